//! The estimators that `bench accuracy` compares, each as it takes samples and predicts the velocity.

use crate::kalman::noise_variance_m2_s2;
use daemon::config::TranslationConfig;
use nalgebra::{Matrix2, Matrix4, SMatrix, Vector3, Vector4};
use observer::{Learn, RigidBodyObserver, Sample, Velocity};

/// Forgetting time of the least squares (s).
const LEAST_SQUARES_MEMORY_S: f64 = 10.0;
/// Prior variance of the least squares' coefficients.
const LEAST_SQUARES_PRIOR: f64 = 1.0;
/// A velocity beyond this is that of an estimator that has diverged (m/s).
const DIVERGED_M_S: f64 = 1e6;

/// A velocity, and its standard deviations where the estimator has any.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prediction {
    pub(super) velocity_m_s: Vector3<f64>,
    pub(super) std_m_s: Option<[f64; 3]>,
}

/// What is compared.
pub(super) trait Estimator: Clone {
    /// The prediction for this stamp, before the sample of the same stamp is taken.
    fn predict(&mut self, stamp_ns: u64) -> Prediction;
    /// Takes a sample; in a coast it comes without measurements of the translation.
    fn take(&mut self, sample: &Sample);
    /// e²/S of the newest sample, mean over its axes, where the estimator has an S.
    fn nis(&mut self) -> Option<f64> {
        None
    }
    /// The learned force (N), where it is to be shown.
    fn force_n(&mut self) -> Option<Vector3<f64>> {
        None
    }
}

/// The service's observer.
#[derive(Clone)]
pub(super) struct Observer {
    observer: RigidBodyObserver,
    learn: Learn,
    stamp_ns: u64,
}

impl Observer {
    pub(super) fn new(observer: RigidBodyObserver, learn: Learn) -> Self {
        Self { observer, learn, stamp_ns: 0 }
    }
}

impl Estimator for Observer {
    fn predict(&mut self, stamp_ns: u64) -> Prediction {
        let estimate = self.observer.estimate(stamp_ns);
        let std_m_s = estimate.deviations.velocity_m_s;
        Prediction {
            velocity_m_s: estimate.velocity_m_s,
            std_m_s: Some(std_m_s).filter(|std| std[0].is_finite()),
        }
    }

    fn take(&mut self, sample: &Sample) {
        self.observer.accept(sample, self.learn);
        self.stamp_ns = sample.stamp_ns;
    }

    fn nis(&mut self) -> Option<f64> {
        let estimate = self.observer.estimate(self.stamp_ns);
        let report = estimate.translation?;
        estimate.deviations.velocity_m_s[0].is_finite().then_some(report.nis)
    }

    fn force_n(&mut self) -> Option<Vector3<f64>> {
        Some(self.observer.estimate(self.stamp_ns).matched_force_n)
    }
}

/// A velocity and a force that is a random walk, or a Gauss–Markov process: one Kalman filter; the axes share the covariance.
///
/// `v' = (u + f)/m + g,   f' = −f/τ + w,   y = v + δ`   with w white of density q; without τ a random walk
#[derive(Clone)]
pub(super) struct DisturbanceFilter {
    mass_kg: f64,
    force_density_n2_s: f64,
    /// τ (s).
    force_time_s: Option<f64>,
    noise_variance_m2_s2: f64,
    known_n: Vector3<f64>,
    input_n: Vector3<f64>,
    velocity_m_s: Vector3<f64>,
    force_n: Vector3<f64>,
    covariance: Matrix2<f64>,
    stamp_ns: Option<u64>,
}

impl DisturbanceFilter {
    /// A filter that starts with an unknown force of about 10 N.
    pub(super) fn new(
        translation: &TranslationConfig,
        force_density_n2_s: f64,
        force_time_s: Option<f64>,
    ) -> anyhow::Result<Self> {
        let noise_variance_m2_s2 = noise_variance_m2_s2(translation)?;
        let force_variance = match force_time_s {
            Some(time_s) => 0.5 * force_density_n2_s * time_s,
            None => 100.0,
        };
        Ok(Self {
            mass_kg: translation.mass_kg,
            force_density_n2_s,
            force_time_s,
            noise_variance_m2_s2,
            known_n: known_force_n(translation),
            input_n: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            force_n: Vector3::zeros(),
            covariance: Matrix2::new(noise_variance_m2_s2, 0.0, 0.0, force_variance),
            stamp_ns: None,
        })
    }

