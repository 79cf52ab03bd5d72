/* row_units.c - rows L1 to L4: what has a length, where cameras are close together, far apart, or far from 0.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "fits.h"
#include "scene/gaussians.h"
#include "scene/scene.h"
#include "sim/sim.h"

#define STUDIO "sim:studio?width=120&height=90&frames=40"
enum { WIDTH = 120, HEIGHT = 90, STEPS = 800, GAUSSIANS = 6000 };

static const stab_axis psnr_axis = {"held-out PSNR (dB)", 0};

/* 1.1 times the largest distance of a training camera from their mean: what is usually taken as the scene's
 * size, and as the unit of the means' rate, of the largest scale and of the near plane. */
static double textbook_extent(sf_scene *scene) {
    sf_view_info view;
    double mean[3] = {0}, center[3], largest = 0, count = 0;
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++) {
            if (view.split != SF_SPLIT_TRAIN) continue;
            sf_camera_center(&view.camera, center);
            double square = 0;
            for (int k = 0; k < 3; k++) square += pow(center[k] - mean[k] / fmax(count, 1), 2);
            if (pass) largest = fmax(largest, sqrt(square));
            for (int k = 0; k < 3 && !pass; k++) mean[k] += center[k];
            count += !pass;
        }
    return 1.1 * largest;
}

/* The same options with lengths in that extent, for Gaussians at the scene's typical depth. */
static sf_fit_options textbook_options(sf_scene *scene, const sf_fit_options *ours) {
    sf_fit_options options = *ours;
    sf_scene_info info;
    sf_view_info view;
    sf_scene_get_info(scene, &info);
    assert_int_equal(sf_scene_get_view(scene, 0, &view), SF_OK);
    double extent = fmax(textbook_extent(scene), 1e-9);
    double half = 0.5 * sqrt(view.camera.width * view.camera.height / (view.camera.fx * view.camera.fy));
    double units = extent / (info.extent * half);
    options.lr_mean = fmin(4.5e-4 * units, 1);
    options.max_scale = fmin(units, 1e9);
    options.near_plane = fmin(0.04 * extent / info.extent, 1e3);
    return options;
}

/* Held-out PSNR of a fit, by ours and by the textbook's lengths. */
static void fit_both(sf_context *ctx, sf_scene *scene, double psnr[2]) {
    sf_fit_options options = stab_fit_options(STEPS, GAUSSIANS);
    sf_fit_options textbook = textbook_options(scene, &options);
    psnr[0] = stab_fit_scene(ctx, scene, &options, 0, NULL).quality.psnr;
    psnr[1] = stab_fit_scene(ctx, scene, &textbook, 0, NULL).quality.psnr;
}

/* Reports a case of several, and keeps it for the chart. */
static void report(stab_run *run, const char *name, const double psnr[2], double least) {
    stab_at_least(run, psnr[0], least, "dB", "%s: held-out PSNR", name);
    stab_textbook(run, psnr[1]);
}

static void chart(stab_run *run, const char *title, stab_axis x, const double *at, double psnr[][2],
                  size_t n) {
    stab_chart_begin(run, title, x, psnr_axis);
    for (int textbook = 0; textbook < 2; textbook++) {
        stab_series_begin(run, textbook ? STAB_TEXTBOOK : STAB_OURS, "%s",
                          textbook ? "textbook: lengths in the cameras' extent"
                                   : "lengths at each Gaussian's depth");
        for (size_t i = 0; i < n; i++) stab_point(run, at[i], psnr[i][textbook]);
    }
}

/* ---- L1: cameras that turn in one place ---- */

