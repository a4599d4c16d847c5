//! A general linear plant with the law: `x' = A x + B (u + f(y)) + ξ`, `y = C x + δ`.
//!
//! ```text
//! x̂' = A x̂ + L ỹ + B (u + f̂_N(y)),    θ' = σ(‖ỹ‖) φ(y) (Γ_f ỹ)ᵀ,    ỹ = y − C x̂
//! ```
//!
//! sampled as the rigid body's channels are, update first, then predict, exact for held inputs:
//!
//! ```text
//! x̂_{j+1} = x̂_j + ∫₀^h e^{A_e s} ds · (A_e x̂_j + L y + B (u + f̂)),    A_e = A − LC
//! ```
//!
//! which is e^{A_e h} x̂_j + ∫₀^h e^{A_e s} ds (L y + B (u + f̂)); while coasting, A stands for A_e and L for 0.
//!
//! | symbol | name | shape |
//! |---|---|---|
//! | x, x̂ | `state` | n ≤ 12 |
//! | u, y, f̂ | `input`, `output`, `matched_input` | m ≤ 6 |
//! | A, B, C, L | `a`, `b`, `c`, `gain` | n×n, n×m, m×n, n×m |
//!
//! # Source
//! Niu et al., eqs. (plant dynamics), (state estimator), (final learning laws).

use crate::function::learned::LearnedFunction;
use crate::innovation_gate::Plausibility;
use crate::law::channel::{DisturbanceBounds, positive, positive_definite};
use crate::law::gradient::Law;
use crate::law::stability::StepLimit;
use crate::report::certificate::{Certificate, sup_if_needed};
use crate::report::linear_algebra::{
    LurePair, complement, eigenvalues, lure_pair, reachable_subspace, spectral_abscissa, spectral_norm,
};
use crate::timeline::{ChannelReport, ChannelState, Measured, Moment, Plant, Timeline};
use crate::{Centers, DeadZone, DesignError, Kernel, LengthScale, Parameter, ScaledKernel, Solver};
use nalgebra::{Complex, DMatrix, DVector, SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// The largest n.
pub const MAX_STATES: usize = 12;
/// The largest m.
pub const MAX_OUTPUTS: usize = 6;
/// The largest ‖A‖ h: beyond, e^{Ah} says nothing any more.
const LARGEST_GROWTH: f64 = 1e6;

/// x̂, its first n entries; the others are 0.
pub type LinearState = SVector<f64, MAX_STATES>;
/// u, y or f̂, the first m entries; the others are 0.
pub type LinearOutput = SVector<f64, MAX_OUTPUTS>;

/// Everything that the observer of a linear plant is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearDesign {
    /// A, n×n.
    pub a: DMatrix<f64>,
    /// B, n×m.
    pub b: DMatrix<f64>,
    /// C, m×n.
    pub c: DMatrix<f64>,
    /// L, n×m.
    pub gain: DMatrix<f64>,
    /// κ.
    pub kernel: Kernel,
    /// ℓ > 0, in the output's unit.
    pub length_scale: LengthScale,
    /// Ξ_N, points of ℝ^m.
    pub centers: Centers,
    /// Added to the Gram matrix's diagonal, as a multiple of κ(0); ≥ 0.
    pub nugget: f64,
    /// How f̂ is computed.
    pub solver: Solver,
    /// Γ_f, m×m, symmetric positive definite.
    pub adaptation_rate: DMatrix<f64>,
    /// σ.
    pub dead_zone: DeadZone,
    /// What is known of the disturbances; ξ̄ bounds a rate of the state.
    pub bounds: DisturbanceBounds,
    /// An output is held for at most this long (s).
    pub hold_s: f64,
    /// Step of coasting (s).
    pub coast_step_s: f64,
    /// x̂(0); `None` takes the least x̂ with C x̂ = y at the first output.
    pub initial_state: Option<DVector<f64>>,
}

/// The part of a plant that its outputs tell of: in coordinates x_o = Oᵀx, with O an orthonormal basis of the
/// observable subspace. What is unobservable does not act on it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ObservablePart {
    pub(crate) a: DMatrix<f64>,
    pub(crate) b: DMatrix<f64>,
    pub(crate) c: DMatrix<f64>,
    pub(crate) gain: DMatrix<f64>,
}

impl ObservablePart {
    pub(crate) fn error_dynamics(&self) -> DMatrix<f64> {
        &self.a - &self.gain * &self.c
    }

    pub(crate) fn lure_pair(&self) -> Result<LurePair, String> {
        lure_pair(&self.error_dynamics(), &self.b, &self.c, &self.gain)
    }
}

impl LinearDesign {
    /// n.
    pub fn n_states(&self) -> usize {
        self.a.nrows()
    }

    /// m.
    pub fn n_outputs(&self) -> usize {
        self.c.nrows()
    }

    /// A_e = A − LC.
    pub fn error_dynamics(&self) -> DMatrix<f64> {
        &self.a - &self.gain * &self.c
    }

    /// An orthonormal basis of the unobservable subspace of (A, C), n×(n−r).
    pub fn unobservable_subspace(&self) -> DMatrix<f64> {
        complement(&reachable_subspace(&self.a.transpose(), &self.c.transpose()))
    }

    pub(crate) fn observable_part(&self) -> ObservablePart {
        let basis = reachable_subspace(&self.a.transpose(), &self.c.transpose());
        // All of it: keep the plant's own coordinates.
        let basis = match basis.ncols() == self.n_states() {
            true => DMatrix::identity(self.n_states(), self.n_states()),
            false => basis,
        };
        let transposed = basis.transpose();
        ObservablePart {
            a: &transposed * &self.a * &basis,
            b: &transposed * &self.b,
            c: &self.c * &basis,
            gain: &transposed * &self.gain,
        }
    }

