/* store.c - see store.h. */
#include "store.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/clock.h"
#include "../io/model_file.h"
#include "../io/picture.h"

enum { MOST_SIDE = 16384, JPEG_QUALITY = 80 };

static const double looks_for = 3;     /* s after its last request a client still looks */
static const double reading_pause = 2; /* s after its last request a client still reads a model */
static const double patience = 15;     /* s that the readers of an older model hold up a newer one */

sf_status sf_store_create(sf_context *ctx, sf_preview_store **store) {
    sf_preview_store *s = sf_calloc(ctx, 1, sizeof *s);
    *store = s;
    if (!s) return SF_ERR_MEMORY;
    s->ctx = ctx;
    for (int i = 0; i < SF_PREVIEW_PARTS; i++) s->seen[i] = -INFINITY;
    s->old_served = s->published = -INFINITY;
    pthread_mutex_init(&s->lock, NULL);
    pthread_mutex_init(&s->modelling, NULL);
    pthread_mutex_init(&s->camera.coder, NULL);
    pthread_mutex_init(&s->render.coder, NULL);
    return SF_OK;
}

static void free_shot(sf_context *ctx, sf_preview_shot *shot) {
    sf_free(ctx, shot->rgb);
    sf_free(ctx, shot->pixels);
    sf_free(ctx, shot->jpeg);
    pthread_mutex_destroy(&shot->coder);
}

void sf_store_destroy(sf_preview_store **store) {
    sf_preview_store *s = *store;
    *store = NULL;
    if (!s) return;
    free_shot(s->ctx, &s->camera);
    free_shot(s->ctx, &s->render);
    for (int i = 0; i < 2 * SF_PREVIEW_PIECES; i++)
        sf_free(s->ctx, s->models[i / SF_PREVIEW_PIECES].data[i % SF_PREVIEW_PIECES]);
    sf_free(s->ctx, s->status);
    pthread_mutex_destroy(&s->modelling);
    pthread_mutex_destroy(&s->lock);
    sf_free(s->ctx, s);
}

/* ---- Who looks ---- */

void sf_store_look(sf_preview_store *s, int parts) {
    double now = sf_clock();
    pthread_mutex_lock(&s->lock);
    for (int i = 0; i < SF_PREVIEW_PARTS; i++)
        if (parts >> i & 1) s->seen[i] = now;
    pthread_mutex_unlock(&s->lock);
}

/* A newer model would take away the one that somebody is in the middle of. */
static int is_read(const sf_preview_store *s, double now) {
    return now - s->old_served < reading_pause && now - s->published < patience;
}

int sf_store_wants(sf_preview_store *s, int parts) {
    double now = sf_clock();
    int wants = 0;
    pthread_mutex_lock(&s->lock);
    for (int i = 0; i < SF_PREVIEW_PARTS; i++)
        if (parts >> i & 1 && now - s->seen[i] < looks_for)
            wants |= 1 << i != SF_PREVIEW_MODEL || !is_read(s, now);
    pthread_mutex_unlock(&s->lock);
    return wants;
}

/* ---- The status and its history ---- */

static double number_or_nan(const json_t *object, const char *key) {
    const json_t *value = json_object_get(object, key);
    return json_is_number(value) ? json_number_value(value) : NAN;
}

static int is_same(double a, double b) { return a == b || (isnan(a) && isnan(b)); }

/* Where there is no room every second point goes, so that all of a long run is shown. */
static void halve_points(sf_preview_store *s) {
    for (int i = 0; i < SF_PREVIEW_POINTS / 2; i++) s->points[i] = s->points[2 * i];
    s->point_count = SF_PREVIEW_POINTS / 2;
}

/* A point is kept where a figure has changed; time that runs backwards begins anew. */
static void add_point(sf_preview_store *s, sf_preview_point p) {
    sf_preview_point *last = s->point_count ? &s->points[s->point_count - 1] : NULL;
    if (isnan(p.seconds) || (isnan(p.held_out_psnr) && isnan(p.psnr_tracked))) return;
    if (last && p.seconds < last->seconds) s->point_count = 0;
    if (s->point_count && is_same(p.held_out_psnr, last->held_out_psnr) &&
        is_same(p.psnr_tracked, last->psnr_tracked))
        return;
    if (s->point_count == SF_PREVIEW_POINTS) halve_points(s);
    s->points[s->point_count++] = p;
    s->history++;
}

