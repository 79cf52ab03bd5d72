/* view.h - one view of a board: projection, residuals and their sums, first poses. */
#ifndef SF_POSE_VIEW_H
#define SF_POSE_VIEW_H

#include <stddef.h>
#include <stdint.h>

#include <splatfit/calibrate.h>

#include "lens.h"
#include "rigid.h"
#include "robust.h"

/* In a view. */
enum { SF_CORNERS_MOST = 2400 };

/* Corners and what is known of them. */
typedef struct sf_corner_list {
    const sf_board_corner *corners;
    uint8_t *rejected; /* a flag each; NULL: none is */
    size_t count;
} sf_corner_list;

/* The normal equations of a view (README, P.3). With r the residuals and w their weights, sums over the
 * corners that are not rejected. */
typedef struct sf_view_sums {
    double cost;                                          /* sum of rho(|r|^2) / 2 */
    double squares;                                       /* sum of |r|^2 */
    size_t count;                                         /* corners */
    double twist[SF_TWIST * SF_TWIST], d_twist[SF_TWIST]; /* sum w J^T J, sum w J^T r */
    double lens[SF_LENS_PARAMETERS * SF_LENS_PARAMETERS], d_lens[SF_LENS_PARAMETERS];
    double cross[SF_LENS_PARAMETERS * SF_TWIST];
} sf_view_sums;

/* Which sums are wanted. */
typedef enum sf_view_parts { SF_VIEW_COST, SF_VIEW_TWIST, SF_VIEW_ALL } sf_view_parts;

/* scale: c of Cauchy's weights 1 / (1 + |r|^2 / c^2), px; 0: all 1. The cost is infinite where a corner is
 * not in front of the camera. */
void sf_view_sum(const sf_lens *lens, const sf_rigid *T, const sf_corner_list *list, double scale,
                 sf_view_parts parts, sf_view_sums *sums);

/* Distances in px between the corners and where the pose puts them; infinite behind the camera. */
void sf_view_distances(const sf_lens *lens, const sf_rigid *T, const sf_corner_list *list, double *distances);

/* Homography from the board's plane to points of the picture, (x, y, 1) ~ H (X, Y, 1), robust. `points`
 * [count][2]. 0 where the points do not tell one: fewer than 4, all in a line. */
int sf_homography(const sf_board_corner *corners, const double *points, size_t count, double H[9]);

/* The pose that a homography to rays (x, y, 1) stands for. 0 where it is none. */
int sf_pose_of_homography(const double H[9], sf_rigid *T);

/* A first pose of the view. 0 where there is none. */
int sf_view_first_pose(const sf_lens *lens, const sf_corner_list *list, sf_rigid *T);

/* Moves T to where the cost is least (Levenberg and Marquardt); returns that. */
double sf_view_refine(const sf_lens *lens, const sf_corner_list *list, double scale, sf_rigid *T);

#endif
