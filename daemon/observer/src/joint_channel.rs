//! A channel with the joint law on a time line: from the samples' own stamps alone.
//!
//! Each sample moves the filter to its stamp, in one step where that is short, else on a grid of steps that begins at the
//! sample before. A question between two samples is answered from the newest point of that grid, and changes nothing: any
//! reader, any tick rate and any replay gets the same bits for the same samples and the same instant.
//!
//! A gap begins when neither an output nor a command came for 1.5 periods, each of its own (joint.md §3b). Grid points are set
//! at its start, so that what is predicted does not depend on the question.

use crate::design::GyroscopicTorque;
use crate::error::{DesignError, Parameter};
use crate::law::joint::design::JointDesign;
use crate::law::joint::filter::JointFilter;
use crate::law::joint::predict::{JointPrediction, LearnedAcceleration};
use crate::law::joint::sensor::SensorUse;
use crate::law::joint::state::JointState;
use crate::law::joint::teaches::Teaches;
use crate::law::joint::update::Agreement;
use crate::plant::attitude_filter::{AttitudeFilter, JointPose, PoseStep};
use crate::plant::body::KnownForce;
use crate::timeline::{ChannelReport, seconds};
use history::JointHistory;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

pub(crate) mod checkpoint;
mod history;

/// The first steps of the grid are as long as this (ns),
const STEP_NS: u64 = 50_000_000;
/// after this many they double,
const STEPS_OF_ONE_LENGTH: u64 = 32;
/// up to this length,
const MAX_STEP_NS: u64 = 250_000_000;
/// for this many steps. Beyond, an estimate carries no information: the steps double again, to bound the cost.
const STEPS_OF_A_LONG_COAST: u64 = 4096;

/// A reading that repeats the one before is not used beyond this many deviations.
const MAX_REPEATED: f64 = 5.0;

/// Everything that a channel with the joint law is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct JointChannelDesign {
    /// The law.
    pub filter: JointDesign,
    /// M, symmetric positive definite (kg; kg·m²).
    pub inertia: Matrix3<f64>,
    /// Without an output for longer than this (s) the channel coasts.
    pub hold_s: f64,
}

/// The translation of a body with the joint law.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTranslationDesign {
    /// The channel.
    pub channel: JointChannelDesign,
    /// Known constant force, inertial axes (N): gravity, buoyancy.
    pub known_force_n: Vector3<f64>,
    /// Gravity, of which an accelerometer measures nothing (m/s²).
    pub gravity_m_s2: Vector3<f64>,
}

/// The rotation of a body with the joint law, and its attitude.
#[derive(Debug, Clone, PartialEq)]
pub struct JointRotationDesign {
    /// The channel.
    pub channel: JointChannelDesign,
    /// What accounts for −ω × Iω.
    pub gyroscopic_torque: GyroscopicTorque,
    /// Deviation of an attitude fix, each component of its rotation vector, body axes (rad).
    pub attitude_noise_rad: f64,
    /// Prior deviation of the gyroscope's bias (rad/s); 0: it has none.
    pub bias_std_rad_s: f64,
    /// Its random walk (rad/s/√s).
    pub bias_walk_rad_s_sqrt_s: f64,
}

/// What one sample brings to a channel; 1 σ of each component where it has its own.
#[derive(Debug, Clone, Copy, Default)]
pub struct JointSample {
    /// Velocity, inertial (m/s), or angular velocity, body axes (rad/s), by component.
    pub output: [Option<f64>; 3],
    /// Its deviations; 0: that of the design.
    pub output_std: [f64; 3],
    /// Whether it is to the bit what its sensor said before. Once the prediction says that it must have changed, by more than five
    /// deviations, it is not used until it does: the deviation of a coast grows until it covers anything.
    pub repeats: bool,
    /// Position fix, inertial (m), by component.
    pub position: [Option<f64>; 3],
    /// Its deviations (m); 0: that of the design.
    pub position_std: [f64; 3],
    /// Commanded force, inertial (N), or torque, body axes (N·m): held until the next one.
    pub command: Option<Vector3<f64>>,
    /// Specific force, inertial (m/s²), and its deviation, the same for each axis. Only of a translation with an accelerometer.
    pub specific_force: Option<(Vector3<f64>, f64)>,
    /// The sensor.
    pub sensor: SensorUse,
    /// Attitude, body to inertial, and ω, body axes (rad/s), for features along the body's axes.
    pub turning: Option<(UnitQuaternion<f64>, Vector3<f64>)>,
}

