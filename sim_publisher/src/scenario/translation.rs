//! The paper's first example: a point mass of 4 kg whose velocity-dependent force is unknown.
//!
//! # Source
//! Niu et al., Vector-Valued Native Space Embedding for Adaptive State Observation, example 1

use super::definition::{Definition, Vehicle};
use crate::plant::{Acceleration, Nominal, State, TruePlant, Wrench};
use crate::sensors::{Schedule, SensorSuite, VectorSensor, VelocityFrame};
use nalgebra::Vector3;

const MASS_KG: f64 = 4.0;

/// A point mass; it has no attitude. The disturbance is what is added to v where f is taken (m/s): with δ(t) for
/// it, the plant feels f at the measured output, the paper's E_{y(t)} f. The scenario has none.
#[derive(Debug)]
pub struct PointMass;

/// `f(v) = (cos v₁², sin v₂² + sin v₁, cos v₃ + sin v₂)` (N).
pub fn unknown_force_n(velocity_m_s: &Vector3<f64>) -> Vector3<f64> {
    let v = velocity_m_s;
    Vector3::new((v.x * v.x).cos(), (v.y * v.y).sin() + v.x.sin(), v.z.cos() + v.y.sin())
}

/// `δ(t) = 0.008 (sin 0.5t + cos 0.5t)` (m/s), the error of each axis.
pub fn velocity_error_m_s(t_s: f64) -> f64 {
    0.008 * ((0.5 * t_s).sin() + (0.5 * t_s).cos())
}

struct Reference {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
}

/// `r_r = (sin t, cos t, sin 2t)` (m) and its derivatives.
fn reference(t: f64) -> Reference {
    let (sin, cos) = t.sin_cos();
    let (sin_2, cos_2) = (2.0 * t).sin_cos();
    Reference {
        position: Vector3::new(sin, cos, sin_2),
        velocity: Vector3::new(cos, -sin, 2.0 * cos_2),
        acceleration: Vector3::new(-sin, -cos, -4.0 * sin_2),
    }
}

impl TruePlant for PointMass {
    fn acceleration(&self, state: &State, command: &Wrench, disturbance: &Vector3<f64>) -> Acceleration {
        let felt_at_m_s = state.velocity_m_s + disturbance;
        Acceleration {
            linear_m_s2: (command.force_n + unknown_force_n(&felt_at_m_s)) / MASS_KG,
            angular_rad_s2: Vector3::zeros(),
        }
    }
}

impl Vehicle for PointMass {
    fn initial_state(&self) -> State {
        let start = reference(0.0);
        State { position_m: start.position, velocity_m_s: start.velocity, ..State::at_rest() }
    }

    /// `u = −(r − r_r) − (v − v_r) + m v̇_r`
    fn command(&self, t_s: f64, state: &State) -> Wrench {
        let reference = reference(t_s);
        let force_n = -(state.position_m - reference.position) - (state.velocity_m_s - reference.velocity)
            + MASS_KG * reference.acceleration;
        Wrench { force_n, ..Wrench::zero() }
    }
}

/// The example as the paper states it.
pub(super) fn definition() -> Definition {
    Definition {
        vehicle: &PointMass,
        nominal: Nominal {
            mass_kg: MASS_KG,
            inertia_kg_m2: Vector3::repeat(1.0),
            gravity_m_s2: Vector3::zeros(),
        },
        disturbance: None,
        sensors: SensorSuite {
            velocity: VectorSensor {
                fixed_error: Some(velocity_error_m_s),
                ..VectorSensor::each_sample(0.0)
            },
            velocity_frame: VelocityFrame::Inertial,
            position: VectorSensor { noise: 0.05, ..VectorSensor::at(Schedule::Start) },
            commands_force: true,
            ..SensorSuite::nothing()
        },
        lowest_rate_hz: 10.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use crate::simulation::largest;
    use shared_types::Truth;

    #[test]
    fn the_paper_s_numbers_stand() {
        let start = PointMass.initial_state();
        assert_eq!(
            (start.position_m, start.velocity_m_s),
            (Vector3::new(0.0, 1.0, 0.0), Vector3::new(1.0, 0.0, 2.0))
        );
        // On the reference only m v̇_r is left: 4 · (0, −1, 0).
        assert_eq!(PointMass.command(0.0, &start).force_n, Vector3::new(0.0, -4.0, 0.0));
        // Computed by hand for v = (1, 0, 2): (cos 1, sin 1, cos 2).
        let expected = Vector3::new(0.5403023058681398, 0.8414709848078965, -0.4161468365471424);
        assert!((unknown_force_n(&start.velocity_m_s) - expected).norm() < 1e-15);
        let error = Vector3::repeat(0.1);
        let unknown = definition().nominal.unknown(&PointMass, &start, &Wrench::zero(), &error);
        assert!((unknown.matched.force_n - expected).norm() < 1e-14);
        // f(v + 0.1) = (cos 1.21, sin 0.01 + sin 1.1, cos 2.1 + sin 0.1), by hand.
        let felt = Vector3::new(0.3530194012193302, 0.9012071933956021, -0.4050126879530294);
        assert!((expected + unknown.unmatched.force_n - felt).norm() < 1e-14);
        assert_eq!(velocity_error_m_s(0.0), 0.008);
        // sin x + cos x is at most √2, at x = π/4.
        let largest = velocity_error_m_s(std::f64::consts::FRAC_PI_2);
        assert!((largest - 0.008 * std::f64::consts::SQRT_2).abs() < 1e-16);
    }

    #[test]
    fn the_reference_s_derivatives_are_those_of_its_position() {
        let (t, dt) = (1.7, 1e-5);
        let (before, here, after) = (reference(t - dt), reference(t), reference(t + dt));
        assert!(((after.position - before.position) / (2.0 * dt) - here.velocity).norm() < 1e-8);
        assert!(((after.velocity - before.velocity) / (2.0 * dt) - here.acceleration).norm() < 1e-8);
    }

    #[test]
    fn the_unknown_force_pushes_the_mass_no_further_than_the_feedback_allows() {
        let distance =
            |t_s: f64, truth: &Truth| (Vector3::from(truth.position_m) - reference(t_s).position).norm();
        let worst = largest(Scenario::Translation, 60.0, distance);
        // A force of at most √6 N against a spring of 1 N/m, damped with a ratio of 1/4: it may overshoot by half.
        assert!(worst > 0.5 && worst < 1.5 * 6f64.sqrt());
    }
}
