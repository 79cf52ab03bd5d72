/* select_fixture.h - fits whose Gaussians are measured. */
#ifndef TESTS_UNIT_SELECT_FIXTURE_H
#define TESTS_UNIT_SELECT_FIXTURE_H

#include "testing.h"

enum { VIEWS = 8, WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

sf_camera select_camera_of(int view);

/* A Gaussian of one colour. */
typedef struct ball {
    float mean[3], scale[3], opacity, gray;
} ball;

sf_model *select_model_of(sf_context *ctx, const ball *balls, size_t count, int sh_degree);

/* Each view of a model so many times, one after another, the first `unmasked` of them with nothing masked and
 * the others altogether. */
sf_scene *select_scene_of_many(sf_context *ctx, const sf_model *model, int times, int unmasked);

/* All views of a model. */
sf_scene *select_scene_of(sf_context *ctx, const sf_model *model);
sf_fitter *select_fitter_of(sf_context *ctx, sf_scene *scene, const sf_model *model);

extern const ball select_three[3];

#endif
