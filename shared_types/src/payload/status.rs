//! The operator's messages: counters and status of the service, commands, and the replies that carry the status.

use crate::payload::rejection::{REASONS, Rejection};
use crate::service::MAX_SOURCES;
use crate::table::{AGE_PER_CHANNEL, Message, PER_CHANNEL, Payload, SIZE_PER_CHANNEL, Value};
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

payload! {
    /// What the engine and its loop count since they started.
    #[derive(Default, Eq, Serialize, Deserialize)]
    pub struct Counters: "observer.Counters.v2" {
        /// Ticks served, each with one estimate.
        ticks: u64,
        /// Deadlines that passed unserved because a tick ended too late; they were skipped.
        deadline_misses: u64,
        /// Samples used.
        samples_accepted: u64,
        /// Gaps in the source's sequence: samples that never arrived.
        samples_lost: u64,
        /// Samples rejected, by [`Rejection`].
        samples_rejected: [u64; REASONS.names.len()] { components: REASONS },
        /// Outputs that were outliers against the running scale of their errors, and were held back from adaptation or
        /// from correction too: of translation, rotation, linear plant.
        outputs_held_back: [u64; 3] { components: PER_CHANNEL },
        /// Outputs that repeated the previous one to the bit, for longer than a working sensor does; likewise.
        outputs_stuck: [u64; 3] { components: PER_CHANNEL },
        /// Ticks on which a channel coasted.
        ticks_coasting: u64,
        /// Ticks on which the dead zone's output was clamped to the stability bound.
        ticks_clamped: u64,
        /// Ticks on which samples were not used because the loop was late.
        ticks_predict_only: u64,
        /// Ticks whose estimate was marked invalid.
        ticks_invalid: u64,
        /// Times the state was reset to the last checkpoint.
        state_resets: u64,
        /// Times the source restarted or another one took over.
        source_changes: u64,
        /// Commands carried out.
        commands: u64,
        /// Tick records that the housekeeping thread was too slow to take.
        records_dropped: u64,
        /// Ticks that the recorder was too slow to take.
        ticks_not_recorded: u64,
    }
}

impl Counters {
    /// Each counter in words with its value, those of several numbers with the parts that are not 0: for people.
    ///
    /// `samples rejected`, `3 (1 not finite, 2 too late)`
    pub fn lines(&self) -> impl Iterator<Item = (String, String)> {
        let in_words = |name: &str| name.replace('_', " ");
        Self::TABLE.fields.iter().enumerate().map(move |(i, field)| {
            let text = match self.value(i) {
                Value::Integer(count) => count.to_string(),
                Value::Integers(counts) => {
                    let parts = counts.iter().zip(field.components.names).filter(|(count, _)| **count > 0);
                    let parts: Vec<_> =
                        parts.map(|(count, name)| format!("{count} {}", in_words(name))).collect();
                    let total: u64 = counts.iter().sum();
                    if total == 0 { "0".into() } else { format!("{total} ({})", parts.join(", ")) }
                }
                _ => String::new(),
            };
            (in_words(field.name), text)
        })
    }

    /// Samples rejected for any reason.
    pub fn samples_rejected_total(&self) -> u64 {
        self.samples_rejected.iter().sum()
    }

    /// Samples rejected for one reason.
    pub fn rejected(&self, reason: Rejection) -> u64 {
        self.samples_rejected[reason as usize]
    }
}

constants! {
    /// Bits of [`Status::real_time_requested`] and [`Status::real_time_granted`].
    pub mod real_time: u64 with words {
        /// A fixed priority (SCHED_FIFO) for the loop.
        PRIORITY = 1 << 0, "priority";
        /// Cores of the loop's own choice.
        CORES = 1 << 1, "cores";
        /// Memory that is neither swapped out nor mapped late.
        LOCKED_MEMORY = 1 << 2, "locked memory";
        /// Timers without slack.
        PUNCTUAL_TIMERS = 1 << 3, "punctual timers";
        /// Cores that wake up at once.
        AWAKE_CORES = 1 << 4, "awake cores";
    }
}

constants! {
    /// Values of [`Status::snapshot_restored`].
    pub mod restored: u64 {
        /// The service started with nothing learned.
        NOTHING = 0;
        /// It started with what an earlier one had learned.
        LEARNED = 1;
        /// It started with that and with the state, and goes on from there.
        LEARNED_AND_STATE = 2;
    }
}

payload! {
    /// Quantiles of one latency (ns) since the service started.
    #[derive(Default, Eq, Serialize, Deserialize)]
    pub struct LatencySummary: "observer.LatencySummary.v1" {
        /// Number of values.
        count: u64,
        /// Median.
        p50: u64,
        /// 90 % quantile.
        p90: u64,
        /// 99 % quantile.
        p99: u64,
        /// 99.9 % quantile.
        p999: u64,
        /// Largest value.
        max: u64,
    }
}

