/* sim_board_fixture.h - a camera carried around a simulated board. */
#ifndef TESTS_UNIT_SIM_BOARD_FIXTURE_H
#define TESTS_UNIT_SIM_BOARD_FIXTURE_H

#include "testing.h"

#include "sim/sim.h"

#define BOARD "sim:studio-board"

extern const double sim_board_degree;

int sim_board_quick(void);
sf_source *sim_board_open_source(sf_context *ctx, const char *name);
sf_sim sim_board_make_sim(sf_context *ctx, const char *name);

/* Degrees between two rotations. */
double sim_board_angle_between(const double a[9], const double b[9]);
double sim_board_distance_between(const double a[3], const double b[3]);

#endif
