/* views.h - what a fit learns of each training view beside the model, by the view's id. */
#ifndef SF_FIT_VIEWS_H
#define SF_FIT_VIEWS_H

#include "../scene/scene.h"

/* Moments of Adam for `n` values that one gradient belongs to, and the steps they have seen. */
#define SF_MOMENTS(n)                                                                                        \
    struct {                                                                                                 \
        double m[n], v[n];                                                                                   \
        int64_t steps;                                                                                       \
    }

typedef struct sf_view_state {
    uint32_t id;
    sf_camera given; /* as the scene has it */
    size_t lens;     /* index in sf_view_states.lenses */

    /* exposure.c: the picture is compared with exp(log_gain) x + bias */
    double log_gain[3], bias[3];
    SF_MOMENTS(6) exposure;

    /* refine.c: the pose in use */
    double R_cw[9], t_cw[3];
    SF_MOMENTS(6) pose;
    double depth;                    /* of what it sees, world units; 0: not looked yet */
    int held;                        /* keeps its pose, for the gauge */
    double turned_deg, moved_depths; /* from the given pose */
} sf_view_state;

/* The intrinsics that views share. */
typedef struct sf_view_lens {
    int32_t width, height;
    double fx, fy, cx, cy; /* as given, px */
    double log_focal[2];   /* logarithm of what to multiply fx and fy by */
    SF_MOMENTS(2) focal;
} sf_view_lens;

/* Plain arrays: a copy of them is a copy of all that was learned. */
typedef struct sf_view_states {
    sf_view_state *states; /* ascending by id */
    size_t count, capacity;
    sf_view_lens *lenses;
    size_t lens_count, lens_capacity;
    double *scratch; /* [count] for medians */
    size_t scratch_capacity;
} sf_view_states;

/* Takes up views that came and drops those that went; `ids` ascend. Views that go do not come again: a scene
 * gives an id once. On failure what was there stays whole. */
sf_status sf_view_states_sync(sf_view_states *views, sf_scene *scene, const uint32_t *ids, size_t count);
void sf_view_states_free(sf_view_states *views, sf_context *ctx);

/* The state of view `id`, NULL if there is none. */
sf_view_state *sf_view_state_of(const sf_view_states *views, uint32_t id);
/* The lens of a camera as given, NULL if no training view has it. */
const sf_view_lens *sf_view_lens_of(const sf_view_states *views, const sf_camera *given);

#endif
