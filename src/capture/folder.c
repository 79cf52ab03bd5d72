/* folder.c - the pictures of a folder as frames. */
#include "folder.h"

#include <dirent.h>
#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "../base/clock.h"
#include "../base/file.h"
#include "../base/query.h"
#include "../io/picture.h"
#include "../io/paths.h"
#include "format.h"
#include "jpeg_cut.h"
#include "pace.h"

static const uint64_t MAX_LIST_BYTES = 1 << 27, MAX_JPEG_BYTES = 1 << 30; /* a list of 8 hours */

typedef struct picture_file {
    char *path;
    int listed; /* by frames.json, with what follows */
    uint64_t sequence;
    int64_t time_ns;
    double exposure_s, gain; /* 0: unknown */
} picture_file;

/* The pixels, or the JPEG, of one frame. */
typedef struct slot {
    int taken;
    uint8_t *data;
    size_t capacity;
} slot;

typedef struct folder_source {
    sf_context *ctx;
    char *name;   /* without options: "folder:DIR" */
    char *folder; /* as asked for */
    picture_file *files;
    size_t count, capacity;
    int decode, loop;
    sf_pace pace;
    int32_t width, height; /* px, of the first picture that has a size */
    sf_pixel_format format;
    slot slots[SF_SOURCE_MAX_LEASES];
} folder_source;

/* 1. Names */

static int in_order(const void *a, const void *b) {
    return sf_natural_order(((const picture_file *)a)->path, ((const picture_file *)b)->path);
}

static int ends_with(const char *name, const char *ending) {
    size_t length = strlen(name), n = strlen(ending);
    return length > n && !strcasecmp(name + length - n, ending);
}

static int is_jpeg_name(const char *name) { return ends_with(name, ".jpg") || ends_with(name, ".jpeg"); }

static int is_picture_name(const char *name) {
    return *name != '.' && (is_jpeg_name(name) || ends_with(name, ".png"));
}

/* 2. The list of pictures */

static sf_status add_file(folder_source *f, const char *folder, const char *name, picture_file **file) {
    sf_status status = sf_grow(f->ctx, &f->files, &f->capacity, f->count, f->count + 1, sizeof *f->files);
    if (status != SF_OK) return status;
    char *path = sf_path_join(f->ctx, folder, name);
    if (!path) return SF_ERR_MEMORY;
    *file = &f->files[f->count++];
    **file = (picture_file){.path = path};
    return SF_OK;
}

static sf_status list_folder(folder_source *f, const char *folder) {
    sf_status status = SF_OK;
    picture_file *file;
    DIR *dir = opendir(folder);
    if (!dir) return sf_fail(f->ctx, SF_ERR_IO, "%s: cannot be opened: %s", folder, strerror(errno));
    for (struct dirent *e; status == SF_OK && (e = readdir(dir));)
        if (is_picture_name(e->d_name) && sf_holds_file(folder, e->d_name))
            status = add_file(f, folder, e->d_name, &file);
    closedir(dir);
    if (f->count) qsort(f->files, f->count, sizeof *f->files, in_order);
    return status;
}

/* One entry of frames.json. */
typedef struct entry {
    sf_context *ctx;
    const char *list;
    size_t index;
    const json_t *json;
} entry;

static sf_status refuse(const entry *e, const char *key, const char *why) {
    return sf_fail(e->ctx, SF_ERR_FORMAT, "%s: frames[%zu]: %s: %s", e->list, e->index, key, why);
}

/* *value stays as it is where the key is missing. */
static sf_status get_count(const entry *e, const char *key, int64_t *value) {
    const json_t *number = json_object_get(e->json, key);
    if (!number) return SF_OK;
    if (!json_is_integer(number) || json_integer_value(number) < 0)
        return refuse(e, key, "is not a whole number from 0");
    *value = json_integer_value(number);
    return SF_OK;
}

static sf_status get_amount(const entry *e, const char *key, double *value) {
    const json_t *number = json_object_get(e->json, key);
    if (!number) return SF_OK;
    if (!json_is_number(number) || json_number_value(number) < 0)
        return refuse(e, key, "is not a number from 0");
    *value = json_number_value(number);
    return SF_OK;
}

static sf_status add_entry(folder_source *f, const entry *e) {
    const char *name = json_string_value(json_object_get(e->json, "file"));
    if (!name) return refuse(e, "file", "is no text");
    if (!sf_name_stays_inside(name)) return refuse(e, "file", "is not a path inside the folder");
    if (!is_picture_name(name)) return SF_OK; /* plain pixels */
    picture_file *file, read = {.listed = 1, .sequence = e->index};
    int64_t sequence = (int64_t)e->index;
    read.time_ns = sf_pace_after(30, e->index);
    sf_status status = get_count(e, "sequence", &sequence);
    if (status == SF_OK) status = get_count(e, "time_ns", &read.time_ns);
    if (status == SF_OK) status = get_amount(e, "exposure_s", &read.exposure_s);
    if (status == SF_OK) status = get_amount(e, "gain", &read.gain);
    if (status == SF_OK) status = add_file(f, f->folder, name, &file);
    if (status != SF_OK) return status;
    read.sequence = (uint64_t)sequence;
    read.path = file->path;
    *file = read;
    return SF_OK;
}

