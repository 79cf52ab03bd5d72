/* test_init.c - distances to the nearest points, and the first Gaussians of a fit. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "scene/init.h"
#include "scene/nearest.h"
#include "scene/random.h"

static const double sh_c0 = 0.28209479177387814;

/* Distances. */

/* Mean distance from point i to its (up to) 3 nearest others, tried one by one in float64. */
static double distance_by_force(const float *points, size_t n, size_t i) {
    double nearest[3] = {INFINITY, INFINITY, INFINITY}, sum = 0;
    int found = 0;
    for (size_t k = 0; k < n; k++) {
        if (k == i) continue;
        double d = 0;
        for (size_t c = 0; c < 3; c++) {
            double off = (double)points[3 * k + c] - (double)points[3 * i + c];
            d += off * off;
        }
        for (int m = 0; m < 3; m++)
            if (d < nearest[m]) {
                double keep = nearest[m];
                nearest[m] = d;
                d = keep;
            }
    }
    for (; found < 3 && nearest[found] < INFINITY; found++) sum += sqrt(nearest[found]);
    return found ? sum / found : 0;
}

/* Every `every`-th point is tried by force. A difference of two floats is off by one rounding, so is each of
 * the few operations after it. */
static void check_distances(const float *points, size_t n, size_t every) {
    sf_context *ctx = test_context();
    float *distances = malloc((n + 1) * sizeof *distances);
    assert_non_null(distances);
    distances[n] = -7;
    assert_ok(ctx, sf_nearest_distances(ctx, points, n, distances));
    for (size_t i = 0; i < n; i += every) {
        double expected = distance_by_force(points, n, i);
        if (!(fabs((double)distances[i] - expected) <= 1e-6 * expected))
            fail_msg("point %zu of %zu: %.9g is not %.9g", i, n, (double)distances[i], expected);
    }
    assert_true(distances[n] == -7);
    free(distances);
    sf_context_destroy(&ctx);
}

typedef void (*place_fn)(sf_rng *rng, size_t i, float *point);

static void place_anywhere(sf_rng *rng, size_t i, float *point) {
    (void)i;
    for (int k = 0; k < 3; k++) point[k] = (float)(20 * sf_rng_uniform(rng) - 10);
}

/* Dense clusters far apart, of very different sizes. */
static void place_in_clusters(sf_rng *rng, size_t i, float *point) {
    static const double size[] = {1e-3, 0.1, 5, 1e-2};
    for (size_t k = 0; k < 3; k++)
        point[k] = (float)(100.0 * (double)((i + k) % 4) + size[i % 4] * sf_rng_normal(rng));
}

static void place_on_few(sf_rng *rng, size_t i, float *point) {
    (void)i;
    for (int k = 0; k < 3; k++) point[k] = (float)sf_rng_below(rng, 4);
}

static void place_on_line(sf_rng *rng, size_t i, float *point) {
    (void)rng;
    for (int k = 0; k < 3; k++) point[k] = (float)(i * i % 1009) * (float)(k + 1);
}

static void place_on_plane(sf_rng *rng, size_t i, float *point) {
    (void)i;
    place_anywhere(rng, i, point);
    point[1] = 3;
}

static void place_in_order(sf_rng *rng, size_t i, float *point) {
    (void)rng;
    point[0] = (float)i, point[1] = point[2] = 0;
}

static void place_at_one(sf_rng *rng, size_t i, float *point) {
    (void)rng, (void)i;
    point[0] = 1, point[1] = 2, point[2] = 3;
}

static float *place(place_fn where, size_t n, uint64_t seed) {
    float *points = malloc((3 * n + 1) * sizeof *points);
    assert_non_null(points);
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    for (size_t i = 0; i < n; i++) where(&rng, i, points + 3 * i);
    return points;
}

