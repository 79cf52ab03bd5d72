/* project.c - the keyframes as a COLMAP project: cameras, landmarks as points, pictures and masks. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "../base/linear.h"
#include "../io/colmap_write.h"
#include "../io/paths.h"
#include "../pose/landmark_map.h"
#include "live_state.h"

enum { QUALITY = 95, LEAST_OBSERVATIONS = 2, NAME = 32 };

/* A keyframe as it is written. */
typedef struct entry {
    sf_view *view;    /* retained */
    sf_camera camera; /* its pose in the world */
    char name[NAME];
    uint32_t camera_id;
    uint64_t features;
} entry;

typedef struct project {
    sf_context *ctx;
    const sf_landmarks *map;
    const sf_world *world; /* where the map lies, if it began from pictures */
    double origin[3];
    entry *entries;
    size_t count;
    uint32_t cameras;
    uint32_t *entry_of;   /* [keyframes of the map]; count: of none */
    uint32_t *feature_of; /* [observations of the map] */
    size_t *observations; /* [landmarks] */
} project;

/* ---- 1. What is written ---- */

static int has_same_lens(const sf_camera *a, const sf_camera *b) {
    return a->width == b->width && a->height == b->height && a->fx == b->fx && a->fy == b->fy &&
           a->cx == b->cx && a->cy == b->cy;
}

/* COLMAP counts from 1. */
static void number_camera(project *p, entry *e) {
    for (const entry *before = p->entries; before < e && !e->camera_id; before++)
        if (has_same_lens(&before->camera, &e->camera)) e->camera_id = before->camera_id;
    if (!e->camera_id) e->camera_id = ++p->cameras;
}

static sf_status take_keyframes(project *p, sf_live *live) {
    for (size_t i = 0; i < live->keyframes.count; i++) {
        entry *e = &p->entries[p->count];
        *e = (entry){.view = sf_scene_retain_id(live->scene, live->keyframes.list[i].id)};
        if (!e->view) continue;
        p->count++;
        e->camera = e->view->camera;
        if (live->fitter) (void)sf_fitter_get_camera(live->fitter, e->view->id, &e->camera);
        if (p->world->is_known) sf_camera_transform(&e->camera, &p->world->similarity);
        for (int k = 0; k < 3; k++) e->camera.t_cw[k] -= sf_dot3(e->camera.R_cw + 3 * k, p->origin);
        snprintf(e->name, sizeof e->name, "frame_%06u.jpg", (unsigned)e->view->id);
        number_camera(p, e);
    }
    return p->count ? SF_OK : sf_fail(p->ctx, SF_ERR_EMPTY, "live: there is no keyframe yet");
}

/* Which observations become features, in which order; and how many each landmark has. */
static void number_features(project *p) {
    const sf_landmarks *map = p->map;
    for (size_t k = 0; k < map->keyframe_count; k++) {
        p->entry_of[k] = (uint32_t)p->count;
        for (size_t i = 0; i < p->count; i++)
            if (p->entries[i].view->id == map->keyframes[k].id) p->entry_of[k] = (uint32_t)i;
    }
    for (size_t i = 0; i < map->observation_count; i++) {
        const sf_landmark_observation *o = &map->observations[i];
        uint32_t at = p->entry_of[o->keyframe];
        if (at == p->count) continue;
        p->feature_of[i] = (uint32_t)p->entries[at].features++;
        p->observations[o->landmark]++;
    }
}

static sf_status prepare(project *p, sf_live *live) {
    const sf_landmarks *map = live->localizer.landmarks;
    *p = (project){.ctx = live->ctx, .map = map, .world = &live->world};
    sf_scene_get_origin(live->scene, p->origin);
    p->entries = sf_calloc(p->ctx, live->keyframes.count + 1, sizeof *p->entries);
    p->entry_of = sf_calloc(p->ctx, map->keyframe_count + 1, sizeof *p->entry_of);
    p->feature_of = sf_calloc(p->ctx, map->observation_count + 1, sizeof *p->feature_of);
    p->observations = sf_calloc(p->ctx, map->count + 1, sizeof *p->observations);
    if (!p->entries || !p->entry_of || !p->feature_of || !p->observations) return SF_ERR_MEMORY;
    sf_status status = take_keyframes(p, live);
    if (!status) number_features(p);
    return status;
}

static void release(project *p) {
    for (size_t i = 0; i < p->count; i++) sf_view_release(p->entries[i].view);
    sf_free(p->ctx, p->entries);
    sf_free(p->ctx, p->entry_of);
    sf_free(p->ctx, p->feature_of);
    sf_free(p->ctx, p->observations);
}

