/* libcamera.h - cameras through libcamera: "libcamera:INDEX_OR_ID?option=value&...".
 *
 * README.md beside this file lists the options. Without libcamera, SF_HAVE_LIBCAMERA is not defined, and
 * every name is SF_ERR_UNSUPPORTED.
 */
#ifndef SF_CAPTURE_LIBCAMERA_H
#define SF_CAPTURE_LIBCAMERA_H

#include "device_list.h"
#include "source_ops.h"

#ifdef SF_HAVE_LIBCAMERA

#ifdef __cplusplus
extern "C" {
#endif

/* Opens the source for sf_source_open. SF_ERR_ARGUMENT: unknown option, value out of range; SF_ERR_IO: no
 * such camera, in use by another program or by another context of this one; SF_ERR_UNSUPPORTED: the camera
 * has not what was asked for (named, with what it has). */
sf_status sf_libcamera_open(sf_context *ctx, const char *name, sf_source *source);

/* Adds the cameras that libcamera finds. SF_ERR_MEMORY; no camera is no error. */
sf_status sf_libcamera_find(sf_context *ctx, sf_devices *devices);

#ifdef __cplusplus
}
#endif

#else

static inline sf_status sf_libcamera_open(sf_context *ctx, const char *name, sf_source *source) {
    (void)source;
    return sf_fail(ctx, SF_ERR_UNSUPPORTED, "%s: this splatfit was built without libcamera", name);
}

#endif
#endif
