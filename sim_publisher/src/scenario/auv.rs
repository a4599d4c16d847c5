//! An underwater vehicle that moves in a lawn-mower pattern in a current: added mass, damping, Coriolis, buoyancy.
//!
//! North-east-down, origin in the center of mass. With ν = Rᵀv, ν_r = Rᵀ(v − c), M_A and J_A diagonal:
//!
//! `m v̇ + R (M_A ν̇_r + ω × M_A ν_r) = u − R D(ν_r) ν_r + (W − B) e₃`
//! `J ω̇ + ω × J ω + ν_r × M_A ν_r = u_τ − D_ω(ω) ω + r_B × Rᵀ(−B e₃) ,   J = J_rigid + J_A`
//!
//! | symbol | meaning | value |
//! |---|---|---|
//! | m, M_A | dry mass, added mass (surge, sway, heave) | 30 kg, (5, 25, 28) kg |
//! | J_rigid, J_A | dry and added inertia | (0.8, 3.5, 3.5), (0.3, 2.8, 2.6) kg m² |
//! | D | (4, 20, 25) N s/m + (6, 60, 70) N s²/m² · \|ν_r\| for each axis | |
//! | D_ω | (1, 4, 4) N m s + (0.5, 6, 6) N m s² · \|ω\| for each axis | |
//! | B − W | positive buoyancy | 3 N |
//! | r_B | center of buoyancy | 4 cm above the center of mass |
//! | c | current | (0.3, 0.15, 0) m/s + variation ξ |
//!
//! ξ, the variation of the current, is Gauss–Markov with 30 s and 0.05 m/s rms on each axis. It is no force, so
//! its published effect is the force and torque that it adds at the same state and command (through damping,
//! Coriolis and the Munk moment), in terms of the nominal plant. The current's own acceleration is neglected:
//! `ν̇_r = Rᵀ v̇ − ω × ν_r`.
//!
//! # Source
//! Fossen (2011), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 6–8; Kirchhoff's equations for
//! the added mass

use super::definition::{Definition, Vehicle};
use crate::disturbance::GaussMarkov;
use crate::plant::{Acceleration, Nominal, State, TruePlant, Wrench, attitude_error};
use crate::sensors::{Schedule, SensorSuite, VectorSensor, VelocityFrame};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

const GRAVITY_M_S2: f64 = 9.81;

/// The nominal plant of service and controller: a neutrally buoyant body.
const NOMINAL: Nominal = Nominal {
    mass_kg: 45.0,
    inertia_kg_m2: Vector3::new(1.2, 6.0, 6.0),
    gravity_m_s2: Vector3::new(0.0, 0.0, 0.0),
};

/// `(linear + quadratic |x|) x` on each axis.
#[derive(Debug, Clone)]
struct Damping {
    linear: Vector3<f64>,
    quadratic: Vector3<f64>,
}

impl Damping {
    fn opposing(&self, x: &Vector3<f64>) -> Vector3<f64> {
        -(self.linear + self.quadratic.component_mul(&x.abs())).component_mul(x)
    }
}

/// The true vehicle. The disturbance is a variation of the current, inertial (m/s).
#[derive(Debug, Clone)]
pub struct UnderwaterVehicle {
    mass_kg: f64,
    added_mass_kg: Vector3<f64>,
    inertia_kg_m2: Vector3<f64>,
    added_inertia_kg_m2: Vector3<f64>,
    damping_n: Damping,
    angular_damping_n_m: Damping,
    net_buoyancy_n: f64,
    center_of_buoyancy_m: Vector3<f64>,
    current_m_s: Vector3<f64>,
}

static TRUE: UnderwaterVehicle = UnderwaterVehicle {
    mass_kg: 30.0,
    added_mass_kg: Vector3::new(5.0, 25.0, 28.0),
    inertia_kg_m2: Vector3::new(0.8, 3.5, 3.5),
    added_inertia_kg_m2: Vector3::new(0.3, 2.8, 2.6),
    damping_n: Damping { linear: Vector3::new(4.0, 20.0, 25.0), quadratic: Vector3::new(6.0, 60.0, 70.0) },
    angular_damping_n_m: Damping {
        linear: Vector3::new(1.0, 4.0, 4.0),
        quadratic: Vector3::new(0.5, 6.0, 6.0),
    },
    net_buoyancy_n: 3.0,
    center_of_buoyancy_m: Vector3::new(0.0, 0.0, -0.04),
    current_m_s: Vector3::new(0.3, 0.15, 0.0),
};

