"""The messages, as they lie in shared memory: fixed size, no padding, all SI.

Written from the Rust types by `UPDATE_PYTHON=1 cargo test -p daemon --test daemon python`: not to be edited.

Frames: I is inertial, J the body, both right-handed; `attitude_wxyz` rotates body vectors into I.
"""

import ctypes

from .structure import EstimateStructure, ReplyStructure, StatusStructure, Structure, array


class valid:
    """Bits of `Measurement.valid`: which fields carry a measurement."""

    # `velocity_m_s`, in the frame that `velocity_frame` names.
    VELOCITY = 1

    # `angular_velocity_rad_s`.
    ANGULAR_VELOCITY = 2

    # `position_m`.
    POSITION = 4

    # `attitude_wxyz`.
    ATTITUDE = 8

    # `force_n`: replaces the held command. Until the first one the command is zero.
    FORCE = 16

    # `torque_n_m`: replaces the held command. Until the first one the command is zero.
    TORQUE = 32

    # Every field of a rigid body.
    RIGID_BODY = 63

    # `output` of a general linear plant.
    OUTPUT = 64

    # `input` of a general linear plant: replaces the held one. Until the first one it is zero.
    INPUT = 128

    # Every bit that has a meaning.
    ALL = 255


class frame:
    """Values of `Measurement.velocity_frame`."""

    # Components along the inertial axes.
    INERTIAL = 0

    # Components along the body axes (a Doppler log).
    BODY = 1


class status_bits:
    """Bits of `Estimate.status`."""

    # Every configured channel follows measurements that it holds now.
    TRACKING = 1

    # The translation channel predicts without a velocity measurement.
    COASTING_TRANSLATION = 2

    # The rotation channel predicts without an angular-velocity measurement.
    COASTING_ROTATION = 4

    # The general linear plant's channel predicts without an output.
    COASTING_LINEAR = 2048

    # Any channel coasts.
    COASTING = 2054

    # No sample for longer than `stale_after_s`, or none yet: do not fly on this.
    STALE = 8

    # A channel's dead zone is open: the unknown force is being learned now.
    ADAPTING = 16

    # Adaptation was frozen by an operator.
    FROZEN = 32

    # The held output lies outside the box of the kernel centers: nothing was learned there.
    OUTSIDE_CENTERS = 64

    # A sample was rejected since the previous estimate.
    REJECTED_SAMPLE = 128

    # The dead zone's output was clamped to the stability bound of the sampled law.
    CLAMPED = 256

    # The state was not finite or beyond limits and was reset to the last good copy.
    DIVERGED = 512

    # No sample was ever accepted: the estimate is the initial state.
    WAITING = 1024

    # The tick before ended after its next deadline: the loop is late.
    LATE = 4096

    # The loop was late so many times in a row that samples are not used: the estimate is predicted only.
    PREDICT_ONLY = 8192

    # The loop was late for so long that the estimate is not to be used at all: do not fly on this.
    INVALID = 16384

    # An output that is implausible against its recent errors was held back since the previous estimate.
    HELD_BACK = 32768

    # A sensor repeats one value to the bit.
    STUCK = 65536


class real_time:
    """Bits of `Status.real_time_requested` and `Status.real_time_granted`."""

    # A fixed priority (SCHED_FIFO) for the loop.
    PRIORITY = 1

    # Cores of the loop's own choice.
    CORES = 2

    # Memory that is neither swapped out nor mapped late.
    LOCKED_MEMORY = 4

    # Timers without slack.
    PUNCTUAL_TIMERS = 8

    # Cores that wake up at once.
    AWAKE_CORES = 16


class restored:
    """Values of `Status.snapshot_restored`."""

    # The service started with nothing learned.
    NOTHING = 0

    # It started with what an earlier one had learned.
    LEARNED = 1

    # It started with that and with the state, and goes on from there.
    LEARNED_AND_STATE = 2


