//! The tick: wake up, take every queued sample (triggered by samples: the one that woke us), step to its
//! stamp, propagate, publish; then the slack.
//!
//! [`Cycle::serve`] is all that happens between wake-up and publication: no allocation, no system call, no
//! lock, no log line. (A reader or source that connects in the very sleep before is mapped in it, once.)
//! [`Cycle::rest`] does what can wait until after publication. [`Cycle::run`] keeps the deadlines: absolute,
//! on CLOCK_MONOTONIC; a late tick is counted and skipped over, never made up.

use crate::config::{Clock, Config, InputConfig, Trigger};
use crate::estimator::{Estimator, VehicleEstimate};
use crate::gate::{Accepted, Gate};
use crate::ports::LoopPorts;
use observer::ChannelReport;
use shared_types::clock::{monotonic_ns, sleep_until_ns};
use shared_types::payload::{Channel, Estimate, Measurement, status_bits};
use std::sync::atomic::{AtomicBool, Ordering};

/// One tick takes at most this many samples: a flood cannot hold the loop.
const MOST_SAMPLES_PER_TICK: usize = 256;
/// Whoever polls for samples reads the clock only now and then: an empty look takes less than 0.1 µs.
const LOOKS_BETWEEN_CLOCKS: usize = 16;
/// A good copy of state and weights is kept this often (s).
const GOOD_COPY_EVERY_S: f64 = 0.5;

/// What the loop counts since it started; see [`shared_types::Status`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Counters {
    /// Ticks served.
    pub ticks: u64,
    /// Deadlines that passed unserved.
    pub deadline_misses: u64,
    /// Samples used.
    pub samples_accepted: u64,
    /// Samples that never arrived.
    pub samples_lost: u64,
    /// Samples rejected, by reason.
    pub samples_rejected: [u64; 11],
    /// Ticks on which a channel coasted.
    pub ticks_coasting: u64,
    /// Ticks on which σ was clamped.
    pub ticks_clamped: u64,
    /// Resets to the last good copy.
    pub state_resets: u64,
    /// Restarts and replacements of the source.
    pub source_changes: u64,
    /// Commands carried out.
    pub commands: u64,
    /// Tick records that found the ring full.
    pub records_dropped: u64,
}

/// What one tick tells the attendant thread.
#[derive(Debug, Clone, Copy)]
pub struct TickRecord {
    /// Deadline to wake-up (ns); `None` where a sample and not a deadline woke the loop.
    pub wake_up_lateness_ns: Option<u64>,
    /// Wake-up to publication (ns).
    pub step_ns: u64,
    /// Newest sample's stamp to wake-up (ns), on ticks with a new sample.
    pub input_age_ns: Option<u64>,
    /// Newest sample's stamp to publication (ns), on ticks with a new sample.
    pub source_to_publish_ns: Option<u64>,
    /// Counts after this tick.
    pub counters: Counters,
    /// Sequence of the newest accepted sample.
    pub newest_sequence: u64,
    /// Stamp of the newest accepted sample (ns).
    pub newest_stamp_ns: Option<u64>,
    /// The source in use.
    pub source: Option<u128>,
    /// Another source whose samples are refused.
    pub other_source: Option<u128>,
    /// Whether an operator froze adaptation.
    pub frozen: bool,
}

/// What an operator asks of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoopCommand {
    /// Forget state and weights.
    Reset,
    /// Stop learning.
    Freeze,
    /// Learn again.
    Thaw,
}

/// The wait-free rings between the loop and the attendant thread.
pub struct LoopRings {
    /// To the attendant.
    pub records: rtrb::Producer<TickRecord>,
    /// From the attendant.
    pub commands: rtrb::Consumer<LoopCommand>,
}

/// The loop's state.
pub struct Cycle {
    ports: LoopPorts,
    /// A sample that the wait has taken already.
    taken: Option<(Measurement, u128)>,
    observer: Estimator,
    gate: Gate,
    rings: LoopRings,
    limits: InputConfig,
    clock: Clock,
    stale_after_ns: u64,
    good_copy_every: u64,
    counters: Counters,
    frozen: bool,
    newest_arrival_ns: Option<u64>,
    record: Option<TickRecord>,
}

