/* bundle.h - poses, points and lenses that explain best where the points were seen (README, P.9). */
#ifndef SF_POSE_BUNDLE_H
#define SF_POSE_BUNDLE_H

#include <stddef.h>
#include <stdint.h>

#include "../base/context.h"
#include "lens.h"
#include "robust.h"
#include "track.h"

/* Px: corners that are followed are not known better, whatever their scatter. */
#define SF_LEAST_SPREAD 0.2

/* World units: points nearer to a camera's plane, or behind it, are not seen. */
#define SF_BUNDLE_NEAREST 1e-9

/* A lens that several views share, and what of it is estimated. */
typedef struct sf_bundle_camera {
    sf_lens lens;
    int focal;      /* 0: as it is; 1: fx, and fy with it by one factor; 2: both */
    int center;     /* 0, 1: cx and cy */
    int radial;     /* 0; 1: k1; 2: k1 and k2 */
    int tangential; /* 0, 1: p1 and p2 */
    /* What is known of fx .. p2: the values, and their inverse variances (0: nothing). */
    double prior[SF_LENS_PARAMETERS], information[SF_LENS_PARAMETERS];
} sf_bundle_camera;

typedef struct sf_bundle_view {
    sf_rigid pose; /* world to camera */
    sf_lens lens;  /* where the bundle has cameras, overwritten by that of this one: */
    uint32_t camera;
    int is_free;  /* 0: stays where it is */
    int is_known; /* prior holds */
    sf_track_prior prior;
} sf_bundle_view;

typedef struct sf_bundle_point {
    double at[3];           /* world */
    double ray[3];          /* held along this unit vector, */
    double ray_information; /* to where it was, by this; 0: not at all */
} sf_bundle_point;

/* A point seen at a pixel. They are in the order of their points. */
typedef struct sf_bundle_observation {
    uint32_t view, point;
    double u, v;
} sf_bundle_observation;

typedef struct sf_bundle {
    sf_bundle_view *views;
    size_t view_count;
    sf_bundle_point *points;
    size_t point_count;
    const sf_bundle_observation *observations;
    size_t observation_count;
    sf_bundle_camera *cameras; /* NULL: lenses are the views' own, and stay as they are */
    size_t camera_count;
    double spread; /* px: the residuals' standard deviation, in a coordinate; 0: estimated in each round, from
                      their median, at least SF_LEAST_SPREAD */
    double enough; /* part of the cost that a round takes off, to go on; 0: 5e-4 */
    size_t dense_most; /* free views up to which Cholesky solves, above conjugate gradients; 0: 300 */
} sf_bundle;

/* Moves points, the free views' poses and what is free of the cameras, by Levenberg and Marquardt with
 * Cauchy's weights, `rounds` times at most. *spread: standard deviation of a coordinate, px. The same bytes
 * for any number of threads. On failure all stay as they were. SF_ERR_MEMORY. */
sf_status sf_bundle_adjust(sf_context *ctx, const sf_bundle *bundle, int rounds, double *spread);

/* The pixel that a point of the camera's frame is seen at. 0: it is not in front of the camera. */
int sf_bundle_pixel(const sf_bundle_view *view, const double p[3], double pixel[2]);

/* A residual's derivatives by the pose's left twist [2][6], for a point p of the camera's frame; d (may be
 * NULL): by p [2][3]. */
void sf_bundle_derive(const sf_bundle_view *view, const double p[3], double J[2 * SF_TWIST], double d[6]);

/* How far a point is from where it was seen, px; infinite behind the camera. */
double sf_bundle_distance(const sf_bundle_view *view, const double at[3], double u, double v);

#endif
