/* statistics.c - order statistics, lines of least squares. */
#include "statistics.h"

/* Each round parts the values from `first` to `last` by a pivot, and goes on with the part that holds `rank`.
 */
#define DEFINE_RANKED(type, name)                                                                            \
    type name(type *values, size_t n, size_t rank) {                                                         \
        size_t first = 0, last = n ? n - 1 : 0;                                                              \
        while (first < last) {                                                                               \
            type pivot = values[first + (last - first) / 2];                                                 \
            size_t i = first, j = last;                                                                      \
            for (;;) {                                                                                       \
                while (values[i] < pivot) i++;                                                               \
                while (pivot < values[j]) j--;                                                               \
                if (i >= j) break;                                                                           \
                type kept = values[i];                                                                       \
                values[i++] = values[j];                                                                     \
                values[j--] = kept;                                                                          \
            }                                                                                                \
            if (j < rank || (j == rank && i == rank)) first = j < rank ? j + 1 : rank;                       \
            if (i > rank || (j == rank && i == rank)) last = i > rank ? i - 1 : rank;                        \
        }                                                                                                    \
        return n ? values[rank] : 0;                                                                         \
    }

DEFINE_RANKED(double, sf_ranked)
DEFINE_RANKED(float, sf_rankedf)

double sf_median(double *values, size_t n) { return sf_ranked(values, n, n / 2); }
float sf_medianf(float *values, size_t n) { return sf_rankedf(values, n, n / 2); }

int sf_compare_doubles(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int sf_compare_floats(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

void sf_line_fit(const sf_line_sums *s, double least_spread, double *gain, double *bias) {
    double spread = s->w * s->xx - s->x * s->x;
    *gain = spread > least_spread ? (s->w * s->xy - s->x * s->y) / spread : 1;
    *bias = s->w > 0 ? (s->y - *gain * s->x) / s->w : 0;
}
