/* film.h - the frames of a video that ffmpeg, as a program, reads: "video:FILE?option=value&...". */
#ifndef SF_CAPTURE_FILM_H
#define SF_CAPTURE_FILM_H

#include "source_ops.h"

/* Opens the source for sf_source_open. Options: rate, side. */
sf_status sf_film_open(sf_context *ctx, const char *name, sf_source *source);

#endif
