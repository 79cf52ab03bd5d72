/* colmap_fixture.h - a COLMAP project, as binary files and as text. */
#ifndef TESTS_UNIT_COLMAP_FIXTURE_H
#define TESTS_UNIT_COLMAP_FIXTURE_H

#include "testing.h"

enum { WIDTH = 24, HEIGHT = 16, PIXELS = WIDTH * HEIGHT };

/* A camera and an image of the project that the tests write. */
typedef struct camera {
    unsigned id;
    int model;
    const char *model_name;
    double width, height;
    int parameters;
    double parameter[16];
} camera;

typedef struct image {
    unsigned id, camera;
    double q[4], t[3];
    const char *name;
    int observations;
} image;

extern const camera colmap_cameras[];
extern const image colmap_images[];

enum { CAMERAS = 3, IMAGES = 4, POINTS = 3 };

/* A file in the making. */
typedef struct buffer {
    uint8_t data[4096];
    size_t size;
} buffer;

/* Append to a file: little-endian integers of `bytes` bytes, doubles, one camera, one image. */
void colmap_add_uint(buffer *b, uint64_t v, int bytes);
void colmap_add_doubles(buffer *b, const double *v, int count);
void colmap_add_camera(buffer *b, const camera *c);
void colmap_add_image(buffer *b, const image *v);

/* The three files of a model. */
typedef struct files {
    buffer cameras, images, points;
} files;

files colmap_binary_files(void);
files colmap_text_files(void);

/* The folder may be there already. */
void colmap_make_folder(const char *path);

/* The colour, 0..1, of pixel i of a picture. */
float colmap_shade(int picture, int i, int channel);
void colmap_write_picture(sf_context *ctx, const char *path, int picture, int width, int height);

/* All pictures into a folder of the project, their sides divided. */
void colmap_write_pictures(sf_context *ctx, const char *project, const char *folder, int divisor);

/* The files of a model into a folder of the project, whose name ends with /. */
void colmap_write_model(const char *project, const char *folder, const files *f, const char *ending);

/* A whole project of binary files in sparse/0, pictures in images. */
const char *colmap_write_project(sf_context *ctx, const char *project);

/* Loading fails with this status, and the error, of one line, holds `part`. */
void colmap_assert_refused_with(sf_context *ctx, const char *path, const sf_load_options *options,
                                sf_status expected, const char *part);
void colmap_assert_refused(sf_context *ctx, const char *path, sf_status expected, const char *part);

/* The log holds `part`. */
void colmap_assert_log(const char *part);

#endif
