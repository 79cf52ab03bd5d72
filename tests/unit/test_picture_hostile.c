/* test_picture_hostile.c - JPEG and PNG that are damaged, hostile, or something else. */
#include "picture_fixture.h"

#include "io/picture.h"

#include <spng.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

static file some_png(void) {
    static const png_kind kind = {SPNG_COLOR_TYPE_TRUECOLOR, 8, 0, NULL, NULL};
    uint8_t pixels[PIXELS * 3];
    picture_fill(pixels, 3, 8, 0);
    return picture_make_png(&kind, pixels, sizeof pixels);
}

static void check_truncations(file f, size_t whole) {
    sf_context *ctx = test_context();
    for (size_t size = 0; size < whole; size++) {
        sf_picture p;
        const char *path = picture_put(f.data, size);
        int width, height;
        sf_status status = sf_picture_load(ctx, path, &p);
        if (status != SF_ERR_FORMAT)
            fail_msg("cut to %zu of %zu bytes: %s", size, f.size, sf_status_text(status));
        assert_error_names(ctx, path);
        assert_null(p.rgb);
        status = sf_picture_size(ctx, path, &width, &height);
        if (!status) assert_int_equal(width, WIDTH);
    }
    sf_context_destroy(&ctx);
}

static void test_truncation_at_every_byte(void **state) {
    (void)state;
    file baseline = picture_some_jpeg(TJSAMP_444, 0),
         progressive = picture_some_jpeg(TJSAMP_420, TJFLAG_PROGRESSIVE);
    file png = some_png();
    check_truncations(baseline, baseline.size);
    check_truncations(progressive, progressive.size);
    check_truncations(png,
                      png.size - 16); /* without its last chunk's 12 bytes, and a checksum, it is whole */
    tjFree(baseline.data);
    tjFree(progressive.data);
    free(png.data);
}

static void check_flips(file f) {
    sf_context *ctx = test_context();
    uint8_t *data = malloc(f.size);
    assert_non_null(data);
    for (size_t at = 0; at < f.size; at++)
        for (int flip = 1; flip < 256; flip *= 128) {
            sf_picture p;
            memcpy(data, f.data, f.size);
            data[at] ^= (uint8_t)flip;
            sf_status status = sf_picture_load(ctx, picture_put(data, f.size), &p);
            assert_int_equal(p.rgb != NULL, status == SF_OK);
            if (!status) assert_between(p.width, 1, SF_PICTURE_MAX_SIDE);
            sf_picture_free(ctx, &p);
        }
    free(data);
    sf_context_destroy(&ctx);
}

static void test_flipped_bits(void **state) {
    (void)state;
    file jpeg = picture_some_jpeg(TJSAMP_420, 0), png = some_png();
    check_flips(jpeg);
    check_flips(png);
    tjFree(jpeg.data);
    free(png.data);
}

static void test_other_content(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_picture p;
    int width, height;
    picture_assert_refused(ctx, "", 0, SF_ERR_FORMAT, "is empty");
    picture_assert_refused(ctx, "some text", 9, SF_ERR_FORMAT, "neither a JPEG nor a PNG");
    picture_assert_refused(ctx, "GIF89a, say", 11, SF_ERR_UNSUPPORTED, "is GIF: only JPEG and PNG are read");
    picture_assert_refused(ctx, "RIFFsizeWEBPVP8 ", 16, SF_ERR_UNSUPPORTED, "is WebP");
    picture_assert_refused(ctx,
                           "\0\0\0\x18"
                           "ftypheic",
                           12, SF_ERR_UNSUPPORTED, "is HEIC or AVIF");
    picture_assert_refused(ctx, "MM\0*\0\0", 6, SF_ERR_UNSUPPORTED, "is TIFF");
    /* libjpeg-turbo 2.1 reads this without an error. */
    picture_assert_refused(ctx, "\xff\xd8\xff", 3, SF_ERR_FORMAT, "JPEG: ");
    picture_assert_refused(ctx, "\x89PNG\r\n\x1a\n", 8, SF_ERR_FORMAT, "PNG");
    assert_status(ctx, sf_picture_load(ctx, test_path("absent"), &p), SF_ERR_IO);
    test_assert_contains(p.fault, "No such file", __FILE__, __LINE__);
    assert_status(ctx, sf_picture_load(ctx, test_folder(), &p), SF_ERR_IO);
    assert_status(ctx, sf_picture_size(ctx, test_path("absent"), &width, &height), SF_ERR_IO);
    assert_status(ctx, sf_picture_size(ctx, test_folder(), &width, &height), SF_ERR_IO);
    sf_context_destroy(&ctx);
}

static void set_big32(uint8_t *p, uint32_t v) {
    for (int i = 0; i < 4; i++) p[i] = (uint8_t)(v >> (24 - 8 * i));
}

