/* frame_quality.h - whether a frame shows anything, and is as sharp as the frames before. */
#ifndef SF_LIVE_FRAME_QUALITY_H
#define SF_LIVE_FRAME_QUALITY_H

#include <splatfit/live.h>

#include "../pose/track.h"
#include "frame_grabber.h"

/* Blurred or blank frames one after another, until a warning is logged. */
enum { SF_TROUBLE_FRAMES = 3 };

/* Averages are moving averages (EMA) over the frames that are not blurred; 0: none yet. */
typedef struct sf_frame_quality {
    double sharpness, usual_sharpness; /* of the frame, as sf_picture_sharpness; its average */
    double relative_sharpness;         /* of the frame, to the average before it */
    double usual_detail;               /* average of sf_track.detail */
    int blurred, blank;                /* frames one after another, up to this one */
    sf_live_trouble trouble;
} sf_frame_quality;

/* Mean square of the Laplacian of grey over 2 x 2 pixels, relative to the variance of grey: brightness does
 * not matter. */
double sf_picture_sharpness(const sf_picture *picture);

/* Standard deviation of the greys, 0..1, of means over a 32nd of the width and a 24th of the height: without
 * the noise. */
double sf_picture_contrast(const sf_picture *picture);

/* Decides whether the frame is blurred, from its sharpness and, where it was tracked, the detail in that of
 * the model (NULL: it was not), and updates the averages. */
void sf_judge_sharpness(sf_frame_quality *quality, const sf_track *track);

/* Sets `trouble`, and logs a warning when it begins. */
void sf_note_trouble(sf_context *ctx, sf_frame_quality *quality);

#endif
