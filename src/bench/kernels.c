/* kernels.c - each kernel at each level, one thread, on the scene. */
#include <string.h>

#include "../base/clock.h"
#include "../base/pool.h"
#include "../base/rng.h"
#include "../scene/gaussians.h"
#include "bench.h"
#include "clocks.h"

#include <splatfit/source.h>

/* What the kernels work on. One context of one thread serves all levels: its table is exchanged. */
typedef struct bench_lab {
    sf_context *ctx;
    bench_scene scene;
    sf_workspace ws;
    const bench_level *level; /* whose turn it is */
    bench_pairs pairs;        /* at 4 x 4 px */
    /* results that the lists must not see: a level may round to another tile */
    sf_splat *splats;
    uint8_t *state;
    uint16_t *first_row, *rows;
    uint32_t *tiles;
    /* Adam's four arrays of `near` parameters, which fit a core's own cache, and of `far`, which fit none */
    float *adam[4];
    uint32_t *adam_words; /* adam_half's, beside the first two */
    size_t near_count, far_count;
    uint8_t *frame;   /* three planes, each as large as any format has one */
    float *frame_rgb; /* [3][FRAME_HEIGHT][FRAME_WIDTH] */
} bench_lab;

enum {
    ADAM_NEAR = 1 << 13, /* parameters: 128 KB in all */
    ADAM_REPEATS = 64,   /* times that they are gone over */
    UNPACK_REPEATS = 4,
    FRAME_WIDTH = 640,
    FRAME_HEIGHT = 480,
    FRAME_PIXELS = FRAME_WIDTH * FRAME_HEIGHT,
    FRAME_PLANE = 3 * FRAME_PIXELS /* bytes */
};

/* The formats of frames, each a row of the table. */
#define FORMATS(X) X(YUYV) X(UYVY) X(NV12) X(YU12) X(422P) X(444P) X(RGB24) X(BGR24) X(GREY)

/* Bytes from one row of a plane to the next. */
static size_t frame_stride(sf_pixel_format format) {
    if (format == SF_PIXEL_RGB24 || format == SF_PIXEL_BGR24) return 3 * FRAME_WIDTH;
    return format == SF_PIXEL_YUYV || format == SF_PIXEL_UYVY ? 2 * FRAME_WIDTH : FRAME_WIDTH;
}

/* Grey and pale: as in nearly all of a picture, nothing is clamped, which would be hard to foresee. */
static void fill_frame(uint8_t *frame) {
    sf_rng rng;
    sf_rng_seed(&rng, BENCH_SEED);
    for (size_t i = 0; i < 3 * FRAME_PLANE; i++) frame[i] = (uint8_t)(96 + sf_rng_below(&rng, 64));
}

/* A frame, into planes of `height` rows, one over the other where they are fewer. */
static void convert_frame(const bench_lab *lab, sf_pixel_format format, size_t height) {
    static const sf_yuv yuv = {16, 1 / 219.0f, 1.402f / 224, 0.344f / 224, 0.714f / 224, 1.772f / 224};
    size_t stride = frame_stride(format), shared = format == SF_PIXEL_NV12 || format == SF_PIXEL_YU12 ? 2 : 1;
    for (size_t row = 0; row < FRAME_HEIGHT; row++) {
        sf_convert_args args = {.format = (int)format, .width = FRAME_WIDTH, .yuv = &yuv};
        for (size_t p = 0; p < 3; p++) {
            args.plane[p] = lab->frame + p * FRAME_PLANE + (p ? row / shared : row) * stride;
            args.rgb[p] = lab->frame_rgb + p * FRAME_PIXELS + row % height * FRAME_WIDTH;
        }
        lab->level->kernels.convert(&args);
    }
}

#define RUN_CONVERT(format)                                                                                  \
    static void run_convert_##format(void *lab, size_t task, int thread) {                                   \
        (void)task, (void)thread;                                                                            \
        convert_frame(lab, SF_PIXEL_##format, 1);                                                            \
    }
FORMATS(RUN_CONVERT)

static void run_convert_far(void *lab, size_t task, int thread) {
    (void)task, (void)thread;
    convert_frame(lab, SF_PIXEL_YUYV, FRAME_HEIGHT);
}

static void run_project(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    const sf_model *model = lab->scene.model;
    sf_project_args args = {.eye = &lab->ws.eye,
                            .params = model->params,
                            .sh_degree = model->sh_degree,
                            .splats = lab->splats,
                            .state = lab->state,
                            .first_row = lab->first_row,
                            .rows = lab->rows};
    lab->level->kernels.project(&args, 0, sf_blocks(model->count));
}

