//! §2: an update with a measured row of the state.
//!
//! ```text
//! e = y − X_0,  R = ρ r²,  S = P_00 + R,  K = P_00/S,  ζ = √(mean e²/S)
//! p = P_{·0},  S_w = S · max(1, ζ/4)            a stray sample counts as a noisier one
//! X += (p/S_w) eᵀ
//! P −= p pᵀ/S_w, and row and column 0 := p (S_w − P_00)/S_w
//! ```

use super::covariance::Covariance;
use super::filter::JointFilter;
use super::noise_levels::Innovation;
use super::rows::{DISTURBANCE, POSITION, VELOCITY};
use super::sensor::{Outliers, SensorUse};
use super::state::JointState;
use super::stray::STRAY;
use super::teaches::Teaches;

/// How well a sample agrees with the prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Mean of e²/S over the measured axes: 1 in the mean where the noises are right.
    pub nis: f64,
    /// Whether ζ > 4.
    pub is_stray: bool,
    /// e; 0 where an axis was not measured.
    pub innovation: [f64; 3],
    /// S_w; +∞ where an axis was not measured.
    pub variance: [f64; 3],
    /// P_00/S_w; 0 where an axis was not measured.
    pub gain: [f64; 3],
}

impl Agreement {
    fn of(innovations: &[Option<Innovation>; 3], nis: f64, weighing: Weighing) -> Self {
        let variance = innovations.map(|innovation| {
            innovation.map_or(f64::INFINITY, |i| (i.variance + weighing.surprise) * weighing.factor)
        });
        Self {
            nis,
            is_stray: nis > STRAY * STRAY,
            innovation: innovations.map(|innovation| innovation.map_or(0.0, |i| i.value)),
            variance,
            gain: std::array::from_fn(|axis| {
                innovations[axis].map_or(0.0, |i| (i.prior_variance + weighing.surprise) / variance[axis])
            }),
        }
    }

    /// ‖e‖.
    pub fn output_error(&self) -> f64 {
        self.innovation.iter().map(|e| e * e).sum::<f64>().sqrt()
    }
}

impl JointFilter {
    /// Takes a velocity, `since_s` after the one before (0 at the first). Deviations are those of the sample, without ρ.
    /// A first one begins the filter: v̂ = y, `P_00 = r²`; an axis that it does not measure may have any velocity.
    ///
    /// # Cost
    /// n² multiply-adds (3n² where the axes differ); no allocation.
    pub fn update_velocity(
        &mut self,
        state: &mut JointState,
        velocity: &[Option<f64>; 3],
        deviations: &[f64; 3],
        since_s: f64,
        (sensor, teaches): (SensorUse, Teaches),
    ) -> Option<Agreement> {
        velocity.iter().flatten().next()?;
        separate_axes(state, !are_alike(velocity, deviations));
        if !state.scalars.is_started {
            self.begin(state, velocity, deviations);
        }
        let noise = state.scalars.noise_levels.of_velocity(sensor);
        let innovations = innovations(state, VELOCITY, velocity, deviations, noise);
        let nis = mean_of(&innovations, Innovation::normalized_square);
        let adaptation = (since_s, self.design.noise_samples, self.design.excitation.correction_share);
        state.scalars.noise_levels.follow(&innovations, nis, adaptation, sensor);
        let is_new = state.scalars.stray_velocities.count(nis);
        let weighing = Weighing::of(&innovations, nis, is_new, sensor.outliers);
        if weighing.is_used {
            self.update_row(state, VELOCITY, &innovations, weighing, teaches);
        }
        Some(Agreement::of(&innovations, nis, weighing))
    }

    /// How well a velocity agrees with the prediction; changes nothing. `None` before the first one.
    pub fn judge_velocity(
        &self,
        state: &JointState,
        velocity: &[Option<f64>; 3],
        deviations: &[f64; 3],
        sensor: SensorUse,
    ) -> Option<Agreement> {
        velocity.iter().flatten().next().filter(|_| state.scalars.is_started)?;
        let noise = state.scalars.noise_levels.of_velocity(sensor);
        let innovations = innovations(state, VELOCITY, velocity, deviations, noise);
        let nis = mean_of(&innovations, Innovation::normalized_square);
        Some(Agreement::of(&innovations, nis, Weighing::NONE))
    }

