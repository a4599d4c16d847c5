//! Messages into quantities of a measurement, and an estimate into a message. No clock, no state.
//!
//! | message | gives |
//! |---|---|
//! | ODOMETRY | position, attitude, velocity (turned by the message's own attitude), angular velocity |
//! | LOCAL_POSITION_NED | position, velocity |
//! | ATTITUDE_QUATERNION, or ATTITUDE (3-2-1 angles) | attitude, angular velocity |
//! | ATTITUDE_TARGET | thrust set-point |
//! | ACTUATOR_CONTROL_TARGET, group 0 | thrust and torque set-points |
//!
//! What is not finite, or no unit quaternion, is not there. Covariances are not taken: a measurement has no place for
//! them.

use mavlink::dialects::common::{
    ACTUATOR_CONTROL_TARGET_DATA, ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, LOCAL_POSITION_NED_DATA,
    MavEstimatorType, MavFrame, ODOMETRY_DATA,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use shared_types::{Estimate, Measurement};

/// A quaternion whose norm is further from 1 is none.
const NORM_TOLERANCE: f64 = 0.01;

/// What one message says of the motion; what it does not say is `None`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Motion {
    /// Inertial (m).
    pub position_m: Option<[f64; 3]>,
    /// Inertial (m/s).
    pub velocity_m_s: Option<[f64; 3]>,
    /// Body axes (m/s), where there is no attitude to turn it by.
    pub body_velocity_m_s: Option<[f64; 3]>,
    /// Body to inertial.
    pub attitude_wxyz: Option<[f64; 4]>,
    /// Body axes (rad/s).
    pub angular_velocity_rad_s: Option<[f64; 3]>,
}

impl Motion {
    /// Adds what is known to a sample.
    pub fn add_to(&self, mut sample: Measurement) -> Measurement {
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
pub enum Refused {
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
    /// The vehicle's estimator says so.
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
pub fn rotation([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
}

/// # Errors
/// `Frames` or `Failed`: nothing of it is to be used.
pub fn odometry(message: &ODOMETRY_DATA) -> Result<Motion, Refused> {
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
pub fn local_position(message: &LOCAL_POSITION_NED_DATA) -> Motion {
    Motion {
        position_m: finite([message.x, message.y, message.z]),
        velocity_m_s: finite([message.vx, message.vy, message.vz]),
        ..Motion::default()
    }
}

/// Attitude and angular velocity, from roll, pitch and yaw: first yaw about z, then pitch about y, then roll about x.
pub fn attitude(message: &ATTITUDE_DATA) -> Motion {
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
pub fn attitude_quaternion(message: &ATTITUDE_QUATERNION_DATA) -> Motion {
    Motion {
        attitude_wxyz: unit([message.q1, message.q2, message.q3, message.q4]),
        angular_velocity_rad_s: finite([message.rollspeed, message.pitchspeed, message.yawspeed]),
        ..Motion::default()
    }
}

/// Roll, pitch and yaw torque and the thrust of the flight group (0), each −1 … 1.
pub fn actuators(message: &ACTUATOR_CONTROL_TARGET_DATA) -> Option<([f64; 3], f64)> {
    let [roll, pitch, yaw, thrust, ..] = message.controls;
    let thrust_and = |torque| thrust.is_finite().then_some((torque, f64::from(thrust)));
    finite([roll, pitch, yaw]).filter(|_| message.group_mlx == 0).and_then(thrust_and)
}

/// The force of a thrust set-point, inertial axes: it pushes the body upwards, along its −z.
pub fn force_n(thrust: f64, thrust_n: f64, attitude_wxyz: [f64; 4]) -> [f64; 3] {
    (rotation(attitude_wxyz) * Vector3::new(0.0, 0.0, -thrust * thrust_n)).into()
}

/// The estimate as ODOMETRY: its own stamp, pose in `frame`, velocities along the body's axes.
///
/// The covariances are unknown, as MAVLink writes that: a bound is none. So the type of the estimator is NAIVE, "without
/// any real covariance feedback".
pub fn estimate_message(estimate: &Estimate, frame: MavFrame, reset_counter: u8) -> ODOMETRY_DATA {
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
