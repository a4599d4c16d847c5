//! The observer of a rigid body: a translation channel and a rotation channel, with position and attitude.

use crate::channels::{AnyChannel, ChannelName, Learn};
use crate::design::{ChannelDesign, GyroscopicTorque, RotationDesign, TranslationDesign};
use crate::error::{DesignError, Parameter};
use crate::law::channel::Channel;
use crate::law::gradient::GradientLaw;
use crate::plant::attitude::Attitude;
use crate::plant::body::{Body, Kinematics, KnownForce};
use crate::plant::position::Position;
use crate::report::certificate::{Certificate, sup_if_needed};
use crate::timeline::{ChannelReport, Measured, Timeline};
use nalgebra::{UnitQuaternion, Vector3};

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

/// The adaptive observer of a rigid body (Niu et al., §VI-A, §VI-B).
///
/// Samples go in with their stamps; estimates come out for any
/// instant not before the newest sample.
///
/// The same samples give the same estimates to the bit, whenever and however often estimates are requested.
#[derive(Debug, Clone)]
pub struct RigidBodyObserver {
    translation: Option<Timeline<Body<Position>, 3>>,
    rotation: Option<Timeline<Body<Attitude>, 3>>,
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
    /// As [`crate::BodyChannel::new`]; `Fix` where a fix's gain or hold is negative or not finite; `Channels` where
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
            position_fix_hold_ns,
            attitude_fix_hold_ns,
        })
    }

    /// Takes one sample: each channel moves to its stamp, learns, and holds the sample's values. Returns which outputs were
    /// outliers ([`crate::InnovationGate`]), by channel.
    ///
    /// # Cost
    /// One evaluation of the features per channel with a new output; no allocation.
    pub fn accept(&mut self, sample: &Sample, learn: Learn) -> [bool; 3] {
        let Learn { frozen, teaches } = learn;
        let stamp_ns = sample.stamp_ns;
        let mut outliers = [false; 3];
        let attitude_until_ns = stamp_ns.saturating_add(self.attitude_fix_hold_ns);
        if let Some(rotation) = &mut self.rotation {
            let teaches = teaches[ChannelName::Rotation as usize];
            let measured = sample.angular_velocity_rad_s.map(|output| Measured { output, teaches });
            outliers[ChannelName::Rotation as usize] =
                rotation.accept(stamp_ns, measured, sample.torque_n_m, frozen, |state| {
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
                // Without an attitude its direction is unknown: it is not used.
                Some(Velocity::Body(velocity)) => attitude.map(|attitude| attitude * velocity),
                None => None,
            };
            let teaches = teaches[ChannelName::Translation as usize];
            let measured = velocity.map(|output| Measured { output, teaches });
            outliers[ChannelName::Translation as usize] =
                translation.accept(stamp_ns, measured, sample.force_n, frozen, |state| {
                    if let Some(fix) = &sample.position_m {
                        state.pose.take_fix(fix, position_until_ns);
                    }
                });
        }
        outliers
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
            deviations: Deviations::UNKNOWN,
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
            ChannelName::Translation => self.translation.as_ref().map(|channel| channel as &dyn AnyChannel),
            ChannelName::Rotation => self.rotation.as_ref().map(|channel| channel as &dyn AnyChannel),
            ChannelName::Linear => None,
        }
    }

    /// A channel, if it is there.
    pub fn channel_mut(&mut self, name: ChannelName) -> Option<&mut dyn AnyChannel> {
        match name {
            ChannelName::Translation => {
                self.translation.as_mut().map(|channel| channel as &mut dyn AnyChannel)
            }
            ChannelName::Rotation => self.rotation.as_mut().map(|channel| channel as &mut dyn AnyChannel),
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

    /// The translation's law and f̂.
    pub fn translation(&self) -> Option<&GradientLaw<3>> {
        self.translation.as_ref().map(|timeline| timeline.channel().law())
    }

    /// The rotation's law and f̂.
    pub fn rotation(&self) -> Option<&GradientLaw<3>> {
        self.rotation.as_ref().map(|timeline| timeline.channel().law())
    }
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
