//! The attitude beside the joint filter: a unit quaternion, with a multiplicative Kalman filter of its error and of the
//! gyroscope's bias.
//!
//! ```text
//! q = q̂ ⊗ exp(½ δθ),   b = b̂ + δb,   ω + δb = ω̂ + δω         δθ: rotation vector, body axes
//! δθ' = −ω̂ × δθ − δb + δω,   δb' = n_b
//! ```
//!
//! The joint filter follows y − b̂, hence ω + δb, with the error δω. This error lasts longer than a step. Therefore its
//! covariance C with the attitude's error is carried, too, and the innovation of a rate corrects the attitude as well.
//!
//! | symbol | name | shape | unit |
//! |---|---|---|---|
//! | q̂ | `attitude` | | body to inertial |
//! | b̂ | `bias_rad_s` | 3 | rad/s |
//! | P, of (δθ, δb) | `covariance` | 6×6 | rad², rad²/s, rad²/s² |
//! | C, of (δθ, δb) with δω | `rate_covariance` | 6×3 | rad²/s, rad²/s² |
//!
//! # Source
//! Markley, F. L. (2003). Attitude error representations for Kalman filtering. J. Guidance, Control, and Dynamics 26(2).
//! C is ours.

use crate::law::joint::stray::{STRAY, StraySamples};
use crate::law::joint::update::Agreement;
use nalgebra::{Matrix3, Matrix6, Matrix6x3, UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// Deviation of an attitude that nobody told of (rad).
const UNKNOWN_STD_RAD: f64 = std::f64::consts::PI;

/// A step of the velocity from which a pose is integrated.
#[derive(Debug, Clone, Copy)]
pub struct PoseStep {
    /// Its length (s).
    pub h_s: f64,
    /// The velocity at both ends (m/s; rad/s).
    pub velocities: [Vector3<f64>; 2],
    /// Its deviations there.
    pub std: [[f64; 3]; 2],
    /// Whether the velocity is predicted only: its error then grows along itself, from an error of the force that lasts.
    pub is_coasting: bool,
}

/// What is integrated from the velocity beside the filter: an attitude, or nothing.
pub trait JointPose: Copy {
    /// The pose after a step.
    fn after(&self, step: &PoseStep) -> Self;

    /// What an output has too much.
    fn output_bias(&self) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Takes what an output told of the velocity, whose error correlates with the pose's.
    fn take_innovations(&mut self, agreement: &Agreement);
}

/// The position is a row of the filter.
impl JointPose for () {
    fn after(&self, _: &PoseStep) {}
    fn take_innovations(&mut self, _: &Agreement) {}
}

/// q̂, b̂, P and C.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AttitudeFilter {
    /// q̂, body to inertial.
    pub attitude: UnitQuaternion<f64>,
    /// b̂, body axes (rad/s).
    pub bias_rad_s: Vector3<f64>,
    covariance: Matrix6<f64>,
    rate_covariance: Matrix6x3<f64>,
    stray_fixes: StraySamples,
    /// Lengths of the newest two steps (s) and ω̂ at their beginnings, the newest first; 0 before.
    steps: [(f64, Vector3<f64>); 2],
    /// Variance per time of the bias's random walk ((rad/s)²/s); 0: the gyroscope has none.
    bias_density: f64,
    is_known: bool,
}

impl AttitudeFilter {
    /// The attitude at the start, if it is known; a bias of this prior deviation (rad/s) and random walk (rad/s/√s).
    pub fn new(start: Option<UnitQuaternion<f64>>, bias_std_rad_s: f64, bias_walk_rad_s_sqrt_s: f64) -> Self {
        let attitude_std = if start.is_some() { 0.0 } else { UNKNOWN_STD_RAD };
        let mut covariance = Matrix6::zeros();
        for i in 0..3 {
            covariance[(i, i)] = attitude_std * attitude_std;
            covariance[(i + 3, i + 3)] = bias_std_rad_s * bias_std_rad_s;
        }
        Self {
            attitude: start.unwrap_or_default(),
            bias_rad_s: Vector3::zeros(),
            covariance,
            rate_covariance: Matrix6x3::zeros(),
            stray_fixes: StraySamples::default(),
            steps: [(0.0, Vector3::zeros()); 2],
            bias_density: bias_walk_rad_s_sqrt_s * bias_walk_rad_s_sqrt_s,
            is_known: start.is_some(),
        }
    }

    /// Whether an initial attitude or a fix was ever given.
    pub fn is_known(&self) -> bool {
        self.is_known
    }

    /// 1 σ of the rotation vector of the error, body axes (rad).
    pub fn std_rad(&self) -> [f64; 3] {
        std::array::from_fn(|axis| self.covariance[(axis, axis)].max(0.0).sqrt())
    }

    /// 1 σ of the bias, body axes (rad/s).
    pub fn bias_std_rad_s(&self) -> [f64; 3] {
        std::array::from_fn(|axis| self.covariance[(axis + 3, axis + 3)].max(0.0).sqrt())
    }