impl TruePlant for UnderwaterVehicle {
    /// Along body axes, `(m + M_A) Rᵀv̇ = Rᵀu + M_A (ω × ν_r) − ω × M_A ν_r − D ν_r + Rᵀ(W − B) e₃`.
    fn acceleration(
        &self,
        state: &State,
        command: &Wrench,
        current_variation: &Vector3<f64>,
    ) -> Acceleration {
        let rotation = state.rotation();
        let omega = state.angular_velocity_rad_s;
        let water = rotation.inverse() * (state.velocity_m_s - self.current_m_s - current_variation);
        let added_momentum = self.added_mass_kg.component_mul(&water);
        let buoyancy_n = self.mass_kg * GRAVITY_M_S2 + self.net_buoyancy_n;

        let down = rotation.inverse() * Vector3::z();
        let force_n = rotation.inverse() * command.force_n
            + self.added_mass_kg.component_mul(&omega.cross(&water))
            - omega.cross(&added_momentum)
            + self.damping_n.opposing(&water)
            - self.net_buoyancy_n * down;
        let inertia = self.inertia_kg_m2 + self.added_inertia_kg_m2;
        let torque_n_m =
            command.torque_n_m - omega.cross(&inertia.component_mul(&omega)) - water.cross(&added_momentum)
                + self.angular_damping_n_m.opposing(&omega)
                + self.center_of_buoyancy_m.cross(&(-buoyancy_n * down));
        Acceleration {
            linear_m_s2: rotation * force_n.component_div(&self.added_mass_kg.add_scalar(self.mass_kg)),
            angular_rad_s2: torque_n_m.component_div(&inertia),
        }
    }
}

struct Reference {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
    attitude: Rotation3<f64>,
    angular_velocity: Vector3<f64>,
}

/// Lanes of 20 m, 6.7 m apart, joined by turns, in waves of 1.5 m depth; the nose along the path.
///
/// `x = X sin wt ,  y = V t − V/(2w) sin 2wt ,  z = 10 + 1.5 sin 0.2t`, so that `ẏ = V (1 − cos 2wt)` vanishes in the
/// middle of a lane and is 2V in a turn: 1.4 m/s along the lanes, 0.6 m/s in the turns.
fn reference(t: f64) -> Reference {
    let (x_amplitude, w, v, depth_rate) = (10.0, 0.14, 0.3, 0.2);
    let (sin, cos) = (w * t).sin_cos();
    let (sin_2, cos_2) = (2.0 * w * t).sin_cos();
    let (sin_z, cos_z) = (depth_rate * t).sin_cos();
    let position = Vector3::new(x_amplitude * sin, v * t - v / (2.0 * w) * sin_2, 10.0 + 1.5 * sin_z);
    let velocity = Vector3::new(x_amplitude * w * cos, v * (1.0 - cos_2), 1.5 * depth_rate * cos_z);
    let acceleration =
        Vector3::new(-x_amplitude * w * w * sin, 2.0 * v * w * sin_2, -1.5 * depth_rate * depth_rate * sin_z);
    let level = velocity.xy().norm();
    let level_rate = velocity.xy().dot(&acceleration.xy()) / level;
    let (yaw, pitch) = (velocity.y.atan2(velocity.x), -(velocity.z / level).atan());
    let yaw_rate = (velocity.x * acceleration.y - velocity.y * acceleration.x) / (level * level);
    let pitch_rate = -(acceleration.z * level - velocity.z * level_rate) / velocity.norm_squared();
    Reference {
        position,
        velocity,
        acceleration,
        attitude: Rotation3::from_euler_angles(0.0, pitch, yaw),
        angular_velocity: Vector3::new(-yaw_rate * pitch.sin(), pitch_rate, yaw_rate * pitch.cos()),
    }
}

