/* bundle_equations.h - the inside of a bundle adjustment: its normal equations, in blocks (README, P.9). */
#ifndef SF_POSE_BUNDLE_EQUATIONS_H
#define SF_POSE_BUNDLE_EQUATIONS_H

#include "bundle.h"

enum {
    SF_BUNDLE_GROUPS = 16, /* of points: each sums up on its own; the sums of all are added in their order */
    SF_BUNDLE_ROWS = 8,    /* of views: filled in together, at most */
    SF_BUNDLE_CROSS = 3 * SF_TWIST,
    SF_BUNDLE_LENS_CROSS = 3 * SF_LENS_PARAMETERS
};

/* The columns of a camera's free parameters. */
typedef struct sf_bundle_columns {
    int count, is_tied;            /* fy moves with fx: */
    double aspect;                 /* fy / fx */
    int which[SF_LENS_PARAMETERS]; /* in the order of sf_lens */
    size_t first;                  /* the first one's place among all cameras' columns */
} sf_bundle_columns;

/* What is kept of one point for the way back: with V = L L^T of its sums and g its gradient, y = L^-1 g. */
typedef struct sf_bundle_point_sums {
    double L[6], y[3]; /* L: rows of the lower triangle */
} sf_bundle_point_sums;

/* Sums over the observations of a view, and of a camera. */
typedef struct sf_bundle_view_sums {
    double U[SF_TWIST * SF_TWIST], e[SF_TWIST], lens[SF_TWIST * SF_LENS_PARAMETERS];
} sf_bundle_view_sums;

typedef struct sf_bundle_camera_sums {
    double U[SF_LENS_PARAMETERS * SF_LENS_PARAMETERS], e[SF_LENS_PARAMETERS];
} sf_bundle_camera_sums;

/* The observations of one point through one camera. */
typedef struct sf_bundle_slot {
    uint32_t camera, point;
    double Z[SF_BUNDLE_LENS_CROSS]; /* sum of lens by point, times L^-T: [8][3] */
} sf_bundle_slot;

/* An observation of a view, and what else saw its point: all that a row of the equations reads from. */
typedef struct sf_bundle_row_entry {
    uint32_t observation, point;
    uint32_t first, end; /* first..end-1: the observations of the point, up to the last one of the row */
} sf_bundle_row_entry;

/* Where which rows of the reduced equations are: blocks [6][6] of views and views, row by row, each row's
 * columns ascending up to its own; rows of the lens columns by views; lens columns by lens columns. */
typedef struct sf_bundle_equations {
    size_t rows;           /* free views */
    size_t *begin;         /* [rows + 1]: each row's first block */
    uint32_t *column;      /* [blocks] */
    double *blocks;        /* [blocks][36] */
    size_t lens_columns;   /* of all cameras */
    double *border;        /* [rows][lens_columns][6] */
    double *corner;        /* [lens_columns][lens_columns], lower triangle */
    double *g;             /* [6 rows + lens_columns]: the gradient; after solving, the step */
    uint32_t *table;       /* [threads][SF_BUNDLE_ROWS][rows]: the blocks of the rows at work, by column */
    double *dense, *panel; /* [n][n] and scratch of Cholesky, n padded; NULL where the solver iterates */
    double *vectors;       /* the iterating solver's */
    size_t *upper_begin;   /* [rows + 1], and */
    uint32_t *upper;       /* [blocks]: those blocks in which a view is the column, */
    uint32_t *upper_row;   /* [blocks]: and their rows */
} sf_bundle_equations;

typedef struct sf_bundle_work {
    sf_context *ctx;
    const sf_bundle *b;
    size_t *rank; /* [views]: among the free ones, SIZE_MAX of others */
    size_t free_count;
    uint32_t *rank_of;            /* [observations]: of their views, UINT32_MAX: of one that is not free */
    size_t *view_of;              /* [free] */
    size_t *first;                /* [points + 1]: each one's first observation */
    sf_bundle_row_entry *of_view; /* [observations]: those of the free views, by view; */
    size_t *from;                 /* [free + 2]: each one's first there */
    sf_bundle_columns *columns;   /* [cameras] */
    sf_bundle_slot *slots;        /* by point; none without lens columns */
    size_t *first_slot;           /* [points + 1] */
    uint32_t *slot_of;            /* [observations] */
    size_t *camera_slots, *camera_from; /* [slots], [cameras + 2]: the slots by camera */
    double (*Z)[SF_BUNDLE_CROSS];       /* [observations]: pose by point, times L^-T, [3][6] */
    sf_bundle_point_sums *sums;         /* [points] */
    sf_bundle_view_sums *view_sums;     /* [groups][free] */
    sf_bundle_camera_sums *camera_sums; /* [groups][cameras] */
    sf_bundle_equations eq;
    sf_rigid *poses;           /* [views], */
    sf_bundle_camera *cameras; /* [cameras] and */
    double *at;                /* [2][points][3]: at first, and before the step */
    double *distances;         /* [observations], px, */
    double *finite;            /* and those that are finite, for their median */
    double spread, damp;
} sf_bundle_work;

/* All memory of `ctx` and `b`, the observations sorted. 0: no memory. sf_bundle_work_free in any case. */
int sf_bundle_work_make(sf_bundle_work *a);
void sf_bundle_work_free(sf_bundle_work *a);

/* The pattern of the blocks, and their memory. 0: no memory. */
int sf_bundle_equations_make(sf_bundle_work *a);
void sf_bundle_equations_free(sf_context *ctx, sf_bundle_equations *eq);

/* Fills in the equations, with the points taken out, at the present poses, points and lenses, damped. */
void sf_bundle_equations_fill(sf_bundle_work *a);

/* Solves them: g becomes the step. 0: it cannot. */
int sf_bundle_equations_solve(sf_context *ctx, sf_bundle_equations *eq);

/* A parameter of a lens by its place in sf_lens, 0..7. */
double *sf_bundle_parameter(sf_lens *lens, int which);

#endif
