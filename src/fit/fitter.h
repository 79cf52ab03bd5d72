/* fitter.h - the inside of a fit. */
#ifndef SF_FIT_FITTER_H
#define SF_FIT_FITTER_H

#include <stdatomic.h>

#include "../base/rng.h"
#include "../render/workspace.h"
#include "../scene/gaussians.h"
#include "../scene/scene.h"
#include "exposure.h"
#include "optimizer_state.h"
#include "views.h"

#include <splatfit/fitter.h>

enum {
    SF_LOSS_WINDOW = 50,
    SF_VALIDATE_EVERY = 8, /* training views: one is kept out where the options leave it to the plan */
    SF_SHORT_RUN = 1000,   /* steps: fewer leave no time to grow more than is needed, and to take it away */
    SF_SHORT_TIME = 3000 /* and where time alone ends the run, for what that costs is taken from the steps */
};

enum { SF_MOST_FLOATS = 59 /* of a Gaussian */ };

/* A tentative merge: Gaussian a stands for both, b is not drawn. */
typedef struct sf_merge {
    uint32_t a, b, leader;                  /* the Gaussian that stands for a in the end, or a */
    float of_a[SF_MOST_FLOATS], logit_of_b; /* as they were before */
} sf_merge;

typedef struct sf_merges {
    sf_merge *list; /* in the order in which they were merged */
    size_t count, capacity;
    float *tiles; /* squared error of each tile of each training view before the merges */
    size_t tile_count, tile_capacity;
    double squares; /* sum of `tiles` */
    double part;    /* of all Gaussians, to merge next */
    int in_vain;    /* rounds one after another that removed nothing */
} sf_merges;

/* The golden ratio's fraction: multiples of it leave no large gap in 0..1. */
#define SF_GOLDEN 0.6180339887498949

/* sampler.c: the order in which training views are drawn. */
typedef struct sf_view_sampler {
    uint32_t *ids; /* training views of the present pass, in order */
    size_t count, at;
    double start;        /* in 0..1, of the views: where the next pass begins */
    size_t views_before; /* training views of the last pass */
} sf_view_sampler;

/* validation.c: training views that are not trained on, and what the model is worth on them. */
typedef struct sf_validation {
    uint32_t *ids; /* of these views, ascending */
    size_t count, capacity;
    uint32_t newest_id;     /* of the training views that were assigned to a side */
    int64_t assigned;       /* how many were */
    int merged;             /* these views are trained on now */
    double psnr, best_psnr; /* dB; NAN before the first validation */
    double best_fraction;   /* of the run, at best_psnr */
    int64_t best_step;      /* at best_psnr */
    double next_fraction;   /* of the run: no validation before, */
    int64_t next_step;      /* nor before this step */
} sf_validation;

/* restore.c: an earlier model to go back to: the one with the best validation PSNR; where views of
 * validation are merged, or there are none, the last whose losses were sound. */
typedef struct sf_restore_point {
    sf_model *model; /* NULL: none */
    double background[3];
} sf_restore_point;

/* recovery.c: what tells divergence. */
typedef struct sf_recovery {
    double min_loss;     /* minimum so far of the median over several steps; 0: none yet */
    double initial_loss; /* of the model that the fit began with, at full resolution; 0: unknown */
    double lr_scale;     /* factor of all learning rates */
    int64_t since;       /* step from which on losses are compared */
    int64_t count;       /* times that the fit went back */
} sf_recovery;

/* blur.c */
typedef struct sf_blur {
    uint32_t *ids; /* of the training views that are blurred */
    size_t count;
    int judged; /* whether the views were measured */
} sf_blur;

/* schedule.c: the last part of the run, over which the learning rates fall; fractions of the run. */
typedef struct sf_cool_down {
    double from, length;
} sf_cool_down;

/* time_trace.c: the time of each step in ticks, as measured, or as given to repeat a run. */
typedef struct sf_time_trace {
    uint32_t *ticks;
    size_t count, capacity;
    int replayed, lost; /* given; or a step's time could not be kept */
} sf_time_trace;

