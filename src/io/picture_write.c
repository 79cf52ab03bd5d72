/* picture_write.c - pictures written: JPEG through TurboJPEG, PNG through libspng. */
#include <spng.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

#include "../base/file.h"
#include "picture.h"

static uint8_t to_8_bits(float value) {
    if (!(value > 0)) return 0; /* not a number too */
    return value < 1 ? (uint8_t)(value * 255 + 0.5f) : 255;
}

static sf_status check_size(sf_context *ctx, int width, int height) {
    if (width > 0 && height > 0 && width <= SF_PICTURE_MAX_SIDE && height <= SF_PICTURE_MAX_SIDE &&
        (uint64_t)width * (uint64_t)height <= SF_PICTURE_MAX_PIXELS)
        return SF_OK;
    return sf_fail(ctx, SF_ERR_ARGUMENT, "size: %d x %d is not a picture's", width, height);
}

/* As 8 bits a channel; NULL after a failure. */
static sf_status take_8_bits(sf_context *ctx, int width, int height, const float *rgb, uint8_t **pixels) {
    *pixels = NULL;
    sf_status status = check_size(ctx, width, height);
    if (status) return status;
    size_t values = (size_t)width * (size_t)height * 3;
    *pixels = sf_alloc(ctx, values, 1);
    if (!*pixels) return SF_ERR_MEMORY;
    for (size_t i = 0; i < values; i++) (*pixels)[i] = to_8_bits(rgb[i]);
    return SF_OK;
}

static sf_status copy_file(sf_context *ctx, const void *data, size_t size, uint8_t **file) {
    *file = sf_alloc(ctx, size, 1);
    if (!*file) return SF_ERR_MEMORY;
    memcpy(*file, data, size);
    return SF_OK;
}

static sf_status png_file(sf_context *ctx, struct spng_ihdr *header, const void *pixels, uint8_t **file,
                          size_t *size) {
    spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
    if (!png) return sf_fail(ctx, SF_ERR_MEMORY, "PNG: out of memory");
    size_t a_pixel = header->color_type == SPNG_COLOR_TYPE_TRUECOLOR ? 3 : 1;
    size_t bytes = (size_t)header->width * header->height * a_pixel * header->bit_depth / 8;
    int error = spng_set_option(png, SPNG_ENCODE_TO_BUFFER, 1);
    if (!error) error = spng_set_ihdr(png, header);
    if (!error) error = spng_encode_image(png, pixels, bytes, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE);
    void *data = error ? NULL : spng_get_png_buffer(png, size, &error);
    sf_status status = data ? copy_file(ctx, data, *size, file)
                            : sf_fail(ctx, SF_ERR_MEMORY, "PNG: %s", spng_strerror(error));
    free(data);
    spng_ctx_free(png);
    return status;
}

sf_status sf_encode_png(sf_context *ctx, int width, int height, const float *rgb, uint8_t **file,
                        size_t *size) {
    uint8_t *pixels;
    *file = NULL;
    sf_status status = take_8_bits(ctx, width, height, rgb, &pixels);
    if (status) return status;
    struct spng_ihdr header = {.width = (uint32_t)width,
                               .height = (uint32_t)height,
                               .bit_depth = 8,
                               .color_type = SPNG_COLOR_TYPE_TRUECOLOR};
    status = png_file(ctx, &header, pixels, file, size);
    sf_free(ctx, pixels);
    return status;
}

static sf_status jpeg_file(sf_context *ctx, int width, int height, const uint8_t *pixels, int quality,
                           uint8_t **file, size_t *size) {
    unsigned long used = tjBufSize(width, height, TJSAMP_444);
    unsigned char *data = sf_alloc(ctx, used, 1);
    tjhandle jpeg = data ? tjInitCompress() : NULL;
    sf_status status = SF_ERR_MEMORY;
    if (jpeg)
        status = tjCompress2(jpeg, pixels, width, 0, height, TJPF_RGB, &data, &used, TJSAMP_444, quality,
                             TJFLAG_NOREALLOC | TJFLAG_ACCURATEDCT)
                     ? sf_fail(ctx, SF_ERR_MEMORY, "JPEG: %s", tjGetErrorStr2(jpeg))
                     : copy_file(ctx, data, used, file);
    if (jpeg) tjDestroy(jpeg);
    sf_free(ctx, data);
    *size = used;
    return status;
}

static sf_status check_jpeg(sf_context *ctx, int width, int height, int quality) {
    enum { MAX_JPEG_SIDE = 65500 }; /* libjpeg's */
    if (quality < 1 || quality > 100)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "quality: %d is not in 1..100", quality);
    if (width > MAX_JPEG_SIDE || height > MAX_JPEG_SIDE)
        return sf_fail(ctx, SF_ERR_UNSUPPORTED, "size: %d x %d is more than %d a side of a JPEG", width,
                       height, MAX_JPEG_SIDE);
    return SF_OK;
}

sf_status sf_encode_jpeg(sf_context *ctx, int width, int height, const float *rgb, int quality,
                         uint8_t **file, size_t *size) {
    uint8_t *pixels;
    *file = NULL;
    sf_status status = check_jpeg(ctx, width, height, quality);
    if (!status) status = take_8_bits(ctx, width, height, rgb, &pixels);
    if (status) return status;
    status = jpeg_file(ctx, width, height, pixels, quality, file, size);
    sf_free(ctx, pixels);
    return status;
}

sf_status sf_encode_jpeg_8(sf_context *ctx, int width, int height, const uint8_t *rgb, int quality,
                           uint8_t **file, size_t *size) {
    *file = NULL;
    sf_status status = check_jpeg(ctx, width, height, quality);
    if (!status) status = check_size(ctx, width, height);
    return status ? status : jpeg_file(ctx, width, height, rgb, quality, file, size);
}

void sf_encoded_free(sf_context *ctx, uint8_t **file) {
    sf_free(ctx, *file);
    *file = NULL;
}

/* The path goes in front of what encoding has to say. */
static sf_status name_path(sf_context *ctx, sf_status status, const char *path) {
    char why[SF_PICTURE_FAULT_BYTES];
    snprintf(why, sizeof why, "%s", sf_last_error(ctx));
    return sf_fail(ctx, status, "%s: %s", path, why);
}

sf_status sf_write_png(sf_context *ctx, const char *path, int width, int height, const float *rgb) {
    uint8_t *file;
    size_t size;
    sf_status status = sf_encode_png(ctx, width, height, rgb, &file, &size);
    if (status) return name_path(ctx, status, path);
    status = sf_write_file(ctx, path, file, size);
    sf_encoded_free(ctx, &file);
    return status;
}

sf_status sf_write_png_grey16(sf_context *ctx, const char *path, int width, int height,
                              const uint16_t *values) {
    uint8_t *file = NULL;
    size_t size;
    struct spng_ihdr header = {.width = (uint32_t)width,
                               .height = (uint32_t)height,
                               .bit_depth = 16,
                               .color_type = SPNG_COLOR_TYPE_GRAYSCALE};
    sf_status status = check_size(ctx, width, height);
    if (!status) status = png_file(ctx, &header, values, &file, &size);
    if (status) return name_path(ctx, status, path);
    status = sf_write_file(ctx, path, file, size);
    sf_encoded_free(ctx, &file);
    return status;
}
