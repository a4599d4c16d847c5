//! `monitor record` and `monitor serve` against real services, read by public readers: the Python packages of MCAP and a
//! WebSocket client, in a Python environment of their own. Without Python the tests report that they were skipped.
//!
//! Vehicles send at 50 Hz. The queue of 64 samples then lasts for a second, so that the test's recorder loses none even if
//! other tests use the processor.

use crate::programs::{MONITOR, monitor, service, simulator, vehicle};
use importers::{CsvMap, ImportOptions, Mcap, read_flight};
use rustix::process::Signal;
use serde::Serialize;
use serde_json::{Value, json};
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Measurement, status_bits, valid};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use testkit::{Ended, Heard, Process, Recorder, TestDomain, wait_until};

/// The interpreter with the readers; `None`, and said so, where there is none.
fn python(what: &str) -> Option<PathBuf> {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mcap-reader");
    let packages = ["mcap==1.6.0", "mcap-protobuf-support==0.6.0", "websockets>=13,<18"];
    testkit::python::environment(&directory, &packages).inspect_err(|reason| testkit::skip(what, reason)).ok()
}

/// What the public readers make of it.
fn check(python: &Path, arguments: &[&str]) -> Value {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/mcap_check.py");
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", testkit::python::said(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Fails unless the message, whose doubles are their bits, has every field of the payload with the same bits.
///
/// The payload's text has the shortest number of the same bits, and null for what is not finite. Absent are what a
/// sample does not carry (empty, where it is a list) and the parts of a plant that is not estimated.
#[track_caller]
fn assert_same(message: &Value, payload: &Value) {
    let valid = payload["valid"].as_u64().unwrap_or(u64::MAX) as u32;
    for (key, needed) in payload.as_object().unwrap() {
        let found = &message[key.strip_suffix("_wxyz").unwrap_or(key)];
        let is_carried = valid_bit(key).is_none_or(|bit| valid & bit != 0);
        match (key.as_str(), needed) {
            (_, _) if !is_carried => assert!(found.is_null() || *found == json!([]), "{key}: {found}"),
            ("linear", _) => assert!(found.is_null(), "{key}: {found}"),
            ("state" | "matched_input", _) => assert_eq!(*found, json!([]), "{key}"),
            (_, Value::Object(_)) => assert_same(found, needed),
            (_, Value::Array(needed)) => {
                let names = match needed.len() {
                    4 => &["w", "x", "y", "z"][..],
                    _ if key == "euler_rad" => &["roll", "pitch", "yaw"],
                    _ => &["x", "y", "z"],
                };
                assert_eq!(found.as_object().unwrap().len(), needed.len(), "{key}");
                for (name, needed) in names.iter().zip(needed) {
                    assert_same_number(&found[name], needed, key);
                }
            }
            _ => assert_same_number(found, needed, key),
        }
    }
}

#[track_caller]
fn assert_same_number(found: &Value, needed: &Value, key: &str) {
    let found_bits = found.as_u64().unwrap_or_else(|| panic!("{key}: {found}"));
    match needed.as_f64() {
        _ if needed.is_u64() => assert_eq!(found, needed, "{key}"),
        Some(number) => assert_eq!(found_bits, number.to_bits(), "{key}"),
        None => assert!(!f64::from_bits(found_bits).is_finite(), "{key}: {found}"),
    }
}

/// The bit that says whether a sample carries this field.
fn valid_bit(key: &str) -> Option<u32> {
    let bit = match key {
        "velocity_m_s" => valid::VELOCITY,
        "angular_velocity_rad_s" => valid::ANGULAR_VELOCITY,
        "specific_force_m_s2" => valid::SPECIFIC_FORCE,
        "position_m" => valid::POSITION,
        "attitude_wxyz" => valid::ATTITUDE,
        "force_n" => valid::FORCE,
        "torque_n_m" => valid::TORQUE,
        "output" => valid::OUTPUT,
        "input" => valid::INPUT,
        _ => return None,
    };
    Some(bit)
}

fn messages<'a>(topics: &'a Value, topic: &str) -> &'a Vec<Value> {
    topics[topic]["messages"].as_array().unwrap_or_else(|| panic!("no topic {topic}"))
}

/// Each message equals the one of its sequence that our own client received.
#[track_caller]
fn assert_heard<T: Serialize>(found: &[Value], heard: &BTreeMap<u64, T>) {
    assert!(!found.is_empty());
    for message in found {
        let sequence = message["sequence"].as_u64().unwrap();
        let heard = heard.get(&sequence).unwrap_or_else(|| panic!("{sequence} was not published"));
        assert_same(message, &serde_json::to_value(heard).unwrap());
    }
}

