//! `bench demo`: the service and a simulated vehicle as two processes, in a domain of their own.
//!
//! This process only looks on: it reads measurements, truth and estimates from shared memory like any
//! other reader. The comparison without adaptation runs the same library on the same samples afterwards.
//! With `--faults`, things go wrong on purpose: those of samples and of the vehicle's process are carried out by
//! `sim_publisher`, those of the service's process here.

mod errors;
mod faults;
mod report;

use crate::plot;
use crate::processes::{Child, OwnDomain, stop_flag};
use anyhow::{Context, ensure};
use clap::Args;
use daemon::assemble;
use daemon::config::ConfigFile;
use errors::{Errors, Run, error_at};
use faults::FaultReport;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Estimate, Status, command, status_bits};
use shared_types::{Client, Measurement, Truth};
use shared_types::{logln, outln};
use sim_publisher::faults::{Fault, Reach, check_faults, help as fault_help, read_faults};
use sim_publisher::sensors::Span;
use sim_publisher::supervise::{Step, steps};
use sim_publisher::{Scenario, Simulation, SimulationOptions};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(10);
const LOOK_EVERY: Duration = Duration::from_millis(1);
const PROGRESS_EVERY: Duration = Duration::from_millis(100);

/// What `bench demo --help` ends with.
pub(crate) fn after_help() -> String {
    format!(
        "{}\n\n\
Examples:
  bench demo
  # An underwater vehicle whose Doppler log is silent for 3 s
  bench demo --scenario auv --duration 60 --outage 40:3
  # Spikes, then a service that stands still
  bench demo --faults 'spike@6:2,size=3; service-stop@15:0.5'",
        fault_help()
    )
}

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
    /// No sample arrives from START for LENGTH seconds, the fault burst; may be given several times.
    #[arg(long, value_name = "START:LENGTH", value_parser = Span::parse)]
    outage: Vec<Span>,
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
    config.config.rate_hz = arguments.rate_hz.unwrap_or(config.config.rate_hz);
    assemble::rigid_body(&config)?;
    let options = SimulationOptions {
        rate_hz: config.config.rate_hz,
        duration_s: Some(arguments.duration),
        seed: arguments.seed,
        ..SimulationOptions::of(arguments.scenario)
    };
    let faults = stated_faults(arguments, &options)?;
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("cannot make the output directory {}", arguments.out.display()))?;

    let stop = stop_flag()?;
    let mut recording = record(arguments, preset, &config, &faults, &stop)?;
    let unseen = recording.status.samples_accepted.saturating_sub(recording.measurements.len() as u64);
    if unseen > 0 {
        logln!("bench: {unseen} samples were too fast for this process to see: the comparison lacks them");
    }
    if stop.load(Ordering::Relaxed) {
        logln!("bench: stopped; the figures are those of the part that ran");
    }
    if !faults.is_empty() {
        recording.truths = whole_truth(&recording, &options)?;
    }
    let run = Run::new(recording.truths, recording.measurements, recording.estimates)?;
    let without = run.without_adaptation(&config)?;
    let fault_report = match faults.is_empty() {
        true => None,
        false => {
            let without = faults::without_faults(&run, &options, &config)?;
            Some(FaultReport::new(&run, &without, &faults, &recording.statuses, &recording.summary)?)
        }
    };
    let report = report::Report {
        scenario: arguments.scenario.name(),
        preset,
        rate_hz: config.config.rate_hz,
        duration_s: run.duration_s(),
        samples_sent: recording.samples_sent,
        status: recording.status,
        with: Errors::over_second_half(&run, &run.estimates),
        without: Errors::over_second_half(&run, &without),
        faults: fault_report,
    };
    let name = format!("{}-truth-and-estimate", arguments.scenario.name());
    let title = format!("{}: truth and estimate", arguments.scenario.name());
    let mut panels = report::panels(&run, &without, arguments.scenario);
    let mut shades = Vec::new();
    if let Some(faults) = &report.faults {
        panels.insert(0, faults.panel());
        shades = faults.shades();
    }
    let plots = plot::draw_shaded(&arguments.out.join(name), &title, "time (s)", &panels, &shades)?;
    match arguments.json {
        true => outln!("{}", serde_json::to_string_pretty(&report.json(&plots))?),
        false => report.print(&plots),
    }
    Ok(())
}

