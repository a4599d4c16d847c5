//! Deliveries: what is on its way from the source to the service.

use crate::simulation::SimulatedSample;
use shared_types::{Measurement, Truth};

/// A sample on its way; times count from the start of the run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delivery {
    /// When it is sent (ns).
    pub at_ns: u64,
    /// The sample, with its true stamp.
    pub measurement: Measurement,
    /// How far the source's clock is wrong (ns); ahead where positive.
    pub clock_error_ns: i64,
    /// Which of the run's publishers sends it.
    pub source: usize,
}

/// What is to be published at one instant; stamps count from the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outgoing {
    /// The instant (ns).
    pub at_ns: u64,
    /// The true state, of a simulation.
    pub truth: Option<Truth>,
    /// The sample that is sent, if any.
    pub delivery: Option<Delivery>,
    /// Whether a sample of this instant is lost on purpose.
    pub is_lost: bool,
}

impl From<Delivery> for Outgoing {
    fn from(delivery: Delivery) -> Self {
        Self { at_ns: delivery.at_ns, truth: None, delivery: Some(delivery), is_lost: false }
    }
}

impl From<Measurement> for Outgoing {
    fn from(measurement: Measurement) -> Self {
        Delivery { at_ns: measurement.stamp_ns, measurement, clock_error_ns: 0, source: 0 }.into()
    }
}

impl From<SimulatedSample> for Outgoing {
    fn from(sample: SimulatedSample) -> Self {
        let SimulatedSample { measurement, truth, .. } = sample;
        let delivery = measurement.and_then(|measurement| Self::from(measurement).delivery);
        Self { at_ns: truth.stamp_ns, truth: Some(truth), delivery, is_lost: measurement.is_none() }
    }
}
