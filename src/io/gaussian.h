/* gaussian.h - one Gaussian on its way between a file and a model. */
#ifndef SF_IO_GAUSSIAN_H
#define SF_IO_GAUSSIAN_H

#include "../scene/gaussians.h"

enum {
    SF_MAX_COEFFICIENTS = (SF_MAX_SH_DEGREE + 1) * (SF_MAX_SH_DEGREE + 1),
    /* Of a Gaussian: mean, quaternion, log-scales, logit-opacity, SH. */
    SF_GAUSSIAN_MOST = 11 + 3 * SF_MAX_COEFFICIENTS
};

typedef struct sf_gaussian {
    float values[SF_GAUSSIAN_MOST];
} sf_gaussian;

/* The fields of a Gaussian, SH with as many coefficients as the degree at hand has. */
sf_gaussians sf_gaussian_fields(sf_gaussian *g);

/* SH coefficients of a degree. */
static inline int sf_coefficients(int sh_degree) { return (sh_degree + 1) * (sh_degree + 1); }

/* A value as INRIA's .ply has it: its name, and where it is in `values`. */
typedef struct sf_file_value {
    char name[24];
    int at;
} sf_file_value;

/* The values of a degree, in the order of the file (which has normals after the first three); returns how
 * many. */
int sf_gaussian_values(int sh_degree, sf_file_value list[SF_GAUSSIAN_MOST]);

/* Negates axes of a Gaussian's frame: y and z together are half a turn about x. */
enum { SF_FLIP_X = 1, SF_FLIP_Y = 2, SF_FLIP_Z = 4 };
void sf_gaussian_flip(sf_gaussian *g, int sh_degree, unsigned axes);

/* Whether a Gaussian would hurt whoever reads it, and by which value. */
typedef struct sf_fault {
    char text[64];
} sf_fault;

int sf_gaussian_is_faulty(const sf_gaussian *g, const sf_file_value *list, int values, sf_fault *found);

/* SF_ERR_ARGUMENT: a Gaussian of the model is faulty; the message says that `path` was not written. */
sf_status sf_model_check(const sf_model *model, const char *path);

/* Gaussians of a file becoming a model: faulty ones are left out and counted, infinite opacities and
 * log-scales below the least are moved to the ends of what a model holds, and counted. */
typedef struct sf_model_builder {
    sf_context *ctx;
    const char *path;
    sf_model *model;
    sf_file_value list[SF_GAUSSIAN_MOST];
    int values;
    size_t part, parts; /* of the pieces; parts 0: all are kept */
    size_t offered, usable, kept, moved, first_skipped;
    sf_fault first_fault;
} sf_model_builder;

/* A model with room for `count` Gaussians of a degree, or, as the options say (NULL: all), for the pieces of
 * one part. */
sf_status sf_model_builder_begin(sf_model_builder *in, sf_context *ctx, const char *path, size_t count,
                                 int sh_degree, const sf_model_file_options *options);
sf_status sf_model_builder_put(sf_model_builder *in, sf_gaussian *g);
/* After the last one: reports what was left out, and gives the model away. SF_ERR_FORMAT where there were
 * Gaussians and all were left out; the builder is abandoned then. */
sf_status sf_model_builder_end(sf_model_builder *in, int antialiased, sf_model **model);
/* After a failure. */
void sf_model_builder_abandon(sf_model_builder *in);

#endif
