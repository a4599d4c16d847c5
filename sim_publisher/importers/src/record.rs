//! The service's flight record: its samples as they arrived, including those that it rejected for their time or source.

use crate::collector::Collector;
use crate::error::{ImportError, Imported};
use crate::importer::{Format, ImportOptions, Importer};
use flight_record::{Entry, Frame, OtherVersion, Reader};
use std::io::{self, Cursor};

/// The service's flight record.
#[derive(Debug)]
pub struct Record;

impl Importer for Record {
    fn format(&self) -> Format {
        Format {
            name: "record",
            about: "Flight record of `daemon run --record FILE`",
            ending: "rec",
            reads: &[],
            airborne_by: None,
            is_built_in: true,
        }
    }

    fn import(&self, bytes: &[u8], file: &str, _: &ImportOptions) -> Imported {
        parse(bytes, file)
    }
}

fn parse(bytes: &[u8], path: &str) -> Imported {
    let refused = |found: String| ImportError::Content(path.into(), found);
    let no_record = |found: String| {
        let needed = "needed: a file of `daemon run --record FILE`";
        refused(format!("no flight record that can be read: {found}; {needed}"))
    };
    let unreadable = |error: io::Error| match OtherVersion::in_error(&error) {
        Some(other) => refused(other.to_string()),
        None => no_record(error.to_string()),
    };
    let mut reader = Reader::new(Cursor::new(bytes));
    let mut flight = Collector::of_recording();
    let (mut sessions, mut ticks_left_out, mut n_samples) = (0_u64, 0, 0);
    while let Some(frame) = reader.next_frame().map_err(unreadable)? {
        match frame {
            Frame::Session(_) => sessions += 1,
            Frame::Entry(entry) => match *entry {
                Entry::Sample { measurement, .. } => {
                    n_samples += 1;
                    flight.add(n_samples, i128::from(measurement.stamp_ns), measurement);
                }
                Entry::Missing(ticks) => ticks_left_out += ticks,
                Entry::Begin { .. } | Entry::Estimate(_) | Entry::Command(_) | Entry::Checkpoint => {}
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

#[cfg(test)]
mod tests {
    use super::*;
    use flight_record::{Session, Writer};
    use shared_types::Measurement;

    /// A record of one session with these samples.
    fn record(samples: &[Measurement]) -> Vec<u8> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("flight.rec");
        let [program_version, instance, config, vector_unit] = [(); 4].map(|()| String::new());
        let session = Session { program_version, instance, config, vector_unit, checkpoint: None };
        let mut writer = Writer::append(&path, &session).unwrap();
        for &measurement in samples {
            writer.push(&Entry::Sample { source: 7, measurement }).unwrap();
        }
        writer.flush().unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn samples_come_back_to_the_bit() {
        let attitude = [0.6, 0.0, 0.8004, 0.0];
        let sample = |j: u64| {
            Measurement::at(1_000_000 + 7 * j, 40 + j)
                .with_velocity_m_s([0.1 + j as f64 / 3.0, -0.0, 1e-300])
                .with_attitude_wxyz(attitude)
        };
        let lost = sample(3).with_velocity_m_s([f64::NAN, 0.0, 0.0]);
        let older = sample(0);
        let bytes = record(&[sample(0), sample(1), sample(2), lost, older]);
        let flight = parse(&bytes, "flight.rec").unwrap();
        assert_eq!((flight.samples.len(), flight.skipped_rows(), flight.values_not_finite), (3, 2, 0));
        assert!(flight.skipped.to_string().contains("(first: sample 4)"), "{}", flight.skipped);
        for (j, found) in (0..3).zip(&flight.samples) {
            let expected = Measurement { stamp_ns: 7 * j, sequence: j, ..sample(j) };
            assert_eq!(format!("{found:?}"), format!("{expected:?}"));
        }
        // Torn: shorter, and said; a text: a sentence.
        let torn = parse(&bytes[..bytes.len() - 3], "flight.rec").unwrap();
        assert_eq!((torn.samples.len(), torn.remarks.len()), (3, 1));
        let error = parse(b"time,vx\n", "flight.csv").unwrap_err().to_string();
        assert!(error.contains("no flight record") && error.contains("daemon run --record"), "{error}");
    }

    #[test]
    fn a_record_of_another_version_is_refused_with_the_file_and_one_remedy() {
        let mut older = record(&[]);
        older[14] = b'1';
        let error = parse(&older, "flight.rec").unwrap_err().to_string();
        assert!(error.contains("flight.rec") && error.contains("of version 1"), "{error}");
        assert_eq!(error.matches("needed").count(), 1, "{error}");
    }
}
