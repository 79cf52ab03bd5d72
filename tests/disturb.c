/* disturb.c - training views that are not what they seem. */
#include "disturb.h"

#include <math.h>
#include <string.h>

static const double pi = 3.141592653589793;

/* 1. Rotations */

/* out = a b, or a^T b */
static void product(const double a[9], const double b[9], int transposed, double out[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            out[3 * i + j] = 0;
            for (int k = 0; k < 3; k++)
                out[3 * i + j] += a[transposed ? 3 * k + i : 3 * i + k] * b[3 * k + j];
        }
}

static void apply(const double R[9], const double p[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = R[3 * i] * p[0] + R[3 * i + 1] * p[1] + R[3 * i + 2] * p[2];
}

/* About `axis`, whose length is the angle. */
static void turn_about(const double axis[3], double R[9]) {
    double angle = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    double s = angle > 0 ? sin(angle) / angle : 1, c = angle > 0 ? (1 - cos(angle)) / (angle * angle) : 0.5;
    const double K[9] = {0, -axis[2], axis[1], axis[2], 0, -axis[0], -axis[1], axis[0], 0};
    product(K, K, 0, R);
    for (int k = 0; k < 9; k++) R[k] = (k % 4 == 0) + s * K[k] + c * R[k];
}

static double degrees_between(const double a[9], const double b[9]) {
    double trace = 0;
    for (int k = 0; k < 9; k++) trace += a[k] * b[k];
    return 2 * asin(fmin(1, sqrt(fmax(0, 6 - 2 * trace) / 8))) * 180 / pi;
}

/* 2. Cameras */

void test_disturb(void *user, size_t number, sf_camera *camera, uint8_t *rgb) {
    (void)rgb;
    test_cameras *c = user;
    double axis[3], by[9], R[9], center[3];
    assert_int_equal(number, c->count);
    assert_true(number < TEST_MOST_VIEWS);
    c->truth[number] = *camera;
    sf_camera_center(camera, center);
    for (int k = 0; k < 3; k++) {
        axis[k] = c->degrees * pi / 180 / sqrt(3) * sf_rng_normal(&c->rng);
        center[k] += c->depth * TEST_STUDIO_DEPTH / sqrt(3) * sf_rng_normal(&c->rng);
    }
    turn_about(axis, by);
    product(by, camera->R_cw, 0, R);
    memcpy(camera->R_cw, R, sizeof R);
    apply(R, center, camera->t_cw);
    for (int k = 0; k < 3; k++) camera->t_cw[k] = -camera->t_cw[k];
    camera->fx *= c->zoom;
    camera->fy *= c->zoom;
    c->given[c->count++] = *camera;
}

test_cameras test_disturbance(double degrees, double depth, double zoom) {
    test_cameras c = {.degrees = degrees, .depth = depth, .zoom = zoom};
    sf_rng_seed(&c.rng, 21);
    return c;
}

void test_cameras_of(sf_context *ctx, sf_scene *scene, const sf_fitter *fitter, const test_cameras *cameras,
                     sf_camera refined[TEST_MOST_VIEWS]) {
    sf_view_info view;
    size_t n = 0;
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++) {
        if (view.split != SF_SPLIT_TRAIN) continue;
        assert_true(n < cameras->count);
        assert_ok(ctx, sf_fitter_get_camera(fitter, view.id, &refined[n++]));
    }
    assert_int_equal(n, cameras->count);
}

/* The rotation that brings the worlds of `got` into those of `want`, as well as one can for all. */
static void common_turn(const sf_camera *got, const sf_camera *want, size_t n, double G[9]) {
    for (int k = 0; k < 9; k++) G[k] = k % 4 == 0;
    for (int pass = 0; pass < 20; pass++) {
        double mean[3] = {0}, by[9], next[9];
        for (size_t i = 0; i < n; i++) {
            double all[9], back[9], left[9];
            product(want[i].R_cw, got[i].R_cw, 1, all);
            for (int k = 0; k < 9; k++) back[k] = G[k % 3 * 3 + k / 3];
            product(all, back, 0, left);
            mean[0] += (left[7] - left[5]) / 2 / (double)n;
            mean[1] += (left[2] - left[6]) / 2 / (double)n;
            mean[2] += (left[3] - left[1]) / 2 / (double)n;
        }
        turn_about(mean, by);
        product(by, G, 0, next);
        memcpy(G, next, sizeof next);
    }
}

