/* test_convert.c - frames of every format as floats: against float64, whole and cut off JPEGs, bad frames. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

#include "base/rng.h"
#include "capture/convert.h"
#include "reference/pixel.h"

static const double MOST_ERROR = 2e-7;

/* ---- frames of random bytes -----------------------------------------------------------------------------
 */

enum { MOST_ROW = 3 * 67 + 16, MOST_ROWS = 33 };

typedef struct random_frame {
    sf_frame frame;
    uint8_t bytes[3][MOST_ROW * MOST_ROWS];
} random_frame;

/* Rows are `more` bytes longer than they must be, and begin at odd addresses. */
static void make_frame(random_frame *f, sf_pixel_format format, int32_t width, int32_t height, size_t more) {
    sf_rng rng;
    sf_rng_seed(&rng, (uint64_t)format * 1000 + (uint64_t)width);
    memset(&f->frame, 0, sizeof f->frame);
    f->frame.format = format;
    f->frame.width = width;
    f->frame.height = height;
    for (int p = 0; p < sf_format_planes(format); p++) {
        f->frame.stride[p] = sf_plane_row_bytes(format, p, width) + more;
        f->frame.plane[p] = f->bytes[p] + 1;
        assert_true((size_t)sf_plane_rows(format, p, height) * f->frame.stride[p] < sizeof f->bytes[p]);
        for (size_t i = 0; i < sizeof f->bytes[p]; i++) f->bytes[p][i] = (uint8_t)sf_rng_next(&rng);
    }
}

/* Planes of floats, all bytes 0xff before. */
static float *make_planes(size_t stride, int32_t height, float *rgb[3]) {
    size_t plane = stride * (size_t)height;
    float *all = malloc(3 * plane * sizeof *all);
    assert_non_null(all);
    memset(all, 0xff, 3 * plane * sizeof *all);
    for (size_t c = 0; c < 3; c++) rgb[c] = all + c * plane;
    return all;
}

static double worst_of(const sf_frame *f, float *const rgb[3], size_t stride) {
    double worst = 0;
    for (int32_t y = 0; y < f->height; y++)
        for (int32_t x = 0; x < f->width; x++) {
            double want[3];
            test_ref_pixel(f, x, y, want);
            for (int c = 0; c < 3; c++)
                worst = fmax(worst, fabs((double)rgb[c][(size_t)y * stride + (size_t)x] - want[c]));
        }
    return worst;
}

static void check_beyond(const sf_frame *f, float *const rgb[3], size_t stride) {
    static const uint8_t untouched[4] = {0xff, 0xff, 0xff, 0xff};
    for (int c = 0; c < 3; c++)
        for (size_t y = 0; y < (size_t)f->height; y++)
            for (size_t x = (size_t)f->width; x < stride; x++)
                assert_memory_equal(&rgb[c][y * stride + x], untouched, sizeof untouched);
}

static void check_frame(sf_context *ctx, const sf_frame *f, size_t stride) {
    float *rgb[3], *all = make_planes(stride, f->height, rgb);
    assert_ok(ctx, sf_frame_convert(ctx, f, rgb, stride));
    double worst = worst_of(f, rgb, stride);
    if (!(worst <= MOST_ERROR))
        fail_msg("%s %d x %d: off by %g", sf_pixel_format_name(f->format), f->width, f->height, worst);
    check_beyond(f, rgb, stride);
    free(all);
}

static void test_all_formats_and_sizes(void **state) {
    (void)state;
    static const int32_t sizes[][2] = {{1, 1}, {2, 2}, {1, 3}, {3, 1}, {5, 7}, {16, 16}, {17, 33}, {67, 9}};
    static random_frame f;
    sf_context *ctx = test_context();
    for (int format = 0; format < SF_PIXEL_MJPEG; format++)
        for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
            make_frame(&f, (sf_pixel_format)format, sizes[s][0], sizes[s][1], s % 2 * 13);
            for (int matrix = 0; matrix <= SF_YUV_2020; matrix++)
                for (f.frame.full_range = 0; f.frame.full_range < 2; f.frame.full_range++) {
                    f.frame.matrix = (sf_yuv_matrix)matrix;
                    check_frame(ctx, &f.frame, (size_t)sizes[s][0] + s);
                }
        }
    sf_context_destroy(&ctx);
}

