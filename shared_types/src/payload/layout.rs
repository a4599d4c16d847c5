//! All payloads and modules of constants, for files of other languages; their layouts, checked when this is compiled.

use crate::payload::control::{Command, Reply, command, outcome};
use crate::payload::counters::Counters;
use crate::payload::estimate::{Channel, Estimate, status_bits};
use crate::payload::measurement::{Measurement, frame, valid};
use crate::payload::status::{LatencySummary, Status, real_time, restored};
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
pub const CONSTANTS: [&Constants; 7] = [
    &valid::TABLE,
    &frame::TABLE,
    &status_bits::TABLE,
    &real_time::TABLE,
    &restored::TABLE,
    &command::TABLE,
    &outcome::TABLE,
];

// The layout is the contract with other processes and languages. Another one needs another version in the type name.
const _: () =
    {
        assert!(Measurement::TABLE.is_laid_out(272, &[0, 8, 16, 20, 24, 48, 72, 96, 128, 152, 176, 224]));
        assert!(Channel::TABLE.is_laid_out(56, &[0, 8, 16, 24, 32, 40, 48]));
        assert!(Estimate::TABLE.is_laid_out(
            536,
            &[0, 8, 16, 24, 32, 40, 48, 72, 96, 128, 152, 176, 200, 224, 280, 336, 432, 480]
        ));
        assert!(LatencySummary::TABLE.is_laid_out(48, &[0, 8, 16, 24, 32, 40]));
        assert!(
            Counters::TABLE
                .is_laid_out(240, &[0, 8, 16, 24, 32, 120, 144, 168, 176, 184, 192, 200, 208, 216, 224, 232])
        );
        assert!(Status::TABLE.is_laid_out(
            600,
            &[
                0, 8, 16, 24, 32, 56, 296, 304, 312, 320, 328, 336, 344, 352, 360, 368, 376, 384, 392, 400,
                408, 456, 504, 552
            ]
        ));
        assert!(Truth::TABLE.is_laid_out(216, &[0, 8, 16, 40, 64, 96, 120, 144, 168, 192]));
        assert!(Command::TABLE.is_laid_out(8, &[0, 4]));
        assert!(Reply::TABLE.is_laid_out(856, &[0, 4, 8, 256]));
        assert!(align_of::<Measurement>() == 8 && align_of::<Estimate>() == 8 && align_of::<Reply>() == 8);
    };
