//! The rigid body: a translation channel and a rotation channel, with position and attitude.

use crate::innovation_gate::Plausibility;
use crate::law::gradient::Law;
use crate::plant::attitude::Attitude;
use crate::plant::body::{Body, BodyState, KnownForce};
use crate::plant::position::Position;
use crate::report::certificate::{Certificate, sup_if_needed};
use crate::timeline::{ChannelReport, ChannelState, Measured, Timeline};
use crate::{Channel, ChannelDesign, DesignError, Parameter};
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// The translation channel: y = v (inertial), M = m I₃, u the commanded force (Niu et al., §VI-A).
#[derive(Debug, Clone, PartialEq)]
pub struct TranslationDesign {
    /// The law for the velocity.
    pub channel: ChannelDesign,
    /// Known constant force, inertial axes (N): gravity, buoyancy.
    pub known_force_n: Vector3<f64>,
    /// L_r: `r̂' = v̂ + L_r ỹ`, dimensionless; 0 by default.
    pub velocity_error_to_position: f64,
    /// L_p ≥ 0 (1/s): how fast the position follows fixes; 0 ignores all but the first.
    pub position_fix_gain_per_s: f64,
    /// How long a position fix keeps correcting (s).
    pub position_fix_hold_s: f64,
}

/// The rotation channel: y = ω (body), M the inertia matrix, u the commanded torque (Niu et al., §VI-B).
#[derive(Debug, Clone, PartialEq)]
pub struct RotationDesign {
    /// The law for the angular velocity.
    pub channel: ChannelDesign,
    /// Who accounts for −ω × Iω.
    pub gyroscopic_torque: GyroscopicTorque,
    /// L_q ≥ 0 (1/s): how fast the attitude follows fixes; 0 ignores all but the first.
    pub attitude_fix_gain_per_s: f64,
    /// How long an attitude fix keeps correcting (s).
    pub attitude_fix_hold_s: f64,
}

/// Who accounts for the gyroscopic torque −ω × Iω of Niu et al., eq. (rotational eom dyn).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GyroscopicTorque {
    /// It is part of the unknown torque, as in the paper.
    Learned,
    /// It is computed from ω̂ and the nominal inertia.
    Feedforward,
}

/// The state before the first sample; what is `None` is taken from the first measurement of it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct InitialState {
    /// r̂(0), inertial (m).
    pub position_m: Option<Vector3<f64>>,
    /// v̂(0), inertial (m/s).
    pub velocity_m_s: Option<Vector3<f64>>,
    /// q̂(0), body to inertial.
    pub attitude: Option<UnitQuaternion<f64>>,
    /// ω̂(0), body axes (rad/s).
    pub angular_velocity_rad_s: Option<Vector3<f64>>,
}

/// A velocity and its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Velocity {
    /// Along the inertial axes (m/s).
    Inertial(Vector3<f64>),
    /// Along the body axes (m/s), of a Doppler log: rotated by q̂.
    Body(Vector3<f64>),
}

/// What was measured and commanded at one instant. All values are finite: the caller checks.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// Time (ns), later than that of the sample before.
    pub stamp_ns: u64,
    /// Measured velocity.
    pub velocity: Option<Velocity>,
    /// Measured angular velocity, body axes (rad/s).
    pub angular_velocity_rad_s: Option<Vector3<f64>>,
    /// Position fix, inertial (m).
    pub position_m: Option<Vector3<f64>>,
    /// Attitude fix, body to inertial.
    pub attitude: Option<UnitQuaternion<f64>>,
    /// Commanded force, inertial axes (N); held until the next one.
    pub force_n: Option<Vector3<f64>>,
    /// Commanded torque, body axes (N·m); held until the next one.
    pub torque_n_m: Option<Vector3<f64>>,
}

/// State, learned force and trust at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBodyEstimate {
    /// Time of the state (ns).
    pub stamp_ns: u64,
    /// r̂, inertial (m).
    pub position_m: Vector3<f64>,
    /// v̂, inertial (m/s).
    pub velocity_m_s: Vector3<f64>,
    /// q̂, body to inertial.
    pub attitude: UnitQuaternion<f64>,
    /// ω̂, body axes (rad/s).
    pub angular_velocity_rad_s: Vector3<f64>,
    /// f̂ of the translation, inertial axes (N).
    pub matched_force_n: Vector3<f64>,
    /// f̂ of the rotation, body axes (N·m).
    pub matched_torque_n_m: Vector3<f64>,
    /// Trust in the translation, if there is one.
    pub translation: Option<ChannelReport>,
    /// Trust in the rotation, if there is one.
    pub rotation: Option<ChannelReport>,
}

impl RigidBodyEstimate {
    /// 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π].
    pub fn euler_rad(&self) -> [f64; 3] {
        let (roll, pitch, yaw) = self.attitude.euler_angles();
        [roll, pitch, yaw]
    }
}

/// The adaptive observer of a rigid body (Niu et al., §VI-A, §VI-B).
///
/// Samples go in with their stamps; estimates come out for any
/// instant not before the newest sample.
///
/// The same samples give the same estimates to the bit, whenever and however often estimates are asked for.
#[derive(Debug, Clone)]
pub struct RigidBodyObserver {
    translation: Option<Timeline<Body<Position>, 3>>,
    rotation: Option<Timeline<Body<Attitude>, 3>>,
    initial_attitude: Option<UnitQuaternion<f64>>,
    position_fix_hold_ns: u64,
    attitude_fix_hold_ns: u64,
    /// Attitude of a body without a rotation channel: the newest fix.
    fixed_attitude: Option<UnitQuaternion<f64>>,
    velocity_teaches: bool,
    angular_velocity_teaches: bool,
    /// `fixed_attitude` of the good copy.
    good_attitude: Option<UnitQuaternion<f64>>,
}

