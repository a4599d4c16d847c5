//! A channel of the rigid body: the law on the plant `M v' = u + f(v)`, `y = v + δ`.
//!
//! The velocity, or the angular velocity, v of a body is estimated by the adaptive observer (Niu et al., eqs.
//! (state estimator) and (final learning laws)) on A = 0, B = M⁻¹, C = I, L = λI:
//!
//! ```text
//! v̂' = λ ỹ + M⁻¹ (u + f̂_N(y)),    θ' = σ(‖ỹ‖) φ(y) (Γ_f ỹ)ᵀ,    ỹ = y − v̂,    f̂_N(y) = θᵀφ(y)
//! ```
//!
//! sampled with the held y and u, update first, then predict: [`Law`] makes θ_{j+1} and f̂, and then
//!
//! ```text
//! v̂_{j+1} = e^{−λh} v̂_j + (1 − e^{−λh})/λ · (λ y + M⁻¹ (u + f̂))
//! ```
//!
//! | symbol | name | shape | unit (translation; rotation) |
//! |---|---|---|---|
//! | v̂ | `estimate` | 3 | m/s; rad/s |
//! | y | `output` | 3 | m/s; rad/s |
//! | u, f̂ | `input`, `matched_force` | 3 | N; N·m |
//! | M | `inertia` | 3×3 | kg; kg·m² |
//! | Γ_f | `adaptation_rate` | 3×3 | kg/s²; N·m |
//! | λ | `gain_per_s` | 1 | 1/s |

use crate::function::learned::LearnedFunction;
use crate::law::gradient::Law;
use crate::law::stability::{StepLimit, largest_learning_rate};
use crate::{Centers, DeadZone, DesignError, Kernel, LengthScale, Parameter, ScaledKernel, Solver};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Everything that a channel is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelDesign {
    /// κ.
    pub kernel: Kernel,
    /// ℓ > 0, in the output's unit.
    pub length_scale: LengthScale,
    /// Ξ_N.
    pub centers: Centers,
    /// Added to the Gram matrix's diagonal, as a multiple of κ(0); ≥ 0.
    pub nugget: f64,
    /// How f̂ is computed.
    pub solver: Solver,
    /// M, symmetric positive definite (kg; kg·m²).
    pub inertia: Matrix3<f64>,
    /// λ > 0 (1/s).
    pub gain_per_s: f64,
    /// Γ_f, symmetric positive definite (kg/s²; N·m).
    pub adaptation_rate: Matrix3<f64>,
    /// σ.
    pub dead_zone: DeadZone,
    /// What is known of the disturbances.
    pub bounds: DisturbanceBounds,
    /// An output is held for at most this long (s); then the channel coasts. Also the longest step of the
    /// law, for which its stability is checked.
    pub hold_s: f64,
    /// Step of coasting (s): f̂ is evaluated once a step at the predicted output.
    pub coast_step_s: f64,
}

/// What is known of the disturbances; 0 is *none*. They shape the guarantees, not the estimate.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DisturbanceBounds {
    /// δ̄ ≥ ‖δ(t)‖, of the measurement error, in the output's unit.
    pub noise: f64,
    /// ξ̄ ≥ ‖ξ(t)‖, of what acts on the plant and is no function of the output: a force (N), a torque (N·m), or for a
    /// general linear plant a rate of the state.
    pub unmatched: f64,
    /// r_f ≥ ‖(I − Π_N) f‖_H, of the part of f that the centers cannot represent; in the input's unit, 0 where f lies
    /// in H_N.
    pub residual_norm: f64,
}

impl DisturbanceBounds {
    pub(crate) fn check(&self) -> Result<(), DesignError> {
        for (parameter, value) in [
            (Parameter::NoiseBound, self.noise),
            (Parameter::UnmatchedBound, self.unmatched),
            (Parameter::ResidualNorm, self.residual_norm),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(DesignError::new(parameter, value.to_string(), "a finite number ≥ 0"));
            }
        }
        Ok(())
    }
}

/// The law and its plant. Everything is allocated here; steps allocate nothing.
///
/// # Source
/// Niu et al., eqs. (state estimator), (final learning laws) on the plants of §VI-A and §VI-B.
#[derive(Debug, Clone)]
pub struct Channel {
    /// ỹ, φ, θ, f̂.
    pub law: Law<3>,
    /// v̂.
    pub integrator: Integrator,
}

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

