//! The recipe of docs/across-machines.md: two domains on one machine, each with a tunnel of iceoryx2's link, zenoh between
//! them over loopback, and a monitor in the second domain that follows the vehicle in the first.
//!
//! The test prints what the link costs and asserts no times. `OBSERVER_TUNNEL` names a tunnel that is already built,
//! `OBSERVER_WAKE` its way to wake up (`--poll 1`, `--reactive`), `OBSERVER_SECONDS` the duration of the measurement.

use crate::programs::{MONITOR, service, vehicle};
use iceoryx2::prelude::*;
use shared_types::client::Stream;
use shared_types::clock::monotonic_ns;
use shared_types::payload::command;
use shared_types::{Client, ClientError, Estimate};
use std::collections::HashMap;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use testkit::{PATIENCE, Process, TestDomain, wait_until};

const ADDRESS: &str = "192.0.2.1:7447";
/// The sequence of estimates that the ground station forges.
const FORGED: u64 = u64::MAX / 3;

/// The tunnel, built where it is missing: some minutes, once.
fn tunnel_program() -> PathBuf {
    if let Some(program) = std::env::var_os("OBSERVER_TUNNEL") {
        return program.into();
    }
    let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("link");
    let program = root.join("bin/iox2-link-tunnel-zenoh");
    if !program.exists() {
        let build = root.join("build");
        let mut install = Command::new(env!("CARGO"));
        install.args([
            "install",
            "iceoryx2-integrations-zenoh-link-tunnel-cli",
            "--version",
            "0.10.0",
            "--locked",
        ]);
        install.arg("--root").arg(&root).env("CARGO_TARGET_DIR", &build);
        assert!(install.status().unwrap().success(), "{install:?}");
        std::fs::remove_dir_all(build).unwrap();
    }
    program
}

/// Starts the tunnel of one domain as the recipe does, in a directory with the domain's iceoryx2 configuration.
fn tunnel(domain: &TestDomain, directory: &Path, zenoh: &str) -> Process {
    std::fs::create_dir_all(directory.join("config")).unwrap();
    drop(domain.domain.lock_for_making().unwrap());
    let iceoryx2 = toml::to_string(&shared_types::service::config_for_others(&domain.domain)).unwrap();
    std::fs::write(directory.join("config/iceoryx2.toml"), iceoryx2).unwrap();
    std::fs::write(directory.join("zenoh.json5"), zenoh).unwrap();
    let wake = std::env::var("OBSERVER_WAKE").unwrap_or("--poll 1".into());
    let mut command = Command::new(tunnel_program());
    command.args(["--zenoh-config", "zenoh.json5"]).args(wake.split(' ')).current_dir(directory);
    for topic in ["estimate", "status", "truth"] {
        command.args(["--allow", &format!("vehicle/{topic}")]);
    }
    let log = || std::fs::File::options().create(true).append(true).open(directory.join("log")).unwrap();
    Process { child: command.stdin(Stdio::null()).stdout(log()).stderr(log()).spawn().unwrap() }
}

/// Seconds of processor time of a process.
fn cpu_s(process: &Process) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.pid())).unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    let ticks: f64 = fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap();
    // USER_HZ, the same on every Linux.
    ticks / 100.0
}

fn resident_kb(process: &Process) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", process.pid())).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

/// Bytes that went over the loopback, everyone's.
fn loopback_bytes() -> u64 {
    let devices = std::fs::read_to_string("/proc/net/dev").unwrap();
    let line = devices.lines().find(|line| line.trim_start().starts_with("lo:")).unwrap();
    line.split(':').nth(1).unwrap().split_whitespace().next().unwrap().parse().unwrap()
}

fn text(estimate: &Estimate) -> String {
    serde_json::to_string(estimate).unwrap()
}

/// All that the vehicle's own machine sees, as text, by sequence.
#[derive(Default)]
struct Sent(HashMap<u64, String>);

impl Sent {
    fn note(&mut self, estimates: &mut Stream<Estimate>) {
        while let Some(estimate) = estimates.take().unwrap() {
            self.0.insert(estimate.sequence, text(&estimate));
        }
    }
}

