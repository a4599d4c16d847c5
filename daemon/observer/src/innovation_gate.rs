//! Decides which outputs are accepted. An output whose innovation ỹ is far larger than those before it is treated as an
//! outlier of the sensor.
//!
//! ```text
//! ỹ is an outlier  ⇔  ‖ỹ‖ > c (d + s),      s ← s + a (‖ỹ‖ − s) for each ỹ that is accepted,  a = 1/20
//! ```
//!
//! with the dead zone's width d and the running scale s. A motion of the vehicle, for example after an impact or in a gust,
//! persists, and its innovations resemble each other; outliers differ. Hence the third large innovation in a row is accepted
//! if the three agree, each with the one before to 60 %. The equal steps that a constant force causes satisfy this. A
//! sensor is never rejected for longer than 10 hold times or 4 of its own periods. The first 10 outputs are accepted, and so
//! is the first one after a silence.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// a: the scale follows the last twenty innovations.
const FORGETTING: f64 = 0.05;
/// The first scale is the largest of this many innovations.
const N_FIRST_OUTPUTS: u32 = 10;
/// This many large innovations in a row that agree are a motion.
const N_AGREEING_OUTPUTS: u32 = 3;
/// Two innovations agree if they differ by no more than this part of the larger one.
const AGREEMENT: f64 = 0.6;
/// After this many holds and this many of the sensor's periods without an accepted output, the next one is accepted.
const MAX_HOLDS_REJECTED: u64 = 10;
const MAX_PERIODS_REJECTED: u64 = 4;

/// What happens to an outlier.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum OutlierAction {
    /// Nothing: every output is accepted, as in the paper.
    #[default]
    Off,
    /// It corrects the state, but nothing is learned from it.
    Adaptation,
    /// It is not used at all: the channel holds the output before, then coasts.
    Correction,
}

/// The gate's parameters and running scale.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct InnovationGate {
    /// What happens to outliers.
    pub outliers: OutlierAction,
    /// c.
    pub factor: f64,
}

/// The running scale, how long it is valid, and the newest outlier.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct InnovationScale<const M: usize> {
    scale: f64,
    n_accepted: u32,
    /// Stamps of the newest output and of the newest accepted one (ns).
    newest_ns: u64,
    accepted_ns: u64,
    /// Between the newest two outputs (ns).
    period_ns: u64,
    outlier: SVector<f64, M>,
    n_agreeing: u32,
}

/// The times before an output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OutputTimes {
    /// Since the output before (ns); since 0 where there is none.
    pub(crate) gap_ns: u64,
    /// Between the two outputs before (ns); 0 where there are no two.
    pub(crate) period_ns: u64,
}

impl<const M: usize> InnovationScale<M> {
    pub(crate) fn unknown() -> Self {
        Self {
            scale: 0.0,
            n_accepted: 0,
            newest_ns: 0,
            accepted_ns: 0,
            period_ns: 0,
            outlier: SVector::zeros(),
            n_agreeing: 0,
        }
    }

    /// Notes the arrival of an output, whether it is used or not; returns the times before it.
    pub(crate) fn arrive(&mut self, stamp_ns: u64) -> OutputTimes {
        let before =
            OutputTimes { gap_ns: stamp_ns.saturating_sub(self.newest_ns), period_ns: self.period_ns };
        self.period_ns = if self.newest_ns > 0 { before.gap_ns } else { 0 };
        self.newest_ns = stamp_ns;
        before
    }