/// Starts a recorder, and waits until it writes.
fn recorder(domain: &TestDomain, file: &Path, arguments: &[&str]) -> Process {
    let process = MONITOR.start(domain, &[&["record", file.to_str().unwrap(), "--json"], arguments].concat());
    wait_until("a first chunk", || file.metadata().is_ok_and(|metadata| metadata.len() > 4096));
    process
}

/// Ends it as an operator does; what it said.
fn summary(recorder: Process) -> Value {
    recorder.signal(Signal::INT);
    serde_json::from_str(&recorder.finish().ok()).unwrap()
}

/// What the recorder says of a topic: messages, missing, restarts.
fn tally(summary: &Value, topic: &str) -> [u64; 3] {
    ["messages", "missing", "restarts"].map(|key| summary["topics"][topic][key].as_u64().unwrap())
}

/// The same fields of a flight's samples: stamps from the first, sequences too.
fn from_the_first(samples: &BTreeMap<u64, Measurement>) -> Vec<Measurement> {
    let first = samples.first_key_value().unwrap().1;
    let relative = |sample: &Measurement| Measurement {
        sequence: sample.sequence - first.sequence,
        stamp_ns: sample.stamp_ns - first.stamp_ns,
        ..*sample
    };
    samples.values().map(relative).collect()
}

/// Compares all bits: as text, two different doubles differ.
#[track_caller]
fn assert_same_bits(found: &[Measurement], needed: &[Measurement]) {
    let text = |samples: &[Measurement]| samples.iter().map(|s| json!(s).to_string()).collect::<Vec<_>>();
    assert_eq!(text(found), text(needed));
}

#[test]
fn a_public_reader_finds_in_a_recording_what_was_published() {
    let domain = TestDomain::new();
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("flight.mcap");
    let daemon = service(&domain, "--preset rigid-body");
    wait_until("the service", || domain.status().counters.ticks > 0);
    let ears = Recorder::start(&domain);
    let recording = recorder(&domain, &file, &[]);
    let mut flight = vehicle(&domain, "--rate-hz 50 --duration 4 --dropout-probability 0.05");
    wait_until("the flight's end", || flight.has_ended());
    std::thread::sleep(Duration::from_millis(600));
    let summary = summary(recording);
    std::thread::sleep(Duration::from_millis(100));
    let Heard { measurements, estimates, truths, statuses } = &ears.finish();

    // Samples that the vehicle lost on purpose are gaps; nothing else is missing.
    let (first, last) = (*measurements.keys().next().unwrap(), *measurements.keys().last().unwrap());
    let n = measurements.len() as u64;
    assert!(n > 150 && last - first + 1 > n, "{n} samples, {first} … {last}");
    assert_eq!(tally(&summary, "/vehicle/measurement"), [n, last - first + 1 - n, 0]);
    assert_eq!(tally(&summary, "/vehicle/truth"), [truths.len() as u64, 0, 0]);
    let [n_estimates, missing, restarts] = tally(&summary, "/vehicle/estimate");
    assert!(n_estimates > 20 && (missing, restarts) == (0, 0), "{summary}");

    // Our own reader first, which needs no Python.
    let flight = read_flight(&Mcap, &file, &ImportOptions::default()).unwrap();
    assert_same_bits(&flight.samples, &from_the_first(measurements));
    assert_eq!(flight.skipped_rows(), 0);

    // Any channel will do, by its fields' names.
    let truth_columns =
        ["x", "y", "z"].map(|axis| format!("velocity_{axis}=/vehicle/truth:velocity_m_s.{axis}"));
    let options =
        ImportOptions { columns: CsvMap::read(None, &truth_columns).unwrap(), ..ImportOptions::default() };
    let flown = read_flight(&Mcap, &file, &options).unwrap();
    let velocities = |samples: &[Measurement]| samples.iter().map(|s| s.velocity_m_s).collect::<Vec<_>>();
    assert_eq!(
        velocities(&flown.samples),
        truths.values().map(|truth| truth.velocity_m_s).collect::<Vec<_>>()
    );

    // Played again, the service gets the same.
    let ears = Recorder::start(&domain);
    let mut replay = simulator(&domain, &format!("replay {}", file.display()));
    wait_until("the replay's end", || replay.has_ended());
    std::thread::sleep(Duration::from_millis(100));
    assert_same_bits(&from_the_first(&ears.finish().measurements), &flight.samples);
    daemon.stop().ok();

    let Some(python) = python("the public reader of recordings") else { return };
    let found = check(&python, &["file", file.to_str().unwrap()]);
    let topics = &found["topics"];
    for (topic, schema) in [
        ("/vehicle/measurement", "measurement.Measurement"),
        ("/vehicle/estimate", "estimate.Estimate"),
        ("/vehicle/truth", "truth.Truth"),
        ("/vehicle/status", "status.Status"),
        ("/vehicle/estimate/odometry", "foxglove.Odometry"),
        ("/vehicle/truth/odometry", "foxglove.Odometry"),
        ("/vehicle/log", "foxglove.Log"),
        ("/tf", "foxglove.FrameTransform"),
    ] {
        assert_eq!(topics[topic]["schema"], schema, "{topic}");
        assert_eq!(topics[topic]["rises"], true, "{topic}: times must rise");
        assert_eq!(found["counts"][topic], messages(topics, topic).len(), "{topic}");
    }
    assert_eq!(topics.as_object().unwrap().len(), 8, "{:?}", topics.as_object().unwrap().keys());
    for topic in ["measurement", "estimate", "truth", "status"] {
        let topic = format!("/vehicle/{topic}");
        assert_eq!(tally(&summary, &topic)[0], messages(topics, &topic).len() as u64, "{topic}");
    }
    assert_heard(messages(topics, "/vehicle/measurement"), measurements);
    assert_heard(messages(topics, "/vehicle/truth"), truths);
    assert_heard(messages(topics, "/vehicle/estimate"), estimates);
    for message in messages(topics, "/vehicle/estimate") {
        let words = status_bits::words(message["status"].as_u64().unwrap()).join(" ");
        assert_eq!(message["status_words"], words);
    }
    for status in messages(topics, "/vehicle/status") {
        let heard = &statuses[&status["sequence"].as_u64().unwrap()];
        assert_eq!(status["samples_accepted"], heard.counters.samples_accepted);
        assert_eq!(status["step_ns"]["p99"], heard.step_ns.p99);
        assert_eq!(status["dead_zone_width"]["translation"], heard.dead_zone_width[0].to_bits());
        assert_eq!(status["samples_rejected"]["too_late"], heard.counters.samples_rejected[4]);
    }
    // The file says how its times were made of the stamps, and what is missing.
    let metadata = &found["metadata"];
    let number = |text: &Value| text.as_str().unwrap().parse::<u64>().unwrap();
    let zero_ns = number(&metadata["recording"]["wall_clock_at_monotonic_zero_ns"]);
    for (topic, stamp) in
        [("estimate", "publish_stamp_ns"), ("measurement", "stamp_ns"), ("truth", "stamp_ns")]
    {
        let topic = &topics[format!("/vehicle/{topic}")];
        for (time, message) in
            topic["times"].as_array().unwrap().iter().zip(topic["messages"].as_array().unwrap())
        {
            assert_eq!(time.as_u64().unwrap(), zero_ns + message[stamp].as_u64().unwrap());
        }
    }
    assert_eq!(number(&metadata["recording_end"]["/vehicle/measurement missing"]), last - first + 1 - n);
    // Foxglove's own schemas say the same: body axes and all.
    let odometry = messages(topics, "/vehicle/truth/odometry").last().unwrap();
    let true_end = truths.last_key_value().unwrap().1;
    assert_eq!(odometry["pose"]["position"]["x"].as_f64(), Some(true_end.position_m[0]));
    let speed = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let body = ["x", "y", "z"].map(|axis| odometry["linearVelocity"][axis].as_f64().unwrap_or(0.0));
    assert!((speed(body) - speed(true_end.velocity_m_s)).abs() < 1e-9, "{odometry}");
}

