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
#include "neighbours.h"
#include "pixels.h"

enum {
    AROUND = 5,            /* pixels that sample a point's surroundings */
    SPREAD = 120,          /* their distance is the longest side / SPREAD */
    DEPTHS = 20,           /* random depths tried for a point */
    FAR_DEPTHS = 10,       /* likewise, for a far point */
    LOOKS = 8,             /* views with which its colour is compared */
    MOST_DRAWN = 64,       /* views drawn to find these: few may see the place */
    MOST_DIFFERENCE = 120, /* of two colours, the sum over the channels, of 3 x 255 */
    CELLS = 24,            /* across and down a picture: what a point in them covers */
    TRIALS = 1000,         /* pixels drawn for one that is not covered; points that are asked about */
    FEWEST_ASKED = 50,     /* of them that a picture has, to judge by */
    NO_MATTER = 3 * 2 * AROUND * LOOKS, /* a difference that no depth is better for: 2 levels a value */
    AS_GOOD = NO_MATTER * 3 / 4,        /* one that says nothing of two depths */
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

/* Projects a point to a pixel; returns its camera z, 0 outside the picture. */
static double pixel_of(const sf_camera *c, const float *xyz, size_t *x, size_t *y) {
    double q[3];
    for (int i = 0; i < 3; i++) {
        q[i] = c->t_cw[i];
        for (int k = 0; k < 3; k++) q[i] += c->R_cw[3 * i + k] * (double)xyz[k];
    }
    double u = c->fx * q[0] / q[2] + c->cx, v = c->fy * q[1] / q[2] + c->cy;
    if (!(q[2] > 0 && u >= 0 && u < c->width && v >= 0 && v < c->height)) return 0;
    *x = (size_t)u, *y = (size_t)v;
    return q[2];
}

/* The world point at `depth` behind a pixel. */
static void behind_pixel(const sf_camera *c, size_t x, size_t y, double depth, float *xyz) {
    double p[3] = {((double)x + 0.5 - c->cx) / c->fx * depth - c->t_cw[0],
                   ((double)y + 0.5 - c->cy) / c->fy * depth - c->t_cw[1], depth - c->t_cw[2]};
    for (int k = 0; k < 3; k++)
        xyz[k] = (float)(c->R_cw[k] * p[0] + c->R_cw[3 + k] * p[1] + c->R_cw[6 + k] * p[2]);
}

/* Whether a pixel has a weight: masked pixels do not. */
static int counts(const sf_view *view, size_t x, size_t y) {
    uint8_t rgb[3];
    return !view->has_weight || sf_view_pixel(view, x, y, rgb) > 0;
}

/* Difference of the colour from that of a view at the point, at most MOST_DIFFERENCE, since something may
 * occlude the point; MOST_DIFFERENCE also if the view does not see it. */
static int difference(const sf_view *view, const float *xyz, const uint8_t *rgb) {
    size_t x, y;
    uint8_t there[3];
    int sum = 0;
    if (!(pixel_of(&view->camera, xyz, &x, &y) > 0)) return MOST_DIFFERENCE;
    if (!sf_view_pixel(view, x, y, there)) return MOST_DIFFERENCE;
    for (int k = 0; k < 3; k++) sum += abs((int)there[k] - (int)rgb[k]);
    return sum < MOST_DIFFERENCE ? sum : MOST_DIFFERENCE;
}

static size_t clamped(int at, int size) { return (size_t)(at < 0 ? 0 : at < size ? at : size - 1); }

/* A pixel and a few around it, and the views with which their colours are compared. */
typedef struct question {
    const sf_view *view, *others[LOOKS];
    size_t xs[AROUND], ys[AROUND];
    uint8_t colors[AROUND][3];
    double nearest, farthest; /* range of depths to search, world units */
} question;

static question ask(const sf_view *view, size_t x, size_t y) {
    static const int across[AROUND] = {0, 1, -1, 0, 0}, down[AROUND] = {0, 0, 0, 1, -1};
    const sf_camera *c = &view->camera;
    question q = {.view = view};
    int step = 1 + (c->width > c->height ? c->width : c->height) / SPREAD;
    for (int i = 0; i < AROUND; i++) {
        q.xs[i] = clamped((int)x + step * across[i], c->width);
        q.ys[i] = clamped((int)y + step * down[i], c->height);
        if (!counts(view, q.xs[i], q.ys[i]))
            q.xs[i] = x, q.ys[i] = y; /* a masked pixel is replaced by the central one */
        (void)sf_view_pixel(view, q.xs[i], q.ys[i], q.colors[i]);
    }
    return q;
}

/* Sum of the colour differences to the other views at a depth; xyz: the point at that depth. */
static int answer(const question *q, double depth, float xyz[3]) {
    float p[AROUND][3];
    int sum = 0;
    for (int i = 0; i < AROUND; i++) {
        behind_pixel(&q->view->camera, q->xs[i], q->ys[i], depth, p[i]);
        for (int k = 0; k < LOOKS; k++) sum += difference(q->others[k], p[i], q->colors[i]);
    }
    memcpy(xyz, p[0], sizeof p[0]);
    return sum;
}

/* Sets the range of depths around a distance. */
static void ask_about(question *q, double distance) { q->nearest = distance / 3, q->farthest = 3 * distance; }

static void ask_anybody(question *q, const sf_view *const *views, size_t n, sf_rng *rng) {
    for (int k = 0; k < LOOKS; k++) q->others[k] = views[sf_rng_below(rng, n)];
}

/* Draws views that see the point at the middle of the depth range and can tell its depths apart; any views if
 * hardly one does. */
static void ask_witnesses(question *q, const sf_view *const *views, size_t n, sf_rng *rng) {
    float middle[3];
    size_t x, y;
    behind_pixel(&q->view->camera, q->xs[0], q->ys[0], sqrt(q->nearest * q->farthest), middle);
    for (int trial = 0, found = 0; found < LOOKS; trial++) {
        const sf_view *other = views[sf_rng_below(rng, n)];
        if (trial >= MOST_DRAWN || pixel_of(&other->camera, middle, &x, &y) > 0) q->others[found++] = other;
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
        double z = pixel_of(&c->views[i]->camera, xyz, &x, &y);
        count += (z > 0 && z * ASIDE < (double)depth_at(c, i, x, y)) || is_beside_camera(c, i, xyz);
    }
    return count;
}

/* The least difference at a few random depths of the range. Of depths that are equally good it takes the
 * farthest: a point in front of a wall without texture fits the view it is close to, and occludes others. */
static int best_answer(const question *q, sf_rng *rng, float *xyz) {
    int sums[DEPTHS], least = INT_MAX;
    double depths[DEPTHS], farthest = 0;
    float points[DEPTHS][3];
    for (int trial = 0; trial < DEPTHS; trial++) {
        depths[trial] = q->nearest * pow(q->farthest / q->nearest, sf_rng_uniform(rng));
        sums[trial] = answer(q, depths[trial], points[trial]);
        if (sums[trial] < least) least = sums[trial];
    }
    for (int trial = 0; trial < DEPTHS; trial++) {
        if (sums[trial] > least + AS_GOOD || depths[trial] <= farthest) continue;
        farthest = depths[trial];
        memcpy(xyz, points[trial], sizeof points[trial]);
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
        double z = pixel_of(camera, job->cloud->xyz + 3 * k, &x, &y);
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
static void far_point(const cover *c, const question *q, double depth, sf_rng *rng, float *xyz) {
    size_t least = SIZE_MAX;
    for (int trial = 0; trial < FAR_DEPTHS && least; trial++) {
        float p[3];
        double nearness = 1 - (1 - 1.0 / FARTHEST) * sf_rng_uniform(rng);
        behind_pixel(&q->view->camera, q->xs[0], q->ys[0], depth / nearness, p);
        size_t hidden = hides(c, p, least);
        if (hidden < least) least = hidden, memcpy(xyz, p, sizeof p);
    }
}

/* Finds a random pixel of a random view that is neither covered nor masked; returns the view's index, c->n if
 * none was found. */
static size_t random_pixel(const cover *c, sf_rng *rng, size_t *x, size_t *y) {
    for (int trial = 0; trial < TRIALS; trial++) {
        size_t i = (size_t)sf_rng_below(rng, c->n);
        const sf_camera *camera = &c->views[i]->camera;
        *x = (size_t)sf_rng_below(rng, (uint64_t)camera->width);
        *y = (size_t)sf_rng_below(rng, (uint64_t)camera->height);
        if (!(depth_at(c, i, *x, *y) > 0) && counts(c->views[i], *x, *y)) return i;
    }
    return c->n;
}

sf_status sf_random_points(sf_context *ctx, const sf_view *const *views, size_t n, size_t count,
                           double extent, sf_rng *rng, sf_cloud *cloud) {
    const sf_camera **cameras = sf_alloc(ctx, n, sizeof *cameras);
    double *distances = sf_alloc(ctx, n, sizeof *distances);
    cover c = {views, n, sf_calloc(ctx, n, CELLS * CELLS * sizeof *c.depths),
               sf_calloc(ctx, n, sizeof *c.nearest), sf_calloc(ctx, 3 * n, sizeof *c.centers)};
    size_t *open = sf_alloc(ctx, n, sizeof *open);
    sf_status status =
        cameras && distances && c.depths && c.nearest && c.centers && open ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < n; i++) {
            cameras[i] = &views[i]->camera;
            sf_camera_center(cameras[i], c.centers + 3 * i);
        }
        sf_look_distances(cameras, n, extent, distances);
        int known = cloud->n > 0;
        double uncovered = find_cover(ctx->pool, &c, cloud, extent, open);
        size_t wanted = cloud->n + (size_t)((double)count * uncovered), x, y, i;
        for (; cloud->n < wanted && (i = random_pixel(&c, rng, &x, &y)) < n; cloud->n++) {
            question q = ask(views[i], x, y);
            double beside = depth_beside(&c, i, x, y);
            float *xyz = cloud->xyz + 3 * cloud->n;
            if (known) {
                far_point(&c, &q, beside > 0 ? beside : distances[i], rng, xyz);
            } else {
                ask_about(&q, distances[i]);
                ask_anybody(&q, views, n, rng); /* the range of depths is only a guess */
                (void)best_answer(&q, rng, xyz);
            }
            memcpy(cloud->rgb + 3 * cloud->n, q.colors[0], sizeof q.colors[0]);
        }
    }
    sf_free(ctx, open);
    sf_free(ctx, c.centers);
    sf_free(ctx, c.nearest);
    sf_free(ctx, c.depths);
    sf_free(ctx, distances);
    sf_free(ctx, cameras);
    return status;
}

int sf_points_agree(const sf_view *const *views, size_t n, const sf_cloud *cloud) {
    sf_rng rng;
    size_t asked = 0, agree = 0;
    sf_rng_seed(&rng, 1);
    for (int trial = 0; trial < TRIALS && cloud->n; trial++) {
        const float *xyz = cloud->xyz + 3 * sf_rng_below(&rng, cloud->n);
        const sf_view *view = views[sf_rng_below(&rng, n)];
        size_t x, y;
        float at[3];
        double depth = pixel_of(&view->camera, xyz, &x, &y);
        if (!(depth > 0) || !counts(view, x, y)) continue;
        question q = ask(view, x, y);
        ask_about(&q, depth);
        ask_witnesses(&q, views, n, &rng);
        agree += answer(&q, depth, at) <= best_answer(&q, &rng, at) + NO_MATTER;
        asked++;
    }
    return asked < FEWEST_ASKED || (double)agree >= LEAST_AGREE * (double)asked;
}
