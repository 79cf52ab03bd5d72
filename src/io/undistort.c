/* undistort.c - see undistort.h. */
#include "undistort.h"

#include <math.h>

static const double PI = 3.14159265358979323846;

/* The frame. */

/* Pixels by which a side of the frame lies beyond that of the picture, which is `extent` px from the axis. */
static int margin(const sf_optics *o, double extent, double focal) {
    double angle = fmin(sf_optics_angle(o, fmax(extent, 0) / focal), PI / 3);
    return (int)lround(focal * tan(angle) - fmax(extent, 0));
}

/* Extreme lenses, which no camera has, keep the picture's size: theirs would be much larger. */
sf_undistorted sf_undistort_frame(const sf_optics *o, int width, int height) {
    sf_undistorted same = {width, height, o->cx, o->cy}, f;
    double most = fmax(fmax(o->fx, o->fy), fmax(fabs(o->cx), fabs(o->cy)));
    if (o->projection == SF_PERSPECTIVE || !sf_optics_is_valid(o) || most > SF_PICTURE_MAX_PIXELS)
        return same;
    int left = margin(o, o->cx, o->fx), top = margin(o, o->cy, o->fy);
    int right = margin(o, width - o->cx, o->fx), bottom = margin(o, height - o->cy, o->fy);
    f = (sf_undistorted){width + left + right, height + top + bottom, o->cx + left, o->cy + top};
    if (f.width < 1 || f.height < 1 || f.width > 2 * width || f.height > 2 * height ||
        f.width > SF_PICTURE_MAX_SIDE || f.height > SF_PICTURE_MAX_SIDE ||
        (int64_t)f.width * f.height > SF_PICTURE_MAX_PIXELS)
        return same;
    return f;
}

static double degrees(double radians) { return radians * 180 / PI; }

void sf_undistort_field(const sf_optics *o, int width, int height, double *seen, double *kept) {
    sf_undistorted f = sf_undistort_frame(o, width, height);
    *seen = degrees(sf_optics_angle(o, o->cx / o->fx) + sf_optics_angle(o, (width - o->cx) / o->fx));
    *kept = fmin(*seen, degrees(atan(f.cx / o->fx) + atan((f.width - f.cx) / o->fx)));
}

/* Where a pixel of the new picture comes from: four taps and their weights. */
typedef struct taps {
    size_t at[4];
    double part[4];
} taps;

static int find_taps(const sf_picture *p, const double source[2], taps *t) {
    if (!(source[0] >= 0 && source[1] >= 0 && source[0] <= p->width - 1 && source[1] <= p->height - 1))
        return 0;
    size_t left = (size_t)source[0], top = (size_t)source[1], width = (size_t)p->width;
    size_t right = left + 1 < width ? left + 1 : left, bottom = top + 1 < (size_t)p->height ? top + 1 : top;
    double h = source[0] - (double)left, v = source[1] - (double)top;
    *t = (taps){{top * width + left, top * width + right, bottom * width + left, bottom * width + right},
                {(1 - h) * (1 - v), h * (1 - v), (1 - h) * v, h * v}};
    return 1;
}

/* Colours are averaged by their weights: what a mask hides must not seep into what it shows. */
static void resample(const sf_picture *from, taps *t, const sf_picture *to, size_t at) {
    size_t plane = (size_t)from->width * (size_t)from->height;
    size_t to_plane = (size_t)to->width * (size_t)to->height;
    double total = 1;
    if (from->weight) {
        double sum = 0;
        for (int i = 0; i < 4; i++) sum += t->part[i] * from->weight[t->at[i]];
        to->weight[at] = (uint8_t)(sum + 0.5);
        if (sum > 0) {
            for (int i = 0; i < 4; i++) t->part[i] *= from->weight[t->at[i]];
            total = sum;
        }
    } else {
        to->weight[at] = 255;
    }
    for (size_t c = 0; c < 3; c++) {
        const uint8_t *source = from->rgb + c * plane;
        double sum = 0;
        for (int i = 0; i < 4; i++) sum += t->part[i] * source[t->at[i]];
        to->rgb[c * to_plane + at] = (uint8_t)(sum / total + 0.5);
    }
}

static void resample_all(const sf_optics *optics, const sf_undistorted *frame, const sf_picture *from,
                         const sf_picture *to) {
    size_t width = (size_t)to->width, plane = width * (size_t)to->height;
    double limit = sf_optics_limit(optics), x = optics->cx - frame->cx, y = optics->cy - frame->cy;
    for (size_t at = 0; at < plane; at++) {
        double source[2], u = (double)(at % width) + 0.5 + x, v = (double)(at / width) + 0.5 + y;
        taps t;
        if (sf_optics_source(optics, limit, u, v, source) && find_taps(from, source, &t)) {
            resample(from, &t, to, at);
        } else {
            to->weight[at] = 0;
            for (size_t c = 0; c < 3; c++) to->rgb[c * plane + at] = 0;
        }
    }
}

sf_status sf_undistort(sf_context *ctx, const sf_optics *optics, sf_picture *picture) {
    sf_undistorted frame = sf_undistort_frame(optics, picture->width, picture->height);
    size_t plane = (size_t)frame.width * (size_t)frame.height;
    sf_picture to = *picture;
    to.width = frame.width;
    to.height = frame.height;
    to.rgb = sf_alloc(ctx, plane, 3);
    to.weight = sf_alloc(ctx, plane, 1);
    if (!to.rgb || !to.weight) {
        sf_picture_free(ctx, &to);
        return SF_ERR_MEMORY;
    }
    resample_all(optics, &frame, picture, &to);
    sf_picture_free(ctx, picture);
    *picture = to;
    return SF_OK;
}
