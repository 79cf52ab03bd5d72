/* training_log.h - the training log of fit: held-out quality at given times, snapshots, a clock without
 * these. */
#ifndef APP_TRAINING_LOG_H
#define APP_TRAINING_LOG_H

#include "../bench/machine.h"
#include "app.h"

enum { EVALUATION_TIMES = 64 };

/* Where fit writes its model if nothing else is said. */
#define FIT_OUTPUT "splat.ply"

/* Options of the command line that it reads. */
extern const arg_option training_log_options[];

/* The clock is wall-clock time since the program's start, with reading of pictures and set-up, without the
 * time of evaluations and snapshots. */
typedef struct training_log {
    const args *a;
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
    app_draw draw;
    bench_machine machine;
    double start;      /* of the program */
    double setup;      /* seconds until the first step */
    double evaluating; /* seconds that went into evaluations and snapshots */
    double seconds;    /* of the clock when the last step was done */
    int eval_every;    /* steps; 0: not by steps */
    int eval_views;    /* of an evaluation, at most; 0: all */
    double eval_at[EVALUATION_TIMES];
    int eval_times, eval_done, snapshots_done;
    json_t *curve, *snapshots; /* snapshots NULL: none wanted */
    double next_sample;        /* fraction of the run at which the curve gets its next point */
    sf_status status;          /* of the first evaluation that failed */
} training_log;

/* Starts the clock. */
void training_log_begin(training_log *w, const args *a);
/* Its time, s. */
double training_log_seconds(const training_log *w);
/* Reads its options. 0 or an exit code. */
int training_log_read(training_log *w);
/* All is ready for the first step (of no fitter: prune): makes the folder of the snapshots. `draw` takes the
 * fitter as its user. 0 or an exit code. */
int training_log_start(training_log *w, sf_context *ctx, sf_scene *scene, sf_fitter *fitter, app_draw draw);
/* After each step: evaluates if it is time. */
void training_log_step(training_log *w, const sf_fit_progress *p);
/* Evaluates the views of a split now, out of the clock's time. progress and user as in evaluation. */
sf_status training_log_evaluate(training_log *w, const char *split, evaluation *e);
/* After the last step: stops the clock. */
void training_log_stop(training_log *w, const sf_fit_progress *p);
/* Puts all into the log, beside its "options", "result" and "scene"; `end` is the evaluation of the model
 * (may be NULL) at the end. */
void training_log_write(training_log *w, json_t *log, const sf_model *model, const evaluation *end);
void training_log_free(training_log *w);

/* The first view that is held out, else the first. */
sf_status training_log_first_held_out(sf_scene *scene, sf_view_info *view);

#endif
