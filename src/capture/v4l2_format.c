/* v4l2_format.c - formats, sizes and rates of a V4L2 node: what it offers, and which is chosen.
 *
 * Where no format is asked for: of those that offer the size, the first without compression, in the order of
 * the table, that is as fast as was asked for (15 frames a second where nothing was, or as fast as the camera
 * is at that size where that is less); where none is, MJPEG; where there is none, the fastest; grey last.
 */
#ifdef __linux__
#include "v4l2_device.h"
#include "v4l2_layout.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

/* 1. The table. Cameras sense one colour a pixel: chroma of half the width loses little and is read faster
 * than RGB. */

static const sf_v4l2_pixels table[] = {
    {V4L2_PIX_FMT_YUYV, SF_PIXEL_YUYV, 1, NULL},         {V4L2_PIX_FMT_UYVY, SF_PIXEL_UYVY, 1, NULL},
    {V4L2_PIX_FMT_YUV422P, SF_PIXEL_422P, 1, "YUV422P"}, {V4L2_PIX_FMT_YUV422M, SF_PIXEL_422P, 3, "YUV422M"},
    {V4L2_PIX_FMT_NV12, SF_PIXEL_NV12, 1, NULL},         {V4L2_PIX_FMT_NV12M, SF_PIXEL_NV12, 2, "NV12M"},
    {V4L2_PIX_FMT_YUV420, SF_PIXEL_YU12, 1, "YUV420"},   {V4L2_PIX_FMT_YUV420M, SF_PIXEL_YU12, 3, "YUV420M"},
    {V4L2_PIX_FMT_RGB24, SF_PIXEL_RGB24, 1, NULL},       {V4L2_PIX_FMT_BGR24, SF_PIXEL_BGR24, 1, NULL},
    {V4L2_PIX_FMT_YUV444M, SF_PIXEL_444P, 3, "YUV444M"}, {V4L2_PIX_FMT_MJPEG, SF_PIXEL_MJPEG, 1, NULL},
    {V4L2_PIX_FMT_JPEG, SF_PIXEL_MJPEG, 1, NULL},        {V4L2_PIX_FMT_GREY, SF_PIXEL_GREY, 1, NULL},
};
enum { FORMATS = sizeof table / sizeof *table };

enum { MOST_FORMATS = 256, MOST_SIZES = 256, MOST_RATES = 64 }; /* that are listed: drivers may be mad */

const sf_v4l2_pixels *sf_v4l2_pixels_of(uint32_t fourcc) {
    for (int i = 0; i < FORMATS; i++)
        if (table[i].fourcc == fourcc) return &table[i];
    return NULL;
}

static void fourcc_text(uint32_t fourcc, char text[5]) {
    for (int i = 0; i < 4; i++) {
        char c = (char)(fourcc >> (8 * i) & 127);
        text[i] = c > ' ' ? c : i && c == ' ' ? 0 : '?';
    }
    text[4] = 0;
}

/* Whether the text of "format=" means this one. */
static int means(const char *text, const sf_v4l2_pixels *p) {
    char fourcc[5];
    fourcc_text(p->fourcc, fourcc);
    return strcasecmp(text, fourcc) == 0 || strcasecmp(text, sf_pixel_format_name(p->format)) == 0 ||
           (p->name && strcasecmp(text, p->name) == 0);
}

/* 2. What the driver offers */

static double rate_of(const struct v4l2_fract *interval) {
    return interval->numerator ? (double)interval->denominator / interval->numerator : 0;
}

/* Frames a second at a size; 0: the driver does not say. */
static void find_rates(sf_v4l2_device *device, uint32_t fourcc, uint32_t width, uint32_t height,
                       double *least, double *most) {
    *least = *most = 0;
    for (uint32_t i = 0; i < MOST_RATES; i++) {
        struct v4l2_frmivalenum e = {.index = i, .pixel_format = fourcc, .width = width, .height = height};
        if (sf_v4l2_ioctl(device, VIDIOC_ENUM_FRAMEINTERVALS, &e)) return;
        int range = e.type != V4L2_FRMIVAL_TYPE_DISCRETE;
        double slow = rate_of(range ? &e.stepwise.max : &e.discrete);
        double fast = rate_of(range ? &e.stepwise.min : &e.discrete);
        if (i == 0 || slow < *least) *least = slow;
        if (i == 0 || fast > *most) *most = fast;
        if (range) return;
    }
}

