//! The service's configuration: TOML in, checked design out.
//!
//! Keys carry their units; an unknown key is an error. Every message says where (file and line), what was
//! found, and what would be accepted.

use crate::estimator::Estimator;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use observer::{
    Centers, ChannelDesign, DeadZone, DeadZoneShape, DesignError, DisturbanceBounds, GyroscopicTorque,
    InitialState, InnovationGate, Kernel, LengthScale, LinearDesign, LinearObserver, LocalSolver,
    OutlierAction, Parameter, RigidBodyObserver, RotationDesign, Solver, TranslationDesign,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

mod keys;
mod linear;
mod real_time;
pub mod reference;
mod schema;
mod words;

use keys::key_of;
pub use linear::{LinearConfig, SquareMatrix};
pub use real_time::RealTimeConfig;

/// An output is held for this many of its sample periods; then its channel coasts.
const HOLD_PERIODS: f64 = 1.5;

/// What the local solver's set-up takes for each center at its peak, measured with a million of them.
const BYTES_PER_CENTER: u64 = 80;

/// The built-in configurations: name, text.
pub const PRESETS: [(&str, &str); 7] = [
    ("rigid-body", include_str!("../../presets/rigid-body.toml")),
    ("paper-translation", include_str!("../../presets/paper-translation.toml")),
    ("paper-rotation", include_str!("../../presets/paper-rotation.toml")),
    ("acsl-x8", include_str!("../../presets/acsl-x8.toml")),
    ("auv", include_str!("../../presets/auv.toml")),
    ("linear", include_str!("../../presets/linear.toml")),
    ("million-centers", include_str!("../../presets/million-centers.toml")),
];

/// Why a configuration was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{place}: {what}")]
pub struct ConfigError {
    /// File and line.
    pub place: String,
    /// What was found, what is needed, what to do.
    pub what: String,
}

/// When the service steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Trigger {
    /// At every tick of `rate_hz`.
    #[default]
    Timer,
    /// As soon as a sample arrives, polling one core; at `rate_hz` while none does.
    Sample,
}

/// What time it is for the estimate.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// CLOCK_MONOTONIC: the estimate is propagated from the newest sample to the tick.
    #[default]
    Monotonic,
    /// The stamp of the newest sample: for replay at another speed than that of the flight.
    Samples,
}

/// Which source wins where several publish.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SourcePolicy {
    /// The one in use, until it has been silent for `takeover_after_s`.
    #[default]
    First,
    /// The one that appeared last.
    Newest,
}

/// The whole configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("anyOf" = [
    { "required": ["translation"] },
    { "required": ["rotation"] },
    { "required": ["linear"] },
]))]
pub struct Config {
    /// Ticks per second; each publishes one estimate.
    ///
    /// Not below the rate of the fastest sensor; more costs processor time, not accuracy, and shortens what a
    /// controller waits. Also as --rate-hz.
    #[schemars(range(min = 1.0, max = 10000.0), example = 200.0)]
    pub rate_hz: f64,
    /// When to step: "timer" at rate_hz, or "sample" as soon as one arrives (polls one core).
    ///
    /// Change it where microseconds between sample and estimate matter and a core is free for them.
    #[serde(default)]
    pub trigger: Trigger,
    /// Time of the estimate: "monotonic" (now), or "samples" (stamp of the newest sample; replay at another
    /// speed).
    ///
    /// "monotonic" for everything that flies.
    #[serde(default)]
    pub clock: Clock,
    /// The last microseconds of every wait are spent polling the clock: less lateness for more of a core.
    ///
    /// 200 takes most of the wake-up lateness away for 4 % of a core at 200 Hz; `bench jitter` measures both.
    /// 0 never polls, and at most it is the period of rate_hz.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub spin_us: f64,
    /// Without a sample for this long, the estimate's status says stale.
    ///
    /// As long as your controller may fly on a prediction. It is the status alone that changes: channels
    /// coast much earlier.
    #[serde(default = "defaults::stale_after_s")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub stale_after_s: f64,
    /// The state before the first sample; what is missing is taken from the first measurement of it.
    #[serde(default, skip_serializing_if = "InitialConfig::is_empty")]
    pub initial: InitialConfig,
    /// Which samples are believed, and from which source.
    #[serde(default)]
    pub input: InputConfig,
    /// What happens when ticks end after their next deadline, so many in a row; 0 is never.
    #[serde(default)]
    pub deadline: DeadlineConfig,
    /// What is written down, so that nothing learned is lost.
    #[serde(default)]
    pub snapshot: SnapshotConfig,
    /// What the loop asks of the system, with `priority = 1 … 98` and `cores = [2]` too; what is refused is said,
    /// and done without (daemon doctor).
    #[serde(default)]
    pub real_time: RealTimeConfig,
    /// Position, velocity and unknown force from measured velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub translation: Option<TranslationConfig>,
    /// Attitude, angular velocity and unknown torque from measured angular velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<RotationConfig>,
    /// A general linear plant x' = A x + B (u + f(y)), y = C x, in units of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub linear: Option<LinearConfig>,
}

impl Config {
    /// d of translation (m/s), rotation (rad/s), linear plant (its output's unit); 0 where there is no such channel.
    pub fn dead_zone_width(&self) -> [f64; 3] {
        let translation = self.translation.as_ref().map(|translation| translation.dead_zone_width_m_s);
        let rotation = self.rotation.as_ref().map(|rotation| rotation.dead_zone_width_rad_s);
        let linear = self.linear.as_ref().map(|linear| linear.dead_zone_width);
        [translation, rotation, linear].map(Option::unwrap_or_default)
    }
}

/// The state before the first sample; what is missing is taken from the first measurement of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitialConfig {
    /// Position, inertial.
    ///
    /// Set it where there are no position fixes; otherwise the dead-reckoned position starts from the origin.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [0.0, 0.0, -10.0])]
    pub position_m: Option<[f64; 3]>,
    /// Velocity, inertial.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [0.0, 0.0, 0.0])]
    pub velocity_m_s: Option<[f64; 3]>,
    /// Attitude, unit quaternion, body to inertial.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [1.0, 0.0, 0.0, 0.0])]
    pub attitude_wxyz: Option<[f64; 4]>,
    /// Angular velocity, body axes.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [0.0, 0.0, 0.1])]
    pub angular_velocity_rad_s: Option<[f64; 3]>,
}

