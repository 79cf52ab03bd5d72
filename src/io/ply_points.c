/* ply_points.c - sparse points from .ply files. */
#include <string.h>

#include "../base/memory.h"
#include "ply.h"

enum { POINT_RED = 3, POINT_VALUES = 6 };
static const char *const point_properties[POINT_VALUES] = {"x", "y", "z", "red", "green", "blue"};

/* Colours of other types have no common scale. */
static int has_colors(sf_ply *p) {
    for (int i = POINT_RED; i < POINT_VALUES; i++)
        if (!sf_ply_is_byte(p, point_properties[i])) return 0;
    return 1;
}

static sf_status bind_point(sf_context *ctx, const char *path, sf_ply *p) {
    sf_status status = SF_OK;
    int colors = has_colors(p);
    if (!colors) sf_log(ctx, SF_LOG_INFO, "%s: points without uchar red, green, blue are grey", path);
    for (int i = 0; i < (colors ? POINT_VALUES : POINT_RED) && !status; i++)
        status = sf_ply_bind(p, point_properties[i], i);
    return status;
}

/* In text a number is whatever it is, also where the header says uchar. */
static sf_status take_colors(sf_context *ctx, const char *path, size_t point, const double *values,
                             uint8_t *rgb) {
    for (int i = POINT_RED; i < POINT_VALUES; i++) {
        if (!(values[i] >= 0 && values[i] <= 255))
            return sf_fail(ctx, SF_ERR_FORMAT, "%s: vertex %zu: property %s: %g is not in 0..255", path,
                           point, point_properties[i], values[i]);
        rgb[i - POINT_RED] = (uint8_t)values[i];
    }
    return SF_OK;
}

static sf_status read_points(sf_context *ctx, const char *path, sf_ply *p, double *xyz, uint8_t *rgb) {
    double values[POINT_VALUES] = {0, 0, 0, 128, 128, 128};
    for (size_t i = 0; i < sf_ply_rows(p); i++, xyz += 3, rgb += 3) {
        sf_status status = sf_ply_next_doubles(p, values);
        if (!status) status = take_colors(ctx, path, i, values, rgb);
        if (status) return status;
        for (int k = 0; k < 3; k++) xyz[k] = values[k] + sf_ply_origin(p)[k];
    }
    sf_ply_report_rest(p);
    return SF_OK;
}

sf_status sf_ply_read_points(sf_context *ctx, const char *path, double **xyz, uint8_t **rgb, size_t *count) {
    sf_ply *p;
    *xyz = NULL;
    *rgb = NULL;
    *count = 0;
    sf_status status = sf_ply_open(ctx, path, &p);
    if (!status) status = sf_ply_enter(p, "vertex");
    if (!status) status = bind_point(ctx, path, p);
    if (!status)
        status = sf_memory_check(ctx, path, "points", (uint64_t)sf_ply_rows(p) * (3 * sizeof **xyz + 3));
    if (!status) {
        *xyz = sf_alloc(ctx, sf_ply_rows(p), 3 * sizeof **xyz);
        *rgb = sf_alloc(ctx, sf_ply_rows(p), 3);
        status = *xyz && *rgb ? read_points(ctx, path, p, *xyz, *rgb) : SF_ERR_MEMORY;
    }
    if (!status) {
        *count = sf_ply_rows(p);
    } else {
        sf_free(ctx, *xyz);
        sf_free(ctx, *rgb);
        *xyz = NULL;
        *rgb = NULL;
    }
    sf_ply_close(&p);
    return status;
}
