/* localize.h - where between the pixels a difference of Gaussians is greatest (README.md, S.3). */
#ifndef SF_SFM_LOCALIZE_H
#define SF_SFM_LOCALIZE_H

/* The differences about a pixel. */
typedef struct sf_cube {
    const float *row[3][3]; /* finer, same, coarser; above, at, below: each at the pixel's column */
} sf_cube;

typedef struct sf_extremum {
    double offset[3]; /* from the pixel: along the row, down, in scales */
    double value;     /* of the difference there */
    double edge;      /* (a + b)^2 / (a b) of the principal curvatures a, b; below 0: of different signs */
} sf_extremum;

/* 0: no quadratic has an extremum there. */
int sf_localize(const sf_cube *cube, sf_extremum *extremum);

#endif
