//! The adaptive law on its own, whatever plant it serves: output error, features, weights, matched force.
//!
//! ```text
//! ỹ = y − C x̂_j
//! φ = R⁻¹ k(y)
//! θ_{j+1} = θ_j + h σ(‖ỹ‖) φ (Γ_f ỹ)ᵀ
//! f̂ = θ_{j+1}ᵀ φ
//! ```
//!
//! The continuous law is `θ' = σ(‖ỹ‖) φ(y) (Γ_f ỹ)ᵀ`, which in the paper's coordinates is
//! `α̂' = σ(‖ỹ‖) K⁻¹ k(y) (Γ_f ỹ)ᵀ` (Niu et al., §V-B; the paper drops σ there), sampled with y and ỹ held over the
//! step h.
//!
//! | symbol | name | shape | unit |
//! |---|---|---|---|
//! | y, ỹ | `output`, `output_error` | m | the output's |
//! | f̂ | `matched_force` | m | the input's |
//! | Γ_f | `adaptation_rate` | m×m | the input's, per second and unit of output |
//! | θ, φ | `weights`, `features` | N×m, N | the input's; 1 |

use crate::lanes::{VectorLoop, dot};
use crate::native_space::FeatureBuffers;
use crate::stability::StepLimit;
use crate::{DeadZone, NativeSpace};
use nalgebra::{SMatrix, SVector};
use pulp::Simd;

/// At run time σ is held below this part of what the sampled-data bound allows: the bound itself is where
/// an error changes sign for ever.
const STABILITY_MARGIN: f64 = 0.9;

/// The law with its weights, for at most M outputs. Everything is allocated here; steps allocate nothing.
///
/// A plant with m < M outputs uses the first m entries of every vector; the others are zero.
///
/// # Source
/// Niu et al., eq. (final learning laws), in the coordinates θ = Rᵀα̂.
#[derive(Debug, Clone)]
pub struct Law<const M: usize> {
    space: NativeSpace,
    dead_zone: DeadZone,
    adaptation_rate: SMatrix<f64, M, M>,
    step_limit: StepLimit,
    frozen: bool,
    weights: [Vec<f64>; M],
    native_norm: f64,
    held: HeldOutput<M>,
    at_output: FeatureBuffers,
    at_query: FeatureBuffers,
}

/// What follows from the held output alone, before it is known how long it will be held.
#[derive(Debug, Clone, Copy)]
struct HeldOutput<const M: usize> {
    output: SVector<f64, M>,
    output_error: SVector<f64, M>,
    activation: f64,
    squared_features: f64,
    /// θ_jᵀ φ.
    prior_force: SVector<f64, M>,
}

impl<const M: usize> HeldOutput<M> {
    fn nothing() -> Self {
        let zero = SVector::zeros();
        Self { output: zero, output_error: zero, activation: 0.0, squared_features: 0.0, prior_force: zero }
    }
}

/// One update of the weights, θ_{j+1} − θ_j = φ (h σ Γ_f ỹ)ᵀ, for one length of the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Learning<const M: usize> {
    /// σ as used.
    pub activation: f64,
    /// Whether σ was held down to keep the sampled law stable.
    pub clamped: bool,
    /// h σ Γ_f ỹ, in the input's unit.
    pub increment: SVector<f64, M>,
}

impl<const M: usize> Learning<M> {
    /// No update.
    pub fn none() -> Self {
        Self { activation: 0.0, clamped: false, increment: SVector::zeros() }
    }
}

impl<const M: usize> Law<M> {
    /// The law with weights zero. `step_limit` is what keeps the sampled law stable with its plant.
    pub(crate) fn new(
        space: NativeSpace,
        dead_zone: DeadZone,
        adaptation_rate: SMatrix<f64, M, M>,
        step_limit: StepLimit,
    ) -> Self {
        let n = space.n_padded();
        let m = space.centers().dimension();
        Self {
            dead_zone,
            adaptation_rate,
            step_limit,
            frozen: false,
            weights: std::array::from_fn(|axis| vec![0.0; if axis < m { n } else { 0 }]),
            native_norm: 0.0,
            held: HeldOutput::nothing(),
            at_output: FeatureBuffers::new(&space),
            at_query: FeatureBuffers::new(&space),
            space,
        }
    }

    /// Takes a new output y against the output estimate Cx̂: ỹ, φ, σ and θᵀφ.
    ///
    /// # Cost
    /// N(N+1)/2 + N m multiply-adds and N kernel values; no allocation.
    pub fn observe(&mut self, output: &SVector<f64, M>, output_estimate: &SVector<f64, M>) {
        self.held.output = *output;
        let point = &output.as_slice()[..self.space.centers().dimension()];
        self.held.squared_features = self.space.features(point, &mut self.at_output);
        self.observe_again(output_estimate);
    }

    /// Takes the held output once more, against a newer estimate and newer weights.
    pub fn observe_again(&mut self, output_estimate: &SVector<f64, M>) {
        self.held.output_error = self.held.output - output_estimate;
        let open = if self.frozen { 0.0 } else { 1.0 };
        self.held.activation = open * self.dead_zone.activation(self.held.output_error.norm());
        let features = self.at_output.features();
        self.held.prior_force = self.space.unit().run(Value { weights: &self.weights, features });
    }

