/* test_sim_board.c - the camera that is carried around a simulated board: path, poses, sensor, faults. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/base/context.h"
#include "../../src/base/linear.h"
#include "../../src/sim/baked.h"
#include "../../src/sim/sheet.h"
#include "../../src/sim/sim.h"
#include "../../src/pose/tags.h"

#include <splatfit/calibrate.h>
#include <splatfit/scene.h>

#define BOARD "sim:studio-board"
#define SMALL BOARD "?width=32&height=24&fps=0"

static const double degree = 3.141592653589793 / 180;

static int quick(void) { return getenv("SPLATFIT_QUICK") != NULL; }

static sf_source *open_source(sf_context *ctx, const char *name) {
    sf_source *source;
    assert_ok(ctx, sf_source_open(ctx, name, &source));
    return source;
}

static sf_sim make_sim(sf_context *ctx, const char *name) {
    sf_sim sim;
    assert_ok(ctx, sf_sim_init(ctx, name, &sim));
    return sim;
}

/* Degrees between two rotations. */
static double angle_between(const double a[9], const double b[9]) {
    double trace = 0;
    for (int i = 0; i < 9; i++) trace += a[i] * b[i];
    return acos(fmin(fmax((trace - 1) / 2, -1), 1)) / degree;
}

static double distance_between(const double a[3], const double b[3]) {
    return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
}

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
    return atan2(eye[0], -eye[1]) / degree;
}

/* 100 times a second: never faster than a hand, closed, around the table, and with the board out of view for
 * a third of the time. */
static void test_walk(void **state) {
    (void)state;
    enum { TIMES = 6000 };
    sf_context *ctx = test_context();
    sf_board *board = open_board(ctx);
    for (int seed = 1; seed <= (quick() ? 1 : 3); seed++) {
        char name[64];
        snprintf(name, sizeof name, BOARD "?frames=%d&seed=%d", TIMES, seed);
        sf_sim sim = make_sim(ctx, name);
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
                double speed = 100 * distance_between(eye, before);
                assert_true(speed < 0.6);
                assert_true(100 * angle_between(camera.R_cw, last.R_cw) < 60);
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
    sf_source *source = open_source(ctx, name);
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
            assert_true(angle_between(pose.R_cb, c->R_cw) < 0.3);
            assert_true(distance_between(pose.t_cb, c->t_cw) < 0.01 * distance);
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
                       quick() ? BOARD "?fps=0&frames=4&width=240&height=180"
                               : BOARD "?fps=0&frames=20&width=240&height=180",
                       quick() ? 1 : 5);
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
    int width = quick() ? 48 : 160, height = width * 3 / 4;
    char name[64];
    snprintf(name, sizeof name, BOARD "?width=%d&height=%d", width, height);
    sf_context *ctx = test_context();
    static sf_sim sim;
    sim = make_sim(ctx, name);
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
        assert_true(squares / (3.0 * (double)pixels) < pow(10, quick() ? -2 : -2.5));
        assert_int_equal(off, 0);
    }
    sf_baked_destroy(&baked);
    free(fast), free(exact);
    sf_context_destroy(&ctx);
}

/* What a frame says of itself, and a sum over its pixels. */
typedef struct note {
    uint64_t sequence;
    int64_t time_ns;
    double exposure_s, gain, mean, eye[3];
    uint64_t hash;
} note;

/* Takes up to `most` frames of a source; returns how many there were. */
static size_t take_notes(sf_context *ctx, const char *name, size_t most, note *notes) {
    sf_source *source = open_source(ctx, name);
    sf_frame frame;
    size_t count = 0;
    while (count < most && sf_source_next(source, -1, &frame) == SF_OK) {
        note *n = &notes[count++];
        *n = (note){frame.sequence, frame.time_ns, frame.exposure_s, frame.gain, .hash = 1};
        for (size_t y = 0; y < (size_t)frame.height; y++)
            for (size_t i = 0; i < 3 * (size_t)frame.width; i++) {
                uint8_t byte = frame.plane[0][y * frame.stride[0] + i];
                n->mean += byte / (3.0 * frame.width * frame.height);
                n->hash = (n->hash ^ byte) * 0x100000001b3u;
            }
        sf_camera_center(&frame.camera, n->eye);
        sf_source_release(source, &frame);
    }
    sf_source_close(&source);
    return count;
}

