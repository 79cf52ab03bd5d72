/* convert.c - frames of every format as planes of floats; JPEGs through TurboJPEG. */
#include "convert.h"

#include "../base/context.h"
#include "../base/pool.h"
#include "../io/picture.h"

#include <stdio.h>
#include <turbojpeg.h>

enum { MAX_SIDE = 65535, ROWS_A_TASK = 16 };

/* 1. Formats */

/* `bytes` for every columns x rows px, what is left over at the right and at the bottom included. */
typedef struct plane_layout {
    uint8_t bytes, columns, rows;
} plane_layout;

static const plane_layout layouts[SF_PIXEL_FORMATS][SF_FRAME_PLANES] = {
    [SF_PIXEL_RGB24] = {{3, 1, 1}},
    [SF_PIXEL_BGR24] = {{3, 1, 1}},
    [SF_PIXEL_GREY] = {{1, 1, 1}},
    [SF_PIXEL_YUYV] = {{4, 2, 1}},
    [SF_PIXEL_UYVY] = {{4, 2, 1}},
    [SF_PIXEL_NV12] = {{1, 1, 1}, {2, 2, 2}},
    [SF_PIXEL_YU12] = {{1, 1, 1}, {1, 2, 2}, {1, 2, 2}},
    [SF_PIXEL_422P] = {{1, 1, 1}, {1, 2, 1}, {1, 2, 1}},
    [SF_PIXEL_444P] = {{1, 1, 1}, {1, 1, 1}, {1, 1, 1}},
};

int sf_format_planes(sf_pixel_format format) {
    int planes = 0;
    if ((unsigned)format >= SF_PIXEL_FORMATS) return 0;
    while (planes < SF_FRAME_PLANES && layouts[format][planes].bytes) planes++;
    return planes;
}

size_t sf_plane_row_bytes(sf_pixel_format format, int plane, int32_t width) {
    plane_layout l = layouts[format][plane];
    return ((size_t)width + l.columns - 1) / l.columns * l.bytes;
}

int32_t sf_plane_rows(sf_pixel_format format, int plane, int32_t height) {
    int32_t rows = layouts[format][plane].rows;
    return height / rows + (height % rows != 0);
}

int sf_format_has_luma(sf_pixel_format format) {
    return format != SF_PIXEL_RGB24 && format != SF_PIXEL_BGR24 && format != SF_PIXEL_MJPEG;
}

void sf_luma_weights(sf_yuv_matrix matrix, double *red, double *blue) {
    static const struct {
        double r, b;
    } weights[] = {
        [SF_YUV_601] = {0.299, 0.114}, [SF_YUV_709] = {0.2126, 0.0722}, [SF_YUV_2020] = {0.2627, 0.0593}};
    *red = weights[matrix].r;
    *blue = weights[matrix].b;
}

sf_yuv sf_yuv_of(sf_yuv_matrix matrix, int full_range) {
    double r, b;
    sf_luma_weights(matrix, &r, &b);
    double g = 1 - r - b;
    double luma = full_range ? 255 : 219, chroma = full_range ? 255 : 224;
    return (sf_yuv){.y_zero = full_range ? 0 : 16,
                    .y_scale = (float)(1 / luma),
                    .r_v = (float)(2 * (1 - r) / chroma),
                    .g_u = (float)(2 * (1 - b) * b / g / chroma),
                    .g_v = (float)(2 * (1 - r) * r / g / chroma),
                    .b_u = (float)(2 * (1 - b) / chroma)};
}

/* 2. Rows */

typedef struct conversion {
    const sf_kernels *kernels;
    const sf_frame *frame;
    sf_yuv yuv;
    float *const *rgb;
    size_t stride;
} conversion;

/* 16..235 of 255 to 0..1: rare, so that it has no kernel of its own. */
static void widen(float *row, int32_t width) {
    for (int32_t i = 0; i < width; i++) {
        float x = (row[i] * 255.0f - 16.0f) / 219.0f;
        row[i] = x < 0 ? 0 : x > 1 ? 1 : x;
    }
}

static void convert_row(const conversion *c, int32_t row) {
    const sf_frame *f = c->frame;
    sf_convert_args args = {.format = f->format, .width = f->width, .yuv = &c->yuv};
    for (int p = 0; p < sf_format_planes(f->format); p++)
        args.plane[p] = f->plane[p] + (size_t)(row / layouts[f->format][p].rows) * f->stride[p];
    for (int ch = 0; ch < 3; ch++) args.rgb[ch] = c->rgb[ch] + (size_t)row * c->stride;
    c->kernels->convert(&args);
    for (int ch = 0; ch < 3 && f->limited_rgb && !sf_format_has_luma(f->format); ch++)
        widen(args.rgb[ch], f->width);
}

static void convert_band(void *arg, size_t task, int thread) {
    (void)thread;
    const conversion *c = arg;
    int32_t first = (int32_t)task * ROWS_A_TASK, end = first + ROWS_A_TASK;
    for (int32_t row = first; row < end && row < c->frame->height; row++) convert_row(c, row);
}

static void convert_rows(sf_context *ctx, const sf_frame *frame, float *const rgb[3], size_t stride) {
    conversion c = {.kernels = ctx->kernels, .frame = frame, .rgb = rgb, .stride = stride};
    if (sf_format_has_luma(frame->format)) c.yuv = sf_yuv_of(frame->matrix, frame->full_range);
    sf_pool_run(ctx->pool, ((size_t)frame->height + ROWS_A_TASK - 1) / ROWS_A_TASK, convert_band, &c);
}

