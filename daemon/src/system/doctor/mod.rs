//! `daemon doctor`: what this machine grants, measured and not believed.
//!
//! How late threads wake up with each setting, and what that depends on: each with what was found, a verdict,
//! and what would help. It needs no rights, changes nothing, and a fact that the kernel does not tell is one
//! line that says so.

mod disk;
mod facts;
mod lateness;
mod memory;

use crate::assemble;
use crate::cli::PlaceArguments;
use crate::config::{ConfigFile, PRESETS, RealTimeConfig};
use crate::log::say;
use crate::system::machine;
use crate::system::settings;
use comfy_table::{CellAlignment, Table, presets::NOTHING};
use lateness::LatenessRow;
use serde::Serialize;
use shared_types::outln;
use shared_types::payload::real_time;
use std::path::PathBuf;

/// What is measured where no configuration says otherwise.
const RATE_HZ: f64 = 1000.0;
const PRIORITY: u8 = 80;
const SPIN_US: f64 = 200.0;

/// What this machine grants, measured.
#[derive(Debug, clap::Args)]
pub struct DoctorArguments {
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

/// What a fact means for the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Verdict {
    Good,
    CouldBeBetter,
    Bad,
    /// The kernel does not tell.
    Unknown,
}

impl Verdict {
    fn words(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::CouldBeBetter => "could be better",
            Self::Bad => "bad",
            Self::Unknown => "unknown",
        }
    }
}

/// One thing that punctuality or safety depends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Fact {
    name: &'static str,
    found: String,
    verdict: Verdict,
    /// The command or change that would help.
    #[serde(skip_serializing_if = "Option::is_none")]
    remedy: Option<String>,
}

impl Fact {
    fn good(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Good, remedy: None }
    }

    fn unknown(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Unknown, remedy: None }
    }

    fn better(name: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::CouldBeBetter, remedy: Some(remedy.into()) }
    }

    fn bad(name: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name, found: found.into(), verdict: Verdict::Bad, remedy: Some(remedy.into()) }
    }
}

/// What is measured.
#[derive(Debug, Clone)]
struct Plan {
    rate_hz: f64,
    spin_us: f64,
    seconds: f64,
    priority: u8,
    cores: Option<Vec<usize>>,
}

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Report {
    cpu: String,
    profile: &'static str,
    rate_hz: f64,
    spin_us: f64,
    priority: u8,
    facts: Vec<Fact>,
    lateness: Vec<LatenessRow>,
}

/// Runs `daemon doctor`.
///
/// # Errors
/// The configuration or the root path is refused. What the machine lacks is a finding, and no error.
pub(crate) fn run(arguments: &DoctorArguments) -> anyhow::Result<()> {
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
        say!("measuring for about {:.0} s …", lateness::seconds(&plan).ceil());
    }
    let steal_before = facts::processor_time();
    let lateness = lateness::measure(&plan);
    let mut facts = facts::all(&plan, steal_before);
    facts.extend(memory::all(&domain, &arguments.place.instance));
    facts.push(disk::snapshots());
    if let Some(file) = &file {
        facts.push(asked_for(file, &asked));
    }
    let report = Report {
        cpu: machine::cpu_model().unwrap_or_else(|| "unknown CPU".into()),
        profile: if cfg!(debug_assertions) { "debug" } else { "release" },
        rate_hz: plan.rate_hz,
        spin_us: plan.spin_us,
        priority: plan.priority,
        facts,
        lateness,
    };
    match arguments.json {
        true => outln!("{}", serde_json::to_string_pretty(&report)?),
        false => report.print(),
    }
    Ok(())
}

/// Whether this machine grants what a configuration asks for.
fn asked_for(file: &ConfigFile, asked: &RealTimeConfig) -> Fact {
    const NAME: &str = "settings of the configuration";
    if let Err(error) = file.check_cores(&crate::system::real_time::allowed_cores()) {
        return Fact::bad(NAME, error.to_string(), "change that key: daemon run refuses it on this machine");
    }
    let outcome = settings::try_out(asked);
    let granted = format!("granted: {}", real_time::words(outcome.granted).join(", "));
    match outcome.refused.as_slice() {
        [] => Fact::good(NAME, granted),
        refused => {
            let remedies: Vec<_> = refused.iter().map(|(_, refused)| refused.to_string()).collect();
            let found = format!("{granted}; refused: {}", outcome.refused_in_short());
            Fact::bad(NAME, found, remedies.join("; "))
        }
    }
}

impl Report {
    fn print(&self) {
        outln!("{}; {} build\n", self.cpu, self.profile);
        let mut table = Table::new();
        table.load_style(NOTHING);
        let header = format!("late by (µs), {} Hz", self.rate_hz);
        table.set_header([header.as_str(), "count", "p50", "p99", "max"]);
        for row in &self.lateness {
            let cells = match &row.lateness_ns {
                Some(found) => {
                    let us = |ns: u64| format!("{:.1}", ns as f64 / 1e3);
                    [found.count.to_string(), us(found.p50), us(found.p99), us(found.max)]
                }
                None => ["not granted", "–", "–", "–"].map(String::from),
            };
            table.add_row([&[row.mode.words(self.spin_us, self.priority)], &cells[..]].concat());
        }
        for column in 1..5 {
            if let Some(column) = table.column_mut(column) {
                column.set_cell_alignment(CellAlignment::Right);
            }
        }
        outln!("{table}\n");
        for fact in &self.facts {
            outln!("{:15}  {}: {}", fact.verdict.words(), fact.name, fact.found);
            if let Some(remedy) = &fact.remedy {
                outln!("{:15}    {remedy}", "");
            }
        }
        let count = |verdict| self.facts.iter().filter(|fact| fact.verdict == verdict).count();
        outln!(
            "\n{} good, {} could be better, {} bad",
            count(Verdict::Good),
            count(Verdict::CouldBeBetter),
            count(Verdict::Bad)
        );
    }
}
