/* libcamera_name.h - what the name of a camera of libcamera asks for. */
#ifndef SF_CAPTURE_LIBCAMERA_NAME_H
#define SF_CAPTURE_LIBCAMERA_NAME_H

#include "../base/context.h"

typedef struct sf_libcamera_request {
    char camera[192]; /* its index or its id */
    char size[32], format[16], exposure[32];
    int32_t width, height; /* 0: the camera's choice */
    double fps, gain;      /* 0: the camera's choice */
    int exposure_us;       /* 0: the camera's choice, -1: automatic */
    unsigned buffers;
} sf_libcamera_request;

/* Reads "libcamera:INDEX_OR_ID?option=value&...". SF_ERR_ARGUMENT: names no camera, or an option is unknown
 * or has a value that is out of its range. */
sf_status sf_libcamera_read_name(sf_context *ctx, const char *name, sf_libcamera_request *request);

/* Whether the camera of that number and id is the one asked for. */
int sf_libcamera_is_meant(const sf_libcamera_request *request, size_t index, const char *id);

/* Writes a name that opens the camera: "libcamera:ID", with its number where the id cannot stand in a name.
 */
void sf_libcamera_write_name(size_t index, const char *id, char *name, size_t bytes);

#endif
