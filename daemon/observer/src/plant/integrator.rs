//! Integrates the velocity of a body, linear or angular, over one step with held inputs.

use nalgebra::{Matrix3, Vector3};

/// `v̂' = λ (y − v̂) + M⁻¹ F`, solved exactly for held y and F.
///
/// # Source
/// Niu et al., eq. (state estimator) with A = 0, B = M⁻¹, C = I, L = λI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Integrator {
    gain_per_s: f64,
    inverse_inertia: Matrix3<f64>,
}

/// The output estimate over one step.
#[derive(Debug, Clone, Copy)]
pub struct Segment {
    /// h (s).
    pub h_s: f64,
    /// v̂ at its start.
    pub start: Vector3<f64>,
    /// v̂ at its end.
    pub end: Vector3<f64>,
    /// ∫v̂ over it.
    pub integral: Vector3<f64>,
    /// The output that was held; `None` while coasting.
    pub output: Option<Vector3<f64>>,
}

impl Integrator {
    /// The velocity of a body with this inertia, which is positive definite.
    pub(crate) fn new(gain_per_s: f64, inertia: &Matrix3<f64>) -> Self {
        Self { gain_per_s, inverse_inertia: inertia.try_inverse().expect("positive definite") }
    }

    /// v̂ over a step with the held output: `v̂' = λ (y − v̂) + M⁻¹ F`, exact for constant y and F.
    pub fn follow(
        &self,
        estimate: &Vector3<f64>,
        output: &Vector3<f64>,
        force: &Vector3<f64>,
        h_s: f64,
    ) -> Segment {
        let lambda = self.gain_per_s;
        let b = -(-lambda * h_s).exp_m1() / lambda;
        let slope = lambda * (output - estimate) + self.inverse_inertia * force;
        Segment {
            h_s,
            start: *estimate,
            end: estimate + b * slope,
            integral: h_s * estimate + (h_s - b) / lambda * slope,
            output: Some(*output),
        }
    }

    /// v̂ over a step without any output: `v̂' = M⁻¹ F`, exact for constant F.
    pub fn coast(&self, estimate: &Vector3<f64>, force: &Vector3<f64>, h_s: f64) -> Segment {
        let slope = self.inverse_inertia * force;
        Segment {
            h_s,
            start: *estimate,
            end: estimate + h_s * slope,
            integral: h_s * estimate + 0.5 * h_s * h_s * slope,
            output: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The exact step against RK4 of the differential equation with 1000 substeps.
    #[test]
    fn a_step_is_the_exact_solution_for_held_inputs() {
        let inertia = Matrix3::new(4.0, 0.5, 0.0, 0.5, 3.0, 0.2, 0.0, 0.2, 5.0);
        let integrator = Integrator::new(10.0, &inertia);
        let (y, force) = (Vector3::new(0.4, -0.3, 0.2), Vector3::new(1.0, 2.0, -3.0));
        let start = Vector3::new(-1.0, 0.5, 2.0);
        let inverse = inertia.try_inverse().unwrap();
        for (segment, lambda) in
            [(integrator.follow(&start, &y, &force, 0.1), 10.0), (integrator.coast(&start, &force, 0.1), 0.0)]
        {
            let slope = |v: &Vector3<f64>| lambda * (y - v) + inverse * force;
            let (mut v, mut integral, h) = (start, Vector3::zeros(), 1e-4);
            for _ in 0..1000 {
                let (k1, v1) = (slope(&v), v);
                let v2 = v + 0.5 * h * k1;
                let k2 = slope(&v2);
                let v3 = v + 0.5 * h * k2;
                let k3 = slope(&v3);
                let v4 = v + h * k3;
                integral += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
                v += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(&v4));
            }
            assert!((segment.end - v).norm() < 1e-12);
            assert!((segment.integral - integral).norm() < 1e-12);
        }
    }
}
