/* ply_fixture.h - models to be written, and .ply files made by hand. */
#ifndef TESTS_UNIT_PLY_FIXTURE_H
#define TESTS_UNIT_PLY_FIXTURE_H

#include "testing.h"

enum { MAX_COUNT = 64, MAX_K = 16 };

typedef struct values {
    float means[3 * MAX_COUNT], quats[4 * MAX_COUNT], log_scales[3 * MAX_COUNT], logit_opacities[MAX_COUNT];
    float sh[3 * MAX_K * MAX_COUNT];
} values;

/* Points at the arrays of `v`, for sf_model_set and sf_model_get. */
sf_gaussians ply_arrays_of(values *v);

/* A model of the first `count` Gaussians of `v`, at most MAX_COUNT; the caller destroys it. */
sf_model *ply_model_of(sf_context *ctx, values *v, size_t count, int degree);

/* Random values, and among them the ones that a careless conversion would lose. */
void ply_make_values(values *v, uint64_t seed);

/* The same Gaussians at each call with a degree; the caller destroys the model. */
sf_model *ply_make_model(sf_context *ctx, size_t count, int degree);

/* A file made by hand, without the library, in either order of bytes. */
typedef struct file {
    size_t size;
    int big_endian;
    uint8_t data[1 << 15];
} file;

/* Append to the file; the size of an integer is 1 to 8 bytes. */
void ply_put_text(file *f, const char *text);
void ply_put_uint(file *f, uint64_t v, int size);
void ply_put_f32(file *f, float v);
void ply_put_f64(file *f, double v);

/* Writes a file and returns its path: a new file each time, as some file systems flush one that is
 * overwritten, which takes long. */
const char *ply_write_bytes(const void *data, size_t size);
const char *ply_write_file(const file *f);
const char *ply_write_text(const char *text);

/* The properties of degree 0 without normals, and a Gaussian of them. */
#define GAUSSIAN_PROPERTIES                                                                                  \
    "property float x\nproperty float y\nproperty float z\n"                                                 \
    "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n"          \
    "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"                               \
    "property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\n"
enum { GAUSSIAN_VALUES = 14 };
extern const float ply_one_gaussian[GAUSSIAN_VALUES];

/* Appends ply_one_gaussian. */
void ply_put_one_gaussian(file *f);

/* A text file of ply_one_gaussian, twice. */
extern const char ply_ascii_file[];

#define VERTEX(count) "ply\nformat binary_little_endian 1.0\nelement vertex " count "\n"
#define POINT         "property float x\nproperty float y\nproperty float z\n"

#define END "end_header\n"

#endif
