"""The messages, as they lie in shared memory: fixed size, no padding, all SI.

Made from the tables of `shared_types` by `UPDATE=1 cargo test -p observer_client --test generated`: not to be edited.

Frames: I is inertial, J the body, both right-handed; `attitude_wxyz` rotates body vectors into I.
"""

import ctypes
from typing import Annotated

from .structure import EstimateStructure, ReplyStructure, StatusStructure, Structure, array, laid_out

u32 = Annotated[int, ctypes.c_uint32]
u64 = Annotated[int, ctypes.c_uint64]
f64 = Annotated[float, ctypes.c_double]
f64x12 = Annotated[ctypes.Array, array(ctypes.c_double, 12)]
f64x16 = Annotated[ctypes.Array, array(ctypes.c_double, 16)]
f64x3 = Annotated[ctypes.Array, array(ctypes.c_double, 3)]
f64x4 = Annotated[ctypes.Array, array(ctypes.c_double, 4)]
f64x6 = Annotated[ctypes.Array, array(ctypes.c_double, 6)]
u64x12 = Annotated[ctypes.Array, array(ctypes.c_uint64, 12)]
u64x16 = Annotated[ctypes.Array, array(ctypes.c_uint64, 16)]
u64x3 = Annotated[ctypes.Array, array(ctypes.c_uint64, 3)]
u8x248 = Annotated[ctypes.Array, array(ctypes.c_uint8, 248)]


class valid:
    """Bits of `Measurement.valid`: which fields carry a measurement."""

    VELOCITY = 0x1  # `velocity_m_s`.
    ANGULAR_VELOCITY = 0x2  # `angular_velocity_rad_s`.
    SPECIFIC_FORCE = 0x100  # `specific_force_m_s2`.
    POSITION = 0x4  # `position_m`.
    ATTITUDE = 0x8  # `attitude_wxyz`.
    FORCE = 0x10  # `force_n`.
    TORQUE = 0x20  # `torque_n_m`.
    OUTPUT = 0x40  # `output`.
    INPUT = 0x80  # `input`.
    RIGID_BODY = 0x3f  # Every field of a rigid body but the specific force.
    ALL = 0x1ff  # Every bit that has a meaning.


class frame:
    """Values of `Measurement.velocity_frame` and `Measurement.force_frame`."""

    INERTIAL = 0x0  # Components along the inertial axes.
    BODY = 0x1  # Components along the body axes (a Doppler log; the thrust of a multicopter).


class flags:
    """Bits of `Measurement.flags`. A sample with any other bit is malformed, as with any other bit of `valid`."""

    # The vehicle stands on the ground, by its own landed detector. Nothing is learned while the newest sample
    # has this bit: the ground's reaction is no force of the motion.
    ON_GROUND = 0x1
    ALL = 0x1  # Every bit that has a meaning.


class absent:
    """Bits of `Measurement.absent`: components of a valid field that were not measured, as of a depth or of a Doppler log that has two axes. The joint law takes the others; a velocity in body axes and a specific force must have all of them."""

    VELOCITY_X = 0x1  # x of the velocity.
    VELOCITY_Y = 0x2  # y of the velocity.
    VELOCITY_Z = 0x4  # z of the velocity.
    ANGULAR_VELOCITY_X = 0x8  # x of the angular velocity.
    ANGULAR_VELOCITY_Y = 0x10  # y of the angular velocity.
    ANGULAR_VELOCITY_Z = 0x20  # z of the angular velocity.
    POSITION_X = 0x40  # x of the position.
    POSITION_Y = 0x80  # y of the position.
    POSITION_Z = 0x100  # z of the position.
    SPECIFIC_FORCE_X = 0x200  # x of the specific force.
    SPECIFIC_FORCE_Y = 0x400  # y of the specific force.
    SPECIFIC_FORCE_Z = 0x800  # z of the specific force.
    ALL = 0xfff  # Every bit that has a meaning.


