/* test_photos_changed.c - the program from outside: photos that are moved, changed or masked after their
 * cameras were found, and cameras that are not its own. */
#include "program.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define SAYS(outcome, part)  test_assert_contains((outcome).out, part, __FILE__, __LINE__)
#define WARNS(outcome, part) test_assert_contains((outcome).err, part, __FILE__, __LINE__)
#define FIT_OF(photos)       "fit", photos, "-o", "out/m.ply", "--steps", "2", SMALL

enum { PHOTOS = 7, WIDTH = 320, HEIGHT = 240 };

static sf_context *context;
static sf_scene *studio;

/* A picture of the studio's path as the photo `name`. */
static void write_photo(const char *name, size_t view) {
    static float rgb[3 * WIDTH * HEIGHT];
    assert_ok(context, sf_scene_get_pixels(studio, test_view_info(studio, view).id, rgb, NULL));
    assert_ok(context, sf_write_png(context, work(name), WIDTH, HEIGHT, rgb));
}

static void write_photos(const char *folder) {
    char name[64];
    make_folder(folder);
    for (size_t i = 0; i < PHOTOS - 1; i++) {
        snprintf(name, sizeof name, "%s/%zu.png", folder, i);
        write_photo(name, i);
    }
}

static int is_there(const char *name) { return !access(work(name), F_OK); }

static void assert_link(const char *name, const char *target) {
    char text[1024] = "";
    assert_true(readlink(work(name), text, sizeof text - 1) > 0);
    assert_string_equal(text, target);
}

static void move(const char *from, const char *to) {
    char path[1024];
    snprintf(path, sizeof path, "%s", work(from));
    assert_int_equal(rename(path, work(to)), 0);
}

/* Photos and project are moved together; then the photos alone. */
static void test_moved(void **state) {
    (void)state;
    make_folder("before");
    write_photos("before/photos");
    run_quietly(ARGS(FIT_OF("before/photos")));
    assert_link("before/photos.project/images", "../photos");
    move("before", "after");
    outcome o = run_ok(FIT_OF("after/photos.project"));
    SAYS(o, "5 training views, 1 held out");
    free_outcome(&o);
    move("after/photos", "after/album");
    o = run(FIT_OF("after/photos.project"));
    assert_int_equal(o.code, FAILED);
    WARNS(o, "after/photos.project/images: is a link to ../photos, which is not there: put that folder back");
    assert_int_equal(strchr(o.err, '\n') - o.err, strlen(o.err) - 1); /* one line */
    free_outcome(&o);
    move("after/photos.project", "after/album.project"); /* that of the album now */
    o = run_ok(FIT_OF("after/album"));
    WARNS(o, "cameras of after/album, found before: after/album.project");
    free_outcome(&o);
    assert_link("after/album.project/images", "../album");
}

/* A link out of the folder around the project, and one into the project. */
static void test_links(void **state) {
    (void)state;
    make_folder("far");
    make_folder("near");
    write_photos("near/raw");
    write_photos("elsewhere");
    run_quietly(ARGS("cameras", "elsewhere", "-o", "far/p"));
    assert_link("far/p/images", work("elsewhere"));
    run_quietly(ARGS("cameras", "near/raw", "-o", "near"));
    assert_link("near/images", "raw");
    run_quietly(ARGS("cameras", "elsewhere", "-o", "elsewhere/p"));
    assert_link("elsewhere/p/images", "..");
}

static void test_changed(void **state) {
    (void)state;
    write_photos("some");
    run_quietly(ARGS(FIT_OF("some")));
    write_photo("some/9.png", PHOTOS - 1);
    assert_int_equal(unlink(work("some/0.png")), 0);
    write_photo("some/1.png", PHOTOS);
    outcome o = run_ok(FIT_OF("some"));
    WARNS(o,
          "some: photos were changed after their cameras were found (1 added, 1 removed, 1 replaced): they "
          "are found again");
    WARNS(o, "some.project/sparse/0: what was there before is kept as some.project/sparse/0.old");
    SAYS(o, "6 of 6 photos placed");
    SAYS(o, "some: 5 training views, 1 held out");
    free_outcome(&o);
    assert_true(is_there("some.project/sparse/0.old/images.bin"));
    o = run_ok(FIT_OF("some"));
    assert_null(strstr(o.err, "found again"));
    assert_null(strstr(o.out, "photos placed"));
    free_outcome(&o);
    write_photo("some/2.png", 2); /* the same bytes, later */
    o = run_ok(FIT_OF("some"));
    assert_null(strstr(o.err, "found again"));
    free_outcome(&o);
}

