//! `bench service`: from a sample's stamp to the estimate that holds it, in the hands of a reader that polls.
//!
//! This process is vehicle and reader, on a core of its own; the service is a process on another one. The
//! samples come at the service's rate but for one period over the whole run: where a timer decides when
//! the service looks, each distance between its tick and the sample is met as often as any other.

use crate::exchange::{MovingVehicle, ServiceExchange, connect, round_trip};
use crate::latency::{Bin, HEADER, bars, cells, histogram, summary, table};
use crate::machine::Machine;
use crate::plot::{self, Line, LineStyle, Panel};
use crate::processes::{Child, OwnDomain, ServiceSettings, stop_flag};
use anyhow::Context;
use clap::ValueEnum;
use daemon::config::PRESETS;
use daemon::deadline::wait_for_deadline;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use shared_types::clock::monotonic_ns;
use shared_types::{Client, LatencySummary, logln, outln};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(10);
/// The publisher of the samples polls the clock for this long before each.
const VEHICLE_SPIN_NS: u64 = 200_000;

/// When the service looks for samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TriggerMode {
    /// At each tick of its timer.
    Timer,
    /// The same, and the last microseconds of each wait are spent polling the clock.
    TimerSpin,
    /// All the time, polling.
    Sample,
}

impl TriggerMode {
    fn name(self) -> &'static str {
        match self {
            Self::Timer => "timer",
            Self::TimerSpin => "timer-spin",
            Self::Sample => "sample",
        }
    }

    /// The service's settings for this mode.
    pub(crate) fn settings(self, preset: &str, rate_hz: f64, spin_us: f64) -> ServiceSettings<'_> {
        let (trigger, spin_us) = match self {
            Self::Timer => ("timer", 0.0),
            Self::TimerSpin => ("timer", spin_us),
            Self::Sample => ("sample", 0.0),
        };
        ServiceSettings { preset, trigger, rate_hz, spin_us }
    }
}

/// Latency from a sample's stamp to its estimate, by trigger and rate.
#[derive(Debug, Clone, clap::Args)]
pub struct ServiceArguments {
    /// Rates of samples and ticks.
    #[arg(long, value_name = "HZ,HZ,…", value_delimiter = ',', default_value = "100,200,1000", value_parser = parse_rate_hz)]
    rates_hz: Vec<f64>,
    /// When the service looks for samples.
    #[arg(
        long,
        value_name = "MODE,MODE,…",
        value_delimiter = ',',
        value_enum,
        default_value = "timer,timer-spin,sample"
    )]
    triggers: Vec<TriggerMode>,
    /// Length of the run for each trigger and rate.
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = parse_seconds)]
    seconds: f64,
    /// How long trigger timer-spin polls the clock before each tick.
    #[arg(long, value_name = "US", default_value_t = 200.0)]
    spin_us: f64,
    /// Configuration of the service.
    #[arg(long, value_name = "NAME", default_value = PRESETS[0].0, value_parser = PRESETS.map(|(name, _)| name))]
    preset: String,
    /// A few seconds: half a second for each trigger and rate.
    #[arg(long, conflicts_with = "seconds")]
    quick: bool,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    json: bool,
    /// Draw the share of later estimates to FILE, .svg or .png.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// Rates that a timer of microseconds can keep.
pub(crate) fn parse_rate_hz(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(rate_hz) if (1.0..=20_000.0).contains(&rate_hz) => Ok(rate_hz),
        _ => Err("needed: a rate from 1 to 20000 (in Hz)".into()),
    }
}

pub(crate) fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(seconds) if (0.05..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("needed: a number of seconds from 0.05 to 86400".into()),
    }
}