class status_bits:
    """Bits of `Estimate.status`."""

    TRACKING = 0x1  # Every configured channel follows measurements that it holds now, and none is reacquiring.
    COASTING_TRANSLATION = 0x2  # The translation channel predicts without a velocity measurement.
    COASTING_ROTATION = 0x4  # The rotation channel predicts without an angular-velocity measurement.
    # A configured channel is stale, or no sample came for longer than `stale_after_s`: do not fly on this.
    # The bits `STALE_…` say which channel.
    STALE = 0x8
    ADAPTING = 0x10  # A channel's dead zone is open: the unknown force is being learned now.
    FROZEN = 0x20  # Adaptation was frozen by an operator.
    OUTSIDE_CENTERS = 0x40  # The held output lies outside the box of the kernel centers: nothing was learned there.
    REJECTED_SAMPLE = 0x80  # A sample was rejected since the previous estimate.
    CLAMPED = 0x100  # The dead zone's output was clamped to the stability bound of the sampled law.
    DIVERGED = 0x200  # The state was not finite or beyond limits and was reset to the last checkpoint.
    WAITING = 0x400  # No sample was ever accepted: the estimate is the initial state.
    COASTING_LINEAR = 0x800  # The general linear plant's channel predicts without an output.
    LATE = 0x1000  # The previous tick ended after its next deadline: the loop is late.
    # The loop was late for `deadline.predict_only_after_ticks` ticks in a row: samples are not used, and the
    # estimate is predicted only.
    PREDICT_ONLY = 0x2000
    INVALID = 0x4000  # The loop was late for so long that the estimate is not to be used at all: do not fly on this.
    # An output that is an outlier against its recent errors was held back since the previous estimate.
    HELD_BACK = 0x8000
    STUCK = 0x10000  # A sensor repeats one value to the bit.
    # After an outage, a channel's innovations are not back within the gate: its state is uncertain.
    REACQUIRING = 0x20000
    STALE_TRANSLATION = 0x40000  # The newest velocity measurement is older than `stale_after_s`, or there was none yet.
    # The newest angular-velocity measurement is older than `stale_after_s`, or there was none yet.
    STALE_ROTATION = 0x80000
    # The newest output of the general linear plant is older than `stale_after_s`, or there was none yet.
    STALE_LINEAR = 0x100000
    ON_GROUND = 0x200000  # The newest sample says that the vehicle stands on the ground: nothing is learned.
    # Samples that arrived late are still being put where they belong: the estimate is predicted from before
    # them.
    CATCHING_UP = 0x400000
    COASTING = 0x806  # Any channel coasts.


class real_time:
    """Bits of `Status.real_time_requested` and `Status.real_time_granted`."""

    PRIORITY = 0x1  # A fixed priority (SCHED_FIFO) for the loop.
    CORES = 0x2  # Cores of the loop's own choice.
    LOCKED_MEMORY = 0x4  # Memory that is neither swapped out nor mapped late.
    PUNCTUAL_TIMERS = 0x8  # Timers without slack.
    AWAKE_CORES = 0x10  # Cores that wake up at once.


class restored:
    """Values of `Status.snapshot_restored`."""

    NOTHING = 0x0  # The service started with nothing learned.
    LEARNED = 0x1  # It started with what an earlier one had learned.
    LEARNED_AND_STATE = 0x2  # It started with that and with the state, and goes on from there.


class command:
    """Values of `Command.kind`."""

    RESET = 0x1  # Forget state and weights; start again from the next sample.
    FREEZE = 0x2  # Stop learning; keep using what was learned.
    THAW = 0x3  # Learn again.
    SAVE = 0x4  # Write the learned weights to disk.
    STATUS = 0x5  # Only answer with the status.


class outcome:
    """Values of `Reply.outcome`."""

    DONE = 0x0  # Done: the loop has carried the command out.
    REFUSED = 0x1  # Refused: `message` says why.
    UNKNOWN = 0x2  # The command's kind is unknown to this service.


