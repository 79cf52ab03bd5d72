/* test_transform.c - models turned, scaled, moved, cut: a camera that moves along sees what it saw. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/base/linear.h"
#include "../../src/base/rng.h"
#include "../../src/kernels/sh.h"

enum { COUNT = 60, SH = 16, WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT };

typedef struct values {
    float means[3 * COUNT], quats[4 * COUNT], log_scales[3 * COUNT], logits[COUNT], sh[3 * SH * COUNT];
} values;

static sf_gaussians arrays(values *v) {
    return (sf_gaussians){v->means, v->quats, v->log_scales, v->logits, v->sh};
}

static void fill(float *to, size_t n, double middle, double spread, sf_rng *rng) {
    for (size_t i = 0; i < n; i++) to[i] = (float)(middle + spread * sf_rng_normal(rng));
}

/* Long ones, strongly coloured by direction; packed: of all degrees. */
static sf_model *make_model(sf_context *ctx, int packed) {
    static values v;
    sf_model *model;
    sf_rng rng;
    sf_rng_seed(&rng, 11);
    fill(v.means, 3 * COUNT, 0, 0.5, &rng);
    fill(v.quats, 4 * COUNT, 0, 1, &rng);
    fill(v.log_scales, 3 * COUNT, -2, 0.6, &rng);
    fill(v.logits, COUNT, 0.5, 1, &rng);
    fill(v.sh, 3 * SH * COUNT, 0, 0.3, &rng);
    for (size_t i = 0; i < COUNT && packed; i++) {
        size_t kept = (i % 4 + 1) * (i % 4 + 1);
        memset(v.sh + 3 * SH * i + 3 * kept, 0, 3 * (SH - kept) * sizeof *v.sh);
    }
    sf_gaussians g = arrays(&v);
    assert_ok(ctx, sf_model_create(ctx, COUNT, 3, &model));
    assert_ok(ctx, sf_model_set(model, 0, COUNT, &g));
    if (packed) assert_ok(ctx, sf_model_pack(model));
    return model;
}

static void get(sf_context *ctx, const sf_model *model, values *v) {
    sf_gaussians g = arrays(v);
    memset(v, 0, sizeof *v);
    assert_ok(ctx, sf_model_get(model, 0, sf_model_count(model), &g));
}

static sf_similarity make_motion(double x, double y, double z, double scale) {
    const double phi[3] = {x, y, z};
    sf_similarity motion = {.scale = scale, .move = {0.3, -2, 1.5}};
    sf_rotation_exp(phi, motion.R);
    return motion;
}

/* What the camera becomes when it moves along: p_c' = scale p_c. */
static sf_camera move_camera(const sf_camera *camera, const sf_similarity *m) {
    sf_camera moved = *camera;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) moved.R_cw[3 * i + j] = sf_dot3(camera->R_cw + 3 * i, m->R + 3 * j);
        moved.t_cw[i] = m->scale * camera->t_cw[i] - sf_dot3(moved.R_cw + 3 * i, m->move);
    }
    return moved;
}

static double likeness(sf_context *ctx, const sf_model *before, const sf_model *after,
                       const sf_similarity *m) {
    static float first[3 * PIXELS], second[3 * PIXELS];
    sf_camera camera = test_camera_around(1, 8, WIDTH, HEIGHT), moved = move_camera(&camera, m);
    sf_render_options options = sf_render_options_default();
    const sf_image_out a = {.rgb = first}, b = {.rgb = second};
    sf_renderer *renderer;
    sf_quality quality;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_render(renderer, before, &camera, &options, &a));
    options.near_plane *= (float)m->scale;
    assert_ok(ctx, sf_render(renderer, after, &moved, &options, &b));
    float brightest = 0;
    for (size_t i = 0; i < 3 * PIXELS; i++) {
        brightest = fmaxf(brightest, first[i]);
        first[i] = fminf(fmaxf(first[i], 0), 1);
    }
    assert_true(brightest > 0.5f);
    assert_ok(ctx, sf_compare(renderer, WIDTH, HEIGHT, second, first, NULL, &quality));
    sf_renderer_destroy(&renderer);
    return quality.psnr;
}

