/* test_picture.c - JPEG and PNG of every kind, whole, damaged and hostile. */
#include "testing.h"

#include "io/picture.h"

#include <math.h>
#include <spng.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

enum { WIDTH = 13, HEIGHT = 7, PIXELS = WIDTH * HEIGHT };

typedef struct file {
    uint8_t *data;
    size_t size;
} file;

/* Writes the bytes under a name without an ending: only their content tells what they are. */
static const char *put(const void *data, size_t size) {
    const char *path = test_path("picture");
    test_write(path, data, size);
    return path;
}

static void assert_refused(sf_context *ctx, const void *data, size_t size, sf_status expected,
                           const char *part) {
    const char *path = put(data, size);
    sf_picture p;
    assert_status(ctx, sf_picture_load(ctx, path, &p), expected);
    assert_null(p.rgb);
    assert_null(p.weight);
    assert_error_names(ctx, path);
    assert_error_names(ctx, part);
    test_assert_contains(p.fault, part, __FILE__, __LINE__);
}

/* PNG. */

typedef struct png_kind {
    int color_type, depth, interlaced;
    const struct spng_plte *palette;
    const struct spng_trns *transparency;
} png_kind;

static file make_png(const png_kind *kind, const void *pixels, size_t size) {
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

/* What the tests put into channel c of pixel i. */
static uint8_t value(int c, int i) { return (uint8_t)(40 * c + 3 * i + 1); }

typedef void (*expect_fn)(int i, uint8_t rgb[3], uint8_t *weight);

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
    const char *path = put(f.data, f.size);
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
    file f = make_png(kind, pixels, size);
    check_file(f, expect, 0, has_weight);
    free(f.data);
}

static void expect_color(int i, uint8_t rgb[3], uint8_t *weight) {
    for (int c = 0; c < 3; c++) rgb[c] = value(c, i);
    *weight = value(3, i);
}

static void expect_grey(int i, uint8_t rgb[3], uint8_t *weight) {
    rgb[0] = rgb[1] = rgb[2] = value(0, i);
    *weight = value(3, i);
}

/* channels values a pixel, 8 or 16 bits; the last of 2 or 4 is alpha, value(3, i). */
static void fill(uint8_t *data, int channels, int depth, int opaque) {
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < channels; c++) {
            int is_alpha = channels % 2 == 0 && c == channels - 1;
            uint8_t v = is_alpha ? (opaque ? 255 : value(3, i)) : value(c, i);
            if (depth == 8) {
                data[i * channels + c] = v;
            } else {
                uint16_t wide = (uint16_t)(v * 257);
                memcpy(data + 2 * (i * channels + c), &wide, 2);
            }
        }
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
                fill(pixels, kinds[k].channels, depth, 0);
                check_png(&kind, pixels, size, kinds[k].expect, alpha);
                fill(pixels, kinds[k].channels, depth, 1); /* an alpha channel that hides nothing */
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
    *weight = rgb[0] == value(0, 5) ? 0 : 255;
}

static void test_png_transparent_grey(void **state) {
    (void)state;
    struct spng_trns transparency = {.gray = value(0, 5)};
    uint8_t pixels[PIXELS];
    fill(pixels, 1, 8, 0);
    png_kind kind = {SPNG_COLOR_TYPE_GRAYSCALE, 8, 0, NULL, &transparency};
    check_png(&kind, pixels, sizeof pixels, expect_keyed, 1);
}

static file some_png(void) {
    static const png_kind kind = {SPNG_COLOR_TYPE_TRUECOLOR, 8, 0, NULL, NULL};
    uint8_t pixels[PIXELS * 3];
    fill(pixels, 3, 8, 0);
    return make_png(&kind, pixels, sizeof pixels);
}

/* JPEG. */

static file make_jpeg(const uint8_t *pixels, int format, int sampling, int flags) {
    file f = {NULL, 0};
    unsigned long size = 0;
    tjhandle jpeg = tjInitCompress();
    assert_int_equal(
        tjCompress2(jpeg, pixels, WIDTH, 0, HEIGHT, format, &f.data, &size, sampling, 100, flags), 0);
    f.size = size;
    tjDestroy(jpeg);
    return f;
}

static void expect_slope(int i, uint8_t rgb[3], uint8_t *weight) {
    rgb[0] = (uint8_t)(100 + 3 * (i % WIDTH));
    rgb[1] = (uint8_t)(120 + 2 * (i / WIDTH));
    rgb[2] = 90;
    *weight = 255;
}

static void expect_grey_slope(int i, uint8_t rgb[3], uint8_t *weight) {
    expect_slope(i, rgb, weight);
    rgb[1] = rgb[2] = rgb[0];
}

static file some_jpeg(int sampling, int flags) {
    uint8_t pixels[PIXELS * 3], weight;
    for (int i = 0; i < PIXELS; i++) expect_slope(i, pixels + 3 * i, &weight);
    return make_jpeg(pixels, TJPF_RGB, sampling, flags);
}

static void test_jpeg_kinds(void **state) {
    (void)state;
    static const int samplings[] = {TJSAMP_444, TJSAMP_422, TJSAMP_420};
    for (int k = 0; k < 3; k++)
        for (int progressive = 0; progressive < 2; progressive++) {
            file f = some_jpeg(samplings[k], progressive ? TJFLAG_PROGRESSIVE : 0);
            check_file(f, expect_slope, 6, 0);
            tjFree(f.data);
        }
    uint8_t pixels[PIXELS], rgb[3], weight;
    for (int i = 0; i < PIXELS; i++) {
        expect_grey_slope(i, rgb, &weight);
        pixels[i] = rgb[0];
    }
    file f = make_jpeg(pixels, TJPF_GRAY, TJSAMP_GRAY, 0);
    check_file(f, expect_grey_slope, 2, 0);
    tjFree(f.data);
}