#: Words for bits of `Estimate.status`.
STATUS_WORDS = {
    0x1: "tracking",
    0x2: "coasting-translation",
    0x4: "coasting-rotation",
    0x8: "stale",
    0x10: "adapting",
    0x20: "frozen",
    0x40: "outside-centers",
    0x80: "rejected-sample",
    0x100: "clamped",
    0x200: "diverged",
    0x400: "waiting",
    0x800: "coasting-linear",
    0x1000: "late",
    0x2000: "predict-only",
    0x4000: "invalid",
    0x8000: "held-back",
    0x10000: "stuck-sensor",
    0x20000: "reacquiring",
    0x40000: "stale-translation",
    0x80000: "stale-rotation",
    0x100000: "stale-linear",
    0x200000: "on-ground",
    0x400000: "catching-up",
}


#: Words for bits of `Status.real_time_granted`.
REAL_TIME_WORDS = {
    0x1: "priority",
    0x2: "cores",
    0x4: "locked memory",
    0x8: "punctual timers",
    0x10: "awake cores",
}


#: Why samples were rejected, in the order of `Counters.samples_rejected`.
REJECTION_WORDS = (
    "not finite",
    "beyond physical limits",
    "quaternion not of unit norm",
    "repeated stamp",
    "too late",
    "too far behind the clock",
    "too far ahead of the clock",
    "sequence went backwards",
    "another source holds the stream",
    "malformed",
    "unknown sensor",
    "the loop was late",
)

#: What a sample may carry: name, bit of `valid`, what it is.
READINGS = {
    "velocity_m_s": (0x1, "Velocity of the center of mass, or of the sensor where its configuration has a lever arm, in the frame that `velocity_frame` names (m/s)."),
    "angular_velocity_rad_s": (0x2, "Angular velocity, body axes (rad/s)."),
    "specific_force_m_s2": (0x100, "Specific force, of an accelerometer: acceleration without gravity's, body axes (m/s²)."),
    "position_m": (0x4, "Position fix, inertial (m)."),
    "attitude_wxyz": (0x8, "Attitude fix, unit quaternion w, x, y, z, body to inertial."),
    "force_n": (0x10, "Commanded force, in the frame that `force_frame` names (N), held until the next one; zero before the first."),
    "torque_n_m": (0x20, "Commanded torque, body axes (N·m), held until the next one; zero before the first."),
    "output": (0x40, "y of a general linear plant, its first m entries, in the units of its configuration."),
    "input": (0x80, "u of a general linear plant, its first m entries, held until the next one; zero before the first."),
}


@laid_out
class Measurement(Structure):
    """One set of sensor readings and commands, all taken at `stamp_ns`."""

    TYPE_NAME = "observer.Measurement.v5"

    sequence: u64  # Counts from 0, one up per sample; a gap counts as loss.
    stamp_ns: u64  # CLOCK_MONOTONIC of the source when the readings were taken (ns).
    valid: u32  # Which of the fields below are valid: bits of `valid`.
    velocity_frame: u32  # Frame of `velocity_m_s`: `frame.INERTIAL` or `frame.BODY`.
    flags: u32  # What the vehicle says of itself: bits of `flags`.
    absent: u32  # Which components of the fields below were not measured: bits of `absent`.
    # Number of the `[[sensor]]` of the configuration that it comes from: mounting, lever arm, noise, latency.
    # 0: of none.
    sensor: u32
    force_frame: u32  # Frame of `force_n`: `frame.INERTIAL` or `frame.BODY`.
    # Velocity of the center of mass, or of the sensor where its configuration has a lever arm, in the frame
    # that `velocity_frame` names (m/s).
    velocity_m_s: f64x3
    angular_velocity_rad_s: f64x3  # Angular velocity, body axes (rad/s).
    specific_force_m_s2: f64x3  # Specific force, of an accelerometer: acceleration without gravity's, body axes (m/s²).
    position_m: f64x3  # Position fix, inertial (m).
    attitude_wxyz: f64x4  # Attitude fix, unit quaternion w, x, y, z, body to inertial.
    # Commanded force, in the frame that `force_frame` names (N), held until the next one; zero before the
    # first.
    force_n: f64x3
    torque_n_m: f64x3  # Commanded torque, body axes (N·m), held until the next one; zero before the first.
    output: f64x6  # y of a general linear plant, its first m entries, in the units of its configuration.
    input: f64x6  # u of a general linear plant, its first m entries, held until the next one; zero before the first.
    velocity_std_m_s: f64x3  # 1 σ of `velocity_m_s`, along its axes (m/s); 0: as configured.
    angular_velocity_std_rad_s: f64x3  # 1 σ of `angular_velocity_rad_s` (rad/s); 0: as configured.
    specific_force_std_m_s2: f64x3  # 1 σ of `specific_force_m_s2` (m/s²); 0: as configured.
    position_std_m: f64x3  # 1 σ of `position_m` (m); 0: as configured.
    attitude_std_rad: f64x3  # 1 σ of the rotation vector of `attitude_wxyz`'s error, body axes (rad); 0: as configured.


