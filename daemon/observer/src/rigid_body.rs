//! The observer of a rigid body: a translation channel and a rotation channel, with position and attitude.

use crate::channels::{AnyChannel, ChannelName, Learn};
use crate::design::{ChannelDesign, GyroscopicTorque, RotationDesign, TranslationDesign};
use crate::error::{DesignError, Parameter};
use crate::joint_channel::{
    JointChannel, JointRotationDesign, JointSample, JointTranslationDesign, or_designed,
};
use crate::law::channel::Channel;
use crate::law::gradient::GradientLaw;
use crate::law::joint::sensor::SensorUse;
use crate::law::joint::teaches::Teaches;
use crate::plant::attitude::Attitude;
use crate::plant::attitude_filter::{AttitudeFilter, JointPose};
use crate::plant::body::{Body, Kinematics, KnownForce};
use crate::plant::position::Position;
use crate::report::certificate::{Certificate, sup_if_needed};
use crate::timeline::{ChannelReport, Measured, Timeline};
use nalgebra::{UnitQuaternion, Vector3};

mod inertial;
mod partial;

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
    /// Specific force, of an accelerometer, body axes (m/s²). Used by a joint law with an accelerometer.
    pub specific_force_m_s2: Option<Vector3<f64>>,
    /// Commanded force (N); held until the next one.
    pub force_n: Option<Vector3<f64>>,
    /// Whether `force_n` is along the body axes: it is turned by q̂; else inertial.
    pub force_is_body: bool,
    /// Commanded torque, body axes (N·m); held until the next one.
    pub torque_n_m: Option<Vector3<f64>>,
    /// Of the velocity, along its own axes (m/s). The gradient law takes no part of a velocity.
    pub velocity_quality: Quality,
    /// Of the angular velocity (rad/s). The gradient law takes no part of one.
    pub angular_velocity_quality: Quality,
    /// Of the position fix (m). The gradient law takes no part of one.
    pub position_quality: Quality,
    /// 1 σ of the attitude fix's rotation vector (rad); 0: as designed.
    pub attitude_std_rad: [f64; 3],
    /// 1 σ of the specific force (m/s²); 0: as designed.
    pub specific_force_std_m_s2: [f64; 3],
    /// Where the sensor sits, from the center of mass, body axes (m): its velocity and position become those of the center.
    pub lever_arm_m: Vector3<f64>,
    /// Which sensor it is.
    pub sensor: SensorUse,
}

/// How well the components of a reading are known.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Quality {
    /// 1 σ of each; 0: as designed.
    pub std: [f64; 3],
    /// Which of them were not measured.
    pub missing: [bool; 3],
    /// Whether the reading is to the bit what its sensor said before, and must not be believed without need. The gradient law,
    /// which has no deviations, does not look at it.
    pub repeats: bool,
}

impl Quality {
    /// The components that were measured.
    fn components(&self, value: Option<Vector3<f64>>) -> [Option<f64>; 3] {
        std::array::from_fn(|axis| value.map(|value| value[axis]).filter(|_| !self.missing[axis]))
    }

    /// The reading if all of it was measured.
    fn whole<T>(&self, value: Option<T>) -> Option<T> {
        value.filter(|_| self.missing == [false; 3])
    }
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
    /// 1 σ of all of these.
    pub deviations: Deviations,
    /// Trust in the translation, if there is one.
    pub translation: Option<ChannelReport>,
    /// Trust in the rotation, if there is one.
    pub rotation: Option<ChannelReport>,
}

/// 1 σ of each component of an estimate; +∞ where it is not known: with the gradient law, and before the first output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviations {
    /// Of the position, inertial axes (m).
    pub position_m: [f64; 3],
    /// Of the velocity, inertial axes (m/s).
    pub velocity_m_s: [f64; 3],
    /// Of the rotation vector of the attitude's error, body axes (rad).
    pub attitude_rad: [f64; 3],
    /// Of the angular velocity, body axes (rad/s).
    pub angular_velocity_rad_s: [f64; 3],
    /// Of the unknown force, inertial axes (N).
    pub matched_force_n: [f64; 3],
    /// Of the unknown torque, body axes (N·m).
    pub matched_torque_n_m: [f64; 3],
}

