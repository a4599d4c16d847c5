/* The vehicle's side of the state-estimation service, for C11 and, wrapped by observer_client.hpp, C++17.
 * Made from the library's source by cargo test; not to be edited.
 *
 *     observer_client client;
 *     if (observer_open(OBSERVER_LAYOUT, NULL, "vehicle", OBSERVER_PORTS_ALL, 5.0, &client) < 0)
 *         fprintf(stderr, "%s\n", observer_error_text());
 *     observer_measurement sample = {.sequence = 0, .stamp_ns = observer_now_ns(), .valid = OBSERVER_VALID_VELOCITY};
 *     observer_publish(client, &sample);
 *     observer_estimate estimate;
 *     uint64_t do_not_fly = OBSERVER_STATUS_BITS_STALE | OBSERVER_STATUS_BITS_INVALID;
 *     if (observer_peek(client, &estimate) == OBSERVER_OK && !(estimate.status & do_not_fly)
 *         && observer_now_ns() - estimate.publish_stamp_ns < 100000000) ... // a dead service's last one stays
 *     observer_close(client);
 *
 * Results below 0 are failures. Any thread may call; a handle belongs to the thread that opened it, and every other
 * thread's call is refused. Signal handlers and forked children must not call.
 * Once a handle is open, observer_publish, _take, _peek and _read_status make no system call.
 * All quantities are SI; the unit is in the name. Frames: inertial, and the body's; attitude_wxyz rotates
 * body vectors into the inertial frame. */

#ifndef OBSERVER_CLIENT_H
#define OBSERVER_CLIENT_H

#include <assert.h>
#include <stddef.h>
#include <stdint.h>

/** Tells the payloads of one version from those of another: for observer_open(). */
#define OBSERVER_LAYOUT UINT32_C(0x5506a066)

/** Enough for the text of any reply, with its end. */
#define OBSERVER_REPLY_TEXT_BYTES 249

/* Bits of observer_measurement.valid: which fields carry a measurement. */
/** `velocity_m_s`, in the frame that `velocity_frame` names. */
#define OBSERVER_VALID_VELOCITY (UINT32_C(1) << 0)
/** `angular_velocity_rad_s`. */
#define OBSERVER_VALID_ANGULAR_VELOCITY (UINT32_C(1) << 1)
/** `position_m`. */
#define OBSERVER_VALID_POSITION (UINT32_C(1) << 2)
/** `attitude_wxyz`. */
#define OBSERVER_VALID_ATTITUDE (UINT32_C(1) << 3)
/** `force_n`: replaces the held command. Until the first one the command is zero. */
#define OBSERVER_VALID_FORCE (UINT32_C(1) << 4)
/** `torque_n_m`: replaces the held command. Until the first one the command is zero. */
#define OBSERVER_VALID_TORQUE (UINT32_C(1) << 5)
/** Every field of a rigid body. */
#define OBSERVER_VALID_RIGID_BODY ((UINT32_C(1) << 6) - UINT32_C(1))
/** `output` of a general linear plant. */
#define OBSERVER_VALID_OUTPUT (UINT32_C(1) << 6)
/** `input` of a general linear plant: replaces the held one. Until the first one it is zero. */
#define OBSERVER_VALID_INPUT (UINT32_C(1) << 7)
/** Every bit that has a meaning. */
#define OBSERVER_VALID_ALL ((UINT32_C(1) << 8) - UINT32_C(1))

/* Values of observer_measurement.velocity_frame. */
/** Components along the inertial axes. */
#define OBSERVER_FRAME_INERTIAL (UINT32_C(0))
/** Components along the body axes (a Doppler log). */
#define OBSERVER_FRAME_BODY (UINT32_C(1))

