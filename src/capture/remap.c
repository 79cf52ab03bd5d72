/* remap.c - undistorts and downscales planes of floats by a map made once.
 *
 * A pixel of the result is the mean of downscale x downscale samples, one for each pixel that it covers of
 * the undistorted picture of full size: what sf_undistort and a box average after it give. To average first
 * would blur twice, over boxes of the distorted picture, which are others; to sample less would alias.
 */
#include <splatfit/remap.h>

#include <math.h>
#include <string.h>

#include "../base/context.h"
#include "../base/pool.h"
#include "../io/optics.h"

enum {
    MAX_SIDE = 65535,
    MAX_DOWNSCALE = 64,
    ROWS_A_TASK = 4,
    NOWHERE = 0xffff,
    WHOLE = 1 << 15 /* of a tap's fractions */
};

/* Where a sample comes from: a pixel, and parts of the way to its neighbours at the right and below. x is
 * NOWHERE outside of the picture. */
typedef struct tap {
    uint16_t x, y, right, down;
} tap;

struct sf_remap {
    sf_context *ctx;
    sf_optics optics;
    double limit;          /* sf_optics_limit of these */
    sf_camera camera;      /* of the result */
    int32_t width, height; /* px, of the source */
    int downscale;
    tap *map; /* [camera.height downscale][camera.width downscale]; NULL: every pixel is its own */
};

/* 1. The map */

/* A coordinate between the centres of the first and the last of `size` pixels, to 2^-15 px. */
static int split(double at, int32_t size, uint16_t *pixel, uint16_t *part) {
    if (!(at > -1 && at < size)) return 0;
    long steps = lround(at * WHOLE), last = (long)(size - 1);
    if (steps < 0 || steps > last * WHOLE) return 0;
    long whole = steps / WHOLE;
    if (whole == last && last > 0) whole--; /* there is a neighbour beyond */
    *pixel = (uint16_t)whole;
    *part = (uint16_t)(steps - whole * WHOLE);
    return 1;
}

static tap find_tap(const sf_remap *r, size_t x, size_t y) {
    double source[2];
    tap t = {0};
    if (!sf_optics_source(&r->optics, r->limit, (double)x + 0.5, (double)y + 0.5, source) ||
        !split(source[0], r->width, &t.x, &t.right) || !split(source[1], r->height, &t.y, &t.down))
        return (tap){.x = NOWHERE};
    return t;
}

static size_t samples_a_row(const sf_remap *r) { return (size_t)r->camera.width * (size_t)r->downscale; }

static void map_row(void *arg, size_t row, int thread) {
    const sf_remap *r = arg;
    (void)thread;
    size_t n = samples_a_row(r);
    for (size_t x = 0; x < n; x++) r->map[row * n + x] = find_tap(r, x, row);
}

static sf_status make_map(sf_remap *r) {
    size_t rows = (size_t)r->camera.height * (size_t)r->downscale;
    r->map = sf_alloc(r->ctx, rows * samples_a_row(r), sizeof *r->map);
    if (!r->map) return SF_ERR_MEMORY;
    sf_pool_run(r->ctx->pool, rows, map_row, r);
    return SF_OK;
}

static sf_status check(sf_context *ctx, const sf_lens *lens, int32_t width, int32_t height, int downscale) {
    if (width < 1 || width > MAX_SIDE || height < 1 || height > MAX_SIDE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "remap: size: %ld x %ld is not 1 to %d a side", (long)width,
                       (long)height, MAX_SIDE);
    if (downscale < 1 || downscale > MAX_DOWNSCALE || downscale > width || downscale > height)
        return sf_fail(ctx, SF_ERR_ARGUMENT,
                       "remap: downscale: %d is not 1 to %d, or more than a side of %ld x %ld", downscale,
                       MAX_DOWNSCALE, (long)width, (long)height);
    if (!sf_lens_is_valid(lens))
        return sf_fail(ctx, SF_ERR_ARGUMENT,
                       "remap: lens: fx %g fy %g cx %g cy %g k1 %g k2 %g p1 %g p2 %g k3 %g: not finite or no "
                       "focal length",
                       lens->fx, lens->fy, lens->cx, lens->cy, lens->k1, lens->k2, lens->p1, lens->p2,
                       lens->k3);
    return SF_OK;
}

sf_status sf_remap_create(sf_context *ctx, const sf_lens *lens, int32_t width, int32_t height, int downscale,
                          sf_remap **remap) {
    *remap = NULL;
    sf_status status = check(ctx, lens, width, height, downscale);
    if (status) return status;
    sf_remap *r = sf_calloc(ctx, 1, sizeof *r);
    if (!r) return SF_ERR_MEMORY;
    sf_camera whole = {width, height, lens->fx, lens->fy, lens->cx, lens->cy, {1, 0, 0, 0, 1, 0, 0, 0, 1},
                       {0}};
    r->ctx = ctx;
    r->optics = sf_optics_of(lens);
    r->limit = sf_optics_limit(&r->optics);
    r->camera = sf_camera_downscaled(&whole, downscale);
    r->width = width;
    r->height = height;
    r->downscale = downscale;
    status = sf_lens_is_distorted(lens) ? make_map(r) : SF_OK;
    if (status) sf_remap_destroy(&r);
    *remap = r;
    return status;
}

