/* frame_grabber.h - a thread that turns the frames of a source into pictures of a pinhole camera. */
#ifndef SF_LIVE_FRAME_GRABBER_H
#define SF_LIVE_FRAME_GRABBER_H

#include <splatfit/remap.h>
#include <splatfit/source.h>

#include "../base/context.h"
#include "../pose/patch.h"

/* A picture through a pinhole camera. */
typedef struct sf_picture {
    sf_camera camera; /* its size and intrinsics; the pose of none */
    float *rgb[3];    /* [height][width], 0..1 */
    float *weight;    /* [height][width], 0..1: what the lens shows; NULL: all */
    int64_t time_ns;
    double light; /* exposure times gain, s; 0: not known */
    uint64_t sequence;
    int is_lens_guessed; /* nobody knows the lens: `camera` has a guess */
    int has_truth;
    sf_camera truth; /* the frame's own camera, scaled to the picture */
} sf_picture;

/* Grey of a pixel, as sf_tracker_take has it. */
static inline float sf_picture_grey(const sf_picture *p, size_t at) {
    return sf_grey(p->rgb[0][at], p->rgb[1][at], p->rgb[2][at]);
}

typedef struct sf_frame_grabber sf_frame_grabber;

/* s: a warning is logged after this time without a frame. */
#define SF_FRAME_SILENCE 2.0

/* Takes frames of `source`, through `lens` (fx 0: their own, unless it is to be found, or a guess), smaller
 * by `downscale`, for who wants `rate` a second. Of a source in real time the newest waits, and older ones
 * are passed over; of another each waits for its turn. */
sf_status sf_frame_grabber_create(sf_context *ctx, sf_source *source, const sf_lens *lens, int find_lens,
                                  int downscale, double rate, sf_frame_grabber **grabber);
/* Waits for the thread to end: a fraction of a second. */
void sf_frame_grabber_destroy(sf_frame_grabber **grabber);

/* The newest picture, in place of the one taken last, which is the grabber's again; waits up to timeout_ms.
 * SF_ERR_TIMEOUT: none has come; SF_ERR_END, SF_ERR_IO, ...: none will come any more, why is in
 * sf_last_error. */
sf_status sf_frame_grabber_take(sf_frame_grabber *grabber, int timeout_ms, const sf_picture **picture);
/* As sf_source_lock_exposure, before the next frame. sf_frame_grabber_locked: whether it is, -1: the source
 * cannot be told. */
void sf_frame_grabber_lock(sf_frame_grabber *grabber, int locked);
int sf_frame_grabber_locked(sf_frame_grabber *grabber);

/* Whether one waits. */
int sf_frame_grabber_waits(sf_frame_grabber *grabber);

/* How long no frame has come, s; of a source that is not in real time, as it counts it. 0 before the first.
 */
double sf_frame_grabber_silent(sf_frame_grabber *grabber);

void sf_frame_grabber_count(sf_frame_grabber *grabber, sf_source_counts *counts, uint64_t *passed_over,
                            uint64_t *came);

#endif
