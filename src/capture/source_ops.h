/* source_ops.h - the inside of sf_source: one small table of functions a scheme. */
#ifndef SF_CAPTURE_SOURCE_OPS_H
#define SF_CAPTURE_SOURCE_OPS_H

#include "../base/context.h"

#include <splatfit/source.h>

enum { SF_SOURCE_MAX_LEASES = 2 };

/* No wait is longer, whatever was asked for. */
enum { SF_SOURCE_LONGEST_WAIT_MS = 10000 };

/* What a scheme does for a source that it opened; `self` is its own. source.c checks arguments and counts
 * leases and frames given: next is called with fewer than SF_SOURCE_MAX_LEASES out and a timeout_ms that is
 * not negative, release once for each frame that next gave, close when all are back or forgotten. next fills
 * in a cleared frame (dmabuf -1) with a lease that is not NULL; `newest` as sf_source_newest asks. It adds
 * what it lost to `counts`, but for given. */
typedef struct sf_source_ops {
    void (*close)(void *self);
    void (*describe)(const void *self, sf_source_info *info);
    sf_status (*next)(void *self, int timeout_ms, int newest, sf_frame *frame, sf_source_counts *counts);
    void (*release)(void *self, sf_frame *frame);
    sf_status (*lock_exposure)(void *self, int locked); /* NULL: the source cannot be told */
} sf_source_ops;

struct sf_source {
    sf_context *ctx;
    const sf_source_ops *ops;
    void *self;
    const void *out[SF_SOURCE_MAX_LEASES]; /* leases of the frames that are out, NULL where none */
    sf_source_counts counts;
};

#endif
