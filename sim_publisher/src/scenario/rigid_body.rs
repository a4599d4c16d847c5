//! A quadcopter with an undeclared payload, in wind and gusts, flying figure-eights.
//!
//! North-east-down; thrust acts along −z of the body.
//!
//! `m_t v̇ = u + m_t g − (c₁ + c₂ ‖v − w‖)(v − w) + ξ`
//! `I_t ω̇ = u_τ − ω × I_t ω − D ω + τ₀`
//!
//! | symbol | meaning | value |
//! |---|---|---|
//! | m_t | true mass: 2 kg declared, 0.15 kg not | 2.15 kg |
//! | I_t | true inertia | diag(0.022, 0.019, 0.037) kg m² |
//! | c₁, c₂ | drag | 0.15 N s/m, 0.06 N s²/m² |
//! | w | wind | (3, −2, 0) m/s |
//! | D | rotor drag | diag(0.01, 0.01, 0.005) N m s |
//! | τ₀ | thrust beside the center of mass | (0.02, −0.03, 0.005) N m |
//! | ξ | gust, Gauss–Markov, 1 s, on each axis | 0.3 N rms |

use super::definition::{Definition, Vehicle};
use crate::disturbance::GaussMarkov;
use crate::plant::{Acceleration, Nominal, State, TruePlant, Wrench, attitude_error};
use crate::sensors::{Schedule, SensorSuite, VectorSensor, VelocityFrame};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// The nominal plant of service and controller.
const NOMINAL: Nominal = Nominal {
    mass_kg: 2.0,
    inertia_kg_m2: Vector3::new(0.02, 0.02, 0.035),
    gravity_m_s2: Vector3::new(0.0, 0.0, 9.81),
};

/// The true quadcopter. The disturbance is a gust force, inertial (N).
#[derive(Debug, Clone)]
pub struct Quadcopter {
    mass_kg: f64,
    inertia_kg_m2: Vector3<f64>,
    linear_drag_n_s_m: f64,
    quadratic_drag_n_s2_m2: f64,
    wind_m_s: Vector3<f64>,
    rotor_drag_n_m_s: Vector3<f64>,
    torque_bias_n_m: Vector3<f64>,
}

static TRUE: Quadcopter = Quadcopter {
    mass_kg: 2.15,
    inertia_kg_m2: Vector3::new(0.022, 0.019, 0.037),
    linear_drag_n_s_m: 0.15,
    quadratic_drag_n_s2_m2: 0.06,
    wind_m_s: Vector3::new(3.0, -2.0, 0.0),
    rotor_drag_n_m_s: Vector3::new(0.01, 0.01, 0.005),
    torque_bias_n_m: Vector3::new(0.02, -0.03, 0.005),
};

impl Quadcopter {
    /// `−(c₁ + c₂ ‖v − w‖)(v − w)` (N).
    fn drag_n(&self, velocity_m_s: &Vector3<f64>) -> Vector3<f64> {
        let air = velocity_m_s - self.wind_m_s;
        -(self.linear_drag_n_s_m + self.quadratic_drag_n_s2_m2 * air.norm()) * air
    }
}

impl TruePlant for Quadcopter {
    fn acceleration(&self, state: &State, command: &Wrench, gust_n: &Vector3<f64>) -> Acceleration {
        let omega = state.angular_velocity_rad_s;
        let momentum = self.inertia_kg_m2.component_mul(&omega);
        let torque_n_m =
            command.torque_n_m - omega.cross(&momentum) - self.rotor_drag_n_m_s.component_mul(&omega)
                + self.torque_bias_n_m;
        Acceleration {
            linear_m_s2: NOMINAL.gravity_m_s2
                + (command.force_n + self.drag_n(&state.velocity_m_s) + gust_n) / self.mass_kg,
            angular_rad_s2: torque_n_m.component_div(&self.inertia_kg_m2),
        }
    }
}

struct Reference {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
    yaw: f64,
}

/// A figure-eight of 10 m by 6 m in 12 s, tilted by 1 m, 10 m above the ground, the nose swinging by half a radian.
fn reference(t: f64) -> Reference {
    let w = std::f64::consts::TAU / 12.0;
    let (sin, cos) = (w * t).sin_cos();
    let (sin_2, cos_2) = (2.0 * w * t).sin_cos();
    Reference {
        position: Vector3::new(5.0 * sin, 3.0 * sin_2, -10.0 - sin),
        velocity: w * Vector3::new(5.0 * cos, 6.0 * cos_2, -cos),
        acceleration: w * w * Vector3::new(-5.0 * sin, -12.0 * sin_2, sin),
        yaw: 0.5 * (0.3 * t).sin(),
    }
}

/// The force that the controller commands, and the attitude whose thrust axis points along it.
///
/// `u* = m (−k_p (r − r_r) − k_v (v − v_r) + v̇_r − g)`, with a natural frequency of 2 rad/s and damping 0.8.
fn wanted(t_s: f64, state: &State) -> (Vector3<f64>, Rotation3<f64>) {
    let reference = reference(t_s);
    let force_n = NOMINAL.mass_kg
        * (-4.0 * (state.position_m - reference.position) - 3.2 * (state.velocity_m_s - reference.velocity)
            + reference.acceleration
            - NOMINAL.gravity_m_s2);
    let down = -force_n.normalize();
    let right = down.cross(&Vector3::new(reference.yaw.cos(), reference.yaw.sin(), 0.0)).normalize();
    let forward = right.cross(&down);
    (force_n, Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[forward, right, down])))
}

impl Vehicle for Quadcopter {
    fn initial_state(&self) -> State {
        let start = reference(0.0);
        let still = State { position_m: start.position, velocity_m_s: start.velocity, ..State::at_rest() };
        let (_, attitude) = wanted(0.0, &still);
        State { attitude: nalgebra::UnitQuaternion::from_rotation_matrix(&attitude).into_inner(), ..still }
    }

