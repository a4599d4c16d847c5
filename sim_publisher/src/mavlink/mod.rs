//! A live vehicle that speaks MAVLink (PX4, ArduPilot, ArduSub) as the source of samples, and the estimate back to it.
//!
//! | module | holds |
//! |---|---|
//! | [`frames`] | bytes into frames; garbage skipped and counted |
//! | [`clock`] | the vehicle's time on our clock |
//! | [`convert`] | messages into quantities, an estimate into ODOMETRY: axes, signs, units |
//! | [`mod@bridge`] | which vehicle, which messages make a sample; no clock, no wire |
//! | [`link`] | UDP and serial |
//!
//! This file is the loop around them, a process of its own beside the real-time one. What is sent: HEARTBEAT once a second,
//! TIMESYNC, requests for messages, and the estimate. Its time is CLOCK_MONOTONIC of this machine, which is also what
//! TIMESYNC requests are answered with, so that the vehicle can tell how old it is. Messages are not signed.

pub mod bridge;
pub mod clock;
pub mod convert;
pub mod frames;
pub mod link;

use bridge::{Bridge, Settings, Source, name_of};
use link::{Address, Link, LinkError, resolve};
use mavlink::dialects::common::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot,
    MavMessage, MavModeFlag, MavState, MavType, ODOMETRY_DATA, TIMESYNC_DATA,
};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};
use shared_types::client::Latest;
use shared_types::clock::monotonic_ns;
use shared_types::payload::status_bits;
use shared_types::{Client, ClientError, Estimate, logln};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const MS: u64 = 1_000_000;
const S: u64 = 1_000_000_000;
/// Of our HEARTBEAT, and of TIMESYNC (ns).
const BEAT_NS: u64 = S;
/// TIMESYNC in the first seconds, until a short round trip is found (ns).
const FIRST_SYNC_NS: u64 = 100 * MS;
const FIRST_SYNCS: u32 = 20;
/// Between two lines about what came (ns).
const STATUS_NS: u64 = 5 * S;
/// Silence that is worth a word (ns).
const SILENCE_NS: u64 = 5 * S;
/// A device that has gone is looked for so often (ns).
const REOPEN_NS: u64 = S;
/// The longest wait: a stop is noticed, and readers are let in, at least this often.
const LONGEST_WAIT: Duration = Duration::from_millis(20);
/// While an estimate is due, or half a sample waits.
const SHORT_WAIT: Duration = Duration::from_millis(1);
/// MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY.
const OWN_COMPONENT_ID: u8 = 197;
/// While no vehicle is known whose number could be taken.
const FIRST_SYSTEM_ID: u8 = 1;

/// What is sent of the estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Send {
    /// ODOMETRY: pose, velocities along the body's axes, covariance unknown
    Odometry,
}

/// How to talk to a vehicle.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct MavlinkOptions {
    /// Where the vehicle is: udp:ADDRESS:PORT, udpout:HOST:PORT or serial:DEVICE[:BAUD]
    #[arg(long, value_name = "ADDRESS")]
    listen: Address,
    /// The vehicle's system id [default: the first autopilot heard]
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u8).range(1..))]
    system_id: Option<u8>,
    /// The component that is listened to
    #[arg(long, value_name = "ID", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..))]
    component_id: u8,
    /// Which messages are taken
    #[arg(long, value_enum, default_value_t)]
    source: Source,
    /// Position and attitude of times that differ by no more than this are one sample
    #[arg(long, value_name = "MS", default_value_t = 5.0)]
    join_ms: f64,
    /// Force of a thrust set-point of 1 [default: no force]
    #[arg(long, value_name = "N")]
    thrust_n: Option<f64>,
    /// Torque of a torque set-point of 1: one number, or three with commas [default: no torque]
    #[arg(long, value_name = "N_M", value_parser = crate::cli::parse_axes)]
    torque_n_m: Option<[f64; 3]>,
    /// Send the estimate back
    #[arg(long, value_enum, value_name = "MESSAGE")]
    send: Option<Send>,
    /// Where to (udp) [default: to the vehicle that talks]
    #[arg(long, value_name = "HOST:PORT", requires = "send")]
    send_to: Option<String>,
    /// How often at most
    #[arg(long, value_name = "HZ", default_value_t = 50.0, requires = "send")]
    send_rate_hz: f64,
    /// System id of what is sent [default: the vehicle's]
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u8).range(1..))]
    own_system_id: Option<u8>,
    /// Component id of what is sent [default: visual-inertial odometry]
    #[arg(long, value_name = "ID", default_value_t = OWN_COMPONENT_ID, value_parser = clap::value_parser!(u8).range(1..))]
    own_component_id: u8,
    /// Ask the vehicle for the messages at this rate [default: take what comes]
    #[arg(long, value_name = "HZ")]
    request_rate_hz: Option<f64>,
    /// Send nothing at all, not even a heartbeat
    #[arg(long, conflicts_with_all = ["send", "request_rate_hz"])]
    silent: bool,
    /// Length of the run in s [default: until Ctrl-C]
    #[arg(long, visible_alias = "duration", value_name = "S")]
    duration_s: Option<f64>,
}

