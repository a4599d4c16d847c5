//! A sample in inertial axes, as of the center of mass: what body axes and a lever arm make of it.
//!
//! ```text
//! v = R (v_s − ω × l)   of a velocity along the body axes,     v = v_s − R (ω × l)   of an inertial one
//! r = r_s − R l,        F = R F_b
//! ```

use super::partial::{self, Known};
use super::{LawChannel, RigidBodyObserver, Sample, Velocity};
use crate::joint_channel::or_designed;
use nalgebra::{UnitQuaternion, Vector3};

/// A sample in inertial axes, as of the center of mass, and what turning and moving it adds to its deviations.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct InertialSample {
    pub(super) velocity: Option<Vector3<f64>>,
    pub(super) velocity_std: f64,
    /// Of a velocity in body axes that lacks a component, by axis, with its deviation.
    pub(super) part: Option<[Option<(f64, f64)>; 3]>,
    pub(super) position: Option<Vector3<f64>>,
    pub(super) position_std: f64,
    pub(super) force: Option<Vector3<f64>>,
    /// With its deviation.
    pub(super) specific_force: Option<(Vector3<f64>, f64)>,
    /// Attitude and ω, body axes (rad/s), where the translation's features are along the body's axes.
    pub(super) turning: Option<(UnitQuaternion<f64>, Vector3<f64>)>,
}

/// Attitude and angular velocity of an instant, with their largest deviations: 0 where the law has none.
#[derive(Debug, Clone, Copy, Default)]
struct Rotating {
    attitude: UnitQuaternion<f64>,
    attitude_std_rad: f64,
    rate: Vector3<f64>,
    rate_std_rad_s: f64,
}

impl RigidBodyObserver {
    /// The sample in inertial axes, as of the center of mass. Without an attitude, what is along body axes and what a lever arm moves
    /// is not used: its direction is unknown.
    pub(super) fn inertial(&mut self, sample: &Sample) -> InertialSample {
        let has_arm = sample.lever_arm_m != Vector3::zeros();
        let is_body = matches!(sample.velocity, Some(Velocity::Body(_)));
        let is_moved = has_arm && (sample.velocity.is_some() || sample.position_m.is_some());
        let accelerometer =
            self.joint_translation().and_then(|channel| channel.filter().design().accelerometer);
        let in_body_axes =
            self.joint_translation().is_some_and(|channel| channel.filter().design().body_axes.is_some());
        let has_force = sample.specific_force_m_s2.is_some() && accelerometer.is_some();
        let is_turned = is_body || sample.force_is_body || has_force;
        let mut inertial = InertialSample {
            velocity: match sample.velocity {
                Some(Velocity::Inertial(velocity)) if !has_arm => Some(velocity),
                _ => None,
            },
            position: sample.position_m.filter(|_| !has_arm),
            force: sample.force_n.filter(|_| !sample.force_is_body),
            ..InertialSample::default()
        };
        if !is_moved && !is_turned && !in_body_axes {
            return inertial;
        }
        let Some(motion) = self.rotation_at(sample.stamp_ns) else { return inertial };
        let Rotating { attitude, attitude_std_rad, rate, rate_std_rad_s } = motion;
        // A body without a rotation channel has but the measured rate.
        let measured = sample.angular_velocity_quality.whole(sample.angular_velocity_rad_s);
        inertial.turning = in_body_axes.then(|| (attitude, measured.unwrap_or(rate)));
        let arm = sample.lever_arm_m;
        let (of_arm, of_arm_std) = (rate.cross(&arm), arm.norm() * rate_std_rad_s);
        match sample.velocity {
            Some(Velocity::Body(velocity)) => {
                let of_center = if has_arm { velocity - of_arm } else { velocity };
                inertial.velocity = Some(attitude * of_center);
                inertial.velocity_std = (of_center.norm() * attitude_std_rad).hypot(of_arm_std);
                if sample.velocity_quality.missing != [false; 3] {
                    inertial.part = self.part_of_velocity(sample, &motion, &of_center, of_arm_std);
                }
            }
            Some(Velocity::Inertial(velocity)) if has_arm => {
                inertial.velocity = Some(velocity - attitude * of_arm);
                inertial.velocity_std = (of_arm.norm() * attitude_std_rad).hypot(of_arm_std);
            }
            _ => {}
        }
        if has_arm {
            inertial.position = sample.position_m.map(|position| position - attitude * arm);
            inertial.position_std = arm.norm() * attitude_std_rad;
        }
        if sample.force_is_body {
            inertial.force = sample.force_n.map(|force| attitude * force);
        }
        inertial.specific_force = sample.specific_force_m_s2.zip(accelerometer).map(|(force, designed)| {
            let std = or_designed(&sample.specific_force_std_m_s2, &[designed.noise; 3]);
            let largest = std.into_iter().fold(0.0, f64::max);
            (attitude * force, largest.hypot(force.norm() * attitude_std_rad))
        });
        inertial
    }

