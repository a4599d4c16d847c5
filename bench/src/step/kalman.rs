//! adskalman's Kalman filter with 6 states and 3 outputs: what one would use who does not model the force.

use super::channel::STEP_S;
use adskalman::{
    KalmanFilterNoControl, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl,
};
use anyhow::anyhow;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Matrix6x3, U3, U6, Vector3, Vector6};

/// Velocity and a disturbance acceleration that wanders at random, seen through the velocity.
pub(super) struct DisturbanceFilter {
    model: DisturbanceModel,
    observation: VelocityObservation,
    estimate: StateAndCovariance<f64, U6>,
    /// The first that went wrong.
    failure: Option<String>,
}

impl DisturbanceFilter {
    pub(super) fn new() -> Self {
        Self {
            model: DisturbanceModel::new(),
            observation: VelocityObservation::new(),
            estimate: StateAndCovariance::new(Vector6::zeros(), Matrix6::identity()),
            failure: None,
        }
    }

    /// One prediction and one update.
    pub(super) fn step(&mut self, output: &Vector3<f64>) {
        match KalmanFilterNoControl::new(&self.model, &self.observation).step(&self.estimate, output) {
            Ok(next) => self.estimate = next,
            Err(error) => self.failure = Some(error.to_string()),
        }
    }

    /// # Errors
    /// A step that failed.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        self.failure.as_ref().map_or(Ok(()), |failure| {
            Err(anyhow!("the Kalman filter failed, so its time means nothing: {failure}"))
        })
    }
}

struct DisturbanceModel {
    transition: Matrix6<f64>,
    transition_transposed: Matrix6<f64>,
    process_noise: Matrix6<f64>,
}

impl TransitionModelLinearNoControl<f64, U6> for DisturbanceModel {
    fn F(&self) -> &Matrix6<f64> {
        &self.transition
    }
    fn FT(&self) -> &Matrix6<f64> {
        &self.transition_transposed
    }
    fn Q(&self) -> &Matrix6<f64> {
        &self.process_noise
    }
}

struct VelocityObservation {
    observation: Matrix3x6<f64>,
    observation_transposed: Matrix6x3<f64>,
    noise: Matrix3<f64>,
}

impl ObservationModel<f64, U6, U3> for VelocityObservation {
    fn H(&self) -> &Matrix3x6<f64> {
        &self.observation
    }
    fn HT(&self) -> &Matrix6x3<f64> {
        &self.observation_transposed
    }
    fn R(&self) -> &Matrix3<f64> {
        &self.noise
    }
}

impl DisturbanceModel {
    fn new() -> Self {
        let mut transition = Matrix6::identity();
        transition.fixed_view_mut::<3, 3>(0, 3).fill_diagonal(STEP_S);
        let process_noise = Matrix6::from_diagonal(&Vector6::from_fn(|i, _| if i < 3 { 1e-6 } else { 1e-3 }));
        Self { transition, transition_transposed: transition.transpose(), process_noise }
    }
}

impl VelocityObservation {
    fn new() -> Self {
        let mut observation = Matrix3x6::zeros();
        observation.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(1.0);
        Self {
            observation,
            observation_transposed: observation.transpose(),
            noise: Matrix3::identity() * 1e-4,
        }
    }
}
