/* lens.c - see lens.h. */
#include "lens.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"

/* x', y' of camera.h, and their derivatives by x, y: d [2][2]. */
static void distort(const sf_lens *lens, double x, double y, double out[2], double d[4]) {
    double r2 = x * x + y * y, factor = 1 + r2 * (lens->k1 + r2 * (lens->k2 + r2 * lens->k3));
    double slope = 2 * (lens->k1 + r2 * (2 * lens->k2 + r2 * 3 * lens->k3)); /* d factor / dx = slope x */
    double p1 = lens->p1, p2 = lens->p2;
    out[0] = x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
    out[1] = y * factor + 2 * p2 * x * y + p1 * (r2 + 2 * y * y);
    d[0] = factor + slope * x * x + 2 * p1 * y + 6 * p2 * x;
    d[1] = slope * x * y + 2 * p1 * x + 2 * p2 * y;
    d[2] = d[1];
    d[3] = factor + slope * y * y + 2 * p2 * x + 6 * p1 * y;
}

int sf_lens_project(const sf_lens *lens, const double point[3], double pixel[2], double *d_point,
                    double *d_lens) {
    double z = point[2], x = point[0] / z, y = point[1] / z, seen[2], d[4];
    if (!(z > 0)) return 0;
    distort(lens, x, y, seen, d);
    pixel[0] = lens->fx * seen[0] + lens->cx;
    pixel[1] = lens->fy * seen[1] + lens->cy;
    for (int i = 0; d_point && i < 2; i++) { /* d(x, y)/d point = [1 0 -x; 0 1 -y] / z */
        double f = (i ? lens->fy : lens->fx) / z;
        d_point[3 * i] = f * d[2 * i];
        d_point[3 * i + 1] = f * d[2 * i + 1];
        d_point[3 * i + 2] = -f * (d[2 * i] * x + d[2 * i + 1] * y);
    }
    if (d_lens) {
        double r2 = x * x + y * y, xy = 2 * x * y;
        double u[SF_LENS_PARAMETERS] = {seen[0], 0, 1, 0, x * r2, x * r2 * r2, xy, r2 + 2 * x * x};
        double v[SF_LENS_PARAMETERS] = {0, seen[1], 0, 1, y * r2, y * r2 * r2, r2 + 2 * y * y, xy};
        for (int i = 4; i < SF_LENS_PARAMETERS; i++) {
            u[i] *= lens->fx;
            v[i] *= lens->fy;
        }
        memcpy(d_lens, u, sizeof u);
        memcpy(d_lens + SF_LENS_PARAMETERS, v, sizeof v);
    }
    return 1;
}

int sf_lens_ray(const sf_lens *lens, const double pixel[2], double ray[2]) {
    enum { STEPS = 30 };
    double wanted[2] = {(pixel[0] - lens->cx) / lens->fx, (pixel[1] - lens->cy) / lens->fy};
    double x = wanted[0], y = wanted[1];
    for (int step = 0; step < STEPS; step++) { /* Newton */
        double seen[2], d[4];
        distort(lens, x, y, seen, d);
        double det = d[0] * d[3] - d[1] * d[2], ex = wanted[0] - seen[0], ey = wanted[1] - seen[1];
        if (!(det > 1e-6)) return 0; /* the polynomial turns back here */
        double dx = (d[3] * ex - d[1] * ey) / det, dy = (d[0] * ey - d[2] * ex) / det;
        x += dx;
        y += dy;
        if (fabs(dx) + fabs(dy) < 1e-12) {
            ray[0] = x;
            ray[1] = y;
            return 1;
        }
    }
    return 0;
}

void sf_twist_derivative(const double d_point[6], const double p[3], double J[2 * SF_TWIST]) {
    for (int i = 0; i < 2; i++) {
        const double *d = d_point + 3 * i;
        double *row = J + SF_TWIST * i;
        memcpy(row, d, 3 * sizeof *d);
        sf_cross3(p, d, row + 3); /* d . (phi x p) = phi . (p x d) */
    }
}
