/* studio.h - the simulated scene: a furnished room, seen by an exact ray caster.
 *
 * The room is closed, so every ray hits something. World units are metres or thereabouts, z is up, the floor
 * is z = 0. Light is linear; colours above 1 are bright reflections.
 */
#ifndef SF_CAPTURE_STUDIO_H
#define SF_CAPTURE_STUDIO_H

#include <splatfit/camera.h>

#include "../base/pool.h"
#include "paint.h"
#include "vec3.h"

enum { SF_STUDIO_MAX_OBJECTS = 32 };

typedef enum sf_shape { SF_SHAPE_SPHERE, SF_SHAPE_BOX } sf_shape;

/* A convex thing: what lies on itself needs no shadow test against itself. */
typedef struct sf_object {
    sf_shape shape;
    sf_paint paint;
    uint32_t salt;
    sf_vec3 center, half;    /* half the box's sides; a sphere's radius in half.x */
    double cos_yaw, sin_yaw; /* turned about z */
    double bound;            /* radius of the bounding sphere */
    double mirror;           /* reflectance at normal incidence, rising to 1 at grazing; 0: matt */
} sf_object;

typedef struct sf_studio {
    sf_object objects[SF_STUDIO_MAX_OBJECTS];
    int count;
} sf_studio;

void sf_studio_init(sf_studio *studio);

/* What a ray meets first. */
typedef struct sf_hit {
    int object;            /* -1: the room */
    int face;              /* 0..5: +x -x +y -y +z -z; 0 on a sphere */
    double distance;       /* along the unit direction, world units */
    sf_vec3 point, normal; /* the normal faces the ray's origin */
} sf_hit;

/* Follows a ray through the picture position (x_px, y_px). */
void sf_studio_look(const sf_studio *studio, const sf_camera *camera, double x_px, double y_px, sf_hit *hit);

/* The light that a hit scatters to all sides, without reflections: the same from every view. */
sf_vec3 sf_studio_diffuse(const sf_studio *studio, const sf_hit *hit);

/* Draws what the camera sees: rgb [height][width][3] linear light, averaged over the pixel; depth
 * [height][width] camera z at the pixel's middle, world units. Either may be NULL. */
void sf_studio_draw(const sf_studio *studio, struct sf_pool *pool, const sf_camera *camera, float *rgb,
                    float *depth);

#endif
