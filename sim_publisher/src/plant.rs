//! The true plant: a rigid body under a held command, integrated by the classical Runge–Kutta method.
//!
//! `ṙ = v,  v̇ = a(r, v, q, ω; u, ξ),  q̇ = ½ q ⊗ (0, ω),  ω̇ = α(r, v, q, ω; u, ξ)`
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | r, v | position, velocity, inertial axes | m, m/s |
//! | q | attitude, rotates body vectors into inertial ones | 1 |
//! | ω | angular velocity, body axes | rad/s |
//! | u | commanded force (inertial) and torque (body), held from sample to sample | N, N·m |
//! | ξ | disturbance that is no function of the motion, held from sample to sample | the vehicle's own |
//!
//! The command and ξ are held over a step of the samples ([`integrate_under`] takes a ξ that is not); the
//! plant's own forces, functions of the true state, are evaluated at every stage of every substep.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Longest step of the integrator (s).
pub const MAX_SUBSTEP_S: f64 = 1e-3;

/// The motion of a rigid body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Position of the center of mass, inertial (m).
    pub position_m: Vector3<f64>,
    /// Velocity of the center of mass, inertial (m/s).
    pub velocity_m_s: Vector3<f64>,
    /// Attitude, body to inertial; of unit norm between steps, not inside one.
    pub attitude: Quaternion<f64>,
    /// Angular velocity, body axes (rad/s).
    pub angular_velocity_rad_s: Vector3<f64>,
}

impl State {
    /// At rest in the origin, body axes along the inertial ones.
    pub fn at_rest() -> Self {
        Self {
            position_m: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            attitude: Quaternion::identity(),
            angular_velocity_rad_s: Vector3::zeros(),
        }
    }

    /// The attitude as a rotation, body to inertial.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_quaternion(self.attitude)
    }

    /// 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π].
    pub fn euler_rad(&self) -> [f64; 3] {
        let (roll, pitch, yaw) = self.rotation().euler_angles();
        [roll, pitch, yaw]
    }
}

/// A force along inertial axes and a torque along body axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// Force, inertial axes (N).
    pub force_n: Vector3<f64>,
    /// Torque, body axes (N·m).
    pub torque_n_m: Vector3<f64>,
}

impl Wrench {
    /// No force and no torque.
    pub fn zero() -> Self {
        Self { force_n: Vector3::zeros(), torque_n_m: Vector3::zeros() }
    }
}

/// v̇ and ω̇.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acceleration {
    /// v̇, inertial (m/s²).
    pub linear_m_s2: Vector3<f64>,
    /// ω̇, body axes (rad/s²).
    pub angular_rad_s2: Vector3<f64>,
}

/// The dynamics of one vehicle.
pub trait TruePlant {
    /// v̇ and ω̇ at `state` under the held `command` and `disturbance` (in the unit that the vehicle states).
    fn acceleration(&self, state: &State, command: &Wrench, disturbance: &Vector3<f64>) -> Acceleration;
}

#[derive(Clone, Copy)]
struct Derivative {
    velocity: Vector3<f64>,
    acceleration: Acceleration,
    attitude: Quaternion<f64>,
}

fn derivative<Plant: TruePlant + ?Sized>(
    plant: &Plant,
    state: &State,
    command: &Wrench,
    disturbance: &Vector3<f64>,
) -> Derivative {
    Derivative {
        velocity: state.velocity_m_s,
        acceleration: plant.acceleration(state, command, disturbance),
        attitude: state.attitude * Quaternion::from_imag(state.angular_velocity_rad_s) * 0.5,
    }
}

fn advanced(state: &State, rate: &Derivative, dt_s: f64) -> State {
    State {
        position_m: state.position_m + rate.velocity * dt_s,
        velocity_m_s: state.velocity_m_s + rate.acceleration.linear_m_s2 * dt_s,
        attitude: state.attitude + rate.attitude * dt_s,
        angular_velocity_rad_s: state.angular_velocity_rad_s + rate.acceleration.angular_rad_s2 * dt_s,
    }
}

