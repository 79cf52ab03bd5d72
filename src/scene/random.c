/* random.c - random points behind pixels: without known points at depths that agree with other views, else
 * behind pixels that no known point covers, farther than the known points beside the pixel. */
#include "random.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/context.h"
#include "../base/pool.h"
#include "../base/statistics.h"
#include "consistency.h"
#include "neighbours.h"
#include "pixels.h"

enum {
    DEPTHS = 20,       /* random depths tried for a point */
    FAR_DEPTHS = 10,   /* likewise, for a far point */
    BATCH = 4096,      /* points whose colours are read at once */
    MOST_DRAWN = 64,   /* views drawn to find those that a point's colour is compared with: few may see it */
    CELLS = 24,        /* across and down a picture: what a point in them covers */
    TRIALS = 1000,     /* pixels drawn for one that is not covered; points that are asked about */
    FEWEST_ASKED = 50, /* of them that a picture has, to judge by */
    NO_MATTER = 3 * 2 * SF_PROBE_PIXELS * SF_PROBE_VIEWS, /* a difference that no depth is better for: 2
                                                             levels a value */
    AS_GOOD = NO_MATTER * 3 / 4,                          /* one that says nothing of two depths */
};
#define ASIDE    1.25 /* factor by which a covered surface may be farther than a point that does not hide it */
#define FARTHEST 20   /* a far point's depth, at most, in those of the points beside its pixel */
/* A point this many extents before a camera is a match with hardly any parallax, and covers nothing. */
#define NOWHERE 100
/* The content of a view begins at NEAR_PART times the NEAR_SHARE quantile of the depths of its covered
 * cells. */
#define NEAR_PART  0.8
#define NEAR_SHARE 0.05
/* The least part of the points that must agree: a fifth to a quarter of wrong points do, more than half of
 * right ones. */
#define LEAST_AGREE 0.3

/* Draws `count` more depths within a factor of 3 of a distance. */
static void draw_depths(sf_probe *p, double distance, int count, sf_rng *rng) {
    double nearest = distance / 3, farthest = 3 * distance;
    for (int i = 0; i < count; i++)
        p->depths[p->depth_count++] = nearest * pow(farthest / nearest, sf_rng_uniform(rng));
}

static void ask_anybody(sf_probe *p, size_t n, sf_rng *rng) {
    for (int k = 0; k < SF_PROBE_VIEWS; k++) p->others[k] = (uint32_t)sf_rng_below(rng, n);
}

/* Draws views that see the point at a depth and can tell it from others; any views if hardly one does. */
static void ask_witnesses(sf_probe *p, const sf_view *const *views, size_t n, double depth, sf_rng *rng) {
    float point[3];
    size_t x, y;
    sf_behind_pixel(&views[p->view]->camera, p->x, p->y, depth, point);
    for (int trial = 0, found = 0; found < SF_PROBE_VIEWS; trial++) {
        uint32_t other = (uint32_t)sf_rng_below(rng, n);
        if (trial >= MOST_DRAWN || sf_pixel_of(&views[other]->camera, point, &x, &y) > 0)
            p->others[found++] = other;
    }
}

/* Depths of a cloud's points in the cells of all pictures. */
typedef struct cover {
    const sf_view *const *views;
    size_t n;
    float *depths;   /* [n][CELLS][CELLS]: mean camera z of the points in a cell; 0: none is */
    double *nearest; /* [n] a little less than the camera z of the nearest content; 0: unknown */
    double *centers; /* [n][3] of the cameras */
} cover;

static size_t cell_of(const sf_camera *c, size_t x, size_t y) {
    return y * CELLS / (size_t)c->height * CELLS + x * CELLS / (size_t)c->width;
}

static float depth_at(const cover *c, size_t view, size_t x, size_t y) {
    return c->depths[view * CELLS * CELLS + cell_of(&c->views[view]->camera, x, y)];
}

/* Whether a point is nearer to a camera than its content, in any direction: a view from nearby that looks
 * there would be hidden. */
