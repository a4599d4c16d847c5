//! The Lyapunov function of the observer and the terms of its derivative, for simulations: where the truth is known.
//!
//! With e = x − x̂, f̃ = f − f̂ and the Lur'e pair (`A_eᵀP + PA_e = −Q`, `PB = Cᵀ`), on the law in H or, with f in H_N, on
//! the law on the centers,
//!
//! ```text
//! e' = A_e e + B f̃(y) − L δ ,    f̃' = −σ Γ_f E_y* ỹ ,    ỹ = C e + δ
//!
//! V  = eᵀP e + ⟨f̃, Γ_f⁻¹ f̃⟩_H
//! V' = −eᵀQ e − 2 eᵀP L δ + 2 (1 − σ) ⟨f̃(y), C e⟩ − 2 σ ⟨f̃(y), δ⟩
//!       decay     noise         dead zone             dropped
//! ```
//!
//! since 2 eᵀPB f̃(y) = 2 ⟨Ce, f̃(y)⟩ and 2 ⟨f̃', Γ_f⁻¹ f̃⟩_H = −2σ ⟨E_y* ỹ, f̃⟩_H = −2σ ⟨ỹ, f̃(y)⟩. The part of f that the
//! centers cannot represent adds [`LyapunovFunction::residual_term`].
//!
//! The proof of Theorem 1 drops the last term; and V need not fall where 0 ≤ σ ≠ 1, which for the paper's unbounded
//! σ₀ is nearly everywhere. With P = pI, C = I and δ = 0 another function falls for every dead zone:
//!
//! `V_σ = ∫₀^{eᵀPe} σ(√(s/p)) ds + ⟨f̃, Γ_f⁻¹ f̃⟩_H ,    V_σ' = −σ eᵀQ e`
//!
//! because its first part has the derivative σ (−eᵀQe + 2⟨f̃(y), e⟩) and the second −2σ ⟨f̃(y), e⟩.
//!
//! # Source
//! Niu et al., proof of Theorem 1; the dead-zone and the dropped term and V_σ are ours.

use crate::{DeadZone, NativeFunction};
use nalgebra::{DMatrix, DVector};

/// V of one observer.
///
/// | symbol | name | shape |
/// |---|---|---|
/// | P | `p` | n×n, symmetric positive definite, PB = Cᵀ |
/// | A_e = A − LC | `error_dynamics` | n×n |
/// | L | `gain` | n×m |
/// | C | `c` | m×n |
/// | Γ_f | `adaptation_rate` | m×m, symmetric positive definite |
/// | e = x − x̂ | `error` | n |
/// | f̃ = f − f̂ | `function_error` | ℝ^m → ℝ^m |
/// | y | `output` | m, as measured |
/// | δ | `noise` | m, y = Cx + δ |
/// | σ | `activation` | ≥ 0, as used |
#[derive(Debug, Clone)]
pub struct LyapunovFunction {
    p: DMatrix<f64>,
    /// Q = −(A_eᵀP + PA_e).
    q: DMatrix<f64>,
    /// PL.
    p_gain: DMatrix<f64>,
    c: DMatrix<f64>,
    inverse_adaptation_rate: DMatrix<f64>,
}

/// The terms of V', in V's unit per second; their sum is V'.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LyapunovRate {
    /// −eᵀQe ≤ 0.
    pub decay: f64,
    /// −2 eᵀPLδ.
    pub noise: f64,
    /// 2 (1 − σ) ⟨f̃(y), Ce⟩: what is not learned.
    pub dead_zone: f64,
    /// −2σ ⟨f̃(y), δ⟩: what is learned from the measurement error. The paper's proof drops it.
    pub dropped: f64,
}

impl LyapunovRate {
    /// V'.
    pub fn sum(&self) -> f64 {
        self.decay + self.noise + self.dead_zone + self.dropped
    }
}

impl LyapunovFunction {
    /// V from P, A_e, L, C and Γ_f.
    ///
    /// # Panics
    /// Where the shapes do not fit or Γ_f is singular.
    pub fn new(
        p: DMatrix<f64>,
        error_dynamics: &DMatrix<f64>,
        gain: &DMatrix<f64>,
        c: DMatrix<f64>,
        adaptation_rate: &DMatrix<f64>,
    ) -> Self {
        let inverse_adaptation_rate =
            adaptation_rate.clone().try_inverse().expect("an adaptation rate is positive definite");
        Self {
            q: -(error_dynamics.tr_mul(&p) + &p * error_dynamics),
            p_gain: &p * gain,
            p,
            c,
            inverse_adaptation_rate,
        }
    }

    /// V(e, f̃) = eᵀPe + ⟨f̃, Γ_f⁻¹ f̃⟩_H.
    ///
    /// # Cost
    /// The square of the number of kernels of f̃.
    pub fn value(&self, error: &DVector<f64>, function_error: &NativeFunction) -> f64 {
        error.dot(&(&self.p * error)) + self.function_part(function_error)
    }

    /// ⟨f̃, Γ_f⁻¹ f̃⟩_H.
    pub fn function_part(&self, function_error: &NativeFunction) -> f64 {
        function_error.inner_product(&function_error.transformed(&self.inverse_adaptation_rate))
    }

    /// V_σ(e, f̃) = p ‖e‖-wise `∫₀^{p‖e‖²} σ(√(s/p)) ds = 2p ∫₀^{‖e‖} σ(r) r dr`, and the same second part; `None` where
    /// P is not pI or C not I, and V_σ need not fall.
    pub fn value_in_dead_zone(
        &self,
        error: &DVector<f64>,
        function_error: &NativeFunction,
        dead_zone: &DeadZone,
    ) -> Option<f64> {
        let p = self.p[(0, 0)];
        let identity = DMatrix::identity(self.p.nrows(), self.p.nrows());
        let is_isotropic = (&self.p - p * &identity).amax() <= 1e-12 * p && self.c == identity;
        is_isotropic
            .then(|| 2.0 * p * dead_zone.first_moment(error.norm()) + self.function_part(function_error))
    }

    /// The terms of V' at one instant.
    pub fn rate(
        &self,
        error: &DVector<f64>,
        function_error: &NativeFunction,
        output: &DVector<f64>,
        noise: &DVector<f64>,
        activation: f64,
    ) -> LyapunovRate {
        let force_error = DVector::from_vec(function_error.value(output.as_slice()));
        LyapunovRate {
            decay: -error.dot(&(&self.q * error)),
            noise: -2.0 * error.dot(&(&self.p_gain * noise)),
            dead_zone: 2.0 * (1.0 - activation) * force_error.dot(&(&self.c * error)),
            dropped: -2.0 * activation * force_error.dot(noise),
        }
    }

    /// 2σ ⟨((I − Π_N) f)(y), Ce + δ⟩: what the law on the centers adds to V' by learning Π_N E_y* ỹ only, where `residual`
    /// is (I − Π_N) f.
    pub fn residual_term(
        &self,
        error: &DVector<f64>,
        residual: &NativeFunction,
        output: &DVector<f64>,
        noise: &DVector<f64>,
        activation: f64,
    ) -> f64 {
        let value = DVector::from_vec(residual.value(output.as_slice()));
        2.0 * activation * value.dot(&(&self.c * error + noise))
    }
}
