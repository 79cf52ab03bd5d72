/* test_bundle.c - bundle adjustment of poses, points and shared lenses, against equations and the truth. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/cholesky.h"
#include "base/context.h"
#include "base/linear.h"
#include "pose/bundle_equations.h"
#include "sfm_fixture.h"

enum { VIEWS = 8, POINTS = 40, MOST = VIEWS * POINTS, CAMERAS = 2, LENS = SF_LENS_PARAMETERS };

/* 1. Cholesky in tiles */

static double *positive(size_t n, uint64_t seed) {
    double *A = calloc(n * n, sizeof *A), *B = malloc(n * n * sizeof *B);
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    assert_true(A && B);
    for (size_t i = 0; i < n * n; i++) B[i] = sf_rng_normal(&rng);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j <= i; j++) {
            for (size_t k = 0; k < n; k++) A[i * n + j] += B[i * n + k] * B[j * n + k] / (double)n;
            A[i * n + j] += i == j;
        }
    free(B);
    return A;
}

static void factors_in_tiles(void **state) {
    (void)state;
    static const size_t sizes[] = {32, 64, 96, 160};
    sf_context *one = test_context_threads(1), *three = test_context_threads(3);
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        size_t n = sizes[s], bytes = n * n * sizeof(double);
        double *A = positive(n, s), *B = malloc(bytes), *C = malloc(bytes);
        double *panel = malloc(n * SF_CHOLESKY_TILE * sizeof *panel);
        assert_true(B && C && panel);
        memcpy(B, A, bytes), memcpy(C, A, bytes);
        assert_true(sf_cholesky((int)n, A));
        assert_true(sf_cholesky_tiled(one->pool, n, B, panel));
        assert_true(sf_cholesky_tiled(three->pool, n, C, panel));
        for (size_t i = 0; i < n; i++)
            for (size_t j = 0; j <= i; j++) {
                assert_float_equal(A[i * n + j], B[i * n + j], 1e-13);
                assert_true(B[i * n + j] == C[i * n + j]);
            }
        B[n * n - 1] = -1;
        assert_false(sf_cholesky_tiled(one->pool, n, B, panel));
        free(A), free(B), free(C), free(panel);
    }
    assert_int_equal(sf_cholesky_padded(1), 32);
    assert_int_equal(sf_cholesky_padded(32), 32);
    sf_context_destroy(&one);
    sf_context_destroy(&three);
}

/* 2. A scene with a truth: views of two cameras around points; the first two views stay where they are. */

typedef struct cloud {
    sf_bundle_view views[VIEWS], truth[VIEWS];
    sf_bundle_camera cameras[CAMERAS];
    sf_lens lenses[CAMERAS];
    sf_bundle_point points[POINTS];
    double at[POINTS][3];
    sf_bundle_observation observations[MOST];
    sf_bundle bundle;
} cloud;

static void observe(cloud *c, sf_rng *rng, double noise) {
    size_t n = 0;
    for (uint32_t i = 0; i < POINTS; i++)
        for (uint32_t v = 0; v < VIEWS; v++) {
            double p[3], pixel[2];
            if ((3 * i + 5 * v) % 7 == 0) continue;
            sf_rigid_apply(&c->truth[v].pose, c->at[i], p);
            assert_true(sf_lens_project(&c->truth[v].lens, p, pixel, NULL, NULL));
            c->observations[n++] = (sf_bundle_observation){v, i, pixel[0] + noise * sf_rng_normal(rng),
                                                           pixel[1] + noise * sf_rng_normal(rng)};
        }
    c->bundle.observation_count = n;
}

