/* fitter.h - fits a model to a scene, step by step. */
#ifndef SPLATFIT_FITTER_H
#define SPLATFIT_FITTER_H

#include "model.h"
#include "render.h"
#include "scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What lies behind the Gaussians. */
typedef enum sf_background {
    SF_BACKGROUND_BLACK,  /* 0, 0, 0 */
    SF_BACKGROUND_WHITE,  /* 1, 1, 1 */
    SF_BACKGROUND_RANDOM, /* a new colour each step: nothing may stay transparent; evaluated on black */
    SF_BACKGROUND_AUTO,   /* estimated: fitted with the Gaussians */
    SF_BACKGROUND_COLOR   /* background_red, background_green, background_blue */
} sf_background;

/* Where the initial Gaussians come from. */
typedef enum sf_init {
    SF_INIT_AUTO,   /* the first of the following that yields enough Gaussians; beside the scene's points
                       up to init_random / 2 random ones, in parts of the pictures without points */
    SF_INIT_POINTS, /* the scene's sparse points */
    SF_INIT_SWEEP,  /* points from plane-sweep stereo, and random ones in parts of the pictures without */
    SF_INIT_RANDOM  /* init_random Gaussians behind random pixels of the views */
} sf_init;

/* How Gaussians are densified. */
typedef enum sf_densification {
    SF_DENSIFY_GRADIENT, /* Gaussians with the largest mean screen gradients are cloned or split */
    SF_DENSIFY_ERROR,    /* Gaussians that share in the error of several training views are cloned or split */
    SF_DENSIFY_RELOCATE  /* faint Gaussians move to others, and new ones are added there (3DGS-MCMC) */
} sf_densification;

/* How many Gaussians a fit ends with. */
typedef enum sf_size {
    SF_SIZE_AUTO, /* those that reduce the error by more than the pruning threshold, up to max_gaussians */
    SF_SIZE_CAP   /* max_gaussians */
} sf_size;

/* The format of Adam's two moments of means, shapes, opacities and base colours. */
typedef enum sf_moment_format {
    SF_MOMENTS_FLOAT, /* 8 bytes a parameter */
    SF_MOMENTS_HALF   /* 4 bytes a parameter, stochastic rounding */
} sf_moment_format;

/* Every hyperparameter, once: kind, name, default, least, greatest, unit or values, meaning. The struct, its
 * defaults, the range checks, the command line, its help and the log are made from this list.
 *
 * Kinds: INT int64_t; REAL double; FLAG int 0 or 1; ENUM int, values in the order of the text.
 * The unit "of the run" is a fraction of the progress: steps done of `steps`, or time passed of `time_limit`,
 * whichever is greater. Where `steps` is 0, steps done of `plan_steps` count too, until the cool-down. */
