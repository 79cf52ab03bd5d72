/* test_board.c - boards of AprilTags: their geometry, descriptions, drawings at their true size. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/io/picture.h"
#include "../../src/pose/tags.h"

static const char *const names[] = {"a4-36h11", "letter-36h11", "a3-36h11"};
static const double sheets[][3] = {{210, 297, 36}, {215.9, 279.4, 36}, {297, 420, 52}}; /* mm; a tag's side */

static int have_tags(sf_context *ctx) {
    int side;
    uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS];
    return sf_tags_cells(ctx, "tag36h11", 0, &side, cells) != SF_ERR_UNSUPPORTED;
}

static void need_tags(sf_context *ctx) {
    if (have_tags(ctx)) return;
    sf_context_destroy(&ctx);
    test_skip("not built with libapriltag");
}

static void assert_near(double value, double wanted) { assert_true(fabs(value - wanted) < 1e-9); }

/* Geometry. */

static void test_sheets(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int i = 0; i < 3; i++) {
        sf_board *b;
        double side = sheets[i][2] * 1e-3;
        assert_ok(ctx, sf_board_open(ctx, names[i], 0, &b));
        assert_string_equal(b->name, names[i]);
        assert_string_equal(b->family, "tag36h11");
        assert_int_equal(b->count, 20);
        assert_near(b->width, sheets[i][0] * 1e-3);
        assert_near(b->tag_size, side);
        double sum[2] = {0, 0};
        for (size_t t = 0; t < b->count; t++) {
            const double(*c)[2] = b->tags[t].corner;
            assert_int_equal(b->tags[t].id, t);
            assert_near(c[1][0] - c[0][0], side); /* to the right, then down */
            assert_near(c[1][1], c[0][1]);
            assert_near(c[2][1] - c[1][1], side);
            assert_near(c[3][0], c[0][0]);
            for (int k = 0; k < 8; k++) sum[k % 2] += c[k / 2][k % 2];
            for (int k = 0; k < 4; k++) /* on the sheet, with a margin to print in */
                assert_true(fabs(c[k][0]) < b->width / 2 - 0.009 && fabs(c[k][1]) < b->height / 2 - 0.009);
        }
        assert_near(sum[0], 0); /* the origin is the middle */
        assert_near(sum[1], 0);
        assert_near(b->tags[1].corner[0][0] - b->tags[0].corner[1][0], side / 4); /* two white cells */
        sf_board_close(&b);
        assert_null(b);
    }
    sf_context_destroy(&ctx);
}

static void test_other_scale(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_board *a, *b;
    assert_ok(ctx, sf_board_open(ctx, "a4-36h11", 0, &a));
    assert_ok(ctx, sf_board_open(ctx, "a4-36h11", 0.0349, &b));
    assert_near(b->tag_size, 0.0349);
    for (size_t t = 0; t < a->count; t++)
        for (int k = 0; k < 8; k++)
            assert_near(b->tags[t].corner[k / 2][k % 2], a->tags[t].corner[k / 2][k % 2] * 34.9 / 36);
    sf_board_close(&a);
    sf_board_close(&b);
    static const double wrong[] = {-0.03, 0.0001, 11, NAN};
    for (int i = 0; i < 4; i++) {
        assert_status(ctx, sf_board_open(ctx, "a4-36h11", wrong[i], &b), SF_ERR_ARGUMENT);
        assert_error_names(ctx, "tag size");
        assert_null(b);
    }
    assert_status(ctx, sf_board_open(ctx, "a5-36h11", 0, &b), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "\"a5-36h11\" is none of");
    sf_context_destroy(&ctx);
}

/* Descriptions. */

static void test_description_round_trip(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_board *a, *b;
    assert_ok(ctx, sf_board_open(ctx, "a3-36h11", 0, &a));
    assert_ok(ctx, sf_board_write(ctx, a, test_path("board.json")));
    assert_ok(ctx, sf_board_open(ctx, test_path("board.json"), 0, &b));
    assert_string_equal(b->name, a->name);
    assert_int_equal(b->count, a->count);
    for (size_t t = 0; t < a->count; t++)
        for (int k = 0; k < 8; k++)
            assert_near(b->tags[t].corner[k / 2][k % 2], a->tags[t].corner[k / 2][k % 2]);
    sf_board_close(&a);
    sf_board_close(&b);
    static const char turned[] =
        "{\"tag_size_m\": 0.1, \"family\": \"tag25h9\", \"tags\": [{\"id\": 7, \"x_m\": 1, \"y_m\": 2, "
        "\"angle_deg\": 90}, {\"id\": 3, \"x_m\": 0, \"y_m\": 0, \"tag_size_m\": 0.2}]}";
    test_write(test_path("turned.json"), turned, sizeof turned - 1);
    assert_ok(ctx, sf_board_open(ctx, test_path("turned.json"), 0, &b));
    assert_string_equal(b->name, "turned.json");
    assert_int_equal(b->tags[0].id, 3);
    assert_near(b->tags[0].corner[2][0], 0.1);
    assert_near(b->tags[1].corner[0][0], 1.05); /* turned by a quarter: its top left is at the right */
    assert_near(b->tags[1].corner[0][1], 1.95);
    sf_board_close(&b);
    sf_context_destroy(&ctx);
}

