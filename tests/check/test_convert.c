/* test_convert.c - rows of frames of every format, at every level: the floats of arch/scalar, which lie where
 * float64 says. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "../../arch/scalar/scalar.h"
#include "capture/convert.h"
#include "reference/pixel.h"

/* Of a value: what is seen is 1.6e-7 (src/capture/README.md). */
static const double MOST_ERROR = 2e-7;

static const int widths[] = {1,  2,  3,  4,  5,  6,  7,  8,  9,  15,  16, 17,
                             31, 32, 33, 47, 48, 49, 63, 64, 65, 100, 257};
enum { WIDTHS = sizeof widths / sizeof *widths, FORMATS = SF_PIXEL_MJPEG, RANGES = 2 };

/* What bytes are: any; black and white; about the middle, where chroma cancels. */
enum content { ANY, ENDS, MIDDLE, CONTENTS };

typedef struct row {
    sf_frame frame; /* of height 1 */
    sf_yuv yuv;
    sf_convert_args args;
} row;

static uint8_t some_byte(check *c, enum content content) {
    switch (content) {
    case ENDS:
        return check_pick(c, 2) ? 255 : 0;
    case MIDDLE:
        return (uint8_t)(126 + check_pick(c, 5));
    default:
        return (uint8_t)check_pick(c, 256);
    }
}

/* Rows begin anywhere. */
static const uint8_t *make_plane(check *c, const row *r, int plane) {
    size_t size = sf_plane_row_bytes(r->frame.format, plane, r->frame.width);
    uint8_t *bytes = check_input(c, "plane", size, 1, 1);
    enum content content = (enum content)check_pick(c, CONTENTS);
    for (size_t i = 0; i < size; i++) bytes[i] = some_byte(c, content);
    return bytes;
}

static void make_row(check *c, row *r) {
    uint64_t kind = c->seed / 2; /* the last bit says at which guard arrays lie */
    memset(r, 0, sizeof *r);
    r->frame.format = (sf_pixel_format)(kind % FORMATS);
    r->frame.width = widths[kind / FORMATS % WIDTHS];
    r->frame.height = 1;
    r->frame.matrix = (sf_yuv_matrix)check_pick(c, SF_YUV_2020 + 1);
    r->frame.full_range = (int)check_pick(c, RANGES);
    r->yuv = sf_yuv_of(r->frame.matrix, r->frame.full_range);
    r->args = (sf_convert_args){.format = r->frame.format, .width = r->frame.width};
    if (sf_format_has_luma(r->frame.format)) r->args.yuv = &r->yuv;
    for (int p = 0; p < sf_format_planes(r->frame.format); p++)
        r->args.plane[p] = r->frame.plane[p] = make_plane(c, r, p);
    for (int ch = 0; ch < 3; ch++) /* aligned as floats, no more */
        r->args.rgb[ch] = check_output(c, "rgb", (size_t)r->frame.width, sizeof(float), sizeof(float));
}

static void call_convert(const sf_kernels *kernels, void *args) {
    const row *r = args;
    kernels->convert(&r->args);
}

static void check_row(check *c, const row *r, float *const specified[3]) {
    static const char *const names[3] = {"red", "green", "blue"};
    for (int x = 0; x < r->frame.width; x++) {
        double want[3];
        test_ref_pixel(&r->frame, x, 0, want);
        for (int ch = 0; ch < 3; ch++) {
            float got = r->args.rgb[ch][x];
            check_near(c, names[ch], (size_t)x, (double)got, (bounded){want[ch], MOST_ERROR / CHECK_SLACK});
            check_that(c, got >= 0 && got <= 1, "beyond 0..1", (size_t)x);
            check_that(c, !memcmp(&got, &specified[ch][x], sizeof got), "not the bytes of arch/scalar",
                       (size_t)x);
        }
    }
}

static void convert_case(check *c) {
    row r;
    float *specified[3];
    make_row(c, &r);
    sf_convert_args scalar = r.args;
    for (int ch = 0; ch < 3; ch++) {
        specified[ch] = malloc((size_t)r.frame.width * sizeof(float));
        assert_non_null(scalar.rgb[ch] = specified[ch]);
    }
    sf_convert_scalar(&scalar);
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (check_call(c, 0, call_convert, &r)) check_row(c, &r, specified);
    }
    for (int ch = 0; ch < 3; ch++) free(specified[ch]);
}

static void levels_agree_and_are_right(void **state) {
    (void)state;
    static const check_kernel kernel = {"convert", SF_KERNEL_convert};
    check_kernels(&kernel, 1, (size_t)(2 * FORMATS * WIDTHS * 3), convert_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(levels_agree_and_are_right)};
    return cmocka_run_group_tests_name("check convert", tests, NULL, NULL);
}
