/* points.c - new Gaussians where a keyframe shows what the model lacks. */
#include "points.h"

#include <math.h>
#include <string.h>

#include "../fit/online.h"
#include "../scene/neighbours.h"
#include "keyframe_exposure.h"

enum {
    POINTS = 3000, /* a search, at most */
    NEIGHBOURS = 5,
    EVERY = 4,   /* px: where it is looked whether a search is worth while */
    CELL = 8,    /* px */
    CROWDED = 12 /* Gaussians in 3 x 3 cells, at a point's depth: no others are needed there */
};

#define LACKING 0.12    /* of a picture, for a search: below, some 50 of its 3,000 points are taken */
#define LARGE   8.0     /* px: no new Gaussian has a greater radius in a keyframe */
#define OPEN    0.4f    /* transmittance of where nothing is */
#define WRONG   0.06    /* grey */
#define FAINT   (-3.0f) /* log2 of the opacity of what is not counted */
#define DEPTH   0.08f   /* of a depth: what lies within is at it */

/* Gaussians by the cell that their middle is drawn in, as lists of indices; NOBODY ends one. */
#define NOBODY UINT32_MAX
typedef struct crowd {
    const sf_workspace *ws;
    size_t across, down;
    uint32_t *first, *next; /* [down][across], [count] */
} crowd;

/* The newest keyframe that is trained on and was not searched yet; NULL: there is none. */
static sf_keyframe *unsearched(const sf_keyframes *keyframes) {
    size_t at = keyframes->count;
    while (at && (keyframes->list[at - 1].held_out || keyframes->list[at - 1].searched)) at--;
    return at ? &keyframes->list[at - 1] : NULL;
}

/* That keyframe and its neighbours; references are the caller's. */
static size_t spawn_views(sf_live *live, const sf_keyframe *keyframe, sf_view *views[SF_SPAWN_VIEWS]) {
    size_t n = 0, count = 0, self = SIZE_MAX, chosen[NEIGHBOURS];
    sf_view **all = sf_alloc(live->ctx, live->keyframes.count, sizeof *all);
    const sf_camera **cameras = sf_alloc(live->ctx, live->keyframes.count, sizeof *cameras);
    for (size_t i = 0; all && cameras && i < live->keyframes.count; i++) {
        const sf_keyframe *k = &live->keyframes.list[i];
        sf_view *view = k->held_out ? NULL : sf_scene_retain_id(live->scene, k->id);
        if (!view) continue;
        if (k == keyframe) self = count;
        cameras[count] = &view->camera;
        all[count++] = view;
    }
    if (self < count) {
        views[n++] = sf_view_retain(all[self]);
        size_t found =
            sf_choose_neighbours(cameras, count, self, live->localizer.distance, NEIGHBOURS, chosen);
        for (size_t i = 0; i < found; i++) views[n++] = sf_view_retain(all[chosen[i]]);
    }
    for (size_t i = 0; i < count; i++) sf_view_release(all[i]);
    sf_free(live->ctx, all);
    sf_free(live->ctx, cameras);
    return n;
}

/* Those of the drawing that are more than faint. */
static sf_status gather(sf_context *ctx, const sf_workspace *ws, crowd *c) {
    size_t width = (size_t)ws->eye.width, height = (size_t)ws->eye.height;
    *c = (crowd){.ws = ws, .across = (width + CELL - 1) / CELL, .down = (height + CELL - 1) / CELL};
    c->first = sf_alloc(ctx, c->across * c->down, sizeof *c->first);
    c->next = sf_alloc(ctx, ws->count, sizeof *c->next);
    if (!c->first || !c->next) return SF_ERR_MEMORY;
    for (size_t i = 0; i < c->across * c->down; i++) c->first[i] = NOBODY;
    for (size_t i = 0; i < ws->count; i++) {
        const sf_splat *g = &ws->splats[i];
        if (ws->state[i] != SF_SEEN || g->log2_opacity < FAINT) continue;
        if (!(g->u >= 0 && g->v >= 0 && g->u < (float)width && g->v < (float)height)) continue;
        uint32_t *list = &c->first[(size_t)g->v / CELL * c->across + (size_t)g->u / CELL];
        c->next[i] = *list, *list = (uint32_t)i;
    }
    return SF_OK;
}

