/* octave.h - one octave of a scale space that goes through the picture row by row (README.md, S.1 to S.3). */
#ifndef SF_SFM_OCTAVE_H
#define SF_SFM_OCTAVE_H

#include "describe.h"

/* Rows of an octave: what comes in, of the first octave alone; then the levels. */
enum { SF_OCTAVE_INPUT = 0, SF_OCTAVE_FIRST = 1, SF_OCTAVE_LEVELS = 6, SF_OCTAVE_ROWS = 7 };
enum { SF_OCTAVE_DIFFERENCES = SF_OCTAVE_LEVELS - 1, SF_OCTAVE_LAYERS = 3, SF_OCTAVE_LEAST_SIDE = 16 };

/* How a kind of rows is blurred from the one before it: weights, the middle one first. */
typedef struct sf_taps {
    int radius;
    float weights[SF_BLUR_RADIUS + 1];
} sf_taps;

/* Deviation of the Gaussian, at most 4 px, cut off at four deviations. */
sf_taps sf_taps_of(double deviation);

typedef struct sf_octave {
    sf_context *ctx;
    int width, height;                          /* px */
    const sf_taps *taps;                        /* [SF_OCTAVE_ROWS]; the first is not used */
    const sf_features_options *options;         /* of the search */
    const sf_photo *picture;                    /* whose mask counts */
    sf_band rows[SF_OCTAVE_ROWS];               /* those of the input: of the first octave alone */
    sf_band differences[SF_OCTAVE_DIFFERENCES]; /* between each level and the next */
    sf_spots spots[SF_OCTAVE_LAYERS];           /* found, by level, not described yet */
    int scanned;                                /* rows above it were looked through */
    float *scratch;
    uint32_t *columns; /* [width] */
    sf_describe_args describe;
    struct sf_octave *coarser; /* NULL: none */
} sf_octave;

/* step: px of the picture a px. is_first: it has rows of input, which come in; else rows of its first level
 * come from the octave before it. On failure sf_octave_free may be called. */
sf_status sf_octave_create(sf_octave *octave, int width, int height, double step, int is_first);
void sf_octave_free(sf_octave *octave);

/* Goes as far as the rows that came in allow, and so do the coarser octaves. */
sf_status sf_octave_advance(sf_octave *octave);

#endif
