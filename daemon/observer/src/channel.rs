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
    pub(crate) increment: Vector3<f64>,
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
            return Learning { activation: held.activation, ..Learning::default() };
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

    /// Stops or resumes learning from the next output on; what was learned stays in use.
    pub fn set_frozen(&mut self, frozen: bool) {
        self.frozen = frozen;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DeadZoneShape, MaternOrder};
    use nalgebra::{DMatrix, DVector};

    fn design() -> ChannelDesign {
        ChannelDesign {
            kernel: Kernel::SobolevMatern { order: MaternOrder::Three },
            length_scale: 1.0,
            centers: Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]).unwrap(),
            nugget: 0.0,
            inertia: Matrix3::new(4.0, 0.5, 0.0, 0.5, 3.0, 0.2, 0.0, 0.2, 5.0),
            gain_per_s: 10.0,
            adaptation_rate: Matrix3::new(80.0, 5.0, 0.0, 5.0, 120.0, 0.0, 0.0, 0.0, 100.0),
            dead_zone: DeadZone::new(DeadZoneShape::Saturated, 0.01, 0.01).unwrap(),
            noise_bound: 0.0,
            hold_s: 0.0075,
            coast_step_s: 0.005,
        }
    }

    /// A path through the centers' box, with errors on both sides of the dead zone.
    fn output(j: usize) -> Vector3<f64> {
        let t = j as f64 * 0.037;
        Vector3::new(t.sin(), (1.3 * t).cos(), (0.7 * t).sin() * 0.9)
    }

    /// The paper's law in its own coordinates, α̂' = σ K⁻¹ k (Γ_f ỹ)ᵀ, and in nodal values β = Kα̂, both with
    /// nalgebra's LU instead of our factor: three coordinates, one function.
    #[test]
    fn weights_coefficients_and_nodal_values_are_the_same_law() {
        let design = design();
        let (inertia, rate, zone) = (design.inertia, design.adaptation_rate, design.dead_zone);
        let mut channel = Channel::new(design).unwrap();
        let gram = channel.space().gram();
        let gram_lu = gram.clone().lu();
        let mut alpha = DMatrix::<f64>::zeros(27, 3);
        let mut beta = DMatrix::<f64>::zeros(27, 3);
        let (mut ours, mut theirs) = (Vector3::zeros(), Vector3::zeros());
        for j in 0..2000 {
            let h = [0.003, 0.005, 0.007][j % 3];
            let (y, u) = (output(j), Vector3::new(0.3, -0.2, 0.1));
            let mut k = DVector::zeros(27);
            channel.space().kernel_vector(&y, k.as_mut_slice());
            let y_error: Vector3<f64> = y - theirs;
            let increment = h * zone.activation(y_error.norm()) * rate * y_error;
            alpha += gram_lu.solve(&k).unwrap() * increment.transpose();
            beta += &k * increment.transpose();
            let f_alpha = alpha.tr_mul(&k);
            let f_beta = gram_lu.solve(&beta).unwrap().tr_mul(&k);
            let force = Vector3::from_column_slice((u + &f_alpha).as_slice());
            let decay = (-10.0 * h).exp();
            theirs =
                decay * theirs + (1.0 - decay) / 10.0 * (10.0 * y + inertia.try_inverse().unwrap() * force);

            ours = channel.step(&ours, &y, &u, h);
            let f_theta =
                channel.held.prior_force + channel.held.squared_features * channel.learning(h).increment;
            let scale = f_alpha.norm().max(1.0);
            assert!(
                (f_theta - Vector3::from_column_slice(f_alpha.as_slice())).norm() < 1e-10 * scale,
                "step {j}"
            );
            assert!((f_beta - f_alpha).norm() < 1e-10 * scale, "step {j}");
            assert!((ours - theirs).norm() < 1e-11, "step {j}");
        }
        let coefficients = channel.space().coefficients(channel.weights());
        assert!((&coefficients - &alpha).norm() < 1e-9 * alpha.norm());
        let norm = (alpha.transpose() * gram * &alpha).trace().sqrt();
        assert!((channel.native_norm() / norm - 1.0).abs() < 1e-10);
        assert!(norm > 1.0, "it learned something: {norm}");
    }

    /// The exact step against RK4 of the differential equation with 1000 substeps.
    #[test]
    fn a_step_is_the_exact_solution_for_held_inputs() {
        let mut channel = Channel::new(design()).unwrap();
        let (y, force) = (Vector3::new(0.4, -0.3, 0.2), Vector3::new(1.0, 2.0, -3.0));
        let start = Vector3::new(-1.0, 0.5, 2.0);
        channel.observe(&y, &start);
        let inverse = design().inertia.try_inverse().unwrap();
        for (segment, lambda) in
            [(channel.follow(&start, &force, 0.1), 10.0), (channel.coast(&start, &force, 0.1), 0.0)]
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

    #[test]
    fn an_unstable_adaptation_rate_is_refused_with_the_largest_stable_one() {
        let mut design = ChannelDesign { inertia: Matrix3::identity() * 4.0, ..design() };
        design.adaptation_rate = Matrix3::identity() * 1e7;
        let error = Channel::new(design.clone()).unwrap_err();
        assert_eq!(error.parameter, Parameter::AdaptationRate);
        let largest: f64 =
            error.needed.split_whitespace().nth(4).unwrap().trim_end_matches(',').parse().unwrap();
        // g h (1 − E)/(λ m) = 2 (1 + E) with g = γ κ(0), by hand.
        let (h, decay) = (0.0075, (-0.075_f64).exp());
        let expected =
            2.0 * (1.0 + decay) * 10.0 * 4.0 / (h * (1.0 - decay)) / (std::f64::consts::PI.powi(2) / 4.0);
        assert!((largest / expected - 1.0).abs() < 1e-4, "{largest} {expected}");
        for (factor, accepted) in [(0.999, true), (1.001, false)] {
            design.adaptation_rate = Matrix3::identity() * (factor * expected);
            assert_eq!(Channel::new(design.clone()).is_ok(), accepted);
        }
    }

    #[test]
    fn parameters_out_of_range_are_refused_by_name() {
        type Change = fn(&mut ChannelDesign);
        let cases: [(Parameter, Change); 8] = [
            (Parameter::Gain, |d| d.gain_per_s = 0.0),
            (Parameter::Hold, |d| d.hold_s = f64::NAN),
            (Parameter::CoastStep, |d| d.coast_step_s = -1.0),
            (Parameter::NoiseBound, |d| d.noise_bound = -1.0),
            (Parameter::Inertia, |d| d.inertia[(0, 1)] = 9.0),
            (Parameter::AdaptationRate, |d| d.adaptation_rate[(2, 2)] = -1.0),
            (Parameter::LengthScale, |d| d.length_scale = 0.0),
            (Parameter::Nugget, |d| d.nugget = f64::INFINITY),
        ];
        for (parameter, change) in cases {
            let mut design = design();
            change(&mut design);
            assert_eq!(Channel::new(design).unwrap_err().parameter, parameter);
        }
    }

    /// The paper's σ₀ grows with the error without bound: the clamp keeps the sampled law stable.
    #[test]
    fn a_huge_error_cannot_break_the_sampled_bound() {
        let mut design = design();
        design.dead_zone = DeadZone::new(DeadZoneShape::Quadratic, 0.01, 0.01).unwrap();
        design.adaptation_rate = Matrix3::identity() * 1e4;
        let mut channel = Channel::new(design).unwrap();
        let (mut estimate, mut clamped, mut largest) = (Vector3::new(1e4, 0.0, 0.0), false, 0.0_f64);
        for _ in 0..20_000 {
            let y = Vector3::new(0.1, 0.2, 0.3);
            channel.observe(&y, &estimate);
            clamped |= channel.learning(0.005).clamped;
            estimate = channel.step(&estimate, &y, &Vector3::zeros(), 0.005);
            largest = largest.max((estimate - y).norm());
        }
        assert!(clamped);
        assert!(
            largest < 2e5 && (estimate - Vector3::new(0.1, 0.2, 0.3)).norm() < 0.1,
            "{largest} {estimate}"
        );
    }

    #[test]
    fn a_frozen_channel_keeps_what_it_learned() {
        let mut channel = Channel::new(design()).unwrap();
        let mut estimate = Vector3::zeros();
        for j in 0..200 {
            estimate = channel.step(&estimate, &output(j), &Vector3::zeros(), 0.005);
        }
        let learned = channel.weights().clone();
        channel.set_frozen(true);
        for j in 200..400 {
            estimate = channel.step(&estimate, &output(j), &Vector3::zeros(), 0.005);
        }
        assert_eq!(channel.weights(), &learned);
        assert!(channel.native_norm() > 0.0);
    }
}
