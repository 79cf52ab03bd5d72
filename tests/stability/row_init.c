/* row_init.c - rows 19 and 22: walls that show nothing, and first points that are few, none, or wrong. */
#include <math.h>

#include "base/rng.h"
#include "fits.h"

/* ---- row 22
 * ------------------------------------------------------------------------------------------------
 */

#define STUDIO "sim:studio"

typedef struct start {
    const char *name;
    int first, points; /* an sf_init; random points that the scene claims to know, 0: its own */
    int64_t random;    /* init_random */
    double most;       /* dB under the first; 0: not promised */
} start;

static const start starts[] = {
    {"the scene's points", SF_INIT_POINTS, 0, 1, 0},
    {"none: 100 at random", SF_INIT_RANDOM, 0, 100, 0},
    {"none: 10,000 at random", SF_INIT_RANDOM, 0, 10000, 2},
    {"none: what matching the views finds", SF_INIT_SWEEP, 0, 10000, 2},
    {"10,000 wrong points", SF_INIT_AUTO, 10000, 10000, 2},
};
enum { STARTS = sizeof starts / sizeof *starts };

/* A copy of the scene that knows points which are nowhere in particular. */
static sf_scene *with_wrong_points(sf_context *ctx, size_t count) {
    static float xyz[3 * 10000];
    sf_scene *to;
    sf_scene_info info;
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    sf_scene *from = stab_load(ctx, STUDIO, 8, 1);
    sf_scene_get_info(from, &info);
    for (size_t i = 0; i < 3 * count; i++)
        xyz[i] = (float)(info.center[i % 3] + 2 * info.extent * (sf_rng_uniform(&rng) - 0.5));
    assert_ok(ctx, sf_scene_create(ctx, &to));
    test_copy_views(ctx, from, to, NULL, NULL);
    assert_ok(ctx, sf_scene_add_points(to, count, xyz, NULL));
    sf_scene_destroy(&from);
    return to;
}

