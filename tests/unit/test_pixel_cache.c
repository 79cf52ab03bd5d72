/* test_pixel_cache.c - pictures that memory does not hold: the same pixels from a file, and what happens
 * where no disk takes them. */
#include "testing.h"

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "scene/pixels.h"

#define SCENE "sim:studio?width=64&height=48&frames=20"
enum { PIXELS = 64 * 48, BYTES = 4 * PIXELS, VIEWS = 8 };

/* The number that the next file gets. */
static int next_file(void) {
    int fd = dup(0);
    close(fd);
    return fd;
}

static sf_pixel_cache *make_cache(sf_context *ctx, size_t buffers) {
    sf_pixel_cache *cache;
    assert_ok(ctx, sf_pixel_cache_create(ctx, "test", VIEWS * BYTES, BYTES, buffers, &cache));
    return cache;
}

static uint8_t shade(size_t view, size_t i) { return (uint8_t)((i * 2654435761u >> 7) + 31 * view); }

/* A view of its own, whose second weight is 0; every other one has no weights. */
static sf_view *make_view(sf_context *ctx, size_t number) {
    sf_camera camera = test_camera_around((int)number, VIEWS, 64, 48);
    sf_view *view;
    assert_ok(ctx, sf_view_create(ctx, "view", &camera, SF_SPLIT_TRAIN, number % 2 == 0, &view));
    for (size_t i = 0; i < 3 * PIXELS; i++) view->rgb[i] = shade(number, i);
    for (size_t i = 0; view->weight && i < PIXELS; i++) view->weight[i] = i == 1 ? 0 : shade(number, i) | 1;
    return view;
}

static void check_pixels(const sf_view_pixels *p, size_t number) {
    for (size_t i = 0; i < 3 * PIXELS; i++) assert_int_equal(p->rgb[i], shade(number, i));
    assert_true((p->weight != NULL) == (number % 2 == 0));
    for (size_t i = 0; p->weight && i < PIXELS; i++)
        assert_int_equal(p->weight[i], i == 1 ? 0 : shade(number, i) | 1);
}

/* What a view shows stays, with its hash, though its memory is given back. */
static void test_moved_out(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_pixel_cache *cache = make_cache(ctx, 2);
    sf_view *views[VIEWS];
    for (size_t i = 0; i < VIEWS; i++) {
        uint64_t before, after;
        sf_view *same = make_view(ctx, i);
        assert_ok(ctx, sf_view_hash(same, &before));
        views[i] = make_view(ctx, i);
        assert_ok(ctx, sf_view_move_out(views[i], cache));
        assert_null(views[i]->rgb);
        assert_null(views[i]->weight);
        assert_ok(ctx, sf_view_hash(views[i], &after));
        assert_true(before == after);
        assert_false(sf_view_is_hidden(views[i]));
        sf_view_release(same);
    }
    sf_pixel_cache_release(cache); /* the views hold it */
    for (size_t round = 0; round < 2; round++)
        for (size_t i = 0; i < VIEWS; i++) {
            sf_view_pixels p;
            uint8_t weight;
            sf_view_expect(views[i]);
            assert_ok(ctx, sf_view_open(views[i], &p));
            check_pixels(&p, i);
            sf_view_close(views[i], &p);
            assert_ok(ctx, sf_view_weight(views[i], 1, 0, &weight));
            assert_int_equal(weight, i % 2 ? 255 : 0);
            uint8_t rgb[3];
            assert_ok(ctx, sf_view_color(views[i], 5, 2, rgb));
            for (size_t c = 0; c < 3; c++) assert_int_equal(rgb[c], shade(i, c * PIXELS + 2 * 64 + 5));
            assert_ok(ctx, sf_view_weight(views[i], 5, 2, &weight));
            assert_int_equal(weight, i % 2 ? 255 : shade(i, 2 * 64 + 5) | 1);
        }
    for (size_t i = 0; i < VIEWS; i++) sf_view_release(views[i]);
    sf_context_destroy(&ctx);
}

/* A view that nothing of counts is known without its pixels. */
static void test_hidden(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_pixel_cache *cache = make_cache(ctx, 2);
    sf_view *view = make_view(ctx, 0);
    memset(view->weight, 0, PIXELS);
    assert_ok(ctx, sf_view_move_out(view, cache));
    assert_true(sf_view_is_hidden(view));
    sf_view_release(view);
    sf_pixel_cache_release(cache);
    sf_context_destroy(&ctx);
}