    /// `T = −u*·R e₃ ,  u = −T R e₃ ,  u_τ = I (−ω_n² e_R − 2 ζ ω_n ω)`, ω_n = 10 rad/s, ζ = 0.8.
    ///
    /// The force is held along the inertial axes while the body turns by some milliradians.
    fn command(&self, t_s: f64, state: &State) -> Wrench {
        let (force_n, attitude) = wanted(t_s, state);
        let rotation = state.rotation().to_rotation_matrix();
        let down = rotation * Vector3::z();
        let least_thrust_n = 0.1 * NOMINAL.mass_kg * NOMINAL.gravity_m_s2.z;
        let thrust_n = (-force_n.dot(&down)).max(least_thrust_n);
        let error = attitude_error(&attitude, &rotation);
        let wanted_rad_s2 = -100.0 * error - 16.0 * state.angular_velocity_rad_s;
        Wrench { force_n: -thrust_n * down, torque_n_m: NOMINAL.inertia_kg_m2.component_mul(&wanted_rad_s2) }
    }
}

/// The quadcopter with its usual sensors: position only at the start.
pub(super) fn definition() -> Definition {
    Definition {
        vehicle: &TRUE,
        nominal: NOMINAL,
        disturbance: Some(GaussMarkov { time_constant_s: 1.0, rms: 0.3 }),
        sensors: SensorSuite {
            velocity: VectorSensor::each_sample(0.02),
            velocity_frame: VelocityFrame::Inertial,
            angular_velocity: VectorSensor::each_sample(0.005),
            position: VectorSensor { noise: 0.05, ..VectorSensor::at(Schedule::Start) },
            attitude: VectorSensor::each_sample(0.005),
            commands_force: true,
            commands_torque: true,
        },
        // The damping's rate is 16 s⁻¹; a held command adds half a step of delay to the attitude loop.
        lowest_rate_hz: 50.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use crate::simulation::largest;
    use shared_types::Truth;

    #[test]
    fn f_is_the_payload_s_share_of_the_command_and_of_the_drag() {
        let state = State {
            velocity_m_s: Vector3::new(-1.0, 2.0, 0.5),
            angular_velocity_rad_s: Vector3::new(0.3, -0.2, 0.1),
            ..State::at_rest()
        };
        let command =
            Wrench { force_n: Vector3::new(1.0, 2.0, -20.0), torque_n_m: Vector3::new(0.01, 0.02, 0.03) };
        let gust = Vector3::new(0.3, -0.1, 0.2);
        let unknown = NOMINAL.unknown(&TRUE, &state, &command, &gust);
        let share = 2.0 / 2.15;
        // Relative to the wind: (−4, 4, 0.5), so ‖·‖ = √32.25.
        let drag = -(0.15 + 0.06 * 32.25f64.sqrt()) * Vector3::new(-4.0, 4.0, 0.5);
        let expected = (share - 1.0) * command.force_n + share * drag;
        assert!((unknown.matched.force_n - expected).norm() < 1e-13);
        assert!((unknown.unmatched.force_n - share * gust).norm() < 1e-13);
        // About x: 0.02/0.022 (0.01 − (0.037 − 0.019) ω_y ω_z − 0.01 ω_x + 0.02) − 0.01.
        let about_x = 0.02 / 0.022 * (0.01 + 0.018 * 0.02 - 0.003 + 0.02) - 0.01;
        assert!((unknown.matched.torque_n_m.x - about_x).abs() < 1e-15);
        assert_eq!(unknown.unmatched.torque_n_m, Vector3::zeros());
    }

    #[test]
    fn a_declared_quadcopter_in_still_air_leaves_nothing_unknown() {
        let declared = Quadcopter {
            mass_kg: NOMINAL.mass_kg,
            inertia_kg_m2: NOMINAL.inertia_kg_m2,
            linear_drag_n_s_m: 0.0,
            quadratic_drag_n_s2_m2: 0.0,
            torque_bias_n_m: Vector3::zeros(),
            ..TRUE.clone()
        };
        let state = State { velocity_m_s: Vector3::new(4.0, 1.0, 0.0), ..State::at_rest() };
        let command = declared.command(0.3, &state);
        let unknown = NOMINAL.unknown(&declared, &state, &command, &Vector3::zeros());
        assert!(unknown.matched.force_n.norm() < 1e-13 && unknown.matched.torque_n_m.norm() < 1e-13);
    }

    #[test]
    fn the_reference_s_derivatives_are_those_of_its_position() {
        let (t, dt) = (1.7, 1e-5);
        let (before, here, after) = (reference(t - dt), reference(t), reference(t + dt));
        assert!(((after.position - before.position) / (2.0 * dt) - here.velocity).norm() < 1e-8);
        assert!(((after.velocity - before.velocity) / (2.0 * dt) - here.acceleration).norm() < 1e-8);
    }

    #[test]
    fn the_commanded_force_is_a_thrust_along_the_body_s_negative_z() {
        let state = TRUE.initial_state();
        let force = state.rotation().inverse() * TRUE.command(0.0, &state).force_n;
        assert!(force.xy().norm() < 1e-12 && force.z < -10.0, "{force}");
    }

    #[test]
    fn the_quadcopter_stays_near_its_reference() {
        let distance =
            |t_s: f64, truth: &Truth| (Vector3::from(truth.position_m) - reference(t_s).position).norm();
        let worst = largest(Scenario::RigidBody, 60.0, distance);
        // 6 N of unknown force against 2 kg · 4 s⁻², and the lag of the attitude loop.
        assert!(worst > 0.1 && worst < 1.0);
    }
}
