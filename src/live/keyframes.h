/* keyframes.h - the frames that are fitted, and what is known of each. */
#ifndef SF_LIVE_KEYFRAMES_H
#define SF_LIVE_KEYFRAMES_H

#include <splatfit/live.h>

#include "../pose/view.h"
#include "frame_grabber.h"

enum {
    SF_THUMBNAIL_WIDTH = 32,
    SF_THUMBNAIL_HEIGHT = 24,
    SF_THUMBNAIL = SF_THUMBNAIL_WIDTH * SF_THUMBNAIL_HEIGHT
};

/* The picture of a keyframe is a view of the scene. */
typedef struct sf_keyframe {
    uint32_t id;                   /* of the view */
    int held_out;                  /* never trained on */
    int hold, told;                /* its pose is to be held; the fit knows of it */
    int searched;                  /* for points */
    double light;                  /* as sf_picture has it */
    sf_rigid pose;                 /* world to camera, as it is known by now */
    double center[3];              /* of the camera */
    float thumbnail[SF_THUMBNAIL]; /* grey, mean 0, norm 1 */
    double psnr, psnr_corrected;   /* dB, when last evaluated; NAN */
} sf_keyframe;

typedef struct sf_keyframes {
    sf_keyframe *list; /* oldest first */
    size_t count, capacity;
    int64_t made;        /* so far, those included that made room for others */
    int wanted;          /* the camera is far enough from all of them for another one, */
    double wanted_since; /* since this time of the frames' clock, s */
} sf_keyframes;

/* Takes the frame as a keyframe where the camera is far enough from all others and the frame is good enough.
 * *taken: whether. */
sf_status sf_live_offer_keyframe(sf_live *live, int *taken);
/* The camera of the frames, at a pose. */
sf_camera sf_live_camera_at(const sf_live *live, const sf_rigid *pose);
/* Begins the fit when there are keyframes from enough places. */
sf_status sf_live_begin(sf_live *live);

/* keyframe_exposure.c */
/* Tells the fit which poses to hold, and which exposures to start with, as soon as it has taken up the views.
 */
void sf_live_tell_fit(sf_live *live);
/* A keyframe's exposure as it is known by now: what the fit learned; before that what its light says, or the
 * exposures of its neighbours. */
void sf_live_exposure(const sf_live *live, uint32_t id, double gain[3], double bias[3]);
/* The mean of what the fit learned of the training keyframes before and after keyframe `at`, in the light
 * that this one had. 0, and nothing changes: there are none. */
int sf_neighbours_exposure(const sf_keyframes *keyframes, const sf_fitter *fitter, size_t at, double gain[3],
                           double bias[3]);

#endif