static void run_spans(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    const sf_workspace *ws = &lab->ws;
    lab->level->kernels.spans(ws->splats, ws->first_row, ws->rows, ws->span_offset, 0, ws->count,
                              ws->eye.tiles_x, ws->spans, lab->tiles, ws->depth_of);
}

static void run_unpack(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    sf_workspace *ws = &lab->ws;
    size_t width = (size_t)ws->eye.width, height = (size_t)ws->eye.height;
    for (size_t row = 0; row < UNPACK_REPEATS * SF_CHANNELS * height; row++) {
        size_t at = row % (SF_CHANNELS * height);
        lab->level->kernels.unpack(lab->scene.picture + at * width, NULL, width, 1,
                                   ws->target[at / height] + at % height * ws->stride, (int)width);
    }
}

static void adam_over(bench_lab *lab, size_t n) {
    static const sf_adam step = {.beta1 = 0.9f, .beta2 = 0.999f, .v_scale = 1, .epsilon = 1e-15f};
    float *const *a = lab->adam;
    lab->level->kernels.adam(a[0], a[1], a[2], a[3], n, &step);
}

static void adam_half_over(bench_lab *lab, size_t n) {
    static const sf_adam step = {.beta1 = 0.9f, .beta2 = 0.999f, .v_scale = 1, .epsilon = 1e-15f};
    lab->level->kernels.adam_half(lab->adam[0], lab->adam[1], lab->adam_words, n, &step, BENCH_SEED);
}

static void rmsprop_over(bench_lab *lab, size_t n) {
    static const sf_adam step = {.beta2 = 0.999f, .v_scale = 1, .epsilon = 1e-15f};
    n = n / 3 / SF_LANES * SF_LANES;
    lab->level->kernels.rmsprop(lab->adam[0], lab->adam[1], lab->adam[3], n, &step);
}

static void run_adam(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    for (int i = 0; i < ADAM_REPEATS; i++) adam_over(lab, lab->near_count);
}

static void run_adam_far(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    adam_over(lab, lab->far_count);
}

static void run_adam_half(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    for (int i = 0; i < ADAM_REPEATS; i++) adam_half_over(lab, lab->near_count);
}

static void run_adam_half_far(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    adam_half_over(lab, lab->far_count);
}

static void run_rmsprop(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    for (int i = 0; i < ADAM_REPEATS; i++) rmsprop_over(lab, lab->near_count);
}

static void run_rmsprop_far(void *lab_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    bench_lab *lab = lab_pointer;
    rmsprop_over(lab, lab->far_count);
}

/* The others through their stages, which hand each tile, band and block to the kernel. */
static const float black[3];

static sf_status run_blend(bench_lab *lab) {
    sf_stage_blend(&lab->ws, black, 0);
    return SF_OK;
}

static sf_status run_cull(bench_lab *lab) {
    lab->ctx->kernels->blend = lab->level->variant[BENCH_CULL].blend;
    sf_stage_blend(&lab->ws, black, 0);
    lab->ctx->kernels->blend = lab->level->kernels.blend;
    return SF_OK;
}

static sf_status run_loss(bench_lab *lab) {
    sf_loss_value value;
    sf_stage_loss(&lab->ws, 0.2, 0, (double)lab->ws.eye.width * lab->ws.eye.height, 0, 1, &value);
    return SF_OK;
}

static sf_status run_blend_importance(bench_lab *lab) {
    return sf_stage_blend_importance(&lab->ws, NULL, NULL);
}
static sf_status run_blend_bwd(bench_lab *lab) { return sf_stage_blend_bwd(&lab->ws); }

static void take_nothing(void *user, const sf_params *grads, size_t first, size_t end) {
    (void)user, (void)grads, (void)first, (void)end;
}

static sf_status run_project_bwd(bench_lab *lab) {
    return sf_stage_project_bwd(&lab->ws, NULL, take_nothing, NULL);
}

enum { UNIT_GAUSSIAN, UNIT_PAIR, UNIT_PIXEL, UNIT_NEAR, UNIT_FAR, UNIT_WHOLE_PIXEL };
static const char *const unit_names[] = {"Gaussian",  "contributing pair", "pixel of a channel",
                                         "parameter", "parameter",         "pixel"};

