/* colmap_write.c - see colmap_write.h. */
#include "colmap_write.h"

#include <string.h>

#include "paths.h"

static void put_uint(sf_writer *w, uint64_t value, int bytes) {
    uint8_t data[8];
    for (int i = 0; i < bytes; i++) data[i] = (uint8_t)(value >> (8 * i));
    sf_writer_put(w, data, (size_t)bytes);
}

static void put_double(sf_writer *w, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_uint(w, bits, 8);
}

static void put_doubles(sf_writer *w, const double *values, size_t count) {
    for (size_t i = 0; i < count; i++) put_double(w, values[i]);
}

void sf_colmap_put_count(sf_writer *w, uint64_t count) { put_uint(w, count, 8); }

void sf_colmap_put_camera(sf_writer *w, uint32_t id, int32_t width, int32_t height, const sf_lens *l) {
    enum { PINHOLE = 1, RADIAL = 3, OPENCV = 4, FULL_OPENCV = 6 };
    const double pinhole[] = {l->fx, l->fy, l->cx, l->cy}, radial[] = {l->fx, l->cx, l->cy, l->k1, l->k2},
                 opencv[] = {l->fx, l->fy, l->cx, l->cy, l->k1, l->k2, l->p1, l->p2, l->k3, 0, 0, 0};
    uint32_t model = l->k3 != 0                 ? FULL_OPENCV
                     : l->p1 != 0 || l->p2 != 0 ? OPENCV
                     : l->k1 == 0 && l->k2 == 0 ? PINHOLE
                     : l->fx == l->fy           ? RADIAL
                                                : OPENCV;
    put_uint(w, id, 4);
    put_uint(w, model, 4);
    put_uint(w, (uint64_t)width, 8);
    put_uint(w, (uint64_t)height, 8);
    if (model == PINHOLE) put_doubles(w, pinhole, 4);
    if (model == RADIAL) put_doubles(w, radial, 5);
    if (model == OPENCV) put_doubles(w, opencv, 8);
    if (model == FULL_OPENCV) put_doubles(w, opencv, 12);
}

void sf_colmap_put_image(sf_writer *w, const sf_colmap_image *image) {
    double q[4];
    sf_rotation_to_quat(image->R_cw, q);
    put_uint(w, image->id, 4);
    put_doubles(w, q, 4);
    put_doubles(w, image->t_cw, 3);
    put_uint(w, image->camera, 4);
    sf_writer_put(w, image->name, strlen(image->name) + 1);
    put_uint(w, image->features, 8);
}

void sf_colmap_put_feature(sf_writer *w, double x, double y, uint64_t point) {
    put_double(w, x);
    put_double(w, y);
    put_uint(w, point, 8);
}

void sf_colmap_put_point(sf_writer *w, const sf_colmap_point *point) {
    put_uint(w, point->id, 8);
    put_doubles(w, point->at, 3);
    sf_writer_put(w, point->rgb, 3);
    put_double(w, point->error);
    put_uint(w, point->observations, 8);
}

void sf_colmap_put_observation(sf_writer *w, uint32_t image, uint32_t feature) {
    put_uint(w, image, 4);
    put_uint(w, feature, 4);
}

sf_status sf_colmap_save(sf_context *ctx, const char *folder, const sf_colmap_put puts[3], const void *user) {
    static const char *const names[] = {"cameras.bin", "images.bin", "points3D.bin"};
    sf_status status = SF_OK;
    for (size_t i = 0; i < 3 && !status; i++) {
        sf_writer w;
        char *path = sf_path_join(ctx, folder, names[i]);
        status = path ? sf_writer_open(&w, ctx, path) : SF_ERR_MEMORY;
        if (!status) {
            puts[i](&w, user);
            status = sf_writer_commit(&w);
        }
        sf_free(ctx, path);
    }
    return status;
}
