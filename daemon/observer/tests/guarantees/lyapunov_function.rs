//! The Lyapunov function of the observer and the terms of its derivative, for simulations: where the truth is
//! known.
//!
//! With e = x − x̂, f̃ = f − f̂ and the Lur'e pair (`A_eᵀP + PA_e = −Q`, `PB = Cᵀ`), on the law in H or, with f
//! in H_N, on the law on the centers,
//!
//! ```text
//! e' = A_e e + B f̃(y) − L δ ,    f̃' = −σ Γ_f E_y* ỹ ,    ỹ = C e + δ
//!
//! V  = eᵀP e + ⟨f̃, Γ_f⁻¹ f̃⟩_H
//! V' = −eᵀQ e − 2 eᵀP L δ + 2 (1 − σ) ⟨f̃(y), C e⟩ − 2 σ ⟨f̃(y), δ⟩
//!       decay     noise         dead zone             dropped
//! ```
//!
//! since 2 eᵀPB f̃(y) = 2 ⟨Ce, f̃(y)⟩ and 2 ⟨f̃', Γ_f⁻¹ f̃⟩_H = −2σ ⟨E_y* ỹ, f̃⟩_H = −2σ ⟨ỹ, f̃(y)⟩. The part
//! of f that the centers cannot represent adds [`LyapunovFunction::residual_term`].
//!
//! The proof of Theorem 1 drops the last term; and V need not fall where 0 ≤ σ ≠ 1, which for the paper's
//! unbounded σ₀ is nearly everywhere. With P = pI, C = I and δ = 0 another function falls for every dead zone:
//!
//! `V_σ = ∫₀^{eᵀPe} σ(√(s/p)) ds + ⟨f̃, Γ_f⁻¹ f̃⟩_H ,    V_σ' = −σ eᵀQ e`
//!
//! because its first part has the derivative σ (−eᵀQe + 2⟨f̃(y), e⟩) and the second −2σ ⟨f̃(y), e⟩.
//!
//! # Source
//! Niu et al., proof of Theorem 1; the dead-zone and the dropped term and V_σ are ours.

use crate::native_function::NativeFunction;
use nalgebra::{DMatrix, DVector};
use observer::{DeadZone, DeadZoneShape};

/// V of one observer.
///
/// | symbol | name | shape |
/// |---|---|---|
/// | P | `p` | n×n, symmetric positive definite, PB = Cᵀ |
/// | A_e = A − LC | `error_dynamics` | n×n |
/// | L | `gain` | n×m |
/// | C | `c` | m×n |
/// | Γ_f | `adaptation_rate` | m×m, symmetric positive definite |
/// | e = x − x̂ | `error` | n |
/// | f̃ = f − f̂ | `function_error` | ℝ^m → ℝ^m |
/// | y | `output` | m, as measured |
/// | δ | `noise` | m, y = Cx + δ |
/// | σ | `activation` | ≥ 0, as used |
#[derive(Debug, Clone)]
pub(crate) struct LyapunovFunction {
    p: DMatrix<f64>,
    /// Q = −(A_eᵀP + PA_e).
    q: DMatrix<f64>,
    /// PL.
    p_gain: DMatrix<f64>,
    c: DMatrix<f64>,
    inverse_adaptation_rate: DMatrix<f64>,
}

/// The terms of V', in V's unit per second; their sum is V'.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LyapunovRate {
    /// −eᵀQe ≤ 0.
    pub(crate) decay: f64,
    /// −2 eᵀPLδ.
    pub(crate) noise: f64,
    /// 2 (1 − σ) ⟨f̃(y), Ce⟩: what is not learned.
    pub(crate) dead_zone: f64,
    /// −2σ ⟨f̃(y), δ⟩: what is learned from the measurement error. The paper's proof drops it.
    pub(crate) dropped: f64,
}

impl LyapunovRate {
    /// V'.
    pub(crate) fn sum(&self) -> f64 {
        self.decay + self.noise + self.dead_zone + self.dropped
    }
}