/// The filter's state at an instant.
#[derive(Debug, Clone)]
struct JointMoment<K> {
    stamp_ns: u64,
    state: JointState,
    pose: K,
}

/// What a channel says of an instant.
#[derive(Debug, Clone, Copy)]
pub struct JointEstimate<K> {
    /// State and unknown acceleration, with their deviations.
    pub prediction: JointPrediction,
    /// The unknown force (N) or torque (N·m): inertia times the unknown acceleration.
    pub matched_force: Vector3<f64>,
    /// 1 σ of it.
    pub matched_force_std: [f64; 3],
    /// What is integrated beside the filter.
    pub pose: K,
    /// Whether a first output was seen: before, deviations are not known.
    pub is_started: bool,
    /// How far it can be trusted.
    pub report: ChannelReport,
}

/// Forces as accelerations.
#[derive(Debug, Clone, Copy)]
struct PlantOfBody {
    inertia: Matrix3<f64>,
    inverse_inertia: Matrix3<f64>,
    known_force: KnownForce,
    gravity_m_s2: Vector3<f64>,
    /// Without an output for longer than this (ns) the channel coasts.
    hold_ns: u64,
}

impl PlantOfBody {
    /// a_u and g at this velocity (m/s²; rad/s²).
    fn accelerations(&self, command: &Vector3<f64>, velocity: &Vector3<f64>) -> ([f64; 3], [f64; 3]) {
        let known = self.inverse_inertia * self.known_force.at(velocity);
        ((self.inverse_inertia * command).into(), known.into())
    }

    fn is_coasting(&self, history: &JointHistory, at_ns: u64) -> bool {
        let newest_ns = history.output_stamp_ns.or(history.fix_stamp_ns);
        newest_ns.is_none_or(|newest_ns| at_ns.saturating_sub(newest_ns) > self.hold_ns)
    }

    /// Moves to a grid point or a sample, within a gap or outside of one. Returns what was learned of the step.
    fn advance<K: JointPose>(
        &self,
        filter: &mut JointFilter,
        from: &mut JointMoment<K>,
        to_ns: u64,
        history: &JointHistory,
    ) -> LearnedAcceleration {
        let h_s = seconds(to_ns - from.stamp_ns);
        let before = Vector3::from(from.state.velocity());
        let (command, known) = self.accelerations(&history.command, &before);
        let gap_ns = history.gap_start_ns();
        let std = from.state.velocity_std();
        filter.set_slope(&mut from.state, self.is_coasting(history, from.stamp_ns));
        let learned = if from.stamp_ns < gap_ns {
            filter.predict(&mut from.state, h_s, &command, &known, history.teaches())
        } else {
            let gap_s = seconds(from.stamp_ns - gap_ns);
            filter.predict_gap(&mut from.state, h_s, &command, &known, gap_s, history.teaches())
        };
        from.pose = from.pose.after(&PoseStep {
            h_s,
            velocities: [before, Vector3::from(from.state.velocity())],
            std: [std, from.state.velocity_std()],
            is_coasting: self.is_coasting(history, to_ns),
        });
        from.stamp_ns = to_ns;
        learned
    }
}

/// A channel of the rigid body with the joint law.
#[derive(Debug, Clone)]
pub struct JointChannel<K> {
    filter: JointFilter,
    plant: PlantOfBody,
    /// At the newest sample.
    at: JointMoment<K>,
    history: JointHistory,
    /// The newest point of the grid from there that was asked for.
    ahead: JointMoment<K>,
    /// How many steps it is from there; `None` where it is not of this grid.
    ahead_steps: Option<u64>,
    initial: InitialMotion<K>,
    /// What was estimated at the checkpoint: the numbers of [`JointState::write`].
    saved: Vec<f64>,
    /// What it was at earlier samples, to return to when one arrives late.
    marks: Vec<(JointMoment<K>, JointHistory)>,
}

