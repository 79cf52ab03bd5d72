/* frame_motion.h - how sharp a frame of a video is, and how far the picture has moved since its beginning
 * (README.md, S.9). */
#ifndef SF_SFM_FRAME_MOTION_H
#define SF_SFM_FRAME_MOTION_H

#include "../base/context.h"

/* What is known of a frame. */
typedef struct sf_frame_judged {
    double sharpness; /* greater is sharper; of frames that show the same */
    double path;      /* how far the picture has moved until here, in the longer side of the picture */
} sf_frame_judged;

/* The mean square of the Laplacian over the variance; 0 for pictures without any, or of less than 8 px. */
double sf_frame_sharpness(const uint8_t *pixels, int width, int height);

/* The mean way that blocks of picture a have moved in picture b, px: up to SF_FRAME_REACH in x and in y.
 * Blocks without texture are left out; 0 where all are, SF_FRAME_REACH where few are found again. */
enum { SF_FRAME_REACH = 12, SF_FRAME_BLOCK = 16 };
double sf_frame_displacement(const uint8_t *a, const uint8_t *b, int width, int height);

/* Frames in their order. The way is measured from a frame that stays the same until the picture has moved
 * away from it, so that slow motion is not lost among pixels. */
typedef struct sf_frame_judge {
    sf_context *ctx;
    uint8_t *anchor, *frame; /* reduced */
    int width, height;       /* of both, px; 0: none */
    double path;             /* until the anchor */
    double last;             /* until the last frame */
} sf_frame_judge;

void sf_frame_judge_begin(sf_frame_judge *judge, sf_context *ctx);
void sf_frame_judge_end(sf_frame_judge *judge);

/* The next frame, grey, rows without gaps. SF_ERR_MEMORY. */
sf_status sf_frame_judge_next(sf_frame_judge *judge, const uint8_t *pixels, int width, int height,
                              sf_frame_judged *judged);

#endif