/* The checksum of a PNG's chunk, over its type and data. */
static uint32_t crc(const uint8_t *data, size_t size) {
    uint32_t c = 0xffffffff;
    for (size_t i = 0; i < size; i++) {
        c ^= data[i];
        for (int k = 0; k < 8; k++) c = c & 1 ? 0xedb88320 ^ (c >> 1) : c >> 1;
    }
    return ~c;
}

/* What compresses best is taken still: one colour in few bytes. */
static void test_plain_pictures_are_no_bombs(void **state) {
    (void)state;
    enum { WIDE = 2000, HIGH = 1500 };
    sf_context *ctx = test_context();
    float *rgb = calloc(3 * (size_t)WIDE * HIGH, sizeof *rgb);
    assert_non_null(rgb);
    for (int png = 0; png < 2; png++) {
        uint8_t *data;
        size_t size;
        sf_picture picture;
        assert_ok(ctx, png ? sf_encode_png(ctx, WIDE, HIGH, rgb, &data, &size)
                           : sf_encode_jpeg(ctx, WIDE, HIGH, rgb, 1, &data, &size));
        test_write(test_path("plain"), data, size);
        assert_ok(ctx, sf_picture_load(ctx, test_path("plain"), &picture));
        assert_int_equal(picture.width, WIDE);
        sf_picture_free(ctx, &picture);
        sf_encoded_free(ctx, &data);
    }
    free(rgb);
    sf_context_destroy(&ctx);
}

/* Passes over the picture, each of some bytes. */
static void test_scans_are_limited(void **state) {
    (void)state;
    static uint8_t data[4096];
    for (size_t i = 0; i + 2 <= sizeof data; i += 8) memcpy(data + i, "\xff\xda", 2);
    assert_true(sf_jpeg_can_hold(data, sizeof data, 32, 32));
    assert_false(sf_jpeg_can_hold(data, sizeof data, 1024, 1024));
    assert_true(sf_jpeg_can_hold(data + 1, 7, 56, 64));
    assert_false(sf_jpeg_can_hold(data + 1, 7, 57, 64));
    assert_true(sf_jpeg_can_hold((const uint8_t *)"\xff", 1, 1, 1)); /* nothing is read behind the end */
}

static void test_sizes_are_limited(void **state) {
    (void)state;
    static const struct {
        uint32_t width, height;
        sf_status status;
        const char *part;
    } cases[] = {{65536, 1, SF_ERR_UNSUPPORTED, "65536 x 1"},
                 {1, 65536, SF_ERR_UNSUPPORTED, "1 x 65536"},
                 {65535, 65535, SF_ERR_UNSUPPORTED, "65535 x 65535"},
                 {0x7fffffff, 0x7fffffff, SF_ERR_UNSUPPORTED, "2147483647"},
                 {0, 5, SF_ERR_FORMAT, "0 x 5"},
                 {65535, 4096, SF_OK, "PNG: size: 65535 x 4096 is more than its "}};
    sf_context *ctx = test_context();
    file png = some_png();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int width, height;
        set_big32(png.data + 16, cases[i].width);
        set_big32(png.data + 20, cases[i].height);
        set_big32(png.data + 29, crc(png.data + 12, 17));
        picture_assert_refused(ctx, png.data, png.size, cases[i].status ? cases[i].status : SF_ERR_FORMAT,
                               cases[i].part);
        assert_status(ctx, sf_picture_size(ctx, test_path("picture"), &width, &height), cases[i].status);
    }
    free(png.data);
    file jpeg = picture_some_jpeg(TJSAMP_444, 0);
    uint8_t *sides = NULL;
    for (size_t i = 0; i + 8 < jpeg.size; i++)
        if (jpeg.data[i] == 0xff && jpeg.data[i + 1] == 0xc0)
            memcpy(sides = jpeg.data + i + 5, "\xff\xdc\xff\xdc", 4);
    assert_non_null(sides);
    picture_assert_refused(ctx, jpeg.data, jpeg.size, SF_ERR_UNSUPPORTED, "65500 x 65500");
    memcpy(sides, "\x10\x00\xff\xdc", 4);
    picture_assert_refused(ctx, jpeg.data, jpeg.size, SF_ERR_FORMAT,
                           "JPEG: size: 65500 x 4096 is more than its ");
    tjFree(jpeg.data);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_truncation_at_every_byte),
        cmocka_unit_test(test_flipped_bits),
        cmocka_unit_test(test_other_content),
        cmocka_unit_test(test_sizes_are_limited),
        cmocka_unit_test(test_plain_pictures_are_no_bombs),
        cmocka_unit_test(test_scans_are_limited),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
