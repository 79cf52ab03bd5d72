/* camera.c - the pinhole camera. */
#include <math.h>

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
    if (!(det > 0)) return SF_ERR_ARGUMENT; /* a mirror */
    for (int k = 0; k < 3; k++)
        if (!isfinite(c->t_cw[k])) return SF_ERR_ARGUMENT;
    return SF_OK;
}
