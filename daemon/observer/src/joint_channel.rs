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
use crate::law::joint::predict::JointPrediction;
use crate::law::joint::state::JointState;
use crate::law::joint::teaches::Teaches;
use crate::law::joint::update::Agreement;
use crate::plant::attitude_filter::{AttitudeFilter, JointPose};
use crate::plant::body::KnownForce;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// The first steps of the grid are as long as this (ns),
const STEP_NS: u64 = 50_000_000;
/// after this many they double,
const STEPS_OF_ONE_LENGTH: u64 = 32;
/// up to this length,
const MAX_STEP_NS: u64 = 250_000_000;
/// for this many steps. Beyond, an estimate carries no information: the steps double again, to bound the cost.
const STEPS_OF_A_LONG_COAST: u64 = 4096;
/// Without a sample or a command for this many of their usual periods a gap begins.
const PERIODS_TO_A_GAP: f64 = 1.5;
/// The usual period follows the periods by this much of their difference.
const PERIOD_RATE: f64 = 0.1;
/// A longer time counts as this many periods.
const MAX_PERIODS_COUNTED: u64 = 3;
/// A channel tracks again after this many samples in a row within the gate.
const SAMPLES_TO_TRACK: u32 = 3;

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

/// What one sample brings to a channel; 1 σ of each component where it has its own.
#[derive(Debug, Clone, Copy, Default)]
pub struct JointSample {
    /// Velocity, inertial (m/s), or angular velocity, body axes (rad/s), by component.
    pub output: [Option<f64>; 3],
    /// Its deviations; `None`: those of the design.
    pub output_std: Option<[f64; 3]>,
    /// Position fix, inertial (m), by component.
    pub position: [Option<f64>; 3],
    /// Its deviations (m); `None`: that of the design.
    pub position_std: Option<[f64; 3]>,
    /// Commanded force, inertial (N), or torque, body axes (N·m): held until the next one.
    pub command: Option<Vector3<f64>>,
}

/// The filter's state at an instant.
#[derive(Debug, Clone)]
struct JointMoment<K> {
    stamp_ns: u64,
    state: JointState,
    pose: K,
}

/// All of a channel's history that has a fixed size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct JointHistory {
    /// The command that is held (N; N·m); 0 before the first.
    command: Vector3<f64>,
    /// Stamp of the newest output (ns).
    output_stamp_ns: Option<u64>,
    /// When outputs and when commands come.
    outputs: Rhythm,
    commands: Rhythm,
    /// Samples in a row within the gate, up to those that are needed.
    samples_within: u32,
    /// Mean of e²/S of the newest output.
    nis: f64,
    /// Whether the weights are learned since the newest sample.
    is_learning: bool,
}

impl JointHistory {
    fn new() -> Self {
        Self {
            command: Vector3::zeros(),
            output_stamp_ns: None,
            outputs: Rhythm::default(),
            commands: Rhythm::default(),
            samples_within: 0,
            nis: 0.0,
            is_learning: true,
        }
    }

    fn teaches(&self) -> Teaches {
        if self.is_learning { Teaches::All } else { Teaches::State }
    }

    /// When a gap begins if nothing comes (ns): outputs and commands are late, each by its own period.
    fn gap_start_ns(&self) -> u64 {
        match (self.outputs.late_ns(), self.commands.late_ns()) {
            (Some(output_ns), Some(command_ns)) => output_ns.max(command_ns),
            (late_ns, None) | (None, late_ns) => late_ns.unwrap_or(u64::MAX),
        }
    }
}

/// When something usually comes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Rhythm {
    /// Stamp of the newest one (ns).
    newest_ns: Option<u64>,
    /// The usual period (ns); 0 before the second one.
    period_ns: u64,
}