static void test_repeats(void **state) {
    (void)state;
    note notes[4][10];
    const char *names[4] = {SMALL "&frames=10&seed=3", SMALL "&frames=10&seed=3", SMALL "&frames=10&seed=4",
                            SMALL "&frames=10&seed=3&noise=0"};
    for (int i = 0; i < 4; i++) {
        sf_context *ctx = test_context_threads(i == 1 ? 3 : 1);
        assert_int_equal(take_notes(ctx, names[i], 10, notes[i]), 10);
        sf_context_destroy(&ctx);
    }
    for (int k = 0; k < 10; k++) {
        assert_true(notes[0][k].hash == notes[1][k].hash);
        assert_true(notes[0][k].time_ns == notes[1][k].time_ns);
        assert_true(notes[0][k].hash != notes[2][k].hash);
        assert_true(notes[0][k].hash != notes[3][k].hash);
        assert_true(fabs(notes[0][k].mean - notes[3][k].mean) < 3); /* the noise has a mean of 0 */
    }
}

/* Automatic exposure evens pictures out, late, and says by how much. */
static void test_exposure(void **state) {
    (void)state;
    enum { FRAMES = 60 };
    sf_context *ctx = test_context();
    note automatic[FRAMES], fixed[FRAMES];
    take_notes(ctx, SMALL "&frames=60&noise=0&blur=0&jitter=0", FRAMES, automatic);
    take_notes(ctx, SMALL "&frames=60&noise=0&blur=0&jitter=0&exposure=fixed", FRAMES, fixed);
    double least = 10, most = 0, spread = 0, fixed_spread = 0, mean = 0, fixed_mean = 0;
    for (int i = 0; i < FRAMES; i++) {
        double bright = automatic[i].exposure_s * automatic[i].gain / fixed[i].exposure_s;
        assert_true(fixed[i].exposure_s > 0 && fixed[i].gain == 1);
        assert_true(bright > 0.59 && bright < 1.41);
        if (bright > 1.05) assert_true(automatic[i].mean > fixed[i].mean);
        if (bright < 0.95) assert_true(automatic[i].mean < fixed[i].mean);
        least = fmin(least, bright), most = fmax(most, bright);
        mean += automatic[i].mean / FRAMES, fixed_mean += fixed[i].mean / FRAMES;
    }
    for (int i = 0; i < FRAMES; i++) {
        spread += pow(automatic[i].mean - mean, 2);
        fixed_spread += pow(fixed[i].mean - fixed_mean, 2);
    }
    assert_true(least < 0.8 && most > 1.2);
    assert_true(spread < 0.7 * fixed_spread);
    sf_context_destroy(&ctx);
}

/* Frames are taken up to 20 ms before they are due, never out of order, and the camera is where it is then.
 */
static void test_jitter(void **state) {
    (void)state;
    enum { FRAMES = 300 };
    sf_context *ctx = test_context();
    static note notes[FRAMES];
    sf_sim sim = make_sim(ctx, SMALL "&frames=1800");
    take_notes(ctx, SMALL "&frames=1800&noise=0&blur=0&exposure=fixed", quick() ? 40 : FRAMES, notes);
    double most = 0;
    for (int i = 0; i < (quick() ? 40 : FRAMES); i++) {
        double early = (double)i / 30 - (double)notes[i].time_ns * 1e-9, eye[3];
        sf_camera studio, world;
        assert_true(early > -1e-8 && early < 0.02);
        if (i) assert_true(notes[i].time_ns > notes[i - 1].time_ns);
        sf_sim_studio_camera(&sim, (double)notes[i].time_ns * 30e-9, &studio);
        sf_sim_to_world(&sim, &studio, &world);
        sf_camera_center(&world, eye);
        assert_true(distance_between(eye, notes[i].eye) < 1e-6);
        most = fmax(most, early);
    }
    assert_true(most > 0.015);
    sf_context_destroy(&ctx);
}

