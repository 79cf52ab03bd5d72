/* replay.c - a run's log as the recipe of another: its options, its scene, and the time of each step. */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "app.h"

/* Differences between steps, "d" or "d*n" for n equal ones: a few characters a step. */
static char *text_of_plan(const uint32_t *ticks, size_t count) {
    enum { MOST = 24 }; /* characters of an item */
    char *text = malloc(count * MOST + 1);
    size_t used = 0;
    if (!text) return NULL;
    text[0] = 0;
    for (size_t i = 0, equal; i < count; i += equal) {
        uint32_t delta = ticks[i] - (i ? ticks[i - 1] : 0);
        for (equal = 1; i + equal < count && ticks[i + equal] - ticks[i + equal - 1] == delta;) equal++;
        used += (size_t)snprintf(text + used, MOST, equal > 1 ? "%s%" PRIu32 "*%zu" : "%s%" PRIu32,
                                 i ? " " : "", delta, equal);
    }
    return text;
}

json_t *replay_plan_json(const sf_fitter *fitter) {
    size_t count;
    if (sf_fitter_get_plan(fitter, NULL, 0, &count) || !count) return json_null();
    uint32_t *ticks = malloc(count * sizeof *ticks);
    char *text = NULL;
    if (ticks && !sf_fitter_get_plan(fitter, ticks, count, &count)) text = text_of_plan(ticks, count);
    json_t *plan = text ? json_pack("{s:i, s:I, s:s}", "ticks", (int)SF_PLAN_TICKS, "steps",
                                    (json_int_t)count, "deltas", text)
                        : json_null();
    free(ticks);
    free(text);
    return plan;
}

json_t *replay_scene_json(sf_scene *scene) {
    uint64_t fingerprint;
    char text[24];
    if (sf_scene_fingerprint(scene, &fingerprint)) return json_null();
    snprintf(text, sizeof text, "%016" PRIx64, fingerprint);
    return json_string(text);
}

/* One line "replay.json: FIELD: what". */
static int refuse(const args *a, const char *field, const char *what) {
    return args_error(a->command, "%s: %s: %s", args_value(a, "replay"), field, what);
}

/* A regular file: a pipe has no end that can be told. */
static int read_log(const args *a, const char *path, FILE *file, json_t **log) {
    enum { MOST = 1 << 28 };
    struct stat st;
    json_error_t error;
    char why[64 + JSON_ERROR_TEXT_LENGTH];
    if (fstat(fileno(file), &st) || !S_ISREG(st.st_mode)) return app_say(a, path, "is not a regular file");
    if (st.st_size > MOST) return app_say(a, path, "size: more than 256 MiB are no log");
    *log = json_loadf(file, JSON_REJECT_DUPLICATES, &error);
    if (*log) return 0;
    snprintf(why, sizeof why, "line %d: %s", error.line, error.text);
    for (char *c = why; *c; c++) /* it may cite the file */
        if ((unsigned char)*c < ' ' || *c == 127) *c = '?';
    return app_say(a, path, why);
}

int replay_open(const args *a, json_t **log) {
    const char *path = args_value(a, "replay");
    *log = NULL;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* a pipe is refused, not waited for */
    FILE *file = fd < 0 ? NULL : fdopen(fd, "rb");
    if (!file) {
        int error = app_say(a, path, strerror(errno));
        if (fd >= 0) close(fd);
        return error;
    }
    int error = read_log(a, path, file, log);
    fclose(file);
    if (error) return error;
    if (!json_is_object(json_object_get(*log, "options"))) return refuse(a, "options", "is no log of a fit");
    return 0;
}

static int set_option(const args *a, sf_context *ctx, const char *name, const json_t *value,
                      sf_fit_options *options) {
    char text[64];
    if (json_is_string(value))
        snprintf(text, sizeof text, "%s", json_string_value(value));
    else if (json_is_integer(value))
        snprintf(text, sizeof text, "%lld", (long long)json_integer_value(value));
    else if (json_is_real(value))
        snprintf(text, sizeof text, "%.17g", json_real_value(value));
    else
        return refuse(a, name, value ? "is neither a number nor a text" : "is missing from the options");
    return sf_fit_options_set(ctx, options, name, text) ? refuse(a, "options", sf_last_error(ctx)) : 0;
}

