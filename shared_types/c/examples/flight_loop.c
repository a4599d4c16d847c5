/* A flight loop in C: publishes a measurement every period, waits for the estimate that holds it, and flies on
 * where none comes in time.
 *
 *     flight_loop [SAMPLES [RATE_HZ [PATIENCE_S]]]      1000 samples at 250 Hz, 0.05 s
 *
 * The service's root path is $OBSERVER_ROOT or the user's own. */

#define _POSIX_C_SOURCE 200809L

#include "observer_client.h"
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define NS_PER_S UINT64_C(1000000000)

static int fail(const char *what)
{
    fprintf(stderr, "flight_loop: %s: %s\n", what, observer_error_text());
    return EXIT_FAILURE;
}

static void sleep_until_ns(uint64_t deadline_ns)
{
    struct timespec deadline = {(time_t)(deadline_ns / NS_PER_S), (long)(deadline_ns % NS_PER_S)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL) == EINTR) {
    }
}

/* What the sensors and the controller of a vehicle that circles would say now. */
static observer_measurement measured(uint64_t sequence)
{
    observer_measurement sample = {
        .sequence = sequence,
        .stamp_ns = observer_now_ns(),
        .valid = OBSERVER_VALID_VELOCITY | OBSERVER_VALID_ANGULAR_VELOCITY | OBSERVER_VALID_FORCE,
        .velocity_frame = OBSERVER_FRAME_INERTIAL,
    };
    double t_s = (double)sample.stamp_ns * 1e-9;
    sample.velocity_m_s[0] = sin(t_s);
    sample.velocity_m_s[1] = cos(t_s);
    sample.angular_velocity_rad_s[2] = 0.1 * sin(2.0 * t_s);
    sample.force_n[2] = -19.6;
    return sample;
}

/* Waits for the estimate that holds a sample; OBSERVER_TIMED_OUT if it does not come within patience_s. */
static observer_result answer(observer_client client, const observer_measurement *sample, double patience_s,
                              observer_estimate *estimate)
{
    uint64_t deadline_ns = observer_now_ns() + (uint64_t)(patience_s * 1e9);
    for (;;) {
        uint64_t now_ns = observer_now_ns();
        double left_s = now_ns < deadline_ns ? (double)(deadline_ns - now_ns) * 1e-9 : 0.0;
        observer_result result = observer_wait(client, left_s, estimate);
        if (result < 0)
            return result;
        if (estimate->source_sequence == sample->sequence && estimate->source_stamp_ns == sample->stamp_ns)
            return OBSERVER_OK;
    }
}

int main(int argc, char **argv)
{
    uint64_t samples = argc > 1 ? strtoull(argv[1], NULL, 10) : 1000;
    double rate_hz = argc > 2 ? strtod(argv[2], NULL) : 200.0;
    double patience_s = argc > 3 ? strtod(argv[3], NULL) : 0.5 / rate_hz;
    if (samples == 0 || !(rate_hz >= 1.0) || !(patience_s >= 0.0)) {
        fprintf(stderr, "usage: flight_loop [SAMPLES [RATE_HZ [PATIENCE_S]]]\n");
        return 2;
    }

    observer_client client;
    uint32_t ports = OBSERVER_PORTS_PUBLISH | OBSERVER_PORTS_TAKE | OBSERVER_PORTS_STATUS;
    if (observer_open(OBSERVER_LAYOUT, NULL, "vehicle", ports, 5.0, &client) < 0)
        return fail("open");

    uint64_t period_ns = (uint64_t)(1e9 / rate_hz), deadline_ns = observer_now_ns();
    uint64_t answered = 0, newest = 0, outages = 0;
    bool silent = false;
    observer_estimate estimate = {0};
    for (uint64_t sequence = 0; sequence < samples; ++sequence) {
        observer_measurement sample = measured(sequence);
        if (observer_publish(client, &sample) < 0)
            return fail("publish");
        observer_result result = answer(client, &sample, patience_s, &estimate);
        if (result == OBSERVER_OK) {
            ++answered;
            newest = estimate.source_sequence;
            silent = false;
            /* The controller goes here: estimate.status says whether the estimate may be used. */
        } else if (result != OBSERVER_TIMED_OUT) {
            return fail("wait");
        } else if (!silent) {
            /* The service is away for a moment: fly on, it comes back by itself. */
            silent = true;
            ++outages;
        }
        /* What is late stays late: nothing is made up in a burst. */
        deadline_ns += period_ns;
        if (observer_now_ns() > deadline_ns)
            deadline_ns = observer_now_ns();
        sleep_until_ns(deadline_ns);
    }

    observer_status status = {0};
    observer_reply reply;
    char text[OBSERVER_REPLY_TEXT_BYTES];
    if (observer_read_status(client, &status) < 0)
        return fail("read status");
    if (observer_command(client, OBSERVER_COMMAND_STATUS, 5.0, &reply) < 0)
        return fail("command");
    if (observer_reply_text(&reply, text, sizeof text) < 0)
        return fail("reply's text");
    printf("published %" PRIu64 ", answered %" PRIu64 ", newest %" PRIu64 ", outages %" PRIu64 "\n", samples,
           answered, newest, outages);
    printf("velocity %.3f %.3f %.3f m/s, unknown force %.2f %.2f %.2f N\n", estimate.velocity_m_s[0],
           estimate.velocity_m_s[1], estimate.velocity_m_s[2], estimate.matched_force_n[0],
           estimate.matched_force_n[1], estimate.matched_force_n[2]);
    printf("service: %" PRIu64 " samples used, outcome %" PRIu32 "%s%s\n", reply.status.counters.samples_accepted,
           reply.outcome, text[0] ? ": " : "", text);
    if (observer_close(client) < 0)
        return fail("close");
    return EXIT_SUCCESS;
}
