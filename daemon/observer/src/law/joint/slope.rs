//! The slope of the learned acceleration in a coast with an accelerometer: what it measures then tells the velocity, through the drag.
//!
//! ```text
//! J = min(0, tr(∂(ψᵀθ)/∂v)/3) at v̂,     f_0 = max(0, 1 + h J),   and row 0 of the accelerometer's h is J
//! ```
//!
//! One number, since the axes share their covariance. While velocities come, and without an accelerometer, it is 0.

use super::filter::JointFilter;
use super::state::JointState;

/// A step of the central differences, as a part of the box.
const STEP: f64 = 0.05;

impl JointFilter {
    /// Sets J of the state for a coast, or 0.
    ///
    /// # Cost
    /// Six evaluations of the features in a coast.
    pub(crate) fn set_slope(&mut self, state: &mut JointState, is_coasting: bool) {
        let has_slope = is_coasting && self.design.accelerometer.is_some();
        state.scalars.slope_per_s = if has_slope { self.slope_per_s(state) } else { 0.0 };
    }

    /// J (1/s).
    fn slope_per_s(&mut self, state: &JointState) -> f64 {
        let step = STEP * self.largest_half_width;
        let mut sum = 0.0;
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let mut velocity = state.velocity();
                velocity[axis] += side * step;
                // What depends on the command is the same on both sides.
                self.evaluate_features(&velocity, &[0.0; 3], &[[0.0; 3]; 2], &state.scalars.axes);
                sum += side * self.unit.dots([&state.mean[axis][..]], &self.features)[0];
            }
        }
        (sum / (6.0 * step)).min(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::designs::joint_law;
    use crate::law::joint::design::{AccelerometerDesign, JointDesign};
    use crate::law::joint::sensor::SensorUse;
    use crate::law::joint::teaches::Teaches;

    /// A linear drag, learned: its slope, and the deviation of a long coast, which is then that of a Gauss–Markov process.
    #[test]
    fn a_learned_drag_bounds_the_deviation_of_a_coast() {
        let accelerometer = Some(AccelerometerDesign { noise: 0.5, bias: 0.5, bias_time_s: 10.0 });
        let mut filter = JointFilter::new(&JointDesign { accelerometer, ..joint_law([0.01; 3]) }).unwrap();
        let mut state = filter.new_state();
        let (mut v, h) = ([0.5, -0.5, 0.0], 0.01);
        for j in 0..6000 {
            let t_s = f64::from(j) * h;
            let command = [t_s.sin(), (1.3 * t_s).cos(), (0.7 * t_s).sin()];
            let how = (SensorUse::default(), Teaches::All);
            filter.update_velocity(&mut state, &v.map(Some), &[0.01; 3], h, how);
            filter.predict(&mut state, h, &command, &[0.0; 3], Teaches::All);
            v = std::array::from_fn(|i| v[i] + h * (command[i] - 0.8 * v[i]));
        }
        let coast = |has_slope: bool, filter: &mut JointFilter, mut state: JointState| {
            filter.set_slope(&mut state, has_slope);
            let slope_per_s = state.scalars.slope_per_s;
            for _ in 0..3000 {
                filter.set_slope(&mut state, has_slope);
                filter.predict(&mut state, h, &[0.0; 3], &[0.0; 3], Teaches::All);
            }
            (slope_per_s, state.velocity(), state.velocity_std()[0])
        };
        let (slope_per_s, with, bounded) = coast(true, &mut filter, state.clone());
        assert!((slope_per_s + 0.8).abs() < 0.3, "{slope_per_s}");
        let (none, without, grown) = coast(false, &mut filter, state);
        assert!(none == 0.0 && with == without, "the means are the same");
        assert!(bounded < 0.2 * grown, "{bounded} m/s, {grown} without");
    }
}
