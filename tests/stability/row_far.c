/* row_far.c - row L5: an object before a far background of which no sparse point is known. */
#include <math.h>

#include "base/rng.h"
#include "fits.h"

enum { WIDTH = 96, HEIGHT = 72, VIEWS = 40, HOLD_OUT = 4, POINTS = 2000, STEPS = 800, GAUSSIANS = 6000 };
#define FOCAL 80.0
#define RING  4.0 /* radius of the cameras' ring around the ball, whose radius is 1 */

/* A colour of a surface, from coordinates of which 1 is a few periods. */
static double shade_at(const double p[3], int channel) {
    double wave = sin(5 * p[0] + channel) * sin(4 * p[1] - 2 * channel) + sin(6 * p[2] + 3 * p[0]);
    return 0.5 + 0.2 * wave + 0.05 * sin(17 * p[0]) * sin(19 * p[2]);
}

/* Where a ray from `from`, inside of a ball around the origin or outside, meets it from inside (`far`) or
 * outside; 0: nowhere. */
static double meets(const double from[3], const double ray[3], double radius, int far) {
    double a = 0, b = 0, c = -radius * radius;
    for (int k = 0; k < 3; k++) a += ray[k] * ray[k], b += from[k] * ray[k], c += from[k] * from[k];
    double root = b * b - a * c;
    return root > 0 ? (-b + (far ? 1 : -1) * sqrt(root)) / a : 0;
}

/* The ball before a larger one, seen from within. */
static void draw(const sf_camera *camera, double background, uint8_t *rgb) {
    double from[3];
    sf_camera_center(camera, from);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double ray[3] = {(i % WIDTH + 0.5 - camera->cx) / camera->fx,
                         (i / WIDTH + 0.5 - camera->cy) / camera->fy, 1};
        double to[3], p[3], radius = 1;
        for (int k = 0; k < 3; k++)
            to[k] = camera->R_cw[k] * ray[0] + camera->R_cw[3 + k] * ray[1] + camera->R_cw[6 + k] * ray[2];
        double t = meets(from, to, radius, 0);
        if (!(t > 0)) t = meets(from, to, radius = background, 1);
        for (int k = 0; k < 3; k++) p[k] = (from[k] + t * to[k]) / radius;
        for (int c = 0; c < 3; c++) rgb[3 * i + c] = (uint8_t)lrint(255 * shade_at(p, c));
    }
}

/* Looks at the ball from the ring. */
static sf_camera camera_on_ring(int view) {
    double turn = 6.283185307179586 * view / VIEWS, up = 0.3 * sin(5 * turn);
    const double at[3] = {RING * cos(turn) * cos(up), RING * sin(turn) * cos(up), RING * sin(up)};
    const double ahead[3] = {-at[0] / RING, -at[1] / RING, -at[2] / RING},
                 right[3] = {-sin(turn), cos(turn), 0};
    sf_camera camera = {
        .width = WIDTH, .height = HEIGHT, .fx = FOCAL, .fy = FOCAL, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    test_turn_camera(&camera, right, ahead);
    test_move_camera(&camera, at);
    return camera;
}

/* Sparse points of the ball alone. */
static void add_points(sf_context *ctx, sf_scene *scene) {
    static float xyz[3 * POINTS];
    static uint8_t rgb[3 * POINTS];
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    for (size_t i = 0; i < POINTS; i++) {
        double p[3], length = 0;
        for (int k = 0; k < 3; k++) p[k] = sf_rng_normal(&rng), length += p[k] * p[k];
        for (int k = 0; k < 3; k++) p[k] /= sqrt(length);
        for (size_t k = 0; k < 3; k++) xyz[3 * i + k] = (float)p[k];
        for (int c = 0; c < 3; c++) rgb[3 * i + (size_t)c] = (uint8_t)lrint(255 * shade_at(p, c));
    }
    assert_ok(ctx, sf_scene_add_points(scene, POINTS, xyz, rgb));
}

static sf_scene *ball_before(sf_context *ctx, double background) {
    static uint8_t rgb[3 * WIDTH * HEIGHT];
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0; v < VIEWS; v++) {
        sf_camera camera = camera_on_ring(v);
        sf_pixels pixels = {.rgb = rgb, .stride = 3 * (size_t)WIDTH};
        assert_ok(ctx, (sf_status)sf_camera_check(&camera));
        draw(&camera, background, rgb);
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels,
                                         v % HOLD_OUT ? SF_SPLIT_TRAIN : SF_SPLIT_TEST, NULL));
    }
    add_points(ctx, scene);
    return scene;
}

static void far_background(stab_run *run) {
    static const double radii[] = {8, 20, 100};
    enum { CASES = sizeof radii / sizeof *radii };
    double psnr[CASES][2];
    sf_context *ctx = test_context();
    for (size_t i = 0; i < CASES; i++) {
        sf_scene *scene = ball_before(ctx, radii[i]);
        sf_fit_options ours = stab_fit_options(STEPS, GAUSSIANS), textbook = ours;
        textbook.init = SF_INIT_POINTS;
        psnr[i][0] = stab_fit_scene(ctx, scene, &ours, 0, NULL).quality.psnr;
        psnr[i][1] = stab_fit_scene(ctx, scene, &textbook, 0, NULL).quality.psnr;
        stab_at_least(run, psnr[i][0], 28, "dB", "background %g radii of the object away: held-out PSNR",
                      radii[i]);
        stab_textbook(run, psnr[i][1]);
        sf_scene_destroy(&scene);
    }
    stab_chart_begin(run, "A ball before a far background without sparse points",
                     (stab_axis){"distance of the background (radii of the ball)", 1},
                     (stab_axis){"held-out PSNR (dB)", 0});
    for (int k = 0; k < 2; k++) {
        stab_series_begin(run, k ? STAB_TEXTBOOK : STAB_OURS, "%s",
                          k ? "textbook: sparse points alone" : "with far points");
        for (size_t i = 0; i < CASES; i++) stab_point(run, radii[i], psnr[i][k]);
    }
    sf_context_destroy(&ctx);
}

const stab_row stab_row_L5 = {
    .id = "L5",
    .failure = "A far background without sparse points is explained by haze before the cameras",
    .cure = "Random first points join the sparse ones: behind these, even in inverse depth, where they hide "
            "nothing and are beside no camera.",
    .run = far_background,
};
