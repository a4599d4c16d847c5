//! Errors of estimates, each against the truth of the same instant.

use anyhow::{Context, ensure};
use daemon::assemble;
use daemon::config::ConfigFile;
use daemon::engine::to_payload;
use daemon::gate::Gate;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use observer::Learn;
use shared_types::payload::{Estimate, status_bits};
use shared_types::{Measurement, Truth};

/// The messages of a run, recorded from shared memory.
pub(super) struct Run {
    pub(super) truths: Vec<Truth>,
    pub(super) estimates: Vec<Estimate>,
    measurements: Vec<Measurement>,
}

impl Run {
    /// Uses the estimates that contain a sample and lie between two true states.
    pub(super) fn new(
        truths: Vec<Truth>,
        measurements: Vec<Measurement>,
        mut estimates: Vec<Estimate>,
    ) -> anyhow::Result<Self> {
        let (first, last) =
            truths.first().zip(truths.last()).context("no true state was seen: the vehicle did not run")?;
        estimates.retain(|estimate| {
            let waiting = estimate.status & status_bits::WAITING != 0;
            !waiting && (first.stamp_ns..=last.stamp_ns).contains(&estimate.stamp_ns)
        });
        ensure!(!estimates.is_empty(), "no estimate was seen while the vehicle ran");
        Ok(Self { truths, estimates, measurements })
    }

    /// The samples that the vehicle published.
    pub(super) fn measurements(&self) -> &[Measurement] {
        &self.measurements
    }

    pub(super) fn duration_s(&self) -> f64 {
        self.seconds(self.truths[self.truths.len() - 1].stamp_ns)
    }

    /// Time since the first true state (s).
    pub(super) fn seconds(&self, stamp_ns: u64) -> f64 {
        stamp_ns.saturating_sub(self.truths[0].stamp_ns) as f64 / 1e9
    }

    /// The estimates that the same samples give at the same instants if nothing is learned.
    pub(super) fn without_adaptation(&self, config: &ConfigFile) -> anyhow::Result<Vec<Estimate>> {
        let taken_at_ns = |sample: &Measurement, estimate: &Estimate| {
            (sample.sequence <= estimate.source_sequence).then_some(estimate.stamp_ns)
        };
        self.flown_again(config, self.measurements.iter().copied(), taken_at_ns, Learn::FROZEN)
    }

    /// The estimates that these samples give at the instants of the run's own. `taken_at_ns` is when a sample is taken, if
    /// that is before the estimate.
    pub(super) fn flown_again(
        &self,
        config: &ConfigFile,
        samples: impl Iterator<Item = Measurement>,
        taken_at_ns: impl Fn(&Measurement, &Estimate) -> Option<u64>,
        learn: Learn,
    ) -> anyhow::Result<Vec<Estimate>> {
        let mut observer = assemble::rigid_body(config)?;
        let mut gate = Gate::new(config.config.input, true);
        let mut samples = samples.peekable();
        let estimates = self.estimates.iter().map(|estimate| {
            while let Some(taken_ns) = samples.peek().and_then(|sample| taken_at_ns(sample, estimate)) {
                let sample = samples.next().expect("it was peeked at");
                if let Ok(accepted) = gate.judge(&sample, 0, &gate.in_order(&sample, taken_ns)) {
                    observer.accept(&accepted.sample, learn);
                }
            }
            Estimate { status: estimate.status, ..to_payload(&observer.estimate(estimate.stamp_ns).into()) }
        });
        Ok(estimates.collect())
    }
}

/// A quantity in which estimate and truth are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    Position,
    Velocity,
    Force,
    Attitude,
    AngularVelocity,
    Torque,
}

impl Quantity {
    pub(super) const ALL: [Self; 6] =
        [Self::Position, Self::Velocity, Self::Force, Self::Attitude, Self::AngularVelocity, Self::Torque];

    /// Its name in a table, and its key in a document, with `{}` for the statistic.
    pub(super) fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::Position => ("position (m)", "position_{}_m"),
            Self::Velocity => ("velocity (m/s)", "velocity_{}_m_s"),
            Self::Force => ("unknown force (N)", "force_{}_n"),
            Self::Attitude => ("attitude (rad)", "attitude_{}_rad"),
            Self::AngularVelocity => ("angular velocity (rad/s)", "angular_velocity_{}_rad_s"),
            Self::Torque => ("unknown torque (N·m)", "torque_{}_n_m"),
        }
    }

    /// Whether it belongs to the translation.
    pub(super) fn is_of_translation(self) -> bool {
        matches!(self, Self::Position | Self::Velocity | Self::Force)
    }

    /// The norm of an estimate's error; `None` where there is no truth at its instant, or where the quantity's
    /// channel is not part of the estimate.
    pub(super) fn error(self, truths: &[Truth], estimate: &Estimate) -> Option<f64> {
        let truth = truth_at(truths, estimate.stamp_ns)?;
        let norm = |a: [f64; 3], b: [f64; 3]| (Vector3::from(a) - Vector3::from(b)).norm();
        let channel = if self.is_of_translation() { &estimate.translation } else { &estimate.rotation };
        (channel.error_bound > 0.0).then(|| match self {
            Self::Position => norm(truth.position_m, estimate.position_m),
            Self::Velocity => norm(truth.velocity_m_s, estimate.velocity_m_s),
            Self::Force => norm(truth.matched_force_n, estimate.matched_force_n),
            Self::Attitude => quaternion(truth.attitude_wxyz).angle_to(&quaternion(estimate.attitude_wxyz)),
            Self::AngularVelocity => norm(truth.angular_velocity_rad_s, estimate.angular_velocity_rad_s),
            Self::Torque => norm(truth.matched_torque_n_m, estimate.matched_torque_n_m),
        })
    }
}

