/* test_adam.c - a step of Adam, with either form of its moments, and of RMSProp, at every level against
 * float64. */
#include "check.h"

#include <string.h>

static const sf_adam steps[] = {
    {0.01f / (1 - 0.9f), 0.9f, 0.999f, 1 / (1 - 0.999f), 1e-15f}, /* the first */
    {0.01f, 0.9f, 0.999f, 1, 1e-15f},                             /* a late one */
    {1e-5f, 0, 0, 1, 1e-8f},
    {3, 0.9999f, 0.999999f, 1e6f, 1e-15f},
    {1e-3f, 0.9f, 0.999f, 1, 1}, /* epsilon is what counts */
};
enum { STEPS = sizeof steps / sizeof *steps, MOST = 4096 };

/* Multiples of SF_LANES; 0 once. */
static const size_t lengths[] = {0, 16, 32, 48, 64, 80, 112, 240, 256, 272, 496, 1024, MOST};
enum { LENGTHS = sizeof lengths / sizeof *lengths };

typedef struct parameters {
    float *p, *g, *m, *v;
    size_t n;
    const sf_adam *step;
} parameters;

static float any(check *c) {
    static const float special[] = {0, -0.0f, 1e-40f, -1e-40f, 1e-30f, FLT_MIN, 1};
    if (check_pick(c, 20) == 0) return special[check_pick(c, sizeof special / sizeof *special)];
    double value = check_magnitude(c, 1e-12, 1e4);
    return (float)(check_pick(c, 2) ? value : -value);
}

static void call_adam(const sf_kernels *kernels, void *args) {
    parameters *a = args;
    kernels->adam(a->p, a->g, a->m, a->v, a->n, a->step);
}

/* Algorithm 1; 1 - beta is rounded before it is multiplied in. */
static void compare(check *c, const parameters *a, const parameters *before, size_t i) {
    bounded one = b_of(1), beta1 = b_of((double)a->step->beta1), beta2 = b_of((double)a->step->beta2);
    bounded g = b_of((double)before->g[i]), rate = b_of((double)a->step->rate);
    bounded m = b_fma(beta1, b_of((double)before->m[i]), b_mul(b_sub(one, beta1), g));
    bounded v = b_fma(beta2, b_of((double)before->v[i]), b_mul(b_sub(one, beta2), b_square(g)));
    bounded root = b_sqrt(b_scale((double)a->step->v_scale, v));
    bounded step = b_div(b_mul(rate, m), b_add(root, b_of((double)a->step->epsilon)));
    check_near(c, "m", i, (double)a->m[i], m);
    check_near(c, "v", i, (double)a->v[i], v);
    check_near(c, "p", i, (double)a->p[i], b_sub(b_of((double)before->p[i]), step));
}

static void adam_case(check *c) {
    size_t n = lengths[c->seed / 2 % LENGTHS], size = n * sizeof(float);
    parameters a = {check_floats_out(c, "p", n),
                    check_floats_in(c, "g", n),
                    check_floats_out(c, "m", n),
                    check_floats_out(c, "v", n),
                    n,
                    &steps[c->seed / 2 / LENGTHS % STEPS]};
    parameters before = {check_floats_in(c, "p before", n), a.g, check_floats_in(c, "m before", n),
                         check_floats_in(c, "v before", n), n,   a.step};
    for (size_t i = 0; i < n; i++) {
        before.p[i] = any(c);
        a.g[i] = any(c);
        before.m[i] = any(c);
        before.v[i] = fabsf(any(c));
    }
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        memcpy(a.p, before.p, size);
        memcpy(a.m, before.m, size);
        memcpy(a.v, before.v, size);
        if (!check_call(c, 0, call_adam, &a)) continue;
        for (size_t i = 0; i < n; i++) compare(c, &a, &before, i);
    }
}

static void adam_agrees_with_float64(void **state) {
    (void)state;
    static const check_kernel kernel = {"adam", SF_KERNEL_adam};
    check_kernels(&kernel, 1, 2 * LENGTHS * STEPS, adam_case);
}

/* ---- adam_half: the same step, its moments rounded by chance into words ---------------------------------
 */

