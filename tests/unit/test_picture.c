/* test_picture.c - JPEG and PNG of every kind, read and written. */
#include "picture_fixture.h"

#include "io/picture.h"

#include <math.h>
#include <spng.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

/* PNG. */

static void assert_pixels(const sf_picture *p, expect_fn expect, int tolerance, int has_weight) {
    assert_int_equal(p->width, WIDTH);
    assert_int_equal(p->height, HEIGHT);
    assert_int_equal(p->weight != NULL, has_weight);
    for (int i = 0; i < PIXELS; i++) {
        uint8_t rgb[3], weight = 255;
        expect(i, rgb, &weight);
        for (int c = 0; c < 3; c++)
            assert_between(p->rgb[c * PIXELS + i] + tolerance - rgb[c], 0, 2 * tolerance);
        if (has_weight) assert_int_equal(p->weight[i], weight);
    }
}

static void check_file(file f, expect_fn expect, int tolerance, int has_weight) {
    sf_context *ctx = test_context();
    sf_picture p;
    int width, height;
    const char *path = picture_put(f.data, f.size);
    assert_ok(ctx, sf_picture_load(ctx, path, &p));
    assert_pixels(&p, expect, tolerance, has_weight);
    assert_int_equal(p.orientation, 1);
    assert_ok(ctx, sf_picture_size(ctx, path, &width, &height));
    assert_int_equal(width, WIDTH);
    assert_int_equal(height, HEIGHT);
    sf_picture_free(ctx, &p);
    sf_context_destroy(&ctx);
}

static void check_png(const png_kind *kind, const void *pixels, size_t size, expect_fn expect,
                      int has_weight) {
    file f = picture_make_png(kind, pixels, size);
    check_file(f, expect, 0, has_weight);
    free(f.data);
}

static void expect_color(int i, uint8_t rgb[3], uint8_t *weight) {
    for (int c = 0; c < 3; c++) rgb[c] = picture_value(c, i);
    *weight = picture_value(3, i);
}

static void expect_grey(int i, uint8_t rgb[3], uint8_t *weight) {
    rgb[0] = rgb[1] = rgb[2] = picture_value(0, i);
    *weight = picture_value(3, i);
}

static void test_png_plain(void **state) {
    (void)state;
    static const struct {
        int type, channels;
        expect_fn expect;
    } kinds[] = {{SPNG_COLOR_TYPE_GRAYSCALE, 1, expect_grey},
                 {SPNG_COLOR_TYPE_GRAYSCALE_ALPHA, 2, expect_grey},
                 {SPNG_COLOR_TYPE_TRUECOLOR, 3, expect_color},
                 {SPNG_COLOR_TYPE_TRUECOLOR_ALPHA, 4, expect_color}};
    uint8_t pixels[PIXELS * 8];
    for (size_t k = 0; k < 4; k++)
        for (int depth = 8; depth <= 16; depth += 8)
            for (int interlaced = 0; interlaced < 2; interlaced++) {
                png_kind kind = {kinds[k].type, depth, interlaced, NULL, NULL};
                size_t size = (size_t)(PIXELS * kinds[k].channels * depth / 8);
                int alpha = kinds[k].channels % 2 == 0;
                picture_fill(pixels, kinds[k].channels, depth, 0);
                check_png(&kind, pixels, size, kinds[k].expect, alpha);
                picture_fill(pixels, kinds[k].channels, depth, 1); /* an alpha channel that hides nothing */
                check_png(&kind, pixels, size, kinds[k].expect, 0);
            }
}

static void expect_bits(int i, uint8_t rgb[3], uint8_t *weight) {
    rgb[0] = rgb[1] = rgb[2] = i % WIDTH % 2 ? 255 : 0;
    *weight = 255;
}

static void test_png_one_bit(void **state) {
    (void)state;
    uint8_t rows[2 * HEIGHT];
    memset(rows, 0x55, sizeof rows);
    png_kind kind = {SPNG_COLOR_TYPE_GRAYSCALE, 1, 0, NULL, NULL};
    check_png(&kind, rows, sizeof rows, expect_bits, 0);
}

static void expect_palette(int i, uint8_t rgb[3], uint8_t *weight) {
    static const uint8_t colors[3][3] = {{10, 20, 30}, {40, 50, 60}, {70, 80, 90}};
    memcpy(rgb, colors[i % 3], 3);
    *weight = i % 3 == 1 ? 128 : 255;
}

