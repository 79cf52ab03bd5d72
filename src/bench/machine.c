/* machine.c - the machine that is measured: its name, its clock, its memory. */
#include "machine.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "../base/statistics.h"
#include "clocks.h"

/* The value of the first line of a file of "name : value" that begins with one of two names. */
static int find_line(const char *path, const char *name, const char *other, char *value, size_t size) {
    char line[512];
    int found = 0;
    FILE *file = fopen(path, "r");
    while (file && !found && fgets(line, sizeof line, file)) {
        char *colon = strchr(line, ':');
        if (!colon || (strncmp(line, name, strlen(name)) && strncmp(line, other, strlen(other)))) continue;
        colon += 1 + strspn(colon + 1, " \t");
        colon[strcspn(colon, "\n")] = 0;
        snprintf(value, size, "%s", colon);
        found = 1;
    }
    if (file) fclose(file);
    return found;
}

static int read_line(const char *path, char *line, size_t size) {
    FILE *file = fopen(path, "r");
    int found = file && fgets(line, (int)size, file);
    if (file) fclose(file);
    if (found) line[strcspn(line, "\n")] = 0;
    return found;
}

/* x86 and armv7 name the processor or the board in cpuinfo, others in the device tree. */
static void find_name(char *name, size_t size) {
    if (find_line("/proc/cpuinfo", "model name", "Model", name, size) && *name) return;
    if (read_line("/proc/device-tree/model", name, size) && *name) return;
    snprintf(name, size, "unknown processor");
}

/* As sysfs lists the caches of the first processor; K, M and G as there. */
static double find_last_cache(void) {
    double most = 0;
    for (int i = 0; i < 8; i++) {
        char path[96], text[32], unit = 0;
        double size = 0;
        snprintf(path, sizeof path, "/sys/devices/system/cpu/cpu0/cache/index%d/size", i);
        if (!read_line(path, text, sizeof text) || sscanf(text, "%lf%c", &size, &unit) < 1) continue;
        size *= unit == 'K' ? 1024.0 : unit == 'M' ? 1048576.0 : unit == 'G' ? 1073741824.0 : 1.0;
        if (size > most) most = size;
    }
    return most;
}

/* What can be had without swapping: free pages and the cache of files. */
static double find_memory(void) {
    char text[64];
    if (find_line("/proc/meminfo", "MemAvailable", "MemAvailable", text, sizeof text))
        return 1024.0 * strtod(text, NULL);
#ifdef _SC_AVPHYS_PAGES
    long pages = sysconf(_SC_AVPHYS_PAGES), size = sysconf(_SC_PAGESIZE);
    if (pages > 0 && size > 0) return (double)pages * (double)size;
#endif
    return 0;
}

double bench_machine_room(void) {
    double memory = find_memory(), most = sizeof(void *) > 4 ? 64e9 : 1e9;
    if (memory == 0) return 256e6;
    return memory / 2 < most ? memory / 2 : most;
}

double bench_machine_far(const bench_machine *machine, int quick) {
    double bytes = 2 * machine->last_cache, room = bench_machine_room();
    if (bytes < 256e6) bytes = 256e6;
    if (quick) bytes = 16e6;
    return bytes < room ? bytes : room;
}

double bench_machine_load(void) {
    char text[64];
    return read_line("/proc/loadavg", text, sizeof text) ? strtod(text, NULL) : -1;
}

void bench_machine_describe(bench_machine *machine, int threads) {
    *machine = (bench_machine){.threads = threads, .load_start = bench_machine_load(), .load_end = -1};
    find_name(machine->cpu, sizeof machine->cpu);
    long cpus = sysconf(_SC_NPROCESSORS_ONLN);
    machine->cpus = cpus > 0 ? (int)cpus : 1;
    machine->last_cache = find_last_cache();
    machine->memory = find_memory();
}

/* Each addition takes one cycle and waits for the one before. Of a register, as some processors do away with
 * additions of constants. */
#if defined(__x86_64__) || defined(__i386__)
#define ADD "add %1, %0\n\t"
#elif defined(__aarch64__) || defined(__arm__)
#define ADD "add %0, %0, %1\n\t"
#endif

enum { ADDS = 64 };

static double add_chain(long rounds) {
    unsigned long sum = 0, one = 1;
    double start = bench_thread_clock();
    for (long i = 0; i < rounds; i++) {
#ifdef ADD
#define ADD8 ADD ADD ADD ADD ADD ADD ADD ADD
        __asm__ volatile(ADD8 ADD8 ADD8 ADD8 ADD8 ADD8 ADD8 ADD8 : "+r"(sum) : "r"(one));
#else
        for (int k = 0; k < ADDS; k++) {
            sum += one;
            __asm__ volatile("" : "+r"(sum));
        }
#endif
    }
    return bench_thread_clock() - start;
}

double bench_machine_clock(bench_machine *machine) {
    enum { ROUNDS = 8000, TIMES = 5 };
    double least = 0;
    for (int i = 0; i < TIMES; i++) bench_keep_least(&least, add_chain(ROUNDS));
    double ghz = least > 0 ? (double)ADDS * ROUNDS / least * 1e-9 : 0;
    if (machine->samples < BENCH_CLOCK_SAMPLES) machine->ghz[machine->samples++] = ghz;
    return ghz;
}

double bench_machine_ghz(const bench_machine *machine, int first) {
    double values[BENCH_CLOCK_SAMPLES];
    int n = machine->samples - first;
    if (n <= 0) return 0;
    memcpy(values, machine->ghz + first, (size_t)n * sizeof *values);
    return sf_median(values, (size_t)n);
}
