/* libcamera_device.h - a camera of libcamera's as messages name it, and the devices of the kernel behind it.
 */
#ifndef SF_CAPTURE_LIBCAMERA_DEVICE_H
#define SF_CAPTURE_LIBCAMERA_DEVICE_H

#include <sys/types.h>

#include "../base/context.h"

/* All 0 to begin with, but for ctx and id. */
typedef struct sf_libcamera_device {
    sf_context *ctx;
    const char *id; /* libcamera's name of it, libcamera's own */
    dev_t *nodes;   /* none: not known */
    size_t count, capacity;
} sf_libcamera_device;

/* Fails with "libcamera: ID: ..." and the words for `error`, an errno of either sign, if it is not 0. */
sf_status sf_libcamera_fail(const sf_libcamera_device *device, sf_status status, int error,
                            const char *format, ...) SF_PRINTF(4, 5);

/* Notes a device behind the camera. SF_ERR_MEMORY. */
sf_status sf_libcamera_add_node(sf_libcamera_device *device, dev_t node);

/* Notes those of `folder` ("/sys/class/video4linux") that `is_its` says are behind it. SF_ERR_MEMORY; a
 * folder that is missing is no error. */
sf_status sf_libcamera_find_nodes(sf_libcamera_device *device, const char *folder,
                                  int (*is_its)(void *user, dev_t node), void *user);

/* Whether the kernel still has all devices behind it. */
int sf_libcamera_present(const sf_libcamera_device *device);

/* Forgets the devices. */
void sf_libcamera_forget(sf_libcamera_device *device);

#endif