    fn advance(&mut self, stamp_ns: u64) {
        let Some(from_ns) = self.stamp_ns.filter(|from_ns| *from_ns < stamp_ns) else { return };
        let (h, m, q) = ((stamp_ns - from_ns) as f64 / 1e9, self.mass_kg, self.force_density_n2_s);
        let (kept, mean_s) = match self.force_time_s {
            Some(time_s) => ((-h / time_s).exp(), time_s * (1.0 - (-h / time_s).exp())),
            None => (1.0, h),
        };
        let transition = Matrix2::new(1.0, mean_s / m, 0.0, kept);
        // To the order of the random walk; a step is short beside τ.
        let noise = q * Matrix2::new(h.powi(3) / (3.0 * m * m), h * h / (2.0 * m), h * h / (2.0 * m), h);
        self.velocity_m_s += (h * (self.input_n + self.known_n) + mean_s * self.force_n) / m;
        self.force_n *= kept;
        self.covariance = transition * self.covariance * transition.transpose() + noise;
        self.stamp_ns = Some(stamp_ns);
    }
}

impl Estimator for DisturbanceFilter {
    fn predict(&mut self, stamp_ns: u64) -> Prediction {
        self.advance(stamp_ns);
        let std = self.covariance[(0, 0)].sqrt();
        Prediction { velocity_m_s: self.velocity_m_s, std_m_s: Some([std; 3]) }
    }

    fn take(&mut self, sample: &Sample) {
        self.advance(sample.stamp_ns);
        self.input_n = sample.force_n.unwrap_or(self.input_n);
        let Some(Velocity::Inertial(measured)) = sample.velocity else { return };
        if self.stamp_ns.is_none() {
            self.velocity_m_s = measured;
            self.stamp_ns = Some(sample.stamp_ns);
            return;
        }
        let column = self.covariance.column(0).into_owned();
        let gain = column / (column[0] + self.noise_variance_m2_s2);
        let error = measured - self.velocity_m_s;
        self.velocity_m_s += gain[0] * error;
        self.force_n += gain[1] * error;
        self.covariance -= gain * column.transpose();
    }
}

/// What a practitioner would do in an afternoon: recursive least squares of the acceleration on [1, v, |v|v, u/m] of each axis
/// with a memory of 10 s, and the integral of what it found.
#[derive(Clone)]
pub(super) struct LeastSquares {
    mass_kg: f64,
    known_n: Vector3<f64>,
    input_n: Vector3<f64>,
    velocity_m_s: Vector3<f64>,
    /// One column per axis.
    coefficients: SMatrix<f64, 4, 3>,
    covariances: [Matrix4<f64>; 3],
    /// The last sample with a velocity: its stamp, its velocity; and the integral of the command from then on (N s).
    newest: Option<(u64, Vector3<f64>)>,
    impulse_n_s: Vector3<f64>,
    stamp_ns: Option<u64>,
}

impl LeastSquares {
    pub(super) fn new(translation: &TranslationConfig) -> Self {
        Self {
            mass_kg: translation.mass_kg,
            known_n: known_force_n(translation),
            input_n: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            coefficients: SMatrix::zeros(),
            covariances: [LEAST_SQUARES_PRIOR * Matrix4::identity(); 3],
            newest: None,
            impulse_n_s: Vector3::zeros(),
            stamp_ns: None,
        }
    }

    fn features(&self, velocity: &Vector3<f64>, input_n: &Vector3<f64>, axis: usize) -> Vector4<f64> {
        Vector4::new(1.0, velocity[axis], velocity.norm() * velocity[axis], input_n[axis] / self.mass_kg)
    }

    fn advance(&mut self, stamp_ns: u64) {
        let Some(from_ns) = self.stamp_ns.filter(|from_ns| *from_ns < stamp_ns) else { return };
        let h = (stamp_ns - from_ns) as f64 / 1e9;
        let learned = Vector3::from_fn(|axis, _| {
            self.features(&self.velocity_m_s, &self.input_n, axis).dot(&self.coefficients.column(axis))
        });
        let moved = self.velocity_m_s + h * ((self.input_n + self.known_n) / self.mass_kg + learned);
        // It stays where it has left every bound: an error that is not finite has no root mean square.
        if moved.norm() < DIVERGED_M_S {
            self.velocity_m_s = moved;
        }
        self.impulse_n_s += h * self.input_n;
        self.stamp_ns = Some(stamp_ns);
    }

    fn learn(&mut self, stamp_ns: u64, measured: &Vector3<f64>) {
        let Some((from_ns, before)) = self.newest else { return };
        let h = (stamp_ns - from_ns) as f64 / 1e9;
        let input_n = self.impulse_n_s / h;
        let unexplained = (measured - before) / h - (input_n + self.known_n) / self.mass_kg;
        let forgetting = (-h / LEAST_SQUARES_MEMORY_S).exp();
        for axis in 0..3 {
            let features = self.features(&before, &input_n, axis);
            let product = self.covariances[axis] * features;
            let gain = product / (forgetting + features.dot(&product));
            let error = unexplained[axis] - features.dot(&self.coefficients.column(axis));
            let moved = self.coefficients.column(axis) + gain * error;
            self.coefficients.set_column(axis, &moved);
            self.covariances[axis] = (self.covariances[axis] - gain * product.transpose()) / forgetting;
        }
    }
}