payload! {
    /// What the service did since it started.
    #[derive(Default, Serialize, Deserialize)]
    pub struct Status: "observer.Status.v6" {
        /// Counts publications from 0.
        sequence: u64,
        /// CLOCK_MONOTONIC of this status (ns).
        stamp_ns: u64,
        /// CLOCK_MONOTONIC of the service's start (ns).
        start_stamp_ns: u64,
        /// Configured rate (mHz: 200 Hz is 200 000).
        rate_millihertz: u64,
        /// d, the width of the dead zone of translation (m/s), rotation (rad/s), linear plant (its output's unit): up to
        /// it an output error is noise, and nothing is learned; 0 where there is no such channel.
        dead_zone_width: [f64; 3] { components: SIZE_PER_CHANNEL },
        /// What the engine and its loop counted.
        #[serde(flatten)]
        counters: Counters,
        /// Sequence of the newest accepted sample.
        newest_sequence: u64,
        /// Age of the newest accepted sample (ns); the largest number before the first.
        newest_sample_age_ns: u64 { unknown: Some(u64::MAX) },
        /// Age of the newest output of each channel (ns): of translation, rotation, linear plant; the largest number
        /// before the first, and where there is no such channel.
        output_age_ns: [u64; 3] { components: AGE_PER_CHANNEL, unknown: Some(u64::MAX) },
        /// Normalized innovation squared of the newest output of each channel, as `nis` of an estimate's channels.
        nis: [f64; 3] { components: SIZE_PER_CHANNEL },
        /// Process id of the source in use; 0 if none or unknown.
        source_pid: u64,
        /// Process id of another source that publishes too; 0 if none.
        other_source_pid: u64,
        /// Of each source that has sent, in the order of appearance: process id; 0 where there is no source, or none any more.
        source_pids: [u64; MAX_SOURCES],
        /// Number of its `[[sensor]]`; 0: none.
        source_sensors: [u64; MAX_SOURCES],
        /// Age of its newest sample since it arrived (ns); the largest number where there is no source.
        source_ages_ns: [u64; MAX_SOURCES] { unknown: Some(u64::MAX) },
        /// The usual time between two of its samples (ns); 0 before the second.
        source_periods_ns: [u64; MAX_SOURCES],
        /// Median of the delays of its samples, from stamp to arrival (ns).
        source_delays_ns: [u64; MAX_SOURCES],
        /// The largest delay (ns).
        source_max_delays_ns: [u64; MAX_SOURCES],
        /// Its samples that were used.
        source_accepted: [u64; MAX_SOURCES],
        /// Of these, those that came after a newer one of any source.
        source_late: [u64; MAX_SOURCES],
        /// Gaps in its sequence.
        source_lost: [u64; MAX_SOURCES],
        /// Its samples that were rejected.
        source_rejected: [u64; MAX_SOURCES],
        /// Recent mean of the normalized innovation squared of its velocities, about 1 where their noise is right; 0 where it has
        /// none, and with the gradient law.
        source_nis: [f64; MAX_SOURCES],
        /// 1 while adaptation is frozen by an operator.
        adaptation_frozen: u64,
        /// Ticks in a row that ended after their next deadline, now.
        late_ticks_in_a_row: u64,
        /// The most so far.
        most_late_ticks_in_a_row: u64,
        /// Real-time settings that the configuration asks for: bits of [`real_time`].
        real_time_requested: u64 { words: Some(&real_time::TABLE) },
        /// Real-time settings that the system granted.
        real_time_granted: u64 { words: Some(&real_time::TABLE) },
        /// What was restored at the start: one of [`restored`].
        snapshot_restored: u64,
        /// Snapshots written.
        snapshots_saved: u64,
        /// Snapshots that could not be written.
        snapshots_failed: u64,
        /// CLOCK_MONOTONIC of the state in the newest snapshot of this service (ns); 0 if none.
        snapshot_stamp_ns: u64,
        /// Ticks written to the flight record.
        ticks_recorded: u64,
        /// Deadline to wake-up (ns).
        wake_up_lateness_ns: LatencySummary,
        /// Wake-up to publication: samples taken, stepped, estimate written (ns).
        step_ns: LatencySummary,
        /// Source stamp of the newest sample to wake-up, on ticks with a new sample (ns).
        input_age_ns: LatencySummary,
        /// Source stamp of the newest sample to publication, on ticks with a new sample (ns).
        source_to_publish_ns: LatencySummary,
    }
}

/// What a status says of one source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SourceStatus {
    /// Its process; 0: it has ended, or is unknown.
    pub pid: u64,
    /// Number of its `[[sensor]]`; 0: none.
    pub sensor: u64,
    /// Age of its newest sample (ns).
    pub age_ns: u64,
    /// The usual time between two (ns).
    pub period_ns: u64,
    /// Median of the delays from stamp to arrival (ns).
    pub delay_ns: u64,
    /// The largest of them (ns).
    pub max_delay_ns: u64,
    /// Samples used.
    pub accepted: u64,
    /// Of these, those that came after a newer one of any source.
    pub late: u64,
    /// Gaps in its sequence.
    pub lost: u64,
    /// Samples rejected.
    pub rejected: u64,
    /// Recent mean of the normalized innovation squared of its velocities; 0: none.
    pub nis: f64,
}

