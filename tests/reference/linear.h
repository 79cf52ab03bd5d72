/* linear.h - vectors of three and small row-major matrices, for the float64 reference. */
#ifndef TESTS_REFERENCE_LINEAR_H
#define TESTS_REFERENCE_LINEAR_H

static inline double dot3(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross3(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* A matrix, or the transpose of one, as a factor of a product. */
typedef struct factor {
    const double *m;
    int rows, columns, row_step, column_step;
} factor;

static inline factor plain(const double *m, int rows, int columns) {
    return (factor){m, rows, columns, columns, 1};
}

/* The transpose of the matrix stored as rows x columns. */
static inline factor transposed(const double *m, int rows, int columns) {
    return (factor){m, columns, rows, 1, columns};
}

/* out = a b; out overlaps neither. */
static inline void multiply(factor a, factor b, double *out) {
    for (int i = 0; i < a.rows; i++)
        for (int j = 0; j < b.columns; j++) {
            double sum = 0;
            for (int k = 0; k < a.columns; k++)
                sum += a.m[i * a.row_step + k * a.column_step] * b.m[k * b.row_step + j * b.column_step];
            out[i * b.columns + j] = sum;
        }
}

#endif
