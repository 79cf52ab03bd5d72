/* machine.h - the machine that is measured: its name, its clock, its memory. */
#ifndef BENCH_MACHINE_H
#define BENCH_MACHINE_H

#include <stddef.h>

enum { BENCH_CLOCK_SAMPLES = 256 };

typedef struct bench_machine {
    char cpu[96];                /* name */
    int cpus, threads;           /* of the machine; in use with all threads */
    double load_start, load_end; /* load average of a minute; negative: not known */
    double last_cache;           /* bytes of the largest cache; 0: not known */
    double memory;               /* bytes available at the start; 0: not known */
    double ghz[BENCH_CLOCK_SAMPLES];
    int samples;
} bench_machine;

void bench_machine_describe(bench_machine *machine, int threads);

/* Measures the clock rate, as additions a nanosecond of a chain in which each waits for the one before, and
 * keeps it as a sample. Takes about a millisecond. */
double bench_machine_clock(bench_machine *machine);

/* The median of all samples from `first` on, GHz; 0: no samples. */
double bench_machine_ghz(const bench_machine *machine, int first);

/* Load average over the last minute; negative if it is not known. */
double bench_machine_load(void);

/* Bytes that a benchmark may take: half of what is available now. */
double bench_machine_room(void);

/* Bytes of arrays that fit no cache: twice the largest and at least 256 MB, as far as there is memory. */
double bench_machine_far(const bench_machine *machine, int quick);

#endif
