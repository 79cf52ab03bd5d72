/* first_map.c - see first_map.h. */
#include "first_map.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/statistics.h"
#include "../sfm/mapper.h"
#include "../sfm/verify.h"

enum {
    PAIRS_MOST = SF_FIRST_MAP_MOST * (SF_FIRST_MAP_MOST - 1) / 2,
    PLACED_LEAST = 6,  /* frames */
    GENERAL_LEAST = 3, /* pairs that show a scene with depth, from two places */
    FIRST_POINTS = 40, /* of the first pair */
    POINTS_LEAST = 60
};

#define FOCAL_GUESS 0.9   /* of a webcam, a phone or a board's camera, in widths of its picture; */
#define FOCAL_SIGMA 0.25  /* a part of it */
#define VOTE_MOST   0.5   /* the logarithm of a factor between the two */
#define PAIR_ANGLE  0.035 /* rad, between the rays of a pair: the camera has moved */
#define WIDE_ENOUGH 0.05  /* rad: the median over the points of the widest angle between two rays */
#define ERROR_MOST  2.0   /* px at a width of 640; more of larger pictures */
#define USED_PART   0.8   /* right maps had 0.84 to 0.97, the mirrored one of a short way 0.68 */
#define PLACED_PART 0.7   /* of the frames */
#define RIGID_PART  0.65  /* of the matches of pairs: those that agree with one rigid scene */

typedef struct maker {
    sf_context *ctx;
    const sf_first_map_input *input;
    sf_map_picture pictures[SF_FIRST_MAP_MOST];
    double *keypoints[SF_FIRST_MAP_MOST];
    sf_map_camera camera;
    sf_matched_pair pairs[PAIRS_MOST];
    uint32_t *items[PAIRS_MOST]; /* the pairs' matches, which are put into order */
    size_t raw[PAIRS_MOST];      /* matches before they were verified */
    size_t pair_count;
    sf_map *map;
} maker;

static sf_status take_keypoints(maker *m) {
    for (size_t i = 0; i < m->input->count; i++) {
        const sf_features *f = &m->input->features[i];
        double *to = m->keypoints[i] = sf_alloc(m->ctx, f->count + 1, 2 * sizeof *to);
        if (!to) return SF_ERR_MEMORY;
        for (size_t k = 0; k < f->count; k++)
            to[2 * k] = (double)f->points[k].x, to[2 * k + 1] = (double)f->points[k].y;
        m->pictures[i] = (sf_map_picture){.keypoints = to, .count = f->count};
    }
    return SF_OK;
}

static double focal_guess(const maker *m) {
    return FOCAL_GUESS * (m->input->width > m->input->height ? m->input->width : m->input->height);
}

static void take_camera(maker *m) {
    const sf_first_map_input *in = m->input;
    m->camera = (sf_map_camera){
        .width = in->width, .height = in->height, .lens = in->lens, .is_fixed = in->is_lens_known};
    if (in->is_lens_known) return;
    m->camera.lens.fx = m->camera.lens.fy = m->camera.focal_prior = focal_guess(m);
    m->camera.focal_sigma = FOCAL_SIGMA;
    m->camera.is_doubtful = 1;
}

static sf_status take_pairs(maker *m) {
    size_t least = sf_verify_options_default().least_count;
    for (uint32_t a = 0; a < m->input->count; a++)
        for (uint32_t b = a + 1; b < m->input->count; b++) {
            const sf_matches *from = &(*m->input->matches)[a][b];
            if (from->count < least) continue;
            uint32_t *to = m->items[m->pair_count] = sf_alloc(m->ctx, from->count, 2 * sizeof *to);
            if (!to) return SF_ERR_MEMORY;
            for (size_t k = 0; k < from->count; k++)
                to[2 * k] = from->items[k].a, to[2 * k + 1] = from->items[k].b;
            m->raw[m->pair_count] = from->count;
            m->pairs[m->pair_count++] =
                (sf_matched_pair){.first = a, .second = b, .matches = to, .count = from->count};
        }
    return SF_OK;
}

/* The greatest error of an inlier: that of photos of 1,600 px, no less than two pixels. */
static double error_px(const maker *m) {
    double side = m->input->width > m->input->height ? m->input->width : m->input->height;
    return fmax(2, 4 * side / 1600);
}

/* 1. What pairs tell, before there is a map */

/* Few pairs of one short way may vote for any focal length: what they vote for is where the search begins, if
 * it is likely, and what is likely holds on. */
