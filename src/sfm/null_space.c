/* null_space.c - see null_space.h. */
#include "null_space.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { WIDTH = 9 };

/* x -= 2 v (v.x) from entry `from` on, for a unit vector v. */
static void reflect(const double *v, int from, double *x) {
    double sum = 0;
    for (int i = from; i < WIDTH; i++) sum += v[i] * x[i];
    for (int i = from; i < WIDTH; i++) x[i] -= 2 * sum * v[i];
}

void sf_null_space(int m, double *A, double *N) {
    double turns[8][WIDTH];
    for (int k = 0; k < m; k++) {
        double *v = turns[k], *row = A + WIDTH * k, squares = 0;
        memcpy(v, row, sizeof turns[k]);
        for (int i = k; i < WIDTH; i++) squares += row[i] * row[i];
        v[k] += row[k] < 0 ? -sqrt(squares) : sqrt(squares);
        squares = 0;
        for (int i = k; i < WIDTH; i++) squares += v[i] * v[i];
        for (int i = k; i < WIDTH; i++) v[i] = squares > 0 ? v[i] / sqrt(squares) : 0;
        for (int i = k + 1; i < m; i++) reflect(v, k, A + WIDTH * i);
    }
    for (int j = m; j < WIDTH; j++) {
        double *row = N + (size_t)WIDTH * (size_t)(j - m);
        for (int i = 0; i < WIDTH; i++) row[i] = i == j;
        for (int k = m; k--;) reflect(turns[k], k, row);
    }
}
