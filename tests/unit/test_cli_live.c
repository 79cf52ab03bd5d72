/* test_cli_live.c - splatfit live of a folder and of a video: frame by frame, and its project. */
#include "../program.h"

#include <stdio.h>
#include <stdlib.h>

#define WARNS(outcome, part) test_assert_contains((outcome).err, part, __FILE__, __LINE__)

enum { WIDTH = 96, HEIGHT = 72, FRAMES = 60, FEW = 30 };

static int film_frames(void) { return test_is_quick() ? FEW : FRAMES; }

/* The simulated camera's frames as a folder, with their poses as a path in a file. */
static void make_walk(void) {
    sf_context *ctx = test_context();
    char name[96];
    snprintf(name, sizeof name, "sim:studio?width=%d&height=%d&frames=%d", WIDTH, HEIGHT, film_frames());
    run_quietly(ARGS("capture", name, "-o", "walk", "--format", "png"));
    sf_source *source;
    assert_ok(ctx, sf_source_open(ctx, name, &source));
    FILE *file = fopen(work("path.txt"), "w");
    assert_non_null(file);
    for (int i = 0; i < film_frames(); i++) {
        sf_frame frame;
        double center[3], R_wc[9], q[4];
        assert_ok(ctx, sf_source_next(source, 0, &frame));
        for (int k = 0; k < 9; k++) R_wc[k] = frame.camera.R_cw[3 * (k % 3) + k / 3];
        sf_rotation_to_quat(R_wc, q);
        sf_camera_center(&frame.camera, center);
        fprintf(file, "%.9f %.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", i / 30.0, center[0], center[1], center[2],
                q[1], q[2], q[3], q[0]);
        sf_source_release(source, &frame);
    }
    fclose(file);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static double result_of(const char *key) {
    json_error_t error;
    json_t *log = json_load_file(work("out/log.json"), 0, &error);
    assert_non_null(log);
    double value = json_number_value(json_object_get(json_object_get(log, "result"), key));
    json_decref(log);
    return value;
}

/* Every frame is looked at, and the project can be fitted. */
static void check_walk(const char *source, const char *project) {
    clear_out();
    run_quietly(ARGS("live", source, "--poses", "file:path.txt", "--listen", "none", "-o", "out/scene.ply",
                     "--cameras", project, "--log", "out/log.json", "--track-rate", "30", SMALL));
    print_message("%s: %.0f frames, %.0f steps, %.2f dB\n", source, result_of("looked_at"),
                  result_of("steps"), result_of("held_out_psnr_corrected"));
    assert_true(result_of("looked_at") == film_frames());
    assert_true(result_of("steps") == 6 * film_frames());
    assert_true(result_of("held_out_psnr_corrected") > 14);
    assert_true(count_in("out/scene.ply") > 50);
    run_quietly(ARGS("fit", project, "--steps", "3", "-o", "out/again.ply", SMALL));
    assert_true(count_in("out/again.ply") > 20);
}

static void follows_a_folder(void **state) {
    (void)state;
    test_skip_emulated();
    make_walk();
    check_walk("walk", "project");
    clear_out();
    assert_refused(ARGS("live", "walk", "--poses", "file:path.txt", "-o", "out/b.ply", "--cameras", "walk"),
                   FAILED, "walk/images: is there already", 0);
}

/* In milliseconds: the first frame alone has a pose. */
static void says_times_that_do_not_meet(void **state) {
    (void)state;
    test_skip_emulated();
    FILE *file = fopen(work("ms.txt"), "w");
    assert_non_null(file);
    for (int i = 0; i < FRAMES; i++) fprintf(file, "%.6f %d 0 0 0 0 0 1\n", 1000 * i / 30.0, i);
    fclose(file);
    clear_out();
    outcome o = run_args(ARGS("live", "walk", "--poses", "file:ms.txt?gap=0.01", "--listen", "none", "-o",
                              "out/ms.ply", "--steps-per-frame", "1", SMALL));
    WARNS(o,
          "warning: file:ms.txt?gap=0.01: 1 of 30 frames, of 0.000 to 0.967 s, have a pose: the poses are of "
          "0.000 to 1966.667 s");
    free_outcome(&o);
}

static void follows_a_video(void **state) {
    char command[1024];
    (void)state;
    test_skip_emulated(); /* ffmpeg is this machine's */
    if (system("ffmpeg -version >/dev/null 2>&1 && ffprobe -version >/dev/null 2>&1"))
        test_skip("ffmpeg is not installed");
    snprintf(command, sizeof command,
             "ffmpeg -nostdin -v error -y -framerate 30 -i '%s/frame_%%06d.png' -c:v mpeg4 -q:v 1 '%s'",
             work("walk/images"), work("walk.mp4"));
    assert_int_equal(system(command), 0);
    check_walk("walk.mp4", "project.mp4");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(follows_a_folder),
                                       cmocka_unit_test(says_times_that_do_not_meet),
                                       cmocka_unit_test(follows_a_video)};
    return cmocka_run_group_tests(tests, program_set_up, NULL);
}
