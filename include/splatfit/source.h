/* source.h - frames from a camera, a file or a simulation, one interface for all.
 *
 * A source is opened by a name: "sim:studio?width=320&height=240&frames=60&seed=1".
 */
#ifndef SPLATFIT_SOURCE_H
#define SPLATFIT_SOURCE_H

#include <stdint.h>

#include "camera.h"
#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sf_source sf_source;

typedef enum sf_pixel_format {
    SF_PIXEL_RGB24 /* 3 bytes a pixel: R, G, B; sRGB values */
} sf_pixel_format;

/* What a source gives. */
typedef struct sf_source_info {
    int32_t width, height; /* px */
    sf_pixel_format format;
    double frames_per_second; /* 0: unknown or not in real time */
    uint64_t frames;          /* 0: without end or unknown */
    int has_poses;            /* frames come with their true camera */
    char name[128];           /* for people */
} sf_source_info;

/* A frame is a lease: its memory stays valid until sf_source_release. */
typedef struct sf_frame {
    const uint8_t *data; /* first row */
    size_t stride;       /* bytes a row */
    int32_t width, height;
    sf_pixel_format format;
    uint64_t sequence;       /* the source's own count: a gap is a dropped frame */
    int64_t time_ns;         /* when it was taken; the monotonic clock for live sources, from 0 otherwise */
    double exposure_s, gain; /* 0: unknown */
    int has_camera;
    sf_camera camera; /* where has_camera */
    void *lease;      /* the source's own */
} sf_frame;

/* Opens a source by name. SF_ERR_ARGUMENT: unknown source or option, value out of range (named). */
SF_API sf_status sf_source_open(sf_context *context, const char *name, sf_source **source);
SF_API void sf_source_close(sf_source **source);
SF_API void sf_source_describe(const sf_source *source, sf_source_info *info);

/* The next frame, waiting at most timeout_ms (-1: as long as it takes). SF_ERR_TIMEOUT, SF_ERR_END. At most
 * two frames may be out at a time (SF_ERR_ARGUMENT). */
SF_API sf_status sf_source_next(sf_source *source, int timeout_ms, sf_frame *frame);

/* Gives a frame back. */
SF_API void sf_source_release(sf_source *source, sf_frame *frame);

#ifdef __cplusplus
}
#endif
#endif
