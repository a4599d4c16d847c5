//! A channel on a time line: which law holds when, from the samples' own stamps alone.
//!
//! Between two samples the estimate follows from the stamps, not from when somebody asks: an output is
//! held for at most `hold_s`, then the channel coasts on a grid of steps from there. So any reader, any tick
//! rate and any replay gets the same bits for the same samples and the same instant. The longer a coast, the
//! longer its steps: the work for a late question or a late sample stays bounded.
//!
//! The weights' update belongs to the next sample, whose stamp tells how long the output was held; until
//! then it is carried along as a pending increment.

use crate::function::learned::Evaluation;
use crate::innovation_gate::{Doubt, ErrorScale, Plausibility};
use crate::law::gradient::{KeptOutput, Law, Learning};
use crate::report::certificate::Certificate;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// The nominal plant with at most M outputs, solved exactly for held inputs.
pub(crate) trait Plant<const M: usize> {
    /// x̂, and what is integrated along with it.
    type State: Copy;

    /// C x̂.
    fn output(&self, state: &Self::State) -> SVector<f64, M>;

    /// The state at the first output, from the one before it.
    fn start(&self, waiting: &Self::State, output: &SVector<f64, M>) -> Self::State;

    /// The state after a step of `h_s` with the held `output` and `force` = u + f̂: `x̂' = A x̂ + L (y − C x̂) + B (u + f̂)`.
    fn follow(
        &mut self,
        at: &Moment<Self::State>,
        output: &SVector<f64, M>,
        force: &SVector<f64, M>,
        h_s: f64,
    ) -> Self::State;

    /// A state that was kept, with the gains of our own.
    fn resumed(&self, own: &Self::State, kept: &Self::State) -> Self::State;

    /// The same without an output: `x̂' = A x̂ + B (u + f̂)`.
    fn coast(&mut self, at: &Moment<Self::State>, force: &SVector<f64, M>, h_s: f64) -> Self::State;
}

/// The state at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Moment<S> {
    pub(crate) stamp_ns: u64,
    pub(crate) state: S,
}

/// All that a channel's future depends on, beside what it learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ChannelState<S, const M: usize> {
    committed: Option<Moment<S>>,
    waiting: S,
    input: SVector<f64, M>,
    held_until_ns: u64,
    last_learning_clamped: bool,
    output_stamp_ns: Option<u64>,
    output: KeptOutput<M>,
    error_scale: ErrorScale<M>,
}

impl<S: Copy, const M: usize> ChannelState<S, M> {
    /// x̂ at the newest sample, or before the first.
    pub(crate) fn newest(&self) -> S {
        self.committed.map_or(self.waiting, |moment| moment.state)
    }

    /// Stamp of the newest sample (ns).
    pub(crate) fn stamp_ns(&self) -> Option<u64> {
        self.committed.map(|moment| moment.stamp_ns)
    }
}

/// An output, and whether it may be learned from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured<const M: usize> {
    pub(crate) output: SVector<f64, M>,
    pub(crate) teaches: bool,
}

/// A point of the coasting grid, with f̂ there.
#[derive(Debug, Clone, Copy)]
struct GridPoint<S, const M: usize> {
    /// Counts from the end of the hold.
    index: u64,
    moment: Moment<S>,
    matched_force: Evaluation<M>,
}

/// What a channel says about an instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prediction<S, const M: usize> {
    pub(crate) moment: Moment<S>,
    pub(crate) matched_force: Evaluation<M>,
    pub(crate) learning: Learning<M>,
    pub(crate) coasting: bool,
}

/// The newest points of the coasting grid. A sample that comes late, but not later than this many steps,
/// goes on from the one before it; an older one coasts again from the start, to the same bits.
const TRAIL: usize = 32;
/// After every so many steps of a coast, a step is twice as long,
const STEPS_OF_ONE_LENGTH: u64 = 32;
/// but not longer than this: f̂ is evaluated once a step,
const LONGEST_STEP_NS: u64 = 250_000_000;
/// for so many steps, a quarter of an hour and more. Beyond, an estimate says nothing, and its cost is what matters.
const STEPS_OF_A_LONG_COAST: u64 = 4096;

