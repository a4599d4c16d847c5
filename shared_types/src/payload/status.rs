//! What the service publishes a few times a second about itself.

use crate::payload::counters::Counters;
use crate::table::SIZE_PER_CHANNEL;
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

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
    pub struct Status: "observer.Status.v4" {
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
        /// Process id of the source in use; 0 if none or unknown.
        source_pid: u64,
        /// Process id of another source that publishes too; 0 if none.
        other_source_pid: u64,
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
