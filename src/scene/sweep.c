/* sweep.c - plane-sweep stereo: matches every view with its neighbours, first coarsely for the range of
 * depths, then finely; depths that several views agree on are fused to points. */
#include "sweep.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/statistics.h"
#include "fuse.h"
#include "match.h"
#include "neighbours.h"

enum {
    MOST_VIEWS = 48, /* of one place */
    MOST_VIEWS_APART = 192,
    NEIGHBOURS = 3,
    COARSE_SIDE = 80, /* px, the longest side of a picture */
    FINE_SIDE = 256,
    COARSE_PLANES = 128, /* at most */
    FINE_PLANES = 80,
    ENOUGH = 40, /* the fewest depths that determine the range of a view */
};

/* Inverse depths of the farthest and the nearest plane of the coarse sweep, in 1 / extents, or in 1 / what a
 * view looks at where views have no common focus: nearly infinity, and near the camera. */
#define FARTHEST 0.01
#define NEAREST  25.0
/* The fraction of the coarse depths that may lie outside the range, and the margin added on both sides. */
#define OUTLIERS   0.02
#define RANGE_ROOM 0.15

/* A parallel run over all views. */
typedef struct sweep_job {
    sf_context *ctx;
    sf_seen *seen;
    size_t n;
    int first_alone;
    size_t scratch_floats; /* a thread */
    float *scratch;        /* [threads][scratch_floats] */
    atomic_int filled;     /* an sf_status */
} sweep_job;

static void fill_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    sweep_job *job = job_pointer;
    sf_status status = sf_grey_fill(job->ctx, job->seen[task].view, &job->seen[task].grey);
    if (status) atomic_store(&job->filled, (int)status);
}

/* Whether the depths of a view are wanted. */
static int is_wanted(const sweep_job *job, size_t view) {
    int wanted = !job->first_alone || !view;
    for (size_t k = 0; k < job->seen[0].neighbours; k++) wanted |= job->seen[0].neighbour[k] == view;
    return wanted;
}

static void match_task(void *job_pointer, size_t task, int thread) {
    const sweep_job *job = job_pointer;
    sf_seen *seen = &job->seen[task];
    size_t pixels = (size_t)seen->grey.camera.width * (size_t)seen->grey.camera.height;
    if (!seen->neighbours || !(seen->range.first < seen->range.last) || !is_wanted(job, task)) {
        memset(seen->inverse_depth, 0, pixels * sizeof *seen->inverse_depth);
        memset(seen->score, 0, pixels * sizeof *seen->score);
        return;
    }
    const sf_grey *neighbours[SF_MATCH_NEIGHBOURS];
    for (size_t k = 0; k < seen->neighbours; k++) neighbours[k] = &job->seen[seen->neighbour[k]].grey;
    sf_match(&seen->grey, neighbours, seen->neighbours, &seen->range,
             job->scratch + (size_t)thread * job->scratch_floats, seen->inverse_depth, seen->score);
}

static void free_pictures(sweep_job *job) {
    for (size_t i = 0; i < job->n; i++) {
        sf_grey_destroy(job->ctx, &job->seen[i].grey);
        sf_free(job->ctx, job->seen[i].inverse_depth);
        sf_free(job->ctx, job->seen[i].score);
        job->seen[i].inverse_depth = job->seen[i].score = NULL;
    }
    sf_free(job->ctx, job->scratch);
    job->scratch = NULL;
}

static int factor_for(const sf_camera *camera, int longest) {
    int side = camera->width > camera->height ? camera->width : camera->height;
    int least = camera->width < camera->height ? camera->width : camera->height;
    int factor = (side + longest - 1) / longest;
    return factor < least ? factor : least;
}

