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
#define OBSERVER_LAYOUT UINT32_C(0xdc3f9be5)

/** Enough for the text of any reply, with its end. */
#define OBSERVER_REPLY_TEXT_BYTES 249

/* Bits of observer_measurement.valid: which fields carry a measurement. */
#define OBSERVER_VALID_VELOCITY UINT32_C(0x1) /**< `velocity_m_s`. */
#define OBSERVER_VALID_ANGULAR_VELOCITY UINT32_C(0x2) /**< `angular_velocity_rad_s`. */
#define OBSERVER_VALID_SPECIFIC_FORCE UINT32_C(0x100) /**< `specific_force_m_s2`. */
#define OBSERVER_VALID_POSITION UINT32_C(0x4) /**< `position_m`. */
#define OBSERVER_VALID_ATTITUDE UINT32_C(0x8) /**< `attitude_wxyz`. */
#define OBSERVER_VALID_FORCE UINT32_C(0x10) /**< `force_n`. */
#define OBSERVER_VALID_TORQUE UINT32_C(0x20) /**< `torque_n_m`. */
#define OBSERVER_VALID_OUTPUT UINT32_C(0x40) /**< `output`. */
#define OBSERVER_VALID_INPUT UINT32_C(0x80) /**< `input`. */
#define OBSERVER_VALID_RIGID_BODY UINT32_C(0x3f) /**< Every field of a rigid body but the specific force. */
#define OBSERVER_VALID_ALL UINT32_C(0x1ff) /**< Every bit that has a meaning. */

/* Values of observer_measurement.velocity_frame and observer_measurement.force_frame. */
#define OBSERVER_FRAME_INERTIAL UINT32_C(0x0) /**< Components along the inertial axes. */
/** Components along the body axes (a Doppler log; the thrust of a multicopter). */
#define OBSERVER_FRAME_BODY UINT32_C(0x1)

/* Bits of observer_measurement.flags. A sample with any other bit is malformed, as with any other bit of `valid`. */
/** The vehicle stands on the ground, by its own landed detector. Nothing is learned while the newest sample
 * has this bit: the ground's reaction is no force of the motion. */
#define OBSERVER_FLAGS_ON_GROUND UINT32_C(0x1)
#define OBSERVER_FLAGS_ALL UINT32_C(0x1) /**< Every bit that has a meaning. */

/* Bits of observer_measurement.absent: components of a valid field that were not measured, as of a depth or of a Doppler log that has two axes. The joint law takes the others; a velocity in body axes and a specific force must have all of them. */
#define OBSERVER_ABSENT_VELOCITY_X UINT32_C(0x1) /**< x of the velocity. */
#define OBSERVER_ABSENT_VELOCITY_Y UINT32_C(0x2) /**< y of the velocity. */
#define OBSERVER_ABSENT_VELOCITY_Z UINT32_C(0x4) /**< z of the velocity. */
#define OBSERVER_ABSENT_ANGULAR_VELOCITY_X UINT32_C(0x8) /**< x of the angular velocity. */
#define OBSERVER_ABSENT_ANGULAR_VELOCITY_Y UINT32_C(0x10) /**< y of the angular velocity. */
#define OBSERVER_ABSENT_ANGULAR_VELOCITY_Z UINT32_C(0x20) /**< z of the angular velocity. */
#define OBSERVER_ABSENT_POSITION_X UINT32_C(0x40) /**< x of the position. */
#define OBSERVER_ABSENT_POSITION_Y UINT32_C(0x80) /**< y of the position. */
#define OBSERVER_ABSENT_POSITION_Z UINT32_C(0x100) /**< z of the position. */
#define OBSERVER_ABSENT_SPECIFIC_FORCE_X UINT32_C(0x200) /**< x of the specific force. */
#define OBSERVER_ABSENT_SPECIFIC_FORCE_Y UINT32_C(0x400) /**< y of the specific force. */
#define OBSERVER_ABSENT_SPECIFIC_FORCE_Z UINT32_C(0x800) /**< z of the specific force. */
#define OBSERVER_ABSENT_ALL UINT32_C(0xfff) /**< Every bit that has a meaning. */

/* Bits of observer_estimate.status. */
/** Every configured channel follows measurements that it holds now, and none is reacquiring. */
#define OBSERVER_STATUS_BITS_TRACKING UINT64_C(0x1)
/** The translation channel predicts without a velocity measurement. */
#define OBSERVER_STATUS_BITS_COASTING_TRANSLATION UINT64_C(0x2)
/** The rotation channel predicts without an angular-velocity measurement. */
#define OBSERVER_STATUS_BITS_COASTING_ROTATION UINT64_C(0x4)
/** A configured channel is stale, or no sample came for longer than `stale_after_s`: do not fly on this. The
 * bits `STALE_…` say which channel. */
