/* mapper.c - see mapper.h. */
#include "mapper.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    STARTS_MOST = 30,  /* first pairs that are tried */
    NEIGHBOURS = 5,    /* pictures that are adjusted with a new one */
    FINAL_ROUNDS = 3,  /* of points, bundle and outliers at the end */
    MISSING_PART = 10, /* another focal length is tried where one picture in so many is missing */
    FOCAL_FEW = 6      /* photos from which on a camera's focal length is not in doubt for their number */
};

#define GROWTH 1.25 /* of placed pictures, from one adjustment of all to the next */
/* Focal lengths that are tried where the voted one is doubtful: from one to the next, and the farthest. */
#define FOCAL_STEP     1.6
#define FOCAL_FARTHEST 6.6

typedef struct mapper {
    const sf_map_input *input;
    sf_map *map;
    sf_mapper_progress progress;
    void *user;
    size_t adjusted_at; /* placed pictures at the last adjustment of all */
} mapper;

/* 1. The first pair */

typedef struct start {
    const sf_matched_pair *pair;
    double score;
} start;

/* Many matches, and wide angles: from 16 degrees on more does not help. Planes are the last choice, for their
 * pose may be the wrong one of two. */
static double score_of(const mapper *m, const sf_matched_pair *pair) {
    const double enough = 0.28, least = m->map->options.least_angle;
    const sf_two_view *g = &pair->geometry;
    if (m->map->pictures[pair->first].is_left_out || m->map->pictures[pair->second].is_left_out) return 0;
    if (!g->has_pose || g->kind == SF_PAIR_ROTATION || !(g->angle > least)) return 0;
    double score = (double)pair->count * fmin(g->angle / enough, 1);
    return g->kind == SF_PAIR_PLANE ? score / 10 : score;
}

static int compare_starts(const void *a, const void *b) {
    const start *x = a, *y = b;
    if (x->score != y->score) return x->score < y->score ? 1 : -1;
    return x->pair < y->pair ? -1 : x->pair > y->pair;
}

static void place_at(sf_map *map, size_t picture, const sf_rigid *T) {
    map->pictures[picture].is_placed = 1;
    map->pictures[picture].pose = *T;
    map->placed_count++;
}

/* Whether enough points come out of a pair. */
static sf_status try_start(mapper *m, const sf_matched_pair *pair, int *is_good) {
    const sf_rigid still = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    sf_map *map = m->map;
    size_t observations, dropped;
    *is_good = 0;
    sf_map_clear(map, m->input);
    place_at(map, pair->first, &still);
    place_at(map, pair->second, &pair->geometry.T);
    sf_map_make_points(map, SIZE_MAX);
    if (sf_map_count_points(map, &observations) < map->options.first_count) return SF_OK;
    sf_status status = sf_map_adjust(map, 30, 1e-5);
    if (status) return status;
    status = sf_map_drop_bad(map, SIZE_MAX, &dropped);
    *is_good = !status && sf_map_count_points(map, &observations) >= map->options.first_count;
    return status;
}

static sf_status begin(mapper *m) {
    sf_context *ctx = m->map->ctx;
    start *starts = sf_alloc(ctx, m->input->pair_count + 1, sizeof *starts);
    size_t count = 0;
    int is_good = 0;
    sf_status status = starts ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < m->input->pair_count; i++) {
        double score = score_of(m, &m->input->pairs[i]);
        if (score > 0) starts[count++] = (start){&m->input->pairs[i], score};
    }
    if (!status) qsort(starts, count, sizeof *starts, compare_starts);
    for (size_t i = 0; !status && !is_good && i < count && i < STARTS_MOST; i++)
        status = try_start(m, starts[i].pair, &is_good);
    sf_free(ctx, starts);
    if (status || is_good) return status;
    if (!count)
        return sf_fail(ctx, SF_ERR_EMPTY,
                       "no two pictures show the same place from two sides: take "
                       "pictures that overlap, and move the camera from one to the next");
    return sf_fail(ctx, SF_ERR_EMPTY,
                   "of %zu pairs of pictures none shows %zu points from two sides: "
                   "take more pictures that overlap",
                   count, m->map->options.first_count);
}

/* 2. Further pictures */