/* Makes pictures of at most `longest` px, and room for their depths. */
static sf_status make_pictures(sweep_job *job, int longest) {
    sf_status status = SF_OK;
    job->scratch_floats = 0;
    for (size_t i = 0; !status && i < job->n; i++) {
        sf_seen *seen = &job->seen[i];
        status = sf_grey_create(job->ctx, seen->view, factor_for(&seen->view->camera, longest), &seen->grey);
        size_t pixels = (size_t)seen->grey.camera.width * (size_t)seen->grey.camera.height;
        if (!status) seen->inverse_depth = sf_alloc(job->ctx, pixels, sizeof *seen->inverse_depth);
        if (!status) seen->score = sf_alloc(job->ctx, pixels, sizeof *seen->score);
        if (!seen->inverse_depth || !seen->score) status = SF_ERR_MEMORY;
        size_t floats = (sf_match_scratch(&seen->grey.camera) + 15) / 16 * 16; /* each thread's aligned */
        if (floats > job->scratch_floats) job->scratch_floats = floats;
    }
    size_t threads = (size_t)sf_pool_threads(job->ctx->pool);
    if (!status) job->scratch = sf_alloc(job->ctx, threads * job->scratch_floats, sizeof *job->scratch);
    if (!status && !job->scratch) status = SF_ERR_MEMORY;
    if (!status) sf_pool_run(job->ctx->pool, job->n, fill_task, job);
    return status ? status : (sf_status)atomic_load(&job->filled);
}

/* Chooses the neighbours of each view at its distance, and the number of planes. */
static void choose_partners(sweep_job *job, const sf_camera *const *cameras, int most_planes) {
    for (size_t i = 0; i < job->n; i++) {
        sf_seen *seen = &job->seen[i];
        const sf_grey *neighbours[SF_MATCH_NEIGHBOURS];
        seen->neighbours =
            sf_choose_neighbours(cameras, job->n, i, seen->distance, NEIGHBOURS, seen->neighbour);
        for (size_t k = 0; k < seen->neighbours; k++) neighbours[k] = &job->seen[seen->neighbour[k]].grey;
        seen->range.planes = sf_match_planes(&seen->grey, neighbours, seen->neighbours, seen->range.first,
                                             seen->range.last, most_planes);
    }
}

/* Narrows a view's range to `n` inverse depths, which get sorted. */
static void narrow(sf_seen *seen, float *found, size_t n) {
    qsort(found, n, sizeof *found, sf_compare_floats);
    double low = (double)found[(size_t)(OUTLIERS * (double)n)];
    double high = (double)found[n - 1 - (size_t)(OUTLIERS * (double)n)];
    seen->distance = 1 / (double)found[n / 2];
    double room = RANGE_ROOM * (high - low);
    seen->range.first = fmax(seen->widest.first, low - room);
    seen->range.last = fmin(seen->widest.last, high + room);
}

static size_t gather_depths(const sf_seen *seen, float *found) {
    size_t pixels = (size_t)seen->grey.camera.width * (size_t)seen->grey.camera.height, n = 0;
    for (size_t i = 0; i < pixels; i++)
        if (seen->inverse_depth[i] > 0) found[n++] = seen->inverse_depth[i];
    return n;
}

static sf_match_range widest_of_all(const sweep_job *job) {
    sf_match_range widest = job->seen[0].widest;
    for (size_t i = 1; i < job->n; i++) {
        widest.first = fmin(widest.first, job->seen[i].widest.first);
        widest.last = fmax(widest.last, job->seen[i].widest.last);
    }
    return widest;
}

/* Sets the range of each view from its coarse depths; where these are few, from those of all views. */
static sf_status narrow_ranges(sweep_job *job) {
    size_t room = 0, all = 0;
    for (size_t i = 0; i < job->n; i++)
        room += (size_t)job->seen[i].grey.camera.width * (size_t)job->seen[i].grey.camera.height;
    float *found = sf_alloc(job->ctx, room, sizeof *found);
    if (!found) return SF_ERR_MEMORY;
    for (size_t i = 0; i < job->n; i++) all += gather_depths(&job->seen[i], found + all);
    sf_seen together = {.widest = widest_of_all(job)};
    if (all >= ENOUGH) narrow(&together, found, all);
    for (size_t i = 0; i < job->n; i++) {
        sf_seen *seen = &job->seen[i];
        size_t n = gather_depths(seen, found);
        seen->range = all >= ENOUGH ? together.range : seen->widest;
        if (n >= ENOUGH)
            narrow(seen, found, n);
        else if (all >= ENOUGH)
            seen->distance = together.distance;
        else
            seen->range.last = seen->range.first; /* an empty range: not matched */
    }
    sf_free(job->ctx, found);
    return SF_OK;
}

