/* test_sweep.c - points found by matching views: near true surfaces, and none where there is nothing to
 * match. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "base/statistics.h"
#include "sim/sim.h"
#include "scene/init.h"
#include "scene/fuse.h"
#include "scene/neighbours.h"
#include "scene/sweep.h"

#define ROOM "sim:studio?width=200&height=150&frames=36"

enum { MOST_VIEWS = 64, WANTED = 3000 };

static void skip_if_quick(void) {
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set, and this matches dozens of pictures");
}

/* The training views of a scene. */
typedef struct held {
    sf_scene *scene;
    sf_view *views[MOST_VIEWS];
    size_t n;
} held;

static void hold(sf_scene *scene, held *h) {
    uint32_t *ids;
    *h = (held){.scene = scene};
    assert_ok(scene->ctx, sf_scene_training_ids(scene, &ids, &h->n));
    assert_between(h->n, 0, MOST_VIEWS);
    for (size_t i = 0; i < h->n; i++) h->views[i] = sf_scene_retain_id(scene, ids[i]);
    sf_free(scene->ctx, ids);
}

static void let_go(held *h) {
    for (size_t i = 0; i < h->n; i++) sf_view_release(h->views[i]);
    sf_scene_destroy(&h->scene);
}

static void hold_simulated(sf_context *ctx, const char *name, held *h) {
    sf_scene *scene;
    sf_load_options options = sf_load_options_default();
    options.hold_out = 0;
    assert_ok(ctx, sf_scene_load(ctx, name, &options, &scene));
    hold(scene, h);
}

static sf_sweep_options sweep_of(sf_scene *scene, size_t wanted) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    return (sf_sweep_options){.wanted = wanted, .nearest = 0.04 * info.extent, .extent = info.extent};
}

static sf_cloud sweep(const held *h, size_t wanted) {
    sf_sweep_options options = sweep_of(h->scene, wanted);
    sf_cloud cloud;
    assert_ok(h->scene->ctx,
              sf_sweep_points(h->scene->ctx, (const sf_view *const *)h->views, h->n, &options, &cloud));
    assert_between(cloud.n, 0, wanted);
    return cloud;
}

/* Where a camera has a point; 0 if not in its picture. */
static int sees(const sf_camera *c, const float *p, double *x, double *y, double *z) {
    double q[3];
    for (int i = 0; i < 3; i++) {
        q[i] = c->t_cw[i];
        for (int k = 0; k < 3; k++) q[i] += c->R_cw[3 * i + k] * (double)p[k];
    }
    *x = c->fx * q[0] / q[2] + c->cx, *y = c->fy * q[1] / q[2] + c->cy, *z = q[2];
    return q[2] > 0 && *x > 0 && *y > 0 && *x < c->width && *y < c->height;
}

/* How far a point lies off the surface, as a share of its distance: the median of the views from which
 * nothing hides it. INFINITY if all is in front of it. */
static double error_of(const held *h, const sf_studio *studio, const float *p) {
    double errors[MOST_VIEWS];
    size_t n = 0;
    for (size_t i = 0; i < h->n; i++) {
        const sf_camera *c = &h->views[i]->camera;
        double x, y, z, center[3], distance = 0;
        if (!sees(c, p, &x, &y, &z)) continue;
        sf_hit hit;
        sf_studio_look(studio, c, x, y, &hit);
        sf_camera_center(c, center);
        for (int k = 0; k < 3; k++) distance += ((double)p[k] - center[k]) * ((double)p[k] - center[k]);
        double off = sqrt(distance) / hit.distance - 1;
        if (off < 0.05) errors[n++] = fabs(off);
    }
    return n ? sf_median(errors, n) : INFINITY;
}

