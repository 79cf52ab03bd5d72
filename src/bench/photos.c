/* photos.c - features of photos and their matches, by stages, at each level, one thread. */
#include <math.h>
#include <string.h>

#include "../base/rng.h"
#include "../sfm/match.h"
#include "bench.h"
#include "clocks.h"

enum { WIDTH = 960, HEIGHT = 540, BLOBS = 6000, PHOTOS = 2, ROUNDS = 5 };

/* The second photo is the first, so far to the left. */
enum { SHIFT = 40 };

typedef struct photo_lab {
    sf_context *ctx; /* of one thread; its table is exchanged */
    uint8_t *pixels; /* [HEIGHT][WIDTH + SHIFT] */
    sf_photo photos[PHOTOS];
    sf_features_options options;
} photo_lab;

/* ---- the picture ----------------------------------------------------------------------------------------
 */

/* A blob of light or shade, cut off at three deviations. */
static void add_blob(float *light, int width, int height, sf_rng *rng) {
    double x = (double)sf_rng_below(rng, (uint64_t)width), y = (double)sf_rng_below(rng, (uint64_t)height);
    double deviation = 0.8 * exp2((double)sf_rng_below(rng, 1000) / 250); /* to 12.8 */
    double peak = (double)sf_rng_below(rng, 120) - 60;
    int reach = (int)(3 * deviation) + 1;
    for (int j = (int)fmax(0, y - reach); j < fmin(height, y + reach + 1); j++)
        for (int i = (int)fmax(0, x - reach); i < fmin(width, x + reach + 1); i++)
            light[(size_t)j * (size_t)width + (size_t)i] +=
                (float)(peak * exp(-((i - x) * (i - x) + (j - y) * (j - y)) / (2 * deviation * deviation)));
}

static sf_status draw(photo_lab *lab, int quick) {
    int scale = quick ? 8 : 1, width = WIDTH / scale + SHIFT, height = HEIGHT / scale;
    size_t pixels = (size_t)width * (size_t)height;
    float *light = sf_alloc(lab->ctx, pixels, sizeof *light);
    lab->pixels = sf_alloc(lab->ctx, pixels, 1);
    if (light && lab->pixels) {
        sf_rng rng;
        sf_rng_seed(&rng, BENCH_SEED);
        for (size_t i = 0; i < pixels; i++) light[i] = 128;
        for (int i = 0; i < BLOBS / scale / scale; i++) add_blob(light, width, height, &rng);
        for (size_t i = 0; i < pixels; i++) lab->pixels[i] = (uint8_t)fmin(fmax((double)light[i], 0), 255);
        for (int i = 0; i < PHOTOS; i++)
            lab->photos[i] = (sf_photo){.pixels = lab->pixels + i * SHIFT,
                                        .stride = (size_t)width,
                                        .width = width - SHIFT,
                                        .height = height};
    }
    sf_free(lab->ctx, light);
    return light && lab->pixels ? SF_OK : SF_ERR_MEMORY;
}

/* ---- a level --------------------------------------------------------------------------------------------
 */

/* Both photos once: features of each, and their matches. Least times are kept. */
static sf_status run_round(photo_lab *lab, bench_photos *row) {
    sf_features f[PHOTOS] = {{0}, {0}};
    sf_matches matches = {0};
    sf_match_options options = sf_match_options_default();
    sf_status status = SF_OK;
    for (int i = 0; i < PHOTOS && !status; i++) {
        double start = bench_thread_clock();
        status = sf_features_find(lab->ctx, &lab->photos[i], &lab->options, &f[i]);
        bench_keep_least(&row->features_seconds, bench_thread_clock() - start);
    }
    double start = bench_thread_clock();
    if (!status) status = sf_match_pair(lab->ctx, &f[0], &f[1], &options, &matches);
    bench_keep_least(&row->match_seconds, bench_thread_clock() - start);
    row->features = (double)f[0].count;
    row->matches = (double)matches.count;
    row->products = (double)f[0].count * (double)f[1].count;
    sf_matches_free(lab->ctx, &matches);
    for (int i = 0; i < PHOTOS; i++) sf_features_free(lab->ctx, &f[i]);
    return status;
}

static sf_status measure(photo_lab *lab, const bench_options *options, bench_report *report) {
    static const struct {
        const char *name;
        sf_upsampling upsampling;
    } starts[BENCH_PHOTO_ROWS] = {{"at its size", SF_UPSAMPLE_NEVER},
                                  {"at twice its size", SF_UPSAMPLE_ALWAYS}};
    sf_status status = SF_OK;
    double start = sf_clock();
    for (int round = 0; bench_goes_on(options, round, options->quick ? 1 : ROUNDS, start) && !status; round++)
        for (int n = 0; n < report->levels * BENCH_PHOTO_ROWS && !status; n++) {
            const bench_level *level = &report->level[n / BENCH_PHOTO_ROWS];
            bench_photos *row = &report->photos[n];
            if (round && !strcmp(level->name, "scalar")) continue; /* slow, and only there to be compared */
            row->level = n / BENCH_PHOTO_ROWS;
            row->start = starts[n % BENCH_PHOTO_ROWS].name;
            row->width = lab->photos[0].width, row->height = lab->photos[0].height;
            lab->options.upsampling = starts[n % BENCH_PHOTO_ROWS].upsampling;
            *lab->ctx->kernels = level->kernels;
            status = run_round(lab, row);
        }
    report->photo_rows = report->levels * BENCH_PHOTO_ROWS;
    return status;
}

sf_status bench_sfm(sf_context *ctx, const bench_options *options, bench_report *report) {
    photo_lab lab = {.options = sf_features_options_default()};
    bench_say(options, "features and matches of photos");
    sf_status status = bench_context(ctx, report->level[0].name, 1, &lab.ctx);
    if (status) return status;
    status = draw(&lab, options->quick);
    if (!status) status = measure(&lab, options, report);
    if (status) sf_fail(ctx, status, "%s", sf_last_error(lab.ctx));
    sf_free(lab.ctx, lab.pixels);
    sf_context_destroy(&lab.ctx);
    return status;
}
