/* gaussians.h - the inside of sf_model: the fields as the kernels take them. */
#ifndef SF_SCENE_GAUSSIANS_H
#define SF_SCENE_GAUSSIANS_H

#include "../base/context.h"
#include "../kernels/kernels.h"

#include <splatfit/model.h>

/* The logit-opacity of what is not to be seen. */
#define SF_INVISIBLE (-20.0f)

/* Greatest |log-scale|: beyond it a file hurts other tools, and is not written. */
#define SF_LOG_SCALE_MOST 20.0f

struct sf_model {
    sf_context *ctx;
    size_t count, capacity; /* Gaussians; arrays hold capacity, a multiple of SF_LANES */
    int sh_degree;
    int antialiased;
    sf_params params; /* lanes count .. capacity-1 are neutral */
};

/* Components of a field, and whether a model of a degree stores it. */
int sf_field_components(int field);
int sf_field_stored(int field, int sh_degree);

/* Arrays for `capacity` Gaussians (rounded up to SF_LANES), zeroed. On failure none is left. */
sf_status sf_params_create(sf_context *ctx, size_t capacity, int sh_degree, sf_params *params);
void sf_params_destroy(sf_context *ctx, sf_params *params);

/* Copies Gaussian `from` of `source` to Gaussian `to` of `params`; both store the same fields. */
void sf_params_copy(const sf_params *source, size_t from, const sf_params *params, size_t to);

/* Blocks of SF_LANES that hold `count` Gaussians. */
static inline size_t sf_blocks(size_t count) { return (count + SF_LANES - 1) / SF_LANES; }

/* A model with room for `capacity` and none used yet. */
sf_status sf_model_create_room(sf_context *ctx, size_t capacity, int sh_degree, sf_model **model);

/* Sets count <= capacity; lanes that leave become neutral. */
void sf_model_resize(sf_model *model, size_t count);

/* A copy with room for `capacity` >= count and bands up to sh_degree (new ones 0, lost ones dropped). */
sf_status sf_model_copy(const sf_model *model, size_t capacity, int sh_degree, sf_model **copy);

/* Copies from blocked arrays to the caller's plain ones, and back. */
void sf_params_get(const sf_params *params, int sh_degree, size_t first, size_t count,
                   const sf_gaussians *to);

#endif
