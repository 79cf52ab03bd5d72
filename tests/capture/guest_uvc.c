/* guest_uvc.c - a simulated USB webcam behind the kernel's driver for real ones. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "guest.h"
#include "pattern.h"
#include "vivid.h"
#include "webcam.h"

enum { FRAMES = 60 };

static void stream(const char *format) {
    webcam camera;
    char node[32];
    webcam_plug(&camera, "", node);
    sf_source *source = open_source("v4l2:%s?size=640x480&format=%s", node, format);
    take_exact(source, FRAMES);
    sf_source_counts counts = counts_of(source);
    check(counts.given == FRAMES && counts.damaged == 0, "given %d, damaged %d", (int)counts.given,
          (int)counts.damaged);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

static void mjpeg(void) { stream("MJPEG"); }
static void yuyv(void) { stream("YUYV"); }

/* Without being told it chooses a format that it reads, and gives it to the pixel. */
static void chosen_format(void) {
    webcam camera;
    char node[32];
    webcam_plug(&camera, "", node);
    sf_source *source = open_source("v4l2:%s", node);
    take_exact(source, 5);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

/* Controls that are asked for arrive in the camera. */
static void controls(void) {
    webcam camera;
    char node[32];
    webcam_plug(&camera, "", node);
    sf_source *source =
        open_source("v4l2:%s?format=YUYV&exposure=manual:120&gain=40&ctrl.brightness=77", node);
    check(webcam_said(&camera, "exposure mode 1\n"), "not set to manual exposure: %s", camera.said);
    check(webcam_said(&camera, "exposure 120\n"), "not set to an exposure of 120: %s", camera.said);
    check(webcam_said(&camera, "gain 40\n"), "not set to a gain of 40: %s", camera.said);
    check(webcam_said(&camera, "brightness 77\n"), "not set to a brightness of 77: %s", camera.said);
    sf_frame frame;
    next_frame(source, 5000, &frame);
    check(frame.exposure_s > 0.0119 && frame.exposure_s < 0.0121, "a frame of %g s", frame.exposure_s);
    sf_source_release(source, &frame);
    sf_source_close(&source);
    check(sf_source_open(guest_context(), "v4l2:/dev/none", &source) == SF_ERR_IO,
          "a missing node was opened");
    webcam_unplug(&camera);
}

/* Frames that the driver or the source must not hand over: what comes is whole, what lacks is counted. */
static void survive(const char *options, const char *format, int counted_as_damaged) {
    webcam camera;
    char node[32];
    webcam_plug(&camera, options, node);
    sf_source *source = open_source("v4l2:%s?format=%s", node, format);
    take_exact(source, 30);
    sf_source_counts counts = counts_of(source);
    check(counted_as_damaged ? counts.damaged > 0 : counts.damaged + counts.dropped > 0,
          "%s, %s: damaged %d, dropped %d", options, format, (int)counts.damaged, (int)counts.dropped);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

static void marked_yuyv(void) { survive("-s 320x240 -e 5", "YUYV", 0); }
static void short_mjpeg(void) { survive("-s 320x240 -d 5", "MJPEG", 0); }
static void marked_mjpeg(void) { survive("-s 320x240 -e 5", "MJPEG", 0); }
static void short_yuyv(void) { survive("-s 320x240 -d 5", "YUYV", 0); }
static void cut_yuyv(void) { survive("-s 320x240 -t 5", "YUYV", 0); }
/* The driver hands a cut JPEG over as if it were whole. */
static void cut_mjpeg(void) { survive("-s 320x240 -t 5", "MJPEG", 1); }

/* What comes can be decoded, whole pictures of it. */
static void decoded(void) {
    enum { WIDTH = 320, HEIGHT = 240 };
    webcam camera;
    char node[32];
    webcam_plug(&camera, "-s 320x240 -t 3", node);
    sf_source *source = open_source("v4l2:%s?format=MJPEG", node);
    float *plane = calloc((size_t)WIDTH * HEIGHT, sizeof *plane), *const rgb[3] = {plane, plane, plane};
    check(plane != NULL, "out of memory");
    for (int i = 0; i < 10; i++) {
        sf_frame frame;
        next_frame(source, 5000, &frame);
        check(frame.width == WIDTH && frame.height == HEIGHT, "%dx%d", (int)frame.width, (int)frame.height);
        check(sf_frame_convert(guest_context(), &frame, rgb, WIDTH) == SF_OK, "frame %d: %s", i,
              sf_last_error(guest_context()));
        sf_source_release(source, &frame);
    }
    check(counts_of(source).damaged > 0, "no frame was cut");
    free(plane);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

static void run(const char *command) {
    char line[512];
    snprintf(line, sizeof line, "{ %s; } >/tmp/said 2>&1 || { cat /tmp/said; exit 1; }", command);
    check(system(line) == 0, "failed: %s", command);
}

/* The program records what the camera sent, and reads it again. */
static void recorded(void) {
    webcam camera;
    char node[32], command[128];
    webcam_plug(&camera, "", node);
    snprintf(command, sizeof command,
             "rm -rf /tmp/shot; splatfit capture 'v4l2:%s?format=MJPEG' -o /tmp/shot --frames 10", node);
    run(command);
    run("grep -q '\"sequence\"' /tmp/shot/frames.json");
    sf_source *source = open_source("folder:/tmp/shot?decode=0");
    take_exact(source, 10);
    sf_frame frame;
    check(sf_source_next(source, 1000, &frame) == SF_ERR_END, "there are more than 10 pictures");
    sf_source_close(&source);
    webcam_unplug(&camera);
}

static void devices(void) {
    webcam camera;
    char node[32];
    webcam_plug(&camera, "-n F00D", node);
    sf_devices *list;
    check(sf_devices_find(guest_context(), &list) == SF_OK, "%s", sf_last_error(guest_context()));
    sf_device_info info;
    int found = 0;
    for (size_t i = 0; sf_devices_get(list, i, &info) == SF_OK; i++) {
        if (strncmp(info.name, WEBCAM_NAME, strlen(WEBCAM_NAME)) != 0) continue;
        check(strncmp(info.source, "v4l2:", 5) == 0 && strcmp(info.source + 5, node) == 0, "source %s",
              info.source);
        check(strcmp(info.serial, "F00D") == 0, "serial \"%s\"", info.serial);
        check(info.modes == 2, "%zu modes", info.modes);
        for (size_t m = 0; m < info.modes; m++) {
            sf_device_mode mode;
            check(sf_devices_get_mode(list, i, m, &mode) == SF_OK, "no mode %zu", m);
            check(mode.supported && mode.width == 640 && mode.height == 480 && mode.fps_most > 29.9 &&
                      mode.fps_most < 30.1,
                  "mode %s %dx%d at %g", mode.fourcc, (int)mode.width, (int)mode.height, mode.fps_most);
        }
        found++;
    }
    check(found == 1, "listed %d times", found);
    sf_devices_free(&list);
    run("splatfit devices >/tmp/devices");
    run("grep -q 640x480 /tmp/devices && grep -q 'Simulated webcam' /tmp/devices");
    run("grep -q /dev/video0 /tmp/devices && grep -q /dev/video2 /tmp/devices");
    webcam_unplug(&camera);
}

static void expect_away(sf_source *source, int looks) {
    sf_frame frame;
    sf_status status = SF_OK;
    int waited = 0;
    for (int i = 0; i < 200 && waited < looks; i++) {
        status = sf_source_next(source, 300, &frame);
        check(status == SF_OK || status == SF_ERR_TIMEOUT, "%s", sf_last_error(guest_context()));
        if (status == SF_OK) sf_source_release(source, &frame);
        waited = status == SF_OK ? 0 : waited + 1;
    }
    check(waited == looks, "no time-out without the camera");
}

/* Pulled out and put back. */
static void replugged(const char *format) {
    webcam camera;
    char node[32];
    webcam_plug(&camera, "-s 320x240 -u 20 -p 1500", node);
    sf_source *source = open_source("v4l2:%s?size=320x240&format=%s", node, format);
    take_exact(source, 50);
    sf_source_counts counts = counts_of(source);
    check(counts.reopened == 1, "reopened %d times", (int)counts.reopened);
    check(was_logged(node), "the loss was not reported");
    sf_source_close(&source);
    webcam_unplug(&camera);
}

static void replugged_yuyv(void) { replugged("YUYV"); }
static void replugged_mjpeg(void) { replugged("MJPEG"); }

/* Only the same camera is taken for the one that was lost. */
static void another_camera(void) {
    webcam camera;
    char node[32];
    webcam_plug(&camera, "-s 320x240 -n ONE", node);
    sf_source *source = open_source("v4l2:%s?format=YUYV", node);
    take_exact(source, 5);
    webcam_unplug(&camera);
    expect_away(source, 2);
    webcam_plug(&camera, "-s 320x240 -n TWO", node);
    expect_away(source, 5);
    check(counts_of(source).reopened == 0, "another camera was taken for it");
    webcam_unplug(&camera);
    webcam_plug(&camera, "-s 320x240 -n ONE", node);
    take_exact(source, 5);
    check(counts_of(source).reopened == 1, "reopened %d times", (int)counts_of(source).reopened);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

/* Someone else still holds the old node, so the camera comes back under another name. */
static void another_node(void) {
    webcam camera;
    char node[32], again[32];
    webcam_plug(&camera, "", node);
    sf_source *source = open_source("v4l2:%s?format=YUYV", node);
    take_exact(source, 5);
    int holder = open(node, O_RDWR | O_CLOEXEC);
    check(holder >= 0, "%s cannot be opened twice", node);
    webcam_unplug(&camera);
    webcam_plug(&camera, "", again);
    check(strcmp(node, again) != 0, "the camera came back as %s", again);
    take_exact(source, 10);
    check(counts_of(source).reopened == 1, "reopened %d times", (int)counts_of(source).reopened);
    sf_source_close(&source);
    close(holder);
    webcam_unplug(&camera);
}

/* A frame that is out when the camera goes stays readable. */
static void kept_frame(void) {
    webcam camera;
    char node[32];
    webcam_plug(&camera, "", node);
    sf_source *source = open_source("v4l2:%s?format=YUYV", node);
    sf_frame kept;
    next_frame(source, 5000, &kept);
    int64_t id = pattern_id(&kept);
    webcam_unplug(&camera);
    expect_away(source, 2);
    check(id >= 0 && pattern_id(&kept) == id, "the frame that was out changed");
    sf_source_release(source, &kept);
    sf_source_close(&source);
}

const guest_test uvc_tests[] = {{"mjpeg", mjpeg},
                                {"yuyv", yuyv},
                                {"chosen_format", chosen_format},
                                {"controls", controls},
                                {"devices", devices},
                                {"marked_yuyv", marked_yuyv},
                                {"marked_mjpeg", marked_mjpeg},
                                {"short_yuyv", short_yuyv},
                                {"short_mjpeg", short_mjpeg},
                                {"cut_yuyv", cut_yuyv},
                                {"cut_mjpeg", cut_mjpeg},
                                {"decoded", decoded},
                                {"recorded", recorded},
                                {"replugged_yuyv", replugged_yuyv},
                                {"replugged_mjpeg", replugged_mjpeg},
                                {"another_camera", another_camera},
                                {"another_node", another_node},
                                {"kept_frame", kept_frame},
                                {0}};
