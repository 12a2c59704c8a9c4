/* The lowest lateness that this machine allows: the pacing of piezod's loop, and nothing else.
 *
 * usage: floor PERIOD_NS SPIN_NS SECONDS PRIORITY CPU
 * Deadlines are absolute. The loop sleeps until SPIN_NS before a deadline and spins for the rest;
 * periods that have passed are skipped and counted. It prints the lateness of each cycle in ns, one
 * per line, then "skipped N".
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

int main(int argc, char **argv) {
    if (argc != 6) return 2;
    int64_t period = atoll(argv[1]), spin = atoll(argv[2]);
    long cycles = atol(argv[3]) * 1000000000LL / period, skipped = 0;
    struct sched_param param = {.sched_priority = atoi(argv[4])};
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET(atoi(argv[5]), &cpus);

    int64_t *late = calloc(cycles, sizeof *late);
    int latency_file = open("/dev/cpu_dma_latency", O_WRONLY);
    int32_t latency = 0;
    if (latency_file >= 0 && write(latency_file, &latency, 4) != 4) perror("cpu_dma_latency");
    if (mlockall(MCL_CURRENT | MCL_FUTURE)) perror("mlockall");
    if (sched_setaffinity(0, sizeof cpus, &cpus)) perror("affinity");
    if (sched_setscheduler(0, SCHED_FIFO, &param)) perror("SCHED_FIFO");

    int64_t deadline = now_ns();
    for (long i = 0; i < cycles; i++) {
        deadline += period;
        int64_t now = now_ns();
        if (now > deadline) {
            skipped += (now - deadline) / period;
            deadline += (now - deadline) / period * period;
        }
        if (now < deadline - spin) {
            int64_t wake = deadline - spin;
            struct timespec t = {wake / 1000000000LL, wake % 1000000000LL};
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
            now = now_ns();
        }
        while (now < deadline) now = now_ns();
        skipped += (now - deadline) / period;
        deadline += (now - deadline) / period * period;
        late[i] = now - deadline;
    }
    for (long i = 0; i < cycles; i++) printf("%lld\n", (long long)late[i]);
    printf("skipped %ld\n", skipped);
    return 0;
}
