//! Recorded flights as samples.
//!
//! What a file holds is checked row by row: a row that cannot be used is skipped and counted, with its line and
//! reason; a file of which nothing can be used is an error.

mod acsl;
mod mcap;
mod record;
mod table;
mod ulog;

pub use mcap::mcap_topics;
pub use table::{CsvMap, MapError, TimeUnit, VelocityAxes, column_names, write_table};
pub use ulog::{UlogContents, UlogScales, ulog_contents};

use shared_types::payload::QUATERNION_NORM_TOLERANCE;
use shared_types::payload::valid;
use shared_types::{Measurement, logln};
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// How a recorded flight is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Log of the ACSL flight stack: inertial velocity, body rates, position, attitude, thrust and torques
    Acsl,
    /// Any table with a line of column names; which column is what, --column or --map says
    Csv,
    /// Recording of monitor record, of several vehicles --topic says which; of other recordings --column says what is where
    Mcap,
    /// PX4's ULog, topics joined by time stamp; the force of a full set-point, --thrust-n or --mass-kg says
    Ulog,
    /// Flight record of `daemon run --record`
    Record,
}

/// What a file does not say of itself.
#[derive(Debug, Clone, PartialEq, Default, clap::Args)]
pub struct ImportOptions {
    /// Which column holds what (csv; mcap: KEY=/topic:path.to.field), KEY=COLUMN; may be repeated, and wins over --map
    #[arg(long, value_name = "KEY=COLUMN")]
    pub column: Vec<String>,
    /// TOML file of such pairs (csv, mcap)
    #[arg(long, value_name = "FILE")]
    pub map: Option<PathBuf>,
    /// Which measurements (mcap), for example /vehicle/measurement [default: the only ones]
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// Force of a thrust set-point of 1 (ulog) [default: from --mass-kg and the log's hover thrust]
    #[arg(long, value_name = "N")]
    pub thrust_n: Option<f64>,
    /// Mass, which the log's hover thrust carries (ulog)
    #[arg(long, value_name = "KG")]
    pub mass_kg: Option<f64>,
    /// Torque of a torque set-point of 1 (ulog): one number, or three with commas [default: no torque]
    #[arg(long, value_name = "N_M", value_parser = crate::cli::parse_axes)]
    pub torque_n_m: Option<[f64; 3]>,
}

/// What a file does not say of itself, ready for use.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Import {
    /// Which column holds what (csv, mcap).
    pub map: CsvMap,
    /// Which measurements (mcap); `None` for the only ones.
    pub topic: Option<String>,
    /// Force and torque of set-points (ulog).
    pub scales: UlogScales,
}

impl ImportOptions {
    /// What the options say of a file of this format.
    ///
    /// # Errors
    /// `Map` or `Option` where they are not usable.
    pub fn import(&self, format: Format) -> Result<Import, ImportError> {
        self.check(format)?;
        let Self { thrust_n, mass_kg, torque_n_m, .. } = *self;
        Ok(Import {
            map: CsvMap::read(self.map.as_deref(), &self.column)?,
            topic: self.topic.clone(),
            scales: UlogScales { thrust_n, torque_n_m, mass_kg },
        })
    }

    /// # Errors
    /// An option that this format has no use for, or a number that is none.
    fn check(&self, format: Format) -> Result<(), ImportError> {
        let of_tables = self.map.is_some() || !self.column.is_empty();
        let of_ulog = self.thrust_n.or(self.mass_kg).is_some() || self.torque_n_m.is_some();
        let numbers = self.thrust_n.iter().chain(&self.mass_kg).chain(self.torque_n_m.iter().flatten());
        let wrong = |what: &str| Err(ImportError::Option(what.into()));
        match format {
            Format::Acsl | Format::Csv | Format::Ulog | Format::Record if self.topic.is_some() => {
                wrong("--topic is for --format mcap")
            }
            Format::Mcap if of_tables && self.topic.is_some() => wrong(
                "--topic and columns: needed: one of them; a column's topic is in --column KEY=/topic:path",
            ),
            Format::Acsl | Format::Ulog | Format::Record if of_tables => {
                wrong("--column and --map are for --format csv and mcap; other logs name their own columns")
            }
            Format::Acsl | Format::Csv | Format::Mcap | Format::Record if of_ulog => wrong(
                "--thrust-n, --mass-kg and --torque-n-m are for --format ulog; other logs say their forces",
            ),
            _ => match numbers.into_iter().find(|number| !(number.is_finite() && **number > 0.0)) {
                Some(number) => {
                    wrong(&format!("--thrust-n, --mass-kg, --torque-n-m: found {number}; needed: above 0"))
                }
                None => Ok(()),
            },
        }
    }
}