@laid_out
class Channel(Structure):
    """How far one channel's estimate can be trusted. Units are those of the channel's output: m/s for
    translation, rad/s for rotation, of the configuration for a general linear plant; forces N or N·m."""

    TYPE_NAME = "observer.Channel.v3"

    output_error: f64  # ‖ỹ‖ = ‖y − Cx̂‖ at the held sample; 0 while coasting.
    activation: f64  # σ, the dead zone's output now: 0 is closed, nothing is learned.
    power_function: f64  # P_N(y) / √κ(0), 0 … 1: 0 at a center, 1 where the centers cover nothing.
    native_norm: f64  # ‖f̂_N‖ in the native space.
    # How far the learned force may be from that of the dense solver (N; N·m): the local solver's estimate of
    # its own error; 0 where the dense one is in use.
    solver_error: f64
    # max(d, d_N): the size that the theorems claim ‖e‖ settles below, where their conditions hold (`daemon
    # check` tells) and the newest output confirms it; else +∞, as while coasting. A bound, not a covariance.
    # +∞ with the joint law, which has standard deviations instead.
    error_bound: f64
    output_age_s: f64  # Time since the stamp of the newest output measurement (s); +∞ before the first.
    # Normalized innovation squared: e²/S of the newest output, mean over its axes. 1 in the mean where the
    # noises are right; 0 where the law has no S, and before the first output.
    nis: f64


@laid_out
class Estimate(EstimateStructure):
    """The state estimate at `stamp_ns`, and how far it can be trusted."""

    TYPE_NAME = "observer.Estimate.v5"
    WORDS = STATUS_WORDS
    MAY_BE_INFINITE = (
        "position_std_m",
        "velocity_std_m_s",
        "attitude_std_rad",
        "angular_velocity_std_rad_s",
        "matched_force_std_n",
        "matched_torque_std_n_m",
    )

    sequence: u64  # Counts the service's publications from 0.
    source_sequence: u64  # Sequence of the newest sample that went into this estimate.
    stamp_ns: u64  # Time of the state (ns).
    source_stamp_ns: u64  # Stamp of the newest sample that went into this estimate (ns); 0 before the first.
    publish_stamp_ns: u64  # CLOCK_MONOTONIC just before publication (ns).
    status: u64  # Bits of `status_bits`.
    # Which sensors contributed: bit k is set where a sample of sensor number k was accepted since the
    # estimate before, bit 0 for samples without a sensor number. Numbers above 63 have no bit.
    sensors: u64
    position_m: f64x3  # Position, inertial (m). Dead-reckoned from velocity unless position fixes are used.
    velocity_m_s: f64x3  # Velocity, inertial (m/s).
    attitude_wxyz: f64x4  # Attitude, unit quaternion w, x, y, z, body to inertial.
    euler_rad: f64x3  # 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π].
    angular_velocity_rad_s: f64x3  # Angular velocity, body axes (rad/s).
    matched_force_n: f64x3  # f̂: the learned unknown force, inertial axes (N).
    matched_torque_n_m: f64x3  # f̂: the learned unknown torque, body axes (N·m).
    # 1 σ of `position_m`, inertial axes (m); +∞ where it is unknown, as each of the next five: with `law =
    # "gradient"`, and before the first output.
    position_std_m: f64x3
    velocity_std_m_s: f64x3  # 1 σ of `velocity_m_s`, inertial axes (m/s).
    attitude_std_rad: f64x3  # 1 σ of the rotation vector of the attitude's error, body axes (rad).
    angular_velocity_std_rad_s: f64x3  # 1 σ of `angular_velocity_rad_s`, body axes (rad/s).
    matched_force_std_n: f64x3  # 1 σ of `matched_force_n`, inertial axes (N).
    matched_torque_std_n_m: f64x3  # 1 σ of `matched_torque_n_m`, body axes (N·m).
    translation: Channel  # Trust in position, velocity and force.
    rotation: Channel  # Trust in attitude, angular velocity and torque.
    state: f64x12  # x̂ of a general linear plant, its first n entries, in the units of its configuration.
    matched_input: f64x6  # f̂ of a general linear plant, its first m entries.
    linear: Channel  # Trust in `state` and `matched_input`.


