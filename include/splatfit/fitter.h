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

/* Where the first Gaussians come from. */
typedef enum sf_init {
    SF_INIT_AUTO,   /* the first of the others that there is enough of */
    SF_INIT_POINTS, /* the scene's sparse points */
    SF_INIT_SWEEP,  /* points found by matching the views; at random where too few are found */
    SF_INIT_RANDOM  /* init_random of them behind random pixels of the views */
} sf_init;

/* How the number of Gaussians grows. */
typedef enum sf_densification {
    SF_DENSIFY_GRADIENT, /* what has the largest mean screen gradient is cloned or split */
    SF_DENSIFY_ERROR,    /* what has a part in the error of several training views is */
    SF_DENSIFY_RELOCATE  /* faint ones move to live ones, and new ones join them (3DGS-MCMC) */
} sf_densification;

/* How many Gaussians a fit ends with. */
typedef enum sf_size {
    SF_SIZE_AUTO, /* what pays for itself, up to max_gaussians */
    SF_SIZE_CAP   /* as many as max_gaussians */
} sf_size;

/* What Adam's two moments of means, shapes, opacities and base colours take. */
typedef enum sf_moment_format {
    SF_MOMENTS_FLOAT, /* 8 bytes a parameter */
    SF_MOMENTS_HALF   /* 4 bytes a parameter, rounded at random */
} sf_moment_format;

/* Every hyperparameter, once: kind, name, default, least, greatest, unit or values, meaning. The struct, its
 * defaults, the range checks, the command line, its help and the log are made from this list.
 *
 * Kinds: INT int64_t; REAL double; FLAG int 0 or 1; ENUM int, values in the order of the text.
 * "of the run" is a fraction of the progress: steps done of steps, or time of time_limit where that is
 * further; without steps those done of the plan count too, until the rates fall. */
