/* path.h - poses from outside: where a robot, a tracker or another program says that the camera was.
 *
 * A path is opened by a name, SCHEME:WHERE?option=value&option=value:
 *     file:poses.txt          unix:/run/robot.sock?clock=unix          udp:127.0.0.1:5555?offset=0.012
 * Poses are lines of the TUM RGB-D benchmark's form, in a file or as they arrive:
 *     time tx ty tz qx qy qz qw
 * s, metres (or the world's unit) and a quaternion, camera to world: t is the camera's centre, its axes as in
 * camera.h. src/pose/README.md lists the options and what becomes of lines that are wrong, late or doubled.
 */
#ifndef SPLATFIT_PATH_H
#define SPLATFIT_PATH_H

#include <stdint.h>

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Poses over time, from a file or as they arrive. */
typedef struct sf_path sf_path;

/* What a path holds so far. */
typedef struct sf_path_info {
    char name[128];            /* for people; of udp: with the port that was taken */
    int live;                  /* poses arrive */
    uint64_t poses;            /* taken so far; the newest 4096 are kept where they arrive */
    uint64_t malformed;        /* lines that were no poses: left out, the first one named in the log */
    uint64_t repeated;         /* of the time of the pose before: left out */
    uint64_t late;             /* before the pose before: left out */
    uint64_t restarted;        /* times that the sender's clock went back by more than a second */
    int64_t first_ns, last_ns; /* of the poses that are kept, on the caller's clock; both 0: none */
} sf_path_info;

/* Opens a path. A file is read whole; SF_ERR_FORMAT names its line, field and value. unix: makes a stream
 * socket at the place, which must not be in use, for one sender or several; udp: binds an IPv4 address and
 * port (0: any). SF_ERR_ARGUMENT: unknown scheme or option, no address; SF_ERR_IO; SF_ERR_EMPTY: a file
 * without a pose; SF_ERR_MEMORY. */
SF_API sf_status sf_path_open(sf_context *context, const char *name, sf_path **path);
SF_API void sf_path_close(sf_path **path);
SF_API void sf_path_describe(sf_path *path, sf_path_info *info);

/* The camera's pose at a time, as sf_camera has it: p_c = R_cw p_w + t_cw, R_cw row-major. Between two poses
 * the centre moves evenly and the rotation turns evenly about one axis. SF_ERR_EMPTY: the time is before the
 * first pose or after the last, or the poses about it are further apart than the option gap. Any thread may
 * call it. */
SF_API sf_status sf_path_at(sf_path *path, int64_t time_ns, double R_cw[9], double t_cw[3]);

/* Waits until a pose at that time or after it has arrived, at most timeout_ms (0..10000; less than 0: 10000).
 * SF_ERR_TIMEOUT; SF_ERR_EMPTY: a file ends before. */
SF_API sf_status sf_path_wait(sf_path *path, int64_t time_ns, int timeout_ms);

#ifdef __cplusplus
}
#endif
#endif