/// All that the future of a [`RigidBodyObserver`] depends on, beside what it learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RigidBodyState {
    translation: Option<ChannelState<BodyState<Position>, 3>>,
    rotation: Option<ChannelState<BodyState<Attitude>, 3>>,
    fixed_attitude: Option<UnitQuaternion<f64>>,
}

impl RigidBodyState {
    /// r̂ and v̂ at the newest sample, inertial (m; m/s).
    pub fn position_and_velocity(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let state = self.translation?.newest();
        Some((state.pose.position, state.rate))
    }

    /// q̂ and ω̂ at the newest sample, body to inertial and body axes (rad/s).
    pub fn attitude_and_angular_velocity(&self) -> Option<(UnitQuaternion<f64>, Vector3<f64>)> {
        let state = self.rotation?.newest();
        Some((state.pose.attitude, state.rate))
    }

    /// Stamp of the newest sample (ns); `None` before the first output.
    pub fn stamp_ns(&self) -> Option<u64> {
        let translation = self.translation.and_then(|translation| translation.stamp_ns());
        translation.max(self.rotation.and_then(|rotation| rotation.stamp_ns()))
    }
}

impl RigidBodyObserver {
    /// Builds the channels. Everything is allocated here.
    ///
    /// # Errors
    /// As [`Channel::new`]; `Fix` where a fix's gain or hold is negative or not finite; `Channels` where
    /// there is none.
    pub fn new(
        translation: Option<TranslationDesign>,
        rotation: Option<RotationDesign>,
        initial: InitialState,
    ) -> Result<Self, DesignError> {
        if translation.is_none() && rotation.is_none() {
            let needed = "a translation, a rotation, or both";
            return Err(DesignError::new(Parameter::Channels, "neither".into(), needed));
        }
        let mut position_fix_hold_ns = 0;
        let translation = translation.map(|design| {
            position_fix_hold_ns = fix_hold_ns(design.position_fix_gain_per_s, design.position_fix_hold_s)?;
            let l_r = design.velocity_error_to_position;
            if !l_r.is_finite() {
                return Err(DesignError::new(Parameter::Fix, l_r.to_string(), "a finite number"));
            }
            let position = Position::new(initial.position_m, l_r, design.position_fix_gain_per_s);
            let known_force = KnownForce::Constant(design.known_force_n);
            timeline(&design.channel, known_force, initial.velocity_m_s, position)
        });
        let mut attitude_fix_hold_ns = 0;
        let rotation = rotation.map(|design| {
            attitude_fix_hold_ns = fix_hold_ns(design.attitude_fix_gain_per_s, design.attitude_fix_hold_s)?;
            let attitude = Attitude::new(initial.attitude, design.attitude_fix_gain_per_s);
            let known_force = match design.gyroscopic_torque {
                GyroscopicTorque::Learned => KnownForce::Constant(Vector3::zeros()),
                GyroscopicTorque::Feedforward => KnownForce::Gyroscopic(design.channel.inertia),
            };
            timeline(&design.channel, known_force, initial.angular_velocity_rad_s, attitude)
        });
        let (translation, rotation) = (translation.transpose()?, rotation.transpose()?);
        Ok(Self {
            translation,
            rotation,
            fixed_attitude: initial.attitude,
            initial_attitude: initial.attitude,
            velocity_teaches: true,
            angular_velocity_teaches: true,
            good_attitude: None,
            position_fix_hold_ns,
            attitude_fix_hold_ns,
        })
    }

    /// Takes one sample: each channel moves to its stamp, learns, and holds what the sample brings.
    ///
    /// # Cost
    /// One evaluation of the features per channel with a new output; no allocation.
    pub fn accept(&mut self, sample: &Sample) {
        let stamp_ns = sample.stamp_ns;
        let attitude_until_ns = stamp_ns.saturating_add(self.attitude_fix_hold_ns);
        if let Some(rotation) = &mut self.rotation {
            let teaches = self.angular_velocity_teaches;
            let measured = sample.angular_velocity_rad_s.map(|output| Measured { output, teaches });
            rotation.accept(stamp_ns, measured, sample.torque_n_m, |state| {
                if let Some(fix) = &sample.attitude {
                    state.pose.take_fix(fix, attitude_until_ns);
                }
            });
        }
        self.fixed_attitude = sample.attitude.or(self.fixed_attitude);
        let attitude = self.known_attitude_at(stamp_ns);
        let position_until_ns = stamp_ns.saturating_add(self.position_fix_hold_ns);
        if let Some(translation) = &mut self.translation {
            let velocity = match sample.velocity {
                Some(Velocity::Inertial(velocity)) => Some(velocity),
                // Without an attitude nobody knows which way it points: it is not used.
                Some(Velocity::Body(velocity)) => attitude.map(|attitude| attitude * velocity),
                None => None,
            };
            let teaches = self.velocity_teaches;
            let measured = velocity.map(|output| Measured { output, teaches });
            translation.accept(stamp_ns, measured, sample.force_n, |state| {
                if let Some(fix) = &sample.position_m {
                    state.pose.take_fix(fix, position_until_ns);
                }
            });
        }
    }

