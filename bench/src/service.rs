//! `bench service`: the time from a sample's stamp until a polling reader has the estimate that contains it.
//!
//! This process is vehicle and reader, on a core of its own; the service is a process on another core. The rate of the
//! samples differs from that of the service by one period over the whole run. With a timer, each phase between tick and
//! sample therefore occurs equally often.

use crate::harness::exchange::{Seen, drive_service};
use crate::harness::latency::{HEADER, cells, summary};
use crate::harness::machine::Machine;
use crate::harness::options::{parse_rate_hz, parse_seconds};
use crate::harness::output::{progress_bar, say_if_stopped, show, table, warn_of_debug_build};
use crate::harness::processes::ServiceSettings;
use crate::plot::{self, Figure, Line, LineStyle, Panel};
use clap::ValueEnum;
use command_line::stop_flag;
use daemon::config::PRESETS;
use serde::Serialize;
use shared_types::{LatencySummary, outln};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// When the service looks for samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum TriggerMode {
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
    fn settings(self, preset: &str, rate_hz: f64, spin_us: f64) -> ServiceSettings<'_> {
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
pub(crate) struct ServiceArguments {
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
    /// Draw the share of later estimates to FILE.svg.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// Runs `bench service`.
pub(crate) fn run(arguments: &ServiceArguments) -> anyhow::Result<()> {
    if let Some(file) = &arguments.plot {
        plot::check_target(file)?;
    }
    warn_of_debug_build();
    let seconds = if arguments.quick { 0.5 } else { arguments.seconds };
    let stop = stop_flag()?;
    let machine = Machine::found();
    let core = machine.other_core()?;
    let n_runs = arguments.triggers.len() * arguments.rates_hz.len();
    let progress = progress_bar(n_runs as u64, "{msg:20} {bar:40} {elapsed} of about {duration}");
    progress.enable_steady_tick(Duration::from_millis(500));
    let mut rows = Vec::new();
    for &rate_hz in &arguments.rates_hz {
        for &trigger in &arguments.triggers {
            progress.set_message(format!("{} {rate_hz} Hz", trigger.name()));
            let settings = trigger.settings(&arguments.preset, rate_hz, arguments.spin_us);
            let seen = drive_service(&settings, core, 1, seconds, &stop)?;
            rows.push(Row::of(trigger, rate_hz, seen));
            progress.inc(1);
        }
    }
    progress.finish_and_clear();
    say_if_stopped(&stop);

    let report = Report { machine: &machine, other_core: core, preset: &arguments.preset, rows: &rows };
    show(arguments.json, &report, || report.print())?;
    if let Some(file) = &arguments.plot {
        draw(file, &rows)?;
        if !arguments.json {
            outln!("plot: {}", file.display());
        }
    }
    Ok(())
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
    #[serde(skip)]
    sorted_ns: Vec<u64>,
}

impl Row {
    fn of(trigger: TriggerMode, rate_hz: f64, seen: Seen) -> Self {
        let Seen { mut source_to_estimate_ns, unanswered, skipped, .. } = seen;
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
    }
}

/// The share of estimates that arrived later than x, one panel per rate.
fn draw(file: &Path, rows: &[Row]) -> anyhow::Result<()> {
    const MAX_POINTS: usize = 2000;
    let mut rates_hz: Vec<f64> = rows.iter().map(|row| row.rate_hz).collect();
    rates_hz.sort_by(f64::total_cmp);
    rates_hz.dedup();
    let line = |row: &Row| {
        let sorted = &row.sorted_ns;
        let later = |i: usize| (sorted[i] as f64 * 1e-3, (sorted.len() - i) as f64 / sorted.len() as f64);
        // Dense in the tail, where single samples show.
        let every =
            |i: &usize| i.is_multiple_of(sorted.len().div_ceil(MAX_POINTS)) || i + 200 >= sorted.len();
        let points = (0..sorted.len()).filter(every).map(later).collect();
        Line::new(row.trigger.name(), LineStyle::Estimate, points)
    };
    let panel = |&rate_hz: &f64| {
        let lines = rows.iter().filter(|row| row.rate_hz == rate_hz).map(line).collect();
        Panel { log_y: true, ..Panel::new(&format!("share later, {rate_hz} Hz"), lines) }
    };
    let panels = rates_hz.iter().map(panel).collect();
    Figure { log_x: true, ..Figure::new("Sample's stamp to its estimate", "latency (µs)", panels) }
        .write(file)
}