/// Publishes an estimate in this domain as any process of the ground station can.
fn forge(domain: &TestDomain) {
    let node = NodeBuilder::new()
        .config(&shared_types::service::config_for_others(&domain.domain))
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .unwrap();
    let name = ServiceName::new("vehicle/estimate").unwrap();
    let topic = node.service_builder(&name).publish_subscribe::<Estimate>().open().unwrap();
    let publisher = topic.publisher_builder().create().unwrap();
    for _ in 0..20 {
        let forged = Estimate { sequence: FORGED, publish_stamp_ns: 1, ..Estimate::default() };
        publisher.send_copy(forged).unwrap();
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
#[ignore = "builds the link first, some minutes; run: cargo test -p monitor across_domains -- --ignored --nocapture"]
fn a_monitor_in_another_domain_follows_the_vehicle_over_zenoh() {
    let [vehicle_zenoh, ground_zenoh] = ["vehicle", "ground"].map(|side| {
        let file = format!("{}/../../docs/across-machines/{side}.json5", env!("CARGO_MANIFEST_DIR"));
        std::fs::read_to_string(file).unwrap()
    });
    let free_port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let vehicle_zenoh = vehicle_zenoh.replace(ADDRESS, &free_port.to_string());
    let ground_zenoh = ground_zenoh.replace(ADDRESS, &free_port.to_string());
    let directory = tempfile::tempdir().unwrap();
    let [vehicle_directory, ground_directory] = ["vehicle", "ground"].map(|side| directory.path().join(side));
    let logs = || {
        [&vehicle_directory, &ground_directory]
            .map(|directory| std::fs::read_to_string(directory.join("log")).unwrap_or_default())
            .join("\n--- ground ---\n")
    };

    let (air, ground) = (TestDomain::new(), TestDomain::new());
    let daemon = service(&air, "--preset rigid-body");
    let simulator = vehicle(&air, "");
    let ground_tunnel = tunnel(&ground, &ground_directory, &ground_zenoh);
    let vehicle_tunnel = tunnel(&air, &vehicle_directory, &vehicle_zenoh);

    let near = Client::connect(&air.domain, "vehicle", PATIENCE).unwrap();
    let mut near_estimates = near.estimate_subscriber().unwrap();
    let mut sent = Sent::default();
    let far = Client::connect(&ground.domain, "vehicle", PATIENCE);
    let far = far.unwrap_or_else(|error| panic!("{error}\n{}", logs()));
    let mut far_estimates = far.estimate_subscriber().unwrap();
    let mut far_statuses = far.status_subscriber().unwrap();
    wait_until("an estimate on the ground", || {
        sent.note(&mut near_estimates);
        far_estimates.take().unwrap().is_some()
    });

    // The same process on both sides, so one clock: latency from publication to being taken on the ground.
    let seconds: f64 = std::env::var("OBSERVER_SECONDS").map_or(3.0, |text| text.parse().unwrap());
    let tunnels = [&vehicle_tunnel, &ground_tunnel];
    let (cpu_before, bytes_before, since) = (tunnels.map(cpu_s), loopback_bytes(), Instant::now());
    let (mut latencies_us, mut sequences, mut n_statuses) = (Vec::new(), Vec::new(), 0);
    while since.elapsed().as_secs_f64() < seconds {
        while let Some(estimate) = far_estimates.take().unwrap() {
            latencies_us.push((monotonic_ns() - estimate.publish_stamp_ns) as f64 / 1e3);
            sequences.push(estimate.sequence);
            sent.note(&mut near_estimates);
            // It may be here before it is there: both are read by this one thread.
            if let Some(near) = sent.0.get(&estimate.sequence) {
                assert_eq!(*near, text(&estimate));
            }
        }
        n_statuses += u32::from(far_statuses.take().unwrap().is_some());
        std::thread::sleep(Duration::from_micros(50));
    }
    let elapsed_s = since.elapsed().as_secs_f64();
    let (cpu_after, bytes_after) = (tunnels.map(cpu_s), loopback_bytes());
    assert!(sequences.is_sorted_by(|a, b| a < b), "in order, each once");
    let expected = sequences.last().unwrap() - sequences[0] + 1;
    latencies_us.sort_by(f64::total_cmp);
    let quantile = |q: f64| latencies_us[((latencies_us.len() - 1) as f64 * q) as usize];
    println!(
        "estimates: {} of {expected} in {elapsed_s:.1} s; statuses: {n_statuses}\n\
         publication to reader (us): p50 {:.0}, p99 {:.0}, max {:.0}\n\
         loopback: {:.0} kB/s\n\
         tunnels, vehicle's and ground's: {:.1} and {:.1} % of a core, {} and {} kB resident",
        latencies_us.len(),
        quantile(0.5),
        quantile(0.99),
        quantile(1.0),
        (bytes_after - bytes_before) as f64 / elapsed_s / 1e3,
        100.0 * (cpu_after[0] - cpu_before[0]) / elapsed_s,
        100.0 * (cpu_after[1] - cpu_before[1]) / elapsed_s,
        resident_kb(&vehicle_tunnel),
        resident_kb(&ground_tunnel),
    );
    assert!(n_statuses > 0);

    // The monitor, as an operator starts it.
    let (lines, status) = watch(&ground, &mut sent, &mut near_estimates);
    assert!(status.success(), "{}", logs());
    assert_eq!(lines.len(), 200);
    let compared = lines.iter().filter(|line| sent.has(line)).count();
    println!("monitor: {compared} of {} lines are what the vehicle's side saw, to the bit", lines.len());
    assert_eq!(compared, lines.len());

    // Nothing is accepted from the ground: no command, and no forged estimate.
    let refused = far.command(command::RESET, Duration::from_millis(500));
    assert!(matches!(refused, Err(ClientError::NoDaemon { .. })), "{refused:?}");
    forge(&ground);
    sent.note(&mut near_estimates);
    assert!(!sent.0.contains_key(&FORGED), "a forged estimate has reached the vehicle");

    // A tunnel is killed and started again without its access control: estimates arrive again, and a forged one reaches
    // the vehicle. This shows that above the access control has stopped it.
    let killed = Instant::now();
    vehicle_tunnel.kill();
    while far_estimates.take().unwrap().is_some() {}
    let open_zenoh = vehicle_zenoh.replace("enabled: true", "enabled: false");
    let vehicle_tunnel = tunnel(&air, &vehicle_directory, &open_zenoh);
    wait_until("an estimate after the tunnel was killed", || far_estimates.take().unwrap().is_some());
    println!("tunnel killed and started again: {:.1} s without estimates", killed.elapsed().as_secs_f64());
    wait_until("a forged estimate", || {
        forge(&ground);
        sent.note(&mut near_estimates);
        sent.0.contains_key(&FORGED)
    });

    // The service is killed and started again.
    daemon.kill();
    let killed_ns = monotonic_ns();
    let daemon = service(&air, "--preset rigid-body");
    wait_until("an estimate of the new service", || {
        let estimate = far_estimates.take().unwrap();
        estimate.is_some_and(|estimate| estimate.publish_stamp_ns > killed_ns)
    });
    println!("service killed and started again: {:.1} s", (monotonic_ns() - killed_ns) as f64 / 1e9);

    // All processes end on request and leave no files behind.
    simulator.kill();
    daemon.stop().ok();
    drop((near_estimates, near, far_estimates, far_statuses, far));
    vehicle_tunnel.stop().ok();
    ground_tunnel.stop().ok();
    for domain in [&air, &ground] {
        domain.domain.remove_if_unused().unwrap();
        domain.assert_clean();
    }
}

/// 200 lines of `monitor --remote --json` in that domain, while the vehicle's side is noted.
fn watch(
    ground: &TestDomain,
    sent: &mut Sent,
    near_estimates: &mut Stream<Estimate>,
) -> (Vec<String>, std::process::ExitStatus) {
    let mut monitor = MONITOR.start(ground, &["--remote", "--json", "--count", "200"]);
    let output = BufReader::new(monitor.child.stdout.take().unwrap());
    let reader = std::thread::spawn(move || output.lines().map(Result::unwrap).collect());
    let since = Instant::now();
    let status = loop {
        assert!(since.elapsed() < PATIENCE, "the monitor does not end");
        sent.note(near_estimates);
        if let Some(status) = monitor.child.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    sent.note(near_estimates);
    (reader.join().unwrap(), status)
}

impl Sent {
    /// Whether a line of the monitor is an estimate of the vehicle's side: the shortest text of a number is that of its bits.
    fn has(&self, line: &str) -> bool {
        let sequence = serde_json::from_str::<serde_json::Value>(line).unwrap()["sequence"].as_u64().unwrap();
        self.0.get(&sequence).is_some_and(|estimate| line.ends_with(&estimate[1..]))
    }
}
