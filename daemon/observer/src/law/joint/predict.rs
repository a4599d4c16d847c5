//! §3: the prediction over a step of h with the command held, for a missing sample, too.
//!
//! ```text
//! s = (1, e^{−h/τ_d}, e^{−h/T_k} …),   f = (1, τ_d (1 − s_1), h ψ),   ψ at v̂
//! v⁺ = fᵀX + h (a_u + g);              f := (1, τ_d (1 − s_1), h ψ_t)
//! w = P f;  X_k := s_k X_k, X_0 := v⁺
//! P_00 := fᵀw;  P_0k := w_k;  P := P ∘ s sᵀ
//! P_kk += π_k (1 − s_k²),  π = (0, λσ_d², 1, 1, …);   Q_1 = λσ_d² (1 − s_1²)
//! P_00 += (λq + 0.1 · 2 τ_d σ_f² P_N²) h + Q_1 h²/3;   P_01 += Q_1 h/2
//! ```
//!
//! §4: the position is a row of its own, r⁺ = r + h (v + v⁺)/2, so that `f_r = e_r + h/2 (e_v + f)`.

use super::covariance::Covariance;
use super::filter::JointFilter;
use super::lags::Lags;
use super::rows::{DISTURBANCE, POSITION, VELOCITY};
use super::state::JointState;
use super::teaches::Teaches;
use crate::space::factors::lanes::VectorUnit;

/// P_N² counts as white acceleration noise of this part of its variance over the disturbance's time.
const UNCOVERED_SHARE: f64 = 0.1;

/// The unknown acceleration of one step, d and ψᵀθ together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedAcceleration {
    /// Its mean over the step (m/s²; rad/s²).
    pub value: [f64; 3],
    /// P_N at v̂, 0 … 1: how badly the centers cover it.
    pub power_function: f64,
}

/// What is known between two samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointPrediction {
    /// v̂.
    pub velocity: [f64; 3],
    /// √P of the velocity.
    pub velocity_std: [f64; 3],
    /// r̂.
    pub position: [f64; 3],
    /// √P of the position.
    pub position_std: [f64; 3],
    /// The unknown acceleration.
    pub learned: LearnedAcceleration,
    /// Its deviation.
    pub learned_std: [f64; 3],
}

impl JointFilter {
    /// Moves the state by h > 0 with the acceleration `command` = a_u held, and the known one g.
    ///
    /// # Cost
    /// N²/2 multiply-adds for the features, 2n² for the covariance (6n² where the axes differ); no allocation.
    pub fn predict(
        &mut self,
        state: &mut JointState,
        h_s: f64,
        command: &[f64; 3],
        known: &[f64; 3],
        teaches: Teaches,
    ) -> LearnedAcceleration {
        let decays = self.decays(h_s, true);
        let lags = &mut state.scalars.lags;
        let differences = lags.advance(h_s, command, (&self.design.lags_s, &decays.lags));
        let uncovered = self.evaluate_features(&state.velocity(), command, &differences, &state.scalars.axes);
        let (scales, design) = (&mut self.scales, &self.design.excitation);
        scales.set(h_s, &self.rates_per_s, design.variation_time_s, teaches);
        state.scalars.command.follow(scales.command_rate, command);
        let levels = (h_s, scales.variation_rate, state.scalars.noise_levels.corrections);
        state.excitation.follow(self.unit, &self.features, levels, design);
        self.advance(state, (h_s, decays.disturbance), (command, known), uncovered)
    }

    /// The same in a gap, where neither a sample nor a command came: what may teach stays as it was, and the unknown
    /// command adds `σ_a² ((t + h)² − t²)` to P_00, `gap_s` = t after the gap's start.
    pub fn predict_gap(
        &mut self,
        state: &mut JointState,
        h_s: f64,
        command: &[f64; 3],
        known: &[f64; 3],
        gap_s: f64,
        teaches: Teaches,
    ) -> LearnedAcceleration {
        let decays = self.decays(h_s, true);
        let mut lags = state.scalars.lags;
        let differences = lags.advance(h_s, command, (&self.design.lags_s, &decays.lags));
        // They start anew with the next command.
        state.scalars.lags = Lags::unknown();
        let uncovered = self.evaluate_features(&state.velocity(), command, &differences, &state.scalars.axes);
        let variation_time_s = self.design.excitation.variation_time_s;
        self.scales.set(h_s, &self.rates_per_s, variation_time_s, teaches);
        let learned = self.advance(state, (h_s, decays.disturbance), (command, known), uncovered);
        let end_s = gap_s + h_s;
        let variance = state.scalars.command.variance * (end_s * end_s - gap_s * gap_s);
        for covariance in state.covariances_in_use_mut() {
            covariance.add_to_diagonal(VELOCITY, variance);
        }
        learned
    }

