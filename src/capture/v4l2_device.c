/* v4l2_device.c - opens a V4L2 node, finds out what it is, and calls it. */
#ifdef __linux__
#include "v4l2_device.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "format.h"

int sf_v4l2_ioctl(sf_v4l2_device *device, unsigned long request, void *arg) {
    enum { INTERRUPTIONS = 100 };
    int result = -1;
    for (int i = 0; i < INTERRUPTIONS; i++) {
        result = device->sys->ioctl(device->sys->user, device->fd, request, arg);
        if (result >= 0 || errno != EINTR) break;
    }
    if (result >= 0) return 0;
    if (errno == ENODEV || errno == ENXIO) device->gone = 1;
    return -1;
}

int sf_v4l2_ioctl_again(sf_v4l2_device *device, unsigned long request, void *arg) {
    for (int i = 0, pause_ms = 5;; i++, pause_ms *= 2) {
        if (sf_v4l2_ioctl(device, request, arg) == 0) return 0;
        int moment = errno == EINVAL || errno == EIO || errno == EAGAIN;
        if (!moment || i + 1 == SF_V4L2_TRIES) return -1;
        int error = errno;
        sf_log(device->ctx, SF_LOG_DEBUG, "%s: a call failed (%s) and is tried again", device->path,
               strerror(error));
        device->sys->sleep_ms(device->sys->user, pause_ms);
        errno = error;
    }
}

sf_status sf_v4l2_fail(const sf_v4l2_device *device, const char *what) {
    const char *advice = errno == EBUSY ? ": in use by another program"
                         : errno == ENOSPC
                             ? ": more than the bus carries: a smaller size, MJPEG, fewer frames"
                             : "";
    return sf_fail(device->ctx, SF_ERR_IO, "%s: %s: %s%s", device->path, what, strerror(errno), advice);
}

static sf_status fail_to_open(const sf_v4l2_device *device) {
    const char *advice = errno == EACCES || errno == EPERM ? ": is the user in the group video?"
                         : errno == ENOENT                 ? ": \"splatfit devices\" lists the cameras"
                         : errno == EBUSY                  ? ": in use by another program"
                                                           : "";
    return sf_fail(device->ctx, SF_ERR_IO, "%s: cannot be opened: %s%s", device->path, strerror(errno),
                   advice);
}

int sf_v4l2_device_answers(sf_v4l2_device *device) {
    struct v4l2_capability what;
    memset(&what, 0, sizeof what);
    return !device->gone && sf_v4l2_ioctl(device, VIDIOC_QUERYCAP, &what) == 0;
}

int sf_v4l2_parse_size(const char *text, int32_t *width, int32_t *height) {
    enum { MOST = 16384 };
    return sf_frame_parse_size(text, width, height) && *width <= MOST && *height <= MOST;
}

/* What the node is good for: the type of its buffers. */
static sf_status take_capability(sf_v4l2_device *device) {
    struct v4l2_capability what;
    memset(&what, 0, sizeof what);
    if (sf_v4l2_ioctl(device, VIDIOC_QUERYCAP, &what)) {
        if (errno != ENOTTY && errno != EINVAL && errno != ENOSYS) /* which qemu-user says */
            return sf_v4l2_fail(device, "cannot be asked what it is");
        return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: is no V4L2 device", device->path);
    }
    uint32_t can = what.capabilities & V4L2_CAP_DEVICE_CAPS ? what.device_caps : what.capabilities;
    device->type = can & V4L2_CAP_VIDEO_CAPTURE          ? V4L2_BUF_TYPE_VIDEO_CAPTURE
                   : can & V4L2_CAP_VIDEO_CAPTURE_MPLANE ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE
                                                         : 0;
    if (!device->type || !(can & V4L2_CAP_STREAMING))
        return sf_fail(device->ctx, SF_ERR_UNSUPPORTED, "%s: is no camera that streams (device_caps 0x%08x)",
                       device->path, (unsigned)can);
    memcpy(device->card, what.card, sizeof device->card - 1);
    memcpy(device->bus, what.bus_info, sizeof device->bus - 1);
    return SF_OK;
}

sf_status sf_v4l2_device_open(sf_context *ctx, const sf_v4l2_sys *sys, const char *path,
                              sf_v4l2_device *device) {
    memset(device, 0, sizeof *device);
    device->ctx = ctx;
    device->sys = sys;
    snprintf(device->path, sizeof device->path, "%s", path);
    device->fd = sys->open(sys->user, path);
    if (device->fd < 0) return fail_to_open(device);
    sf_status status = take_capability(device);
    if (status != SF_OK) {
        sf_v4l2_device_close(device);
        return status;
    }
    sys->identify(sys->user, device->fd, device->serial, sizeof device->serial, &device->index);
    return SF_OK;
}

void sf_v4l2_device_close(sf_v4l2_device *device) {
    if (device->fd >= 0) device->sys->close(device->sys->user, device->fd);
    device->fd = -1;
}
#endif