#[test]
fn a_recording_goes_on_across_a_killed_service_and_is_whole_without_its_end() {
    let domain = TestDomain::new();
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("flight.mcap");
    let daemon = service(&domain, "--preset rigid-body");
    wait_until("the service", || domain.status().counters.ticks > 0);
    let ears = Recorder::start(&domain);
    let recording = recorder(&domain, &file, &["--compression", "none"]);
    let flight = vehicle(&domain, "--rate-hz 50");
    std::thread::sleep(Duration::from_millis(700));
    daemon.kill();
    let _service = service(&domain, "--preset rigid-body");
    wait_until("the new service", || domain.status().counters.ticks > 20);
    let restarted_ns = monotonic_ns();
    std::thread::sleep(Duration::from_millis(1500));
    let killed_ns = monotonic_ns();
    recording.kill();
    std::thread::sleep(Duration::from_millis(100));
    drop(flight);
    let heard = &ears.finish().measurements;
    assert!(heard.values().any(|sample| sample.stamp_ns > restarted_ns), "no samples after the restart");

    // Nearly all is there: what was sent up to a second before the kill.
    let flight = read_flight(&Mcap, &file, &ImportOptions::default()).unwrap();
    let n_old = heard.values().filter(|sample| sample.stamp_ns + 1_000_000_000 < killed_ns).count();
    assert!(flight.samples.len() >= n_old && n_old > 40, "{} of {n_old}", flight.samples.len());
    assert!(flight.samples.len() <= heard.len());
    assert_same_bits(&flight.samples, &from_the_first(heard)[..flight.samples.len()]);
    assert!(flight.skipped.to_string().contains("cut off"), "{}", flight.skipped);

    let Some(python) = python("the public reader of a recording without its end") else { return };
    let found = check(&python, &["cut", file.to_str().unwrap()]);
    let n_found = found["counts"]["/vehicle/measurement"].as_u64().unwrap() as usize;
    assert!((n_old..=heard.len()).contains(&n_found), "{n_found} of {n_old}: {found}");
    assert!(found["counts"]["/vehicle/estimate"].as_u64().unwrap() > 20, "{found}");
}

