//! Samples into shared memory, each at its own stamp.
//!
//! Stamps are made from the start of the run and the samples' own times, never from the time of waking up:
//! what is published is repeatable but for its start. A sample is published at its stamp or, where this
//! process was late, after it; never before.

use shared_types::client::{MeasurementPublisher, TruthPublisher};
use shared_types::clock::{monotonic_ns, sleep_until_ns};
use shared_types::{Client, ClientError, Domain, Measurement, Truth};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How long one look for the service lasts; a stop is noticed between two looks.
const CONNECT_PATIENCE: Duration = Duration::from_millis(200);
/// Time for readers to connect to new ports before the first sample (ns).
const SETTLING_NS: u64 = 50_000_000;
/// From the decision to start to the first stamp (ns).
const LEAD_NS: u64 = 20_000_000;
/// The longest sleep: a stop is noticed, and readers are let in, at least this often (ns).
const LONGEST_SLEEP_NS: u64 = 50_000_000;

/// What is to be published at one instant; stamps count from the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outgoing {
    /// The instant (ns).
    pub stamp_ns: u64,
    /// The true state, of a simulation.
    pub truth: Option<Truth>,
    /// The sample; `None` where it is lost on purpose.
    pub measurement: Option<Measurement>,
}

impl From<crate::SimulatedSample> for Outgoing {
    fn from(sample: crate::SimulatedSample) -> Self {
        let crate::SimulatedSample { measurement, truth } = sample;
        Self { stamp_ns: truth.stamp_ns, truth: Some(truth), measurement }
    }
}

impl From<Measurement> for Outgoing {
    fn from(measurement: Measurement) -> Self {
        Self { stamp_ns: measurement.stamp_ns, truth: None, measurement: Some(measurement) }
    }
}

/// What was published.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Published {
    /// CLOCK_MONOTONIC of the start (ns): stamp 0 of the source.
    pub start_stamp_ns: u64,
    /// Samples sent.
    pub samples_published: u64,
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

/// Connects to the service of `instance`; waits for it as long as `stop` is not set, telling `waiting` once.
///
/// `None` where the stop came first.
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

/// Publishes everything of `source` at `start + stamp / speed`, until it ends or `stop` is set.
///
/// Every payload carries `start + its own stamp` whatever the speed. The truth goes out just before the
/// measurement of the same instant, and alone where that sample is lost.
///
/// # Errors
/// `Service` or `Port` where a port cannot be made or refuses a sample.
pub fn publish(
    client: &Client,
    source: impl Iterator<Item = Outgoing>,
    speed: f64,
    stop: &AtomicBool,
) -> Result<Published, ClientError> {
    let mut source = source.peekable();
    let has_truth = source.peek().is_some_and(|first| first.truth.is_some());
    let ports = Ports {
        measurements: client.measurement_publisher()?,
        truths: has_truth.then(|| client.truth_publisher()).transpose()?,
    };
    wait_until(monotonic_ns() + SETTLING_NS, &ports, stop)?;

    let start_stamp_ns = monotonic_ns() + LEAD_NS;
    let mut published = Published { start_stamp_ns, ..Published::default() };
    for outgoing in source {
        let deadline_ns = start_stamp_ns + scaled(outgoing.stamp_ns, speed);
        if !wait_until(deadline_ns, &ports, stop)? {
            published.stopped = true;
            break;
        }
        ports.send(&outgoing, start_stamp_ns)?;
        published.count(&outgoing, monotonic_ns().saturating_sub(deadline_ns));
    }
    Ok(published)
}

/// Time of the wall for a time of the source; exact at speed 1.
fn scaled(stamp_ns: u64, speed: f64) -> u64 {
    if speed == 1.0 { stamp_ns } else { (stamp_ns as f64 / speed).round() as u64 }
}

struct Ports {
    measurements: MeasurementPublisher,
    truths: Option<TruthPublisher>,
}

