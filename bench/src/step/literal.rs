//! The paper's law written literally with nalgebra, to measure the cost of the formula as it is printed.

use super::channel::{ADAPTATION_RATE, GAIN_PER_S, INPUT, KERNEL, LENGTH_SCALE, MASS_KG, STEP_S, dead_zone};
use anyhow::{Context, bail};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3xX, Vector3};
use observer::{BodyChannel, DeadZone, Learning, RadialFunction};

/// The law as the paper prints it, on 3N coefficients:
///
/// ```text
/// α̂' = σ(‖ỹ‖) Γ 𝕂⁻¹ 𝒦_Ξ(y)ᵀ ỹ,    f̂ = 𝒦_Ξ(y) α̂
/// ```
///
/// | symbol | name | shape |
/// |---|---|---|
/// | 𝒦_Ξ(y) = [κ₁ I₃ … κ_N I₃] | `kernel_operator` | 3×3N |
/// | 𝕂⁻¹ = K⁻¹ ⊗ I₃ | `gram_inverse` | 3N×3N |
/// | α̂ | `coefficients` | 3N |
///
/// 𝕂⁻¹ is made beforehand, and the scalar Γ comes last, so that no step is charged for scaling a matrix.
pub(super) struct LiteralChannel {
    kernel: RadialFunction,
    centers: Vec<Vector3<f64>>,
    gram_inverse: DMatrix<f64>,
    coefficients: DVector<f64>,
    dead_zone: DeadZone,
}

impl LiteralChannel {
    pub(super) fn new(channel: &BodyChannel) -> anyhow::Result<Self> {
        let space = channel.law().function().space();
        let gram = space.gram();
        let inverse = gram.cholesky().context("the Gram matrix is not positive definite")?.inverse();
        Ok(Self {
            kernel: KERNEL.radial(3)?,
            centers: space.centers().points().map(Vector3::from_column_slice).collect(),
            gram_inverse: inverse.kronecker(&Matrix3::identity()),
            coefficients: DVector::zeros(3 * space.n_centers()),
            dead_zone: dead_zone()?,
        })
    }

    fn kernel_operator(&self, y: &Vector3<f64>) -> Matrix3xX<f64> {
        let mut operator = Matrix3xX::zeros(3 * self.centers.len());
        for (j, center) in self.centers.iter().enumerate() {
            let kernel = self.kernel.value((center - y).norm() / LENGTH_SCALE);
            operator.fixed_view_mut::<3, 3>(0, 3 * j).fill_diagonal(kernel);
        }
        operator
    }

    /// v̂ after one step, and f̂(y).
    pub(super) fn step(
        &mut self,
        estimate: &Vector3<f64>,
        output: &Vector3<f64>,
        input: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let output_error = output - estimate;
        let activation = self.dead_zone.activation(output_error.norm());
        let kernel_operator = self.kernel_operator(output);
        let coefficients_rate =
            &self.gram_inverse * kernel_operator.transpose() * output_error * (ADAPTATION_RATE * activation);
        self.coefficients += coefficients_rate * STEP_S;
        let matched_force = &kernel_operator * &self.coefficients;
        let decay = (-GAIN_PER_S * STEP_S).exp();
        let driving = GAIN_PER_S * output + (input + matched_force) / MASS_KG;
        (decay * estimate + (1.0 - decay) / GAIN_PER_S * driving, matched_force)
    }
}

/// The two formulas are compared over this many steps.
const CHECKED_STEPS: usize = 100;
/// Of the largest force. Rounding enters with the condition of the Gram matrix and the explicit inverse; up
/// to N = 343 it left 5e-14, so that this leaves room for some thousand centers.
const TOLERANCE: f64 = 1e-9;

/// The largest difference of the forces over the first steps, relative to the largest force.
pub(super) fn check_agreement(
    channel: &mut BodyChannel,
    literal: &mut LiteralChannel,
    outputs: &[Vector3<f64>],
) -> anyhow::Result<f64> {
    let mut theirs = Vector3::zeros();
    let (mut difference, mut largest): (f64, f64) = (0.0, 0.0);
    for output in &outputs[..CHECKED_STEPS] {
        let ours = channel.step(output, &INPUT, STEP_S).state.rate;
        let our_force = channel.law_mut().matched_force_at(output, &Learning::none()).value;
        let their_force;
        (theirs, their_force) = literal.step(&theirs, output, &INPUT);
        difference = difference.max((our_force - their_force).amax()).max((ours - theirs).amax());
        largest = largest.max(their_force.amax());
    }
    let relative = difference / largest;
    if relative.is_nan() || relative > TOLERANCE {
        bail!(
            "ours and the literal formula differ by {relative:.1e} of the force after {CHECKED_STEPS} steps; \
             needed: at most {TOLERANCE:.0e}. One of them is wrong, or the Gram matrix is too badly \
             conditioned (here {:.1e}) to compare them: choose fewer centers or a lower --literal-up-to",
            channel.law().function().space().gram_condition()
        );
    }
    Ok(relative)
}

#[cfg(test)]
mod tests {
    use super::super::channel::{centers, design, wandering_outputs};
    use super::*;

    fn channel(n_centers: usize) -> BodyChannel {
        BodyChannel::new(&design(centers(n_centers).unwrap().0).unwrap()).unwrap()
    }

    #[test]
    fn ours_and_the_literal_formula_find_the_same_force() {
        let outputs = wandering_outputs();
        for n_centers in [1, 8, 20, 27, 64] {
            let mut channel = channel(n_centers);
            let mut literal = LiteralChannel::new(&channel).unwrap();
            let difference = check_agreement(&mut channel, &mut literal, &outputs).unwrap();
            assert!(difference < TOLERANCE, "N = {n_centers}: {difference:e}");
            assert!(channel.law().function().native_norm() > 1.0, "nothing was learned");
        }
    }

    #[test]
    fn a_formula_that_differs_is_refused() {
        let mut channel = channel(27);
        let mut literal = LiteralChannel::new(&channel).unwrap();
        literal.gram_inverse *= 1.0 + 1e-6;
        let error = check_agreement(&mut channel, &mut literal, &wandering_outputs()).unwrap_err();
        assert!(error.to_string().contains("differ by"), "{error}");
    }
}