static void test_threads_change_nothing(void **state) {
    (void)state;
    enum { WIDTH = 61, HEIGHT = 33 };
    static random_frame f;
    float *rgb[3][3], *all[3];
    make_frame(&f, SF_PIXEL_NV12, WIDTH, HEIGHT, 0);
    for (int threads = 1; threads <= 3; threads++) {
        sf_context *ctx = test_context_threads(threads);
        all[threads - 1] = make_planes(WIDTH, HEIGHT, rgb[threads - 1]);
        assert_ok(ctx, sf_frame_convert(ctx, &f.frame, rgb[threads - 1], WIDTH));
        sf_context_destroy(&ctx);
    }
    for (int i = 1; i < 3; i++) assert_memory_equal(all[0], all[i], 3 * WIDTH * HEIGHT * sizeof(float));
    for (int i = 0; i < 3; i++) free(all[i]);
}

/* ---- colours --------------------------------------------------------------------------------------------
 */

/* Colours as the standards' tables of bars give them, in whole numbers: one part of 255 off at most. */
static void test_known_colours(void **state) {
    (void)state;
    static const struct {
        sf_yuv_matrix matrix;
        int full_range;
        uint8_t yuv[3], rgb[3];
    } known[] = {
        {SF_YUV_601, 0, {235, 128, 128}, {255, 255, 255}},  {SF_YUV_601, 0, {16, 128, 128}, {0, 0, 0}},
        {SF_YUV_601, 0, {81, 90, 240}, {255, 0, 0}},        {SF_YUV_601, 0, {145, 54, 34}, {0, 255, 0}},
        {SF_YUV_601, 0, {41, 240, 110}, {0, 0, 255}},       {SF_YUV_601, 1, {76, 85, 255}, {254, 0, 0}},
        {SF_YUV_709, 0, {63, 102, 240}, {255, 0, 0}},       {SF_YUV_709, 0, {173, 42, 26}, {0, 255, 0}},
        {SF_YUV_709, 0, {32, 240, 118}, {0, 0, 255}},       {SF_YUV_709, 1, {255, 128, 128}, {255, 255, 255}},
        {SF_YUV_2020, 0, {74, 97, 240}, {255, 0, 0}},       {SF_YUV_2020, 0, {28, 240, 119}, {0, 0, 255}},
        {SF_YUV_2020, 0, {126, 128, 128}, {128, 128, 128}},
    };
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        sf_frame f = {.width = 1,
                      .height = 1,
                      .format = SF_PIXEL_444P,
                      .matrix = known[i].matrix,
                      .full_range = known[i].full_range};
        float out[3], *rgb[3] = {&out[0], &out[1], &out[2]};
        for (int p = 0; p < 3; p++) f.plane[p] = &known[i].yuv[p], f.stride[p] = 1;
        assert_ok(ctx, sf_frame_convert(ctx, &f, rgb, 1));
        for (int c = 0; c < 3; c++) {
            if (fabs(255 * (double)out[c] - known[i].rgb[c]) > 1.5)
                fail_msg("colour %zu, channel %d: %g, not %d", i, c, 255 * (double)out[c], known[i].rgb[c]);
        }
    }
    sf_context_destroy(&ctx);
}

