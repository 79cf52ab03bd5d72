/* args.c - parses a command line by its tables, and says what is wrong with it. */
#include "args.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <splatfit/fitter.h>

/* An option of the tables or of the hyperparameters. */
typedef struct found {
    const char *name;
    int takes_value;
    int optional_value; /* a flag of the hyperparameters: --name or --name=0|1 */
} found;

/* Names are equal with _ for -. `n` characters of `typed`. */
static int same_name(const char *name, const char *typed, size_t n) {
    if (strlen(name) != n) return 0;
    for (size_t i = 0; i < n; i++)
        if (name[i] != typed[i] && !(name[i] == '_' && typed[i] == '-')) return 0;
    return 1;
}

static int find_option(const command *cmd, const char *typed, size_t n, char letter, found *out) {
    for (const arg_option *const *table = cmd->tables; *table; table++)
        for (const arg_option *o = *table; o->name; o++)
            if (letter ? o->letter == letter : same_name(o->name, typed, n)) {
                *out = (found){o->name, o->metavar != NULL, 0};
                return 1;
            }
    sf_option_info info;
    for (size_t i = 0; cmd->with_fit_options && !letter && !sf_fit_option_info(i, &info); i++) {
        const char *former = sf_fit_option_former(info.name);
        if (same_name(info.name, typed, n) || (former && same_name(former, typed, n))) {
            int flag = info.kind == SF_KIND_FLAG;
            *out = (found){info.name, !flag, flag};
            return 1;
        }
    }
    return 0;
}

int args_colored(FILE *to) {
    const char *no = getenv("NO_COLOR"), *terminal = getenv("TERM");
    return isatty(fileno(to)) && !(no && *no) && terminal && strcmp(terminal, "dumb") != 0;
}

/* "rank 1 on HOST: ", of a rank of several that is not the first. */
static char speaker[128];

const char *args_speaker(void) { return speaker; }

void args_speak_as(int rank, const char *host) {
    snprintf(speaker, sizeof speaker, "rank %d on %s: ", rank, host);
}

int args_error(const command *cmd, const char *format, ...) {
    int colored = args_colored(stderr);
    char text[4096]; /* written at once: ranks speak at the same time, and one of them may end all */
    va_list values;
    va_start(values, format);
    vsnprintf(text, sizeof text, format, values);
    va_end(values);
    fprintf(stderr, "%ssplatfit%s%s:%s %s%s\n", colored ? "\033[1;31m" : "", cmd ? " " : "",
            cmd ? cmd->name : "", colored ? "\033[0m" : "", speaker, text);
    return EXIT_FAILED;
}

static int within(const char *typed, const char *word, size_t most) {
    if (!*typed || !*word) return strlen(typed) + strlen(word) <= most;
    if (*typed == *word || (*typed == '-' && *word == '_')) return within(typed + 1, word + 1, most);
    return most && (within(typed + 1, word, most - 1) || within(typed, word + 1, most - 1) ||
                    within(typed + 1, word + 1, most - 1));
}

int args_near(const char *typed, const char *word) {
    size_t n = strlen(typed);
    return (n > 2 && !strncmp(word, typed, n)) || within(typed, word, n < 6 ? 1 : 2);
}

static int usage(const command *cmd, const char *what, const char *typed) {
    args_error(cmd, "%s: %s (see splatfit %s --help)", typed, what, cmd->name);
    return EXIT_USAGE;
}

/* An option that may have been meant; NULL: none. */
static const char *near_option(const command *cmd, const char *typed) {
    for (const arg_option *const *table = cmd->tables; *table; table++)
        for (const arg_option *o = *table; o->name; o++)
            if (args_near(typed, o->name)) return o->name;
    sf_option_info info;
    for (size_t i = 0; cmd->with_fit_options && !sf_fit_option_info(i, &info); i++)
        if (args_near(typed, info.name)) return info.name;
    return NULL;
}

