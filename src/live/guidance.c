/* guidance.c - see guidance.h. A look at a keyframe takes some ms: the model is drawn in a small size. */
#include "guidance.h"

#include <math.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/linear.h"
#include "../fit/online.h"

enum { LONGER_SIDE = 64 }; /* px, of a small picture */

#define CELL        0.1  /* of the distance to the scene */
#define FAR         6    /* distances, beyond which nothing is counted */
#define SAME_EXTENT 0.1  /* part by which it may change */
#define SHARE       0.02 /* of the time, for looks */
#define MEMORY      0.1  /* of a look in the mean time of one */
#define IN_SIGHT    0.7  /* s, between two looks at what is in sight */
#define OPAQUE      0.3f /* transmittance, below which there is a surface */
#define ERROR_LEAST 1e-9

void sf_guidance_init(sf_guidance *g, sf_context *ctx) {
    *g = (sf_guidance){.coverage = {.ctx = ctx}, .brightness = NAN, .in_sight = NAN};
}

void sf_guidance_clear(sf_guidance *g) {
    sf_coverage_clear(&g->coverage, 0, 0);
    g->extent = 0, g->in_sight = g->brightness = NAN;
}

void sf_guidance_free(sf_guidance *g) { sf_coverage_free(&g->coverage); }

/* 1. Small pictures */

/* The model drawn small, and where a picture is compared, that. One block at `rgb`. */
typedef struct small {
    sf_camera camera;
    size_t pixels;
    float *rgb, *seen; /* [height][width][3] */
    float *transmittance, *depth, *error, *weight;
} small;

static sf_camera small_camera(const sf_camera *c) {
    double by = fmin(1, LONGER_SIDE / fmax(c->width, c->height));
    sf_camera s = *c;
    s.width = (int32_t)fmax(1, round(c->width * by)), s.height = (int32_t)fmax(1, round(c->height * by));
    double x = (double)s.width / c->width, y = (double)s.height / c->height;
    s.fx *= x, s.cx *= x, s.fy *= y, s.cy *= y;
    return s;
}

/* The depth is 0 where the model shows nothing. sf_free s->rgb, also after a failure. */
static sf_status draw_small(sf_live *live, const sf_camera *camera, small *s) {
    *s = (small){.camera = *camera, .pixels = (size_t)camera->width * (size_t)camera->height};
    s->rgb = sf_calloc(live->ctx, 10 * s->pixels, sizeof *s->rgb);
    if (!s->rgb) return SF_ERR_MEMORY;
    s->seen = s->rgb + 3 * s->pixels, s->transmittance = s->rgb + 6 * s->pixels;
    s->depth = s->rgb + 7 * s->pixels, s->error = s->rgb + 8 * s->pixels, s->weight = s->rgb + 9 * s->pixels;
    sf_image_out out = {.rgb = s->rgb, .transmittance = s->transmittance, .depth = s->depth};
    sf_status status = sf_fitter_render(live->fitter, camera, &out);
    for (size_t i = 0; i < s->pixels; i++)
        s->depth[i] = s->transmittance[i] < OPAQUE ? s->depth[i] / (1 - s->transmittance[i]) : 0;
    return status;
}

/* Means over boxes of the view's pixels. */
static void reduce(const sf_view *v, small *s) {
    size_t width = (size_t)v->camera.width, height = (size_t)v->camera.height, at = 0;
    size_t w = (size_t)s->camera.width, h = (size_t)s->camera.height;
    for (size_t y = 0; y < h; y++)
        for (size_t x = 0; x < w; x++, at++) {
            size_t top = y * height / h, bottom = (y + 1) * height / h;
            size_t left = x * width / w, right = (x + 1) * width / w;
            double sum[3] = {0}, weight = 0, n = (double)((bottom - top) * (right - left));
            for (size_t j = top; j < bottom; j++)
                for (size_t i = left; i < right; i++) {
                    size_t from = j * width + i;
                    for (size_t c = 0; c < 3; c++) sum[c] += v->rgb[c * width * height + from];
                    weight += v->weight ? v->weight[from] : 255;
                }
            for (size_t c = 0; c < 3; c++) s->seen[3 * at + c] = (float)(sum[c] / n / 255);
            s->weight[at] = (float)(weight / n / 255);
        }
}

static int counts(const small *s, size_t i) { return s->depth[i] > 0 && s->weight[i] > 0.5f; }

/* The picture's exposure, a gain and a bias by least squares, is taken out of the differences of a channel.
 */