static void first_points(stab_run *run) {
    enum { STEPS = 2000 };
    double of_points = 0;
    sf_context *ctx = test_context();
    stab_chart_begin(run, "The studio by what it begins with", (stab_axis){"steps (1)", 0},
                     (stab_axis){"held-out PSNR (dB)", 0});
    for (size_t i = 0; i < STARTS; i++) {
        const start *s = &starts[i];
        sf_scene *scene =
            s->points ? with_wrong_points(ctx, (size_t)s->points) : stab_load(ctx, STUDIO, 8, 1);
        sf_fit_options options = sf_fit_options_default();
        options.steps = STEPS, options.init = s->first, options.init_random = s->random;
        stab_fit fit = stab_fit_scene(ctx, scene, &options, STEPS / 10, NULL);
        stab_draw_fit(run, STAB_OURS, &fit, s->name);
        if (!i) of_points = fit.quality.psnr;
        if (s->most > 0)
            stab_at_most(run, of_points - fit.quality.psnr, s->most, "dB", "%s: under the scene's points",
                         s->name);
        else
            stab_shown(run, fit.quality.psnr, "dB", "%s: held-out PSNR", s->name);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

const stab_row stab_row_22 = {
    .id = "22",
    .failure = "No first points, or wrong ones",
    .cure = "Points are found by matching the views, or lie behind random pixels at the depth where other "
            "views agree best; points of the scene that lie nowhere in particular are left out.",
    .run = first_points,
};

/* ---- row 19
 * ------------------------------------------------------------------------------------------------
 */

enum { WIDTH = 96, HEIGHT = 72, VIEWS = 24, HELD_OUT = 8 };
#define FOCAL 60.0
#define HALF  2.0 /* of the room's sides, world units */

/* The white of a point of the room: each wall its own shade, a little darker towards its edges. */
static double white_at(const double p[3], int axis) {
    static const double shades[3][2] = {{0.90, 0.84}, {0.87, 0.93}, {0.80, 0.97}};
    double shade = shades[axis][p[axis] > 0];
    for (int k = 0; k < 3; k++)
        if (k != axis) shade -= 0.03 * pow(p[k] / HALF, 4);
    return shade;
}

static void draw_room(const sf_camera *camera, uint8_t *rgb) {
    double center[3];
    sf_camera_center(camera, center);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double ray[3] = {(i % WIDTH + 0.5 - camera->cx) / camera->fx,
                         (i / WIDTH + 0.5 - camera->cy) / camera->fy, 1};
        double to[3], p[3], nearest = INFINITY;
        int wall = 0;
        for (int k = 0; k < 3; k++) {
            to[k] = camera->R_cw[k] * ray[0] + camera->R_cw[3 + k] * ray[1] + camera->R_cw[6 + k] * ray[2];
            double t = ((to[k] > 0 ? HALF : -HALF) - center[k]) / to[k];
            if (t < nearest) nearest = t, wall = k;
        }
        for (int k = 0; k < 3; k++) p[k] = center[k] + nearest * to[k];
        for (int c = 0; c < 3; c++) rgb[3 * i + c] = (uint8_t)lrint(255 * white_at(p, wall));
    }
}

/* In the middle of the room, on a ring of `radius`, upright and looking `outwards` of it by an angle, up by
 * another. */
static sf_camera camera_in_room(double turn, double radius, double aside, double up) {
    double yaw = turn + aside, c = cos(yaw), s = sin(yaw), cu = cos(up), su = sin(up);
    const double ahead[3] = {c * cu, s * cu, su}, right[3] = {s, -c, 0};
    const double at[3] = {radius * cos(turn), radius * sin(turn), 0.2 * sin(3 * turn)};
    sf_camera camera = {
        .width = WIDTH, .height = HEIGHT, .fx = FOCAL, .fy = FOCAL, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    test_turn_camera(&camera, right, ahead);
    test_move_camera(&camera, at);
    return camera;
}

/* Training views look outwards, level, up and down; held-out ones stand elsewhere and look aside. */
static sf_scene *white_room(sf_context *ctx) {
    static uint8_t rgb[3 * WIDTH * HEIGHT];
    const double around = 6.283185307179586;
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0; v < VIEWS + HELD_OUT; v++) {
        int held_out = v >= VIEWS;
        sf_camera camera = held_out ? camera_in_room(around * (v + 0.3) / HELD_OUT, 0.5, 0.7, 0.25)
                                    : camera_in_room(around * v / VIEWS, 0.8, 0, 0.5 * (v % 3 - 1));
        sf_pixels pixels = {.rgb = rgb, .stride = 3 * (size_t)WIDTH};
        assert_ok(ctx, (sf_status)sf_camera_check(&camera));
        draw_room(&camera, rgb);
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels,
                                         held_out ? SF_SPLIT_TEST : SF_SPLIT_TRAIN, NULL));
    }
    return scene;
}

static void white_walls(stab_run *run) {
    enum { STEPS = 1500 };
    sf_context *ctx = test_context();
    sf_scene *scene = white_room(ctx);
    sf_fit_options options = stab_fit_options(STEPS, 20000);
    options.size = SF_SIZE_AUTO;
    stab_fit fit = stab_fit_scene(ctx, scene, &options, STEPS / 15, NULL);
    stab_at_most(run, (double)fit.progress.gaussians, 2000, "", "a white room: Gaussians");
    stab_at_least(run, fit.quality.psnr, 30, "dB", "a white room: PSNR from elsewhere, off the axis");
    stab_chart_begin(run, "A room of white walls", (stab_axis){"steps (1)", 0},
                     (stab_axis){"PSNR from elsewhere (dB)", 0});
    stab_draw_fit(run, STAB_OURS, &fit, "views that stand elsewhere and look aside");
    stab_bound_line(run, 30, "wanted");
    stab_chart_begin(run, "A room of white walls: size", (stab_axis){"steps (1)", 0},
                     (stab_axis){"Gaussians (1)", 1});
    stab_series_begin(run, STAB_OURS, "Gaussians");
    for (size_t i = 0; i < fit.looks; i++) stab_point(run, fit.steps[i], fit.gaussians[i]);
    stab_bound_line(run, 2000, "wanted");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_19 = {
    .id = "19",
    .failure = "Walls without texture",
    .cure = "Where no depth of a first Gaussian is better than another it begins at the farthest; and each "
            "has to pay for itself: few and large ones stay.",
    .run = white_walls,
};