    /// Takes a fix of either sign with these deviations of its rotation vector, body axes (rad).
    ///
    /// `e = log(q̂⁻¹ ⊗ q_fix)`, H = (I 0), a Joseph update; then q̂ := q̂ ⊗ exp(½ δθ). A stray fix counts as a noisier one; after
    /// too many in a row it is the attitude that is wrong: `P_θθ += ‖e‖²/3 I`.
    pub fn take_fix(&mut self, fix: &UnitQuaternion<f64>, std_rad: &[f64; 3]) {
        let noise = Matrix3::from_diagonal(&Vector3::from(*std_rad).map(|std| std * std));
        if !self.is_known {
            (self.attitude, self.is_known) = (*fix, true);
            self.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&noise);
            self.covariance.fixed_view_mut::<3, 3>(0, 3).fill(0.0);
            self.covariance.fixed_view_mut::<3, 3>(3, 0).fill(0.0);
            self.rate_covariance.fixed_view_mut::<3, 3>(0, 0).fill(0.0);
            return;
        }
        let error = (self.attitude.inverse() * fix).scaled_axis();
        let prior = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let Some(nis) = (prior + noise).try_inverse().map(|inverse| error.dot(&(inverse * error)) / 3.0)
        else {
            return;
        };
        let is_wrong = self.stray_fixes.count(nis);
        if is_wrong {
            (0..3).for_each(|axis| self.covariance[(axis, axis)] += error.norm_squared() / 3.0);
        }
        let prior = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let factor = if is_wrong { 1.0 } else { (nis.sqrt() / STRAY).max(1.0) };
        let noise = factor * (prior + noise) - prior;
        let Some(inverse) = (prior + noise).try_inverse() else { return };
        let cross: Matrix6x3<f64> = self.covariance.fixed_view::<6, 3>(0, 0).into_owned();
        let gain = cross * inverse;
        let mut remaining = Matrix6::identity();
        let mut measured = remaining.fixed_view_mut::<6, 3>(0, 0);
        measured -= gain;
        self.covariance =
            remaining * self.covariance * remaining.transpose() + gain * noise * gain.transpose();
        self.rate_covariance = remaining * self.rate_covariance;
        self.symmetrize();
        self.correct(gain * error);
    }

    fn correct(&mut self, error: Vector6<f64>) {
        self.attitude *= UnitQuaternion::new(error.fixed_rows::<3>(0).into_owned());
        self.bias_rad_s += error.fixed_rows::<3>(3);
    }

    /// h³/6 D of the newest step, over which ω̂ changes by this (rad).
    fn bend(&self, change: &Vector3<f64>) -> Vector3<f64> {
        let [(h_s, start), (before_s, before)] = self.steps;
        let evenly = if before_s > 0.0 { h_s / before_s * (start - before) } else { *change };
        self.bend_of(&(change - evenly))
    }

    /// The bend where ω̂ ends this far (rad/s) from where it would be without one; 0 after a step that is much shorter, of which
    /// noise would be carried too far.
    fn bend_of(&self, difference: &Vector3<f64>) -> Vector3<f64> {
        let [(h_s, _), (before_s, _)] = self.steps;
        if before_s <= 0.5 * h_s {
            return Vector3::zeros();
        }
        h_s * h_s / (6.0 * (h_s + before_s)) * difference
    }

    fn symmetrize(&mut self) {
        for i in 0..6 {
            for j in 0..i {
                let mean = 0.5 * (self.covariance[(i, j)] + self.covariance[(j, i)]);
                (self.covariance[(i, j)], self.covariance[(j, i)]) = (mean, mean);
            }
        }
    }
}

