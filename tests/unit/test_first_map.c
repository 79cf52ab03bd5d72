/* test_first_map.c - the first map of a live fit from pictures alone: against the truth, and what is no
 * start. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <splatfit/model.h>

#include "live/first_map.h"
#include "pose/lens.h"

enum { POINTS = 500, FRAMES = 12, WIDTH = 640, HEIGHT = 480 };

static const double degree = 57.29577951308232, focal = 610;

/* What the camera sees and how it moves. */
typedef enum { ROOM, WALL, TURNING, STANDING, MOVING_HALF } place;

typedef struct frames {
    sf_features features[FRAMES];
    sf_camera truth[FRAMES];
    uint32_t point_of[FRAMES][POINTS];
    sf_frame_matches matches;
} frames;

static double draw(uint64_t *state) { /* -1..1 */
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) / (double)(1ull << 52) - 1;
}

/* A point of the place at frame n: half of a place in motion moves to the right. */
static void point_at(place p, size_t i, size_t n, double at[3]) {
    uint64_t state = 977 * (i + 1);
    for (int k = 0; k < 20; k++) (void)draw(&state);
    at[0] = 2 * draw(&state), at[1] = 1.5 * draw(&state);
    double depth = draw(&state);
    at[2] = p == WALL ? 4 + 0.4 * at[0] : 4 + 1.2 * depth;
    if (p == MOVING_HALF && i % 2) at[0] += 0.06 * (double)n, at[1] -= 0.03 * (double)n;
}

