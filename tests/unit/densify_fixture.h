/* densify_fixture.h - fits before a densification. */
#ifndef TESTS_UNIT_DENSIFY_FIXTURE_H
#define TESTS_UNIT_DENSIFY_FIXTURE_H

#include "testing.h"

enum { VIEWS = 8, WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

/* A round Gaussian of one colour. */
typedef struct ball {
    float mean[3], scale, opacity, gray;
} ball;

sf_model *densify_model_of(sf_context *ctx, const ball *balls, size_t count);

/* All views of balls; in view `spoilt` (-1: none) the picture is white around the middle of `where`. */
sf_scene *densify_scene_of(sf_context *ctx, const ball *balls, size_t count, int spoilt, const float *where,
                           const uint8_t *mask);
sf_fit_options densify_options_of(int growth);
sf_fitter *densify_fitter_of(sf_context *ctx, sf_scene *scene, const ball *balls, size_t count,
                             const sf_fit_options *options);

#endif
