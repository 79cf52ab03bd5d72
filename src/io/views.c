/* views.c - from the entries of a project to the views of a scene. */
#include "views.h"

#include "../base/pool.h"
#include "../base/statistics.h"
#include "../scene/pixels.h"
#include "mask.h"
#include "paths.h"
#include "picture_memory.h"
#include "undistort.h"

#include <limits.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { NAMES_IN_LOG = 5 /* of skipped pictures; the rest is counted */ };

/* From a picture to a view. */

/* A picture that was turned or cropped after its camera was found is not what the camera saw. */
static sf_status check_shape(const sf_entry *e, sf_picture *p) {
    if (sf_is_same_shape(p->file_width, p->file_height, e->width, e->height)) return SF_OK;
    int turned = sf_is_same_shape(p->file_height, p->file_width, e->width, e->height);
    snprintf(p->fault, sizeof p->fault, "size: %d x %d is not the camera's %d x %d, nor its shape: %s",
             p->file_width, p->file_height, e->width, e->height, turned ? "turned, by EXIF?" : "cropped?");
    return SF_ERR_FORMAT;
}

/* The mean of a channel over a box of side x side pixels from `at` on, by weight. 0 if nothing there weighs.
 */
static int weighted_mean(const sf_picture *p, size_t at, size_t channel, size_t side, uint8_t *mean) {
    const uint8_t *plane = p->rgb + channel * (size_t)p->width * (size_t)p->height;
    uint32_t sum = 0, weight = 0;
    for (size_t i = 0; i < side * side; i++) {
        size_t from = at + i / side * (size_t)p->width + i % side;
        weight += p->weight[from];
        sum += p->weight[from] * (uint32_t)plane[from];
    }
    if (weight) *mean = (uint8_t)((sum + weight / 2) / weight);
    return weight > 0;
}

/* One pixel of the view: the mean over a box of the picture, by weight where that is known. */
static void average_box(const sf_picture *p, size_t x, size_t y, size_t factor, const sf_view *v) {
    size_t width = (size_t)p->width, from = y * factor * width + x * factor;
    size_t from_plane = width * (size_t)p->height, at = y * (size_t)v->camera.width + x;
    size_t to_plane = (size_t)v->camera.width * (size_t)v->camera.height;
    for (size_t c = 0; c < 3; c++)
        if (!p->weight || !weighted_mean(p, from, c, factor, &v->rgb[c * to_plane + at]))
            v->rgb[c * to_plane + at] = sf_box_mean(p->rgb + c * from_plane + from, factor, 1, width);
    if (v->weight) v->weight[at] = p->weight ? sf_box_mean(p->weight + from, factor, 1, width) : 0;
}

/* factor: by which the sides are still to be divided. */
static void fill_view(const sf_picture *p, int factor, const sf_view *v) {
    size_t plane = (size_t)p->width * (size_t)p->height;
    if (p->width == v->camera.width && p->height == v->camera.height) {
        memcpy(v->rgb, p->rgb, 3 * plane);
        if (v->weight) memcpy(v->weight, p->weight, plane);
        return;
    }
    for (size_t y = 0; y < (size_t)v->camera.height; y++)
        for (size_t x = 0; x < (size_t)v->camera.width; x++) average_box(p, x, y, (size_t)factor, v);
}

static sf_camera pinhole(const sf_entry *e, const sf_optics *lens, const sf_picture *p) {
    sf_undistorted frame = sf_undistort_frame(lens, p->file_width, p->file_height);
    sf_camera camera = {.width = frame.width,
                        .height = frame.height,
                        .fx = lens->fx,
                        .fy = lens->fy,
                        .cx = frame.cx,
                        .cy = frame.cy};
    memcpy(camera.R_cw, e->R_cw, sizeof camera.R_cw);
    memcpy(camera.t_cw, e->t_cw, sizeof camera.t_cw);
    return camera;
}

typedef struct result {
    sf_view *view; /* NULL if skipped */
    sf_status status;
    int bad_pose, rotated, undistorted, alpha;
    int hidden;     /* no pixel of the view counts */
    int has_weight; /* the view has weights, or would have them */
    char fault[SF_PICTURE_FAULT_BYTES];
} result;

