//! The paper's second example: a rotating body whose drag and gyroscopic torque are unknown.
//!
//! # Source
//! Niu et al., Vector-Valued Native Space Embedding for Adaptive State Observation, example 2. The attitude is
//! a unit quaternion here, where the paper integrates 3-2-1 Euler angles; the motion is the same.

use super::definition::{Definition, Vehicle};
use crate::plant::{Acceleration, Nominal, State, TruePlant, Wrench};
use crate::sensors::{Schedule, SensorSuite, VectorSensor};
use nalgebra::Vector3;

const INERTIA_KG_M2: Vector3<f64> = Vector3::new(0.2, 15.0, 15.0);

/// A body that only rotates. The disturbance is what is added to ω where f is taken (rad/s), as for
/// [`PointMass`](super::translation::PointMass); the scenario has none.
#[derive(Debug)]
pub struct RotatingBody;

/// `f(ω) = −0.001 ‖ω‖ ω − ω × I ω` (N·m).
pub fn unknown_torque_n_m(angular_velocity_rad_s: &Vector3<f64>) -> Vector3<f64> {
    let omega = angular_velocity_rad_s;
    -0.001 * omega.norm() * omega - omega.cross(&INERTIA_KG_M2.component_mul(omega))
}

/// `δ(t) = 0.05 sin 5t` (rad/s), the error of each axis.
pub fn angular_velocity_error_rad_s(t_s: f64) -> f64 {
    0.05 * (5.0 * t_s).sin()
}

/// `ω_r = (0.1 cos 0.1t, 0.1 sin 0.1t, 0.1 tanh 0.1t)` (rad/s) and its derivative.
fn reference(t: f64) -> (Vector3<f64>, Vector3<f64>) {
    let (sin, cos) = (0.1 * t).sin_cos();
    let tanh = (0.1 * t).tanh();
    (
        Vector3::new(0.1 * cos, 0.1 * sin, 0.1 * tanh),
        Vector3::new(-0.01 * sin, 0.01 * cos, 0.01 * (1.0 - tanh * tanh)),
    )
}

impl TruePlant for RotatingBody {
    fn acceleration(&self, state: &State, command: &Wrench, disturbance: &Vector3<f64>) -> Acceleration {
        let felt_at_rad_s = state.angular_velocity_rad_s + disturbance;
        let torque_n_m = command.torque_n_m + unknown_torque_n_m(&felt_at_rad_s);
        Acceleration {
            linear_m_s2: Vector3::zeros(),
            angular_rad_s2: torque_n_m.component_div(&INERTIA_KG_M2),
        }
    }
}

impl Vehicle for RotatingBody {
    fn initial_state(&self) -> State {
        State { angular_velocity_rad_s: reference(0.0).0, ..State::at_rest() }
    }

    /// `u = −10 (ω − ω_r) + ω̇_r`
    fn command(&self, t_s: f64, state: &State) -> Wrench {
        let (omega_r, omega_r_dot) = reference(t_s);
        let torque_n_m = -10.0 * (state.angular_velocity_rad_s - omega_r) + omega_r_dot;
        Wrench { torque_n_m, ..Wrench::zero() }
    }
}

