//! What the joint filter estimates, and all that its future depends on.

use super::axes::Axes;
use super::command::CommandStatistics;
use super::covariance::Covariance;
use super::excitation::Excitation;
use super::lags::Lags;
use super::noise_levels::NoiseLevels;
use super::rows::{KERNEL, POSITION, VELOCITY, WEIGHTS};
use super::stray::StraySamples;
use nalgebra::{DMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// All that the filter's future depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct JointState {
    /// X, one column for each axis, of whole lanes.
    pub(crate) mean: [Vec<f64>; 3],
    /// P of each axis; only the first is in use while they are shared.
    pub(crate) covariances: [Covariance; 3],
    pub(crate) excitation: Excitation,
    /// All that has a fixed size.
    pub(crate) scalars: JointScalars,
}

/// The part of a [`JointState`] that has a fixed size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct JointScalars {
    /// Whether a first output was seen.
    pub(crate) is_started: bool,
    /// Whether one covariance stands for all axes.
    pub(crate) is_shared: bool,
    pub(crate) stray_velocities: StraySamples,
    /// One for each component: they are gated one by one.
    pub(crate) stray_positions: [StraySamples; 3],
    /// Components of the position that a fix has set.
    pub(crate) position_is_known: [bool; 3],
    pub(crate) noise_levels: NoiseLevels,
    /// J of a coast with an accelerometer, else 0 (1/s).
    pub(crate) slope_per_s: f64,
    /// Of the features.
    pub(crate) axes: Axes,
    pub(crate) lags: Lags,
    pub(crate) command: CommandStatistics,
}

impl JointScalars {
    pub(crate) fn new() -> Self {
        Self {
            is_started: false,
            is_shared: true,
            stray_velocities: StraySamples::default(),
            stray_positions: [StraySamples::default(); 3],
            position_is_known: [false; 3],
            noise_levels: NoiseLevels::configured(),
            slope_per_s: 0.0,
            axes: Axes::default(),
            lags: Lags::unknown(),
            command: CommandStatistics::unknown(),
        }
    }
}

impl JointState {
    /// Velocity (m/s; rad/s) and position (m) before the first output, where they are known. The first output replaces the
    /// velocity.
    pub(crate) fn set_motion(&mut self, velocity: Option<Vector3<f64>>, position: Option<Vector3<f64>>) {
        for axis in 0..3 {
            self.mean[axis][VELOCITY] = velocity.map_or(0.0, |velocity| velocity[axis]);
            self.mean[axis][POSITION] = position.map_or(0.0, |position| position[axis]);
        }
        self.scalars.position_is_known = [position.is_some(); 3];
    }

    /// Becomes equal to another state of the same filter. No allocation.
    pub fn copy_from(&mut self, other: &Self) {
        for (own, other) in self.mean.iter_mut().zip(&other.mean) {
            own.copy_from_slice(other);
        }
        let n_covariances = if other.scalars.is_shared { 1 } else { 3 };
        for (own, other) in self.covariances.iter_mut().zip(&other.covariances).take(n_covariances) {
            own.copy_from(other);
        }
        self.excitation.copy_from(&other.excitation);
        self.scalars = other.scalars;
    }

    /// How many numbers [`JointState::write`] writes, of n rows.
    pub(crate) fn n_numbers(n: usize) -> usize {
        3 * n + 3 * (n * (n + 1) / 2) + n + Axes::N_NUMBERS
    }

    /// X, the lower triangle of each axis's P, ψ̄, and the axes of the features. No allocation.
    pub(crate) fn write(&mut self, n: usize, numbers: &mut [f64]) {
        self.covariances_in_use_mut().iter_mut().for_each(Covariance::settle);
        let mut rest = numbers;
        let mut put = |values: &[f64]| {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(values.len());
            own.copy_from_slice(values);
            rest = others;
        };
        self.mean.iter().for_each(|mean| put(&mean[..n]));
        for axis in 0..3 {
            let covariance = self.covariance(axis);
            (0..n).for_each(|i| (0..=i).for_each(|j| put(&[covariance.at(i, j)])));
        }
        put(&self.excitation.mean[..n]);
        put(&self.scalars.axes.numbers());
    }

