//! The tick: wake up, take the queued samples, step to their stamps, propagate, publish. The [`Engine`] makes all
//! decisions; this file calls it at the right times.
//!
//! | function | part of the tick |
//! |---|---|
//! | [`Cycle::serve`] | from wake-up to publication: no allocation, no system call, no lock, no log line |
//! | [`Cycle::rest`] | after publication: everything that can wait |
//! | [`Cycle::run`] | the deadlines, absolute on CLOCK_MONOTONIC. A missed deadline is counted and not made up for |
//!
//! With a timer, a tick takes every queued sample; when triggered by samples, the one that woke it. One exception to
//! "no system call": a reader or source that has connected during the preceding sleep is mapped in `serve`, once.

use crate::config::{Config, Trigger};
use crate::deadline::{WakeUp, skip_missed, wait_for_deadline};
use crate::engine::{Engine, LoopCommand};
use crate::limits::MAX_SAMPLES_PER_TICK;
use crate::ports::LoopPorts;
use crate::sensor_clocks::{ClockOffsets, SensorClocks};
use crate::source_book::SourceBook;
use crate::threads::recorder::RecorderRing;
use crate::threads::snapshot_writer::SnapshotRing;
use flight_record::Entry;
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Counters, Measurement, status_bits};
use std::sync::atomic::{AtomicBool, Ordering};

/// The polling loop reads the clock once in this many polls; a poll of an empty queue takes less than 0.1 µs.
const LOOKS_BETWEEN_CLOCKS: usize = 16;

/// The record of one tick for the housekeeping thread.
#[derive(Debug, Clone, Copy)]
pub struct TickRecord {
    /// When the tick woke (ns).
    pub wake_ns: u64,
    /// Deadline to wake-up (ns); `None` where a sample and not a deadline woke the loop.
    pub wake_up_lateness_ns: Option<u64>,
    /// Wake-up to publication (ns).
    pub step_ns: u64,
    /// Newest sample's stamp to wake-up (ns), on ticks with a new sample.
    pub input_age_ns: Option<u64>,
    /// Newest sample's stamp to publication (ns), on ticks with a new sample.
    pub source_to_publish_ns: Option<u64>,
    /// Ticks before this one, in a row, that ended after their next deadline.
    pub late_ticks_in_a_row: u64,
    /// Counts after this tick.
    pub counters: Counters,
    /// Sequence of the newest accepted sample.
    pub newest_sequence: u64,
    /// Stamp of the newest accepted sample (ns).
    pub newest_stamp_ns: Option<u64>,
    /// Age of the newest output of each channel in this tick's estimate (ns); `None` before the first, and where there is
    /// no such channel.
    pub output_ages_ns: [Option<u64>; 3],
    /// Normalized innovation squared of the newest output of each channel.
    pub nis: [f64; 3],
    /// What each source has sent.
    pub sources: SourceBook,
    /// The clocks of the sensors that have another one.
    pub clock_offsets_ns: ClockOffsets,
    /// The source in use.
    pub source: Option<u128>,
    /// Another source whose samples are refused.
    pub other_source: Option<u128>,
    /// Whether a sensor repeated itself in a sample of this tick.
    pub stuck: bool,
    /// Whether an operator froze adaptation.
    pub frozen: bool,
}

/// The wait-free rings between the loop and the housekeeping thread.
pub struct LoopRings {
    /// To the housekeeping thread.
    pub records: rtrb::Producer<TickRecord>,
    /// From the housekeeping thread.
    pub commands: rtrb::Consumer<LoopCommand>,
    /// To the flight record.
    pub recorder: RecorderRing,
    /// To the thread that writes snapshots.
    pub snapshots: SnapshotRing,
}

/// The loop's state.
pub struct Cycle {
    ports: LoopPorts,
    /// A sample that the wait has taken already.
    taken: Option<(Measurement, u128)>,
    clocks: SensorClocks,
    engine: Engine,
    rings: LoopRings,
    /// Ticks in a row that ended after their next deadline.
    late_ticks_in_a_row: u64,
    /// As the engine returned it last.
    n_forgotten: u64,
    record: Option<TickRecord>,
}