    /// f̂ = 0 with the design's solver; whether the observer is stable is another question.
    ///
    /// # Errors
    /// As [`LinearObserver::new`], but for what is stable.
    ///
    /// # Cost
    /// As [`crate::NativeSpace::new`] with the dense solver.
    pub fn function(&self) -> Result<LearnedFunction<MAX_OUTPUTS>, DesignError> {
        self.check()?;
        LearnedFunction::zero((self.kernel, &self.length_scale), &self.centers, self.nugget, &self.solver)
    }

    fn check(&self) -> Result<(), DesignError> {
        let (n, m) = (self.a.nrows(), self.b.ncols());
        let refuse =
            |parameter, found: String, needed: String| Err(DesignError::new(parameter, found, needed));
        if !(1..=MAX_STATES).contains(&n) || self.a.ncols() != n {
            let found = format!("A of {}×{}", n, self.a.ncols());
            return refuse(Parameter::Plant, found, format!("a square A with 1 to {MAX_STATES} states"));
        }
        if !(1..=MAX_OUTPUTS.min(n)).contains(&m) {
            let needed = format!("1 to {} inputs, as many as outputs", MAX_OUTPUTS.min(n));
            return refuse(Parameter::PlantInput, format!("B with {m} columns"), needed);
        }
        for (parameter, name, matrix, rows, columns) in [
            (Parameter::PlantInput, "B", &self.b, n, m),
            (Parameter::PlantOutput, "C", &self.c, m, n),
            (Parameter::Gain, "L", &self.gain, n, m),
            (Parameter::AdaptationRate, "Γ_f", &self.adaptation_rate, m, m),
        ] {
            if matrix.shape() != (rows, columns) {
                let found = format!("{name} of {}×{}", matrix.nrows(), matrix.ncols());
                return refuse(parameter, found, format!("{rows}×{columns}, as A is {n}×{n} and B {n}×{m}"));
            }
        }
        for (parameter, name, matrix) in [
            (Parameter::Plant, "A", &self.a),
            (Parameter::PlantInput, "B", &self.b),
            (Parameter::PlantOutput, "C", &self.c),
            (Parameter::Gain, "L", &self.gain),
        ] {
            if matrix.iter().any(|entry| !entry.is_finite()) {
                return refuse(
                    parameter,
                    format!("{name} with an entry that is not finite"),
                    "finite numbers".into(),
                );
            }
        }
        for (parameter, name, matrix) in
            [(Parameter::PlantInput, "B", &self.b), (Parameter::PlantOutput, "C", &self.c)]
        {
            let sizes = matrix.singular_values();
            if sizes.min() <= 1e-9 * sizes.max() {
                let found = format!("{name} with singular values {:?}", sizes.as_slice());
                return refuse(
                    parameter,
                    found,
                    format!("{m} independent directions: nothing can be learned along the others"),
                );
            }
        }
        let growth =
            self.a.amax().max(self.error_dynamics().amax()) * n as f64 * self.hold_s.max(self.coast_step_s);
        if growth > LARGEST_GROWTH {
            let found = format!(
                "A or A − LC that changes the state {growth:.1e} times within a hold of {} s",
                self.hold_s
            );
            return refuse(
                Parameter::Plant,
                found,
                format!("at most {LARGEST_GROWTH:.0e}: a shorter hold, or other units"),
            );
        }
        if self.centers.dimension() != m {
            let found = format!("centers with {} coordinates", self.centers.dimension());
            return refuse(Parameter::Centers, found, format!("{m}, one per output"));
        }
        if let Some(initial) = &self.initial_state
            && (initial.len() != n || initial.iter().any(|x| !x.is_finite()))
        {
            return refuse(
                Parameter::InitialState,
                format!("{:?}", initial.as_slice()),
                format!("{n} finite numbers"),
            );
        }
        positive(Parameter::Hold, self.hold_s)?;
        positive(Parameter::CoastStep, self.coast_step_s)?;
        self.bounds.check()?;
        positive_definite(Parameter::AdaptationRate, &self.adaptation_rate)
    }
}

/// The adaptive observer of a linear plant (Niu et al., eqs. (state estimator), (final learning laws)).
///
/// Samples go in with their stamps; estimates come out for any instant not before the newest sample. The same
/// samples give the same bits, whoever asks and whenever.
#[derive(Debug, Clone)]
pub struct LinearObserver {
    timeline: Timeline<LinearPlant, MAX_OUTPUTS>,
    teaches: bool,
}

/// All that the future of a [`LinearObserver`] depends on, beside what it learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LinearObserverState(ChannelState<LinearState, MAX_OUTPUTS>);

impl LinearObserverState {
    /// x̂ at the newest sample.
    pub fn state(&self) -> LinearState {
        self.0.newest()
    }

    /// Stamp of the newest sample (ns); `None` before the first output.
    pub fn stamp_ns(&self) -> Option<u64> {
        self.0.stamp_ns()
    }
}

/// State, learned input and trust at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearEstimate {
    /// Time of the state (ns).
    pub stamp_ns: u64,
    /// x̂.
    pub state: LinearState,
    /// f̂.
    pub matched_input: LinearOutput,
    /// How far it can be trusted.
    pub report: ChannelReport,
}

