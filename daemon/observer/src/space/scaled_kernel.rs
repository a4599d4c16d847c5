//! The kernel 𝔎: a radial kernel with length scales.

use crate::error::{DesignError, Parameter};
use crate::space::centers::weighted_distance;
use crate::space::kernel::{Kernel, RadialFunction};

/// ℓ: the distance over which a center affects f̂, in the output's unit.
#[derive(Debug, Clone, PartialEq)]
pub enum LengthScale {
    /// One for all axes.
    Isotropic(f64),
    /// One for each axis.
    PerAxis(Vec<f64>),
}

impl LengthScale {
    fn inverses(&self, dimension: usize) -> Result<Vec<f64>, DesignError> {
        let scales = match self {
            Self::Isotropic(scale) => vec![*scale; dimension],
            Self::PerAxis(scales) => scales.clone(),
        };
        let positive = scales.iter().all(|scale| scale.is_finite() && *scale > 0.0);
        if scales.len() != dimension || !positive {
            let needed = format!("a finite number > 0, or one for each of the {dimension} axes");
            return Err(DesignError::new(Parameter::LengthScale, format!("{scales:?}"), needed));
        }
        Ok(scales.iter().map(|scale| scale.recip()).collect())
    }

    /// The same shape, `factor` times as long.
    pub fn scaled(&self, factor: f64) -> Self {
        match self {
            Self::Isotropic(scale) => Self::Isotropic(scale * factor),
            Self::PerAxis(scales) => Self::PerAxis(scales.iter().map(|scale| scale * factor).collect()),
        }
    }
}

/// 𝔎: a radial kernel with its length scales, `𝔎(y, ξ) = κ(√Σ_i ((y_i − ξ_i)/ℓ_i)²)`.
///
/// # Source
/// Niu et al., §II (Mercer kernel); the length scales are ours, the paper has ℓ = 1.
#[derive(Debug, Clone, PartialEq)]
pub struct ScaledKernel {
    radial: RadialFunction,
    inverse_length_scales: Vec<f64>,
}

impl ScaledKernel {
    /// `kernel` on ℝ^`dimension` with these length scales.
    ///
    /// # Errors
    /// `Kernel` where it is not positive definite there, `LengthScale` where one is not a finite number > 0 or
    /// there is not one for each axis.
    pub fn new(kernel: Kernel, length_scale: &LengthScale, dimension: usize) -> Result<Self, DesignError> {
        Ok(Self {
            radial: kernel.radial(dimension)?,
            inverse_length_scales: length_scale.inverses(dimension)?,
        })
    }

    /// 1/ℓ, one for each axis.
    pub(crate) fn inverse_length_scales(&self) -> &[f64] {
        &self.inverse_length_scales
    }

    /// κ.
    pub(crate) fn radial(&self) -> &RadialFunction {
        &self.radial
    }

    /// 𝔎(a, b), dimensionless.
    pub fn value(&self, a: &[f64], b: &[f64]) -> f64 {
        self.radial.value(weighted_distance(a, b, &self.inverse_length_scales))
    }

    /// κ(0).
    pub fn value_at_zero(&self) -> f64 {
        self.radial.value_at_zero()
    }
}
