/* test_file.c - whole files in, whole files out. */
#include "testing.h"

#include "base/file.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LARGE = 200000 };

static void assert_content(const char *path, const void *data, size_t size) {
    size_t got;
    uint8_t *content = test_read(path, &got);
    assert_int_equal(got, size);
    assert_memory_equal(content, data, size);
    free(content);
}

/* A fresh folder in the scratch folder. */
static const char *make_folder(const char *name) {
    const char *path = test_path(name);
    assert_int_equal(mkdir(path, 0777), 0);
    return path;
}

static void test_read_gives_what_was_written(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path = test_path("plain");
    uint8_t *data;
    size_t size;
    test_write(path, "some\0text", 9);
    assert_ok(ctx, sf_read_file(ctx, path, 9, &data, &size));
    assert_int_equal(size, 9);
    assert_memory_equal(data, "some\0text", 10); /* and the 0 byte behind it */
    sf_free(ctx, data);
    test_write(path, "", 0);
    assert_ok(ctx, sf_read_file(ctx, path, 9, &data, &size));
    assert_int_equal(size, 0);
    assert_int_equal(data[0], 0);
    sf_free(ctx, data);
    sf_context_destroy(&ctx);
}

static void test_read_refuses(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *file = test_path("limited"), *fifo = test_path("fifo-in");
    uint8_t *data;
    size_t size;
    test_write(file, "0123456789", 10);
    assert_status(ctx, sf_read_file(ctx, file, 9, &data, &size), SF_ERR_FORMAT);
    assert_error_names(ctx, file);
    assert_error_names(ctx, "10 bytes");
    assert_null(data);
    assert_status(ctx, sf_read_file(ctx, test_path("absent"), 9, &data, &size), SF_ERR_IO);
    assert_error_names(ctx, "No such file");
    assert_status(ctx, sf_read_file(ctx, test_folder(), 9, &data, &size), SF_ERR_IO);
    assert_error_names(ctx, "folder");
    assert_int_equal(mkfifo(fifo, 0600), 0);
    assert_status(ctx, sf_read_file(ctx, fifo, 9, &data, &size), SF_ERR_IO); /* at once: no writer comes */
    assert_error_names(ctx, "not a regular file");
    sf_context_destroy(&ctx);
}

/* A file without content may have any size. */
static void test_read_refuses_what_no_memory_holds(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *file = test_path("sparse");
    uint8_t *data;
    size_t size;
    test_write(file, "", 0);
    if (sizeof(size_t) < 8 || truncate(file, (off_t)1 << 42)) {
        remove(file);
        sf_context_destroy(&ctx);
        test_skip("files of 4 TiB cannot be had here");
    }
    assert_status(ctx, sf_read_file(ctx, file, UINT64_MAX, &data, &size), SF_ERR_MEMORY);
    assert_error_names(ctx, "sparse: size: 4398046511104 bytes are more than the memory that is left");
    assert_null(data);
    sf_context_destroy(&ctx);
}

static void test_write_replaces_and_leaves_no_other_file(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *folder = make_folder("replace"), *path = test_path("replace/target");
    uint8_t *large = malloc(LARGE);
    assert_non_null(large);
    for (size_t i = 0; i < LARGE; i++) large[i] = (uint8_t)(i * 31);
    assert_ok(ctx, sf_write_file(ctx, path, "first", 5));
    assert_content(path, "first", 5);
    assert_ok(ctx, sf_write_file(ctx, path, large, LARGE));
    assert_content(path, large, LARGE);
    assert_ok(ctx, sf_write_file(ctx, path, NULL, 0));
    assert_content(path, "", 0);
    assert_int_equal(test_count_entries(folder), 1);
    free(large);
    sf_context_destroy(&ctx);
}