/* Size `index` of a format into width.. and height.. of a mode. 0: there is none. */
static int get_size(sf_v4l2_device *device, uint32_t fourcc, uint32_t index, sf_device_mode *mode) {
    struct v4l2_frmsizeenum e = {.index = index, .pixel_format = fourcc};
    if (sf_v4l2_ioctl(device, VIDIOC_ENUM_FRAMESIZES, &e)) return 0;
    if (e.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
        mode->width = (int32_t)e.discrete.width;
        mode->height = (int32_t)e.discrete.height;
        mode->width_most = mode->height_most = mode->width_step = mode->height_step = 0;
        return 1;
    }
    if (index) return 0; /* a range is the only one */
    mode->width = (int32_t)e.stepwise.min_width;
    mode->height = (int32_t)e.stepwise.min_height;
    mode->width_most = (int32_t)e.stepwise.max_width;
    mode->height_most = (int32_t)e.stepwise.max_height;
    mode->width_step = (int32_t)(e.stepwise.step_width ? e.stepwise.step_width : 1);
    mode->height_step = (int32_t)(e.stepwise.step_height ? e.stepwise.step_height : 1);
    return 1;
}

static sf_status each_size(sf_v4l2_device *device, uint32_t fourcc, sf_v4l2_mode_fn fn, void *user) {
    const sf_v4l2_pixels *pixels = sf_v4l2_pixels_of(fourcc);
    sf_device_mode mode = {.supported = pixels != NULL, .format = pixels ? pixels->format : SF_PIXEL_RGB24};
    sf_status status = SF_OK;
    fourcc_text(fourcc, mode.fourcc);
    for (uint32_t i = 0; i < MOST_SIZES && status == SF_OK; i++) {
        if (!get_size(device, fourcc, i, &mode)) return i ? SF_OK : fn(user, &mode);
        uint32_t width = (uint32_t)(mode.width_most ? mode.width_most : mode.width);
        uint32_t height = (uint32_t)(mode.height_most ? mode.height_most : mode.height);
        find_rates(device, fourcc, width, height, &mode.fps_least, &mode.fps_most);
        status = fn(user, &mode);
    }
    return status;
}

/* Format `index` that the driver offers, 0 past the last. */
static uint32_t get_format(sf_v4l2_device *device, uint32_t index) {
    struct v4l2_fmtdesc e = {.index = index, .type = device->type};
    return index < MOST_FORMATS && sf_v4l2_ioctl(device, VIDIOC_ENUM_FMT, &e) == 0 ? e.pixelformat : 0;
}

sf_status sf_v4l2_each_mode(sf_v4l2_device *device, sf_v4l2_mode_fn fn, void *user) {
    sf_status status = SF_OK;
    uint32_t fourcc;
    for (uint32_t i = 0; status == SF_OK && (fourcc = get_format(device, i)) != 0; i++)
        status = each_size(device, fourcc, fn, user);
    return status;
}

static int has_size(sf_v4l2_device *device, uint32_t fourcc, int32_t width, int32_t height) {
    sf_device_mode m = {0};
    uint32_t i = 0;
    for (; i < MOST_SIZES && get_size(device, fourcc, i, &m); i++) {
        if (!m.width_most && m.width == width && m.height == height) return 1;
        if (m.width_most && width >= m.width && width <= m.width_most && height >= m.height &&
            height <= m.height_most && (width - m.width) % m.width_step == 0 &&
            (height - m.height) % m.height_step == 0)
            return 1;
    }
    return i == 0; /* it lists none: it may have it */
}

/* 3. What cannot be had, with what can */

typedef struct words {
    char text[512];
    size_t length;
    char last[5]; /* the format added last */
} words;

static void add_word(words *w, const char *word) {
    int n = snprintf(w->text + w->length, sizeof w->text - w->length, "%s%s", w->length ? ", " : "", word);
    if (n > 0 && (size_t)n < sizeof w->text - w->length) w->length += (size_t)n;
    w->text[w->length] = 0;
}

