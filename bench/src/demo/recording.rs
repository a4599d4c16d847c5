//! The run: starts service and vehicle as processes, injects faults of the service, and records the messages.

use super::errors::Quantity;
use crate::harness::output::progress_bar;
use crate::harness::processes::{Child, OwnDomain, PATIENCE};
use anyhow::{Context, ensure};
use indicatif::ProgressBar;
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Estimate, Status, command, status_bits};
use shared_types::{Client, Measurement, Truth};
use sim_publisher::faults::{Fault, Reach};
use sim_publisher::supervise::{Step, steps};
use sim_publisher::{Simulation, SimulationOptions};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const LOOK_EVERY: Duration = Duration::from_millis(1);
const PROGRESS_EVERY: Duration = Duration::from_millis(100);

/// The messages recorded from shared memory.
pub(super) struct Recording {
    pub(super) measurements: Vec<Measurement>,
    pub(super) truths: Vec<Truth>,
    pub(super) estimates: Vec<Estimate>,
    pub(super) statuses: Vec<Status>,
    pub(super) samples_sent: u64,
    /// The vehicle's report.
    pub(super) summary: serde_json::Value,
    /// The last status.
    pub(super) status: Status,
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

    fn connect(&self) -> anyhow::Result<Client> {
        self.process.as_ref().context("the service is dead")?.connect(self.domain, "vehicle")
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
            // Dropping a child kills it.
            (Step::Kill, _) => self.process = None,
            (Step::Start { .. }, None) => self.process = Some(Child::start(self.domain, self.arguments)?),
            _ => {}
        }
        Ok(())
    }

    /// Makes it run again if a fault has stopped or killed it.
    fn revive(&mut self) -> anyhow::Result<()> {
        if self.stopped {
            self.take(Step::GoOn)?;
        }
        self.take(Step::Start { fault: 0 })
    }

    fn finish(self) -> anyhow::Result<()> {
        self.process.map_or(Ok(()), Child::stop)
    }
}

/// Runs the service with this preset and the vehicle with these options and faults, and records their messages.
pub(super) fn record(
    options: &SimulationOptions,
    preset: &str,
    faults: &[Fault],
    stop: &AtomicBool,
) -> anyhow::Result<Recording> {
    let domain = OwnDomain::new()?;
    let rate_hz = options.rate_hz.to_string();
    let service = ["daemon", "run", "--preset", preset, "--rate-hz", &rate_hz];
    let mut service = Service::start(&domain, &service)?;
    let client = service.connect()?;
    let mut measured = client.measurement_subscriber()?;
    let mut true_states = client.truth_subscriber()?;
    let mut estimated = client.estimate_subscriber()?;
    let mut statuses = client.status_subscriber()?;

    let duration_s = options.duration_s.context("a demo has a duration")?;
    let (duration, seed) = (duration_s.to_string(), options.seed.to_string());
    let scenario = options.scenario.name();
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
    let progress = Progress::new(duration_s);
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
    (recording.summary, recording.samples_sent) = vehicle.finish_with_summary()?;
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
    last: Cell<Instant>,
}

impl Progress {
    fn new(duration_s: f64) -> Self {
        let bar = progress_bar((duration_s * 1e3) as u64, "{bar:20} {msg}");
        Self { bar, last: Cell::new(Instant::now()) }
    }

    fn show(&self, recording: &Recording, faults: &[Fault], since_start_ns: Option<u64>) {
        if self.last.get().elapsed() < PROGRESS_EVERY {
            return;
        }
        self.last.set(Instant::now());
        let (Some(truth), Some(first)) = (recording.truths.last(), recording.truths.first()) else { return };
        let same = recording.estimates.iter().rev().find(|estimate| estimate.stamp_ns <= truth.stamp_ns);
        let Some(estimate) = same else { return };
        let error = |quantity: Quantity| quantity.error(&recording.truths, estimate).unwrap_or(0.0);
        // A dead vehicle publishes no newer truth, but the time of the run continues.
        let elapsed_ns = since_start_ns.unwrap_or(truth.stamp_ns - first.stamp_ns);
        let active = faults.iter().filter(|fault| fault.span.contains_ns(elapsed_ns));
        let active: Vec<&str> = active.map(|fault| fault.kind.name()).collect();
        self.bar.set_position(elapsed_ns / 1_000_000);
        let learning = if estimate.status & status_bits::ADAPTING != 0 { "learning" } else { "dead zone" };
        let coverage = estimate.translation.power_function.max(estimate.rotation.power_function);
        self.bar.set_message(format!(
            "{:5.1} s  v {:.3} m/s  w {:.3} rad/s  f {:.2} N  {learning:9}  uncovered {:3.0} %  {:4.0} µs  {}",
            elapsed_ns as f64 / 1e9,
            error(Quantity::Velocity),
            error(Quantity::AngularVelocity),
            error(Quantity::Force),
            100.0 * coverage,
            (estimate.publish_stamp_ns - estimate.stamp_ns.min(estimate.publish_stamp_ns)) as f64 / 1e3,
            active.join(" ").to_uppercase(),
        ));
    }

    fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// Every true state of the run, also those that a dead process did not publish: the simulation depends on its options
/// alone.
pub(super) fn whole_truth(recording: &Recording, options: &SimulationOptions) -> anyhow::Result<Vec<Truth>> {
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
