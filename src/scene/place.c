/* place.c - brings a model into the coordinates of a scene. */
#include <math.h>
#include <string.h>

#include "../base/statistics.h"
#include "gaussians.h"
#include "scene.h"

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
