//! The accuracy of an estimator on a recorded flight: errors of the next sample's prediction, and after a coast.

use crate::kalman::{KalmanFilter, densities_n2_s, noise_variance_m2_s2};
use anyhow::ensure;
use daemon::config::TranslationConfig;
use nalgebra::Vector3;
use observer::{Learn, RigidBodyObserver, Sample, Velocity};

/// From one coast's start to the next (s).
pub(crate) const COAST_EVERY_S: f64 = 0.25;
/// Coasts start after this (s).
pub(crate) const LEARN_IN_S: f64 = 2.0;

/// Samples with an inertial velocity each, where their second half begins, and how long they are to be coasted.
pub(crate) struct Flight {
    pub(crate) samples: Vec<Sample>,
    pub(crate) half: usize,
    pub(crate) coast_s: f64,
}

impl Flight {
    pub(crate) fn new(samples: Vec<Sample>, coast_s: f64) -> anyhow::Result<Self> {
        ensure!(coast_s > 0.0 && coast_s <= 3600.0, "--coast-s {coast_s}: needed: above 0, at most 3600 s");
        let start = samples.iter().position(|sample| sample.velocity.is_some()).unwrap_or(samples.len());
        let samples = samples[start..].to_vec();
        let body = samples.iter().any(|sample| matches!(sample.velocity, Some(Velocity::Body(_))));
        ensure!(
            !body,
            "velocities along the body axes; needed: inertial ones, which can be compared with a prediction"
        );
        ensure!(
            samples.iter().any(|sample| sample.force_n.is_some()),
            "no commanded force in this flight; needed: force columns, so that a coast knows what was commanded"
        );
        let duration_s = match (samples.first(), samples.last()) {
            (Some(first), Some(last)) => (last.stamp_ns - first.stamp_ns) as f64 / 1e9,
            _ => 0.0,
        };
        ensure!(
            duration_s >= 4.0 * coast_s,
            "{duration_s:.2} s of usable samples in the air; needed: at least {} s, four coasts",
            4.0 * coast_s
        );
        let half_ns = samples[0].stamp_ns + (duration_s / 2.0 * 1e9) as u64;
        let half =
            samples.iter().position(|sample| sample.stamp_ns >= half_ns).expect("the last one is later");
        Ok(Self { samples, half, coast_s })
    }

    /// The first half as a flight of its own, evaluated after the first seconds.
    pub(crate) fn first_half(&self) -> anyhow::Result<Self> {
        let mut first = Self::new(self.samples[..self.half].to_vec(), self.coast_s)?;
        let learned_in_ns = first.samples[0].stamp_ns + (LEARN_IN_S * 1e9) as u64;
        let learned_in = first.samples.iter().position(|sample| sample.stamp_ns >= learned_in_ns);
        first.half = learned_in.unwrap_or(first.samples.len());
        let left_s = first
            .samples
            .get(first.half)
            .map_or(0.0, |_| first.seconds_from(first.half, first.samples.len() - 1));
        ensure!(
            left_s >= 6.0 * self.coast_s,
            "the flight's first half has {left_s:.1} s after the first {LEARN_IN_S} s; needed: at least {} s, six coasts",
            6.0 * self.coast_s
        );
        Ok(first)
    }

    pub(crate) fn seconds_from(&self, from: usize, to: usize) -> f64 {
        (self.samples[to].stamp_ns - self.samples[from].stamp_ns) as f64 / 1e9
    }

    pub(crate) fn extreme_velocity(&self, extreme: fn(f64, f64) -> f64) -> [f64; 3] {
        let velocities = (0..self.samples.len()).filter_map(|index| self.velocity(index));
        velocities.reduce(|a, b| a.zip_map(&b, extreme)).expect("the first sample has one").into()
    }

    pub(crate) fn velocity(&self, index: usize) -> Option<Vector3<f64>> {
        match self.samples[index].velocity {
            Some(Velocity::Inertial(velocity)) => Some(velocity),
            _ => None,
        }
    }
}

/// An estimator that is compared: it takes samples, and predicts the velocity at a later instant.
pub(crate) trait Estimator: Clone {
    /// The prediction for this stamp, before the sample of the same stamp is taken.
    fn predict(&mut self, stamp_ns: u64) -> Vector3<f64>;
    /// Takes the sample of that stamp; in a coast it comes without measurements of the translation.
    fn take(&mut self, sample: &Sample) -> anyhow::Result<()>;
}

#[derive(Clone)]
pub(crate) struct ObserverEstimator(pub(crate) RigidBodyObserver, pub(crate) Learn);

impl Estimator for ObserverEstimator {
    fn predict(&mut self, stamp_ns: u64) -> Vector3<f64> {
        self.0.estimate(stamp_ns).velocity_m_s
    }

    fn take(&mut self, sample: &Sample) -> anyhow::Result<()> {
        self.0.accept(sample, self.1);
        Ok(())
    }
}

