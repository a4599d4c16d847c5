//! The MAVLink bridge between a live daemon and a vehicle simulated with pymavlink, over loopback and a pseudo terminal.
//!
//! The vehicle (`mavlink_peer.py`) computes rotations with its own code, and its clock differs from ours by a known offset.
//! Values and stamps are compared with those that it reports.

use crate::programs::BENCH;
use serde_json::Value;
use shared_types::Client;
use shared_types::payload::{Estimate, Measurement, Rejection, Status, command, frame, status_bits, valid};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use testkit::{Ended, Heard, PATIENCE, Process, Recorder, TestDomain};

const PEER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/mavlink_peer.py");
const PYMAVLINK: &str = "pymavlink==2.4.50";
/// Single precision, of numbers up to some ten.
const ROUNDING: f64 = 3e-6;

/// The interpreter of an environment with pymavlink; `None`, and said so, where this machine gives none.
fn python() -> Option<PathBuf> {
    if !sim_publisher::HAS_MAVLINK {
        testkit::skip("the MAVLink bridge", "it is not in this program; needed: --features mavlink");
        return None;
    }
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mavlink-peer");
    let made = testkit::python::environment(&directory, &[PYMAVLINK]);
    made.inspect_err(|reason| testkit::skip("the MAVLink bridge against pymavlink", reason)).ok()
}

/// The vehicle's process. It reads a line before a flight over a serial line.
fn peer(python: &Path, arguments: &[&str]) -> Process {
    let mut command = Command::new(python);
    command.arg(PEER).args(arguments).stdin(Stdio::piped()).env("PYTHONDONTWRITEBYTECODE", "1");
    Process::spawn(command)
}

/// What the vehicle sent and received.
fn heard(peer: Process) -> Value {
    serde_json::from_str(&peer.finish_within(2 * PATIENCE).ok()).unwrap()
}

fn free_port() -> u16 {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// What a flight left behind.
struct Flight {
    peer: Value,
    bridge: Value,
    log: String,
    status: Status,
    samples: Vec<Measurement>,
    estimates: Vec<Estimate>,
}

fn fly(python: &Path, flight: &str, n: usize, options: &[&str]) -> Flight {
    let domain = TestDomain::new();
    let daemon = BENCH.start(&domain, &["daemon", "run", "--preset", "rigid-body", "--fresh"]);
    let client = domain.client();
    let recorder = Recorder::start(&domain);
    let n = n.to_string();
    let port = free_port();
    let (listen, wire) = (format!("udp:127.0.0.1:{port}"), format!("udpout:127.0.0.1:{port}"));
    let arguments = [&["sim_publisher", "mavlink", "--json", "--listen", &listen], options].concat();
    let bridge = BENCH.start(&domain, &arguments);
    let peer = heard(peer(python, &[&wire, flight, "--n", &n]));
    let Ended { code, out, log } = bridge.stop();
    assert_eq!(code, Some(0), "{log}");
    let status = client.command(command::STATUS, PATIENCE).unwrap().status;
    let Heard { measurements, estimates, .. } = recorder.finish();
    drop(client);
    daemon.stop().ok();
    let bridge = serde_json::from_str(&out).unwrap();
    println!("{log}{bridge}");
    let (samples, estimates) = (measurements.into_values().collect(), estimates.into_values().collect());
    Flight { peer, bridge, log, status, samples, estimates }
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|index| value[index].as_f64().unwrap_or(f64::NAN))
}

fn assert_near(found: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len());
    let is_near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= tolerance);
    assert!(is_near, "{what}: found {found:?}, expected {expected:?}");
}

/// A quaternion and its negative are the same rotation.
fn assert_same_rotation(found: [f64; 4], expected: [f64; 4], what: &str) {
    let same: f64 = found.iter().zip(&expected).map(|(a, b)| a * b).sum();
    assert_near(&found.map(|part| part * same.signum()), &expected, ROUNDING, what);
}

