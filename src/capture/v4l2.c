/* v4l2.c - a frame source on a V4L2 camera, and what it does when the camera fails or is unplugged.
 *
 * A stream that reports an error is stopped and started again, MOST_RESTARTS times with growing pauses before
 * a frame must come. A camera that is gone is closed at once and looked for while frames are asked for;
 * frames of it that are out stay readable until they are given back.
 */
#include "v4l2.h"

#ifdef __linux__
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "../base/query.h"
#include "frame_order.h"
#include "v4l2_stream.h"

enum { MOST_RESTARTS = 4, RESTART_PAUSE_MS = 100, LOOK_PAUSE_MS = 100, SIGNAL_PAUSE_MS = 1000 };

typedef struct v4l2_source {
    sf_context *ctx;
    const sf_v4l2_sys *sys;
    char *name; /* the whole of it */
    sf_v4l2_settings settings;
    sf_v4l2_device identity; /* of the camera, for when it comes back; not open */
    sf_v4l2_picture picture; /* what it gives */
    sf_v4l2_stream *stream;  /* NULL: the camera is gone */
    sf_v4l2_stream *closed;  /* streams of before, whose frames are still out */
    int bus_matters;         /* others are there with the same name and number */
    int restarts;            /* since the last frame */
    int fatal;               /* it came back with other frames */
    int can_lock;            /* the camera chooses one of these, where it is let: */
    int locked;              /* exposure, gain and white balance stay as they were */
    unsigned were;           /* which of them the camera chose before */
    int64_t not_before_ns;   /* when the next look or restart may be */
    sf_frame_order order;
    const char *signal; /* why the input carries nothing, as last said; NULL: it carries a picture */
    int64_t signal_asked_ns;
} v4l2_source;

static int64_t now_of(const v4l2_source *s) { return s->sys->now_ns(s->sys->user); }

static int left_ms(const v4l2_source *s, int64_t deadline_ns) {
    int64_t left = deadline_ns - now_of(s);
    return left <= 0 ? 0 : (int)((left + 999999) / 1000000);
}

static void pause_for(v4l2_source *s, int ms) { s->not_before_ns = now_of(s) + (int64_t)ms * 1000000; }

/* Sleeps until the next look or restart may be; 0: the deadline comes first. */
static int wait_for_turn(const v4l2_source *s, int64_t deadline_ns) {
    int pause_ms = left_ms(s, s->not_before_ns), limit_ms = left_ms(s, deadline_ns);
    int ms = pause_ms < limit_ms ? pause_ms : limit_ms;
    if (ms > 0) s->sys->sleep_ms(s->sys->user, ms);
    return pause_ms <= limit_ms;
}

/* 1. A camera that goes and comes back */

static int is_ours(const v4l2_source *s, const sf_v4l2_device *d, int with_bus) {
    return strcmp(d->card, s->identity.card) == 0 && strcmp(d->serial, s->identity.serial) == 0 &&
           d->index == s->identity.index && (!with_bus || strcmp(d->bus, s->identity.bus) == 0);
}

/* Calls `fn` with each camera, open, until it keeps one, which is then its own to close. */
typedef int (*camera_fn)(v4l2_source *s, sf_v4l2_device *d);

static int visit(v4l2_source *s, const char *path, camera_fn fn) {
    sf_v4l2_device d;
    if (sf_v4l2_device_open(s->ctx, s->sys, path, &d) != SF_OK) return 0;
    if (fn(s, &d)) return 1;
    sf_v4l2_device_close(&d);
    return 0;
}

static int visit_all(v4l2_source *s, camera_fn fn) {
    int numbers[SF_V4L2_MOST_NODES];
    size_t count = s->sys->list(s->sys->user, numbers, SF_V4L2_MOST_NODES);
    if (visit(s, s->settings.path, fn)) return 1;
    for (size_t i = 0; i < count; i++) {
        char path[32];
        snprintf(path, sizeof path, "/dev/video%d", numbers[i]);
        if (visit(s, path, fn)) return 1;
    }
    return 0;
}

/* Another camera of the same kind, with the same serial number or none. */
static int note_twin(v4l2_source *s, sf_v4l2_device *d) {
    if (is_ours(s, d, 0) && !is_ours(s, d, 1)) s->bus_matters = 1;
    return 0;
}

