//! The program for libFuzzer. The environment variable `FUZZ_TARGET` names the target to run.

#![no_main]

use fuzz::{TARGETS, Target};
use std::sync::LazyLock;

static CHOSEN: LazyLock<Target> = LazyLock::new(|| {
    let name = std::env::var("FUZZ_TARGET").unwrap_or_default();
    let found = TARGETS.iter().find(|(target, _)| *target == name);
    found
        .unwrap_or_else(|| {
            panic!("FUZZ_TARGET: found {name:?}, needed: one of {:?}", TARGETS.map(|(n, _)| n))
        })
        .1
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| (*CHOSEN)(bytes));