static void subtract(small *s, size_t c) {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (size_t i = 0; i < s->pixels; i++) {
        if (!counts(s, i)) continue;
        double a = (double)s->rgb[3 * i + c], b = (double)s->seen[3 * i + c];
        n++, x += a, y += b, xx += a * a, xy += a * b;
    }
    double variance = n * xx - x * x, gain = variance > ERROR_LEAST ? (n * xy - x * y) / variance : 1;
    double bias = n > 0 ? (y - gain * x) / n : 0;
    for (size_t i = 0; i < s->pixels; i++)
        s->seen[3 * i + c] -= (float)(gain * (double)s->rgb[3 * i + c] + bias);
}

/* The mean over the pixel and its neighbours: what differs between two neighbours alone comes of how the two
 * pictures were reduced. */
static float smooth(const small *s, int x, int y, size_t c) {
    float sum = 0, n = 0;
    for (int j = y - 1; j <= y + 1; j++)
        for (int i = x - 1; i <= x + 1; i++) {
            size_t at = (size_t)j * (size_t)s->camera.width + (size_t)i;
            if (i < 0 || j < 0 || i >= s->camera.width || j >= s->camera.height || !counts(s, at)) continue;
            sum += s->seen[3 * at + c], n++;
        }
    return n > 0 ? sum / n : 0;
}

static void compare(small *s) {
    for (size_t c = 0; c < 3; c++) {
        subtract(s, c);
        for (int y = 0; y < s->camera.height; y++)
            for (int x = 0; x < s->camera.width; x++)
                s->error[(size_t)y * (size_t)s->camera.width + (size_t)x] += fabsf(smooth(s, x, y, c)) / 3;
    }
    for (size_t i = 0; i < s->pixels; i++)
        if (!counts(s, i)) s->depth[i] = 0;
}

/* 2. Looks */

static sf_status look_at(sf_live *live, const sf_keyframe *k) {
    sf_camera camera;
    small s = {.rgb = NULL};
    sf_view *view = sf_scene_retain_id(live->scene, k->id);
    if (!view) return SF_OK;
    sf_status status = sf_fitter_get_camera(live->fitter, k->id, &camera);
    if (status) camera = view->camera;
    camera = small_camera(&camera);
    status = draw_small(live, &camera, &s);
    if (!status) {
        reduce(view, &s);
        compare(&s);
        status = sf_coverage_see(&live->guidance.coverage, k->id, &(sf_depth_map){&camera, s.depth, s.error});
    }
    sf_free(live->ctx, s.rgb);
    sf_view_release(view);
    return status;
}

static sf_status draw(sf_live *live, const sf_camera *camera, uint8_t *coverage) {
    small s;
    sf_status status = draw_small(live, camera, &s);
    for (size_t i = 0; !status && i < s.pixels; i++) {
        double place[3];
        sf_live_cell told;
        int width = camera->width;
        const sf_coverage_cell *cell = NULL;
        if (s.depth[i] > 0) {
            sf_coverage_place(camera, (int)(i % (size_t)width), (int)(i / (size_t)width), (double)s.depth[i],
                              place);
            cell = sf_coverage_at(&live->guidance.coverage, place);
        }
        if (cell) sf_coverage_tell(&live->guidance.coverage, cell, &told);
        coverage[i] = cell ? (uint8_t)(254 * told.coverage + 0.5f) : SF_COVERAGE_UNKNOWN;
    }
    sf_free(live->ctx, s.rgb);
    return status;
}

/* The mean coverage of what the camera sees now. */
static sf_status look_ahead(sf_live *live) {
    sf_camera camera = small_camera(&live->input.frame.camera);
    size_t pixels = (size_t)camera.width * (size_t)camera.height, n = 0;
    uint8_t *coverage = sf_alloc(live->ctx, pixels, 1);
    double sum = 0;
    if (!coverage) return SF_ERR_MEMORY;
    sf_status status = draw(live, &camera, coverage);
    for (size_t i = 0; !status && i < pixels; i++)
        if (coverage[i] != SF_COVERAGE_UNKNOWN) sum += coverage[i] / 254.0, n++;
    live->guidance.in_sight = 4 * n > pixels ? sum / (double)n : NAN;
    sf_free(live->ctx, coverage);
    return status;
}

/* A keyframe that was not looked at yet, the newest first; else one after another. NULL: there is none. */
static const sf_keyframe *next_keyframe(sf_live *live) {
    const sf_keyframes *all = &live->keyframes;
    for (size_t i = all->count; i-- > 0;)
        if (!all->list[i].held_out && !sf_coverage_has(&live->guidance.coverage, all->list[i].id))
            return &all->list[i];
    for (size_t i = 0; i < all->count; i++) {
        const sf_keyframe *k = &all->list[live->guidance.turn++ % all->count];
        if (!k->held_out) return k;
    }
    return NULL;
}

