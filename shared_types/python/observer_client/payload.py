import ctypes
from .structure import EstimateStructure, ReplyStructure, StatusStructure, Structure, array
class valid:
    VELOCITY = 1 << 0
    ANGULAR_VELOCITY = 1 << 1
    POSITION = 1 << 2
    ATTITUDE = 1 << 3
    FORCE = 1 << 4
    TORQUE = 1 << 5
    RIGID_BODY = (1 << 6) - 1
    OUTPUT = 1 << 6
    INPUT = 1 << 7
    ALL = (1 << 8) - 1
class frame:
    INERTIAL = 0
    BODY = 1
class status_bits:
    TRACKING = 1 << 0
    COASTING_TRANSLATION = 1 << 1
    COASTING_ROTATION = 1 << 2
    COASTING_LINEAR = 1 << 11
    COASTING = COASTING_TRANSLATION | COASTING_ROTATION | COASTING_LINEAR
    STALE = 1 << 3
    ADAPTING = 1 << 4
    FROZEN = 1 << 5
    OUTSIDE_CENTERS = 1 << 6
    REJECTED_SAMPLE = 1 << 7
    CLAMPED = 1 << 8
    DIVERGED = 1 << 9
    WAITING = 1 << 10
    LATE = 1 << 12
    PREDICT_ONLY = 1 << 13
    INVALID = 1 << 14
    HELD_BACK = 1 << 15
    STUCK = 1 << 16
class real_time:
    PRIORITY = 1 << 0
    CORES = 1 << 1
    LOCKED_MEMORY = 1 << 2
    PUNCTUAL_TIMERS = 1 << 3
    AWAKE_CORES = 1 << 4
class restored:
    NOTHING = 0
    LEARNED = 1
    LEARNED_AND_STATE = 2
class command:
    RESET = 1
    FREEZE = 2
    THAW = 3
    SAVE = 4
    STATUS = 5
class outcome:
    DONE = 0
    REFUSED = 1
    UNKNOWN = 2
STATUS_WORDS = {status_bits.TRACKING: "tracking", status_bits.COASTING_TRANSLATION: "coasting-translation", status_bits.COASTING_ROTATION: "coasting-rotation", status_bits.STALE: "stale", status_bits.ADAPTING: "adapting", status_bits.FROZEN: "frozen", status_bits.OUTSIDE_CENTERS: "outside-centers", status_bits.REJECTED_SAMPLE: "rejected-sample", status_bits.CLAMPED: "clamped", status_bits.DIVERGED: "diverged", status_bits.WAITING: "waiting", status_bits.COASTING_LINEAR: "coasting-linear", status_bits.LATE: "late", status_bits.PREDICT_ONLY: "predict-only", status_bits.INVALID: "invalid", status_bits.HELD_BACK: "held-back", status_bits.STUCK: "stuck-sensor"}
REAL_TIME_WORDS = {real_time.PRIORITY: "priority", real_time.CORES: "cores", real_time.LOCKED_MEMORY: "locked memory", real_time.PUNCTUAL_TIMERS: "punctual timers", real_time.AWAKE_CORES: "awake cores"}
REJECTION_WORDS = ("not finite", "beyond physical limits", "quaternion not of unit norm", "repeated stamp", "older stamp", "too far behind the clock", "too far ahead of the clock", "sequence went backwards", "another source holds the stream", "malformed", "the loop was late")
class Measurement(Structure):
    TYPE_NAME = "observer.Measurement.v2"
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
    TYPE_NAME = "observer.Channel.v2"
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
    TYPE_NAME = "observer.Estimate.v3"
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
    TYPE_NAME = "observer.LatencySummary.v1"
    _fields_ = [
        ("count", ctypes.c_uint64),
        ("p50", ctypes.c_uint64),
        ("p90", ctypes.c_uint64),
        ("p99", ctypes.c_uint64),
        ("p999", ctypes.c_uint64),
        ("max", ctypes.c_uint64),
    ]
class Status(StatusStructure):
    TYPE_NAME = "observer.Status.v2"
    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("start_stamp_ns", ctypes.c_uint64),
        ("rate_millihertz", ctypes.c_uint64),
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
    TYPE_NAME = "observer.Truth.v1"
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
    TYPE_NAME = "observer.Command.v1"
    _fields_ = [
        ("kind", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]
class Reply(ReplyStructure):
    TYPE_NAME = "observer.Reply.v2"
    _fields_ = [
        ("outcome", ctypes.c_uint32),
        ("message_bytes", ctypes.c_uint32),
        ("message", array(ctypes.c_uint8, 248)),
        ("status", Status),
    ]
