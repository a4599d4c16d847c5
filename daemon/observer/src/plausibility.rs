//! Which outputs are believed: one whose error stands out against the errors before it is a spike of the sensor
//! sooner than a jump of the vehicle.
//!
//! ```text
//! ỹ is believed  ⇔  ‖ỹ‖ ≤ c (d + s)  or no output was believed for 10 holds,      s ← s + a (‖ỹ‖ − s),  a = 1/20
//! ```
//!
//! with the dead zone's width d, and s the running scale of the errors that were believed. What a vehicle does, an impact included, lasts: after 10 holds the next output is
//! believed whatever it says, and sets the scale.

use serde::{Deserialize, Serialize};

/// a: the scale follows the last twenty errors.
const FORGETTING: f64 = 0.05;
/// After so many holds without a believed output the next one is believed.
const HOLDS_OF_DOUBT: u64 = 10;

/// What happens to an output that is not believed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Doubt {
    /// Nothing: every output is believed, as in the paper.
    #[default]
    Off,
    /// It corrects the state, but nothing is learned from it.
    Adaptation,
    /// It is not used at all: the channel holds the output before, then coasts.
    Correction,
}

/// How outputs are judged.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Plausibility {
    /// What happens to those that stand out.
    pub outliers: Doubt,
    /// c: they stand out by more than this factor.
    pub factor: f64,
}

/// The running scale, and until when it is relied on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ErrorScale {
    scale: f64,
    /// Stamp of the newest believed output (ns).
    believed_ns: Option<u64>,
}

impl ErrorScale {
    pub(crate) fn unknown() -> Self {
        Self { scale: 0.0, believed_ns: None }
    }

    /// Whether an output with this ‖ỹ‖ stands out; if not, the scale follows it.
    pub(crate) fn stands_out(
        &mut self,
        error_norm: f64,
        stamp_ns: u64,
        (factor, width, hold_ns): (f64, f64, u64),
    ) -> bool {
        let patience_ns = hold_ns.saturating_mul(HOLDS_OF_DOUBT);
        let is_known = self.believed_ns.is_some_and(|ns| stamp_ns.saturating_sub(ns) < patience_ns);
        if is_known && error_norm > factor * (width + self.scale) {
            return true;
        }
        self.scale = match is_known {
            true => self.scale + FORGETTING * (error_norm - self.scale),
            false => self.scale.max(error_norm),
        };
        self.believed_ns = Some(stamp_ns);
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 5_000_000;
    const RULE: (f64, f64, u64) = (8.0, 0.01, 7_500_000);

    fn judged(errors: impl IntoIterator<Item = f64>) -> Vec<bool> {
        let mut scale = ErrorScale::unknown();
        errors.into_iter().zip(1..).map(|(e, j)| scale.stands_out(e, j * PERIOD_NS, RULE)).collect()
    }

    fn places(judged: &[bool]) -> Vec<usize> {
        judged.iter().enumerate().filter(|(_, out)| **out).map(|(j, _)| j).collect()
    }

    #[test]
    fn a_spike_stands_out_and_what_follows_does_not() {
        let errors = (0..100).map(|j| if j == 60 { 2.0 } else { 0.01 });
        assert_eq!(places(&judged(errors)), [60]);
        let pairs = (0..100).map(|j| if j % 10 < 2 && j >= 40 { 2.0 } else { 0.01 });
        assert_eq!(places(&judged(pairs)), [40, 41, 50, 51, 60, 61, 70, 71, 80, 81, 90, 91]);
    }

    #[test]
    fn what_lasts_is_believed_after_ten_holds() {
        let judged = judged((0..200).map(|j| if j < 50 { 0.01 } else { 2.0 }));
        // Fifteen periods of 5 ms are ten holds of 7.5 ms, counted from the last one believed.
        assert_eq!(places(&judged), (50..64).collect::<Vec<_>>());
    }

    /// 20 N on 2 kg that nobody knew of: the error of an observer of 20 1/s grows to 0.5 m/s.
    #[test]
    fn an_error_that_grows_as_a_force_lets_it_is_believed() {
        let errors = (0..200).map(|j| 0.005 + 0.5 * (1.0 - (-0.1 * f64::from(j)).exp()));
        assert_eq!(places(&judged(errors)), []);
    }

    #[test]
    fn after_an_outage_the_first_output_is_believed_and_sets_the_scale() {
        let mut scale = ErrorScale::unknown();
        (1..100).for_each(|j| assert!(!scale.stands_out(0.01, j * PERIOD_NS, RULE)));
        let after = 100 * PERIOD_NS + 500_000_000;
        assert!(!scale.stands_out(1.0, after, RULE));
        assert!(!scale.stands_out(0.95, after + PERIOD_NS, RULE));
        assert!(scale.stands_out(10.0, after + 2 * PERIOD_NS, RULE));
    }

    /// A comparison with NaN is false: such an output would be believed. None comes this far.
    #[test]
    fn an_infinite_error_stands_out() {
        let mut scale = ErrorScale::unknown();
        assert!(!scale.stands_out(0.01, PERIOD_NS, RULE));
        assert!(scale.stands_out(f64::INFINITY, 2 * PERIOD_NS, RULE));
    }
}