/* Bits of observer_estimate.status. */
/** Every configured channel follows measurements that it holds now. */
#define OBSERVER_STATUS_BITS_TRACKING (UINT64_C(1) << 0)
/** The translation channel predicts without a velocity measurement. */
#define OBSERVER_STATUS_BITS_COASTING_TRANSLATION (UINT64_C(1) << 1)
/** The rotation channel predicts without an angular-velocity measurement. */
#define OBSERVER_STATUS_BITS_COASTING_ROTATION (UINT64_C(1) << 2)
/** The general linear plant's channel predicts without an output. */
#define OBSERVER_STATUS_BITS_COASTING_LINEAR (UINT64_C(1) << 11)
/** Any channel coasts. */
#define OBSERVER_STATUS_BITS_COASTING (OBSERVER_STATUS_BITS_COASTING_TRANSLATION | OBSERVER_STATUS_BITS_COASTING_ROTATION | OBSERVER_STATUS_BITS_COASTING_LINEAR)
/** No sample for longer than `stale_after_s`, or none yet: do not fly on this. */
#define OBSERVER_STATUS_BITS_STALE (UINT64_C(1) << 3)
/** A channel's dead zone is open: the unknown force is being learned now. */
#define OBSERVER_STATUS_BITS_ADAPTING (UINT64_C(1) << 4)
/** Adaptation was frozen by an operator. */
#define OBSERVER_STATUS_BITS_FROZEN (UINT64_C(1) << 5)
/** The held output lies outside the box of the kernel centers: nothing was learned there. */
#define OBSERVER_STATUS_BITS_OUTSIDE_CENTERS (UINT64_C(1) << 6)
/** A sample was rejected since the previous estimate. */
#define OBSERVER_STATUS_BITS_REJECTED_SAMPLE (UINT64_C(1) << 7)
/** The dead zone's output was clamped to the stability bound of the sampled law. */
#define OBSERVER_STATUS_BITS_CLAMPED (UINT64_C(1) << 8)
/** The state was not finite or beyond limits and was reset to the last good copy. */
#define OBSERVER_STATUS_BITS_DIVERGED (UINT64_C(1) << 9)
/** No sample was ever accepted: the estimate is the initial state. */
#define OBSERVER_STATUS_BITS_WAITING (UINT64_C(1) << 10)
/** The tick before ended after its next deadline: the loop is late. */
#define OBSERVER_STATUS_BITS_LATE (UINT64_C(1) << 12)
/** The loop was late so many times in a row that samples are not used: the estimate is predicted only. */
#define OBSERVER_STATUS_BITS_PREDICT_ONLY (UINT64_C(1) << 13)
/** The loop was late for so long that the estimate is not to be used at all: do not fly on this. */
#define OBSERVER_STATUS_BITS_INVALID (UINT64_C(1) << 14)
/** An output that is implausible against its recent errors was held back since the previous estimate. */
#define OBSERVER_STATUS_BITS_HELD_BACK (UINT64_C(1) << 15)
/** A sensor repeats one value to the bit. */
#define OBSERVER_STATUS_BITS_STUCK (UINT64_C(1) << 16)

/* Bits of observer_status.real_time_requested and observer_status.real_time_granted. */
/** A fixed priority (SCHED_FIFO) for the loop. */
#define OBSERVER_REAL_TIME_PRIORITY (UINT64_C(1) << 0)
/** Cores of the loop's own choice. */
#define OBSERVER_REAL_TIME_CORES (UINT64_C(1) << 1)
/** Memory that is neither swapped out nor mapped late. */
#define OBSERVER_REAL_TIME_LOCKED_MEMORY (UINT64_C(1) << 2)
/** Timers without slack. */
#define OBSERVER_REAL_TIME_PUNCTUAL_TIMERS (UINT64_C(1) << 3)
/** Cores that wake up at once. */
#define OBSERVER_REAL_TIME_AWAKE_CORES (UINT64_C(1) << 4)

/* Values of observer_status.snapshot_restored. */
/** The service started with nothing learned. */
#define OBSERVER_RESTORED_NOTHING (UINT64_C(0))
/** It started with what an earlier one had learned. */
#define OBSERVER_RESTORED_LEARNED (UINT64_C(1))
/** It started with that and with the state, and goes on from there. */
#define OBSERVER_RESTORED_LEARNED_AND_STATE (UINT64_C(2))

/* Values of `command` in observer_command(). */
/** Forget state and weights; start again from the next sample. */
#define OBSERVER_COMMAND_RESET (UINT32_C(1))
/** Stop learning; keep using what was learned. */
#define OBSERVER_COMMAND_FREEZE (UINT32_C(2))
/** Learn again. */
#define OBSERVER_COMMAND_THAW (UINT32_C(3))
/** Write the learned weights to disk. */
#define OBSERVER_COMMAND_SAVE (UINT32_C(4))
/** Only answer with the status. */
#define OBSERVER_COMMAND_STATUS (UINT32_C(5))

/* Values of observer_reply.outcome. */
/** Done: the loop has carried the command out. */
#define OBSERVER_OUTCOME_DONE (UINT32_C(0))
/** Refused: `message` says why. */
#define OBSERVER_OUTCOME_REFUSED (UINT32_C(1))
/** The command's kind is unknown to this service. */
#define OBSERVER_OUTCOME_UNKNOWN (UINT32_C(2))