    /// Begins with this velocity; an axis that was not measured may have any.
    fn begin(&self, state: &mut JointState, velocity: &[Option<f64>; 3], deviations: &[f64; 3]) {
        state.scalars.is_started = true;
        for axis in 0..3 {
            let deviation = match velocity[axis] {
                Some(y) => {
                    state.mean[axis][VELOCITY] = y;
                    deviations[axis]
                }
                None => self.largest_half_width,
            };
            state.covariances[axis].set(VELOCITY, VELOCITY, deviation * deviation);
        }
    }

    /// Takes a position fix, any of its components, each on its own; the first one of a component sets it. Where it comes before
    /// any velocity, it begins the filter: the velocity may be any. `since_s` is the time since a fix agreed, where fixes are all
    /// that is measured: too many stray ones in a row are then those of another velocity, `P += e² s sᵀ`, s = (1/t, …, 1).
    ///
    /// # Cost
    /// As [`JointFilter::update_velocity`].
    pub fn update_position(
        &mut self,
        state: &mut JointState,
        position: &[Option<f64>; 3],
        deviations: &[f64; 3],
        since_s: Option<f64>,
        (sensor, teaches): (SensorUse, Teaches),
    ) -> Option<Agreement> {
        position.iter().flatten().next()?;
        separate_axes(state, !are_alike(position, deviations));
        if !state.scalars.is_started {
            self.begin(state, &[None; 3], deviations);
        }
        for axis in 0..3 {
            let Some(fix) = position[axis].filter(|_| !state.scalars.position_is_known[axis]) else {
                continue;
            };
            state.scalars.position_is_known[axis] = true;
            state.mean[axis][POSITION] = fix;
            let covariance = &mut state.covariances[axis];
            self.column.fill(0.0);
            self.column[POSITION] = deviations[axis] * deviations[axis];
            covariance.set_cross(POSITION, &self.column);
        }
        let noise = state.scalars.noise_levels.position[sensor.place];
        let found = innovations(state, POSITION, position, deviations, noise);
        if found.iter().flatten().any(|i| i.normalized_square() > STRAY * STRAY) {
            separate_axes(state, true);
        }
        let nis = mean_of(&found, Innovation::normalized_square);
        if state.scalars.is_shared {
            state.scalars.stray_positions = Default::default();
            self.update_row(state, POSITION, &found, Weighing::NONE, teaches);
        } else {
            for axis in 0..3 {
                let mut one = [None; 3];
                one[axis] = found[axis];
                let Some(innovation) = one[axis] else { continue };
                let nis = innovation.normalized_square();
                let is_new = state.scalars.stray_positions[axis].count(nis);
                if let Some(since_s) = since_s.filter(|_| is_new) {
                    let covariance = &mut state.covariances[axis];
                    let speed = innovation.value / since_s;
                    let cross = covariance.at(VELOCITY, POSITION) + innovation.value * speed;
                    covariance.set(VELOCITY, POSITION, cross);
                    covariance.add_to_diagonal(VELOCITY, speed * speed);
                }
                let weighing = Weighing::of(&one, nis, is_new, sensor.outliers);
                if weighing.is_used {
                    self.update_row(state, POSITION, &one, weighing, teaches);
                }
            }
        }
        for innovation in found.iter().flatten() {
            state.scalars.noise_levels.follow_position(innovation, self.design.noise_samples, sensor.place);
        }
        Some(Agreement::of(&found, nis, Weighing::NONE))
    }