static void test_png_palette(void **state) {
    (void)state;
    struct spng_plte palette = {3, {{10, 20, 30, 0}, {40, 50, 60, 0}, {70, 80, 90, 0}}};
    struct spng_trns transparency = {.n_type3_entries = 2, .type3_alpha = {255, 128}};
    uint8_t pixels[PIXELS];
    for (int i = 0; i < PIXELS; i++) pixels[i] = (uint8_t)(i % 3);
    png_kind kind = {SPNG_COLOR_TYPE_INDEXED, 8, 0, &palette, NULL};
    check_png(&kind, pixels, sizeof pixels, expect_palette, 0);
    kind.transparency = &transparency;
    check_png(&kind, pixels, sizeof pixels, expect_palette, 1);
}

static void expect_keyed(int i, uint8_t rgb[3], uint8_t *weight) {
    expect_grey(i, rgb, weight);
    *weight = rgb[0] == picture_value(0, 5) ? 0 : 255;
}

static void test_png_transparent_grey(void **state) {
    (void)state;
    struct spng_trns transparency = {.gray = picture_value(0, 5)};
    uint8_t pixels[PIXELS];
    picture_fill(pixels, 1, 8, 0);
    png_kind kind = {SPNG_COLOR_TYPE_GRAYSCALE, 8, 0, NULL, &transparency};
    check_png(&kind, pixels, sizeof pixels, expect_keyed, 1);
}

/* JPEG. */

static void expect_grey_slope(int i, uint8_t rgb[3], uint8_t *weight) {
    picture_expect_slope(i, rgb, weight);
    rgb[1] = rgb[2] = rgb[0];
}

static void test_jpeg_kinds(void **state) {
    (void)state;
    static const int samplings[] = {TJSAMP_444, TJSAMP_422, TJSAMP_420};
    for (int k = 0; k < 3; k++)
        for (int progressive = 0; progressive < 2; progressive++) {
            file f = picture_some_jpeg(samplings[k], progressive ? TJFLAG_PROGRESSIVE : 0);
            check_file(f, picture_expect_slope, 6, 0);
            tjFree(f.data);
        }
    uint8_t pixels[PIXELS], rgb[3], weight;
    for (int i = 0; i < PIXELS; i++) {
        expect_grey_slope(i, rgb, &weight);
        pixels[i] = rgb[0];
    }
    file f = picture_make_jpeg(pixels, TJPF_GRAY, TJSAMP_GRAY, 0);
    check_file(f, expect_grey_slope, 2, 0);
    tjFree(f.data);
}

static void test_jpeg_cmyk_is_refused(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    uint8_t pixels[PIXELS * 4] = {0};
    file f = picture_make_jpeg(pixels, TJPF_CMYK, TJSAMP_444, 0);
    picture_assert_refused(ctx, f.data, f.size, SF_ERR_UNSUPPORTED, "CMYK");
    tjFree(f.data);
    sf_context_destroy(&ctx);
}

/* The JPEG with an APP1 segment behind its first two bytes. */
static file with_app1(file jpeg, const uint8_t *body, size_t size) {
    file f = {malloc(jpeg.size + size + 4), jpeg.size + size + 4};
    assert_non_null(f.data);
    memcpy(f.data, jpeg.data, 2);
    memcpy(f.data + 2, (const uint8_t[]){0xff, 0xe1, (uint8_t)((size + 2) >> 8), (uint8_t)(size + 2)}, 4);
    memcpy(f.data + 6, body, size);
    memcpy(f.data + 6 + size, jpeg.data + 2, jpeg.size - 2);
    return f;
}

static int orientation_of(file jpeg, const uint8_t *body, size_t size) {
    sf_context *ctx = test_context();
    file f = with_app1(jpeg, body, size);
    sf_picture p;
    const char *path = picture_put(f.data, f.size);
    assert_ok(ctx, sf_picture_load(ctx, path, &p));
    int orientation = p.orientation;
    assert_pixels(&p, picture_expect_slope, 6, 0); /* read, never applied */
    sf_picture_free(ctx, &p);
    free(f.data);
    sf_context_destroy(&ctx);
    return orientation;
}

static void test_exif_orientation(void **state) {
    (void)state;
    file jpeg = picture_some_jpeg(TJSAMP_444, 0);
    uint8_t little[] = "Exif\0\0II*\0\x08\0\0\0\x02\0"
                       "\x0f\x01\x02\0\x01\0\0\0\0\0\0\0"
                       "\x12\x01\x03\0\x01\0\0\0\x06\0\0\0";
    uint8_t big[] = "Exif\0\0MM\0*\0\0\0\x08\0\x01"
                    "\x01\x12\0\x03\0\0\0\x01\0\x08\0\0";
    assert_int_equal(orientation_of(jpeg, little, sizeof little - 1), 6);
    assert_int_equal(orientation_of(jpeg, big, sizeof big - 1), 8);
    for (size_t size = 0; size < sizeof little - 5; size++) /* cut off anywhere, up to the value */
        assert_int_equal(orientation_of(jpeg, little, size), 1);
    for (int byte = 0; byte < 256; byte += 5) { /* the directory's place, anywhere */
        little[10] = (uint8_t)byte;
        assert_between(orientation_of(jpeg, little, sizeof little - 1), 1, 8);
    }
    memset(little + 10, 0xff, 4);
    assert_int_equal(orientation_of(jpeg, little, sizeof little - 1), 1);
    tjFree(jpeg.data);
}

