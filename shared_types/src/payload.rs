//! The messages. `#[repr(C)]`, fixed size, no padding, all SI; a change of layout is a new type name.
//!
//! Frames: I is inertial, J the body, both right-handed; `attitude_wxyz` rotates body vectors into I.

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

/// Bits of [`Measurement::valid`]: which fields carry a measurement.
pub mod valid {
    /// `velocity_m_s`, in the frame that `velocity_frame` names.
    pub const VELOCITY: u32 = 1 << 0;
    /// `angular_velocity_rad_s`.
    pub const ANGULAR_VELOCITY: u32 = 1 << 1;
    /// `position_m`.
    pub const POSITION: u32 = 1 << 2;
    /// `attitude_wxyz`.
    pub const ATTITUDE: u32 = 1 << 3;
    /// `force_n`: replaces the held command. Until the first one the command is zero.
    pub const FORCE: u32 = 1 << 4;
    /// `torque_n_m`: replaces the held command. Until the first one the command is zero.
    pub const TORQUE: u32 = 1 << 5;
    /// Every field of a rigid body.
    pub const RIGID_BODY: u32 = (1 << 6) - 1;
    /// `output` of a general linear plant.
    pub const OUTPUT: u32 = 1 << 6;
    /// `input` of a general linear plant: replaces the held one. Until the first one it is zero.
    pub const INPUT: u32 = 1 << 7;
    /// Every bit that has a meaning.
    pub const ALL: u32 = (1 << 8) - 1;
}

/// Values of [`Measurement::velocity_frame`].
pub mod frame {
    /// Components along the inertial axes.
    pub const INERTIAL: u32 = 0;
    /// Components along the body axes (a Doppler log).
    pub const BODY: u32 = 1;
}

/// Bits of [`Estimate::status`].
pub mod status_bits {
    /// Every configured channel follows measurements that it holds now.
    pub const TRACKING: u64 = 1 << 0;
    /// The translation channel predicts without a velocity measurement.
    pub const COASTING_TRANSLATION: u64 = 1 << 1;
    /// The rotation channel predicts without an angular-velocity measurement.
    pub const COASTING_ROTATION: u64 = 1 << 2;
    /// The general linear plant's channel predicts without an output.
    pub const COASTING_LINEAR: u64 = 1 << 11;
    /// Any channel coasts.
    pub const COASTING: u64 = COASTING_TRANSLATION | COASTING_ROTATION | COASTING_LINEAR;
    /// No sample for longer than `stale_after_s`, or none yet: do not fly on this.
    pub const STALE: u64 = 1 << 3;
    /// A channel's dead zone is open: the unknown force is being learned now.
    pub const ADAPTING: u64 = 1 << 4;
    /// Adaptation was frozen by an operator.
    pub const FROZEN: u64 = 1 << 5;
    /// The held output lies outside the box of the kernel centers: nothing was learned there.
    pub const OUTSIDE_CENTERS: u64 = 1 << 6;
    /// A sample was rejected since the previous estimate.
    pub const REJECTED_SAMPLE: u64 = 1 << 7;
    /// The dead zone's output was clamped to the stability bound of the sampled law.
    pub const CLAMPED: u64 = 1 << 8;
    /// The state was not finite or beyond limits and was reset to the last good copy.
    pub const DIVERGED: u64 = 1 << 9;
    /// No sample was ever accepted: the estimate is the initial state.
    pub const WAITING: u64 = 1 << 10;
    /// The tick before ended after its next deadline: the loop is late.
    pub const LATE: u64 = 1 << 12;
    /// The loop was late so many times in a row that samples are not used: the estimate is predicted only.
    pub const PREDICT_ONLY: u64 = 1 << 13;
    /// The loop was late for so long that the estimate is not to be used at all: do not fly on this.
    pub const INVALID: u64 = 1 << 14;
    /// An output that is implausible against its recent errors was held back since the previous estimate.
    pub const HELD_BACK: u64 = 1 << 15;
    /// A sensor repeats one value to the bit.
    pub const STUCK: u64 = 1 << 16;