    /// The weights' update if the output is held for `h_s`.
    pub fn learning(&self, h_s: f64) -> Learning<M> {
        let held = &self.held;
        if held.activation == 0.0 || h_s == 0.0 {
            return Learning { activation: held.activation, ..Learning::none() };
        }
        let allowed = STABILITY_MARGIN * self.step_limit.largest_activation(h_s, held.squared_features);
        let activation = held.activation.min(allowed);
        Learning {
            activation,
            clamped: activation < held.activation,
            increment: h_s * activation * (self.adaptation_rate * held.output_error),
        }
    }

    /// f̂(y) at the held output after the update: `θ_{j+1}ᵀ φ = θ_jᵀ φ + φᵀφ · h σ Γ_f ỹ`.
    pub fn matched_force(&self, learning: &Learning<M>) -> SVector<f64, M> {
        self.held.prior_force + self.held.squared_features * learning.increment
    }

    /// θ_{j+1} = θ_j + φ (h σ Γ_f ỹ)ᵀ.
    pub fn learn(&mut self, learning: &Learning<M>) {
        if learning.increment == SVector::<f64, M>::zeros() {
            return;
        }
        let features = self.at_output.features();
        let update = Update { weights: &mut self.weights, features, increment: &learning.increment };
        self.native_norm = self.space.unit().run(update).sqrt();
    }

    /// f̂ at another point than the held output, with an update of the weights that is not yet made; and
    /// φᵀφ there.
    ///
    /// # Cost
    /// As [`Law::observe`].
    pub fn matched_force_at(
        &mut self,
        point: &SVector<f64, M>,
        pending: &Learning<M>,
    ) -> (SVector<f64, M>, f64) {
        let coordinates = &point.as_slice()[..self.space.centers().dimension()];
        let squared_features = self.space.features(coordinates, &mut self.at_query);
        let (unit, features) = (self.space.unit(), self.at_query.features());
        let pending_part = match pending.increment == SVector::<f64, M>::zeros() {
            true => 0.0,
            false => unit.run(Dot { x: self.at_output.features(), y: features }),
        };
        let force = unit.run(Value { weights: &self.weights, features });
        (force + pending_part * pending.increment, squared_features)
    }

    /// Stops or resumes learning from the next output on; what was learned stays in use.
    pub fn set_frozen(&mut self, frozen: bool) {
        self.frozen = frozen;
    }

    /// Whether learning is stopped.
    pub fn frozen(&self) -> bool {
        self.frozen
    }

    /// Forgets what was learned.
    pub fn forget(&mut self) {
        self.weights.iter_mut().for_each(|theta| theta.fill(0.0));
        self.native_norm = 0.0;
        self.held = HeldOutput::nothing();
    }

    /// θ, one run of N per output, filled up with zeros to whole lanes.
    pub fn weights(&self) -> &[Vec<f64>] {
        &self.weights[..self.space.centers().dimension()]
    }

    /// Takes weights of a law of the same design. No allocation.
    ///
    /// # Panics
    /// Where a run has more entries than those of [`Law::weights`].
    pub fn set_weights(&mut self, weights: &[Vec<f64>]) {
        for (theta, new) in self.weights.iter_mut().zip(weights) {
            theta[..new.len()].copy_from_slice(new);
        }
        let squares = |theta: &Vec<f64>| self.space.unit().run(Dot { x: theta, y: theta });
        self.native_norm = self.weights.iter().map(squares).sum::<f64>().sqrt();
    }

    /// The native space of f̂.
    pub fn space(&self) -> &NativeSpace {
        &self.space
    }

    /// σ's shape and width.
    pub fn dead_zone(&self) -> &DeadZone {
        &self.dead_zone
    }

    /// ‖f̂_N‖_H = ‖θ‖_F.
    pub fn native_norm(&self) -> f64 {
        self.native_norm
    }

    /// ỹ of the held output.
    pub fn output_error(&self) -> &SVector<f64, M> {
        &self.held.output_error
    }

    /// The output that was taken last.
    pub fn held_output(&self) -> &SVector<f64, M> {
        &self.held.output
    }

    /// φᵀφ at the held output.
    pub fn squared_features(&self) -> f64 {
        self.held.squared_features
    }

    /// P_N at the held output.
    pub fn power_function(&self) -> f64 {
        self.space.power_function(self.held.squared_features)
    }
}

/// θᵀφ.
struct Value<'a, const M: usize> {
    weights: &'a [Vec<f64>; M],
    features: &'a [f64],
}

impl<const M: usize> VectorLoop for Value<'_, M> {
    type Output = SVector<f64, M>;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> SVector<f64, M> {
        SVector::from_fn(|axis, _| dot(simd, &self.weights[axis], self.features))
    }
}

/// xᵀy.
struct Dot<'a> {
    x: &'a [f64],
    y: &'a [f64],
}

impl VectorLoop for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn call<S: Simd>(self, simd: S) -> f64 {
        dot(simd, self.x, self.y)
    }
}

/// θ + φ (h σ Γ_f ỹ)ᵀ, and ‖θ‖²_F of the result.
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
