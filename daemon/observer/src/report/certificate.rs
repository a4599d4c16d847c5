//! The bounds E₀ and d_N, below which the error settles by the theorems, and the `error_bound` of an estimate.
//!
//! With the Lur'e pair P, Q = WᵀW + εP of the error dynamics (`A_eᵀP + PA_e = −Q`, `PB = Cᵀ`), an error e that obeys
//!
//! `e' = A_e e + B f̃(y) − L δ + G ξ ,   ‖δ‖ ≤ δ̄ ,  ‖ξ‖ ≤ ξ̄`
//!
//! and V = eᵀPe + ⟨f̃, Γ_f⁻¹ f̃⟩, the terms that the adaptation does not cancel are at most
//!
//! `V' ≤ −λ_min(Q) ‖e‖² + 2 ‖e‖ (‖PL‖ δ̄ + ‖PG‖ ξ̄ + ‖C‖ P_N r_f)`
//!
//! so V falls outside of the ball of the radius E₀ (r_f = 0) or d_N:
//!
//! ```text
//! E₀  = 2 (‖PL‖ δ̄ + ‖PG‖ ξ̄) / λ_min(Q)
//! e_N = 2 (‖C‖ sup P_N · r_f + ‖PL‖ δ̄ + ‖PG‖ ξ̄) / λ_min(Q)        of the state
//! d_N = ‖C‖ e_N                                                    of the output
//! ```
//!
//! # Source
//! Niu et al., Theorems 1 and 2. The paper's E₀ lacks the factor 2 that its own V' has. Its d_N lacks one ‖C‖ at r_f and is
//! stated for the state; for ‖C‖ = 1, as in its examples, all agree. The terms in ξ̄ are ours: the paper introduces ξ but
//! does not bound it. With δ ≠ 0 the proof drops −2σ⟨f̃(y), δ⟩; then the bound is a claim of the paper.

use crate::design::{ChannelDesign, DisturbanceBounds};
use crate::law::dead_zone::DeadZone;
use crate::report::box_search::Supremum;
use crate::space::native_space::NativeSpace;

/// The claims of the theorems for one channel (Niu et al., eqs. (E₀), (minimal dead zone)).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    /// λ_min(Q), Q = WᵀW + εP.
    pub lambda_min: f64,
    /// ‖PL‖₂.
    pub pl_norm: f64,
    /// ‖C‖₂.
    pub output_norm: f64,
    /// ‖C⁻¹‖₂; +∞ where C is not square, so that the output does not show the whole error.
    pub output_inverse_norm: f64,
    /// ‖PG‖₂: with G = B, for a force, it is ‖C‖.
    pub disturbance_norm: f64,
    /// δ̄, ξ̄, r_f.
    pub bounds: DisturbanceBounds,
    /// d.
    pub dead_zone_width: f64,
    /// sup P_N over the box of the centers, by search; 0 where r_f = 0 and it is not needed.
    pub sup_power_function: f64,
}

impl Certificate {
    /// Of a rigid body's channel: A = 0, B = M⁻¹, C = I, L = λI, hence P = M and Q = 2λM.
    ///
    /// # Cost
    /// A search for sup P_N where r_f > 0.
    pub fn of_channel(design: &ChannelDesign, space: &NativeSpace) -> Self {
        Self::with_cover(design, sup_if_needed(&design.bounds, || space.sup_power_function()))
    }

    /// The same, with sup P_N.
    pub(crate) fn with_cover(design: &ChannelDesign, sup_power_function: f64) -> Self {
        let masses = design.inertia.symmetric_eigenvalues();
        Self::new(
            (2.0 * design.gain_per_s * masses.min(), design.gain_per_s * masses.max()),
            (1.0, 1.0, 1.0),
            design.bounds,
            &design.dead_zone,
            sup_power_function,
        )
    }

    /// From λ_min(Q) and ‖PL‖, from ‖C‖, ‖C⁻¹‖ and ‖PG‖, and from sup P_N.
    pub(crate) fn new(
        (lambda_min, pl_norm): (f64, f64),
        (output_norm, output_inverse_norm, disturbance_norm): (f64, f64, f64),
        bounds: DisturbanceBounds,
        dead_zone: &DeadZone,
        sup_power_function: f64,
    ) -> Self {
        Self {
            lambda_min,
            pl_norm,
            output_norm,
            output_inverse_norm,
            disturbance_norm,
            bounds,
            dead_zone_width: dead_zone.width(),
            sup_power_function,
        }
    }

    /// `‖PL‖ δ̄ + ‖PG‖ ξ̄`.
    fn disturbance(&self) -> f64 {
        self.pl_norm * self.bounds.noise + self.disturbance_norm * self.bounds.unmatched
    }

    /// E₀ in the state's unit: the error settles below, if f lies in H and is learned without centers (Theorem 1).
    pub fn e0(&self) -> f64 {
        2.0 * self.disturbance() / self.lambda_min
    }

    /// e_N, in the state's unit, where the power function is `power_function`, if that is more than over the box of
    /// the centers.
    fn state_radius(&self, power_function: f64) -> f64 {
        let residual = self.sup_power_function.max(power_function) * self.bounds.residual_norm;
        2.0 * (self.output_norm * residual + self.disturbance()) / self.lambda_min
    }

    /// d_N, in the output's unit: a dead zone must be wider (Theorem 2).
    pub fn d_n(&self) -> f64 {
        self.output_norm * self.state_radius(0.0)
    }

    /// d > d_N: the condition of Theorem 2.
    pub fn is_admissible(&self) -> bool {
        self.dead_zone_width > self.d_n()
    }

    /// max(d, e_N): the size that the theorems claim ‖e‖ settles below, with the power function at the present output
    /// in case that lies outside of the centers. A bound, not a covariance.
    pub fn error_bound(&self, power_function: f64) -> f64 {
        self.dead_zone_width.max(self.state_radius(power_function))
    }

    /// [`Certificate::error_bound`] where an output with this ‖ỹ‖ shows that the error is below it, +∞ elsewhere.
    ///
    /// The theorems say that ‖e‖ settles below the bound, but neither when nor, with δ̄ > 0, with a proof. An output says
    /// it of its own instant, since Ce = ỹ − δ:
    ///
    /// `‖e‖ ≤ ‖C⁻¹‖ (‖ỹ‖ + δ̄)`
    ///
    /// Hence two conditions: that of Theorem 2 with this P_N, `d > ‖C‖ e_N`, and `‖C⁻¹‖ (‖ỹ‖ + δ̄) ≤ max(d, e_N)`.
    pub fn confirmed_error_bound(&self, power_function: f64, output_error: f64) -> f64 {
        let bound = self.error_bound(power_function);
        let is_admissible = self.dead_zone_width > self.output_norm * self.state_radius(power_function);
        let is_confirmed = self.output_inverse_norm * (output_error + self.bounds.noise) <= bound;
        if is_admissible && is_confirmed { bound } else { f64::INFINITY }
    }
}

/// sup P_N, which is needed and searched only if r_f > 0.
pub(crate) fn sup_if_needed(bounds: &DisturbanceBounds, search: impl FnOnce() -> Supremum) -> f64 {
    if bounds.residual_norm > 0.0 { search().value } else { 0.0 }
}
