/* statistics.h - order statistics. */
#ifndef SF_BASE_STATISTICS_H
#define SF_BASE_STATISTICS_H

#include <stddef.h>

/* The value at index `rank` (0 .. n-1) of the n values in ascending order, and the value at index n / 2; 0 if
 * n is 0. By Hoare's selection, in time O(n): both reorder the values. */
double sf_ranked(double *values, size_t n, size_t rank);
double sf_median(double *values, size_t n);
float sf_rankedf(float *values, size_t n, size_t rank);
float sf_medianf(float *values, size_t n);

/* For qsort: ascending doubles, ascending floats. */
int sf_compare_doubles(const void *a, const void *b);
int sf_compare_floats(const void *a, const void *b);

#endif