#[derive(Clone)]
struct KalmanEstimator {
    filter: KalmanFilter,
    known_force_n: Vector3<f64>,
    input_n: Vector3<f64>,
    /// Of the filter's state; `None` before the first measurement.
    stamp_ns: Option<u64>,
}

impl KalmanEstimator {
    fn new(filter: KalmanFilter, known_force_n: Vector3<f64>) -> Self {
        Self { filter, known_force_n, input_n: Vector3::zeros(), stamp_ns: None }
    }
}

impl Estimator for KalmanEstimator {
    fn predict(&mut self, stamp_ns: u64) -> Vector3<f64> {
        let Some(from_ns) = self.stamp_ns else { return Vector3::zeros() };
        let h_s = (stamp_ns - from_ns) as f64 / 1e9;
        if h_s > 0.0 {
            self.filter.predict(&(self.input_n + self.known_force_n), h_s);
        }
        self.stamp_ns = Some(stamp_ns);
        self.filter.velocity_m_s()
    }

    fn take(&mut self, sample: &Sample) -> anyhow::Result<()> {
        self.predict(sample.stamp_ns);
        self.input_n = sample.force_n.unwrap_or(self.input_n);
        let Some(Velocity::Inertial(velocity)) = sample.velocity else { return Ok(()) };
        if self.stamp_ns.is_some() {
            return self.filter.correct(&velocity);
        }
        self.filter.start_at(&velocity);
        self.stamp_ns = Some(sample.stamp_ns);
        Ok(())
    }
}

/// One estimator over one flight.
pub(crate) struct Accuracy {
    pub(crate) one_step_rms_m_s: f64,
    pub(crate) coast_rms_m_s: f64,
    pub(crate) whole_flight_coast_rms_m_s: f64,
    /// Of each coast of the second half: stamp and predicted velocity at its start, its end and in between.
    pub(crate) coasts: Vec<Path>,
}

/// The errors of an estimator at one instant.
pub(crate) enum Finding {
    /// The prediction of this sample, before it was taken, minus its measurement (m/s).
    NextSample(Vector3<f64>),
    /// A coast that began with this sample: how it went, and its error at the end (m/s).
    Coast(Path, Vector3<f64>),
}

/// Runs over the whole flight, learning, and passes on every error with the index of its sample.
pub(crate) fn fly(
    flight: &Flight,
    mut estimator: impl Estimator,
    mut found: impl FnMut(usize, Finding),
) -> anyhow::Result<()> {
    let every_ns = (COAST_EVERY_S * 1e9) as u64;
    let half_ns = flight.samples[flight.half].stamp_ns;
    // The grid of starts has a point at the beginning of the second half.
    let learned_in_ns = flight.samples[0].stamp_ns + (LEARN_IN_S * 1e9) as u64;
    let mut next_ns = half_ns - half_ns.saturating_sub(learned_in_ns) / every_ns * every_ns;
    for (index, sample) in flight.samples.iter().enumerate() {
        let predicted = estimator.predict(sample.stamp_ns);
        let measured = flight.velocity(index);
        if let Some(measured) = measured {
            found(index, Finding::NextSample(predicted - measured));
        }
        estimator.take(sample)?;
        if sample.stamp_ns >= next_ns && measured.is_some() {
            if let Some((path, error)) = coast_from(flight, index, estimator.clone())? {
                found(index, Finding::Coast(path, error));
            }
            next_ns += every_ns;
        }
    }
    Ok(())
}

/// The errors of the flight's second half, and the coasts of all of it.
pub(crate) fn evaluate(flight: &Flight, estimator: impl Estimator) -> anyhow::Result<Accuracy> {
    let [mut one_step, mut coast, mut whole_flight] = [const { MeanSquare { sum: 0.0, count: 0 } }; 3];
    let mut coasts = Vec::new();
    fly(flight, estimator, |index, finding| match finding {
        Finding::NextSample(error) if index >= flight.half => one_step.add(&error),
        Finding::NextSample(_) => {}
        Finding::Coast(path, error) => {
            MeanSquare::add(&mut whole_flight, &error);
            if index >= flight.half {
                MeanSquare::add(&mut coast, &error);
                coasts.push(path);
            }
        }
    })?;
    Ok(Accuracy {
        one_step_rms_m_s: one_step.root(),
        coast_rms_m_s: coast.root(),
        whole_flight_coast_rms_m_s: whole_flight.root(),
        coasts,
    })
}

/// The mean NIS of the second half, learning; `None` with a law without deviations.
pub(crate) fn mean_nis(flight: &Flight, mut observer: RigidBodyObserver) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0_usize);
    for (index, sample) in flight.samples.iter().enumerate() {
        observer.accept(sample, Learn::ALL);
        if index >= flight.half && sample.velocity.is_some() {
            let estimate = observer.estimate(sample.stamp_ns);
            if estimate.deviations.velocity_m_s[0].is_finite() {
                sum += estimate.translation?.nis;
                count += 1;
            }
        }
    }
    (count > 0).then(|| sum / count as f64)
}

