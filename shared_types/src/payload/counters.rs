//! What the engine and its loop count since they started.

use crate::payload::rejection::{REASONS, Rejection};
use crate::table::PER_CHANNEL;
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

payload! {
    /// What the engine and its loop count since they started.
    #[derive(Default, Eq, Serialize, Deserialize)]
    pub struct Counters: "observer.Counters.v1" {
        /// Ticks served, each with one estimate.
        ticks: u64,
        /// Deadlines that passed unserved because a tick ended too late; they were skipped.
        deadline_misses: u64,
        /// Samples used.
        samples_accepted: u64,
        /// Gaps in the source's sequence: samples that never arrived.
        samples_lost: u64,
        /// Samples rejected, by [`Rejection`].
        samples_rejected: [u64; 11] { components: REASONS },
        /// Outputs that were outliers against the running scale of their errors, and were held back from adaptation or
        /// from correction too: of translation, rotation, linear plant.
        outputs_held_back: [u64; 3] { components: PER_CHANNEL },
        /// Outputs that repeated the previous one to the bit, for longer than a living sensor does; likewise.
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
    /// Samples rejected for any reason.
    pub fn samples_rejected_total(&self) -> u64 {
        self.samples_rejected.iter().sum()
    }

    /// Samples rejected for one reason.
    pub fn rejected(&self, reason: Rejection) -> u64 {
        self.samples_rejected[reason as usize]
    }
}
