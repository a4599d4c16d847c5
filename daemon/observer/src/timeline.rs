//! Runs a channel on a time line: holding, coasting and committing follow from the samples' stamps alone.
//!
//! An output is held for at most `hold_s`; then the channel coasts on a grid of steps that starts there. The estimate for an
//! instant therefore depends on the samples and that instant only, not on when or how often it is requested: any tick rate
//! and any replay gives the same bits. The steps of a coast grow with its length, so the work for a late request or a late
//! sample is bounded.
//!
//! The first output after a coast teaches nothing: its ỹ is the error of the whole coast, from any cause, and not what a
//! force does within a step. After an outage the state also begins again from the output, C x̂ := y: following it would take
//! some 1/λ, and every ỹ until then would be learned as a force. The pose and what the output does not show stay.
//!
//! | at an output after a coast | if |
//! |---|---|
//! | it does not teach | it is later after the output used before than 1.5 intervals of the last two outputs |
//! | the state begins again | no output came, used or not, for more than 5 hold times and 4 intervals of the last two |
//!
//! The intervals except a sensor that is slower than the hold, which makes the channel coast before each of its outputs; what
//! the gate rejects is no outage. A single lost sample is none either: C x̂ := y lets the sensor's whole noise s into x̂,
//! following it lets in s √(λh/2). A coast of the time T is wrong by f̃ T/m, which exceeds s after some 4 hold times with
//! the vehicles of the presets.
//!
//! The weights change when the next sample arrives, since its stamp determines how long the output was held. Until then
//! their update is a pending increment.

use crate::function::evaluation::Evaluation;
use crate::innovation_gate::{InnovationGate, InnovationScale, OutlierAction, OutputTimes};
use crate::law::channel::Channel;
use crate::law::gradient::{GradientMark, HeldOutput, Learning};
use crate::plant::nominal::{Moment, Plant};
use crate::report::certificate::Certificate;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// The state of a channel at a checkpoint: everything that later estimates depend on, except what was learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimelineState<S, const M: usize> {
    committed: Option<Moment<S>>,
    waiting: S,
    input: SVector<f64, M>,
    held_until_ns: u64,
    last_learning_clamped: bool,
    output_stamp_ns: Option<u64>,
    output: HeldOutput<M>,
    teaches: bool,
    innovation_scale: InnovationScale<M>,
}

impl<S: Copy, const M: usize> TimelineState<S, M> {
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

/// The estimate of a channel at an instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prediction<S, const M: usize> {
    pub(crate) moment: Moment<S>,
    pub(crate) matched_force: Evaluation<M>,
    /// What is learned from the held output by then.
    pub(crate) learning: Learning<M>,
    pub(crate) coasting: bool,
}

/// The newest points of the coasting grid that are stored. A sample that arrives at most this many steps late continues
/// from the point before it; for an older one the coast is computed again from its start, with the same bits.
const TRAIL: usize = 32;
/// After this many steps of a coast, the step doubles,
const STEPS_OF_ONE_LENGTH: u64 = 32;
/// up to this length (f̂ is evaluated once a step),
const MAX_STEP_NS: u64 = 250_000_000;
/// for this many steps, a quarter of an hour and more. Beyond, an estimate carries no information: the steps double
/// again, to bound the cost.
const STEPS_OF_A_LONG_COAST: u64 = 4096;

/// Without an output for more than this many hold times, and this many intervals of the last two outputs, there is an outage.
const OUTAGE_HOLDS: u64 = 5;
const OUTAGE_PERIODS: u64 = 4;

