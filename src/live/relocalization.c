/* relocalization.c - where a picture was taken: features that it shares with keyframes, at their depths, and
 * the pose that sees them there. */
#include "relocalization.h"

#include <math.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/pool.h"
#include "../fit/online.h"
#include "../pose/patch.h"
#include "../sfm/match.h"
#include "../sfm/pose_search.h"
#include "place_recognition.h"

enum {
    ALIKE = 5,        /* keyframes that a picture is compared with in full */
    DRAWINGS = 3,     /* of the model, for depths, in a frame */
    LEAST_SHARED = 4, /* of the few features, for a keyframe to be like the picture */
    LEAST = 15,       /* features that agree, for a pose */
    CELLS = 4,        /* along each side of the picture: */
    LEAST_CELLS = 4,  /* cells with such features */
    TURNS = 3,        /* misses after which the same keyframes are tried again */
    PARTS = 6,        /* along each side of the picture, that are compared each for itself; */
    LEAST_PARTS = 9   /* of which so many must show something */
};

#define ERROR 0.0125 /* of the picture's longer side: the greatest error of a feature that agrees */
#define RIVAL 0.5    /* of the features that agree: as many that agree with another place make it doubtful */
/* Standard deviation of the greys of a part that shows nothing; correlation with the model of one that
 * agrees; how many of them must. */
#define PLAIN      0.02
#define PART_ALIKE 0.4
#define MOST_PARTS 0.65
#define SOLID      0.5f /* transmittance of what the model fills */
#define ELSEWHERE  0.35 /* rad, parts of the distance to the scene */

typedef struct comparison {
    sf_live *live;
    const sf_place *place;
    const size_t *chosen;
    size_t count;
    sf_matches *matches; /* [count] */
    sf_status *statuses;
    uint32_t *feature; /* [observations]: of the picture */
    uint8_t *agrees;   /* [features] */
    sf_pose_search search;
} comparison;

static void match_task(void *pointer, size_t at, int thread) {
    const comparison *c = pointer;
    const sf_features *of = &c->live->keyframes.list[c->chosen[at]].place.features;
    sf_match_options options = sf_match_options_default();
    (void)thread;
    c->statuses[at] = sf_match_pair(c->live->ctx, &c->place->features, of, &options, &c->matches[at]);
}

/* A feature of a keyframe that the picture shows as well, as a point of the world. */
static void add_observation(comparison *c, const sf_keyframe *k, const sf_match *match) {
    const sf_keypoint *there = &k->place.features.points[match->b];
    const sf_keypoint *here = &c->place->features.points[match->a];
    const sf_lens *lens = &c->search.lens;
    double z = (double)k->place.depths[match->b], at[3];
    if (!(z > 0)) return;
    const double p[3] = {z * ((double)there->x - lens->cx) / lens->fx,
                         z * ((double)there->y - lens->cy) / lens->fy, z};
    const double pixel[2] = {(double)here->x, (double)here->y};
    sf_rigid_apply_back(&k->pose, p, at);
    c->feature[c->search.all.count] = match->a;
    sf_pose_search_add(&c->search, at, pixel);
}

static sf_status gather(comparison *c, int drawings) {
    const sf_camera *camera = &c->live->input.picture->camera;
    const sf_lens lens = {.fx = camera->fx, .fy = camera->fy, .cx = camera->cx, .cy = camera->cy};
    size_t most = 0;
    sf_pool_run(c->live->ctx->pool, c->count, match_task, c);
    for (size_t i = 0; i < c->count; i++) {
        if (c->statuses[i]) return c->statuses[i];
        most += c->matches[i].count;
    }
    c->feature = sf_alloc(c->live->ctx, most + 1, sizeof *c->feature);
    c->agrees = sf_alloc(c->live->ctx, c->place->features.count + 1, 1);
    if (!sf_pose_search_make(c->live->ctx, most, &lens, &c->search) || !c->feature || !c->agrees)
        return SF_ERR_MEMORY;
    for (size_t i = 0; i < c->count; i++) {
        sf_keyframe *k = &c->live->keyframes.list[c->chosen[i]];
        int drawn = 0;
        if (!c->matches[i].count) continue;
        sf_status status = drawings > 0 ? sf_live_draw_depths(c->live, k, &drawn) : SF_OK;
        if (status) return status;
        drawings -= drawn;
        for (size_t m = 0; k->place.depths && m < c->matches[i].count; m++)
            add_observation(c, k, &c->matches[i].items[m]);
    }
    return SF_OK;
}

