/* memory.c - what the machine has left for this process, and what the process has taken. */
#include "memory.h"

#include <stdio.h>
#include <string.h>

enum { LINE = 512, KILO = 1024 };

/* The number behind `key` in a file of lines "key: number kB"; 0 if the key is missing. */
static uint64_t kilobytes_of(const char *path, const char *key) {
    char line[LINE];
    unsigned long long number = 0;
    FILE *f = fopen(path, "r");
    if (!f) return 0;
    while (!number && fgets(line, sizeof line, f))
        if (!strncmp(line, key, strlen(key)) && sscanf(line + strlen(key), " %llu", &number) != 1) number = 0;
    fclose(f);
    return (uint64_t)number * KILO;
}

/* The number that a file holds; 0 where it holds none ("max") or is not there. */
static uint64_t number_in(const char *folder, const char *name) {
    char path[3 * LINE];
    unsigned long long number = 0;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *f = fopen(path, "r");
    if (!f) return 0;
    if (fscanf(f, "%llu", &number) != 1) number = 0;
    fclose(f);
    return number;
}

/* What a control group leaves; UINT64_MAX without a limit. Pages of files count as used here, though they can
 * be dropped: they are taken out. */
static uint64_t left_in(const char *folder, const char *limit_name, const char *used_name,
                        const char *cache_key) {
    uint64_t limit = number_in(folder, limit_name), used = number_in(folder, used_name), cache = 0;
    if (!limit || limit >= UINT64_MAX / 4) return UINT64_MAX;
    char path[3 * LINE];
    snprintf(path, sizeof path, "%s/memory.stat", folder);
    cache = kilobytes_of(path, cache_key) / KILO; /* bytes in this file */
    used = used > cache ? used - cache : 0;
    return limit > used ? limit - used : 0;
}

static uint64_t least(uint64_t a, uint64_t b) { return a < b ? a : b; }

/* The group's path, as /proc/self/cgroup names it below `mount`, and all above it: each may set a limit. */
static uint64_t left_up_from(const char *mount, char *group, const char *limit_name, const char *used_name,
                             const char *cache_key) {
    uint64_t left = UINT64_MAX;
    for (;;) {
        char folder[2 * LINE];
        snprintf(folder, sizeof folder, "%s%s", mount, group);
        left = least(left, left_in(folder, limit_name, used_name, cache_key));
        char *slash = strrchr(group, '/');
        if (!slash) return left;
        *slash = 0;
    }
}

static uint64_t left_in_groups(void) {
    char line[LINE];
    uint64_t left = UINT64_MAX;
    FILE *f = fopen("/proc/self/cgroup", "r");
    if (!f) return left;
    while (fgets(line, sizeof line, f)) {
        line[strcspn(line, "\n")] = 0;
        char *path = strchr(line, ':'), *name = path ? path + 1 : NULL;
        path = name ? strchr(name, ':') : NULL;
        if (!path) continue;
        *path++ = 0;
        if (!*name) /* version 2 */
            left = least(
                left, left_up_from("/sys/fs/cgroup", path, "memory.max", "memory.current", "inactive_file"));
        else if (!strcmp(name, "memory"))
            left = least(left, left_up_from("/sys/fs/cgroup/memory", path, "memory.limit_in_bytes",
                                            "memory.usage_in_bytes", "total_inactive_file"));
    }
    fclose(f);
    return left;
}

uint64_t sf_memory_free(void) {
    uint64_t machine = kilobytes_of("/proc/meminfo", "MemAvailable:"), groups = left_in_groups();
    if (!machine) return groups == UINT64_MAX ? 0 : groups;
    return least(machine, groups);
}

uint64_t sf_memory_budget(uint64_t asked) {
    uint64_t left = asked ? 0 : sf_memory_free();
    if (asked) return asked;
    return left ? sf_memory_resident() + left / 5 * 4 : 0;
}

uint64_t sf_memory_resident(void) { return kilobytes_of("/proc/self/status", "VmRSS:"); }

sf_status sf_memory_check(sf_context *ctx, const char *path, const char *field, uint64_t bytes) {
    enum { LARGE = 1 << 28 }; /* smaller allocations are not checked */
    uint64_t left = bytes < LARGE ? 0 : sf_memory_free();
    if (!left || bytes <= left / 5 * 4) return SF_OK;
    return sf_fail(ctx, SF_ERR_MEMORY, "%s: %s: %llu bytes are more than the memory that is left, %llu", path,
                   field, (unsigned long long)bytes, (unsigned long long)left);
}
