//! `[linear]`: a plant of the user's own A, B and C, in units of its own.

use super::{
    CentersKeys, DeadZoneName, HOLD_PERIODS, KernelName, LengthScaleConfig, SolverConfig, dead_zone,
};
use nalgebra::{DMatrix, DVector};
use observer::{DesignError, DisturbanceBounds, LinearDesign, Parameter};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `x' = A x + B (u + f(y)) + ξ`, `y = C x + δ`, with `output` and `input` of the measurement for y and u.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("oneOf" = [
    { "required": ["centers_lower", "centers_upper", "centers_per_axis"] },
    { "required": ["centers_listed"] },
]))]
pub struct LinearConfig {
    /// A, row after row.
    ///
    /// 1/s in the units of its states: n rows of n numbers, n at most 12.
    #[schemars(example = [[0.0, 1.0], [-3.0, -0.2]])]
    pub a: Vec<Vec<f64>>,
    /// B, row after row.
    ///
    /// n rows of m numbers.
    #[schemars(example = [[0.0], [0.5]])]
    pub b: Vec<Vec<f64>>,
    /// C, row after row: as many outputs as inputs.
    ///
    /// m rows of n numbers; y = C x is `output` of the measurement.
    #[schemars(example = [[2.0, 1.0]])]
    pub c: Vec<Vec<f64>>,
    /// Observer gain L, row after row; A − LC must be Hurwitz on what is observable.
    ///
    /// n rows of m numbers. `daemon check` tells the poles of A − LC and whether they suffice for the
    /// guarantees.
    #[schemars(example = [[1.0], [8.0]])]
    pub gain: Vec<Vec<f64>>,
    /// Names of the states, for reports.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = ["position", "velocity"])]
    pub state_names: Option<Vec<String>>,
    /// The state before the first sample; default: the least one with the first output.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [0.5, 0.0])]
    pub initial_state: Option<Vec<f64>>,
    /// Outputs per second (default rate_hz); each is held for 1.5 periods, then the channel coasts.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.01, max = 10000.0), example = 100.0)]
    pub sample_rate_hz: Option<f64>,
    /// Adaptation rate Γ_f, symmetric positive definite: a number, one per output (diagonal), or m × m.
    ///
    /// Higher learns faster and noisier. A rate that makes the sampled law unstable is refused with the
    /// largest stable one.
    #[schemars(example = 50.0)]
    pub adaptation_rate: SquareMatrix,
    /// Kernel κ: "sobolev-matern-K" with its order K (the higher, the smoother what is learned), "gaussian",
    /// "wendland-c2" or "wendland-c4".
    #[serde(default)]
    pub kernel: KernelName,
    /// Length scale ℓ of the kernel: outputs this far apart share what is learned. One number, or one per
    /// axis.
    ///
    /// Once to twice the distance between centers, with Wendland kernels some times it; smaller resolves
    /// finer detail and learns it more slowly.
    #[schemars(example = 1.0)]
    pub length_scale: LengthScaleConfig,
    /// Lower corner of the lattice of kernel centers, in the output.
    ///
    /// The box must hold the outputs: outside of it the learned function fades, and the estimate says outside
    /// the centers.
    /// Needs the upper corner and the number per axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [-3.0])]
    pub centers_lower: Option<Vec<f64>>,
    /// Upper corner of the lattice of kernel centers, in the output.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [3.0])]
    pub centers_upper: Option<Vec<f64>>,
    /// Centers along each axis of the lattice.
    ///
    /// Spacing of about half a length scale to one; the memory and the time per step grow with the product.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [13])]
    pub centers_per_axis: Option<Vec<usize>>,
    /// Centers one by one, instead of a lattice.
    ///
    /// For a flight envelope that is no box. No two may be equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = [[-1.0], [0.0], [1.0]])]
    pub centers_listed: Option<Vec<Vec<f64>>>,
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
    pub dead_zone_width: f64,
    /// Buffer ε over which the dead zone opens.
    ///
    /// About the width.
    #[schemars(extend("exclusiveMinimum" = 0.0), example = 0.02)]
    pub dead_zone_buffer: f64,
    /// Bound δ̄ on the norm of the output's measurement error.
    ///
    /// It widens the error bounds that `daemon check` and every estimate tell, not the estimate.
    #[schemars(range(min = 0.0), example = 0.01)]
    pub noise_bound: f64,
    /// Bound ξ̄ on what else acts on x' and is no function of the output; it widens the guarantees, not the
    /// estimate.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub unmatched_bound: f64,
    /// Bound r_f on the native norm of what the centers cannot represent of the unknown input; it widens the
    /// guarantees.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub residual_norm_bound: f64,
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

impl LinearConfig {
    /// The design of this table for a service of `rate_hz`.
    pub(super) fn design(&self, rate_hz: f64) -> Result<LinearDesign, DesignError> {
        let n_outputs = self.c.len();
        let centers = CentersKeys {
            lower: self.centers_lower.clone(),
            upper: self.centers_upper.clone(),
            per_axis: self.centers_per_axis.clone(),
            listed: self.centers_listed.clone(),
        };
        if let Some(names) = self.state_names.as_ref().filter(|names| names.len() != self.a.len()) {
            return Err(DesignError {
                parameter: Parameter::Plant,
                found: format!("{} state_names for {} states", names.len(), self.a.len()),
                needed: "one name per row of a".into(),
            });
        }
        Ok(LinearDesign {
            a: matrix(Parameter::Plant, "a", &self.a)?,
            b: matrix(Parameter::PlantInput, "b", &self.b)?,
            c: matrix(Parameter::PlantOutput, "c", &self.c)?,
            gain: matrix(Parameter::Gain, "gain", &self.gain)?,
            kernel: self.kernel.kernel(n_outputs),
            length_scale: self.length_scale.length_scale(),
            centers: centers.centers()?,
            nugget: self.nugget,
            solver: self.solver.solver(),
            adaptation_rate: match &self.adaptation_rate {
                SquareMatrix::Scalar(rate) => DMatrix::identity(n_outputs, n_outputs) * *rate,
                SquareMatrix::Diagonal(rates) => DMatrix::from_diagonal(&DVector::from_column_slice(rates)),
                SquareMatrix::Full(rows) => matrix(Parameter::AdaptationRate, "adaptation_rate", rows)?,
            },
            dead_zone: dead_zone(self.dead_zone, self.dead_zone_width, self.dead_zone_buffer)?,
            bounds: DisturbanceBounds {
                noise: self.noise_bound,
                unmatched: self.unmatched_bound,
                residual_norm: self.residual_norm_bound,
            },
            hold_s: HOLD_PERIODS / self.sample_rate_hz.unwrap_or(rate_hz),
            coast_step_s: rate_hz.recip(),
            initial_state: self.initial_state.clone().map(DVector::from_vec),
        })
    }
}

fn matrix(parameter: Parameter, key: &str, rows: &[Vec<f64>]) -> Result<DMatrix<f64>, DesignError> {
    let n_columns = rows.first().map_or(0, Vec::len);
    match rows.iter().find(|row| row.len() != n_columns || row.is_empty()) {
        None if n_columns > 0 => {
            Ok(DMatrix::from_row_iterator(rows.len(), n_columns, rows.iter().flatten().copied()))
        }
        _ => Err(DesignError {
            parameter,
            found: format!("{key} with rows of {:?} numbers", rows.iter().map(Vec::len).collect::<Vec<_>>()),
            needed: "rows of the same length, [[…], […]]".into(),
        }),
    }
}
