/* record_options.h - how a recording is written, and what became of its frames. */
#ifndef APP_RECORD_OPTIONS_H
#define APP_RECORD_OPTIONS_H

#include "app.h"

typedef enum record_format { RECORD_JPG, RECORD_PNG, RECORD_RAW } record_format;

typedef struct record_options {
    const char *folder, *source;
    sf_source_info info; /* of the source */
    record_format format;
    int quality, downscale;
    int every, sharpest; /* one of every so many frames: the first, or the sharpest */
    uint64_t most;       /* pictures; 0: no limit */
    const json_t *lens;  /* goes into frames.json; NULL: none */
    int force;           /* an older recording in the folder is removed */
} record_options;

/* What became of the frames that were put in. */
typedef struct record_counts {
    uint64_t put;
    uint64_t kept;        /* pictures written */
    uint64_t passed_over; /* another one of its group was kept, or none was wanted any more */
    uint64_t undecodable; /* JPEGs that cannot be decoded whole */
    uint64_t dropped;     /* not written: the queue was full, or writing failed */
} record_counts;

#endif
