/* Once a handle is open, calls make no system call: this program forbids itself all of them (the kernel would kill
 * it) and goes on publishing and reading. Run by daemon/tests/c_client.rs with a service in $OBSERVER_ROOT. */

#define _GNU_SOURCE

#include "observer_client.h"
#include <linux/seccomp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

static void check(observer_result result, const char *what)
{
    if (result < 0) {
        fprintf(stderr, "%s: %s\n", what, observer_error_text());
        exit(EXIT_FAILURE);
    }
}

int main(int argc, char **argv)
{
    observer_client client;
    observer_estimate estimate;
    observer_status status;
    observer_measurement sample = {.valid = OBSERVER_VALID_VELOCITY};
    check(observer_open(OBSERVER_LAYOUT, NULL, "vehicle", OBSERVER_PORTS_ALL, 10.0, &client), "open");
    /* Both sides connect, and every kind of call has been made once with a result. */
    uint64_t source_stamp_ns = 0;
    for (int i = 0; i < 2000 && source_stamp_ns == 0; ++i) {
        sample.stamp_ns = observer_now_ns();
        check(observer_publish(client, &sample), "publish");
        ++sample.sequence;
        check(observer_wait(client, 10.0, &estimate), "wait");
        source_stamp_ns = estimate.source_stamp_ns;
    }
    while (observer_peek(client, &estimate) != OBSERVER_OK || observer_read_status(client, &status) != OBSERVER_OK)
        usleep(1000);
    observer_reply reply;
    check(observer_command(client, OBSERVER_COMMAND_STATUS, 10.0, &reply), "command");

    if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_STRICT) != 0) {
        printf("skipped: this kernel has no strict mode of seccomp\n");
        return EXIT_SUCCESS;
    }
    int failures = 0;
    for (int i = 0; i < 2000; ++i) {
        /* The clock is left alone: without a vDSO it is a system call of the machine's. */
        sample.stamp_ns += 1000;
        ++sample.sequence;
        failures += observer_publish(client, &sample) < 0;
        failures += observer_take(client, &estimate) < 0;
        failures += observer_peek(client, &estimate) != OBSERVER_OK;
        failures += observer_read_status(client, &status) != OBSERVER_OK;
    }
    /* write and exit are the system calls that are left. `sleep` shows that others really end it. */
    const char *words = failures == 0 ? "no system call\n" : "calls failed\n";
    if (write(STDOUT_FILENO, words, strlen(words)) < 0)
        failures = 1;
    if (argc > 1 && strcmp(argv[1], "sleep") == 0)
        usleep(1);
    syscall(SYS_exit, failures != 0);
    return EXIT_FAILURE;
}
