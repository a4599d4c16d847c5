//! `bench soak`: runs the service for a long time beside processes that load all cores. The command fails if a sample is
//! neither used nor counted, if an estimate is not finite, or if memory grows.

use crate::harness::latency::latency_table;
use crate::harness::options::{parse_rate_hz, parse_seconds};
use crate::harness::output::show;
use crate::harness::processes::{Child, OwnDomain, PATIENCE};
use anyhow::{Context, ensure};
use clap::builder::RangedU64ValueParser;
use command_line::stop_flag;
use serde::Serialize;
use shared_types::payload::{Status, command};
use shared_types::{Client, LatencySummary, outln};
use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const RIGID_BODY: &str = "rigid-body";
/// Memory is read this often (s).
const LOOK_EVERY_S: f64 = 1.0;
/// The first part of the run is for whatever is set up lazily.
const SETTLING_PART: f64 = 0.2;
/// A shorter run is mostly lazy set-up: its memory is printed, not checked.
const MIN_S_FOR_MEMORY: f64 = 60.0;
/// Megabytes that each of the load's processes writes over and over.
const LOAD_MB: usize = 64;

/// A long run under load.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct SoakArguments {
    /// Length of the run.
    #[arg(long, value_name = "S", default_value_t = 600.0, value_parser = parse_seconds)]
    seconds: f64,
    /// Rate of samples and of ticks.
    #[arg(long, value_name = "HZ", default_value_t = 1000.0, value_parser = parse_rate_hz)]
    rate_hz: f64,
    /// Processes beside it that compute and write memory without a pause.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = RangedU64ValueParser::<u64>::new().range(0..=64))]
    load: u64,
    /// A further argument of `daemon run`; may be given several times.
    #[arg(long, value_name = "ARGUMENT", allow_hyphen_values = true)]
    service: Vec<String>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// The result of a run.
#[derive(Debug, Serialize)]
struct Report {
    rate_hz: f64,
    duration_s: f64,
    load_processes: u64,
    samples_used: u64,
    samples_lost: u64,
    samples_rejected: u64,
    /// Sent, and neither used nor counted.
    samples_unaccounted: i64,
    ticks: u64,
    deadline_misses: u64,
    most_late_ticks_in_a_row: u64,
    ticks_recorded: u64,
    ticks_not_recorded: u64,
    wake_up_lateness_ns: LatencySummary,
    step_ns: LatencySummary,
    #[serde(flatten)]
    seen: Seen,
}

/// Runs `bench soak`.
pub(crate) fn run(arguments: &SoakArguments) -> anyhow::Result<()> {
    let stop = stop_flag()?;
    let domain = OwnDomain::new()?;
    let files = tempfile::tempdir().context("make a directory for the flight record")?;
    let record = files.path().join("flight.rec");
    let record = record.to_str().context("the temporary directory's path is no text")?;
    let (rate_hz, seconds) = (arguments.rate_hz.to_string(), arguments.seconds.to_string());
    let mut service =
        vec!["daemon", "run", "--preset", RIGID_BODY, "--rate-hz", &rate_hz, "--record", record];
    service.extend(arguments.service.iter().map(String::as_str));
    let daemon = Child::start(&domain, &service)?;
    let client = daemon.connect(&domain, "vehicle")?;
    let load: Vec<Child> =
        (0..arguments.load).map(|_| Child::start(&domain, &["burn"])).collect::<anyhow::Result<_>>()?;
    let vehicle = [
        "sim_publisher",
        "run",
        "--scenario",
        RIGID_BODY,
        "--rate-hz",
        &rate_hz,
        "--duration",
        &seconds,
        "--json",
    ];
    let seen = look_on(&client, Child::start(&domain, &vehicle)?, &daemon, arguments.seconds, &stop)?;
    drop((load, client));
    daemon.stop()?;

    let status = seen.status;
    let accounted = status.counters.samples_accepted
        + status.counters.samples_lost
        + status.counters.samples_rejected_total();
    // A sample that was lost after the newest one that arrived is not counted as lost by the service.
    let report = Report {
        rate_hz: arguments.rate_hz,
        duration_s: arguments.seconds,
        load_processes: arguments.load,
        samples_used: status.counters.samples_accepted,
        samples_lost: status.counters.samples_lost,
        samples_rejected: status.counters.samples_rejected_total(),
        samples_unaccounted: seen.samples_sent as i64 - accounted as i64,
        ticks: status.counters.ticks,
        deadline_misses: status.counters.deadline_misses,
        most_late_ticks_in_a_row: status.most_late_ticks_in_a_row,
        ticks_recorded: status.ticks_recorded,
        ticks_not_recorded: status.counters.ticks_not_recorded,
        wake_up_lateness_ns: status.wake_up_lateness_ns,
        step_ns: status.step_ns,
        seen,
    };
    show(arguments.json, &report, || print(&report))?;
    ensure!(
        report.samples_unaccounted == 0,
        "{} samples are neither used nor counted",
        report.samples_unaccounted
    );
    ensure!(
        report.seen.estimates_not_finite == 0,
        "{} estimates are not finite",
        report.seen.estimates_not_finite
    );
    // Less is the allocator's; a leak of one byte a tick would be more.
    let grown_kb = report.seen.resident_kb_end.saturating_sub(report.seen.resident_kb_settled);
    let is_judged = arguments.seconds >= MIN_S_FOR_MEMORY;
    ensure!(grown_kb < 256 || !is_judged, "the service's memory has grown by {grown_kb} kB");
    Ok(())
}