impl SourceStatus {
    /// Samples per second, of late; `None` before the second one.
    pub fn rate_hz(&self) -> Option<f64> {
        (self.period_ns > 0).then(|| 1e9 / self.period_ns as f64)
    }
}

impl Status {
    /// The sources that have sent.
    pub fn sources(&self) -> impl Iterator<Item = SourceStatus> {
        let has_sent = |k: &usize| self.source_accepted[*k] + self.source_rejected[*k] > 0;
        (0..MAX_SOURCES).filter(has_sent).map(|k| SourceStatus {
            pid: self.source_pids[k],
            sensor: self.source_sensors[k],
            age_ns: self.source_ages_ns[k],
            period_ns: self.source_periods_ns[k],
            delay_ns: self.source_delays_ns[k],
            max_delay_ns: self.source_max_delays_ns[k],
            accepted: self.source_accepted[k],
            late: self.source_late[k],
            lost: self.source_lost[k],
            rejected: self.source_rejected[k],
            nis: self.source_nis[k],
        })
    }

    /// Sets the row of a source.
    pub fn set_source(&mut self, k: usize, source: &SourceStatus) {
        self.source_pids[k] = source.pid;
        self.source_sensors[k] = source.sensor;
        self.source_ages_ns[k] = source.age_ns;
        self.source_periods_ns[k] = source.period_ns;
        self.source_delays_ns[k] = source.delay_ns;
        self.source_max_delays_ns[k] = source.max_delay_ns;
        self.source_accepted[k] = source.accepted;
        self.source_late[k] = source.late;
        self.source_lost[k] = source.lost;
        self.source_rejected[k] = source.rejected;
        self.source_nis[k] = source.nis;
    }
}

constants! {
    /// Values of [`Command::kind`].
    pub mod command: u32 {
        /// Forget state and weights; start again from the next sample.
        RESET = 1;
        /// Stop learning; keep using what was learned.
        FREEZE = 2;
        /// Learn again.
        THAW = 3;
        /// Write the learned weights to disk.
        SAVE = 4;
        /// Only answer with the status.
        STATUS = 5;
    }
}

constants! {
    /// Values of [`Reply::outcome`].
    pub mod outcome: u32 {
        /// Done: the loop has carried the command out.
        DONE = 0;
        /// Refused: `message` says why.
        REFUSED = 1;
        /// The command's kind is unknown to this service.
        UNKNOWN = 2;
    }
}

payload! {
    /// An operator's request.
    #[derive(Default, Eq)]
    pub struct Command: "observer.Command.v1" {
        /// One of [`command`].
        kind: u32,
        /// Zero.
        reserved: u32,
    }
}

payload! {
    /// The service's answer, with its status after the command.
    pub struct Reply: "observer.Reply.v6" {
        /// One of [`outcome`].
        outcome: u32,
        /// Bytes of `message` in use.
        message_bytes: u32,
        /// UTF-8 text.
        message: [u8; 248],
        /// Status after the command.
        status: Status,
    }
}

impl Default for Reply {
    fn default() -> Self {
        Self::new(outcome::DONE, "", Status::default())
    }
}

impl Reply {
    /// A reply whose text is cut at a character's boundary if it does not fit.
    pub fn new(outcome: u32, text: &str, status: Status) -> Self {
        let mut message = [0; 248];
        let end = text.floor_char_boundary(message.len());
        message[..end].copy_from_slice(&text.as_bytes()[..end]);
        Self { outcome, message_bytes: end as u32, message, status }
    }

    /// The text, or nothing where the bytes are no text.
    pub fn text(&self) -> &str {
        let end = (self.message_bytes as usize).min(self.message.len());
        str::from_utf8(&self.message[..end]).unwrap_or("")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_counter_is_told_in_words() {
        let mut counters = Counters { ticks: 7, outputs_stuck: [0, 2, 0], ..Counters::default() };
        counters.samples_rejected[Rejection::NotFinite as usize] = 1;
        counters.samples_rejected[Rejection::TooLate as usize] = 2;
        let lines: Vec<_> = counters.lines().map(|(name, text)| format!("{name} {text}")).collect();
        assert_eq!(lines.len(), Counters::TABLE.fields.len());
        for needed in [
            "ticks 7",
            "samples lost 0",
            "samples rejected 3 (1 not finite, 2 too late)",
            "outputs stuck 2 (2 rotation)",
        ] {
            assert!(lines.iter().any(|line| line == needed), "{needed}: {lines:?}");
        }
    }

    #[test]
    fn a_reply_cuts_its_text_at_a_character() {
        let long = "ä".repeat(200);
        let reply = Reply::new(outcome::REFUSED, &long, Status::default());
        assert_eq!(reply.text(), "ä".repeat(124));
        assert_eq!(Reply { message_bytes: u32::MAX, ..reply }.text(), "ä".repeat(124));
    }
}
