/* picture_memory.c - see picture_memory.h. */
#include "picture_memory.h"

#include <math.h>
#include <stdio.h>

#include "../base/memory.h"
#include "../base/pool.h"
#include "undistort.h"

static const double mega = 1048576;

sf_optics sf_scaled_lens(const sf_entry *e, double x, double y) {
    sf_optics lens = e->lens;
    lens.fx *= x;
    lens.cx *= x;
    lens.fy *= y;
    lens.cy *= y;
    return lens;
}

/* Bytes of pictures. */
typedef struct picture_bytes {
    double kept, largest; /* of all; of the largest */
    double read;          /* what is held of a picture while it is read, at most */
} picture_bytes;

/* By the files' sizes, which need not be the cameras'. While a picture is read there are pixels of 4 bytes,
 * planes, and planes once more where they are resampled. A file that cannot be read is named when it is its
 * turn. SF_ERR_MEMORY. */
static sf_status estimate(const sf_project *p, const sf_load_options *options, picture_bytes *bytes) {
    enum { AT_WORK = 4 + 3 + 3 };
    picture_bytes b = {0};
    double area = (double)options->downscale * options->downscale;
    for (size_t i = 0; i < p->count; i++) {
        const sf_entry *e = &p->entries[i];
        int width = e->width, height = e->height;
        sf_status status = e->bad_pose ? SF_OK : sf_picture_size(p->ctx, e->path, &width, &height);
        if (status == SF_ERR_MEMORY) return status;
        if (e->bad_pose || status) continue;
        sf_optics lens = sf_scaled_lens(e, (double)width / e->width, (double)height / e->height);
        sf_undistorted frame = sf_undistort_frame(&lens, width, height);
        int weighted = e->mask || sf_optics_is_distorted(&lens);
        double kept = (weighted ? 4 : 3) * (double)frame.width * frame.height / area;
        double read = AT_WORK * fmax((double)width * height, (double)frame.width * frame.height) + kept;
        b.kept += kept;
        b.largest = fmax(b.largest, kept);
        b.read = fmax(b.read, read);
    }
    *bytes = b;
    return SF_OK;
}

/* How many pictures `bytes` hold while they are read, at most one a thread. */
static size_t at_once(const sf_project *p, const picture_bytes *b, double bytes) {
    double count = bytes / fmax(b->read, 1), threads = sf_pool_threads(p->ctx->pool);
    return count < 1 ? 0 : (size_t)fmin(count, threads);
}

/* Whether the pictures stay in memory. */
static int stays(const sf_project *p, const picture_bytes *b, double budget, double left,
                 sf_picture_plan *plan) {
    plan->at_once = at_once(p, b, left - b->kept);
    return !sf_pixels_exceed(b->kept, budget) && plan->at_once;
}

/* Without a disk the pictures stay in memory, if it holds them at all. */
static sf_status stay_after_all(const sf_project *p, const picture_bytes *b, double left, sf_status status,
                                sf_picture_plan *plan) {
    char why[1024];
    plan->at_once = at_once(p, b, left - b->kept);
    if (status != SF_ERR_IO || !plan->at_once) return status;
    snprintf(why, sizeof why, "%s", sf_last_error(p->ctx));
    sf_log(p->ctx, SF_LOG_WARNING, "%s: they stay in memory", why);
    return SF_OK;
}

/* Each of several ranks needs a part of each picture: memory is for the Gaussians. Where no disk takes the
 * pictures, memory that holds them does. */
static sf_status move_for_ranks(const sf_project *p, const picture_bytes *b, sf_picture_plan *plan) {
    if (!p->ctx->cluster) return SF_OK;
    sf_status status = sf_pixel_cache_create(p->ctx, p->path, (uint64_t)b->kept, (size_t)b->largest,
                                             sf_pixel_buffers(0, b->largest), &plan->cache);
    return status == SF_ERR_IO ? SF_OK : status;
}

sf_status sf_plan_pictures(const sf_project *p, const sf_load_options *options, sf_picture_plan *plan) {
    *plan = (sf_picture_plan){.at_once = (size_t)sf_pool_threads(p->ctx->pool)};
    double budget = options->no_pixels ? 0 : (double)sf_memory_budget((uint64_t)options->memory);
    int known = budget > 0;
    if (options->no_pixels || (!known && !p->ctx->cluster)) return SF_OK;
    double before = (double)sf_memory_resident(), left = budget - before;
    picture_bytes b;
    sf_status status = estimate(p, options, &b);
    if (status) return status;
    if (!known || stays(p, &b, budget, left, plan)) return move_for_ranks(p, &b, plan);
    size_t buffers = sf_pixel_buffers(budget, b.largest);
    double least = fmax(b.read, (double)buffers * b.largest);
    if (least > left)
        return sf_fail(
            p->ctx, SF_ERR_MEMORY,
            "%s: memory: %.0f MB are not enough: the pictures take about %.0f MB, a few at a time, "
            "beside the %.0f in use (downscale makes them smaller)",
            p->path, budget / mega, least / mega, before / mega);
    plan->at_once = at_once(p, &b, left);
    status =
        sf_pixel_cache_create(p->ctx, p->path, (uint64_t)b.kept, (size_t)b.largest, buffers, &plan->cache);
    if (status) return stay_after_all(p, &b, left, status, plan);
    sf_log(
        p->ctx, SF_LOG_INFO,
        "%s: the pictures' %.0f MB are more than half of the %.0f MB of memory: they are read from a file in "
        "%s as they are needed",
        p->path, b.kept / mega, budget / mega, sf_pixel_cache_folder(plan->cache));
    return SF_OK;
}
