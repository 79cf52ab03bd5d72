/* scene_fixture.h - an empty scene, and views to add to it. */
#ifndef TESTS_UNIT_SCENE_FIXTURE_H
#define TESTS_UNIT_SCENE_FIXTURE_H

#include "testing.h"

/* Looks along +z of the world from `x, y, z`. */
sf_camera scene_camera_at(double x, double y, double z);

/* Byte i of a picture, by its seed. */
uint8_t scene_shade(size_t seed, size_t i);

/* A view of scene_camera_at(x, 0, 0), 8x6, with a picture of its own. */
uint32_t scene_add_view(sf_context *ctx, sf_scene *scene, const char *name, double x, sf_split split);

/* An empty scene; the caller destroys it. */
sf_scene *scene_new(sf_context *ctx);
void scene_assert_near(double got, double expected, double tolerance);

#endif
