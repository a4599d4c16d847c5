//! The loop around the bridge, with the link, the clock, and the service's ports. It runs in a process of its own.

use crate::bridge::Bridge;
use crate::convert;
use crate::link::{Address, Link, LinkError, resolve};
use crate::report::{Bridged, Silence, counts};
use crate::settings::Settings;
use mavlink::dialects::common::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType, TIMESYNC_DATA,
};
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use shared_types::client::Latest;
use shared_types::clock::monotonic_ns;
use shared_types::payload::status_bits;
use shared_types::{Client, ClientError, Estimate, logln};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const MS: u64 = 1_000_000;
const S: u64 = 1_000_000_000;
/// Period of our HEARTBEAT, and of TIMESYNC (ns).
const BEAT_NS: u64 = S;
/// Period of TIMESYNC in the first seconds, until a short round trip is found (ns).
const FIRST_SYNC_NS: u64 = 100 * MS;
const FIRST_SYNCS: u32 = 20;
/// Time between two lines with counts (ns).
const STATUS_NS: u64 = 5 * S;
/// Time between two attempts to open a device that was removed (ns).
const REOPEN_NS: u64 = S;
/// Stop requests and new readers are handled at least this often.
const MAX_WAIT: Duration = Duration::from_millis(20);
/// While an estimate is due, or half a sample waits.
const SHORT_WAIT: Duration = Duration::from_millis(1);
/// While no vehicle is known whose number could be taken.
const FIRST_SYSTEM_ID: u8 = 1;

/// How to talk to a vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The address of the vehicle.
    pub listen: Address,
    /// The settings of the bridge.
    pub settings: Settings,
    /// Whether the estimate is sent as ODOMETRY.
    pub sends_odometry: bool,
    /// Destination (udp, `HOST:PORT`); `None` for the sender of the vehicle's messages.
    pub send_to: Option<String>,
    /// How often at most (Hz), above 0.
    pub send_rate_hz: f64,
    /// System id of what is sent; `None` for the vehicle's.
    pub own_system_id: Option<u8>,
    /// Component id of what is sent.
    pub own_component_id: u8,
    /// Nothing at all is sent.
    pub is_silent: bool,
    /// Length of the run (s); `None` until the stop.
    pub duration_s: Option<f64>,
}

/// Why the bridge ends without having done its work.
#[derive(Debug, thiserror::Error)]
pub enum MavlinkError {
    /// The link failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Shared memory failed.
    #[error(transparent)]
    Client(#[from] ClientError),
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

/// The estimates of the service that are to be sent.
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

/// Bridges until the time is over or `stop` is set. `link` is open already; bytes that came before are dropped.
///
/// # Errors
/// `Client` if a port refuses. A device that was removed is no error: the loop waits until it is back.
pub fn run(
    options: &Options,
    link: Link,
    client: &Client,
    stop: &AtomicBool,
) -> Result<Bridged, MavlinkError> {
    let mut bridge = Bridge::new(options.settings);
    let publisher = client.measurement_publisher()?;
    let latest = options.sends_odometry.then(|| client.latest_estimate()).transpose()?;
    let mut estimates = latest.map(|latest| Estimates {
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
    // Bytes that arrived before have an unknown age.
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
    let mut silence = Silence::since(start_ns);
    let mut now_ns = start_ns;
    while now_ns < end_ns && !stop.load(Ordering::Relaxed) {
        let waits =
            bridge.waits() || estimates.as_ref().is_some_and(|estimates| estimates.due_ns < now_ns + 20 * MS);
        let wait = if waits { SHORT_WAIT } else { MAX_WAIT };
        if link.is_none() {
            std::thread::sleep(MAX_WAIT);
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
        bridge.poll(now_ns);
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
            out.push(time_sync(&bridge, options.settings.component_id));
        }
        let estimate = estimates.as_mut().map(|estimates| estimates.next(now_ns)).transpose()?.flatten();
        if let (Some(open), false) = (&link, options.is_silent) {
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
            let gone = LinkError::Gone(options.listen.clone(), cause);
            logln!("{gone}; waiting for it to come back");
            link = None;
        }
        if let Some(words) = silence.poll(&bridge, now_ns, &options.listen) {
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

/// Takes the bytes that have arrived, for 5 ms at most: a sender without pauses must not block the rest.
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