#[derive(Debug, Clone)]
pub(crate) struct Timeline<P: Plant<M>, const M: usize> {
    /// θ, and x̂ just after the newest sample.
    channel: Channel<P, M>,
    /// Whether there was an output: before, x̂ is `waiting`.
    is_started: bool,
    initial: P::State,
    /// The state before the first output: the initial one, and fixes.
    waiting: P::State,
    /// `None` if the error dynamics are not strictly positive real; then the theorems claim nothing.
    certificate: Option<Certificate>,
    hold_ns: u64,
    coast_step_ns: u64,
    input: SVector<f64, M>,
    held_until_ns: u64,
    /// Whether the held output may be learned from.
    teaches: bool,
    last_learning_clamped: bool,
    output_stamp_ns: Option<u64>,
    /// A ring; only the first `trail_length` places hold points of this coast.
    trail: [Option<GridPoint<P::State, M>>; TRAIL],
    trail_length: usize,
    trail_end: usize,
    gate: InnovationGate,
    innovation_scale: InnovationScale<M>,
    /// What it was at earlier samples, to return to when one arrives late.
    marks: Vec<(TimelineState<P::State, M>, GradientMark<M>)>,
}

impl<P: Plant<M>, const M: usize> Timeline<P, M> {
    /// A timeline before its first output. An output is held for at most `hold_s`; then the channel coasts in
    /// steps of `coast_step_s`.
    pub(crate) fn new(
        channel: Channel<P, M>,
        certificate: Option<Certificate>,
        (hold_s, coast_step_s): (f64, f64),
    ) -> Self {
        let initial = *channel.state();
        Self {
            channel,
            is_started: false,
            initial,
            waiting: initial,
            certificate,
            hold_ns: nanoseconds(hold_s),
            coast_step_ns: nanoseconds(coast_step_s).max(1),
            input: SVector::zeros(),
            held_until_ns: 0,
            teaches: true,
            last_learning_clamped: false,
            output_stamp_ns: None,
            trail: [None; TRAIL],
            trail_length: 0,
            trail_end: 0,
            gate: InnovationGate::default(),
            innovation_scale: InnovationScale::unknown(),
            marks: Vec::new(),
        }
    }

    /// Moves to the stamp of a new sample, learns from the output held until then, and takes the sample's
    /// values. While frozen, nothing is learned from here on. Returns whether the output is an outlier.
    pub(crate) fn accept(
        &mut self,
        stamp_ns: u64,
        measured: Option<Measured<M>>,
        input: Option<SVector<f64, M>>,
        frozen: bool,
        take_fix: impl FnOnce(&mut P::State),
    ) -> bool {
        let was_started = self.is_started;
        if was_started {
            let ahead = self.predict(stamp_ns);
            self.last_learning_clamped = ahead.learning.clamped;
            self.channel.commit(&ahead.learning, ahead.moment);
        } else if let Some(first) = &measured {
            let state = self.channel.plant().start(&self.waiting, &first.output);
            *self.channel.at_mut() = Moment { stamp_ns, state };
            self.is_started = true;
        }
        self.input = input.unwrap_or(self.input);
        take_fix(if self.is_started { &mut self.channel.at_mut().state } else { &mut self.waiting });
        let before = measured.map(|_| self.innovation_scale.arrive(stamp_ns));
        let is_outlier = (measured.zip(before))
            .is_some_and(|(measured, before)| self.is_outlier(&measured.output, (stamp_ns, &before)));
        let used = measured.and_then(|measured| match is_outlier {
            false => Some(measured),
            true if self.gate.outliers == OutlierAction::Adaptation => {
                Some(Measured { teaches: false, ..measured })
            }
            true => None,
        });
        if let (Some(Measured { output, teaches }), Some(before)) = (used, before) {
            let has_coasted = was_started && stamp_ns > self.held_until_ns;
            self.teaches = teaches && !(has_coasted && self.is_longer_than_usual(stamp_ns, &before));
            if has_coasted && self.is_outage(&before) {
                let at = self.channel.at();
                let state = self.channel.plant().at_output(&at.state, &output);
                *self.channel.at_mut() = Moment { stamp_ns, state };
            }
            self.channel.observe(&output, self.teaches && !frozen);
            self.held_until_ns = stamp_ns.saturating_add(self.hold_ns);
            self.output_stamp_ns = Some(stamp_ns);
        } else if self.is_started && self.held_until_ns >= stamp_ns {
            self.channel.observe_again(self.teaches && !frozen);
        }
        self.clear_trail();
        is_outlier
    }