impl Channel {
    /// Builds the native space and checks the design.
    ///
    /// # Errors
    /// The parameter that is out of range, with what would be accepted: gains and times that are not
    /// positive, an inertia or adaptation rate that is not symmetric positive definite, centers without a
    /// positive definite Gram matrix, or an adaptation rate beyond the sampled-data bound.
    pub fn new(design: &ChannelDesign) -> Result<Self, DesignError> {
        design.check()?;
        let factor = design.largest_rate_factor()?;
        if factor <= 1.0 {
            let largest = design.adaptation_rate.symmetric_eigenvalues().max();
            return Err(DesignError::new(
                Parameter::AdaptationRate,
                format!(
                    "{largest} is unstable when an output is held for {} s (g h (1 − e^(−λh))/(λ m) ≥ 2 (1 + e^(−λh)))",
                    design.hold_s
                ),
                format!("an adaptation rate below {:.4}, or a shorter hold", largest * factor),
            ));
        }
        let step_limit = StepLimit::Integrator {
            gain_per_s: design.gain_per_s,
            fastest_learning: design.fastest_learning(),
        };
        Ok(Self {
            law: Law::new(
                design.function()?,
                &design.centers,
                design.dead_zone,
                design.adaptation_rate,
                step_limit,
            ),
            integrator: Integrator {
                gain_per_s: design.gain_per_s,
                inverse_inertia: design.inertia.try_inverse().expect("positive definite"),
            },
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
        self.law.observe(output, estimate);
        let learning = self.law.learning(h_s);
        let matched_force = self.law.matched_force(&learning).value;
        self.law.learn(&learning);
        self.integrator.follow(estimate, output, &(input + matched_force), h_s).end
    }
}

impl ChannelDesign {
    /// f̂ = 0 with the design's solver; whether the rate is stable is another question.
    ///
    /// # Errors
    /// As [`Channel::new`], but for the rate's stability.
    ///
    /// # Cost
    /// As [`crate::NativeSpace::new`] with the dense solver.
    pub fn function(&self) -> Result<LearnedFunction<3>, DesignError> {
        self.check()?;
        LearnedFunction::zero((self.kernel, &self.length_scale), &self.centers, self.nugget, &self.solver)
    }

    fn check(&self) -> Result<(), DesignError> {
        positive(Parameter::Gain, self.gain_per_s)?;
        positive(Parameter::Hold, self.hold_s)?;
        positive(Parameter::CoastStep, self.coast_step_s)?;
        self.bounds.check()?;
        positive_definite(Parameter::Inertia, &dynamic(&self.inertia))?;
        positive_definite(Parameter::AdaptationRate, &dynamic(&self.adaptation_rate))?;
        if self.centers.dimension() != 3 {
            let found = format!("centers with {} coordinates", self.centers.dimension());
            return Err(DesignError::new(Parameter::Centers, found, "three, one per output"));
        }
        Ok(())
    }

    /// λ_max(M⁻¹ Γ_f): what the fastest direction learns per unit of φᵀφ and σ (1/s²).
    fn fastest_learning(&self) -> f64 {
        // It is that of F⁻¹ Γ F⁻ᵀ with M = F Fᵀ, which is symmetric.
        let factor = self.inertia.cholesky().map(|cholesky| cholesky.l());
        let inverse = factor.and_then(|l| l.try_inverse()).expect("the inertia is positive definite");
        (inverse * self.adaptation_rate * inverse.transpose()).symmetric_eigenvalues().max()
    }

    /// The adaptation rate may be multiplied by less than this, by the sampled-data bound for σ = 1 and the
    /// longest hold.
    pub(crate) fn largest_rate_factor(&self) -> Result<f64, DesignError> {
        let kernel = ScaledKernel::new(self.kernel, &self.length_scale, self.centers.dimension())?;
        let fastest = self.fastest_learning() * kernel.value_at_zero();
        Ok(largest_learning_rate(self.gain_per_s, self.hold_s) / fastest)
    }
}

impl Integrator {
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

pub(crate) fn positive(parameter: Parameter, value: f64) -> Result<(), DesignError> {
    match value.is_finite() && value > 0.0 {
        true => Ok(()),
        false => Err(DesignError::new(parameter, value.to_string(), "a finite number > 0")),
    }
}

pub(crate) fn dynamic(matrix: &Matrix3<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(3, 3, matrix.as_slice())
}

/// Refuses a matrix that is not symmetric positive definite.
pub(crate) fn positive_definite(parameter: Parameter, matrix: &DMatrix<f64>) -> Result<(), DesignError> {
    let is_finite = matrix.iter().all(|entry| entry.is_finite());
    let is_symmetric = is_finite && (matrix - matrix.transpose()).amax() <= 1e-12 * matrix.amax();
    if is_symmetric && matrix.clone().cholesky().is_some() {
        return Ok(());
    }
    let rows: Vec<_> = matrix.row_iter().map(|row| format!("{:?}", row.iter().collect::<Vec<_>>())).collect();
    Err(DesignError::new(parameter, rows.join(" "), "a symmetric positive definite matrix"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DeadZoneShape, LocalSolver};
    use nalgebra::{DMatrix, DVector};

    fn design() -> ChannelDesign {
        ChannelDesign {
            kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
            length_scale: LengthScale::Isotropic(1.0),
            centers: Centers::lattice([-1.0; 3], [1.0; 3], [3; 3]).unwrap(),
            nugget: 0.0,
            solver: Solver::Dense,
            inertia: Matrix3::new(4.0, 0.5, 0.0, 0.5, 3.0, 0.2, 0.0, 0.2, 5.0),
            gain_per_s: 10.0,
            adaptation_rate: Matrix3::new(80.0, 5.0, 0.0, 5.0, 120.0, 0.0, 0.0, 0.0, 100.0),
            dead_zone: DeadZone::new(DeadZoneShape::Saturated, 0.01, 0.01).unwrap(),
            bounds: DisturbanceBounds::default(),
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
        let mut channel = Channel::new(&design).unwrap();
        let gram = channel.law.space().gram();
        let gram_lu = gram.clone().lu();
        let mut alpha = DMatrix::<f64>::zeros(27, 3);
        let mut beta = DMatrix::<f64>::zeros(27, 3);
        let (mut ours, mut theirs) = (Vector3::zeros(), Vector3::zeros());
        for j in 0..2000 {
            let h = [0.003, 0.005, 0.007][j % 3];
            let (y, u) = (output(j), Vector3::new(0.3, -0.2, 0.1));
            let mut k = DVector::zeros(27);
            k.copy_from_slice(&channel.law.space().kernel_vector(y.as_slice()));
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
            let f_theta = channel.law.matched_force(&channel.law.learning(h)).value;
            let scale = f_alpha.norm().max(1.0);
            assert!(
                (f_theta - Vector3::from_column_slice(f_alpha.as_slice())).norm() < 1e-10 * scale,
                "step {j}"
            );
            assert!((f_beta - f_alpha).norm() < 1e-10 * scale, "step {j}");
            assert!((ours - theirs).norm() < 1e-11, "step {j}");
        }
        let coefficients = channel.law.space().coefficients(channel.law.weights());
        assert!((&coefficients - &alpha).norm() < 1e-9 * alpha.norm());
        let norm = (alpha.transpose() * gram * &alpha).trace().sqrt();
        assert!((channel.law.native_norm() / norm - 1.0).abs() < 1e-10);
        assert!(norm > 1.0, "it learned something: {norm}");
    }

    /// In the loop, where each estimate depends on all that was learned before: a drag that nobody modelled.
    #[test]
    fn the_local_solver_learns_what_the_dense_one_learns() {
        let channel = |solver| {
            let centers = Centers::lattice([-1.5; 3], [1.5; 3], [8, 7, 6]).unwrap();
            Channel::new(&ChannelDesign { centers, solver, ..design() }).unwrap()
        };
        let local = LocalSolver { block: Some(6), ..LocalSolver::default() };
        let mut dense = channel(Solver::Dense);
        let mut local = channel(Solver::Local(local));
        let (mut by_dense, mut by_local) = (Vector3::zeros(), Vector3::zeros());
        let (mut difference, mut learned, mut estimate) = (0.0_f64, 0.0_f64, 0.0_f64);
        for j in 0..6000 {
            // y moves as it does whatever is estimated; u is the force that this takes, but for a drag.
            let (y, next) = (output(j), output(j + 1));
            let drag = -0.8 * y.norm() * y;
            let input = design().inertia * (next - y) / 0.005 - drag;
            let step = |channel: &mut Channel, from: &Vector3<f64>| {
                let next = channel.step(from, &y, &input, 0.005);
                (next, channel.law.matched_force(&crate::Learning::none()))
            };
            let (exact, found);
            (by_dense, exact) = step(&mut dense, &by_dense);
            (by_local, found) = step(&mut local, &by_local);
            if j > 3000 {
                difference = difference.max((exact.value - found.value).norm());
                learned = learned.max(exact.value.norm());
                estimate = estimate.max(found.error);
            }
        }
        assert!(learned > 1.0, "{learned}");
        assert!(difference < 0.01 * learned, "{difference} of {learned}");
        assert!(difference > 0.0 && estimate > difference, "{difference}, at most {estimate} expected");
    }

    /// The exact step against RK4 of the differential equation with 1000 substeps.
    #[test]
    fn a_step_is_the_exact_solution_for_held_inputs() {
        let Channel { integrator, .. } = Channel::new(&design()).unwrap();
        let (y, force) = (Vector3::new(0.4, -0.3, 0.2), Vector3::new(1.0, 2.0, -3.0));
        let start = Vector3::new(-1.0, 0.5, 2.0);
        let inverse = design().inertia.try_inverse().unwrap();
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

    #[test]
    fn an_unstable_adaptation_rate_is_refused_with_the_largest_stable_one() {
        let mut design = ChannelDesign { inertia: Matrix3::identity() * 4.0, ..design() };
        design.adaptation_rate = Matrix3::identity() * 1e7;
        let error = Channel::new(&design).unwrap_err();
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
            assert_eq!(Channel::new(&design).is_ok(), accepted);
        }
    }

    #[test]
    fn parameters_out_of_range_are_refused_by_name() {
        type Change = fn(&mut ChannelDesign);
        let cases: [(Parameter, Change); 8] = [
            (Parameter::Gain, |d| d.gain_per_s = 0.0),
            (Parameter::Hold, |d| d.hold_s = f64::NAN),
            (Parameter::CoastStep, |d| d.coast_step_s = -1.0),
            (Parameter::NoiseBound, |d| d.bounds.noise = -1.0),
            (Parameter::Inertia, |d| d.inertia[(0, 1)] = 9.0),
            (Parameter::AdaptationRate, |d| d.adaptation_rate[(2, 2)] = -1.0),
            (Parameter::LengthScale, |d| d.length_scale = LengthScale::Isotropic(0.0)),
            (Parameter::Nugget, |d| d.nugget = f64::INFINITY),
        ];
        for (parameter, change) in cases {
            let mut design = design();
            change(&mut design);
            assert_eq!(Channel::new(&design).unwrap_err().parameter, parameter);
        }
    }

    /// The paper's σ₀ grows with the error without bound: the clamp keeps the sampled law stable.
    #[test]
    fn a_huge_error_cannot_break_the_sampled_bound() {
        let mut design = design();
        design.dead_zone = DeadZone::new(DeadZoneShape::Quadratic, 0.01, 0.01).unwrap();
        design.adaptation_rate = Matrix3::identity() * 1e4;
        let mut channel = Channel::new(&design).unwrap();
        let (mut estimate, mut clamped, mut largest) = (Vector3::new(1e4, 0.0, 0.0), false, 0.0_f64);
        for _ in 0..20_000 {
            let y = Vector3::new(0.1, 0.2, 0.3);
            channel.law.observe(&y, &estimate);
            clamped |= channel.law.learning(0.005).clamped;
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
        let mut channel = Channel::new(&design()).unwrap();
        let mut estimate = Vector3::zeros();
        for j in 0..200 {
            estimate = channel.step(&estimate, &output(j), &Vector3::zeros(), 0.005);
        }
        let learned = channel.law.weights().to_vec();
        channel.law.set_frozen(true);
        for j in 200..400 {
            estimate = channel.step(&estimate, &output(j), &Vector3::zeros(), 0.005);
        }
        assert_eq!(channel.law.weights(), learned);
        assert!(channel.law.native_norm() > 0.0);
    }
}