impl Deviations {
    /// Nothing is known of the errors.
    pub const UNKNOWN: Self = Self {
        position_m: [f64::INFINITY; 3],
        velocity_m_s: [f64::INFINITY; 3],
        attitude_rad: [f64::INFINITY; 3],
        angular_velocity_rad_s: [f64::INFINITY; 3],
        matched_force_n: [f64::INFINITY; 3],
        matched_torque_n_m: [f64::INFINITY; 3],
    };
}

impl RigidBodyEstimate {
    /// 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π].
    pub fn euler_rad(&self) -> [f64; 3] {
        let (roll, pitch, yaw) = self.attitude.euler_angles();
        [roll, pitch, yaw]
    }
}

/// The design of a translation, with its law.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // there is one of it
pub enum TranslationLaw {
    /// The paper's.
    Gradient(TranslationDesign),
    /// The joint filter.
    Joint(JointTranslationDesign),
}

/// The design of a rotation, with its law.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant)] // there is one of it
pub enum RotationLaw {
    /// The paper's.
    Gradient(RotationDesign),
    /// The joint filter.
    Joint(JointRotationDesign),
}

impl From<TranslationDesign> for TranslationLaw {
    fn from(design: TranslationDesign) -> Self {
        Self::Gradient(design)
    }
}

impl From<RotationDesign> for RotationLaw {
    fn from(design: RotationDesign) -> Self {
        Self::Gradient(design)
    }
}

/// A channel with one of the laws: `G` the pose of the gradient law, `K` that of the joint one.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // there are two of it
enum LawChannel<G: Kinematics, K> {
    Gradient(Timeline<Body<G>, 3>),
    Joint(JointChannel<K>),
}

type TranslationChannel = LawChannel<Position, ()>;
type RotationChannel = LawChannel<Attitude, AttitudeFilter>;

impl<G: Kinematics, K: JointPose> LawChannel<G, K>
where
    Timeline<Body<G>, 3>: AnyChannel,
    JointChannel<K>: AnyChannel,
{
    fn any(&self) -> &dyn AnyChannel {
        match self {
            Self::Gradient(channel) => channel,
            Self::Joint(channel) => channel,
        }
    }

    fn any_mut(&mut self) -> &mut dyn AnyChannel {
        match self {
            Self::Gradient(channel) => channel,
            Self::Joint(channel) => channel,
        }
    }

    fn gradient(&self) -> Option<&GradientLaw<3>> {
        match self {
            Self::Gradient(channel) => Some(channel.channel().law()),
            Self::Joint(_) => None,
        }
    }

    fn joint(&self) -> Option<&JointChannel<K>> {
        match self {
            Self::Gradient(_) => None,
            Self::Joint(channel) => Some(channel),
        }
    }
}

/// The observer of a rigid body (Niu et al., §VI-A, §VI-B), with the paper's law or the joint filter.
///
/// Samples go in with their stamps; estimates come out for any
/// instant not before the newest sample.
///
/// The same samples give the same estimates to the bit, whenever and however often estimates are requested.
#[derive(Debug, Clone)]
pub struct RigidBodyObserver {
    translation: Option<TranslationChannel>,
    rotation: Option<RotationChannel>,
    /// Deviation of an attitude fix (rad).
    attitude_noise_rad: f64,
    initial_attitude: Option<UnitQuaternion<f64>>,
    position_fix_hold_ns: u64,
    attitude_fix_hold_ns: u64,
    /// Attitude of a body without a rotation channel: the newest fix.
    fixed_attitude: Option<UnitQuaternion<f64>>,
}

