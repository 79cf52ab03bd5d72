/* optics.c - see optics.h. */
#include "optics.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { SCAN_STEPS = 4096, BISECTIONS = 60 };

static const double PI = 3.14159265358979323846;

/* Models. */

/* In the order of their numbers in COLMAP 4.2. */
static const sf_lens_model models[] = {
    {"SIMPLE_PINHOLE", "fuv", SF_PERSPECTIVE, 0},
    {"PINHOLE", "xyuv", SF_PERSPECTIVE, 0},
    {"SIMPLE_RADIAL", "fuv1", SF_PERSPECTIVE, 0},
    {"RADIAL", "fuv12", SF_PERSPECTIVE, 0},
    {"OPENCV", "xyuv12ab", SF_PERSPECTIVE, 0},
    {"OPENCV_FISHEYE", "xyuv1234", SF_EQUIDISTANT, 0},
    {"FULL_OPENCV", "xyuv12ab3567", SF_PERSPECTIVE, 0},
    {"FOV", "xyuvw", SF_FIELD_OF_VIEW, 0},
    {"SIMPLE_RADIAL_FISHEYE", "fuv1", SF_EQUIDISTANT, 0},
    {"RADIAL_FISHEYE", "fuv12", SF_EQUIDISTANT, 0},
    {"THIN_PRISM_FISHEYE", "xyuv12ab34st", SF_EQUIDISTANT, 0},
    {"RAD_TAN_THIN_PRISM_FISHEYE", NULL, SF_EQUIDISTANT, 16},
    {"SIMPLE_DIVISION", NULL, SF_PERSPECTIVE, 4},
    {"DIVISION", NULL, SF_PERSPECTIVE, 5},
    {"SIMPLE_FISHEYE", "fuv", SF_EQUIDISTANT, 0},
    {"FISHEYE", "xyuv", SF_EQUIDISTANT, 0},
    {"EUCM", NULL, SF_PERSPECTIVE, 6},
    {"EQUIRECTANGULAR", NULL, SF_PERSPECTIVE, 2},
};

enum { MODELS = sizeof models / sizeof *models };

const sf_lens_model *sf_lens_model_at(unsigned long number) {
    return number < MODELS ? &models[number] : NULL;
}

const sf_lens_model *sf_lens_model_named(const char *name) {
    for (size_t i = 0; i < MODELS; i++)
        if (!strcmp(name, models[i].name)) return &models[i];
    return NULL;
}

double *sf_optics_value(sf_optics *o, char letter) {
    switch (letter) {
    case 'x':
        return &o->fx;
    case 'y':
        return &o->fy;
    case 'u':
        return &o->cx;
    case 'v':
        return &o->cy;
    case 'a':
    case 'b':
        return &o->p[letter - 'a'];
    case 's':
    case 't':
        return &o->s[letter - 's'];
    case 'w':
        return &o->omega;
    default:
        if (letter >= '1' && letter <= '4') return &o->k[letter - '1'];
        return letter >= '5' && letter <= '7' ? &o->q[letter - '5'] : NULL;
    }
}

sf_optics sf_optics_make(const sf_lens_model *model, const double *parameters) {
    sf_optics o = {.model = model->name, .projection = model->projection};
    for (size_t i = 0; model->layout && model->layout[i]; i++) {
        double *value = sf_optics_value(&o, model->layout[i]);
        if (value)
            *value = parameters[i];
        else
            o.fx = o.fy = parameters[i];
    }
    return o;
}

sf_optics sf_optics_of(const sf_lens *l) {
    return (sf_optics){.model = "OPENCV",
                       .fx = l->fx,
                       .fy = l->fy,
                       .cx = l->cx,
                       .cy = l->cy,
                       .k = {l->k1, l->k2, l->k3},
                       .p = {l->p1, l->p2}};
}

int sf_optics_to_lens(const sf_optics *o, sf_lens *lens) {
    *lens = (sf_lens){o->fx, o->fy, o->cx, o->cy, o->k[0], o->k[1], o->p[0], o->p[1], o->k[2]};
    return o->projection == SF_PERSPECTIVE && o->k[3] == 0 && o->q[0] == 0 && o->q[1] == 0 && o->q[2] == 0 &&
           o->s[0] == 0 && o->s[1] == 0;
}

int sf_optics_is_distorted(const sf_optics *o) {
    sf_lens lens;
    if (!sf_optics_to_lens(o, &lens)) return 1;
    return lens.k1 != 0 || lens.k2 != 0 || lens.p1 != 0 || lens.p2 != 0 || lens.k3 != 0;
}

int sf_optics_is_valid(const sf_optics *optics) {
    static const char letters[] = "xyuv1234567abstw";
    sf_optics o = *optics;
    for (const char *c = letters; *c; c++)
        if (!isfinite(*sf_optics_value(&o, *c))) return 0;
    return o.fx > 0 && o.fy > 0 && o.omega >= 0 && o.omega < PI;
}

int sf_lens_is_distorted(const sf_lens *lens) {
    sf_optics o = sf_optics_of(lens);
    return sf_optics_is_distorted(&o);
}

