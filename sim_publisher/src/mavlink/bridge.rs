//! What is done with what arrives: which vehicle is followed, which messages make a sample, and when it was. Time and
//! bytes are arguments; nothing here waits, reads a clock or sends.
//!
//! LOCAL_POSITION_NED and ATTITUDE(_QUATERNION) come each at its own time. Those whose times differ by no more than the
//! stated tolerance are one sample, at the newer time; a sample waits no longer than the tolerance for its other half,
//! and not at all where the vehicle sends no other half. ODOMETRY is whole, and while it comes the others are not used.

use super::clock::{Observed, VehicleClock};
use super::convert::{self, Motion};
use super::frames::{Decoder, Frame, FrameTally};
use mavlink::MessageData;
use mavlink::dialects::common::{
    ACTUATOR_CONTROL_TARGET_DATA, ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, ATTITUDE_TARGET_DATA,
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavCmd,
    MavFrame, MavMessage, MavResult, ODOMETRY_DATA, TIMESYNC_DATA,
};
use shared_types::Measurement;
use shared_types::payload::valid;
use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;

/// Senders whose unfinished frames are kept apart.
const MAX_PEERS: usize = 16;
/// Systems and messages that are remembered by name.
const MAX_NAMES: usize = 64;
/// What was not heard for so long does not come any more, and a set-point as old as this is not used (ns).
const RECENT_NS: u64 = 1_000_000_000;
/// How long an answer to a request is waited for, and how often it is asked for (ns).
const ANSWER_NS: u64 = 1_000_000_000;
const MOST_REQUESTS: u32 = 5;

/// Where bytes come from: an address, or the one other end of a serial line.
pub type Peer = Option<SocketAddr>;

/// Which messages are taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Source {
    /// ODOMETRY where it comes, else the others
    #[default]
    Auto,
    /// ODOMETRY alone
    Odometry,
    /// LOCAL_POSITION_NED with ATTITUDE_QUATERNION or ATTITUDE
    LocalPosition,
}

/// What to take, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The vehicle; `None` for the first autopilot that is heard.
    pub system_id: Option<u8>,
    /// Which part of it.
    pub component_id: u8,
    /// Which messages.
    pub source: Source,
    /// Times that differ by no more than this are one sample (ns).
    pub join_ns: u64,
    /// Force of a thrust set-point of 1 (N).
    pub thrust_n: Option<f64>,
    /// Torque of a torque set-point of 1 (N·m), about each axis of the body.
    pub torque_n_m: Option<[f64; 3]>,
    /// How often the vehicle is asked to send what is taken (Hz).
    pub request_rate_hz: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            system_id: None,
            component_id: 1,
            source: Source::Auto,
            join_ns: 5_000_000,
            thrust_n: None,
            torque_n_m: None,
            request_rate_hz: None,
        }
    }
}

/// What came, and what became of it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tally {
    /// Messages of the vehicle, by name.
    pub messages: BTreeMap<&'static str, u64>,
    /// Frames of other systems, or of other parts of the vehicle.
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
    /// Times that the vehicle's clock was set anew.
    pub clock_resets: u64,
    /// Times that the vehicle's estimate jumped (ODOMETRY's reset_counter).
    pub estimate_resets: u64,
    /// Samples made.
    pub samples: u64,
    /// Of them, with a force.
    pub samples_with_force: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Half {
    Whole,
    Position,
    Attitude,
}

/// The two clocks of MAVLink's messages, which need not be the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TimeBase {
    Microseconds,
    Milliseconds,
}

#[derive(Debug, Clone, Copy)]
struct Pending {
    sample: Measurement,
    base: TimeBase,
    oldest_ns: i128,
    newest_ns: i128,
    receive_ns: u64,
    halves: (bool, bool),
}

#[derive(Debug, Clone, Copy)]
struct Request {
    message_id: u32,
    asked: u32,
    asked_at_ns: u64,
    answered: bool,
}

impl Request {
    fn of(message_id: u32) -> Self {
        Self { message_id, asked: 0, asked_at_ns: 0, answered: false }
    }
}

/// Together they say what ODOMETRY says.
const PAIR_IDS: [u32; 2] = [LOCAL_POSITION_NED_DATA::ID, ATTITUDE_QUATERNION_DATA::ID];