#[derive(Debug, Clone)]
pub(crate) struct Timeline<P: Plant<M>, const M: usize> {
    pub(crate) law: Law<M>,
    /// `None` where the error dynamics are not strictly positive real: then nothing is claimed.
    pub(crate) certificate: Option<Certificate>,
    plant: P,
    hold_ns: u64,
    coast_step_ns: u64,
    /// The state just after the newest sample; `None` before the first output.
    committed: Option<Moment<P::State>>,
    initial: P::State,
    /// The state before the first output: the initial one, and fixes.
    waiting: P::State,
    input: SVector<f64, M>,
    held_until_ns: u64,
    last_learning_clamped: bool,
    output_stamp_ns: Option<u64>,
    /// A ring; only the first `trail_length` places hold points of this coast.
    trail: [Option<GridPoint<P::State, M>>; TRAIL],
    trail_length: usize,
    trail_end: usize,
    plausibility: Plausibility,
    error_scale: ErrorScale<M>,
    n_held_back: u64,
    /// The last state that was known to be good.
    good: Option<ChannelState<P::State, M>>,
}

impl<P: Plant<M>, const M: usize> Timeline<P, M> {
    /// A timeline before its first output. An output is held for at most `hold_s`; then the channel coasts in
    /// steps of `coast_step_s`.
    pub(crate) fn new(
        law: Law<M>,
        plant: P,
        certificate: Option<Certificate>,
        (hold_s, coast_step_s): (f64, f64),
        initial: P::State,
    ) -> Self {
        Self {
            law,
            certificate,
            plant,
            hold_ns: nanoseconds(hold_s),
            coast_step_ns: nanoseconds(coast_step_s).max(1),
            committed: None,
            initial,
            waiting: initial,
            input: SVector::zeros(),
            held_until_ns: 0,
            last_learning_clamped: false,
            output_stamp_ns: None,
            trail: [None; TRAIL],
            trail_length: 0,
            trail_end: 0,
            plausibility: Plausibility::default(),
            error_scale: ErrorScale::unknown(),
            n_held_back: 0,
            good: None,
        }
    }

    /// From now on outputs are judged by this.
    pub(crate) fn set_plausibility(&mut self, plausibility: Plausibility) {
        self.plausibility = plausibility;
    }

    /// Outputs that stood out and were held back.
    pub(crate) fn n_held_back(&self) -> u64 {
        self.n_held_back
    }

    /// Moves to the stamp of a new sample, learns from the output held until then, and takes what the
    /// sample brings.
    pub(crate) fn accept(
        &mut self,
        stamp_ns: u64,
        measured: Option<Measured<M>>,
        input: Option<SVector<f64, M>>,
        take_fix: impl FnOnce(&mut P::State),
    ) {
        match (self.committed, &measured) {
            (Some(committed), _) => {
                let moment = self.predict(stamp_ns).moment;
                let learning = self.law.learning(self.held_h_s(&committed, stamp_ns));
                self.law.learn(&learning);
                self.last_learning_clamped = learning.clamped;
                self.committed = Some(moment);
            }
            (None, Some(first)) => {
                let state = self.plant.start(&self.waiting, &first.output);
                self.committed = Some(Moment { stamp_ns, state });
            }
            (None, None) => {}
        }
        self.input = input.unwrap_or(self.input);
        take_fix(match &mut self.committed {
            Some(moment) => &mut moment.state,
            None => &mut self.waiting,
        });
        if let Some(moment) = &self.committed {
            let output_estimate = self.plant.output(&moment.state);
            let believed = measured.and_then(|measured| self.believed(measured, &output_estimate, stamp_ns));
            if let Some(Measured { output, teaches }) = believed {
                self.law.observe_for(&output, &output_estimate, teaches);
                self.held_until_ns = stamp_ns.saturating_add(self.hold_ns);
                self.output_stamp_ns = Some(stamp_ns);
            } else if self.held_until_ns >= stamp_ns {
                self.law.observe_again(&output_estimate);
            }
        }
        self.clear_trail();
    }

    /// What is left of an output that may stand out.
    fn believed(
        &mut self,
        measured: Measured<M>,
        output_estimate: &SVector<f64, M>,
        stamp_ns: u64,
    ) -> Option<Measured<M>> {
        let Plausibility { outliers, factor } = self.plausibility;
        if outliers == Doubt::Off {
            return Some(measured);
        }
        let error = measured.output - output_estimate;
        let rule = (factor, self.law.dead_zone().width(), self.hold_ns);
        if !self.error_scale.stands_out(&error, stamp_ns, rule) {
            return Some(measured);
        }
        self.n_held_back += 1;
        (outliers == Doubt::Adaptation).then_some(Measured { teaches: false, ..measured })
    }

