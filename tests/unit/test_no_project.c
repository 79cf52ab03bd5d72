/* test_no_project.c - photos and videos without cameras: the failure says which command to run next. */
#include "testing.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

static void make_file(const char *name) { test_write(test_path(name), "x", 1); }

static void assert_says(sf_status expected, const char *name, const char *const *parts) {
    sf_context *ctx = test_context();
    sf_scene *scene = NULL;
    char path[1024];
    snprintf(path, sizeof path, "%s", test_path(name));
    assert_status(ctx, sf_scene_load(ctx, path, NULL, &scene), expected);
    assert_null(scene);
    for (; *parts; parts++) assert_error_names(ctx, *parts);
    sf_context_destroy(&ctx);
}

static void test_photos(void **state) {
    (void)state;
    mkdir(test_path("photos"), 0777);
    make_file("photos/a.jpg");
    make_file("photos/b.JPEG");
    make_file("photos/c.PNG");
    make_file("photos/notes.txt");
    assert_says(SF_ERR_IO, "photos",
                (const char *[]){"photos: no project: 3 pictures, but no cameras", "splatfit cameras '",
                                 "photos' -o '", "photos.project'", NULL});
}

static void test_images_without_cameras(void **state) {
    (void)state;
    mkdir(test_path("scene"), 0777);
    mkdir(test_path("scene/images"), 0777);
    make_file("scene/images/a.jpg");
    assert_says(SF_ERR_IO, "scene/",
                (const char *[]){"1 pictures in images, but no cameras", "scene'; ",
                                 "splatfit cameras \"$P/images\" -o \"$P\"", NULL});
}

static void test_videos(void **state) {
    (void)state;
    mkdir(test_path("films"), 0777);
    make_file("films/walk.MP4");
    const char *parts[] = {"walk.MP4: no project: a video", "splatfit cameras '", "walk.MP4' -o '",
                           "films/walk.MP4.project'", NULL};
    assert_says(SF_ERR_FORMAT, "films/walk.MP4", parts);
    assert_says(SF_ERR_IO, "films", parts + 1);
}

/* By their first bytes, whatever their names; a picture of a phone begins as an MP4 does. */
static void test_videos_by_content(void **state) {
    (void)state;
    static const struct {
        const char *name, *bytes;
    } films[] = {{"mp4", "\1\1\1\40ftypisom...."},
                 {"mov", "\1\1\1\24ftypqt  ...."},
                 {"mkv", "\x1a\x45\xdf\xa3............"},
                 {"avi", "RIFF....AVI LIST"},
                 {"y4m", "YUV4MPEG2 W16 H16"}};
    for (size_t i = 0; i < sizeof films / sizeof *films; i++) {
        test_write(test_path(films[i].name), films[i].bytes, strlen(films[i].bytes));
        assert_says(SF_ERR_FORMAT, films[i].name, (const char *[]){"no project: a video", ".project'", NULL});
    }
    uint8_t packets[3 * 188] = {[0] = 'G', [188] = 'G', [2 * 188] = 'G'};
    test_write(test_path("ts"), packets, sizeof packets);
    assert_says(SF_ERR_FORMAT, "ts", (const char *[]){"ts: no project: a video", NULL});
    packets[188] = 'H';
    test_write(test_path("ts"), packets, sizeof packets);
    assert_says(SF_ERR_FORMAT, "ts", (const char *[]){"ts: is neither a folder", NULL});
    test_write(test_path("vob"), "\0\0\1\xba............", 16);
    assert_says(SF_ERR_FORMAT, "vob", (const char *[]){"vob: no project: a video", NULL});
    test_write(test_path("still"), "\1\1\1\40ftypheic....", 16);
    assert_says(SF_ERR_FORMAT, "still", (const char *[]){"still: is neither a folder", NULL});
}

static void test_database(void **state) {
    (void)state;
    mkdir(test_path("matched"), 0777);
    make_file("matched/database.db");
    assert_says(SF_ERR_IO, "matched",
                (const char *[]){"COLMAP's database.db, but neither cameras nor pictures",
                                 "colmap mapper --database_path \"$P/database.db\"", NULL});
}

/* A command that is pasted into a shell must name what is there. */
static void test_quotes_in_names(void **state) {
    (void)state;
    mkdir(test_path("bob's"), 0777);
    make_file("bob's/a.jpg");
    assert_says(SF_ERR_IO, "bob's",
                (const char *[]){"splatfit cameras '", "bob'\\''s' -o '", "bob'\\''s.project'", NULL});
    make_file("bob's first.walk.mp4");
    assert_says(
        SF_ERR_FORMAT, "bob's first.walk.mp4",
        (const char *[]){"bob'\\''s first.walk.mp4' -o '", "bob'\\''s first.walk.mp4.project'", NULL});
}

/* What is not installed is installed first. */
static void test_missing_programs(void **state) {
    (void)state;
    char *before = strdup(getenv("PATH"));
    assert_int_equal(setenv("PATH", test_path("films"), 1), 0);
    assert_says(SF_ERR_FORMAT, "films/walk.MP4", (const char *[]){"apt install ffmpeg && splatfit", NULL});
    mkdir(test_path("known"), 0777);
    make_file("known/database.db");
    assert_says(SF_ERR_IO, "known", (const char *[]){"apt install colmap && mkdir", NULL});
    make_file("films/colmap");
    chmod(test_path("films/colmap"), 0755);
    assert_says(SF_ERR_IO, "known", (const char *[]){"known'; mkdir", NULL});
    setenv("PATH", before, 1);
    free(before);
}

static void test_others(void **state) {
    (void)state;
    make_file("one.png");
    make_file("some.txt");
    mkdir(test_path("empty"), 0777);
    assert_says(SF_ERR_FORMAT, "one.png", (const char *[]){"one.png: is one picture", NULL});
    assert_says(SF_ERR_FORMAT, "some.txt", (const char *[]){"some.txt: is neither a folder", NULL});
    assert_says(SF_ERR_IO, "empty", (const char *[]){"empty: no project: looked for cameras.bin", NULL});
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_photos),
        cmocka_unit_test(test_images_without_cameras),
        cmocka_unit_test(test_videos),
        cmocka_unit_test(test_missing_programs),
        cmocka_unit_test(test_videos_by_content),
        cmocka_unit_test(test_database),
        cmocka_unit_test(test_quotes_in_names),
        cmocka_unit_test(test_others),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