    const WORDS: [(u64, &str); 17] = [
        (TRACKING, "tracking"),
        (COASTING_TRANSLATION, "coasting-translation"),
        (COASTING_ROTATION, "coasting-rotation"),
        (STALE, "stale"),
        (ADAPTING, "adapting"),
        (FROZEN, "frozen"),
        (OUTSIDE_CENTERS, "outside-centers"),
        (REJECTED_SAMPLE, "rejected-sample"),
        (CLAMPED, "clamped"),
        (DIVERGED, "diverged"),
        (WAITING, "waiting"),
        (COASTING_LINEAR, "coasting-linear"),
        (LATE, "late"),
        (PREDICT_ONLY, "predict-only"),
        (INVALID, "invalid"),
        (HELD_BACK, "held-back"),
        (STUCK, "stuck-sensor"),
    ];

    /// The set bits in words, for people.
    pub fn words(status: u64) -> Vec<&'static str> {
        WORDS.iter().filter(|(bit, _)| status & bit != 0).map(|&(_, word)| word).collect()
    }
}

/// One set of sensor readings and commands, all taken at `stamp_ns`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Serialize, Deserialize)]
#[type_name("observer.Measurement.v2")]
pub struct Measurement {
    /// Counts from 0, one up per sample; a gap counts as loss.
    pub sequence: u64,
    /// CLOCK_MONOTONIC of the source when the readings were taken (ns).
    pub stamp_ns: u64,
    /// Which of the fields below are valid: bits of [`valid`].
    pub valid: u32,
    /// Frame of `velocity_m_s`: [`frame::INERTIAL`] or [`frame::BODY`].
    pub velocity_frame: u32,
    /// Velocity of the center of mass (m/s).
    pub velocity_m_s: [f64; 3],
    /// Angular velocity, body axes (rad/s).
    pub angular_velocity_rad_s: [f64; 3],
    /// Position fix, inertial (m).
    pub position_m: [f64; 3],
    /// Attitude fix, unit quaternion w, x, y, z, body to inertial.
    pub attitude_wxyz: [f64; 4],
    /// Commanded force, inertial axes (N), held until the next one.
    pub force_n: [f64; 3],
    /// Commanded torque, body axes (N·m), held until the next one.
    pub torque_n_m: [f64; 3],
    /// y of a general linear plant, its first m entries, in the units of its configuration.
    pub output: [f64; 6],
    /// u of a general linear plant, its first m entries, held until the next one.
    pub input: [f64; 6],
}

impl Measurement {
    /// A sample without any valid field yet.
    pub fn at(stamp_ns: u64, sequence: u64) -> Self {
        Self { stamp_ns, sequence, ..Self::default() }
    }

    /// Adds an inertial velocity.
    pub fn with_velocity_m_s(mut self, velocity_m_s: [f64; 3]) -> Self {
        (self.velocity_m_s, self.velocity_frame) = (velocity_m_s, frame::INERTIAL);
        self.valid |= valid::VELOCITY;
        self
    }

    /// Adds a velocity along the body axes.
    pub fn with_body_velocity_m_s(mut self, velocity_m_s: [f64; 3]) -> Self {
        (self.velocity_m_s, self.velocity_frame) = (velocity_m_s, frame::BODY);
        self.valid |= valid::VELOCITY;
        self
    }

    /// Adds an angular velocity, body axes.
    pub fn with_angular_velocity_rad_s(mut self, angular_velocity_rad_s: [f64; 3]) -> Self {
        self.angular_velocity_rad_s = angular_velocity_rad_s;
        self.valid |= valid::ANGULAR_VELOCITY;
        self
    }

    /// Adds a position fix.
    pub fn with_position_m(mut self, position_m: [f64; 3]) -> Self {
        self.position_m = position_m;
        self.valid |= valid::POSITION;
        self
    }

    /// Adds an attitude fix.
    pub fn with_attitude_wxyz(mut self, attitude_wxyz: [f64; 4]) -> Self {
        self.attitude_wxyz = attitude_wxyz;
        self.valid |= valid::ATTITUDE;
        self
    }

    /// Adds a commanded force, inertial axes.
    pub fn with_force_n(mut self, force_n: [f64; 3]) -> Self {
        self.force_n = force_n;
        self.valid |= valid::FORCE;
        self
    }

