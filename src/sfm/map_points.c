/* map_points.c - points of tracks: made, used by more observations, dropped (GEOMETRY.md, S.25). */
#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "map.h"
#include "triangulate.h"

enum {
    SIGHTS_MOST = SF_SIGHTS_MOST,
    TRIES_MOST = 20, /* pairs of them that a point is tried from */
    CHUNK = 256      /* tracks a task */
};

double sf_map_unit(const sf_map_camera *camera) { return camera->unit > 0 ? camera->unit : 1; }

int sf_map_observe(const sf_map *map, size_t observation, sf_sight *sight) {
    const sf_track_observation *s = &map->tracks.observations[observation];
    const sf_map_picture *p = &map->pictures[s->picture];
    if (!p->is_placed) return 0;
    sight->lens = &map->cameras[p->camera].lens, sight->pose = &p->pose;
    sight->unit = sf_map_unit(&map->cameras[p->camera]);
    memcpy(sight->pixel, p->keypoints + 2 * (size_t)s->keypoint, sizeof sight->pixel);
    return 1;
}

/* The placed pictures' sights of a track, with rays. */
typedef struct view_of_track {
    sf_sight sights[SIGHTS_MOST];
    size_t observations[SIGHTS_MOST], count;
} view_of_track;

static void gather(const sf_map *map, size_t track, view_of_track *v) {
    v->count = 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1] && v->count < SIGHTS_MOST;
         i++) {
        sf_sight *sight = &v->sights[v->count];
        if (sf_map_observe(map, i, sight) && sf_lens_ray(sight->lens, sight->pixel, sight->ray))
            v->observations[v->count++] = i;
    }
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
    return sf_is_wide(sights, count, at, cos(map->options.least_angle));
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
        map->is_used[v.observations[i]] = sf_sight_error(&v.sights[i], at) <= map->options.error_px;
}

/* Sightings of placed pictures that agree with the point. */
static void use_more(sf_map *map, size_t track) {
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        sf_sight sight;
        if (map->is_used[i] || !sf_map_observe(map, i, &sight)) continue;
        map->is_used[i] = sf_sight_error(&sight, map->at[track]) <= map->options.error_px;
    }
}

/* What is done to each track of a list, or to all. */
typedef struct job {
    sf_map *map;
    const uint32_t *list; /* [count]; UINT32_MAX: none; NULL: all of the map */
    size_t count;
    size_t *dropped; /* [chunks] */
    void (*of_track)(const struct job *job, size_t track, size_t chunk);
} job;

static void chunk_task(void *pointer, size_t chunk, int thread) {
    const job *j = pointer;
    size_t end = (chunk + 1) * CHUNK < j->count ? (chunk + 1) * CHUNK : j->count;
    (void)thread;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        size_t track = j->list ? j->list[i] : i;
        if (!j->list || j->list[i] != UINT32_MAX) j->of_track(j, track, chunk);
    }
}

static size_t chunks_of(const job *j) { return (j->count + CHUNK - 1) / CHUNK; }

/* Of a picture: the tracks of its keypoints, each of which is another. */
static job job_of(sf_map *map, size_t picture) {
    if (picture == SIZE_MAX) return (job){.map = map, .count = map->tracks.count};
    return (job){.map = map, .list = map->pictures[picture].track_of, .count = map->pictures[picture].count};
}

static void make_or_use(const job *j, size_t track, size_t chunk) {
    (void)chunk;
    if (j->map->has_point[track])
        use_more(j->map, track);
    else
        make_point(j->map, track);
}

void sf_map_make_points(sf_map *map, size_t picture) {
    job j = job_of(map, picture);
    j.of_track = make_or_use;
    sf_pool_run(map->ctx->pool, chunks_of(&j), chunk_task, &j);
}

static size_t drop_bad_of(sf_map *map, size_t track) {
    double most = map->options.error_px;
    sf_sight sights[SIGHTS_MOST];
    size_t dropped = 0, kept = 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        sf_sight sight;
        if (!map->is_used[i]) continue;
        if (!sf_map_observe(map, i, &sight) || !(sf_sight_error(&sight, map->at[track]) <= most)) {
            map->is_used[i] = 0;
            dropped++;
        } else if (kept < SIGHTS_MOST) {
            sights[kept++] = sight;
        }
    }
    if (is_wide(map, sights, kept, map->at[track])) return dropped;
    map->has_point[track] = 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        dropped += map->is_used[i];
        map->is_used[i] = 0;
    }
    return dropped;
}

static void drop(const job *j, size_t track, size_t chunk) {
    if (j->map->has_point[track]) j->dropped[chunk] += drop_bad_of(j->map, track);
}

sf_status sf_map_drop_bad(sf_map *map, size_t picture, size_t *dropped) {
    job j = job_of(map, picture);
    j.of_track = drop;
    j.dropped = sf_calloc(map->ctx, chunks_of(&j) + 1, sizeof *j.dropped);
    *dropped = 0;
    if (!j.dropped) return SF_ERR_MEMORY;
    sf_pool_run(map->ctx->pool, chunks_of(&j), chunk_task, &j);
    for (size_t i = 0; i < chunks_of(&j); i++) *dropped += j.dropped[i];
    sf_free(map->ctx, j.dropped);
    return SF_OK;
}

size_t sf_map_count_points(const sf_map *map, size_t *observations) {
    size_t points = 0;
    *observations = 0;
    for (size_t track = 0; track < map->tracks.count; track++) {
        if (!map->has_point[track]) continue;
        points++;
        for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++)
            *observations += map->is_used[i];
    }
    return points;
}
