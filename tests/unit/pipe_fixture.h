/* pipe_fixture.h - streams of frames by pipes and files. */
#ifndef TESTS_UNIT_PIPE_FIXTURE_H
#define TESTS_UNIT_PIPE_FIXTURE_H

#include "testing.h"

#include <sys/time.h>

/* A file in the making. */
typedef struct buffer {
    uint8_t data[1 << 17];
    size_t size;
} buffer;

extern buffer pipe_file; /* of the test that runs */

void pipe_add(const void *data, size_t size);
void pipe_add_text(const char *text);

/* Byte i of frame `number`. */
uint8_t pipe_pixel(uint64_t number, size_t i);
void pipe_add_pixels(uint64_t number, size_t size);

/* The name of a source that reads the file. */
const char *pipe_put_file(const char *options);
sf_source *pipe_open_source(sf_context *ctx, const char *name);

/* All bytes of the frame's planes, close together, are those of frame `number`. */
void pipe_assert_pixels(const sf_frame *frame, uint64_t number);

/* Takes frames 0 .. count-1, then the end. */
void pipe_assert_frames(sf_context *ctx, sf_source *source, uint64_t count, double fps);
sf_source_counts pipe_counts_of(const sf_source *source);

#endif
