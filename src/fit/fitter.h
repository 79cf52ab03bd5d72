/* fitter.h - the state of a fit: what is trained, and a struct for each policy, named after the file that
 * changes it. fit.c calls the policies in turn and passes their decisions on. */
#ifndef SF_FIT_FITTER_H
#define SF_FIT_FITTER_H

#include <stdatomic.h>

#include "../base/rng.h"
#include "../render/workspace.h"
#include "../scene/gaussians.h"
#include "../scene/half_model.h"
#include "../scene/scene.h"
#include "exposure.h"
#include "optimizer_state.h"
#include "views.h"

#include <splatfit/fitter.h>

enum {
    SF_LOSS_WINDOW = 50,
    SF_VALIDATE_EVERY = 8, /* training views of which one is kept out by default */
    SF_SHORT_RUN = 1000,   /* steps: a shorter run has no time to select a model */
    SF_SHORT_TIME = 3000   /* the same where time alone ends the run: selection costs steps */
};

enum { SF_MOST_FLOATS = 59 /* of a Gaussian with all bands */ };

/* A tentative merge: Gaussian a replaces both, b is invisible. */
typedef struct sf_merge {
    uint32_t a, b, leader;                  /* leader: the Gaussian that a was merged into later, or a */
    float of_a[SF_MOST_FLOATS], logit_of_b; /* before the merge */
} sf_merge;

typedef struct sf_merges {
    sf_merge *list; /* in the order of merging */
    size_t count, capacity;
    float *tiles; /* squared error of each tile of each training view before the merges */
    size_t tile_count, tile_capacity;
    double squares; /* sum of `tiles` */
    double part;    /* part of the Gaussians to merge in the next round */
    int in_vain;    /* rounds one after another that removed nothing */
    int on_ranks;   /* of several ranks: whether one of them has any, since the round began */
} sf_merges;

/* The golden ratio's fraction: multiples of it leave no large gap in 0..1. */
#define SF_GOLDEN 0.6180339887498949

/* sampler.c: the order in which training views are drawn. */
typedef struct sf_view_sampler {
    uint32_t *ids; /* training views of the present pass, in order */
    size_t count, at;
    double start;        /* 0..1: the view, as a part of all, at which the next pass begins */
    size_t views_before; /* training views of the scene when the last pass began */
} sf_view_sampler;

/* validation.c: training views kept out of training, and the PSNR of the model on them. */
typedef struct sf_validation {
    uint32_t *ids; /* of the views in validation, ascending */
    size_t count, capacity;
    uint32_t newest_id;     /* newest training view that was assigned to validation or training */
    int64_t assigned;       /* how many views were assigned */
    int merged;             /* these views are trained on now */
    double psnr, best_psnr; /* dB; NAN before the first validation */
    double best_fraction;   /* of the run, at best_psnr */
    int64_t best_step;      /* at best_psnr */
    double next_fraction;   /* no validation before this fraction of the run, */
    int64_t next_step;      /* nor before this step */
} sf_validation;

/* restore_point.c: an earlier model to go back to: the one of the best validation PSNR, or, where validation
 * does not choose, the last one whose losses had not diverged. */
typedef struct sf_restore_point {
    sf_model *model;    /* of a fit on several ranks, and as a checkpoint has it; NULL: none */
    sf_half_model half; /* else; empty: none */
    double background[3];
} sf_restore_point;

/* recovery.c: detects divergence. */
typedef struct sf_recovery {
    double min_loss;     /* minimum so far of the median over several steps; 0: none yet */
    double initial_loss; /* of the initial model, at full resolution; 0: unknown */
    double lr_scale;     /* factor of all learning rates */
    int64_t since;       /* step from which on losses are compared */
    int64_t count;       /* number of returns to the restore point */
} sf_recovery;

/* blur.c */
typedef struct sf_blur {
    uint32_t *ids; /* of the blurred training views */
    size_t count;
    int judged; /* whether sharpness was measured */
} sf_blur;

/* misplaced.c */
typedef struct sf_misplaced {
    uint32_t *ids; /* of the training views with a wrong pose */
    size_t count;
    int judged; /* whether views were judged */
} sf_misplaced;

/* schedule.c: the last part of the run, over which learning rates are annealed; fractions of the run. */
typedef struct sf_cool_down {
    double from, length;
} sf_cool_down;

