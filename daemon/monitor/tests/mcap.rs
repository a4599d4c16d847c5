//! `monitor record` and `monitor serve` against real services, read by public readers: the Python packages of MCAP and a
//! WebSocket client, in an environment of their own (skipped aloud where Python is missing).

mod common;
#[path = "../../tests/common/python.rs"]
mod venv;

use common::{Role, TestDomain, finished, monitor, play_role, wait_until};
use importers::{CsvMap, ImportOptions, Mcap, parse_flight, read_flight};
use rustix::process::Signal;
use serde_json::{Map, Value, json};
use shared_types::client::Stream;
use shared_types::payload::{Estimate, Measurement, Status, Truth, valid};
use shared_types::{Client, clock::monotonic_ns};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

#[test]
fn role() {
    play_role();
}

/// The interpreter with the readers; `None`, aloud, where there is none.
fn python(what: &str) -> Option<PathBuf> {
    // Tests of one file run at once, and may not make one environment at once.
    static MADE: std::sync::OnceLock<Result<PathBuf, String>> = std::sync::OnceLock::new();
    let packages = ["mcap==1.6.0", "mcap-protobuf-support==0.6.0", "websockets>=13,<18"];
    match MADE.get_or_init(|| venv::environment("mcap-reader", &packages)) {
        Ok(python) => Some(python.clone()),
        Err(reason) => {
            // Past the test's capture: nobody shall take a skipped test for a passed one.
            let _ = writeln!(std::io::stderr(), "skipped: {what}: {reason}");
            None
        }
    }
}

