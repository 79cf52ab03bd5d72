/* devices.c - finds the cameras of the machine. */
#include "device_list.h"
#include "libcamera.h"
#include "v4l2.h"

sf_status sf_devices_find(sf_context *ctx, sf_devices **devices) {
    sf_status status = sf_devices_create(ctx, devices);
    if (status == SF_OK) status = sf_v4l2_find(ctx, *devices);
#ifdef SF_HAVE_LIBCAMERA
    if (status == SF_OK) status = sf_libcamera_find(ctx, *devices);
#endif
    if (status != SF_OK) sf_devices_free(devices);
    return status;
}
