/* camera.c - the pinhole camera. */
#include <math.h>

#include "gaussian_math.h"

#include <splatfit/camera.h>

void sf_camera_center(const sf_camera *camera, double center[3]) {
    const double *R = camera->R_cw, *t = camera->t_cw;
    for (int k = 0; k < 3; k++) center[k] = -(R[k] * t[0] + R[3 + k] * t[1] + R[6 + k] * t[2]);
}

sf_camera sf_camera_downscaled(const sf_camera *camera, int factor) {
    sf_camera c = *camera;
    c.width /= factor, c.height /= factor;
    c.fx /= factor, c.fy /= factor, c.cx /= factor, c.cy /= factor;
    return c;
}

sf_status sf_camera_check(const sf_camera *c) {
    if (c->width < 1 || c->width > 65535 || c->height < 1 || c->height > 65535) return SF_ERR_ARGUMENT;
    if (!(c->fx > 0 && c->fy > 0 && isfinite(c->fx) && isfinite(c->fy))) return SF_ERR_ARGUMENT;
    if (!isfinite(c->cx) || !isfinite(c->cy)) return SF_ERR_ARGUMENT;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double dot = 0;
            for (int k = 0; k < 3; k++) dot += c->R_cw[3 * i + k] * c->R_cw[3 * j + k];
            if (!(fabs(dot - (i == j)) <= 1e-3)) return SF_ERR_ARGUMENT;
        }
    const double *R = c->R_cw;
    double det = R[0] * (R[4] * R[8] - R[5] * R[7]) - R[1] * (R[3] * R[8] - R[5] * R[6]) +
                 R[2] * (R[3] * R[7] - R[4] * R[6]);
    if (!(det > 0)) return SF_ERR_ARGUMENT; /* a reflection */
    for (int k = 0; k < 3; k++)
        if (!isfinite(c->t_cw[k])) return SF_ERR_ARGUMENT;
    return SF_OK;
}

void sf_rotation_to_quat(const double R[9], double q[4]) {
    double square[4] = {1 + R[0] + R[4] + R[8], 1 + R[0] - R[4] - R[8], 1 - R[0] + R[4] - R[8],
                        1 - R[0] - R[4] + R[8]};
    const double row[4][4] = {{square[0], R[7] - R[5], R[2] - R[6], R[3] - R[1]},
                              {R[7] - R[5], square[1], R[1] + R[3], R[2] + R[6]},
                              {R[2] - R[6], R[1] + R[3], square[2], R[5] + R[7]},
                              {R[3] - R[1], R[2] + R[6], R[5] + R[7], square[3]}};
    int k = 0;
    for (int i = 1; i < 4; i++)
        if (square[i] > square[k]) k = i;
    for (int i = 0; i < 4; i++) q[i] = row[k][i] / (2 * sqrt(square[k]));
}

void sf_rotation_from_quat(const double q[4], double R[9]) {
    double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    sf_unit_quat_rotation(q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm, R);
}
