/* cores.c - --cores: the processors that the program runs on. */
#define _GNU_SOURCE
#include <ctype.h>
#include <sched.h>
#include <stdlib.h>

#include "app.h"

/* One number or A-B; 0: it is neither. */
static int read_range(const char **text, long *first, long *last) {
    char *end;
    if (!isdigit((unsigned char)**text)) return 0;
    *first = *last = strtol(*text, &end, 10);
    if (*end == '-') {
        const char *second = end + 1;
        if (!isdigit((unsigned char)*second)) return 0;
        *last = strtol(second, &end, 10);
    }
    *text = end;
    return *first <= *last && *last < CPU_SETSIZE;
}

static int read_list(const char *text, cpu_set_t *set) {
    long first, last;
    CPU_ZERO(set);
    for (;; text++) {
        if (!read_range(&text, &first, &last)) return 0;
        for (long i = first; i <= last; i++) CPU_SET((size_t)i, set);
        if (!*text) return 1;
        if (*text != ',') return 0;
    }
}

int app_cores(const args *a) {
    const char *text = args_value(a, "cores");
    cpu_set_t set, got;
    if (!text) return 0;
    if (!read_list(text, &set)) {
        args_error(a->command, "--cores: \"%s\" is not a list of numbers, for example 0-2,5", text);
        return EXIT_USAGE;
    }
    /* The kernel leaves out what is not there, and fails where nothing is left. */
    if (!sched_setaffinity(0, sizeof set, &set) && !sched_getaffinity(0, sizeof got, &got) &&
        CPU_EQUAL(&set, &got))
        return 0;
    args_error(a->command, "--cores: \"%s\": not all of these are there, and for this program", text);
    return EXIT_USAGE;
}
