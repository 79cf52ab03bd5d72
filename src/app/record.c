/* record.c - writes frames as a folder of pictures, on a thread of its own. */
#include "record.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "json_list.h"
#include "record_folder.h"
#include "record_json.h"

enum {
    QUEUE_BYTES = 64 << 20, /* that the frames on their way may take, */
    QUEUE_LEAST = 2,        /* but as many frames in any case */
    QUEUE_MOST = 32,
    ERROR_BYTES = 1200
};

/* A frame with memory of its own. */
typedef struct item {
    sf_frame frame;
    uint8_t *data;
    size_t capacity, bytes;
    uint64_t group;
    int ends_group;
} item;

/* A frame as planes of floats, and how sharp it is. */
typedef struct candidate {
    item item;
    float *planes; /* [3][height][width] */
    size_t capacity;
    double sharpness;
    int present;
} candidate;

struct record {
    record_options o;
    const args *a;
    sf_context *ctx; /* its own: messages of the writing thread, and of the source's, do not mix */
    char *images;    /* the folder */
    pthread_t thread;
    uint64_t number; /* of the next frame that is put in */

    /* The writing thread's. */
    candidate best, next; /* of the group; the one that may replace it */
    float *rgb;           /* [height][width][3] */
    size_t rgb_capacity;
    json_list frames, cameras;
    int with_cameras;

    /* Shared, under `lock`. */
    pthread_mutex_t lock;
    pthread_cond_t changed;
    item queue[QUEUE_MOST]; /* a ring */
    int first, queued, room;
    uint64_t pending; /* groups that end on their way */
    int ending;
    record_counts counts;
    char error[ERROR_BYTES]; /* what failed first; "": nothing */
};

static void fail_with(record *r, const char *subject, const char *what) {
    pthread_mutex_lock(&r->lock);
    if (!*r->error) snprintf(r->error, sizeof r->error, "%s%s%s", subject, *subject ? ": " : "", what);
    pthread_mutex_unlock(&r->lock);
}

static void fail_ctx(record *r) {
    const char *message = sf_last_error(r->ctx);
    fail_with(r, "", *message ? message : "out of memory");
}

static void count(record *r, uint64_t *counter) {
    pthread_mutex_lock(&r->lock);
    ++*counter;
    pthread_mutex_unlock(&r->lock);
}

/* Makes room for `need` items; what they held is lost. 0: there is no memory. */
static int make_room(void *block_pointer, size_t *capacity, size_t need, size_t size) {
    void **block = block_pointer;
    if (need <= *capacity) return 1;
    free(*block);
    *capacity = 0;
    *block = need <= SIZE_MAX / size ? malloc(need * size) : NULL;
    if (*block) *capacity = need;
    return *block != NULL;
}

/* 1. From frames to pictures: on the writing thread */

static size_t pixels_of(const sf_frame *f) { return (size_t)f->width * (size_t)f->height; }

/* Luma of 2 x 2 pixels. */
static float luma4(const float *planes, size_t pixels, size_t stride, size_t at) {
    static const float weights[3] = {0.299f, 0.587f, 0.114f};
    float sum = 0;
    for (size_t c = 0; c < 3; c++) {
        const float *p = planes + c * pixels + at;
        sum += weights[c] * (p[0] + p[1] + p[stride] + p[stride + 1]);
    }
    return sum / 4;
}

/* The mean square of the Laplacian of luma, in grey levels of 0..255, with 2 x 2 pixels averaged before:
 * noise of single pixels and the blocks of chroma count little. 0 for pictures too small for it. */
static double sharpness_of(const float *planes, size_t width, size_t height, float *half) {
    size_t w = width / 2, h = height / 2;
    double sum = 0;
    if (w < 3 || h < 3) return 0;
    for (size_t y = 0; y < h; y++)
        for (size_t x = 0; x < w; x++)
            half[y * w + x] = luma4(planes, width * height, width, 2 * y * width + 2 * x);
    for (size_t y = 1; y + 1 < h; y++) {
        float row = 0;
        for (size_t x = 1; x + 1 < w; x++) {
            const float *p = half + y * w + x;
            float laplacian = 255 * (4 * p[0] - p[-1] - p[1] - *(p - w) - p[w]);
            row += laplacian * laplacian;
        }
        sum += (double)row;
    }
    return sum / (double)((w - 2) * (h - 2));
}

