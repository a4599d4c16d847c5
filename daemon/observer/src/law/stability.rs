//! The sampled-data stability bound of the law *update first, then predict*.

/// The largest product g = (rate of learning per unit of output error, over inertia) that a step of
/// `h_s` seconds allows.
///
/// With the output frozen at y, the errors of one channel, e of the velocity and F of the force, follow
///
/// ```text
/// F⁺ = F − g h e          g = γ σ φᵀφ (γ in units of the inertia m)
/// e⁺ = E e + b F⁺ / m     E = e^{−λh},  b = (1 − E)/λ
/// ```
///
/// with determinant E and trace 1 + E − b h g/m. Jury's conditions leave one: `g h (1 − E) / (λ m) < 2 (1 + E)`.
///
/// # Source
/// Ours: the paper's law is continuous. For small h it is g h² < 4m.
///
/// | symbol | name | unit |
/// |---|---|---|
/// | λ | `gain_per_s` | 1/s |
/// | h | `h_s` | s |
/// | g/m | returned | 1/s² |
pub fn largest_learning_rate(gain_per_s: f64, h_s: f64) -> f64 {
    let decay = (-gain_per_s * h_s).exp();
    let b = -(-gain_per_s * h_s).exp_m1() / gain_per_s;
    2.0 * (1.0 + decay) / (h_s * b)
}

/// The limit on h σ φᵀφ that keeps the sampled law stable with its plant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum StepLimit {
    /// [`largest_learning_rate`] of `M v' = u + f(v)`.
    Integrator {
        /// λ (1/s).
        gain_per_s: f64,
        /// λ_max(M⁻¹ Γ_f) (1/s²).
        fastest_learning: f64,
    },
    /// The least bound over all steps up to the longest hold.
    OfEveryStep {
        /// σ φᵀφ (the law's adaptation rate included in the bound).
        largest_learning: f64,
    },
}

impl StepLimit {
    /// σ, or `margin` times the largest σ for a step of `h_s` and this φᵀφ where that is less.
    pub(crate) fn limited(&self, activation: f64, margin: f64, h_s: f64, squared_features: f64) -> f64 {
        match self {
            Self::Integrator { gain_per_s, fastest_learning } => {
                let learning = activation * fastest_learning * squared_features;
                // The bound is at least 2/h², since 1 + E ≥ 1 and b ≤ h: most steps need no more than that.
                if learning * h_s * h_s <= 2.0 * margin {
                    return activation;
                }
                let largest = largest_learning_rate(*gain_per_s, h_s);
                activation.min(margin * largest / (fastest_learning * squared_features))
            }
            Self::OfEveryStep { largest_learning } => {
                activation.min(margin * largest_learning / squared_features)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The spectral radius of the 2×2 recursion, from its characteristic polynomial.
    fn spectral_radius(gain: f64, h: f64, g: f64) -> f64 {
        let decay = (-gain * h).exp();
        let b = (1.0 - decay) / gain;
        let (trace, det) = (1.0 + decay - b * h * g, decay);
        let discriminant = trace * trace / 4.0 - det;
        if discriminant < 0.0 {
            return det.sqrt();
        }
        (trace / 2.0).abs() + discriminant.sqrt()
    }

    #[test]
    fn the_bound_is_where_the_spectral_radius_crosses_one() {
        for (gain, h) in [(10.0, 0.005), (20.0, 0.01), (2.0, 0.5), (100.0, 0.001)] {
            let bound = largest_learning_rate(gain, h);
            assert!(spectral_radius(gain, h, 0.999 * bound) < 1.0);
            assert!(spectral_radius(gain, h, 1.001 * bound) > 1.0);
        }
    }

    #[test]
    fn for_short_steps_it_is_four_over_h_squared() {
        let h = 1e-4;
        assert!((largest_learning_rate(1.0, h) * h * h - 4.0).abs() < 1e-3);
    }
}