static int reopen(v4l2_source *s, sf_v4l2_device *d) {
    if (!is_ours(s, d, s->bus_matters)) return 0;
    sf_status status = sf_v4l2_stream_open(d, &s->settings, &s->stream);
    if (status == SF_ERR_UNSUPPORTED || status == SF_ERR_ARGUMENT) s->fatal = 1;
    if (!status && s->locked) (void)sf_v4l2_lock(&s->stream->device, 1, &s->were);
    return 1; /* what fails otherwise is tried again: the camera may not be ready yet */
}

/* Closes the stream of a camera that is gone. What is mapped would keep the driver from letting go of it. */
static void lose(v4l2_source *s) {
    sf_v4l2_stream *stream = s->stream;
    sf_log(s->ctx, SF_LOG_WARNING, "%s: %s is gone; it is waited for", stream->device.path, s->identity.card);
    s->stream = NULL;
    sf_v4l2_stream_close(stream);
    if (sf_v4l2_stream_is_out(stream)) {
        stream->next = s->closed;
        s->closed = stream;
    } else {
        sf_v4l2_stream_free(stream);
    }
    s->bus_matters = !*s->identity.serial;
    visit_all(s, note_twin);
    pause_for(s, 0);
}

static void welcome(v4l2_source *s, sf_source_counts *counts) {
    sf_log(s->ctx, SF_LOG_WARNING, "%s: %s is back", s->stream->device.path, s->identity.card);
    sf_frame_order_restart(&s->order);
    s->restarts = 0;
    counts->reopened++;
}

/* Looks for the camera until the deadline. */
static sf_status await_camera(v4l2_source *s, int64_t deadline_ns, sf_source_counts *counts) {
    while (!s->fatal && wait_for_turn(s, deadline_ns)) {
        pause_for(s, LOOK_PAUSE_MS);
        visit_all(s, reopen);
        if (!s->stream) continue;
        welcome(s, counts);
        return SF_OK;
    }
    if (s->fatal) return SF_ERR_IO; /* with the message of what it refused */
    return sf_fail(s->ctx, SF_ERR_TIMEOUT, "%s: %s is gone and not back yet%s", s->settings.path,
                   s->identity.card, s->closed ? "; frames of it are still out" : "");
}

/* 2. A stream that breaks */

static sf_status restart(v4l2_source *s, int64_t deadline_ns) {
    if (s->restarts == MOST_RESTARTS)
        return sf_fail(s->ctx, SF_ERR_IO, "%s: the stream fails and was started %d times without a frame",
                       s->settings.path, MOST_RESTARTS);
    if (!wait_for_turn(s, deadline_ns))
        return sf_fail(s->ctx, SF_ERR_TIMEOUT, "%s: the stream failed and is about to be started again",
                       s->settings.path);
    sf_log(s->ctx, SF_LOG_WARNING, "%s: the stream failed and is started again", s->settings.path);
    pause_for(s, RESTART_PAUSE_MS << 2 * s->restarts);
    s->restarts++;
    sf_frame_order_restart(&s->order);
    sf_v4l2_stream_stop(s->stream);
    sf_v4l2_stream_start(s->stream); /* what fails stays broken, or is gone */
    return SF_OK;
}

/* Brings the stream to where it can be waited for. */
static sf_status make_ready(v4l2_source *s, int64_t deadline_ns, sf_source_counts *counts) {
    sf_status status = SF_OK;
    for (;;) {
        if (s->stream && s->stream->device.gone) lose(s);
        if (!s->stream) status = await_camera(s, deadline_ns, counts);
        if (status != SF_OK) return status;
        if (!s->stream->broken) sf_v4l2_stream_queue(s->stream, 1);
        if (s->stream->device.gone) continue;
        if (!s->stream->broken) return SF_OK;
        status = restart(s, deadline_ns);
        if (status != SF_OK) return status;
    }
}

/* An input without a signal gives noise, and no error. */
static void watch_signal(v4l2_source *s) {
    int64_t now = now_of(s);
    if (s->signal_asked_ns && now - s->signal_asked_ns < (int64_t)SIGNAL_PAUSE_MS * 1000000) return;
    s->signal_asked_ns = now;
    const char *signal = sf_v4l2_signal(&s->stream->device);
    if (signal && !s->signal)
        sf_log(s->ctx, SF_LOG_WARNING, "%s: the input has %s", s->settings.path, signal);
    if (!signal && s->signal) sf_log(s->ctx, SF_LOG_INFO, "%s: the input has a signal", s->settings.path);
    s->signal = signal;
}