static void test_hostile_descriptions(void **state) {
    (void)state;
    static const struct {
        sf_status status;
        const char *text, *names;
    } cases[] = {
        {SF_ERR_FORMAT, "", "line"},
        {SF_ERR_FORMAT, "{", "line"},
        {SF_ERR_FORMAT, "[]", "tag_size_m: is missing"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": \"x\"}", "tag_size_m: is not a number"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 36}", "tag_size_m: 36 is not in"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 0.1}", "tags: is not a list"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 0.1, \"tags\": {}}", "tags: is not a list"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 0.1, \"tags\": [3]}", "tags[0]: id"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 0.1, \"tags\": [{\"id\": 587, \"x_m\": 0, \"y_m\": 0}]}",
         "tags[0]: id: 587 is not in 0..586"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 0.1, \"tags\": [{\"id\": -1, \"x_m\": 0, \"y_m\": 0}]}", "id: -1"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 0.1, \"tags\": [{\"id\": 1, \"y_m\": 0}]}",
         "tags[0]: x_m: is missing"},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 0.1, \"tags\": [{\"id\": 1, \"x_m\": 1e300, \"y_m\": 0}]}",
         "x_m: 1e+300"},
        {SF_ERR_FORMAT,
         "{\"tag_size_m\": 0.1, \"tags\": [{\"id\": 1, \"x_m\": 0, \"y_m\": 0}, {\"id\": 1, \"x_m\": 1, "
         "\"y_m\": 0}]}",
         "id 1 stands twice"},
        {SF_ERR_UNSUPPORTED, "{\"tag_size_m\": 0.1, \"family\": \"aruco\", \"tags\": []}",
         "family: \"aruco\""},
        {SF_ERR_FORMAT, "{\"tag_size_m\": 0.1, \"family\": 5, \"tags\": []}", "family: is not a text"},
    };
    sf_context *ctx = test_context();
    sf_board *b;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        test_write(test_path("bad.json"), cases[i].text, strlen(cases[i].text));
        assert_status(ctx, sf_board_open(ctx, test_path("bad.json"), 0, &b), cases[i].status);
        assert_error_names(ctx, "bad.json: ");
        assert_error_names(ctx, cases[i].names);
        assert_null(b);
    }
    assert_status(ctx, sf_board_open(ctx, test_path("none.json"), 0, &b), SF_ERR_IO);
    sf_context_destroy(&ctx);
}

/* Drawings. */

/* A drawing of a board, as text. */
static char *draw(sf_context *ctx, const char *name, const char *file) {
    sf_board *b;
    size_t size;
    assert_ok(ctx, sf_board_open(ctx, name, 0, &b));
    assert_ok(ctx, sf_board_write(ctx, b, test_path(file)));
    sf_board_close(&b);
    return (char *)test_read(test_path(file), &size);
}

/* The number after `key`. */
static double number_after(const char *text, const char *key) {
    const char *at = strstr(text, key);
    if (!at) fail_msg("no %s", key);
    return strtod(at + strlen(key), NULL);
}