/* What a handle is opened for: bits of `ports` in observer_open(). */
/** observer_publish(): a source. An instance has 8 places for sources. */
#define OBSERVER_PORTS_PUBLISH (UINT32_C(1) << 0)
/** observer_take() and observer_wait(): a queue of 256 estimates. An instance has 32 places for readers of estimates. */
#define OBSERVER_PORTS_TAKE (UINT32_C(1) << 1)
/** observer_peek(): the newest estimate. It takes a place for a reader of estimates, too. */
#define OBSERVER_PORTS_PEEK (UINT32_C(1) << 2)
/** observer_read_status(): the newest status. An instance has 32 places for readers of it. */
#define OBSERVER_PORTS_STATUS (UINT32_C(1) << 3)
/** All of these. */
#define OBSERVER_PORTS_ALL ((UINT32_C(1) << 4) - UINT32_C(1))

/**
 * How a call ended: 0 and above are good, below are failures, whose reason observer_error_text() tells.
 */
typedef enum {
  /**
   * Done.
   */
  OBSERVER_OK = 0,
  /**
   * No failure, but there is nothing: nothing to take, nothing published yet, nobody who listens.
   */
  OBSERVER_NOTHING = 1,
  /**
   * An argument cannot be: null, not aligned, no text, not finite, another header, a port not asked for.
   */
  OBSERVER_BAD_ARGUMENT = -1,
  /**
   * The handle is not open: never was, or was closed.
   */
  OBSERVER_BAD_HANDLE = -2,
  /**
   * Another thread opened the handle. A handle is used, and closed, by the thread that opened it.
   */
  OBSERVER_WRONG_THREAD = -3,
  /**
   * No service of that instance was there within the patience.
   */
  OBSERVER_NO_DAEMON = -4,
  /**
   * The service did not answer within the patience.
   */
  OBSERVER_TIMED_OUT = -5,
  /**
   * What is there does not fit: another version of a payload or of iceoryx2, other qualities, another user's.
   */
  OBSERVER_REFUSED = -6,
  /**
   * A port did not do it; the text has iceoryx2's reason.
   */
  OBSERVER_PORT = -7,
  /**
   * A defect of this library. Nothing is known of the handle's state: close it.
   */
  OBSERVER_INTERNAL = -8,
} observer_result;

/**
 * Why a sample was rejected; the value is its index in observer_status.samples_rejected.
 */
typedef enum {
  /**
   * A valid field is NaN or infinite.
   */
  OBSERVER_REJECTION_NOT_FINITE,
  /**
   * A valid field is beyond the configured physical limit.
   */
  OBSERVER_REJECTION_BEYOND_LIMITS,
  /**
   * The attitude is not of unit norm.
   */
  OBSERVER_REJECTION_QUATERNION_NORM,
  /**
   * The stamp is the same as the newest accepted one.
   */
  OBSERVER_REJECTION_REPEATED_STAMP,
  /**
   * The stamp is older than the newest accepted one.
   */
  OBSERVER_REJECTION_OLDER_STAMP,
  /**
   * The stamp lies too far behind the clock.
   */
  OBSERVER_REJECTION_TOO_OLD,
  /**
   * The stamp lies too far ahead of the clock.
   */
  OBSERVER_REJECTION_FAR_FUTURE,
  /**
   * The sequence went backwards although the source is the same.
   */
  OBSERVER_REJECTION_SEQUENCE_BACKWARDS,
  /**
   * Another source holds the stream.
   */
  OBSERVER_REJECTION_OTHER_SOURCE,
  /**
   * No valid field, an unknown bit or an unknown frame.
   */
  OBSERVER_REJECTION_MALFORMED,
  /**
   * The loop was late for too long to use it.
   */
  OBSERVER_REJECTION_OVERLOAD,
} observer_rejection;

/**
 * A connection to one instance of the service, of the thread that opened it. All zero is none.
 */
typedef struct {
  /**
   * For the library.
   */
  uint32_t thread;
  /**
   * For the library.
   */
  uint32_t number;
} observer_client;

/**
 * One set of sensor readings and commands, all taken at `stamp_ns`.
 */