    /// Takes over what another state of the same filter has written. No allocation.
    pub(crate) fn read(&mut self, n: usize, numbers: &[f64]) {
        let mut rest = numbers;
        let mut take = |length: usize| {
            let (own, others) = rest.split_at(length);
            rest = others;
            own
        };
        self.mean.iter_mut().for_each(|mean| mean[..n].copy_from_slice(take(n)));
        for covariance in &mut self.covariances {
            for i in 0..n {
                take(i + 1).iter().enumerate().for_each(|(j, &value)| covariance.set(i, j, value));
            }
        }
        self.excitation.mean[..n].copy_from_slice(take(n));
        self.scalars.axes = Axes::of_numbers(take(Axes::N_NUMBERS));
    }

    /// P of one axis.
    pub(crate) fn covariance(&self, axis: usize) -> &Covariance {
        &self.covariances[if self.scalars.is_shared { 0 } else { axis }]
    }

    /// Whether a first output was seen.
    pub fn is_started(&self) -> bool {
        self.scalars.is_started
    }

    pub(crate) fn covariances_in_use_mut(&mut self) -> &mut [Covariance] {
        let n_covariances = if self.scalars.is_shared { 1 } else { 3 };
        &mut self.covariances[..n_covariances]
    }

    /// v̂ (m/s; rad/s).
    pub fn velocity(&self) -> [f64; 3] {
        self.row(VELOCITY)
    }

    /// r̂ (m).
    pub fn position(&self) -> [f64; 3] {
        self.row(POSITION)
    }

    fn row(&self, row: usize) -> [f64; 3] {
        std::array::from_fn(|axis| self.mean[axis][row])
    }

    /// √P of the velocity, one for each axis (m/s; rad/s).
    pub fn velocity_std(&self) -> [f64; 3] {
        self.std_of_row(VELOCITY)
    }

    /// √P of the position, one for each axis (m).
    pub fn position_std(&self) -> [f64; 3] {
        self.std_of_row(POSITION)
    }

    fn std_of_row(&self, row: usize) -> [f64; 3] {
        let std_of = |covariance: &Covariance| covariance.at(row, row).max(0.0).sqrt();
        match self.scalars.is_shared {
            true => [std_of(&self.covariances[0]); 3],
            false => self.covariances.each_ref().map(std_of),
        }
    }

    /// ‖θ‖.
    pub fn weights_norm(&self) -> f64 {
        (0..3).map(|axis| self.weights_square(axis)).sum::<f64>().sqrt()
    }

    /// ‖θ‖² of one axis: the square of the native norm of what was learned of it. Its prior mean is p, the number of weights.
    pub fn weights_square(&self, axis: usize) -> f64 {
        let column = &self.mean[axis];
        let theta = column[WEIGHTS..POSITION].iter().chain(&column[KERNEL..]);
        theta.map(|weight| weight * weight).sum()
    }

    /// tr P_θθ of one axis.
    pub fn weights_trace(&self, axis: usize) -> f64 {
        let covariance = self.covariance(axis);
        let rows = (WEIGHTS..POSITION).chain(KERNEL..self.mean[0].len());
        rows.map(|row| covariance.at(row, row)).sum()
    }

    /// P of one axis without the position: rows of the velocity, the disturbance, the p weights. Allocates.
    pub fn covariance_matrix(&self, axis: usize, n_weights: usize) -> DMatrix<f64> {
        let row = |i: usize| if i < POSITION { i } else { i + KERNEL - POSITION };
        DMatrix::from_fn(WEIGHTS + n_weights, WEIGHTS + n_weights, |i, k| {
            self.covariance(axis).at(row(i), row(k))
        })
    }

    /// ρ and λ, the levels of the first sensor's and of the process's noise variance: 1 as configured.
    pub fn noise_levels(&self) -> (f64, f64) {
        (self.scalars.noise_levels.sensor[0], self.scalars.noise_levels.process)
    }

    /// g, the part of the features' variation that teaches: 0 … 1.
    pub fn teaching(&self) -> f64 {
        self.excitation.teaching
    }
}