/* Whether there are Gaussians enough about a point that falls on a pixel at depth z, in the model's unit. */
static int is_crowded(const crowd *c, size_t px, size_t py, float z) {
    size_t column = px / CELL, row = py / CELL;
    int n = 0;
    for (size_t y = row ? row - 1 : 0; y <= row + 1 && y < c->down; y++)
        for (size_t x = column ? column - 1 : 0; x <= column + 1 && x < c->across; x++)
            for (uint32_t i = c->first[y * c->across + x]; i != NOBODY; i = c->next[i])
                n += fabsf(c->ws->splats[i].depth - z) < DEPTH * z;
    return n > CROWDED;
}

/* What a keyframe shows, and the model drawn as it does. */
typedef struct sight {
    const sf_view *view;
    sf_camera camera;
    double gain[SF_SPAWN_VIEWS][3],
        bias[SF_SPAWN_VIEWS][3]; /* of the views that were searched, its own first */
    crowd crowd;
} sight;

/* Mean difference of the channels at a pixel, without the picture's exposure. */
static double error_at(const sight *s, size_t x, size_t y) {
    const sf_workspace *ws = s->crowd.ws;
    size_t width = (size_t)s->camera.width, plane = width * (size_t)s->camera.height;
    double sum = 0;
    for (size_t k = 0; k < 3; k++) {
        double seen = s->view->rgb[k * plane + y * width + x] / 255.0;
        sum += fabs((seen - s->bias[0][k]) / s->gain[0][k] - (double)ws->rgb[k][y * ws->stride + x]);
    }
    return sum / 3;
}

/* Whether the model lacks what a pixel shows at a depth: nothing is there, or it errs and has few Gaussians.
 * Where it is crowded growth has enough to go on from. */
static int lacks(const sight *s, size_t x, size_t y, float depth) {
    const sf_workspace *ws = s->crowd.ws;
    if (s->view->weight && !s->view->weight[y * (size_t)s->camera.width + x]) return 0; /* masked */
    if (ws->transmittance[y * ws->stride + x] <= OPEN && error_at(s, x, y) <= WRONG) return 0;
    return !is_crowded(&s->crowd, x, y, depth);
}

/* Whether it lacks what was found at a point. */
static int is_missing(const sight *s, const float *xyz) {
    double u, v, z, p[3] = {(double)xyz[0], (double)xyz[1], (double)xyz[2]};
    if (!sf_camera_sees(&s->camera, p, &u, &v, &z)) return 0;
    return lacks(s, (size_t)u, (size_t)v, (float)ldexp(z, -s->crowd.ws->unit));
}

/* A point's colour as it would be without the exposure of the picture that it is from. */
static void expose_back(uint8_t *rgb, const double gain[3], const double bias[3]) {
    for (int k = 0; k < 3; k++) {
        double value = 255 * (rgb[k] / 255.0 - bias[k]) / gain[k];
        rgb[k] = (uint8_t)(fmin(fmax(value, 0), 255) + 0.5);
    }
}

/* A keyframe that was taken from near shows in detail what is around the point, and the model has it: a few
 * Gaussians as wide as points are apart in a picture from far away hid so much of it that it fell by 2 to
 * 3 dB until they were fitted. */
float sf_limit_radius(const sf_keyframes *keyframes, const sf_camera *c, double near_plane,
                      const float xyz[3], float radius) {
    const double p[3] = {(double)xyz[0], (double)xyz[1], (double)xyz[2]};
    double least = (double)radius;
    for (size_t i = 0; i < keyframes->count; i++) {
        double q[3];
        sf_rigid_apply(&keyframes->list[i].pose, p, q);
        double most = LARGE * q[2] / c->fx, reach = 3 * least * c->fx / q[2];
        if (q[2] < near_plane || least <= most) continue;
        double u = c->fx * q[0] / q[2] + c->cx, v = c->fy * q[1] / q[2] + c->cy;
        if (u > -reach && v > -reach && u < c->width + reach && v < c->height + reach) least = most;
    }
    return (float)least;
}

/* Those that the model lacks stay, in the scene's own colours. */
static void keep_missing(const sf_live *live, const sight *s, sf_spawned_points *points) {
    size_t n = 0;
    sf_cloud *cloud = &points->cloud;
    double near_plane = sf_online_near_plane(live->fitter);
    for (size_t i = 0; i < cloud->n; i++) {
        if (!is_missing(s, cloud->xyz + 3 * i)) continue;
        uint32_t from = cloud->view[i];
        memmove(cloud->xyz + 3 * n, cloud->xyz + 3 * i, 3 * sizeof *cloud->xyz);
        memmove(cloud->rgb + 3 * n, cloud->rgb + 3 * i, 3);
        expose_back(cloud->rgb + 3 * n, s->gain[from], s->bias[from]);
        cloud->view[n] = from;
        points->radius[n] = sf_limit_radius(&live->keyframes, &live->input.frame.camera, near_plane,
                                            cloud->xyz + 3 * n, points->radius[i]);
        n++;
    }
    cloud->n = n;
}

