//! How an estimator is judged on a flight: the next sample's prediction, and coasts with the recorded commands.
//!
//! Judged is the second half of the time in the air. A coast starts every 0.25 s. None goes across a gap of more than three
//! periods. Errors are against the truth where it is known, else against the measured velocity.

use super::cases::Case;
use super::estimators::{Estimator, Prediction};
use nalgebra::Vector3;
use observer::Sample;

/// Lengths of the coasts (s).
pub(super) const HORIZONS_S: [f64; 4] = [0.5, 1.0, 2.0, 5.0];
/// From one coast's start to the next (s).
const COAST_EVERY_S: f64 = 0.25;
/// Half of a 95 % interval, in deviations.
const DEVIATIONS_OF_95: f64 = 1.96;

/// The errors of one estimator on one flight.
#[derive(Debug, Clone, Default)]
pub(super) struct Judgement {
    /// The next sample's.
    pub(super) one_step: MeanSquare,
    /// After each length of coast.
    pub(super) coasts: [MeanSquare; HORIZONS_S.len()],
    /// |error|/σ of each axis, after each length; empty without deviations.
    pub(super) scores: [Vec<f64>; HORIZONS_S.len()],
    nis: (f64, usize),
    /// For the figures: (t, error of the next sample), (t, error after the shortest coast), (t, force).
    pub(super) residuals: Vec<(f64, Vector3<f64>)>,
    pub(super) short_coasts: Vec<(f64, f64)>,
    pub(super) forces: Vec<(f64, Vector3<f64>)>,
}

impl Judgement {
    /// Mean NIS, where there are deviations.
    pub(super) fn nis(&self) -> Option<f64> {
        (self.nis.1 > 0).then(|| self.nis.0 / self.nis.1 as f64)
    }

    /// The part of the errors within this many deviations.
    pub(super) fn part_within(&self, horizon: usize, deviations: f64) -> Option<f64> {
        let scores = &self.scores[horizon];
        let within = scores.iter().filter(|score| **score <= deviations).count();
        (!scores.is_empty()).then(|| within as f64 / scores.len() as f64)
    }

    /// Coverage of the 95 % band.
    pub(super) fn coverage_95(&self, horizon: usize) -> Option<f64> {
        self.part_within(horizon, DEVIATIONS_OF_95)
    }
}

/// A root of a mean square.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MeanSquare {
    sum: f64,
    pub(super) count: usize,
}

impl MeanSquare {
    fn add(&mut self, error: &Vector3<f64>) {
        self.sum += error.norm_squared();
        self.count += 1;
    }

    /// `None` without any.
    pub(super) fn root(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum / self.count as f64).sqrt())
    }
}

/// Flies the estimator over the whole flight, learning, and judges its second half.
pub(super) fn judge(case: &Case, mut estimator: impl Estimator) -> Judgement {
    let mut judgement = Judgement::default();
    let start_ns = case.samples[0].stamp_ns;
    let half_ns = start_ns + (case.samples[case.samples.len() - 1].stamp_ns - start_ns) / 2;
    let (mut next_coast_ns, mut newest_ns) = (half_ns, None);
    for (index, sample) in case.samples.iter().enumerate() {
        let predicted = estimator.predict(sample.stamp_ns);
        let t_s = (sample.stamp_ns - start_ns) as f64 / 1e9;
        let is_judged = sample.stamp_ns >= half_ns;
        let follows = newest_ns.is_some_and(|newest_ns| !case.is_gap(newest_ns, sample.stamp_ns));
        if let Some(truth) = case.velocity(index).filter(|_| is_judged && follows) {
            judgement.one_step.add(&(predicted.velocity_m_s - truth));
            judgement.residuals.push((t_s, predicted.velocity_m_s - truth));
        }
        estimator.take(sample);
        if case.velocity(index).is_none() {
            continue;
        }
        newest_ns = Some(sample.stamp_ns);
        if !is_judged {
            continue;
        }
        if let Some(nis) = estimator.nis().filter(|_| follows) {
            judgement.nis = (judgement.nis.0 + nis, judgement.nis.1 + 1);
        }
        judgement.forces.extend(estimator.force_n().map(|force_n| (t_s, force_n)));
        if sample.stamp_ns >= next_coast_ns {
            coast(case, index, estimator.clone(), &mut judgement);
            while next_coast_ns <= sample.stamp_ns {
                next_coast_ns += (COAST_EVERY_S * 1e9) as u64;
            }
        }
    }
    judgement
}

