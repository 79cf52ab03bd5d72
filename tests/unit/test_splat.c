/* test_splat.c - Gaussians to .splat and back: bytes by hand, the order, errors within the format's steps. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scene/gaussian_math.h"

enum { ROW = 32 };

static sf_model *model_of(sf_context *ctx, const sf_gaussians *g, size_t count, int degree) {
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, count, degree, &model));
    assert_ok(ctx, sf_model_set(model, 0, count, g));
    return model;
}

static void put_float(uint8_t *to, float value) {
    uint32_t u;
    memcpy(&u, &value, sizeof u);
    for (int b = 0; b < 4; b++) to[b] = (uint8_t)(u >> (8 * b));
}

/* Two Gaussians, the heavier one second in the model and first in the file, with the bytes worked out by
 * hand. */
static void test_bytes(void **state) {
    (void)state;
    float means[] = {1, 2, 3, -4, 5.5f, 6}, quats[] = {1, 0, 0, 0, -1, 1, 1, -1},
          log_scales[] = {0, 0, 0, 0.5f, 0, 0}, logits[] = {0, 0};
    float sh[24] = {0, 1.7724539f, -1.7724539f, 9, 9, 9, 9, 9, 9, 9, 9, 9, -0.8862269f, 0.8862269f, 0};
    static const uint8_t colors[2][8] = {{64, 191, 128, 128, 64, 192, 192, 64},
                                         {128, 255, 0, 128, 255, 128, 128, 128}};
    uint8_t expected[2 * ROW];
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 3; k++) {
            put_float(expected + ROW * i + 4 * k, means[3 * (1 - i) + k]);
            put_float(expected + ROW * i + 12 + 4 * k, expf(log_scales[3 * (1 - i) + k]));
        }
        memcpy(expected + ROW * i + 24, colors[i], 8);
    }
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, &(sf_gaussians){means, quats, log_scales, logits, sh}, 2, 1);
    const char *path = test_path("bytes.splat");
    test_log_clear();
    assert_ok(ctx, sf_model_save(model, path));
    assert_non_null(strstr(test_log, "bytes.splat: bands 1 to 1 of the SH are left out"));
    size_t size;
    uint8_t *data = test_read(path, &size);
    assert_int_equal(size, sizeof expected);
    for (size_t i = 0; i < size; i++)
        if (data[i] != expected[i]) fail_msg("byte %zu is %d, not %d", i, data[i], expected[i]);
    free(data);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_round_trip(void **state) {
    (void)state;
    enum { COUNT = 40 };
    float means[3 * COUNT], quats[4 * COUNT], log_scales[3 * COUNT], logits[COUNT], sh[3 * COUNT];
    float means2[3 * COUNT], quats2[4 * COUNT], log_scales2[3 * COUNT], logits2[COUNT], sh2[3 * COUNT];
    for (int i = 0; i < COUNT; i++) {
        double norm = 0;
        for (int k = 0; k < 3; k++) {
            means[3 * i + k] = (float)(i - k) / 3;
            log_scales[3 * i + k] = -(float)i / 4 - (float)k;
            sh[3 * i + k] = 0.04f * (float)((7 * i + k) % 80 - 40);
        }
        for (int k = 0; k < 4; k++)
            norm += pow(quats[4 * i + k] = (float)((5 * i + 3 * k) % 11 - 5) + 0.25f, 2);
        for (int k = 0; k < 4; k++) quats[4 * i + k] /= (float)sqrt(norm);
        logits[i] = (float)(i % 12 - 6);
    }
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, &(sf_gaussians){means, quats, log_scales, logits, sh}, COUNT, 0), *again;
    const char *path = test_path("round.splat");
    assert_ok(ctx, sf_model_save(model, path));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    assert_int_equal(sf_model_count(again), COUNT);
    assert_int_equal(sf_model_sh_degree(again), 0);
    assert_ok(ctx, sf_model_get(again, 0, COUNT, &(sf_gaussians){means2, quats2, log_scales2, logits2, sh2}));
    double before = INFINITY;
    for (int j = 0; j < COUNT; j++) {
        int i = (int)lround(3 * (double)means2[3 * j]);
        double weight = log(sf_sigmoid((double)logits[i]));
        for (int k = 0; k < 3; k++) {
            weight += (double)log_scales[3 * i + k];
            assert_true(means2[3 * j + k] == means[3 * i + k]);
            assert_true(fabsf(log_scales2[3 * j + k] - log_scales[3 * i + k]) < 1e-5f);
            double color = fmin(fmax((double)sh[3 * i + k], -0.5 / 0.28209479), 0.5 / 0.28209479);
            assert_true(fabs((double)sh2[3 * j + k] - color) <= 0.5 / 255 / 0.28209479 + 1e-5);
        }
        /* 1 would be 256: it is one step less. */
        for (int k = 0; k < 4; k++) assert_true(fabsf(quats2[4 * j + k] - quats[4 * i + k]) <= 1 / 128.0f);
        assert_true(fabs(sf_sigmoid((double)logits2[j]) - sf_sigmoid((double)logits[i])) <= 0.5 / 255 + 1e-6);
        assert_true(weight <= before + 1e-4);
        before = weight;
    }
    sf_model_destroy(&again);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Cut anywhere but between two Gaussians it is refused; values that are none are left out. */
static void test_hostile(void **state) {
    (void)state;
    uint8_t data[3 * ROW];
    sf_context *ctx = test_context();
    const char *path = test_path("made.splat");
    sf_model *model;
    memset(data, 200, sizeof data);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 6; k++) put_float(data + ROW * i + 4 * k, 1);
    for (size_t cut = 0; cut <= sizeof data; cut++) {
        test_write(path, data, cut);
        sf_status status = sf_model_load(ctx, path, &model);
        assert_int_equal(status, cut % ROW ? SF_ERR_FORMAT : SF_OK);
        if (status) {
            assert_error_names(ctx, "made.splat: size: ");
            assert_null(model);
            continue;
        }
        assert_int_equal(sf_model_count(model), cut / ROW);
        sf_model_destroy(&model);
    }
    put_float(data, NAN);
    put_float(data + ROW + 12, -1);
    test_log_clear();
    test_write(path, data, sizeof data);
    assert_ok(ctx, sf_model_load(ctx, path, &model));
    assert_non_null(strstr(test_log, "skipped 2 of 3 Gaussians"));
    assert_int_equal(sf_model_count(model), 1);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bytes),
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_hostile),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
