/* spans.c - the tiles that a Gaussian touches, row by row, in plain C. */
#include "scalar.h"

#include "interval.h"

void sf_spans_scalar(const sf_splat *splats, const uint16_t *first_row, const uint16_t *rows,
                     const uint32_t *offset, size_t first, size_t end, int tiles_x, sf_span *spans,
                     uint32_t *tiles, float *depth) {
    const float last_center = SF_TILE - 0.5f;
    for (size_t i = first; i < end; i++) {
        tiles[i] = 0;
        depth[i] = splats[i].depth;
        for (int r = 0; r < rows[i]; r++) {
            const sf_splat *s = &splats[i];
            float top = (float)((first_row[i] + r) * SF_TILE) + 0.5f, left, right;
            sf_interval(s, top - s->v, top + (SF_TILE - 1) - s->v, &left, &right);
            /* A tile has a centre in the interval where 16 x + 15.5 >= left and 16 x + 0.5 <= right. Clamped
             * as floats: an interval beside the picture must come out empty on either side. */
            float x0 = ceilf((left - last_center) / SF_TILE), x1 = floorf((right - 0.5f) / SF_TILE) + 1.0f;
            x0 = fminf(fmaxf(x0, 0.0f), (float)tiles_x);
            x1 = fminf(fmaxf(x1, x0), (float)tiles_x);
            spans[offset[i] + (uint32_t)r] = (sf_span){(uint16_t)x0, (uint16_t)x1};
            tiles[i] += (uint32_t)x1 - (uint32_t)x0;
        }
    }
}
