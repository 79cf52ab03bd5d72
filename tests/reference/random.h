/* random.h - random scenes, for the reference and for the library alike: every number is a float. */
#ifndef TESTS_RANDOM_H
#define TESTS_RANDOM_H

#include <splatfit/model.h>
#include <splatfit/render.h>

#include "base/rng.h"
#include "reference.h"

/* Uniform in [least, most). */
static inline double test_random_between(sf_rng *rng, double least, double most) {
    return least + (most - least) * sf_rng_uniform(rng);
}

/* A camera turned and moved at random by a little, so that it still looks along +z. */
sf_camera test_random_camera(sf_rng *rng, int width, int height);

/* `count` Gaussians before such a camera: some beside the picture, a few behind the near plane. The caller
 * frees scene.gaussians. */
test_ref_scene test_random_scene(uint64_t seed, size_t count, int sh_degree, int width, int height);

/* The mean of Gaussian i, from the camera's frame. */
void test_random_place(test_ref_scene *scene, size_t i, const double camera_point[3]);

/* The same for the library; free the model with sf_model_destroy. */
sf_model *test_model_of(sf_context *ctx, const test_ref_scene *scene);
sf_render_options test_render_options_of(const test_ref_scene *scene);

/* Arrays of floats, 0, of the caller's. */
sf_gaussians test_gaussians_create(size_t count, int sh_degree);
void test_gaussians_free(sf_gaussians *gaussians);
/* The five arrays, in the order of test_ref_list. */
void test_gaussians_list(const sf_gaussians *gaussians, float *list[TEST_REF_ARRAYS]);

#endif
