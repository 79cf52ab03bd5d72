/* app.h - functions that the subcommands share. The program uses only the public interface, except for bench,
 * chart, and the description of the machine in a fit's log. */
#ifndef APP_APP_H
#define APP_APP_H

#include <jansson.h>

#include <splatfit/splatfit.h>

#include "args.h"

extern const command command_fit, command_render, command_eval, command_info, command_devices,
    command_capture, command_cameras, command_board, command_calibrate, command_bench, command_chart,
    command_convert, command_prune, command_live, command_view;

/* Tables of options that several commands take. Every command that reads a model takes
 * model_options, and all but fit, where --antialiased is a hyperparameter, compensation_options. */
extern const arg_option common_options[], compensation_options[], load_options[], model_options[],
    world_options[], render_options[];

/* parts.c: which libraries are built in, on standard output. */
void app_parts(void);

/* licences.c: what is linked, and under which terms, on standard output. */
void app_licences(void);

/* Prints the context's last error on standard error ("splatfit NAME: ...") and returns EXIT_FAILED. */
int app_fail(const args *a, const sf_context *ctx);
int app_say(const args *a, const char *subject, const char *what);

/* --spz-frame; and fails unless --antialiased, where the command takes it, is yes or no. 0 or an exit code.
 */
int app_model_options(const args *a, sf_model_file_options *options);
/* A model, read as these two tables say. 0 or an exit code. */
sf_status app_save_model(const args *a, const sf_model *model, const char *path);
sf_status app_save_fitted(const args *a, const sf_fitter *fitter, const char *path);
int app_load_model(const args *a, sf_context *ctx, const char *path, sf_model **model);
/* The same of a model that is looked at, with a warning where it holds no Gaussians. */
int app_load_shown(const args *a, sf_context *ctx, const char *path, sf_model **model);
int app_load_part(const args *a, sf_context *ctx, const char *path, int part, int parts, sf_model **model);

/* A context as --threads, --isa and --quiet say. 0 or an exit code. */
int app_context(const args *a, sf_context **ctx);
/* Moves the program to the processors of --cores, if it is given; app_context does. */
int app_cores(const args *a);

/* The scene at `path` as the load options say. 0 or an exit code. The second is without pixels, the third
 * holds the process to `memory` bytes (sf_load_options). */
int app_load(const args *a, sf_context *ctx, const char *path, sf_scene **scene);
int app_load_cameras(const args *a, sf_context *ctx, const char *path, sf_scene **scene);
int app_load_within(const args *a, sf_context *ctx, const char *path, int64_t memory, sf_scene **scene);

/* Fails if one of the load options is given, since `what` is no project. 0 or an exit code. */
int app_refuse_load_options(const args *a, const char *what);

/* project_model.c: a scene's points and cameras as Gaussians, to be looked at. 0 or an exit code. */
int app_project_model(const args *a, sf_context *ctx, sf_scene *scene, sf_model **model);

/* signals.c: sf_scene_load. SIGINT, SIGTERM or SIGHUP meanwhile cancels the load, which leaves no unpacked
 * archive, and then ends the program. 0 or an exit code. */
int app_load_caught(const args *a, sf_context *ctx, const char *path, const sf_load_options *options,
                    sf_scene **scene);

/* Reads a colour: "R,G,B" (0..1), "black" or "white". Returns 0 if the text is not a colour. */
int app_color(const char *text, float color[3]);

/* How to render a model in a scene (NULL: in none): background and near plane, as --background and
 * --near-plane say. 0 or an exit code. */
int app_render_options(const args *a, sf_render_options *options);

/* Whether a view is meant by --split (test, train, all; `otherwise` where it was not given). */
int app_split_wants(const args *a, const char *otherwise, sf_split split);
int app_split_check(const args *a);

/* hyperparameters.c: sets those hyperparameters that the command line names; 0 or an exit code. All of them
 * as JSON. */
int app_fit_options(const args *a, sf_context *ctx, sf_fit_options *options);
json_t *app_options_json(const sf_fit_options *options);

/* The most memory that the process has had resident, in MB. */
double app_peak_memory(void);

/* The lens in the file that --lens names, which must be for pictures of the source's size; left alone where
 * it was not given. 0 or an exit code. */