/* Compact, for sf_free; NULL: no memory. */
static char *copy_json(sf_context *ctx, const json_t *object) {
    size_t size = json_dumpb(object, NULL, 0, JSON_COMPACT | JSON_REAL_PRECISION(10));
    char *text = sf_alloc(ctx, size + 1, 1);
    if (!text) return NULL;
    json_dumpb(object, text, size, JSON_COMPACT | JSON_REAL_PRECISION(10));
    text[size] = 0;
    return text;
}

sf_status sf_store_set_status(sf_preview_store *s, const char *json) {
    json_error_t error;
    size_t size = strlen(json);
    json_t *object = size <= SF_PREVIEW_MOST_STATUS ? json_loadb(json, size, 0, &error) : NULL;
    if (size > SF_PREVIEW_MOST_STATUS)
        return sf_fail(s->ctx, SF_ERR_ARGUMENT, "status: %zu bytes are more than %d", size,
                       SF_PREVIEW_MOST_STATUS);
    if (!json_is_object(object)) {
        json_decref(object);
        return sf_fail(s->ctx, SF_ERR_ARGUMENT, "status: no JSON object: %s",
                       object ? "an array" : error.text);
    }
    char *text = copy_json(s->ctx, object);
    if (text) {
        pthread_mutex_lock(&s->lock);
        char *old = s->status;
        s->status = text;
        s->buttons = json_is_true(json_object_get(object, "buttons"));
        add_point(s, (sf_preview_point){.seconds = number_or_nan(object, "seconds"),
                                        .held_out_psnr = number_or_nan(object, "held_out_psnr"),
                                        .psnr_tracked = number_or_nan(object, "psnr_tracked")});
        pthread_mutex_unlock(&s->lock);
        sf_free(s->ctx, old);
    }
    json_decref(object);
    return text ? SF_OK : SF_ERR_MEMORY;
}

char *sf_store_status_json(sf_preview_store *s, const char *head) {
    enum { FIGURES = 256 };
    pthread_mutex_lock(&s->lock);
    const sf_preview_splats *m = &s->models[s->newest];
    const char *status = s->status ? s->status : "{}";
    size_t room = strlen(head) + strlen(status) + FIGURES;
    char *text = sf_alloc(s->ctx, room, 1);
    if (text)
        snprintf(
            text, room,
            "{%s\"camera\":%llu,\"render\":%llu,\"history\":%llu,\"model\":{\"version\":%llu,\"count\":%zu,"
            "\"antialiased\":%s,\"sh_degree\":%d},\"status\":%s}",
            head, (unsigned long long)s->camera.version, (unsigned long long)s->render.version,
            (unsigned long long)s->history, (unsigned long long)m->version, m->count,
            m->antialiased ? "true" : "false", m->sh_degree, status);
    pthread_mutex_unlock(&s->lock);
    return text;
}

static int put_number(char *to, size_t room, double value, const char *after) {
    if (isnan(value)) return snprintf(to, room, "null%s", after);
    return snprintf(to, room, "%.10g%s", value, after);
}

char *sf_store_history_json(sf_preview_store *s) {
    enum { POINT = 80, FRAME = 64 };
    size_t room = FRAME + (size_t)SF_PREVIEW_POINTS * POINT;
    char *text = sf_alloc(s->ctx, room, 1);
    if (!text) return NULL;
    pthread_mutex_lock(&s->lock);
    int at = snprintf(text, room, "{\"history\":%llu,\"points\":[", (unsigned long long)s->history);
    for (int i = 0; i < s->point_count; i++) {
        const sf_preview_point *p = &s->points[i];
        at += snprintf(text + at, room - (size_t)at, i ? ",[" : "[");
        at += put_number(text + at, room - (size_t)at, p->seconds, ",");
        at += put_number(text + at, room - (size_t)at, p->held_out_psnr, ",");
        at += put_number(text + at, room - (size_t)at, p->psnr_tracked, "]");
    }
    snprintf(text + at, room - (size_t)at, "]}");
    pthread_mutex_unlock(&s->lock);
    return text;
}

