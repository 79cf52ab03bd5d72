/* init.c - initialises Gaussians from sparse points, from plane-sweep stereo or at random. */
#include "init.h"

#include <math.h>
#include <string.h>

#include "curve.h"
#include "gaussian_math.h"
#include "nearest.h"
#include "random.h"
#include "sweep.h"

#define SH_C0 0.28209479177387814f

enum {
    ENOUGH = 100,       /* the fewest points to initialise from */
    MOST_SWEPT = 20000, /* densification adds more where they are needed */
};

/* The point nearest to the mean of the given points. */
static uint32_t central(const float *xyz, const uint32_t *points, size_t n) {
    double mean[3] = {0}, least = INFINITY;
    uint32_t nearest = points[0];
    for (size_t i = 0; i < 3 * n; i++) mean[i % 3] += (double)xyz[3 * points[i / 3] + i % 3] / (double)n;
    for (size_t i = 0; i < n; i++) {
        double square = 0;
        for (int k = 0; k < 3; k++) {
            double d = (double)xyz[3 * points[i] + k] - mean[k];
            square += d * d;
        }
        if (square < least) least = square, nearest = points[i];
    }
    return nearest;
}

/* Thins points to `most`, in their order: Hilbert's curve through the points is cut into as many parts, and
 * the central point of each part is kept, so that no region is left empty by chance. */
static sf_status thin_points(sf_context *ctx, size_t most, sf_cloud *c) {
    uint32_t *curve;
    sf_status status = sf_curve_order(ctx, c->xyz, c->n, NULL, &curve);
    if (status) return status;
    uint8_t *kept = sf_calloc(ctx, c->n, 1);
    for (size_t k = 0; k < most && kept; k++) {
        size_t from = (size_t)((uint64_t)k * c->n / most), end = (size_t)((uint64_t)(k + 1) * c->n / most);
        kept[central(c->xyz, curve + from, end - from)] = 1;
    }
    size_t n = 0;
    for (size_t i = 0; i < c->n && kept; i++) {
        if (!kept[i]) continue;
        memmove(c->xyz + 3 * n, c->xyz + 3 * i, 3 * sizeof *c->xyz);
        memmove(c->rgb + 3 * n++, c->rgb + 3 * i, 3);
    }
    if (kept)
        c->n = n;
    else
        status = SF_ERR_MEMORY;
    sf_free(ctx, kept);
    sf_free(ctx, curve);
    return status;
}

/* The scene's points, at most `most` of them. */
static sf_status choose_points(sf_scene *scene, size_t most, sf_cloud *c) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    sf_status status = sf_cloud_create(scene->ctx, info.points, c);
    if (status) return status;
    size_t total = c->n = sf_scene_get_points(scene, 0, info.points, c->xyz, c->rgb);
    if (total <= most) return SF_OK;
    sf_log(scene->ctx, SF_LOG_INFO, "%zu of %zu points chosen, evenly: max_gaussians", most, total);
    status = thin_points(scene->ctx, most, c);
    if (status) sf_cloud_destroy(scene->ctx, c);
    return status;
}

/* Retains the training views, for sf_scene_release_all. SF_ERR_EMPTY: there is none. */
static sf_status hold_views(sf_scene *scene, sf_view ***views, size_t *n) {
    sf_status status = sf_scene_retain_training(scene, views, n);
    if (!status && !*n) status = sf_fail(scene->ctx, SF_ERR_EMPTY, "scene: no training view");
    return status;
}

/* Points from plane-sweep stereo; an empty cloud, and a log line, if there are too few to start from. */
static sf_status swept_points(sf_context *ctx, const sf_view *const *views, size_t n,
                              const sf_init_options *options, sf_cloud *c) {
    size_t most = options->max_gaussians;
    sf_sweep_options sweep = {.wanted = most < MOST_SWEPT ? most : MOST_SWEPT,
                              .nearest = options->nearest,
                              .extent = options->extent};
    sf_status status = sf_sweep_points(ctx, views, n, &sweep, c);
    if (status) return status;
    int few = c->n < (sweep.wanted < ENOUGH ? sweep.wanted : ENOUGH);
    sf_log(ctx, few && options->from == SF_INIT_SWEEP ? SF_LOG_WARNING : SF_LOG_INFO,
           "%zu points found by matching %zu views%s", c->n, n, few ? ": too few to start from" : "");
    if (few) sf_cloud_destroy(ctx, c);
    return SF_OK;
}

/* Adds random points, at most `count`, in parts of the pictures that no point of the cloud covers. */
static sf_status add_random_points(sf_context *ctx, const sf_view *const *views, size_t n, size_t count,
                                   const sf_init_options *options, sf_rng *rng, sf_cloud *c) {
    sf_cloud all;
    size_t known = c->n, room = options->max_gaussians - known;
    if (count > room) count = room;
    sf_status status = sf_cloud_create(ctx, known + count, &all);
    if (status) return status;
    if (known) memcpy(all.xyz, c->xyz, 3 * known * sizeof *c->xyz);
    if (known) memcpy(all.rgb, c->rgb, 3 * known);
    all.n = known;
    sf_cloud_destroy(ctx, c);
    *c = all;
    status = sf_random_points(ctx, views, n, count, options->extent, rng, c);
    if (!status && c->n > known) sf_log(ctx, SF_LOG_INFO, "%zu first Gaussians at random", c->n - known);
    return status;
}