/* How many features of the picture agree, each counted once, marked in agrees[], if they are spread over the
 * picture; else 0. */
static size_t count_features(const comparison *c, size_t members) {
    const sf_camera *camera = &c->live->input.picture->camera;
    uint8_t cells[CELLS * CELLS] = {0};
    size_t count = 0, filled = 0;
    memset(c->agrees, 0, c->place->features.count);
    for (size_t i = 0; i < members; i++) {
        uint32_t at = c->search.members[i], feature = c->feature[at];
        const double *pixel = c->search.pixels + 2 * at;
        int x = (int)(CELLS * pixel[0] / camera->width), y = (int)(CELLS * pixel[1] / camera->height);
        count += !c->agrees[feature];
        c->agrees[feature] = 1;
        if (x >= 0 && y >= 0 && x < CELLS && y < CELLS) cells[CELLS * y + x] = 1;
    }
    for (int i = 0; i < CELLS * CELLS; i++) filled += cells[i];
    return filled >= LEAST_CELLS ? count : 0;
}

/* Leaves the observations that agree with no pose yet. members[] ascends. */
static void leave_others(comparison *c, size_t members) {
    size_t kept = 0, next = 0;
    for (size_t i = 0; i < c->search.all.count; i++) {
        if (next < members && c->search.members[next] == i) {
            next++;
            continue;
        }
        memmove(c->search.points + 3 * kept, c->search.points + 3 * i, 3 * sizeof *c->search.points);
        memmove(c->search.pixels + 2 * kept, c->search.pixels + 2 * i, 2 * sizeof *c->search.pixels);
        c->feature[kept++] = c->feature[i];
    }
    c->search.all.count = kept;
}

/* Returns how many features agree with the pose, 0: there is none; *members: observations. */
static size_t search(comparison *c, size_t least, sf_rigid *pose, size_t *members) {
    const sf_camera *camera = &c->live->input.picture->camera;
    sf_ransac_result found;
    const sf_pose_search_options options = {.error_px = ERROR * fmax(camera->width, camera->height),
                                            .least = least,
                                            .seed = c->live->localizer.looked_at};
    sf_pose_search_run(&c->search, &options, &found);
    if (!found.count) return 0;
    *pose = sf_pose_search_pose(&found);
    *members = sf_pose_search_refine(&c->search, &options, 0, pose);
    size_t count = count_features(c, *members);
    return count >= least ? count : 0;
}

static int is_elsewhere(const sf_rigid *a, const sf_rigid *b, double distance) {
    double angle, apart;
    sf_rigid_gap(a, b, &angle, &apart);
    return angle > ELSEWHERE || apart > ELSEWHERE * distance;
}

sf_status sf_live_find_place(sf_live *live, const sf_place *place, const size_t *chosen, size_t count,
                             int drawings, sf_place_pose *found) {
    comparison c = {.live = live, .place = place, .chosen = chosen, .count = count};
    sf_rigid other;
    double began = sf_clock();
    size_t members;
    *found = (sf_place_pose){0};
    c.matches = sf_calloc(live->ctx, count + 1, sizeof *c.matches);
    c.statuses = sf_calloc(live->ctx, count + 1, sizeof *c.statuses);
    sf_status status = c.matches && c.statuses ? gather(&c, drawings) : SF_ERR_MEMORY;
    if (!status && (found->agree = search(&c, LEAST, &found->pose, &members)) > 0) {
        size_t least = (size_t)fmax(RIVAL * (double)found->agree, LEAST / 2);
        leave_others(&c, members);
        size_t rivals = search(&c, least, &other, &members);
        found->found = !rivals || !is_elsewhere(&found->pose, &other, live->localizer.distance);
    }
    for (size_t i = 0; c.matches && i < count; i++) sf_matches_free(live->ctx, &c.matches[i]);
    sf_pose_search_free(live->ctx, &c.search);
    void *const blocks[] = {c.matches, c.statuses, c.feature, c.agrees};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(live->ctx, blocks[i]);
    found->seconds = sf_clock() - began;
    return status;
}

