//! Requests messages from the vehicle, one at a time, because an answer names the command and not the message.

use crate::settings::{Settings, Source};
use crate::tally::{Tally, name_of};
use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_QUATERNION_DATA, ATTITUDE_TARGET_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA,
    LOCAL_POSITION_NED_DATA, MavCmd, MavMessage, MavResult, ODOMETRY_DATA,
};

/// An answer is waited for this long (ns).
const ANSWER_NS: u64 = 1_000_000_000;
const MAX_ATTEMPTS: u32 = 5;
/// The messages that together have the contents of ODOMETRY.
const PAIR_IDS: [u32; 2] = [LOCAL_POSITION_NED_DATA::ID, ATTITUDE_QUATERNION_DATA::ID];

/// The output: messages for the vehicle, and lines for the operator.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    pub(crate) replies: Vec<MavMessage>,
    pub(crate) notes: Vec<String>,
}

#[derive(Debug, Clone, Copy)]
struct Request {
    message_id: u32,
    attempts: u32,
    asked_at_ns: u64,
    is_answered: bool,
}

impl Request {
    fn of(message_id: u32) -> Self {
        Self { message_id, attempts: 0, asked_at_ns: 0, is_answered: false }
    }
}

/// The requests that the vehicle has not granted yet.
#[derive(Debug)]
pub(crate) struct Requests {
    settings: Settings,
    list: Vec<Request>,
}

impl Requests {
    pub(crate) fn new(settings: Settings) -> Self {
        Self { settings, list: Vec::new() }
    }

    /// Begins anew: after a reboot the vehicle has forgotten its rates.
    pub(crate) fn begin(&mut self) {
        if self.settings.request_rate_hz.is_none() {
            return;
        }
        let of_source: &[u32] = match self.settings.source {
            Source::Auto | Source::Odometry => &[ODOMETRY_DATA::ID],
            Source::LocalPosition => &PAIR_IDS,
        };
        let thrust = self.settings.thrust_n.map(|_| ATTITUDE_TARGET_DATA::ID);
        self.list = of_source.iter().copied().chain(thrust).map(Request::of).collect();
    }

    /// Asks for the first message that is not granted yet, again after each second without an answer.
    pub(crate) fn poll(&mut self, now_ns: u64, vehicle: Option<u8>, tally: &Tally, out: &mut Outbox) {
        let (Some(rate_hz), Some(system_id)) = (self.settings.request_rate_hz, vehicle) else { return };
        let Some(request) = self.list.iter_mut().find(|request| !request.is_answered) else { return };
        if request.attempts > 0 && now_ns.saturating_sub(request.asked_at_ns) < ANSWER_NS {
            return;
        }
        if request.attempts >= MAX_ATTEMPTS {
            request.is_answered = true;
            let message_id = request.message_id;
            // Some vehicles send the message without an answer.
            if !tally.has_heard(message_id) {
                self.not_granted(message_id, "no answer", out);
            }
            return;
        }
        (request.attempts, request.asked_at_ns) = (request.attempts + 1, now_ns);
        out.replies.push(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1: request.message_id as f32,
            param2: (1e6 / rate_hz) as f32,
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            target_system: system_id,
            target_component: self.settings.component_id,
            confirmation: (request.attempts - 1) as u8,
            ..COMMAND_LONG_DATA::default()
        }));
    }

    /// Takes the vehicle's answer to the request that is open.
    pub(crate) fn answered(&mut self, answer: &COMMAND_ACK_DATA, out: &mut Outbox) {
        if answer.command != MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL {
            return;
        }
        let mut open = self.list.iter_mut().filter(|request| request.attempts > 0 && !request.is_answered);
        let Some(request) = open.next() else { return };
        request.is_answered = true;
        let message_id = request.message_id;
        if answer.result != MavResult::MAV_RESULT_ACCEPTED {
            self.not_granted(message_id, &format!("{:?}", answer.result), out);
        }
    }

    fn not_granted(&mut self, message_id: u32, reason: &str, out: &mut Outbox) {
        out.notes.push(format!("asked for {}: {reason}", name_of(message_id)));
        if message_id == ODOMETRY_DATA::ID && self.settings.source == Source::Auto {
            self.list.extend(PAIR_IDS.map(Request::of));
        }
    }
}
