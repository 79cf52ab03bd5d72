/* orbit.c - cameras on a circle around a model, or that look around from its middle. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model_transform.h"
#include "camera_path.h"

/* Defaults if no camera of the model is known. */
#define RADII     2.0  /* of the model's, from its middle */
#define ELEVATION 20.0 /* degrees */
/* A model that leaves its plane by more says nothing about up. */
#define FLAT 0.6

typedef struct orbit {
    double center[3], up[3], ahead[3], side[3]; /* unit vectors; ahead: to the first camera */
    double distance, elevation;                 /* world units, radians; distance 0: they look outward */
} orbit;

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static int normalize(double v[3]) {
    double length = sqrt(dot(v, v));
    if (!(length > 1e-9)) return 0;
    for (int k = 0; k < 3; k++) v[k] /= length;
    return 1;
}

static void cross(const double a[3], const double b[3], double c[3]) {
    for (int k = 0; k < 3; k++) c[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

void camera_path_look_at(const double from[3], const double at[3], const double up[3], sf_camera *c) {
    double right[3], down[3], ahead[3];
    for (int k = 0; k < 3; k++) ahead[k] = at[k] - from[k];
    if (!normalize(ahead)) ahead[0] = ahead[1] = 0, ahead[2] = 1;
    cross(ahead, up, right);
    if (!normalize(right)) { /* straight down */
        const double other[3] = {fabs(up[0]) < 0.5, fabs(up[0]) >= 0.5, 0};
        cross(ahead, other, right);
        normalize(right);
    }
    cross(ahead, right, down);
    for (int k = 0; k < 3; k++) {
        c->R_cw[k] = right[k];
        c->R_cw[3 + k] = down[k];
        c->R_cw[6 + k] = ahead[k];
    }
    c->t_cw[0] = -dot(right, from);
    c->t_cw[1] = -dot(down, from);
    c->t_cw[2] = -dot(ahead, from);
}

/* --up, else the mean of what was up in the cameras' pictures, else the normal of the model's plane. */
static int find_up(const args *a, const sf_model_bounds *b, const sf_camera *known, size_t count,
                   double up[3]) {
    const char *text = args_value(a, "up");
    if (text) return model_transform_up(a, text, up);
    up[0] = up[1] = up[2] = 0;
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) up[k] -= known[i].R_cw[3 + k];
    if (count && normalize(up)) return 0;
    const double usual[3] = {0, -1, 0};
    memcpy(up, b->flatness < FLAT ? b->normal : usual, sizeof usual);
    return 0;
}

/* Medians over the cameras of how far and how high above the middle they stood. */
static int as_known(const args *a, const sf_camera *known, size_t count, orbit *o) {
    double *values = malloc(2 * count * sizeof *values);
    if (!values) return app_say(a, "orbit", "out of memory");
    for (size_t i = 0; i < count; i++) {
        double at[3];
        sf_camera_center(&known[i], at);
        for (int k = 0; k < 3; k++) at[k] -= o->center[k];
        values[i] = sqrt(dot(at, at));
        values[count + i] = values[i] > 0 ? asin(fmax(-1, fmin(dot(at, o->up) / values[i], 1))) : 0;
    }
    double distance = app_median(values, count);
    if (distance > 0) o->distance = distance;
    o->elevation = app_median(values + count, count);
    free(values);
    return 0;
}

/* The first camera stands where the first known one does, as seen from above; else on the side of -z, from
 * where a model is looked at in these axes. */
static void find_start(const sf_camera *known, size_t count, orbit *o) {
    double at[3] = {0, 0, -1};
    if (count) {
        sf_camera_center(known, at);
        for (int k = 0; k < 3; k++) at[k] -= o->center[k];
    }
    for (int turn = 0;; turn++) {
        double high = dot(at, o->up);
        for (int k = 0; k < 3; k++) o->ahead[k] = at[k] - high * o->up[k];
        if (normalize(o->ahead)) break;
        for (int k = 0; k < 3; k++) at[k] = k == turn;
    }
    cross(o->up, o->ahead, o->side);
}

static int read_orbit(const args *a, sf_context *ctx, const sf_model *model, const sf_camera *known,
                      size_t count, orbit *o, double *radius) {
    sf_model_bounds b;
    const double *const axes[3] = {o->up, o->ahead, o->side};
    const double degree = 0.017453292519943295;
    if (sf_model_get_bounds(model, &b)) return app_fail(a, ctx);
    memcpy(o->center, b.center, sizeof o->center);
    *radius = b.radius;
    o->distance = RADII * b.radius;
    o->elevation = ELEVATION * degree;
    int error = find_up(a, &b, known, count, o->up), around = 0;
    if (!error) find_start(known, count, o);
    if (!error && count) error = as_known(a, known, count, o);
    if (!error && !count) error = camera_path_find_center(a, ctx, model, axes, o->center, &around);
    if (around) o->distance = o->elevation = 0;
    double degrees = o->elevation / degree;
    if (!error) error = args_numbers(a, "elevation", 1, &degrees);
    if (!error) error = args_numbers(a, "distance", 1, &o->distance);
    if (!error && (!(o->distance >= 0) || !(fabs(degrees) <= 90))) {
        app_say(a, o->distance >= 0 ? "--elevation" : "--distance",
                o->distance >= 0 ? "is not in -90..90 degrees" : "is below 0");
        error = EXIT_USAGE;
    }
    if (!args_value(a, "elevation") && (around || !(o->distance > 0)))
        degrees = o->distance > 0 ? ELEVATION : 0;
    o->elevation = degrees * degree;
    return error;
}

int camera_path_orbit(const args *a, sf_context *ctx, const sf_model *model, const sf_camera *known,
                      size_t known_count, camera_path *s) {
    orbit o;
    double radius = 1;
    int error = read_orbit(a, ctx, model, known, known_count, &o, &radius);
    if (error) return error;
    s->near_plane = radius / 100;
    for (size_t i = 0; i < s->count; i++) {
        double angle = 6.283185307179586 * (double)i / (double)s->count, from[3];
        double flat = cos(o.elevation), high = sin(o.elevation), out[3];
        for (int k = 0; k < 3; k++) {
            out[k] = high * o.up[k] + flat * (cos(angle) * o.ahead[k] + sin(angle) * o.side[k]);
            from[k] = o.center[k] + o.distance * out[k];
            out[k] += o.center[k];
        }
        camera_path_look_at(from, o.distance > 0 ? o.center : out, o.up, &s->cameras[i]);
    }
    return 0;
}
