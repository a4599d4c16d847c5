//! Any bytes as a ULog of PX4.

use crate::flights::check_flight;
use sim_publisher::{Format, Import, UlogScales, parse_flight};

/// One run.
pub(crate) fn run(bytes: &[u8]) {
    check_flight(parse_flight(
        Format::Ulog,
        bytes,
        "fuzz",
        &Import {
            scales: UlogScales { thrust_n: Some(30.0), torque_n_m: Some([1.0; 3]), mass_kg: None },
            ..Import::default()
        },
    ));
}