impl Estimator for LeastSquares {
    fn predict(&mut self, stamp_ns: u64) -> Prediction {
        self.advance(stamp_ns);
        Prediction { velocity_m_s: self.velocity_m_s, std_m_s: None }
    }

    fn take(&mut self, sample: &Sample) {
        self.advance(sample.stamp_ns);
        let Some(Velocity::Inertial(measured)) = sample.velocity else {
            self.input_n = sample.force_n.unwrap_or(self.input_n);
            return;
        };
        self.learn(sample.stamp_ns, &measured);
        self.input_n = sample.force_n.unwrap_or(self.input_n);
        self.velocity_m_s = measured;
        self.newest = Some((sample.stamp_ns, measured));
        self.impulse_n_s = Vector3::zeros();
        self.stamp_ns = Some(sample.stamp_ns);
    }
}

fn known_force_n(translation: &TranslationConfig) -> Vector3<f64> {
    translation.mass_kg * Vector3::from(translation.gravity_m_s2) + Vector3::from(translation.known_force_n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kalman::KalmanFilter;
    use daemon::config::ConfigFile;

    fn translation() -> TranslationConfig {
        ConfigFile::preset("acsl-x8").unwrap().config.translation.unwrap()
    }

    fn sample(stamp_ns: u64, velocity: Vector3<f64>, force_n: Vector3<f64>) -> Sample {
        Sample {
            stamp_ns,
            velocity: Some(Velocity::Inertial(velocity)),
            force_n: Some(force_n),
            ..Sample::default()
        }
    }

    #[test]
    fn the_kalman_filter_is_that_of_another_library() {
        let translation = translation();
        let mut filter = DisturbanceFilter::new(&translation, 3.0, None).unwrap();
        let variance = noise_variance_m2_s2(&translation).unwrap();
        let mut other = KalmanFilter::new(translation.mass_kg, 3.0, variance);
        let known_n = known_force_n(&translation);
        for j in 0..300_u64 {
            let t = j as f64 * 0.01;
            let velocity = Vector3::new(t.sin(), 0.3 * t, (3.0 * t).cos());
            let force_n = Vector3::new(t.cos(), 1.0, -21.0);
            filter.take(&sample(j * 10_000_000, velocity, force_n));
            if j == 0 {
                other.start_at(&velocity)
            } else {
                other.correct(&velocity).unwrap()
            }
            other.predict(&(force_n + known_n), 0.01);
            let predicted = filter.predict((j + 1) * 10_000_000);
            assert!((predicted.velocity_m_s - other.velocity_m_s()).norm() < 1e-9, "{j}");
        }
    }

    /// The stationary variance of a force that nobody measures is qτ/2.
    #[test]
    fn without_samples_a_gauss_markov_force_keeps_its_stationary_variance_and_fades() {
        let mut filter = DisturbanceFilter::new(&translation(), 2.0, Some(0.5)).unwrap();
        filter.take(&sample(0, Vector3::zeros(), Vector3::zeros()));
        filter.force_n = Vector3::x();
        for j in 1..=500 {
            filter.predict(j * 1_000_000);
        }
        assert!((filter.force_n.x - (-1.0_f64).exp()).abs() < 1e-9);
        assert!((filter.covariance[(1, 1)] / 0.5 - 1.0).abs() < 0.01, "{}", filter.covariance[(1, 1)]);
    }

    /// v' = (u − 0.4 v − 0.3 |v| v)/m without noise: the coefficients are found, and a coast follows.
    #[test]
    fn the_least_squares_find_a_drag() {
        let translation = TranslationConfig { gravity_m_s2: [0.0; 3], mass_kg: 2.0, ..translation() };
        let mut estimator = LeastSquares::new(&translation);
        let mut velocity = Vector3::new(1.0, -1.0, 0.5);
        for j in 0..4000_u64 {
            let t = j as f64 * 0.01;
            let force = Vector3::new((0.7 * t).sin(), (1.1 * t).cos(), (0.4 * t).sin()) * 2.0;
            estimator.take(&sample(j * 10_000_000, velocity, force));
            velocity += 0.01 * (force - 0.4 * velocity - 0.3 * velocity.norm() * velocity) / 2.0;
        }
        let found = estimator.coefficients.column(0).into_owned();
        assert!((found - Vector4::new(0.0, -0.2, -0.15, 0.0)).norm() < 0.01, "{found}");
        let predicted = estimator.predict(4000 * 10_000_000).velocity_m_s;
        assert!((predicted - velocity).norm() < 1e-3, "{predicted} {velocity}");
    }
}