    fn update_row(
        &mut self,
        state: &mut JointState,
        row: usize,
        innovations: &[Option<Innovation>; 3],
        weighing: Weighing,
        teaches: Teaches,
    ) {
        let is_shared = state.scalars.is_shared;
        for (axis, innovation) in innovations.iter().enumerate() {
            let Some(innovation) = innovation else { continue };
            let variance = (innovation.variance + weighing.surprise) * weighing.factor;
            if axis == 0 || !is_shared {
                let covariance = &mut state.covariances[axis];
                covariance.add_to_diagonal(row, weighing.surprise);
                covariance.copy_row(row, &mut self.column);
                self.update_covariance(covariance, row, variance, teaches);
            }
            // X += (p/S_w) e.
            let (mean, p, step) = (&mut state.mean[axis], &self.column, innovation.value / variance);
            match teaches {
                Teaches::All => {
                    self.unit.compile(|| mean.iter_mut().zip(p).for_each(|(x, p)| *x += p * step));
                }
                Teaches::State => STATE_ROWS.into_iter().for_each(|row| mean[row] += p[row] * step),
            }
        }
    }

    /// P −= p pᵀ/S_w, p in `self.column`; nothing cancels in the measured row. Where the weights are not taught, their gain is
    /// 0 (Schmidt), and their own covariance stays.
    fn update_covariance(
        &mut self,
        covariance: &mut Covariance,
        row: usize,
        variance: f64,
        teaches: Teaches,
    ) {
        let (p, g, remaining) = (&self.column, &mut self.teaching, &mut self.product);
        let of_root = variance.sqrt().recip();
        let of_row = (variance - p[row]) / variance;
        self.unit.compile(|| {
            for ((g, remaining), p) in g.iter_mut().zip(&mut *remaining).zip(p) {
                (*g, *remaining) = (p * of_root, p * of_row);
            }
        });
        // The measured row and column are set below.
        g[row] = 0.0;
        match teaches {
            Teaches::All => covariance.subtract_square(g),
            Teaches::State => {
                covariance.subtract_square_of(&STATE_ROWS, g, self.n);
            }
        }
        covariance.set_cross(row, remaining);
    }
}

/// Rows that a sample corrects where it does not teach.
pub(super) const STATE_ROWS: [usize; 3] = [VELOCITY, DISTURBANCE, POSITION];

/// How a sample enters that may be stray.
#[derive(Debug, Clone, Copy)]
struct Weighing {
    /// S_w/S.
    factor: f64,
    /// What is added to P_00 because the vehicle does something new.
    surprise: f64,
    is_used: bool,
}

impl Weighing {
    /// As it stands.
    const NONE: Self = Self { factor: 1.0, surprise: 0.0, is_used: true };

    fn of(innovations: &[Option<Innovation>; 3], nis: f64, is_new: bool, outliers: Outliers) -> Self {
        match outliers {
            Outliers::Off => Self::NONE,
            _ if is_new => Self { surprise: mean_of(innovations, |i| i.value * i.value), ..Self::NONE },
            Outliers::Weigh => Self { factor: (nis.sqrt() / STRAY).max(1.0), ..Self::NONE },
            Outliers::Reject => Self { is_used: nis <= STRAY * STRAY, ..Self::NONE },
        }
    }
}

/// Whether the axes were measured alike, so that they may share a covariance.
fn are_alike(measured: &[Option<f64>; 3], deviations: &[f64; 3]) -> bool {
    measured.iter().all(Option::is_some) && deviations.iter().all(|r| *r == deviations[0])
}

/// Gives each axis a covariance of its own where they begin to differ. No allocation.
fn separate_axes(state: &mut JointState, differ: bool) {
    if state.scalars.is_shared && differ {
        let [shared, others @ ..] = &mut state.covariances;
        others.iter_mut().for_each(|covariance| covariance.copy_from(shared));
        state.scalars.is_shared = false;
    }
}

fn innovations(
    state: &JointState,
    row: usize,
    measured: &[Option<f64>; 3],
    deviations: &[f64; 3],
    noise_level: f64,
) -> [Option<Innovation>; 3] {
    std::array::from_fn(|axis| {
        let prior_variance = state.covariance(axis).at(row, row);
        let variance = prior_variance + noise_level * deviations[axis] * deviations[axis];
        measured[axis].map(|y| Innovation { value: y - state.mean[axis][row], prior_variance, variance })
    })
}

pub(super) fn mean_of(innovations: &[Option<Innovation>; 3], value: impl Fn(&Innovation) -> f64) -> f64 {
    let measured = innovations.iter().flatten();
    measured.clone().map(value).sum::<f64>() / measured.count() as f64
}
