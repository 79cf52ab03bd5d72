/* opacity.h - the opacity of a Gaussian that a split, merge or relocation has just made. */
#ifndef SF_FIT_OPACITY_H
#define SF_FIT_OPACITY_H

#include <math.h>

#include "../scene/gaussian_math.h"
#include "../scene/gaussians.h"

/* Sets it: neither so faint that it is removed at once nor so opaque that it
 * cannot learn. */
static inline void sf_set_opacity(const sf_params *p, size_t i, float opacity) {
    p->field[SF_FIELD_logit_opacity][i] = sf_logitf(fminf(fmaxf(opacity, 0.006f), 0.995f));
}

#endif