static void make_cloud(cloud *c, uint64_t seed, double noise, double off) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    memset(c, 0, sizeof *c);
    c->lenses[0] = (sf_lens){.fx = 700, .fy = 700, .cx = 320, .cy = 240, .k1 = -0.1, .k2 = 0.03};
    c->lenses[1] = (sf_lens){.fx = 900, .fy = 930, .cx = 330, .cy = 235, .k1 = 0.05, .p1 = 1e-3, .p2 = -2e-3};
    for (int i = 0; i < POINTS; i++)
        for (int k = 0; k < 3; k++) c->points[i].at[k] = c->at[i][k] = 2 * sf_rng_uniform(&rng) - 1;
    for (uint32_t v = 0; v < VIEWS; v++) {
        const double turn = 0.4 * v, far = 4 + 0.5 * sin(3 * v), target[3] = {0.1 * cos(5 * v), 0.05 * v, 0};
        const double center[3] = {far * sin(turn), 0.8 * cos(2 * v), -far * cos(turn)};
        sf_bundle_view *to = &c->truth[v];
        to->camera = v % 3 == 2, to->lens = c->lenses[to->camera], to->is_free = v > 1;
        sfm_look_at(center, target, &to->pose);
        c->views[v] = *to;
    }
    c->bundle = (sf_bundle){.views = c->views,
                            .view_count = VIEWS,
                            .points = c->points,
                            .point_count = POINTS,
                            .observations = c->observations,
                            .cameras = c->cameras,
                            .camera_count = CAMERAS,
                            .enough = 1e-12};
    observe(c, &rng, noise);
    c->cameras[0] = (sf_bundle_camera){.lens = c->lenses[0], .focal = 1, .radial = 2};
    c->cameras[1] =
        (sf_bundle_camera){.lens = c->lenses[1], .focal = 2, .center = 1, .radial = 1, .tangential = 1};
    for (int i = 0; i < POINTS; i++)
        for (int k = 0; k < 3; k++) c->points[i].at[k] += off * sf_rng_normal(&rng);
    for (int v = 2; v < VIEWS; v++) {
        double twist[6];
        for (int k = 0; k < 6; k++) twist[k] = 0.3 * off * sf_rng_normal(&rng);
        sf_rigid_move(&c->views[v].pose, twist);
    }
    for (int i = 0; i < CAMERAS; i++) {
        c->cameras[i].lens.fx *= 1 + off, c->cameras[i].lens.fy *= 1 + off;
        c->cameras[i].lens.k1 += off, c->cameras[i].lens.cx += 50 * off * i;
    }
}

/* 3. The step against the whole equations, of central differences */

enum { FREE_VIEWS = VIEWS - 2, SHARED = 3 + 7, UNKNOWNS = 6 * FREE_VIEWS + SHARED + 3 * POINTS };

/* Which parameters of which camera the columns are; -1: fx and fy by one factor. */
static const int column_camera[SHARED] = {0, 0, 0, 1, 1, 1, 1, 1, 1, 1};
static const int column_which[SHARED] = {-1, 4, 5, 0, 1, 2, 3, 4, 6, 7};

/* Moves unknown `k` by h. */
static void nudge(cloud *c, int k, double h) {
    if (k < 6 * FREE_VIEWS) {
        double twist[6] = {0};
        twist[k % 6] = h;
        sf_rigid_move(&c->views[2 + k / 6].pose, twist);
    } else if (k < 6 * FREE_VIEWS + SHARED) {
        int at = k - 6 * FREE_VIEWS, which = column_which[at];
        for (int v = 0; v < VIEWS; v++) {
            sf_lens *lens = &c->views[v].lens;
            if ((int)c->views[v].camera != column_camera[at]) continue;
            if (which < 0) lens->fy += h * lens->fy / lens->fx, lens->fx += h;
            if (which >= 0) *sf_bundle_parameter(lens, which) += h;
        }
    } else {
        int at = k - 6 * FREE_VIEWS - SHARED;
        c->points[at / 3].at[at % 3] += h;
    }
}

static void residuals(const cloud *c, double *r) {
    for (size_t i = 0; i < c->bundle.observation_count; i++) {
        const sf_bundle_observation *s = &c->observations[i];
        double p[3], pixel[2];
        sf_rigid_apply(&c->views[s->view].pose, c->points[s->point].at, p);
        assert_true(sf_bundle_pixel(&c->views[s->view], p, pixel));
        r[2 * i] = pixel[0] - s->u, r[2 * i + 1] = pixel[1] - s->v;
    }
}

typedef struct whole {
    double N[UNKNOWNS * UNKNOWNS], g[UNKNOWNS], J[UNKNOWNS][2 * MOST];
} whole;

/* sum w J^T J and sum w J^T r, with Cauchy's weights of this spread (0: all 1). */
static void make_whole(const cloud *from, double spread, whole *w) {
    static cloud c;
    static double here[2 * MOST], more[2 * MOST], less[2 * MOST];
    size_t n = 2 * from->bundle.observation_count;
    memset(w, 0, sizeof *w);
    residuals(from, here);
    for (int k = 0; k < UNKNOWNS; k++) {
        const double h = k >= 6 * FREE_VIEWS && k < 6 * FREE_VIEWS + SHARED ? 1e-5 : 1e-6;
        c = *from, nudge(&c, k, h), residuals(&c, more);
        c = *from, nudge(&c, k, -h), residuals(&c, less);
        for (size_t i = 0; i < n; i++) w->J[k][i] = (more[i] - less[i]) / (2 * h);
    }
    for (size_t i = 0; i < n; i++) {
        double r2 = pow(here[i / 2 * 2], 2) + pow(here[i / 2 * 2 + 1], 2), c2 = pow(SF_CAUCHY * spread, 2);
        double weight = spread > 0 ? c2 / (c2 + r2) / (spread * spread) : 1;
        for (int k = 0; k < UNKNOWNS; k++) {
            w->g[k] += weight * w->J[k][i] * here[i];
            for (int l = 0; l <= k; l++) w->N[UNKNOWNS * k + l] += weight * w->J[k][i] * w->J[l][i];
        }
    }
}