static sf_status add_size(void *user, const sf_device_mode *m) {
    char word[64];
    if (m->width_most)
        snprintf(word, sizeof word, "%dx%d to %dx%d", (int)m->width, (int)m->height, (int)m->width_most,
                 (int)m->height_most);
    else
        snprintf(word, sizeof word, "%dx%d", (int)m->width, (int)m->height);
    if (m->width) add_word(user, word);
    return SF_OK;
}

static sf_status refuse_format(sf_v4l2_device *device, const char *asked) {
    words w = {.length = 0};
    char text[5];
    uint32_t fourcc;
    for (uint32_t i = 0; (fourcc = get_format(device, i)) != 0; i++) {
        fourcc_text(fourcc, text);
        add_word(&w, text);
    }
    if (*asked)
        return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: format: %s is not offered; offered: %s",
                       device->path, asked, w.text);
    return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: format: splatfit reads none of those offered: %s",
                   device->path, w.text);
}

static sf_status refuse_size(sf_v4l2_device *device, const sf_v4l2_settings *settings, uint32_t fourcc,
                             int32_t width, int32_t height) {
    words w = {.length = 0};
    char name[5], given[64] = "";
    fourcc_text(fourcc, name);
    each_size(device, fourcc, add_size, &w);
    if (width) snprintf(given, sizeof given, " (the driver gives %dx%d)", (int)width, (int)height);
    return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: size: %dx%d cannot be had%s; %s has: %s",
                   device->path, (int)settings->width, (int)settings->height, given, name,
                   w.length ? w.text : "sizes that the driver does not list");
}

/* 4. The choice */

/* A format that may be chosen. */
typedef struct candidate {
    const sf_v4l2_pixels *pixels; /* NULL: not offered, or not at the size */
    double fps;                   /* the most at that size; 0: unknown */
} candidate;

static int is_fast(const candidate *c, double fps) {
    return c->fps == 0 || c->fps >= 0.99 * fps; /* 29.97 is 30 */
}

static const sf_v4l2_pixels *best_of(const candidate *all, double fps) {
    const candidate *fastest = NULL, *grey = NULL, *jpeg = NULL;
    double most = 0;
    for (int i = 0; i < FORMATS; i++)
        if (all[i].pixels && all[i].fps > most) most = all[i].fps;
    if (fps == 0) fps = 15;
    if (most > 0 && most < fps) fps = most;
    for (int i = 0; i < FORMATS; i++) {
        const candidate *c = &all[i];
        if (!c->pixels) continue;
        if (c->pixels->format == SF_PIXEL_GREY) {
            grey = grey ? grey : c;
        } else if (c->pixels->format == SF_PIXEL_MJPEG) {
            jpeg = jpeg ? jpeg : c;
        } else {
            if (is_fast(c, fps)) return c->pixels;
            if (!fastest || c->fps > fastest->fps) fastest = c;
        }
    }
    const candidate *chosen = jpeg ? jpeg : fastest ? fastest : grey;
    return chosen ? chosen->pixels : NULL;
}

static int is_wanted(const sf_v4l2_settings *settings, const sf_v4l2_pixels *pixels) {
    if (settings->fixed_fourcc) return pixels->fourcc == settings->fixed_fourcc;
    return !*settings->format || means(settings->format, pixels);
}

/* Chooses a format for width x height. */
static sf_status choose(sf_v4l2_device *device, const sf_v4l2_settings *settings, int32_t width,
                        int32_t height, const sf_v4l2_pixels **chosen) {
    candidate all[FORMATS] = {{NULL, 0}};
    uint32_t fourcc, other = 0;
    for (uint32_t i = 0; (fourcc = get_format(device, i)) != 0; i++) {
        const sf_v4l2_pixels *pixels = sf_v4l2_pixels_of(fourcc);
        if (!pixels || !is_wanted(settings, pixels)) continue;
        double slow;
        candidate *c = &all[pixels - table];
        if (!other) other = fourcc;
        if (!has_size(device, fourcc, width, height)) continue;
        c->pixels = pixels;
        find_rates(device, fourcc, (uint32_t)width, (uint32_t)height, &slow, &c->fps);
    }
    *chosen = best_of(all, settings->fps);
    if (*chosen) return SF_OK;
    if (!other) return refuse_format(device, settings->format);
    if (settings->width) return refuse_size(device, settings, other, 0, 0);
    *chosen = sf_v4l2_pixels_of(other); /* at the size that the driver then gives */
    return SF_OK;
}

