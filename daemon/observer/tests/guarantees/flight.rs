//! A body on a commanded trajectory, under a force that the observer must learn.

use crate::lyapunov_function::LyapunovFunction;
use crate::native_function::NativeFunction;
use crate::{NOISE_BOUND, dynamic};
use nalgebra::{DMatrix, Vector3};
use observer::{BodyChannel, ChannelDesign, NativeSpace};

/// What is true and what is estimated at one sample, before the law has used it.
pub(crate) struct Instant<'a> {
    /// v − v̂.
    pub(crate) error: Vector3<f64>,
    /// θ.
    pub(crate) weights: &'a [Vec<f64>],
    /// y = v + δ.
    pub(crate) output: Vector3<f64>,
    /// δ.
    pub(crate) noise: Vector3<f64>,
    /// σ as used with this sample.
    pub(crate) activation: f64,
}

/// `n` samples of the step `h_s` of the paper's translation, `M v' = u + f(y)`, from x̂(0) = x(0): its reference, its feedback, the
/// f at the measured output as its plant has it. The plant takes Euler steps of the same length.
pub(crate) fn fly(
    design: &ChannelDesign,
    f: &NativeFunction,
    noise: impl Fn(f64) -> Vector3<f64>,
    (h_s, n): (f64, usize),
    mut look: impl FnMut(&Instant),
) {
    let mut channel = BodyChannel::new(design).unwrap();
    let inverse_inertia = design.inertia.try_inverse().unwrap();
    let (mut r, mut v) = (Vector3::new(0.0, 1.0, 0.0), Vector3::new(1.0, 0.0, 2.0));
    channel.set_rate(v);
    for j in 0..n {
        let t_s = j as f64 * h_s;
        let (sine, cosine) = t_s.sin_cos();
        let (sine_2, cosine_2) = (2.0 * t_s).sin_cos();
        let position = Vector3::new(sine, cosine, sine_2);
        let velocity = Vector3::new(cosine, -sine, 2.0 * cosine_2);
        let acceleration = Vector3::new(-sine, -cosine, -4.0 * sine_2);
        let input = -(r - position) - (v - velocity) + design.inertia * acceleration;
        let noise = noise(t_s);
        let output = v + noise;
        let weights = channel.law().function().weights().to_vec();
        let error = v - channel.output_estimate();
        let learning = channel.step(&output, &input, h_s).learning;
        assert!(!learning.clamped, "the law itself is on trial");
        look(&Instant { error, weights: &weights, output, noise, activation: learning.activation });
        let force = Vector3::from_column_slice(&f.value(output.as_slice()));
        r += h_s * v;
        v += h_s * inverse_inertia * (input + force);
    }
}

/// The paper's force (cos v₁², sin v₂² + sin v₁, cos v₃ + sin v₂), projected onto H_N: a truth that the centers
/// can represent.
pub(crate) fn papers_force(space: &NativeSpace) -> Vec<Vec<f64>> {
    let at = |v: &[f64]| [(v[0] * v[0]).cos(), (v[1] * v[1]).sin() + v[0].sin(), v[2].cos() + v[1].sin()];
    let values: Vec<_> = space.centers().points().map(at).collect();
    space.weights_of_nodal_values(&DMatrix::from_fn(values.len(), 3, |i, j| values[i][j]))
}

/// 0.008 (sin ωt + cos ωt) on each axis; the paper has ω = 0.5 rad/s.
pub(crate) fn papers_noise(omega_rad_s: f64) -> impl Fn(f64) -> Vector3<f64> {
    move |t_s| {
        let (sine, cosine) = (omega_rad_s * t_s).sin_cos();
        let noise = Vector3::repeat(0.008 * (sine + cosine));
        assert!(noise.norm() <= NOISE_BOUND);
        noise
    }
}

/// f̃ = f − f̂_N, both in H_N.
pub(crate) fn function_error(
    space: &NativeSpace,
    truth: &[Vec<f64>],
    weights: &[Vec<f64>],
) -> NativeFunction {
    let difference: Vec<Vec<f64>> = truth
        .iter()
        .zip(weights)
        .map(|(truth, theta)| truth.iter().zip(theta).map(|(a, b)| a - b).collect())
        .collect();
    NativeFunction::of(space, &difference)
}

/// Of a rigid body's channel: A = 0, B = M⁻¹, C = I, L = λI, hence P = M.
pub(crate) fn lyapunov_function(design: &ChannelDesign) -> LyapunovFunction {
    let identity = DMatrix::<f64>::identity(3, 3);
    let gain = design.gain_per_s * &identity;
    LyapunovFunction::new(
        dynamic(&design.inertia),
        &-&gain,
        &gain,
        identity,
        &dynamic(&design.adaptation_rate),
    )
}
