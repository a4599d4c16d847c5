//! The row of the unknown acceleration: what an accelerometer adds.
//!
//! ```text
//! y = a − a_u − g + σ_a b,  h = (0, 1, ψ_t, σ_a):  e = y − (d + ψᵀθ + σ_a b),  S = hᵀPh + σ_f² P_N² + r²
//! b' = −b/T_a + …,   stationary law N(0, 1): a row of its own, which no prediction sees
//! X += (P h/S_w) eᵀ,  P −= P h (P h)ᵀ/S_w,  S_w as for a velocity
//! ```
//!
//! The covariance sees ψ_t of the newest prediction ([`super::excitation`]), the mean all of ψ. The process's white noise q is no part of S: the
//! accelerometer measures it, too.

use super::filter::JointFilter;
use super::noise_levels::Innovation;
use super::rows::{DISTURBANCE, POSITION, VELOCITY};
use super::sensor::{Outliers, SensorUse};
use super::state::JointState;
use super::stray::STRAY;
use super::teaches::Teaches;
use super::update::{STATE_ROWS, mean_of};

impl JointFilter {
    /// Takes the unknown acceleration that was measured at the state's instant, inertial axes (m/s²), with one deviation r for all of
    /// them, while `command` = a_u is held. Nothing before a first velocity, and without an accelerometer in the design. Returns e (m/s²).
    ///
    /// # Cost
    /// 2n² multiply-adds (6n² where the axes differ) and the features; no allocation.
    pub fn update_acceleration(
        &mut self,
        state: &mut JointState,
        acceleration: &[f64; 3],
        deviation: f64,
        command: &[f64; 3],
        (sensor, teaches): (SensorUse, Teaches),
    ) -> Option<[f64; 3]> {
        let bias = self.design.accelerometer.filter(|_| state.scalars.is_started)?.bias;
        let bias_row = self.n - 1;
        let mut lags = state.scalars.lags;
        let differences = lags.advance(0.0, command, (&self.design.lags_s, &[1.0; 2]));
        let uncovered = self.evaluate_features(&state.velocity(), command, &differences, &state.scalars.axes);
        let means = state.mean.each_ref().map(|mean| &mean[..]);
        let of_weights = self.unit.dots(means, &self.features);
        state.excitation.teaching_features(&self.features, 1.0, &mut self.teaching);
        (self.teaching[VELOCITY], self.teaching[DISTURBANCE], self.teaching[POSITION]) =
            (state.scalars.slope_per_s, 1.0, 0.0);
        self.teaching[bias_row] = bias;
        let kernel_variance = self.design.prior.kernel * self.design.prior.kernel;
        let noise = deviation * deviation + kernel_variance * uncovered;
        let mut prior_variances = [0.0; 3];
        for axis in 0..3 {
            prior_variances[axis] = if axis == 0 || !state.scalars.is_shared {
                let h = &self.teaching;
                state.covariance(axis).times([h, h], [&mut self.product, &mut self.column]);
                self.unit.dots([h], &self.product)[0]
            } else {
                prior_variances[0]
            };
        }
        let innovations: [_; 3] = std::array::from_fn(|axis| {
            Some(Innovation {
                value: acceleration[axis]
                    - state.mean[axis][DISTURBANCE]
                    - of_weights[axis]
                    - bias * state.mean[axis][bias_row],
                prior_variance: prior_variances[axis],
                variance: prior_variances[axis] + noise,
            })
        });
        let nis = mean_of(&innovations, Innovation::normalized_square);
        let factor = match sensor.outliers {
            Outliers::Reject if nis > STRAY * STRAY => return None,
            Outliers::Off => 1.0,
            _ => (nis.sqrt() / STRAY).max(1.0),
        };
        for (axis, innovation) in innovations.iter().flatten().enumerate() {
            let variance = innovation.variance * factor;
            if axis == 0 || !state.scalars.is_shared {
                let (h, w) = (&self.teaching, &mut self.product);
                // Where the axes share P, it is P h already.
                if !state.scalars.is_shared {
                    state.covariance(axis).times([h, h], [w, &mut self.column]);
                }
                let of_root = variance.sqrt().recip();
                self.column.iter_mut().zip(&*w).for_each(|(g, w)| *g = w * of_root);
                let covariance = &mut state.covariances[axis];
                match teaches {
                    Teaches::All => covariance.subtract_square(&self.column),
                    Teaches::State => covariance.subtract_square_of(&STATE_ROWS, &self.column, self.n),
                }
            }
            let (mean, w, step) = (&mut state.mean[axis], &self.product, innovation.value / variance);
            match teaches {
                Teaches::All => mean.iter_mut().zip(w).for_each(|(x, w)| *x += w * step),
                Teaches::State => STATE_ROWS.into_iter().for_each(|row| mean[row] += w[row] * step),
            }
        }
        Some(innovations.map(|innovation| innovation.map_or(0.0, |i| i.value)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::designs::joint_law;
    use crate::law::joint::design::{AccelerometerDesign, JointDesign};
    use crate::law::joint::rows::KERNEL;
    use nalgebra::{DMatrix, DVector};

    const H_S: f64 = 0.01;

    /// A mass with drag and a fast disturbance; 20 s with a velocity each 10 ms, the accelerometer where it is on. Returns the
    /// filter and its state, and the RMS error of the unknown acceleration in the second half.
    fn fly(deviation: Option<f64>) -> (JointFilter, JointState, f64) {
        let accelerometer = Some(AccelerometerDesign { noise: 0.1, bias: 0.3, bias_time_s: 10.0 });
        let mut filter = JointFilter::new(&JointDesign { accelerometer, ..joint_law([0.05; 3]) }).unwrap();
        let mut state = filter.new_state();
        let mut noise = crate::designs::Random(7);
        let (mut v, mut gust, mut squares, mut n) = ([0.0_f64; 3], [0.0_f64; 3], 0.0, 0);
        let how = (SensorUse::default(), Teaches::All);
        for j in 0..2000 {
            let t_s = j as f64 * H_S;
            let command = [(0.7 * t_s).sin(), (1.1 * t_s).cos(), 0.5 * (1.9 * t_s).sin()];
            gust = gust.map(|gust| 0.95 * gust + 0.1 * noise.normal());
            let unknown: [f64; 3] = std::array::from_fn(|i| -0.4 * v[i] * v[i].abs() - 0.2 * v[i] + gust[i]);
            let y = v.map(|v| Some(v + 0.05 * noise.normal()));
            filter.update_velocity(&mut state, &y, &[0.05; 3], H_S, how);
            if let Some(deviation) = deviation {
                let bias = [0.2, -0.1, 0.3];
                let measured = std::array::from_fn(|i| unknown[i] + bias[i] + deviation * noise.normal());
                filter.update_acceleration(&mut state, &measured, deviation, &command, how);
            }
            let learned = filter.predict(&mut state, H_S, &command, &[0.0; 3], Teaches::All);
            if j > 1000 {
                squares += (0..3).map(|i| (learned.value[i] - unknown[i]).powi(2)).sum::<f64>();
                n += 3;
            }
            v = std::array::from_fn(|i| v[i] + H_S * (command[i] + unknown[i]));
        }
        (filter, state, (squares / f64::from(n)).sqrt())
    }

    #[test]
    fn an_accelerometer_tells_the_gusts_that_a_velocity_tells_late() {
        let (with, without) = (fly(Some(0.1)).2, fly(None).2);
        assert!(with < 0.8 * without, "{with} m/s², {without} without");
    }

    /// Against a Kalman update with dense matrices, in the form of Joseph.
    #[test]
    fn the_update_is_that_of_a_kalman_filter() {
        let (mut filter, mut state, _) = fly(None);
        let command = [0.3, -0.2, 0.8];
        let n_weights = filter.n_weights();
        let (before, mean) = (state.covariance_matrix(0, n_weights), state.mean.clone());
        let measured = [0.9, -0.4, 0.2];
        let innovation = filter
            .update_acceleration(&mut state, &measured, 0.3, &command, (SensorUse::default(), Teaches::All))
            .unwrap();
        assert!(innovation.iter().all(|e| e.abs() < 4.0));
        // What the update has left behind: h with ψ_t, and ψ.
        let row = |i: usize| if i < POSITION { i } else { i + KERNEL - POSITION };
        let h = DVector::from_fn(2 + n_weights, |i, _| filter.teaching[row(i)]);
        let psi = DVector::from_fn(2 + n_weights, |i, _| match i {
            1 => 1.0,
            i if i == 1 + n_weights => 0.3,
            i => filter.features[row(i)],
        });
        let differences = state.scalars.lags.advance(0.0, &command, (&filter.design.lags_s, &[1.0; 2]));
        let velocity = mean.each_ref().map(|mean| mean[VELOCITY]);
        let uncovered = filter.evaluate_features(&velocity, &command, &differences, &state.scalars.axes);
        let noise = 0.3_f64.powi(2) + filter.design.prior.kernel.powi(2) * uncovered;
        let gain = &before * &h / (h.dot(&(&before * &h)) + noise);
        let shrink = DMatrix::identity(2 + n_weights, 2 + n_weights) - &gain * h.transpose();
        let wanted = &shrink * &before * shrink.transpose() + noise * &gain * gain.transpose();
        let found = state.covariance_matrix(0, n_weights);
        assert!((&found - &wanted).amax() < 1e-12, "{}", (&found - &wanted).amax());
        for axis in 0..3 {
            let x = DVector::from_fn(2 + n_weights, |i, _| mean[axis][row(i)]);
            let wanted = &x + &gain * (measured[axis] - psi.dot(&x));
            let found = DVector::from_fn(2 + n_weights, |i, _| state.mean[axis][row(i)]);
            assert!((found - wanted).amax() < 1e-12);
        }
    }
}
