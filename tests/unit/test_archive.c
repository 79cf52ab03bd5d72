/* test_archive.c - projects in a .zip: whatever ends the reading of one, and whenever, nothing of what it was
 * unpacked to stays. */
#include "program.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "io/zip.h"

#ifdef SF_HAVE_LIBZIP

#include <zip.h>

enum { VIEWS = 60, WIDTH = 640, HEIGHT = 480, TEXT = 16384 };

/* An archive of a transforms.json with so many views, which share a picture. */
static void write_archive(const char *name, int views, int width, int height) {
    static float rgb[3 * WIDTH * HEIGHT];
    static char json[TEXT];
    sf_context *ctx = test_context();
    uint8_t *picture;
    size_t size;
    for (int i = 0; i < 3 * width * height; i++) rgb[i] = (float)(i % 251) / 250;
    assert_ok(ctx, sf_encode_jpeg(ctx, width, height, rgb, 80, &picture, &size));
    zip_t *zip = zip_open(test_path(name), ZIP_CREATE | ZIP_TRUNCATE, NULL);
    assert_non_null(zip);
    int used =
        snprintf(json, TEXT, "{\"w\": %d, \"h\": %d, \"fl_x\": %d, \"frames\": [", width, height, width);
    for (int i = 0; i < views; i++) {
        char file[32];
        snprintf(file, sizeof file, "images/%d.jpg", i);
        used += snprintf(json + used, TEXT - (size_t)used,
                         "%s{\"file_path\": \"%s\", \"transform_matrix\": "
                         "[[1,0,0,%d],[0,1,0,0],[0,0,1,3],[0,0,0,1]]}",
                         i ? ", " : "", file, i);
        assert_true(zip_file_add(zip, file, zip_source_buffer(zip, picture, size, 0), 0) >= 0);
    }
    used += snprintf(json + used, TEXT - (size_t)used, "]}");
    assert_true(used < TEXT);
    assert_true(zip_file_add(zip, "transforms.json", zip_source_buffer(zip, json, (size_t)used, 0), 0) >= 0);
    assert_int_equal(zip_close(zip), 0);
    sf_encoded_free(ctx, &picture);
    sf_context_destroy(&ctx);
}

/* Archives are unpacked to a folder of their own. */
static const char *unpack_to(const char *name) {
    static char folder[4096];
    snprintf(folder, sizeof folder, "%s", test_path(name));
    mkdir(folder, 0777);
    assert_int_equal(setenv("TMPDIR", folder, 1), 0);
    assert_int_equal(test_count_entries(folder), 0);
    return folder;
}

static void load(sf_context *ctx, const char *name) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, test_path(name), NULL, &scene));
    sf_scene_destroy(&scene);
}

/* What others have there. */

static void make_left(const char *name, int locked, const char *file) {
    char path[256];
    snprintf(path, sizeof path, "unpacked/%s", name);
    assert_int_equal(mkdir(test_path(path), 0700), 0);
    snprintf(path, sizeof path, "unpacked/%s/.splatfit-lock", name);
    if (locked) test_write(test_path(path), "", 0);
    snprintf(path, sizeof path, "unpacked/%s/%s", name, file);
    if (*file) test_write(test_path(path), "x", 1);
}

static void unpack(sf_context *ctx, const char *path) {
    static sf_unpacked to;
    if (sf_zip_unpack(ctx, path, &to)) _exit(1);
}

/* A process that has unpacked an archive. */
static pid_t start_reader(const char *name) { return test_start(test_path(name)); }

