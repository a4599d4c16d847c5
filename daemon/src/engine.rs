//! Everything that determines an estimate: gate, observers, guards, deadline policy, counters. No clock and no port.
//!
//! The inputs are samples, commands and instants. The same inputs give the same estimates to the bit. Therefore a record of
//! them can be replayed ([`crate::replay`]), and another engine can continue from a checkpoint ([`crate::snapshot`]).
//!
//! A tick is [`Engine::begin`], [`Engine::take`] for each sample, [`Engine::conclude`]: no allocation, no system call.

use crate::config::{Clock, Config, DeadlineConfig, InputConfig, LawName, OutlierAction};
use crate::estimator::{ChannelName, Estimator, EstimatorState, VehicleEstimate};
use crate::gate::{Accepted, Arrival, Gate, GateState};
use crate::sensors::{Installed, Sensors};
use crate::source_book::{Received, SourceBook};
use crate::window::{Kept, Place, Window};
pub use flight_record::LoopCommand;
use observer::{ChannelReport, Deviations};
use serde::{Deserialize, Serialize};
use shared_types::payload::{Channel, Counters, Estimate, Measurement, Rejection, status_bits};

/// A checkpoint is saved this often (s).
const CHECKPOINT_EVERY_S: f64 = 0.5;
/// A checkpoint is saved only within this part of the limits, so that a diverging state is not saved.
const PART_OF_LIMITS: f64 = 0.5;
/// A second fallback within this time (s) means that the checkpoint is bad.
const RELAPSE_S: f64 = 2.0;

/// The state of an engine at a checkpoint: everything that later estimates depend on, except what was learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EngineState {
    /// Of the observers.
    pub estimator: EstimatorState,
    gate: GateState,
    frozen: bool,
    on_ground: bool,
    newest_arrival_ns: Option<u64>,
}

/// A checkpoint of an engine, from which another one of the same design continues.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// What was learned: the numbers of [`Engine::read_saved`].
    pub learned: Vec<f64>,
    /// `None` if only what was learned is resumed.
    pub state: Option<EngineState>,
}

/// Gate, observers and guards of one vehicle.
#[derive(Debug, Clone)]
pub struct Engine {
    estimator: Estimator,
    gate: Gate,
    sensors: Sensors,
    limits: InputConfig,
    deadline: DeadlineConfig,
    clock: Clock,
    stale_after_s: f64,
    /// Which of translation and rotation have the joint law.
    is_joint: [bool; 2],
    checkpoint_every: u64,
    counters: Counters,
    sources: SourceBook,
    /// Samples that may have to be fused again.
    window: Window,
    frozen: bool,
    newest_arrival_ns: Option<u64>,
    /// Stamps of the newest fallback to the checkpoint (ns), by channel.
    fell_back_ns: [Option<u64>; 3],
    /// How often something learned was forgotten, on command or because it was bad.
    n_forgotten: u64,
    /// Whether the newest estimate was good enough for a checkpoint.
    is_good: bool,
    /// The states at the newest checkpoint; the learned numbers that go with them are in the channels.
    saved: Option<EngineState>,
    tick: Tick,
}

/// The present tick.
#[derive(Debug, Clone, Copy, Default)]
struct Tick {
    wake_ns: u64,
    status: u64,
    /// Bit k: a sample of sensor number k was accepted.
    sensors: u64,
    new_sample: bool,
}

impl Engine {
    /// An engine before the first sample.
    pub fn new(config: &Config, mut estimator: Estimator) -> Self {
        Self {
            window: Window::new(config.input.max_age_s, config.rate_hz, &mut estimator),
            estimator,
            gate: Gate::new(config.input, config.clock == Clock::Monotonic),
            sensors: Sensors::new(&config.sensor),
            limits: config.input,
            deadline: config.deadline,
            clock: config.clock,
            stale_after_s: config.stale_after_s,
            is_joint: [
                config.translation.as_ref().is_some_and(|channel| channel.law() == LawName::Joint),
                config.rotation.as_ref().is_some_and(|channel| channel.law() == LawName::Joint),
            ],
            checkpoint_every: ((CHECKPOINT_EVERY_S * config.rate_hz) as u64).max(1),
            counters: Counters::default(),
            sources: SourceBook::default(),
            frozen: false,
            newest_arrival_ns: None,
            fell_back_ns: [None; 3],
            n_forgotten: 0,
            is_good: true,
            saved: None,
            tick: Tick::default(),
        }
    }

