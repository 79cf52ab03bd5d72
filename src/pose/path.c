/* path.c - poses from outside: a table of timed poses, from a file or as they arrive. */
#include "path.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "../base/clock.h"
#include "../base/file.h"
#include "../base/query.h"
#include "../base/wait.h"

static const uint64_t MOST_BYTES = (uint64_t)1 << 30;
static const int64_t RESTART_NS = 1000000000;
enum { LONGEST_WAIT_MS = 10000 };

/* 1. The table */

static sf_timed_pose *pose_at(const sf_path *path, size_t i) {
    return &path->poses[(path->first + i) % path->room];
}

/* What becomes of a pose: SF_OK: it is in the table; SF_ERR_END: of the last one's time; SF_ERR_FORMAT:
 * before it. */
static sf_status append(sf_path *path, const sf_timed_pose *pose) {
    const sf_timed_pose *last = path->count ? pose_at(path, path->count - 1) : NULL;
    if (last && pose->time_ns == last->time_ns) return SF_ERR_END;
    if (last && pose->time_ns < last->time_ns) return SF_ERR_FORMAT;
    if (path->count == path->room)
        path->first = (path->first + 1) % path->room;
    else
        path->count++;
    *pose_at(path, path->count - 1) = *pose;
    path->taken++;
    return SF_OK;
}

/* From the sender's frame and clock to the camera's and the caller's. */
static void bring_home(const sf_path *path, int64_t now_ns, sf_timed_pose *pose) {
    sf_timed_pose_join(pose, &path->rig, pose);
    pose->time_ns = (path->clock == SF_PATH_ARRIVAL ? now_ns : pose->time_ns) + path->offset_ns;
}

void sf_path_take_line(sf_path *path, const char *line, uint64_t number, int64_t now_ns) {
    sf_timed_pose pose;
    char fault[SF_POSE_FAULT];
    sf_status status = sf_pose_line_read(line, &pose, fault);
    if (status == SF_ERR_EMPTY) return;
    pthread_mutex_lock(&path->lock);
    if (status != SF_OK && path->malformed++ == 0)
        snprintf(path->report, sizeof path->report,
                 "line %llu: %s; more of these are left out without a word", (unsigned long long)number,
                 fault);
    if (status == SF_OK) {
        bring_home(path, now_ns, &pose);
        if (path->count && pose.time_ns < pose_at(path, path->count - 1)->time_ns - RESTART_NS)
            path->count = 0, path->restarted++;
        status = append(path, &pose);
        path->repeated += status == SF_ERR_END;
        path->late += status == SF_ERR_FORMAT;
        pthread_cond_broadcast(&path->arrived);
    }
    pthread_mutex_unlock(&path->lock);
}

/* Says what the listening thread found: on a thread of the caller's, as all of the log. */
static void report(sf_path *path) {
    char text[sizeof path->report];
    pthread_mutex_lock(&path->lock);
    memcpy(text, path->report, sizeof text);
    path->report[0] = 0;
    pthread_mutex_unlock(&path->lock);
    if (text[0]) sf_log(path->ctx, SF_LOG_WARNING, "%s: %s", path->name, text);
}