/// The vehicle's messages as samples.
#[derive(Debug)]
pub struct Bridge {
    settings: Settings,
    decoders: Vec<(Peer, Decoder)>,
    /// Of decoders that were given up.
    earlier: FrameTally,
    tally: Tally,
    vehicle: Option<u8>,
    vehicle_peer: Peer,
    autopilot: Option<MavAutopilot>,
    others: BTreeSet<(u8, u8)>,
    next_frame: Option<u8>,
    microseconds: VehicleClock,
    milliseconds: VehicleClock,
    newest_stamp_ns: u64,
    pending: Option<Pending>,
    /// When the first of them came; nobody knows then what else will.
    began_ns: Option<u64>,
    /// When each half, ODOMETRY, and ATTITUDE_QUATERNION came last.
    position_at_ns: Option<u64>,
    attitude_at_ns: Option<u64>,
    odometry_at_ns: Option<u64>,
    quaternion_at_ns: Option<u64>,
    attitude: Option<([f64; 4], u64)>,
    thrust: Option<(f64, u64)>,
    torque: Option<([f64; 3], u64)>,
    frame: MavFrame,
    reset_counter: Option<u8>,
    requests: Vec<Request>,
    refusal_told: bool,
    /// What may happen with every message is told once a second at most.
    jump_told_ns: Option<u64>,
    reset_told_ns: Option<u64>,
    signed_told: bool,
    samples: Vec<Measurement>,
    replies: Vec<MavMessage>,
    notes: Vec<String>,
}

impl Bridge {
    /// Nothing heard yet.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            decoders: Vec::new(),
            earlier: FrameTally::default(),
            tally: Tally::default(),
            vehicle: settings.system_id,
            vehicle_peer: None,
            autopilot: None,
            others: BTreeSet::new(),
            next_frame: None,
            microseconds: VehicleClock::default(),
            milliseconds: VehicleClock::default(),
            newest_stamp_ns: 0,
            pending: None,
            began_ns: None,
            position_at_ns: None,
            attitude_at_ns: None,
            odometry_at_ns: None,
            quaternion_at_ns: None,
            attitude: None,
            thrust: None,
            torque: None,
            frame: MavFrame::MAV_FRAME_LOCAL_NED,
            reset_counter: None,
            requests: Vec::new(),
            refusal_told: false,
            jump_told_ns: None,
            reset_told_ns: None,
            signed_told: false,
            samples: Vec::new(),
            replies: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// What became of what came.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// What came, as bytes.
    pub fn frame_tally(&self) -> FrameTally {
        self.decoders.iter().fold(self.earlier, |sum, (_, decoder)| sum.plus(decoder.tally()))
    }

    /// The system that is followed, once it was heard or named.
    pub fn vehicle(&self) -> Option<u8> {
        self.vehicle
    }

    /// What kind of autopilot it said to be.
    pub fn autopilot(&self) -> Option<MavAutopilot> {
        self.autopilot
    }

    /// Where the vehicle's frames come from.
    pub fn vehicle_peer(&self) -> Peer {
        self.vehicle_peer
    }

    /// Systems and components that were heard and are not followed.
    pub fn others(&self) -> &BTreeSet<(u8, u8)> {
        &self.others
    }

    /// Axes in which the vehicle gives its pose.
    pub fn frame(&self) -> MavFrame {
        self.frame
    }

    /// The clock in use: that of ODOMETRY where it comes.
    pub fn clock(&self) -> &VehicleClock {
        if self.odometry_at_ns.is_some() { &self.microseconds } else { &self.milliseconds }
    }

    /// Samples since the last call, oldest first.
    pub fn take_samples(&mut self) -> Vec<Measurement> {
        std::mem::take(&mut self.samples)
    }

    /// What the vehicle is to be answered.
    pub fn take_replies(&mut self) -> Vec<MavMessage> {
        std::mem::take(&mut self.replies)
    }

    /// What an operator is to be told.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Takes bytes that arrived at `receive_ns`.
    pub fn receive(&mut self, bytes: &[u8], from: Peer, receive_ns: u64) {
        let known = self.decoders.iter().position(|(peer, _)| *peer == from);
        let mut decoder = match known {
            Some(at) => self.decoders.remove(at).1,
            None => Decoder::default(),
        };
        if self.decoders.len() >= MAX_PEERS {
            self.earlier = self.earlier.plus(self.decoders.remove(0).1.tally());
        }
        decoder.feed(bytes);
        decoder.take_all(|frame| self.take(frame, from, receive_ns));
        if decoder.tally().signed > 0 && !self.signed_told {
            self.signed_told = true;
            self.notes.push(
                "frames are signed; nobody checks that here, and what is sent has no signature: \
                 a vehicle that insists on one will not listen"
                    .into(),
            );
        }
        self.decoders.push((from, decoder));
    }

    /// What is due without a message: a sample whose other half does not come, a request that was not answered.
    pub fn turn(&mut self, now_ns: u64) {
        if self.pending.is_some_and(|p| now_ns.saturating_sub(p.receive_ns) >= self.settings.join_ns) {
            self.complete();
        }
        self.ask(now_ns);
    }

    /// Whether a half waits for its other half.
    pub fn waits(&self) -> bool {
        self.pending.is_some()
    }

