//! Radial kernels κ(r).

use crate::error::{DesignError, Parameter};
use crate::space::factors::lanes::{exp_of_minus, multiply_add};
use pulp::Simd;
use std::f64::consts::PI;

/// A radial kernel; `𝔎(y, ξ) = κ(r)`, r the distance of y and ξ with each axis divided by its length scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kernel {
    /// The reproducing kernel of the Sobolev space H^k(ℝ^d), k > d/2, ν = k − d/2:
    ///
    /// `κ(r) = 2 π^{d/2} / Γ(k) · K_ν(r) · (r/2)^ν ,   κ(0) = π^{d/2} Γ(ν) / Γ(k)`
    ///
    /// K_ν is the modified Bessel function of the second kind. The larger k, the smoother f̂: it has
    /// derivatives up to the largest integer below 2ν at the centers.
    ///
    /// # Source
    /// Niu et al., *Vector-Valued Native Space Embedding for Adaptive State Observation*, §VI-C, whose
    /// print has lost the argument of K.
    SobolevMatern {
        /// d ≥ 1, the number of outputs.
        dimension: usize,
        /// k > d/2.
        order: usize,
    },
    /// `κ(r) = e^{−r²/2}`, for any d. Very smooth: its Gram matrix is soon singular to working precision.
    Gaussian,
    /// Wendland's `κ(r) = (1 − r)₊⁴ (4r + 1)`, twice differentiable, zero from r = 1 on; d ≤ 3.
    WendlandC2,
    /// Wendland's `κ(r) = (1 − r)₊⁶ (35r² + 18r + 3) / 3`, four times differentiable, zero from r = 1 on; d ≤ 3.
    WendlandC4,
}

impl Kernel {
    /// κ ready for evaluation.
    ///
    /// # Errors
    /// `Kernel` where the kernel is not positive definite on ℝ^`dimension`: k ≤ d/2, a Sobolev–Matérn kernel
    /// of another dimension, or a Wendland kernel with d > 3.
    pub fn radial(self, dimension: usize) -> Result<RadialFunction, DesignError> {
        let refuse = |found: String, needed: String| Err(DesignError::new(Parameter::Kernel, found, needed));
        let form = match self {
            Self::SobolevMatern { dimension: d, order } => {
                if d == 0 || d != dimension {
                    let found = format!("a Sobolev–Matérn kernel on ℝ^{d} for {dimension} outputs");
                    return refuse(found, "the kernel of the outputs' dimension".into());
                }
                if 2 * order <= d || order > MAX_ORDER {
                    let needed = format!("an order k from {} to {MAX_ORDER}", d / 2 + 1);
                    return refuse(format!("a Sobolev–Matérn kernel of order {order} on ℝ^{d}"), needed);
                }
                if d.is_multiple_of(2) {
                    Form::Bessel { at_zero: even_value_at_zero(d, order), nu: order - d / 2 }
                } else {
                    let degree = order - d.div_ceil(2);
                    let (at_zero, coefficients) = (odd_value_at_zero(d, order), bessel_polynomial(degree));
                    match coefficients[..] {
                        [c0] => Form::Exponential0([c0 * at_zero]),
                        [c0, c1] => Form::Exponential1([c0 * at_zero, c1 * at_zero]),
                        [c0, c1, c2] => Form::Exponential2([c0 * at_zero, c1 * at_zero, c2 * at_zero]),
                        _ => Form::Exponential(coefficients.iter().map(|c| c * at_zero).collect()),
                    }
                }
            }
            Self::Gaussian => Form::Gaussian,
            Self::WendlandC2 | Self::WendlandC4 if dimension > 3 => {
                return refuse(
                    format!("a Wendland kernel for {dimension} outputs"),
                    "at most 3 outputs, where it is positive definite; or a Sobolev–Matérn or Gaussian one"
                        .into(),
                );
            }
            Self::WendlandC2 => Form::WendlandC2,
            Self::WendlandC4 => Form::WendlandC4,
        };
        Ok(RadialFunction(form))
    }
}

/// Beyond, coefficients of the closed form come near the smallest doubles.
const MAX_ORDER: usize = 60;

/// κ with its constants worked out: what a step evaluates.
#[derive(Debug, Clone, PartialEq)]
pub struct RadialFunction(Form);

