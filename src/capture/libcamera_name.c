/* libcamera_name.c - see libcamera_name.h. */
#include "libcamera_name.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/query.h"
#include "format.h"
#include "libcamera_format.h"

static sf_status read_size(sf_context *ctx, const char *name, sf_libcamera_request *request) {
    if (*request->size && !sf_frame_parse_size(request->size, &request->width, &request->height))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: size: \"%s\" is not WIDTHxHEIGHT", name, request->size);
    return SF_OK;
}

static sf_status read_exposure(sf_context *ctx, const char *name, sf_libcamera_request *request) {
    char more;
    if (!*request->exposure) return SF_OK;
    if (strcmp(request->exposure, "auto") == 0) {
        request->exposure_us = -1;
        return SF_OK;
    }
    if (sscanf(request->exposure, "manual:%9d%c", &request->exposure_us, &more) != 1 ||
        request->exposure_us < 1)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: exposure: \"%s\" is neither auto nor manual:MICROSECONDS",
                       name, request->exposure);
    return SF_OK;
}

sf_status sf_libcamera_read_name(sf_context *ctx, const char *name, sf_libcamera_request *request) {
    enum { FPS, GAIN, BUFFERS, SIZE, FORMAT, EXPOSURE, OPTIONS };
    sf_query_option options[OPTIONS] = {
        {"fps", 0, 0.01, 1000, 0, NULL, 0},
        {"gain", 0, 0.001, 1000, 0, NULL, 0},
        {"buffers", 4, 3, 32, 1, NULL, 0}, /* two may be out, and the camera needs one */
        {"size", 0, 0, 0, 0, request->size, sizeof request->size},
        {"format", 0, 0, 0, 0, request->format, sizeof request->format},
        {"exposure", 0, 0, 0, 0, request->exposure, sizeof request->exposure}};
    *request = (sf_libcamera_request){0};
    const char *id = strchr(name, ':') + 1;
    size_t length = strcspn(id, "?");
    if (length == 0 || length >= sizeof request->camera)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: names no camera: libcamera:0, or a camera's id", name);
    memcpy(request->camera, id, length);
    request->camera[length] = 0;
    sf_status status = sf_query_parse(ctx, name, options, OPTIONS);
    if (status == SF_OK) status = read_size(ctx, name, request);
    if (status == SF_OK) status = read_exposure(ctx, name, request);
    if (status != SF_OK) return status;
    if (*request->format && !sf_libcamera_format_named(request->format))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: format: \"%s\" is none that libcamera and splatfit share",
                       name, request->format);
    request->fps = options[FPS].value;
    request->gain = options[GAIN].value;
    request->buffers = (unsigned)options[BUFFERS].value;
    return SF_OK;
}

int sf_libcamera_is_meant(const sf_libcamera_request *request, size_t index, const char *id) {
    int is_number = strspn(request->camera, "0123456789") == strlen(request->camera);
    return is_number ? strtoul(request->camera, NULL, 10) == index : strcmp(request->camera, id) == 0;
}

void sf_libcamera_write_name(size_t index, const char *id, char *name, size_t bytes) {
    if (strlen(id) + sizeof "libcamera:" > bytes || strchr(id, '?'))
        snprintf(name, bytes, "libcamera:%zu", index);
    else
        snprintf(name, bytes, "libcamera:%s", id);
}
