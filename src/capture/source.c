/* source.c - opens frame sources by name and keeps count of the frames that are out. */
#include "source_ops.h"

#include <stdio.h>
#include <string.h>

#include "../io/no_project.h"
#include "../io/paths.h"
#include "film.h"
#include "folder.h"
#include "libcamera.h"
#include "pipe.h"
#include "sim_source.h"
#include "v4l2.h"

typedef struct scheme {
    const char *prefix;
    sf_status (*open)(sf_context *ctx, const char *name, sf_source *source);
} scheme;

static const scheme schemes[] = {{"v4l2:", sf_v4l2_open},     {"libcamera:", sf_libcamera_open},
                                 {"folder:", sf_folder_open}, {"video:", sf_film_open},
                                 {"pipe:", sf_pipe_open},     {"sim:", sf_sim_open}};
enum { SCHEMES = sizeof schemes / sizeof *schemes };

static const scheme *scheme_of(const char *name) {
    for (size_t i = 0; i < SCHEMES; i++)
        if (strncmp(name, schemes[i].prefix, strlen(schemes[i].prefix)) == 0) return &schemes[i];
    return NULL;
}

/* What a path without a scheme is: a video, or a folder of pictures. NULL: neither. *full (sf_free it): the
 * name with its scheme; NULL: no memory. */
static const scheme *scheme_of_path(sf_context *ctx, const char *name, char **full) {
    size_t length = strcspn(name, "?");
    char *path = sf_alloc(ctx, strlen(name) + sizeof "folder:", 1);
    const scheme *found = NULL;
    *full = path;
    if (!path) return NULL;
    snprintf(path, length + 1, "%s", name);
    if (sf_names_video(path))
        found = scheme_of("video:");
    else if (sf_is_folder(path))
        found = scheme_of("folder:");
    if (found) sprintf(path, "%s%s", found->prefix, name);
    return found;
}

static sf_status unknown(sf_context *ctx, const char *name) {
    char known[128] = "";
    for (size_t i = 0; i < SCHEMES; i++) {
        size_t used = strlen(known);
        snprintf(known + used, sizeof known - used, " %s", schemes[i].prefix);
    }
    return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: unknown source, and no video or folder; known:%s", name, known);
}

sf_status sf_source_open(sf_context *ctx, const char *name, sf_source **source) {
    *source = NULL;
    char *full = NULL;
    const scheme *known = scheme_of(name);
    if (!known) known = scheme_of_path(ctx, name, &full);
    sf_source *s = known ? sf_calloc(ctx, 1, sizeof *s) : NULL;
    sf_status status = SF_ERR_MEMORY;
    if (s) s->ctx = ctx, status = known->open(ctx, full ? full : name, s);
    if (!known && full) status = unknown(ctx, name);
    sf_free(ctx, full);
    if (status != SF_OK) {
        sf_free(ctx, s);
        return status;
    }
    *source = s;
    return SF_OK;
}

void sf_source_close(sf_source **source) {
    sf_source *s = *source;
    if (!s) return;
    s->ops->close(s->self);
    sf_free(s->ctx, s);
    *source = NULL;
}

void sf_source_count(const sf_source *source, sf_source_counts *counts) { *counts = source->counts; }

void sf_source_describe(const sf_source *source, sf_source_info *info) {
    memset(info, 0, sizeof *info);
    info->can_lock_exposure = source->ops->lock_exposure != NULL;
    source->ops->describe(source->self, info);
}

sf_status sf_source_lock_exposure(sf_source *source, int locked) {
    if (source->ops->lock_exposure) return source->ops->lock_exposure(source->self, locked);
    return sf_fail(source->ctx, SF_ERR_UNSUPPORTED,
                   "source: exposure: this kind has nothing that could be locked");
}

static const void **slot_of(sf_source *source, const void *lease) {
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++)
        if (source->out[i] == lease) return &source->out[i];
    return NULL;
}

static sf_status take(sf_source *source, int timeout_ms, int newest, sf_frame *frame) {
    memset(frame, 0, sizeof *frame);
    frame->dmabuf = -1;
    if (timeout_ms < -1)
        return sf_fail(source->ctx, SF_ERR_ARGUMENT, "source: timeout_ms: %d is less than -1", timeout_ms);
    const void **slot = slot_of(source, NULL);
    if (!slot)
        return sf_fail(source->ctx, SF_ERR_ARGUMENT, "source: %d frames are out: release one before the next",
                       SF_SOURCE_MAX_LEASES);
    if (timeout_ms < 0 || timeout_ms > SF_SOURCE_LONGEST_WAIT_MS) timeout_ms = SF_SOURCE_LONGEST_WAIT_MS;
    sf_status status = source->ops->next(source->self, timeout_ms, newest, frame, &source->counts);
    if (status != SF_OK) return status;
    *slot = frame->lease;
    source->counts.given++;
    return SF_OK;
}

sf_status sf_source_next(sf_source *source, int timeout_ms, sf_frame *frame) {
    return take(source, timeout_ms, 0, frame);
}

sf_status sf_source_newest(sf_source *source, int timeout_ms, sf_frame *frame) {
    return take(source, timeout_ms, 1, frame);
}

void sf_source_release(sf_source *source, sf_frame *frame) {
    const void **slot = frame->lease ? slot_of(source, frame->lease) : NULL;
    if (!slot) return;
    *slot = NULL;
    source->ops->release(source->self, frame);
    memset(frame, 0, sizeof *frame);
}