#define SF_FIT_OPTIONS(INT, REAL, FLAG, ENUM)                                                                \
    INT(steps, 3000, 0, 100000000, "", "optimisation steps; 0: as many as time_limit allows")                \
    REAL(time_limit, 0, 0, 1e9, "s", "stop after this time, the schedule spread over it; 0: no limit")       \
    INT(plan_steps, 0, 0, 100000000, "",                                                                     \
        "steps for which the schedule is planned; 0: steps, or what time_limit seems to allow")              \
    INT(validate, -1, -1, 1000, "",                                                                          \
        "of n training views or more every n-th is kept out, to stop and to choose by, until growth is "     \
        "over and they gain, or the rates fall (with target_psnr to the end, and of 3 or more at least "     \
        "one); 0: none; -1: every 8th, without target_psnr none in a run of fewer than 1000 steps (3000 "    \
        "where time alone ends it)")                                                                         \
    REAL(target_psnr, 0, 0, 100, "dB", "end where the views of validate reach this; 0: no target")           \
    REAL(patience, 0.25, 0, 1, "of the run",                                                                 \
         "the rates fall where they have gained nothing for so long; 0: never")                              \
    REAL(blur, 0.33, 0, 1, "",                                                                               \
         "training views with less than this part of the detail that the model has there, against the "      \
         "median of all, are blurred and count less (not in a run that time ends after fewer than 3000 "     \
         "steps); 0: none")                                                                                  \
    INT(max_gaussians, 150000, 1, 100000000, "", "hard cap on the number of Gaussians")                      \
    ENUM(size, 0, "auto|cap",                                                                                \
         "Gaussians: those that pay for themselves, in runs of 1000 steps or more (3000 where time alone "   \
         "ends them), or as many as max_gaussians")                                                          \
    REAL(merge, 1, 0, 1, "",                                                                                 \
         "size auto: two Gaussians that one stands for but for this part of their square integral become "   \
         "it, on trial; 0: none")                                                                            \
    REAL(quality, 1, 0.001, 1000, "", "size auto: decibels against bits; the price is divided by it")        \
    INT(memory, 0, 0, 1000000000000000, "bytes",                                                             \
        "most memory of the whole process (900M, 2G); lowers max_gaussians; 0: 4/5 of what is free")         \
    INT(seed, 1, 0, INT64_MAX, "", "seed of every random choice")                                            \
    REAL(extent, 0, 0, 1e12, "world units",                                                                  \
         "size of the scene, which rates and limits are measured in; 0: as far as the cameras are apart")    \
    FLAG(open_end, 0, "no end: beyond the plan the run goes on at the rates before they would fall")         \
    INT(sh_degree, 3, 0, 3, "", "highest degree of the spherical harmonics")                                 \
    FLAG(antialiased, 0, "compensate opacity for the low-pass (mip) and mark the model so")                  \
    ENUM(background, 0, "black|white|random|auto|color",                                                     \
         "what lies behind the Gaussians; auto estimates it")                                                \
    REAL(background_red, 0, 0, 1, "", "red of background color")                                             \
    REAL(background_green, 0, 0, 1, "", "green of background color")                                         \
    REAL(background_blue, 0, 0, 1, "", "blue of background color")                                           \
    REAL(near_plane, 0.04, 1e-9, 1e3, "extents", "Gaussians nearer to the camera are culled")                \
    REAL(lambda_dssim, 0.2, 0, 1, "", "weight of 1 - SSIM in the loss; the rest is L1, or Huber's loss")     \
    REAL(huber_delta, 0, 0, 1, "",                                                                           \
         "differences below it count by their squares, d^2 / (2 delta), and the others as |d| - delta / 2: " \
         "with 1e-9 the loss is L1; 0: as plan_steps suggest, L1 where they are many")                       \
    REAL(lr_mean, 4.5e-4, 0, 1, "extents", "learning rate of the means at the start")                        \
    REAL(lr_mean_final, 0.05, 1e-9, 1, "", "that rate at the end, as a fraction; exponential between")       \
    REAL(cool_down, 0.8, 0, 1, "of the run", "all learning rates fall from here on")                         \
    REAL(cool_down_rate, 0.1, 1e-9, 1, "", "to this fraction at the end; exponential between")               \
    REAL(lr_sh0, 0.013, 0, 1, "", "learning rate of SH band 0")                                              \
    REAL(lr_sh_rest, 0.001, 0, 1, "", "learning rate of the higher SH bands")                                \
    REAL(lr_opacity, 0.07, 0, 1, "", "learning rate of the logit-opacities")                                 \
    REAL(lr_scale, 0.015, 0, 1, "", "learning rate of the log-scales")                                       \
    REAL(lr_boost, 0, 0, 100, "",                                                                            \
         "the rates of scales, higher SH bands and a background are so many times as high, those of "        \
         "means, quaternions and opacities by the root of it; 0: as plan_steps suggest")                     \
    REAL(lr_quat, 0.003, 0, 1, "", "learning rate of the quaternions")                                       \
    REAL(lr_background, 0.01, 0, 1, "", "learning rate of an estimated background")                          \
    FLAG(exposure, 0, "learn a gain and a bias per channel of each training picture")                        \
    FLAG(refine_poses, 0, "correct the poses of the training views")                                         \
    FLAG(refine_intrinsics, 0, "correct the focal lengths, which the views of a camera share")               \
    REAL(refine_start, 0.2, 0, 1, "of the run", "poses are corrected from here on")                          \
    FLAG(fix_gauge, 0, "with refine_poses: keep two poses, far apart, not the mean")                         \
    REAL(lr_gain, 0.04, 0, 1, "", "learning rate of an exposure's gains (their logarithms) at the start")    \
    REAL(lr_bias, 0.004, 0, 1, "", "that of its biases")                                                     \
    REAL(lr_pose, 0.0015, 0, 1, "rad", "that of poses: turns, and translations in depths of what is seen")   \
    REAL(lr_focal, 0.003, 0, 1, "", "that of focal lengths (their logarithms)")                              \
    REAL(lr_exposure_final, 0.02, 1e-9, 1, "", "rates of gains and biases at the end, as a fraction")        \
    REAL(lr_camera_final, 0.05, 1e-9, 1, "", "those of poses and focal lengths at the end")                  \
    REAL(adam_beta1, 0.8, 0, 0.9999, "", "decay of Adam's first moment; higher SH have none")                \
    REAL(adam_beta2, 0.99, 0, 0.999999, "", "decay of Adam's second moment")                                 \
    REAL(adam_epsilon, 1e-15, 1e-30, 1, "", "Adam's epsilon")                                                \
    ENUM(moments, 0, "float|half",                                                                           \
         "Adam's moments take 8 bytes a parameter, or 4, rounded at random; higher SH have none")            \
    INT(ema_steps, 0, 0, 100000, "",                                                                         \
        "what is shown and saved is a mean of about so many steps, but of higher SH; 0: the last step")      \
    ENUM(init, 0, "auto|points|sweep|random",                                                                \
         "first Gaussians: the scene's points, found by matching its views, or at random")                   \
    REAL(init_opacity, 0.3, 0.001, 0.99, "", "opacity of the first Gaussians")                               \
    REAL(init_scale, 0.8, 0.001, 1000, "", "their scale, in mean distances to the 3 nearest points")         \
    INT(init_random, 10000, 1, 100000000, "", "first Gaussians at random, where there are no points")        \
    INT(pyramid_levels, 2, 0, 4, "", "halvings of the picture at the start")                                 \
    REAL(pyramid_end, 0, 0, 1, "of the run", "full resolution from here on; 0: as plan_steps suggest")       \
    REAL(pyramid_mix, 0, 0, 1, "of the run",                                                                 \
         "until here every other step at half resolution; 0: as plan_steps suggest")                         \
    REAL(pyramid_ratio, 0.25, 0.01, 1, "", "end of a coarser level, as a fraction of the next finer one's")  \
    REAL(sh_end, 0, 0, 1, "of the run",                                                                      \
         "the highest SH degree from here on, the others evenly before; 0: as plan_steps suggest")           \
    ENUM(densify, 0, "gradient|error|relocate",                                                              \
         "what grows: by mean screen gradient, by error seen in several views; or faint ones move to live "  \
         "ones")                                                                                             \
    INT(error_views, 8, 1, 1000, "", "densify error: training views that are looked at before each")         \
    REAL(relocate_noise, 5e5, 0, 1e12, "",                                                                   \
         "densify relocate: noise of faint means, in covariances (square extents) times the means' rate")    \
    REAL(reg_opacity, 0, 0, 1e6, "", "logits of what is seen fall by so many rates, times the opacity")      \
    REAL(reg_scale, 0, 0, 1e6, "", "log-scales of what is seen fall by so many rates")                       \
    REAL(densify_start, 0, 0, 1, "of the run", "first growth")                                               \
    REAL(densify_end, 0, 0, 1, "of the run", "last growth; 0: as plan_steps suggest")                        \
    REAL(densify_per_step, 26, 0, 1e6, "a step",                                                             \
         "most Gaussians to grow in all, for each step of plan_steps")                                       \
    INT(densify_every, 0, 0, 100000000, "steps", "steps between growths; 0: as plan_steps suggest")          \
    REAL(densify_threshold, 0, 0, 1e9, "",                                                                   \
         "least mean screen gradient (device units) or error (px) of what grows")                            \
    REAL(densify_rate, 0.5, 0, 1, "", "largest growth at once, as a fraction of the Gaussians")              \
    REAL(split_scale, 0, 0, 1e9, "extents",                                                                  \
         "larger Gaussians are split along their long axis, others cloned")                                  \
    REAL(prune_opacity, 0.005, 0, 1, "", "fainter Gaussians are removed, or relocated")                      \
    REAL(max_scale, 1, 0, 1e9, "extents", "no axis grows beyond it; 0: no limit")                            \
    REAL(max_aspect, 30, 0, 1e9, "", "longest axis limited to this multiple of the middle one; 0: no limit")

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

