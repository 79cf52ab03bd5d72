/* golden.h - a golden case (README.md) in memory. */
#ifndef TESTS_GOLDEN_H
#define TESTS_GOLDEN_H

#include "../reference/reference.h"
#include "../testing.h"

typedef struct test_golden {
    char name[64];
    int long_needles; /* of that kind: its picture has a wider bound */
    test_ref_scene scene;
    double lambda;
    double *target; /* [H][W][3] */

    /* what must come out */
    double *image, *transmittance, *depth; /* [H][W][3], [H][W], [H][W] */
    double loss, l1, ssim;
    uint64_t contributing_pairs;
    double *visible; /* [n]: 1 or 0; the next ones mean something only where it is 1 */
    double *camera_points, *means2d, *cov2d, *conics, *rgb; /* [n][3], [n][2], [n][3], [n][3], [n][3] */
    double *d_image;                                        /* [H][W][3] */
    test_ref_grads gradient;                                /* but for the background's */
} test_golden;

/* Reads a case. A file that is not one fails the test in progress, with the key at fault. */
void test_golden_load(const char *path, test_golden *golden);
void test_golden_free(test_golden *golden);

/* A test for every *.json in the folder: tests/golden, or what SPLATFIT_GOLDEN names. `run` finds the path of
 * its case in *state. A folder with no case, or that is none, gives one test, which fails. Returns their
 * number. */
size_t test_golden_list(CMUnitTestFunction run, const char *prefix, struct CMUnitTest **tests);
void test_golden_list_free(struct CMUnitTest *tests, size_t count);

/* The largest |got - expected| over `rows` of `width`, those left out where `used` (may be NULL) is 0. NaN
 * counts as infinite. */
typedef struct test_rows {
    size_t rows, width;
    const double *used;
} test_rows;
double test_golden_worst(test_rows rows, const double *got, const double *expected);
/* The largest |value| of the same. */
double test_golden_largest(test_rows rows, const double *values);

#endif
