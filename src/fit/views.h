/* views.h - what a fit learns of each training view, by the view's id. */
#ifndef SF_FIT_VIEWS_H
#define SF_FIT_VIEWS_H

#include "../scene/scene.h"

/* Adam's moments of `n` values that are updated together, and their number of steps. */
#define SF_MOMENTS(n)                                                                                        \
    struct {                                                                                                 \
        double m[n], v[n];                                                                                   \
        int64_t steps;                                                                                       \
    }

typedef struct sf_view_state {
    uint32_t id;
    sf_camera given; /* the camera in the scene */
    size_t lens;     /* index in sf_view_states.lenses */

    /* exposure.c: the target is compared with exp(log_gain) x + bias; x: render */
    double log_gain[3], bias[3];
    SF_MOMENTS(6) exposure;

    /* refine.c: the pose in use */
    double R_cw[9], t_cw[3];
    struct {
        double last[6], size[6]; /* the last gradient; the step size, in learning rates */
        int64_t steps;
    } pose;
    double depth; /* typical depth of the Gaussians in view, world units; 0: not measured */
    int held;     /* the pose is fixed, for the gauge */
    double turned_deg, moved_depths; /* distance from the given pose */
} sf_view_state;

/* The intrinsics that views share. */
typedef struct sf_view_lens {
    int32_t width, height;
    double fx, fy, cx, cy; /* as in the scene, px */
    double log_focal[2];   /* logarithms of the factors of fx and fy */
    SF_MOMENTS(2) focal;
} sf_view_lens;

/* Plain arrays, which can be copied. */
typedef struct sf_view_states {
    sf_view_state *states; /* ascending by id */
    size_t count, capacity;
    sf_view_lens *lenses;
    size_t lens_count, lens_capacity;
    double *scratch; /* [count] for medians */
    size_t scratch_capacity;
} sf_view_states;

/* Adds states of new views and drops those of removed ones; `ids` ascend. A removed view does not return: a
 * scene gives an id once. On failure the states are unchanged. */
sf_status sf_view_states_sync(sf_view_states *views, sf_scene *scene, const uint32_t *ids, size_t count);
/* The view's camera in the scene is another one now. */
sf_status sf_view_states_set_camera(sf_view_states *views, sf_context *ctx, sf_view_state *state,
                                    const sf_camera *camera);
void sf_view_states_free(sf_view_states *views, sf_context *ctx);

/* The state of view `id`; NULL: there is none. */
sf_view_state *sf_view_state_of(const sf_view_states *views, uint32_t id);
/* The lens of a camera in the scene; NULL: no training view has it. */
const sf_view_lens *sf_view_lens_of(const sf_view_states *views, const sf_camera *given);

#endif