/* Draws the model as a keyframe shows it; `sight` is the caller's to free even so. */
static sf_status look_through(sf_live *live, const sf_view *view, sight *s) {
    const sf_workspace *ws;
    s->view = view;
    sf_status status = sf_fitter_get_camera(live->fitter, view->id, &s->camera);
    if (!status) status = sf_online_draw(live->fitter, &s->camera, &ws);
    return status ? status : gather(live->ctx, ws, &s->crowd);
}

static void free_sight(sf_live *live, sight *s) {
    sf_free(live->ctx, s->crowd.first);
    sf_free(live->ctx, s->crowd.next);
}

/* The part of a keyframe's picture in which the model lacks something. */
static double lacking_part(const sight *s) {
    const sf_workspace *ws = s->crowd.ws;
    size_t lacking = 0, all = 0;
    for (size_t y = EVERY / 2; y < (size_t)s->camera.height; y += EVERY)
        for (size_t x = EVERY / 2; x < (size_t)s->camera.width; x += EVERY, all++) {
            size_t at = y * ws->stride + x;
            float open = ws->transmittance[at];
            lacking += lacks(s, x, y, ws->depth[at] / fmaxf(1 - open, 1e-6f));
        }
    return all ? (double)lacking / (double)all : 0;
}

static void exposure_of(const sf_live *live, uint32_t id, double gain[3], double bias[3]) {
    for (int c = 0; c < 3; c++) gain[c] = 1, bias[c] = 0;
    if (live->options.fit.exposure) sf_keyframe_exposure(&live->keyframes, live->fitter, id, gain, bias);
}

/* Whether a search is worth its time. */
static sf_status is_wanting(sf_live *live, const sf_view *view, int *wanting) {
    sight s = {0};
    exposure_of(live, view->id, s.gain[0], s.bias[0]);
    sf_status status = look_through(live, view, &s);
    if (!status) *wanting = lacking_part(&s) > LACKING;
    free_sight(live, &s);
    return status;
}

sf_status sf_live_ask_for_points(sf_live *live) {
    sf_view *views[SF_SPAWN_VIEWS];
    sf_keyframe *keyframe =
        live->fitter && sf_spawner_idle(live->spawning.spawner) ? unsearched(&live->keyframes) : NULL;
    sf_status status = SF_OK;
    int wanting = 0;
    if (!keyframe) return SF_OK;
    size_t n = spawn_views(live, keyframe, views);
    keyframe->searched = 1;
    if (n > 1) status = is_wanting(live, views[0], &wanting);
    if (!status && wanting) {
        sf_sweep_options options = {.wanted = POINTS,
                                    .nearest = sf_online_near_plane(live->fitter),
                                    .extent = sf_online_extent(live->fitter),
                                    .first_alone = 1};
        sf_spawner_search(live->spawning.spawner, views, n, &options);
        if (live->options.steps_per_frame > 0) sf_spawner_wait(live->spawning.spawner); /* to be repeated */
    }
    for (size_t i = 0; i < n; i++) sf_view_release(views[i]);
    return status;
}

static sf_status choose_points(sf_live *live, sf_spawned_points *points, const sf_view *view) {
    sight s = {0};
    for (int i = 0; i < SF_SPAWN_VIEWS; i++) exposure_of(live, points->ids[i], s.gain[i], s.bias[i]);
    sf_status status = look_through(live, view, &s);
    if (!status) keep_missing(live, &s, points);
    free_sight(live, &s);
    return status;
}

sf_status sf_live_take_points(sf_live *live) {
    sf_spawned_points points;
    size_t added = 0;
    if (!live->fitter || !sf_spawner_take(live->spawning.spawner, &points)) return SF_OK;
    sf_view *view = sf_scene_retain_id(live->scene, points.ids[0]);
    sf_status status = SF_OK;
    if (view && points.cloud.n) {
        status = choose_points(live, &points, view);
        if (!status)
            status = sf_fitter_add_points(live->fitter, points.cloud.n, points.cloud.xyz, points.cloud.rgb,
                                          points.radius, &added);
    }
    live->spawning.spawned += added;
    sf_view_release(view);
    sf_spawned_points_free(live->spawning.spawner, &points);
    return status;
}
