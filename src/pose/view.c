/* view.c - see view.h. */
#include "view.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "homography.h"

/* Residuals. */

static void to_camera(const sf_rigid *T, const double board[2], double point[3]) {
    for (int i = 0; i < 3; i++) point[i] = T->R[3 * i] * board[0] + T->R[3 * i + 1] * board[1] + T->t[i];
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
    double r2 = r[0] * r[0] + r[1] * r[1], c2 = scale * scale;
    double w = scale > 0 ? sf_cauchy_weight(r2, c2) : 1;
    s->squares += r2;
    s->cost += scale > 0 ? sf_cauchy_cost(r2, c2) : r2 / 2;
    if (parts == SF_VIEW_COST) return;
    sf_twist_derivative(d_point, p, J);
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

/* Homographies. */

int sf_homography(const sf_board_corner *corners, const double *points, size_t count, double H[9]) {
    enum { ROUNDS = 5 };
    double board[2 * SF_CORNERS_MOST], weights[SF_CORNERS_MOST], sorted[SF_CORNERS_MOST];
    if (count > SF_CORNERS_MOST) return 0;
    for (size_t i = 0; i < count; i++) {
        memcpy(board + 2 * i, corners[i].board, sizeof corners[i].board);
        weights[i] = 1;
    }
    for (int round = 0; round < ROUNDS; round++) {
        if (!sf_homography_fit(board, points, weights, count, H)) return 0;
        for (size_t i = 0; i < count; i++) {
            double seen[2];
            sf_homography_map(H, board + 2 * i, seen);
            sorted[i] = weights[i] = hypot(seen[0] - points[2 * i], seen[1] - points[2 * i + 1]);
            if (!isfinite(weights[i])) return 0;
        }
        double scale = 2 * sf_spread(sorted, count) + 1e-9 / sf_normalizer_make(points, count).scale;
        for (size_t i = 0; i < count; i++) weights[i] = 1 / (1 + pow(weights[i] / scale, 2));
    }
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