#define SF_FIT_OPTIONS(INT, REAL, FLAG, ENUM)                                                                \
    INT(steps, 3000, 0, 100000000, "", "optimisation steps; 0: as many as time_limit allows")                \
    REAL(time_limit, 0, 0, 1e9, "s", "stop after this time; the schedule is spread over it; 0: no limit")    \
    INT(plan_steps, 0, 0, 100000000, "",                                                                     \
        "steps for which the schedule is planned; 0: steps, or as many as time_limit seems to allow")        \
    INT(validate, -1, -1, 1000, "",                                                                          \
        "validation set: every n-th of n or more training views; it decides when to stop and which model "   \
        "to keep, and is merged back into training when the learning rates start to fall, or earlier if it " \
        "still gains shortly before (with target_psnr never, and of 3 or more views at least one is "        \
        "taken); 0: none; -1: every 8th, but without target_psnr none in a run of fewer than 1000 steps "    \
        "(3000 where time alone ends it)")                                                                   \
    REAL(target_psnr, 0, 0, 100, "dB", "stop when the validation set reaches this PSNR; 0: no target")       \
    REAL(patience, 0.25, 0, 1, "of the run",                                                                 \
         "start to lower the learning rates when the validation PSNR has not risen for this long; 0: never") \
    REAL(blur, 0.33, 0, 1, "",                                                                               \
         "a training view counts as blurred, and is trained on less often, if its detail relative to the "   \
         "model's is below this fraction of the median over all views (not in a run that time ends after "   \
         "fewer than 3000 steps); 0: never")                                                                 \
    INT(max_gaussians, 150000, 1, 100000000, "", "hard cap on the number of Gaussians")                      \
    ENUM(size, 0, "auto|cap",                                                                                \
         "number of Gaussians: auto keeps those that reduce the error enough, in runs of 1000 steps or "     \
         "more (3000 where time alone ends them); cap aims at max_gaussians")                                \
    REAL(merge, 1, 0, 1, "",                                                                                 \
         "size auto: two Gaussians are tentatively merged if one Gaussian differs from them by at most "     \
         "this fraction of their square integral; 0: never")                                                 \
    REAL(quality, 1, 0.001, 1000, "",                                                                        \
         "size auto: the pruning threshold is divided by this, so that a higher value keeps more Gaussians") \
    INT(memory, 0, 0, 1000000000000000, "bytes",                                                             \
        "most memory of the whole process (900M, 2G): pictures beyond half of it go to a file in TMPDIR or " \
        "/var/tmp, and max_gaussians is lowered; 0: 4/5 of what is free")                                    \
    INT(seed, 1, 0, INT64_MAX, "", "seed of every random choice")                                            \
    REAL(extent, 0, 0, 1e12, "world units",                                                                  \
         "size of the scene, for first points and a given near_plane; 0: computed from points and cameras")  \
    FLAG(open_end, 0,                                                                                        \
         "no end: after the planned steps the run continues, and the learning rates do not fall")            \
    INT(sh_degree, 3, 0, 3, "", "highest degree of the spherical harmonics")                                 \
    FLAG(antialiased, 0, "compensate opacity for the low-pass (mip) and mark the model so")                  \
    ENUM(background, 0, "black|white|random|auto|color", "colour behind the Gaussians; auto estimates it")   \
    REAL(background_red, 0, 0, 1, "", "red of background color")                                             \
    REAL(background_green, 0, 0, 1, "", "green of background color")                                         \
    REAL(background_blue, 0, 0, 1, "", "blue of background color")                                           \
    REAL(near_plane, 0, 0, 1e3, "extents",                                                                   \
         "Gaussians nearer to the camera are culled; 0: chosen for each view")                               \
    REAL(lambda_dssim, 0.2, 0, 1, "", "weight of 1 - SSIM in the loss; the rest is L1, or Huber's loss")     \
    REAL(huber_delta, 0, 0, 1, "",                                                                           \
         "Huber loss: a difference d below delta counts as d^2 / (2 delta), a larger one as |d| - delta / "  \
         "2; 1e-9 makes it L1; 0: chosen by plan_steps, L1 for long runs")                                   \
    REAL(lr_mean, 1.3e-3, 0, 1, "half pictures", "learning rate of the means at the start")                  \
    REAL(lr_mean_final, 0.05, 1e-9, 1, "",                                                                   \
         "rate of the means at the end, as a fraction of lr_mean; exponential between")                      \
    REAL(cool_down, 0.8, 0, 1, "of the run", "start of the cool-down, in which all learning rates fall")     \
    REAL(cool_down_rate, 0.1, 1e-9, 1, "",                                                                   \
         "factor on all learning rates at the end of the cool-down; exponential between")                    \
    REAL(lr_sh0, 0.013, 0, 1, "", "learning rate of SH band 0")                                              \
    REAL(lr_sh_rest, 0.001, 0, 1, "", "learning rate of the higher SH bands")                                \
    REAL(lr_opacity, 0.07, 0, 1, "", "learning rate of the logit-opacities")                                 \
    REAL(lr_scale, 0.015, 0, 1, "", "learning rate of the log-scales")                                       \
    REAL(lr_boost, 0, 0, 100, "",                                                                            \
         "factor on the learning rates of scales, higher SH bands and a background; those of means, "        \
         "quaternions and opacities get its square root; 0: chosen by plan_steps")                           \
    REAL(lr_quat, 0.003, 0, 1, "", "learning rate of the quaternions")                                       \
    REAL(lr_background, 0.01, 0, 1, "", "learning rate of an estimated background")                          \
    FLAG(exposure, 0, "learn a gain and a bias per channel of each training picture")                        \
    FLAG(refine_poses, 0, "correct the poses of the training views")                                         \
    FLAG(refine_intrinsics, 0, "correct the focal lengths, which the views of a camera share")               \
    REAL(refine_start, 0.1, 0, 1, "of the run", "poses are corrected from here on")                          \
    FLAG(fix_gauge, 0,                                                                                       \
         "with refine_poses: fix the gauge by two poses, far apart, in place of the mean of all poses")      \
    REAL(lr_gain, 0.04, 0, 1, "",                                                                            \
         "learning rate of the exposures' gains (of their logarithms) at the start")                         \
    REAL(lr_bias, 0.004, 0, 1, "", "learning rate of the exposures' biases at the start")                    \
    REAL(lr_pose, 0.003, 0, 1, "rad",                                                                        \
         "longest step of poses at the start: rotations, and translations in units of the views' depths")    \
    REAL(lr_focal, 0.003, 0, 1, "", "learning rate of focal lengths (of their logarithms) at the start")     \
    REAL(lr_exposure_final, 0.02, 1e-9, 1, "",                                                               \
         "rates of gains and biases at the end, as a fraction of those at the start")                        \
    REAL(lr_camera_final, 0.05, 1e-9, 1, "",                                                                 \
         "rates of poses and focal lengths at the end, as a fraction of those at the start")                 \
    REAL(adam_beta1, 0.8, 0, 0.9999, "",                                                                     \
         "decay of Adam's first moment; higher SH bands have no first moment")                               \
    REAL(adam_beta2, 0.99, 0, 0.999999, "", "decay of Adam's second moment")                                 \
    REAL(adam_epsilon, 1e-15, 1e-30, 1, "", "Adam's epsilon")                                                \
    ENUM(moments, 0, "float|half",                                                                           \
         "format of Adam's moments: 8 bytes a parameter, or 4 with stochastic rounding; does not affect "    \
         "higher SH bands")                                                                                  \
    INT(ema_steps, 0, 0, 100000, "",                                                                         \
        "show and save a moving average over about this many steps, except of higher SH bands; 0: the "      \
        "values of the last step")                                                                           \
    ENUM(init, 0, "auto|points|sweep|random",                                                                \
         "initialisation: from the scene's points, from points found by plane-sweep stereo, or at random")   \
    REAL(init_opacity, 0.3, 0.001, 0.99, "", "opacity of the initial Gaussians")                             \
    REAL(init_scale, 0.8, 0.001, 1000, "",                                                                   \
         "scale of the initial Gaussians, in mean distances to the 3 nearest points")                        \
    INT(init_random, 10000, 1, 100000000, "",                                                                \
        "number of initial Gaussians at random positions, in parts of the pictures without points; half as " \
        "many beside the scene's own points")                                                                \
    INT(pyramid_levels, 2, 0, 4, "", "how often the picture's size is halved at the start")                  \
    REAL(pyramid_end, 0, 0, 1, "of the run", "full resolution from here on; 0: chosen by plan_steps")        \
    REAL(pyramid_mix, 0, 0, 1, "of the run",                                                                 \
         "until here every other step is at half resolution; 0: chosen by plan_steps")                       \
    REAL(pyramid_ratio, 0.25, 0.01, 1, "", "end of a coarser level, as a fraction of the next finer one's")  \
    REAL(sh_end, 0, 0, 1, "of the run",                                                                      \
         "highest SH degree from here on, lower degrees in even intervals before; 0: chosen by plan_steps")  \
    ENUM(densify, 0, "gradient|error|relocate",                                                              \
         "densification: by mean screen gradient; by error seen in several views; or relocate, which moves " \
         "faint Gaussians to others (3DGS-MCMC)")                                                            \
    INT(error_views, 8, 1, 1000, "",                                                                         \
        "densify error: training views that are sampled before each densification")                          \
    REAL(relocate_noise, 5e5, 0, 1e12, "",                                                                   \
         "densify relocate: noise added to the means of faint Gaussians, in covariances (square half "       \
         "pictures) times the means' rate")                                                                  \
    REAL(reg_opacity, 0, 0, 1e6, "",                                                                         \
         "each step lowers the logit-opacity of a visible Gaussian by this times its opacity times the "     \
         "opacities' learning rate")                                                                         \
    REAL(reg_scale, 0, 0, 1e6, "",                                                                           \
         "each step lowers the log-scales of a visible Gaussian by this times the scales' learning rate")    \
    REAL(densify_start, 0, 0, 1, "of the run", "first densification")                                        \
    REAL(densify_end, 0, 0, 1, "of the run", "last densification; 0: chosen by plan_steps")                  \
    REAL(densify_per_step, 26, 0, 1e6, "a step",                                                             \
         "most Gaussians to add in all, for each step of plan_steps")                                        \
    INT(densify_every, 0, 0, 100000000, "steps", "steps between densifications; 0: chosen by plan_steps")    \
    REAL(densify_threshold, 0, 0, 1e9, "",                                                                   \
         "least mean screen gradient (device units) or error (px) of a Gaussian that is densified")          \
    REAL(densify_rate, 0.5, 0, 1, "",                                                                        \
         "most Gaussians that one densification adds, as a fraction of those that exist")                    \
    REAL(split_scale, 0, 0, 1e9, "half pictures",                                                            \
         "larger Gaussians are split along their long axis, others cloned")                                  \
    REAL(prune_opacity, 0.005, 0, 1, "", "fainter Gaussians are removed, or relocated")                      \
    REAL(max_scale, 0.7, 0, 1e9, "half pictures", "no axis grows beyond this; 0: no limit")                  \
    REAL(max_aspect, 30, 0, 1e9, "",                                                                         \
         "the longest axis is at most this multiple of the middle one; 0: no limit")

