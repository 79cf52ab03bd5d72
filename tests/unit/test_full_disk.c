/* test_full_disk.c - every call that writes a file fails in turn: what stood there still stands. */
/* link: -Wl,--wrap=open,--wrap=open64,--wrap=write,--wrap=fsync,--wrap=rename,--wrap=close */
#include "testing.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

/* The calls that the library makes pass through here. Which one fails, how, and what has happened so far. */

enum call { CALL_OPEN, CALL_WRITE, CALL_FSYNC, CALL_RENAME, CALL_CLOSE, CALLS };
static const char *const call_names[CALLS] = {"open", "write", "fsync", "rename", "close"};

static struct faults {
    enum call which;
    int at;            /* its at-th call fails, from 1; 0: none does */
    int error;         /* with this errno */
    size_t most;       /* bytes that one write takes; 0: all */
    int interruptions; /* every second write is interrupted first */
    int count[CALLS];
    int failed, renamed;
    int failed_before_rename;
} faults;

static int is_failing(enum call call) {
    if (++faults.count[call] != faults.at || call != faults.which) return 0;
    faults.failed = 1;
    faults.failed_before_rename = !faults.renamed;
    errno = faults.error;
    return 1;
}

int __real_open(const char *path, int flags, ...);
ssize_t __real_write(int fd, const void *data, size_t size);
int __real_fsync(int fd);
int __real_rename(const char *from, const char *to);
int __real_close(int fd);

int __wrap_open(const char *path, int flags, ...);
int __wrap_open64(const char *path, int flags, ...);
ssize_t __wrap_write(int fd, const void *data, size_t size);
int __wrap_fsync(int fd);
int __wrap_rename(const char *from, const char *to);
int __wrap_close(int fd);

static int do_open(const char *path, int flags, va_list arguments) {
    mode_t mode = flags & O_CREAT ? va_arg(arguments, mode_t) : 0;
    return is_failing(CALL_OPEN) ? -1 : __real_open(path, flags, mode);
}

int __wrap_open(const char *path, int flags, ...) {
    va_list arguments;
    va_start(arguments, flags);
    int fd = do_open(path, flags, arguments);
    va_end(arguments);
    return fd;
}

/* What open is called where off_t is made to have 64 bits. */
int __wrap_open64(const char *path, int flags, ...) {
    va_list arguments;
    va_start(arguments, flags);
    int fd = do_open(path, flags, arguments);
    va_end(arguments);
    return fd;
}

ssize_t __wrap_write(int fd, const void *data, size_t size) {
    if (is_failing(CALL_WRITE)) return -1;
    if (faults.interruptions && faults.count[CALL_WRITE] % 2) {
        errno = EINTR;
        return -1;
    }
    return __real_write(fd, data, faults.most && size > faults.most ? faults.most : size);
}

int __wrap_fsync(int fd) { return is_failing(CALL_FSYNC) ? -1 : __real_fsync(fd); }

int __wrap_rename(const char *from, const char *to) {
    if (is_failing(CALL_RENAME)) return -1;
    int result = __real_rename(from, to);
    if (!result) faults.renamed = 1;
    return result;
}

/* A close that fails has closed all the same. */
int __wrap_close(int fd) {
    int failing = is_failing(CALL_CLOSE), result = __real_close(fd);
    if (failing) errno = faults.error;
    return failing ? -1 : result;
}

/* What writes a file. */

typedef struct subject {
    sf_context *ctx;
    sf_model *model;
    sf_scene *scene;
} subject;

typedef sf_status (*write_fn)(const subject *s, const char *path);

static sf_status write_model(const subject *s, const char *path) { return sf_model_save(s->model, path); }
static sf_status write_spz(const subject *s, const char *path) {
    sf_model_file_options options = sf_model_file_options_default();
    options.format = SF_MODEL_SPZ;
    return sf_model_save_as(s->model, path, &options);
}
static sf_status write_splat(const subject *s, const char *path) {
    sf_model_file_options options = sf_model_file_options_default();
    options.format = SF_MODEL_SPLAT;
    return sf_model_save_as(s->model, path, &options);
}
static sf_status write_cameras(const subject *s, const char *path) {
    return sf_scene_save_cameras(s->scene, path, 0);
}
static sf_status write_nothing(const subject *s, const char *path) {
    return sf_write_file(s->ctx, path, "", 0);
}

static sf_status write_bytes(const subject *s, const char *path) {
    static uint8_t data[200000]; /* more than any buffer */
    for (size_t i = 0; i < sizeof data; i++) data[i] = (uint8_t)(i * i >> 8);
    return sf_write_file(s->ctx, path, data, sizeof data);
}

static sf_status write_unsynced(const subject *s, const char *path) {
    return sf_write_file_unsynced(s->ctx, path, "a picture", 9);
}

static sf_status write_picture(const subject *s, const char *path) {
    float rgb[3 * 6 * 5];
    for (int i = 0; i < 3 * 6 * 5; i++) rgb[i] = (float)(i % 7) / 6;
    return sf_write_png(s->ctx, path, 6, 5, rgb);
}