typedef struct loading {
    sf_context *ctx;
    const sf_project *project;
    const sf_load_options *options;
    result *results; /* one an entry */
    sf_picture_plan plan;
    pthread_mutex_t lock; /* guards free */
    pthread_cond_t freed;
    size_t free; /* pictures that may be read now */
} loading;

/* The camera of the view, and what is known of its lens; r->fault or r->bad_pose says what is wrong. */
static sf_status find_camera(const loading *l, const sf_entry *e, const sf_picture *p, result *r,
                             sf_optics *lens, sf_camera *camera) {
    *lens = sf_scaled_lens(e, (double)p->file_width / e->width, (double)p->file_height / e->height);
    *camera = pinhole(e, lens, p);
    r->bad_pose = !sf_optics_is_valid(lens) || sf_camera_check(camera);
    if (r->bad_pose) return SF_OK;
    int factor = l->options->downscale;
    if (camera->width < factor || camera->height < factor) {
        snprintf(r->fault, sizeof r->fault, "downscale: %d leaves nothing of %d x %d", factor, camera->width,
                 camera->height);
        return SF_ERR_ARGUMENT;
    }
    r->undistorted = sf_optics_is_distorted(lens);
    *camera = sf_camera_downscaled(camera, factor);
    return SF_OK;
}

static void describe_view(const sf_entry *e, const sf_optics *lens, const sf_picture *p, const result *r) {
    sf_lens_note note = {.model = lens->model, .undistorted = r->undistorted};
    sf_undistort_field(lens, p->file_width, p->file_height, &note.seen, &note.kept);
    r->view->lens = note;
    r->view->masked = e->mask != NULL;
    r->view->alpha = r->alpha;
    r->view->has_weight = r->has_weight;
}

static sf_status make_view(const loading *l, const sf_entry *e, sf_picture *p, result *r) {
    sf_optics lens;
    sf_camera camera;
    sf_status status = find_camera(l, e, p, r, &lens, &camera);
    if (status || r->bad_pose) return status;
    if (r->undistorted) {
        double x = (double)p->file_width / p->divided, y = (double)p->file_height / p->divided;
        sf_optics decoded = sf_scaled_lens(e, x / e->width, y / e->height);
        status = sf_undistort(l->ctx, &decoded, p);
    }
    if (status) return status;
    r->has_weight = p->weight != NULL;
    status = sf_view_create(l->ctx, e->name, &camera, e->split, r->has_weight, &r->view);
    if (status) return status;
    fill_view(p, l->options->downscale / p->divided, r->view);
    describe_view(e, &lens, p, r);
    r->hidden = sf_view_is_hidden(r->view);
    return l->plan.cache ? sf_view_move_out(r->view, l->plan.cache) : SF_OK;
}

/* The factor by which a JPEG's sides may be divided while it is decoded. 1 with a mask, which hides single
 * pixels of the file. Where a lens is corrected, a factor of 2 is left for afterwards: averaging hides the
 * blur of resampling. */
static int decoded_factor(const loading *l, const sf_entry *e) {
    int factor = l->options->downscale;
    if (e->mask || e->border_px) return 1;
    if (!sf_optics_is_distorted(&e->lens)) return factor;
    return e->lens.projection == SF_PERSPECTIVE && factor % 2 == 0 ? factor / 2 : 1;
}

static sf_status read_picture(const loading *l, const sf_entry *e, sf_picture *p, result *r) {
    sf_status status = sf_picture_load_divided(l->ctx, e->path, decoded_factor(l, e), p);
    if (!status) status = check_shape(e, p);
    r->alpha = p->weight != NULL;
    if (!status) sf_alpha_apply(l->ctx, l->options, l->project->blends, p);
    if (!status && e->mask) status = sf_mask_apply(l->ctx, e->mask, p);
    if (!status && e->border_px) status = sf_mask_border(l->ctx, e->border_px, p);
    memcpy(r->fault, p->fault, sizeof r->fault);
    r->rotated = !status && p->orientation != 1;
    if (!status) status = make_view(l, e, p, r);
    sf_picture_free(l->ctx, p);
    return status;
}

