/* near_plane.c - the near plane of a view, from what the model has in its picture. */
#include "near_plane.h"

#include <float.h>
#include <math.h>

#include "../base/statistics.h"

/* The near plane is NEAR_PART times the NEAR_SHARE quantile of the depths of the Gaussians in the picture,
 * out of at most SAMPLES of the model's. */
#define SAMPLES    2048
#define NEAR_SHARE 0.02
#define NEAR_PART  0.1

float sf_near_plane_of(const sf_model *model, const sf_eye *eye) {
    float depths[SAMPLES];
    size_t stride = (model->count + SAMPLES - 1) / SAMPLES, n = 0;
    for (size_t i = 0; i < model->count; i += stride) {
        float p[3], at[3];
        for (int k = 0; k < 3; k++) p[k] = *sf_value(&model->params, SF_FIELD_mean, i, k);
        for (int k = 0; k < 3; k++)
            at[k] = eye->R[3 * k] * p[0] + eye->R[3 * k + 1] * p[1] + eye->R[3 * k + 2] * p[2] + eye->t[k];
        float u = eye->fx * at[0] + (eye->cx * at[2]), v = eye->fy * at[1] + (eye->cy * at[2]);
        int inside = at[2] > 0 && isfinite(at[2]) && u >= 0 && v >= 0 && u <= (float)eye->width * at[2] &&
                     v <= (float)eye->height * at[2];
        depths[n] = at[2];
        n += (size_t)inside;
    }
    float nearest = n ? sf_rankedf(depths, n, (size_t)(NEAR_SHARE * (double)n)) : 0;
    return fmaxf((float)NEAR_PART * nearest, FLT_MIN);
}