    fn take(&mut self, frame: &Frame, from: Peer, receive_ns: u64) {
        let is_right_part = frame.component_id == self.settings.component_id;
        let heartbeat = (frame.message_id == HEARTBEAT_DATA::ID)
            .then(|| read::<HEARTBEAT_DATA>(frame).map(|heartbeat| heartbeat.autopilot));
        if self.vehicle.is_none() && is_right_part {
            let is_autopilot = match heartbeat {
                Some(said) => said != Some(MavAutopilot::MAV_AUTOPILOT_INVALID),
                None => is_motion(frame.message_id),
            };
            if is_autopilot {
                self.vehicle = Some(frame.system_id);
            }
        }
        if self.vehicle != Some(frame.system_id) || !is_right_part {
            self.tally.frames_of_others += 1;
            if self.others.len() < MAX_NAMES {
                self.others.insert((frame.system_id, frame.component_id));
            }
            return;
        }
        if self.next_frame.is_none() {
            let system_id = frame.system_id;
            self.notes.push(format!("following system {system_id}, component {}", frame.component_id));
            self.begin_requests();
        }
        self.vehicle_peer = from;
        // A frame that is late, or comes twice, is no loss.
        let gap = frame.sequence.wrapping_sub(self.next_frame.unwrap_or(frame.sequence));
        if gap < 128 {
            self.tally.frames_lost += u64::from(gap);
            self.next_frame = Some(frame.sequence.wrapping_add(1));
        }
        let name = name_of(frame.message_id);
        if self.tally.messages.len() < MAX_NAMES || self.tally.messages.contains_key(name) {
            *self.tally.messages.entry(name).or_default() += 1;
        }
        if self.understand(frame, heartbeat.flatten(), receive_ns).is_none() {
            self.tally.unreadable += 1;
        }
    }

    /// `None` where the content cannot be.
    fn understand(&mut self, frame: &Frame, autopilot: Option<MavAutopilot>, receive_ns: u64) -> Option<()> {
        let takes_pair = match self.settings.source {
            // Axes of another heading would turn the vehicle within one stream.
            Source::Auto => {
                self.frame != MavFrame::MAV_FRAME_LOCAL_FRD && !is_recent(self.odometry_at_ns, receive_ns)
            }
            Source::Odometry => false,
            Source::LocalPosition => true,
        };
        match frame.message_id {
            HEARTBEAT_DATA::ID => self.autopilot = Some(autopilot?),
            ODOMETRY_DATA::ID if self.settings.source != Source::LocalPosition => {
                self.take_odometry(&read(frame)?, receive_ns);
            }
            LOCAL_POSITION_NED_DATA::ID if takes_pair => {
                let message: LOCAL_POSITION_NED_DATA = read(frame)?;
                self.position_at_ns = Some(receive_ns);
                self.frame = MavFrame::MAV_FRAME_LOCAL_NED;
                let motion = convert::local_position(&message);
                self.join_half(Half::Position, message.time_boot_ms, receive_ns, motion);
            }
            ATTITUDE_QUATERNION_DATA::ID if takes_pair => {
                let message: ATTITUDE_QUATERNION_DATA = read(frame)?;
                (self.quaternion_at_ns, self.attitude_at_ns) = (Some(receive_ns), Some(receive_ns));
                let motion = convert::attitude_quaternion(&message);
                self.join_half(Half::Attitude, message.time_boot_ms, receive_ns, motion);
            }
            ATTITUDE_DATA::ID if takes_pair && !is_recent(self.quaternion_at_ns, receive_ns) => {
                let message: ATTITUDE_DATA = read(frame)?;
                self.attitude_at_ns = Some(receive_ns);
                let motion = convert::attitude(&message);
                self.join_half(Half::Attitude, message.time_boot_ms, receive_ns, motion);
            }
            ATTITUDE_TARGET_DATA::ID => {
                let thrust = read::<ATTITUDE_TARGET_DATA>(frame)?.thrust;
                self.thrust = thrust.is_finite().then_some((f64::from(thrust), receive_ns)).or(self.thrust);
            }
            ACTUATOR_CONTROL_TARGET_DATA::ID => {
                if let Some((torque, thrust)) = convert::actuators(&read(frame)?) {
                    (self.torque, self.thrust) = (Some((torque, receive_ns)), Some((thrust, receive_ns)));
                }
            }
            TIMESYNC_DATA::ID => self.time_sync(&read(frame)?, receive_ns),
            COMMAND_ACK_DATA::ID => self.answered(&read(frame)?, receive_ns),
            _ => {}
        }
        Some(())
    }

