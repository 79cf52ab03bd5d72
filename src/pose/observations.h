/* observations.h - the views of a calibration. */
#ifndef SF_POSE_OBSERVATIONS_H
#define SF_POSE_OBSERVATIONS_H

#include "../base/context.h"
#include "edge_bias.h"

/* The picture as cells, for coverage. */
enum { SF_CELLS_X = 8, SF_CELLS_Y = 6, SF_CELLS = SF_CELLS_X * SF_CELLS_Y };

/* How a view looks through a guessed lens. */
typedef struct sf_stance {
    double x, y;         /* the corners' mean, of the picture's width and height */
    double log_distance; /* of the board's middle */
    double tilt[2];      /* x, y of the board's axis in the camera's frame */
} sf_stance;

typedef struct sf_observation {
    sf_board_corner *corners; /* with room for the flags behind them */
    sf_corner_list list;
    sf_stance stance;
    /* What sf_calibrate makes of it. */
    int rejected;
    sf_edge_bias edge_bias; /* that the corners are without */
    sf_rigid pose, next;
    sf_view_sums sums, next_sums;
    double factor[SF_TWIST * SF_TWIST]; /* of the damped normal equations of the pose */
} sf_observation;

struct sf_observations {
    sf_context *ctx;
    int32_t width, height;
    sf_observation *views;
    size_t count, capacity;
    uint8_t cells[SF_CELLS]; /* 1 where a corner was seen */
};

/* A lens to begin with: the picture's middle, no distortion, a focal length of `focal` times its longer side.
 */
sf_lens sf_observations_guess(const sf_observations *s, double focal);

/* Marks the cells in which the corners lie that are not rejected. Returns how many were not marked before. */
size_t sf_observations_mark(const sf_observations *s, const sf_corner_list *list, uint8_t cells[SF_CELLS]);

double sf_cells_share(const uint8_t cells[SF_CELLS]);

#endif
