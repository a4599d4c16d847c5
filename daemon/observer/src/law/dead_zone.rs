//! The dead zone σ(e): which part of an output error is learned from. Smaller errors count as noise.

use crate::error::{DesignError, Parameter};

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

/// The shape of σ outside of its width d, over its buffer ε.
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

    /// The shape of σ outside of d.
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
}

#[cfg(test)]
mod tests {
    use super::*;

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
