/* place.c - a scene's origin, and a model in its coordinates. */
#include <math.h>
#include <string.h>

#include "../base/statistics.h"
#include "gaussians.h"
#include "scene.h"

/* Coordinates are moved where they are more than FAR_AWAY times as large as the scene. A float keeps 2^-24 of
 * a coordinate: 2^-16 of the scene's size is left, a tenth of a pixel in a picture of 6,000. */
#define FAR_AWAY 256.0

int sf_choose_origin(const double at[3], double size, double origin[3]) {
    double away = fmax(fmax(fabs(at[0]), fabs(at[1])), fabs(at[2]));
    /* cameras in one place differ by rounding, and do not tell the size without points */
    if (!isfinite(away) || !(size > 1e-12 * away) || !(away > FAR_AWAY * size)) return 0;
    double unit = exp2(ceil(log2(size)));
    for (int k = 0; k < 3; k++) origin[k] = unit * round(at[k] / unit);
    return 1;
}

/* Distance of the median mean from `point`; up to SAMPLES means, evenly chosen. */
static double distance_from(const sf_model *model, const double point[3]) {
    enum { SAMPLES = 4096 };
    float values[SAMPLES];
    double square = 0;
    size_t n = model->count < SAMPLES ? model->count : SAMPLES;
    for (int axis = 0; axis < 3 && n; axis++) {
        for (size_t k = 0; k < n; k++)
            values[k] = *sf_value(&model->params, SF_FIELD_mean,
                                  (size_t)((double)k * (double)model->count / (double)n), axis);
        square += pow((double)sf_medianf(values, n) - point[axis], 2);
    }
    return sqrt(square);
}

void sf_scene_place_model(const sf_scene *scene, sf_model *model) {
    static const double zero[3];
    if (!sf_model_has_origin(model) && distance_from(model, zero) < distance_from(model, scene->origin))
        memcpy(model->origin, scene->origin, sizeof model->origin);
    else
        sf_model_set_origin(model, scene->origin);
}
