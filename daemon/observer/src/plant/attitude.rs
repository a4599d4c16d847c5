//! Attitude: a unit quaternion, integrated by the exponential map, with optional fixes.

use crate::plant::body::Kinematics;
use crate::plant::integrator::Segment;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// q̂ (body to inertial) with `q̂_{j+1} = q̂_j ⊗ exp(½ h ω̄)`, ω̄ = (ω̂_j + ω̂_{j+1})/2: no gimbal lock.
///
/// A fix moves with the estimated motion; the remaining error, a rotation about a body axis, decays as
/// e^{−L_q t}.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Attitude {
    pub(crate) attitude: UnitQuaternion<f64>,
    /// L_q (1/s).
    fix_gain_per_s: f64,
    /// Rotation vector, body axes (rad).
    fix_error: Vector3<f64>,
    fix_until_ns: u64,
    known: bool,
}

impl Attitude {
    pub(crate) fn new(start: Option<UnitQuaternion<f64>>, fix_gain_per_s: f64) -> Self {
        Self {
            attitude: start.unwrap_or_default(),
            fix_gain_per_s,
            fix_error: Vector3::zeros(),
            fix_until_ns: 0,
            known: start.is_some(),
        }
    }

    /// Whether an initial attitude or a fix was ever given.
    pub(crate) fn is_known(&self) -> bool {
        self.known
    }

    /// Takes a fix, of either sign; the first one sets the attitude where no initial one was given.
    pub(crate) fn take_fix(&mut self, fix: &UnitQuaternion<f64>, until_ns: u64) {
        if self.known {
            // The logarithm takes the shorter way round, so q and −q are the same fix.
            self.fix_error = (self.attitude.inverse() * fix).scaled_axis();
            self.fix_until_ns = until_ns;
        } else {
            (self.attitude, self.known) = (*fix, true);
        }
    }
}

impl Kinematics for Attitude {
    fn after(&self, segment: &Segment, start_ns: u64) -> Self {
        let mut next = *self;
        if start_ns < self.fix_until_ns {
            let corrected = -(-self.fix_gain_per_s * segment.h_s).exp_m1() * self.fix_error;
            next.attitude *= UnitQuaternion::new(corrected);
            next.fix_error -= corrected;
        }
        let turn = UnitQuaternion::new(0.5 * segment.h_s * (segment.start + segment.end));
        next.attitude *= turn;
        next.attitude.renormalize_fast();
        next.fix_error = turn.inverse_transform_vector(&next.fix_error);
        next
    }

    fn with_gains_of(self, other: &Self) -> Self {
        Self { fix_gain_per_s: other.fix_gain_per_s, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turn about a fixed axis at a rate that rises from 1 to 3 rad/s is by their mean.
    #[test]
    fn a_step_turns_by_the_mean_rate() {
        let axis = Vector3::new(0.6, 0.0, 0.8);
        let segment =
            Segment { h_s: 0.25, start: axis, end: 3.0 * axis, integral: Vector3::zeros(), output: None };
        let turned = Attitude::new(None, 0.0).after(&segment, 0).attitude;
        assert!(turned.angle_to(&UnitQuaternion::new(0.5 * axis)) < 1e-12);
    }
}
