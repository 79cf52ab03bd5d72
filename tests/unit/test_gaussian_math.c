/* test_gaussian_math.c - opacities and rotations of Gaussians against their definitions. */
#include "testing.h"

#include <math.h>

#include "base/linear.h"
#include "scene/gaussian_math.h"
#include "fit/opacity.h"

#include <splatfit/camera.h>

static void test_logits(void **state) {
    (void)state;
    assert_true(sf_sigmoid(0) == 0.5 && sf_sigmoidf(0) == 0.5f);
    assert_true(sf_sigmoid(-800) == 0 && sf_sigmoid(800) == 1);
    assert_true(sf_sigmoidf(-200) == 0 && sf_sigmoidf(200) == 1);
    assert_float_equal(sf_sigmoid(log(3)), 0.75, 1e-15);
    assert_float_equal(sf_logit(0.2), -log(4), 1e-15);
    for (int i = 1; i < 100; i++) {
        double opacity = i / 100.0;
        assert_float_equal(sf_sigmoid(sf_logit(opacity)), opacity, 1e-15);
        assert_float_equal(sf_sigmoidf(sf_logitf((float)opacity)), opacity, 2e-7);
        assert_float_equal(sf_logitf((float)opacity), sf_logit((double)(float)opacity), 1e-6);
    }
}

/* The rotation of q with whatever length, by the definition: v -> q v q*. */
static void rotate(const double q[4], const double v[3], double turned[3]) {
    const double pure[4] = {0, v[0], v[1], v[2]}, back[4] = {q[0], -q[1], -q[2], -q[3]};
    double half[4], whole[4], square = 0;
    for (int k = 0; k < 4; k++) square += q[k] * q[k];
    sf_quat_mul(q, pure, half);
    sf_quat_mul(half, back, whole);
    assert_float_equal(whole[0], 0, 1e-12);
    for (int k = 0; k < 3; k++) turned[k] = whole[k + 1] / square;
}

static const float quats[][4] = {{1, 0, 0, 0},           {0, 1, 0, 0},
                                 {0, 0, -2, 0},          {0.5f, 0.5f, 0.5f, 0.5f},
                                 {0.1f, -3, 0.2f, 0.7f}, {-4, 1, 2, 8}};
enum { QUATS = sizeof quats / sizeof *quats };

static void test_units(void **state) {
    (void)state;
    for (int i = 0; i < QUATS; i++) {
        float unit[4];
        double square = 0, along = 0, length = 0;
        sf_unit_quat(quats[i], unit);
        for (int k = 0; k < 4; k++) {
            square += (double)unit[k] * (double)unit[k];
            along += (double)unit[k] * (double)quats[i][k];
            length += (double)quats[i][k] * (double)quats[i][k];
        }
        assert_float_equal(square, 1, 1e-6);
        assert_float_equal(along, sqrt(length), 1e-6 * sqrt(length)); /* the same direction */
    }
}

/* Hamilton's rules: i j = k, j k = i, k i = j, and none of them commutes. */
static void test_products(void **state) {
    (void)state;
    static const double unit[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    for (int a = 1; a < 4; a++) {
        int b = a % 3 + 1, c = b % 3 + 1;
        double product[4];
        sf_quat_mul(unit[a], unit[b], product);
        for (int k = 0; k < 4; k++) assert_true(product[k] == unit[c][k]);
        sf_quat_mul(unit[b], unit[a], product);
        for (int k = 0; k < 4; k++) assert_true(product[k] == -unit[c][k]);
        sf_quat_mul(unit[a], unit[a], product);
        for (int k = 0; k < 4; k++) assert_true(product[k] == -unit[0][k]);
    }
}

static void test_rotations(void **state) {
    (void)state;
    for (int i = 0; i < QUATS; i++) {
        double q[4], R[9], public[9], norm = 0;
        for (int k = 0; k < 4; k++) q[k] = (double)quats[i][k], norm += q[k] * q[k];
        norm = sqrt(norm);
        sf_unit_quat_rotation(q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm, R);
        sf_rotation_from_quat(q, public);
        assert_memory_equal(R, public, sizeof R);
        for (int axis = 0; axis < 3; axis++) {
            const double along[3] = {axis == 0, axis == 1, axis == 2};
            double turned[3], column[3];
            float direction[3];
            rotate(q, along, turned);
            sf_mat3_vec(R, along, column);
            sf_quat_axis(quats[i], axis, direction);
            for (int k = 0; k < 3; k++) {
                assert_float_equal(column[k], turned[k], 1e-12);
                assert_float_equal(direction[k], turned[k], 1e-6);
            }
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_logits),
        cmocka_unit_test(test_units),
        cmocka_unit_test(test_products),
        cmocka_unit_test(test_rotations),
    };
    return cmocka_run_group_tests_name("gaussian_math", tests, NULL, NULL);
}