impl InitialConfig {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// Which samples are believed, and which source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InputConfig {
    /// A faster measured velocity is rejected; a faster estimate is reset.
    ///
    /// Above what your vehicle can reach, wind included, but well below what a broken sensor says.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_speed_m_s: f64,
    /// A faster measured rotation is rejected; a faster estimate is reset.
    ///
    /// Above what your vehicle can reach, below the range of the gyroscope.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_angular_rate_rad_s: f64,
    /// A position further from the origin is rejected; such an estimate is reset.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_position_m: f64,
    /// A larger commanded force is rejected.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_force_n: f64,
    /// A larger commanded torque is rejected.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_torque_n_m: f64,
    /// A larger learned force is not believed: the translation is reset to its last good copy.
    ///
    /// A few times the largest disturbance that you expect, its weight say: it is what stops a diverging
    /// learner.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_unknown_force_n: f64,
    /// A larger learned torque is not believed: the rotation is reset to its last good copy.
    ///
    /// A few times the largest torque that you expect.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_unknown_torque_n_m: f64,
    /// An output of the linear plant with a larger entry is rejected.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_output: f64,
    /// A commanded input of the linear plant with a larger entry is rejected; a learned one is reset.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_input: f64,
    /// A state of the linear plant with a larger entry is reset to its last good copy.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_state: f64,
    /// A stamp further ahead of the clock is rejected.
    ///
    /// Stamps are CLOCK_MONOTONIC of this machine: raise it only for sources whose clock is another one.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_future_s: f64,
    /// A stamp further behind the clock is rejected.
    ///
    /// More than the largest delay of your slowest sensor; replay with clock = "samples" does not look at it.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub max_age_s: f64,
    /// Where several publish: "first" keeps the one in use, "newest" takes the one that appeared last.
    ///
    /// "newest" where a source is replaced on purpose while the old one still runs.
    pub source: SourcePolicy,
    /// A source silent for this long may be replaced by another one.
    ///
    /// Some periods of the source: shorter than the outage that your vehicle stands, longer than its jitter.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub takeover_after_s: f64,
    /// An output whose error stands out: "off" believes it, "adaptation" does not learn from it, "correction"
    /// does not use it. What lasts longer than 10 holds is believed.
    ///
    /// "off" is the paper's observer. With "correction" a spike does not reach the estimate, and a real jump
    /// does a few samples later.
    #[schemars(with = "words::OutlierAction")]
    pub outliers: OutlierAction,
    /// It stands out if its error is this many times the dead zone's width plus the running scale of the
    /// errors.
    ///
    /// Lower finds smaller spikes and doubts more honest outputs.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub outlier_factor: f64,
    /// A sensor that repeats one value to the bit is named, and its outputs: "off" are used, "adaptation" not
    /// learned from, "correction" not used.
    ///
    /// "off" for sensors that are quantised so coarsely, or simulated so cleanly, that they repeat themselves
    /// in truth.
    #[schemars(with = "words::OutlierAction")]
    pub stuck: OutlierAction,
    /// Repetitions of one value after which a sensor is stuck; 0 is never.
    pub stuck_after_samples: u64,
}

/// What happens when ticks end after their next deadline, so many in a row; 0 is never.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DeadlineConfig {
    /// So many late ticks in a row, and the estimate's status says late; 0 is never.
    pub warn_after_ticks: u64,
    /// So many late ticks in a row, and samples are not used any more, which costs less, until a tick is in
    /// time again; 0 is never.
    ///
    /// A service that is late because its machine is overloaded gets back in time so.
    pub predict_only_after_ticks: u64,
    /// So many late ticks in a row, and the estimate's status says invalid: not to be used; 0 is never.
    pub invalid_after_ticks: u64,
}

impl Default for DeadlineConfig {
    fn default() -> Self {
        Self { warn_after_ticks: 1, predict_only_after_ticks: 10, invalid_after_ticks: 50 }
    }
}

/// What is written down, so that nothing learned is lost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SnapshotConfig {
    /// Time between two snapshots; 0 writes one on command and at the end only.
    ///
    /// What is lost at most when the machine loses power. The disk is written by a thread of its own.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub save_every_s: f64,
    /// After a restart the state in a snapshot is gone on from where it is not older than this; what was
    /// learned always is.
    ///
    /// As long as your vehicle stays near where it was while the service is away.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub resume_state_within_s: f64,
}

impl Default for SnapshotConfig {
    fn default() -> Self {
        Self { save_every_s: 5.0, resume_state_within_s: 10.0 }
    }
}

impl Default for InputConfig {
    fn default() -> Self {
        Self {
            max_speed_m_s: 100.0,
            max_angular_rate_rad_s: 50.0,
            max_position_m: 1e6,
            max_force_n: 1e5,
            max_torque_n_m: 1e5,
            max_unknown_force_n: 1e5,
            max_unknown_torque_n_m: 1e5,
            max_output: 1e9,
            max_input: 1e9,
            max_state: 1e9,
            max_future_s: 0.05,
            max_age_s: 0.5,
            source: SourcePolicy::First,
            takeover_after_s: 0.2,
            outliers: OutlierAction::Correction,
            outlier_factor: 8.0,
            stuck: OutlierAction::Adaptation,
            stuck_after_samples: 50,
        }
    }
}

/// A symmetric matrix: a multiple of the identity, a diagonal, or all nine numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected a number, three numbers (a diagonal), or three rows of three numbers"
)]
pub enum SymmetricMatrix {
    /// A multiple of the identity.
    Scalar(f64),
    /// A diagonal.
    Diagonal([f64; 3]),
    /// Row after row.
    Full([[f64; 3]; 3]),
}

