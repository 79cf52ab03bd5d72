/* guest_virtual.c - the virtual cameras of a newer libcamera, whose frames lie in memory of a DMA heap.
 *
 * Their bars move to the left by a pixel from frame to frame, so that of two frames each row is the other's,
 * turned by as many pixels as their numbers differ.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "guest.h"

enum { WIDTH = 400, HEIGHT = 300, FRAMES = 30 };

static const char virtual_cameras[] =
    "Bars:\n  supported_formats:\n  - width: 400\n    height: 300\n    frame_rates: [ 30, 30 ]\n"
    "  - width: 640\n    height: 480\n    frame_rates: [ 30, 30 ]\n"
    "  test_pattern: bars\n  model: Moving bars\n"
    "Lines:\n  supported_formats:\n  - width: 320\n    height: 240\n    frame_rates: [ 30, 30 ]\n"
    "  test_pattern: lines\n  model: Moving lines\n";

/* libcamera finds its cameras in a file, below the prefix that it is installed under. */
static void make_cameras(void) {
    const char *prefix = getenv("prefix");
    char path[256];
    snprintf(path, sizeof path, "%s/share/libcamera/pipeline/virtual/virtual.yaml", prefix ? prefix : "/usr");
    FILE *file = fopen(path, "w");
    if (!file) skip("this libcamera has no virtual cameras");
    check(fputs(virtual_cameras, file) >= 0 && fclose(file) == 0, "%s cannot be written", path);
}

static void devices(void) {
    make_cameras();
    sf_devices *list;
    check(sf_devices_find(guest_context(), &list) == SF_OK, "%s", sf_last_error(guest_context()));
    sf_device_info info;
    int bars = 0, lines = 0;
    for (size_t i = 0; sf_devices_get(list, i, &info) == SF_OK; i++) {
        printf("%s: %s, %zu modes\n", info.source, info.name, info.modes);
        bars += strcmp(info.source, "libcamera:Bars") == 0 && strcmp(info.name, "Moving bars") == 0;
        lines += strcmp(info.source, "libcamera:Lines") == 0 && strcmp(info.name, "Moving lines") == 0;
    }
    check(bars == 1 && lines == 1, "bars %d times, lines %d times", bars, lines);
    sf_devices_free(&list);
}

static void expect_form(const sf_frame *frame) {
    check(frame->width == WIDTH && frame->height == HEIGHT && frame->format == SF_PIXEL_NV12, "is %dx%d %s",
          (int)frame->width, (int)frame->height, sf_pixel_format_name(frame->format));
    check(frame->matrix == SF_YUV_709 && !frame->full_range, "matrix %d, full range %d", (int)frame->matrix,
          frame->full_range);
    check(frame->stride[0] >= WIDTH && frame->stride[1] >= WIDTH, "strides of %zu and %zu bytes",
          frame->stride[0], frame->stride[1]);
    check(frame->dmabuf >= 0, "no DMA buffer");
}

/* All rows are the same bars, some of them bright, some dark; so are those of the colours. */
static void expect_bars(const sf_frame *frame) {
    int least = 255, most = 0, u_least = 255, u_most = 0;
    for (int x = 0; x < WIDTH; x++) {
        int y = frame->plane[0][x], u = frame->plane[1][x & ~1];
        least = y < least ? y : least, most = y > most ? y : most;
        u_least = u < u_least ? u : u_least, u_most = u > u_most ? u : u_most;
    }
    check(least < 40 && most > 200, "luma is from %d to %d", least, most);
    check(u_least < 60 && u_most > 200, "U is from %d to %d", u_least, u_most);
    for (size_t row = 1; row < HEIGHT; row++)
        check(memcmp(frame->plane[0], frame->plane[0] + row * frame->stride[0], WIDTH) == 0,
              "row %zu is another than row 0", row);
}

/* Whether `row` is `first`, turned to the left by so many pixels. */
static int turned(const uint8_t *row, const uint8_t *first, uint64_t by) {
    for (uint64_t x = 0; x < WIDTH; x++)
        if (row[x] != first[(x + by) % WIDTH]) return 0;
    return 1;
}

