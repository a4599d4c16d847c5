//! The Kalman filter with which the observer is compared: a random-walk force per axis, with the crate `adskalman`.
//!
//! ```text
//! v' = (u + f)/m,   f' = w,   y = v + δ        w white with density q (N²/s), δ white with variance r
//! ```

use adskalman::{
    CovarianceUpdateMethod, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl,
};
use anyhow::Context;
use daemon::config::{LawName, TranslationConfig};
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Matrix6x3, OMatrix, U3, U6, Vector3, Vector6};

/// The filter's densities that are tried, in half decades from 1e-2 to 1e6 for a mass of 2.2 kg (N²/s).
pub(crate) fn densities_n2_s(mass_kg: f64) -> [f64; 17] {
    let scale = (mass_kg / 2.2).powi(2);
    std::array::from_fn(|index| scale * 10_f64.powf(-2.0 + 0.5 * index as f64))
}

/// r, the variance of the measured velocity (m²/s²): the mean over the axes.
pub(crate) fn noise_variance_m2_s2(translation: &TranslationConfig) -> anyhow::Result<f64> {
    let variance = match translation.law {
        LawName::Joint => {
            let noise = translation.velocity_noise_m_s.context("the joint law without velocity_noise_m_s")?;
            <[f64; 3]>::from(noise).map(|noise| noise * noise).iter().sum::<f64>() / 3.0
        }
        // A bound on the norm of three axes, of three deviations each.
        LawName::Gradient => {
            let bound = translation.noise_bound_m_s.context("the gradient law without noise_bound_m_s")?;
            (bound / 3.0).powi(2) / 3.0
        }
    };
    Ok(variance.max(1e-8))
}

/// State (v, f), its covariance, and the model.
#[derive(Debug, Clone)]
pub(crate) struct KalmanFilter {
    mass_kg: f64,
    force_density_n2_s: f64,
    output: Output,
    estimate: StateAndCovariance<f64, U6>,
}

impl KalmanFilter {
    /// A filter that starts at rest with an unknown force of about 10 N.
    pub(crate) fn new(mass_kg: f64, force_density_n2_s: f64, noise_variance_m2_s2: f64) -> Self {
        let mut covariance = Matrix6::identity() * 100.0;
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * noise_variance_m2_s2));
        Self {
            mass_kg,
            force_density_n2_s,
            output: Output::new(noise_variance_m2_s2),
            estimate: StateAndCovariance::new(Vector6::zeros(), covariance),
        }
    }

    /// Starts at a measured velocity (m/s) instead.
    pub(crate) fn start_at(&mut self, velocity: &Vector3<f64>) {
        let mut state = Vector6::zeros();
        state.fixed_rows_mut::<3>(0).copy_from(velocity);
        self.estimate = StateAndCovariance::new(state, *self.estimate.covariance());
    }

    /// Predicts over `h_s` seconds under a held command `input_n` (N).
    pub(crate) fn predict(&mut self, input_n: &Vector3<f64>, h_s: f64) {
        let motion = Motion::new(self.mass_kg, self.force_density_n2_s, h_s);
        let prior = motion.predict(&self.estimate);
        let mut state = *prior.state();
        let driven = state.fixed_rows::<3>(0) + h_s / self.mass_kg * input_n;
        state.fixed_rows_mut::<3>(0).copy_from(&driven);
        self.estimate = StateAndCovariance::new(state, *prior.covariance());
    }

    /// Corrects with a measured velocity (m/s).
    pub(crate) fn correct(&mut self, velocity: &Vector3<f64>) -> anyhow::Result<()> {
        let method = CovarianceUpdateMethod::JosephForm;
        self.estimate = self
            .output
            .update(&self.estimate, velocity, method)
            .map_err(|error| anyhow::anyhow!("the Kalman filter's covariance broke down: {error:?}"))?;
        Ok(())
    }

    /// f̂ (N).
    #[cfg(test)]
    pub(crate) fn force_n(&self) -> Vector3<f64> {
        self.estimate.state().fixed_rows::<3>(3).into()
    }

    /// v̂ (m/s).
    pub(crate) fn velocity_m_s(&self) -> Vector3<f64> {
        self.estimate.state().fixed_rows::<3>(0).into()
    }
}

/// How (v, f) moves over a time h.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    transition: Matrix6<f64>,
    transposed: Matrix6<f64>,
    noise: Matrix6<f64>,
}

impl Motion {
    pub(crate) fn new(mass_kg: f64, q: f64, h: f64) -> Self {
        let identity = Matrix3::identity();
        let mut transition = Matrix6::identity();
        transition.fixed_view_mut::<3, 3>(0, 3).copy_from(&(identity * (h / mass_kg)));
        let mut noise = Matrix6::zeros();
        let cross = identity * (q * h * h / (2.0 * mass_kg));
        noise
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(identity * (q * h.powi(3) / (3.0 * mass_kg * mass_kg))));
        noise.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        noise.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross);
        noise.fixed_view_mut::<3, 3>(3, 3).copy_from(&(identity * (q * h)));
        Self { transition, transposed: transition.transpose(), noise }
    }
}

#[allow(non_snake_case)] // the crate's names
impl TransitionModelLinearNoControl<f64, U6> for Motion {
    fn F(&self) -> &OMatrix<f64, U6, U6> {
        &self.transition
    }
    fn FT(&self) -> &OMatrix<f64, U6, U6> {
        &self.transposed
    }
    fn Q(&self) -> &OMatrix<f64, U6, U6> {
        &self.noise
    }
}

/// The velocity is measured.
#[derive(Debug, Clone)]
pub(crate) struct Output {
    matrix: Matrix3x6<f64>,
    transposed: Matrix6x3<f64>,
    noise: Matrix3<f64>,
}

impl Output {
    pub(crate) fn new(variance: f64) -> Self {
        let matrix = Matrix3x6::identity();
        Self { matrix, transposed: matrix.transpose(), noise: Matrix3::identity() * variance }
    }
}

#[allow(non_snake_case)] // the crate's names
impl ObservationModel<f64, U6, U3> for Output {
    fn H(&self) -> &OMatrix<f64, U3, U6> {
        &self.matrix
    }
    fn HT(&self) -> &OMatrix<f64, U6, U3> {
        &self.transposed
    }
    fn R(&self) -> &OMatrix<f64, U3, U3> {
        &self.noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A constant force of 3 N on 2 kg is found, and the steady prediction error is its own.
    #[test]
    fn the_filter_finds_a_constant_force() {
        let (mut filter, input, h) = (KalmanFilter::new(2.0, 1.0, 1e-4), Vector3::y(), 0.01);
        for j in 1..=500 {
            filter.predict(&input, h);
            let t = j as f64 * h;
            filter.correct(&Vector3::new(1.5 * t, 0.5 * t, 0.0)).unwrap();
        }
        let force = filter.force_n();
        assert!((force - Vector3::new(3.0, 0.0, 0.0)).norm() < 1e-3, "{force}");
        assert!((filter.velocity_m_s() - Vector3::new(7.5, 2.5, 0.0)).norm() < 1e-6);
    }
}