static void test_it_looks_the_same(void **state) {
    (void)state;
    static const double turns[][4] = {
        {0, 0, 0, 1}, {1.2, 0, 0, 1}, {0.4, -2.1, 1.3, 3.7}, {3.1, 0.2, 0, 0.05}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof turns / sizeof *turns; i++)
        for (int packed = 0; packed < 2; packed++) {
            sf_similarity m = make_motion(turns[i][0], turns[i][1], turns[i][2], turns[i][3]);
            sf_model *before = make_model(ctx, packed), *after = make_model(ctx, packed);
            assert_ok(ctx, sf_model_transform(after, &m));
            double psnr = likeness(ctx, before, after, &m);
            print_message("turn %zu, packed %d: %.1f dB\n", i, packed, psnr);
            assert_true(psnr > 60);
            /* It would notice colours that stayed. */
            if (i > 1) {
                static values was, is;
                get(ctx, before, &was);
                get(ctx, after, &is);
                const sf_gaussians stayed = {.sh = was.sh};
                assert_ok(ctx, sf_model_set(after, 0, COUNT, &stayed));
                assert_true(likeness(ctx, before, after, &m) < 40);
            }
            sf_model_destroy(&after);
            sf_model_destroy(&before);
        }
    sf_context_destroy(&ctx);
}