static int is_beside_camera(const cover *c, size_t i, const float *xyz) {
    double square = 0;
    for (int k = 0; k < 3; k++) {
        double d = (double)xyz[k] - c->centers[3 * i + (size_t)k];
        square += d * d;
    }
    return square < c->nearest[i] * c->nearest[i];
}

/* Number of views in which a point would hide the covered surface, or that it is beside; counts to `most`. */
static size_t hides(const cover *c, const float *xyz, size_t most) {
    size_t count = 0, x, y;
    for (size_t i = 0; i < c->n && count < most; i++) {
        double z = sf_pixel_of(&c->views[i]->camera, xyz, &x, &y);
        count += (z > 0 && z * ASIDE < (double)depth_at(c, i, x, y)) || is_beside_camera(c, i, xyz);
    }
    return count;
}

/* The least difference of the probe's depths from `first` on. Of depths that are equally good it takes the
 * farthest: a point in front of a wall without texture fits the view it is close to, and occludes others. */
static int best_depth(const sf_probe *p, size_t first, float *xyz) {
    int least = INT_MAX;
    double farthest = 0;
    for (size_t d = first; d < p->depth_count; d++)
        if (p->sums[d] < least) least = p->sums[d];
    for (size_t d = first; d < p->depth_count; d++) {
        if (p->sums[d] > least + AS_GOOD || p->depths[d] <= farthest) continue;
        farthest = p->depths[d];
        memcpy(xyz, p->points[d][0], sizeof p->points[d][0]);
    }
    return least;
}

typedef struct cover_job {
    cover *c;
    const sf_cloud *cloud;
    double farthest; /* greatest camera z of what counts */
    size_t *open;    /* [n] cells of a view without points */
} cover_job;

/* The cells of a view, and where its content begins. */
static void cover_task(void *pointer, size_t i, int thread) {
    (void)thread;
    const cover_job *job = pointer;
    const sf_camera *camera = &job->c->views[i]->camera;
    float *depths = job->c->depths + i * CELLS * CELLS;
    uint32_t number[CELLS * CELLS] = {0};
    double covered[CELLS * CELLS];
    size_t n = 0, x, y;
    for (size_t k = 0; k < job->cloud->n; k++) {
        double z = sf_pixel_of(camera, job->cloud->xyz + 3 * k, &x, &y);
        if (!(z > 0 && z <= job->farthest)) continue;
        size_t at = cell_of(camera, x, y);
        depths[at] += (float)z, number[at]++;
    }
    for (size_t at = 0; at < CELLS * CELLS; at++) {
        if (!number[at]) continue;
        depths[at] /= (float)number[at];
        covered[n++] = (double)depths[at];
    }
    job->open[i] = CELLS * CELLS - n;
    if (n) job->c->nearest[i] = NEAR_PART * sf_ranked(covered, n, (size_t)(NEAR_SHARE * (double)n));
}

/* Fills the cells from a cloud; returns the part of the pictures that is not covered. open: scratch, [n]. */
static double find_cover(struct sf_pool *pool, cover *c, const sf_cloud *cloud, double extent, size_t *open) {
    cover_job job = {c, cloud, extent > 0 ? NOWHERE * extent : INFINITY, open};
    size_t all = 0;
    sf_pool_run(pool, c->n, cover_task, &job);
    for (size_t i = 0; i < c->n; i++) all += open[i];
    return (double)all / (double)(c->n * CELLS * CELLS);
}

/* The largest depth of the covered cells nearest to a pixel, in a growing square; 0 if no cell is covered. */
static double depth_beside(const cover *c, size_t view, size_t x, size_t y) {
    size_t at = cell_of(&c->views[view]->camera, x, y);
    const float *depths = c->depths + view * CELLS * CELLS;
    int column = (int)(at % CELLS), row = (int)(at / CELLS);
    float farthest = 0;
    for (int r = 1; r < CELLS && !(farthest > 0); r++)
        for (int v = row - r; v <= row + r; v++)
            for (int u = column - r; u <= column + r; u++)
                if (u >= 0 && u < CELLS && v >= 0 && v < CELLS)
                    farthest = fmaxf(farthest, depths[v * CELLS + u]);
    return (double)farthest;
}

