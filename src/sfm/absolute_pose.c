/* absolute_pose.c - see absolute_pose.h. */
#include "absolute_pose.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../pose/robust.h"
#include "polynomial.h"

/* 1. Distances of three points from the camera (Grunert, as Haralick et al. write it down) */

typedef struct triangle {
    double ray[3][3];  /* unit vectors */
    double a2, b2, c2; /* squares of the sides between points 1 and 2, 0 and 2, 0 and 1 */
    double cos_a, cos_b, cos_c;
} triangle;

static double squared_distance(const double *p, const double *q) {
    double d[3] = {p[0] - q[0], p[1] - q[1], p[2] - q[2]};
    return sf_dot3(d, d);
}

static int make_triangle(const double *points, const double *rays, const uint32_t sample[3], triangle *t) {
    const double *p[3], *longest;
    double u[3], v[3], n[3];
    for (int i = 0; i < 3; i++) {
        p[i] = points + 3 * sample[i];
        const double *ray = rays + 2 * sample[i];
        double length = sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1);
        t->ray[i][0] = ray[0] / length, t->ray[i][1] = ray[1] / length, t->ray[i][2] = 1 / length;
    }
    t->a2 = squared_distance(p[1], p[2]), t->b2 = squared_distance(p[0], p[2]);
    t->c2 = squared_distance(p[0], p[1]);
    t->cos_a = sf_dot3(t->ray[1], t->ray[2]), t->cos_b = sf_dot3(t->ray[0], t->ray[2]);
    t->cos_c = sf_dot3(t->ray[0], t->ray[1]);
    for (int k = 0; k < 3; k++) u[k] = p[1][k] - p[0][k], v[k] = p[2][k] - p[0][k];
    sf_cross3(u, v, n);
    longest = t->a2 > t->b2 ? &t->a2 : &t->b2;
    if (t->c2 > *longest) longest = &t->c2;
    return sf_dot3(n, n) > 1e-12 * *longest * *longest; /* not in a line */
}

/* The quartic in the ratio v of the distances of points 2 and 0. */
static void make_quartic(const triangle *t, double c[5]) {
    double ca = t->cos_a, cb = t->cos_b, cg = t->cos_c;
    double d = (t->a2 - t->c2) / t->b2, s = (t->a2 + t->c2) / t->b2, cc = t->c2 / t->b2, aa = t->a2 / t->b2;
    c[4] = (d - 1) * (d - 1) - 4 * cc * ca * ca;
    c[3] = 4 * (d * (1 - d) * cb - (1 - s) * ca * cg + 2 * cc * ca * ca * cb);
    c[2] = 2 * (d * d - 1 + 2 * d * d * cb * cb + 2 * (1 - cc) * ca * ca - 4 * s * ca * cb * cg +
                2 * (1 - aa) * cg * cg);
    c[1] = 4 * (-d * (1 + d) * cb + 2 * aa * cg * cg * cb - (1 - s) * ca * cg);
    c[0] = (1 + d) * (1 + d) - 4 * aa * cg * cg;
}

/* How far the three sides are from what they should be, over the longest one's square. */
static double misfit(const triangle *t, const double s[3], double r[3]) {
    r[0] = s[1] * s[1] + s[2] * s[2] - 2 * s[1] * s[2] * t->cos_a - t->a2;
    r[1] = s[0] * s[0] + s[2] * s[2] - 2 * s[0] * s[2] * t->cos_b - t->b2;
    r[2] = s[0] * s[0] + s[1] * s[1] - 2 * s[0] * s[1] * t->cos_c - t->c2;
    return fmax(fabs(r[0]), fmax(fabs(r[1]), fabs(r[2]))) / fmax(t->a2, fmax(t->b2, t->c2));
}