/* The options of a preset: "draft" for seconds, "standard" (the defaults) for a minute, "high" for as good as
 * it gets. SF_ERR_ARGUMENT: no such name; `options` is unchanged. */
SF_API sf_status sf_fit_options_preset(sf_context *context, const char *name, sf_fit_options *options);

/* What an option's value is, and its field's type. */
typedef enum sf_option_kind {
    SF_KIND_INT,  /* int64_t */
    SF_KIND_REAL, /* double */
    SF_KIND_FLAG, /* int: 0 or 1 */
    SF_KIND_ENUM  /* int: one of the values in `unit`, counted from 0 */
} sf_option_kind;

/* One option, as a program needs it to offer it. */
typedef struct sf_option_info {
    const char *name;          /* as in the struct, with underscores */
    sf_option_kind kind;       /* and so the type of its field */
    double value, least, most; /* default and range; an ENUM's value is its index */
    const char *unit;          /* "" if none; of an ENUM: its values, separated by | */
    const char *text;          /* what it means, for a help */
} sf_option_info;

/* Description of option `index`; SF_ERR_END past the last. */
SF_API sf_status sf_fit_option_info(size_t index, sf_option_info *info);

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
    SF_FIT_TARGET,     /* the views of `validate` reached target_psnr */
    SF_FIT_VALIDATION, /* they gained nothing, so that the rates fell early */
    SF_FIT_END_COUNT   /* how many there are */
} sf_fit_end;