static void test_size_behind_long_header(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    uint8_t *body = calloc(65000, 1);
    file inner = picture_some_jpeg(TJSAMP_444, 0), once = with_app1(inner, body, 65000),
         f = with_app1(once, body, 65000);
    int width = 0, height = 0;
    assert_ok(ctx, sf_picture_size(ctx, picture_put(f.data, f.size), &width, &height));
    assert_int_equal(width, WIDTH);
    assert_int_equal(height, HEIGHT);
    tjFree(inner.data);
    free(once.data);
    free(f.data);
    free(body);
    sf_context_destroy(&ctx);
}

/* Writing. */

static void test_write_png_reads_back(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const float values[] = {0,     1,      0.5f,    -3, 7, NAN, 0.25f, 100 / 255.0f, 254.6f / 255,
                            1e30f, -1e30f, INFINITY};
    const uint8_t expected[3][4] = {{0, 0, 64, 255}, {255, 255, 100, 0}, {128, 0, 255, 255}};
    const char *path = test_path("written.png");
    sf_picture p;
    assert_ok(ctx, sf_write_png(ctx, path, 2, 2, values));
    assert_ok(ctx, sf_picture_load(ctx, path, &p));
    assert_int_equal(p.width, 2);
    assert_int_equal(p.height, 2);
    assert_memory_equal(p.rgb, expected, sizeof expected);
    assert_null(p.weight);
    sf_picture_free(ctx, &p);
    assert_status(ctx, sf_write_png(ctx, path, 0, 2, values), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "0 x 2");
    assert_status(ctx, sf_write_png(ctx, path, 65536, 1, values), SF_ERR_ARGUMENT);
    assert_status(ctx, sf_write_png(ctx, test_path("none/x.png"), 2, 2, values), SF_ERR_IO);
    assert_error_names(ctx, "none/x.png");
    sf_context_destroy(&ctx);
}

/* Red and blue pixels side by side stay apart: chroma is not subsampled. */
static void test_encode_reads_back(void **state) {
    (void)state;
    enum { SIDE = 16 };
    sf_context *ctx = test_context();
    float rgb[3 * SIDE * SIDE];
    uint8_t *bytes;
    size_t size;
    sf_picture p;
    for (int i = 0; i < SIDE * SIDE; i++) {
        rgb[3 * i] = i % 2 ? 0.8f : 0.1f;
        rgb[3 * i + 1] = 0.2f;
        rgb[3 * i + 2] = i % 2 ? 0.1f : 0.8f;
    }
    for (int png = 0; png < 2; png++) {
        int most = png ? 0 : 12; /* of 255 */
        assert_ok(ctx, png ? sf_encode_png(ctx, SIDE, SIDE, rgb, &bytes, &size)
                           : sf_encode_jpeg(ctx, SIDE, SIDE, rgb, 95, &bytes, &size));
        assert_ok(ctx, sf_picture_load(ctx, picture_put(bytes, size), &p));
        assert_int_equal(p.width, SIDE);
        assert_int_equal(p.height, SIDE);
        for (int i = 0; i < 3 * SIDE * SIDE; i++)
            assert_true(abs(p.rgb[i % 3 * SIDE * SIDE + i / 3] - (int)(255 * rgb[i] + 0.5f)) <= most);
        sf_picture_free(ctx, &p);
        sf_encoded_free(ctx, &bytes);
        assert_null(bytes);
    }
    size_t coarse;
    assert_ok(ctx, sf_encode_jpeg(ctx, SIDE, SIDE, rgb, 100, &bytes, &size));
    sf_encoded_free(ctx, &bytes);
    assert_ok(ctx, sf_encode_jpeg(ctx, SIDE, SIDE, rgb, 1, &bytes, &coarse));
    sf_encoded_free(ctx, &bytes);
    assert_true(coarse < size);
    assert_status(ctx, sf_encode_jpeg(ctx, SIDE, SIDE, rgb, 0, &bytes, &size), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "quality: 0");
    assert_null(bytes);
    assert_status(ctx, sf_encode_jpeg(ctx, SIDE, SIDE, rgb, 101, &bytes, &size), SF_ERR_ARGUMENT);
    assert_status(ctx, sf_encode_jpeg(ctx, 65501, 1, rgb, 95, &bytes, &size), SF_ERR_UNSUPPORTED);
    assert_status(ctx, sf_encode_jpeg(ctx, 0, 1, rgb, 95, &bytes, &size), SF_ERR_ARGUMENT);
    assert_status(ctx, sf_encode_png(ctx, 3, -1, rgb, &bytes, &size), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "3 x -1");
    sf_context_destroy(&ctx);
}