#define OBSERVER_STATUS_BITS_STALE UINT64_C(0x8)
/** A channel's dead zone is open: the unknown force is being learned now. */
#define OBSERVER_STATUS_BITS_ADAPTING UINT64_C(0x10)
#define OBSERVER_STATUS_BITS_FROZEN UINT64_C(0x20) /**< Adaptation was frozen by an operator. */
/** The held output lies outside the box of the kernel centers: nothing was learned there. */
#define OBSERVER_STATUS_BITS_OUTSIDE_CENTERS UINT64_C(0x40)
/** A sample was rejected since the previous estimate. */
#define OBSERVER_STATUS_BITS_REJECTED_SAMPLE UINT64_C(0x80)
/** The dead zone's output was clamped to the stability bound of the sampled law. */
#define OBSERVER_STATUS_BITS_CLAMPED UINT64_C(0x100)
/** The state was not finite or beyond limits and was reset to the last checkpoint. */
#define OBSERVER_STATUS_BITS_DIVERGED UINT64_C(0x200)
/** No sample was ever accepted: the estimate is the initial state. */
#define OBSERVER_STATUS_BITS_WAITING UINT64_C(0x400)
/** The general linear plant's channel predicts without an output. */
#define OBSERVER_STATUS_BITS_COASTING_LINEAR UINT64_C(0x800)
/** The previous tick ended after its next deadline: the loop is late. */
#define OBSERVER_STATUS_BITS_LATE UINT64_C(0x1000)
/** The loop was late for `deadline.predict_only_after_ticks` ticks in a row: samples are not used, and the
 * estimate is predicted only. */
#define OBSERVER_STATUS_BITS_PREDICT_ONLY UINT64_C(0x2000)
/** The loop was late for so long that the estimate is not to be used at all: do not fly on this. */
#define OBSERVER_STATUS_BITS_INVALID UINT64_C(0x4000)
/** An output that is an outlier against its recent errors was held back since the previous estimate. */
#define OBSERVER_STATUS_BITS_HELD_BACK UINT64_C(0x8000)
#define OBSERVER_STATUS_BITS_STUCK UINT64_C(0x10000) /**< A sensor repeats one value to the bit. */
/** After an outage, a channel's innovations are not back within the gate: its state is uncertain. */
#define OBSERVER_STATUS_BITS_REACQUIRING UINT64_C(0x20000)
/** The newest velocity measurement is older than `stale_after_s`, or there was none yet. */
#define OBSERVER_STATUS_BITS_STALE_TRANSLATION UINT64_C(0x40000)
/** The newest angular-velocity measurement is older than `stale_after_s`, or there was none yet. */
#define OBSERVER_STATUS_BITS_STALE_ROTATION UINT64_C(0x80000)
/** The newest output of the general linear plant is older than `stale_after_s`, or there was none yet. */
#define OBSERVER_STATUS_BITS_STALE_LINEAR UINT64_C(0x100000)
/** The newest sample says that the vehicle stands on the ground: nothing is learned. */
#define OBSERVER_STATUS_BITS_ON_GROUND UINT64_C(0x200000)
/** Samples that arrived late are still being put where they belong: the estimate is predicted from before
 * them. */
#define OBSERVER_STATUS_BITS_CATCHING_UP UINT64_C(0x400000)
#define OBSERVER_STATUS_BITS_COASTING UINT64_C(0x806) /**< Any channel coasts. */

/* Bits of observer_status.real_time_requested and observer_status.real_time_granted. */
#define OBSERVER_REAL_TIME_PRIORITY UINT64_C(0x1) /**< A fixed priority (SCHED_FIFO) for the loop. */
#define OBSERVER_REAL_TIME_CORES UINT64_C(0x2) /**< Cores of the loop's own choice. */
/** Memory that is neither swapped out nor mapped late. */
#define OBSERVER_REAL_TIME_LOCKED_MEMORY UINT64_C(0x4)
#define OBSERVER_REAL_TIME_PUNCTUAL_TIMERS UINT64_C(0x8) /**< Timers without slack. */
#define OBSERVER_REAL_TIME_AWAKE_CORES UINT64_C(0x10) /**< Cores that wake up at once. */

/* Values of observer_status.snapshot_restored. */
#define OBSERVER_RESTORED_NOTHING UINT64_C(0x0) /**< The service started with nothing learned. */
#define OBSERVER_RESTORED_LEARNED UINT64_C(0x1) /**< It started with what an earlier one had learned. */
/** It started with that and with the state, and goes on from there. */
#define OBSERVER_RESTORED_LEARNED_AND_STATE UINT64_C(0x2)