/* 3. Frames */

/* Drivers that do not count are counted for. */
static void count_frame(v4l2_source *s, uint32_t sequence, sf_source_counts *counts) {
    uint64_t dropped = counts->dropped;
    sf_frame_order_take(&s->order, sequence, 1, &counts->dropped);
    if (counts->dropped > dropped) watch_signal(s);
}

/* A frame that has arrived. */
typedef struct caught {
    sf_v4l2_arrival arrival; /* buffer NULL: none */
    uint64_t sequence;
} caught;

/* Takes what has arrived up to the first good frame, or `newest`, the last. The rest goes back at once. */
static void collect(v4l2_source *s, int newest, caught *kept, sf_source_counts *counts) {
    sf_v4l2_arrival a;
    kept->arrival.buffer = NULL;
    for (uint32_t i = 0; i < 2 * s->stream->count && sf_v4l2_stream_take(s->stream, &a); i++) {
        count_frame(s, a.sequence, counts);
        if (a.damaged) {
            counts->damaged++;
            sf_v4l2_stream_give_back(a.buffer);
            continue;
        }
        if (kept->arrival.buffer) {
            counts->skipped++;
            sf_v4l2_stream_give_back(kept->arrival.buffer);
        }
        *kept = (caught){a, s->order.sequence};
        if (!newest) return;
    }
}

static void fill_frame(const v4l2_source *s, const caught *c, sf_frame *frame) {
    const sf_v4l2_picture *p = &s->stream->picture; /* strides may be others since it was reopened */
    const sf_v4l2_arrival *a = &c->arrival;
    for (uint32_t k = 0; k < p->planes; k++) {
        frame->plane[k] = a->start[p->plane[k].memory] + p->plane[k].offset;
        frame->stride[k] = p->plane[k].stride;
    }
    frame->bytes = p->pixels->format == SF_PIXEL_MJPEG ? a->bytes[0] : 0;
    frame->width = p->width;
    frame->height = p->height;
    frame->format = p->pixels->format;
    frame->matrix = p->matrix;
    frame->full_range = p->full_range;
    frame->limited_rgb = p->limited_rgb;
    frame->sequence = c->sequence;
    frame->time_ns = a->time_ns;
    frame->exposure_s = s->stream->exposure_s;
    frame->gain = s->stream->gain;
    frame->dmabuf = a->buffer->dmabuf;
    frame->lease = a->buffer;
}

static sf_status v4l2_next(void *self, int timeout_ms, int newest, sf_frame *frame,
                           sf_source_counts *counts) {
    v4l2_source *s = self;
    int64_t deadline_ns = now_of(s) + (int64_t)timeout_ms * 1000000;
    int late = 0; /* looks after the deadline: what has arrived by then still counts */
    while (late < 2) {
        caught c;
        sf_status status = make_ready(s, deadline_ns, counts);
        if (status != SF_OK) return status;
        int left = left_ms(s, deadline_ns);
        late += left == 0;
        if (!sf_v4l2_stream_wait(s->stream, left)) continue;
        collect(s, newest, &c, counts);
        if (c.arrival.buffer) {
            fill_frame(s, &c, frame);
            s->restarts = 0;
            return SF_OK;
        }
        if (!s->stream->broken && left > 0) s->sys->sleep_ms(s->sys->user, 1); /* ready, and nothing there */
    }
    sf_v4l2_device_answers(&s->stream->device); /* some drivers are silent about it */
    return sf_fail(s->ctx, SF_ERR_TIMEOUT, "%s: no frame within %d ms", s->settings.path, timeout_ms);
}

static void v4l2_release(void *self, sf_frame *frame) {
    v4l2_source *s = self;
    sf_v4l2_buffer *buffer = frame->lease;
    sf_v4l2_stream *stream = buffer->stream;
    sf_v4l2_stream_give_back(buffer);
    if (stream == s->stream || sf_v4l2_stream_is_out(stream)) return;
    sf_v4l2_stream **link = &s->closed;
    while (*link != stream) link = &(*link)->next;
    *link = stream->next;
    sf_v4l2_stream_free(stream);
}