static void test_writer_joins_pieces(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path = test_path("pieces");
    uint8_t *expected = malloc(LARGE);
    assert_non_null(expected);
    for (size_t i = 0; i < LARGE; i++) expected[i] = (uint8_t)(i * 7 + i / 251);
    static const size_t pieces[] = {1, 65535, 1, 65536, 0, 60000, 8927};
    sf_writer w;
    size_t at = 0;
    assert_ok(ctx, sf_writer_open(&w, ctx, path));
    for (size_t i = 0; i < sizeof pieces / sizeof *pieces; at += pieces[i++])
        sf_writer_put(&w, expected + at, pieces[i]);
    assert_int_equal(at, LARGE);
    assert_false(test_exists(path)); /* not before it is whole */
    assert_ok(ctx, sf_writer_commit(&w));
    assert_content(path, expected, LARGE);
    free(expected);
    sf_context_destroy(&ctx);
}

static void test_writer_prints(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path = test_path("printed");
    sf_writer w;
    char long_word[5000];
    memset(long_word, 'a', sizeof long_word - 1);
    long_word[sizeof long_word - 1] = 0;
    assert_ok(ctx, sf_writer_open(&w, ctx, path));
    sf_writer_printf(&w, "%d %s\n", 12, "views");
    assert_ok(ctx, sf_writer_commit(&w));
    assert_content(path, "12 views\n", 9);
    assert_ok(ctx, sf_writer_open(&w, ctx, path));
    sf_writer_printf(&w, "%s", long_word); /* longer than a line may be: nothing is cut silently */
    assert_status(ctx, sf_writer_commit(&w), SF_ERR_IO);
    assert_content(path, "12 views\n", 9);
    sf_context_destroy(&ctx);
}

static void test_abandon_leaves_nothing(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *folder = make_folder("abandon"), *path = test_path("abandon/target");
    sf_writer w;
    assert_ok(ctx, sf_write_file(ctx, path, "old", 3));
    assert_ok(ctx, sf_writer_open(&w, ctx, path));
    sf_writer_put(&w, "new", 3);
    assert_int_equal(test_count_entries(folder), 2);
    sf_writer_abandon(&w);
    assert_int_equal(test_count_entries(folder), 1);
    assert_content(path, "old", 3);
    sf_context_destroy(&ctx);
}

static void test_failed_rename_leaves_nothing(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *folder = make_folder("rename"), *path = test_path("rename/target");
    sf_writer w;
    assert_ok(ctx, sf_writer_open(&w, ctx, path));
    assert_int_equal(mkdir(path, 0777), 0);
    assert_status(ctx, sf_writer_commit(&w), SF_ERR_IO);
    assert_error_names(ctx, path);
    assert_error_names(ctx, "renamed");
    assert_int_equal(test_count_entries(folder), 1);
    sf_context_destroy(&ctx);
}

static void test_write_refuses_what_cannot_be(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *folder = make_folder("refuse"), *file = test_path("refuse/file");
    char name[300];
    assert_ok(ctx, sf_write_file(ctx, file, "old", 3));
    assert_status(ctx, sf_write_file(ctx, folder, "x", 1), SF_ERR_IO);
    assert_error_names(ctx, "Is a directory");
    assert_status(ctx, sf_write_file(ctx, test_path("refuse/none/target"), "x", 1), SF_ERR_IO);
    assert_error_names(ctx, "refuse/none/target");
    assert_error_names(ctx, "No such file or directory");
    assert_status(ctx, sf_write_file(ctx, test_path("refuse/file/target"), "x", 1), SF_ERR_IO);
    assert_error_names(ctx, "Not a directory");
    assert_status(ctx, sf_write_file(ctx, "", "x", 1), SF_ERR_IO);
    memset(name, 'n', sizeof name - 1);
    name[sizeof name - 1] = 0;
    assert_status(ctx, sf_write_file(ctx, test_path(name), "x", 1), SF_ERR_IO);
    assert_int_equal(test_count_entries(folder), 1);
    assert_content(file, "old", 3);
    sf_context_destroy(&ctx);
}

