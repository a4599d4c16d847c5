//! Any bytes as a ULog of PX4.

#![no_main]

use importers::{ImportOptions, Ulog};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let options =
        ImportOptions { thrust_n: Some(30.0), torque_n_m: Some([1.0; 3]), ..ImportOptions::default() };
    fuzz::check_log(&Ulog, bytes, &options);
});
