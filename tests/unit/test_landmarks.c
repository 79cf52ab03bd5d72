/* test_landmarks.c - patches, bundles, and landmarks that are followed through pictures of a painted room. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "base/rng.h"
#include "pose/bundle.h"
#include "pose/landmarks.h"
#include "pose/patch.h"

enum { WIDTH = 240, HEIGHT = 180, PIXELS = WIDTH * HEIGHT };

static const double degree = 57.29577951308232;
static const sf_camera lens = {
    .width = WIDTH, .height = HEIGHT, .fx = 200, .fy = 200, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};

/* 1. Pictures */

static double hash(int x, int y, int z) {
    uint32_t h = (uint32_t)x * 374761393u + (uint32_t)y * 668265263u + (uint32_t)z * 2246822519u;
    h = (h ^ (h >> 13)) * 1274126177u;
    return (double)((h ^ (h >> 16)) & 0xffff) / 65535;
}

/* Paint that changes smoothly over 1, and has corners everywhere. */
static double paint(double x, double y, int wall) {
    double i = floor(x), j = floor(y), a = x - i, b = y - j;
    a = a * a * (3 - 2 * a), b = b * b * (3 - 2 * b);
    double top = (1 - a) * hash((int)i, (int)j, wall) + a * hash((int)i + 1, (int)j, wall);
    double bottom = (1 - a) * hash((int)i, (int)j + 1, wall) + a * hash((int)i + 1, (int)j + 1, wall);
    return 0.15 + 0.7 * ((1 - b) * top + b * bottom);
}

/* A wall at z = 4 and a floor at y = 1. */
static double grey_at(const sf_rigid *pose, double u, double v) {
    const double ray[3] = {(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, 1};
    double d[3], c[3], back[3] = {-pose->t[0], -pose->t[1], -pose->t[2]};
    for (int k = 0; k < 3; k++) {
        d[k] = pose->R[k] * ray[0] + pose->R[3 + k] * ray[1] + pose->R[6 + k] * ray[2];
        c[k] = pose->R[k] * back[0] + pose->R[3 + k] * back[1] + pose->R[6 + k] * back[2];
    }
    double to_wall = (4 - c[2]) / d[2], to_floor = d[1] > 0 ? (1 - c[1]) / d[1] : INFINITY;
    if (to_floor < to_wall) return paint(6 * (c[0] + to_floor * d[0]), 6 * (c[2] + to_floor * d[2]), 1);
    return paint(5 * (c[0] + to_wall * d[0]), 5 * (c[1] + to_wall * d[1]), 2);
}

typedef struct picture {
    float plane[PIXELS];
} picture;

static void take_picture(const sf_rigid *pose, double gain, double bias, double noise, sf_rng *rng,
                         picture *to) {
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            double grey = 0;
            for (int k = 0; k < 4; k++)
                grey += grey_at(pose, x + 0.25 + 0.5 * (k % 2), y + 0.25 + 0.5 * (k / 2)) / 4;
            double hiss = noise * 2 * (sf_rng_uniform(rng) + sf_rng_uniform(rng) + sf_rng_uniform(rng) - 1.5);
            to->plane[y * WIDTH + x] = (float)(gain * grey + bias + hiss);
        }
}

/* 2. Patches */

/* The wall as two cameras see it. */
typedef struct pair {
    sf_context *ctx;
    sf_pyramid here, there;
} pair;

static pair look_twice(const sf_rigid *there, double gain, double bias, double noise) {
    pair pictures = {.ctx = test_context()};
    const sf_rigid here = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    picture *p = malloc(sizeof *p);
    sf_rng rng;
    sf_rng_seed(&rng, 7);
    assert_non_null(p);
    float *const rgb[3] = {p->plane, p->plane, p->plane};
    take_picture(&here, 1, 0, 0, &rng, p);
    assert_ok(pictures.ctx, sf_pyramid_make(pictures.ctx, &lens, rgb, WIDTH, &pictures.here));
    take_picture(there, gain, bias, noise, &rng, p);
    assert_ok(pictures.ctx, sf_pyramid_make(pictures.ctx, &lens, rgb, WIDTH, &pictures.there));
    free(p);
    return pictures;
}