/* The place of the first pose at `time_ns` or after it; the count: there is none. */
static size_t find(const sf_path *path, int64_t time_ns) {
    size_t low = 0, high = path->count;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (pose_at(path, middle)->time_ns < time_ns)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Looks a time up; NULL, or why there is no pose. */
static const char *look_up(const sf_path *path, int64_t time_ns, sf_timed_pose *pose) {
    size_t at = find(path, time_ns);
    if (path->count == 0) return "there is no pose yet";
    if (at == path->count) return "is after the last pose";
    if (pose_at(path, at)->time_ns == time_ns) {
        *pose = *pose_at(path, at);
        return NULL;
    }
    if (at == 0) return "is before the first pose";
    const sf_timed_pose *a = pose_at(path, at - 1), *b = pose_at(path, at);
    if (b->time_ns - a->time_ns > path->gap_ns) return "lies in a gap between poses";
    sf_timed_pose_between(a, b, time_ns, pose);
    return NULL;
}

sf_status sf_path_at(sf_path *path, int64_t time_ns, double R_cw[9], double t_cw[3]) {
    sf_timed_pose pose;
    report(path);
    pthread_mutex_lock(&path->lock);
    const char *why = look_up(path, time_ns, &pose);
    pthread_mutex_unlock(&path->lock);
    if (why)
        return sf_fail(path->ctx, SF_ERR_EMPTY, "%s: time: %.6f s: %s", path->name, (double)time_ns * 1e-9,
                       why);
    sf_timed_pose_view(&pose, R_cw, t_cw);
    return SF_OK;
}

sf_status sf_path_wait(sf_path *path, int64_t time_ns, int timeout_ms) {
    if (timeout_ms < 0 || timeout_ms > LONGEST_WAIT_MS) timeout_ms = LONGEST_WAIT_MS;
    int64_t deadline = sf_clock_ns() + (int64_t)timeout_ms * 1000000;
    int in_time = 1, there = 0;
    report(path);
    pthread_mutex_lock(&path->lock);
    for (;;) {
        there = find(path, time_ns) < path->count;
        if (there || !in_time || !path->live) break;
        in_time = sf_condition_wait(&path->arrived, &path->lock, deadline);
    }
    pthread_mutex_unlock(&path->lock);
    if (there) return SF_OK;
    if (!path->live)
        return sf_fail(path->ctx, SF_ERR_EMPTY, "%s: time: %.6f s: is after the last pose", path->name,
                       (double)time_ns * 1e-9);
    return sf_fail(path->ctx, SF_ERR_TIMEOUT, "%s: no pose of %.6f s or later within %d ms", path->name,
                   (double)time_ns * 1e-9, timeout_ms);
}

void sf_path_describe(sf_path *path, sf_path_info *info) {
    memset(info, 0, sizeof *info);
    report(path);
    snprintf(info->name, sizeof info->name, "%.127s", path->name);
    info->live = path->live;
    pthread_mutex_lock(&path->lock);
    info->poses = path->taken;
    info->malformed = path->malformed;
    info->repeated = path->repeated;
    info->late = path->late;
    info->restarted = path->restarted;
    if (path->count) {
        info->first_ns = pose_at(path, 0)->time_ns;
        info->last_ns = pose_at(path, path->count - 1)->time_ns;
    }
    pthread_mutex_unlock(&path->lock);
}

/* 2. Files */

/* One line of a file, ended by 0. */
static sf_status take_from_file(sf_path *path, const char *line, size_t number) {
    sf_timed_pose pose;
    char fault[SF_POSE_FAULT];
    sf_status status = sf_pose_line_read(line, &pose, fault);
    if (status == SF_ERR_EMPTY) return SF_OK;
    if (status != SF_OK)
        return sf_fail(path->ctx, SF_ERR_FORMAT, "%s: line %zu: %s", path->name, number, fault);
    if (path->count == path->room) {
        status = sf_grow(path->ctx, &path->poses, &path->room, path->count, path->count + 1, sizeof pose);
        if (status != SF_OK) return status;
    }
    bring_home(path, 0, &pose);
    status = append(path, &pose);
    path->repeated += status == SF_ERR_END;
    if (status != SF_ERR_FORMAT) return SF_OK;
    return sf_fail(path->ctx, SF_ERR_FORMAT, "%s: line %zu: time: %.9g s: is before that of the pose before",
                   path->name, number, (double)(pose.time_ns - path->offset_ns) * 1e-9);
}

static sf_status read_file(sf_path *path, const char *where) {
    uint8_t *data;
    size_t size, number = 1;
    sf_status status = sf_read_text(path->ctx, where, MOST_BYTES, &data, &size);
    if (status != SF_OK) return status;
    for (size_t at = 0; at < size && status == SF_OK; number++) {
        const uint8_t *end = memchr(data + at, '\n', size - at);
        size_t next = end ? (size_t)(end - data) : size;
        data[next] = 0; /* there is one byte more than size */
        if (memchr(data + at, 0, next - at))
            status = sf_fail(path->ctx, SF_ERR_FORMAT, "%s: line %zu: holds a 0", path->name, number);
        else
            status = take_from_file(path, (const char *)data + at, number);
        at = next + 1;
    }
    sf_free(path->ctx, data);
    if (status == SF_OK && path->count == 0)
        return sf_fail(path->ctx, SF_ERR_EMPTY, "%s: holds no pose", path->name);
    return status;
}

/* 3. Opening */

static sf_status read_clock(sf_path *path, const char *name, const char *text) {
    struct timespec now;
    path->clock = strcmp(text, "unix") == 0      ? SF_PATH_UNIX
                  : strcmp(text, "arrival") == 0 ? SF_PATH_ARRIVAL
                                                 : SF_PATH_OWN;
    if (path->clock == SF_PATH_OWN && strcmp(text, "own") != 0)
        return sf_fail(path->ctx, SF_ERR_ARGUMENT, "%s: clock: \"%s\" is none of own, unix, arrival", name,
                       text);
    if (path->clock != SF_PATH_OWN && strncmp(name, "file:", 5) == 0)
        return sf_fail(path->ctx, SF_ERR_ARGUMENT, "%s: clock: %s is for poses that arrive", name, text);
    if (path->clock == SF_PATH_UNIX) {
        clock_gettime(CLOCK_REALTIME, &now);
        path->offset_ns += sf_clock_ns() - ((int64_t)now.tv_sec * 1000000000 + now.tv_nsec);
    }
    return SF_OK;
}

/* "tx,ty,tz,qx,qy,qz,qw" as a line without its time. */
static sf_status read_rig(sf_path *path, const char *name, const char *text) {
    char line[SF_PATH_NAME], fault[SF_POSE_FAULT];
    snprintf(line, sizeof line, "0,%s", text);
    sf_status status = sf_pose_line_read(line, &path->rig, fault);
    if (status == SF_OK) return SF_OK;
    return sf_fail(path->ctx, SF_ERR_ARGUMENT, "%s: rig: %s", name, fault);
}

static sf_status read_options(sf_path *path, const char *name) {
    enum { GAP, OFFSET, CLOCK, RIG, OPTIONS };
    char clock[16] = "own", rig[256] = "0,0,0,0,0,0,1";
    sf_query_option options[OPTIONS] = {
        [GAP] = {.name = "gap", .value = 0.2, .least = 0, .most = 3600},
        [OFFSET] = {.name = "offset", .least = -9e9, .most = 9e9},
        [CLOCK] = {.name = "clock", .text = clock, .text_size = sizeof clock},
        [RIG] = {.name = "rig", .text = rig, .text_size = sizeof rig},
    };
    sf_status status = sf_query_parse(path->ctx, name, options, OPTIONS);
    if (status != SF_OK) return status;
    path->gap_ns = llround(options[GAP].value * 1e9);
    path->offset_ns = llround(options[OFFSET].value * 1e9);
    status = read_clock(path, name, clock);
    return status == SF_OK ? read_rig(path, name, rig) : status;
}

static sf_status fill(sf_path *path, const char *name) {
    char where[SF_PATH_NAME];
    const char *colon = strchr(name, ':');
    size_t scheme = colon ? (size_t)(colon - name) : 0, length = strcspn(name, "?");
    int file = scheme == 4 && memcmp(name, "file", 4) == 0;
    int known =
        file || (scheme == 4 && memcmp(name, "unix", 4) == 0) || (scheme == 3 && memcmp(name, "udp", 3) == 0);
    if (!known || scheme > length)
        return sf_fail(path->ctx, SF_ERR_ARGUMENT,
                       "%s: unknown source of poses; known: file: unix: udp:", name);
    if (length >= sizeof where)
        return sf_fail(path->ctx, SF_ERR_ARGUMENT, "%.100s...: the name is too long", name);
    snprintf(where, sizeof where, "%.*s", (int)(length - scheme - 1), colon + 1);
    snprintf(path->name, sizeof path->name, "%.*s", (int)length, name);
    if (file) memcpy(path->name, where, length - scheme);
    sf_status status = read_options(path, name);
    if (status != SF_OK || file) return status == SF_OK ? read_file(path, where) : status;
    path->poses = sf_alloc(path->ctx, path->room = SF_PATH_KEPT, sizeof *path->poses);
    if (!path->poses) return SF_ERR_MEMORY;
    return sf_path_listen(path, scheme == 3 ? "udp" : "unix", where);
}

sf_status sf_path_open(sf_context *ctx, const char *name, sf_path **path) {
    sf_path *p = *path = sf_calloc(ctx, 1, sizeof *p);
    if (!p) return SF_ERR_MEMORY;
    p->ctx = ctx;
    p->socket = p->stop[0] = p->stop[1] = -1;
    for (int i = 0; i < SF_PATH_SENDERS; i++) p->senders[i].fd = -1;
    pthread_mutex_init(&p->lock, NULL);
    sf_condition_init(&p->arrived);
    sf_status status = fill(p, name);
    if (status != SF_OK) sf_path_close(path);
    return status;
}

void sf_path_close(sf_path **path) {
    sf_path *p = *path;
    if (!p) return;
    sf_path_deafen(p);
    pthread_cond_destroy(&p->arrived);
    pthread_mutex_destroy(&p->lock);
    sf_free(p->ctx, p->poses);
    sf_free(p->ctx, p->buffer);
    sf_free(p->ctx, p);
    *path = NULL;
}
