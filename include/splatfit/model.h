/* model.h - a set of 3D Gaussians: the thing that is fitted. */
#ifndef SPLATFIT_MODEL_H
#define SPLATFIT_MODEL_H

#include <stddef.h>

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SF_MAX_SH_DEGREE = 3 };

/* Plain arrays of raw parameters, or of gradients with respect to them. K = (sh_degree + 1)^2. */
typedef struct sf_gaussians {
    float *means;           /* [n][3], world units */
    float *quats;           /* [n][4], w x y z, any norm */
    float *log_scales;      /* [n][3], natural logarithm of the standard deviations, world units */
    float *logit_opacities; /* [n] */
    float *sh;              /* [n][K][3], coefficient-major, RGB innermost (M.4) */
} sf_gaussians;

typedef struct sf_model sf_model;

/* A model of `count` (0 .. 2^31 - 17) neutral Gaussians: mean 0, identity rotation, log-scale 0,
 * logit-opacity -20 (invisible), SH 0. sh_degree 0..3. */
SF_API sf_status sf_model_create(sf_context *context, size_t count, int sh_degree, sf_model **model);
SF_API void sf_model_destroy(sf_model **model);

SF_API size_t sf_model_count(const sf_model *model);
SF_API int sf_model_sh_degree(const sf_model *model);

/* Whether it was fitted with opacity compensation (M.3) and wants to be rendered so. */
SF_API int sf_model_antialiased(const sf_model *model);
SF_API void sf_model_set_antialiased(sf_model *model, int antialiased);

/* Copies Gaussians first .. first+count-1 from or to the caller's arrays; an array that is NULL is left out.
 * Bands that a Gaussian lacks (sf_model_pack) are got as 0. SF_ERR_ARGUMENT, and nothing is copied: the range
 * exceeds the model, or a value to set that is not 0 belongs to a band that its Gaussian lacks. */
SF_API sf_status sf_model_set(sf_model *model, size_t first, size_t count, const sf_gaussians *from);
SF_API sf_status sf_model_get(const sf_model *model, size_t first, size_t count, const sf_gaussians *to);

/* Gives each Gaussian an SH degree of its own: that of its highest band with a value that is not 0. The bands
 * above are let go, with their memory and the time that they take, and Gaussians are sorted by falling
 * degree; those of one degree stay in their order. Pictures stay what they were, but for the order of
 * Gaussians at the same depth. A new or loaded model has all bands for all of its Gaussians, and a file of a
 * packed one is padded with 0s. SF_ERR_MEMORY: the model is what it was. */
SF_API sf_status sf_model_pack(sf_model *model);

/* count[d]: Gaussians that have degree d; and the floats that describe the model, 14 to 59 a Gaussian. */
SF_API void sf_model_degrees(const sf_model *model, size_t count[SF_MAX_SH_DEGREE + 1]);
SF_API size_t sf_model_floats(const sf_model *model);

/* Reads an INRIA .ply (by property name, any order, with or without normals, f_rest and comments). Gaussians
 * with a non-finite value, a zero quaternion or |log-scale| > 20 are left out, counted and reported to the
 * log. */
SF_API sf_status sf_model_load(sf_context *context, const char *path, sf_model **model);

/* Writes an INRIA .ply under a temporary name and renames it; a device, a pipe and "-" (standard output) are
 * written directly. Refuses (SF_ERR_ARGUMENT) a model with values that hurt other tools: see sf_model_load.
 * On failure the file that stood at `path` still stands. */
SF_API sf_status sf_model_save(const sf_model *model, const char *path);

#ifdef __cplusplus
}
#endif
#endif
