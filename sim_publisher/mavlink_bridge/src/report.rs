//! The reports of a bridge: counts as text and JSON, and advice if nothing usable arrives.

use crate::bridge::Bridge;
use crate::link::Address;
use crate::tally::name_of;
use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, ODOMETRY_DATA,
};

const S: u64 = 1_000_000_000;
/// A longer silence is logged (ns).
const SILENCE_NS: u64 = 5 * S;

/// What a run did.
#[derive(Debug)]
pub struct Bridged {
    /// Counts of the messages.
    pub bridge: Bridge,
    /// Estimates that were sent.
    pub estimates_sent: u64,
    /// Estimates that were due and not sent, because they were stale, invalid, or missing.
    pub estimates_withheld: u64,
    /// Length of the run (s).
    pub duration_s: f64,
    /// Whether a stop ended it.
    pub stopped: bool,
}

impl Bridged {
    /// The report as JSON.
    pub fn document(&self) -> serde_json::Value {
        let (frames, tally, clock) = (self.bridge.frame_tally(), self.bridge.tally(), self.bridge.clock());
        serde_json::json!({
            "samples_published": tally.samples,
            "samples_with_force": tally.samples_with_force,
            "messages": tally.messages,
            "bytes": frames.bytes,
            "frames": frames.frames,
            "frames_signed": frames.signed,
            "garbage_bytes": frames.garbage_bytes,
            "crc_failures": frames.crc_failures,
            "unknown_messages": frames.unknown_messages,
            "frames_of_others": tally.frames_of_others,
            "frames_lost": tally.frames_lost,
            "unreadable": tally.unreadable,
            "odometry_refused": tally.refused,
            "messages_without_numbers": tally.empty,
            "samples_out_of_order": tally.out_of_order,
            "clock_resets": tally.clock_resets,
            "estimate_resets": tally.estimate_resets,
            "system_id": self.bridge.vehicle(),
            "autopilot": self.bridge.autopilot().map(|autopilot| format!("{autopilot:?}")),
            "timesync_round_trip_ns": clock.round_trip_ns(),
            "estimates_sent": self.estimates_sent,
            "estimates_withheld": self.estimates_withheld,
            "duration_s": self.duration_s,
            "stopped": self.stopped,
        })
    }

    /// The report as text.
    pub fn line(&self) -> String {
        let ending = if self.stopped { ", stopped" } else { "" };
        format!(
            "{} samples published in {:.1} s, {} estimates sent{ending}; {}",
            self.bridge.tally().samples,
            self.duration_s,
            self.estimates_sent,
            counts(&self.bridge)
        )
    }
}

/// The counts in words, without zeros.
pub(crate) fn counts(bridge: &Bridge) -> String {
    let (frames, tally) = (bridge.frame_tally(), bridge.tally());
    let mut words: Vec<String> = tally.messages.iter().map(|(name, n)| format!("{n} {name}")).collect();
    for (n, what) in [
        (tally.frames_lost, "lost by the vehicle's count"),
        (frames.crc_failures, "with a wrong sum"),
        (frames.garbage_bytes, "bytes of garbage"),
        (frames.unknown_messages, "unknown messages"),
        (tally.frames_of_others, "frames of other systems"),
        (tally.unreadable, "unreadable"),
        (tally.refused, "ODOMETRY refused"),
        (tally.empty, "without numbers"),
        (tally.out_of_order, "samples out of order"),
        (tally.clock_resets, "clock resets"),
        (tally.estimate_resets, "jumps of its estimate"),
    ] {
        if n > 0 {
            words.push(format!("{n} {what}"));
        }
    }
    if words.is_empty() { "nothing came".into() } else { words.join(", ") }
}

/// Detects that nothing arrives, or nothing that can be used, and reports it once each time.
pub(crate) struct Silence {
    heard_ns: u64,
    frames: u64,
    samples_ns: u64,
    samples: u64,
    is_logged: bool,
}

impl Silence {
    pub(crate) fn since(now_ns: u64) -> Self {
        Self { heard_ns: now_ns, frames: 0, samples_ns: now_ns, samples: 0, is_logged: false }
    }

    /// What to log now, if anything.
    pub(crate) fn poll(&mut self, bridge: &Bridge, now_ns: u64, address: &Address) -> Option<String> {
        let (frames, tally) = (bridge.frame_tally(), bridge.tally());
        if frames.frames > self.frames {
            (self.frames, self.heard_ns) = (frames.frames, now_ns);
        }
        if tally.samples > self.samples {
            (self.samples, self.samples_ns, self.is_logged) = (tally.samples, now_ns, false);
        }
        if self.is_logged || now_ns - self.samples_ns < SILENCE_NS {
            return None;
        }
        self.is_logged = true;
        let is_silent = now_ns - self.heard_ns >= SILENCE_NS;
        Some(if is_silent && frames.bytes == 0 {
            nothing_heard(address)
        } else {
            wrong_heard(bridge, is_silent)
        })
    }
}

