/* half_model.h - a copy of a model in about half of its memory: all values but means as 16-bit floats.
 *
 * Rounded to 11 bits, and to 0 below 2^-14: colours by less than a tenth of a step of 1/255, lengths of axes
 * by less than 0.5 %. Means keep all their bits, for they are far from 0 where a scene is large.
 */
#ifndef SF_SCENE_HALF_MODEL_H
#define SF_SCENE_HALF_MODEL_H

#include "gaussians.h"

typedef struct sf_half_model {
    size_t banded[SF_BANDS]; /* as of sf_model */
    int sh_degree, antialiased, unit;
    double origin[3];
    void *field[SF_FIELD_COUNT]; /* whole blocks; NULL: not stored */
    size_t bytes[SF_FIELD_COUNT];
} sf_half_model;

/* Puts the model in the place of what the copy held, which begins as zeros. On failure the copy is empty.
 * SF_ERR_MEMORY. */
sf_status sf_half_model_set(const sf_model *model, sf_half_model *half);
int sf_half_model_is_empty(const sf_half_model *half);
void sf_half_model_free(sf_context *ctx, sf_half_model *half);

/* How many values of a field there are; copies values first .. first+count-1 of them as floats. */
size_t sf_half_model_values(const sf_half_model *half, int field);
void sf_half_model_expand(const sf_half_model *half, int field, size_t first, size_t count, float *to);

/* Replaces a model's Gaussians, as sf_model_assign does; there must be room. */
void sf_half_model_get(const sf_half_model *half, sf_model *model);
/* A new model with the same Gaussians. SF_ERR_MEMORY. */
sf_status sf_half_model_copy(const sf_half_model *half, sf_context *ctx, sf_model **model);

#endif