/// The faults that were asked for, in the order of time.
fn stated_faults(arguments: &DemoArguments, options: &SimulationOptions) -> anyhow::Result<Vec<Fault>> {
    let outage = |&span: &Span| format!("burst@{}:{}", span.start_s, span.length_s);
    let outages: Vec<String> = arguments.outage.iter().map(outage).collect();
    let mut faults = read_faults(&[outages.as_slice(), &arguments.faults].concat())?;
    check_faults(&faults, options)?;
    faults.sort_by(|a, b| a.span.start_s.total_cmp(&b.span.start_s));
    Ok(faults)
}

/// Every true state of the run, those included that a dead process did not publish: the simulation follows from its
/// options alone. Fails where the two differ.
fn whole_truth(recording: &Recording, options: &SimulationOptions) -> anyhow::Result<Vec<Truth>> {
    let start_ns = recording.summary["start_stamp_ns"]
        .as_u64()
        .context("the vehicle's summary has no start_stamp_ns")?;
    let simulated = Simulation::new(options)?.map(|sample| sample.truth);
    let last_ns =
        recording.truths.last().context("no true state was seen: the vehicle did not run")?.stamp_ns;
    let stamped = simulated.map(|truth| Truth { stamp_ns: start_ns + truth.stamp_ns, ..truth });
    let whole: Vec<Truth> = stamped.take_while(|truth| truth.stamp_ns <= last_ns).collect();
    for seen in &recording.truths {
        let same = whole.binary_search_by_key(&seen.stamp_ns, |truth| truth.stamp_ns);
        ensure!(
            same.is_ok_and(|i| whole[i] == *seen),
            "the vehicle's true state {} is not that of the simulation with the same options: \
             are both programs of the same build?",
            seen.sequence
        );
    }
    Ok(whole)
}

/// What was seen in shared memory.
struct Recording {
    measurements: Vec<Measurement>,
    truths: Vec<Truth>,
    estimates: Vec<Estimate>,
    statuses: Vec<Status>,
    samples_sent: u64,
    /// What the vehicle says it did.
    summary: serde_json::Value,
    /// The last.
    status: Status,
}

/// The service's process, which faults stop and kill; `None` while it is dead.
struct Service<'a> {
    domain: &'a OwnDomain,
    arguments: &'a [&'a str],
    process: Option<Child>,
    stopped: bool,
}

