/* scene_load.c - sf_scene_load: a project from files, or a scene made from the frames of a simulation. */
#include <stdio.h>
#include <string.h>

#include "../base/memory.h"
#include "../base/rng.h"
#include "../base/statistics.h"
#include "../io/dataset.h"
#include "../io/load_project.h"
#include "../scene/pixels.h"
#include "../sim/sim.h"
#include "source_ops.h"

/* As many as structure from motion finds in a scene of this kind. */
enum { SPARSE_POINTS = 8000, FRAME_NAME = 16 };

static sf_status check_options(sf_context *ctx, const char *name, const sf_sim *sim,
                               const sf_load_options *options) {
    if (sim->fps > 0 || sim->loop)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: a scene is made of frames that wait and end", name,
                       sim->loop ? "loop" : "fps");
    int smaller = sim->width < sim->height ? sim->width : sim->height;
    if (options->downscale < 1 || options->downscale > 64 || options->downscale > smaller)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: downscale: %d is not in 1..%d", name, options->downscale,
                       smaller < 64 ? smaller : 64);
    if (options->hold_out < 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: hold_out: %d is negative", name, options->hold_out);
    if (options->max_views < 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: max_views: %d is negative", name, options->max_views);
    if (options->max_views > 0 && sim->frames > (uint64_t)options->max_views)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: frames: %u are more than max_views %d", name,
                       (unsigned)sim->frames, options->max_views);
    return SF_OK;
}

static const char *frame_name(uint64_t frame, char name[FRAME_NAME]) {
    snprintf(name, FRAME_NAME, "frame_%04u", (unsigned)(frame % 10000));
    return name;
}

/* Box-averages a frame into the planes of a view whose size is the frame's divided by `factor`. */
static void fill_planes(const sf_frame *frame, size_t factor, sf_view *view) {
    size_t width = (size_t)view->camera.width, height = (size_t)view->camera.height;
    for (size_t i = 0; i < 3 * width * height; i++) {
        size_t channel = i / (width * height), y = i / width % height, x = i % width;
        const uint8_t *corner = frame->plane[0] + y * factor * frame->stride[0] + 3 * x * factor + channel;
        view->rgb[i] = sf_box_mean(corner, factor, 3, frame->stride[0]);
    }
}

/* cache: that takes the pixels; NULL: they stay in memory. */
static sf_status add_frame(sf_scene *scene, const sf_frame *frame, int factor, sf_split split,
                           sf_pixel_cache *cache) {
    char name[FRAME_NAME];
    frame_name(frame->sequence, name);
    sf_camera camera = sf_camera_downscaled(&frame->camera, factor);
    sf_view *view;
    sf_status status = sf_view_create(scene->ctx, name, &camera, split, 0, &view);
    if (status != SF_OK) return status;
    fill_planes(frame, (size_t)factor, view);
    if (cache) status = sf_view_move_out(view, cache);
    if (status == SF_OK) return sf_scene_take_view(scene, view);
    sf_view_release(view);
    return status;
}

static sf_status add_frames(sf_scene *scene, const char *name, int factor, const sf_split *splits,
                            sf_pixel_cache *cache) {
    sf_source *source;
    sf_status status = sf_source_open(scene->ctx, name, &source);
    while (status == SF_OK) {
        sf_frame frame;
        status = sf_source_next(source, -1, &frame);
        if (status != SF_OK) break;
        status = add_frame(scene, &frame, factor, splits[frame.sequence], cache);
        sf_source_release(source, &frame);
    }
    sf_source_close(&source);
    return status == SF_ERR_END ? SF_OK : status;
}

/* A point as structure from motion would give it: seen in a training view, and off by about a pixel; *at: the
 * pixel. */
static void sparse_point(const sf_sim *sim, const sf_view *view, sf_rng *rng, float xyz[3], size_t *at) {
    size_t width = (size_t)view->camera.width, height = (size_t)view->camera.height;
    double x = sf_rng_uniform(rng) * (double)width, y = sf_rng_uniform(rng) * (double)height;
    sf_vec3 point;
    double distance;
    sf_sim_look(sim, &view->camera, x, y, &point, &distance);
    double pixel = distance / view->camera.fx;
    xyz[0] = (float)(point.x + pixel * sf_rng_normal(rng));
    xyz[1] = (float)(point.y + pixel * sf_rng_normal(rng));
    xyz[2] = (float)(point.z + pixel * sf_rng_normal(rng));
    *at = (size_t)y * width + (size_t)x;
}

/* Every n-th point is of one view. */
static sf_status color_points(const sf_view *view, size_t first, size_t n, const size_t *at, uint8_t *rgb) {
    sf_view_pixels pixels;
    sf_status status = sf_view_open(view, &pixels);
    if (status != SF_OK) return status;
    size_t plane = (size_t)view->camera.width * (size_t)view->camera.height;
    for (size_t i = first; i < SPARSE_POINTS; i += n)
        for (size_t c = 0; c < 3; c++) rgb[3 * i + c] = pixels.rgb[c * plane + at[i]];
    sf_view_close(view, &pixels);
    return SF_OK;
}

