/* test_sfm_two_view.c - models of pairs found among wrong matches, and pairs told apart. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "sfm/pair_models.h"
#include "sfm/two_view.h"
#include "sfm_fixture.h"

enum { COUNT = 200, PAIRS = 60 };

static const double focal = 800; /* px: noise and thresholds are told in pixels */
static const double degree = 57.29577951308232;

/* Every inlier that was found, and how many of them are wrong ones. */
static void count_inliers(const sfm_pair *p, const uint8_t *inliers, size_t *right, size_t *wrong) {
    *right = *wrong = 0;
    for (size_t i = 0; i < p->count; i++)
        if (inliers[i]) ++*(p->is_true[i] ? right : wrong);
}

static size_t true_count(const sfm_pair *p) {
    size_t count = 0;
    for (size_t i = 0; i < p->count; i++) count += p->is_true[i];
    return count;
}

static void find(const sfm_pair *p, int known, sf_two_view *found, uint8_t *inliers) {
    static double scratch[SF_TWO_VIEW_SCRATCH * SFM_PAIRS_MOST];
    sf_two_view_options o = sf_two_view_options_default();
    o.known = known;
    o.threshold = 2 / focal;
    sf_two_view_find(&o, p->a, p->b, p->count, scratch, inliers, found);
}

/* Half of the pairs are wrong; noise of half a pixel. */
static void general_pairs(void **state) {
    (void)state;
    static sfm_pair p;
    uint8_t inliers[COUNT];
    sf_rng rng;
    double worst = 0;
    size_t failed = 0;
    sf_rng_seed(&rng, 1);
    for (int i = 0; i < PAIRS; i++) {
        sf_two_view found;
        size_t right, wrong;
        sfm_make_pair(&p, &rng, SFM_GENERAL, COUNT, 0.5 / focal, 0.5);
        find(&p, 1, &found, inliers);
        count_inliers(&p, inliers, &right, &wrong);
        double off = fmax(sfm_angle_between(found.T.R, p.T.R), sfm_direction_error(found.T.t, p.T.t));
        failed += found.kind != SF_PAIR_GENERAL || !(off < 3 / degree);
        worst = fmax(worst, off);
        assert_true((double)right > 0.97 * (double)true_count(&p) && wrong < 12);
        assert_int_equal(found.count, right + wrong);
        find(&p, 0, &found, inliers);
        count_inliers(&p, inliers, &right, &wrong);
        assert_false(found.has_pose);
        failed +=
            found.kind != SF_PAIR_GENERAL || !((double)right > 0.9 * (double)true_count(&p)) || wrong > 15;
    }
    print_message("general: %.2f degrees off at most, %zu of %d failed\n", worst * degree, failed, 2 * PAIRS);
    assert_true(failed <= 2);
}

/* A plane has a second pose that explains it as well: the pose is one of the two. */
static void planes(void **state) {
    (void)state;
    static sfm_pair p;
    uint8_t inliers[COUNT];
    sf_rng rng;
    int near = 0;
    sf_rng_seed(&rng, 2);
    for (int i = 0; i < PAIRS; i++) {
        sf_two_view found;
        size_t right, wrong;
        sfm_make_pair(&p, &rng, SFM_PLANE, COUNT, 0.5 / focal, 0.4);
        find(&p, 1, &found, inliers);
        count_inliers(&p, inliers, &right, &wrong);
        assert_true(found.has_pose && (double)right > 0.95 * (double)true_count(&p));
        assert_true(found.kind == SF_PAIR_PLANE);
        near += sfm_angle_between(found.T.R, p.T.R) < 3 / degree;
        find(&p, 0, &found, inliers);
        assert_int_equal(found.kind, SF_PAIR_PLANE_OR_ROTATION);
    }
    print_message("planes: %d of %d poses are the true one\n", near, PAIRS);
    assert_true(near >= PAIRS / 2);
}

static void rotations(void **state) {
    (void)state;
    static sfm_pair p;
    uint8_t inliers[COUNT];
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    for (int i = 0; i < PAIRS; i++) {
        sf_two_view found;
        size_t right, wrong;
        sfm_make_pair(&p, &rng, SFM_ROTATION, COUNT, 0.5 / focal, 0.3);
        find(&p, 1, &found, inliers);
        count_inliers(&p, inliers, &right, &wrong);
        assert_int_equal(found.kind, SF_PAIR_ROTATION);
        assert_true((double)right > 0.94 * (double)true_count(&p) && wrong < 5);
        assert_true(sfm_angle_between(found.T.R, p.T.R) < 0.1 / degree);
        assert_true(sf_dot3(found.T.t, found.T.t) == 0 && found.angle == 0);
        find(&p, 0, &found, inliers);
        assert_int_equal(found.kind, SF_PAIR_PLANE_OR_ROTATION);
    }
}

