/* chart.h - charts of quality against time, from the logs that fits wrote. */
#ifndef CHART_CHART_H
#define CHART_CHART_H

#include "svg.h"

enum { CHART_TEXT = 192 };

/* Quality of a model on held-out views, as it was at a moment of its fit. */
typedef enum chart_metric { CHART_PSNR, CHART_SSIM, CHART_METRICS } chart_metric;

typedef struct chart_point {
    double seconds; /* since the program's start, evaluations left out */
    double gaussians;
    double quality[CHART_METRICS];
} chart_point;

/* The view that snapshots show: its own picture (second 0), or a render. */
typedef struct chart_snapshot {
    int second;           /* for which it was made */
    double seconds, psnr; /* when it was made; psnr of this view alone */
    uint8_t *png;
    size_t size;
} chart_snapshot;

/* Runs of a scene that together show what size is worth. */
typedef enum chart_series {
    CHART_NO_SERIES,
    CHART_CAPS,   /* fits with other caps */
    CHART_AUTO,   /* fits that chose their number themselves */
    CHART_PRUNED, /* a large fit, pruned by worth */
    CHART_RANDOM, /* and at random */
    CHART_SERIES
} chart_series;

enum { CHART_DEGREES = 4 };

/* One fit, or one pruning. Fields that have no comment are the log's. */
typedef struct chart_run {
    char label[CHART_TEXT]; /* "label", else "preset / isa", else "isa" */
    char scene[CHART_TEXT], cpu[CHART_TEXT], isa[CHART_TEXT];
    int width, height; /* px, of the held-out views */
    int threads;
    double seed, load_start, load_end;
    double steps, seconds, setup_seconds, evaluation_seconds, gaussians, needles; /* at the end */
    chart_series
        series;   /* the log's "series"; without it, auto by options.size, caps by other caps of its label */
    int timed;    /* drawn against time: what is no pruning and none of several caps */
    double cap;   /* options.max_gaussians; 0: not known */
    double bytes; /* of the model's file; 0: not known */
    double train[CHART_METRICS];   /* quality on the training views at the end; NAN: not known */
    double degrees[CHART_DEGREES]; /* Gaussians by SH degree; all 0: not known */
    chart_point *points;           /* seconds ascend; 1 at least */
    size_t count;
    chart_snapshot *snapshots;
    size_t snapshot_count;
} chart_run;

/* A run to some quality with one more move of the schedule than the run before it in the list. */
typedef struct chart_move {
    char name[CHART_TEXT];
    double seconds, steps, psnr;
} chart_move;

typedef struct chart_ablation {
    char name[CHART_TEXT]; /* of its file, without folder and ending */
    chart_move *moves;
    size_t count;
} chart_ablation;

/* Chosen numbers of Gaussians for scenes that consist of a known number of Gaussians. */
typedef struct chart_choice {
    char series[CHART_TEXT];
    double complexity, gaussians; /* Gaussians of the scene, and of the model */
} chart_choice;

typedef struct chart_choices {
    char name[CHART_TEXT]; /* of its file, without folder and ending */
    chart_choice *list;
    size_t count;
} chart_choices;

/* A live fit of a simulated camera: how far its keyframes are off the truth at the end. */
typedef struct chart_walk {
    char name[CHART_TEXT]; /* of its file, without folder and ending */
    svg_point *points;     /* x: s of the source's clock, ascending; y: world units */
    double degrees;        /* median */
    size_t count;          /* 1 at least */
} chart_walk;

typedef struct chart_input {
    sf_context *ctx;
    chart_run *runs;
    size_t run_count, run_room;
    chart_ablation *ablations;
    size_t ablation_count, ablation_room;
    chart_choices *choices;
    size_t choices_count, choices_room;
    chart_walk *walks;
    size_t walk_count, walk_room;
} chart_input;

/* read.c: adds a file: the log of a fit, of a live fit with truth or of a pruning, an ablation (a list of
 * objects with "move"), or choices of size (with "complexity"). SF_ERR_IO, SF_ERR_FORMAT: with file and
 * field; the input is as it was. */
sf_status chart_read(chart_input *input, const char *path);
void chart_free(chart_input *input);

/* curve.c: the mean over the runs of one label and scene. */
typedef struct chart_sample {
    double seconds, gaussians; /* mean of the runs */
    double mean, least, most;  /* of the quality */
} chart_sample;