/* Values of `command` in observer_command(). */
/** Forget state and weights; start again from the next sample. */
#define OBSERVER_COMMAND_RESET UINT32_C(0x1)
#define OBSERVER_COMMAND_FREEZE UINT32_C(0x2) /**< Stop learning; keep using what was learned. */
#define OBSERVER_COMMAND_THAW UINT32_C(0x3) /**< Learn again. */
#define OBSERVER_COMMAND_SAVE UINT32_C(0x4) /**< Write the learned weights to disk. */
#define OBSERVER_COMMAND_STATUS UINT32_C(0x5) /**< Only answer with the status. */

/* Values of observer_reply.outcome. */
#define OBSERVER_OUTCOME_DONE UINT32_C(0x0) /**< Done: the loop has carried the command out. */
#define OBSERVER_OUTCOME_REFUSED UINT32_C(0x1) /**< Refused: `message` says why. */
#define OBSERVER_OUTCOME_UNKNOWN UINT32_C(0x2) /**< The command's kind is unknown to this service. */

/* What a handle is opened for: bits of `ports` in observer_open(). */
/** observer_publish(): a source. An instance has 8 places for sources. */
#define OBSERVER_PORTS_PUBLISH UINT32_C(0x1)
/** observer_take() and observer_wait(): a queue of 256 estimates. An instance has 32 places for readers of
 * estimates. */
#define OBSERVER_PORTS_TAKE UINT32_C(0x2)
/** observer_peek(): the newest estimate. It takes a place for a reader of estimates, too. */
#define OBSERVER_PORTS_PEEK UINT32_C(0x4)
/** observer_read_status(): the newest status. An instance has 32 places for readers of it. */
#define OBSERVER_PORTS_STATUS UINT32_C(0x8)
#define OBSERVER_PORTS_ALL UINT32_C(0xf) /**< All of these. */

/** Why a sample was rejected; the value is its index in samples_rejected. */
typedef enum {
  OBSERVER_REJECTION_NOT_FINITE, /**< A valid field is NaN or infinite. */
  OBSERVER_REJECTION_BEYOND_LIMITS, /**< A valid field is beyond the configured physical limit. */
  OBSERVER_REJECTION_QUATERNION_NORM, /**< The attitude is not of unit norm. */
  OBSERVER_REJECTION_REPEATED_STAMP, /**< The source has already told a field of this instant. */
  /** The stamp lies before the window in which late samples are put where they belong (`input.max_age_s`), or,
   * with a law that cannot go back, before the newest one. */
  OBSERVER_REJECTION_TOO_LATE,
  OBSERVER_REJECTION_TOO_OLD, /**< The stamp lies too far behind the clock. */
  OBSERVER_REJECTION_FAR_FUTURE, /**< The stamp lies too far ahead of the clock. */
  OBSERVER_REJECTION_SEQUENCE_BACKWARDS, /**< The sequence went backwards although the source is the same. */
  OBSERVER_REJECTION_OTHER_SOURCE, /**< Another source holds the stream, or there are too many. */
  /** No valid field, an unknown bit of `valid`, `flags` or `absent`, a body velocity or a specific force
   * without one of its components, or an unknown frame. */
  OBSERVER_REJECTION_MALFORMED,
  /** The configuration has `[[sensor]]` tables, and none with the sample's number. */
  OBSERVER_REJECTION_UNKNOWN_SENSOR,
  OBSERVER_REJECTION_OVERLOAD, /**< The loop was late for too long to use it. */
} observer_rejection;

/** One set of sensor readings and commands, all taken at `stamp_ns`. */
typedef struct {
  uint64_t sequence; /**< Counts from 0, one up per sample; a gap counts as loss. */
  uint64_t stamp_ns; /**< CLOCK_MONOTONIC of the source when the readings were taken (ns). */
  uint32_t valid; /**< Which of the fields below are valid: bits of OBSERVER_VALID_…. */
  uint32_t velocity_frame; /**< Frame of `velocity_m_s`: OBSERVER_FRAME_INERTIAL or OBSERVER_FRAME_BODY. */
  uint32_t flags; /**< What the vehicle says of itself: bits of OBSERVER_FLAGS_…. */
  uint32_t absent; /**< Which components of the fields below were not measured: bits of OBSERVER_ABSENT_…. */
  /** Number of the `[[sensor]]` of the configuration that it comes from: mounting, lever arm, noise, latency.
   * 0: of none. */
  uint32_t sensor;
  uint32_t force_frame; /**< Frame of `force_n`: OBSERVER_FRAME_INERTIAL or OBSERVER_FRAME_BODY. */
  /** Velocity of the center of mass, or of the sensor where its configuration has a lever arm, in the frame
   * that `velocity_frame` names (m/s). */
  double velocity_m_s[3];
  double angular_velocity_rad_s[3]; /**< Angular velocity, body axes (rad/s). */
  /** Specific force, of an accelerometer: acceleration without gravity's, body axes (m/s²). */
  double specific_force_m_s2[3];
  double position_m[3]; /**< Position fix, inertial (m). */
  double attitude_wxyz[4]; /**< Attitude fix, unit quaternion w, x, y, z, body to inertial. */
  /** Commanded force, in the frame that `force_frame` names (N), held until the next one; zero before the
   * first. */
  double force_n[3];
  /** Commanded torque, body axes (N·m), held until the next one; zero before the first. */
  double torque_n_m[3];
  /** y of a general linear plant, its first m entries, in the units of its configuration. */
  double output[6];
  /** u of a general linear plant, its first m entries, held until the next one; zero before the first. */
  double input[6];
  double velocity_std_m_s[3]; /**< 1 σ of `velocity_m_s`, along its axes (m/s); 0: as configured. */
  double angular_velocity_std_rad_s[3]; /**< 1 σ of `angular_velocity_rad_s` (rad/s); 0: as configured. */
  double specific_force_std_m_s2[3]; /**< 1 σ of `specific_force_m_s2` (m/s²); 0: as configured. */
  double position_std_m[3]; /**< 1 σ of `position_m` (m); 0: as configured. */
  /** 1 σ of the rotation vector of `attitude_wxyz`'s error, body axes (rad); 0: as configured. */
  double attitude_std_rad[3];
} observer_measurement;