/// What was seen while the vehicle ran.
#[derive(Debug, Serialize)]
struct Seen {
    samples_sent: u64,
    #[serde(skip)]
    status: Status,
    estimates_read: u64,
    estimates_overrun: u64,
    estimates_not_finite: u64,
    resident_kb_settled: u64,
    resident_kb_end: u64,
}

fn look_on(
    client: &Client,
    mut vehicle: Child,
    service: &Child,
    seconds: f64,
    stop: &AtomicBool,
) -> anyhow::Result<Seen> {
    let mut estimates = client.estimate_subscriber()?;
    let (mut read, mut overrun, mut not_finite) = (0, 0, 0);
    let mut next_sequence = None;
    let start = Instant::now();
    let (mut settled_kb, mut end_kb, mut last_look) = (None, 0, Instant::now());
    while !vehicle.has_ended()? {
        while let Some(estimate) = estimates.take()? {
            read += 1;
            not_finite += u64::from(!estimate.is_finite());
            overrun += next_sequence.map_or(0, |next| estimate.sequence - next);
            next_sequence = Some(estimate.sequence + 1);
        }
        if last_look.elapsed().as_secs_f64() >= LOOK_EVERY_S {
            last_look = Instant::now();
            end_kb = service.private_kb()?;
            if settled_kb.is_none() || start.elapsed().as_secs_f64() < SETTLING_PART * seconds {
                settled_kb = Some(end_kb);
            }
        }
        if stop.load(Ordering::Relaxed) {
            vehicle.terminate();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    // The last sample is used and counted, and the status published.
    std::thread::sleep(Duration::from_millis(500));
    Ok(Seen {
        samples_sent: vehicle.finish_with_summary()?.1,
        status: client.command(command::STATUS, PATIENCE)?.status,
        estimates_read: read,
        estimates_overrun: overrun,
        estimates_not_finite: not_finite,
        resident_kb_settled: settled_kb.unwrap_or(end_kb),
        resident_kb_end: end_kb,
    })
}

fn print(report: &Report) {
    let accounted = format!(
        "{} sent: {} used, {} lost, {} rejected; {} unaccounted for",
        report.seen.samples_sent,
        report.samples_used,
        report.samples_lost,
        report.samples_rejected,
        report.samples_unaccounted
    );
    outln!(
        "{} s at {} Hz beside {} processes of load",
        report.duration_s,
        report.rate_hz,
        report.load_processes
    );
    outln!("samples    {accounted}");
    outln!(
        "ticks      {}, {} deadlines missed, at most {} late in a row",
        report.ticks,
        report.deadline_misses,
        report.most_late_ticks_in_a_row
    );
    outln!("record     {} ticks, {} not recorded", report.ticks_recorded, report.ticks_not_recorded);
    outln!(
        "estimates  {} read, {} too fast for this reader, {} not finite",
        report.seen.estimates_read,
        report.seen.estimates_overrun,
        report.seen.estimates_not_finite
    );
    outln!(
        "memory     {} kB after the first fifth, {} kB at the end",
        report.seen.resident_kb_settled,
        report.seen.resident_kb_end
    );
    let rows = [("wake-up lateness", report.wake_up_lateness_ns), ("step", report.step_ns)];
    outln!("{}", latency_table("latency (µs)", rows));
}

/// The role `burn`: computes and writes memory until it is terminated.
pub(crate) fn burn() -> anyhow::Result<()> {
    let stop = stop_flag()?;
    let mut memory = vec![0_u64; LOAD_MB << 17];
    let mut x = 1_u64;
    while !stop.load(Ordering::Relaxed) {
        for word in &mut memory {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(*word | 1);
            *word = x;
        }
        black_box(&memory);
    }
    Ok(())
}
