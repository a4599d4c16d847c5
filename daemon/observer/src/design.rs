//! The designs of a rigid body's channels, and the checks that all designs share.

use crate::error::{DesignError, Parameter};
use crate::function::learned::LearnedFunction;
use crate::function::solver::Solver;
use crate::law::dead_zone::DeadZone;
use crate::law::stability::{StepLimit, largest_learning_rate};
use crate::space::centers::Centers;
use crate::space::kernel::Kernel;
use crate::space::scaled_kernel::{LengthScale, ScaledKernel};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// The design of a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelDesign {
    /// κ.
    pub kernel: Kernel,
    /// ℓ > 0, in the output's unit.
    pub length_scale: LengthScale,
    /// Ξ_N.
    pub centers: Centers,
    /// Added to the Gram matrix's diagonal, as a multiple of κ(0); ≥ 0.
    pub nugget: f64,
    /// How f̂ is computed.
    pub solver: Solver,
    /// M, symmetric positive definite (kg; kg·m²).
    pub inertia: Matrix3<f64>,
    /// λ > 0 (1/s).
    pub gain_per_s: f64,
    /// Γ_f, symmetric positive definite (kg/s²; N·m).
    pub adaptation_rate: Matrix3<f64>,
    /// σ.
    pub dead_zone: DeadZone,
    /// Where the law departs from the paper's.
    pub options: GradientOptions,
    /// Bounds on the disturbances.
    pub bounds: DisturbanceBounds,
    /// An output is held for at most this long (s); then the channel coasts. Also the longest step of the
    /// law, for which its stability is checked.
    pub hold_s: f64,
    /// Step of coasting (s): f̂ is evaluated once a step at the predicted output.
    pub coast_step_s: f64,
}

/// The translation channel: y = v (inertial), M = m I₃, u the commanded force (Niu et al., §VI-A).
#[derive(Debug, Clone, PartialEq)]
pub struct TranslationDesign {
    /// The law for the velocity.
    pub channel: ChannelDesign,
    /// Known constant force, inertial axes (N): gravity, buoyancy.
    pub known_force_n: Vector3<f64>,
    /// L_r: `r̂' = v̂ + L_r ỹ`, dimensionless; 0 by default.
    pub velocity_error_to_position: f64,
    /// L_p ≥ 0 (1/s): how fast the position follows fixes; 0 ignores all but the first.
    pub position_fix_gain_per_s: f64,
    /// How long a position fix is used (s).
    pub position_fix_hold_s: f64,
}

/// The rotation channel: y = ω (body), M the inertia matrix, u the commanded torque (Niu et al., §VI-B).
#[derive(Debug, Clone, PartialEq)]
pub struct RotationDesign {
    /// The law for the angular velocity.
    pub channel: ChannelDesign,
    /// What accounts for −ω × Iω.
    pub gyroscopic_torque: GyroscopicTorque,
    /// L_q ≥ 0 (1/s): how fast the attitude follows fixes; 0 ignores all but the first.
    pub attitude_fix_gain_per_s: f64,
    /// How long an attitude fix is used (s).
    pub attitude_fix_hold_s: f64,
}

/// What accounts for the gyroscopic torque −ω × Iω of Niu et al., eq. (rotational eom dyn).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GyroscopicTorque {
    /// It is part of the unknown torque, as in the paper.
    Learned,
    /// It is computed from ω̂ and the nominal inertia.
    Feedforward,
}

/// Where the gradient law departs from the paper's; the default is the paper's law.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GradientOptions {
    /// Where φ is taken.
    pub feature_point: FeaturePoint,
    /// An upper bound > 0 on ‖f̂_N‖_H, in the input's unit; `None` for none. An update that would exceed it is made smaller,
    /// down to nothing, and reported as clamped.
    pub max_norm: Option<f64>,
}

/// The point at which the gradient law takes its features, both to learn and to evaluate f̂ for the step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FeaturePoint {
    /// φ(y), as in the paper. y and ỹ carry the same noise, so that noise alone makes f̂ grow in proportion to the time:
    /// docs/method.md derives the rate.
    #[default]
    Measured,
    /// φ(C x̂), of the estimate before the output is used. It does not carry the noise of this output.
    Estimated,
}

impl GradientOptions {
    pub(crate) fn check(&self) -> Result<(), DesignError> {
        self.max_norm.map_or(Ok(()), |max_norm| positive(Parameter::MaxNorm, max_norm))
    }
}

/// Bounds on the disturbances; 0 is *none*. They affect the guarantees, not the estimate.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DisturbanceBounds {
    /// δ̄ ≥ ‖δ(t)‖, of the measurement error, in the output's unit.
    pub noise: f64,
    /// ξ̄ ≥ ‖ξ(t)‖, of what acts on the plant and is no function of the output: a force (N), a torque (N·m), or for a
    /// general linear plant a rate of the state.
    pub unmatched: f64,
    /// r_f ≥ ‖(I − Π_N) f‖_H, of the part of f that the centers cannot represent; in the input's unit, 0 where f lies
    /// in H_N.
    pub residual_norm: f64,
}