static void test_distances(void **state) {
    (void)state;
    static const place_fn all[] = {place_anywhere, place_in_clusters, place_on_few, place_on_line,
                                   place_on_plane, place_in_order,    place_at_one};
    static const size_t counts[] = {0, 1, 2, 3, 4, 5, 8, 9, 10, 17, 18, 100, 513, 700};
    for (size_t w = 0; w < sizeof all / sizeof *all; w++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
            float *points = place(all[w], counts[c], 100 * w + c + 1);
            check_distances(points, counts[c], 1);
            free(points);
        }
}

/* So many that anything quadratic would be felt; all in one place is the worst case of a careless tree. */
static void test_distances_of_many(void **state) {
    (void)state;
    static const place_fn all[] = {place_anywhere, place_in_clusters, place_on_few, place_at_one};
    for (size_t w = 0; w < sizeof all / sizeof *all; w++) {
        float *points = place(all[w], 20000, w + 1);
        check_distances(points, 20000, 457);
        free(points);
    }
}

static void test_distances_by_hand(void **state) {
    (void)state;
    static const float line[5][3] = {{0, 0, 0}, {1, 0, 0}, {3, 0, 0}, {6, 0, 0}, {10, 0, 0}};
    static const float one[] = {0}, two[] = {1, 1}, three[] = {2, 1.5f, 2.5f},
                       five[] = {10 / 3.f, 8 / 3.f, 8 / 3.f, 4, 20 / 3.f};
    static const struct {
        size_t n;
        const float *expected;
    } cases[] = {{1, one}, {2, two}, {3, three}, {5, five}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        float got[5];
        assert_ok(ctx, sf_nearest_distances(ctx, &line[0][0], cases[i].n, got));
        for (size_t k = 0; k < cases[i].n; k++) assert_float_equal(got[k], cases[i].expected[k], 1e-6);
    }
    sf_context_destroy(&ctx);
}

/* Gaussians from points. */

enum { WIDTH = 20, HEIGHT = 16 };

/* Looks at the origin along +x from (-6, 0, 0); `turn` more quarter turns around z. */
static sf_camera camera_around(int turn) {
    static const double forward[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    const double *f = forward[turn % 4];
    return (sf_camera){.width = WIDTH,
                       .height = HEIGHT,
                       .fx = 25,
                       .fy = 24,
                       .cx = 9,
                       .cy = 8.5,
                       .R_cw = {f[1], -f[0], 0, 0, 0, -1, f[0], f[1], 0},
                       .t_cw = {0, 0, 6}};
}

/* Views from four sides, each of one colour. */
static const uint8_t side_colors[4][3] = {{255, 0, 0}, {0, 255, 0}, {10, 20, 30}, {128, 128, 128}};

static sf_scene *scene_of(sf_context *ctx, int views) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0; v < views; v++) {
        sf_camera camera = camera_around(v);
        uint8_t rgb[3 * WIDTH * HEIGHT];
        for (size_t i = 0; i < sizeof rgb; i++) rgb[i] = side_colors[v % 4][i % 3];
        sf_pixels pixels = {.rgb = rgb, .stride = 3 * (size_t)WIDTH};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
    }
    return scene;
}

static const sf_init_options usual = {.max_gaussians = 1000,
                                      .random_count = 300,
                                      .sh_degree = 2,
                                      .opacity = 0.1,
                                      .scale = 0.5,
                                      .extent = 10,
                                      .nearest = 0.4};

/* All that is in a model of degree 2. */
enum { MOST = 1200, COEFFICIENTS = 9 };
typedef struct content {
    size_t count;
    float means[MOST][3], quats[MOST][4], log_scales[MOST][3], logits[MOST], sh[MOST][COEFFICIENTS][3];
} content;

static content *make_first(sf_scene *scene, const sf_init_options *options, uint64_t seed) {
    sf_context *ctx = scene->ctx;
    sf_rng rng;
    sf_model *model;
    sf_rng_seed(&rng, seed);
    assert_ok(ctx, sf_init_gaussians(scene, options, &rng, &model));
    assert_int_equal(sf_model_sh_degree(model), options->sh_degree);
    assert_int_equal(options->sh_degree, 2);
    content *c = calloc(1, sizeof *c);
    assert_non_null(c);
    c->count = sf_model_count(model);
    assert_between(c->count, 0, MOST);
    sf_gaussians to = {&c->means[0][0], &c->quats[0][0], &c->log_scales[0][0], c->logits, &c->sh[0][0][0]};
    assert_ok(ctx, sf_model_get(model, 0, c->count, &to));
    sf_model_destroy(&model);
    return c;
}

