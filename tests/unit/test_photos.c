/* test_photos.c - the program from outside: a folder of photos, its cameras, and a fit of it. */
#include "program.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SAYS(outcome, part)  test_assert_contains((outcome).out, part, __FILE__, __LINE__)
#define WARNS(outcome, part) test_assert_contains((outcome).err, part, __FILE__, __LINE__)

enum { PHOTOS = 6, WIDTH = 320, HEIGHT = 240 };

/* Neighbours on the studio's path, as photos. */
static int set_up(void **state) {
    static float rgb[3 * WIDTH * HEIGHT];
    char name[64];
    if (program_set_up(state)) return 1;
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, "sim:studio?width=320&height=240&frames=24", NULL);
    make_folder("photos");
    make_folder("one");
    make_folder("empty");
    make_folder("unread");
    make_folder("white");
    for (size_t i = 0; i < PHOTOS; i++) {
        sf_view_info view = test_view_info(scene, i);
        assert_ok(ctx, sf_scene_get_pixels(scene, view.id, rgb, NULL));
        snprintf(name, sizeof name, "photos/%zu.png", i);
        assert_ok(ctx, sf_write_png(ctx, work(name), WIDTH, HEIGHT, rgb));
    }
    write_text("photos/broken.jpg", "no picture");
    write_text("one/a.jpg", "no picture");
    write_text("unread/a.jpg", "no picture");
    write_text("unread/b.jpg", "no picture");
    for (size_t i = 0; i < COUNT(rgb); i++) rgb[i] = 1;
    assert_ok(ctx, sf_write_png(ctx, work("white/0.png"), WIDTH, HEIGHT, rgb));
    write_text("film.mp4", "no film");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return 0;
}

static void test_project(void **state) {
    (void)state;
    outcome o = run_ok("cameras", "photos", "-o", "p");
    SAYS(o, "6 of 7 photos placed");
    SAYS(o, "not placed: broken.jpg: is neither a JPEG nor a PNG picture");
    SAYS(o, "focal length ");
    free_outcome(&o);
    o = run_ok("info", "p");
    SAYS(o, "COLMAP: 6 views: 5 to train on, 1 held out");
    free_outcome(&o);
    o = run_ok("cameras", "photos", "-o", "p", "-q"); /* the folder is there, with its link */
    assert_int_equal(strlen(o.out), 0);
    free_outcome(&o);
    o = run_ok("cameras", "photos", "-o", "p", "--progress", "json");
    assert_int_equal(strlen(o.out), 0);
    free_outcome(&o);
    o = run_ok("cameras", "photos", "-o", "p", "--progress", "plain", "--all-pairs", "0");
    SAYS(o, "pairs matched: ");
    assert_null(strstr(o.out, "0 of 0"));
    free_outcome(&o);
}

/* Another project's folders are told of before photos are read. */
static void test_other_project(void **state) {
    (void)state;
    make_folder("other");
    make_folder("other/images");
    outcome o = run("cameras", "unread", "-o", "other");
    assert_int_equal(o.code, FAILED);
    WARNS(o, "other/images: is there, and is another folder");
    free_outcome(&o);
    make_folder("masked");
    make_folder("masked/masks");
    o = run("cameras", "unread", "-o", "masked", "--masks", "white");
    WARNS(o, "masked/masks: is there, and is another folder");
    free_outcome(&o);
    o = run("cameras", "unread", "-o", "film.mp4");
    WARNS(o, "film.mp4: Not a directory");
    free_outcome(&o);
}

/* A run without masks leaves none to a fit. */
static void test_masks(void **state) {
    (void)state;
    outcome o = run_ok("cameras", "photos", "-o", "m", "--masks", "white");
    free_outcome(&o);
    assert_int_equal(access(work("m/masks/0.png"), F_OK), 0);
    o = run_ok("cameras", "photos", "-o", "m", "--no-masks");
    free_outcome(&o);
    assert_int_not_equal(access(work("m/masks"), F_OK), 0);
    assert_int_equal(access(work("white/0.png"), F_OK), 0);
}

/* The cameras are found once. */
static void test_fit(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("fit", "photos", "-o", "out/m.ply", "--steps", "3", SMALL);
    SAYS(o, "6 of 7 photos placed");
    SAYS(o, "photos: 5 training views, 1 held out");
    free_outcome(&o);
    assert_true(count_in("out/m.ply") > 0);
    assert_int_equal(access(work("photos.project/sparse/0/images.bin"), F_OK), 0);
    o = run_ok("fit", "photos/", "-o", "out/m.ply", "--steps", "3", SMALL);
    assert_null(strstr(o.out, "photos placed"));
    WARNS(o, "cameras of photos/, found before: photos.project");
    free_outcome(&o);
}

static void test_bad_input(void **state) {
    (void)state;
    static const bad_input inputs[] = {
        {USAGE, "-o PROJECT", {"cameras", "photos"}},
        {FAILED, "nowhere: cannot be opened as a folder of photos", {"cameras", "nowhere", "-o", "q"}},
        {FAILED, "empty: holds no photos", {"cameras", "empty", "-o", "q"}},
        {FAILED, "one: one photo alone shows no depth", {"cameras", "one", "-o", "q"}},
        {USAGE, "--side", {"cameras", "photos", "-o", "q", "--side", "63"}},
        {USAGE, "--features", {"cameras", "photos", "-o", "q", "--features", "99"}},
        {USAGE, "memory: \"much\"", {"cameras", "photos", "-o", "q", "--memory", "much"}},
        {FAILED, "memory: photos: 7 photos take about ", {"cameras", "photos", "-o", "q", "--memory", "10M"}},
        {FAILED, "--frames: is for videos", {"cameras", "photos", "-o", "q", "--frames", "9"}},
        {FAILED, "film.mp4: ", {"cameras", "film.mp4", "-o", "q"}},
        {USAGE, "--focal", {"cameras", "photos", "-o", "q", "--focal", "wide"}},
        {FAILED, "focal: -1 px", {"cameras", "photos", "-o", "q", "--focal", "-1"}},
    };
    for (size_t i = 0; i < COUNT(inputs); i++) {
        outcome o = run_args(inputs[i].args);
        assert_int_equal(o.code, inputs[i].code);
        WARNS(o, inputs[i].part);
        assert_int_not_equal(access(work("q"), F_OK), 0);
        free_outcome(&o);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_project), cmocka_unit_test(test_other_project), cmocka_unit_test(test_masks),
        cmocka_unit_test(test_fit),     cmocka_unit_test(test_bad_input),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