impl Ports {
    fn send(&self, outgoing: &Outgoing, start_stamp_ns: u64) -> Result<(), ClientError> {
        if let (Some(port), Some(truth)) = (&self.truths, outgoing.truth) {
            port.publish(&Truth { stamp_ns: start_stamp_ns + truth.stamp_ns, ..truth })?;
        }
        match outgoing.measurement {
            Some(sample) => {
                let stamp_ns = start_stamp_ns + sample.stamp_ns;
                self.measurements.publish(&Measurement { stamp_ns, ..sample })?;
            }
            None => self.measurements.update_connections()?,
        }
        Ok(())
    }
}

impl Published {
    fn count(&mut self, outgoing: &Outgoing, lateness_ns: u64) {
        if outgoing.measurement.is_some() {
            self.samples_published += 1;
            self.samples_late += u64::from(lateness_ns > LATE_NS);
            self.largest_lateness_ns = self.largest_lateness_ns.max(lateness_ns);
        } else {
            self.samples_dropped += 1;
        }
        self.duration_ns = outgoing.stamp_ns;
    }
}

/// Sleeps until the deadline, letting readers in meanwhile; `false` where a stop came first.
fn wait_until(deadline_ns: u64, ports: &Ports, stop: &AtomicBool) -> Result<bool, ClientError> {
    loop {
        if stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        let now_ns = monotonic_ns();
        if now_ns >= deadline_ns {
            return Ok(true);
        }
        if deadline_ns - now_ns > LONGEST_SLEEP_NS {
            ports.measurements.update_connections()?;
        }
        sleep_until_ns(deadline_ns.min(now_ns + LONGEST_SLEEP_NS));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::Outage;
    use crate::{Scenario, Simulation, SimulationOptions};
    use shared_types::service::{self, Services};
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
            services.make_measurement().unwrap(),
            services.make_truth().unwrap(),
            services.make_estimate().unwrap(),
            services.make_status().unwrap(),
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
            let published = publish(&client, source.inspect(&mut receive), 1.0, &never).unwrap();
            assert_eq!((published.samples_published, published.samples_dropped), (30, 10));
            assert_eq!((published.duration_ns, published.stopped), (195_000_000, false));
            // What was sent last is still there when its source is gone.
            receive(&Outgoing { stamp_ns: 0, truth: None, measurement: None });

            let stamped = |stamp_ns| published.start_stamp_ns + stamp_ns;
            let simulated: Vec<_> = Simulation::new(&options).unwrap().collect();
            let truths = simulated.iter().map(|s| Truth { stamp_ns: stamped(s.truth.stamp_ns), ..s.truth });
            assert_eq!(got_truths, truths.collect::<Vec<_>>());
            let sent = simulated.iter().filter_map(|sample| sample.measurement);
            let sent = sent.map(|m| Measurement { stamp_ns: stamped(m.stamp_ns), ..m });
            assert_eq!(got_measurements, sent.collect::<Vec<_>>());
        });
    }

    #[test]
    fn a_faster_replay_keeps_the_samples_own_time() {
        with_services(|domain| {
            let never = AtomicBool::new(false);
            let client = connect(domain, "vehicle", &never, || ()).unwrap().unwrap();
            let mut measurements = client.measurement_subscriber().unwrap();
            let samples = (0..20u64).map(|k| Measurement::at(k * 100_000_000, k).with_velocity_m_s([0.0; 3]));
            let mut stamps_ns = Vec::new();
            let mut receive = |_: &Outgoing| {
                stamps_ns.extend(iter::from_fn(|| measurements.take().unwrap()).map(|m| m.stamp_ns));
            };
            let source = samples.map(Outgoing::from).inspect(&mut receive);
            let published = publish(&client, source, 50.0, &never).unwrap();
            receive(&Outgoing { stamp_ns: 0, truth: None, measurement: None });
            assert_eq!(published.duration_ns, 1_900_000_000);
            let expected = (0..20).map(|k| published.start_stamp_ns + k * 100_000_000);
            assert_eq!(stamps_ns, expected.collect::<Vec<_>>());
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
                    publish(&client, samples.map(Outgoing::from), 1.0, &never).unwrap();
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
            let published = publish(&client, stopping, 1.0, &stop).unwrap();
            assert_eq!((published.samples_published, published.stopped), (10, true));
        });
    }
}
