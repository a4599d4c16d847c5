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

use crate::function::learned::{Evaluation, LearnedFunction};
use crate::law::stability::StepLimit;
use crate::{Centers, DeadZone, NativeSpace, SolverInUse};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// At run time σ is held below this part of what the sampled-data bound allows.
///
/// The bound is for a constant σ. The paper's σ₀ grows with the error, so that the *slope* of σ(e) e is up to 2σ: it
/// is the slope that has to stay within the bound, or the error may swing for ever between large and small σ. With 0.9
/// one start in fifteen did, with 0.45 none of 300.
const STABILITY_MARGIN: f64 = 0.45;

/// The law with its weights, for at most M outputs. Everything is allocated here; steps allocate nothing.
///
/// A plant with m < M outputs uses the first m entries of every vector; the others are zero.
///
/// # Source
/// Niu et al., eq. (final learning laws), in the coordinates θ = Rᵀα̂.
#[derive(Debug, Clone)]
pub struct Law<const M: usize> {
    function: LearnedFunction<M>,
    /// m.
    n_outputs: usize,
    /// The smallest box around the centers.
    bounding_box: (Vec<f64>, Vec<f64>),
    dead_zone: DeadZone,
    adaptation_rate: SMatrix<f64, M, M>,
    step_limit: StepLimit,
    frozen: bool,
    held: HeldOutput<M>,
}

/// What follows from the held output alone, before it is known how long it will be held.
#[derive(Debug, Clone, Copy)]
struct HeldOutput<const M: usize> {
    output: SVector<f64, M>,
    output_error: SVector<f64, M>,
    activation: f64,
    /// Whether this output may be learned from.
    teaches: bool,
    /// f̂ there before the update, θ_jᵀ φ.
    prior: Evaluation<M>,
}

impl<const M: usize> HeldOutput<M> {
    fn nothing() -> Self {
        let zero = SVector::zeros();
        let prior = Evaluation::exact(zero, 0.0);
        Self { output: zero, output_error: zero, activation: 0.0, teaches: true, prior }
    }
}