/// Why the bridge ends without having done its work.
#[derive(Debug, thiserror::Error)]
pub enum MavlinkError {
    /// An option cannot be.
    #[error("{0}")]
    Option(String),
    /// The wire.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Shared memory.
    #[error(transparent)]
    Client(#[from] ClientError),
}

impl MavlinkOptions {
    /// Where the vehicle is.
    pub fn address(&self) -> &Address {
        &self.listen
    }

    /// What to take, and how.
    ///
    /// # Errors
    /// `Option` with what was found and what is needed.
    pub fn settings(&self) -> Result<Settings, MavlinkError> {
        let torques = self.torque_n_m.iter().flatten().map(|torque| ("torque-n-m", *torque, 0.0, 1e9));
        let given = [
            ("join-ms", Some(self.join_ms), 0.0, 1000.0),
            ("thrust-n", self.thrust_n, f64::MIN_POSITIVE, 1e9),
            ("send-rate-hz", Some(self.send_rate_hz), 0.1, 1000.0),
            ("request-rate-hz", self.request_rate_hz, 0.1, 1000.0),
            ("duration-s", self.duration_s, f64::MIN_POSITIVE, 1e9),
        ];
        let given =
            given.into_iter().filter_map(|(name, number, low, high)| Some((name, number?, low, high)));
        for (name, number, low, high) in given.chain(torques) {
            if !(number >= low && number <= high) {
                let low = if low == f64::MIN_POSITIVE { "above 0".into() } else { format!("{low} or more") };
                return Err(MavlinkError::Option(format!(
                    "--{name} {number}: needed: {low}, at most {high}"
                )));
            }
        }
        if self.send_to.is_some() && matches!(self.listen, Address::Serial { .. }) {
            return Err(MavlinkError::Option(
                "--send-to: a serial line leads to one place; leave it out".into(),
            ));
        }
        Ok(Settings {
            system_id: self.system_id,
            component_id: self.component_id,
            source: self.source,
            join_ns: (self.join_ms * 1e6) as u64,
            thrust_n: self.thrust_n,
            torque_n_m: self.torque_n_m,
            request_rate_hz: self.request_rate_hz,
        })
    }
}

/// What was done.
#[derive(Debug)]
pub struct Bridged {
    /// What came, and what became of it.
    pub bridge: Bridge,
    /// Estimates that were sent.
    pub estimates_sent: u64,
    /// Estimates that were due and told not to be used: stale, invalid, or none yet.
    pub estimates_withheld: u64,
    /// How long it was listened (s).
    pub duration_s: f64,
    /// Whether a stop ended it.
    pub stopped: bool,
}

impl Bridged {
    /// For scripts.
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