impl Cycle {
    /// A cycle that runs this engine, with sensors of these clocks.
    pub fn new(engine: Engine, clocks: SensorClocks, ports: LoopPorts, rings: LoopRings) -> Self {
        Self {
            ports,
            taken: None,
            clocks,
            engine,
            rings,
            late_ticks_in_a_row: 0,
            n_forgotten: 0,
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
            self.engine.counters_mut().deadline_misses += missed;
            self.late_ticks_in_a_row = if missed > 0 { self.late_ticks_in_a_row + 1 } else { 0 };
        }
        self.save_to_the_end();
    }

    /// Polls for a sample until the deadline. A sample that is found has been taken from the queue.
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
        let late_ticks_in_a_row = self.late_ticks_in_a_row;
        self.rings.recorder.begin_tick(&Entry::Begin { wake_ns, late_ticks_in_a_row });
        self.engine.begin(wake_ns, late_ticks_in_a_row);
        // A polling loop serves one sample per tick: every sample has its estimate, and the poll that finds the queue
        // empty comes after publication.
        let max_samples = if self.taken.is_some() { 1 } else { MAX_SAMPLES_PER_TICK };
        for _ in 0..max_samples {
            let Some((measurement, source)) = self.taken.take().or_else(|| self.ports.take()) else { break };
            let measurement = self.clocks.on_our_clock(measurement, wake_ns);
            self.rings.recorder.push(|| Entry::Sample { source, measurement });
            self.engine.take(&measurement, source);
        }
        let mut estimate = self.engine.conclude();
        estimate.publish_stamp_ns = monotonic_ns();
        self.ports.publish(&estimate);
        let published_ns = monotonic_ns();

        self.rings.recorder.push(|| Entry::Estimate(estimate));
        let input_age_ns = self.engine.input_age_ns();
        let gate = self.engine.gate();
        self.record = Some(TickRecord {
            wake_ns,
            wake_up_lateness_ns: wake_up.deadline_ns.map(|deadline_ns| wake_ns.saturating_sub(deadline_ns)),
            step_ns: published_ns - wake_ns,
            input_age_ns,
            source_to_publish_ns: input_age_ns.map(|_| published_ns.saturating_sub(estimate.source_stamp_ns)),
            late_ticks_in_a_row,
            counters: *self.engine.counters(),
            newest_sequence: estimate.source_sequence,
            newest_stamp_ns: gate.newest_stamp_ns(),
            output_ages_ns: self.engine.output_ages_ns(&estimate),
            nis: estimate.channels().map(|channel| channel.nis),
            sources: *self.engine.sources(),
            clock_offsets_ns: *self.clocks.offsets_ns(),
            source: gate.source(),
            other_source: gate.other_source(),
            stuck: estimate.status & status_bits::STUCK != 0,
            frozen: self.engine.frozen(),
        });
    }

    /// What can wait until after publication.
    pub fn rest(&mut self) {
        self.ports.prepare();
        while let Ok(command) = self.rings.commands.pop() {
            self.engine.carry_out(command);
            self.rings.recorder.push(|| Entry::Command(command));
        }
        if let Some(mut record) = self.record.take() {
            let counters = self.engine.counters_mut();
            counters.ticks_not_recorded = self.rings.recorder.left_out();
            record.counters = *counters;
            record.frozen = self.engine.frozen();
            if self.rings.records.push(record).is_err() {
                self.engine.counters_mut().records_dropped += 1;
            }
        }
        // While a checkpoint is read in parts it must not change, unless a channel was forgotten meanwhile.
        let snapshots = &mut self.rings.snapshots;
        if std::mem::replace(&mut self.n_forgotten, self.engine.n_forgotten()) != self.engine.n_forgotten() {
            snapshots.start_over();
        }
        let (engine, may_change) = (&self.engine, !snapshots.is_reading());
        let is_asked = may_change && engine.is_good() && snapshots.take_request();
        if is_asked || (may_change && engine.checkpoint_is_due()) {
            self.save();
        }
        self.rings.snapshots.read_a_part(&self.engine);
    }

    fn save(&mut self) {
        self.engine.save();
        self.rings.recorder.push(|| Entry::Checkpoint);
    }

    /// After the last tick: hands over the present checkpoint, in place of one that was being read.
    fn save_to_the_end(&mut self) {
        if self.engine.is_good() {
            self.save();
        }
        self.rings.snapshots.read_at_once(&self.engine);
    }
}