static float cornerness(const sf_pyramid *p, int x, int y) {
    float row[WIDTH];
    sf_cornerness(p, y, row);
    return row[x];
}

static void forget(pair *pictures) {
    sf_pyramid_free(pictures->ctx, &pictures->here);
    sf_pyramid_free(pictures->ctx, &pictures->there);
    sf_context_destroy(&pictures->ctx);
}

static void patches_are_found_to_parts_of_a_pixel(void **state) {
    (void)state;
    sf_rigid moved = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const double still[4] = {1, 0, 0, 1};
    double squares = 0, n = 0;
    moved.t[0] = 4 / lens.fx * 5.37, moved.t[1] = -4 / lens.fy * 3.81; /* px, on the wall */
    pair p = look_twice(&moved, 0.7, 0.1, 0.01);
    for (int y = 20; y < 100; y += 10)
        for (int x = 20; x < WIDTH - 20; x += 10) {
            sf_patch patch;
            double u = x + 0.5, v = y + 0.5;
            if (cornerness(&p.here, x, y) < 2e-4f) continue;
            assert_true(sf_patch_cut(&p.here, u, v, &patch));
            double like = sf_patch_find(&p.there, &patch, still, SF_PYRAMID_LEVELS - 1, &u, &v);
            if (!(like > 0.9)) continue;
            squares += pow(u - x - 0.5 - 5.37, 2) + pow(v - y - 0.5 + 3.81, 2);
            n++;
        }
    print_message("%.0f patches, %.3f px rms\n", n, sqrt(squares / n / 2));
    assert_true(n > 60 && sqrt(squares / n / 2) < 0.1);
    forget(&p);
}

/* Against the sums as they are written down, at every pixel of some rows. */
static void corners_are_least_eigenvalues(void **state) {
    (void)state;
    const sf_rigid pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    pair p = look_twice(&pose, 1, 0, 0);
    const float *grey = p.here.levels[0].grey;
    for (int y = 0; y < HEIGHT; y += 7)
        for (int x = 0; x < WIDTH; x++) {
            double xx = 0, xy = 0, yy = 0, least = 0;
            if (x > 3 && y > 3 && x < WIDTH - 4 && y < HEIGHT - 4) {
                for (int j = y - 3; j <= y + 3; j++)
                    for (int i = x - 3; i <= x + 3; i++) {
                        double dx = (double)(grey[j * WIDTH + i + 1] - grey[j * WIDTH + i - 1]) / 2;
                        double dy = (double)(grey[(j + 1) * WIDTH + i] - grey[(j - 1) * WIDTH + i]) / 2;
                        xx += dx * dx / 49, xy += dx * dy / 49, yy += dy * dy / 49;
                    }
                least = (xx + yy - sqrt((xx - yy) * (xx - yy) + 4 * xy * xy)) / 2;
            }
            assert_true(fabs((double)cornerness(&p.here, x, y) - least) < 1e-7 + 1e-5 * (xx + yy));
        }
    forget(&p);
}

static void patches_are_turned_and_scaled(void **state) {
    (void)state;
    sf_rigid turned = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const double angle = 0.5, far = 5, turn[6] = {0, 0, far - 4, 0, 0, angle};
    double worst = 0;
    int n = 0;
    sf_rigid_move(&turned, turn); /* the wall from 5 in place of 4, turned about the axis */
    pair p = look_twice(&turned, 1, 0, 0);
    const double c = cos(angle) * far / 4, s = sin(angle) * far / 4, back[4] = {c, s, -s, c};
    for (int y = 40; y < 110; y += 10)
        for (int x = 70; x < 170; x += 10) {
            sf_patch patch;
            double dx = x + 0.5 - lens.cx, dy = y + 0.5 - lens.cy;
            double to_u = lens.cx + (cos(angle) * dx - sin(angle) * dy) * 4 / far;
            double to_v = lens.cy + (sin(angle) * dx + cos(angle) * dy) * 4 / far;
            double u = to_u + 0.7, v = to_v - 0.5;
            if (cornerness(&p.here, x, y) < 2e-4f) continue;
            assert_true(sf_patch_cut(&p.here, x + 0.5, y + 0.5, &patch));
            if (!(sf_patch_find(&p.there, &patch, back, 0, &u, &v) > 0.95)) continue;
            worst = fmax(worst, hypot(u - to_u, v - to_v));
            n++;
        }
    print_message("%d patches, %.3f px off at most\n", n, worst);
    assert_true(n > 15 && worst < 0.15);
    forget(&p);
}

