//! Position: the integral of the velocity estimate, with optional fixes.

use crate::plant::body::Kinematics;
use crate::plant::integrator::Segment;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// r̂ with the law `r̂' = v̂ + L_r ỹ + L_p (r_meas − r̂)`.
///
/// Without fixes (L_p = 0) the position is not observable from the velocity: r̂ is dead reckoning.
/// A fix moves with the estimated motion, so that its age causes no lag; the remaining error decays as e^{−L_p t},
/// beside the exact integral of v̂.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Position {
    pub(crate) position: Vector3<f64>,
    /// L_r, dimensionless.
    velocity_error_to_position: f64,
    /// L_p (1/s).
    fix_gain_per_s: f64,
    fix_error: Vector3<f64>,
    fix_until_ns: u64,
    known: bool,
}

impl Position {
    pub(crate) fn new(
        start: Option<Vector3<f64>>,
        velocity_error_to_position: f64,
        fix_gain_per_s: f64,
    ) -> Self {
        Self {
            position: start.unwrap_or_default(),
            velocity_error_to_position,
            fix_gain_per_s,
            fix_error: Vector3::zeros(),
            fix_until_ns: 0,
            known: start.is_some(),
        }
    }

    /// Takes a fix; the first one sets the position where no initial one was given.
    pub(crate) fn take_fix(&mut self, fix: &Vector3<f64>, until_ns: u64) {
        if self.known {
            self.fix_error = fix - self.position;
            self.fix_until_ns = until_ns;
        } else {
            (self.position, self.known) = (*fix, true);
        }
    }
}

impl Kinematics for Position {
    fn after(&self, segment: &Segment, start_ns: u64) -> Self {
        let mut next = *self;
        next.position += segment.integral;
        if let Some(output) = segment.output {
            next.position += self.velocity_error_to_position * (segment.h_s * output - segment.integral);
        }
        if start_ns < self.fix_until_ns {
            let corrected = -(-self.fix_gain_per_s * segment.h_s).exp_m1() * self.fix_error;
            next.position += corrected;
            next.fix_error -= corrected;
        }
        next
    }

    fn with_gains_of(self, other: &Self) -> Self {
        let Self { velocity_error_to_position, fix_gain_per_s, .. } = *other;
        Self { velocity_error_to_position, fix_gain_per_s, ..self }
    }
}