int app_lens(const args *a, sf_context *ctx, const sf_source *source, sf_lens *lens);

/* Whether `path` can be written, as far as that can be told without writing. 0 or an exit code. */
int app_check_output(const args *a, const char *path);

/* The same of a model that is to be written: its name also has an ending that is known. */
int app_check_model(const args *a, sf_context *ctx, const char *path);

/* The file that option `name` says to write; NULL where it says none, or was not given. */
const char *app_output(const args *a, const char *name);
/* The same of the model `output`, which may be NULL, and of the files that the options names [n] say to
 * write; none is named twice. */
int app_check_outputs(const args *a, sf_context *ctx, const char *output, const char *const *names, int n);

/* Whether a path ends as the files of models do: .ply, .spz, .splat, .glb, .gltf, .sog. */
int app_names_model(const char *path);

/* The folder of a path, with its slash; "" if it has none. free() it. */
char *app_folder(const char *path);

/* freeze.c: with --freeze, makes options of which no step changes anything of `from`, which may be NULL, or
 * one rank's part of a model of `count` Gaussians. 0 or an exit code. */
int app_freeze(const args *a, sf_context *ctx, sf_model *from, size_t count, sf_fit_options *options);

/* Where a fit writes the cameras of the model at `path`: splat.cameras.json beside splat.ply, whatever format
 * the model has. free() it; NULL: out of memory. */
char *app_cameras_beside(const char *path);
/* The cameras that were written beside a model: the file of this name, else the cameras.json of its folder,
 * as other trainers write it. free() it; NULL: there are none. */
char *app_find_cameras_beside(const char *path);

/* From here on the first SIGINT, SIGTERM or SIGHUP calls `fn`, in its handler (NULL: nothing), and is told by
 * app_stopped_by, 0 before; another one ends the program, unless it comes within a second of the first. */
void app_catch_signals(void (*fn)(void));
int app_stopped_by(void);

/* Seconds of the monotonic clock. */
double app_seconds(void);

/* Makes the folders of a path: all but its last part; or all. 0 or an exit code. */
int app_make_folders(const args *a, const char *path);
int app_make_folder(const args *a, const char *path);

/* Lines of a path as sf_path_open reads them (path.h), of at most so many bytes: what their fields are; and a
 * pose, camera to world, its quaternion as w x y z. Both return how many bytes. */
enum { APP_POSE_LINE = 512 };
size_t app_pose_header(char line[APP_POSE_LINE]);
size_t app_pose_line(char line[APP_POSE_LINE], double time, const double center[3], const double quat[4]);

/* A string for JSON, which holds UTF-8 alone: where `text` is not, its bytes above 127 become ?. */
json_t *app_json_text(const char *text);
json_t *app_json_numbers(const double *values, int count);
/* A camera as the page takes it: R_cw, t_cw, fx, fy, cx, cy, width, height. */
json_t *app_json_pose(const sf_camera *camera);
/* The value at n / 2 of the n values in ascending order, as which they are left; NAN if n is 0. */
double app_median(double *values, size_t n);

/* Writes JSON, indented, whole or not at all; takes the reference. 0 or an exit code. */
int app_write_json(const args *a, sf_context *ctx, const char *path, json_t *json);

/* After each view: how many of how many are done. Other than 0 ends the evaluation (SF_ERR_CANCELLED). */
typedef int (*app_evaluated)(void *user, size_t done, size_t all);

/* evaluate.c: views rendered and compared with their pictures. */
typedef struct evaluation {
    int most;               /* set by the caller: evaluate at most so many views; 0: all */
    app_evaluated progress; /* set by the caller, may be NULL */
    void *user;             /* of progress */
    size_t of;              /* views of the split */
    size_t views;
    double psnr, ssim, psnr_corrected; /* means of sf_quality's */
    json_t *list;                      /* {name, psnr, ssim, psnr_corrected} of each */
} evaluation;

/* Renders what a view sees into rgb [H][W][3]. */
typedef sf_status (*app_draw)(void *user, const sf_view_info *view, float *rgb);
/* Measures the render of a view against its picture. SF_ERR_EMPTY: it is wholly masked. */
typedef sf_status (*app_measure)(void *user, const sf_view_info *view, sf_quality *quality);