class command:
    """Values of `Command.kind`."""

    # Forget state and weights; start again from the next sample.
    RESET = 1

    # Stop learning; keep using what was learned.
    FREEZE = 2

    # Learn again.
    THAW = 3

    # Write the learned weights to disk.
    SAVE = 4

    # Only answer with the status.
    STATUS = 5


class outcome:
    """Values of `Reply.outcome`."""

    # Done: the loop has carried the command out.
    DONE = 0

    # Refused: `message` says why.
    REFUSED = 1

    # The command's kind is unknown to this service.
    UNKNOWN = 2


#: Words for bits of `Estimate.status`.
STATUS_WORDS = {
    1: "tracking",
    2: "coasting-translation",
    4: "coasting-rotation",
    8: "stale",
    16: "adapting",
    32: "frozen",
    64: "outside-centers",
    128: "rejected-sample",
    256: "clamped",
    512: "diverged",
    1024: "waiting",
    2048: "coasting-linear",
    4096: "late",
    8192: "predict-only",
    16384: "invalid",
    32768: "held-back",
    65536: "stuck-sensor",
}


#: Words for bits of `Status.real_time_granted`.
REAL_TIME_WORDS = {
    1: "priority",
    2: "cores",
    4: "locked memory",
    8: "punctual timers",
    16: "awake cores",
}


#: Why samples were rejected, in the order of `Status.samples_rejected`.
REJECTION_WORDS = (
    "not finite",
    "beyond physical limits",
    "quaternion not of unit norm",
    "repeated stamp",
    "older stamp",
    "too far behind the clock",
    "too far ahead of the clock",
    "sequence went backwards",
    "another source holds the stream",
    "malformed",
    "the loop was late",
)


class Measurement(Structure):
    """One set of sensor readings and commands, all taken at `stamp_ns`."""

    TYPE_NAME = "observer.Measurement.v2"

    # Counts from 0, one up per sample; a gap counts as loss.
    sequence: int

    # CLOCK_MONOTONIC of the source when the readings were taken (ns).
    stamp_ns: int

    # Which of the fields below are valid: bits of `valid`.
    valid: int

    # Frame of `velocity_m_s`: `frame.INERTIAL` or `frame.BODY`.
    velocity_frame: int

    # Velocity of the center of mass (m/s).
    velocity_m_s: ctypes.Array

    # Angular velocity, body axes (rad/s).
    angular_velocity_rad_s: ctypes.Array

    # Position fix, inertial (m).
    position_m: ctypes.Array

    # Attitude fix, unit quaternion w, x, y, z, body to inertial.
    attitude_wxyz: ctypes.Array

    # Commanded force, inertial axes (N), held until the next one.
    force_n: ctypes.Array

    # Commanded torque, body axes (N·m), held until the next one.
    torque_n_m: ctypes.Array

    # y of a general linear plant, its first m entries, in the units of its configuration.
    output: ctypes.Array

    # u of a general linear plant, its first m entries, held until the next one.
    input: ctypes.Array

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("valid", ctypes.c_uint32),
        ("velocity_frame", ctypes.c_uint32),
        ("velocity_m_s", array(ctypes.c_double, 3)),
        ("angular_velocity_rad_s", array(ctypes.c_double, 3)),
        ("position_m", array(ctypes.c_double, 3)),
        ("attitude_wxyz", array(ctypes.c_double, 4)),
        ("force_n", array(ctypes.c_double, 3)),
        ("torque_n_m", array(ctypes.c_double, 3)),
        ("output", array(ctypes.c_double, 6)),
        ("input", array(ctypes.c_double, 6)),
    ]


