/* sightings.h - the views of a calibration. */
#ifndef SF_POSE_SIGHTINGS_H
#define SF_POSE_SIGHTINGS_H

#include "../base/context.h"
#include "swelling.h"

/* The picture as cells, for coverage. */
enum { SF_CELLS_X = 8, SF_CELLS_Y = 6, SF_CELLS = SF_CELLS_X * SF_CELLS_Y };

/* How a view looks through a guessed lens. */
typedef struct sf_stance {
    double x, y;         /* the corners' mean, of the picture's width and height */
    double log_distance; /* of the board's middle */
    double tilt[2];      /* x, y of the board's axis in the camera's frame */
} sf_stance;

typedef struct sf_sighting {
    sf_board_corner *corners; /* with room for the flags behind them */
    sf_corner_list list;
    sf_stance stance;
    /* What sf_calibrate makes of it. */
    int rejected;
    sf_swelling swelling; /* that the corners are without */
    sf_rigid pose, next;
    sf_view_sums sums, next_sums;
    double factor[SF_TWIST * SF_TWIST]; /* of the damped normal equations of the pose */
} sf_sighting;

struct sf_sightings {
    sf_context *ctx;
    int32_t width, height;
    sf_sighting *views;
    size_t count, capacity;
    uint8_t cells[SF_CELLS]; /* 1 where a corner was seen */
};

/* A lens to begin with: the picture's middle, no distortion, a focal length of `focal` times its longer side.
 */
sf_lens sf_sightings_guess(const sf_sightings *s, double focal);

/* Marks the cells in which the corners lie that are not rejected. Returns how many were not marked before. */
size_t sf_sightings_mark(const sf_sightings *s, const sf_corner_list *list, uint8_t cells[SF_CELLS]);

double sf_cells_share(const uint8_t cells[SF_CELLS]);

#endif
