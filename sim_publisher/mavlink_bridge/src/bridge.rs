//! Turns the vehicle's messages into samples: decides which messages are used, and in which order. Time and bytes are
//! arguments; nothing here waits, reads a clock or sends.
//!
//! While ODOMETRY comes, LOCAL_POSITION_NED and ATTITUDE(_QUATERNION) are not used, unless the settings say so.

use crate::clock::{Observed, VehicleClock};
use crate::convert;
use crate::frames::{Decoder, Frame, FrameTally, Peer};
use crate::joining::{Half, Joiner, RECENT_NS, is_recent};
use crate::requests::{Outbox, Requests};
use crate::selection::Selection;
use crate::settings::{Settings, Source};
use crate::tally::Tally;
use mavlink::MessageData;
use mavlink::dialects::common::{
    ACTUATOR_CONTROL_TARGET_DATA, ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, ATTITUDE_TARGET_DATA,
    COMMAND_ACK_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavFrame, MavMessage,
    ODOMETRY_DATA, TIMESYNC_DATA,
};
use shared_types::Measurement;
use std::collections::BTreeSet;

/// Number of senders whose unfinished frames are stored separately.
const MAX_PEERS: usize = 16;

/// The vehicle's messages as samples.
#[derive(Debug)]
pub struct Bridge {
    settings: Settings,
    decoders: Vec<(Peer, Decoder)>,
    /// Of decoders that were dropped.
    earlier: FrameTally,
    tally: Tally,
    selection: Selection,
    joiner: Joiner,
    requests: Requests,
    out: Outbox,
    frame: MavFrame,
    reset_counter: Option<u8>,
    odometry_at_ns: Option<u64>,
    quaternion_at_ns: Option<u64>,
    has_logged_refusal: bool,
    has_logged_signature: bool,
    /// Events that may occur with every message are logged at most once a second.
    last_jump_log_ns: Option<u64>,
    last_reset_log_ns: Option<u64>,
}

