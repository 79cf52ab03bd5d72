/* test_libcamera_queue.c - frames that wait to be taken: their order, gaps, deadlines, a camera that goes;
 * the memory of buffers. */
#include "../testing.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "capture/libcamera_buffers.h"
#include "capture/libcamera_queue.h"

enum { BUFFERS = 4 };

static int64_t in_ms(int ms) { return sf_clock_ns() + (int64_t)ms * 1000000; }

static void put(sf_libcamera_queue *queue, size_t buffer, uint32_t sequence) {
    sf_libcamera_filled filled = {.buffer = buffer, .driver_sequence = sequence};
    sf_libcamera_queue_put(queue, &filled);
}

/* Takes a frame that must be there. */
static void assert_takes(sf_libcamera_queue *queue, size_t buffer, uint64_t sequence, int late) {
    sf_libcamera_filled filled;
    uint64_t dropped = 0;
    assert_int_equal(sf_libcamera_queue_take(queue, in_ms(0), &filled, &dropped), SF_OK);
    assert_int_equal(filled.buffer, buffer);
    assert_int_equal(filled.sequence, sequence);
    assert_int_equal(filled.late, late);
    assert_int_equal(dropped, 0);
}

/* 1. The queue */

/* A batch that comes in another order than that of its pictures. */
static void test_order(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_libcamera_queue queue;
    assert_ok(ctx, sf_libcamera_queue_open(ctx, BUFFERS, &queue));
    assert_false(sf_libcamera_queue_has(&queue));
    put(&queue, 2, 7);
    assert_takes(&queue, 2, 7, 0); /* the first is where it begins */
    put(&queue, 0, 9);
    put(&queue, 3, 10);
    put(&queue, 1, 8);
    assert_true(sf_libcamera_queue_has(&queue));
    assert_takes(&queue, 1, 8, 0);
    assert_takes(&queue, 0, 9, 0);
    assert_takes(&queue, 3, 10, 0);
    assert_false(sf_libcamera_queue_has(&queue));
    put(&queue, 2, 9);
    assert_takes(&queue, 2, 10, 1);
    sf_libcamera_queue_close(&queue);
    sf_libcamera_queue_close(&queue); /* as one that was never opened */
    sf_context_destroy(&ctx);
}

/* What lacks is awaited for a moment, then counted. */
static void test_gap(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_libcamera_queue queue;
    sf_libcamera_filled filled;
    uint64_t dropped = 0;
    assert_ok(ctx, sf_libcamera_queue_open(ctx, BUFFERS, &queue));
    put(&queue, 0, 0);
    assert_takes(&queue, 0, 0, 0);
    put(&queue, 1, 4);
    int64_t began = sf_clock_ns();
    assert_int_equal(sf_libcamera_queue_take(&queue, in_ms(1000), &filled, &dropped), SF_OK);
    assert_true(sf_clock_ns() - began >= 4000000);
    assert_int_equal(filled.driver_sequence, 4);
    assert_int_equal(dropped, 3);
    sf_libcamera_queue_close(&queue);
    sf_context_destroy(&ctx);
}

static void test_deadline(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_libcamera_queue queue;
    sf_libcamera_filled filled;
    uint64_t dropped = 0;
    assert_ok(ctx, sf_libcamera_queue_open(ctx, BUFFERS, &queue));
    int64_t deadline = in_ms(20);
    assert_int_equal(sf_libcamera_queue_take(&queue, deadline, &filled, &dropped), SF_ERR_TIMEOUT);
    assert_true(sf_clock_ns() >= deadline);
    sf_libcamera_queue_close(&queue);
    sf_context_destroy(&ctx);
}