#define SF_OPTION_INT(name, value, least, most, unit, text)  int64_t name;
#define SF_OPTION_REAL(name, value, least, most, unit, text) double name;
#define SF_OPTION_FLAG(name, value, text)                    int name;
#define SF_OPTION_ENUM(name, value, values, text)            int name;
/* One field for each entry of SF_FIT_OPTIONS. Start from sf_fit_options_default(). */
typedef struct sf_fit_options {
    SF_FIT_OPTIONS(SF_OPTION_INT, SF_OPTION_REAL, SF_OPTION_FLAG, SF_OPTION_ENUM)
} sf_fit_options;
#undef SF_OPTION_INT
#undef SF_OPTION_REAL
#undef SF_OPTION_FLAG
#undef SF_OPTION_ENUM

/* The defaults of SF_FIT_OPTIONS, which are the preset "standard". */
SF_API sf_fit_options sf_fit_options_default(void);

/* The options of a preset: "draft" takes seconds, "standard" (the defaults) a minute, "high" minutes for the
 * best quality. SF_ERR_ARGUMENT: no such name; `options` is unchanged. */
SF_API sf_status sf_fit_options_preset(sf_context *context, const char *name, sf_fit_options *options);

/* The kind of an option's value, and the type of its field. */
typedef enum sf_option_kind {
    SF_KIND_INT,  /* int64_t */
    SF_KIND_REAL, /* double */
    SF_KIND_FLAG, /* int: 0 or 1 */
    SF_KIND_ENUM  /* int: one of the values in `unit`, counted from 0 */
} sf_option_kind;

