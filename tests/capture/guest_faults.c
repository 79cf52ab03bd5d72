/* guest_faults.c - the faults that the kernel's simulated capture device injects: each is survived and
 * counted. */
#include <stdio.h>
#include <string.h>

#include "guest.h"
#include "vivid.h"

#define WEBCAM "v4l2:" VIVID_CAPTURE "?size=640x360&format=YUYV"

/* Takes frames, summing up the gaps in their sequence. */
static uint64_t take(sf_source *source, int count) {
    uint64_t gaps = 0, last = 0;
    for (int i = 0; i < count; i++) {
        sf_frame frame;
        next_frame(source, 2000, &frame);
        check(i == 0 || frame.sequence > last, "sequence %llu after %llu", (unsigned long long)frame.sequence,
              (unsigned long long)last);
        if (i > 0) gaps += frame.sequence - last - 1;
        last = frame.sequence;
        sf_source_release(source, &frame);
    }
    return gaps;
}

static sf_source *open_webcam(void) {
    vivid_webcam(VIVID_CAPTURE);
    return open_source(WEBCAM);
}

/* An error that comes once, before the first frame or while frames come. */
static void survive_once(const char *control, int streaming) {
    vivid_webcam(VIVID_CAPTURE);
    if (!streaming) vivid_set(VIVID_CAPTURE, control, 1);
    sf_source *source = open_source(WEBCAM);
    take(source, 5);
    check(streaming || was_logged("tried again"), "no call failed");
    if (streaming) vivid_set(VIVID_CAPTURE, control, 1);
    take(source, 10);
    check(counts_of(source).given == 15, "given %d", (int)counts_of(source).given);
    sf_source_close(&source);
}

static void no_buffers_once(void) { survive_once("Inject VIDIOC_REQBUFS Error", 0); }
static void no_queueing_once(void) { survive_once("Inject VIDIOC_QBUF Error", 0); }
static void no_queueing_while_streaming(void) { survive_once("Inject VIDIOC_QBUF Error", 1); }
static void no_start_once(void) { survive_once("Inject VIDIOC_STREAMON Error", 0); }

static void damaged_frame(void) {
    sf_source *source = open_webcam();
    take(source, 5);
    vivid_set(VIVID_CAPTURE, "Inject V4L2_BUF_FLAG_ERROR", 1);
    take(source, 10);
    check(counts_of(source).damaged == 1, "damaged %d, not 1", (int)counts_of(source).damaged);
    sf_source_close(&source);
}

static void half_dropped(void) {
    sf_source *source = open_webcam();
    vivid_set(VIVID_CAPTURE, "Percentage of Dropped Buffers", 50);
    uint64_t gaps = take(source, 30);
    check(gaps > 0, "no frame was lost");
    check(counts_of(source).dropped >= gaps, "dropped %d, but the sequence lacks %d",
          (int)counts_of(source).dropped, (int)gaps);
    vivid_set(VIVID_CAPTURE, "Percentage of Dropped Buffers", 0);
    sf_source_close(&source);
}

static void all_dropped(void) {
    sf_source *source = open_webcam();
    take(source, 3);
    vivid_set(VIVID_CAPTURE, "Percentage of Dropped Buffers", 100);
    sf_frame frame;
    /* What was captured before is still there. */
    sf_status status = SF_OK;
    for (int i = 0; i < 10 && status == SF_OK; i++) {
        int64_t began = now_ms();
        status = sf_source_next(source, 400, &frame);
        check(now_ms() - began < 20000, "waited for %lld ms", (long long)(now_ms() - began));
        if (status == SF_OK) sf_source_release(source, &frame);
    }
    check(status == SF_ERR_TIMEOUT, "%s instead of a time-out", sf_status_text(status));
    vivid_set(VIVID_CAPTURE, "Percentage of Dropped Buffers", 0);
    take(source, 5);
    check(counts_of(source).dropped > 0, "the gap was not counted");
    sf_source_close(&source);
}

