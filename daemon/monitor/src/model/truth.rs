//! The error of the estimate against the true state, where a simulator publishes it.

use shared_types::{Estimate, Truth};
use std::collections::VecDeque;

/// Estimates that wait for the true state at their instant: as many as the service queues for a slow reader.
const PENDING: usize = shared_types::service::ESTIMATE_BUFFER;
/// Time constant of the mean square error (ns).
const TRUTH_AVERAGE_NS: f64 = 2e9;
/// An error that is older than this is not shown (ns).
const TRUTH_SHOWN_NS: u64 = 2_000_000_000;

/// Root mean squares of the estimate's error against the truth, over some two seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthError {
    /// Position (m).
    pub position_m: f64,
    /// Velocity (m/s).
    pub velocity_m_s: f64,
    /// Attitude, the angle of the rotation between the two (rad).
    pub attitude_rad: f64,
    /// Angular velocity (rad/s).
    pub angular_velocity_rad_s: f64,
    /// Learned force against the true one (N).
    pub force_n: f64,
    /// Learned torque against the true one (N·m).
    pub torque_n_m: f64,
}

/// Compares estimates with the truth at their own instants, as both arrive.
#[derive(Debug, Clone, Default)]
pub struct Comparison {
    pending: VecDeque<Estimate>,
    truth: Option<Truth>,
    squares: Option<[f64; 6]>,
    squared_to_ns: u64,
}

impl Comparison {
    /// Keeps an estimate until the truths before and after it are known.
    pub fn note_estimate(&mut self, estimate: &Estimate) {
        self.pending.push_back(*estimate);
        if self.pending.len() > PENDING {
            self.pending.pop_front();
        }
    }

    /// Compares the estimates since the truth before with the truth between the two.
    pub fn note_truth(&mut self, truth: &Truth) {
        let before = self.truth.replace(*truth);
        let Some(before) = before.filter(|before| before.stamp_ns < truth.stamp_ns) else { return };
        while let Some(estimate) = self.pending.front().filter(|e| e.stamp_ns <= truth.stamp_ns) {
            // One from before the first truth has nothing to be compared with.
            if estimate.stamp_ns >= before.stamp_ns {
                let part =
                    (estimate.stamp_ns - before.stamp_ns) as f64 / (truth.stamp_ns - before.stamp_ns) as f64;
                let squares = squared_errors(estimate, &before, truth, part);
                let step_ns = estimate.stamp_ns.saturating_sub(self.squared_to_ns) as f64;
                let share = (step_ns / TRUTH_AVERAGE_NS).clamp(0.0, 1.0);
                let means = self.squares.get_or_insert(squares);
                for (mean, square) in means.iter_mut().zip(squares) {
                    *mean += share * (square - *mean);
                }
                self.squared_to_ns = estimate.stamp_ns;
            }
            self.pending.pop_front();
        }
    }

    /// The mean error, unless no truth came lately before `newest_ns`, the newest estimate's time.
    pub fn error(&self, newest_ns: u64) -> Option<TruthError> {
        if newest_ns.saturating_sub(self.squared_to_ns) > TRUTH_SHOWN_NS {
            return None;
        }
        let [position_m, velocity_m_s, attitude_rad, angular_velocity_rad_s, force_n, torque_n_m] =
            self.squares?.map(f64::sqrt);
        Some(TruthError {
            position_m,
            velocity_m_s,
            attitude_rad,
            angular_velocity_rad_s,
            force_n,
            torque_n_m,
        })
    }
}

/// Squared distances of position, velocity, attitude, angular velocity, force and torque from the truth that lies
/// `part` of the way between two.
fn squared_errors(estimate: &Estimate, before: &Truth, after: &Truth, part: f64) -> [f64; 6] {
    let between = |a: f64, b: f64| a + part * (b - a);
    let square = |estimate: [f64; 3], read: fn(&Truth) -> [f64; 3]| {
        let (a, b) = (read(before), read(after));
        (0..3).map(|k| (estimate[k] - between(a[k], b[k])).powi(2)).sum::<f64>()
    };
    // The angle between two unit quaternions, of which either sign means the same attitude.
    let dot = |a: &[f64; 4], b: &[f64; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (a, b) = (before.attitude_wxyz, after.attitude_wxyz);
    let sign = dot(&a, &b).signum();
    let mut truth: [f64; 4] = std::array::from_fn(|k| between(a[k], sign * b[k]));
    let norm = dot(&truth, &truth).sqrt();
    truth = truth.map(|component| component / norm);
    let cosine = dot(&truth, &estimate.attitude_wxyz).abs().min(1.0);
    [
        square(estimate.position_m, |truth| truth.position_m),
        square(estimate.velocity_m_s, |truth| truth.velocity_m_s),
        (2.0 * cosine.acos()).powi(2),
        square(estimate.angular_velocity_rad_s, |truth| truth.angular_velocity_rad_s),
        square(estimate.matched_force_n, |truth| truth.matched_force_n),
        square(estimate.matched_torque_n_m, |truth| truth.matched_torque_n_m),
    ]
}