impl Vehicle for UnderwaterVehicle {
    fn initial_state(&self) -> State {
        let start = reference(0.0);
        State {
            position_m: start.position,
            velocity_m_s: start.velocity,
            attitude: UnitQuaternion::from_rotation_matrix(&start.attitude).into_inner(),
            angular_velocity_rad_s: start.angular_velocity,
        }
    }

    /// `u = m (−k_p (r − r_r) − k_v (v − v_r) + v̇_r) ,  u_τ = I (−ω_n² e_R − 2 ζ ω_n (ω − ω_r))`
    ///
    /// with 1.4 rad/s and 0.92 for the position, 4 rad/s and 0.8 for the attitude; thrusters on every axis.
    fn command(&self, t_s: f64, state: &State) -> Wrench {
        let reference = reference(t_s);
        let force_n = NOMINAL.mass_kg
            * (-2.0 * (state.position_m - reference.position)
                - 2.6 * (state.velocity_m_s - reference.velocity)
                + reference.acceleration);
        let rotation = state.rotation().to_rotation_matrix();
        let error = attitude_error(&reference.attitude, &rotation);
        let wanted_rad_s2 = -16.0 * error - 6.4 * (state.angular_velocity_rad_s - reference.angular_velocity);
        Wrench { force_n, torque_n_m: NOMINAL.inertia_kg_m2.component_mul(&wanted_rad_s2) }
    }
}

