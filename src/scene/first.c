/* first.c - the first Gaussians, from sparse points or at random. */
#include "first.h"

#include <math.h>
#include <string.h>

#define SH_C0 0.28209479177387814f

/* Points and their colours, as they will become Gaussians. */
typedef struct cloud {
    float *xyz;
    uint8_t *rgb;
    size_t n;
} cloud;

static sf_status cloud_room(sf_context *ctx, cloud *c, size_t n) {
    c->xyz = sf_alloc(ctx, n, 3 * sizeof *c->xyz);
    c->rgb = sf_alloc(ctx, n, 3);
    return c->xyz && c->rgb ? SF_OK : SF_ERR_MEMORY;
}

/* All points, or `most` of them at random, in their order (Knuth's selection sampling). */
static sf_status choose_points(sf_scene *scene, size_t most, sf_rng *rng, cloud *c) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    sf_status status = cloud_room(scene->ctx, c, info.points);
    if (status) return status;
    size_t total = sf_scene_get_points(scene, 0, info.points, c->xyz, c->rgb);
    if (total > most)
        sf_log(scene->ctx, SF_LOG_INFO, "%zu of %zu points chosen at random: max_gaussians", most, total);
    for (size_t i = 0; i < total && c->n < most; i++) {
        if (total > most && sf_rng_uniform(rng) * (double)(total - i) >= (double)(most - c->n)) continue;
        memmove(c->xyz + 3 * c->n, c->xyz + 3 * i, 3 * sizeof *c->xyz);
        memmove(c->rgb + 3 * c->n, c->rgb + 3 * i, 3);
        c->n++;
    }
    return SF_OK;
}

/* The point nearest to all optical axes, in the sense of least squares: what cameras that look inward look
 * at. */
static void focus_point(sf_view *const *views, size_t n, double *focus) {
    double M[6] = {0}, b[3] = {0}; /* sum of I - d d^T, and that times the centres */
    for (size_t i = 0; i < n; i++) {
        const double *d = views[i]->camera.R_cw + 6;
        double c[3], along;
        sf_camera_center(&views[i]->camera, c);
        along = d[0] * c[0] + d[1] * c[1] + d[2] * c[2];
        M[0] += 1 - d[0] * d[0], M[1] -= d[0] * d[1], M[2] -= d[0] * d[2];
        M[3] += 1 - d[1] * d[1], M[4] -= d[1] * d[2], M[5] += 1 - d[2] * d[2];
        for (int k = 0; k < 3; k++) b[k] += c[k] - along * d[k];
    }
    double m00 = M[3] * M[5] - M[4] * M[4], m01 = M[2] * M[4] - M[1] * M[5], m02 = M[1] * M[4] - M[2] * M[3];
    double m11 = M[0] * M[5] - M[2] * M[2], m12 = M[1] * M[2] - M[0] * M[4], m22 = M[0] * M[3] - M[1] * M[1];
    double det = M[0] * m00 + M[1] * m01 + M[2] * m02;
    focus[0] = (m00 * b[0] + m01 * b[1] + m02 * b[2]) / det; /* not finite for parallel axes */
    focus[1] = (m01 * b[0] + m11 * b[1] + m12 * b[2]) / det;
    focus[2] = (m02 * b[0] + m12 * b[1] + m22 * b[2]) / det;
}

/* How far along its axis a camera looks: to the focus where that lies in front, else the scene's extent. */
static double look_distance(const sf_view *view, const double *focus, double extent) {
    const double *R = view->camera.R_cw + 6;
    double depth = R[0] * focus[0] + R[1] * focus[1] + R[2] * focus[2] + view->camera.t_cw[2];
    return isfinite(depth) && depth > 0.05 * extent && depth < 100 * extent ? depth : extent;
}

/* A random pixel of a random view, at a random depth from a third to three times the distance that it looks.
 */
