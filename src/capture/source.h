/* source.h - the inside of sf_source: one small table of functions a scheme. */
#ifndef SF_CAPTURE_SOURCE_H
#define SF_CAPTURE_SOURCE_H

#include "../base/context.h"

#include <splatfit/source.h>

enum { SF_SOURCE_MAX_LEASES = 2 };

/* What a scheme does for a source that it opened; `self` is its own. source.c checks arguments and counts
 * leases: next is called with fewer than SF_SOURCE_MAX_LEASES out, release once for each frame that next
 * gave, close when all are back or forgotten. next fills in a cleared frame. */
typedef struct sf_source_ops {
    void (*close)(void *self);
    void (*describe)(const void *self, sf_source_info *info);
    sf_status (*next)(void *self, int timeout_ms, sf_frame *frame);
    void (*release)(void *self, sf_frame *frame);
} sf_source_ops;

struct sf_source {
    sf_context *ctx;
    const sf_source_ops *ops;
    void *self;
    const void *out[SF_SOURCE_MAX_LEASES]; /* leases of the frames that are out, NULL where none */
};

/* A number among the options of a source's name, "...?name=value&...". */
typedef struct sf_source_option {
    const char *name;
    double value; /* the default, then what was asked for */
    double least, most;
    int whole; /* no fraction */
} sf_source_option;

/* Reads the options of `source_name` into the table; of an option named twice, the last counts.
 * SF_ERR_ARGUMENT: an option that is not in the table, not a number, out of range. */
sf_status sf_source_parse_options(sf_context *ctx, const char *source_name, sf_source_option *options,
                                  size_t count);

#endif
