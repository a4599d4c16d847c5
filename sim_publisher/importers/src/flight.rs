//! A recorded flight, and why rows of its file were skipped.

use shared_types::Measurement;
use std::fmt;
use std::ops::Range;

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
    /// No field of the row has all of its values.
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
            Self::NothingMeasured => "no quantity with all of its values",
            Self::NoAttitudeYet => "thrust before the first attitude",
            Self::EndsEarly => "cut off or damaged, and not read from there on",
        }
    }
}

/// Where in a file something is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Place {
    /// The file's lines, from 1.
    #[default]
    Line,
    /// The file's samples, from 1.
    Sample,
    /// The file's own clock (µs).
    #[cfg_attr(not(feature = "ulog"), allow(dead_code))]
    Microsecond,
}

/// Rows that were skipped, by reason, each with the place of the first.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Skipped {
    reasons: Vec<(SkipReason, usize, u64)>,
    place: Place,
}

impl Skipped {
    pub(crate) fn counted_by(place: Place) -> Self {
        Self { place, ..Self::default() }
    }

    /// How many rows, for any reason.
    pub fn rows(&self) -> usize {
        self.reasons.iter().map(|(_, rows, _)| rows).sum()
    }

    /// How many rows, for this reason.
    pub fn for_reason(&self, reason: SkipReason) -> usize {
        self.reasons.iter().find(|(known, ..)| *known == reason).map_or(0, |(_, rows, _)| *rows)
    }

    pub(crate) fn add(&mut self, reason: SkipReason, place: u64) {
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
    /// Samples in the air, if the format marks them.
    pub airborne: Option<Range<usize>>,
    /// Remarks, a sentence each: that the file ends too early, what it lacks.
    pub remarks: Vec<String>,
}

impl RecordedFlight {
    /// Rows that could not be used.
    pub fn skipped_rows(&self) -> usize {
        self.skipped.rows()
    }

    /// The remarks and what was left out, a sentence each.
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

    /// The part in the air, as a flight of its own; `None` if the format does not mark it, or there is none.
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
