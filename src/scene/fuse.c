/* fuse.c - depth fusion: points whose depths agree between views, and thinning of them. */
#include "fuse.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/statistics.h"
#include "neighbours.h"
#include "pixels.h"

enum {
    CELL = 2, /* px: at most one point in CELL x CELL */
    MOST_TRIALS = 100,
};

/* Forward-backward check: where a point of a view projects into a neighbour, the neighbour's depth agrees to
 * this fraction, and the neighbour's point projects back to within this many pixels. */
#define MOST_DEPTH_ERROR 0.01
#define MOST_PIXEL_ERROR 1.0
/* Thinning starts with voxels of one pixel and makes them larger by at least this factor until few enough
 * points are left. */
#define COARSER 1.05

typedef struct candidate {
    float xyz[3];
    uint8_t rgb[3];
    uint32_t view;
    float score;
    float pixel; /* world units that a pixel spans there */
    uint64_t voxel;
} candidate;

typedef struct fuse_job {
    const sf_seen *seen;
    candidate *candidates; /* of view i from first[i], count[i] of them */
    size_t *first, *count;
    atomic_int opened; /* an sf_status */
} fuse_job;

static void to_world(const sf_camera *c, double u, double v, double z, double *p) {
    double q[3] = {(u - c->cx) / c->fx * z - c->t_cw[0], (v - c->cy) / c->fy * z - c->t_cw[1],
                   z - c->t_cw[2]};
    for (int k = 0; k < 3; k++) p[k] = c->R_cw[k] * q[0] + c->R_cw[3 + k] * q[1] + c->R_cw[6 + k] * q[2];
}

/* Whether the neighbour's depth at (u, v), where a point of depth z falls, leads back to the pixel (x, y); q:
 * the neighbour's point. */
static int confirms(const sf_seen *neighbour, const double uvz[3], const sf_camera *camera, double x,
                    double y, double *q) {
    const sf_camera *c = &neighbour->grey.camera;
    size_t column = (size_t)floor(uvz[0]), row = (size_t)floor(uvz[1]);
    double back_u, back_v, back_z, w = (double)neighbour->inverse_depth[row * (size_t)c->width + column];
    if (!(w > 0) || fabs(uvz[2] * w - 1) > MOST_DEPTH_ERROR) return 0;
    to_world(c, uvz[0], uvz[1], 1 / w, q);
    if (!sf_camera_sees(camera, q, &back_u, &back_v, &back_z)) return 0;
    return hypot(back_u - x, back_v - y) <= MOST_PIXEL_ERROR;
}

/* Whether at least one neighbour confirms a point, and all but one of those whose pictures it falls in: at
 * the edge of the pictures only two views may see it. p becomes the mean of the confirmed points. */
static int is_confirmed(const sf_seen *all, const sf_seen *seen, double x, double y, double *p) {
    size_t confirmed = 0, looking = 0;
    double sum[3] = {p[0], p[1], p[2]}, uvz[3], q[3];
    for (size_t k = 0; k < seen->neighbours; k++) {
        const sf_seen *neighbour = &all[seen->neighbour[k]];
        if (!sf_camera_sees(&neighbour->grey.camera, p, &uvz[0], &uvz[1], &uvz[2])) continue;
        looking++;
        if (!confirms(neighbour, uvz, &seen->grey.camera, x, y, q)) continue;
        for (int i = 0; i < 3; i++) sum[i] += q[i];
        confirmed++;
    }
    for (int i = 0; i < 3; i++) p[i] = sum[i] / (double)(confirmed + 1);
    return confirmed && confirmed + 1 >= looking;
}

/* The colour of the view, averaged over a pixel of the reduced picture. */
static void color_of(const sf_seen *seen, const uint8_t *planes, size_t x, size_t y, uint8_t *rgb) {
    size_t factor = (size_t)seen->grey.factor, width = (size_t)seen->view->camera.width;
    size_t pixels = width * (size_t)seen->view->camera.height;
    const uint8_t *corner = planes + y * factor * width + x * factor;
    for (size_t ch = 0; ch < 3; ch++) rgb[ch] = sf_box_mean(corner + ch * pixels, factor, 1, width);
}

/* Makes pixel (x, y) the cell's candidate if its depth is confirmed and its score is higher. planes: the
 * view's. */
static void consider_pixel(const sf_seen *all, const sf_seen *seen, const uint8_t *planes, size_t x, size_t y,
                           candidate *best) {
    const sf_camera *c = &seen->grey.camera;
    size_t i = y * (size_t)c->width + x;
    if (!(seen->inverse_depth[i] > 0) || seen->score[i] <= best->score) return;
    double p[3], u = (double)x + 0.5, v = (double)y + 0.5, z = 1 / (double)seen->inverse_depth[i];
    to_world(c, u, v, z, p);
    if (!is_confirmed(all, seen, u, v, p)) return;
    for (int k = 0; k < 3; k++) best->xyz[k] = (float)p[k];
    best->score = seen->score[i];
    best->pixel = (float)(z / c->fx);
    best->view = seen->place;
    color_of(seen, planes, x, y, best->rgb);
}