/// The held output as it is kept: f̂ there follows from what was learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct KeptOutput<const M: usize> {
    output: SVector<f64, M>,
    output_error: SVector<f64, M>,
    activation: f64,
    teaches: bool,
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
    /// The law with f̂ = 0. `step_limit` is what keeps the sampled law stable with its plant.
    pub(crate) fn new(
        function: LearnedFunction<M>,
        centers: &Centers,
        dead_zone: DeadZone,
        adaptation_rate: SMatrix<f64, M, M>,
        step_limit: StepLimit,
    ) -> Self {
        Self {
            function,
            n_outputs: centers.dimension(),
            bounding_box: centers.bounding_box(),
            dead_zone,
            adaptation_rate,
            step_limit,
            frozen: false,
            held: HeldOutput::nothing(),
        }
    }

    /// Takes a new output y against the output estimate Cx̂: ỹ, φ, σ and θᵀφ.
    ///
    /// # Cost
    /// Dense: N(N+1)/2 + N m multiply-adds and N kernel values. Local: those of one block. No allocation.
    pub fn observe(&mut self, output: &SVector<f64, M>, output_estimate: &SVector<f64, M>) {
        self.observe_for(output, output_estimate, true);
    }

    /// The same; an output that does not teach corrects the state only: σ = 0.
    pub(crate) fn observe_for(
        &mut self,
        output: &SVector<f64, M>,
        output_estimate: &SVector<f64, M>,
        teaches: bool,
    ) {
        self.held.output = *output;
        self.held.teaches = teaches;
        self.function.hold(&output.as_slice()[..self.n_outputs]);
        self.observe_again(output_estimate);
    }

    /// Takes the held output once more, against a newer estimate and newer weights.
    pub fn observe_again(&mut self, output_estimate: &SVector<f64, M>) {
        self.held.output_error = self.held.output - output_estimate;
        let open = if self.frozen || !self.held.teaches { 0.0 } else { 1.0 };
        self.held.activation = open * self.dead_zone.activation(self.held.output_error.norm());
        self.held.prior = self.function.held();
    }

    /// The weights' update if the output is held for `h_s`.
    pub fn learning(&self, h_s: f64) -> Learning<M> {
        let held = &self.held;
        if held.activation == 0.0 || h_s == 0.0 {
            return Learning { activation: held.activation, ..Learning::none() };
        }
        let activation =
            self.step_limit.limited(held.activation, STABILITY_MARGIN, h_s, held.prior.squared_features);
        Learning {
            activation,
            clamped: activation < held.activation,
            increment: h_s * activation * (self.adaptation_rate * held.output_error),
        }
    }

    /// f̂(y) at the held output after the update: `θ_{j+1}ᵀ φ = θ_jᵀ φ + φᵀφ · h σ Γ_f ỹ`.
    pub fn matched_force(&self, learning: &Learning<M>) -> Evaluation<M> {
        let prior = &self.held.prior;
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
    /// As [`Law::observe`].
    pub fn matched_force_at(&mut self, point: &SVector<f64, M>, pending: &Learning<M>) -> Evaluation<M> {
        self.function.at(&point.as_slice()[..self.n_outputs], &pending.increment)
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
        self.function.forget();
        self.held = HeldOutput::nothing();
    }

    /// Keeps what is learned by now. No allocation.
    pub fn keep_good_copy(&mut self) {
        self.function.keep_good_copy();
    }

    /// Puts back what was kept last. No allocation.
    pub fn restore_good_copy(&mut self) {
        self.function.restore_good_copy();
    }

    /// The held output, to be kept.
    pub(crate) fn kept_output(&self) -> KeptOutput<M> {
        let HeldOutput { output, output_error, activation, teaches, .. } = self.held;
        KeptOutput { output, output_error, activation, teaches }
    }

    /// How many numbers the good copy of what was learned is.
    pub(crate) fn n_kept(&self) -> usize {
        self.function.n_kept()
    }

    /// As [`LearnedFunction::read_kept`].
    pub(crate) fn read_kept(&self, from: usize, into: &mut [f64]) {
        self.function.read_kept(from, into);
    }

    /// Takes what another law of the same design has kept.
    pub(crate) fn put(&mut self, learned: &[f64]) {
        self.function.put(learned);
        self.held = HeldOutput::nothing();
    }

    /// Goes on with an output that was held.
    pub(crate) fn resume(&mut self, kept: &KeptOutput<M>) {
        self.function.hold(&kept.output.as_slice()[..self.n_outputs]);
        let KeptOutput { output, output_error, activation, teaches } = *kept;
        self.held = HeldOutput { output, output_error, activation, teaches, prior: self.function.held() };
    }

    /// f̂.
    pub fn function(&self) -> &LearnedFunction<M> {
        &self.function
    }

    /// θ of the dense solver, one run of N per output, filled up with zeros to whole lanes; empty for a local one.
    pub fn weights(&self) -> &[Vec<f64>] {
        self.function.weights()
    }

    /// The native space of f̂; of the local solver, the one of a block of neighbours.
    pub fn space(&self) -> &NativeSpace {
        self.function.space()
    }

    /// How f̂ is computed.
    pub fn solver(&self) -> SolverInUse {
        self.function.solver()
    }

    /// Bytes that a step reads.
    pub fn bytes_of_step(&self) -> usize {
        self.function.bytes_of_step()
    }

    /// m.
    pub fn n_outputs(&self) -> usize {
        self.n_outputs
    }

    /// The smallest box around the centers: its lower and its upper corner.
    pub fn bounding_box(&self) -> (&[f64], &[f64]) {
        (&self.bounding_box.0, &self.bounding_box.1)
    }

    /// σ's shape and width.
    pub fn dead_zone(&self) -> &DeadZone {
        &self.dead_zone
    }

    /// ‖f̂_N‖_H.
    pub fn native_norm(&self) -> f64 {
        self.function.native_norm()
    }

    /// ỹ of the held output.
    pub fn output_error(&self) -> &SVector<f64, M> {
        &self.held.output_error
    }

    /// The output that was taken last.
    pub fn held_output(&self) -> &SVector<f64, M> {
        &self.held.output
    }

    /// P_N at the held output; of the local solver, that of its block, which is no smaller.
    pub fn power_function(&self) -> f64 {
        self.space().power_function(self.held.prior.squared_features)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law::stability::largest_learning_rate;
    use crate::{
        Centers, Channel, ChannelDesign, DeadZoneShape, DisturbanceBounds, Integrator, Kernel, LengthScale,
        Solver,
    };
    use nalgebra::{Matrix3, Vector3};

    const UNLIMITED: StepLimit = StepLimit::OfEveryStep { largest_learning: f64::INFINITY };
    const HELD: Vector3<f64> = Vector3::new(0.3, -0.6, 0.8);
    const STEPS: usize = 20_000;

    #[derive(Clone, Copy, PartialEq)]
    enum Order {
        UpdateThenPredict,
        PredictThenUpdate,
    }

    /// A channel whose run-time clamp is out of the way: σ ≡ 1, `factor` times the adaptation rate at which the
    /// bound on the sampled law says that the fastest direction of M⁻¹Γ_f begins to diverge where the output
    /// stays at `HELD`.
    fn unlimited_channel(
        inertia: Matrix3<f64>,
        rate: Matrix3<f64>,
        (gain_per_s, h_s): (f64, f64),
        factor: f64,
    ) -> (Law<3>, Integrator) {
        let dead_zone = DeadZone::new(DeadZoneShape::Step, 0.0, 1.0).unwrap();
        let design = ChannelDesign {
            kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
            length_scale: LengthScale::Isotropic(1.0),
            centers: Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]).unwrap(),
            nugget: 0.0,
            solver: Solver::Dense,
            inertia,
            gain_per_s,
            adaptation_rate: 1e-6 * rate,
            dead_zone,
            bounds: DisturbanceBounds::default(),
            hold_s: h_s,
            coast_step_s: h_s,
        };
        let Channel { law, integrator } = Channel::new(&design).unwrap();
        let power = law.space().power_function_at(HELD.as_slice());
        let squared_features = law.space().value_at_zero() - power * power;
        // The eigenvalues of M⁻¹Γ_f by LU and Schur, where the library has a Cholesky factor and symmetric ones.
        let learning = inertia.lu().solve(&rate).unwrap().complex_eigenvalues();
        let fastest = learning.iter().map(|eigenvalue| eigenvalue.re).fold(0.0, f64::max);
        let scale = factor * largest_learning_rate(gain_per_s, h_s) / (fastest * squared_features);
        let function = law.function().clone();
        (Law::new(function, &design.centers, dead_zone, scale * rate, UNLIMITED), integrator)
    }

    /// The largest output error in the first and in the last tenth of a run at a frozen output, with nothing to
    /// learn. Stops early, with +∞, where it has grown a million times.
    fn first_and_last_error(
        (mut law, integrator): (Law<3>, Integrator),
        h_s: f64,
        order: Order,
    ) -> (f64, f64) {
        let start = Vector3::new(0.1, 0.1, -0.1);
        let mut estimate = HELD - start;
        let (mut first, mut last) = (0.0_f64, 0.0_f64);
        for j in 0..STEPS {
            law.observe(&HELD, &estimate);
            let learning = law.learning(h_s);
            assert!(!learning.clamped && learning.activation == 1.0, "the law itself is on trial");
            let prior = Learning { activation: 1.0, ..Learning::none() };
            let known = if order == Order::UpdateThenPredict { &learning } else { &prior };
            estimate = integrator.follow(&estimate, &HELD, &law.matched_force(known).value, h_s).end;
            law.learn(&learning);
            let error = (HELD - estimate).norm();
            if error > 1e6 * start.norm() {
                return (first, f64::INFINITY);
            }
            // Rounding would bring ‖ỹ‖ to an exact 0, where a step dead zone of width 0 has σ = 1 all the same.
            first = if j < STEPS / 10 { first.max(error) } else { first };
            last = if j >= STEPS - STEPS / 10 { last.max(error) } else { last };
        }
        (first, last)
    }

    fn isotropic_and_full() -> [(Matrix3<f64>, Matrix3<f64>); 2] {
        [
            (Matrix3::identity() * 4.0, Matrix3::identity()),
            (
                Matrix3::new(4.0, 1.5, 0.0, 1.5, 3.0, 0.2, 0.0, 0.2, 5.0),
                Matrix3::new(0.8, 0.3, 0.0, 0.3, 1.2, -0.4, 0.0, -0.4, 1.0),
            ),
        ]
    }

    #[test]
    fn one_percent_inside_of_the_sampled_bound_the_law_settles_and_one_percent_outside_it_diverges() {
        for (inertia, rate) in isotropic_and_full() {
            for sampling in [(10.0, 0.005), (4.0, 0.05)] {
                let end = |factor| {
                    let channel = unlimited_channel(inertia, rate, sampling, factor);
                    first_and_last_error(channel, sampling.1, Order::UpdateThenPredict)
                };
                let (first, last) = end(0.99);
                // The alternating eigenvalue lies near −1 and is not normal to the other: a factor 2/(1 − E) < 50.
                assert!(first < 50.0 && last < 1e-3, "λ, h {sampling:?}: {first} … {last}");
                assert_eq!(end(1.01).1, f64::INFINITY, "λ, h {sampling:?}");
            }
        }
    }

    /// Predict first, and determinant E + b h g/m of the error's map passes 1 at g h = λ m: 2 (1 + E)/(1 − E) ≈
    /// 4/(λh) times earlier, 80 times at λ = 10 1/s and 200 Hz, 400 times at λ = 2 1/s.
    #[test]
    fn predicting_before_the_update_diverges_at_a_rate_eighty_to_four_hundred_times_lower() {
        let (inertia, rate) = (Matrix3::identity() * 4.0, Matrix3::identity());
        for (gain, ratio) in [(10.0, 80.0), (2.0, 400.0)] {
            let end = |factor, order| {
                first_and_last_error(unlimited_channel(inertia, rate, (gain, 0.005), factor), 0.005, order)
            };
            // The pair of eigenvalues has the modulus 1 ± 0.025 (1 − E): e^{±2.2} in all at least.
            let (first, last) = end(0.95 / ratio, Order::PredictThenUpdate);
            assert!(last < 0.3 * first, "inside: {first} … {last}");
            let (first, last) = end(1.05 / ratio, Order::PredictThenUpdate);
            assert!(last > 3.0 * first, "outside: {first} … {last}");
            let (first, last) = end(1.05 / ratio, Order::UpdateThenPredict);
            assert!(last < 0.3 * first, "update first bears it: {first} … {last}");
        }
    }
}
