//! `bench ipc`: what the service adds to bare shared memory.
//!
//! Two kinds of round trip take turns in small batches of one run, between the same two cores, so that drift affects both:
//!
//! | kind | a round trip |
//! |---|---|
//! | service | `Client` publishes a [`Measurement`], a polling `daemon run` takes it, checks it, steps the observer and publishes an [`Estimate`] for which `Client` polls |
//! | bare | the same two payloads through iceoryx2's ports alone, another process echoing them |
//!
//! Both sides of both kinds copy the payloads out of shared memory, as a user's program does. The process that is not
//! measured is stopped (SIGSTOP), so that it does not compete for the other's core.

use crate::harness::exchange::{Exchange, MovingVehicle, Reply, ServiceExchange, Trip, connect, round_trip};
use crate::harness::latency::{latency_table, summary};
use crate::harness::machine::Machine;
use crate::harness::output::{progress_bar, say_if_stopped, show, three_digits, warn_of_debug_build};
use crate::harness::processes::{Child, OwnDomain, PATIENCE, ServiceSettings};
use anyhow::{Context, anyhow, bail};
use command_line::stop_flag;
use daemon::config::PRESETS;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;
use serde::Serialize;
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Estimate, Measurement};
use shared_types::service::{self, Node, ServiceError, Services};
use shared_types::{Domain, LatencySummary, outln};
use std::ffi::OsString;
use std::hint::black_box;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const TRIP_PATIENCE_NS: u64 = 1_000_000_000;
/// Instance of the services between the two bare sides.
const BARE: &str = "bare";

/// Round trips through the service and through bare shared memory.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct IpcArguments {
    /// Round trips of each way.
    #[arg(long, value_name = "COUNT", default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    samples: u32,
    /// Round trips before the other way has its turn.
    #[arg(long, value_name = "COUNT", default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    batch: u32,
    /// Pause between two round trips; 0 is back to back.
    #[arg(long, value_name = "US", default_value_t = 0)]
    pause_us: u32,
    /// Configuration of the service.
    #[arg(long, value_name = "NAME", default_value = PRESETS[0].0, value_parser = PRESETS.map(|(name, _)| name))]
    preset: String,
    /// A few seconds: 5000 round trips of each way.
    #[arg(long, conflicts_with = "samples")]
    quick: bool,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    json: bool,
}

/// Runs `bench ipc`. Pins the calling thread to its core and the other side to another one.
pub(crate) fn run(arguments: &IpcArguments) -> anyhow::Result<()> {
    warn_of_debug_build();
    let stop = stop_flag()?;
    let machine = Machine::found();
    let core = machine.other_core()?;
    let n_samples = if arguments.quick { 5000 } else { arguments.samples as usize };
    let (service, bare) = measure(arguments, n_samples, core, &stop)?;
    let report = Report::of(&machine, core, arguments, service, bare)
        .context("stopped before the first batch: nothing was measured")?;
    show(arguments.json, &report, || report.print())
}

/// Times of one kind (ns).
#[derive(Debug, Default)]
struct Times {
    there: Vec<u64>,
    inside: Vec<u64>,
    back: Vec<u64>,
    whole: Vec<u64>,
}

impl Times {
    /// Reserved and touched, so that no page is mapped while the clock runs.
    fn reserved(n_samples: usize) -> Self {
        let reserved = || {
            let mut samples_ns = vec![1; n_samples];
            samples_ns.clear();
            samples_ns
        };
        Self { there: reserved(), inside: reserved(), back: reserved(), whole: reserved() }
    }

    fn note(&mut self, trip: Trip) {
        self.there.push(trip.there_ns);
        self.inside.push(trip.inside_ns);
        self.back.push(trip.back_ns);
        self.whole.push(trip.whole_ns);
    }
}

/// One kind of round trip, with its other side.
struct Contestant<E> {
    exchange: E,
    other_side: Child,
    vehicle: MovingVehicle,
    times: Times,
}

/// Round trips at the head of each batch that are not timed: they bring back what the other way pushed out
/// of the caches, and wake the other side up.
const UNTIMED_TRIPS: usize = 20;