static void random_point(const sf_view *view, double distance, sf_rng *rng, float *xyz, uint8_t *rgb) {
    const sf_camera *c = &view->camera;
    size_t x = (size_t)sf_rng_below(rng, (uint64_t)c->width),
           y = (size_t)sf_rng_below(rng, (uint64_t)c->height);
    double depth = distance * pow(9, sf_rng_uniform(rng)) / 3, p[3];
    p[0] = ((double)x + 0.5 - c->cx) / c->fx * depth - c->t_cw[0];
    p[1] = ((double)y + 0.5 - c->cy) / c->fy * depth - c->t_cw[1];
    p[2] = depth - c->t_cw[2];
    size_t pixels = (size_t)c->width * (size_t)c->height, at = y * (size_t)c->width + x;
    for (size_t k = 0; k < 3; k++) {
        xyz[k] = (float)(c->R_cw[k] * p[0] + c->R_cw[3 + k] * p[1] + c->R_cw[6 + k] * p[2]);
        rgb[k] = view->rgb[k * pixels + at];
    }
}

static sf_status random_points(sf_scene *scene, const sf_first_options *options, sf_rng *rng, cloud *c) {
    uint32_t *ids = NULL;
    size_t n = 0, held = 0, most = options->max_gaussians;
    size_t wanted = options->random_count < most ? options->random_count : most;
    sf_status status = sf_scene_training_ids(scene, &ids, &n);
    sf_view **views = status ? NULL : sf_calloc(scene->ctx, n, sizeof *views);
    if (!status) status = views ? cloud_room(scene->ctx, c, wanted) : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < n; i++) {
        sf_view *view = sf_scene_retain_id(scene, ids[i]);
        if (view) views[held++] = view;
    }
    if (!status && !held) status = sf_fail(scene->ctx, SF_ERR_EMPTY, "scene: no training view");
    if (!status) {
        double focus[3];
        focus_point(views, held, focus);
        sf_log(scene->ctx, SF_LOG_INFO, "no sparse points: %zu first Gaussians at random", wanted);
        for (c->n = 0; c->n < wanted; c->n++) {
            const sf_view *view = views[sf_rng_below(rng, held)];
            random_point(view, look_distance(view, focus, options->extent), rng, c->xyz + 3 * c->n,
                         c->rgb + 3 * c->n);
        }
    }
    for (size_t i = 0; i < held; i++) sf_view_release(views[i]);
    sf_free(scene->ctx, views);
    sf_free(scene->ctx, ids);
    return status;
}

static void become_gaussians(const cloud *c, const float *distances, const sf_first_options *options,
                             sf_model *model) {
    float logit = (float)log(options->opacity / (1 - options->opacity));
    double least = fmax(1e-7 * options->extent, exp(-(double)SF_LOG_SCALE_MOST));
    double most = fmin(options->extent, exp((double)SF_LOG_SCALE_MOST));
    for (size_t i = 0; i < c->n; i++) {
        double scale = distances[i] > 0 ? options->scale * (double)distances[i] : 0.01 * options->extent;
        float log_scale = (float)log(fmin(fmax(scale, least), most));
        for (int k = 0; k < 3; k++) {
            model->params.field[SF_FIELD_mean][sf_at(i, 3, k)] = c->xyz[3 * i + (size_t)k];
            model->params.field[SF_FIELD_log_scale][sf_at(i, 3, k)] = log_scale;
            model->params.field[SF_FIELD_sh0][sf_at(i, 3, k)] =
                ((float)c->rgb[3 * i + (size_t)k] / 255.0f - 0.5f) / SH_C0;
        }
        model->params.field[SF_FIELD_logit_opacity][i] = logit;
    }
}

sf_status sf_first_gaussians(sf_scene *scene, const sf_first_options *options, sf_rng *rng,
                             sf_model **model) {
    sf_context *ctx = scene->ctx;
    cloud c = {0};
    float *distances = NULL;
    *model = NULL;
    sf_status status = choose_points(scene, options->max_gaussians, rng, &c);
    if (!status && !c.n) {
        sf_free(ctx, c.xyz);
        sf_free(ctx, c.rgb);
        c = (cloud){0};
        status = random_points(scene, options, rng, &c);
    }
    if (!status && !(distances = sf_alloc(ctx, c.n, sizeof *distances))) status = SF_ERR_MEMORY;
    if (!status) status = sf_nearest_distances(ctx, c.xyz, c.n, distances);
    if (!status) status = sf_model_create(ctx, c.n, options->sh_degree, model);
    if (!status) become_gaussians(&c, distances, options, *model);
    sf_free(ctx, distances);
    sf_free(ctx, c.xyz);
    sf_free(ctx, c.rgb);
    return status;
}
