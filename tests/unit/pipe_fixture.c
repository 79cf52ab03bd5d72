/* pipe_fixture.c - see the header. */
#include "pipe_fixture.h"

#include <stdio.h>
#include <string.h>
#include <sys/time.h>

buffer pipe_file; /* of the test that runs */

void pipe_add(const void *data, size_t size) {
    assert_true(size <= sizeof pipe_file.data - pipe_file.size);
    memcpy(pipe_file.data + pipe_file.size, data, size);
    pipe_file.size += size;
}

void pipe_add_text(const char *text) { pipe_add(text, strlen(text)); }

uint8_t pipe_pixel(uint64_t number, size_t i) { return (uint8_t)(31 * number + 7 * i + i / 251); }

void pipe_add_pixels(uint64_t number, size_t size) {
    assert_true(size <= sizeof pipe_file.data - pipe_file.size);
    for (size_t i = 0; i < size; i++) pipe_file.data[pipe_file.size++] = pipe_pixel(number, i);
}

const char *pipe_put_file(const char *options) {
    static char name[600];
    const char *path = test_path("frames");
    test_write(path, pipe_file.data, pipe_file.size);
    snprintf(name, sizeof name, "pipe:%s%s", path, options);
    return name;
}

sf_source *pipe_open_source(sf_context *ctx, const char *name) {
    sf_source *source;
    assert_ok(ctx, sf_source_open(ctx, name, &source));
    return source;
}

void pipe_assert_pixels(const sf_frame *frame, uint64_t number) {
    size_t at = 0, bytes, rows;
    for (int i = 0; i < SF_FRAME_PLANES; i++) {
        sf_pixel_plane(frame->format, frame->width, frame->height, i, &bytes, &rows);
        assert_true(!rows == !frame->plane[i]);
        for (size_t y = 0; y < rows; y++)
            for (size_t x = 0; x < bytes; x++, at++)
                assert_int_equal(frame->plane[i][y * frame->stride[i] + x], pipe_pixel(number, at));
    }
    assert_true(at > 0);
}

void pipe_assert_frames(sf_context *ctx, sf_source *source, uint64_t count, double fps) {
    sf_frame frame;
    for (uint64_t i = 0; i < count; i++) {
        assert_ok(ctx, sf_source_next(source, -1, &frame));
        assert_int_equal(frame.sequence, i);
        assert_true(llabs(frame.time_ns - (int64_t)((double)i * 1e9 / fps)) <= 1);
        assert_int_equal(frame.dmabuf, -1);
        assert_false(frame.has_camera);
        pipe_assert_pixels(&frame, i);
        sf_source_release(source, &frame);
    }
    assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_END);
    assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_END);
}

sf_source_counts pipe_counts_of(const sf_source *source) {
    sf_source_counts counts;
    sf_source_count(source, &counts);
    return counts;
}
