/* band.c - the newest rows of a picture that comes row by row. */
#include "band.h"

#include <string.h>

static sf_status take_rows(sf_context *ctx, sf_band *band) {
    band->rows = sf_calloc(ctx, (size_t)band->capacity, band->stride * sizeof(float));
    return band->rows ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_band_create_ring(sf_context *ctx, sf_band *band, int width, int kept, int group) {
    int capacity = 1;
    while (capacity < kept + group) capacity *= 2;
    *band = (sf_band){
        .stride = sf_band_stride(width), .wrap = (unsigned)capacity - 1, .kept = kept, .capacity = capacity};
    return take_rows(ctx, band);
}

sf_status sf_band_create(sf_context *ctx, sf_band *band, int width, int kept, int group) {
    *band =
        (sf_band){.stride = sf_band_stride(width), .wrap = ~0u, .kept = kept, .capacity = 2 * kept + group};
    return take_rows(ctx, band);
}

void sf_band_free(sf_context *ctx, sf_band *band) {
    sf_free(ctx, band->rows);
    *band = (sf_band){0};
}

void sf_band_make_room(sf_band *band, int count) {
    if (!sf_band_is_full(band, count)) return;
    memmove(band->rows, sf_band_row(band, band->end - band->kept),
            (size_t)band->kept * band->stride * sizeof(float));
    band->first = band->end - band->kept;
}
