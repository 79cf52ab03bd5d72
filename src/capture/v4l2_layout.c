/* v4l2_layout.c - see v4l2_layout.h. */
#ifdef __linux__
#include "v4l2_layout.h"

#include "convert.h"
#include "format.h"

#include <string.h>

/* 1. What the driver gives */

static void take_single(const struct v4l2_pix_format *p, sf_v4l2_given *g) {
    *g = (sf_v4l2_given){.fourcc = p->pixelformat,
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

static void take_multi(const struct v4l2_pix_format_mplane *p, sf_v4l2_given *g) {
    *g = (sf_v4l2_given){.fourcc = p->pixelformat,
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

static void take_given(const struct v4l2_format *f, sf_v4l2_given *g) {
    if (f->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE)
        take_multi(&f->fmt.pix_mp, g);
    else
        take_single(&f->fmt.pix, g);
}

sf_status sf_v4l2_get_given(sf_v4l2_device *device, sf_v4l2_given *g) {
    struct v4l2_format f;
    memset(&f, 0, sizeof f);
    f.type = device->type;
    if (sf_v4l2_ioctl(device, VIDIOC_G_FMT, &f)) return sf_v4l2_fail(device, "format: cannot be read");
    take_given(&f, g);
    return SF_OK;
}

sf_status sf_v4l2_set_given(sf_v4l2_device *device, const sf_v4l2_pixels *pixels, int32_t width,
                            int32_t height, sf_v4l2_given *g) {
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

/* 2. Colours and planes */

static void set_colors(sf_context *ctx, const char *path, const sf_v4l2_given *g, sf_v4l2_picture *p) {
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
    int planes = sf_format_planes(format);
    for (int i = 0; i < SF_FRAME_PLANES; i++) {
        sf_pixel_plane(format, w, h, i, &shape[i].row_bytes, &shape[i].rows);
        shape[i].part = sf_pixel_stride_part(format, i);
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
static sf_status lay_out(sf_v4l2_device *device, const sf_v4l2_given *g, sf_v4l2_picture *p) {
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

sf_status sf_v4l2_lay_out(sf_v4l2_device *device, const sf_v4l2_given *g, sf_v4l2_picture *p) {
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
#endif
