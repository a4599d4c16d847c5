//! `bench demo`: the service and a simulated vehicle as two processes, in a domain of their own.
//!
//! This process only looks on: it reads measurements, truth and estimates from shared memory like any
//! other reader. The comparison without adaptation runs the same library on the same samples afterwards.

mod errors;
mod report;

use crate::plot;
use crate::processes::{Child, OwnDomain, stop_flag};
use anyhow::{Context, ensure};
use clap::Args;
use daemon::config::ConfigFile;
use errors::{Errors, Run, error_at};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use shared_types::payload::{Estimate, Status, command, status_bits};
use shared_types::{Client, Measurement, Truth};
use shared_types::{logln, outln};
use sim_publisher::Scenario;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(10);
const LOOK_EVERY: Duration = Duration::from_millis(1);
const PROGRESS_EVERY: Duration = Duration::from_millis(100);

/// Arguments of `bench demo`.
#[derive(Debug, Args)]
pub struct DemoArguments {
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
    /// No sample arrives from START for LENGTH seconds; may be given several times.
    #[arg(long, value_name = "START:LENGTH")]
    outage: Vec<String>,
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
///
/// # Errors
/// A process does not start or fails; shared memory or the output directory cannot be used.
pub fn run(arguments: &DemoArguments) -> anyhow::Result<()> {
    ensure!(
        arguments.duration.is_finite() && arguments.duration >= 1.0,
        "--duration {}; needed: at least 1 (in s)",
        arguments.duration
    );
    let preset = preset_of(arguments.scenario);
    let mut config = ConfigFile::preset(preset)?;
    config.set_rate_hz(arguments.rate_hz.unwrap_or(config.config.rate_hz));
    config.observer()?;
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("cannot make the output directory {}", arguments.out.display()))?;

    let stop = stop_flag()?;
    let recording = record(arguments, preset, &config, &stop)?;
    let unseen = recording.status.samples_accepted.saturating_sub(recording.measurements.len() as u64);
    if unseen > 0 {
        logln!("bench: {unseen} samples were too fast for this process to see: the comparison lacks them");
    }
    if stop.load(Ordering::Relaxed) {
        logln!("bench: stopped; the figures are those of the part that ran");
    }
    let run = Run::new(recording.truths, recording.measurements, recording.estimates)?;
    let without = run.without_adaptation(&config)?;
    let report = report::Report {
        scenario: arguments.scenario.name(),
        preset,
        rate_hz: config.config.rate_hz,
        duration_s: run.duration_s(),
        samples_sent: recording.samples_sent,
        status: recording.status,
        with: Errors::over_second_half(&run, &run.estimates),
        without: Errors::over_second_half(&run, &without),
    };
    let name = format!("{}-truth-and-estimate", arguments.scenario.name());
    let title = format!("{}: truth and estimate", arguments.scenario.name());
    let panels = report::panels(&run, &without, arguments.scenario);
    let plots = plot::draw(&arguments.out.join(name), &title, "time (s)", &panels)?;
    match arguments.json {
        true => outln!("{}", serde_json::to_string_pretty(&report.json(&plots))?),
        false => report.print(&plots),
    }
    Ok(())
}

/// What was seen in shared memory.
struct Recording {
    measurements: Vec<Measurement>,
    truths: Vec<Truth>,
    estimates: Vec<Estimate>,
    samples_sent: u64,
    status: Status,
}