static void nothing_is_found_where_nothing_is(void **state) {
    (void)state;
    const sf_rigid pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const double still[4] = {1, 0, 0, 1}, huge[4] = {9, 0, 0, 9};
    sf_patch patch;
    double u = 100.5, v = 60.5;
    pair p = look_twice(&pose, 0, 0.5, 0);
    assert_true(sf_patch_cut(&p.here, u, v, &patch));
    assert_true(sf_patch_find(&p.there, &patch, still, 2, &u, &v) < 0);
    assert_true(cornerness(&p.there, 100, 60) < 1e-9f);
    u = 100.5, v = 60.5;
    assert_true(sf_patch_find(&p.here, &patch, huge, 0, &u, &v) < -1); /* more than was kept of it */
    u = 2, v = 60;
    assert_true(sf_patch_find(&p.here, &patch, still, 0, &u, &v) < -1); /* the picture ends */
    assert_false(sf_patch_cut(&p.here, 3, 60, &patch));
    assert_true(cornerness(&p.here, 0, 0) == 0 && cornerness(&p.here, WIDTH - 1, HEIGHT - 1) == 0);
    forget(&p);
}

/* 3. Bundles */

enum { VIEWS = 10, POINTS = 80, MOST_OBSERVATIONS = VIEWS * POINTS };

typedef struct cloud {
    sf_bundle_view views[VIEWS], truth[VIEWS];
    sf_bundle_point points[POINTS];
    double at[POINTS][3];
    sf_bundle_observation observations[MOST_OBSERVATIONS];
    sf_bundle bundle;
} cloud;

/* Cameras on an arc around points; the first is known from outside, and so is the last. */
static cloud *make_cloud(double noise, double off, int wrong) {
    cloud *c = calloc(1, sizeof *c);
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    assert_non_null(c);
    for (int i = 0; i < POINTS; i++)
        for (int k = 0; k < 3; k++)
            c->at[i][k] = c->points[i].at[k] = 2 * sf_rng_uniform(&rng) - 1 + (k == 2 ? 4 : 0);
    for (int v = 0; v < VIEWS; v++) {
        const double twist[6] = {0.25 * v - 1.1,    0.1 * sin(v),   0.1 * cos(v),
                                 0.02 * sin(2 * v), 0.06 * v - 0.3, 0.05};
        sf_bundle_view *to = &c->views[v];
        *to = (sf_bundle_view){.pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                               .lens = {.fx = 300, .fy = 310, .cx = 160, .cy = 120},
                               .is_free = 1};
        sf_rigid_move(&to->pose, twist);
        c->truth[v] = *to;
        to->is_known = v == 0 || v == VIEWS - 1;
        to->prior.pose = to->pose;
        for (int k = 0; k < 6; k++) to->prior.information[7 * k] = 1e8;
    }
    size_t n = 0;
    for (uint32_t i = 0; i < POINTS; i++)
        for (uint32_t v = 0; v < VIEWS; v++) {
            double p[3], hiss[2];
            if ((i + v) % 4 == 0) continue;
            sf_mat3_vec(c->truth[v].pose.R, c->at[i], p);
            for (int k = 0; k < 3; k++) p[k] += c->truth[v].pose.t[k];
            for (int k = 0; k < 2; k++)
                hiss[k] =
                    noise * 2 * (sf_rng_uniform(&rng) + sf_rng_uniform(&rng) + sf_rng_uniform(&rng) - 1.5);
            if (wrong && (i * VIEWS + v) % 25 == 3) hiss[0] += 30;
            c->observations[n++] = (sf_bundle_observation){v, i, 300 * p[0] / p[2] + 160 + hiss[0],
                                                           310 * p[1] / p[2] + 120 + hiss[1]};
        }
    for (int i = 0; i < POINTS; i++)
        for (int k = 0; k < 3; k++) c->points[i].at[k] += off * (2 * sf_rng_uniform(&rng) - 1);
    for (int v = 1; v < VIEWS - 1; v++) {
        double twist[6];
        for (int k = 0; k < 6; k++) twist[k] = 0.3 * off * (2 * sf_rng_uniform(&rng) - 1);
        sf_rigid_move(&c->views[v].pose, twist);
    }
    c->bundle = (sf_bundle){.views = c->views,
                            .view_count = VIEWS,
                            .points = c->points,
                            .point_count = POINTS,
                            .observations = c->observations,
                            .observation_count = n};
    return c;
}

