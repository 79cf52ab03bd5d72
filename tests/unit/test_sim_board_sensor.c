/* test_sim_board_sensor.c - the sensor of the camera that is carried around a simulated board, and its
 * faults. */
#include "sim_board_fixture.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sim/sim.h"

#define SMALL BOARD "?width=32&height=24&fps=0"

/* What a frame says of itself, and a sum over its pixels. */
typedef struct note {
    uint64_t sequence;
    int64_t time_ns;
    double exposure_s, gain, mean, eye[3];
    uint64_t hash;
} note;

/* Takes up to `most` frames of a source; returns how many there were. */
static size_t take_notes(sf_context *ctx, const char *name, size_t most, note *notes) {
    sf_source *source = sim_board_open_source(ctx, name);
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
    sf_sim sim = sim_board_make_sim(ctx, SMALL "&frames=1800");
    take_notes(ctx, SMALL "&frames=1800&noise=0&blur=0&exposure=fixed", sim_board_quick() ? 40 : FRAMES,
               notes);
    double most = 0;
    for (int i = 0; i < (sim_board_quick() ? 40 : FRAMES); i++) {
        double early = (double)i / 30 - (double)notes[i].time_ns * 1e-9, eye[3];
        sf_camera studio, world;
        assert_true(early > -1e-8 && early < 0.02);
        if (i) assert_true(notes[i].time_ns > notes[i - 1].time_ns);
        sf_sim_studio_camera(&sim, (double)notes[i].time_ns * 30e-9, &studio);
        sf_sim_to_world(&sim, &studio, &world);
        sf_camera_center(&world, eye);
        assert_true(sim_board_distance_between(eye, notes[i].eye) < 1e-6);
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
    take_notes(ctx, SMALL "&frames=60&noise=0&exposure=fixed&jitter=0&away=3:6", 8, odd);
    for (int i = 0; i < 8; i++)
        assert_memory_equal(odd[i].eye, usual[i + (i >= 3 && i < 6 ? 30 : 0)].eye, sizeof odd[i].eye);
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
    sf_source *sources[2] = {
        sim_board_open_source(ctx, BOARD "?width=80&height=60&fps=0&clean=1&exact=1&frames=60"),
        sim_board_open_source(ctx, BOARD "?width=80&height=60&fps=0&frames=60&exact=1&noise=0&blur=0"
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

/* A wall fills the picture; on the spot the camera turns and stays, then goes on from there. */
static void test_wall_and_spin(void **state) {
    (void)state;
    enum { FRAMES = 12 };
    sf_context *ctx = test_context();
    note usual[FRAMES], odd[FRAMES];
    const char *fixed = SMALL "&frames=60&noise=0&blur=0&exposure=fixed&jitter=0";
    char name[160];
    take_notes(ctx, fixed, FRAMES, usual);
    snprintf(name, sizeof name, "%s&wall=3:6", fixed);
    take_notes(ctx, name, FRAMES, odd);
    for (int i = 0; i < FRAMES; i++) assert_int_equal(odd[i].hash == usual[i].hash, i < 3 || i >= 6);
    assert_int_equal(odd[3].hash, odd[5].hash);
    snprintf(name, sizeof name, "%s&spin=3:6", fixed);
    take_notes(ctx, name, FRAMES, odd);
    for (int i = 0; i < FRAMES; i++) {
        const note *same = &usual[i <= 3 ? i : i < 6 ? 3 : i - 3];
        for (int k = 0; k < 3; k++) assert_true(fabs(odd[i].eye[k] - same->eye[k]) < 1e-6);
        assert_int_equal(odd[i].hash == same->hash, i <= 3 || i >= 6);
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
        sf_source *source = sim_board_open_source(ctx, names[live]);
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
    sf_sim sim = sim_board_make_sim(ctx, BOARD "?width=32&height=24&frames=10");
    for (size_t i = 0; i < 10; i++) {
        sf_view_info view;
        sf_camera camera;
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        sf_sim_camera(&sim, i, &camera);
        assert_true(sim_board_distance_between(view.camera.t_cw, camera.t_cw) < 1e-12);
        assert_true(sim_board_angle_between(view.camera.R_cw, camera.R_cw) < 1e-5);
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
               {BOARD "?mover_part=0.8", "mover_part: 0.8"},
               {BOARD "?wall=4", "wall: \"4\" is not A:B"},
               {BOARD "?spin=4:3", "spin: \"4:3\""},
               {BOARD "?noise=11", "noise: 11"},
               {"sim:studio-boards", "known: sim:studio, sim:studio-board, sim:corridor"}};
    sf_context *ctx = test_context();
    sf_source *source;
    sf_source_info info;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_status(ctx, sf_source_open(ctx, bad[i].name, &source), SF_ERR_ARGUMENT);
        assert_error_names(ctx, bad[i].part);
        assert_null(source);
    }
    source = sim_board_open_source(ctx, BOARD "?width=16&height=16");
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
        sources[k] = sim_board_open_source(ctx, SMALL "&exposure=auto&frames=30");
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
    sf_source *fixed = sim_board_open_source(ctx, "sim:studio?width=32&height=24&fps=0");
    sf_source_describe(fixed, &info);
    assert_false(info.can_lock_exposure);
    sf_source_close(&fixed);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_repeats),   cmocka_unit_test(test_exposure),
        cmocka_unit_test(test_jitter),    cmocka_unit_test(test_faults),
        cmocka_unit_test(test_mover),     cmocka_unit_test(test_wall_and_spin),
        cmocka_unit_test(test_unplugged), cmocka_unit_test(test_project),
        cmocka_unit_test(test_names),     cmocka_unit_test(test_exposure_is_locked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