    /// Begins a tick that woke at `wake_ns`, after this many ticks in a row that ended too late.
    pub fn begin(&mut self, wake_ns: u64, late_ticks_in_a_row: u64) {
        let late = |after: u64| after > 0 && late_ticks_in_a_row >= after;
        let DeadlineConfig { warn_after_ticks, predict_only_after_ticks, invalid_after_ticks } =
            self.deadline;
        let status = bit(late(warn_after_ticks), status_bits::LATE)
            | bit(late(predict_only_after_ticks), status_bits::PREDICT_ONLY)
            | bit(late(invalid_after_ticks), status_bits::INVALID);
        self.tick = Tick { wake_ns, status, sensors: 0, new_sample: false };
    }

    /// Takes a sample of `source` that arrived by the time of the wake-up.
    pub fn take(&mut self, measurement: &Measurement, source: u128) {
        let wake_ns = self.tick.wake_ns;
        if self.tick.status & status_bits::PREDICT_ONLY != 0 || self.window.is_full() {
            self.gate.turn_away(measurement, source, wake_ns);
            self.reject(Rejection::Overload, measurement, source);
            return;
        }
        let (measurement, installed) = match self.sensors.read(measurement) {
            Ok(read) => read,
            Err(reason) => {
                self.gate.turn_away(measurement, source, wake_ns);
                return self.reject(reason, measurement, source);
            }
        };
        let Measurement { stamp_ns, sequence, valid, sensor, .. } = measurement;
        let place = Place { stamp_ns, sensor, valid, source, sequence };
        let arrival = Arrival {
            now_ns: wake_ns,
            window_start_ns: self.window.start_ns(),
            is_repeated: self.window.holds(&place),
        };
        let newest_ns = self.gate.newest_stamp_ns();
        match self.gate.judge(&measurement, source, &arrival) {
            Ok(accepted) => {
                let is_late = newest_ns.is_some_and(|newest_ns| stamp_ns < newest_ns) && !accepted.new_time;
                let lost = i64::try_from(accepted.lost).unwrap_or(i64::MAX) - i64::from(accepted.found);
                let received = Received::Accepted { is_late, lost };
                self.sources.note(&measurement, source, wake_ns, received);
                self.accept(&accepted, place, installed);
            }
            Err(reason) => self.reject(reason, &measurement, source),
        }
    }

    fn reject(&mut self, reason: Rejection, measurement: &Measurement, source: u128) {
        self.sources.note(measurement, source, self.tick.wake_ns, Received::Rejected);
        self.counters.samples_rejected[reason as usize] += 1;
        self.tick.status |= status_bits::REJECTED_SAMPLE;
    }

    fn accept(&mut self, accepted: &Accepted, place: Place, installed: Installed) {
        let Accepted { mut sample, mut linear, lost, found, new_source, new_time, on_ground, .. } = *accepted;
        let Accepted { repeats, stuck, .. } = *accepted;
        (sample.lever_arm_m, sample.sensor) = (installed.lever_arm_m, installed.sensor);
        if new_time {
            self.estimator.restart();
            self.window.begin(&mut self.estimator, None);
            self.fell_back_ns = [None; 3];
        }
        // The joint law knows whether a reading had to change; where it decides, it tells.
        let law_tells = |place: usize| {
            self.limits.stuck == OutlierAction::Correction && self.is_joint.get(place) == Some(&true)
        };
        for (place, stuck) in stuck.into_iter().enumerate().filter(|(place, _)| !law_tells(*place)) {
            self.counters.outputs_stuck[place] += u64::from(stuck);
            self.tick.status |= bit(stuck, status_bits::STUCK);
        }
        let teaches = stuck.map(|stuck| !(stuck && self.limits.stuck == OutlierAction::Adaptation));
        if self.limits.stuck == OutlierAction::Correction {
            let is_out = |place: usize| stuck[place] && !self.is_joint[place];
            sample.velocity = sample.velocity.filter(|_| !is_out(0));
            sample.angular_velocity_rad_s = sample.angular_velocity_rad_s.filter(|_| !is_out(1));
            sample.velocity_quality.repeats = repeats[0];
            sample.angular_velocity_quality.repeats = repeats[1];
            linear.output = linear.output.filter(|_| !stuck[2]);
        }
        self.window.insert(Kept { place, sample, linear, frozen: self.frozen, teaches, on_ground });
        self.counters.samples_accepted += 1;
        // A forged sequence may have any gap.
        let lost_by_now = self.counters.samples_lost.saturating_add(lost);
        self.counters.samples_lost = lost_by_now.saturating_sub(u64::from(found));
        self.counters.source_changes += u64::from(new_source);
        self.tick.sensors |= 1_u64.checked_shl(place.sensor).unwrap_or(0);
        self.tick.new_sample = true;
        self.newest_arrival_ns = Some(self.tick.wake_ns);
    }