#[test]
fn a_websocket_client_receives_the_live_stream() {
    let domain = TestDomain::new();
    let Some(python) = python("the WebSocket client") else { return };
    let daemon = service(&domain, "--preset rigid-body");
    wait_until("the service", || domain.status().counters.ticks > 0);
    let ears = Recorder::start(&domain);
    let flight = vehicle(&domain, "--rate-hz 50");
    let mut server = MONITOR.start(&domain, &["serve", "--listen", "127.0.0.1:0"]);
    let mut url = String::new();
    BufReader::new(server.child.stdout.take().unwrap()).read_line(&mut url).unwrap();
    let address = url.trim().to_owned();
    assert!(address.starts_with("ws://127.0.0.1:"), "{address}");
    let client = std::thread::spawn(move || check(&python, &["stream", &address, "6"]));
    wait_until("the client's end", || client.is_finished());
    std::thread::sleep(Duration::from_millis(100));
    let found = client.join().unwrap();
    drop(flight);
    server.stop().ok();
    daemon.stop().ok();

    assert_eq!(found["subprotocol"], "foxglove.sdk.v1");
    assert!(found["server"]["name"].as_str().unwrap().contains("vehicle"), "{}", found["server"]);
    // Nothing can be written through it.
    assert_eq!(found["server"]["capabilities"], json!([]), "{}", found["server"]);
    let topics = &found["topics"];
    let heard = &ears.finish();
    assert_heard(messages(topics, "/vehicle/measurement"), &heard.measurements);
    assert_heard(messages(topics, "/vehicle/truth"), &heard.truths);
    assert_heard(messages(topics, "/vehicle/estimate"), &heard.estimates);
    assert!(messages(topics, "/vehicle/status").len() >= 6);
    assert_eq!(topics["/vehicle/estimate/odometry"]["schema"], "foxglove.Odometry");
    for (topic, described) in topics.as_object().unwrap() {
        let times: Vec<u64> =
            described["times"].as_array().unwrap().iter().map(|time| time.as_u64().unwrap()).collect();
        assert!(times.is_sorted_by(|a, b| a < b), "{topic}: {times:?}");
    }
}

#[test]
fn what_cannot_be_written_is_said() {
    let domain = TestDomain::new();
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("flight.mcap");
    std::fs::write(&file, "precious").unwrap();
    let path = file.to_str().unwrap();
    let run = |arguments: &[&str]| monitor(&domain, arguments);
    let Ended { code, log, .. } = run(&["record", path]);
    assert_eq!((code, log.contains("--force")), (Some(1), true), "{log}");
    assert_eq!(std::fs::read(&file).unwrap(), b"precious");
    for wrong in [
        &["record"][..],
        &["record", path, "--duration-s", "0"],
        &["record", path, "--force", "--instance", "a/b"],
        &["serve", "--listen", "everywhere"],
        &["--fps", "1", "record", path],
    ] {
        assert_eq!(run(wrong).code, Some(2), "{wrong:?}");
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"precious");

    let daemon = service(&domain, "--preset rigid-body");
    wait_until("the service", || domain.status().counters.ticks > 0);
    // A full disk ends the recording, with the system's reason.
    let Ended { code, log, .. } = run(&["record", "/dev/full", "--force"]);
    assert_eq!((code, log.contains("No space left on device")), (Some(1), true), "{log}");
    let Ended { code, out: document, log, .. } =
        run(&["record", path, "--force", "--duration-s", "0.7", "--json"]);
    let document: Value = serde_json::from_str(&document).unwrap();
    assert_eq!((code, document["not_written"].as_u64()), (Some(0), Some(0)), "{log}");
    assert_eq!(document["bytes"], file.metadata().unwrap().len());
    // No vehicle, no samples: said, and no flight.
    let error = read_flight(&Mcap, &file, &ImportOptions::default()).unwrap_err().to_string();
    assert!(error.contains("no measurements") && error.contains("/vehicle/estimate"), "{error}");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let Ended { code, log, .. } = run(&["serve", "--listen", &taken.local_addr().unwrap().to_string()]);
    assert_eq!((code, log.contains("cannot listen on 127.0.0.1:")), (Some(1), true), "{log}");
    daemon.stop().ok();
    domain.assert_clean();
}