    /// The estimate at `stamp_ns`, or at the newest sample where that is later.
    ///
    /// # Cost
    /// Constant while outputs are held; one evaluation of the features per channel and coasting step
    /// otherwise. No allocation.
    pub fn estimate(&mut self, stamp_ns: u64) -> RigidBodyEstimate {
        let translation = self.translation.as_mut().map(|t| (t.predict(stamp_ns), t));
        let (position_m, velocity_m_s, matched_force_n, translation) = match translation {
            Some((at, timeline)) => {
                let report = timeline.report(&at, stamp_ns);
                (at.moment.state.pose.position, at.moment.state.rate, at.matched_force.value, Some(report))
            }
            None => Default::default(),
        };
        let rotation = self.rotation.as_mut().map(|r| (r.predict(stamp_ns), r));
        let (attitude, angular_velocity_rad_s, matched_torque_n_m, rotation) = match rotation {
            Some((at, timeline)) => {
                let report = timeline.report(&at, stamp_ns);
                (at.moment.state.pose.attitude, at.moment.state.rate, at.matched_force.value, Some(report))
            }
            None => (self.fixed_attitude.unwrap_or_default(), Vector3::zeros(), Vector3::zeros(), None),
        };
        RigidBodyEstimate {
            stamp_ns,
            position_m,
            velocity_m_s,
            attitude,
            angular_velocity_rad_s,
            matched_force_n,
            matched_torque_n_m,
            translation,
            rotation,
        }
    }

    fn known_attitude_at(&mut self, stamp_ns: u64) -> Option<UnitQuaternion<f64>> {
        match &mut self.rotation {
            Some(rotation) => {
                let pose = rotation.predict(stamp_ns).moment.state.pose;
                pose.is_known().then_some(pose.attitude)
            }
            None => self.fixed_attitude,
        }
    }

    /// Stops or resumes learning from the next outputs on; what was learned stays in use.
    pub fn set_frozen(&mut self, frozen: bool) {
        if let Some(translation) = &mut self.translation {
            translation.law.set_frozen(frozen);
        }
        if let Some(rotation) = &mut self.rotation {
            rotation.law.set_frozen(frozen);
        }
    }

    /// Whether the outputs of each channel may be learned from, from now on: not while a sensor is stuck, say.
    pub fn set_teaching(&mut self, translation: bool, rotation: bool) {
        (self.velocity_teaches, self.angular_velocity_teaches) = (translation, rotation);
    }

    /// From now on outputs are judged by this; at first all are believed.
    pub fn set_plausibility(&mut self, plausibility: Plausibility) {
        if let Some(translation) = &mut self.translation {
            translation.set_plausibility(plausibility);
        }
        if let Some(rotation) = &mut self.rotation {
            rotation.set_plausibility(plausibility);
        }
    }

    /// Outputs that stood out and were held back: of translation and rotation.
    pub fn n_held_back(&self) -> [u64; 2] {
        let translation = self.translation.as_ref().map_or(0, Timeline::n_held_back);
        [translation, self.rotation.as_ref().map_or(0, Timeline::n_held_back)]
    }

    /// Forgets everything; starts again from the next sample.
    pub fn reset(&mut self) {
        self.restart();
        if let Some(translation) = &mut self.translation {
            translation.law.forget();
        }
        if let Some(rotation) = &mut self.rotation {
            rotation.law.forget();
        }
    }

    /// Forgets the state, not what was learned: starts again from the next sample, whatever its stamp.
    pub fn restart(&mut self) {
        if let Some(translation) = &mut self.translation {
            translation.restart();
        }
        if let Some(rotation) = &mut self.rotation {
            rotation.restart();
        }
        self.fixed_attitude = self.initial_attitude;
    }

    /// Keeps a copy of the committed state and weights. Call it while they are known to be good.
    ///
    /// # Cost
    /// 6N numbers copied; no allocation.
    pub fn keep_good_copy(&mut self) {
        if let Some(translation) = &mut self.translation {
            translation.keep_good_copy();
        }
        if let Some(rotation) = &mut self.rotation {
            rotation.keep_good_copy();
        }
        self.good_attitude = self.fixed_attitude;
    }

    /// The state of the last good copy; `None` before the first.
    pub fn kept_state(&self) -> Option<RigidBodyState> {
        let translation = self.translation.as_ref().map(|t| t.kept_state());
        let rotation = self.rotation.as_ref().map(|r| r.kept_state());
        Some(RigidBodyState {
            // A channel without a copy is no answer; one that is not configured is.
            translation: translation.map_or(Some(None), |kept| kept.map(Some))?,
            rotation: rotation.map_or(Some(None), |kept| kept.map(Some))?,
            fixed_attitude: self.good_attitude,
        })
    }

    /// How many numbers the good copy of what was learned is.
    pub fn n_kept(&self) -> usize {
        self.translation().map_or(0, Law::n_kept) + self.rotation().map_or(0, Law::n_kept)
    }

    /// The numbers of the good copy from `from` on, as many as `into` has room for: translation, then rotation.
    pub fn read_kept(&self, from: usize, into: &mut [f64]) {
        let split = self.translation().map_or(0, Law::n_kept);
        let (first, second) = into.split_at_mut(split.saturating_sub(from).min(into.len()));
        if let Some(translation) = self.translation() {
            translation.read_kept(from, first);
        }
        if let Some(rotation) = self.rotation() {
            rotation.read_kept(from.saturating_sub(split), second);
        }
    }

    /// Takes what an observer of the same design has learned.
    ///
    /// # Panics
    /// With another count of numbers than [`RigidBodyObserver::n_kept`].
    pub fn put(&mut self, learned: &[f64]) {
        let (translation, rotation) = learned.split_at(self.translation().map_or(0, Law::n_kept));
        if let Some(timeline) = &mut self.translation {
            timeline.law.put(translation);
        }
        if let Some(timeline) = &mut self.rotation {
            timeline.law.put(rotation);
        }
    }

