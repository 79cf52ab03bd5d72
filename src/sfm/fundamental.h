/* fundamental.h - fundamental matrices of point pairs (GEOMETRY.md, S.13).
 *
 * b^T F a = 0 for pairs a, b [count][2]. The coordinates should be of the order of 1: pixels from the middle
 * of the picture, divided by its size or by a focal length.
 */
#ifndef SF_SFM_FUNDAMENTAL_H
#define SF_SFM_FUNDAMENTAL_H

#include <stddef.h>
#include <stdint.h>

enum { SF_FUNDAMENTAL_MOST = 3 };

/* The fundamental matrices of norm 1 that seven pairs agree with; sample[7]: which. Returns how many. */
int sf_fundamental_from_7(const double *a, const double *b, const uint32_t sample[7],
                          double F[9 * SF_FUNDAMENTAL_MOST]);

/* The one of least squares of the algebraic error over all pairs, in Hartley's normalised coordinates, with
 * weights [count] (NULL: all 1), of rank 2. 0: fewer than 8 pairs with a weight, or all at one place. */
int sf_fundamental_from_8(const double *a, const double *b, const double *weights, size_t count, double F[9]);

/* sf_fundamental_from_8 with the weights that make the algebraic error Sampson's distance, around F, `rounds`
 * times, over the pairs whose weights [count] are not 0; the weights are overwritten. 0: as above. */
int sf_fundamental_refine(const double *a, const double *b, double *weights, size_t count, int rounds,
                          double F[9]);

#endif
