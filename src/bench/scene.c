/* scene.c - the scene that is measured. */
#include "scene.h"

#include <math.h>

#include "../base/rng.h"
#include "../scene/gaussian_math.h"
#include "../scene/gaussians.h"

enum { CLUSTERS = 40 };

/* xorshift64 (Marsaglia 2003): the generator with which the scene was first drawn. */
typedef struct generator {
    uint64_t state;
} generator;

static double uniform(generator *g) {
    g->state ^= g->state << 13;
    g->state ^= g->state >> 7;
    g->state ^= g->state << 17;
    return (double)(g->state >> 11) * 0x1p-53;
}

static double normal(generator *g) {
    double u = uniform(g) + 1e-300, v = uniform(g);
    return sqrt(-2 * log(u)) * cos(6.283185307179586 * v);
}

/* What a Gaussian looks like on the screen, before the low-pass. */
typedef struct drawn {
    double x, y;             /* px */
    double sigma_a, sigma_b; /* standard deviations of the two axes, px */
    double angle;            /* of the first, rad */
    double opacity, rgb[3], depth;
} drawn;

typedef struct drawing {
    generator random;
    double width, height, size; /* px; of a typical Gaussian */
    double cluster_x[CLUSTERS], cluster_y[CLUSTERS], cluster_size[CLUSTERS];
} drawing;

/* Sizes shrink with the number of Gaussians: about as many of them cover a pixel, however many there are. */
static drawing start_drawing(size_t gaussians, int width, int height, uint64_t seed) {
    drawing d = {.random = {seed * 0x9E3779B97F4A7C15u + 1}, .width = width, .height = height};
    d.size = sqrt(d.width * d.height / (double)gaussians);
    for (int i = 0; i < CLUSTERS; i++) {
        d.cluster_x[i] = uniform(&d.random) * d.width;
        d.cluster_y[i] = uniform(&d.random) * d.height;
        d.cluster_size[i] = (0.03 + 0.12 * uniform(&d.random)) * d.width;
    }
    return d;
}

/* Somewhere in the picture, half of the time in a cluster. */
static void draw_place(drawing *d, drawn *g) {
    do {
        if (uniform(&d->random) < 0.5) {
            g->x = uniform(&d->random) * d->width;
            g->y = uniform(&d->random) * d->height;
        } else {
            int c = (int)(uniform(&d->random) * CLUSTERS);
            g->x = d->cluster_x[c] + d->cluster_size[c] * normal(&d->random);
            g->y = d->cluster_y[c] + d->cluster_size[c] * normal(&d->random);
        }
    } while (g->x < 0 || g->x >= d->width || g->y < 0 || g->y >= d->height);
}

static drawn draw(drawing *d) {
    drawn g;
    draw_place(d, &g);
    g.sigma_a = d->size * exp(0.7 * normal(&d->random));
    g.sigma_b = g.sigma_a * exp(-fabs(0.9 * normal(&d->random)));
    g.angle = uniform(&d->random) * 6.2831853;
    if (uniform(&d->random) < 0.55)
        g.opacity = 0.02 + 0.28 * pow(uniform(&d->random), 1.5);
    else
        g.opacity = 0.99 - 0.35 * pow(uniform(&d->random), 2.0);
    static const double pace[] = {1, 1.3, 0.7};
    double phase = g.x * 0.02 + g.y * 0.013;
    for (int ch = 0; ch < 3; ch++)
        g.rgb[ch] = 0.5 + 0.35 * sin(phase * pace[ch] + ch) + 0.15 * (uniform(&d->random) - 0.5);
    g.depth = 1 + 9 * uniform(&d->random);
    return g;
}

/* Parallel to the picture at its depth and almost flat, a Gaussian projects to its own two axes. */
static void lift(const drawn *g, const sf_camera *camera, sf_model *model, size_t i) {
    const double FLAT = 0.01, Y0 = 0.28209479177387814;
    double unit = g->depth / camera->fx; /* world units a pixel */
    double opacity = fmin(g->opacity, 0.99);
    float mean[3] = {(float)((g->x - camera->cx) * unit), (float)((g->y - camera->cy) * unit),
                     (float)g->depth};
    float log_scale[3] = {(float)log(g->sigma_a * unit), (float)log(g->sigma_b * unit),
                          (float)log(g->sigma_b * unit * FLAT)};
    float quat[4] = {(float)cos(g->angle / 2), 0, 0, (float)sin(g->angle / 2)};
    float logit = (float)sf_logit(opacity), sh[48] = {0};
    for (int ch = 0; ch < 3; ch++) sh[ch] = (float)((g->rgb[ch] - 0.5) / Y0);
    sf_gaussians one = {
        .means = mean, .quats = quat, .log_scales = log_scale, .logit_opacities = &logit, .sh = sh};
    sf_model_set(model, i, 1, &one);
}

/* A smooth picture with noise. */
static void draw_picture(bench_scene *scene) {
    int width = scene->camera.width, height = scene->camera.height;
    sf_rng rng;
    sf_rng_seed(&rng, BENCH_SEED);
    uint8_t *out = scene->picture;
    for (int ch = 0; ch < 3; ch++)
        for (int y = 0; y < height; y++)
            for (int x = 0; x < width; x++)
                *out++ =
                    (uint8_t)(128 + 90 * sin(0.02 * x + 0.013 * y + ch) + 30 * (sf_rng_uniform(&rng) - 0.5));
}

sf_status bench_scene_create(sf_context *ctx, size_t gaussians, int width, int height, uint64_t seed,
                             bench_scene *scene) {
    *scene = (bench_scene){.ctx = ctx};
    scene->camera = (sf_camera){.width = width,
                                .height = height,
                                .fx = width,
                                .fy = width,
                                .cx = 0.5 * width,
                                .cy = 0.5 * height,
                                .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    sf_status status = sf_model_create(ctx, gaussians, SF_MAX_SH_DEGREE, &scene->model);
    if (status) return status;
    scene->picture = sf_alloc(ctx, 3 * (size_t)width * (size_t)height, 1);
    if (!scene->picture) {
        bench_scene_destroy(scene);
        return SF_ERR_MEMORY;
    }
    drawing d = start_drawing(gaussians, width, height, seed);
    for (size_t i = 0; i < gaussians; i++) {
        drawn g = draw(&d);
        lift(&g, &scene->camera, scene->model, i);
    }
    draw_picture(scene);
    return SF_OK;
}

void bench_scene_destroy(bench_scene *scene) {
    if (!scene->ctx) return;
    sf_model_destroy(&scene->model);
    sf_free(scene->ctx, scene->picture);
    *scene = (bench_scene){0};
}

sf_status bench_scene_project(const bench_scene *scene, sf_workspace *ws) {
    const sf_model *model = scene->model;
    sf_status status = sf_workspace_look(ws, &scene->camera, BENCH_NEAR);
    if (!status) status = sf_workspace_loss_room(ws);
    if (!status) status = sf_stage_project(ws, model, model->sh_degree, 0);
    return status ? status : sf_stage_bin(ws);
}