/* 0: it cannot be used, which was counted or has failed. */
static int develop(record *r, candidate *c) {
    const sf_frame *f = &c->item.frame;
    size_t pixels = pixels_of(f);
    if (!make_room(&c->planes, &c->capacity, 3 * pixels, sizeof *c->planes) ||
        !make_room(&r->rgb, &r->rgb_capacity, 3 * pixels, sizeof *r->rgb)) {
        fail_with(r, r->o.source, "out of memory for a picture");
        return 0;
    }
    float *const rgb[3] = {c->planes, c->planes + pixels, c->planes + 2 * pixels};
    sf_status status = sf_frame_convert(r->ctx, f, rgb, (size_t)f->width);
    if (status == SF_ERR_FORMAT) {
        count(r, &r->counts.undecodable);
        return 0;
    }
    if (status) {
        fail_ctx(r);
        return 0;
    }
    c->sharpness = sharpness_of(c->planes, (size_t)f->width, (size_t)f->height, r->rgb);
    return c->present = 1;
}

/* Planes to r->rgb, averaged over n x n pixels. */
static void pack(record *r, const candidate *c, size_t width, size_t height) {
    size_t n = (size_t)r->o.downscale, stride = (size_t)c->item.frame.width;
    size_t pixels = pixels_of(&c->item.frame);
    for (size_t i = 0; i < 3 * width * height; i++) {
        const float *from = c->planes + i % 3 * pixels + i / 3 / width * n * stride + i / 3 % width * n;
        float sum = 0;
        for (size_t v = 0; v < n; v++)
            for (size_t u = 0; u < n; u++) sum += from[v * stride + u];
        r->rgb[i] = sum / (float)(n * n);
    }
}

/* A JPEG, or plain pixels: the bytes as they came. */
static int as_it_came(const record *r, const sf_frame *f) {
    return r->o.format == RECORD_RAW ||
           (r->o.format == RECORD_JPG && f->format == SF_PIXEL_MJPEG && r->o.downscale == 1);
}

static const char *ending_of(const record *r, const sf_frame *f) {
    static const char *const raw[SF_PIXEL_FORMATS] = {"rgb24", "bgr24", "grey", "yuyv", "uyvy",
                                                      "nv12",  "yu12",  "422p", "444p", "jpg"};
    return r->o.format == RECORD_PNG ? "png" : r->o.format == RECORD_JPG ? "jpg" : raw[f->format];
}

static sf_status write_picture(record *r, const candidate *c, const char *path) {
    const sf_frame *f = &c->item.frame;
    size_t width = (size_t)(f->width / r->o.downscale), height = (size_t)(f->height / r->o.downscale), size;
    uint8_t *file;
    if (as_it_came(r, f)) return sf_write_file_unsynced(r->ctx, path, c->item.data, c->item.bytes);
    pack(r, c, width, height);
    sf_status status =
        r->o.format == RECORD_PNG
            ? sf_encode_png(r->ctx, (int)width, (int)height, r->rgb, &file, &size)
            : sf_encode_jpeg(r->ctx, (int)width, (int)height, r->rgb, r->o.quality, &file, &size);
    if (!status) status = sf_write_file_unsynced(r->ctx, path, file, size);
    sf_encoded_free(r->ctx, &file);
    return status;
}

/* 2. The lists */

static void fail_list(record *r, const char *name, int error) {
    char path[1024];
    snprintf(path, sizeof path, "%s/%s", r->o.folder, name);
    if (error) fail_with(r, path, strerror(error));
}

static void open_lists(record *r) {
    json_list_open(&r->frames, r->o.folder, "frames.json", record_head_json(&r->o), "frames");
    fail_list(r, "frames.json", r->frames.error ? r->frames.error : r->frames.full);
    r->with_cameras = r->o.info.has_poses;
    if (!r->with_cameras) return;
    json_list_open(&r->cameras, r->o.folder, "transforms.json", json_pack("{s:s}", "camera_model", "PINHOLE"),
                   "frames");
    fail_list(r, "transforms.json", r->cameras.error);
}

static void add_to_list(record *r, json_list *list, json_t *entry) {
    json_list_add(list, entry);
    int error = list->error ? list->error : list->full;
    if (error) fail_with(r, list->path ? list->path : r->o.folder, strerror(error));
}

/* 3. Groups: on the writing thread */

static int has_failed(record *r) {
    pthread_mutex_lock(&r->lock);
    int failed = *r->error != 0;
    pthread_mutex_unlock(&r->lock);
    return failed;
}

static int has_all(const record *r) { return r->o.most && r->counts.kept >= r->o.most; }

/* Pictures of a folder, and JPEGs of a pipe, have sizes of their own. Fails where nothing would be left. */
static int is_too_small(record *r, const sf_frame *f) {
    char what[128];
    if (f->width >= r->o.downscale && f->height >= r->o.downscale) return 0;
    snprintf(what, sizeof what, "frame %llu: %d x %d px cannot be reduced by --downscale %d",
             (unsigned long long)f->sequence, (int)f->width, (int)f->height, r->o.downscale);
    fail_with(r, r->o.source, what);
    return 1;
}