/* The greatest distances from the truth: rad and world units of poses, world units of points. */
static void off_truth(const cloud *c, double *turned, double *moved, double *points) {
    *turned = *moved = *points = 0;
    for (int v = 0; v < VIEWS; v++) {
        double twist[6];
        sf_rigid_twist(&c->truth[v].pose, &c->views[v].pose, twist);
        *moved = fmax(*moved, sqrt(sf_dot3(twist, twist)));
        *turned = fmax(*turned, sqrt(sf_dot3(twist + 3, twist + 3)));
    }
    for (int i = 0; i < POINTS; i++)
        for (int k = 0; k < 3; k++) *points = fmax(*points, fabs(c->points[i].at[k] - c->at[i][k]));
}

static void a_bundle_finds_poses_and_points(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    double spread, turned, moved, points, apart = 0;
    cloud *c = make_cloud(0, 0.1, 0);
    assert_ok(ctx, sf_bundle_adjust(ctx, &c->bundle, 30, &spread));
    off_truth(c, &turned, &moved, &points);
    print_message("exact: %.1e rad, %.1e and %.1e\n", turned, moved, points);
    assert_true(turned < 1e-5 && moved < 1e-5 && points < 1e-4);
    free(c);
    c = make_cloud(0.3, 0.1, 0);
    assert_ok(ctx, sf_bundle_adjust(ctx, &c->bundle, 30, &spread));
    off_truth(c, &turned, &moved, &points);
    print_message("0.3 px: %.1e rad, %.1e and %.1e, spread %.2f px\n", turned, moved, points, spread);
    assert_true(turned < 4e-3 && moved < 0.015 && points < 0.05);
    assert_true(fabs(spread - 0.3 * sqrt(1 - 288.0 / 1200)) < 0.02); /* of 1200 coordinates 288 are fitted */
    cloud *from_truth = make_cloud(0.3, 0, 0);
    assert_ok(ctx, sf_bundle_adjust(ctx, &from_truth->bundle, 30, &spread));
    for (int v = 0; v < VIEWS; v++) {
        double twist[6];
        sf_rigid_twist(&from_truth->views[v].pose, &c->views[v].pose, twist);
        for (int k = 0; k < 6; k++) apart = fmax(apart, fabs(twist[k]));
    }
    print_message("begun from the truth: %.1e apart\n", apart);
    assert_true(apart < 0.1 * moved); /* it ends where a step gains less than a ten thousandth */
    free(from_truth);
    free(c);
    c = make_cloud(0.3, 0.05, 1); /* one observation in 25 is 30 px off */
    assert_ok(ctx, sf_bundle_adjust(ctx, &c->bundle, 30, &spread));
    off_truth(c, &turned, &moved, &points);
    print_message("with wrong ones: %.1e rad, %.1e and %.1e\n", turned, moved, points);
    assert_true(turned < 4e-3 && moved < 1.2e-2 && points < 0.06);
    free(c);
    sf_context_destroy(&ctx);
}

static void what_is_not_free_stays(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    double spread;
    cloud *c = make_cloud(0.3, 0.1, 0);
    for (int v = 0; v < VIEWS; v += 2) c->views[v].is_free = 0;
    sf_bundle_view before[VIEWS];
    memcpy(before, c->views, sizeof before);
    assert_ok(ctx, sf_bundle_adjust(ctx, &c->bundle, 10, &spread));
    for (int v = 0; v < VIEWS; v++)
        assert_int_equal(memcmp(&before[v].pose, &c->views[v].pose, sizeof before[v].pose) == 0, v % 2 == 0);
    c->bundle.observation_count = 0; /* and nothing to do */
    memcpy(before, c->views, sizeof before);
    assert_ok(ctx, sf_bundle_adjust(ctx, &c->bundle, 10, &spread));
    assert_memory_equal(before, c->views, sizeof before);
    free(c);
    sf_context_destroy(&ctx);
}