/* The same from headers alone: a view without pixels. */
static sf_status look_at_picture(const loading *l, const sf_entry *e, sf_picture *p, result *r) {
    sf_optics lens;
    sf_camera camera;
    sf_status status = sf_picture_look(l->ctx, e->path, 1, p);
    if (!status) status = check_shape(e, p);
    if (!status && e->mask) status = sf_mask_look(l->ctx, e->mask, p);
    memcpy(r->fault, p->fault, sizeof r->fault);
    if (!status) status = find_camera(l, e, p, r, &lens, &camera);
    if (status || r->bad_pose) return status;
    r->alpha = p->has_alpha;
    r->rotated = p->orientation != 1;
    r->has_weight = e->mask || e->border_px || r->undistorted ||
                    (r->alpha && sf_alpha_is_weight(l->options, l->project->blends));
    status = sf_view_create_bare(l->ctx, e->name, &camera, e->split, &r->view);
    if (!status) describe_view(e, &lens, p, r);
    return status;
}

/* Waits until another picture may be read. */
static void take_turn(loading *l) {
    pthread_mutex_lock(&l->lock);
    while (!l->free) pthread_cond_wait(&l->freed, &l->lock);
    l->free--;
    pthread_mutex_unlock(&l->lock);
}

static void give_turn(loading *l) {
    pthread_mutex_lock(&l->lock);
    l->free++;
    pthread_cond_signal(&l->freed);
    pthread_mutex_unlock(&l->lock);
}

static void load_entry(void *arg, size_t task, int thread) {
    loading *l = arg;
    const sf_entry *e = &l->project->entries[task];
    result *r = &l->results[task];
    sf_picture p;
    (void)thread;
    r->bad_pose = e->bad_pose;
    if (r->bad_pose || atomic_load(&l->ctx->loads_cancelled)) return;
    if (l->plan.cache && sf_pixel_cache_fault(l->plan.cache)) return;
    take_turn(l);
    r->status = (l->options->no_pixels ? look_at_picture : read_picture)(l, e, &p, r);
    give_turn(l);
}

/* The scene from what was loaded. */

static sf_status take_result(const loading *l, size_t i, sf_scene *scene) {
    result *r = &l->results[i];
    if (r->bad_pose) {
        scene->skipped_pose++;
    } else if (r->status) {
        if (scene->skipped_missing++ < NAMES_IN_LOG)
            sf_log(l->ctx, SF_LOG_WARNING, "%s: skipped: %s", l->project->entries[i].path, r->fault);
    } else {
        scene->undistorted_views += (size_t)r->undistorted;
        scene->rotated_views += (size_t)r->rotated;
        sf_view *view = r->view;
        view->file = sf_text_copy(l->ctx, l->project->entries[i].path);
        if (!view->file) return SF_ERR_MEMORY;
        r->view = NULL;
        return sf_scene_take_view(scene, view);
    }
    return SF_OK;
}

/* What ends the whole, whatever became of other pictures; said again, since those may have failed later. */
static sf_status fatal_result(const loading *l) {
    sf_status full = l->plan.cache ? sf_pixel_cache_fault(l->plan.cache) : SF_OK;
    if (full) return full;
    for (size_t i = 0; i < l->project->count; i++) {
        const char *path = l->project->entries[i].path;
        sf_status status = l->results[i].status;
        if (status == SF_ERR_MEMORY) return sf_fail(l->ctx, status, "%s: out of memory", path);
        if (status == SF_ERR_ARGUMENT) return sf_fail(l->ctx, status, "%s: %s", path, l->results[i].fault);
    }
    return SF_OK;
}

static const char *first_bad_pose(const loading *l) {
    for (size_t i = 0; i < l->project->count; i++)
        if (l->results[i].bad_pose) return l->project->entries[i].path;
    return "";
}

static void report_hidden(const loading *l, const char *path) {
    const char *first = NULL;
    size_t count = 0;
    for (size_t i = 0; i < l->project->count; i++) {
        if (!l->results[i].hidden) continue;
        if (!first) first = l->project->entries[i].path;
        count++;
    }
    if (first)
        sf_log(
            l->ctx, SF_LOG_WARNING,
            "%s: %zu of %zu pictures have no pixel that counts: a mask or transparency hides all (first: %s)",
            path, count, l->project->count, first);
}

/* A lens that sees more than a pinhole camera can show. */
static void report_cropped(const loading *l, const char *path, const sf_scene *scene) {
    const sf_view *first = NULL;
    size_t count = 0;
    for (size_t i = 0; i < scene->view_count; i++) {
        const sf_view *v = scene->views[i];
        if (!sf_lens_is_cropped(&v->lens)) continue;
        if (!first) first = v;
        count++;
    }
    if (first)
        sf_log(l->ctx, SF_LOG_INFO,
               "%s: %zu views are cropped: a pinhole camera keeps %.0f of the %.0f degrees across that a %s "
               "sees (first: %s)",
               path, count, first->lens.kept, first->lens.seen, first->lens.model, first->name);
}

