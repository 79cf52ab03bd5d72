/* spans.c - the tiles that a Gaussian touches: lanes = rows of tiles. */
#include "kernels.h"

#include "vec.h"

/* 0, 1, 2 ... */
VEC vf counting(void) {
    _Alignas(64) float lane[VW];
    for (int i = 0; i < VW; i++) lane[i] = (float)i;
    return vf_load(lane);
}

/* VW rows of tiles from `row` on, counted from the first: their spans as floats. A tile has a centre in the
 * interval left .. right where 16 x + 15.5 >= left and 16 x + 0.5 <= right. Clamped as floats: an interval
 * beside the picture must come out empty on either side. */
VEC void spans_of(const sf_splat *s, vf row, vf tiles_x, vf *x0, vf *x1) {
    vf top = vf_sub(vf_fma(row, vf_set(SF_TILE), vf_set(0.5f)), vf_set(s->v));
    vf bottom = vf_add(top, vf_set(SF_TILE - 1)), zero = vf_set(0), reach = vf_set(s->reach);
    vf at_right = vf_min(vf_max(vf_set(s->lean), top), bottom);
    vf at_left = vf_min(vf_max(vf_set(-s->lean), top), bottom);
    vf squeeze = vf_set(s->squeeze), slope = vf_set(s->slope), u = vf_set(s->u), pad = vf_set(0.01f);
    vf half_right = vf_root(vf_max(vf_fnma(squeeze, vf_mul(at_right, at_right), reach), zero));
    vf half_left = vf_root(vf_max(vf_fnma(squeeze, vf_mul(at_left, at_left), reach), zero));
    vf right = vf_add(vf_fma(slope, at_right, u), vf_add(half_right, pad));
    vf left = vf_sub(vf_fma(slope, at_left, u), vf_add(half_left, pad));
    vf inv = vf_set(1.0f / SF_TILE);
    vf first = vf_mul(vf_sub(left, vf_set(SF_TILE - 0.5f)), inv);
    vf end = vf_mul(vf_add(right, vf_set(SF_TILE - 0.5f)), inv);
    first = vf_min(vf_max(first, zero), tiles_x);
    *x0 = vf_sub(tiles_x, vf_floor(vf_sub(tiles_x, first)));
    *x1 = vf_max(vf_floor(vf_min(vf_max(end, zero), tiles_x)), *x0);
}

void SF_AT_LEVEL(sf_spans)(const sf_splat *splats, const uint16_t *first_row, const uint16_t *rows,
                           const uint32_t *offset, size_t first, size_t end, int tiles_x, sf_span *spans,
                           uint32_t *tiles) {
    vf lane = counting(), width = vf_set((float)tiles_x);
    for (size_t i = first; i < end; i++) {
        vf sum = vf_set(0);
        for (int r = 0; r < rows[i]; r += VW) {
            vf x0, x1;
            int left = rows[i] - r, count = left < VW ? left : VW;
            spans_of(&splats[i], vf_add(lane, vf_set((float)(first_row[i] + r))), width, &x0, &x1);
            sum = vf_add(sum, vf_keep(vf_le(lane, vf_set((float)(left - 1))), vf_sub(x1, x0)));
            vu pairs = vu_pairs(x0, x1);
            size_t at = (size_t)offset[i] + (size_t)r;
            if (at + VW <= offset[end]) { /* what is too much the next Gaussians write over */
                vu_storeu((uint32_t *)(void *)&spans[at], pairs);
            } else {
                _Alignas(64) uint32_t some[VW];
                vu_store(some, pairs);
                memcpy(&spans[at], some, (size_t)count * sizeof *spans);
            }
        }
        tiles[i] = (uint32_t)vf_sum(sum);
    }
}
