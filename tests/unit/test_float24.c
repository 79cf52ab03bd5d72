/* test_float24.c - floats of 3 bytes: how far values move, and those that are no numbers. */
#include "testing.h"

#include <float.h>
#include <math.h>

#include "base/rng.h"
#include "render/float24.h"

static float there_and_back(float value) {
    uint8_t bytes[SF_FLOAT24_BYTES + 1] = {0};
    bytes[SF_FLOAT24_BYTES] = 77;
    sf_put_float24(value, bytes);
    assert_int_equal(bytes[SF_FLOAT24_BYTES], 77);
    return sf_float24(bytes);
}

/* Of all sizes: right to 2^-16, the nearest of its neighbours, and the same when it goes a second time. */
static void test_values_are_near(void **state) {
    (void)state;
    sf_rng rng;
    sf_rng_seed(&rng, 24);
    for (int k = 0; k < 100000; k++) {
        float value = (float)ldexp(sf_rng_normal(&rng), (int)(sf_rng_uniform(&rng) * 200) - 100);
        float got = there_and_back(value);
        assert_true(fabs((double)got - value) <= 0x1p-16 * fabs(value));
        assert_true(there_and_back(got) == got);
    }
    assert_true(there_and_back(1 + 0x1p-16f * 0.9f) == 1);
    assert_true(there_and_back(1 + 0x1p-16f * 1.1f) == 1 + 0x1p-15f);
    assert_true(there_and_back(-1.5f) == -1.5f);
}

static void test_others(void **state) {
    (void)state;
    assert_true(there_and_back(0) == 0 && !signbit(there_and_back(0.0f)) && signbit(there_and_back(-0.0f)));
    assert_true(there_and_back(INFINITY) == INFINITY && there_and_back(-INFINITY) == -INFINITY);
    assert_true(there_and_back(FLT_MAX) == INFINITY);
    assert_true(fabsf(there_and_back(FLT_TRUE_MIN)) <= 0x1p-134f);
    const uint32_t nans[] = {0x7fc00000, 0x7f800001, 0xff800080, 0x7fffffff};
    for (int k = 0; k < 4; k++) {
        float value;
        memcpy(&value, &nans[k], sizeof value);
        assert_true(isnan(there_and_back(value)));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_values_are_near),
        cmocka_unit_test(test_others),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
