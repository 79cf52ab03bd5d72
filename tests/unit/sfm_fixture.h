/* sfm_fixture.h - cameras and points with a known truth, for the tests of src/sfm. */
#ifndef SFM_FIXTURE_H
#define SFM_FIXTURE_H

#include <stddef.h>
#include <stdint.h>

#include "../../src/base/rng.h"
#include "../../src/pose/lens.h"

/* What the points of a pair of views lie on, and how the second camera moved. */
typedef enum sfm_layout { SFM_GENERAL, SFM_PLANE, SFM_ROTATION } sfm_layout;

enum { SFM_PAIRS_MOST = 2000 };

/* Pairs of rays with their truth; T: the second camera's pose from the first's, |t| = 1 (0 of a rotation). */
typedef struct sfm_pair {
    size_t count;
    sf_rigid T;
    double points[3 * SFM_PAIRS_MOST]; /* in the first camera's frame */
    double a[2 * SFM_PAIRS_MOST], b[2 * SFM_PAIRS_MOST];
    uint8_t is_true[SFM_PAIRS_MOST]; /* 0: a wrong pair */
} sfm_pair;

/* A random direction, and a rotation by up to `most` rad. */
void sfm_direction(sf_rng *rng, double d[3]);
void sfm_rotation(sf_rng *rng, double most, double R[9]);

/* Fills in `count` pairs; noise: standard deviation of a coordinate of b and a, in their units; wrong: share
 * of pairs whose b is anywhere. */
void sfm_make_pair(sfm_pair *pair, sf_rng *rng, sfm_layout layout, size_t count, double noise, double wrong);

/* The angle in rad between two rotations, and between two directions. */
double sfm_angle_between(const double R[9], const double Q[9]);
double sfm_direction_error(const double a[3], const double b[3]);

/* The norm of the difference of two matrices, made alike in norm and sign. */
double sfm_matrix_error(const double *A, const double *B, size_t n);

/* A camera that looks from `center` at `target`, with y down. */
void sfm_look_at(const double center[3], const double target[3], sf_rigid *T);

#endif
