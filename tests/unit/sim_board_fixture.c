/* sim_board_fixture.c - see the header. */
#include "sim_board_fixture.h"

#include <math.h>
#include <stdlib.h>

#include "sim/sim.h"

const double sim_board_degree = 3.141592653589793 / 180;

int sim_board_quick(void) { return getenv("SPLATFIT_QUICK") != NULL; }

sf_source *sim_board_open_source(sf_context *ctx, const char *name) {
    sf_source *source;
    assert_ok(ctx, sf_source_open(ctx, name, &source));
    return source;
}

sf_sim sim_board_make_sim(sf_context *ctx, const char *name) {
    sf_sim sim;
    assert_ok(ctx, sf_sim_init(ctx, name, &sim));
    return sim;
}

double sim_board_angle_between(const double a[9], const double b[9]) {
    double trace = 0;
    for (int i = 0; i < 9; i++) trace += a[i] * b[i];
    return acos(fmin(fmax((trace - 1) / 2, -1), 1)) / sim_board_degree;
}

double sim_board_distance_between(const double a[3], const double b[3]) {
    return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
}
