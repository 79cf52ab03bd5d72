/* view.c - see view.h. */
#include "view.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/statistics.h"

/* Rigid motions. */

/* One step of Newton towards the nearest rotation: R (3 I - R^T R) / 2. */
static void polish(double R[9]) {
    double square[9], result[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            square[3 * i + j] =
                (i == j) * 1.5 - 0.5 * (R[i] * R[j] + R[3 + i] * R[3 + j] + R[6 + i] * R[6 + j]);
    sf_mat3_mul(R, square, result);
    memcpy(R, result, sizeof result);
}

void sf_rigid_move(sf_rigid *T, const double twist[SF_TWIST]) {
    double turn[9], R[9], t[3];
    sf_rotation_exp(twist + 3, turn);
    sf_mat3_mul(turn, T->R, R);
    sf_mat3_vec(turn, T->t, t);
    polish(R);
    memcpy(T->R, R, sizeof R);
    for (int i = 0; i < 3; i++) T->t[i] = t[i] + twist[i];
}

/* The lens. */

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

/* Residuals. */

static void to_camera(const sf_rigid *T, const double board[2], double point[3]) {
    for (int i = 0; i < 3; i++) point[i] = T->R[3 * i] * board[0] + T->R[3 * i + 1] * board[1] + T->t[i];
}

/* d(pixel)/d(twist) = d_point [I, -[p]x]. */
static void twist_derivative(const double d_point[6], const double p[3], double J[2 * SF_TWIST]) {
    for (int i = 0; i < 2; i++) {
        const double *d = d_point + 3 * i;
        double *row = J + SF_TWIST * i;
        memcpy(row, d, 3 * sizeof *d);
        sf_cross3(p, d, row + 3); /* d . (phi x p) = phi . (p x d) */
    }
}

/* A += w J^T K for J (2 x m) and K (2 x n). */
static void add_product(int m, int n, const double *J, const double *K, double w, double *A) {
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++) A[i * n + j] += w * (J[i] * K[j] + J[m + i] * K[n + j]);
}

static void add_corner(const sf_lens *lens, const sf_rigid *T, const sf_board_corner *corner, double scale,
                       sf_view_parts parts, sf_view_sums *s) {
    double p[3], pixel[2], d_point[6], J[2 * SF_TWIST], K[2 * SF_LENS_PARAMETERS];
    to_camera(T, corner->board, p);
    s->count++;
    if (!sf_lens_project(lens, p, pixel, parts == SF_VIEW_COST ? NULL : d_point,
                         parts == SF_VIEW_ALL ? K : NULL)) {
        s->cost = s->squares = INFINITY;
        return;
    }
    double r[2] = {pixel[0] - corner->pixel[0], pixel[1] - corner->pixel[1]};
    double r2 = r[0] * r[0] + r[1] * r[1], c2 = scale * scale, w = scale > 0 ? c2 / (c2 + r2) : 1;
    s->squares += r2;
    s->cost += scale > 0 ? c2 * log1p(r2 / c2) / 2 : r2 / 2;
    if (parts == SF_VIEW_COST) return;
    twist_derivative(d_point, p, J);
    add_product(SF_TWIST, SF_TWIST, J, J, w, s->twist);
    add_product(SF_TWIST, 1, J, r, w, s->d_twist);
    if (parts != SF_VIEW_ALL) return;
    add_product(SF_LENS_PARAMETERS, SF_LENS_PARAMETERS, K, K, w, s->lens);
    add_product(SF_LENS_PARAMETERS, 1, K, r, w, s->d_lens);
    add_product(SF_LENS_PARAMETERS, SF_TWIST, K, J, w, s->cross);
}

void sf_view_sum(const sf_lens *lens, const sf_rigid *T, const sf_corner_list *list, double scale,
                 sf_view_parts parts, sf_view_sums *sums) {
    memset(sums, 0, sizeof *sums);
    for (size_t i = 0; i < list->count; i++)
        if (!list->rejected || !list->rejected[i]) add_corner(lens, T, &list->corners[i], scale, parts, sums);
}