static sf_status cast_points(sf_scene *scene, const sf_sim *sim, float *xyz, uint8_t *rgb) {
    sf_view **views;
    size_t n, *at = sf_alloc(scene->ctx, SPARSE_POINTS, sizeof *at);
    sf_status status = at ? sf_scene_retain_training(scene, &views, &n) : SF_ERR_MEMORY;
    if (status == SF_OK) {
        sf_rng rng;
        sf_rng_seed(&rng, sim->seed);
        for (size_t i = 0; i < SPARSE_POINTS; i++) sparse_point(sim, views[i % n], &rng, xyz + 3 * i, &at[i]);
        for (size_t v = 0; v < n && status == SF_OK; v++) status = color_points(views[v], v, n, at, rgb);
        sf_scene_release_all(scene, views, n);
    }
    sf_free(scene->ctx, at);
    return status;
}

static sf_status add_points(sf_scene *scene, const sf_sim *sim) {
    float *xyz = sf_alloc(scene->ctx, SPARSE_POINTS, 3 * sizeof *xyz);
    uint8_t *rgb = sf_alloc(scene->ctx, SPARSE_POINTS, 3);
    sf_status status = xyz && rgb ? cast_points(scene, sim, xyz, rgb) : SF_ERR_MEMORY;
    if (status == SF_OK) status = sf_scene_add_points(scene, SPARSE_POINTS, xyz, rgb);
    sf_free(scene->ctx, xyz);
    sf_free(scene->ctx, rgb);
    return status;
}

static sf_status choose_splits(sf_context *ctx, const sf_load_options *options, size_t count,
                               sf_split *splits) {
    char(*texts)[FRAME_NAME] = sf_alloc(ctx, count, sizeof *texts);
    const char **names = sf_alloc(ctx, count, sizeof *names);
    sf_status status = SF_ERR_MEMORY;
    if (texts && names) {
        for (size_t i = 0; i < count; i++) names[i] = frame_name(i, texts[i]);
        status = sf_split_names(ctx, options, count, names, splits);
    }
    sf_free(ctx, names);
    sf_free(ctx, texts);
    return status;
}

static sf_status need_training(sf_context *ctx, const char *name, const sf_split *splits, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (splits[i] == SF_SPLIT_TRAIN) return SF_OK;
    return sf_fail(ctx, SF_ERR_EMPTY, "%s: frames: all %zu are held out, no training view is left", name,
                   count);
}

/* Where the memory has too little room for the pictures, or is for the Gaussians of one of several ranks. */
static sf_status make_cache(sf_context *ctx, const char *name, const sf_sim *sim,
                            const sf_load_options *options, sf_pixel_cache **cache) {
    double budget = (double)sf_memory_budget((uint64_t)options->memory);
    double picture = 3.0 * (sim->width / options->downscale) * (sim->height / options->downscale);
    double bytes = (double)sim->frames * picture;
    int exceeds = sf_pixels_exceed(bytes, budget);
    if (!exceeds && !ctx->cluster) return SF_OK;
    sf_status status = sf_pixel_cache_create(ctx, name, (uint64_t)bytes, (size_t)picture,
                                             sf_pixel_buffers(exceeds ? budget : 0, picture), cache);
    return status == SF_ERR_IO && !exceeds ? SF_OK : status;
}

static sf_status fill_scene(sf_scene *scene, const char *name, const sf_sim *sim,
                            const sf_load_options *options) {
    size_t count = (size_t)sim->frames;
    sf_pixel_cache *cache = NULL;
    sf_split *splits = sf_alloc(scene->ctx, count, sizeof *splits);
    sf_status status = splits ? choose_splits(scene->ctx, options, count, splits) : SF_ERR_MEMORY;
    if (status == SF_OK) status = need_training(scene->ctx, name, splits, count);
    if (status == SF_OK) status = make_cache(scene->ctx, name, sim, options, &cache);
    if (status == SF_OK) status = add_frames(scene, name, options->downscale, splits, cache);
    if (status == SF_OK) status = add_points(scene, sim);
    sf_pixel_cache_release(cache);
    sf_free(scene->ctx, splits);
    return status;
}

static sf_status load_simulated(sf_context *ctx, const char *name, const sf_load_options *options,
                                sf_scene **scene) {
    sf_sim sim;
    char *project;
    sf_status status = sf_sim_project_name(ctx, name, &project);
    if (status != SF_OK) return status;
    status = sf_sim_init(ctx, project, &sim);
    if (status == SF_OK) status = check_options(ctx, name, &sim, options);
    if (status == SF_OK) status = sf_scene_create(ctx, scene);
    if (status == SF_OK) {
        (*scene)->kind = "simulated";
        status = fill_scene(*scene, project, &sim, options);
        if (status != SF_OK) sf_scene_destroy(scene);
    }
    sf_free(ctx, project);
    return status;
}

sf_status sf_scene_load(sf_context *ctx, const char *path, const sf_load_options *options, sf_scene **scene) {
    sf_load_options defaults = sf_load_options_default();
    *scene = NULL;
    if (!options) options = &defaults;
    if (atomic_load(&ctx->loads_cancelled)) return sf_load_cancelled(ctx, path);
    if (strncmp(path, "sim:", 4) == 0) return load_simulated(ctx, path, options, scene);
    return sf_project_load(ctx, path, options, scene);
}
