/* sfm_scene_fixture.c - see sfm_scene_fixture.h. */
#include "sfm_scene_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/base/linear.h"
#include "../../src/base/statistics.h"
#include "../../src/sfm/plane.h"

enum { WIDTH = 1000, HEIGHT = 750 };

static const double radius = 3;

static void *clear(size_t count, size_t size) {
    void *block = calloc(count + 1, size);
    if (!block) abort();
    return block;
}

/* Points of a bumpy ball, whose normals point outwards; of a wall; of a room around the views. */
static void make_points(sfm_scene *s, sf_rng *rng) {
    for (size_t i = 0; i < s->points; i++) {
        double d[3], far = 0.8 + 0.3 * sf_rng_uniform(rng);
        sfm_direction(rng, d);
        if (s->layout == SFM_ROTATION) far *= 5;
        for (size_t k = 0; k < 3; k++) s->at[3 * i + k] = d[k] * far;
        for (size_t k = 0; k < 3 && s->layout == SFM_PLANE; k++)
            s->at[3 * i + k] = k < 2 ? 4 * (sf_rng_uniform(rng) - 0.5) : 0;
    }
}

static void place_view(sfm_scene *s, size_t view, sf_rng *rng) {
    double turn = 6.283185307179586 * (double)view / (double)s->views;
    double far = radius * (1 + 0.15 * sin(5 * turn) + 0.05 * sf_rng_normal(rng));
    double center[3] = {far * sin(turn), 0.9 * sin(3 * turn) - 0.5, -far * cos(turn)};
    double target[3] = {0.15 * sf_rng_normal(rng), 0.15 * sf_rng_normal(rng), 0};
    if (s->layout == SFM_PLANE) center[0] = 1.5 * sin(turn), center[1] = cos(turn), center[2] = -far;
    for (int k = 0; k < 3 && s->layout == SFM_ROTATION; k++) target[k] = center[k], center[k] = 0;
    sfm_look_at(center, target, &s->truth[view]);
}

static void make_lenses(sfm_scene *s, int plain) {
    for (size_t i = 0; i < s->cameras; i++) {
        double f = WIDTH * (0.9 + 0.35 * (double)i);
        s->lenses[i] =
            (sf_lens){.fx = f, .fy = f, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0, .k1 = -0.06, .k2 = 0.01};
        if (plain) s->lenses[i].k1 = i ? 0 : -0.12, s->lenses[i].k2 = 0;
        s->known[i] = (sf_map_camera){
            .width = WIDTH,
            .height = HEIGHT,
            .lens = {.fx = 1.2 * WIDTH, .fy = 1.2 * WIDTH, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0}};
    }
}

static int is_seen(const sfm_scene *s, size_t view, size_t point, double pixel[2]) {
    const double *at = s->at + 3 * point;
    double p[3], center[3], to[3];
    sf_rigid_center(&s->truth[view], center);
    for (int k = 0; k < 3; k++) to[k] = center[k] - at[k];
    double cosine = sf_dot3(to, at) / sqrt(sf_dot3(to, to) * sf_dot3(at, at));
    sf_rigid_apply(&s->truth[view], at, p);
    return (s->layout != SFM_GENERAL || cosine > 0.35) &&
           sf_lens_project(&s->lenses[s->pictures[view].camera], p, pixel, NULL, NULL) && pixel[0] >= 0 &&
           pixel[1] >= 0 && pixel[0] < WIDTH && pixel[1] < HEIGHT;
}

/* What a view sees, in an order of its own: point i is taken at place (i * step) mod points. */
static void take_picture(sfm_scene *s, size_t view, double noise, sf_rng *rng) {
    double *keypoints = clear(2 * s->points, sizeof *keypoints), pixel[2];
    sf_map_picture *p = &s->pictures[view];
    s->point_of[view] = clear(s->points, sizeof **s->point_of);
    for (size_t i = 0; i < s->points; i++) {
        size_t point = (i * 7919 + view * 31) % s->points;
        if (!is_seen(s, view, point, pixel) || sf_rng_uniform(rng) < 0.3) continue;
        for (size_t k = 0; k < 2; k++) keypoints[2 * p->count + k] = pixel[k] + noise * sf_rng_normal(rng);
        s->point_of[view][p->count++] = (uint32_t)point;
    }
    p->keypoints = keypoints;
}

static void match(sfm_scene *s, size_t pair, double wrong, sf_rng *rng) {
    sf_matched_pair *p = &s->pairs[pair];
    const sf_map_picture *a = &s->pictures[p->first], *b = &s->pictures[p->second];
    uint32_t *there = clear(s->points, sizeof *there);
    p->matches = clear(2 * a->count, sizeof *p->matches);
    memset(there, 0xff, s->points * sizeof *there);
    for (uint32_t k = 0; k < b->count; k++) there[s->point_of[p->second][k]] = k;
    for (uint32_t k = 0; k < a->count; k++) {
        uint32_t to = there[s->point_of[p->first][k]];
        if (to == UINT32_MAX || sf_rng_uniform(rng) < wrong) {
            if (sf_rng_uniform(rng) > wrong) continue;
            to = (uint32_t)sf_rng_below(rng, b->count);
        }
        p->matches[2 * p->count] = k, p->matches[2 * p->count++ + 1] = to;
    }
    free(there);
}

