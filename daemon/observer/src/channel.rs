//! One channel of the law: output error, features, weights, matched force, output estimate.
//!
//! A channel estimates the output v (velocity, or angular velocity) of
//!
//! ```text
//! M v' = u + f(v),    y = v + δ
//! ```
//!
//! whose force f is unknown, by the adaptive observer (Niu et al., eqs. (state estimator) and (final
//! learning laws)) on A = 0, B = M⁻¹, C = I, L = λI:
//!
//! ```text
//! v̂' = λ ỹ + M⁻¹ (u + f̂_N(y)),    θ' = σ(‖ỹ‖) φ(y) (Γ_f ỹ)ᵀ,    ỹ = y − v̂,    f̂_N(y) = θᵀφ(y)
//! ```
//!
//! sampled with the held y and u, update first, then predict:
//!
//! ```text
//! ỹ = y − v̂_j
//! φ = R⁻¹ k(y)
//! θ_{j+1} = θ_j + h σ(‖ỹ‖) φ (Γ_f ỹ)ᵀ
//! f̂ = θ_{j+1}ᵀ φ
//! v̂_{j+1} = e^{−λh} v̂_j + (1 − e^{−λh})/λ · (λ y + M⁻¹ (u + f̂))
//! ```
//!
//! | symbol | name | shape | unit (translation; rotation) |
//! |---|---|---|---|
//! | v̂ | `estimate` | 3 | m/s; rad/s |
//! | y | `output` | 3 | m/s; rad/s |
//! | ỹ | `output_error` | 3 | m/s; rad/s |
//! | u, f̂ | `input`, `matched_force` | 3 | N; N·m |
//! | M | `inertia` | 3×3 | kg; kg·m² |
//! | Γ_f | `adaptation_rate` | 3×3 | kg/s²; N·m |
//! | λ | `gain_per_s` | 1 | 1/s |
//! | θ, φ | `weights`, `features` | N×3, N | N, N·m; 1 |

use crate::native_space::dot;
use crate::stability::largest_learning_rate;
use crate::{Centers, DeadZone, DesignError, Kernel, NativeSpace, Parameter};
use nalgebra::{Matrix3, Vector3};

/// At run time σ is held below this part of what the sampled-data bound allows: the bound itself is where
/// an error changes sign for ever.
const STABILITY_MARGIN: f64 = 0.9;

/// Everything that a channel is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelDesign {
    /// κ.
    pub kernel: Kernel,
    /// ℓ > 0, in the output's unit.
    pub length_scale: f64,
    /// Ξ_N.
    pub centers: Centers,
    /// Added to the Gram matrix's diagonal, as a multiple of κ(0); ≥ 0.
    pub nugget: f64,
    /// M, symmetric positive definite (kg; kg·m²).
    pub inertia: Matrix3<f64>,
    /// λ > 0 (1/s).
    pub gain_per_s: f64,
    /// Γ_f, symmetric positive definite (kg/s²; N·m).
    pub adaptation_rate: Matrix3<f64>,
    /// σ.
    pub dead_zone: DeadZone,
    /// δ̄ ≥ 0, bound on the norm of the measurement error.
    pub noise_bound: f64,
    /// An output is held for at most this long (s); then the channel coasts. Also the longest step of the
    /// law, for which its stability is checked.
    pub hold_s: f64,
    /// Step of coasting (s): f̂ is evaluated once a step at the predicted output.
    pub coast_step_s: f64,
}

/// A channel with its weights. Everything is allocated here; steps allocate nothing.
#[derive(Debug, Clone)]
pub struct Channel {
    space: NativeSpace,
    dead_zone: DeadZone,
    gain_per_s: f64,
    inverse_inertia: Matrix3<f64>,
    adaptation_rate: Matrix3<f64>,
    /// λ_max(M⁻¹ Γ_f): what the fastest direction learns per unit of φᵀφ and σ (1/s²).
    fastest_learning: f64,
    error_bound: f64,
    frozen: bool,
    weights: [Vec<f64>; 3],
    native_norm: f64,
    held: HeldOutput,
    features: Vec<f64>,
    kernel_vector: Vec<f64>,
    query_features: Vec<f64>,
}

/// What follows from the held output alone, before it is known how long it will be held.
#[derive(Debug, Clone, Copy, Default)]
struct HeldOutput {
    output: Vector3<f64>,
    output_error: Vector3<f64>,
    activation: f64,
    squared_features: f64,
    /// θ_jᵀ φ.
    prior_force: Vector3<f64>,
}

/// One update of the weights, θ_{j+1} − θ_j = φ (h σ Γ_f ỹ)ᵀ, for one length of the step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Learning {
    /// σ as used.
    pub activation: f64,
    /// Whether σ was held down to keep the sampled law stable.
    pub clamped: bool,
    /// h σ Γ_f ỹ (N; N·m).
    increment: Vector3<f64>,
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

