/* scene_center.c - whether a model surrounds an empty center, as a room does, or fills it, as an object does.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "camera_path.h"

/* Gaussians of a lower opacity are ignored. */
#define VISIBLE 0.1f
/* Within half the median distance lie 6 % of a solid ball, but nothing of a room's walls. */
#define MOST_INSIDE 0.02
/* Of all Gaussians, in each of the sectors that walls stand in. */
#define LEAST_IN_SECTOR 0.02
enum { SECTORS = 8, LEAST = 64, AXES = 3 };

/* The visible means, and one value of each. */
typedef struct cloud {
    float *means, *values;
    size_t count;
} cloud;

static int rising(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static float quantile(const cloud *c, double part) {
    return c->values[(size_t)(part * (double)(c->count - 1))];
}

static void keep_visible(cloud *c, const float *logits) {
    size_t kept = 0;
    for (size_t i = 0; i < c->count; i++) {
        if (!(1 / (1 + expf(-logits[i])) > VISIBLE)) continue;
        memmove(c->means + AXES * kept++, c->means + AXES * i, AXES * sizeof *c->means);
    }
    c->count = kept;
}

/* Half way between what lies outermost, but for the last in twenty: a room's floor may hold most of it. */
static void find_center(const cloud *c, double center[3]) {
    for (size_t k = 0; k < AXES; k++) {
        for (size_t i = 0; i < c->count; i++) c->values[i] = c->means[AXES * i + k];
        qsort(c->values, c->count, sizeof *c->values, rising);
        center[k] = 0.5 * (double)(quantile(c, 0.05) + quantile(c, 0.95));
    }
}

/* How far from `at` a mean lies, and in which sector about up; -1: above or below. */
static double look_from(const double at[3], const float *mean, const double up[3], const double ahead[3],
                        const double side[3], int *sector) {
    double r = 0, high = 0, x = 0, y = 0;
    for (int k = 0; k < AXES; k++) {
        double d = (double)mean[k] - at[k];
        r += d * d, high += d * up[k], x += d * side[k], y -= d * ahead[k];
    }
    r = sqrt(r);
    int turn = (int)floor((atan2(y, x) / 6.283185307179586 + 0.5) * SECTORS);
    *sector = fabs(high) < 0.7 * r ? turn % SECTORS : -1;
    return r;
}

static int is_around(const cloud *c, const double at[3], const double up[3], const double ahead[3],
                     const double side[3]) {
    size_t in[SECTORS] = {0}, inside = 0;
    int sector;
    for (size_t i = 0; i < c->count; i++) {
        c->values[i] = (float)look_from(at, c->means + AXES * i, up, ahead, side, &sector);
        if (sector >= 0) in[sector]++;
    }
    qsort(c->values, c->count, sizeof *c->values, rising);
    while (inside < c->count && c->values[inside] < 0.5f * quantile(c, 0.5)) inside++;
    if ((double)inside > MOST_INSIDE * (double)c->count) return 0;
    for (int i = 0; i < SECTORS; i++)
        if ((double)in[i] < LEAST_IN_SECTOR * (double)c->count) return 0;
    return 1;
}

/* The medians, else the center of the extent. */
static int decide(const cloud *c, const double up[3], const double ahead[3], const double side[3],
                  double center[3]) {
    double other[3];
    if (c->count < LEAST) return 0;
    if (is_around(c, center, up, ahead, side)) return 1;
    find_center(c, other);
    if (!is_around(c, other, up, ahead, side)) return 0;
    memcpy(center, other, sizeof other);
    return 1;
}

int camera_path_find_center(const args *a, sf_context *ctx, const sf_model *model,
                            const double *const axes[3], double center[3], int *around) {
    size_t n = sf_model_count(model);
    float *values = malloc((AXES + 2) * (n + 1) * sizeof *values);
    *around = 0;
    if (!values) return app_say(a, "orbit", "out of memory");
    cloud c = {.means = values, .values = values + AXES * n, .count = n};
    float *logits = c.values + n;
    const sf_gaussians g = {.means = c.means, .logit_opacities = logits};
    int error = sf_model_get(model, 0, n, &g) ? app_fail(a, ctx) : 0;
    if (!error) {
        keep_visible(&c, logits);
        *around = decide(&c, axes[0], axes[1], axes[2], center);
    }
    free(values);
    return error;
}
