/* test_adam.c - a step of Adam at every level against float64. */
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

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(adam_agrees_with_float64)};
    return cmocka_run_group_tests_name("check adam", tests, NULL, NULL);
}