/* 4. The source */

static void v4l2_describe(const void *self, sf_source_info *info) {
    const v4l2_source *s = self;
    info->width = s->picture.width;
    info->height = s->picture.height;
    info->format = s->picture.pixels->format;
    info->frames_per_second = s->picture.fps;
    info->live = 1;
    info->can_lock_exposure = s->can_lock;
    snprintf(info->name, sizeof info->name, "%s, %.80s", s->identity.card, s->settings.path);
}

static sf_status v4l2_lock(void *self, int locked) {
    v4l2_source *s = self;
    if (!s->stream) return sf_fail(s->ctx, SF_ERR_IO, "%s: exposure: the camera is gone", s->settings.path);
    sf_status status = sf_v4l2_lock(&s->stream->device, locked, &s->were);
    if (!status) s->locked = locked;
    return status;
}

static void v4l2_close(void *self) {
    v4l2_source *s = self;
    if (s->stream) {
        sf_v4l2_stream_close(s->stream);
        sf_v4l2_stream_free(s->stream);
    }
    while (s->closed) {
        sf_v4l2_stream *stream = s->closed;
        s->closed = stream->next;
        sf_v4l2_stream_free(stream);
    }
    sf_free(s->ctx, s->name);
    sf_free(s->ctx, s);
}

/* "v4l2:N" or "v4l2:PATH". */
static sf_status read_path(sf_context *ctx, const char *name, char path[SF_V4L2_PATH]) {
    const char *which = name + strlen("v4l2:");
    size_t length = strcspn(which, "?");
    int is_number = length > 0 && length < 6 && strspn(which, "0123456789") >= length;
    if (length == 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: names no device; \"splatfit devices\" lists them", name);
    if (length + sizeof "/dev/video" > SF_V4L2_PATH)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: the name of the device is too long", name);
    snprintf(path, SF_V4L2_PATH, "%s%.*s", is_number ? "/dev/video" : "", (int)length, which);
    return SF_OK;
}

static sf_status read_settings(sf_context *ctx, const char *name, sf_v4l2_settings *to) {
    enum { FPS, BUFFERS, DMABUF, INPUT };
    char size[24] = "";
    sf_query_option options[] = {
        [FPS] = {.name = "fps", .value = 0, .least = 0, .most = 1000},
        [BUFFERS] = {"buffers", 4, SF_V4L2_LEAST_BUFFERS, SF_V4L2_MOST_BUFFERS, 1, NULL, 0},
        [DMABUF] = {"dmabuf", 0, 0, 1, 1, NULL, 0},
        [INPUT] = {"input", -1, -1, 63, 1, NULL, 0},
        {.name = "size", .text = size, .text_size = sizeof size},
        {.name = "format", .text = to->format, .text_size = sizeof to->format},
        {.name = "timings", .text = to->timings, .text_size = sizeof to->timings},
        {.name = "exposure", .text = to->exposure, .text_size = sizeof to->exposure},
        {.name = "gain", .text = to->gain, .text_size = sizeof to->gain},
        {.name = "white_balance", .text = to->white_balance, .text_size = sizeof to->white_balance},
        {.name = "focus", .text = to->focus, .text_size = sizeof to->focus},
        {.name = "ctrl."},
    };
    sf_status status = read_path(ctx, name, to->path);
    if (status == SF_OK) status = sf_query_parse(ctx, name, options, sizeof options / sizeof *options);
    if (status != SF_OK) return status;
    if (*size && !sf_v4l2_parse_size(size, &to->width, &to->height))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: size: \"%s\" is not WIDTHxHEIGHT of 1 to 16384 px", name,
                       size);
    to->fps = options[FPS].value;
    to->buffers = (uint32_t)options[BUFFERS].value;
    to->dmabuf = (int)options[DMABUF].value;
    to->input = (int)options[INPUT].value;
    to->options = name;
    return SF_OK;
}