/* densify.c: arrays have the model's capacity. */
typedef struct sf_densify {
    double *gradient_sum;    /* sum of the norms of the screen gradient since the last densification; while
                                densifying by error the score, below 0 for a Gaussian to remove */
    uint32_t *visible_count; /* views that saw the Gaussian since then */
    int ended;               /* select.c: more Gaussians no longer pay */
    int out_of_memory;       /* said once; the number of Gaussians stays */
} sf_densify;

/* select.c: what model selection remembers between two densifications. */
typedef struct sf_selection {
    int vain_growths;      /* densifications one after another that did not lower the error */
    double min_error;      /* mean squared error of some views, the minimum after a densification; 0: none */
    int min_error_level;   /* resolution level of min_error */
    double growth_scale;   /* factor of the number of Gaussians to add; 0: unknown */
    double noise_variance; /* of a value; the minimum so far is kept: pruning raises residuals, and must not
                              make the rest look cheaper. 0: unknown */
} sf_selection;

struct sf_fitter {
    sf_context *ctx;
    sf_scene *scene;
    sf_fit_options options;
    double extent;      /* of the scene, world units */
    float near_plane;   /* world units */
    int warm_start;     /* begun from a model: full resolution and all bands from the first step */
    size_t first_count; /* Gaussians at the start */
    sf_memory_bill bill;

    sf_model *model;
    sf_optimizer_state moments; /* of Adam; arrays have the model's capacities */
    int64_t optimizer_restart;  /* step at which the moments were last cleared */
    sf_model shown;             /* ema.c: the moving average of the model, where one is kept */
    double background[3], background_m[3], background_v[3];
    float step_background[3]; /* of the step in progress */

    sf_view_sampler sampler;
    sf_densify densify;
    sf_selection select;
    sf_merges merges;
    sf_validation validation;
    sf_restore_point restore;
    sf_recovery recovery;
    sf_blur blur;
    sf_cool_down cool_down;
    sf_time_trace trace;

    sf_view_states views; /* empty unless exposure or a refinement is on */
    sf_exposure exposure;