static void test_svg(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    need_tags(ctx);
    for (int i = 0; i < 3; i++) {
        char *svg = draw(ctx, names[i], "board.svg");
        double side = sheets[i][2], left = (sheets[i][0] - 4.75 * side) / 2,
               top = (sheets[i][1] - 6 * side) / 2;
        assert_near(number_after(svg, "width=\""), sheets[i][0]);
        assert_near(number_after(svg, "mm\" height=\""), sheets[i][1]);
        assert_near(number_after(svg, "viewBox=\"0 0 "), sheets[i][0]);
        assert_non_null(strstr(svg, names[i]));
        /* The first bar is the upper border of the first tag. */
        assert_near(number_after(svg, "d=\"M"), left);
        assert_near(number_after(strstr(svg, "d=\"M"), "h"), side);
        char corner[64];
        snprintf(corner, sizeof corner, "M%.4f %.4fh%.4fv%.4f", left, top, side, side / 8);
        assert_non_null(strstr(svg, corner));
        assert_non_null(strstr(svg, "h100.0000v0.3000")); /* the ruler */
        assert_string_equal(svg + strlen(svg) - 7, "</svg>\n");
        free(svg);
    }
    sf_context_destroy(&ctx);
}

/* Every offset of the table leads to its object, and the stream is as long as it says. */
static void check_pdf(const char *pdf) {
    assert_memory_equal(pdf, "%PDF-1.4\n", 9);
    const char *end = strstr(pdf, "startxref\n"), *table = pdf + (long)number_after(pdf, "startxref\n");
    assert_memory_equal(table, "xref\n0 6\n", 9);
    assert_true(table < end && !strcmp(end + strlen(end) - 6, "%%EOF\n"));
    for (int i = 1; i < 6; i++) {
        char head[16];
        const char *entry = table + 9 + 20 * i;
        assert_memory_equal(entry + 10, " 00000 n \n", 10);
        snprintf(head, sizeof head, "%d 0 obj\n", i);
        assert_memory_equal(pdf + strtol(entry, NULL, 10), head, strlen(head));
    }
    const char *stream = strstr(pdf, "stream\n") + 7;
    assert_memory_equal(stream + (long)number_after(pdf, "/Length "), "\nendstream", 10);
}

static void test_pdf(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    need_tags(ctx);
    for (int i = 0; i < 3; i++) {
        const double point = 25.4 / 72;
        char *pdf = draw(ctx, names[i], "board.pdf");
        check_pdf(pdf);
        const char *box = strstr(pdf, "/MediaBox [0 0 ");
        assert_non_null(box);
        char *rest;
        assert_true(fabs(strtod(box + 15, &rest) * point - sheets[i][0]) < 1e-3);
        assert_true(fabs(strtod(rest, NULL) * point - sheets[i][1]) < 1e-3);
        double bar[4]; /* the first: x, y from below, width, height */
        const char *at = strstr(pdf, "stream\n") + 7;
        for (int k = 0; k < 4; k++) {
            bar[k] = strtod(at, &rest) * point;
            at = rest;
        }
        assert_true(fabs(bar[0] - (sheets[i][0] - 4.75 * sheets[i][2]) / 2) < 1e-3);
        assert_true(fabs(bar[1] + bar[3] - (sheets[i][1] + 6 * sheets[i][2]) / 2) < 1e-3);
        assert_true(fabs(bar[2] - sheets[i][2]) < 1e-3 && fabs(bar[3] - sheets[i][2] / 8) < 1e-3);
        free(pdf);
    }
    sf_context_destroy(&ctx);
}

