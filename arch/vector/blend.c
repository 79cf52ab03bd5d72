/* blend.c - one tile, front to back, and the gradient of it, in vectors of pixels.
 *
 * A tile is cut into blocks of one vector each. The list is taken in chunks: first, with lanes = Gaussians,
 * which of them reach which block (the same exact interval that made the tile's list, for each band of
 * blocks); then the pairs, with lanes = pixels. Forward goes block by block with the block's state in
 * registers; backward goes Gaussian by Gaussian with its sums in registers.
 */
#include "kernels.h"

#include "vec.h"

enum {
    CHUNK = 256,
    ACROSS = SF_TILE / VB_COLUMNS, /* blocks side by side */
    BANDS = SF_TILE / VB_ROWS,
    BLOCKS = ACROSS * BANDS, /* at most 64 */
    WORDS = CHUNK / 64
};

/* log2(1/255): a pair below it is skipped. */
#define LEAST_POWER ((float)-SF_LOG2_255)

/* Gaussians of a chunk. Offsets are from the tile's first pixel centre: t = l00 X + l01 Y + t0, s = m Y + s0.
 */
typedef struct chunk {
    _Alignas(64) float l00[CHUNK], l01[CHUNK], t0[CHUNK], m[CHUNK], s0[CHUNK], power[CHUNK];
    _Alignas(64) float rgb[3][CHUNK], depth[CHUNK];
    _Alignas(64) uint32_t blocks_of[2][CHUNK]; /* by Gaussian: the blocks that it reaches, 32 in each half */
    uint64_t reaches[BLOCKS][WORDS];           /* by block: the Gaussians that reach it */
} chunk;

/* Offsets of a block's pixels. */
typedef struct place {
    vf x, y;
} place;

VEC place place_of(int block) {
    _Alignas(64) float x[VW], y[VW];
    for (int i = 0; i < VW; i++) {
        x[i] = (float)(block % ACROSS * VB_COLUMNS + i % VB_COLUMNS);
        y[i] = (float)(block / ACROSS * VB_ROWS + i / VB_COLUMNS);
    }
    return (place){vf_load(x), vf_load(y)};
}

/* One that reaches nothing, for the lanes past a chunk's end. */
static const _Alignas(64) sf_splat nothing = {.half_height = -1e9f};

/* Reads VW Gaussians and finds the blocks that they reach. */
VEC void gather(const sf_blend_args *a, const uint32_t *entries, int first, int n, int by_block, chunk *c) {
    const float *rows[VW];
    vf field[16];
    for (int i = 0; i < VW; i++)
        rows[i] = (const float *)(first + i < n ? &a->splats[entries[first + i]] : &nothing);
    vf_transpose(rows, field);
    vf u = field[0] - vf_set((float)a->x0 + 0.5f), v = field[1] - vf_set((float)a->y0 + 0.5f);
    vf l00 = field[2], l01 = field[3], m = field[4];
    vf_store(c->l00 + first, l00);
    vf_store(c->l01 + first, l01);
    vf_store(c->m + first, m);
    vf_store(c->t0 + first, vf_set(0) - vf_fma(l00, u, l01 * v));
    vf_store(c->s0 + first, vf_set(0) - m * v);
    vf_store(c->power + first, field[5]);
    for (int ch = 0; ch < 3; ch++) vf_store(c->rgb[ch] + first, field[6 + ch]);
    vf_store(c->depth + first, field[9]);

    vf slope = field[10], reach = field[11], squeeze = field[12], lean = field[13];
    vf high = field[15] + vf_set(0.01f), zero = vf_set(0), pad = vf_set(0.01f);
    vu blocks[2] = {vu_zero(), vu_zero()};
    for (int band = 0; band < BANDS; band++) {
        vf top = vf_set((float)(band * VB_ROWS)) - v, bottom = top + vf_set(VB_ROWS - 1);
        vm in = vm_and(vf_le(top, high), vf_ge(bottom, zero - high));
        vf at_right = vf_min(vf_max(lean, top), bottom), at_left = vf_min(vf_max(zero - lean, top), bottom);
        vf right = vf_fma(slope, at_right, u) +
                   (vf_sqrt(vf_max(vf_fnma(squeeze, at_right * at_right, reach), zero)) + pad);
        vf left = vf_fma(slope, at_left, u) -
                  (vf_sqrt(vf_max(vf_fnma(squeeze, at_left * at_left, reach), zero)) + pad);
        for (int column = 0; column < ACROSS; column++) {
            int block = band * ACROSS + column;
            vm hit = vm_and(in, vm_and(vf_ge(right, vf_set((float)(column * VB_COLUMNS))),
                                       vf_le(left, vf_set((float)(column * VB_COLUMNS + VB_COLUMNS - 1)))));
            if (by_block)
                c->reaches[block][first / 64] |= (uint64_t)vm_bits(hit) << first % 64;
            else
                blocks[block / 32] = vu_or_where(blocks[block / 32], hit, (uint32_t)1 << block % 32);
        }
    }
    if (by_block) return;
    vu_store(c->blocks_of[0] + first, blocks[0]);
    vu_store(c->blocks_of[1] + first, blocks[1]);
}

