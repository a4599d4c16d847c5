//! The law without centers: f̂ is in H itself, and every sample that is learned from adds one kernel.
//!
//! ```text
//! f̂' = σ(‖ỹ‖) Γ_f E_y* ỹ ,    E_y* a = 𝒦(y,·) a
//! f̂_{j+1} = f̂_j + h σ(‖ỹ‖) 𝒦(y_j,·) Γ_f ỹ ,    ỹ = y_j − C x̂_j
//! ```
//!
//! For the same output errors the law on N centers computes Π_N of this. Only for reference and offline: a step costs one
//! kernel value for each step that was learned from.
//!
//! # Source
//! Niu et al., eq. (adaptive law infinite dim), sampled as the law is: y and ỹ held over the step,
//! update first.

use crate::native_function::NativeFunction;
use nalgebra::{SMatrix, SVector};
use observer::{DeadZone, ScaledKernel};

/// The law in H for M outputs, from f̂ = 0.
#[derive(Debug, Clone)]
pub(crate) struct ReferenceLaw<const M: usize> {
    dead_zone: DeadZone,
    adaptation_rate: SMatrix<f64, M, M>,
    function: NativeFunction,
}

/// One step of the law in H.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ReferenceStep<const M: usize> {
    /// ỹ = y − C x̂, in the output's unit.
    pub(crate) output_error: SVector<f64, M>,
    /// σ(‖ỹ‖).
    pub(crate) activation: f64,
    /// h σ Γ_f ỹ, in the input's unit.
    pub(crate) increment: SVector<f64, M>,
    /// f̂_{j+1}(y), after the update, in the input's unit.
    pub(crate) matched_force: SVector<f64, M>,
}

impl<const M: usize> ReferenceLaw<M> {
    /// f̂ = 0 in the space of `kernel` on ℝ^M; Γ_f = `adaptation_rate`, symmetric positive definite. σ is not
    /// held down for the sampled law's stability: that is the caller's to see to.
    pub(crate) fn new(
        kernel: ScaledKernel,
        dead_zone: DeadZone,
        adaptation_rate: SMatrix<f64, M, M>,
    ) -> Self {
        Self { dead_zone, adaptation_rate, function: NativeFunction::zero(kernel, M) }
    }

    /// Learns from an output that is held for `h_s`, against the output estimate Cx̂.
    ///
    /// # Cost
    /// One kernel value for every step that learned; allocates.
    pub(crate) fn step(
        &mut self,
        output: &SVector<f64, M>,
        output_estimate: &SVector<f64, M>,
        h_s: f64,
    ) -> ReferenceStep<M> {
        let output_error = output - output_estimate;
        let activation = self.dead_zone.activation(output_error.norm());
        let increment = h_s * activation * (self.adaptation_rate * output_error);
        if activation > 0.0 {
            self.function.add(output.as_slice(), increment.as_slice());
        }
        let matched_force = SVector::from_column_slice(&self.function.value(output.as_slice()));
        ReferenceStep { output_error, activation, increment, matched_force }
    }

    /// f̂.
    pub(crate) fn function(&self) -> &NativeFunction {
        &self.function
    }
}
