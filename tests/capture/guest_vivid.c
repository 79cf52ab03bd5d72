/* guest_vivid.c - frames through the kernel's simulated capture devices, compared to the last bit. */
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#include <linux/videodev2.h>

#include "guest.h"
#include "pattern.h"
#include "vivid.h"

enum { WIDTH = 640, HEIGHT = 480, FRAMES = 60 };

/* Takes FRAMES different frames of what is fed. The device repeats the newest frame that it has, so the next
 * is put only when that was seen: a frame is never written while it is being read. Before the first of ours
 * the device may give frames of its own. */
static void take_fed(sf_source *source, vivid_feed *feed, sf_pixel_format format) {
    int64_t last = -1;
    int taken = 0;
    for (int i = 0; taken < FRAMES; i++) {
        check(i < 10 * FRAMES, "%d frames, but only %d different ones", i, taken);
        sf_frame frame;
        next_frame(source, 5000, &frame);
        check(frame.format == format && frame.width == WIDTH && frame.height == HEIGHT,
              "a frame of %dx%d, %s", (int)frame.width, (int)frame.height,
              sf_pixel_format_name(frame.format));
        int64_t id = pattern_id(&frame);
        sf_source_release(source, &frame);
        if (id < 0 && taken == 0 && i < 10) continue;
        check(id >= 0, "frame %d after id %lld: the pixels are not those that were written", i,
              (long long)last);
        check(id >= last && id < vivid_feed_count(feed), "id %lld after %lld", (long long)id,
              (long long)last);
        taken += id > last;
        last = id;
        if (id + 1 == vivid_feed_count(feed)) vivid_feed_put(feed);
    }
}

static void loop(int multiplanar, uint32_t fourcc, const char *name, sf_pixel_format format) {
    const char *capture = multiplanar ? VIVID_CAPTURE_MPLANE : VIVID_CAPTURE;
    const char *output = multiplanar ? VIVID_OUTPUT_MPLANE : VIVID_OUTPUT;
    vivid_loop(capture, output, WIDTH, HEIGHT);
    vivid_feed *feed = vivid_feed_open(output, fourcc, format, WIDTH, HEIGHT);
    sf_source *source = open_source("v4l2:%s?size=%dx%d&format=%s", capture, WIDTH, HEIGHT, name);
    sf_source_info info;
    sf_source_describe(source, &info);
    check(info.format == format && info.width == WIDTH && info.height == HEIGHT && info.live, "is %dx%d %s",
          (int)info.width, (int)info.height, sf_pixel_format_name(info.format));
    take_fed(source, feed, format);
    sf_source_counts counts = counts_of(source);
    check(counts.damaged == 0 && counts.skipped == 0 && counts.reopened == 0,
          "damaged %d, skipped %d, reopened %d", (int)counts.damaged, (int)counts.skipped,
          (int)counts.reopened);
    sf_source_close(&source);
    vivid_feed_close(feed);
}

static void loop_yuyv(void) { loop(0, V4L2_PIX_FMT_YUYV, "YUYV", SF_PIXEL_YUYV); }
static void loop_uyvy(void) { loop(0, V4L2_PIX_FMT_UYVY, "UYVY", SF_PIXEL_UYVY); }
static void loop_nv12(void) { loop(0, V4L2_PIX_FMT_NV12, "NV12", SF_PIXEL_NV12); }
static void loop_yu12(void) { loop(0, V4L2_PIX_FMT_YUV420, "YU12", SF_PIXEL_YU12); }
static void loop_rgb24(void) { loop(0, V4L2_PIX_FMT_RGB24, "RGB24", SF_PIXEL_RGB24); }
static void loop_bgr24(void) { loop(0, V4L2_PIX_FMT_BGR24, "BGR24", SF_PIXEL_BGR24); }
static void loop_grey(void) { loop(0, V4L2_PIX_FMT_GREY, "GREY", SF_PIXEL_GREY); }
static void loop_mplane_yuyv(void) { loop(1, V4L2_PIX_FMT_YUYV, "YUYV", SF_PIXEL_YUYV); }
static void loop_mplane_nv12m(void) { loop(1, V4L2_PIX_FMT_NV12M, "NV12M", SF_PIXEL_NV12); }
static void loop_mplane_ym12(void) { loop(1, V4L2_PIX_FMT_YUV420M, "YM12", SF_PIXEL_YU12); }

