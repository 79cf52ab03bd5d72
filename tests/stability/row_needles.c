/* row_needles.c - row 1: thin Gaussians, whose covariance on the screen is nearly singular. */
#include "stability.h"

#include <math.h>
#include <stdlib.h>

#include "reference/outcome.h"

static void needles(stab_run *run) {
    test_ref_scene scene = test_random_scene(1, 20, 0, 32, 32);
    test_outcome o = test_outcome_alone(&scene, 1);
    test_ref_frame frame;
    test_ref_grads grads;
    test_ref_outcome(&scene, &frame, &grads);
    stab_at_most(run, test_worst_of(o.rgb, frame.rgb, 3 * o.pixels), 1e-5, "colour", "error of the picture");
    test_outcome_free(&o);
    test_ref_frame_free(&frame);
    test_ref_grads_free(&grads);
    test_ref_gaussians_free(&scene.gaussians);
}

const stab_row stab_row_1 = {
    .id = "1",
    .failure = "Near-singular 2D covariance: ac - b^2 cancels",
    .cure = "The determinant is a sum of squares, the exponent is factored (M.1).",
    .quick = 1,
    .run = needles,
};