static void frames(void) {
    make_cameras();
    sf_source *source = open_source("libcamera:Bars?size=400x300");
    uint8_t first[WIDTH];
    uint64_t number = 0, before = 0;
    int64_t time = 0;
    for (int i = 0; i < FRAMES; i++) {
        sf_frame frame;
        next_frame(source, 5000, &frame);
        expect_form(&frame);
        expect_bars(&frame);
        if (i == 0) {
            memcpy(first, frame.plane[0], WIDTH);
            number = frame.sequence;
        } else {
            check(frame.sequence > before, "number %llu after %llu", (unsigned long long)frame.sequence,
                  (unsigned long long)before);
            check(frame.time_ns > time, "time %lld after %lld ns", (long long)frame.time_ns, (long long)time);
            check(!turned(frame.plane[0], first, 0), "frame %d is the first", i);
        }
        check(turned(frame.plane[0], first, frame.sequence - number), "frame %d, number %llu: not its pixels",
              i, (unsigned long long)frame.sequence);
        before = frame.sequence, time = frame.time_ns;
        sf_source_release(source, &frame);
    }
    check(counts_of(source).given == FRAMES && counts_of(source).damaged == 0, "given %d, damaged %d",
          (int)counts_of(source).given, (int)counts_of(source).damaged);
    printf("%d frames, numbers %llu to %llu\n", FRAMES, (unsigned long long)number,
           (unsigned long long)before);
    sf_source_close(&source);
}

/* Two cameras of one context; frames of both are out at once. */
static void two_cameras(void) {
    make_cameras();
    sf_source *bars = open_source("libcamera:Bars?size=640x480"), *lines = open_source("libcamera:Lines");
    for (int i = 0; i < 5; i++) {
        sf_frame bar, line;
        next_frame(bars, 5000, &bar);
        next_frame(lines, 5000, &line);
        check(bar.width == 640 && bar.height == 480 && line.width == 320 && line.height == 240,
              "%dx%d and %dx%d", (int)bar.width, (int)bar.height, (int)line.width, (int)line.height);
        sf_source_release(lines, &line);
        sf_source_release(bars, &bar);
    }
    sf_source_close(&lines);
    sf_source_close(&bars);
}

static void expect(const char *name, sf_status expected, const char *part) {
    sf_source *source = NULL;
    sf_status status = sf_source_open(guest_context(), name, &source);
    printf("%s: %s\n", name, sf_last_error(guest_context()));
    check(status == expected, "%s, not %s", sf_status_text(status), sf_status_text(expected));
    check(strstr(sf_last_error(guest_context()), part), "says nothing of \"%s\"", part);
}

/* They have no controls. */
static void refused(void) {
    make_cameras();
    expect("libcamera:Bars?exposure=auto", SF_ERR_UNSUPPORTED, "exposure: has no automatic exposure");
    expect("libcamera:Bars?exposure=manual:9000", SF_ERR_UNSUPPORTED, "exposure: has no control for it");
    expect("libcamera:Bars?gain=2", SF_ERR_UNSUPPORTED, "gain: has no control for it");
    expect("libcamera:Bars?size=401x300", SF_ERR_UNSUPPORTED, "has no 401x300, but 640x480");
    expect("libcamera:Bars?format=YUYV", SF_ERR_UNSUPPORTED, "NV12");
}

/* The last test: it removes the system's DMA heaps. */
static void no_heap(void) {
    make_cameras();
    check(system("rm -rf /dev/dma_heap /dev/udmabuf") == 0, "the heaps stay");
    expect("libcamera:Bars", SF_ERR_IO, "no DMA heap: /dev/dma_heap and /dev/udmabuf are missing");
}

const guest_test virtual_tests[] = {{"virtual_devices", devices},         {"virtual_frames", frames},
                                    {"virtual_two_cameras", two_cameras}, {"virtual_refused", refused},
                                    {"virtual_no_heap", no_heap},         {0}};
