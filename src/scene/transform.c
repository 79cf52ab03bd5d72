/* transform.c - rotates, scales and moves a model, and crops it to a box. */
#include <math.h>

#include "../base/linear.h"
#include "../kernels/sh.h"
#include "gaussian_math.h"
#include "gaussians.h"

#include <splatfit/camera.h>

/* ---- Spherical harmonics ---- */

enum { SH = (SF_MAX_SH_DEGREE + 1) * (SF_MAX_SH_DEGREE + 1), NODES = 4, TURNS = 8 };

/* Rotation of SH: a colour f(d) = sum_m c_m Y_m(d) becomes f(R^T d). Its coefficients in the same band are D
 * c, D_mn = integral over the sphere of Y_m(d) Y_n(R^T d). Products of two bands of degree 3 are polynomials
 * of degree 6, which Gauss quadrature with 4 heights and 8 directions each integrates exactly. */
static void sh_rotation(const double R[9], double D[SH][SH]) {
    static const double height[NODES] = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563,
                                         0.8611363115940526},
                        weight[NODES] = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461,
                                         0.3478548451374538};
    const double tau = 6.283185307179586;
    for (int m = 0; m < SH; m++)
        for (int n = 0; n < SH; n++) D[m][n] = 0;
    for (int i = 0; i < NODES * TURNS; i++) {
        double z = height[i / TURNS], r = sqrt(1 - z * z), angle = tau * (i % TURNS) / TURNS;
        double d[3] = {r * cos(angle), r * sin(angle), z}, back[3], there[SH], here[SH];
        for (int k = 0; k < 3; k++) back[k] = R[k] * d[0] + R[3 + k] * d[1] + R[6 + k] * d[2];
        sf_sh_basis(SF_MAX_SH_DEGREE, d, here);
        sf_sh_basis(SF_MAX_SH_DEGREE, back, there);
        for (int m = 0; m < SH; m++)
            for (int n = 0; n < SH; n++) D[m][n] += weight[i / TURNS] * tau / TURNS * here[m] * there[n];
    }
}

/* Band `degree` of Gaussian i. */
static void turn_band(const sf_params *params, size_t i, int degree, double D[SH][SH]) {
    int first = degree * degree, n = 2 * degree + 1, field = SF_FIELD_sh0 + degree;
    for (int channel = 0; channel < 3; channel++) {
        double was[2 * SF_MAX_SH_DEGREE + 1];
        for (int k = 0; k < n; k++) was[k] = (double)*sf_value(params, field, i, 3 * k + channel);
        for (int m = 0; m < n; m++) {
            double sum = 0;
            for (int k = 0; k < n; k++) sum += D[first + m][first + k] * was[k];
            *sf_value(params, field, i, 3 * m + channel) = (float)sum;
        }
    }
}

/* ---- The rest ---- */

static void move_gaussian(const sf_model *model, size_t i, const sf_similarity *motion, const double q[4]) {
    const sf_params *p = &model->params;
    double mean[3], to[3], g[4], turned[4];
    for (int k = 0; k < 3; k++) mean[k] = (double)*sf_value(p, SF_FIELD_mean, i, k);
    for (int k = 0; k < 4; k++) g[k] = (double)*sf_value(p, SF_FIELD_quat, i, k);
    sf_mat3_vec(motion->R, mean, to);
    sf_quat_mul(q, g, turned);
    for (int k = 0; k < 3; k++) {
        *sf_value(p, SF_FIELD_mean, i, k) = (float)(motion->scale * to[k] + motion->move[k]);
        float *log_scale = sf_value(p, SF_FIELD_log_scale, i, k);
        *log_scale = (float)((double)*log_scale + log(motion->scale));
    }
    for (int k = 0; k < 4; k++) *sf_value(p, SF_FIELD_quat, i, k) = (float)turned[k];
}

static sf_status check_motion(sf_context *ctx, const sf_similarity *motion) {
    double sum = motion->scale, down[3];
    for (int k = 0; k < 9; k++) sum += motion->R[k];
    for (int k = 0; k < 3; k++) sum += motion->move[k];
    if (!isfinite(sum)) return sf_fail(ctx, SF_ERR_ARGUMENT, "motion: a value is not finite");
    if (!(motion->scale > 0))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "motion: scale: %g is not above 0", motion->scale);
    sf_cross3(motion->R, motion->R + 3, down);
    for (int k = 0; k < 3; k++) {
        double row = sf_dot3(motion->R + 3 * k, motion->R + 3 * k);
        if (fabs(row - 1) > 1e-6 || fabs(down[k] - motion->R[6 + k]) > 1e-6)
            return sf_fail(ctx, SF_ERR_ARGUMENT, "motion: R: is not a rotation");
    }
    return SF_OK;
}

sf_status sf_model_transform(sf_model *model, const sf_similarity *motion) {
    double D[SH][SH], q[4];
    sf_status status = check_motion(model->ctx, motion);
    if (status) return status;
    sh_rotation(motion->R, D);
    sf_rotation_to_quat(motion->R, q);
    for (size_t i = 0; i < model->count; i++) {
        move_gaussian(model, i, motion, q);
        for (int degree = sf_degree_of(model, i); degree > 0; degree--)
            turn_band(&model->params, i, degree, D);
    }
    double origin[3];
    sf_mat3_vec(motion->R, model->origin, origin);
    for (int k = 0; k < 3; k++) model->origin[k] = motion->scale * origin[k];
    sf_model_note_change(model);
    return SF_OK;
}

/* ---- The box ---- */

static int is_inside(const sf_model *model, size_t i, const double low[3], const double high[3]) {
    for (int k = 0; k < 3; k++) {
        double x = (double)*sf_value(&model->params, SF_FIELD_mean, i, k);
        if (!(x >= low[k] && x <= high[k])) return 0;
    }
    return 1;
}

sf_status sf_model_crop(sf_model *model, const double low[3], const double high[3]) {
    sf_order order = {0};
    size_t kept = 0;
    for (int k = 0; k < 3; k++)
        if (!(low[k] <= high[k]))
            return sf_fail(model->ctx, SF_ERR_ARGUMENT, "box: axis %d: %g is not below %g", k, low[k],
                           high[k]);
    sf_remap_entry *places = sf_alloc(model->ctx, model->count + 1, sizeof *places);
    if (!places) return SF_ERR_MEMORY;
    for (size_t i = 0; i < model->count; i++)
        if (is_inside(model, i, low, high))
            places[kept++] = (sf_remap_entry){(uint32_t)i, (uint8_t)sf_degree_of(model, i)};
    sf_status status = kept ? sf_order_create(model->ctx, places, kept, NULL, &order)
                            : sf_fail(model->ctx, SF_ERR_EMPTY, "box: no Gaussian lies in it");
    sf_free(model->ctx, places);
    if (!status) status = sf_order_prepare(model->ctx, &order);
    if (!status) sf_model_reorder(model, &order);
    sf_order_free(model->ctx, &order);
    return status;
}