static void test_jpeg_cmyk_is_refused(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    uint8_t pixels[PIXELS * 4] = {0};
    file f = make_jpeg(pixels, TJPF_CMYK, TJSAMP_444, 0);
    assert_refused(ctx, f.data, f.size, SF_ERR_UNSUPPORTED, "CMYK");
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
    const char *path = put(f.data, f.size);
    assert_ok(ctx, sf_picture_load(ctx, path, &p));
    int orientation = p.orientation;
    assert_pixels(&p, expect_slope, 6, 0); /* read, never applied */
    sf_picture_free(ctx, &p);
    free(f.data);
    sf_context_destroy(&ctx);
    return orientation;
}

static void test_exif_orientation(void **state) {
    (void)state;
    file jpeg = some_jpeg(TJSAMP_444, 0);
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
    file inner = some_jpeg(TJSAMP_444, 0), once = with_app1(inner, body, 65000),
         f = with_app1(once, body, 65000);
    int width = 0, height = 0;
    assert_ok(ctx, sf_picture_size(ctx, put(f.data, f.size), &width, &height));
    assert_int_equal(width, WIDTH);
    assert_int_equal(height, HEIGHT);
    tjFree(inner.data);
    free(once.data);
    free(f.data);
    free(body);
    sf_context_destroy(&ctx);
}

/* Damage. */

static void check_truncations(file f, size_t whole) {
    sf_context *ctx = test_context();
    for (size_t size = 0; size < whole; size++) {
        sf_picture p;
        const char *path = put(f.data, size);
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
    file baseline = some_jpeg(TJSAMP_444, 0), progressive = some_jpeg(TJSAMP_420, TJFLAG_PROGRESSIVE);
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
            sf_status status = sf_picture_load(ctx, put(data, f.size), &p);
            assert_int_equal(p.rgb != NULL, status == SF_OK);
            if (!status) assert_between(p.width, 1, SF_PICTURE_MAX_SIDE);
            sf_picture_free(ctx, &p);
        }
    free(data);
    sf_context_destroy(&ctx);
}

static void test_flipped_bits(void **state) {
    (void)state;
    file jpeg = some_jpeg(TJSAMP_420, 0), png = some_png();
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
    assert_refused(ctx, "", 0, SF_ERR_FORMAT, "is empty");
    assert_refused(ctx, "some text", 9, SF_ERR_FORMAT, "neither a JPEG nor a PNG");
    assert_refused(ctx, "GIF89a, say", 11, SF_ERR_UNSUPPORTED, "is GIF: only JPEG and PNG are read");
    assert_refused(ctx, "RIFFsizeWEBPVP8 ", 16, SF_ERR_UNSUPPORTED, "is WebP");
    assert_refused(ctx,
                   "\0\0\0\x18"
                   "ftypheic",
                   12, SF_ERR_UNSUPPORTED, "is HEIC or AVIF");
    assert_refused(ctx, "MM\0*\0\0", 6, SF_ERR_UNSUPPORTED, "is TIFF");
    /* libjpeg-turbo 2.1 reads this without an error. */
    assert_refused(ctx, "\xff\xd8\xff", 3, SF_ERR_FORMAT, "JPEG: ");
    assert_refused(ctx, "\x89PNG\r\n\x1a\n", 8, SF_ERR_FORMAT, "PNG");
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
        assert_refused(ctx, png.data, png.size, cases[i].status ? cases[i].status : SF_ERR_FORMAT,
                       cases[i].part);
        assert_status(ctx, sf_picture_size(ctx, test_path("picture"), &width, &height), cases[i].status);
    }
    free(png.data);
    file jpeg = some_jpeg(TJSAMP_444, 0);
    uint8_t *sides = NULL;
    for (size_t i = 0; i + 8 < jpeg.size; i++)
        if (jpeg.data[i] == 0xff && jpeg.data[i + 1] == 0xc0)
            memcpy(sides = jpeg.data + i + 5, "\xff\xdc\xff\xdc", 4);
    assert_non_null(sides);
    assert_refused(ctx, jpeg.data, jpeg.size, SF_ERR_UNSUPPORTED, "65500 x 65500");
    memcpy(sides, "\x10\x00\xff\xdc", 4);
    assert_refused(ctx, jpeg.data, jpeg.size, SF_ERR_FORMAT, "JPEG: size: 65500 x 4096 is more than its ");
    tjFree(jpeg.data);
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
        assert_ok(ctx, sf_picture_load(ctx, put(bytes, size), &p));
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
        cmocka_unit_test(test_truncation_at_every_byte),
        cmocka_unit_test(test_flipped_bits),
        cmocka_unit_test(test_other_content),
        cmocka_unit_test(test_sizes_are_limited),
        cmocka_unit_test(test_plain_pictures_are_no_bombs),
        cmocka_unit_test(test_scans_are_limited),
        cmocka_unit_test(test_write_png_reads_back),
        cmocka_unit_test(test_encode_reads_back),
        cmocka_unit_test(test_grey_of_16_bits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
