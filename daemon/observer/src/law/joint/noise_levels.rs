//! §2a: the noise levels, which follow the innovations, and the level of the corrections.
//!
//! ρ scales the sensor's variance, λ the process's (q and σ_d²). Both take likelihood steps in innovation form.

use super::sensor::{MAX_SENSORS, Outliers, SensorUse};
use serde::{Deserialize, Serialize};

const SENSOR_RANGE: (f64, f64) = (0.01, 100.0);
/// Of so many velocities of one sensor, half are forgotten: another one may come more often from then on.
const COUNTED: u32 = 1024;
/// e⁻² … 100.
const PROCESS_RANGE: (f64, f64) = (0.135_335_283_236_612_7, 100.0);

/// ρ, λ, the sensitivity m, and A².
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct NoiseLevels {
    /// ρ of each velocity's sensor: its variance is ρ r².
    pub(crate) sensor: [f64; MAX_SENSORS],
    /// ρ of each position's.
    pub(crate) position: [f64; MAX_SENSORS],
    /// How many velocities came of each sensor of late: λ follows those of which there are most.
    n_velocities: [u32; MAX_SENSORS],
    /// λ: process noise λ q, disturbance λ σ_d².
    pub(crate) process: f64,
    /// m = ∂v̂/∂ln K.
    pub(crate) sensitivity: [f64; 3],
    /// A², the mean square of the corrections, as an acceleration ((m/s²)²).
    pub(crate) corrections: f64,
}

/// What an update knows of one axis: `None` where it was not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Innovation {
    /// e.
    pub(crate) value: f64,
    /// P_00 before the update.
    pub(crate) prior_variance: f64,
    /// S = P_00 + R.
    pub(crate) variance: f64,
}

impl Innovation {
    /// K = P_00/S.
    pub(crate) fn gain(&self) -> f64 {
        self.prior_variance / self.variance
    }

    /// e²/S.
    pub(crate) fn normalized_square(&self) -> f64 {
        self.value * self.value / self.variance
    }
}

impl NoiseLevels {
    pub(crate) fn configured() -> Self {
        Self {
            sensor: [1.0; MAX_SENSORS],
            position: [1.0; MAX_SENSORS],
            n_velocities: [0; MAX_SENSORS],
            process: 1.0,
            sensitivity: [0.0; 3],
            corrections: 0.0,
        }
    }

    /// ρ of a velocity of this sensor. What bounds an error is not made smaller by a sensor that turned out to be quiet.
    pub(super) fn of_velocity(&self, sensor: SensorUse) -> f64 {
        let learned = self.sensor[sensor.place];
        if sensor.is_bounded { learned.max(1.0) } else { learned }
    }

    /// Follows the innovations of one velocity sample of this sensor; Δ is the time since the sample before (s), 0 at the first.
    ///
    /// ```text
    /// A² = Σ c² P_00 (1−K) (K/Δ)² max(1, λ^{−3/2})
    /// χ = min(1, 4/ζ),  δ_S = (χ²ζ² − 1)/N_a,  δ_K = χ mean(e m/S) / max(K/(2−K), 1e-3) / N_a
    /// ρ := clip(ρ exp(δ_S − K/max(1−K, 0.05) δ_K)),   λ := clip(λ exp(δ_S + 2 δ_K))
    /// m := (1−K) m + K χ e
    /// ```
    pub(crate) fn follow(
        &mut self,
        innovations: &[Option<Innovation>; 3],
        mean_square: f64,
        (since_s, n_samples, correction_share): (f64, f64, f64),
        sensor: SensorUse,
    ) {
        let gains = innovations.map(|innovation| innovation.map(|i| i.gain()));
        let each = || innovations.iter().zip(&gains).filter_map(|(i, gain)| i.as_ref().zip(*gain));
        let n = each().count() as f64;
        if since_s > 0.0 {
            let inflation = (self.process * self.process.sqrt()).recip().max(1.0);
            let corrections =
                each().map(|(i, gain)| i.prior_variance * (1.0 - gain) * gain * gain).sum::<f64>();
            let rate = correction_share / since_s;
            self.corrections = rate * rate * corrections * inflation;
        }
        if n_samples == 0.0 || sensor.is_bounded {
            return;
        }
        let zeta = mean_square.sqrt();
        let chi = if zeta > 4.0 { 4.0 / zeta } else { 1.0 };
        let gain = each().map(|(_, gain)| gain).sum::<f64>() / n;
        let correlation = innovations.iter().zip(&self.sensitivity);
        let correlation = correlation.filter_map(|(i, m)| i.as_ref().map(|i| i.value * m / i.variance));
        // What is rejected says little of the noise of the others.
        let trust = if sensor.outliers == Outliers::Reject { chi * chi } else { 1.0 };
        let place = sensor.place;
        let by_scale = trust * (chi * chi * mean_square - 1.0) / n_samples;
        let by_gain =
            trust * chi * correlation.sum::<f64>() / (n * n_samples * (gain / (2.0 - gain)).max(1e-3));
        let sensor = self.sensor[place] * (by_scale - gain / (1.0 - gain).max(0.05) * by_gain).exp();
        self.sensor[place] = sensor.clamp(SENSOR_RANGE.0, SENSOR_RANGE.1);
        if self.comes_most_often(place) {
            let process = self.process * (by_scale + 2.0 * by_gain).exp();
            self.process = process.clamp(PROCESS_RANGE.0, PROCESS_RANGE.1);
        }
        for ((m, innovation), gain) in self.sensitivity.iter_mut().zip(innovations).zip(gains) {
            if let (Some(innovation), Some(gain)) = (innovation, gain) {
                *m = (1.0 - gain) * *m + gain * chi * innovation.value;
            }
        }
    }

    fn comes_most_often(&mut self, place: usize) -> bool {
        self.n_velocities[place] += 1;
        if self.n_velocities[place] == COUNTED {
            self.n_velocities.iter_mut().for_each(|n| *n /= 2);
        }
        self.n_velocities.iter().all(|n| *n <= self.n_velocities[place])
    }

    /// Follows one component of a position fix: `ρ := clip(ρ exp((1−K)(χ²ζ² − 1)/N_a))`. With K near 1 the innovation
    /// is the dead reckoning's and tells nothing of the sensor.
    pub(crate) fn follow_position(&mut self, innovation: &Innovation, n_samples: f64, place: usize) {
        if n_samples > 0.0 {
            let square = innovation.normalized_square().min(16.0);
            let step = (1.0 - innovation.gain()) * (square - 1.0) / n_samples;
            self.position[place] = (self.position[place] * step.exp()).clamp(SENSOR_RANGE.0, SENSOR_RANGE.1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_is_not_made_smaller_by_a_quiet_sensor_but_larger_by_a_noisy_one() {
        let bounded = SensorUse { is_bounded: true, ..SensorUse::default() };
        let mut levels = NoiseLevels::configured();
        for (learned, wanted) in [(0.1, 1.0), (3.0, 3.0)] {
            levels.sensor[0] = learned;
            assert_eq!(
                [levels.of_velocity(SensorUse::default()), levels.of_velocity(bounded)],
                [learned, wanted]
            );
        }
    }
}
