//! The estimators that `bench accuracy` compares, each as it takes samples and predicts the velocity.

use crate::disturbance_filter::{DisturbanceFilter, known_force_n};
use daemon::config::TranslationConfig;
use nalgebra::{Matrix4, SMatrix, UnitQuaternion, Vector3, Vector4};
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

impl Estimator for DisturbanceFilter {
    fn predict(&mut self, stamp_ns: u64) -> Prediction {
        Self::predict(self, stamp_ns);
        Prediction { velocity_m_s: self.velocity_m_s(), std_m_s: Some([self.velocity_std_m_s(); 3]) }
    }

    fn take(&mut self, sample: &Sample) {
        // The velocities of a case are inertial.
        Self::take(self, sample, &UnitQuaternion::identity());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disturbance_filter::tests::{sample, translation};

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