static sf_status open_camera(v4l2_source *s) {
    sf_v4l2_device d;
    sf_status status = sf_v4l2_device_open(s->ctx, s->sys, s->settings.path, &d);
    if (status != SF_OK) return status;
    s->identity = d;
    s->identity.fd = -1;
    status = sf_v4l2_stream_open(&d, &s->settings, &s->stream);
    if (status != SF_OK) return status;
    s->picture = s->stream->picture;
    s->settings.fixed_width = s->picture.width;
    s->settings.fixed_height = s->picture.height;
    s->settings.fixed_fourcc = s->picture.pixels->fourcc;
    watch_signal(s);
    return SF_OK;
}

sf_status sf_v4l2_open_with(sf_context *ctx, const sf_v4l2_sys *sys, const char *name, sf_source *source) {
    static const sf_source_ops ops = {v4l2_close, v4l2_describe, v4l2_next, v4l2_release, v4l2_lock};
    v4l2_source *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    s->ctx = ctx;
    s->sys = sys;
    s->name = sf_alloc(ctx, strlen(name) + 1, 1);
    sf_status status = s->name ? SF_OK : SF_ERR_MEMORY;
    if (s->name) memcpy(s->name, name, strlen(name) + 1);
    if (status == SF_OK) status = read_settings(ctx, s->name, &s->settings);
    if (status == SF_OK) status = open_camera(s);
    if (status == SF_OK) s->can_lock = sf_v4l2_has_automatic(&s->stream->device);
    if (status != SF_OK) {
        v4l2_close(s);
        return status;
    }
    source->ops = &ops;
    source->self = s;
    return SF_OK;
}

sf_status sf_v4l2_open(sf_context *ctx, const char *name, sf_source *source) {
    return sf_v4l2_open_with(ctx, &sf_v4l2_system, name, source);
}

/* 5. The list of cameras */

typedef struct mode_list {
    sf_context *ctx;
    sf_device_mode *modes;
    size_t count, capacity;
} mode_list;

static sf_status add_mode(void *user, const sf_device_mode *mode) {
    mode_list *l = user;
    sf_status status = sf_grow(l->ctx, &l->modes, &l->capacity, l->count, l->count + 1, sizeof *mode);
    if (status == SF_OK) l->modes[l->count++] = *mode;
    return status;
}

static sf_status add_camera(sf_v4l2_device *device, sf_devices *devices) {
    mode_list l = {.ctx = device->ctx};
    sf_device_info info = {.modes = 0};
    snprintf(info.source, sizeof info.source, "v4l2:%.240s", device->path);
    snprintf(info.name, sizeof info.name, "%s", device->card);
    snprintf(info.bus, sizeof info.bus, "%s", device->bus);
    snprintf(info.serial, sizeof info.serial, "%s", device->serial);
    sf_status status = sf_v4l2_each_mode(device, add_mode, &l);
    if (status == SF_OK) status = sf_devices_add(devices, &info, l.modes, l.count);
    sf_free(device->ctx, l.modes);
    return status;
}

sf_status sf_v4l2_find_with(sf_context *ctx, const sf_v4l2_sys *sys, sf_devices *devices) {
    int numbers[SF_V4L2_MOST_NODES];
    size_t count = sys->list(sys->user, numbers, SF_V4L2_MOST_NODES);
    sf_status status = SF_OK;
    for (size_t i = 0; i < count && status == SF_OK; i++) {
        char path[32];
        sf_v4l2_device device;
        snprintf(path, sizeof path, "/dev/video%d", numbers[i]);
        sf_status opened = sf_v4l2_device_open(ctx, sys, path, &device);
        if (opened == SF_ERR_IO) sf_log(ctx, SF_LOG_WARNING, "%s", sf_last_error(ctx));
        if (opened != SF_OK) continue; /* SF_ERR_UNSUPPORTED: no camera */
        status = add_camera(&device, devices);
        sf_v4l2_device_close(&device);
    }
    return status;
}

sf_status sf_v4l2_find(sf_context *ctx, sf_devices *devices) {
    return sf_v4l2_find_with(ctx, &sf_v4l2_system, devices);
}

#else

sf_status sf_v4l2_open(sf_context *ctx, const char *name, sf_source *source) {
    (void)source;
    return sf_fail(ctx, SF_ERR_UNSUPPORTED, "%s: V4L2 is Linux's alone", name);
}

sf_status sf_v4l2_find(sf_context *ctx, sf_devices *devices) {
    (void)ctx, (void)devices;
    return SF_OK;
}
#endif