static void doubt_vote(maker *m) {
    sf_map_camera *c = &m->camera;
    if (m->input->is_lens_known) return;
    double likely = focal_guess(m);
    if (fabs(log(c->lens.fx / likely)) > VOTE_MOST) c->lens.fx = c->lens.fy = likely;
    c->focal_prior = likely;
    c->is_doubtful = c->is_vague = 0;
}

static sf_first_map_verdict judge_pairs(const maker *m) {
    size_t kinds[SF_PAIR_PLANE_OR_ROTATION + 1] = {0}, general = 0, raw = 0, rigid = 0;
    for (size_t i = 0; i < m->pair_count; i++) {
        const sf_two_view *g = &m->pairs[i].geometry;
        kinds[g->kind]++;
        general += g->kind == SF_PAIR_GENERAL && (!g->has_pose || g->angle > PAIR_ANGLE);
        raw += m->raw[i], rigid += m->pairs[i].count;
    }
    if (m->pair_count < GENERAL_LEAST) return SF_FIRST_MAP_FEW;
    if ((double)rigid < RIGID_PART * (double)raw) return SF_FIRST_MAP_MOVING;
    if (general >= GENERAL_LEAST) return SF_FIRST_MAP_FOUND;
    return kinds[SF_PAIR_PLANE] > kinds[SF_PAIR_ROTATION] ? SF_FIRST_MAP_FLAT : SF_FIRST_MAP_STILL;
}

/* 2. What the map is worth */

/* The widest angle between two rays to a point; 0: it has none. */
static double widest_angle(const sf_map *map, size_t track) {
    double least = 1;
    if (!map->has_point[track]) return 0;
    for (size_t i = map->tracks.first[track]; i < map->tracks.first[track + 1]; i++) {
        double first[3], second[3];
        const sf_map_picture *p = &map->pictures[map->tracks.observations[i].picture];
        if (!map->is_used[i] || !p->is_placed) continue;
        sf_rigid_center(&p->pose, first);
        for (int k = 0; k < 3; k++) first[k] -= map->at[track][k];
        for (size_t j = map->tracks.first[track]; j < i; j++) {
            const sf_map_picture *q = &map->pictures[map->tracks.observations[j].picture];
            if (!map->is_used[j] || !q->is_placed) continue;
            sf_rigid_center(&q->pose, second);
            for (int k = 0; k < 3; k++) second[k] -= map->at[track][k];
            double cosine = sf_dot3(first, second) / sqrt(sf_dot3(first, first) * sf_dot3(second, second));
            least = fmin(least, cosine);
        }
    }
    return acos(fmax(least, -1));
}

/* The median depth of the points that a picture sees; *count: how many it sees. */
static double median_depth(const sf_map *map, size_t picture, double *scratch, size_t *count) {
    size_t n = 0;
    for (size_t t = 0; t < map->tracks.count; t++)
        for (size_t i = map->tracks.first[t]; map->has_point[t] && i < map->tracks.first[t + 1]; i++) {
            double point[3];
            if (!map->is_used[i] || map->tracks.observations[i].picture != picture) continue;
            sf_rigid_apply(&map->pictures[picture].pose, map->at[t], point);
            scratch[n++] = point[2];
            break;
        }
    *count = n;
    return sf_median(scratch, n);
}

/* Of the observations in placed pictures: the part that points were made from. A wrong map loses many of
 * them.
 */
static double used_part(const sf_map *map) {
    double all = 0, used = 0;
    for (size_t t = 0; t < map->tracks.count; t++)
        for (size_t i = map->tracks.first[t]; i < map->tracks.first[t + 1]; i++) {
            if (!map->pictures[map->tracks.observations[i].picture].is_placed) continue;
            all++;
            used += map->has_point[t] && map->is_used[i];
        }
    return all > 0 ? used / all : 0;
}

static double mean_square_error(const sf_map *map) {
    double sum = 0, count = 0;
    for (size_t t = 0; t < map->tracks.count; t++)
        for (size_t i = map->tracks.first[t]; map->has_point[t] && i < map->tracks.first[t + 1]; i++) {
            const sf_track_observation *s = &map->tracks.observations[i];
            const sf_map_picture *p = &map->pictures[s->picture];
            double point[3], pixel[2];
            if (!map->is_used[i] || !p->is_placed) continue;
            sf_rigid_apply(&p->pose, map->at[t], point);
            if (!sf_lens_project(&map->cameras[0].lens, point, pixel, NULL, NULL)) continue;
            const double *seen = p->keypoints + 2 * (size_t)s->keypoint;
            sum += pow(pixel[0] - seen[0], 2) + pow(pixel[1] - seen[1], 2), count++;
        }
    return count > 0 ? sum / count : INFINITY;
}

