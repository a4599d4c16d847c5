//! The housekeeping thread: collects the loop's records, publishes the status, answers commands and writes the log.

use crate::config::{Config, MAX_SENSOR, SensorConfig};
use crate::cycle::TickRecord;
use crate::engine::LoopCommand;
use crate::latency::Latency;
use crate::log::say;
use crate::ports::HousekeepingPorts;
use crate::sensor_clocks::ClockOffsets;
use crate::system::service_manager::ServiceManager;
use crate::system::settings::Outcome;
use crate::threads::recorder::RecorderProgress;
use crate::threads::snapshot_writer::SaverHandle;
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Counters, Rejection, Reply, SourceStatus, Status, command, outcome};
use shared_types::service::MAX_SOURCES;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock, mpsc};
use std::time::{Duration, Instant};

const LOOK_EVERY: Duration = Duration::from_millis(5);
const STATUS_EVERY: Duration = Duration::from_millis(200);
/// A loop that has not carried out a command after this long is reported as stuck.
const LOOP_PATIENCE: Duration = Duration::from_secs(2);
/// Longest wait for a snapshot: a disk may be slow, and a million centers are read in parts.
const SAVE_PATIENCE: Duration = Duration::from_secs(120);
/// Rare samples are logged after this many statuses in a row with them.
const STATUSES_BEFORE_RARE_SAMPLES_ARE_LOGGED: u32 = 10;
/// A sensor is silent after this many of its expected periods.
const PERIODS_OF_SILENCE: f64 = 3.0;
/// The channels by their measured quantity, as the counters of three are ordered.
const QUANTITIES: [&str; 3] = ["velocity", "angular velocity", "output"];

/// The wait-free rings between this thread and the loop, and the progress of the writers.
pub struct HousekeepingRings {
    /// From the loop.
    pub records: rtrb::Consumer<TickRecord>,
    /// To the loop.
    pub commands: rtrb::Producer<LoopCommand>,
    /// Of the saver thread, if there is one.
    pub saver: Option<SaverHandle>,
    /// What the recorder thread has done, if there is one.
    pub record_progress: Option<Arc<RecorderProgress>>,
}

/// The thread's state.
pub struct Housekeeping {
    ports: HousekeepingPorts,
    rings: HousekeepingRings,
    newest: Option<TickRecord>,
    wake_up_lateness: Latency,
    step: Latency,
    input_age: Latency,
    source_to_publish: Latency,
    start_ns: u64,
    rate_millihertz: u64,
    dead_zone_width: [f64; 3],
    sensors: Vec<SensorConfig>,
    restored: u64,
    most_late_ticks_in_a_row: u64,
    statuses: u64,
    logged: Logged,
    /// The settings that the system granted to the loop, once they are known.
    real_time: Arc<OnceLock<Outcome>>,
    service_manager: ServiceManager,
}

/// The counters at the last log.
#[derive(Default)]
struct Logged {
    counters: Counters,
    other_source: Option<u128>,
    waiting: bool,
    statuses_with_rare_samples: u32,
    /// Which sensors were silent.
    silent: [bool; MAX_SENSOR as usize + 1],
    clock_offsets_ns: ClockOffsets,
}

impl Housekeeping {
    /// The housekeeping of a loop that starts now with this configuration and with what was `restored`, one of
    /// [`shared_types::payload::restored`].
    pub fn new(ports: HousekeepingPorts, rings: HousekeepingRings, config: &Config, restored: u64) -> Self {
        Self {
            ports,
            rings,
            newest: None,
            wake_up_lateness: Latency::new(),
            step: Latency::new(),
            input_age: Latency::new(),
            source_to_publish: Latency::new(),
            start_ns: monotonic_ns(),
            rate_millihertz: (config.rate_hz * 1e3).round() as u64,
            dead_zone_width: config.dead_zone_width(),
            sensors: config.sensor.clone(),
            restored,
            most_late_ticks_in_a_row: 0,
            statuses: 0,
            logged: Logged::default(),
            real_time: Arc::default(),
            service_manager: ServiceManager::of_this_process(),
        }
    }

    /// Sets where the outcome of the loop's real-time settings will be stored.
    pub fn with_real_time(self, real_time: Arc<OnceLock<Outcome>>) -> Self {
        Self { real_time, ..self }
    }