/* A colour seen from d is, turned, seen from R d: to what a float holds. */
static void test_harmonics_in_float64(void **state) {
    (void)state;
    static values was, is;
    sf_context *ctx = test_context();
    sf_model *model = make_model(ctx, 0);
    sf_similarity m = make_motion(-0.7, 1.9, 0.6, 1);
    get(ctx, model, &was);
    assert_ok(ctx, sf_model_transform(model, &m));
    get(ctx, model, &is);
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    double worst = 0;
    for (size_t i = 0; i < COUNT; i++) {
        double d[3], turned[3], Y[SH], Z[SH];
        for (int k = 0; k < 3; k++) d[k] = sf_rng_normal(&rng);
        double length = sqrt(sf_dot3(d, d));
        for (int k = 0; k < 3; k++) d[k] /= length;
        sf_mat3_vec(m.R, d, turned);
        sf_sh_basis(3, d, Y);
        sf_sh_basis(3, turned, Z);
        for (size_t c = 0; c < 3; c++) {
            double before = 0, after = 0;
            for (size_t k = 0; k < SH; k++) {
                before += Y[k] * (double)was.sh[3 * SH * i + 3 * k + c];
                after += Z[k] * (double)is.sh[3 * SH * i + 3 * k + c];
            }
            worst = fmax(worst, fabs(after - before));
        }
    }
    /* 16 products of values near 1, each rounded to 24 bits. */
    print_message("colours differ by %.1e\n", worst);
    assert_true(worst < 16 * 0x1p-24 * 3);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_motions_that_are_none(void **state) {
    (void)state;
    static values was, is;
    sf_context *ctx = test_context();
    sf_model *model = make_model(ctx, 0);
    get(ctx, model, &was);
    sf_similarity mirror = make_motion(0.2, 0.1, 0, 1), flat = mirror, lost = mirror;
    for (int k = 0; k < 3; k++) mirror.R[6 + k] *= -1;
    flat.scale = 0;
    lost.move[1] = NAN;
    assert_status(ctx, sf_model_transform(model, &mirror), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "R: is not a rotation");
    assert_status(ctx, sf_model_transform(model, &flat), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "scale: 0");
    assert_status(ctx, sf_model_transform(model, &lost), SF_ERR_ARGUMENT);
    get(ctx, model, &is);
    assert_memory_equal(&was, &is, sizeof was);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static int is_inside(const float *mean) { return mean[0] >= 0 && mean[1] >= -0.5f && mean[1] <= 0.5f; }

static void test_crop(void **state) {
    (void)state;
    static values was, is;
    static const double low[3] = {0, -0.5, -9}, high[3] = {9, 0.5, 9}, far[3] = {8, 8, 8};
    sf_context *ctx = test_context();
    for (int packed = 0; packed < 2; packed++) {
        sf_model *model = make_model(ctx, packed);
        get(ctx, model, &was);
        assert_status(ctx, sf_model_crop(model, far, high), SF_ERR_ARGUMENT);
        assert_status(ctx, sf_model_crop(model, far, (const double[3]){9, 9, 9}), SF_ERR_EMPTY);
        get(ctx, model, &is);
        assert_memory_equal(&was, &is, sizeof was);
        assert_ok(ctx, sf_model_crop(model, low, high));
        get(ctx, model, &is);
        size_t kept = 0;
        for (size_t i = 0; i < COUNT; i++) {
            if (!is_inside(was.means + 3 * i)) continue;
            assert_memory_equal(is.means + 3 * kept, was.means + 3 * i, 3 * sizeof(float));
            assert_memory_equal(is.quats + 4 * kept, was.quats + 4 * i, 4 * sizeof(float));
            assert_memory_equal(is.sh + 3 * SH * kept, was.sh + 3 * SH * i, 3 * SH * sizeof(float));
            kept++;
        }
        assert_true(kept > 5 && kept < COUNT / 2);
        assert_int_equal(sf_model_count(model), kept);
        sf_model_destroy(&model);
    }
    sf_context_destroy(&ctx);
}

/* A tilted disc with a few Gaussians far away. */
static void test_bounds(void **state) {
    (void)state;
    enum { N = 400, FAR = 20 };
    static float means[3 * N];
    sf_context *ctx = test_context();
    sf_rng rng;
    sf_model *model;
    sf_model_bounds b;
    const double tilt[3] = {0.4, 0, 0};
    double R[9];
    sf_rotation_exp(tilt, R);
    sf_rng_seed(&rng, 3);
    for (size_t i = 0; i < N; i++) {
        double p[3] = {2 * sf_rng_normal(&rng), 0.1 * sf_rng_normal(&rng), sf_rng_normal(&rng)}, q[3];
        sf_mat3_vec(R, p, q);
        for (size_t k = 0; k < 3; k++) means[3 * i + k] = (float)(i < FAR ? 500 : q[k] + 1);
    }
    assert_ok(ctx, sf_model_create(ctx, N, 0, &model));
    const sf_gaussians g = {.means = means};
    assert_ok(ctx, sf_model_set(model, 0, N, &g));
    assert_ok(ctx, sf_model_get_bounds(model, &b));
    for (int k = 0; k < 3; k++) assert_float_equal(b.center[k], 1, 0.3);
    assert_true(b.radius > 1.5 && b.radius < 4);
    /* The plane's normal, upwards: -y turned by the tilt. */
    for (int k = 0; k < 3; k++) assert_float_equal(b.normal[k], -R[3 * k + 1], 0.02);
    assert_true(b.flatness < 0.2);
    sf_model_destroy(&model);
    assert_ok(ctx, sf_model_create(ctx, 0, 0, &model));
    assert_status(ctx, sf_model_get_bounds(model, &b), SF_ERR_EMPTY);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_quaternions(void **state) {
    (void)state;
    static const double turns[][3] = {{0, 0, 0}, {3.1, 0.1, 0}, {0, 3.14159, 0}, {0.1, 0, 3.1}, {1, -1, 0.5}};
    for (size_t i = 0; i < sizeof turns / sizeof *turns; i++) {
        double R[9], again[9], q[4];
        sf_rotation_exp(turns[i], R);
        sf_rotation_to_quat(R, q);
        for (int k = 0; k < 4; k++) q[k] *= -3;
        sf_rotation_from_quat(q, again);
        for (int k = 0; k < 9; k++) assert_float_equal(again[k], R[k], 1e-12);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_it_looks_the_same),
        cmocka_unit_test(test_harmonics_in_float64),
        cmocka_unit_test(test_motions_that_are_none),
        cmocka_unit_test(test_crop),
        cmocka_unit_test(test_bounds),
        cmocka_unit_test(test_quaternions),
    };
    return cmocka_run_group_tests_name("transform", tests, NULL, NULL);
}