/** How far one channel's estimate can be trusted. Units are those of the channel's output: m/s for
 * translation, rad/s for rotation, of the configuration for a general linear plant; forces N or N·m. */
typedef struct {
  double output_error; /**< ‖ỹ‖ = ‖y − Cx̂‖ at the held sample; 0 while coasting. */
  double activation; /**< σ, the dead zone's output now: 0 is closed, nothing is learned. */
  double power_function; /**< P_N(y) / √κ(0), 0 … 1: 0 at a center, 1 where the centers cover nothing. */
  double native_norm; /**< ‖f̂_N‖ in the native space. */
  /** How far the learned force may be from that of the dense solver (N; N·m): the local solver's estimate of
   * its own error; 0 where the dense one is in use. */
  double solver_error;
  /** max(d, d_N): the size that the theorems claim ‖e‖ settles below, where their conditions hold (`daemon
   * check` tells) and the newest output confirms it; else +∞, as while coasting. A bound, not a covariance.
   * +∞ with the joint law, which has standard deviations instead. */
  double error_bound;
  double output_age_s; /**< Time since the stamp of the newest output measurement (s); +∞ before the first. */
  /** Normalized innovation squared: e²/S of the newest output, mean over its axes. 1 in the mean where the
   * noises are right; 0 where the law has no S, and before the first output. */
  double nis;
} observer_channel;

/** The state estimate at `stamp_ns`, and how far it can be trusted. */
typedef struct {
  uint64_t sequence; /**< Counts the service's publications from 0. */
  uint64_t source_sequence; /**< Sequence of the newest sample that went into this estimate. */
  uint64_t stamp_ns; /**< Time of the state (ns). */
  /** Stamp of the newest sample that went into this estimate (ns); 0 before the first. */
  uint64_t source_stamp_ns;
  uint64_t publish_stamp_ns; /**< CLOCK_MONOTONIC just before publication (ns). */
  uint64_t status; /**< Bits of OBSERVER_STATUS_BITS_…. */
  /** Which sensors contributed: bit k is set where a sample of sensor number k was accepted since the estimate
   * before, bit 0 for samples without a sensor number. Numbers above 63 have no bit. */
  uint64_t sensors;
  /** Position, inertial (m). Dead-reckoned from velocity unless position fixes are used. */
  double position_m[3];
  double velocity_m_s[3]; /**< Velocity, inertial (m/s). */
  double attitude_wxyz[4]; /**< Attitude, unit quaternion w, x, y, z, body to inertial. */
  double euler_rad[3]; /**< 3-2-1 Euler angles roll, pitch, yaw (rad), in (−π, π]. */
  double angular_velocity_rad_s[3]; /**< Angular velocity, body axes (rad/s). */
  double matched_force_n[3]; /**< f̂: the learned unknown force, inertial axes (N). */
  double matched_torque_n_m[3]; /**< f̂: the learned unknown torque, body axes (N·m). */
  /** 1 σ of `position_m`, inertial axes (m); +∞ where it is unknown, as each of the next five: with `law =
   * "gradient"`, and before the first output. */
  double position_std_m[3];
  double velocity_std_m_s[3]; /**< 1 σ of `velocity_m_s`, inertial axes (m/s). */
  double attitude_std_rad[3]; /**< 1 σ of the rotation vector of the attitude's error, body axes (rad). */
  double angular_velocity_std_rad_s[3]; /**< 1 σ of `angular_velocity_rad_s`, body axes (rad/s). */
  double matched_force_std_n[3]; /**< 1 σ of `matched_force_n`, inertial axes (N). */
  double matched_torque_std_n_m[3]; /**< 1 σ of `matched_torque_n_m`, body axes (N·m). */
  observer_channel translation; /**< Trust in position, velocity and force. */
  observer_channel rotation; /**< Trust in attitude, angular velocity and torque. */
  /** x̂ of a general linear plant, its first n entries, in the units of its configuration. */
  double state[12];
  double matched_input[6]; /**< f̂ of a general linear plant, its first m entries. */
  observer_channel linear; /**< Trust in `state` and `matched_input`. */
} observer_estimate;

