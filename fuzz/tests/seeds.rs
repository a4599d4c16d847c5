//! Runs every seed through its target, without instrumentation, so that the faults found by fuzzing stay fixed.

use fuzz::TARGETS;
use std::panic::catch_unwind;
use std::path::Path;

mod programs;

/// For all targets: nothing, one byte over and over, all bytes in order.
fn plain_inputs() -> Vec<(String, Vec<u8>)> {
    let mut inputs =
        vec![(String::from("empty"), Vec::new()), (String::from("counting"), (0..=255).collect())];
    inputs.extend([0, 1, 64, 200, 255].map(|byte| (format!("192 times {byte}"), vec![byte; 192])));
    inputs
}

#[test]
fn every_seed_keeps_its_property() {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("seeds");
    let (mut n_seeds, mut failed) = (0, Vec::new());
    for (name, target) in TARGETS {
        let mut inputs = plain_inputs();
        let n_before = inputs.len();
        for entry in std::fs::read_dir(seeds.join(name)).into_iter().flatten() {
            let path = entry.unwrap().path();
            inputs.push((path.display().to_string(), std::fs::read(&path).unwrap()));
        }
        let n_of_target = inputs.len() - n_before;
        assert!(n_of_target > 0, "found no seed of {name}, needed: one or more in seeds/{name}");
        n_seeds += n_of_target;
        for (input, bytes) in inputs {
            if catch_unwind(|| target(&bytes)).is_err() {
                failed.push(format!("{name}: {input}"));
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
    assert!(n_seeds > 200, "found {n_seeds} seeds");
}

#[test]
fn every_folder_of_seeds_belongs_to_a_target() {
    for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("seeds")).unwrap() {
        let folder = entry.unwrap().file_name();
        assert!(TARGETS.iter().any(|(name, _)| *name == folder), "{folder:?}");
    }
}