impl SymmetricMatrix {
    fn matrix(&self) -> Matrix3<f64> {
        match self {
            Self::Scalar(a) => Matrix3::identity() * *a,
            Self::Diagonal(diagonal) => Matrix3::from_diagonal(&Vector3::from(*diagonal)),
            Self::Full(rows) => Matrix3::from_fn(|i, j| rows[i][j]),
        }
    }
}

/// The kernel κ by name: `sobolev-matern-K` with the order K, `gaussian`, `wendland-c2`, `wendland-c4`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(extend("pattern" = "^(sobolev-matern-[0-9]+|gaussian|wendland-c2|wendland-c4)$"))]
pub enum KernelName {
    /// Sobolev–Matérn of order k.
    SobolevMatern(usize),
    /// Gaussian.
    Gaussian,
    /// Wendland's C².
    WendlandC2,
    /// Wendland's C⁴.
    WendlandC4,
}

impl Default for KernelName {
    fn default() -> Self {
        Self::SobolevMatern(3)
    }
}

impl TryFrom<String> for KernelName {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let order = name.strip_prefix("sobolev-matern-").and_then(|order| order.parse().ok());
        match (name.as_str(), order) {
            (_, Some(order)) => Ok(Self::SobolevMatern(order)),
            ("gaussian", _) => Ok(Self::Gaussian),
            ("wendland-c2", _) => Ok(Self::WendlandC2),
            ("wendland-c4", _) => Ok(Self::WendlandC4),
            _ => Err(format!(
                "unknown kernel \"{name}\", expected \"sobolev-matern-K\" with its order K, \"gaussian\", \"wendland-c2\" or \"wendland-c4\""
            )),
        }
    }
}

impl From<KernelName> for String {
    fn from(name: KernelName) -> Self {
        match name {
            KernelName::SobolevMatern(order) => format!("sobolev-matern-{order}"),
            KernelName::Gaussian => "gaussian".into(),
            KernelName::WendlandC2 => "wendland-c2".into(),
            KernelName::WendlandC4 => "wendland-c4".into(),
        }
    }
}

impl KernelName {
    fn kernel(self, dimension: usize) -> Kernel {
        match self {
            Self::SobolevMatern(order) => Kernel::SobolevMatern { dimension, order },
            Self::Gaussian => Kernel::Gaussian,
            Self::WendlandC2 => Kernel::WendlandC2,
            Self::WendlandC4 => Kernel::WendlandC4,
        }
    }
}

/// How the learned function is computed: by name, or with options.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected \"auto\", \"dense\", \"local\", or a table { kind = \"local\", block = 6, accuracy = 1e-3, truncation = 1e-6 }"
)]
pub enum SolverConfig {
    /// By name.
    Name(SolverName),
    /// With options.
    Options(SolverOptions),
}

/// The solver by name.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SolverName {
    /// By the number of centers.
    #[default]
    Auto,
    /// All centers at every step: exact.
    Dense,
    /// The neighbourhood of the output, with an error estimate.
    Local,
}

/// Options of the local solver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SolverOptions {
    /// "auto", "dense" or "local".
    #[serde(default)]
    pub kind: SolverName,
    /// Local: centers along each axis of the lattice block that is evaluated, an even number 4 … 12; default:
    /// as accuracy needs.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 4, max = 12), extend("multipleOf" = 2), example = 6)]
    pub block: Option<usize>,
    /// Local: the error that the block is chosen for, RMS relative to the learned function, for random
    /// updates.
    #[serde(default = "defaults::local_accuracy")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub accuracy: f64,
    /// Local: an update ends where the kernel falls below this multiple of its largest value; 0 never cuts
    /// (Wendland kernels end by themselves).
    #[serde(default)]
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1.0))]
    pub truncation: f64,
}

impl Default for SolverConfig {
    fn default() -> Self {
        Self::Name(SolverName::Auto)
    }
}

impl SolverConfig {
    fn solver(&self) -> Solver {
        let (name, options) = match *self {
            Self::Name(name) => (name, LocalSolver::default()),
            Self::Options(SolverOptions { kind, block, accuracy, truncation }) => {
                (kind, LocalSolver { block, accuracy, truncation })
            }
        };
        match name {
            SolverName::Auto => Solver::Auto(options),
            SolverName::Dense => Solver::Dense,
            SolverName::Local => Solver::Local(options),
        }
    }
}

/// A length scale: one number, or one per axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number, or one number per axis")]
pub enum LengthScaleConfig {
    /// The same along all axes.
    Isotropic(f64),
    /// One per axis.
    PerAxis(Vec<f64>),
}

impl LengthScaleConfig {
    fn length_scale(&self) -> LengthScale {
        match self {
            Self::Isotropic(scale) => LengthScale::Isotropic(*scale),
            Self::PerAxis(scales) => LengthScale::PerAxis(scales.clone()),
        }
    }
}

/// The shape of the dead zone σ.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DeadZoneName {
    /// 0, then a smooth rise to 1 over the buffer.
    #[default]
    Saturated,
    /// 0, then a parabola over the buffer, then a straight line without bound.
    Quadratic,
    /// 0 inside of the width, 1 outside; the buffer is not used.
    Step,
}

/// Who accounts for −ω × Iω.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GyroscopicTorqueName {
    /// It is learned with the rest of the unknown torque.
    #[default]
    Learned,
    /// It is computed from the estimate and the nominal inertia.
    Feedforward,
}

