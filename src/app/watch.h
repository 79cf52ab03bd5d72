/* watch.h - the training log of fit: held-out quality at given times, snapshots, a clock without these. */
#ifndef APP_WATCH_H
#define APP_WATCH_H

#include "../bench/machine.h"
#include "app.h"

enum { WATCH_TIMES = 64 };

/* Where fit writes its model if nothing else is said. */
#define FIT_OUTPUT "splat.ply"

/* Options of the command line that it reads. */
extern const arg_option watch_options[];

/* The clock is wall-clock time since the program's start, with reading of pictures and set-up, without the
 * time of evaluations and snapshots. */
typedef struct watch {
    const args *a;
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
    app_draw draw;
    bench_machine machine;
    double start;   /* of the program */
    double setup;   /* seconds until the first step */
    double looking; /* seconds that went into evaluations and snapshots */
    double seconds; /* of the clock when the last step was done */
    int eval_every; /* steps; 0: not by steps */
    int eval_views; /* of an evaluation, at most; 0: all */
    double eval_at[WATCH_TIMES];
    int eval_times, eval_done, snapshots_done;
    json_t *curve, *snapshots; /* snapshots NULL: none wanted */
    double next_sample;        /* fraction of the run at which the curve gets its next point */
    sf_status status;          /* of the first look that failed */
} watch;

/* Starts the clock. */
void watch_begin(watch *w, const args *a);
/* Its time, s. */
double watch_seconds(const watch *w);
/* Reads its options. 0 or an exit code. */
int watch_read(watch *w);
/* All is ready for the first step (of no fitter: prune): makes the folder of the snapshots. `draw` takes the
 * fitter as its user. 0 or an exit code. */
int watch_start(watch *w, sf_context *ctx, sf_scene *scene, sf_fitter *fitter, app_draw draw);
/* After each step: looks if it is time. */
void watch_step(watch *w, const sf_fit_progress *p);
/* Evaluates the views of a split now, out of the clock's time. progress and user as in evaluation. */
sf_status watch_evaluate(watch *w, const char *split, evaluation *e);
/* After the last step: stops the clock. */
void watch_stop(watch *w, const sf_fit_progress *p);
/* Puts all into the log, beside its "options", "result" and "scene"; `end` is the evaluation of the model
 * (may be NULL) at the end. */
void watch_log(watch *w, json_t *log, const sf_model *model, const evaluation *end);
void watch_free(watch *w);

/* The first view that is held out, else the first. */
sf_status watch_first_held_out(sf_scene *scene, sf_view_info *view);

#endif
