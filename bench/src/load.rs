//! `bench load`: the cost of further readers and further vehicles on one machine.
//!
//! | part | what increases | what is measured |
//! |---|---|---|
//! | readers | subscribers of one instance's estimates, each served at every tick | the tick, a sample's stamp to its estimate, shared memory |
//! | instances | vehicles in one domain, each a service and a publisher as two processes | the tick, processor time per tick, private and shared memory |

use crate::harness::exchange::drive_service;
use crate::harness::latency::{cells, summary};
use crate::harness::machine::Machine;
use crate::harness::options::parse_seconds;
use crate::harness::output::{
    microseconds, progress_bar, say_if_stopped, show, table, three_digits, warn_of_debug_build,
};
use crate::harness::processes::{Child, OwnDomain, PATIENCE, ServiceSettings};
use anyhow::ensure;
use clap::builder::RangedU64ValueParser;
use command_line::stop_flag;
use serde::Serialize;
use shared_types::payload::{Status, command};
use shared_types::service::MAX_READERS;
use shared_types::{Client, LatencySummary, outln};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Preset and scenario of every vehicle.
const RIGID_BODY: &str = "rigid-body";
const RATE_HZ: f64 = 200.0;
/// Places that the measurement itself takes among the readers: a client for status, one reader in reserve.
const OWN_READERS: u64 = 2;

/// Cost of further readers and further vehicles on one machine.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct LoadArguments {
    /// Readers of one service.
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', default_value = "1,4,16", value_parser = RangedU64ValueParser::<u64>::new().range(1..=MAX_READERS as u64 - OWN_READERS))]
    readers: Vec<u64>,
    /// Vehicles on this machine, each with a service and a publisher at 200 Hz.
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', default_value = "1,2,4,8", value_parser = RangedU64ValueParser::<u64>::new().range(1..=64))]
    instances: Vec<u64>,
    /// Length of the run for each number.
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = parse_seconds)]
    seconds: f64,
    /// A few seconds: 0.3 s for each number.
    #[arg(long, conflicts_with = "seconds")]
    quick: bool,
    /// Print one JSON document instead of the tables.
    #[arg(long)]
    json: bool,
}

/// Runs `bench load`.
pub(crate) fn run(arguments: &LoadArguments) -> anyhow::Result<()> {
    warn_of_debug_build();
    let seconds = if arguments.quick { 0.3 } else { arguments.seconds };
    let stop = stop_flag()?;
    let machine = Machine::found();
    let n_runs = arguments.readers.len() + arguments.instances.len();
    let progress = progress_bar(n_runs as u64, "{msg:14} {bar:40} {elapsed} of about {duration}");
    progress.enable_steady_tick(Duration::from_millis(500));
    let mut report = Report { machine: &machine, preset: RIGID_BODY, readers: vec![], instances: vec![] };
    for &n_readers in &arguments.readers {
        progress.set_message(format!("{n_readers} readers"));
        if !stop.load(Ordering::Relaxed) {
            report.readers.push(with_readers(n_readers, seconds, &machine, &stop)?);
        }
        progress.inc(1);
    }
    for &n_instances in &arguments.instances {
        progress.set_message(format!("{n_instances} vehicles"));
        if !stop.load(Ordering::Relaxed) {
            report.instances.push(with_instances(n_instances, seconds, &machine, &stop)?);
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    say_if_stopped(&stop);
    show(arguments.json, &report, || report.print())
}

fn settings(trigger: &str) -> ServiceSettings<'_> {
    ServiceSettings { preset: RIGID_BODY, trigger, rate_hz: RATE_HZ, spin_us: 0.0 }
}

fn status(client: &Client) -> anyhow::Result<Status> {
    Ok(client.command(command::STATUS, PATIENCE)?.status)
}

/// One polling service with this many readers.
fn with_readers(
    n_readers: u64,
    seconds: f64,
    machine: &Machine,
    stop: &AtomicBool,
) -> anyhow::Result<ReadersRow> {
    let core = machine.other_core()?;
    let mut seen = drive_service(&settings("sample"), core, n_readers, seconds, stop)?;
    Ok(ReadersRow {
        readers: n_readers,
        step_ns: seen.status.step_ns,
        source_to_estimate_ns: summary(&mut seen.source_to_estimate_ns),
        shm_bytes: seen.shm_bytes,
    })
}

/// This many vehicles at once, on all cores.
fn with_instances(
    n_instances: u64,
    seconds: f64,
    machine: &Machine,
    stop: &AtomicBool,
) -> anyhow::Result<InstancesRow> {
    let cores = machine.all_cores();
    let domain = OwnDomain::new()?;
    let mut vehicles = Vec::new();
    for i in 0..n_instances {
        let name = format!("v{i}");
        let service = Child::start_service(&domain, &name, &settings("timer"), &cores)?;
        let client = service.connect(&domain, &name)?;
        let rate_hz = RATE_HZ.to_string();
        let publisher =
            ["sim_publisher", "run", "--scenario", RIGID_BODY, "--rate-hz", &rate_hz, "--instance", &name];
        vehicles.push(Vehicle { client, publisher: Child::start_on(&domain, &publisher, &cores)?, service });
    }
    for vehicle in &vehicles {
        vehicle.wait_for_samples()?;
    }
    let used = || vehicles.iter().map(Vehicle::used).collect::<anyhow::Result<Vec<_>>>();
    let (before, started) = (used()?, Instant::now());
    while started.elapsed().as_secs_f64() < seconds && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(20));
    }
    let after = used()?;

    let sum = |of: fn(&Used) -> u64| after.iter().map(of).sum::<u64>();
    let rise = |of: fn(&Used) -> u64| sum(of) - before.iter().map(of).sum::<u64>();
    let slowest = |of: fn(&Status) -> LatencySummary| {
        after.iter().map(|used| of(&used.status)).max_by_key(|found| found.p50).unwrap_or_default()
    };
    let ticks = rise(|used| used.status.counters.ticks);
    let row = InstancesRow {
        instances: n_instances,
        ticks,
        deadline_misses: sum(|used| used.status.counters.deadline_misses),
        step_ns: slowest(|status| status.step_ns),
        wake_up_lateness_ns: slowest(|status| status.wake_up_lateness_ns),
        service_cpu_ns_per_tick: rise(|used| used.service_ns) / ticks.max(1),
        service_private_kb: sum(|used| used.private_kb) / n_instances,
        shm_bytes: domain.shm_bytes()?,
    };
    for Vehicle { client, publisher, service } in vehicles {
        drop(client);
        publisher.stop()?;
        service.stop()?;
    }
    Ok(row)
}

