/* codebook.c - see codebook.h: levels for single values. */
#include "codebook.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/statistics.h"

enum { GAPS = 1024, A_GAP = 16 /* values in one, at least */, ROUNDS = 24 };

/* Of n sorted values how many are below x. */
static size_t below(const float *sorted, size_t n, double x) {
    size_t low = 0, high = n;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if ((double)sorted[middle] < x)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The value at the beginning of the g-th of so many gaps. */
static size_t end_of(size_t n, size_t gaps, size_t g) { return (n - 1) * g / gaps; }

/* Few values are levels themselves; 0: there are more. */
static int take_values(const float *sorted, size_t n, double levels[SF_CODEBOOK]) {
    size_t made = 0;
    for (size_t i = 0; i < n; i++) {
        if (i && sorted[i] == sorted[i - 1]) continue;
        if (made == SF_CODEBOOK) return 0;
        levels[made++] = (double)sorted[i];
    }
    for (; made < SF_CODEBOOK; made++) levels[made] = levels[made - 1];
    return 1;
}

/* The mean squared error is least where levels are as dense as the cube root of the values' density: over a
 * gap that holds so many values as each other one it adds up to the gap to the power of 2/3. */
static void begin(const float *sorted, size_t n, double levels[SF_CODEBOOK]) {
    size_t gaps = n / A_GAP < GAPS ? n / A_GAP : GAPS;
    double sum[GAPS + 1] = {0};
    for (size_t g = 0; g < gaps; g++)
        sum[g + 1] =
            sum[g] + pow((double)sorted[end_of(n, gaps, g + 1)] - (double)sorted[end_of(n, gaps, g)], 2. / 3);
    for (size_t k = 0, g = 0; k < SF_CODEBOOK; k++) {
        double wanted = sum[gaps] * ((double)k + 0.5) / SF_CODEBOOK;
        while (g + 1 < gaps && sum[g + 1] < wanted) g++;
        double from = (double)sorted[end_of(n, gaps, g)], to = (double)sorted[end_of(n, gaps, g + 1)];
        levels[k] =
            from + (to - from) * (sum[g + 1] > sum[g] ? (wanted - sum[g]) / (sum[g + 1] - sum[g]) : 0);
    }
}

/* Each level moves to the mean of the values that are nearest to it. before[i]: the sum of the first i. */
static void improve(const float *sorted, const double *before, size_t n, double levels[SF_CODEBOOK]) {
    for (size_t k = 0, first = 0; k < SF_CODEBOOK; k++) {
        size_t end = n;
        if (k + 1 < SF_CODEBOOK) end = below(sorted, n, 0.5 * (levels[k] + levels[k + 1]));
        if (end > first) levels[k] = (before[end] - before[first]) / (double)(end - first);
        if (end > first) first = end;
    }
}

sf_status sf_codebook_make(sf_context *ctx, const float *values, size_t n, float levels[SF_CODEBOOK]) {
    float *sorted = sf_alloc(ctx, n, sizeof *sorted);
    double *before = sf_alloc(ctx, n + 1, sizeof *before), exact[SF_CODEBOOK];
    if (sorted && before) {
        memcpy(sorted, values, n * sizeof *sorted);
        qsort(sorted, n, sizeof *sorted, sf_compare_floats);
        before[0] = 0;
        for (size_t i = 0; i < n; i++) before[i + 1] = before[i] + (double)sorted[i];
        if (!take_values(sorted, n, exact)) {
            begin(sorted, n, exact);
            for (int round = 0; round < ROUNDS; round++) improve(sorted, before, n, exact);
        }
        for (size_t k = 0; k < SF_CODEBOOK; k++) levels[k] = (float)exact[k];
    }
    sf_status status = sorted && before ? SF_OK : SF_ERR_MEMORY;
    sf_free(ctx, sorted);
    sf_free(ctx, before);
    return status;
}

uint8_t sf_codebook_nearest(const float levels[SF_CODEBOOK], float value) {
    size_t above = below(levels, SF_CODEBOOK, (double)value);
    if (above == SF_CODEBOOK) return SF_CODEBOOK - 1;
    if (!above) return 0;
    return (uint8_t)(value - levels[above - 1] <= levels[above] - value ? above - 1 : above);
}
