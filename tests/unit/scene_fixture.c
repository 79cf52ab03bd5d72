/* scene_fixture.c - makes the scene and its views. */
#include "scene_fixture.h"

#include <math.h>

sf_camera scene_camera_at(double x, double y, double z) {
    return (sf_camera){.width = 8,
                       .height = 6,
                       .fx = 10,
                       .fy = 11,
                       .cx = 4,
                       .cy = 3,
                       .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                       .t_cw = {-x, -y, -z}};
}

uint8_t scene_shade(size_t seed, size_t i) { return (uint8_t)(53 * seed + 7 * i + i * i / 5); }

uint32_t scene_add_view(sf_context *ctx, sf_scene *scene, const char *name, double x, sf_split split) {
    sf_camera camera = scene_camera_at(x, 0, 0);
    uint8_t rgb[6 * 24];
    for (size_t i = 0; i < sizeof rgb; i++) rgb[i] = scene_shade((size_t)(x + 50), i);
    sf_pixels pixels = {.rgb = rgb, .stride = 24};
    uint32_t id = 0;
    assert_ok(ctx, sf_scene_add_view(scene, name, &camera, &pixels, split, &id));
    return id;
}

sf_scene *scene_new(sf_context *ctx) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    return scene;
}

void scene_assert_near(double got, double expected, double tolerance) {
    if (!(fabs(got - expected) <= tolerance)) fail_msg("%.17g is not %.17g", got, expected);
}