/* A point behind a pixel, between what is known beside it, at `depth`, and FARTHEST times as far, with an
 * evenly distributed inverse depth: of a few, the first that hides nothing, or the one that hides least. */
static void far_point(const cover *c, const sf_probe *q, double depth, sf_rng *rng, float *xyz) {
    size_t least = SIZE_MAX;
    for (int trial = 0; trial < FAR_DEPTHS && least; trial++) {
        float p[3];
        double nearness = 1 - (1 - 1.0 / FARTHEST) * sf_rng_uniform(rng);
        sf_behind_pixel(&c->views[q->view]->camera, q->x, q->y, depth / nearness, p);
        size_t hidden = hides(c, p, least);
        if (hidden < least) least = hidden, memcpy(xyz, p, sizeof p);
    }
}

/* Finds a random pixel of a random view that is neither covered nor masked; p->view is c->n if none was
 * found. */
static sf_status random_pixel(const cover *c, sf_rng *rng, sf_probe *p) {
    for (int trial = 0; trial < TRIALS; trial++) {
        size_t i = (size_t)sf_rng_below(rng, c->n);
        const sf_camera *camera = &c->views[i]->camera;
        uint8_t weight;
        p->view = (uint32_t)i, p->depth_count = 0;
        p->x = (size_t)sf_rng_below(rng, (uint64_t)camera->width);
        p->y = (size_t)sf_rng_below(rng, (uint64_t)camera->height);
        if (depth_at(c, i, p->x, p->y) > 0) continue;
        sf_status status = sf_view_weight(c->views[i], p->x, p->y, &weight);
        if (status || weight) return status;
    }
    p->view = (uint32_t)c->n;
    return SF_OK;
}

/* What points are made from. */
typedef struct drawing {
    sf_context *ctx;
    const cover *cover;
    const double *distances; /* [n] that the views look at */
    int known;               /* the cloud had points */
    sf_rng *rng;
    sf_probe *probes; /* [BATCH] */
} drawing;

/* Draws up to `most` pixels, and what is asked about them; far points at once, to xyz [most][3]. Fewer, where
 * there are hardly any pixels left. */
static sf_status draw_probes(const drawing *d, size_t most, float *xyz, size_t *count) {
    const cover *c = d->cover;
    for (*count = 0; *count < most; ++*count) {
        sf_probe *p = &d->probes[*count];
        sf_status status = random_pixel(c, d->rng, p);
        if (status || p->view == c->n) return status;
        if (d->known) {
            double beside = depth_beside(c, p->view, p->x, p->y);
            far_point(c, p, beside > 0 ? beside : d->distances[p->view], d->rng, xyz + 3 * *count);
        } else {
            ask_anybody(p, c->n, d->rng); /* the range of depths is only a guess */
            draw_depths(p, d->distances[p->view], DEPTHS, d->rng);
        }
    }
    return SF_OK;
}

static sf_status draw_points(const drawing *d, size_t wanted, sf_cloud *cloud) {
    sf_status status = SF_OK;
    for (size_t drawn = BATCH, most; drawn == BATCH && cloud->n < wanted && !status;) {
        const sf_view *const *views = d->cover->views;
        size_t n = d->cover->n;
        float *xyz = cloud->xyz + 3 * cloud->n;
        most = wanted - cloud->n < BATCH ? wanted - cloud->n : BATCH;
        status = draw_probes(d, most, xyz, &drawn);
        if (!status) status = sf_probe_colors(d->ctx, views, n, d->probes, drawn);
        if (!status && !d->known) status = sf_probe_compare(d->ctx, views, n, d->probes, drawn);
        for (size_t i = 0; i < drawn && !status; i++) {
            if (!d->known) (void)best_depth(&d->probes[i], 0, xyz + 3 * i);
            memcpy(cloud->rgb + 3 * cloud->n++, d->probes[i].colors[0], sizeof d->probes[i].colors[0]);
        }
    }
    return status;
}