/// The Kalman filter with each density of its force (N²/s).
pub(crate) fn evaluate_kalman(
    flight: &Flight,
    translation: &TranslationConfig,
) -> anyhow::Result<Vec<(f64, Accuracy)>> {
    let known_force_n = translation.mass_kg * Vector3::from(translation.gravity_m_s2)
        + Vector3::from(translation.known_force_n);
    let noise_variance_m2_s2 = noise_variance_m2_s2(translation)?;
    let evaluate = |q: f64| {
        let filter = KalmanFilter::new(translation.mass_kg, q, noise_variance_m2_s2);
        Ok((q, evaluate(flight, KalmanEstimator::new(filter, known_force_n))?))
    };
    densities_n2_s(translation.mass_kg).into_iter().map(evaluate).collect()
}

/// The least of some error over all densities, with its density.
pub(crate) fn best(kalman: &[(f64, Accuracy)], of: fn(&Accuracy) -> f64) -> &(f64, Accuracy) {
    kalman.iter().min_by(|(_, a), (_, b)| of(a).total_cmp(&of(b))).expect("at least one density")
}

/// Stamps, and the velocities that were predicted for them (m/s).
pub(crate) type Path = Vec<(u64, Vector3<f64>)>;

/// Predicts without measurements of the translation; `None` where the flight ends before.
fn coast_from(
    flight: &Flight,
    start: usize,
    mut estimator: impl Estimator,
) -> anyhow::Result<Option<(Path, Vector3<f64>)>> {
    let end_ns = flight.samples[start].stamp_ns + (flight.coast_s * 1e9) as u64;
    let mut path = vec![(flight.samples[start].stamp_ns, estimator.predict(flight.samples[start].stamp_ns))];
    for index in start + 1..flight.samples.len() {
        let sample = &flight.samples[index];
        path.push((sample.stamp_ns, estimator.predict(sample.stamp_ns)));
        if let (true, Some(measured)) = (sample.stamp_ns >= end_ns, flight.velocity(index)) {
            let error = path.last().expect("just pushed").1 - measured;
            return Ok(Some((path, error)));
        }
        estimator.take(&Sample { velocity: None, position_m: None, specific_force_m_s2: None, ..*sample })?;
    }
    Ok(None)
}

#[derive(Default)]
struct MeanSquare {
    sum: f64,
    count: usize,
}

impl MeanSquare {
    fn add(&mut self, error: &Vector3<f64>) {
        self.sum += error.norm_squared();
        self.count += 1;
    }

    fn root(&self) -> f64 {
        (self.sum / self.count as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use daemon::assemble;
    use daemon::config::ConfigFile;

    /// v' = u/m, known exactly to the filter and to the observer: coasting has no error.
    #[test]
    fn a_flight_without_unknown_forces_is_predicted_exactly() {
        let samples: Vec<Sample> = (0..600)
            .map(|j| {
                let t = j as f64 * 0.01;
                Sample {
                    stamp_ns: j * 10_000_000,
                    velocity: Some(Velocity::Inertial(Vector3::new(0.5 * t, 0.0, 0.0))),
                    force_n: Some(Vector3::new(1.1, 0.0, -2.2 * 9.81)),
                    ..Sample::default()
                }
            })
            .collect();
        let flight = Flight::new(samples, 0.5).unwrap();
        let config = ConfigFile::preset("acsl-x8").unwrap();
        let observer = assemble::rigid_body(&config).unwrap();
        let ours = evaluate(&flight, ObserverEstimator(observer, Learn::ALL)).unwrap();
        let filter = KalmanFilter::new(2.2, 0.0, 0.01);
        let gravity = Vector3::new(0.0, 0.0, 2.2 * 9.81);
        let theirs = evaluate(&flight, KalmanEstimator::new(filter, gravity)).unwrap();
        assert_eq!(ours.coasts.len(), 10);
        // A held velocity lags by half a sample. The dead zone hides that, so it is not learned as a force.
        assert!(ours.coast_rms_m_s < 0.01, "{}", ours.coast_rms_m_s);
        assert!(theirs.coast_rms_m_s < 1e-9 && theirs.one_step_rms_m_s < 1e-9, "{}", theirs.coast_rms_m_s);
    }

    #[test]
    fn a_flight_that_is_too_short_is_refused_with_its_length() {
        let sample = Sample {
            velocity: Some(Velocity::Inertial(Vector3::zeros())),
            force_n: Some(Vector3::zeros()),
            ..Sample::default()
        };
        let flight = Flight::new(vec![sample; 3], 0.5).err().unwrap().to_string();
        assert!(flight.contains("0.00 s") && flight.contains("at least 2 s"), "{flight}");
    }
}
