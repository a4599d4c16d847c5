//! Any bytes as a snapshot, with a correct header and check sum or without: an error message, or a snapshot that an engine
//! resumes from or refuses. Its estimates are then finite.

use daemon::assemble;
use daemon::config::ConfigFile;
use daemon::engine::Engine;
use daemon::snapshot::{self, Snapshot};
use std::cell::LazyCell;

thread_local! {
    static START: LazyCell<(ConfigFile, Engine)> = const { LazyCell::new(|| {
        let file = ConfigFile::preset("paper-translation").unwrap();
        let engine = Engine::new(&file.config, assemble::estimator(&file).unwrap());
        (file, engine)
    }) };
}

pub(crate) fn run(bytes: &[u8]) {
    let _ = Snapshot::decode(bytes);
    // With a sum that fits, what is behind it is reached.
    let version = snapshot::VERSION.to_le_bytes();
    let whole = [b"obs-snap", version.as_slice(), &crc32fast::hash(bytes).to_le_bytes(), bytes].concat();
    match Snapshot::decode(&whole) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(snapshot) => START.with(|start| {
            let (file, engine) = &**start;
            let _ = snapshot.differences(&file.config);
            // Read back, it is the same: NaN is equal to nothing, so bytes are compared.
            assert_eq!(Snapshot::decode(&snapshot.encode()).unwrap().encode(), snapshot.encode());
            let mut engine = engine.clone();
            if engine.load(&snapshot.checkpoint).is_ok() {
                engine.begin(1_000_000_000_000, 0);
                let estimate = engine.conclude();
                assert!(estimate.is_finite(), "{estimate:?}");
            }
        }),
    }
}