static void steps_solve_the_whole_equations(void **state) {
    (void)state;
    static cloud c;
    static whole w;
    sf_context *ctx = test_context();
    const double damp = 1e-3;
    for (int how = 0; how < 2; how++) { /* by factors, by conjugate gradients */
        make_cloud(&c, 1, 0.5, 0.02);
        for (int v = 0; v < VIEWS; v++) c.views[v].lens = c.cameras[c.views[v].camera].lens;
        c.bundle.dense_most = how ? 1 : 0;
        sf_bundle_work a = {.ctx = ctx, .b = &c.bundle, .spread = 1.5, .damp = damp};
        assert_true(sf_bundle_work_make(&a));
        assert_int_equal(a.eq.lens_columns, SHARED);
        assert_int_equal(a.eq.dense != NULL, !how);
        sf_bundle_equations_fill(&a);
        assert_true(sf_bundle_equations_solve(ctx, &a.eq));
        make_whole(&c, a.spread, &w);
        for (int k = 0; k < UNKNOWNS; k++) w.N[(UNKNOWNS + 1) * k] *= 1 + damp;
        assert_true(sf_cholesky(UNKNOWNS, w.N));
        sf_cholesky_solve(UNKNOWNS, w.N, w.g);
        for (int k = 0; k < 6 * FREE_VIEWS + SHARED; k++)
            assert_float_equal(a.eq.g[k], -w.g[k], (how ? 0.1 : 1e-5) * (fabs(w.g[k]) + 1e-3));
        sf_bundle_work_free(&a);
    }
    sf_context_destroy(&ctx);
}

/* 4. Results */

static double off_truth(const cloud *c) {
    double off = 0;
    for (int v = 0; v < VIEWS; v++) {
        double twist[6];
        sf_rigid_twist(&c->truth[v].pose, &c->views[v].pose, twist);
        for (int k = 0; k < 6; k++) off = fmax(off, fabs(twist[k]));
    }
    for (int i = 0; i < POINTS; i++)
        for (int k = 0; k < 3; k++) off = fmax(off, fabs(c->points[i].at[k] - c->at[i][k]));
    for (int i = 0; i < CAMERAS; i++) {
        sf_lens found = c->cameras[i].lens, truth = c->lenses[i];
        for (int k = 0; k < LENS; k++)
            off = fmax(off, fabs(*sf_bundle_parameter(&found, k) - *sf_bundle_parameter(&truth, k)) /
                                (k < 4 ? 100 : 1));
    }
    return off;
}

static void truth_without_noise(void **state) {
    (void)state;
    static cloud c;
    sf_context *ctx = test_context();
    double spread;
    for (int how = 0; how < 2; how++) {
        make_cloud(&c, 2, 0, 0.03);
        c.bundle.dense_most = how ? 1 : 0;
        assert_true(off_truth(&c) > 0.02);
        assert_ok(ctx, sf_bundle_adjust(ctx, &c.bundle, 60, &spread));
        print_message("%s: %.1e from the truth\n", how ? "conjugate gradients" : "factors", off_truth(&c));
        assert_true(off_truth(&c) < 1e-9);
        for (int v = 0; v < VIEWS; v++)
            assert_memory_equal(&c.views[v].lens, &c.cameras[c.views[v].camera].lens, sizeof(sf_lens));
    }
    sf_context_destroy(&ctx);
}

/* Errors of focal lengths and poses are those that the equations foretell: the mean of the squared errors
 * over their variances is 1 / 0.95, what Cauchy's weights cost. */
