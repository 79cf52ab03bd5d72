/* detect.c - the tags of a board in grey pictures and in frames. */
#include <math.h>
#include <string.h>

#include "../base/context.h"
#include "tags.h"
#include "view.h"

enum { MOST_SIDE = 65535, MOST_PIXELS = 1 << 28 };

struct sf_detector {
    sf_context *ctx;
    sf_tags *tags;
    sf_board_tag *board; /* by id */
    size_t board_count;
    sf_board_corner *corners; /* 4 for each tag of the board */
    uint8_t *grey;            /* of a frame */
    float *rgb;               /* of a frame that is not read as it is */
    size_t grey_capacity, rgb_capacity;
};

sf_status sf_detector_create(sf_context *ctx, const sf_board *board, int decimate, sf_detector **detector) {
    *detector = NULL;
    if (decimate < 1 || decimate > 8)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "detector: decimate: %d is not in 1..8", decimate);
    if (board->count < 1 || 4 * board->count > SF_CORNERS_MOST)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "detector: board %s: %zu tags are not in 1..%d", board->name,
                       board->count, SF_CORNERS_MOST / 4);
    sf_detector *d = sf_calloc(ctx, 1, sizeof *d);
    if (!d) return SF_ERR_MEMORY;
    d->ctx = ctx;
    d->board = sf_alloc(ctx, board->count, sizeof *d->board);
    d->corners = sf_alloc(ctx, board->count, 4 * sizeof *d->corners);
    sf_status status = d->board && d->corners ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        d->board_count = board->count;
        memcpy(d->board, board->tags, board->count * sizeof *d->board);
        status = sf_tags_create(ctx, board->family, decimate, &d->tags);
    }
    if (status)
        sf_detector_destroy(&d);
    else
        *detector = d;
    return status;
}

void sf_detector_destroy(sf_detector **detector) {
    sf_detector *d = *detector;
    if (!d) return;
    sf_tags_destroy(&d->tags);
    sf_free(d->ctx, d->board);
    sf_free(d->ctx, d->corners);
    sf_free(d->ctx, d->grey);
    sf_free(d->ctx, d->rgb);
    sf_free(d->ctx, d);
    *detector = NULL;
}

static const sf_board_tag *find_tag(const sf_detector *d, int id) {
    for (size_t i = 0; i < d->board_count; i++)
        if (d->board[i].id == id) return &d->board[i];
    return NULL;
}

static int is_finite(const sf_tag_seen *seen) {
    for (int i = 0; i < 4; i++)
        if (!isfinite(seen->corner[i][0]) || !isfinite(seen->corner[i][1])) return 0;
    return 1;
}

/* Of two tags of one id, none can be trusted. */
static int is_alone(const sf_tag_seen *seen, size_t at, size_t count) {
    return !(at > 0 && seen[at - 1].id == seen[at].id) && !(at + 1 < count && seen[at + 1].id == seen[at].id);
}

static size_t take_tag(const sf_board_tag *tag, const sf_tag_seen *seen, sf_board_corner *corners) {
    for (int i = 0; i < 4; i++)
        corners[i] = (sf_board_corner){.id = tag->id,
                                       .corner = i,
                                       .board = {tag->corner[i][0], tag->corner[i][1]},
                                       .pixel = {seen->corner[i][0], seen->corner[i][1]}};
    return 4;
}

sf_status sf_detector_find(sf_detector *d, const uint8_t *grey, size_t stride, int32_t width, int32_t height,
                           const sf_board_corner **corners, size_t *count) {
    const sf_tag_seen *seen;
    size_t seen_count;
    *corners = d->corners;
    *count = 0;
    if (width < 1 || height < 1 || width > MOST_SIDE || height > MOST_SIDE || stride < (size_t)width ||
        (int64_t)width * height > MOST_PIXELS)
        return sf_fail(d->ctx, SF_ERR_ARGUMENT, "detector: a picture of %d x %d px, rows %zu bytes apart",
                       (int)width, (int)height, stride);
    sf_status status = sf_tags_find(d->tags, grey, stride, width, height, &seen, &seen_count);
    for (size_t i = 0; !status && i < seen_count; i++) {
        const sf_board_tag *tag = find_tag(d, seen[i].id);
        if (tag && is_alone(seen, i, seen_count) && is_finite(&seen[i]))
            *count += take_tag(tag, &seen[i], d->corners + *count);
    }
    return status;
}