    /// Adds a commanded torque, body axes.
    pub fn with_torque_n_m(mut self, torque_n_m: [f64; 3]) -> Self {
        self.torque_n_m = torque_n_m;
        self.valid |= valid::TORQUE;
        self
    }

    /// Adds the output of a general linear plant.
    ///
    /// # Panics
    /// With more than 6 numbers.
    pub fn with_output(mut self, output: &[f64]) -> Self {
        self.output[..output.len()].copy_from_slice(output);
        self.valid |= valid::OUTPUT;
        self
    }

    /// Adds the commanded input of a general linear plant.
    ///
    /// # Panics
    /// With more than 6 numbers.
    pub fn with_input(mut self, input: &[f64]) -> Self {
        self.input[..input.len()].copy_from_slice(input);
        self.valid |= valid::INPUT;
        self
    }

    /// Whether every value that is measured is a finite number.
    pub fn is_finite(&self) -> bool {
        let fields: [(u32, &[f64]); 8] = [
            (valid::VELOCITY, &self.velocity_m_s),
            (valid::ANGULAR_VELOCITY, &self.angular_velocity_rad_s),
            (valid::POSITION, &self.position_m),
            (valid::ATTITUDE, &self.attitude_wxyz),
            (valid::FORCE, &self.force_n),
            (valid::TORQUE, &self.torque_n_m),
            (valid::OUTPUT, &self.output),
            (valid::INPUT, &self.input),
        ];
        fields.iter().all(|(bit, values)| !self.has(*bit) || values.iter().all(|value| value.is_finite()))
    }

    /// Whether all the given bits of [`valid`] are set.
    pub fn has(&self, bits: u32) -> bool {
        self.valid & bits == bits
    }
}

/// A measured attitude's norm may differ from 1 by this much: single precision and a little more.
pub const QUATERNION_NORM_TOLERANCE: f64 = 1e-3;
/// A sequence further ahead than this is no gap but a damaged number.
pub const MAX_SEQUENCE_GAP: u64 = 1_000_000;

/// How far one channel's estimate can be trusted.
///
/// Units are those of the channel's output: m/s for translation, rad/s for rotation, of the configuration for a
/// general linear plant; forces N or N·m.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Serialize, Deserialize)]
#[type_name("observer.Channel.v2")]
pub struct Channel {
    /// ‖ỹ‖ = ‖y − Cx̂‖ at the held sample; 0 while coasting.
    pub output_error: f64,
    /// σ, the dead zone's output now: 0 is closed, nothing is learned.
    pub activation: f64,
    /// P_N(y) / √κ(0), 0 … 1: 0 at a center, 1 where the centers cover nothing.
    pub power_function: f64,
    /// ‖f̂_N‖ in the native space.
    pub native_norm: f64,
    /// How far the learned force may be from that of the dense solver (N; N·m): the local solver's estimate of its own
    /// error; 0 where the dense one is in use.
    pub solver_error: f64,
    /// max(d, d_N): the size that the theorems claim ‖e‖ settles below, if their conditions hold (`daemon check`
    /// tells). A bound, not a covariance; +∞ while coasting.
    pub error_bound: f64,
    /// Time since the stamp of the newest output measurement (s); +∞ before the first.
    pub output_age_s: f64,
}

/// The state estimate at `stamp_ns`, and how far it can be trusted.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Serialize, Deserialize)]
#[type_name("observer.Estimate.v3")]
pub struct Estimate {
    /// Counts the service's publications from 0.
    pub sequence: u64,
    /// Sequence of the newest sample that went into this estimate.
    pub source_sequence: u64,
    /// Time of the state (ns).
    pub stamp_ns: u64,
    /// Stamp of the newest sample that went into this estimate (ns); 0 before the first.
    pub source_stamp_ns: u64,
    /// CLOCK_MONOTONIC just before publication (ns).
    pub publish_stamp_ns: u64,
    /// Bits of [`status_bits`].
    pub status: u64,
    /// Position, inertial (m). Dead-reckoned from velocity unless position fixes are used.
    pub position_m: [f64; 3],
    /// Velocity, inertial (m/s).
    pub velocity_m_s: [f64; 3],
    /// Attitude, unit quaternion w, x, y, z, body to inertial.
    pub attitude_wxyz: [f64; 4],
    /// 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π].
    pub euler_rad: [f64; 3],
    /// Angular velocity, body axes (rad/s).
    pub angular_velocity_rad_s: [f64; 3],
    /// f̂: the learned unknown force, inertial axes (N).
    pub matched_force_n: [f64; 3],
    /// f̂: the learned unknown torque, body axes (N·m).
    pub matched_torque_n_m: [f64; 3],
    /// Trust in position, velocity and force.
    pub translation: Channel,
    /// Trust in attitude, angular velocity and torque.
    pub rotation: Channel,
    /// x̂ of a general linear plant, its first n entries, in the units of its configuration.
    pub state: [f64; 12],
    /// f̂ of a general linear plant, its first m entries.
    pub matched_input: [f64; 6],
    /// Trust in `state` and `matched_input`.
    pub linear: Channel,
}

