/* test_undistort.c - pictures of a distorted lens against what a pinhole camera sees of the same scene. */
#include "testing.h"

#include "io/undistort.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 160, HEIGHT = 120, PIXELS = WIDTH * HEIGHT };

static const sf_lens mild = {150, 140, 83, 57, -0.15, 0.03, 0.004, -0.003, 0};

/* The scene, by direction: smooth, so that bilinear interpolation is good to a grey level. */
static double shade(double x, double y, int channel) {
    return 127 + 60 * sin(5 * x + channel) + 50 * cos(4 * y - 2 * x + channel);
}

static void distort(const sf_lens *l, double x, double y, double out[2]) {
    double r2 = x * x + y * y, d = 1 + l->k1 * r2 + l->k2 * r2 * r2 + l->k3 * r2 * r2 * r2;
    out[0] = x * d + 2 * l->p1 * x * y + l->p2 * (r2 + 2 * x * x);
    out[1] = y * d + 2 * l->p2 * x * y + l->p1 * (r2 + 2 * y * y);
}

/* The direction that a pixel of the distorted picture shows, by fixed-point iteration. */
static void direction(const sf_lens *l, double u, double v, double out[2]) {
    double want[2] = {(u - l->cx) / l->fx, (v - l->cy) / l->fy}, seen[2];
    memcpy(out, want, sizeof want);
    for (int i = 0; i < 200; i++) {
        distort(l, out[0], out[1], seen);
        for (int k = 0; k < 2; k++) out[k] += want[k] - seen[k];
    }
}

static sf_status undistort(sf_context *ctx, const sf_lens *l, sf_picture *p) {
    sf_optics optics = sf_optics_of(l);
    return sf_undistort(ctx, &optics, p);
}

typedef double (*scene_fn)(double x, double y, int channel);

static sf_picture photograph(sf_context *ctx, const sf_lens *l, scene_fn scene) {
    sf_picture p = {.width = WIDTH, .height = HEIGHT, .orientation = 1};
    p.rgb = sf_alloc(ctx, PIXELS, 3);
    assert_non_null(p.rgb);
    for (int i = 0; i < PIXELS; i++) {
        double at[2];
        direction(l, i % WIDTH + 0.5, i / WIDTH + 0.5, at);
        for (int c = 0; c < 3; c++) p.rgb[c * PIXELS + i] = (uint8_t)(scene(at[0], at[1], c) + 0.5);
    }
    return p;
}

static void pinhole_direction(const sf_lens *l, int i, double at[2]) {
    at[0] = (i % WIDTH + 0.5 - l->cx) / l->fx;
    at[1] = (i / WIDTH + 0.5 - l->cy) / l->fy;
}

/* Whether the pixel's source lies within the centres of the picture's border pixels. */
static int is_inside(const sf_lens *l, int i) {
    double at[2], seen[2];
    pinhole_direction(l, i, at);
    distort(l, at[0], at[1], seen);
    double u = l->fx * seen[0] + l->cx, v = l->fy * seen[1] + l->cy;
    return u >= 0.5 && v >= 0.5 && u <= WIDTH - 0.5 && v <= HEIGHT - 0.5;
}

static void check_lens(const sf_lens *l, int least_inside) {
    sf_context *ctx = test_context();
    sf_picture p = photograph(ctx, l, shade);
    int inside = 0;
    assert_ok(ctx, undistort(ctx, l, &p));
    assert_int_equal(p.width, WIDTH);
    assert_int_equal(p.height, HEIGHT);
    for (int i = 0; i < PIXELS; i++) {
        double at[2];
        pinhole_direction(l, i, at);
        assert_int_equal(p.weight[i], is_inside(l, i) ? 255 : 0);
        inside += p.weight[i] != 0;
        for (int c = 0; c < 3; c++)
            if (p.weight[i]) assert_true(fabs(p.rgb[c * PIXELS + i] - shade(at[0], at[1], c)) <= 2);
    }
    assert_between(inside, least_inside, PIXELS);
    sf_picture_free(ctx, &p);
    sf_context_destroy(&ctx);
}

