//! Our messages as Foxglove's own: `Odometry`, `FrameTransform` and `Log`.

use foxglove::messages::{FrameTransform, Log, Odometry, Pose, Timestamp, log::Level};
use shared_types::payload::{self, status_bits};

/// Position, attitude and velocities of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Inertial (m).
    pub position_m: [f64; 3],
    /// Inertial (m/s).
    pub velocity_m_s: [f64; 3],
    /// Body to inertial.
    pub attitude_wxyz: [f64; 4],
    /// Body axes (rad/s).
    pub angular_velocity_rad_s: [f64; 3],
}

impl Motion {
    /// The estimated motion; `None` where there is none: no sample yet, a general linear plant.
    pub fn estimated(estimate: &payload::Estimate) -> Option<Self> {
        let is_known = estimate.status & status_bits::WAITING == 0 && !estimate.has_linear_plant();
        is_known.then_some(Self {
            position_m: estimate.position_m,
            velocity_m_s: estimate.velocity_m_s,
            attitude_wxyz: estimate.attitude_wxyz,
            angular_velocity_rad_s: estimate.angular_velocity_rad_s,
        })
    }

    /// The true motion.
    pub fn of(truth: &payload::Truth) -> Self {
        Self {
            position_m: truth.position_m,
            velocity_m_s: truth.velocity_m_s,
            attitude_wxyz: truth.attitude_wxyz,
            angular_velocity_rad_s: truth.angular_velocity_rad_s,
        }
    }

    /// As Foxglove's message: velocities along the body axes.
    pub fn odometry(&self, wall_ns: u64, frame: &str, body_frame: &str) -> Odometry {
        Odometry {
            timestamp: Some(timestamp(wall_ns)),
            frame_id: frame.into(),
            body_frame_id: body_frame.into(),
            pose: Some(Pose { position: Some(vector(self.position_m)), orientation: Some(self.rotation()) }),
            linear_velocity: Some(vector(into_body(self.attitude_wxyz, self.velocity_m_s))),
            angular_velocity: Some(vector(self.angular_velocity_rad_s)),
            // Unknown: a bound on the error is none.
            pose_covariance: vec![0.0; 36],
            velocity_covariance: vec![0.0; 36],
            metadata: Vec::new(),
        }
    }

    /// Where the body's frame is.
    pub fn frame_transform(&self, wall_ns: u64, frame: &str, body_frame: &str) -> FrameTransform {
        FrameTransform {
            timestamp: Some(timestamp(wall_ns)),
            parent_frame_id: frame.into(),
            child_frame_id: body_frame.into(),
            translation: Some(vector(self.position_m)),
            rotation: Some(self.rotation()),
        }
    }

    fn rotation(&self) -> foxglove::messages::Quaternion {
        let [w, x, y, z] = self.attitude_wxyz;
        foxglove::messages::Quaternion { x, y, z, w }
    }
}

/// A line of Foxglove's log.
pub fn log_line(wall_ns: u64, level: Level, name: &str, message: String) -> Log {
    Log {
        timestamp: Some(timestamp(wall_ns)),
        level: level.into(),
        message,
        name: name.into(),
        ..Log::default()
    }
}

fn timestamp(wall_ns: u64) -> Timestamp {
    Timestamp::new((wall_ns / 1_000_000_000) as u32, (wall_ns % 1_000_000_000) as u32)
}

fn vector([x, y, z]: [f64; 3]) -> foxglove::messages::Vector3 {
    foxglove::messages::Vector3 { x, y, z }
}

/// An inertial vector along the body axes: `v − 2w (u × v) + 2 u × (u × v)`, u the quaternion's vector part.
fn into_body([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross = |b: [f64; 3]| [y * b[2] - z * b[1], z * b[0] - x * b[2], x * b[1] - y * b[0]];
    let once = cross(v);
    let twice = cross(once);
    [0, 1, 2].map(|axis| v[axis] - 2.0 * w * once[axis] + 2.0 * twice[axis])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_that_points_east_and_flies_east_flies_forward() {
        // North-east-down, a quarter turn to the right.
        let half = std::f64::consts::FRAC_PI_4;
        let body = into_body([half.cos(), 0.0, 0.0, half.sin()], [0.0, 3.0, 0.5]);
        for (found, needed) in body.into_iter().zip([3.0, 0.0, 0.5]) {
            assert!((found - needed).abs() < 1e-15, "{body:?}");
        }
    }

    #[test]
    fn before_the_first_sample_and_of_a_linear_plant_there_is_no_motion() {
        let waiting = payload::Estimate { status: status_bits::WAITING, ..Default::default() };
        assert_eq!(Motion::estimated(&waiting), None);
        let mut linear = payload::Estimate::default();
        linear.linear.error_bound = 1.0;
        assert_eq!(Motion::estimated(&linear), None);
        assert!(Motion::estimated(&payload::Estimate::default()).is_some());
    }
}
