/* convert.c - a row of a camera's picture as floats, in plain C. */
#include "scalar.h"

#include <splatfit/source.h>

/* Where the samples of a row lie: those of pixel i at y[i y_step], and at u and v [(i >> shift) c_step]. */
typedef struct samples {
    const uint8_t *y, *u, *v;
    int y_step, c_step, shift;
} samples;

static samples samples_of(const sf_convert_args *a) {
    const uint8_t *const *p = a->plane;
    switch (a->format) {
    case SF_PIXEL_YUYV:
        return (samples){p[0], p[0] + 1, p[0] + 3, 2, 4, 1};
    case SF_PIXEL_UYVY:
        return (samples){p[0] + 1, p[0], p[0] + 2, 2, 4, 1};
    case SF_PIXEL_NV12:
        return (samples){p[0], p[1], p[1] + 1, 1, 2, 1};
    case SF_PIXEL_444P:
        return (samples){p[0], p[1], p[2], 1, 1, 0};
    default: /* YU12, 422P */
        return (samples){p[0], p[1], p[2], 1, 1, 1};
    }
}

static float clamped(float x) {
    x = x > 0 ? x : 0;
    return x < 1 ? x : 1;
}

static float luma(const sf_yuv *m, uint8_t y) { return ((float)y - m->y_zero) * m->y_scale; }

static void convert_yuv(const sf_convert_args *a) {
    const sf_yuv *m = a->yuv;
    samples s = samples_of(a);
    for (int i = 0; i < a->width; i++) {
        int c = (i >> s.shift) * s.c_step;
        float y = luma(m, s.y[i * s.y_step]), u = (float)s.u[c] - 128, v = (float)s.v[c] - 128;
        a->rgb[0][i] = clamped(y + m->r_v * v);
        a->rgb[1][i] = clamped(y - (m->g_u * u + m->g_v * v));
        a->rgb[2][i] = clamped(y + m->b_u * u);
    }
}

static void convert_grey(const sf_convert_args *a) {
    for (int i = 0; i < a->width; i++)
        a->rgb[0][i] = a->rgb[1][i] = a->rgb[2][i] = clamped(luma(a->yuv, a->plane[0][i]));
}

/* 255 times the float nearest to 1/255 is 1. */
static void convert_bytes(const sf_convert_args *a, int red, int blue) {
    for (int i = 0; i < a->width; i++) {
        const uint8_t *pixel = a->plane[0] + 3 * i;
        a->rgb[0][i] = (float)pixel[red] * (1 / 255.0f);
        a->rgb[1][i] = (float)pixel[1] * (1 / 255.0f);
        a->rgb[2][i] = (float)pixel[blue] * (1 / 255.0f);
    }
}

void sf_convert_scalar(const sf_convert_args *args) {
    switch (args->format) {
    case SF_PIXEL_RGB24:
        convert_bytes(args, 0, 2);
        break;
    case SF_PIXEL_BGR24:
        convert_bytes(args, 2, 0);
        break;
    case SF_PIXEL_GREY:
        convert_grey(args);
        break;
    default:
        convert_yuv(args);
    }
}