typedef struct {
  /**
   * Counts from 0, one up per sample; a gap counts as loss.
   */
  uint64_t sequence;
  /**
   * CLOCK_MONOTONIC of the source when the readings were taken (ns).
   */
  uint64_t stamp_ns;
  /**
   * Which of the fields below are valid: bits of OBSERVER_VALID_….
   */
  uint32_t valid;
  /**
   * Frame of `velocity_m_s`: OBSERVER_FRAME_INERTIAL or OBSERVER_FRAME_BODY.
   */
  uint32_t velocity_frame;
  /**
   * Velocity of the center of mass (m/s).
   */
  double velocity_m_s[3];
  /**
   * Angular velocity, body axes (rad/s).
   */
  double angular_velocity_rad_s[3];
  /**
   * Position fix, inertial (m).
   */
  double position_m[3];
  /**
   * Attitude fix, unit quaternion w, x, y, z, body to inertial.
   */
  double attitude_wxyz[4];
  /**
   * Commanded force, inertial axes (N), held until the next one.
   */
  double force_n[3];
  /**
   * Commanded torque, body axes (N·m), held until the next one.
   */
  double torque_n_m[3];
  /**
   * y of a general linear plant, its first m entries, in the units of its configuration.
   */
  double output[6];
  /**
   * u of a general linear plant, its first m entries, held until the next one.
   */
  double input[6];
} observer_measurement;

/**
 * How far one channel's estimate can be trusted.
 *
 * Units are those of the channel's output: m/s for translation, rad/s for rotation, of the configuration for a
 * general linear plant; forces N or N·m.
 */
typedef struct {
  /**
   * ‖ỹ‖ = ‖y − Cx̂‖ at the held sample; 0 while coasting.
   */
  double output_error;
  /**
   * σ, the dead zone's output now: 0 is closed, nothing is learned.
   */
  double activation;
  /**
   * P_N(y) / √κ(0), 0 … 1: 0 at a center, 1 where the centers cover nothing.
   */
  double power_function;
  /**
   * ‖f̂_N‖ in the native space.
   */
  double native_norm;
  /**
   * How far the learned force may be from that of the dense solver (N; N·m): the local solver's estimate of its own
   * error; 0 where the dense one is in use.
   */
  double solver_error;
  /**
   * max(d, d_N): the size that the theorems claim ‖e‖ settles below, if their conditions hold (`daemon check`
   * tells). A bound, not a covariance; +∞ while coasting.
   */
  double error_bound;
  /**
   * Time since the stamp of the newest output measurement (s); +∞ before the first.
   */
  double output_age_s;
} observer_channel;

/**
 * The state estimate at `stamp_ns`, and how far it can be trusted.
 */
typedef struct {
  /**
   * Counts the service's publications from 0.
   */
  uint64_t sequence;
  /**
   * Sequence of the newest sample that went into this estimate.
   */
  uint64_t source_sequence;
  /**
   * Time of the state (ns).
   */
  uint64_t stamp_ns;
  /**
   * Stamp of the newest sample that went into this estimate (ns); 0 before the first.
   */
  uint64_t source_stamp_ns;
  /**
   * CLOCK_MONOTONIC just before publication (ns).
   */
  uint64_t publish_stamp_ns;
  /**
   * Bits of OBSERVER_STATUS_BITS_….
   */
  uint64_t status;
  /**
   * Position, inertial (m). Dead-reckoned from velocity unless position fixes are used.
   */
  double position_m[3];
  /**
   * Velocity, inertial (m/s).
   */
  double velocity_m_s[3];
  /**
   * Attitude, unit quaternion w, x, y, z, body to inertial.
   */
  double attitude_wxyz[4];
  /**
   * 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π].
   */
  double euler_rad[3];
  /**
   * Angular velocity, body axes (rad/s).
   */
  double angular_velocity_rad_s[3];
  /**
   * f̂: the learned unknown force, inertial axes (N).
   */
  double matched_force_n[3];
  /**
   * f̂: the learned unknown torque, body axes (N·m).
   */
  double matched_torque_n_m[3];
  /**
   * Trust in position, velocity and force.
   */
  observer_channel translation;
  /**
   * Trust in attitude, angular velocity and torque.
   */
  observer_channel rotation;
  /**
   * x̂ of a general linear plant, its first n entries, in the units of its configuration.
   */
  double state[12];
  /**
   * f̂ of a general linear plant, its first m entries.
   */
  double matched_input[6];
  /**
   * Trust in `state` and `matched_input`.
   */
  observer_channel linear;
} observer_estimate;

/**
 * Quantiles of one latency (ns) since the service started.
 */
typedef struct {
  /**
   * Number of values.
   */
  uint64_t count;
  /**
   * Median.
   */
  uint64_t p50;
  /**
   * 90 % quantile.
   */
  uint64_t p90;
  /**
   * 99 % quantile.
   */
  uint64_t p99;
  /**
   * 99.9 % quantile.
   */
  uint64_t p999;
  /**
   * Largest value.
   */
  uint64_t max;
} observer_latency_summary;

/**
 * What the service did since it started.
 */
