//! The paper's gradient law, independent of the plant: output error, features, weights, matched force.
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
//! step h. With [`FeaturePoint::Estimated`] φ is taken at C x̂_j in place of y, and with a `max_norm` an update that would
//! bring ‖f̂‖_H beyond it is made smaller ([`GradientOptions`]).
//!
//! | symbol | name | shape | unit |
//! |---|---|---|---|
//! | y, ỹ | `output`, `output_error` | m | the output's |
//! | f̂ | `matched_force` | m | the input's |
//! | Γ_f | `adaptation_rate` | m×m | the input's, per second and unit of output |
//! | θ, φ | `weights`, `features` | N×m, N | the input's; 1 |

use crate::design::{FeaturePoint, GradientOptions};
use crate::function::checkpoint::Learned;
use crate::function::evaluation::Evaluation;
use crate::function::learned::LearnedFunction;
use crate::law::dead_zone::DeadZone;
use crate::law::stability::StepLimit;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// At run time σ is held below this part of the sampled-data bound.
///
/// The bound is for a constant σ. The paper's σ₀ grows with the error, so that the *slope* of σ(e) e is up to 2σ: the
/// slope has to stay within the bound, or the error may swing for ever between large and small σ. With 0.9
/// one start in fifteen did, with 0.45 none of 300.
const STABILITY_MARGIN: f64 = 0.45;

/// The law with its weights, for at most M outputs. Everything is allocated here; steps allocate nothing.
///
/// A plant with m < M outputs uses the first m entries of every vector; the others are zero.
///
/// # Source
/// Niu et al., eq. (final learning laws), in the coordinates θ = Rᵀα̂.
#[derive(Debug, Clone)]
pub struct GradientLaw<const M: usize> {
    function: LearnedFunction<M>,
    dead_zone: DeadZone,
    adaptation_rate: SMatrix<f64, M, M>,
    step_limit: StepLimit,
    options: GradientOptions,
    held: HeldOutput<M>,
    /// f̂ at the feature point before the update, θ_jᵀ φ.
    prior: Evaluation<M>,
}

/// The results of a held output that do not depend on how long it is held.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeldOutput<const M: usize> {
    /// y.
    pub output: SVector<f64, M>,
    /// ỹ.
    pub output_error: SVector<f64, M>,
    /// σ(‖ỹ‖), 0 where nothing is learned from it.
    pub activation: f64,
}

impl<const M: usize> HeldOutput<M> {
    fn nothing() -> Self {
        Self { output: SVector::zeros(), output_error: SVector::zeros(), activation: 0.0 }
    }
}

/// One update of the weights, θ_{j+1} − θ_j = φ (h σ Γ_f ỹ)ᵀ, for one length of the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Learning<const M: usize> {
    /// σ as used.
    pub activation: f64,
    /// Whether σ was held down, to keep the sampled law stable or ‖f̂‖ within its bound.
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

/// Weights and held output at an instant.
#[derive(Debug, Clone)]
pub(crate) struct GradientMark<const M: usize> {
    learned: Learned<M, 1>,
    held: HeldOutput<M>,
    prior: Evaluation<M>,
}

impl<const M: usize> GradientLaw<M> {
    /// The law with f̂ = 0. `step_limit` is what keeps the sampled law stable with its plant.
    pub(crate) fn new(
        function: LearnedFunction<M>,
        dead_zone: DeadZone,
        adaptation_rate: SMatrix<f64, M, M>,
        step_limit: StepLimit,
        options: GradientOptions,
    ) -> Self {
        let (held, prior) = (HeldOutput::nothing(), Evaluation::exact(SVector::zeros(), 0.0));
        Self { function, dead_zone, adaptation_rate, step_limit, options, held, prior }
    }

    /// Takes a new output y against the output estimate Cx̂: ỹ, φ, σ and θᵀφ. With `learn` false, σ = 0: the output
    /// corrects the state only.
    ///
    /// # Cost
    /// Dense: N(N+1)/2 + N m multiply-adds and N kernel values. Local: those of one block. No allocation.
    pub fn observe(&mut self, output: &SVector<f64, M>, output_estimate: &SVector<f64, M>, learn: bool) {
        self.held.output = *output;
        if self.options.feature_point == FeaturePoint::Measured {
            self.function.hold(output.as_slice());
        }
        self.observe_again(output_estimate, learn);
    }

    /// Takes the held output once more, against a newer estimate and newer weights.
    ///
    /// # Cost
    /// Independent of N with features at y; as [`GradientLaw::observe`] with features at C x̂, which has moved.
    pub fn observe_again(&mut self, output_estimate: &SVector<f64, M>, learn: bool) {
        self.held.output_error = self.held.output - output_estimate;
        if self.options.feature_point == FeaturePoint::Estimated {
            self.function.hold(self.feature_point().as_slice());
        }
        let open = if learn { 1.0 } else { 0.0 };
        self.held.activation = open * self.dead_zone.activation(self.held.output_error.norm());
        self.prior = self.function.held();
    }