/// Each sample is the message of the same place in the vehicle's own list; how much later it was stamped (s).
fn assert_samples(flight: &Flight, force_of_1_n: Option<f64>) -> Vec<f64> {
    let sent = flight.peer["sent"].as_array().unwrap();
    // What a busy machine's recorder missed is missing in a row, and known by its number.
    assert!(flight.samples.len() * 10 >= sent.len() * 9, "{} of {} seen", flight.samples.len(), sent.len());
    let mut later_s = Vec::new();
    for sample in &flight.samples {
        let sent = &sent[sample.sequence as usize];
        let needed = valid::VELOCITY | valid::ANGULAR_VELOCITY | valid::POSITION | valid::ATTITUDE;
        assert!(sample.has(needed) && sample.velocity_frame == frame::INERTIAL, "{sample:?}");
        assert_near(&sample.velocity_m_s, &numbers::<3>(&sent["velocity"]), ROUNDING, "velocity");
        assert_near(&sample.position_m, &numbers::<3>(&sent["position"]), ROUNDING, "position");
        assert_near(&sample.angular_velocity_rad_s, &numbers::<3>(&sent["rates"]), ROUNDING, "rates");
        assert_same_rotation(sample.attitude_wxyz, numbers(&sent["quaternion"]), "attitude");
        assert_eq!(sample.has(valid::FORCE), force_of_1_n.is_some());
        if let Some(force_of_1_n) = force_of_1_n {
            let size_n = sent["thrust"].as_f64().unwrap() * force_of_1_n;
            let force_n = numbers::<3>(&sent["up"]).map(|up| up * size_n);
            assert_near(&sample.force_n, &force_n, 1e-4, "force");
        }
        later_s.push(sample.stamp_ns as f64 * 1e-9 - sent["monotonic_s"].as_f64().unwrap());
    }
    assert!(flight.samples.windows(2).all(|two| two[0].stamp_ns < two[1].stamp_ns));
    later_s
}

/// The service took them all; only a machine that is too busy for it may leave some out, and says so.
fn assert_accepted(status: &Status, n: u64) {
    let rejected = |reason: Rejection| status.counters.samples_rejected[reason as usize];
    let too_busy = rejected(Rejection::Overload) + rejected(Rejection::TooOld);
    println!(
        "{} accepted, {too_busy} came to a loop that was late, {} lost",
        status.counters.samples_accepted, status.counters.samples_lost
    );
    assert_eq!(status.counters.samples_rejected_total(), too_busy, "{:?}", status.counters.samples_rejected);
    assert_eq!(status.counters.samples_accepted + too_busy + status.counters.samples_lost, n);
    assert!(status.counters.samples_accepted * 2 > n);
}

fn summary_of(later_s: &[f64]) -> (f64, f64, f64) {
    let mut sorted = later_s.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
    println!(
        "stamps later than the vehicle's own times by {:.1} … {:.1} … {:.1} µs (least, median, most)",
        at(0.0) * 1e6,
        at(0.5) * 1e6,
        at(1.0) * 1e6
    );
    (at(0.0), at(0.5), at(1.0))
}

