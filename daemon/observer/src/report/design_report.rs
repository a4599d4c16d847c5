//! The design report: every condition of the theorems, computed for a design (Niu et al., §III to §V).
//!
//! | condition | purpose |
//! |---|---|
//! | (A, B) controllable, (A, C) observable | assumed of the plant |
//! | A_e = A − LC Hurwitz | the estimate follows the output |
//! | `A_eᵀP + PA_e = −WᵀW − εP`, `PB = Cᵀ` (Lur'e) | the learning law takes energy out of the error |
//! | E₀, d_N (see [`Certificate`]) | the size that the error settles below |
//! | d > d_N | Theorem 2 |
//! | `h σ φᵀφ` below its bound (see [`crate::law::stability`]) | the sampled law is stable; ours, the paper is continuous |
//!
//! The theorems hold for the observable part of the state only; the rest is integrated from it. For a body whose velocity is
//! measured the rest is the position.

use crate::design::{ChannelDesign, DisturbanceBounds, RotationDesign, TranslationDesign, dynamic};
use crate::error::DesignError;
use crate::function::learned::LearnedFunction;
use crate::function::solver::SolverInUse;
use crate::law::dead_zone::DeadZoneShape;
use crate::law::linear_stability::largest_learning_of_every_step;
use crate::linear_design::LinearDesign;
use crate::plant::linear::MAX_OUTPUTS;
use crate::plant::linear_algebra::{
    complement, eigenvalues, inverse_norm, reachable_subspace, spectral_abscissa, spectral_norm,
};
use crate::report::box_search::Supremum;
use crate::report::certificate::Certificate;
use crate::report::lure_pair::LurePair;
use crate::report::words::{axes, in_words, state_names};
use nalgebra::{Complex, DMatrix, Matrix3};

/// What is proven for one channel: the assumptions of Niu et al., §III, and the conditions of Theorems 1 and 2.
#[derive(Debug, Clone)]
pub struct DesignReport {
    /// The names of the n states.
    pub states: Vec<String>,
    /// (A, B).
    pub controllable: bool,
    /// (A, C), C with the fixes that are used.
    pub observable: bool,
    /// The unobservable subspace in words; empty where there is none.
    pub unobservable: Vec<String>,
    /// The eigenvalues of A_e, of all states (1/s).
    pub poles: Vec<Complex<f64>>,
    /// Whether all of them lie in the left half plane.
    pub hurwitz: bool,
    /// Whether those of the observable part of the law's plant do.
    pub observable_hurwitz: bool,
    /// The Lur'e pair of the observable part, or why there is none.
    pub lure: Result<LurePair, String>,
    /// E₀ and d_N; `None` where there is no Lur'e pair.
    pub certificate: Option<Certificate>,
    /// δ̄, ξ̄ and r_f of the design.
    pub bounds: DisturbanceBounds,
    /// d.
    pub dead_zone_width: f64,
    /// N.
    pub n_centers: usize,
    /// How f̂ is computed. Of a local solver, what follows is that of one block of neighbours: its P is at least P_N,
    /// its condition at most K's.
    pub solver: SolverInUse,
    /// κ(0).
    pub value_at_zero: f64,
    /// sup P_N over the box of the centers.
    pub sup_power_function: Supremum,
    /// The fill distance of the centers in their box (length scales).
    pub fill_distance: Supremum,
    /// The separation distance of the centers (length scales); `None` for a single one.
    pub separation: Option<f64>,
    /// cond(K).
    pub gram_condition: f64,
    /// Bytes that every step reads.
    pub bytes: usize,
    /// Bytes that are held.
    pub memory_bytes: usize,
    /// The largest eigenvalue of Γ_f.
    pub adaptation_rate: f64,
    /// The (exclusive) limit on that eigenvalue with an output held for `hold_s`, for σ = 1.
    pub largest_stable_adaptation_rate: f64,
    /// The longest that an output is held (s).
    pub hold_s: f64,
    /// Whether σ has a continuous derivative.
    pub dead_zone_is_smooth: bool,
}

