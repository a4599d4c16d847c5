/* A child that ends by exit() leaves its parent's ports alone. Run by daemon/tests/c_client.rs with a service in
 * $OBSERVER_ROOT. */

#define _XOPEN_SOURCE 700

#include "observer_client.h"
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

static int n_files;

static int count(const char *path, const struct stat *status, int type, struct FTW *place)
{
    (void)path, (void)status, (void)place;
    n_files += type == FTW_F;
    return 0;
}

static int files_of_the_domain(void)
{
    n_files = 0;
    nftw(getenv("OBSERVER_ROOT"), count, 8, FTW_PHYS);
    return n_files;
}

int main(void)
{
    observer_client client;
    if (observer_open(OBSERVER_LAYOUT, NULL, "vehicle", OBSERVER_PORTS_ALL, 10.0, &client) < 0) {
        fprintf(stderr, "open: %s\n", observer_error_text());
        return EXIT_FAILURE;
    }
    int before = files_of_the_domain();
    int status = 0;
    pid_t child = fork();
    if (child == 0)
        exit(0);
    waitpid(child, &status, 0);
    printf("child ended with %d; %d files gone\n", status, before - files_of_the_domain());
    return observer_close(client) < 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