impl Estimate {
    /// Whether every component of state and forces is a finite number.
    pub fn is_finite(&self) -> bool {
        let vectors = [
            self.position_m,
            self.velocity_m_s,
            self.euler_rad,
            self.angular_velocity_rad_s,
            self.matched_force_n,
            self.matched_torque_n_m,
        ];
        let linear = self.state.iter().chain(&self.matched_input);
        vectors
            .iter()
            .flatten()
            .chain(&self.attitude_wxyz)
            .chain(linear)
            .all(|component| component.is_finite())
    }
}

/// Quantiles of one latency (ns) since the service started.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend, Serialize, Deserialize)]
#[type_name("observer.LatencySummary.v1")]
pub struct LatencySummary {
    /// Number of values.
    pub count: u64,
    /// Median.
    pub p50: u64,
    /// 90 % quantile.
    pub p90: u64,
    /// 99 % quantile.
    pub p99: u64,
    /// 99.9 % quantile.
    pub p999: u64,
    /// Largest value.
    pub max: u64,
}

/// Why a sample was rejected; the value is its index in [`Status::samples_rejected`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Rejection {
    /// A valid field is NaN or infinite.
    NotFinite,
    /// A valid field is beyond the configured physical limit.
    BeyondLimits,
    /// The attitude is not of unit norm.
    QuaternionNorm,
    /// The stamp is the same as the newest accepted one.
    RepeatedStamp,
    /// The stamp is older than the newest accepted one.
    OlderStamp,
    /// The stamp lies too far behind the clock.
    TooOld,
    /// The stamp lies too far ahead of the clock.
    FarFuture,
    /// The sequence went backwards although the source is the same.
    SequenceBackwards,
    /// Another source holds the stream.
    OtherSource,
    /// No valid field, an unknown bit or an unknown frame.
    Malformed,
    /// The loop was late for too long to use it.
    Overload,
}

impl Rejection {
    /// All reasons, in the order of [`Status::samples_rejected`].
    pub const ALL: [Self; 11] = [
        Self::NotFinite,
        Self::BeyondLimits,
        Self::QuaternionNorm,
        Self::RepeatedStamp,
        Self::OlderStamp,
        Self::TooOld,
        Self::FarFuture,
        Self::SequenceBackwards,
        Self::OtherSource,
        Self::Malformed,
        Self::Overload,
    ];

    /// The reason in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::NotFinite => "not finite",
            Self::BeyondLimits => "beyond physical limits",
            Self::QuaternionNorm => "quaternion not of unit norm",
            Self::RepeatedStamp => "repeated stamp",
            Self::OlderStamp => "older stamp",
            Self::TooOld => "too far behind the clock",
            Self::FarFuture => "too far ahead of the clock",
            Self::SequenceBackwards => "sequence went backwards",
            Self::OtherSource => "another source holds the stream",
            Self::Malformed => "malformed",
            Self::Overload => "the loop was late",
        }
    }
}

/// Bits of [`Status::real_time_requested`] and [`Status::real_time_granted`].
pub mod real_time {
    /// A fixed priority (SCHED_FIFO) for the loop.
    pub const PRIORITY: u64 = 1 << 0;
    /// Cores of the loop's own choice.
    pub const CORES: u64 = 1 << 1;
    /// Memory that is neither swapped out nor mapped late.
    pub const LOCKED_MEMORY: u64 = 1 << 2;
    /// Timers without slack.
    pub const PUNCTUAL_TIMERS: u64 = 1 << 3;
    /// Cores that wake up at once.
    pub const AWAKE_CORES: u64 = 1 << 4;

