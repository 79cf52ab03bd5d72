/* similarity.c - the similarity between two worlds, from cameras that are known in both. */
#include <math.h>
#include <string.h>

#include <splatfit/model.h>

#include "../base/linear.h"

/* The mean of the rotations R'^T R: the quaternion whose squared products with all of theirs have the
 * greatest sum, so that their signs do not matter. */
static void mean_rotation(const sf_camera *from, const sf_camera *to, size_t count, double R[9]) {
    double sum[16] = {0}, mean[4];
    for (size_t n = 0; n < count; n++) {
        double turn[9], q[4];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                turn[3 * i + j] = 0;
                for (int k = 0; k < 3; k++)
                    turn[3 * i + j] += to[n].R_cw[3 * k + i] * from[n].R_cw[3 * k + j];
            }
        sf_rotation_to_quat(turn, q);
        for (int i = 0; i < 16; i++) sum[i] -= q[i / 4] * q[i % 4];
    }
    sf_least_eigenvector(4, sum, mean);
    sf_rotation_from_quat(mean, R);
}

int sf_similarity_between(const sf_camera *from, const sf_camera *to, size_t count, sf_similarity *s) {
    double middle[3] = {0}, middle_to[3] = {0}, along = 0, square = 0, c[3], c_to[3], turned[3];
    if (!count) return 0;
    mean_rotation(from, to, count, s->R);
    for (size_t n = 0; n < count; n++) {
        sf_camera_center(&from[n], c), sf_camera_center(&to[n], c_to);
        for (int k = 0; k < 3; k++)
            middle[k] += c[k] / (double)count, middle_to[k] += c_to[k] / (double)count;
    }
    for (size_t n = 0; n < count; n++) {
        sf_camera_center(&from[n], c), sf_camera_center(&to[n], c_to);
        for (int k = 0; k < 3; k++) c[k] -= middle[k], c_to[k] -= middle_to[k];
        sf_mat3_vec(s->R, c, turned);
        along += sf_dot3(turned, c_to), square += sf_dot3(c, c);
    }
    if (!(square > 0 && along > 0 && isfinite(along / square))) return 0;
    s->scale = along / square;
    sf_mat3_vec(s->R, middle, turned);
    for (int k = 0; k < 3; k++) s->move[k] = middle_to[k] - s->scale * turned[k];
    return 1;
}

void sf_camera_transform(sf_camera *camera, const sf_similarity *s) {
    double R[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[3 * i + j] = sf_dot3(camera->R_cw + 3 * i, s->R + 3 * j);
    for (int i = 0; i < 3; i++) camera->t_cw[i] = s->scale * camera->t_cw[i] - sf_dot3(R + 3 * i, s->move);
    memcpy(camera->R_cw, R, sizeof R);
}