static void test_longest_name(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    char name[256];
    memset(name, 'n', 255);
    name[255] = 0;
    assert_ok(ctx, sf_write_file(ctx, test_path(name), "whole", 5));
    assert_content(test_path(name), "whole", 5);
    sf_context_destroy(&ctx);
}

static void test_name_left_behind_is_stepped_over(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *folder = make_folder("stale"), *path = test_path("stale/target");
    sf_writer first, second;
    assert_ok(ctx, sf_writer_open(&first, ctx, path));
    assert_ok(ctx, sf_writer_open(&second, ctx, path));
    sf_writer_put(&first, "one", 3);
    sf_writer_put(&second, "two", 3);
    assert_ok(ctx, sf_writer_commit(&first));
    assert_content(path, "one", 3);
    assert_ok(ctx, sf_writer_commit(&second));
    assert_content(path, "two", 3);
    assert_int_equal(test_count_entries(folder), 1);
    sf_context_destroy(&ctx);
}

static void write_half(sf_context *ctx, const char *target) {
    static sf_writer w;
    if (sf_writer_open(&w, ctx, target)) _exit(1);
    sf_writer_put(&w, "x", 1);
}

/* A process that has `target` half written. */
static pid_t start_writer(const char *target) { return test_start(target); }

/* What the dead left behind goes with the next writing of that file; what lives, and what is another's,
 * stays.
 */
static void test_what_the_dead_left_goes(void **state) {
    (void)state;
    static const char *const others[] = {"leftovers/.target.tmp", "leftovers/.target.1.2.tmp.old",
                                         "leftovers/.targets.1.2.tmp", "leftovers/target.1.2.tmp",
                                         "leftovers/.target.x.2.tmp"};
    enum { OTHERS = sizeof others / sizeof *others };
    sf_context *ctx = test_context();
    const char *folder = make_folder("leftovers"), *path = test_path("leftovers/target");
    for (int i = 0; i < OTHERS; i++) test_write(test_path(others[i]), "x", 1);
    test_write(test_path("leftovers/.target.1.99.tmp"), "left", 4);
    test_kill(start_writer(path));
    pid_t living = start_writer(path), other = start_writer(test_path("leftovers/another"));
    test_kill(other);
    assert_int_equal(test_count_entries(folder), OTHERS + 2); /* of the living, and of another's */
    assert_ok(ctx, sf_write_file(ctx, path, "new", 3));
    assert_int_equal(test_count_entries(folder), OTHERS + 3);
    test_kill(living);
    assert_ok(ctx, sf_write_file(ctx, test_path("leftovers/another"), "new", 3));
    assert_ok(ctx, sf_write_file(ctx, path, "newer", 5));
    assert_int_equal(test_count_entries(folder), OTHERS + 2);
    assert_content(path, "newer", 5);
    sf_context_destroy(&ctx);
}

static void test_links_stay_links(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    struct stat st;
    make_folder("links");
    make_folder("links/there");
    const char *target = test_path("links/there/target"), *link = test_path("links/link");
    assert_int_equal(symlink("there/target", link), 0);
    assert_status(ctx, sf_write_file(ctx, link, "x", 1), SF_ERR_IO); /* leads nowhere */
    assert_error_names(ctx, link);
    assert_ok(ctx, sf_write_file(ctx, target, "old", 3));
    assert_ok(ctx, sf_write_file(ctx, link, "new", 3));
    assert_content(target, "new", 3);
    assert_int_equal(lstat(link, &st), 0);
    assert_true(S_ISLNK(st.st_mode));
    assert_int_equal(test_count_entries(test_path("links")), 2);
    assert_int_equal(test_count_entries(test_path("links/there")), 1);
    sf_context_destroy(&ctx);
}

static unsigned mode_of(const char *path) {
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    return st.st_mode & 0777;
}

static void test_modes(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path = test_path("mode");
    mode_t before = umask(027);
    assert_ok(ctx, sf_write_file(ctx, path, "x", 1));
    assert_int_equal(mode_of(path), 0640);
    assert_int_equal(chmod(path, 0600), 0);
    assert_ok(ctx, sf_write_file(ctx, path, "y", 1));
    assert_int_equal(mode_of(path), 0600);
    umask(before);
    sf_context_destroy(&ctx);
}