/* Along its ray a point is held to where it was, and nowhere else. */
static void a_point_without_parallax_keeps_its_depth(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_bundle_view views[2] = {
        {.pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}}, .lens = {.fx = 300, .fy = 300, .cx = 160, .cy = 120}}};
    views[1] = views[0];
    sf_bundle_point point = {.at = {0, 0, 3}, .ray = {0, 0, 1}, .ray_information = 1};
    const sf_bundle_observation observations[2] = {{0, 0, 165, 120}, {1, 0, 165, 120}};
    const sf_bundle bundle = {.views = views,
                              .view_count = 2,
                              .points = &point,
                              .point_count = 1,
                              .observations = observations,
                              .observation_count = 2};
    double spread;
    assert_ok(ctx, sf_bundle_adjust(ctx, &bundle, 20, &spread));
    assert_true(fabs(point.at[0] - 0.05) < 1e-4 && fabs(point.at[1]) < 1e-6 && fabs(point.at[2] - 3) < 1e-2);
    sf_context_destroy(&ctx);
}

/* 4. Landmarks */

/* A hand-held walk: to the side, turning, and back to where it began. */
static sf_rigid pose_at(double s) {
    sf_rigid pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const double a = 6.283185307179586 * s;
    const double twist[6] = {0.9 * sin(a),      0.15 * sin(2 * a), 0.3 * (1 - cos(a)),
                             0.03 * sin(3 * a), 0.15 * sin(a),     0.05 * sin(2 * a)};
    sf_rigid_move(&pose, twist);
    return pose;
}

typedef struct walk {
    sf_landmarks *landmarks;
    sf_rigid pose, before; /* as found */
    double degrees, moved; /* off the truth, the most */
    size_t least_used;
} walk;

enum { FRAMES = 60, KNOWN_FRAMES = 8, KEPT_EVERY = 3 };

/* Frames first..last-1, poses of the first few known from outside. */
static void follow(sf_context *ctx, walk *w, int first, int last, picture *p) {
    sf_rng rng;
    sf_rng_seed(&rng, 11 + (uint64_t)first);
    float *const rgb[3] = {p->plane, p->plane, p->plane};
    for (int i = first; i < last; i++) {
        sf_rigid truth = pose_at((double)i / FRAMES), guess = w->pose;
        sf_track_prior known = {.pose = truth};
        sf_followed f;
        double twist[6], light = 1 + 0.2 * sin(0.5 * i);
        int is_known = i < KNOWN_FRAMES;
        for (int k = 0; k < 6; k++) known.information[7 * k] = 1e8;
        take_picture(&truth, light, 0.02 * sin(0.3 * i), 0.01, &rng, p);
        assert_ok(ctx, sf_landmarks_take(w->landmarks, &lens, rgb, WIDTH));
        if (!is_known) { /* a steady motion */
            sf_rigid_twist(&w->before, &w->pose, twist);
            sf_rigid_move(&guess, twist);
        }
        assert_ok(
            ctx, sf_landmarks_follow(w->landmarks, is_known ? &truth : &guess, is_known ? &known : NULL, &f));
        w->before = w->pose, w->pose = is_known ? truth : f.pose;
        sf_landmarks_settle(w->landmarks, &w->pose);
        if (!is_known && f.used < w->least_used) w->least_used = f.used;
        if (i % KEPT_EVERY == 0) {
            assert_ok(ctx, sf_landmarks_keep(w->landmarks, (uint32_t)i + 1, &w->pose,
                                             is_known ? &known : NULL, 3, NULL));
            assert_ok(ctx, sf_landmarks_adjust(w->landmarks, 20));
            assert_true(sf_landmarks_pose(w->landmarks, (uint32_t)i + 1, &w->pose));
        }
        sf_rigid_twist(&truth, &w->pose, twist);
        w->degrees = fmax(w->degrees, degree * sqrt(sf_dot3(twist + 3, twist + 3)));
        w->moved = fmax(w->moved, sqrt(sf_dot3(twist, twist)));
    }
}

