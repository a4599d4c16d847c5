//! Replays a flight record: runs the engine on its samples and instants, and compares every estimate with the published one.

use crate::assemble;
use crate::config::{ConfigError, ConfigFile};
use crate::engine::Engine;
use crate::snapshot::decode_checkpoint;
use flight_record::{Entry, Frame, Reader, Session};
use serde::Serialize;
use shared_types::payload::Estimate;
use std::io::{Read, Seek};

/// Why a record cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The file has no session.
    #[error("no session in it: it is no flight record; needed: a file of `daemon run --record FILE`")]
    NoSession,
    /// The configuration of a session cannot be read.
    #[error("recorded by version {program_version}: {cause}")]
    Config {
        /// Version of the program that wrote it.
        program_version: String,
        /// What is wrong with it.
        cause: ConfigError,
    },
    /// The checkpoint that a session was resumed from is of another version, damaged, or does not fit its configuration.
    #[error(
        "recorded by version {program_version}: its session began with a checkpoint that cannot be used: {cause}"
    )]
    Checkpoint {
        /// Version of the program that wrote it.
        program_version: String,
        /// What was found, and what is needed.
        cause: String,
    },
}

/// Where a replay first differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Sequence of the estimate: the tick, counted from the start of the session.
    pub tick: u64,
    /// When it was published (ns).
    pub publish_stamp_ns: u64,
    /// The first field that differs.
    pub field: String,
    /// Its value in the record.
    pub recorded: String,
    /// Its value now.
    pub replayed: String,
}

/// The result for one session of a record.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SessionReport {
    /// Name of the vehicle.
    pub instance: String,
    /// Version of the program that wrote it.
    pub program_version: String,
    /// Vector unit that it ran with.
    pub vector_unit: String,
    /// Whether it began with what an earlier one had learned.
    pub resumed: bool,
    /// Ticks whose estimates are the same to the bit.
    pub ticks_same: u64,
    /// Samples that the engine took.
    pub samples: u64,
    /// From its first to its last tick (s).
    pub duration_s: f64,
    /// Ticks that the recorder left out.
    pub ticks_missing: u64,
    /// Ticks after those that cannot be checked: what they depend on is not in the record.
    pub ticks_unchecked: u64,
    /// Where it differs first; the rest of the session is not compared.
    pub difference: Option<Difference>,
}

/// The configuration of a session.
///
/// # Errors
/// As [`ConfigFile::parse`]: it was written by another version.
pub fn config_of(session: &Session) -> Result<ConfigFile, ConfigError> {
    ConfigFile::parse("the record's configuration".into(), session.config.clone())
}

/// A session that is being replayed.
struct Replay {
    engine: Engine,
    report: SessionReport,
    is_checked: bool,
    first_wake_ns: Option<u64>,
}

/// Replays every session.
///
/// # Errors
/// The file cannot be read or is no record; a session's configuration is of another version.
pub fn check<R: Read + Seek>(reader: &mut Reader<R>) -> Result<Vec<SessionReport>, ReplayError> {
    let mut reports = Vec::new();
    let mut replay: Option<Replay> = None;
    while let Some(frame) = reader.next_frame()? {
        match frame {
            Frame::Session(session) => {
                reports.extend(replay.take().map(|replay| replay.report));
                replay = Some(Replay::of(&session)?);
            }
            Frame::Entry(entry) => {
                if let Some(replay) = &mut replay {
                    replay.take(&entry);
                }
            }
        }
    }
    reports.extend(replay.map(|replay| replay.report));
    if reports.is_empty() { Err(ReplayError::NoSession) } else { Ok(reports) }
}

impl Replay {
    fn of(session: &Session) -> Result<Self, ReplayError> {
        let config_error =
            |cause| ReplayError::Config { program_version: session.program_version.clone(), cause };
        let file = config_of(session).map_err(config_error)?;
        let mut engine = Engine::new(&file.config, assemble::estimator(&file).map_err(config_error)?);
        if let Some(bytes) = &session.checkpoint {
            let refused = |cause: String| ReplayError::Checkpoint {
                program_version: session.program_version.clone(),
                cause,
            };
            let checkpoint = decode_checkpoint(bytes).map_err(|error| refused(error.to_string()))?;
            engine.load(&checkpoint).map_err(refused)?;
        }
        let report = SessionReport {
            instance: session.instance.clone(),
            program_version: session.program_version.clone(),
            vector_unit: session.vector_unit.clone(),
            resumed: session.checkpoint.is_some(),
            ..SessionReport::default()
        };
        Ok(Self { engine, report, is_checked: true, first_wake_ns: None })
    }

    fn take(&mut self, entry: &Entry) {
        match entry {
            Entry::Begin { wake_ns, late_ticks_in_a_row } => {
                self.engine.begin(*wake_ns, *late_ticks_in_a_row);
                let first_ns = *self.first_wake_ns.get_or_insert(*wake_ns);
                self.report.duration_s = wake_ns.saturating_sub(first_ns) as f64 / 1e9;
            }
            Entry::Sample { source, measurement } => {
                self.report.samples += 1;
                self.engine.take(measurement, *source);
            }
            Entry::Estimate(recorded) => self.compare(recorded),
            Entry::Command(command) => self.engine.carry_out(*command),
            Entry::Checkpoint => self.engine.save(),
            Entry::Missing(ticks) => {
                self.report.ticks_missing = self.report.ticks_missing.saturating_add(*ticks);
                self.is_checked = false;
            }
        }
    }

