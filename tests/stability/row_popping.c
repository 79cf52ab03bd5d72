/* row_popping.c - row 13: what jumps as the camera turns, since Gaussians are sorted by their centres. */
#include <stdlib.h>
#include <string.h>

#include "lab.h"

enum { WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT };

/* A Gaussian at a pixel, and where along the pixel's ray it is densest. */
typedef struct hit {
    double depth, alpha;
    uint32_t gaussian;
} hit;

typedef struct pixel_list {
    hit *hits;
    size_t count, room;
} pixel_list;

static void add_hit(pixel_list *list, hit h) {
    if (list->count == list->room) {
        list->room = list->room ? 2 * list->room : 32;
        list->hits = realloc(list->hits, list->room * sizeof *list->hits);
        assert_non_null(list->hits);
    }
    list->hits[list->count++] = h;
}

static int nearer(const void *a, const void *b) {
    const hit *x = a, *y = b;
    if (x->depth != y->depth) return x->depth < y->depth ? -1 : 1;
    return x->gaussian < y->gaussian ? -1 : x->gaussian > y->gaussian;
}

/* The rows of S^-1 R^T R_cw^T take an offset in the camera's frame to standard deviations of the Gaussian. */
static void whitening(const test_ref_scene *scene, size_t i, double to[9]) {
    const double *q = scene->gaussians.quats + 4 * i, *c = scene->camera.R_cw;
    double n = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
    const double R[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                         2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                         2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
    for (size_t a = 0; a < 3; a++)
        for (size_t k = 0; k < 3; k++) {
            to[3 * a + k] = 0;
            for (size_t j = 0; j < 3; j++) to[3 * a + k] += R[3 * j + a] * c[3 * k + j];
            to[3 * a + k] /= exp(scene->gaussians.log_scales[3 * i + a]);
        }
}

/* Camera z at which a Gaussian is densest along the ray (dx, dy, 1). */
static double depth_along(const double to[9], const double mean[3], double dx, double dy) {
    double along = 0, squares = 0;
    for (size_t a = 0; a < 3; a++) {
        double e = to[3 * a] * dx + to[3 * a + 1] * dy + to[3 * a + 2];
        double m = to[3 * a] * mean[0] + to[3 * a + 1] * mean[1] + to[3 * a + 2] * mean[2];
        along += e * m, squares += e * e;
    }
    return along / squares;
}

static void splat(const test_ref_scene *scene, size_t i, const test_ref_splat *s, int by_centre,
                  pixel_list *lists) {
    double reach = sqrt(fmax(0, 2 * log(255 * s->opacity))), to[9];
    double half_x = reach * sqrt(s->cov2d[0]), half_y = reach * sqrt(s->cov2d[2]);
    int x0 = (int)fmax(0, floor(s->mean2d[0] - half_x)),
        x1 = (int)fmin(WIDTH - 1, ceil(s->mean2d[0] + half_x));
    int y0 = (int)fmax(0, floor(s->mean2d[1] - half_y)),
        y1 = (int)fmin(HEIGHT - 1, ceil(s->mean2d[1] + half_y));
    whitening(scene, i, to);
    for (int y = y0; y <= y1; y++)
        for (int x = x0; x <= x1; x++) {
            double d0 = s->mean2d[0] - (x + 0.5), d1 = s->mean2d[1] - (y + 0.5);
            double power = -0.5 * (s->conic[0] * d0 * d0 + s->conic[2] * d1 * d1) - s->conic[1] * d0 * d1;
            hit h = {.alpha = fmin(0.99, s->opacity * exp(power)), .gaussian = (uint32_t)i};
            if (h.alpha < 1.0 / 255) continue;
            const sf_camera *c = &scene->camera;
            h.depth = by_centre ? s->camera_point[2]
                                : depth_along(to, s->camera_point, (x + 0.5 - c->cx) / c->fx,
                                              (y + 0.5 - c->cy) / c->fy);
            add_hit(&lists[y * WIDTH + x], h);
        }
}

/* The scene in float64, each pixel's Gaussians sorted by where they are densest along its ray; or by their
 * centres, as the library does. */
static void render_sorted(const test_ref_scene *scene, int by_centre, float *rgb) {
    pixel_list *lists = calloc(PIXELS, sizeof *lists);
    test_ref_splat *splats = calloc(scene->count, sizeof *splats);
    assert_true(lists && splats);
    for (size_t i = 0; i < scene->count; i++) {
        test_ref_project(scene, i, &splats[i]);
        if (splats[i].visible) splat(scene, i, &splats[i], by_centre, lists);
    }
    for (size_t p = 0; p < PIXELS; p++) {
        double T = 1, sum[3] = {0};
        if (lists[p].count) qsort(lists[p].hits, lists[p].count, sizeof(hit), nearer);
        for (size_t k = 0; k < lists[p].count && T * (1 - lists[p].hits[k].alpha) >= 1e-4; k++) {
            const hit *h = &lists[p].hits[k];
            for (int c = 0; c < 3; c++) sum[c] += T * h->alpha * splats[h->gaussian].rgb[c];
            T *= 1 - h->alpha;
        }
        for (size_t c = 0; c < 3; c++) rgb[3 * p + c] = (float)sum[c];
        free(lists[p].hits);
    }
    free(splats);
    free(lists);
}

static double largest_change(const float *a, const float *b) {
    double most = 0;
    for (size_t i = 0; i < 3 * PIXELS; i++) {
        double by = fabs((double)a[i] - (double)b[i]);
        if (isnan(by)) return INFINITY;
        if (by > most) most = by; /* gcc 12 for aarch64 fails on fmax() here */
    }
    return most;
}

/* A model of few Gaussians of the simulated scene, as the reference has it. */
static test_ref_scene fitted(sf_context *ctx, sf_model **model) {
    sf_scene *scene;
    sf_fitter *fitter;
    sf_view_info view;
    sf_fit_options options = sf_fit_options_default();
    options.steps = 600, options.max_gaussians = 6000, options.sh_degree = 0;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=160&height=120", NULL, &scene));
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_ok(ctx, sf_fitter_snapshot(fitter, model));
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    double by = (double)WIDTH / view.camera.width;
    test_ref_scene to = {.camera = view.camera, .count = sf_model_count(*model), .near_plane = 0.05f};
    to.camera.width = WIDTH, to.camera.height = HEIGHT;
    to.camera.fx *= by, to.camera.fy *= by, to.camera.cx *= by, to.camera.cy *= by;
    to.gaussians = test_ref_gaussians_create(to.count, 0);
    sf_gaussians values = test_gaussians_create(to.count, 0);
    float *from[TEST_REF_ARRAYS];
    test_ref_array list[TEST_REF_ARRAYS];
    assert_int_equal(sf_model_sh_degree(*model), 0);
    assert_ok(ctx, sf_model_get(*model, 0, to.count, &values));
    test_gaussians_list(&values, from);
    test_ref_list(&to.gaussians, 0, list);
    for (int a = 0; a < TEST_REF_ARRAYS; a++)
        for (size_t k = 0; k < to.count * list[a].width; k++) list[a].values[k] = (double)from[a][k];
    test_gaussians_free(&values);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    return to;
}

/* About the camera's own upright axis. */
static sf_camera turned(const sf_camera *camera, double degrees) {
    double a = degrees * 3.14159265358979323846 / 180, c = cos(a), s = sin(a);
    sf_camera to = *camera;
    for (int k = 0; k < 3; k++) {
        to.R_cw[k] = c * camera->R_cw[k] + s * camera->R_cw[6 + k];
        to.R_cw[6 + k] = -s * camera->R_cw[k] + c * camera->R_cw[6 + k];
    }
    to.t_cw[0] = c * camera->t_cw[0] + s * camera->t_cw[2];
    to.t_cw[2] = -s * camera->t_cw[0] + c * camera->t_cw[2];
    return to;
}

enum { FRAMES = 60 };

/* How far the renderer above is from the library where it sorts alike. */
static double disagreement(const stab_lab *lab, const test_ref_scene *scene, const sf_model *model) {
    static float ours[3 * PIXELS], theirs[3 * PIXELS];
    sf_render_options options = test_render_options_of(scene);
    assert_ok(lab->ctx,
              sf_render(lab->renderer, model, &scene->camera, &options, &(sf_image_out){.rgb = ours}));
    render_sorted(scene, 1, theirs);
    return largest_change(ours, theirs);
}

/* The library's largest change of a pixel at each frame but the first, and that of the exact sort. */
static void turn(const stab_lab *lab, test_ref_scene *scene, const sf_model *model,
                 double change[2][FRAMES]) {
    static float now[2][3 * PIXELS], before[2][3 * PIXELS];
    const sf_camera start = scene->camera;
    sf_render_options options = test_render_options_of(scene);
    for (int f = 0; f < FRAMES; f++) {
        sf_image_out out = {.rgb = now[0]};
        scene->camera = turned(&start, 0.1 * f);
        assert_ok(lab->ctx, sf_render(lab->renderer, model, &scene->camera, &options, &out));
        render_sorted(scene, 0, now[1]);
        for (int k = 0; k < 2; k++) {
            change[k][f] = f ? largest_change(now[k], before[k]) : 0;
            memcpy(before[k], now[k], sizeof now[k]);
        }
    }
}

static void popping(stab_run *run) {
    double change[2][FRAMES], most[2];
    stab_lab lab = stab_lab_open(NULL);
    sf_model *model;
    test_ref_scene scene = fitted(lab.ctx, &model);
    stab_at_most(run, disagreement(&lab, &scene, model), 1.0 / 255, "colour",
                 "difference from a picture in float64, sorted alike");
    turn(&lab, &scene, model, change);
    stab_chart_begin(run, "The pixel that changes most as the camera turns by 0.1 degrees a frame",
                     (stab_axis){"turn (degrees)", 0}, (stab_axis){"change of a channel (colour)", 0});
    for (int k = 0; k < 2; k++) {
        stab_series_begin(run, k ? STAB_TEXTBOOK : STAB_OURS,
                          k ? "each pixel sorted along its own ray, float64" : "ours: sorted by camera z");
        for (int f = 1; f < FRAMES; f++) stab_point(run, 0.1 * f, change[k][f]);
        most[k] = stab_most_of(change[k], FRAMES);
    }
    stab_at_most(run, most[0] / most[1], 2, "", "largest change, over that of a sort of each pixel");
    stab_shown(run, most[0], "colour", "largest change of a pixel; beside it that of the exact sort");
    stab_textbook(run, most[1]);
    stab_shown(run, (double)scene.count, "", "Gaussians of the model, fitted to sim:studio");
    test_ref_gaussians_free(&scene.gaussians);
    sf_model_destroy(&model);
    stab_lab_close(&lab);
}

const stab_row stab_row_13 = {
    .id = "13",
    .failure = "Popping as the order of Gaussians changes",
    .cure = "Measured and stated: Gaussians are sorted by the depth of their centres, beside them an exact "
            "sort of each "
            "pixel.",
    .run = popping,
};
