//! Any bytes as a log of the laboratory's flight stack.

#![no_main]

use libfuzzer_sys::fuzz_target;
use sim_publisher::{Format, Import, parse_flight};

fuzz_target!(|bytes: &[u8]| fuzz::check_flight(parse_flight(
    Format::Acsl,
    bytes,
    "fuzz",
    &Import::default()
)));
