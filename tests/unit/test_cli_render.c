/* test_cli_render.c - splatfit render leaves the pictures of its project as they are. */
#include "program.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* A project of PNG files, and a model. */
static int make_project(void **state) {
    if (program_set_up(state)) return -1;
    run_quietly(ARGS("capture", SCENE, "-o", "photos", "--format", "png", "--frames", "4"));
    run_quietly(ARGS("fit", SCENE, "-o", "m.ply", "--steps", "2", SMALL));
    return 0;
}

static void assert_not_rendered(const char *out, const char *part) {
    assert_refused(ARGS("render", "m.ply", "photos", "--out", out), FAILED, part, 1);
}

/* Into the project itself, also through a link to it. Elsewhere, and once more there, it may. */
static void photos_are_not_written_over(void **state) {
    (void)state;
    content before = content_of("photos/images/frame_000001.png");
    assert_not_rendered("photos", "images/frame_000001.png: is a picture of the project");
    assert_int_equal(symlink("photos", work("link")), 0);
    assert_not_rendered("link", "is a picture of the project");
    content after = content_of("photos/images/frame_000001.png");
    assert_int_equal(before.size, after.size);
    assert_memory_equal(before.data, after.data, before.size);
    free(before.data);
    free(after.data);
    for (int i = 0; i < 2; i++) run_quietly(ARGS("render", "m.ply", "photos", "--out", "photos/renders"));
    assert_true(test_exists(work("photos/renders/images/frame_000001.png")));
}

/* frame_000001.png and frame_000001.jpg */
static void names_that_would_be_one_are_refused(void **state) {
    (void)state;
    size_t size;
    char *text = (char *)test_read(work("photos/transforms.json"), &size);
    char *second = strstr(text, "frame_000002.png");
    assert_non_null(second);
    memcpy(second, "frame_000001.jpg", strlen("frame_000001.jpg"));
    FILE *f = fopen(work("photos/transforms.json"), "w");
    assert_non_null(f);
    assert_int_equal(fwrite(text, 1, size, f), size);
    assert_int_equal(fclose(f), 0);
    free(text);
    assert_int_equal(rename(work("photos/images/frame_000002.png"), work("photos/images/frame_000001.jpg")),
                     0);
    assert_not_rendered("r", "images/frame_000001: two pictures of the project have this name");
    assert_false(test_exists(work("r")));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(photos_are_not_written_over),
                                       cmocka_unit_test(names_that_would_be_one_are_refused)};
    return cmocka_run_group_tests_name("cli_render", tests, make_project, NULL);
}
