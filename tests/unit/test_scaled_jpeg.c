/* test_scaled_jpeg.c - JPEGs that are decoded at the scale in use, against means of the full pictures. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "base/file.h"
#include "io/picture.h"

enum { WIDE = 203, HIGH = 150, PIXELS = WIDE * HIGH };

/* Waves of several lengths, an edge, and some noise. */
static void paint(uint8_t *rgb) {
    uint32_t random = 1;
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++) {
            double x = i % WIDE, y = i / WIDE,
                   value = 60 * (x > y) + 40 * sin(x / (3 + 5 * c)) + 30 * sin(y / 7);
            random = random * 1664525u + 1013904223u;
            rgb[3 * i + c] = (uint8_t)(100 + value + (double)(random >> 29));
        }
}

/* A project of two JPEGs, whose transforms.json also says `more`. */
static void make_project(sf_context *ctx, const char *more) {
    static uint8_t rgb[3 * PIXELS];
    uint8_t *data;
    size_t size;
    char text[1024];
    paint(rgb);
    assert_ok(ctx, sf_encode_jpeg_8(ctx, WIDE, HIGH, rgb, 92, &data, &size));
    test_write(test_path("a.jpg"), data, size);
    test_write(test_path("b.jpg"), data, size);
    sf_encoded_free(ctx, &data);
    int n =
        snprintf(text, sizeof text,
                 "{\"w\":%d,\"h\":%d,\"fl_x\":180,\"fl_y\":181,\"cx\":100.5,\"cy\":70,%s\"frames\":["
                 "{\"file_path\":\"a.jpg\",\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]},"
                 "{\"file_path\":\"b.jpg\",\"transform_matrix\":[[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}",
                 WIDE, HIGH, more);
    test_write(test_path("transforms.json"), text, (size_t)n);
}

/* The first view's colours and weights, and its camera. */
static sf_camera load(sf_context *ctx, int downscale, float *rgb, float *weight) {
    sf_load_options options = sf_load_options_default();
    sf_scene *scene;
    sf_view_info view;
    options.downscale = downscale;
    assert_ok(ctx, sf_scene_load(ctx, test_path("transforms.json"), &options, &scene));
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    assert_ok(ctx, sf_scene_get_pixels(scene, view.id, rgb, weight));
    sf_scene_destroy(&scene);
    return view.camera;
}

/* Mean and greatest difference, in levels, of what is loaded by n from means of n x n; the greatest is that
 * of boxes in which all counts. */
static void compare(sf_context *ctx, int n, double *mean, double *most) {
    static float whole[3 * PIXELS], counts[PIXELS], small[3 * PIXELS], weight[PIXELS];
    sf_camera full = load(ctx, 1, whole, counts), c = load(ctx, n, small, weight);
    size_t values = 0;
    assert_true(full.width == WIDE && full.height == HIGH);
    assert_true(c.width == WIDE / n && c.height == HIGH / n && fabs(c.fx - 180.0 / n) < 1e-9);
    assert_true(fabs(c.cx - 100.5 / n) < 1e-9 && fabs(c.cy - 70.0 / n) < 1e-9);
    *mean = *most = 0;
    for (int y = 0; y < c.height; y++)
        for (int x = 0; x < c.width; x++) {
            double sum[3] = {0}, all = 0;
            for (int i = 0; i < n * n; i++) {
                int at = (y * n + i / n) * WIDE + x * n + i % n;
                all += (double)counts[at];
                for (int k = 0; k < 3; k++) sum[k] += 255 * (double)whole[3 * at + k] / (n * n);
            }
            for (int k = 0; k < 3 && all >= n * n; k++, values++) {
                double off = fabs(255 * (double)small[3 * (y * c.width + x) + k] - sum[k]);
                *mean += off;
                *most = fmax(*most, off);
            }
        }
    assert_true(values > (size_t)(2 * c.width * c.height));
    *mean /= (double)values;
}

/* Where a factor of 2 is in n, decoding divides; else values are the means, rounded. */
static void test_means_of_boxes(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    double mean, most;
    make_project(ctx, "");
    for (int n = 2; n <= 8; n++) {
        compare(ctx, n, &mean, &most);
        if (n % 2 && most > 0.51) fail_msg("by %d: %g levels off", n, most);
        if (mean > 1 || most > 20) fail_msg("by %d: %g levels off, at most %g", n, mean, most);
        if (n % 2 == 0) assert_true(mean > 0.255); /* more than rounding: it was decoded in part */
    }
    sf_context_destroy(&ctx);
}

static void test_lens_that_is_corrected(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    double mean, most;
    make_project(ctx, "\"k1\":0.05,\"p1\":0.002,");
    for (int n = 2; n <= 8; n += 2) {
        compare(ctx, n, &mean, &most);
        if (n % 4 && most > 0.51) fail_msg("by %d: %g levels off", n, most);
        if (mean > 1.5 || most > 30) fail_msg("by %d: %g levels off, at most %g", n, mean, most);
    }
    sf_context_destroy(&ctx);
}

/* A mask hides pixels of the file: their colours do not come into the means. */
static void test_mask(void **state) {
    (void)state;
    static float mask[3 * PIXELS];
    sf_context *ctx = test_context();
    double mean, most;
    make_project(ctx, "");
    for (int i = 0; i < 3 * PIXELS; i++) mask[i] = (float)(i / 3 % WIDE > 20);
    (void)mkdir(test_path("masks"), 0777);
    assert_ok(ctx, sf_write_png(ctx, test_path("masks/a.png"), WIDE, HIGH, mask));
    compare(ctx, 4, &mean, &most);
    if (most > 0.51) fail_msg("%g levels off", most);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_means_of_boxes),
                                       cmocka_unit_test(test_lens_that_is_corrected),
                                       cmocka_unit_test(test_mask)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