static sf_status read_entries(folder_source *f, const char *list, const json_t *root) {
    const json_t *frames = json_object_get(root, "frames");
    sf_status status = SF_OK;
    if (!json_is_array(frames))
        return sf_fail(f->ctx, SF_ERR_FORMAT, "%s: frames: %s", list,
                       frames ? "is not an array" : "is missing");
    for (size_t i = 0; status == SF_OK && i < json_array_size(frames); i++) {
        entry e = {f->ctx, list, i, json_array_get(frames, i)};
        status = add_entry(f, &e);
    }
    return status;
}

/* The pictures that frames.json lists, in its order. */
static sf_status read_list(folder_source *f) {
    uint8_t *data;
    size_t size;
    json_error_t error;
    char *list = sf_path_join(f->ctx, f->folder, "frames.json");
    if (!list) return SF_ERR_MEMORY;
    sf_status status = sf_read_text(f->ctx, list, MAX_LIST_BYTES, &data, &size);
    if (status == SF_OK) {
        json_t *root = json_loadb((const char *)data, size, 0, &error);
        sf_free(f->ctx, data);
        status = root ? read_entries(f, list, root)
                      : sf_fail(f->ctx, SF_ERR_FORMAT, "%s: line %d: JSON: %s", list, error.line, error.text);
        json_decref(root);
    }
    sf_free(f->ctx, list);
    return status;
}

/* Those of the folder itself, or of its folder "images". */
static sf_status list_pictures(folder_source *f) {
    if (sf_holds_file(f->folder, "frames.json")) return read_list(f);
    sf_status status = list_folder(f, f->folder);
    if (status != SF_OK || f->count) return status;
    char *images = sf_path_join(f->ctx, f->folder, "images");
    if (!images) return SF_ERR_MEMORY;
    if (sf_is_folder(images)) status = list_folder(f, images);
    sf_free(f->ctx, images);
    return status;
}

/* Size and format that describe the source: those of the first picture that can be told. */
static sf_status find_size(folder_source *f) {
    int width, height;
    for (size_t i = 0; i < f->count; i++) {
        sf_status status = sf_picture_size(f->ctx, f->files[i].path, &width, &height);
        if (status == SF_ERR_MEMORY) return status;
        if (status != SF_OK) continue;
        f->width = width;
        f->height = height;
        f->format = !f->decode && is_jpeg_name(f->files[i].path) ? SF_PIXEL_MJPEG : SF_PIXEL_RGB24;
        return SF_OK;
    }
    return sf_fail(f->ctx, SF_ERR_EMPTY, "%s: %s", f->folder,
                   f->count ? "none of its pictures can be read" : "holds no JPEG or PNG picture");
}

/* 3. Frames */

static sf_status hold(folder_source *f, slot *s, size_t bytes) {
    return sf_grow(f->ctx, &s->data, &s->capacity, 0, bytes, 1);
}

static sf_status decode(folder_source *f, const char *path, slot *s, sf_frame *frame) {
    sf_picture picture;
    sf_status status = sf_picture_load(f->ctx, path, &picture);
    if (status != SF_OK) return status;
    size_t pixels = (size_t)picture.width * (size_t)picture.height;
    status = hold(f, s, 3 * pixels);
    for (size_t c = 0; status == SF_OK && c < 3; c++)
        for (size_t i = 0; i < pixels; i++) s->data[3 * i + c] = picture.rgb[c * pixels + i];
    frame->format = SF_PIXEL_RGB24;
    frame->width = picture.width;
    frame->height = picture.height;
    if (status == SF_OK) sf_frame_set_planes(frame, s->data);
    sf_picture_free(f->ctx, &picture);
    return status;
}

/* A JPEG as it is. */
static sf_status take_jpeg(folder_source *f, const char *path, slot *s, sf_frame *frame) {
    uint8_t *data;
    size_t size;
    sf_status status = sf_read_file(f->ctx, path, MAX_JPEG_BYTES, &data, &size);
    if (status != SF_OK) return status;
    sf_free(f->ctx, s->data);
    s->data = data;
    s->capacity = size;
    frame->format = SF_PIXEL_MJPEG;
    frame->full_range = 1;
    frame->plane[0] = data;
    frame->bytes = size;
    if (sf_jpeg_size(data, size, &frame->width, &frame->height)) return SF_OK;
    return sf_fail(f->ctx, SF_ERR_FORMAT, "%s: is no JPEG, or is cut off", path);
}

static sf_status load(folder_source *f, const char *path, slot *s, sf_frame *frame) {
    return !f->decode && is_jpeg_name(path) ? take_jpeg(f, path, s, frame) : decode(f, path, s, frame);
}

