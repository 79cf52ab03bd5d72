/* test_loss.c - the loss and its gradient at every level against float64, and for every cut into bands. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "reference/bounds.h"

enum content { NOISE, SMOOTH, ALIKE, SAME, FLAT, BEYOND, CONTENTS };
enum weighting { NONE, ONES, FRACTIONS, REGION, WEIGHTINGS };
enum mode { BOTH, VALUE, L1_GRADIENT, L1_VALUE, SSIM_GRADIENT, SSIM_BESIDE_L1, MODES };

/* Widths and heights: all small ones, then around multiples of a vector and a tile. */
static int side(size_t i) {
    static const int large[] = {47, 48, 49, 63, 64, 65, 79, 80, 81, 95, 97, 127, 129};
    return i < 40 ? (int)i + 1 : large[i - 40];
}
enum { SIDES = 53, MOST = 160, ROUNDS = 2 };

static float value_at(check *c, enum content content, int x, int y) {
    switch (content) {
    case NOISE:
        return (float)check_between(c, 0, 1);
    case FLAT:
        return x < 20 ? 0.5f : 0.0f;
    case BEYOND:
        return (float)(0.5 + 0.6 * sf_rng_normal(&c->rng));
    default:
        return (float)(0.5 + 0.3 * sin(0.3 * x) * cos(0.2 * y));
    }
}

static float other_value(check *c, enum content content, float value) {
    switch (content) {
    case SAME:
        return value;
    case FLAT:
        return check_pick(c, 2) ? value : 0.25f;
    case ALIKE:
        return (float)((double)value + 0.05 * sf_rng_normal(&c->rng));
    default:
        return (float)check_between(c, 0, 1);
    }
}

static float weight_at(check *c, enum weighting how, int x, int y) {
    if (how == FRACTIONS) return (float)check_between(c, 0, 1);
    if (how == REGION) return (float)fmin(fmax(0.2 * (x + 0.5 * y - 8), 0), 1);
    return 1;
}

/* What lies beside the picture is no number. */
static void make_planes(check *c, sf_loss_args *a) {
    size_t size = (size_t)a->height * a->stride;
    enum content content = (enum content)check_pick(c, CONTENTS);
    enum weighting how = (enum weighting)check_pick(c, WEIGHTINGS);
    /* with fractions for weights the products would be open to rounding: every sign of L1 on its cliff */
    if (how == FRACTIONS || how == REGION) content = content == SAME || content == FLAT ? ALIKE : content;
    float *x = check_floats_in(c, "x", size), *y = check_floats_in(c, "y", size);
    float *weight = how == NONE ? NULL : check_floats_in(c, "weight", size);
    for (size_t i = 0; i < size; i++) {
        int column = (int)(i % a->stride), row = (int)(i / a->stride);
        x[i] = y[i] = NAN;
        if (weight) weight[i] = NAN;
        if (column >= a->width) continue;
        float w = weight_at(c, how, column, row);
        x[i] = value_at(c, content, column, row);
        y[i] = other_value(c, content, x[i]) * w;
        if (weight) weight[i] = w;
    }
    a->x = x, a->y = y, a->weight = weight;
}

static void make_case(check *c, sf_loss_args *a) {
    size_t k = c->seed / 2;
    a->width = side(k % SIDES), a->height = side((7 * k + 3) % SIDES);
    a->stride = (size_t)(a->width + SF_TILE - 1) / SF_TILE * SF_TILE + SF_TILE * check_pick(c, 2);
    make_planes(c, a);
    enum mode mode = (enum mode)(k / SIDES % MODES);
    int with_ssim = mode != L1_GRADIENT && mode != L1_VALUE;
    double scale = 1.0 / (3.0 * a->width * a->height);
    a->delta = check_pick(c, 2) ? (float)exp2(check_between(c, -12, 0)) : 0;
    a->l1_scale = mode == SSIM_GRADIENT ? 0 : (float)(0.8 * scale);
    a->ssim_scale = mode == SSIM_BESIDE_L1 || !with_ssim ? 0 : (float)(-0.2 * scale);
    a->scratch = check_floats_out(c, "scratch", sf_loss_scratch(a->stride));
    a->l1 = check_output(c, "l1", (size_t)a->height, sizeof *a->l1, sizeof *a->l1);
    a->ssim = with_ssim ? check_output(c, "ssim", (size_t)a->height, sizeof *a->l1, sizeof *a->l1) : NULL;
    if (mode != VALUE && mode != L1_VALUE) a->d_x = check_floats_out(c, "d_x", (size_t)a->height * a->stride);
}