sf_status sf_live_relocalize(sf_live *live, sf_place_pose *found) {
    size_t chosen[ALIKE], count = 0, skipped = live->localizer.misses % TURNS == 2 ? ALIKE : 0;
    *found = (sf_place_pose){0};
    sf_place_score *scores = sf_alloc(live->ctx, live->keyframes.count + 1, sizeof *scores);
    sf_status status = scores ? sf_live_find_features(live) : SF_ERR_MEMORY;
    if (!status) status = sf_live_score_places(live, &live->input.place, NULL, scores);
    for (size_t i = skipped; !status && i < live->keyframes.count && count < ALIKE; i++)
        if (scores[i].shared >= LEAST_SHARED) chosen[count++] = scores[i].keyframe;
    sf_free(live->ctx, scores);
    return status || !count ? status
                            : sf_live_find_place(live, &live->input.place, chosen, count, DRAWINGS, found);
}

/* Sums over the pixels of a part of the picture that the model fills. */
typedef struct part {
    double n, seen, drawn, seen2, drawn2, both;
} part;

static void add_pixels(const sf_live *live, const sf_workspace *ws, size_t cell, part *p) {
    const sf_picture *picture = live->input.picture;
    size_t width = (size_t)picture->camera.width, height = (size_t)picture->camera.height;
    size_t x0 = cell % PARTS * width / PARTS, x1 = (cell % PARTS + 1) * width / PARTS;
    size_t y0 = cell / PARTS * height / PARTS, y1 = (cell / PARTS + 1) * height / PARTS;
    for (size_t y = y0; y < y1; y++)
        for (size_t x = x0; x < x1; x++) {
            size_t at = y * ws->stride + x;
            if (ws->transmittance[at] >= SOLID) continue;
            double drawn = (double)sf_grey(ws->rgb[0][at], ws->rgb[1][at], ws->rgb[2][at]);
            double seen = (double)sf_picture_grey(picture, y * width + x);
            p->n++, p->seen += seen, p->drawn += drawn, p->both += seen * drawn;
            p->seen2 += seen * seen, p->drawn2 += drawn * drawn;
        }
}

/* Variances and covariance. */
static void center(part *p) {
    p->seen2 = p->seen2 / p->n - pow(p->seen / p->n, 2);
    p->drawn2 = p->drawn2 / p->n - pow(p->drawn / p->n, 2);
    p->both = p->both / p->n - p->seen / p->n * (p->drawn / p->n);
}

sf_status sf_live_confirm_place(sf_live *live, const sf_rigid *pose, int *confirmed) {
    sf_camera camera = live->input.frame.camera;
    const sf_workspace *ws;
    size_t pixels = (size_t)camera.width * (size_t)camera.height / (PARTS * PARTS);
    int compared = 0, alike = 0;
    memcpy(camera.R_cw, pose->R, sizeof camera.R_cw), memcpy(camera.t_cw, pose->t, sizeof camera.t_cw);
    sf_status status = sf_online_draw(live->fitter, &camera, &ws);
    for (size_t cell = 0; !status && cell < PARTS * PARTS; cell++) {
        part p = {0};
        add_pixels(live, ws, cell, &p);
        if (p.n < (double)pixels / 2) continue;
        center(&p);
        if (p.seen2 < PLAIN * PLAIN && p.drawn2 < PLAIN * PLAIN) continue;
        compared++;
        alike += p.both > PART_ALIKE * sqrt(p.seen2 * p.drawn2);
    }
    *confirmed = compared >= LEAST_PARTS && alike >= MOST_PARTS * compared;
    return status;
}
