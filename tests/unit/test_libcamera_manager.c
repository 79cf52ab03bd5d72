/* test_libcamera_manager.c - one manager a process; what a camera is called, and the devices behind it. */
#include "../testing.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include "base/context.h"
#include "capture/libcamera_device.h"
#include "capture/libcamera_manager.h"

/* 1. The manager */

/* A manager is the number of those that run. */
static int running;

static const char *start(void **manager) {
    running++;
    *manager = &running;
    return NULL;
}

static const char *refuse(void **manager) {
    (void)manager;
    return "refused";
}

static void stop(void *manager) { --*(int *)manager; }

static const sf_libcamera_maker maker = {start, stop}, refusing = {refuse, stop};

/* Of one context at a time, which may have it more than once. */
static void test_share(void **state) {
    (void)state;
    if (getenv("SPLATFIT_EMULATED"))
        test_skip("qemu-user gives each open of /proc/self/stat a file of its own: no lock on it holds");
    sf_context *ctx = test_context(), *other = test_context();
    void *manager = NULL, *same = NULL;
    running = 0;
    assert_null(sf_libcamera_share(ctx, &maker, &manager));
    assert_null(sf_libcamera_share(ctx, &maker, &same));
    assert_ptr_equal(manager, &running);
    assert_ptr_equal(same, manager);
    assert_int_equal(running, 1);
    test_assert_contains(sf_libcamera_share(other, &maker, &same), "another context", __FILE__, __LINE__);
    sf_libcamera_unshare(ctx);
    assert_int_equal(running, 1);
    test_assert_contains(sf_libcamera_share(other, &maker, &same), "another context", __FILE__, __LINE__);
    sf_libcamera_unshare(ctx);
    assert_int_equal(running, 0);
    assert_null(sf_libcamera_share(other, &maker, &same));
    assert_int_equal(running, 1);
    sf_libcamera_unshare(other);
    assert_int_equal(running, 0);
    sf_context_destroy(&other);
    sf_context_destroy(&ctx);
}

/* What fails leaves nothing behind that would hinder the next. */
static void test_share_fails(void **state) {
    (void)state;
    test_allocations memory = {0};
    const sf_allocator allocator = {test_count_alloc, test_count_free, &memory};
    sf_context *ctx;
    void *manager;
    running = 0;
    assert_int_equal(sf_context_create(&ctx, &(sf_context_options){.allocator = &allocator, .threads = 1}),
                     SF_OK);
    assert_string_equal(sf_libcamera_share(ctx, &refusing, &manager), "refused");
    long before = memory.live;
    memory.fail_at = memory.calls + 1;
    assert_string_equal(sf_libcamera_share(ctx, &maker, &manager), "out of memory");
    assert_int_equal(running, 0);
    memory.fail_at = 0;
    assert_null(sf_libcamera_share(ctx, &maker, &manager));
    assert_int_equal(running, 1);
    sf_libcamera_unshare(ctx);
    assert_int_equal(memory.live, before);
    sf_context_destroy(&ctx);
}

/* 2. The device */

static void test_fail(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const sf_libcamera_device device = {.ctx = ctx, .id = "/base/i2c@1"};
    assert_status(ctx, sf_libcamera_fail(&device, SF_ERR_IO, 0, "has no %s of %d", "size", 3), SF_ERR_IO);
    assert_string_equal(sf_last_error(ctx), "libcamera: /base/i2c@1: has no size of 3");
    for (int sign = -1; sign <= 1; sign += 2) {
        char expected[256] = "libcamera: /base/i2c@1: fails: ";
        strcat(expected, strerror(EBUSY));
        assert_status(ctx, sf_libcamera_fail(&device, SF_ERR_UNSUPPORTED, sign * EBUSY, "fails"),
                      SF_ERR_UNSUPPORTED);
        assert_string_equal(sf_last_error(ctx), expected);
    }
    sf_context_destroy(&ctx);
}

static int is_even(void *user, dev_t node) {
    ++*(int *)user;
    return minor(node) % 2 == 0;
}

/* What sysfs has of a node of video4linux. */
static void make_node(const char *name, const char *numbers) {
    const char *folder = test_path_in("video4linux", name);
    assert_int_equal(mkdir(folder, 0700), 0);
    char file[512];
    snprintf(file, sizeof file, "%s/dev", folder);
    if (numbers) test_write(file, numbers, strlen(numbers));
}

static int by_number(const void *a, const void *b) {
    const dev_t *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

static void test_find_nodes(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_libcamera_device device = {.ctx = ctx, .id = "played"};
    const char *folder = test_path("video4linux");
    int asked = 0;
    assert_ok(ctx, sf_libcamera_find_nodes(&device, folder, is_even, &asked)); /* not there */
    assert_true(asked == 0 && device.count == 0);
    assert_int_equal(mkdir(folder, 0700), 0);
    make_node("video0", "81:0\n");
    make_node("video1", "81:1\n");
    make_node("video2", "81:258\n");
    make_node("broken", "eighty\n");
    make_node("empty", NULL);
    assert_ok(ctx, sf_libcamera_find_nodes(&device, folder, is_even, &asked));
    assert_int_equal(asked, 3);
    assert_int_equal(device.count, 2);
    qsort(device.nodes, device.count, sizeof *device.nodes, by_number);
    assert_true(device.nodes[0] == makedev(81, 0) && device.nodes[1] == makedev(81, 258));
    sf_libcamera_forget(&device);
    assert_true(device.count == 0 && !device.nodes);
    sf_context_destroy(&ctx);
}

/* /dev/null is there, the other not. */
static void test_present(void **state) {
    (void)state;
    if (access("/sys/dev/char/1:3", F_OK)) test_skip("there is no /sys/dev/char");
    sf_context *ctx = test_context();
    sf_libcamera_device device = {.ctx = ctx, .id = "played"};
    assert_true(sf_libcamera_present(&device)); /* nothing is known */
    assert_ok(ctx, sf_libcamera_add_node(&device, makedev(1, 3)));
    assert_true(sf_libcamera_present(&device));
    assert_ok(ctx, sf_libcamera_add_node(&device, makedev(4095, 1000000)));
    assert_false(sf_libcamera_present(&device));
    sf_libcamera_forget(&device);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_share), cmocka_unit_test(test_share_fails),
                                       cmocka_unit_test(test_fail), cmocka_unit_test(test_find_nodes),
                                       cmocka_unit_test(test_present)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