/* Every Y with every V, U in steps: in all matrices and ranges. */
static void test_error_is_as_documented(void **state) {
    (void)state;
    enum { SIDE = 256 };
    static uint8_t y[SIDE * SIDE], u[SIDE * SIDE], v[SIDE * SIDE];
    int step = test_is_quick() ? 127 : 15;
    sf_context *ctx = test_context();
    float *rgb[3], *all = make_planes(SIDE, SIDE, rgb);
    double worst = 0;
    for (int i = 0; i < SIDE * SIDE; i++) y[i] = (uint8_t)(i / SIDE), v[i] = (uint8_t)i;
    for (int kind = 0; kind < 6; kind++)
        for (int at = 0; at < SIDE; at += step) {
            memset(u, at, sizeof u);
            sf_frame f = {.plane = {y, u, v},
                          .stride = {SIDE, SIDE, SIDE},
                          .width = SIDE,
                          .height = SIDE,
                          .format = SF_PIXEL_444P,
                          .matrix = (sf_yuv_matrix)(kind / 2),
                          .full_range = kind % 2};
            assert_ok(ctx, sf_frame_convert(ctx, &f, rgb, SIDE));
            worst = fmax(worst, worst_of(&f, rgb, SIDE));
        }
    print_message("greatest error %.3g\n", worst);
    assert_true(worst > 1e-9 && worst < MOST_ERROR);
    free(all);
    sf_context_destroy(&ctx);
}

/* ---- JPEG -----------------------------------------------------------------------------------------------
 */

enum { WIDTH = 37, HEIGHT = 21, PIXELS = WIDTH * HEIGHT };

typedef struct file {
    uint8_t data[1 << 16];
    size_t size;
} file;

static void make_jpeg(file *f, int width, int height, int format, int sampling) {
    uint8_t pixels[4 * PIXELS], *data = NULL;
    unsigned long size = 0;
    int channels = tjPixelSize[format];
    for (int i = 0; i < width * height * channels; i++)
        pixels[i] = (uint8_t)(128 + 55 * sin(i / channels % width * 0.4) +
                              35 * cos(i / channels / width * 0.3) + 10 * (i % channels));
    tjhandle jpeg = tjInitCompress();
    assert_int_equal(tjCompress2(jpeg, pixels, width, 0, height, format, &data, &size, sampling, 90, 0), 0);
    assert_true(size <= sizeof f->data);
    memcpy(f->data, data, size);
    f->size = size;
    tjFree(data);
    tjDestroy(jpeg);
}

static sf_frame frame_of(const file *f) {
    return (sf_frame){.plane = {f->data},
                      .bytes = f->size,
                      .width = WIDTH,
                      .height = HEIGHT,
                      .format = SF_PIXEL_MJPEG,
                      .sequence = 41};
}

/* The file as TurboJPEG itself gives it. */
static void check_jpeg(sf_context *ctx, const file *f, const file *like) {
    uint8_t pixels[3 * PIXELS];
    float *rgb[3], *all = make_planes(WIDTH + 3, HEIGHT, rgb);
    sf_frame frame = frame_of(f);
    tjhandle jpeg = tjInitDecompress();
    assert_int_equal(
        tjDecompress2(jpeg, like->data, like->size, pixels, WIDTH, 0, HEIGHT, TJPF_RGB, TJFLAG_ACCURATEDCT),
        0);
    tjDestroy(jpeg);
    assert_ok(ctx, sf_frame_convert(ctx, &frame, rgb, WIDTH + 3));
    for (int i = 0; i < 3 * PIXELS; i++)
        assert_true(
            fabs((double)rgb[i % 3][i / 3 / WIDTH * (WIDTH + 3) + i / 3 % WIDTH] - pixels[i] / 255.0) < 1e-7);
    check_beyond(&frame, rgb, WIDTH + 3);
    free(all);
}

static void assert_refused(sf_context *ctx, const sf_frame *frame, const char *part) {
    float *rgb[3], *all = make_planes(WIDTH, HEIGHT, rgb);
    assert_status(ctx, sf_frame_convert(ctx, frame, rgb, WIDTH), SF_ERR_FORMAT);
    assert_error_names(ctx, "frame 41");
    assert_error_names(ctx, part);
    free(all);
}

static void test_jpeg_kinds(void **state) {
    (void)state;
    static const int samplings[] = {TJSAMP_444, TJSAMP_422, TJSAMP_420, TJSAMP_GRAY};
    static file f;
    sf_context *ctx = test_context();
    for (int i = 0; i < 4; i++) {
        make_jpeg(&f, WIDTH, HEIGHT, TJPF_RGB, samplings[i]);
        check_jpeg(ctx, &f, &f);
    }
    sf_context_destroy(&ctx);
}