    fn take_odometry(&mut self, message: &ODOMETRY_DATA, receive_ns: u64) {
        let motion = match convert::odometry(message) {
            Ok(motion) => motion,
            Err(refused) => {
                self.tally.refused += 1;
                if !std::mem::replace(&mut self.refusal_told, true) {
                    self.notes.push(refused.to_string());
                }
                return;
            }
        };
        self.odometry_at_ns = Some(receive_ns);
        self.frame = message.frame_id;
        if self.reset_counter.replace(message.reset_counter).is_some_and(|old| old != message.reset_counter) {
            self.tally.estimate_resets += 1;
            if !is_recent(self.jump_told_ns, receive_ns) {
                self.jump_told_ns = Some(receive_ns);
                let counter = message.reset_counter;
                self.notes.push(format!(
                    "the vehicle's estimate jumped (reset counter {counter}): so do the samples"
                ));
            }
        }
        let vehicle_ns = i128::from(message.time_usec) * 1000;
        self.join(Half::Whole, TimeBase::Microseconds, vehicle_ns, receive_ns, motion);
    }

    fn clock_of(&mut self, base: TimeBase) -> &mut VehicleClock {
        match base {
            TimeBase::Microseconds => &mut self.microseconds,
            TimeBase::Milliseconds => &mut self.milliseconds,
        }
    }

    fn join_half(&mut self, half: Half, time_boot_ms: u32, receive_ns: u64, motion: Motion) {
        let vehicle_ns = i128::from(time_boot_ms) * 1_000_000;
        self.join(half, TimeBase::Milliseconds, vehicle_ns, receive_ns, motion);
    }

    /// Puts a message to the half that waits, or begins a sample with it.
    fn join(&mut self, half: Half, base: TimeBase, vehicle_ns: i128, receive_ns: u64, motion: Motion) {
        if motion == Motion::default() {
            self.tally.empty += 1;
            return;
        }
        let tolerance_ns = i128::from(self.settings.join_ns);
        let fits = |pending: &Pending| {
            let oldest_ns = pending.oldest_ns.min(vehicle_ns);
            let newest_ns = pending.newest_ns.max(vehicle_ns);
            let is_free = match half {
                Half::Whole => false,
                Half::Position => !pending.halves.0,
                Half::Attitude => !pending.halves.1,
            };
            is_free && pending.base == base && newest_ns - oldest_ns <= tolerance_ns
        };
        if !self.pending.as_ref().is_some_and(fits) {
            self.complete();
        }
        if self.clock_of(base).observe(vehicle_ns, receive_ns) == Observed::Reset {
            self.pending = None;
            self.tally.clock_resets += 1;
            if !is_recent(self.reset_told_ns, receive_ns) {
                self.reset_told_ns = Some(receive_ns);
                self.notes.push(format!(
                    "the vehicle's clock was set anew, to {:.3} s: a reboot? samples go on with a new offset",
                    vehicle_ns as f64 * 1e-9
                ));
            }
            self.begin_requests();
        }
        let pending = self.pending.get_or_insert(Pending {
            sample: Measurement::default(),
            base,
            oldest_ns: vehicle_ns,
            newest_ns: vehicle_ns,
            receive_ns,
            halves: (false, false),
        });
        pending.sample = motion.add_to(pending.sample);
        pending.oldest_ns = pending.oldest_ns.min(vehicle_ns);
        pending.newest_ns = pending.newest_ns.max(vehicle_ns);
        pending.halves.0 |= half != Half::Attitude;
        pending.halves.1 |= half != Half::Position;
        let halves = pending.halves;
        if let Some(attitude_wxyz) = motion.attitude_wxyz {
            self.attitude = Some((attitude_wxyz, receive_ns));
        }
        let is_new = is_recent(Some(*self.began_ns.get_or_insert(receive_ns)), receive_ns);
        let is_complete = (halves.0 || !(is_new || is_recent(self.position_at_ns, receive_ns)))
            && (halves.1 || !(is_new || is_recent(self.attitude_at_ns, receive_ns)));
        if is_complete || half == Half::Whole {
            self.complete();
        }
    }