impl RigidBodyObserver {
    /// Builds the channels. Everything is allocated here.
    ///
    /// # Errors
    /// As [`crate::BodyChannel::new`] and [`JointChannel::translation`]; `Fix` where a fix's gain or hold is negative or not
    /// finite; `Channels` where there is none.
    pub fn new(
        translation: Option<TranslationLaw>,
        rotation: Option<RotationLaw>,
        initial: InitialState,
    ) -> Result<Self, DesignError> {
        if translation.is_none() && rotation.is_none() {
            let needed = "a translation, a rotation, or both";
            return Err(DesignError::new(Parameter::Channels, "neither".into(), needed));
        }
        let mut position_fix_hold_ns = 0;
        let translation = translation.map(|law| match law {
            TranslationLaw::Gradient(design) => {
                position_fix_hold_ns =
                    fix_hold_ns(design.position_fix_gain_per_s, design.position_fix_hold_s)?;
                let l_r = design.velocity_error_to_position;
                if !l_r.is_finite() {
                    return Err(DesignError::new(Parameter::Fix, l_r.to_string(), "a finite number"));
                }
                let position = Position::new(initial.position_m, l_r, design.position_fix_gain_per_s);
                let known_force = KnownForce::Constant(design.known_force_n);
                timeline(&design.channel, known_force, initial.velocity_m_s, position)
                    .map(LawChannel::Gradient)
            }
            TranslationLaw::Joint(design) => {
                JointChannel::translation(&design, initial.velocity_m_s, initial.position_m)
                    .map(LawChannel::Joint)
            }
        });
        let (mut attitude_fix_hold_ns, mut attitude_noise_rad) = (0, 0.0);
        let rotation = rotation.map(|law| match law {
            RotationLaw::Gradient(design) => {
                attitude_fix_hold_ns =
                    fix_hold_ns(design.attitude_fix_gain_per_s, design.attitude_fix_hold_s)?;
                let attitude = Attitude::new(initial.attitude, design.attitude_fix_gain_per_s);
                let known_force = match design.gyroscopic_torque {
                    GyroscopicTorque::Learned => KnownForce::Constant(Vector3::zeros()),
                    GyroscopicTorque::Feedforward => KnownForce::Gyroscopic(design.channel.inertia),
                };
                timeline(&design.channel, known_force, initial.angular_velocity_rad_s, attitude)
                    .map(LawChannel::Gradient)
            }
            RotationLaw::Joint(design) => {
                attitude_noise_rad = design.attitude_noise_rad;
                JointChannel::rotation(&design, initial.angular_velocity_rad_s, initial.attitude)
                    .map(LawChannel::Joint)
            }
        });
        let (translation, rotation) = (translation.transpose()?, rotation.transpose()?);
        Ok(Self {
            translation,
            rotation,
            attitude_noise_rad,
            fixed_attitude: initial.attitude,
            initial_attitude: initial.attitude,
            position_fix_hold_ns,
            attitude_fix_hold_ns,
        })
    }

    /// Takes one sample: each channel moves to its stamp, learns, and holds the sample's values. Returns which outputs were
    /// outliers ([`crate::InnovationGate`], or of the joint law), by channel.
    ///
    /// # Cost
    /// One evaluation of the features per channel with a new output; no allocation.
    pub fn accept(&mut self, sample: &Sample, learn: Learn) -> [bool; 3] {
        let mut outliers = [false; 3];
        outliers[ChannelName::Rotation as usize] = self.accept_rotation(sample, learn);
        self.fixed_attitude = sample.attitude.or(self.fixed_attitude);
        outliers[ChannelName::Translation as usize] = self.accept_translation(sample, learn);
        outliers
    }

    fn accept_rotation(&mut self, sample: &Sample, Learn { frozen, teaches }: Learn) -> bool {
        let teaches = teaches[ChannelName::Rotation as usize];
        match &mut self.rotation {
            None => false,
            Some(LawChannel::Gradient(rotation)) => {
                let output = sample.angular_velocity_quality.whole(sample.angular_velocity_rad_s);
                let measured = output.map(|output| Measured { output, teaches });
                let until_ns = sample.stamp_ns.saturating_add(self.attitude_fix_hold_ns);
                rotation.accept(sample.stamp_ns, measured, sample.torque_n_m, frozen, |state| {
                    if let Some(fix) = &sample.attitude {
                        state.pose.take_fix(fix, until_ns);
                    }
                })
            }
            Some(LawChannel::Joint(rotation)) => {
                let joint = JointSample {
                    output: sample.angular_velocity_quality.components(sample.angular_velocity_rad_s),
                    output_std: sample.angular_velocity_quality.std,
                    repeats: sample.angular_velocity_quality.repeats,
                    command: sample.torque_n_m,
                    sensor: sample.sensor,
                    ..JointSample::default()
                };
                let std_rad = or_designed(&sample.attitude_std_rad, &[self.attitude_noise_rad; 3]);
                let take_fix =
                    sample.attitude.map(|fix| move |pose: &mut AttitudeFilter| pose.take_fix(&fix, &std_rad));
                let agreement =
                    rotation.accept(sample.stamp_ns, &joint, what_teaches(teaches, frozen), take_fix);
                agreement.is_some_and(|agreement| agreement.is_stray)
            }
        }
    }