/* The project given itself: its cameras are used, and what changed is said. */
static void test_changed_beside_the_project(void **state) {
    (void)state;
    write_photos("given");
    run_quietly(ARGS(FIT_OF("given")));
    outcome o = run_ok(FIT_OF("given.project"));
    assert_null(strstr(o.err, "were changed"));
    free_outcome(&o);
    write_photo("given/9.png", PHOTOS - 1);
    assert_int_equal(unlink(work("given/0.png")), 0);
    o = run_ok(FIT_OF("given.project"));
    WARNS(o,
          "warning: given.project: photos were changed after their cameras were found (1 added, 1 removed, 0 "
          "replaced)");
    WARNS(o, "splatfit cameras given.project -o given.project finds them again");
    free_outcome(&o);
    o = run_ok(FIT_OF("given.project"), "--quiet");
    assert_null(strstr(o.err, "were changed"));
    free_outcome(&o);
    run_quietly(ARGS("cameras", "given.project", "-o", "given.project"));
    o = run_ok(FIT_OF("given.project"));
    assert_null(strstr(o.err, "were changed"));
    SAYS(o, "given.project: 5 training views, 1 held out");
    free_outcome(&o);
}

/* Masks that come later are used, with the cameras as they are. */
static void test_masks_later(void **state) {
    (void)state;
    static float rgb[3 * WIDTH * HEIGHT];
    write_photos("plain");
    run_quietly(ARGS(FIT_OF("plain")));
    make_folder("plain/masks");
    for (size_t i = 0; i < COUNT(rgb) / 2; i++) rgb[i] = 1;
    assert_ok(context, sf_write_png(context, work("plain/masks/1.png.png"), WIDTH, HEIGHT, rgb));
    outcome o = run_ok(FIT_OF("plain"), "--no-masks");
    assert_null(strstr(o.err, "masks of"));
    free_outcome(&o);
    o = run_ok(FIT_OF("plain"));
    WARNS(o, "plain.project/masks: masks of 1 of 6 pictures");
    WARNS(o, "found before");
    free_outcome(&o);
    assert_link("plain.project/masks", "../plain/masks");
    move("plain/masks", "plain/old");
    o = run_ok(FIT_OF("plain"));
    assert_null(strstr(o.err, "masks of"));
    free_outcome(&o);
}

/* Cameras of COLMAP, of a hand, or of nobody knows whom are not written over. */
static void test_not_its_own(void **state) {
    (void)state;
    write_photos("own");
    run_quietly(ARGS("cameras", "own", "-o", "q"));
    run_quietly(ARGS("cameras", "own", "-o", "q"));
    content before = content_of("q/sparse/0/images.bin");
    assert_int_equal(unlink(work("q/photos.txt")), 0);
    static const char *const given[] = {"own", "q", "q/images"};
    for (size_t i = 0; i < COUNT(given); i++) {
        outcome o = run("cameras", given[i], "-o", "q");
        assert_int_equal(o.code, FAILED);
        WARNS(o, "q/sparse/0: holds cameras that splatfit did not find, or that were changed since");
        free_outcome(&o);
    }
    content after = content_of("q/sparse/0/images.bin");
    assert_int_equal(after.size, before.size);
    assert_memory_equal(after.data, before.data, before.size);
    free(before.data), free(after.data);
    run_quietly(ARGS("cameras", "own", "-o", "r"));
    write_text("r/sparse/0/points3D.bin", "shorter");
    outcome o = run("cameras", "own", "-o", "r");
    assert_int_equal(o.code, FAILED);
    WARNS(o, "r/sparse/0: holds cameras");
    free_outcome(&o);
}

/* The frames of another video are kept, and so are their cameras. */
static void test_another_video(void **state) {
    (void)state;
    char command[4096], pictures[1024];
    test_skip_emulated();
    if (system("ffmpeg -version >/dev/null 2>&1 && ffprobe -version >/dev/null 2>&1"))
        test_skip("ffmpeg is not installed");
    write_photos("frames");
    snprintf(pictures, sizeof pictures, "%s", work("frames"));
    for (int i = 0; i < 2; i++) {
        snprintf(command, sizeof command,
                 "ffmpeg -nostdin -v error -y -start_number %d -i '%s/%%d.png' -c:v mpeg4 -q:v 2 '%s'", i,
                 pictures, work("film.mp4"));
        assert_int_equal(system(command), 0);
        outcome o = run_ok(FIT_OF("film.mp4"));
        SAYS(o, i ? "5 of 5 frames taken" : "6 of 6 frames taken");
        if (i) WARNS(o, "film.mp4 was changed after its cameras were found: they are found again");
        if (i)
            WARNS(o, "film.mp4.project/images: what was there before is kept as film.mp4.project/images.old");
        free_outcome(&o);
    }
    assert_true(is_there("film.mp4.project/images.old/frame_000005.jpg"));
    assert_true(is_there("film.mp4.project/sparse/0.old/images.bin"));
    outcome o = run_ok(FIT_OF("film.mp4"));
    assert_null(strstr(o.err, "found again"));
    free_outcome(&o);
}

static int set_up(void **state) {
    if (program_set_up(state)) return 1;
    context = test_context();
    studio = test_load_scene(context, "sim:studio?width=320&height=240&frames=24", NULL);
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    sf_scene_destroy(&studio);
    sf_context_destroy(&context);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_moved),        cmocka_unit_test(test_links),
        cmocka_unit_test(test_changed),      cmocka_unit_test(test_changed_beside_the_project),
        cmocka_unit_test(test_masks_later),  cmocka_unit_test(test_not_its_own),
        cmocka_unit_test(test_another_video)};
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