impl LinearObserver {
    /// Checks the design and builds the observer. Everything is allocated here.
    ///
    /// # Errors
    /// `Plant`, `Gain`, `AdaptationRate`, … where a shape or a number is wrong; `Gain` where the observable part of
    /// A − LC is not Hurwitz; `AdaptationRate` beyond the sampled-data bound; `Centers` as
    /// [`crate::NativeSpace::new`].
    pub fn new(design: &LinearDesign) -> Result<Self, DesignError> {
        design.check()?;
        let kernel = ScaledKernel::new(design.kernel, &design.length_scale, design.n_outputs())?;
        let part = design.observable_part();
        let slowest = spectral_abscissa(&part.error_dynamics());
        if slowest >= 0.0 {
            return Err(DesignError::new(
                Parameter::Gain,
                format!("A − LC with a pole at {slowest:.3e} 1/s on the observable subspace"),
                "a gain L that moves all of these poles to the left half plane",
            ));
        }
        let hidden = design.unobservable_subspace();
        let drift = spectral_abscissa(&(hidden.transpose() * &design.a * &hidden));
        if drift > 1e-9 * (1.0 + design.a.amax()) {
            return Err(DesignError::new(
                Parameter::PlantOutput,
                format!("a mode that no output tells of and that grows by itself, at {drift:.3e} 1/s"),
                "outputs from which every unstable mode is seen (a detectable plant)",
            ));
        }
        let largest_learning = largest_learning_of_every_step(design);
        let factor = largest_learning / kernel.value_at_zero();
        if factor <= 1.0 {
            let largest = design.adaptation_rate.clone().symmetric_eigenvalues().max();
            let needed = match factor > 0.0 {
                true => format!("an adaptation rate below {:.4}, or a shorter hold", largest * factor),
                false => {
                    "a plant and gain that are strictly positive real from B to C: with these no adaptation \
                          rate is stable"
                        .into()
                }
            };
            return Err(DesignError::new(
                Parameter::AdaptationRate,
                format!("{largest} is unstable when an output is held for {} s", design.hold_s),
                needed,
            ));
        }
        let function = design.function()?;
        let certificate = part.lure_pair().ok().map(|pair| {
            Certificate::new(
                (pair.lambda_min, pair.pl_norm),
                (spectral_norm(&part.c), pair.p_norm),
                design.bounds,
                &design.dead_zone,
                sup_if_needed(&design.bounds, || function.space().sup_power_function()),
            )
        });
        let law = Law::new(
            function,
            &design.centers,
            design.dead_zone,
            padded(&design.adaptation_rate),
            StepLimit::OfEveryStep { largest_learning },
        );
        let plant = LinearPlant::new(design);
        let initial = plant.initial_state.unwrap_or_default();
        let steps_s = (design.hold_s, design.coast_step_s);
        Ok(Self { timeline: Timeline::new(law, plant, certificate, steps_s, initial), teaches: true })
    }

    /// Takes what was measured and commanded at `stamp_ns`, later than the sample before. All values are finite:
    /// the caller checks.
    ///
    /// # Cost
    /// One evaluation of the features with a new output; no allocation.
    pub fn accept(&mut self, stamp_ns: u64, output: Option<LinearOutput>, input: Option<LinearOutput>) {
        // What is beyond m is nobody's.
        let m = self.timeline.law.n_outputs();
        let own = |vector: LinearOutput| LinearOutput::from_fn(|i, _| if i < m { vector[i] } else { 0.0 });
        let measured = output.map(|output| Measured { output: own(output), teaches: self.teaches });
        self.timeline.accept(stamp_ns, measured, input.map(own), |_| {});
    }

    /// Whether the outputs from now on may be learned from: not while their sensor is stuck, say.
    pub fn set_teaching(&mut self, teaches: bool) {
        self.teaches = teaches;
    }

    /// From now on outputs are judged by this; at first all are believed.
    pub fn set_plausibility(&mut self, plausibility: Plausibility) {
        self.timeline.set_plausibility(plausibility);
    }

    /// Outputs that stood out and were held back.
    pub fn n_held_back(&self) -> u64 {
        self.timeline.n_held_back()
    }

    /// The state of the last good copy.
    pub fn kept_state(&self) -> Option<LinearObserverState> {
        self.timeline.kept_state().map(LinearObserverState)
    }

    /// How many numbers the good copy of what was learned is.
    pub fn n_kept(&self) -> usize {
        self.timeline.law.n_kept()
    }

    /// The numbers of the good copy from `from` on, as many as `into` has room for.
    pub fn read_kept(&self, from: usize, into: &mut [f64]) {
        self.timeline.law.read_kept(from, into);
    }

    /// Takes what an observer of the same design has learned.
    ///
    /// # Panics
    /// With another count of numbers than [`LinearObserver::n_kept`].
    pub fn put(&mut self, learned: &[f64]) {
        self.timeline.law.put(learned);
    }

    /// Goes on from a state that an observer of the same design has kept, after [`LinearObserver::put`].
    pub fn resume(&mut self, kept: &LinearObserverState) {
        self.timeline.resume(&kept.0);
    }

    /// The estimate at `stamp_ns`, or at the newest sample where that is later. No allocation.
    pub fn estimate(&mut self, stamp_ns: u64) -> LinearEstimate {
        let at = self.timeline.predict(stamp_ns);
        LinearEstimate {
            stamp_ns,
            state: at.moment.state,
            matched_input: at.matched_force.value,
            report: self.timeline.report(&at, stamp_ns),
        }
    }

    /// Stops or resumes learning from the next outputs on; what was learned stays in use.
    pub fn set_frozen(&mut self, frozen: bool) {
        self.timeline.law.set_frozen(frozen);
    }

    /// Forgets everything; starts again from the next sample.
    pub fn reset(&mut self) {
        self.timeline.restart();
        self.timeline.law.forget();
    }

    /// Forgets the state, not what was learned.
    pub fn restart(&mut self) {
        self.timeline.restart();
    }

