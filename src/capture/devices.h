/* devices.h - the list of cameras, and who fills it in. */
#ifndef SF_CAPTURE_DEVICES_H
#define SF_CAPTURE_DEVICES_H

#include "../base/context.h"

#include <splatfit/source.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Adds a camera and its `count` modes, both copied; info->modes is set from `count`. SF_ERR_MEMORY. */
sf_status sf_devices_add(sf_devices *devices, const sf_device_info *info, const sf_device_mode *modes,
                         size_t count);

#ifdef SF_HAVE_LIBCAMERA
/* Adds the cameras that libcamera finds. SF_ERR_MEMORY; no camera is no error. */
sf_status sf_libcamera_find(sf_context *ctx, sf_devices *devices);
#endif

#ifdef __cplusplus
}
#endif
#endif