typedef struct words {
    float *p, *g;
    uint32_t *moments;
    size_t n, cut; /* made in two calls, where 0 < cut < n */
    const sf_adam *step;
    uint32_t number;
} words;

static void call_adam_half(const sf_kernels *kernels, void *args) {
    words *a = args;
    if (a->cut) kernels->adam_half(a->p, a->g, a->moments, a->cut, a->step, a->number);
    kernels->adam_half(a->p + a->cut, a->g + a->cut, a->moments + a->cut, a->n - a->cut, a->step,
                       a->number + (uint32_t)a->cut);
}

/* What is left of x above `dropped` bits when `chance` was added to them, counted from 0 upward, and
 * downward below it. */
static int64_t rounded(double x, int dropped, uint32_t chance) {
    int64_t size = (sf_bits_of(fabsf((float)x)) + (int64_t)chance) >> dropped;
    return x < 0 ? -size : size;
}

/* The contract's, in 64 bits. */
static uint32_t noise_of(uint32_t number) {
    return (uint32_t)((uint64_t)number * 0x9e3779b9u % 0x100000000u);
}

/* `got` lies between what the ends of the bound of `want` are rounded to: nearly always one number. */
static void check_rounded(check *c, const char *what, size_t i, int64_t got, bounded want, int dropped,
                          uint32_t chance) {
    double by = CHECK_SLACK * want.e + FLOAT_UNIT * fabs(want.v);
    int64_t least = rounded(want.v - by, dropped, chance), most = rounded(want.v + by, dropped, chance);
    check_that(c, least <= got && got <= most, what, i);
    check_cliffs(c, least != most);
}

static void compare_half(check *c, const words *a, const words *before, size_t i) {
    const double limit = (double)SF_MOMENT_MOST;
    uint32_t was = before->moments[i], is = a->moments[i], noise = noise_of(a->number + (uint32_t)i);
    bounded one = b_of(1), beta1 = b_of((double)a->step->beta1), beta2 = b_of((double)a->step->beta2);
    bounded g = b_of(fmin(fmax((double)before->g[i], -limit), limit)), rate = b_of((double)a->step->rate);
    bounded m0 = b_of((double)sf_float_of(was & 0xffff0000u)),
            v0 = b_of((double)sf_float_of((was & 0xffffu) << 15));
    bounded m = b_fma(beta1, m0, b_mul(b_sub(one, beta1), g));
    bounded v = b_fma(beta2, v0, b_mul(b_sub(one, beta2), b_square(g)));
    bounded root = b_sqrt(b_scale((double)a->step->v_scale, v));
    bounded step = b_div(b_mul(rate, m), b_add(root, b_of((double)a->step->epsilon)));
    check_near(c, "p", i, (double)a->p[i], b_sub(b_of((double)before->p[i]), step));
    int64_t size = is >> 16 & 0x7fff;
    check_rounded(c, "m", i, is >> 31 ? -size : size, m, 16, noise >> 16);
    check_rounded(c, "v", i, is & 0xffff, v, 15, noise >> 17);
}

static void adam_half_case(check *c) {
    static const float huge[] = {1e14f, -1e14f, 1e16f, -1e30f, FLT_MAX, -FLT_MAX};
    size_t n = lengths[c->seed / 2 % LENGTHS];
    words a = {.p = check_floats_out(c, "p", n),
               .g = check_floats_in(c, "g", n),
               .moments = check_output(c, "moments", n, sizeof *a.moments, 64),
               .n = n,
               .cut = n ? check_pick(c, n / SF_LANES) * SF_LANES : 0,
               .step = &steps[c->seed / 2 / LENGTHS % STEPS],
               .number = (uint32_t)sf_rng_next(&c->rng)};
    words before = a;
    before.p = check_floats_in(c, "p before", n);
    before.moments = check_input(c, "moments before", n, sizeof *a.moments, 64);
    for (size_t i = 0; i < n; i++) {
        float m = any(c), v = fabsf(any(c));
        if (fabsf(m) < FLT_MIN) m = 0;
        if (v < FLT_MIN) v = 0;
        before.p[i] = any(c);
        a.g[i] = check_pick(c, 40) ? any(c) : huge[check_pick(c, sizeof huge / sizeof *huge)];
        before.moments[i] = (sf_bits_of(m) & 0xffff0000u) | sf_bits_of(v) >> 15;
    }
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        memcpy(a.p, before.p, n * sizeof *a.p);
        memcpy(a.moments, before.moments, n * sizeof *a.moments);
        if (!check_call(c, 0, call_adam_half, &a)) continue;
        for (size_t i = 0; i < n; i++) compare_half(c, &a, &before, i);
    }
}