/* The picture whose points are spread over most of it; SIZE_MAX: there is none to try. */
static size_t choose_next(const sf_map *map) {
    size_t best = SIZE_MAX, most = 0, most_seen = 0;
    for (size_t i = 0; i < map->picture_count; i++) {
        const sf_map_picture *p = &map->pictures[i];
        size_t cells;
        if (p->is_placed || p->is_left_out) continue;
        size_t seen = sf_map_count_seen(map, i, &cells);
        if (seen < map->options.least_seen || (p->tried_at && 10 * seen < 11 * p->tried_at)) continue;
        if (cells < most || (cells == most && seen <= most_seen)) continue;
        best = i, most = cells, most_seen = seen;
    }
    return best;
}

static sf_status adjust_all(mapper *m, int rounds, double enough) {
    sf_map *map = m->map;
    for (int round = 0; round < 2; round++) {
        sf_status status = sf_map_adjust_roughly(map, rounds, enough);
        size_t observations, dropped;
        if (!status) status = sf_map_drop_bad(map, SIZE_MAX, &dropped);
        if (status) return status;
        sf_map_make_points(map, SIZE_MAX);
        sf_map_count_points(map, &observations);
        if (200 * dropped < observations) break;
    }
    m->adjusted_at = map->placed_count;
    return SF_OK;
}

static sf_status add_picture(mapper *m, size_t picture, int *is_placed) {
    sf_map *map = m->map;
    size_t dropped;
    sf_status status = sf_map_place(map, picture, is_placed);
    if (status || !*is_placed) return status;
    sf_map_make_points(map, picture);
    status = sf_map_adjust_around(map, picture, NEIGHBOURS);
    if (!status) status = sf_map_drop_bad(map, picture, &dropped);
    if (status) return status;
    if (m->progress && m->progress(m->user, map->placed_count, map->picture_count))
        return sf_fail(map->ctx, SF_ERR_CANCELLED, "cancelled");
    if ((double)map->placed_count < GROWTH * (double)m->adjusted_at) return SF_OK;
    return adjust_all(m, 6, 2e-3);
}

/* Until no picture can be placed any more, even after all were adjusted; where none is left, finish adjusts.
 */
static sf_status grow(mapper *m) {
    sf_map *map = m->map;
    for (;;) {
        size_t picture = choose_next(map);
        int is_placed;
        sf_status status;
        if (picture != SIZE_MAX)
            status = add_picture(m, picture, &is_placed);
        else if (m->adjusted_at != map->placed_count && map->placed_count < map->picture_count)
            status = adjust_all(m, 10, 1e-4);
        else
            return SF_OK;
        if (status) return status;
    }
}

static sf_status finish(mapper *m) {
    static const double enough[FINAL_ROUNDS] = {1e-3, 1e-4, 1e-5}; /* outliers first */
    sf_map *map = m->map;
    for (int round = 0; round < FINAL_ROUNDS; round++) {
        int is_last = round + 1 == FINAL_ROUNDS;
        size_t dropped;
        sf_status status = is_last ? sf_map_choose_lens(map) : SF_OK;
        if (!status) status = sf_map_adjust_roughly(map, 30, enough[round]);
        if (!status && is_last) status = sf_map_adjust(map, 30, 1e-5);
        if (!status) status = sf_map_drop_bad(map, SIZE_MAX, &dropped);
        if (status) return status;
        if (!is_last) sf_map_make_points(map, SIZE_MAX);
    }
    return SF_OK;
}

static sf_status run_once(sf_context *ctx, mapper *m, const sf_map_options *options) {
    sf_status status = sf_map_create(ctx, m->input, options, &m->map);
    if (!status) status = begin(m);
    if (!status) m->adjusted_at = m->map->placed_count;
    if (!status) status = grow(m);
    if (!status) status = finish(m);
    if (status) sf_map_destroy(&m->map);
    return status;
}

/* Takes from cameras the focal length that only files tell, where the map is far from it: what pairs of
 * pictures say of it is the better begin. Returns whether there are any. */
