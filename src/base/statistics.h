/* statistics.h - order statistics, means of boxes of bytes, lines of least squares. */
#ifndef SF_BASE_STATISTICS_H
#define SF_BASE_STATISTICS_H

#include <stddef.h>
#include <stdint.h>

/* The value at index `rank` (0 .. n-1) of the n values in ascending order, and the value at index n / 2; 0 if
 * n is 0. By Hoare's selection, in time O(n): both reorder the values. */
double sf_ranked(double *values, size_t n, size_t rank);
double sf_median(double *values, size_t n);
float sf_rankedf(float *values, size_t n, size_t rank);
float sf_medianf(float *values, size_t n);

/* For qsort: ascending doubles, ascending floats. */
int sf_compare_doubles(const void *a, const void *b);
int sf_compare_floats(const void *a, const void *b);

/* The mean, rounded, of side x side bytes: `step` bytes from one to the next in a row, `row` bytes from row
 * to row. side is 1..4096. */
static inline uint8_t sf_box_mean(const uint8_t *corner, size_t side, size_t step, size_t row) {
    uint32_t area = (uint32_t)(side * side), sum = area / 2;
    for (size_t v = 0; v < side; v++)
        for (size_t u = 0; u < side; u++) sum += corner[v * row + u * step];
    return (uint8_t)(sum / area);
}

/* Sums over pairs (x, y) of their weights w, w x, w y, w x x, w x y. */
typedef struct sf_line_sums {
    double w, x, y, xx, xy;
} sf_line_sums;

/* The line y = gain x + bias of least squares. Where w^2 times the variance of x is at most least_spread, x
 * says nothing of a gain: it is 1. Without weight the bias is 0. */
void sf_line_fit(const sf_line_sums *sums, double least_spread, double *gain, double *bias);

#endif