impl Format {
    /// The format that a file's ending tells, if any.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "log" => Some(Self::Acsl),
            "csv" => Some(Self::Csv),
            "mcap" => Some(Self::Mcap),
            "ulg" => Some(Self::Ulog),
            "rec" => Some(Self::Record),
            _ => None,
        }
    }
}

/// Why a file cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The system refused.
    #[error("cannot read '{path}': {source}")]
    Io {
        /// Which file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file has no bytes, or no line of names.
    #[error("'{path}' is empty; needed: a line of column names, then rows")]
    Empty {
        /// Which file.
        path: String,
    },
    /// A column is not there.
    #[error("'{path}' has no column '{column}'; its columns are: {found}")]
    MissingColumn {
        /// Which file.
        path: String,
        /// What was looked for.
        column: String,
        /// The file's columns.
        found: String,
    },
    /// It is no ULog, or damaged from the start.
    #[error("'{path}' is no ULog: {found}; needed: a log of PX4 (.ulg)")]
    NoUlog {
        /// Which file.
        path: String,
        /// What was found.
        found: String,
    },
    /// It is no flight record, or none that this version reads.
    #[error(
        "'{path}' is no flight record that can be read: {found}; needed: a file of `daemon run --record`"
    )]
    NoRecord {
        /// Which file.
        path: String,
        /// What was found.
        found: String,
    },
    /// None of the topics that say how the vehicle moves.
    #[error(
        "'{path}' has none of vehicle_local_position, vehicle_angular_velocity, vehicle_attitude; its topics are: {found}"
    )]
    MissingTopics {
        /// Which file.
        path: String,
        /// The file's topics.
        found: String,
    },
    /// No recording with measurements.
    #[error("'{path}': {found}")]
    Mcap {
        /// Which file.
        path: String,
        /// What was found, and needed.
        found: String,
    },
    /// An option does not belong to this format.
    #[error("{0}")]
    Option(String),
    /// No row can be used.
    #[error("'{path}' has no usable row; {skipped}")]
    NoUsableRow {
        /// Which file.
        path: String,
        /// What was skipped, and why.
        skipped: Skipped,
    },
    /// The map of columns contradicts itself or lacks something.
    #[error(transparent)]
    Map(#[from] MapError),
}

/// Why a row was skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SkipReason {
    /// Fewer values than names: a truncated line.
    TooFewValues,
    /// A needed value is no number, or not finite.
    NotANumber,
    /// The time is not later than that of the row before.
    TimeNotIncreasing,
    /// The time is more than a second ahead, and the rows after it go back.
    TimeAhead,
    /// The attitude is no unit quaternion within 5 %.
    NoUnitQuaternion,
    /// No field of the row has a value.
    NothingMeasured,
    /// A force along the body's axes, before the first attitude.
    NoAttitudeYet,
    /// The file has no end, or is damaged: nothing is read from here on.
    EndsEarly,
}

impl SkipReason {
    /// The reason in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::TooFewValues => "fewer values than column names",
            Self::NotANumber => "a needed value is not a finite number",
            Self::TimeNotIncreasing => "time not later than in the row before",
            Self::TimeAhead => "time ahead of the rows after it",
            Self::NoUnitQuaternion => "attitude not of unit norm",
            Self::NothingMeasured => "no value at all",
            Self::NoAttitudeYet => "thrust before the first attitude",
            Self::EndsEarly => "cut off or damaged, and not read from there on",
        }
    }
}

/// Where in a file something is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Place {
    /// The file's lines, from 1.
    #[default]
    Line,
    /// The file's samples, from 1.
    Sample,
    /// The file's own clock (µs).
    Microsecond,
}

/// Rows that were skipped, by reason, each with the place of the first.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Skipped {
    reasons: Vec<(SkipReason, usize, u64)>,
    place: Place,
}

impl Skipped {
    /// How many rows, for any reason.
    pub fn rows(&self) -> usize {
        self.reasons.iter().map(|(_, rows, _)| rows).sum()
    }

    /// How many rows, for this reason.
    pub fn for_reason(&self, reason: SkipReason) -> usize {
        self.reasons.iter().find(|(known, ..)| *known == reason).map_or(0, |(_, rows, _)| *rows)
    }

