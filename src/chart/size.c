/* size.c - the runs of a scene by the size of their models: series, the knee. */
#include "chart.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Numbers of Gaussians this near to each other are one (seeds of a cap). */
#define NEAR_IN_SIZE 1.02

static int by_size(const void *a, const void *b) {
    const chart_size_point *x = a, *y = b;
    return (x->size[CHART_GAUSSIANS] > y->size[CHART_GAUSSIANS]) -
           (x->size[CHART_GAUSSIANS] < y->size[CHART_GAUSSIANS]);
}

static chart_size_point point_of(const chart_run *run) {
    const chart_point *end = &run->points[run->count - 1];
    chart_size_point p = {.size = {run->gaussians, run->bytes}, .runs = 1};
    for (int m = 0; m < CHART_METRICS; m++) {
        p.quality[m] = p.least[m] = p.most[m] = end->quality[m];
        p.train[m] = run->train[m];
    }
    return p;
}

/* Adds a run's point to one that holds others. */
static void merge(chart_size_point *p, const chart_size_point *other) {
    double n = (double)p->runs;
    int unknown = p->size[CHART_BYTES] == 0 || other->size[CHART_BYTES] == 0;
    for (int s = 0; s < CHART_SIZES; s++) p->size[s] += (other->size[s] - p->size[s]) / (n + 1);
    if (unknown) p->size[CHART_BYTES] = 0;
    for (int m = 0; m < CHART_METRICS; m++) {
        p->quality[m] += (other->quality[m] - p->quality[m]) / (n + 1);
        p->train[m] += (other->train[m] - p->train[m]) / (n + 1);
        p->least[m] = fmin(p->least[m], other->least[m]);
        p->most[m] = fmax(p->most[m], other->most[m]);
    }
    p->runs++;
}

static size_t merge_near(chart_size_point *points, size_t count) {
    size_t kept = 0;
    for (size_t i = 0; i < count; i++) {
        chart_size_point *last = kept ? &points[kept - 1] : NULL;
        if (last && points[i].size[CHART_GAUSSIANS] <= NEAR_IN_SIZE * last->size[CHART_GAUSSIANS])
            merge(last, &points[i]);
        else
            points[kept++] = points[i];
    }
    return kept;
}

sf_status chart_sizes_make(const chart_input *input, const chart_run *first, chart_sizes *sizes) {
    *sizes = (chart_sizes){.input = input, .first = first};
    for (int s = CHART_CAPS; s < CHART_SERIES; s++) {
        chart_size_point *points = sf_calloc(input->ctx, input->run_count, sizeof *points);
        if (!points) {
            chart_sizes_free(sizes);
            return SF_ERR_MEMORY;
        }
        size_t n = 0;
        for (size_t i = 0; i < input->run_count; i++) {
            const chart_run *run = &input->runs[i];
            if ((int)run->series == s && run->gaussians > 0 && chart_same_scene(run, first))
                points[n++] = point_of(run);
        }
        qsort(points, n, sizeof *points, by_size);
        sizes->points[s] = points;
        sizes->count[s] = merge_near(points, n);
    }
    return SF_OK;
}

void chart_sizes_free(chart_sizes *sizes) {
    for (int s = 0; s < CHART_SERIES; s++) sf_free(sizes->input->ctx, sizes->points[s]);
    memset(sizes->points, 0, sizeof sizes->points);
    memset(sizes->count, 0, sizeof sizes->count);
}

/* Points of known size; the automatic choice alone is no sweep. */
int chart_sizes_known(const chart_sizes *sizes, chart_size size) {
    int known = 0, sweep = 0;
    for (int s = CHART_CAPS; s < CHART_SERIES; s++)
        for (size_t i = 0; i < sizes->count[s]; i++) {
            known += sizes->points[s][i].size[size] > 0;
            sweep |= s != CHART_AUTO;
        }
    return known > 1 && sweep;
}

int chart_gap_known(const chart_sizes *sizes) {
    int known = 0;
    for (int s = CHART_CAPS; s < CHART_SERIES; s++)
        for (size_t i = 0; i < sizes->count[s]; i++) known += isfinite(sizes->points[s][i].train[CHART_PSNR]);
    return known > 1;
}

double chart_knee(const chart_sizes *sizes, chart_size size, double *plateau) {
    const chart_size_point *points = sizes->points[CHART_CAPS], *below = NULL;
    size_t known = 0;
    *plateau = -INFINITY;
    for (size_t i = 0; i < sizes->count[CHART_CAPS]; i++) {
        if (!(points[i].size[size] > 0)) continue;
        *plateau = fmax(*plateau, points[i].quality[CHART_PSNR]);
        known++;
    }
    double target = *plateau - CHART_KNEE;
    for (size_t i = 0; i < sizes->count[CHART_CAPS] && known > 1; i++) {
        const chart_size_point *p = &points[i];
        if (!(p->size[size] > 0)) continue;
        if (p->quality[CHART_PSNR] >= target) {
            if (!below) return p->size[size];
            double low = below->quality[CHART_PSNR], share = (target - low) / (p->quality[CHART_PSNR] - low);
            return below->size[size] * pow(p->size[size] / below->size[size], share);
        }
        below = p;
    }
    return 0;
}
