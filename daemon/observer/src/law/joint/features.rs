//! §1: the features ψ(z) of the unknown acceleration, and the actuators' lags.
//!
//! ```text
//! ψ(z) = [ σ_b ; σ_v v/V ; σ_u a_u ; σ_l (a_u − ā_1) ; σ_l (a_u − ā_2) ; σ_f φ(v) ]
//! φ(v) = R⁻¹ k(v), the Newton features of the kernel with κ(0) = 1
//! ā_i' = (a_u − ā_i)/τ_i
//! ```
//!
//! All of it along the axes of the features, inertial ones or the body's ([`super::axes`]).

use super::axes::Axes;
use super::filter::JointFilter;
use super::rows::{KERNEL, N_TURN, WEIGHTS};
use nalgebra::Vector3;

/// The linear rows see no more than this many half-widths: a long coast may run away.
const MAX_LINEAR: f64 = 2.0;

impl JointFilter {
    /// ψ at this velocity and command, inertial, into `self.features`, and P_N(v)², the part that the centers cannot represent.
    pub(crate) fn evaluate_features(
        &mut self,
        velocity: &[f64; 3],
        command: &[f64; 3],
        lag_differences: &[[f64; 3]; 2],
        axes: &Axes,
    ) -> f64 {
        let (velocity, command) = (&axes.of_features(velocity), &axes.of_features(command));
        let lag_differences = lag_differences.each_ref().map(|difference| axes.of_features(difference));
        let (prior, psi) = (&self.design.prior, &mut self.features);
        psi[WEIGHTS] = prior.bias;
        for axis in 0..3 {
            let linear = (velocity[axis] - self.box_center[axis]) / self.largest_half_width;
            psi[WEIGHTS + 1 + axis] = prior.linear * linear.clamp(-MAX_LINEAR, MAX_LINEAR);
            psi[WEIGHTS + 4 + axis] = prior.input * command[axis];
            psi[WEIGHTS + 7 + axis] = prior.lag * lag_differences[0][axis];
            psi[WEIGHTS + 10 + axis] = prior.lag * lag_differences[1][axis];
        }
        let squared_features = self.space.features(velocity, &mut self.buffers);
        // κ is used with κ(0) = 1.
        let value_at_zero = self.space.value_at_zero();
        let scale = prior.kernel / value_at_zero.sqrt();
        for (psi, phi) in psi[KERNEL..].iter_mut().zip(self.buffers.features()) {
            *psi = scale * phi;
        }
        if let Some(body_axes) = &self.design.body_axes {
            // The body's axes: ω and the velocity.
            let turning = Vector3::from(axes.rate).cross(&Vector3::from(*velocity));
            for (psi, turning) in psi[self.n_kernel - N_TURN..].iter_mut().zip(&turning) {
                *psi = body_axes.turn * turning;
            }
        }
        (1.0 - squared_features / value_at_zero).max(0.0)
    }
}