    fn compare(&mut self, recorded: &Estimate) {
        if !self.is_checked {
            self.report.ticks_unchecked += 1;
            return;
        }
        // The time of publication comes from the clock.
        let replayed = Estimate { publish_stamp_ns: recorded.publish_stamp_ns, ..self.engine.conclude() };
        match difference(recorded, &replayed) {
            None => self.report.ticks_same += 1,
            Some((field, recorded_value, replayed_value)) => {
                self.is_checked = false;
                self.report.difference = Some(Difference {
                    tick: recorded.sequence,
                    publish_stamp_ns: recorded.publish_stamp_ns,
                    field,
                    recorded: recorded_value,
                    replayed: replayed_value,
                });
            }
        }
    }
}

/// The first field that differs, and its two values.
fn difference(recorded: &Estimate, replayed: &Estimate) -> Option<(String, String, String)> {
    // Bytes are compared, because equal numbers may have different bits (-0 and 0), and NaN is not equal to itself.
    let bytes = |estimate: &Estimate| postcard::to_allocvec(estimate).expect("numbers");
    if bytes(recorded) == bytes(replayed) {
        return None;
    }
    let fields = |estimate: &Estimate| {
        let mut fields = Vec::new();
        leaves(&serde_json::to_value(estimate).expect("numbers"), String::new(), &mut fields);
        fields
    };
    let pairs = fields(recorded).into_iter().zip(fields(replayed));
    let first = pairs.into_iter().find(|((_, then), (_, now))| then != now);
    let unnamed = || ("a value that is no number".into(), "other bits".into(), "other bits".into());
    Some(first.map_or_else(unnamed, |((field, then), (_, now))| (field, then, now)))
}

/// The numbers of a document with their paths.
fn leaves(value: &serde_json::Value, path: String, found: &mut Vec<(String, String)>) {
    match value {
        serde_json::Value::Object(fields) => {
            let dot = if path.is_empty() { "" } else { "." };
            fields.iter().for_each(|(name, value)| leaves(value, format!("{path}{dot}{name}"), found));
        }
        serde_json::Value::Array(values) => {
            values.iter().enumerate().for_each(|(j, value)| leaves(value, format!("{path}[{j}]"), found));
        }
        leaf => found.push((path, leaf.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Checkpoint;
    use crate::snapshot::encode_checkpoint;

    /// A session that begins with these bytes as its checkpoint.
    fn begun_with(checkpoint: &[u8]) -> Result<Replay, ReplayError> {
        let config = ConfigFile::preset("paper-translation").unwrap().config;
        let checkpoint = Some(checkpoint.to_vec());
        Replay::of(&Session { checkpoint, ..crate::threads::recorder::session(&config, "vehicle", None) })
    }

    #[test]
    fn a_checkpoint_of_another_version_or_length_is_refused() {
        let file = ConfigFile::preset("paper-translation").unwrap();
        let engine = Engine::new(&file.config, assemble::estimator(&file).unwrap());
        let checkpoint = Checkpoint { learned: vec![1.0; engine.n_learned()], state: engine.saved_state() };
        let bytes = encode_checkpoint(&checkpoint);
        assert!(begun_with(&bytes).is_ok());
        let refused = |bytes: &[u8]| begun_with(bytes).err().unwrap().to_string();
        let mut other = bytes.clone();
        other[0] = 1;
        let sentence = refused(&other);
        assert!(sentence.contains("version 1; this program reads version 6"), "{sentence}");
        assert!(refused(&[&bytes[..], &[0]].concat()).contains("1 bytes too many"));
        for length in [0, 3, 4, bytes.len() - 1] {
            refused(&bytes[..length]);
        }
        let less = Checkpoint { learned: vec![1.0; 2], ..checkpoint };
        assert!(refused(&encode_checkpoint(&less)).contains("2 learned numbers; needed"));
    }

    #[test]
    fn the_first_field_that_differs_is_named() {
        let mut one = Estimate { velocity_m_s: [0.0, 1.0, f64::NAN], ..Estimate::default() };
        assert_eq!(difference(&one, &one), None);
        let mut other = one;
        other.velocity_m_s[1] += f64::EPSILON;
        other.status = 7;
        let (field, recorded, replayed) = difference(&one, &other).unwrap();
        assert!(field == "status" || field == "velocity_m_s[1]", "{field}");
        assert_ne!(recorded, replayed);
        // Bits, not values.
        other = one;
        other.position_m[0] = -0.0;
        assert_eq!(difference(&one, &other).unwrap().0, "position_m[0]");
        one.velocity_m_s[2] = -f64::NAN;
        assert!(difference(&one, &Estimate { velocity_m_s: [0.0, 1.0, f64::NAN], ..one }).is_some());
    }
}