static int overrule(const sf_map *map, sf_map_camera *cameras) {
    int count = 0;
    for (size_t i = 0; i < map->camera_count; i++) {
        sf_map_camera *c = &cameras[i];
        if (!c->is_doubtful || !(c->focal_prior > 0) || !(c->focal_voted > 0)) continue;
        if (fabs(log(map->cameras[i].lens.fx / c->focal_prior)) < 2 * c->focal_sigma) continue;
        c->focal_prior = 0, c->lens.fx = c->lens.fy = c->focal_voted;
        count++;
    }
    return count;
}

/* Counts pictures that are not placed though a pair connects them with one that is. SF_ERR_MEMORY. */
static sf_status count_missing(const mapper *m, size_t *missing) {
    const sf_map *map = m->map;
    uint8_t *is_missing = sf_calloc(map->ctx, map->picture_count + 1, 1);
    *missing = 0;
    if (!is_missing) return SF_ERR_MEMORY;
    for (size_t i = 0; i < m->input->pair_count; i++) {
        const sf_matched_pair *p = &m->input->pairs[i];
        const sf_map_picture *a = &map->pictures[p->first], *b = &map->pictures[p->second];
        if (a->is_placed != b->is_placed && !a->is_left_out && !b->is_left_out)
            is_missing[a->is_placed ? p->second : p->first] = 1;
    }
    for (size_t i = 0; i < map->picture_count; i++) *missing += is_missing[i];
    sf_free(map->ctx, is_missing);
    return SF_OK;
}

/* Changes the focal lengths that only pairs of pictures tell. Returns whether there are any. */
static int change_focal(const sf_map_camera *from, size_t count, double factor, sf_map_camera *cameras) {
    int changed = 0;
    for (size_t i = 0; i < count; i++) {
        cameras[i] = from[i];
        if (from[i].is_fixed || from[i].focal_prior > 0) continue;
        cameras[i].lens.fx *= factor, cameras[i].lens.fy *= factor;
        changed = 1;
    }
    return changed;
}

static int are_vague(const sf_map_camera *cameras, size_t count) {
    int vague = 0;
    for (size_t i = 0; i < count; i++) vague |= cameras[i].is_vague;
    return vague;
}

/* Makes maps with focal lengths that are `step`, step^2 ... times the voted ones, as long as they hold more
 * observations than the best one so far, which stays in m. *changed: whether that is another one now. */
static sf_status climb(mapper *m, const sf_map_options *options, const sf_map_camera *voted,
                       sf_map_camera *cameras, double step, int *changed) {
    sf_context *ctx = m->map->ctx;
    sf_status status = SF_OK;
    int is_better = 1;
    *changed = 0;
    for (double factor = step; is_better && factor < FOCAL_FARTHEST && factor * FOCAL_FARTHEST > 1;
         factor *= step) {
        mapper other = *m;
        size_t most, observations;
        if (!change_focal(voted, m->input->camera_count, factor, cameras)) break;
        status = run_once(ctx, &other, options);
        if (status) break;
        sf_map_count_points(m->map, &most), sf_map_count_points(other.map, &observations);
        is_better = observations > most;
        *changed |= is_better;
        sf_map *worse = is_better ? m->map : other.map;
        if (is_better) m->map = other.map;
        sf_map_destroy(&worse);
    }
    return status == SF_ERR_EMPTY ? SF_OK : status;
}

/* Pairs hardly tell a long focal length from a longer one, and from far off the bundle does not find the
 * right one: where their vote is vague, or pictures are missing, others are tried. */
static sf_status try_other_focal(mapper *m, const sf_map_options *options, sf_map_camera *cameras) {
    sf_context *ctx = m->map->ctx;
    size_t count = m->input->camera_count, missing;
    int changed;
    sf_status status = count_missing(m, &missing);
    int is_missing = missing > 1 && MISSING_PART * missing >= m->map->placed_count;
    if (status || (!is_missing && !are_vague(cameras, count))) return status;
    sf_map_camera *voted = sf_alloc(ctx, count + 1, sizeof *voted);
    if (!voted) return SF_ERR_MEMORY;
    memcpy(voted, cameras, count * sizeof *voted);
    status = climb(m, options, voted, cameras, FOCAL_STEP, &changed);
    if (!status && !changed) status = climb(m, options, voted, cameras, 1 / FOCAL_STEP, &changed);
    memcpy(cameras, voted, count * sizeof *voted);
    sf_free(ctx, voted);
    return status;
}

