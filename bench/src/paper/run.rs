//! The run: samples at `t_j = j/rate`, taken and held until `t_{j+1}`.
//!
//! Each step reads as the law:
//!
//! ```text
//! y_j = v(t_j) + δ(t_j),  u_j from the true state              held over the step h = t_{j+1} − t_j
//! ỹ = y_j − v̂_j,  θ_{j+1} = θ_j + h σ(‖ỹ‖) φ(y_j) (Γ_f ỹ)ᵀ
//! f̂ = θ_{j+1}ᵀ φ(y_j)                                          or θ_jᵀ φ(y_j): predict first
//! v̂' = λ (y_j − v̂) + M⁻¹ (u_j + f̂)                             exactly, and so is its integral r̂
//! q̂_{j+1} = q̂_j ⊗ exp(½ h ω̄),  ω̄ = (ω̂_j + ω̂_{j+1})/2           rotation
//! ```
//!
//! The truth is integrated by Runge–Kutta steps of at most 1 ms, under the held u_j and f at every stage.

use super::rows::{Motion, Row};
use super::settings::{Example, FeltAt, Initial, Scheme, Settings, UsageError};
use anyhow::ensure;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use observer::{
    BodyChannel, BodyState, Centers, ChannelDesign, DeadZone, DisturbanceBounds, GradientOptions, Kernel,
    Learning, LengthScale, Moment, Segment, Solver,
};
use sim_publisher::plant::{State, Wrench, integrate, integrate_under};
use sim_publisher::scenario::Definition;
use std::f64::consts::PI;

/// A run: its rows, and counts that they do not show.
#[derive(Debug, Clone)]
pub struct Run {
    /// One for each sample.
    pub rows: Vec<Row>,
    /// Steps in which σ was held down to keep the sampled law stable.
    pub n_clamped: usize,
}

/// Runs the example.
///
/// # Errors
/// [`UsageError`] for settings of which no observer can be made; an estimate that does not stay finite.
pub fn run(settings: &Settings) -> anyhow::Result<Run> {
    let &Settings { example, rate_hz, .. } = settings;
    let Definition { vehicle, nominal, .. } = example.scenario().definition();
    let noise = example.measurement_error();
    let mut channel = channel(settings)?;

    let mut state = vehicle.initial_state();
    let mut pose_estimate = Pose::of(example, &state);
    channel.set_rate(match settings.initial {
        Initial::Reference => example.rate(&state),
        Initial::ZeroVelocity => Vector3::zeros(),
    });
    let mut run = Run { rows: Vec::with_capacity(settings.n_samples()), n_clamped: 0 };
    for j in 0..settings.n_samples() {
        let t_s = j as f64 / rate_hz;
        let h_s = (j + 1) as f64 / rate_hz - t_s;
        let command = vehicle.command(t_s, &state);
        let output = example.rate(&state) + noise(t_s);

        let rate_estimate = channel.state().rate;
        channel.observe(&output, true);
        let learning = channel.law().learning(h_s);
        let matched_force = match settings.scheme {
            Scheme::UpdateFirst => channel.law().matched_force(&learning),
            Scheme::PredictFirst => channel.law().matched_force(&Learning::none()),
        }
        .value;
        run.n_clamped += usize::from(learning.clamped);

        let calm = Vector3::zeros();
        run.rows.push(Row {
            t_s,
            truth: Motion { pose: Pose::of(example, &state).coordinates(), rate: example.rate(&state) },
            estimate: Motion { pose: pose_estimate.coordinates(), rate: rate_estimate },
            force: example.force(&nominal.unknown(vehicle, &state, &command, &calm).matched),
            force_estimate: matched_force,
            output,
            output_error: channel.law().held().output_error.norm(),
            activation: learning.activation,
            power_function: channel.law().power_function(),
        });

        let force = example.force(&command) + matched_force;
        let segment = channel.plant().integrator().follow(&rate_estimate, &output, &force, h_s);
        pose_estimate = pose_estimate.after(&segment);
        channel.commit(&learning, Moment { stamp_ns: 0, state: BodyState { rate: segment.end, pose: () } });
        ensure!(
            segment.end.iter().chain(&matched_force).all(|value| value.is_finite()),
            "the estimate is not finite after {} s: this scheme is unstable with these settings; lower \
             --adaptation-rate, raise --rate-hz, or use --scheme update-first",
            t_s + h_s
        );
        state = match settings.felt_at {
            FeltAt::True => integrate(vehicle, &state, &command, &calm, h_s),
            FeltAt::Measured => integrate_under(vehicle, &state, &command, |s| noise(t_s + s), h_s),
        };
    }
    Ok(run)
}