/* Recorded times hold for frames that are given once and not in real time. */
static void stamp(const folder_source *f, const picture_file *file, uint64_t number, int64_t time_ns,
                  sf_frame *frame) {
    int recorded = file->listed && !f->loop && f->pace.fps == 0;
    frame->sequence = recorded ? file->sequence : number;
    frame->time_ns = recorded ? file->time_ns - f->files[0].time_ns : time_ns;
    frame->exposure_s = file->exposure_s;
    frame->gain = file->gain;
}

static int milliseconds_left(int64_t deadline_ns) {
    int64_t left = (deadline_ns - sf_clock_ns()) / 1000000;
    return left > 0 ? (int)left : 0;
}

/* Passes over pictures that cannot be read, though not for ever. */
static sf_status folder_next(void *self, int timeout_ms, int newest, sf_frame *frame,
                             sf_source_counts *counts) {
    folder_source *f = self;
    slot *s = &f->slots[f->slots[0].taken ? 1 : 0];
    int64_t deadline = sf_clock_ns() + (int64_t)timeout_ms * 1000000;
    for (size_t tries = 0; tries < f->count; tries++) {
        sf_pace_frame due;
        int left = tries ? milliseconds_left(deadline) : timeout_ms;
        sf_status status = sf_pace_next(&f->pace, f->ctx, f->name, left, newest, counts, &due);
        if (status != SF_OK) return status;
        const picture_file *file = &f->files[due.number % f->count];
        status = load(f, file->path, s, frame);
        if (status == SF_OK) {
            stamp(f, file, due.number, due.time_ns, frame);
            frame->lease = s;
            s->taken = 1;
            return SF_OK;
        }
        *frame = (sf_frame){.dmabuf = -1};
        if (status == SF_ERR_MEMORY) return status;
        counts->damaged++;
        sf_log(f->ctx, SF_LOG_WARNING, "%s", sf_last_error(f->ctx));
    }
    return f->loop ? sf_fail(f->ctx, SF_ERR_IO, "%s: none of its pictures can be read", f->folder)
                   : sf_fail(f->ctx, SF_ERR_END, "%s: no more frames", f->name);
}

static void folder_release(void *self, sf_frame *frame) {
    (void)self;
    ((slot *)frame->lease)->taken = 0;
}

/* 4. The source */

static void folder_close(void *self) {
    folder_source *f = self;
    for (size_t i = 0; i < f->count; i++) sf_free(f->ctx, f->files[i].path);
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++) sf_free(f->ctx, f->slots[i].data);
    sf_free(f->ctx, f->files);
    sf_free(f->ctx, f->name);
    sf_free(f->ctx, f->folder);
    sf_free(f->ctx, f);
}

static void folder_describe(const void *self, sf_source_info *info) {
    const folder_source *f = self;
    info->width = f->width;
    info->height = f->height;
    info->format = f->format;
    info->frames_per_second = f->pace.fps;
    info->frames = f->pace.frames;
    info->live = f->pace.fps > 0;
    snprintf(info->name, sizeof info->name, "%zu pictures in %.80s", f->count, f->folder);
}

static char *text_up_to(sf_context *ctx, const char *text, size_t length) {
    char *copy = sf_calloc(ctx, length + 1, 1);
    if (copy) memcpy(copy, text, length);
    return copy;
}

static sf_status open_folder(folder_source *f, const char *name) {
    enum { FPS, LOOP, DECODE, OPTIONS };
    sf_query_option options[OPTIONS] = {
        [FPS] = {.name = "fps", .most = 1000},
        [LOOP] = {.name = "loop", .most = 1, .whole = 1},
        [DECODE] = {.name = "decode", .value = 1, .most = 1, .whole = 1},
    };
    sf_status status = sf_query_parse(f->ctx, name, options, OPTIONS);
    if (status != SF_OK) return status;
    size_t length = strcspn(name, "?"), scheme = strlen("folder:");
    f->loop = options[LOOP].value != 0;
    f->decode = options[DECODE].value != 0;
    f->name = text_up_to(f->ctx, name, length);
    f->folder = text_up_to(f->ctx, name + scheme, length - scheme);
    if (!f->name || !f->folder) return SF_ERR_MEMORY;
    status = list_pictures(f);
    if (status == SF_OK) status = find_size(f);
    f->pace = (sf_pace){.fps = options[FPS].value, .frames = f->loop ? 0 : f->count};
    return status;
}

sf_status sf_folder_open(sf_context *ctx, const char *name, sf_source *source) {
    static const sf_source_ops ops = {folder_close, folder_describe, folder_next, folder_release, NULL};
    folder_source *f = sf_calloc(ctx, 1, sizeof *f);
    if (!f) return SF_ERR_MEMORY;
    f->ctx = ctx;
    sf_status status = open_folder(f, name);
    if (status != SF_OK) {
        folder_close(f);
        return status;
    }
    source->ops = &ops;
    source->self = f;
    return SF_OK;
}
