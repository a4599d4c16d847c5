//! Weights along the body's axes turn with it ([`super::axes`]).

use super::filter::JointFilter;
use super::rows::{KERNEL, POSITION, WEIGHTS};
use super::state::JointState;
use nalgebra::{UnitQuaternion, Vector3};

impl JointFilter {
    /// The body has turned to this attitude, and what was learned with it; ω along the body's axes (rad/s). No allocation.
    ///
    /// # Cost
    /// 9 p multiply-adds.
    pub(crate) fn turn(&self, state: &mut JointState, attitude: &UnitQuaternion<f64>, rate: &Vector3<f64>) {
        state.scalars.axes.rate = (*rate).into();
        let matrix = state.scalars.axes.turn(attitude).to_rotation_matrix();
        for k in (WEIGHTS..POSITION).chain(KERNEL..self.n_kernel) {
            let weights = matrix * Vector3::from_fn(|axis, _| state.mean[axis][k]);
            (0..3).for_each(|axis| state.mean[axis][k] = weights[axis]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::designs::joint_law;
    use crate::law::joint::design::{BodyAxesDesign, JointDesign};
    use crate::law::joint::sensor::SensorUse;
    use crate::law::joint::teaches::Teaches;

    /// A vehicle that turns, with a drag that is twenty times larger across than along it: what was learned in all headings is known in
    /// each, with features of the body's axes better than with inertial ones.
    #[test]
    fn a_drag_along_the_body_s_axes_is_learned_while_the_vehicle_turns() {
        let h_s = 0.02;
        let attitude = |t_s: f64| UnitQuaternion::new(Vector3::new(0.0, 0.0, 0.4 * t_s));
        // And an added mass of half the vehicle's own across it.
        let drag = |v: &Vector3<f64>, q: &UnitQuaternion<f64>| {
            let along = q.inverse() * v;
            let added = Vector3::new(0.0, 0.0, 0.4).cross(&along.component_mul(&Vector3::new(0.0, 0.5, 0.5)));
            q * (along.component_mul(&Vector3::new(-0.05, -1.0, -1.0)) - added)
        };
        let fly = |in_body_axes: bool| {
            let body_axes = in_body_axes.then_some(BodyAxesDesign { turn: 0.3 });
            let mut filter = JointFilter::new(&JointDesign { body_axes, ..joint_law([0.01; 3]) }).unwrap();
            let mut state = filter.new_state();
            let mut v = Vector3::new(0.5, 0.0, 0.0);
            let (mut squares, mut n) = (0.0, 0);
            for j in 0..6000 {
                let t_s = f64::from(j) * h_s;
                let q = attitude(t_s);
                let command =
                    q * Vector3::new(0.4 + 0.3 * t_s.sin(), 0.5 * (1.7 * t_s).sin(), (0.6 * t_s).cos());
                if in_body_axes {
                    filter.turn(&mut state, &q, &Vector3::new(0.0, 0.0, 0.4));
                }
                let y = std::array::from_fn(|axis| Some(v[axis]));
                let how = (SensorUse::default(), Teaches::All);
                filter.update_velocity(&mut state, &y, &[0.01; 3], h_s, how);
                let known = &[0.0; 3];
                // What was learned alone: in a coast the disturbance is gone.
                let mut coasting = state.clone();
                (0..3).for_each(|axis| coasting.mean[axis][crate::law::joint::rows::DISTURBANCE] = 0.0);
                let learned = filter.look_ahead(&coasting, h_s, &command.into(), known, None).learned.value;
                if j > 3000 {
                    squares += (Vector3::from(learned) - drag(&v, &q)).norm_squared();
                    n += 1;
                }
                filter.predict(&mut state, h_s, &command.into(), known, Teaches::All);
                v += h_s * (command + drag(&v, &q));
            }
            (squares / f64::from(n)).sqrt()
        };
        let (body, inertial) = (fly(true), fly(false));
        assert!(body < 0.5 * inertial, "{body} m/s², {inertial} with inertial axes");
    }
}
