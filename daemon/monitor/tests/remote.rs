//! `--remote`: a plain iceoryx2 node stands in for a service on another machine. It publishes in the monitor's domain as the
//! link does: with iceoryx2's default qualities (two samples wait, late readers get none), with stamps of another machine's
//! clock, and without a claim on the instance.

use crate::programs::MONITOR;
use iceoryx2::config::Config;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::*;
use monitor::link::{Link, Whence};
use monitor::model::{Model, Presence};
use monitor::view::screen::now;
use shared_types::clock::monotonic_ns;
use shared_types::payload::status_bits;
use shared_types::{Client, ClientError, Estimate, Status, Truth};
use std::fmt::Debug;
use std::io::{BufRead, BufReader};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use testkit::{PATIENCE, TestDomain};

const PERIOD: Duration = Duration::from_millis(5);
const S: u64 = 1_000_000_000;

/// What the link makes of a service that runs elsewhere.
struct Mirror {
    estimates: Publisher<ipc::Service, Estimate, ()>,
    statuses: Publisher<ipc::Service, Status, ()>,
    _truths: Publisher<ipc::Service, Truth, ()>,
    /// Of the other machine, minus ours.
    clock_ahead_ns: i64,
    sequence: u64,
    _node: Node<ipc::Service>,
}

impl Mirror {
    fn new(domain: &TestDomain) -> Self {
        // The root path is made first by one of ours, as `daemon iceoryx2-config` does.
        drop(domain.domain.lock_for_making().unwrap());
        let mut config = shared_types::service::config_for_others(&domain.domain);
        config.defaults = Config::default().defaults;
        set_log_level(LogLevel::Fatal);
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .unwrap();
        Self {
            estimates: publisher(&node, "vehicle/estimate"),
            statuses: publisher(&node, "vehicle/status"),
            _truths: publisher(&node, "vehicle/truth"),
            clock_ahead_ns: 0,
            sequence: 0,
            _node: node,
        }
    }

    /// One tick of the service; a status with every tenth.
    fn tick(&mut self) -> Estimate {
        let stamp_ns = monotonic_ns().wrapping_add_signed(self.clock_ahead_ns);
        self.sequence += 1;
        let mut estimate = Estimate {
            sequence: self.sequence,
            publish_stamp_ns: stamp_ns,
            status: status_bits::TRACKING,
            ..Estimate::default()
        };
        estimate.velocity_m_s = [0.1, -1.0 / 3.0, self.sequence as f64 * 1e-7];
        self.estimates.send_copy(estimate).unwrap();
        if self.sequence.is_multiple_of(10) {
            let status =
                Status { stamp_ns, start_stamp_ns: 1, rate_millihertz: 200_000, ..Status::default() };
            self.statuses.send_copy(status).unwrap();
        }
        std::thread::sleep(PERIOD);
        estimate
    }
}

fn publisher<Payload: ZeroCopySend + Debug + Copy>(
    node: &Node<ipc::Service>,
    name: &str,
) -> Publisher<ipc::Service, Payload, ()> {
    let name = ServiceName::new(name).unwrap();
    let topic = node.service_builder(&name).publish_subscribe::<Payload>().open_or_create().unwrap();
    topic.publisher_builder().create().unwrap()
}

/// Ahead of our clock, and behind it: a machine that runs for longer, and one that was started just now.
fn clocks() -> [i64; 2] {
    [1_000_000 * S as i64, 5 * S as i64 - monotonic_ns() as i64]
}

/// `monitor` with these arguments while the mirror ticks: what it prints, and what was sent.
fn watched(domain: &TestDomain, mirror: &mut Mirror, arguments: &[&str]) -> (String, Vec<Estimate>) {
    let monitor = MONITOR.start(domain, arguments);
    // Read from the start: 50 estimates are more than a pipe holds.
    let reader = std::thread::spawn(move || monitor.finish());
    let mut sent = Vec::new();
    while !reader.is_finished() {
        sent.push(mirror.tick());
    }
    (reader.join().unwrap().ok(), sent)
}

/// Ticks until the reading thread is done; what it read.
fn tick_while<T>(mirror: &mut Mirror, reader: JoinHandle<T>) -> T {
    let since = Instant::now();
    while !reader.is_finished() {
        assert!(since.elapsed() < PATIENCE, "the monitor does not say it");
        mirror.tick();
    }
    reader.join().unwrap()
}

#[test]
fn estimates_of_another_machines_clock_arrive_as_they_were_sent() {
    for clock_ahead_ns in clocks() {
        let domain = TestDomain::new();
        let mut mirror = Mirror::new(&domain);
        mirror.clock_ahead_ns = clock_ahead_ns;
        let (lines, sent) = watched(&domain, &mut mirror, &["--remote", "--json", "--count", "50"]);
        assert_eq!(lines.lines().count(), 50);
        let mut sent = sent.iter().map(|estimate| serde_json::to_string(estimate).unwrap());
        for line in lines.lines() {
            // In order, each once, and the shortest text of a number is that of its bits.
            assert!(sent.any(|estimate| line.ends_with(&estimate[1..])), "{line}");
        }
        drop(mirror);
    }
}