    /// Makes the sample that waits, if one does.
    fn complete(&mut self) {
        let Some(Pending { mut sample, base, newest_ns, receive_ns, .. }) = self.pending.take() else {
            return;
        };
        let stamp_ns = self.clock_of(base).stamp_ns(newest_ns);
        let Some(stamp_ns) = stamp_ns.filter(|stamp_ns| *stamp_ns > self.newest_stamp_ns) else {
            self.tally.out_of_order += 1;
            return;
        };
        self.newest_stamp_ns = stamp_ns;
        let fresh = |at_ns: u64| receive_ns.saturating_sub(at_ns) < RECENT_NS;
        let thrust = self.thrust.filter(|(_, at_ns)| fresh(*at_ns));
        let attitude = self.attitude.filter(|(_, at_ns)| fresh(*at_ns));
        if let (Some(thrust_n), Some((thrust, _)), Some((wxyz, _))) =
            (self.settings.thrust_n, thrust, attitude)
        {
            sample = sample.with_force_n(convert::force_n(thrust, thrust_n, wxyz));
        }
        let torque = self.torque.filter(|(_, at_ns)| fresh(*at_ns));
        if let (Some(full_n_m), Some((torque, _))) = (self.settings.torque_n_m, torque) {
            sample = sample.with_torque_n_m(std::array::from_fn(|axis| torque[axis] * full_n_m[axis]));
        }
        (sample.stamp_ns, sample.sequence) = (stamp_ns, self.tally.samples);
        self.tally.samples += 1;
        self.tally.samples_with_force += u64::from(sample.has(valid::FORCE));
        self.samples.push(sample);
    }

    /// A request is answered with our time; an answer to ours tells the offset.
    fn time_sync(&mut self, message: &TIMESYNC_DATA, receive_ns: u64) {
        if message.tc1 == 0 {
            let answer = TIMESYNC_DATA {
                tc1: receive_ns.cast_signed(),
                ts1: message.ts1,
                target_system: self.vehicle.unwrap_or(0),
                target_component: self.settings.component_id,
            };
            self.replies.push(MavMessage::TIMESYNC(answer));
            return;
        }
        // Somebody else's answer has another clock's time in it.
        let Ok(sent_ns) = u64::try_from(message.ts1) else { return };
        if sent_ns <= receive_ns && receive_ns - sent_ns < RECENT_NS {
            for clock in [&mut self.microseconds, &mut self.milliseconds] {
                clock.exchange(sent_ns, i128::from(message.tc1), receive_ns);
            }
        }
    }

    /// Which messages to ask for; after a reboot the vehicle has forgotten them.
    fn begin_requests(&mut self) {
        if self.settings.request_rate_hz.is_none() {
            return;
        }
        let of_source: &[u32] = match self.settings.source {
            Source::Auto | Source::Odometry => &[ODOMETRY_DATA::ID],
            Source::LocalPosition => &PAIR_IDS,
        };
        let thrust = self.settings.thrust_n.map(|_| ATTITUDE_TARGET_DATA::ID);
        let ids = of_source.iter().copied().chain(thrust);
        self.requests = ids.map(Request::of).collect();
    }

    /// Asks for one message at a time: an answer names the command and not the message.
    fn ask(&mut self, now_ns: u64) {
        let (Some(rate_hz), Some(system_id)) = (self.settings.request_rate_hz, self.vehicle) else { return };
        let Some(at) = self.requests.iter().position(|request| !request.answered) else { return };
        let request = &mut self.requests[at];
        if request.asked > 0 && now_ns.saturating_sub(request.asked_at_ns) < ANSWER_NS {
            return;
        }
        if request.asked >= MOST_REQUESTS {
            request.answered = true;
            let message_id = request.message_id;
            // Some vehicles do it without a word.
            if !self.tally.messages.contains_key(name_of(message_id)) {
                self.not_granted(message_id, "no answer");
            }
            return;
        }
        (request.asked, request.asked_at_ns) = (request.asked + 1, now_ns);
        self.replies.push(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1: request.message_id as f32,
            param2: (1e6 / rate_hz) as f32,
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            target_system: system_id,
            target_component: self.settings.component_id,
            confirmation: (request.asked - 1) as u8,
            ..COMMAND_LONG_DATA::default()
        }));
    }

    fn answered(&mut self, answer: &COMMAND_ACK_DATA, now_ns: u64) {
        if answer.command != MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL {
            return;
        }
        let Some(request) = self.requests.iter_mut().find(|request| request.asked > 0 && !request.answered)
        else {
            return;
        };
        request.answered = true;
        let message_id = request.message_id;
        match answer.result {
            MavResult::MAV_RESULT_ACCEPTED => {}
            refused => self.not_granted(message_id, &format!("{refused:?}")),
        }
        self.ask(now_ns);
    }

    fn not_granted(&mut self, message_id: u32, reason: &str) {
        let name = name_of(message_id);
        self.notes.push(format!("asked for {name}: {reason}"));
        if message_id == ODOMETRY_DATA::ID && self.settings.source == Source::Auto {
            self.requests.extend(PAIR_IDS.map(Request::of));
        }
    }
}

/// Content of a frame; `None` where it holds a value that is none. Fields that a newer message set has added are left out.
fn read<Data: MessageData>(frame: &Frame) -> Option<Data> {
    let payload = frame.payload();
    Data::deser(frame.version, &payload[..payload.len().min(Data::ENCODED_LEN)]).ok()
}