/// The example as the paper states it.
pub(super) fn definition() -> Definition {
    Definition {
        vehicle: &RotatingBody,
        nominal: Nominal { mass_kg: 1.0, inertia_kg_m2: INERTIA_KG_M2, gravity_m_s2: Vector3::zeros() },
        disturbance: None,
        sensors: SensorSuite {
            angular_velocity: VectorSensor {
                fixed_error: Some(angular_velocity_error_rad_s),
                ..VectorSensor::each_sample(0.0)
            },
            attitude: VectorSensor::at(Schedule::Start),
            commands_torque: true,
            ..SensorSuite::nothing()
        },
        // The feedback's rate about the first axis is 10/0.2 = 50 s⁻¹; held, it is stable below a step of 2/50 s.
        lowest_rate_hz: 50.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use crate::plant::integrate;
    use crate::simulation::largest;
    use shared_types::Truth;

    #[test]
    fn the_paper_s_numbers_stand() {
        let start = RotatingBody.initial_state();
        assert_eq!(start.angular_velocity_rad_s, Vector3::new(0.1, 0.0, 0.0));
        assert_eq!(start.euler_rad(), [0.0; 3]);
        assert!(
            (RotatingBody.command(0.0, &start).torque_n_m - Vector3::new(0.0, 0.01, 0.01)).norm() < 1e-17
        );
        // By hand for ω = (0.1, 0.2, 0.3): ω × Iω = (0, 0.3·0.02 − 0.1·4.5, 0.1·3 − 0.2·0.02), ‖ω‖ = √0.14.
        let drag = 0.001 * 0.14f64.sqrt();
        let expected = Vector3::new(-0.1 * drag, 0.444 - 0.2 * drag, -0.296 - 0.3 * drag);
        assert!((unknown_torque_n_m(&Vector3::new(0.1, 0.2, 0.3)) - expected).norm() < 1e-15);
        let error = Vector3::new(0.0, 0.2, 0.3);
        let felt = RotatingBody.acceleration(&start, &Wrench::zero(), &error).angular_rad_s2;
        assert!((felt.component_mul(&INERTIA_KG_M2) - expected).norm() < 1e-15);
        assert!((angular_velocity_error_rad_s(0.1) - 0.05 * 0.5f64.sin()).abs() < 1e-17);
        let (t, dt) = (3.0, 1e-5);
        let difference = (reference(t + dt).0 - reference(t - dt).0) / (2.0 * dt);
        assert!((difference - reference(t).1).norm() < 1e-11);
    }

    /// The paper's own form, written here a second time: η̇ = Γ(η) ω with 3-2-1 Euler angles.
    fn euler_form(x: &[f64; 6], u: &Vector3<f64>) -> [f64; 6] {
        let ([phi, theta, _], w) = ([x[0], x[1], x[2]], Vector3::new(x[3], x[4], x[5]));
        let swirl = w.y * phi.sin() + w.z * phi.cos();
        let [i1, i2, i3] = [0.2, 15.0, 15.0];
        let drag = 0.001 * w.norm();
        [
            w.x + swirl * theta.tan(),
            w.y * phi.cos() - w.z * phi.sin(),
            swirl / theta.cos(),
            (u.x - drag * w.x - (i3 - i2) * w.y * w.z) / i1,
            (u.y - drag * w.y - (i1 - i3) * w.z * w.x) / i2,
            (u.z - drag * w.z - (i2 - i1) * w.x * w.y) / i3,
        ]
    }

    #[test]
    fn the_quaternion_agrees_with_the_paper_s_euler_angles_integrated_finely() {
        let mut state = RotatingBody.initial_state();
        let mut x = [0.0, 0.0, 0.0, 0.1, 0.0, 0.0];
        for j in 0..30 * 200 {
            let command = RotatingBody.command(f64::from(j) / 200.0, &state);
            state = integrate(&RotatingBody, &state, &command, &Vector3::zeros(), 0.005);
            let dt = 0.005 / 20.0;
            for _ in 0..20 {
                let at = |k: &[f64; 6], s: f64| std::array::from_fn(|i| x[i] + s * k[i]);
                let k1 = euler_form(&x, &command.torque_n_m);
                let k2 = euler_form(&at(&k1, dt / 2.0), &command.torque_n_m);
                let k3 = euler_form(&at(&k2, dt / 2.0), &command.torque_n_m);
                let k4 = euler_form(&at(&k3, dt), &command.torque_n_m);
                x = std::array::from_fn(|i| x[i] + dt / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
            }
            for (axis, angle) in state.euler_rad().into_iter().enumerate() {
                let difference = (angle - x[axis] + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                    - std::f64::consts::PI;
                assert!(difference.abs() < 1e-9, "axis {axis}, sample {j}: {difference:e}");
            }
        }
        assert!(x[2] > 2.0 && x[1].abs() > 0.1, "the body was to turn far: {x:?}");
    }

    #[test]
    fn the_body_turns_as_its_reference_does_for_the_paper_s_hundred_seconds() {
        let error =
            |t_s: f64, truth: &Truth| (Vector3::from(truth.angular_velocity_rad_s) - reference(t_s).0).norm();
        let worst = largest(Scenario::Rotation, 100.0, error);
        // An unknown torque of 0.17 N m and 14 kg m² of ω̇_r that the controller leaves out, against 10 N m s.
        assert!(worst > 1e-3 && worst < 0.035);
    }
}
