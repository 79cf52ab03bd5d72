/* map_bundle.c - the map's poses, points and lenses adjusted: all, or around a picture (GEOMETRY.md, S.27).
 */
#include <math.h>
#include <string.h>

#include "map.h"

/* A bundle, and what of the map its parts are. */
typedef struct gathering {
    sf_bundle bundle;
    sf_bundle_observation *observations;
    size_t *picture_of, *view_of; /* [views]; [pictures], SIZE_MAX: none */
    size_t *track_of;             /* [points] */
    uint8_t *is_chosen;           /* [tracks]: its point is adjusted */
} gathering;

static int make_gathering(const sf_map *map, gathering *g) {
    sf_context *ctx = map->ctx;
    size_t observations, points = sf_map_count_points(map, &observations), n = map->picture_count;
    g->bundle.views = sf_calloc(ctx, n + 1, sizeof *g->bundle.views);
    g->bundle.cameras = sf_calloc(ctx, map->camera_count + 1, sizeof *g->bundle.cameras);
    g->bundle.points = sf_calloc(ctx, points + 1, sizeof *g->bundle.points);
    g->observations = sf_alloc(ctx, observations + 1, sizeof *g->observations);
    g->picture_of = sf_alloc(ctx, n + 1, sizeof *g->picture_of);
    g->view_of = sf_alloc(ctx, n + 1, sizeof *g->view_of);
    g->track_of = sf_alloc(ctx, points + 1, sizeof *g->track_of);
    g->is_chosen = sf_calloc(ctx, map->tracks.count + 1, sizeof *g->is_chosen);
    return g->bundle.views && g->bundle.cameras && g->bundle.points && g->observations && g->picture_of &&
           g->view_of && g->track_of && g->is_chosen;
}

static void free_gathering(const sf_map *map, gathering *g) {
    void *const blocks[] = {g->bundle.views, g->bundle.cameras, g->bundle.points, g->observations,
                            g->picture_of,   g->view_of,        g->track_of,      g->is_chosen};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(map->ctx, blocks[i]);
}

static void gather_views(const sf_map *map, gathering *g) {
    sf_bundle *b = &g->bundle;
    for (size_t i = 0; i < map->picture_count; i++) {
        const sf_map_picture *p = &map->pictures[i];
        g->view_of[i] = SIZE_MAX;
        if (!p->is_placed) continue;
        g->view_of[i] = b->view_count;
        g->picture_of[b->view_count] = i;
        b->views[b->view_count++] =
            (sf_bundle_view){.pose = p->pose, .camera = p->camera, .lens = map->cameras[p->camera].lens};
    }
}

/* A track's point, and what sees it; of views that stay, FIXED_MOST, evenly chosen: they hold it. */
static void gather_point(const sf_map *map, gathering *g, size_t track, size_t fixed) {
    enum { FIXED_MOST = 8 };
    sf_bundle *b = &g->bundle;
    size_t seen = 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        const sf_track_observation *s = &map->tracks.observations[i];
        const double *pixel = map->pictures[s->picture].keypoints + 2 * (size_t)s->keypoint;
        size_t view = g->view_of[s->picture];
        if (!map->is_used[i]) continue;
        if (!b->views[view].is_free && fixed > FIXED_MOST) {
            size_t before = seen++ * FIXED_MOST / fixed;
            if (seen * FIXED_MOST / fixed == before) continue;
        }
        g->observations[b->observation_count++] =
            (sf_bundle_observation){(uint32_t)view, (uint32_t)b->point_count, pixel[0], pixel[1]};
    }
    memcpy(b->points[b->point_count].at, map->at[track], sizeof map->at[track]);
    g->track_of[b->point_count++] = track;
}

static void choose_track(const sf_map *map, gathering *g, size_t track, size_t *seen) {
    g->is_chosen[track] = 1;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++)
        if (map->is_used[i]) seen[map->tracks.observations[i].picture]++;
}

