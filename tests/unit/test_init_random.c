/* test_init_random.c - Gaussians at random, and which initialisation a fit chooses. */
#include "init_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "scene/init.h"
#include "scene/random.h"

static int sees(const sf_camera *camera, const float *p) {
    double q[3];
    for (int i = 0; i < 3; i++) {
        q[i] = camera->t_cw[i];
        for (int k = 0; k < 3; k++) q[i] += camera->R_cw[3 * i + k] * (double)p[k];
    }
    double x = camera->fx * q[0] / q[2] + camera->cx, y = camera->fy * q[1] / q[2] + camera->cy;
    return q[2] > 0 && x > 0 && y > 0 && x < camera->width && y < camera->height;
}

/* In front of a camera, with a colour that this camera sees; some from every view. */
static void check_random(const content *c, int views) {
    size_t of_view[4] = {0};
    for (size_t i = 0; i < c->count; i++) {
        int owner = -1;
        for (int v = 0; v < views; v++) {
            sf_camera camera = init_camera_around(v);
            double off = 0;
            for (size_t ch = 0; ch < 3; ch++)
                off += fabs(0.5 + init_sh_c0 * (double)c->sh[i][0][ch] - init_side_colors[v][ch] / 255.0);
            if (off < 1e-5 && sees(&camera, c->means[i])) owner = v;
        }
        if (owner < 0) fail_msg("Gaussian %zu is of no view", i);
        of_view[owner]++;
    }
    for (int v = 0; v < views; v++) assert_true(of_view[v] > 0);
}