    /// Whether the outputs in use are further apart than those that came before.
    fn is_longer_than_usual(&self, stamp_ns: u64, before: &OutputTimes) -> bool {
        let since_ns = stamp_ns.saturating_sub(self.output_stamp_ns.unwrap_or(0));
        since_ns.saturating_mul(2) > before.period_ns.saturating_mul(3)
    }

    fn is_outage(&self, before: &OutputTimes) -> bool {
        before.gap_ns > self.hold_ns.saturating_mul(OUTAGE_HOLDS)
            && before.gap_ns > before.period_ns.saturating_mul(OUTAGE_PERIODS)
    }

    fn is_outlier(&mut self, output: &SVector<f64, M>, at: (u64, &OutputTimes)) -> bool {
        let InnovationGate { outliers, factor } = self.gate;
        let rule = (factor, self.channel.law().dead_zone().width(), self.hold_ns);
        outliers != OutlierAction::Off
            && self.innovation_scale.is_outlier(&(output - self.channel.output_estimate()), at, rule)
    }

    /// The estimate at `to_ns`, not before the newest sample. Changes nothing but the coasting grid.
    pub(crate) fn predict(&mut self, to_ns: u64) -> Prediction<P::State, M> {
        if !self.is_started {
            return Prediction {
                moment: Moment { stamp_ns: to_ns, state: self.waiting },
                matched_force: Evaluation::exact(SVector::zeros(), 0.0),
                learning: Learning::none(),
                coasting: true,
            };
        }
        let from_ns = self.channel.at().stamp_ns;
        let to_ns = to_ns.max(from_ns);
        let held_to_ns = to_ns.min(self.held_until_ns).max(from_ns);
        let ahead = self.channel.predict(&self.input, seconds(held_to_ns - from_ns));
        let (learning, matched_force) = (ahead.learning, ahead.matched_force);
        let moment = Moment { stamp_ns: held_to_ns, state: ahead.state };
        if to_ns <= self.held_until_ns {
            return Prediction { moment, matched_force, learning, coasting: false };
        }
        let mut point = match self.newest_grid_point(to_ns) {
            Some(point) => point,
            None => self.grid_point(0, moment, &learning),
        };
        loop {
            let next_ns = point.moment.stamp_ns.saturating_add(self.step_ns(point.index));
            if next_ns > to_ns || next_ns == u64::MAX {
                break;
            }
            let moment = self.coast(&point, next_ns);
            point = self.grid_point(point.index + 1, moment, &learning);
        }
        Prediction {
            moment: if point.moment.stamp_ns == to_ns { point.moment } else { self.coast(&point, to_ns) },
            matched_force: point.matched_force,
            learning,
            coasting: true,
        }
    }

    fn grid_point(
        &mut self,
        index: u64,
        moment: Moment<P::State>,
        pending: &Learning<M>,
    ) -> GridPoint<P::State, M> {
        let output = self.channel.plant().output(&moment.state);
        let matched_force = self.channel.law_mut().matched_force_at(&output, pending);
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
        let longest_ns = MAX_STEP_NS.max(self.coast_step_ns);
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
        Moment { stamp_ns: to_ns, state: self.channel.plant_mut().coast(&point.moment, &force, h_s) }
    }

    /// Restores an earlier state, from which the channel coasts to the present.
    fn put_back(&mut self, moment: Option<Moment<P::State>>) {
        self.is_started = moment.is_some();
        if let Some(moment) = moment {
            *self.channel.at_mut() = moment;
        }
        self.held_until_ns = 0;
        // The error that made it necessary may have any size.
        self.innovation_scale = InnovationScale::unknown();
        self.clear_trail();
    }

