/* bounds.c - the bounds of a model, without outliers. */
#include <math.h>

#include "../base/linear.h"
#include "../base/statistics.h"
#include "gaussians.h"

/* This part of the Gaussians is within the radius. */
#define RADIUS_PART 0.8

static double mean_of(const sf_model *model, size_t i, int k) {
    return (double)*sf_value(&model->params, SF_FIELD_mean, i, k);
}

static double distance_to(const sf_model *model, size_t i, const double center[3]) {
    double square = 0;
    for (int k = 0; k < 3; k++) square += pow(mean_of(model, i, k) - center[k], 2);
    return sqrt(square);
}

static void find_sphere(const sf_model *model, float *values, sf_model_bounds *b) {
    size_t n = model->count;
    for (int k = 0; k < 3; k++) {
        for (size_t i = 0; i < n; i++) values[i] = *sf_value(&model->params, SF_FIELD_mean, i, k);
        b->center[k] = (double)sf_medianf(values, n);
    }
    for (size_t i = 0; i < n; i++) values[i] = (float)distance_to(model, i, b->center);
    b->radius = (double)sf_rankedf(values, n, (size_t)(RADIUS_PART * (double)(n - 1)));
    if (!(b->radius > 0)) b->radius = 1;
}

/* The axes of the covariance of the means within the radius. */
static void find_plane(const sf_model *model, sf_model_bounds *b) {
    double sum[3] = {0}, A[9] = {0}, V[9], n = 0;
    for (size_t i = 0; i < model->count; i++) {
        if (distance_to(model, i, b->center) > b->radius) continue;
        double d[3];
        for (int k = 0; k < 3; k++) sum[k] += d[k] = mean_of(model, i, k) - b->center[k];
        for (int k = 0; k < 9; k++) A[k] += d[k / 3] * d[k % 3];
        n++;
    }
    for (int k = 0; k < 9; k++) A[k] = n > 0 ? A[k] / n - sum[k / 3] / n * (sum[k % 3] / n) : 0;
    sf_eigen(3, A, V);
    int least = 0, most = 0;
    for (int k = 1; k < 3; k++) {
        if (A[4 * k] < A[4 * least]) least = k;
        if (A[4 * k] >= A[4 * most]) most = k;
    }
    double middle = A[4 * (3 - least - most)];
    for (int k = 0; k < 3; k++) b->normal[k] = V[3 * k + least] * (V[3 + least] > 0 ? -1 : 1);
    b->flatness = middle > 0 ? sqrt(fmax(A[4 * least], 0) / middle) : 1;
}

sf_status sf_model_get_bounds(const sf_model *model, sf_model_bounds *bounds) {
    *bounds = (sf_model_bounds){.radius = 1, .normal = {0, -1, 0}, .flatness = 1};
    if (!model->count) return sf_fail(model->ctx, SF_ERR_EMPTY, "model: there is no Gaussian");
    float *values = sf_alloc(model->ctx, model->count, sizeof *values);
    if (!values) return SF_ERR_MEMORY;
    find_sphere(model, values, bounds);
    sf_free(model->ctx, values);
    find_plane(model, bounds);
    return SF_OK;
}
