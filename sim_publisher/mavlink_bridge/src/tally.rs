//! Counts of the messages that arrived, and of what was done with them.

use mavlink::dialects::common::MavMessage;
use std::collections::BTreeMap;

/// Messages that are counted by name.
const MAX_NAMES: usize = 64;

/// Counts of the messages and of what was done with them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tally {
    /// Messages of the vehicle, by name.
    pub messages: BTreeMap<&'static str, u64>,
    /// Frames of other systems, or of other components of the vehicle.
    pub frames_of_others: u64,
    /// Frames of the vehicle that are missing in its own count.
    pub frames_lost: u64,
    /// Messages whose content the common set does not allow.
    pub unreadable: u64,
    /// ODOMETRY in other axes, or of a failed estimator.
    pub refused: u64,
    /// Whole messages without a single usable number.
    pub empty: u64,
    /// Samples whose time is not later than that of the one before.
    pub out_of_order: u64,
    /// Resets of the vehicle's clock.
    pub clock_resets: u64,
    /// Jumps of the vehicle's estimate (ODOMETRY's reset_counter).
    pub estimate_resets: u64,
    /// Samples made.
    pub samples: u64,
    /// Of them, with a force.
    pub samples_with_force: u64,
}

impl Tally {
    pub(crate) fn count_message(&mut self, message_id: u32) {
        let name = name_of(message_id);
        if self.messages.len() < MAX_NAMES || self.messages.contains_key(name) {
            *self.messages.entry(name).or_default() += 1;
        }
    }

    /// Whether a message of this kind came.
    pub(crate) fn has_heard(&self, message_id: u32) -> bool {
        self.messages.contains_key(name_of(message_id))
    }
}

/// The name in the message set.
pub(crate) fn name_of(message_id: u32) -> &'static str {
    MavMessage::all_messages().iter().find(|(_, id)| *id == message_id).map_or("unknown", |(name, _)| name)
}
