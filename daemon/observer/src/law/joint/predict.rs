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
use super::rows::{DISTURBANCE, KERNEL, POSITION, VELOCITY};
use super::state::JointState;
use super::teaches::Teaches;

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
        let lags = &mut state.scalars.lags;
        let differences = lags.advance(h_s, command, &self.design.lags_s);
        let uncovered = self.evaluate_features(&state.velocity(), command, &differences);
        state.scalars.command.follow(h_s, command);
        let corrections = state.scalars.noise_levels.corrections;
        let excitation = &mut state.excitation;
        excitation.follow(self.unit, &self.features, (h_s, corrections), &self.design.excitation);
        self.advance(state, h_s, (command, known), uncovered, teaches)
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
        let mut lags = state.scalars.lags;
        let differences = lags.advance(h_s, command, &self.design.lags_s);
        // They start anew with the next command.
        state.scalars.lags = Lags::unknown();
        let uncovered = self.evaluate_features(&state.velocity(), command, &differences);
        let learned = self.advance(state, h_s, (command, known), uncovered, teaches);
        let end_s = gap_s + h_s;
        let variance = state.scalars.command.variance * (end_s * end_s - gap_s * gap_s);
        for covariance in state.covariances_in_use_mut() {
            covariance.add_to_diagonal(VELOCITY, variance);
        }
        learned
    }

    fn advance(
        &mut self,
        state: &mut JointState,
        h_s: f64,
        forces: (&[f64; 3], &[f64; 3]),
        uncovered: f64,
        teaches: Teaches,
    ) -> LearnedAcceleration {
        let step = self.transition(state, h_s, forces, uncovered, teaches);
        for axis in 0..3 {
            let mean = &mut state.mean[axis];
            mean.iter_mut().zip(&self.scales.factors).for_each(|(x, s)| *x *= s);
            (mean[VELOCITY], mean[POSITION]) = (step.velocity[axis], step.position[axis]);
        }
        self.scales.variances(&mut self.variances);
        self.variances[DISTURBANCE] = step.driven;
        let has_position = self.design.position_noise.is_some();
        let (f, s) = (&self.teaching, &self.scales.factors);
        for covariance in state.covariances_in_use_mut() {
            let w = &mut self.product;
            covariance.times(self.unit, f, w);
            let variances = step.variances(covariance, f, w);
            if has_position {
                let before = covariance.row(VELOCITY).zip(covariance.row(POSITION));
                for ((w_r, w), (p_v, p_r)) in self.position_row.iter_mut().zip(&*w).zip(before) {
                    *w_r = p_r + 0.5 * h_s * (p_v + w);
                }
            }
            covariance.scale(self.unit, s, &self.variances);
            w.iter_mut().zip(s).for_each(|(w, s)| *w *= s);
            w[VELOCITY] = variances.velocity;
            w[DISTURBANCE] += 0.5 * step.driven * h_s;
            if has_position {
                let w_r = &mut self.position_row;
                w_r.iter_mut().zip(s).for_each(|(w, s)| *w *= s);
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
        let mut lags = state.scalars.lags;
        let differences = lags.advance(h_s, command, &self.design.lags_s);
        let uncovered = self.evaluate_features(&state.velocity(), command, &differences);
        let learned_std = self.std_at_features(state, uncovered);
        let step = self.transition(state, h_s, (command, known), uncovered, Teaches::All);
        let from_command = gap_s.map_or(0.0, |gap_s| {
            let end_s = gap_s + h_s;
            state.scalars.command.variance * (end_s * end_s - gap_s * gap_s)
        });
        let mut variances = StepVariances::default();
        let variances: [StepVariances; 3] = std::array::from_fn(|axis| {
            if axis == 0 || !state.scalars.is_shared {
                let covariance = state.covariance(axis);
                covariance.times(self.unit, &self.teaching, &mut self.product);
                variances = step.variances(covariance, &self.teaching, &self.product);
                variances.velocity += from_command;
            }
            variances
        });
        JointPrediction {
            velocity: step.velocity,
            velocity_std: variances.map(|variances| variances.velocity.max(0.0).sqrt()),
            position: step.position,
            position_std: variances.map(|variances| variances.position.max(0.0).sqrt()),
            learned: LearnedAcceleration { value: step.learned, power_function: uncovered.sqrt() },
            learned_std,
        }
    }

    /// The means after a step, and f in `self.teaching`.
    fn transition(
        &mut self,
        state: &JointState,
        h_s: f64,
        (command, known): (&[f64; 3], &[f64; 3]),
        uncovered: f64,
        teaches: Teaches,
    ) -> Transition {
        self.scales.set(h_s, &self.rates_per_s, teaches);
        let decay = self.scales.factors[DISTURBANCE];
        let disturbance_s = self.design.disturbance_time_s * (1.0 - decay);
        let learned_m_s: [f64; 3] = std::array::from_fn(|axis| {
            let mean = &state.mean[axis];
            disturbance_s * mean[DISTURBANCE] + h_s * dot(&self.features, mean)
        });
        let (before, position) = (state.velocity(), state.position());
        let velocity: [f64; 3] = std::array::from_fn(|axis| {
            before[axis] + learned_m_s[axis] + h_s * (command[axis] + known[axis])
        });
        state.excitation.teaching_features(&self.features, &mut self.teaching);
        self.teaching.iter_mut().for_each(|f| *f *= h_s);
        self.teaching[VELOCITY] = 1.0;
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
                false => state.mean[axis][DISTURBANCE] + dot(&self.features, &state.mean[axis]),
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
        self.std_at_features(state, learned.power_function * learned.power_function)
    }

    fn std_at_features(&mut self, state: &JointState, uncovered: f64) -> [f64; 3] {
        let kernel_variance = self.design.prior.kernel * self.design.prior.kernel;
        self.features[DISTURBANCE] = 1.0;
        let mut shared = 0.0;
        let deviations = std::array::from_fn(|axis| {
            if axis == 0 || !state.scalars.is_shared {
                state.covariance(axis).times(self.unit, &self.features, &mut self.product);
                shared =
                    (dot_all(&self.features, &self.product) + kernel_variance * uncovered).max(0.0).sqrt();
            }
            shared
        });
        self.features[DISTURBANCE] = 0.0;
        deviations
    }
}

/// The means after a step, and its noises.
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

/// Variances after a step.
#[derive(Debug, Clone, Copy, Default)]
struct StepVariances {
    velocity: f64,
    velocity_position: f64,
    position: f64,
}

impl Transition {
    /// From P before the step, f and w = P f.
    fn variances(&self, covariance: &Covariance, f: &[f64], w: &[f64]) -> StepVariances {
        let (h_s, half) = (self.h_s, 0.5 * self.h_s);
        let along = dot_all(f, w);
        let (p_vv, p_rv, p_rr) = (
            covariance.at(VELOCITY, VELOCITY),
            covariance.at(POSITION, VELOCITY),
            covariance.at(POSITION, POSITION),
        );
        // w_r = P f_r at the rows of velocity and position, and fᵀ w_r.
        let velocity_of_w_r = p_rv + half * (p_vv + w[VELOCITY]);
        let position_of_w_r = p_rr + half * (p_rv + w[POSITION]);
        let along_w_r = w[POSITION] + half * (w[VELOCITY] + along);
        StepVariances {
            velocity: along + self.noise * h_s + self.driven * h_s * h_s / 3.0,
            velocity_position: along_w_r + 0.5 * self.noise * h_s * h_s,
            position: position_of_w_r
                + half * (velocity_of_w_r + along_w_r)
                + self.noise * h_s * h_s * h_s / 3.0,
        }
    }
}

/// ψᵀθ: the weights' rows only; ψ is 0 elsewhere.
fn dot(features: &[f64], mean: &[f64]) -> f64 {
    debug_assert!(features[POSITION] == 0.0 && KERNEL > POSITION);
    dot_all(features, mean)
}

fn dot_all(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