/* At 200 x 150: five of six points within 2 % of their distance, half of them within 1 %. */
static void test_points_lie_on_surfaces(void **state) {
    (void)state;
    skip_if_quick();
    sf_context *ctx = test_context();
    held h;
    sf_sim sim;
    hold_simulated(ctx, ROOM, &h);
    assert_ok(ctx, sf_sim_init(ctx, ROOM, &sim));
    sf_cloud cloud = sweep(&h, WANTED);
    double *errors = malloc((cloud.n + 1) * sizeof *errors);
    assert_non_null(errors);
    size_t close = 0;
    for (size_t i = 0; i < cloud.n; i++) {
        errors[i] = error_of(&h, &sim.studio, cloud.xyz + 3 * i);
        close += errors[i] <= 0.02;
    }
    qsort(errors, cloud.n, sizeof *errors, sf_compare_doubles);
    print_message("%zu points, %.3f within 2 %%, error: half %.4f, nine of ten %.4f, 0.99 %.4f\n", cloud.n,
                  (double)close / (double)cloud.n, errors[cloud.n / 2], errors[cloud.n * 9 / 10],
                  errors[cloud.n * 99 / 100]);
    assert_true(cloud.n > WANTED / 2);
    assert_true((double)close >= 5.0 / 6 * (double)cloud.n);
    assert_true(errors[cloud.n / 2] <= 0.01);
    free(errors);
    sf_cloud_destroy(ctx, &cloud);
    let_go(&h);
    sf_context_destroy(&ctx);
}

static void assert_none(const held *h) {
    sf_cloud cloud = sweep(h, WANTED);
    assert_int_equal(cloud.n, 0);
    sf_cloud_destroy(h->scene->ctx, &cloud);
}

/* The views of `h` with the pixels that `paint` makes of theirs, and its masks. */
typedef void (*paint_fn)(const sf_view *view, size_t x, size_t y, uint8_t *rgb, uint8_t *mask);

static void repaint(const held *h, paint_fn paint, int with_mask, held *out) {
    sf_scene *scene;
    sf_context *ctx = h->scene->ctx;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (size_t i = 0; i < h->n; i++) {
        const sf_view *view = h->views[i];
        size_t width = (size_t)view->camera.width, pixels = width * (size_t)view->camera.height;
        uint8_t *rgb = malloc(3 * pixels), *mask = malloc(pixels);
        assert_true(rgb && mask);
        for (size_t k = 0; k < pixels; k++) {
            for (size_t ch = 0; ch < 3; ch++) rgb[3 * k + ch] = view->rgb[ch * pixels + k];
            mask[k] = 255;
            paint(view, k % width, k / width, rgb + 3 * k, mask + k);
        }
        sf_pixels given = {.rgb = rgb, .stride = 3 * width, .mask = with_mask ? mask : NULL};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &view->camera, &given, SF_SPLIT_TRAIN, NULL));
        free(rgb);
        free(mask);
    }
    hold(scene, out);
}

static void paint_flat(const sf_view *view, size_t x, size_t y, uint8_t *rgb, uint8_t *mask) {
    (void)view, (void)x, (void)y, (void)mask;
    rgb[0] = 200, rgb[1] = 120, rgb[2] = 40;
}

/* From dark to light by less than the noise of a window. */
static void paint_faint(const sf_view *view, size_t x, size_t y, uint8_t *rgb, uint8_t *mask) {
    (void)mask;
    rgb[0] = rgb[1] = rgb[2] = (uint8_t)(100 + (x + y) / 8 + view->id % 2);
}

static void paint_noise(const sf_view *view, size_t x, size_t y, uint8_t *rgb, uint8_t *mask) {
    (void)mask;
    sf_rng rng;
    sf_rng_seed(&rng, ((uint64_t)view->id * 1000 + y) * 1000 + x);
    rgb[0] = rgb[1] = rgb[2] = (uint8_t)sf_rng_below(&rng, 256);
}

static void mask_all(const sf_view *view, size_t x, size_t y, uint8_t *rgb, uint8_t *mask) {
    (void)view, (void)x, (void)y, (void)rgb;
    *mask = 0;
}

static int in_left_half(const sf_camera *camera, double x) { return x < camera->width / 2.0; }

static void mask_left_half(const sf_view *view, size_t x, size_t y, uint8_t *rgb, uint8_t *mask) {
    (void)y, (void)rgb;
    if (in_left_half(&view->camera, (double)x)) *mask = 0;
}

#define SMALL_ROOM "sim:studio?width=120&height=90&frames=24"

static void test_nothing_to_match(void **state) {
    (void)state;
    static const paint_fn paints[] = {paint_flat, paint_faint, mask_all};
    sf_context *ctx = test_context();
    held room, h;
    hold_simulated(ctx, SMALL_ROOM, &room);
    for (size_t i = 0; i < sizeof paints / sizeof *paints; i++) {
        repaint(&room, paints[i], paints[i] == mask_all, &h);
        assert_none(&h);
        let_go(&h);
    }
    repaint(&room, paint_noise, 0, &h); /* textured, but each view of something else */
    sf_cloud cloud = sweep(&h, WANTED);
    assert_between(cloud.n, 0, 20);
    sf_cloud_destroy(ctx, &cloud);
    let_go(&h);
    let_go(&room);
    sf_context_destroy(&ctx);
}

