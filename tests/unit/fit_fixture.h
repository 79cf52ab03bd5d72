/* fit_fixture.h - scenes that the library drew itself, and fits of them. */
#ifndef TESTS_UNIT_FIT_FIXTURE_H
#define TESTS_UNIT_FIT_FIXTURE_H

#include "testing.h"

enum { TRUE_COUNT = 60, VIEWS = 12, WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

sf_camera fit_camera_of(int view);
sf_model *fit_true_model(sf_context *ctx);
void fit_add_picture(sf_scene *scene, const sf_camera *camera, const float *rgb, const uint8_t *mask,
                     sf_split split);

/* The views `first` .. `end`-1 of the true model over a background. */
void fit_add_views(sf_context *ctx, sf_scene *scene, int first, int end, const float *background);

/* The true means, off by what structure from motion is off by. */
void fit_add_points(sf_scene *scene);
sf_scene *fit_empty_scene(sf_context *ctx);

extern const float fit_black[3];

sf_scene *fit_small_scene(sf_context *ctx);
void fit_skip_if_quick(void);
sf_fit_options fit_short_fit(int64_t steps);
sf_fitter *fit_start(sf_context *ctx, sf_scene *scene, const sf_fit_options *options);
sf_fit_progress fit_progress_of(const sf_fitter *fitter);
void fit_take_steps(sf_context *ctx, sf_fitter *fitter, int steps);

/* Mean PSNR of the fit over all views of the scene. */
double fit_psnr_of(sf_context *ctx, sf_scene *scene, sf_fitter *fitter);

/* All values of a model in one array. */
typedef struct content {
    size_t count, size;
    float *values;
} content;

content fit_content_of_model(const sf_model *model);
content fit_content_of(sf_context *ctx, const sf_fitter *fitter);
/* The same, and destroys all three. */
content fit_end(sf_context *ctx, sf_scene *scene, sf_fitter *fitter);

/* To the bit; frees b. */
void fit_assert_same(const content *a, content b);
int fit_is_same(const content *a, const content *b);

/* A model that any viewer can take: it is written, which checks every value. */
void fit_assert_sound(sf_context *ctx, const sf_fitter *fitter);

/* The whole run of one thread count; the caller frees the values. */
content fit_fitted_by(int threads, const sf_fit_options *options);

#endif
