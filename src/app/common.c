/* common.c - what the subcommands share: errors, a context, lines of poses, JSON, measures of the process. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "app.h"

int app_fail(const args *a, const sf_context *ctx) {
    const char *message = sf_last_error(ctx);
    return args_error(a->command, "%s", *message ? message : "out of memory");
}

int app_say(const args *a, const char *subject, const char *what) {
    return args_error(a->command, "%s: %s", subject, what);
}

static int log_is_held;

void app_hold_log(int hold) { log_is_held = hold; }

static void print_log(void *user, sf_log_level level, const char *message) {
    (void)user;
    if (log_is_held) return;
    if (level < (*args_speaker() ? SF_LOG_WARNING : SF_LOG_INFO)) return;
    int colored = level == SF_LOG_WARNING && args_colored(stderr);
    fprintf(stderr, "%s%s%s%s%s\n", args_speaker(), colored ? "\033[1;33m" : "",
            level == SF_LOG_WARNING ? "warning: " : "", colored ? "\033[0m" : "", message);
}

int app_context(const args *a, sf_context **ctx) {
    sf_context_options options = {.isa = args_value(a, "isa")};
    if (!args_value(a, "quiet")) options.log = print_log;
    int error = args_int(a, "threads", 1, 256, &options.threads);
    if (!error) error = app_cores(a);
    if (error) return error;
    sf_status status = sf_context_create(ctx, &options);
    if (!status) return 0;
    if (status == SF_ERR_ARGUMENT || status == SF_ERR_UNSUPPORTED) {
        const char *isa = options.isa ? options.isa : getenv("SPLATFIT_ISA");
        char usable[128] = "";
        sf_isa_info info;
        for (size_t i = 0, n = 0; !sf_isa_describe(i, &info) && n < sizeof usable; i++)
            if (info.usable) n += (size_t)snprintf(usable + n, sizeof usable - n, " %s", info.name);
        args_error(a->command, "isa: \"%s\" is none of this machine's:%s", isa ? isa : "", usable);
        return EXIT_USAGE;
    }
    return app_say(a, "cannot start", sf_status_text(status));
}

static int rising(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double app_median(double *values, size_t n) {
    qsort(values, n, sizeof *values, rising);
    return n ? values[n / 2] : NAN;
}

size_t app_pose_header(char line[APP_POSE_LINE]) {
    return (size_t)snprintf(line, APP_POSE_LINE, "# time x y z qx qy qz qw, camera to world\n");
}

size_t app_pose_line(char line[APP_POSE_LINE], double time, const double c[3], const double q[4]) {
    int n = snprintf(line, APP_POSE_LINE, "%.6f %.13g %.13g %.13g %.7f %.7f %.7f %.7f\n", time, c[0], c[1],
                     c[2], q[1], q[2], q[3], q[0]);
    return n < APP_POSE_LINE ? (size_t)n : 0; /* of values beyond all sense */
}

json_t *app_json_text(const char *text) {
    json_t *string = json_string(text);
    if (string) return string;
    char *plain = malloc(strlen(text) + 1);
    if (!plain) return NULL;
    strcpy(plain, text);
    for (char *c = plain; *c; c++)
        if ((unsigned char)*c > 127) *c = '?';
    string = json_string(plain);
    free(plain);
    return string;
}

json_t *app_json_numbers(const double *values, int count) {
    json_t *list = json_array();
    for (int i = 0; i < count; i++) json_array_append_new(list, json_real(values[i]));
    return list;
}

json_t *app_json_pose(const sf_camera *c) {
    return json_pack("{s:o, s:o, s:f, s:f, s:f, s:f, s:i, s:i}", "R_cw", app_json_numbers(c->R_cw, 9), "t_cw",
                     app_json_numbers(c->t_cw, 3), "fx", c->fx, "fy", c->fy, "cx", c->cx, "cy", c->cy,
                     "width", (int)c->width, "height", (int)c->height);
}

double app_seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

double app_peak_memory(void) {
    struct rusage usage;
    return getrusage(RUSAGE_SELF, &usage) ? 0 : (double)usage.ru_maxrss / 1024;
}
