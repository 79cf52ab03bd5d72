/* densify.h - what growth and relocation share. */
#ifndef SF_FIT_DENSIFY_H
#define SF_FIT_DENSIFY_H

#include <math.h>

#include "../scene/gaussian_math.h"
#include "fitter.h"

/* Of what was made by growth: neither faint enough to go at once nor too opaque to learn. */
static inline void sf_set_opacity(const sf_params *p, size_t i, float opacity) {
    p->field[SF_FIELD_logit_opacity][i] = sf_logitf(fminf(fmaxf(opacity, 0.006f), 0.995f));
}

/* Column `axis` of the rotation of Gaussian i (M.1), [3]. */
void sf_axis_of(const sf_params *params, size_t i, int axis, float *direction);

/* Least logit-opacity of what is kept. */
float sf_min_logit_opacity(const sf_fitter *fitter);
/* Whether Gaussian i is finite, not fainter, and not scored to go. */
int sf_is_kept(const sf_fitter *fitter, size_t i, float faintest);

/* select_floaters.c: scores -1, to go, what a training camera is inside of, and what stands before what one
 * sees. On failure nothing is. */
sf_status sf_mark_floaters(sf_fitter *fitter);

#endif