/* More views at once than there are buffers: each is there, and what is too much goes again. */
static void test_more_than_buffers(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_pixel_cache *cache = make_cache(ctx, 3);
    sf_view *views[VIEWS];
    sf_view_pixels p[VIEWS], again;
    assert_true(sf_pixel_cache_missing(cache) == 3 * BYTES);
    for (size_t i = 0; i < VIEWS; i++) {
        views[i] = make_view(ctx, i);
        assert_ok(ctx, sf_view_move_out(views[i], cache));
    }
    for (size_t i = 0; i < VIEWS; i++) assert_ok(ctx, sf_view_open(views[i], &p[i]));
    assert_ok(ctx, sf_view_open(views[1], &again));
    assert_ptr_equal(again.rgb, p[1].rgb); /* one buffer serves both */
    for (size_t i = 0; i < VIEWS; i++) check_pixels(&p[i], i);
    assert_true(sf_pixel_cache_missing(cache) == 0);
    for (size_t i = 0; i < VIEWS; i++) sf_view_close(views[i], &p[i]);
    check_pixels(&again, 1);
    sf_view_close(views[1], &again);
    assert_true(sf_pixel_cache_missing(cache) == 0); /* three stay */
    for (size_t i = 0; i < VIEWS; i++) sf_view_release(views[i]);
    sf_pixel_cache_release(cache);
    sf_context_destroy(&ctx);
}

typedef struct readers {
    sf_view *views[VIEWS];
    atomic_int wrong;
} readers;

static void *read_views(void *arg) {
    readers *r = arg;
    for (size_t k = 0; k < 200; k++) {
        size_t i = k * 5 % VIEWS;
        sf_view_pixels p;
        if (sf_view_open(r->views[i], &p)) {
            atomic_fetch_add(&r->wrong, 1);
            continue;
        }
        for (size_t at = 0; at < 3 * PIXELS; at += 997)
            if (p.rgb[at] != shade(i, at)) atomic_fetch_add(&r->wrong, 1);
        sf_view_close(r->views[i], &p);
    }
    return NULL;
}

static void test_threads(void **state) {
    (void)state;
    enum { THREADS = 4 };
    sf_context *ctx = test_context();
    sf_pixel_cache *cache = make_cache(ctx, 2);
    readers r;
    pthread_t threads[THREADS];
    atomic_init(&r.wrong, 0);
    for (size_t i = 0; i < VIEWS; i++) {
        r.views[i] = make_view(ctx, i);
        assert_ok(ctx, sf_view_move_out(r.views[i], cache));
    }
    for (int t = 0; t < THREADS; t++) assert_int_equal(pthread_create(&threads[t], NULL, read_views, &r), 0);
    for (int t = 0; t < THREADS; t++) pthread_join(threads[t], NULL);
    assert_int_equal(atomic_load(&r.wrong), 0);
    for (size_t i = 0; i < VIEWS; i++) sf_view_release(r.views[i]);
    sf_pixel_cache_release(cache);
    sf_context_destroy(&ctx);
}

static sf_scene *load_within(sf_context *ctx, int64_t memory) {
    sf_load_options options = sf_load_options_default();
    options.memory = memory;
    return test_load_scene(ctx, SCENE, &options);
}

static int in_file(sf_scene *scene) {
    sf_view *view = sf_scene_retain_id(scene, 1);
    int is = view->cache != NULL;
    sf_view_release(view);
    return is;
}

/* A scene is the same wherever its pixels are, and also where a camera was moved. */
static void test_scene_is_the_same(void **state) {
    (void)state;
    static float there[3 * PIXELS], here[3 * PIXELS];
    sf_context *ctx = test_context();
    sf_scene *memory = load_within(ctx, 0), *file = load_within(ctx, 20 * 3 * PIXELS);
    uint64_t a, b;
    assert_false(in_file(memory));
    assert_true(in_file(file));
    for (int round = 0; round < 2; round++) {
        assert_ok(ctx, sf_scene_fingerprint(memory, &a));
        assert_ok(ctx, sf_scene_fingerprint(file, &b));
        assert_true(a == b);
        for (size_t i = 0; i < 20; i++) {
            sf_view_info view = test_view_info(file, i);
            assert_ok(ctx, sf_scene_get_pixels(memory, view.id, there, NULL));
            assert_ok(ctx, sf_scene_get_pixels(file, view.id, here, NULL));
            assert_memory_equal(there, here, sizeof here);
        }
        sf_view_info view = test_view_info(file, 3);
        const double t[3] = {0, 0, 1};
        assert_ok(ctx, sf_scene_set_pose(memory, view.id, view.camera.R_cw, t));
        assert_ok(ctx, sf_scene_set_pose(file, view.id, view.camera.R_cw, t));
    }
    sf_scene_destroy(&memory);
    sf_scene_destroy(&file);
    sf_context_destroy(&ctx);
}

/* Folders. */

static char *named_before;

static void name_folder(const char *folder) {
    const char *named = getenv("TMPDIR");
    named_before = named ? strdup(named) : NULL;
    assert_int_equal(setenv("TMPDIR", folder, 1), 0);
}

static void name_as_before(void) {
    if (named_before)
        setenv("TMPDIR", named_before, 1);
    else
        unsetenv("TMPDIR");
    free(named_before);
}

