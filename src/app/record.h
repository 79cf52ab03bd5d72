/* record.h - writes frames as a folder of pictures, on a thread of its own: DIR/images, DIR/frames.json and,
 * where the cameras are known, DIR/transforms.json. */
#ifndef APP_RECORD_H
#define APP_RECORD_H

#include "app.h"

typedef enum record_format { RECORD_JPG, RECORD_PNG, RECORD_RAW } record_format;

typedef struct record_options {
    const char *folder, *source;
    sf_source_info info; /* of the source */
    record_format format;
    int quality, downscale;
    int every, sharpest; /* keep one of every `every` frames: the first, or the sharpest */
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

typedef struct record record;

/* Makes the folder and starts the thread. 0, or an exit code after one line on standard error; *record is
 * NULL then. */
int record_start(const args *a, const record_options *options, record **record);

/* Puts a frame in, in the order of the source; it may be released at once. Where the queue is full the frame
 * is dropped, or where the source is not live there is a wait. */
void record_put(record *record, const sf_frame *frame);

/* Whether one more frame is wanted: not after a failure, nor when all pictures that were asked for are
 * written. Waits where those on their way may be enough. */
int record_wants(record *record);

void record_count(record *record, record_counts *counts);

/* Writes what is on its way, then the lists, and frees the record. `totals` of the source go into
 * frames.json. 0, or an exit code after one line on standard error; what could be written is there then too.
 */
int record_finish(record **record, const sf_source_counts *totals, record_counts *counts);

#endif