/* Nothing but wrong pairs; too few; none. */
static void no_geometry(void **state) {
    (void)state;
    static sfm_pair p;
    uint8_t inliers[COUNT];
    sf_rng rng;
    int some = 0;
    sf_rng_seed(&rng, 4);
    for (int i = 0; i < 30; i++) {
        sf_two_view found;
        sfm_make_pair(&p, &rng, SFM_GENERAL, 60, 0.5 / focal, 1);
        find(&p, i % 2, &found, inliers);
        some += found.kind != SF_PAIR_NONE;
    }
    assert_int_equal(some, 0);
    static const size_t few[] = {0, 1, 4, 6, 14};
    for (size_t i = 0; i < sizeof few / sizeof *few; i++) {
        sf_two_view found;
        sfm_make_pair(&p, &rng, SFM_GENERAL, few[i], 0, 0);
        find(&p, i % 2, &found, inliers);
        assert_true(found.kind == SF_PAIR_NONE && found.count == 0);
    }
}

/* All at one place; all in a line; half of the pairs twice. */
static void odd_pairs(void **state) {
    (void)state;
    static sfm_pair p;
    uint8_t inliers[COUNT];
    sf_rng rng;
    sf_two_view found;
    sf_rng_seed(&rng, 5);
    sfm_make_pair(&p, &rng, SFM_GENERAL, COUNT, 0.5 / focal, 0.2);
    for (size_t i = 0; i < COUNT; i++) p.a[2 * i + 1] = 0.3 * p.a[2 * i], p.b[2 * i + 1] = 0.2;
    for (int known = 0; known < 2; known++) find(&p, known, &found, inliers);
    for (size_t i = 0; i < 2 * COUNT; i++) p.a[i] = p.b[i] = 0.1;
    for (int known = 0; known < 2; known++) find(&p, known, &found, inliers);
    sfm_make_pair(&p, &rng, SFM_GENERAL, COUNT, 0.5 / focal, 0);
    memcpy(p.a + COUNT, p.a, COUNT * sizeof *p.a);
    memcpy(p.b + COUNT, p.b, COUNT * sizeof *p.b);
    find(&p, 1, &found, inliers);
    assert_int_equal(found.kind, SF_PAIR_GENERAL);
    assert_true(sfm_angle_between(found.T.R, p.T.R) < 1 / degree);
}

/* The search stops as soon as its best model makes further samples pointless, repeats itself by its seed, and
 * does not depend on it where there is an answer. */
static void searches_repeat(void **state) {
    (void)state;
    static sfm_pair p;
    static double scratch[2 * COUNT];
    uint8_t first[COUNT], second[COUNT];
    sf_rng rng;
    sf_rng_seed(&rng, 6);
    sfm_make_pair(&p, &rng, SFM_GENERAL, COUNT, 0.3 / focal, 0.3);
    const sf_pairs pairs = {p.a, p.b, COUNT};
    const sf_ransac_problem problem = sf_essential_problem(&pairs);
    sf_ransac_options o = {
        .threshold = 2 / focal, .confidence = 0.999, .least = 10, .most = 5000, .least_count = 15, .seed = 1};
    sf_ransac_result one, again, other;
    sf_ransac(&problem, &o, scratch, first, &one);
    sf_ransac(&problem, &o, scratch, second, &again);
    assert_memory_equal(&one, &again, sizeof one);
    assert_memory_equal(first, second, COUNT);
    o.seed = 2;
    sf_ransac(&problem, &o, scratch, NULL, &other);
    assert_true(fabs(other.cost / one.cost - 1) < 0.02);
    assert_true(one.samples >= 10 && one.samples < 80); /* log(0.001) / log(1 - 0.7^5) = 38 */
    o.least_count = COUNT;
    sf_ransac(&problem, &o, scratch, first, &other);
    assert_int_equal(other.count, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(general_pairs), cmocka_unit_test(planes),    cmocka_unit_test(rotations),
        cmocka_unit_test(no_geometry),   cmocka_unit_test(odd_pairs), cmocka_unit_test(searches_repeat),
    };
    return cmocka_run_group_tests_name("sfm_two_view", tests, NULL, NULL);
}