impl Bridge {
    /// A bridge before the first message.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            decoders: Vec::new(),
            earlier: FrameTally::default(),
            tally: Tally::default(),
            selection: Selection::new(settings.system_id, settings.component_id),
            joiner: Joiner::new(settings),
            requests: Requests::new(settings),
            out: Outbox::default(),
            frame: MavFrame::MAV_FRAME_LOCAL_NED,
            reset_counter: None,
            odometry_at_ns: None,
            quaternion_at_ns: None,
            has_logged_refusal: false,
            has_logged_signature: false,
            last_jump_log_ns: None,
            last_reset_log_ns: None,
        }
    }

    /// Counts of what was done with the messages.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Counts of bytes and frames.
    pub fn frame_tally(&self) -> FrameTally {
        self.decoders.iter().fold(self.earlier, |sum, (_, decoder)| sum.plus(decoder.tally()))
    }

    /// The system that is followed, once it is known or configured.
    pub fn vehicle(&self) -> Option<u8> {
        self.selection.system_id
    }

    /// The kind of autopilot, from its HEARTBEAT.
    pub fn autopilot(&self) -> Option<MavAutopilot> {
        self.selection.autopilot
    }

    /// Where the vehicle's frames come from.
    pub fn vehicle_peer(&self) -> Peer {
        self.selection.peer
    }

    /// Systems and components that send messages and are not followed.
    pub fn others(&self) -> &BTreeSet<(u8, u8)> {
        &self.selection.others
    }

    /// Axes in which the vehicle gives its pose.
    pub fn frame(&self) -> MavFrame {
        self.frame
    }

    /// The clock in use: that of ODOMETRY, if ODOMETRY arrives.
    pub fn clock(&self) -> &VehicleClock {
        self.joiner.clock(self.odometry_at_ns.is_some())
    }

    /// Samples since the last call, oldest first.
    pub fn take_samples(&mut self) -> Vec<Measurement> {
        std::mem::take(&mut self.joiner.samples)
    }

    /// Messages for the vehicle since the last call.
    pub fn take_replies(&mut self) -> Vec<MavMessage> {
        std::mem::take(&mut self.out.replies)
    }

    /// Lines for the operator since the last call.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.out.notes)
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
        if decoder.tally().signed > 0 && !std::mem::replace(&mut self.has_logged_signature, true) {
            self.out.notes.push(
                "frames are signed: signatures are not checked, and what is sent has none; \
                 a vehicle that insists on one will not listen"
                    .into(),
            );
        }
        self.decoders.push((from, decoder));
    }

    /// Does what is due at this time without a message: completes a sample, repeats a request.
    pub fn poll(&mut self, now_ns: u64) {
        self.joiner.poll(now_ns, &mut self.tally);
        self.requests.poll(now_ns, self.selection.system_id, &self.tally, &mut self.out);
    }

    /// Whether a message waits for its counterpart.
    pub fn waits(&self) -> bool {
        self.joiner.waits()
    }

    fn take(&mut self, frame: &Frame, from: Peer, receive_ns: u64) {
        let heartbeat = match frame.message_id {
            HEARTBEAT_DATA::ID => read::<HEARTBEAT_DATA>(frame).map(|heartbeat| heartbeat.autopilot),
            _ => None,
        };
        let Some(followed) = self.selection.take(frame, heartbeat, from) else {
            self.tally.frames_of_others += 1;
            return;
        };
        if followed.is_first {
            let (system_id, component_id) = (frame.system_id, frame.component_id);
            self.out.notes.push(format!("following system {system_id}, component {component_id}"));
            self.requests.begin();
        }
        self.tally.frames_lost += followed.lost;
        self.tally.count_message(frame.message_id);
        if self.understand(frame, heartbeat, receive_ns).is_none() {
            self.tally.unreadable += 1;
        }
    }

    /// `None` where the content is not one of this message.
    fn understand(&mut self, frame: &Frame, autopilot: Option<MavAutopilot>, receive_ns: u64) -> Option<()> {
        let takes_halves = match self.settings.source {
            // Axes of another heading would turn the vehicle within one stream.
            Source::Auto => {
                self.frame != MavFrame::MAV_FRAME_LOCAL_FRD && !is_recent(self.odometry_at_ns, receive_ns)
            }
            Source::Odometry => false,
            Source::LocalPosition => true,
        };
        let joined = match frame.message_id {
            HEARTBEAT_DATA::ID => {
                self.selection.autopilot = Some(autopilot?);
                None
            }
            ODOMETRY_DATA::ID if self.settings.source != Source::LocalPosition => {
                self.take_odometry(&read(frame)?, receive_ns)
            }
            LOCAL_POSITION_NED_DATA::ID if takes_halves => {
                let message: LOCAL_POSITION_NED_DATA = read(frame)?;
                self.frame = MavFrame::MAV_FRAME_LOCAL_NED;
                let motion = convert::local_position(&message);
                Some(self.take_half(Half::Position, message.time_boot_ms, receive_ns, motion))
            }
            ATTITUDE_QUATERNION_DATA::ID if takes_halves => {
                let message: ATTITUDE_QUATERNION_DATA = read(frame)?;
                self.quaternion_at_ns = Some(receive_ns);
                let motion = convert::attitude_quaternion(&message);
                Some(self.take_half(Half::Attitude, message.time_boot_ms, receive_ns, motion))
            }
            ATTITUDE_DATA::ID if takes_halves && !is_recent(self.quaternion_at_ns, receive_ns) => {
                let message: ATTITUDE_DATA = read(frame)?;
                let motion = convert::attitude(&message);
                Some(self.take_half(Half::Attitude, message.time_boot_ms, receive_ns, motion))
            }
            ATTITUDE_TARGET_DATA::ID => {
                let thrust = read::<ATTITUDE_TARGET_DATA>(frame)?.thrust;
                let thrust = thrust.is_finite().then_some(f64::from(thrust));
                self.joiner.take_setpoints(thrust, None, receive_ns);
                None
            }
            ACTUATOR_CONTROL_TARGET_DATA::ID => {
                if let Some((torque, thrust)) = convert::actuators(&read(frame)?) {
                    self.joiner.take_setpoints(Some(thrust), Some(torque), receive_ns);
                }
                None
            }
            TIMESYNC_DATA::ID => {
                self.time_sync(&read(frame)?, receive_ns);
                None
            }
            COMMAND_ACK_DATA::ID => {
                self.requests.answered(&read(frame)?, &mut self.out);
                self.requests.poll(receive_ns, self.selection.system_id, &self.tally, &mut self.out);
                None
            }
            _ => None,
        };
        if let Some((Observed::Reset, vehicle_s)) = joined {
            if !is_recent(self.last_reset_log_ns, receive_ns) {
                self.last_reset_log_ns = Some(receive_ns);
                self.out.notes.push(format!(
                    "the vehicle's clock was set anew, to {vehicle_s:.3} s: a reboot? samples go on with a new offset"
                ));
            }
            self.requests.begin();
        }
        Some(())
    }

    fn take_half(
        &mut self,
        half: Half,
        time_boot_ms: u32,
        receive_ns: u64,
        motion: convert::Motion,
    ) -> (Observed, f64) {
        let observed = self.joiner.take_half(half, time_boot_ms, receive_ns, motion, &mut self.tally);
        (observed, f64::from(time_boot_ms) * 1e-3)
    }

    /// What was observed of the vehicle's clock, and its time (s); `None` if the message is refused.
    fn take_odometry(&mut self, message: &ODOMETRY_DATA, receive_ns: u64) -> Option<(Observed, f64)> {
        let motion = match convert::odometry(message) {
            Ok(motion) => motion,
            Err(refused) => {
                self.tally.refused += 1;
                if !std::mem::replace(&mut self.has_logged_refusal, true) {
                    self.out.notes.push(refused.to_string());
                }
                return None;
            }
        };
        self.odometry_at_ns = Some(receive_ns);
        self.frame = message.frame_id;
        if self.reset_counter.replace(message.reset_counter).is_some_and(|old| old != message.reset_counter) {
            self.tally.estimate_resets += 1;
            if !is_recent(self.last_jump_log_ns, receive_ns) {
                self.last_jump_log_ns = Some(receive_ns);
                let counter = message.reset_counter;
                self.out.notes.push(format!(
                    "the vehicle's estimate jumped (reset counter {counter}): so do the samples"
                ));
            }
        }
        let observed = self.joiner.take_whole(message.time_usec, receive_ns, motion, &mut self.tally);
        Some((observed, message.time_usec as f64 * 1e-6))
    }

    /// A request is answered with our time; an answer to ours gives the offset.
    fn time_sync(&mut self, message: &TIMESYNC_DATA, receive_ns: u64) {
        if message.tc1 == 0 {
            self.out.replies.push(MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: receive_ns.cast_signed(),
                ts1: message.ts1,
                target_system: self.selection.system_id.unwrap_or(0),
                target_component: self.settings.component_id,
            }));
            return;
        }
        // An answer to another program's request has that program's time in it.
        let Ok(sent_ns) = u64::try_from(message.ts1) else { return };
        if sent_ns <= receive_ns && receive_ns - sent_ns < RECENT_NS {
            self.joiner.exchange(sent_ns, i128::from(message.tc1), receive_ns);
        }
    }
}