/// The translation channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("oneOf" = [
    { "required": ["centers_lower_m_s", "centers_upper_m_s", "centers_per_axis"] },
    { "required": ["centers_listed_m_s"] },
]))]
pub struct TranslationConfig {
    /// Nominal mass; under water with the added mass.
    ///
    /// What it gets wrong is learned as a force.
    #[schemars(extend("exclusiveMinimum" = 0.0), example = 2.0)]
    pub mass_kg: f64,
    /// Gravity along the inertial axes where the commanded force carries the weight; [0, 0, 9.81] with axes
    /// north-east-down.
    ///
    /// Zero where the commanded force is net of weight, and for a vehicle that floats.
    #[serde(default)]
    pub gravity_m_s2: [f64; 3],
    /// Another known constant force along the inertial axes, buoyancy say.
    #[serde(default)]
    pub known_force_n: [f64; 3],
    /// Velocity measurements per second (default rate_hz); each is held for 1.5 periods, then the channel
    /// coasts.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.01, max = 10000.0), example = 10.0)]
    pub sample_rate_hz: Option<f64>,
    /// Observer gain λ: how fast the velocity estimate follows the measurement.
    ///
    /// Higher trusts the sensor more, and lets more of its noise through; a few times below the sample rate.
    #[schemars(extend("exclusiveMinimum" = 0.0), example = 10.0)]
    pub gain_per_s: f64,
    /// Adaptation rate Γ_f, symmetric positive definite: a number, three numbers (diagonal) or 3 × 3.
    ///
    /// Higher learns faster and noisier. A rate that makes the sampled law unstable is refused with the
    /// largest stable one.
    #[schemars(example = 100.0)]
    pub adaptation_rate_kg_s2: SymmetricMatrix,
    /// Kernel κ: "sobolev-matern-K" with its order K (the higher, the smoother what is learned), "gaussian",
    /// "wendland-c2" or "wendland-c4".
    #[serde(default)]
    pub kernel: KernelName,
    /// Length scale ℓ of the kernel: speeds this far apart share what is learned. One number, or one per
    /// axis.
    ///
    /// Once to twice the distance between centers, with Wendland kernels some times it; smaller resolves
    /// finer detail and learns it more slowly.
    #[schemars(example = 3.0)]
    pub length_scale_m_s: LengthScaleConfig,
    /// Lower corner of the lattice of kernel centers, in velocity.
    ///
    /// The box must hold the velocities that are flown: outside of it the learned function fades, and the
    /// estimate says outside the centers. Needs the upper corner and the number per axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [-4.0, -4.0, -2.0])]
    pub centers_lower_m_s: Option<[f64; 3]>,
    /// Upper corner of the lattice of kernel centers, in velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [4.0, 4.0, 2.0])]
    pub centers_upper_m_s: Option<[f64; 3]>,
    /// Centers along each axis of the lattice.
    ///
    /// Spacing of about half a length scale to one; the memory and the time per step grow with the product.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [5, 5, 3])]
    pub centers_per_axis: Option<[usize; 3]>,
    /// Centers one by one, instead of a lattice.
    ///
    /// For a flight envelope that is no box. No two may be equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])]
    pub centers_listed_m_s: Option<Vec<[f64; 3]>>,
    /// Added to the Gram matrix's diagonal as a multiple of κ(0); 0 is the paper's law.
    ///
    /// 1e-8 or so where the Gram matrix is refused as not positive definite: centers that lie too close for
    /// the length scale.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub nugget: f64,
    /// How the learned function is computed: "dense" from all centers, exact; "local" from those around the
    /// output, with an error estimate in every estimate; "auto" by the number of centers. Or a table of
    /// options.
    ///
    /// "auto" takes "dense" up to some 2000 centers; `daemon check` says which one you get, its error and its
    /// memory.
    #[serde(default)]
    pub solver: SolverConfig,
    /// Shape of the dead zone σ: "saturated", "quadratic" (the paper's, corrected) or "step" (Theorem 1;
    /// ignores the buffer).
    #[serde(default)]
    pub dead_zone: DeadZoneName,
    /// Dead zone d: output errors up to this are taken for noise.
    ///
    /// Just above what the error is when nothing is to be learned: narrower learns noise, wider stops
    /// learning early.
    #[schemars(range(min = 0.0), example = 0.02)]
    pub dead_zone_width_m_s: f64,
    /// Buffer ε over which the dead zone opens.
    ///
    /// About the width.
    #[schemars(extend("exclusiveMinimum" = 0.0), example = 0.02)]
    pub dead_zone_buffer_m_s: f64,
    /// Bound δ̄ on the norm of the velocity measurement's error.
    ///
    /// It widens the error bounds that `daemon check` and every estimate tell, not the estimate.
    #[schemars(range(min = 0.0), example = 0.06)]
    pub noise_bound_m_s: f64,
    /// Bound ξ̄ on the force that is no function of the velocity (gusts); it widens the guarantees, not the
    /// estimate.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub unmatched_force_bound_n: f64,
    /// Bound r_f on the native norm of what the centers cannot represent of the unknown force; it widens the
    /// guarantees.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub residual_norm_bound_n: f64,
    /// Gain L_r of the velocity error into the position; 0 is dead reckoning.
    ///
    /// Dimensionless. Position is not observable from velocity: it changes where errors go, not that they
    /// grow.
    #[serde(default)]
    pub velocity_error_to_position: f64,
    /// Gain L_p of position fixes; 0 uses only the first one.
    ///
    /// About one over the time in which a fix shall pull the position to itself.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub position_fix_gain_per_s: f64,
    /// How long a position fix keeps correcting.
    ///
    /// Between one and two periods of the fixes.
    #[serde(default = "defaults::fix_hold_s")]
    #[schemars(range(min = 0.0))]
    pub position_fix_hold_s: f64,
}

