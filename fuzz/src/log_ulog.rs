//! Any bytes as a ULog of PX4.

#![no_main]

use libfuzzer_sys::fuzz_target;
use sim_publisher::{Format, Import, UlogScales, parse_flight};

fuzz_target!(|bytes: &[u8]| fuzz::check_flight(parse_flight(
    Format::Ulog,
    bytes,
    "fuzz",
    &Import {
        scales: UlogScales { thrust_n: Some(30.0), torque_n_m: Some([1.0; 3]), mass_kg: None },
        ..Import::default()
    }
)));