/// The plant whose observability and poles are reported; the law's own plant may be a part of it.
struct WholePlant {
    states: Vec<String>,
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    measured: DMatrix<f64>,
    error_dynamics: DMatrix<f64>,
}

impl DesignReport {
    /// Of a body's translation: x = (r, v). The law's plant is the velocity; a position fix that is used makes the
    /// position observable.
    ///
    /// `function` is that of the channel ([`ChannelDesign::function`]), which takes long to build with many centers.
    ///
    /// # Errors
    /// A parameter out of range, as [`crate::Channel::new`]; an unstable adaptation rate is a finding, not an error.
    pub fn of_translation(
        design: &TranslationDesign,
        function: &LearnedFunction<3>,
    ) -> Result<Self, DesignError> {
        let identity = Matrix3::identity();
        let fix = design.position_fix_gain_per_s;
        let velocity = block([[Matrix3::zeros(), identity]]);
        let plant = WholePlant {
            states: axes("position").chain(axes("velocity")).collect(),
            a: block([[Matrix3::zeros(), identity], [Matrix3::zeros(), Matrix3::zeros()]]),
            b: block([[Matrix3::zeros()], [inverse(&design.channel)]]),
            measured: match fix > 0.0 {
                true => block([[Matrix3::zeros(), identity], [identity, Matrix3::zeros()]]),
                false => velocity,
            },
            error_dynamics: block([
                [-fix * identity, (1.0 - design.velocity_error_to_position) * identity],
                [Matrix3::zeros(), -design.channel.gain_per_s * identity],
            ]),
        };
        Self::of_channel(&design.channel, function, plant)
    }

    /// Of a body's rotation: x = ω.
    ///
    /// # Errors
    /// As [`DesignReport::of_translation`].
    pub fn of_rotation(design: &RotationDesign, function: &LearnedFunction<3>) -> Result<Self, DesignError> {
        let identity = Matrix3::identity();
        let plant = WholePlant {
            states: axes("angular velocity").collect(),
            a: DMatrix::zeros(3, 3),
            b: dynamic(&inverse(&design.channel)),
            measured: dynamic(&identity),
            error_dynamics: dynamic(&(-design.channel.gain_per_s * identity)),
        };
        Self::of_channel(&design.channel, function, plant)
    }

    fn of_channel(
        channel: &ChannelDesign,
        function: &LearnedFunction<3>,
        plant: WholePlant,
    ) -> Result<Self, DesignError> {
        let law = LinearDesign {
            a: DMatrix::zeros(3, 3),
            b: dynamic(&inverse(channel)),
            c: DMatrix::identity(3, 3),
            gain: DMatrix::identity(3, 3) * channel.gain_per_s,
            kernel: channel.kernel,
            length_scale: channel.length_scale.clone(),
            centers: channel.centers.clone(),
            nugget: channel.nugget,
            solver: channel.solver,
            adaptation_rate: dynamic(&channel.adaptation_rate),
            dead_zone: channel.dead_zone,
            options: channel.options,
            bounds: channel.bounds,
            hold_s: channel.hold_s,
            coast_step_s: channel.coast_step_s,
            initial_state: None,
        };
        // ξ is a force here: it enters through B.
        let through_input = |pair: &LurePair| spectral_norm(&(&pair.p * &law.b));
        Ok(Self::assemble(&law, function, plant, channel.largest_rate_factor()?, through_input))
    }

    /// Of a general linear plant and its f̂ ([`LinearDesign::function`]), with names for its states (x1, x2, … where
    /// there are none). Neither poles nor adaptation rate have to be stable.
    pub fn of_linear(
        design: &LinearDesign,
        function: &LearnedFunction<MAX_OUTPUTS>,
        names: Option<&[String]>,
    ) -> Self {
        let n = design.n_states();
        let plant = WholePlant {
            states: state_names(names, n),
            a: design.a.clone(),
            b: design.b.clone(),
            measured: design.c.clone(),
            error_dynamics: design.error_dynamics(),
        };
        let factor = largest_learning_of_every_step(design) / function.space().value_at_zero();
        Self::assemble(design, function, plant, factor, |pair| pair.p_norm)
    }