    /// Fuses what came, in the order of the stamps.
    fn fuse(&mut self) {
        let (counters, tick, sources) = (&mut self.counters, &mut self.tick, &mut self.sources);
        self.window.fuse(&mut self.estimator, |fused| {
            if let Some(nis) = fused.velocity_nis {
                sources.note_nis(fused.source, nis);
            }
            for (count, stuck) in counters.outputs_stuck.iter_mut().zip(fused.stuck) {
                *count += u64::from(stuck);
                tick.status |= bit(stuck, status_bits::STUCK);
            }
            for (count, is_outlier) in counters.outputs_held_back.iter_mut().zip(fused.outliers) {
                *count += u64::from(is_outlier);
                tick.status |= bit(is_outlier, status_bits::HELD_BACK);
            }
        });
    }

    /// The observers were set to another state: the samples of before are not fused again.
    fn begin_window(&mut self) {
        let newest_ns = self.gate.newest_stamp_ns();
        self.window.begin(&mut self.estimator, newest_ns);
    }

    /// Ends the tick and returns its estimate. The loop sets the stamp of publication.
    pub fn conclude(&mut self) -> Estimate {
        self.fuse();
        let wake_ns = self.tick.wake_ns;
        let source_stamp_ns = self.gate.newest_stamp_ns();
        let stamp_ns = match self.clock {
            Clock::Monotonic => wake_ns.max(source_stamp_ns.unwrap_or(0)),
            Clock::Samples => source_stamp_ns.unwrap_or(wake_ns),
        };
        let (state, diverged) = self.guarded_estimate(stamp_ns);
        self.counters.state_resets += u64::from(diverged);
        let status = self.tick.status
            | bit(diverged, status_bits::DIVERGED)
            | self.status_of(&state, self.age_of_newest_ns());
        let mut estimate = to_payload(&state);
        estimate.sequence = self.counters.ticks;
        estimate.source_sequence = self.gate.newest_sequence().unwrap_or(0);
        estimate.source_stamp_ns = source_stamp_ns.unwrap_or(0);
        estimate.status = status;
        estimate.sensors = self.tick.sensors;

        let counted = |bits: u64| u64::from(status & bits != 0);
        self.counters.ticks += 1;
        self.counters.ticks_coasting += counted(status_bits::COASTING);
        self.counters.ticks_clamped += counted(status_bits::CLAMPED);
        self.counters.ticks_predict_only += counted(status_bits::PREDICT_ONLY);
        self.counters.ticks_invalid += counted(status_bits::INVALID);
        estimate
    }

    /// The estimate, and whether a channel was beyond its limits and had to fall back.
    fn guarded_estimate(&mut self, stamp_ns: u64) -> (VehicleEstimate, bool) {
        let state = self.estimator.estimate(stamp_ns);
        let within = Within::of(&state, &self.limits, 1.0);
        self.is_good = Within::of(&state, &self.limits, PART_OF_LIMITS).all();
        if within.all() {
            return (state, false);
        }
        for channel in ChannelName::ALL.into_iter().filter(|&channel| !within.is(channel)) {
            let coasts = state.report(channel).is_none_or(|report| report.coasting);
            self.fall_back(channel, coasts, stamp_ns);
        }
        self.begin_window();
        (self.estimator.estimate(stamp_ns), true)
    }