/* Looks from near the studio's middle to all sides. */
static sf_camera turning_camera(size_t view, size_t views, double noise, sf_rng *rng) {
    const double focal = 0.5 * WIDTH / tan(0.5236), angle = 6.283185307179586 * (double)view / (double)views;
    sf_camera camera = {
        .width = WIDTH, .height = HEIGHT, .fx = focal, .fy = focal, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    const double right[3] = {cos(angle), -sin(angle), 0}, ahead[3] = {sin(angle), cos(angle), 0};
    double at[3] = {0, -1, 1.6};
    for (int k = 0; k < 3; k++) at[k] += noise * sf_rng_normal(rng);
    test_turn_camera(&camera, right, ahead);
    for (int j = 0; j < 3; j++)
        camera.t_cw[j] =
            -(camera.R_cw[3 * j] * at[0] + camera.R_cw[3 * j + 1] * at[1] + camera.R_cw[3 * j + 2] * at[2]);
    return camera;
}

/* Every n-th point of a scene, moved. */
static void copy_points(sf_context *ctx, sf_scene *from, sf_scene *to, size_t every, const double move[3]) {
    sf_scene_info info;
    sf_scene_get_info(from, &info);
    float *xyz = malloc(3 * info.points * sizeof *xyz);
    uint8_t *rgb = malloc(3 * info.points);
    assert_true(xyz && rgb);
    assert_int_equal(sf_scene_get_points(from, 0, info.points, xyz, rgb), info.points);
    size_t count = 0;
    for (size_t i = 0; i < info.points; i += every, count++)
        for (size_t k = 0; k < 3; k++) {
            xyz[3 * count + k] = (float)((double)xyz[3 * i + k] + move[k]);
            rgb[3 * count + k] = rgb[3 * i + k];
        }
    assert_ok(ctx, sf_scene_add_points(to, count, xyz, rgb));
    free(xyz);
    free(rgb);
}

static sf_scene *turning_scene(sf_context *ctx, double noise) {
    enum { VIEWS = 40 };
    static const double nowhere[3];
    static uint8_t bytes[3 * WIDTH * HEIGHT];
    sf_sim sim;
    sf_rng rng;
    sf_scene *scene, *studio = stab_load(ctx, STUDIO, 8, 1);
    sf_rng_seed(&rng, 1);
    assert_ok(ctx, sf_sim_init(ctx, STUDIO, &sim));
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (size_t i = 0; i < VIEWS; i++) {
        sf_camera camera = turning_camera(i, VIEWS, noise, &rng);
        sf_pixels pixels = {.rgb = bytes, .stride = 3 * WIDTH};
        stab_draw_studio(ctx, &sim, &camera, bytes);
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels,
                                         i % 8 ? SF_SPLIT_TRAIN : SF_SPLIT_TEST, NULL));
    }
    copy_points(ctx, studio, scene, 1, nowhere);
    sf_scene_destroy(&studio);
    return scene;
}

static void turning(stab_run *run) {
    static const double noises[] = {0, 0.001, 0.03, 0.1, 1};
    enum { CASES = sizeof noises / sizeof *noises };
    double psnr[CASES][2];
    char name[STAB_TEXT];
    sf_context *ctx = test_context();
    for (size_t i = 0; i < CASES; i++) {
        sf_scene *scene = turning_scene(ctx, noises[i]);
        fit_both(ctx, scene, psnr[i]);
        snprintf(name, sizeof name, "turning, centres apart by %g", noises[i]);
        report(run, name, psnr[i], i < 3 ? psnr[0][0] - 2 : 15);
        sf_scene_destroy(&scene);
    }
    chart(run, "Cameras that turn in one place",
          (stab_axis){"standard deviation of the centres (world units)", 1}, noises, psnr, CASES);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_L1 = {
    .id = "L1",
    .failure = "Cameras close together: the extent of their centres is no size of the scene",
    .cure = "Rates and limits are in half pictures at each Gaussian's depth; the near plane follows each "
            "view's content.",
    .run = turning,
};

/* ---- L2: cameras far from all others ---- */

static void put_far(void *distance, size_t number, sf_camera *camera, uint8_t *rgb) {
    const double *d = distance;
    (void)rgb;
    if (number == 13) camera->t_cw[0] += d[0];
    if (number == 29) camera->t_cw[1] -= d[1];
}

static void far_cameras(stab_run *run) {
    static const double distances[][2] = {{0, 0}, {10, 0}, {40, 0}, {100, 0}, {500, 0}, {1e5, 0}, {100, 100}};
    enum { CASES = sizeof distances / sizeof *distances };
    double psnr[CASES][2], at[CASES];
    char name[STAB_TEXT];
    sf_context *ctx = test_context();
    for (size_t i = 0; i < CASES; i++) {
        double d[2] = {distances[i][0], distances[i][1]};
        sf_scene *scene = test_changed_scene(ctx, STUDIO, put_far, d);
        fit_both(ctx, scene, psnr[i]);
        at[i] = fmax(d[0], 1);
        snprintf(name, sizeof name, "%s away by %g", d[1] > 0 ? "two cameras" : "one camera", d[0]);
        report(run, name, psnr[i], psnr[0][0] - 0.5);
        sf_scene_destroy(&scene);
    }
    chart(run, "One camera of 35 far away", (stab_axis){"distance (world units; 1: none)", 1}, at, psnr,
          CASES - 1);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_L2 = {
    .id = "L2",
    .failure = "One camera far from all others makes every length too large",
    .cure =
        "The scene's size is a median; a far camera is named, and trained on only where its picture fits.",
    .run = far_cameras,
};

/* ---- L3: places along a street ---- */

enum { PLACES = 12, PLACE_VIEWS = 12, APART = 40 };

/* Every n-th view of the studio, from place `place` on of the street; more: views are added to `scene`. */
static void add_place(sf_context *ctx, sf_scene *studio, int place, sf_scene *scene) {
    static float rgb[3 * WIDTH * HEIGHT];
    static uint8_t bytes[3 * WIDTH * HEIGHT];
    const double move[3] = {(double)APART * place, 0, 0};
    for (int v = 0; v < PLACE_VIEWS; v++) {
        sf_view_info view = test_view_info(studio, (size_t)(v * 40 / PLACE_VIEWS));
        assert_ok(ctx, sf_scene_get_pixels(studio, view.id, rgb, NULL));
        for (size_t p = 0; p < 3 * WIDTH * HEIGHT; p++) bytes[p] = (uint8_t)lroundf(255 * rgb[p]);
        for (int j = 0; j < 3; j++) view.camera.t_cw[j] -= view.camera.R_cw[3 * j] * move[0];
        sf_pixels pixels = {.rgb = bytes, .stride = 3 * WIDTH};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &view.camera, &pixels,
                                         v % 6 == 3 ? SF_SPLIT_TEST : SF_SPLIT_TRAIN, NULL));
    }
    copy_points(ctx, studio, scene, 24, move);
}