/* Draws a model as the options say: an app_draw, of an app_drawer. */
typedef struct app_drawer {
    sf_renderer *renderer;
    const sf_model *model;
    sf_render_options options;
} app_drawer;
sf_status app_draw_model(void *drawer, const sf_view_info *view, float *rgb);

/* Evaluates the views of a split ("test", "train", "all"), or result->most of them, evenly spread. The caller
 * owns result->list. */
sf_status app_evaluate(sf_scene *scene, const args *a, const char *otherwise, app_measure measure, void *user,
                       evaluation *result);
/* The same of views that `draw` renders. */
sf_status app_evaluate_drawn(sf_context *ctx, sf_scene *scene, const args *a, const char *otherwise,
                             app_draw draw, void *user, evaluation *result);

/* A view's render as PNG, and its quality; with draw NULL its picture, and no quality. */
sf_status app_write_view(sf_context *ctx, sf_scene *scene, const sf_view_info *view, app_draw draw,
                         void *user, const char *path, sf_quality *quality);

/* A view's picture and its render beside it, as PNG. */
sf_status app_write_pair(sf_context *ctx, sf_scene *scene, const sf_view_info *view, app_draw draw,
                         void *user, const char *path);

/* cameras.c: finds the cameras of photos (sf_sfm_find_photos says that there are some) or of a video
 * (sf_film_is) and writes them to a project, whose path the caller frees: the folder itself where the photos
 * are in its folder images, else PATH.project. What is there from before
 * stays. 0 or an exit code. */
int app_find_cameras(const args *a, sf_context *ctx, const char *path, FILE *out, char **project);
/* Whether they were found before; *project as above. */
int app_cameras_were_found(const args *a, const char *path, char **project);

/* model_size.c: what a model takes, into the result of a log: gaussians, parameters (floats that describe
 * it), sh_degrees (Gaussians by the degree of their harmonics), and bytes, where the file at `path` (may be
 * NULL) is a regular one. */
void app_log_model(json_t *result, const sf_model *model, const char *path);
/* The same of a model of which each rank has a part. */
void app_log_parts(sf_context *ctx, json_t *result, const sf_model *part, const char *path);
/* Adds "origin" to an object where coordinates are relative to one, not to 0. */
void app_json_origin(json_t *to, const double origin[3]);

/* progress.c: one line a moment about what goes on. */
typedef struct progress_line {
    enum { PROGRESS_BAR, PROGRESS_PLAIN, PROGRESS_JSON, PROGRESS_NONE } kind;
    FILE *out;
    double last; /* seconds at the last line */
    int open;    /* a bar stands on the line */
} progress_line;

/* kind as --progress says: auto, plain, json, none. 0 or an exit code. */
int progress_start(progress_line *line, const args *a, FILE *out);
/* Shows the state if it is time, or if `now`. */
void progress_show(progress_line *line, const sf_fit_progress *p, int now);
/* The same for text of another kind: whether it is time for a line, at `seconds`; the line. */
int progress_due(progress_line *line, double seconds, int now);
void progress_text(progress_line *line, const char *text);
/* Ends a bar's line, so that something else can be printed. */
void progress_break(progress_line *line);

/* Whether the library's log lines are suppressed, for work that is done only for its figures. */
void app_hold_log(int hold);

/* info_project.c: what splatfit info says of a project; 0 or an exit code. */
int app_info_project(const args *a, sf_context *ctx, const char *path);

/* replay.c: repeats a run from its log. Functions that can fail return 0 or an exit code. */
/* What a log must hold for it: the plan of a run limited by time (null: none), the scene's fingerprint. */
json_t *replay_plan_json(const sf_fitter *fitter);
json_t *replay_scene_json(sf_scene *scene);
/* The log that --replay names; the caller's to release, also after a failure. */
int replay_open(const args *a, json_t **log);
/* The run's options; an option that is given beside them is refused by name. */
int replay_options(const args *a, sf_context *ctx, const json_t *log, sf_fit_options *options);
/* Whether scene, kernels and version are those of the run, and its plan can be followed. */
int replay_check(const args *a, sf_context *ctx, const json_t *log, sf_scene *scene);
/* Makes the fitter follow the plan of the run. */
int replay_follow(const args *a, sf_context *ctx, const json_t *log, sf_fitter *fitter);

#endif