/* Cuts `size` bytes out, or puts zeros in. */
static void cut(file *f, size_t at, size_t size) {
    memmove(f->data + at, f->data + at + size, f->size - at - size);
    f->size -= size;
}

static void put_zeros(file *f, size_t at, size_t size) {
    memmove(f->data + at + size, f->data + at, f->size - at);
    memset(f->data + at, 0, size);
    f->size += size;
}

/* The first segment with that marker. 0: there is none. */
static size_t find_segment(const file *f, int marker) {
    size_t at = 2;
    while (at + 4 < f->size && f->data[at + 1] != 0xda) {
        if (f->data[at + 1] == marker) return at;
        at += 2 + ((size_t)f->data[at + 2] << 8 | f->data[at + 3]);
    }
    return 0;
}

/* Webcams leave the tables of Huffman's code out, which are those of the standard (AVI1). */
static void test_jpeg_without_tables(void **state) {
    (void)state;
    static file whole, f;
    sf_context *ctx = test_context();
    make_jpeg(&whole, WIDTH, HEIGHT, TJPF_RGB, TJSAMP_422);
    f = whole;
    int removed = 0;
    for (size_t at; (at = find_segment(&f, 0xc4)); removed++)
        cut(&f, at, 2 + ((size_t)f.data[at + 2] << 8 | f.data[at + 3]));
    assert_true(removed > 0 && f.size < whole.size - 400);
    check_jpeg(ctx, &f, &whole);
    sf_context_destroy(&ctx);
}

static void test_cut_off_jpeg(void **state) {
    (void)state;
    static file f;
    sf_context *ctx = test_context();
    make_jpeg(&f, WIDTH, HEIGHT, TJPF_RGB, TJSAMP_422);
    size_t whole = f.size;
    for (f.size = 0; f.size < whole - 1; f.size += f.size < 20 || f.size + 40 > whole ? 1 : 17) {
        sf_frame frame = frame_of(&f);
        assert_refused(ctx, &frame, "JPEG");
    }
    f.size = whole;
    put_zeros(&f, f.size, 50); /* after its end */
    check_jpeg(ctx, &f, &f);
    sf_context_destroy(&ctx);
}

static void test_padded_jpeg(void **state) {
    (void)state;
    static file whole, f;
    sf_context *ctx = test_context();
    make_jpeg(&whole, WIDTH, HEIGHT, TJPF_RGB, TJSAMP_422);
    f = whole;
    put_zeros(&f, f.size - 2, 6);
    check_jpeg(ctx, &f, &whole);
    put_zeros(&f, f.size - 2, 60);
    sf_frame frame = frame_of(&f);
    assert_refused(ctx, &frame, "extraneous");
    sf_context_destroy(&ctx);
}

static void test_other_jpegs(void **state) {
    (void)state;
    static file f;
    sf_context *ctx = test_context();
    make_jpeg(&f, WIDTH - 1, HEIGHT, TJPF_RGB, TJSAMP_422);
    sf_frame frame = frame_of(&f);
    assert_refused(ctx, &frame, "36 x 21 is not the frame's 37 x 21");
    make_jpeg(&f, WIDTH, HEIGHT, TJPF_CMYK, TJSAMP_444);
    frame = frame_of(&f);
    assert_refused(ctx, &frame, "CMYK");
    memcpy(f.data, "\xff\xd8\xff\xd9", f.size = 4);
    frame = frame_of(&f);
    assert_refused(ctx, &frame, "JPEG");
    memset(f.data, 7, f.size = 1000);
    frame = frame_of(&f);
    assert_refused(ctx, &frame, "JPEG");
    sf_context_destroy(&ctx);
}

/* ---- what is refused ------------------------------------------------------------------------------------
 */