static uint32_t big32(const uint8_t *p) {
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

/* The picture at 300 dots an inch: its size is stated, and the detector finds every corner in its place. */
static void test_png(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    need_tags(ctx);
    if (getenv("SPLATFIT_QUICK")) {
        sf_context_destroy(&ctx);
        test_skip("SPLATFIT_QUICK: nine million dots");
    }
    sf_board *b;
    sf_detector *detector;
    sf_picture picture;
    const sf_board_corner *corners;
    size_t count, size;
    const double dots = 300 / 25.4;
    free(draw(ctx, "a4-36h11", "board.png"));
    uint8_t *file = test_read(test_path("board.png"), &size);
    assert_int_equal(big32(file + 16), 2480);
    assert_int_equal(big32(file + 20), 3508);
    uint8_t *phys = NULL;
    for (size_t i = 33; i < 200 && !phys; i++)
        if (!memcmp(file + i, "pHYs", 4)) phys = file + i + 4;
    assert_non_null(phys);
    assert_true(big32(phys) == 11811 && big32(phys + 4) == 11811 && phys[8] == 1);
    free(file);
    assert_ok(ctx, sf_picture_load(ctx, test_path("board.png"), &picture));
    assert_ok(ctx, sf_board_open(ctx, "a4-36h11", 0, &b));
    assert_ok(ctx, sf_detector_create(ctx, b, 4, &detector));
    assert_ok(ctx, sf_detector_find(detector, picture.rgb, 2480, 2480, 3508, &corners, &count));
    assert_int_equal(count, 80);
    double worst = 0;
    for (size_t i = 0; i < count; i++) {
        assert_int_equal(corners[i].id, i / 4);
        assert_int_equal(corners[i].corner, i % 4);
        for (int k = 0; k < 2; k++) {
            assert_near(corners[i].board[k], b->tags[i / 4].corner[i % 4][k]);
            double wanted = (corners[i].board[k] * 1e3 + sheets[0][k] / 2) * dots;
            worst = fmax(worst, fabs(corners[i].pixel[k] - wanted));
        }
    }
    print_message("a drawn board, found again: corners within %.3f dots of 1/300 inch\n", worst);
    /* bytes are shares of a dot here, not light: an edge within a dot seems up to half of one farther out */
    assert_true(worst < 0.6);
    sf_picture_free(ctx, &picture);
    sf_detector_destroy(&detector);
    sf_board_close(&b);
    sf_context_destroy(&ctx);
}

static void test_refused_drawings(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_board *b, *described;
    assert_ok(ctx, sf_board_open(ctx, "a4-36h11", 0, &b));
    assert_status(ctx, sf_board_write(ctx, b, test_path("board.bmp")), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "board.bmp: ending");
    assert_ok(ctx, sf_board_write(ctx, b, test_path("described.json")));
    assert_ok(ctx, sf_board_open(ctx, test_path("described.json"), 0, &described));
    assert_status(ctx, sf_board_write(ctx, described, test_path("described.svg")), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "no sheet");
    if (have_tags(ctx))
        assert_status(ctx, sf_board_write(ctx, b, "no/such/folder/board.svg"), SF_ERR_IO);
    else {
        assert_status(ctx, sf_board_write(ctx, b, test_path("board.svg")), SF_ERR_UNSUPPORTED);
        assert_error_names(ctx, "not built with libapriltag");
    }
    assert_int_equal(test_exists(test_path("described.svg")), 0);
    sf_board_close(&b);
    sf_board_close(&described);
    sf_context_destroy(&ctx);
}

/* Detection. */

static void test_detector_arguments(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_board *b;
    sf_detector *detector;
    uint8_t grey[32 * 32] = {0};
    const sf_board_corner *corners;
    size_t count;
    assert_ok(ctx, sf_board_open(ctx, "a4-36h11", 0, &b));
    assert_status(ctx, sf_detector_create(ctx, b, 0, &detector), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "decimate: 0");
    assert_null(detector);
    if (!have_tags(ctx)) {
        assert_status(ctx, sf_detector_create(ctx, b, 1, &detector), SF_ERR_UNSUPPORTED);
        assert_null(detector);
    } else {
        assert_ok(ctx, sf_detector_create(ctx, b, 1, &detector));
        assert_ok(ctx, sf_detector_find(detector, grey, 32, 32, 32, &corners, &count));
        assert_int_equal(count, 0);
        assert_status(ctx, sf_detector_find(detector, grey, 16, 32, 32, &corners, &count), SF_ERR_ARGUMENT);
        assert_status(ctx, sf_detector_find(detector, grey, 32, 0, 32, &corners, &count), SF_ERR_ARGUMENT);
        sf_detector_destroy(&detector);
        assert_null(detector);
    }
    sf_board_close(&b);
    sf_context_destroy(&ctx);
}

/* A tag of 8 px a cell on white, in each format of frames; twice it is left out. */
enum { SIDE = 128 };

static void paint_tag(sf_context *ctx, int id, size_t x0, size_t y0, uint8_t *grey) {
    uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS];
    int side;
    assert_ok(ctx, sf_tags_cells(ctx, "tag36h11", id, &side, cells));
    for (size_t y = 0; y < 48; y++)
        for (size_t x = 0; x < 48; x++)
            if (cells[y / 6 * 8 + x / 6]) grey[(y0 + y) * SIDE + x0 + x] = 20;
}

static void find_in(sf_detector *detector, sf_context *ctx, const sf_frame *frame) {
    const sf_board_corner *corners;
    size_t count;
    assert_ok(ctx, sf_detector_find_in_frame(detector, frame, &corners, &count));
    assert_int_equal(count, 4);
    assert_int_equal(corners[0].id, 5);
    assert_true(fabs(corners[0].pixel[0] - 10) < 0.3 && fabs(corners[0].pixel[1] - 12) < 0.3);
    assert_true(fabs(corners[2].pixel[0] - 58) < 0.3 && fabs(corners[2].pixel[1] - 60) < 0.3);
}