@laid_out
class LatencySummary(Structure):
    """Quantiles of one latency (ns) since the service started."""

    TYPE_NAME = "observer.LatencySummary.v1"

    count: u64  # Number of values.
    p50: u64  # Median.
    p90: u64  # 90 % quantile.
    p99: u64  # 99 % quantile.
    p999: u64  # 99.9 % quantile.
    max: u64  # Largest value.


@laid_out
class Counters(Structure):
    """What the engine and its loop count since they started."""

    TYPE_NAME = "observer.Counters.v2"

    ticks: u64  # Ticks served, each with one estimate.
    deadline_misses: u64  # Deadlines that passed unserved because a tick ended too late; they were skipped.
    samples_accepted: u64  # Samples used.
    samples_lost: u64  # Gaps in the source's sequence: samples that never arrived.
    samples_rejected: u64x12  # Samples rejected, by `Rejection`.
    # Outputs that were outliers against the running scale of their errors, and were held back from adaptation
    # or from correction too: of translation, rotation, linear plant.
    outputs_held_back: u64x3
    # Outputs that repeated the previous one to the bit, for longer than a working sensor does; likewise.
    outputs_stuck: u64x3
    ticks_coasting: u64  # Ticks on which a channel coasted.
    ticks_clamped: u64  # Ticks on which the dead zone's output was clamped to the stability bound.
    ticks_predict_only: u64  # Ticks on which samples were not used because the loop was late.
    ticks_invalid: u64  # Ticks whose estimate was marked invalid.
    state_resets: u64  # Times the state was reset to the last checkpoint.
    source_changes: u64  # Times the source restarted or another one took over.
    commands: u64  # Commands carried out.
    records_dropped: u64  # Tick records that the housekeeping thread was too slow to take.
    ticks_not_recorded: u64  # Ticks that the recorder was too slow to take.