#define CONVERT_ITEM(format)                                                                                 \
    {"convert, " #format, SF_KERNEL_convert, UNIT_WHOLE_PIXEL, run_convert_##format, NULL, 0, 1},

/* What is measured, in the order of a step: blend_bwd takes what blend of the same level left. So does
 * blend_importance, ahead of it: both write the sums, and project_bwd takes those of blend_bwd. */
static const struct {
    const char *name;
    int kernel; /* of the table */
    int unit;
    sf_task_fn direct; /* one of the two */
    sf_status (*stage)(bench_lab *lab);
    double operations; /* a pair evaluated, or a pixel of a channel */
    int every;         /* measured in every n-th round */
} items[] = {
    {"project", SF_KERNEL_project, UNIT_GAUSSIAN, run_project, NULL, 0, 1},
    {"spans", SF_KERNEL_spans, UNIT_GAUSSIAN, run_spans, NULL, 0, 1},
    {"blend, culling alone", SF_KERNEL_blend, UNIT_PAIR, NULL, run_cull, 0, 1},
    {"blend", SF_KERNEL_blend, UNIT_PAIR, NULL, run_blend, BENCH_BLEND_OPERATIONS, 1},
    {"unpack", SF_KERNEL_unpack, UNIT_PIXEL, run_unpack, NULL, 0, 1},
    {"loss", SF_KERNEL_loss, UNIT_PIXEL, NULL, run_loss, BENCH_LOSS_OPERATIONS, 1},
    {"blend_importance", SF_KERNEL_blend_importance, UNIT_PAIR, NULL, run_blend_importance,
     BENCH_BLEND_WORTH_OPERATIONS, 1},
    {"blend_bwd", SF_KERNEL_blend_bwd, UNIT_PAIR, NULL, run_blend_bwd, BENCH_BLEND_BWD_OPERATIONS, 1},
    {"project_bwd", SF_KERNEL_project_bwd, UNIT_GAUSSIAN, NULL, run_project_bwd, 0, 1},
    {"adam, in cache", SF_KERNEL_adam, UNIT_NEAR, run_adam, NULL, 0, 1},
    {"adam, in memory", SF_KERNEL_adam, UNIT_FAR, run_adam_far, NULL, 0, 5},
    {"adam_half, in cache", SF_KERNEL_adam_half, UNIT_NEAR, run_adam_half, NULL, 0, 1},
    {"adam_half, in memory", SF_KERNEL_adam_half, UNIT_FAR, run_adam_half_far, NULL, 0, 5},
    {"rmsprop, in cache", SF_KERNEL_rmsprop, UNIT_NEAR, run_rmsprop, NULL, 0, 1},
    {"rmsprop, in memory", SF_KERNEL_rmsprop, UNIT_FAR, run_rmsprop_far, NULL, 0, 5},
    {"convert, a whole frame", SF_KERNEL_convert, UNIT_WHOLE_PIXEL, run_convert_far, NULL, 0, 1},
    FORMATS(CONVERT_ITEM)};
enum { ITEMS = sizeof items / sizeof *items, PAIRS_ALONE = ITEMS };

static sf_status run_item(bench_lab *lab, int i) {
    if (items[i].stage) return items[i].stage(lab);
    sf_pool_run(lab->ctx->pool, 1, items[i].direct, lab); /* which flushes denormals */
    return SF_OK;
}

static sf_status lab_room(bench_lab *lab, double far_bytes) {
    size_t n = sf_blocks(lab->scene.model->count) * SF_LANES;
    lab->near_count = ADAM_NEAR;
    lab->far_count = (size_t)(far_bytes / 16) / SF_LANES * SF_LANES;
    size_t parameters = lab->far_count > ADAM_NEAR ? lab->far_count : ADAM_NEAR;
    lab->splats = sf_alloc(lab->ctx, n, sizeof *lab->splats);
    lab->state = sf_alloc(lab->ctx, n, sizeof *lab->state);
    lab->first_row = sf_alloc(lab->ctx, n, sizeof *lab->first_row);
    lab->rows = sf_alloc(lab->ctx, n, sizeof *lab->rows);
    lab->tiles = sf_alloc(lab->ctx, n, sizeof *lab->tiles);
    int failed = !lab->splats || !lab->state || !lab->first_row || !lab->rows || !lab->tiles;
    for (int i = 0; i < 4; i++) {
        lab->adam[i] = sf_alloc(lab->ctx, parameters, sizeof(float));
        for (size_t k = 0; lab->adam[i] && k < parameters; k++) lab->adam[i][k] = 1e-3f;
        failed |= !lab->adam[i];
    }
    lab->adam_words = sf_calloc(lab->ctx, parameters, sizeof *lab->adam_words);
    failed |= !lab->adam_words;
    lab->frame = sf_alloc(lab->ctx, 3, FRAME_PLANE);
    lab->frame_rgb = sf_alloc(lab->ctx, 3 * FRAME_PIXELS, sizeof *lab->frame_rgb);
    failed |= !lab->frame || !lab->frame_rgb;
    if (lab->frame) fill_frame(lab->frame);
    return failed ? SF_ERR_MEMORY : SF_OK;
}

/* 1 in the picture, which blend_importance reads; the loss is without weights. */
static void fill_weight(sf_workspace *ws) {
    for (size_t y = 0; y < ws->plane_rows; y++)
        for (size_t x = 0; x < ws->stride; x++)
            ws->weight[y * ws->stride + x] =
                y < (size_t)ws->eye.height && x < (size_t)ws->eye.width ? 1.0f : 0.0f;
}

static void set_level(bench_lab *lab, const bench_level *level) {
    lab->level = level;
    *lab->ctx->kernels = level->kernels;
}

static sf_status open_lab(sf_context *ctx, const bench_level *level, int quick, double far_bytes,
                          bench_lab *lab) {
    *lab = (bench_lab){0};
    sf_status status = bench_context(ctx, level->name, 1, &lab->ctx);
    if (status) return status;
    sf_workspace_init(&lab->ws, lab->ctx);
    set_level(lab, level);
    status = quick ? bench_scene_create(lab->ctx, 2000, 120, 68, BENCH_SEED, &lab->scene)
                   : bench_scene_create(lab->ctx, BENCH_GAUSSIANS, BENCH_WIDTH, BENCH_HEIGHT, BENCH_SEED,
                                        &lab->scene);
    if (!status) status = lab_room(lab, far_bytes);
    if (!status) status = bench_scene_project(&lab->scene, &lab->ws);
    if (!status) fill_weight(&lab->ws);
    if (!status) lab->pairs = bench_count_pairs(&lab->ws, 4, 4);
    return status ? sf_fail(ctx, status, "%s", sf_last_error(lab->ctx)) : SF_OK;
}

static void close_lab(bench_lab *lab) {
    if (!lab->ctx) return;
    void *blocks[] = {lab->splats,  lab->state,      lab->first_row, lab->rows,
                      lab->tiles,   lab->adam[0],    lab->adam[1],   lab->adam[2],
                      lab->adam[3], lab->adam_words, lab->frame,     lab->frame_rgb};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(lab->ctx, blocks[i]);
    sf_workspace_free(&lab->ws);
    bench_scene_destroy(&lab->scene);
    sf_context_destroy(&lab->ctx);
}

static double units_of(const bench_lab *lab, int item) {
    double pixels = (double)lab->ws.eye.width * lab->ws.eye.height;
    switch (items[item].unit) {
    case UNIT_GAUSSIAN:
        return (double)lab->scene.model->count;
    case UNIT_PAIR:
        return lab->pairs.contributing;
    case UNIT_PIXEL:
        return (items[item].direct == run_unpack ? UNPACK_REPEATS : 1) * SF_CHANNELS * pixels;
    case UNIT_WHOLE_PIXEL:
        return FRAME_PIXELS;
    case UNIT_NEAR:
        return (double)ADAM_REPEATS * (double)lab->near_count;
    default:
        return (double)lab->far_count;
    }
}

/* Bytes that the kernels of few operations read and write, each once. */
static double bytes_of(const bench_lab *lab, int item, double units) {
    double parameters = 4 * bench_parameters(lab->scene.model->sh_degree), record = sizeof(sf_splat);
    double slots = lab->ws.slot[lab->ws.count] / (double)lab->ws.count;
    if (items[item].direct == run_adam_far) return units * 28;      /* p, m, v in and out, g in */
    if (items[item].direct == run_adam_half_far) return units * 20; /* p and the words in and out, g in */
    if (items[item].direct == run_rmsprop_far)
        return units * (12 + 8.0 / 3); /* p in and out, g in, a third v */
    switch (items[item].kernel) {
    case SF_KERNEL_project: /* parameters in, records out */
        return units * (parameters + record);
    case SF_KERNEL_spans: /* records in */
        return units * record;
    case SF_KERNEL_project_bwd: /* parameters, records and sums in; gradients stay in the cache */
        return units * (parameters + record + slots * SF_SUMS * sizeof(float));
    default:
        return 0;
    }
}

/* The rows of a level's table, without their times. */
static void describe(const bench_lab *lab, const bench_level *level, bench_kernel *rows) {
    bench_pairs pairs = bench_count_pairs(&lab->ws, level->roof.block_columns, level->roof.block_rows);
    for (int i = 0; i < ITEMS; i++) {
        bench_kernel *k = &rows[i];
        snprintf(k->name, sizeof k->name, "%s", items[i].name);
        k->unit = unit_names[items[i].unit];
        k->units = units_of(lab, i);
        k->operations = items[i].operations * (items[i].unit == UNIT_PAIR ? pairs.evaluated : k->units);
        k->bytes = bytes_of(lab, i, k->units);
    }
    snprintf(rows[PAIRS_ALONE].name, sizeof rows[PAIRS_ALONE].name, "blend, pairs alone");
    rows[PAIRS_ALONE].unit = unit_names[UNIT_PAIR];
    rows[PAIRS_ALONE].units = lab->pairs.contributing;
    rows[PAIRS_ALONE].operations = BENCH_BLEND_OPERATIONS * pairs.evaluated;
}

/* Whether a level has a separate version of a kernel; otherwise its table holds that of a lower level. */
static int has_own(const bench_level *level, int item) {
    if (items[item].stage == run_cull && !level->variant[BENCH_CULL].blend) return 0;
    return !strcmp(level->kernels.level[items[item].kernel], level->name);
}

static int index_of(const char *name) {
    for (int i = 0; i < ITEMS; i++)
        if (!strcmp(items[i].name, name)) return i;
    return 0;
}

/* All items of a level once; each row keeps its least time. */
static sf_status run_level(bench_lab *lab, const bench_level *level, int round, bench_kernel *rows) {
    set_level(lab, level);
    for (int i = 0; i < ITEMS; i++) {
        if (round % items[i].every || !has_own(level, i)) continue;
        double start = bench_thread_clock();
        sf_status status = run_item(lab, i);
        if (status) return status;
        bench_keep_least(&rows[i].seconds, bench_thread_clock() - start);
    }
    return SF_OK;
}

static void note_load(const bench_lab *lab, bench_load *load) {
    const sf_eye *eye = &lab->ws.eye;
    *load = (bench_load){.gaussians = lab->scene.model->count,
                         .width = eye->width,
                         .height = eye->height,
                         .entries = lab->ws.tile_begin[eye->tiles_x * eye->tiles_y],
                         .contributing = lab->pairs.contributing,
                         .evaluated_4x4 = lab->pairs.evaluated};
}

sf_status bench_kernels(sf_context *ctx, const bench_options *options, bench_report *report) {
    bench_lab lab;
    int rounds = options->quick ? 3 : 20;
    bench_say(options, "kernels");
    double far_bytes = bench_machine_far(&report->machine, options->quick);
    sf_status status = open_lab(ctx, &report->level[0], options->quick, far_bytes, &lab);
    for (int i = 0; i < report->levels && !status; i++) describe(&lab, &report->level[i], report->kernel[i]);
    if (!status) note_load(&lab, &report->load);
    double start = sf_clock();
    for (int round = 0; bench_goes_on(options, round, rounds, start) && !status; round++) {
        for (int i = 0; i < report->levels && !status; i++)
            status = run_level(&lab, &report->level[i], round, report->kernel[i]);
        bench_machine_clock(&report->machine);
    }
    report->kernels = ITEMS + 1;
    int whole = index_of("blend"), culling = index_of("blend, culling alone");
    for (int i = 0; i < report->levels; i++) {
        bench_kernel *rows = report->kernel[i];
        if (rows[culling].seconds > 0 && rows[whole].seconds > rows[culling].seconds)
            rows[PAIRS_ALONE].seconds = rows[whole].seconds - rows[culling].seconds;
    }
    close_lab(&lab);
    return status;
}

sf_status bench_once(sf_context *ctx, const bench_options *options, FILE *out) {
    bench_level levels[BENCH_LEVELS_MOST];
    bench_lab lab;
    const bench_level *level = &levels[bench_levels_find(options->isa, levels) - 1];
    sf_status status = open_lab(ctx, level, options->quick, 0, &lab);
    for (int i = 0; i < ITEMS && !status; i++) {
        if (!has_own(level, i) || items[i].stage == run_cull || items[i].unit == UNIT_FAR) continue;
        if (items[i].kernel == SF_KERNEL_convert && items[i].direct != run_convert_YUYV) continue;
        /* the two kernels with which the lists are made have run already */
        int ran = items[i].direct == run_project || items[i].direct == run_spans;
        if (!ran) status = run_item(&lab, i);
        int n = (int)strcspn(items[i].name, ",");
        fprintf(out, "sf_%.*s_%s %.0f\n", n, items[i].name, level->name, units_of(&lab, i));
    }
    close_lab(&lab);
    return status;
}