    /// The estimate at `to_ns`, not before the newest sample. Changes nothing but the coasting grid.
    pub(crate) fn predict(&mut self, to_ns: u64) -> Prediction<P::State, M> {
        let Some(committed) = self.committed else {
            return Prediction {
                moment: Moment { stamp_ns: to_ns, state: self.waiting },
                matched_force: Evaluation::exact(SVector::zeros(), 0.0),
                learning: Learning::none(),
                coasting: true,
            };
        };
        let to_ns = to_ns.max(committed.stamp_ns);
        let held_end_ns = self.held_until_ns.max(committed.stamp_ns);
        if to_ns <= self.held_until_ns {
            return self.hold(&committed, to_ns);
        }
        let held = self.hold(&committed, held_end_ns);
        let mut point = match self.newest_grid_point(to_ns) {
            Some(point) => point,
            None => self.grid_point(0, held.moment, &held.learning),
        };
        loop {
            let next_ns = point.moment.stamp_ns.saturating_add(self.step_ns(point.index));
            if next_ns > to_ns || next_ns == u64::MAX {
                break;
            }
            let moment = self.coast(&point, next_ns);
            point = self.grid_point(point.index + 1, moment, &held.learning);
        }
        Prediction {
            moment: if point.moment.stamp_ns == to_ns { point.moment } else { self.coast(&point, to_ns) },
            matched_force: point.matched_force,
            learning: Learning::none(),
            coasting: true,
        }
    }

    /// How long the output has been held since the newest sample, at `to_ns`.
    fn held_h_s(&self, committed: &Moment<P::State>, to_ns: u64) -> f64 {
        seconds(to_ns.min(self.held_until_ns).saturating_sub(committed.stamp_ns))
    }

    fn hold(&mut self, committed: &Moment<P::State>, to_ns: u64) -> Prediction<P::State, M> {
        let h_s = self.held_h_s(committed, to_ns);
        let learning = self.law.learning(h_s);
        let matched_force = self.law.matched_force(&learning);
        let moment = if h_s == 0.0 {
            *committed
        } else {
            let force = self.input + matched_force.value;
            let state = self.plant.follow(committed, self.law.held_output(), &force, h_s);
            Moment { stamp_ns: to_ns, state }
        };
        let clamped = learning.clamped || self.last_learning_clamped;
        let learning = Learning { clamped, ..learning };
        Prediction { moment, matched_force, learning, coasting: false }
    }

    fn grid_point(
        &mut self,
        index: u64,
        moment: Moment<P::State>,
        pending: &Learning<M>,
    ) -> GridPoint<P::State, M> {
        let output = self.plant.output(&moment.state);
        let matched_force = self.law.matched_force_at(&output, pending);
        let point = GridPoint { index, moment, matched_force };
        self.trail[self.trail_end] = Some(point);
        self.trail_end = (self.trail_end + 1) % TRAIL;
        self.trail_length = (self.trail_length + 1).min(TRAIL);
        point
    }

    /// Before every sample: the points themselves, some kilobytes, are not touched.
    fn clear_trail(&mut self) {
        (self.trail_length, self.trail_end) = (0, 0);
    }

    /// Length of the step from the grid point of this index.
    fn step_ns(&self, index: u64) -> u64 {
        let doublings = |index: u64| (index / STEPS_OF_ONE_LENGTH).min(34);
        let step_ns = |n: u64| self.coast_step_ns.saturating_mul(1 << n);
        let longest_ns = LONGEST_STEP_NS.max(self.coast_step_ns);
        let long_ns = longest_ns.saturating_mul(1 << doublings(index.saturating_sub(STEPS_OF_A_LONG_COAST)));
        step_ns(doublings(index)).min(long_ns)
    }

    fn newest_grid_point(&self, to_ns: u64) -> Option<GridPoint<P::State, M>> {
        let trail = self.trail[..self.trail_length].iter().flatten();
        let before = trail.filter(|point| point.moment.stamp_ns <= to_ns);
        before.max_by_key(|point| point.moment.stamp_ns).copied()
    }

    fn coast(&mut self, point: &GridPoint<P::State, M>, to_ns: u64) -> Moment<P::State> {
        let force = self.input + point.matched_force.value;
        let h_s = seconds(to_ns - point.moment.stamp_ns);
        Moment { stamp_ns: to_ns, state: self.plant.coast(&point.moment, &force, h_s) }
    }

    /// Puts the state back to an earlier one, from which it coasts to now.
    fn put_back(&mut self, moment: Option<Moment<P::State>>) {
        self.committed = moment;
        self.held_until_ns = 0;
        // What made it necessary may have been an error of any size.
        self.error_scale = ErrorScale::unknown();
        self.clear_trail();
    }

    /// Keeps a copy of the committed state and weights. No allocation.
    pub(crate) fn keep_good_copy(&mut self) {
        self.good = Some(ChannelState {
            committed: self.committed,
            waiting: self.waiting,
            input: self.input,
            held_until_ns: self.held_until_ns,
            last_learning_clamped: self.last_learning_clamped,
            output_stamp_ns: self.output_stamp_ns,
            output: self.law.kept_output(),
            error_scale: self.error_scale,
        });
        self.law.keep_good_copy();
    }