    fn add(&mut self, reason: SkipReason, place: u64) {
        match self.reasons.iter_mut().find(|(known, ..)| *known == reason) {
            Some((_, rows, _)) => *rows += 1,
            None => self.reasons.push((reason, 1, place)),
        }
    }
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = if self.place == Place::Line { "rows" } else { "samples" };
        write!(f, "{} {rows} skipped", self.rows())?;
        for (index, (reason, rows, first)) in self.reasons.iter().enumerate() {
            let separator = if index == 0 { ':' } else { ',' };
            write!(f, "{separator} {rows} × {} (first: ", reason.words())?;
            match self.place {
                Place::Line => write!(f, "line {first})"),
                Place::Sample => write!(f, "sample {first})"),
                Place::Microsecond => write!(f, "at {first} µs of the log)"),
            }?;
        }
        Ok(())
    }
}

/// A recorded flight, ready to be published.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedFlight {
    /// The samples; sequences count from 0, with the gaps that a recording (mcap) has; stamps from the first sample.
    pub samples: Vec<Measurement>,
    /// Rows that could not be used.
    pub skipped: Skipped,
    /// Values that were given as not finite, and left their field without a measurement.
    pub values_not_finite: usize,
    /// Samples in the air, where the format tells.
    pub airborne: Option<Range<usize>>,
    /// What a person should know of the file: where it ends too early, what it lacks. A sentence each.
    pub remarks: Vec<String>,
}

impl RecordedFlight {
    /// Rows that could not be used.
    pub fn skipped_rows(&self) -> usize {
        self.skipped.rows()
    }

    /// What a person should know before the flight is used: the remarks, and what was left out. A sentence each.
    pub fn findings(&self) -> Vec<String> {
        let mut findings = self.remarks.clone();
        if self.skipped_rows() > 0 {
            findings.push(self.skipped.to_string());
        }
        if self.values_not_finite > 0 {
            findings.push(format!(
                "{} values not finite; their fields carry no measurement",
                self.values_not_finite
            ));
        }
        findings
    }

    /// From the first to the last sample (s).
    pub fn duration_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |last| last.stamp_ns as f64 * 1e-9)
    }

    /// Start and end of the time in the air (s), after the first sample.
    pub fn airborne_s(&self) -> Option<(f64, f64)> {
        let range = self.airborne.clone()?;
        let stamp_s = |index: usize| self.samples.get(index).map(|sample| sample.stamp_ns as f64 * 1e-9);
        Some((stamp_s(range.start)?, stamp_s(range.end.checked_sub(1)?)?))
    }

    /// The part in the air, as a flight of its own; `None` where the format does not tell, or nothing flew.
    pub fn airborne_only(&self) -> Option<Self> {
        let mut samples = self.samples.get(self.airborne.clone()?)?.to_vec();
        let start_ns = samples.first()?.stamp_ns;
        for (sequence, sample) in samples.iter_mut().enumerate() {
            sample.sequence = sequence as u64;
            sample.stamp_ns -= start_ns;
        }
        Some(Self { airborne: Some(0..samples.len()), samples, ..self.clone() })
    }
}

/// Reads a recorded flight.
///
/// # Errors
/// What is wrong with the file, and `Map` or `Option` where the options are not usable.
pub fn read_flight(
    format: Format,
    path: &Path,
    options: &ImportOptions,
) -> Result<RecordedFlight, ImportError> {
    let import = options.import(format)?;
    parse_flight(format, &read_file(path)?, &path.display().to_string(), &import)
}

pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, ImportError> {
    std::fs::read(path).map_err(|source| ImportError::Io { path: path.display().to_string(), source })
}

/// Says on standard error what a person should know before the flight is used.
pub fn say_findings(flight: &RecordedFlight, file: &str) {
    for finding in flight.findings() {
        logln!("'{file}': {finding}");
    }
}

/// A recorded flight from the bytes of its file; `name` stands for that in messages.
///
/// # Errors
/// As [`read_flight`], without `Io`.
pub fn parse_flight(
    format: Format,
    bytes: &[u8],
    name: &str,
    import: &Import,
) -> Result<RecordedFlight, ImportError> {
    let Import { map, topic, scales } = import;
    match format {
        Format::Record => record::parse(bytes, name),
        Format::Ulog => ulog::parse(bytes, name, scales),
        Format::Acsl => acsl::parse(bytes, name),
        Format::Csv => table::parse(bytes, name, map),
        Format::Mcap => mcap::parse(bytes, name, map, topic.as_deref()),
    }
}