    /// For people.
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

/// What came, in words; what did not happen is not named.
fn counts(bridge: &Bridge) -> String {
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

/// What is sent, with our own numbers.
struct Sender {
    to: Option<SocketAddr>,
    own_system_id: Option<u8>,
    component_id: u8,
    sequence: u8,
}

impl Sender {
    fn send(&mut self, link: &Link, bridge: &Bridge, message: &MavMessage) -> Result<bool, std::io::Error> {
        let system_id = self.own_system_id.or(bridge.vehicle()).unwrap_or(FIRST_SYSTEM_ID);
        let header = MavHeader {
            system_id: system_id.into(),
            component_id: self.component_id,
            sequence: self.sequence,
        };
        let mut frame = MAVLinkV2MessageRaw::new();
        frame.serialize_message(header, message);
        let sent = link.send(frame.raw_bytes(), self.to.or(bridge.vehicle_peer()))?;
        self.sequence = self.sequence.wrapping_add(u8::from(sent));
        Ok(sent)
    }
}

/// The estimates of the service, as far as they are to be sent.
struct Estimates {
    latest: Latest<Estimate>,
    period_ns: u64,
    due_ns: u64,
    newest: Option<(u64, u64)>,
    was_diverged: bool,
    reset_counter: u8,
    sent: u64,
    withheld: u64,
}

impl Estimates {
    /// The newest one, where one is due that was not sent yet.
    fn next(&mut self, now_ns: u64) -> Result<Option<Estimate>, ClientError> {
        if now_ns < self.due_ns {
            return Ok(None);
        }
        let Some(estimate) = self.latest.peek()? else { return Ok(None) };
        let key = (estimate.stamp_ns, estimate.sequence);
        if self.newest == Some(key) {
            return Ok(None);
        }
        let restarted = self.newest.is_some_and(|(_, sequence)| estimate.sequence < sequence);
        let diverged = estimate.status & status_bits::DIVERGED != 0;
        if restarted || (diverged && !self.was_diverged) {
            self.reset_counter = self.reset_counter.wrapping_add(1);
        }
        (self.newest, self.was_diverged) = (Some(key), diverged);
        // On the raster, unless that is long past.
        self.due_ns = (self.due_ns + self.period_ns).max(now_ns.saturating_sub(self.period_ns));
        let unusable = status_bits::STALE | status_bits::INVALID | status_bits::WAITING;
        if estimate.status & unusable != 0 || !estimate.is_finite() {
            self.withheld += 1;
            return Ok(None);
        }
        Ok(Some(estimate))
    }
}

/// Bridges until the time is over or `stop` is set. `link` is open already: what came before is thrown away.
///
/// # Errors
/// `Client` where a port refuses. A device that goes is waited for.
pub fn bridge(
    options: &MavlinkOptions,
    link: Link,
    client: &Client,
    stop: &AtomicBool,
) -> Result<Bridged, MavlinkError> {
    let mut bridge = Bridge::new(options.settings()?);
    let publisher = client.measurement_publisher()?;
    let estimates = |_| client.latest_estimate();
    let mut estimates = options.send.map(estimates).transpose()?.map(|latest| Estimates {
        latest,
        period_ns: (1e9 / options.send_rate_hz) as u64,
        due_ns: 0,
        newest: None,
        was_diverged: false,
        reset_counter: 0,
        sent: 0,
        withheld: 0,
    });
    let mut sender = Sender {
        to: options.send_to.as_deref().map(resolve).transpose()?,
        own_system_id: options.own_system_id,
        component_id: options.own_component_id,
        sequence: 0,
    };
    let mut bytes = vec![0; 1 << 16];
    // What waited before is of unknown age.
    for _ in 0..10_000 {
        if !matches!(link.receive(&mut bytes), Ok(Some(_))) {
            break;
        }
    }

    let start_ns = monotonic_ns();
    let end_ns = options.duration_s.map_or(u64::MAX, |duration_s| start_ns + (duration_s * 1e9) as u64);
    let mut link = Some(link);
    let (mut beat_ns, mut sync_ns, mut syncs, mut reopen_ns) = (start_ns, start_ns, 0, 0);
    let mut status_ns = start_ns + STATUS_NS;
    let mut silence =
        Silence { heard_ns: start_ns, frames: 0, samples_ns: start_ns, samples: 0, told: false };
    let mut now_ns = start_ns;
    while now_ns < end_ns && !stop.load(Ordering::Relaxed) {
        let waits =
            bridge.waits() || estimates.as_ref().is_some_and(|estimates| estimates.due_ns < now_ns + 20 * MS);
        let wait = if waits { SHORT_WAIT } else { LONGEST_WAIT };
        if link.is_none() {
            std::thread::sleep(LONGEST_WAIT);
        }
        if link.is_none() && now_ns >= reopen_ns {
            reopen_ns = now_ns + REOPEN_NS;
            link = Link::open(&options.listen).ok();
            if link.is_some() {
                logln!("{} is back", options.listen);
            }
        }
        let mut outcome = Ok(());
        if let Some(open) = &link {
            open.wait(wait);
            outcome = take(open, &mut bytes, &mut bridge);
        }
        now_ns = monotonic_ns();
        bridge.turn(now_ns);
        let samples = bridge.take_samples();
        for sample in &samples {
            publisher.publish(sample)?;
        }
        if samples.is_empty() {
            publisher.update_connections()?;
        }
        for note in bridge.take_notes() {
            logln!("{note}");
        }
        let mut out = bridge.take_replies();
        if now_ns >= beat_ns {
            beat_ns = now_ns + BEAT_NS;
            out.push(heartbeat());
        }
        if now_ns >= sync_ns
            && bridge.vehicle_peer().is_some() | matches!(options.listen, Address::Serial { .. })
        {
            syncs += 1;
            sync_ns = now_ns + if syncs < FIRST_SYNCS { FIRST_SYNC_NS } else { BEAT_NS };
            out.push(time_sync(&bridge, options.component_id));
        }
        let estimate = estimates.as_mut().map(|estimates| estimates.next(now_ns)).transpose()?.flatten();
        if let (Some(open), false) = (&link, options.silent) {
            for message in &out {
                outcome = outcome.and_then(|()| sender.send(open, &bridge, message).map(drop));
            }
            if let (Some(estimates), Some(estimate), Ok(())) = (&mut estimates, estimate, &outcome) {
                let message = convert::estimate_message(&estimate, bridge.frame(), estimates.reset_counter);
                match sender.send(open, &bridge, &MavMessage::ODOMETRY(message)) {
                    Ok(sent) => estimates.sent += u64::from(sent),
                    Err(error) => outcome = Err(error),
                }
            }
        }
        if let Err(cause) = outcome {
            let gone = LinkError::Gone { address: options.listen.clone(), cause };
            logln!("{gone}; waiting for it to come back");
            link = None;
        }
        if let Some(words) = silence.look(&bridge, now_ns, options) {
            logln!("{words}");
        }
        if now_ns >= status_ns {
            status_ns = now_ns + STATUS_NS;
            let sent = estimates.as_ref().map_or(0, |estimates| estimates.sent);
            logln!(
                "{} samples published, {sent} estimates sent; {}",
                bridge.tally().samples,
                counts(&bridge)
            );
        }
    }
    Ok(Bridged {
        bridge,
        estimates_sent: estimates.as_ref().map_or(0, |estimates| estimates.sent),
        estimates_withheld: estimates.as_ref().map_or(0, |estimates| estimates.withheld),
        duration_s: (now_ns - start_ns) as f64 * 1e-9,
        stopped: now_ns < end_ns,
    })
}

/// Everything that lies ready. A sender without pause must not keep the rest from its turn.
fn take(link: &Link, bytes: &mut [u8], bridge: &mut Bridge) -> Result<(), std::io::Error> {
    let start_ns = monotonic_ns();
    for _ in 0..256 {
        let Some((n, from)) = link.receive(bytes)? else { break };
        // Of each its own: an arrival earlier than the true one would be taken for a shorter way.
        let now_ns = monotonic_ns();
        bridge.receive(&bytes[..n], from, now_ns);
        if now_ns > start_ns + 5 * MS {
            break;
        }
    }
    Ok(())
}

fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        ..HEARTBEAT_DATA::default()
    })
}

