/* live_source.h - what a live fit reads, and the project that it writes. */
#ifndef APP_LIVE_SOURCE_H
#define APP_LIVE_SOURCE_H

#include "app.h"

/* Opens the source that the command line names. A video or a folder whose frames do not come in real time is
 * followed frame by frame: `options` get steps_per_frame, lens and downscale where the command line names
 * none. 0 or an exit code. */
int live_open_source(const args *a, sf_context *ctx, sf_live_options *options, sf_source **source);

/* The project that --cameras names; NULL: it names none, or a cameras.json. */
const char *live_project(const args *a);
/* Whether a project can be written there. 0 or an exit code. */
int live_check_project(const args *a, const char *project);

#endif
