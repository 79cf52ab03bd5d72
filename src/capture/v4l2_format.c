/* v4l2_format.c - formats, sizes and rates of a V4L2 node: what it offers, which is chosen, how it lies in
 * memory.
 *
 * Where no format is asked for: of those that offer the size, the first without compression, in the order of
 * the table, that is as fast as was asked for (15 frames a second where nothing was, or as fast as the camera
 * is at that size where that is less); where none is, MJPEG; where there is none, the fastest; grey last.
 */
#ifdef __linux__
#include "convert.h"
#include "v4l2_device.h"

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

/* 5. Input and timings of what is no camera but a socket */

static sf_status set_input(sf_v4l2_device *device, const sf_v4l2_settings *settings) {
    if (settings->input < 0) return SF_OK;
    int input = settings->input;
    if (sf_v4l2_ioctl(device, VIDIOC_S_INPUT, &input) == 0) return SF_OK;
    if (errno != EINVAL && errno != ENOTTY) return sf_v4l2_fail(device, "input");
    int inputs = 0;
    for (struct v4l2_input e; inputs < 64; inputs++) {
        memset(&e, 0, sizeof e);
        e.index = (uint32_t)inputs;
        if (sf_v4l2_ioctl(device, VIDIOC_ENUMINPUT, &e)) break;
    }
    return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: input: %d is not there; there are %d, from 0 on",
                   device->path, settings->input, inputs);
}

const char *sf_v4l2_signal(sf_v4l2_device *device) {
    int index = 0;
    if (sf_v4l2_ioctl(device, VIDIOC_G_INPUT, &index)) return NULL;
    struct v4l2_input input = {.index = (uint32_t)index};
    if (sf_v4l2_ioctl(device, VIDIOC_ENUMINPUT, &input)) return NULL;
    if (input.status & V4L2_IN_ST_NO_POWER) return "no power";
    if (input.status & V4L2_IN_ST_NO_SIGNAL) return "no signal";
    if (input.status & (V4L2_IN_ST_NO_SYNC | V4L2_IN_ST_NO_H_LOCK)) return "no lock on the signal";
    return NULL;
}

static sf_status find_timings(sf_v4l2_device *device, const sf_v4l2_settings *settings,
                              struct v4l2_dv_timings *timings) {
    enum { MOST_TIMINGS = 512 };
    int32_t width, height;
    if (strcmp(settings->timings, "auto") == 0) {
        if (sf_v4l2_ioctl(device, VIDIOC_QUERY_DV_TIMINGS, timings) == 0) return SF_OK;
        return sf_v4l2_fail(device, "timings: auto: none are found");
    }
    if (!sf_v4l2_parse_size(settings->timings, &width, &height))
        return sf_fail(device->ctx, SF_ERR_ARGUMENT, "%s: timings: \"%s\" is neither auto nor WIDTHxHEIGHT",
                       device->path, settings->timings);
    for (uint32_t i = 0; i < MOST_TIMINGS; i++) {
        struct v4l2_enum_dv_timings e = {.index = i};
        if (sf_v4l2_ioctl(device, VIDIOC_ENUM_DV_TIMINGS, &e)) break;
        if (e.timings.bt.width == (uint32_t)width && e.timings.bt.height == (uint32_t)height &&
            !e.timings.bt.interlaced) {
            *timings = e.timings;
            return SF_OK;
        }
    }
    return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: timings: the input has none of %s", device->path,
                   settings->timings);
}

static sf_status set_timings(sf_v4l2_device *device, const sf_v4l2_settings *settings) {
    struct v4l2_dv_timings timings;
    memset(&timings, 0, sizeof timings);
    if (!*settings->timings) return SF_OK;
    sf_status status = find_timings(device, settings, &timings);
    if (status == SF_OK && sf_v4l2_ioctl(device, VIDIOC_S_DV_TIMINGS, &timings))
        status = sf_v4l2_fail(device, "timings");
    return status;
}

/* 6. What the driver gives */

/* The same of both kinds of nodes. */
typedef struct given {
    uint32_t fourcc, width, height, field, colorspace, ycbcr_enc, quantization;
    uint32_t planes;                      /* of memory */
    size_t stride[SF_FRAME_PLANES];       /* bytes, of each plane of memory; 0: unknown */
    size_t memory_bytes[SF_FRAME_PLANES]; /* of each */
} given;

static void take_single(const struct v4l2_pix_format *p, given *g) {
    *g = (given){.fourcc = p->pixelformat,
                 .width = p->width,
                 .height = p->height,
                 .field = p->field,
                 .colorspace = p->colorspace,
                 .planes = 1,
                 .stride = {p->bytesperline},
                 .memory_bytes = {p->sizeimage}};
    if (p->priv != V4L2_PIX_FMT_PRIV_MAGIC) return; /* an old driver: these fields hold nothing */
    g->ycbcr_enc = p->ycbcr_enc;
    g->quantization = p->quantization;
}

