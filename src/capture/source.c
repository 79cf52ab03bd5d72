/* source.c - opens frame sources by name and keeps count of the frames that are out. */
#include "source.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "folder.h"
#include "libcamera.h"
#include "pipe.h"
#include "sim.h"
#include "v4l2.h"

typedef struct scheme {
    const char *prefix;
    sf_status (*open)(sf_context *ctx, const char *name, sf_source *source);
} scheme;

static const scheme schemes[] = {{"v4l2:", sf_v4l2_open},
                                 {"libcamera:", sf_libcamera_open},
                                 {"folder:", sf_folder_open},
                                 {"pipe:", sf_pipe_open},
                                 {"sim:", sf_sim_open}};
enum { SCHEMES = sizeof schemes / sizeof *schemes };

static const scheme *scheme_of(const char *name) {
    for (size_t i = 0; i < SCHEMES; i++)
        if (strncmp(name, schemes[i].prefix, strlen(schemes[i].prefix)) == 0) return &schemes[i];
    return NULL;
}

static sf_status unknown(sf_context *ctx, const char *name) {
    char known[128] = "";
    for (size_t i = 0; i < SCHEMES; i++) {
        size_t used = strlen(known);
        snprintf(known + used, sizeof known - used, " %s", schemes[i].prefix);
    }
    return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: unknown source; known:%s", name, known);
}

sf_status sf_source_open(sf_context *ctx, const char *name, sf_source **source) {
    *source = NULL;
    const scheme *known = scheme_of(name);
    if (!known) return unknown(ctx, name);
    sf_source *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    s->ctx = ctx;
    sf_status status = known->open(ctx, name, s);
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

/* "ctrl." stands for ctrl.ANYTHING, which the scheme reads by itself. */
static int is_family(const sf_source_option *option) { return option->name[strlen(option->name) - 1] == '.'; }

static sf_source_option *find_option(sf_source_option *options, size_t count, const char *name,
                                     size_t length) {
    for (size_t i = 0; i < count; i++)
        if (strlen(options[i].name) == length && memcmp(options[i].name, name, length) == 0)
            return &options[i];
    for (size_t i = 0; i < count; i++)
        if (is_family(&options[i]) && strlen(options[i].name) < length &&
            memcmp(options[i].name, name, strlen(options[i].name)) == 0)
            return &options[i];
    return NULL;
}

/* Reads text up to `end` as a plain decimal number. */
static int parse_number(const char *text, const char *end, double *value) {
    char copy[32], *stop;
    size_t length = (size_t)(end - text);
    if (length == 0 || length >= sizeof copy || strspn(text, "0123456789.-") < length) return 0;
    memcpy(copy, text, length);
    copy[length] = 0;
    *value = strtod(copy, &stop);
    return *stop == 0;
}

static int in_range(const sf_source_option *option, double value) {
    return value >= option->least && value <= option->most &&
           !(option->whole && value != (double)(int64_t)value);
}

static sf_status take_text(sf_context *ctx, const char *source_name, const char *value, const char *end,
                           sf_source_option *option) {
    size_t length = (size_t)(end - value);
    if (length == 0 || length >= option->text_size)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: \"%.*s\" is not a text of 1 to %zu letters",
                       source_name, option->name, (int)length, value, option->text_size - 1);
    memcpy(option->text, value, length);
    option->text[length] = 0;
    return SF_OK;
}

/* Reads one "name=value" that ends at `end`. */
static sf_status parse_option(sf_context *ctx, const char *source_name, const char *text, const char *end,
                              sf_source_option *options, size_t count) {
    size_t length = strcspn(text, "=&");
    sf_source_option *option = find_option(options, count, text, length);
    if (!option)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: unknown option \"%.*s\"", source_name, (int)length, text);
    const char *value = text + length + (text[length] == '=');
    if (is_family(option)) return SF_OK;
    if (option->text) return take_text(ctx, source_name, value, end, option);
    double number;
    if (!parse_number(value, end, &number))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: \"%.*s\" is not a number", source_name, option->name,
                       (int)(end - value), value);
    if (!in_range(option, number))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: %.*s is not a%s number from %.16g to %.16g",
                       source_name, option->name, (int)(end - value), value, option->whole ? " whole" : "",
                       option->least, option->most);
    option->value = number;
    return SF_OK;
}

sf_status sf_source_parse_options(sf_context *ctx, const char *source_name, sf_source_option *options,
                                  size_t count) {
    const char *text = strchr(source_name, '?');
    while (text && *text) {
        text++; /* over ? or & */
        const char *end = text + strcspn(text, "&");
        sf_status status = parse_option(ctx, source_name, text, end, options, count);
        if (status != SF_OK) return status;
        text = end;
    }
    return SF_OK;
}
