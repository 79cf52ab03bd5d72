/* map_place.c - the pose of a further picture from the points that it sees (GEOMETRY.md, S.26). */
#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "absolute_pose.h"
#include "map.h"
#include "ransac.h"

/* Points and where a picture sees them. */
typedef struct sightings {
    sf_sightings all;
    double *points, *pixels, *rays; /* [count][3], [count][2], [count][2] */
    double *scratch;                /* [2 count] */
    uint32_t *members;              /* [count] */
    sf_lens lens;
    double scale; /* px: of the weights of a refinement */
} sightings;

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

static int make_sightings(const sf_map *map, size_t picture, sightings *s) {
    const sf_map_picture *p = &map->pictures[picture];
    size_t count = sf_map_count_seen(map, picture, NULL), n = 0;
    s->lens = map->cameras[p->camera].lens;
    s->points = sf_alloc(map->ctx, 9 * count + 1, sizeof *s->points);
    s->members = sf_alloc(map->ctx, count + 1, sizeof *s->members);
    if (!s->points || !s->members) return 0;
    s->pixels = s->points + 3 * count, s->rays = s->pixels + 2 * count, s->scratch = s->rays + 2 * count;
    for (size_t k = 0; k < p->count; k++) {
        uint32_t track = p->track_of[k];
        if (track == UINT32_MAX || !map->has_point[track]) continue;
        memcpy(s->points + 3 * n, map->at[track], sizeof map->at[track]);
        memcpy(s->pixels + 2 * n, p->keypoints + 2 * k, 2 * sizeof *s->pixels);
        n++;
    }
    s->all = (sf_sightings){s->points, s->pixels, n};
    return 1;
}

/* The rays through the lens; a pixel without one gets that of a pinhole. */
static void make_rays(sightings *s) {
    for (size_t i = 0; i < s->all.count; i++) {
        const double *pixel = s->pixels + 2 * i;
        if (sf_lens_ray(&s->lens, pixel, s->rays + 2 * i)) continue;
        s->rays[2 * i] = (pixel[0] - s->lens.cx) / s->lens.fx;
        s->rays[2 * i + 1] = (pixel[1] - s->lens.cy) / s->lens.fy;
    }
}

/* The model of the search: a pose, as sf_rigid. */

static int solve(const void *user, const uint32_t *sample, double *models) {
    const sightings *s = user;
    sf_rigid poses[SF_P3P_MOST];
    int count = sf_pose_from_3(s->points, s->rays, sample, poses);
    for (int k = 0; k < count; k++) {
        memcpy(models + (size_t)(12 * k), poses[k].R, sizeof poses[k].R);
        memcpy(models + (size_t)(12 * k + 9), poses[k].t, sizeof poses[k].t);
    }
    return count;
}

static sf_rigid pose_of(const double *model) {
    sf_rigid T;
    memcpy(T.R, model, sizeof T.R);
    memcpy(T.t, model + 9, sizeof T.t);
    return T;
}

static int refit(const void *user, double *weights, double *model) {
    const sightings *s = user;
    sf_rigid T = pose_of(model);
    sf_lens lens = s->lens;
    size_t count = 0;
    for (uint32_t i = 0; i < s->all.count; i++)
        if (weights[i] != 0) s->members[count++] = i;
    if (count < 4 || !isfinite(sf_pose_refine(&s->all, s->members, count, s->scale, 0, &lens, &T))) return 0;
    memcpy(model, T.R, sizeof T.R);
    memcpy(model + 9, T.t, sizeof T.t);
    return 1;
}

static void errors(const void *user, const double *model, size_t begin, size_t end, double *squared) {
    const sightings *s = user;
    const sf_rigid T = pose_of(model);
    for (size_t i = begin; i < end; i++) {
        double p[3], pixel[2];
        sf_rigid_apply(&T, s->points + 3 * i, p);
        squared[i - begin] = INFINITY;
        if (!sf_lens_project(&s->lens, p, pixel, NULL, NULL)) continue;
        double x = pixel[0] - s->pixels[2 * i], y = pixel[1] - s->pixels[2 * i + 1];
        squared[i - begin] = x * x + y * y;
    }
}

static void search(const sf_map *map, size_t picture, sightings *s, sf_ransac_result *found) {
    const sf_ransac_problem problem = {s, s->all.count, 3, 12, solve, refit, errors};
    const sf_ransac_options options = {.threshold = map->options.error_px,
                                       .confidence = 0.9999,
                                       .least = 10,
                                       .most = 2000,
                                       .least_count = map->options.least_seen,
                                       .seed = map->options.seed + picture};
    make_rays(s);
    s->scale = map->options.error_px / 2;
    sf_ransac(&problem, &options, s->scratch, NULL, found);
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
static void search_focal(const sf_map *map, size_t picture, sightings *s, sf_ransac_result *found) {
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
static int search_doubtful(const sf_map *map, size_t picture, sightings *s, sf_ransac_result *found) {
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

/* The last refinement, over the inliers, with the focal length of a new camera. Returns how many there are.
 */
static size_t refine(const sf_map *map, sightings *s, int with_focal, sf_rigid *T, double *model) {
    size_t count = 0;
    for (int round = 0; round < 3; round++) {
        double most = map->options.error_px * map->options.error_px;
        memcpy(model, T->R, sizeof T->R), memcpy(model + 9, T->t, sizeof T->t);
        errors(s, model, 0, s->all.count, s->scratch);
        count = 0;
        for (uint32_t i = 0; i < s->all.count; i++)
            if (s->scratch[i] <= most) s->members[count++] = i;
        if (count < map->options.least_seen) return 0;
        sf_pose_refine(&s->all, s->members, count, s->scale, with_focal, &s->lens, T);
    }
    return count;
}

sf_status sf_map_place(sf_map *map, size_t picture, int *is_placed) {
    sf_map_picture *p = &map->pictures[picture];
    sightings s = {.scale = 1};
    sf_ransac_result found = {.count = 0};
    int with_focal = is_new_camera(map, picture), ready = make_sightings(map, picture, &s);
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
        sf_rigid T = pose_of(found.model);
        size_t count = refine(map, &s, with_focal, &T, found.model);
        *is_placed = count >= map->options.least_seen && 4 * count >= s.all.count;
        if (*is_placed) {
            p->is_placed = 1, p->pose = T;
            map->placed_count++;
            if (with_focal) map->cameras[p->camera].lens = s.lens, map->cameras[p->camera].focal_prior = 0;
        }
    }
    sf_free(map->ctx, s.points);
    sf_free(map->ctx, s.members);
    return ready ? SF_OK : SF_ERR_MEMORY;
}
