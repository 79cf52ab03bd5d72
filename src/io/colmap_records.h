/* colmap_records.h - what COLMAP's files hold, binary or text: cameras, images and points, checked and taken
 * into a project. */
#ifndef SF_IO_COLMAP_RECORDS_H
#define SF_IO_COLMAP_RECORDS_H

#include "dataset.h"
#include "optics.h"

typedef struct sf_colmap_camera {
    uint32_t id;
    int width, height;
    int supported; /* 0: pictures of this camera cannot be read */
    sf_optics lens;
} sf_colmap_camera;

typedef struct sf_colmap_reader {
    sf_context *ctx;
    sf_project *project;
    const char *model;         /* folder of the three files */
    const char *pictures;      /* folder of the pictures */
    char *file;                /* the one being read */
    sf_colmap_camera *cameras; /* sorted by id once all are read */
    size_t camera_count, camera_capacity;
    uint32_t *image_ids;
    size_t image_count, image_capacity;
    size_t xyz_capacity, rgb_capacity; /* of the project's points */
} sf_colmap_reader;

typedef struct sf_colmap_camera_record {
    uint64_t width, height;
    double parameters[SF_OPTICS_PARAMETERS];
    uint32_t id;
    const sf_lens_model *model;
} sf_colmap_camera_record;

typedef struct sf_colmap_image_record {
    uint32_t id, camera;
    double q[4], t[3];
    const char *name;
} sf_colmap_image_record;

typedef struct sf_colmap_point_record {
    double xyz[3];
    uint8_t rgb[3];
} sf_colmap_point_record;

/* Each fails with the file's name, SF_ERR_FORMAT: a value is out of its range, an image names no camera. */
sf_status sf_colmap_add_camera(sf_colmap_reader *r, const sf_colmap_camera_record *record);
sf_status sf_colmap_add_image(sf_colmap_reader *r, const sf_colmap_image_record *record);
sf_status sf_colmap_add_point(sf_colmap_reader *r, const sf_colmap_point_record *record);

sf_status sf_colmap_make_room_for_points(sf_colmap_reader *r, size_t more);

/* After the last of a file. SF_ERR_FORMAT: an id appears twice. */
sf_status sf_colmap_sort_cameras(sf_colmap_reader *r);
sf_status sf_colmap_check_image_ids(sf_colmap_reader *r);

/* SF_ERR_UNSUPPORTED, with the camera's model and what to do. */
sf_status sf_colmap_unsupported(sf_colmap_reader *r, const sf_colmap_camera *c);

#endif
