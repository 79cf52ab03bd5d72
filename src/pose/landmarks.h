/* landmarks.h - points of the scene that picture after picture shows: followed from frame to frame, and kept
 * true to each other and to what is known from outside (README, P.8 and P.9). */
#ifndef SF_POSE_LANDMARKS_H
#define SF_POSE_LANDMARKS_H

#include "track.h"

typedef struct sf_landmarks sf_landmarks;

/* What landmarks say of a picture's pose. */
typedef struct sf_followed {
    sf_rigid pose;                           /* world to camera */
    double information[SF_TWIST * SF_TWIST]; /* inverse covariance of its left twist, the prior's not in it */
    double spread;                           /* of a coordinate, px */
    size_t used, expected; /* landmarks that agree; those of known places that should be seen */
} sf_followed;

sf_status sf_landmarks_create(sf_context *ctx, sf_landmarks **landmarks);
void sf_landmarks_destroy(sf_landmarks **landmarks);
/* Forgets all. */
void sf_landmarks_clear(sf_landmarks *landmarks);

/* The picture that the next calls are of: `camera` has its size and intrinsics, rgb planes of height x stride
 * floats, 0..1. */
sf_status sf_landmarks_take(sf_landmarks *landmarks, const sf_camera *camera, float *const rgb[3],
                            size_t stride);

/* Looks for the landmarks in the picture, near where a pose of `guess` would show them, and for the pose that
 * agrees with them and the prior (NULL: none). used 0: they tell nothing. SF_ERR_MEMORY. */
sf_status sf_landmarks_follow(sf_landmarks *landmarks, const sf_rigid *guess, const sf_track_prior *prior,
                              sf_followed *followed);

/* Tells the pose that the picture has, of all that is known: what was found elsewhere is no observation, and
 * depths are learned. */
void sf_landmarks_settle(sf_landmarks *landmarks, const sf_rigid *pose);

/* Makes the picture a keyframe: notes the observations, and takes up new landmarks where there are none, at
 * first at `distance`. known: its pose from outside, NULL: none. weight: [height][width], of pixels that
 * count, NULL: all do. SF_ERR_MEMORY: it is none. */
sf_status sf_landmarks_keep(sf_landmarks *landmarks, uint32_t id, const sf_rigid *pose,
                            const sf_track_prior *known, double distance, const float *weight);
/* Forgets a keyframe, if there is such a one, and what was first seen in it. */
void sf_landmarks_drop(sf_landmarks *landmarks, uint32_t id);

/* Moves the newest keyframe, up to `most` - 1 others that see the same, and their landmarks to where they
 * agree best. SF_ERR_MEMORY: all stay. */
sf_status sf_landmarks_adjust(sf_landmarks *landmarks, size_t most);

/* Moves all keyframes, all landmarks and the focal length that the keyframes share to where they agree best.
 * *zoom: the focal length, in what it was; 1: it stays, and so does all else. The next pictures must come
 * with it. SF_ERR_MEMORY: all stay. */
sf_status sf_landmarks_calibrate(sf_landmarks *landmarks, double *zoom);

/* The median depth of the landmarks of known place that a keyframe sees; 0: it sees none. SF_ERR_MEMORY. */
sf_status sf_landmarks_depth(const sf_landmarks *landmarks, uint32_t id, double *depth);

/* The pose of a keyframe; 0: there is no such one. */
int sf_landmarks_pose(const sf_landmarks *landmarks, uint32_t id, sf_rigid *pose);

#endif
