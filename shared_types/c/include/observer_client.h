#ifndef O
#define O
#include <assert.h>
#include <stddef.h>
#include <stdint.h>
#define OBSERVER_LAYOUT UINT32_C(0xc3f8743a)
#define OBSERVER_REPLY_TEXT_BYTES 249
#define OBSERVER_VALID_VELOCITY (UINT32_C(1) << UINT32_C(0))
#define OBSERVER_VALID_ANGULAR_VELOCITY (UINT32_C(1) << UINT32_C(1))
#define OBSERVER_VALID_POSITION (UINT32_C(1) << UINT32_C(2))
#define OBSERVER_VALID_ATTITUDE (UINT32_C(1) << UINT32_C(3))
#define OBSERVER_VALID_FORCE (UINT32_C(1) << UINT32_C(4))
#define OBSERVER_VALID_TORQUE (UINT32_C(1) << UINT32_C(5))
#define OBSERVER_VALID_RIGID_BODY ((UINT32_C(1) << UINT32_C(6)) - UINT32_C(1))
#define OBSERVER_VALID_OUTPUT (UINT32_C(1) << UINT32_C(6))
#define OBSERVER_VALID_INPUT (UINT32_C(1) << UINT32_C(7))
#define OBSERVER_VALID_ALL ((UINT32_C(1) << UINT32_C(8)) - UINT32_C(1))
#define OBSERVER_FRAME_INERTIAL (UINT32_C(0))
#define OBSERVER_FRAME_BODY (UINT32_C(1))
#define OBSERVER_STATUS_BITS_TRACKING (UINT64_C(1) << UINT64_C(0))
#define OBSERVER_STATUS_BITS_COASTING_TRANSLATION (UINT64_C(1) << UINT64_C(1))
#define OBSERVER_STATUS_BITS_COASTING_ROTATION (UINT64_C(1) << UINT64_C(2))
#define OBSERVER_STATUS_BITS_COASTING_LINEAR (UINT64_C(1) << UINT64_C(11))
#define OBSERVER_STATUS_BITS_COASTING (OBSERVER_STATUS_BITS_COASTING_TRANSLATION | OBSERVER_STATUS_BITS_COASTING_ROTATION | OBSERVER_STATUS_BITS_COASTING_LINEAR)
#define OBSERVER_STATUS_BITS_STALE (UINT64_C(1) << UINT64_C(3))
#define OBSERVER_STATUS_BITS_ADAPTING (UINT64_C(1) << UINT64_C(4))
#define OBSERVER_STATUS_BITS_FROZEN (UINT64_C(1) << UINT64_C(5))
#define OBSERVER_STATUS_BITS_OUTSIDE_CENTERS (UINT64_C(1) << UINT64_C(6))
#define OBSERVER_STATUS_BITS_REJECTED_SAMPLE (UINT64_C(1) << UINT64_C(7))
#define OBSERVER_STATUS_BITS_CLAMPED (UINT64_C(1) << UINT64_C(8))
#define OBSERVER_STATUS_BITS_DIVERGED (UINT64_C(1) << UINT64_C(9))
#define OBSERVER_STATUS_BITS_WAITING (UINT64_C(1) << UINT64_C(10))
#define OBSERVER_STATUS_BITS_LATE (UINT64_C(1) << UINT64_C(12))
#define OBSERVER_STATUS_BITS_PREDICT_ONLY (UINT64_C(1) << UINT64_C(13))
#define OBSERVER_STATUS_BITS_INVALID (UINT64_C(1) << UINT64_C(14))
#define OBSERVER_STATUS_BITS_HELD_BACK (UINT64_C(1) << UINT64_C(15))
#define OBSERVER_STATUS_BITS_STUCK (UINT64_C(1) << UINT64_C(16))
#define OBSERVER_REAL_TIME_PRIORITY (UINT64_C(1) << UINT64_C(0))
#define OBSERVER_REAL_TIME_CORES (UINT64_C(1) << UINT64_C(1))
#define OBSERVER_REAL_TIME_LOCKED_MEMORY (UINT64_C(1) << UINT64_C(2))
#define OBSERVER_REAL_TIME_PUNCTUAL_TIMERS (UINT64_C(1) << UINT64_C(3))
#define OBSERVER_REAL_TIME_AWAKE_CORES (UINT64_C(1) << UINT64_C(4))
#define OBSERVER_RESTORED_NOTHING (UINT64_C(0))
#define OBSERVER_RESTORED_LEARNED (UINT64_C(1))
#define OBSERVER_RESTORED_LEARNED_AND_STATE (UINT64_C(2))
#define OBSERVER_COMMAND_RESET (UINT32_C(1))
#define OBSERVER_COMMAND_FREEZE (UINT32_C(2))
#define OBSERVER_COMMAND_THAW (UINT32_C(3))
#define OBSERVER_COMMAND_SAVE (UINT32_C(4))
#define OBSERVER_COMMAND_STATUS (UINT32_C(5))
#define OBSERVER_OUTCOME_DONE (UINT32_C(0))
#define OBSERVER_OUTCOME_REFUSED (UINT32_C(1))
#define OBSERVER_OUTCOME_UNKNOWN (UINT32_C(2))
#define OBSERVER_PORTS_PUBLISH (UINT32_C(1) << UINT32_C(0))
#define OBSERVER_PORTS_TAKE (UINT32_C(1) << UINT32_C(1))
#define OBSERVER_PORTS_PEEK (UINT32_C(1) << UINT32_C(2))
#define OBSERVER_PORTS_STATUS (UINT32_C(1) << UINT32_C(3))
#define OBSERVER_PORTS_ALL ((UINT32_C(1) << UINT32_C(4)) - UINT32_C(1))
#ifdef __cplusplus
extern "C" {
#endif
typedef enum { OBSERVER_OK=0, OBSERVER_NOTHING=1, OBSERVER_BAD_ARGUMENT=-1, OBSERVER_BAD_HANDLE=-2, OBSERVER_WRONG_THREAD=-3, OBSERVER_NO_DAEMON=-4, OBSERVER_TIMED_OUT=-5, OBSERVER_REFUSED=-6, OBSERVER_PORT=-7, OBSERVER_INTERNAL=-8 } observer_result;
typedef struct { uint32_t thread; uint32_t number; } observer_client;
enum {OBSERVER_REJECTION_OVERLOAD=10};
typedef struct {
  uint64_t sequence;
  uint64_t stamp_ns;
  uint32_t valid;
  uint32_t velocity_frame;
  double velocity_m_s[3];
  double angular_velocity_rad_s[3];
  double position_m[3];
  double attitude_wxyz[4];
  double force_n[3];
  double torque_n_m[3];
  double output[6];
  double input[6];
} observer_measurement;

typedef struct {
  double output_error;
  double activation;
  double power_function;
  double native_norm;
  double solver_error;
  double error_bound;
  double output_age_s;
} observer_channel;

typedef struct {
  uint64_t sequence;
  uint64_t source_sequence;
  uint64_t stamp_ns;
  uint64_t source_stamp_ns;
  uint64_t publish_stamp_ns;
  uint64_t status;
  double position_m[3];
  double velocity_m_s[3];
  double attitude_wxyz[4];
  double euler_rad[3];
  double angular_velocity_rad_s[3];
  double matched_force_n[3];
  double matched_torque_n_m[3];
  observer_channel translation;
  observer_channel rotation;
  double state[12];
  double matched_input[6];
  observer_channel linear;
} observer_estimate;

typedef struct {
  uint64_t count;
  uint64_t p50;
  uint64_t p90;
  uint64_t p99;
  uint64_t p999;
  uint64_t max;
} observer_latency_summary;

typedef struct {
  uint64_t sequence;
  uint64_t stamp_ns;
  uint64_t start_stamp_ns;
  uint64_t rate_millihertz;
  uint64_t ticks;
  uint64_t deadline_misses;
  uint64_t samples_accepted;
  uint64_t samples_lost;
  uint64_t samples_rejected[11];
  uint64_t newest_sequence;
  uint64_t newest_sample_age_ns;
  uint64_t ticks_coasting;
  uint64_t ticks_clamped;
  uint64_t state_resets;
  uint64_t source_changes;
  uint64_t source_pid;
  uint64_t other_source_pid;
  uint64_t commands;
  uint64_t records_dropped;
  uint64_t adaptation_frozen;
  uint64_t outputs_held_back[3];
  uint64_t outputs_stuck[3];
  uint64_t late_ticks_in_a_row;
  uint64_t most_late_ticks_in_a_row;
  uint64_t ticks_predict_only;
  uint64_t ticks_invalid;
  uint64_t real_time_requested;
  uint64_t real_time_granted;
  uint64_t snapshot_restored;
  uint64_t snapshots_saved;
  uint64_t snapshots_failed;
  uint64_t snapshot_stamp_ns;
  uint64_t ticks_recorded;
  uint64_t ticks_not_recorded;
  observer_latency_summary wake_up_lateness_ns;
  observer_latency_summary step_ns;
  observer_latency_summary input_age_ns;
  observer_latency_summary source_to_publish_ns;
} observer_status;

typedef struct {
  uint32_t outcome;
  uint32_t message_bytes;
  uint8_t message[248];
  observer_status status;
} observer_reply;
observer_result observer_open(uint32_t layout, const char *root_path, const char *instance, uint32_t ports, double patience_s, observer_client *client);
observer_result observer_publish(observer_client client, const observer_measurement *measurement);
observer_result observer_take(observer_client client, observer_estimate *estimate);
observer_result observer_wait(observer_client client, double patience_s, observer_estimate *estimate);
observer_result observer_peek(observer_client client, observer_estimate *estimate);
observer_result observer_read_status(observer_client client, observer_status *status);
observer_result observer_command(observer_client client, uint32_t command, double patience_s, observer_reply *reply);
observer_result observer_reply_text(const observer_reply *reply, char *text, size_t text_bytes);
observer_result observer_close(observer_client client);
uint64_t observer_now_ns(void);
const char *observer_error_text(void);
#ifdef __cplusplus
}
#endif
static_assert(sizeof(observer_measurement) == 272, "");
static_assert(offsetof(observer_measurement, sequence) == 0, "");
static_assert(offsetof(observer_measurement, stamp_ns) == 8, "");
static_assert(offsetof(observer_measurement, valid) == 16, "");
static_assert(offsetof(observer_measurement, velocity_frame) == 20, "");
static_assert(offsetof(observer_measurement, velocity_m_s) == 24, "");
static_assert(offsetof(observer_measurement, angular_velocity_rad_s) == 48, "");
static_assert(offsetof(observer_measurement, position_m) == 72, "");
static_assert(offsetof(observer_measurement, attitude_wxyz) == 96, "");
static_assert(offsetof(observer_measurement, force_n) == 128, "");
static_assert(offsetof(observer_measurement, torque_n_m) == 152, "");
static_assert(offsetof(observer_measurement, output) == 176, "");
static_assert(offsetof(observer_measurement, input) == 224, "");
static_assert(sizeof(observer_channel) == 56, "");
static_assert(offsetof(observer_channel, output_error) == 0, "");
static_assert(offsetof(observer_channel, activation) == 8, "");
static_assert(offsetof(observer_channel, power_function) == 16, "");
static_assert(offsetof(observer_channel, native_norm) == 24, "");
static_assert(offsetof(observer_channel, solver_error) == 32, "");
static_assert(offsetof(observer_channel, error_bound) == 40, "");
static_assert(offsetof(observer_channel, output_age_s) == 48, "");
static_assert(sizeof(observer_estimate) == 536, "");
static_assert(offsetof(observer_estimate, sequence) == 0, "");
static_assert(offsetof(observer_estimate, source_sequence) == 8, "");
static_assert(offsetof(observer_estimate, stamp_ns) == 16, "");
static_assert(offsetof(observer_estimate, source_stamp_ns) == 24, "");
static_assert(offsetof(observer_estimate, publish_stamp_ns) == 32, "");
static_assert(offsetof(observer_estimate, status) == 40, "");
static_assert(offsetof(observer_estimate, position_m) == 48, "");
static_assert(offsetof(observer_estimate, velocity_m_s) == 72, "");
static_assert(offsetof(observer_estimate, attitude_wxyz) == 96, "");
static_assert(offsetof(observer_estimate, euler_rad) == 128, "");
static_assert(offsetof(observer_estimate, angular_velocity_rad_s) == 152, "");
static_assert(offsetof(observer_estimate, matched_force_n) == 176, "");
static_assert(offsetof(observer_estimate, matched_torque_n_m) == 200, "");
static_assert(offsetof(observer_estimate, translation) == 224, "");
static_assert(offsetof(observer_estimate, rotation) == 280, "");
static_assert(offsetof(observer_estimate, state) == 336, "");
static_assert(offsetof(observer_estimate, matched_input) == 432, "");
static_assert(offsetof(observer_estimate, linear) == 480, "");
static_assert(sizeof(observer_latency_summary) == 48, "");
static_assert(offsetof(observer_latency_summary, count) == 0, "");
static_assert(offsetof(observer_latency_summary, p50) == 8, "");
static_assert(offsetof(observer_latency_summary, p90) == 16, "");
static_assert(offsetof(observer_latency_summary, p99) == 24, "");
static_assert(offsetof(observer_latency_summary, p999) == 32, "");
static_assert(offsetof(observer_latency_summary, max) == 40, "");
static_assert(sizeof(observer_status) == 576, "");
static_assert(offsetof(observer_status, sequence) == 0, "");
static_assert(offsetof(observer_status, stamp_ns) == 8, "");
static_assert(offsetof(observer_status, start_stamp_ns) == 16, "");
static_assert(offsetof(observer_status, rate_millihertz) == 24, "");
static_assert(offsetof(observer_status, ticks) == 32, "");
static_assert(offsetof(observer_status, deadline_misses) == 40, "");
static_assert(offsetof(observer_status, samples_accepted) == 48, "");
static_assert(offsetof(observer_status, samples_lost) == 56, "");
static_assert(offsetof(observer_status, samples_rejected) == 64, "");
static_assert(offsetof(observer_status, newest_sequence) == 152, "");
static_assert(offsetof(observer_status, newest_sample_age_ns) == 160, "");
static_assert(offsetof(observer_status, ticks_coasting) == 168, "");
static_assert(offsetof(observer_status, ticks_clamped) == 176, "");
static_assert(offsetof(observer_status, state_resets) == 184, "");
static_assert(offsetof(observer_status, source_changes) == 192, "");
static_assert(offsetof(observer_status, source_pid) == 200, "");
static_assert(offsetof(observer_status, other_source_pid) == 208, "");
static_assert(offsetof(observer_status, commands) == 216, "");
static_assert(offsetof(observer_status, records_dropped) == 224, "");
static_assert(offsetof(observer_status, adaptation_frozen) == 232, "");
static_assert(offsetof(observer_status, outputs_held_back) == 240, "");
static_assert(offsetof(observer_status, outputs_stuck) == 264, "");
static_assert(offsetof(observer_status, late_ticks_in_a_row) == 288, "");
static_assert(offsetof(observer_status, most_late_ticks_in_a_row) == 296, "");
static_assert(offsetof(observer_status, ticks_predict_only) == 304, "");
static_assert(offsetof(observer_status, ticks_invalid) == 312, "");
static_assert(offsetof(observer_status, real_time_requested) == 320, "");
static_assert(offsetof(observer_status, real_time_granted) == 328, "");
static_assert(offsetof(observer_status, snapshot_restored) == 336, "");
static_assert(offsetof(observer_status, snapshots_saved) == 344, "");
static_assert(offsetof(observer_status, snapshots_failed) == 352, "");
static_assert(offsetof(observer_status, snapshot_stamp_ns) == 360, "");
static_assert(offsetof(observer_status, ticks_recorded) == 368, "");
static_assert(offsetof(observer_status, ticks_not_recorded) == 376, "");
static_assert(offsetof(observer_status, wake_up_lateness_ns) == 384, "");
static_assert(offsetof(observer_status, step_ns) == 432, "");
static_assert(offsetof(observer_status, input_age_ns) == 480, "");
static_assert(offsetof(observer_status, source_to_publish_ns) == 528, "");
static_assert(sizeof(observer_reply) == 832, "");
static_assert(offsetof(observer_reply, outcome) == 0, "");
static_assert(offsetof(observer_reply, message_bytes) == 4, "");
static_assert(offsetof(observer_reply, message) == 8, "");
static_assert(offsetof(observer_reply, status) == 256, "");
#endif
