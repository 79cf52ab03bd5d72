/* test_half_model.c - a copy of a model with 16-bit floats: how far values move, and what it cannot hold. */
#include "testing.h"

#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "scene/half_model.h"

/* Of degree 2: `count` Gaussians, a half with band 1, a third with band 2. */
static sf_model *mixed(sf_context *ctx, size_t count) {
    const size_t banded[SF_BANDS] = {count, count / 2, count / 3};
    sf_model *model;
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    assert_ok(ctx, sf_model_create_banded(ctx, banded, count, 2, &model));
    for (int field = 0; sf_field_stored(field, 2); field++)
        for (size_t i = 0; i < banded[sf_field_band(field)]; i++)
            for (int c = 0; c < sf_field_components(field); c++)
                *sf_value(&model->params, field, i, c) =
                    (float)(sf_rng_normal(&rng) * exp(8 * sf_rng_uniform(&rng) - 4));
    model->antialiased = 1, model->unit = -3, model->origin[1] = 7;
    return model;
}

static void assert_near_all(const sf_model *a, const sf_model *b) {
    for (int field = 0; sf_field_stored(field, 2); field++)
        for (size_t i = 0; i < a->banded[sf_field_band(field)]; i++)
            for (int c = 0; c < sf_field_components(field); c++) {
                float x = *sf_value(&a->params, field, i, c), y = *sf_value(&b->params, field, i, c);
                if (field == SF_FIELD_mean)
                    assert_true(x == y);
                else if (fabsf(x) < 0x1p-14f)
                    assert_true(y == 0 || fabsf(y) == 0x1p-14f);
                else
                    assert_true(fabsf(x - y) <= 0x1p-11f * fabsf(x));
            }
}

static void test_values_are_near(void **state) {
    (void)state;
    const size_t counts[] = {0, 1, 100, 1003};
    sf_context *ctx = test_context();
    sf_half_model half = {0};
    for (size_t k = 0; k < sizeof counts / sizeof *counts; k++) {
        sf_model *model = mixed(ctx, counts[k]), *copy, *again;
        assert_ok(ctx, sf_half_model_set(model, &half));
        assert_false(sf_half_model_is_empty(&half));
        assert_ok(ctx, sf_half_model_copy(&half, ctx, &copy));
        assert_memory_equal(copy->banded, model->banded, sizeof copy->banded);
        assert_true(copy->antialiased == 1 && copy->unit == -3 && copy->origin[1] == 7);
        assert_near_all(model, copy);
        /* what is 16-bit already stays */
        assert_ok(ctx, sf_half_model_set(copy, &half));
        assert_ok(ctx, sf_half_model_copy(&half, ctx, &again));
        for (int field = 0; sf_field_stored(field, 2); field++)
            if (counts[k])
                assert_memory_equal(copy->params.field[field], again->params.field[field],
                                    sizeof(float) *
                                        sf_field_values(field, copy->banded[sf_field_band(field)]));
        sf_model_destroy(&model);
        sf_model_destroy(&copy);
        sf_model_destroy(&again);
    }
    sf_half_model_free(ctx, &half);
    assert_true(sf_half_model_is_empty(&half));
    sf_context_destroy(&ctx);
}

/* A larger model takes less of them, and lanes behind it are neutral. */
static void test_a_model_is_replaced(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_half_model half = {0};
    sf_model *small = mixed(ctx, 33), *large = mixed(ctx, 200);
    assert_ok(ctx, sf_half_model_set(small, &half));
    sf_half_model_get(&half, large);
    assert_int_equal(large->count, 33);
    assert_near_all(small, large);
    for (size_t i = 33; i < large->capacity[0]; i++)
        assert_true(*sf_value(&large->params, SF_FIELD_quat, i, 0) == 1 &&
                    *sf_value(&large->params, SF_FIELD_logit_opacity, i, 0) == SF_INVISIBLE);
    sf_half_model_free(ctx, &half);
    sf_model_destroy(&small);
    sf_model_destroy(&large);
    sf_context_destroy(&ctx);
}

static void test_what_has_no_16_bits(void **state) {
    (void)state;
    const float values[] = {1e30f, -1e30f, INFINITY, NAN, 65503.0f, 0x1p-14f, 0x1p-15f, -1e-30f};
    const float expected[] = {65504.0f, -65504.0f, 65504.0f, NAN, 65504.0f, 0x1p-14f, 0, -0.0f};
    sf_context *ctx = test_context();
    sf_half_model half = {0};
    sf_model *model = mixed(ctx, 8), *copy;
    for (size_t i = 0; i < 8; i++) *sf_value(&model->params, SF_FIELD_sh0, i, 1) = values[i];
    assert_ok(ctx, sf_half_model_set(model, &half));
    assert_ok(ctx, sf_half_model_copy(&half, ctx, &copy));
    for (size_t i = 0; i < 8; i++) {
        float got = *sf_value(&copy->params, SF_FIELD_sh0, i, 1);
        assert_true(isnan(expected[i]) ? isnan(got) : got == expected[i]);
    }
    sf_half_model_free(ctx, &half);
    sf_model_destroy(&model);
    sf_model_destroy(&copy);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_values_are_near),
        cmocka_unit_test(test_a_model_is_replaced),
        cmocka_unit_test(test_what_has_no_16_bits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