static subject make_subject(void) {
    static const uint8_t pixels[12];
    const sf_camera camera = {2, 2, 1, 1, 1, 1, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    subject s = {.ctx = test_context()};
    assert_ok(s.ctx, sf_model_create(s.ctx, 3, 0, &s.model));
    assert_ok(s.ctx, sf_scene_create(s.ctx, &s.scene));
    sf_pixels p = {.rgb = pixels, .stride = 6};
    assert_ok(s.ctx, sf_scene_add_view(s.scene, "a.png", &camera, &p, SF_SPLIT_TRAIN, NULL));
    return s;
}

static void free_subject(subject *s) {
    sf_scene_destroy(&s->scene);
    sf_model_destroy(&s->model);
    sf_context_destroy(&s->ctx);
}

/* One write with one fault. */

static const char old_text[] = "what stood here before";

typedef struct content {
    uint8_t *data;
    size_t size;
} content;

static void assert_content(const char *path, const void *data, size_t size) {
    content c;
    c.data = test_read(path, &c.size);
    assert_int_equal(c.size, size);
    assert_memory_equal(c.data, data, size);
    free(c.data);
}

static content write_undisturbed(const subject *s, write_fn write_it) {
    content c;
    const char *path = test_path("undisturbed");
    faults = (struct faults){0};
    assert_ok(s->ctx, write_it(s, path));
    c.data = test_read(path, &c.size);
    remove(path);
    return c;
}

/* Success only where all is in place; otherwise the path is named and all is as before. Beyond the rename
 * nothing may fail any more: the new file has replaced the old. */
static void check_outcome(const subject *s, sf_status status, const char *path, int existed,
                          const content *whole) {
    int failing = faults.failed_before_rename;
    faults = (struct faults){0};
    if (!failing) {
        assert_status(s->ctx, status, SF_OK);
        assert_content(path, whole->data, whole->size);
        assert_int_equal(test_count_entries(test_folder()), 1);
        return;
    }
    assert_status(s->ctx, status, SF_ERR_IO);
    assert_error_names(s->ctx, path);
    assert_error_names(s->ctx, strerror(ENOSPC));
    assert_int_equal(test_count_entries(test_folder()), existed);
    if (existed) assert_content(path, old_text, sizeof old_text);
}

static int open_files(void) { return test_count_entries("/proc/self/fd"); }

/* Lets the at-th call fail; returns whether there was one. */
static int write_with_fault(const subject *s, write_fn write_it, struct faults fault, int existed,
                            const content *whole) {
    const char *path = test_path("target");
    remove(path);
    if (existed) test_write(path, old_text, sizeof old_text);
    int files = open_files();
    assert_status(s->ctx, sf_model_load(s->ctx, "", &(sf_model *){NULL}), SF_ERR_IO); /* another message */
    faults = fault;
    sf_status status = write_it(s, path);
    int failed = faults.failed;
    check_outcome(s, status, path, existed, whole);
    assert_int_equal(open_files(), files);
    return failed;
}

static void check_every_call(write_fn write_it, size_t most) {
    subject s = make_subject();
    content whole = write_undisturbed(&s, write_it);
    for (int existed = 0; existed < 2; existed++)
        for (int call = 0; call < CALLS; call++) {
            struct faults fault = {.which = (enum call)call, .error = ENOSPC, .most = most};
            do fault.at++;
            while (write_with_fault(&s, write_it, fault, existed, &whole));
            if (fault.at == 1 && whole.size) fail_msg("%s was never called", call_names[call]);
        }
    free(whole.data);
    free_subject(&s);
}

/* Writes that take a few bytes at a time, and are interrupted in between, lose nothing. */
static void check_short_writes(write_fn write_it, size_t most) {
    subject s = make_subject();
    content whole = write_undisturbed(&s, write_it);
    struct faults fault = {.most = most, .interruptions = 1};
    assert_false(write_with_fault(&s, write_it, fault, 1, &whole));
    free(whole.data);
    free_subject(&s);
}

static void test_model(void **state) {
    (void)state;
    check_every_call(write_model, 0);
    check_every_call(write_model, 50);
    check_short_writes(write_model, 7);
}

static void test_spz(void **state) {
    (void)state;
    check_every_call(write_spz, 0);
    check_every_call(write_spz, 20);
    check_short_writes(write_spz, 7);
}

static void test_splat(void **state) {
    (void)state;
    check_every_call(write_splat, 0);
    check_every_call(write_splat, 20);
}

static void test_file(void **state) {
    (void)state;
    check_every_call(write_bytes, 0);
    check_every_call(write_bytes, 30000);
    check_short_writes(write_bytes, 3001);
}

/* One that is left to the operating system is not synced, but as whole as the others. */
static void test_unsynced(void **state) {
    (void)state;
    subject s = make_subject();
    content whole = write_undisturbed(&s, write_unsynced);
    assert_int_equal(faults.count[CALL_FSYNC], 0);
    assert_int_equal(faults.count[CALL_RENAME], 1);
    for (int call = 0; call < CALLS; call++) {
        struct faults fault = {.which = (enum call)call, .at = 1, .error = ENOSPC};
        assert_int_equal(write_with_fault(&s, write_unsynced, fault, 1, &whole), call != CALL_FSYNC);
    }
    free(whole.data);
    free_subject(&s);
}

static void test_empty_file(void **state) {
    (void)state;
    check_every_call(write_nothing, 0);
}

static void test_picture(void **state) {
    (void)state;
    check_every_call(write_picture, 0);
    check_every_call(write_picture, 20);
    check_short_writes(write_picture, 1);
}

static void test_cameras(void **state) {
    (void)state;
    check_every_call(write_cameras, 0);
    check_every_call(write_cameras, 50);
    check_short_writes(write_cameras, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_model),   cmocka_unit_test(test_spz),      cmocka_unit_test(test_splat),
        cmocka_unit_test(test_file),    cmocka_unit_test(test_unsynced), cmocka_unit_test(test_empty_file),
        cmocka_unit_test(test_picture), cmocka_unit_test(test_cameras),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