/// Velocity, position and pose before the first output.
#[derive(Debug, Clone, Copy)]
struct InitialMotion<K> {
    velocity: Option<Vector3<f64>>,
    position: Option<Vector3<f64>>,
    pose: K,
}

impl JointChannel<()> {
    /// The translation of a body, with velocity (m/s) and position (m) before the first output where they are known.
    ///
    /// # Errors
    /// As [`JointFilter::new`]; `Inertia` or `Hold` where they are not positive.
    pub fn translation(
        design: &JointTranslationDesign,
        velocity: Option<Vector3<f64>>,
        position: Option<Vector3<f64>>,
    ) -> Result<Self, DesignError> {
        let initial = InitialMotion { velocity, position, pose: () };
        let mut channel = Self::new(&design.channel, KnownForce::Constant(design.known_force_n), initial)?;
        channel.plant.gravity_m_s2 = design.gravity_m_s2;
        Ok(channel)
    }
}

impl JointChannel<AttitudeFilter> {
    /// The rotation of a body, with angular velocity (rad/s) and attitude before the first output where they are known.
    ///
    /// # Errors
    /// As [`JointChannel::translation`]; `Joint` where a deviation of the attitude is out of range.
    pub fn rotation(
        design: &JointRotationDesign,
        velocity: Option<Vector3<f64>>,
        attitude: Option<UnitQuaternion<f64>>,
    ) -> Result<Self, DesignError> {
        let (bias, walk) = (design.bias_std_rad_s, design.bias_walk_rad_s_sqrt_s);
        let noise = design.attitude_noise_rad;
        if !(noise.is_finite() && noise > 0.0) {
            return Err(DesignError::new(
                Parameter::Joint("attitude_noise_rad"),
                noise.to_string(),
                "a finite number > 0",
            ));
        }
        for (name, value) in [("bias_std_rad_s", bias), ("bias_walk_rad_s_sqrt_s", walk)] {
            if !(value.is_finite() && value >= 0.0) {
                let parameter = Parameter::Joint(name);
                return Err(DesignError::new(parameter, value.to_string(), "a finite number ≥ 0"));
            }
        }
        let known_force = match design.gyroscopic_torque {
            GyroscopicTorque::Learned => KnownForce::Constant(Vector3::zeros()),
            GyroscopicTorque::Feedforward => KnownForce::Gyroscopic(design.channel.inertia),
        };
        let pose = AttitudeFilter::new(attitude, bias, walk);
        Self::new(&design.channel, known_force, InitialMotion { velocity, position: None, pose })
    }

    /// The attitude and the gyroscope's bias at the newest sample.
    pub fn attitude(&self) -> &AttitudeFilter {
        &self.at.pose
    }
}

impl<K: JointPose> JointChannel<K> {
    fn new(
        design: &JointChannelDesign,
        known_force: KnownForce,
        initial: InitialMotion<K>,
    ) -> Result<Self, DesignError> {
        if !(design.hold_s.is_finite() && design.hold_s > 0.0) {
            return Err(DesignError::new(Parameter::Hold, design.hold_s.to_string(), "a finite number > 0"));
        }
        let inverse_inertia = design.inertia.cholesky().map(|factor| factor.inverse()).ok_or_else(|| {
            let found = format!("{:?}", design.inertia.as_slice());
            DesignError::new(Parameter::Inertia, found, "a symmetric positive definite matrix")
        })?;
        let filter = JointFilter::new(&design.filter)?;
        let at = JointMoment { stamp_ns: 0, state: filter.new_state(), pose: initial.pose };
        let saved = vec![0.0; JointState::n_numbers(filter.n)];
        let hold_ns = (design.hold_s * 1e9).round() as u64;
        let mut channel = Self {
            filter,
            plant: PlantOfBody {
                inertia: design.inertia,
                inverse_inertia,
                known_force,
                gravity_m_s2: Vector3::zeros(),
                hold_ns,
            },
            ahead: at.clone(),
            at,
            history: JointHistory::new(),
            ahead_steps: None,
            initial,
            saved,
            marks: Vec::new(),
        };
        channel.begin();
        channel.at.state.write(channel.filter.n, &mut channel.saved);
        Ok(channel)
    }