static void drop_removed(sf_live *live) {
    sf_coverage *c = &live->guidance.coverage;
    for (size_t i = c->view_count; i-- > 0;) {
        size_t k = 0;
        while (k < live->keyframes.count && live->keyframes.list[k].id != c->views[i].id) k++;
        if (k == live->keyframes.count) sf_coverage_drop(c, c->views[i].id);
    }
}

/* Cells suit the distance to the scene, which changes where the world's unit does. */
static void fit_cells(sf_live *live) {
    sf_guidance *g = &live->guidance;
    double extent = sf_online_extent(live->fitter);
    if (fabs(extent - g->extent) <= SAME_EXTENT * g->extent) return;
    sf_coverage_clear(&g->coverage, CELL * extent, FAR * extent);
    g->extent = extent;
}

sf_status sf_live_look_around(sf_live *live) {
    sf_guidance *g = &live->guidance;
    double began = sf_clock();
    sf_status status = SF_OK;
    if (began < g->next) return SF_OK;
    fit_cells(live);
    drop_removed(live);
    if (began >= g->next_in_sight && live->input.frame.from != SF_POSE_NONE) {
        status = look_ahead(live);
        g->next_in_sight = began + IN_SIGHT;
        sf_coverage_choose_worst(&g->coverage);
    } else {
        const sf_keyframe *k = next_keyframe(live);
        if (k) status = look_at(live, k);
    }
    double took = sf_clock() - began;
    g->ms += (g->ms > 0 ? MEMORY : 1) * (1e3 * took - g->ms);
    g->next = began + took / SHARE;
    return status;
}

/* 3. Advice */

/* Since the frame before. */
static double speed_of(const sf_live *live) {
    const sf_localizer *l = &live->localizer;
    double twist[6], here[3], moved = 0, seconds = 1e-9 * (double)(l->pose_ns - l->pose_before_ns);
    sf_rigid now, before;
    if (live->input.frame.from == SF_POSE_NONE || l->poses < 2 || !(seconds > 0) || !(l->distance > 0))
        return NAN;
    sf_rigid_twist(&l->pose_before, &l->pose, twist);
    sf_rigid_invert(&l->pose, &now), sf_rigid_invert(&l->pose_before, &before);
    for (int k = 0; k < 3; k++) here[k] = now.t[k] - before.t[k];
    moved = sqrt(sf_dot3(here, here)) / l->distance;
    return fmax(moved, sqrt(sf_dot3(twist + 3, twist + 3))) / seconds;
}

void sf_live_advise(sf_live *live) {
    sf_guidance *g = &live->guidance;
    int tracked = live->input.frame.from != SF_POSE_NONE;
    sf_advice_facts facts = {.seconds = 1e-9 * (double)live->input.picture->time_ns,
                             .state = live->localizer.state,
                             .blurred = live->quality.trouble == SF_LIVE_BLURRED,
                             .speed = speed_of(live),
                             .brightness = g->brightness,
                             .coverage = tracked ? g->in_sight : NAN};
    (void)sf_advise(&g->adviser, &facts);
}

/* 4. The public side */

void sf_live_get_coverage(const sf_live *live, sf_live_coverage *told) {
    const sf_coverage *c = &live->guidance.coverage;
    double sum = 0;
    sf_live_cell cell;
    *told = (sf_live_coverage){
        .cell = c->side, .in_sight = live->guidance.in_sight, .look_ms = live->guidance.ms, .mean = NAN};
    for (size_t i = 0; i < c->count; i++) {
        if (!c->cells[i].views) continue;
        sf_coverage_tell(c, &c->cells[i], &cell);
        sum += (double)cell.coverage, told->cells++;
    }
    if (told->cells) told->mean = sum / (double)told->cells;
    told->has_worst = c->has_worst && c->cells[c->worst].views;
    if (told->has_worst) sf_coverage_tell(c, &c->cells[c->worst], &told->worst);
}

size_t sf_live_get_cells(const sf_live *live, size_t first, size_t capacity, sf_live_cell *cells) {
    const sf_coverage *c = &live->guidance.coverage;
    size_t n = 0, at = 0;
    for (size_t i = 0; i < c->count && n < capacity; i++) {
        if (!c->cells[i].views || at++ < first) continue;
        sf_coverage_tell(c, &c->cells[i], &cells[n++]);
    }
    return n;
}

sf_status sf_live_draw_coverage(sf_live *live, const sf_camera *camera, uint8_t *coverage) {
    if (!live->fitter) return sf_fail(live->ctx, SF_ERR_EMPTY, "live: there is no model yet");
    sf_status status = sf_camera_check(camera) ? SF_ERR_ARGUMENT : SF_OK;
    if (status) return sf_fail(live->ctx, status, "camera: its values are no camera's");
    return draw(live, camera, coverage);
}
