/* v4l2.h - cameras through V4L2: "v4l2:/dev/video0?option=value&...". Linux alone. */
#ifndef SF_CAPTURE_V4L2_H
#define SF_CAPTURE_V4L2_H

#include "device_list.h"
#include "source_ops.h"

/* Opens the source for sf_source_open; README.md lists its options. SF_ERR_ARGUMENT: unknown option, value
 * out of range; SF_ERR_IO: no such device, no permission, in use; SF_ERR_UNSUPPORTED: the camera has not what
 * was asked for (named, with what it has), or this is not Linux. */
sf_status sf_v4l2_open(sf_context *ctx, const char *name, sf_source *source);

/* Adds the cameras of this machine, in the order of their numbers. SF_ERR_MEMORY. */
sf_status sf_v4l2_find(sf_context *ctx, sf_devices *devices);

/* The same two through other system calls (v4l2_device.h), which must stay valid until the source is closed.
 */
struct sf_v4l2_sys;
sf_status sf_v4l2_open_with(sf_context *ctx, const struct sf_v4l2_sys *sys, const char *name,
                            sf_source *source);
sf_status sf_v4l2_find_with(sf_context *ctx, const struct sf_v4l2_sys *sys, sf_devices *devices);

#endif