/* time_trace.c: the time of each step in ticks, as measured, or as given to repeat a run. */
typedef struct sf_time_trace {
    uint32_t *ticks;
    size_t count, capacity;
    int replayed, lost; /* given; a step's time could not be stored */
} sf_time_trace;

/* densify.c: arrays have the model's capacity. */
typedef struct sf_densify {
    double *gradient_sum;    /* sum of the norms of the screen gradient since the last densification.
                                Densification by error replaces it by a score; below 0: to be removed */
    uint32_t *visible_count; /* views in which the Gaussian was visible since then */
    int ended;               /* select.c: more Gaussians no longer lower the error enough */
    int out_of_memory;       /* the number of Gaussians stays; logged once */
} sf_densify;

/* select.c: state of model selection between two densifications. */
typedef struct sf_selection {
    int vain_growths;      /* consecutive densifications that did not lower the error */
    double min_error;      /* least mean squared error of sampled views after a densification; 0: none */
    int min_error_level;   /* resolution level of min_error */
    double growth_scale;   /* factor of the number of Gaussians to add; 0: unknown */
    double noise_variance; /* of a value; the minimum so far is kept: pruning raises residuals, and must not
                              make the rest look cheaper. 0: unknown */
} sf_selection;

/* local_units.c: the unit of length of each Gaussian; the array has the model's capacity. */
typedef struct sf_local_units {
    float *inverse; /* 1 / unit, 1 / world units; 0: no view has seen the Gaussian yet */
} sf_local_units;

/* out_of_view.c: the groups of Gaussians that views leave out together; the array has the model's capacity.
 */
typedef struct sf_out_of_view {
    uint32_t *steps; /* of each group: in how many steps it was out of view since its second moments were
                        brought up to date */
} sf_out_of_view;

struct sf_fitter {
    sf_context *ctx;
    sf_scene *scene;
    sf_fit_options options;
    double extent;      /* of the scene, world units */
    float near_plane;   /* world units; 0: chosen for each view */
    int warm_start;     /* started from a model: full resolution and all bands from the first step */
    size_t first_count; /* Gaussians at the start, of all ranks */
    sf_memory_bill bill;

    sf_model *model;
    sf_optimizer_state moments; /* optimizer state; arrays have the model's capacities */
    int64_t optimizer_restart;  /* step at which the optimizer state was last cleared */
    sf_model shown;             /* moving_average.c: the moving average of the model, if one is kept */
    double background[3], background_m[3], background_v[3];
    float step_background[3]; /* of the current step */

    sf_view_sampler sampler;
    sf_densify densify;
    sf_local_units units;
    sf_out_of_view out_of_view;
    sf_selection select;
    sf_merges merges;
    sf_validation validation;
    sf_restore_point restore;
    sf_recovery recovery;
    sf_blur blur;
    sf_misplaced misplaced;
    sf_cool_down cool_down;
    sf_time_trace trace;

    sf_view_states views; /* empty unless exposure or a refinement is on */
    sf_exposure exposure;

    sf_workspace workspace;
    uint8_t *band_pixels; /* of several ranks: the rows of the present view that this one compares */
    size_t band_pixels_capacity;
    sf_rng rng;
    sf_rng rank_rng;       /* ranks.c: of the present densification of this rank's Gaussians */
    size_t shared_count;   /* Gaussians of all ranks, at the beginning of the step */
    double shared_seconds; /* of the fit, as rank 0 said at the beginning of the step */

    /* progress */
    int end; /* an sf_fit_end */
    int64_t step;
    double start;
    double losses[SF_LOSS_WINDOW]; /* of the last steps, by step modulo SF_LOSS_WINDOW */
    double rate_time;              /* start of the interval over which the rate is measured */
    int64_t rate_step;
    double steps_per_second;
    int level, sh_degree;
    uint64_t skipped_values;
    atomic_int cancelled;
};

/* Whether a training view is in validation now. */
static inline int sf_is_in_validation(const sf_validation *validation, uint32_t id) {
    size_t i = 0;
    while (i < validation->count && validation->ids[i] != id) i++;
    return !validation->merged && i < validation->count;
}

static inline int sf_is_blurred(const sf_blur *blur, uint32_t id) {
    size_t i = 0;
    while (i < blur->count && blur->ids[i] != id) i++;
    return i < blur->count;
}

/* Whether exposure, poses or focal lengths of views are learned. */
static inline int sf_learns_views(const sf_fitter *fitter) {
    return fitter->options.exposure || fitter->options.refine_poses || fitter->options.refine_intrinsics;
}

#endif