    /// Keeps a copy of state and weights. Call it while they are known to be good.
    pub fn keep_good_copy(&mut self) {
        self.timeline.keep_good_copy();
    }

    /// Puts state and weights back to the last good copy.
    pub fn restore_good_copy(&mut self) {
        self.timeline.restore_good_copy();
    }

    /// Forgets all, in the good copy too.
    pub fn forget(&mut self) {
        self.timeline.forget();
    }

    /// The law, its space and weights.
    pub fn law(&self) -> &Law<MAX_OUTPUTS> {
        &self.timeline.law
    }

    /// What the theorems claim; `None` where the error dynamics are not strictly positive real.
    pub fn certificate(&self) -> Option<&Certificate> {
        self.timeline.certificate.as_ref()
    }
}

type StateMatrix = SMatrix<f64, MAX_STATES, MAX_STATES>;

/// A smaller matrix in the upper left corner of a fixed one.
fn padded<const R: usize, const C: usize>(matrix: &DMatrix<f64>) -> SMatrix<f64, R, C> {
    SMatrix::from_fn(|i, j| matrix.get((i, j)).copied().unwrap_or(0.0))
}

/// `x̂' = A x̂ + L (y − C x̂) + B F` in arrays of fixed size, so that steps allocate nothing.
#[derive(Debug, Clone)]
struct LinearPlant {
    n_states: usize,
    a: StateMatrix,
    a_e: StateMatrix,
    b: SMatrix<f64, MAX_STATES, MAX_OUTPUTS>,
    c: SMatrix<f64, MAX_OUTPUTS, MAX_STATES>,
    gain: SMatrix<f64, MAX_STATES, MAX_OUTPUTS>,
    /// Cᵀ(CCᵀ)⁺.
    c_pseudo_inverse: SMatrix<f64, MAX_STATES, MAX_OUTPUTS>,
    initial_state: Option<LinearState>,
    holding: HeldIntegral,
    coasting: HeldIntegral,
}

/// ∫₀^h e^{Ms} ds of the step before: most steps are as long as the one before.
#[derive(Debug, Clone, Copy)]
struct HeldIntegral {
    h_s: f64,
    integral: StateMatrix,
}

impl HeldIntegral {
    fn of(&mut self, m: &StateMatrix, n: usize, h_s: f64) -> &StateMatrix {
        if self.h_s != h_s {
            *self = Self { h_s, integral: held_integral(m, n, h_s) };
        }
        &self.integral
    }
}

/// `∫₀^h e^{Ms} ds = h Σ_k (Mh)^k / (k+1)!` of the leading n×n block, by the series on h/2^q with ‖M‖h/2^q ≤ 1/4 and
/// `Ψ(2h) = Ψ(h) (2I + MΨ(h))`.
fn held_integral(m: &StateMatrix, n: usize, h_s: f64) -> StateMatrix {
    let norm = m.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max);
    let doublings = (4.0 * norm * h_s).max(1.0).log2().ceil() as i32;
    let step_s = h_s / 2.0_f64.powi(doublings);
    let scaled = m * step_s;
    let mut term = StateMatrix::identity();
    let mut sum = term;
    // The first term left out is below (1/4)^13/14! of the sum.
    for k in 1..=12 {
        term = block_product(&scaled, &term, n) / (k + 1) as f64;
        sum += term;
    }
    let mut integral = sum * step_s;
    for _ in 0..doublings {
        let grown = StateMatrix::identity() * 2.0 + block_product(m, &integral, n);
        integral = block_product(&integral, &grown, n);
    }
    integral
}

/// The product of the leading n×n blocks: most plants have few states.
fn block_product(a: &StateMatrix, b: &StateMatrix, n: usize) -> StateMatrix {
    let mut product = StateMatrix::zeros();
    for j in 0..n {
        for k in 0..n {
            for i in 0..n {
                product[(i, j)] += a[(i, k)] * b[(k, j)];
            }
        }
    }
    product
}

impl LinearPlant {
    fn new(design: &LinearDesign) -> Self {
        let pseudo_inverse = design.c.clone().pseudo_inverse(1e-12).expect("the tolerance is not negative");
        let never = HeldIntegral { h_s: 0.0, integral: StateMatrix::zeros() };
        Self {
            n_states: design.n_states(),
            a: padded(&design.a),
            a_e: padded(&design.error_dynamics()),
            b: padded(&design.b),
            c: padded(&design.c),
            gain: padded(&design.gain),
            c_pseudo_inverse: padded(&pseudo_inverse),
            initial_state: design
                .initial_state
                .as_ref()
                .map(|x| LinearState::from_fn(|i, _| x.get(i).copied().unwrap_or(0.0))),
            holding: never,
            coasting: never,
        }
    }
}

impl Plant<MAX_OUTPUTS> for LinearPlant {
    type State = LinearState;

    fn output(&self, state: &LinearState) -> LinearOutput {
        self.c * state
    }

    fn start(&self, waiting: &LinearState, output: &LinearOutput) -> LinearState {
        if self.initial_state.is_some() { *waiting } else { self.c_pseudo_inverse * output }
    }

    fn resumed(&self, _own: &LinearState, kept: &LinearState) -> LinearState {
        *kept
    }

    fn follow(
        &mut self,
        at: &Moment<LinearState>,
        output: &LinearOutput,
        force: &LinearOutput,
        h_s: f64,
    ) -> LinearState {
        let slope = self.a_e * at.state + self.gain * output + self.b * force;
        at.state + self.holding.of(&self.a_e, self.n_states, h_s) * slope
    }

