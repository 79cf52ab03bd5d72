/* folder.h - the pictures of a folder as frames: "folder:DIR?option=value&...". */
#ifndef SF_CAPTURE_FOLDER_H
#define SF_CAPTURE_FOLDER_H

#include "source_ops.h"

/* Opens the source for sf_source_open. Options: fps, loop, decode. */
sf_status sf_folder_open(sf_context *ctx, const char *name, sf_source *source);

#endif
