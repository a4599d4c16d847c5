//! Any bytes as a log of the laboratory's flight stack.

#![no_main]

use importers::{Acsl, ImportOptions};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| fuzz::check_log(&Acsl, bytes, &ImportOptions::default()));