/// Runs `bench service`.
///
/// # Errors
/// Fewer than two cores, a service that does not start, shared memory that cannot be used, a plot that
/// cannot be written.
pub fn run(arguments: &ServiceArguments) -> anyhow::Result<()> {
    if let Some(file) = &arguments.plot {
        plot::check_target(file)?;
    }
    if cfg!(debug_assertions) {
        logln!("warning: this is a debug build, its latencies mean nothing; use cargo run --release");
    }
    let seconds = if arguments.quick { 0.5 } else { arguments.seconds };
    let stop = stop_flag()?;
    let machine = Machine::found();
    let core = machine.other_core()?;
    let style = ProgressStyle::with_template("{msg:20} {bar:40} {elapsed} of about {duration}");
    let progress = ProgressBar::new((arguments.triggers.len() * arguments.rates_hz.len()) as u64)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    progress.enable_steady_tick(Duration::from_millis(500));
    let mut rows = Vec::new();
    for &rate_hz in &arguments.rates_hz {
        for &trigger in &arguments.triggers {
            progress.set_message(format!("{} {rate_hz} Hz", trigger.name()));
            let settings = trigger.settings(&arguments.preset, rate_hz, arguments.spin_us);
            let seen = one_service(&settings, seconds, core, &stop)?;
            rows.push(Row::of(trigger, rate_hz, seen));
            progress.inc(1);
        }
    }
    progress.finish_and_clear();
    if stop.load(Ordering::Relaxed) {
        logln!("bench: stopped; the figures are those of the part that ran");
    }

    let report = Report { machine: &machine, other_core: core, preset: &arguments.preset, rows: &rows };
    match arguments.json {
        true => outln!("{}", serde_json::to_string_pretty(&report)?),
        false => report.print(),
    }
    if let Some(file) = &arguments.plot {
        draw(file, &rows)?;
        if !arguments.json {
            outln!("plot: {}", file.display());
        }
    }
    Ok(())
}

/// What came back.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    /// Sample's stamp to the estimate's arrival (ns).
    pub(crate) source_to_estimate_ns: Vec<u64>,
    /// Samples whose estimate did not come within two periods.
    pub(crate) unanswered: u64,
    /// Samples that were due while the estimate before was still awaited, and not sent.
    pub(crate) skipped: u64,
}

/// Runs one service in a domain of its own.
fn one_service(
    settings: &ServiceSettings<'_>,
    seconds: f64,
    core: usize,
    stop: &AtomicBool,
) -> anyhow::Result<Seen> {
    let domain = OwnDomain::new()?;
    let service = Child::start_service(&domain, "vehicle", settings, &[core])?;
    let client = Client::connect(domain.domain(), "vehicle", PATIENCE)
        .or_else(|error| Err(error).with_context(|| service.log()))?;
    let mut exchange = ServiceExchange::of(&client)?;
    let mut vehicle = MovingVehicle::default();
    connect(&mut exchange, &mut vehicle).or_else(|error| Err(error).with_context(|| service.log()))?;
    let seen = send_at_rate(&mut exchange, &mut vehicle, settings.rate_hz, seconds, || {}, stop)?;
    drop((exchange, client));
    service.terminate();
    service.finish()?;
    Ok(seen)
}

/// Sends samples at a rate and polls for the estimate of each; `between` is done after each.
pub(crate) fn send_at_rate(
    exchange: &mut ServiceExchange,
    vehicle: &mut MovingVehicle,
    rate_hz: f64,
    seconds: f64,
    mut between: impl FnMut(),
    stop: &AtomicBool,
) -> anyhow::Result<Seen> {
    let n_samples = (seconds * rate_hz).ceil().max(1.0);
    let period_ns = 1e9 / rate_hz * (1.0 + 1.0 / n_samples);
    let start_ns = monotonic_ns() + period_ns as u64;
    let mut seen = Seen::default();
    for i in 0..n_samples as u64 {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let due_ns = start_ns + (i as f64 * period_ns) as u64;
        // An estimate that came after the next sample was due: that one is left out, and counted.
        if monotonic_ns() > due_ns {
            seen.skipped += 1;
            continue;
        }
        wait_for_deadline(due_ns, VEHICLE_SPIN_NS);
        match round_trip(exchange, vehicle, 2 * period_ns as u64)? {
            Some(trip) => seen.source_to_estimate_ns.push(trip.whole_ns),
            None => seen.unanswered += 1,
        }
        between();
    }
    Ok(seen)
}