void sf_remap_destroy(sf_remap **remap) {
    sf_remap *r = *remap;
    if (!r) return;
    sf_free(r->ctx, r->map);
    sf_free(r->ctx, r);
    *remap = NULL;
}

void sf_remap_camera(const sf_remap *remap, sf_camera *camera) { *camera = remap->camera; }

/* 2. A picture */

typedef struct job {
    const sf_remap *remap;
    float *const *in;
    size_t stride;
    float *const *out;
    size_t out_stride;
    float *weight;
} job;

/* Sums of samples, and how many there are. Three names, not an array: the compiler keeps them in registers.
 */
typedef struct sums {
    float r, g, b;
    int count;
} sums;

static void add(sums *to, sums s) {
    to->r += s.r, to->g += s.g, to->b += s.b;
    to->count += s.count;
}

static float between(float a, float b, float part) { return a + part * (b - a); }

/* A tap with steps to its neighbours, which the last row and column have not. */
static float sample(const float *p, size_t beside, size_t below, float right, float down) {
    float above = between(p[0], p[beside], right), under = between(p[below], p[below + beside], right);
    return between(above, under, down);
}

static sums take_tap(const job *j, const tap *t) {
    size_t at = t->y * j->stride + t->x, below = j->remap->height > 1 ? j->stride : 0;
    size_t beside = j->remap->width > 1;
    float right = t->right * (1.0f / WHOLE), down = t->down * (1.0f / WHOLE);
    return (sums){sample(j->in[0] + at, beside, below, right, down),
                  sample(j->in[1] + at, beside, below, right, down),
                  sample(j->in[2] + at, beside, below, right, down), 1};
}

/* The samples of pixel x of a result from row `row` of the samples. */
static sums sum_row(const job *j, size_t x, size_t row) {
    const sf_remap *r = j->remap;
    size_t n = (size_t)r->downscale, first = x * n;
    sums s = {0, 0, 0, 0};
    if (r->map) {
        const tap *t = r->map + row * samples_a_row(r) + first;
        for (size_t i = 0; i < n; i++)
            if (t[i].x != NOWHERE) add(&s, take_tap(j, &t[i]));
        return s;
    }
    for (size_t i = 0, at = row * j->stride + first; i < n; i++, at++)
        add(&s, (sums){j->in[0][at], j->in[1][at], j->in[2][at], 1});
    return s;
}

static void run_pixel(const job *j, size_t x, size_t y) {
    size_t n = (size_t)j->remap->downscale, at = y * j->out_stride + x;
    sums all = {0, 0, 0, 0};
    for (size_t i = 0; i < n; i++) add(&all, sum_row(j, x, y * n + i)); /* sums of sums: fewer roundings */
    float count = all.count ? (float)all.count : 1;
    j->out[0][at] = all.r / count;
    j->out[1][at] = all.g / count;
    j->out[2][at] = all.b / count;
    if (j->weight) j->weight[at] = (float)all.count / (float)(n * n);
}

static void copy_row(const job *j, size_t y) {
    size_t width = (size_t)j->remap->width;
    for (int c = 0; c < 3; c++)
        memcpy(j->out[c] + y * j->out_stride, j->in[c] + y * j->stride, width * sizeof(float));
    for (size_t x = 0; j->weight && x < width; x++) j->weight[y * j->out_stride + x] = 1;
}

static void run_rows(void *arg, size_t task, int thread) {
    const job *j = arg;
    const sf_camera *camera = &j->remap->camera;
    (void)thread;
    size_t first = task * ROWS_A_TASK, end = first + ROWS_A_TASK;
    for (size_t y = first; y < end && y < (size_t)camera->height; y++) {
        if (!j->remap->map && j->remap->downscale == 1)
            copy_row(j, y);
        else
            for (size_t x = 0; x < (size_t)camera->width; x++) run_pixel(j, x, y);
    }
}

sf_status sf_remap_run(const sf_remap *remap, float *const rgb[3], size_t stride, float *const out[3],
                       size_t out_stride, float *weight) {
    const sf_camera *camera = &remap->camera;
    if (stride < (size_t)remap->width)
        return sf_fail(remap->ctx, SF_ERR_ARGUMENT, "remap: stride: %zu is less than a width of %ld", stride,
                       (long)remap->width);
    if (out_stride < (size_t)camera->width)
        return sf_fail(remap->ctx, SF_ERR_ARGUMENT, "remap: out_stride: %zu is less than a width of %ld",
                       out_stride, (long)camera->width);
    job j = {remap, rgb, stride, out, out_stride, weight};
    size_t tasks = ((size_t)camera->height + ROWS_A_TASK - 1) / ROWS_A_TASK;
    sf_pool_run(remap->ctx->pool, tasks, run_rows, &j);
    return SF_OK;
}
