//! Facts about the disk on which snapshots are stored.

use super::fact::Fact;
use crate::snapshot;
use crate::system::state_directory::{STATE_VARIABLE, state_directory};
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// A snapshot of some hundred centers.
const TEST_BYTES: usize = 4096;
/// A sync that takes longer than this holds up the end of a service.
const SLOW_MS: f64 = 2000.0;

/// Whether snapshots can be written to their directory, and how long that takes.
pub(super) fn snapshots() -> Fact {
    const NAME: &str = "snapshots";
    let asked = std::env::var_os(STATE_VARIABLE);
    let Some(directory) = state_directory(asked.as_deref().map(Path::new)) else {
        let remedy = "set HOME, or start with --state DIR";
        return Fact::better(NAME, "no directory for them: nothing learned is kept", remedy);
    };
    let name = directory.display();
    if !directory.exists() {
        return Fact::good(NAME, format!("{name}, not there yet"));
    }
    match snapshot::make_directory(&directory).and_then(|()| write_test(&directory)) {
        Ok(ms) if ms > SLOW_MS => {
            let remedy = "--state DIR on a faster or a less busy disk";
            Fact::better(NAME, format!("{name}: written and synced in {ms:.0} ms"), remedy)
        }
        Ok(ms) => Fact::good(NAME, format!("{name}: written and synced in {ms:.1} ms")),
        Err(error) => Fact::bad(NAME, format!("{name}: {error}"), "--state DIR that this user can write"),
    }
}

/// Writes, syncs and removes a small file. Returns the time of the first two (ms).
fn write_test(directory: &Path) -> std::io::Result<f64> {
    let path = directory.join(format!("doctor-{}", std::process::id()));
    let start = Instant::now();
    let mut file = OpenOptions::new().write(true).create_new(true).open(&path)?;
    let written = file.write_all(&[0; TEST_BYTES]).and_then(|()| file.sync_all());
    let ms = start.elapsed().as_secs_f64() * 1e3;
    std::fs::remove_file(&path)?;
    written.map(|()| ms)
}