/// Collects rows into a flight: times strictly increasing, stamps relative to the first.
#[derive(Debug, Default)]
struct Collector {
    samples: Vec<Measurement>,
    skipped: Skipped,
    values_not_finite: usize,
    first_ns: Option<i128>,
    remarks: Vec<String>,
    /// Samples stay as they are, or are left out whole, as the service's gate did: its own are no rounded ones.
    is_exact: bool,
}

impl Collector {
    fn counted_by(place: Place) -> Self {
        Self { skipped: Skipped { place, ..Skipped::default() }, ..Self::default() }
    }

    /// For what the service itself was given.
    fn of_recording() -> Self {
        Self { is_exact: true, ..Self::counted_by(Place::Sample) }
    }

    /// Adds a row taken at `time_ns`, any origin; its sequence and stamp are set here.
    fn add(&mut self, line: u64, time_ns: i128, sample: Measurement) -> bool {
        let accepted = self.place(line, time_ns, sample);
        if let Err(reason) = accepted {
            self.skipped.add(reason, line);
        }
        accepted.is_ok()
    }

    fn place(&mut self, line: u64, time_ns: i128, mut sample: Measurement) -> Result<(), SkipReason> {
        if self.is_exact && !sample.is_finite() {
            return Err(SkipReason::NotANumber);
        }
        if sample.valid == 0 {
            return Err(SkipReason::NothingMeasured);
        }
        if sample.has(valid::ATTITUDE) {
            let tolerance = if self.is_exact { QUATERNION_NORM_TOLERANCE } else { ROUNDED_NORM_TOLERANCE };
            let unit = unit(sample.attitude_wxyz, tolerance).ok_or(SkipReason::NoUnitQuaternion)?;
            if !self.is_exact {
                sample.attitude_wxyz = unit;
            }
        }
        let first_ns = self.first_ns.unwrap_or(time_ns);
        let stamp_ns = u64::try_from(time_ns - first_ns).map_err(|_| SkipReason::TimeNotIncreasing)?;
        self.forget_a_jump_ahead(line, stamp_ns);
        if self.samples.last().is_some_and(|previous| previous.stamp_ns >= stamp_ns) {
            return Err(SkipReason::TimeNotIncreasing);
        }
        self.first_ns = Some(first_ns);
        (sample.sequence, sample.stamp_ns) = (self.samples.len() as u64, stamp_ns);
        self.samples.push(sample);
        Ok(())
    }

    /// Samples after a jump ahead that this one goes back behind were stamped by a clock that erred: without this, all that
    /// follows would be late until the time has caught up.
    fn forget_a_jump_ahead(&mut self, line: u64, stamp_ns: u64) {
        const JUMP_NS: u64 = 1_000_000_000;
        if self.samples.last().is_none_or(|last| last.stamp_ns <= stamp_ns) {
            return;
        }
        let after_jump = self.samples.partition_point(|sample| sample.stamp_ns <= stamp_ns);
        let jump = after_jump.checked_sub(1).zip(self.samples.get(after_jump));
        let is_ahead = jump.is_some_and(|(before, after)| {
            after.stamp_ns - self.samples[before].stamp_ns > JUMP_NS
                && self.samples[before].stamp_ns < stamp_ns
        });
        if is_ahead {
            for _ in self.samples.drain(after_jump..) {
                self.skipped.add(SkipReason::TimeAhead, line);
            }
        }
    }

    fn finish(self, path: &str, airborne: Option<Range<usize>>) -> Result<RecordedFlight, ImportError> {
        let Self { samples, skipped, values_not_finite, remarks, .. } = self;
        if samples.is_empty() {
            return Err(ImportError::NoUsableRow { path: path.into(), skipped });
        }
        Ok(RecordedFlight { samples, skipped, values_not_finite, airborne, remarks })
    }
}

/// Logs round their values.
const ROUNDED_NORM_TOLERANCE: f64 = 0.05;

/// The quaternion of unit norm, where it is one within the tolerance. One of unit norm stays as it is.
fn unit(wxyz: [f64; 4], tolerance: f64) -> Option<[f64; 4]> {
    let norm = wxyz.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (norm - 1.0).abs() < 1e-9 {
        return Some(wxyz);
    }
    ((norm - 1.0).abs() < tolerance).then(|| wxyz.map(|x| x / norm))
}

