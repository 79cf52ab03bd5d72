/* origin.c - see origin.h. */
#include "origin.h"

#include <math.h>

#include "../base/linear.h"
#include "../base/statistics.h"
#include "../scene/scene.h"

/* Points that medians are taken of, evenly chosen. */
enum { POINTS = 4096 };

static void center_of(const sf_entry *e, double c[3]) {
    for (int k = 0; k < 3; k++)
        c[k] = -(e->R_cw[k] * e->t_cw[0] + e->R_cw[3 + k] * e->t_cw[1] + e->R_cw[6 + k] * e->t_cw[2]);
}

/* Point k of n evenly chosen ones. */
static const double *point_of(const sf_project *p, size_t k, size_t n) {
    return p->xyz + 3 * (size_t)((double)k * (double)p->points / (double)n);
}

static double distance(const double a[3], const double b[3]) {
    double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return sqrt(sf_dot3(d, d));
}

/* The medians of the centres' coordinates; the median distance of the centres from there, or of the points if
 * that is larger. values: [count or POINTS], scratch. 0: no pose. */
static int measure(const sf_project *p, double *values, double median[3], double *size) {
    size_t n = 0, points = p->points < POINTS ? p->points : POINTS;
    double c[3];
    for (int k = 0; k < 3; k++) {
        n = 0;
        for (size_t i = 0; i < p->count; i++) {
            if (p->entries[i].bad_pose) continue;
            center_of(&p->entries[i], c);
            values[n++] = c[k];
        }
        if (!n) return 0;
        median[k] = sf_median(values, n);
    }
    n = 0;
    for (size_t i = 0; i < p->count; i++) {
        if (p->entries[i].bad_pose) continue;
        center_of(&p->entries[i], c);
        values[n++] = distance(c, median);
    }
    *size = sf_median(values, n);
    n = 0;
    for (size_t k = 0; k < points; k++) {
        double away = distance(point_of(p, k, points), median);
        if (isfinite(away)) values[n++] = away;
    }
    if (n) *size = fmax(*size, sf_median(values, n));
    return 1;
}

static void subtract(sf_project *p) {
    for (size_t i = 0; i < p->count; i++) {
        sf_entry *e = &p->entries[i];
        if (e->bad_pose) continue;
        for (int k = 0; k < 3; k++) e->t_cw[k] += sf_dot3(e->R_cw + 3 * k, p->origin);
    }
    for (size_t i = 0; i < 3 * p->points; i++) p->xyz[i] -= p->origin[i % 3];
}

sf_status sf_project_move_origin(sf_project *p) {
    double median[3], size = 0;
    double *values = sf_alloc(p->ctx, p->count > POINTS ? p->count : POINTS, sizeof *values);
    if (!values) return SF_ERR_MEMORY;
    int known = measure(p, values, median, &size);
    sf_free(p->ctx, values);
    if (!known || !sf_choose_origin(median, size, p->origin)) return SF_OK;
    subtract(p);
    sf_log(p->ctx, SF_LOG_INFO,
           "%s: coordinates are far from 0: they are taken relative to the origin %.17g %.17g %.17g", p->path,
           p->origin[0], p->origin[1], p->origin[2]);
    return SF_OK;
}
