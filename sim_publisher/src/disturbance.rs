//! Coloured noise: the part of the true force that is not a function of the motion.

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A first-order Gauss–Markov process on each of three axes, stationary from the start.
///
/// `ξ(t + h) = e^{−h/τ} ξ(t) + s √(1 − e^{−2h/τ}) n ,   n ~ N(0, 1)`
///
/// Exact for every h, so a change of the sample rate does not change its statistics:
/// `E ξ² = s²`, `E ξ(t) ξ(t + h) = s² e^{−|h|/τ}`. Between samples it is held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussMarkov {
    /// τ (s).
    pub time_constant_s: f64,
    /// s, of each axis, in the unit of the disturbance.
    pub rms: f64,
}

impl GaussMarkov {
    /// A value from the stationary distribution.
    pub fn stationary(&self, random: &mut ChaCha8Rng) -> Vector3<f64> {
        self.rms * white(random)
    }

    /// The value `dt_s` after `value`.
    pub fn next(&self, value: &Vector3<f64>, dt_s: f64, random: &mut ChaCha8Rng) -> Vector3<f64> {
        let memory = (-dt_s / self.time_constant_s).exp();
        let fresh = -(-2.0 * dt_s / self.time_constant_s).exp_m1();
        memory * value + self.rms * fresh.sqrt() * white(random)
    }
}

/// Three independent values from N(0, 1).
pub(crate) fn white(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(random))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn variance_and_correlation_follow_theory_at_uneven_steps() {
        let process = GaussMarkov { time_constant_s: 1.0, rms: 0.3 };
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let (mut value, mut time_constants) = (process.stationary(&mut random), 0.0);
        let (mut square, mut lagged, mut n) = (0.0, 0.0, 0.0);
        // Pairs of a short and a long step: a wrong scaling with h would show in one of them.
        for _ in 0..40_000 {
            let after = process.next(&value, 0.7, &mut random);
            square += value.norm_squared();
            lagged += value.dot(&after);
            value = process.next(&after, 0.05, &mut random);
            (n, time_constants) = (n + 3.0, time_constants + 0.75);
        }
        // The variance's own standard deviation is s² √(2τ/T) for each axis; four of them, over three axes.
        let tolerance = 4.0 * 0.09 * (2.0f64 / (3.0 * time_constants)).sqrt();
        let (variance, covariance) = (square / n, lagged / n);
        assert!((variance - 0.09).abs() < tolerance, "{variance}, tolerance {tolerance}");
        assert!((covariance - 0.09 * (-0.7f64).exp()).abs() < tolerance, "{covariance}");
        assert!(tolerance < 0.003, "the run is too short to tell anything");
    }
}