/* Where one focal length is in doubt, so are the others: the same points are seen through all. So are those
 * that a few photos alone tell. */
static void tell_doubt(const mapper *m, const sf_map_camera *cameras) {
    const sf_map *map = m->map;
    int vague = are_vague(cameras, m->input->camera_count);
    for (size_t i = 0; i < map->camera_count; i++) {
        const sf_map_camera *c = &map->cameras[i];
        size_t placed = 0;
        for (size_t k = 0; k < map->picture_count; k++)
            placed += map->pictures[k].is_placed && map->pictures[k].camera == i;
        if (cameras[i].is_fixed || cameras[i].focal_prior > 0 || !placed) continue;
        if (vague || placed < FOCAL_FEW)
            sf_log(
                map->ctx, SF_LOG_WARNING,
                "focal: the %zu photos of %dx%d hardly tell their focal length, %.0f px: give it if you know "
                "it (--focal, --lens), or add photos",
                placed, (int)c->width, (int)c->height, c->lens.fx);
    }
}

/* A map, and once more where it overrules what files tell; others where the focal length is in doubt. */
static sf_status run_again(sf_context *ctx, mapper *m, const sf_map_options *options,
                           sf_map_camera *cameras) {
    sf_status status = run_once(ctx, m, options);
    if (!status && overrule(m->map, cameras)) {
        sf_map_destroy(&m->map);
        status = run_once(ctx, m, options);
    }
    if (!status) status = try_other_focal(m, options, cameras);
    if (!status) tell_doubt(m, cameras);
    if (status) sf_map_destroy(&m->map);
    return status;
}

/* 3. Several places: a map of each, until none that is left can be larger than the largest */

/* Leaves out what a map has placed. Returns how many pictures are left. */
static size_t leave_out(const sf_map *map, sf_map_picture *pictures) {
    size_t left = 0;
    for (size_t i = 0; i < map->picture_count; i++) {
        pictures[i].is_left_out |= map->pictures[i].is_placed;
        left += !pictures[i].is_left_out;
    }
    return left;
}

/* The larger one of two maps stays in *best, and tells of the other. */
static void keep_larger(sf_map **best, sf_map *map) {
    sf_map *smaller = map;
    if (!*best || map->placed_count > (*best)->placed_count) smaller = *best, *best = map;
    if (!smaller) return;
    if (smaller != map)
        (*best)->other_maps = smaller->other_maps, (*best)->other_pictures = smaller->other_pictures;
    for (size_t i = 0; i < smaller->picture_count; i++)
        (*best)->pictures[i].is_elsewhere |=
            smaller->pictures[i].is_placed || smaller->pictures[i].is_elsewhere;
    (*best)->other_maps++;
    (*best)->other_pictures += smaller->placed_count;
    sf_map_destroy(&smaller);
}

sf_status sf_mapper_run(sf_context *ctx, const sf_map_input *input, const sf_map_options *options,
                        sf_mapper_progress progress, void *user, sf_map **map) {
    sf_map_input rest = *input;
    sf_map_picture *pictures = sf_alloc(ctx, input->picture_count + 1, sizeof *pictures);
    sf_map_camera *cameras = sf_alloc(ctx, input->camera_count + 1, sizeof *cameras);
    sf_status status = pictures && cameras ? SF_OK : SF_ERR_MEMORY;
    size_t left = input->picture_count;
    *map = NULL;
    if (!status) {
        memcpy(pictures, input->pictures, input->picture_count * sizeof *pictures);
        memcpy(cameras, input->cameras, input->camera_count * sizeof *cameras);
    }
    rest.pictures = pictures, rest.cameras = cameras;
    while (!status && left > 1 && (!*map || left > (*map)->placed_count)) {
        mapper m = {.input = &rest, .progress = progress, .user = user};
        status = run_again(ctx, &m, options, cameras);
        if (status) break;
        left = leave_out(m.map, pictures);
        keep_larger(map, m.map);
    }
    if (status == SF_ERR_EMPTY && *map) status = SF_OK;
    if (status) sf_map_destroy(map);
    for (size_t i = 0; *map && i < input->picture_count; i++)
        (*map)->pictures[i].is_left_out = input->pictures[i].is_left_out;
    sf_free(ctx, pictures);
    sf_free(ctx, cameras);
    return status;
}