static void errors_are_as_large_as_they_should_be(void **state) {
    (void)state;
    static cloud c;
    static whole w;
    enum { SEEDS = 40 };
    sf_context *ctx = test_context();
    double spread, normalized = 0, freedom = 0, squares = 0, noise = 0.5, variance[6 * FREE_VIEWS + SHARED];
    static double r[2 * MOST], column[UNKNOWNS];
    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        make_cloud(&c, 3, noise, 0);
        sf_rng rng;
        sf_rng_seed(&rng, 100 + seed);
        observe(&c, &rng, noise);
        if (!seed) {
            make_whole(&c, 0, &w);
            assert_true(sf_cholesky(UNKNOWNS, w.N));
            for (int k = 0; k < 6 * FREE_VIEWS + SHARED; k++) {
                memset(column, 0, sizeof column);
                column[k] = 1;
                sf_cholesky_solve(UNKNOWNS, w.N, column);
                variance[k] = column[k] * noise * noise;
            }
        }
        assert_ok(ctx, sf_bundle_adjust(ctx, &c.bundle, 40, &spread));
        /* The median of residuals of which 166 in 548 are free is below sqrt(1 - 166 / 548) = 0.83. */
        assert_true(spread / noise > 0.55 && spread / noise < 0.9);
        double twist[6];
        sf_rigid_twist(&c.truth[2 + seed % FREE_VIEWS].pose, &c.views[2 + seed % FREE_VIEWS].pose, twist);
        for (int k = 0; k < 6; k++)
            normalized += twist[k] * twist[k] / variance[6 * (seed % FREE_VIEWS) + (size_t)k] / 7 / SEEDS;
        normalized += pow(c.cameras[0].lens.fx - c.lenses[0].fx, 2) / variance[6 * FREE_VIEWS] / 7 / SEEDS;
        residuals(&c, r);
        for (size_t i = 0; i < 2 * c.bundle.observation_count; i++) squares += r[i] * r[i];
        freedom += 2 * (double)c.bundle.observation_count - UNKNOWNS;
    }
    print_message("squared errors over their variances %.2f; noise %.3f of %.1f px\n", normalized,
                  sqrt(squares / freedom), noise);
    assert_true(fabs(normalized - 1 / 0.95) < 0.3); /* 280 values of a few degrees of freedom each */
    assert_true(fabs(sqrt(squares / freedom) / noise - 1) < 0.03);
    sf_context_destroy(&ctx);
}

static void threads_do_not_matter(void **state) {
    (void)state;
    static cloud c, first;
    static const int threads[] = {1, 2, 5};
    double spread;
    for (size_t i = 0; i < sizeof threads / sizeof *threads; i++)
        for (int how = 0; how < 2; how++) {
            static cloud kept[2];
            sf_context *ctx = test_context_threads(threads[i]);
            make_cloud(&c, 4, 0.5, 0.02);
            c.bundle.dense_most = how ? 1 : 0;
            assert_ok(ctx, sf_bundle_adjust(ctx, &c.bundle, 6, &spread));
            if (!i) kept[how] = c;
            first = kept[how];
            assert_memory_equal(first.views, c.views, sizeof c.views);
            assert_memory_equal(first.cameras, c.cameras, sizeof c.cameras);
            assert_memory_equal(first.points, c.points, sizeof c.points);
            sf_context_destroy(&ctx);
        }
}

/* A prior holds a focal length to its value; without memory nothing moves. */
static void priors_and_memory(void **state) {
    (void)state;
    static cloud c, before;
    sf_context *ctx = test_context();
    double spread;
    make_cloud(&c, 5, 0.5, 0.01);
    c.cameras[0].prior[0] = 720, c.cameras[0].information[0] = 1e6;
    assert_ok(ctx, sf_bundle_adjust(ctx, &c.bundle, 40, &spread));
    assert_true(fabs(c.cameras[0].lens.fx - 720) < 0.1);
    assert_float_equal(c.cameras[0].lens.fy, c.cameras[0].lens.fx, 1e-9);
    sf_context_destroy(&ctx);
    for (long fail_at = 1;; fail_at++) {
        test_allocations memory = {0};
        const sf_allocator allocator = {test_count_alloc, test_count_free, &memory};
        assert_int_equal(
            sf_context_create(&ctx, &(sf_context_options){.allocator = &allocator, .threads = 1}), SF_OK);
        make_cloud(&c, 5, 0.5, 0.01);
        before = c;
        long live = memory.live;
        memory.fail_at = memory.calls + fail_at;
        sf_status status = sf_bundle_adjust(ctx, &c.bundle, 2, &spread);
        assert_int_equal(memory.live, live);
        sf_context_destroy(&ctx);
        if (!status) break;
        assert_int_equal(status, SF_ERR_MEMORY);
        assert_memory_equal(before.views, c.views, sizeof c.views);
        assert_true(fail_at < 100);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(factors_in_tiles),      cmocka_unit_test(steps_solve_the_whole_equations),
        cmocka_unit_test(truth_without_noise),   cmocka_unit_test(errors_are_as_large_as_they_should_be),
        cmocka_unit_test(threads_do_not_matter), cmocka_unit_test(priors_and_memory),
    };
    return cmocka_run_group_tests_name("bundle", tests, NULL, NULL);
}