static uint8_t blue_of(const sf_view *view) { return (uint8_t)(10 + 9 * view->id); }

static void paint_name(const sf_view *view, size_t x, size_t y, uint8_t *rgb, uint8_t *mask) {
    (void)x, (void)y, (void)mask;
    rgb[2] = blue_of(view);
}

/* A point says whose colour it has. */
static void test_colors_of_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    held room, h;
    size_t others = 0;
    hold_simulated(ctx, SMALL_ROOM, &room);
    repaint(&room, paint_name, 0, &h);
    h.n = 4; /* fewer pictures to match */
    sf_cloud cloud = sweep(&h, WANTED);
    assert_true(cloud.n > 50);
    for (size_t i = 0; i < cloud.n; i++) {
        assert_between(cloud.view[i], 0, h.n - 1);
        assert_int_equal(cloud.rgb[3 * i + 2], blue_of(h.views[cloud.view[i]]));
        others += cloud.view[i] > 0;
    }
    assert_between(others, 1, cloud.n - 1);
    sf_cloud_destroy(ctx, &cloud);
    h.n = room.n;
    let_go(&h);
    let_go(&room);
    sf_context_destroy(&ctx);
}

static void test_too_few_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    held h;
    hold_simulated(ctx, SMALL_ROOM, &h);
    size_t n = h.n;
    sf_sweep_options options = sweep_of(h.scene, WANTED);
    for (h.n = 0; h.n < 2; h.n++) assert_none(&h);
    /* the same view again and again, from one place */
    const sf_view *same[] = {h.views[0], h.views[0], h.views[0]};
    sf_cloud cloud;
    assert_ok(ctx, sf_sweep_points(ctx, same, 3, &options, &cloud));
    assert_int_equal(cloud.n, 0);
    sf_cloud_destroy(ctx, &cloud);
    h.n = 2; /* but two are enough */
    cloud = sweep(&h, WANTED);
    assert_true(cloud.n > 50);
    sf_cloud_destroy(ctx, &cloud);
    h.n = n;
    let_go(&h);
    sf_context_destroy(&ctx);
}

static void test_bad_options(void **state) {
    (void)state;
    static const sf_sweep_options bad[] = {
        {0, 1, 1, 0}, {9, 0, 1, 0}, {9, 1, 0, 0}, {9, NAN, 1, 0}, {9, 1, -1, 0}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        sf_cloud cloud;
        assert_status(ctx, sf_sweep_points(ctx, NULL, 0, &bad[i], &cloud), SF_ERR_ARGUMENT);
        assert_error_names(ctx, "sweep");
        assert_null(cloud.xyz);
    }
    sf_context_destroy(&ctx);
}

/* Points that fewer than two views show outside of their left half. */
static size_t count_on_the_left(const held *h, const sf_cloud *cloud) {
    size_t count = 0;
    for (size_t i = 0; i < cloud->n; i++) {
        int outside = 0;
        for (size_t k = 0; k < h->n; k++) {
            const sf_camera *c = &h->views[k]->camera;
            double x, y, z;
            outside += sees(c, cloud->xyz + 3 * i, &x, &y, &z) && !in_left_half(c, x);
        }
        count += outside < 2;
    }
    return count;
}

static void test_masked_pixels_are_not_matched(void **state) {
    (void)state;
    skip_if_quick();
    sf_context *ctx = test_context();
    held room, masked;
    hold_simulated(ctx, SMALL_ROOM, &room);
    repaint(&room, mask_left_half, 1, &masked);
    /* four views of one side, so that there are things that only left halves show */
    size_t room_n = room.n, masked_n = masked.n;
    room.n = masked.n = 4;
    sf_cloud all = sweep(&room, WANTED), some = sweep(&masked, WANTED);
    assert_true(count_on_the_left(&room, &all) > 100);
    assert_int_equal(count_on_the_left(&masked, &some), 0);
    assert_true(some.n > 100);
    sf_cloud_destroy(ctx, &all);
    sf_cloud_destroy(ctx, &some);
    room.n = room_n;
    masked.n = masked_n;
    let_go(&room);
    let_go(&masked);
    sf_context_destroy(&ctx);
}