/* ---- 2. sparse/0 ---- */

static int is_point(const project *p, size_t landmark) {
    return p->map->all[landmark].state == SF_LANDMARK_KNOWN &&
           p->observations[landmark] >= LEAST_OBSERVATIONS;
}

static void put_cameras(sf_writer *w, const void *user) {
    const project *p = user;
    uint32_t next = 1;
    sf_colmap_put_count(w, p->cameras);
    for (size_t i = 0; i < p->count; i++) {
        const sf_camera *c = &p->entries[i].camera;
        const sf_lens lens = {.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy};
        if (p->entries[i].camera_id != next) continue;
        sf_colmap_put_camera(w, next++, c->width, c->height, &lens);
    }
}

static void put_features(sf_writer *w, const project *p, size_t entry_index) {
    for (size_t i = 0; i < p->map->observation_count; i++) {
        const sf_landmark_observation *o = &p->map->observations[i];
        if (p->entry_of[o->keyframe] != entry_index) continue;
        sf_colmap_put_feature(w, o->u, o->v, is_point(p, o->landmark) ? o->landmark + 1 : UINT64_MAX);
    }
}

static void put_images(sf_writer *w, const void *user) {
    const project *p = user;
    sf_colmap_put_count(w, p->count);
    for (size_t i = 0; i < p->count; i++) {
        const entry *e = &p->entries[i];
        sf_colmap_put_image(w, &(sf_colmap_image){.id = (uint32_t)i + 1,
                                                  .camera = e->camera_id,
                                                  .R_cw = e->camera.R_cw,
                                                  .t_cw = e->camera.t_cw,
                                                  .name = e->name,
                                                  .features = e->features});
        put_features(w, p, i);
    }
}

static void add_color(const entry *e, const sf_landmark_observation *o, double rgb[3]) {
    int width = e->camera.width, height = e->camera.height;
    size_t x = (size_t)fmin(fmax(o->u, 0), width - 1), y = (size_t)fmin(fmax(o->v, 0), height - 1);
    for (size_t c = 0; c < 3; c++) rgb[c] += e->view->rgb[(c * (size_t)height + y) * (size_t)width + x];
}

/* Squared distance, px, from where the keyframe saw a place (world) to where it is. */
static double squared_error(const entry *e, const sf_landmark_observation *o, const double at[3]) {
    const sf_camera *c = &e->camera;
    double q[3];
    for (int k = 0; k < 3; k++) q[k] = sf_dot3(c->R_cw + 3 * k, at) + c->t_cw[k];
    return pow(c->fx * q[0] / q[2] + c->cx - o->u, 2) + pow(c->fy * q[1] / q[2] + c->cy - o->v, 2);
}

/* Observations by landmark: those of one from first[landmark] on. */
typedef struct by_landmark {
    size_t *first; /* [landmarks + 1] */
    size_t *list;  /* [observations] */
} by_landmark;

static void sort_observations(const project *p, by_landmark *by) {
    const sf_landmarks *map = p->map;
    for (size_t l = 0; l < map->count; l++) by->first[l + 1] = by->first[l] + p->observations[l];
    for (size_t i = 0; i < map->observation_count; i++)
        if (p->entry_of[map->observations[i].keyframe] != p->count)
            by->list[by->first[map->observations[i].landmark]++] = i;
    for (size_t l = map->count; l > 0; l--) by->first[l] = by->first[l - 1];
    by->first[0] = 0;
}

static void put_point(sf_writer *w, const project *p, size_t landmark, const size_t *list) {
    size_t count = p->observations[landmark];
    double at[3], rgb[3] = {0}, squares = 0;
    const sf_similarity *s = &p->world->similarity;
    memcpy(at, p->map->all[landmark].at, sizeof at);
    if (p->world->is_known)
        for (int k = 0; k < 3; k++)
            at[k] = s->scale * sf_dot3(s->R + 3 * k, p->map->all[landmark].at) + s->move[k];
    for (int k = 0; k < 3; k++) at[k] += p->origin[k];
    for (size_t i = 0; i < count; i++) {
        const sf_landmark_observation *o = &p->map->observations[list[i]];
        const entry *e = &p->entries[p->entry_of[o->keyframe]];
        add_color(e, o, rgb);
        squares += squared_error(e, o, at);
    }
    sf_colmap_point point = {
        .id = landmark + 1, .at = at, .error = sqrt(squares / (double)count), .observations = count};
    for (int c = 0; c < 3; c++) point.rgb[c] = (uint8_t)(rgb[c] / (double)count + 0.5);
    sf_colmap_put_point(w, &point);
    for (size_t i = 0; i < count; i++)
        sf_colmap_put_observation(w, p->entry_of[p->map->observations[list[i]].keyframe] + 1,
                                  p->feature_of[list[i]]);
}

