//! A thread that records every message of an instance while a test runs.

use crate::domain::TestDomain;
use crate::wait::PATIENCE;
use shared_types::{Estimate, Measurement, Status, Truth};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

/// The recorded messages of the instance `vehicle`, by sequence.
#[derive(Debug, Default)]
pub struct Heard {
    /// Samples of all sources.
    pub measurements: BTreeMap<u64, Measurement>,
    /// Estimates of all services.
    pub estimates: BTreeMap<u64, Estimate>,
    /// True states.
    pub truths: BTreeMap<u64, Truth>,
    /// Statuses.
    pub statuses: BTreeMap<u64, Status>,
}

/// A thread that reads often enough that no queue overflows; the shortest holds 64 samples.
pub struct Recorder {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Heard>,
}

impl Recorder {
    /// Starts it, and waits until it listens. The service must run.
    pub fn start(domain: &TestDomain) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (ready, is_ready) = mpsc::channel();
        let (its_stop, domain) = (stop.clone(), domain.domain.clone());
        let thread = std::thread::spawn(move || {
            let client = shared_types::Client::connect(&domain, "vehicle", PATIENCE).unwrap();
            let mut measurements = client.measurement_subscriber().unwrap();
            let mut estimates = client.estimate_subscriber().unwrap();
            let mut truths = client.truth_subscriber().unwrap();
            let mut statuses = client.status_subscriber().unwrap();
            ready.send(()).unwrap();
            let mut heard = Heard::default();
            loop {
                let is_last = its_stop.load(Ordering::Relaxed);
                while let Some(sample) = measurements.take().unwrap() {
                    heard.measurements.insert(sample.sequence, sample);
                }
                while let Some(estimate) = estimates.take().unwrap() {
                    heard.estimates.insert(estimate.sequence, estimate);
                }
                while let Some(truth) = truths.take().unwrap() {
                    heard.truths.insert(truth.sequence, truth);
                }
                while let Some(status) = statuses.take().unwrap() {
                    heard.statuses.insert(status.sequence, status);
                }
                if is_last {
                    return heard;
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        is_ready.recv_timeout(PATIENCE).unwrap();
        Self { stop, thread }
    }

    /// Ends it and returns the messages.
    pub fn finish(self) -> Heard {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}