    fn coast(&mut self, at: &Moment<LinearState>, force: &LinearOutput, h_s: f64) -> LinearState {
        let slope = self.a * at.state + self.b * force;
        at.state + self.coasting.of(&self.a, self.n_states, h_s) * slope
    }
}

/// The largest σ φᵀφ (1/s²) that keeps the sampled law stable for every step up to the longest hold; 0 where none does.
///
/// With the output frozen at y, the errors e of the state and F of the matched input follow, on the observable part,
///
/// ```text
/// F⁺ = F − s Γ_f C e,    e⁺ = e^{A_e h} e + ∫₀^h e^{A_e τ} dτ B F⁺,    s = h σ φᵀφ
/// ```
///
/// The bound is where the spectral radius of this map first exceeds 1; it has no closed form here. It is looked for
/// on a grid of steps, fine against the fastest oscillation of A_e, and in the limit of short steps, that of the
/// continuous law.
pub(crate) fn largest_learning_of_every_step(design: &LinearDesign) -> f64 {
    let part = design.observable_part();
    let fastest = eigenvalues(&part.error_dynamics()).iter().map(|pole| pole.im.abs()).fold(0.0, f64::max);
    let n_steps = (8.0 * fastest * design.hold_s).ceil().clamp(24.0, 400.0) as usize;
    let grid = (1..=n_steps).map(|i| i as f64 / n_steps as f64);
    grid.map(|share| share * design.hold_s)
        .map(|h_s| largest_gain(&part, &design.adaptation_rate, h_s) / h_s)
        .chain([largest_continuous_learning(&part, &design.adaptation_rate)])
        .fold(f64::INFINITY, f64::min)
}

fn largest_gain(part: &ObservablePart, adaptation_rate: &DMatrix<f64>, h_s: f64) -> f64 {
    let (n, m) = part.b.shape();
    let a_e = part.error_dynamics();
    let integral = held_integral(&padded(&a_e), n, h_s);
    let integral = DMatrix::from_fn(n, n, |i, j| integral[(i, j)]);
    let transition = DMatrix::identity(n, n) + &a_e * &integral;
    let to_state = &integral * &part.b;
    let learning = adaptation_rate * &part.c;
    let excess = |s: f64| {
        let mut map = DMatrix::identity(n + m, n + m);
        map.view_mut((n, 0), (m, n)).copy_from(&(-s * &learning));
        map.view_mut((0, n), (n, m)).copy_from(&to_state);
        map.view_mut((0, 0), (n, n)).copy_from(&(&transition - s * &to_state * &learning));
        let size = |x: &Complex<f64>| if x.re.is_nan() { f64::INFINITY } else { x.norm() };
        eigenvalues(&map).iter().map(size).fold(0.0, f64::max) - 1.0
    };
    // Where s ‖∫e^{A_e τ}B‖ ‖Γ_f C‖ is 1, learning acts within a step.
    first_crossing(1.0 / (spectral_norm(&to_state) * spectral_norm(&learning)), excess)
}

/// The largest σ φᵀφ of the continuous law, `e' = A_e e + B F,  F' = −σ φᵀφ Γ_f C e`: the limit of short steps.
fn largest_continuous_learning(part: &ObservablePart, adaptation_rate: &DMatrix<f64>) -> f64 {
    let (n, m) = part.b.shape();
    let a_e = part.error_dynamics();
    let learning = adaptation_rate * &part.c;
    let rate = spectral_norm(&a_e);
    let excess = |g: f64| {
        let mut dynamics = DMatrix::zeros(n + m, n + m);
        dynamics.view_mut((0, 0), (n, n)).copy_from(&a_e);
        dynamics.view_mut((0, n), (n, m)).copy_from(&part.b);
        dynamics.view_mut((n, 0), (m, n)).copy_from(&(-g * &learning));
        spectral_abscissa(&dynamics) / rate
    };
    first_crossing(rate * rate / (spectral_norm(&part.b) * spectral_norm(&learning)), excess)
}

