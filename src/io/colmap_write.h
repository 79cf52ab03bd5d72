/* colmap_write.h - COLMAP's binary files cameras.bin, images.bin and points3D.bin, record by record. */
#ifndef SF_IO_COLMAP_WRITE_H
#define SF_IO_COLMAP_WRITE_H

#include <splatfit/camera.h>

#include "../base/file.h"

/* Writes a file's contents: the count of its records, then the records. */
typedef void (*sf_colmap_put)(sf_writer *w, const void *user);

/* Writes cameras.bin, images.bin and points3D.bin, in this order, into a folder that exists. SF_ERR_IO,
 * SF_ERR_MEMORY. */
sf_status sf_colmap_save(sf_context *ctx, const char *folder, const sf_colmap_put puts[3], const void *user);

void sf_colmap_put_count(sf_writer *w, uint64_t count);

/* PINHOLE without distortion; RADIAL where k1, k2 and one focal length are all; else OPENCV, or FULL_OPENCV
 * with k3. */
void sf_colmap_put_camera(sf_writer *w, uint32_t id, int32_t width, int32_t height, const sf_lens *lens);

/* An image and how many features follow it. */
typedef struct sf_colmap_image {
    uint32_t id, camera;
    const double *R_cw, *t_cw; /* [9], [3] */
    const char *name;
    uint64_t features;
} sf_colmap_image;

void sf_colmap_put_image(sf_writer *w, const sf_colmap_image *image);
/* px; point UINT64_MAX: of none. */
void sf_colmap_put_feature(sf_writer *w, double x, double y, uint64_t point);

/* A point and how many observations follow it. */
typedef struct sf_colmap_point {
    uint64_t id;
    const double *at; /* [3] */
    uint8_t rgb[3];
    double error; /* px */
    uint64_t observations;
} sf_colmap_point;

void sf_colmap_put_point(sf_writer *w, const sf_colmap_point *point);
/* By the image's id, and the index of its feature. */
void sf_colmap_put_observation(sf_writer *w, uint32_t image, uint32_t feature);

#endif
