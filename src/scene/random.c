/* random.c - random points: a pixel that no point covers, a depth that other views have nothing against. */
#include "random.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "neighbours.h"

enum {
    AROUND = 5,            /* pixels that stand for a point's surroundings */
    SPREAD = 120,          /* of the longest side: how far they are apart */
    DEPTHS = 20,           /* of a point, to choose from */
    LOOKS = 8,             /* views that are asked about its colour */
    MOST_DIFFERENCE = 120, /* of two colours, the sum over the channels, of 3 x 255 */
    CELLS = 24,            /* across and down a picture: what a point in them covers */
    TRIALS = 1000,         /* pixels drawn for one that is not covered; points that are asked about */
    FEWEST_ASKED = 50,     /* of them that a picture has, to judge by */
    NO_MATTER = 3 * 2 * AROUND * LOOKS, /* a difference that no depth is better for: 2 levels a value */
    AS_GOOD = NO_MATTER * 3 / 4,        /* one that says nothing of two depths */
};
#define LEAST_AGREE 0.2 /* of the points: at random it is a twentieth */

/* The pixel that shows a point; 0 if none does. */
static int pixel_of(const sf_camera *c, const float *xyz, size_t *x, size_t *y) {
    double q[3];
    for (int i = 0; i < 3; i++) {
        q[i] = c->t_cw[i];
        for (int k = 0; k < 3; k++) q[i] += c->R_cw[3 * i + k] * (double)xyz[k];
    }
    double u = c->fx * q[0] / q[2] + c->cx, v = c->fy * q[1] / q[2] + c->cy;
    if (!(q[2] > 0 && u >= 0 && u < c->width && v >= 0 && v < c->height)) return 0;
    *x = (size_t)u, *y = (size_t)v;
    return 1;
}

/* The world point at `depth` behind a pixel. */
static void behind_pixel(const sf_camera *c, size_t x, size_t y, double depth, float *xyz) {
    double p[3] = {((double)x + 0.5 - c->cx) / c->fx * depth - c->t_cw[0],
                   ((double)y + 0.5 - c->cy) / c->fy * depth - c->t_cw[1], depth - c->t_cw[2]};
    for (int k = 0; k < 3; k++)
        xyz[k] = (float)(c->R_cw[k] * p[0] + c->R_cw[3 + k] * p[1] + c->R_cw[6 + k] * p[2]);
}

/* Whether a pixel counts: what a mask hides is of no scene. */
static int counts(const sf_view *view, size_t x, size_t y) {
    return !view->weight || view->weight[y * (size_t)view->camera.width + x] > 0;
}

static void color_at(const sf_view *view, size_t x, size_t y, uint8_t *rgb) {
    size_t width = (size_t)view->camera.width, pixels = width * (size_t)view->camera.height;
    for (size_t k = 0; k < 3; k++) rgb[k] = view->rgb[k * pixels + y * width + x];
}

/* How much the colour differs from the one that a view has there, at most MOST_DIFFERENCE (something may hide
 * the point), which is also for a point that it does not show. */
static int difference(const sf_view *view, const float *xyz, const uint8_t *rgb) {
    size_t x, y;
    uint8_t there[3];
    int sum = 0;
    if (!pixel_of(&view->camera, xyz, &x, &y) || !counts(view, x, y)) return MOST_DIFFERENCE;
    color_at(view, x, y, there);
    for (int k = 0; k < 3; k++) sum += abs((int)there[k] - (int)rgb[k]);
    return sum < MOST_DIFFERENCE ? sum : MOST_DIFFERENCE;
}

static size_t clamped(int at, int size) { return (size_t)(at < 0 ? 0 : at < size ? at : size - 1); }

/* A pixel and a few about it, and other views that are asked about their colours. */
typedef struct question {
    const sf_view *view, *others[LOOKS];
    size_t xs[AROUND], ys[AROUND];
    uint8_t colors[AROUND][3];
    double distance; /* of what the view looks at, world units */
} question;

static question ask(const sf_view *const *views, size_t n, const sf_view *view, size_t x, size_t y,
                    double distance, sf_rng *rng) {
    static const int across[AROUND] = {0, 1, -1, 0, 0}, down[AROUND] = {0, 0, 0, 1, -1};
    const sf_camera *c = &view->camera;
    question q = {.view = view, .distance = distance};
    int step = 1 + (c->width > c->height ? c->width : c->height) / SPREAD;
    for (int i = 0; i < AROUND; i++) {
        q.xs[i] = clamped((int)x + step * across[i], c->width);
        q.ys[i] = clamped((int)y + step * down[i], c->height);
        if (!counts(view, q.xs[i], q.ys[i]))
            q.xs[i] = x, q.ys[i] = y; /* nothing is asked about what is masked */
        color_at(view, q.xs[i], q.ys[i], q.colors[i]);
    }
    for (int k = 0; k < LOOKS; k++) q.others[k] = views[sf_rng_below(rng, n)];
    return q;
}

