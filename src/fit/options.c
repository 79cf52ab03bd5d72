/* options.c - the table of options: defaults, ranges, conversion from and to text. */
#include "options.h"

#include "../base/context.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct option {
    sf_option_info info;
    size_t offset;
} option;

#define INT(name, value, least, most, unit, text)                                                            \
    {{#name, SF_KIND_INT, value, least, (double)(most), unit, text}, offsetof(sf_fit_options, name)},
#define REAL(name, value, least, most, unit, text)                                                           \
    {{#name, SF_KIND_REAL, value, least, most, unit, text}, offsetof(sf_fit_options, name)},
#define FLAG(name, value, text)                                                                              \
    {{#name, SF_KIND_FLAG, value, 0, 1, "", text}, offsetof(sf_fit_options, name)},
#define ENUM(name, value, values, text)                                                                      \
    {{#name, SF_KIND_ENUM, value, 0, 0, values, text}, offsetof(sf_fit_options, name)},
static const option options_table[] = {SF_FIT_OPTIONS(INT, REAL, FLAG, ENUM)};
#undef INT
#undef REAL
#undef FLAG
#undef ENUM

enum { OPTION_COUNT = sizeof options_table / sizeof *options_table };

sf_fit_options sf_fit_options_default(void) {
#define VALUE_INT(name, value, least, most, unit, text)  .name = (value),
#define VALUE_REAL(name, value, least, most, unit, text) .name = (value),
#define VALUE_FLAG(name, value, text)                    .name = (value),
#define VALUE_ENUM(name, value, values, text)            .name = (value),
    return (sf_fit_options){SF_FIT_OPTIONS(VALUE_INT, VALUE_REAL, VALUE_FLAG, VALUE_ENUM)};
}

sf_status sf_fit_options_preset(sf_context *ctx, const char *name, sf_fit_options *options) {
    sf_fit_options preset = sf_fit_options_default();
    if (!strcmp(name, "draft")) {
        preset.steps = 800;
        preset.max_gaussians = 30000;
        preset.blur = 0;
        preset.validate = 0;
    } else if (!strcmp(name, "high")) {
        preset.steps = 4000;
        preset.max_gaussians = 400000;
        preset.densify_per_step = 52;
        preset.quality = 4;
    } else if (strcmp(name, "standard") != 0) {
        return sf_fail(ctx, SF_ERR_ARGUMENT, "preset: \"%s\" is none of draft|standard|high", name);
    }
    *options = preset;
    return SF_OK;
}

/* Number of values of an ENUM. */
static int enum_size(const char *values) {
    int n = 1;
    for (; *values; values++) n += *values == '|';
    return n;
}

static double most_of(const sf_option_info *info) {
    return info->kind == SF_KIND_ENUM ? enum_size(info->unit) - 1 : info->most;
}

sf_status sf_fit_option_info(size_t index, sf_option_info *info) {
    if (index >= OPTION_COUNT) return SF_ERR_END;
    *info = options_table[index].info;
    info->most = most_of(info);
    return SF_OK;
}

/* Names that options had in version 0.1.0, and have now. */
static const struct {
    const char *former, *name;
} renamed[] = {
    {"first", "init"},
    {"grow_end", "densify_end"},
    {"grow_every", "densify_every"},
    {"grow_most", "densify_per_step"},
    {"grow_rate", "densify_rate"},
    {"grow_start", "densify_start"},
    {"grow_threshold", "densify_threshold"},
    {"growth", "densify"},
    {"hold_two_poses", "fix_gauge"},
    {"lr_haste", "lr_boost"},
    {"lr_settle", "cool_down"},
    {"lr_settled", "cool_down_rate"},
    {"mean_steps", "ema_steps"},
};

const char *sf_fit_option_former(const char *name) {
    for (size_t i = 0; i < sizeof renamed / sizeof *renamed; i++)
        if (!strcmp(renamed[i].name, name)) return renamed[i].former;
    return NULL;
}

/* Names are equal with - for _. */
static int is_same_name(const char *a, const char *b) {
    while (*a && (*a == *b || (*a == '_' && *b == '-'))) a++, b++;
    return !*a && !*b;
}

static const option *find(const char *name) {
    for (size_t i = 0; i < OPTION_COUNT; i++) {
        const char *present = options_table[i].info.name, *former = sf_fit_option_former(present);
        if (is_same_name(present, name) || (former && is_same_name(former, name))) return &options_table[i];
    }
    return NULL;
}

static double value_of(const option *o, const sf_fit_options *options) {
    const char *at = (const char *)options + o->offset;
    int64_t integer;
    double real;
    int small;
    switch (o->info.kind) {
    case SF_KIND_INT:
        memcpy(&integer, at, sizeof integer);
        return (double)integer;
    case SF_KIND_REAL:
        memcpy(&real, at, sizeof real);
        return real;
    default:
        memcpy(&small, at, sizeof small);
        return small;
    }
}

/* Length of the value of an ENUM that starts at `values`. */
static size_t value_length(const char *values) { return strcspn(values, "|"); }

/* Index of `text` among the values of an ENUM, -1 if it is none. */
static int enum_index(const char *values, const char *text) {
    for (int i = 0;; i++) {
        size_t n = value_length(values);
        if (strlen(text) == n && !strncmp(values, text, n)) return i;
        if (!values[n]) return -1;
        values += n + 1;
    }
}

/* Numbers of bytes may end in K, M or G: 1024, its square, its cube. */
static double take_unit(const sf_option_info *info, char **end) {
    static const char letters[] = "KMG";
    const char *letter = **end ? strchr(letters, **end) : NULL;
    if (!letter || (*end)[1] || strcmp(info->unit, "bytes")) return 1;
    ++*end;
    return ldexp(1, 10 * (int)(letter - letters + 1));
}

static sf_status set_number(sf_context *ctx, const option *o, sf_fit_options *options, const char *text) {
    char *end, *at = (char *)options + o->offset;
    errno = 0;
    double real = strtod(text, &end);
    if (end != text) real *= take_unit(&o->info, &end);
    if (end == text || *end || !isfinite(real))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: \"%s\" is not a number", o->info.name, text);
    if (real < o->info.least || real > o->info.most)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s is not in %.15g..%.15g", o->info.name, text,
                       o->info.least, o->info.most);
    if (o->info.kind == SF_KIND_REAL) {
        memcpy(at, &real, sizeof real);
        return SF_OK;
    }
    errno = 0;
    int64_t integer = strtoll(text, &end, 10);
    if (*end && real == floor(real) && fabs(real) < 0x1p53)
        integer = (int64_t)real; /* "3e4" */
    else if (*end || errno)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: \"%s\" is not a whole number", o->info.name, text);
    int small = (int)integer;
    if (o->info.kind == SF_KIND_INT)
        memcpy(at, &integer, sizeof integer);
    else
        memcpy(at, &small, sizeof small);
    return SF_OK;
}

sf_status sf_fit_options_set(sf_context *ctx, sf_fit_options *options, const char *name, const char *text) {
    const option *o = find(name);
    if (!o) return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: no such option", name);
    if (o->info.kind != SF_KIND_ENUM) return set_number(ctx, o, options, text);
    int index = enum_index(o->info.unit, text);
    if (index < 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: \"%s\" is none of %s", o->info.name, text, o->info.unit);
    memcpy((char *)options + o->offset, &index, sizeof index);
    return SF_OK;
}

sf_status sf_fit_options_get(const sf_fit_options *options, const char *name, char *text, size_t size) {
    const option *o = find(name);
    if (!o) return SF_ERR_ARGUMENT;
    double value = value_of(o, options);
    int length;
    if (o->info.kind == SF_KIND_REAL) {
        length = snprintf(text, size, "%.15g", value);
        if (strtod(text, NULL) != value) length = snprintf(text, size, "%.17g", value);
    } else if (o->info.kind == SF_KIND_ENUM) {
        const char *values = o->info.unit;
        for (int i = 0; i < (int)value; i++) values += value_length(values) + 1;
        length = snprintf(text, size, "%.*s", (int)value_length(values), values);
    } else {
        int64_t integer; /* not through a double, which may round it out of its range */
        if (o->info.kind == SF_KIND_INT)
            memcpy(&integer, (const char *)options + o->offset, sizeof integer);
        else
            integer = (int64_t)value;
        length = snprintf(text, size, "%" PRId64, integer);
    }
    return length >= 0 && (size_t)length < size ? SF_OK : SF_ERR_ARGUMENT;
}

sf_status sf_fit_options_check(sf_context *ctx, const sf_fit_options *options) {
    for (size_t i = 0; i < OPTION_COUNT; i++) {
        const sf_option_info *info = &options_table[i].info;
        double value = value_of(&options_table[i], options);
        if (!(value >= info->least && value <= most_of(info)))
            return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %.15g is not in %.15g..%.15g", info->name, value,
                           info->least, most_of(info));
    }
    if (!options->steps && !(options->time_limit > 0))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "steps: 0 needs a time_limit");
    return SF_OK;
}