static sf_status check_format_name(sf_context *ctx, const sf_v4l2_settings *settings) {
    words w = {.length = 0};
    if (!*settings->format) return SF_OK;
    for (int i = 0; i < FORMATS; i++) {
        char text[5];
        if (means(settings->format, &table[i])) return SF_OK;
        fourcc_text(table[i].fourcc, text);
        add_word(&w, table[i].name ? table[i].name : text);
    }
    return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: format: \"%s\" is none that splatfit reads: %s", settings->path,
                   settings->format, w.text);
}

/* 5. The rate, and all together */

static sf_status interpret(sf_v4l2_device *device, const sf_v4l2_settings *settings, const sf_v4l2_given *g,
                           sf_v4l2_picture *p) {
    p->pixels = sf_v4l2_pixels_of(g->fourcc);
    if (!p->pixels || !is_wanted(settings, p->pixels)) {
        char name[5];
        fourcc_text(g->fourcc, name);
        return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: format: the driver gives %s instead",
                       device->path, name);
    }
    return sf_v4l2_lay_out(device, g, p);
}

static void set_rate(sf_v4l2_device *device, const sf_v4l2_settings *settings, sf_v4l2_picture *p) {
    struct v4l2_streamparm parm;
    memset(&parm, 0, sizeof parm);
    parm.type = device->type;
    if (settings->fps > 0) {
        parm.parm.capture.timeperframe.numerator = 1000;
        parm.parm.capture.timeperframe.denominator = (uint32_t)(1000 * settings->fps + 0.5);
    }
    int known = sf_v4l2_ioctl(device, settings->fps > 0 ? VIDIOC_S_PARM : VIDIOC_G_PARM, &parm) == 0;
    p->fps = known ? rate_of(&parm.parm.capture.timeperframe) : 0;
    double error = p->fps - settings->fps;
    if (settings->fps > 0 && !(error < 0.01 * settings->fps && -error < 0.01 * settings->fps))
        sf_log(device->ctx, SF_LOG_WARNING, "%s: fps: %.6g was asked for, the driver says %.6g", device->path,
               settings->fps, p->fps);
}

sf_status sf_v4l2_set_picture(sf_v4l2_device *device, const sf_v4l2_settings *settings,
                              sf_v4l2_picture *picture) {
    const sf_v4l2_pixels *pixels = NULL;
    sf_v4l2_given now = {0};
    int32_t width = settings->fixed_width ? settings->fixed_width : settings->width;
    int32_t height = settings->fixed_width ? settings->fixed_height : settings->height;
    memset(picture, 0, sizeof *picture);
    sf_status status = check_format_name(device->ctx, settings);
    if (status == SF_OK) status = sf_v4l2_set_input(device, settings);
    if (status == SF_OK) status = sf_v4l2_set_timings(device, settings);
    if (status == SF_OK) status = sf_v4l2_get_given(device, &now);
    if (status != SF_OK) return status;
    if (!width) width = (int32_t)now.width, height = (int32_t)now.height;
    status = choose(device, settings, width, height, &pixels);
    if (status == SF_OK) status = sf_v4l2_set_given(device, pixels, width, height, &now);
    if (status != SF_OK) return status;
    int exactly = settings->width || settings->fixed_width;
    if (exactly && (now.width != (uint32_t)width || now.height != (uint32_t)height)) {
        sf_v4l2_settings asked = *settings;
        asked.width = width, asked.height = height;
        return refuse_size(device, &asked, pixels->fourcc, (int32_t)now.width, (int32_t)now.height);
    }
    status = interpret(device, settings, &now, picture);
    if (status == SF_OK) set_rate(device, settings, picture);
    return status;
}
#endif
