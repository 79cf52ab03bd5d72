/* near_plane.c - the near plane of a view, from what the model has in its picture. */
#include "near_plane.h"

#include <float.h>
#include <math.h>

#include "../base/statistics.h"
#include "../cluster/cluster.h"

/* The near plane is NEAR_PART times the NEAR_SHARE quantile of the depths of the Gaussians in the picture,
 * out of at most SAMPLES of the model's. */
#define SAMPLES    2048
#define NEAR_SHARE 0.02
#define NEAR_PART  0.1

/* Depths in the picture, of at most `most` Gaussians; returns how many. */
static size_t sample_depths(const sf_model *model, const sf_eye *eye, size_t most, float *depths) {
    size_t stride = (model->count + most - 1) / most, n = 0;
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
    return n;
}

/* Those of all ranks, each of which samples a part; the unused places of a rank have NAN. */
static size_t gather_depths(const sf_model *model, const sf_eye *eye, sf_cluster *cluster, float *depths) {
    size_t most = (size_t)(SAMPLES / cluster->size), n = 0;
    float mine[SAMPLES];
    if (!most) return 0; /* more ranks than samples */
    size_t found = sample_depths(model, eye, most, mine);
    while (found < most) mine[found++] = NAN;
    sf_cluster_gather_bytes(cluster, mine, most * sizeof *mine, depths);
    for (size_t i = 0; i < most * (size_t)cluster->size; i++)
        if (!isnan(depths[i])) depths[n++] = depths[i];
    return n;
}

float sf_near_plane_of(const sf_model *model, const sf_eye *eye, struct sf_cluster *cluster) {
    float depths[SAMPLES];
    size_t n =
        cluster ? gather_depths(model, eye, cluster, depths) : sample_depths(model, eye, SAMPLES, depths);
    float nearest = n ? sf_rankedf(depths, n, (size_t)(NEAR_SHARE * (double)n)) : 0;
    return fmaxf((float)NEAR_PART * nearest, FLT_MIN);
}
