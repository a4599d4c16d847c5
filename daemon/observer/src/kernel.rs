//! Radial kernels κ(r), the shape of what one center knows about its surroundings.

use std::f64::consts::PI;

/// A radial kernel on ℝ³; 𝔎(y, ξ) = κ(‖y − ξ‖ / ℓ).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kernel {
    /// The reproducing kernel of the Sobolev space H^k(ℝ³), k = 2, 3 or 4.
    ///
    /// `κ(r) = 2 π^{3/2} / Γ(k) · K_{k−3/2}(r) · (r/2)^{k−3/2}`
    ///
    /// K_ν is the modified Bessel function of the second kind; for half-integer ν it is elementary, so
    /// that the limit κ(0) = π^{3/2} Γ(k − 3/2) / Γ(k) is taken without 0 · ∞.
    ///
    /// # Source
    /// Niu et al., *Vector-Valued Native Space Embedding for Adaptive State Observation*, §V-C, whose
    /// print has lost the argument of K.
    SobolevMatern {
        /// Smoothness k.
        order: MaternOrder,
    },
}

/// Smoothness k of a Sobolev–Matérn kernel on ℝ³.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaternOrder {
    /// k = 2: π² e^{−r}; continuous, not differentiable at 0.
    Two,
    /// k = 3: (π²/4) (1 + r) e^{−r}; once differentiable at 0.
    Three,
    /// k = 4: (π²/24) (3 + 3r + r²) e^{−r}; twice differentiable at 0.
    Four,
}

impl Kernel {
    /// κ(r) for r ≥ 0, dimensionless.
    pub fn value(self, r: f64) -> f64 {
        let Self::SobolevMatern { order } = self;
        match order {
            MaternOrder::Two => PI * PI * (-r).exp(),
            MaternOrder::Three => PI * PI / 4.0 * (1.0 + r) * (-r).exp(),
            MaternOrder::Four => PI * PI / 24.0 * (3.0 + 3.0 * r + r * r) * (-r).exp(),
        }
    }

    /// κ(0), the largest value.
    pub fn value_at_zero(self) -> f64 {
        self.value(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORDERS: [(MaternOrder, f64); 3] =
        [(MaternOrder::Two, 2.0), (MaternOrder::Three, 3.0), (MaternOrder::Four, 4.0)];

    /// The Fourier transform of κ is (1 + |ω|²)^{−k} up to a constant: in ℝ³ that says
    /// κ(r) = C/r ∫₀^∞ ω sin(ωr) (1+ω²)^{−k} dω, and C follows from one value. Integrated by Simpson's
    /// rule after integrating by parts once, so that the tail decays as ω^{−2k}.
    #[test]
    fn the_closed_forms_are_the_sobolev_kernels() {
        for (order, k) in ORDERS {
            let kernel = Kernel::SobolevMatern { order };
            let transform = |r: f64| {
                let integrand = |w: f64| (w * r).cos() * (1.0 + w * w).powf(1.0 - k) / (2.0 * (k - 1.0));
                let (end, n) = (2000.0, 2_000_000);
                let h = end / n as f64;
                let sum: f64 =
                    (1..n).map(|i| integrand(i as f64 * h) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
                (integrand(0.0) + integrand(end) + sum) * h / 3.0
            };
            let scale = kernel.value(1.0) / transform(1.0);
            for r in [0.0, 0.3, 2.0, 5.0] {
                let (ours, reference) = (kernel.value(r), scale * transform(r));
                // The tail of k = 2 beyond ω = 2000 is cut: ∫ ω^{−2} leaves at most 2.5e-4 at r = 0.
                let tolerance = if k == 2.0 { 5e-4 } else { 1e-8 };
                assert!(
                    (ours - reference).abs() < tolerance * kernel.value_at_zero(),
                    "k {k} r {r}: {ours} {reference}"
                );
            }
        }
    }

    #[test]
    fn published_values_of_order_three() {
        let kernel = Kernel::SobolevMatern { order: MaternOrder::Three };
        for (r, value) in [(0.0, 2.46740110), (0.5, 2.24483163), (2.0, 1.00177928)] {
            assert!((kernel.value(r) - value).abs() < 5e-9, "{r}");
        }
    }
}
