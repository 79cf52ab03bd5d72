/* bundle.h - poses and points that explain best where the points were seen (README, P.9). */
#ifndef SF_POSE_BUNDLE_H
#define SF_POSE_BUNDLE_H

#include <stddef.h>
#include <stdint.h>

#include "../base/context.h"
#include "track.h"

/* Px: corners that are followed are not known better, whatever their scatter. */
#define SF_LEAST_SPREAD 0.2

typedef struct sf_bundle_view {
    sf_rigid pose; /* world to camera */
    double fx, fy, cx, cy;
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
} sf_bundle;

/* Moves points and the free views' poses, by Levenberg and Marquardt with Cauchy's weights, `rounds` times at
 * most. *spread: standard deviation of a coordinate, px. On failure all stay as they were. */
sf_status sf_bundle_adjust(sf_context *ctx, const sf_bundle *bundle, int rounds, double *spread);

/* The pixel that a point of the camera's frame is seen at. 0: it is not in front of the camera. */
int sf_bundle_pixel(const sf_bundle_view *view, const double p[3], double pixel[2]);

/* A residual's derivatives by the pose's left twist [2][6], for a point p of the camera's frame; d (may be
 * NULL): by p [2][3]. */
void sf_bundle_derive(const sf_bundle_view *view, const double p[3], double J[2 * SF_TWIST], double d[6]);

/* How far a point is from where it was seen, px; infinite behind the camera. */
double sf_bundle_distance(const sf_bundle_view *view, const double at[3], double u, double v);

#endif