/// A tick of the timer: when it was due, and when the loop woke.
#[derive(Debug, Clone, Copy)]
pub struct WakeUp {
    /// When the loop woke (ns).
    pub wake_ns: u64,
    /// When it should have (ns); `None` where a sample woke it.
    pub deadline_ns: Option<u64>,
}

impl Cycle {
    /// A cycle that has seen nothing.
    pub fn new(config: &Config, observer: Estimator, ports: LoopPorts, rings: LoopRings) -> Self {
        Self {
            ports,
            taken: None,
            observer,
            gate: Gate::new(config.input, config.clock == Clock::Monotonic),
            rings,
            limits: config.input,
            clock: config.clock,
            stale_after_ns: (config.stale_after_s * 1e9) as u64,
            good_copy_every: ((GOOD_COPY_EVERY_S * config.rate_hz) as u64).max(1),
            counters: Counters::default(),
            frozen: false,
            newest_arrival_ns: None,
            record: None,
        }
    }

    /// Ticks until `stop`.
    pub fn run(&mut self, config: &Config, stop: &AtomicBool) {
        let period_ns = (1e9 / config.rate_hz) as u64;
        let spin_ns = (config.spin_us * 1e3) as u64;
        let mut deadline_ns = monotonic_ns() + period_ns;
        while !stop.load(Ordering::Relaxed) {
            let wake_up = match config.trigger {
                Trigger::Timer => wait_for_deadline(deadline_ns, spin_ns),
                Trigger::Sample => self.wait_for_sample(deadline_ns, stop),
            };
            self.serve(wake_up);
            self.rest();
            let now_ns = monotonic_ns();
            let missed = match config.trigger {
                Trigger::Timer => skip_missed(&mut deadline_ns, now_ns, period_ns),
                Trigger::Sample => {
                    deadline_ns = now_ns + period_ns;
                    0
                }
            };
            self.counters.deadline_misses += missed;
        }
    }

    /// Polls for a sample, which is then in our hands already, until the deadline.
    fn wait_for_sample(&mut self, deadline_ns: u64, stop: &AtomicBool) -> WakeUp {
        loop {
            for _ in 0..LOOKS_BETWEEN_CLOCKS {
                self.taken = self.ports.take();
                if self.taken.is_some() {
                    return WakeUp { wake_ns: monotonic_ns(), deadline_ns: None };
                }
            }
            let now_ns = monotonic_ns();
            if now_ns >= deadline_ns || stop.load(Ordering::Relaxed) {
                return WakeUp { wake_ns: now_ns, deadline_ns: Some(deadline_ns) };
            }
        }
    }

