/* video.c - pictures as YUV4MPEG2. */
#include <splatfit/video.h>

#include <math.h>

#include "../base/file.h"
#include "convert.h"
#include "format.h"
#include "y4m.h"

struct sf_video {
    sf_context *ctx;
    sf_video_options options;
    sf_writer writer;
    int32_t chroma_width, chroma_height;
    float luma[3], to_cb, to_cr; /* Y = luma . RGB; Cb = to_cb (B - Y), Cr = to_cr (R - Y), in -1/2..1/2 */
    uint8_t *planes;             /* Y, then Cb, then Cr */
    size_t bytes;
};

sf_video_options sf_video_options_default(void) {
    return (sf_video_options){.width = 640, .height = 480, .rate = 30, .per = 1};
}

static sf_status check_range(sf_context *ctx, const char *name, int64_t value, int64_t least, int64_t most) {
    if (value >= least && value <= most) return SF_OK;
    return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %lld is not in %lld..%lld", name, (long long)value,
                   (long long)least, (long long)most);
}

static sf_status check_options(sf_context *ctx, const sf_video_options *o) {
    sf_status status = check_range(ctx, "width", o->width, 1, SF_FRAME_MAX_SIDE);
    if (!status) status = check_range(ctx, "height", o->height, 1, SF_FRAME_MAX_SIDE);
    if (!status) status = check_range(ctx, "pixels", (int64_t)o->width * o->height, 1, SF_FRAME_MAX_PIXELS);
    if (!status) status = check_range(ctx, "rate", o->rate, 1, 1000000);
    if (!status) status = check_range(ctx, "per", o->per, 1, 1000000);
    if (!status) status = check_range(ctx, "chroma", (int)o->chroma, SF_VIDEO_420, SF_VIDEO_444);
    if (!status) status = check_range(ctx, "matrix", (int)o->matrix, SF_YUV_601, SF_YUV_709);
    return status;
}

static void set_matrix(sf_video *v) {
    double red, blue;
    sf_luma_weights(v->options.matrix, &red, &blue);
    v->luma[0] = (float)red;
    v->luma[1] = (float)(1 - red - blue);
    v->luma[2] = (float)blue;
    v->to_cb = (float)(0.5 / (1 - blue));
    v->to_cr = (float)(0.5 / (1 - red));
}

sf_status sf_video_open(sf_context *ctx, const char *path, const sf_video_options *options,
                        sf_video **video) {
    *video = NULL;
    sf_status status = check_options(ctx, options);
    if (status) return status;
    sf_video *v = sf_calloc(ctx, 1, sizeof *v);
    if (!v) return SF_ERR_MEMORY;
    v->ctx = ctx;
    v->options = *options;
    int share = options->chroma == SF_VIDEO_420 ? 2 : 1;
    v->chroma_width = (options->width + share - 1) / share;
    v->chroma_height = (options->height + share - 1) / share;
    v->bytes = (size_t)options->width * (size_t)options->height +
               2 * (size_t)v->chroma_width * (size_t)v->chroma_height;
    set_matrix(v);
    v->planes = sf_alloc(ctx, v->bytes, 1);
    status = v->planes ? sf_writer_open(&v->writer, ctx, path) : SF_ERR_MEMORY;
    if (status) {
        sf_free(ctx, v->planes);
        sf_free(ctx, v);
        return status;
    }
    sf_writer_printf(&v->writer, SF_Y4M_MAGIC "W%d H%d F%d:%d Ip A1:1 C%s XCOLORRANGE=LIMITED\n",
                     (int)options->width, (int)options->height, (int)options->rate, (int)options->per,
                     share == 2 ? "420jpeg" : "444");
    *video = v;
    return SF_OK;
}

static float clamp(float value) { return value > 0 ? fminf(value, 1) : 0; }

/* Values of limited range: -1/2..1/2 of chroma to 16..240. */
static uint8_t chroma_byte(float value) { return (uint8_t)(128.5f + 224 * value); }

static float luma_of(const sf_video *v, const float rgb[3]) {
    return v->luma[0] * clamp(rgb[0]) + v->luma[1] * clamp(rgb[1]) + v->luma[2] * clamp(rgb[2]);
}

/* The mean colour of the pixels of a sample of chroma. */
static void mean_of(const sf_video *v, const float *rgb, int32_t x, int32_t y, float mean[3]) {
    int32_t share = v->options.chroma == SF_VIDEO_420 ? 2 : 1, count = 0;
    mean[0] = mean[1] = mean[2] = 0;
    for (int32_t j = share * y; j < share * (y + 1) && j < v->options.height; j++)
        for (int32_t i = share * x; i < share * (x + 1) && i < v->options.width; i++, count++)
            for (size_t k = 0; k < 3; k++)
                mean[k] += clamp(rgb[3 * ((size_t)j * (size_t)v->options.width + (size_t)i) + k]);
    for (size_t k = 0; k < 3; k++) mean[k] /= (float)count;
}

static void fill_planes(const sf_video *v, const float *rgb) {
    size_t pixels = (size_t)v->options.width * (size_t)v->options.height;
    uint8_t *cb = v->planes + pixels, *cr = cb + (size_t)v->chroma_width * (size_t)v->chroma_height;
    for (size_t i = 0; i < pixels; i++) v->planes[i] = (uint8_t)(16.5f + 219 * luma_of(v, rgb + 3 * i));
    for (int32_t y = 0; y < v->chroma_height; y++)
        for (int32_t x = 0; x < v->chroma_width; x++) {
            float mean[3];
            mean_of(v, rgb, x, y, mean);
            float luma = luma_of(v, mean);
            *cb++ = chroma_byte(v->to_cb * (mean[2] - luma));
            *cr++ = chroma_byte(v->to_cr * (mean[0] - luma));
        }
}

sf_status sf_video_add(sf_video *v, const float *rgb) {
    if (v->writer.status) return v->writer.status;
    fill_planes(v, rgb);
    sf_writer_put(&v->writer, "FRAME\n", 6);
    sf_writer_put(&v->writer, v->planes, v->bytes);
    return v->writer.status;
}

static void release(sf_video **video) {
    sf_context *ctx = (*video)->ctx;
    sf_free(ctx, (*video)->planes);
    sf_free(ctx, *video);
    *video = NULL;
}

sf_status sf_video_close(sf_video **video) {
    if (!*video) return SF_OK;
    sf_status status = sf_writer_commit(&(*video)->writer);
    release(video);
    return status;
}

void sf_video_abandon(sf_video **video) {
    if (!*video) return;
    sf_writer_abandon(&(*video)->writer);
    release(video);
}
