/* band.h - the newest rows of a picture that comes row by row. */
#ifndef SF_SFM_BAND_H
#define SF_SFM_BAND_H

#include "../base/context.h"
#include "../kernels/kernels.h"

/* The last `kept` of rows 0 .. end-1 at least: either in a ring, or one after another from `first` on. */
typedef struct sf_band {
    float *rows; /* [capacity][stride], aligned */
    size_t stride;
    unsigned wrap; /* of a ring: capacity - 1; else all bits */
    int first, end;
    int kept, capacity;
} sf_band;

/* Floats of a row of `width` pixels: what the kernels need. */
static inline size_t sf_band_stride(int width) {
    return ((size_t)width + SF_LANES - 1) / SF_LANES * SF_LANES + SF_LANES;
}

/* Rows come `group` at a time at most. */
sf_status sf_band_create_ring(sf_context *ctx, sf_band *band, int width, int kept, int group);
/* Without the ring: rows lie one after another, and move when there is no room for more. */
sf_status sf_band_create(sf_context *ctx, sf_band *band, int width, int kept, int group);
void sf_band_free(sf_context *ctx, sf_band *band);

/* Whether room for `count` more rows is made by dropping all but the last `kept`. */
static inline int sf_band_is_full(const sf_band *band, int count) {
    return band->wrap + 1 == 0 && band->end - band->first + count > band->capacity;
}

/* Makes room for `count` rows, the next ones that are added. */
void sf_band_make_room(sf_band *band, int count);

static inline float *sf_band_row(const sf_band *band, int y) {
    return band->rows + ((unsigned)(y - band->first) & band->wrap) * band->stride;
}

/* The next row, for which there is room. */
static inline float *sf_band_next(sf_band *band) { return sf_band_row(band, band->end++); }

#endif