    fn accept_translation(&mut self, sample: &Sample, Learn { frozen, teaches }: Learn) -> bool {
        let teaches = teaches[ChannelName::Translation as usize];
        let inertial = self.inertial(sample);
        match &mut self.translation {
            None => false,
            Some(LawChannel::Gradient(translation)) => {
                let output = sample.velocity_quality.whole(inertial.velocity);
                let measured = output.map(|output| Measured { output, teaches });
                let position = sample.position_quality.whole(inertial.position);
                let until_ns = sample.stamp_ns.saturating_add(self.position_fix_hold_ns);
                translation.accept(sample.stamp_ns, measured, inertial.force, frozen, |state| {
                    if let Some(fix) = &position {
                        state.pose.take_fix(fix, until_ns);
                    }
                })
            }
            Some(LawChannel::Joint(translation)) => {
                let design = translation.filter().design();
                let output_std = or_designed(&sample.velocity_quality.std, &design.noise);
                let position_std = sample.position_quality.std;
                let joint = JointSample {
                    output: match inertial.part {
                        Some(part) => part.map(|told| told.map(|(velocity, _)| velocity)),
                        None => sample.velocity_quality.components(inertial.velocity),
                    },
                    output_std: match (inertial.part, sample.velocity) {
                        (Some(part), _) => part.map(|told| told.map_or(0.0, |(_, std)| std)),
                        // Body axes couple the inertial ones, which separate covariances cannot hold: the largest deviation.
                        (None, Some(Velocity::Body(_))) => {
                            [output_std.into_iter().fold(0.0, f64::max).hypot(inertial.velocity_std); 3]
                        }
                        _ if inertial.velocity_std > 0.0 => {
                            output_std.map(|std| std.hypot(inertial.velocity_std))
                        }
                        _ => output_std,
                    },
                    repeats: sample.velocity_quality.repeats,
                    position: sample.position_quality.components(inertial.position),
                    position_std: match design.position_noise {
                        Some(noise) if inertial.position_std > 0.0 => or_designed(&position_std, &[noise; 3])
                            .map(|std| std.hypot(inertial.position_std)),
                        _ => position_std,
                    },
                    command: inertial.force,
                    specific_force: inertial.specific_force,
                    sensor: SensorUse { is_bounded: inertial.part.is_some(), ..sample.sensor },
                    turning: inertial.turning,
                };
                let agreement = translation.accept(
                    sample.stamp_ns,
                    &joint,
                    what_teaches(teaches, frozen),
                    None::<fn(&mut ())>,
                );
                agreement.is_some_and(|agreement| agreement.is_stray)
            }
        }
    }

    /// The estimate at `stamp_ns`, or at the newest sample where that is later.
    ///
    /// # Cost
    /// Gradient law: constant while outputs are held; one evaluation of the features per channel and coasting step
    /// otherwise. Joint law: [`JointChannel::estimate`]. No allocation.
    pub fn estimate(&mut self, stamp_ns: u64) -> RigidBodyEstimate {
        let mut estimate = RigidBodyEstimate {
            stamp_ns,
            position_m: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            attitude: self.fixed_attitude.unwrap_or_default(),
            angular_velocity_rad_s: Vector3::zeros(),
            matched_force_n: Vector3::zeros(),
            matched_torque_n_m: Vector3::zeros(),
            deviations: Deviations::UNKNOWN,
            translation: None,
            rotation: None,
        };
        match &mut self.translation {
            None => {}
            Some(LawChannel::Gradient(timeline)) => {
                let at = timeline.predict(stamp_ns);
                estimate.translation = Some(timeline.report(&at, stamp_ns));
                estimate.position_m = at.moment.state.pose.position;
                estimate.velocity_m_s = at.moment.state.rate;
                estimate.matched_force_n = at.matched_force.value;
            }
            Some(LawChannel::Joint(channel)) => {
                let at = channel.estimate(stamp_ns);
                estimate.translation = Some(at.report);
                estimate.position_m = at.prediction.position.into();
                estimate.velocity_m_s = at.prediction.velocity.into();
                estimate.matched_force_n = at.matched_force;
                if at.is_started {
                    estimate.deviations.position_m = at.prediction.position_std;
                    estimate.deviations.velocity_m_s = at.prediction.velocity_std;
                    estimate.deviations.matched_force_n = at.matched_force_std;
                }
            }
        }
        match &mut self.rotation {
            None => {}
            Some(LawChannel::Gradient(timeline)) => {
                let at = timeline.predict(stamp_ns);
                estimate.rotation = Some(timeline.report(&at, stamp_ns));
                estimate.attitude = at.moment.state.pose.attitude;
                estimate.angular_velocity_rad_s = at.moment.state.rate;
                estimate.matched_torque_n_m = at.matched_force.value;
            }
            Some(LawChannel::Joint(channel)) => {
                let at = channel.estimate(stamp_ns);
                estimate.rotation = Some(at.report);
                estimate.attitude = at.pose.attitude;
                estimate.angular_velocity_rad_s = at.prediction.velocity.into();
                estimate.matched_torque_n_m = at.matched_force;
                if at.pose.is_known() {
                    estimate.deviations.attitude_rad = at.pose.std_rad();
                }
                if at.is_started {
                    estimate.deviations.angular_velocity_rad_s = at.prediction.velocity_std;
                    estimate.deviations.matched_torque_n_m = at.matched_force_std;
                }
            }
        }
        estimate
    }