typedef struct {
  /**
   * Counts publications from 0.
   */
  uint64_t sequence;
  /**
   * CLOCK_MONOTONIC of this status (ns).
   */
  uint64_t stamp_ns;
  /**
   * CLOCK_MONOTONIC of the service's start (ns).
   */
  uint64_t start_stamp_ns;
  /**
   * Configured rate (mHz: 200 Hz is 200 000).
   */
  uint64_t rate_millihertz;
  /**
   * d, the width of the dead zone of translation (m/s), rotation (rad/s), linear plant (its output's unit): up to
   * it an output error is noise, and nothing is learned; 0 where there is no such channel.
   */
  double dead_zone_width[3];
  /**
   * Ticks served, each with one estimate.
   */
  uint64_t ticks;
  /**
   * Deadlines that passed unserved because a tick ended too late; they were skipped.
   */
  uint64_t deadline_misses;
  /**
   * Samples used.
   */
  uint64_t samples_accepted;
  /**
   * Gaps in the source's sequence: samples that never arrived.
   */
  uint64_t samples_lost;
  /**
   * Samples rejected, by observer_rejection.
   */
  uint64_t samples_rejected[11];
  /**
   * Sequence of the newest accepted sample.
   */
  uint64_t newest_sequence;
  /**
   * Age of the newest accepted sample (ns); `u64.MAX` before the first.
   */
  uint64_t newest_sample_age_ns;
  /**
   * Ticks on which a channel coasted.
   */
  uint64_t ticks_coasting;
  /**
   * Ticks on which the dead zone's output was clamped to the stability bound.
   */
  uint64_t ticks_clamped;
  /**
   * Times the state was reset to the last good copy.
   */
  uint64_t state_resets;
  /**
   * Times the source restarted or another one took over.
   */
  uint64_t source_changes;
  /**
   * Process id of the source in use; 0 if none or unknown.
   */
  uint64_t source_pid;
  /**
   * Process id of another source that publishes too; 0 if none.
   */
  uint64_t other_source_pid;
  /**
   * Commands carried out.
   */
  uint64_t commands;
  /**
   * Tick records that the status thread was too slow to take.
   */
  uint64_t records_dropped;
  /**
   * 1 while adaptation is frozen by an operator.
   */
  uint64_t adaptation_frozen;
  /**
   * Outputs whose error was implausible against its running scale, and which were held back from adaptation or
   * from correction too: of translation, rotation, linear plant.
   */
  uint64_t outputs_held_back[3];
  /**
   * Outputs that repeated the one before to the bit, for longer than a living sensor does; likewise.
   */
  uint64_t outputs_stuck[3];
  /**
   * Ticks in a row that ended after their next deadline, now.
   */
  uint64_t late_ticks_in_a_row;
  /**
   * The most so far.
   */
  uint64_t most_late_ticks_in_a_row;
  /**
   * Ticks on which samples were not used because the loop was late.
   */
  uint64_t ticks_predict_only;
  /**
   * Ticks whose estimate was marked invalid.
   */
  uint64_t ticks_invalid;
  /**
   * Real-time settings that the configuration asks for: bits of OBSERVER_REAL_TIME_….
   */
  uint64_t real_time_requested;
  /**
   * Real-time settings that the system granted.
   */
  uint64_t real_time_granted;
  /**
   * What was restored at the start: one of OBSERVER_RESTORED_….
   */
  uint64_t snapshot_restored;
  /**
   * Snapshots written.
   */
  uint64_t snapshots_saved;
  /**
   * Snapshots that could not be written.
   */
  uint64_t snapshots_failed;
  /**
   * CLOCK_MONOTONIC of the state in the newest snapshot of this service (ns); 0 if none.
   */
  uint64_t snapshot_stamp_ns;
  /**
   * Ticks written to the flight record.
   */
  uint64_t ticks_recorded;
  /**
   * Ticks that the recorder was too slow to take.
   */
  uint64_t ticks_not_recorded;
  /**
   * Deadline to wake-up (ns).
   */
  observer_latency_summary wake_up_lateness_ns;
  /**
   * Wake-up to publication: samples taken, stepped, estimate written (ns).
   */
  observer_latency_summary step_ns;
  /**
   * Source stamp of the newest sample to wake-up, on ticks with a new sample (ns).
   */
  observer_latency_summary input_age_ns;
  /**
   * Source stamp of the newest sample to publication, on ticks with a new sample (ns).
   */
  observer_latency_summary source_to_publish_ns;
} observer_status;

/**
 * The service's answer, with its status after the command.
 */