/* The folder that TMPDIR names, and nothing is seen of the file there; another one where it cannot be. */
static void test_folders(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    name_folder(test_folder());
    int before = test_count_entries(test_folder());
    sf_pixel_cache *cache = make_cache(ctx, 2);
    int is_there = !strcmp(sf_pixel_cache_folder(cache), test_folder()); /* unless it is in memory itself */
    assert_true(is_there || !strcmp(sf_pixel_cache_folder(cache), "/var/tmp"));
    assert_int_equal(test_count_entries(test_folder()), before);
    sf_pixel_cache_release(cache);
    name_as_before();
    static const char *const others[] = {"/nowhere/at/all", "/dev/shm", "/proc"};
    for (int i = 0; i < 3; i++) {
        name_folder(others[i]);
        cache = make_cache(ctx, 2);
        assert_string_not_equal(sf_pixel_cache_folder(cache), others[i]);
        sf_pixel_cache_release(cache);
        name_as_before();
    }
    sf_context_destroy(&ctx);
}

static void limit_files(rlim_t bytes) {
    struct rlimit limit;
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &limit), 0);
    limit.rlim_cur = bytes < limit.rlim_max ? bytes : limit.rlim_max;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

/* No disk has the room: it is said before a picture is read, with all folders, in one line. */
static void test_no_room(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    sf_scene *scene;
    options.memory = 20 * 3 * PIXELS;
    name_folder("/nowhere");
    limit_files(1000);
    assert_status(ctx, sf_scene_load(ctx, SCENE, &options, &scene), SF_ERR_IO);
    limit_files(RLIM_INFINITY);
    name_as_before();
    assert_null(scene);
    assert_error_names(ctx, "sim:studio");
    assert_error_names(ctx, "/nowhere: No such file or directory; /var/tmp: ");
    assert_null(strchr(sf_last_error(ctx), '\n'));
    sf_context_destroy(&ctx);
}

/* The disk is full in the middle. */
static void test_full_disk(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_pixel_cache *cache;
    assert_ok(ctx, sf_pixel_cache_create(ctx, "test", BYTES, BYTES, 2, &cache));
    sf_view *first = make_view(ctx, 0), *second = make_view(ctx, 1);
    limit_files(BYTES + 100);
    assert_ok(ctx, sf_view_move_out(first, cache));
    assert_status(ctx, sf_view_move_out(second, cache), SF_ERR_IO);
    limit_files(RLIM_INFINITY);
    assert_error_names(ctx, "test: the pictures");
    assert_error_names(ctx, ": File too large");
    assert_non_null(second->rgb); /* it keeps what it has */
    assert_status(ctx, sf_pixel_cache_fault(cache), SF_ERR_IO);
    sf_view_release(first);
    sf_view_release(second);
    sf_pixel_cache_release(cache);
    sf_context_destroy(&ctx);
}

/* A disk that fails later: who opens a view learns it, and may try again. */
static void test_failing_disk(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    int fd = next_file();
    sf_pixel_cache *cache = make_cache(ctx, 2);
    sf_view *view = make_view(ctx, 1);
    sf_view_pixels p;
    struct stat st;
    assert_ok(ctx, sf_view_move_out(view, cache));
    assert_int_equal(fstat(fd, &st), 0);
    assert_true(S_ISREG(st.st_mode) && st.st_size >= 3 * PIXELS && st.st_nlink == 0);
    assert_int_equal(ftruncate(fd, 1000), 0);
    for (int i = 0; i < 3; i++) {
        assert_status(ctx, sf_view_open(view, &p), SF_ERR_IO);
        assert_error_names(ctx, "test: its pictures cannot be read again from ");
        assert_null(p.rgb);
    }
    assert_ok(ctx, sf_pixel_cache_open(cache, 0, 1000, &p.rgb)); /* what is left of it */
    assert_int_equal(p.rgb[999], shade(1, 999));
    sf_pixel_cache_close(cache, 0);
    sf_view_release(view);
    sf_pixel_cache_release(cache);
    sf_context_destroy(&ctx);
}

static void test_figures(void **state) {
    (void)state;
    assert_false(sf_pixels_exceed(1e12, 0)); /* a budget that is not known */
    assert_false(sf_pixels_exceed(50, 100));
    assert_true(sf_pixels_exceed(51, 100));
    assert_int_equal(sf_pixel_buffers(1e6, 1e6), 4);
    assert_int_equal(sf_pixel_buffers(1.6e9, 1e7), 10);
    assert_int_equal(sf_pixel_buffers(1e12, 1e6), 32);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_moved_out),         cmocka_unit_test(test_hidden),
        cmocka_unit_test(test_more_than_buffers), cmocka_unit_test(test_threads),
        cmocka_unit_test(test_scene_is_the_same), cmocka_unit_test(test_folders),
        cmocka_unit_test(test_no_room),           cmocka_unit_test(test_full_disk),
        cmocka_unit_test(test_failing_disk),      cmocka_unit_test(test_figures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