static void test_devices_are_written_directly(void **state) {
    (void)state;
    if (!test_exists("/dev/full")) test_skip("no /dev/full here");
    sf_context *ctx = test_context();
    struct stat st;
    assert_ok(ctx, sf_write_file(ctx, "/dev/null", "x", 1));
    assert_int_equal(stat("/dev/null", &st), 0);
    assert_true(S_ISCHR(st.st_mode));
    assert_status(ctx, sf_write_file(ctx, "/dev/full", "x", 1), SF_ERR_IO);
    assert_error_names(ctx, "/dev/full");
    assert_error_names(ctx, "No space left");
    assert_int_equal(stat("/dev/full", &st), 0);
    assert_true(S_ISCHR(st.st_mode));
    sf_context_destroy(&ctx);
}

typedef struct pipe_reader {
    const char *path;
    size_t got;
} pipe_reader;

static void *read_pipe(void *arg) {
    pipe_reader *r = arg;
    char data[4096];
    FILE *f = fopen(r->path, "rb");
    for (size_t n; f && (n = fread(data, 1, sizeof data, f)) > 0;) r->got += n;
    if (f) fclose(f);
    return NULL;
}

static void test_pipes_are_written_directly(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    struct stat st;
    pipe_reader r = {test_path("fifo-out"), 0};
    pthread_t thread;
    uint8_t *large = calloc(LARGE, 1);
    assert_non_null(large);
    assert_int_equal(mkfifo(r.path, 0600), 0);
    assert_int_equal(pthread_create(&thread, NULL, read_pipe, &r), 0);
    sf_status status = sf_write_file(ctx, r.path, large, LARGE);
    pthread_join(thread, NULL);
    assert_ok(ctx, status);
    assert_int_equal(r.got, LARGE);
    assert_int_equal(stat(r.path, &st), 0);
    assert_true(S_ISFIFO(st.st_mode));
    free(large);
    sf_context_destroy(&ctx);
}

static void test_dash_is_standard_output(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path = test_path("stdout");
    fflush(stdout);
    int kept = dup(STDOUT_FILENO);
    assert_true(kept >= 0);
    assert_non_null(freopen(path, "wb", stdout));
    sf_status first = sf_write_file(ctx, "-", "one ", 4);
    sf_status second = sf_write_file(ctx, "-", "two", 3); /* still open */
    assert_true(dup2(kept, STDOUT_FILENO) >= 0);
    close(kept);
    assert_ok(ctx, first);
    assert_ok(ctx, second);
    assert_content(path, "one two", 7);
    assert_false(test_exists("-"));
    sf_context_destroy(&ctx);
}

int main(int argc, char **argv) {
    test_begin(argc, argv, write_half);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_read_gives_what_was_written),
        cmocka_unit_test(test_read_refuses),
        cmocka_unit_test(test_read_refuses_what_no_memory_holds),
        cmocka_unit_test(test_write_replaces_and_leaves_no_other_file),
        cmocka_unit_test(test_writer_joins_pieces),
        cmocka_unit_test(test_writer_prints),
        cmocka_unit_test(test_abandon_leaves_nothing),
        cmocka_unit_test(test_failed_rename_leaves_nothing),
        cmocka_unit_test(test_write_refuses_what_cannot_be),
        cmocka_unit_test(test_longest_name),
        cmocka_unit_test(test_name_left_behind_is_stepped_over),
        cmocka_unit_test(test_what_the_dead_left_goes),
        cmocka_unit_test(test_links_stay_links),
        cmocka_unit_test(test_modes),
        cmocka_unit_test(test_devices_are_written_directly),
        cmocka_unit_test(test_pipes_are_written_directly),
        cmocka_unit_test(test_dash_is_standard_output),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