typedef struct {
  /**
   * One of OBSERVER_OUTCOME_….
   */
  uint32_t outcome;
  /**
   * Bytes of `message` in use.
   */
  uint32_t message_bytes;
  /**
   * UTF-8 text.
   */
  uint8_t message[248];
  /**
   * Status after the command.
   */
  observer_status status;
} observer_reply;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Connects this thread to the service of an instance, and opens the ports that are asked for: what allocates
 * and asks the system happens here. Waits up to `patience_s` for the service to start.
 *
 * `layout`: OBSERVER_LAYOUT, which tells whether program and library have the same payloads.
 * `root_path`: the domain's, absolute; null for $OBSERVER_ROOT or, without it, the user's own.
 * `instance`: the vehicle's name, usually "vehicle".
 * `ports`: bits of OBSERVER_PORTS_….
 * `patience_s`: 0 to 1e9 s.
 * `client`: where the handle goes; all zero after a failure.
 *
 * Condition:
 * The texts end with a zero; `client` points to a handle.
 */
observer_result observer_open(uint32_t layout,
                              const char *root_path,
                              const char *instance,
                              uint32_t ports,
                              double patience_s,
                              observer_client *client);

/**
 * Publishes one measurement; its sequence and its stamp (observer_now_ns()) are the caller's. Never blocks: where
 * the service is slow, the oldest sample is dropped. OBSERVER_NOTHING: no service is connected now.
 *
 * No system call; one allocation, of iceoryx2 (48 bytes, freed before the call returns).
 *
 * Condition:
 * `measurement` points to one.
 */
observer_result observer_publish(observer_client client,
                                 const observer_measurement *measurement);

/**
 * Takes the oldest estimate not yet taken; OBSERVER_NOTHING leaves `estimate` as it is. Where the reader is slow,
 * the oldest are dropped, which shows as a gap in their sequence. No system call, no allocation.
 *
 * Condition:
 * `estimate` points to one.
 */
observer_result observer_take(observer_client client,
                              observer_estimate *estimate);

/**
 * As observer_take(), but waits up to `patience_s` for an estimate, and looks every 50 µs (sleeping in between);
 * OBSERVER_TIMED_OUT if none came.
 *
 * Condition:
 * `estimate` points to one.
 */
observer_result observer_wait(observer_client client,
                              double patience_s,
                              observer_estimate *estimate);

/**
 * The newest estimate, taken or not; OBSERVER_NOTHING before the first leaves `estimate` as it is. When the
 * service dies the last one stays: its age is in its stamps. No system call, no allocation.
 *
 * Condition:
 * `estimate` points to one.
 */
observer_result observer_peek(observer_client client, observer_estimate *estimate);

/**
 * The newest status, which the service publishes a few times a second; OBSERVER_NOTHING before the first leaves
 * `status` as it is. No system call, no allocation.
 *
 * Condition:
 * `status` points to one.
 */
observer_result observer_read_status(observer_client client,
                                     observer_status *status);

/**
 * Sends a command (one of OBSERVER_COMMAND_…) and waits up to `patience_s` for the answer. OBSERVER_OK means that
 * there is one: its `outcome` says whether the command was carried out, observer_reply_text() what the service
 * says. Where the service is away, it is waited for as long as observer_open() was to. Allocates and asks the
 * system: not for the loop.
 *
 * Condition:
 * `reply` points to one.
 */
observer_result observer_command(observer_client client,
                                 uint32_t command,
                                 double patience_s,
                                 observer_reply *reply);

/**
 * Copies the text of a reply, with a zero at its end, cut where `text_bytes` are too few; OBSERVER_REPLY_TEXT_BYTES
 * are enough.
 *
 * Condition:
 * `reply` points to one, `text` to `text_bytes` bytes.
 */
observer_result observer_reply_text(const observer_reply *reply,
                                    char *text,
                                    size_t text_bytes);

/**
 * Closes a handle, on the thread that opened it. What a thread leaves open is closed when it ends.
 */
observer_result observer_close(observer_client client);

/**
 * Nanoseconds of CLOCK_MONOTONIC, the clock of every stamp. No system call where the kernel offers the vDSO.
 */
uint64_t observer_now_ns(void);

/**
 * What was found, needed, and what to do, of this thread's latest failure; empty before the first. Never null; valid until this
 * thread's next failure.
 */