    /// Moves to the stamp of a sample and takes what it brings, `take_fix` for the pose. `None` where it has no output.
    ///
    /// A sample that brings nothing changes nothing.
    ///
    /// # Cost
    /// One update and one prediction of the filter; a step for each grid point since the sample before.
    pub fn accept<F: FnOnce(&mut K)>(
        &mut self,
        stamp_ns: u64,
        sample: &JointSample,
        teaches: Teaches,
        take_fix: Option<F>,
    ) -> Option<Agreement> {
        let has_output = sample.output.iter().any(Option::is_some);
        let has_fix = sample.position.iter().any(Option::is_some) || take_fix.is_some();
        if !has_output && !has_fix && sample.command.is_none() && sample.specific_force.is_none() {
            return None;
        }
        self.move_to(stamp_ns);
        if let Some((attitude, rate)) = &sample.turning {
            self.filter.turn(&mut self.at.state, attitude, rate);
        }
        self.history.is_learning = teaches == Teaches::All;
        if let Some(take_fix) = take_fix {
            take_fix(&mut self.at.pose);
        }
        self.history.command = sample.command.unwrap_or(self.history.command);
        let agreement = self.update(stamp_ns, sample, teaches);
        if sample.command.is_some() {
            self.history.see_command(stamp_ns);
        }
        self.ahead_steps = None;
        agreement
    }

    fn update(&mut self, stamp_ns: u64, sample: &JointSample, teaches: Teaches) -> Option<Agreement> {
        let (history, state) = (&mut self.history, &mut self.at.state);
        let design = self.filter.design();
        let (output_std, position_std) = (
            or_designed(&sample.output_std, &design.noise),
            or_designed(&sample.position_std, &[design.position_noise.unwrap_or(1.0); 3]),
        );
        let since_s = history.output_stamp_ns.map_or(0.0, |before_ns| seconds(stamp_ns - before_ns));
        let bias = self.at.pose.output_bias();
        let output = std::array::from_fn(|axis| sample.output[axis].map(|y| y - bias[axis]));
        history.is_stuck &= sample.repeats || output.iter().all(Option::is_none);
        let judged = sample
            .repeats
            .then(|| self.filter.judge_velocity(state, &output, &output_std, sample.sensor))
            .flatten();
        let impossible = judged.filter(|judged| {
            history.is_stuck |= judged.nis > MAX_REPEATED * MAX_REPEATED;
            history.is_stuck
        });
        let output = if impossible.is_some() { [None; 3] } else { output };
        let how = (sample.sensor, teaches);
        let agreement = self.filter.update_velocity(state, &output, &output_std, since_s, how);
        if let Some(agreement) = &agreement {
            self.filter.set_slope(state, false);
            let agrees = !agreement.is_stray && !self.plant.is_coasting(history, stamp_ns);
            history.see_output(stamp_ns, agreement.output_error(), agreement.nis, agrees);
            self.at.pose.take_innovations(agreement);
        }
        if self.filter.design().position_noise.is_some() {
            let was_coasting = self.plant.is_coasting(history, stamp_ns);
            let since_s = history.since_agreed_fix_s(stamp_ns);
            let fix = self.filter.update_position(state, &sample.position, &position_std, since_s, how);
            if let Some(fix) = fix {
                history.see_fix(stamp_ns, fix.output_error(), fix.nis, !fix.is_stray && !was_coasting);
            }
        }
        if let Some((force, deviation)) = &sample.specific_force {
            let velocity = Vector3::from(state.velocity());
            let (command, known) = self.plant.accelerations(&history.command, &velocity);
            let unknown = force + self.plant.gravity_m_s2 - Vector3::from(known) - Vector3::from(command);
            // Without a velocity, an error of v̂ shows in the learned force and would teach it.
            let is_coasting = self.plant.is_coasting(history, stamp_ns);
            let how = if is_coasting { (sample.sensor, Teaches::State) } else { how };
            self.filter.update_acceleration(state, &unknown.into(), *deviation, &command, how);
        }
        agreement.or(impossible.map(|impossible| Agreement { is_stray: true, ..impossible }))
    }

