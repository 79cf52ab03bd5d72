/* localize.c - where between the pixels a difference of Gaussians is greatest. */
#include "localize.h"

#include <math.h>

static double at(const sf_cube *c, int scale, int y, int x) { return (double)c->row[1 + scale][1 + y][x]; }

/* Cramer's rule, for a symmetric matrix of xx, xy, xs, yy, ys, ss. */
static int solve(const double h[6], const double g[3], double *out) {
    double xx = h[3] * h[5] - h[4] * h[4], xy = h[2] * h[4] - h[1] * h[5], xs = h[1] * h[4] - h[2] * h[3];
    double yy = h[0] * h[5] - h[2] * h[2], ys = h[1] * h[2] - h[0] * h[4], ss = h[0] * h[3] - h[1] * h[1];
    double det = h[0] * xx + h[1] * xy + h[2] * xs;
    if (!(fabs(det) > 1e-30)) return 0;
    out[0] = -(xx * g[0] + xy * g[1] + xs * g[2]) / det;
    out[1] = -(xy * g[0] + yy * g[1] + ys * g[2]) / det;
    out[2] = -(xs * g[0] + ys * g[1] + ss * g[2]) / det;
    return 1;
}

int sf_localize(const sf_cube *cube, sf_extremum *e) {
    const sf_cube *c = cube;
    double value = at(c, 0, 0, 0);
    double g[3] = {(at(c, 0, 0, 1) - at(c, 0, 0, -1)) / 2, (at(c, 0, 1, 0) - at(c, 0, -1, 0)) / 2,
                   (at(c, 1, 0, 0) - at(c, -1, 0, 0)) / 2};
    double xx = at(c, 0, 0, 1) + at(c, 0, 0, -1) - 2 * value;
    double yy = at(c, 0, 1, 0) + at(c, 0, -1, 0) - 2 * value;
    double ss = at(c, 1, 0, 0) + at(c, -1, 0, 0) - 2 * value;
    double xy = (at(c, 0, 1, 1) + at(c, 0, -1, -1) - at(c, 0, -1, 1) - at(c, 0, 1, -1)) / 4;
    double xs = (at(c, 1, 0, 1) + at(c, -1, 0, -1) - at(c, -1, 0, 1) - at(c, 1, 0, -1)) / 4;
    double ys = (at(c, 1, 1, 0) + at(c, -1, -1, 0) - at(c, -1, 1, 0) - at(c, 1, -1, 0)) / 4;
    const double h[6] = {xx, xy, xs, yy, ys, ss};
    if (!solve(h, g, e->offset)) return 0;
    e->value = value + (g[0] * e->offset[0] + g[1] * e->offset[1] + g[2] * e->offset[2]) / 2;
    double det = xx * yy - xy * xy;
    e->edge = det > 0 ? (xx + yy) * (xx + yy) / det : -1;
    return 1;
}
