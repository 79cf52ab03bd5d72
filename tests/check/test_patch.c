/* test_patch.c - gradients about points, by direction and by place and direction, at every level: the floats
 * of arch/scalar, near those of float64. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "../../arch/scalar/patch.h"
#include "../../arch/scalar/scalar.h"

enum { ORIENT, DESCRIBE, KERNELS };

static const int sizes[][2] = {{2, 2}, {3, 7}, {16, 16}, {17, 40}, {61, 33}, {200, 90}};
enum { SIZES = sizeof sizes / sizeof *sizes };

/* What pixels are: any of 0..1; one value; a slope along one of 16 directions, on whose borders gradients
 * lie. */
enum content { ANY, FLAT, SLOPE, CONTENTS };

typedef struct points {
    sf_patch_args args;
    double range; /* the greatest difference of two pixels */
    int exact;    /* places of samples have no error */
} points;

/* A multiple of 1/64: sums of few of them, and halves of them, are exact. */
static float snapped(double x) { return (float)(floor(x * 64) / 64); }

static void make_pixels(check *c, points *p, enum content content) {
    sf_patch_args *a = &p->args;
    double angle = (double)check_pick(c, 16) * 3.14159265358979 / 8, least = 1e9, most = -1e9;
    a->stride = (size_t)a->width + check_pick(c, 20);
    size_t count = a->stride * (size_t)(a->height - 1) + (size_t)a->width;
    float *pixels = check_floats_in(c, "pixels", count);
    for (size_t i = 0; i < count; i++) {
        double x = (double)(i % a->stride), y = (double)(i / a->stride);
        double value = content == ANY    ? check_between(c, 0, 1)
                       : content == FLAT ? 0.7
                                         : (x * cos(angle) + y * sin(angle)) / 64;
        pixels[i] = (float)value;
        least = fmin(least, value), most = fmax(most, value);
    }
    a->pixels = pixels;
    p->range = most - least;
}

static void make_points(check *c, points *p) {
    uint64_t kind = c->seed / 2;
    *p = (points){.args = {.width = sizes[kind % SIZES][0],
                           .height = sizes[kind % SIZES][1],
                           .count = 1 + kind / SIZES % SF_LANES}};
    make_pixels(c, p, (enum content)check_pick(c, CONTENTS));
    p->exact = (int)check_pick(c, 2);
    for (size_t lane = 0; lane < SF_LANES; lane++) {
        double step = check_between(c, 0.5, 3.7), angle = check_between(c, 0, 6.283);
        double x = check_between(c, 0, p->args.width - 1), y = check_between(c, 0, p->args.height - 1);
        if (check_pick(c, 3) == 0) angle = 0;
        p->args.x[lane] = p->exact ? snapped(x) : (float)x;
        p->args.y[lane] = p->exact ? snapped(y) : (float)y;
        p->args.a[lane] = p->exact ? snapped(step * cos(angle)) : (float)(step * cos(angle));
        p->args.b[lane] = p->exact ? snapped(step * sin(angle)) : (float)(step * sin(angle));
    }
    p->args.out = check_floats_out(c, "out", SF_DESCRIPTOR * SF_LANES); /* orient leaves the last ones */
}

/* ---- in float64 -----------------------------------------------------------------------------------------
 */

static double clamped(double x, double last) { return x < 0 ? 0 : x > last ? last : x; }

static double sample(const sf_patch_args *a, size_t lane, int i, int j) {
    double u = i - 7.5, v = j - 7.5, across = (double)a->b[lane], along = (double)a->a[lane];
    double x = clamped((double)a->x[lane] + u * along - v * across, a->width - 1);
    double y = clamped((double)a->y[lane] + u * across + v * along, a->height - 1);
    double column = clamped(floor(x), a->width - 2), line = clamped(floor(y), a->height - 2);
    const float *p = a->pixels + (size_t)line * a->stride + (size_t)column, *q = p + a->stride;
    double above = (1 - (x - column)) * (double)p[0] + (x - column) * (double)p[1];
    double below = (1 - (x - column)) * (double)q[0] + (x - column) * (double)q[1];
    return (1 - (y - line)) * above + (y - line) * below;
}

static void gradient(const sf_patch_args *a, size_t lane, int i, int j, double g[2]) {
    double s[2][2];
    for (int k = 0; k < 4; k++) s[k / 2][k % 2] = sample(a, lane, i + k % 2, j + k / 2);
    g[0] = s[0][1] + s[1][1] - s[0][0] - s[1][0];
    g[1] = s[1][0] + s[1][1] - s[0][0] - s[0][1];
}

/* Parts along the two nearest of n directions, so that they sum up to the gradient. */
static void split(const double g[2], int n, double *parts) {
    double d = 2 * 3.14159265358979323846 / n, size = hypot(g[0], g[1]), angle = atan2(g[1], g[0]) / d;
    int k = (int)floor(angle);
    double f = (angle - k) * d;
    memset(parts, 0, (size_t)n * sizeof *parts);
    parts[(k + n) % n] += size * sin(d - f) / sin(d);
    parts[(k + 1 + n) % n] += size * sin(f) / sin(d);
}

static double share_of(int at, int cell) {
    double place = at - 7, middle = -4.5 + 3 * cell, share = 1 - fabs(place - middle) / 3;
    return share > 0 ? share * exp(-place * place / 72) : 0;
}