/// One trigger at one rate.
#[derive(Debug, Serialize)]
struct Row {
    trigger: TriggerMode,
    rate_hz: f64,
    source_to_estimate_ns: Option<LatencySummary>,
    #[serde(skip_serializing_if = "Option::is_none")]
    source_to_estimate_ns_reason: Option<String>,
    unanswered: u64,
    skipped: u64,
    histogram: Vec<Bin>,
    #[serde(skip)]
    sorted_ns: Vec<u64>,
}

impl Row {
    fn of(trigger: TriggerMode, rate_hz: f64, seen: Seen) -> Self {
        let Seen { mut source_to_estimate_ns, unanswered, skipped } = seen;
        let found = summary(&mut source_to_estimate_ns);
        Self {
            trigger,
            rate_hz,
            source_to_estimate_ns: found,
            source_to_estimate_ns_reason: found
                .is_none()
                .then(|| "no estimate came within two periods of its sample, or the run was stopped".into()),
            unanswered,
            skipped,
            histogram: histogram(&source_to_estimate_ns),
            sorted_ns: source_to_estimate_ns,
        }
    }
}

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    machine: &'a Machine,
    other_core: usize,
    preset: &'a str,
    rows: &'a [Row],
}

impl Report<'_> {
    fn print(&self) {
        self.machine.print();
        outln!(
            "service with preset {} on core {}; sample's stamp to the estimate in the reader's hands, in µs",
            self.preset,
            self.other_core
        );
        let cells = |row: &Row| {
            let names = [row.trigger.name().to_owned(), row.rate_hz.to_string()];
            let unanswered = [row.unanswered.to_string(), row.skipped.to_string()];
            [names.as_slice(), &cells(row.source_to_estimate_ns), &unanswered].concat()
        };
        let header = [["trigger", "Hz"].as_slice(), &HEADER, &["unanswered", "skipped"]].concat();
        outln!("{}", table(&header, 1, self.rows.iter().map(cells)));
        for row in self.rows {
            outln!("{} at {} Hz:\n{}", row.trigger.name(), row.rate_hz, bars(&row.histogram));
        }
    }
}

/// The share of estimates that came later than x, a panel for each rate.
fn draw(file: &Path, rows: &[Row]) -> anyhow::Result<()> {
    const MOST_POINTS: usize = 2000;
    let mut rates_hz: Vec<f64> = rows.iter().map(|row| row.rate_hz).collect();
    rates_hz.sort_by(f64::total_cmp);
    rates_hz.dedup();
    let line = |row: &Row| {
        let sorted = &row.sorted_ns;
        let later = |i: usize| (sorted[i] as f64 * 1e-3, (sorted.len() - i) as f64 / sorted.len() as f64);
        // Dense in the tail, where single samples show.
        let every =
            |i: &usize| i.is_multiple_of(sorted.len().div_ceil(MOST_POINTS)) || i + 200 >= sorted.len();
        let points = (0..sorted.len()).filter(every).map(later).collect();
        Line { label: row.trigger.name().into(), points, style: LineStyle::Estimate }
    };
    let panel = |&rate_hz: &f64| Panel {
        y_label: format!("share later, {rate_hz} Hz"),
        lines: rows.iter().filter(|row| row.rate_hz == rate_hz).map(line).collect(),
        log_x: true,
        log_y: true,
    };
    let panels: Vec<Panel> = rates_hz.iter().map(panel).collect();
    plot::draw_to(file, "Sample's stamp to its estimate", "latency (µs)", &panels)
}
