/* in_view.h - whether any of many Gaussians may be in the picture, from the box around their means and their
 * largest scale alone. */
#ifndef SF_RENDER_IN_VIEW_H
#define SF_RENDER_IN_VIEW_H

#include "../kernels/kernels.h"

enum { SF_FRUSTUM_SIDES = 5 };

/* Gaussians are out of view where normal . p + reach s + offset < 0 at one of the sides for all of them; p:
 * mean, s: largest standard deviation. */
typedef struct sf_frustum {
    double normal[SF_FRUSTUM_SIDES][3], offset[SF_FRUSTUM_SIDES], reach[SF_FRUSTUM_SIDES];
} sf_frustum;

sf_frustum sf_frustum_of(const sf_eye *eye);

/* Whether projection would find all Gaussians of blocks first .. end-1 out of view. 0 where that is not sure,
 * or a mean or scale is not finite; quaternions and opacities are not looked at. */
int sf_are_out_of_view(const sf_frustum *frustum, const sf_params *params, size_t first, size_t end);

#endif