/* The memory behind the descriptor holds the same picture. */
static void dmabuf(void) {
    vivid_loop(VIVID_CAPTURE, VIVID_OUTPUT, WIDTH, HEIGHT);
    vivid_feed *feed = vivid_feed_open(VIVID_OUTPUT, V4L2_PIX_FMT_YUYV, SF_PIXEL_YUYV, WIDTH, HEIGHT);
    sf_source *source = open_source("v4l2:" VIVID_CAPTURE "?size=%dx%d&format=YUYV&dmabuf=1", WIDTH, HEIGHT);
    int64_t id = -1;
    for (int i = 0; i < 20 && id < 0; i++) {
        sf_frame frame;
        next_frame(source, 5000, &frame);
        check(frame.dmabuf >= 0, "no descriptor of the memory");
        size_t bytes = frame.stride[0] * HEIGHT;
        void *memory = mmap(NULL, bytes, PROT_READ, MAP_SHARED, frame.dmabuf, 0);
        check(memory != MAP_FAILED, "the memory of the descriptor cannot be mapped");
        sf_frame same = frame;
        same.plane[0] = memory;
        id = pattern_id(&same);
        check(id == pattern_id(&frame), "the descriptor's memory is not the frame's");
        munmap(memory, bytes);
        sf_source_release(source, &frame);
    }
    check(id >= 0, "no frame of ours came");
    sf_source_close(&source);
    vivid_feed_close(feed);
}

/* A frame that nobody took in time makes room for a newer one. */
static void newest(void) {
    vivid_webcam(VIVID_CAPTURE);
    sf_source *source = open_source("v4l2:" VIVID_CAPTURE "?size=640x360&format=YUYV");
    sf_frame frame;
    next_frame(source, 5000, &frame);
    int64_t first = frame.time_ns;
    sf_source_release(source, &frame);
    uint64_t skipped = 0;
    for (int i = 0; i < 5; i++) {
        sleep_ms(300);
        sf_status status = sf_source_newest(source, 5000, &frame);
        check(status == SF_OK, "newest: %s", sf_last_error(guest_context()));
        int64_t age_ms = now_ms() - frame.time_ns / 1000000;
        check(age_ms >= 0 && frame.time_ns > first, "a frame of %lld ms ago, after one of %lld",
              (long long)age_ms, (long long)first);
        first = frame.time_ns;
        sf_source_release(source, &frame);
        check(counts_of(source).skipped > skipped, "no frame was skipped in 300 ms");
        skipped = counts_of(source).skipped;
    }
    sf_source_close(&source);
}

/* Both ends of what a source tells of itself: the list of devices, and the names that open. */
static void devices(void) {
    static const char *const nodes[] = {"v4l2:" VIVID_CAPTURE, "v4l2:" VIVID_CAPTURE_MPLANE};
    sf_devices *list;
    check(sf_devices_find(guest_context(), &list) == SF_OK, "%s", sf_last_error(guest_context()));
    unsigned found = 0;
    sf_device_info info;
    for (size_t i = 0; sf_devices_get(list, i, &info) == SF_OK; i++) {
        check(strcmp(info.source, "v4l2:" VIVID_OUTPUT) != 0, "an output is listed: %s", info.source);
        for (unsigned k = 0; k < 2; k++)
            if (strcmp(info.source, nodes[k]) == 0 && strcmp(info.name, "vivid") == 0 && info.modes > 10)
                found |= 1U << k;
    }
    check(found == 3, "not both capture devices are listed with their modes");
    sf_devices_free(&list);
}

const guest_test vivid_tests[] = {{"loop_yuyv", loop_yuyv},
                                  {"loop_uyvy", loop_uyvy},
                                  {"loop_nv12", loop_nv12},
                                  {"loop_yu12", loop_yu12},
                                  {"loop_rgb24", loop_rgb24},
                                  {"loop_bgr24", loop_bgr24},
                                  {"loop_grey", loop_grey},
                                  {"loop_mplane_yuyv", loop_mplane_yuyv},
                                  {"loop_mplane_nv12m", loop_mplane_nv12m},
                                  {"loop_mplane_ym12", loop_mplane_ym12},
                                  {"dmabuf", dmabuf},
                                  {"newest", newest},
                                  {"devices", devices},
                                  {0}};