/// A time as nanoseconds, exactly where it is written as a decimal: a double cannot hold today's date in ns.
fn parse_ns(text: &str, ns_per_unit: i128) -> Option<i128> {
    let decimal = || {
        let (sign, digits) = match text.strip_prefix('-') {
            Some(digits) => (-1, digits),
            None => (1, text),
        };
        let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
        let is_decimal = |part: &str| part.len() <= 21 && part.bytes().all(|b| b.is_ascii_digit());
        if whole.is_empty() || !is_decimal(whole) || !is_decimal(fraction) {
            return None;
        }
        let mut ns = whole.parse::<i128>().ok()? * ns_per_unit;
        let mut place = ns_per_unit;
        for digit in fraction.bytes() {
            place /= 10;
            ns += i128::from(digit - b'0') * place;
        }
        Some(sign * ns)
    };
    let rounded = || {
        let value: f64 = text.parse().ok()?;
        let ns = (value * ns_per_unit as f64).round();
        (ns.abs() < 1e30).then_some(ns as i128)
    };
    decimal().or_else(rounded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_errs_ahead_costs_its_own_samples_alone() {
        let stamps_ms = [0, 10, 20, 60_030, 60_040, 30, 40, 2_000, 2_010, 2_005, 15, 2_020];
        let mut flight = Collector::default();
        let sample = Measurement::default().with_velocity_m_s([1.0, 0.0, 0.0]);
        for (line, stamp_ms) in stamps_ms.into_iter().enumerate() {
            flight.add(line as u64, 5 + stamp_ms * 1_000_000, sample);
        }
        let flight = flight.finish("f", None).unwrap();
        let kept: Vec<_> = flight.samples.iter().map(|sample| sample.stamp_ns / 1_000_000).collect();
        // A gap is no jump, as long as nothing goes back behind it; what is late in order stays late.
        assert_eq!(kept, [0, 10, 20, 30, 40, 2_000, 2_010, 2_020]);
        let of = |reason| flight.skipped.for_reason(reason);
        assert_eq!((of(SkipReason::TimeAhead), of(SkipReason::TimeNotIncreasing)), (2, 2));
        assert!((0..).zip(&flight.samples).all(|(sequence, sample)| sample.sequence == sequence));
    }

    #[test]
    fn what_the_service_would_not_take_is_left_out_of_its_recordings() {
        let sample = |wxyz: [f64; 4]| Measurement::default().with_attitude_wxyz(wxyz);
        let nan = sample([1.0, 0.0, 0.0, 0.0]).with_velocity_m_s([f64::NAN, 0.0, 0.0]);
        let [close, off] = [[0.6, 0.0, 0.8004, 0.0], [0.6, 0.0, 0.83, 0.0]];
        let mut recording = Collector::of_recording();
        let mut log = Collector::default();
        for (line, sample) in (0..).zip([nan, sample(close), sample(off)]) {
            recording.add(line, i128::from(line), sample);
            log.add(line, i128::from(line), sample);
        }
        let recording = recording.finish("f", None).unwrap();
        assert_eq!(recording.samples.len(), 1);
        assert_eq!(recording.samples[0].attitude_wxyz, close);
        assert_eq!(recording.skipped.for_reason(SkipReason::NotANumber), 1);
        assert_eq!(recording.skipped.for_reason(SkipReason::NoUnitQuaternion), 1);
        let of_log = log.finish("f", None).unwrap().samples;
        let norm_squared = |sample: &Measurement| sample.attitude_wxyz.iter().map(|x| x * x).sum::<f64>();
        assert!(of_log[1..].iter().all(|sample| (norm_squared(sample) - 1.0).abs() < 1e-15), "{of_log:?}");
    }

    #[test]
    fn times_are_exact_to_the_nanosecond() {
        for (text, ns_per_unit, expected) in [
            ("1718295482.836884123", 1_000_000_000, Some(1_718_295_482_836_884_123)),
            ("1718295482836884123", 1, Some(1_718_295_482_836_884_123)),
            ("10.0088", 1_000_000_000, Some(10_008_800_000)),
            ("-0.5", 1_000_000_000, Some(-500_000_000)),
            ("7", 1_000, Some(7_000)),
            ("1.25e2", 1_000_000, Some(125_000_000)),
            ("0.1234567890123", 1_000_000_000, Some(123_456_789)),
            ("nan", 1, None),
            ("inf", 1, None),
            ("1e300", 1, None),
            ("", 1, None),
            ("12:30", 1, None),
        ] {
            assert_eq!(parse_ns(text, ns_per_unit), expected, "{text}");
        }
    }

    #[test]
    fn a_missing_file_is_named() {
        let error =
            read_flight(Format::Acsl, Path::new("/no/such.log"), &ImportOptions::default()).unwrap_err();
        assert!(error.to_string().contains("cannot read '/no/such.log'"), "{error}");
    }
}