/// The rotation channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("oneOf" = [
    { "required": ["centers_lower_rad_s", "centers_upper_rad_s", "centers_per_axis"] },
    { "required": ["centers_listed_rad_s"] },
]))]
pub struct RotationConfig {
    /// Nominal inertia, symmetric positive definite: a number, three numbers (diagonal) or 3 × 3.
    ///
    /// In body axes. What it gets wrong is learned as a torque.
    #[schemars(example = [0.02, 0.02, 0.035])]
    pub inertia_kg_m2: SymmetricMatrix,
    /// −ω × Iω: "learned" with the rest (the paper), or "feedforward" from the estimate.
    ///
    /// "feedforward" for bodies that spin fast and whose inertia is known well.
    #[serde(default)]
    pub gyroscopic_torque: GyroscopicTorqueName,
    /// Angular-velocity measurements per second (default rate_hz); each is held for 1.5 periods, then the
    /// channel coasts.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.01, max = 10000.0), example = 100.0)]
    pub sample_rate_hz: Option<f64>,
    /// Observer gain λ: how fast the angular-velocity estimate follows the measurement.
    ///
    /// Higher trusts the sensor more, and lets more of its noise through; a few times below the sample rate.
    #[schemars(extend("exclusiveMinimum" = 0.0), example = 40.0)]
    pub gain_per_s: f64,
    /// Adaptation rate Γ_f, symmetric positive definite: a number, three numbers (diagonal) or 3 × 3.
    ///
    /// Higher learns faster and noisier. A rate that makes the sampled law unstable is refused with the
    /// largest stable one.
    #[schemars(example = 1.0)]
    pub adaptation_rate_n_m: SymmetricMatrix,
    /// Kernel κ: "sobolev-matern-K" with its order K (the higher, the smoother what is learned), "gaussian",
    /// "wendland-c2" or "wendland-c4".
    #[serde(default)]
    pub kernel: KernelName,
    /// Length scale ℓ of the kernel: rates this far apart share what is learned. One number, or one per axis.
    ///
    /// Once to twice the distance between centers, with Wendland kernels some times it; smaller resolves
    /// finer detail and learns it more slowly.
    #[schemars(example = 2.0)]
    pub length_scale_rad_s: LengthScaleConfig,
    /// Lower corner of the lattice of kernel centers, in angular velocity.
    ///
    /// The box must hold the angular velocities that are flown: outside of it the learned function fades, and
    /// the estimate says outside the centers. Needs the upper corner and the number per axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [-2.0, -2.0, -1.0])]
    pub centers_lower_rad_s: Option<[f64; 3]>,
    /// Upper corner of the lattice of kernel centers, in angular velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [2.0, 2.0, 1.0])]
    pub centers_upper_rad_s: Option<[f64; 3]>,
    /// Centers along each axis of the lattice.
    ///
    /// Spacing of about half a length scale to one; the memory and the time per step grow with the product.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [3, 3, 3])]
    pub centers_per_axis: Option<[usize; 3]>,
    /// Centers one by one, instead of a lattice.
    ///
    /// For a flight envelope that is no box. No two may be equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])]
    pub centers_listed_rad_s: Option<Vec<[f64; 3]>>,
    /// Added to the Gram matrix's diagonal as a multiple of κ(0); 0 is the paper's law.
    ///
    /// 1e-8 or so where the Gram matrix is refused as not positive definite: centers that lie too close for
    /// the length scale.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub nugget: f64,
    /// How the learned function is computed: "dense" from all centers, exact; "local" from those around the
    /// output, with an error estimate in every estimate; "auto" by the number of centers. Or a table of
    /// options.
    ///
    /// "auto" takes "dense" up to some 2000 centers; `daemon check` says which one you get, its error and its
    /// memory.
    #[serde(default)]
    pub solver: SolverConfig,
    /// Shape of the dead zone σ: "saturated", "quadratic" (the paper's, corrected) or "step" (Theorem 1;
    /// ignores the buffer).
    #[serde(default)]
    pub dead_zone: DeadZoneName,
    /// Dead zone d: output errors up to this are taken for noise.
    ///
    /// Just above what the error is when nothing is to be learned: narrower learns noise, wider stops
    /// learning early.
    #[schemars(range(min = 0.0), example = 0.01)]
    pub dead_zone_width_rad_s: f64,
    /// Buffer ε over which the dead zone opens.
    ///
    /// About the width.
    #[schemars(extend("exclusiveMinimum" = 0.0), example = 0.01)]
    pub dead_zone_buffer_rad_s: f64,
    /// Bound δ̄ on the norm of the angular-velocity measurement's error.
    ///
    /// It widens the error bounds that `daemon check` and every estimate tell, not the estimate.
    #[schemars(range(min = 0.0), example = 0.015)]
    pub noise_bound_rad_s: f64,
    /// Bound ξ̄ on the torque that is no function of the angular velocity; it widens the guarantees, not the
    /// estimate.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub unmatched_torque_bound_n_m: f64,
    /// Bound r_f on the native norm of what the centers cannot represent of the unknown torque; it widens the
    /// guarantees.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub residual_norm_bound_n_m: f64,
    /// Gain L_q of attitude fixes; 0 uses only the first one.
    ///
    /// About one over the time in which a fix shall pull the attitude to itself.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub attitude_fix_gain_per_s: f64,
    /// How long an attitude fix keeps correcting.
    ///
    /// Between one and two periods of the fixes.
    #[serde(default = "defaults::fix_hold_s")]
    #[schemars(range(min = 0.0))]
    pub attitude_fix_hold_s: f64,
}

mod defaults {
    pub(super) fn stale_after_s() -> f64 {
        0.5
    }
    pub(super) fn local_accuracy() -> f64 {
        observer::LocalSolver::default().accuracy
    }
    pub(super) fn fix_hold_s() -> f64 {
        0.25
    }
}

/// A configuration with the text it came from, so that messages can name the line.
#[derive(Debug, Clone, PartialEq)]
pub struct ConfigFile {
    /// The values.
    pub config: Config,
    source: Source,
}

#[derive(Debug, Clone, PartialEq)]
struct Source {
    name: String,
    text: String,
}

impl ConfigFile {
    /// A built-in configuration.
    ///
    /// # Errors
    /// An unknown name, with the known ones.
    pub fn preset(name: &str) -> Result<Self, ConfigError> {
        match PRESETS.iter().find(|(known, _)| *known == name) {
            Some((_, text)) => Self::parse(format!("preset {name}"), (*text).into()),
            None => Err(ConfigError {
                place: "--preset".into(),
                what: format!(
                    "'{name}' is unknown; needed: one of {}",
                    PRESETS.map(|(known, _)| known).join(", ")
                ),
            }),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The file cannot be read; as [`ConfigFile::parse`].
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let place = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(place, text),
            Err(error) => {
                let what = format!("cannot be read: {error}; print one to start from: daemon config > FILE");
                Err(ConfigError { place, what })
            }
        }
    }

    /// Reads a text; `name` stands for it in messages.
    ///
    /// # Errors
    /// No TOML, an unknown or missing key, a value of the wrong type: with its line.
    pub fn parse(name: String, text: String) -> Result<Self, ConfigError> {
        let source = Source { name, text };
        match toml::from_str(&source.text) {
            Ok(config) => Ok(Self { config, source }),
            Err(error) => Err(ConfigError {
                place: source.place(error.span().map(|span| span.start)),
                what: with_suggestion(error.message()),
            }),
        }
    }