static void assert_bad(sf_context *ctx, const sf_frame *frame, size_t stride, const char *part) {
    float *rgb[3], *all = make_planes(WIDTH, HEIGHT, rgb);
    assert_status(ctx, sf_frame_convert(ctx, frame, rgb, stride), SF_ERR_ARGUMENT);
    assert_error_names(ctx, part);
    free(all);
}

static void test_bad_frames(void **state) {
    (void)state;
    static random_frame f;
    sf_context *ctx = test_context();
    make_frame(&f, SF_PIXEL_NV12, WIDTH, HEIGHT, 0);
    const sf_frame good = f.frame;
    sf_frame bad = good;
    assert_bad(ctx, &good, WIDTH - 1, "stride: 36");
    bad.plane[1] = NULL;
    assert_bad(ctx, &bad, WIDTH, "plane 1");
    bad = good, bad.stride[1] = WIDTH; /* 19 pairs */
    assert_bad(ctx, &bad, WIDTH, "stride of plane 1: 37 is less than the 38");
    bad = good, bad.width = 0;
    assert_bad(ctx, &bad, WIDTH, "size: 0 x 21");
    bad = good, bad.height = 65536;
    assert_bad(ctx, &bad, WIDTH, "size: 37 x 65536");
    bad = good, bad.format = SF_PIXEL_FORMATS;
    assert_bad(ctx, &bad, WIDTH, "format: 10");
    bad = good, bad.matrix = (sf_yuv_matrix)3;
    assert_bad(ctx, &bad, WIDTH, "matrix: 3");
    bad = good, bad.format = SF_PIXEL_MJPEG, bad.plane[0] = NULL;
    assert_bad(ctx, &bad, WIDTH, "plane 0");
    sf_context_destroy(&ctx);
}

static void test_memory_ends(void **state) {
    (void)state;
    static file f;
    test_allocations a = {0};
    sf_allocator allocator = {test_count_alloc, test_count_free, &a};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    float *rgb[3], *all = make_planes(WIDTH, HEIGHT, rgb);
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    make_jpeg(&f, WIDTH, HEIGHT, TJPF_RGB, TJSAMP_422);
    sf_frame frame = frame_of(&f);
    long before = a.live;
    a.fail_at = a.calls + 1;
    assert_status(ctx, sf_frame_convert(ctx, &frame, rgb, WIDTH), SF_ERR_MEMORY);
    a.fail_at = 0;
    assert_ok(ctx, sf_frame_convert(ctx, &frame, rgb, WIDTH));
    assert_int_equal(a.live, before);
    free(all);
    sf_context_destroy(&ctx);
    assert_int_equal(a.live, 0);
}

static void test_limited_rgb(void **state) {
    (void)state;
    enum { N = 5 };
    static const uint8_t bytes[3 * N] = {0, 16, 17, 125, 126, 234, 235, 236, 255, 16, 235, 0, 1, 2, 3};
    sf_context *ctx = test_context();
    sf_frame f = {.plane = {bytes},
                  .stride = {3 * N},
                  .width = N,
                  .height = 1,
                  .format = SF_PIXEL_RGB24,
                  .limited_rgb = 1};
    float out[3][N], *rgb[3] = {out[0], out[1], out[2]};
    assert_ok(ctx, sf_frame_convert(ctx, &f, rgb, N));
    for (size_t i = 0; i < 3 * N; i++) {
        double truth = fmin(fmax((bytes[i] - 16) / 219.0, 0), 1);
        assert_true(fabs((double)out[i % 3][i / 3] - truth) < 1e-6);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_all_formats_and_sizes),
        cmocka_unit_test(test_threads_change_nothing),
        cmocka_unit_test(test_known_colours),
        cmocka_unit_test(test_limited_rgb),
        cmocka_unit_test(test_error_is_as_documented),
        cmocka_unit_test(test_jpeg_kinds),
        cmocka_unit_test(test_jpeg_without_tables),
        cmocka_unit_test(test_cut_off_jpeg),
        cmocka_unit_test(test_padded_jpeg),
        cmocka_unit_test(test_other_jpegs),
        cmocka_unit_test(test_bad_frames),
        cmocka_unit_test(test_memory_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
