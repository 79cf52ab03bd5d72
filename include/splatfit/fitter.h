/* fitter.h - fits a model to a scene, step by step. */
#ifndef SPLATFIT_FITTER_H
#define SPLATFIT_FITTER_H

#include "model.h"
#include "render.h"
#include "scene.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sf_background {
    SF_BACKGROUND_BLACK,
    SF_BACKGROUND_WHITE,
    SF_BACKGROUND_RANDOM, /* a new colour each step: nothing may stay transparent; evaluated on black */
    SF_BACKGROUND_AUTO,   /* estimated: fitted with the Gaussians */
    SF_BACKGROUND_COLOR   /* background_red, background_green, background_blue */
} sf_background;

/* Every hyperparameter, once: kind, name, default, least, greatest, unit or values, meaning. The struct, its
 * defaults, the range checks, the command line, its help and the log are made from this list.
 *
 * Kinds: INT int64_t; REAL double; FLAG int 0 or 1; ENUM int, values in the order of the text.
 * "of the run" is a fraction of the progress: steps done of steps, or time of time_limit where that is
 * further. */
#define SF_FIT_OPTIONS(INT, REAL, FLAG, ENUM)                                                                \
    INT(steps, 2000, 0, 100000000, "", "optimisation steps; 0: as many as time_limit allows")                \
    REAL(time_limit, 0, 0, 1e9, "s", "stop after this time, the schedule spread over it; 0: no limit")       \
    INT(max_gaussians, 60000, 1, 100000000, "", "hard cap on the number of Gaussians")                       \
    INT(seed, 1, 0, INT64_MAX, "", "seed of every random choice")                                            \
    INT(sh_degree, 3, 0, 3, "", "highest degree of the spherical harmonics")                                 \
    FLAG(antialiased, 0, "compensate opacity for the low-pass (mip) and mark the model so")                  \
    ENUM(background, 0, "black|white|random|auto|color",                                                     \
         "what lies behind the Gaussians; auto estimates it")                                                \
    REAL(background_red, 0, 0, 1, "", "red of background color")                                             \
    REAL(background_green, 0, 0, 1, "", "green of background color")                                         \
    REAL(background_blue, 0, 0, 1, "", "blue of background color")                                           \
    REAL(near_plane, 0.04, 1e-9, 1e3, "extents", "Gaussians nearer to the camera are culled")                \
    REAL(lambda_dssim, 0.2, 0, 1, "", "weight of 1 - SSIM in the loss; the rest is L1")                      \
    REAL(lr_mean, 3.2e-4, 0, 1, "extents", "learning rate of the means at the start")                        \
    REAL(lr_mean_final, 0.05, 1e-9, 1, "", "that rate at the end, as a fraction; exponential between")       \
    REAL(lr_sh0, 0.01, 0, 1, "", "learning rate of SH band 0")                                               \
    REAL(lr_sh_rest, 0.001, 0, 1, "", "learning rate of the higher SH bands")                                \
    REAL(lr_opacity, 0.05, 0, 1, "", "learning rate of the logit-opacities")                                 \
    REAL(lr_scale, 0.01, 0, 1, "", "learning rate of the log-scales")                                        \
    REAL(lr_quat, 0.003, 0, 1, "", "learning rate of the quaternions")                                       \
    REAL(lr_background, 0.005, 0, 1, "", "learning rate of an estimated background")                         \
    REAL(adam_beta1, 0.9, 0, 0.9999, "", "decay of Adam's first moment")                                     \
    REAL(adam_beta2, 0.999, 0, 0.999999, "", "decay of Adam's second moment")                                \
    REAL(adam_epsilon, 1e-15, 1e-30, 1, "", "Adam's epsilon")                                                \
    REAL(init_opacity, 0.1, 0.001, 0.99, "", "opacity of the first Gaussians")                               \
    REAL(init_scale, 1, 0.001, 1000, "", "their scale, in mean distances to the 3 nearest points")           \
    INT(init_random, 10000, 1, 100000000, "", "first Gaussians at random where the scene has no points")     \
    INT(pyramid_levels, 2, 0, 4, "", "halvings of the picture at the start")                                 \
    REAL(pyramid_end, 0.7, 0, 1, "of the run", "full resolution from here on")                               \
    REAL(pyramid_ratio, 0.35, 0.01, 1, "", "end of a coarser level, as a fraction of the next finer one's")  \
    REAL(sh_start, 0.1, 0, 1, "of the run", "SH degree 1 from here on")                                      \
    REAL(sh_end, 0.5, 0, 1, "of the run", "the highest SH degree from here on; the others evenly between")   \
    REAL(grow_start, 0.04, 0, 1, "of the run", "first growth")                                               \
    REAL(grow_end, 0.75, 0, 1, "of the run", "last growth")                                                  \
    INT(grow_every, 100, 1, 100000000, "steps", "steps between growths")                                     \
    REAL(grow_threshold, 0, 0, 1e9, "", "least mean screen gradient (device units) of what grows")           \
    REAL(grow_rate, 0.5, 0, 1, "", "largest growth at once, as a fraction of the Gaussians")                 \
    REAL(split_scale, 0.01, 0, 1e9, "extents",                                                               \
         "larger Gaussians are split along their long axis, others cloned")                                  \
    REAL(prune_opacity, 0.005, 0, 1, "", "fainter Gaussians are removed")                                    \
    REAL(prune_scale, 1, 0, 1e9, "extents", "larger Gaussians are removed; 0: none")                         \
    REAL(max_aspect, 30, 0, 1e9, "", "longest axis limited to this multiple of the middle one; 0: no limit")