static void add_points(sf_scene *scene, place_fn where, size_t n, uint64_t seed) {
    float *xyz = place(where, n, seed);
    uint8_t *rgb = malloc(3 * n);
    assert_non_null(rgb);
    for (size_t i = 0; i < 3 * n; i++) rgb[i] = (uint8_t)(i * 7);
    assert_ok(scene->ctx, sf_scene_add_points(scene, n, xyz, rgb));
    free(xyz);
    free(rgb);
}

/* What every first Gaussian has. */
static void check_common(const content *c, const sf_init_options *options) {
    double logit = log(options->opacity / (1 - options->opacity));
    for (size_t i = 0; i < c->count; i++) {
        assert_memory_equal(c->quats[i], ((float[]){1, 0, 0, 0}), sizeof c->quats[i]);
        assert_float_equal(c->logits[i], logit, 1e-6);
        assert_true(c->log_scales[i][0] == c->log_scales[i][1] && c->log_scales[i][0] == c->log_scales[i][2]);
        for (size_t k = 1; k < COEFFICIENTS; k++)
            for (size_t ch = 0; ch < 3; ch++) assert_true(c->sh[i][k][ch] == 0);
    }
}

static void test_from_points(void **state) {
    (void)state;
    enum { POINTS = 211 };
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx, 1);
    add_points(scene, place_anywhere, POINTS, 5);
    content *c = make_first(scene, &usual, 1);
    float xyz[POINTS][3];
    uint8_t rgb[POINTS][3];
    assert_int_equal(sf_scene_get_points(scene, 0, POINTS, &xyz[0][0], &rgb[0][0]), POINTS);
    assert_int_equal(c->count, POINTS);
    assert_memory_equal(c->means, xyz, sizeof xyz);
    check_common(c, &usual);
    for (size_t i = 0; i < POINTS; i++) {
        double distance = distance_by_force(&xyz[0][0], POINTS, i);
        assert_float_equal(c->log_scales[i][0], log(0.5 * distance), 1e-5);
        for (size_t ch = 0; ch < 3; ch++) /* drawn, it has the point's colour */
            assert_float_equal(0.5 + sh_c0 * (double)c->sh[i][0][ch], rgb[i][ch] / 255.0, 1e-6);
    }
    free(c);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Points in one place, a single one, and some so far apart that they would cover the scene. */
