//! Publishes samples in shared memory, each at its stamp.
//!
//! Stamps follow from the start of the run and the samples' own times, not from the times of waking up, so a run is
//! repeatable except for its start. A sample is published at its stamp or, if this process is late, after it; never before.

use crate::delivery::{Delivery, Outgoing};
use serde::{Deserialize, Serialize};
use shared_types::client::{MeasurementPublisher, TruthPublisher};
use shared_types::clock::{monotonic_ns, sleep_until_ns};
use shared_types::{Client, ClientError, Domain, Measurement, Truth};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How long one search for the service lasts; a stop is noticed between two searches.
const CONNECT_PATIENCE: Duration = Duration::from_millis(200);
/// Time for readers to connect to new ports before the first sample (ns).
const SETTLING_NS: u64 = 50_000_000;
/// From the decision to start to the first stamp (ns).
const LEAD_NS: u64 = 20_000_000;
/// The longest sleep: stop requests and new readers are handled at least this often (ns).
const MAX_SLEEP_NS: u64 = 50_000_000;

/// The relation of the source's time to real time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// How many times faster than its stamps.
    pub speed: f64,
    /// CLOCK_MONOTONIC of a start in the past (ns), of a run that another process began: what was due until now is
    /// skipped. `None` starts now.
    pub resumed_start_ns: Option<u64>,
    /// How many publishers send at once: [`Delivery::source`] counts them.
    pub n_sources: usize,
}

impl Pace {
    /// As fast as the stamps, from now on.
    pub fn live() -> Self {
        Self { speed: 1.0, resumed_start_ns: None, n_sources: 1 }
    }
}

/// What was published.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Published {
    /// CLOCK_MONOTONIC of the start (ns): stamp 0 of the source.
    pub start_stamp_ns: u64,
    /// Samples sent.
    pub samples_published: u64,
    /// Samples that were due before this process could send, of a run that another one began.
    pub samples_skipped: u64,
    /// Samples lost on purpose.
    pub samples_dropped: u64,
    /// Samples sent more than 1 ms after their deadline.
    pub samples_late: u64,
    /// The largest delay of a sample behind its deadline (ns).
    pub largest_lateness_ns: u64,
    /// From the start to the last instant that was served, in the source's time (ns).
    pub duration_ns: u64,
    /// Whether a stop came before the source's end.
    pub stopped: bool,
}

/// A later publication counts as late (ns).
const LATE_NS: u64 = 1_000_000;

