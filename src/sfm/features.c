/* features.c - points of a photo that other photos of the same place show too. */
#include "features.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "octave.h"

enum { OCTAVES_MOST = 16, FEATURES_MOST = 1 << 24 };

/* Deviations of the Gaussian, px of an octave: of its first level; that pictures have when they come. */
#define FIRST_SCALE   1.6
#define PICTURE_SCALE 0.5

sf_features_options sf_features_options_default(void) {
    return (sf_features_options){
        .most = 2048, .upsampling = SF_UPSAMPLE_SMALL, .contrast = 0.02 / 3, .edge = 10, .directions = 2};
}

/* A picture's scale space. */
typedef struct search {
    const sf_photo *picture;
    sf_features_options options;
    sf_taps taps[SF_OCTAVE_ROWS];
    sf_octave octaves[OCTAVES_MOST];
    int count, factor; /* octaves; pixels of the first a pixel of the picture, along a row */
    sf_feature_list list;
    float *above, *below; /* two rows of the picture */
} search;

/* Of a level: from the scale before it to 2^(1/3) times that; of the first: from the picture's. */
static void find_taps(search *s) {
    double came = PICTURE_SCALE * s->factor, scale = FIRST_SCALE;
    const double ratio = 1.2599210498948732; /* 2^(1/3) */
    s->taps[SF_OCTAVE_FIRST] = sf_taps_of(sqrt(scale * scale - came * came));
    for (int kind = SF_OCTAVE_FIRST + 1; kind < SF_OCTAVE_ROWS; kind++) {
        s->taps[kind] = sf_taps_of(scale * sqrt(ratio * ratio - 1));
        scale *= ratio;
    }
}

static int factor_of(int width, int height, const sf_features_options *options) {
    if (options->upsampling == SF_UPSAMPLE_NEVER) return 1;
    return options->upsampling == SF_UPSAMPLE_ALWAYS || (int64_t)width * height <= SF_FEATURES_SMALL ? 2 : 1;
}

static sf_status open_search(search *s, sf_context *ctx, const sf_photo *picture,
                             const sf_features_options *options) {
    int factor = factor_of(picture->width, picture->height, options);
    int width = factor * picture->width, height = factor * picture->height;
    double step = 1.0 / factor;
    sf_status status = SF_OK;
    s->picture = picture;
    s->options = *options;
    s->factor = factor;
    find_taps(s);
    sf_feature_list_init(&s->list, ctx, options->most < FEATURES_MOST ? options->most : FEATURES_MOST);
    while (width >= SF_OCTAVE_LEAST_SIDE && height >= SF_OCTAVE_LEAST_SIDE && !status) {
        sf_octave *o = &s->octaves[s->count];
        *o = (sf_octave){.ctx = ctx, .taps = s->taps, .options = &s->options, .picture = picture};
        o->describe.list = &s->list;
        if (s->count) s->octaves[s->count - 1].coarser = o;
        status = sf_octave_create(o, width, height, step, s->count == 0);
        s->count++;
        width = (width + 1) / 2, height = (height + 1) / 2, step *= 2;
    }
    s->above = sf_alloc(ctx, (size_t)picture->width, sizeof *s->above);
    s->below = sf_alloc(ctx, (size_t)picture->width, sizeof *s->below);
    return status ? status : s->above && s->below ? SF_OK : SF_ERR_MEMORY;
}

static void close_search(search *s, sf_context *ctx) {
    for (int i = 0; i < s->count; i++) sf_octave_free(&s->octaves[i]);
    sf_feature_list_free(&s->list);
    sf_free(ctx, s->above);
    sf_free(ctx, s->below);
}

/* A row of the picture as 0..1. */
static void take_row(const sf_photo *p, int y, float *row) {
    const uint8_t *pixels = p->pixels + (size_t)y * p->stride;
    for (int x = 0; x < p->width; x++) row[x] = (float)pixels[x] * (1 / 255.0f);
}

