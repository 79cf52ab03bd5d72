/* map_points.c - points of tracks: made, used by more sightings, dropped (GEOMETRY.md, S.25). */
#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "map.h"
#include "triangulate.h"

enum {
    SIGHTS_MOST = 64, /* of a track that are looked at */
    TRIES_MOST = 20,  /* pairs of them that a point is tried from */
    CHUNK = 256       /* tracks a task */
};

int sf_map_sight(const sf_map *map, size_t sighting, sf_sight *sight) {
    const sf_sighting *s = &map->tracks.sightings[sighting];
    const sf_map_picture *p = &map->pictures[s->picture];
    if (!p->is_placed) return 0;
    sight->lens = &map->cameras[p->camera].lens, sight->pose = &p->pose;
    memcpy(sight->pixel, p->keypoints + 2 * (size_t)s->keypoint, sizeof sight->pixel);
    return sf_lens_ray(sight->lens, sight->pixel, sight->ray);
}

/* The placed pictures' sights of a track. */
typedef struct view_of_track {
    sf_sight sights[SIGHTS_MOST];
    size_t sightings[SIGHTS_MOST], count;
} view_of_track;

static void gather(const sf_map *map, size_t track, view_of_track *v) {
    v->count = 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1] && v->count < SIGHTS_MOST; i++)
        if (sf_map_sight(map, i, &v->sights[v->count])) v->sightings[v->count++] = i;
}

/* Keeps those sights that see the point well. Returns their number; *sum: of their errors. */
static size_t choose(const view_of_track *v, const double at[3], double most, sf_sight *kept, double *sum) {
    size_t count = 0;
    *sum = 0;
    for (size_t i = 0; i < v->count; i++) {
        double error = sf_sight_error(&v->sights[i], at);
        if (!(error <= most)) continue;
        *sum += error;
        kept[count++] = v->sights[i];
    }
    return count;
}

static int is_wide(const sf_map *map, const sf_sight *sights, size_t count, const double at[3]) {
    return count > 1 && sf_widest_cosine(sights, count, at) < cos(map->options.least_angle);
}

/* The point that most of the sights agree with, tried from pairs of them, the farthest apart in the order of
 * the pictures first. */
static int find_point(const sf_map *map, const view_of_track *v, double at[3]) {
    size_t most = 0, tries = 0;
    double least = INFINITY, most_px = map->options.error_px;
    for (size_t step = v->count - 1; step > 0; step--)
        for (size_t i = 0; i + step < v->count && tries < TRIES_MOST; i++, tries++) {
            sf_sight two[2] = {v->sights[i], v->sights[i + step]}, kept[SIGHTS_MOST];
            double here[3], sum;
            if (!sf_triangulate_rays(two, 2, here) || !is_wide(map, two, 2, here)) continue;
            size_t count = choose(v, here, most_px, kept, &sum);
            if (count < 2 || count < most || (count == most && !(sum < least))) continue;
            most = count, least = sum;
            memcpy(at, here, sizeof here);
        }
    return most > 1;
}

static void make_point(sf_map *map, size_t track) {
    view_of_track v;
    sf_sight kept[SIGHTS_MOST];
    double at[3], sum;
    gather(map, track, &v);
    if (v.count < 2 || !find_point(map, &v, at)) return;
    for (int round = 0; round < 2; round++) {
        size_t count = choose(&v, at, map->options.error_px, kept, &sum);
        if (count < 2 || !isfinite(sf_triangulate_refine(kept, count, at))) return;
    }
    size_t count = choose(&v, at, map->options.error_px, kept, &sum);
    if (!is_wide(map, kept, count, at)) return;
    map->has_point[track] = 1;
    memcpy(map->at[track], at, sizeof at);
    for (size_t i = 0; i < v.count; i++)
        map->is_used[v.sightings[i]] = sf_sight_error(&v.sights[i], at) <= map->options.error_px;
}

/* Sightings of placed pictures that agree with the point. */
static void use_more(sf_map *map, size_t track) {
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        sf_sight sight;
        if (map->is_used[i] || !sf_map_sight(map, i, &sight)) continue;
        map->is_used[i] = sf_sight_error(&sight, map->at[track]) <= map->options.error_px;
    }
}

typedef struct job {
    sf_map *map;
    size_t picture;
    double most;
    size_t *dropped; /* [chunks] */
} job;

static size_t end_of_chunk(const sf_map *map, size_t chunk) {
    size_t end = (chunk + 1) * CHUNK;
    return end < map->tracks.count ? end : map->tracks.count;
}

static void make_task(void *pointer, size_t chunk, int thread) {
    const job *j = pointer;
    (void)thread;
    for (size_t track = chunk * CHUNK; track < end_of_chunk(j->map, chunk); track++) {
        int is_wanted = j->picture == SIZE_MAX;
        for (size_t i = j->map->tracks.first[track]; !is_wanted && i < j->map->tracks.first[track + 1]; i++)
            is_wanted = j->map->tracks.sightings[i].picture == j->picture;
        if (is_wanted && j->map->has_point[track]) use_more(j->map, track);
        if (is_wanted && !j->map->has_point[track]) make_point(j->map, track);
    }
}

void sf_map_make_points(sf_map *map, size_t picture) {
    job j = {map, picture, 0, NULL};
    sf_pool_run(map->ctx->pool, (map->tracks.count + CHUNK - 1) / CHUNK, make_task, &j);
}

static size_t drop_bad_of(sf_map *map, size_t track, double most) {
    view_of_track v = {.count = 0};
    size_t dropped = 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        sf_sight sight;
        if (!map->is_used[i]) continue;
        if (!sf_map_sight(map, i, &sight) || !(sf_sight_error(&sight, map->at[track]) <= most)) {
            map->is_used[i] = 0;
            dropped++;
        } else if (v.count < SIGHTS_MOST) {
            v.sights[v.count++] = sight;
        }
    }
    if (is_wide(map, v.sights, v.count, map->at[track])) return dropped;
    map->has_point[track] = 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        dropped += map->is_used[i];
        map->is_used[i] = 0;
    }
    return dropped;
}

static void drop_task(void *pointer, size_t chunk, int thread) {
    const job *j = pointer;
    (void)thread;
    for (size_t track = chunk * CHUNK; track < end_of_chunk(j->map, chunk); track++)
        if (j->map->has_point[track]) j->dropped[chunk] += drop_bad_of(j->map, track, j->most);
}

size_t sf_map_drop_bad(sf_map *map, double most) {
    size_t chunks = (map->tracks.count + CHUNK - 1) / CHUNK, dropped = 0;
    job j = {map, 0, most, sf_calloc(map->ctx, chunks + 1, sizeof *j.dropped)};
    if (!j.dropped) return 0;
    sf_pool_run(map->ctx->pool, chunks, drop_task, &j);
    for (size_t i = 0; i < chunks; i++) dropped += j.dropped[i];
    sf_free(map->ctx, j.dropped);
    return dropped;
}

size_t sf_map_count_points(const sf_map *map, size_t *sightings) {
    size_t points = 0;
    *sightings = 0;
    for (size_t track = 0; track < map->tracks.count; track++) {
        if (!map->has_point[track]) continue;
        points++;
        for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++)
            *sightings += map->is_used[i];
    }
    return points;
}