    /// Puts state and weights back to the last good copy, from which it coasts to now. No allocation.
    pub(crate) fn restore_good_copy(&mut self) {
        self.put_back(self.good.and_then(|good| good.committed));
        self.law.restore_good_copy();
    }

    /// The state of the last good copy.
    pub(crate) fn kept_state(&self) -> Option<ChannelState<P::State, M>> {
        self.good
    }

    /// Goes on from a state that another timeline of the same design has kept: with what that one had learned, the
    /// next step is the same to the bit.
    pub(crate) fn resume(&mut self, kept: &ChannelState<P::State, M>) {
        let resumed = |state: &P::State| self.plant.resumed(&self.initial, state);
        self.waiting = resumed(&kept.waiting);
        let committed =
            kept.committed.map(|Moment { stamp_ns, state }| Moment { stamp_ns, state: resumed(&state) });
        self.put_back(committed);
        self.input = kept.input;
        // Never longer than our own hold.
        let longest_ns = committed.map_or(0, |moment| moment.stamp_ns.saturating_add(self.hold_ns));
        self.held_until_ns = kept.held_until_ns.min(longest_ns);
        self.last_learning_clamped = kept.last_learning_clamped;
        self.output_stamp_ns = kept.output_stamp_ns;
        self.error_scale = kept.error_scale;
        self.law.resume(&kept.output);
    }

    /// Forgets the state, not what was learned: starts again from the next output, at any stamp.
    pub(crate) fn restart(&mut self) {
        self.waiting = self.initial;
        self.output_stamp_ns = None;
        self.input = SVector::zeros();
        self.last_learning_clamped = false;
        self.put_back(None);
    }

    /// Forgets the state and what was learned, in the good copy too.
    pub(crate) fn forget(&mut self) {
        self.restart();
        self.law.forget();
        self.keep_good_copy();
    }

    /// How far the estimate at an instant can be trusted.
    pub(crate) fn report(&self, at: &Prediction<P::State, M>, stamp_ns: u64) -> ChannelReport {
        let space = self.law.space();
        let (lower, upper) = self.law.bounding_box();
        let output = if at.coasting { self.plant.output(&at.moment.state) } else { *self.law.held_output() };
        let power_function = space.power_function(at.matched_force.squared_features);
        ChannelReport {
            output_error: if at.coasting { 0.0 } else { self.law.output_error().norm() },
            activation: at.learning.activation,
            power_function: power_function / space.value_at_zero().sqrt(),
            native_norm: self.law.native_norm(),
            solver_error: at.matched_force.error,
            error_bound: match &self.certificate {
                Some(certificate) if !at.coasting => certificate.error_bound(power_function),
                _ => f64::INFINITY,
            },
            output_age_s: match self.output_stamp_ns {
                Some(output_stamp_ns) => seconds(stamp_ns.saturating_sub(output_stamp_ns)),
                None => f64::INFINITY,
            },
            coasting: at.coasting,
            clamped: at.learning.clamped,
            outside_centers: lower
                .iter()
                .zip(upper)
                .zip(&output)
                .any(|((lower, upper), y)| !(lower..=upper).contains(&y)),
        }
    }
}

/// How far one channel's part of an estimate can be trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelReport {
    /// ‖ỹ‖ at the held sample; 0 while coasting.
    pub output_error: f64,
    /// σ as used; 0 while coasting.
    pub activation: f64,
    /// P_N / √κ(0) at the held or predicted output, 0 … 1.
    pub power_function: f64,
    /// ‖f̂_N‖ of what is committed.
    pub native_norm: f64,
    /// How far f̂ may be from that of the dense solver, in the input's unit; 0 where that is in use.
    pub solver_error: f64,
    /// max(d, e_N) of the [`Certificate`], a bound and not a covariance; +∞ while coasting, or where there is none.
    pub error_bound: f64,
    /// Time since the newest output's stamp (s); +∞ before the first.
    pub output_age_s: f64,
    /// No output is held: prediction only.
    pub coasting: bool,
    /// σ was held down to keep the sampled law stable.
    pub clamped: bool,
    /// The held or predicted output lies outside of the box of the centers.
    pub outside_centers: bool,
}

pub(crate) fn seconds(duration_ns: u64) -> f64 {
    duration_ns as f64 / 1e9
}

fn nanoseconds(duration_s: f64) -> u64 {
    (duration_s * 1e9).round() as u64
}