/// What the public readers make of it.
fn check(python: &Path, arguments: &[&str]) -> Value {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/mcap_check.py");
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", venv::said(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What our own client hears on the same services. Vehicles send at 50 Hz, so that 64 samples of a queue last for a second:
/// where other tests take the processor, nobody misses one.
struct Ears {
    measurements: Stream<Measurement>,
    estimates: Stream<Estimate>,
    truths: Stream<Truth>,
    statuses: Stream<Status>,
    heard: Heard,
    _client: Client,
}

#[derive(Default)]
struct Heard {
    measurements: Vec<Measurement>,
    estimates: BTreeMap<u64, Estimate>,
    truths: Vec<Truth>,
    statuses: BTreeMap<u64, Status>,
}

impl Ears {
    fn of(domain: &TestDomain) -> Self {
        let client = Client::connect(&domain.domain, "vehicle", common::PATIENCE).unwrap();
        Self {
            measurements: client.measurement_subscriber().unwrap(),
            estimates: client.estimate_subscriber().unwrap(),
            truths: client.truth_subscriber().unwrap(),
            statuses: client.status_subscriber().unwrap(),
            heard: Heard::default(),
            _client: client,
        }
    }

    /// Listens until then.
    fn listen(&mut self, mut until: impl FnMut() -> bool) {
        let deadline_ns = monotonic_ns() + common::PATIENCE.as_nanos() as u64;
        while !until() {
            assert!(monotonic_ns() < deadline_ns, "listened for {:?}", common::PATIENCE);
            while let Some(sample) = self.measurements.take().unwrap() {
                self.heard.measurements.push(sample);
            }
            while let Some(estimate) = self.estimates.take().unwrap() {
                self.heard.estimates.insert(estimate.sequence, estimate);
            }
            while let Some(truth) = self.truths.take().unwrap() {
                self.heard.truths.push(truth);
            }
            while let Some(status) = self.statuses.take().unwrap() {
                self.heard.statuses.insert(status.sequence, status);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn listen_for(&mut self, length: Duration) {
        let end_ns = monotonic_ns() + length.as_nanos() as u64;
        self.listen(|| monotonic_ns() >= end_ns);
    }
}

fn vector<const N: usize>(names: [&str; N], values: [f64; N]) -> Value {
    let pairs = names.iter().zip(values).map(|(name, value)| ((*name).to_owned(), json!(value.to_bits())));
    pairs.collect::<Map<_, _>>().into()
}

fn xyz(values: [f64; 3]) -> Value {
    vector(["x", "y", "z"], values)
}

fn wxyz(values: [f64; 4]) -> Value {
    vector(["w", "x", "y", "z"], values)
}

/// A sample as the reader must see it: what it does not carry is absent.
fn measurement(sample: &Measurement) -> Value {
    let mut message = json!({
        "sequence": sample.sequence,
        "stamp_ns": sample.stamp_ns,
        "valid": sample.valid,
        "velocity_frame": sample.velocity_frame,
        "output": [],
        "input": [],
    });
    for (bit, name, value) in [
        (valid::VELOCITY, "velocity_m_s", xyz(sample.velocity_m_s)),
        (valid::ANGULAR_VELOCITY, "angular_velocity_rad_s", xyz(sample.angular_velocity_rad_s)),
        (valid::POSITION, "position_m", xyz(sample.position_m)),
        (valid::ATTITUDE, "attitude", wxyz(sample.attitude_wxyz)),
        (valid::FORCE, "force_n", xyz(sample.force_n)),
        (valid::TORQUE, "torque_n_m", xyz(sample.torque_n_m)),
    ] {
        if sample.has(bit) {
            message[name] = value;
        }
    }
    message
}

fn channel(channel: &shared_types::Channel) -> Value {
    vector(
        [
            "output_error",
            "activation",
            "power_function",
            "native_norm",
            "solver_error",
            "error_bound",
            "output_age_s",
        ],
        [
            channel.output_error,
            channel.activation,
            channel.power_function,
            channel.native_norm,
            channel.solver_error,
            channel.error_bound,
            channel.output_age_s,
        ],
    )
}

fn estimate(estimate: &Estimate) -> Value {
    json!({
        "sequence": estimate.sequence,
        "source_sequence": estimate.source_sequence,
        "stamp_ns": estimate.stamp_ns,
        "source_stamp_ns": estimate.source_stamp_ns,
        "publish_stamp_ns": estimate.publish_stamp_ns,
        "status": estimate.status,
        "status_words": shared_types::payload::status_bits::words(estimate.status).join(" "),
        "position_m": xyz(estimate.position_m),
        "velocity_m_s": xyz(estimate.velocity_m_s),
        "attitude": wxyz(estimate.attitude_wxyz),
        "euler_rad": vector(["roll", "pitch", "yaw"], estimate.euler_rad),
        "angular_velocity_rad_s": xyz(estimate.angular_velocity_rad_s),
        "matched_force_n": xyz(estimate.matched_force_n),
        "matched_torque_n_m": xyz(estimate.matched_torque_n_m),
        "translation": channel(&estimate.translation),
        "rotation": channel(&estimate.rotation),
        "state": [],
        "matched_input": [],
    })
}

fn truth(truth: &Truth) -> Value {
    json!({
        "sequence": truth.sequence,
        "stamp_ns": truth.stamp_ns,
        "position_m": xyz(truth.position_m),
        "velocity_m_s": xyz(truth.velocity_m_s),
        "attitude": wxyz(truth.attitude_wxyz),
        "angular_velocity_rad_s": xyz(truth.angular_velocity_rad_s),
        "matched_force_n": xyz(truth.matched_force_n),
        "matched_torque_n_m": xyz(truth.matched_torque_n_m),
        "unmatched_force_n": xyz(truth.unmatched_force_n),
        "unmatched_torque_n_m": xyz(truth.unmatched_torque_n_m),
    })
}

fn messages<'a>(topics: &'a Value, topic: &str) -> &'a Vec<Value> {
    topics[topic]["messages"].as_array().unwrap_or_else(|| panic!("no topic {topic}"))
}

/// Each message is the one of its sequence that our own client heard.
fn assert_heard<T>(found: &[Value], heard: &BTreeMap<u64, T>, expected: impl Fn(&T) -> Value) {
    assert!(!found.is_empty());
    for message in found {
        let sequence = message["sequence"].as_u64().unwrap();
        let heard = heard.get(&sequence).unwrap_or_else(|| panic!("{sequence} was not published"));
        assert_eq!(*message, expected(heard));
    }
}

/// Starts a recorder, and waits until it writes.
fn recorder(domain: &TestDomain, file: &Path, arguments: &[&str]) -> Role {
    let mut command = monitor(domain, &["record", file.to_str().unwrap(), "--json"]);
    let role = Role(command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap());
    wait_until("a first chunk", || file.metadata().is_ok_and(|metadata| metadata.len() > 4096));
    role
}

/// Ends it as an operator does; what it said.
fn summary(mut recorder: Role) -> Value {
    recorder.signal(Signal::INT);
    let document: Value = serde_json::from_reader(recorder.0.stdout.take().unwrap()).unwrap();
    assert!(recorder.0.wait().unwrap().success());
    document
}

/// What the recorder says of a topic: messages, missing, restarts.
fn tally(summary: &Value, topic: &str) -> [u64; 3] {
    ["messages", "missing", "restarts"].map(|key| summary["topics"][topic][key].as_u64().unwrap())
}

/// The same fields of a flight's samples: stamps from the first, sequences too.
fn from_the_first(samples: &[Measurement]) -> Vec<Measurement> {
    let first = samples[0];
    let relative = |sample: &Measurement| Measurement {
        sequence: sample.sequence - first.sequence,
        stamp_ns: sample.stamp_ns - first.stamp_ns,
        ..*sample
    };
    samples.iter().map(relative).collect()
}

/// Equality of all bits: text, in which every double is told apart.
fn assert_same_bits(found: &[Measurement], needed: &[Measurement]) {
    let bits =
        |samples: &[Measurement]| samples.iter().map(|s| measurement(s).to_string()).collect::<Vec<_>>();
    assert_eq!(found.len(), needed.len());
    assert_eq!(bits(found), bits(needed));
}

#[test]
fn a_public_reader_finds_in_a_recording_what_was_published() {
    let domain = TestDomain::new();
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("flight.mcap");
    let service = Role::start(&domain, "daemon run --preset rigid-body");
    wait_until("the service", || domain.status().ticks > 0);
    let mut ears = Ears::of(&domain);
    let recording = recorder(&domain, &file, &[]);
    let mut vehicle = Role::start(
        &domain,
        "sim_publisher run --scenario rigid-body --rate-hz 50 --duration 4 --dropout-probability 0.05",
    );
    ears.listen(|| vehicle.0.try_wait().unwrap().is_some());
    ears.listen_for(Duration::from_millis(600));
    let summary = summary(recording);
    ears.listen_for(Duration::from_millis(100));
    let Heard { measurements, estimates, truths, statuses } = &std::mem::take(&mut ears.heard);

    // Samples that the vehicle lost on purpose are gaps; nothing else is missing.
    let (first, last) = (measurements[0].sequence, measurements.last().unwrap().sequence);
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
    assert_eq!(velocities(&flown.samples), truths.iter().map(|truth| truth.velocity_m_s).collect::<Vec<_>>());

    // Played again, the service gets the same.
    let mut replay = Role::start(&domain, &format!("sim_publisher replay {}", file.display()));
    ears.listen(|| replay.0.try_wait().unwrap().is_some());
    ears.listen_for(Duration::from_millis(100));
    assert_same_bits(&from_the_first(&ears.heard.measurements), &flight.samples);
    service.stop();

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
    let expected: Vec<Value> = measurements.iter().map(measurement).collect();
    assert_eq!(*messages(topics, "/vehicle/measurement"), expected);
    let expected: Vec<Value> = truths.iter().map(truth).collect();
    assert_eq!(*messages(topics, "/vehicle/truth"), expected);
    assert_heard(messages(topics, "/vehicle/estimate"), estimates, estimate);
    for status in messages(topics, "/vehicle/status") {
        let heard = &statuses[&status["sequence"].as_u64().unwrap()];
        assert_eq!(status["samples_accepted"], heard.samples_accepted);
        assert_eq!(status["step_ns"]["p99"], heard.step_ns.p99);
        assert_eq!(status["dead_zone_width"]["translation"], heard.dead_zone_width[0].to_bits());
        assert_eq!(status["samples_rejected"]["older_stamp"], heard.samples_rejected[4]);
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
    let true_end = truths.last().unwrap();
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
    let service = Role::start(&domain, "daemon run --preset rigid-body");
    wait_until("the service", || domain.status().ticks > 0);
    let mut ears = Ears::of(&domain);
    let recording = recorder(&domain, &file, &["--compression", "none"]);
    let vehicle = Role::start(&domain, "sim_publisher run --scenario rigid-body --rate-hz 50");
    ears.listen_for(Duration::from_millis(700));
    service.kill();
    let _service = Role::start(&domain, "daemon run --preset rigid-body");
    let n_before = ears.heard.measurements.len();
    ears.listen(|| domain.status().ticks > 20);
    ears.listen_for(Duration::from_millis(1500));
    let killed_ns = monotonic_ns();
    recording.kill();
    ears.listen_for(Duration::from_millis(100));
    drop(vehicle);
    let heard = &ears.heard.measurements;
    assert!(heard.len() > n_before, "no samples after the restart");

    // Nearly all is there: what was sent up to a second before the kill.
    let flight = read_flight(&Mcap, &file, &ImportOptions::default()).unwrap();
    let n_old = heard.iter().filter(|sample| sample.stamp_ns + 1_000_000_000 < killed_ns).count();
    assert!(flight.samples.len() >= n_old && n_old > 40, "{} of {n_old}", flight.samples.len());
    assert!(flight.samples.len() <= heard.len());
    assert_same_bits(&flight.samples, &from_the_first(heard)[..flight.samples.len()]);
    assert!(flight.skipped.to_string().contains("cut off"), "{}", flight.skipped);

    let bytes = std::fs::read(&file).unwrap();
    assert_no_panic(&bytes);
    let Some(python) = python("the public reader of a recording without its end") else { return };
    let found = check(&python, &["cut", file.to_str().unwrap()]);
    let n_found = found["counts"]["/vehicle/measurement"].as_u64().unwrap() as usize;
    assert!((n_old..=heard.len()).contains(&n_found), "{n_found} of {n_old}: {found}");
    assert!(found["counts"]["/vehicle/estimate"].as_u64().unwrap() > 20, "{found}");
}

/// Cut anywhere or with any byte spoilt, a recording gives a shorter result or a sentence.
fn assert_no_panic(bytes: &[u8]) {
    let parse = |bytes: &[u8]| parse_flight(&Mcap, bytes, "spoilt", &ImportOptions::default());
    let whole = parse(bytes).unwrap();
    let mut shorter = 0;
    let mut refused = 0;
    for at in (0..bytes.len()).step_by(bytes.len() / 97) {
        match parse(&bytes[..at]) {
            Ok(flight) => {
                assert_eq!(flight.samples[..], whole.samples[..flight.samples.len()]);
                shorter += 1;
            }
            Err(error) => {
                assert!(error.to_string().starts_with("'spoilt'"), "{error}");
                refused += 1;
            }
        }
    }
    assert!(shorter > 50 && refused > 0, "{shorter} shorter, {refused} refused");
    // The first kilobytes hold the lengths, schemas and channels.
    for at in (0..bytes.len().min(2000)).chain((2000..bytes.len()).step_by(bytes.len() / 97)) {
        for spoilt in [0x00, 0x7f, 0xff] {
            let mut copy = bytes[..bytes.len().min(40_000)].to_vec();
            if let Some(byte) = copy.get_mut(at) {
                *byte = spoilt;
                let _ = parse(&copy);
            }
        }
    }
}

#[test]
fn a_websocket_client_receives_the_live_stream() {
    let domain = TestDomain::new();
    let Some(python) = python("the WebSocket client") else { return };
    let service = Role::start(&domain, "daemon run --preset rigid-body");
    wait_until("the service", || domain.status().ticks > 0);
    let mut ears = Ears::of(&domain);
    let vehicle = Role::start(&domain, "sim_publisher run --scenario rigid-body --rate-hz 50");
    let mut command = monitor(&domain, &["serve", "--listen", "127.0.0.1:0"]);
    let mut server = Role(command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap());
    let mut url = String::new();
    BufReader::new(server.0.stdout.take().unwrap()).read_line(&mut url).unwrap();
    let address = url.trim().to_owned();
    assert!(address.starts_with("ws://127.0.0.1:"), "{address}");
    let client = std::thread::spawn(move || check(&python, &["stream", &address, "6"]));
    ears.listen(|| client.is_finished());
    ears.listen_for(Duration::from_millis(100));
    let found = client.join().unwrap();
    drop(vehicle);
    server.signal(Signal::TERM);
    assert!(server.0.wait().unwrap().success());
    service.stop();

    assert_eq!(found["subprotocol"], "foxglove.sdk.v1");
    assert!(found["server"]["name"].as_str().unwrap().contains("vehicle"), "{}", found["server"]);
    // Nothing can be written through it.
    assert_eq!(found["server"]["capabilities"], json!([]), "{}", found["server"]);
    let topics = &found["topics"];
    let heard = &ears.heard;
    let by_sequence = heard.measurements.iter().map(|sample| (sample.sequence, *sample)).collect();
    assert_heard(messages(topics, "/vehicle/measurement"), &by_sequence, measurement);
    let by_sequence = heard.truths.iter().map(|truth| (truth.sequence, *truth)).collect();
    assert_heard(messages(topics, "/vehicle/truth"), &by_sequence, truth);
    assert_heard(messages(topics, "/vehicle/estimate"), &heard.estimates, estimate);
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
    let run = |arguments: &[&str]| finished(monitor(&domain, arguments).output().unwrap());
    let (code, _, log) = run(&["record", path]);
    assert_eq!((code, log.contains("--force")), (Some(1), true), "{log}");
    assert_eq!(std::fs::read(&file).unwrap(), b"precious");
    for wrong in [
        &["record"][..],
        &["record", path, "--duration-s", "0"],
        &["record", path, "--force", "--instance", "a/b"],
        &["serve", "--listen", "everywhere"],
        &["--fps", "1", "record", path],
    ] {
        assert_eq!(run(wrong).0, Some(2), "{wrong:?}");
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"precious");

    let service = Role::start(&domain, "daemon run --preset rigid-body");
    wait_until("the service", || domain.status().ticks > 0);
    // A full disk ends the recording, with the system's reason.
    let (code, _, log) = run(&["record", "/dev/full", "--force"]);
    assert_eq!((code, log.contains("No space left on device")), (Some(1), true), "{log}");
    let (code, document, log) = run(&["record", path, "--force", "--duration-s", "0.7", "--json"]);
    let document: Value = serde_json::from_str(&document).unwrap();
    assert_eq!((code, document["not_written"].as_u64()), (Some(0), Some(0)), "{log}");
    assert_eq!(document["bytes"], file.metadata().unwrap().len());
    // No vehicle, no samples: said, and no flight.
    let error = read_flight(&Mcap, &file, &ImportOptions::default()).unwrap_err().to_string();
    assert!(error.contains("no measurements") && error.contains("/vehicle/estimate"), "{error}");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let (code, _, log) = run(&["serve", "--listen", &taken.local_addr().unwrap().to_string()]);
    assert_eq!((code, log.contains("cannot listen on 127.0.0.1:")), (Some(1), true), "{log}");
    service.stop();
    domain.assert_clean();
}