/* A pair's opacity: e = o g where visible, else 0, not yet clamped. */
VEC vf opacity(const chunk *c, int i, place at, vf *t, vf *s) {
    *t = vf_fma(vf_set(c->l00[i]), at.x, vf_fma(vf_set(c->l01[i]), at.y, vf_set(c->t0[i])));
    *s = vf_fma(vf_set(c->m[i]), at.y, vf_set(c->s0[i]));
    vf power = vf_fnma(*t, *t, vf_fnma(*s, *s, vf_set(c->power[i])));
    return vf_keep(vf_ge(power, vf_set(LEAST_POWER)), vf_exp2(vf_max(power, vf_set(-16.0f))));
}

/* The state of the blocks between chunks. */
typedef struct state {
    _Alignas(64) float running[SF_TILE_PIXELS];  /* T, also past the stop */
    _Alignas(64) float accepted[SF_TILE_PIXELS]; /* T after the last Gaussian that was blended */
    _Alignas(64) float rgb[3][SF_TILE_PIXELS], depth[SF_TILE_PIXELS];
} state;

/* One block through a chunk. Returns the Gaussian after which no pixel is left, or -1. */
VEC int blend_block(const chunk *c, int block, int with_depth, state *st) {
    place at = place_of(block);
    int px = block * VW;
    vf T = vf_load(st->running + px), accepted = vf_load(st->accepted + px), depth = vf_load(st->depth + px);
    vf red = vf_load(st->rgb[0] + px), green = vf_load(st->rgb[1] + px), blue = vf_load(st->rgb[2] + px);
    int finished = -1;
    for (int word = 0; word < WORDS && finished < 0; word++)
        for (uint64_t bits = c->reaches[block][word]; bits; bits &= bits - 1) {
            int i = 64 * word + __builtin_ctzll(bits);
            /* 1. o g in base 2; 2. opacity at this pixel */
            vf t, s, alpha = vf_min(opacity(c, i, at, &t, &s), vf_set(SF_ALPHA_MAX));
            /* 3. stop before the Gaussian that would bring T under the threshold: T runs on, its weight does
             * not count */
            vf next = vf_fnma(T, alpha, T);
            vm open = vf_ge(next, vf_set(SF_T_STOP));
            vf w = vf_keep(open, T * alpha);
            T = next;
            accepted = vf_select(open, next, accepted);
            /* 4. accumulate */
            red = vf_fma(w, vf_set(c->rgb[0][i]), red);
            green = vf_fma(w, vf_set(c->rgb[1][i]), green);
            blue = vf_fma(w, vf_set(c->rgb[2][i]), blue);
            if (with_depth) depth = vf_fma(w, vf_set(c->depth[i]), depth);
            if (__builtin_expect(!vm_any(open), 0)) {
                finished = i;
                break;
            }
        }
    vf_store(st->running + px, T);
    vf_store(st->accepted + px, accepted);
    vf_store(st->rgb[0] + px, red);
    vf_store(st->rgb[1] + px, green);
    vf_store(st->rgb[2] + px, blue);
    if (with_depth) vf_store(st->depth + px, depth);
    return finished;
}

VEC void blend(const sf_blend_args *a, int with_depth) {
    chunk c;
    state st;
    for (int px = 0; px < SF_TILE_PIXELS; px++) {
        st.running[px] = st.accepted[px] = 1;
        st.rgb[0][px] = st.rgb[1][px] = st.rgb[2][px] = st.depth[px] = 0;
    }
    for (int block = 0; block < BLOCKS; block++) a->last[block] = a->count;
    uint64_t live = BLOCKS == 64 ? UINT64_MAX : ((uint64_t)1 << BLOCKS % 64) - 1;

    for (uint32_t begin = 0; begin < a->count && live; begin += CHUNK) {
        int n = a->count - begin < CHUNK ? (int)(a->count - begin) : CHUNK;
        for (int block = 0; block < BLOCKS; block++)
            for (int word = 0; word < WORDS; word++) c.reaches[block][word] = 0;
        for (int i = 0; i < n; i += VW) gather(a, a->entries + begin, i, n, 1, &c);
        for (uint64_t left = live; left; left &= left - 1) {
            int block = __builtin_ctzll(left), finished = blend_block(&c, block, with_depth, &st);
            if (finished < 0) continue;
            a->last[block] = begin + (uint32_t)finished + 1;
            live &= ~((uint64_t)1 << block);
        }
    }

    for (int block = 0; block < BLOCKS; block++) {
        size_t at = (size_t)(block / ACROSS * VB_ROWS) * a->stride + (size_t)(block % ACROSS * VB_COLUMNS);
        vf T = vf_load(st.accepted + block * VW);
        for (int ch = 0; ch < 3; ch++)
            vf_store_block(a->rgb[ch] + at, a->stride,
                           vf_fma(T, vf_set(a->background[ch]), vf_load(st.rgb[ch] + block * VW)));
        vf_store_block(a->transmittance + at, a->stride, T);
        if (with_depth) vf_store_block(a->depth + at, a->stride, vf_load(st.depth + block * VW));
    }
}