static void take_multi(const struct v4l2_pix_format_mplane *p, given *g) {
    *g = (given){.fourcc = p->pixelformat,
                 .width = p->width,
                 .height = p->height,
                 .field = p->field,
                 .colorspace = p->colorspace,
                 .ycbcr_enc = p->ycbcr_enc,
                 .quantization = p->quantization,
                 .planes = p->num_planes};
    for (uint32_t k = 0; k < p->num_planes && k < SF_FRAME_PLANES; k++) {
        g->stride[k] = p->plane_fmt[k].bytesperline;
        g->memory_bytes[k] = p->plane_fmt[k].sizeimage;
    }
}

static void take_given(const struct v4l2_format *f, given *g) {
    if (f->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE)
        take_multi(&f->fmt.pix_mp, g);
    else
        take_single(&f->fmt.pix, g);
}

static sf_status get_given(sf_v4l2_device *device, given *g) {
    struct v4l2_format f;
    memset(&f, 0, sizeof f);
    f.type = device->type;
    if (sf_v4l2_ioctl(device, VIDIOC_G_FMT, &f)) return sf_v4l2_fail(device, "format: cannot be read");
    take_given(&f, g);
    return SF_OK;
}

static sf_status set_given(sf_v4l2_device *device, const sf_v4l2_pixels *pixels, int32_t width,
                           int32_t height, given *g) {
    struct v4l2_format f;
    memset(&f, 0, sizeof f);
    f.type = device->type;
    if (device->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE) {
        f.fmt.pix_mp.width = (uint32_t)width;
        f.fmt.pix_mp.height = (uint32_t)height;
        f.fmt.pix_mp.pixelformat = pixels->fourcc;
        f.fmt.pix_mp.field = V4L2_FIELD_NONE;
        f.fmt.pix_mp.num_planes = (uint8_t)pixels->planes;
    } else {
        f.fmt.pix.width = (uint32_t)width;
        f.fmt.pix.height = (uint32_t)height;
        f.fmt.pix.pixelformat = pixels->fourcc;
        f.fmt.pix.field = V4L2_FIELD_NONE;
        f.fmt.pix.priv = V4L2_PIX_FMT_PRIV_MAGIC;
    }
    if (sf_v4l2_ioctl(device, VIDIOC_S_FMT, &f)) return sf_v4l2_fail(device, "format");
    take_given(&f, g);
    return SF_OK;
}

/* 7. What that means */

static void set_colors(sf_context *ctx, const char *path, const given *g, sf_v4l2_picture *p) {
    uint32_t encoding = g->ycbcr_enc, range = g->quantization;
    sf_pixel_format format = p->pixels->format;
    int rgb = format == SF_PIXEL_RGB24 || format == SF_PIXEL_BGR24;
    if (format == SF_PIXEL_MJPEG) { /* as JFIF says, whatever the driver does */
        p->matrix = SF_YUV_601;
        p->full_range = 1;
        return;
    }
    if (encoding == V4L2_YCBCR_ENC_DEFAULT) encoding = V4L2_MAP_YCBCR_ENC_DEFAULT(g->colorspace);
    if (range == V4L2_QUANTIZATION_DEFAULT)
        range = V4L2_MAP_QUANTIZATION_DEFAULT(rgb, g->colorspace, encoding);
    p->full_range = range == V4L2_QUANTIZATION_FULL_RANGE;
    p->limited_rgb = rgb && !p->full_range;
    switch (encoding) {
    case V4L2_YCBCR_ENC_709:
    case V4L2_YCBCR_ENC_XV709:
        p->matrix = SF_YUV_709;
        break;
    case V4L2_YCBCR_ENC_BT2020:
        p->matrix = SF_YUV_2020;
        break;
    case V4L2_YCBCR_ENC_601:
    case V4L2_YCBCR_ENC_XV601:
        p->matrix = SF_YUV_601;
        break;
    default:
        p->matrix = encoding == V4L2_YCBCR_ENC_BT2020_CONST_LUM ? SF_YUV_2020 : SF_YUV_709;
        sf_log(ctx, SF_LOG_WARNING, "%s: ycbcr_enc %u is read as %s", path, (unsigned)encoding,
               p->matrix == SF_YUV_2020 ? "BT.2020" : "BT.709");
    }
}

/* A plane of a picture: bytes of a row, rows, and how many times the first plane's stride fits theirs where
 * they lie together. */
typedef struct plane_shape {
    size_t row_bytes, rows, part;
} plane_shape;

/* Of an MJPEG, a file, the one plane has no rows. */
static uint32_t shape_of(sf_pixel_format format, int32_t w, int32_t h, plane_shape shape[SF_FRAME_PLANES]) {
    int halves = format == SF_PIXEL_YU12 || format == SF_PIXEL_422P, planes = sf_format_planes(format);
    for (int i = 0; i < SF_FRAME_PLANES; i++) {
        sf_pixel_plane(format, w, h, i, &shape[i].row_bytes, &shape[i].rows);
        shape[i].part = i && halves ? 2 : 1;
    }
    return planes ? (uint32_t)planes : 1;
}