/// The paper's observer: 3 × 3 × 3 centers on [−1, 1]³ m/s, or on [−0.1, 0.1]³ rad/s.
fn channel(settings: &Settings) -> Result<BodyChannel, UsageError> {
    let nominal = settings.example.scenario().nominal();
    let (reach, inertia) = match settings.example {
        Example::Translation => (1.0, Matrix3::identity() * nominal.mass_kg),
        Example::Rotation => (0.1, Matrix3::from_diagonal(&nominal.inertia_kg_m2)),
    };
    let design = ChannelDesign {
        kernel: Kernel::SobolevMatern { dimension: 3, order: settings.kernel_order },
        length_scale: LengthScale::Isotropic(settings.length_scale),
        centers: Centers::lattice([-reach; 3], [reach; 3], [3; 3])?,
        nugget: 0.0,
        solver: Solver::Dense,
        inertia,
        gain_per_s: settings.gain_per_s,
        adaptation_rate: Matrix3::identity() * settings.adaptation_rate,
        dead_zone: DeadZone::new(settings.dead_zone.into(), settings.width, settings.buffer)?,
        options: GradientOptions::default(),
        bounds: DisturbanceBounds::default(),
        hold_s: settings.rate_hz.recip(),
        // There is no coasting here: every sample arrives.
        coast_step_s: settings.rate_hz.recip(),
    };
    Ok(BodyChannel::new(&design)?)
}

impl Example {
    /// v or ω: what is measured.
    fn rate(self, state: &State) -> Vector3<f64> {
        match self {
            Self::Translation => state.velocity_m_s,
            Self::Rotation => state.angular_velocity_rad_s,
        }
    }

    fn force(self, wrench: &Wrench) -> Vector3<f64> {
        match self {
            Self::Translation => wrench.force_n,
            Self::Rotation => wrench.torque_n_m,
        }
    }

    /// δ(t), the same on each axis (m/s; rad/s); its argument is in s.
    fn measurement_error(self) -> impl Fn(f64) -> Vector3<f64> {
        let sensors = self.scenario().definition().sensors;
        let sensor = match self {
            Self::Translation => sensors.velocity,
            Self::Rotation => sensors.angular_velocity,
        };
        move |t_s| Vector3::repeat(sensor.fixed_error.map_or(0.0, |error| error(t_s)))
    }
}

/// The pose that is integrated from the rate.
#[derive(Clone, Copy)]
enum Pose {
    /// Inertial (m).
    Position(Vector3<f64>),
    /// Body to inertial.
    Attitude(UnitQuaternion<f64>),
}

impl Pose {
    fn of(example: Example, state: &State) -> Self {
        match example {
            Example::Translation => Self::Position(state.position_m),
            Example::Rotation => Self::Attitude(state.rotation()),
        }
    }

    /// The pose at the end of a step.
    fn after(self, segment: &Segment) -> Self {
        match self {
            Self::Position(position) => Self::Position(position + segment.integral),
            Self::Attitude(attitude) => {
                // `UnitQuaternion::new` takes the whole rotation vector, twice the exponent.
                let turn = UnitQuaternion::new(0.5 * segment.h_s * (segment.start + segment.end));
                let mut attitude = attitude * turn;
                attitude.renormalize();
                Self::Attitude(attitude)
            }
        }
    }

    /// Position (m), or 3-2-1 Euler angles in (−π, π] (rad).
    fn coordinates(&self) -> Vector3<f64> {
        match self {
            Self::Position(position) => *position,
            Self::Attitude(attitude) => {
                let (roll, pitch, yaw) = attitude.euler_angles();
                Vector3::new(roll, pitch, yaw).map(|angle| if angle == -PI { PI } else { angle })
            }
        }
    }
}
