//! §3a: what is not excited does not teach.
//!
//! In closed loop the commands and v̂ carry the sensor's noise. Without more motion than that, features would explain the
//! filter's own corrections. So the covariance, not the mean, sees the variation of ψ about its recent mean only as far as
//! it exceeds the level A² of the corrections:
//!
//! ```text
//! ψ̄ += (1 − e^{−(h/T_m)(g + ε)})(ψ − ψ̄)
//! E += (1 − e^{−h/T_E})(‖ψ − ψ̄‖² − E)
//! g = E⁴/(E⁴ + (A²)⁴),   1 while A = 0
//! ψ_t = ψ̄ + g (ψ − ψ̄)
//! ```

use super::design::ExcitationDesign;
use crate::space::factors::lanes::{VectorLoop, VectorUnit};
use pulp::Simd;

/// ψ̄, E and g.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Excitation {
    /// ψ̄, of whole lanes.
    pub(crate) mean: Vec<f64>,
    /// E.
    pub(crate) variation: f64,
    /// g.
    pub(crate) teaching: f64,
    /// Whether a first ψ was seen.
    pub(crate) is_started: bool,
}

impl Excitation {
    pub(crate) fn new(n_padded: usize) -> Self {
        Self { mean: vec![0.0; n_padded], variation: 0.0, teaching: 1.0, is_started: false }
    }

    pub(crate) fn clear(&mut self) {
        self.mean.fill(0.0);
        (self.variation, self.teaching, self.is_started) = (0.0, 1.0, false);
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.mean.copy_from_slice(&other.mean);
        (self.variation, self.teaching, self.is_started) =
            (other.variation, other.teaching, other.is_started);
    }

    /// Follows ψ over a step of h; `variation_rate` = 1 − e^{−h/T_E}.
    pub(crate) fn follow(
        &mut self,
        unit: VectorUnit,
        features: &[f64],
        (h_s, variation_rate, corrections): (f64, f64, f64),
        design: &ExcitationDesign,
    ) {
        if !self.is_started {
            self.mean.copy_from_slice(features);
            self.is_started = true;
        }
        let rate = 1.0 - (-h_s / design.mean_time_s * (self.teaching + design.idle_rate)).exp();
        let square = unit.run(FollowMean { mean: &mut self.mean, features, rate });
        self.variation += variation_rate * (square - self.variation);
        self.teaching = teaching(self.variation, corrections);
    }

    /// h ψ_t = h (ψ̄ + g (ψ − ψ̄)); h ψ before a first ψ was seen.
    #[inline(always)]
    pub(crate) fn teaching_features(&self, features: &[f64], h_s: f64, teaching: &mut [f64]) {
        let share = if self.is_started { self.teaching } else { 1.0 };
        for ((t, &psi), &mean) in teaching.iter_mut().zip(features).zip(&self.mean) {
            *t = h_s * (mean + share * (psi - mean));
        }
    }
}

/// g; 1 where both levels are too small to compare.
fn teaching(variation: f64, corrections: f64) -> f64 {
    let (e, a) = (variation.powi(4), corrections.powi(4));
    if corrections > 0.0 && e + a > 0.0 { e / (e + a) } else { 1.0 }
}

/// ψ̄ += rate (ψ − ψ̄), and ‖ψ − ψ̄‖² with the new ψ̄.
struct FollowMean<'a> {
    mean: &'a mut [f64],
    features: &'a [f64],
    rate: f64,
}

impl VectorLoop for FollowMean<'_> {
    type Output = f64;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> f64 {
        let ((mean, _), (features, _)) = (S::as_mut_simd_f64s(self.mean), S::as_simd_f64s(self.features));
        let rate = simd.splat_f64s(self.rate);
        let mut squares = simd.splat_f64s(0.0);
        for (mean, &psi) in mean.iter_mut().zip(features) {
            *mean = simd.mul_add_e_f64s(rate, simd.sub_f64s(psi, *mean), *mean);
            let difference = simd.sub_f64s(psi, *mean);
            squares = simd.mul_add_e_f64s(difference, difference, squares);
        }
        simd.reduce_sum_f64s(squares)
    }
}
