/* calibrate_fixture.h - views of a board, of known lenses. */
#ifndef TESTS_UNIT_CALIBRATE_FIXTURE_H
#define TESTS_UNIT_CALIBRATE_FIXTURE_H

#include "testing.h"

#include <sys/wait.h>

#include "base/rng.h"
#include "pose/edge_bias.h"
#include "pose/view.h"

enum { WIDTH = 640, HEIGHT = 480, MOST_CORNERS = 80 };

extern const double calibrate_pi;
extern const sf_lens calibrate_truth;

/* The board's middle seen at pixel (u, v) from `distance` metres, turned by x, y, z degrees. */
typedef struct stand {
    double u, v, distance, x, y, z;
} stand;

sf_rigid calibrate_pose_of(const sf_lens *lens, const stand *s);

enum { STANDS = 16 };
extern const stand calibrate_stands[STANDS];

/* The corners that lie in the picture, with noise of `sigma` px. */
size_t calibrate_project_board(const sf_board *board, const sf_lens *lens, const sf_rigid *T, double sigma,
                               sf_rng *rng, sf_board_corner *corners);

typedef struct fixture {
    sf_context *ctx;
    sf_board *board;
    sf_observations *observations;
    sf_rng rng;
    sf_board_corner corners[MOST_CORNERS];
} fixture;

void calibrate_begin(fixture *f, uint64_t seed);
void calibrate_end(fixture *f);
size_t calibrate_see(fixture *f, const stand *s, double sigma);
void calibrate_print_lens(const char *what, const sf_calibration *c);

/* Within the bar for the focal length and k1, and within what the views tell for the rest. */
void calibrate_assert_as_told(const sf_calibration *c);

#endif
