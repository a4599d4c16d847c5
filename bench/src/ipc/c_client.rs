//! What the C client adds to a call of the Rust client that it wraps; a part of `bench ipc`.
//!
//! Both clients are open at once and take turns, sample by sample, with an echo on the other core that answers
//! every sample. Timed are single calls: publish; the take that finds the answer; a peek at it.

use crate::harness::exchange::MovingVehicle;
use crate::harness::latency::summary;
use crate::harness::processes::{OwnDomain, PATIENCE};
use anyhow::{anyhow, bail};
use observer_client::{Handle, observer_close, ports, through_c};
use serde::Serialize;
use shared_types::client::{Latest, MeasurementPublisher, Stream};
use shared_types::clock::monotonic_ns;
use shared_types::{Client, Estimate, LatencySummary, Measurement};
use std::sync::atomic::{AtomicBool, Ordering};

const TRIP_PATIENCE_NS: u64 = 1_000_000_000;
/// Samples of each client that are not timed: until the echo has connected, and all is in the caches.
const UNTIMED: usize = 100;

/// The calls of a loop, of either client; an estimate goes where the caller wants it, if there is one.
trait Calls {
    fn publish(&mut self, sample: &Measurement) -> anyhow::Result<bool>;
    fn take(&mut self, estimate: &mut Estimate) -> anyhow::Result<bool>;
    fn peek(&mut self, estimate: &mut Estimate) -> anyhow::Result<bool>;
}

struct Rust {
    samples: MeasurementPublisher,
    estimates: Stream<Estimate>,
    newest: Latest<Estimate>,
}

fn put(found: Option<Estimate>, estimate: &mut Estimate) -> bool {
    found.map(|found| *estimate = found).is_some()
}

impl Calls for Rust {
    fn publish(&mut self, sample: &Measurement) -> anyhow::Result<bool> {
        Ok(self.samples.publish(sample)? > 0)
    }

    fn take(&mut self, estimate: &mut Estimate) -> anyhow::Result<bool> {
        Ok(put(self.estimates.take()?, estimate))
    }

    fn peek(&mut self, estimate: &mut Estimate) -> anyhow::Result<bool> {
        Ok(put(self.newest.peek()?, estimate))
    }
}

struct ThroughC(Handle);

impl Calls for ThroughC {
    fn publish(&mut self, sample: &Measurement) -> anyhow::Result<bool> {
        through_c::publish(self.0, sample).map_err(|text| anyhow!(text))
    }

    fn take(&mut self, estimate: &mut Estimate) -> anyhow::Result<bool> {
        through_c::take(self.0, estimate).map_err(|text| anyhow!(text))
    }

    fn peek(&mut self, estimate: &mut Estimate) -> anyhow::Result<bool> {
        through_c::peek(self.0, estimate).map_err(|text| anyhow!(text))
    }
}

impl Drop for ThroughC {
    fn drop(&mut self) {
        observer_close(self.0);
    }
}

/// Times of one client's calls (ns).
#[derive(Default)]
struct Times {
    publish: Vec<u64>,
    take: Vec<u64>,
    peek: Vec<u64>,
}

fn timed<T>(call: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<(T, u64)> {
    let start_ns = monotonic_ns();
    let value = call()?;
    Ok((value, monotonic_ns() - start_ns))
}

/// One sample and its answer; whether both have come through.
fn trip(client: &mut impl Calls, vehicle: &mut MovingVehicle, times: &mut Times) -> anyhow::Result<bool> {
    let mut estimate = Estimate::default();
    // Answers to the other client came here as well.
    while client.take(&mut estimate)? {}
    client.peek(&mut estimate)?;
    let sample = vehicle.sample();
    let (_, publish_ns) = timed(|| client.publish(&sample))?;
    let take_ns = loop {
        match timed(|| client.take(&mut estimate))? {
            (true, take_ns) if estimate.source_sequence == sample.sequence => break take_ns,
            _ if monotonic_ns() - sample.stamp_ns > TRIP_PATIENCE_NS => return Ok(false),
            _ => {}
        }
    };
    let (found, peek_ns) = timed(|| client.peek(&mut estimate))?;
    if !found || estimate.source_sequence != sample.sequence {
        // The echo was between its two readers.
        return Ok(true);
    }
    times.publish.push(publish_ns);
    times.take.push(take_ns);
    times.peek.push(peek_ns);
    Ok(true)
}

/// One call, by both clients.
#[derive(Debug, Serialize)]
pub(crate) struct Call {
    pub(crate) call: &'static str,
    pub(crate) rust_ns: LatencySummary,
    pub(crate) c_ns: LatencySummary,
    /// Of the medians, without the clock's own time.
    pub(crate) c_over_rust_median: f64,
}

/// What the calls of both clients cost.
#[derive(Debug, Serialize)]
pub(crate) struct Comparison {
    /// What every time holds of the clock's own.
    pub(crate) clock_ns: u64,
    pub(crate) calls: Vec<Call>,
}

/// Compares the clients with the echo of `instance`, by `n_samples` of each.
pub(crate) fn compare(
    domain: &OwnDomain,
    instance: &str,
    n_samples: usize,
    stop: &AtomicBool,
) -> anyhow::Result<Comparison> {
    let client = Client::connect(domain.domain(), instance, PATIENCE)?;
    let mut rust = Rust {
        samples: client.measurement_publisher()?,
        estimates: client.estimate_subscriber()?,
        newest: client.latest_estimate()?,
    };
    let asked = ports::PUBLISH | ports::TAKE | ports::PEEK;
    let handle = through_c::open(domain.domain(), instance, asked, PATIENCE.as_secs_f64());
    let mut c = ThroughC(handle.map_err(|text| anyhow!(text))?);
    let mut vehicle = MovingVehicle::default();
    let (mut rust_times, mut c_times) = (Times::default(), Times::default());
    let mut silent = 0;
    for i in 0..UNTIMED + n_samples {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let both =
            trip(&mut rust, &mut vehicle, &mut rust_times)? & trip(&mut c, &mut vehicle, &mut c_times)?;
        silent = if both { 0 } else { silent + 1 };
        if silent == 3 {
            bail!("no answer within 1 s");
        }
        if i + 1 == UNTIMED {
            (rust_times, c_times) = (Times::default(), Times::default());
        }
    }
    let mut clock: Vec<u64> = (0..1000).map(|_| timed(|| Ok(())).map_or(0, |((), ns)| ns)).collect();
    let clock_ns = summary(&mut clock).map_or(0, |clock| clock.p50);
    let of = |call, rust: &mut Vec<u64>, c: &mut Vec<u64>| {
        let (rust_ns, c_ns) =
            summary(rust).zip(summary(c)).ok_or_else(|| anyhow!("stopped before the first call"))?;
        let own = |summary: LatencySummary| summary.p50.saturating_sub(clock_ns).max(1) as f64;
        Ok(Call { call, rust_ns, c_ns, c_over_rust_median: own(c_ns) / own(rust_ns) })
    };
    let calls: anyhow::Result<Vec<Call>> = [
        of("publish", &mut rust_times.publish, &mut c_times.publish),
        of("take", &mut rust_times.take, &mut c_times.take),
        of("peek", &mut rust_times.peek, &mut c_times.peek),
    ]
    .into_iter()
    .collect();
    Ok(Comparison { clock_ns, calls: calls? })
}
