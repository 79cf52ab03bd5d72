/* pair_models.c - see pair_models.h. */
#include "pair_models.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../pose/homography.h"
#include "epipolar.h"
#include "essential.h"
#include "fundamental.h"
#include "null_space.h"
#include "relative_pose.h"

/* Epipolar models */

static void sampson_errors(const void *user, const double *model, size_t begin, size_t end, double *squared) {
    const sf_pairs *p = user;
    for (size_t i = begin; i < end; i++) squared[i - begin] = sf_sampson(model, p->a + 2 * i, p->b + 2 * i);
}

static int solve_essential(const void *user, const uint32_t *sample, double *models) {
    const sf_pairs *p = user;
    return sf_essential_from_5(p->a, p->b, sample, models);
}

/* Leaves weights to `most` pairs, evenly chosen among those that have one. */
static void thin(double *weights, size_t count, size_t most) {
    size_t all = 0, left = 0;
    for (size_t i = 0; i < count; i++) all += weights[i] != 0;
    for (size_t i = 0; all > most && i < count; i++) {
        if (weights[i] == 0) continue;
        left += most;
        if (left < all)
            weights[i] = 0;
        else
            left -= all;
    }
}

/* All four poses of a matrix have the same distances. More pairs than MOST hardly move a pose that is refined
 * with all of them when the search has ended. */
static int refit_essential(const void *user, double *weights, double *model) {
    enum { STEPS = 4, MOST = 256 };
    const sf_pairs *p = user;
    sf_rigid poses[4];
    if (!sf_essential_poses(model, poses)) return 0;
    thin(weights, p->count, MOST);
    sf_relative_pose_refine(p->a, p->b, weights, p->count, STEPS, &poses[0]);
    sf_essential_of_pose(&poses[0], model);
    return 1;
}

sf_ransac_problem sf_essential_problem(const sf_pairs *pairs) {
    return (sf_ransac_problem){pairs, pairs->count, 5, 9, solve_essential, refit_essential, sampson_errors};
}

static int solve_fundamental(const void *user, const uint32_t *sample, double *models) {
    const sf_pairs *p = user;
    return sf_fundamental_from_7(p->a, p->b, sample, models);
}

static int refit_fundamental(const void *user, double *weights, double *model) {
    const sf_pairs *p = user;
    return sf_fundamental_refine(p->a, p->b, weights, p->count, 2, model);
}

sf_ransac_problem sf_fundamental_problem(const sf_pairs *pairs) {
    return (sf_ransac_problem){pairs,         pairs->count, 7, 9, solve_fundamental, refit_fundamental,
                               sampson_errors};
}

/* Homographies */

int sf_homography_invert(double H[18]) {
    double C[9];
    for (int i = 0; i < 3; i++) sf_cross3(H + 3 * ((i + 1) % 3), H + 3 * ((i + 2) % 3), C + 3 * i);
    double det = sf_dot3(H, C);
    if (det == 0 || !isfinite(det)) return 0;
    for (int i = 0; i < 9; i++) H[9 + i] = C[3 * (i % 3) + i / 3] / det;
    return 1;
}

double sf_homography_error(const double H[18], const double a[2], const double b[2]) {
    double there[2], back[2];
    sf_homography_map(H, a, there);
    sf_homography_map(H + 9, b, back);
    double x = there[0] - b[0], y = there[1] - b[1], u = back[0] - a[0], v = back[1] - a[1];
    return (x * x + y * y + u * u + v * v) / 2;
}

static void homography_errors(const void *user, const double *model, size_t begin, size_t end,
                              double *squared) {
    const sf_pairs *p = user;
    for (size_t i = begin; i < end; i++)
        squared[i - begin] = sf_homography_error(model, p->a + 2 * i, p->b + 2 * i);
}

static int solve_homography(const void *user, const uint32_t *sample, double *models) {
    const sf_pairs *p = user;
    double A[72], a[4][2], b[4][2];
    for (int i = 0; i < 4; i++) {
        memcpy(a[i], p->a + 2 * sample[i], sizeof a[i]);
        memcpy(b[i], p->b + 2 * sample[i], sizeof b[i]);
        const double rows[18] = {
            a[i][0], a[i][1], 1, 0,       0,       0, -b[i][0] * a[i][0], -b[i][0] * a[i][1], -b[i][0],
            0,       0,       0, a[i][0], a[i][1], 1, -b[i][1] * a[i][0], -b[i][1] * a[i][1], -b[i][1]};
        memcpy(A + 18 * i, rows, sizeof rows);
    }
    sf_null_space(8, A, models);
    return sf_homography_invert(models);
}

static int refit_homography(const void *user, double *weights, double *model) {
    const sf_pairs *p = user;
    return sf_homography_fit(p->a, p->b, weights, p->count, model) && sf_homography_invert(model);
}

sf_ransac_problem sf_homography_problem(const sf_pairs *pairs) {
    return (sf_ransac_problem){
        pairs, pairs->count, 4, 18, solve_homography, refit_homography, homography_errors};
}