/* 3. JPEG */

static sf_status refuse_jpeg(sf_context *ctx, const sf_frame *frame, const char *why) {
    return sf_fail(ctx, SF_ERR_FORMAT, "frame %llu: JPEG: %s", (unsigned long long)frame->sequence, why);
}

static sf_status read_header(sf_context *ctx, tjhandle jpeg, const sf_frame *f) {
    /* What holds tables alone has a header without these, and no error. */
    int width = 0, height = 0, sampling = -1, space = -1;
    char why[96];
    if (tjDecompressHeader3(jpeg, f->plane[0], (unsigned long)f->bytes, &width, &height, &sampling, &space))
        return refuse_jpeg(ctx, f, tjGetErrorStr2(jpeg));
    if (space == TJCS_CMYK || space == TJCS_YCCK) return refuse_jpeg(ctx, f, "colours: CMYK is no camera's");
    snprintf(why, sizeof why, "size: %d x %d is not the frame's %ld x %ld", width, height, (long)f->width,
             (long)f->height);
    if (width != f->width || height != f->height) return refuse_jpeg(ctx, f, why);
    if (sf_jpeg_can_hold(f->plane[0], f->bytes, width, height)) return SF_OK;
    snprintf(why, sizeof why, "size: %d x %d is more than its %zu bytes can hold", width, height, f->bytes);
    return refuse_jpeg(ctx, f, why);
}

/* A JPEG that was cut off decodes with a warning, its rest grey: a warning is a failure. But some cameras
 * pad what they coded by a few bytes before the end. Of several warnings it is the first that is told, and
 * none comes after the end: all pixels were there. */
static int is_padding(const char *warning) {
    unsigned bytes, marker;
    return sscanf(warning, "Corrupt JPEG data: %u extraneous bytes before marker 0x%x", &bytes, &marker) ==
               2 &&
           marker == 0xd9 && bytes <= 16;
}

static sf_status decode(sf_context *ctx, tjhandle jpeg, const sf_frame *f, uint8_t *pixels) {
    sf_status status = read_header(ctx, jpeg, f);
    if (status) return status;
    if (tjDecompress2(jpeg, f->plane[0], (unsigned long)f->bytes, pixels, f->width, 3 * f->width, f->height,
                      TJPF_RGB, TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS) &&
        !is_padding(tjGetErrorStr2(jpeg)))
        return refuse_jpeg(ctx, f, tjGetErrorStr2(jpeg));
    return SF_OK;
}

static sf_status convert_jpeg(sf_context *ctx, const sf_frame *frame, float *const rgb[3], size_t stride) {
    uint8_t *pixels = sf_alloc(ctx, (size_t)frame->width * (size_t)frame->height, 3);
    if (!pixels) return SF_ERR_MEMORY;
    tjhandle jpeg = tjInitDecompress();
    sf_status status =
        jpeg ? decode(ctx, jpeg, frame, pixels) : sf_fail(ctx, SF_ERR_MEMORY, "frame: JPEG: out of memory");
    if (!status) {
        sf_frame decoded = {.plane = {pixels},
                            .stride = {3 * (size_t)frame->width},
                            .width = frame->width,
                            .height = frame->height,
                            .format = SF_PIXEL_RGB24};
        convert_rows(ctx, &decoded, rgb, stride);
    }
    if (jpeg) tjDestroy(jpeg);
    sf_free(ctx, pixels);
    return status;
}

/* 4. Any */

static sf_status check_planes(sf_context *ctx, const sf_frame *f) {
    for (int p = 0; p < sf_format_planes(f->format); p++) {
        size_t least = sf_plane_row_bytes(f->format, p, f->width);
        if (!f->plane[p])
            return sf_fail(ctx, SF_ERR_ARGUMENT, "frame: plane %d: %s has one, it is NULL", p,
                           sf_pixel_format_name(f->format));
        if (f->stride[p] < least)
            return sf_fail(ctx, SF_ERR_ARGUMENT,
                           "frame: stride of plane %d: %zu is less than the %zu bytes of %ld px %s", p,
                           f->stride[p], least, (long)f->width, sf_pixel_format_name(f->format));
    }
    if (f->format == SF_PIXEL_MJPEG && !f->plane[0])
        return sf_fail(ctx, SF_ERR_ARGUMENT, "frame: plane 0: MJPEG has one, it is NULL");
    return SF_OK;
}

static sf_status check_frame(sf_context *ctx, const sf_frame *f) {
    if (!sf_pixel_format_name(f->format))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "frame: format: %d is none", (int)f->format);
    if (f->width < 1 || f->width > MAX_SIDE || f->height < 1 || f->height > MAX_SIDE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "frame: size: %ld x %ld is not 1 to %d a side", (long)f->width,
                       (long)f->height, MAX_SIDE);
    if (sf_format_has_luma(f->format) && (unsigned)f->matrix > SF_YUV_2020)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "frame: matrix: %d is none", (int)f->matrix);
    return check_planes(ctx, f);
}

sf_status sf_frame_convert(sf_context *ctx, const sf_frame *frame, float *const rgb[3], size_t stride) {
    sf_status status = check_frame(ctx, frame);
    if (status) return status;
    if (stride < (size_t)frame->width)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "frame: stride: %zu floats are less than a width of %ld", stride,
                       (long)frame->width);
    if (frame->format == SF_PIXEL_MJPEG) return convert_jpeg(ctx, frame, rgb, stride);
    convert_rows(ctx, frame, rgb, stride);
    return SF_OK;
}