static sf_status check_stride(sf_v4l2_device *device, size_t stride, const plane_shape *shape,
                              int32_t width) {
    if (stride >= shape->row_bytes) return SF_OK;
    return sf_fail(device->ctx, SF_ERR_UNSUPPORTED,
                   "%s: stride: %zu bytes are too few for a row of %d px (%zu)", device->path, stride,
                   (int)width, shape->row_bytes);
}

/* Where the planes lie, and how much memory they take. */
static sf_status lay_out(sf_v4l2_device *device, const given *g, sf_v4l2_picture *p) {
    plane_shape shape[SF_FRAME_PLANES];
    size_t offset = 0;
    p->planes = shape_of(p->pixels->format, p->width, p->height, shape);
    int together = p->pixels->planes == 1;
    for (uint32_t k = 0; k < p->planes; k++) {
        uint32_t memory = together ? 0 : k;
        size_t stride = g->stride[memory] ? g->stride[memory] : shape[memory].row_bytes; /* 0: not told */
        if (together) stride /= shape[k].part;
        if (!shape[k].rows) stride = 0;
        sf_status status = check_stride(device, stride, &shape[k], p->width);
        if (status != SF_OK) return status;
        if (!together) offset = 0;
        p->plane[k].memory = memory;
        p->plane[k].offset = offset;
        p->plane[k].stride = stride;
        if ((uint64_t)offset + (uint64_t)shape[k].rows * stride > SIZE_MAX / 2)
            return sf_fail(device->ctx, SF_ERR_UNSUPPORTED,
                           "%s: size: %dx%d with %zu bytes a row is too large", device->path, (int)p->width,
                           (int)p->height, stride);
        /* the last row ends where its pixels do */
        p->need[memory] = shape[k].rows ? offset + (shape[k].rows - 1) * stride + shape[k].row_bytes : 1;
        offset += shape[k].rows * stride;
    }
    for (uint32_t m = 0; m < p->pixels->planes; m++)
        if (g->memory_bytes[m] < p->need[m])
            return sf_fail(device->ctx, SF_ERR_UNSUPPORTED,
                           "%s: sizeimage: %zu bytes of plane %u are too few for %dx%d (%zu)", device->path,
                           g->memory_bytes[m], (unsigned)m, (int)p->width, (int)p->height, p->need[m]);
    return SF_OK;
}

static sf_status check_field(sf_v4l2_device *device, uint32_t field) {
    switch (field) {
    case V4L2_FIELD_ANY:
    case V4L2_FIELD_NONE:
        return SF_OK;
    case V4L2_FIELD_INTERLACED:
    case V4L2_FIELD_INTERLACED_TB:
    case V4L2_FIELD_INTERLACED_BT:
        sf_log(device->ctx, SF_LOG_WARNING, "%s: the frames are interlaced: what moves has combed edges",
               device->path);
        return SF_OK;
    default:
        return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: field: %u: half frames are not read",
                       device->path, (unsigned)field);
    }
}

static sf_status interpret(sf_v4l2_device *device, const sf_v4l2_settings *settings, const given *g,
                           sf_v4l2_picture *p) {
    p->pixels = sf_v4l2_pixels_of(g->fourcc);
    if (!p->pixels || !is_wanted(settings, p->pixels)) {
        char name[5];
        fourcc_text(g->fourcc, name);
        return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: format: the driver gives %s instead",
                       device->path, name);
    }
    if (g->planes != p->pixels->planes || g->width < 1 || g->height < 1 || g->width > 65535 ||
        g->height > 65535)
        return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: format: the driver gives %ux%u in %u planes",
                       device->path, (unsigned)g->width, (unsigned)g->height, (unsigned)g->planes);
    p->width = (int32_t)g->width;
    p->height = (int32_t)g->height;
    sf_status status = check_field(device, g->field);
    set_colors(device->ctx, device->path, g, p);
    return status == SF_OK ? lay_out(device, g, p) : status;
}

/* 8. The rate */

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
    given now = {0};
    int32_t width = settings->fixed_width ? settings->fixed_width : settings->width;
    int32_t height = settings->fixed_width ? settings->fixed_height : settings->height;
    memset(picture, 0, sizeof *picture);
    sf_status status = check_format_name(device->ctx, settings);
    if (status == SF_OK) status = set_input(device, settings);
    if (status == SF_OK) status = set_timings(device, settings);
    if (status == SF_OK) status = get_given(device, &now);
    if (status != SF_OK) return status;
    if (!width) width = (int32_t)now.width, height = (int32_t)now.height;
    status = choose(device, settings, width, height, &pixels);
    if (status == SF_OK) status = set_given(device, pixels, width, height, &now);
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
