/* sensor.c - what a small camera makes of the light that falls on it: motion blur, brightness, noise. */
#include "sensor.h"

#include <math.h>

#include "../base/linear.h"
#include "../base/rng.h"

/* 1. Motion blur */

sf_motion sf_motion_between(const sf_camera *from, const sf_camera *to) {
    double Q[9], t[3];
    sf_motion m;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) Q[3 * i + j] = sf_dot3(&to->R_cw[3 * i], &from->R_cw[3 * j]);
    sf_mat3_vec(Q, from->t_cw, t);
    m.turn[0] = (Q[7] - Q[5]) / 2;
    m.turn[1] = (Q[2] - Q[6]) / 2;
    m.turn[2] = (Q[3] - Q[1]) / 2;
    for (int i = 0; i < 3; i++) m.move[i] = to->t_cw[i] - t[i];
    return m;
}

typedef struct smearing {
    const sf_camera *camera;
    const sf_motion *motion;
    int most;
    const float *rgb, *depth;
    float *out;
} smearing;

/* How far a pixel moves, px. */
static void flow_of(const smearing *s, double x, double y, double z, double flow[2]) {
    const sf_camera *c = s->camera;
    const double *w = s->motion->turn, *v = s->motion->move;
    double p = (x - c->cx) / c->fx, q = (y - c->cy) / c->fy, near = 1 / z; /* of (p, q, 1) z */
    double dx = w[1] - w[2] * q + v[0] * near, dy = w[2] * p - w[0] + v[1] * near,
           dz = w[0] * q - w[1] * p + v[2] * near;
    flow[0] = c->fx * (dx - p * dz);
    flow[1] = c->fy * (dy - q * dz);
}

/* Adds the picture at x, y, in px from the middle of pixel 0, between its pixels. */
static void add_at(const smearing *s, double x, double y, float sum[3]) {
    int width = s->camera->width, height = s->camera->height;
    x = x < 0 ? 0 : x > width - 1 ? width - 1 : x;
    y = y < 0 ? 0 : y > height - 1 ? height - 1 : y;
    int i = (int)x, j = (int)y;
    float u = (float)(x - i), v = (float)(y - j);
    const float *a = s->rgb + 3 * ((size_t)j * (size_t)width + (size_t)i);
    const float *b = a + (i + 1 < width ? 3 : 0), *below = j + 1 < height ? a + 3 * (size_t)width : a;
    const float *d = below + (b - a);
    for (int k = 0; k < 3; k++) {
        float above = a[k] + u * (b[k] - a[k]), under = below[k] + u * (d[k] - below[k]);
        sum[k] += above + v * (under - above);
    }
}

static void smear_row(void *arg, size_t row, int thread) {
    const smearing *s = arg;
    int width = s->camera->width;
    (void)thread;
    for (int x = 0; x < width; x++) {
        size_t at = row * (size_t)width + (size_t)x;
        double flow[2];
        flow_of(s, x + 0.5, (double)row + 0.5, (double)s->depth[at], flow);
        double length = sqrt(flow[0] * flow[0] + flow[1] * flow[1]);
        float sum[3] = {0, 0, 0};
        int n = length < 0.3 ? 1 : length + 2 < s->most ? (int)length + 2 : s->most;
        double share = 1.0 / n;
        for (int k = 0; k < n; k++) {
            double along = (k + 0.5) * share - 0.5;
            add_at(s, x + along * flow[0], (double)row + along * flow[1], sum);
        }
        for (int k = 0; k < 3; k++) s->out[3 * at + (size_t)k] = sum[k] * (float)share;
    }
}

void sf_sensor_smear(struct sf_pool *pool, const sf_camera *camera, const sf_motion *motion, int most,
                     const float *rgb, const float *depth, float *out) {
    smearing s = {camera, motion, most, rgb, depth, out};
    sf_pool_run(pool, (size_t)camera->height, smear_row, &s);
}

/* 2. Brightness and noise */

static uint8_t srgb8(double linear) {
    double v = fmin(fmax(linear, 0), 1);
    v = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
    return (uint8_t)(255 * v + 0.5);
}

/* Faster, and next to as exact: good enough for what is noisy. */
static uint8_t from_curve(const sf_sensor_curve *curve, float linear) {
    linear = linear < 0 ? 0 : linear > 1 ? 1 : linear;
    return curve->byte[(int)(linear * SF_SENSOR_STEPS + 0.5f)];
}

void sf_sensor_curve_init(sf_sensor_curve *curve) {
    for (int i = 0; i <= SF_SENSOR_STEPS; i++) curve->byte[i] = srgb8((double)i / SF_SENSOR_STEPS);
}

/* Variance of the noise: SHOT for each unit of light, READ^2 at gain 1. In the middle of the range that is 2
 * steps of 8 bits. */
static const float SHOT = 2.5e-4f, READ = 1.5e-3f;

/* Two samples of nearly normal noise, of mean 0 and variance 1: sums of four bytes. */
static void noise_pair(sf_rng *rng, float pair[2]) {
    const float scale = 0.0067658f; /* 1 / sqrt(4 (256^2 - 1) / 12) */
    uint64_t bits = sf_rng_next(rng);
    for (int i = 0; i < 2; i++, bits >>= 32) {
        int sum = (int)((bits & 255) + (bits >> 8 & 255) + (bits >> 16 & 255) + (bits >> 24 & 255));
        pair[i] = scale * (float)(sum - 510);
    }
}

typedef struct exposing {
    const sf_exposure *exposure;
    uint8_t *data;
} exposing;

static void expose_row(void *arg, size_t row, int thread) {
    const exposing *x = arg;
    const sf_exposure *e = x->exposure;
    size_t n = 3 * (size_t)e->width;
    const float *from = e->linear + row * n;
    uint8_t *to = x->data + row * n;
    float bright = (float)(e->time * e->gain), noise = (float)e->noise, pair[2] = {0, 0};
    float shot = SHOT * (float)e->gain, read = READ * (float)e->gain * READ * (float)e->gain;
    sf_rng rng;
    sf_rng_seed(&rng, e->seed ^ (row + 1) * 0x9e3779b97f4a7c15u);
    (void)thread;
    for (size_t i = 0; i < n; i++) {
        float value = bright * from[i];
        if (noise > 0) {
            if (i % 2 == 0) noise_pair(&rng, pair);
            value += noise * sqrtf(shot * value + read) * pair[i % 2];
        }
        to[i] = noise > 0 ? from_curve(e->curve, value) : srgb8((double)value);
    }
}

void sf_sensor_expose(struct sf_pool *pool, const sf_exposure *exposure, uint8_t *data) {
    exposing x = {exposure, data};
    sf_pool_run(pool, (size_t)exposure->height, expose_row, &x);
}