sf_status sf_random_points(sf_context *ctx, const sf_view *const *views, size_t n, size_t count,
                           double extent, sf_rng *rng, sf_cloud *cloud) {
    const sf_camera **cameras = sf_alloc(ctx, n, sizeof *cameras);
    double *distances = sf_alloc(ctx, n, sizeof *distances);
    cover c = {views, n, sf_calloc(ctx, n, CELLS * CELLS * sizeof *c.depths),
               sf_calloc(ctx, n, sizeof *c.nearest), sf_calloc(ctx, 3 * n, sizeof *c.centers)};
    size_t *open = sf_alloc(ctx, n, sizeof *open), had = cloud->n;
    drawing d = {ctx, &c, distances, had > 0, rng, sf_alloc(ctx, BATCH, sizeof *d.probes)};
    sf_status status = cameras && distances && c.depths && c.nearest && c.centers && open && d.probes
                           ? SF_OK
                           : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < n; i++) {
            cameras[i] = &views[i]->camera;
            sf_camera_center(cameras[i], c.centers + 3 * i);
        }
        sf_look_distances(cameras, n, extent, distances);
        double uncovered = find_cover(ctx->pool, &c, cloud, extent, open);
        status = draw_points(&d, had + (size_t)((double)count * uncovered), cloud);
    }
    if (status) cloud->n = had;
    sf_free(ctx, d.probes);
    sf_free(ctx, open);
    sf_free(ctx, c.centers);
    sf_free(ctx, c.nearest);
    sf_free(ctx, c.depths);
    sf_free(ctx, distances);
    sf_free(ctx, cameras);
    return status;
}

/* What is asked about a random sample of the points: the depth of each, and random ones. */
static sf_status ask_about_points(const sf_view *const *views, size_t n, const sf_cloud *cloud,
                                  sf_probe *probes, size_t *count) {
    sf_rng rng;
    *count = 0;
    sf_rng_seed(&rng, 1);
    for (int trial = 0; trial < TRIALS && cloud->n; trial++) {
        const float *xyz = cloud->xyz + 3 * sf_rng_below(&rng, cloud->n);
        sf_probe *p = &probes[*count];
        uint8_t weight;
        p->view = (uint32_t)sf_rng_below(&rng, n), p->depth_count = 1;
        p->depths[0] = sf_pixel_of(&views[p->view]->camera, xyz, &p->x, &p->y);
        if (!(p->depths[0] > 0)) continue;
        sf_status status = sf_view_weight(views[p->view], p->x, p->y, &weight);
        if (status) return status;
        if (!weight) continue;
        double nearest = p->depths[0] / 3, farthest = 3 * p->depths[0];
        ask_witnesses(p, views, n, sqrt(nearest * farthest), &rng);
        draw_depths(p, p->depths[0], DEPTHS, &rng);
        ++*count;
    }
    return SF_OK;
}

sf_status sf_points_agree(sf_context *ctx, const sf_view *const *views, size_t n, const sf_cloud *cloud,
                          int *do_agree) {
    size_t asked = 0, agree = 0;
    sf_probe *probes = sf_alloc(ctx, TRIALS, sizeof *probes);
    if (!probes) return SF_ERR_MEMORY;
    sf_status status = ask_about_points(views, n, cloud, probes, &asked);
    if (!status) status = sf_probe_colors(ctx, views, n, probes, asked);
    if (!status) status = sf_probe_compare(ctx, views, n, probes, asked);
    for (size_t i = 0; i < asked && !status; i++) {
        float at[3];
        agree += probes[i].sums[0] <= best_depth(&probes[i], 1, at) + NO_MATTER;
    }
    sf_free(ctx, probes);
    *do_agree = asked < FEWEST_ASKED || (double)agree >= LEAST_AGREE * (double)asked;
    return status;
}
