/* studio.h - the simulated scene: a furnished room, seen by an exact ray caster.
 *
 * The room is closed, so every ray hits something. World units are metres or thereabouts, z is up, the floor
 * is z = 0. Light is linear; colours above 1 are bright reflections.
 */
#ifndef SF_SIM_STUDIO_H
#define SF_SIM_STUDIO_H

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
    double wall_near; /* world units: the least distance that walls are looked at from */
    sf_object objects[SF_STUDIO_MAX_OBJECTS];
    int count;
} sf_studio;

/* The room is a box: its middle, and half its sides. */
extern const sf_vec3 sf_studio_room_center, sf_studio_room_half;

/* Between world axes and those of an object. */
static inline sf_vec3 sf_object_turned(const sf_object *o, sf_vec3 a) {
    return vec3(o->cos_yaw * a.x + o->sin_yaw * a.y, o->cos_yaw * a.y - o->sin_yaw * a.x, a.z);
}
static inline sf_vec3 sf_object_turned_back(const sf_object *o, sf_vec3 a) {
    return vec3(o->cos_yaw * a.x - o->sin_yaw * a.y, o->cos_yaw * a.y + o->sin_yaw * a.x, a.z);
}

/* Furnishes the room (furniture.c). */
void sf_studio_init(sf_studio *studio);

/* Where the board of sf_studio_init_board lies: its frame is that of sf_board (calibrate.h). */
typedef struct sf_board_place {
    double unit_m;  /* metres a world unit */
    sf_vec3 origin; /* world units: the middle of the tags */
    double R_wb[9]; /* row-major: the board's axes in the world are its columns */
} sf_board_place;

/* Furnishes the room a little differently, with a board of AprilTags on the platform: "a3-36h11" printed so
 * that its tags are SF_STUDIO_TAG_M wide. */
#define SF_STUDIO_TAG_M 0.08
void sf_studio_init_board(sf_studio *studio, sf_board_place *place);

/* Furnishes it as a corridor that leads around a block in the middle, 3 units wide. Its walls to the front
 * and the back are alike. */
void sf_studio_init_corridor(sf_studio *studio);

/* What a ray meets first. */
typedef struct sf_hit {
    int object;            /* -1: the room */
    int face;              /* 0..5: +x -x +y -y +z -z; 0 on a sphere */
    double distance;       /* along the unit direction, world units */
    sf_vec3 point, normal; /* the normal faces the ray's origin */
} sf_hit;

/* Follows a ray through the picture position (x_px, y_px). */
void sf_studio_look(const sf_studio *studio, const sf_camera *camera, double x_px, double y_px, sf_hit *hit);

/* What a hit's surface is painted with, and the light that falls on it. A lamp's surface glows instead. */
sf_vec3 sf_studio_albedo(const sf_studio *studio, const sf_hit *hit);
sf_vec3 sf_studio_light(const sf_studio *studio, const sf_hit *hit);
int sf_studio_on_lamp(const sf_hit *hit);
extern const sf_vec3 sf_studio_lamp_glow;

/* A box's face (0..5 as in sf_hit) as seen from outside: spot->u to the right and v up of the place p in the
 * box's axes. The walls of the room are seen from inside: as the opposite face. */
void sf_studio_face_position(int face, sf_vec3 p, sf_spot *spot);

/* The light that a hit scatters to all sides, without reflections: the same from every view. */
sf_vec3 sf_studio_diffuse(const sf_studio *studio, const sf_hit *hit);

/* Draws what the camera sees: rgb [height][width][3] linear light, averaged over the pixel; depth
 * [height][width] camera z at the pixel's middle, world units. Either may be NULL. */
void sf_studio_draw(const sf_studio *studio, struct sf_pool *pool, const sf_camera *camera, float *rgb,
                    float *depth);

#endif