impl LyapunovFunction {
    /// V from P, A_e, L, C and Γ_f.
    ///
    /// # Panics
    /// Where the shapes do not fit or Γ_f is singular.
    pub(crate) fn new(
        p: DMatrix<f64>,
        error_dynamics: &DMatrix<f64>,
        gain: &DMatrix<f64>,
        c: DMatrix<f64>,
        adaptation_rate: &DMatrix<f64>,
    ) -> Self {
        let inverse_adaptation_rate =
            adaptation_rate.clone().try_inverse().expect("an adaptation rate is positive definite");
        Self {
            q: -(error_dynamics.tr_mul(&p) + &p * error_dynamics),
            p_gain: &p * gain,
            p,
            c,
            inverse_adaptation_rate,
        }
    }

    /// V(e, f̃) = eᵀPe + ⟨f̃, Γ_f⁻¹ f̃⟩_H.
    ///
    /// # Cost
    /// The square of the number of kernels of f̃.
    pub(crate) fn value(&self, error: &DVector<f64>, function_error: &NativeFunction) -> f64 {
        error.dot(&(&self.p * error)) + self.function_part(function_error)
    }

    /// ⟨f̃, Γ_f⁻¹ f̃⟩_H.
    pub(crate) fn function_part(&self, function_error: &NativeFunction) -> f64 {
        function_error.inner_product(&function_error.transformed(&self.inverse_adaptation_rate))
    }

    /// V_σ(e, f̃) = 2p ∫₀^{‖e‖} σ(r) r dr + ⟨f̃, Γ_f⁻¹ f̃⟩_H, where r = √(s/p) in the integral above; `None`
    /// where P is not pI or C not I: then V_σ need not fall.
    pub(crate) fn value_in_dead_zone(
        &self,
        error: &DVector<f64>,
        function_error: &NativeFunction,
        dead_zone: &DeadZone,
    ) -> Option<f64> {
        let p = self.p[(0, 0)];
        let identity = DMatrix::identity(self.p.nrows(), self.p.nrows());
        let is_isotropic = (&self.p - p * &identity).amax() <= 1e-12 * p && self.c == identity;
        is_isotropic
            .then(|| 2.0 * p * first_moment(dead_zone, error.norm()) + self.function_part(function_error))
    }

    /// The terms of V' at one instant.
    pub(crate) fn rate(
        &self,
        error: &DVector<f64>,
        function_error: &NativeFunction,
        output: &DVector<f64>,
        noise: &DVector<f64>,
        activation: f64,
    ) -> LyapunovRate {
        let force_error = DVector::from_vec(function_error.value(output.as_slice()));
        LyapunovRate {
            decay: -error.dot(&(&self.q * error)),
            noise: -2.0 * error.dot(&(&self.p_gain * noise)),
            dead_zone: 2.0 * (1.0 - activation) * force_error.dot(&(&self.c * error)),
            dropped: -2.0 * activation * force_error.dot(noise),
        }
    }

    /// 2σ ⟨((I − Π_N) f)(y), Ce + δ⟩: what the law on the centers adds to V' by learning Π_N E_y* ỹ only, where
    /// `residual` is (I − Π_N) f.
    pub(crate) fn residual_term(
        &self,
        error: &DVector<f64>,
        residual: &NativeFunction,
        output: &DVector<f64>,
        noise: &DVector<f64>,
        activation: f64,
    ) -> f64 {
        let value = DVector::from_vec(residual.value(output.as_slice()));
        2.0 * activation * value.dot(&(&self.c * error + noise))
    }
}