/** Quantiles of one latency (ns) since the service started. */
typedef struct {
  uint64_t count; /**< Number of values. */
  uint64_t p50; /**< Median. */
  uint64_t p90; /**< 90 % quantile. */
  uint64_t p99; /**< 99 % quantile. */
  uint64_t p999; /**< 99.9 % quantile. */
  uint64_t max; /**< Largest value. */
} observer_latency_summary;

/** What the engine and its loop count since they started. */
typedef struct {
  uint64_t ticks; /**< Ticks served, each with one estimate. */
  /** Deadlines that passed unserved because a tick ended too late; they were skipped. */
  uint64_t deadline_misses;
  uint64_t samples_accepted; /**< Samples used. */
  uint64_t samples_lost; /**< Gaps in the source's sequence: samples that never arrived. */
  uint64_t samples_rejected[12]; /**< Samples rejected, by observer_rejection. */
  /** Outputs that were outliers against the running scale of their errors, and were held back from adaptation
   * or from correction too: of translation, rotation, linear plant. */
  uint64_t outputs_held_back[3];
  /** Outputs that repeated the previous one to the bit, for longer than a working sensor does; likewise. */
  uint64_t outputs_stuck[3];
  uint64_t ticks_coasting; /**< Ticks on which a channel coasted. */
  uint64_t ticks_clamped; /**< Ticks on which the dead zone's output was clamped to the stability bound. */
  uint64_t ticks_predict_only; /**< Ticks on which samples were not used because the loop was late. */
  uint64_t ticks_invalid; /**< Ticks whose estimate was marked invalid. */
  uint64_t state_resets; /**< Times the state was reset to the last checkpoint. */
  uint64_t source_changes; /**< Times the source restarted or another one took over. */
  uint64_t commands; /**< Commands carried out. */
  uint64_t records_dropped; /**< Tick records that the housekeeping thread was too slow to take. */
  uint64_t ticks_not_recorded; /**< Ticks that the recorder was too slow to take. */
} observer_counters;

/** What the service did since it started. */
typedef struct {
  uint64_t sequence; /**< Counts publications from 0. */
  uint64_t stamp_ns; /**< CLOCK_MONOTONIC of this status (ns). */
  uint64_t start_stamp_ns; /**< CLOCK_MONOTONIC of the service's start (ns). */
  uint64_t rate_millihertz; /**< Configured rate (mHz: 200 Hz is 200 000). */
  /** d, the width of the dead zone of translation (m/s), rotation (rad/s), linear plant (its output's unit):
   * up to it an output error is noise, and nothing is learned; 0 where there is no such channel. */
  double dead_zone_width[3];
  observer_counters counters; /**< What the engine and its loop counted. */
  uint64_t newest_sequence; /**< Sequence of the newest accepted sample. */
  /** Age of the newest accepted sample (ns); the largest number before the first. */
  uint64_t newest_sample_age_ns;
  /** Age of the newest output of each channel (ns): of translation, rotation, linear plant; the largest number
   * before the first, and where there is no such channel. */
  uint64_t output_age_ns[3];
  /** Normalized innovation squared of the newest output of each channel, as `nis` of an estimate's channels.
   * */
  double nis[3];
  uint64_t source_pid; /**< Process id of the source in use; 0 if none or unknown. */
  uint64_t other_source_pid; /**< Process id of another source that publishes too; 0 if none. */
  /** Of each source that has sent, in the order of appearance: process id; 0 where there is no source, or none
   * any more. */
  uint64_t source_pids[16];
  uint64_t source_sensors[16]; /**< Number of its `[[sensor]]`; 0: none. */
  /** Age of its newest sample since it arrived (ns); the largest number where there is no source. */
  uint64_t source_ages_ns[16];
  uint64_t source_periods_ns[16]; /**< The usual time between two of its samples (ns); 0 before the second. */
  uint64_t source_delays_ns[16]; /**< Median of the delays of its samples, from stamp to arrival (ns). */
  uint64_t source_max_delays_ns[16]; /**< The largest delay (ns). */
  uint64_t source_accepted[16]; /**< Its samples that were used. */
  uint64_t source_late[16]; /**< Of these, those that came after a newer one of any source. */
  uint64_t source_lost[16]; /**< Gaps in its sequence. */
  uint64_t source_rejected[16]; /**< Its samples that were rejected. */
  /** Recent mean of the normalized innovation squared of its velocities, about 1 where their noise is right; 0
   * where it has none, and with the gradient law. */
  double source_nis[16];
  uint64_t adaptation_frozen; /**< 1 while adaptation is frozen by an operator. */
  uint64_t late_ticks_in_a_row; /**< Ticks in a row that ended after their next deadline, now. */
  uint64_t most_late_ticks_in_a_row; /**< The most so far. */
  /** Real-time settings that the configuration asks for: bits of OBSERVER_REAL_TIME_…. */
  uint64_t real_time_requested;
  uint64_t real_time_granted; /**< Real-time settings that the system granted. */
  uint64_t snapshot_restored; /**< What was restored at the start: one of OBSERVER_RESTORED_…. */
  uint64_t snapshots_saved; /**< Snapshots written. */
  uint64_t snapshots_failed; /**< Snapshots that could not be written. */
  /** CLOCK_MONOTONIC of the state in the newest snapshot of this service (ns); 0 if none. */
  uint64_t snapshot_stamp_ns;
  uint64_t ticks_recorded; /**< Ticks written to the flight record. */
  observer_latency_summary wake_up_lateness_ns; /**< Deadline to wake-up (ns). */
  /** Wake-up to publication: samples taken, stepped, estimate written (ns). */
  observer_latency_summary step_ns;
  /** Source stamp of the newest sample to wake-up, on ticks with a new sample (ns). */
  observer_latency_summary input_age_ns;
  /** Source stamp of the newest sample to publication, on ticks with a new sample (ns). */
  observer_latency_summary source_to_publish_ns;
} observer_status;