static void test_what_the_dead_left_goes(void **state) {
    (void)state;
    write_archive("small.zip", 3, 24, 16);
    const char *folder = unpack_to("unpacked");
    sf_context *ctx = test_context();
    test_kill(start_reader("small.zip"));
    assert_int_equal(test_count_entries(folder), 1);
    pid_t living = start_reader("small.zip");
    assert_int_equal(test_count_entries(folder), 1); /* it has removed what the other left */
    load(ctx, "small.zip");
    assert_int_equal(test_count_entries(folder), 1);
    test_kill(living);
    /* Half made, half removed; then what has never been ours. */
    make_left("splatfit-zip-aaaaaa", 0, "");
    make_left("splatfit-zip-bbbbbb", 1, "");
    make_left("splatfit-zip-cccccc", 0, "of-others");
    make_left("splatfit-zip-of-others", 1, "kept");
    make_left("splatfit-dddddd", 1, "kept");
    load(ctx, "small.zip");
    assert_int_equal(test_count_entries(folder), 3);
    assert_int_equal(access(test_path("unpacked/splatfit-zip-cccccc/of-others"), F_OK), 0);
    assert_int_equal(access(test_path("unpacked/splatfit-zip-of-others/kept"), F_OK), 0);
    assert_int_equal(access(test_path("unpacked/splatfit-dddddd/kept"), F_OK), 0);
    sf_context_destroy(&ctx);
}

/* Photos alone: the advice names the archive, never the folder that it was unpacked to. */
static void test_photos_alone(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    zip_t *zip = zip_open(test_path("photos.zip"), ZIP_CREATE | ZIP_TRUNCATE, NULL);
    assert_non_null(zip);
    for (int i = 0; i < 3; i++) {
        char name[32];
        snprintf(name, sizeof name, "album/%d.jpg", i);
        assert_true(zip_file_add(zip, name, zip_source_buffer(zip, "x", 1, 0), 0) >= 0);
    }
    assert_int_equal(zip_close(zip), 0);
    assert_status(ctx, sf_scene_load(ctx, test_path("photos.zip"), NULL, &scene), SF_ERR_IO);
    assert_error_names(ctx, "photos.zip: no project: 3 pictures, but no cameras");
    assert_error_names(ctx, "/photos.zip' -d '");
    assert_error_names(ctx, "/photos' && splatfit fit '");
    assert_null(strstr(sf_last_error(ctx), "splatfit-zip-"));
    assert_null(strstr(sf_last_error(ctx), ".project"));
    sf_context_destroy(&ctx);
}

/* A video alone, which is not unpacked: the advice names where it will lie. */
static void test_video_alone(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    zip_t *zip = zip_open(test_path("film.zip"), ZIP_CREATE | ZIP_TRUNCATE, NULL);
    assert_non_null(zip);
    assert_true(zip_file_add(zip, "notes.txt", zip_source_buffer(zip, "x", 1, 0), 0) >= 0);
    assert_true(zip_file_add(zip, "clip/walk.MP4", zip_source_buffer(zip, "x", 1, 0), 0) >= 0);
    assert_int_equal(zip_close(zip), 0);
    assert_status(ctx, sf_scene_load(ctx, test_path("film.zip"), NULL, &scene), SF_ERR_IO);
    assert_error_names(ctx, "film.zip: no project: a video, but no cameras");
    assert_error_names(ctx, "/film.zip' -d '");
    assert_error_names(ctx, "/film' && splatfit fit '");
    assert_error_names(ctx, "/film/clip/walk.MP4' -o splat.ply");
    assert_null(strstr(sf_last_error(ctx), "splatfit-zip-"));
    sf_context_destroy(&ctx);
}

/* A folder that is not there is said, and is tried no longer than that takes. */
static void test_no_folder(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    write_archive("small.zip", 3, 24, 16);
    assert_int_equal(setenv("TMPDIR", test_path("absent"), 1), 0);
    assert_status(ctx, sf_scene_load(ctx, test_path("small.zip"), NULL, &scene), SF_ERR_IO);
    assert_error_names(ctx, "small.zip: cannot be unpacked to ");
    assert_error_names(ctx, "absent");
    sf_context_destroy(&ctx);
}

/* Cancelled. */

