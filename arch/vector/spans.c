/* spans.c - the tiles that a Gaussian touches: lanes = Gaussians, one row of tiles after the other. */
#include "kernels.h"

#include "interval.h"
#include "vec.h"

/* VW Gaussians. */
typedef struct gaussians {
    ellipses shape;
    vf first_row, rows, depth;
    int most_rows;
} gaussians;

/* Those from i to end - 1; lanes past them have no rows. */
VEC gaussians load(const sf_splat *splats, const uint16_t *first_row, const uint16_t *rows, size_t i,
                   size_t end) {
    const float *splat[VW];
    _Alignas(64) float row[VW], count[VW];
    vf field[16];
    gaussians g = {.most_rows = 0};
    for (size_t lane = 0; lane < VW; lane++) {
        size_t at = i + lane < end ? i + lane : i;
        int n = i + lane < end ? rows[at] : 0;
        splat[lane] = (const float *)&splats[at];
        row[lane] = (float)first_row[at];
        count[lane] = (float)n;
        g.most_rows = n > g.most_rows ? n : g.most_rows;
    }
    vf_transpose(splat, field);
    g.shape = (ellipses){field[0], field[1], field[10], field[11], field[12], field[13]};
    g.first_row = vf_load(row), g.rows = vf_load(count), g.depth = field[9];
    return g;
}

/* The spans of a row as floats. A tile has a centre in the interval left .. right where 16 x + 15.5 >= left
 * and 16 x + 0.5 <= right. Clamped as floats: an interval beside the picture must come out empty on either
 * side. */
VEC void spans_of(const gaussians *g, vf row, vf tiles_x, vf *x0, vf *x1) {
    vf top = vf_sub(vf_fma(row, vf_set(SF_TILE), vf_set(0.5f)), g->shape.v);
    vf bottom = vf_add(top, vf_set(SF_TILE - 1)), zero = vf_set(0);
    vf left, right;
    interval(&g->shape, top, bottom, &left, &right);
    vf inv = vf_set(1.0f / SF_TILE), margin = vf_set(SF_TILE - 0.5f);
    vf first = vf_mul(vf_sub(left, margin), inv), end = vf_mul(vf_add(right, margin), inv);
    first = vf_min(vf_max(first, zero), tiles_x);
    *x0 = vf_sub(tiles_x, vf_floor(vf_sub(tiles_x, first)));
    *x1 = vf_max(vf_floor(vf_min(vf_max(end, zero), tiles_x)), *x0);
}

void SF_AT_LEVEL(sf_spans)(const sf_splat *splats, const uint16_t *first_row, const uint16_t *rows,
                           const uint32_t *offset, size_t first, size_t end, int tiles_x, sf_span *spans,
                           uint32_t *tiles, float *depth) {
    vf width = vf_set((float)tiles_x);
    uint32_t none;
    for (size_t i = first; i < end; i += VW) {
        size_t lanes = end - i < VW ? end - i : VW;
        gaussians g = load(splats, first_row, rows, i, end);
        vf sum = vf_set(0);
        for (int r = 0; r < g.most_rows; r++) {
            vf x0, x1, in_row = vf_set((float)r);
            spans_of(&g, vf_add(g.first_row, in_row), width, &x0, &x1);
            sum = vf_add(sum, vf_keep(vf_le(vf_add(in_row, vf_set(1)), g.rows), vf_sub(x1, x0)));
            _Alignas(64) uint32_t pairs[VW];
            vu_store(pairs, vu_pairs(x0, x1));
            for (size_t lane = 0; lane < lanes;
                 lane++) { /* without branches: how many rows is not foreseeable */
                void *to =
                    r < rows[i + lane] ? (void *)&spans[offset[i + lane] + (uint32_t)r] : (void *)&none;
                memcpy(to, &pairs[lane], sizeof *pairs);
            }
        }
        _Alignas(64) float sums[VW], depths[VW];
        vf_store(sums, sum);
        vf_store(depths, g.depth);
        for (size_t lane = 0; lane < lanes; lane++) tiles[i + lane] = (uint32_t)sums[lane];
        memcpy(depth + i, depths, lanes * sizeof *depth);
    }
}