    /// A channel that coasted beyond its limits has its state reset; what was learned is kept, since a long coast does not
    /// show that it is wrong. A channel that diverges while it is measured returns to the checkpoint. A second divergence
    /// within [`RELAPSE_S`] means that the checkpoint is bad: the channel begins anew, and so does its part of the checkpoint.
    fn fall_back(&mut self, name: ChannelName, coasts: bool, stamp_ns: u64) {
        let Some(channel) = self.estimator.channel_mut(name) else { return };
        if coasts {
            channel.restart();
            return;
        }
        let saved = self.saved.as_mut().map(|saved| &mut saved.estimator.channels[name as usize]);
        let before_ns = self.fell_back_ns[name as usize].replace(stamp_ns);
        if before_ns.is_some_and(|ns| stamp_ns.abs_diff(ns) < (RELAPSE_S * 1e9) as u64) {
            channel.forget();
            let state = channel.save();
            if let Some(saved) = saved {
                *saved = Some(state);
            }
            self.n_forgotten += 1;
            return;
        }
        channel.restore(saved.and_then(|saved| saved.as_ref()));
        let restored = self.estimator.estimate(stamp_ns);
        if !Within::of(&restored, &self.limits, 1.0).is(name)
            && let Some(channel) = self.estimator.channel_mut(name)
        {
            // The learned part of the checkpoint is good; its state has coasted too far by now.
            channel.restart();
        }
    }

    fn status_of(&self, state: &VehicleEstimate, age_ns: Option<u64>) -> u64 {
        let any = |test: fn(&ChannelReport) -> bool| state.reports().any(test);
        let any_reacquires = any(|channel| channel.reacquiring);
        bit(!any(|channel| channel.coasting) && !any_reacquires, status_bits::TRACKING)
            | bit(any_reacquires, status_bits::REACQUIRING)
            | self.coasting_and_stale_bits(state, age_ns)
            | bit(age_ns.is_none(), status_bits::WAITING)
            | bit(any(|channel| channel.activation > 0.0), status_bits::ADAPTING)
            | bit(any(|channel| channel.clamped), status_bits::CLAMPED)
            | bit(any(|channel| channel.outside_centers), status_bits::OUTSIDE_CENTERS)
            | bit(self.frozen, status_bits::FROZEN)
            | bit(self.window.on_ground(), status_bits::ON_GROUND)
            | bit(!self.window.is_caught_up(), status_bits::CATCHING_UP)
    }

    /// Which channels coast, and which are stale. Without any sample for `stale_after_s`, all of them are stale.
    fn coasting_and_stale_bits(&self, state: &VehicleEstimate, age_ns: Option<u64>) -> u64 {
        use status_bits::{
            COASTING_LINEAR, COASTING_ROTATION, COASTING_TRANSLATION, STALE, STALE_LINEAR, STALE_ROTATION,
            STALE_TRANSLATION,
        };
        let is_silent = age_ns.is_none_or(|age_ns| age_ns as f64 / 1e9 > self.stale_after_s);
        let bits_of = |channel: ChannelName| match channel {
            ChannelName::Translation => (COASTING_TRANSLATION, STALE_TRANSLATION),
            ChannelName::Rotation => (COASTING_ROTATION, STALE_ROTATION),
            ChannelName::Linear => (COASTING_LINEAR, STALE_LINEAR),
        };
        ChannelName::ALL.into_iter().fold(0, |bits, channel| {
            let Some(report) = state.report(channel) else { return bits };
            let (coasting, stale) = bits_of(channel);
            let is_stale = is_silent || report.output_age_s > self.stale_after_s;
            bits | bit(report.coasting, coasting) | bit(is_stale, stale | STALE)
        })
    }

    /// Age of the newest accepted sample at the wake-up (ns). If samples are the clock, their stamps are not comparable with
    /// the present time, so the time of arrival is used.
    fn age_of_newest_ns(&self) -> Option<u64> {
        let seen_ns = match self.clock {
            Clock::Monotonic => self.gate.newest_stamp_ns(),
            Clock::Samples => self.newest_arrival_ns,
        };
        seen_ns.map(|seen_ns| self.tick.wake_ns.saturating_sub(seen_ns))
    }