/* Cameras far from all others: views of the whole, or poses that are wrong; and such points. */
static void report_far(const loading *l, const char *path, sf_scene *scene) {
    enum { NAMED = 4 };
    sf_far_view far[NAMED];
    size_t count = sf_scene_far_views(scene, -1, far, NAMED);
    for (size_t i = 0; i < count && i < NAMED; i++)
        sf_log(l->ctx, SF_LOG_WARNING,
               "%s: the camera of %s is %.3g times as far from the cameras' middle as they usually are%s: it "
               "does not count for the scene's size",
               path, far[i].name, far[i].times,
               scene->point_count && !far[i].points ? ", and sees none of the points" : "");
    if (count > NAMED)
        sf_log(l->ctx, SF_LOG_WARNING, "%s: %zu more cameras are as far away", path, count - NAMED);
    size_t points = sf_scene_count_far_points(scene);
    if (points)
        sf_log(l->ctx, SF_LOG_INFO,
               "%s: %zu of %zu points are more than 100 times as far from the cameras as they usually are: "
               "they do not count for the scene's size",
               path, points, scene->point_count);
}

static void report(const loading *l, const char *path, sf_scene *scene) {
    size_t rotated = 0, alpha = 0;
    for (size_t i = 0; i < l->project->count; i++) {
        rotated += (size_t)l->results[i].rotated;
        alpha += (size_t)l->results[i].alpha;
    }
    if (alpha)
        sf_log(l->ctx, SF_LOG_INFO, "%s: %zu pictures have an alpha channel: %s", path, alpha,
               sf_alpha_says(l->options, l->project->blends));
    if (rotated)
        sf_log(l->ctx, SF_LOG_WARNING,
               "%s: %zu pictures carry an EXIF orientation: it is ignored, as poses assume", path, rotated);
    if (scene->skipped_missing)
        sf_log(l->ctx, SF_LOG_WARNING,
               "%s: %zu of %zu pictures skipped: missing, not decodable or of another shape", path,
               scene->skipped_missing, l->project->count);
    if (scene->skipped_pose)
        sf_log(l->ctx, SF_LOG_WARNING,
               "%s: %zu of %zu views skipped: pose or intrinsics not usable (first: %s)", path,
               scene->skipped_pose, l->project->count, first_bad_pose(l));
    if (scene->skipped_points)
        sf_log(l->ctx, SF_LOG_WARNING, "%s: skipped %zu of %zu points that are not finite (first: #%zu)",
               path, scene->skipped_points, scene->skipped_points + scene->point_count,
               scene->first_skipped_point);
    if (scene->undistorted_views)
        sf_log(l->ctx, SF_LOG_INFO, "%s: %zu views undistorted", path, scene->undistorted_views);
    report_cropped(l, path, scene);
    report_hidden(l, path);
    report_far(l, path, scene);
}

/* " (first: PATH: why)" of a picture that was skipped, or "". */
static void first_fault(const loading *l, char *text, size_t size) {
    *text = 0;
    for (size_t i = 0; i < l->project->count && !*text; i++)
        if (l->results[i].status)
            snprintf(text, size, " (first: %s: %s)", l->project->entries[i].path, l->results[i].fault);
}

/* Without a pixel that counts a fit would end with no Gaussian. */
static sf_status check_training(const loading *l, const char *path, const sf_scene *scene) {
    const sf_project *p = l->project;
    char fault[PATH_MAX + SF_PICTURE_FAULT_BYTES];
    size_t training = 0;
    for (size_t i = 0; i < scene->view_count; i++) {
        if (scene->views[i]->split != SF_SPLIT_TRAIN) continue;
        if (l->options->no_pixels || !sf_view_is_hidden(scene->views[i])) return SF_OK;
        training++;
    }
    if (training)
        return sf_fail(
            p->ctx, SF_ERR_EMPTY,
            "%s: none of %zu training views has a pixel that counts: masks or transparency hide all "
            "(in a mask black is ignored, white counts; no_masks and SF_ALPHA_IGNORE, --no-masks "
            "and --alpha ignore, take all pixels)",
            path, training);
    first_fault(l, fault, sizeof fault);
    return sf_fail(
        p->ctx, SF_ERR_EMPTY,
        "%s: no training view is left: of %zu views %zu lack a readable picture%s, %zu a usable pose, "
        "%zu are held out",
        path, p->count, scene->skipped_missing, fault, scene->skipped_pose, scene->view_count);
}

