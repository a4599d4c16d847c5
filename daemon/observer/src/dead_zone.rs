//! σ(e): how much of an output error is believed to come from the unknown force, and not from noise.

use crate::{DesignError, Parameter};

/// A Δ-admissible dead zone: zero on [0, d], nondecreasing, continuously differentiable, its derivative
/// locally Lipschitz. The argument is ‖ỹ‖, the error that can be measured; the paper writes ‖x − x̂‖.
///
/// # Source
/// Niu et al., Definition 1 (admissible dead zone) and eqs. (μ_step), (σ₀).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadZone {
    shape: DeadZoneShape,
    width: f64,
    buffer: f64,
}

/// What σ does outside of its width d, over its buffer ε.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeadZoneShape {
    /// `(e − d)² / 2ε` on [d, d+ε], then `e − d − ε/2`: unbounded, so that a large error learns faster.
    ///
    /// The paper's σ₀ prints `e − (d + ε)` for the last branch, which jumps from ε/2 to 0 at d + ε;
    /// integrating its own derivative gives `e − d − ε/2`.
    Quadratic,
    /// `s² (3 − 2s)`, `s = (e − d)/ε` on [d, d+ε], then 1: the adaptation rate means the same at every error.
    Saturated,
    /// 1 outside of the open ball of radius d, 0 in it; the buffer is not used. The μ_step of Theorem 1: not
    /// continuous, so not admissible, and it may chatter.
    Step,
}

impl DeadZone {
    /// A dead zone of width d = `width` ≥ 0 and buffer ε = `buffer` > 0, in the output's unit.
    ///
    /// # Errors
    /// `DeadZoneWidth` or `DeadZoneBuffer` outside of these ranges.
    pub fn new(shape: DeadZoneShape, width: f64, buffer: f64) -> Result<Self, DesignError> {
        if !(width.is_finite() && width >= 0.0) {
            return Err(DesignError::new(Parameter::DeadZoneWidth, width.to_string(), "a finite number ≥ 0"));
        }
        if !(buffer.is_finite() && buffer > 0.0) {
            return Err(DesignError::new(
                Parameter::DeadZoneBuffer,
                buffer.to_string(),
                "a finite number > 0",
            ));
        }
        Ok(Self { shape, width, buffer })
    }

    /// d.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// What σ does outside of d.
    pub fn shape(&self) -> DeadZoneShape {
        self.shape
    }

    /// ε.
    pub fn buffer(&self) -> f64 {
        self.buffer
    }

    /// σ(e) for e = ‖ỹ‖ ≥ 0.
    ///
    /// # Source
    /// Niu et al., eq. (σ₀), corrected; the saturated shape is ours.
    pub fn activation(&self, e: f64) -> f64 {
        let (d, epsilon) = (self.width, self.buffer);
        let s = (e - d) / epsilon;
        match self.shape {
            DeadZoneShape::Step if e >= d => 1.0,
            _ if e <= d => 0.0,
            DeadZoneShape::Step => 0.0,
            DeadZoneShape::Quadratic if s <= 1.0 => (e - d) * s / 2.0,
            DeadZoneShape::Quadratic => e - d - epsilon / 2.0,
            DeadZoneShape::Saturated if s <= 1.0 => s * s * (3.0 - 2.0 * s),
            DeadZoneShape::Saturated => 1.0,
        }
    }

    /// ∫₀^e σ(r) r dr: the first moment of σ, in the output's unit to the power 2 (saturated, step) or 3.
    ///
    /// With t = e − d on the buffer, where s = t/ε ≤ 1:
    ///
    /// `quadratic  t³ (4d + 3t) / 24ε ,    saturated  ε (d (s³ − s⁴/2) + ε (3s⁴/4 − 2s⁵/5))`
    pub fn first_moment(&self, e: f64) -> f64 {
        let (d, epsilon) = (self.width, self.buffer);
        let edge = d + epsilon;
        let squares = |from: f64| (e * e - from * from) / 2.0;
        let quadratic = |t: f64| t * t * t * (4.0 * d + 3.0 * t) / (24.0 * epsilon);
        let saturated = |s: f64| {
            let cube = s * s * s;
            epsilon * (d * cube * (1.0 - s / 2.0) + epsilon * cube * s * (0.75 - 0.4 * s))
        };
        match self.shape {
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
}

#[cfg(test)]
mod tests {
    use super::*;

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
                let found = zone.first_moment(e);
                assert!(
                    (found - expected).abs() <= 1e-12 * (1.0 + expected),
                    "{shape:?} {e}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn both_shapes_are_admissible() {
        for shape in [DeadZoneShape::Quadratic, DeadZoneShape::Saturated] {
            let (d, epsilon) = (0.01, 0.02);
            let zone = DeadZone::new(shape, d, epsilon).unwrap();
            assert_eq!(zone.activation(0.0), 0.0);
            assert_eq!(zone.activation(d), 0.0);
            let h = 1e-7;
            let slope = |e: f64| (zone.activation(e + h) - zone.activation(e - h)) / (2.0 * h);
            let mut previous = zone.activation(0.0);
            for i in 1..5000 {
                let e = i as f64 * 1e-5;
                let now = zone.activation(e);
                assert!(now >= previous, "{shape:?} falls at {e}");
                // Continuous: no step of 1e-5 moves σ by more than the largest slope, 3/(2ε), allows.
                assert!(now - previous <= 1e-5 * 1.5 / epsilon + 1e-12, "{shape:?} jumps at {e}");
                // Continuously differentiable: the second derivative is at most 6/ε².
                assert!(
                    (slope(e) - slope(e - 1e-5)).abs() <= 1e-5 * 6.0 / (epsilon * epsilon) + 1e-5,
                    "{shape:?} kink at {e}"
                );
                previous = now;
            }
        }
    }

    #[test]
    fn values_outside_of_the_buffer() {
        let quadratic = DeadZone::new(DeadZoneShape::Quadratic, 0.01, 0.02).unwrap();
        assert!((quadratic.activation(0.03) - 0.01).abs() < 1e-15);
        assert!((quadratic.activation(1.0) - 0.98).abs() < 1e-15);
        let saturated = DeadZone::new(DeadZoneShape::Saturated, 0.01, 0.02).unwrap();
        assert_eq!(saturated.activation(0.02), 0.5);
        assert_eq!(saturated.activation(1.0), 1.0);
    }

    #[test]
    fn impossible_widths_are_refused() {
        assert!(DeadZone::new(DeadZoneShape::Saturated, -0.1, 0.1).is_err());
        assert!(DeadZone::new(DeadZoneShape::Saturated, 0.1, 0.0).is_err());
        assert!(DeadZone::new(DeadZoneShape::Saturated, f64::NAN, 0.1).is_err());
    }
}