/* Writes the best of its group. */
static void write_best(record *r) {
    char name[64], path[4096];
    candidate *c = &r->best;
    if (!c->present) return;
    c->present = 0;
    if (has_all(r)) {
        count(r, &r->counts.passed_over);
        return;
    }
    snprintf(name, sizeof name, "images/frame_%06llu.%s", (unsigned long long)r->counts.kept + 1,
             ending_of(r, &c->item.frame));
    snprintf(path, sizeof path, "%s/%s", r->o.folder, name);
    int failed = has_failed(r) || is_too_small(r, &c->item.frame);
    sf_status status = failed ? SF_ERR_CANCELLED : write_picture(r, c, path);
    if (status) {
        if (status != SF_ERR_CANCELLED) fail_ctx(r);
        count(r, &r->counts.dropped);
        return;
    }
    add_to_list(r, &r->frames, record_frame_json(&r->o, &c->item.frame, c->sharpness, name));
    if (r->with_cameras && c->item.frame.has_camera)
        add_to_list(r, &r->cameras, record_camera_json(&r->o, &c->item.frame, name));
    count(r, &r->counts.kept);
}

static void swap(candidate *a, candidate *b) {
    candidate c = *a;
    *a = *b;
    *b = c;
}

/* Takes the frame in r->next. */
static void take_frame(record *r) {
    int ends = r->next.item.ends_group;
    if (r->best.present && r->best.item.group != r->next.item.group) write_best(r);
    if (has_all(r)) {
        count(r, &r->counts.passed_over);
    } else if (has_failed(r)) {
        count(r, &r->counts.dropped);
    } else if (develop(r, &r->next)) {
        int both = r->best.present;
        if (!both || r->next.sharpness > r->best.sharpness) swap(&r->best, &r->next);
        r->next.present = 0;
        if (both) count(r, &r->counts.passed_over);
    } else if (has_failed(r)) {
        count(r, &r->counts.dropped);
    }
    if (ends) write_best(r);
}

static void swap_items(item *a, item *b) {
    item c = *a;
    *a = *b;
    *b = c;
}

/* Waits for a frame, and takes it into r->next. 0: there will be none. */
static int take_item(record *r) {
    pthread_mutex_lock(&r->lock);
    while (!r->queued && !r->ending) pthread_cond_wait(&r->changed, &r->lock);
    int got = r->queued > 0;
    if (got) {
        swap_items(&r->queue[r->first], &r->next.item);
        r->first = (r->first + 1) % QUEUE_MOST;
        r->queued--;
    }
    pthread_cond_broadcast(&r->changed);
    pthread_mutex_unlock(&r->lock);
    return got;
}

static void *write_all(void *arg) {
    record *r = arg;
    while (take_item(r)) {
        int ends = r->next.item.ends_group;
        take_frame(r);
        pthread_mutex_lock(&r->lock);
        r->pending -= (uint64_t)ends;
        pthread_cond_broadcast(&r->changed);
        pthread_mutex_unlock(&r->lock);
    }
    write_best(r);
    return NULL;
}

/* 4. Frames come in */

static size_t bytes_of(const sf_frame *f) {
    size_t sum = f->format == SF_PIXEL_MJPEG ? f->bytes : 0, bytes, rows;
    for (int i = 0; i < SF_FRAME_PLANES; i++) {
        sf_pixel_plane(f->format, f->width, f->height, i, &bytes, &rows);
        sum += bytes * rows;
    }
    return sum;
}

/* Its rows are laid close together. */
static int copy_frame(item *to, const sf_frame *from) {
    size_t at = 0, bytes, rows;
    to->bytes = bytes_of(from);
    if (!make_room(&to->data, &to->capacity, to->bytes ? to->bytes : 1, 1)) return 0;
    to->frame = *from;
    to->frame.lease = NULL;
    if (from->format == SF_PIXEL_MJPEG) {
        memcpy(to->data, from->plane[0], from->bytes);
        to->frame.plane[0] = to->data;
    }
    for (int i = 0; i < SF_FRAME_PLANES; i++) {
        sf_pixel_plane(from->format, from->width, from->height, i, &bytes, &rows);
        if (!rows) continue;
        to->frame.plane[i] = to->data + at;
        to->frame.stride[i] = bytes;
        for (size_t y = 0; y < rows; y++, at += bytes)
            memcpy(to->data + at, from->plane[i] + y * from->stride[i], bytes);
    }
    return 1;
}

/* Frames that may be on their way at once. */
static int queue_room(size_t bytes) {
    size_t room = bytes ? QUEUE_BYTES / bytes : QUEUE_MOST;
    return room < QUEUE_LEAST ? QUEUE_LEAST : room > QUEUE_MOST ? QUEUE_MOST : (int)room;
}