static int sees_too_few(const sf_map *map, size_t track, const size_t *seen) {
    enum { LEAST = 60 };
    int few = 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++)
        few |= map->is_used[i] && seen[map->tracks.observations[i].picture] < LEAST;
    return few;
}

/* Each n-th track with a point, and others as long as a picture sees too few. seen [pictures]: all 0. */
static void choose_tracks(const sf_map *map, gathering *g, size_t each, size_t *seen) {
    for (size_t track = 0; track < map->tracks.count; track += each)
        if (map->has_point[track]) choose_track(map, g, track, seen);
    for (size_t track = 0; track < map->tracks.count; track++)
        if (map->has_point[track] && !g->is_chosen[track] && sees_too_few(map, track, seen))
            choose_track(map, g, track, seen);
}

static void gather_chosen(const sf_map *map, gathering *g) {
    g->bundle.observations = g->observations;
    for (size_t track = 0; track < map->tracks.count; track++)
        if (g->is_chosen[track]) gather_point(map, g, track, 0);
}

/* How many of the observations of a track's point are of views that are free, or of others. */
static void count_views(const sf_map *map, const gathering *g, size_t track, size_t *free_count,
                        size_t *fixed) {
    *free_count = *fixed = 0;
    if (!map->has_point[track]) return;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        if (!map->is_used[i]) continue;
        int is_free = g->bundle.views[g->view_of[map->tracks.observations[i].picture]].is_free;
        *free_count += is_free != 0, *fixed += is_free == 0;
    }
}

/* Points that free views see: all of few, and of many about POINTS, but enough of each picture. */
static void gather_points_around(const sf_map *map, gathering *g, size_t *seen) {
    enum { POINTS = 600 };
    size_t count = 0, number = 0, free_count, fixed;
    for (size_t track = 0; track < map->tracks.count; track++) {
        count_views(map, g, track, &free_count, &fixed);
        count += free_count > 0;
    }
    memset(seen, 0, map->picture_count * sizeof *seen);
    g->bundle.observations = g->observations;
    for (size_t track = 0; track < map->tracks.count; track++) {
        count_views(map, g, track, &free_count, &fixed);
        if (!free_count || (number++ % (count / POINTS + 1) && !sees_too_few(map, track, seen))) continue;
        choose_track(map, g, track, seen);
        gather_point(map, g, track, fixed);
    }
}

/* What of the lenses is estimated: by how many placed pictures there are of each. */
static void free_lenses(const sf_map *map, gathering *g) {
    enum { FOCAL_LEAST = 3, FIRST_RADIAL_LEAST = 4, SECOND_RADIAL_LEAST = 8 };
    sf_bundle *b = &g->bundle;
    b->camera_count = map->camera_count;
    for (size_t i = 0; i < map->camera_count; i++) {
        const sf_map_camera *c = &map->cameras[i];
        sf_bundle_camera *to = &b->cameras[i];
        size_t views = 0;
        to->lens = c->lens;
        for (size_t v = 0; v < b->view_count; v++) views += b->views[v].camera == i;
        if (c->is_fixed || !views) continue;
        to->focal = map->placed_count >= FOCAL_LEAST;
        to->radial = (views >= FIRST_RADIAL_LEAST) + (views >= SECOND_RADIAL_LEAST);
        if (to->radial > c->radial) to->radial = c->radial;
        for (int k = 4; k < 6; k++) to->information[k] = 1 / (0.2 * 0.2); /* distortion is small */
        if (c->focal_prior > 0) {
            to->prior[0] = c->focal_prior;
            to->information[0] = 1 / pow(c->focal_sigma * c->focal_prior, 2);
        }
    }
}

static void accept(sf_map *map, const gathering *g) {
    const sf_bundle *b = &g->bundle;
    for (size_t v = 0; v < b->view_count; v++) map->pictures[g->picture_of[v]].pose = b->views[v].pose;
    for (size_t i = 0; i < b->camera_count; i++) map->cameras[i].lens = b->cameras[i].lens;
    for (size_t i = 0; i < b->point_count; i++)
        memcpy(map->at[g->track_of[i]], b->points[i].at, sizeof b->points[i].at);
}

