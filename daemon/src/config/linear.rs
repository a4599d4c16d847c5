//! `[linear]`: a plant of the user's own A, B and C, in units of its own.

use super::{
    CentersKeys, DeadZoneName, HOLD_PERIODS, KernelName, LengthScaleConfig, SolverConfig, dead_zone,
};
use nalgebra::{DMatrix, DVector};
use observer::{DesignError, DisturbanceBounds, LinearDesign, Parameter};
use serde::{Deserialize, Serialize};

/// `x' = A x + B (u + f(y)) + ξ`, `y = C x + δ`, with `output` and `input` of the measurement for y and u.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinearConfig {
    /// A, n rows of n numbers.
    pub a: Vec<Vec<f64>>,
    /// B, n rows of m numbers.
    pub b: Vec<Vec<f64>>,
    /// C, m rows of n numbers.
    pub c: Vec<Vec<f64>>,
    /// L, n rows of m numbers.
    pub gain: Vec<Vec<f64>>,
    /// Names of the states, for reports.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_names: Option<Vec<String>>,
    /// x̂(0).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_state: Option<Vec<f64>>,
    /// Outputs per second; default: `rate_hz`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample_rate_hz: Option<f64>,
    /// Γ_f.
    pub adaptation_rate: SquareMatrix,
    /// κ.
    #[serde(default)]
    pub kernel: KernelName,
    /// ℓ.
    pub length_scale: LengthScaleConfig,
    /// Lower corner of the lattice of centers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centers_lower: Option<Vec<f64>>,
    /// Upper corner of the lattice of centers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centers_upper: Option<Vec<f64>>,
    /// Centers along each axis of the lattice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centers_per_axis: Option<Vec<usize>>,
    /// Centers one by one, instead of a lattice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centers_listed: Option<Vec<Vec<f64>>>,
    /// Added to the Gram matrix's diagonal, as a multiple of κ(0).
    #[serde(default)]
    pub nugget: f64,
    /// How the learned function is computed.
    #[serde(default)]
    pub solver: SolverConfig,
    /// Shape of σ.
    #[serde(default)]
    pub dead_zone: DeadZoneName,
    /// d.
    pub dead_zone_width: f64,
    /// ε.
    pub dead_zone_buffer: f64,
    /// δ̄.
    pub noise_bound: f64,
    /// ξ̄.
    #[serde(default)]
    pub unmatched_bound: f64,
    /// r_f.
    #[serde(default)]
    pub residual_norm_bound: f64,
}

/// A square matrix of the plant's own size: a multiple of the identity, a diagonal, or all of its rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
