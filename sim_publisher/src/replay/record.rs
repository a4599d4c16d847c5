//! The service's own flight record: the samples as they arrived, also those that it rejected.

use super::{Collector, ImportError, Place, RecordedFlight};
use daemon::record::{Entry, Frame, Reader};
use std::io::Cursor;

pub(super) fn parse(bytes: &[u8], path: &str) -> Result<RecordedFlight, ImportError> {
    let no_record = |found: String| ImportError::NoRecord { path: path.into(), found };
    let mut reader = Reader::new(Cursor::new(bytes));
    let mut flight = Collector::counted_by(Place::Sample);
    let (mut sessions, mut ticks_left_out, mut n_samples) = (0_u64, 0, 0);
    while let Some(frame) = reader.next_frame().map_err(|error| no_record(error.to_string()))? {
        match frame {
            Frame::Session(_) => sessions += 1,
            Frame::Entry(entry) => match *entry {
                Entry::Sample { measurement, .. } => {
                    n_samples += 1;
                    flight.add(n_samples, i128::from(measurement.stamp_ns), measurement);
                }
                Entry::Missing(ticks) => ticks_left_out += ticks,
                Entry::Begin { .. } | Entry::Estimate(_) | Entry::Command(_) | Entry::Kept => {}
            },
        }
    }
    if sessions == 0 {
        return Err(no_record(format!("{} bytes without the start of a session", bytes.len())));
    }
    if reader.torn_bytes() > 0 {
        flight.remarks.push(format!("{} bytes at torn places were left out", reader.torn_bytes()));
    }
    if ticks_left_out > 0 {
        flight.remarks.push(format!("{ticks_left_out} ticks were not recorded: the disk was too slow"));
    }
    if sessions > 1 {
        flight.remarks.push(format!("{sessions} starts of the service, one after the other"));
    }
    flight.finish(path, None)
}
