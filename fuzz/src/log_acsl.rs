//! Any bytes as a log of the laboratory's flight stack.

use crate::flights::check_flight;
use sim_publisher::{Format, Import, parse_flight};

/// One run.
pub(crate) fn run(bytes: &[u8]) {
    check_flight(parse_flight(Format::Acsl, bytes, "fuzz", &Import::default()));
}
