//! The filter: constants of a design, and what a step works in.

use super::command::CommandStatistics;
use super::covariance::Covariance;
use super::design::JointDesign;
use super::excitation::Excitation;
use super::lags::Lags;
use super::noise_levels::NoiseLevels;
use super::rows::{DISTURBANCE, KERNEL, N_PARAMETRIC, POSITION, VELOCITY, WEIGHTS};
use super::state::{JointScalars, JointState};
use super::stray::StraySamples;
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
    pub(super) n: usize,
    pub(super) n_padded: usize,
    /// 1/T_k, 0 for the position's row and for what fills up.
    pub(super) rates_per_s: Vec<f64>,
    /// Center and largest half-width of the box: the scale of the linear rows.
    pub(super) box_center: [f64; 3],
    pub(super) largest_half_width: f64,
    pub(super) scales: Scales,
    pub(super) buffers: FeatureBuffers,
    pub(super) features: Vec<f64>,
    pub(super) teaching: Vec<f64>,
    pub(super) product: Vec<f64>,
    pub(super) position_row: Vec<f64>,
    pub(super) variances: Vec<f64>,
    pub(super) column: Vec<f64>,
}

/// e^{−h/T_k} of every row for one length of the step: computed when the length changes.
#[derive(Debug, Clone)]
pub(super) struct Scales {
    pub(super) h_s: f64,
    /// Whether the weights do not forget.
    pub(super) weights_stay: bool,
    pub(super) factors: Vec<f64>,
}

impl JointFilter {
    /// Builds the native space and allocates all that a step needs.
    ///
    /// # Errors
    /// The parameter that is out of range, with what would be accepted; `Centers` as [`NativeSpace::new`].
    pub fn new(design: &JointDesign) -> Result<Self, DesignError> {
        design.check()?;
        let space = NativeSpace::whole(design.kernel, &design.length_scale, design.centers.clone(), 0.0)?;
        let n = KERNEL + design.centers.n_centers();
        let n_padded = whole_lanes(n);
        let mut rates_per_s = vec![0.0; n_padded];
        rates_per_s[DISTURBANCE] = design.disturbance_time_s.recip();
        rates_per_s[WEIGHTS..WEIGHTS + 4].fill(design.motion_memory_s.recip());
        rates_per_s[WEIGHTS + 4..POSITION].fill(design.input_memory_s.recip());
        rates_per_s[KERNEL..n].fill(design.motion_memory_s.recip());
        let (lower, upper) = design.centers.bounding_box();
        let half_widths = (0..3).map(|axis| 0.5 * (upper[axis] - lower[axis]));
        let vector = || vec![0.0; n_padded];
        Ok(Self {
            unit: VectorUnit::of_this_machine(),
            n,
            n_padded,
            rates_per_s,
            box_center: std::array::from_fn(|axis| 0.5 * (upper[axis] + lower[axis])),
            largest_half_width: half_widths.fold(0.0, f64::max),
            scales: Scales { h_s: 0.0, weights_stay: false, factors: vec![1.0; n_padded] },
            buffers: FeatureBuffers::new(&space),
            features: vector(),
            teaching: vector(),
            product: vector(),
            position_row: vector(),
            variances: vector(),
            column: vector(),
            space,
            design: design.clone(),
        })
    }

    /// A state before the first output: nothing learned.
    pub fn new_state(&self) -> JointState {
        let mut variances = vec![0.0; self.n_padded];
        variances[WEIGHTS..POSITION].fill(1.0);
        variances[KERNEL..self.n].fill(1.0);
        variances[DISTURBANCE] = self.design.prior.disturbance * self.design.prior.disturbance;
        let mut prior = Covariance::zero(self.n);
        prior.set_diagonal(&variances);
        JointState {
            mean: std::array::from_fn(|_| vec![0.0; self.n_padded]),
            covariances: std::array::from_fn(|_| prior.clone()),
            excitation: Excitation::new(self.n_padded),
            scalars: JointScalars {
                is_started: false,
                is_shared: true,
                stray_velocities: StraySamples::default(),
                stray_positions: StraySamples::default(),
                position_is_known: [false; 3],
                noise_levels: NoiseLevels::configured(),
                lags: Lags::unknown(),
                command: CommandStatistics::unknown(),
            },
        }
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

    /// n: velocity, disturbance, weights, and the position where there is one.
    pub fn n_rows(&self) -> usize {
        self.n - usize::from(self.design.position_noise.is_none())
    }

    /// p, the number of weights of each axis.
    pub fn n_weights(&self) -> usize {
        N_PARAMETRIC + self.n - KERNEL
    }

    /// The design.
    pub fn design(&self) -> &JointDesign {
        &self.design
    }
}

impl Scales {
    pub(super) fn set(&mut self, h_s: f64, rates_per_s: &[f64], teaches: Teaches) {
        let weights_stay = teaches == Teaches::State;
        if self.h_s == h_s && self.weights_stay == weights_stay {
            return;
        }
        (self.h_s, self.weights_stay) = (h_s, weights_stay);
        let mut before = (0.0, 1.0);
        for (row, (factor, &rate)) in self.factors.iter_mut().zip(rates_per_s).enumerate() {
            let rate = if weights_stay && row >= WEIGHTS { 0.0 } else { rate };
            if rate != before.0 {
                before = (rate, (-h_s * rate).exp());
            }
            *factor = before.1;
        }
    }

    /// 1 − s_k² of the weights' rows, 0 of the others.
    pub(super) fn variances(&self, variances: &mut [f64]) {
        for (variance, s) in variances.iter_mut().zip(&self.factors) {
            *variance = 1.0 - s * s;
        }
    }
}
