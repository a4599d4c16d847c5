//! A step of adskalman's Kalman filter with 6 states and 3 outputs, the usual estimator of a vehicle without a force model.

use super::channel::{MASS_KG, STEP_S};
use crate::kalman::{Motion, Output};
use adskalman::{KalmanFilterNoControl, StateAndCovariance};
use anyhow::anyhow;
use nalgebra::{Matrix6, U6, Vector3, Vector6};

/// Velocity and a force that wanders at random, seen through the velocity.
pub(super) struct DisturbanceFilter {
    motion: Motion,
    output: Output,
    estimate: StateAndCovariance<f64, U6>,
    /// The first step that went wrong.
    failure: Option<String>,
}

impl DisturbanceFilter {
    pub(super) fn new() -> Self {
        Self {
            motion: Motion::new(MASS_KG, 1.0, STEP_S),
            output: Output::new(1e-4),
            estimate: StateAndCovariance::new(Vector6::zeros(), Matrix6::identity()),
            failure: None,
        }
    }

    /// One prediction and one update.
    pub(super) fn step(&mut self, output: &Vector3<f64>) {
        match KalmanFilterNoControl::new(&self.motion, &self.output).step(&self.estimate, output) {
            Ok(next) => self.estimate = next,
            Err(error) => self.failure = Some(error.to_string()),
        }
    }

    pub(super) fn check(&self) -> anyhow::Result<()> {
        self.failure.as_ref().map_or(Ok(()), |failure| {
            Err(anyhow!("the Kalman filter failed, so its time means nothing: {failure}"))
        })
    }
}
