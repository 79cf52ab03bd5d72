/* null_space.h - the null space of a few rows of nine. */
#ifndef SF_SFM_NULL_SPACE_H
#define SF_SFM_NULL_SPACE_H

/* Orthonormal rows N [9 - m][9] at right angles to the rows of A [m][9], m = 1..8, which is destroyed
 * (Householder). Where the rows of A depend on each other, N is only a part of their null space. */
void sf_null_space(int m, double *A, double *N);

#endif