#define SF_OPTION_INT(name, value, least, most, unit, text)  int64_t name;
#define SF_OPTION_REAL(name, value, least, most, unit, text) double name;
#define SF_OPTION_FLAG(name, value, text)                    int name;
#define SF_OPTION_ENUM(name, value, values, text)            int name;
typedef struct sf_fit_options {
    SF_FIT_OPTIONS(SF_OPTION_INT, SF_OPTION_REAL, SF_OPTION_FLAG, SF_OPTION_ENUM)
} sf_fit_options;
#undef SF_OPTION_INT
#undef SF_OPTION_REAL
#undef SF_OPTION_FLAG
#undef SF_OPTION_ENUM

SF_API sf_fit_options sf_fit_options_default(void);

typedef enum sf_option_kind { SF_KIND_INT, SF_KIND_REAL, SF_KIND_FLAG, SF_KIND_ENUM } sf_option_kind;

/* One option, as a program needs it to offer it. */
typedef struct sf_option_info {
    const char *name; /* as in the struct, with underscores */
    sf_option_kind kind;
    double value, least, most; /* default and range; an ENUM's value is its index */
    const char *unit;          /* "" if none; of an ENUM: its values, separated by | */
    const char *text;
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

typedef struct sf_fit_progress {
    int64_t step, steps; /* done; planned (0: by time alone) */
    double fraction;     /* of the run, 0..1 */
    double seconds;      /* since create */
    double loss;         /* mean of the last steps, up to 50 */
    size_t gaussians;
    double steps_per_second; /* over the last second or so */
    double eta_seconds;      /* to the end */
    int level;               /* halvings of the picture in the last step */
    int sh_degree;           /* in use */
    uint64_t skipped_values; /* Gaussian-steps left out for a value that was not finite */
    float background[3];
} sf_fit_progress;

typedef struct sf_fitter sf_fitter;

/* Prepares a fit of `scene`, which stays the caller's and outlives the fitter. `from` (may be NULL) is copied
 * and gone on from, with its own SH degree raised to the options'; otherwise the first Gaussians come from
 * the scene's points, or at random where it has none. options NULL: the defaults. SF_ERR_ARGUMENT: an option
 * out of range (named), `from` larger than max_gaussians; SF_ERR_EMPTY: no training view. */
SF_API sf_status sf_fitter_create(sf_context *context, sf_scene *scene, const sf_model *from,
                                  const sf_fit_options *options, sf_fitter **fitter);
SF_API void sf_fitter_destroy(sf_fitter **fitter);

/* Does one step (project, bin, blend, loss, backwards, update; growth when due) on the next training view.
 * SF_ERR_END: the run is complete, nothing was done; SF_ERR_CANCELLED; SF_ERR_EMPTY: no training view is
 * left; SF_ERR_MEMORY: the step was not done, the model is whole. */
SF_API sf_status sf_fitter_step(sf_fitter *fitter);

/* Called between steps, from the thread that runs. */
typedef void (*sf_fit_callback)(void *user, const sf_fit_progress *progress);

/* Steps to the end of the run, calling `callback` (may be NULL) after each step. SF_OK at the end; otherwise
 * as sf_fitter_step. */
SF_API sf_status sf_fitter_run(sf_fitter *fitter, sf_fit_callback callback, void *user);

SF_API void sf_fitter_get_progress(const sf_fitter *fitter, sf_fit_progress *progress);

/* Makes the step in progress the last one, until the next sf_fitter_resume. Safe from any thread and from a
 * signal handler. */
SF_API void sf_fitter_cancel(sf_fitter *fitter);
SF_API void sf_fitter_resume(sf_fitter *fitter);

/* A copy of the model as it is between steps; the caller destroys it. */
SF_API sf_status sf_fitter_snapshot(const sf_fitter *fitter, sf_model **model);

/* Renders the present model with the fit's background and near plane; as sf_render. */
SF_API sf_status sf_fitter_render(sf_fitter *fitter, const sf_camera *camera, const sf_image_out *out);

/* How to render the fit's model as the fit saw it, for sf_render. */
SF_API void sf_fitter_render_options(const sf_fitter *fitter, sf_render_options *options);

#ifdef __cplusplus
}
#endif
#endif
