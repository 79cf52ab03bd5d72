/* picture_fixture.c - encodes pictures, and refuses them. */
#include "picture_fixture.h"

#include "io/picture.h"

#include <spng.h>
#include <string.h>
#include <turbojpeg.h>

const char *picture_put(const void *data, size_t size) {
    const char *path = test_path("picture");
    test_write(path, data, size);
    return path;
}

void picture_assert_refused(sf_context *ctx, const void *data, size_t size, sf_status expected,
                            const char *part) {
    const char *path = picture_put(data, size);
    sf_picture p;
    assert_status(ctx, sf_picture_load(ctx, path, &p), expected);
    assert_null(p.rgb);
    assert_null(p.weight);
    assert_error_names(ctx, path);
    assert_error_names(ctx, part);
    test_assert_contains(p.fault, part, __FILE__, __LINE__);
}

file picture_make_png(const png_kind *kind, const void *pixels, size_t size) {
    file f;
    int error;
    spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
    struct spng_ihdr header = {.width = WIDTH,
                               .height = HEIGHT,
                               .bit_depth = (uint8_t)kind->depth,
                               .color_type = (uint8_t)kind->color_type,
                               .interlace_method = (uint8_t)kind->interlaced};
    assert_int_equal(spng_set_option(png, SPNG_ENCODE_TO_BUFFER, 1), 0);
    assert_int_equal(spng_set_ihdr(png, &header), 0);
    if (kind->palette) assert_int_equal(spng_set_plte(png, (struct spng_plte *)kind->palette), 0);
    if (kind->transparency) assert_int_equal(spng_set_trns(png, (struct spng_trns *)kind->transparency), 0);
    assert_int_equal(spng_encode_image(png, pixels, size, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE), 0);
    f.data = spng_get_png_buffer(png, &f.size, &error);
    assert_non_null(f.data);
    spng_ctx_free(png);
    return f;
}

uint8_t picture_value(int c, int i) { return (uint8_t)(40 * c + 3 * i + 1); }

void picture_fill(uint8_t *data, int channels, int depth, int opaque) {
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < channels; c++) {
            int is_alpha = channels % 2 == 0 && c == channels - 1;
            uint8_t v = is_alpha ? (opaque ? 255 : picture_value(3, i)) : picture_value(c, i);
            if (depth == 8) {
                data[i * channels + c] = v;
            } else {
                uint16_t wide = (uint16_t)(v * 257);
                memcpy(data + 2 * (i * channels + c), &wide, 2);
            }
        }
}

file picture_make_jpeg(const uint8_t *pixels, int format, int sampling, int flags) {
    file f = {NULL, 0};
    unsigned long size = 0;
    tjhandle jpeg = tjInitCompress();
    assert_int_equal(
        tjCompress2(jpeg, pixels, WIDTH, 0, HEIGHT, format, &f.data, &size, sampling, 100, flags), 0);
    f.size = size;
    tjDestroy(jpeg);
    return f;
}

void picture_expect_slope(int i, uint8_t rgb[3], uint8_t *weight) {
    rgb[0] = (uint8_t)(100 + 3 * (i % WIDTH));
    rgb[1] = (uint8_t)(120 + 2 * (i / WIDTH));
    rgb[2] = 90;
    *weight = 255;
}

file picture_some_jpeg(int sampling, int flags) {
    uint8_t pixels[PIXELS * 3], weight;
    for (int i = 0; i < PIXELS; i++) picture_expect_slope(i, pixels + 3 * i, &weight);
    return picture_make_jpeg(pixels, TJPF_RGB, sampling, flags);
}