fn record(
    arguments: &DemoArguments,
    preset: &str,
    config: &ConfigFile,
    stop: &AtomicBool,
) -> anyhow::Result<Recording> {
    let domain = OwnDomain::new("demo")?;
    let rate_hz = config.config.rate_hz.to_string();
    let daemon = Child::start(&domain, &["daemon", "run", "--preset", preset, "--rate-hz", &rate_hz])?;
    let client = Client::connect(domain.domain(), "vehicle", PATIENCE)
        .or_else(|error| Err(error).with_context(|| daemon.log()))?;
    let mut measured = client.measurement_subscriber()?;
    let mut true_states = client.truth_subscriber()?;
    let mut estimated = client.estimate_subscriber()?;

    let (duration, seed) = (arguments.duration.to_string(), arguments.seed.to_string());
    let scenario = arguments.scenario.name();
    let mut vehicle = vec!["sim_publisher", "run", "--scenario", scenario, "--duration", &duration];
    vehicle.extend(["--rate-hz", &rate_hz, "--seed", &seed, "--json"]);
    for outage in &arguments.outage {
        vehicle.extend(["--outage", outage]);
    }
    let mut vehicle = Child::start(&domain, &vehicle)?;

    let mut recording = Recording {
        measurements: Vec::new(),
        truths: Vec::new(),
        estimates: Vec::new(),
        samples_sent: 0,
        status: Status::default(),
    };
    let progress = Progress::new(arguments.duration);
    let mut ended: Option<Instant> = None;
    loop {
        while let Some(measurement) = measured.take()? {
            recording.measurements.push(measurement);
        }
        while let Some(truth) = true_states.take()? {
            recording.truths.push(truth);
        }
        while let Some(estimate) = estimated.take()? {
            recording.estimates.push(estimate);
        }
        progress.show(&recording);
        if ended.is_none() && vehicle.has_ended()? {
            ended = Some(Instant::now());
        }
        // A little longer than the last sample, so that it is used and counted.
        if ended.is_some_and(|ended| ended.elapsed() > Duration::from_millis(100)) {
            break;
        }
        if stop.load(Ordering::Relaxed) && ended.is_none() {
            vehicle.terminate();
        }
        std::thread::sleep(LOOK_EVERY);
    }
    progress.clear();
    let summary: serde_json::Value =
        serde_json::from_str(&vehicle.finish()?).context("read the vehicle's summary")?;
    recording.samples_sent =
        summary["samples_published"].as_u64().context("the vehicle's summary has no samples")?;
    recording.status = client.command(command::STATUS, PATIENCE)?.status;
    drop((measured, true_states, estimated, client));
    daemon.terminate();
    daemon.finish()?;
    Ok(recording)
}

/// One live line on a terminal; nothing where stderr is none.
struct Progress {
    bar: ProgressBar,
    last: std::cell::Cell<Instant>,
}

impl Progress {
    fn new(duration_s: f64) -> Self {
        let bar =
            ProgressBar::with_draw_target(Some((duration_s * 1e3) as u64), ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template("{bar:20} {msg}").expect("a constant template");
        bar.set_style(style.progress_chars("=> "));
        Self { bar, last: std::cell::Cell::new(Instant::now()) }
    }

    fn show(&self, recording: &Recording) {
        if self.last.get().elapsed() < PROGRESS_EVERY {
            return;
        }
        self.last.set(Instant::now());
        let (Some(truth), Some(first)) = (recording.truths.last(), recording.truths.first()) else { return };
        let same = recording.estimates.iter().rev().find(|estimate| estimate.stamp_ns <= truth.stamp_ns);
        let Some(estimate) = same else { return };
        let Some(error) = error_at(&recording.truths, estimate) else { return };
        let elapsed_ns = truth.stamp_ns - first.stamp_ns;
        self.bar.set_position(elapsed_ns / 1_000_000);
        let learning = if estimate.status & status_bits::ADAPTING != 0 { "learning" } else { "dead zone" };
        let coverage = estimate.translation.power_function.max(estimate.rotation.power_function);
        self.bar.set_message(format!(
            "{:5.1} s  v {:.3} m/s  w {:.3} rad/s  f {:.2} N  {learning:9}  uncovered {:3.0} %  {:4.0} µs",
            elapsed_ns as f64 / 1e9,
            error.velocity_m_s.unwrap_or(0.0),
            error.angular_velocity_rad_s.unwrap_or(0.0),
            error.force_n.unwrap_or(0.0),
            100.0 * coverage,
            (estimate.publish_stamp_ns - estimate.stamp_ns.min(estimate.publish_stamp_ns)) as f64 / 1e3,
        ));
    }

    fn clear(&self) {
        self.bar.finish_and_clear();
    }
}
