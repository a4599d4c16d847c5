//! What the engine and its loop count since they started.

use crate::payload::rejection::{REASONS, Rejection};
use crate::table::{Message, PER_CHANNEL, Payload, Value};
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
    /// Each counter in words with its value, those of several numbers with the parts that are not 0: for people.
    ///
    /// `samples rejected`, `3 (1 not finite, 2 older stamp)`
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_counter_is_told_in_words() {
        let mut counters = Counters { ticks: 7, outputs_stuck: [0, 2, 0], ..Counters::default() };
        counters.samples_rejected[Rejection::NotFinite as usize] = 1;
        counters.samples_rejected[Rejection::OlderStamp as usize] = 2;
        let lines: Vec<_> = counters.lines().map(|(name, text)| format!("{name} {text}")).collect();
        assert_eq!(lines.len(), Counters::TABLE.fields.len());
        for needed in [
            "ticks 7",
            "samples lost 0",
            "samples rejected 3 (1 not finite, 2 older stamp)",
            "outputs stuck 2 (2 rotation)",
        ] {
            assert!(lines.iter().any(|line| line == needed), "{needed}: {lines:?}");
        }
    }
}