impl<E: Exchange> Contestant<E> {
    fn new(exchange: E, other_side: Child, n_samples: usize) -> anyhow::Result<Self> {
        let times = Times::reserved(n_samples);
        let mut contestant = Self { exchange, other_side, vehicle: MovingVehicle::default(), times };
        connect(&mut contestant.exchange, &mut contestant.vehicle)
            .or_else(|error| Err(error).with_context(|| contestant.other_side.log()))?;
        contestant.other_side.pause()?;
        Ok(contestant)
    }

    fn batch(&mut self, n_trips: usize, pause: Duration) -> anyhow::Result<()> {
        self.other_side.go_on()?;
        for i in 0..UNTIMED_TRIPS + n_trips {
            let paused = Instant::now();
            while paused.elapsed() < pause {
                std::hint::spin_loop();
            }
            let trip = round_trip(&mut self.exchange, &mut self.vehicle, TRIP_PATIENCE_NS)?;
            let trip = trip.with_context(|| format!("no answer within 1 s; {}", self.other_side.log()))?;
            if i >= UNTIMED_TRIPS {
                self.times.note(trip);
            }
        }
        self.other_side.pause()
    }

    fn finish(self) -> anyhow::Result<Times> {
        drop(self.exchange);
        self.other_side.go_on()?;
        self.other_side.stop()?;
        Ok(self.times)
    }
}

fn measure(
    arguments: &IpcArguments,
    n_samples: usize,
    core: usize,
    stop: &AtomicBool,
) -> anyhow::Result<(Times, Times)> {
    let domain = OwnDomain::new()?;
    let settings =
        ServiceSettings { preset: &arguments.preset, trigger: "sample", rate_hz: 200.0, spin_us: 0.0 };
    let service = Child::start_service(&domain, "vehicle", &settings, &[core])?;
    let client = service.connect(&domain, "vehicle")?;
    let mut service = Contestant::new(ServiceExchange::of(&client)?, service, n_samples)?;
    let echo = Child::start_on(&domain, &["echo"], &[core])?;
    let bare = BareExchange::open(domain.domain(), PATIENCE)
        .or_else(|error| Err(error).with_context(|| echo.log()))?;
    let mut bare = Contestant::new(bare, echo, n_samples)?;

    let progress = progress_bar(n_samples as u64, "{bar:40} {elapsed} of about {duration}");
    let pause = Duration::from_micros(arguments.pause_us.into());
    while service.times.whole.len() < n_samples && !stop.load(Ordering::Relaxed) {
        let n_trips = (arguments.batch as usize).min(n_samples - service.times.whole.len());
        service.batch(n_trips, pause)?;
        bare.batch(n_trips, pause)?;
        progress.inc(n_trips as u64);
    }
    progress.finish_and_clear();
    say_if_stopped(stop);
    let times = (service.finish()?, bare.finish()?);
    drop(client);
    Ok(times)
}

/// iceoryx2's ports and nothing else.
struct BareExchange {
    samples: Publisher<ipc::Service, Measurement, ()>,
    estimates: Subscriber<ipc::Service, Estimate, ()>,
    _node: Node,
}

impl BareExchange {
    fn open(domain: &Domain, patience: Duration) -> anyhow::Result<Self> {
        let node = {
            let _making = domain.lock_for_making()?;
            service::node(domain, "bare")?
        };
        let services = Services::of(&node, BARE)?;
        let start = Instant::now();
        let estimates = loop {
            match services.open::<Estimate>() {
                Err(ServiceError::Missing(_)) if start.elapsed() < patience => {
                    std::thread::sleep(Duration::from_millis(10));
                }
                found => break found?,
            }
        };
        let samples = services.open::<Measurement>()?;
        let _making = domain.lock_for_making()?;
        let samples = samples.publisher_builder().create().map_err(bare_error)?;
        let estimates = estimates.subscriber_builder().create().map_err(bare_error)?;
        Ok(Self { samples, estimates, _node: node })
    }
}

impl Exchange for BareExchange {
    fn send(&mut self, sample: &Measurement) -> anyhow::Result<()> {
        let loan = self.samples.loan_uninit().map_err(bare_error)?;
        loan.write_payload(*sample).send().map_err(bare_error)?;
        Ok(())
    }

    fn poll(&mut self) -> anyhow::Result<Option<Reply>> {
        let sample = self.estimates.receive().map_err(bare_error)?;
        Ok(sample.map(|sample| Reply::from(&black_box(*sample))))
    }
}