static void put_points(sf_writer *w, const void *user) {
    const project *p = user;
    by_landmark by = {.first = sf_calloc(p->ctx, p->map->count + 2, sizeof *by.first),
                      .list = sf_calloc(p->ctx, p->map->observation_count + 1, sizeof *by.list)};
    size_t points = 0;
    if (by.first && by.list) {
        for (size_t l = 0; l < p->map->count; l++) points += is_point(p, l) != 0;
        sf_colmap_put_count(w, points);
        sort_observations(p, &by);
        for (size_t l = 0; l < p->map->count; l++)
            if (is_point(p, l)) put_point(w, p, l, by.list + by.first[l]);
    } else {
        w->status = SF_ERR_MEMORY;
    }
    sf_free(p->ctx, by.first);
    sf_free(p->ctx, by.list);
}

/* ---- 3. Pictures ---- */

/* Writes rgb [height][width][3], 0..1. */
static sf_status write_picture(sf_context *ctx, const entry *e, const char *path, float *rgb) {
    uint8_t *file = NULL;
    size_t size;
    sf_status status = sf_encode_jpeg(ctx, e->camera.width, e->camera.height, rgb, QUALITY, &file, &size);
    if (!status) status = sf_write_file_unsynced(ctx, path, file, size);
    if (file) sf_encoded_free(ctx, &file);
    return status;
}

/* The picture; or where the lens left a part of it empty, white on black. */
static sf_status write_keyframe(const project *p, const entry *e, const char *folder, int mask) {
    size_t pixels = (size_t)e->camera.width * (size_t)e->camera.height;
    float *rgb = sf_alloc(p->ctx, pixels, 3 * sizeof *rgb);
    char name[NAME + 4];
    snprintf(name, sizeof name, mask ? "%s.png" : "%s", e->name);
    char *path = sf_path_join(p->ctx, folder, name);
    sf_status status = rgb && path ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < pixels; i++)
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = (float)(mask ? e->view->weight[i] : e->view->rgb[c * pixels + i]) / 255;
    if (!status)
        status = mask ? sf_write_png(p->ctx, path, e->camera.width, e->camera.height, rgb)
                      : write_picture(p->ctx, e, path, rgb);
    sf_free(p->ctx, rgb);
    sf_free(p->ctx, path);
    return status;
}

static sf_status make_folder(sf_context *ctx, const char *project_folder, const char *name, char **path) {
    *path = *name ? sf_path_join(ctx, project_folder, name) : sf_text_copy(ctx, project_folder);
    if (!*path) return SF_ERR_MEMORY;
    if (!mkdir(*path, 0777) || errno == EEXIST) return SF_OK;
    return sf_fail(ctx, SF_ERR_IO, "%s: %s", *path, strerror(errno));
}

static sf_status write_pictures(const project *p, const char *images, const char *masks) {
    sf_status status = SF_OK;
    for (size_t i = 0; i < p->count && !status; i++) {
        const entry *e = &p->entries[i];
        status = write_keyframe(p, e, images, 0);
        if (!status && e->view->weight) status = write_keyframe(p, e, masks, 1);
    }
    return status;
}

static sf_status write_project(const project *p, const char *folder) {
    static const sf_colmap_put puts[] = {put_cameras, put_images, put_points};
    enum { PROJECT, SPARSE, MODEL, IMAGES, MASKS, FOLDERS };
    static const char *const names[FOLDERS] = {"", "sparse", "sparse/0", "images", "masks"};
    char *paths[FOLDERS] = {NULL};
    int masked = 0;
    sf_status status = SF_OK;
    for (size_t i = 0; i < p->count; i++) masked |= p->entries[i].view->weight != NULL;
    for (int i = 0; i < FOLDERS && !status; i++)
        if (i != MASKS || masked) status = make_folder(p->ctx, folder, names[i], &paths[i]);
    if (!status) status = write_pictures(p, paths[IMAGES], paths[MASKS]);
    if (!status) status = sf_colmap_save(p->ctx, paths[MODEL], puts, p);
    for (int i = 0; i < FOLDERS; i++) sf_free(p->ctx, paths[i]);
    return status;
}

sf_status sf_live_save_project(sf_live *live, const char *folder) {
    project p;
    sf_status status = prepare(&p, live);
    if (!status) status = write_project(&p, folder);
    release(&p);
    return status;
}