static double near_middle(int at) { return exp(-0.08 * (at - 7) * (at - 7)); }

/* How far a gradient may be off: a sample's place by the roundings of its coordinates, which moves its value
 * by so many times the range of the pixels, and the roundings of values. */
static double gradient_error(const points *p, size_t lane) {
    const sf_patch_args *a = &p->args;
    double reach = 15 * (fabs((double)a->a[lane]) + fabs((double)a->b[lane])), place = 0;
    if (!p->exact) place = 6 * FLOAT_UNIT * (fabs((double)a->x[lane]) + fabs((double)a->y[lane]) + reach);
    return 4 * (2 * place * p->range + 8 * FLOAT_UNIT * (p->range + 1)) + 8 * FLOAT_UNIT * p->range;
}

/* A sum, and how far it may be off. */
typedef struct sums {
    bounded orient[SF_ORIENTATIONS], describe[SF_DESCRIPTOR];
} sums;

/* Adds the parts, times a weight. Each is off by up to `error` where it, or a neighbour, is not 0, and its
 * product and the sum are rounded. */
static void add_parts(bounded *to, const double *parts, int n, double weight, double error) {
    for (int k = 0; k < n; k++) {
        double near = parts[k] + parts[(k + 1) % n] + parts[(k + n - 1) % n];
        to[k].v += weight * parts[k];
        if (near > 0) to[k].e += weight * (error + 6 * FLOAT_UNIT * near) + FLOAT_UNIT * to[k].v;
    }
}

/* Factors: the greatest that a gradient's error has on a part, which is a difference of products by the sines
 * and cosines of patch.h, or of the gradient's sides. */
static void sum_up(const points *p, size_t lane, sums *s) {
    double g[2], parts[SF_ORIENTATIONS], error = gradient_error(p, lane);
    memset(s, 0, sizeof *s);
    for (int n = 0; n < SF_GRADIENTS * SF_GRADIENTS; n++) {
        int i = n % SF_GRADIENTS, j = n / SF_GRADIENTS;
        gradient(&p->args, lane, i, j, g);
        split(g, SF_ORIENTATIONS, parts);
        double rounded = 24 * FLOAT_UNIT * hypot(g[0], g[1]);
        add_parts(s->orient, parts, SF_ORIENTATIONS, near_middle(i) * near_middle(j), 8.8 * error + rounded);
        split(g, SF_DIRECTIONS, parts);
        for (int cell = 0; cell < SF_CELLS * SF_CELLS; cell++) {
            double share = share_of(j, cell / SF_CELLS) * share_of(i, cell % SF_CELLS);
            add_parts(s->describe + cell * SF_DIRECTIONS, parts, SF_DIRECTIONS, share, 2 * error + rounded);
        }
    }
}

static void check_lane(check *c, const points *p, size_t lane) {
    sums s;
    sum_up(p, lane, &s);
    for (int k = 0; k < (c->kernel == ORIENT ? SF_ORIENTATIONS : SF_DESCRIPTOR); k++) {
        double got = (double)p->args.out[(size_t)k * SF_LANES + lane];
        if (c->kernel == ORIENT)
            check_near(c, "orient", (size_t)k, got, s.orient[k]);
        else
            check_near(c, "describe", (size_t)k, got, s.describe[k]);
    }
}

static void call_orient(const sf_kernels *kernels, void *args) { kernels->orient(&((points *)args)->args); }

static void call_describe(const sf_kernels *kernels, void *args) {
    kernels->describe(&((points *)args)->args);
}

static void patch_case(check *c) {
    points p;
    float *specified[KERNELS];
    make_points(c, &p);
    for (int k = 0; k < KERNELS; k++) {
        sf_patch_args scalar = p.args;
        assert_non_null(scalar.out = specified[k] = calloc(SF_DESCRIPTOR * SF_LANES, sizeof(float)));
        (k == ORIENT ? sf_orient_scalar : sf_describe_scalar)(&scalar);
    }
    for (size_t l = 0; l < c->level_count; l++)
        for (size_t k = 0; k < KERNELS; k++) {
            size_t count = k == ORIENT ? SF_ORIENTATIONS : SF_DESCRIPTOR;
            check_at(c, l);
            if (!check_call(c, k, k == ORIENT ? call_orient : call_describe, &p)) continue;
            for (size_t lane = 0; lane < p.args.count; lane++) {
                if (lane % 5 == 0) check_lane(c, &p, lane);
                for (size_t n = 0; n < count; n++)
                    check_that(c, p.args.out[n * SF_LANES + lane] == specified[k][n * SF_LANES + lane],
                               "not what arch/scalar has", n);
            }
        }
    for (int k = 0; k < KERNELS; k++) free(specified[k]);
}

static void levels_agree_and_are_right(void **state) {
    (void)state;
    static const check_kernel kernels[KERNELS] = {{"orient", SF_KERNEL_orient},
                                                  {"describe", SF_KERNEL_describe}};
    check_kernels(kernels, KERNELS, (size_t)(2 * SIZES * SF_LANES), patch_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(levels_agree_and_are_right)};
    return cmocka_run_group_tests_name("check patch", tests, NULL, NULL);
}
