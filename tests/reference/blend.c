/* blend.c - the Gaussians over every pixel, front to back, and the gradients of that (M.1, M.2). */
#include "../testing.h"
#include "reference.h"

#include <math.h>
#include <stdlib.h>

static const double MOST_ALPHA = 0.99, LEAST_ALPHA = 1.0 / 255, LEAST_TRANSMITTANCE = 1e-4;

/* One Gaussian's share of one pixel. */
typedef struct contribution {
    uint32_t gaussian;
    double d0, d1;        /* u - x */
    double g;             /* exp(power) */
    double alpha;         /* alpha' */
    double transmittance; /* before it */
    int saturated;
} contribution;

/* M.1, "Exponent". */
static double factored_power(const test_ref_splat *s, double d0, double d1) {
    double b = s->cov2d[1], c = s->cov2d[2];
    double t = (c * d0 - b * d1) / sqrt(c * s->det);
    return -0.5 * (t * t + d1 * d1 / c);
}

static float dot3f(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The same in float32, with the determinant of M.1. */
static float factored_powerf(const float A[6], float d0, float d1) {
    const float eps = 0.3f, *a0 = A, *a1 = A + 3;
    float n[3] = {a0[1] * a1[2] - a0[2] * a1[1], a0[2] * a1[0] - a0[0] * a1[2],
                  a0[0] * a1[1] - a0[1] * a1[0]};
    float det = dot3f(n, n) + eps * (dot3f(a0, a0) + dot3f(a1, a1)) + eps * eps;
    float b = dot3f(a0, a1), c = dot3f(a1, a1) + eps;
    float t = sqrtf(c / det) * d0 - b / sqrtf(c * det) * d1;
    return -0.5f * (t * t + d1 * d1 / c);
}

/* F.5.3: ac - b^2 cancels where the Gaussian is thin, and so does the quadratic form. */
static float textbook_powerf(const float A[6], float d0, float d1) {
    const float eps = 0.3f, *a0 = A, *a1 = A + 3;
    float a = dot3f(a0, a0) + eps, b = dot3f(a0, a1), c = dot3f(a1, a1) + eps;
    float det = a * c - b * b;
    float w0 = c / det, w1 = -b / det, w2 = a / det;
    return -0.5f * (w0 * d0 * d0 + w2 * d1 * d1) - w1 * d0 * d1;
}

static double power(test_ref_form form, const test_ref_splat *s, double d0, double d1) {
    if (form == TEST_REF_FLOAT64) return factored_power(s, d0, d1);
    float A[6];
    for (int k = 0; k < 6; k++) A[k] = (float)s->factor[k];
    return form == TEST_REF_FLOAT32 ? factored_powerf(A, (float)d0, (float)d1)
                                    : textbook_powerf(A, (float)d0, (float)d1);
}

/* A pixel on its way through the Gaussians. */
typedef struct pixel {
    contribution *list; /* room for all visible Gaussians */
    size_t count;
    double transmittance; /* after the last */
    int stopped;          /* one was refused */
} pixel;

/* Collects the contributions to the pixel whose centre is (x, y), in order. */
static void walk(const test_ref_scene *scene, const test_ref_frame *frame, double x, double y, pixel *p) {
    p->count = 0;
    p->transmittance = 1;
    p->stopped = 0;
    for (size_t k = 0; k < frame->visible && !p->stopped; k++) {
        const test_ref_splat *s = &frame->splats[frame->order[k]];
        contribution c = {.gaussian = frame->order[k], .d0 = s->mean2d[0] - x, .d1 = s->mean2d[1] - y};
        c.g = exp(power(scene->form, s, c.d0, c.d1));
        c.saturated = s->opacity * c.g > MOST_ALPHA;
        c.alpha = fmin(MOST_ALPHA, s->opacity * c.g);
        c.transmittance = p->transmittance;
        if (c.alpha < LEAST_ALPHA) continue;
        p->stopped = p->transmittance * (1 - c.alpha) < LEAST_TRANSMITTANCE;
        if (p->stopped) continue;
        p->transmittance *= 1 - c.alpha;
        p->list[p->count++] = c;
    }
}

static contribution *room_for_all(const test_ref_frame *frame) {
    contribution *list = calloc(frame->visible + 1, sizeof *list);
    assert_non_null(list);
    return list;
}

/* Which Gaussians the pixel holds, which of them are saturated, and whether more would have come. */
static void record(const pixel *p, test_ref_frame *frame) {
    for (size_t n = 0; n < p->count; n++) {
        const contribution *c = &p->list[n];
        const test_ref_splat *s = &frame->splats[c->gaussian];
        frame->branches =
            test_ref_branch(frame->branches, 2 * (uint64_t)c->gaussian + (uint64_t)c->saturated);
        frame->counts.pairs++;
        frame->counts.saturated += (uint64_t)c->saturated;
        frame->counts.wide += s->jacobian_clamped != 0;
        frame->counts.floored += s->compensation_floored != 0;
    }
    frame->branches = test_ref_branch(frame->branches, UINT64_MAX - (uint64_t)p->stopped);
    frame->counts.stopped_pixels += (uint64_t)p->stopped;
}

void test_ref_blend(const test_ref_scene *scene, test_ref_frame *frame) {
    pixel p = {.list = room_for_all(frame)};
    size_t width = (size_t)scene->camera.width, height = (size_t)scene->camera.height;
    for (size_t at = 0; at < width * height; at++) {
        walk(scene, frame, (double)(at % width) + 0.5, (double)(at / width) + 0.5, &p);
        record(&p, frame);
        double *rgb = frame->rgb + 3 * at;
        for (size_t n = 0; n < p.count; n++) {
            const test_ref_splat *s = &frame->splats[p.list[n].gaussian];
            double w = p.list[n].alpha * p.list[n].transmittance;
            for (int k = 0; k < 3; k++) rgb[k] += w * s->rgb[k];
            frame->depth[at] += w * s->camera_point[2];
        }
        for (int k = 0; k < 3; k++) rgb[k] += p.transmittance * scene->background[k];
        frame->transmittance[at] = p.transmittance;
    }
    free(p.list);
}

/* M.2 for one pair. `behind` is C - S_i: the colour that comes from behind it. */
static void pair_backward(const contribution *c, const test_ref_splat *s, const double behind[3],
                          const double d_rgb[3], test_ref_splat_grads *d) {
    double d_alpha = 0;
    for (int k = 0; k < 3; k++) {
        d->rgb[k] += d_rgb[k] * c->alpha * c->transmittance;                               /* B.5b */
        d_alpha += d_rgb[k] * (c->transmittance * s->rgb[k] - behind[k] / (1 - c->alpha)); /* B.5a */
    }
    if (c->saturated) return;
    double p = d_alpha * c->alpha;
    d->opacity += d_alpha * c->g;
    d->mean2d[0] -= p * (s->conic[0] * c->d0 + s->conic[1] * c->d1); /* B.5.2b */
    d->mean2d[1] -= p * (s->conic[1] * c->d0 + s->conic[2] * c->d1);
    d->conic[0] -= p * c->d0 * c->d0 / 2; /* B.5.2c */
    d->conic[1] -= p * c->d0 * c->d1;
    d->conic[2] -= p * c->d1 * c->d1 / 2;
}

void test_ref_blend_backward(const test_ref_scene *scene, const test_ref_frame *frame, const double *d_rgb,
                             test_ref_splat_grads *d_splats, double d_background[3]) {
    pixel p = {.list = room_for_all(frame)};
    size_t width = (size_t)scene->camera.width, height = (size_t)scene->camera.height;
    for (size_t at = 0; at < width * height; at++) {
        walk(scene, frame, (double)(at % width) + 0.5, (double)(at / width) + 0.5, &p);
        double behind[3];
        for (size_t k = 0; k < 3; k++) {
            behind[k] = frame->rgb[3 * at + k];
            d_background[k] += p.transmittance * d_rgb[3 * at + k];
        }
        for (size_t n = 0; n < p.count; n++) {
            const contribution *c = &p.list[n];
            const test_ref_splat *s = &frame->splats[c->gaussian];
            for (int k = 0; k < 3; k++) behind[k] -= c->alpha * c->transmittance * s->rgb[k];
            pair_backward(c, s, behind, d_rgb + 3 * at, &d_splats[c->gaussian]);
        }
    }
    free(p.list);
}