void sf_view_distances(const sf_lens *lens, const sf_rigid *T, const sf_corner_list *list,
                       double *distances) {
    for (size_t i = 0; i < list->count; i++) {
        const sf_board_corner *corner = &list->corners[i];
        double p[3], pixel[2];
        to_camera(T, corner->board, p);
        distances[i] = sf_lens_project(lens, p, pixel, NULL, NULL)
                           ? hypot(pixel[0] - corner->pixel[0], pixel[1] - corner->pixel[1])
                           : INFINITY;
    }
}

double sf_spread(double *distances, size_t count) {
    return sf_median(distances, count) / sqrt(2 * log(2)); /* the median of Rayleigh's distribution */
}

/* Homographies. */

/* x -> scale (x - middle): the mean to 0, the mean square to 2 (Hartley). */
typedef struct normalizer {
    double middle[2], scale;
} normalizer;

static normalizer normalize(const double *points, size_t stride, size_t count) {
    normalizer n = {{0, 0}, 0};
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < 2; k++) n.middle[k] += points[i * stride + k] / (double)count;
    double squares = 0;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < 2; k++) squares += pow(points[i * stride + k] - n.middle[k], 2);
    n.scale = sqrt(2 * (double)count / squares);
    return n;
}

static void map(const double H[9], const double from[2], double to[2]) {
    double w = H[6] * from[0] + H[7] * from[1] + H[8];
    to[0] = (H[0] * from[0] + H[1] * from[1] + H[2]) / w;
    to[1] = (H[3] * from[0] + H[4] * from[1] + H[5]) / w;
}

/* Adds a pair's two equations of the direct linear transformation. */
static void add_pair(const double X[2], const double x[2], double w, double A[81]) {
    double rows[18] = {X[0], X[1], 1, 0,    0,    0, -x[0] * X[0], -x[0] * X[1], -x[0],
                       0,    0,    0, X[0], X[1], 1, -x[1] * X[0], -x[1] * X[1], -x[1]};
    add_product(9, 9, rows, rows, w, A);
}

static void apply(const normalizer *n, const double in[2], double out[2]) {
    for (int k = 0; k < 2; k++) out[k] = n->scale * (in[k] - n->middle[k]);
}

/* H = from normalized to plain: N_x^-1 G N_X. */
static void restore(const double G[9], const normalizer *X, const normalizer *x, double H[9]) {
    double right[9] = {X->scale, 0, -X->scale * X->middle[0], 0, X->scale, -X->scale * X->middle[1], 0, 0, 1};
    double left[9] = {1 / x->scale, 0, x->middle[0], 0, 1 / x->scale, x->middle[1], 0, 0, 1};
    double middle[9];
    sf_mat3_mul(G, right, middle);
    sf_mat3_mul(left, middle, H);
}

/* Points on a line leave a second direction undetermined: the spread across is then nothing. */
static int in_a_line(const sf_board_corner *corners, size_t count, const normalizer *n) {
    double xx = 0, xy = 0, yy = 0;
    for (size_t i = 0; i < count; i++) {
        double p[2];
        apply(n, corners[i].board, p);
        xx += p[0] * p[0];
        xy += p[0] * p[1];
        yy += p[1] * p[1];
    }
    return !(xx * yy - xy * xy > 1e-6 * (xx + yy) * (xx + yy));
}

int sf_homography(const sf_board_corner *corners, const double *points, size_t count, double H[9]) {
    enum { ROUNDS = 5 };
    if (count < 4 || count > SF_CORNERS_MOST) return 0;
    normalizer X = normalize(corners[0].board, sizeof *corners / sizeof(double), count);
    normalizer x = normalize(points, 2, count);
    if (!isfinite(X.scale) || !isfinite(x.scale) || in_a_line(corners, count, &X)) return 0;
    double weights[SF_CORNERS_MOST], sorted[SF_CORNERS_MOST], G[9];
    for (size_t i = 0; i < count; i++) weights[i] = 1;
    for (int round = 0; round < ROUNDS; round++) {
        double A[81] = {0}, a[2], b[2], seen[2];
        for (size_t i = 0; i < count; i++) {
            apply(&X, corners[i].board, a);
            apply(&x, points + 2 * i, b);
            add_pair(a, b, weights[i], A);
        }
        sf_least_eigenvector(9, A, G);
        for (size_t i = 0; i < count; i++) {
            apply(&X, corners[i].board, a);
            apply(&x, points + 2 * i, b);
            map(G, a, seen);
            sorted[i] = weights[i] = hypot(seen[0] - b[0], seen[1] - b[1]);
            if (!isfinite(weights[i])) return 0;
        }
        double scale = 2 * sf_spread(sorted, count) + 1e-9;
        for (size_t i = 0; i < count; i++) weights[i] = 1 / (1 + pow(weights[i] / scale, 2));
    }
    restore(G, &X, &x, H);
    return 1;
}

