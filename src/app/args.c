/* args.c - parses a command line by its tables, and prints them as help. */
#include "args.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
    for (size_t i = 0; cmd->with_fit_options && !letter && !sf_fit_option_info(i, &info); i++)
        if (same_name(info.name, typed, n)) {
            int flag = info.kind == SF_KIND_FLAG;
            *out = (found){info.name, !flag, flag};
            return 1;
        }
    return 0;
}

static int usage(const command *cmd, const char *what, const char *typed) {
    fprintf(stderr, "splatfit %s: %s: %s (see splatfit %s --help)\n", cmd->name, typed, what, cmd->name);
    return EXIT_USAGE;
}

static int keep(args *a, const char *name, const char *value) {
    if (a->givens == ARGS_MOST) return usage(a->command, "too many options", name);
    a->given[a->givens].name = name;
    a->given[a->givens++].value = value;
    return 0;
}

/* One option at argv[*at]; *at moves on to its value if that is an argument of its own. */
static int parse_option(args *a, int argc, char **argv, int *at) {
    const char *typed = argv[*at], *equals = NULL;
    found f;
    if (typed[1] == '-') {
        equals = strchr(typed, '=');
        size_t n = equals ? (size_t)(equals - typed) - 2 : strlen(typed) - 2;
        if (!find_option(a->command, typed + 2, n, 0, &f)) return usage(a->command, "unknown option", typed);
    } else if (typed[2] || !find_option(a->command, NULL, 0, typed[1], &f)) {
        return usage(a->command, "unknown option", typed);
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
    fprintf(stderr, "splatfit %s: an argument is missing: splatfit %s %s\n", cmd->name, cmd->name,
            cmd->synopsis);
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
        fprintf(stderr, "splatfit %s: --%s: \"%s\" is not a whole number in %ld..%ld\n", a->command->name,
                name, text, least, most);
        return EXIT_USAGE;
    }
    *value = (int)number;
    return 0;
}

/* Names are shown with dashes. */
static void print_name(const char *name, const char *metavar) {
    char shown[64];
    int n = snprintf(shown, sizeof shown, "--%s%s%s", name, metavar && *metavar ? " " : "",
                     metavar ? metavar : "");
    for (char *c = shown; *c && *c != ' '; c++)
        if (*c == '_') *c = '-';
    printf("  %-28s%s", shown, n > 27 ? "\n                              " : "");
}

static void help_hyperparameters(void) {
    sf_fit_options defaults = sf_fit_options_default();
    sf_option_info info;
    printf("\nHyperparameters (also with _ for -):\n");
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char value[64];
        sf_fit_options_get(&defaults, info.name, value, sizeof value);
        print_name(info.name, info.kind == SF_KIND_FLAG ? NULL : info.kind == SF_KIND_ENUM ? info.unit : "X");
        printf("%s", info.text);
        if (info.kind == SF_KIND_ENUM)
            printf(" (%s)\n", value);
        else if (info.kind == SF_KIND_FLAG)
            printf("\n");
        else
            printf(" (%s%s%s; %g..%g)\n", value, *info.unit ? " " : "", info.unit, info.least, info.most);
    }
}

void args_help(const command *cmd) {
    printf("splatfit %s %s\n\n%s\n\nOptions:\n", cmd->name, cmd->synopsis, cmd->summary);
    for (const arg_option *const *table = cmd->tables; *table; table++)
        for (const arg_option *o = *table; o->name; o++) {
            print_name(o->name, o->metavar);
            printf("%s", o->text);
            if (o->letter) printf(" (also -%c)", o->letter);
            printf("\n");
        }
    if (cmd->with_fit_options) help_hyperparameters();
}
