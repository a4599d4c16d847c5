//! The Kalman filter that the service is compared with: position, velocity and a force that is a random walk or a Gauss–Markov
//! process. It is given the configuration's mass, gravity and noises.

use crate::kalman::noise_variance_m2_s2;
use daemon::config::TranslationConfig;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use observer::{Sample, Velocity};

/// Variance of a velocity that was never measured (m²/s²).
const UNKNOWN_VELOCITY_M2_S2: f64 = 100.0;
/// Variance of a random walk's force before the first sample (N²).
const UNKNOWN_FORCE_N2: f64 = 100.0;

/// Position, velocity and force, one column per axis; the axes share the covariance.
///
/// `r' = v,   v' = (u + f)/m + g,   f' = −f/τ + w,   y = v + δ`   with w white of density q; without τ a random walk
#[derive(Clone)]
pub(crate) struct DisturbanceFilter {
    mass_kg: f64,
    force_density_n2_s: f64,
    /// τ (s).
    force_time_s: Option<f64>,
    velocity_variance_m2_s2: f64,
    /// Of fixes; without it, the first fix sets the position.
    position_variance_m2: Option<f64>,
    /// Rows r, v, f.
    state: Matrix3<f64>,
    covariance: Matrix3<f64>,
    /// Constant, in addition to the commanded force (N).
    known_n: Vector3<f64>,
    input_n: Vector3<f64>,
    /// `None` before the first measurement.
    stamp_ns: Option<u64>,
}

impl DisturbanceFilter {
    /// A filter that starts with an unknown force.
    pub(crate) fn new(
        translation: &TranslationConfig,
        force_density_n2_s: f64,
        force_time_s: Option<f64>,
    ) -> anyhow::Result<Self> {
        let velocity_variance_m2_s2 = noise_variance_m2_s2(translation)?;
        let force_variance =
            force_time_s.map_or(UNKNOWN_FORCE_N2, |time_s| 0.5 * force_density_n2_s * time_s);
        let variances = Vector3::new(0.0, velocity_variance_m2_s2, force_variance);
        Ok(Self {
            mass_kg: translation.mass_kg,
            force_density_n2_s,
            force_time_s,
            velocity_variance_m2_s2,
            position_variance_m2: Some(translation.position_noise_m.powi(2))
                .filter(|variance_m2| *variance_m2 > 0.0),
            state: Matrix3::zeros(),
            covariance: Matrix3::from_diagonal(&variances),
            known_n: known_force_n(translation),
            input_n: Vector3::zeros(),
            stamp_ns: None,
        })
    }

    /// Before the first sample (m).
    pub(crate) fn start_at_position(&mut self, position_m: &Vector3<f64>) {
        self.state.set_row(0, &position_m.transpose());
    }

    pub(crate) fn position_m(&self) -> Vector3<f64> {
        self.state.row(0).transpose()
    }

    pub(crate) fn velocity_m_s(&self) -> Vector3<f64> {
        self.state.row(1).transpose()
    }

    pub(crate) fn velocity_std_m_s(&self) -> f64 {
        self.covariance[(1, 1)].sqrt()
    }

    pub(crate) fn force_n(&self) -> Vector3<f64> {
        self.state.row(2).transpose()
    }

    /// Moves to an instant with the command held.
    pub(crate) fn predict(&mut self, stamp_ns: u64) {
        let Some(from_ns) = self.stamp_ns.filter(|from_ns| *from_ns < stamp_ns) else { return };
        let (h, m, q) = ((stamp_ns - from_ns) as f64 / 1e9, self.mass_kg, self.force_density_n2_s);
        let (kept, mean_s) = match self.force_time_s {
            Some(time_s) => ((-h / time_s).exp(), time_s * (1.0 - (-h / time_s).exp())),
            None => (1.0, h),
        };
        let transition = Matrix3::new(1.0, h, 0.5 * h * mean_s / m, 0.0, 1.0, mean_s / m, 0.0, 0.0, kept);
        let driven = Vector3::new(h * h / (2.0 * m), h / m, 0.0);
        // To the order of the random walk; a step is short beside τ.
        let [rr, rv, rf] = [h.powi(5) / (20.0 * m * m), h.powi(4) / (8.0 * m * m), h.powi(3) / (6.0 * m)];
        let [vv, vf] = [h.powi(3) / (3.0 * m * m), h * h / (2.0 * m)];
        let noise = q * Matrix3::new(rr, rv, rf, rv, vv, vf, rf, vf, h);
        self.state = transition * self.state + driven * (self.input_n + self.known_n).transpose();
        self.covariance = transition * self.covariance * transition.transpose() + noise;
        self.stamp_ns = Some(stamp_ns);
    }