static int is_good(const maker *m, const sf_first_map *map) {
    double scale = fmax(1, fmax(m->input->width, m->input->height) / 640.0);
    return map->placed >= PLACED_LEAST && (double)map->placed >= PLACED_PART * (double)m->input->count &&
           map->points >= POINTS_LEAST && map->error < ERROR_MOST * scale && map->angle > WIDE_ENOUGH &&
           map->used > USED_PART;
}

/* Measures the map; scratch [tracks]. */
static void measure(const maker *m, sf_first_map *map, double *scratch) {
    size_t n = 0, observations;
    map->lens = m->map->cameras[0].lens;
    map->points = sf_map_count_points(m->map, &observations);
    for (size_t t = 0; t < m->map->tracks.count; t++)
        if (m->map->has_point[t]) scratch[n++] = widest_angle(m->map, t);
    map->angle = sf_median(scratch, n);
    map->error = sqrt(mean_square_error(m->map));
    map->used = used_part(m->map);
    for (size_t i = 0; i < m->input->count; i++) {
        map->is_placed[i] = (uint8_t)m->map->pictures[i].is_placed;
        map->placed += map->is_placed[i];
    }
}

/* The first frame at the origin, what it sees at the distance 1. */
static int take_poses(const maker *m, sf_first_map *map, double *scratch) {
    size_t first = 0, seen;
    while (first < m->input->count && !map->is_placed[first]) first++;
    if (first == m->input->count) return 0;
    double depth = median_depth(m->map, first, scratch, &seen);
    if (!seen || !(depth > 0)) return 0;
    sf_rigid back;
    sf_rigid_invert(&m->map->pictures[first].pose, &back);
    for (size_t i = 0; i < m->input->count; i++) {
        if (!map->is_placed[i]) continue;
        sf_rigid_compose(&m->map->pictures[i].pose, &back, &map->poses[i]);
        for (int k = 0; k < 3; k++) map->poses[i].t[k] /= depth;
    }
    return 1;
}

static sf_status run_mapper(maker *m, sf_first_map *map) {
    sf_map_input input = {.cameras = &m->camera,
                          .camera_count = 1,
                          .pictures = m->pictures,
                          .picture_count = m->input->count,
                          .pairs = m->pairs,
                          .pair_count = m->pair_count};
    sf_map_options options = sf_map_options_default();
    options.first_count = FIRST_POINTS;
    options.error_px = error_px(m);
    sf_status status = sf_mapper_run(m->ctx, &input, &options, NULL, NULL, &m->map);
    map->verdict = SF_FIRST_MAP_STILL;
    if (status == SF_ERR_EMPTY) return SF_OK;
    if (status) return status;
    double *scratch = sf_alloc(m->ctx, m->map->tracks.count + 1, sizeof *scratch);
    if (!scratch) return SF_ERR_MEMORY;
    measure(m, map, scratch);
    map->verdict =
        is_good(m, map) && take_poses(m, map, scratch) ? SF_FIRST_MAP_FOUND : SF_FIRST_MAP_DOUBTFUL;
    sf_free(m->ctx, scratch);
    return SF_OK;
}

/* Pairs without a geometry go. */
static void drop_empty(maker *m) {
    size_t kept = 0;
    for (size_t i = 0; i < m->pair_count; i++)
        if (m->pairs[i].count) m->pairs[kept++] = m->pairs[i];
    m->pair_count = kept;
}

static sf_status find(maker *m, sf_first_map *map) {
    sf_verify_options verify = sf_verify_options_default();
    verify.error_px = error_px(m);
    sf_status status = take_keypoints(m);
    if (!status) take_camera(m);
    if (!status) status = take_pairs(m);
    if (!status)
        status = sf_verify_pairs(m->ctx, &verify, m->pictures, &m->camera, 1, m->pairs, m->pair_count);
    if (status) return status;
    doubt_vote(m);
    map->verdict = judge_pairs(m);
    if (map->verdict != SF_FIRST_MAP_FOUND) return SF_OK;
    drop_empty(m);
    return run_mapper(m, map);
}

sf_status sf_first_map_find(sf_context *ctx, const sf_first_map_input *input, sf_first_map *map) {
    *map = (sf_first_map){0};
    maker *m = sf_calloc(ctx, 1, sizeof *m);
    if (!m) return SF_ERR_MEMORY;
    m->ctx = ctx, m->input = input;
    sf_status status = find(m, map);
    sf_map_destroy(&m->map);
    for (size_t i = 0; i < input->count; i++) sf_free(ctx, m->keypoints[i]);
    for (size_t i = 0; i < PAIRS_MOST; i++) sf_free(ctx, m->items[i]);
    sf_free(ctx, m);
    return status;
}