    /// Everything between wake-up and publication.
    pub fn serve(&mut self, wake_up: WakeUp) {
        let wake_ns = wake_up.wake_ns;
        let mut status = 0;
        let mut new_sample = false;
        // Whoever polls serves each sample on its own: the look that finds the queue empty comes after
        // publication, and every sample has its estimate.
        let most_samples = if self.taken.is_some() { 1 } else { MOST_SAMPLES_PER_TICK };
        for _ in 0..most_samples {
            let Some((measurement, source)) = self.taken.take().or_else(|| self.ports.take()) else { break };
            match self.gate.judge(&measurement, source, wake_ns) {
                Ok(Accepted { sample, linear, lost, new_source, new_time }) => {
                    if new_time {
                        self.observer.restart();
                    }
                    self.observer.accept(&sample, &linear);
                    self.counters.samples_accepted += 1;
                    // A forged sequence may claim any gap.
                    self.counters.samples_lost = self.counters.samples_lost.saturating_add(lost);
                    self.counters.source_changes += u64::from(new_source);
                    new_sample = true;
                    self.newest_arrival_ns = Some(wake_ns);
                }
                Err(reason) => {
                    self.counters.samples_rejected[reason as usize] += 1;
                    status |= status_bits::REJECTED_SAMPLE;
                }
            }
        }
        let source_stamp_ns = self.gate.newest_stamp_ns();
        let stamp_ns = match self.clock {
            Clock::Monotonic => wake_ns.max(source_stamp_ns.unwrap_or(0)),
            Clock::Samples => source_stamp_ns.unwrap_or(wake_ns),
        };
        let (state, diverged) = self.guarded_estimate(stamp_ns);
        if diverged {
            self.counters.state_resets += 1;
            status |= status_bits::DIVERGED;
        }
        // Where samples are the clock, their stamps say nothing about now: their arrival does.
        let seen_ns = match self.clock {
            Clock::Monotonic => source_stamp_ns,
            Clock::Samples => self.newest_arrival_ns,
        };
        let age_ns = seen_ns.map(|seen_ns| wake_ns.saturating_sub(seen_ns));
        status |= self.status_of(&state, age_ns);
        let mut estimate = to_payload(&state);
        estimate.sequence = self.counters.ticks;
        estimate.source_sequence = self.gate.newest_sequence().unwrap_or(0);
        estimate.source_stamp_ns = source_stamp_ns.unwrap_or(0);
        estimate.status = status;
        estimate.publish_stamp_ns = monotonic_ns();
        self.ports.publish(&estimate);
        let published_ns = monotonic_ns();

        self.counters.ticks += 1;
        self.counters.ticks_coasting += u64::from(status & status_bits::COASTING != 0);
        self.counters.ticks_clamped += u64::from(status & status_bits::CLAMPED != 0);
        // Where samples are the clock, the distance between their stamps and now means nothing.
        let if_new = |value: Option<u64>| value.filter(|_| new_sample && self.clock == Clock::Monotonic);
        self.record = Some(TickRecord {
            wake_up_lateness_ns: wake_up.deadline_ns.map(|deadline_ns| wake_ns.saturating_sub(deadline_ns)),
            step_ns: published_ns - wake_ns,
            input_age_ns: if_new(age_ns),
            source_to_publish_ns: if_new(
                source_stamp_ns.map(|stamp_ns| published_ns.saturating_sub(stamp_ns)),
            ),
            counters: self.counters,
            newest_sequence: self.gate.newest_sequence().unwrap_or(0),
            newest_stamp_ns: source_stamp_ns,
            source: self.gate.source(),
            other_source: self.gate.other_source(),
            frozen: self.frozen,
        });
    }

    /// The estimate, and whether the state was beyond its limits: then first the channel's last good copy is
    /// tried, and if that is no better, everything starts again.
    fn guarded_estimate(&mut self, stamp_ns: u64) -> (VehicleEstimate, bool) {
        let state = self.observer.estimate(stamp_ns);
        let within = Within::of(&state, &self.limits);
        if within.all() {
            return (state, false);
        }
        if let Some(body) = &mut self.observer.rigid_body {
            if !within.translation {
                body.restore_translation();
            }
            if !within.rotation {
                body.restore_rotation();
            }
        }
        if let Some(linear) = self.observer.linear.as_mut().filter(|_| !within.linear) {
            linear.restore_good_copy();
        }
        let restored = self.observer.estimate(stamp_ns);
        if Within::of(&restored, &self.limits).all() {
            return (restored, true);
        }
        self.observer.reset();
        (self.observer.estimate(stamp_ns), true)
    }

    fn status_of(&self, state: &VehicleEstimate, age_ns: Option<u64>) -> u64 {
        let any = |test: fn(&ChannelReport) -> bool| state.reports().any(test);
        let coasting = |channel: Option<ChannelReport>| channel.is_some_and(|channel| channel.coasting);
        let bit = |set: bool, bit: u64| if set { bit } else { 0 };
        let body = state.rigid_body.as_ref();
        let linear = state.linear.map(|linear| linear.report);
        bit(!any(|channel| channel.coasting), status_bits::TRACKING)
            | bit(coasting(body.and_then(|body| body.translation)), status_bits::COASTING_TRANSLATION)
            | bit(coasting(body.and_then(|body| body.rotation)), status_bits::COASTING_ROTATION)
            | bit(coasting(linear), status_bits::COASTING_LINEAR)
            | bit(age_ns.is_none_or(|age_ns| age_ns > self.stale_after_ns), status_bits::STALE)
            | bit(age_ns.is_none(), status_bits::WAITING)
            | bit(any(|channel| channel.activation > 0.0), status_bits::ADAPTING)
            | bit(any(|channel| channel.clamped), status_bits::CLAMPED)
            | bit(any(|channel| channel.outside_centers), status_bits::OUTSIDE_CENTERS)
            | bit(self.frozen, status_bits::FROZEN)
    }

