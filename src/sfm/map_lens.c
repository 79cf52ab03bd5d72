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
}

/* All but the cameras. */
static void restore(sf_map *map, const saved *s) {
    for (size_t i = 0; i < map->picture_count; i++) map->pictures[i].pose = s->poses[i];
    memcpy(map->at, s->at, map->tracks.count * sizeof *s->at);
    map->spread = s->spread;
}

/* Sightings of each n-th track's point. */
static size_t count_observations(const sf_map *map, size_t each) {
    size_t count = 0;
    for (size_t track = 0; track < map->tracks.count; track += each)
        for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++)
            count += map->has_point[track] && map->is_used[i];
    return count;
}

/* The distances between points and where the pictures of a camera see them, px. Returns how many there are.
 */
static size_t measure_distances(const sf_map *map, size_t each, size_t camera, double *distances) {
    size_t n = 0;
    for (size_t track = 0; track < map->tracks.count; track += each)
        for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
            const sf_track_observation *s = &map->tracks.observations[i];
            const sf_map_picture *picture = &map->pictures[s->picture];
            double point[3], pixel[2];
            if (!map->has_point[track] || !map->is_used[i] || !picture->is_placed) continue;
            if (picture->camera != camera) continue;
            sf_rigid_apply(&picture->pose, map->at[track], point);
            if (!sf_lens_project(&map->cameras[camera].lens, point, pixel, NULL, NULL)) continue;
            const double *seen = picture->keypoints + 2 * (size_t)s->keypoint;
            distances[n++] = hypot(pixel[0] - seen[0], pixel[1] - seen[1]);
        }
    return n;
}

/* medians [cameras]: the median distance of each camera, px. SF_ERR_MEMORY. */
static sf_status find_medians(const sf_map *map, size_t each, double *medians) {
    double *distances = sf_alloc(map->ctx, count_observations(map, each) + 1, sizeof *distances);
    for (size_t i = 0; distances && i < map->camera_count; i++) {
        size_t n = measure_distances(map, each, i, distances);
        medians[i] = n ? sf_median(distances, n) : 0;
    }
    sf_free(map->ctx, distances);
    return distances ? SF_OK : SF_ERR_MEMORY;
}

static void set_radial(sf_map_camera *c, int radial) {
    if (c->is_fixed) return;
    c->radial = radial;
    if (radial < 2) c->lens.k2 = 0;
    if (radial < 1) c->lens.k1 = 0;
}

static int is_open(const sf_map *map, size_t camera) {
    return !map->cameras[camera].is_fixed && map->cameras[camera].radial == map->options.radial;
}

/* What choosing works with. */
typedef struct choice {
    saved full;              /* before the trial */
    size_t each;             /* the tracks that it takes */
    double *medians, *trial; /* [cameras]: with all parameters, and in the trial */
    uint8_t *is_tried;       /* [cameras]: has fewer in it */
} choice;

static int make_choice(const sf_map *map, choice *c) {
    c->medians = sf_alloc(map->ctx, 2 * map->camera_count + 1, sizeof *c->medians);
    c->is_tried = sf_alloc(map->ctx, map->camera_count + 1, sizeof *c->is_tried);
    if (!make_saved(map, &c->full) || !c->medians || !c->is_tried) return 0;
    c->trial = c->medians + map->camera_count;
    return 1;
}

static void free_choice(const sf_map *map, choice *c) {
    free_saved(map, &c->full);
    sf_free(map->ctx, c->medians);
    sf_free(map->ctx, c->is_tried);
}

static void use_radial(sf_map *map, const choice *c, int radial) {
    memcpy(map->cameras, c->full.cameras, map->camera_count * sizeof *map->cameras);
    for (size_t i = 0; i < map->camera_count; i++)
        if (c->is_tried[i]) set_radial(&map->cameras[i], radial);
}

/* Ends the trial for lenses whose residuals have grown most: they may have bent the others'. Returns how many
 * there are. */
static size_t give_up(const sf_map *map, choice *c) {
    double worst = 0;
    size_t count = 0;
    for (size_t i = 0; i < map->camera_count; i++) {
        c->trial[i] = c->medians[i] > 0 ? c->trial[i] / c->medians[i] - 1 : 0;
        if (c->is_tried[i]) worst = fmax(worst, c->trial[i]);
    }
    for (size_t i = 0; i < map->camera_count && worst > GAIN; i++) {
        int is_bad = c->is_tried[i] && c->trial[i] > worst / 2;
        count += is_bad != 0;
        c->is_tried[i] = (uint8_t)(c->is_tried[i] && !is_bad);
    }
    return count;
}

/* Leaves to the open lenses `radial` parameters, where the residuals of their pictures stay as they are. */
static sf_status try_radial(sf_map *map, choice *c, int radial) {
    size_t given_up = 1, tried = 0;
    sf_status status = SF_OK;
    save(map, &c->full);
    for (size_t i = 0; i < map->camera_count; i++) tried += c->is_tried[i] = (uint8_t)is_open(map, i);
    for (; tried && given_up && !status; tried -= given_up) {
        use_radial(map, c, radial);
        status = sf_map_adjust_sample(map, c->each, 10, 1e-3);
        if (!status) status = find_medians(map, c->each, c->trial);
        given_up = status ? 0 : give_up(map, c);
        restore(map, &c->full);
    }
    use_radial(map, c, radial);
    return status;
}

/* The residuals with all parameters, by the observations of the trials: fewer observations are explained
 * better. */
static sf_status measure_full(sf_map *map, choice *c) {
    save(map, &c->full);
    sf_status status = c->each > 1 ? sf_map_adjust_sample(map, c->each, 10, 1e-3) : SF_OK;
    if (!status) status = find_medians(map, c->each, c->medians);
    memcpy(map->cameras, c->full.cameras, map->camera_count * sizeof *map->cameras);
    restore(map, &c->full);
    return status;
}

sf_status sf_map_choose_lens(sf_map *map) {
    enum { ENOUGH = 30000 };
    choice c = {.each = count_observations(map, 1) / ENOUGH + 1};
    sf_status status = make_choice(map, &c) ? SF_OK : SF_ERR_MEMORY;
    if (!status) status = measure_full(map, &c);
    for (int radial = 0; radial < map->options.radial && !status; radial++)
        status = try_radial(map, &c, radial);
    free_choice(map, &c);
    return status;
}