int sf_lens_is_valid(const sf_lens *lens) {
    sf_optics o = sf_optics_of(lens);
    return sf_optics_is_valid(&o);
}

/* The equation. */

static double above(const sf_optics *o, double r2) {
    return 1 + r2 * (o->k[0] + r2 * (o->k[1] + r2 * (o->k[2] + r2 * o->k[3])));
}

static double below(const sf_optics *o, double r2) {
    return 1 + r2 * (o->q[0] + r2 * (o->q[1] + r2 * o->q[2]));
}

/* By what the projection multiplies the distance of a ray, r = tan(angle). */
static double projected(const sf_optics *o, double r) {
    if (o->projection == SF_EQUIDISTANT) return r > 0 ? atan(r) / r : 1;
    if (o->projection == SF_PERSPECTIVE || o->omega == 0) return 1;
    double wide = 2 * tan(o->omega / 2);
    return r > 0 ? atan(r * wide) / (r * o->omega) : wide / o->omega;
}

static void distort(const sf_optics *o, double x, double y, double out[2]) {
    double r2 = x * x + y * y;
    if (o->projection != SF_PERSPECTIVE) {
        double factor = projected(o, sqrt(r2));
        x *= factor;
        y *= factor;
        r2 = x * x + y * y;
    }
    double d = above(o, r2) / below(o, r2);
    out[0] = x * d + 2 * o->p[0] * x * y + o->p[1] * (r2 + 2 * x * x) + o->s[0] * r2;
    out[1] = y * d + 2 * o->p[1] * x * y + o->p[0] * (r2 + 2 * y * y) + o->s[1] * r2;
}

int sf_optics_source(const sf_optics *o, double limit, double u, double v, double source[2]) {
    double x = (u - o->cx) / o->fx, y = (v - o->cy) / o->fy, out[2];
    if (!(x * x + y * y < limit)) return 0;
    distort(o, x, y, out);
    source[0] = o->fx * out[0] + o->cx - 0.5;
    source[1] = o->fy * out[1] + o->cy - 0.5;
    return 1;
}

/* How far it holds. */

/* Without k3: the least positive root of the derivative of r d(r), 1 + 3 k1 r2 + 5 k2 r2^2. */
static double limit_of_two(const sf_optics *o) {
    double a = 5 * o->k[1], b = 3 * o->k[0], inside = b * b - 4 * a;
    if (a == 0) return b < 0 ? -1 / b : INFINITY;
    if (inside < 0) return INFINITY;
    /* t has the sign of -b: no cancellation. The roots are t/a and 1/t; their product is 1/a. */
    double t = b < 0 ? (-b + sqrt(inside)) / 2 : (-b - sqrt(inside)) / 2;
    double first = t / a, second = 1 / t, least = INFINITY;
    if (first > 0) least = first;
    if (second > 0 && second < least) least = second;
    return least;
}

/* The distance that the projection gives to an angle: what the polynomials are of. */
static double radius_at(const sf_optics *o, double angle) {
    if (o->projection == SF_EQUIDISTANT) return angle;
    double r = tan(angle);
    return r * projected(o, r);
}

/* Whether r d(r) grows: by the sign of its derivative, and before the first pole. */
static int grows(const sf_optics *o, double r) {
    const double *k = o->k, *q = o->q;
    double r2 = r * r, n = above(o, r2), m = below(o, r2);
    double dn = k[0] + r2 * (2 * k[1] + r2 * (3 * k[2] + r2 * 4 * k[3]));
    double dm = q[0] + r2 * (2 * q[1] + r2 * 3 * q[2]);
    return m > 0 && (n + 2 * r2 * dn) * m - 2 * r2 * n * dm > 0;
}

static double widest(const sf_optics *o) { return o->projection == SF_EQUIDISTANT ? PI : PI / 2; }

/* The angle up to which the picture grows, at most `most`. */
static double growth_end(const sf_optics *o, double most) {
    double inside = 0, outside = most;
    for (int i = 1; i < SCAN_STEPS; i++) {
        double angle = most * i / SCAN_STEPS;
        if (!grows(o, radius_at(o, angle))) {
            outside = angle;
            break;
        }
        inside = angle;
    }
    if (outside == most) return most;
    for (int i = 0; i < BISECTIONS; i++) {
        double middle = (inside + outside) / 2;
        if (grows(o, radius_at(o, middle)))
            inside = middle;
        else
            outside = middle;
    }
    return inside;
}

double sf_optics_limit(const sf_optics *o) {
    sf_lens lens;
    if (sf_optics_to_lens(o, &lens) && lens.k3 == 0) return limit_of_two(o);
    double end = growth_end(o, PI / 2), r = tan(end);
    return end < PI / 2 ? r * r : INFINITY;
}

double sf_optics_angle(const sf_optics *o, double r) {
    double least = 0, most = growth_end(o, widest(o));
    for (int i = 0; i < BISECTIONS; i++) {
        double middle = (least + most) / 2, at = radius_at(o, middle);
        if (at * above(o, at * at) / below(o, at * at) < r)
            least = middle;
        else
            most = middle;
    }
    return most;
}