    const WORDS: [(u64, &str); 5] = [
        (PRIORITY, "priority"),
        (CORES, "cores"),
        (LOCKED_MEMORY, "locked memory"),
        (PUNCTUAL_TIMERS, "punctual timers"),
        (AWAKE_CORES, "awake cores"),
    ];

    /// The set bits in words, for people.
    pub fn words(bits: u64) -> Vec<&'static str> {
        WORDS.iter().filter(|(bit, _)| bits & bit != 0).map(|&(_, word)| word).collect()
    }
}

/// Values of [`Status::snapshot_restored`].
pub mod restored {
    /// The service started with nothing learned.
    pub const NOTHING: u64 = 0;
    /// It started with what an earlier one had learned.
    pub const LEARNED: u64 = 1;
    /// It started with that and with the state, and goes on from there.
    pub const LEARNED_AND_STATE: u64 = 2;
}

/// What the service did since it started.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Serialize, Deserialize)]
#[type_name("observer.Status.v3")]
pub struct Status {
    /// Counts publications from 0.
    pub sequence: u64,
    /// CLOCK_MONOTONIC of this status (ns).
    pub stamp_ns: u64,
    /// CLOCK_MONOTONIC of the service's start (ns).
    pub start_stamp_ns: u64,
    /// Configured rate (mHz: 200 Hz is 200 000).
    pub rate_millihertz: u64,
    /// d, the width of the dead zone of translation (m/s), rotation (rad/s), linear plant (its output's unit): up to
    /// it an output error is noise, and nothing is learned; 0 where there is no such channel.
    pub dead_zone_width: [f64; 3],
    /// Ticks served, each with one estimate.
    pub ticks: u64,
    /// Deadlines that passed unserved because a tick ended too late; they were skipped.
    pub deadline_misses: u64,
    /// Samples used.
    pub samples_accepted: u64,
    /// Gaps in the source's sequence: samples that never arrived.
    pub samples_lost: u64,
    /// Samples rejected, by [`Rejection`].
    pub samples_rejected: [u64; 11],
    /// Sequence of the newest accepted sample.
    pub newest_sequence: u64,
    /// Age of the newest accepted sample (ns); `u64::MAX` before the first.
    pub newest_sample_age_ns: u64,
    /// Ticks on which a channel coasted.
    pub ticks_coasting: u64,
    /// Ticks on which the dead zone's output was clamped to the stability bound.
    pub ticks_clamped: u64,
    /// Times the state was reset to the last good copy.
    pub state_resets: u64,
    /// Times the source restarted or another one took over.
    pub source_changes: u64,
    /// Process id of the source in use; 0 if none or unknown.
    pub source_pid: u64,
    /// Process id of another source that publishes too; 0 if none.
    pub other_source_pid: u64,
    /// Commands carried out.
    pub commands: u64,
    /// Tick records that the status thread was too slow to take.
    pub records_dropped: u64,
    /// 1 while adaptation is frozen by an operator.
    pub adaptation_frozen: u64,
    /// Outputs whose error was implausible against its running scale, and which were held back from adaptation or
    /// from correction too: of translation, rotation, linear plant.
    pub outputs_held_back: [u64; 3],
    /// Outputs that repeated the one before to the bit, for longer than a living sensor does; likewise.
    pub outputs_stuck: [u64; 3],
    /// Ticks in a row that ended after their next deadline, now.
    pub late_ticks_in_a_row: u64,
    /// The most so far.
    pub most_late_ticks_in_a_row: u64,
    /// Ticks on which samples were not used because the loop was late.
    pub ticks_predict_only: u64,
    /// Ticks whose estimate was marked invalid.
    pub ticks_invalid: u64,
    /// Real-time settings that the configuration asks for: bits of [`real_time`].
    pub real_time_requested: u64,
    /// Real-time settings that the system granted.
    pub real_time_granted: u64,
    /// What was restored at the start: one of [`restored`].
    pub snapshot_restored: u64,
    /// Snapshots written.
    pub snapshots_saved: u64,
    /// Snapshots that could not be written.
    pub snapshots_failed: u64,
    /// CLOCK_MONOTONIC of the state in the newest snapshot of this service (ns); 0 if none.
    pub snapshot_stamp_ns: u64,
    /// Ticks written to the flight record.
    pub ticks_recorded: u64,
    /// Ticks that the recorder was too slow to take.
    pub ticks_not_recorded: u64,
    /// Deadline to wake-up (ns).
    pub wake_up_lateness_ns: LatencySummary,
    /// Wake-up to publication: samples taken, stepped, estimate written (ns).
    pub step_ns: LatencySummary,
    /// Source stamp of the newest sample to wake-up, on ticks with a new sample (ns).
    pub input_age_ns: LatencySummary,
    /// Source stamp of the newest sample to publication, on ticks with a new sample (ns).
    pub source_to_publish_ns: LatencySummary,
}