/// Predicts without measurements of the translation, as far as the longest horizon, the flight's end or a gap.
fn coast(case: &Case, start: usize, mut estimator: impl Estimator, judgement: &mut Judgement) {
    let start_ns = case.samples[start].stamp_ns;
    let mut horizon = 0;
    let mut newest_ns = start_ns;
    for (index, sample) in case.samples.iter().enumerate().skip(start + 1) {
        let has_velocity = case.velocity(index).is_some();
        if case.is_gap(newest_ns, sample.stamp_ns) {
            return;
        }
        let seconds = (sample.stamp_ns - start_ns) as f64 / 1e9;
        if let Some(truth) = case.velocity(index).filter(|_| seconds >= HORIZONS_S[horizon] - 1e-9) {
            let Prediction { velocity_m_s, std_m_s } = estimator.predict(sample.stamp_ns);
            let error = velocity_m_s - truth;
            judgement.coasts[horizon].add(&error);
            if horizon == 0 {
                let begun_s = (start_ns - case.samples[0].stamp_ns) as f64 / 1e9;
                judgement.short_coasts.push((begun_s, error.norm()));
            }
            if let Some(std) = std_m_s {
                judgement.scores[horizon].extend((0..3).map(|axis| error[axis].abs() / std[axis]));
            }
            horizon += 1;
            if horizon == HORIZONS_S.len() {
                return;
            }
        }
        estimator.take(&Sample {
            velocity: None,
            position_m: None,
            // An accelerometer needs no outside; only the joint law looks at it, where its configuration has one.
            specific_force_m_s2: sample.specific_force_m_s2,
            ..*sample
        });
        if has_velocity {
            newest_ns = sample.stamp_ns;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use observer::Velocity;

    /// It predicts that the velocity stays as it was measured.
    #[derive(Clone)]
    struct Holds(Vector3<f64>);

    impl Estimator for Holds {
        fn predict(&mut self, _: u64) -> Prediction {
            Prediction { velocity_m_s: self.0, std_m_s: Some([1.0; 3]) }
        }

        fn take(&mut self, sample: &Sample) {
            if let Some(Velocity::Inertial(velocity)) = sample.velocity {
                self.0 = velocity;
            }
        }
    }

    /// v_x = t over 20 s at 100 Hz: one that holds the velocity errs by the time that it held it.
    #[test]
    fn the_second_half_is_judged_and_no_coast_crosses_a_gap() {
        let sample = |j: u64| Sample {
            stamp_ns: j * 10_000_000,
            velocity: Some(Velocity::Inertial(Vector3::new(j as f64 * 0.01, 0.0, 0.0))),
            force_n: Some(Vector3::zeros()),
            ..Sample::default()
        };
        let whole = Case::of("whole", (0..=2000).map(sample).collect());
        let judgement = judge(&whole, Holds(Vector3::zeros()));
        assert_eq!(judgement.one_step.count, 1001);
        assert!((judgement.one_step.root().unwrap() - 0.01).abs() < 1e-12);
        // From 10 s on, every 0.25 s, as long as they fit: 39, 37, 33 and 21.
        let counts = judgement.coasts.map(|coast| coast.count);
        assert_eq!(counts, [39, 37, 33, 21]);
        for (horizon, seconds) in HORIZONS_S.iter().enumerate() {
            assert!((judgement.coasts[horizon].root().unwrap() - seconds).abs() < 1e-9);
        }
        // Errors of x within 1.96 of 1 σ: those after 0.5 and 1 s; of y and z all.
        let covered = [0, 1, 2, 3].map(|horizon| judgement.coverage_95(horizon).unwrap());
        assert!(covered[..2] == [1.0, 1.0] && (covered[2] - 2.0 / 3.0).abs() < 1e-12, "{covered:?}");

        // Without the samples from 15 to 15.05 s, the coasts that would cross that gap are not there, nor one next sample.
        let with_gap = (0..=2000).filter(|j| !(1500..=1505).contains(j)).map(sample).collect();
        let judgement = judge(&Case::of("gap", with_gap), Holds(Vector3::zeros()));
        assert_eq!(judgement.one_step.count, 1001 - 6 - 1);
        assert!((judgement.one_step.root().unwrap() - 0.01).abs() < 1e-12);
        assert!(judgement.coasts[0].count < 39 && judgement.coasts[3].count < 5, "{:?}", judgement.coasts);
    }
}
