//! `daemon doctor`: prints what this machine grants, as text or JSON.

use super::arguments::PlaceArguments;
use crate::assemble;
use crate::config::{ConfigFile, PRESETS};
use crate::log::say;
use crate::system::doctor::{self, Plan, Report, Verdict};
use clap::Args;
use comfy_table::{CellAlignment, Table, presets::NOTHING};
use shared_types::outln;
use std::path::PathBuf;

/// What is measured where no configuration says otherwise.
const RATE_HZ: f64 = 1000.0;
const PRIORITY: u8 = 80;
const SPIN_US: f64 = 200.0;

/// What this machine grants, measured.
#[derive(Debug, Args)]
pub(super) struct DoctorArguments {
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Take rate, priority, cores and spin from this configuration (TOML), and try out its real-time settings.
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Likewise from a built-in configuration.
    #[arg(long, value_name = "NAME", value_parser = PRESETS.map(|(name, _)| name))]
    preset: Option<String>,
    /// Length of the measurement for each of the settings.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = seconds)]
    seconds: f64,
    /// Priority of SCHED_FIFO, instead of the configuration's [default: 80].
    #[arg(long, value_name = "1…98", value_parser = clap::value_parser!(u8).range(1..=98))]
    priority: Option<u8>,
    #[command(flatten)]
    place: PlaceArguments,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.01..=3600.0).contains(&seconds) => Ok(seconds),
        _ => Err("needed: 0.01 … 3600 (in s)".into()),
    }
}

/// Runs `daemon doctor`.
pub(super) fn run(arguments: &DoctorArguments) -> anyhow::Result<()> {
    let file = match (&arguments.config, &arguments.preset) {
        (Some(path), _) => Some(ConfigFile::read(path)?),
        (None, Some(name)) => Some(ConfigFile::preset(name)?),
        (None, None) => None,
    };
    if let Some(file) = &file {
        assemble::check(file)?;
    }
    let domain = arguments.place.domain()?;
    let config = file.as_ref().map(|file| &file.config);
    let asked = config.map(|config| config.real_time.clone()).unwrap_or_default();
    let plan = Plan {
        rate_hz: config.map_or(RATE_HZ, |config| config.rate_hz),
        spin_us: match config {
            Some(config) if config.spin_us > 0.0 => config.spin_us,
            Some(config) => SPIN_US.min(0.5e6 / config.rate_hz),
            None => SPIN_US,
        },
        seconds: arguments.seconds,
        priority: arguments.priority.or(asked.priority).unwrap_or(PRIORITY),
        cores: asked.cores.clone(),
    };
    if cfg!(debug_assertions) {
        say!("warning: this is a debug build, its latencies mean little; use cargo build --release");
    }
    if !arguments.json {
        say!("measuring for about {:.0} s …", doctor::seconds(&plan).ceil());
    }
    let report = doctor::report(&plan, &domain, &arguments.place.instance, file.as_ref());
    match arguments.json {
        true => outln!("{}", serde_json::to_string_pretty(&report)?),
        false => print(&report),
    }
    Ok(())
}

fn print(report: &Report) {
    outln!("{}; {} build\n", report.cpu, report.profile);
    let mut table = Table::new();
    table.load_style(NOTHING);
    let header = format!("late by (µs), {} Hz", report.rate_hz);
    table.set_header([header.as_str(), "count", "p50", "p99", "max"]);
    for row in &report.lateness {
        let cells = match &row.lateness_ns {
            Some(found) => {
                let us = |ns: u64| format!("{:.1}", ns as f64 / 1e3);
                [found.count.to_string(), us(found.p50), us(found.p99), us(found.max)]
            }
            None => ["not granted", "–", "–", "–"].map(String::from),
        };
        table.add_row([&[row.mode.words(report.spin_us, report.priority)], &cells[..]].concat());
    }
    for column in 1..5 {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    outln!("{table}\n");
    for fact in &report.facts {
        outln!("{:15}  {}: {}", fact.verdict.words(), fact.name, fact.found);
        if let Some(remedy) = &fact.remedy {
            outln!("{:15}    {remedy}", "");
        }
    }
    let count = |verdict| report.facts.iter().filter(|fact| fact.verdict == verdict).count();
    outln!(
        "\n{} good, {} could be better, {} bad",
        count(Verdict::Good),
        count(Verdict::CouldBeBetter),
        count(Verdict::Bad)
    );
}