    /// Commits the prediction to the stamp of a new sample.
    fn move_to(&mut self, stamp_ns: u64) {
        if self.at.state.is_started() {
            let mut step = 0;
            // What was asked for already lies on the same grid.
            if let Some(steps) = self.ahead_steps.filter(|_| self.ahead.stamp_ns <= stamp_ns) {
                std::mem::swap(&mut self.at, &mut self.ahead);
                step = steps;
            }
            while self.at.stamp_ns < stamp_ns {
                let next_ns = self.grid_ns(self.at.stamp_ns, step).min(stamp_ns);
                self.plant.advance(&mut self.filter, &mut self.at, next_ns, &self.history);
                step += 1;
            }
        }
        self.at.stamp_ns = stamp_ns;
    }

    /// What a sample at `stamp_ns` will find: the prediction that is committed there, to the bit, the force of the step to it
    /// (inertia times the acceleration), and its deviation with the covariance after the step. Between two samples
    /// [`estimate`](Self::estimate) answers sooner, and leaves out what changes with the commitment.
    ///
    /// # Cost
    /// A copy of the channel, which allocates: for traces.
    pub fn committed(&self, stamp_ns: u64) -> (JointPrediction, Vector3<f64>, [f64; 3]) {
        let mut next = self.clone();
        let at_once = next.filter.look_ahead(&next.at.state, 0.0, &[0.0; 3], &[0.0; 3], None);
        let (mut learned, mut learned_std) = (at_once.learned, at_once.learned_std);
        let mut step = 0;
        while next.at.state.is_started() && next.at.stamp_ns < stamp_ns {
            let next_ns = next.grid_ns(next.at.stamp_ns, step).min(stamp_ns);
            learned = next.plant.advance(&mut next.filter, &mut next.at, next_ns, &next.history);
            learned_std = next.filter.learned_std(&next.at.state, &learned);
            step += 1;
        }
        let state = &next.at.state;
        let prediction = JointPrediction {
            velocity: state.velocity(),
            velocity_std: state.velocity_std(),
            position: state.position(),
            position_std: state.position_std(),
            learned,
            learned_std,
        };
        let inertia = &self.plant.inertia;
        (prediction, inertia * Vector3::from(learned.value), std_of(inertia, &learned_std))
    }

    /// The grid point after the one at `at_ns`, which is this many steps from the newest sample.
    fn grid_ns(&self, at_ns: u64, step: u64) -> u64 {
        let doublings = |step: u64| (step / STEPS_OF_ONE_LENGTH).min(34);
        let long_ns = MAX_STEP_NS.saturating_mul(1 << doublings(step.saturating_sub(STEPS_OF_A_LONG_COAST)));
        let next_ns = at_ns.saturating_add((STEP_NS << doublings(step).min(8)).min(long_ns));
        let gap_ns = self.history.gap_start_ns();
        if at_ns < gap_ns { next_ns.min(gap_ns) } else { next_ns }
    }

    /// The estimate at `stamp_ns`, or at the newest sample where that is later. Changes nothing but the grid.
    ///
    /// # Cost
    /// N²/2 + 2n² multiply-adds, and a prediction for each grid point that was not asked for yet; no allocation.
    pub fn estimate(&mut self, stamp_ns: u64) -> JointEstimate<K> {
        let history = self.history;
        let to_ns = stamp_ns.max(self.at.stamp_ns);
        let base = if !self.at.state.is_started() || to_ns <= self.grid_ns(self.at.stamp_ns, 0) {
            &self.at
        } else {
            self.move_ahead(to_ns);
            &self.ahead
        };
        let h_s = if base.state.is_started() { seconds(to_ns - base.stamp_ns) } else { 0.0 };
        let before = Vector3::from(base.state.velocity());
        let (command, known) = self.plant.accelerations(&history.command, &before);
        let gap_ns = history.gap_start_ns();
        let gap_s = (base.stamp_ns >= gap_ns).then(|| seconds(base.stamp_ns - gap_ns));
        let prediction = self.filter.look_ahead(&base.state, h_s, &command, &known, gap_s);
        let is_coasting = self.plant.is_coasting(&history, stamp_ns);
        let step = PoseStep {
            h_s,
            velocities: [before, Vector3::from(prediction.velocity)],
            std: [base.state.velocity_std(), prediction.velocity_std],
            is_coasting,
        };
        JointEstimate {
            pose: base.pose.after(&step),
            matched_force: self.plant.inertia * Vector3::from(prediction.learned.value),
            matched_force_std: std_of(&self.plant.inertia, &prediction.learned_std),
            report: self.report(&base.state, &prediction, is_coasting, stamp_ns),
            is_started: base.state.is_started(),
            prediction,
        }
    }