/// Connects to the service of `instance`. Waits for it until `stop` is set; `waiting` is called once if it must wait.
///
/// `None` if it was stopped first.
///
/// # Errors
/// As [`Client::connect`], `NoDaemon` excepted.
pub fn connect(
    domain: &Domain,
    instance: &str,
    stop: &AtomicBool,
    waiting: impl FnOnce(),
) -> Result<Option<Client>, ClientError> {
    let mut waiting = Some(waiting);
    while !stop.load(Ordering::Relaxed) {
        match Client::connect(domain, instance, CONNECT_PATIENCE) {
            Ok(client) => return Ok(Some(client)),
            Err(ClientError::NoDaemon { .. }) => {
                if let Some(tell) = waiting.take() {
                    tell();
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(None)
}

/// Publishes everything of `source` at `start + instant / speed`, until it ends or `stop` is set. `started` is called
/// just before the first sample, with the start and the number of skipped samples.
///
/// Every payload carries `start + its own stamp` at any speed. The truth is published just before the
/// measurement of the same instant, and alone if that sample is lost.
///
/// # Errors
/// `Service` or `Port` where a port cannot be made or refuses a sample.
pub fn publish(
    client: &Client,
    source: impl Iterator<Item = Outgoing>,
    pace: Pace,
    stop: &AtomicBool,
    started: impl FnOnce(&Published),
) -> Result<Published, ClientError> {
    let mut source = source.peekable();
    let has_truth = source.peek().is_some_and(|first| first.truth.is_some());
    let ports = Ports {
        measurements: (0..pace.n_sources)
            .map(|_| client.measurement_publisher())
            .collect::<Result<_, _>>()?,
        truths: has_truth.then(|| client.truth_publisher()).transpose()?,
    };
    wait_until(monotonic_ns() + SETTLING_NS, &ports, stop)?;

    let ready_ns = monotonic_ns() + LEAD_NS;
    let start_stamp_ns = pace.resumed_start_ns.unwrap_or(ready_ns);
    let deadline_ns = |at_ns: u64| start_stamp_ns + scaled(at_ns, pace.speed);
    let mut published = Published { start_stamp_ns, ..Published::default() };
    while let Some(overdue) = source.next_if(|outgoing| deadline_ns(outgoing.at_ns) < ready_ns) {
        published.skip(&overdue);
    }
    started(&published);
    for outgoing in source {
        let deadline_ns = deadline_ns(outgoing.at_ns);
        if !wait_until(deadline_ns, &ports, stop)? {
            published.stopped = true;
            break;
        }
        ports.send(&outgoing, start_stamp_ns)?;
        published.count(&outgoing, monotonic_ns().saturating_sub(deadline_ns));
    }
    Ok(published)
}

/// Converts the source's time to real time; exact at speed 1.
fn scaled(stamp_ns: u64, speed: f64) -> u64 {
    if speed == 1.0 { stamp_ns } else { (stamp_ns as f64 / speed).round() as u64 }
}

struct Ports {
    measurements: Vec<MeasurementPublisher>,
    truths: Option<TruthPublisher>,
}

impl Ports {
    fn send(&self, outgoing: &Outgoing, start_stamp_ns: u64) -> Result<(), ClientError> {
        if let (Some(port), Some(truth)) = (&self.truths, outgoing.truth) {
            port.publish(&Truth { stamp_ns: start_stamp_ns + truth.stamp_ns, ..truth })?;
        }
        match outgoing.delivery {
            Some(Delivery { measurement, clock_error_ns, source, .. }) => {
                let true_stamp_ns = start_stamp_ns + measurement.stamp_ns;
                let stamp_ns = true_stamp_ns.saturating_add_signed(clock_error_ns);
                self.measurements[source].publish(&Measurement { stamp_ns, ..measurement })?;
            }
            None => self.update_connections()?,
        }
        Ok(())
    }

    fn update_connections(&self) -> Result<(), ClientError> {
        self.measurements.iter().try_for_each(MeasurementPublisher::update_connections)
    }
}

impl Published {
    fn count(&mut self, outgoing: &Outgoing, lateness_ns: u64) {
        if outgoing.delivery.is_some() {
            self.samples_published += 1;
            self.samples_late += u64::from(lateness_ns > LATE_NS);
            self.largest_lateness_ns = self.largest_lateness_ns.max(lateness_ns);
        }
        self.samples_dropped += u64::from(outgoing.is_lost);
        self.duration_ns = outgoing.at_ns;
    }

    /// Adds what another process published of the same run.
    pub fn add(&mut self, other: &Self) {
        self.samples_published += other.samples_published;
        self.samples_skipped += other.samples_skipped;
        self.samples_dropped += other.samples_dropped;
        self.samples_late += other.samples_late;
        self.largest_lateness_ns = self.largest_lateness_ns.max(other.largest_lateness_ns);
        self.duration_ns = self.duration_ns.max(other.duration_ns);
        self.stopped |= other.stopped;
    }

    fn skip(&mut self, overdue: &Outgoing) {
        self.samples_skipped += u64::from(overdue.delivery.is_some());
        self.samples_dropped += u64::from(overdue.is_lost);
        self.duration_ns = overdue.at_ns;
    }
}

/// Sleeps until the deadline and connects new readers meanwhile; `false` if it was stopped first.
fn wait_until(deadline_ns: u64, ports: &Ports, stop: &AtomicBool) -> Result<bool, ClientError> {
    loop {
        if stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        let now_ns = monotonic_ns();
        if now_ns >= deadline_ns {
            return Ok(true);
        }
        if deadline_ns - now_ns > MAX_SLEEP_NS {
            ports.update_connections()?;
        }
        sleep_until_ns(deadline_ns.min(now_ns + MAX_SLEEP_NS));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::Outage;
    use crate::{Scenario, Simulation, SimulationOptions};
    use shared_types::service::{self, Services};
    use shared_types::{Estimate, Status};
    use std::{iter, thread};

    /// The services that a daemon makes, in a domain of the test's own.
    fn with_services(test: impl FnOnce(&Domain)) {
        let root = tempfile::Builder::new().prefix("os").tempdir_in("/dev/shm").unwrap();
        let domain = Domain::at(root.path()).unwrap();
        let node = {
            let _making = domain.lock_for_making().unwrap();
            service::node(&domain, "stand-in").unwrap()
        };
        let services = Services::of(&node, "vehicle").unwrap();
        let making = domain.lock_for_making().unwrap();
        let made = (
            services.make::<Measurement>().unwrap(),
            services.make::<Truth>().unwrap(),
            services.make::<Estimate>().unwrap(),
            services.make::<Status>().unwrap(),
            services.make_control().unwrap(),
        );
        drop(making);
        test(&domain);
        drop(made);
        drop(node);
        domain.remove().unwrap();
    }

    #[test]
    fn what_is_published_is_what_was_simulated_at_its_own_stamp() {
        with_services(|domain| {
            let options = SimulationOptions {
                duration_s: Some(0.2),
                outages: vec![Outage { start_s: 0.05, length_s: 0.05 }],
                ..SimulationOptions::of(Scenario::RigidBody)
            };
            let never = AtomicBool::new(false);
            let client = connect(domain, "vehicle", &never, || panic!("it is there")).unwrap().unwrap();
            let mut measurements = client.measurement_subscriber().unwrap();
            let mut truths = client.truth_subscriber().unwrap();
            let (mut got_measurements, mut got_truths) = (Vec::new(), Vec::new());
            let mut receive = |_: &Outgoing| {
                got_measurements.extend(iter::from_fn(|| measurements.take().unwrap()));
                got_truths.extend(iter::from_fn(|| truths.take().unwrap()));
            };
            let source = Simulation::new(&options).unwrap().map(Outgoing::from);
            let published =
                publish(&client, source.inspect(&mut receive), Pace::live(), &never, |_| ()).unwrap();
            assert_eq!((published.samples_published, published.samples_dropped), (30, 10));
            assert_eq!((published.duration_ns, published.stopped), (195_000_000, false));
            // The last message is still there after its source has ended.
            receive(&Outgoing { at_ns: 0, truth: None, delivery: None, is_lost: false });

            let stamped = |stamp_ns| published.start_stamp_ns + stamp_ns;
            let simulated: Vec<_> = Simulation::new(&options).unwrap().collect();
            let truths = simulated.iter().map(|s| Truth { stamp_ns: stamped(s.truth.stamp_ns), ..s.truth });
            assert_eq!(got_truths, truths.collect::<Vec<_>>());
            let sent = simulated.iter().filter_map(|sample| sample.measurement);
            let sent = sent.map(|m| Measurement { stamp_ns: stamped(m.stamp_ns), ..m });
            assert_eq!(got_measurements, sent.collect::<Vec<_>>());
        });
    }

    /// Publishes samples of this period; gives what was published, skipped before the start, and received.
    fn sent(domain: &Domain, n: u64, period_ns: u64, pace: Pace) -> (Published, u64, Vec<Measurement>) {
        let never = AtomicBool::new(false);
        let client = connect(domain, "vehicle", &never, || ()).unwrap().unwrap();
        let mut measurements = client.measurement_subscriber().unwrap();
        let samples = (0..n).map(|k| Measurement::at(k * period_ns, k).with_velocity_m_s([0.0; 3]));
        let (mut skipped, mut received) = (0, Vec::new());
        let mut receive = |_: &Outgoing| received.extend(iter::from_fn(|| measurements.take().unwrap()));
        let source = samples.map(Outgoing::from).inspect(&mut receive);
        let published = publish(&client, source, pace, &never, |p| skipped = p.samples_skipped).unwrap();
        receive(&Outgoing { at_ns: 0, truth: None, delivery: None, is_lost: false });
        (published, skipped, received)
    }

    #[test]
    fn a_faster_replay_keeps_the_samples_own_time() {
        with_services(|domain| {
            let (published, _, received) =
                sent(domain, 20, 100_000_000, Pace { speed: 50.0, ..Pace::live() });
            assert_eq!(published.duration_ns, 1_900_000_000);
            let expected: Vec<_> = (0..20).map(|k| published.start_stamp_ns + k * 100_000_000).collect();
            assert_eq!(received.iter().map(|m| m.stamp_ns).collect::<Vec<_>>(), expected);
        });
    }

    #[test]
    fn a_run_that_another_process_began_is_continued_at_its_own_instants() {
        with_services(|domain| {
            let start_ns = monotonic_ns() - 300_000_000;
            let pace = Pace { resumed_start_ns: Some(start_ns), ..Pace::live() };
            let (published, skipped, received) = sent(domain, 60, 10_000_000, pace);
            // At least what was due when it was called, and all else is sent with its own stamp.
            assert!(skipped >= 30, "{skipped} skipped");
            assert_eq!((published.samples_skipped, published.samples_published), (skipped, 60 - skipped));
            let expected: Vec<_> = (skipped..60).map(|k| (k, start_ns + k * 10_000_000)).collect();
            assert_eq!(received.iter().map(|m| (m.sequence, m.stamp_ns)).collect::<Vec<_>>(), expected);
        });
    }

    #[test]
    fn no_sample_is_published_before_its_stamp() {
        with_services(|domain| {
            let never = AtomicBool::new(false);
            let client = connect(domain, "vehicle", &never, || ()).unwrap().unwrap();
            let mut measurements = client.measurement_subscriber().unwrap();
            let samples = (0..50u64).map(|k| Measurement::at(k * 2_000_000, k).with_velocity_m_s([0.0; 3]));
            thread::scope(|scope| {
                // Ports stay on their thread: the publishing side makes its own connection.
                scope.spawn(|| {
                    let client = connect(domain, "vehicle", &never, || ()).unwrap().unwrap();
                    let source = samples.map(Outgoing::from);
                    publish(&client, source, Pace::live(), &never, |_| ()).unwrap();
                });
                for _ in 0..50 {
                    let sample = measurements.wait_next(Duration::from_secs(30)).unwrap();
                    assert!(sample.stamp_ns <= monotonic_ns(), "sample {} came early", sample.sequence);
                }
            });
        });
    }

    #[test]
    fn a_stop_ends_waiting_for_a_service_and_publishing() {
        let root = tempfile::Builder::new().prefix("os").tempdir_in("/dev/shm").unwrap();
        let domain = Domain::at(root.path()).unwrap();
        let stop = AtomicBool::new(false);
        let told = std::cell::Cell::new(0);
        let tell = || {
            told.set(told.get() + 1);
            stop.store(true, Ordering::Relaxed);
        };
        assert!(connect(&domain, "vehicle", &stop, tell).unwrap().is_none());
        assert_eq!(told.get(), 1);
        domain.remove().unwrap();
        with_services(|domain| {
            let stop = AtomicBool::new(false);
            let client = connect(domain, "vehicle", &stop, || ()).unwrap().unwrap();
            let endless = Simulation::new(&SimulationOptions::of(Scenario::Translation)).unwrap();
            let stopping = endless.map(Outgoing::from).inspect(|outgoing| {
                stop.store(outgoing.truth.unwrap().sequence == 10, Ordering::Relaxed);
            });
            let published = publish(&client, stopping, Pace::live(), &stop, |_| ()).unwrap();
            assert_eq!((published.samples_published, published.stopped), (10, true));
        });
    }
}