static void test_faults(void **state) {
    (void)state;
    enum { FRAMES = 60 };
    sf_context *ctx = test_context();
    note usual[FRAMES], odd[FRAMES];
    const char *plain = SMALL "&frames=60&noise=0&exposure=fixed&jitter=0";
    take_notes(ctx, plain, FRAMES, usual);
    take_notes(ctx, SMALL "&frames=60&noise=0&exposure=fixed&jitter=0&black=10:12&smear=20:22.5&jump=40",
               FRAMES, odd);
    for (int i = 0; i < FRAMES; i++) {
        int black = i >= 10 && i < 12, smear = i >= 20 && i < 23, jump = i >= 40;
        assert_int_equal(odd[i].hash == usual[i].hash, !black && !smear && !jump);
        if (black) assert_true(odd[i].mean < 1);
        if (jump) assert_memory_equal(odd[i].eye, usual[(i + 12) % FRAMES].eye, sizeof odd[i].eye);
    }
    take_notes(ctx, SMALL "&frames=60&noise=0&exposure=fixed&jitter=0&mover=1", 5, odd);
    for (int i = 0; i < 5; i++) assert_true(odd[i].hash != usual[i].hash);
    take_notes(ctx, SMALL "&frames=60&noise=0&exposure=fixed&jitter=0&mover=2:3", 5, odd);
    for (int i = 0; i < 5; i++) assert_int_equal(odd[i].hash != usual[i].hash, i == 2);
    sf_context_destroy(&ctx);
}

/* The ball covers a tenth of the picture, what is around it stays. */
static void test_mover(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source *sources[2] = {open_source(ctx, BOARD "?width=80&height=60&fps=0&clean=1&exact=1&frames=60"),
                             open_source(ctx,
                                         BOARD "?width=80&height=60&fps=0&frames=60&exact=1&noise=0&blur=0"
                                               "&exposure=fixed&jitter=0&mover=1")};
    sf_frame frames[2];
    int differ = 0;
    for (int i = 0; i < 2; i++) assert_ok(ctx, sf_source_next(sources[i], -1, &frames[i]));
    for (int i = 0; i < 80 * 60; i++)
        differ += memcmp(frames[0].plane[0] + 3 * i, frames[1].plane[0] + 3 * i, 3) != 0;
    assert_between(differ, 80 * 60 * 9 / 100, 80 * 60 * 11 / 100);
    for (int i = 0; i < 2; i++) {
        sf_source_release(sources[i], &frames[i]);
        sf_source_close(&sources[i]);
    }
    sf_context_destroy(&ctx);
}