    /// Age of the newest sample at the wake-up (ns), on a tick with a new sample, if its stamps are of this clock.
    pub fn input_age_ns(&self) -> Option<u64> {
        self.age_of_newest_ns().filter(|_| self.tick.new_sample && self.clock == Clock::Monotonic)
    }

    /// Age of the newest output of each channel in an estimate of this engine (ns); `None` before the first, and where there
    /// is no such channel.
    pub fn output_ages_ns(&self, estimate: &Estimate) -> [Option<u64>; 3] {
        let channels = estimate.channels();
        ChannelName::ALL.map(|name| {
            let age_s = channels[name as usize].output_age_s;
            (self.estimator.channel(name).is_some() && age_s.is_finite())
                .then(|| (age_s * 1e9).round() as u64)
        })
    }

    /// Carries out a command, between two ticks.
    pub fn carry_out(&mut self, command: LoopCommand) {
        match command {
            LoopCommand::Reset => {
                // In the checkpoint, too.
                self.estimator.reset();
                self.gate.forget();
                self.window.set_on_ground(false);
                self.begin_window();
                self.newest_arrival_ns = None;
                self.n_forgotten += 1;
                self.save();
            }
            LoopCommand::Freeze => self.set_frozen(true),
            LoopCommand::Thaw => self.set_frozen(false),
        }
        self.counters.commands += 1;
    }

    /// In the checkpoint, too: a service that goes on from it does as the operator said last.
    fn set_frozen(&mut self, frozen: bool) {
        self.frozen = frozen;
        if let Some(saved) = &mut self.saved {
            saved.frozen = frozen;
        }
    }

    /// Whether a checkpoint is due now, between two ticks: the newest estimate was well within its limits.
    pub fn checkpoint_is_due(&self) -> bool {
        self.is_good
            && self.window.is_caught_up()
            && self.counters.ticks.is_multiple_of(self.checkpoint_every)
    }

    /// Whether the newest estimate is good enough for a checkpoint.
    pub fn is_good(&self) -> bool {
        self.is_good && self.window.is_caught_up()
    }

    /// How often something learned was forgotten, on command or because it was bad.
    pub fn n_forgotten(&self) -> u64 {
        self.n_forgotten
    }

    /// Saves states and weights as the checkpoint, for fallbacks and snapshots. No allocation.
    pub fn save(&mut self) {
        self.saved = Some(EngineState {
            estimator: self.estimator.save(),
            gate: self.gate.state(),
            frozen: self.frozen,
            on_ground: self.window.on_ground(),
            newest_arrival_ns: self.newest_arrival_ns,
        });
    }

    /// The states at the newest checkpoint; `None` before the first.
    pub fn saved_state(&self) -> Option<EngineState> {
        self.saved
    }

    /// How many numbers are learned.
    pub fn n_learned(&self) -> usize {
        self.estimator.n_learned()
    }

    /// The learned numbers of the newest checkpoint from `from` on, as many as `into` has room for.
    pub fn read_saved(&self, from: usize, into: &mut [f64]) {
        self.estimator.read_saved(from, into);
    }

    /// Continues from the checkpoint of an engine of the same design. With its state, the next step is the same to the bit.
    ///
    /// # Errors
    /// If the count of numbers is not that of this design, or a number is not finite: what was found, what is needed.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), String> {
        let Checkpoint { learned, state } = checkpoint;
        if learned.len() != self.n_learned() {
            return Err(format!("{} learned numbers; needed: {}", learned.len(), self.n_learned()));
        }
        if let Some(number) = learned.iter().find(|number| !number.is_finite()) {
            return Err(format!("{number} among the learned numbers; needed: finite ones"));
        }
        self.estimator.load(learned, state.as_ref().map(|state| &state.estimator));
        if let Some(state) = state {
            self.gate.resume(&state.gate);
            self.frozen = state.frozen;
            self.window.set_on_ground(state.on_ground);
            self.newest_arrival_ns = state.newest_arrival_ns;
        }
        self.begin_window();
        self.save();
        Ok(())
    }

    /// The counters.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The counters that the loop sets.
    pub fn counters_mut(&mut self) -> &mut Counters {
        &mut self.counters
    }

    /// What each source has sent.
    pub fn sources(&self) -> &SourceBook {
        &self.sources
    }

    /// The samples that may have to be fused again.
    pub fn window(&self) -> &Window {
        &self.window
    }

    /// The gate.
    pub fn gate(&self) -> &Gate {
        &self.gate
    }

    /// Whether an operator froze adaptation.
    pub fn frozen(&self) -> bool {
        self.frozen
    }
}