    /// Serves until `stop`; then publishes a last status that covers every tick.
    pub fn run(mut self, stop: &AtomicBool) -> Status {
        let mut last_status = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            self.keep_up();
            self.serve_commands();
            if last_status.elapsed() >= STATUS_EVERY {
                last_status = Instant::now();
                let status = self.publish_status();
                self.service_manager.describe(&status);
                self.log();
            }
            std::thread::sleep(LOOK_EVERY);
        }
        self.gather();
        self.publish_status()
    }

    /// Gathers the records and feeds the watchdog; done also while a command is waited for.
    fn keep_up(&mut self) {
        self.gather();
        self.service_manager.feed_watchdog(self.newest.map_or(0, |record| record.counters.ticks));
    }

    fn gather(&mut self) {
        while let Ok(record) = self.rings.records.pop() {
            self.wake_up_lateness.note(record.wake_up_lateness_ns);
            self.step.note(Some(record.step_ns));
            self.input_age.note(record.input_age_ns);
            self.source_to_publish.note(record.source_to_publish_ns);
            self.most_late_ticks_in_a_row = self.most_late_ticks_in_a_row.max(record.late_ticks_in_a_row);
            self.newest = Some(record);
        }
    }

    fn publish_status(&mut self) -> Status {
        let status = self.status();
        self.statuses += 1;
        self.ports.publish(&status);
        status
    }

    fn status(&self) -> Status {
        let mut status = Status {
            sequence: self.statuses,
            stamp_ns: monotonic_ns(),
            start_stamp_ns: self.start_ns,
            rate_millihertz: self.rate_millihertz,
            dead_zone_width: self.dead_zone_width,
            counters: self.newest.map_or_else(Counters::default, |record| record.counters),
            newest_sample_age_ns: u64::MAX,
            output_age_ns: [u64::MAX; 3],
            source_ages_ns: [u64::MAX; MAX_SOURCES],
            wake_up_lateness_ns: self.wake_up_lateness.summary(),
            step_ns: self.step.summary(),
            input_age_ns: self.input_age.summary(),
            source_to_publish_ns: self.source_to_publish.summary(),
            snapshot_restored: self.restored,
            most_late_ticks_in_a_row: self.most_late_ticks_in_a_row,
            ..Status::default()
        };
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        if let Some(SaverHandle { progress, .. }) = &self.rings.saver {
            status.snapshots_saved = read(&progress.saved);
            status.snapshots_failed = read(&progress.failed);
            status.snapshot_stamp_ns = read(&progress.stamp_ns);
        }
        if let Some(progress) = &self.rings.record_progress {
            status.ticks_recorded = read(&progress.written);
            status.counters.ticks_not_recorded += read(&progress.failed);
        }
        if let Some(outcome) = self.real_time.get() {
            status.real_time_requested = outcome.requested;
            status.real_time_granted = outcome.granted;
        }
        let Some(record) = &self.newest else { return status };
        status.late_ticks_in_a_row = record.late_ticks_in_a_row;
        status.newest_sequence = record.newest_sequence;
        if let Some(stamp_ns) = record.newest_stamp_ns {
            status.newest_sample_age_ns = status.stamp_ns.saturating_sub(stamp_ns);
        }
        let since_tick_ns = status.stamp_ns.saturating_sub(record.wake_ns);
        status.output_age_ns = record
            .output_ages_ns
            .map(|age_ns| age_ns.map_or(u64::MAX, |age_ns| age_ns.saturating_add(since_tick_ns)));
        status.nis = record.nis;
        let pid = |source: Option<u128>| source.and_then(|source| self.ports.source_pid(source)).unwrap_or(0);
        for (k, row) in record.sources.rows().enumerate() {
            let source = SourceStatus {
                pid: pid(Some(row.source)),
                sensor: row.sensor.into(),
                age_ns: status.stamp_ns.saturating_sub(row.arrival_ns),
                period_ns: row.period_ns as u64,
                delay_ns: row.delay_ns as u64,
                max_delay_ns: row.max_delay_ns,
                accepted: row.accepted,
                late: row.late,
                lost: row.lost,
                rejected: row.rejected,
                nis: row.nis,
            };
            status.set_source(k, &source);
        }
        status.source_pid = pid(record.source);
        status.other_source_pid = pid(record.other_source);
        status.adaptation_frozen = u64::from(record.frozen);
        status
    }

    fn serve_commands(&mut self) {
        while let Some(request) = self.ports.request() {
            let reply = self.carry_out(request.kind());
            request.answer(reply);
        }
    }

    fn carry_out(&mut self, kind: u32) -> Reply {
        let (loop_command, done) = match kind {
            command::RESET => (LoopCommand::Reset, "state and learned weights forgotten"),
            command::FREEZE => (LoopCommand::Freeze, "adaptation frozen; what was learned stays in use"),
            command::THAW => (LoopCommand::Thaw, "adaptation resumed"),
            command::STATUS => return Reply::new(outcome::DONE, &self.running(), self.status()),
            command::SAVE => return self.save(),
            _ => {
                let message = format!("command {kind} is unknown; needed: 1 … 5");
                return Reply::new(outcome::UNKNOWN, &message, self.status());
            }
        };
        let before = self.commands_done();
        let deadline = Instant::now() + LOOP_PATIENCE;
        let sent = self.rings.commands.push(loop_command).is_ok();
        while sent && Instant::now() < deadline {
            self.gather();
            if self.commands_done() > before {
                return Reply::new(outcome::DONE, done, self.status());
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let message = format!(
            "the loop did not answer within {} s: it is stuck; should it go on, it carries this out",
            LOOP_PATIENCE.as_secs()
        );
        Reply::new(outcome::REFUSED, &message, self.status())
    }

    fn save(&mut self) -> Reply {
        let Some(SaverHandle { save_requests, .. }) = &self.rings.saver else {
            let message = "no directory for snapshots: start it with --state DIR";
            return Reply::new(outcome::REFUSED, message, self.status());
        };
        let (answer, answered) = mpsc::sync_channel(1);
        let requested = save_requests.send(answer).is_ok();
        let deadline = Instant::now() + SAVE_PATIENCE;
        while requested && Instant::now() < deadline {
            self.keep_up();
            match answered.recv_timeout(LOOK_EVERY) {
                Ok(Ok(message)) => return Reply::new(outcome::DONE, &message, self.status()),
                Ok(Err(message)) => return Reply::new(outcome::REFUSED, &message, self.status()),
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
            }
        }
        let message = format!("nothing was saved within {} s", SAVE_PATIENCE.as_secs());
        Reply::new(outcome::REFUSED, &message, self.status())
    }

    /// The message of a reply: that the service runs, and the system's reasons for refusals, for which the status has only bits.
    fn running(&self) -> String {
        match self.real_time.get() {
            Some(real_time) if !real_time.refused.is_empty() => {
                format!("running; real time refused: {}", real_time.refused_in_short())
            }
            _ => "running".into(),
        }
    }

    fn commands_done(&self) -> u64 {
        self.newest.map_or(0, |record| record.counters.commands)
    }

    fn log(&mut self) {
        let Some(record) = &self.newest else { return };
        let now = record.counters;
        let before = std::mem::replace(&mut self.logged.counters, now);
        if record.source.is_none() && !std::mem::replace(&mut self.logged.waiting, true) {
            say!("no sample yet; waiting for a source");
        }
        if now.source_changes != before.source_changes {
            let pid =
                |source: u128| self.ports.source_pid(source).map_or("unknown".into(), |pid| pid.to_string());
            match record.sources.rows().filter(|row| row.accepted > 0).count() {
                0 | 1 => {
                    let pid = record.source.map_or("unknown".into(), pid);
                    say!("source of samples is process {pid} (change {})", now.source_changes);
                }
                n => {
                    let pids: Vec<_> = record.sources.rows().map(|row| pid(row.source)).collect();
                    say!(
                        "{n} sources of samples: processes {} (change {})",
                        pids.join(", "),
                        now.source_changes
                    );
                }
            }
        }
        if record.other_source.is_some() && record.other_source != self.logged.other_source {
            if let Some(pid) = record.other_source.and_then(|source| self.ports.source_pid(source)) {
                say!(
                    "process {pid} publishes too and is refused; stop one of the two (input.source decides who wins)"
                );
            }
            self.logged.other_source = record.other_source;
        }
        for reason in Rejection::ALL {
            let n = now.samples_rejected[reason as usize];
            if is_news(before.samples_rejected[reason as usize], n) {
                say!("{n} samples rejected: {}", reason.words());
            }
        }
        for (channel, quantity) in QUANTITIES.into_iter().enumerate() {
            let (held_back, stuck) = (now.outputs_held_back[channel], now.outputs_stuck[channel]);
            if is_news(before.outputs_held_back[channel], held_back) {
                say!(
                    "{held_back} measurements of the {quantity} are outliers and held back (input.outliers)"
                );
            }
            if is_news(before.outputs_stuck[channel], stuck) {
                say!(
                    "the sensor of the {quantity} is stuck: it repeats one value to the bit (input.stuck), {stuck} samples by now"
                );
            }
        }
        if is_news(before.ticks_predict_only, now.ticks_predict_only) {
            say!(
                "warning: the loop is late, {} ticks in a row: samples are not used ({} ticks by now); a lower rate_hz or fewer centers would help",
                record.late_ticks_in_a_row,
                now.ticks_predict_only
            );
        }
        if is_news(before.ticks_invalid, now.ticks_invalid) {
            say!(
                "warning: the loop is late for too long: {} estimates are marked invalid by now",
                now.ticks_invalid
            );
        }
        if is_news(before.ticks_not_recorded, now.ticks_not_recorded) {
            say!("warning: the disk is too slow: {} ticks are not recorded by now", now.ticks_not_recorded);
        }
        if now.state_resets != before.state_resets {
            say!("warning: the state left its limits and fell back ({} times)", now.state_resets);
        }
        self.log_rare_samples(&before, &now);
        self.log_silent_sensors();
        self.log_clocks();
    }

    /// Logs a sensor that is silent for three of its expected periods, and its return.
    fn log_silent_sensors(&mut self) {
        let Some(record) = &self.newest else { return };
        let now_ns = monotonic_ns();
        for SensorConfig { name, number, rate_hz, .. } in self.sensors.iter().filter(|s| s.rate_hz > 0.0) {
            let rows = record.sources.rows().filter(|row| row.sensor == *number);
            let since_ns = rows.map(|row| row.arrival_ns).max().unwrap_or(self.start_ns);
            let silence_s = now_ns.saturating_sub(since_ns) as f64 / 1e9;
            let is_silent = silence_s * rate_hz > PERIODS_OF_SILENCE;
            let before = std::mem::replace(&mut self.logged.silent[*number as usize], is_silent);
            if is_silent && !before {
                say!(
                    "sensor {name} (number {number}) is silent for {silence_s:.1} s; expected: {rate_hz} Hz"
                );
            } else if before && !is_silent {
                say!("sensor {name} (number {number}) sends again");
            }
        }
    }

    /// Logs how a sensor's clock differs, when that is found and when it has moved by a second.
    fn log_clocks(&mut self) {
        let Some(record) = &self.newest else { return };
        for SensorConfig { name, number, .. } in &self.sensors {
            let place = *number as usize;
            let Some(offset_ns) = record.clock_offsets_ns[place] else { continue };
            let logged = &mut self.logged.clock_offsets_ns[place];
            if logged.is_none_or(|logged_ns| offset_ns.abs_diff(logged_ns) > 1_000_000_000) {
                *logged = Some(offset_ns);
                let offset_s = offset_ns as f64 / 1e9;
                say!("sensor {name} (number {number}): CLOCK_MONOTONIC is its clock {offset_s:+.6} s");
            }
        }
    }

    /// Logs that samples arrive while many ticks coast: the source is slower than configured.
    fn log_rare_samples(&mut self, before: &Counters, now: &Counters) {
        let ticks = now.ticks - before.ticks;
        let coasting = now.ticks_coasting - before.ticks_coasting;
        let rare = now.samples_accepted > before.samples_accepted && 3 * coasting > ticks;
        let in_a_row = &mut self.logged.statuses_with_rare_samples;
        *in_a_row = if rare { in_a_row.saturating_add(1) } else { 0 };
        if *in_a_row == STATUSES_BEFORE_RARE_SAMPLES_ARE_LOGGED {
            say!(
                "samples keep coming, and yet {coasting} of {ticks} ticks coast: is a sensor slower than rate_hz, or lossy? \
                 (translation.sample_rate_hz, rotation.sample_rate_hz)"
            );
        }
    }
}

/// Whether a count is to be logged: its first, then each power of ten, so that a flood of events is no flood of lines.
fn is_news(before: u64, now: u64) -> bool {
    now.checked_ilog10() > before.checked_ilog10()
}
