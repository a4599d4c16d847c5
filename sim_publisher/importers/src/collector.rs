//! Collects rows into a flight: times strictly increasing, attitudes of unit norm, stamps relative to the first.

use crate::error::{ImportError, Imported};
use crate::flight::{Place, RecordedFlight, SkipReason, Skipped};
use shared_types::Measurement;
use shared_types::payload::{QUATERNION_NORM_TOLERANCE, valid};
use std::ops::Range;

/// Collects rows into a flight: times strictly increasing, stamps relative to the first.
#[derive(Debug, Default)]
pub(crate) struct Collector {
    pub(crate) samples: Vec<Measurement>,
    pub(crate) skipped: Skipped,
    pub(crate) values_not_finite: usize,
    pub(crate) first_ns: Option<i128>,
    pub(crate) remarks: Vec<String>,
    /// For samples of a recording: they stay unchanged, or are left out if the service's gate rejects their values.
    is_exact: bool,
}

impl Collector {
    pub(crate) fn counted_by(place: Place) -> Self {
        Self { skipped: Skipped::counted_by(place), ..Self::default() }
    }

    /// For recordings of the service's own input.
    pub(crate) fn of_recording() -> Self {
        Self { is_exact: true, ..Self::counted_by(Place::Sample) }
    }

    /// Adds a row taken at `time_ns`, any origin; its sequence and stamp are set here.
    pub(crate) fn add(&mut self, line: u64, time_ns: i128, sample: Measurement) -> bool {
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
        self.drop_jump_ahead(line, stamp_ns);
        if self.samples.last().is_some_and(|previous| previous.stamp_ns >= stamp_ns) {
            return Err(SkipReason::TimeNotIncreasing);
        }
        self.first_ns = Some(first_ns);
        (sample.sequence, sample.stamp_ns) = (self.samples.len() as u64, stamp_ns);
        self.samples.push(sample);
        Ok(())
    }

    /// Drops samples after a jump ahead if this sample is older than they are, since their clock was wrong. Otherwise all
    /// later samples would be rejected until time has caught up with the jump.
    fn drop_jump_ahead(&mut self, line: u64, stamp_ns: u64) {
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

    pub(crate) fn finish(self, path: &str, airborne: Option<Range<usize>>) -> Imported {
        let Self { samples, skipped, values_not_finite, remarks, .. } = self;
        if samples.is_empty() {
            return Err(ImportError::NoUsableRow(path.into(), skipped));
        }
        Ok(RecordedFlight { samples, skipped, values_not_finite, airborne, remarks })
    }
}

/// Logs round their values.
pub(crate) const ROUNDED_NORM_TOLERANCE: f64 = 0.05;

/// The normalised quaternion, if its norm is 1 within the tolerance. A quaternion of unit norm is not changed.
pub(crate) fn unit(wxyz: [f64; 4], tolerance: f64) -> Option<[f64; 4]> {
    let norm = wxyz.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (norm - 1.0).abs() < 1e-9 {
        return Some(wxyz);
    }
    ((norm - 1.0).abs() < tolerance).then(|| wxyz.map(|x| x / norm))
}

/// A time as nanoseconds, exactly where it is written as a decimal: a double cannot hold today's date in ns.
pub(crate) fn parse_ns(text: &str, ns_per_unit: i128) -> Option<i128> {
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
}