static void sequence_wraps(void) {
    vivid_webcam(VIVID_CAPTURE);
    vivid_set(VIVID_CAPTURE, "Wrap Sequence Number", 1);
    sf_source *source = open_source(WEBCAM);
    enum { BEFORE_THE_WRAP = 0x80 };
    uint64_t gaps = take(source, BEFORE_THE_WRAP + 20);
    check(counts_of(source).dropped == gaps && gaps < 1000, "dropped %llu, gaps %llu",
          (unsigned long long)counts_of(source).dropped, (unsigned long long)gaps);
    vivid_set(VIVID_CAPTURE, "Wrap Sequence Number", 0);
    sf_source_close(&source);
}

static void stream_breaks(void) {
    sf_source *source = open_webcam();
    take(source, 5);
    vivid_set(VIVID_CAPTURE, "Inject Fatal Streaming Error", 1);
    take(source, 15);
    check(was_logged(VIVID_CAPTURE ": the stream failed"), "the stream did not break");
    check(counts_of(source).given == 20 && counts_of(source).reopened == 0, "given %d, reopened %d",
          (int)counts_of(source).given, (int)counts_of(source).reopened);
    sf_source_close(&source);
}

/* The device forgets its users, and is there again when the last has closed it. */
static void disconnected(void) {
    sf_source *source = open_webcam();
    take(source, 5);
    vivid_set(VIVID_CAPTURE, "Disconnect", 1);
    take(source, 10);
    check(counts_of(source).reopened == 1, "reopened %d times", (int)counts_of(source).reopened);
    check(was_logged(VIVID_CAPTURE), "the loss was not reported");
    sf_source_close(&source);
}

static void unbound(void) {
    sf_source *source = open_webcam();
    take(source, 5);
    sf_frame kept;
    next_frame(source, 2000, &kept);
    uint8_t before = kept.plane[0][1000];
    vivid_bind("vivid.0", 0);
    check(!node_exists("vivid-000-vid-cap"), "the node did not vanish");
    sf_frame frame;
    sf_status status = SF_OK;
    for (int i = 0; i < 10 && status == SF_OK; i++) {
        status = sf_source_next(source, 500, &frame);
        if (status == SF_OK) sf_source_release(source, &frame);
    }
    check(status == SF_ERR_TIMEOUT, "%s instead of a time-out: %s", sf_status_text(status),
          sf_last_error(guest_context()));
    check(kept.plane[0][1000] == before, "the frame that was out changed");
    sf_source_release(source, &kept);
    vivid_bind("vivid.0", 1);
    char node[32];
    find_node("vivid-000-vid-cap", node);
    take(source, 10);
    check(counts_of(source).reopened == 1, "reopened %d times", (int)counts_of(source).reopened);
    sf_source_close(&source);
}

/* No error: noise, or nothing; neither waits for ever. */
static void no_signal(void) {
    vivid_webcam(VIVID_CAPTURE);
    vivid_set_input(VIVID_CAPTURE, VIVID_HDMI);
    vivid_set_timings(VIVID_CAPTURE, 640, 480);
    sf_source *source = open_source("v4l2:" VIVID_CAPTURE "?format=YUYV");
    take(source, 5);
    vivid_set(VIVID_CAPTURE, "DV Timings Signal Mode", 1);
    for (int i = 0; i < 10; i++) {
        sf_frame frame;
        int64_t began = now_ms();
        sf_status status = sf_source_next(source, 300, &frame);
        check(status == SF_OK || status == SF_ERR_TIMEOUT, "%s", sf_last_error(guest_context()));
        check(now_ms() - began < 20000, "waited for %lld ms", (long long)(now_ms() - began));
        if (status == SF_OK) sf_source_release(source, &frame);
    }
    vivid_set(VIVID_CAPTURE, "DV Timings Signal Mode", 0);
    take(source, 5);
    sf_source_close(&source);
}

