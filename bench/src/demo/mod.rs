//! `bench demo`: the service and a simulated vehicle as two processes, in a domain of their own.
//!
//! This process only reads measurements, truth and estimates from shared memory, like any other reader. Afterwards it runs
//! the same library on the same samples without learning, and a Kalman filter, for comparison. The velocity's sensor fails
//! three times, while the commands go on. With `--faults` or `--outage` it is those instead: `sim_publisher` injects the faults
//! of samples and of the vehicle's process, and `recording` those of the service's process.
//!
//! | file | what lives there |
//! |---|---|
//! | `recording` | the processes, and the messages recorded of them |
//! | `errors` | errors of estimates against the truth |
//! | `compared` | the Kalman filter on the same samples |
//! | `outages` | errors at the ends of times without a measured velocity, and the figure of one |
//! | `faults` | the effect of each fault |
//! | `report` | tables, JSON document and panels |

mod compared;
mod errors;
mod faults;
mod outages;
mod recording;
mod report;

use crate::harness::output::{say_if_stopped, show};
use crate::plot::Figure;
use anyhow::{Context, ensure};
use clap::Args;
use command_line::stop_flag;
use daemon::assemble;
use daemon::config::ConfigFile;
use errors::{Quantity, RmsMax, Run};
use faults::FaultReport;
use outages::{OutageReport, best_in_outages};
use recording::{record, whole_truth};
use shared_types::logln;
use sim_publisher::faults::{Fault, check_faults, help as fault_help, read_faults};
use sim_publisher::sensors::Span;
use sim_publisher::{Scenario, SimulationOptions};
use std::path::PathBuf;

/// What `bench demo --help` ends with.
pub(crate) fn after_help() -> String {
    format!(
        "{}\n\n\
Examples:
  bench demo
  # The same without outages
  bench demo --no-outages
  # An underwater vehicle whose Doppler log is silent for 3 s
  bench demo --scenario auv --duration 60 --outage 40:3
  # Spikes, then a service that stands still
  bench demo --faults 'spike@6:2,size=3; service-stop@15:0.5'",
        fault_help()
    )
}

/// Arguments of `bench demo`.
#[derive(Debug, Args)]
pub(crate) struct DemoArguments {
    /// Which vehicle.
    #[arg(long, value_enum, default_value_t = Scenario::RigidBody)]
    scenario: Scenario,
    /// Length of the run (s).
    #[arg(long, value_name = "S", default_value_t = 20.0)]
    duration: f64,
    /// Rate of samples and of ticks [default: the preset's].
    #[arg(long, value_name = "HZ")]
    rate_hz: Option<f64>,
    /// Seed of all chance in the vehicle and its sensors.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// No sample and no command arrives from START for LENGTH seconds, the fault burst; may be given several times.
    #[arg(long, value_name = "START:LENGTH", value_parser = Span::parse)]
    outage: Vec<Span>,
    /// Without the three outages of the velocity's sensor that a run has without --outage and --faults.
    #[arg(long, conflicts_with_all = ["outage", "faults"])]
    no_outages: bool,
    /// Faults at stated times, see below, or a file of them; may be given several times.
    #[arg(long, value_name = "SPEC|FILE")]
    faults: Vec<String>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Where the plots go; made if it is missing.
    #[arg(long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,
}

/// The built-in configuration that belongs to a scenario.
fn preset_of(scenario: Scenario) -> &'static str {
    match scenario {
        Scenario::Translation => "paper-translation",
        Scenario::Rotation => "paper-rotation",
        Scenario::RigidBody => "rigid-body",
        Scenario::Auv => "auv",
    }
}