fn bit(set: bool, bit: u64) -> u64 {
    if set { bit } else { 0 }
}

/// Which channels are finite and within their limits.
struct Within {
    translation: bool,
    rotation: bool,
    linear: bool,
}

impl Within {
    /// Within this part of the limits.
    fn of(state: &VehicleEstimate, limits: &InputConfig, part: f64) -> Self {
        // A comparison with NaN is false, so NaN is not within the limits.
        let translation = state.rigid_body.as_ref().is_none_or(|body| {
            body.velocity_m_s.norm() <= part * limits.max_speed_m_s
                && body.position_m.norm() <= part * limits.max_position_m
                && body.matched_force_n.norm() <= part * limits.max_unknown_force_n
        });
        let rotation = state.rigid_body.as_ref().is_none_or(|body| {
            body.angular_velocity_rad_s.norm() <= part * limits.max_angular_rate_rad_s
                && body.attitude.coords.norm().is_finite()
                && body.matched_torque_n_m.norm() <= part * limits.max_unknown_torque_n_m
        });
        let linear = state.linear.as_ref().is_none_or(|linear| {
            linear.state.iter().all(|x| x.abs() <= part * limits.max_state)
                && linear.matched_input.iter().all(|f| f.abs() <= part * limits.max_input)
        });
        Self { translation, rotation, linear }
    }

    fn is(&self, channel: ChannelName) -> bool {
        match channel {
            ChannelName::Translation => self.translation,
            ChannelName::Rotation => self.rotation,
            ChannelName::Linear => self.linear,
        }
    }

    fn all(&self) -> bool {
        self.translation && self.rotation && self.linear
    }
}

/// The message of an estimate; the loop sets sequences, source, status and publication time.
pub fn to_payload(state: &VehicleEstimate) -> Estimate {
    let channel = |report: &ChannelReport| Channel {
        output_error: report.output_error,
        activation: report.activation,
        power_function: report.power_function,
        native_norm: report.native_norm,
        solver_error: report.solver_error,
        error_bound: report.error_bound,
        output_age_s: report.output_age_s,
        nis: report.nis,
    };
    let mut estimate = Estimate { attitude_wxyz: [1.0, 0.0, 0.0, 0.0], ..Estimate::default() };
    let deviations = state.rigid_body.as_ref().map_or(Deviations::UNKNOWN, |body| body.deviations);
    estimate.position_std_m = deviations.position_m;
    estimate.velocity_std_m_s = deviations.velocity_m_s;
    estimate.attitude_std_rad = deviations.attitude_rad;
    estimate.angular_velocity_std_rad_s = deviations.angular_velocity_rad_s;
    estimate.matched_force_std_n = deviations.matched_force_n;
    estimate.matched_torque_std_n_m = deviations.matched_torque_n_m;
    if let Some(body) = &state.rigid_body {
        let q = body.attitude.coords;
        estimate.stamp_ns = body.stamp_ns;
        estimate.position_m = body.position_m.into();
        estimate.velocity_m_s = body.velocity_m_s.into();
        estimate.attitude_wxyz = [q.w, q.x, q.y, q.z];
        estimate.euler_rad = body.euler_rad();
        estimate.angular_velocity_rad_s = body.angular_velocity_rad_s.into();
        estimate.matched_force_n = body.matched_force_n.into();
        estimate.matched_torque_n_m = body.matched_torque_n_m.into();
        estimate.translation = body.translation.as_ref().map(channel).unwrap_or_default();
        estimate.rotation = body.rotation.as_ref().map(channel).unwrap_or_default();
    }
    if let Some(linear) = &state.linear {
        estimate.stamp_ns = linear.stamp_ns;
        estimate.state = linear.state.into();
        estimate.matched_input = linear.matched_input.into();
        estimate.linear = channel(&linear.report);
    }
    estimate
}

#[cfg(test)]
mod tests;
