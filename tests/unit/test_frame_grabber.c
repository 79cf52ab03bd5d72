/* test_frame_grabber.c - frames that become pictures of one camera, also where some have another size. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "live/frame_grabber.h"

static void write_frame(sf_context *ctx, int number, int width, int height) {
    char path[1024];
    float *rgb = calloc((size_t)(3 * width * height), sizeof *rgb);
    assert_non_null(rgb);
    for (int i = 0; i < 3 * width * height; i++) rgb[i] = (float)number / 10;
    snprintf(path, sizeof path, "%s/f%d.png", test_path("frames"), number);
    assert_ok(ctx, sf_write_png(ctx, path, width, height, rgb));
    free(rgb);
}

/* Larger and smaller ones, and one on its side, are passed over, and one line says so. */
static void other_sizes_are_passed_over(void **state) {
    (void)state;
    static const int sizes[][2] = {{32, 24}, {64, 48}, {32, 24}, {16, 12}, {24, 32}, {32, 24}};
    sf_context *ctx = test_context();
    sf_source *source;
    sf_frame_grabber *grabber;
    const sf_picture *picture;
    sf_status status;
    int taken = 0;
    char text[1100];
    mkdir(test_path("frames"), 0777);
    for (int i = 0; i < 6; i++) write_frame(ctx, i + 1, sizes[i][0], sizes[i][1]);
    snprintf(text, sizeof text, "folder:%s", test_path("frames"));
    assert_ok(ctx, sf_source_open(ctx, text, &source));
    test_log_clear();
    const sf_lens own = {0};
    assert_ok(ctx, sf_frame_grabber_create(ctx, source, &own, 0, 1, 30, &grabber));
    static const double grey[] = {0.1, 0.3, 0.6};
    while (!(status = sf_frame_grabber_take(grabber, 2000, &picture))) {
        assert_true(taken < 3);
        assert_int_equal(picture->camera.width, 32);
        assert_int_equal(picture->camera.height, 24);
        assert_true(fabs((double)picture->rgb[0][32 * 24 - 1] - grey[taken]) < 0.01);
        taken++;
    }
    assert_int_equal(status, SF_ERR_END);
    assert_int_equal(taken, 3);
    const char *said = strstr(test_log, "64 x 48 px after frames of 32 x 24");
    assert_non_null(said);
    assert_null(strstr(strchr(said, '\n'), "px after frames"));
    sf_frame_grabber_destroy(&grabber);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(other_sizes_are_passed_over)};
    return cmocka_run_group_tests_name("frame_grabber", tests, NULL, NULL);
}
