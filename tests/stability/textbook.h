/* textbook.h - the usual forms in float32, as published trainers have them: what the library does not do. */
#ifndef TESTS_STABILITY_TEXTBOOK_H
#define TESTS_STABILITY_TEXTBOOK_H

#include "../reference/outcome.h"

/* The picture's transmittance [H][W] and the gradients of a scene of one Gaussian over black: the inverse of
 * the 2D covariance through ac - b^2, and its gradient through 1 / (ac - b^2)^2. What comes before and after
 * that is float64. d_rgb: dL/dimage, [H][W][3]. */
void stab_textbook_single(const test_ref_scene *scene, const float *d_rgb, double *transmittance,
                          test_ref_gaussians *gradient);

/* Layers of one pixel, nearest first, each with the colour `color[i]` in one channel and the opacity o[i]:
 * clamped to 0.99, ended before T falls under 1e-4; then dC/do back to front, where T is recovered by
 * division and the clamp has no say. Returns how many layers count; d_opacity of the others is 0. */
size_t stab_textbook_layers(size_t count, const float *opacity, const float *color, float *d_opacity);

/* q/|q| in float32, without care for the size of its squares. */
void stab_textbook_normalise(const double q[4], double unit[4]);

#endif
