//! The filter: constants of a design, and what a step works in.

use super::command::COMMAND_TIME_S;
use super::covariance::Covariance;
use super::design::JointDesign;
use super::excitation::Excitation;
use super::lags::Lags;
use super::rows::{DISTURBANCE, KERNEL, N_PARAMETRIC, N_TURN, POSITION, VELOCITY, WEIGHTS};
use super::state::{JointScalars, JointState};
use super::teaches::Teaches;
use crate::error::DesignError;
use crate::space::factors::lanes::{VectorUnit, whole_lanes};
use crate::space::native_space::{FeatureBuffers, NativeSpace};

/// The law: constants of a design, and what a step works in. What it estimates is a [`JointState`].
#[derive(Debug, Clone)]
pub struct JointFilter {
    pub(super) space: NativeSpace,
    pub(super) design: JointDesign,
    pub(super) unit: VectorUnit,
    /// Rows in use, and rows up to whole lanes.
    pub(crate) n: usize,
    /// Rows without the accelerometer's bias.
    pub(super) n_kernel: usize,
    pub(super) n_padded: usize,
    /// 1/T_k, 0 for the position's row and for what fills up.
    pub(super) rates_per_s: Vec<f64>,
    /// Diagonal of P before the first output: σ_d², and 1 of the weights.
    prior_variances: Vec<f64>,
    /// Center and half-widths of the box; the largest is the scale of the linear rows.
    pub(super) box_center: [f64; 3],
    half_widths: [f64; 3],
    pub(super) largest_half_width: f64,
    pub(super) scales: Scales,
    /// Of the newest committed step, and of the newest question.
    decays: [Decays; 2],
    pub(super) buffers: FeatureBuffers,
    pub(super) features: Vec<f64>,
    pub(super) teaching: Vec<f64>,
    pub(super) product: Vec<f64>,
    pub(super) position_row: Vec<f64>,
    pub(super) column: Vec<f64>,
}

/// e^{−h/τ} of what a prediction needs, for one length of the step: computed when the length changes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Decays {
    h_s: f64,
    /// α_i, of the lags.
    pub(super) lags: [f64; 2],
    /// Of the disturbance.
    pub(super) disturbance: f64,
}

/// e^{−h/T_k} of every row, and what else a committed step needs, for one length of the step: computed when it changes.
#[derive(Debug, Clone)]
pub(super) struct Scales {
    h_s: f64,
    /// Whether the weights do not forget.
    weights_stay: bool,
    pub(super) factors: Vec<f64>,
    /// What the prior puts back: 1 − e^{−2h/T_k} of the weights, 0 of the other rows.
    pub(super) variances: Vec<f64>,
    /// 1 − e^{−h/τ} of the command's mean and variance, and of E.
    pub(super) command_rate: f64,
    pub(super) variation_rate: f64,
}

impl JointFilter {
    /// Builds the native space and allocates all that a step needs.
    ///
    /// # Errors
    /// The parameter that is out of range, with what would be accepted; `Centers` as [`NativeSpace::new`].
    pub fn new(design: &JointDesign) -> Result<Self, DesignError> {
        design.check()?;
        let space = NativeSpace::whole(design.kernel, &design.length_scale, design.centers.clone(), 0.0)?;
        let n_turn = if design.body_axes.is_some() { N_TURN } else { 0 };
        let n_kernel = KERNEL + design.centers.n_centers() + n_turn;
        let n = n_kernel + usize::from(design.accelerometer.is_some());
        let n_padded = whole_lanes(n);
        let mut rates_per_s = vec![0.0; n_padded];
        rates_per_s[DISTURBANCE] = design.disturbance_time_s.recip();
        rates_per_s[WEIGHTS..WEIGHTS + 4].fill(design.motion_memory_s.recip());
        rates_per_s[WEIGHTS + 4..POSITION].fill(design.input_memory_s.recip());
        rates_per_s[KERNEL..n_kernel].fill(design.motion_memory_s.recip());
        if let Some(accelerometer) = &design.accelerometer {
            rates_per_s[n_kernel] = accelerometer.bias_time_s.recip();
        }
        let mut prior_variances = vec![0.0; n_padded];
        prior_variances[WEIGHTS..POSITION].fill(1.0);
        prior_variances[KERNEL..n].fill(1.0);
        prior_variances[DISTURBANCE] = design.prior.disturbance * design.prior.disturbance;
        let (lower, upper) = design.centers.bounding_box();
        let half_widths = std::array::from_fn(|axis| 0.5 * (upper[axis] - lower[axis]));
        let vector = || vec![0.0; n_padded];
        Ok(Self {
            unit: VectorUnit::of_this_machine(),
            n,
            n_kernel,
            n_padded,
            rates_per_s,
            prior_variances,
            box_center: std::array::from_fn(|axis| 0.5 * (upper[axis] + lower[axis])),
            half_widths,
            largest_half_width: half_widths.into_iter().fold(0.0, f64::max),
            scales: Scales {
                h_s: 0.0,
                weights_stay: false,
                factors: vec![1.0; n_padded],
                variances: vector(),
                command_rate: 0.0,
                variation_rate: 0.0,
            },
            decays: [Decays { h_s: 0.0, lags: [1.0; 2], disturbance: 1.0 }; 2],
            buffers: FeatureBuffers::new(&space),
            features: vector(),
            teaching: vector(),
            product: vector(),
            position_row: vector(),
            column: vector(),
            space,
            design: design.clone(),
        })
    }