#[test]
fn the_age_is_that_of_the_estimate_and_not_of_the_clock() {
    for clock_ahead_ns in clocks() {
        let domain = TestDomain::new();
        let mut mirror = Mirror::new(&domain);
        mirror.clock_ahead_ns = clock_ahead_ns;
        let mut link = Link::new(domain.domain.clone(), "vehicle", Whence::AnotherMachine, monotonic_ns());
        let mut model = Model::new("vehicle");
        let since = Instant::now();
        while model.estimate.is_none_or(|estimate| estimate.sequence < 20) {
            assert!(since.elapsed() < PATIENCE, "no estimate comes");
            mirror.tick();
            link.look(monotonic_ns(), |news| model.note(news)).unwrap();
        }
        assert_eq!(model.presence, Presence::Here);
        // No more estimates arrive: the age of the newest one grows, and this is reported.
        let silent = Instant::now();
        std::thread::sleep(Duration::from_millis(1500));
        link.look(monotonic_ns(), |news| model.note(news)).unwrap();
        assert!(matches!(model.presence, Presence::Away { .. }), "{:?}", model.presence);
        let age_ns = model.estimate_age_ns(now(&model).monotonic_ns).unwrap();
        let bounds_ns = 1500 * S / 1000..=(silent.elapsed() + PATIENCE).as_nanos() as u64;
        assert!(bounds_ns.contains(&age_ns), "{age_ns}");
    }
}

#[test]
fn one_status_and_estimate_as_text() {
    let domain = TestDomain::new();
    let mut mirror = Mirror::new(&domain);
    mirror.clock_ahead_ns = clocks()[0];
    let (text, sent) = watched(&domain, &mut mirror, &["--remote", "--once"]);
    assert!(text.contains("estimate ") && text.contains("LATENCY") && !sent.is_empty(), "{text}");
}

#[test]
fn a_reboot_of_the_other_machine_is_followed() {
    let domain = TestDomain::new();
    let mut mirror = Mirror::new(&domain);
    let [ahead_ns, started_now_ns] = clocks();
    mirror.clock_ahead_ns = ahead_ns;
    let mut monitor = MONITOR.start(&domain, &["--remote", "--json"]);
    let mut lines = BufReader::new(monitor.child.stdout.take().unwrap()).lines();
    let first = std::thread::spawn(move || (lines.next().unwrap().unwrap(), lines));
    let (_, lines) = tick_while(&mut mirror, first);
    // The sequence continues: an estimate with a greater number was sent after the reboot.
    mirror.clock_ahead_ns = started_now_ns;
    let rebooted_with = mirror.sequence;
    let mut sequences = lines.map(|line| {
        serde_json::from_str::<serde_json::Value>(&line.unwrap()).unwrap()["sequence"].as_u64().unwrap()
    });
    let after = std::thread::spawn(move || sequences.any(|sequence| sequence > rebooted_with + 20));
    assert!(tick_while(&mut mirror, after));
}

#[test]
fn without_remote_foreign_stamps_are_refused_with_what_to_do() {
    for clock_ahead_ns in clocks() {
        let domain = TestDomain::new();
        let mut mirror = Mirror::new(&domain);
        mirror.clock_ahead_ns = clock_ahead_ns;
        let mut monitor = MONITOR.start(&domain, &["--json"]);
        let log = BufReader::new(monitor.child.stderr.take().unwrap()).lines();
        let told =
            std::thread::spawn(move || log.map(Result::unwrap).any(|line| line.contains("monitor --remote")));
        assert!(tick_while(&mut mirror, told));
        // None of them was taken.
        assert_eq!(monitor.stop().out, "");
    }
}

#[test]
fn a_client_reads_what_a_mirror_has_and_no_command_crosses() {
    let domain = TestDomain::new();
    let mut mirror = Mirror::new(&domain);
    let client = Client::connect(&domain.domain, "vehicle", Duration::ZERO).unwrap();
    let (mut every, mut newest) = (client.estimate_subscriber().unwrap(), client.latest_estimate().unwrap());
    let mut statuses = client.status_subscriber().unwrap();
    // The first one lets the readers connect.
    mirror.tick();
    while every.take().unwrap().is_some() {}
    let sent: Vec<_> = (0..20).map(|_| mirror.tick().sequence).collect();
    // Two wait for a slow reader, and those are the newest ones.
    let taken = [every.take().unwrap().unwrap().sequence, every.take().unwrap().unwrap().sequence];
    assert_eq!(taken[..], sent[sent.len() - 2..]);
    assert!(every.take().unwrap().is_none());
    assert_eq!(newest.peek().unwrap().unwrap().sequence, taken[1]);
    assert!(statuses.take().unwrap().is_some());
    let refused = client.command(shared_types::payload::command::RESET, Duration::ZERO);
    assert!(matches!(refused, Err(ClientError::NoDaemon { .. })), "{refused:?}");
}