impl Status {
    /// Samples rejected for any reason.
    pub fn samples_rejected_total(&self) -> u64 {
        self.samples_rejected.iter().sum()
    }

    /// Samples rejected for one reason.
    pub fn rejected(&self, reason: Rejection) -> u64 {
        self.samples_rejected[reason as usize]
    }
}

/// The true plant at `stamp_ns`, from the simulator.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Serialize, Deserialize)]
#[type_name("observer.Truth.v1")]
pub struct Truth {
    /// Sequence of the sample taken at the same time.
    pub sequence: u64,
    /// Time of the state (ns).
    pub stamp_ns: u64,
    /// Position, inertial (m).
    pub position_m: [f64; 3],
    /// Velocity, inertial (m/s).
    pub velocity_m_s: [f64; 3],
    /// Attitude, unit quaternion w, x, y, z, body to inertial.
    pub attitude_wxyz: [f64; 4],
    /// Angular velocity, body axes (rad/s).
    pub angular_velocity_rad_s: [f64; 3],
    /// f: everything that the nominal plant leaves out and that depends on the motion, inertial (N).
    pub matched_force_n: [f64; 3],
    /// f of the rotation, body axes (N·m).
    pub matched_torque_n_m: [f64; 3],
    /// ξ: gusts and the like, which are no function of the motion, inertial (N).
    pub unmatched_force_n: [f64; 3],
    /// ξ of the rotation, body axes (N·m).
    pub unmatched_torque_n_m: [f64; 3],
}

/// Values of [`Command::kind`].
pub mod command {
    /// Forget state and weights; start again from the next sample.
    pub const RESET: u32 = 1;
    /// Stop learning; keep using what was learned.
    pub const FREEZE: u32 = 2;
    /// Learn again.
    pub const THAW: u32 = 3;
    /// Write the learned weights to disk.
    pub const SAVE: u32 = 4;
    /// Only answer with the status.
    pub const STATUS: u32 = 5;
}

/// An operator's request.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("observer.Command.v1")]
pub struct Command {
    /// One of [`command`].
    pub kind: u32,
    /// Zero.
    pub reserved: u32,
}

/// Values of [`Reply::outcome`].
pub mod outcome {
    /// Done: the loop has carried the command out.
    pub const DONE: u32 = 0;
    /// Refused: `message` says why.
    pub const REFUSED: u32 = 1;
    /// The command's kind is unknown to this service.
    pub const UNKNOWN: u32 = 2;
}

/// The service's answer, with its status after the command.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("observer.Reply.v3")]
pub struct Reply {
    /// One of [`outcome`].
    pub outcome: u32,
    /// Bytes of `message` in use.
    pub message_bytes: u32,
    /// UTF-8 text.
    pub message: [u8; 248],
    /// Status after the command.
    pub status: Status,
}

impl Default for Reply {
    fn default() -> Self {
        Self::new(outcome::DONE, "", Status::default())
    }
}

impl Reply {
    /// A reply whose text is cut at a character's boundary if it does not fit.
    pub fn new(outcome: u32, text: &str, status: Status) -> Self {
        let mut message = [0; 248];
        let end = text.floor_char_boundary(message.len());
        message[..end].copy_from_slice(&text.as_bytes()[..end]);
        Self { outcome, message_bytes: end as u32, message, status }
    }