/* Under the lock: the place for a frame; NULL: it is full. */
static item *place_for(record *r) {
    while (r->queued >= r->room && !r->o.info.live && !*r->error) pthread_cond_wait(&r->changed, &r->lock);
    return r->queued < r->room ? &r->queue[(r->first + r->queued) % QUEUE_MOST] : NULL;
}

void record_put(record *r, const sf_frame *frame) {
    uint64_t number = r->number++, every = (uint64_t)r->o.every;
    int wanted = r->o.sharpest || number % every == 0;
    if (!r->room) r->room = queue_room(bytes_of(frame));
    pthread_mutex_lock(&r->lock);
    r->counts.put++;
    item *place = wanted ? place_for(r) : NULL;
    int copied = place && copy_frame(place, frame);
    if (copied) {
        place->group = number / every;
        place->ends_group = !r->o.sharpest || number % every == every - 1;
        r->pending += (uint64_t)place->ends_group;
        r->queued++;
    } else {
        ++*(wanted ? &r->counts.dropped : &r->counts.passed_over);
    }
    pthread_cond_broadcast(&r->changed);
    pthread_mutex_unlock(&r->lock);
}

int record_wants(record *r) {
    pthread_mutex_lock(&r->lock);
    while (r->o.most && r->pending && !*r->error && !has_all(r) && r->counts.kept + r->pending >= r->o.most)
        pthread_cond_wait(&r->changed, &r->lock);
    int wants = !*r->error && !has_all(r);
    pthread_mutex_unlock(&r->lock);
    return wants;
}

void record_count(record *r, record_counts *counts) {
    pthread_mutex_lock(&r->lock);
    *counts = r->counts;
    pthread_mutex_unlock(&r->lock);
}

/* 5. Begin and end */

static int start_thread(record *r) {
    sigset_t all, old;
    sigfillset(&all); /* they are for the thread that takes frames */
    pthread_sigmask(SIG_SETMASK, &all, &old);
    int error = pthread_create(&r->thread, NULL, write_all, r);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return error ? app_say(r->a, "cannot start a thread", strerror(error)) : 0;
}

static void free_record(record *r) {
    for (int i = 0; i < QUEUE_MOST; i++) free(r->queue[i].data);
    free(r->best.item.data);
    free(r->best.planes);
    free(r->next.item.data);
    free(r->next.planes);
    free(r->rgb);
    free(r->images);
    sf_context_destroy(&r->ctx);
    pthread_cond_destroy(&r->changed);
    pthread_mutex_destroy(&r->lock);
    free(r);
}

/* What failed, if anything did. 0 or an exit code. */
static int tell(const record *r) {
    if (!*r->error) return 0;
    return args_error(r->a->command, "%s", r->error);
}

/* Nothing of it stays: there is nothing to keep from the next try. */
static void give_up_lists(record *r) {
    r->frames.error = r->cameras.error = ECANCELED;
    json_list_close(&r->frames, NULL);
    if (r->with_cameras) json_list_close(&r->cameras, NULL);
    rmdir(r->images); /* where it is empty */
}

/* 0 or an exit code, which is told. */
static int close_lists(record *r, const sf_source_counts *totals) {
    if (!totals->given) {
        give_up_lists(r);
        return tell(r);
    }
    fail_list(r, "frames.json", json_list_close(&r->frames, record_totals_json(totals, &r->counts)));
    if (r->with_cameras) fail_list(r, "transforms.json", json_list_close(&r->cameras, NULL));
    return tell(r);
}

int record_start(const args *a, const record_options *options, record **out) {
    record *r = calloc(1, sizeof *r);
    *out = NULL;
    if (!r) return app_say(a, options->folder, "out of memory");
    r->o = *options;
    r->a = a;
    pthread_mutex_init(&r->lock, NULL);
    pthread_cond_init(&r->changed, NULL);
    r->images = malloc(strlen(options->folder) + 16);
    if (r->images) sprintf(r->images, "%s/images", options->folder);
    int error = r->images ? app_context(a, &r->ctx) : app_say(a, options->folder, "out of memory");
    if (!error) error = record_clear_folder(r->a, r->o.folder, r->images, r->o.source, r->o.force);
    if (!error) {
        open_lists(r);
        error = *r->error ? tell(r) : start_thread(r);
        if (error) give_up_lists(r);
    }
    if (error)
        free_record(r);
    else
        *out = r;
    return error;
}

int record_finish(record **record_pointer, const sf_source_counts *totals, record_counts *counts) {
    record *r = *record_pointer;
    pthread_mutex_lock(&r->lock);
    r->ending = 1;
    pthread_cond_broadcast(&r->changed);
    pthread_mutex_unlock(&r->lock);
    pthread_join(r->thread, NULL);
    r->counts.passed_over += totals->given - r->counts.put; /* it came after the end that was asked for */
    *counts = r->counts;
    int error = close_lists(r, totals);
    free_record(r);
    *record_pointer = NULL;
    return error;
}