/* A device can be opened by many, but streams for one. */
static void busy(void) {
    sf_source *first = open_webcam(), *second = NULL;
    take(first, 3);
    sf_status status =
        sf_source_open(guest_context(), "v4l2:" VIVID_CAPTURE "?size=320x180&format=GREY", &second);
    sf_frame frame;
    if (status == SF_OK) status = sf_source_next(second, 1000, &frame);
    check(status == SF_ERR_IO, "%s", sf_status_text(status));
    check(strstr(sf_last_error(guest_context()), VIVID_CAPTURE), "the device is not named: %s",
          sf_last_error(guest_context()));
    sf_source_close(&second);
    take(first, 3);
    sf_source_close(&first);
}

/* Nothing is left behind that would keep the device from another format. */
static void opened_again(void) {
    vivid_webcam(VIVID_CAPTURE);
    static const char *const modes[] = {"size=640x360&format=YUYV", "size=320x180&format=NV12",
                                        "size=1280x720&format=RGB24", "size=640x360&format=GREY&buffers=2"};
    for (int i = 0; i < 8; i++) {
        sf_source *source = open_source("v4l2:" VIVID_CAPTURE "?%s", modes[i % 4]);
        take(source, 2);
        sf_frame left_out;
        next_frame(source, 2000, &left_out);
        sf_source_close(&source);
    }
}

/* A size that the device has not is refused by name, with what it has. */
static void other_size(void) {
    vivid_webcam(VIVID_CAPTURE);
    sf_source *source = NULL;
    sf_status status =
        sf_source_open(guest_context(), "v4l2:" VIVID_CAPTURE "?size=641x479&format=YUYV", &source);
    const char *error = sf_last_error(guest_context());
    check(status == SF_ERR_UNSUPPORTED, "%s", sf_status_text(status));
    check(strstr(error, "641x479") && strstr(error, "640x360"), "not named with what there is: %s", error);
}

/* A stride is the driver's: the rows of a picture are where it says. */
static void other_stride(void) {
    vivid_webcam(VIVID_CAPTURE);
    sf_source *source = open_source("v4l2:" VIVID_CAPTURE "?size=640x360&format=RGB24");
    sf_frame frame;
    next_frame(source, 2000, &frame);
    check(frame.stride[0] >= 3 * 640, "stride %zu", frame.stride[0]);
    sf_source_release(source, &frame);
    sf_source_close(&source);
}

static void controls(void) {
    vivid_webcam(VIVID_CAPTURE);
    sf_source *source = open_source(WEBCAM "&ctrl.brightness=77&ctrl.contrast=55");
    check(vivid_get(VIVID_CAPTURE, "Brightness") == 77, "brightness %d",
          vivid_get(VIVID_CAPTURE, "Brightness"));
    check(vivid_get(VIVID_CAPTURE, "Contrast") == 55, "contrast %d", vivid_get(VIVID_CAPTURE, "Contrast"));
    sf_source_close(&source);
    check(sf_source_open(guest_context(), WEBCAM "&ctrl.brightness=100000", &source) == SF_ERR_ARGUMENT,
          "a value out of range was taken");
    check(sf_source_open(guest_context(), WEBCAM "&ctrl.nothing=1", &source) != SF_OK,
          "an unknown control was taken");
}

const guest_test fault_tests[] = {{"no_buffers_once", no_buffers_once},
                                  {"no_queueing_once", no_queueing_once},
                                  {"no_queueing_while_streaming", no_queueing_while_streaming},
                                  {"no_start_once", no_start_once},
                                  {"damaged_frame", damaged_frame},
                                  {"half_dropped", half_dropped},
                                  {"all_dropped", all_dropped},
                                  {"sequence_wraps", sequence_wraps},
                                  {"stream_breaks", stream_breaks},
                                  {"no_signal", no_signal},
                                  {"busy", busy},
                                  {"opened_again", opened_again},
                                  {"other_size", other_size},
                                  {"other_stride", other_stride},
                                  {"controls", controls},
                                  {"disconnected", disconnected},
                                  {"unbound", unbound},
                                  {0}};