/* Big-endian in the file, whatever the machine: the high byte is what 8 bits show. */
static void test_grey_of_16_bits(void **state) {
    (void)state;
    enum { SIDE = 16 };
    static uint16_t values[SIDE * SIDE];
    sf_context *ctx = test_context();
    sf_picture p;
    const char *path = test_path("grey16.png");
    for (size_t i = 0; i < SIDE * SIDE; i++) values[i] = (uint16_t)(257 * i);
    assert_ok(ctx, sf_write_png_grey16(ctx, path, SIDE, SIDE, values));
    assert_ok(ctx, sf_picture_load(ctx, path, &p));
    assert_true(p.width == SIDE && p.height == SIDE);
    for (size_t i = 0; i < SIDE * SIDE; i++) assert_int_equal(p.rgb[i], i);
    sf_picture_free(ctx, &p);
    for (size_t i = 0; i < SIDE * SIDE; i++) values[i] = (uint16_t)i; /* low bytes alone: black */
    assert_ok(ctx, sf_write_png_grey16(ctx, path, SIDE, SIDE, values));
    assert_ok(ctx, sf_picture_load(ctx, path, &p));
    assert_true(p.rgb[0] == 0 && p.rgb[SIDE * SIDE - 1] <= 1);
    sf_picture_free(ctx, &p);
    assert_status(ctx, sf_write_png_grey16(ctx, test_path("none.png"), 0, 4, values), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "none.png: size: 0 x 4");
    assert_status(ctx, sf_write_png_grey16(ctx, test_path("no/such.png"), 4, 4, values), SF_ERR_IO);
    sf_context_destroy(&ctx);
}

/* Of what is divided by 1, 6 and 16, decoding divides by 1, 2 and 8; pixels are means of those that they
 * stand for. */
static void test_jpeg_reduced(void **state) {
    (void)state;
    enum { WIDE = 401, HIGH = 300 };
    static const int sides[] = {401, 70, 26}, divided[] = {1, 2, 8};
    static uint8_t rgb[3 * WIDE * HIGH];
    sf_context *ctx = test_context();
    uint8_t *data;
    size_t size;
    for (int i = 0; i < WIDE * HIGH; i++)
        rgb[3 * i] = (uint8_t)(i % WIDE / 2), rgb[3 * i + 1] = (uint8_t)(i / WIDE / 2), rgb[3 * i + 2] = 99;
    assert_ok(ctx, sf_encode_jpeg_8(ctx, WIDE, HIGH, rgb, 98, &data, &size));
    const char *path = picture_put(data, size);
    sf_encoded_free(ctx, &data);
    for (int k = 0; k < 3; k++) {
        sf_picture p;
        int by = divided[k], width, height;
        assert_ok(ctx, sf_picture_load_reduced(ctx, path, sides[k], &p));
        assert_ok(ctx, sf_picture_size_reduced(ctx, path, sides[k], &width, &height));
        assert_true(width == p.width && height == p.height);
        assert_int_equal(p.divided, by);
        assert_true(p.file_width == WIDE && p.file_height == HIGH);
        assert_true(p.width == (WIDE + by - 1) / by && p.height == (HIGH + by - 1) / by);
        for (int y = 0; y + 1 < p.height; y++)
            for (int x = 0; x + 1 < p.width; x++) {
                const uint8_t *at = p.rgb + y * p.width + x;
                assert_true(fabs(at[0] - (x * by + by / 2) / 2.0) < 3);
                assert_true(fabs(at[p.width * p.height] - (y * by + by / 2) / 2.0) < 3);
            }
        sf_picture_free(ctx, &p);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_png_plain),
        cmocka_unit_test(test_png_one_bit),
        cmocka_unit_test(test_png_palette),
        cmocka_unit_test(test_png_transparent_grey),
        cmocka_unit_test(test_jpeg_kinds),
        cmocka_unit_test(test_jpeg_cmyk_is_refused),
        cmocka_unit_test(test_exif_orientation),
        cmocka_unit_test(test_size_behind_long_header),
        cmocka_unit_test(test_write_png_reads_back),
        cmocka_unit_test(test_encode_reads_back),
        cmocka_unit_test(test_grey_of_16_bits),
        cmocka_unit_test(test_jpeg_reduced),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