fn bare_error(error: impl std::fmt::Debug) -> anyhow::Error {
    anyhow!("bare iceoryx2: {error:?}")
}

/// The other side of the bare way, a process of its own: `bench echo --root PATH`. It answers every sample
/// with an estimate, polling, until it is told to end.
pub(crate) fn echo(arguments: &[OsString]) -> anyhow::Result<()> {
    let [option, root] = arguments else { bail!("needed: echo --root PATH") };
    if option != "--root" {
        bail!("needed: echo --root PATH");
    }
    let stop = stop_flag()?;
    let domain = Domain::at(Path::new(root))?;
    let node = {
        let _making = domain.lock_for_making()?;
        service::node(&domain, "echo")?
    };
    let services = Services::of(&node, BARE)?;
    let making = domain.lock_for_making()?;
    let samples = services.make::<Measurement>()?.subscriber_builder().create().map_err(bare_error)?;
    let estimates = services.make::<Estimate>()?.publisher_builder().create().map_err(bare_error)?;
    drop(making);
    while !stop.load(Ordering::Relaxed) {
        let Some(sample) = samples.receive().map_err(bare_error)? else { continue };
        let sample = black_box(*sample);
        let stamp_ns = monotonic_ns();
        let loan = estimates.loan_uninit().map_err(bare_error)?;
        let estimate = Estimate {
            sequence: sample.sequence,
            source_sequence: sample.sequence,
            source_stamp_ns: sample.stamp_ns,
            stamp_ns,
            publish_stamp_ns: monotonic_ns(),
            ..Estimate::default()
        };
        loan.write_payload(estimate).send().map_err(bare_error)?;
    }
    Ok(())
}

/// The document of `--json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    machine: &'a Machine,
    other_core: usize,
    preset: &'a str,
    pause_us: u32,
    service_over_bare_median: f64,
    service_ns: LatencySummary,
    bare_ns: LatencySummary,
    service_one_way: OneWay,
    bare_one_way: OneWay,
}

/// The parts of a round trip.
#[derive(Debug, Serialize)]
struct OneWay {
    there_ns: LatencySummary,
    inside_ns: LatencySummary,
    back_ns: LatencySummary,
}

impl OneWay {
    fn of(times: &mut Times) -> Option<Self> {
        let Times { there, inside, back, .. } = times;
        Some(Self { there_ns: summary(there)?, inside_ns: summary(inside)?, back_ns: summary(back)? })
    }
}

impl<'a> Report<'a> {
    /// `None` where nothing was measured.
    fn of(
        machine: &'a Machine,
        other_core: usize,
        arguments: &'a IpcArguments,
        mut service: Times,
        mut bare: Times,
    ) -> Option<Self> {
        let (service_ns, bare_ns) = (summary(&mut service.whole)?, summary(&mut bare.whole)?);
        Some(Self {
            machine,
            other_core,
            preset: &arguments.preset,
            pause_us: arguments.pause_us,
            service_over_bare_median: service_ns.p50 as f64 / bare_ns.p50 as f64,
            service_ns,
            bare_ns,
            service_one_way: OneWay::of(&mut service)?,
            bare_one_way: OneWay::of(&mut bare)?,
        })
    }

    fn print(&self) {
        self.machine.print();
        let pause = match self.pause_us {
            0 => "back to back".into(),
            pause_us => format!("{pause_us} µs apart"),
        };
        let (core, preset) = (self.other_core, self.preset);
        outln!("the other side on core {core}; service with preset {preset}; samples {pause}");
        let (service, bare) = (&self.service_one_way, &self.bare_one_way);
        let rows = [
            ("service: round trip", self.service_ns),
            ("  sample's stamp until the service has it", service.there_ns),
            ("  judged, stepped, until just before publication", service.inside_ns),
            ("  publication until the client has it", service.back_ns),
            ("bare: round trip", self.bare_ns),
            ("  sample's stamp until the echo has it", bare.there_ns),
            ("  until just before publication", bare.inside_ns),
            ("  publication until the client has it", bare.back_ns),
        ];
        outln!("{}", latency_table("µs", rows));
        let ratio = three_digits(self.service_over_bare_median);
        outln!("median of the service's round trip over the bare one: {ratio}");
    }
}