    /// The text, or nothing where the bytes are no text.
    pub fn text(&self) -> &str {
        let end = (self.message_bytes as usize).min(self.message.len());
        str::from_utf8(&self.message[..end]).unwrap_or("")
    }
}

/// The layout is the contract with other languages: checked when this crate is compiled.
const _: () = {
    use core::mem::{align_of, offset_of, size_of};
    assert!(size_of::<Measurement>() == 272 && align_of::<Measurement>() == 8);
    assert!(offset_of!(Measurement, stamp_ns) == 8);
    assert!(offset_of!(Measurement, valid) == 16);
    assert!(offset_of!(Measurement, velocity_frame) == 20);
    assert!(offset_of!(Measurement, velocity_m_s) == 24);
    assert!(offset_of!(Measurement, angular_velocity_rad_s) == 48);
    assert!(offset_of!(Measurement, position_m) == 72);
    assert!(offset_of!(Measurement, attitude_wxyz) == 96);
    assert!(offset_of!(Measurement, force_n) == 128);
    assert!(offset_of!(Measurement, torque_n_m) == 152);
    assert!(offset_of!(Measurement, output) == 176);
    assert!(offset_of!(Measurement, input) == 224);

    assert!(size_of::<Channel>() == 56);
    assert!(size_of::<Estimate>() == 536 && align_of::<Estimate>() == 8);
    assert!(offset_of!(Estimate, source_sequence) == 8);
    assert!(offset_of!(Estimate, stamp_ns) == 16);
    assert!(offset_of!(Estimate, source_stamp_ns) == 24);
    assert!(offset_of!(Estimate, publish_stamp_ns) == 32);
    assert!(offset_of!(Estimate, status) == 40);
    assert!(offset_of!(Estimate, position_m) == 48);
    assert!(offset_of!(Estimate, velocity_m_s) == 72);
    assert!(offset_of!(Estimate, attitude_wxyz) == 96);
    assert!(offset_of!(Estimate, euler_rad) == 128);
    assert!(offset_of!(Estimate, angular_velocity_rad_s) == 152);
    assert!(offset_of!(Estimate, matched_force_n) == 176);
    assert!(offset_of!(Estimate, matched_torque_n_m) == 200);
    assert!(offset_of!(Estimate, translation) == 224);
    assert!(offset_of!(Estimate, rotation) == 280);
    assert!(offset_of!(Estimate, state) == 336);
    assert!(offset_of!(Estimate, matched_input) == 432);
    assert!(offset_of!(Estimate, linear) == 480);

    assert!(size_of::<LatencySummary>() == 48);
    assert!(size_of::<Status>() == 51 * 8 + 4 * 48);
    assert!(offset_of!(Status, dead_zone_width) == 32);
    assert!(offset_of!(Status, samples_rejected) == 88);
    assert!(offset_of!(Status, newest_sequence) == 176);
    assert!(offset_of!(Status, outputs_held_back) == 264);
    assert!(offset_of!(Status, wake_up_lateness_ns) == 408);

    assert!(size_of::<Truth>() == 16 + 25 * 8);
    assert!(offset_of!(Truth, unmatched_torque_n_m) == 192);

    assert!(size_of::<Command>() == 8);
    assert!(size_of::<Reply>() == 256 + size_of::<Status>());
    assert!(offset_of!(Reply, message) == 8 && offset_of!(Reply, status) == 256);
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reply_cuts_its_text_at_a_character() {
        let long = "ä".repeat(200);
        let reply = Reply::new(outcome::REFUSED, &long, Status::default());
        assert_eq!(reply.text(), "ä".repeat(124));
        assert_eq!(Reply { message_bytes: u32::MAX, ..reply }.text(), "ä".repeat(124));
    }

    #[test]
    fn every_rejection_has_its_own_counter() {
        for (index, reason) in Rejection::ALL.into_iter().enumerate() {
            assert_eq!(reason as usize, index, "{}", reason.words());
        }
    }

    #[test]
    fn status_words_name_every_bit_once() {
        assert_eq!(status_bits::words(u64::MAX).len(), 17);
        let coasting = ["coasting-translation", "coasting-rotation", "coasting-linear"];
        assert_eq!(status_bits::words(status_bits::COASTING), coasting);
    }
}
