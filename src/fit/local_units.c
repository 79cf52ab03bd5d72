/* local_units.c - see local_units.h. The unit is the harmonic mean over the last views that saw the Gaussian:
 * 1 / unit is how many half pictures it moves by for a step of length 1, in the mean over these views. */
#include "local_units.h"

#include <math.h>

/* Weight of a new view in the mean. */
#define WEIGHT 0.05f

double sf_half_picture(const sf_eye *eye) {
    return 0.5 * sqrt((double)eye->width * eye->height / ((double)eye->fx * (double)eye->fy));
}

void sf_note_units(sf_fitter *f, size_t first, size_t end) {
    const sf_workspace *ws = &f->workspace;
    size_t last = end * SF_LANES < f->model->count ? end * SF_LANES : f->model->count;
    float half = (float)sf_half_picture(&ws->eye);
    for (size_t i = first * SF_LANES; i < last; i++) {
        if (ws->state[i] != SF_SEEN) continue;
        float *inverse = &f->units.inverse[i], now = 1 / (half * ws->splats[i].depth);
        *inverse = *inverse > 0 ? *inverse + WEIGHT * (now - *inverse) : now;
    }
}
