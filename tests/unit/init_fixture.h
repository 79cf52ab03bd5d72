/* init_fixture.h - scenes of points and pictures. */
#ifndef TESTS_UNIT_INIT_FIXTURE_H
#define TESTS_UNIT_INIT_FIXTURE_H

#include "testing.h"

#include "base/rng.h"
#include "scene/init.h"
#include "scene/random.h"

extern const double init_sh_c0;

typedef void (*place_fn)(sf_rng *rng, size_t i, float *point);

void init_place_anywhere(sf_rng *rng, size_t i, float *point);
float *init_place(place_fn where, size_t n, uint64_t seed);

/* Looks at the origin along +x from (-6, 0, 0); `turn` more quarter turns around z. */
sf_camera init_camera_around(int turn);

/* Views from four sides, each of one colour. */
extern const uint8_t init_side_colors[4][3];

sf_scene *init_scene_of(sf_context *ctx, int views);

extern const sf_init_options init_usual;

/* All that is in a model of degree 2. */
enum { MOST = 1200, COEFFICIENTS = 9 };
typedef struct content {
    size_t count;
    float means[MOST][3], quats[MOST][4], log_scales[MOST][3], logits[MOST], sh[MOST][COEFFICIENTS][3];
} content;

content *init_make_first(sf_scene *scene, const sf_init_options *options, uint64_t seed);
void init_add_points(sf_scene *scene, place_fn where, size_t n, uint64_t seed);

/* What every first Gaussian has. */
void init_check_common(const content *c, const sf_init_options *options);

#endif
