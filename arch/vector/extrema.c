/* extrema.c - the pixels of a row of differences that no neighbour reaches: lanes = columns. */
#include "kernels.h"

#include "vec.h"

/* The greatest and the least of some neighbours. */
typedef struct range {
    vf high, low;
} range;

VEC range take(range r, const float *p) {
    vf a = vf_loadu(p);
    return (range){vf_max(r.high, a), vf_min(r.low, a)};
}

VEC range range_of(const float *p) {
    vf a = vf_loadu(p);
    return (range){a, a};
}

VEC range take_three(range r, const float *p) { return take(take(take(r, p - 1), p), p + 1); }

/* Lanes that are above all before and no less than all after, as bits; and those below. */
VEC void keep_extrema(vf value, range before, range after, unsigned *above, unsigned *below) {
    *above &= ~vm_bits(vf_ge(before.high, value)) & vm_bits(vf_ge(value, after.high));
    *below &= ~vm_bits(vf_ge(value, before.low)) & vm_bits(vf_ge(after.low, value));
}

VEC unsigned extrema_at(const sf_extrema_args *a, int x) {
    vf value = vf_loadu(a->rows[1][1] + x);
    unsigned above = vm_bits(vf_ge(value, vf_set(a->threshold)));
    unsigned below = vm_bits(vf_le(value, vf_set(-a->threshold)));
    if (!(above | below)) return 0;
    /* 1. Beside it: most fall out here. */
    range before = take_three(range_of(a->rows[1][1] + x - 1), a->rows[1][0] + x);
    range after = take_three(range_of(a->rows[1][1] + x + 1), a->rows[1][2] + x);
    keep_extrema(value, before, after, &above, &below);
    if (!(above | below)) return 0;
    /* 2. One layer finer, and one coarser. */
    for (int row = 0; row < 3; row++) {
        before = take_three(before, a->rows[0][row] + x);
        after = take_three(after, a->rows[2][row] + x);
    }
    keep_extrema(value, before, after, &above, &below);
    return above | below;
}

size_t SF_AT_LEVEL(sf_extrema)(const sf_extrema_args *args) {
    const sf_extrema_args own = *args;
    size_t count = 0;
    for (int x = own.first; x < own.end; x += VW) {
        unsigned found = extrema_at(&own, x);
        if (own.end - x < VW) found &= (1u << (own.end - x)) - 1;
        for (; found; found &= found - 1) own.columns[count++] = (uint32_t)(x + __builtin_ctz(found));
    }
    return count;
}