/** The service's answer, with its status after the command. */
typedef struct {
  uint32_t outcome; /**< One of OBSERVER_OUTCOME_…. */
  uint32_t message_bytes; /**< Bytes of `message` in use. */
  uint8_t message[248]; /**< UTF-8 text. */
  observer_status status; /**< Status after the command. */
} observer_reply;

/** How a call ended: 0 and above are good, below are failures, whose reason observer_error_text() tells. */
typedef enum {
  /** Done. */
  OBSERVER_OK = 0,
  /** No failure, but there is nothing: nothing to take, nothing published yet, no reader. */
  OBSERVER_NOTHING = 1,
  /** An argument cannot be: null, not aligned, no text, not finite, another header, a port not asked for. */
  OBSERVER_BAD_ARGUMENT = -1,
  /** The handle is not open: never was, or was closed. */
  OBSERVER_BAD_HANDLE = -2,
  /** Another thread opened the handle. A handle is used, and closed, by the thread that opened it. */
  OBSERVER_WRONG_THREAD = -3,
  /** No service of that instance was there within the patience. */
  OBSERVER_NO_DAEMON = -4,
  /** The service did not answer within the patience. */
  OBSERVER_TIMED_OUT = -5,
  /** What is there does not fit: another version of a payload or of iceoryx2, other qualities, another user's. */
  OBSERVER_REFUSED = -6,
  /** A port did not do it; the text has iceoryx2's reason. */
  OBSERVER_PORT = -7,
  /** A defect of this library. Nothing is known of the handle's state: close it. */
  OBSERVER_INTERNAL = -8,
} observer_result;

/** A connection to one instance of the service, of the thread that opened it. All zero is none. */
typedef struct {
  /** For the library. */
  uint32_t thread;
  /** For the library. */
  uint32_t number;
} observer_client;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/** Connects this thread to the service of an instance, and opens the ports that are asked for: what allocates
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
 * The texts end with a zero; `client` points to a handle. */
observer_result observer_open(uint32_t layout,
                              const char *root_path,
                              const char *instance,
                              uint32_t ports,
                              double patience_s,
                              observer_client *client);

/** Publishes one measurement; its sequence and its stamp (observer_now_ns()) are the caller's. Never blocks: where
 * the service is slow, the oldest sample is dropped. OBSERVER_NOTHING: no service is connected now.
 *
 * No system call; one allocation, of iceoryx2 (48 bytes, freed before the call returns).
 *
 * Condition:
 * `measurement` points to one. */
observer_result observer_publish(observer_client client,
                                 const observer_measurement *measurement);

/** Takes the oldest estimate not yet taken; OBSERVER_NOTHING leaves `estimate` as it is. Where the reader is slow,
 * the oldest are dropped, which shows as a gap in their sequence. No system call, no allocation.
 *
 * Condition:
 * `estimate` points to one. */
observer_result observer_take(observer_client client,
                              observer_estimate *estimate);

/** As observer_take(), but waits up to `patience_s` for an estimate, and looks every 50 µs (sleeping in between);
 * OBSERVER_TIMED_OUT if none came.
 *
 * Condition:
 * `estimate` points to one. */
observer_result observer_wait(observer_client client,
                              double patience_s,
                              observer_estimate *estimate);