    /// Checks every value and builds what the service runs.
    ///
    /// # Errors
    /// The key, its line, what was found and what would be accepted.
    pub fn estimator(&self) -> Result<Estimator, ConfigError> {
        self.check_service()?;
        let config = &self.config;
        let linear = self.linear_design()?.map(|design| LinearObserver::new(&design)).transpose();
        let linear = linear.map_err(|error| self.refuse("linear", &error))?;
        let rigid_body = match (&linear, &config.translation, &config.rotation) {
            (Some(_), None, None) => None,
            _ => Some(self.observer()?),
        };
        let mut estimator = Estimator { rigid_body, linear };
        let InputConfig { outliers, outlier_factor: factor, .. } = config.input;
        estimator.set_innovation_gate(InnovationGate { outliers, factor });
        Ok(estimator)
    }

    /// Checks every value and builds the observer of the rigid body.
    ///
    /// # Errors
    /// As [`ConfigFile::estimator`].
    pub fn observer(&self) -> Result<RigidBodyObserver, ConfigError> {
        self.check_service()?;
        let initial = self.initial_state()?;
        let (translation, rotation) = (self.translation_design()?, self.rotation_design()?);
        // One channel at a time, so that an error can name its table.
        let wrong = match (&translation, &rotation) {
            (Some(design), _) => RigidBodyObserver::new(Some(design.clone()), None, initial).err(),
            _ => None,
        };
        if let Some(error) = wrong {
            return Err(self.refuse("translation", &error));
        }
        RigidBodyObserver::new(translation, rotation, initial).map_err(|error| match error.parameter {
            Parameter::Channels => ConfigError {
                place: self.source.name.clone(),
                what:
                    "neither [translation] nor [rotation] nor [linear]; needed: at least one of these tables"
                        .into(),
            },
            _ => self.refuse("rotation", &error),
        })
    }

    /// The design of the translation, if there is one. Its stability is not checked here.
    ///
    /// # Errors
    /// As [`ConfigFile::estimator`].
    pub fn translation_design(&self) -> Result<Option<TranslationDesign>, ConfigError> {
        let design = self.config.translation.as_ref().map(|t| t.design(self.config.rate_hz)).transpose();
        design.map_err(|error| self.refuse("translation", &error))
    }

    /// The design of the rotation, if there is one. Its stability is not checked here.
    ///
    /// # Errors
    /// As [`ConfigFile::estimator`].
    pub fn rotation_design(&self) -> Result<Option<RotationDesign>, ConfigError> {
        let design = self.config.rotation.as_ref().map(|r| r.design(self.config.rate_hz)).transpose();
        design.map_err(|error| self.refuse("rotation", &error))
    }

    /// The design of the linear plant, if there is one. Its stability is not checked here.
    ///
    /// # Errors
    /// As [`ConfigFile::estimator`].
    pub fn linear_design(&self) -> Result<Option<LinearDesign>, ConfigError> {
        let design = self.config.linear.as_ref().map(|l| l.design(self.config.rate_hz)).transpose();
        design.map_err(|error| self.refuse("linear", &error))
    }

    /// What the configuration is called in messages: its file, or its preset.
    pub fn name(&self) -> &str {
        &self.source.name
    }

    /// Replaces the rate, as `--rate-hz` does.
    pub fn set_rate_hz(&mut self, rate_hz: f64) {
        self.config.rate_hz = rate_hz;
    }