/* What is there is given first; then no deadline is waited for. */
static void test_gone(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_libcamera_queue queue;
    sf_libcamera_filled filled;
    uint64_t dropped = 0;
    assert_ok(ctx, sf_libcamera_queue_open(ctx, BUFFERS, &queue));
    put(&queue, 0, 3);
    sf_libcamera_queue_lose(&queue);
    assert_takes(&queue, 0, 3, 0);
    int64_t deadline = in_ms(60000);
    assert_int_equal(sf_libcamera_queue_take(&queue, deadline, &filled, &dropped), SF_ERR_IO);
    sf_libcamera_queue_close(&queue);

    /* All buffers came back without a frame; all but one mean nothing yet. */
    assert_ok(ctx, sf_libcamera_queue_open(ctx, BUFFERS, &queue));
    for (int i = 1; i < BUFFERS; i++) sf_libcamera_queue_cancel(&queue);
    assert_int_equal(sf_libcamera_queue_take(&queue, in_ms(1), &filled, &dropped), SF_ERR_TIMEOUT);
    sf_libcamera_queue_cancel(&queue);
    assert_int_equal(sf_libcamera_queue_take(&queue, deadline, &filled, &dropped), SF_ERR_IO);
    assert_true(sf_clock_ns() < deadline);
    sf_libcamera_queue_close(&queue);
    sf_context_destroy(&ctx);
}

/* A thread that fills buffers as they become free, two at a time and the younger first, and leaves every
 * eleventh number out. */
enum { FRAMES = 600 };

typedef struct camera {
    sf_libcamera_queue queue;
    atomic_int taken;
    int sent, left_out;
} camera;

static void *fill_all(void *user) {
    camera *c = user;
    uint32_t number = 0;
    while (c->sent + 2 <= FRAMES) {
        while (c->sent + 2 - atomic_load(&c->taken) > BUFFERS) test_pause_ms(0);
        uint32_t first = number++, second = number++;
        if (first % 11 == 0) {
            c->left_out += first > 0;
            first = second;
            second = number++;
        }
        put(&c->queue, (size_t)(c->sent + 1) % BUFFERS, second);
        put(&c->queue, (size_t)c->sent % BUFFERS, first);
        c->sent += 2;
    }
    sf_libcamera_queue_lose(&c->queue);
    return NULL;
}

/* Each number from the first one on is given, or counted as dropped: left out, or late. */
static void test_thread(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    static camera c;
    pthread_t thread;
    sf_libcamera_filled filled;
    uint64_t dropped = 0, given = 0, late = 0, last = 0, first = 0;
    sf_status status;
    assert_ok(ctx, sf_libcamera_queue_open(ctx, BUFFERS, &c.queue));
    assert_int_equal(pthread_create(&thread, NULL, fill_all, &c), 0);
    while ((status = sf_libcamera_queue_take(&c.queue, in_ms(10000), &filled, &dropped)) == SF_OK) {
        if (filled.late) {
            late += filled.driver_sequence > first;
        } else {
            if (!given) first = filled.sequence;
            if (given) assert_true(filled.sequence > last);
            last = filled.sequence;
            given++;
        }
        atomic_fetch_add(&c.taken, 1);
    }
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_int_equal(status, SF_ERR_IO);
    assert_int_equal(c.sent, FRAMES);
    assert_int_equal(given + dropped, last - first + 1);
    assert_true(c.left_out > 0);
    assert_int_equal(dropped, late + (uint64_t)c.left_out);
    sf_libcamera_queue_close(&c.queue);
    sf_context_destroy(&ctx);
}

/* 2. Memory */

static const sf_libcamera_picture nv12 = {.format = SF_PIXEL_NV12, .width = 6, .height = 4, .stride = 8};
enum { LUMA = 8 * 4, CHROMA = 8 * 2, OFFSET = 16 };

/* A file whose bytes are their offsets. */
static int open_memory(const char *name, size_t bytes, int flags) {
    uint8_t content[256];
    for (size_t i = 0; i < sizeof content; i++) content[i] = (uint8_t)i;
    test_write(test_path(name), content, bytes);
    int fd = open(test_path(name), flags);
    assert_true(fd >= 0);
    return fd;
}