impl<'a> Service<'a> {
    fn start(domain: &'a OwnDomain, arguments: &'a [&'a str]) -> anyhow::Result<Self> {
        Ok(Self { domain, arguments, process: Some(Child::start(domain, arguments)?), stopped: false })
    }

    fn log(&self) -> String {
        self.process.as_ref().map_or("the service is dead".into(), Child::log)
    }

    fn take(&mut self, step: Step) -> anyhow::Result<()> {
        match (step, &self.process) {
            (Step::Stop, Some(process)) => {
                process.pause()?;
                self.stopped = true;
            }
            (Step::GoOn, Some(process)) => {
                process.go_on()?;
                self.stopped = false;
            }
            // A child that is let go of is killed.
            (Step::Kill, _) => self.process = None,
            (Step::Start { .. }, None) => self.process = Some(Child::start(self.domain, self.arguments)?),
            _ => {}
        }
        Ok(())
    }

    /// Whatever a fault left of it: it runs afterwards.
    fn revive(&mut self) -> anyhow::Result<()> {
        if self.stopped {
            self.take(Step::GoOn)?;
        }
        self.take(Step::Start { fault: 0 })
    }

    fn finish(self) -> anyhow::Result<()> {
        let Some(process) = self.process else { return Ok(()) };
        process.terminate();
        process.finish()?;
        Ok(())
    }
}

fn record(
    arguments: &DemoArguments,
    preset: &str,
    config: &ConfigFile,
    faults: &[Fault],
    stop: &AtomicBool,
) -> anyhow::Result<Recording> {
    let domain = OwnDomain::new()?;
    let rate_hz = config.config.rate_hz.to_string();
    let service = ["daemon", "run", "--preset", preset, "--rate-hz", &rate_hz];
    let mut service = Service::start(&domain, &service)?;
    let client = Client::connect(domain.domain(), "vehicle", PATIENCE)
        .or_else(|error| Err(error).with_context(|| service.log()))?;
    let mut measured = client.measurement_subscriber()?;
    let mut true_states = client.truth_subscriber()?;
    let mut estimated = client.estimate_subscriber()?;
    let mut statuses = client.status_subscriber()?;

    let (duration, seed) = (arguments.duration.to_string(), arguments.seed.to_string());
    let scenario = arguments.scenario.name();
    let mut vehicle = vec!["sim_publisher", "run", "--scenario", scenario, "--duration", &duration];
    vehicle.extend(["--rate-hz", &rate_hz, "--seed", &seed, "--json"]);
    let of_vehicle = faults.iter().filter(|fault| fault.kind.reach() != Reach::Service);
    let of_vehicle: Vec<String> = of_vehicle.map(Fault::to_string).collect();
    for fault in &of_vehicle {
        vehicle.extend(["--faults", fault]);
    }
    let mut vehicle = Child::start(&domain, &vehicle)?;

    let mut recording = Recording {
        measurements: Vec::new(),
        truths: Vec::new(),
        estimates: Vec::new(),
        statuses: Vec::new(),
        samples_sent: 0,
        summary: serde_json::Value::Null,
        status: Status::default(),
    };
    let mut steps = steps(faults, Reach::Service).into_iter().peekable();
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
        while let Some(status) = statuses.take()? {
            recording.statuses.push(status);
        }
        let since_start_ns =
            recording.truths.first().map(|first| monotonic_ns().saturating_sub(first.stamp_ns));
        while let Some((_, step)) =
            steps.next_if(|&(at_ns, _)| since_start_ns.is_some_and(|now| now >= at_ns))
        {
            service.take(step)?;
        }
        progress.show(&recording, faults, since_start_ns);
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
    recording.summary = summary;
    service.revive()?;
    recording.status = client.command(command::STATUS, PATIENCE)?.status;
    recording.statuses.push(recording.status);
    drop((measured, true_states, estimated, statuses, client));
    service.finish()?;
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

    fn show(&self, recording: &Recording, faults: &[Fault], since_start_ns: Option<u64>) {
        if self.last.get().elapsed() < PROGRESS_EVERY {
            return;
        }
        self.last.set(Instant::now());
        let (Some(truth), Some(first)) = (recording.truths.last(), recording.truths.first()) else { return };
        let same = recording.estimates.iter().rev().find(|estimate| estimate.stamp_ns <= truth.stamp_ns);
        let Some(estimate) = same else { return };
        let Some(error) = error_at(&recording.truths, estimate) else { return };
        // A dead vehicle has no newer truth; time goes on.
        let elapsed_ns = since_start_ns.unwrap_or(truth.stamp_ns - first.stamp_ns);
        let active = faults.iter().filter(|fault| fault.span.contains_ns(elapsed_ns));
        let active: Vec<&str> = active.map(|fault| fault.kind.name()).collect();
        self.bar.set_position(elapsed_ns / 1_000_000);
        let learning = if estimate.status & status_bits::ADAPTING != 0 { "learning" } else { "dead zone" };
        let coverage = estimate.translation.power_function.max(estimate.rotation.power_function);
        self.bar.set_message(format!(
            "{:5.1} s  v {:.3} m/s  w {:.3} rad/s  f {:.2} N  {learning:9}  uncovered {:3.0} %  {:4.0} µs  {}",
            elapsed_ns as f64 / 1e9,
            error.velocity_m_s.unwrap_or(0.0),
            error.angular_velocity_rad_s.unwrap_or(0.0),
            error.force_n.unwrap_or(0.0),
            100.0 * coverage,
            (estimate.publish_stamp_ns - estimate.stamp_ns.min(estimate.publish_stamp_ns)) as f64 / 1e3,
            active.join(" ").to_uppercase(),
        ));
    }

    fn clear(&self) {
        self.bar.finish_and_clear();
    }
}