    /// What a velocity in body axes without some of its components tells; `None` with the gradient law. `of_arm_std` is what the lever
    /// arm adds to its deviations (m/s).
    fn part_of_velocity(
        &mut self,
        sample: &Sample,
        motion: &Rotating,
        velocity: &Vector3<f64>,
        of_arm_std: f64,
    ) -> Option<[Option<(f64, f64)>; 3]> {
        let Some(LawChannel::Joint(translation)) = &mut self.translation else { return None };
        let at = translation.estimate(sample.stamp_ns);
        let filter = translation.filter();
        let of_sensor = or_designed(&sample.velocity_quality.std, &filter.design().noise);
        // Before the first velocity, any within the box of the centers.
        let (value, std) = match at.is_started {
            true => (at.prediction.velocity.into(), at.prediction.velocity_std),
            false => (Vector3::zeros(), [filter.largest_half_width(); 3]),
        };
        let missing = &sample.velocity_quality.missing;
        let rotation = motion.attitude.to_rotation_matrix().into_inner();
        let expected = rotation.tr_mul(&value);
        let body = Vector3::from_fn(|k, _| if missing[k] { expected[k] } else { velocity[k] });
        let turned_std = (body.norm() * motion.attitude_std_rad).hypot(of_arm_std);
        let of_body = Known { value: &body, std: &of_sensor.map(|std| std.hypot(turned_std)) };
        Some(partial::of_body(&rotation, of_body, missing, Known { value: &value, std: &std }))
    }