    /// Goes on from a state that an observer of the same design has kept, after [`RigidBodyObserver::put`]: the next
    /// step is the same to the bit.
    pub fn resume(&mut self, kept: &RigidBodyState) {
        if let (Some(timeline), Some(kept)) = (&mut self.translation, &kept.translation) {
            timeline.resume(kept);
        }
        if let (Some(timeline), Some(kept)) = (&mut self.rotation, &kept.rotation) {
            timeline.resume(kept);
        }
        self.fixed_attitude = kept.fixed_attitude;
    }

    /// Puts state and weights of the translation back to the last good copy, from which it coasts to now.
    pub fn restore_translation(&mut self) {
        if let Some(translation) = &mut self.translation {
            translation.restore_good_copy();
        }
    }

    /// Puts state and weights of the rotation back to the last good copy, from which it coasts to now.
    pub fn restore_rotation(&mut self) {
        if let Some(rotation) = &mut self.rotation {
            rotation.restore_good_copy();
        }
    }

    /// Forgets the translation's state, not what was learned: it starts again from the next velocity.
    pub fn restart_translation(&mut self) {
        if let Some(translation) = &mut self.translation {
            translation.restart();
        }
    }

    /// Forgets the rotation's state, not what was learned: it starts again from the next angular velocity.
    pub fn restart_rotation(&mut self) {
        if let Some(rotation) = &mut self.rotation {
            rotation.restart();
        }
    }

    /// Forgets all of the translation, in the good copy too.
    pub fn forget_translation(&mut self) {
        if let Some(translation) = &mut self.translation {
            translation.forget();
        }
    }

    /// Forgets all of the rotation, in the good copy too.
    pub fn forget_rotation(&mut self) {
        if let Some(rotation) = &mut self.rotation {
            rotation.forget();
        }
    }

    /// The translation's law, its space and weights.
    pub fn translation(&self) -> Option<&Law<3>> {
        self.translation.as_ref().map(|timeline| &timeline.law)
    }

    /// What the theorems claim for the translation.
    pub fn translation_certificate(&self) -> Option<&Certificate> {
        self.translation.as_ref()?.certificate.as_ref()
    }

    /// What the theorems claim for the rotation.
    pub fn rotation_certificate(&self) -> Option<&Certificate> {
        self.rotation.as_ref()?.certificate.as_ref()
    }

    /// The rotation's law, its space and weights.
    pub fn rotation(&self) -> Option<&Law<3>> {
        self.rotation.as_ref().map(|timeline| &timeline.law)
    }
}

fn timeline<K: Copy>(
    design: &ChannelDesign,
    known_force: KnownForce,
    initial_rate: Option<Vector3<f64>>,
    initial_pose: K,
) -> Result<Timeline<Body<K>, 3>, DesignError>
where
    Body<K>: crate::timeline::Plant<3, State = BodyState<K>>,
{
    let Channel { law, integrator } = Channel::new(design)?;
    let cover = sup_if_needed(&design.bounds, || law.function().space().sup_power_function());
    let certificate = Some(Certificate::with_cover(design, cover));
    let initial = BodyState { rate: initial_rate.unwrap_or_default(), pose: initial_pose };
    let body = Body::new(integrator, known_force, initial_rate);
    Ok(Timeline::new(law, body, certificate, (design.hold_s, design.coast_step_s), initial))
}

