//! What is proven for a design: every condition of the theorems, computed (Niu et al., §III to §V).
//!
//! | condition | what it is for |
//! |---|---|
//! | (A, B) controllable, (A, C) observable | assumed of the plant |
//! | A_e = A − LC Hurwitz | the estimate follows the output |
//! | `A_eᵀP + PA_e = −WᵀW − εP`, `PB = Cᵀ` (Lur'e) | the learning law takes energy out of the error |
//! | E₀, d_N (see [`Certificate`]) | the size that the error settles below |
//! | d > d_N | Theorem 2 |
//! | `h σ φᵀφ` below its bound (see [`crate::law::stability`]) | the sampled law is stable; ours, the paper is continuous |
//!
//! What is unobservable has no place in the theorems: they are about the observable part, and the rest is
//! integrated from it. For a body whose velocity is measured that is the position.

use crate::design::{ChannelDesign, DisturbanceBounds, RotationDesign, TranslationDesign, dynamic};
use crate::error::DesignError;
use crate::function::learned::LearnedFunction;
use crate::function::solver::SolverInUse;
use crate::law::dead_zone::DeadZoneShape;
use crate::law::linear_stability::largest_learning_of_every_step;
use crate::linear_design::LinearDesign;
use crate::plant::linear::MAX_OUTPUTS;
use crate::plant::linear_algebra::{
    complement, eigenvalues, reachable_subspace, spectral_abscissa, spectral_norm,
};
use crate::report::box_search::Supremum;
use crate::report::certificate::Certificate;
use crate::report::lure_pair::LurePair;
use crate::space::centers::Centers;
use crate::space::kernel::Kernel;
use crate::space::native_space::NativeSpace;
use crate::space::scaled_kernel::LengthScale;
use nalgebra::{Complex, DMatrix, Matrix3};

/// Whether a condition is met.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It is.
    Holds,
    /// It is not.
    Fails,
    /// The paper says so, and its proof does not cover this design.
    Claimed,
    /// It says nothing about this design.
    NotApplicable,
}

/// One line of a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The condition.
    pub condition: String,
    /// Whether it is met.
    pub verdict: Verdict,
    /// The numbers, and what they mean.
    pub detail: String,
}

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
    /// What that may be at most with an output held for `hold_s` (exclusive), for σ = 1.
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
    /// All that is measured.
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
                (spectral_norm(&part.c), disturbance_norm(pair)),
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

    /// All conditions, in the order in which they build on each other.
    pub fn findings(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        let plain = |holds: bool| if holds { Verdict::Holds } else { Verdict::Fails };
        let mut find = |condition: &str, verdict: Verdict, detail: String| {
            findings.push(Finding { condition: condition.into(), verdict, detail });
        };
        let n = self.states.len();
        find("(A, B) controllable", plain(self.controllable), format!("{n} states"));
        let hidden = self.unobservable.join(", ");
        find(
            "(A, C) observable",
            plain(self.observable),
            match self.observable {
                true => "everything acts on what is measured".into(),
                false => format!(
                    "unobservable: {hidden}; it is integrated from its start, its error bounded only through the rest"
                ),
            },
        );
        let poles = self.poles.iter().map(pole_in_words).collect::<Vec<_>>().join(", ");
        find("A_e = A − LC Hurwitz", plain(self.hurwitz), format!("poles {poles} 1/s"));
        if !self.observable {
            let detail = "what the theorems are about".into();
            find("A_e Hurwitz on the observable part", plain(self.observable_hurwitz), detail);
        }
        find(
            "error dynamics strictly positive real (Lur'e)",
            plain(self.lure.is_ok()),
            match &self.lure {
                Ok(pair) => format!(
                    "{}, λ_min(WᵀW + εP) = {}, ‖PL‖ = {}; residuals at most {:.0e}",
                    matrix_in_words("P", &pair.p),
                    number(pair.lambda_min),
                    number(pair.pl_norm),
                    pair.input_residual.max(pair.lyapunov_residual)
                ),
                Err(reason) => reason.clone(),
            },
        );
        let noise = self.bounds.noise;
        let (e0, d_n) = match &self.certificate {
            None => (None, None),
            Some(certificate) => {
                (Some(certificate.e0()), Some((certificate.d_n(), certificate.is_admissible())))
            }
        };
        let claimed_with_noise = |holds: bool| match (holds, noise > 0.0) {
            (true, true) => Verdict::Claimed,
            (true, false) => Verdict::Holds,
            (false, _) => Verdict::Fails,
        };
        let no_pair = || "not defined without a Lur'e pair".to_owned();
        find(
            "‖e‖ settles below E₀ (Theorem 1)",
            e0.map_or(Verdict::NotApplicable, |_| claimed_with_noise(true)),
            e0.map_or_else(no_pair, |e0| format!("E₀ = {}", number(e0))),
        );
        find(
            "d > d_N (Theorem 2)",
            d_n.map_or(Verdict::NotApplicable, |(_, holds)| claimed_with_noise(holds)),
            d_n.map_or_else(no_pair, |(d_n, _)| {
                format!(
                    "d = {}, d_N = {} with sup P_N = {:.4} (no point above {:.4}) and r_f = {}{}",
                    number(self.dead_zone_width),
                    number(d_n),
                    self.sup_power_function.value,
                    self.sup_power_function.upper_bound,
                    number(self.bounds.residual_norm),
                    if self.bounds.residual_norm == 0.0 {
                        ": as if f lay in the span of the centers"
                    } else {
                        ""
                    }
                )
            }),
        );
        find(
            "dead zone continuously differentiable",
            plain(self.dead_zone_is_smooth),
            if self.dead_zone_is_smooth { "admissible".into() } else { "a step: it may chatter".into() },
        );
        find(
            "sampled law stable",
            plain(self.sampled_data_stable()),
            format!(
                "adaptation rate {}, largest {} for an output held for {} ms",
                number(self.adaptation_rate),
                number(self.largest_stable_adaptation_rate),
                number(1e3 * self.hold_s)
            ),
        );
        find(
            "the proofs cover the measurement error",
            plain(noise == 0.0),
            match noise == 0.0 {
                true => "δ̄ = 0".into(),
                false => format!(
                    "δ̄ = {}: with it E₀ and d_N are the paper's claim; its proof drops −2σ⟨f̃(y), δ⟩",
                    number(noise)
                ),
            },
        );
        findings
    }
}

