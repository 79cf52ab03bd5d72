/* two_view.h - the geometry of a pair of pictures from their matches (GEOMETRY.md, S.20, S.21). */
#ifndef SF_SFM_TWO_VIEW_H
#define SF_SFM_TWO_VIEW_H

#include <stddef.h>
#include <stdint.h>

#include "../pose/rigid.h"

/* What the matches of a pair say. */
typedef enum sf_pair_kind {
    SF_PAIR_NONE,             /* too few agree with any model */
    SF_PAIR_GENERAL,          /* an essential matrix; a fundamental matrix where the lenses are not known */
    SF_PAIR_PLANE,            /* all of it in one plane; a pose where the lenses are known */
    SF_PAIR_ROTATION,         /* the camera turned, and did not move, as far as the matches tell */
    SF_PAIR_PLANE_OR_ROTATION /* the lenses are not known: a homography explains all */
} sf_pair_kind;

typedef struct sf_two_view_options {
    int known;          /* the lenses are known: the coordinates are rays */
    double threshold;   /* greatest error of an inlier, in the units of the coordinates: px / focal length */
    size_t least_count; /* inliers of a pair */
    double plane_share; /* homography's inliers over the general model's, from where on it is a plane */
    double turn_share;  /* a rotation's inliers over the best other model's, from where on it is one */
    int most_samples;   /* of each search */
    uint64_t seed;
} sf_two_view_options;

typedef struct sf_two_view {
    sf_pair_kind kind;
    double F[9]; /* b^T F a = 0, of norm 1; the essential matrix where the lenses are known */
    double H[9]; /* b ~ H a; 0 if none has plane_share of the inliers */
    int has_pose;
    sf_rigid T;   /* the second camera's from the first's, |t| = 1; of a rotation t = 0 */
    double angle; /* rad: median angle between the rays of the inliers; 0 without a pose */
    size_t general_count, plane_count, rotation_count; /* inliers of each model */
    size_t count; /* inliers of the pair: of the model that its kind names */
} sf_two_view;

/* known 0, threshold 0.003, 15 inliers, plane_share 0.8, turn_share 0.9, 1000 samples, seed 1. */
sf_two_view_options sf_two_view_options_default(void);

/* Doubles of scratch a match that sf_two_view_find needs. */
enum { SF_TWO_VIEW_SCRATCH = 4 };

/* The geometry of the matches a, b [count][2]: rays (x, y, 1) where the lenses are known, else pixels from
 * the picture's middle over a guessed focal length or the picture's size. scratch [SF_TWO_VIEW_SCRATCH
 * count]; inliers [count]: flags. The same input gives the same result, on any thread. */
void sf_two_view_find(const sf_two_view_options *options, const double *a, const double *b, size_t count,
                      double *scratch, uint8_t *inliers, sf_two_view *result);

#endif
