/* map_lens.c - as few radial parameters as the pictures ask for (GEOMETRY.md, S.28). */
#include <math.h>
#include <string.h>

#include "../base/statistics.h"
#include "../pose/lens.h"
#include "map.h"

/* A parameter stays where the median residual grows by more than this part without it. Less is what wrong
 * matches and reflections bend, while focal length and distortion stand in for each other. */
#define GAIN 0.01

/* What a bundle changes. */
typedef struct saved {
    sf_map_camera *cameras;
    sf_rigid *poses;
    double (*at)[3];
    double spread;
    int radial;
} saved;

static int make_saved(const sf_map *map, saved *s) {
    s->cameras = sf_alloc(map->ctx, map->camera_count + 1, sizeof *s->cameras);
    s->poses = sf_alloc(map->ctx, map->picture_count + 1, sizeof *s->poses);
    s->at = sf_alloc(map->ctx, map->tracks.count + 1, sizeof *s->at);
    return s->cameras && s->poses && s->at;
}

static void free_saved(const sf_map *map, saved *s) {
    sf_free(map->ctx, s->cameras);
    sf_free(map->ctx, s->poses);
    sf_free(map->ctx, s->at);
}

static void save(const sf_map *map, saved *s) {
    memcpy(s->cameras, map->cameras, map->camera_count * sizeof *s->cameras);
    for (size_t i = 0; i < map->picture_count; i++) s->poses[i] = map->pictures[i].pose;
    memcpy(s->at, map->at, map->tracks.count * sizeof *s->at);
    s->spread = map->spread;
    s->radial = map->options.radial;
}

static void restore(sf_map *map, const saved *s) {
    memcpy(map->cameras, s->cameras, map->camera_count * sizeof *s->cameras);
    for (size_t i = 0; i < map->picture_count; i++) map->pictures[i].pose = s->poses[i];
    memcpy(map->at, s->at, map->tracks.count * sizeof *s->at);
    map->spread = s->spread;
    map->options.radial = s->radial;
}

/* The median distance between points and where pictures see them, px. SF_ERR_MEMORY. */
static sf_status median_distance(const sf_map *map, double *median) {
    size_t sightings, n = 0;
    (void)sf_map_count_points(map, &sightings);
    double *distances = sf_alloc(map->ctx, sightings + 1, sizeof *distances);
    if (!distances) return SF_ERR_MEMORY;
    for (size_t track = 0; track < map->tracks.count; track++)
        for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
            const sf_sighting *s = &map->tracks.sightings[i];
            const sf_map_picture *picture = &map->pictures[s->picture];
            double point[3], pixel[2];
            if (!map->has_point[track] || !map->is_used[i] || !picture->is_placed || n == sightings) continue;
            sf_rigid_apply(&picture->pose, map->at[track], point);
            if (!sf_lens_project(&map->cameras[picture->camera].lens, point, pixel, NULL, NULL)) continue;
            const double *seen = picture->keypoints + 2 * (size_t)s->keypoint;
            distances[n++] = hypot(pixel[0] - seen[0], pixel[1] - seen[1]);
        }
    *median = n ? sf_median(distances, n) : 0;
    sf_free(map->ctx, distances);
    return SF_OK;
}

/* With at most `radial` parameters, the others 0; far enough for the residuals to tell. */
static sf_status adjust_with(sf_map *map, int radial) {
    map->options.radial = radial;
    for (size_t i = 0; i < map->camera_count; i++) {
        sf_map_camera *c = &map->cameras[i];
        if (c->is_fixed) continue;
        if (radial < 2) c->lens.k2 = 0;
        if (radial < 1) c->lens.k1 = 0;
    }
    return sf_map_adjust(map, 10, 1e-3);
}

sf_status sf_map_choose_lens(sf_map *map) {
    saved full = {0};
    double with = 0, without = 0;
    sf_status status = make_saved(map, &full) ? SF_OK : SF_ERR_MEMORY;
    if (!status) save(map, &full);
    if (!status) status = median_distance(map, &with);
    for (int radial = 0; radial < full.radial && !status; radial++) {
        status = adjust_with(map, radial);
        if (!status) status = median_distance(map, &without);
        if (!status && without <= (1 + GAIN) * with) {
            status = sf_map_adjust(map, 30, 1e-5);
            break;
        }
        restore(map, &full);
    }
    free_saved(map, &full);
    return status;
}
