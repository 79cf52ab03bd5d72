/* coverage.h - cells of the scene: from how many sides the training keyframes see each, and how well the
 * model shows it there.
 *
 * Cells are cubes of one size on a grid. A keyframe sees those in which the pixels of its depth map lie. What
 * each keyframe sees is kept, so that it can be replaced when its pose or the model has changed, or taken out
 * when the keyframe goes.
 */
#ifndef SF_LIVE_COVERAGE_H
#define SF_LIVE_COVERAGE_H

#include <splatfit/live.h>

#include "../base/context.h"

enum {
    SF_COVERAGE_SECTORS = 14,  /* directions: those of a cube's 6 faces and 8 corners */
    SF_COVERAGE_MOST = 1 << 16 /* cells; what lies outside them is not counted */
};

/* All sums are over the keyframes that see the cell. */
typedef struct sf_coverage_cell {
    int32_t at[3]; /* its lowest corner, in cells from 0 */
    uint32_t views, pixels;
    uint16_t sectors[SF_COVERAGE_SECTORS]; /* keyframes, by the direction that they see it from */
    double direction[3];                   /* of unit vectors towards the cameras */
    double error;                          /* of mean errors */
} sf_coverage_cell;

/* A keyframe's share of a cell. */
typedef struct sf_coverage_share {
    uint32_t cell, pixels;
    float direction[3], error;
} sf_coverage_share;

/* What a keyframe sees. */
typedef struct sf_coverage_view {
    uint32_t id;
    sf_coverage_share *shares;
    size_t count, capacity;
} sf_coverage_view;

typedef struct sf_coverage {
    sf_context *ctx;
    double side, far; /* world units: of a cell; pixels farther off are not counted */
    sf_coverage_cell *cells;
    size_t count, capacity;
    uint32_t *table; /* [table_size], open addressing: cell + 1, 0: free */
    size_t table_size;
    sf_coverage_view *views;
    size_t view_count, view_capacity;
    int has_worst;
    size_t worst; /* cell */
} sf_coverage;

/* Of a view's pixels, [height][width]; depth 0: nothing is seen there. */
typedef struct sf_depth_map {
    const sf_camera *camera;
    const float *depth; /* z, world units */
    const float *error; /* 0..1 */
} sf_depth_map;

/* Forgets all; cells have this side from now on. */
void sf_coverage_clear(sf_coverage *coverage, double side, double far);
void sf_coverage_free(sf_coverage *coverage);

/* Notes what keyframe `id` sees, in place of what it saw before. SF_ERR_MEMORY: it sees nothing. */
sf_status sf_coverage_see(sf_coverage *coverage, uint32_t id, const sf_depth_map *map);
/* Takes the keyframe out, if it is in. */
void sf_coverage_drop(sf_coverage *coverage, uint32_t id);
int sf_coverage_has(const sf_coverage *coverage, uint32_t id);

/* The cell at a place; NULL: there is none, or nobody sees it any more. */
const sf_coverage_cell *sf_coverage_at(const sf_coverage *coverage, const double place[3]);
/* Where the pixel's ray is at that depth. */
void sf_coverage_place(const sf_camera *camera, int x, int y, double depth, double place[3]);

/* Fills in what is told of a cell. */
void sf_coverage_tell(const sf_coverage *coverage, const sf_coverage_cell *cell, sf_live_cell *told);

/* Chooses the cell about which coverage is least, with its neighbours; the one before stays until it is
 * covered or another is much worse. */
void sf_coverage_choose_worst(sf_coverage *coverage);

#endif