impl Rhythm {
    /// Sees one. Two of one stamp are one; an outage counts as a few periods, so that a slower rhythm is found, too.
    fn see(&mut self, stamp_ns: u64) {
        if let Some(before_ns) = self.newest_ns {
            let period_ns = stamp_ns.saturating_sub(before_ns);
            if self.period_ns == 0 {
                self.period_ns = period_ns;
            } else if period_ns > 0 {
                let counted_ns = period_ns.min(MAX_PERIODS_COUNTED.saturating_mul(self.period_ns));
                let change = PERIOD_RATE * (counted_ns as f64 - self.period_ns as f64);
                self.period_ns = (self.period_ns as f64 + change).ceil() as u64;
            }
        }
        self.newest_ns = Some(stamp_ns);
    }

    /// From when on the next one is late (ns).
    fn late_ns(&self) -> Option<u64> {
        let late_ns = (PERIODS_TO_A_GAP * self.period_ns as f64) as u64;
        self.newest_ns.filter(|_| self.period_ns > 0).map(|newest_ns| newest_ns.saturating_add(late_ns))
    }
}

/// What a channel says of an instant.
#[derive(Debug, Clone, Copy)]
pub struct JointEstimate<K> {
    /// State and unknown acceleration, with their deviations.
    pub prediction: JointPrediction,
    /// The unknown force (N) or torque (N·m): inertia times the unknown acceleration.
    pub matched_force: Vector3<f64>,
    /// What is integrated beside the filter.
    pub pose: K,
    /// No output for longer than the hold.
    pub is_coasting: bool,
    /// The innovations are not back within the gate since the last outage.
    pub is_reacquiring: bool,
    /// Mean of e²/S of the newest output.
    pub nis: f64,
    /// Time since the newest output (s); +∞ before the first.
    pub output_age_s: f64,
}

/// Forces as accelerations.
#[derive(Debug, Clone, Copy)]
struct PlantOfBody {
    inertia: Matrix3<f64>,
    inverse_inertia: Matrix3<f64>,
    known_force: KnownForce,
}

impl PlantOfBody {
    /// a_u and g at this velocity (m/s²; rad/s²).
    fn accelerations(&self, command: &Vector3<f64>, velocity: &Vector3<f64>) -> ([f64; 3], [f64; 3]) {
        let known = self.inverse_inertia * self.known_force.at(velocity);
        ((self.inverse_inertia * command).into(), known.into())
    }

    /// Moves to a grid point or a sample, within a gap or outside of one.
    fn advance<K: JointPose>(
        &self,
        filter: &mut JointFilter,
        from: &mut JointMoment<K>,
        to_ns: u64,
        history: &JointHistory,
    ) {
        let h_s = seconds(to_ns - from.stamp_ns);
        let before = Vector3::from(from.state.velocity());
        let (command, known) = self.accelerations(&history.command, &before);
        let gap_ns = history.gap_start_ns();
        let std = from.state.velocity_std();
        if from.stamp_ns < gap_ns {
            filter.predict(&mut from.state, h_s, &command, &known, history.teaches());
        } else {
            let gap_s = seconds(from.stamp_ns - gap_ns);
            filter.predict_gap(&mut from.state, h_s, &command, &known, gap_s);
        }
        let after = Vector3::from(from.state.velocity());
        from.pose = from.pose.after((&before, &after), &std, h_s);
        from.stamp_ns = to_ns;
    }
}

/// A channel of the rigid body with the joint law.
#[derive(Debug, Clone)]
pub struct JointChannel<K> {
    filter: JointFilter,
    plant: PlantOfBody,
    hold_ns: u64,
    /// At the newest sample.
    at: JointMoment<K>,
    history: JointHistory,
    /// The newest point of the grid from there that was asked for.
    ahead: JointMoment<K>,
    /// How many steps it is from there; `None` where it is not of this grid.
    ahead_steps: Option<u64>,
}

impl JointChannel<()> {
    /// The translation of a body on which this known force acts (N, inertial): gravity, buoyancy.
    ///
    /// # Errors
    /// As [`JointFilter::new`]; `Inertia` or `Hold` where they are not positive.
    pub fn translation(
        design: &JointChannelDesign,
        known_force_n: Vector3<f64>,
    ) -> Result<Self, DesignError> {
        Self::new(design, KnownForce::Constant(known_force_n), ())
    }
}