    /// The largest half width of the box of the centers (m/s; rad/s): any velocity is within.
    pub fn largest_half_width(&self) -> f64 {
        self.largest_half_width
    }

    /// A state before the first output: nothing learned.
    pub fn new_state(&self) -> JointState {
        let mut state = JointState {
            mean: std::array::from_fn(|_| vec![0.0; self.n_padded]),
            covariances: std::array::from_fn(|_| Covariance::zero(self.unit, self.n)),
            excitation: Excitation::new(self.n_padded),
            scalars: JointScalars::new(),
        };
        self.clear(&mut state);
        state
    }

    /// Becomes a state before the first output again: nothing learned. No allocation.
    pub(crate) fn clear(&self, state: &mut JointState) {
        for (mean, covariance) in state.mean.iter_mut().zip(&mut state.covariances) {
            mean.fill(0.0);
            covariance.set_diagonal(&self.prior_variances);
        }
        state.excitation.clear();
        state.scalars = JointScalars::new();
    }

    /// Forgets velocity, disturbance and position, not the weights: begins again with the next velocity. No allocation.
    pub fn restart(&mut self, state: &mut JointState) {
        let disturbance = self.design.prior.disturbance;
        self.column.fill(0.0);
        for axis in 0..3 {
            for row in [VELOCITY, DISTURBANCE, POSITION] {
                state.mean[axis][row] = 0.0;
                state.covariances[axis].set_cross(row, &self.column);
            }
            let level = state.scalars.noise_levels.process;
            state.covariances[axis].set(DISTURBANCE, DISTURBANCE, level * disturbance * disturbance);
        }
        state.scalars.is_started = false;
        state.scalars.position_is_known = [false; 3];
        state.scalars.lags = Lags::unknown();
    }

    /// Takes what was learned on another day: `P_θθ := 0.9 P_θθ + 0.1 I`, or it would be too sure of itself. Velocity,
    /// disturbance and position begin anew. No allocation.
    pub fn doubt(&mut self, state: &mut JointState) {
        let [first, second, third] = &state.covariances;
        state.scalars.is_shared = first == second && second == third;
        let weights = || (WEIGHTS..POSITION).chain(KERNEL..self.n);
        for covariance in &mut state.covariances {
            for i in weights() {
                for j in weights().take_while(|&j| j <= i) {
                    let of_prior = if i == j { 1.0 } else { 0.0 };
                    covariance.set(i, j, 0.9 * covariance.at(i, j) + 0.1 * of_prior);
                }
            }
        }
        self.restart(state);
    }

    /// For a step of this length that is committed, or that is only asked for: they take turns with different lengths.
    pub(super) fn decays(&mut self, h_s: f64, is_committed: bool) -> Decays {
        let decays = &mut self.decays[usize::from(is_committed)];
        if decays.h_s != h_s {
            *decays = Decays {
                h_s,
                lags: self.design.lags_s.map(|lag_s| (-h_s / lag_s).exp()),
                disturbance: (-h_s / self.design.disturbance_time_s).exp(),
            };
        }
        *decays
    }

    /// n: velocity, disturbance, weights, and the position where there is one.
    pub fn n_rows(&self) -> usize {
        self.n - usize::from(self.design.position_noise.is_none())
    }

    /// p, the number of weights of each axis.
    pub fn n_weights(&self) -> usize {
        N_PARAMETRIC + self.n - KERNEL
    }

    /// Whether a velocity lies outside of the box.
    pub(crate) fn is_outside(&self, velocity: &[f64; 3]) -> bool {
        (0..3).any(|axis| (velocity[axis] - self.box_center[axis]).abs() > self.half_widths[axis])
    }

    /// Bytes that a step reads: the factor of the features, and P.
    pub fn bytes_of_step(&self) -> usize {
        let n_centers = self.design.centers.n_centers();
        size_of::<f64>() * (n_centers * (n_centers + 1) / 2 + self.n_padded * self.n_padded)
    }

    /// Bytes of one state: three P, three columns of X, ψ̄.
    pub(crate) fn bytes_of_state(&self) -> usize {
        size_of::<f64>() * (3 * self.n_padded * self.n_padded + 4 * self.n_padded)
    }

    /// cond(K).
    pub fn gram_condition(&self) -> f64 {
        self.space.gram_condition()
    }

    /// The design.
    pub fn design(&self) -> &JointDesign {
        &self.design
    }
}

impl Scales {
    pub(super) fn set(&mut self, h_s: f64, rates_per_s: &[f64], variation_time_s: f64, teaches: Teaches) {
        let weights_stay = teaches == Teaches::State;
        if self.h_s == h_s && self.weights_stay == weights_stay {
            return;
        }
        (self.h_s, self.weights_stay) = (h_s, weights_stay);
        self.command_rate = -(-h_s / COMMAND_TIME_S).exp_m1();
        self.variation_rate = 1.0 - (-h_s / variation_time_s).exp();
        let mut before = (0.0, 1.0);
        for (row, (factor, &rate)) in self.factors.iter_mut().zip(rates_per_s).enumerate() {
            let rate = if weights_stay && row >= WEIGHTS { 0.0 } else { rate };
            if rate != before.0 {
                before = (rate, (-h_s * rate).exp());
            }
            *factor = before.1;
        }
        for (variance, s) in self.variances.iter_mut().zip(&self.factors) {
            *variance = 1.0 - s * s;
        }
        self.variances[DISTURBANCE] = 0.0;
    }
}