/* The description of one option, for a program's command line or dialogue. */
typedef struct sf_option_info {
    const char *name;          /* as in the struct, with underscores */
    sf_option_kind kind;       /* tells the type of its field */
    double value, least, most; /* default and range; an ENUM's value is its index */
    const char *unit;          /* "" if none; of an ENUM: its values, separated by | */
    const char *text;          /* its meaning, for a help text */
} sf_option_info;

/* Description of option `index`; SF_ERR_END past the last. */
SF_API sf_status sf_fit_option_info(size_t index, sf_option_info *info);

/* The name that an option (as in the struct) had in version 0.1.0, NULL if it had the same or none. Functions
 * that take a name, and the command line, still accept it. */
SF_API const char *sf_fit_option_former(const char *name);

/* Sets an option by name (with - or _) from text. SF_ERR_ARGUMENT: no such name, not a number, out of range;
 * the message is in sf_last_error, `options` is unchanged. */
SF_API sf_status sf_fit_options_set(sf_context *context, sf_fit_options *options, const char *name,
                                    const char *text);

/* The value of an option as text that sf_fit_options_set reads back. SF_ERR_ARGUMENT: no such name, no room.
 */
SF_API sf_status sf_fit_options_get(const sf_fit_options *options, const char *name, char *text, size_t size);