#[test]
fn odometry_goes_in_and_the_estimates_come_back_as_odometry() {
    let Some(python) = python() else { return };
    let flight = fly(&python, "odometry", 600, &["--send", "odometry", "--send-rate-hz", "200"]);
    assert_eq!(flight.bridge["samples_published"], 600);
    for none in
        ["garbage_bytes", "crc_failures", "frames_lost", "unreadable", "samples_out_of_order", "clock_resets"]
    {
        assert_eq!(flight.bridge[none], 0, "{none}");
    }
    assert_accepted(&flight.status, 600);

    // The vehicle answers TIMESYNC: no stamp is off by more than half of the round trip, and the clock's microsecond.
    let later_s = assert_samples(&flight, None);
    let round_trip_s = flight.bridge["timesync_round_trip_ns"].as_f64().unwrap() * 1e-9;
    let (least_s, median_s, _) = summary_of(&later_s);
    assert!(least_s > -0.1 && median_s < 0.1, "offsets are of this clock: {least_s}, {median_s}");
    println!("round trip of TIMESYNC {:.0} µs", round_trip_s * 1e6);

    // The ODOMETRY that the vehicle received equals the estimate in shared memory at the same stamp.
    let returned = flight.peer["odometry"].as_array().unwrap();
    assert!(returned.len() > 100, "{} estimates came back", returned.len());
    assert_eq!(flight.bridge["estimates_sent"], returned.len());
    let mut compared = 0;
    for message in returned {
        let time_us = message["time_usec"].as_u64().unwrap();
        let Some(estimate) = flight.estimates.iter().find(|estimate| estimate.stamp_ns / 1000 == time_us)
        else {
            continue;
        };
        compared += 1;
        assert_eq!(estimate.status & (status_bits::STALE | status_bits::INVALID | status_bits::WAITING), 0);
        assert_near(&numbers::<3>(&message["position"]), &estimate.position_m, ROUNDING, "position");
        assert_near(&numbers::<3>(&message["rates"]), &estimate.angular_velocity_rad_s, ROUNDING, "rates");
        assert_same_rotation(numbers(&message["quaternion"]), estimate.attitude_wxyz, "attitude");
        let inertial_m_s = turned(estimate.attitude_wxyz, numbers(&message["velocity"]));
        assert_near(&inertial_m_s, &estimate.velocity_m_s, ROUNDING, "velocity along the body's axes");
        assert_eq!(message["frames"], serde_json::json!([1, 12]));
        assert_eq!(message["unknown"], serde_json::json!([true, true]));
        assert_eq!(message["estimator_type"], 1);
    }
    assert!(compared * 10 >= returned.len() * 9, "{compared} of {} compared", returned.len());
    // And they are estimates of this flight, once they have found into it.
    let mut errors_m_s: Vec<f64> = flight.samples[flight.samples.len() / 2..]
        .iter()
        .filter_map(|sample| {
            let is_of_it =
                |e: &&Estimate| e.status & status_bits::TRACKING != 0 && e.source_sequence == sample.sequence;
            let estimate = flight.estimates.iter().find(is_of_it)?;
            let off = estimate.velocity_m_s.iter().zip(&sample.velocity_m_s).map(|(a, b)| (a - b).powi(2));
            Some(off.sum::<f64>().sqrt())
        })
        .collect();
    errors_m_s.sort_by(f64::total_cmp);
    println!(
        "velocity off by {:.3} m/s in the median of {}",
        errors_m_s[errors_m_s.len() / 2],
        errors_m_s.len()
    );
    assert!(errors_m_s[errors_m_s.len() / 2] < 0.5);

    assert_eq!(flight.peer["sources"], serde_json::json!([[1, 197]]));
    assert!(flight.peer["heartbeats"].as_u64().unwrap() >= 3);
    let answered = flight.peer["offsets_us"].as_array().unwrap();
    assert!(
        answered.len() >= 10 && answered.iter().all(|us| us.as_f64().unwrap().abs() < 1e6),
        "{answered:?}"
    );
}

