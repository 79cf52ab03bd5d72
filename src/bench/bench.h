/* bench.h - the measurements of splatfit bench, and its report. */
#ifndef BENCH_BENCH_H
#define BENCH_BENCH_H

#include <stdio.h>

#include "machine.h"
#include "levels.h"
#include "step.h"

#include "../base/context.h"

#include <splatfit/model.h>
#include <splatfit/scene.h>

enum {
    BENCH_KERNELS_MOST = 32, /* rows of the table of kernels, a level */
    BENCH_DEGREES_MOST = 5,
    BENCH_STEPS_MOST = 64,
    BENCH_PHOTO_ROWS = 2, /* a level */
    BENCH_NAME = 64
};

typedef struct bench_options {
    const char *isa; /* measure only this level and scalar; NULL: all levels of this machine */
    int quick;       /* small scenes and few rounds: tests that all works, the times mean nothing */
    int brief;       /* full scenes, but few rounds and one size of steps: about a minute */
    FILE *progress;  /* names the running measurement; NULL: silent */
} bench_options;

/* A kernel at a level, one thread. */
typedef struct bench_kernel {
    char name[BENCH_NAME];
    const char *unit; /* what `units` counts */
    double units;
    double seconds;      /* the least of all rounds; 0: not measured at this level */
    double operations;   /* of floats in all, as stated in README.md; 0: not stated */
    double bytes;        /* to and from memory, where that is the roof; else 0 */
    double instructions; /* a unit, as counted under valgrind; 0: not counted */
} bench_kernel;

/* The scene for the kernels, and its numbers of pairs. */
typedef struct bench_load {
    size_t gaussians;
    int width, height; /* px */
    double entries;    /* pairs of a Gaussian and a tile */
    double contributing;
    double evaluated_4x4; /* pairs of a Gaussian and a pixel in the blocks of 4 x 4 px that it reaches */
} bench_load;

/* Blending with one polynomial for exp2 at one level, against float64. */
typedef struct bench_accuracy {
    int level;                         /* index of the levels */
    int degree;                        /* of the polynomial */
    double seconds, seconds_bwd;       /* least of all rounds, one thread, */
    double pairs;                      /* for so many contributing pairs */
    double picture_rms, picture_max;   /* relative to the picture's own rms and greatest value */
    double gradient_rms, gradient_max; /* the worst of the nine components, relative likewise */
} bench_accuracy;

/* Features of a photo, and its matches with another, at one level on one thread. */
typedef struct bench_photos {
    int level;         /* index of the levels */
    const char *start; /* of the scale space: at which size of the picture */
    int width, height; /* px of a photo */
    double features, matches;
    double products;                        /* of descriptors, a pair of photos */
    double features_seconds, match_seconds; /* of a photo, of a pair: the least of all rounds */
} bench_photos;

/* Mean step of a fitted model over a project's training views. */
typedef struct bench_fitted {
    size_t views, gaussians;
    int width, height; /* px, of the first view */
    int count;
    bench_step_times times[2 * BENCH_LEVELS_MOST];
} bench_fitted;

typedef struct bench_report {
    int quick;
    bench_machine machine;
    int levels;
    bench_level level[BENCH_LEVELS_MOST];
    bench_bandwidth bandwidth;
    bench_load load;
    int kernels;
    bench_kernel kernel[BENCH_LEVELS_MOST][BENCH_KERNELS_MOST];
    int stages; /* steps of one thread at the scene's number of Gaussians, every level at two sizes */
    bench_step_times stage[2 * BENCH_LEVELS_MOST];
    bench_step_times far; /* a step of one thread at the best level with more Gaussians than fit in a cache */
    int steps;
    bench_step_times step[BENCH_STEPS_MOST];
    int accuracies, accuracy_pixels, accuracy_left_out;
    bench_accuracy accuracy[BENCH_LEVELS_MOST * BENCH_DEGREES_MOST];
    int befores; /* the same of another build, where its figures were given */
    bench_accuracy before[BENCH_LEVELS_MOST * BENCH_DEGREES_MOST];
    int photo_rows;
    bench_photos photos[BENCH_LEVELS_MOST * BENCH_PHOTO_ROWS];
    bench_fitted fitted;
} bench_report;

/* Each fills in its part of the report; ctx takes the messages of failures. bench_begin is the first: the
 * machine, its levels. bench_end notes how busy it is at the end. */
sf_status bench_begin(sf_context *ctx, const bench_options *options, bench_report *report);
sf_status bench_roofs(sf_context *ctx, const bench_options *options, bench_report *report);
sf_status bench_kernels(sf_context *ctx, const bench_options *options, bench_report *report);
sf_status bench_stages(sf_context *ctx, const bench_options *options, bench_report *report);
sf_status bench_accuracies(sf_context *ctx, const bench_options *options, bench_report *report);
sf_status bench_steps(sf_context *ctx, const bench_options *options, bench_report *report);
sf_status bench_sfm(sf_context *ctx, const bench_options *options, bench_report *report);
sf_status bench_fit(sf_context *ctx, const bench_options *options, const sf_model *model, sf_scene *scene,
                    float near_plane, bench_report *report);
void bench_end(bench_report *report);

/* Runs each kernel once at the level of options->isa, and prints how many units that was: for tools that
 * count instructions. */
sf_status bench_once(sf_context *ctx, const bench_options *options, FILE *out);

/* Whether to go on with round `round` of `rounds` that began at `start` (sf_clock): of a brief report there
 * is one at least, and no more than three or fifteen seconds hold. */
int bench_goes_on(const bench_options *options, int round, int rounds, double start);

/* Says what is measured next. */
void bench_say(const bench_options *options, const char *what);

/* A context of `threads` (0: all) at a level. */
sf_status bench_context(sf_context *ctx, const char *isa, int threads, sf_context **out);

#endif
