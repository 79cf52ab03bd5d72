/* map_place.c - the pose of a further picture from the points that it sees (GEOMETRY.md, S.26). */
#include <math.h>
#include <string.h>

#include "map.h"
#include "pose_search.h"

size_t sf_map_count_seen(const sf_map *map, size_t picture, size_t *cells) {
    enum { SIDE = 16 };
    const sf_map_picture *p = &map->pictures[picture];
    const sf_map_camera *camera = &map->cameras[p->camera];
    uint8_t is_seen[SIDE * SIDE] = {0};
    size_t seen = 0;
    for (size_t k = 0; k < p->count; k++) {
        double x = p->keypoints[2 * k] * SIDE / camera->width,
               y = p->keypoints[2 * k + 1] * SIDE / camera->height;
        if (p->track_of[k] == UINT32_MAX || !map->has_point[p->track_of[k]]) continue;
        seen++;
        if (x >= 0 && y >= 0 && x < SIDE && y < SIDE) is_seen[(int)y * SIDE + (int)x] = 1;
    }
    if (cells) *cells = 0;
    for (size_t i = 0; cells && i < SIDE * SIDE; i++) *cells += is_seen[i];
    return seen;
}

static int make_observations(const sf_map *map, size_t picture, sf_pose_search *s) {
    const sf_map_picture *p = &map->pictures[picture];
    const sf_lens *lens = &map->cameras[p->camera].lens;
    if (!sf_pose_search_make(map->ctx, sf_map_count_seen(map, picture, NULL), lens, s)) return 0;
    for (size_t k = 0; k < p->count; k++) {
        uint32_t track = p->track_of[k];
        if (track == UINT32_MAX || !map->has_point[track]) continue;
        sf_pose_search_add(s, map->at[track], p->keypoints + 2 * k);
    }
    return 1;
}

static sf_pose_search_options options_for(const sf_map *map, size_t picture) {
    return (sf_pose_search_options){.error_px = map->options.error_px *
                                                sf_map_unit(&map->cameras[map->pictures[picture].camera]),
                                    .least = map->options.least_seen,
                                    .seed = map->options.seed + picture};
}

static void search(const sf_map *map, size_t picture, sf_pose_search *s, sf_ransac_result *found) {
    const sf_pose_search_options options = options_for(map, picture);
    sf_pose_search_run(s, &options, found);
}

/* A camera that no placed picture has, and that nobody vouches for: its focal length is looked for as well.
 */
static int is_new_camera(const sf_map *map, size_t picture) {
    const sf_map_camera *camera = &map->cameras[map->pictures[picture].camera];
    if (camera->is_fixed || (camera->focal_prior > 0 && !camera->is_doubtful)) return 0;
    for (size_t i = 0; i < map->picture_count; i++)
        if (map->pictures[i].is_placed && map->pictures[i].camera == map->pictures[picture].camera) return 0;
    return 1;
}

/* The pose of least cost over factors of the focal length from a third to three. */
static void search_focal(const sf_map *map, size_t picture, sf_pose_search *s, sf_ransac_result *found) {
    enum { STEPS = 6 };
    const sf_lens guess = s->lens;
    sf_lens best = guess;
    *found = (sf_ransac_result){.cost = INFINITY};
    for (int i = -STEPS; i <= STEPS; i++) {
        sf_ransac_result here;
        double factor = pow(3, (double)i / STEPS);
        s->lens = guess, s->lens.fx *= factor, s->lens.fy *= factor;
        search(map, picture, s, &here);
        if (here.count && here.cost < found->cost) *found = here, best = s->lens;
    }
    s->lens = best;
}

/* With what files tell, unless another focal length explains the points clearly better. Returns whether that
 * is so. */
static int search_doubtful(const sf_map *map, size_t picture, sf_pose_search *s, sf_ransac_result *found) {
    const double most = 0.7, clearly = 0.8;
    const sf_lens told = s->lens;
    sf_ransac_result other;
    search(map, picture, s, found);
    if ((double)found->count >= most * (double)s->all.count) return 0;
    search_focal(map, picture, s, &other);
    if (other.count && (!found->count || other.cost < clearly * found->cost)) {
        *found = other;
        return 1;
    }
    s->lens = told;
    return 0;
}

sf_status sf_map_place(sf_map *map, size_t picture, int *is_placed) {
    sf_map_picture *p = &map->pictures[picture];
    const sf_pose_search_options options = options_for(map, picture);
    sf_pose_search s;
    sf_ransac_result found = {.count = 0};
    int with_focal = is_new_camera(map, picture), ready = make_observations(map, picture, &s);
    *is_placed = 0;
    p->tried_at = s.all.count;
    if (ready && s.all.count >= map->options.least_seen) {
        if (with_focal && map->cameras[p->camera].focal_prior > 0)
            with_focal = search_doubtful(map, picture, &s, &found);
        else if (with_focal)
            search_focal(map, picture, &s, &found);
        else
            search(map, picture, &s, &found);
    }
    if (found.count) {
        sf_rigid T = sf_pose_search_pose(&found);
        size_t count = sf_pose_search_refine(&s, &options, with_focal, &T);
        *is_placed = count >= map->options.least_seen && 4 * count >= s.all.count;
        if (*is_placed) {
            p->is_placed = 1, p->pose = T;
            map->placed_count++;
            if (with_focal) map->cameras[p->camera].lens = s.lens, map->cameras[p->camera].focal_prior = 0;
        }
    }
    sf_pose_search_free(map->ctx, &s);
    return ready ? SF_OK : SF_ERR_MEMORY;
}
