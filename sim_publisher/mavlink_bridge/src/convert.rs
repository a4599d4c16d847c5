//! Converts messages to quantities of a measurement, and an estimate to a message. No clock, no state.
//!
//! | message | gives |
//! |---|---|
//! | ODOMETRY | position, attitude, velocity (turned by the message's own attitude), angular velocity |
//! | LOCAL_POSITION_NED | position, velocity |
//! | ATTITUDE_QUATERNION, or ATTITUDE (3-2-1 angles) | attitude, angular velocity |
//! | ATTITUDE_TARGET | thrust set-point |
//! | ACTUATOR_CONTROL_TARGET, group 0 | thrust and torque set-points |
//!
//! Fields that are not finite, and quaternions that are not of unit norm, are ignored. Covariances are ignored, too: a
//! measurement has none.

use mavlink::dialects::common::{
    ACTUATOR_CONTROL_TARGET_DATA, ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, LOCAL_POSITION_NED_DATA,
    MavEstimatorType, MavFrame, ODOMETRY_DATA,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use shared_types::{Estimate, Measurement};

/// A quaternion whose norm differs from 1 by more is ignored.
const NORM_TOLERANCE: f64 = 0.01;

/// The quantities of motion in one message; `None` for those that it does not have.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Motion {
    /// Inertial (m).
    pub position_m: Option<[f64; 3]>,
    /// Inertial (m/s).
    pub velocity_m_s: Option<[f64; 3]>,
    /// Body axes (m/s), if there is no attitude to rotate it.
    pub body_velocity_m_s: Option<[f64; 3]>,
    /// Body to inertial.
    pub attitude_wxyz: Option<[f64; 4]>,
    /// Body axes (rad/s).
    pub angular_velocity_rad_s: Option<[f64; 3]>,
}

impl Motion {
    /// Adds these quantities to a sample.
    pub(crate) fn add_to(&self, mut sample: Measurement) -> Measurement {
        if let Some(position_m) = self.position_m {
            sample = sample.with_position_m(position_m);
        }
        if let Some(velocity_m_s) = self.velocity_m_s {
            sample = sample.with_velocity_m_s(velocity_m_s);
        } else if let Some(velocity_m_s) = self.body_velocity_m_s {
            sample = sample.with_body_velocity_m_s(velocity_m_s);
        }
        if let Some(attitude_wxyz) = self.attitude_wxyz {
            sample = sample.with_attitude_wxyz(attitude_wxyz);
        }
        if let Some(angular_velocity_rad_s) = self.angular_velocity_rad_s {
            sample = sample.with_angular_velocity_rad_s(angular_velocity_rad_s);
        }
        sample
    }
}

/// Why an ODOMETRY is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Refused {
    /// Its axes are not those of the other messages.
    #[error(
        "ODOMETRY in frame {frame} with velocities in frame {child}: needed: MAV_FRAME_LOCAL_NED (1) or LOCAL_FRD (20), \
         velocities in BODY_FRD (12) or in the same frame"
    )]
    Frames {
        /// MAV_FRAME of the pose.
        frame: u32,
        /// MAV_FRAME of the velocities.
        child: u32,
    },
    /// The vehicle's estimator reports a failure.
    #[error("ODOMETRY of quality -1: the vehicle's estimator has failed")]
    Failed,
}

fn finite(numbers: [f32; 3]) -> Option<[f64; 3]> {
    numbers.iter().all(|number| number.is_finite()).then(|| numbers.map(f64::from))
}

/// The quaternion of unit norm in doubles, where it is one.
fn unit(wxyz: [f32; 4]) -> Option<[f64; 4]> {
    let wxyz = wxyz.map(f64::from);
    let norm = wxyz.iter().map(|part| part * part).sum::<f64>().sqrt();
    ((norm - 1.0).abs() < NORM_TOLERANCE).then(|| wxyz.map(|part| part / norm))
}

