//! The service's messages as files and the wire carry them: Protocol Buffers with their schema, made for plots.
//!
//! Names and units are those of [`shared_types::payload`]; vectors have components `x`, `y`, `z`, and what a sample does not
//! carry is absent, not zero. Everything is written, infinities and negative zeros too: a recording holds the bits that were sent.
//!
//! Foxglove's own `Odometry`, `FrameTransform` and `Log` stand beside them where they say the same; of forces and torques
//! there is no such schema.

use foxglove::Encode;
use foxglove::messages::{FrameTransform, Log, Odometry, Pose, Timestamp, log::Level};
use shared_types::payload::{self, real_time, status_bits, valid};

/// Components along three axes.
#[derive(Debug, Clone, Copy, PartialEq, Encode)]
pub struct Vector {
    /// First.
    pub x: f64,
    /// Second.
    pub y: f64,
    /// Third.
    pub z: f64,
}

impl From<[f64; 3]> for Vector {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

/// A rotation, body to inertial.
#[derive(Debug, Clone, Copy, PartialEq, Encode)]
pub struct Quaternion {
    /// Scalar part.
    pub w: f64,
    /// First of the vector part.
    pub x: f64,
    /// Second.
    pub y: f64,
    /// Third.
    pub z: f64,
}

impl From<[f64; 4]> for Quaternion {
    fn from([w, x, y, z]: [f64; 4]) -> Self {
        Self { w, x, y, z }
    }
}

/// 3-2-1 Euler angles.
#[derive(Debug, Clone, Copy, PartialEq, Encode)]
pub struct Euler {
    /// About the forward axis.
    pub roll: f64,
    /// About the right axis.
    pub pitch: f64,
    /// About the down axis.
    pub yaw: f64,
}

/// [`payload::Measurement`].
#[derive(Debug, Clone, PartialEq, Encode)]
#[allow(missing_docs)] // the payload's
pub struct Measurement {
    pub sequence: u64,
    pub stamp_ns: u64,
    pub valid: u32,
    pub velocity_frame: u32,
    pub velocity_m_s: Option<Vector>,
    pub angular_velocity_rad_s: Option<Vector>,
    pub position_m: Option<Vector>,
    pub attitude: Option<Quaternion>,
    pub force_n: Option<Vector>,
    pub torque_n_m: Option<Vector>,
    pub output: Vec<f64>,
    pub input: Vec<f64>,
}

impl From<&payload::Measurement> for Measurement {
    fn from(sample: &payload::Measurement) -> Self {
        let vector = |bit, value: [f64; 3]| sample.has(bit).then(|| Vector::from(value));
        let numbers = |bit, value: [f64; 6]| if sample.has(bit) { value.to_vec() } else { Vec::new() };
        Self {
            sequence: sample.sequence,
            stamp_ns: sample.stamp_ns,
            valid: sample.valid,
            velocity_frame: sample.velocity_frame,
            velocity_m_s: vector(valid::VELOCITY, sample.velocity_m_s),
            angular_velocity_rad_s: vector(valid::ANGULAR_VELOCITY, sample.angular_velocity_rad_s),
            position_m: vector(valid::POSITION, sample.position_m),
            attitude: sample.has(valid::ATTITUDE).then(|| sample.attitude_wxyz.into()),
            force_n: vector(valid::FORCE, sample.force_n),
            torque_n_m: vector(valid::TORQUE, sample.torque_n_m),
            output: numbers(valid::OUTPUT, sample.output),
            input: numbers(valid::INPUT, sample.input),
        }
    }
}

/// [`payload::Channel`].
#[derive(Debug, Clone, Copy, PartialEq, Encode)]
#[allow(missing_docs)] // the payload's
pub struct Channel {
    pub output_error: f64,
    pub activation: f64,
    pub power_function: f64,
    pub native_norm: f64,
    pub solver_error: f64,
    pub error_bound: f64,
    pub output_age_s: f64,
}

impl From<payload::Channel> for Channel {
    fn from(channel: payload::Channel) -> Self {
        let payload::Channel {
            output_error,
            activation,
            power_function,
            native_norm,
            solver_error,
            error_bound,
            output_age_s,
        } = channel;
        Self {
            output_error,
            activation,
            power_function,
            native_norm,
            solver_error,
            error_bound,
            output_age_s,
        }
    }
}

/// [`payload::Estimate`], with its status in words.
#[derive(Debug, Clone, PartialEq, Encode)]
#[allow(missing_docs)] // the payload's
pub struct Estimate {
    pub sequence: u64,
    pub source_sequence: u64,
    pub stamp_ns: u64,
    pub source_stamp_ns: u64,
    pub publish_stamp_ns: u64,
    pub status: u64,
    pub status_words: String,
    pub position_m: Vector,
    pub velocity_m_s: Vector,
    pub attitude: Quaternion,
    pub euler_rad: Euler,
    pub angular_velocity_rad_s: Vector,
    pub matched_force_n: Vector,
    pub matched_torque_n_m: Vector,
    pub translation: Channel,
    pub rotation: Channel,
    pub linear: Option<Channel>,
    pub state: Vec<f64>,
    pub matched_input: Vec<f64>,
}

impl From<&payload::Estimate> for Estimate {
    fn from(estimate: &payload::Estimate) -> Self {
        let [roll, pitch, yaw] = estimate.euler_rad;
        let is_linear = has_linear_plant(estimate);
        let numbers = |value: &[f64]| if is_linear { value.to_vec() } else { Vec::new() };
        Self {
            sequence: estimate.sequence,
            source_sequence: estimate.source_sequence,
            stamp_ns: estimate.stamp_ns,
            source_stamp_ns: estimate.source_stamp_ns,
            publish_stamp_ns: estimate.publish_stamp_ns,
            status: estimate.status,
            status_words: status_bits::words(estimate.status).join(" "),
            position_m: estimate.position_m.into(),
            velocity_m_s: estimate.velocity_m_s.into(),
            attitude: estimate.attitude_wxyz.into(),
            euler_rad: Euler { roll, pitch, yaw },
            angular_velocity_rad_s: estimate.angular_velocity_rad_s.into(),
            matched_force_n: estimate.matched_force_n.into(),
            matched_torque_n_m: estimate.matched_torque_n_m.into(),
            translation: estimate.translation.into(),
            rotation: estimate.rotation.into(),
            linear: is_linear.then(|| estimate.linear.into()),
            state: numbers(&estimate.state),
            matched_input: numbers(&estimate.matched_input),
        }
    }
}

/// Whether a general linear plant is estimated: else its part is zero throughout.
fn has_linear_plant(estimate: &payload::Estimate) -> bool {
    let numbers = estimate.state.iter().chain(&estimate.matched_input);
    estimate.linear != payload::Channel::default() || numbers.copied().any(|number| number != 0.0)
}

/// [`payload::Truth`].
#[derive(Debug, Clone, PartialEq, Encode)]
#[allow(missing_docs)] // the payload's
pub struct Truth {
    pub sequence: u64,
    pub stamp_ns: u64,
    pub position_m: Vector,
    pub velocity_m_s: Vector,
    pub attitude: Quaternion,
    pub angular_velocity_rad_s: Vector,
    pub matched_force_n: Vector,
    pub matched_torque_n_m: Vector,
    pub unmatched_force_n: Vector,
    pub unmatched_torque_n_m: Vector,
}

impl From<&payload::Truth> for Truth {
    fn from(truth: &payload::Truth) -> Self {
        Self {
            sequence: truth.sequence,
            stamp_ns: truth.stamp_ns,
            position_m: truth.position_m.into(),
            velocity_m_s: truth.velocity_m_s.into(),
            attitude: truth.attitude_wxyz.into(),
            angular_velocity_rad_s: truth.angular_velocity_rad_s.into(),
            matched_force_n: truth.matched_force_n.into(),
            matched_torque_n_m: truth.matched_torque_n_m.into(),
            unmatched_force_n: truth.unmatched_force_n.into(),
            unmatched_torque_n_m: truth.unmatched_torque_n_m.into(),
        }
    }
}

/// [`payload::LatencySummary`] (ns).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Encode)]
#[allow(missing_docs)] // the payload's
pub struct Latency {
    pub count: u64,
    pub p50: u64,
    pub p90: u64,
    pub p99: u64,
    pub p999: u64,
    pub max: u64,
}

impl From<payload::LatencySummary> for Latency {
    fn from(summary: payload::LatencySummary) -> Self {
        let payload::LatencySummary { count, p50, p90, p99, p999, max } = summary;
        Self { count, p50, p90, p99, p999, max }
    }
}

/// Samples by the reason of their rejection: [`payload::Rejection`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Encode)]
#[allow(missing_docs)] // the payload's
pub struct Rejected {
    pub not_finite: u64,
    pub beyond_limits: u64,
    pub quaternion_norm: u64,
    pub repeated_stamp: u64,
    pub older_stamp: u64,
    pub too_old: u64,
    pub far_future: u64,
    pub sequence_backwards: u64,
    pub other_source: u64,
    pub malformed: u64,
    pub overload: u64,
}

/// One number for each channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Encode)]
#[allow(missing_docs)] // their names
pub struct PerChannel {
    pub translation: u64,
    pub rotation: u64,
    pub linear: u64,
}

impl From<[u64; 3]> for PerChannel {
    fn from([translation, rotation, linear]: [u64; 3]) -> Self {
        Self { translation, rotation, linear }
    }
}

/// A size for each channel, in the unit of its output.
#[derive(Debug, Clone, Copy, PartialEq, Encode)]
#[allow(missing_docs)] // their names
pub struct WidthPerChannel {
    pub translation: f64,
    pub rotation: f64,
    pub linear: f64,
}

/// [`payload::Status`], with what was granted in words.
#[derive(Debug, Clone, PartialEq, Encode)]
#[allow(missing_docs)] // the payload's
pub struct Status {
    pub sequence: u64,
    pub stamp_ns: u64,
    pub start_stamp_ns: u64,
    pub rate_millihertz: u64,
    pub dead_zone_width: WidthPerChannel,
    pub ticks: u64,
    pub deadline_misses: u64,
    pub samples_accepted: u64,
    pub samples_lost: u64,
    pub samples_rejected: Rejected,
    pub newest_sequence: u64,
    pub newest_sample_age_ns: Option<u64>,
    pub ticks_coasting: u64,
    pub ticks_clamped: u64,
    pub state_resets: u64,
    pub source_changes: u64,
    pub source_pid: u64,
    pub other_source_pid: u64,
    pub commands: u64,
    pub records_dropped: u64,
    pub adaptation_frozen: u64,
    pub outputs_held_back: PerChannel,
    pub outputs_stuck: PerChannel,
    pub late_ticks_in_a_row: u64,
    pub most_late_ticks_in_a_row: u64,
    pub ticks_predict_only: u64,
    pub ticks_invalid: u64,
    pub real_time_requested: String,
    pub real_time_granted: String,
    pub snapshot_restored: u64,
    pub snapshots_saved: u64,
    pub snapshots_failed: u64,
    pub snapshot_stamp_ns: u64,
    pub ticks_recorded: u64,
    pub ticks_not_recorded: u64,
    pub wake_up_lateness_ns: Latency,
    pub step_ns: Latency,
    pub input_age_ns: Latency,
    pub source_to_publish_ns: Latency,
}

impl From<&payload::Status> for Status {
    fn from(status: &payload::Status) -> Self {
        let rejected = |reason| status.rejected(reason);
        use payload::Rejection as R;
        let [translation, rotation, linear] = status.dead_zone_width;
        Self {
            sequence: status.sequence,
            stamp_ns: status.stamp_ns,
            start_stamp_ns: status.start_stamp_ns,
            rate_millihertz: status.rate_millihertz,
            dead_zone_width: WidthPerChannel { translation, rotation, linear },
            ticks: status.ticks,
            deadline_misses: status.deadline_misses,
            samples_accepted: status.samples_accepted,
            samples_lost: status.samples_lost,
            samples_rejected: Rejected {
                not_finite: rejected(R::NotFinite),
                beyond_limits: rejected(R::BeyondLimits),
                quaternion_norm: rejected(R::QuaternionNorm),
                repeated_stamp: rejected(R::RepeatedStamp),
                older_stamp: rejected(R::OlderStamp),
                too_old: rejected(R::TooOld),
                far_future: rejected(R::FarFuture),
                sequence_backwards: rejected(R::SequenceBackwards),
                other_source: rejected(R::OtherSource),
                malformed: rejected(R::Malformed),
                overload: rejected(R::Overload),
            },
            newest_sequence: status.newest_sequence,
            newest_sample_age_ns: Some(status.newest_sample_age_ns).filter(|&age_ns| age_ns != u64::MAX),
            ticks_coasting: status.ticks_coasting,
            ticks_clamped: status.ticks_clamped,
            state_resets: status.state_resets,
            source_changes: status.source_changes,
            source_pid: status.source_pid,
            other_source_pid: status.other_source_pid,
            commands: status.commands,
            records_dropped: status.records_dropped,
            adaptation_frozen: status.adaptation_frozen,
            outputs_held_back: status.outputs_held_back.into(),
            outputs_stuck: status.outputs_stuck.into(),
            late_ticks_in_a_row: status.late_ticks_in_a_row,
            most_late_ticks_in_a_row: status.most_late_ticks_in_a_row,
            ticks_predict_only: status.ticks_predict_only,
            ticks_invalid: status.ticks_invalid,
            real_time_requested: real_time::words(status.real_time_requested).join(", "),
            real_time_granted: real_time::words(status.real_time_granted).join(", "),
            snapshot_restored: status.snapshot_restored,
            snapshots_saved: status.snapshots_saved,
            snapshots_failed: status.snapshots_failed,
            snapshot_stamp_ns: status.snapshot_stamp_ns,
            ticks_recorded: status.ticks_recorded,
            ticks_not_recorded: status.ticks_not_recorded,
            wake_up_lateness_ns: status.wake_up_lateness_ns.into(),
            step_ns: status.step_ns.into(),
            input_age_ns: status.input_age_ns.into(),
            source_to_publish_ns: status.source_to_publish_ns.into(),
        }
    }
}

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
        let is_known = estimate.status & status_bits::WAITING == 0 && !has_linear_plant(estimate);
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
    fn what_a_sample_does_not_carry_is_absent() {
        let sample = payload::Measurement::at(5, 2).with_velocity_m_s([-0.0, f64::INFINITY, 1.0]);
        let message = Measurement::from(&sample);
        assert_eq!((message.position_m, message.output.len()), (None, 0));
        let mut bytes = Vec::new();
        message.encode(&mut bytes).unwrap();
        let negative_zero = (-0.0_f64).to_le_bytes();
        assert!(bytes.windows(8).any(|window| window == negative_zero), "{bytes:?}");
    }

    #[test]
    fn before_the_first_sample_and_of_a_linear_plant_there_is_no_motion() {
        let waiting = payload::Estimate { status: status_bits::WAITING, ..Default::default() };
        assert_eq!(Motion::estimated(&waiting), None);
        let mut linear = payload::Estimate::default();
        linear.linear.error_bound = 1.0;
        assert_eq!(Motion::estimated(&linear), None);
        assert!(Estimate::from(&linear).linear.is_some() && Estimate::from(&waiting).linear.is_none());
        assert!(Motion::estimated(&payload::Estimate::default()).is_some());
    }
}