class Channel(Structure):
    """How far one channel's estimate can be trusted.  Units are those of the channel's output: m/s for
    translation, rad/s for rotation, of the configuration for a general linear plant; forces N or N·m."""

    TYPE_NAME = "observer.Channel.v2"

    # ‖ỹ‖ = ‖y − Cx̂‖ at the held sample; 0 while coasting.
    output_error: float

    # σ, the dead zone's output now: 0 is closed, nothing is learned.
    activation: float

    # P_N(y) / √κ(0), 0 … 1: 0 at a center, 1 where the centers cover nothing.
    power_function: float

    # ‖f̂_N‖ in the native space.
    native_norm: float

    # How far the learned force may be from that of the dense solver (N; N·m): the local solver's estimate of
    # its own error; 0 where the dense one is in use.
    solver_error: float

    # max(d, d_N): the size that the theorems claim ‖e‖ settles below, if their conditions hold (`daemon
    # check` tells). A bound, not a covariance; +∞ while coasting.
    error_bound: float

    # Time since the stamp of the newest output measurement (s); +∞ before the first.
    output_age_s: float

    _fields_ = [
        ("output_error", ctypes.c_double),
        ("activation", ctypes.c_double),
        ("power_function", ctypes.c_double),
        ("native_norm", ctypes.c_double),
        ("solver_error", ctypes.c_double),
        ("error_bound", ctypes.c_double),
        ("output_age_s", ctypes.c_double),
    ]


class Estimate(EstimateStructure):
    """The state estimate at `stamp_ns`, and how far it can be trusted."""

    TYPE_NAME = "observer.Estimate.v3"

    # Counts the service's publications from 0.
    sequence: int

    # Sequence of the newest sample that went into this estimate.
    source_sequence: int

    # Time of the state (ns).
    stamp_ns: int

    # Stamp of the newest sample that went into this estimate (ns); 0 before the first.
    source_stamp_ns: int

    # CLOCK_MONOTONIC just before publication (ns).
    publish_stamp_ns: int

    # Bits of `status_bits`.
    status: int

    # Position, inertial (m). Dead-reckoned from velocity unless position fixes are used.
    position_m: ctypes.Array

    # Velocity, inertial (m/s).
    velocity_m_s: ctypes.Array

    # Attitude, unit quaternion w, x, y, z, body to inertial.
    attitude_wxyz: ctypes.Array

    # 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π].
    euler_rad: ctypes.Array

    # Angular velocity, body axes (rad/s).
    angular_velocity_rad_s: ctypes.Array

    # f̂: the learned unknown force, inertial axes (N).
    matched_force_n: ctypes.Array

    # f̂: the learned unknown torque, body axes (N·m).
    matched_torque_n_m: ctypes.Array

    # Trust in position, velocity and force.
    translation: Channel

    # Trust in attitude, angular velocity and torque.
    rotation: Channel

    # x̂ of a general linear plant, its first n entries, in the units of its configuration.
    state: ctypes.Array

    # f̂ of a general linear plant, its first m entries.
    matched_input: ctypes.Array

    # Trust in `state` and `matched_input`.
    linear: Channel

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("source_sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("source_stamp_ns", ctypes.c_uint64),
        ("publish_stamp_ns", ctypes.c_uint64),
        ("status", ctypes.c_uint64),
        ("position_m", array(ctypes.c_double, 3)),
        ("velocity_m_s", array(ctypes.c_double, 3)),
        ("attitude_wxyz", array(ctypes.c_double, 4)),
        ("euler_rad", array(ctypes.c_double, 3)),
        ("angular_velocity_rad_s", array(ctypes.c_double, 3)),
        ("matched_force_n", array(ctypes.c_double, 3)),
        ("matched_torque_n_m", array(ctypes.c_double, 3)),
        ("translation", Channel),
        ("rotation", Channel),
        ("state", array(ctypes.c_double, 12)),
        ("matched_input", array(ctypes.c_double, 6)),
        ("linear", Channel),
    ]


class LatencySummary(Structure):
    """Quantiles of one latency (ns) since the service started."""

    TYPE_NAME = "observer.LatencySummary.v1"

    # Number of values.
    count: int

    # Median.
    p50: int

    # 90 % quantile.
    p90: int

    # 99 % quantile.
    p99: int

    # 99.9 % quantile.
    p999: int

    # Largest value.
    max: int

    _fields_ = [
        ("count", ctypes.c_uint64),
        ("p50", ctypes.c_uint64),
        ("p90", ctypes.c_uint64),
        ("p99", ctypes.c_uint64),
        ("p999", ctypes.c_uint64),
        ("max", ctypes.c_uint64),
    ]