static void a_walk_is_followed(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(2);
    picture *p = malloc(sizeof *p);
    walk w = {.least_used = SIZE_MAX, .pose = pose_at(0)};
    assert_non_null(p);
    assert_ok(ctx, sf_landmarks_create(ctx, &w.landmarks));
    follow(ctx, &w, 0, FRAMES, p);
    print_message("off by %.3f degrees and %.4f of a depth of 4 at most, by %zu landmarks and more\n",
                  w.degrees, w.moved, w.least_used);
    assert_true(w.degrees < 0.25 && w.moved < 0.02 && w.least_used >= 40);
    /* it ends where it began: the keyframe of frame 0 is what it was */
    sf_rigid first, truth = pose_at(0);
    double twist[6];
    assert_true(sf_landmarks_pose(w.landmarks, 1, &first));
    sf_rigid_twist(&truth, &first, twist);
    assert_true(sqrt(sf_dot3(twist + 3, twist + 3)) < 0.002);
    sf_landmarks_destroy(&w.landmarks);
    assert_null(w.landmarks);
    free(p);
    sf_context_destroy(&ctx);
}

static void any_number_of_threads_finds_the_same(void **state) {
    (void)state;
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and a_walk_is_followed goes the same way");
    picture *p = malloc(sizeof *p);
    sf_rigid end[2];
    assert_non_null(p);
    for (int i = 0; i < 2; i++) {
        sf_context *ctx = test_context_threads(i ? 3 : 1);
        walk w = {.least_used = SIZE_MAX, .pose = pose_at(0)};
        assert_ok(ctx, sf_landmarks_create(ctx, &w.landmarks));
        follow(ctx, &w, 0, 16, p);
        end[i] = w.pose;
        sf_landmarks_destroy(&w.landmarks);
        sf_context_destroy(&ctx);
    }
    assert_memory_equal(&end[0], &end[1], sizeof end[0]);
    free(p);
}

static void keyframes_come_and_go(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(2);
    picture *p = malloc(sizeof *p);
    walk w = {.least_used = SIZE_MAX, .pose = pose_at(0)};
    sf_rigid pose;
    sf_followed f;
    float *const rgb[3] = {p->plane, p->plane, p->plane};
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    assert_non_null(p);
    assert_ok(ctx, sf_landmarks_create(ctx, &w.landmarks));
    follow(ctx, &w, 0, 20, p);
    assert_true(sf_landmarks_pose(w.landmarks, 4, &pose));
    assert_false(sf_landmarks_pose(w.landmarks, 5, &pose)); /* was no keyframe */
    sf_landmarks_drop(w.landmarks, 4);
    sf_landmarks_drop(w.landmarks, 99); /* is none */
    assert_false(sf_landmarks_pose(w.landmarks, 4, &pose));
    follow(ctx, &w, 20, 32, p);
    assert_true(w.degrees < 0.25);
    /* a picture of nothing tells nothing */
    take_picture(&w.pose, 0, 0.5, 0.01, &rng, p);
    assert_ok(ctx, sf_landmarks_take(w.landmarks, &lens, rgb, WIDTH));
    assert_ok(ctx, sf_landmarks_follow(w.landmarks, &w.pose, NULL, &f));
    assert_true(f.used == 0 && f.expected > 40);
    assert_memory_equal(&f.pose, &w.pose, sizeof f.pose);
    sf_landmarks_clear(w.landmarks);
    assert_false(sf_landmarks_pose(w.landmarks, 1, &pose));
    assert_ok(ctx, sf_landmarks_follow(w.landmarks, &w.pose, NULL, &f));
    assert_true(f.used == 0 && f.expected == 0);
    assert_ok(ctx, sf_landmarks_adjust(w.landmarks, 20)); /* of none */
    sf_landmarks_destroy(&w.landmarks);
    free(p);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(patches_are_found_to_parts_of_a_pixel),
        cmocka_unit_test(corners_are_least_eigenvalues),
        cmocka_unit_test(patches_are_turned_and_scaled),
        cmocka_unit_test(nothing_is_found_where_nothing_is),
        cmocka_unit_test(a_bundle_finds_poses_and_points),
        cmocka_unit_test(what_is_not_free_stays),
        cmocka_unit_test(a_point_without_parallax_keeps_its_depth),
        cmocka_unit_test(a_walk_is_followed),
        cmocka_unit_test(any_number_of_threads_finds_the_same),
        cmocka_unit_test(keyframes_come_and_go),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