    /// Checks what belongs to no channel.
    pub(crate) fn check_service(&self) -> Result<(), ConfigError> {
        let config = &self.config;
        let input = &config.input;
        let positive = [
            ("stale_after_s", config.stale_after_s),
            ("input.max_speed_m_s", input.max_speed_m_s),
            ("input.max_angular_rate_rad_s", input.max_angular_rate_rad_s),
            ("input.max_position_m", input.max_position_m),
            ("input.max_force_n", input.max_force_n),
            ("input.max_torque_n_m", input.max_torque_n_m),
            ("input.max_unknown_force_n", input.max_unknown_force_n),
            ("input.max_unknown_torque_n_m", input.max_unknown_torque_n_m),
            ("input.max_output", input.max_output),
            ("input.max_input", input.max_input),
            ("input.max_state", input.max_state),
            ("input.max_future_s", input.max_future_s),
            ("input.max_age_s", input.max_age_s),
            ("input.takeover_after_s", input.takeover_after_s),
            ("input.outlier_factor", input.outlier_factor),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(self.wrong(key, &value.to_string(), "a finite number > 0"));
            }
        }
        let durations = [
            ("snapshot.save_every_s", config.snapshot.save_every_s),
            ("snapshot.resume_state_within_s", config.snapshot.resume_state_within_s),
        ];
        for (key, value) in durations {
            if !(0.0..=1e9).contains(&value) {
                return Err(self.wrong(key, &value.to_string(), "0 … 1e9 (in s)"));
            }
        }
        if !(1.0..=10_000.0).contains(&config.rate_hz) {
            return Err(self.wrong("rate_hz", &config.rate_hz.to_string(), "1 … 10000 (in Hz)"));
        }
        if !(0.0..=1e6 / config.rate_hz).contains(&config.spin_us) {
            let needed = format!("0 … {:.0}, the period of rate_hz (in µs)", 1e6 / config.rate_hz);
            return Err(self.wrong("spin_us", &config.spin_us.to_string(), &needed));
        }
        let sample_rates = [
            ("translation.sample_rate_hz", config.translation.as_ref().and_then(|t| t.sample_rate_hz)),
            ("rotation.sample_rate_hz", config.rotation.as_ref().and_then(|r| r.sample_rate_hz)),
            ("linear.sample_rate_hz", config.linear.as_ref().and_then(|l| l.sample_rate_hz)),
        ];
        for (key, rate) in sample_rates {
            if let Some(rate) = rate.filter(|rate| !(0.01..=10_000.0).contains(rate)) {
                return Err(self.wrong(key, &rate.to_string(), "0.01 … 10000 (in Hz)"));
            }
        }
        self.check_real_time()?;
        self.check_memory(free_memory_bytes())
    }

    /// A lattice that does not fit into memory would end the process without a word.
    fn check_memory(&self, free_bytes: Option<u64>) -> Result<(), ConfigError> {
        let (translation, rotation) = (self.config.translation.as_ref(), self.config.rotation.as_ref());
        let lattices = [
            (
                "translation.centers_per_axis",
                translation.and_then(|t| t.centers_per_axis.as_ref()).map(|n| &n[..]),
            ),
            ("rotation.centers_per_axis", rotation.and_then(|r| r.centers_per_axis.as_ref()).map(|n| &n[..])),
            (
                "linear.centers_per_axis",
                self.config.linear.as_ref().and_then(|l| l.centers_per_axis.as_deref()),
            ),
        ];
        let Some(free_bytes) = free_bytes else { return Ok(()) };
        for (key, per_axis) in lattices {
            let n_centers = per_axis
                .unwrap_or_default()
                .iter()
                .fold(1, |product: u64, &n| product.saturating_mul(n as u64));
            let most = free_bytes / BYTES_PER_CENTER;
            if n_centers > most {
                let found = format!("{n_centers} centers");
                let needed =
                    format!("at most {most}: {:.1} GB of memory are free here", free_bytes as f64 * 1e-9);
                return Err(self.wrong(key, &found, &needed));
            }
        }
        Ok(())
    }

    fn initial_state(&self) -> Result<InitialState, ConfigError> {
        let initial = &self.config.initial;
        let limits = &self.config.input;
        let vector = |key: &str, value: Option<[f64; 3]>, limit: f64| match value.map(Vector3::from) {
            // NaN is within no limit.
            Some(v) if v.norm() > limit || !v.norm().is_finite() => {
                let needed = format!("finite numbers of norm {limit} at most, the limit in [input]");
                Err(self.wrong(&format!("initial.{key}"), &format!("{:?}", v.as_slice()), &needed))
            }
            value => Ok(value),
        };
        let attitude = match initial.attitude_wxyz {
            None => None,
            Some([w, x, y, z]) => {
                let q = Quaternion::new(w, x, y, z);
                if !(0.999..=1.001).contains(&q.norm()) {
                    let found = format!("norm {}", q.norm());
                    return Err(self.wrong("initial.attitude_wxyz", &found, "a unit quaternion w, x, y, z"));
                }
                Some(UnitQuaternion::from_quaternion(q))
            }
        };
        Ok(InitialState {
            position_m: vector("position_m", initial.position_m, limits.max_position_m)?,
            velocity_m_s: vector("velocity_m_s", initial.velocity_m_s, limits.max_speed_m_s)?,
            attitude,
            angular_velocity_rad_s: vector(
                "angular_velocity_rad_s",
                initial.angular_velocity_rad_s,
                limits.max_angular_rate_rad_s,
            )?,
        })
    }

    pub(crate) fn refuse(&self, table: &str, error: &DesignError) -> ConfigError {
        let key = format!("{table}.{}", key_of(table, error.parameter));
        self.wrong(&key, &error.found, &error.needed)
    }

    fn wrong(&self, key: &str, found: &str, needed: &str) -> ConfigError {
        ConfigError {
            place: self.source.place(self.source.offset_of(key)),
            what: format!("{key}: found {found}; needed: {needed}"),
        }
    }

    /// The effective configuration, defaults included, as TOML with a comment on every key.
    pub fn commented_toml(&self) -> String {
        let text = toml::to_string(&self.config).expect("a configuration is a TOML document");
        let schema = schema::schema();
        let comment = |key: &str| match schema::find(&schema, key).and_then(schema::meaning) {
            Some(meaning) => format!("# {meaning}\n"),
            None => String::new(),
        };
        let mut commented = format!("# Effective configuration of {}.\n", self.source.name);
        let mut table = String::new();
        for line in text.lines() {
            if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
                table = format!("{name}.");
                commented += &comment(name);
            } else if let Some((key, _)) = line.split_once(" = ") {
                commented += &comment(&format!("{table}{key}"));
            }
            commented += line;
            commented.push('\n');
        }
        commented
    }
}

/// What the system could still give; `None` where it does not say.
fn free_memory_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

impl Source {
    fn place(&self, offset: Option<usize>) -> String {
        match offset {
            Some(offset) => {
                let line = self.text[..offset.min(self.text.len())].matches('\n').count() + 1;
                format!("{}, line {line}", self.name)
            }
            None => self.name.clone(),
        }
    }

    /// Where `table.key` stands; where it does not, its table.
    fn offset_of(&self, key: &str) -> Option<usize> {
        let document = toml::de::DeTable::parse(&self.text).ok()?;
        let (table, name) = key.split_once('.').map_or((key, None), |(table, name)| (table, Some(name)));
        let (at, value) = document.get_ref().get_key_value(table)?;
        let inside = name.and_then(|name| value.get_ref().as_table()?.get_key_value(name));
        Some(inside.map_or(at, |(at, _)| at).span().start)
    }
}

/// Adds the most similar accepted key to a message about an unknown one.
fn with_suggestion(message: &str) -> String {
    let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    match names.split_first() {
        Some((unknown, accepted)) if message.starts_with("unknown field") => {
            let similar = accepted
                .iter()
                .max_by(|a, b| strsim::jaro_winkler(unknown, a).total_cmp(&strsim::jaro_winkler(unknown, b)));
            let similar = similar.filter(|name| strsim::jaro_winkler(unknown, name) > 0.8);
            let hint = similar.map(|name| format!("; did you mean `{name}`? (a name ends in its unit)"));
            message.to_owned() + &hint.unwrap_or_default()
        }
        Some((missing, _)) if message.starts_with("missing field") => {
            let schema = schema::schema();
            let tables = ["", "translation.", "rotation.", "linear."];
            let note = tables.iter().find_map(|table| schema::find(&schema, &format!("{table}{missing}")));
            message.to_owned()
                + &note.and_then(schema::meaning).map(|text| format!(": {text}")).unwrap_or_default()
        }
        _ => message.into(),
    }
}