impl LinearDesign {
    /// The unobservable subspace in words, with names for the states (x1, x2, … where there are none).
    pub fn unobservable_states(&self, names: Option<&[String]>) -> Vec<String> {
        in_words(&self.unobservable_subspace(), &state_names(names, self.n_states()))
    }
}

fn state_names(names: Option<&[String]>, n: usize) -> Vec<String> {
    names.map_or_else(|| (1..=n).map(|i| format!("x{i}")).collect(), <[String]>::to_vec)
}

/// What another length scale would do to a space.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthScaleEffect {
    /// Times the length scale of the design.
    pub factor: f64,
    /// cond(K); `None` where K is not numerically positive definite.
    pub gram_condition: Option<f64>,
    /// sup P_N / √κ(0) over the box of the centers.
    pub relative_power_function: Option<f64>,
}

/// cond(K) and sup P_N / √κ(0) for multiples of the length scale: the longer, the better the cover and the worse
/// the condition.
pub fn length_scale_effect(
    kernel: Kernel,
    length_scale: &LengthScale,
    centers: &Centers,
    nugget: f64,
    factors: &[f64],
) -> Vec<LengthScaleEffect> {
    let effect = |&factor: &f64| {
        let space = NativeSpace::new(kernel, &length_scale.scaled(factor), centers.clone(), nugget).ok();
        LengthScaleEffect {
            factor,
            gram_condition: space.as_ref().map(NativeSpace::gram_condition),
            relative_power_function: space
                .as_ref()
                .map(|space| space.sup_power_function().value / space.value_at_zero().sqrt()),
        }
    };
    factors.iter().map(effect).collect()
}

fn axes(quantity: &str) -> impl Iterator<Item = String> {
    ["x", "y", "z"].map(|axis| format!("{quantity} {axis}")).into_iter()
}

fn inverse(channel: &ChannelDesign) -> Matrix3<f64> {
    channel.inertia.try_inverse().unwrap_or_else(|| Matrix3::repeat(f64::NAN))
}

fn block<const R: usize, const C: usize>(blocks: [[Matrix3<f64>; C]; R]) -> DMatrix<f64> {
    DMatrix::from_fn(3 * R, 3 * C, |i, j| blocks[i / 3][j / 3][(i % 3, j % 3)])
}

/// A subspace by the states that span it, or by the combinations that they enter.
fn in_words(basis: &DMatrix<f64>, states: &[String]) -> Vec<String> {
    let share = |i: usize| basis.row(i).norm();
    let whole: Vec<_> = (0..states.len()).filter(|&i| share(i) > 1.0 - 1e-9).collect();
    let mixed: Vec<_> = (0..states.len()).filter(|&i| (1e-9..=1.0 - 1e-9).contains(&share(i))).collect();
    let mut words: Vec<String> = whole.iter().map(|&i| states[i].clone()).collect();
    // Three axes of one quantity are the quantity.
    for quantity in ["position", "velocity"] {
        if axes(quantity).all(|axis| words.contains(&axis)) {
            words.retain(|word| !axes(quantity).any(|axis| axis == *word));
            words.push(quantity.into());
        }
    }
    if !mixed.is_empty() {
        let names: Vec<_> = mixed.iter().map(|&i| states[i].as_str()).collect();
        words.push(format!("{} combinations of {}", basis.ncols() - whole.len(), names.join(" and ")));
    }
    words
}