/* Where a fit stands, between two steps. */
typedef struct sf_fit_progress {
    int64_t step, steps;     /* done; planned (0: by time alone) */
    double fraction;         /* of the run, 0..1 */
    double seconds;          /* since create */
    double loss;             /* mean of the last steps, up to 50, as far as known; 0: of none */
    double validation_psnr;  /* dB, of the views of `validate` when last looked at; NAN before */
    int64_t best_step;       /* at which it was best, to 0.01 dB; 0 before the first look */
    sf_fit_end end;          /* SF_FIT_GOES_ON while the run goes on */
    size_t gaussians;        /* in the model */
    double steps_per_second; /* over the last second or so */
    double eta_seconds;      /* to the end */
    int level;               /* halvings of the picture in the last step */
    int sh_degree;           /* in use */
    int warm_start;          /* started from a model */
    uint64_t skipped_values; /* Gaussian-steps left out for a value that was not finite */
    int64_t diverged;        /* times that the loss jumped, or was not finite: the fit went back to an earlier
                                model, and on with half the learning rates */
    float background[3];     /* the one in use, as estimated where the options say so */
    /* with refine_poses, medians over the training views: how far poses are from the given ones; with
     * refine_intrinsics: the focal length's change, as a fraction */
    double turned_degrees, moved_depths, focal_change;
} sf_fit_progress;

/* A fit: a model in the making, its optimiser, its place in the run. One thread at a time may use it; what
 * other threads may call says so. */
typedef struct sf_fitter sf_fitter;

/* Prepares a fit of `scene`, which stays the caller's and outlives the fitter. `from` (may be NULL) is copied
 * and gone on from, with its own SH degree raised to the options'; otherwise the first Gaussians are made as
 * options->init says. options NULL: the defaults. SF_ERR_ARGUMENT: an option out of range (named), `from`
 * larger than max_gaussians; SF_ERR_MEMORY: the start does not fit into
 * options->memory; SF_ERR_EMPTY: no training view, or first is points and the scene has none. */
SF_API sf_status sf_fitter_create(sf_context *context, sf_scene *scene, const sf_model *from,
                                  const sf_fit_options *options, sf_fitter **fitter);
SF_API void sf_fitter_destroy(sf_fitter **fitter);

/* Does one step (project, bin, blend, loss, backwards, update; growth when due) on the next training view.
 * SF_ERR_END: the run is complete, nothing was done; SF_ERR_CANCELLED; SF_ERR_EMPTY: no training view is
 * left; SF_ERR_MEMORY: the step was not done, the model is whole. */
SF_API sf_status sf_fitter_step(sf_fitter *fitter);

/* Checkpoints: everything that a fit is between two steps. A fit that is loaded makes the same bytes as one
 * that was never interrupted, with any number of threads, on the same level of the kernels. */

/* Writes a checkpoint, whole or not at all: what stood at `path` stands until then. Call it between steps.
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

/* The plan of a run limited by time: how much of time_limit had passed at each step, in parts of
 * SF_PLAN_TICKS. A run that follows it makes the same bytes on a machine of any speed. */
enum { SF_PLAN_TICKS = 1 << 24 };

/* Copies up to `capacity` steps of the plan so far (ticks may be NULL); *count is how many there are, 0 for a
 * run that knows no time limit. SF_ERR_MEMORY: there was no room to keep it. */
SF_API sf_status sf_fitter_get_plan(const sf_fitter *fitter, uint32_t *ticks, size_t capacity, size_t *count);

/* Before the first step of a fitter with the options that were in effect (sf_fitter_get_options): takes the
 * time of each step from `ticks` [count] (copied), not from the clock, and
 * ends after these steps. SF_ERR_ARGUMENT: ticks fall or reach SF_PLAN_TICKS; a step was done already. */
SF_API sf_status sf_fitter_follow(sf_fitter *fitter, const uint32_t *ticks, size_t count);

