/* memory.h - the available memory of the machine, and the resident memory of the process. */
#ifndef SF_BASE_MEMORY_H
#define SF_BASE_MEMORY_H

#include <stdint.h>

#include "context.h"

/* Bytes that this process may still take before the machine or its control group runs out; 0: not known. */
uint64_t sf_memory_free(void);

/* Bytes that the process has resident now; 0: not known. */
uint64_t sf_memory_resident(void);

/* Memory budget of the process: `asked`; if that is 0, its resident memory plus 80 % of the available memory;
 * 0 if unknown. */
uint64_t sf_memory_budget(uint64_t asked);

/* Checks that an allocation, whose size comes from `field` of the file at `path`, fits into 80 % of the
 * available memory. SF_ERR_MEMORY, with a message. Allocations below 256 MiB are not checked. */
sf_status sf_memory_check(sf_context *ctx, const char *path, const char *field, uint64_t bytes);

#endif
