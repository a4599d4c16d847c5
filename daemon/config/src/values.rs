//! Types of values that are not single numbers: matrices, kernels, solvers, length scales, words.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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

/// A square matrix of the plant's own size: a multiple of the identity, a diagonal, or all of its rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number, one number per output (a diagonal), or rows of numbers")]
pub enum SquareMatrix {
    /// A multiple of the identity.
    Scalar(f64),
    /// A diagonal.
    Diagonal(Vec<f64>),
    /// Row after row.
    Full(Vec<Vec<f64>>),
}

/// How a channel estimates its state and the unknown force.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LawName {
    /// One Kalman filter over the state and the unknown force as an element of the native space, with deviations.
    #[default]
    Joint,
    /// The paper's adaptive observer, with its theorems and up to a million centers; it has no deviations.
    Gradient,
}

impl LawName {
    /// The word in a file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Joint => "joint",
            Self::Gradient => "gradient",
        }
    }
}

/// A number for all three axes, or one for each.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number, or three numbers")]
pub enum AxisValues {
    /// The same for all.
    All(f64),
    /// One for each.
    Each([f64; 3]),
}

impl From<AxisValues> for [f64; 3] {
    fn from(values: AxisValues) -> Self {
        match values {
            AxisValues::All(value) => [value; 3],
            AxisValues::Each(values) => values,
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
    #[serde(default = "local_accuracy")]
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

fn local_accuracy() -> f64 {
    0.005
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

/// Where the gradient law takes the features of what it learns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FeaturesAtName {
    /// At the measured output, as in the paper: noise alone makes the learned function grow with time.
    #[default]
    Measured,
    /// At the estimate, which does not carry the output's noise.
    Estimated,
}

/// Axes along which the joint law learns the unknown force.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ForceAxesName {
    /// Inertial ones: wind and current are constant along them, and so is an error of the attitude that does not turn with the vehicle.
    #[default]
    Inertial,
    /// The body's: a drag or an added mass that differs along the vehicle's axes, a wing. They need the attitude.
    Body,
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

/// What happens to an output that is not accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OutlierAction {
    /// It is accepted, as in the paper.
    Off,
    /// It corrects the state, but nothing is learned from it.
    Adaptation,
    /// It is not used at all: the channel holds the output before, then coasts.
    Correction,
}