/* Grey of frames. */

/* Every `step`-th byte of rows. */
static void take_bytes(const uint8_t *from, size_t stride, size_t step, const sf_frame *frame,
                       uint8_t *grey) {
    size_t width = (size_t)frame->width;
    for (size_t y = 0; y < (size_t)frame->height; y++)
        for (size_t x = 0; x < width; x++) grey[y * width + x] = from[y * stride + x * step];
}

static void mix_bytes(const sf_frame *frame, uint8_t *grey) {
    size_t width = (size_t)frame->width;
    for (size_t y = 0; y < (size_t)frame->height; y++) {
        const uint8_t *row = frame->plane[0] + y * frame->stride[0];
        for (size_t x = 0; x < width; x++) /* green is in the middle of either order */
            grey[y * width + x] = (uint8_t)((row[3 * x] + 2 * row[3 * x + 1] + row[3 * x + 2] + 2) / 4);
    }
}

static uint8_t to_byte(float value) {
    return value > 0 ? value < 1 ? (uint8_t)(255 * value + 0.5f) : 255 : 0;
}

static sf_status convert(sf_detector *d, const sf_frame *frame) {
    size_t pixels = (size_t)frame->width * (size_t)frame->height;
    sf_status status = sf_grow(d->ctx, &d->rgb, &d->rgb_capacity, 0, 3 * pixels, sizeof *d->rgb);
    if (status) return status;
    float *planes[3] = {d->rgb, d->rgb + pixels, d->rgb + 2 * pixels};
    status = sf_frame_convert(d->ctx, frame, planes, (size_t)frame->width);
    for (size_t i = 0; !status && i < pixels; i++)
        d->grey[i] = to_byte((planes[0][i] + 2 * planes[1][i] + planes[2][i]) / 4);
    return status;
}

/* Tags are black on white in the range of any camera: Y is taken as it is. */
static sf_status make_grey(sf_detector *d, const sf_frame *frame) {
    switch (frame->format) {
    case SF_PIXEL_RGB24:
    case SF_PIXEL_BGR24:
        mix_bytes(frame, d->grey);
        return SF_OK;
    case SF_PIXEL_YUYV:
        take_bytes(frame->plane[0], frame->stride[0], 2, frame, d->grey);
        return SF_OK;
    case SF_PIXEL_UYVY:
        take_bytes(frame->plane[0] + 1, frame->stride[0], 2, frame, d->grey);
        return SF_OK;
    default:
        return convert(d, frame);
    }
}

static int is_grey_as_it_is(const sf_frame *frame) {
    return frame->format == SF_PIXEL_GREY || frame->format == SF_PIXEL_NV12 ||
           frame->format == SF_PIXEL_YU12 || frame->format == SF_PIXEL_422P || frame->format == SF_PIXEL_444P;
}

sf_status sf_detector_find_in_frame(sf_detector *d, const sf_frame *frame, const sf_board_corner **corners,
                                    size_t *count) {
    *corners = d->corners;
    *count = 0;
    if (!frame->plane[0] || frame->width < 1 || frame->height < 1 || frame->width > MOST_SIDE ||
        frame->height > MOST_SIDE || (int64_t)frame->width * frame->height > MOST_PIXELS)
        return sf_fail(d->ctx, SF_ERR_ARGUMENT, "detector: a frame of %d x %d px without pixels",
                       (int)frame->width, (int)frame->height);
    if (is_grey_as_it_is(frame))
        return sf_detector_find(d, frame->plane[0], frame->stride[0], frame->width, frame->height, corners,
                                count);
    sf_status status =
        sf_grow(d->ctx, &d->grey, &d->grey_capacity, 0, (size_t)frame->width * (size_t)frame->height, 1);
    if (!status) status = make_grey(d, frame);
    return status ? status
                  : sf_detector_find(d, d->grey, (size_t)frame->width, frame->width, frame->height, corners,
                                     count);
}