fn pole_in_words(pole: &Complex<f64>) -> String {
    match pole.im == 0.0 {
        true => number(pole.re),
        false => {
            let sign = if pole.im < 0.0 { '-' } else { '+' };
            format!("{}{sign}{}i", number(pole.re), number(pole.im.abs()))
        }
    }
}

/// Six significant digits at most, without trailing zeros.
fn number(x: f64) -> String {
    match x.abs() {
        0.0 => "0".into(),
        size if (1e-4..1e7).contains(&size) => {
            let unit = 10.0_f64.powi(size.log10().floor() as i32 - 5);
            // Through text, so that 0.1 + 0.2 is 0.3.
            let rounded: f64 = format!("{:.5e}", (x / unit).round() * unit).parse().unwrap_or(x);
            rounded.to_string()
        }
        _ => format!("{x:.4e}"),
    }
}

/// `P = 4 I`, `P = diag(…)`, or its rows.
fn matrix_in_words(name: &str, matrix: &DMatrix<f64>) -> String {
    let tolerance = 1e-9 * matrix.amax();
    let diagonal = matrix.diagonal();
    let is_diagonal = (matrix - DMatrix::from_diagonal(&diagonal)).amax() <= tolerance;
    if is_diagonal && diagonal.iter().all(|x| (x - diagonal[0]).abs() <= tolerance) {
        return format!("{name} = {} I", number(diagonal[0]));
    }
    let list = |entries: Vec<f64>| entries.into_iter().map(number).collect::<Vec<_>>().join(", ");
    if is_diagonal {
        return format!("{name} = diag({})", list(diagonal.iter().copied().collect()));
    }
    let rows: Vec<_> = matrix.row_iter().map(|row| list(row.iter().copied().collect())).collect();
    format!("{name} = [{}]", rows.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::{DisturbanceBounds, GyroscopicTorque};
    use crate::function::solver::Solver;
    use crate::law::dead_zone::DeadZone;

    fn paper(inertia: Matrix3<f64>, box_half: f64, zone: (DeadZoneShape, f64), noise: f64) -> ChannelDesign {
        ChannelDesign {
            kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
            length_scale: LengthScale::Isotropic(1.0),
            centers: Centers::lattice([-box_half; 3], [box_half; 3], [3; 3]).unwrap(),
            nugget: 0.0,
            solver: Solver::Dense,
            inertia,
            gain_per_s: 10.0,
            adaptation_rate: Matrix3::identity(),
            dead_zone: DeadZone::new(zone.0, zone.1, 0.01).unwrap(),
            bounds: DisturbanceBounds { noise, ..DisturbanceBounds::default() },
            hold_s: 0.0075,
            coast_step_s: 0.005,
        }
    }

    fn translation() -> TranslationDesign {
        let noise = 0.008 * 6.0_f64.sqrt();
        TranslationDesign {
            channel: paper(Matrix3::identity() * 4.0, 1.0, (DeadZoneShape::Quadratic, 0.01), noise),
            known_force_n: nalgebra::Vector3::zeros(),
            velocity_error_to_position: 0.0,
            position_fix_gain_per_s: 0.0,
            position_fix_hold_s: 0.0,
        }
    }

    fn report_of(design: &TranslationDesign) -> DesignReport {
        DesignReport::of_translation(design, &design.channel.function().unwrap()).unwrap()
    }

    fn verdict(report: &DesignReport, condition: &str) -> Verdict {
        let findings = report.findings();
        findings.iter().find(|f| f.condition.starts_with(condition)).unwrap().verdict
    }

    /// By hand: P = 4I, Q = 2λP = 80 I, ‖PL‖ = 40, E₀ = 2 δ̄ 40/80 = δ̄.
    #[test]
    fn the_papers_translation_has_the_numbers_of_a_hand_calculation() {
        let report = report_of(&translation());
        assert!(report.controllable && !report.observable && !report.hurwitz && report.observable_hurwitz);
        assert_eq!(report.unobservable, ["position"]);
        let pair = report.lure.as_ref().unwrap();
        assert!((&pair.p - DMatrix::identity(3, 3) * 4.0).amax() < 1e-12);
        assert!((pair.lambda_min - 80.0).abs() < 1e-10 && (pair.pl_norm - 40.0).abs() < 1e-10);
        assert!((report.certificate.unwrap().e0() - 0.0195959).abs() < 1e-7);
        assert!((report.certificate.unwrap().d_n() - 0.0195959).abs() < 1e-7);
        assert!((report.sup_power_function.value - 0.443_724_775_3).abs() < 1e-8);
        assert!((report.gram_condition - 291.69).abs() < 0.02);
        assert!((report.value_at_zero - 2.467_401_1).abs() < 1e-7);
        assert_eq!(verdict(&report, "d > d_N"), Verdict::Fails);
        assert_eq!(verdict(&report, "(A, C)"), Verdict::Fails);
        assert_eq!(verdict(&report, "sampled law"), Verdict::Holds);
        assert_eq!(report.level_set_factor(), 1.0);
    }

    /// P = I, hence E₀ = 2 δ̄ λ 15 / (2 λ 0.2) = 75 δ̄.
    #[test]
    fn the_papers_rotation_has_an_unequal_inertia() {
        let noise = 0.05 * 3.0_f64.sqrt();
        let inertia = Matrix3::from_diagonal(&nalgebra::Vector3::new(0.2, 15.0, 15.0));
        let design = RotationDesign {
            channel: paper(inertia, 0.1, (DeadZoneShape::Quadratic, 0.1), noise),
            gyroscopic_torque: GyroscopicTorque::Learned,
            attitude_fix_gain_per_s: 0.0,
            attitude_fix_hold_s: 0.0,
        };
        let report = DesignReport::of_rotation(&design, &design.channel.function().unwrap()).unwrap();
        assert!(report.observable && report.hurwitz && report.unobservable.is_empty());
        assert!((report.certificate.unwrap().e0() - 75.0 * noise).abs() < 1e-9);
        assert_eq!(verdict(&report, "d > d_N"), Verdict::Fails);
        assert!((report.level_set_factor() - 75.0_f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn a_position_fix_makes_the_position_observable() {
        let mut design = translation();
        design.position_fix_gain_per_s = 0.5;
        let report = report_of(&design);
        assert!(report.observable && report.hurwitz);
        assert!(report.poles.iter().filter(|pole| (pole.re + 0.5).abs() < 1e-9).count() == 3);
    }

    /// d_N = 2 (0.4437 · 3 + 40 δ̄ + 5)/80 with r_f = 3 and ξ̄ = 5.
    #[test]
    fn every_bound_adds_its_part() {
        let mut design = translation();
        design.channel.bounds.unmatched = 5.0;
        design.channel.bounds.residual_norm = 3.0;
        let report = report_of(&design);
        let noise = design.channel.bounds.noise;
        assert!((report.certificate.unwrap().e0() - 2.0 * (40.0 * noise + 5.0) / 80.0).abs() < 1e-12);
        let expected = 2.0 * (0.443_724_775_3 * 3.0 + 40.0 * noise + 5.0) / 80.0;
        assert!((report.certificate.unwrap().d_n() - expected).abs() < 1e-8);
    }

    #[test]
    fn numbers_are_short_at_any_size() {
        for (x, text) in [
            (0.0, "0"),
            (-10.0, "-10"),
            (0.019_595_917_9, "0.0195959"),
            (115_335.024_1, "115335"),
            (1e-7, "1.0000e-7"),
            (-1e300, "-1.0000e300"),
            (0.1 + 0.2, "0.3"),
        ] {
            assert_eq!(number(x), text);
        }
    }

    #[test]
    fn an_unstable_rate_is_a_finding() {
        let mut design = translation();
        design.channel.adaptation_rate *= 1e7;
        let report = report_of(&design);
        assert!(!report.sampled_data_stable());
        assert_eq!(verdict(&report, "sampled law"), Verdict::Fails);
    }

    #[test]
    fn a_subspace_is_named_by_its_states_or_their_combinations() {
        let states: Vec<String> = axes("position").chain(axes("velocity")).collect();
        let mut basis = DMatrix::zeros(6, 2);
        basis[(0, 0)] = 1.0;
        (basis[(1, 1)], basis[(4, 1)]) = (0.6, 0.8);
        let words = in_words(&basis, &states);
        assert_eq!(words, ["position x", "1 combinations of position y and velocity y"]);
    }

    #[test]
    fn a_longer_length_scale_covers_better_and_conditions_worse() {
        let channel = translation().channel;
        let effects = length_scale_effect(
            channel.kernel,
            &channel.length_scale,
            &channel.centers,
            0.0,
            &[0.5, 1.0, 2.0],
        );
        for pair in effects.windows(2) {
            assert!(pair[0].gram_condition < pair[1].gram_condition);
            assert!(pair[0].relative_power_function > pair[1].relative_power_function);
        }
    }
}