/* Why a run has ended. */
typedef enum sf_fit_end {
    SF_FIT_GOES_ON,    /* it has not */
    SF_FIT_COMPLETE,   /* all its steps are done */
    SF_FIT_TIME,       /* time_limit is over */
    SF_FIT_TARGET,     /* the validation set reached target_psnr */
    SF_FIT_VALIDATION, /* the validation PSNR stopped rising, so that the cool-down began early */
    SF_FIT_END_COUNT   /* how many there are */
} sf_fit_end;

/* Where a fit stands, between two steps. */
typedef struct sf_fit_progress {
    int64_t step, steps;    /* done; planned (0: by time alone) */
    double fraction;        /* of the run, 0..1 */
    double seconds;         /* since create */
    double loss;            /* mean of up to 50 last steps whose loss is known; 0 before the first step */
    double validation_psnr; /* dB, of the validation set when last measured; NAN before */
    int64_t best_step; /* at which validation_psnr was best, to 0.01 dB; 0 before the first measurement */
    sf_fit_end end;    /* SF_FIT_GOES_ON while the run goes on */
    size_t gaussians;  /* in the model */
    double steps_per_second; /* over the last second or so */
    double eta_seconds;      /* to the end */
    int level;               /* halvings of the picture in the last step */
    int sh_degree;           /* in use */
    int warm_start;          /* warm start: the fit started from a model */
    uint64_t skipped_values; /* updates of a Gaussian that were skipped for a value that is not finite */
    int64_t diverged;    /* times that the fit diverged (its loss jumped or was not finite), went back to an
                            earlier model and continued with half the learning rates */
    float background[3]; /* the one in use, estimated with SF_BACKGROUND_AUTO */
    /* with refine_poses, medians over the training views: rotation and translation from the given poses; with
     * refine_intrinsics: the relative change of the focal length */
    double turned_degrees, moved_depths, focal_change;
} sf_fit_progress;

/* A fit: the model that is fitted, the optimiser's state, the progress of the run. One thread at a time may
 * use it, except for functions whose comments say otherwise. */
typedef struct sf_fitter sf_fitter;

/* Prepares a fit of `scene`, which stays the caller's and outlives the fitter. If `from` is not NULL, the fit
 * starts from a copy of it (a warm start), its SH degree raised to the options'; otherwise Gaussians are
 * initialised as options->init says. options NULL: the defaults. SF_ERR_ARGUMENT: an option out of range
 * (named), `from` larger than max_gaussians; SF_ERR_MEMORY: the start does not fit into options->memory;
 * SF_ERR_EMPTY: no training view, or first is points and the scene has none. */
SF_API sf_status sf_fitter_create(sf_context *context, sf_scene *scene, const sf_model *from,
                                  const sf_fit_options *options, sf_fitter **fitter);
SF_API void sf_fitter_destroy(sf_fitter **fitter);

/* Does one step (project, bin, blend, loss, gradients, update; densification when due) on the next training
 * view. SF_ERR_END: the run is complete, nothing was done; SF_ERR_CANCELLED; SF_ERR_EMPTY: no training view
 * is left; SF_ERR_MEMORY, SF_ERR_IO (a picture in a file cannot be read): the step was not done, the model is
 * whole. */
SF_API sf_status sf_fitter_step(sf_fitter *fitter);

/* Checkpoints hold the whole state of a fit between two steps. A fit that is loaded makes the same bytes as
 * one that was never interrupted, with any number of threads, on the same level of the kernels. */

/* Writes a checkpoint, whole or not at all: an older file at `path` stays until then. Call it between steps.
 * SF_ERR_IO, SF_ERR_MEMORY. */
SF_API sf_status sf_fitter_save(const sf_fitter *fitter, const char *path);

/* The options of the run in a checkpoint. Errors as sf_fitter_load; `options` is then unchanged. */
SF_API sf_status sf_checkpoint_options(sf_context *context, const char *path, sf_fit_options *options);