/// Runs `bench demo`.
pub(crate) fn run(arguments: &DemoArguments) -> anyhow::Result<()> {
    ensure!(
        arguments.duration.is_finite() && arguments.duration >= 1.0,
        "--duration {}; needed: at least 1 (in s)",
        arguments.duration
    );
    let preset = preset_of(arguments.scenario);
    let mut config = ConfigFile::preset(preset)?;
    config.config.rate_hz = arguments.rate_hz.unwrap_or(config.config.rate_hz);
    assemble::rigid_body(&config)?;
    let options = SimulationOptions {
        rate_hz: config.config.rate_hz,
        duration_s: Some(arguments.duration),
        seed: arguments.seed,
        ..SimulationOptions::of(arguments.scenario)
    };
    let faults = stated_faults(arguments, &options)?;
    let is_judged_by_fault = !arguments.outage.is_empty() || !arguments.faults.is_empty();
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("cannot make the output directory {}", arguments.out.display()))?;

    let stop = stop_flag()?;
    let mut recording = record(&options, preset, &faults, &stop)?;
    let unseen =
        recording.status.counters.samples_accepted.saturating_sub(recording.measurements.len() as u64);
    if unseen > 0 {
        logln!("bench: {unseen} samples were too fast for this process to see: the comparison lacks them");
    }
    say_if_stopped(&stop);
    if !faults.is_empty() {
        recording.truths = whole_truth(&recording, &options)?;
    }
    let run = Run::new(recording.truths, recording.measurements, recording.estimates)?;
    let without = run.without_adaptation(&config)?;
    let tunings = compared::tunings(&run, &config)?;
    let fault_report = match is_judged_by_fault {
        false => None,
        true => {
            let without = faults::without_faults(&run, &options, &config)?;
            Some(FaultReport::new(&run, &without, &faults, &recording.statuses, &recording.summary)?)
        }
    };
    // Of the filter's tunings the best for each quantity.
    let errors = Quantity::ALL.map(|quantity| {
        let filter = compared::best(&run, &tunings, quantity).filter(|_| quantity.is_of_translation());
        let compared = [Some(run.estimates.as_slice()), Some(&without), filter];
        (quantity, compared.map(|e| RmsMax::over_second_half(&run, e?, quantity)))
    });
    let filter = best_in_outages(&run, &tunings, &faults);
    let compared = filter.map(|filter| [run.estimates.as_slice(), without.as_slice(), filter]);
    let outages = compared.and_then(|compared| OutageReport::new(&run, compared, &faults));
    let report = report::Report {
        scenario: arguments.scenario.name(),
        preset,
        rate_hz: config.config.rate_hz,
        duration_s: run.duration_s(),
        samples_sent: recording.samples_sent,
        status: recording.status,
        errors,
        faults: fault_report,
        outages,
    };
    let title = format!("{}: truth and estimate", arguments.scenario.name());
    let mut panels = report::panels(&run, &without, filter, arguments.scenario);
    let mut shades = Vec::new();
    if let Some(faults) = &report.faults {
        panels.insert(0, faults.panel());
        shades = faults.shades();
    }
    let name = arguments.scenario.name();
    let mut plots = Vec::new();
    if let Some(outages) = &report.outages {
        plots.push(arguments.out.join(format!("{name}-outage.svg")));
        outages.figure().write(&plots[0])?;
        shades.extend(outages.shades().filter(|_| report.faults.is_none()));
    }
    plots.push(arguments.out.join(format!("{name}-truth-and-estimate.svg")));
    Figure { shades, ..Figure::new(&title, "time (s)", panels) }.write(&plots[plots.len() - 1])?;
    show(arguments.json, &report.json(&plots), || report.print(&plots))
}

/// Three outages of the velocity's sensor, spread over the run after a time to learn in.
fn usual_outages(arguments: &DemoArguments) -> Vec<String> {
    let has_velocity = arguments.scenario != Scenario::Rotation;
    let length_s = (0.1 * arguments.duration).min(2.0);
    let starts = [0.4, 0.62, 0.84].into_iter().filter(|_| has_velocity && !arguments.no_outages);
    starts
        .map(|part| format!("burst@{:.2}:{length_s:.2},field=velocity", part * arguments.duration))
        .collect()
}

/// The faults that were asked for, in the order of time.
fn stated_faults(arguments: &DemoArguments, options: &SimulationOptions) -> anyhow::Result<Vec<Fault>> {
    let outage = |&span: &Span| format!("burst@{}:{}", span.start_s, span.length_s);
    let usual = usual_outages(arguments);
    let outages: Vec<String> = arguments.outage.iter().map(outage).collect();
    let stated = [outages.as_slice(), &arguments.faults].concat();
    let mut faults = read_faults(if stated.is_empty() { &usual } else { &stated })?;
    check_faults(&faults, options)?;
    faults.sort_by(|a, b| a.span.start_s.total_cmp(&b.span.start_s));
    Ok(faults)
}