#[derive(Debug, Clone, PartialEq)]
enum Form {
    /// `e^{−r} Σ c_i r^i`: half-integer ν, degree ν − 1/2. The first three have loops of their own.
    Exponential0([f64; 1]),
    Exponential1([f64; 2]),
    Exponential2([f64; 3]),
    Exponential(Vec<f64>),
    /// Integer ν: from K₀ and K₁.
    Bessel {
        at_zero: f64,
        nu: usize,
    },
    Gaussian,
    WendlandC2,
    WendlandC4,
}

impl RadialFunction {
    /// κ(r) for r ≥ 0, dimensionless. Relative error below 1e-14 wherever κ(r) is a normal number; exactly κ(0)
    /// at r = 0.
    pub fn value(&self, r: f64) -> f64 {
        match &self.0 {
            Form::Exponential0(c) => exponential(c, r),
            Form::Exponential1(c) => exponential(c, r),
            Form::Exponential2(c) => exponential(c, r),
            Form::Exponential(c) => exponential(c, r),
            Form::Bessel { at_zero, nu } => at_zero * normalized_bessel(*nu, r),
            Form::Gaussian => gaussian(r),
            Form::WendlandC2 => wendland_c2(r),
            Form::WendlandC4 => wendland_c4(r),
        }
    }

    /// κ(0), the largest value.
    pub fn value_at_zero(&self) -> f64 {
        self.value(0.0)
    }

    /// Replaces each squared distance r² by κ(r). No allocation.
    ///
    /// Relative error below 1e-13; where κ(r) is below the smallest normal number, about that.
    #[inline(always)]
    pub(crate) fn replace_squares<S: Simd>(&self, squares: &mut [f64]) {
        match &self.0 {
            Form::Exponential0([c0]) => each(squares, |r| c0 * exp_of_minus::<S>(r)),
            Form::Exponential1([c0, c1]) => {
                each(squares, |r| multiply_add::<S>(*c1, r, *c0) * exp_of_minus::<S>(r));
            }
            Form::Exponential2([c0, c1, c2]) => each(squares, |r| {
                let polynomial = multiply_add::<S>(multiply_add::<S>(*c2, r, *c1), r, *c0);
                polynomial * exp_of_minus::<S>(r)
            }),
            Form::Exponential(c) => each(squares, |r| {
                let horner = |sum, c: &f64| multiply_add::<S>(sum, r, *c);
                c.iter().rev().fold(0.0, horner) * exp_of_minus::<S>(r)
            }),
            Form::Bessel { at_zero, nu } => each(squares, |r| at_zero * normalized_bessel(*nu, r)),
            Form::Gaussian => each(squares, |r| exp_of_minus::<S>(0.5 * r * r)),
            Form::WendlandC2 => each(squares, wendland_c2),
            Form::WendlandC4 => each(squares, wendland_c4),
        }
    }
}

/// One flat loop: what the compiler turns into vector instructions.
#[inline(always)]
fn each(squares: &mut [f64], kappa: impl Fn(f64) -> f64) {
    for square in squares {
        *square = kappa(square.sqrt());
    }
}

fn exponential(coefficients: &[f64], r: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * r + c) * (-r).exp()
}

fn gaussian(r: f64) -> f64 {
    (-0.5 * r * r).exp()
}

#[inline(always)]
fn wendland_c2(r: f64) -> f64 {
    let square = (1.0 - r).max(0.0) * (1.0 - r).max(0.0);
    square * square * (4.0 * r + 1.0)
}

#[inline(always)]
fn wendland_c4(r: f64) -> f64 {
    let square = (1.0 - r).max(0.0) * (1.0 - r).max(0.0);
    square * square * square * ((35.0 * r + 18.0) * r + 3.0) / 3.0
}

/// `c_i` of `K_ν(r) r^ν / lim_{r→0} K_ν(r) r^ν = e^{−r} Σ_{i=0}^n c_i r^i`, ν = n + 1/2: the reverse Bessel polynomial with
/// c₀ = 1, `c_{i+1} / c_i = 2 (n − i) / ((2n − i)(i + 1))`.
fn bessel_polynomial(degree: usize) -> Vec<f64> {
    let n = degree;
    let mut coefficients = vec![1.0];
    for i in 0..n {
        let ratio = 2.0 * (n - i) as f64 / ((2 * n - i) as f64 * (i + 1) as f64);
        coefficients.push(coefficients[i] * ratio);
    }
    coefficients
}

