/* local_units.h - the unit of length of each Gaussian: half the size of a picture at its depth. */
#ifndef SF_FIT_LOCAL_UNITS_H
#define SF_FIT_LOCAL_UNITS_H

#include "../render/workspace.h"
#include "fitter.h"

/* Half the geometric mean of width and height of the eye's picture, at depth 1. */
double sf_half_picture(const sf_eye *eye);

/* Takes the depths of the Gaussians of blocks first .. end-1 in the present view into their units. */
void sf_note_units(sf_fitter *fitter, size_t first, size_t end);

/* The unit of Gaussian i in world units; 0: no view has seen it yet. */
static inline float sf_unit_of(const sf_fitter *fitter, size_t i) {
    float inverse = fitter->units.inverse[i];
    return inverse > 0 ? 1 / inverse : 0;
}

#endif