fn fix_hold_ns(gain_per_s: f64, hold_s: f64) -> Result<u64, DesignError> {
    for value in [gain_per_s, hold_s] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(DesignError::new(Parameter::Fix, value.to_string(), "a finite number ≥ 0"));
        }
    }
    Ok((hold_s * 1e9).round() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Centers, DeadZone, DeadZoneShape, DisturbanceBounds, Doubt, Kernel, LengthScale, Solver};
    use nalgebra::Matrix3;

    const PERIOD_NS: u64 = 5_000_000;
    const PERIOD_S: f64 = 0.005;
    const START_NS: u64 = 77_000_000_000;

    fn channel(inertia: Matrix3<f64>, adaptation_rate: f64) -> ChannelDesign {
        ChannelDesign {
            kernel: Kernel::SobolevMatern { dimension: 3, order: 3 },
            length_scale: LengthScale::Isotropic(2.0),
            centers: Centers::lattice([-2.0; 3], [2.0; 3], [3; 3]).unwrap(),
            nugget: 0.0,
            solver: Solver::Dense,
            inertia,
            gain_per_s: 10.0,
            adaptation_rate: Matrix3::identity() * adaptation_rate,
            dead_zone: DeadZone::new(DeadZoneShape::Saturated, 1e-3, 1e-3).unwrap(),
            bounds: DisturbanceBounds::default(),
            hold_s: 1.5 * PERIOD_S,
            coast_step_s: PERIOD_S,
        }
    }

    fn translation(known_force_n: [f64; 3]) -> TranslationDesign {
        TranslationDesign {
            channel: channel(Matrix3::identity() * 2.0, 100.0),
            known_force_n: known_force_n.into(),
            velocity_error_to_position: 0.0,
            position_fix_gain_per_s: 0.5,
            position_fix_hold_s: 10.0,
        }
    }

    fn rotation(gyroscopic_torque: GyroscopicTorque) -> RotationDesign {
        RotationDesign {
            channel: channel(Matrix3::from_diagonal(&Vector3::new(0.1, 0.2, 0.3)), 5.0),
            gyroscopic_torque,
            attitude_fix_gain_per_s: 2.0,
            attitude_fix_hold_s: 10.0,
        }
    }

    fn both() -> RigidBodyObserver {
        let rotation = rotation(GyroscopicTorque::Learned);
        RigidBodyObserver::new(Some(translation([0.0; 3])), Some(rotation), InitialState::default()).unwrap()
    }

    /// A stream with everything in it: three rates, body-frame velocities, fixes, jitter and an outage.
    fn varied_samples() -> Vec<Sample> {
        let mut samples = Vec::new();
        for j in 0..2000_u64 {
            let t = j as f64 * PERIOD_S;
            if (900..1000).contains(&j) {
                continue;
            }
            let every = |n: u64, vector: Vector3<f64>| j.is_multiple_of(n).then_some(vector);
            let v = Vector3::new(t.sin(), (0.7 * t).cos(), 0.3 * (2.0 * t).sin());
            samples.push(Sample {
                stamp_ns: START_NS + j * PERIOD_NS + (j * 7919 % 1000) * 500,
                velocity: every(2, v).map(if j < 500 { Velocity::Inertial } else { Velocity::Body }),
                angular_velocity_rad_s: Some(Vector3::new((2.0 * t).cos(), t.sin(), -0.5)),
                position_m: every(100, v),
                attitude: every(50, v).map(UnitQuaternion::new),
                force_n: every(3, -v),
                torque_n_m: every(1, 0.1 * v),
            });
        }
        samples
    }

    /// What was kept in the middle of a stream, written down and taken over by an observer with other gains of fixes and
    /// nothing learned, goes on to the same bits; learned numbers alone do not.
    #[test]
    fn another_observer_goes_on_from_a_kept_state_to_the_bit() {
        let samples = varied_samples();
        let mut observer = both();
        samples[..500].iter().for_each(|sample| observer.accept(sample));
        assert_eq!(observer.kept_state(), None);
        observer.keep_good_copy();
        let state = observer.kept_state().unwrap();
        assert_eq!(state.stamp_ns(), Some(samples[499].stamp_ns));
        let mut learned = vec![0.0; observer.n_kept()];
        learned.chunks_mut(37).enumerate().for_each(|(j, chunk)| observer.read_kept(37 * j, chunk));
        for with_state in [true, false] {
            let mut original = observer.clone();
            let mut other = both();
            other.put(&learned);
            if with_state {
                other.resume(&state);
            }
            let same = samples[500..].iter().all(|sample| {
                original.accept(sample);
                other.accept(sample);
                let later_ns = sample.stamp_ns + PERIOD_NS / 3;
                let texts =
                    [&mut original, &mut other].map(|observer| format!("{:?}", observer.estimate(later_ns)));
                texts[0] == texts[1]
            });
            assert_eq!(same, with_state);
        }
    }

    #[test]
    fn a_spike_is_held_back_as_configured() {
        let run = |outliers: Option<Doubt>, spike: f64| {
            let mut observer = both();
            if let Some(outliers) = outliers {
                observer.set_plausibility(Plausibility { outliers, factor: 8.0 });
            }
            let mut worst = 0.0_f64;
            for j in 0..1000_u64 {
                let v = Vector3::new(0.3 * (0.002 * j as f64).sin(), 0.0, 0.0);
                let error = if j == 700 { spike } else { 0.0 };
                let velocity = Some(Velocity::Inertial(v + Vector3::new(0.0, error, 0.0)));
                let stamp_ns = START_NS + j * PERIOD_NS;
                observer.accept(&Sample { stamp_ns, velocity, ..Sample::default() });
                if j >= 700 {
                    let estimate = observer.estimate(stamp_ns + PERIOD_NS);
                    worst = worst.max((estimate.velocity_m_s - v).norm());
                }
            }
            let norm = observer.estimate(START_NS + 5_000_000_000).translation.unwrap().native_norm;
            (worst, norm, observer.n_held_back())
        };
        let clean = run(None, 0.0);
        let believed = run(Some(Doubt::Off), 4.0);
        let corrected = run(Some(Doubt::Adaptation), 4.0);
        let held_back = run(Some(Doubt::Correction), 4.0);
        assert_eq!((believed.2, held_back.2), ([0, 0], [1, 0]));
        // As the spike moves the estimate, the next outputs stand out too.
        assert!((2..20).contains(&corrected.2[0]), "{corrected:?}");
        assert_eq!(run(Some(Doubt::Correction), 0.0).2, [0, 0]);
        assert!(held_back.0 < 1.1 * clean.0 + 1e-3, "{held_back:?} {clean:?}");
        // It corrects: by 1 − e^{−λh} of the spike.
        assert!(corrected.0 > 0.15 && believed.0 > 0.15, "{corrected:?} {believed:?}");
        assert!((held_back.1 - clean.1).abs() < 0.05 * clean.1 + 1e-3, "{held_back:?} {clean:?}");
        assert!(
            (believed.1 - clean.1).abs() > 5.0 * (corrected.1 - clean.1).abs(),
            "{believed:?} {corrected:?}"
        );
    }

    /// A stuck sensor corrects, and teaches nothing.
    #[test]
    fn what_does_not_teach_is_not_learned_from() {
        let mut observer = both();
        observer.set_teaching(false, true);
        varied_samples().iter().for_each(|sample| observer.accept(sample));
        let estimate = observer.estimate(START_NS);
        assert_eq!(estimate.translation.unwrap().native_norm, 0.0);
        assert!(estimate.rotation.unwrap().native_norm > 0.0);
        assert!(estimate.velocity_m_s.norm() > 0.0);
    }

    #[test]
    fn estimates_do_not_depend_on_who_asked_before() {
        let samples = varied_samples();
        let (mut asked, mut silent) = (both(), both());
        for (j, sample) in samples.iter().enumerate() {
            asked.accept(sample);
            silent.accept(sample);
            let next_ns = samples.get(j + 1).map_or(sample.stamp_ns + 500_000_000, |next| next.stamp_ns);
            // Many questions, also about times after samples that are yet to come late.
            for k in 0..(j % 7) as u64 {
                asked.estimate(sample.stamp_ns + k * 3_700_000 + (j as u64 * 13) % 1_000_000);
            }
            if j % 97 == 0 {
                asked.estimate(next_ns + 400_000_000);
            }
            if j % 11 == 0 {
                let at_ns = sample.stamp_ns + (next_ns - sample.stamp_ns) * 2 / 3;
                assert_eq!(asked.estimate(at_ns), silent.estimate(at_ns), "sample {j}");
            }
        }
        let last_ns = samples.last().unwrap().stamp_ns;
        assert_eq!(asked.estimate(last_ns + 333_000_000), silent.estimate(last_ns + 333_000_000));
        assert!(silent.estimate(last_ns).translation.unwrap().native_norm > 0.1);
    }

    /// Between samples the time line is the law's own step, with the true time between the stamps.
    #[test]
    fn the_time_line_steps_the_law_over_the_true_time() {
        let design = translation([0.0; 3]);
        let mut law = Channel::new(&design.channel).unwrap();
        let initial = InitialState { velocity_m_s: Some(Vector3::zeros()), ..InitialState::default() };
        let mut observer = RigidBodyObserver::new(Some(design), None, initial).unwrap();
        let (mut stamp_ns, mut v) = (START_NS, Vector3::zeros());
        for j in 0..500_u64 {
            let y = Vector3::new((j as f64 * 0.01).sin(), 0.5, -0.2);
            let u = Vector3::new(0.0, 1.0, j as f64 * 0.01);
            let velocity = Some(Velocity::Inertial(y));
            observer.accept(&Sample { stamp_ns, velocity, force_n: Some(u), ..Sample::default() });
            let h_ns = 3_000_000 + j % 5 * 1_000_000;
            v = law.step(&v, &y, &u, h_ns as f64 / 1e9);
            stamp_ns += h_ns;
            let estimate = observer.estimate(stamp_ns);
            assert_eq!(estimate.velocity_m_s, v, "sample {j}");
            assert!(!estimate.translation.unwrap().coasting);
        }
    }

    #[test]
    fn a_silent_sensor_means_coasting_from_the_end_of_the_hold() {
        let mut observer =
            RigidBodyObserver::new(Some(translation([0.0, 0.0, 19.62])), None, InitialState::default())
                .unwrap();
        let velocity = Some(Velocity::Inertial(Vector3::new(1.0, 0.0, 0.0)));
        let position_m = Some(Vector3::new(10.0, 20.0, 30.0));
        observer.accept(&Sample { stamp_ns: START_NS, velocity, position_m, ..Sample::default() });
        let hold_end_ns = START_NS + PERIOD_NS * 3 / 2;
        assert!(!observer.estimate(hold_end_ns).translation.unwrap().coasting);
        let start = observer.estimate(hold_end_ns);
        let estimate = observer.estimate(hold_end_ns + 2_000_000_000);
        // Nothing was learned, so it falls freely: 2 kg under 19.62 N for 2 s.
        let fall = Vector3::new(0.0, 0.0, 9.81 * 2.0);
        assert!((estimate.velocity_m_s - start.velocity_m_s - fall).norm() < 1e-9);
        let way = start.velocity_m_s * 2.0 + fall;
        assert!((estimate.position_m - start.position_m - way).norm() < 1e-9);
        let report = estimate.translation.unwrap();
        assert!(report.coasting && report.outside_centers && report.error_bound == f64::INFINITY);
        assert!((report.output_age_s - 2.0075).abs() < 1e-12);
    }

    /// v' = −v³/4: learned while measured, then used while nobody measures.
    #[test]
    fn what_was_learned_makes_coasting_better() {
        let coast_error = |frozen: bool| {
            let mut observer =
                RigidBodyObserver::new(Some(translation([0.0; 3])), None, InitialState::default()).unwrap();
            observer.set_frozen(frozen);
            let (mut v, mut stamp_ns) = (1.5_f64, START_NS);
            let push = |t: f64| 2.0 + (0.8 * t).sin();
            let mut advance = |t: f64| {
                for i in 0..10 {
                    v += PERIOD_S / 10.0 * (push(t + i as f64 * PERIOD_S / 10.0) - 0.5 * v.powi(3)) / 2.0;
                }
                v
            };
            for j in 0..8000 {
                let t = j as f64 * PERIOD_S;
                let velocity = Some(Velocity::Inertial(Vector3::new(advance(t), 0.0, 0.0)));
                let force_n = Some(Vector3::new(push(t + PERIOD_S), 0.0, 0.0));
                let velocity = if j < 7800 { velocity } else { None };
                stamp_ns += PERIOD_NS;
                observer.accept(&Sample { stamp_ns, velocity, force_n, ..Sample::default() });
            }
            (observer.estimate(stamp_ns).velocity_m_s.x - advance(8000.0 * PERIOD_S)).abs()
        };
        let (with, without) = (coast_error(false), coast_error(true));
        assert!(with < without / 4.0, "after 1 s without measurements: {with} with, {without} without");
    }

    #[test]
    fn a_constant_turn_is_integrated_exactly() {
        let mut observer =
            RigidBodyObserver::new(None, Some(rotation(GyroscopicTorque::Learned)), InitialState::default())
                .unwrap();
        let omega = Vector3::new(0.0, 0.0, 1.5);
        for j in 0..=2000 {
            let stamp_ns = START_NS + j * PERIOD_NS;
            observer.accept(&Sample { stamp_ns, angular_velocity_rad_s: Some(omega), ..Sample::default() });
        }
        let estimate = observer.estimate(START_NS + 2000 * PERIOD_NS);
        let expected = UnitQuaternion::new(omega * 10.0);
        assert!(estimate.attitude.angle_to(&expected) < 1e-10);
        assert!((estimate.attitude.coords.norm() - 1.0).abs() < 1e-14);
        let yaw = 15.0 - 4.0 * std::f64::consts::PI;
        assert!((estimate.euler_rad()[2] - yaw).abs() < 1e-9);
    }

    /// A torque-free body keeps its rates only if −ω × Iω is accounted for.
    #[test]
    fn the_gyroscopic_feedforward_coasts_a_torque_free_body() {
        let initial =
            InitialState { angular_velocity_rad_s: Some(Vector3::new(1.0, 0.2, -0.5)), ..Default::default() };
        let mut observer =
            RigidBodyObserver::new(None, Some(rotation(GyroscopicTorque::Feedforward)), initial).unwrap();
        let omega = initial.angular_velocity_rad_s.unwrap();
        observer.accept(&Sample {
            stamp_ns: START_NS,
            angular_velocity_rad_s: Some(omega),
            ..Sample::default()
        });
        let inertia = Vector3::new(0.1, 0.2, 0.3);
        // Euler's equations I ω' = −ω × Iω by RK4.
        let slope = |w: Vector3<f64>| -w.cross(&w.component_mul(&inertia)).component_div(&inertia);
        let (mut expected, h) = (omega, 1e-3);
        for _ in 0..1000 {
            let k1 = slope(expected);
            let k2 = slope(expected + 0.5 * h * k1);
            let k3 = slope(expected + 0.5 * h * k2);
            expected += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(expected + h * k3));
        }
        let estimate = observer.estimate(START_NS + 1_000_000_000);
        assert!((expected - omega).norm() > 0.1, "it tumbles");
        // Euler steps of 5 ms and more: right to first order in the step.
        let error = (estimate.angular_velocity_rad_s - expected).norm();
        assert!(error < 0.02, "{error}");
    }

    /// A held output, its pending update and the coast after it, against the law's own pieces.
    #[test]
    fn the_time_line_coasts_on_what_the_last_output_taught() {
        let design = translation([0.0; 3]);
        let mut law = Channel::new(&design.channel).unwrap();
        let initial = InitialState { velocity_m_s: Some(Vector3::zeros()), ..InitialState::default() };
        let mut observer = RigidBodyObserver::new(Some(design), None, initial).unwrap();
        let (y, u) = (Vector3::new(0.5, -0.4, 0.3), Vector3::new(0.1, 0.2, 0.3));
        let sample = Sample {
            stamp_ns: START_NS,
            velocity: Some(Velocity::Inertial(y)),
            force_n: Some(u),
            ..Sample::default()
        };
        observer.accept(&sample);

        let mut v = law.step(&Vector3::zeros(), &y, &u, 1.5 * PERIOD_S);
        for _ in 0..20 {
            let force = law.law.matched_force_at(&v, &crate::Learning::none()).value;
            v = law.integrator.coast(&v, &(u + force), PERIOD_S).end;
        }
        let end_ns = START_NS + PERIOD_NS * 3 / 2 + 20 * PERIOD_NS;
        assert!((observer.estimate(end_ns).velocity_m_s - v).norm() < 1e-12);
        assert!(law.law.native_norm() > 0.1);
        // The next sample commits just what was learned while the output was held.
        observer.accept(&Sample { stamp_ns: end_ns, ..sample });
        for (ours, theirs) in observer.translation().unwrap().weights().iter().zip(law.law.weights()) {
            assert!(ours.iter().zip(theirs).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }

    #[test]
    fn fixes_pull_position_and_attitude_exponentially() {
        let initial = InitialState {
            position_m: Some(Vector3::zeros()),
            velocity_m_s: Some(Vector3::zeros()),
            attitude: Some(UnitQuaternion::identity()),
            angular_velocity_rad_s: Some(Vector3::zeros()),
        };
        let turned = UnitQuaternion::new(Vector3::new(0.0, 0.3, 0.0));
        for sign in [1.0, -1.0] {
            let rotation = rotation(GyroscopicTorque::Learned);
            let mut observer =
                RigidBodyObserver::new(Some(translation([0.0; 3])), Some(rotation), initial).unwrap();
            let still = Sample {
                velocity: Some(Velocity::Inertial(Vector3::zeros())),
                angular_velocity_rad_s: Some(Vector3::zeros()),
                ..Sample::default()
            };
            let attitude = Some(UnitQuaternion::new_unchecked(turned.into_inner() * sign));
            let position_m = Some(Vector3::new(8.0, 0.0, 0.0));
            observer.accept(&Sample { stamp_ns: START_NS, attitude, position_m, ..still });
            for j in 1..=200 {
                observer.accept(&Sample { stamp_ns: START_NS + j * PERIOD_NS, ..still });
            }
            let estimate = observer.estimate(START_NS + 200 * PERIOD_NS);
            assert!((estimate.position_m.x - 8.0 * (1.0 - (-0.5_f64).exp())).abs() < 1e-9);
            assert!((estimate.attitude.angle_to(&turned) - 0.3 * (-2.0_f64).exp()).abs() < 1e-9);
        }
    }

    #[test]
    fn a_body_velocity_is_turned_into_the_inertial_frame() {
        let quarter = UnitQuaternion::new(Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
        for rotation in [Some(rotation(GyroscopicTorque::Learned)), None] {
            let mut observer =
                RigidBodyObserver::new(Some(translation([0.0; 3])), rotation, InitialState::default())
                    .unwrap();
            observer.accept(&Sample {
                stamp_ns: START_NS,
                velocity: Some(Velocity::Body(Vector3::new(2.0, 0.0, 0.0))),
                angular_velocity_rad_s: Some(Vector3::zeros()),
                attitude: Some(quarter),
                ..Sample::default()
            });
            let velocity = observer.estimate(START_NS).velocity_m_s;
            assert!((velocity - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-12);
        }
    }

    #[test]
    fn a_body_velocity_waits_for_an_attitude() {
        let mut observer = both();
        let sample = Sample {
            stamp_ns: START_NS,
            velocity: Some(Velocity::Body(Vector3::new(2.0, 0.0, 0.0))),
            angular_velocity_rad_s: Some(Vector3::zeros()),
            ..Sample::default()
        };
        observer.accept(&sample);
        let before = observer.estimate(START_NS);
        assert!(before.translation.unwrap().coasting && before.velocity_m_s == Vector3::zeros());
        let turned = Some(UnitQuaternion::new(Vector3::new(0.0, 0.0, std::f64::consts::PI)));
        observer.accept(&Sample { stamp_ns: START_NS + PERIOD_NS, attitude: turned, ..sample });
        let after = observer.estimate(START_NS + PERIOD_NS);
        assert!((after.velocity_m_s - Vector3::new(-2.0, 0.0, 0.0)).norm() < 1e-12);
    }

    /// Ten hours of silence, asked about now and then: bounded work, and a sample still goes on from there.
    #[test]
    fn a_long_silence_costs_little() {
        let samples = varied_samples();
        let mut observer = both();
        samples[..500].iter().for_each(|sample| observer.accept(sample));
        let last_ns = samples[499].stamp_ns;
        let end_ns = last_ns + 36_000 * 1_000_000_000;
        // 0.25 s a step: some 144 000 evaluations in all, not 7 200 000.
        assert!(observer.estimate(end_ns).translation.unwrap().coasting);
        // Asking half a second back finds a point of the trail.
        let late = observer.estimate(end_ns - 400_000_000);
        assert_eq!(late, observer.clone().estimate(end_ns - 400_000_000));
    }

    #[test]
    fn a_restarted_observer_keeps_what_it_learned_and_takes_earlier_stamps() {
        let samples = varied_samples();
        let mut observer = both();
        samples.iter().for_each(|sample| observer.accept(sample));
        let learned = observer.translation().unwrap().weights().to_vec();
        observer.restart();
        observer.accept(&samples[0]);
        assert_eq!(observer.translation().unwrap().weights(), learned);
        let estimate = observer.estimate(samples[0].stamp_ns);
        assert_eq!(Some(Velocity::Inertial(estimate.velocity_m_s)), samples[0].velocity);
    }

    #[test]
    fn a_reset_observer_is_a_new_one() {
        let samples = varied_samples();
        let mut used = both();
        samples.iter().for_each(|sample| used.accept(sample));
        used.reset();
        let mut new = both();
        for sample in &samples[..300] {
            used.accept(sample);
            new.accept(sample);
        }
        assert_eq!(used.estimate(samples[299].stamp_ns), new.estimate(samples[299].stamp_ns));
    }

    #[test]
    fn a_poisoned_state_comes_back_to_the_good_copy() {
        let samples = varied_samples();
        let mut observer = both();
        samples[..800].iter().for_each(|sample| observer.accept(sample));
        observer.keep_good_copy();
        let good = observer.estimate(samples[799].stamp_ns);
        // What the gate would never let through.
        let poison = Vector3::new(f64::NAN, 0.0, 0.0);
        let stamp_ns = samples[800].stamp_ns;
        let velocity = Some(Velocity::Inertial(poison));
        let angular_velocity_rad_s = Some(poison);
        observer.accept(&Sample { stamp_ns, velocity, angular_velocity_rad_s, ..Sample::default() });
        observer.accept(&samples[801]);
        assert!(observer.estimate(samples[801].stamp_ns).velocity_m_s.x.is_nan());
        observer.restore_translation();
        observer.restore_rotation();
        let restored = observer.estimate(samples[801].stamp_ns);
        // Coasted from the good copy for two samples.
        assert!((restored.velocity_m_s - good.velocity_m_s).norm() < 0.1);
        assert_eq!(restored.translation.unwrap().native_norm, good.translation.unwrap().native_norm);
        observer.accept(&samples[802]);
        assert!(observer.estimate(samples[802].stamp_ns).velocity_m_s.norm().is_finite());
    }

    #[test]
    fn before_the_first_output_there_is_the_initial_state() {
        let position = Vector3::new(1.0, 2.0, 3.0);
        let mut observer = both();
        assert!(observer.estimate(START_NS).translation.unwrap().coasting);
        observer.accept(&Sample { stamp_ns: START_NS, position_m: Some(position), ..Sample::default() });
        let estimate = observer.estimate(START_NS + 5_000_000_000);
        assert_eq!(estimate.position_m, position);
        assert_eq!(estimate.translation.unwrap().output_age_s, f64::INFINITY);
        assert!(RigidBodyObserver::new(None, None, InitialState::default()).is_err());
    }
}