static void street(stab_run *run) {
    double at[PLACES], alone[PLACES], together[PLACES][2], worst[2] = {-INFINITY, -INFINITY};
    sf_context *ctx = test_context();
    sf_scene *studio = stab_load(ctx, STUDIO, 8, 1), *scene, *place;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int p = 0; p < PLACES; p++) add_place(ctx, studio, p, scene);
    sf_fit_options options = stab_fit_options(3 * STEPS, PLACES * GAUSSIANS / 2),
                   textbook = textbook_options(scene, &options);
    sf_fitter *fitters[2];
    (void)stab_fit_scene(ctx, scene, &options, 0, &fitters[0]);
    (void)stab_fit_scene(ctx, scene, &textbook, 0, &fitters[1]);
    options = stab_fit_options(STEPS, GAUSSIANS / 2);
    for (int p = 0; p < PLACES; p++) {
        assert_ok(ctx, sf_scene_create(ctx, &place));
        add_place(ctx, studio, p, place);
        alone[p] = p % 4 ? alone[p - 1]
                         : stab_fit_scene(ctx, place, &options, 0, NULL).quality.psnr; /* all are alike */
        for (int k = 0; k < 2; k++) together[p][k] = test_held_out(ctx, place, fitters[k]).psnr;
        for (int k = 0; k < 2; k++) worst[k] = fmax(worst[k], alone[p] - together[p][k]);
        at[p] = p;
        sf_scene_destroy(&place);
    }
    stab_at_most(run, worst[0], 2, "dB", "street of %d places: the worst place under what it has alone",
                 (int)PLACES);
    stab_textbook(run, worst[1]);
    chart(run, "A street of 12 places", (stab_axis){"place (1)", 0}, at, together, PLACES);
    stab_series_begin(run, STAB_OURS, "each alone");
    for (int p = 0; p < PLACES; p++) stab_point(run, at[p], alone[p]);
    for (int k = 0; k < 2; k++) sf_fitter_destroy(&fitters[k]);
    sf_scene_destroy(&scene);
    sf_scene_destroy(&studio);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_L3 = {
    .id = "L3",
    .failure = "Many places in one scene: each is small beside the extent of the cameras",
    .cure = "As L1; what a camera looks at is found from the cameras near it.",
    .run = street,
};

/* ---- L4: the same world in another unit, or with other axes ---- */

typedef struct change {
    int power, axes; /* times 2^power; x, y, z become z, x, y */
} change;

static sf_scene *changed_world(sf_context *ctx, change to) {
    sf_scene *scene = stab_load(ctx, STUDIO, 8, 1);
    for (size_t i = 0; i < scene->view_count; i++) {
        sf_camera *c = &scene->views[i]->camera;
        for (int k = 0; k < 3; k++) {
            double row[3] = {c->R_cw[3 * k], c->R_cw[3 * k + 1], c->R_cw[3 * k + 2]};
            c->t_cw[k] = ldexp(c->t_cw[k], to.power);
            for (int j = 0; j < 3; j++) c->R_cw[3 * k + (j + to.axes) % 3] = row[j];
        }
    }
    for (size_t i = 0; i < scene->point_count; i++) {
        float *p = scene->points + 3 * i, was[3] = {p[0], p[1], p[2]};
        for (int j = 0; j < 3; j++) p[(j + to.axes) % 3] = ldexpf(was[j], to.power);
    }
    return scene;
}