/* Poses. */

int sf_pose_of_homography(const double H[9], sf_rigid *T) {
    double a[3] = {H[0], H[3], H[6]}, b[3] = {H[1], H[4], H[7]};
    double la = sqrt(sf_dot3(a, a)), lb = sqrt(sf_dot3(b, b));
    double scale = 2 / (la + lb) * (H[8] < 0 ? -1 : 1); /* the board is in front of the camera */
    if (!(la > 0 && lb > 0) || !isfinite(scale)) return 0;
    double sum[3], difference[3];
    for (int i = 0; i < 3; i++) {
        T->t[i] = H[3 * i + 2] * scale;
        sum[i] = (a[i] / la + b[i] / lb) * (scale < 0 ? -1 : 1);
        difference[i] = (a[i] / la - b[i] / lb) * (scale < 0 ? -1 : 1);
    }
    /* The two axes turned apart alike until they are at right angles. */
    double ls = sqrt(2 * sf_dot3(sum, sum)), ld = sqrt(2 * sf_dot3(difference, difference));
    if (!(ls > 1e-9 && ld > 1e-9)) return 0;
    double x[3], y[3], z[3];
    for (int i = 0; i < 3; i++) {
        x[i] = sum[i] / ls + difference[i] / ld;
        y[i] = sum[i] / ls - difference[i] / ld;
    }
    sf_cross3(x, y, z);
    for (int i = 0; i < 3; i++) {
        T->R[3 * i] = x[i];
        T->R[3 * i + 1] = y[i];
        T->R[3 * i + 2] = z[i];
    }
    return 1;
}

int sf_view_first_pose(const sf_lens *lens, const sf_corner_list *list, sf_rigid *T) {
    double rays[2 * SF_CORNERS_MOST], H[9];
    if (list->count > SF_CORNERS_MOST) return 0;
    for (size_t i = 0; i < list->count; i++)
        if (!sf_lens_ray(lens, list->corners[i].pixel, rays + 2 * i)) return 0;
    return sf_homography(list->corners, rays, list->count, H) && sf_pose_of_homography(H, T);
}

/* A step of the damped normal equations; 0 if there is none. */
static int damped_step(const sf_view_sums *s, double damping, double step[SF_TWIST]) {
    double A[SF_TWIST * SF_TWIST];
    memcpy(A, s->twist, sizeof A);
    for (int i = 0; i < SF_TWIST; i++) {
        A[i * SF_TWIST + i] *= 1 + damping;
        step[i] = -s->d_twist[i];
    }
    if (!sf_cholesky(SF_TWIST, A)) return 0;
    sf_cholesky_solve(SF_TWIST, A, step);
    return 1;
}

double sf_view_refine(const sf_lens *lens, const sf_corner_list *list, double scale, sf_rigid *T) {
    enum { STEPS = 60 };
    sf_view_sums s, moved;
    double damping = 1e-3;
    sf_view_sum(lens, T, list, scale, SF_VIEW_TWIST, &s);
    for (int i = 0; i < STEPS && damping < 1e9; i++) {
        sf_rigid next = *T;
        double step[SF_TWIST];
        if (!damped_step(&s, damping, step)) {
            damping *= 10;
            continue;
        }
        sf_rigid_move(&next, step);
        sf_view_sum(lens, &next, list, scale, SF_VIEW_TWIST, &moved);
        if (!(moved.cost < s.cost)) {
            damping *= 10;
            continue;
        }
        int done = s.cost - moved.cost < 1e-12 * s.cost;
        *T = next;
        s = moved;
        damping = fmax(damping / 10, 1e-12);
        if (done) break;
    }
    return s.cost;
}