/// The least x > 0 from which on `excess` is positive, looked for from far below `unit`, the size that x has as a rule,
/// to far above; 0 where it is positive from the start.
fn first_crossing(unit: f64, excess: impl Fn(f64) -> f64) -> f64 {
    // Where x is small, the largest eigenvalue is at the edge of stability, up to rounding.
    const ROUNDING: f64 = 1e-8;
    let scan = |from: f64, to: f64, steps: i32| {
        (0..=steps).map(move |i| from * (to / from).powf(f64::from(i) / f64::from(steps)))
    };
    let (mut below, mut above) = (0.0, None);
    for x in scan(1e-10 * unit, 1e5 * unit, 60) {
        if excess(x) > ROUNDING {
            above = Some(x);
            break;
        }
        below = x;
    }
    while let Some(mut outside) = above {
        if below == 0.0 {
            return 0.0;
        }
        for _ in 0..40 {
            let middle = 0.5 * (below + outside);
            if excess(middle) <= ROUNDING { below = middle } else { outside = middle }
        }
        // What grows with x from the start only seemed stable where rounding hid it.
        if (0.3 * ROUNDING..=ROUNDING).contains(&excess(0.5 * below)) {
            return 0.0;
        }
        // A narrow window of instability may lie before.
        let mut last = 0.0;
        above = scan(0.05 * below, 0.999 * below, 24).find(|&x| {
            let is_outside = excess(x) > ROUNDING;
            last = if is_outside { last } else { x };
            is_outside
        });
        below = if above.is_some() { last } else { below };
    }
    below
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DeadZoneShape;

    fn matrix(rows: usize, entries: &[f64]) -> DMatrix<f64> {
        DMatrix::from_row_slice(rows, entries.len() / rows, entries)
    }

    /// A mass on a spring whose sensor mixes position and velocity, so that the transfer function
    /// (s + 2)/(s² + …) is strictly positive real: x = (r, v), m = 2.
    pub(crate) fn oscillator() -> LinearDesign {
        LinearDesign {
            a: matrix(2, &[0.0, 1.0, -3.0, -0.2]),
            b: matrix(2, &[0.0, 0.5]),
            c: matrix(1, &[2.0, 1.0]),
            gain: matrix(2, &[1.0, 8.0]),
            kernel: Kernel::SobolevMatern { dimension: 1, order: 2 },
            length_scale: LengthScale::Isotropic(1.0),
            centers: Centers::lattice([-3.0], [3.0], [13]).unwrap(),
            nugget: 0.0,
            solver: Solver::Dense,
            adaptation_rate: matrix(1, &[50.0]),
            dead_zone: DeadZone::new(DeadZoneShape::Saturated, 1e-4, 1e-4).unwrap(),
            bounds: DisturbanceBounds::default(),
            hold_s: 0.0075,
            coast_step_s: 0.005,
            initial_state: Some(DVector::from_vec(vec![0.5, 0.0])),
        }
    }

    /// Against nalgebra's matrix exponential of [[M, I], [0, 0]], whose upper right block is the integral.
    #[test]
    fn the_held_integral_is_that_of_the_matrix_exponential() {
        let small = matrix(3, &[-2.0, 1.0, 0.5, 3.0, -40.0, 2.0, 0.0, 7.0, 1.0]);
        for h in [1e-6, 0.005, 0.3, 1.5] {
            let mut block = DMatrix::zeros(6, 6);
            block.view_mut((0, 0), (3, 3)).copy_from(&(&small * h));
            block.view_mut((0, 3), (3, 3)).copy_from(&(DMatrix::<f64>::identity(3, 3) * h));
            let expected = block.exp();
            let found = held_integral(&padded(&small), 3, h);
            for i in 0..3 {
                for j in 0..3 {
                    let size = expected.view((0, 3), (3, 3)).amax();
                    assert!((found[(i, j)] - expected[(i, 3 + j)]).abs() < 1e-13 * size, "h {h}");
                }
            }
        }
    }

    /// The oscillator driven by u, with the unknown force −0.8 y |y|, by RK4 with small steps.
    fn run(
        observer: &mut LinearObserver,
        n: u64,
        measured: impl Fn(u64) -> bool,
    ) -> (LinearEstimate, DVector<f64>, f64) {
        let design = oscillator();
        let (h, substeps) = (0.005, 10);
        let force = |y: f64| -0.8 * y * y.abs();
        let mut x = DVector::from_vec(vec![0.5, 0.0]);
        for j in 0..n {
            let u = 4.0 * (0.9 * j as f64 * h).sin() + 2.0 * (2.3 * j as f64 * h).cos();
            let y = (&design.c * &x)[0];
            let output = measured(j).then(|| LinearOutput::from_fn(|i, _| if i == 0 { y } else { 0.0 }));
            let input = LinearOutput::from_fn(|i, _| if i == 0 { u } else { 0.0 });
            observer.accept(j * 5_000_000, output, Some(input));
            let slope = |x: &DVector<f64>| &design.a * x + &design.b * (u + force((&design.c * x)[0]));
            let dt = h / f64::from(substeps);
            for _ in 0..substeps {
                let k1 = slope(&x);
                let k2 = slope(&(&x + 0.5 * dt * &k1));
                let k3 = slope(&(&x + 0.5 * dt * &k2));
                let k4 = slope(&(&x + dt * &k3));
                x += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
            }
        }
        let y = (&design.c * &x)[0];
        (observer.estimate(n * 5_000_000), x, force(y))
    }

    #[test]
    fn the_force_on_an_oscillator_is_learned_and_carries_it_through_an_outage() {
        let coast_error = |frozen: bool| {
            let mut observer = LinearObserver::new(&oscillator()).unwrap();
            observer.set_frozen(frozen);
            // A minute of measurements, then half a second without.
            let (estimate, truth, _) = run(&mut observer, 12_100, |j| j < 12_000);
            assert!(estimate.report.coasting);
            (estimate.state.fixed_rows::<2>(0) - truth.fixed_rows::<2>(0)).norm()
        };
        let (with, without) = (coast_error(false), coast_error(true));
        assert!(with < 0.3 * without, "{with} with, {without} without learning");

        let mut observer = LinearObserver::new(&oscillator()).unwrap();
        let (estimate, truth, force) = run(&mut observer, 12_000, |_| true);
        assert!((estimate.state[0] - truth[0]).abs() < 5e-3 && (estimate.state[1] - truth[1]).abs() < 2e-2);
        assert!((estimate.matched_input[0] - force).abs() < 0.1, "{} {force}", estimate.matched_input[0]);
        assert!(estimate.state.iter().skip(2).all(|&x| x == 0.0));
    }

    /// The clamp and the refusal rest on the spectral radius of the frozen-output map; for a plant that is a
    /// channel of the rigid body the closed form says the same.
    #[test]
    fn the_bound_of_a_channel_is_the_closed_form() {
        let (mass, gain, rate, h) = (4.0, 10.0, 100.0, 0.0075);
        let identity = DMatrix::<f64>::identity(3, 3);
        let design = LinearDesign {
            a: DMatrix::zeros(3, 3),
            b: &identity / mass,
            c: identity.clone(),
            gain: gain * &identity,
            adaptation_rate: rate * &identity,
            centers: Centers::lattice([-1.0; 3], [1.0; 3], [2; 3]).unwrap(),
            hold_s: h,
            initial_state: None,
            ..oscillator()
        };
        for h in [h, 0.1, 1.0] {
            let closed = crate::law::stability::largest_learning_rate(gain, h) * h * mass / rate;
            assert!(
                (largest_gain(&design.observable_part(), &design.adaptation_rate, h) / closed - 1.0).abs()
                    < 1e-6,
                "h {h}"
            );
        }
    }

    /// The bound of the law itself, with its clamp out of the way: the oscillator at rest at y = 0, σ ≡ 1,
    /// nothing to learn.
    #[test]
    fn one_percent_inside_of_the_general_bound_the_law_settles_and_one_percent_outside_it_diverges() {
        let unlimited = StepLimit::OfEveryStep { largest_learning: f64::INFINITY };
        let dead_zone = DeadZone::new(DeadZoneShape::Step, 0.0, 1.0).unwrap();
        let design = oscillator();
        let function = design.function().unwrap();
        let space = function.space();
        let squared_features = space.value_at_zero() - space.power_function_at(&[0.0]).powi(2);
        let (at_rest, no_input) = (LinearOutput::zeros(), LinearOutput::zeros());
        let last_error = |h_s: f64, factor: f64| {
            let scale = factor * largest_gain(&design.observable_part(), &design.adaptation_rate, h_s)
                / (h_s * squared_features);
            let rate = padded(&(scale * &design.adaptation_rate));
            let mut law = Law::new(function.clone(), &design.centers, dead_zone, rate, unlimited);
            let mut plant = LinearPlant::new(&design);
            let mut state = padded::<MAX_STATES, 1>(&matrix(2, &[0.1, -0.2]));
            let mut last = 0.0_f64;
            for j in 0..20_000 {
                law.observe(&at_rest, &plant.output(&state));
                let learning = law.learning(h_s);
                assert!(!learning.clamped && learning.activation == 1.0);
                let force = no_input + law.matched_force(&learning).value;
                law.learn(&learning);
                state = plant.follow(&Moment { stamp_ns: 0, state }, &at_rest, &force, h_s);
                if state.norm() > 1e6 {
                    return f64::INFINITY;
                }
                last = if j >= 18_000 { last.max(state.norm()) } else { last };
            }
            last
        };
        for h_s in [0.005, 0.05] {
            let inside = last_error(h_s, 0.99);
            assert!(inside < 1e-3, "h {h_s}: {inside}");
            assert_eq!(last_error(h_s, 1.01), f64::INFINITY, "h {h_s}");
        }
    }

    /// e' = A_e e − Lδ + ξ of random strictly positive real plants, exact for held δ and ξ: switched at random,
    /// and always to where V grows most. With f̃ = 0, V falls outside of the ball of radius E₀, hence ‖e‖ ≤
    /// √cond(P) E₀ in the end; the ball itself is no level set of V.
    #[test]
    fn noise_and_disturbances_within_their_bounds_keep_the_error_within_e0_times_the_root_of_the_condition_of_p()
     {
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        let (noise_bound, unmatched_bound, h_s) = (0.02, 0.03, 2e-3);
        let (mut closest, mut beyond_e0) = (0.0_f64, 0.0_f64);
        for case in 0..48 {
            let (n, m) = ([2, 3, 4][case % 3], [1, 1, 2, 2][case % 4]);
            let mut random_matrix = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| random());
            let mut definite = || {
                let factor = random_matrix(n, n);
                &factor * factor.transpose() + 0.2 * DMatrix::identity(n, n)
            };
            let (p, q): (DMatrix<f64>, DMatrix<f64>) = (definite(), definite());
            let (skew, b, gain) = (random_matrix(n, n), random_matrix(n, m), random_matrix(n, m));
            let skew = 2.0 * (&skew - skew.transpose());
            let c = b.tr_mul(&p);
            let a_e = p.clone().try_inverse().unwrap() * (skew - 0.5 * q);
            let design = LinearDesign {
                a: &a_e + &gain * &c,
                b,
                c,
                gain,
                kernel: Kernel::Gaussian,
                centers: Centers::lattice(vec![-1.0; m], vec![1.0; m], vec![2; m]).unwrap(),
                adaptation_rate: 1e-3 * DMatrix::identity(m, m),
                bounds: DisturbanceBounds {
                    noise: noise_bound,
                    unmatched: unmatched_bound,
                    residual_norm: 0.0,
                },
                initial_state: None,
                ..oscillator()
            };
            let e0 = LinearObserver::new(&design).unwrap().certificate().unwrap().e0();
            let pair = design.observable_part().lure_pair().unwrap();
            let spread = pair.p.clone().symmetric_eigenvalues();
            let bound = (spread.max() / spread.min()).sqrt() * e0;
            let integral = held_integral(&padded(&a_e), n, h_s).view((0, 0), (n, n)).into_owned();
            let integral = DMatrix::from_fn(n, n, |i, j| integral[(i, j)]);
            let settle_s = 12.0 / -spectral_abscissa(&a_e);
            for greedy in [false, true] {
                let unit = |x: DVector<f64>| if x.norm() > 0.0 { x.normalize() } else { x };
                let mut error = DVector::from_element(n, 1e-6);
                let (mut noise, mut unmatched) = (DVector::zeros(m), DVector::zeros(n));
                let mut largest = 0.0_f64;
                for j in 0..(2.0 * settle_s / h_s) as usize {
                    if greedy {
                        noise = -noise_bound * unit(design.gain.tr_mul(&(&pair.p * &error)));
                        unmatched = unmatched_bound * unit(&pair.p * &error);
                    } else if random() > 0.99 {
                        noise = noise_bound * unit(DVector::from_fn(m, |_, _| random()));
                        unmatched = unmatched_bound * unit(DVector::from_fn(n, |_, _| random()));
                    }
                    error += &integral * (&a_e * &error - &design.gain * &noise + &unmatched);
                    if j as f64 * h_s > settle_s {
                        largest = largest.max(error.norm());
                    }
                }
                assert!(largest <= bound, "case {case}: {largest} {bound}");
                closest = closest.max(largest / bound);
                beyond_e0 = beyond_e0.max(largest / e0);
            }
        }
        println!("‖e‖ up to {closest:.3} of √cond(P) E₀ and {beyond_e0:.3} of E₀");
        assert!(closest > 0.2, "bounds that nothing comes near prove little: {closest}");
    }

    #[test]
    fn designs_that_cannot_work_are_refused_by_name() {
        type Change = fn(&mut LinearDesign);
        let cases: [(Parameter, Change); 13] = [
            (Parameter::Plant, |d| d.a = matrix(1, &[0.0, 1.0])),
            (Parameter::Plant, |d| d.a[(0, 0)] = -1e308),
            (Parameter::PlantInput, |d| d.b = matrix(2, &[0.0, 0.0])),
            (Parameter::PlantInput, |d| d.b = DMatrix::zeros(1, 1)),
            (Parameter::PlantOutput, |d| d.c = matrix(2, &[0.0, 1.0, 1.0, 0.0])),
            (Parameter::PlantOutput, |d| d.c = matrix(1, &[0.0, 0.0])),
            // An unstable mode that the output does not see.
            (Parameter::PlantOutput, |d| {
                d.a = matrix(2, &[5.0, 0.0, 0.0, -1.0]);
                d.c = matrix(1, &[0.0, 1.0]);
            }),
            (Parameter::Plant, |d| d.a[(0, 0)] = f64::NAN),
            (Parameter::Gain, |d| d.gain = matrix(2, &[-9.0, -9.0])),
            (Parameter::AdaptationRate, |d| d.adaptation_rate[(0, 0)] = 1e9),
            (Parameter::AdaptationRate, |d| d.adaptation_rate[(0, 0)] = -1.0),
            (Parameter::Centers, |d| d.centers = Centers::lattice([0.0; 2], [1.0; 2], [2; 2]).unwrap()),
            (Parameter::InitialState, |d| d.initial_state = Some(DVector::zeros(3))),
        ];
        for (parameter, change) in cases {
            let mut design = oscillator();
            change(&mut design);
            assert_eq!(LinearObserver::new(&design).unwrap_err().parameter, parameter);
        }
    }

    /// Learning through an output of the wrong sign is unstable however slowly it is done.
    #[test]
    fn a_plant_that_is_not_positive_real_has_no_stable_rate() {
        let mut design = oscillator();
        design.b = -design.b;
        let error = LinearObserver::new(&design).unwrap_err();
        assert_eq!(error.parameter, Parameter::AdaptationRate);
        assert!(error.needed.contains("positive real"), "{error}");
    }

    /// Position measured, force learned, no gain: relative degree two, poles −2 and −3. The continuous law is stable for
    /// γ σ κ(0) < 30 (Routh: (2 + 3) · 6 > γ σ κ(0)); short steps come near it, and no step is held to less than that
    /// by the bound of another.
    #[test]
    fn short_steps_have_the_bound_of_the_continuous_law() {
        let design = LinearDesign {
            a: matrix(2, &[0.0, 1.0, -6.0, -5.0]),
            b: matrix(2, &[0.0, 1.0]),
            c: matrix(1, &[1.0, 0.0]),
            gain: matrix(2, &[0.0, 0.0]),
            adaptation_rate: matrix(1, &[1.0]),
            ..oscillator()
        };
        let bound = largest_learning_of_every_step(&design);
        assert!((0.95..1.0001).contains(&(bound / 30.0)), "{bound}");
    }

    /// A lightly damped plant that is sampled slowly has narrow bands of steps in which it is least stable.
    #[test]
    fn no_step_of_a_lightly_damped_plant_is_less_stable_than_the_bound() {
        let design = LinearDesign {
            a: matrix(2, &[0.0, 1.0, -3600.0, -0.6]),
            b: matrix(2, &[0.0, 1.0]),
            c: matrix(1, &[0.3, 1.0]),
            gain: matrix(2, &[0.0, 0.2]),
            adaptation_rate: matrix(1, &[35.0]),
            hold_s: 0.15,
            ..oscillator()
        };
        let bound = largest_learning_of_every_step(&design);
        let part = design.observable_part();
        for i in 1..=2000 {
            let h_s = 0.15 * f64::from(i) / 2000.0;
            let here = largest_gain(&part, &design.adaptation_rate, h_s) / h_s;
            // Half of that is what a step is held to.
            assert!(bound < 1.1 * here, "h {h_s}: {here}, bound {bound}");
        }
    }

    /// A client that leaves garbage behind the m entries of its output changes nothing.
    #[test]
    fn entries_beyond_the_outputs_are_ignored() {
        let (mut clean, mut dirty) =
            (LinearObserver::new(&oscillator()).unwrap(), LinearObserver::new(&oscillator()).unwrap());
        for j in 0..100_u64 {
            let output = LinearOutput::from_fn(|i, _| if i == 0 { (j as f64 * 0.1).sin() } else { 0.0 });
            let garbage = LinearOutput::from_fn(|i, _| if i == 0 { output[0] } else { 1e6 });
            clean.accept(j * 5_000_000, Some(output), None);
            dirty.accept(j * 5_000_000, Some(garbage), Some(garbage - output));
        }
        assert_eq!(clean.estimate(500_000_000), dirty.estimate(500_000_000));
    }
}