void SF_AT_LEVEL(sf_blend)(const sf_blend_args *a) {
    if (a->depth)
        blend(a, 1);
    else
        blend(a, 0);
}

/* What the backward pass keeps of each pixel. */
typedef struct pixels {
    _Alignas(64) float x[SF_TILE_PIXELS], y[SF_TILE_PIXELS]; /* offsets */
    _Alignas(64) float T[SF_TILE_PIXELS];                    /* also past the stop */
    _Alignas(
        64) float behind[SF_TILE_PIXELS]; /* dL/dgamma . (C - S_i): what lies behind the entries so far */
    _Alignas(64) float d_rgb[3][SF_TILE_PIXELS];
} pixels;

static void load_pixels(const sf_blend_args *a, pixels *p) {
    for (int block = 0; block < BLOCKS; block++) {
        size_t at = (size_t)(block / ACROSS * VB_ROWS) * a->stride + (size_t)(block % ACROSS * VB_COLUMNS);
        place where = place_of(block);
        vf behind = vf_set(0);
        for (int ch = 0; ch < 3; ch++) {
            vf d = vf_load_block(a->d_rgb[ch] + at, a->stride);
            vf_store(p->d_rgb[ch] + block * VW, d);
            behind = vf_fma(d, vf_load_block(a->rgb[ch] + at, a->stride), behind);
        }
        vf_store(p->behind + block * VW, behind);
        vf_store(p->T + block * VW, vf_set(1));
        vf_store(p->x + block * VW, where.x);
        vf_store(p->y + block * VW, where.y);
    }
}

/* Gaussian i in one block: the pair's part of the nine sums. */
VEC void blend_bwd_block(const chunk *c, int i, int px, pixels *p, vf sums[9]) {
    place at = {vf_load(p->x + px), vf_load(p->y + px)};
    vf T = vf_load(p->T + px), one = vf_set(1);
    /* 1. o g in base 2; 2. opacity at this pixel */
    vf t, s, og = opacity(c, i, at, &t, &s), alpha = vf_min(og, vf_set(SF_ALPHA_MAX));
    vf next = vf_fnma(T, alpha, T);
    vf_store(p->T + px, next);
    alpha = vf_keep(vf_ge(next, vf_set(SF_T_STOP)), alpha);
    /* 3. B.5b, and B.5a in its front-to-back form */
    vf w = T * alpha, along = vf_set(0);
    for (int ch = 0; ch < 3; ch++) {
        vf d = vf_load(p->d_rgb[ch] + px);
        sums[ch] = vf_fma(w, d, sums[ch]);
        along = vf_fma(d, vf_set(c->rgb[ch][i]), along);
    }
    vf behind = vf_fnma(w, along, vf_load(p->behind + px));
    vf_store(p->behind + px, behind);
    /* 4. moments; the clamp passes no gradient */
    vf q = vf_keep(vf_le(og, vf_set(SF_ALPHA_MAX)), vf_fnma(behind, vf_div(alpha, one - alpha), w * along));
    vf qt = q * t, qs = q * s;
    sums[3] = sums[3] + q;
    sums[4] = sums[4] + qt;
    sums[5] = sums[5] + qs;
    sums[6] = vf_fma(qt, t, sums[6]);
    sums[7] = vf_fma(qt, s, sums[7]);
    sums[8] = vf_fma(qs, s, sums[8]);
}

/* The blocks that are still open at entry e; *until: the entry at which that changes. */
static uint64_t open_blocks(const uint32_t *last, uint32_t e, uint32_t *until) {
    uint64_t open = 0;
    *until = UINT32_MAX;
    for (int block = 0; block < BLOCKS; block++)
        if (last[block] > e) {
            open |= (uint64_t)1 << block;
            if (last[block] < *until) *until = last[block];
        }
    return open;
}

void SF_AT_LEVEL(sf_blend_bwd)(const sf_blend_args *a) {
    chunk c;
    pixels p;
    load_pixels(a, &p);
    uint32_t until = 0;
    uint64_t open = 0;
    for (uint32_t begin = 0; begin < a->count; begin += CHUNK) {
        int n = a->count - begin < CHUNK ? (int)(a->count - begin) : CHUNK;
        for (int i = 0; i < n; i += VW) gather(a, a->entries + begin, i, n, 0, &c);
        for (int i = 0; i < n; i++) {
            uint32_t e = begin + (uint32_t)i;
            if (e >= until) open = open_blocks(a->last, e, &until);
            float *out = a->sums + (size_t)a->slots[e] * SF_SUMS;
            uint64_t blocks = (((uint64_t)c.blocks_of[1][i] << 32) | c.blocks_of[0][i]) & open;
            vf sums[9];
            for (int k = 0; k < 9; k++) sums[k] = vf_set(0);
            for (; blocks; blocks &= blocks - 1)
                blend_bwd_block(&c, i, __builtin_ctzll(blocks) * VW, &p, sums);
            vf_sums8(sums, out);
            out[8] = vf_sum(sums[8]);
        }
    }
}