/* A fitter as it was when the checkpoint was written; time goes on from then. `scene` must hold the same
 * views. options NULL: those of the checkpoint; only steps, time_limit and memory may differ from them.
 * SF_ERR_IO: the file cannot be read; SF_ERR_FORMAT: it is no checkpoint, cut off or damaged;
 * SF_ERR_UNSUPPORTED: of another version; SF_ERR_ARGUMENT: of another scene (the view is named), an option
 * that may not differ (named). On failure *fitter is NULL. */
SF_API sf_status sf_fitter_load(sf_context *context, sf_scene *scene, const char *path,
                                const sf_fit_options *options, sf_fitter **fitter);

/* The time trace of a run limited by time: for each step the part of time_limit that had passed, in units of
 * 1 / SF_PLAN_TICKS. A run that follows the trace makes the same bytes on a machine of any speed. */
enum { SF_PLAN_TICKS = 1 << 24 };

/* Copies up to `capacity` steps of the time trace so far (ticks may be NULL); *count is how many there are, 0
 * for a run without a time limit. SF_ERR_MEMORY: there was no memory to keep the trace. */
SF_API sf_status sf_fitter_get_plan(const sf_fitter *fitter, uint32_t *ticks, size_t capacity, size_t *count);

/* Before the first step of a fitter with the options that were in effect (sf_fitter_get_options): takes the
 * time of each step from `ticks` [count] (copied), not from the clock, and
 * ends after these steps. SF_ERR_ARGUMENT: ticks fall or reach SF_PLAN_TICKS; a step was done already. */
SF_API sf_status sf_fitter_follow(sf_fitter *fitter, const uint32_t *ticks, size_t count);

/* The memory estimate of a fit, made when it was created: bytes of the whole process. */
typedef struct sf_memory_bill {
    uint64_t budget;    /* memory of the options, or 4/5 of what was free; 0: not known, no limit */
    uint64_t before;    /* the program and the pictures, or the buffers of those that are in a file */
    uint64_t gaussians; /* for max_gaussians: the model, optimizer state, statistics of densification */
    uint64_t lists;     /* for max_gaussians: projected Gaussians, tile lists, sums of gradients */
    uint64_t planes;    /* for the largest view: rendered pictures and intermediate planes */
    uint64_t results;   /* what writing or evaluating the final model takes beyond lists and planes,
                           which are freed before */
    uint64_t total;     /* the sum of all but the budget */
} sf_memory_bill;

/* The estimate alone, of a fit of `scene` from its points; the pictures of a scene without pixels count as if
 * they had been read within that memory. options NULL: the defaults. Errors as sf_fitter_create; the bill is
 * then unchanged. */
SF_API sf_status sf_fit_memory(sf_context *context, sf_scene *scene, const sf_fit_options *options,
                               sf_memory_bill *bill);

/* The memory estimate that was made when the fitter was created. */
SF_API void sf_fitter_get_memory(const sf_fitter *fitter, sf_memory_bill *bill);

/* The options in effect: max_gaussians is lowered to what the memory holds. */
SF_API void sf_fitter_get_options(const sf_fitter *fitter, sf_fit_options *options);

/* Called between steps, from the thread that runs. */
typedef void (*sf_fit_callback)(void *user, const sf_fit_progress *progress);

/* Steps to the end of the run, calling `callback` (may be NULL) after each step. SF_OK at the end; otherwise
 * as sf_fitter_step. */
SF_API sf_status sf_fitter_run(sf_fitter *fitter, sf_fit_callback callback, void *user);

/* Where the fit stands. Call it between steps. */
SF_API void sf_fitter_get_progress(const sf_fitter *fitter, sf_fit_progress *progress);

/* Makes the step in progress the last one, until the next sf_fitter_resume. Safe from any thread and from a
 * signal handler. */
SF_API void sf_fitter_cancel(sf_fitter *fitter);
SF_API void sf_fitter_resume(sf_fitter *fitter);

/* Subtracts seconds that passed between steps from the run's time, so that the caller's own work, such as an
 * evaluation, does not count against time_limit. Negative values add to the run's time. */
SF_API void sf_fitter_skip_time(sf_fitter *fitter, double seconds);

