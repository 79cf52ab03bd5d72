/* path.h - the inside of paths: a table of timed poses that may grow while it is read. */
#ifndef SF_POSE_PATH_H
#define SF_POSE_PATH_H

#include <pthread.h>

#include "../base/context.h"
#include "pose_line.h"

#include <splatfit/path.h>

enum { SF_PATH_KEPT = 4096, SF_PATH_SENDERS = 8, SF_PATH_NAME = 512 };

/* Which clock the times of lines are of. */
typedef enum sf_path_clock {
    SF_PATH_OWN,    /* the caller's, but for the offset */
    SF_PATH_UNIX,   /* seconds since 1970, brought to the monotonic clock */
    SF_PATH_ARRIVAL /* none: a pose is of the time when it arrives */
} sf_path_clock;

/* Bytes on their way to lines. */
typedef struct sf_path_sender {
    int fd; /* -1: none */
    char line[SF_POSE_LINE];
    size_t used;
    int too_long; /* the rest of the line is passed over */
    uint64_t lines;
} sf_path_sender;

struct sf_path {
    sf_context *ctx;
    char name[SF_PATH_NAME];
    sf_path_clock clock;
    int64_t gap_ns, offset_ns; /* offset: from the times of lines to the caller's */
    sf_timed_pose rig;         /* the camera in the frame whose poses come */
    /* Under the lock: */
    pthread_mutex_t lock;
    pthread_cond_t arrived;
    sf_timed_pose *poses; /* a ring of `room` */
    size_t first, count, room;
    uint64_t taken, malformed, repeated, late, restarted;
    char report[SF_POSE_FAULT + 64]; /* for the log, at the next call; "": nothing */
    /* Sockets: */
    int live, socket, stop[2]; /* -1: none */
    int datagrams;
    char socket_path[108];
    pthread_t thread;
    int has_thread;
    char *buffer;
    sf_path_sender senders[SF_PATH_SENDERS];
};

/* Takes a line that arrived, ended by 0: into the table, or into the counts. */
void sf_path_take_line(sf_path *path, const char *line, uint64_t number, int64_t now_ns);

/* Opens what `where` says after "unix:" or "udp:" and starts to listen; the sockets are the path's, also
 * after a failure. */
sf_status sf_path_listen(sf_path *path, const char *scheme, const char *where);
/* Ends the thread and closes the sockets. */
void sf_path_deafen(sf_path *path);

#endif