static void adam_half_agrees_with_float64(void **state) {
    (void)state;
    static const check_kernel kernel = {"adam_half", SF_KERNEL_adam_half};
    check_kernels(&kernel, 1, 2 * LENGTHS * STEPS, adam_half_case);
}

/* ---- rmsprop: one second moment for three channels, no first one ----------------------------------------
 */

static void call_rmsprop(const sf_kernels *kernels, void *args) {
    parameters *a = args;
    kernels->rmsprop(a->p, a->g, a->v, a->n, a->step);
}

static void compare_rmsprop(check *c, const parameters *a, const parameters *before, size_t i) {
    bounded beta2 = b_of((double)a->step->beta2), rate = b_of((double)a->step->rate), sum = b_of(0);
    double exact = 0;
    for (int ch = 0; ch < 3; ch++) {
        double g = (double)before->g[sf_at(i, 3, ch)];
        sum = b_add(sum, b_square(b_of(g)));
        exact += g * g;
    }
    bounded square = b_scale((double)(1.0f / 3), sum), old = b_of((double)before->v[i]);
    bounded v = b_fma(beta2, old, b_mul(b_sub(b_of(1), beta2), square));
    if (exact == 0) {
        check_that(c, a->v[i] == before->v[i], "v stays", i);
        v = old;
    } else if (exact < 1e-36) { /* the square of a float may be 0 */
        v = b_of((double)a->v[i]);
    }
    check_near(c, "v", i, (double)a->v[i], v);
    bounded root = b_sqrt(b_scale((double)a->step->v_scale, v));
    bounded along = b_div(rate, b_add(root, b_of((double)a->step->epsilon)));
    for (int ch = 0; ch < 3; ch++) {
        size_t k = sf_at(i, 3, ch);
        bounded step = b_mul(along, b_of((double)before->g[k]));
        check_near(c, "p", k, (double)a->p[k], b_sub(b_of((double)before->p[k]), step));
    }
}

static void rmsprop_case(check *c) {
    size_t n = lengths[c->seed / 2 % LENGTHS];
    parameters a = {.p = check_floats_out(c, "p", 3 * n),
                    .g = check_floats_in(c, "g", 3 * n),
                    .v = check_floats_out(c, "v", n),
                    .n = n,
                    .step = &steps[c->seed / 2 / LENGTHS % STEPS]};
    parameters before = a;
    before.p = check_floats_in(c, "p before", 3 * n);
    before.v = check_floats_in(c, "v before", n);
    for (size_t i = 0; i < n; i++) {
        int unseen = check_pick(c, 5) == 0;
        before.v[i] = fabsf(any(c));
        for (int ch = 0; ch < 3; ch++) {
            before.p[sf_at(i, 3, ch)] = any(c);
            a.g[sf_at(i, 3, ch)] = unseen ? 0 : any(c);
        }
    }
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        memcpy(a.p, before.p, 3 * n * sizeof *a.p);
        memcpy(a.v, before.v, n * sizeof *a.v);
        if (!check_call(c, 0, call_rmsprop, &a)) continue;
        for (size_t i = 0; i < n; i++) compare_rmsprop(c, &a, &before, i);
    }
}

static void rmsprop_agrees_with_float64(void **state) {
    (void)state;
    static const check_kernel kernel = {"rmsprop", SF_KERNEL_rmsprop};
    check_kernels(&kernel, 1, 2 * LENGTHS * STEPS, rmsprop_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(adam_agrees_with_float64),
                                       cmocka_unit_test(rmsprop_agrees_with_float64),
                                       cmocka_unit_test(adam_half_agrees_with_float64)};
    return cmocka_run_group_tests_name("check adam", tests, NULL, NULL);
}