static void test_matches_the_scene(void **state) {
    (void)state;
    const sf_lens barrel = {150, 150, 80, 60, -0.1, 0, 0, 0, 0},
                  pincushion = {150, 150, 80, 60, 0.1, 0.02, 0, 0, 0};
    const sf_lens tangential = {150, 150, 80, 60, 0, 0, 0.01, -0.008, 0};
    check_lens(&barrel, 16000);
    check_lens(&pincushion, 16000);
    check_lens(&tangential, 16000);
    const sf_lens six = {150, 140, 83, 57, 0.05, 0.02, 0.002, -0.001, -0.11};
    check_lens(&mild, 16000);
    check_lens(&six, 16000);
}

/* A bright line through the scene, x = 0.4 + 0.1 y, soft over about two pixels. */
static double line(double x, double y, int channel) {
    (void)channel;
    double d = (x - 0.1 * y - 0.4) / sqrt(1.01);
    return 250 * exp(-d * d / (2 * 0.012 * 0.012));
}

/* In each row the centre of brightness is where the straight line is, to a fifth of a pixel. */
static void test_straight_lines_come_out_straight(void **state) {
    (void)state;
    const sf_lens strong = {150, 150, 80, 60, -0.2, 0.05, 0, 0, 0};
    sf_context *ctx = test_context();
    sf_picture p = photograph(ctx, &strong, line);
    double worst_before = 0, worst = 0;
    uint8_t before[PIXELS];
    memcpy(before, p.rgb, PIXELS);
    assert_ok(ctx, undistort(ctx, &strong, &p));
    for (int row = 10; row < HEIGHT - 10; row++) {
        double sum = 0, moment = 0, sum_before = 0, moment_before = 0;
        for (int x = 0; x < WIDTH; x++) {
            sum += p.rgb[row * WIDTH + x];
            moment += p.rgb[row * WIDTH + x] * (x + 0.5);
            sum_before += before[row * WIDTH + x];
            moment_before += before[row * WIDTH + x] * (x + 0.5);
        }
        double y = (row + 0.5 - strong.cy) / strong.fy, expected = strong.fx * (0.4 + 0.1 * y) + strong.cx;
        worst = fmax(worst, fabs(moment / sum - expected));
        worst_before = fmax(worst_before, fabs(moment_before / sum_before - expected));
    }
    assert_true(worst < 0.2);
    assert_true(worst_before > 1);
    sf_picture_free(ctx, &p);
    sf_context_destroy(&ctx);
}

static void test_no_distortion_changes_nothing(void **state) {
    (void)state;
    const sf_lens plain = {150, 150, 80, 60, 0, 0, 0, 0, 0};
    sf_context *ctx = test_context();
    sf_picture p = photograph(ctx, &plain, shade);
    uint8_t before[3 * PIXELS];
    memcpy(before, p.rgb, sizeof before);
    assert_ok(ctx, undistort(ctx, &plain, &p));
    for (int i = 0; i < PIXELS; i++) {
        int x = i % WIDTH, y = i / WIDTH; /* rounding may put the border's sources outside */
        if (x && y && x < WIDTH - 1 && y < HEIGHT - 1) assert_int_equal(p.weight[i], 255);
        for (int c = 0; c < 3 && p.weight[i]; c++)
            assert_int_equal(p.rgb[c * PIXELS + i], before[c * PIXELS + i]);
    }
    sf_picture_free(ctx, &p);
    sf_context_destroy(&ctx);
}

/* r(1 - r^2/3) turns back at r = 1: what lies beyond would show the picture's inside a second time. */
static void check_turning_back(const sf_lens *l, double limit) {
    sf_context *ctx = test_context();
    sf_picture p = {.width = WIDTH, .height = HEIGHT, .orientation = 1};
    int beyond = 0, kept = 0;
    p.rgb = sf_calloc(ctx, PIXELS, 3);
    assert_ok(ctx, undistort(ctx, l, &p));
    for (int i = 0; i < PIXELS; i++) {
        double at[2];
        pinhole_direction(l, i, at);
        double r = hypot(at[0], at[1]);
        if (r > limit + 1e-6) {
            assert_int_equal(p.weight[i], 0);
            beyond++;
        }
        kept += p.weight[i] == 255;
    }
    assert_true(beyond > 1000);
    assert_true(kept > 1000);
    sf_picture_free(ctx, &p);
    sf_context_destroy(&ctx);
}

