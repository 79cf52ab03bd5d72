/* video.h - pictures as an uncompressed stream, YUV4MPEG2, which ffmpeg, GStreamer and players read. */
#ifndef SPLATFIT_VIDEO_H
#define SPLATFIT_VIDEO_H

#include <stdint.h>

#include "context.h"
#include "source.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A film that is being written. */
typedef struct sf_video sf_video;

/* How much of the colour is kept beside the brightness. */
typedef enum sf_video_chroma {
    SF_VIDEO_420, /* one sample for 2 x 2 px, at their middle (C420jpeg): the mean of those that there are
                     where a side is odd */
    SF_VIDEO_444  /* one for each px (C444) */
} sf_video_chroma;

/* Start from sf_video_options_default(). */
typedef struct sf_video_options {
    int32_t width, height;  /* px, 1..65535, at most 2^28 px */
    int32_t rate, per;      /* frames a second: rate / per, both 1..1000000 */
    sf_video_chroma chroma; /* how much of the colour is kept */
    sf_yuv_matrix matrix;   /* SF_YUV_601 or SF_YUV_709. The stream has no field for it: say it to what reads
                               (ffmpeg takes 601 where nothing is said; pipe: from 720 lines on 709) */
} sf_video_options;

/* 640 x 480, 30 frames a second, 4:2:0, BT.601. */
SF_API sf_video_options sf_video_options_default(void);

/* Begins a stream at `path`: a file is written under a temporary name until sf_video_close, "-" (standard
 * output), a device and a pipe directly. Values are of 8 bits and limited range, Y 16..235 and chroma
 * 16..240, which the header says (XCOLORRANGE=LIMITED). SF_ERR_ARGUMENT: an option out of its range, named;
 * SF_ERR_IO; SF_ERR_MEMORY. On failure *video is NULL. */
SF_API sf_status sf_video_open(sf_context *context, const char *path, const sf_video_options *options,
                               sf_video **video);

/* Adds a picture, [height][width][3], sRGB values, clamped to 0..1. SF_ERR_IO: it cannot be written, now or
 * before: nothing more is. */
SF_API sf_status sf_video_add(sf_video *video, const float *rgb);

/* Ends the stream, renames a file to its name, sets *video to NULL. SF_ERR_IO: a picture could not be
 * written, and what stood at the path still stands. sf_video_abandon leaves nothing of a file behind. NULL is
 * allowed. */
SF_API sf_status sf_video_close(sf_video **video);
SF_API void sf_video_abandon(sf_video **video);

#ifdef __cplusplus
}
#endif
#endif