fn is_recent(at_ns: Option<u64>, now_ns: u64) -> bool {
    at_ns.is_some_and(|at_ns| now_ns.saturating_sub(at_ns) < RECENT_NS)
}

fn is_motion(message_id: u32) -> bool {
    [ODOMETRY_DATA::ID, LOCAL_POSITION_NED_DATA::ID, ATTITUDE_DATA::ID, ATTITUDE_QUATERNION_DATA::ID]
        .contains(&message_id)
}

/// As the message set calls it.
pub fn name_of(message_id: u32) -> &'static str {
    MavMessage::all_messages().iter().find(|(_, id)| *id == message_id).map_or("unknown", |(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::{MAVLinkV2MessageRaw, MavHeader};
    use proptest::prelude::*;
    use shared_types::payload::frame;

    const MS: u64 = 1_000_000;
    /// Our time when the vehicle's was zero.
    const BOOT_NS: u64 = 500_000 * MS;

    /// A vehicle's side: it counts its frames, and all arrive at once.
    struct Vehicle {
        bridge: Bridge,
        system_id: u32,
        sequence: u8,
    }

    impl Vehicle {
        fn of(settings: Settings) -> Self {
            Self { bridge: Bridge::new(settings), system_id: 1, sequence: 0 }
        }

        fn frame(&mut self, message: &MavMessage) -> Vec<u8> {
            let header = MavHeader { system_id: self.system_id, component_id: 1, sequence: self.sequence };
            self.sequence = self.sequence.wrapping_add(1);
            let mut frame = MAVLinkV2MessageRaw::new();
            frame.serialize_message(header, message);
            frame.raw_bytes().to_vec()
        }

        fn says(&mut self, at_ms: u64, message: &MavMessage) -> Vec<Measurement> {
            let bytes = self.frame(message);
            self.bridge.receive(&bytes, None, BOOT_NS + at_ms * MS);
            self.bridge.take_samples()
        }

        fn turns(&mut self, at_ms: u64) -> Vec<Measurement> {
            self.bridge.turn(BOOT_NS + at_ms * MS);
            self.bridge.take_samples()
        }
    }

    fn position(ms: u32) -> MavMessage {
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: ms,
            vx: 1.0,
            ..Default::default()
        })
    }

    fn attitude(ms: u32) -> MavMessage {
        MavMessage::ATTITUDE(ATTITUDE_DATA { time_boot_ms: ms, yawspeed: 0.5, ..Default::default() })
    }

    fn odometry(ms: u64) -> ODOMETRY_DATA {
        ODOMETRY_DATA {
            time_usec: ms * 1000,
            frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
            child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
            q: [1.0, 0.0, 0.0, 0.0],
            vx: 2.0,
            ..Default::default()
        }
    }

    const PAIR: u32 = valid::VELOCITY | valid::POSITION | valid::ATTITUDE | valid::ANGULAR_VELOCITY;

    #[test]
    fn two_halves_within_the_tolerance_are_one_sample_in_either_order() {
        let mut vehicle = Vehicle::of(Settings::default());
        for k in 0..10 {
            let (first, second) = (1020 + 20 * k, 1020 + 20 * k + k % 6);
            let halves = [position(first), attitude(second)];
            let order = if k % 2 == 0 { [0, 1] } else { [1, 0] };
            assert_eq!(vehicle.says(second.into(), &halves[order[0]]), []);
            let samples = vehicle.says(second.into(), &halves[order[1]]);
            assert_eq!(samples.len(), 1);
            assert_eq!((samples[0].valid, samples[0].sequence), (PAIR, u64::from(k)));
            // At the newer of both times.
            assert_eq!(samples[0].stamp_ns, BOOT_NS + u64::from(second) * MS);
        }
    }

    #[test]
    fn the_other_half_is_waited_for_as_long_as_it_may_come() {
        let mut vehicle = Vehicle::of(Settings::default());
        // In the first second nobody knows; then it is known that there is none.
        assert_eq!(vehicle.says(1000, &position(1000)), []);
        assert_eq!(vehicle.turns(1004), []);
        assert_eq!(vehicle.turns(1005)[0].valid, valid::VELOCITY | valid::POSITION);
        assert_eq!(vehicle.says(2000, &position(2000)).len(), 1);
        // Now there is one, until it has been silent for a second.
        assert_eq!(vehicle.says(2020, &attitude(2020)), []);
        assert_eq!(vehicle.turns(2025)[0].valid, valid::ATTITUDE | valid::ANGULAR_VELOCITY);
        assert_eq!(vehicle.says(3019, &position(3019)), []);
        assert_eq!(vehicle.turns(3024).len(), 1);
        assert_eq!(vehicle.says(3040, &position(3040)).len(), 1);
    }

    #[test]
    fn beyond_the_tolerance_they_stay_apart_and_an_older_one_is_left_out() {
        let mut vehicle = Vehicle::of(Settings::default());
        vehicle.says(1000, &position(1000));
        vehicle.says(1000, &attitude(1000));
        let made = vehicle.bridge.tally().samples;
        assert_eq!(vehicle.says(1020, &position(1020)), []);
        let samples = vehicle.says(1026, &attitude(1026));
        assert_eq!(
            samples.iter().map(|sample| sample.valid).collect::<Vec<_>>(),
            [valid::VELOCITY | valid::POSITION]
        );
        assert_eq!(vehicle.turns(1030), []);
        assert_eq!(vehicle.turns(1031)[0].valid, valid::ATTITUDE | valid::ANGULAR_VELOCITY);
        // It was overtaken by a time that is published already.
        assert_eq!(vehicle.says(1032, &position(1015)), []);
        assert_eq!(vehicle.turns(1040), []);
        assert_eq!((vehicle.bridge.tally().samples, vehicle.bridge.tally().out_of_order), (made + 2, 1));
    }

    #[test]
    fn while_odometry_comes_the_halves_are_not_used() {
        let mut vehicle = Vehicle::of(Settings::default());
        assert_eq!(
            vehicle.says(1000, &MavMessage::ODOMETRY(odometry(1000)))[0].velocity_m_s,
            [2.0, 0.0, 0.0]
        );
        assert_eq!(vehicle.says(1001, &position(1001)), []);
        assert_eq!(vehicle.turns(1100), []);
        assert_eq!(vehicle.says(2001, &position(2001))[0].velocity_m_s, [1.0, 0.0, 0.0]);
        let mut vehicle = Vehicle::of(Settings { source: Source::LocalPosition, ..Settings::default() });
        assert_eq!(vehicle.says(1000, &MavMessage::ODOMETRY(odometry(1000))), []);
        assert_eq!(vehicle.says(1001, &position(1001)), []);
        assert_eq!(vehicle.turns(1010).len(), 1);
    }

    #[test]
    fn one_system_is_followed_and_its_losses_are_counted() {
        let mut vehicle = Vehicle::of(Settings::default());
        vehicle.says(1000, &position(1000));
        vehicle.system_id = 2;
        assert_eq!(vehicle.says(1010, &position(9000)), []);
        vehicle.system_id = 1;
        // Of its own count the one frame is missing.
        vehicle.says(1020, &position(1020));
        vehicle.sequence = 250;
        vehicle.says(1030, &position(1030));
        assert_eq!((vehicle.bridge.vehicle(), vehicle.bridge.tally().frames_of_others), (Some(1), 1));
        // 3 was due: 247 missing is a jump backwards, by a reboot or another way round the network.
        assert_eq!(vehicle.bridge.tally().frames_lost, 1);
        let mut vehicle = Vehicle::of(Settings { system_id: Some(7), ..Settings::default() });
        vehicle.says(1000, &position(1000));
        vehicle.system_id = 7;
        vehicle.says(1001, &position(2000));
        assert_eq!(vehicle.turns(1010).len(), 1);
        assert_eq!(vehicle.bridge.tally().frames_of_others, 1);
    }

    #[test]
    fn a_reboot_is_told_and_its_samples_go_on_at_their_own_times() {
        let mut vehicle = Vehicle::of(Settings::default());
        let old = vehicle.says(60_000, &MavMessage::ODOMETRY(odometry(60_000)))[0];
        let new = vehicle.says(65_000, &MavMessage::ODOMETRY(odometry(700)))[0];
        assert_eq!((old.sequence, new.sequence), (0, 1));
        assert_eq!(new.stamp_ns, BOOT_NS + 65_000 * MS);
        assert_eq!(vehicle.bridge.tally().clock_resets, 1);
        let notes = vehicle.bridge.take_notes().join("\n");
        assert!(notes.contains("set anew, to 0.700 s"), "{notes}");
    }

    #[test]
    fn thrust_and_torque_become_forces_while_they_are_fresh() {
        let settings =
            Settings { thrust_n: Some(10.0), torque_n_m: Some([1.0, 2.0, 3.0]), ..Settings::default() };
        let mut vehicle = Vehicle::of(settings);
        let sample = vehicle.says(999, &MavMessage::ODOMETRY(odometry(999)))[0];
        assert!(!sample.has(valid::FORCE) && !sample.has(valid::TORQUE));
        let controls = [0.5, 0.5, -0.5, 0.25, 0.0, 0.0, 0.0, 0.0];
        let target = ACTUATOR_CONTROL_TARGET_DATA { controls, ..Default::default() };
        vehicle.says(1000, &MavMessage::ACTUATOR_CONTROL_TARGET(target));
        let sample = vehicle.says(1001, &MavMessage::ODOMETRY(odometry(1001)))[0];
        assert_eq!((sample.force_n, sample.torque_n_m), ([0.0, 0.0, -2.5], [0.5, 1.0, -1.5]));
        let sample = vehicle.says(2100, &MavMessage::ODOMETRY(odometry(2100)))[0];
        assert!(!sample.has(valid::FORCE) && !sample.has(valid::TORQUE));
        let target = ATTITUDE_TARGET_DATA { thrust: 0.75, ..Default::default() };
        vehicle.says(2101, &MavMessage::ATTITUDE_TARGET(target));
        let sample = vehicle.says(2102, &MavMessage::ODOMETRY(odometry(2102)))[0];
        assert_eq!(sample.force_n, [0.0, 0.0, -7.5]);
        assert!(!sample.has(valid::TORQUE));
    }

    #[test]
    fn a_request_for_the_time_is_answered_and_requests_are_repeated_five_times() {
        let mut vehicle = Vehicle::of(Settings { request_rate_hz: Some(50.0), ..Settings::default() });
        let request = TIMESYNC_DATA { tc1: 0, ts1: 77, target_system: 0, target_component: 0 };
        vehicle.says(1000, &MavMessage::TIMESYNC(request.clone()));
        assert_eq!(vehicle.bridge.take_replies(), [], "nobody is followed yet");
        vehicle.says(1000, &position(1000));
        vehicle.says(1001, &MavMessage::TIMESYNC(request));
        let replies = vehicle.bridge.take_replies();
        let [MavMessage::TIMESYNC(answer)] = &replies[..] else { panic!("{replies:?}") };
        assert_eq!((answer.tc1, answer.ts1), ((BOOT_NS + 1001 * MS) as i64, 77));
        let mut asked = Vec::new();
        for k in 0..200 {
            vehicle.turns(1002 + 100 * k);
            asked.extend(vehicle.bridge.take_replies().into_iter().map(|reply| match reply {
                MavMessage::COMMAND_LONG(command) => (command.param1, command.param2),
                other => panic!("{other:?}"),
            }));
        }
        let of = |id: f32| vec![(id, 20_000.0); 5];
        assert_eq!(asked, [of(331.0), of(32.0), of(31.0)].concat());
        let notes = vehicle.bridge.take_notes().join("\n");
        assert!(
            notes.contains("asked for ODOMETRY: no answer") && !notes.contains("asked for LOCAL"),
            "{notes}"
        );
    }

    proptest! {
        /// Whatever a vehicle or an attacker sends: samples are finite, in order, and never later than their arrival.
        #[test]
        fn any_messages_make_good_samples_or_none(
            messages in prop::collection::vec((0..6u8, prop::array::uniform16(any::<f32>()), any::<u64>(), 0..30u64), 1..60)
        ) {
            let mut vehicle = Vehicle::of(Settings { thrust_n: Some(1e3), ..Settings::default() });
            let (mut at_ms, mut newest_ns) = (1000, 0);
            for (kind, f, time, step_ms) in messages {
                at_ms += step_ms;
                let message = match kind {
                    0 => MavMessage::ODOMETRY(ODOMETRY_DATA {
                        time_usec: time, x: f[0], q: [f[1], f[2], f[3], f[4]], vx: f[5], yawspeed: f[6], ..odometry(0)
                    }),
                    1 => MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                        time_boot_ms: time as u32, x: f[0], y: f[1], z: f[2], vx: f[3], vy: f[4], vz: f[5]
                    }),
                    2 => MavMessage::ATTITUDE(ATTITUDE_DATA { time_boot_ms: time as u32, roll: f[0], yaw: f[1], ..Default::default() }),
                    3 => MavMessage::ATTITUDE_TARGET(ATTITUDE_TARGET_DATA { thrust: f[0], ..Default::default() }),
                    4 => position(at_ms as u32),
                    _ => MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: time.cast_signed(), ts1: f[0] as i64, ..Default::default() }),
                };
                let mut samples = vehicle.says(at_ms, &message);
                samples.extend(vehicle.turns(at_ms));
                for sample in samples {
                    prop_assert!(sample.stamp_ns > newest_ns && sample.stamp_ns <= BOOT_NS + at_ms * MS);
                    newest_ns = sample.stamp_ns;
                    prop_assert!(sample.valid != 0 && sample.velocity_frame <= frame::BODY);
                    let all = sample.velocity_m_s.iter().chain(&sample.position_m).chain(&sample.attitude_wxyz);
                    prop_assert!(all.chain(&sample.force_n).chain(&sample.angular_velocity_rad_s).all(|x| x.is_finite()));
                }
            }
        }
    }
}