    /// What can wait until after publication.
    pub fn rest(&mut self) {
        self.ports.prepare();
        while let Ok(command) = self.rings.commands.pop() {
            match command {
                LoopCommand::Reset => {
                    self.observer.reset();
                    self.observer.keep_good_copy();
                    self.gate.forget();
                    self.newest_arrival_ns = None;
                }
                LoopCommand::Freeze => self.frozen = true,
                LoopCommand::Thaw => self.frozen = false,
            }
            self.observer.set_frozen(self.frozen);
            self.counters.commands += 1;
        }
        if let Some(mut record) = self.record.take() {
            record.counters = self.counters;
            record.frozen = self.frozen;
            if self.rings.records.push(record).is_err() {
                self.counters.records_dropped += 1;
            }
        }
        // What is published was checked to be within limits, or is new: this is a good moment.
        if self.counters.ticks.is_multiple_of(self.good_copy_every) {
            self.observer.keep_good_copy();
        }
    }
}

/// Moves a deadline to the next one of its grid that is not over, and counts those that are.
pub fn skip_missed(deadline_ns: &mut u64, now_ns: u64, period_ns: u64) -> u64 {
    *deadline_ns += period_ns;
    let missed = match now_ns.checked_sub(*deadline_ns) {
        Some(late_ns) if late_ns > 0 => late_ns / period_ns + 1,
        _ => 0,
    };
    *deadline_ns += missed * period_ns;
    missed
}

/// Sleeps to `spin_ns` before the deadline and polls the clock for the rest.
pub fn wait_for_deadline(deadline_ns: u64, spin_ns: u64) -> WakeUp {
    let sleep_end_ns = deadline_ns.saturating_sub(spin_ns);
    loop {
        let now_ns = monotonic_ns();
        if now_ns >= deadline_ns {
            return WakeUp { wake_ns: now_ns, deadline_ns: Some(deadline_ns) };
        }
        if now_ns < sleep_end_ns {
            sleep_until_ns(sleep_end_ns);
        } else {
            std::hint::spin_loop();
        }
    }
}

/// Which channels are finite and plausible.
struct Within {
    translation: bool,
    rotation: bool,
    linear: bool,
}

impl Within {
    fn of(state: &VehicleEstimate, limits: &InputConfig) -> Self {
        // A comparison with NaN is false, so what is not finite is not within.
        let translation = state.rigid_body.as_ref().is_none_or(|body| {
            body.velocity_m_s.norm() <= limits.max_speed_m_s
                && body.position_m.norm() <= limits.max_position_m
                && body.matched_force_n.norm() <= limits.max_unknown_force_n
        });
        let rotation = state.rigid_body.as_ref().is_none_or(|body| {
            body.angular_velocity_rad_s.norm() <= limits.max_angular_rate_rad_s
                && body.attitude.coords.norm().is_finite()
                && body.matched_torque_n_m.norm() <= limits.max_unknown_torque_n_m
        });
        let linear = state.linear.as_ref().is_none_or(|linear| {
            linear.state.iter().all(|x| x.abs() <= limits.max_state)
                && linear.matched_input.iter().all(|f| f.abs() <= limits.max_input)
        });
        Self { translation, rotation, linear }
    }

    fn all(&self) -> bool {
        self.translation && self.rotation && self.linear
    }
}

/// The published form of an estimate; sequences, source, status and publication time are the loop's.
pub fn to_payload(state: &VehicleEstimate) -> Estimate {
    let channel = |report: &ChannelReport| Channel {
        output_error: report.output_error,
        activation: report.activation,
        power_function: report.power_function,
        native_norm: report.native_norm,
        solver_error: report.solver_error,
        error_bound: report.error_bound,
        output_age_s: report.output_age_s,
    };
    let mut estimate = Estimate { attitude_wxyz: [1.0, 0.0, 0.0, 0.0], ..Estimate::default() };
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
mod tests {
    use super::skip_missed;

    #[test]
    fn late_ticks_are_counted_and_skipped_over() {
        for (now_ns, next_ns, misses) in [
            (1010, 1100, 0),
            (1100, 1100, 0),
            (1101, 1200, 1),
            (1199, 1200, 1),
            (1201, 1300, 2),
            (9950, 10_000, 89),
        ] {
            let mut deadline_ns = 1000;
            assert_eq!(skip_missed(&mut deadline_ns, now_ns, 100), misses, "at {now_ns}");
            assert_eq!(deadline_ns, next_ns, "at {now_ns}");
        }
    }
}
