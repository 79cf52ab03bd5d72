/* throttling.c - see throttling.h. The names are those of Linux's
 * Documentation/ABI/testing/sysfs-class-thermal. */
#include "throttling.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/file.h"

enum { PATH = 512, TEXT = 64 };

/* Bits of get_throttled: the frequency is capped, the processor is throttled, the soft limit is reached. */
#define HELD_BACK 0xeul

/* The line in folder/name; 0: there is none. */
static int read_line(const char *folder, const char *name, char line[TEXT]) {
    char path[PATH];
    int length = snprintf(path, sizeof path, "%s/%s", folder, name);
    size_t got = length > 0 && length < PATH ? sf_read_start(path, (uint8_t *)line, TEXT - 1) : 0;
    line[got] = 0;
    line[strcspn(line, "\n")] = 0;
    return got > 0;
}

static int read_number(const char *folder, const char *name, double *value) {
    char line[TEXT], *end;
    if (!read_line(folder, name, line)) return 0;
    *value = strtod(line, &end);
    return end != line && !*end;
}

static int begins(const char *text, const char *with) { return !strncmp(text, with, strlen(with)); }

static int cools(const char *folder, const char *name, char *what, size_t size) {
    char type[TEXT];
    double state;
    if (!read_line(folder, "type", type) || !read_number(folder, "cur_state", &state) || !(state > 0))
        return 0;
    /* Fans cool too, and hold nothing back. */
    if (!strstr(type, "cpufreq") && !strstr(type, "cpuidle") && !begins(type, "Processor")) return 0;
    snprintf(what, size, "%s (%s): state %.0f", name, type, state);
    return 1;
}

static int is_warm(const char *folder, const char *name, char *what, size_t size) {
    double now, most;
    if (!read_number(folder, "temp", &now)) return 0;
    for (int i = 0; i < 16; i++) {
        char file[TEXT], type[TEXT];
        snprintf(file, sizeof file, "trip_point_%d_type", i);
        if (!read_line(folder, file, type)) break;
        snprintf(file, sizeof file, "trip_point_%d_temp", i);
        if (strcmp(type, "passive") != 0 || !read_number(folder, file, &most) || !(most > 0) || now < most)
            continue;
        snprintf(what, size, "%s: %.1f degrees, %.1f at most", name, now / 1000, most / 1000);
        return 1;
    }
    return 0;
}

static int firmware_holds_back(const char *folder, char *what, size_t size) {
    char path[PATH], line[TEXT];
    int length = snprintf(path, sizeof path, "%s/devices/platform/soc/soc:firmware", folder);
    if (length <= 0 || length >= PATH || !read_line(path, "get_throttled", line)) return 0;
    if (!(strtoul(line, NULL, 16) & HELD_BACK)) return 0;
    snprintf(what, size, "get_throttled: %s", line);
    return 1;
}

int sf_is_throttled(const char *folder, char *what, size_t size) {
    char thermal[PATH], path[PATH];
    if (firmware_holds_back(folder, what, size)) return 1;
    int length = snprintf(thermal, sizeof thermal, "%s/class/thermal", folder), hot = 0;
    DIR *entries = length > 0 && length < PATH ? opendir(thermal) : NULL;
    const struct dirent *e;
    while (entries && !hot && (e = readdir(entries))) {
        length = snprintf(path, sizeof path, "%s/%s", thermal, e->d_name);
        if (length <= 0 || length >= PATH) continue;
        if (begins(e->d_name, "cooling_device")) hot = cools(path, e->d_name, what, size);
        if (begins(e->d_name, "thermal_zone")) hot = is_warm(path, e->d_name, what, size);
    }
    if (entries) closedir(entries);
    return hot;
}
