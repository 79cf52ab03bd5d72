/* device_list.h - the list of cameras. */
#ifndef SF_CAPTURE_DEVICE_LIST_H
#define SF_CAPTURE_DEVICE_LIST_H

#include "../base/context.h"

#include <splatfit/source.h>

#ifdef __cplusplus
extern "C" {
#endif

/* An empty list, for sf_devices_free. */
sf_status sf_devices_create(sf_context *ctx, sf_devices **devices);

/* Adds a camera and its `count` modes, both copied; info->modes is set from `count`. SF_ERR_MEMORY. */
sf_status sf_devices_add(sf_devices *devices, const sf_device_info *info, const sf_device_mode *modes,
                         size_t count);

#ifdef __cplusplus
}
#endif
#endif