typedef struct world_fit {
    float *pictures; /* of the held-out views, one after another */
    size_t values;
    double psnr;
    sf_model *model;
} world_fit;

static world_fit fit_world(sf_context *ctx, change to, int64_t steps) {
    enum { HELD_OUT = 5 };
    sf_fit_options options = stab_fit_options(steps, 9000); /* all points of the studio have room */
    sf_fitter *fitter;
    sf_view_info view;
    sf_scene *scene = changed_world(ctx, to);
    world_fit w = {.pictures = malloc(HELD_OUT * 3 * sizeof(float) * WIDTH * HEIGHT)};
    assert_non_null(w.pictures);
    w.psnr = stab_fit_scene(ctx, scene, &options, 0, &fitter).quality.psnr;
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++) {
        if (view.split != SF_SPLIT_TEST) continue;
        assert_ok(ctx, sf_fitter_render(fitter, &view.camera, &(sf_image_out){.rgb = w.pictures + w.values}));
        w.values += 3 * WIDTH * HEIGHT;
    }
    assert_ok(ctx, sf_fitter_snapshot(fitter, &w.model));
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    return w;
}

static void free_world(world_fit *w) {
    free(w->pictures);
    sf_model_destroy(&w->model);
}

static double largest_difference(const float *a, const float *b, size_t n) {
    double most = 0;
    for (size_t i = 0; i < n; i++) most = fmax(most, fabs((double)a[i] - (double)b[i]));
    return most;
}

/* How many of n values differ by more than 1e-4. */
static size_t count_apart(const float *a, const float *b, size_t n) {
    size_t count = 0;
    for (size_t i = 0; i < n; i++) count += fabs((double)a[i] - (double)b[i]) > 1e-4;
    return count;
}

/* The model, with its axes turned, from the cameras with their axes turned: how many of a million values of
 * its pictures change by more than 1e-4. */
static double turned_apart(sf_context *ctx, const world_fit *plain, int axes) {
    sf_similarity motion = {.scale = 1};
    float *picture = malloc(3 * sizeof *picture * WIDTH * HEIGHT);
    size_t at = 0, apart = 0;
    sf_view_info view;
    sf_renderer *renderer;
    sf_model *model;
    sf_scene *scene = changed_world(ctx, (change){0, axes});
    assert_non_null(picture);
    for (int j = 0; j < 3; j++) motion.R[3 * ((j + axes) % 3) + j] = 1;
    assert_ok(ctx, sf_model_copy(plain->model, sf_model_count(plain->model), &model));
    assert_ok(ctx, sf_model_transform(model, &motion));
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++) {
        if (view.split != SF_SPLIT_TEST) continue;
        assert_ok(ctx, sf_render(renderer, model, &view.camera, NULL, &(sf_image_out){.rgb = picture}));
        apart += count_apart(picture, plain->pictures + at, 3 * WIDTH * HEIGHT);
        at += 3 * WIDTH * HEIGHT;
    }
    sf_renderer_destroy(&renderer);
    sf_model_destroy(&model);
    sf_scene_destroy(&scene);
    free(picture);
    return 1e6 * (double)apart / (double)at;
}

static void worlds(stab_run *run) {
    static const int powers[] = {-20, -7, -1, 1, 7, 20};
    sf_context *ctx = test_context();
    world_fit plain = fit_world(ctx, (change){0, 0}, STEPS);
    for (size_t i = 0; i < sizeof powers / sizeof *powers; i++) {
        world_fit other = fit_world(ctx, (change){powers[i], 0}, STEPS);
        stab_at_most(run, largest_difference(plain.pictures, other.pictures, plain.values), 0, "",
                     "times 2^%d: pictures apart after %d steps", powers[i], (int)STEPS);
        free_world(&other);
    }
    for (int axes = 1; axes < 3; axes++) {
        world_fit other = fit_world(ctx, (change){0, axes}, STEPS);
        /* a pair within rounding of an opacity of 1/255 falls on either side */
        stab_at_most(run, turned_apart(ctx, &plain, axes), 50, "of 1e6",
                     "axes turned %d: values of the model's pictures apart by 1e-4", axes);
        /* other sums in float32: where a gradient is rounding, Adam's first steps are its sign */
        stab_at_most(run, fabs(plain.psnr - other.psnr), 0.3, "dB",
                     "axes turned %d: held-out PSNR of fits apart", axes);
        free_world(&other);
    }
    free_world(&plain);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_L4 = {
    .id = "L4",
    .failure = "The result depends on the world's unit or axes",
    .cure =
        "The model is trained in units of a power of two near the scene's size; every rate has a local unit.",
    .run = worlds,
};
