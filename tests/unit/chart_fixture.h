/* chart_fixture.h - logs, and charts drawn from them. */
#ifndef TESTS_UNIT_CHART_FIXTURE_H
#define TESTS_UNIT_CHART_FIXTURE_H

#include "testing.h"

#include <ctype.h>
#include <jansson.h>

#include "../../src/chart/chart.h"

/* A log as fit writes it, with what charts need. Quality rises by 2 dB and 0.1 from point to point. */
typedef struct log_plan {
    const char *label, *preset, *isa, *scene;
    int width, height, seed;
    double first_psnr, gaussians;
    double seconds[8]; /* ended by 0 */
} log_plan;

extern const log_plan chart_plain;

json_t *chart_make_log(const log_plan *plan);
const char *chart_write_json(const char *name, json_t *json);
void chart_read_plan(chart_input *input, const char *name, const log_plan *plan);
void chart_assert_well_formed(const char *text);
int chart_count_of(const char *text, const char *part);

/* A picture that one of the functions of draw.c wrote; free() it. */
typedef sf_status (*draw_fn)(const void *what, sf_writer *out);

char *chart_drawn(sf_context *ctx, draw_fn draw, const void *what);

#define MOVE(name, seconds)                                                                                  \
    "{\"move\": \"" name "\", \"seconds\": " seconds ", \"steps\": 1500, \"psnr\": 31.25}"

void chart_write_text(const char *name, const char *text);

#endif