const char *observer_error_text(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

/* The payloads as the library was compiled. */
static_assert(sizeof(observer_measurement) == 272, "size of observer_measurement");
static_assert(offsetof(observer_measurement, sequence) == 0, "observer_measurement.sequence");
static_assert(offsetof(observer_measurement, stamp_ns) == 8, "observer_measurement.stamp_ns");
static_assert(offsetof(observer_measurement, valid) == 16, "observer_measurement.valid");
static_assert(offsetof(observer_measurement, velocity_frame) == 20, "observer_measurement.velocity_frame");
static_assert(offsetof(observer_measurement, velocity_m_s) == 24, "observer_measurement.velocity_m_s");
static_assert(offsetof(observer_measurement, angular_velocity_rad_s) == 48, "observer_measurement.angular_velocity_rad_s");
static_assert(offsetof(observer_measurement, position_m) == 72, "observer_measurement.position_m");
static_assert(offsetof(observer_measurement, attitude_wxyz) == 96, "observer_measurement.attitude_wxyz");
static_assert(offsetof(observer_measurement, force_n) == 128, "observer_measurement.force_n");
static_assert(offsetof(observer_measurement, torque_n_m) == 152, "observer_measurement.torque_n_m");
static_assert(offsetof(observer_measurement, output) == 176, "observer_measurement.output");
static_assert(offsetof(observer_measurement, input) == 224, "observer_measurement.input");
static_assert(sizeof(observer_channel) == 56, "size of observer_channel");
static_assert(offsetof(observer_channel, output_error) == 0, "observer_channel.output_error");
static_assert(offsetof(observer_channel, activation) == 8, "observer_channel.activation");
static_assert(offsetof(observer_channel, power_function) == 16, "observer_channel.power_function");
static_assert(offsetof(observer_channel, native_norm) == 24, "observer_channel.native_norm");
static_assert(offsetof(observer_channel, solver_error) == 32, "observer_channel.solver_error");
static_assert(offsetof(observer_channel, error_bound) == 40, "observer_channel.error_bound");
static_assert(offsetof(observer_channel, output_age_s) == 48, "observer_channel.output_age_s");
static_assert(sizeof(observer_estimate) == 536, "size of observer_estimate");
static_assert(offsetof(observer_estimate, sequence) == 0, "observer_estimate.sequence");
static_assert(offsetof(observer_estimate, source_sequence) == 8, "observer_estimate.source_sequence");
static_assert(offsetof(observer_estimate, stamp_ns) == 16, "observer_estimate.stamp_ns");
static_assert(offsetof(observer_estimate, source_stamp_ns) == 24, "observer_estimate.source_stamp_ns");
static_assert(offsetof(observer_estimate, publish_stamp_ns) == 32, "observer_estimate.publish_stamp_ns");
static_assert(offsetof(observer_estimate, status) == 40, "observer_estimate.status");
static_assert(offsetof(observer_estimate, position_m) == 48, "observer_estimate.position_m");
static_assert(offsetof(observer_estimate, velocity_m_s) == 72, "observer_estimate.velocity_m_s");
static_assert(offsetof(observer_estimate, attitude_wxyz) == 96, "observer_estimate.attitude_wxyz");
static_assert(offsetof(observer_estimate, euler_rad) == 128, "observer_estimate.euler_rad");
static_assert(offsetof(observer_estimate, angular_velocity_rad_s) == 152, "observer_estimate.angular_velocity_rad_s");
static_assert(offsetof(observer_estimate, matched_force_n) == 176, "observer_estimate.matched_force_n");
static_assert(offsetof(observer_estimate, matched_torque_n_m) == 200, "observer_estimate.matched_torque_n_m");
static_assert(offsetof(observer_estimate, translation) == 224, "observer_estimate.translation");
static_assert(offsetof(observer_estimate, rotation) == 280, "observer_estimate.rotation");
static_assert(offsetof(observer_estimate, state) == 336, "observer_estimate.state");
static_assert(offsetof(observer_estimate, matched_input) == 432, "observer_estimate.matched_input");
static_assert(offsetof(observer_estimate, linear) == 480, "observer_estimate.linear");
static_assert(sizeof(observer_latency_summary) == 48, "size of observer_latency_summary");
static_assert(offsetof(observer_latency_summary, count) == 0, "observer_latency_summary.count");
static_assert(offsetof(observer_latency_summary, p50) == 8, "observer_latency_summary.p50");
static_assert(offsetof(observer_latency_summary, p90) == 16, "observer_latency_summary.p90");
static_assert(offsetof(observer_latency_summary, p99) == 24, "observer_latency_summary.p99");
static_assert(offsetof(observer_latency_summary, p999) == 32, "observer_latency_summary.p999");
static_assert(offsetof(observer_latency_summary, max) == 40, "observer_latency_summary.max");
static_assert(sizeof(observer_status) == 600, "size of observer_status");
static_assert(offsetof(observer_status, sequence) == 0, "observer_status.sequence");
static_assert(offsetof(observer_status, stamp_ns) == 8, "observer_status.stamp_ns");
static_assert(offsetof(observer_status, start_stamp_ns) == 16, "observer_status.start_stamp_ns");
static_assert(offsetof(observer_status, rate_millihertz) == 24, "observer_status.rate_millihertz");
static_assert(offsetof(observer_status, dead_zone_width) == 32, "observer_status.dead_zone_width");
static_assert(offsetof(observer_status, ticks) == 56, "observer_status.ticks");
static_assert(offsetof(observer_status, deadline_misses) == 64, "observer_status.deadline_misses");
static_assert(offsetof(observer_status, samples_accepted) == 72, "observer_status.samples_accepted");
static_assert(offsetof(observer_status, samples_lost) == 80, "observer_status.samples_lost");
static_assert(offsetof(observer_status, samples_rejected) == 88, "observer_status.samples_rejected");
static_assert(offsetof(observer_status, newest_sequence) == 176, "observer_status.newest_sequence");
static_assert(offsetof(observer_status, newest_sample_age_ns) == 184, "observer_status.newest_sample_age_ns");
static_assert(offsetof(observer_status, ticks_coasting) == 192, "observer_status.ticks_coasting");
static_assert(offsetof(observer_status, ticks_clamped) == 200, "observer_status.ticks_clamped");
static_assert(offsetof(observer_status, state_resets) == 208, "observer_status.state_resets");
static_assert(offsetof(observer_status, source_changes) == 216, "observer_status.source_changes");
static_assert(offsetof(observer_status, source_pid) == 224, "observer_status.source_pid");
static_assert(offsetof(observer_status, other_source_pid) == 232, "observer_status.other_source_pid");
static_assert(offsetof(observer_status, commands) == 240, "observer_status.commands");
static_assert(offsetof(observer_status, records_dropped) == 248, "observer_status.records_dropped");
static_assert(offsetof(observer_status, adaptation_frozen) == 256, "observer_status.adaptation_frozen");
static_assert(offsetof(observer_status, outputs_held_back) == 264, "observer_status.outputs_held_back");
static_assert(offsetof(observer_status, outputs_stuck) == 288, "observer_status.outputs_stuck");
static_assert(offsetof(observer_status, late_ticks_in_a_row) == 312, "observer_status.late_ticks_in_a_row");
static_assert(offsetof(observer_status, most_late_ticks_in_a_row) == 320, "observer_status.most_late_ticks_in_a_row");
static_assert(offsetof(observer_status, ticks_predict_only) == 328, "observer_status.ticks_predict_only");
static_assert(offsetof(observer_status, ticks_invalid) == 336, "observer_status.ticks_invalid");
static_assert(offsetof(observer_status, real_time_requested) == 344, "observer_status.real_time_requested");
static_assert(offsetof(observer_status, real_time_granted) == 352, "observer_status.real_time_granted");
static_assert(offsetof(observer_status, snapshot_restored) == 360, "observer_status.snapshot_restored");
static_assert(offsetof(observer_status, snapshots_saved) == 368, "observer_status.snapshots_saved");
static_assert(offsetof(observer_status, snapshots_failed) == 376, "observer_status.snapshots_failed");
static_assert(offsetof(observer_status, snapshot_stamp_ns) == 384, "observer_status.snapshot_stamp_ns");
static_assert(offsetof(observer_status, ticks_recorded) == 392, "observer_status.ticks_recorded");
static_assert(offsetof(observer_status, ticks_not_recorded) == 400, "observer_status.ticks_not_recorded");
static_assert(offsetof(observer_status, wake_up_lateness_ns) == 408, "observer_status.wake_up_lateness_ns");
static_assert(offsetof(observer_status, step_ns) == 456, "observer_status.step_ns");
static_assert(offsetof(observer_status, input_age_ns) == 504, "observer_status.input_age_ns");
static_assert(offsetof(observer_status, source_to_publish_ns) == 552, "observer_status.source_to_publish_ns");
static_assert(sizeof(observer_reply) == 856, "size of observer_reply");
static_assert(offsetof(observer_reply, outcome) == 0, "observer_reply.outcome");
static_assert(offsetof(observer_reply, message_bytes) == 4, "observer_reply.message_bytes");
static_assert(offsetof(observer_reply, message) == 8, "observer_reply.message");
static_assert(offsetof(observer_reply, status) == 256, "observer_reply.status");
#endif // OBSERVER_CLIENT_H