    fn report(
        &self,
        state: &JointState,
        prediction: &JointPrediction,
        is_coasting: bool,
        stamp_ns: u64,
    ) -> ChannelReport {
        let history = &self.history;
        let teaches = !is_coasting && history.is_learning;
        ChannelReport {
            output_error: if is_coasting { 0.0 } else { history.output_error },
            activation: if teaches { state.excitation.teaching } else { 0.0 },
            power_function: prediction.learned.power_function,
            native_norm: state.weights_norm(),
            solver_error: 0.0,
            error_bound: f64::INFINITY,
            output_age_s: match history.output_stamp_ns.or(history.fix_stamp_ns) {
                Some(output_ns) => seconds(stamp_ns.saturating_sub(output_ns)),
                None => f64::INFINITY,
            },
            coasting: is_coasting,
            clamped: false,
            outside_centers: self.filter.is_outside(&prediction.velocity),
            nis: history.nis,
            reacquiring: history.is_reacquiring(),
        }
    }

    /// Moves `ahead` to the newest grid point at or before `to_ns`.
    fn move_ahead(&mut self, to_ns: u64) {
        let mut steps = match self.ahead_steps.filter(|_| self.ahead.stamp_ns <= to_ns) {
            Some(steps) => steps,
            None => {
                self.ahead.stamp_ns = self.at.stamp_ns;
                self.ahead.pose = self.at.pose;
                self.ahead.state.copy_from(&self.at.state);
                0
            }
        };
        loop {
            let next_ns = self.grid_ns(self.ahead.stamp_ns, steps);
            if next_ns > to_ns || next_ns == u64::MAX {
                break;
            }
            self.plant.advance(&mut self.filter, &mut self.ahead, next_ns, &self.history);
            steps += 1;
        }
        self.ahead_steps = Some(steps);
    }

    /// The filter's state at the newest sample.
    pub fn state(&self) -> &JointState {
        &self.at.state
    }

    /// Normalized innovation squared of the newest output; 0 before the first.
    pub fn nis(&self) -> f64 {
        self.history.nis
    }

    /// Whether the newest outputs repeat what cannot be, and are not used.
    pub fn is_stuck(&self) -> bool {
        self.history.is_stuck
    }

    /// p, the number of weights of each axis.
    pub fn n_weights(&self) -> usize {
        self.filter.n_weights()
    }

    /// Forgets the state, not what was learned: begins again with the next output, at any stamp.
    pub fn restart(&mut self) {
        self.filter.restart(&mut self.at.state);
        self.begin();
    }

    /// Forgets the state and what was learned. No allocation.
    pub fn forget(&mut self) {
        self.filter.clear(&mut self.at.state);
        self.begin();
    }

    fn begin(&mut self) {
        let InitialMotion { velocity, position, pose } = self.initial;
        self.at.state.set_motion(velocity, position);
        self.at.pose = pose;
        self.history = JointHistory::new();
        self.ahead_steps = None;
    }

    /// The law: its design, and what of it a report needs.
    pub fn filter(&self) -> &JointFilter {
        &self.filter
    }

    /// Bytes that are held: two states, the marks, a checkpoint, and the law.
    pub fn bytes(&self) -> usize {
        (2 + self.marks.len()) * self.filter.bytes_of_state()
            + size_of_val(&*self.saved)
            + self.filter.bytes_of_step()
    }
}

/// Deviations of a sample, and where it says 0 those of the design.
pub(crate) fn or_designed(std: &[f64; 3], designed: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| if std[axis] > 0.0 { std[axis] } else { designed[axis] })
}

/// Deviations of M a, those of the axes of a being independent: √diag(M diag(std²) Mᵀ).
fn std_of(inertia: &Matrix3<f64>, std: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|row| {
        (0..3).map(|column| (inertia[(row, column)] * std[column]).powi(2)).sum::<f64>().sqrt()
    })
}

#[cfg(test)]
mod tests;