/* Newton on the three laws of cosines. */
static int polish_distances(const triangle *t, double s[3]) {
    double r[3];
    for (int step = 0; step < 5 && misfit(t, s, r) > 1e-15; step++) {
        const double J[9] = {0, s[1] - s[2] * t->cos_a, s[2] - s[1] * t->cos_a, s[0] - s[2] * t->cos_b,
                             0, s[2] - s[0] * t->cos_b, s[0] - s[1] * t->cos_c, s[1] - s[0] * t->cos_c,
                             0};
        double C[9]; /* the inverse is C^T / det */
        for (int i = 0; i < 3; i++) sf_cross3(J + 3 * ((i + 1) % 3), J + 3 * ((i + 2) % 3), C + 3 * i);
        double det = sf_dot3(J, C);
        if (det == 0) break;
        for (int k = 0; k < 3; k++) s[k] -= (C[k] * r[0] + C[3 + k] * r[1] + C[6 + k] * r[2]) / (2 * det);
    }
    return s[0] > 0 && s[1] > 0 && s[2] > 0 && misfit(t, s, r) < 1e-9;
}

/* Distances for a root v; the ratio u of those of points 1 and 0 is a root of a quadratic, the one that
 * agrees better with the side between points 1 and 2. */
static int distances_of(const triangle *t, double v, double s[3]) {
    double least = INFINITY;
    double s0 = sqrt(t->b2 / (1 + v * v - 2 * v * t->cos_b));
    double inside = t->cos_c * t->cos_c - 1 + t->c2 / (s0 * s0);
    if (!(v > 0) || !(inside > -1e-3)) return 0;
    for (int k = 0; k < 2; k++) {
        double u = t->cos_c + (k ? -1 : 1) * sqrt(fmax(inside, 0)), r[3];
        double tried[3] = {s0, u * s0, v * s0};
        double off = misfit(t, tried, r);
        if (!(u > 0) || !(off < least)) continue;
        least = off;
        memcpy(s, tried, sizeof tried);
    }
    return isfinite(least) && polish_distances(t, s);
}

/* 2. The pose that takes three points to three others, the same triangle */

/* Rows: along the first side, at right angles to it in the plane, and to the plane. */
static void frame_of(const double *p, const double *q, const double *r, double F[9]) {
    double x[3], y[3], length, along;
    for (int k = 0; k < 3; k++) x[k] = q[k] - p[k], y[k] = r[k] - p[k];
    length = sqrt(sf_dot3(x, x));
    for (int k = 0; k < 3; k++) F[k] = x[k] / length;
    along = sf_dot3(F, y);
    for (int k = 0; k < 3; k++) y[k] -= along * F[k];
    length = sqrt(sf_dot3(y, y));
    for (int k = 0; k < 3; k++) F[3 + k] = y[k] / length;
    sf_cross3(F, F + 3, F + 6);
}

int sf_pose_from_3(const double *points, const double *rays, const uint32_t sample[3],
                   sf_rigid poses[SF_P3P_MOST]) {
    triangle t;
    double c[5], roots[SF_DEGREE_MOST], s[3], from[9], to[9], seen[3][3], at[3];
    int count = 0;
    if (!make_triangle(points, rays, sample, &t)) return 0;
    const double *p[3] = {points + 3 * sample[0], points + 3 * sample[1], points + 3 * sample[2]};
    frame_of(p[0], p[1], p[2], from);
    make_quartic(&t, c);
    int found = sf_polynomial_roots(c, 4, roots);
    for (int i = 0; i < found && count < SF_P3P_MOST; i++) {
        sf_rigid *T = &poses[count];
        if (!distances_of(&t, roots[i], s)) continue;
        for (int k = 0; k < 9; k++) seen[k / 3][k % 3] = s[k / 3] * t.ray[k / 3][k % 3];
        frame_of(seen[0], seen[1], seen[2], to);
        for (int k = 0; k < 9; k++)
            T->R[k] =
                to[k / 3] * from[k % 3] + to[3 + k / 3] * from[3 + k % 3] + to[6 + k / 3] * from[6 + k % 3];
        sf_mat3_vec(T->R, p[0], at);
        for (int k = 0; k < 3; k++) T->t[k] = seen[0][k] - at[k];
        count++;
    }
    return count;
}