static void test_at_random(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int views = 1; views <= 4; views += 3) {
        sf_scene *scene = init_scene_of(ctx, views);
        content *c = init_make_first(scene, &init_usual, 1), *same = init_make_first(scene, &init_usual, 1),
                *other = init_make_first(scene, &init_usual, 2);
        assert_int_equal(c->count, init_usual.random_count);
        init_check_common(c, &init_usual);
        check_random(c, views);
        assert_memory_equal(c, same, sizeof *c);
        assert_memory_not_equal(c->means, other->means, sizeof c->means);
        free(c);
        free(same);
        free(other);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* A single camera has no point that all look at, and says nothing of depths: points are as far from it as any
 * may be, some three times the extent. */
static void test_random_depths(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = init_scene_of(ctx, 1);
    sf_init_options options = init_usual;
    options.extent = 6; /* what a single camera is taken to look at */
    content *c = init_make_first(scene, &options, 1);
    double least = INFINITY, most = 0;
    for (size_t i = 0; i < c->count; i++) {
        double depth = (double)c->means[i][0] + 6;
        least = fmin(least, depth);
        most = fmax(most, depth);
    }
    assert_true(least > 6); /* each is the farthest of 20: nearer than the extent is one in a million */
    assert_true(most > 17 && most < 18.01);
    free(c);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Beside points, random ones are 1 to 20 times as far as these. The front has one at depth 6 alone; a view
 * from the side sees a wall at depth 9. No random point lies before the wall, and hardly one is nearer to a
 * camera than its content. */
static void test_far_points_hide_nothing(void **state) {
    (void)state;
    enum { COUNT = 300, ACROSS = 40, DOWN = 30, KNOWN = ACROSS * DOWN + 1 };
    sf_context *ctx = test_context();
    sf_scene *scene = init_scene_of(ctx, 2);
    sf_camera front = init_camera_around(0), side = init_camera_around(1);
    sf_view *views[2];
    uint32_t *ids;
    size_t known;
    assert_ok(ctx, sf_scene_training_ids(scene, &ids, &known));
    assert_int_equal(known, 2);
    for (size_t v = 0; v < 2; v++) assert_non_null(views[v] = sf_scene_retain_id(scene, ids[v]));
    sf_free(ctx, ids);
    sf_cloud cloud;
    assert_ok(ctx, sf_cloud_create(ctx, KNOWN + COUNT, &cloud));
    for (size_t i = 0; i < KNOWN; i++) { /* of the side: columns 9.8 to 15; the last one of the front alone */
        float wall[3] = {0.3f + 1.9f * (float)(i % ACROSS) / ACROSS, 3,
                         5 * (float)(i / ACROSS) / DOWN - 2.5f};
        memcpy(cloud.xyz + 3 * i, i < KNOWN - 1 ? wall : ((float[]){0, -2.2f, 2}), sizeof wall);
    }
    cloud.n = KNOWN;
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    assert_ok(ctx, sf_random_points(ctx, (const sf_view *const *)views, 2, COUNT, 10, &rng, &cloud));
    size_t of_front = 0, far = 0, beside = 0;
    assert_between(cloud.n, KNOWN + COUNT / 2, KNOWN + COUNT - 1);
    for (size_t i = KNOWN; i < cloud.n; i++) {
        const float *p = cloud.xyz + 3 * i;
        double deep = (double)p[0] + 6, aside = (double)p[1] + 6;
        int of_side = sees(&side, p) && aside > 8.99 && aside < 180.1;
        double u = side.cx + side.fx * (double)p[0] / aside, v = side.cy - side.fy * (double)p[2] / aside;
        if (aside > 0 && aside < 7.19 && u > 10.9 && u < 14.1 && v > 3.5 && v < 13)
            fail_msg("point %zu hangs before what the side sees at %.2f %.2f", i, u, v);
        if (sees(&front, p) && deep > 5.99 && deep < 120.1)
            of_front++, far += deep > 12;
        else if (!of_side)
            fail_msg("point %zu lies at %.2f and %.2f", i, deep, aside);
        double up = (double)p[2], from_front = sqrt(deep * deep + (double)p[1] * (double)p[1] + up * up),
               from_side = sqrt(aside * aside + (double)p[0] * (double)p[0] + up * up);
        beside += from_front < 0.8 * 6 - 0.01 || from_side < 0.8 * 9 - 0.01;
    }
    assert_true(of_front > 50);
    assert_true(20 * beside < cloud.n - KNOWN); /* ten depths may all be too near */
    assert_true(2 * far > of_front * 0.8);      /* even in inverse depth: half are twice as far */
    for (size_t v = 0; v < 2; v++) sf_view_release(views[v]);
    sf_cloud_destroy(ctx, &cloud);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A point at no sensible depth, as of a wrong match, changes nothing of the random ones beside it. */
static void test_points_nowhere_cover_nothing(void **state) {
    (void)state;
    enum { COUNT = 50 };
    sf_context *ctx = test_context();
    sf_scene *scene = init_scene_of(ctx, 1);
    uint32_t *ids;
    size_t views;
    sf_cloud clouds[2];
    assert_ok(ctx, sf_scene_training_ids(scene, &ids, &views));
    const sf_view *view = sf_scene_retain_id(scene, ids[0]);
    assert_non_null(view);
    for (size_t nowhere = 0; nowhere < 2; nowhere++) { /* 6 before the camera, and 1e9 along the same ray */
        const float points[2][3] = {{0, -2.2f, 2}, {1e9f, -2.2e9f / 6, 2e9f / 6}};
        sf_cloud *cloud = &clouds[nowhere];
        sf_rng rng;
        sf_rng_seed(&rng, 1);
        assert_ok(ctx, sf_cloud_create(ctx, 2 + COUNT, cloud));
        memcpy(cloud->xyz, points, sizeof points);
        cloud->n = 1 + nowhere;
        assert_ok(ctx, sf_random_points(ctx, &view, 1, COUNT, 10, &rng, cloud));
    }
    size_t added = clouds[0].n - 1;
    assert_true(sees(&view->camera, clouds[1].xyz + 3));
    assert_true(added > COUNT / 2 && clouds[1].n == added + 2);
    assert_memory_equal(clouds[0].xyz + 3, clouds[1].xyz + 6, 3 * added * sizeof *clouds[0].xyz);
    for (int i = 0; i < 2; i++) sf_cloud_destroy(ctx, &clouds[i]);
    sf_view_release((sf_view *)(uintptr_t)view);
    sf_free(ctx, ids);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_random_count_is_capped(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = init_scene_of(ctx, 2);
    sf_init_options options = init_usual;
    options.max_gaussians = 17;
    content *c = init_make_first(scene, &options, 1);
    assert_int_equal(c->count, 17);
    free(c);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Nothing to start from: no point and no view, or points but none that is finite. */
static void test_nothing_to_start_from(void **state) {
    (void)state;
    static const float nowhere[3] = {NAN, 0, 0};
    sf_context *ctx = test_context();
    sf_scene *scene = init_scene_of(ctx, 0);
    sf_rng rng;
    sf_model *model;
    sf_rng_seed(&rng, 1);
    assert_ok(ctx, sf_scene_add_points(scene, 1, nowhere, NULL));
    assert_status(ctx, sf_init_gaussians(scene, &init_usual, &rng, &model), SF_ERR_EMPTY);
    assert_null(model);
    assert_error_names(ctx, "no training view");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* From where, as asked for: points that are there are left alone by the others, and none are missed. By
 * default random points join sparse ones. */
static void test_from_where_asked(void **state) {
    (void)state;
    static const struct {
        sf_init from;
        size_t points, expected;
    } cases[] = {{SF_INIT_AUTO, 0, 300},     {SF_INIT_AUTO, 99, 300},    {SF_INIT_AUTO, 100, 0},
                 {SF_INIT_POINTS, 5, 5},     {SF_INIT_POINTS, 100, 100}, {SF_INIT_SWEEP, 100, 300},
                 {SF_INIT_RANDOM, 100, 300}, {SF_INIT_RANDOM, 0, 300}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_scene *scene = init_scene_of(ctx, 4); /* of one colour each: a sweep finds nothing */
        sf_init_options options = init_usual;
        options.from = cases[i].from;
        init_add_points(scene, init_place_anywhere, cases[i].points, 1);
        test_log_clear();
        content *c = init_make_first(scene, &options, 1);
        if (cases[i].expected)
            assert_int_equal(c->count, cases[i].expected);
        else
            assert_between(c->count, 110, 100 + options.random_count / 2);
        if (cases[i].expected == 300) {
            check_random(c, 4);
            test_assert_contains(test_log, "300 first Gaussians at random", __FILE__, __LINE__);
        }
        free(c);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Asked for points that are not there, it says so. */
/* Points that are anywhere are not begun with, and that is said; where they are asked for, they are. */
static void test_wrong_points(void **state) {
    (void)state;
    enum { POINTS = 2000 };
    static float xyz[3 * POINTS];
    sf_context *ctx = test_context();
    sf_scene *right, *wrong;
    sf_scene_info info;
    sf_rng rng;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=80&height=60&frames=18", NULL, &right));
    assert_ok(ctx, sf_scene_create(ctx, &wrong));
    test_copy_views(ctx, right, wrong, NULL, NULL);
    sf_scene_get_info(right, &info);
    sf_rng_seed(&rng, 3);
    for (size_t i = 0; i < 3 * POINTS; i++)
        xyz[i] = (float)(info.center[i % 3] + 2 * info.extent * (sf_rng_uniform(&rng) - 0.5));
    assert_ok(ctx, sf_scene_add_points(wrong, POINTS, xyz, NULL));
    for (int asked = 0; asked < 2; asked++)
        for (int is_wrong = 0; is_wrong < 2; is_wrong++) {
            sf_init_options options = {.from = asked ? SF_INIT_POINTS : SF_INIT_AUTO,
                                       .max_gaussians = 1000000,
                                       .random_count = 1,
                                       .opacity = 0.1,
                                       .scale = 1,
                                       .extent = info.extent,
                                       .nearest = 0.01};
            sf_model *model;
            test_log_clear();
            assert_ok(ctx, sf_init_gaussians(is_wrong ? wrong : right, &options, &rng, &model));
            int left_out = is_wrong && !asked;
            assert_int_equal(strstr(test_log, "left out") != NULL, left_out);
            assert_int_equal(model->count == (is_wrong ? POINTS : info.points), !left_out);
            sf_model_destroy(&model);
        }
    sf_scene_destroy(&wrong);
    sf_scene_destroy(&right);
    sf_context_destroy(&ctx);
}

static void test_no_points_to_start_from(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = init_scene_of(ctx, 1);
    sf_init_options options = init_usual;
    options.from = SF_INIT_POINTS;
    sf_rng rng;
    sf_model *model;
    sf_rng_seed(&rng, 1);
    assert_status(ctx, sf_init_gaussians(scene, &options, &rng, &model), SF_ERR_EMPTY);
    assert_null(model);
    assert_error_names(ctx, "first: points");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_at_random),
        cmocka_unit_test(test_random_depths),
        cmocka_unit_test(test_far_points_hide_nothing),
        cmocka_unit_test(test_points_nowhere_cover_nothing),
        cmocka_unit_test(test_random_count_is_capped),
        cmocka_unit_test(test_nothing_to_start_from),
        cmocka_unit_test(test_from_where_asked),
        cmocka_unit_test(test_wrong_points),
        cmocka_unit_test(test_no_points_to_start_from),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