/* Between steps: adds Gaussians at new points, made as SF_INIT_POINTS makes them: xyz [count][3] and radius
 * [count] (standard deviations) in world units, rgb [count][3]. Points that are not finite, that have a
 * radius of 0 or less, or that would exceed max_gaussians are left out; *added (may be NULL): how many were
 * added. SF_ERR_MEMORY: the model is unchanged. */
SF_API sf_status sf_fitter_add_points(sf_fitter *fitter, size_t count, const float *xyz, const uint8_t *rgb,
                                      const float *radius, size_t *added);

/* A copy of the current model, or of its moving average (ema_steps); the caller destroys it. */
SF_API sf_status sf_fitter_snapshot(const sf_fitter *fitter, sf_model **model);
/* The same of the Gaussians that this rank has (cluster.h): all where there are no others. */
SF_API sf_status sf_fitter_snapshot_part(const sf_fitter *fitter, sf_model **part);

/* Writes what sf_fitter_snapshot would copy, as sf_model_save_as does. Of several ranks rank 0 writes; for a
 * .ply no rank holds the whole model. */
SF_API sf_status sf_fitter_save_model(const sf_fitter *fitter, const char *path,
                                      const sf_model_file_options *options);

/* Renders the model that sf_fitter_snapshot would copy, with the fit's background and near plane; as
 * sf_render. */
SF_API sf_status sf_fitter_render(sf_fitter *fitter, const sf_camera *camera, const sf_image_out *out);

/* The quality of that render of view `id`, a training or a held-out one, from the camera that
 * sf_fitter_get_camera tells. Takes less memory than sf_fitter_render and sf_compare: of several ranks (all
 * must call it) each draws and measures a band of the picture. SF_ERR_ARGUMENT: no such view, or its pixels
 * were not read; SF_ERR_EMPTY: it is wholly masked. */
SF_API sf_status sf_fitter_compare(sf_fitter *fitter, uint32_t id, sf_quality *quality);

/* The camera of view `id` as the fit has refined it. A training view has its refined pose and focal lengths.
 * A held-out view is moved by what the corrections of the training views next to it have in common, without a
 * look at its picture, and has the refined focal lengths of the training views whose given intrinsics equal
 * its own. Without refinement: as given. SF_ERR_ARGUMENT: no such view. */
SF_API sf_status sf_fitter_get_camera(const sf_fitter *fitter, uint32_t id, sf_camera *camera);

/* With refine_poses: training view `id` keeps its given pose from now on. Held views fix the gauge, so that
 * the mean of all poses is then free to move. SF_ERR_ARGUMENT: the fit has no training view of that id yet.
 */
SF_API sf_status sf_fitter_hold_pose(sf_fitter *fitter, uint32_t id);

/* Between steps: replaces the given and the refined pose of training view `id` (conventions as in camera.h).
 * SF_ERR_ARGUMENT: the values are not a pose, or the fit has no training view of that id yet. */
SF_API sf_status sf_fitter_set_pose(sf_fitter *fitter, uint32_t id, const double R_cw[9],
                                    const double t_cw[3]);

/* sf_scene_save_cameras with the cameras of sf_fitter_get_camera. */
SF_API sf_status sf_fitter_save_cameras(const sf_fitter *fitter, const char *path, int world);

/* A training picture's exposure: the picture is compared with min(gain x + bias, 1), where x is the render.
 * The logarithms of the gains and the biases have mean 0 over the training views. Without the option
 * `exposure`: gain 1, bias 0. SF_ERR_ARGUMENT: the fit has no training view of that id yet. */
SF_API sf_status sf_fitter_get_exposure(const sf_fitter *fitter, uint32_t id, double gain[3], double bias[3]);

/* With the option `exposure`: sets a training picture's exposure, from which the fit continues to learn. The
 * next step brings the means over all views back to 0. SF_ERR_ARGUMENT: the fit has no training view of that
 * id yet; a gain of 0 or less, a value that is not finite. */
SF_API sf_status sf_fitter_set_exposure(sf_fitter *fitter, uint32_t id, const double gain[3],
                                        const double bias[3]);

/* How to render the fit's model as the fit saw it, for sf_render. */
SF_API void sf_fitter_render_options(const sf_fitter *fitter, sf_render_options *options);

#ifdef __cplusplus
}
#endif
#endif
