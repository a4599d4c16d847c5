//! f̂_N in the orthonormal basis of its native space. An evaluation is exact and costs N(N+1)/2 multiply-adds, or an eighth
//! of that on a lattice of three axes.
//!
//! ```text
//! f̂(y) = θᵀ φ(y),    θ += φ(y) inᵀ
//! ```
//!
//! with the increment `in` = h σ Γ_f ỹ of an output that was held for h.

use crate::function::checkpoint::Learned;
use crate::function::evaluation::Evaluation;
use crate::space::factors::lanes::{VectorLoop, VectorUnit};
use crate::space::native_space::{FeatureBuffers, NativeSpace};
use nalgebra::SVector;
use pulp::Simd;

/// A function of H_N with values in ℝ^m, m ≤ M, as weights θ.
#[derive(Debug, Clone)]
pub(crate) struct DenseFunction<const M: usize> {
    space: NativeSpace,
    /// θ and ‖θ‖.
    learned: Learned<M, 1>,
    saved: Learned<M, 1>,
    at_output: FeatureBuffers,
    /// φᵀφ at the held output.
    squared_features: f64,
    at_query: FeatureBuffers,
}

impl<const M: usize> DenseFunction<M> {
    pub(crate) fn zero(space: NativeSpace) -> Self {
        let (n, m) = (space.n_padded(), space.centers().dimension());
        Self {
            learned: Learned::zeros(m, n),
            saved: Learned::zeros(m, n),
            at_output: FeatureBuffers::new(&space),
            squared_features: 0.0,
            at_query: FeatureBuffers::new(&space),
            space,
        }
    }

    pub(crate) fn hold(&mut self, output: &[f64]) {
        self.squared_features = self.space.features(output, &mut self.at_output);
    }

    /// θᵀφ.
    fn value(&self, unit: VectorUnit, features: &[f64]) -> SVector<f64, M> {
        unit.dots(self.learned.runs.each_ref().map(|run| &run[..]), features).into()
    }

    pub(crate) fn held(&self) -> Evaluation<M> {
        let features = self.at_output.features();
        let value = self.value(self.space.unit(), features);
        Evaluation::exact(value, self.squared_features)
    }

    pub(crate) fn at(&mut self, point: &[f64], pending: &SVector<f64, M>) -> Evaluation<M> {
        let squared_features = self.space.features(point, &mut self.at_query);
        let (unit, features) = (self.space.unit(), self.at_query.features());
        let pending_part = match *pending == SVector::<f64, M>::zeros() {
            true => 0.0,
            false => unit.dots([self.at_output.features()], features)[0],
        };
        let value = self.value(unit, features);
        Evaluation::exact(value + pending_part * pending, squared_features)
    }

    pub(crate) fn learn(&mut self, increment: &SVector<f64, M>) {
        let features = self.at_output.features();
        let update = Update { weights: &mut self.learned.runs, features, increment };
        self.learned.scalars[0] = self.space.unit().run(update).sqrt();
    }

    pub(crate) fn forget(&mut self) {
        self.learned.clear();
    }

    pub(crate) fn save(&mut self) {
        self.saved.copy_from(&self.learned);
    }

    pub(crate) fn restore(&mut self) {
        self.learned.copy_from(&self.saved);
    }

    pub(crate) fn load(&mut self, numbers: &[f64]) {
        self.saved.load(numbers);
        self.restore();
    }

    /// θ and ‖θ‖.
    pub(crate) fn learned(&self) -> &Learned<M, 1> {
        &self.learned
    }

    /// Takes θ and ‖θ‖ that were copied before.
    pub(crate) fn set_learned(&mut self, learned: &Learned<M, 1>) {
        self.learned.copy_from(learned);
    }

    pub(crate) fn saved(&self) -> &Learned<M, 1> {
        &self.saved
    }

    pub(crate) fn bounding_box(&self) -> (&[f64], &[f64]) {
        self.space.bounding_box()
    }

    /// θ, one run of whole lanes per output.
    pub(crate) fn weights(&self) -> &[Vec<f64>] {
        &self.learned.runs[..self.space.centers().dimension()]
    }

    /// ‖f̂_N‖_H = ‖θ‖_F.
    pub(crate) fn native_norm(&self) -> f64 {
        self.learned.scalars[0]
    }

    pub(crate) fn norm_coefficient(&self) -> f64 {
        self.squared_features
    }

    pub(crate) fn space(&self) -> &NativeSpace {
        &self.space
    }

    /// Bytes of the factor, the weights and their checkpoint.
    pub(crate) fn bytes(&self) -> usize {
        self.space.bytes() + 16 * self.space.centers().dimension() * self.space.n_padded()
    }

    /// Bytes of the factor and the centers, which a step reads.
    pub(crate) fn bytes_of_step(&self) -> usize {
        self.space.bytes()
    }
}

/// θ + φ inᵀ, and ‖θ‖²_F of the result.
struct Update<'a, const M: usize> {
    weights: &'a mut [Vec<f64>; M],
    features: &'a [f64],
    increment: &'a SVector<f64, M>,
}

impl<const M: usize> VectorLoop for Update<'_, M> {
    type Output = f64;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> f64 {
        let (features, _) = S::as_simd_f64s(self.features);
        let mut squares = simd.splat_f64s(0.0);
        for (theta, &increment) in self.weights.iter_mut().zip(self.increment) {
            let (theta, _) = S::as_mut_simd_f64s(theta);
            let increment = simd.splat_f64s(increment);
            for (weight, &feature) in theta.iter_mut().zip(features) {
                *weight = simd.mul_add_e_f64s(feature, increment, *weight);
                squares = simd.mul_add_e_f64s(*weight, *weight, squares);
            }
        }
        simd.reduce_sum_f64s(squares)
    }
}