/// One Runge–Kutta step of length `dt_s` under the disturbances at its start, middle and end; the quaternion is
/// brought back to unit norm at its end only, for a normalisation between stages would cost two orders.
fn runge_kutta_step<Plant: TruePlant + ?Sized>(
    plant: &Plant,
    state: &State,
    command: &Wrench,
    [at_start, at_middle, at_end]: [&Vector3<f64>; 3],
    dt_s: f64,
) -> State {
    let rate = |state: &State, disturbance| derivative(plant, state, command, disturbance);
    let k1 = rate(state, at_start);
    let k2 = rate(&advanced(state, &k1, dt_s / 2.0), at_middle);
    let k3 = rate(&advanced(state, &k2, dt_s / 2.0), at_middle);
    let k4 = rate(&advanced(state, &k3, dt_s), at_end);
    let (sixth, third) = (dt_s / 6.0, dt_s / 3.0);
    let mut next = advanced(state, &k1, sixth);
    next = advanced(&next, &k2, third);
    next = advanced(&next, &k3, third);
    next = advanced(&next, &k4, sixth);
    next.attitude = next.attitude.normalize();
    next
}

/// The state `duration_s` later, in `n_substeps` equal steps.
pub fn integrate_in<Plant: TruePlant + ?Sized>(
    plant: &Plant,
    state: &State,
    command: &Wrench,
    disturbance: &Vector3<f64>,
    duration_s: f64,
    n_substeps: usize,
) -> State {
    let dt_s = duration_s / n_substeps as f64;
    (0..n_substeps).fold(*state, |state, _| runge_kutta_step(plant, &state, command, [disturbance; 3], dt_s))
}

/// The state `duration_s` later, in `⌈duration / 1 ms⌉` equal steps.
pub fn integrate<Plant: TruePlant + ?Sized>(
    plant: &Plant,
    state: &State,
    command: &Wrench,
    disturbance: &Vector3<f64>,
    duration_s: f64,
) -> State {
    integrate_in(plant, state, command, disturbance, duration_s, n_substeps(duration_s))
}

/// As [`integrate`], under a disturbance that moves within the step: `disturbance` is ξ as a function of the
/// time since its start (s).
pub fn integrate_under<Plant: TruePlant + ?Sized>(
    plant: &Plant,
    state: &State,
    command: &Wrench,
    disturbance: impl Fn(f64) -> Vector3<f64>,
    duration_s: f64,
) -> State {
    let n_substeps = n_substeps(duration_s);
    let dt_s = duration_s / n_substeps as f64;
    (0..n_substeps).fold(*state, |state, i| {
        let [at_start, at_middle, at_end] = [0.0, 0.5, 1.0].map(|part| disturbance((i as f64 + part) * dt_s));
        runge_kutta_step(plant, &state, command, [&at_start, &at_middle, &at_end], dt_s)
    })
}

fn n_substeps(duration_s: f64) -> usize {
    // The margin keeps 5 ms, of which the difference of two times has lost a bit, at 5 steps.
    (duration_s / MAX_SUBSTEP_S - 1e-9).ceil().max(1.0) as usize
}

/// The nominal plant of a vehicle, with which the estimation service is configured.
///
/// `m v̇ = u + m g + f + ξ ,   I ω̇ = u_τ + f_τ + ξ_τ`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nominal {
    /// m (kg).
    pub mass_kg: f64,
    /// Diagonal of I, body axes (kg·m²).
    pub inertia_kg_m2: Vector3<f64>,
    /// g, inertial (m/s²); zero for a vehicle that is nominally neutrally buoyant.
    pub gravity_m_s2: Vector3<f64>,
}

/// The force and torque that the nominal plant omits: with them its equations hold exactly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unknown {
    /// f and f_τ: everything present without the disturbance.
    pub matched: Wrench,
    /// ξ and ξ_τ: what the disturbance adds.
    pub unmatched: Wrench,
}

impl Nominal {
    /// Splits the truth into nominal plant, f and ξ:
    ///
    /// `f = m a(0) − u − m g ,  ξ = m (a(ξ₀) − a(0)) ;   f_τ = I α(0) − u_τ ,  ξ_τ = I (α(ξ₀) − α(0))`
    ///
    /// with a(·), α(·) the true accelerations at this state and command, with the disturbance ξ₀ and with
    /// none. With the masses m and m_true and a force ξ₀ this gives `f = (m/m_true − 1) u + (m/m_true) f_true`
    /// and `ξ = (m/m_true) ξ₀`.
    pub fn unknown<Plant: TruePlant + ?Sized>(
        &self,
        plant: &Plant,
        state: &State,
        command: &Wrench,
        disturbance: &Vector3<f64>,
    ) -> Unknown {
        let calm = plant.acceleration(state, command, &Vector3::zeros());
        let disturbed = plant.acceleration(state, command, disturbance);
        let inertia = Matrix3::from_diagonal(&self.inertia_kg_m2);
        Unknown {
            matched: Wrench {
                force_n: (calm.linear_m_s2 - self.gravity_m_s2) * self.mass_kg - command.force_n,
                torque_n_m: inertia * calm.angular_rad_s2 - command.torque_n_m,
            },
            unmatched: Wrench {
                force_n: (disturbed.linear_m_s2 - calm.linear_m_s2) * self.mass_kg,
                torque_n_m: inertia * (disturbed.angular_rad_s2 - calm.angular_rad_s2),
            },
        }
    }
}

