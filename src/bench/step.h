/* step.h - a whole step of a fit, stage by stage. */
#ifndef BENCH_STEP_H
#define BENCH_STEP_H

#include "../fit/optimizer_state.h"
#include "scene.h"

enum {
    STAGE_PROJECT,
    STAGE_BIN,
    STAGE_BLEND,
    STAGE_TARGET,
    STAGE_LOSS,
    STAGE_BLEND_BWD,
    STAGE_UPDATE, /* project_bwd and the optimiser */
    STAGE_TOTAL,
    STAGES
};

extern const char *const bench_stage_names[STAGES];

/* The least time of each stage over some rounds, and how much work it was. */
typedef struct bench_step_times {
    int level, threads; /* index of the levels */
    size_t gaussians;
    int width, height; /* px */
    int rounds;
    double seconds[STAGES];
    double median_total; /* of the views of a fitted model; 0 elsewhere */
    double entries;      /* pairs of a Gaussian and a tile */
    double contributing; /* pairs of a Gaussian and a pixel; 0: not counted */
    double evaluated;    /* at the level's own size of blocks; 0: not counted */
    int sh_degree;
} bench_step_times;

/* What a step compares with. */
typedef struct bench_view {
    sf_camera camera;
    float near_plane;
    const uint8_t *rgb;    /* [3][height][width] */
    const uint8_t *weight; /* [height][width]; NULL: 1 */
} bench_view;

/* One step with a learning rate of 0, so that every step does the same work. seconds: of each stage. */
sf_status bench_step(sf_workspace *ws, const sf_model *model, const sf_optimizer_state *moments,
                     const bench_view *view, double seconds[STAGES]);

/* Least seconds that the stage's arithmetic or its way to memory takes with `roof` figures: operations a
 * second and bytes a second. 0 where the work was not counted. */
double bench_stage_floor(const bench_step_times *step, int stage, double flops, double bytes);

/* Parameters of a Gaussian with SH up to a degree. */
int bench_parameters(int sh_degree);

/* Operations of floats as counted in the kernels' source (README.md). */
#define BENCH_BLEND_OPERATIONS       31.0  /* a pair evaluated */
#define BENCH_BLEND_BWD_OPERATIONS   56.0  /* a pair evaluated */
#define BENCH_BLEND_WORTH_OPERATIONS 68.0  /* a pair evaluated */
#define BENCH_LOSS_OPERATIONS        283.0 /* a pixel of a channel */

#endif