impl Channel {
    /// Builds the native space and checks the design.
    ///
    /// # Errors
    /// The parameter that is out of range, with what would be accepted: gains and times that are not
    /// positive, an inertia or adaptation rate that is not symmetric positive definite, centers without a
    /// positive definite Gram matrix, or an adaptation rate beyond the sampled-data bound.
    pub fn new(design: ChannelDesign) -> Result<Self, DesignError> {
        let positive = |parameter, value: f64| match value.is_finite() && value > 0.0 {
            true => Ok(()),
            false => Err(DesignError::new(parameter, value.to_string(), "a finite number > 0")),
        };
        positive(Parameter::Gain, design.gain_per_s)?;
        positive(Parameter::Hold, design.hold_s)?;
        positive(Parameter::CoastStep, design.coast_step_s)?;
        if !(design.noise_bound.is_finite() && design.noise_bound >= 0.0) {
            let found = design.noise_bound.to_string();
            return Err(DesignError::new(Parameter::NoiseBound, found, "a finite number ≥ 0"));
        }
        let inertia_factor = positive_definite(Parameter::Inertia, &design.inertia)?;
        positive_definite(Parameter::AdaptationRate, &design.adaptation_rate)?;
        let space = NativeSpace::new(design.kernel, design.length_scale, design.centers, design.nugget)?;

        // λ_max(M⁻¹Γ) is that of F⁻¹ Γ F⁻ᵀ with M = F Fᵀ, which is symmetric.
        let inverse_factor = inertia_factor.try_inverse().expect("a Cholesky factor has an inverse");
        let fastest_learning = (inverse_factor * design.adaptation_rate * inverse_factor.transpose())
            .symmetric_eigenvalues()
            .max();
        let allowed = largest_learning_rate(design.gain_per_s, design.hold_s);
        let largest_rate = allowed / (fastest_learning * design.kernel.value_at_zero());
        if largest_rate <= 1.0 {
            let largest = design.adaptation_rate.symmetric_eigenvalues().max();
            return Err(DesignError::new(
                Parameter::AdaptationRate,
                format!(
                    "{largest} is unstable when an output is held for {} s (g h (1 − e^(−λh))/(λ m) ≥ 2 (1 + e^(−λh)))",
                    design.hold_s
                ),
                format!("an adaptation rate below {:.4}, or a shorter hold", largest * largest_rate),
            ));
        }
        let masses = design.inertia.symmetric_eigenvalues();
        let n = space.n_centers();
        Ok(Self {
            dead_zone: design.dead_zone,
            gain_per_s: design.gain_per_s,
            inverse_inertia: design.inertia.try_inverse().expect("positive definite"),
            adaptation_rate: design.adaptation_rate,
            fastest_learning,
            // E₀ = 2 δ̄ ‖PL‖ / λ_min(PL + LᵀP) with P = M and L = λI.
            error_bound: design.dead_zone.width().max(design.noise_bound * masses.max() / masses.min()),
            frozen: false,
            weights: std::array::from_fn(|_| vec![0.0; n]),
            native_norm: 0.0,
            held: HeldOutput::default(),
            features: vec![0.0; n],
            kernel_vector: vec![0.0; n],
            query_features: vec![0.0; n],
            space,
        })
    }

    /// One whole step of the law: learns from `output`, and returns v̂ after `h_s`.
    ///
    /// # Cost
    /// N(N+1)/2 + 6N multiply-adds and N kernel values; no allocation.
    pub fn step(
        &mut self,
        estimate: &Vector3<f64>,
        output: &Vector3<f64>,
        input: &Vector3<f64>,
        h_s: f64,
    ) -> Vector3<f64> {
        self.observe(output, estimate);
        let learning = self.learning(h_s);
        let matched_force = self.matched_force(&learning);
        self.learn(&learning);
        self.follow(estimate, &(input + matched_force), h_s).end
    }

    /// Takes a new output: ỹ, φ, σ and θᵀφ.
    pub fn observe(&mut self, output: &Vector3<f64>, estimate: &Vector3<f64>) {
        self.held.output = *output;
        self.space.features(output, &mut self.kernel_vector, &mut self.features);
        self.held.squared_features = dot(&self.features, &self.features);
        self.observe_again(estimate);
    }

    /// Takes the held output once more, against a newer estimate and newer weights.
    pub fn observe_again(&mut self, estimate: &Vector3<f64>) {
        self.held.output_error = self.held.output - estimate;
        let open = if self.frozen { 0.0 } else { 1.0 };
        self.held.activation = open * self.dead_zone.activation(self.held.output_error.norm());
        self.held.prior_force = Vector3::from_fn(|axis, _| dot(&self.weights[axis], &self.features));
    }

    /// The weights' update if the output is held for `h_s`.
    pub fn learning(&self, h_s: f64) -> Learning {
        let held = &self.held;
        if held.activation == 0.0 || h_s == 0.0 {
            return Learning::default();
        }
        let allowed = STABILITY_MARGIN * largest_learning_rate(self.gain_per_s, h_s);
        let largest_activation = allowed / (self.fastest_learning * held.squared_features);
        let activation = held.activation.min(largest_activation);
        Learning {
            activation,
            clamped: activation < held.activation,
            increment: h_s * activation * (self.adaptation_rate * held.output_error),
        }
    }