static void test_scales_have_limits(void **state) {
    (void)state;
    static const float far_apart[2][3] = {{-1e6f, 0, 0}, {1e6f, 0, 0}},
                       close[2][3] = {{0, 0, 0}, {1e-9f, 0, 0}};
    static const struct {
        const float *points;
        place_fn where;
        size_t n;
        double scale;
    } cases[] = {{NULL, place_at_one, 9, 0.1}, /* a hundredth of the extent */
                 {NULL, place_at_one, 1, 0.1},
                 {&far_apart[0][0], NULL, 2, 10}, /* the extent */
                 {&close[0][0], NULL, 2, 1e-6}};  /* 1e-7 of it */
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_scene *scene = scene_of(ctx, 1);
        if (cases[i].where)
            add_points(scene, cases[i].where, cases[i].n, 1);
        else
            assert_ok(ctx, sf_scene_add_points(scene, cases[i].n, cases[i].points, NULL));
        sf_init_options options = usual;
        options.from = SF_INIT_POINTS;
        content *c = make_first(scene, &options, 1);
        assert_int_equal(c->count, cases[i].n);
        for (size_t k = 0; k < c->count; k++)
            assert_float_equal(c->log_scales[k][0], log(cases[i].scale), 1e-5);
        free(c);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Whether Gaussian i of `c` is point k: position and colour. */
static int is_point(const content *c, size_t i, const float *xyz, const uint8_t *rgb) {
    int same = memcmp(c->means[i], xyz, 3 * sizeof *xyz) == 0;
    for (size_t ch = 0; ch < 3; ch++)
        same &= fabs(0.5 + sh_c0 * (double)c->sh[i][0][ch] - rgb[ch] / 255.0) < 1e-6;
    return same;
}

/* Too many points: exactly as many as allowed, each once, in their order, the same of any seed. */
static void test_more_points_than_allowed(void **state) {
    (void)state;
    enum { POINTS = 1100 };
    static const size_t allowed[] = {1, 2, 100, POINTS - 1, POINTS, MOST};
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx, 1);
    add_points(scene, place_anywhere, POINTS, 8);
    static float xyz[POINTS][3];
    static uint8_t rgb[POINTS][3];
    assert_int_equal(sf_scene_get_points(scene, 0, POINTS, &xyz[0][0], &rgb[0][0]), POINTS);
    for (size_t a = 0; a < sizeof allowed / sizeof *allowed; a++) {
        sf_init_options options = usual;
        options.max_gaussians = allowed[a];
        content *c = make_first(scene, &options, 1), *same = make_first(scene, &options, 2);
        assert_int_equal(c->count, allowed[a] < POINTS ? allowed[a] : POINTS);
        assert_memory_equal(c, same, sizeof *c);
        size_t found = 0;
        for (size_t k = 0; k < POINTS && found < c->count; k++)
            found += (size_t)is_point(c, found, xyz[k], rgb[k]);
        assert_int_equal(found, c->count);
        free(c);
        free(same);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The choice is spread evenly over space, wherever points stand in the list: of a line, one in five, it
 * leaves no gap of more than ten, and of clusters of different sizes each
 * gets its share. */
static void test_choice_is_even(void **state) {
    (void)state;
    enum { POINTS = 1000, CHOSEN = 200 };
    sf_context *ctx = test_context();
    sf_scene *line = scene_of(ctx, 1), *clusters = scene_of(ctx, 1);
    add_points(line, place_in_order, POINTS, 1);
    add_points(clusters, place_in_clusters, POINTS, 1);
    sf_init_options options = usual;
    options.max_gaussians = CHOSEN;
    content *c = make_first(line, &options, 1);
    assert_true(c->means[0][0] < 5 && c->means[CHOSEN - 1][0] > POINTS - 6);
    for (size_t i = 1; i < CHOSEN; i++) assert_true(c->means[i][0] - c->means[i - 1][0] <= 10);
    free(c);
    c = make_first(clusters, &options, 1);
    size_t of_cluster[4] = {0};
    for (size_t i = 0; i < CHOSEN; i++) of_cluster[(size_t)lroundf(c->means[i][0] / 100) & 3]++;
    for (size_t k = 0; k < 4; k++) assert_between(of_cluster[k], 48, 52);
    free(c);
    sf_scene_destroy(&line);
    sf_scene_destroy(&clusters);
    sf_context_destroy(&ctx);
}

/* Gaussians at random. */

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
            sf_camera camera = camera_around(v);
            double off = 0;
            for (size_t ch = 0; ch < 3; ch++)
                off += fabs(0.5 + sh_c0 * (double)c->sh[i][0][ch] - side_colors[v][ch] / 255.0);
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
        sf_scene *scene = scene_of(ctx, views);
        content *c = make_first(scene, &usual, 1), *same = make_first(scene, &usual, 1),
                *other = make_first(scene, &usual, 2);
        assert_int_equal(c->count, usual.random_count);
        check_common(c, &usual);
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
    sf_scene *scene = scene_of(ctx, 1);
    sf_init_options options = usual;
    options.extent = 6; /* what a single camera is taken to look at */
    content *c = make_first(scene, &options, 1);
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

/* Beside points: a view that has one at depth 6 alone asks about 4.8 to 7.5; a view from the side sees
 * through the far part of that what lies behind it, at depth 9, so that points lie in the near part. */
static void test_random_points_hide_nothing(void **state) {
    (void)state;
    enum { COUNT = 300, ACROSS = 40, DOWN = 30, KNOWN = ACROSS * DOWN + 1 };
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx, 2);
    sf_camera front = camera_around(0), side = camera_around(1);
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
    size_t left = 0;
    assert_between(cloud.n, KNOWN + COUNT / 2, KNOWN + COUNT - 1);
    for (size_t i = KNOWN; i < cloud.n; i++) {
        const float *p = cloud.xyz + 3 * i;
        double deep = (double)p[0] + 6, aside = (double)p[1] + 6;
        double u = side.cx + side.fx * (double)p[0] / aside, v = side.cy - side.fy * (double)p[2] / aside;
        int of_front = sees(&front, p) && deep > 4.79 && deep < 7.51;
        int of_side = sees(&side, p) && aside > 7.19 && aside < 11.26;
        if (!of_front && !of_side) fail_msg("point %zu lies at %.2f and %.2f", i, deep, aside);
        if (aside > 7.19) continue;
        if (u > 10.9 && u < 14.1 && v > 3.5 && v < 13)
            fail_msg("point %zu hangs before what the side sees at %.2f %.2f", i, u, v);
        left += u < 9.8;
    }
    assert_true(left > 20);
    for (size_t v = 0; v < 2; v++) sf_view_release(views[v]);
    sf_cloud_destroy(ctx, &cloud);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_random_count_is_capped(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx, 2);
    sf_init_options options = usual;
    options.max_gaussians = 17;
    content *c = make_first(scene, &options, 1);
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
    sf_scene *scene = scene_of(ctx, 0);
    sf_rng rng;
    sf_model *model;
    sf_rng_seed(&rng, 1);
    assert_ok(ctx, sf_scene_add_points(scene, 1, nowhere, NULL));
    assert_status(ctx, sf_init_gaussians(scene, &usual, &rng, &model), SF_ERR_EMPTY);
    assert_null(model);
    assert_error_names(ctx, "no training view");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* From where, as asked for: points that are there are left alone by the others, and none are missed. */
static void test_from_where_asked(void **state) {
    (void)state;
    static const struct {
        sf_init from;
        size_t points, expected;
    } cases[] = {{SF_INIT_AUTO, 0, 300},     {SF_INIT_AUTO, 99, 300},    {SF_INIT_AUTO, 100, 100},
                 {SF_INIT_POINTS, 5, 5},     {SF_INIT_POINTS, 100, 100}, {SF_INIT_SWEEP, 100, 300},
                 {SF_INIT_RANDOM, 100, 300}, {SF_INIT_RANDOM, 0, 300}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_scene *scene = scene_of(ctx, 4); /* of one colour each: a sweep finds nothing */
        sf_init_options options = usual;
        options.from = cases[i].from;
        add_points(scene, place_anywhere, cases[i].points, 1);
        test_log_clear();
        content *c = make_first(scene, &options, 1);
        assert_int_equal(c->count, cases[i].expected);
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
    sf_scene *scene = scene_of(ctx, 1);
    sf_init_options options = usual;
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
        cmocka_unit_test(test_distances),
        cmocka_unit_test(test_distances_of_many),
        cmocka_unit_test(test_distances_by_hand),
        cmocka_unit_test(test_from_points),
        cmocka_unit_test(test_scales_have_limits),
        cmocka_unit_test(test_more_points_than_allowed),
        cmocka_unit_test(test_choice_is_even),
        cmocka_unit_test(test_at_random),
        cmocka_unit_test(test_random_depths),
        cmocka_unit_test(test_random_points_hide_nothing),
        cmocka_unit_test(test_random_count_is_capped),
        cmocka_unit_test(test_nothing_to_start_from),
        cmocka_unit_test(test_from_where_asked),
        cmocka_unit_test(test_wrong_points),
        cmocka_unit_test(test_no_points_to_start_from),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