/// Written out: v + 2 w (u × v) + 2 u × (u × v).
fn turned([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let once = cross([x, y, z], v);
    let twice = cross([x, y, z], once);
    std::array::from_fn(|axis| v[axis] + 2.0 * w * once[axis] + 2.0 * twice[axis])
}

#[test]
fn position_and_attitude_are_joined_and_the_thrust_becomes_a_force() {
    let Some(python) = python() else { return };
    let options = [
        "--thrust-n",
        "39.2",
        "--request-rate-hz",
        "100",
        "--own-system-id",
        "42",
        "--own-component-id",
        "191",
    ];
    let flight = fly(&python, "pair", 400, &options);
    assert_eq!(flight.bridge["samples_published"], 400);
    assert_eq!(flight.bridge["samples_with_force"], 400);
    assert_eq!(flight.bridge["samples_out_of_order"], 0);
    assert_accepted(&flight.status, flight.peer["sent"].as_array().unwrap().len() as u64);
    let (least_s, median_s, _) = summary_of(&assert_samples(&flight, Some(39.2)));
    assert!(least_s > -0.1 && median_s < 0.1);
    // ODOMETRY was requested and denied; then the others were requested, with their interval in µs.
    let asked: Vec<_> =
        flight.peer["requests"].as_array().unwrap().iter().map(|r| r[0].as_u64().unwrap()).collect();
    assert_eq!(asked, [331, 83, 32, 31]);
    assert!(flight.peer["requests"].as_array().unwrap().iter().all(|r| r[1] == 10_000.0 && r[2] == 1));
    assert!(flight.log.contains("ODOMETRY: MAV_RESULT_DENIED"), "{}", flight.log);
    assert_eq!(flight.peer["sources"], serde_json::json!([[42, 191]]));
}

#[test]
fn a_serial_line_works_like_the_network_and_is_waited_for_when_it_goes() {
    let Some(python) = python() else { return };
    let domain = TestDomain::new();
    let daemon = BENCH.start(&domain, &["daemon", "run", "--preset", "rigid-body", "--fresh"]);
    let client = domain.client();
    let mut peer = peer(&python, &["pty", "odometry", "--n", "200"]);
    let mut device = String::new();
    let mut said = BufReader::new(peer.child.stdout.take().unwrap());
    said.read_line(&mut device).unwrap();
    let listen = format!("serial:{}:921600", device.trim());
    let bridge = BENCH
        .start(&domain, &["sim_publisher", "mavlink", "--json", "--listen", &listen, "--send", "odometry"]);
    std::thread::sleep(Duration::from_millis(300));
    peer.child.stdin.take().unwrap().write_all(b"go\n").unwrap();
    let mut rest = String::new();
    said.read_to_string(&mut rest).unwrap();
    let heard: Value = serde_json::from_str(&rest).unwrap();
    // The other end of the serial line is closed, as if the plug were pulled out.
    std::thread::sleep(Duration::from_millis(300));
    let Ended { code, out, log } = bridge.stop();
    assert!(code == Some(0) && log.contains("waiting for it to come back"), "{log}");
    let bridge: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(bridge["samples_published"], 200);
    assert_eq!(bridge["crc_failures"], 0);
    assert_eq!(bridge["estimates_sent"], heard["odometry"].as_array().unwrap().len());
    assert!(heard["odometry"].as_array().unwrap().len() > 10);
    let status = client.command(command::STATUS, PATIENCE).unwrap().status;
    assert_accepted(&status, 200);
    drop(client);
    daemon.stop().ok();
}

#[test]
fn the_bridge_outlives_the_service_and_feeds_its_successor() {
    let Some(python) = python() else { return };
    let domain = TestDomain::new();
    let port = free_port();
    let (listen, wire) = (format!("udp:127.0.0.1:{port}"), format!("udpout:127.0.0.1:{port}"));
    // Before there is any service.
    let bridge = BENCH
        .start(&domain, &["sim_publisher", "mavlink", "--json", "--listen", &listen, "--send", "odometry"]);
    let daemon = BENCH.start(&domain, &["daemon", "run", "--preset", "rigid-body", "--fresh"]);
    let peer = peer(&python, &[&wire, "odometry", "--n", "1000"]);
    let accepted = |least: u64| {
        let deadline = Instant::now() + 2 * PATIENCE;
        loop {
            let client = Client::connect(&domain.domain, "vehicle", PATIENCE).unwrap();
            match client.command(command::STATUS, Duration::from_secs(1)) {
                Ok(reply) if reply.status.counters.samples_accepted >= least => return,
                found => assert!(
                    Instant::now() < deadline,
                    "{:?}",
                    found.map(|reply| reply.status.counters.samples_accepted)
                ),
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    accepted(100);
    daemon.kill();
    let daemon = BENCH.start(&domain, &["daemon", "run", "--preset", "rigid-body", "--fresh"]);
    accepted(100);
    let heard = heard(peer);
    let bridge: Value = serde_json::from_str(&bridge.stop().ok()).unwrap();
    assert_eq!(bridge["samples_published"], 1000);
    assert_eq!(bridge["estimates_sent"], heard["odometry"].as_array().unwrap().len());
    daemon.stop().ok();
}

#[test]
fn what_cannot_be_opened_is_named_with_a_remedy() {
    let domain = TestDomain::new();
    if !sim_publisher::HAS_MAVLINK {
        let ended = BENCH.start(&domain, &["sim_publisher", "mavlink", "--listen", "x"]).finish();
        assert!(ended.log.contains("--features mavlink"), "{ended:?}");
        return;
    }
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let in_use = format!("udp:{}", taken.local_addr().unwrap());
    let refused = [
        (in_use.as_str(), 1, "is in use by another program"),
        ("serial:/dev/ttyNONE:57600", 1, "no serial port '/dev/ttyNONE'"),
        ("serial:/dev/null", 1, "cannot use '/dev/null' as a serial port"),
        ("udp:192.0.2.1:14550", 1, "needed: an address of this machine"),
        ("udp:14550", 2, "needed: udp:ADDRESS:PORT"),
        ("tcp:127.0.0.1:5760", 2, "needed: udp:ADDRESS:PORT"),
    ];
    for (listen, code, words) in refused {
        let ended = BENCH.start(&domain, &["sim_publisher", "mavlink", "--listen", listen]).finish();
        assert!(ended.code == Some(code) && ended.log.contains(words), "{listen}: {ended:?}");
    }
}