test_pose_error test_pose_error_of(const sf_camera *got, const sf_camera *want, size_t n) {
    double G[9], p[TEST_MOST_VIEWS][3], q[TEST_MOST_VIEWS][3], mean_p[3] = {0}, mean_q[3] = {0}, pq = 0,
                                                               pp = 0;
    test_pose_error e = {0};
    common_turn(got, want, n, G);
    for (size_t i = 0; i < n; i++) {
        double center[3], turned[9];
        sf_camera_center(&got[i], center);
        apply(G, center, p[i]);
        sf_camera_center(&want[i], q[i]);
        for (int k = 0; k < 3; k++) mean_p[k] += p[i][k] / (double)n, mean_q[k] += q[i][k] / (double)n;
        product(want[i].R_cw, G, 0, turned); /* got's axes, by the true pose */
        e.degrees += degrees_between(got[i].R_cw, turned) / (double)n;
    }
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            pq += (p[i][k] - mean_p[k]) * (q[i][k] - mean_q[k]);
            pp += (p[i][k] - mean_p[k]) * (p[i][k] - mean_p[k]);
        }
    for (size_t i = 0; i < n; i++) {
        double square = 0;
        for (int k = 0; k < 3; k++) square += pow(pq / pp * (p[i][k] - mean_p[k]) + mean_q[k] - q[i][k], 2);
        e.depths += sqrt(square) / TEST_STUDIO_DEPTH / (double)n;
    }
    return e;
}

/* 3. Exposures */

static const double DIM = 0.6;

static void multiply(const double gains[3], const sf_camera *camera, uint8_t *rgb) {
    for (size_t i = 0; i < 3 * (size_t)camera->width * (size_t)camera->height; i++)
        rgb[i] = (uint8_t)(fmin(gains[i % 3] * rgb[i], 255) + 0.5);
}

void test_dim(void *user, size_t number, sf_camera *camera, uint8_t *rgb) {
    (void)user, (void)number;
    multiply((const double[]){DIM, DIM, DIM}, camera, rgb);
}

void test_wander(void *user, size_t number, sf_camera *camera, uint8_t *rgb) {
    (void)user;
    double gain = DIM * (number % 2 ? 0.7 : 1.4), balance = number / 2 % 2 ? 0.15 : -0.15;
    multiply((const double[]){gain * (1 + balance), gain, gain * (1 - balance)}, camera, rgb);
}

/* 4. Blur */

/* `count` pixels, `apart` bytes from one to the next. */
static void smear(uint8_t *line, int count, size_t apart, int most) {
    uint8_t *was = malloc((size_t)count);
    assert_non_null(was);
    for (int i = 0; i < count; i++) was[i] = line[(size_t)i * apart];
    for (int i = 0; i < count; i++) {
        int sum = 0, n = 0;
        for (int k = i - most; k <= i + most; k++)
            if (k >= 0 && k < count) sum += was[k], n++;
        line[(size_t)i * apart] = (uint8_t)((sum + n / 2) / n);
    }
    free(was);
}

void test_blur_a_third(void *user, size_t number, sf_camera *camera, uint8_t *rgb) {
    const test_smear *by = user;
    size_t width = 3 * (size_t)camera->width;
    if (number % 3 != 1) return;
    for (size_t y = 0; y < (size_t)camera->height; y++)
        for (size_t ch = 0; ch < 3; ch++) smear(rgb + y * width + ch, camera->width, 3, by->across);
    for (size_t x = 0; x < width; x++) smear(rgb + x, camera->height, width, by->down);
}
