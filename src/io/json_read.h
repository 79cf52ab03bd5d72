/* json_read.h - files of JSON. */
#ifndef SF_IO_JSON_READ_H
#define SF_IO_JSON_READ_H

#include "../base/context.h"

#include <jansson.h>

/* The caller's reference, NULL after a failure: SF_ERR_IO, also more than `most` bytes; SF_ERR_FORMAT, naming
 * the line: not JSON. */
sf_status sf_json_read(sf_context *ctx, const char *file, uint64_t most, json_t **root);

#endif