/// The vehicle with a Doppler log at 10 Hz; position only at the start.
pub(super) fn definition() -> Definition {
    Definition {
        vehicle: &TRUE,
        nominal: NOMINAL,
        disturbance: Some(GaussMarkov { time_constant_s: 30.0, rms: 0.05 }),
        sensors: SensorSuite {
            velocity: VectorSensor { noise: 0.01, ..VectorSensor::at(Schedule::AtHz(10.0)) },
            velocity_frame: VelocityFrame::Body,
            angular_velocity: VectorSensor::each_sample(0.002),
            position: VectorSensor { noise: 0.5, ..VectorSensor::at(Schedule::Start) },
            attitude: VectorSensor::each_sample(0.005),
            commands_force: true,
            commands_torque: true,
        },
        lowest_rate_hz: 20.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use crate::plant::integrate_in;
    use crate::simulation::largest;
    use shared_types::Truth;

    fn in_ideal_still_water() -> UnderwaterVehicle {
        let none = Damping { linear: Vector3::zeros(), quadratic: Vector3::zeros() };
        UnderwaterVehicle {
            damping_n: none.clone(),
            angular_damping_n_m: none,
            net_buoyancy_n: 0.0,
            center_of_buoyancy_m: Vector3::zeros(),
            current_m_s: Vector3::zeros(),
            ..TRUE.clone()
        }
    }

    /// Kirchhoff: without forces, kinetic energy, momentum and angular momentum of body and water together stay.
    #[test]
    fn an_ideal_fluid_keeps_energy_and_momentum() {
        let vehicle = in_ideal_still_water();
        let mass = vehicle.added_mass_kg.add_scalar(vehicle.mass_kg);
        let inertia = vehicle.inertia_kg_m2 + vehicle.added_inertia_kg_m2;
        let invariants = |s: &State| {
            let body = s.rotation().inverse() * s.velocity_m_s;
            let omega = s.angular_velocity_rad_s;
            let momentum = s.rotation() * mass.component_mul(&body);
            let spin = s.rotation() * inertia.component_mul(&omega) + s.position_m.cross(&momentum);
            let energy =
                0.5 * (body.dot(&mass.component_mul(&body)) + omega.dot(&inertia.component_mul(&omega)));
            (energy, momentum, spin)
        };
        let start = State {
            velocity_m_s: Vector3::new(1.0, 0.4, -0.3),
            angular_velocity_rad_s: Vector3::new(0.3, 0.5, -0.4),
            ..State::at_rest()
        };
        let end = integrate_in(&vehicle, &start, &Wrench::zero(), &Vector3::zeros(), 10.0, 10_000);
        let ((e0, p0, l0), (e1, p1, l1)) = (invariants(&start), invariants(&end));
        assert!((end.velocity_m_s - start.velocity_m_s).norm() > 0.1, "the motion was to be a curved one");
        // 10 000 steps with rounding errors of 1e-16 of values up to 100.
        assert!((e1 - e0).abs() < 1e-9 && (p1 - p0).norm() < 1e-9 && (l1 - l0).norm() < 1e-8);
    }

    #[test]
    fn a_vehicle_that_drifts_with_the_current_feels_only_its_buoyancy() {
        let state = State { velocity_m_s: TRUE.current_m_s, ..State::at_rest() };
        let motion = TRUE.acceleration(&state, &Wrench::zero(), &Vector3::zeros());
        assert!((motion.linear_m_s2 - Vector3::new(0.0, 0.0, -3.0 / 58.0)).norm() < 1e-15);
        assert!(motion.angular_rad_s2.norm() < 1e-15);
    }

    #[test]
    fn a_heeled_vehicle_rights_itself() {
        let heeled = |roll: f64, pitch: f64| State {
            attitude: UnitQuaternion::from_euler_angles(roll, pitch, 0.0).into_inner(),
            velocity_m_s: TRUE.current_m_s,
            ..State::at_rest()
        };
        // B · 4 cm · sin(angle) over the inertia.
        let moment = (30.0 * 9.81 + 3.0) * 0.04 * 0.2f64.sin();
        let roll = TRUE.acceleration(&heeled(0.2, 0.0), &Wrench::zero(), &Vector3::zeros()).angular_rad_s2;
        let pitch = TRUE.acceleration(&heeled(0.0, 0.2), &Wrench::zero(), &Vector3::zeros()).angular_rad_s2;
        assert!((roll - Vector3::new(-moment / 1.1, 0.0, 0.0)).norm() < 1e-12, "{roll}");
        assert!((pitch - Vector3::new(0.0, -moment / 6.3, 0.0)).norm() < 1e-12, "{pitch}");
    }

    #[test]
    fn a_varied_current_acts_as_that_current_would() {
        let state = TRUE.initial_state();
        let variation = Vector3::new(0.04, -0.07, 0.02);
        let command = TRUE.command(0.0, &state);
        let elsewhere = UnderwaterVehicle { current_m_s: TRUE.current_m_s + variation, ..TRUE.clone() };
        let here = NOMINAL.unknown(&TRUE, &state, &command, &variation);
        let there = NOMINAL.unknown(&elsewhere, &state, &command, &Vector3::zeros());
        let sum = here.matched.force_n + here.unmatched.force_n;
        assert!((sum - there.matched.force_n).norm() < 1e-12);
        assert!(here.unmatched.force_n.norm() > 0.1 && here.unmatched.torque_n_m.norm() > 0.01);
    }

    #[test]
    fn the_reference_s_derivatives_are_those_of_its_position_and_attitude() {
        let dt = 1e-5;
        for t in [0.0, 3.3, 11.2, 40.0] {
            let (before, here, after) = (reference(t - dt), reference(t), reference(t + dt));
            assert!(((after.position - before.position) / (2.0 * dt) - here.velocity).norm() < 1e-8);
            assert!(((after.velocity - before.velocity) / (2.0 * dt) - here.acceleration).norm() < 1e-8);
            let turned = attitude_error(&before.attitude, &after.attitude) / (2.0 * dt);
            assert!((turned - here.angular_velocity).norm() < 1e-8, "{turned} {}", here.angular_velocity);
        }
    }

    #[test]
    fn the_vehicle_stays_near_its_lanes_with_its_nose_along_them() {
        let distance =
            |t_s: f64, truth: &Truth| (Vector3::from(truth.position_m) - reference(t_s).position).norm();
        let angle = |t_s: f64, truth: &Truth| {
            let [w, x, y, z] = truth.attitude_wxyz;
            let attitude = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
            attitude.angle_to(&UnitQuaternion::from_rotation_matrix(&reference(t_s).attitude))
        };
        let worst = (largest(Scenario::Auv, 120.0, distance), largest(Scenario::Auv, 120.0, angle));
        // 40 N of drag and added mass against 45 kg · 2 s⁻², 20 N m of the Munk moment against 6 kg m² · 16 s⁻².
        assert!(worst.0 < 0.5 && worst.1 < 0.3);
    }
}