/// Half the vector of the skew part of `R_rᵀR`: the attitude error of geometric tracking control.
///
/// `e_R = ½ (R_rᵀR − RᵀR_r)^∨`, body axes; for a small rotation about an axis, that rotation vector (rad).
///
/// # Source
/// Lee, Leok, McClamroch (2010), Geometric tracking control of a quadrotor UAV on SE(3), eq. (10)
pub(crate) fn attitude_error(reference: &Rotation3<f64>, rotation: &Rotation3<f64>) -> Vector3<f64> {
    let twice_skew =
        reference.matrix().tr_mul(rotation.matrix()) - rotation.matrix().tr_mul(reference.matrix());
    Vector3::new(twice_skew[(2, 1)], twice_skew[(0, 2)], twice_skew[(1, 0)]) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `v̇ = −Ω² r` and `I ω̇ = −ω × I ω`, both with known solutions or invariants.
    struct OscillatingTop {
        angular_frequency_rad_s: f64,
        inertia_kg_m2: Vector3<f64>,
    }

    impl TruePlant for OscillatingTop {
        fn acceleration(&self, state: &State, command: &Wrench, _: &Vector3<f64>) -> Acceleration {
            let omega = state.angular_velocity_rad_s;
            let momentum = self.inertia_kg_m2.component_mul(&omega);
            Acceleration {
                linear_m_s2: -self.angular_frequency_rad_s.powi(2) * state.position_m,
                angular_rad_s2: (command.torque_n_m - omega.cross(&momentum))
                    .component_div(&self.inertia_kg_m2),
            }
        }
    }

    fn top(inertia_kg_m2: [f64; 3]) -> OscillatingTop {
        OscillatingTop { angular_frequency_rad_s: 3.0, inertia_kg_m2: inertia_kg_m2.into() }
    }

    fn flown(plant: &OscillatingTop, state: &State, duration_s: f64, n_substeps: usize) -> State {
        integrate_in(plant, state, &Wrench::zero(), &Vector3::zeros(), duration_s, n_substeps)
    }

    #[test]
    fn halving_the_step_divides_the_error_by_sixteen() {
        // Closed forms: the oscillator, and a symmetric top, whose ω precesses about the body's axis with
        // n = (I₃ − I₁)/I₁ ω₃ and whose attitude is exp(t L/I₁) exp(−t n e₃) q₀, L the angular momentum.
        let plant = top([1.0, 1.0, 1.6]);
        let omega0 = Vector3::new(0.9, 0.0, 2.0);
        let start = State {
            position_m: Vector3::new(1.0, 0.0, -2.0),
            velocity_m_s: Vector3::new(0.0, 3.0, 0.0),
            angular_velocity_rad_s: omega0,
            ..State::at_rest()
        };
        let duration_s = 2.0;
        let precession = (1.6 - 1.0) / 1.0 * omega0.z;
        let momentum = Vector3::new(omega0.x, omega0.y, 1.6 * omega0.z);
        let exact_attitude = UnitQuaternion::new(momentum * duration_s)
            * UnitQuaternion::new(Vector3::z() * (-precession * duration_s));
        let exact_position = Vector3::new((6.0f64).cos(), (6.0f64).sin(), -2.0 * (6.0f64).cos());
        let errors = |n_substeps| {
            let end = flown(&plant, &start, duration_s, n_substeps);
            (
                (end.position_m - exact_position).norm(),
                end.rotation().angle_to(&exact_attitude),
                (end.angular_velocity_rad_s.xy().norm() - omega0.xy().norm()).abs(),
            )
        };
        let (coarse, fine) = (errors(80), errors(160));
        // The next term of the error is a few per cent of the leading one at these steps.
        for (coarse, fine) in [(coarse.0, fine.0), (coarse.1, fine.1)] {
            let order = (coarse / fine).log2();
            assert!((order - 4.0).abs() < 0.25, "order {order}, errors {coarse:e} and {fine:e}");
        }
        assert!(fine.2 < 1e-7, "the precession's amplitude changed by {:e}", fine.2);
    }

    #[test]
    fn a_torque_free_rotation_keeps_its_energy_and_momentum() {
        // Unequal inertias and a start near the middle axis: the body tumbles.
        let plant = top([1.0, 2.0, 3.0]);
        let start = State { angular_velocity_rad_s: Vector3::new(0.01, 2.0, 0.01), ..State::at_rest() };
        let inertia = plant.inertia_kg_m2;
        let energy =
            |s: &State| 0.5 * s.angular_velocity_rad_s.dot(&inertia.component_mul(&s.angular_velocity_rad_s));
        let momentum = |s: &State| s.rotation() * inertia.component_mul(&s.angular_velocity_rad_s);
        let mut state = start;
        let mut tumbled = false;
        for _ in 0..20 {
            state = integrate(&plant, &state, &Wrench::zero(), &Vector3::zeros(), 1.0);
            tumbled |= state.angular_velocity_rad_s.y < -1.9;
            // 20 000 steps, each with a local error of about (ω h)⁵/120 ≈ 3e-16 beside rounding.
            assert!((energy(&state) - energy(&start)).abs() < 1e-10);
            assert!((momentum(&state) - momentum(&start)).norm() < 1e-10);
            assert!((state.attitude.norm() - 1.0).abs() < 1e-15);
        }
        assert!(tumbled, "the start was to be an unstable one");
    }

    #[test]
    fn a_step_of_five_milliseconds_is_five_substeps_whatever_its_last_bit() {
        let plant = top([1.0, 2.0, 3.0]);
        let start = State { position_m: Vector3::x(), ..State::at_rest() };
        let zero = Vector3::zeros();
        for duration_s in [0.005, 0.3 - 0.295, 0.005f64.next_up()] {
            let end = integrate(&plant, &start, &Wrench::zero(), &zero, duration_s);
            assert_eq!(end, flown(&plant, &start, duration_s, 5));
        }
        assert_eq!(
            integrate(&plant, &start, &Wrench::zero(), &zero, 0.0051),
            flown(&plant, &start, 0.0051, 6)
        );
    }

    /// `v̇ = cos(a t)` and `v̇ = v ξ(t)` with ξ = cos(a t): v = sin(a t)/a and v = exp(sin(a t)/a).
    #[test]
    fn a_disturbance_that_moves_is_felt_at_its_own_instants() {
        struct Pushed;
        impl TruePlant for Pushed {
            fn acceleration(&self, state: &State, _: &Wrench, disturbance: &Vector3<f64>) -> Acceleration {
                let linear_m_s2 = Vector3::new(disturbance.x, disturbance.y * state.velocity_m_s.y, 0.0);
                Acceleration { linear_m_s2, angular_rad_s2: Vector3::zeros() }
            }
        }
        let (a, start_s, duration_s) = (40.0_f64, 0.3_f64, 0.025);
        let exact = |t: f64| Vector3::new((a * t).sin() / a, ((a * t).sin() / a).exp(), 0.0);
        let start = State { velocity_m_s: exact(start_s), ..State::at_rest() };
        let disturbance = |s: f64| Vector3::repeat((a * (start_s + s)).cos());
        let end = integrate_under(&Pushed, &start, &Wrench::zero(), disturbance, duration_s);
        // The global error of steps of 1 ms: about (a h)⁴/2880 ≈ 1e-9 of v's change, 0.03.
        let error = (end.velocity_m_s - exact(start_s + duration_s)).norm();
        assert!(error < 1e-10, "{error:e}");

        let held = Vector3::new(0.3, -0.2, 0.0);
        assert_eq!(
            integrate_under(&Pushed, &start, &Wrench::zero(), |_| held, duration_s),
            integrate(&Pushed, &start, &Wrench::zero(), &held, duration_s)
        );
    }

    #[test]
    fn the_attitude_error_of_a_small_rotation_is_its_vector() {
        let small = Vector3::new(1e-4, -2e-4, 3e-4);
        let reference = Rotation3::from_euler_angles(0.3, -0.4, 2.0);
        let error = attitude_error(&reference, &(reference * Rotation3::new(small)));
        // sin of the angle instead of the angle: a third of the angle squared, relatively.
        assert!((error - small).norm() < 1e-10);
    }
}
