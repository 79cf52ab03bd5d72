/* guest_libcamera.c - the simulated webcam through libcamera. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "guest.h"
#include "pattern.h"
#include "webcam.h"

/* libcamera takes only devices that udev calls initialised. There is no udev, so its notes are written here:
 * one a device, named by its numbers. */
static void note_for_udev(const char *class_folder) {
    char command[256];
    snprintf(command, sizeof command,
             "for f in %s/*/dev; do [ -e $f ] && echo I:1000000 >/run/udev/data/c$(cat $f); done",
             class_folder);
    check(system(command) >= 0, "no shell");
}

static void plug(webcam *camera, const char *options) {
    char node[32];
    webcam_plug(camera, options, node);
    note_for_udev("/sys/class/video4linux");
    note_for_udev("/sys/bus/media/devices");
}

static void stream(const char *format, sf_pixel_format expected) {
    webcam camera;
    plug(&camera, "");
    sf_source *source = open_source("libcamera:0?size=640x480&format=%s", format);
    sf_source_info info;
    sf_source_describe(source, &info);
    check(info.width == 640 && info.height == 480 && info.format == expected && info.live, "is %dx%d %s",
          (int)info.width, (int)info.height, sf_pixel_format_name(info.format));
    take_exact(source, 60);
    check(counts_of(source).given == 60 && counts_of(source).damaged == 0, "given %d, damaged %d",
          (int)counts_of(source).given, (int)counts_of(source).damaged);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

static void yuyv(void) { stream("YUYV", SF_PIXEL_YUYV); }
static void mjpeg(void) { stream("MJPEG", SF_PIXEL_MJPEG); }

static void cut_mjpeg(void) {
    webcam camera;
    plug(&camera, "-t 5");
    sf_source *source = open_source("libcamera:0?format=MJPEG");
    take_exact(source, 20);
    check(counts_of(source).damaged > 0, "no frame was found damaged");
    sf_source_close(&source);
    webcam_unplug(&camera);
}

/* The driver swallows the frame, or marks it: either is counted. */
static void marked_yuyv(void) {
    webcam camera;
    plug(&camera, "-s 320x240 -e 5");
    sf_source *source = open_source("libcamera:0?format=YUYV");
    take_exact(source, 20);
    check(counts_of(source).damaged + counts_of(source).dropped > 0, "nothing was counted");
    sf_source_close(&source);
    webcam_unplug(&camera);
}

/* Its id opens it, too; the list names it. */
static void devices(void) {
    webcam camera;
    plug(&camera, "");
    sf_devices *list;
    check(sf_devices_find(guest_context(), &list) == SF_OK, "%s", sf_last_error(guest_context()));
    sf_device_info info, found = {0};
    for (size_t i = 0; sf_devices_get(list, i, &info) == SF_OK; i++)
        if (strncmp(info.source, "libcamera:", 10) == 0) found = info;
    check(found.modes == 2, "%s: %zu modes", found.source, found.modes);
    check(strncmp(found.name, WEBCAM_NAME, strlen(WEBCAM_NAME)) == 0, "name \"%s\"", found.name);
    sf_devices_free(&list);
    sf_source *source = open_source("%s?format=YUYV", found.source);
    take_exact(source, 3);
    sf_source_close(&source);
    check(system("/bin/splatfit devices >/tmp/devices 2>&1 && grep -q 'libcamera:' /tmp/devices && "
                 "grep -q 'v4l2:' /tmp/devices || { cat /tmp/devices; exit 1; }") == 0,
          "splatfit devices does not list both");
    webcam_unplug(&camera);
}

static void controls(void) {
    webcam camera;
    plug(&camera, "");
    sf_source *source = open_source("libcamera:0?format=YUYV&exposure=manual:12000");
    sf_frame frame;
    next_frame(source, 5000, &frame);
    check(frame.exposure_s > 0.0119 && frame.exposure_s < 0.0121, "a frame of %g s", frame.exposure_s);
    check(webcam_said(&camera, "exposure mode 1\n"), "not set to manual exposure: %s", camera.said);
    check(webcam_said(&camera, "exposure 120\n"), "not set to an exposure of 120: %s", camera.said);
    sf_source_release(source, &frame);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

/* From libcamera 0.5 on a gain counts only where its own mode is not automatic; a webcam has none. Until 0.4
 * libcamera knows only one automatic mode of webcams, that with a fixed aperture. */
static void gain(void) {
    webcam camera;
    plug(&camera, "-m 9");
    sf_source *source = open_source("libcamera:0?format=YUYV&exposure=auto&gain=2");
    sf_frame frame;
    next_frame(source, 5000, &frame);
    check(frame.gain == 2 && frame.exposure_s == 0, "a gain of %g, %g s", frame.gain, frame.exposure_s);
    check(webcam_said(&camera, "exposure mode 8\n"), "not set to automatic exposure: %s", camera.said);
    check(webcam_said(&camera, "gain 96\n"), "not set to a gain of 96: %s", camera.said);
    sf_source_release(source, &frame);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

/* What is automatic, until it is locked. */
static void lock(void) {
    webcam camera;
    plug(&camera, "-m 9");
    sf_source *source = open_source("libcamera:0?format=YUYV");
    sf_source_info info;
    sf_source_describe(source, &info);
    check(info.can_lock_exposure, "the exposure cannot be locked");
    take_exact(source, 2);
    check(sf_source_lock_exposure(source, 1) == SF_OK, "%s", sf_last_error(guest_context()));
    take_exact(source, 8);
    check(webcam_said(&camera, "exposure mode 1\n"), "not locked: %s", camera.said);
    check(sf_source_lock_exposure(source, 0) == SF_OK, "%s", sf_last_error(guest_context()));
    take_exact(source, 8);
    check(webcam_said(&camera, "exposure mode 8\n"), "not unlocked: %s", camera.said);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

static sf_status try_open(sf_context *context, const char *name) {
    sf_source *source = NULL;
    sf_status status = sf_source_open(context, name, &source);
    sf_source_close(&source);
    return status;
}

static void expect(const char *name, sf_status expected, const char *part) {
    sf_status status = try_open(guest_context(), name);
    check(status == expected, "%s: %s, not %s", name, sf_status_text(status), sf_status_text(expected));
    check(strstr(sf_last_error(guest_context()), part), "%s: \"%s\" says nothing of \"%s\"", name,
          sf_last_error(guest_context()), part);
}

static void refused(void) {
    webcam camera;
    plug(&camera, "");
    expect("libcamera:7", SF_ERR_IO, "\"7\"");
    expect("libcamera:nobody", SF_ERR_IO, "nobody");
    expect("libcamera:0?size=641x479", SF_ERR_UNSUPPORTED, "640x480");
    expect("libcamera:0?format=NV12", SF_ERR_UNSUPPORTED, "YUYV");
    expect("libcamera:0?format=nothing", SF_ERR_ARGUMENT, "nothing");
    expect("libcamera:0?fps=20", SF_ERR_UNSUPPORTED, "fps");
    expect("libcamera:0?exposure=manual:90000000", SF_ERR_ARGUMENT, "90000000");
    expect("libcamera:0?exposure=bright", SF_ERR_ARGUMENT, "bright");
    webcam_unplug(&camera);
}

/* A process has one manager at a time; whoever comes second is refused, and served when the first is done. */
static void one_context(void) {
    webcam camera;
    plug(&camera, "");
    sf_context *other;
    check(sf_context_create(&other, NULL) == SF_OK, "no second context");
    sf_source *source = open_source("libcamera:0?format=MJPEG");
    check(try_open(other, "libcamera:0") == SF_ERR_IO, "two contexts have libcamera");
    check(strstr(sf_last_error(other), "another context"), "%s", sf_last_error(other));
    sf_devices *list;
    check(sf_devices_find(other, &list) == SF_OK, "%s", sf_last_error(other));
    sf_devices_free(&list);
    check(try_open(guest_context(), "libcamera:0") == SF_ERR_IO, "the camera was opened twice");
    take_exact(source, 3);
    sf_source_close(&source);
    check(try_open(other, "libcamera:0") == SF_OK, "%s", sf_last_error(other));
    sf_context_destroy(&other);
    webcam_unplug(&camera);
}

static void newest(void) {
    webcam camera;
    plug(&camera, "");
    sf_source *source = open_source("libcamera:0?format=MJPEG");
    take_exact(source, 2);
    for (int i = 0; i < 50 && counts_of(source).skipped < 3; i++) {
        sleep_ms(200);
        sf_frame frame;
        check(sf_source_newest(source, 5000, &frame) == SF_OK, "%s", sf_last_error(guest_context()));
        check(pattern_id(&frame) > 0, "the pixels are not those that were sent");
        sf_source_release(source, &frame);
    }
    check(counts_of(source).skipped >= 3, "frames that nobody took were not skipped");
    take_exact(source, 5);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

/* An error, said once. What is out stays readable, and closing neither hangs nor ends the program. */
static void unplugged(void) {
    webcam camera;
    plug(&camera, "");
    sf_source *source = open_source("libcamera:0?format=YUYV");
    sf_frame kept, frame;
    next_frame(source, 5000, &kept);
    int64_t id = pattern_id(&kept);
    webcam_unplug(&camera);
    sf_status status = SF_OK;
    for (int i = 0; i < 20 && (status == SF_OK || status == SF_ERR_TIMEOUT); i++) {
        int64_t began = now_ms();
        status = sf_source_next(source, 500, &frame);
        check(now_ms() - began < 20000, "waited for %lld ms", (long long)(now_ms() - began));
        if (status == SF_OK) sf_source_release(source, &frame);
    }
    check(status == SF_ERR_IO, "%s", sf_status_text(status));
    check(was_logged("is gone"), "the loss was not reported");
    check(id >= 0 && pattern_id(&kept) == id, "the frame that was out changed");
    sf_source_release(source, &kept);
    sf_source_close(&source);

    plug(&camera, "");
    source = open_source("libcamera:0?format=YUYV");
    take_exact(source, 5);
    sf_source_close(&source);
    webcam_unplug(&camera);
}

const guest_test libcamera_tests[] = {{"libcamera_yuyv", yuyv},
                                      {"libcamera_mjpeg", mjpeg},
                                      {"libcamera_cut_mjpeg", cut_mjpeg},
                                      {"libcamera_marked_yuyv", marked_yuyv},
                                      {"libcamera_devices", devices},
                                      {"libcamera_controls", controls},
                                      {"libcamera_gain", gain},
                                      {"libcamera_lock", lock},
                                      {"libcamera_refused", refused},
                                      {"libcamera_one_context", one_context},
                                      {"libcamera_newest", newest},
                                      {"libcamera_unplugged", unplugged},
                                      {0}};
