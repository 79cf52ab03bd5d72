/* pipe.h - frames from a pipe or file: "pipe:-" (standard input), "pipe:PATH". */
#ifndef SF_CAPTURE_PIPE_H
#define SF_CAPTURE_PIPE_H

#include "source_ops.h"

/* Opens the source for sf_source_open. Options: size, format, fps, live, matrix, range. */
sf_status sf_pipe_open(sf_context *ctx, const char *name, sf_source *source);

#endif