    fn assemble<const M: usize>(
        law: &LinearDesign,
        function: &LearnedFunction<M>,
        plant: WholePlant,
        largest_rate_factor: f64,
        disturbance_norm: impl Fn(&LurePair) -> f64,
    ) -> Self {
        let n = plant.states.len();
        let observable = reachable_subspace(&plant.a.transpose(), &plant.measured.transpose());
        let part = law.observable_part();
        let lure = part.lure_pair();
        let space = function.space();
        let sup_power_function = space.sup_power_function();
        let certificate = lure.as_ref().ok().map(|pair| {
            Certificate::new(
                (pair.lambda_min, pair.pl_norm),
                (spectral_norm(&part.c), inverse_norm(&part.c), disturbance_norm(pair)),
                law.bounds,
                &law.dead_zone,
                sup_power_function.value,
            )
        });
        let adaptation_rate = law.adaptation_rate.clone().symmetric_eigenvalues().max();
        Self {
            controllable: reachable_subspace(&plant.a, &plant.b).ncols() == n,
            observable: observable.ncols() == n,
            unobservable: in_words(&complement(&observable), &plant.states),
            poles: eigenvalues(&plant.error_dynamics),
            hurwitz: spectral_abscissa(&plant.error_dynamics) < 0.0,
            observable_hurwitz: spectral_abscissa(&part.error_dynamics()) < 0.0,
            states: plant.states,
            lure,
            certificate,
            bounds: law.bounds,
            dead_zone_width: law.dead_zone.width(),
            n_centers: law.centers.n_centers(),
            solver: function.solver(),
            value_at_zero: space.value_at_zero(),
            sup_power_function,
            fill_distance: space.fill_distance(),
            separation: space.separation(),
            gram_condition: space.gram_condition(),
            bytes: function.bytes_of_step(),
            memory_bytes: function.bytes(),
            adaptation_rate,
            largest_stable_adaptation_rate: adaptation_rate * largest_rate_factor,
            hold_s: law.hold_s,
            dead_zone_is_smooth: law.dead_zone.shape() != DeadZoneShape::Step,
        }
    }

    /// Whether the sampled law is stable for σ = 1.
    pub fn sampled_data_stable(&self) -> bool {
        self.adaptation_rate < self.largest_stable_adaptation_rate
    }

    /// √cond(P): V ≤ const is an ellipsoid, so that ‖e‖ may come to this many times E₀ or d_N before V falls.
    pub fn level_set_factor(&self) -> f64 {
        match &self.lure {
            Ok(pair) => {
                let sizes = pair.p.clone().symmetric_eigenvalues();
                (sizes.max() / sizes.min()).sqrt()
            }
            Err(_) => f64::INFINITY,
        }
    }
}

impl LinearDesign {
    /// The unobservable subspace in words, with names for the states (x1, x2, … where there are none).
    pub fn unobservable_states(&self, names: Option<&[String]>) -> Vec<String> {
        in_words(&self.unobservable_subspace(), &state_names(names, self.n_states()))
    }
}

fn inverse(channel: &ChannelDesign) -> Matrix3<f64> {
    channel.inertia.try_inverse().unwrap_or_else(|| Matrix3::repeat(f64::NAN))
}

fn block<const R: usize, const C: usize>(blocks: [[Matrix3<f64>; C]; R]) -> DMatrix<f64> {
    DMatrix::from_fn(3 * R, 3 * C, |i, j| blocks[i / 3][j / 3][(i % 3, j % 3)])
}

#[cfg(test)]
mod tests;