/// A lattice or a list, whichever is given.
struct CentersKeys<Point, Counts> {
    lower: Option<Point>,
    upper: Option<Point>,
    per_axis: Option<Counts>,
    listed: Option<Vec<Point>>,
}

impl<Point: AsRef<[f64]>, Counts: AsRef<[usize]>> CentersKeys<Point, Counts> {
    fn centers(&self) -> Result<Centers, DesignError> {
        match (&self.lower, &self.upper, &self.per_axis, &self.listed) {
            (Some(lower), Some(upper), Some(per_axis), None) => Centers::lattice(lower, upper, per_axis),
            (None, None, None, Some(listed)) => Centers::listed(listed),
            (lower, upper, per_axis, listed) => {
                let given = [lower.is_some(), upper.is_some(), per_axis.is_some(), listed.is_some()];
                let words = ["a lower corner", "an upper corner", "a number per axis", "a list"];
                let found: Vec<_> =
                    words.iter().zip(given).filter(|(_, given)| *given).map(|(word, _)| *word).collect();
                Err(DesignError {
                    parameter: Parameter::Centers,
                    found: if found.is_empty() { "none".into() } else { found.join(" and ") },
                    needed:
                        "either centers_lower_…, centers_upper_… and centers_per_axis, or centers_listed_…"
                            .into(),
                })
            }
        }
    }
}

fn dead_zone(name: DeadZoneName, width: f64, buffer: f64) -> Result<DeadZone, DesignError> {
    let shape = match name {
        DeadZoneName::Saturated => DeadZoneShape::Saturated,
        DeadZoneName::Quadratic => DeadZoneShape::Quadratic,
        DeadZoneName::Step => DeadZoneShape::Step,
    };
    DeadZone::new(shape, width, buffer)
}

impl TranslationConfig {
    fn design(&self, rate_hz: f64) -> Result<TranslationDesign, DesignError> {
        let centers = CentersKeys {
            lower: self.centers_lower_m_s,
            upper: self.centers_upper_m_s,
            per_axis: self.centers_per_axis,
            listed: self.centers_listed_m_s.clone(),
        };
        let force = self.mass_kg * Vector3::from(self.gravity_m_s2) + Vector3::from(self.known_force_n);
        if force.iter().any(|f| !f.is_finite()) {
            let found = format!("{:?} N with gravity", force.as_slice());
            return Err(DesignError {
                parameter: Parameter::Inertia,
                found,
                needed: "finite numbers".into(),
            });
        }
        Ok(TranslationDesign {
            channel: ChannelDesign {
                kernel: self.kernel.kernel(3),
                length_scale: self.length_scale_m_s.length_scale(),
                centers: centers.centers()?,
                nugget: self.nugget,
                solver: self.solver.solver(),
                inertia: Matrix3::identity() * self.mass_kg,
                gain_per_s: self.gain_per_s,
                adaptation_rate: self.adaptation_rate_kg_s2.matrix(),
                dead_zone: dead_zone(self.dead_zone, self.dead_zone_width_m_s, self.dead_zone_buffer_m_s)?,
                bounds: DisturbanceBounds {
                    noise: self.noise_bound_m_s,
                    unmatched: self.unmatched_force_bound_n,
                    residual_norm: self.residual_norm_bound_n,
                },
                hold_s: HOLD_PERIODS / self.sample_rate_hz.unwrap_or(rate_hz),
                coast_step_s: rate_hz.recip(),
            },
            known_force_n: force,
            velocity_error_to_position: self.velocity_error_to_position,
            position_fix_gain_per_s: self.position_fix_gain_per_s,
            position_fix_hold_s: self.position_fix_hold_s,
        })
    }
}

impl RotationConfig {
    fn design(&self, rate_hz: f64) -> Result<RotationDesign, DesignError> {
        let centers = CentersKeys {
            lower: self.centers_lower_rad_s,
            upper: self.centers_upper_rad_s,
            per_axis: self.centers_per_axis,
            listed: self.centers_listed_rad_s.clone(),
        };
        Ok(RotationDesign {
            channel: ChannelDesign {
                kernel: self.kernel.kernel(3),
                length_scale: self.length_scale_rad_s.length_scale(),
                centers: centers.centers()?,
                nugget: self.nugget,
                solver: self.solver.solver(),
                inertia: self.inertia_kg_m2.matrix(),
                gain_per_s: self.gain_per_s,
                adaptation_rate: self.adaptation_rate_n_m.matrix(),
                dead_zone: dead_zone(
                    self.dead_zone,
                    self.dead_zone_width_rad_s,
                    self.dead_zone_buffer_rad_s,
                )?,
                bounds: DisturbanceBounds {
                    noise: self.noise_bound_rad_s,
                    unmatched: self.unmatched_torque_bound_n_m,
                    residual_norm: self.residual_norm_bound_n_m,
                },
                hold_s: HOLD_PERIODS / self.sample_rate_hz.unwrap_or(rate_hz),
                coast_step_s: rate_hz.recip(),
            },
            gyroscopic_torque: match self.gyroscopic_torque {
                GyroscopicTorqueName::Learned => GyroscopicTorque::Learned,
                GyroscopicTorqueName::Feedforward => GyroscopicTorque::Feedforward,
            },
            attitude_fix_gain_per_s: self.attitude_fix_gain_per_s,
            attitude_fix_hold_s: self.attitude_fix_hold_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_that_does_not_fit_into_memory_is_refused_by_its_key() {
        let file = ConfigFile::preset("million-centers").unwrap();
        assert!(free_memory_bytes().unwrap() > 1_000_000);
        assert_eq!(file.check_memory(Some(80_000_000)), Ok(()));
        assert_eq!(file.check_memory(None), Ok(()));
        let message = file.check_memory(Some(79_999_999)).unwrap_err().to_string();
        let expected = "translation.centers_per_axis: found 1000000 centers; needed: at most 999999: 0.1 GB of memory are free here";
        assert!(message.contains(expected), "{message}");
    }
}