/* Twice as wide: between two pixels their mean. */
static void widen(const float *row, int width, float *out) {
    for (int x = 0; x < width; x++) {
        out[2 * x] = row[x];
        out[2 * x + 1] = (row[x] + row[x + 1 < width ? x + 1 : x]) * 0.5f;
    }
}

static sf_status push_twice(search *s, int y) {
    const sf_photo *p = s->picture;
    sf_octave *first = &s->octaves[0];
    if (y == 0) take_row(p, 0, s->above);
    take_row(p, y + 1 < p->height ? y + 1 : y, s->below);
    widen(s->above, p->width, sf_band_next(&first->rows[SF_OCTAVE_INPUT]));
    sf_status status = sf_octave_advance(first);
    if (status) return status;
    for (int x = 0; x < p->width; x++) s->above[x] = (s->above[x] + s->below[x]) * 0.5f;
    widen(s->above, p->width, sf_band_next(&first->rows[SF_OCTAVE_INPUT]));
    float *next = s->below;
    s->below = s->above, s->above = next;
    return sf_octave_advance(first);
}

static sf_status push_row(search *s, int y) {
    if (s->factor == 2) return push_twice(s, y);
    take_row(s->picture, y, sf_band_next(&s->octaves[0].rows[SF_OCTAVE_INPUT]));
    return sf_octave_advance(&s->octaves[0]);
}

static sf_status check(sf_context *ctx, const sf_photo *p, const sf_features_options *options) {
    if (p->width < 1 || p->height < 1 || p->width > SF_FEATURES_SIDE || p->height > SF_FEATURES_SIDE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "features of a picture of %dx%d px: sides are 1 to %d px",
                       p->width, p->height, SF_FEATURES_SIDE);
    if (!options->most || !(options->contrast > 0) || !(options->edge > 1))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "features: %zu at most, contrast %g, edge %g: out of range",
                       options->most, options->contrast, options->edge);
    return SF_OK;
}

sf_status sf_features_find(sf_context *ctx, const sf_photo *picture, const sf_features_options *options,
                           sf_features *features) {
    *features = (sf_features){0};
    sf_status status = check(ctx, picture, options);
    if (status) return status;
    search *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    status = open_search(s, ctx, picture, options);
    for (int y = 0; y < picture->height && s->count && !status; y++) status = push_row(s, y);
    if (!status) status = sf_feature_list_take(&s->list, features);
    close_search(s, ctx);
    sf_free(ctx, s);
    return status;
}

typedef struct batch {
    sf_context *ctx;
    const sf_photo *pictures;
    const sf_features_options *options;
    sf_features *features;
    sf_status *statuses;
} batch;

static void find_one(void *batch_pointer, size_t task, int thread) {
    (void)thread;
    const batch *b = batch_pointer;
    b->statuses[task] = sf_features_find(b->ctx, &b->pictures[task], b->options, &b->features[task]);
}

sf_status sf_features_find_all(sf_context *ctx, const sf_photo *pictures, size_t count,
                               const sf_features_options *options, sf_features *features) {
    batch b = {ctx, pictures, options, features, NULL};
    sf_status status = SF_OK;
    for (size_t i = 0; i < count; i++) features[i] = (sf_features){0};
    if (!count) return SF_OK;
    b.statuses = sf_calloc(ctx, count, sizeof *b.statuses);
    if (!b.statuses) return SF_ERR_MEMORY;
    sf_pool_run(ctx->pool, count, find_one, &b);
    for (size_t i = 0; i < count && !status; i++) status = b.statuses[i];
    for (size_t i = 0; i < count && status; i++) sf_features_free(ctx, &features[i]);
    sf_free(ctx, b.statuses);
    return status;
}

void sf_features_free(sf_context *ctx, sf_features *features) {
    sf_free(ctx, features->points);
    sf_free(ctx, features->descriptors);
    *features = (sf_features){0};
}

uint64_t sf_features_memory(int width, int height, const sf_features_options *options) {
    uint64_t columns = (uint64_t)width * (uint64_t)factor_of(width, height, options);
    return (columns + 64) * 9600 + (uint64_t)options->most * 700;
}