/* Points from plane-sweep stereo plus random ones; with SF_INIT_RANDOM only random points. */
static sf_status points_from_views(sf_context *ctx, const sf_view *const *views, size_t n,
                                   const sf_init_options *options, sf_rng *rng, sf_cloud *c) {
    sf_status status = options->from == SF_INIT_RANDOM ? SF_OK : swept_points(ctx, views, n, options, c);
    if (!status) status = add_random_points(ctx, views, n, options->random_count, options, rng, c);
    return status;
}

/* The scene's sparse points; none if they are too few or do not agree with the pictures. */
static sf_status points_of_scene(sf_scene *scene, const sf_view *const *views, size_t n,
                                 const sf_init_options *options, sf_cloud *c) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    if (info.points < ENOUGH) return SF_OK;
    int agree;
    sf_status status = choose_points(scene, options->max_gaussians, c);
    if (!status) status = sf_points_agree(scene->ctx, views, n, c, &agree);
    if (status || agree) return status;
    sf_log(scene->ctx, SF_LOG_WARNING,
           "first: the scene's points are not where the pictures show anything: they are left out (points "
           "takes them)");
    sf_cloud_destroy(scene->ctx, c);
    return SF_OK;
}

static sf_status find_points(sf_scene *scene, const sf_init_options *options, sf_rng *rng, sf_cloud *c) {
    sf_view **held;
    size_t n;
    sf_status status = hold_views(scene, &held, &n);
    const sf_view *const *views = (const sf_view *const *)held;
    if (!status && options->from == SF_INIT_AUTO) status = points_of_scene(scene, views, n, options, c);
    if (!status && c->n)
        status = add_random_points(scene->ctx, views, n, options->random_count / 2, options, rng, c);
    else if (!status)
        status = points_from_views(scene->ctx, views, n, options, rng, c);
    sf_scene_release_all(scene, held, n);
    return status;
}

static sf_status gather_points(sf_scene *scene, const sf_init_options *options, sf_rng *rng, sf_cloud *c) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    if (options->from == SF_INIT_POINTS && !info.points)
        return sf_fail(scene->ctx, SF_ERR_EMPTY, "first: points: the scene has none");
    if (options->from == SF_INIT_POINTS) return choose_points(scene, options->max_gaussians, c);
    return find_points(scene, options, rng, c);
}

void sf_point_gaussian(const sf_params *params, size_t i, const float xyz[3], const uint8_t rgb[3],
                       double scale, double opacity) {
    double least = exp((double)SF_LOG_SCALE_LEAST_TRAINED), most = exp((double)SF_LOG_SCALE_MOST);
    float log_scale = (float)log(fmin(fmax(scale, least), most));
    for (int k = 0; k < 3; k++) {
        *sf_value(params, SF_FIELD_mean, i, k) = xyz[k];
        *sf_value(params, SF_FIELD_log_scale, i, k) = log_scale;
        *sf_value(params, SF_FIELD_sh0, i, k) = ((float)rgb[k] / 255.0f - 0.5f) / SH_C0;
    }
    params->field[SF_FIELD_logit_opacity][i] = (float)sf_logit(opacity);
}

static void become_gaussians(const sf_cloud *c, const float *distances, const sf_init_options *options,
                             sf_model *model) {
    for (size_t i = 0; i < c->n; i++) {
        double scale = distances[i] > 0 ? options->scale * (double)distances[i] : 0.01 * options->extent;
        scale = fmin(fmax(scale, 1e-7 * options->extent), options->extent);
        float xyz[3];
        for (size_t k = 0; k < 3; k++) xyz[k] = ldexpf(c->xyz[3 * i + k], -options->unit);
        sf_point_gaussian(&model->params, i, xyz, c->rgb + 3 * i, ldexp(scale, -options->unit),
                          options->opacity);
    }
}

sf_status sf_init_gaussians(sf_scene *scene, const sf_init_options *options, sf_rng *rng, sf_model **model) {
    sf_context *ctx = scene->ctx;
    sf_cloud c = {0};
    float *distances = NULL;
    *model = NULL;
    sf_status status = gather_points(scene, options, rng, &c);
    if (!status && !(distances = sf_alloc(ctx, c.n, sizeof *distances))) status = SF_ERR_MEMORY;
    if (!status) status = sf_nearest_distances(ctx, c.xyz, c.n, distances);
    if (!status) status = sf_model_create(ctx, c.n, options->sh_degree, model);
    if (!status) {
        become_gaussians(&c, distances, options, *model);
        (*model)->unit = options->unit;
    }
    sf_free(ctx, distances);
    sf_cloud_destroy(ctx, &c);
    return status;
}