    /// Takes a sample; `attitude` turns a body velocity into inertial axes.
    pub(crate) fn take(&mut self, sample: &Sample, attitude: &UnitQuaternion<f64>) {
        self.predict(sample.stamp_ns);
        self.input_n = sample.force_n.unwrap_or(self.input_n);
        let is_first = self.stamp_ns.is_none();
        if let Some(position) = sample.position_m {
            match self.position_variance_m2 {
                Some(variance_m2) if !is_first => self.correct(0, &position, variance_m2),
                Some(variance_m2) => {
                    self.start_at_position(&position);
                    self.covariance[(0, 0)] = variance_m2;
                    self.covariance[(1, 1)] = UNKNOWN_VELOCITY_M2_S2;
                    self.stamp_ns = Some(sample.stamp_ns);
                }
                None if is_first => self.start_at_position(&position),
                None => {}
            }
        }
        let velocity = match sample.velocity {
            Some(Velocity::Inertial(velocity)) => velocity,
            Some(Velocity::Body(velocity)) => attitude * velocity,
            None => return,
        };
        if is_first {
            self.state.set_row(1, &velocity.transpose());
            self.covariance[(1, 1)] = self.velocity_variance_m2_s2;
            self.stamp_ns = Some(sample.stamp_ns);
        } else {
            self.correct(1, &velocity, self.velocity_variance_m2_s2);
        }
    }

    fn correct(&mut self, row: usize, measured: &Vector3<f64>, variance: f64) {
        let column = self.covariance.column(row).into_owned();
        let gain = column / (column[row] + variance);
        self.state += gain * (measured.transpose() - self.state.row(row));
        self.covariance -= gain * column.transpose();
    }
}

/// Gravity, buoyancy and the like (N).
pub(crate) fn known_force_n(translation: &TranslationConfig) -> Vector3<f64> {
    translation.mass_kg * Vector3::from(translation.gravity_m_s2) + Vector3::from(translation.known_force_n)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::kalman::KalmanFilter;
    use daemon::config::ConfigFile;

    /// Of the laboratory's X8.
    pub(crate) fn translation() -> TranslationConfig {
        ConfigFile::preset("acsl-x8").unwrap().config.translation.unwrap()
    }

    /// A velocity and a command.
    pub(crate) fn sample(stamp_ns: u64, velocity: Vector3<f64>, force_n: Vector3<f64>) -> Sample {
        Sample {
            stamp_ns,
            velocity: Some(Velocity::Inertial(velocity)),
            force_n: Some(force_n),
            ..Sample::default()
        }
    }

    /// Velocity and force are those of the library's filter; the position is the velocity's integral between corrections.
    #[test]
    fn velocity_and_force_are_those_of_a_filter_of_another_library() {
        let translation = translation();
        let mut filter = DisturbanceFilter::new(&translation, 3.0, None).unwrap();
        let variance = noise_variance_m2_s2(&translation).unwrap();
        let mut other = KalmanFilter::new(translation.mass_kg, 3.0, variance);
        let known_n = known_force_n(&translation);
        for j in 0..300_u64 {
            let t = j as f64 * 0.01;
            let velocity = Vector3::new(t.sin(), 0.3 * t, (3.0 * t).cos());
            let force_n = Vector3::new(t.cos(), 1.0, -21.0);
            filter.take(&sample(j * 10_000_000, velocity, force_n), &UnitQuaternion::identity());
            if j == 0 {
                other.start_at(&velocity)
            } else {
                other.correct(&velocity).unwrap()
            }
            assert!((filter.velocity_m_s() - other.velocity_m_s()).norm() < 1e-9, "{j}");
            assert!((filter.force_n() - other.force_n()).norm() < 1e-7, "{j}");
            other.predict(&(force_n + known_n), 0.01);
        }
        let before = filter.clone();
        filter.predict(before.stamp_ns.unwrap() + 100_000_000);
        let mean_velocity = 0.5 * (filter.velocity_m_s() + before.velocity_m_s());
        let moved = filter.position_m() - before.position_m() - 0.1 * mean_velocity;
        assert!(moved.norm() < 1e-12, "{moved}");
    }

    /// A constant acceleration that nobody commands: from fixes of the position alone, velocity and force are found.
    #[test]
    fn from_positions_velocity_and_force_are_found() {
        let translation = TranslationConfig {
            gravity_m_s2: [0.0; 3],
            mass_kg: 2.0,
            position_noise_m: 0.01,
            ..translation()
        };
        let mut filter = DisturbanceFilter::new(&translation, 1e-3, None).unwrap();
        for j in 0..500_u64 {
            let t = j as f64 * 0.01;
            let position_m = Some(Vector3::new(1.0 + 0.25 * t * t, -t, 3.0));
            let fix = Sample { stamp_ns: j * 10_000_000, position_m, ..Sample::default() };
            filter.take(&fix, &UnitQuaternion::identity());
        }
        let velocity_error = filter.velocity_m_s() - Vector3::new(0.5 * 4.99, -1.0, 0.0);
        let force_error = filter.force_n() - Vector3::new(1.0, 0.0, 0.0);
        assert!(velocity_error.norm() < 1e-3 && force_error.norm() < 2e-3, "{velocity_error} {force_error}");
    }

    /// The stationary variance of a force that nobody measures is qτ/2.
    #[test]
    fn without_samples_a_gauss_markov_force_keeps_its_stationary_variance_and_fades() {
        let mut filter = DisturbanceFilter::new(&translation(), 2.0, Some(0.5)).unwrap();
        filter.take(&sample(0, Vector3::zeros(), Vector3::zeros()), &UnitQuaternion::identity());
        filter.state[(2, 0)] = 1.0;
        for j in 1..=500 {
            filter.predict(j * 1_000_000);
        }
        assert!((filter.force_n().x - (-1.0_f64).exp()).abs() < 1e-9);
        assert!((filter.covariance[(2, 2)] / 0.5 - 1.0).abs() < 0.01, "{}", filter.covariance[(2, 2)]);
    }
}