/// Body to inertial.
pub(crate) fn rotation([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
}

/// # Errors
/// `Frames` or `Failed`: nothing of it is to be used.
pub(crate) fn odometry(message: &ODOMETRY_DATA) -> Result<Motion, Refused> {
    let (frame, child) = (message.frame_id, message.child_frame_id);
    let is_local = matches!(frame, MavFrame::MAV_FRAME_LOCAL_NED | MavFrame::MAV_FRAME_LOCAL_FRD);
    // The old name of the same axes is still in use.
    #[allow(deprecated)]
    let is_body = matches!(child, MavFrame::MAV_FRAME_BODY_FRD | MavFrame::MAV_FRAME_BODY_NED);
    if !is_local || !(is_body || child == frame) {
        return Err(Refused::Frames { frame: frame as u32, child: child as u32 });
    }
    if message.quality == -1 {
        return Err(Refused::Failed);
    }
    let attitude_wxyz = unit(message.q);
    let velocity_m_s = finite([message.vx, message.vy, message.vz]);
    let turned = |body: [f64; 3]| attitude_wxyz.map(|wxyz| (rotation(wxyz) * Vector3::from(body)).into());
    let inertial_m_s = if is_body { velocity_m_s.and_then(turned) } else { velocity_m_s };
    Ok(Motion {
        position_m: finite([message.x, message.y, message.z]),
        velocity_m_s: inertial_m_s,
        body_velocity_m_s: velocity_m_s.filter(|_| inertial_m_s.is_none()),
        attitude_wxyz,
        angular_velocity_rad_s: finite([message.rollspeed, message.pitchspeed, message.yawspeed]),
    })
}

/// Position and velocity.
pub(crate) fn local_position(message: &LOCAL_POSITION_NED_DATA) -> Motion {
    Motion {
        position_m: finite([message.x, message.y, message.z]),
        velocity_m_s: finite([message.vx, message.vy, message.vz]),
        ..Motion::default()
    }
}

/// Attitude and angular velocity, from roll, pitch and yaw: first yaw about z, then pitch about y, then roll about x.
pub(crate) fn attitude(message: &ATTITUDE_DATA) -> Motion {
    let wxyz = |[roll, pitch, yaw]: [f64; 3]| {
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        [q.w, q.i, q.j, q.k]
    };
    Motion {
        attitude_wxyz: finite([message.roll, message.pitch, message.yaw]).map(wxyz),
        angular_velocity_rad_s: finite([message.rollspeed, message.pitchspeed, message.yawspeed]),
        ..Motion::default()
    }
}

/// Attitude and angular velocity.
pub(crate) fn attitude_quaternion(message: &ATTITUDE_QUATERNION_DATA) -> Motion {
    Motion {
        attitude_wxyz: unit([message.q1, message.q2, message.q3, message.q4]),
        angular_velocity_rad_s: finite([message.rollspeed, message.pitchspeed, message.yawspeed]),
        ..Motion::default()
    }
}

/// Roll, pitch and yaw torque and the thrust of the flight group (0), each −1 … 1.
pub(crate) fn actuators(message: &ACTUATOR_CONTROL_TARGET_DATA) -> Option<([f64; 3], f64)> {
    let [roll, pitch, yaw, thrust, ..] = message.controls;
    let thrust_and = |torque| thrust.is_finite().then_some((torque, f64::from(thrust)));
    finite([roll, pitch, yaw]).filter(|_| message.group_mlx == 0).and_then(thrust_and)
}

/// The force of a thrust set-point, inertial axes: it pushes the body upwards, along its −z.
pub(crate) fn force_n(thrust: f64, thrust_n: f64, attitude_wxyz: [f64; 4]) -> [f64; 3] {
    (rotation(attitude_wxyz) * Vector3::new(0.0, 0.0, -thrust * thrust_n)).into()
}

/// The estimate as ODOMETRY: its own stamp, pose in `frame`, velocities along the body's axes.
///
/// The covariances are marked as unknown, since a bound is not a covariance. The type of the estimator is therefore NAIVE,
/// "without any real covariance feedback".
pub(crate) fn estimate_message(estimate: &Estimate, frame: MavFrame, reset_counter: u8) -> ODOMETRY_DATA {
    let body_m_s = rotation(estimate.attitude_wxyz).inverse() * Vector3::from(estimate.velocity_m_s);
    let [x, y, z] = estimate.position_m.map(|number| number as f32);
    let [rollspeed, pitchspeed, yawspeed] = estimate.angular_velocity_rad_s.map(|number| number as f32);
    let mut unknown = [0.0; 21];
    unknown[0] = f32::NAN;
    ODOMETRY_DATA {
        time_usec: estimate.stamp_ns / 1000,
        frame_id: frame,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
        x,
        y,
        z,
        q: estimate.attitude_wxyz.map(|number| number as f32),
        vx: body_m_s.x as f32,
        vy: body_m_s.y as f32,
        vz: body_m_s.z as f32,
        rollspeed,
        pitchspeed,
        yawspeed,
        pose_covariance: unknown,
        velocity_covariance: unknown,
        reset_counter,
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_NAIVE,
        quality: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::payload::{frame, valid};
    use std::f32::consts::FRAC_PI_2;

    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;
    const ROUNDING: f64 = 1e-6;

    fn near(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        let is_near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < ROUNDING);
        assert!(is_near, "found {found:?}, expected {expected:?}");
    }

    /// Nose to the east, level: what points forward in the body points east, what points right points south.
    fn heading_east() -> ODOMETRY_DATA {
        ODOMETRY_DATA {
            frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
            child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
            x: 1.0,
            y: 2.0,
            z: -3.0,
            q: [HALF, 0.0, 0.0, HALF],
            vx: 4.0,
            vy: 0.5,
            vz: 0.25,
            rollspeed: 0.1,
            pitchspeed: 0.2,
            yawspeed: 0.3,
            ..ODOMETRY_DATA::default()
        }
    }

    #[test]
    fn velocities_of_the_body_are_turned_by_the_message_s_own_attitude() {
        let motion = odometry(&heading_east()).unwrap();
        near(&motion.velocity_m_s.unwrap(), &[-0.5, 4.0, 0.25]);
        near(&motion.position_m.unwrap(), &[1.0, 2.0, -3.0]);
        near(&motion.attitude_wxyz.unwrap(), &[HALF.into(), 0.0, 0.0, HALF.into()]);
        near(&motion.angular_velocity_rad_s.unwrap(), &[0.1, 0.2, 0.3]);
        let sample = motion.add_to(Measurement::default());
        assert!(sample.has(valid::VELOCITY | valid::POSITION | valid::ATTITUDE | valid::ANGULAR_VELOCITY));
        assert_eq!(sample.velocity_frame, frame::INERTIAL);
    }

    #[test]
    fn velocities_of_the_pose_s_own_frame_are_taken_as_they_are() {
        // PX4 says so of an estimate in north-east-down.
        for frame in [MavFrame::MAV_FRAME_LOCAL_NED, MavFrame::MAV_FRAME_LOCAL_FRD] {
            let message = ODOMETRY_DATA { frame_id: frame, child_frame_id: frame, ..heading_east() };
            near(&odometry(&message).unwrap().velocity_m_s.unwrap(), &[4.0, 0.5, 0.25]);
        }
    }

    #[test]
    fn nan_fields_are_ignored() {
        let blind =
            ODOMETRY_DATA { x: f32::NAN, q: [f32::NAN; 4], yawspeed: f32::INFINITY, ..heading_east() };
        let sample = odometry(&blind).unwrap().add_to(Measurement::default());
        assert_eq!((sample.valid, sample.velocity_frame), (valid::VELOCITY, frame::BODY));
        near(&sample.velocity_m_s, &[4.0, 0.5, 0.25]);
        let doubtful = ODOMETRY_DATA { q: [0.8, 0.0, 0.0, 0.8], ..heading_east() };
        assert_eq!(odometry(&doubtful).unwrap().attitude_wxyz, None);
        let rounded = ODOMETRY_DATA { q: [1.005, 0.0, 0.0, 0.0], ..heading_east() };
        assert_eq!(odometry(&rounded).unwrap().attitude_wxyz, Some([1.0, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn other_axes_and_a_failed_estimator_are_refused() {
        let enu = ODOMETRY_DATA { frame_id: MavFrame::MAV_FRAME_LOCAL_ENU, ..heading_east() };
        assert_eq!(odometry(&enu), Err(Refused::Frames { frame: 4, child: 12 }));
        let other = ODOMETRY_DATA { child_frame_id: MavFrame::MAV_FRAME_LOCAL_FRD, ..heading_east() };
        assert_eq!(odometry(&other), Err(Refused::Frames { frame: 1, child: 20 }));
        let failed = ODOMETRY_DATA { quality: -1, ..heading_east() };
        assert_eq!(odometry(&failed), Err(Refused::Failed));
    }

    #[test]
    fn angles_are_yaw_then_pitch_then_roll() {
        let quarter_turns = |roll: f32, pitch: f32, yaw: f32| {
            let angles = ATTITUDE_DATA { roll, pitch, yaw, ..ATTITUDE_DATA::default() };
            let nose = rotation(attitude(&angles).attitude_wxyz.unwrap()) * Vector3::x();
            let right = rotation(attitude(&angles).attitude_wxyz.unwrap()) * Vector3::y();
            (<[f64; 3]>::from(nose), <[f64; 3]>::from(right))
        };
        // Rolled right: the right wing points down. Pitched up: the nose points up. Yawed: the nose points east.
        near(&quarter_turns(FRAC_PI_2, 0.0, 0.0).1, &[0.0, 0.0, 1.0]);
        near(&quarter_turns(0.0, FRAC_PI_2, 0.0).0, &[0.0, 0.0, -1.0]);
        near(&quarter_turns(0.0, 0.0, FRAC_PI_2).0, &[0.0, 1.0, 0.0]);
        // All three: to the east, then up, and the right wing goes to where the belly looked by then, east.
        let (nose, right) = quarter_turns(FRAC_PI_2, FRAC_PI_2, FRAC_PI_2);
        near(&nose, &[0.0, 0.0, -1.0]);
        near(&right, &[0.0, 1.0, 0.0]);
    }

    #[test]
    fn thrust_pushes_the_body_up_and_where_it_leans_to() {
        // Level, 39.2 N at half thrust: up is −z.
        near(&force_n(0.5, 39.2, [1.0, 0.0, 0.0, 0.0]), &[0.0, 0.0, -19.6]);
        // Nose down by 30°: forward, to the north. Half angle 15°.
        let (s, c) = (-15.0f64).to_radians().sin_cos();
        let forward = 10.0 * 30.0f64.to_radians().sin();
        near(&force_n(1.0, 10.0, [c, 0.0, s, 0.0]), &[forward, 0.0, -10.0 * 30.0f64.to_radians().cos()]);
        // Rolled right by 30°: to the east.
        near(&force_n(1.0, 10.0, [c, -s, 0.0, 0.0]), &[0.0, forward, -10.0 * 30.0f64.to_radians().cos()]);
        // A thruster that pulls back.
        near(&force_n(-0.5, 10.0, [1.0, 0.0, 0.0, 0.0]), &[0.0, 0.0, 5.0]);
    }

    #[test]
    fn of_the_actuators_the_flight_group_alone_counts() {
        let controls = [0.1, -0.2, 0.3, 0.4, 0.0, 0.0, 0.0, 0.0];
        let mut message =
            ACTUATOR_CONTROL_TARGET_DATA { controls, ..ACTUATOR_CONTROL_TARGET_DATA::default() };
        let (torque, thrust) = actuators(&message).unwrap();
        near(&[torque[0], torque[1], torque[2], thrust], &[0.1, -0.2, 0.3, 0.4]);
        message.group_mlx = 1;
        assert_eq!(actuators(&message), None);
        message = ACTUATOR_CONTROL_TARGET_DATA { controls: [f32::NAN; 8], ..message };
        assert_eq!(actuators(&message), None);
    }

    #[test]
    fn an_estimate_is_told_along_the_body_s_axes() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let estimate = Estimate {
            stamp_ns: 1_234_567_890,
            position_m: [1.0, 2.0, 3.0],
            // North-west with the nose to the east: backwards and to the left.
            velocity_m_s: [2.0, -1.0, 0.5],
            attitude_wxyz: [half, 0.0, 0.0, half],
            angular_velocity_rad_s: [0.1, 0.2, 0.3],
            ..Estimate::default()
        };
        let message = estimate_message(&estimate, MavFrame::MAV_FRAME_LOCAL_FRD, 3);
        assert_eq!((message.time_usec, message.frame_id), (1_234_567, MavFrame::MAV_FRAME_LOCAL_FRD));
        near(&[message.vx, message.vy, message.vz].map(f64::from), &[-1.0, -2.0, 0.5]);
        assert!(message.pose_covariance[0].is_nan() && message.velocity_covariance[0].is_nan());
        assert_eq!((message.reset_counter, message.quality), (3, 0));
        // There and back.
        let back = odometry(&message).unwrap();
        near(&back.velocity_m_s.unwrap(), &estimate.velocity_m_s);
        near(&back.attitude_wxyz.unwrap(), &estimate.attitude_wxyz);
        near(&back.position_m.unwrap(), &estimate.position_m);
    }
}