typedef struct chart_curve {
    const char *label;
    size_t style; /* index of the label among all labels */
    size_t runs;
    chart_sample *samples;
    size_t count;
} chart_curve;

/* The timed runs of one scene: those of the input with the scene and the size of `first`. */
typedef struct chart_scene {
    const chart_input *input;
    const chart_run *first;
    chart_curve *curves[CHART_METRICS]; /* one a label, in the order of the input */
    size_t count;
} chart_scene;

int chart_same_scene(const chart_run *a, const chart_run *b);
/* Whether no run before it is of its scene. */
int chart_opens_scene(const chart_input *input, size_t run);
sf_status chart_scene_make(const chart_input *input, const chart_run *first, chart_scene *scene);
void chart_scene_free(chart_scene *scene);

/* The best quality of any curve, and when a curve first has as much as `target` (negative: never). */
double chart_best(const chart_scene *scene, chart_metric metric);
double chart_time_to(const chart_curve *curve, double target);

/* size.c: quality against size over the runs of a scene. */
typedef enum chart_size { CHART_GAUSSIANS, CHART_BYTES, CHART_SIZES } chart_size;

typedef struct chart_size_point {
    double size[CHART_SIZES];      /* mean of the runs; 0: not known */
    double quality[CHART_METRICS]; /* held out, mean of the runs at their ends */
    double least[CHART_METRICS], most[CHART_METRICS];
    double train[CHART_METRICS]; /* NAN: not known */
    size_t runs;                 /* whose numbers of Gaussians are near each other */
} chart_size_point;

typedef struct chart_sizes {
    const chart_input *input;
    const chart_run *first;
    chart_size_point *points[CHART_SERIES]; /* Gaussians ascend */
    size_t count[CHART_SERIES];
} chart_sizes;

sf_status chart_sizes_make(const chart_input *input, const chart_run *first, chart_sizes *sizes);
void chart_sizes_free(chart_sizes *sizes);
/* Whether there is something to draw against a size, or the gap to the training views. */
int chart_sizes_known(const chart_sizes *sizes, chart_size size);
int chart_gap_known(const chart_sizes *sizes);

/* PSNR at the knee is below the best by this, dB. */
#define CHART_KNEE 0.1
/* The least size with which the caps come within CHART_KNEE of the best PSNR of them (*plateau), between runs
 * over the logarithm of size. 0: less than two caps are there. */
double chart_knee(const chart_sizes *sizes, chart_size size, double *plateau);

/* peers.c: other programs on the same pictures, measured once. */
typedef struct chart_peer {
    const char *scene;
    int width, height;
    const char *name;   /* program, version, settings */
    const char *source; /* where and by whom */
    struct {
        double seconds, psnr;
    } points[8]; /* ended by 0 s */
} chart_peer;

/* Peer `index` of those measured on a scene; NULL past the last. */
const chart_peer *chart_peer_of(const chart_run *scene, size_t index);

/* draw.c: one picture each, as an element svg. */
sf_status chart_draw_quality(const chart_scene *scene, chart_metric metric, sf_writer *out);
void chart_draw_times(const chart_scene *scene, sf_writer *out);
void chart_draw_moves(const chart_ablation *ablation, sf_writer *out);

/* draw_size.c: the same. */
sf_status chart_draw_size(const chart_sizes *sizes, chart_size size, chart_metric metric, sf_writer *out);
sf_status chart_draw_gap(const chart_sizes *sizes, sf_writer *out);
void chart_draw_choices(const chart_choices *choices, sf_writer *out);
/* Gaussians by SH degree, a row for each run of a series whose Gaussians differ in it; how many such there
 * are. */
size_t chart_degree_rows(const chart_input *input, const chart_run *first);
void chart_draw_degrees(const chart_input *input, const chart_run *first, sf_writer *out);

/* draw_walk.c: the same, of all walks. */
sf_status chart_draw_walks(const chart_input *input, sf_writer *out);

/* page.c: index.html and each of its charts as a separate .svg, in a folder that exists. */
sf_status chart_write_page(const chart_input *input, const char *folder);
/* A page of charts up to its heading, which is its title; and its end. */
void chart_page_begin(sf_writer *out, const char *title);
void chart_page_end(sf_writer *out);

#endif