fn nothing_heard(address: &Address) -> String {
    let check = match address {
        Address::Udp(_) => {
            "is the vehicle or a router told to send to this machine and port? does a firewall stop it (ufw allow PORT/udp)? \
             does another program take it?"
        }
        Address::UdpOut(_) => "does anything listen at that address? is the way back open?",
        Address::Serial { .. } => {
            "do baud rates agree (PX4: SER_TEL2_BAUD, ArduPilot: SERIALn_BAUD)? is the port set to MAVLink (MAV_1_CONFIG, \
             SERIALn_PROTOCOL = 2)? are RX and TX crossed?"
        }
    };
    format!("nothing heard at {} within {} s; {check}", address, SILENCE_NS / S)
}

fn wrong_heard(bridge: &Bridge, is_silent: bool) -> String {
    let (frames, tally) = (bridge.frame_tally(), bridge.tally());
    if frames.frames == 0 {
        return format!(
            "{} bytes heard and no MAVLink among them; needed: the vehicle's baud rate, or another port",
            frames.bytes
        );
    }
    if is_silent {
        return format!("nothing more heard for {} s; waiting", SILENCE_NS / S);
    }
    let heard: Vec<_> = tally.messages.keys().copied().collect();
    if bridge.vehicle().is_none() || heard.is_empty() {
        let others: Vec<_> =
            bridge.others().iter().map(|(system, part)| format!("{system}/{part}")).collect();
        return format!(
            "no autopilot heard; others are (system/component): {}; needed: --system-id and --component-id of one of them",
            others.join(", ")
        );
    }
    let needed =
        [ODOMETRY_DATA::ID, LOCAL_POSITION_NED_DATA::ID, ATTITUDE_QUATERNION_DATA::ID, ATTITUDE_DATA::ID];
    if needed.iter().any(|id| heard.contains(&name_of(*id))) {
        return format!("nothing of what is heard can be used; {}", counts(bridge));
    }
    let how = match bridge.autopilot() {
        Some(MavAutopilot::MAV_AUTOPILOT_PX4) => {
            "on PX4: mavlink stream -u PORT -s ODOMETRY -r 100, or MAV_n_MODE = Onboard"
        }
        Some(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA) => {
            "on ArduPilot: SRn_POSITION and SRn_EXTRA1 = 50 (MAVn_… since 4.7), n counting the ports that speak MAVLink"
        }
        _ => "set the vehicle's streams",
    };
    format!(
        "system {} sends {} and neither ODOMETRY nor LOCAL_POSITION_NED nor ATTITUDE; needed: --request-rate-hz 100, or {how}",
        bridge.vehicle().unwrap_or(0),
        heard.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use mavlink::dialects::common::{HEARTBEAT_DATA, MavMessage, SYS_STATUS_DATA};
    use mavlink::{MAVLinkV2MessageRaw, MavHeader};

    fn heard(system_id: u32, messages: &[MavMessage]) -> Bridge {
        let mut bridge = Bridge::new(Settings::default());
        for (sequence, message) in messages.iter().enumerate() {
            let mut frame = MAVLinkV2MessageRaw::new();
            let header = MavHeader { system_id, component_id: 1, sequence: sequence as u8 };
            frame.serialize_message(header, message);
            bridge.receive(frame.raw_bytes(), None, S);
        }
        bridge
    }

    #[test]
    fn what_is_missing_is_told_with_what_to_set() {
        let status = MavMessage::SYS_STATUS(SYS_STATUS_DATA::default());
        let of = |autopilot| MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot, ..HEARTBEAT_DATA::default() });
        for (autopilot, words) in [
            (MavAutopilot::MAV_AUTOPILOT_PX4, "mavlink stream"),
            (MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, "SRn_POSITION"),
        ] {
            let said = wrong_heard(&heard(3, &[of(autopilot), status.clone()]), false);
            assert!(said.contains("system 3 sends HEARTBEAT, SYS_STATUS and neither"), "{said}");
            assert!(said.contains(words), "{said}");
        }
        let said = wrong_heard(&heard(255, &[of(MavAutopilot::MAV_AUTOPILOT_INVALID)]), false);
        assert!(said.contains("no autopilot heard") && said.contains("255/1"), "{said}");
        let mut noise = Bridge::new(Settings::default());
        noise.receive(&[1; 77], None, S);
        assert!(wrong_heard(&noise, false).contains("77 bytes heard and no MAVLink"));
        let said = nothing_heard(&"serial:/dev/ttyUSB0:921600".parse().unwrap());
        assert!(
            said.contains("nothing heard at serial:/dev/ttyUSB0:921600 within 5 s; do baud rates agree"),
            "{said}"
        );
    }
}