    /// Over the step that the scales were set for.
    fn advance(
        &mut self,
        state: &mut JointState,
        (h_s, decay): (f64, f64),
        forces: (&[f64; 3], &[f64; 3]),
        uncovered: f64,
    ) -> LearnedAcceleration {
        let step = self.transition(state, (h_s, decay), forces, uncovered);
        let (f, s) = (&self.teaching, &self.scales.factors);
        for axis in 0..3 {
            let mean = &mut state.mean[axis];
            self.unit.compile(|| mean.iter_mut().zip(s).for_each(|(x, s)| *x *= s));
            (mean[VELOCITY], mean[POSITION]) = (step.velocity[axis], step.position[axis]);
        }
        let has_position = self.design.position_noise.is_some();
        for covariance in state.covariances_in_use_mut() {
            let (w, w_r) = (&mut self.product, &mut self.position_row);
            let before = MotionVariances::of(covariance);
            if has_position {
                covariance.copy_row(VELOCITY, &mut self.column);
                covariance.copy_row(POSITION, w_r);
            }
            covariance.advance(f, s, &self.scales.variances, w);
            covariance.add_to_diagonal(DISTURBANCE, step.driven);
            let variances = step.variances(&before, f, w, self.unit);
            if has_position {
                for (((w_r, w), p_v), s) in w_r.iter_mut().zip(&*w).zip(&self.column).zip(s) {
                    *w_r = (*w_r + 0.5 * h_s * (p_v + w)) * s;
                }
            }
            self.unit.compile(|| w.iter_mut().zip(s).for_each(|(w, s)| *w *= s));
            w[VELOCITY] = variances.velocity;
            w[DISTURBANCE] += 0.5 * step.driven * h_s;
            if has_position {
                (w_r[VELOCITY], w_r[POSITION]) = (variances.velocity_position, variances.position);
                w[POSITION] = variances.velocity_position;
                covariance.set_cross(POSITION, w_r);
            }
            covariance.set_cross(VELOCITY, w);
        }
        LearnedAcceleration { value: step.learned, power_function: uncovered.sqrt() }
    }

    /// What a prediction by h would give, for a question between two samples: nothing changes. `gap_s` is the time since
    /// a gap began at the state, `None` outside of one.
    ///
    /// # Cost
    /// N²/2 multiply-adds for the features, n² for the deviations of the state, n² for that of the acceleration.
    pub fn look_ahead(
        &mut self,
        state: &JointState,
        h_s: f64,
        command: &[f64; 3],
        known: &[f64; 3],
        gap_s: Option<f64>,
    ) -> JointPrediction {
        let decays = self.decays(h_s, false);
        let mut lags = state.scalars.lags;
        let differences = lags.advance(h_s, command, (&self.design.lags_s, &decays.lags));
        let uncovered = self.evaluate_features(&state.velocity(), command, &differences, &state.scalars.axes);
        let step = self.transition(state, (h_s, decays.disturbance), (command, known), uncovered);
        let from_command = gap_s.map_or(0.0, |gap_s| {
            let end_s = gap_s + h_s;
            state.scalars.command.variance * (end_s * end_s - gap_s * gap_s)
        });
        let variances = self.variances_ahead(state, &step, uncovered);
        JointPrediction {
            velocity: step.velocity,
            velocity_std: variances.map(|(of_step, _)| (of_step.velocity + from_command).max(0.0).sqrt()),
            position: step.position,
            position_std: variances.map(|(of_step, _)| of_step.position.max(0.0).sqrt()),
            learned: LearnedAcceleration { value: step.learned, power_function: uncovered.sqrt() },
            learned_std: variances.map(|(_, of_learned)| of_learned.max(0.0).sqrt()),
        }
    }

