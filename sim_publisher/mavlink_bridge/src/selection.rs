//! Selects the vehicle that is followed: the one of `--system-id`, or the first autopilot from which a message arrives.

use crate::frames::{Frame, Peer};
use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot,
    ODOMETRY_DATA,
};
use std::collections::BTreeSet;

/// Other systems that are remembered.
const MAX_OTHERS: usize = 64;

/// The vehicle that is followed.
#[derive(Debug)]
pub(crate) struct Selection {
    component_id: u8,
    /// Known once a message has arrived, or configured.
    pub(crate) system_id: Option<u8>,
    /// The kind of autopilot, from its HEARTBEAT.
    pub(crate) autopilot: Option<MavAutopilot>,
    /// Where its frames come from.
    pub(crate) peer: Peer,
    /// Systems and components that send messages and are not followed.
    pub(crate) others: BTreeSet<(u8, u8)>,
    next_sequence: Option<u8>,
}

/// A frame of the vehicle.
pub(crate) struct Followed {
    /// Whether it is the first one.
    pub(crate) is_first: bool,
    /// Frames that are missing before it.
    pub(crate) lost: u64,
}

impl Selection {
    pub(crate) fn new(system_id: Option<u8>, component_id: u8) -> Self {
        let others = BTreeSet::new();
        Self { component_id, system_id, autopilot: None, peer: None, others, next_sequence: None }
    }

    /// `heartbeat` is the autopilot that a HEARTBEAT names. `None` where the frame is of another system.
    pub(crate) fn take(
        &mut self,
        frame: &Frame,
        heartbeat: Option<MavAutopilot>,
        from: Peer,
    ) -> Option<Followed> {
        let is_right_component = frame.component_id == self.component_id;
        if self.system_id.is_none() && is_right_component {
            let is_autopilot = match frame.message_id {
                HEARTBEAT_DATA::ID => heartbeat != Some(MavAutopilot::MAV_AUTOPILOT_INVALID),
                message_id => is_motion(message_id),
            };
            self.system_id = is_autopilot.then_some(frame.system_id);
        }
        if self.system_id != Some(frame.system_id) || !is_right_component {
            if self.others.len() < MAX_OTHERS {
                self.others.insert((frame.system_id, frame.component_id));
            }
            return None;
        }
        let is_first = self.next_sequence.is_none();
        self.peer = from;
        // A frame that is late, or comes twice, is no loss.
        let gap = frame.sequence.wrapping_sub(self.next_sequence.unwrap_or(frame.sequence));
        let lost = if gap < 128 { gap } else { 0 };
        if gap < 128 {
            self.next_sequence = Some(frame.sequence.wrapping_add(1));
        }
        Some(Followed { is_first, lost: lost.into() })
    }
}

fn is_motion(message_id: u32) -> bool {
    [ODOMETRY_DATA::ID, LOCAL_POSITION_NED_DATA::ID, ATTITUDE_DATA::ID, ATTITUDE_QUATERNION_DATA::ID]
        .contains(&message_id)
}