/* 3. Refinement */

enum { MOST_PARAMETERS = SF_TWIST + 1 };

typedef struct sums {
    double cost, A[MOST_PARAMETERS * MOST_PARAMETERS], g[MOST_PARAMETERS];
} sums;

static void add_observation(const sf_lens *lens, const sf_rigid *T, const double *point, const double *seen,
                            double c2, int n, sums *s) {
    double p[3], pixel[2], d_point[6], J[2 * SF_TWIST], K[2 * SF_LENS_PARAMETERS], rows[2][MOST_PARAMETERS];
    sf_rigid_apply(T, point, p);
    if (!sf_lens_project(lens, p, pixel, d_point, K)) {
        s->cost = INFINITY;
        return;
    }
    const double r[2] = {pixel[0] - seen[0], pixel[1] - seen[1]};
    double r2 = r[0] * r[0] + r[1] * r[1], w = sf_cauchy_weight(r2, c2);
    s->cost += sf_cauchy_cost(r2, c2);
    sf_twist_derivative(d_point, p, J);
    for (int i = 0; i < 2; i++) {
        memcpy(rows[i], J + SF_TWIST * i, SF_TWIST * sizeof *J);
        /* by the logarithm of the focal length */
        rows[i][SF_TWIST] = lens->fx * K[SF_LENS_PARAMETERS * i] + lens->fy * K[SF_LENS_PARAMETERS * i + 1];
    }
    for (int k = 0; k < n; k++) {
        s->g[k] += w * (rows[0][k] * r[0] + rows[1][k] * r[1]);
        for (int l = 0; l <= k; l++)
            s->A[n * k + l] += w * (rows[0][k] * rows[0][l] + rows[1][k] * rows[1][l]);
    }
}

/* What is refined, and from what. */
typedef struct refinement {
    const sf_correspondences *all;
    const uint32_t *members;
    size_t count;
    double c2;
    int n; /* parameters */
} refinement;

static void add_all(const refinement *f, const sf_lens *lens, const sf_rigid *T, sums *s) {
    memset(s, 0, sizeof *s);
    for (size_t i = 0; i < f->count; i++) {
        size_t at = f->members[i];
        add_observation(lens, T, f->all->points + 3 * at, f->all->pixels + 2 * at, f->c2, f->n, s);
    }
}

double sf_pose_refine(const sf_correspondences *all, const uint32_t *members, size_t count, double scale,
                      int with_focal, sf_lens *lens, sf_rigid *T) {
    enum { STEPS = 30 };
    const int n = with_focal ? MOST_PARAMETERS : SF_TWIST;
    const refinement f = {all, members, count, scale * scale, n};
    double damping = 1e-4;
    sums s, moved;
    if (!count) return INFINITY;
    add_all(&f, lens, T, &s);
    for (int i = 0; i < STEPS && damping < 1e6 && isfinite(s.cost); i++) {
        double A[MOST_PARAMETERS * MOST_PARAMETERS], step[MOST_PARAMETERS];
        sf_rigid next = *T;
        sf_lens other = *lens;
        memcpy(A, s.A, sizeof A);
        for (int k = 0; k < n; k++) A[n * k + k] *= 1 + damping, step[k] = -s.g[k];
        damping *= 10;
        if (!sf_cholesky(n, A)) continue;
        sf_cholesky_solve(n, A, step);
        sf_rigid_move(&next, step);
        if (with_focal) other.fx *= exp(step[SF_TWIST]), other.fy *= exp(step[SF_TWIST]);
        add_all(&f, &other, &next, &moved);
        if (!(moved.cost < s.cost)) continue;
        int done = s.cost - moved.cost < 1e-9 * s.cost;
        *T = next, *lens = other, s = moved, damping /= 100;
        if (done) break;
    }
    return s.cost / (double)count;
}
