/* test_sim_board.c - the camera that is carried around a simulated board: path, poses, what it draws. */
#include "sim_board_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "sim/baked.h"
#include "sim/sheet.h"
#include "sim/sim.h"
#include "pose/tags.h"

/* Tags of the board that lie in the picture with all corners. */
static int tags_in_view(const sf_board *board, const sf_camera *c) {
    int count = 0;
    for (size_t i = 0; i < board->count; i++) {
        int inside = 1;
        for (int k = 0; k < 4; k++) {
            const double p[3] = {board->tags[i].corner[k][0], board->tags[i].corner[k][1], 0};
            double q[3];
            sf_mat3_vec(c->R_cw, p, q);
            for (int a = 0; a < 3; a++) q[a] += c->t_cw[a];
            double x = c->fx * q[0] / q[2] + c->cx, y = c->fy * q[1] / q[2] + c->cy;
            inside &= q[2] > 0 && x > 0 && y > 0 && x < c->width && y < c->height;
        }
        count += inside;
    }
    return count;
}

static sf_board *open_board(sf_context *ctx) {
    sf_board *board;
    assert_ok(ctx, sf_board_open(ctx, "a3-36h11", SF_STUDIO_TAG_M, &board));
    return board;
}

/* Where the camera is about the table's middle, degrees. */
static double azimuth_of(const sf_sim *sim, int frame) {
    sf_camera camera;
    double eye[3];
    sf_sim_studio_camera(sim, frame, &camera);
    sf_camera_center(&camera, eye);
    return atan2(eye[0], -eye[1]) / sim_board_degree;
}

/* 100 times a second: never faster than a hand, closed, around the table, and with the board out of view for
 * a third of the time. */
static void test_walk(void **state) {
    (void)state;
    enum { TIMES = 6000 };
    sf_context *ctx = test_context();
    sf_board *board = open_board(ctx);
    for (int seed = 1; seed <= (sim_board_quick() ? 1 : 3); seed++) {
        char name[64];
        snprintf(name, sizeof name, BOARD "?frames=%d&seed=%d", TIMES, seed);
        sf_sim sim = sim_board_make_sim(ctx, name);
        sf_camera camera, last = {0}, first = {0};
        double least = 10, most = -10, near = 10, far = 0, slowest = 10, fastest = 0;
        int without = 0;
        for (int i = 0; i <= TIMES; i++) {
            double eye[3], before[3];
            sf_sim_camera(&sim, (uint64_t)(i % TIMES), &camera);
            assert_ok(ctx, sf_camera_check(&camera));
            sf_camera_center(&camera, eye);
            assert_true(eye[2] < -0.2); /* above the table */
            double azimuth = azimuth_of(&sim, i % TIMES), from_board = sqrt(sf_dot3(eye, eye));
            least = fmin(least, azimuth), most = fmax(most, azimuth);
            near = fmin(near, from_board), far = fmax(far, from_board);
            without += tags_in_view(board, &camera) == 0;
            if (i == 0) {
                first = camera;
                assert_int_equal(tags_in_view(board, &camera), board->count);
            } else {
                sf_camera_center(&last, before);
                double speed = 100 * sim_board_distance_between(eye, before);
                assert_true(speed < 0.6);
                assert_true(100 * sim_board_angle_between(camera.R_cw, last.R_cw) < 60);
                slowest = fmin(slowest, speed), fastest = fmax(fastest, speed);
            }
            last = camera;
        }
        assert_memory_equal(first.R_cw, last.R_cw, sizeof first.R_cw);
        assert_true(most - least > 150);
        assert_true(near < 1.1 && far > 1.6);
        assert_true(slowest < 0.05 && fastest > 0.15);
        assert_between(without, TIMES / 3, TIMES * 2 / 3);
    }
    sf_board_close(&board);
    sf_context_destroy(&ctx);
}

/* The board is found where the frame's camera has it. */
static void look_for_board(sf_context *ctx, sf_detector *detector, const sf_board *board, const char *name,
                           int least) {
    sf_source *source = sim_board_open_source(ctx, name);
    sf_frame frame;
    int found = 0, blind = 0;
    sf_status status;
    while ((status = sf_source_next(source, -1, &frame)) == SF_OK) {
        const sf_board_corner *corners;
        size_t count;
        assert_ok(ctx, sf_detector_find_in_frame(detector, &frame, &corners, &count));
        const sf_camera *c = &frame.camera;
        double distance = sqrt(sf_dot3(c->t_cw, c->t_cw));
        int seen = tags_in_view(board, c);
        if (seen == 0) assert_int_equal(count, 0), blind++;
        if (seen >= 15 && distance < 1.5 && count >= 40) {
            sf_lens lens = {.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy};
            sf_pose pose;
            assert_ok(ctx, sf_board_pose(ctx, &lens, corners, count, &pose));
            assert_true(sim_board_angle_between(pose.R_cb, c->R_cw) < 0.3);
            assert_true(sim_board_distance_between(pose.t_cb, c->t_cw) < 0.01 * distance);
            found++;
        }
        sf_source_release(source, &frame);
    }
    assert_int_equal(status, SF_ERR_END);
    assert_true(found >= least && blind > 0);
    sf_source_close(&source);
}