impl DisturbanceBounds {
    pub(crate) fn check(&self) -> Result<(), DesignError> {
        for (parameter, value) in [
            (Parameter::NoiseBound, self.noise),
            (Parameter::UnmatchedBound, self.unmatched),
            (Parameter::ResidualNorm, self.residual_norm),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(DesignError::new(parameter, value.to_string(), "a finite number ≥ 0"));
            }
        }
        Ok(())
    }
}

impl ChannelDesign {
    /// f̂ = 0 with the design's solver; whether the rate is stable is another question.
    ///
    /// # Errors
    /// As [`crate::BodyChannel::new`], but for the rate's stability.
    ///
    /// # Cost
    /// As [`crate::NativeSpace::new`] with the dense solver.
    pub fn function(&self) -> Result<LearnedFunction<3>, DesignError> {
        self.check()?;
        LearnedFunction::zero((self.kernel, &self.length_scale), &self.centers, self.nugget, &self.solver)
    }

    /// The limit that keeps the sampled law stable with the body.
    ///
    /// # Errors
    /// `AdaptationRate` beyond the sampled-data bound, with the largest one that is within it.
    pub(crate) fn step_limit(&self) -> Result<StepLimit, DesignError> {
        let factor = self.largest_rate_factor()?;
        if factor <= 1.0 {
            let largest = self.adaptation_rate.symmetric_eigenvalues().max();
            return Err(DesignError::new(
                Parameter::AdaptationRate,
                format!(
                    "{largest} is unstable when an output is held for {} s (g h (1 − e^(−λh))/(λ m) ≥ 2 (1 + e^(−λh)))",
                    self.hold_s
                ),
                format!("an adaptation rate below {:.4}, or a shorter hold", largest * factor),
            ));
        }
        Ok(StepLimit::Integrator { gain_per_s: self.gain_per_s, fastest_learning: self.fastest_learning() })
    }

    pub(crate) fn check(&self) -> Result<(), DesignError> {
        positive(Parameter::Gain, self.gain_per_s)?;
        positive(Parameter::Hold, self.hold_s)?;
        positive(Parameter::CoastStep, self.coast_step_s)?;
        self.bounds.check()?;
        self.options.check()?;
        positive_definite(Parameter::Inertia, &dynamic(&self.inertia))?;
        positive_definite(Parameter::AdaptationRate, &dynamic(&self.adaptation_rate))?;
        if self.centers.dimension() != 3 {
            let found = format!("centers with {} coordinates", self.centers.dimension());
            return Err(DesignError::new(Parameter::Centers, found, "three, one per output"));
        }
        Ok(())
    }

    /// λ_max(M⁻¹ Γ_f): the learning rate of the fastest direction per unit of φᵀφ and σ (1/s²).
    fn fastest_learning(&self) -> f64 {
        // It is that of F⁻¹ Γ F⁻ᵀ with M = F Fᵀ, which is symmetric.
        let factor = self.inertia.cholesky().map(|cholesky| cholesky.l());
        let inverse = factor.and_then(|l| l.try_inverse()).expect("the inertia is positive definite");
        (inverse * self.adaptation_rate * inverse.transpose()).symmetric_eigenvalues().max()
    }

    /// The adaptation rate may be multiplied by less than this, by the sampled-data bound for σ = 1 and the
    /// longest hold.
    pub(crate) fn largest_rate_factor(&self) -> Result<f64, DesignError> {
        let kernel = ScaledKernel::new(self.kernel, &self.length_scale, self.centers.dimension())?;
        let fastest = self.fastest_learning() * kernel.value_at_zero();
        Ok(largest_learning_rate(self.gain_per_s, self.hold_s) / fastest)
    }
}

pub(crate) fn positive(parameter: Parameter, value: f64) -> Result<(), DesignError> {
    match value.is_finite() && value > 0.0 {
        true => Ok(()),
        false => Err(DesignError::new(parameter, value.to_string(), "a finite number > 0")),
    }
}

pub(crate) fn dynamic(matrix: &Matrix3<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(3, 3, matrix.as_slice())
}

/// Refuses a matrix that is not symmetric positive definite.
pub(crate) fn positive_definite(parameter: Parameter, matrix: &DMatrix<f64>) -> Result<(), DesignError> {
    let is_finite = matrix.iter().all(|entry| entry.is_finite());
    let is_symmetric = is_finite && (matrix - matrix.transpose()).amax() <= 1e-12 * matrix.amax();
    if is_symmetric && matrix.clone().cholesky().is_some() {
        return Ok(());
    }
    let rows: Vec<_> = matrix.row_iter().map(|row| format!("{:?}", row.iter().collect::<Vec<_>>())).collect();
    Err(DesignError::new(parameter, rows.join(" "), "a symmetric positive definite matrix"))
}
