/* test_spans.c - the tiles of each Gaussian at every level against float64. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "reference/bounds.h"

/* Sizes in px, aspect, and places: in the picture and up to `beyond` px beside it. */
typedef struct kind {
    const char *name;
    double size[2], aspect, beyond, opacity[2];
} kind;

static const kind kinds[] = {
    {"round", {1, 30}, 2, 30, {0.01, 1}},
    {"needles", {10, 500}, 1000, 300, {0.01, 1}},
    {"tiny", {1e-4, 0.5}, 10, 2, {0.01, 1}},
    {"huge", {300, 1e6}, 100, 3000, {0.01, 1}},
    {"faint", {0.5, 200}, 30, 20, {1 / 255.0, 1.02 / 255}},
    {"beside", {1, 1e3}, 1000, 1e7, {0.01, 1}},
    {"level", {10, 300}, 1000, 50, {0.01, 1}}, /* along a side of the picture, or nearly */
};
enum { KINDS = sizeof kinds / sizeof *kinds, LEVEL = KINDS - 1, ROUNDS = 60, MOST = 96 };

typedef struct spans {
    sf_splat *splats;
    uint16_t *first_row, *rows;
    uint32_t *offset;
    size_t first, end;
    int tiles_x, tiles_y;
    sf_span *spans;
    uint32_t *tiles, span_count;
    float *depth;
} spans;

/* The rows that project gives: those that the tight box and a hundredth of a pixel more reach. */
static void set_rows(spans *s, size_t i) {
    double top = (double)s->splats[i].v - (double)s->splats[i].half_height - 0.01;
    double bottom = (double)s->splats[i].v + (double)s->splats[i].half_height + 0.01;
    double y0 = ceil(fmax(top - (SF_TILE - 0.5), 0) / SF_TILE);
    double y1 = floor(fmin(bottom - 0.5, SF_TILE * s->tiles_y - 1.0) / SF_TILE);
    if (bottom < 0.5 || y1 < y0) return;
    s->first_row[i] = (uint16_t)y0, s->rows[i] = (uint16_t)(y1 - y0 + 1);
}

static void make_gaussian(check *c, spans *s, size_t i) {
    const kind *k = &kinds[c->seed / 2 % KINDS];
    double mean[2] = {check_between(c, 0, SF_TILE * s->tiles_x), check_between(c, 0, SF_TILE * s->tiles_y)};
    double size[2], angle = check_between(c, 0, 3.1415926), beyond = check_magnitude(c, 0.01, k->beyond);
    switch (check_pick(c, 6)) { /* beside one of the four sides */
    case 0:
        mean[0] = -beyond;
        break;
    case 1:
        mean[0] = SF_TILE * s->tiles_x + beyond;
        break;
    case 2:
        mean[1] = -beyond;
        break;
    case 3:
        mean[1] = SF_TILE * s->tiles_y + beyond;
        break;
    }
    if (k == &kinds[LEVEL]) angle = 1.57079632679 * (double)check_pick(c, 2) + 0.01 * sf_rng_normal(&c->rng);
    size[0] = check_magnitude(c, k->size[0], k->size[1]);
    size[1] = size[0] / check_magnitude(c, 1, k->aspect);
    s->splats[i] = check_splat(mean, size, angle, check_between(c, k->opacity[0], k->opacity[1]));
    if (check_pick(c, 10)) set_rows(s, i);
}

static void make_case(check *c, spans *s) {
    size_t blocks = 1 + check_pick(c, MOST / SF_LANES), padded = blocks * SF_LANES;
    s->tiles_x = 1 + (int)check_pick(c, 25), s->tiles_y = 1 + (int)check_pick(c, 20);
    s->first = SF_LANES * check_pick(c, blocks);
    s->end = s->first + 1 + check_pick(c, padded - s->first);
    s->splats = check_input(c, "splats", padded, sizeof *s->splats, 64);
    s->first_row = check_input(c, "first_row", padded, sizeof *s->rows, sizeof *s->rows);
    s->rows = check_input(c, "rows", padded, sizeof *s->rows, sizeof *s->rows);
    s->offset = check_input(c, "offset", padded + 1, sizeof *s->offset, sizeof *s->offset);
    for (size_t i = 0; i < padded; i++) {
        make_gaussian(c, s, i);
        s->offset[i + 1] = s->offset[i] + s->rows[i];
    }
    s->span_count = s->offset[padded];
    s->spans = check_output(c, "spans", s->span_count, sizeof *s->spans, sizeof(uint16_t));
    s->tiles = check_output(c, "tiles", padded, sizeof *s->tiles, sizeof *s->tiles);
    s->depth = check_output(c, "depth", padded, sizeof *s->depth, sizeof *s->depth);
}

static void call_spans(const sf_kernels *kernels, void *args) {
    spans *s = args;
    kernels->spans(s->splats, s->first_row, s->rows, s->offset, s->first, s->end, s->tiles_x, s->spans,
                   s->tiles, s->depth);
}

static int holds(test_ref_span span, int x) { return x >= span.first && x < span.end; }

static void compare_row(check *c, const spans *s, size_t i, int r, size_t *tiles) {
    sf_span got = s->spans[s->offset[i] + (uint32_t)r];
    test_ref_span needed, allowed;
    test_ref_span_row(&s->splats[i], s->first_row[i] + r, s->tiles_x, &needed, &allowed);
    check_that(c, got.x0 <= got.x1 && got.x1 <= s->tiles_x, "a span ends before it begins, or outside", i);
    *tiles += (size_t)(got.x1 - got.x0);
    for (int x = 0; x < s->tiles_x; x++) {
        int listed = x >= got.x0 && x < got.x1;
        if (holds(needed, x))
            check_that(c, listed, "a tile with a visible pixel is missing", i);
        else if (!holds(allowed, x))
            check_that(c, !listed, "a tile is listed that nothing reaches", i);
        else
            check_cliffs(c, 1);
    }
}

static void compare(check *c, const spans *s) {
    static uint8_t owned[MOST * 64];
    memset(owned, 0, sizeof owned);
    for (size_t i = 0; i < s->end; i++) {
        size_t tiles = 0;
        if (i < s->first) {
            check_that(c,
                       check_untouched(&s->tiles[i], sizeof *s->tiles) &&
                           check_untouched(&s->depth[i], sizeof *s->depth),
                       "wrote beside the Gaussians asked for", i);
            continue;
        }
        for (int r = 0; r < s->rows[i]; r++) {
            owned[s->offset[i] + (uint32_t)r] = 1;
            compare_row(c, s, i, r, &tiles);
        }
        check_that(c, s->tiles[i] == tiles, "the number of tiles is another", i);
        check_that(c, !s->rows[i] || s->depth[i] == s->splats[i].depth, "the depth is another", i);
    }
    for (uint32_t k = 0; k < s->span_count; k++)
        check_that(c, owned[k] || check_untouched(&s->spans[k], sizeof *s->spans),
                   "wrote into a span of another Gaussian", k);
}

static void spans_case(check *c) {
    spans s;
    memset(&s, 0, sizeof s);
    make_case(c, &s);
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (check_call(c, 0, call_spans, &s)) compare(c, &s);
    }
}

static void spans_agree_with_float64(void **state) {
    (void)state;
    static const check_kernel kernel = {"spans", SF_KERNEL_spans};
    check_kernels(&kernel, 1, 2 * KINDS * ROUNDS, spans_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(spans_agree_with_float64)};
    return cmocka_run_group_tests_name("check spans", tests, NULL, NULL);
}
