/* test_features_numbers.c - the arithmetic of features: plain functions, weights of blurs, places of extrema.
 */
#include "testing.h"

#include <math.h>

#include "sfm/elementary.h"
#include "sfm/localize.h"
#include "sfm/octave.h"

static void plain_functions_are_right(void **state) {
    (void)state;
    double worst_exp = 0, worst_turn = 0;
    for (double x = -64; x <= 64; x += 0.0137)
        worst_exp = fmax(worst_exp, fabs(sf_plain_exp(x) / exp(x) - 1));
    for (double x = 0; x <= 7; x += 0.00137) {
        double c, s;
        sf_plain_turn(x, &c, &s);
        worst_turn = fmax(worst_turn, fmax(fabs(c - cos(x)), fabs(s - sin(x))));
    }
    print_message("exp: relative error %.2g, cosine and sine: %.2g\n", worst_exp, worst_turn);
    assert_true(worst_exp < 1e-12 && worst_turn < 2e-15); /* as elementary.h says */
    assert_true(worst_exp > 0);
}

/* Weights sum to 1, and have a Gaussian's variance, but for what is cut off: 2.7 % of it at three deviations.
 */
static void weights_are_those_of_a_gaussian(void **state) {
    (void)state;
    for (double deviation = 0.6; deviation <= 5; deviation += 0.1) {
        sf_taps t = sf_taps_of(deviation);
        double sum = (double)t.weights[0], variance = 0;
        assert_between(t.radius, 1, SF_BLUR_RADIUS);
        assert_true(t.radius >= 3 * deviation);
        for (int k = 1; k <= t.radius; k++) {
            sum += 2 * (double)t.weights[k];
            variance += 2 * k * k * (double)t.weights[k];
            assert_true(t.weights[k] > 0 && t.weights[k] < t.weights[k - 1]);
        }
        assert_true(fabs(sum - 1) < 1e-6);
        assert_true(fabs(variance / (deviation * deviation) - 1) < 0.03);
    }
}

/* ---- places ---------------------------------------------------------------------------------------------
 */

/* A quadratic of x, y and scale about its extremum: the sum of c[n] times products of the offsets. */
typedef struct quadratic {
    double at[3], peak, c[6]; /* xx, xy, xs, yy, ys, ss */
} quadratic;

static double value_of(const quadratic *q, double x, double y, double s) {
    double dx = x - q->at[0], dy = y - q->at[1], ds = s - q->at[2];
    return q->peak + q->c[0] * dx * dx + q->c[1] * dx * dy + q->c[2] * dx * ds + q->c[3] * dy * dy +
           q->c[4] * dy * ds + q->c[5] * ds * ds;
}

static int localize(const quadratic *q, sf_extremum *e) {
    float values[3][3][3];
    sf_cube cube;
    for (int s = 0; s < 3; s++)
        for (int y = 0; y < 3; y++) {
            for (int x = 0; x < 3; x++) values[s][y][x] = (float)value_of(q, x - 1, y - 1, s - 1);
            cube.row[s][y] = &values[s][y][1];
        }
    return sf_localize(&cube, e);
}

static void extrema_of_quadratics_are_found(void **state) {
    (void)state;
    static const quadratic cases[] = {{{0, 0, 0}, 0.1, {-1, 0, 0, -1, 0, -1}},
                                      {{0.3, -0.2, 0.1}, 0.1, {-1, 0, 0, -1, 0, -1}},
                                      {{-0.4, 0.45, -0.3}, -0.2, {2, 0.5, 0.3, 1, -0.4, 0.7}},
                                      {{0.5, 0.1, 0.6}, 0.3, {-0.5, 0.7, 0.1, -3, 0.2, -0.2}}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const quadratic *q = &cases[i];
        sf_extremum e;
        assert_true(localize(q, &e));
        double xx = 2 * q->c[0], yy = 2 * q->c[3], xy = q->c[1],
               edge = (xx + yy) * (xx + yy) / (xx * yy - xy * xy);
        for (int k = 0; k < 3; k++) assert_true(fabs(e.offset[k] - q->at[k]) < 1e-5);
        assert_true(fabs(e.value - q->peak) < 1e-5);
        assert_true(fabs(e.edge / edge - 1) < 1e-5);
    }
}

/* A saddle is no blob, and a plane has no extremum. */
static void saddles_and_planes_are_told(void **state) {
    (void)state;
    static const quadratic saddle = {{0, 0, 0}, 0.1, {-1, 0, 0, 1, 0, -1}};
    static const float plane[3] = {1, 2, 3};
    sf_extremum e;
    sf_cube cube;
    assert_true(localize(&saddle, &e) && e.edge < 0);
    for (int i = 0; i < 9; i++) cube.row[i / 3][i % 3] = plane + 1;
    assert_false(sf_localize(&cube, &e));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_functions_are_right), cmocka_unit_test(weights_are_those_of_a_gaussian),
        cmocka_unit_test(extrema_of_quadratics_are_found), cmocka_unit_test(saddles_and_planes_are_told)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
