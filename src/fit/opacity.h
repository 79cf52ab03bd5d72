/* opacity.h - the opacity of a Gaussian made by a split, merge or relocation. */
#ifndef SF_FIT_OPACITY_H
#define SF_FIT_OPACITY_H

#include <math.h>

#include "../scene/gaussian_math.h"
#include "../scene/gaussians.h"

/* Sets the opacity within limits: not so low that pruning removes it at once, nor so high that it has no
 * gradient. */
static inline void sf_set_opacity(const sf_params *p, size_t i, float opacity) {
    p->field[SF_FIELD_logit_opacity][i] = sf_logitf(fminf(fmaxf(opacity, 0.006f), 0.995f));
}

#endif