static sf_camera camera_at(place p, size_t n) {
    const double twist[6] = {p == TURNING || p == STANDING ? 0 : -0.09 * (double)n,
                             p == ROOM ? 0.01 * (double)n : 0,
                             0,
                             p == STANDING ? 0 : 0.004 * (double)n,
                             p == STANDING ? 0 : -0.02 * (double)n,
                             0};
    sf_rigid pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    sf_camera c = {
        .width = WIDTH, .height = HEIGHT, .fx = focal, .fy = focal, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    sf_rigid_move(&pose, twist);
    memcpy(c.R_cw, pose.R, sizeof c.R_cw), memcpy(c.t_cw, pose.t, sizeof c.t_cw);
    return c;
}

static void see(place p, size_t n, const sf_lens *lens, frames *f) {
    sf_features *to = &f->features[n];
    uint64_t state = 31 * (n + 1);
    f->truth[n] = camera_at(p, n);
    to->points = calloc(POINTS, sizeof *to->points);
    assert_non_null(to->points);
    for (size_t i = 0; i < POINTS; i++) {
        double at[3], seen[3], pixel[2];
        sf_rigid pose;
        memcpy(pose.R, f->truth[n].R_cw, sizeof pose.R), memcpy(pose.t, f->truth[n].t_cw, sizeof pose.t);
        point_at(p, i, n, at);
        sf_rigid_apply(&pose, at, seen);
        double u = 0.3 * draw(&state), v = 0.3 * draw(&state); /* px of noise */
        if (!sf_lens_project(lens, seen, pixel, NULL, NULL) || pixel[0] < 0 || pixel[1] < 0 ||
            pixel[0] >= WIDTH || pixel[1] >= HEIGHT)
            continue;
        f->point_of[n][to->count] = (uint32_t)i;
        to->points[to->count++] = (sf_keypoint){.x = (float)(pixel[0] + u), .y = (float)(pixel[1] + v)};
    }
}

/* One match in ten is wrong. */
static void match(frames *f, size_t a, size_t b) {
    sf_matches *m = &f->matches[a][b];
    m->items = calloc(POINTS, sizeof *m->items);
    assert_non_null(m->items);
    for (uint32_t i = 0, j = 0; i < f->features[a].count; i++) {
        while (j < f->features[b].count && f->point_of[b][j] < f->point_of[a][i]) j++;
        if (j == f->features[b].count || f->point_of[b][j] != f->point_of[a][i]) continue;
        m->items[m->count++] =
            (sf_match){i, i % 10 == 3 ? (uint32_t)((j * 7 + 11) % f->features[b].count) : j};
    }
}

static void free_frames(frames *f) {
    for (size_t n = 0; n < FRAMES; n++) {
        free(f->features[n].points);
        for (size_t k = n + 1; k < FRAMES; k++) free(f->matches[n][k].items);
    }
    free(f);
}

static sf_lens lens_of(double k1) {
    return (sf_lens){.fx = focal, .fy = focal, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0, .k1 = k1};
}

static frames *find(sf_context *ctx, place p, double k1, int is_lens_known, sf_first_map *map) {
    frames *f = calloc(1, sizeof *f);
    const sf_lens lens = lens_of(k1);
    assert_non_null(f);
    for (size_t n = 0; n < FRAMES; n++) see(p, n, &lens, f);
    for (size_t a = 0; a < FRAMES; a++)
        for (size_t b = a + 1; b < FRAMES; b++) match(f, a, b);
    sf_first_map_input input = {.width = WIDTH,
                                .height = HEIGHT,
                                .lens = is_lens_known ? lens : lens_of(0),
                                .is_lens_known = is_lens_known,
                                .count = FRAMES,
                                .features = f->features,
                                .matches = &f->matches};
    if (!is_lens_known) input.lens.fx = input.lens.fy = 400;
    assert_ok(ctx, sf_first_map_find(ctx, &input, map));
    return f;
}

static void assert_near_truth(const frames *f, const sf_first_map *map, double degrees, double distance) {
    sf_camera found[FRAMES];
    sf_similarity s;
    for (size_t n = 0; n < FRAMES; n++) {
        assert_true(map->is_placed[n]);
        found[n] = f->truth[n];
        memcpy(found[n].R_cw, map->poses[n].R, sizeof found[n].R_cw);
        memcpy(found[n].t_cw, map->poses[n].t, sizeof found[n].t_cw);
    }
    for (int k = 0; k < 9; k++) assert_true(fabs(map->poses[0].R[k] - !(k % 4)) < 1e-9);
    for (int k = 0; k < 3; k++) assert_true(fabs(map->poses[0].t[k]) < 1e-9);
    assert_true(sf_similarity_between(found, f->truth, FRAMES, &s));
    print_message("a unit of the map is %.2f\n", s.scale);
    assert_true(fabs(s.scale - 4) < 1); /* the room's middle is 4 away */
    for (size_t n = 0; n < FRAMES; n++) {
        double a[3], b[3], trace = 0, square = 0;
        sf_camera_transform(&found[n], &s);
        sf_camera_center(&found[n], a), sf_camera_center(&f->truth[n], b);
        for (int k = 0; k < 9; k++) trace += found[n].R_cw[k] * f->truth[n].R_cw[k];
        for (int k = 0; k < 3; k++) square += pow(a[k] - b[k], 2);
        assert_true(acos(fmin((trace - 1) / 2, 1)) * degree < degrees);
        assert_true(sqrt(square) < 4 * distance);
    }
}

static void a_room_gives_poses_and_lens(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(2);
    sf_first_map map;
    frames *f = find(ctx, ROOM, 0, 1, &map);
    assert_int_equal(map.verdict, SF_FIRST_MAP_FOUND);
    assert_true(map.lens.fx == focal && map.used > 0.8 && map.error < 0.5);
    assert_near_truth(f, &map, 0.05, 0.002);
    free_frames(f);
    static const double distortions[] = {0, -0.12};
    for (int i = 0; i < 2; i++) {
        f = find(ctx, ROOM, distortions[i], 0, &map);
        print_message("focal length %.1f for %.0f px, k1 %.3f for %.2f\n", map.lens.fx, focal, map.lens.k1,
                      distortions[i]);
        assert_int_equal(map.verdict, SF_FIRST_MAP_FOUND);
        /* On a short way, focal length and distortion stand in for each other; keyframes tell them apart
         * later. */
        assert_true(fabs(map.lens.fx / focal - 1) < (i ? 0.1 : 0.03));
        assert_true(fabs(map.lens.k1 - distortions[i]) < 0.03);
        assert_near_truth(f, &map, i ? 1.5 : 0.5, i ? 0.03 : 0.01);
        free_frames(f);
    }
    sf_context_destroy(&ctx);
}

/* The same bytes for any number of threads. */
static void threads_do_not_matter(void **state) {
    (void)state;
    sf_first_map maps[2];
    for (int i = 0; i < 2; i++) {
        sf_context *ctx = test_context_threads(i ? 4 : 1);
        free_frames(find(ctx, ROOM, 0, 0, &maps[i]));
        sf_context_destroy(&ctx);
    }
    assert_int_equal(maps[0].verdict, SF_FIRST_MAP_FOUND);
    assert_memory_equal(&maps[0], &maps[1], sizeof maps[0]);
}

/* A wall, a camera that turns or stands, and a place half of which moves are no start. */
static void no_map_is_better_than_a_wrong_one(void **state) {
    (void)state;
    static const struct {
        place p;
        sf_first_map_verdict verdict;
    } cases[] = {{WALL, SF_FIRST_MAP_FLAT},
                 {TURNING, SF_FIRST_MAP_STILL},
                 {STANDING, SF_FIRST_MAP_STILL},
                 {MOVING_HALF, SF_FIRST_MAP_MOVING}};
    sf_context *ctx = test_context_threads(2);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (int known = 0; known < 2; known++) {
            sf_first_map map;
            free_frames(find(ctx, cases[i].p, 0, known, &map));
            print_message("case %zu, lens %s: %d\n", i, known ? "known" : "not known", (int)map.verdict);
            assert_int_not_equal(map.verdict, SF_FIRST_MAP_FOUND);
            if (known) assert_int_equal(map.verdict, cases[i].verdict);
        }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_room_gives_poses_and_lens),
                                       cmocka_unit_test(threads_do_not_matter),
                                       cmocka_unit_test(no_map_is_better_than_a_wrong_one)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