impl JointChannel<AttitudeFilter> {
    /// The rotation of a body, with the attitude that is integrated from it.
    ///
    /// # Errors
    /// As [`JointChannel::translation`].
    pub fn rotation(
        design: &JointChannelDesign,
        gyroscopic_torque: GyroscopicTorque,
        attitude: AttitudeFilter,
    ) -> Result<Self, DesignError> {
        let known_force = match gyroscopic_torque {
            GyroscopicTorque::Learned => KnownForce::Constant(Vector3::zeros()),
            GyroscopicTorque::Feedforward => KnownForce::Gyroscopic(design.inertia),
        };
        Self::new(design, known_force, attitude)
    }
}

impl<K: JointPose> JointChannel<K> {
    /// A channel that has learned nothing.
    ///
    /// # Errors
    /// As [`JointFilter::new`]; `Inertia` or `Hold` where they are not positive.
    fn new(design: &JointChannelDesign, known_force: KnownForce, pose: K) -> Result<Self, DesignError> {
        if !(design.hold_s.is_finite() && design.hold_s > 0.0) {
            return Err(DesignError::new(Parameter::Hold, design.hold_s.to_string(), "a finite number > 0"));
        }
        let inverse_inertia = design.inertia.cholesky().map(|factor| factor.inverse()).ok_or_else(|| {
            let found = format!("{:?}", design.inertia.as_slice());
            DesignError::new(Parameter::Inertia, found, "a symmetric positive definite matrix")
        })?;
        let filter = JointFilter::new(&design.filter)?;
        let at = JointMoment { stamp_ns: 0, state: filter.new_state(), pose };
        Ok(Self {
            filter,
            plant: PlantOfBody { inertia: design.inertia, inverse_inertia, known_force },
            hold_ns: (design.hold_s * 1e9).round() as u64,
            ahead: at.clone(),
            at,
            history: JointHistory::new(),
            ahead_steps: None,
        })
    }