static void test_map(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const sf_libcamera_device device = {.ctx = ctx, .id = "played"};
    sf_libcamera_buffer buffer = {.dmabuf = -1};
    int fd = open_memory("shared", OFFSET + LUMA + CHROMA, O_RDONLY);
    int other = open_memory("other", CHROMA, O_RDONLY);

    /* Planes of one descriptor: it is mapped once. */
    const sf_libcamera_plane together[] = {{fd, OFFSET, LUMA}, {fd, OFFSET + LUMA, CHROMA}};
    assert_ok(ctx, sf_libcamera_map(&device, &nv12, together, 2, &buffer));
    assert_int_equal(buffer.dmabuf, fd);
    assert_int_equal(buffer.plane[0][3], OFFSET + 3);
    assert_int_equal(buffer.plane[1][5], OFFSET + LUMA + 5);
    assert_ptr_equal(buffer.plane[1], buffer.plane[0] + LUMA);
    assert_int_equal(buffer.mapping[0].bytes, OFFSET + LUMA + CHROMA);
    assert_null(buffer.mapping[1].memory);
    assert_true(buffer.length[0] == LUMA && buffer.length[1] == CHROMA && !buffer.plane[2]);
    sf_libcamera_unmap(&buffer);
    assert_true(!buffer.plane[0] && !buffer.mapping[0].memory);

    const sf_libcamera_plane apart[] = {{fd, 0, LUMA}, {other, 0, CHROMA}};
    assert_ok(ctx, sf_libcamera_map(&device, &nv12, apart, 2, &buffer));
    assert_true(buffer.plane[0][3] == 3 && buffer.plane[1][5] == 5);
    assert_non_null(buffer.mapping[1].memory);
    sf_libcamera_unmap(&buffer);
    close(other);
    close(fd);
    sf_context_destroy(&ctx);
}

static void test_map_refused(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const sf_libcamera_device device = {.ctx = ctx, .id = "played"};
    int fd = open_memory("short", LUMA + CHROMA, O_RDONLY);
    int sealed = open_memory("sealed", LUMA + CHROMA, O_WRONLY);
    const struct {
        sf_libcamera_plane planes[2];
        size_t count;
        sf_status status;
        const char *part;
    } cases[] = {
        {{{fd, 0, LUMA}}, 1, SF_ERR_UNSUPPORTED, "libcamera: played: has fewer planes"},
        {{{fd, 0, LUMA - 1}, {fd, LUMA, CHROMA}}, 2, SF_ERR_UNSUPPORTED, "shorter than a picture"},
        {{{fd, 0, LUMA}, {fd, LUMA + 1, CHROMA}}, 2, SF_ERR_UNSUPPORTED, "shorter than a picture"},
        {{{fd, 0, LUMA}, {fd, UINT32_MAX, CHROMA}}, 2, SF_ERR_UNSUPPORTED, "shorter than a picture"},
        {{{-1, 0, LUMA}, {fd, LUMA, CHROMA}}, 2, SF_ERR_UNSUPPORTED, "shorter than a picture"},
        {{{sealed, 0, LUMA}, {fd, LUMA, CHROMA}}, 2, SF_ERR_IO, "cannot be mapped: "},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_libcamera_buffer buffer = {.dmabuf = -1};
        assert_status(ctx, sf_libcamera_map(&device, &nv12, cases[i].planes, cases[i].count, &buffer),
                      cases[i].status);
        assert_error_names(ctx, cases[i].part);
        sf_libcamera_unmap(&buffer);
    }
    assert_error_names(ctx, strerror(EACCES));
    close(sealed);
    close(fd);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_order),      cmocka_unit_test(test_gap),
                                       cmocka_unit_test(test_deadline),   cmocka_unit_test(test_gone),
                                       cmocka_unit_test(test_thread),     cmocka_unit_test(test_map),
                                       cmocka_unit_test(test_map_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
