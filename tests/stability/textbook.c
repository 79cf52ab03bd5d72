/* textbook.c - the usual forms in float32. */
#include "textbook.h"

#include "../testing.h"

/* One Gaussian on the screen; the conic's gradient as the pixels add it up. */
typedef struct single {
    float a, b, c, det, w[3];
    double opacity, color[3], mean[2];
    test_ref_splat_grads d;
} single;

static void invert(single *s, const test_ref_splat *splat) {
    s->a = (float)splat->cov2d[0], s->b = (float)splat->cov2d[1], s->c = (float)splat->cov2d[2];
    s->det = s->a * s->c - s->b * s->b; /* F.5.3 */
    s->w[0] = s->c / s->det, s->w[1] = -s->b / s->det, s->w[2] = s->a / s->det;
}

/* One pixel there and back; returns what it lets through. */
static double visit(single *s, double x, double y, const float *d_rgb) {
    float d0 = (float)(s->mean[0] - x), d1 = (float)(s->mean[1] - y), *w = s->w;
    float power = -0.5f * (w[0] * d0 * d0 + w[2] * d1 * d1) - w[1] * d0 * d1;
    double g = (double)expf(power), alpha = fmin(0.99, s->opacity * g), d_alpha = 0;
    if (alpha < 1.0 / 255) return 1;
    for (int k = 0; k < 3; k++) {
        s->d.rgb[k] += alpha * (double)d_rgb[k];
        d_alpha += (double)d_rgb[k] * s->color[k];
    }
    double p = d_alpha * alpha;
    s->d.opacity += d_alpha * g;
    s->d.mean2d[0] -= p * (double)(w[0] * d0 + w[1] * d1);
    s->d.mean2d[1] -= p * (double)(w[1] * d0 + w[2] * d1);
    s->d.conic[0] -= p * (double)(d0 * d0) / 2;
    s->d.conic[1] -= p * (double)(d0 * d1);
    s->d.conic[2] -= p * (double)(d1 * d1) / 2;
    return 1 - alpha;
}

/* From the conic's gradient to the covariance's by B.5.3, then to that gradient of the conic which float64
 * takes to the same one. */
static void through_covariance(single *s, const test_ref_splat *splat) {
    float a = s->a, b = s->b, c = s->c, det = s->det, by = 1 / (det * det);
    float x = (float)s->d.conic[0], y = (float)(s->d.conic[1] / 2), z = (float)s->d.conic[2];
    double d_a = (double)(by * (-c * c * x + 2 * b * c * y + (det - a * c) * z));
    double d_c = (double)(by * (-a * a * z + 2 * a * b * y + (det - a * c) * x));
    double d_b = (double)(by * (b * c * x - (det + 2 * b * b) * y + a * b * z)); /* of one of the two */
    const double *m = splat->cov2d;
    double m0 = m[0], m1 = m[1], m2 = m[2];
    s->d.conic[0] = -(m0 * m0 * d_a + 2 * m0 * m1 * d_b + m1 * m1 * d_c);
    s->d.conic[1] = -2 * (m0 * m1 * d_a + (m0 * m2 + m1 * m1) * d_b + m1 * m2 * d_c);
    s->d.conic[2] = -(m1 * m1 * d_a + 2 * m1 * m2 * d_b + m2 * m2 * d_c);
}

void stab_textbook_single(const test_ref_scene *scene, const float *d_rgb, double *transmittance,
                          test_ref_gaussians *gradient) {
    test_ref_splat splat;
    size_t width = (size_t)scene->camera.width, pixels = width * (size_t)scene->camera.height;
    assert_int_equal(scene->count, 1);
    test_ref_project(scene, 0, &splat);
    single s = {.opacity = splat.opacity, .mean = {splat.mean2d[0], splat.mean2d[1]}};
    for (int k = 0; k < 3; k++) s.color[k] = splat.rgb[k];
    invert(&s, &splat);
    for (size_t i = 0; i < pixels; i++)
        transmittance[i] = visit(&s, (double)(i % width) + 0.5, (double)(i / width) + 0.5, d_rgb + 3 * i);
    through_covariance(&s, &splat);
    test_ref_grads grads = {.gaussians = *gradient};
    test_ref_project_backward(scene, 0, &s.d, &grads);
}

size_t stab_textbook_layers(size_t count, const float *opacity, const float *color, float *d_opacity) {
    float T = 1, behind = 0;
    size_t used = 0;
    for (size_t i = 0; i < count; i++) d_opacity[i] = 0;
    for (; used < count; used++) {
        float next = T * (1 - fminf(0.99f, opacity[used]));
        if (next < 1e-4f) break;
        T = next;
    }
    float last_alpha = 0, last_color = 0;
    for (size_t i = used; i-- > 0;) {
        float alpha = fminf(0.99f, opacity[i]);
        T = T / (1 - alpha);
        behind = last_alpha * last_color + (1 - last_alpha) * behind;
        d_opacity[i] = (color[i] - behind) * T;
        last_alpha = alpha, last_color = color[i];
    }
    return used;
}

void stab_textbook_normalise(const double q[4], double unit[4]) {
    float squares = 0;
    for (int k = 0; k < 4; k++) squares += (float)q[k] * (float)q[k];
    for (int k = 0; k < 4; k++) unit[k] = (double)((float)q[k] / sqrtf(squares));
}