    /// Whether the output that has just arrived is an outlier with this ỹ; if not, the scale is updated with it.
    pub(crate) fn is_outlier(
        &mut self,
        output_error: &SVector<f64, M>,
        (stamp_ns, before): (u64, &OutputTimes),
        (factor, width, hold_ns): (f64, f64, u64),
    ) -> bool {
        let max_rejected_ns = hold_ns
            .saturating_mul(MAX_HOLDS_REJECTED)
            .max(before.period_ns.saturating_mul(MAX_PERIODS_REJECTED));
        let is_silent = stamp_ns.saturating_sub(self.accepted_ns) >= max_rejected_ns;

        let size = output_error.norm();
        let is_first = self.n_accepted < N_FIRST_OUTPUTS;
        if !is_first && !is_silent && size > factor * (width + self.scale) {
            let largest = size.max(self.outlier.norm());
            let agrees = self.n_agreeing > 0 && (output_error - self.outlier).norm() <= AGREEMENT * largest;
            self.n_agreeing = if agrees { self.n_agreeing + 1 } else { 1 };
            self.outlier = *output_error;
            if self.n_agreeing < N_AGREEING_OUTPUTS {
                return true;
            }
            self.scale = size;
        } else if is_first {
            self.scale = self.scale.max(size);
        } else if is_silent {
            self.scale = size;
        } else {
            self.scale += FORGETTING * (size - self.scale);
        }
        self.n_agreeing = 0;
        self.n_accepted = self.n_accepted.saturating_add(1);
        self.accepted_ns = stamp_ns;
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    const PERIOD_NS: u64 = 5_000_000;
    const RULE: (f64, f64, u64) = (8.0, 0.01, 7_500_000);

    fn is_outlier(scale: &mut InnovationScale<2>, error: f64, stamp_ns: u64, rule: (f64, f64, u64)) -> bool {
        let before = scale.arrive(stamp_ns);
        scale.is_outlier(&Vector2::new(error, 0.0), (stamp_ns, &before), rule)
    }

    /// Which of these errors, one each period, are outliers.
    fn judged(period_ns: u64, errors: impl IntoIterator<Item = f64>) -> Vec<usize> {
        let mut scale = InnovationScale::unknown();
        let errors = errors.into_iter().zip(1..);
        let out = errors.map(|(e, j)| is_outlier(&mut scale, e, j * period_ns, RULE));
        out.enumerate().filter(|(_, out)| *out).map(|(j, _)| j).collect()
    }

    #[test]
    fn a_spike_is_an_outlier_and_what_follows_is_not() {
        assert_eq!(judged(PERIOD_NS, (0..100).map(|j| if j == 60 { 2.0 } else { 0.01 })), [60]);
        // Pairs agree or not: two in a row are not enough.
        let pairs = (0..100).map(|j| if j % 10 < 2 && j >= 40 { 2.0 } else { 0.01 });
        assert_eq!(judged(PERIOD_NS, pairs), [40, 41, 50, 51, 60, 61, 70, 71, 80, 81, 90, 91]);
        // Five in a row to both sides.
        let to_both = (0..100).map(|j| if j / 5 == 12 { 2.0 * (-1.0_f64).powi(j) } else { 0.01 });
        assert_eq!(judged(PERIOD_NS, to_both), [60, 61, 62, 63, 64]);
    }

    /// At 200 Hz and at 10 Hz; the gate is not configured with the rate.
    #[test]
    fn what_lasts_is_accepted_at_the_third_output() {
        for period_ns in [PERIOD_NS, 100_000_000] {
            assert_eq!(judged(period_ns, (0..200).map(|j| if j < 50 { 0.01 } else { 2.0 })), [50, 51]);
        }
    }

    #[test]
    fn spikes_to_all_sides_close_the_gate_for_ten_holds_at_most() {
        let spikes = (0..100).map(|j| if j < 50 { 0.01 } else { 2.0 * (-1.0_f64).powi(j) });
        // Fifteen periods of 5 ms are ten holds of 7.5 ms, counted from the last one accepted.
        assert_eq!(judged(PERIOD_NS, spikes)[..14], (50..64).collect::<Vec<_>>());
    }

    /// An unknown acceleration, from rest and out of rest, at the rate of a gyroscope and of a Doppler log.
    #[test]
    fn an_error_that_grows_as_a_force_lets_it_is_accepted() {
        for (period_s, acceleration, gain_per_s) in
            [(0.005, 10.0, 20.0), (0.005, 100.0, 20.0), (0.1, 1.0, 4.0)]
        {
            for from in [0, 50] {
                let grown = |j: i32| 1.0 - (-gain_per_s * period_s * f64::from(j - from)).exp();
                let errors = (0..200).map(|j| 0.005 + acceleration / gain_per_s * grown(j.max(from)));
                let out = judged((period_s * 1e9) as u64, errors);
                assert!(out.len() <= 2, "{acceleration} m/s² at {period_s} s from {from}: {out:?}");
            }
        }
    }

    #[test]
    fn the_first_outputs_make_the_scale_however_narrow_the_dead_zone() {
        let rule = (8.0, 1e-9, 7_500_000);
        let mut scale = InnovationScale::unknown();
        let errors = (1..200).map(|j| (j, 0.02 + 0.01 * (j as f64).sin()));
        let out = errors.filter(|(j, e)| is_outlier(&mut scale, *e, j * PERIOD_NS, rule));
        assert_eq!(out.count(), 0);
    }

    #[test]
    fn after_a_silence_the_first_output_is_accepted_and_sets_the_scale() {
        let mut scale = InnovationScale::unknown();
        let mut out = |e: f64, ns: u64| is_outlier(&mut scale, e, ns, RULE);
        (1..100).for_each(|j| assert!(!out(0.01, j * PERIOD_NS)));
        let after = 100 * PERIOD_NS + 500_000_000;
        assert!(!out(1.0, after));
        assert!(!out(0.95, after + PERIOD_NS));
        assert!(out(10.0, after + 2 * PERIOD_NS));
    }
}