static void test_board_is_found(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_board *board = open_board(ctx);
    sf_detector *detector;
    sf_status status = sf_detector_create(ctx, board, 1, &detector);
    if (status == SF_OK) {
        look_for_board(ctx, detector, board,
                       sim_board_quick() ? BOARD "?fps=0&frames=4&width=240&height=180"
                                         : BOARD "?fps=0&frames=20&width=240&height=180",
                       sim_board_quick() ? 1 : 5);
        look_for_board(ctx, detector, board, BOARD "?fps=0&frames=3&clean=1", 1);
        sf_detector_destroy(&detector);
    }
    sf_board_close(&board);
    sf_context_destroy(&ctx);
    if (status != SF_OK) skip();
}

/* The printed tags are libapriltag's. */
static void test_cells(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS];
    int side, built = 1;
    for (int tag = 0; tag < SF_SHEET_TAGS && built; tag++) {
        sf_status status = sf_tags_cells(ctx, "tag36h11", tag, &side, cells);
        built = status != SF_ERR_UNSUPPORTED;
        if (!built) break;
        assert_ok(ctx, status);
        assert_int_equal(side, 8);
        for (int i = 0; i < 64; i++)
            assert_int_equal(sf_sheet_cells(tag, i / 8) >> (7 - i % 8) & 1, cells[i]);
    }
    /* The middle of tag 6's upper left cell, and a little up: its white margin. */
    double x, y, cell = sf_sheet_a3.tag / 8;
    sf_sheet_tag(&sf_sheet_a3, 6, &x, &y);
    assert_true(sf_sheet_black(&sf_sheet_a3, x - 3.5 * cell, y - 3.5 * cell));
    assert_false(sf_sheet_black(&sf_sheet_a3, x - 3.5 * cell, y - 4.5 * cell));
    assert_false(sf_sheet_black(&sf_sheet_a3, 0.49 * sf_sheet_a3.width, 0));
    sf_context_destroy(&ctx);
    if (!built) skip();
}

/* Baked surfaces look as those that the ray caster shows, and lie as far away. */
static void test_baked(void **state) {
    (void)state;
    int width = sim_board_quick() ? 48 : 160, height = width * 3 / 4;
    char name[64];
    snprintf(name, sizeof name, BOARD "?width=%d&height=%d", width, height);
    sf_context *ctx = test_context();
    static sf_sim sim;
    sim = sim_board_make_sim(ctx, name);
    size_t pixels = (size_t)width * (size_t)height;
    float *fast = malloc(4 * pixels * sizeof *fast), *exact = malloc(4 * pixels * sizeof *exact);
    assert_true(fast && exact);
    sf_camera camera;
    double eye[3];
    sf_sim_studio_camera(&sim, 0, &camera);
    sf_camera_center(&camera, eye);
    sf_vec3 eyes[1] = {{eye[0], eye[1], eye[2]}};
    sf_baked *baked;
    assert_ok(ctx, sf_baked_create(ctx, &sim.studio, eyes, 1, camera.fx, pixels, &baked));
    for (int i = 0; i < 3; i++) {
        double squares = 0;
        size_t off = 0;
        sf_sim_studio_camera(&sim, 600.0 * i, &camera);
        sf_baked_draw(baked, &camera, fast, fast + 3 * pixels);
        sf_studio_draw(&sim.studio, ctx->pool, &camera, exact, exact + 3 * pixels);
        for (size_t k = 0; k < 3 * pixels; k++) {
            double a = sqrt(fmin((double)fast[k], 1)), b = sqrt(fmin((double)exact[k], 1));
            squares += (a - b) * (a - b);
        }
        for (size_t k = 3 * pixels; k < 4 * pixels; k++)
            off += fabs((double)fast[k] - (double)exact[k]) > 1e-4 * (double)exact[k];
        /* 25 dB; small pictures are mostly edges. */
        assert_true(squares / (3.0 * (double)pixels) < pow(10, sim_board_quick() ? -2 : -2.5));
        assert_int_equal(off, 0);
    }
    sf_baked_destroy(&baked);
    free(fast), free(exact);
    sf_context_destroy(&ctx);
}

/* The corridor's walk closes after 21 m, and never comes near a wall, the block or what stands there. */
static void test_corridor(void **state) {
    (void)state;
    enum { TIMES = 240 };
    sf_context *ctx = test_context();
    sf_sim sim = sim_board_make_sim(ctx, "sim:corridor?frames=240");
    double way = 0, nearest = INFINITY, eye[3], before[3], first[3];
    for (uint64_t i = 0; i <= TIMES; i++) {
        sf_camera camera;
        sf_vec3 point;
        double distance;
        sf_sim_camera(&sim, i, &camera);
        sf_camera_center(&camera, eye);
        if (!i) memcpy(first, eye, sizeof first);
        if (i) way += sim_board_distance_between(eye, before);
        memcpy(before, eye, sizeof before);
        sf_sim_look(&sim, &camera, camera.width / 2.0, camera.height / 2.0, &point, &distance);
        nearest = fmin(nearest, distance);
    }
    assert_true(way > 20 && way < 23);
    assert_true(sim_board_distance_between(eye, first) < 1e-9);
    assert_true(nearest > 0.8);
    assert_true(sim.walks && !sim.has_board);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_walk),  cmocka_unit_test(test_corridor), cmocka_unit_test(test_board_is_found),
        cmocka_unit_test(test_cells), cmocka_unit_test(test_baked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