/* ---- Pictures ---- */

static sf_preview_shot *shot_of(sf_preview_store *s, sf_preview_part part) {
    return part == SF_PREVIEW_CAMERA ? &s->camera : part == SF_PREVIEW_RENDER ? &s->render : NULL;
}

/* Room for `bytes`; what was there is lost. */
static sf_status make_room(sf_context *ctx, uint8_t **data, size_t *capacity, size_t bytes) {
    if (*capacity >= bytes) return SF_OK;
    uint8_t *more = sf_alloc(ctx, bytes, 1);
    if (!more) return SF_ERR_MEMORY;
    sf_free(ctx, *data);
    *data = more;
    *capacity = bytes;
    return SF_OK;
}

sf_status sf_store_set_picture(sf_preview_store *s, sf_preview_part part, int width, int height,
                               const uint8_t *rgb) {
    sf_preview_shot *shot = shot_of(s, part);
    if (!shot) return sf_fail(s->ctx, SF_ERR_ARGUMENT, "part: %d is no picture", (int)part);
    if (width < 1 || height < 1 || width > MOST_SIDE || height > MOST_SIDE)
        return sf_fail(s->ctx, SF_ERR_ARGUMENT, "size: %d x %d is not in 1..%d", width, height, MOST_SIDE);
    size_t bytes = (size_t)width * (size_t)height * 3;
    pthread_mutex_lock(&s->lock);
    sf_status status = make_room(s->ctx, &shot->rgb, &shot->capacity, bytes);
    if (!status) {
        memcpy(shot->rgb, rgb, bytes);
        shot->width = width;
        shot->height = height;
        shot->version++;
    }
    pthread_mutex_unlock(&s->lock);
    return status;
}

/* Copies the newest pixels, which then no longer hold up who publishes. Under shot->coder. */
static sf_status copy_pixels(sf_preview_store *s, sf_preview_shot *shot, int *width, int *height,
                             uint64_t *version) {
    pthread_mutex_lock(&s->lock);
    sf_status status = shot->version ? SF_OK : SF_ERR_EMPTY;
    size_t bytes = (size_t)shot->width * (size_t)shot->height * 3;
    *width = shot->width;
    *height = shot->height;
    *version = shot->version;
    if (!status && shot->version != shot->jpeg_version) {
        status = make_room(s->ctx, &shot->pixels, &shot->pixels_capacity, bytes);
        if (!status) memcpy(shot->pixels, shot->rgb, bytes);
    }
    pthread_mutex_unlock(&s->lock);
    return status;
}

/* Makes shot->jpeg the newest picture's. Under shot->coder. */
static sf_status code_newest(sf_preview_store *s, sf_preview_shot *shot) {
    int width, height;
    uint64_t version;
    uint8_t *jpeg;
    size_t size;
    sf_status status = copy_pixels(s, shot, &width, &height, &version);
    if (status || version == shot->jpeg_version) return status;
    status = sf_encode_jpeg_8(s->ctx, width, height, shot->pixels, JPEG_QUALITY, &jpeg, &size);
    if (status) return status;
    sf_free(s->ctx, shot->jpeg);
    shot->jpeg = jpeg;
    shot->jpeg_size = size;
    shot->jpeg_version = version;
    return SF_OK;
}

sf_status sf_store_jpeg(sf_preview_store *s, sf_preview_part part, uint8_t **jpeg, size_t *size,
                        uint64_t *version) {
    sf_preview_shot *shot = shot_of(s, part);
    *jpeg = NULL;
    pthread_mutex_lock(&shot->coder);
    sf_status status = code_newest(s, shot);
    if (!status) {
        *jpeg = sf_alloc(s->ctx, shot->jpeg_size, 1);
        *size = shot->jpeg_size;
        *version = shot->jpeg_version;
        if (*jpeg)
            memcpy(*jpeg, shot->jpeg, shot->jpeg_size);
        else
            status = SF_ERR_MEMORY;
    }
    pthread_mutex_unlock(&shot->coder);
    return status;
}

/* ---- The model ---- */