@laid_out
class Status(StatusStructure):
    """What the service did since it started."""

    TYPE_NAME = "observer.Status.v6"
    WORDS = REJECTION_WORDS

    sequence: u64  # Counts publications from 0.
    stamp_ns: u64  # CLOCK_MONOTONIC of this status (ns).
    start_stamp_ns: u64  # CLOCK_MONOTONIC of the service's start (ns).
    rate_millihertz: u64  # Configured rate (mHz: 200 Hz is 200 000).
    # d, the width of the dead zone of translation (m/s), rotation (rad/s), linear plant (its output's unit):
    # up to it an output error is noise, and nothing is learned; 0 where there is no such channel.
    dead_zone_width: f64x3
    counters: Counters  # What the engine and its loop counted.
    newest_sequence: u64  # Sequence of the newest accepted sample.
    newest_sample_age_ns: u64  # Age of the newest accepted sample (ns); the largest number before the first.
    # Age of the newest output of each channel (ns): of translation, rotation, linear plant; the largest
    # number before the first, and where there is no such channel.
    output_age_ns: u64x3
    # Normalized innovation squared of the newest output of each channel, as `nis` of an estimate's channels.
    nis: f64x3
    source_pid: u64  # Process id of the source in use; 0 if none or unknown.
    other_source_pid: u64  # Process id of another source that publishes too; 0 if none.
    # Of each source that has sent, in the order of appearance: process id; 0 where there is no source, or
    # none any more.
    source_pids: u64x16
    source_sensors: u64x16  # Number of its `[[sensor]]`; 0: none.
    # Age of its newest sample since it arrived (ns); the largest number where there is no source.
    source_ages_ns: u64x16
    source_periods_ns: u64x16  # The usual time between two of its samples (ns); 0 before the second.
    source_delays_ns: u64x16  # Median of the delays of its samples, from stamp to arrival (ns).
    source_max_delays_ns: u64x16  # The largest delay (ns).
    source_accepted: u64x16  # Its samples that were used.
    source_late: u64x16  # Of these, those that came after a newer one of any source.
    source_lost: u64x16  # Gaps in its sequence.
    source_rejected: u64x16  # Its samples that were rejected.
    # Recent mean of the normalized innovation squared of its velocities, about 1 where their noise is right;
    # 0 where it has none, and with the gradient law.
    source_nis: f64x16
    adaptation_frozen: u64  # 1 while adaptation is frozen by an operator.
    late_ticks_in_a_row: u64  # Ticks in a row that ended after their next deadline, now.
    most_late_ticks_in_a_row: u64  # The most so far.
    real_time_requested: u64  # Real-time settings that the configuration asks for: bits of `real_time`.
    real_time_granted: u64  # Real-time settings that the system granted.
    snapshot_restored: u64  # What was restored at the start: one of `restored`.
    snapshots_saved: u64  # Snapshots written.
    snapshots_failed: u64  # Snapshots that could not be written.
    snapshot_stamp_ns: u64  # CLOCK_MONOTONIC of the state in the newest snapshot of this service (ns); 0 if none.
    ticks_recorded: u64  # Ticks written to the flight record.
    wake_up_lateness_ns: LatencySummary  # Deadline to wake-up (ns).
    step_ns: LatencySummary  # Wake-up to publication: samples taken, stepped, estimate written (ns).
    input_age_ns: LatencySummary  # Source stamp of the newest sample to wake-up, on ticks with a new sample (ns).
    # Source stamp of the newest sample to publication, on ticks with a new sample (ns).
    source_to_publish_ns: LatencySummary


@laid_out
class Truth(Structure):
    """The true plant at `stamp_ns`, from the simulator."""

    TYPE_NAME = "observer.Truth.v1"

    sequence: u64  # Sequence of the sample taken at the same time.
    stamp_ns: u64  # Time of the state (ns).
    position_m: f64x3  # Position, inertial (m).
    velocity_m_s: f64x3  # Velocity, inertial (m/s).
    attitude_wxyz: f64x4  # Attitude, unit quaternion w, x, y, z, body to inertial.
    angular_velocity_rad_s: f64x3  # Angular velocity, body axes (rad/s).
    # f: everything that the nominal plant leaves out and that depends on the motion, inertial (N).
    matched_force_n: f64x3
    matched_torque_n_m: f64x3  # f of the rotation, body axes (N·m).
    unmatched_force_n: f64x3  # ξ: gusts and the like, which are no function of the motion, inertial (N).
    unmatched_torque_n_m: f64x3  # ξ of the rotation, body axes (N·m).


@laid_out
class Command(Structure):
    """An operator's request."""

    TYPE_NAME = "observer.Command.v1"

    kind: u32  # One of `command`.
    reserved: u32  # Zero.


@laid_out
class Reply(ReplyStructure):
    """The service's answer, with its status after the command."""

    TYPE_NAME = "observer.Reply.v6"

    outcome: u32  # One of `outcome`.
    message_bytes: u32  # Bytes of `message` in use.
    message: u8x248  # UTF-8 text.
    status: Status  # Status after the command.