/// The true state at an instant, between the two published ones around it.
pub(super) fn truth_at(truths: &[Truth], stamp_ns: u64) -> Option<Truth> {
    let after = truths.partition_point(|truth| truth.stamp_ns < stamp_ns);
    let b = truths.get(after)?;
    if b.stamp_ns == stamp_ns {
        return Some(*b);
    }
    let a = truths.get(after.checked_sub(1)?)?;
    let s = (stamp_ns - a.stamp_ns) as f64 / (b.stamp_ns - a.stamp_ns) as f64;
    let between = |a: [f64; 3], b: [f64; 3]| Vector3::from(a).lerp(&b.into(), s).into();
    let q = quaternion(a.attitude_wxyz).nlerp(&quaternion(b.attitude_wxyz), s).coords;
    Some(Truth {
        stamp_ns,
        position_m: between(a.position_m, b.position_m),
        velocity_m_s: between(a.velocity_m_s, b.velocity_m_s),
        attitude_wxyz: [q.w, q.x, q.y, q.z],
        angular_velocity_rad_s: between(a.angular_velocity_rad_s, b.angular_velocity_rad_s),
        matched_force_n: between(a.matched_force_n, b.matched_force_n),
        matched_torque_n_m: between(a.matched_torque_n_m, b.matched_torque_n_m),
        ..*a
    })
}

pub(super) fn quaternion([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

/// Root of the mean square, and maximum, of an error's norm.
#[derive(Debug, Clone, Copy)]
pub(super) struct RmsMax {
    pub(super) rms: f64,
    pub(super) max: f64,
}

impl RmsMax {
    /// Of the errors over the second half of a run, after the observer has learned; `None` if there are none.
    pub(super) fn over_second_half(run: &Run, estimates: &[Estimate], quantity: Quantity) -> Option<Self> {
        let half_s = run.duration_s() / 2.0;
        let second_half = estimates.iter().filter(|estimate| run.seconds(estimate.stamp_ns) >= half_s);
        let errors: Vec<f64> =
            second_half.filter_map(|estimate| quantity.error(&run.truths, estimate)).collect();
        let mean_square = errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64;
        let max = errors.iter().copied().fold(0.0, f64::max);
        (!errors.is_empty()).then_some(Self { rms: mean_square.sqrt(), max })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth(stamp_ns: u64, x: f64) -> Truth {
        Truth { stamp_ns, position_m: [x, 0.0, 0.0], attitude_wxyz: [1.0, 0.0, 0.0, 0.0], ..Truth::default() }
    }

    #[test]
    fn the_truth_between_two_states_is_interpolated() {
        let truths = [truth(1000, 1.0), truth(2000, 3.0)];
        assert_eq!(truth_at(&truths, 1250).unwrap().position_m[0], 1.5);
        assert_eq!(truth_at(&truths, 2000).unwrap().position_m[0], 3.0);
        assert!(truth_at(&truths, 999).is_none() && truth_at(&truths, 2001).is_none());
    }

    #[test]
    fn errors_are_those_of_the_second_half() {
        let truths = vec![truth(0, 0.0), truth(4_000_000_000, 0.0)];
        let estimate = |stamp_ns: u64, x: f64| {
            let mut estimate = Estimate { stamp_ns, position_m: [x, 0.0, 0.0], ..Estimate::default() };
            estimate.attitude_wxyz = [1.0, 0.0, 0.0, 0.0];
            estimate.translation.error_bound = 1.0;
            estimate
        };
        let estimates =
            [(1, 100.0), (2, 3.0), (3, 4.0)].map(|(s, x)| estimate(s * 1_000_000_000, x)).to_vec();
        let run = Run::new(truths, Vec::new(), estimates).unwrap();
        let errors = |quantity| RmsMax::over_second_half(&run, &run.estimates, quantity);
        let position = errors(Quantity::Position).unwrap();
        assert_eq!((position.rms, position.max), (12.5_f64.sqrt(), 4.0));
        assert!(errors(Quantity::Torque).is_none());
    }
}
