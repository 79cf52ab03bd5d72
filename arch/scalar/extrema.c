/* extrema.c - the pixels of a row of differences that no neighbour reaches, in plain C. */
#include "scalar.h"

/* Whether `sign` times the value is above that of those before it and no less than that of those after it. */
static int is_extremum(const sf_extrema_args *a, int x, float sign) {
    float value = sign * a->rows[1][1][x];
    for (int n = 0; n < 27; n++) {
        if (n == 13) continue;
        float other = sign * a->rows[n / 9][n / 3 % 3][x + n % 3 - 1];
        if (n < 13 ? !(value > other) : !(value >= other)) return 0;
    }
    return 1;
}

size_t sf_extrema_scalar(const sf_extrema_args *args) {
    size_t count = 0;
    for (int x = args->first; x < args->end; x++) {
        float value = args->rows[1][1][x];
        if (!(value >= args->threshold || -value >= args->threshold)) continue;
        if (is_extremum(args, x, value > 0 ? 1.0f : -1.0f)) args->columns[count++] = (uint32_t)x;
    }
    return count;
}
