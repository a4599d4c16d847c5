//! The Kalman filter that the service is compared with: position, velocity and a random-walk force, on the same samples, at
//! the same instants. It is given the preset's mass, gravity and noise, and the best of 17 densities of its force, chosen for each
//! quantity by its error against the truth.

use super::errors::{Quantity, RmsMax, Run, quaternion};
use crate::kalman::{densities_n2_s, noise_variance_m2_s2};
use daemon::config::{ConfigFile, TranslationConfig};
use daemon::gate::Gate;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use observer::{Sample, Velocity};
use shared_types::payload::Estimate;

/// The filter's estimates with every density; none where the configuration has no translation.
pub(super) fn tunings(run: &Run, config: &ConfigFile) -> anyhow::Result<Vec<Vec<Estimate>>> {
    let Some(translation) = &config.config.translation else { return Ok(Vec::new()) };
    let start_m = config.config.initial.position_m.unwrap_or_default().into();
    densities_n2_s(translation.mass_kg)
        .into_iter()
        .map(|density| Ok(estimates(run, config, Filter::new(translation, density, start_m)?)))
        .collect()
}

/// The tuning with the least error of a quantity over the second half.
pub(super) fn best<'a>(
    run: &Run,
    tunings: &'a [Vec<Estimate>],
    quantity: Quantity,
) -> Option<&'a [Estimate]> {
    let rms = |estimates: &[Estimate]| {
        RmsMax::over_second_half(run, estimates, quantity).map_or(f64::INFINITY, |error| error.rms)
    };
    tunings.iter().map(Vec::as_slice).min_by(|a, b| rms(a).total_cmp(&rms(b)))
}

/// Position, velocity and force, one column per axis; the axes share the covariance.
///
/// `r' = v,   v' = (u + f)/m,   f' = w,   y = v + δ`   with w white of density q, δ white of variance r
#[derive(Clone)]
struct Filter {
    mass_kg: f64,
    force_density_n2_s: f64,
    noise_variance_m2_s2: f64,
    state: Matrix3<f64>,
    covariance: Matrix3<f64>,
    /// Constant, in addition to the commanded force (N).
    known_n: Vector3<f64>,
    input_n: Vector3<f64>,
    /// `None` before the first velocity.
    stamp_ns: Option<u64>,
}

impl Filter {
    /// A filter that starts at this position with an unknown force of about 10 N.
    fn new(
        translation: &TranslationConfig,
        force_density_n2_s: f64,
        position_m: Vector3<f64>,
    ) -> anyhow::Result<Self> {
        let noise_variance_m2_s2 = noise_variance_m2_s2(translation)?;
        let gravity_n = translation.mass_kg * Vector3::from(translation.gravity_m_s2);
        let mut state = Matrix3::zeros();
        state.set_row(0, &position_m.transpose());
        Ok(Self {
            mass_kg: translation.mass_kg,
            force_density_n2_s,
            noise_variance_m2_s2,
            state,
            covariance: Matrix3::from_diagonal(&Vector3::new(0.0, noise_variance_m2_s2, 100.0)),
            known_n: gravity_n + Vector3::from(translation.known_force_n),
            input_n: Vector3::zeros(),
            stamp_ns: None,
        })
    }

    fn row(&self, row: usize) -> Vector3<f64> {
        self.state.row(row).transpose()
    }

    fn predict(&mut self, stamp_ns: u64) {
        let Some(from_ns) = self.stamp_ns.filter(|from_ns| *from_ns < stamp_ns) else { return };
        let (h, m, q) = ((stamp_ns - from_ns) as f64 / 1e9, self.mass_kg, self.force_density_n2_s);
        let transition = Matrix3::new(1.0, h, h * h / (2.0 * m), 0.0, 1.0, h / m, 0.0, 0.0, 1.0);
        let driven = Vector3::new(h * h / (2.0 * m), h / m, 0.0);
        let [rr, rv, rf] = [h.powi(5) / (20.0 * m * m), h.powi(4) / (8.0 * m * m), h.powi(3) / (6.0 * m)];
        let [vv, vf] = [h.powi(3) / (3.0 * m * m), h * h / (2.0 * m)];
        let noise = q * Matrix3::new(rr, rv, rf, rv, vv, vf, rf, vf, h);
        self.state = transition * self.state + driven * (self.input_n + self.known_n).transpose();
        self.covariance = transition * self.covariance * transition.transpose() + noise;
        self.stamp_ns = Some(stamp_ns);
    }

