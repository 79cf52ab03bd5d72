/* pace.h - frames that become due one after another on the monotonic clock, as those of a camera do. */
#ifndef SF_CAPTURE_PACE_H
#define SF_CAPTURE_PACE_H

#include "source_ops.h"

/* As many due frames wait to be taken, as in a driver's buffers; older ones are lost. */
enum { SF_PACE_WAITING = 4 };

typedef struct sf_pace {
    double fps;       /* 0: not in real time, a frame is due when it is asked for */
    uint64_t frames;  /* 0: without end */
    uint64_t next;    /* the frame that was neither given nor lost yet */
    int64_t start_ns; /* when frame 0 was due: when it was first asked for a frame; 0: not yet */
} sf_pace;

/* A frame that is due. */
typedef struct sf_pace_frame {
    uint64_t number;
    int64_t time_ns; /* when it was due, on the monotonic clock; not in real time: from 0 on, 30 a second */
} sf_pace_frame;

/* Nanoseconds from frame 0 to frame `number`. */
int64_t sf_pace_after(double fps, uint64_t number);

/* Sleeps until a time on the monotonic clock. */
void sf_pace_sleep_until(int64_t time_ns);

/* Chooses the next frame, or the newest that is due, waiting for it at most timeout_ms. What was lost or
 * passed over is added to `counts`. SF_ERR_TIMEOUT, SF_ERR_END: with a message that begins with `name`. */
sf_status sf_pace_next(sf_pace *pace, sf_context *ctx, const char *name, int timeout_ms, int newest,
                       sf_source_counts *counts, sf_pace_frame *frame);

#endif
