//! The list of all payloads and modules of constants, for the files of other languages and the record of layouts.

use crate::payload::estimate::{Channel, Estimate, status_bits};
use crate::payload::measurement::{Measurement, absent, flags, frame, valid};
use crate::payload::status::{
    Command, Counters, LatencySummary, Reply, Status, command, outcome, real_time, restored,
};
use crate::payload::truth::Truth;
use crate::table::{Constants, Payload, Table};

/// Every payload, each after those that it holds.
pub const PAYLOADS: [&Table; 9] = [
    &Measurement::TABLE,
    &Channel::TABLE,
    &Estimate::TABLE,
    &LatencySummary::TABLE,
    &Counters::TABLE,
    &Status::TABLE,
    &Truth::TABLE,
    &Command::TABLE,
    &Reply::TABLE,
];

/// Every module of constants.
pub const CONSTANTS: [&Constants; 9] = [
    &valid::TABLE,
    &frame::TABLE,
    &flags::TABLE,
    &absent::TABLE,
    &status_bits::TABLE,
    &real_time::TABLE,
    &restored::TABLE,
    &command::TABLE,
    &outcome::TABLE,
];

// A gap would be undefined bytes in shared memory.
const _: () = {
    let mut i = 0;
    while i < PAYLOADS.len() {
        assert!(PAYLOADS[i].is_sound());
        i += 1;
    }
};