/* Room for both pieces, and what they are. */
static sf_status encode(sf_preview_store *s, sf_preview_splats *m, const sf_model *model, int sh_degree) {
    int most = sf_model_sh_degree(model), degree = sh_degree < most ? sh_degree : most;
    size_t count = sf_model_count(model);
    m->bytes[SF_PREVIEW_SPLATS] = count * SF_SPLAT_BYTES;
    m->bytes[SF_PREVIEW_SH] = count * sf_splat_sh_bytes(degree);
    sf_status status = SF_OK;
    for (int i = 0; i < SF_PREVIEW_PIECES && !status; i++)
        status = make_room(s->ctx, &m->data[i], &m->capacity[i], m->bytes[i] + (i == SF_PREVIEW_SPLATS));
    if (!status) status = sf_splat_encode(model, m->data[SF_PREVIEW_SPLATS], degree, m->data[SF_PREVIEW_SH]);
    m->count = count;
    m->antialiased = sf_model_antialiased(model);
    m->sh_degree = degree;
    return status;
}

sf_status sf_store_set_model(sf_preview_store *s, const sf_model *model, int sh_degree) {
    pthread_mutex_lock(&s->modelling);
    /* Nobody reads what has no version. */
    pthread_mutex_lock(&s->lock);
    sf_preview_splats *m = &s->models[!s->newest];
    uint64_t version = s->models[s->newest].version + 1;
    m->version = 0;
    pthread_mutex_unlock(&s->lock);
    sf_status status = encode(s, m, model, sh_degree);
    if (!status) {
        pthread_mutex_lock(&s->lock);
        m->version = version;
        s->newest = !s->newest;
        s->published = sf_clock();
        pthread_mutex_unlock(&s->lock);
    }
    pthread_mutex_unlock(&s->modelling);
    return status;
}

/* Under the lock; NULL: no longer here. */
static const sf_preview_splats *find_model(const sf_preview_store *s, uint64_t version) {
    for (int i = 0; i < 2; i++)
        if (version && s->models[i].version == version) return &s->models[i];
    return NULL;
}

uint64_t sf_store_model(sf_preview_store *s) {
    pthread_mutex_lock(&s->lock);
    uint64_t version = s->models[s->newest].version;
    pthread_mutex_unlock(&s->lock);
    return version;
}

size_t sf_store_model_bytes(sf_preview_store *s, uint64_t version, sf_preview_piece piece) {
    pthread_mutex_lock(&s->lock);
    const sf_preview_splats *m = find_model(s, version);
    size_t bytes = m ? m->bytes[piece] : 0;
    pthread_mutex_unlock(&s->lock);
    return bytes;
}

int sf_store_model_read(sf_preview_store *s, uint64_t version, sf_preview_piece piece, size_t at, size_t size,
                        uint8_t *data) {
    pthread_mutex_lock(&s->lock);
    const sf_preview_splats *m = find_model(s, version);
    int inside = m && at <= m->bytes[piece] && size <= m->bytes[piece] - at;
    if (inside) {
        memcpy(data, m->data[piece] + at, size);
        if (m != &s->models[s->newest]) s->old_served = sf_clock();
    }
    pthread_mutex_unlock(&s->lock);
    return inside;
}

/* ---- Commands ---- */

sf_status sf_store_give_command(sf_preview_store *s, sf_preview_command command) {
    pthread_mutex_lock(&s->lock);
    sf_status status = !s->buttons                               ? SF_ERR_UNSUPPORTED
                       : s->command_count == SF_PREVIEW_COMMANDS ? SF_ERR_TIMEOUT
                                                                 : SF_OK;
    if (!status) s->commands[(s->first_command + s->command_count++) % SF_PREVIEW_COMMANDS] = command;
    pthread_mutex_unlock(&s->lock);
    return status;
}

int sf_store_take_command(sf_preview_store *s, sf_preview_command *command) {
    pthread_mutex_lock(&s->lock);
    int taken = s->command_count > 0;
    if (taken) {
        *command = s->commands[s->first_command];
        s->first_command = (s->first_command + 1) % SF_PREVIEW_COMMANDS;
        s->command_count--;
    }
    pthread_mutex_unlock(&s->lock);
    return taken;
}