int replay_options(const args *a, sf_context *ctx, const json_t *log, sf_fit_options *options) {
    const json_t *values = json_object_get(log, "options");
    size_t known = 0;
    int error = 0;
    sf_option_info info;
    for (size_t i = 0; !error && !sf_fit_option_info(i, &info); i++) {
        known++;
        if (strcmp(info.name, "memory") && args_value(a, info.name))
            return refuse(a, info.name, "is given again: --replay takes it from the log");
        error = set_option(a, ctx, info.name, json_object_get(values, info.name), options);
    }
    if (!error && json_object_size(values) != known)
        return refuse(a, "options", "hold more than this program knows");
    return error;
}

/* Reads "d" or "d*n" at *at. */
static int next_item(const char **at, unsigned long *delta, unsigned long *times) {
    char *stop;
    *times = 1;
    *delta = strtoul(*at, &stop, 10);
    if (stop == *at || **at == '-' || *delta > SF_PLAN_TICKS) return 0;
    if (*stop == '*') {
        *at = stop + 1;
        *times = strtoul(*at, &stop, 10);
        if (stop == *at || **at == '-') return 0;
    }
    *at = stop;
    return *stop == 0 || *stop == ' ';
}

static int read_plan(const char *text, uint32_t *ticks, size_t count) {
    size_t n = 0;
    uint32_t now = 0;
    unsigned long delta, times;
    for (const char *at = text; *at;) {
        if (!next_item(&at, &delta, &times) || times > count - n) return 0;
        for (; times; times--) {
            if (delta > SF_PLAN_TICKS - now) return 0;
            ticks[n++] = now += (uint32_t)delta;
        }
    }
    return n == count;
}

/* The plan of a log, the caller's to free; NULL where the run had no time limit. 0 or an exit code. */
static int plan_of(const args *a, const json_t *log, uint32_t **ticks, size_t *count) {
    const json_t *plan = json_object_get(log, "plan");
    *ticks = NULL;
    if (!json_is_object(plan)) {
        double limit = json_number_value(json_object_get(json_object_get(log, "options"), "time_limit"));
        return limit > 0 ? refuse(a, "plan", "is missing: a run limited by time cannot be repeated") : 0;
    }
    const char *text = json_string_value(json_object_get(plan, "deltas"));
    json_int_t steps = json_integer_value(json_object_get(plan, "steps"));
    if (json_integer_value(json_object_get(plan, "ticks")) != SF_PLAN_TICKS || !text || steps < 0 ||
        steps > INT32_MAX)
        return refuse(a, "plan", "is not one that this program reads");
    *count = (size_t)steps;
    *ticks = malloc((*count + 1) * sizeof **ticks);
    if (!*ticks) return app_say(a, "plan", "out of memory");
    if (read_plan(text, *ticks, *count)) return 0;
    free(*ticks);
    *ticks = NULL;
    return refuse(a, "plan", "its deltas do not make as many steps as it announces");
}

/* Whether the log's text `key` is `mine`. */
static int is_same(const json_t *log, const char *key, const char *mine) {
    const char *text = json_string_value(json_object_get(log, key));
    return text && mine && !strcmp(text, mine);
}

int replay_check(const args *a, sf_context *ctx, const json_t *log, sf_scene *scene) {
    json_t *mine = replay_scene_json(scene);
    int same = is_same(json_object_get(log, "scene"), "fingerprint", json_string_value(mine));
    json_decref(mine);
    if (!same)
        return refuse(a, "scene", "the run had other pictures, cameras or points, or read them otherwise");
    if (!is_same(log, "isa", sf_context_isa(ctx)))
        return refuse(a, "isa", "the run was made at another level of the kernels: see --isa");
    if (!is_same(log, "version", sf_version()))
        return refuse(a, "version", "the run was made by another version");
    if (json_is_true(json_object_get(log, "warm_start")) != (args_value(a, "from") != NULL))
        return refuse(a, "warm_start",
                      "the run began with --from, and this one does not, or the other way round");
    uint32_t *ticks;
    size_t count;
    int error = plan_of(a, log, &ticks, &count);
    free(ticks);
    return error;
}

int replay_follow(const args *a, sf_context *ctx, const json_t *log, sf_fitter *fitter) {
    uint32_t *ticks;
    size_t count;
    int error = plan_of(a, log, &ticks, &count);
    if (!error && ticks && sf_fitter_follow(fitter, ticks, count)) error = app_fail(a, ctx);
    free(ticks);
    return error;
}
