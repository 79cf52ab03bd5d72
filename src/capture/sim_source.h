/* sim_source.h - "sim:...": the simulated camera (src/sim) as a source of frames. */
#ifndef SF_CAPTURE_SIM_SOURCE_H
#define SF_CAPTURE_SIM_SOURCE_H

#include "source_ops.h"

/* Opens the source for sf_source_open. */
sf_status sf_sim_open(sf_context *ctx, const char *name, sf_source *source);

#endif