/* An allocator whose countdown-th call cancels. */
typedef struct canceller {
    sf_context *ctx;
    long countdown;
} canceller;

static void *cancelling_alloc(void *user, size_t size) {
    canceller *c = user;
    if (c->ctx && !--c->countdown) sf_scene_cancel_loads(c->ctx);
    return malloc(size);
}

static void plain_free(void *user, void *block) {
    (void)user;
    free(block);
}

static void test_cancelled_at_any_moment(void **state) {
    (void)state;
    write_archive("small.zip", 3, 24, 16);
    const char *folder = unpack_to("cancelled");
    int cancelled = 0, done = 0;
    for (long at = 1; done < 3; at++) {
        canceller c = {.countdown = at};
        const sf_allocator allocator = {cancelling_alloc, plain_free, &c};
        const sf_context_options options = {.allocator = &allocator, .threads = 1};
        sf_context *ctx;
        sf_scene *scene;
        assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
        c.ctx = ctx;
        sf_status status = sf_scene_load(ctx, test_path("small.zip"), NULL, &scene);
        assert_int_equal(test_count_entries(folder), 0);
        if (status) {
            assert_status(ctx, status, SF_ERR_CANCELLED);
            assert_error_names(ctx, "small.zip: reading it was cancelled");
            assert_null(scene);
            cancelled++;
        } else {
            done += c.countdown > 0; /* it went by before */
        }
        if (c.countdown <= 0) { /* for good */
            sf_scene_destroy(&scene);
            assert_status(ctx, sf_scene_load(ctx, "sim:studio", NULL, &scene), SF_ERR_CANCELLED);
        }
        sf_scene_destroy(&scene);
        sf_context_destroy(&ctx);
    }
    assert_true(cancelled > 10);
}

/* The program. */

/* Of a run that is sent a signal so long after it has begun to unpack: whether that has ended it. */
static int interrupt(int number, int after_ms) {
    const char *folder = test_path("signalled");
    int status;
    double since = now();
    pid_t pid =
        start_program(ARGS("fit", test_path("large.zip"), "-o", "out/m.ply", SMALL, "--steps", "1"), NULL);
    while (test_count_entries(folder) == 0)
        if (has_ended(pid, since, &status)) fail_msg("the program has unpacked nothing");
    test_pause_ms(after_ms);
    kill(pid, number);
    outcome o = wait_for(pid);
    int ended = o.signal == number;
    if (!ended) assert_true(o.code == 0 || o.code == 128 + number);
    free_outcome(&o);
    return ended;
}

static void test_signals(void **state) {
    (void)state;
    static const int moments[] = {0, 10, 30, 60, 100, 150, 250};
    int ended = 0;
    if (program_set_up(NULL)) fail_msg("there is no program");
    write_archive("large.zip", VIEWS, WIDTH, HEIGHT);
    const char *folder = unpack_to("signalled");
    for (size_t i = 0; i < COUNT(moments); i++) {
        clear_out();
        ended += interrupt(i % 2 ? SIGTERM : SIGINT, moments[i]);
        assert_int_equal(test_count_entries(folder), 0);
    }
    assert_true(ended > 0);
    /* What cannot be caught leaves it to the next. */
    interrupt(SIGKILL, 0);
    assert_int_equal(test_count_entries(folder), 1);
    clear_out();
    run_quietly(ARGS("info", test_path("large.zip")));
    assert_int_equal(test_count_entries(folder), 0);
}

int main(int argc, char **argv) {
    test_begin(argc, argv, unpack);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_photos_alone),
        cmocka_unit_test(test_video_alone),
        cmocka_unit_test(test_what_the_dead_left_goes),
        cmocka_unit_test(test_no_folder),

        cmocka_unit_test(test_cancelled_at_any_moment),
        cmocka_unit_test(test_signals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#else

static void test_not_built(void **state) {
    (void)state;
    test_skip("not built with libzip");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_not_built)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#endif
