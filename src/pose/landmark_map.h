/* landmark_map.h - the map of landmarks: those in it, where keyframes saw them, matches in the
 * picture. */
#ifndef SF_POSE_LANDMARK_MAP_H
#define SF_POSE_LANDMARK_MAP_H

#include "bundle.h"
#include "patch.h"

/* Standard deviation of the inverse depth of a new landmark, in parts of it: the depth is guessed. */
#define SF_GUESSED_DEPTH 0.5

typedef enum sf_landmark_state {
    SF_LANDMARK_EMPTY, /* a free entry of the list */
    SF_LANDMARK_NEW,   /* its depth is being estimated */
    SF_LANDMARK_KNOWN  /* its place is known from several keyframes */
} sf_landmark_state;

typedef struct sf_landmark {
    sf_landmark_state state;
    sf_patch patch;
    size_t keyframe;          /* index, that it was first seen in */
    double ray[3];            /* there: (x, y, 1) of that camera */
    double at[3];             /* world */
    double inverse, variance; /* of SF_LANDMARK_NEW: inverse z in that camera */
    double off_u, off_v;      /* of SF_LANDMARK_NEW: where it was seen from where it was expected */
    int misses, searches, finds;
    uint32_t observations; /* in keyframes */
} sf_landmark;

/* A landmark searched for in the picture. */
typedef struct sf_landmark_match {
    size_t landmark;
    sf_landmark_state state; /* of the landmark when the search was planned */
    uint32_t observations;   /* of the landmark then */
    double back[4];          /* displacements in the picture to those in its patch */
    double u, v;
    int found, misled; /* misled: it agrees with no pose that the others do */
} sf_landmark_match;

/* A landmark seen at a pixel of a keyframe; both by index. */
typedef struct sf_landmark_observation {
    size_t keyframe, landmark;
    double u, v;
} sf_landmark_observation;

typedef struct sf_landmark_keyframe {
    uint32_t id;
    sf_bundle_view view;
} sf_landmark_keyframe;

typedef struct sf_landmarks {
    sf_context *ctx;
    sf_landmark *all;
    size_t count, capacity;
    sf_landmark_keyframe *keyframes;
    size_t keyframe_count, keyframe_capacity;
    sf_landmark_observation *observations;
    size_t observation_count, observation_capacity;

    /* Of the picture. */
    sf_bundle_view view;
    int width, height;
    sf_pyramid pyramid;
    float *cornerness; /* [height][width], of the last keyframe */
    size_t cornerness_capacity;
    sf_landmark_match *matches;
    size_t match_count, match_capacity;
    int coarsest;      /* of the search in progress */
    double *distances; /* [matches] */
    size_t distance_capacity;
} sf_landmarks;

/* Fills in the place of a new landmark (world) for an inverse depth. */
void sf_landmark_place(const sf_landmarks *l, const sf_landmark *m, double inverse, double at[3]);

/* The cosine between the rays to a landmark from its first keyframe and from another camera. */
double sf_landmark_cosine(const sf_landmarks *l, const sf_landmark *m, const sf_rigid *pose);

/* Px: the side of the cells that landmarks are spread over. */
int sf_landmarks_cell(const sf_landmarks *l);

/* Whether a match counts for the pose: it was found, agrees with the others, and the landmark's place is
 * known. */
int sf_match_is_used(const sf_landmarks *l, const sf_landmark_match *match);

/* Px: the greatest residual that is no outlier, where residuals have this standard deviation. */
double sf_match_gate(double spread);

/* Drops the observations of landmarks that are gone, and counts the others anew. */
void sf_landmarks_drop_stale(sf_landmarks *l);

#endif
