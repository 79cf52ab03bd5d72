/* test_loss_figures.c - the figures of merit against the float64 reference. */
#include "loss_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/random.h"

static sf_quality quality_of(const bench *b, const pair *p) {
    sf_quality quality;
    assert_ok(b->ctx, sf_compare(b->renderer, p->width, p->height, p->rgb, p->target, p->weight, &quality));
    return quality;
}

static void fill(pair *p, float rgb, float target) {
    for (size_t i = 0; i < 3 * p->pixels; i++) p->rgb[i] = rgb, p->target[i] = target;
}

static void psnr_of_known_errors(void **state) {
    (void)state;
    pair p = loss_pair_create(1, 20, 10, WEIGHT_NONE);
    bench b = loss_bench_create(2);
    fill(&p, 0.5f, 0.5f);
    sf_quality same = quality_of(&b, &p);
    assert_true(same.psnr == 100);
    assert_true(fabs(same.ssim - 1) <= 1e-6);
    fill(&p, 0.75f, 0.5f); /* MSE 1/16 */
    assert_true(fabs(quality_of(&b, &p).psnr - 10 * log10(16)) < 1e-9);
    fill(&p, 1, 0);
    assert_true(fabs(quality_of(&b, &p).psnr) < 1e-9);
    fill(&p, 0.5f, 0.5f);
    p.rgb[77] = 1; /* one value of 600: MSE 1/2400 */
    assert_true(fabs(quality_of(&b, &p).psnr - 10 * log10(2400)) < 1e-9);
    fill(&p, 0.5f, 0.5f + 0x1p-20f); /* below the floor */
    assert_true(quality_of(&b, &p).psnr == 100);
    loss_bench_free(&b);
    loss_pair_free(&p);
}

static void psnr_counts_by_weight(void **state) {
    (void)state;
    pair p = loss_pair_create(1, 20, 10, WEIGHT_ONE);
    bench b = loss_bench_create(2);
    for (size_t i = 0; i < p.pixels; i++) {
        p.weight[i] = i % 2 ? 0.25f : 0.75f;
        for (size_t k = 0; k < 3; k++) {
            p.target[3 * i + k] = 0.25f;
            p.rgb[3 * i + k] = i % 2 ? 0.75f : 0.25f;
        }
    }
    /* a quarter of the weight with an error of 1/4 */
    assert_true(fabs(quality_of(&b, &p).psnr - 10 * log10(16)) < 1e-9);
    loss_bench_free(&b);
    loss_pair_free(&p);
}

/* The picture is clamped to 0..1, where exposure is corrected to 0..2, and what is no number is 0; the
 * caller's array stays as it is. */
static void compare_clamps_the_picture(void **state) {
    (void)state;
    static const float beyond[] = {1.5f, -0.25f, NAN, INFINITY, -INFINITY, 1e30f};
    static const float clamped[] = {1, 0, 0, 1, 0, 1}, bright[] = {1.5f, 0, 0, 2, 0, 2};
    pair p = loss_pair_create(2, 31, 18, WEIGHT_NONE), q = loss_pair_create(2, 31, 18, WEIGHT_NONE);
    bench b = loss_bench_create(2);
    for (size_t i = 0; i < 3 * p.pixels; i++) {
        p.rgb[i] = q.rgb[i] = fminf(fmaxf(p.rgb[i], 0), 1);
        if (i % 7) continue;
        p.rgb[i] = beyond[i / 7 % 6];
        q.rgb[i] = clamped[i / 7 % 6];
    }
    float *before = loss_floats(3 * p.pixels);
    memcpy(before, p.rgb, 3 * p.pixels * sizeof(float));
    sf_quality x = quality_of(&b, &p), y = quality_of(&b, &q);
    assert_true(isfinite(x.psnr) && isfinite(x.ssim) && isfinite(x.psnr_corrected));
    assert_true(x.psnr == y.psnr && x.ssim == y.ssim);
    for (size_t i = 0; i < 3 * p.pixels; i += 7) q.rgb[i] = bright[i / 7 % 6];
    y = quality_of(&b, &q);
    assert_memory_equal(&x, &y, sizeof x);
    assert_memory_equal(p.rgb, before, 3 * p.pixels * sizeof(float));
    free(before);
    loss_bench_free(&b);
    loss_pair_free(&p);
    loss_pair_free(&q);
}

static void quality_matches_the_reference(void **state) {
    (void)state;
    bench b = loss_bench_create(2);
    for (int how = 0; how < WEIGHTINGS; how++) {
        pair p = loss_pair_create(20 + (uint64_t)how, 53, 38, (enum weighting)how);
        double squares = 0, weights = 0;
        for (size_t i = 0; i < 3 * p.pixels; i++) {
            p.rgb[i] = fminf(fmaxf(p.rgb[i], 0), 1);
            double weight = p.weight ? p.weight[i / 3] : 1, error = (double)p.rgb[i] - (double)p.target[i];
            squares += weight * error * error;
            weights += weight;
        }
        double *rgb = loss_to_double(p.rgb, 3 * p.pixels), *target = loss_to_double(p.target, 3 * p.pixels);
        double *weight = loss_to_double(p.weight, p.pixels);
        test_ref_loss expected =
            test_ref_compare(&(test_ref_pair){53, 38, rgb, target, weight, 0.2, 0}, NULL);
        sf_quality quality = quality_of(&b, &p);
        assert_true(fabs(quality.psnr + 10 * log10(squares / weights)) < 1e-6);
        assert_true(fabs(quality.ssim - expected.ssim) <= loss_VALUE_BOUND);
        free(rgb);
        free(target);
        free(weight);
        loss_pair_free(&p);
    }
    loss_bench_free(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(psnr_of_known_errors),
        cmocka_unit_test(psnr_counts_by_weight),
        cmocka_unit_test(compare_clamps_the_picture),
        cmocka_unit_test(quality_matches_the_reference),
    };
    return cmocka_run_group_tests_name("loss", tests, NULL, NULL);
}