/// Content of a frame; `None` where a field's value is not allowed. Fields that a newer message set added are left out.
fn read<Data: MessageData>(frame: &Frame) -> Option<Data> {
    let payload = frame.payload();
    Data::deser(frame.version, &payload[..payload.len().min(Data::ENCODED_LEN)]).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::{MAVLinkV2MessageRaw, MavHeader};
    use shared_types::payload::valid;

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

        fn polls(&mut self, at_ms: u64) -> Vec<Measurement> {
            self.bridge.poll(BOOT_NS + at_ms * MS);
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
        // In the first second it may still come; then it is known that there is none.
        assert_eq!(vehicle.says(1000, &position(1000)), []);
        assert_eq!(vehicle.polls(1004), []);
        assert_eq!(vehicle.polls(1005)[0].valid, valid::VELOCITY | valid::POSITION);
        assert_eq!(vehicle.says(2000, &position(2000)).len(), 1);
        // Now there is one, until it has been silent for a second.
        assert_eq!(vehicle.says(2020, &attitude(2020)), []);
        assert_eq!(vehicle.polls(2025)[0].valid, valid::ATTITUDE | valid::ANGULAR_VELOCITY);
        assert_eq!(vehicle.says(3019, &position(3019)), []);
        assert_eq!(vehicle.polls(3024).len(), 1);
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
        assert_eq!(vehicle.polls(1030), []);
        assert_eq!(vehicle.polls(1031)[0].valid, valid::ATTITUDE | valid::ANGULAR_VELOCITY);
        // It was overtaken by a time that is published already.
        assert_eq!(vehicle.says(1032, &position(1015)), []);
        assert_eq!(vehicle.polls(1040), []);
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
        assert_eq!(vehicle.polls(1100), []);
        assert_eq!(vehicle.says(2001, &position(2001))[0].velocity_m_s, [1.0, 0.0, 0.0]);
        let mut vehicle = Vehicle::of(Settings { source: Source::LocalPosition, ..Settings::default() });
        assert_eq!(vehicle.says(1000, &MavMessage::ODOMETRY(odometry(1000))), []);
        assert_eq!(vehicle.says(1001, &position(1001)), []);
        assert_eq!(vehicle.polls(1010).len(), 1);
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
        assert_eq!(vehicle.polls(1010).len(), 1);
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
    fn odometry_that_cannot_be_used_is_counted_by_reason_and_logged_once() {
        let mut vehicle = Vehicle::of(Settings::default());
        let nothing = [f32::NAN; 4];
        let [x, y, z, _] = nothing;
        for k in 0..3 {
            let ms = 1000 + 10 * k;
            let fine = ODOMETRY_DATA { reset_counter: k as u8, ..odometry(ms) };
            assert_eq!(vehicle.says(ms, &MavMessage::ODOMETRY(fine.clone())).len(), 1);
            let frame_id = MavFrame::MAV_FRAME_LOCAL_ENU;
            let rates = ODOMETRY_DATA { rollspeed: x, pitchspeed: y, yawspeed: z, ..fine.clone() };
            for unusable in [
                ODOMETRY_DATA { frame_id, ..fine.clone() },
                ODOMETRY_DATA { quality: -1, ..fine },
                ODOMETRY_DATA { x, y, z, q: nothing, vx: x, vy: y, vz: z, ..rates },
            ] {
                assert_eq!(vehicle.says(ms + 1, &MavMessage::ODOMETRY(unusable)), []);
            }
        }
        let tally = vehicle.bridge.tally();
        assert_eq!((tally.refused, tally.empty, tally.estimate_resets, tally.samples), (6, 3, 2, 3));
        let notes = vehicle.bridge.take_notes().join("\n");
        assert_eq!(notes.matches("ODOMETRY in frame 4 with velocities in frame 12").count(), 1, "{notes}");
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
        assert_eq!(vehicle.bridge.take_replies(), [], "no vehicle is followed yet");
        vehicle.says(1000, &position(1000));
        vehicle.says(1001, &MavMessage::TIMESYNC(request));
        let replies = vehicle.bridge.take_replies();
        let [MavMessage::TIMESYNC(answer)] = &replies[..] else { panic!("{replies:?}") };
        assert_eq!((answer.tc1, answer.ts1), ((BOOT_NS + 1001 * MS) as i64, 77));
        let mut asked = Vec::new();
        for k in 0..200 {
            vehicle.polls(1002 + 100 * k);
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
}
