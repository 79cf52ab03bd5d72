/* v4l2_input.c - inputs and timings of devices that digitise a signal, where a camera has none. */
#ifdef __linux__
#include "v4l2_device.h"

#include <errno.h>
#include <string.h>

sf_status sf_v4l2_set_input(sf_v4l2_device *device, const sf_v4l2_settings *settings) {
    if (settings->input < 0) return SF_OK;
    int input = settings->input;
    if (sf_v4l2_ioctl(device, VIDIOC_S_INPUT, &input) == 0) return SF_OK;
    if (errno != EINVAL && errno != ENOTTY) return sf_v4l2_fail(device, "input");
    int inputs = 0;
    for (struct v4l2_input e; inputs < 64; inputs++) {
        memset(&e, 0, sizeof e);
        e.index = (uint32_t)inputs;
        if (sf_v4l2_ioctl(device, VIDIOC_ENUMINPUT, &e)) break;
    }
    return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: input: %d is not there; there are %d, from 0 on",
                   device->path, settings->input, inputs);
}

const char *sf_v4l2_signal(sf_v4l2_device *device) {
    int index = 0;
    if (sf_v4l2_ioctl(device, VIDIOC_G_INPUT, &index)) return NULL;
    struct v4l2_input input = {.index = (uint32_t)index};
    if (sf_v4l2_ioctl(device, VIDIOC_ENUMINPUT, &input)) return NULL;
    if (input.status & V4L2_IN_ST_NO_POWER) return "no power";
    if (input.status & V4L2_IN_ST_NO_SIGNAL) return "no signal";
    if (input.status & (V4L2_IN_ST_NO_SYNC | V4L2_IN_ST_NO_H_LOCK)) return "no lock on the signal";
    return NULL;
}

static sf_status find_timings(sf_v4l2_device *device, const sf_v4l2_settings *settings,
                              struct v4l2_dv_timings *timings) {
    enum { MOST_TIMINGS = 512 };
    int32_t width, height;
    if (strcmp(settings->timings, "auto") == 0) {
        if (sf_v4l2_ioctl(device, VIDIOC_QUERY_DV_TIMINGS, timings) == 0) return SF_OK;
        return sf_v4l2_fail(device, "timings: auto: none are found");
    }
    if (!sf_v4l2_parse_size(settings->timings, &width, &height))
        return sf_fail(device->ctx, SF_ERR_ARGUMENT, "%s: timings: \"%s\" is neither auto nor WIDTHxHEIGHT",
                       device->path, settings->timings);
    for (uint32_t i = 0; i < MOST_TIMINGS; i++) {
        struct v4l2_enum_dv_timings e = {.index = i};
        if (sf_v4l2_ioctl(device, VIDIOC_ENUM_DV_TIMINGS, &e)) break;
        if (e.timings.bt.width == (uint32_t)width && e.timings.bt.height == (uint32_t)height &&
            !e.timings.bt.interlaced) {
            *timings = e.timings;
            return SF_OK;
        }
    }
    return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: timings: the input has none of %s", device->path,
                   settings->timings);
}

sf_status sf_v4l2_set_timings(sf_v4l2_device *device, const sf_v4l2_settings *settings) {
    struct v4l2_dv_timings timings;
    memset(&timings, 0, sizeof timings);
    if (!*settings->timings) return SF_OK;
    sf_status status = find_timings(device, settings, &timings);
    if (status == SF_OK && sf_v4l2_ioctl(device, VIDIOC_S_DV_TIMINGS, &timings))
        status = sf_v4l2_fail(device, "timings");
    return status;
}
#endif