    /// Saves what is learned by now as the checkpoint, and returns the state that goes with it. No allocation.
    pub(crate) fn save(&mut self) -> TimelineState<P::State, M> {
        self.channel.law_mut().save();
        self.state()
    }

    /// Everything that later estimates depend on, except what was learned.
    fn state(&self) -> TimelineState<P::State, M> {
        TimelineState {
            committed: self.is_started.then(|| *self.channel.at()),
            waiting: self.waiting,
            input: self.input,
            held_until_ns: self.held_until_ns,
            last_learning_clamped: self.last_learning_clamped,
            output_stamp_ns: self.output_stamp_ns,
            output: *self.channel.law().held(),
            teaches: self.teaches,
            innovation_scale: self.innovation_scale,
        }
    }

    /// Restores state and weights of the checkpoint, from which the channel coasts to the present. No allocation.
    pub(crate) fn restore(&mut self, saved: Option<&TimelineState<P::State, M>>) {
        self.put_back(saved.and_then(|saved| saved.committed));
        self.channel.law_mut().restore();
    }

    /// Continues from the checkpoint of another timeline of the same design. With its state, the next step is the same to
    /// the bit.
    pub(crate) fn load(&mut self, learned: &[f64], state: Option<&TimelineState<P::State, M>>) {
        self.channel.law_mut().load(learned);
        let Some(saved) = state else { return };
        let loaded = |state: &P::State| self.channel.plant().loaded(&self.initial, state);
        let committed =
            saved.committed.map(|Moment { stamp_ns, state }| Moment { stamp_ns, state: loaded(&state) });
        // Never longer than the own hold.
        let max_ns = committed.map_or(0, |moment| moment.stamp_ns.saturating_add(self.hold_ns));
        let held_until_ns = saved.held_until_ns.min(max_ns);
        self.resume(&TimelineState { committed, waiting: loaded(&saved.waiting), held_until_ns, ..*saved });
        self.channel.law_mut().hold(&saved.output);
    }

    /// Room for this many marks. Allocates. Nothing with the local solver.
    pub(crate) fn reserve_marks(&mut self, n_marks: usize) {
        let state = self.state();
        let marks = (0..n_marks).map_while(|_| Some((state, self.channel.law().new_mark()?)));
        self.marks = marks.collect();
    }

    /// Bytes of a mark; `None` with the local solver.
    pub(crate) fn bytes_of_mark(&self) -> Option<usize> {
        let numbers = 8 * self.channel.law().function().n_learned();
        self.channel.law().function().learned().map(|_| size_of::<TimelineState<P::State, M>>() + numbers)
    }

    /// Copies the present into a mark. No allocation.
    pub(crate) fn mark(&mut self, place: usize) {
        let state = self.state();
        if let Some((own, law)) = self.marks.get_mut(place) {
            *own = state;
            self.channel.law().mark(law);
        }
    }

    /// Becomes what it was at a mark, to the bit. No allocation.
    pub(crate) fn return_to(&mut self, place: usize) {
        let Some((saved, law)) = self.marks.get(place) else { return };
        self.channel.law_mut().return_to(law);
        let saved = *saved;
        self.resume(&saved);
    }

    /// Continues from a state; what was learned and the output that is held are another matter.
    fn resume(&mut self, saved: &TimelineState<P::State, M>) {
        self.waiting = saved.waiting;
        self.put_back(saved.committed);
        self.input = saved.input;
        self.held_until_ns = saved.held_until_ns;
        self.last_learning_clamped = saved.last_learning_clamped;
        self.output_stamp_ns = saved.output_stamp_ns;
        self.teaches = saved.teaches;
        self.innovation_scale = saved.innovation_scale;
    }

    /// Forgets the state, not what was learned: starts again from the next output, at any stamp.
    pub(crate) fn restart(&mut self) {
        self.waiting = self.initial;
        self.output_stamp_ns = None;
        self.input = SVector::zeros();
        self.last_learning_clamped = false;
        self.put_back(None);
    }