fn time_sync(bridge: &Bridge, component_id: u8) -> MavMessage {
    MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: 0,
        ts1: monotonic_ns().cast_signed(),
        target_system: bridge.vehicle().unwrap_or(0),
        target_component: component_id,
    })
}

/// Tells, once each time, that nothing comes, or nothing that can be used.
struct Silence {
    heard_ns: u64,
    frames: u64,
    samples_ns: u64,
    samples: u64,
    told: bool,
}

impl Silence {
    fn look(&mut self, bridge: &Bridge, now_ns: u64, options: &MavlinkOptions) -> Option<String> {
        let (frames, tally) = (bridge.frame_tally(), bridge.tally());
        if frames.frames > self.frames {
            (self.frames, self.heard_ns) = (frames.frames, now_ns);
        }
        if tally.samples > self.samples {
            (self.samples, self.samples_ns, self.told) = (tally.samples, now_ns, false);
        }
        if self.told || now_ns - self.samples_ns < SILENCE_NS {
            return None;
        }
        self.told = true;
        let is_silent = now_ns - self.heard_ns >= SILENCE_NS;
        Some(if is_silent && frames.bytes == 0 {
            nothing_heard(options)
        } else {
            wrong_heard(bridge, is_silent)
        })
    }
}

fn nothing_heard(options: &MavlinkOptions) -> String {
    let check = match &options.listen {
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
    format!("nothing heard at {} within {} s; {check}", options.listen, SILENCE_NS / S)
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
    use clap::Parser;
    use mavlink::dialects::common::SYS_STATUS_DATA;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        options: MavlinkOptions,
    }

    fn options(line: &str) -> MavlinkOptions {
        Line::parse_from(line.split_whitespace()).options
    }

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
        let said = nothing_heard(&options("x --listen serial:/dev/ttyUSB0:921600"));
        assert!(
            said.contains("nothing heard at serial:/dev/ttyUSB0:921600 within 5 s; do baud rates agree"),
            "{said}"
        );
    }

    #[test]
    fn options_become_settings() {
        let line = "x --listen udp:0.0.0.0:14550 --system-id 4 --component-id 2 --source local-position --join-ms 2.5 \
                    --thrust-n 40 --torque-n-m 1,2,3 --request-rate-hz 20";
        let expected = Settings {
            system_id: Some(4),
            component_id: 2,
            source: Source::LocalPosition,
            join_ns: 2_500_000,
            thrust_n: Some(40.0),
            torque_n_m: Some([1.0, 2.0, 3.0]),
            request_rate_hz: Some(20.0),
        };
        assert_eq!(options(line).settings().unwrap(), expected);
        assert_eq!(options("x --listen udp:0.0.0.0:14550").settings().unwrap(), Settings::default());
    }
}