impl JointPose for AttitudeFilter {
    /// `q̂ := q̂ ⊗ exp(½ (h ω̄ + h²/12 ω̂ × ω̂⁺ − h³/6 D))`, ω̄ = (ω̂ + ω̂⁺)/2, whose error is (δω + δω⁺)/2. The second term is
    /// that of a rate that changes its direction over the step, the third that of its bend: D is the second divided difference
    /// of ω̂⁺, ω̂ and the ω̂ a step before. Without them coning drifts.
    ///
    /// With Φ of (δθ, δb) and J = (h, 0): `P := Φ P Φᵀ + Φ C Jᵀ + J Cᵀ Φᵀ + J var(ω̄) Jᵀ`, `C := Φ C + J cov(ω̄, δω⁺)`. Between
    /// outputs δω⁺ is δω and something new; in a coast it is δω σ⁺/σ.
    fn after(&self, step: &PoseStep) -> Self {
        let h_s = step.h_s;
        if h_s == 0.0 {
            return *self;
        }
        let mut next = *self;
        let [before, after] = step.velocities;
        next.steps = [(h_s, before), self.steps[0]];
        let turn = UnitQuaternion::new(
            0.5 * h_s * (before + after) + h_s * h_s / 12.0 * before.cross(&after)
                - next.bend(&(after - before)),
        );
        next.attitude *= turn;
        next.attitude.renormalize_fast();
        let mut transition = Matrix6::identity();
        let turned = turn.inverse().to_rotation_matrix();
        transition.fixed_view_mut::<3, 3>(0, 0).copy_from(turned.matrix());
        transition.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-h_s * Matrix3::identity()));
        next.covariance = transition * self.covariance * transition.transpose();
        next.rate_covariance = transition * self.rate_covariance;
        for axis in 0..3 {
            let [before, after] = step.std.map(|std| std[axis] * std[axis]);
            // δω⁺ = along δω + something new; ω̄ has `of_before` δω.
            let along = if step.is_coasting && before > 0.0 { (after / before).sqrt() } else { 1.0 };
            let fresh = (after - along * along * before).max(0.0);
            let of_before = 0.5 * (1.0 + along);
            let mean_variance = of_before * of_before * before + 0.25 * fresh;
            for i in 0..6 {
                let cross = h_s * of_before * next.rate_covariance[(i, axis)];
                next.covariance[(i, axis)] += cross;
                next.covariance[(axis, i)] += cross;
                next.rate_covariance[(i, axis)] *= along;
            }
            next.covariance[(axis, axis)] += h_s * h_s * mean_variance;
            next.rate_covariance[(axis, axis)] += h_s * (along * of_before * before + 0.5 * fresh);
            next.covariance[(axis + 3, axis + 3)] += self.bias_density * h_s;
        }
        next.symmetrize();
        next
    }

    fn output_bias(&self) -> Vector3<f64> {
        self.bias_rad_s
    }

    /// δω is known to correlate with (δθ, δb): `(δθ, δb) += C S⁻¹ e`, `P −= C S⁻¹ Cᵀ`, `C := C (1 − K)`. The step's ω̂⁺ was K e
    /// less than it is now: `δθ −= h²/6 ω̂ × K e` (h²/12 of the step, less h²/4 since the correction follows the turn), and its
    /// bend.
    fn take_innovations(&mut self, agreement: &Agreement) {
        let Agreement { innovation, variance, gain, .. } = agreement;
        let mut correction = Vector6::zeros();
        for axis in 0..3 {
            let cross = self.rate_covariance.column(axis).into_owned();
            correction += cross * (innovation[axis] / variance[axis]);
            self.covariance -= cross * cross.transpose() / variance[axis];
            self.rate_covariance.set_column(axis, &(cross * (1.0 - gain[axis])));
        }
        let told = Vector3::from_fn(|axis, _| gain[axis] * innovation[axis]);
        let (h_s, before) = self.steps[0];
        let mut second_order = correction.fixed_rows_mut::<3>(0);
        second_order -= h_s * h_s / 6.0 * before.cross(&told) + self.bend_of(&told);
        self.symmetrize();
        self.correct(correction);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rate sensor with a constant bias, noise, and noisy fixes at 10 Hz: the bias is found, and the errors are as large
    /// as their deviations say.
    #[test]
    fn fixes_tell_the_bias_and_the_deviations_are_honest() {
        let mut seed = 7_u64;
        let mut normal = || {
            (0..12)
                .map(|_| {
                    seed =
                        seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (seed >> 11) as f64 / (1_u64 << 53) as f64
                })
                .sum::<f64>()
                - 6.0
        };
        let (rate_std, fix_std, h) = (0.01, 0.02, 0.01);
        let mut squares = 0.0;
        let runs = 60;
        for _ in 0..runs {
            let bias = Vector3::from_fn(|_, _| 0.02 * normal());
            let mut truth = UnitQuaternion::identity();
            let mut filter = AttitudeFilter::new(None, 0.02, 0.0);
            for j in 0..2000 {
                let t = f64::from(j) * h;
                let rate = Vector3::new(t.sin(), 0.7 * (1.3 * t).cos(), -0.4);
                if j % 10 == 0 {
                    let error = Vector3::from_fn(|_, _| fix_std * normal());
                    filter.take_fix(&(truth * UnitQuaternion::new(error)), &[fix_std; 3]);
                }
                let noise = Vector3::from_fn(|_, _| rate_std * normal());
                let measured = rate + bias + noise - filter.bias_rad_s;
                truth *= UnitQuaternion::new(h * rate);
                let step = PoseStep {
                    h_s: h,
                    velocities: [measured; 2],
                    std: [[rate_std; 3]; 2],
                    is_coasting: false,
                };
                filter.rate_covariance.fill(0.0);
                filter = filter.after(&step);
            }
            let error = (filter.attitude.inverse() * truth).scaled_axis();
            let both = nalgebra::Vector6::from_iterator(
                error.iter().chain((bias - filter.bias_rad_s).iter()).copied(),
            );
            squares += (both.transpose() * filter.covariance.try_inverse().unwrap() * both)[0];
        }
        // χ² of 360 degrees of freedom: its 95 % band is 309 … 414.
        assert!((309.0..414.0).contains(&squares), "{squares}");
    }
}
