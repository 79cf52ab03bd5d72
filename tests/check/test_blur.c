/* test_blur.c - rows made blurrier, at every level: the floats of arch/scalar, near those of float64. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "../../arch/scalar/scalar.h"

static const int widths[] = {1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 47, 63, 64, 65, 100, 129, 257};
enum { WIDTHS = sizeof widths / sizeof *widths, WINDOW = 2 * SF_BLUR_RADIUS + SF_BLUR_ROWS };

/* What pixels are: any of 0..1; of both signs and all sizes; one among 0s. */
enum content { ANY, SIZES, IMPULSE, CONTENTS };

typedef struct rows {
    sf_blur_args args;
    const float *window[WINDOW];
    float taps[SF_BLUR_RADIUS + 1];
} rows;

static float some_pixel(check *c, enum content content) {
    if (content == ANY) return (float)check_between(c, 0, 1);
    if (content == SIZES) return (float)((check_pick(c, 2) ? 1 : -1) * check_magnitude(c, 1e-6, 1e6));
    return 0;
}

static void make_rows(check *c, rows *r) {
    uint64_t kind = c->seed / 2; /* the last bit says at which guard arrays lie */
    sf_blur_args *a = &r->args;
    enum content content = (enum content)check_pick(c, CONTENTS);
    *a = (sf_blur_args){.rows = r->window,
                        .taps = r->taps,
                        .radius = 1 + (int)(kind % SF_BLUR_RADIUS),
                        .width = widths[kind / SF_BLUR_RADIUS % WIDTHS],
                        .count = 1 + (int)check_pick(c, SF_BLUR_ROWS)};
    size_t width = (size_t)a->width, whole = (width + SF_LANES - 1) / SF_LANES * SF_LANES;
    for (int k = 0; k <= a->radius; k++) r->taps[k] = (float)check_between(c, 0.01, 0.5);
    for (int k = 0; k < 2 * a->radius + a->count; k++) {
        float *row = check_floats_in(c, "row", width + SF_LANES);
        for (size_t x = 0; x < width; x++) row[x] = some_pixel(c, content);
        for (size_t x = width; x < width + SF_LANES; x++) row[x] = 1e30f;
        if (content == IMPULSE && check_pick(c, 4) == 0) row[check_pick(c, width)] = 1;
        r->window[k] = row;
    }
    a->scratch = check_floats_out(c, "scratch", sf_blur_scratch(a->width));
    int wants_difference = (int)check_pick(c, 2);
    for (int k = 0; k < a->count; k++) {
        a->out[k] = check_floats_out(c, "out", whole);
        if (wants_difference) a->difference[k] = check_floats_out(c, "difference", whole);
    }
}

static void call_blur(const sf_kernels *kernels, void *args) {
    const rows *r = args;
    kernels->blur(&r->args);
}

static bounded blurred_down(const rows *r, int row, int x) {
    const float *const *middle = r->window + r->args.radius + row;
    bounded sum = b_mul(b_of((double)r->taps[0]), b_of((double)middle[0][x]));
    for (int k = 1; k <= r->args.radius; k++) {
        bounded both = b_add(b_of((double)middle[-k][x]), b_of((double)middle[k][x]));
        sum = b_add(sum, b_mul(b_of((double)r->taps[k]), both));
    }
    return sum;
}

static int inside(int x, int width) { return x < 0 ? 0 : x < width ? x : width - 1; }

static bounded blurred(const rows *r, const bounded *down, int x) {
    int width = r->args.width;
    bounded sum = b_mul(b_of((double)r->taps[0]), down[x]);
    for (int k = 1; k <= r->args.radius; k++) {
        bounded both = b_add(down[inside(x - k, width)], down[inside(x + k, width)]);
        sum = b_add(sum, b_mul(b_of((double)r->taps[k]), both));
    }
    return sum;
}

static void check_row(check *c, const rows *r, int row, const float *specified, const float *difference) {
    bounded down[257];
    for (int x = 0; x < r->args.width; x++) down[x] = blurred_down(r, row, x);
    for (int x = 0; x < r->args.width; x++) {
        float got = r->args.out[row][x];
        bounded want = blurred(r, down, x);
        check_near(c, "out", (size_t)x, (double)got, want);
        check_that(c, !memcmp(&got, &specified[x], sizeof got), "not the bytes of arch/scalar", (size_t)x);
        if (!r->args.difference[row]) continue;
        bounded less = b_sub(want, b_of((double)r->window[r->args.radius + row][x]));
        check_near(c, "difference", (size_t)x, (double)r->args.difference[row][x], less);
        check_that(c, !memcmp(&r->args.difference[row][x], &difference[x], sizeof got),
                   "not the difference of arch/scalar", (size_t)x);
    }
}

static void blur_case(check *c) {
    rows r;
    make_rows(c, &r);
    sf_blur_args scalar = r.args;
    size_t size = (size_t)r.args.width * sizeof(float);
    float *specified[SF_BLUR_ROWS] = {0}, *difference[SF_BLUR_ROWS] = {0};
    assert_non_null(scalar.scratch = malloc(sf_blur_scratch(r.args.width) * sizeof(float)));
    for (int k = 0; k < r.args.count; k++) {
        assert_non_null(scalar.out[k] = specified[k] = malloc(size));
        assert_non_null(difference[k] = malloc(size));
        if (scalar.difference[k]) scalar.difference[k] = difference[k];
    }
    sf_blur_scalar(&scalar);
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (!check_call(c, 0, call_blur, &r)) continue;
        for (int k = 0; k < r.args.count; k++) check_row(c, &r, k, specified[k], difference[k]);
    }
    for (int k = 0; k < r.args.count; k++) free(specified[k]), free(difference[k]);
    free(scalar.scratch);
}

static void levels_agree_and_are_right(void **state) {
    (void)state;
    static const check_kernel kernel = {"blur", SF_KERNEL_blur};
    check_kernels(&kernel, 1, (size_t)(2 * SF_BLUR_RADIUS * WIDTHS), blur_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(levels_agree_and_are_right)};
    return cmocka_run_group_tests_name("check blur", tests, NULL, NULL);
}