    sf_workspace workspace;
    sf_rng rng;

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

/* fit.c: a fitter without a model; `options` are checked. On failure *fitter is NULL. */
sf_status sf_fitter_create_empty(sf_context *ctx, sf_scene *scene, const sf_fit_options *options,
                                 sf_fitter **fitter);

/* sampler.c: the next training view, the caller's to release. Views that came since the pass began are next;
 * views that went are passed over. SF_ERR_EMPTY: there is no training view. */
sf_status sf_next_view(sf_fitter *fitter, sf_view **view);
/* sampler.c: whether exposure, poses or focal lengths of views are learned. */
int sf_learns_views(const sf_fitter *fitter);

/* draw_view.c: draws a training view at the level, degree and background of the moment, with the camera and
 * the exposure learned of it (state; NULL: nothing is), beside what it is compared with, ready for the loss.
 * *weight_sum: of its pixels. SF_ERR_EMPTY: it is masked altogether. */
sf_status sf_draw_view(sf_fitter *fitter, const sf_view *view, const sf_view_state *state,
                       double *weight_sum);

/* moving_average.c: the model as it is to be seen and tracked against, with means in the place of parameters
 * where they are kept; until the next step, and read alone. Without the memory for it: as the last step left
 * it. */
const sf_model *sf_fitter_average_model(sf_fitter *fitter);
/* The same done to a copy of the model; and the end of what sf_fitter_average_model made. */
void sf_take_moving_average(const sf_fitter *fitter, sf_model *copy);
void sf_average_free(sf_fitter *fitter);

/* memory.c */
/* Forecasts what the fit takes with bands up to sh_degree, and lowers max_gaussians to what fits.
 * SF_ERR_MEMORY, with the figures: not even `least` Gaussians fit. */
sf_status sf_fitter_plan_memory(sf_fitter *fitter, size_t least, int sh_degree);
/* Ends growth where the process takes more than was expected and allowed. */
void sf_fitter_watch_memory(sf_fitter *fitter);

/* time_trace.c */
/* The part of time_limit that has passed, 0..1; 0 without a limit; the plan's where one is followed. */
double sf_time_fraction(const sf_fitter *fitter);
/* The fraction of the run at which the step to come is made; its time is kept. */
double sf_next_fraction(sf_fitter *fitter);
/* SF_ERR_ARGUMENT: ticks that fall or are not below SF_PLAN_TICKS. */
sf_status sf_time_trace_check(sf_context *ctx, const uint32_t *ticks, size_t count);

/* schedule.c: what holds at a fraction of the run. */
double sf_fraction(const sf_fitter *fitter);
/* The fraction where `time` of the time limit has passed. */
double sf_fraction_at(const sf_fitter *fitter, double time);
/* `level`, or the most that leaves a picture of this size large enough. */
int sf_level_within(int level, int width, int height);
/* Halvings of the finest pictures that steps near this fraction are made on. */
int sf_finest_level(const sf_fitter *fitter, double fraction);
int sf_scheduled_level(const sf_fitter *fitter, double fraction, int width, int height);
int sf_scheduled_degree(const sf_fitter *fitter, double fraction);
/* How many steps there are in `seconds`, where one at full resolution takes `step` seconds now. */
double sf_steps_in(const sf_fitter *fitter, double seconds, double step);
/* Fills in what the options leave to the plan, for a run of about `steps`. */
void sf_plan_schedule(sf_fitter *fitter, double steps);
/* The fraction at which the run ends: 1, or sooner where the views of validation gain nothing. */
double sf_end_of_run(const sf_fitter *fitter);
/* Whether the rates fall before their time. */
int sf_cools_down_early(const sf_fitter *fitter);
/* What settling leaves of a learning rate. */
double sf_cooled_rate(const sf_fitter *fitter, double fraction, double rate);
/* Learning rate of a field, in its own units. */
double sf_scheduled_rate(const sf_fitter *fitter, double fraction, int field);
/* Whether this step ends with growth, and the number of Gaussians planned for then. */
int sf_densification_is_due(const sf_fitter *fitter, double fraction);
size_t sf_planned_count(const sf_fitter *fitter, double fraction);

/* What a step from here to the end costs on average, in steps of now: for the ETA. */
double sf_cost_ahead(const sf_fitter *fitter, double fraction);

/* update.c: the way back from the slots' sums to the parameters: gradients, one step of Adam on all fields,
 * the limit on needles, the statistics of growth. d_camera: NULL or [SF_CAMERA_SUMS]. On failure nothing has
 * changed. */
sf_status sf_update(sf_fitter *fitter, double fraction, double *d_camera);
void sf_update_background(sf_fitter *fitter, double fraction, const double *gradient);

/* validation.c */
/* Takes up the training views that came since, `ids` ascending, and keeps some of them out of the training.
 */
sf_status sf_assign_views(sf_fitter *fitter, const uint32_t *ids, size_t count);
/* Whether a training view is kept out of the training. */
int sf_is_in_validation(const sf_fitter *fitter, uint32_t id);
/* PSNR of a view, its values clamped, at full resolution with the model's present degree, and the camera as
 * sf_fitter_get_camera has it; NAN: masked altogether. */
sf_status sf_view_psnr(sf_fitter *fitter, const sf_view *view, double *psnr);
/* Mean PSNR of those views, at full resolution; *views: how many. */
sf_status sf_measure_validation(sf_fitter *fitter, double *psnr, size_t *views);
/* The next model that is looked at is the best: a smaller one is worth what it loses. */
void sf_forget_best_model(sf_fitter *fitter);
/* The model as it is becomes the one to go back to; and comes back, without what the optimiser knew. On
 * failure nothing has changed. */
sf_status sf_save_restore_point(sf_fitter *fitter);
sf_status sf_go_to_restore_point(sf_fitter *fitter);
/* Validates when it is time, keeps the best model, lets the views of validation join the others when the
 * rates fall, and says when the run is over: SF_ERR_END. */
sf_status sf_validation_step(sf_fitter *fitter, double fraction);

/* blur.c */
/* Before a step: when it is time, once, finds the training views that are blurred, and says which. On failure
 * none is, or those that were found. */
sf_status sf_measure_blur(sf_fitter *fitter, double fraction);
int sf_is_blurred(const sf_fitter *fitter, uint32_t id);
/* Leaves blurred views out of most passes: a pass has all views when it begins. */
void sf_skip_blurred_views(sf_fitter *fitter);

/* recovery.c */
/* Before a step: goes back where the losses of the last steps say that the fit diverged; keeps a model to go
 * back to now and then. */
sf_status sf_recovery_step(sf_fitter *fitter);
/* Goes back, and on with lower rates, and counts it. Without a model that is known to be better nothing
 * happens, nor after many times. */
sf_status sf_recover(sf_fitter *fitter, double loss);
/* Views came or went: the losses to come are no measure for those so far. */
void sf_recovery_forget(sf_fitter *fitter);

/* reorder.c */
/* Makes what stands beside a model that a fit begins with, and room for `count` Gaussians in all. */
sf_status sf_fitter_start_room(sf_fitter *fitter, size_t count);
/* Room for banded[b] Gaussians with band b in the model and all arrays beside it, at least. On failure what
 * they hold is as before. */
sf_status sf_fitter_room(sf_fitter *fitter, const size_t banded[SF_BANDS]);
/* The Gaussians become those of places[0..n-1], sorted stably by falling degree, which is no higher than the
 * model's sh_degree: each a copy of Gaussian `from` of before, with its moments and statistics. Bands beyond
 * its degree are dropped, new ones start at 0 with moments of 0. where[k] (may be NULL): the index that
 * places[k] got. Makes room, and lets go what is not needed any more. On failure nothing has changed. */
sf_status sf_reorder(sf_fitter *fitter, const sf_remap_entry *places, size_t n, uint32_t *where);
/* Those of a degree go along a curve through space: what one view does not see fills whole blocks, which a
 * step passes over, and what a tile draws and adds up lies together. On failure nothing has changed. */
sf_status sf_fitter_sort(sf_fitter *fitter);

/* select_merge.c */
/* Ends the trial, all as before. */
void sf_merges_undo_all(sf_fitter *fitter);
void sf_merges_free(sf_fitter *fitter);

/* densify.c */
/* Charges where that is due (select.h); removes what is faint or not finite, then clones and splits up to the
 * plan; or relocates. */
void sf_densify_and_prune(sf_fitter *fitter, double fraction);

/* Removes what is not finite, and says so. */
sf_status sf_drop_not_finite(sf_fitter *fitter);

/* sample_views.c: draws `wanted` of the views that are trained on and not masked altogether, spread over all
 * of them, the same each time or, with `others`, others each time; 0: all. At the level, degree and
 * background of the moment, with the cameras and exposures learned. `look` is called after each, as
 * sf_draw_view leaves it, with the sum of the weights of its pixels; a failure of it ends the looking.
 * pixels: of the full resolution in one of the picture; *there (may be NULL): how many such views there are.
 */
typedef sf_status (*sf_sample_fn)(sf_fitter *fitter, sf_view_state *state, double pixels, double weight_sum,
                                  void *user);
sf_status sf_sample_views(sf_fitter *fitter, size_t wanted, int others, sf_sample_fn look, void *user,
                          size_t *there);

/* densify_score.c: puts in the place of the statistics each Gaussian's part in the error of several training
 * views, and below 0 what none of them shows. On failure they stay as they are. */
sf_status sf_densify_score(sf_fitter *fitter);

/* densify_relocate.c */
/* What is faint or not finite moves to live Gaussians, and `more` join them: drawn by opacity, of the degree
 * of where they come to, and corrected so that the picture stays. Nothing happens where none is live, or on
 * failure. */
sf_status sf_relocate(sf_fitter *fitter, size_t more);
/* Opacity of each of n Gaussians in the place of one of `opacity`, 0 < opacity < 1; *shrink: what to multiply
 * its scales by, so that a line through the middle has the same integral. */
double sf_relocated_opacity(double opacity, uint32_t n, double *shrink);
/* Moves the faint of blocks first .. end-1 at random; strength: world units, for a covariance of 1. */
void sf_inject_noise(sf_fitter *fitter, double strength, size_t first, size_t end);

/* options.c: SF_ERR_ARGUMENT with the option's name if one is out of range. */
sf_status sf_fit_options_check(sf_context *ctx, const sf_fit_options *options);

#endif