/** The newest estimate, taken or not; OBSERVER_NOTHING before the first leaves `estimate` as it is. When the
 * service dies the last one stays: its age is in its stamps. No system call, no allocation.
 *
 * Condition:
 * `estimate` points to one. */
observer_result observer_peek(observer_client client, observer_estimate *estimate);

/** The newest status, which the service publishes a few times a second; OBSERVER_NOTHING before the first leaves
 * `status` as it is. No system call, no allocation.
 *
 * Condition:
 * `status` points to one. */
observer_result observer_read_status(observer_client client,
                                     observer_status *status);

/** Sends a command (one of OBSERVER_COMMAND_…) and waits up to `patience_s` for the answer. OBSERVER_OK means that
 * there is one: its `outcome` says whether the command was carried out, observer_reply_text() what the service
 * says. Where the service is away, it is waited for as long as observer_open() was to. Allocates and asks the
 * system: not for the loop.
 *
 * Condition:
 * `reply` points to one. */
observer_result observer_command(observer_client client,
                                 uint32_t command,
                                 double patience_s,
                                 observer_reply *reply);

/** Copies the text of a reply, with a zero at its end, cut where `text_bytes` are too few; OBSERVER_REPLY_TEXT_BYTES
 * are enough.
 *
 * Condition:
 * `reply` points to one, `text` to `text_bytes` bytes. */
observer_result observer_reply_text(const observer_reply *reply,
                                    char *text,
                                    size_t text_bytes);

/** Closes a handle, on the thread that opened it. What a thread leaves open is closed when it ends. */
observer_result observer_close(observer_client client);

/** Nanoseconds of CLOCK_MONOTONIC, the clock of every stamp. No system call where the kernel offers the vDSO. */
uint64_t observer_now_ns(void);

/** What was found, needed, and what to do, of this thread's latest failure; empty before the first. Never null; valid until this
 * thread's next failure. */
