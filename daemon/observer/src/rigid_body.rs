//! The rigid body: a translation channel and a rotation channel, with position and attitude.

use crate::attitude::Attitude;
use crate::position::Position;
use crate::timeline::{Kinematics, KnownForce, Moment, Prediction, Timeline, seconds};
use crate::{Channel, ChannelDesign, DesignError, Parameter};
use nalgebra::{UnitQuaternion, Vector3};

/// The translation channel: y = v (inertial), M = m I₃, u the commanded force.
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

/// The rotation channel: y = ω (body), M the inertia matrix, u the commanded torque.
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

/// Who accounts for the gyroscopic torque −ω × Iω.
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

/// How far one channel can be trusted at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelReport {
    /// ‖ỹ‖ at the held sample; 0 while coasting.
    pub output_error: f64,
    /// σ as used; 0 while coasting.
    pub activation: f64,
    /// P_N / √κ(0) at the held or predicted output, 0 … 1.
    pub power_function: f64,
    /// ‖f̂_N‖ of the committed weights.
    pub native_norm: f64,
    /// max(d, E₀), a bound and not a covariance; +∞ while coasting.
    pub error_bound: f64,
    /// Time since the newest output's stamp (s); +∞ before the first.
    pub output_age_s: f64,
    /// No output is held: prediction only.
    pub coasting: bool,
    /// σ was held down to keep the sampled law stable.
    pub clamped: bool,
    /// The held or predicted output lies outside of the box of the centers.
    pub outside_centers: bool,
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

/// The adaptive observer of a rigid body. Samples go in with their stamps; estimates come out for any
/// instant not before the newest sample.
///
/// The same samples give the same estimates to the bit, whenever and however often estimates are asked for.
#[derive(Debug, Clone)]
pub struct RigidBodyObserver {
    translation: Option<Timeline<Position>>,
    rotation: Option<Timeline<Attitude>>,
    initial_attitude: UnitQuaternion<f64>,
    position_fix_hold_ns: u64,
    attitude_fix_hold_ns: u64,
    /// Attitude of a body without a rotation channel: the newest fix.
    fixed_attitude: UnitQuaternion<f64>,
    good_translation: Option<GoodCopy<Position>>,
    good_rotation: Option<GoodCopy<Attitude>>,
}

/// The last state and weights of a channel that were known to be good.
#[derive(Debug, Clone)]
struct GoodCopy<K> {
    moment: Option<Moment<K>>,
    weights: [Vec<f64>; 3],
}

impl<K: Kinematics> GoodCopy<K> {
    fn of(timeline: &Timeline<K>) -> Self {
        Self { moment: timeline.committed(), weights: timeline.channel.weights().clone() }
    }

    fn keep(&mut self, timeline: &Timeline<K>) {
        self.moment = timeline.committed();
        for (kept, theta) in self.weights.iter_mut().zip(timeline.channel.weights()) {
            kept.copy_from_slice(theta);
        }
    }