/* Also of the first view's alone, of which there are more than among all. */
static void test_wanted_is_the_most(void **state) {
    (void)state;
    skip_if_quick();
    static const size_t wanted[] = {1, 2, 30, 1000};
    sf_context *ctx = test_context();
    held h;
    hold_simulated(ctx, SMALL_ROOM, &h);
    sf_sweep_options options = sweep_of(h.scene, WANTED);
    sf_cloud first, all = sweep(&h, WANTED);
    int more = 0;
    options.first_alone = 1;
    assert_ok(ctx, sf_sweep_points(ctx, (const sf_view *const *)h.views, h.n, &options, &first));
    for (size_t i = 0; i < first.n; i++) more += first.view[i] == 0;
    for (size_t i = 0; i < all.n; i++) more -= all.view[i] == 0;
    assert_true(first.n > 50 && first.n < all.n && more >= 0);
    sf_cloud_destroy(ctx, &first), sf_cloud_destroy(ctx, &all);
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        sf_cloud cloud = sweep(&h, wanted[i]);
        assert_true(2 * cloud.n > wanted[i]); /* and not much less */
        sf_cloud_destroy(ctx, &cloud);
    }
    let_go(&h);
    sf_context_destroy(&ctx);
}

static void test_same_bytes(void **state) {
    (void)state;
    skip_if_quick();
    static const int threads[] = {1, 2, 4};
    sf_cloud first = {0};
    sf_context *first_ctx = NULL;
    for (size_t i = 0; i < sizeof threads / sizeof *threads; i++) {
        sf_context *ctx = test_context_threads(threads[i]);
        held h;
        hold_simulated(ctx, SMALL_ROOM, &h);
        sf_cloud cloud = sweep(&h, WANTED);
        let_go(&h);
        if (!i) {
            assert_true(cloud.n > 500);
            first = cloud;
            first_ctx = ctx;
            continue;
        }
        assert_int_equal(cloud.n, first.n);
        assert_memory_equal(cloud.xyz, first.xyz, 3 * cloud.n * sizeof *cloud.xyz);
        assert_memory_equal(cloud.rgb, first.rgb, 3 * cloud.n);
        sf_cloud_destroy(ctx, &cloud);
        sf_context_destroy(&ctx);
    }
    sf_cloud_destroy(first_ctx, &first);
    sf_context_destroy(&first_ctx);
}

static void test_every_allocation_may_fail(void **state) {
    (void)state;
    test_allocations c = {0};
    const sf_allocator allocator = {test_count_alloc, test_count_free, &c};
    sf_context_options options = {.allocator = &allocator, .threads = 2};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    held h;
    hold_simulated(ctx, "sim:studio?width=48&height=36&frames=6", &h);
    sf_sweep_options sweep_options = sweep_of(h.scene, WANTED);
    long idle = c.live, failures = 0;
    for (sf_status status = SF_ERR_MEMORY; status;) {
        sf_cloud cloud;
        c.fail_at = c.calls + failures + 1;
        status = sf_sweep_points(ctx, (const sf_view *const *)h.views, h.n, &sweep_options, &cloud);
        if (status) {
            assert_status(ctx, status, SF_ERR_MEMORY);
            assert_null(cloud.xyz);
            assert_int_equal(cloud.n, 0);
            failures++;
        }
        sf_cloud_destroy(ctx, &cloud);
        assert_int_equal(c.live, idle);
    }
    assert_true(failures > 20);
    c.fail_at = 0;
    let_go(&h);
    sf_context_destroy(&ctx);
    assert_int_equal(c.live, 0);
}

