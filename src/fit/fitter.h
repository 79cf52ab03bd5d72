/* fitter.h - the inside of a fit. */
#ifndef SF_FIT_FITTER_H
#define SF_FIT_FITTER_H

#include <stdatomic.h>

#include "../base/rng.h"
#include "../render/workspace.h"
#include "../scene/gaussians.h"
#include "../scene/scene.h"

#include <splatfit/fitter.h>

enum { SF_LOSS_WINDOW = 50 };

struct sf_fitter {
    sf_context *ctx;
    sf_scene *scene;
    sf_fit_options options;
    double extent;      /* of the scene, world units */
    float near_plane;   /* world units */
    int gone_on;        /* started from a model: full resolution and all bands from the first step */
    size_t first_count; /* Gaussians at the start */

    sf_model *model;
    sf_params m, v;        /* Adam's moments, arrays of the model's capacity */
    double *screen_sum;    /* [capacity] sum of the screen gradient's norm since the last growth */
    uint32_t *screen_seen; /* [capacity] views in which it was seen */
    size_t capacity;
    int growth_ended; /* memory ran out: said once, and N stays */

    double background[3], background_m[3], background_v[3];
    float step_background[3]; /* of the step in progress */

    sf_workspace workspace;
    sf_rng rng;
    uint32_t *order; /* training views of this pass in random order */
    size_t order_count, order_at;

    /* progress */
    int64_t step;
    double start;
    double losses[SF_LOSS_WINDOW]; /* of the last steps, by step modulo */
    double rate_time;              /* start of the interval over which the rate is measured */
    int64_t rate_step;
    double steps_per_second;
    int level, sh_degree;
    uint64_t skipped_values;
    atomic_int cancelled;
};

/* schedule.c: what holds at a fraction of the run. */
double sf_fraction(const sf_fitter *fitter);
int sf_scheduled_level(const sf_fitter *fitter, double fraction, int width, int height);
int sf_scheduled_degree(const sf_fitter *fitter, double fraction);
/* Learning rate of a field, in its own units. */
double sf_scheduled_rate(const sf_fitter *fitter, double fraction, int field);
/* Whether this step ends with growth, and the number of Gaussians planned for then. */
int sf_growth_due(const sf_fitter *fitter, double fraction);
size_t sf_planned_count(const sf_fitter *fitter, double fraction);

/* What a step from here to the end costs on average, in steps of now: for the ETA. */
double sf_cost_ahead(const sf_fitter *fitter, double fraction);

/* update.c: the way back from the slots' sums to the parameters: gradients, one step of Adam on all fields,
 * the limit on needles, the statistics of growth. On failure nothing has changed. */
sf_status sf_update(sf_fitter *fitter, double fraction);
void sf_update_background(sf_fitter *fitter, const double *gradient);

/* grow.c */
/* Room for `count` Gaussians in the model and all arrays beside it. On failure all is as before. */
sf_status sf_fitter_room(sf_fitter *fitter, size_t count);
/* Removes what is faint or not finite, then clones and splits up to the plan. */
void sf_grow_and_prune(sf_fitter *fitter, double fraction);

/* options.c: SF_ERR_ARGUMENT with the option's name if one is out of range. */
sf_status sf_fit_options_check(sf_context *ctx, const sf_fit_options *options);

#endif