sf_status sf_map_adjust(sf_map *map, int rounds, double enough) {
    return sf_map_adjust_sample(map, 1, rounds, enough);
}

sf_status sf_map_adjust_sample(sf_map *map, size_t each, int rounds, double enough) {
    gathering g = {.bundle = {.enough = enough}};
    size_t *seen = sf_calloc(map->ctx, map->picture_count + 1, sizeof *seen);
    sf_status status = seen && make_gathering(map, &g) ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        gather_views(map, &g);
        for (size_t v = 1; v < g.bundle.view_count; v++) g.bundle.views[v].is_free = 1;
        choose_tracks(map, &g, each, seen);
        gather_chosen(map, &g);
        free_lenses(map, &g);
        status = sf_bundle_adjust(map->ctx, &g.bundle, rounds, &map->spread);
    }
    if (!status) accept(map, &g);
    free_gathering(map, &g);
    sf_free(map->ctx, seen);
    return status;
}

/* Moves all points to where the views, which stay, see them. */
static sf_status adjust_points(sf_map *map) {
    enum { ROUNDS = 4 };
    gathering g = {.bundle = {.enough = 1e-3}};
    sf_status status = make_gathering(map, &g) ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        gather_views(map, &g);
        memcpy(g.is_chosen, map->has_point, map->tracks.count);
        gather_chosen(map, &g);
        status = sf_bundle_adjust(map->ctx, &g.bundle, ROUNDS, &map->spread);
    }
    if (!status) accept(map, &g);
    free_gathering(map, &g);
    return status;
}

sf_status sf_map_adjust_roughly(sf_map *map, int rounds, double enough) {
    enum { OBSERVATIONS = 30000 };
    size_t observations;
    sf_map_count_points(map, &observations);
    size_t each = observations / OBSERVATIONS + 1;
    sf_status status = sf_map_adjust_sample(map, each, rounds, enough);
    return status || each == 1 ? status : adjust_points(map);
}

/* Frees the views that share most points with one, counted in `shared` [views]. */
static void choose_free(const sf_map *map, gathering *g, size_t view, size_t most, size_t *shared) {
    for (size_t track = 0; track < map->tracks.count; track++) {
        int is_seen = 0;
        if (!map->has_point[track]) continue;
        for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++)
            is_seen |= map->is_used[i] && g->view_of[map->tracks.observations[i].picture] == view;
        for (size_t i = map->tracks.first[track]; is_seen && i < map->tracks.first[track + 1]; i++)
            if (map->is_used[i]) shared[g->view_of[map->tracks.observations[i].picture]]++;
    }
    g->bundle.views[view].is_free = 1;
    for (size_t n = 0; n < most; n++) {
        size_t best = SIZE_MAX;
        for (size_t v = 0; v < g->bundle.view_count; v++)
            if (!g->bundle.views[v].is_free && shared[v] && (best == SIZE_MAX || shared[v] > shared[best]))
                best = v;
        if (best == SIZE_MAX) break;
        g->bundle.views[best].is_free = 1;
    }
}

sf_status sf_map_adjust_around(sf_map *map, size_t picture, size_t most) {
    enum { ROUNDS = 6 };
    gathering g = {.bundle = {.enough = 1e-3}};
    size_t *shared = sf_calloc(map->ctx, map->picture_count + 1, sizeof *shared);
    sf_status status = shared && make_gathering(map, &g) ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        gather_views(map, &g);
        choose_free(map, &g, g.view_of[picture], most, shared);
        gather_points_around(map, &g, shared);
        status = sf_bundle_adjust(map->ctx, &g.bundle, ROUNDS, &map->spread);
    }
    if (!status) accept(map, &g);
    free_gathering(map, &g);
    sf_free(map->ctx, shared);
    return status;
}