    /// The means after a step, and f in `self.teaching`.
    fn transition(
        &mut self,
        state: &JointState,
        (h_s, decay): (f64, f64),
        (command, known): (&[f64; 3], &[f64; 3]),
        uncovered: f64,
    ) -> Transition {
        let disturbance_s = self.design.disturbance_time_s * (1.0 - decay);
        let means = state.mean.each_ref().map(|mean| &mean[..]);
        // Of the weights alone: ψ is 0 in the other rows.
        let of_weights = self.unit.dots(means, &self.features);
        let learned_m_s: [f64; 3] =
            std::array::from_fn(|axis| disturbance_s * means[axis][DISTURBANCE] + h_s * of_weights[axis]);
        let (before, position) = (state.velocity(), state.position());
        let velocity: [f64; 3] = std::array::from_fn(|axis| {
            before[axis] + learned_m_s[axis] + h_s * (command[axis] + known[axis])
        });
        let (excitation, f) = (&state.excitation, &mut self.teaching);
        self.unit.compile(|| excitation.teaching_features(&self.features, h_s, f));
        self.teaching[VELOCITY] = (1.0 + h_s * state.scalars.slope_per_s).max(0.0);
        self.teaching[DISTURBANCE] = disturbance_s;
        self.teaching[POSITION] = 0.0;

        let design = &self.design;
        let level = state.scalars.noise_levels.process;
        let disturbance_variance = level * design.prior.disturbance * design.prior.disturbance;
        let kernel_variance = design.prior.kernel * design.prior.kernel;
        Transition {
            h_s,
            velocity,
            position: std::array::from_fn(|axis| {
                position[axis] + 0.5 * h_s * (before[axis] + velocity[axis])
            }),
            // The mean over the step; at its start where it has no length.
            learned: std::array::from_fn(|axis| match h_s > 0.0 {
                true => learned_m_s[axis] / h_s,
                false => means[axis][DISTURBANCE] + of_weights[axis],
            }),
            driven: disturbance_variance * (1.0 - decay * decay),
            noise: level * design.process_noise
                + UNCOVERED_SHARE * 2.0 * design.disturbance_time_s * kernel_variance * uncovered,
        }
    }

    /// Deviation of the unknown acceleration at the features of the newest prediction: `√(cᵀPc + σ_f² P_N²)`, c = (0, 1, ψ).
    ///
    /// # Cost
    /// n² multiply-adds.
    pub fn learned_std(&mut self, state: &JointState, learned: &LearnedAcceleration) -> [f64; 3] {
        let uncovered = learned.power_function * learned.power_function;
        let variances = self.variances_ahead(state, &Transition::default(), uncovered);
        variances.map(|(_, of_learned)| of_learned.max(0.0).sqrt())
    }

    /// After a step with f of the newest transition; and of the unknown acceleration.
    fn variances_ahead(
        &mut self,
        state: &JointState,
        step: &Transition,
        uncovered: f64,
    ) -> [(MotionVariances, f64); 3] {
        let uncovered_variance = self.design.prior.kernel * self.design.prior.kernel * uncovered;
        self.features[DISTURBANCE] = 1.0;
        let (f, c) = (&self.teaching, &self.features);
        let mut variances = Default::default();
        let of_axes = std::array::from_fn(|axis| {
            if axis == 0 || !state.scalars.is_shared {
                let covariance = state.covariance(axis);
                let (of_f, of_c) = (&mut self.product, &mut self.column);
                covariance.times([f, c], [of_f, of_c]);
                let of_step = step.variances(&MotionVariances::of(covariance), f, of_f, self.unit);
                variances = (of_step, self.unit.dots([c], of_c)[0] + uncovered_variance);
            }
            variances
        });
        self.features[DISTURBANCE] = 0.0;
        of_axes
    }
}

/// The means after a step, and its noises.
#[derive(Debug, Clone, Copy, Default)]
struct Transition {
    h_s: f64,
    velocity: [f64; 3],
    position: [f64; 3],
    learned: [f64; 3],
    /// Q_1.
    driven: f64,
    /// λq and what the centers cannot represent ((m/s²)² s).
    noise: f64,
}

/// Entries of P before or after a step.
#[derive(Debug, Clone, Copy, Default)]
struct MotionVariances {
    velocity: f64,
    velocity_position: f64,
    position: f64,
}

impl MotionVariances {
    fn of(covariance: &Covariance) -> Self {
        Self {
            velocity: covariance.at(VELOCITY, VELOCITY),
            velocity_position: covariance.at(VELOCITY, POSITION),
            position: covariance.at(POSITION, POSITION),
        }
    }
}

impl Transition {
    /// From P before the step, f and w = P f.
    fn variances(&self, before: &MotionVariances, f: &[f64], w: &[f64], unit: VectorUnit) -> MotionVariances {
        let (h_s, half) = (self.h_s, 0.5 * self.h_s);
        let [along] = unit.dots([f], w);
        let (p_vv, p_rv, p_rr) = (before.velocity, before.velocity_position, before.position);
        // w_r = P f_r at the rows of velocity and position, and fᵀ w_r.
        let velocity_of_w_r = p_rv + half * (p_vv + w[VELOCITY]);
        let position_of_w_r = p_rr + half * (p_rv + w[POSITION]);
        let along_w_r = w[POSITION] + half * (w[VELOCITY] + along);
        MotionVariances {
            velocity: along + self.noise * h_s + self.driven * h_s * h_s / 3.0,
            velocity_position: along_w_r + 0.5 * self.noise * h_s * h_s,
            position: position_of_w_r
                + half * (velocity_of_w_r + along_w_r)
                + self.noise * h_s * h_s * h_s / 3.0,
        }
    }
}
