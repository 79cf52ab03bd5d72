/* memory.h - what the machine has left for this process, and what the process has taken. */
#ifndef SF_BASE_MEMORY_H
#define SF_BASE_MEMORY_H

#include <stdint.h>

#include "context.h"

/* Bytes that this process may still take before the machine or its control group runs out; 0: not known. */
uint64_t sf_memory_free(void);

/* Bytes that the process has resident now; 0: not known. */
uint64_t sf_memory_resident(void);

/* What the process may take altogether: `asked`, where that is 0 what it has and four fifths of what is left;
 * 0: not known. */
uint64_t sf_memory_budget(uint64_t asked);

/* Whether so many bytes, which `field` of the file at `path` asks for, fit into four fifths of what is left.
 * SF_ERR_MEMORY, with a message; less than 256 MiB is left to the allocator. */
sf_status sf_memory_check(sf_context *ctx, const char *path, const char *field, uint64_t bytes);

#endif