    /// Forgets the state and what was learned; the checkpoint stays until the next one.
    pub(crate) fn forget(&mut self) {
        self.restart();
        self.channel.law_mut().forget();
    }

    /// Sets how outliers are detected.
    pub(crate) fn set_innovation_gate(&mut self, gate: InnovationGate) {
        self.gate = gate;
    }

    pub(crate) fn channel(&self) -> &Channel<P, M> {
        &self.channel
    }

    pub(crate) fn certificate(&self) -> Option<&Certificate> {
        self.certificate.as_ref()
    }

    /// How far the estimate at an instant can be trusted.
    pub(crate) fn report(&self, at: &Prediction<P::State, M>, stamp_ns: u64) -> ChannelReport {
        let law = self.channel.law();
        let (space, (lower, upper)) = (law.function().space(), law.function().bounding_box());
        let output =
            if at.coasting { self.channel.plant().output(&at.moment.state) } else { law.feature_point() };
        let power_function = space.power_function(at.matched_force.squared_features);
        ChannelReport {
            output_error: if at.coasting { 0.0 } else { law.held().output_error.norm() },
            activation: if at.coasting { 0.0 } else { at.learning.activation },
            power_function: power_function / space.value_at_zero().sqrt(),
            native_norm: law.function().native_norm(),
            solver_error: at.matched_force.error,
            error_bound: match &self.certificate {
                Some(certificate) if !at.coasting => {
                    certificate.confirmed_error_bound(power_function, law.held().output_error.norm())
                }
                _ => f64::INFINITY,
            },
            output_age_s: match self.output_stamp_ns {
                Some(output_stamp_ns) => seconds(stamp_ns.saturating_sub(output_stamp_ns)),
                None => f64::INFINITY,
            },
            coasting: at.coasting,
            clamped: !at.coasting && (at.learning.clamped || self.last_learning_clamped),
            outside_centers: lower
                .iter()
                .zip(upper)
                .zip(&output)
                .any(|((lower, upper), y)| !(lower..=upper).contains(&y)),
            nis: 0.0,
            reacquiring: false,
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
    /// P_N / √κ(0) where f̂ is evaluated, 0 … 1.
    pub power_function: f64,
    /// ‖f̂_N‖ of what is committed.
    pub native_norm: f64,
    /// How far f̂ may be from that of the dense solver, in the input's unit; 0 where that is in use.
    pub solver_error: f64,
    /// max(d, e_N) of the [`Certificate`] where the held output confirms it, a bound and not a covariance; +∞ elsewhere: while
    /// coasting, where the error dynamics are not strictly positive real, where the dead zone is not admissible
    /// (d ≤ ‖C‖ e_N), and after an output with ‖C⁻¹‖ (‖ỹ‖ + δ̄) > max(d, e_N), which is every output of a plant with
    /// more states than outputs. It is true at the output's stamp, as far as the configured δ̄ bounds its noise.
    pub error_bound: f64,
    /// Time since the newest output's stamp (s); +∞ before the first.
    pub output_age_s: f64,
    /// No output is held: prediction only.
    pub coasting: bool,
    /// σ was held down, to keep the sampled law stable or ‖f̂‖ within its bound.
    pub clamped: bool,
    /// f̂ is evaluated outside of the box of the centers.
    pub outside_centers: bool,
    /// Mean of e²/S over the axes of the newest output: 1 in the mean where the noises are right; 0 where the law has no S,
    /// and before the first output.
    pub nis: f64,
    /// After an outage, the innovations are not back within the gate yet.
    pub reacquiring: bool,
}

pub(crate) fn seconds(duration_ns: u64) -> f64 {
    duration_ns as f64 / 1e9
}

fn nanoseconds(duration_s: f64) -> u64 {
    (duration_s * 1e9).round() as u64
}

#[cfg(test)]
mod tests;