/// One vehicle: its service, its publisher, and our connection to it.
struct Vehicle {
    client: Client,
    publisher: Child,
    service: Child,
}

/// The resources that a vehicle's service has used since its start.
struct Used {
    status: Status,
    service_ns: u64,
    private_kb: u64,
}

impl Vehicle {
    fn wait_for_samples(&self) -> anyhow::Result<()> {
        let start = Instant::now();
        while status(&self.client)?.counters.samples_accepted == 0 {
            ensure!(start.elapsed() < PATIENCE, "no sample arrives; {}", self.publisher.log());
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    fn used(&self) -> anyhow::Result<Used> {
        Ok(Used {
            status: status(&self.client)?,
            service_ns: self.service.cpu_ns()?,
            private_kb: self.service.private_kb()?,
        })
    }
}

#[derive(Debug, Serialize)]
struct ReadersRow {
    readers: u64,
    /// Wake-up to publication, as the service counts it.
    step_ns: LatencySummary,
    /// As the first reader sees it.
    source_to_estimate_ns: Option<LatencySummary>,
    shm_bytes: u64,
}

#[derive(Debug, Serialize)]
struct InstancesRow {
    instances: u64,
    ticks: u64,
    deadline_misses: u64,
    /// Of the instance with the largest median.
    step_ns: LatencySummary,
    /// Deadline to wake-up, of the instance with the largest median.
    wake_up_lateness_ns: LatencySummary,
    service_cpu_ns_per_tick: u64,
    /// Mean over the instances.
    service_private_kb: u64,
    /// Of all instances together.
    shm_bytes: u64,
}

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    machine: &'a Machine,
    preset: &'a str,
    readers: Vec<ReadersRow>,
    instances: Vec<InstancesRow>,
}

impl Report<'_> {
    fn print(&self) {
        self.machine.print();
        let megabytes = |bytes: u64| three_digits(bytes as f64 * 1e-6);
        let median_and_p99 = |found: LatencySummary| [microseconds(found.p50), microseconds(found.p99)];
        outln!("\nreaders of one service that polls, preset {}, {RATE_HZ} Hz", self.preset);
        let row = |row: &ReadersRow| {
            let [_, seen_p50, _, seen_p99, ..] = cells(row.source_to_estimate_ns);
            let [step_p50, step_p99] = median_and_p99(row.step_ns);
            [row.readers.to_string(), step_p50, step_p99, seen_p50, seen_p99, megabytes(row.shm_bytes)]
        };
        let header =
            ["readers", "step p50 (µs)", "p99", "stamp to estimate p50 (µs)", "p99", "shared memory (MB)"];
        outln!("{}", table(&header, 0, self.readers.iter().map(row)));
        outln!("\nvehicles, each a service and a publisher, at {RATE_HZ} Hz with a timer");
        let row = |row: &InstancesRow| {
            let [step_p50, step_p99] = median_and_p99(row.step_ns);
            let [late_p50, late_p99] = median_and_p99(row.wake_up_lateness_ns);
            [
                row.instances.to_string(),
                step_p50,
                step_p99,
                late_p50,
                late_p99,
                format!("{}/{}", row.deadline_misses, row.ticks),
                microseconds(row.service_cpu_ns_per_tick),
                megabytes(1000 * row.service_private_kb),
                megabytes(row.shm_bytes),
            ]
        };
        let header = [
            "vehicles",
            "step p50 (µs)",
            "p99",
            "late by p50 (µs)",
            "p99",
            "missed/ticks",
            "CPU per tick (µs)",
            "private memory (MB)",
            "shared memory, all (MB)",
        ];
        outln!("{}", table(&header, 0, self.instances.iter().map(row)));
        outln!("Steps and lateness are those of the slowest instance; processor time and memory are means.");
    }
}