    /// Moves to the stamp of a sample and takes what it brings. `None` where it has no output.
    ///
    /// # Cost
    /// One update and one prediction of the filter; a step for each grid point since the sample before.
    pub fn accept(
        &mut self,
        stamp_ns: u64,
        sample: &JointSample,
        teaches: Teaches,
        take_fix: impl FnOnce(&mut K),
    ) -> Option<Agreement> {
        self.move_to(stamp_ns);
        self.history.is_learning = teaches == Teaches::All;
        take_fix(&mut self.at.pose);
        let (history, state) = (&mut self.history, &mut self.at.state);
        history.command = sample.command.unwrap_or(history.command);
        let design = self.filter.design();
        let (output_std, position_std) = (
            sample.output_std.unwrap_or(design.noise),
            sample.position_std.unwrap_or([design.position_noise.unwrap_or(1.0); 3]),
        );
        let since_s = history.output_stamp_ns.map_or(0.0, |before_ns| seconds(stamp_ns - before_ns));
        let agreement = self.filter.update_velocity(state, &sample.output, &output_std, since_s, teaches);
        if let Some(agreement) = agreement {
            let is_gap = history.output_stamp_ns.is_none_or(|before_ns| stamp_ns - before_ns > self.hold_ns);
            let within = if agreement.is_stray || is_gap { 0 } else { history.samples_within + 1 };
            history.samples_within = within.min(SAMPLES_TO_TRACK);
            (history.output_stamp_ns, history.nis) = (Some(stamp_ns), agreement.nis);
        }
        if state.is_started() && self.filter.design().position_noise.is_some() {
            self.filter.update_position(state, &sample.position, &position_std, teaches);
        }
        if agreement.is_some() {
            history.outputs.see(stamp_ns);
        }
        if sample.command.is_some() {
            history.commands.see(stamp_ns);
        }
        self.ahead_steps = None;
        agreement
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
        let output_age_s = match history.output_stamp_ns {
            Some(output_ns) => seconds(stamp_ns.saturating_sub(output_ns)),
            None => f64::INFINITY,
        };
        let is_coasting =
            history.output_stamp_ns.is_none_or(|output_ns| stamp_ns.saturating_sub(output_ns) > self.hold_ns);
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
        let after = Vector3::from(prediction.velocity);
        JointEstimate {
            pose: base.pose.after((&before, &after), &base.state.velocity_std(), h_s),
            matched_force: self.plant.inertia * Vector3::from(prediction.learned.value),
            prediction,
            is_coasting,
            is_reacquiring: history.samples_within < SAMPLES_TO_TRACK || is_coasting,
            nis: history.nis,
            output_age_s,
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

    /// p, the number of weights of each axis.
    pub fn n_weights(&self) -> usize {
        self.filter.n_weights()
    }

    /// Forgets the state, not what was learned: begins again with the next output, at any stamp.
    pub fn restart(&mut self, pose: K) {
        self.filter.restart(&mut self.at.state);
        self.at.pose = pose;
        self.history = JointHistory::new();
        self.ahead_steps = None;
    }
}

fn seconds(duration_ns: u64) -> f64 {
    duration_ns as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law::joint::tests::paper_design;
    use crate::{Centers, LengthScale};

    const PERIOD_NS: u64 = 5_000_000;
    const NOISE_M_S: f64 = 0.05;
    const MASS_KG: f64 = 2.0;

    fn design() -> JointChannelDesign {
        let filter = JointDesign {
            length_scale: LengthScale::Isotropic(4.0),
            centers: Centers::lattice([-4.0; 3], [4.0; 3], [3; 3]).unwrap(),
            noise: [NOISE_M_S; 3],
            ..paper_design()
        };
        JointChannelDesign { filter, inertia: Matrix3::identity() * MASS_KG, hold_s: 0.0075 }
    }

    fn channel() -> JointChannel<()> {
        JointChannel::translation(&design(), Vector3::zeros()).unwrap()
    }

    struct Random(u64);

    impl Random {
        fn normal(&mut self) -> f64 {
            let uniform = |seed: &mut u64| {
                *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (*seed >> 11) as f64 / (1_u64 << 53) as f64
            };
            (0..12).map(|_| uniform(&mut self.0)).sum::<f64>() - 6.0
        }
    }

    /// A vehicle that holds a moving reference against a drag and a wind that it was not told of.
    struct Flight {
        random: Random,
        velocity: Vector3<f64>,
        gust: Vector3<f64>,
        phases: Vector3<f64>,
    }

    impl Flight {
        fn new(seed: u64) -> Self {
            let mut random = Random(seed);
            let phases = Vector3::from_fn(|_, _| 3.0 * random.normal());
            Self { random, velocity: Vector3::zeros(), gust: Vector3::zeros(), phases }
        }

        fn unknown_n(&self) -> Vector3<f64> {
            let air = self.velocity - Vector3::new(1.5, -0.5, 0.0);
            -0.25 * air.norm() * air
        }

        fn command_n(&self, t_s: f64) -> Vector3<f64> {
            let wave = |axis: usize, rate: f64| (rate * t_s + self.phases[axis]).sin();
            let reference = Vector3::new(2.5 * wave(0, 0.9), 2.0 * wave(1, 0.7), 0.8 * wave(2, 1.3));
            4.0 * (reference - self.velocity)
        }

        /// The process noise that the filter is told of, and the Gauss–Markov disturbance.
        fn advance(&mut self, command_n: &Vector3<f64>, h_s: f64) {
            for axis in 0..3 {
                let decay = (-h_s / 0.2_f64).exp();
                self.gust[axis] =
                    decay * self.gust[axis] + 0.1 * (1.0 - decay * decay).sqrt() * self.random.normal();
            }
            let substeps = 5;
            let dt = h_s / f64::from(substeps);
            for _ in 0..substeps {
                let a = (command_n + self.unknown_n()) / MASS_KG + self.gust;
                self.velocity += dt * a;
            }
            let white = (1.5e-3 * h_s).sqrt();
            self.velocity += Vector3::from_fn(|_, _| white * self.random.normal());
        }

        fn measured(&mut self) -> [Option<f64>; 3] {
            std::array::from_fn(|axis| Some(self.velocity[axis] + NOISE_M_S * self.random.normal()))
        }
    }

    /// Who asks, and when, changes nothing.
    #[test]
    fn the_same_samples_give_the_same_bits_whoever_asks() {
        let (mut asked, mut silent) = (channel(), channel());
        let mut flight = Flight::new(3);
        for j in 0..3000_u64 {
            let stamp_ns = 1_000_000_000 + j * PERIOD_NS;
            let command = flight.command_n(j as f64 * 0.005);
            // A gap of everything, an outage of the velocity, a slow sensor.
            let is_gap = (1000..1600).contains(&j);
            let has_output = !(2000..2200).contains(&j) && j % 3 == 0;
            if !is_gap {
                let output = if has_output { flight.measured() } else { [None; 3] };
                let sample = JointSample { output, command: Some(command), ..JointSample::default() };
                let teaches = if (700..800).contains(&j) { Teaches::State } else { Teaches::All };
                for channel in [&mut asked, &mut silent] {
                    channel.accept(stamp_ns, &sample, teaches, |()| {});
                }
            }
            for later_ns in [0, 1_700_000, (j % 7) * 60_000_000, 4_000_000] {
                asked.estimate(stamp_ns + later_ns);
            }
            flight.advance(&command, 0.005);
        }
        let later_ns = 1_000_000_000 + 3010 * PERIOD_NS;
        let [a, b] = [&mut asked, &mut silent].map(|channel| format!("{:?}", channel.estimate(later_ns)));
        assert_eq!(a, b);
        assert_eq!(asked.at.state.mean, silent.at.state.mean);
        assert_eq!(asked.at.state.covariances[0], silent.at.state.covariances[0]);
    }

    /// White noise as configured: the errors are as large as the deviations say, sample by sample and after outages.
    #[test]
    fn over_fifty_seeds_the_deviations_are_honest() {
        let (mut nees, mut nis, mut n) = (0.0, 0.0, 0.0);
        let (mut within, mut coasts) = (0.0, 0.0);
        for seed in 1..=50 {
            let mut channel = channel();
            let mut flight = Flight::new(seed);
            for j in 0..6000_u64 {
                let stamp_ns = 1_000_000_000 + j * PERIOD_NS;
                let command = flight.command_n(j as f64 * 0.005);
                // From 15 s on 0.5 s without velocity in every 2 s.
                let is_outage = j >= 3000 && j % 400 < 100;
                let output = if is_outage { [None; 3] } else { flight.measured() };
                let sample = JointSample { output, command: Some(command), ..JointSample::default() };
                let agreement = channel.accept(stamp_ns, &sample, Teaches::All, |()| {});
                let estimate = channel.estimate(stamp_ns);
                let error = flight.velocity - Vector3::from(estimate.prediction.velocity);
                let std = Vector3::from(estimate.prediction.velocity_std);
                if (2000..3000).contains(&j) && j % 50 == 0 {
                    nees += error.component_div(&std).norm_squared();
                    nis += agreement.unwrap().nis;
                    n += 1.0;
                }
                if j >= 3000 && j % 400 == 99 {
                    coasts += 3.0;
                    for axis in 0..3 {
                        within += f64::from(error[axis].abs() < 1.96 * std[axis]);
                    }
                }
                flight.advance(&command, 0.005);
            }
        }
        // Samples every 0.25 s are nearly independent. χ² of 3n degrees: ±1.96 √(2 · 3n).
        let (mean, spread) = (nees / (3.0 * n), 1.96 * (2.0 / (3.0 * n)).sqrt());
        let coverage = within / coasts;
        println!("NEES {mean:.3} ± {spread:.3}, NIS {:.3}, coverage of coasts {coverage:.3}", nis / n);
        assert!((mean - 1.0).abs() < spread, "NEES {mean} ± {spread}");
        assert!((0.8..1.2).contains(&(nis / n)), "NIS {}", nis / n);
        assert!((0.90..0.99).contains(&coverage), "coverage {coverage}");
    }
}