static int unknown(const command *cmd, const char *typed) {
    char name[64] = "";
    if (typed[1] == '-') snprintf(name, sizeof name, "%.*s", (int)strcspn(typed + 2, "="), typed + 2);
    const char *meant = *name ? near_option(cmd, name) : NULL;
    if (!meant) return usage(cmd, "unknown option", typed);
    snprintf(name, sizeof name, "%s", meant);
    for (char *c = name; *c; c++)
        if (*c == '_') *c = '-';
    args_error(cmd, "%s: unknown option: is --%s meant? (see splatfit %s --help)", typed, name, cmd->name);
    return EXIT_USAGE;
}

static int keep(args *a, const char *name, const char *value) {
    if (a->givens == ARGS_MOST) return usage(a->command, "too many options", name);
    a->given[a->givens].name = name;
    a->given[a->givens++].value = value;
    return 0;
}

/* One option at argv[*at]; *at moves on to its value if that is a separate argument. */
static int parse_option(args *a, int argc, char **argv, int *at) {
    const char *typed = argv[*at], *equals = NULL;
    found f;
    if (typed[1] == '-') {
        equals = strchr(typed, '=');
        size_t n = equals ? (size_t)(equals - typed) - 2 : strlen(typed) - 2;
        if (!find_option(a->command, typed + 2, n, 0, &f)) return unknown(a->command, typed);
    } else if (typed[2] || !find_option(a->command, NULL, 0, typed[1], &f)) {
        return unknown(a->command, typed);
    }
    if (equals && !f.takes_value && !f.optional_value) return usage(a->command, "takes no value", typed);
    if (equals) return keep(a, f.name, equals + 1);
    if (!f.takes_value) return keep(a, f.name, f.optional_value ? "1" : "");
    if (++*at == argc) return usage(a->command, "needs a value", typed);
    return keep(a, f.name, argv[*at]);
}

int args_parse(args *a, const command *cmd, int argc, char **argv) {
    *a = (args){.command = cmd};
    int only_positional = 0;
    for (int at = 0; at < argc; at++) {
        const char *typed = argv[at];
        int error = 0;
        if (only_positional || typed[0] != '-' || !typed[1]) {
            if (a->positionals == cmd->most) return usage(cmd, "one argument too many", typed);
            a->positional[a->positionals++] = typed;
        } else if (!strcmp(typed, "--")) {
            only_positional = 1;
        } else {
            error = parse_option(a, argc, argv, &at);
        }
        if (error) return error;
    }
    if (args_value(a, "help") || a->positionals >= cmd->least) return 0;
    args_error(cmd, "an argument is missing: splatfit %s %s", cmd->name, cmd->synopsis);
    return EXIT_USAGE;
}

const char *args_value(const args *a, const char *name) {
    for (int i = a->givens - 1; i >= 0; i--)
        if (!strcmp(a->given[i].name, name)) return a->given[i].value;
    return NULL;
}

int args_int(const args *a, const char *name, long least, long most, int *value) {
    const char *text = args_value(a, name);
    if (!text) return 0;
    char *end;
    errno = 0;
    long number = strtol(text, &end, 10);
    if (end == text || *end || errno || number < least || number > most) {
        args_error(a->command, "--%s: \"%s\" is not a whole number in %ld..%ld", name, text, least, most);
        return EXIT_USAGE;
    }
    *value = (int)number;
    return 0;
}

int args_numbers(const args *a, const char *name, int count, double *values) {
    const char *text = args_value(a, name), *at = text;
    double read[16];
    if (!text) return 0;
    for (int k = 0; k < count; k++) {
        char *end;
        read[k] = strtod(at, &end);
        if (end == at || *end != (k + 1 < count ? ',' : 0) || !isfinite(read[k])) {
            args_error(a->command, "--%s: \"%s\" is not %d number%s", name, text, count,
                       count > 1 ? "s set apart by commas" : "");
            return EXIT_USAGE;
        }
        at = end + 1;
    }
    memcpy(values, read, (size_t)count * sizeof *values);
    return 0;
}
