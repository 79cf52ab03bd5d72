/* optics.h - lenses of all kinds: where a ray is seen, and how far that can be told.
 */
#ifndef SF_IO_OPTICS_H
#define SF_IO_OPTICS_H

#include <splatfit/camera.h>

typedef enum sf_projection {
    SF_PERSPECTIVE,   /* r = tan(angle) */
    SF_EQUIDISTANT,   /* r = angle */
    SF_FIELD_OF_VIEW, /* r = atan(2 tan(angle) tan(omega/2)) / omega */
} sf_projection;

/* A ray (x, y, 1) is brought to the distance r from the axis that the projection gives it. There, with
 * r2 = x^2 + y^2 and d = (1 + k1 r2 + k2 r2^2 + k3 r2^3 + k4 r2^4) / (1 + q1 r2 + q2 r2^2 + q3 r2^3),
 * it is seen at pixel (fx x' + cx, fy y' + cy), where
 *     x' = x d + 2 p1 x y + p2 (r2 + 2 x^2) + s1 r2        y' = y d + 2 p2 x y + p1 (r2 + 2 y^2) + s2 r2. */
typedef struct sf_optics {
    const char *model; /* its name, static */
    sf_projection projection;
    double fx, fy, cx, cy; /* px */
    double k[4], q[3], p[2], s[2];
    double omega; /* radians */
} sf_optics;

/* COLMAP's camera models. A letter of `layout` is a parameter: f = fx = fy, x y = fx fy, u v = cx cy, 1 2 3 4
 * = k, 5 6 7 = q, a b = p, s t = s, w = omega; NULL: known by name, not supported. */
typedef struct sf_lens_model {
    const char *name, *layout;
    sf_projection projection;
    int unread; /* parameters of a model without a layout */
} sf_lens_model;

/* By COLMAP's number, by name; NULL: not known. */
const sf_lens_model *sf_lens_model_at(unsigned long number);
const sf_lens_model *sf_lens_model_named(const char *name);

/* Parameters in the order of the layout. */
enum { SF_OPTICS_PARAMETERS = 12 };
sf_optics sf_optics_make(const sf_lens_model *model, const double *parameters);
/* What a letter of a layout stands for; NULL for f, which is two. */
double *sf_optics_value(sf_optics *optics, char letter);

sf_optics sf_optics_of(const sf_lens *lens);
/* 0: it is more than an sf_lens can say. */
int sf_optics_to_lens(const sf_optics *optics, sf_lens *lens);

int sf_optics_is_distorted(const sf_optics *optics);
/* All values finite, focal lengths > 0, omega in [0, pi). */
int sf_optics_is_valid(const sf_optics *optics);

/* x^2 + y^2 of a ray (x, y, 1) up to which the picture still grows with it: beyond, it would show the inside
 * once more. */
double sf_optics_limit(const sf_optics *optics);

/* Where the lens shows what a pinhole camera of its fx, fy, cx, cy shows at (u, v), px; of the source whole
 * numbers are the centres of pixels. 0, and no source, from the limit on. */
int sf_optics_source(const sf_optics *optics, double limit, double u, double v, double source[2]);

/* The angle from the axis, in radians, of what is seen at the distance r, in focal lengths; of a lens that
 * turns back before, where it does. Tangential and prism terms do not count. At most pi. */
double sf_optics_angle(const sf_optics *optics, double r);

int sf_lens_is_distorted(const sf_lens *lens);
/* All values finite, focal lengths > 0. */
int sf_lens_is_valid(const sf_lens *lens);

#endif
