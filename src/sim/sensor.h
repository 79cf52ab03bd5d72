/* sensor.h - what a small camera makes of the light that falls on it: motion blur, brightness, noise. */
#ifndef SF_SIM_SENSOR_H
#define SF_SIM_SENSOR_H

#include <stdint.h>

#include <splatfit/camera.h>

#include "../base/pool.h"

enum { SF_SENSOR_STEPS = 1 << 14 };

/* From linear light to bytes: 0..1 in SF_SENSOR_STEPS steps by the sRGB curve. */
typedef struct sf_sensor_curve {
    uint8_t byte[SF_SENSOR_STEPS + 1];
} sf_sensor_curve;

void sf_sensor_curve_init(sf_sensor_curve *curve);

/* How the scene moves before the camera while a picture is exposed: p' = p + turn x p + move. */
typedef struct sf_motion {
    double turn[3], move[3]; /* radians; the unit of depth */
} sf_motion;

/* Between two poses of a camera, turned by little. */
sf_motion sf_motion_between(const sf_camera *from, const sf_camera *to);

/* The mean of up to `most` pictures along the motion: rgb and out [height][width][3] linear, depth
 * [height][width]. What is in front smears as it is seen in the middle of the exposure. */
void sf_sensor_smear(struct sf_pool *pool, const sf_camera *camera, const sf_motion *motion, int most,
                     const float *rgb, const float *depth, float *out);

/* One picture, from linear light to bytes. */
typedef struct sf_exposure {
    const sf_sensor_curve *curve;
    const float *linear; /* [height][width][3] */
    int32_t width, height;
    double time, gain; /* 1: light 1 is white without a gain */
    double noise;      /* 1: that of a webcam indoors; 0: none */
    uint64_t seed;     /* of the noise: another for each frame */
} sf_exposure;

/* data: rows of 3 width bytes. */
void sf_sensor_expose(struct sf_pool *pool, const sf_exposure *exposure, uint8_t *data);

#endif