/* Reduced to less than libapriltag's tiles of 4 px. */
static void test_tiny_pictures(void **state) {
    (void)state;
    enum { EDGE = 33 };
    static const uint8_t grey[EDGE * EDGE];
    sf_context *ctx = test_context();
    const sf_board_corner *corners;
    size_t count;
    sf_board *b;
    assert_ok(ctx, sf_board_open(ctx, "a4-36h11", 0, &b));
    for (int decimate = 1; have_tags(ctx) && decimate <= 8; decimate++) {
        sf_detector *detector;
        assert_ok(ctx, sf_detector_create(ctx, b, decimate, &detector));
        for (int32_t w = 1; w <= EDGE; w++)
            for (int32_t h = 1; h <= EDGE; h += 4) {
                assert_ok(ctx, sf_detector_find(detector, grey, EDGE, w, h, &corners, &count));
                assert_int_equal(count, 0);
            }
        sf_detector_destroy(&detector);
    }
    sf_board_close(&b);
    sf_context_destroy(&ctx);
}

static void test_frames(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    need_tags(ctx);
    sf_board *b;
    sf_detector *detector;
    static uint8_t grey[SIDE * SIDE], wide[3 * SIDE * SIDE];
    memset(grey, 230, sizeof grey);
    paint_tag(ctx, 5, 10, 12, grey);
    assert_ok(ctx, sf_board_open(ctx, "a4-36h11", 0, &b));
    assert_ok(ctx, sf_detector_create(ctx, b, 1, &detector));
    sf_frame frame = {
        .plane = {grey, grey, grey}, .stride = {SIDE, SIDE, SIDE}, .width = SIDE, .height = SIDE};
    static const sf_pixel_format planar[] = {SF_PIXEL_GREY, SF_PIXEL_NV12, SF_PIXEL_YU12, SF_PIXEL_422P,
                                             SF_PIXEL_444P};
    for (size_t i = 0; i < sizeof planar / sizeof *planar; i++) {
        frame.format = planar[i];
        find_in(detector, ctx, &frame);
    }
    static const struct {
        sf_pixel_format format;
        size_t step, first, copies;
    } packed[] = {{SF_PIXEL_RGB24, 3, 0, 3},
                  {SF_PIXEL_BGR24, 3, 0, 3},
                  {SF_PIXEL_YUYV, 2, 0, 1},
                  {SF_PIXEL_UYVY, 2, 1, 1}};
    for (size_t i = 0; i < sizeof packed / sizeof *packed; i++) {
        memset(wide, 128, sizeof wide);
        for (size_t p = 0; p < SIDE * SIDE; p++)
            for (size_t c = 0; c < packed[i].copies; c++)
                wide[packed[i].step * p + packed[i].first + c] = grey[p];
        frame = (sf_frame){.plane = {wide},
                           .stride = {packed[i].step * SIDE},
                           .width = SIDE,
                           .height = SIDE,
                           .format = packed[i].format};
        find_in(detector, ctx, &frame);
    }
    const sf_board_corner *corners;
    size_t count;
    frame =
        (sf_frame){.plane = {grey}, .bytes = 100, .width = SIDE, .height = SIDE, .format = SF_PIXEL_MJPEG};
    assert_status(ctx, sf_detector_find_in_frame(detector, &frame, &corners, &count), SF_ERR_FORMAT);
    frame.plane[0] = NULL;
    assert_status(ctx, sf_detector_find_in_frame(detector, &frame, &corners, &count), SF_ERR_ARGUMENT);
    paint_tag(ctx, 5, 70, 70, grey); /* a second time */
    paint_tag(ctx, 9, 70, 12, grey);
    assert_ok(ctx, sf_detector_find(detector, grey, SIDE, SIDE, SIDE, &corners, &count));
    assert_int_equal(count, 4);
    assert_int_equal(corners[0].id, 9);
    sf_detector_destroy(&detector);
    sf_board_close(&b);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sheets),
        cmocka_unit_test(test_other_scale),
        cmocka_unit_test(test_description_round_trip),
        cmocka_unit_test(test_hostile_descriptions),
        cmocka_unit_test(test_svg),
        cmocka_unit_test(test_pdf),
        cmocka_unit_test(test_png),
        cmocka_unit_test(test_refused_drawings),
        cmocka_unit_test(test_detector_arguments),
        cmocka_unit_test(test_tiny_pictures),
        cmocka_unit_test(test_frames),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