    /// The weights' update if the output is held for `h_s`.
    pub fn learning(&self, h_s: f64) -> Learning<M> {
        let HeldOutput { output_error, activation: wanted, .. } = self.held;
        if wanted == 0.0 || h_s == 0.0 {
            return Learning { activation: wanted, ..Learning::none() };
        }
        let mut activation =
            self.step_limit.limited(wanted, STABILITY_MARGIN, h_s, self.prior.squared_features);
        if let Some(max_norm) = self.options.max_norm {
            let increment = h_s * activation * (self.adaptation_rate * output_error);
            activation *= self.share_within(max_norm, &increment);
        }
        Learning {
            activation,
            clamped: activation < wanted,
            increment: h_s * activation * (self.adaptation_rate * output_error),
        }
    }

    /// The largest s in 0 … 1 for which an update of s times this increment leaves ‖f̂‖ at most at `max_norm`, or no
    /// larger than it is.
    ///
    /// `‖f̂ + s Π_N 𝔎(·, y) in‖² = ‖f̂‖² + 2 s f̂(y)ᵀin + s² q |in|²`, q = φᵀφ
    fn share_within(&self, max_norm: f64, increment: &SVector<f64, M>) -> f64 {
        let norm = self.function.native_norm();
        let room = (max_norm * max_norm - norm * norm).max(0.0);
        let half_slope = self.prior.value.dot(increment);
        let curvature = self.function.norm_coefficient() * increment.norm_squared();
        if 2.0 * half_slope + curvature <= room {
            return 1.0;
        }
        let root = (half_slope * half_slope + curvature * room).sqrt();
        // The positive root, without cancellation.
        let share = match half_slope > 0.0 {
            true => room / (half_slope + root),
            false => (root - half_slope) / curvature,
        };
        share.min(1.0)
    }

    /// f̂(y) at the held output after the update: `θ_{j+1}ᵀ φ = θ_jᵀ φ + φᵀφ · h σ Γ_f ỹ`.
    pub fn matched_force(&self, learning: &Learning<M>) -> Evaluation<M> {
        let prior = &self.prior;
        Evaluation {
            value: prior.value + prior.squared_features * learning.increment,
            error: prior.error + prior.error_of_increment * learning.increment.norm(),
            ..*prior
        }
    }

    /// θ_{j+1} = θ_j + φ (h σ Γ_f ỹ)ᵀ.
    ///
    /// # Cost
    /// Dense: N m multiply-adds. Local: kernel values and m multiply-adds for the centers that the kernel reaches.
    pub fn learn(&mut self, learning: &Learning<M>) {
        if learning.increment != SVector::<f64, M>::zeros() {
            self.function.learn(&learning.increment);
        }
    }

    /// f̂ at another point than the held output, with an update of the weights that is not yet made.
    ///
    /// # Cost
    /// As [`GradientLaw::observe`].
    pub fn matched_force_at(&mut self, point: &SVector<f64, M>, pending: &Learning<M>) -> Evaluation<M> {
        self.function.at(point.as_slice(), &pending.increment)
    }

    /// Forgets what was learned.
    pub(crate) fn forget(&mut self) {
        self.function.forget();
        self.hold_nothing();
    }

    /// Saves what is learned by now. No allocation.
    pub(crate) fn save(&mut self) {
        self.function.save();
    }

    /// Restores what was saved last. No allocation.
    pub(crate) fn restore(&mut self) {
        self.function.restore();
    }

    /// Takes over what another law of the same design has learned.
    pub(crate) fn load(&mut self, learned: &[f64]) {
        self.function.load(learned);
        self.hold_nothing();
    }

    /// Continues with an output that another law of the same design held.
    pub(crate) fn hold(&mut self, held: &HeldOutput<M>) {
        self.held = *held;
        self.function.hold(self.feature_point().as_slice());
        self.prior = self.function.held();
    }

    /// Room for a mark; `None` with the local solver.
    pub(crate) fn new_mark(&self) -> Option<GradientMark<M>> {
        let learned = self.function.learned()?.clone();
        Some(GradientMark { learned, held: self.held, prior: self.prior })
    }

    /// Copies weights and held output into a mark. No allocation.
    pub(crate) fn mark(&self, mark: &mut GradientMark<M>) {
        if let Some(learned) = self.function.learned() {
            mark.learned.copy_from(learned);
        }
        (mark.held, mark.prior) = (self.held, self.prior);
    }

    /// Becomes what it was at a mark. No allocation.
    pub(crate) fn return_to(&mut self, mark: &GradientMark<M>) {
        self.function.set_learned(&mark.learned);
        self.hold(&mark.held);
        self.prior = mark.prior;
    }

    fn hold_nothing(&mut self) {
        (self.held, self.prior) = (HeldOutput::nothing(), Evaluation::exact(SVector::zeros(), 0.0));
    }

    /// f̂_N.
    pub fn function(&self) -> &LearnedFunction<M> {
        &self.function
    }

    /// σ's shape and width.
    pub fn dead_zone(&self) -> &DeadZone {
        &self.dead_zone
    }

    /// y, ỹ and σ of the newest output.
    pub fn held(&self) -> &HeldOutput<M> {
        &self.held
    }

    /// Where φ is taken: y, or C x̂ = y − ỹ, from what a checkpoint holds.
    pub fn feature_point(&self) -> SVector<f64, M> {
        match self.options.feature_point {
            FeaturePoint::Measured => self.held.output,
            FeaturePoint::Estimated => self.held.output - self.held.output_error,
        }
    }

    /// P_N at the feature point; of the local solver, that of its block, which is no smaller.
    pub fn power_function(&self) -> f64 {
        self.function.space().power_function(self.prior.squared_features)
    }
}