class Status(StatusStructure):
    """What the service did since it started."""

    TYPE_NAME = "observer.Status.v3"

    # Counts publications from 0.
    sequence: int

    # CLOCK_MONOTONIC of this status (ns).
    stamp_ns: int

    # CLOCK_MONOTONIC of the service's start (ns).
    start_stamp_ns: int

    # Configured rate (mHz: 200 Hz is 200 000).
    rate_millihertz: int

    # d, the width of the dead zone of translation (m/s), rotation (rad/s), linear plant (its output's unit):
    # up to it an output error is noise, and nothing is learned; 0 where there is no such channel.
    dead_zone_width: ctypes.Array

    # Ticks served, each with one estimate.
    ticks: int

    # Deadlines that passed unserved because a tick ended too late; they were skipped.
    deadline_misses: int

    # Samples used.
    samples_accepted: int

    # Gaps in the source's sequence: samples that never arrived.
    samples_lost: int

    # Samples rejected, by `Rejection`.
    samples_rejected: ctypes.Array

    # Sequence of the newest accepted sample.
    newest_sequence: int

    # Age of the newest accepted sample (ns); `u64.MAX` before the first.
    newest_sample_age_ns: int

    # Ticks on which a channel coasted.
    ticks_coasting: int

    # Ticks on which the dead zone's output was clamped to the stability bound.
    ticks_clamped: int

    # Times the state was reset to the last good copy.
    state_resets: int

    # Times the source restarted or another one took over.
    source_changes: int

    # Process id of the source in use; 0 if none or unknown.
    source_pid: int

    # Process id of another source that publishes too; 0 if none.
    other_source_pid: int

    # Commands carried out.
    commands: int

    # Tick records that the status thread was too slow to take.
    records_dropped: int

    # 1 while adaptation is frozen by an operator.
    adaptation_frozen: int

    # Outputs whose error was implausible against its running scale, and which were held back from adaptation
    # or from correction too: of translation, rotation, linear plant.
    outputs_held_back: ctypes.Array

    # Outputs that repeated the one before to the bit, for longer than a living sensor does; likewise.
    outputs_stuck: ctypes.Array

    # Ticks in a row that ended after their next deadline, now.
    late_ticks_in_a_row: int

    # The most so far.
    most_late_ticks_in_a_row: int

    # Ticks on which samples were not used because the loop was late.
    ticks_predict_only: int

    # Ticks whose estimate was marked invalid.
    ticks_invalid: int

    # Real-time settings that the configuration asks for: bits of `real_time`.
    real_time_requested: int

    # Real-time settings that the system granted.
    real_time_granted: int

    # What was restored at the start: one of `restored`.
    snapshot_restored: int

    # Snapshots written.
    snapshots_saved: int

    # Snapshots that could not be written.
    snapshots_failed: int

    # CLOCK_MONOTONIC of the state in the newest snapshot of this service (ns); 0 if none.
    snapshot_stamp_ns: int

    # Ticks written to the flight record.
    ticks_recorded: int

    # Ticks that the recorder was too slow to take.
    ticks_not_recorded: int

    # Deadline to wake-up (ns).
    wake_up_lateness_ns: LatencySummary

    # Wake-up to publication: samples taken, stepped, estimate written (ns).
    step_ns: LatencySummary

    # Source stamp of the newest sample to wake-up, on ticks with a new sample (ns).
    input_age_ns: LatencySummary

    # Source stamp of the newest sample to publication, on ticks with a new sample (ns).
    source_to_publish_ns: LatencySummary

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("start_stamp_ns", ctypes.c_uint64),
        ("rate_millihertz", ctypes.c_uint64),
        ("dead_zone_width", array(ctypes.c_double, 3)),
        ("ticks", ctypes.c_uint64),
        ("deadline_misses", ctypes.c_uint64),
        ("samples_accepted", ctypes.c_uint64),
        ("samples_lost", ctypes.c_uint64),
        ("samples_rejected", array(ctypes.c_uint64, 11)),
        ("newest_sequence", ctypes.c_uint64),
        ("newest_sample_age_ns", ctypes.c_uint64),
        ("ticks_coasting", ctypes.c_uint64),
        ("ticks_clamped", ctypes.c_uint64),
        ("state_resets", ctypes.c_uint64),
        ("source_changes", ctypes.c_uint64),
        ("source_pid", ctypes.c_uint64),
        ("other_source_pid", ctypes.c_uint64),
        ("commands", ctypes.c_uint64),
        ("records_dropped", ctypes.c_uint64),
        ("adaptation_frozen", ctypes.c_uint64),
        ("outputs_held_back", array(ctypes.c_uint64, 3)),
        ("outputs_stuck", array(ctypes.c_uint64, 3)),
        ("late_ticks_in_a_row", ctypes.c_uint64),
        ("most_late_ticks_in_a_row", ctypes.c_uint64),
        ("ticks_predict_only", ctypes.c_uint64),
        ("ticks_invalid", ctypes.c_uint64),
        ("real_time_requested", ctypes.c_uint64),
        ("real_time_granted", ctypes.c_uint64),
        ("snapshot_restored", ctypes.c_uint64),
        ("snapshots_saved", ctypes.c_uint64),
        ("snapshots_failed", ctypes.c_uint64),
        ("snapshot_stamp_ns", ctypes.c_uint64),
        ("ticks_recorded", ctypes.c_uint64),
        ("ticks_not_recorded", ctypes.c_uint64),
        ("wake_up_lateness_ns", LatencySummary),
        ("step_ns", LatencySummary),
        ("input_age_ns", LatencySummary),
        ("source_to_publish_ns", LatencySummary),
    ]