    /// Forgets everything; starts again from the next sample.
    pub fn reset(&mut self) {
        for channel in ChannelName::ALL {
            if let Some(channel) = self.channel_mut(channel) {
                channel.forget();
            }
        }
        self.fixed_attitude = self.initial_attitude;
    }

    /// Forgets the state, not what was learned: starts again from the next sample, with any stamp.
    pub fn restart(&mut self) {
        for channel in ChannelName::ALL {
            if let Some(channel) = self.channel_mut(channel) {
                channel.restart();
            }
        }
        self.fixed_attitude = self.initial_attitude;
    }

    /// A channel, if it is there.
    pub fn channel(&self, name: ChannelName) -> Option<&dyn AnyChannel> {
        match name {
            ChannelName::Translation => self.translation.as_ref().map(LawChannel::any),
            ChannelName::Rotation => self.rotation.as_ref().map(LawChannel::any),
            ChannelName::Linear => None,
        }
    }

    /// A channel, if it is there.
    pub fn channel_mut(&mut self, name: ChannelName) -> Option<&mut dyn AnyChannel> {
        match name {
            ChannelName::Translation => self.translation.as_mut().map(LawChannel::any_mut),
            ChannelName::Rotation => self.rotation.as_mut().map(LawChannel::any_mut),
            ChannelName::Linear => None,
        }
    }

    /// The newest attitude fix, or the initial attitude: the attitude of a body without a rotation channel.
    pub fn fixed_attitude(&self) -> Option<UnitQuaternion<f64>> {
        self.fixed_attitude
    }

    /// Continues with the attitude of another observer's checkpoint.
    pub fn set_fixed_attitude(&mut self, attitude: Option<UnitQuaternion<f64>>) {
        self.fixed_attitude = attitude;
    }

    /// The translation's gradient law and f̂, if it has that law.
    pub fn translation(&self) -> Option<&GradientLaw<3>> {
        self.translation.as_ref().and_then(LawChannel::gradient)
    }

    /// The rotation's gradient law and f̂, if it has that law.
    pub fn rotation(&self) -> Option<&GradientLaw<3>> {
        self.rotation.as_ref().and_then(LawChannel::gradient)
    }

    /// The translation with the joint law, if it has that law.
    pub fn joint_translation(&self) -> Option<&JointChannel<()>> {
        self.translation.as_ref().and_then(LawChannel::joint)
    }

    /// The rotation with the joint law, if it has that law.
    pub fn joint_rotation(&self) -> Option<&JointChannel<AttitudeFilter>> {
        self.rotation.as_ref().and_then(LawChannel::joint)
    }
}

fn what_teaches(teaches: bool, frozen: bool) -> Teaches {
    if teaches && !frozen { Teaches::All } else { Teaches::State }
}

fn timeline<K: Kinematics>(
    design: &ChannelDesign,
    known_force: KnownForce,
    initial_rate: Option<Vector3<f64>>,
    initial_pose: K,
) -> Result<Timeline<Body<K>, 3>, DesignError> {
    let channel = Channel::of_body(design, known_force, initial_rate, initial_pose)?;
    let cover = sup_if_needed(&design.bounds, || channel.law().function().space().sup_power_function());
    let certificate = Some(Certificate::with_cover(design, cover));
    Ok(Timeline::new(channel, certificate, (design.hold_s, design.coast_step_s)))
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
mod tests;
