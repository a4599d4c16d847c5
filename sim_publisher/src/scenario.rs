//! The simulated vehicles: the true plant, the nominal plant that the service is configured with, controller and sensors.
//!
//! | scenario | unknown to the nominal plant | ξ | measured |
//! |---|---|---|---|
//! | `translation` | the paper's f(v) | none | inertial velocity |
//! | `rotation` | drag torque and −ω × Iω | none | angular velocity |
//! | `rigid-body` | payload, drag in wind, rotor drag, offset center of mass, another inertia | gusts | inertial velocity, angular velocity, attitude |
//! | `auv` | added mass, damping, Coriolis, buoyancy, current | variation of the current | body velocity at 10 Hz, angular velocity, attitude |
//!
//! The controllers use the true state and the nominal plant, as in the paper. They only generate the motion and are not under
//! test. Every vehicle starts on its reference trajectory.

pub mod auv;
mod definition;
pub mod rigid_body;
pub mod rotation;
pub mod translation;

pub use definition::{Definition, Vehicle};

use crate::plant::Nominal;

/// Which vehicle, with which sensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scenario {
    /// The paper's first example: a point mass with a velocity-dependent unknown force
    Translation,
    /// The paper's second example: a rotating body with drag and gyroscopic torque unknown
    Rotation,
    /// A quadcopter with an unknown payload in wind and gusts, flying figure-eights
    RigidBody,
    /// An underwater vehicle with added mass and damping in a current, mowing the lawn
    Auv,
}

impl Scenario {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Translation, Self::Rotation, Self::RigidBody, Self::Auv];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Translation => "translation",
            Self::Rotation => "rotation",
            Self::RigidBody => "rigid-body",
            Self::Auv => "auv",
        }
    }

    /// Vehicle, nominal plant, disturbance and sensors.
    pub fn definition(self) -> Definition {
        match self {
            Self::Translation => translation::definition(),
            Self::Rotation => rotation::definition(),
            Self::RigidBody => rigid_body::definition(),
            Self::Auv => auv::definition(),
        }
    }

    /// The nominal plant, with which the service is configured.
    pub fn nominal(self) -> Nominal {
        self.definition().nominal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::{State, Wrench, integrate_in};
    use clap::ValueEnum;
    use nalgebra::{Matrix3, Quaternion, Vector3};
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        proptest::array::uniform3(-size..size).prop_map(Vector3::from)
    }

    fn motion() -> impl Strategy<Value = State> {
        (vector(20.0), vector(3.0), proptest::array::uniform4(-1.0..1.0f64), vector(1.0)).prop_filter_map(
            "a quaternion near zero has no direction",
            |(position_m, velocity_m_s, q, angular_velocity_rad_s)| {
                let attitude = Quaternion::new(q[0], q[1], q[2], q[3]);
                (attitude.norm() > 0.1).then(|| State {
                    position_m,
                    velocity_m_s,
                    attitude: attitude.normalize(),
                    angular_velocity_rad_s,
                })
            },
        )
    }

    #[test]
    fn names_are_those_of_the_command_line() {
        for scenario in Scenario::ALL {
            assert_eq!(Scenario::from_str(scenario.name(), false), Ok(scenario));
        }
        assert_eq!(Scenario::value_variants().len(), Scenario::ALL.len());
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        /// `m v̇ = u + m g + f + ξ` and `I ω̇ = u_τ + f_τ + ξ_τ`, the derivatives taken from the integrated
        /// motion and not from the plant's own formula.
        #[test]
        fn f_and_xi_complete_the_nominal_plant(
            state in motion(), force_n in vector(30.0), torque_n_m in vector(0.5), disturbance in vector(0.3)
        ) {
            for scenario in Scenario::ALL {
                let Definition { vehicle, nominal, .. } = scenario.definition();
                let command = Wrench { force_n, torque_n_m };
                let unknown = nominal.unknown(vehicle, &state, &command, &disturbance);
                let dt_s = 1e-5;
                let later = integrate_in(vehicle, &state, &command, &disturbance, dt_s, 1);
                let earlier = integrate_in(vehicle, &state, &command, &disturbance, -dt_s, 1);
                let v_dot = (later.velocity_m_s - earlier.velocity_m_s) / (2.0 * dt_s);
                let w_dot =
                    (later.angular_velocity_rad_s - earlier.angular_velocity_rad_s) / (2.0 * dt_s);
                let force = nominal.mass_kg * (v_dot - nominal.gravity_m_s2)
                    - (force_n + unknown.matched.force_n + unknown.unmatched.force_n);
                let torque = Matrix3::from_diagonal(&nominal.inertia_kg_m2) * w_dot
                    - (torque_n_m + unknown.matched.torque_n_m + unknown.unmatched.torque_n_m);
                // The central difference errs by dt²/6 of the third derivative, of which damping makes up to 1e6 N/s².
                prop_assert!(force.norm() < 1e-4, "{}: force is off by {force:?}", scenario.name());
                prop_assert!(torque.norm() < 1e-4, "{}: torque is off by {torque:?}", scenario.name());
            }
        }
    }
}