    /// Attitude and angular velocity at `stamp_ns`; `None` where the attitude was never told.
    fn rotation_at(&mut self, stamp_ns: u64) -> Option<Rotating> {
        let largest = |std: [f64; 3]| std.into_iter().fold(0.0, f64::max);
        match &mut self.rotation {
            Some(LawChannel::Gradient(rotation)) => {
                let state = rotation.predict(stamp_ns).moment.state;
                state.pose.is_known().then_some(Rotating {
                    attitude: state.pose.attitude,
                    rate: state.rate,
                    ..Rotating::default()
                })
            }
            Some(LawChannel::Joint(rotation)) => {
                let at = rotation.estimate(stamp_ns);
                at.pose.is_known().then_some(Rotating {
                    attitude: at.pose.attitude,
                    attitude_std_rad: largest(at.pose.std_rad()),
                    rate: at.prediction.velocity.into(),
                    rate_std_rad_s: largest(at.prediction.velocity_std),
                })
            }
            None => self.fixed_attitude.map(|attitude| Rotating { attitude, ..Rotating::default() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channels::Learn;
    use crate::design::GyroscopicTorque;
    use crate::designs::joint_law;
    use crate::joint_channel::{JointChannelDesign, JointRotationDesign, JointTranslationDesign};
    use crate::law::joint::design::{AccelerometerDesign, JointDesign};
    use crate::rigid_body::{InitialState, RotationLaw, TranslationLaw};
    use nalgebra::{Matrix3, Vector4};

    /// What a sensor at `arm` reads of a rigid body in motion, by matrices of homogeneous coordinates and their derivative: nothing of
    /// the formulas above.
    #[test]
    fn velocity_and_position_of_a_sensor_become_those_of_the_center_of_mass() {
        let (arm, rate) = (Vector3::new(0.7, -0.4, 0.25), Vector3::new(0.3, -0.9, 0.5));
        let (velocity, position) = (Vector3::new(1.2, -3.0, 0.4), Vector3::new(10.0, 20.0, -5.0));
        let attitude = UnitQuaternion::new(Vector3::new(0.4, -0.2, 2.0));
        let pose = attitude.to_rotation_matrix().to_homogeneous();
        let mut motion = pose * rate.cross_matrix().to_homogeneous();
        motion.fixed_view_mut::<3, 1>(0, 3).copy_from(&velocity);
        motion[(3, 3)] = 0.0;
        let mut pose = pose;
        pose.fixed_view_mut::<3, 1>(0, 3).copy_from(&position);
        let at: Vector4<f64> = arm.push(1.0);
        let (of_sensor, sensor_at) = ((motion * at).xyz(), (pose * at).xyz());

        let rotation = JointRotationDesign {
            channel: JointChannelDesign {
                filter: joint_law([1e-9; 3]),
                inertia: Matrix3::identity(),
                hold_s: 0.01,
            },
            gyroscopic_torque: GyroscopicTorque::Learned,
            attitude_noise_rad: 1e-9,
            bias_std_rad_s: 0.0,
            bias_walk_rad_s_sqrt_s: 0.0,
        };
        let law = RotationLaw::Joint(rotation);
        let initial = InitialState {
            attitude: Some(attitude),
            angular_velocity_rad_s: Some(rate),
            ..InitialState::default()
        };
        let translation = TranslationLaw::Joint(JointTranslationDesign {
            channel: JointChannelDesign {
                filter: JointDesign {
                    accelerometer: Some(AccelerometerDesign { noise: 0.5, bias: 0.5, bias_time_s: 10.0 }),
                    ..joint_law([0.01; 3])
                },
                inertia: Matrix3::identity(),
                hold_s: 0.01,
            },
            known_force_n: Vector3::zeros(),
            gravity_m_s2: Vector3::zeros(),
        });
        let mut observer = RigidBodyObserver::new(Some(translation), Some(law), initial).unwrap();
        let stamp_ns = 1_000_000_000;
        let rates = Sample { stamp_ns, angular_velocity_rad_s: Some(rate), ..Sample::default() };
        observer.accept(&rates, Learn::ALL);
        for reading in [Velocity::Inertial(of_sensor), Velocity::Body(attitude.inverse() * of_sensor)] {
            let sample = Sample {
                stamp_ns,
                velocity: Some(reading),
                position_m: Some(sensor_at),
                lever_arm_m: arm,
                ..Sample::default()
            };
            let inertial = observer.inertial(&sample);
            assert!((inertial.velocity.unwrap() - velocity).norm() < 1e-12, "{inertial:?}");
            assert!((inertial.position.unwrap() - position).norm() < 1e-12, "{inertial:?}");
        }
        let thrust = Vector3::new(0.1, 0.0, -9.0);
        let body = Sample {
            stamp_ns,
            force_n: Some(thrust),
            force_is_body: true,
            specific_force_m_s2: Some(thrust),
            ..Sample::default()
        };
        let inertial = observer.inertial(&body);
        let wanted = attitude.to_rotation_matrix().matrix() * thrust;
        assert!((inertial.force.unwrap() - wanted).norm() < 1e-12);
        let (force, std) = inertial.specific_force.unwrap();
        assert!((force - wanted).norm() < 1e-12 && (std - 0.5).abs() < 1e-6);
    }

    #[test]
    fn without_an_attitude_nothing_is_turned_and_nothing_is_used() {
        let translation = TranslationLaw::Joint(JointTranslationDesign {
            channel: JointChannelDesign {
                filter: joint_law([0.01; 3]),
                inertia: Matrix3::identity(),
                hold_s: 0.01,
            },
            known_force_n: Vector3::zeros(),
            gravity_m_s2: Vector3::zeros(),
        });
        let mut observer = RigidBodyObserver::new(Some(translation), None, InitialState::default()).unwrap();
        let one = Some(Vector3::x());
        let sample = Sample {
            stamp_ns: 1,
            velocity: Some(Velocity::Inertial(Vector3::x())),
            position_m: one,
            force_n: one,
            force_is_body: true,
            specific_force_m_s2: one,
            lever_arm_m: Vector3::y(),
            ..Sample::default()
        };
        let inertial = observer.inertial(&sample);
        assert!(inertial.velocity.is_none() && inertial.position.is_none());
        assert!(inertial.force.is_none() && inertial.specific_force.is_none());
    }
}