/* What a fit was expected to take when it was created, bytes of the whole process. */
typedef struct sf_memory_bill {
    uint64_t budget;    /* memory of the options, or 4/5 of what was free; 0: not known, no limit */
    uint64_t before;    /* resident before the fitter: the program and the pictures */
    uint64_t gaussians; /* model, moments of the optimiser, statistics of growth, for max_gaussians */
    uint64_t lists;     /* Gaussians on the screen, tile lists, sums of gradients, for max_gaussians */
    uint64_t planes;    /* pictures in the making, of the largest view */
    uint64_t results;   /* to write the model or to evaluate it in the end, the larger */
    uint64_t total;     /* of all but the budget */
} sf_memory_bill;

/* The bill of a fit, as it was made when the fitter was created. */
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

/* Takes seconds that went by between steps out of the run's time: what the caller spent on looking at the
 * model does not count against time_limit. Negative: puts them in. */
SF_API void sf_fitter_skip_time(sf_fitter *fitter, double seconds);

/* Between steps: adds Gaussians at points that were found since, as SF_INIT_POINTS makes them: xyz
 * [count][3] and radius [count] (standard deviations) in world units, rgb [count][3]. What is not finite, a
 * radius that is not above 0, and what max_gaussians has no room for is left out; *added (may be NULL): how
 * many were not. SF_ERR_MEMORY: the model is what it was. */
SF_API sf_status sf_fitter_add_points(sf_fitter *fitter, size_t count, const float *xyz, const uint8_t *rgb,
                                      const float *radius, size_t *added);

/* A copy of the model as it is between steps, or of its means (ema_steps); the caller destroys it. */
SF_API sf_status sf_fitter_snapshot(const sf_fitter *fitter, sf_model **model);

/* Renders what sf_fitter_snapshot would copy, with the fit's background and near plane; as sf_render. */
SF_API sf_status sf_fitter_render(sf_fitter *fitter, const sf_camera *camera, const sf_image_out *out);

/* The camera of view `id` as the fit has refined it: pose and focal lengths of a training view; of a held-out
 * view the pose as given, and the focal lengths that training views of the same camera (equal intrinsics as
 * given) have led to. Without refinement: as given. SF_ERR_ARGUMENT: no such view. */
SF_API sf_status sf_fitter_get_camera(const sf_fitter *fitter, uint32_t id, sf_camera *camera);

/* With refine_poses: training view `id` keeps the pose that it was given from now on. Where views are held
 * the others find their places among them, and the mean is not held. SF_ERR_ARGUMENT: no training view of
 * that id was taken up yet. */
SF_API sf_status sf_fitter_hold_pose(sf_fitter *fitter, uint32_t id);

/* Between steps: puts another pose (as in camera.h) in the place of training view id's, as given and as
 * refined. SF_ERR_ARGUMENT: it is no pose, or the fit has not taken up such a view (as sf_fitter_hold_pose).
 */
SF_API sf_status sf_fitter_set_pose(sf_fitter *fitter, uint32_t id, const double R_cw[9],
                                    const double t_cw[3]);

/* sf_scene_save_cameras with the cameras of sf_fitter_get_camera. */
SF_API sf_status sf_fitter_save_cameras(const sf_fitter *fitter, const char *path);

/* A training picture's exposure: it is compared with gain x + bias, at most 1, of the
 * render x. Over the training views
 * the gains' logarithms and the biases have mean 0. 1 and 0 without `exposure`. SF_ERR_ARGUMENT: no training
 * view of that id was taken up yet. */
SF_API sf_status sf_fitter_get_exposure(const sf_fitter *fitter, uint32_t id, double gain[3], double bias[3]);

/* With exposure: a training picture's exposure is taken to be this from now on, and learned on from there;
 * that the means are 0 is seen to by the next step. SF_ERR_ARGUMENT: no training view of that id was taken up
 * yet; a gain that is not above 0 or a value that is not finite. */
SF_API sf_status sf_fitter_set_exposure(sf_fitter *fitter, uint32_t id, const double gain[3],
                                        const double bias[3]);

/* How to render the fit's model as the fit saw it, for sf_render. */
SF_API void sf_fitter_render_options(const sf_fitter *fitter, sf_render_options *options);

#ifdef __cplusplus
}
#endif
#endif