/* Frames stop while it is unplugged, and go on after; those in between are lost. */
static void test_unplugged(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    static const char *const names[2] = {SMALL "&frames=60&unplug=2:5&noise=0&exposure=fixed",
                                         SMALL "&frames=60&fps=100&unplug=0.1:0.3&noise=0&exposure=fixed"};
    for (int live = 0; live < 2; live++) {
        sf_source *source = open_source(ctx, names[live]);
        sf_source_counts counts;
        sf_frame frame;
        uint64_t last = 0;
        int timeouts = 0, gone_on = 0;
        for (int i = 0; i < 500 && !gone_on; i++) {
            sf_status status = sf_source_next(source, live ? 20 : 1000, &frame);
            if (status == SF_ERR_TIMEOUT) {
                assert_error_names(ctx, "unplugged");
                timeouts++;
                continue;
            }
            assert_ok(ctx, status);
            gone_on = timeouts > 0;
            if (gone_on) assert_true(frame.sequence >= (live ? 30 : 5) && last < (live ? 10 : 2));
            last = frame.sequence;
            sf_source_release(source, &frame);
        }
        assert_true(gone_on);
        if (!live) assert_int_equal(timeouts, 2);
        sf_source_count(source, &counts);
        assert_int_equal(counts.reopened, 1);
        assert_int_equal(counts.given + counts.dropped, last + 1);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

/* A project: sharp, even frames of the whole walk, in the board's frame, with points in metres. */
static void test_project(void **state) {
    (void)state;
    enum { POINTS = 8000 };
    sf_context *ctx = test_context();
    sf_scene *scene;
    static float xyz[3 * POINTS];
    static uint8_t rgb[3 * POINTS];
    assert_ok(ctx, sf_scene_load(ctx, BOARD "?width=32&height=24&frames=10", NULL, &scene));
    sf_sim sim = make_sim(ctx, BOARD "?width=32&height=24&frames=10");
    for (size_t i = 0; i < 10; i++) {
        sf_view_info view;
        sf_camera camera;
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        sf_sim_camera(&sim, i, &camera);
        assert_true(distance_between(view.camera.t_cw, camera.t_cw) < 1e-12);
        assert_true(angle_between(view.camera.R_cw, camera.R_cw) < 1e-5);
    }
    int on_board = 0, below = 0, far = 0;
    assert_int_equal(sf_scene_get_points(scene, 0, POINTS, xyz, rgb), POINTS);
    for (int i = 0; i < POINTS; i++) {
        const float *p = xyz + 3 * i;
        on_board += fabsf(p[0]) < 0.2f && fabsf(p[1]) < 0.2f && fabsf(p[2]) < 0.08f;
        below += p[2] > 0.2f; /* under the floor, 0.11 m below */
        far += fabsf(p[0]) > 3.5f || fabsf(p[1]) > 3.5f;
    }
    assert_true(on_board > POINTS / 20);
    assert_true(below < POINTS / 20);
    assert_int_equal(far, 0);
    sf_scene_destroy(&scene);
    assert_status(ctx, sf_scene_load(ctx, BOARD "?fps=30", NULL, &scene), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "fps: a scene");
    sf_context_destroy(&ctx);
}

static void test_names(void **state) {
    (void)state;
    static const struct {
        const char *name, *part;
    } bad[] = {{BOARD "?black=3", "black: \"3\" is not A:B"},
               {BOARD "?black=3:2", "black: \"3:2\""},
               {BOARD "?smear=:2", "smear: \":2\""},
               {BOARD "?unplug=1:2:3", "unplug: \"1:2:3\""},
               {BOARD "?unplug=nan:2", "unplug: \"nan:2\""},
               {BOARD "?exposure=manual", "exposure: \"manual\" is neither auto nor fixed"},
               {BOARD "?jump=-3", "jump: -3"},
               {BOARD "?mover=2", "mover: \"2\" is not A:B"},
               {BOARD "?noise=11", "noise: 11"},
               {"sim:studio-boards", "known: sim:studio, sim:studio-board"}};
    sf_context *ctx = test_context();
    sf_source *source;
    sf_source_info info;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_status(ctx, sf_source_open(ctx, bad[i].name, &source), SF_ERR_ARGUMENT);
        assert_error_names(ctx, bad[i].part);
        assert_null(source);
    }
    source = open_source(ctx, BOARD "?width=16&height=16");
    sf_source_describe(source, &info);
    assert_true(info.live && info.has_poses && info.frames == 1800 && info.frames_per_second == 30);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* Two looks along the same path; of one the exposure is locked at the fifth frame, and given back at the
 * twentieth. */
static void test_exposure_is_locked(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source *sources[2];
    sf_source_info info;
    double light[2][30];
    for (int k = 0; k < 2; k++) {
        sources[k] = open_source(ctx, SMALL "&exposure=auto&frames=30");
        for (int i = 0; i < 30; i++) {
            sf_frame frame;
            if (k && (i == 5 || i == 20)) assert_ok(ctx, sf_source_lock_exposure(sources[k], i == 5));
            assert_ok(ctx, sf_source_next(sources[k], 1000, &frame));
            light[k][i] = frame.exposure_s * frame.gain;
            sf_source_release(sources[k], &frame);
        }
    }
    int moved = 0;
    for (int i = 0; i < 30; i++) {
        int locked = i >= 5 && i < 20;
        assert_true(light[1][i] == light[locked ? 1 : 0][locked ? 4 : i]);
        moved += light[0][i] != light[0][4];
    }
    assert_true(moved > 20);
    sf_source_describe(sources[0], &info);
    assert_true(info.can_lock_exposure);
    for (int k = 0; k < 2; k++) sf_source_close(&sources[k]);
    sf_source *fixed = open_source(ctx, "sim:studio?width=32&height=24&fps=0");
    sf_source_describe(fixed, &info);
    assert_false(info.can_lock_exposure);
    sf_source_close(&fixed);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_walk),
        cmocka_unit_test(test_board_is_found),
        cmocka_unit_test(test_cells),
        cmocka_unit_test(test_baked),
        cmocka_unit_test(test_repeats),
        cmocka_unit_test(test_exposure),
        cmocka_unit_test(test_jitter),
        cmocka_unit_test(test_faults),
        cmocka_unit_test(test_mover),
        cmocka_unit_test(test_unplugged),
        cmocka_unit_test(test_project),
        cmocka_unit_test(test_names),
        cmocka_unit_test(test_exposure_is_locked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
