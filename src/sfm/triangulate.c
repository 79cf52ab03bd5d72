/* triangulate.c - see triangulate.h. */
#include "triangulate.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"

/* The unit vector of a ray in the world. */
static void world_ray(const sf_sight *sight, double d[3]) {
    const double *R = sight->pose->R, x = sight->ray[0], y = sight->ray[1];
    double length = sqrt(x * x + y * y + 1);
    for (int k = 0; k < 3; k++) d[k] = (R[k] * x + R[3 + k] * y + R[6 + k]) / length;
}

/* sum (I - d d^T) (X - c) = 0 */
int sf_triangulate_rays(const sf_sight *sights, size_t count, double at[3]) {
    double A[9] = {0}, sum[3] = {0};
    for (size_t i = 0; i < count; i++) {
        double d[3], c[3], along;
        world_ray(&sights[i], d);
        sf_rigid_center(sights[i].pose, c);
        along = sf_dot3(d, c);
        for (int k = 0; k < 3; k++) {
            sum[k] += c[k] - along * d[k];
            for (int l = 0; l < 3; l++) A[3 * k + l] += (k == l) - d[k] * d[l];
        }
    }
    double trace = A[0] + A[4] + A[8];
    if (!sf_cholesky(3, A) || !(A[8] * A[8] > 1e-12 * trace)) return 0;
    sf_cholesky_solve(3, A, sum);
    memcpy(at, sum, sizeof sum);
    return 1;
}

double sf_sight_error(const sf_sight *sight, const double at[3]) {
    double p[3], pixel[2];
    sf_rigid_apply(sight->pose, at, p);
    if (!sf_lens_project(sight->lens, p, pixel, NULL, NULL)) return INFINITY;
    double x = pixel[0] - sight->pixel[0], y = pixel[1] - sight->pixel[1];
    return sqrt(x * x + y * y) / (sight->unit > 0 ? sight->unit : 1);
}

/* The sum of the squares of the residuals, with A = sum J^T J and g = sum J^T r. */
static double add_sights(const sf_sight *sights, size_t count, const double at[3], double A[9], double g[3]) {
    double squares = 0;
    memset(A, 0, 9 * sizeof *A), memset(g, 0, 3 * sizeof *g);
    for (size_t i = 0; i < count; i++) {
        const double *R = sights[i].pose->R;
        double p[3], pixel[2], d[6];
        sf_rigid_apply(sights[i].pose, at, p);
        if (!sf_lens_project(sights[i].lens, p, pixel, d, NULL)) return INFINITY;
        for (int m = 0; m < 2; m++) {
            double r = pixel[m] - sights[i].pixel[m], J[3];
            for (int k = 0; k < 3; k++)
                J[k] = d[3 * m] * R[k] + d[3 * m + 1] * R[3 + k] + d[3 * m + 2] * R[6 + k];
            squares += r * r;
            for (int k = 0; k < 3; k++) {
                g[k] += J[k] * r;
                for (int l = 0; l < 3; l++) A[3 * k + l] += J[k] * J[l];
            }
        }
    }
    return squares;
}

double sf_triangulate_refine(const sf_sight *sights, size_t count, double at[3]) {
    enum { STEPS = 10 };
    double A[9], g[3], squares = add_sights(sights, count, at, A, g);
    for (int i = 0; i < STEPS && isfinite(squares); i++) {
        double next[3], B[9], h[3];
        if (!sf_cholesky(3, A)) break;
        sf_cholesky_solve(3, A, g);
        for (int k = 0; k < 3; k++) next[k] = at[k] - g[k];
        double moved = add_sights(sights, count, next, B, h);
        if (!(moved < squares)) break;
        int done = squares - moved < 1e-8 * squares;
        squares = moved;
        memcpy(at, next, sizeof next), memcpy(A, B, sizeof B), memcpy(g, h, sizeof h);
        if (done) break;
    }
    return squares / (double)count;
}

/* The unit vector from the camera to the point. */
static void direction(const sf_sight *sight, const double at[3], double d[3]) {
    double c[3];
    sf_rigid_center(sight->pose, c);
    for (int k = 0; k < 3; k++) d[k] = at[k] - c[k];
    double length = sqrt(sf_dot3(d, d));
    for (int k = 0; k < 3; k++) d[k] /= length;
}

int sf_is_wide(const sf_sight *sights, size_t count, const double at[3], double cosine) {
    double d[SF_SIGHTS_MOST][3];
    for (size_t i = 0; i < count && i < SF_SIGHTS_MOST; i++) {
        direction(&sights[i], at, d[i]);
        for (size_t j = 0; j < i; j++)
            if (sf_dot3(d[i], d[j]) < cosine) return 1;
    }
    return 0;
}

double sf_pair_angle(const sf_rigid *T, const double a[2], const double b[2]) {
    const double ray[3] = {a[0], a[1], 1}, seen[3] = {b[0], b[1], 1};
    double d[3], n[3], by_t[3], by_d[3];
    sf_mat3_vec(T->R, ray, d);
    sf_cross3(d, seen, n);
    sf_cross3(seen, T->t, by_t);
    sf_cross3(d, T->t, by_d);
    if (!(sf_dot3(n, by_t) > 0 && sf_dot3(n, by_d) > 0)) return 0;
    return atan2(sqrt(sf_dot3(n, n)), sf_dot3(d, seen));
}