/* Cameras on a circle that look at its middle: neighbours stand on both sides, none opposite. */
static void test_neighbours_on_a_circle(void **state) {
    (void)state;
    enum { CAMERAS = 40, NEIGHBOURS = 3 };
    const double pi = 3.141592653589793;
    sf_camera cameras[CAMERAS];
    const sf_camera *pointers[CAMERAS];
    for (int i = 0; i < CAMERAS; i++) {
        double s = sin(2 * pi * i / CAMERAS), c = cos(2 * pi * i / CAMERAS);
        cameras[i] = (sf_camera){.width = 100,
                                 .height = 80,
                                 .fx = 100,
                                 .fy = 100,
                                 .cx = 50,
                                 .cy = 40,
                                 .R_cw = {c, 0, -s, 0, 1, 0, s, 0, c},
                                 .t_cw = {0, 0, 5}};
        pointers[i] = &cameras[i];
    }
    double focus[3];
    sf_focus_point(pointers, CAMERAS, focus);
    for (int k = 0; k < 3; k++) assert_true(fabs(focus[k]) < 1e-9);
    for (size_t i = 0; i < CAMERAS; i++) {
        size_t chosen[NEIGHBOURS];
        int left = 0, right = 0;
        assert_true(fabs(sf_look_distance(&cameras[i], focus, 1) - 5) < 1e-9);
        assert_int_equal(sf_choose_neighbours(pointers, CAMERAS, i, 5, NEIGHBOURS, chosen), NEIGHBOURS);
        for (size_t k = 0; k < NEIGHBOURS; k++) {
            size_t around = (chosen[k] + CAMERAS - i) % CAMERAS;
            assert_true(around > 0 && (around <= 4 || around >= CAMERAS - 4));
            left += around <= 4, right += around > 4;
        }
        assert_true(left && right);
    }
    /* a camera alone, and one that looks away */
    size_t chosen[NEIGHBOURS];
    assert_int_equal(sf_choose_neighbours(pointers, 1, 0, 5, NEIGHBOURS, chosen), 0);
    const sf_camera *opposite[] = {&cameras[0], &cameras[CAMERAS / 2]};
    assert_int_equal(sf_choose_neighbours(opposite, 2, 0, 5, NEIGHBOURS, chosen), 0);
}

/* A depth counts if all but one of the neighbours that see the place have the same, and one at least: a wall
 * at 4, cameras 1 apart in a row, so that a point is 4 px farther left in each. */
static void test_who_confirms(void **state) {
    (void)state;
    enum { CAMERAS = 4, WIDTH = 16, HEIGHT = 2, PIXELS = WIDTH * HEIGHT };
    static const struct {
        int column, agree[CAMERAS]; /* of the first camera; which of the others agree */
        size_t points;
    } cases[] = {{14, {1, 1, 1, 1}, 1}, {14, {1, 1, 0, 1}, 1}, {14, {1, 1, 0, 0}, 0},
                 {9, {1, 1, 1, 0}, 1},  {9, {1, 0, 1, 0}, 1},  {9, {1, 0, 0, 0}, 0},
                 {5, {1, 1, 0, 0}, 1},  {5, {1, 0, 1, 1}, 0},  {2, {1, 1, 1, 1}, 0}};
    static uint8_t rgb[3 * PIXELS];
    sf_context *ctx = test_context();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        sf_view views[CAMERAS];
        sf_seen seen[CAMERAS];
        float inverse_depth[CAMERAS][PIXELS], score[PIXELS];
        for (int i = 0; i < PIXELS; i++) score[i] = i == cases[k].column;
        for (int v = 0; v < CAMERAS; v++) {
            sf_camera camera = {.width = WIDTH, .height = HEIGHT, .fx = 16, .fy = 16, .cx = 8, .cy = 1};
            for (int i = 0; i < 3; i++) camera.R_cw[4 * i] = 1;
            camera.t_cw[0] = -v;
            for (int i = 0; i < PIXELS; i++) inverse_depth[v][i] = cases[k].agree[v] ? 0.25f : 0.2f;
            views[v] = (sf_view){.camera = camera, .rgb = rgb};
            seen[v] = (sf_seen){.view = &views[v],
                                .grey = {.camera = camera, .factor = 1},
                                .inverse_depth = inverse_depth[v],
                                .score = score,
                                .neighbour = {1, 2, 3},
                                .neighbours = v ? 0 : CAMERAS - 1};
        }
        sf_cloud cloud;
        assert_ok(ctx, sf_fuse(ctx, seen, CAMERAS, 10, &cloud));
        if (cloud.n != cases[k].points) fail_msg("case %zu: %zu points", k, cloud.n);
        if (cloud.n) assert_true(fabs((double)cloud.xyz[2] - 4) < 1e-5);
        sf_cloud_destroy(ctx, &cloud);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_points_lie_on_surfaces),
        cmocka_unit_test(test_nothing_to_match),
        cmocka_unit_test(test_colors_of_views),
        cmocka_unit_test(test_too_few_views),
        cmocka_unit_test(test_bad_options),
        cmocka_unit_test(test_masked_pixels_are_not_matched),
        cmocka_unit_test(test_wanted_is_the_most),
        cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_every_allocation_may_fail),
        cmocka_unit_test(test_neighbours_on_a_circle),
        cmocka_unit_test(test_who_confirms),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