    fn restore(&self, timeline: &mut Timeline<K>, stamp_ns: u64) {
        timeline.put_back(self.moment, stamp_ns);
        timeline.channel.set_weights(&self.weights);
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
            Timeline::new(design.channel, known_force, initial.velocity_m_s, position)
        });
        let mut attitude_fix_hold_ns = 0;
        let rotation = rotation.map(|design| {
            attitude_fix_hold_ns = fix_hold_ns(design.attitude_fix_gain_per_s, design.attitude_fix_hold_s)?;
            let attitude = Attitude::new(initial.attitude, design.attitude_fix_gain_per_s);
            let known_force = match design.gyroscopic_torque {
                GyroscopicTorque::Learned => KnownForce::Constant(Vector3::zeros()),
                GyroscopicTorque::Feedforward => KnownForce::Gyroscopic(design.channel.inertia),
            };
            Timeline::new(design.channel, known_force, initial.angular_velocity_rad_s, attitude)
        });
        let (translation, rotation) = (translation.transpose()?, rotation.transpose()?);
        Ok(Self {
            good_translation: translation.as_ref().map(GoodCopy::of),
            good_rotation: rotation.as_ref().map(GoodCopy::of),
            translation,
            rotation,
            fixed_attitude: initial.attitude.unwrap_or_default(),
            initial_attitude: initial.attitude.unwrap_or_default(),
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
        let attitude_until_ns = stamp_ns + self.attitude_fix_hold_ns;
        if let Some(rotation) = &mut self.rotation {
            rotation.accept(stamp_ns, sample.angular_velocity_rad_s, sample.torque_n_m, |pose| {
                if let Some(fix) = &sample.attitude {
                    pose.take_fix(fix, attitude_until_ns);
                }
            });
        }
        if let Some(attitude) = sample.attitude {
            self.fixed_attitude = attitude;
        }
        let attitude = self.attitude_at(stamp_ns);
        let position_until_ns = stamp_ns + self.position_fix_hold_ns;
        if let Some(translation) = &mut self.translation {
            let velocity = sample.velocity.map(|velocity| match velocity {
                Velocity::Inertial(velocity) => velocity,
                Velocity::Body(velocity) => attitude * velocity,
            });
            translation.accept(stamp_ns, velocity, sample.force_n, |pose| {
                if let Some(fix) = &sample.position_m {
                    pose.take_fix(fix, position_until_ns);
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
                let report = report(timeline, &at, stamp_ns);
                (at.moment.pose.position, at.moment.rate, at.matched_force, Some(report))
            }
            None => Default::default(),
        };
        let rotation = self.rotation.as_mut().map(|r| (r.predict(stamp_ns), r));
        let (attitude, angular_velocity_rad_s, matched_torque_n_m, rotation) = match rotation {
            Some((at, timeline)) => {
                let report = report(timeline, &at, stamp_ns);
                (at.moment.pose.attitude, at.moment.rate, at.matched_force, Some(report))
            }
            None => (self.fixed_attitude, Vector3::zeros(), Vector3::zeros(), None),
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

    fn attitude_at(&mut self, stamp_ns: u64) -> UnitQuaternion<f64> {
        match &mut self.rotation {
            Some(rotation) => rotation.predict(stamp_ns).moment.pose.attitude,
            None => self.fixed_attitude,
        }
    }

    /// Stops or resumes learning; what was learned stays in use.
    pub fn set_frozen(&mut self, frozen: bool) {
        if let Some(translation) = &mut self.translation {
            translation.set_frozen(frozen);
        }
        if let Some(rotation) = &mut self.rotation {
            rotation.set_frozen(frozen);
        }
    }

    /// Forgets everything; starts again from the next sample.
    pub fn reset(&mut self) {
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
        if let (Some(timeline), Some(good)) = (&self.translation, &mut self.good_translation) {
            good.keep(timeline);
        }
        if let (Some(timeline), Some(good)) = (&self.rotation, &mut self.good_rotation) {
            good.keep(timeline);
        }
    }

    /// Puts state and weights back to the last good copy, as the state of `stamp_ns`.
    pub fn restore_good_copy(&mut self, stamp_ns: u64) {
        if let (Some(timeline), Some(good)) = (&mut self.translation, &self.good_translation) {
            good.restore(timeline, stamp_ns);
        }
        if let (Some(timeline), Some(good)) = (&mut self.rotation, &self.good_rotation) {
            good.restore(timeline, stamp_ns);
        }
    }

    /// The translation's law, its space and weights.
    pub fn translation(&self) -> Option<&Channel> {
        self.translation.as_ref().map(|timeline| &timeline.channel)
    }

    /// The rotation's law, its space and weights.
    pub fn rotation(&self) -> Option<&Channel> {
        self.rotation.as_ref().map(|timeline| &timeline.channel)
    }
}

fn fix_hold_ns(gain_per_s: f64, hold_s: f64) -> Result<u64, DesignError> {
    for value in [gain_per_s, hold_s] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(DesignError::new(Parameter::Fix, value.to_string(), "a finite number ≥ 0"));
        }
    }
    Ok((hold_s * 1e9).round() as u64)
}

fn report<K: Kinematics>(timeline: &Timeline<K>, at: &Prediction<K>, stamp_ns: u64) -> ChannelReport {
    let channel = &timeline.channel;
    let space = channel.space();
    let (lower, upper) = space.bounding_box();
    let output = if at.coasting { &at.moment.rate } else { channel.held_output() };
    ChannelReport {
        output_error: if at.coasting { 0.0 } else { channel.output_error_norm() },
        activation: at.learning.activation,
        power_function: space.power_function(at.squared_features) / space.kernel().value_at_zero().sqrt(),
        native_norm: channel.native_norm(),
        error_bound: if at.coasting { f64::INFINITY } else { channel.error_bound() },
        output_age_s: match timeline.output_stamp_ns() {
            Some(output_stamp_ns) => seconds(stamp_ns.saturating_sub(output_stamp_ns)),
            None => f64::INFINITY,
        },
        coasting: at.coasting,
        clamped: at.learning.clamped,
        outside_centers: (0..3).any(|axis| !(lower[axis]..=upper[axis]).contains(&output[axis])),
    }
}