const char *observer_error_text(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

/* The payloads as the library was compiled. */
static_assert(sizeof(observer_measurement) == 432 && offsetof(observer_measurement, sequence) == 0
    && offsetof(observer_measurement, stamp_ns) == 8 && offsetof(observer_measurement, valid) == 16
    && offsetof(observer_measurement, velocity_frame) == 20 && offsetof(observer_measurement, flags) == 24
    && offsetof(observer_measurement, absent) == 28 && offsetof(observer_measurement, sensor) == 32
    && offsetof(observer_measurement, force_frame) == 36 && offsetof(observer_measurement, velocity_m_s) == 40
    && offsetof(observer_measurement, angular_velocity_rad_s) == 64
    && offsetof(observer_measurement, specific_force_m_s2) == 88
    && offsetof(observer_measurement, position_m) == 112
    && offsetof(observer_measurement, attitude_wxyz) == 136 && offsetof(observer_measurement, force_n) == 168
    && offsetof(observer_measurement, torque_n_m) == 192 && offsetof(observer_measurement, output) == 216
    && offsetof(observer_measurement, input) == 264 && offsetof(observer_measurement, velocity_std_m_s) == 312
    && offsetof(observer_measurement, angular_velocity_std_rad_s) == 336
    && offsetof(observer_measurement, specific_force_std_m_s2) == 360
    && offsetof(observer_measurement, position_std_m) == 384
    && offsetof(observer_measurement, attitude_std_rad) == 408,
    "layout of observer_measurement");
static_assert(sizeof(observer_channel) == 64 && offsetof(observer_channel, output_error) == 0
    && offsetof(observer_channel, activation) == 8 && offsetof(observer_channel, power_function) == 16
    && offsetof(observer_channel, native_norm) == 24 && offsetof(observer_channel, solver_error) == 32
    && offsetof(observer_channel, error_bound) == 40 && offsetof(observer_channel, output_age_s) == 48
    && offsetof(observer_channel, nis) == 56,
    "layout of observer_channel");
static_assert(sizeof(observer_estimate) == 712 && offsetof(observer_estimate, sequence) == 0
    && offsetof(observer_estimate, source_sequence) == 8 && offsetof(observer_estimate, stamp_ns) == 16
    && offsetof(observer_estimate, source_stamp_ns) == 24
    && offsetof(observer_estimate, publish_stamp_ns) == 32 && offsetof(observer_estimate, status) == 40
    && offsetof(observer_estimate, sensors) == 48 && offsetof(observer_estimate, position_m) == 56
    && offsetof(observer_estimate, velocity_m_s) == 80 && offsetof(observer_estimate, attitude_wxyz) == 104
    && offsetof(observer_estimate, euler_rad) == 136
    && offsetof(observer_estimate, angular_velocity_rad_s) == 160
    && offsetof(observer_estimate, matched_force_n) == 184
    && offsetof(observer_estimate, matched_torque_n_m) == 208
    && offsetof(observer_estimate, position_std_m) == 232
    && offsetof(observer_estimate, velocity_std_m_s) == 256
    && offsetof(observer_estimate, attitude_std_rad) == 280
    && offsetof(observer_estimate, angular_velocity_std_rad_s) == 304
    && offsetof(observer_estimate, matched_force_std_n) == 328
    && offsetof(observer_estimate, matched_torque_std_n_m) == 352
    && offsetof(observer_estimate, translation) == 376 && offsetof(observer_estimate, rotation) == 440
    && offsetof(observer_estimate, state) == 504 && offsetof(observer_estimate, matched_input) == 600
    && offsetof(observer_estimate, linear) == 648,
    "layout of observer_estimate");
static_assert(sizeof(observer_latency_summary) == 48 && offsetof(observer_latency_summary, count) == 0
    && offsetof(observer_latency_summary, p50) == 8 && offsetof(observer_latency_summary, p90) == 16
    && offsetof(observer_latency_summary, p99) == 24 && offsetof(observer_latency_summary, p999) == 32
    && offsetof(observer_latency_summary, max) == 40,
    "layout of observer_latency_summary");
static_assert(sizeof(observer_counters) == 248 && offsetof(observer_counters, ticks) == 0
    && offsetof(observer_counters, deadline_misses) == 8
    && offsetof(observer_counters, samples_accepted) == 16 && offsetof(observer_counters, samples_lost) == 24
    && offsetof(observer_counters, samples_rejected) == 32
    && offsetof(observer_counters, outputs_held_back) == 128
    && offsetof(observer_counters, outputs_stuck) == 152 && offsetof(observer_counters, ticks_coasting) == 176
    && offsetof(observer_counters, ticks_clamped) == 184
    && offsetof(observer_counters, ticks_predict_only) == 192
    && offsetof(observer_counters, ticks_invalid) == 200 && offsetof(observer_counters, state_resets) == 208
    && offsetof(observer_counters, source_changes) == 216 && offsetof(observer_counters, commands) == 224
    && offsetof(observer_counters, records_dropped) == 232
    && offsetof(observer_counters, ticks_not_recorded) == 240,
    "layout of observer_counters");
static_assert(sizeof(observer_status) == 2064 && offsetof(observer_status, sequence) == 0
    && offsetof(observer_status, stamp_ns) == 8 && offsetof(observer_status, start_stamp_ns) == 16
    && offsetof(observer_status, rate_millihertz) == 24 && offsetof(observer_status, dead_zone_width) == 32
    && offsetof(observer_status, counters) == 56 && offsetof(observer_status, newest_sequence) == 304
    && offsetof(observer_status, newest_sample_age_ns) == 312
    && offsetof(observer_status, output_age_ns) == 320 && offsetof(observer_status, nis) == 344
    && offsetof(observer_status, source_pid) == 368 && offsetof(observer_status, other_source_pid) == 376
    && offsetof(observer_status, source_pids) == 384 && offsetof(observer_status, source_sensors) == 512
    && offsetof(observer_status, source_ages_ns) == 640 && offsetof(observer_status, source_periods_ns) == 768
    && offsetof(observer_status, source_delays_ns) == 896
    && offsetof(observer_status, source_max_delays_ns) == 1024
    && offsetof(observer_status, source_accepted) == 1152 && offsetof(observer_status, source_late) == 1280
    && offsetof(observer_status, source_lost) == 1408 && offsetof(observer_status, source_rejected) == 1536
    && offsetof(observer_status, source_nis) == 1664 && offsetof(observer_status, adaptation_frozen) == 1792
    && offsetof(observer_status, late_ticks_in_a_row) == 1800
    && offsetof(observer_status, most_late_ticks_in_a_row) == 1808
    && offsetof(observer_status, real_time_requested) == 1816
    && offsetof(observer_status, real_time_granted) == 1824
    && offsetof(observer_status, snapshot_restored) == 1832
    && offsetof(observer_status, snapshots_saved) == 1840
    && offsetof(observer_status, snapshots_failed) == 1848
    && offsetof(observer_status, snapshot_stamp_ns) == 1856
    && offsetof(observer_status, ticks_recorded) == 1864
    && offsetof(observer_status, wake_up_lateness_ns) == 1872 && offsetof(observer_status, step_ns) == 1920
    && offsetof(observer_status, input_age_ns) == 1968
    && offsetof(observer_status, source_to_publish_ns) == 2016,
    "layout of observer_status");
static_assert(sizeof(observer_reply) == 2320 && offsetof(observer_reply, outcome) == 0
    && offsetof(observer_reply, message_bytes) == 4 && offsetof(observer_reply, message) == 8
    && offsetof(observer_reply, status) == 256,
    "layout of observer_reply");
#endif // OBSERVER_CLIENT_H
