/* frame_choice.h - which frames of a video are taken as photos (README.md, S.9). */
#ifndef SF_SFM_FRAME_CHOICE_H
#define SF_SFM_FRAME_CHOICE_H

#include <stddef.h>

#include "frame_motion.h"

/* How many frames a video is worth, whose picture has moved so far: one in 6 % of its longer side, but 100 to
 * 300; less where that would be more than one in 1 %. */
size_t sf_frames_wanted(double path);

/* Chooses up to `wanted` of `count` frames: the way is cut into so many equal parts, and of each the sharpest
 * frame is taken, those in the middle of it first. Parts in which there is no frame are left out. chosen
 * [wanted] ascends. Returns how many. */
size_t sf_frames_choose(const sf_frame_judged *frames, size_t count, size_t wanted, size_t *chosen);

#endif