/// ∫₀^e σ(r) r dr: the first moment of σ, in the output's unit to the power 2 (saturated, step) or 3.
///
/// With t = e − d on the buffer, where s = t/ε ≤ 1:
///
/// `quadratic  t³ (4d + 3t) / 24ε ,    saturated  ε (d (s³ − s⁴/2) + ε (3s⁴/4 − 2s⁵/5))`
fn first_moment(zone: &DeadZone, e: f64) -> f64 {
    let (d, epsilon) = (zone.width(), zone.buffer());
    let edge = d + epsilon;
    let squares = |from: f64| (e * e - from * from) / 2.0;
    let quadratic = |t: f64| t * t * t * (4.0 * d + 3.0 * t) / (24.0 * epsilon);
    let saturated = |s: f64| {
        let cube = s * s * s;
        epsilon * (d * cube * (1.0 - s / 2.0) + epsilon * cube * s * (0.75 - 0.4 * s))
    };
    match zone.shape() {
        _ if e <= d => 0.0,
        DeadZoneShape::Step => squares(d),
        DeadZoneShape::Quadratic if e <= edge => quadratic(e - d),
        DeadZoneShape::Quadratic => {
            let cubes = (e * e * e - edge * edge * edge) / 3.0;
            quadratic(epsilon) + cubes - (d + epsilon / 2.0) * squares(edge)
        }
        DeadZoneShape::Saturated if e <= edge => saturated((e - d) / epsilon),
        DeadZoneShape::Saturated => saturated(1.0) + squares(edge),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::designs::Random;
    use observer::{Centers, Kernel, LengthScale, NativeSpace, ScaledKernel};

    /// Against Simpson's rule on 2000 intervals of each of the pieces, on which σ(r) r is a polynomial: its
    /// error is that of the fifth power at most, 1e-13 of the integral.
    #[test]
    fn the_first_moment_is_the_integral() {
        for shape in [DeadZoneShape::Quadratic, DeadZoneShape::Saturated, DeadZoneShape::Step] {
            let zone = DeadZone::new(shape, 0.3, 0.2).unwrap();
            let simpson = |from: f64, to: f64| {
                let n = 2000;
                let width = (to - from) / n as f64;
                let f = |r: f64| zone.activation(r) * r;
                let panel = |i: usize| {
                    let a = from + i as f64 * width;
                    width / 6.0 * (f(a) + 4.0 * f(a + width / 2.0) + f(a + width))
                };
                (0..n).map(panel).sum::<f64>()
            };
            // The step's own jump at d is left to one side.
            let start = 0.3 + 1e-15;
            for e in [0.0, 0.2, 0.3, 0.31, 0.45, 0.5, 0.6, 3.0] {
                let expected = match e {
                    e if e <= 0.3 => 0.0,
                    e if e <= 0.5 => simpson(start, e),
                    e => simpson(start, 0.5) + simpson(0.5, e),
                };
                let found = first_moment(&zone, e);
                assert!(
                    (found - expected).abs() <= 1e-12 * (1.0 + expected),
                    "{shape:?} {e}: {found} {expected}"
                );
            }
        }
    }

    fn random(rows: usize, columns: usize, seed: u64) -> DMatrix<f64> {
        Random(seed).matrix(rows, columns)
    }

    fn random_vector(n: usize, seed: u64) -> DVector<f64> {
        random(n, 1, seed).column(0).into_owned()
    }

    /// A strictly positive real plant with n = 3, m = 2 and a matrix P with PB = Cᵀ, made from P, Q and B; and
    /// where it is.
    struct Case {
        p: DMatrix<f64>,
        a_e: DMatrix<f64>,
        b: DMatrix<f64>,
        c: DMatrix<f64>,
        gain: DMatrix<f64>,
        rate: DMatrix<f64>,
        error: DVector<f64>,
        output: DVector<f64>,
        noise: DVector<f64>,
        function_error: NativeFunction,
        activation: f64,
    }

    fn kernel() -> ScaledKernel {
        let matern = Kernel::SobolevMatern { dimension: 2, order: 2 };
        ScaledKernel::new(matern, &LengthScale::Isotropic(0.7), 2).unwrap()
    }

    fn case(seed: u64) -> Case {
        let (n, m, seed) = (3, 2, 1000 * seed);
        let (p, q) = (Random(seed + 1).positive(n, 0.3), Random(seed + 2).positive(n, 0.3));
        let skew = random(n, n, seed + 3);
        let skew = &skew - skew.transpose();
        let b = random(n, m, seed + 4);
        let mut function_error = NativeFunction::zero(kernel(), m);
        for i in 0..6 {
            let (z, a) = (random_vector(m, seed + 10 + i), random_vector(m, seed + 20 + i));
            function_error.add(z.as_slice(), a.as_slice());
        }
        Case {
            a_e: p.clone().try_inverse().unwrap() * (-0.5 * q + skew),
            c: b.tr_mul(&p),
            gain: random(n, m, seed + 5),
            rate: Random(seed + 6).positive(m, 0.3),
            error: random_vector(n, seed + 7),
            output: random_vector(m, seed + 8),
            noise: random_vector(m, seed + 9),
            activation: random(1, 1, seed + 30)[0].abs(),
            function_error,
            p,
            b,
        }
    }

    impl Case {
        fn lyapunov(&self) -> LyapunovFunction {
            LyapunovFunction::new(self.p.clone(), &self.a_e, &self.gain, self.c.clone(), &self.rate)
        }

        fn force_error(&self) -> DVector<f64> {
            DVector::from_vec(self.function_error.value(self.output.as_slice()))
        }

        /// A_e e + B f̃(y) − Lδ.
        fn error_rate(&self) -> DVector<f64> {
            &self.a_e * &self.error + &self.b * self.force_error() - &self.gain * &self.noise
        }

        /// f̃ − τ σ 𝒦(y,·) Γ_f ỹ.
        fn function_error_after(&self, tau: f64) -> NativeFunction {
            let output_error = &self.c * &self.error + &self.noise;
            let taught = -tau * self.activation * (&self.rate * output_error);
            let mut after = self.function_error.clone();
            after.add(self.output.as_slice(), taught.as_slice());
            after
        }
    }

    /// Central difference of a quadratic: exact but for rounding, 1e-16 V/τ.
    const TAU: f64 = 1e-3;

    #[test]
    fn the_four_terms_sum_to_the_derivative_of_v_on_any_positive_real_plant() {
        for seed in 1..=20 {
            let case = case(seed);
            let v = case.lyapunov();
            let at =
                |tau: f64| v.value(&(&case.error + tau * case.error_rate()), &case.function_error_after(tau));
            let derivative = (at(TAU) - at(-TAU)) / (2.0 * TAU);
            let rate = v.rate(&case.error, &case.function_error, &case.output, &case.noise, case.activation);
            let size = at(0.0) + case.error_rate().norm_squared();
            assert!((rate.sum() - derivative).abs() < 1e-9 * size, "{seed}: {rate:?} {derivative}");
            // Each term matters: without it the sum would be wrong.
            for term in [rate.decay, rate.noise, rate.dead_zone, rate.dropped] {
                assert!(term.abs() > 1e-6 * size, "{seed}: {rate:?}");
            }
        }
    }

    /// In e_δ = e + B(CB)⁻¹δ, for which Ce_δ is the measured ỹ, nothing is dropped:
    ///
    /// `V(e_δ)' = −e_δᵀQe_δ + 2(1 − σ)⟨f̃(y), ỹ⟩ + 2e_δᵀP(Dδ' − ADδ),   D = B(CB)⁻¹,  A = A_e + LC`.
    #[test]
    fn in_the_error_shifted_by_the_noise_v_has_no_dropped_term() {
        for seed in 1..=20 {
            let case = case(seed);
            let v = case.lyapunov();
            let noise_rate = random_vector(2, seed);
            let shift = &case.b * (&case.c * &case.b).try_inverse().unwrap();
            let shifted = &case.error + &shift * &case.noise;
            let at = |tau: f64| {
                let error = &shifted + tau * (case.error_rate() + &shift * &noise_rate);
                v.value(&error, &case.function_error_after(tau))
            };
            let derivative = (at(TAU) - at(-TAU)) / (2.0 * TAU);
            let a = &case.a_e + &case.gain * &case.c;
            let disturbance = &shift * &noise_rate - a * &shift * &case.noise;
            let output_error = &case.c * &case.error + &case.noise;
            assert!((&case.c * &shifted - &output_error).amax() < 1e-9 * (1.0 + shifted.amax()));
            let q = -(case.a_e.tr_mul(&case.p) + &case.p * &case.a_e);
            let expected = -shifted.dot(&(q * &shifted))
                + 2.0 * (1.0 - case.activation) * case.force_error().dot(&output_error)
                + 2.0 * shifted.dot(&(&case.p * disturbance));
            let size = at(0.0) + derivative.abs() + shifted.norm_squared();
            assert!((expected - derivative).abs() < 1e-8 * size, "{seed}: {expected} {derivative}");
        }
    }

    /// The law on the centers learns Π_N E_y* ỹ; with f outside of H_N its V' has the residual's term too.
    #[test]
    fn the_residual_term_is_what_the_projection_leaves() {
        let centers = Centers::lattice([-1.0; 2], [1.0; 2], [3; 2]).unwrap();
        let matern = Kernel::SobolevMatern { dimension: 2, order: 2 };
        let space = NativeSpace::new(matern, &LengthScale::Isotropic(0.7), centers, 0.0).unwrap();
        for seed in 1..=20 {
            let case = case(seed);
            let v = case.lyapunov();
            // f̂_N = 0 here, so that f̃ = f and its residual is f's.
            let projected = NativeFunction::projected(&space, &case.function_error);
            let residual = case.function_error.minus(&projected);
            let at = |tau: f64| {
                let output_error = &case.c * &case.error + &case.noise;
                let taught = tau * case.activation * (&case.rate * output_error);
                let adjoint =
                    NativeFunction::evaluation_adjoint(kernel(), case.output.as_slice(), taught.as_slice());
                let learned = NativeFunction::projected(&space, &adjoint);
                v.value(&(&case.error + tau * case.error_rate()), &case.function_error.minus(&learned))
            };
            let derivative = (at(TAU) - at(-TAU)) / (2.0 * TAU);
            let rate = v.rate(&case.error, &case.function_error, &case.output, &case.noise, case.activation);
            let left = v.residual_term(&case.error, &residual, &case.output, &case.noise, case.activation);
            let size = at(0.0) + case.error_rate().norm_squared();
            assert!((rate.sum() + left - derivative).abs() < 1e-9 * size, "{seed}");
            assert!(left.abs() > 1e-6 * size, "{seed}: {left}");
        }
    }

    /// V_σ' = −σ eᵀQe, in and outside of the buffer. No quadratic: the central difference is right to τ² of the
    /// third derivative, 1e-6/ε².
    #[test]
    fn with_a_dead_zone_of_any_shape_v_sigma_falls_by_sigma_times_the_decay() {
        use DeadZoneShape::{Quadratic, Saturated, Step};
        let (mass, gain) = (2.5, 3.0);
        let identity = DMatrix::<f64>::identity(2, 2);
        for (seed, shape) in (1..=20).flat_map(|seed| [Quadratic, Saturated, Step].map(|shape| (seed, shape)))
        {
            let zone = DeadZone::new(shape, 0.3, 0.6).unwrap();
            let error = random_vector(2, 100 * seed);
            let case = Case {
                p: mass * &identity,
                a_e: -gain * &identity,
                b: &identity / mass,
                c: identity.clone(),
                gain: gain * &identity,
                noise: DVector::zeros(2),
                activation: zone.activation(error.norm()),
                error,
                ..case(seed)
            };
            let v = case.lyapunov();
            let at = |tau: f64| {
                let error = &case.error + tau * case.error_rate();
                v.value_in_dead_zone(&error, &case.function_error_after(tau), &zone).unwrap()
            };
            let derivative = (at(TAU) - at(-TAU)) / (2.0 * TAU);
            let expected = -case.activation * 2.0 * gain * mass * case.error.norm_squared();
            assert!((derivative - expected).abs() < 1e-4 * (1.0 + expected.abs()), "{shape:?} {seed}");
        }
    }

    #[test]
    fn v_sigma_is_given_only_where_it_falls() {
        let zone = DeadZone::new(DeadZoneShape::Saturated, 0.1, 0.1).unwrap();
        let case = case(1);
        assert!(case.lyapunov().value_in_dead_zone(&case.error, &case.function_error, &zone).is_none());
        let identity = DMatrix::<f64>::identity(2, 2);
        let with_p = |p| LyapunovFunction::new(p, &-&identity, &identity, identity.clone(), &identity);
        let e = DVector::from_vec(vec![0.3, -0.4]);
        let anisotropic = DMatrix::from_diagonal(&DVector::from_vec(vec![1.0, 1.01]));
        assert!(with_p(anisotropic).value_in_dead_zone(&e, &case.function_error, &zone).is_none());
        let found = with_p(2.5 * &identity).value_in_dead_zone(&e, &case.function_error, &zone).unwrap();
        let expected = 5.0 * first_moment(&zone, 0.5) + case.function_error.norm().powi(2);
        assert!((found - expected).abs() < 1e-12 * expected);
    }
}