/// `π^{d/2} Γ(k − d/2) / Γ(k)` for odd d: `Γ(n + 1/2) = √π Π_{i=1}^n (i − 1/2)`, n = k − (d+1)/2.
fn odd_value_at_zero(d: usize, k: usize) -> f64 {
    let n = k - d.div_ceil(2);
    let factor = |i: usize| if i <= n { (i as f64 - 0.5) / i as f64 } else { 1.0 / i as f64 };
    PI.powi(d.div_ceil(2) as i32) * (1..k).map(factor).product::<f64>()
}

/// `π^{d/2} Γ(k − d/2) / Γ(k) = π^{d/2} / Π_{i=1}^{d/2} (k − i)` for even d.
fn even_value_at_zero(d: usize, k: usize) -> f64 {
    PI.powi(d as i32 / 2) / (1..=d / 2).map(|i| (k - i) as f64).product::<f64>()
}

/// `T_ν(r) = 2/Γ(ν) · K_ν(r) (r/2)^ν` for integer ν ≥ 1, with T_ν(0) = 1.
///
/// The upward recurrence `K_{ν+1} = K_{ν−1} + (2ν/r) K_ν` in these terms has no 0 · ∞:
/// `T_1 = r K_1,  T_2 = T_1 + (r²/2) K_0,  T_{ν+1} = T_ν + (r/2)² T_{ν−1} / (ν(ν−1))`; all terms are positive.
fn normalized_bessel(nu: usize, r: f64) -> f64 {
    // Below, T differs from 1 by less than r² |ln r|; and K₁ would overflow.
    if r < 1e-150 {
        return 1.0;
    }
    let mut previous = r * pxfm::f_k1(r);
    if nu == 1 {
        return previous;
    }
    let mut current = previous + 0.5 * r * r * pxfm::f_k0(r);
    for nu in 2..nu {
        let nu = nu as f64;
        let next = current + 0.25 * r * r * previous / (nu * (nu - 1.0));
        (previous, current) = (current, next);
    }
    current
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::factors::lanes::{VectorLoop, VectorUnit};

    struct Replace<'a>(&'a RadialFunction, &'a mut [f64]);

    impl VectorLoop for Replace<'_> {
        type Output = ();

        #[inline(always)]
        fn call<S: Simd>(self, _: S) {
            self.0.replace_squares::<S>(self.1);
        }
    }

    /// The evaluation in steps against the plain values, which `tests/guarantees/reference_tables.rs` compares with mpmath.
    #[test]
    fn kernels_in_vectors_have_the_plain_values() {
        let matern = |dimension, order| (Kernel::SobolevMatern { dimension, order }, dimension);
        let kernels = [
            matern(3, 2),
            matern(3, 3),
            matern(3, 4),
            matern(3, 9),
            matern(2, 2),
            matern(4, 5),
            matern(1, 1),
        ];
        let others = [Kernel::Gaussian, Kernel::WendlandC2, Kernel::WendlandC4].map(|kernel| (kernel, 3));
        let distances: Vec<f64> =
            (0..4000).map(|i| i as f64 * 0.005).chain([1e-12, 1e-6, 50.0, 300.0]).collect();
        for (kernel, dimension) in kernels.into_iter().chain(others) {
            let radial = kernel.radial(dimension).unwrap();
            for unit in [VectorUnit::of_this_machine(), VectorUnit::baseline()] {
                let mut values: Vec<f64> = distances.iter().map(|r| r * r).collect();
                unit.run(Replace(&radial, &mut values));
                for (r, found) in distances.iter().zip(values) {
                    // Through the square and its root, r itself has moved by a rounding error.
                    let expected = radial.value((r * r).sqrt());
                    let tolerance = 1e-13 * expected + 1e-16 * f64::from(expected < 1e-300);
                    assert!(
                        (found - expected).abs() <= tolerance,
                        "{kernel:?} at {r}: {found:e} {expected:e}"
                    );
                }
            }
        }
    }
}