/* How much the colours differ from those that the others have at a depth, where the point is then. */
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

/* The least difference at a few random depths, from a third to three times the distance. Of depths that are
 * as good the point is at the farthest: what hangs before a wall without texture pleases the one view that it
 * is near to, and stands in the way of others. */
static int best_answer(const question *q, sf_rng *rng, float *xyz) {
    int sums[DEPTHS], least = INT_MAX;
    double depths[DEPTHS], farthest = 0;
    float points[DEPTHS][3];
    for (int trial = 0; trial < DEPTHS; trial++) {
        depths[trial] = q->distance * pow(9, sf_rng_uniform(rng)) / 3;
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

static size_t cell_of(const sf_camera *c, size_t x, size_t y) {
    return y * CELLS / (size_t)c->height * CELLS + x * CELLS / (size_t)c->width;
}

/* Marks the cells [n][CELLS][CELLS] in which the cloud has a point; returns the share of those without. */
static double cover(const sf_view *const *views, size_t n, const sf_cloud *cloud, uint8_t *covered) {
    size_t open = 0, cells = n * CELLS * CELLS, x, y;
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < cloud->n; k++)
            if (pixel_of(&views[i]->camera, cloud->xyz + 3 * k, &x, &y))
                covered[i * CELLS * CELLS + cell_of(&views[i]->camera, x, y)] = 1;
    for (size_t i = 0; i < cells; i++) open += !covered[i];
    return (double)open / (double)cells;
}

/* A random pixel of a random view that is neither covered nor masked; 0 if none was found. */
static int random_pixel(const sf_view *const *views, size_t n, const uint8_t *covered, sf_rng *rng,
                        const sf_view **view, size_t *x, size_t *y) {
    for (int trial = 0; trial < TRIALS; trial++) {
        size_t i = (size_t)sf_rng_below(rng, n);
        const sf_camera *c = &views[i]->camera;
        *x = (size_t)sf_rng_below(rng, (uint64_t)c->width);
        *y = (size_t)sf_rng_below(rng, (uint64_t)c->height);
        *view = views[i];
        if (!covered[i * CELLS * CELLS + cell_of(c, *x, *y)] && counts(*view, *x, *y)) return 1;
    }
    return 0;
}

sf_status sf_random_points(sf_context *ctx, const sf_view *const *views, size_t n, size_t count,
                           double extent, sf_rng *rng, sf_cloud *cloud) {
    const sf_camera **cameras = sf_alloc(ctx, n, sizeof *cameras);
    uint8_t *covered = sf_calloc(ctx, n, CELLS * CELLS);
    sf_status status = cameras && covered ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        double focus[3];
        for (size_t i = 0; i < n; i++) cameras[i] = &views[i]->camera;
        sf_focus_point(cameras, n, focus);
        size_t wanted = cloud->n + (size_t)((double)count * cover(views, n, cloud, covered)), x, y;
        const sf_view *view;
        for (; cloud->n < wanted && random_pixel(views, n, covered, rng, &view, &x, &y); cloud->n++) {
            question q = ask(views, n, view, x, y, sf_look_distance(&view->camera, focus, extent), rng);
            best_answer(&q, rng, cloud->xyz + 3 * cloud->n);
            memcpy(cloud->rgb + 3 * cloud->n, q.colors[0], sizeof q.colors[0]);
        }
    }
    sf_free(ctx, covered);
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
        const double *R = view->camera.R_cw + 6;
        double depth = view->camera.t_cw[2];
        size_t x, y;
        float at[3];
        if (!pixel_of(&view->camera, xyz, &x, &y) || !counts(view, x, y)) continue;
        for (int k = 0; k < 3; k++) depth += R[k] * (double)xyz[k];
        question q = ask(views, n, view, x, y, depth, &rng);
        agree += answer(&q, depth, at) <= best_answer(&q, &rng, at) + NO_MATTER;
        asked++;
    }
    return asked < FEWEST_ASKED || (double)agree >= LEAST_AGREE * (double)asked;
}