class Truth(Structure):
    """The true plant at `stamp_ns`, from the simulator."""

    TYPE_NAME = "observer.Truth.v1"

    # Sequence of the sample taken at the same time.
    sequence: int

    # Time of the state (ns).
    stamp_ns: int

    # Position, inertial (m).
    position_m: ctypes.Array

    # Velocity, inertial (m/s).
    velocity_m_s: ctypes.Array

    # Attitude, unit quaternion w, x, y, z, body to inertial.
    attitude_wxyz: ctypes.Array

    # Angular velocity, body axes (rad/s).
    angular_velocity_rad_s: ctypes.Array

    # f: everything that the nominal plant leaves out and that depends on the motion, inertial (N).
    matched_force_n: ctypes.Array

    # f of the rotation, body axes (N·m).
    matched_torque_n_m: ctypes.Array

    # ξ: gusts and the like, which are no function of the motion, inertial (N).
    unmatched_force_n: ctypes.Array

    # ξ of the rotation, body axes (N·m).
    unmatched_torque_n_m: ctypes.Array

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("position_m", array(ctypes.c_double, 3)),
        ("velocity_m_s", array(ctypes.c_double, 3)),
        ("attitude_wxyz", array(ctypes.c_double, 4)),
        ("angular_velocity_rad_s", array(ctypes.c_double, 3)),
        ("matched_force_n", array(ctypes.c_double, 3)),
        ("matched_torque_n_m", array(ctypes.c_double, 3)),
        ("unmatched_force_n", array(ctypes.c_double, 3)),
        ("unmatched_torque_n_m", array(ctypes.c_double, 3)),
    ]


class Command(Structure):
    """An operator's request."""

    TYPE_NAME = "observer.Command.v1"

    # One of `command`.
    kind: int

    # Zero.
    reserved: int

    _fields_ = [
        ("kind", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]


class Reply(ReplyStructure):
    """The service's answer, with its status after the command."""

    TYPE_NAME = "observer.Reply.v3"

    # One of `outcome`.
    outcome: int

    # Bytes of `message` in use.
    message_bytes: int

    # UTF-8 text.
    message: ctypes.Array

    # Status after the command.
    status: Status

    _fields_ = [
        ("outcome", ctypes.c_uint32),
        ("message_bytes", ctypes.c_uint32),
        ("message", array(ctypes.c_uint8, 248)),
        ("status", Status),
    ]