static void test_nothing_beyond_the_turning_point(void **state) {
    (void)state;
    const sf_lens cubic = {60, 60, 80, 60, -1.0 / 3, 0, 0, 0, 0};
    const sf_lens quintic = {60, 60, 80, 60, 0, -0.2, 0, 0, 0};    /* 1 - 5 0.2 r^4 */
    const sf_lens both = {60, 60, 80, 60, -0.5, 0.05, 0, 0, 0};    /* 1 - 1.5 s + 0.25 s^2: s = 3 - sqrt(5) */
    const sf_lens septic = {60, 60, 80, 60, 0, 0, 0, 0, -1.0 / 7}; /* 1 - 7/7 r^6 */
    check_turning_back(&septic, 1);
    check_turning_back(&cubic, 1);
    check_turning_back(&quintic, 1);
    check_turning_back(&both, sqrt(3 - sqrt(5)));
}

static void test_weights_come_along(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_picture p = photograph(ctx, &mild, shade);
    p.weight = sf_alloc(ctx, PIXELS, 1);
    for (int i = 0; i < PIXELS; i++) { /* the left half is hidden, and of a colour that nothing else has */
        p.weight[i] = i % WIDTH < WIDTH / 2 ? 0 : 200;
        for (int c = 0; c < 3; c++) p.rgb[c * PIXELS + i] = p.weight[i] ? 10 : 255;
    }
    assert_ok(ctx, undistort(ctx, &mild, &p));
    int hidden = 0, shown = 0;
    for (int i = 0; i < PIXELS; i++) {
        if (!is_inside(&mild, i)) assert_int_equal(p.weight[i], 0);
        assert_between(p.weight[i], 0, 200);
        hidden += is_inside(&mild, i) && p.weight[i] == 0;
        shown += p.weight[i] == 200;
        if (p.weight[i]) assert_int_equal(p.rgb[i], 10); /* none of the hidden colour seeps in */
    }
    assert_true(hidden > PIXELS / 3);
    assert_true(shown > PIXELS / 3);
    sf_picture_free(ctx, &p);
    sf_context_destroy(&ctx);
}

static void test_smallest_picture(void **state) {
    (void)state;
    const sf_lens tiny = {1, 1, 0.5, 0.5, 0.1, 0, 0, 0, 0};
    sf_context *ctx = test_context();
    sf_picture p = {.width = 1, .height = 1, .orientation = 1};
    p.rgb = sf_alloc(ctx, 1, 3);
    memset(p.rgb, 77, 3);
    assert_ok(ctx, undistort(ctx, &tiny, &p));
    assert_int_equal(p.rgb[1], 77);
    assert_int_equal(p.weight[0], 255);
    sf_picture_free(ctx, &p);
    sf_context_destroy(&ctx);
}

static void test_lens_questions(void **state) {
    (void)state;
    sf_lens l = {100, 100, 50, 50, 0, 0, 0, 0, 0};
    assert_false(sf_lens_is_distorted(&l));
    assert_true(sf_lens_is_valid(&l));
    l.p2 = 1e-9;
    assert_true(sf_lens_is_distorted(&l));
    l.p2 = NAN;
    assert_false(sf_lens_is_valid(&l));
    l.p2 = 0;
    l.fy = 0;
    assert_false(sf_lens_is_valid(&l));
    l.fy = INFINITY;
    assert_false(sf_lens_is_valid(&l));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_matches_the_scene),
        cmocka_unit_test(test_straight_lines_come_out_straight),
        cmocka_unit_test(test_no_distortion_changes_nothing),
        cmocka_unit_test(test_nothing_beyond_the_turning_point),
        cmocka_unit_test(test_weights_come_along),
        cmocka_unit_test(test_smallest_picture),
        cmocka_unit_test(test_lens_questions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
