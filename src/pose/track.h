/* track.h - the pose of a picture against the model itself (README, P.7). */
#ifndef SF_POSE_TRACK_H
#define SF_POSE_TRACK_H

#include <splatfit/camera.h>
#include <splatfit/model.h>
#include <splatfit/render.h>

#include "view.h"

/* A pose that is known from elsewhere, as well as it is known. */
typedef struct sf_track_prior {
    sf_rigid pose;                           /* world to camera */
    double information[SF_TWIST * SF_TWIST]; /* inverse covariance of its left twist: world units, radians */
} sf_track_prior;

typedef struct sf_track {
    sf_rigid pose;                          /* world to camera */
    double covariance[SF_TWIST * SF_TWIST]; /* of its left twist */
    double gain, bias;                      /* the picture is gain x render + bias, in grey, 0..1 */
    double depth;                           /* mean, of what was compared, world units */
    double rms;                             /* of the differences, where both agree */
    double detail; /* of the picture, in that of the render: mean square differences of neighbours; falls with
                      blur */
    double seen;   /* the share of the picture that the model fills, 0..1 */
    double agreement; /* correlation of picture and render there, -1..1; 0 where nothing is to be compared */
} sf_track;

typedef struct sf_tracker sf_tracker;

/* A tracker keeps its memory from picture to picture. One thread at a time may use it. */
sf_status sf_tracker_create(sf_context *ctx, sf_tracker **tracker);
void sf_tracker_destroy(sf_tracker **tracker);

/* The picture to place: `camera` has its size and intrinsics, rgb planes of height x stride floats, 0..1. */
sf_status sf_tracker_take(sf_tracker *tracker, const sf_camera *camera, float *const rgb[3], size_t stride);

/* How good a guess is: by so many halvings of the picture it begins. */
typedef enum sf_track_guess {
    SF_GUESS_CLOSE, /* less than a pixel off: at the finest size alone, from one drawing */
    SF_GUESS_NEAR,  /* some pixels */
    SF_GUESS_FAR    /* many */
} sf_track_guess;

/* Looks for the pose from which the model looks like the picture, from `guess` on. prior: NULL, or what else
 * is known. What came out is for the caller to trust or not: by agreement and seen. SF_ERR_MEMORY. */
sf_status sf_track_picture(sf_tracker *tracker, const sf_model *model, const sf_render_options *options,
                           const sf_rigid *guess, const sf_track_prior *prior, sf_track_guess how,
                           sf_track *track);

#endif
