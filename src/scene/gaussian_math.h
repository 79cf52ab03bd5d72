/* gaussian_math.h - opacities as logits, rotations as quaternions.
 *
 * Quaternions are (w, x, y, z).
 */
#ifndef SF_SCENE_GAUSSIAN_MATH_H
#define SF_SCENE_GAUSSIAN_MATH_H

#include <math.h>

/* The opacity of a logit, and the logit of an opacity in (0, 1). */
static inline double sf_sigmoid(double logit) { return 1 / (1 + exp(-logit)); }
static inline float sf_sigmoidf(float logit) { return 1.0f / (1.0f + expf(-logit)); }
static inline double sf_logit(double opacity) { return log(opacity / (1 - opacity)); }
static inline float sf_logitf(float opacity) { return logf(opacity / (1.0f - opacity)); }

/* unit = quat / |quat|, computed in float64. */
static inline void sf_unit_quat(const float quat[4], float unit[4]) {
    double w = (double)quat[0], x = (double)quat[1], y = (double)quat[2], z = (double)quat[3];
    double norm = sqrt(w * w + x * x + y * y + z * z);
    for (int k = 0; k < 4; k++) unit[k] = (float)((double)quat[k] / norm);
}

/* product = p q: the rotation q, then p. `product` is neither. */
static inline void sf_quat_mul(const double p[4], const double q[4], double product[4]) {
    product[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3];
    product[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2];
    product[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1];
    product[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0];
}

/* The rotation of a unit quaternion; R: [9], row-major. */
static inline void sf_unit_quat_rotation(double w, double x, double y, double z, double R[9]) {
    R[0] = 1 - 2 * (y * y + z * z), R[1] = 2 * (x * y - w * z), R[2] = 2 * (x * z + w * y);
    R[3] = 2 * (x * y + w * z), R[4] = 1 - 2 * (x * x + z * z), R[5] = 2 * (y * z - w * x);
    R[6] = 2 * (x * z - w * y), R[7] = 2 * (y * z + w * x), R[8] = 1 - 2 * (x * x + y * y);
}

/* Column `axis` of the rotation of `quat`, which need not be a unit: the direction of an axis of a Gaussian.
 */
static inline void sf_quat_axis(const float quat[4], int axis, float direction[3]) {
    float norm = 0;
    for (int k = 0; k < 4; k++) norm += quat[k] * quat[k];
    norm = 1.0f / sqrtf(norm);
    float w = quat[0] * norm, x = quat[1] * norm, y = quat[2] * norm, z = quat[3] * norm;
    float R[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                  2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                  2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
    for (int k = 0; k < 3; k++) direction[k] = R[3 * k + axis];
}

#endif