    /// f̂(y) at the held output after the update: `θ_{j+1}ᵀ φ = θ_jᵀ φ + φᵀφ · h σ Γ_f ỹ`.
    pub fn matched_force(&self, learning: &Learning) -> Vector3<f64> {
        self.held.prior_force + self.held.squared_features * learning.increment
    }

    /// θ_{j+1} = θ_j + φ (h σ Γ_f ỹ)ᵀ.
    pub fn learn(&mut self, learning: &Learning) {
        if learning.increment == Vector3::zeros() {
            return;
        }
        let mut squared_norm = 0.0;
        for (theta, increment) in self.weights.iter_mut().zip(&learning.increment) {
            for (weight, feature) in theta.iter_mut().zip(&self.features) {
                *weight += increment * feature;
            }
            squared_norm += dot(theta, theta);
        }
        self.native_norm = squared_norm.sqrt();
    }

    /// f̂ at another point than the held output, with an update of the weights that is not yet made; and
    /// φᵀφ there.
    ///
    /// # Cost
    /// As [`Channel::step`].
    pub fn matched_force_at(&mut self, point: &Vector3<f64>, pending: &Learning) -> (Vector3<f64>, f64) {
        self.space.features(point, &mut self.kernel_vector, &mut self.query_features);
        let pending_part = match pending.increment == Vector3::zeros() {
            true => 0.0,
            false => dot(&self.features, &self.query_features),
        };
        let force = Vector3::from_fn(|axis, _| dot(&self.weights[axis], &self.query_features));
        (force + pending_part * pending.increment, dot(&self.query_features, &self.query_features))
    }

    /// v̂ over a step with the held output: `v̂' = λ (y − v̂) + M⁻¹ F`, exact for constant y and F.
    pub fn follow(&self, estimate: &Vector3<f64>, force: &Vector3<f64>, h_s: f64) -> Segment {
        let lambda = self.gain_per_s;
        let b = -(-lambda * h_s).exp_m1() / lambda;
        let slope = lambda * (self.held.output - estimate) + self.inverse_inertia * force;
        Segment {
            h_s,
            start: *estimate,
            end: estimate + b * slope,
            integral: h_s * estimate + (h_s - b) / lambda * slope,
            output: Some(self.held.output),
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

    /// Stops or resumes learning; what was learned stays in use.
    pub fn set_frozen(&mut self, frozen: bool) {
        self.frozen = frozen;
        if frozen {
            self.held.activation = 0.0;
        }
    }

    /// Whether learning is stopped.
    pub fn frozen(&self) -> bool {
        self.frozen
    }

    /// Forgets what was learned.
    pub fn forget(&mut self) {
        self.weights.iter_mut().for_each(|theta| theta.fill(0.0));
        self.native_norm = 0.0;
        self.held = HeldOutput::default();
    }

    /// θ, one run of N per axis.
    pub fn weights(&self) -> &[Vec<f64>; 3] {
        &self.weights
    }

    /// Takes weights of a channel of the same design. No allocation.
    ///
    /// # Panics
    /// Where a run has not N entries.
    pub fn set_weights(&mut self, weights: &[Vec<f64>; 3]) {
        for (theta, new) in self.weights.iter_mut().zip(weights) {
            theta.copy_from_slice(new);
        }
        self.native_norm = self.weights.iter().map(|theta| dot(theta, theta)).sum::<f64>().sqrt();
    }

    /// The native space of f̂.
    pub fn space(&self) -> &NativeSpace {
        &self.space
    }

    /// ‖f̂_N‖_H = ‖θ‖_F.
    pub fn native_norm(&self) -> f64 {
        self.native_norm
    }

    /// ‖ỹ‖ when the held output was taken.
    pub fn output_error_norm(&self) -> f64 {
        self.held.output_error.norm()
    }

    /// The output that was taken last.
    pub fn held_output(&self) -> &Vector3<f64> {
        &self.held.output
    }

    /// φᵀφ at the held output.
    pub fn squared_features(&self) -> f64 {
        self.held.squared_features
    }

    /// max(d, E₀), E₀ = δ̄ λ_max(M)/λ_min(M): the size that the theorems claim ‖v − v̂‖ settles below, if
    /// their conditions hold.
    pub fn error_bound(&self) -> f64 {
        self.error_bound
    }
}

/// The Cholesky factor of a symmetric positive definite matrix.
fn positive_definite(parameter: Parameter, matrix: &Matrix3<f64>) -> Result<Matrix3<f64>, DesignError> {
    let symmetric = (matrix - matrix.transpose()).abs().max() <= 1e-12 * matrix.abs().max();
    match matrix.cholesky() {
        Some(factor) if symmetric && matrix.iter().all(|entry| entry.is_finite()) => Ok(factor.l()),
        _ => {
            let rows: Vec<_> =
                matrix.row_iter().map(|row| format!("{:?}", row.iter().collect::<Vec<_>>())).collect();
            Err(DesignError::new(parameter, rows.join(" "), "a symmetric positive definite matrix"))
        }
    }
}