    fn correct(&mut self, velocity: &Vector3<f64>) {
        let column = self.covariance.column(1).into_owned();
        let gain = column / (column[1] + self.noise_variance_m2_s2);
        self.state += gain * (velocity - self.row(1)).transpose();
        self.covariance -= gain * column.transpose();
    }

    /// `attitude` turns a body velocity into inertial axes.
    fn take(&mut self, sample: &Sample, attitude: &UnitQuaternion<f64>) {
        self.predict(sample.stamp_ns);
        self.input_n = sample.force_n.unwrap_or(self.input_n);
        if let Some(position) = sample.position_m.filter(|_| self.stamp_ns.is_none()) {
            self.state.set_row(0, &position.transpose());
        }
        let velocity = match sample.velocity {
            Some(Velocity::Inertial(velocity)) => velocity,
            Some(Velocity::Body(velocity)) => attitude * velocity,
            None => return,
        };
        if self.stamp_ns.is_some() {
            return self.correct(&velocity);
        }
        self.state.set_row(1, &velocity.transpose());
        self.stamp_ns = Some(sample.stamp_ns);
    }
}

fn estimates(run: &Run, config: &ConfigFile, mut filter: Filter) -> Vec<Estimate> {
    let mut gate = Gate::new(config.config.input, true);
    let mut samples = run.measurements().iter().peekable();
    let estimate = |estimate: &Estimate| {
        // The service's own attitude: what is compared is the translation.
        let attitude = quaternion(estimate.attitude_wxyz);
        while let Some(sample) = samples.next_if(|sample| sample.sequence <= estimate.source_sequence) {
            if let Ok(accepted) = gate.judge(sample, 0, estimate.stamp_ns) {
                filter.take(&accepted.sample, &attitude);
            }
        }
        let mut now = filter.clone();
        now.predict(estimate.stamp_ns);
        Estimate {
            position_m: now.row(0).into(),
            velocity_m_s: now.row(1).into(),
            matched_force_n: now.row(2).into(),
            ..*estimate
        }
    };
    run.estimates.iter().map(estimate).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kalman::KalmanFilter;

    /// Velocity and force are those of the library's filter; the position is the velocity's integral between corrections.
    #[test]
    fn velocity_and_force_are_those_of_a_filter_of_another_library() {
        let config = ConfigFile::preset("rigid-body").unwrap().config;
        let translation = config.translation.unwrap();
        let mut filter = Filter::new(&translation, 3.0, Vector3::zeros()).unwrap();
        let mut other = KalmanFilter::new(translation.mass_kg, 3.0, filter.noise_variance_m2_s2);
        let velocity = |t: f64| Vector3::new(t.sin(), 0.3 * t, (3.0 * t).cos());
        let known_n = Vector3::new(0.0, 0.0, 2.0 * 9.81);
        for j in 0..200_u64 {
            let (t, h_s) = (j as f64 * 0.01, 0.01);
            let force_n = Vector3::new(t.cos(), 1.0, -19.0);
            let sample = Sample {
                stamp_ns: j * 10_000_000,
                velocity: Some(Velocity::Inertial(velocity(t))),
                angular_velocity_rad_s: None,
                position_m: None,
                attitude: None,
                force_n: Some(force_n),
                torque_n_m: None,
            };
            filter.take(&sample, &UnitQuaternion::identity());
            match j {
                0 => other.start_at(&velocity(t)),
                _ => other.correct(&velocity(t)).unwrap(),
            }
            assert!((filter.row(1) - other.velocity_m_s()).norm() < 1e-9, "{j}");
            assert!((filter.row(2) - other.force_n()).norm() < 1e-7, "{j}");
            other.predict(&(force_n + known_n), h_s);
        }
        let before = filter.clone();
        filter.predict(before.stamp_ns.unwrap() + 100_000_000);
        let moved = filter.row(0) - before.row(0) - 0.05 * (filter.row(1) + before.row(1));
        assert!(moved.norm() < 1e-12, "{moved}");
    }
}