/* A point beyond floats is left out by the scene, with what is not finite. */
static sf_status add_points(const sf_project *p, sf_scene *scene) {
    float *xyz = sf_alloc(p->ctx, p->points, 3 * sizeof *xyz);
    if (!xyz) return SF_ERR_MEMORY;
    for (size_t i = 0; i < 3 * p->points; i++) xyz[i] = fabs(p->xyz[i]) <= FLT_MAX ? (float)p->xyz[i] : NAN;
    sf_status status = sf_scene_add_points(scene, p->points, xyz, p->rgb);
    sf_free(p->ctx, xyz);
    return status;
}

static sf_status fill_scene(loading *l, const char *path, sf_scene *scene) {
    const sf_project *p = l->project;
    sf_status fits = sf_plan_pictures(p, l->options, &l->plan);
    if (fits) return fits;
    l->free = l->plan.at_once;
    sf_pool_run(l->ctx->pool, p->count, load_entry, l);
    if (atomic_load(&l->ctx->loads_cancelled)) return sf_load_cancelled(l->ctx, path);
    sf_status status = fatal_result(l);
    for (size_t i = 0; !status && i < p->count; i++) status = take_result(l, i, scene);
    if (!status && p->points) status = add_points(p, scene);
    if (status) return status;
    report(l, path, scene);
    return check_training(l, path, scene);
}

sf_status sf_project_build(const sf_project *p, const sf_load_options *options, sf_scene **scene) {
    loading l = {.ctx = p->ctx, .project = p, .options = options};
    l.results = sf_calloc(p->ctx, p->count, sizeof *l.results);
    if (!l.results) return SF_ERR_MEMORY;
    pthread_mutex_init(&l.lock, NULL);
    pthread_cond_init(&l.freed, NULL);
    sf_status status = sf_scene_create(p->ctx, scene);
    if (!status) {
        (*scene)->kind = p->kind;
        memcpy((*scene)->origin, p->origin, sizeof p->origin);
        status = fill_scene(&l, p->path, *scene);
        if (status) sf_scene_destroy(scene);
    }
    for (size_t i = 0; i < p->count; i++)
        if (l.results[i].view) sf_view_release(l.results[i].view);
    sf_pixel_cache_release(l.plan.cache);
    pthread_cond_destroy(&l.freed);
    pthread_mutex_destroy(&l.lock);
    sf_free(p->ctx, l.results);
    return status;
}

/* One picture of the caller's. */

static sf_status add_picture(sf_scene *scene, const char *name, const sf_camera *camera, sf_split split,
                             const sf_picture *p, uint32_t *id) {
    sf_camera scaled = *camera;
    double x = (double)p->width / camera->width, y = (double)p->height / camera->height;
    scaled.width = p->width;
    scaled.height = p->height;
    scaled.fx *= x;
    scaled.cx *= x;
    scaled.fy *= y;
    scaled.cy *= y;
    sf_view *view;
    sf_status status = sf_view_create(scene->ctx, name, &scaled, split, p->weight != NULL, &view);
    if (status) return status;
    fill_view(p, 1, view);
    sf_view_retain(view); /* another thread may take it out of the scene at once */
    status = sf_scene_take_view(scene, view);
    if (!status && id) *id = view->id;
    sf_view_release(view);
    return status;
}

sf_status sf_scene_add_file(sf_scene *scene, const char *path, const sf_camera *camera, sf_split split,
                            uint32_t *id) {
    if (sf_camera_check(camera))
        return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "%s: camera: size, focal length or pose out of range",
                       path);
    sf_picture p;
    sf_status status = sf_picture_load(scene->ctx, path, &p);
    if (status) return status;
    const char *slash = strrchr(path, '/');
    status = add_picture(scene, slash ? slash + 1 : path, camera, split, &p, id);
    sf_picture_free(scene->ctx, &p);
    return status;
}
