/* ffmpeg.h - the programs ffprobe and ffmpeg, which read videos: what a video is, and its frames. */
#ifndef SF_IO_FFMPEG_H
#define SF_IO_FFMPEG_H

#include <stdio.h>
#include <sys/types.h>

#include "../base/context.h"

/* Which lines of a frame were filmed first, of a video whose frames each hold two fields. */
typedef enum sf_first_field {
    SF_FIELD_NONE,    /* frames are whole */
    SF_FIELD_FLAGGED, /* each frame says it */
    SF_FIELD_TOP,     /* the upper one of each two */
    SF_FIELD_BOTTOM   /* the lower one */
} sf_first_field;

/* What ffprobe says of a video. */
typedef struct sf_film_facts {
    int width, height; /* px, as it is coded: before it is turned */
    int has_matrix;    /* whether it says how its colours are coded */
    int is_hdr;        /* of a high dynamic range (PQ or HLG) */
    sf_first_field first;
    int has_fields; /* whether each coded picture is one field: `height`, `frames` and `rate` are of two */
    double frames;  /* about; 0: not known */
    double rate;    /* frames a second, in the mean; 0: not known */
} sf_film_facts;

/* Interlaced video is told of. SF_ERR_IO: there is no such file, or no ffprobe; SF_ERR_FORMAT: no video
 * (sf_last_error says what ffprobe does). */
sf_status sf_ffmpeg_probe(sf_context *ctx, const char *video, sf_film_facts *facts);

/* The filter (libavfilter's text, at most `size` bytes of it) that reduces frames until no side is longer
 * than `side`, by swscale's flags `how`, with pixels that are not square made so. Returns its length. */
int sf_ffmpeg_scale(const sf_film_facts *facts, int side, const char *how, char *text, size_t size);

/* Frames as they come from ffmpeg. */
typedef struct sf_frame_pipe {
    sf_context *ctx;
    const char *video; /* the caller's */
    pid_t pid;
    FILE *frames, *errors; /* NULL: closed */
    int is_over;           /* ffmpeg has closed its end */
    uint8_t *pixels;       /* the frame: [height][width][channels] */
    size_t capacity;
    int width, height, channels; /* 1 or 3 */
} sf_frame_pipe;

/* Starts ffmpeg: each frame of the video, deinterlaced where the facts say that it holds fields, passes
 * through the filters (libavfilter's text), and comes as grey (channels 1) or RGB. SF_ERR_IO, SF_ERR_MEMORY.
 */
sf_status sf_frame_pipe_open(sf_frame_pipe *pipe, sf_context *ctx, const char *video,
                             const sf_film_facts *facts, const char *filters, int channels);

/* The next frame. SF_ERR_END: there is none; SF_ERR_FORMAT, SF_ERR_MEMORY. */
sf_status sf_frame_pipe_next(sf_frame_pipe *pipe);

/* Ends ffmpeg, which may not be done. *fault [size]: its first line of errors, "" if it had none. */
void sf_frame_pipe_close(sf_frame_pipe *pipe, char *fault, size_t size);

#endif