void sfm_scene_make(sf_context *ctx, const sfm_scene_options *o, sfm_scene *s) {
    sf_rng rng;
    sf_rng_seed(&rng, o->seed);
    *s = (sfm_scene){
        .ctx = ctx, .views = o->views, .points = o->points, .cameras = o->cameras, .layout = o->layout};
    s->at = clear(3 * s->points, sizeof *s->at);
    s->truth = clear(s->views, sizeof *s->truth);
    s->lenses = clear(s->cameras, sizeof *s->lenses);
    s->known = clear(s->cameras, sizeof *s->known);
    s->pictures = clear(s->views, sizeof *s->pictures);
    s->point_of = clear(s->views, sizeof *s->point_of);
    s->pairs = clear(s->views * o->reach, sizeof *s->pairs);
    make_points(s, &rng);
    make_lenses(s, o->plain);
    for (size_t v = 0; v < s->views; v++) {
        place_view(s, v, &rng);
        s->pictures[v].camera = (uint32_t)(v % s->cameras);
        take_picture(s, v, o->noise, &rng);
    }
    for (uint32_t v = 0; v < s->views; v++)
        for (uint32_t k = 1; k <= o->reach; k++) {
            uint32_t w = (uint32_t)((v + k) % s->views);
            s->pairs[s->pair_count].first = v < w ? v : w, s->pairs[s->pair_count].second = v < w ? w : v;
            match(s, s->pair_count++, o->wrong, &rng);
        }
}

void sfm_scene_free(sfm_scene *s) {
    for (size_t v = 0; v < s->views; v++) free((void *)s->pictures[v].keypoints), free(s->point_of[v]);
    for (size_t i = 0; i < s->pair_count; i++) free(s->pairs[i].matches);
    free(s->at), free(s->truth), free(s->lenses), free(s->known), free(s->pictures);
    free(s->point_of), free(s->pairs);
}

void sfm_scene_verify(sfm_scene *s) {
    const sf_verify_options options = sf_verify_options_default();
    if (sf_verify_pairs(s->ctx, &options, s->pictures, s->known, s->cameras, s->pairs, s->pair_count))
        abort();
}

sf_map_input sfm_scene_input(const sfm_scene *s) {
    return (sf_map_input){s->known, s->cameras, s->pictures, s->views, s->pairs, s->pair_count};
}

/* The rotation (Horn) and scale that take the directions a to b, [count][3] about their means. */
static void align(const double *a, const double *b, size_t count, double R[9], double *scale) {
    double S[9] = {0}, aa = 0, bb = 0, N[16], q[4];
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < 9; k++) S[k] += a[3 * i + k / 3] * b[3 * i + k % 3];
        aa += sf_dot3(a + 3 * i, a + 3 * i), bb += sf_dot3(b + 3 * i, b + 3 * i);
    }
    const double rows[16] = {S[0] + S[4] + S[8],  S[5] - S[7], S[6] - S[2], S[1] - S[3], S[5] - S[7],
                             S[0] - S[4] - S[8],  S[1] + S[3], S[6] + S[2], S[6] - S[2], S[1] + S[3],
                             -S[0] + S[4] - S[8], S[5] + S[7], S[1] - S[3], S[6] + S[2], S[5] + S[7],
                             -S[0] - S[4] + S[8]};
    for (int k = 0; k < 16; k++) N[k] = -rows[k];
    sf_least_eigenvector(4, N, q);
    sf_rotation_from_quat(q, R);
    *scale = sqrt(bb / aa);
}

/* Centers of the map's and the true cameras, about their means. */
static size_t gather_centers(const sfm_scene *s, const sf_map *map, double *a, double *b) {
    double middle[6] = {0};
    size_t n = 0;
    for (size_t v = 0; v < s->views; v++) {
        if (!map->pictures[v].is_placed) continue;
        sf_rigid_center(&map->pictures[v].pose, a + 3 * n);
        sf_rigid_center(&s->truth[v], b + 3 * n);
        n++;
    }
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < 3; k++)
            middle[k] += a[3 * i + k] / (double)n, middle[3 + k] += b[3 * i + k] / (double)n;
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < 3; k++) a[3 * i + k] -= middle[k], b[3 * i + k] -= middle[3 + k];
    return n;
}

sfm_map_errors sfm_scene_compare(const sfm_scene *s, const sf_map *map) {
    double *a = clear(3 * s->views, sizeof *a), *b = clear(3 * s->views, sizeof *b);
    double *turned = clear(s->views, sizeof *turned), *moved = clear(s->views, sizeof *moved), R[9], scale;
    size_t n = gather_centers(s, map, a, b), i = 0;
    align(a, b, n, R, &scale);
    for (size_t v = 0; v < s->views; v++) {
        double back[9], at[3];
        if (!map->pictures[v].is_placed) continue;
        for (int k = 0; k < 9; k++) back[k] = R[3 * (k % 3) + k / 3];
        double expected[9];
        sf_mat3_mul(map->pictures[v].pose.R, back, expected);
        turned[i] = sfm_angle_between(expected, s->truth[v].R);
        sf_mat3_vec(R, a + 3 * i, at);
        for (size_t k = 0; k < 3; k++) moved[i] += pow(scale * at[k] - b[3 * i + k], 2);
        moved[i] = sqrt(moved[i]) / radius;
        i++;
    }
    sfm_map_errors e = {sf_median(turned, n), sf_ranked(turned, n, n - 1), sf_median(moved, n),
                        sf_ranked(moved, n, n - 1)};
    free(a), free(b), free(turned), free(moved);
    return e;
}