static void fuse_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    fuse_job *job = job_pointer;
    const sf_seen *seen = &job->seen[task];
    sf_view_pixels pixels;
    sf_status status = sf_view_open(seen->view, &pixels);
    if (status) {
        atomic_store(&job->opened, (int)status);
        return;
    }
    size_t width = (size_t)seen->grey.camera.width, height = (size_t)seen->grey.camera.height;
    candidate *out = job->candidates + job->first[task];
    for (size_t y = 0; y < height; y += CELL)
        for (size_t x = 0; x < width; x += CELL) {
            candidate best = {.score = 0};
            for (size_t v = y; v < y + CELL && v < height; v++)
                for (size_t u = x; u < x + CELL && u < width; u++)
                    consider_pixel(job->seen, seen, pixels.rgb, u, v, &best);
            if (best.score > 0) *out++ = best;
        }
    job->count[task] = (size_t)(out - (job->candidates + job->first[task]));
    sf_view_close(seen->view, &pixels);
}

static uint64_t mix(uint64_t hash, int64_t value) {
    hash = (hash ^ (uint64_t)value) * 0x9e3779b97f4a7c15u;
    return hash ^ (hash >> 29);
}

/* The voxel of a point, `size` pixels wide. A pixel's span grows with depth in powers of two, so that far
 * points are as dense in the pictures as near ones. */
static uint64_t voxel_of(const candidate *c, double size) {
    int level = ilogbf(c->pixel);
    double side = ldexp(size, level);
    uint64_t hash = mix(0, level);
    for (int k = 0; k < 3; k++)
        hash = mix(hash, (int64_t)floor(fmin(fmax((double)c->xyz[k] / side, -1e18), 1e18)));
    return hash;
}

enum { NOBODY = 0 }; /* slots hold an index + 1 */

/* Enters the candidate with the highest score of each voxel into `slots`; returns how many. slot_count is a
 * power of two, more than twice the candidates. */
static size_t keep_best(candidate *c, size_t n, double size, uint32_t *slots, size_t slot_count) {
    size_t kept = 0;
    memset(slots, NOBODY, slot_count * sizeof *slots);
    for (size_t i = 0; i < n; i++) {
        c[i].voxel = voxel_of(&c[i], size);
        size_t at = (size_t)c[i].voxel & (slot_count - 1);
        while (slots[at] && c[slots[at] - 1].voxel != c[i].voxel) at = (at + 1) & (slot_count - 1);
        kept += !slots[at];
        if (!slots[at] || c[i].score > c[slots[at] - 1].score) slots[at] = (uint32_t)i + 1;
    }
    return kept;
}

static int is_kept(const candidate *c, size_t i, const uint32_t *slots, size_t slot_count) {
    size_t at = (size_t)c[i].voxel & (slot_count - 1);
    while (c[slots[at] - 1].voxel != c[i].voxel) at = (at + 1) & (slot_count - 1);
    return slots[at] == (uint32_t)i + 1;
}

static sf_status thin(sf_context *ctx, candidate *c, size_t n, size_t wanted, sf_cloud *cloud) {
    size_t slot_count = 64;
    while (slot_count <= 2 * n) slot_count *= 2;
    uint32_t *slots = sf_alloc(ctx, slot_count, sizeof *slots);
    if (!slots) return SF_ERR_MEMORY;
    double size = 1;
    size_t kept = keep_best(c, n, size, slots, slot_count);
    for (int i = 0; kept > wanted && i < MOST_TRIALS; i++) {
        size *= fmax(COARSER, sqrt((double)kept / (double)wanted)); /* points lie on surfaces */
        kept = keep_best(c, n, size, slots, slot_count);
    }
    if (kept > wanted) kept = wanted; /* voxels around the origin and of different sides always remain */
    sf_status status = sf_cloud_create(ctx, kept, cloud);
    for (size_t i = 0; !status && cloud->n < kept; i++) {
        if (!is_kept(c, i, slots, slot_count)) continue;
        memcpy(cloud->xyz + 3 * cloud->n, c[i].xyz, sizeof c[i].xyz);
        memcpy(cloud->rgb + 3 * cloud->n, c[i].rgb, sizeof c[i].rgb);
        cloud->view[cloud->n++] = c[i].view;
    }
    sf_free(ctx, slots);
    return status;
}

sf_status sf_fuse(sf_context *ctx, const sf_seen *seen, size_t n, size_t wanted, sf_cloud *cloud) {
    size_t room = 0, found = 0;
    fuse_job job = {.seen = seen};
    *cloud = (sf_cloud){0};
    job.first = sf_calloc(ctx, n, sizeof *job.first);
    job.count = sf_calloc(ctx, n, sizeof *job.count);
    for (size_t i = 0; job.first && i < n; i++) {
        job.first[i] = room;
        size_t across = ((size_t)seen[i].grey.camera.width + CELL - 1) / CELL;
        room += across * (((size_t)seen[i].grey.camera.height + CELL - 1) / CELL);
    }
    if (job.first && job.count) job.candidates = sf_alloc(ctx, room, sizeof *job.candidates);
    sf_status status = job.candidates ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        sf_pool_run(ctx->pool, n, fuse_task, &job);
        for (size_t i = 0; i < n; i++) {
            memmove(job.candidates + found, job.candidates + job.first[i],
                    job.count[i] * sizeof *job.candidates);
            found += job.count[i];
        }
        status = (sf_status)atomic_load(&job.opened);
        if (!status) status = thin(ctx, job.candidates, found, wanted, cloud);
    }
    sf_free(ctx, job.candidates);
    sf_free(ctx, job.count);
    sf_free(ctx, job.first);
    return status;
}