static void call_loss(const sf_kernels *kernels, void *args) { kernels->loss(args); }

static int run_band(check *c, const sf_loss_args *whole, int first, int end) {
    sf_loss_args a = *whole;
    a.first_row = first, a.end_row = end;
    a.l1 += first;
    if (a.ssim) a.ssim += first;
    return check_call(c, 0, call_loss, &a);
}

static void compare(check *c, const sf_loss_args *a, const test_ref_channel *want) {
    size_t width = (size_t)a->width, height = (size_t)a->height;
    for (size_t row = 0; row < height; row++) {
        check_near(c, "l1", row, a->l1[row], want->l1[row]);
        if (a->ssim) check_near(c, "ssim", row, a->ssim[row], want->ssim[row]);
        for (size_t x = 0; a->d_x && x < a->stride; x++) {
            double got = (double)a->d_x[row * a->stride + x];
            size_t i = row * width + x;
            if (x >= width)
                check_that(c, got == 0, "a gradient beside the picture", row);
            else if (want->cliff[i])
                check_cliffs(c, 1);
            else
                check_near(c, a->ssim_scale != 0.0f ? "d_x" : "d_x of L1", i, got, want->d_x[i]);
        }
    }
}

/* The results of the whole picture at once, to compare with. */
typedef struct results {
    double l1[MOST], ssim[MOST];
    float d_x[MOST * MOST];
} results;

static void keep(const sf_loss_args *a, results *r) {
    size_t rows = (size_t)a->height;
    memcpy(r->l1, a->l1, rows * sizeof *r->l1);
    if (a->ssim) memcpy(r->ssim, a->ssim, rows * sizeof *r->ssim);
    if (a->d_x) memcpy(r->d_x, a->d_x, rows * a->stride * sizeof *r->d_x);
}

static void check_same(check *c, const sf_loss_args *a, const results *r, int first, int end) {
    size_t from = (size_t)first, rows = (size_t)(end - first);
    int same = !memcmp(a->l1 + from, r->l1 + from, rows * sizeof *r->l1);
    if (a->ssim) same &= !memcmp(a->ssim + from, r->ssim + from, rows * sizeof *r->ssim);
    if (a->d_x)
        same &=
            !memcmp(a->d_x + from * a->stride, r->d_x + from * a->stride, rows * a->stride * sizeof *r->d_x);
    check_that(c, same, "a band is not as in the whole picture", from);
}

static void check_rest_untouched(check *c, const sf_loss_args *a, int first, int end) {
    for (int row = 0; row < a->height; row++) {
        if (row >= first && row < end) continue;
        int untouched = check_untouched(a->l1 + row, sizeof *a->l1);
        if (a->ssim) untouched &= check_untouched(a->ssim + row, sizeof *a->ssim);
        if (a->d_x)
            untouched &= check_untouched(a->d_x + (size_t)row * a->stride, a->stride * sizeof *a->d_x);
        check_that(c, untouched, "wrote into another band's row", (size_t)row);
    }
}

static void loss_case(check *c) {
    static results whole;
    sf_loss_args a = {0};
    test_ref_channel want;
    make_case(c, &a);
    test_ref_loss_channel(&a, &want);
    int longest = 1 + (int)check_pick(c, 30), first_cut = (int)check_pick(c, (size_t)a.height);
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (!run_band(c, &a, 0, a.height)) continue;
        compare(c, &a, &want);
        keep(&a, &whole);
        check_at(c, l);
        for (int first = first_cut, end; first < a.height; first = end) {
            end = first + longest < a.height ? first + longest : a.height;
            if (!run_band(c, &a, first, end)) break;
            check_same(c, &a, &whole, first, end);
            if (first == first_cut) check_rest_untouched(c, &a, first, end);
        }
    }
    free(want.l1);
    free(want.ssim);
    free(want.d_x);
    free(want.cliff);
}

static void loss_agrees_with_float64(void **state) {
    (void)state;
    static const check_kernel kernel = {"loss", SF_KERNEL_loss};
    check_kernels(&kernel, 1, 2 * SIDES * MODES * ROUNDS, loss_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(loss_agrees_with_float64)};
    return cmocka_run_group_tests_name("check loss", tests, NULL, NULL);
}