static void first_look(sweep_job *job, const sf_camera *const *cameras, const sf_sweep_options *options) {
    double distances[MOST_VIEWS_APART];
    int shared = sf_look_distances(cameras, job->n, options->extent, distances);
    for (size_t i = 0; i < job->n; i++) {
        sf_seen *seen = &job->seen[i];
        seen->distance = distances[i];
        seen->widest.first = FARTHEST / (shared ? options->extent : distances[i]);
        seen->widest.last = shared ? 1 / options->nearest : NEAREST / distances[i];
        seen->range = seen->widest;
    }
}

static sf_status match_all(sweep_job *job, const sf_sweep_options *options) {
    const sf_camera *cameras[MOST_VIEWS_APART];
    for (size_t i = 0; i < job->n; i++) cameras[i] = &job->seen[i].view->camera;
    sf_status status = make_pictures(job, COARSE_SIDE);
    if (!status) {
        first_look(job, cameras, options);
        choose_partners(job, cameras, COARSE_PLANES);
        sf_pool_run(job->ctx->pool, job->n, match_task, job);
        status = narrow_ranges(job);
    }
    free_pictures(job);
    if (!status) status = make_pictures(job, FINE_SIDE);
    if (!status) {
        choose_partners(job, cameras, FINE_PLANES);
        sf_pool_run(job->ctx->pool, job->n, match_task, job);
    }
    return status;
}

/* How many of n views to match: places that are apart need more. */
static sf_status choose_count(sf_context *ctx, const sf_view *const *views, size_t n, double extent,
                              size_t *count) {
    *count = n;
    if (n <= MOST_VIEWS) return SF_OK;
    const sf_camera **cameras = sf_alloc(ctx, n, sizeof *cameras);
    double *distances = sf_alloc(ctx, n, sizeof *distances);
    for (size_t i = 0; i < n && cameras; i++) cameras[i] = &views[i]->camera;
    if (cameras && distances) {
        size_t most = sf_look_distances(cameras, n, extent, distances) ? MOST_VIEWS : MOST_VIEWS_APART;
        if (n > most) *count = most;
    }
    sf_status status = cameras && distances ? SF_OK : SF_ERR_MEMORY;
    sf_free(ctx, distances);
    sf_free(ctx, cameras);
    return status;
}

sf_status sf_sweep_points(sf_context *ctx, const sf_view *const *views, size_t n,
                          const sf_sweep_options *options, sf_cloud *cloud) {
    *cloud = (sf_cloud){0};
    if (!(options->nearest > 0 && options->extent > 0 && options->wanted))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "sweep: wanted %zu, nearest %g or extent %g is not above 0",
                       options->wanted, options->nearest, options->extent);
    sweep_job job = {.ctx = ctx, .first_alone = options->first_alone};
    sf_status status = choose_count(ctx, views, n, options->extent, &job.n);
    if (status) return status;
    job.seen = sf_calloc(ctx, job.n, sizeof *job.seen);
    status = job.seen ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < job.n; i++) {
        size_t place = i * n / job.n;
        job.seen[i].view = views[place], job.seen[i].place = (uint32_t)place;
    }
    if (!status) status = match_all(&job, options);
    if (!status) status = sf_fuse(ctx, job.seen, job.n, options->wanted, cloud);
    if (job.seen) free_pictures(&job);
    sf_free(ctx, job.seen);
    return status;
}
