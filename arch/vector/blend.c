/* blend.c - one tile, front to back, and the gradient of it, in vectors of pixels.
 *
 * A tile is cut into blocks of one vector each. The list is taken in chunks: first, with lanes = Gaussians,
 * which of them reach which block (the interval that made the tile's list, for each band of blocks); then the
 * pairs, with lanes = pixels. Forward goes block by block with the block's state in registers; backward goes
 * Gaussian by Gaussian with its sums in registers.
 *
 * The opacity of a pair is a chain of some twenty dependent operations. Those of STEP pairs are worked out
 * side by side, so that no processor waits for one of them.
 */
#include "kernels.h"

#include "interval.h"
#include "vec.h"

enum {
    CHUNK = VW < 8 ? 128 : 240,    /* Gaussians at a time; their numbers fit into a byte */
    NOTHING = CHUNK,               /* one without effect stands behind them */
    ACROSS = SF_TILE / VB_COLUMNS, /* blocks side by side */
    BANDS = SF_TILE / VB_ROWS,
    BLOCKS = ACROSS * BANDS, /* at most 64 */
    STEP = 4,
    AHEAD = 32,
    BATCH = BLOCKS < 64 ? 64 : 128 /* pairs of the backward pass at a time: they stay in the L1 cache */
};

/* The bench builds this file once more for each degree of the exponential, and without the pairs. */
#if defined(SF_BLEND_VARIANT)
#define KERNEL(name) SF_JOIN(SF_AT_LEVEL(name), SF_BLEND_VARIANT)
#else
#define KERNEL(name) SF_AT_LEVEL(name)
#endif
#if !defined(SF_BLEND_CULL_ONLY)
#define SF_BLEND_CULL_ONLY 0
#endif

/* log2(1/255): a pair below it is skipped. */
#define LEAST_POWER ((float)-SF_LOG2_255)

/* Less than log2(0.99): a Gaussian of no more opacity is never clamped, whatever exp2's rounding. */
#define LOG2_ALPHA_MAX -0.0145f

/* Gaussians of a chunk. Offsets are from the tile's first pixel centre: t = l00 X + l01 Y + t0, s = m Y + s0.
 */
typedef struct chunk {
    _Alignas(64) float l00[CHUNK + VW], l01[CHUNK + VW], t0[CHUNK + VW], m[CHUNK + VW], s0[CHUNK + VW];
    _Alignas(64) float power[CHUNK + VW], rgb[3][CHUNK + VW], depth[CHUNK + VW];
} chunk;

/* By block: the Gaussians of a chunk that reach it, near to far. */
typedef struct lists {
    uint8_t reaching[BLOCKS][CHUNK + VW];
    int count[BLOCKS];
} lists;

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

/* Fields of VW Gaussians, u and v from the tile's first pixel centre. */
typedef struct gaussians {
    ellipses shape;
    vf half_height;
} gaussians;

static const _Alignas(64) sf_splat nothing = {.half_height = -1e9f, .log2_opacity = -1e9f};

/* Reads Gaussians first .. first+VW-1 of a chunk of n; those past its end are nothing. */
VEC gaussians gather(const sf_blend_args *a, const uint32_t *entries, int first, int n, chunk *c) {
    const float *rows[VW];
    vf field[16];
    for (int i = first ? first + AHEAD : 0; i < first + AHEAD + VW && i < n; i++)
        __builtin_prefetch(&a->splats[entries[i]]);
    for (int i = 0; i < VW; i++)
        rows[i] = (const float *)(first + i < n ? &a->splats[entries[first + i]] : &nothing);
    vf_transpose(rows, field);
    vf u = vf_sub(field[0], vf_set((float)a->x0 + 0.5f)), v = vf_sub(field[1], vf_set((float)a->y0 + 0.5f));
    vf l00 = field[2], l01 = field[3], m = field[4];
    vf_store(c->l00 + first, l00);
    vf_store(c->l01 + first, l01);
    vf_store(c->m + first, m);
    vf_store(c->t0 + first, vf_neg(vf_fma(l00, u, vf_mul(l01, v))));
    vf_store(c->s0 + first, vf_neg(vf_mul(m, v)));
    vf_store(c->power + first, field[5]);
    for (int ch = 0; ch < 3; ch++) vf_store(c->rgb[ch] + first, field[6 + ch]);
    vf_store(c->depth + first, field[9]);
    return (gaussians){{u, v, field[10], field[11], field[12], field[13]}, field[15]};
}

/* Puts the Gaussians on the lists of the blocks that they reach, and leaves these in parts, a bit a block. */
VEC void cull(const gaussians *g, int first, int n, lists *l, uint64_t *parts) {
    vf high = vf_add(g->half_height, vf_set(0.01f));
    vu reached[2] = {vu_zero(), vu_zero()};
    for (int band = 0; band < BANDS; band++) {
        vf top = vf_sub(vf_set((float)(band * VB_ROWS)), g->shape.v),
           bottom = vf_add(top, vf_set(VB_ROWS - 1));
        vm in = vm_and(vf_le(top, high), vf_ge(bottom, vf_neg(high)));
        if (!vm_any(in)) continue;
        vf left, right;
        interval(&g->shape, top, bottom, &left, &right);
        for (int column = 0; column < ACROSS; column++) {
            int block = band * ACROSS + column;
            float x = (float)(column * VB_COLUMNS);
            vm hit = vm_and(in, vm_and(vf_ge(right, vf_set(x)), vf_le(left, vf_set(x + (VB_COLUMNS - 1)))));
            l->count[block] += vm_list(hit, first, l->reaching[block] + l->count[block]);
            reached[block / 32] = vu_or_where(reached[block / 32], hit, (uint32_t)1 << block % 32);
        }
    }
    _Alignas(64) uint32_t bits[2][VW];
    vu_store(bits[0], reached[0]);
    vu_store(bits[1], reached[1]);
    for (int i = 0; i < VW && first + i < n; i++) parts[first + i] = (uint64_t)bits[1][i] << 32 | bits[0][i];
}

/* Of STEP pairs: the whitened offsets, and o g where visible, else 0, not yet clamped. Pair k is Gaussian
 * i[k] at place[k]. */
VEC void opacities(const chunk *c, const uint8_t *i, const place *at, vf *t, vf *s, vf *og) {
    vf power[STEP];
    for (int k = 0; k < STEP; k++) s[k] = vf_fma(vf_set(c->m[i[k]]), at[k].y, vf_set(c->s0[i[k]]));
    for (int k = 0; k < STEP; k++) t[k] = vf_fma(vf_set(c->l01[i[k]]), at[k].y, vf_set(c->t0[i[k]]));
    for (int k = 0; k < STEP; k++) t[k] = vf_fma(vf_set(c->l00[i[k]]), at[k].x, t[k]);
    /* 1. o g in base 2 */
    for (int k = 0; k < STEP; k++) power[k] = vf_fnma(s[k], s[k], vf_set(c->power[i[k]]));
    for (int k = 0; k < STEP; k++) power[k] = vf_fnma(t[k], t[k], power[k]);
    vf_exp2(power, og, STEP);
    for (int k = 0; k < STEP; k++) og[k] = vf_keep(vf_ge(power[k], vf_set(LEAST_POWER)), og[k]);
}

/* The state of the blocks between chunks. */
typedef struct state {
    _Alignas(64) float running[SF_TILE_PIXELS];  /* T, also past the stop */
    _Alignas(64) float accepted[SF_TILE_PIXELS]; /* T after the last Gaussian that was blended */
    _Alignas(64) float rgb[3][SF_TILE_PIXELS], depth[SF_TILE_PIXELS];
} state;

/* One block through a chunk. Returns a Gaussian after which no pixel is left, or -1. */
VEC int blend_block(const chunk *c, uint8_t *list, int count, int block, int with_depth, state *st) {
    place at[STEP];
    for (int k = 0; k < STEP; k++) at[k] = place_of(block);
    int px = block * VW;
    vf T = vf_load(st->running + px), accepted = vf_load(st->accepted + px), depth = vf_load(st->depth + px);
    vf red = vf_load(st->rgb[0] + px), green = vf_load(st->rgb[1] + px), blue = vf_load(st->rgb[2] + px);
    int finished = -1, last = count ? list[count - 1] : 0;
    for (int k = 0; k < STEP; k++) list[count + k] = NOTHING;
    for (int first = 0; first < count && finished < 0; first += STEP) {
        const uint8_t *i = list + first;
        vf t[STEP], s[STEP], og[STEP];
        opacities(c, i, at, t, s, og);
        vm open = vf_ge(T, T);
        for (int k = 0; k < STEP; k++) {
            /* 2. opacity at this pixel */
            vf alpha = vf_min(og[k], vf_set(SF_ALPHA_MAX));
            /* 3. stop before the Gaussian that would bring T under the threshold: T runs on, its weight does
             * not count */
            vf next = vf_fnma(T, alpha, T);
            open = vf_ge(next, vf_set(SF_T_STOP));
            vf w = vf_keep(open, vf_mul(T, alpha));
            T = next;
            accepted = vf_select(open, next, accepted);
            /* 4. accumulate */
            red = vf_fma(w, vf_set(c->rgb[0][i[k]]), red);
            green = vf_fma(w, vf_set(c->rgb[1][i[k]]), green);
            blue = vf_fma(w, vf_set(c->rgb[2][i[k]]), blue);
            if (with_depth) depth = vf_fma(w, vf_set(c->depth[i[k]]), depth);
        }
        if (__builtin_expect(!vm_any(open), 0)) finished = first + STEP < count ? i[STEP - 1] : last;
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
    lists l;
    state st;
    for (int px = 0; px < SF_TILE_PIXELS; px++) {
        st.running[px] = st.accepted[px] = 1;
        st.rgb[0][px] = st.rgb[1][px] = st.rgb[2][px] = st.depth[px] = 0;
    }
    c.l00[NOTHING] = c.l01[NOTHING] = c.t0[NOTHING] = c.m[NOTHING] = c.s0[NOTHING] = 0;
    c.rgb[0][NOTHING] = c.rgb[1][NOTHING] = c.rgb[2][NOTHING] = c.depth[NOTHING] = 0;
    c.power[NOTHING] = nothing.log2_opacity;
    for (int block = 0; block < BLOCKS; block++) a->last[block] = a->count;
    uint64_t live = BLOCKS == 64 ? UINT64_MAX : ((uint64_t)1 << BLOCKS % 64) - 1;

    for (uint32_t begin = 0; begin < a->count && live; begin += CHUNK) {
        int n = a->count - begin < CHUNK ? (int)(a->count - begin) : CHUNK;
        for (int block = 0; block < BLOCKS; block++) l.count[block] = 0;
        for (int i = 0; i < n; i += VW) {
            gaussians g = gather(a, a->entries + begin, i, n, &c);
            cull(&g, i, n, &l, a->parts + begin);
        }
        for (uint64_t left = SF_BLEND_CULL_ONLY ? 0 : live; left; left &= left - 1) {
            int block = __builtin_ctzll(left);
            int finished = blend_block(&c, l.reaching[block], l.count[block], block, with_depth, &st);
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

void KERNEL(sf_blend)(const sf_blend_args *a) {
    if (a->depth)
        blend(a, 1);
    else
        blend(a, 0);
}

/* What the backward pass keeps of a block's pixels, side by side: apart by 4096 bytes, a load would wait for
 * the store before it. */
typedef struct pixels {
    place at;
    vf T;      /* also past the stop */
    vf behind; /* dL/dgamma . (C - S_i): what lies behind the entries so far */
    vf d_rgb[3];
} pixels;

static void load_pixels(const sf_blend_args *a, pixels p[BLOCKS]) {
    for (int block = 0; block < BLOCKS; block++, p++) {
        size_t at = (size_t)(block / ACROSS * VB_ROWS) * a->stride + (size_t)(block % ACROSS * VB_COLUMNS);
        p->at = place_of(block);
        p->T = vf_set(1);
        p->behind = vf_set(0);
        for (int ch = 0; ch < 3; ch++) {
            p->d_rgb[ch] = vf_load_block(a->d_rgb[ch] + at, a->stride);
            p->behind = vf_fma(p->d_rgb[ch], vf_load_block(a->rgb[ch] + at, a->stride), p->behind);
        }
    }
}

/* Pairs of the next Gaussians of a chunk, Gaussian by Gaussian. */
typedef struct pairs {
    int count;
    uint8_t gaussian[BATCH + BLOCKS], block[BATCH + BLOCKS];
    vf t[BATCH + STEP], s[BATCH + STEP], og[BATCH + STEP];
} pairs;

/* The blocks of a Gaussian. */
VEC void add_pairs(pairs *r, int i, uint64_t blocks) {
    memset(r->gaussian + r->count, i, BLOCKS);
    uint8_t *list = r->block + r->count;
    for (int block = 0; block < BLOCKS; block += VM_BITS)
        list += vm_list_bits(blocks >> block & ((1u << VM_BITS) - 1), block, list);
    r->count = (int)(list - r->block);
}

VEC void find_opacities(const chunk *c, const pixels *p, pairs *r) {
    for (int k = 0; k < STEP; k++)
        r->block[r->count + k] = 0, r->gaussian[r->count + k] = 0; /* fill the last step */
    for (int first = 0; first < r->count; first += STEP) {
        place at[STEP];
        for (int k = 0; k < STEP; k++) at[k] = p[r->block[first + k]].at;
        opacities(c, r->gaussian + first, at, r->t + first, r->s + first, r->og + first);
    }
}

/* Pair k of Gaussian i: its part of the nine sums. `opaque`: its opacity may be clamped. */
VEC void blend_bwd_pair(const chunk *c, int i, const pairs *r, int k, int opaque, pixels *p, vf sums[9]) {
    vf alpha = r->og[k], most = vf_set(SF_ALPHA_MAX);
    p += r->block[k];
    /* 2. opacity at this pixel */
    if (opaque) alpha = vf_min(alpha, most);
    vf T = p->T, next = vf_fnma(T, alpha, T);
    p->T = next;
    vm open = vf_ge(next, vf_set(SF_T_STOP)), sloped = open;
    /* 3. B.5b, and B.5a in its front-to-back form */
    vf w = vf_keep(open, vf_mul(T, alpha));
    for (int ch = 0; ch < 3; ch++) sums[ch] = vf_fma(w, p->d_rgb[ch], sums[ch]);
    vf along = vf_mul(p->d_rgb[0], vf_set(c->rgb[0][i]));
    along = vf_fma(p->d_rgb[1], vf_set(c->rgb[1][i]), along);
    along = vf_fma(p->d_rgb[2], vf_set(c->rgb[2][i]), along);
    vf behind = vf_fnma(w, along, p->behind);
    p->behind = behind;
    /* 4. moments; the clamp passes no gradient */
    vf ratio = vf_mul(alpha, vf_reciprocal(vf_sub(vf_set(1), alpha)));
    if (opaque) sloped = vm_and(open, vf_le(r->og[k], most));
    vf q = vf_keep(sloped, vf_fnma(behind, ratio, vf_mul(w, along)));
    vf qt = vf_mul(q, r->t[k]), qs = vf_mul(q, r->s[k]);
    sums[3] = vf_add(sums[3], q);
    sums[4] = vf_add(sums[4], qt);
    sums[5] = vf_add(sums[5], qs);
    sums[6] = vf_fma(qt, r->t[k], sums[6]);
    sums[7] = vf_fma(qt, r->s[k], sums[7]);
    sums[8] = vf_fma(qs, r->s[k], sums[8]);
}

/* What blend_importance keeps of a block's pixels beside those: what lies behind the entries so far, C - S_i,
 * the weight, and the weighted square error. */
typedef struct worth_pixels {
    vf behind[3], weight, error;
} worth_pixels;

static void load_worth(const sf_blend_args *a, const pixels p[BLOCKS], worth_pixels q[BLOCKS]) {
    for (int block = 0; block < BLOCKS; block++, p++, q++) {
        size_t at = (size_t)(block / ACROSS * VB_ROWS) * a->stride + (size_t)(block % ACROSS * VB_COLUMNS);
        q->weight = vf_load_block(a->weight + at, a->stride);
        q->error = vf_set(0);
        for (int ch = 0; ch < 3; ch++) {
            q->behind[ch] = vf_load_block(a->rgb[ch] + at, a->stride);
            q->error = vf_fma(p->d_rgb[ch], p->d_rgb[ch], q->error);
        }
    }
}

/* Pair k of Gaussian i: its part of the sums of blend_importance. */
VEC void blend_importance_pair(const chunk *c, int i, const pairs *r, int k, pixels *p, worth_pixels *q,
                               vf sums[SF_IMPORTANCE_SUMS]) {
    p += r->block[k], q += r->block[k];
    /* 2. opacity at this pixel */
    vf alpha = vf_min(r->og[k], vf_set(SF_ALPHA_MAX)), T = p->T, next = vf_fnma(T, alpha, T);
    p->T = next;
    vm open = vf_ge(next, vf_set(SF_T_STOP));
    /* 3. what the pixel has of it, and what it hides */
    vf w = vf_keep(open, vf_mul(T, alpha)), along = vf_set(0), square = vf_set(0);
    vf ratio = vf_keep(open, vf_mul(alpha, vf_reciprocal(vf_sub(vf_set(1), alpha))));
    for (int ch = 0; ch < 3; ch++) {
        vf of_it = vf_mul(w, vf_set(c->rgb[ch][i])), behind = vf_sub(q->behind[ch], of_it);
        q->behind[ch] = behind;
        vf part = vf_fnma(ratio, behind, of_it);
        sums[ch] = vf_fma(w, p->d_rgb[ch], sums[ch]);
        along = vf_fma(part, p->d_rgb[ch], along);
        square = vf_fma(part, part, square);
    }
    /* 4. sums */
    vf weighted = vf_mul(q->weight, w);
    sums[3] = vf_add(sums[3], along);
    sums[4] = vf_fma(q->weight, square, sums[4]);
    sums[5] = vf_fma(weighted, w, sums[5]);
    sums[6] = vf_fma(w, q->error, sums[6]);
    sums[7] = vf_add(sums[7], weighted);
}

/* The blocks that are still open at entry e; *until: the entry at which that changes. Without branches: which
 * blocks they are is not foreseeable. */
static uint64_t open_blocks(const uint32_t *last, uint32_t e, uint32_t *until) {
    uint64_t open = 0;
    uint32_t next = UINT32_MAX;
    for (int block = 0; block < BLOCKS; block++) {
        uint32_t closes = last[block] > e ? last[block] : UINT32_MAX;
        open |= (uint64_t)(last[block] > e) << block;
        next = closes < next ? closes : next;
    }
    *until = next;
    return open;
}

/* The sums of each entry over its pairs: those of blend_bwd, or of blend_importance. */
VEC void gather_sums(const sf_blend_args *a, int worth) {
    chunk c;
    pixels p[BLOCKS];
    worth_pixels q[BLOCKS];
    pairs r;
    load_pixels(a, p);
    if (worth) load_worth(a, p, q);
    uint32_t until = 0, count = 0;
    uint64_t open = 0;
    for (int block = 0; block < BLOCKS; block++) count = a->last[block] > count ? a->last[block] : count;
    for (uint32_t begin = 0; begin < count; begin += CHUNK) {
        int n = count - begin < CHUNK ? (int)(count - begin) : CHUNK;
        for (int i = 0; i < n; i += VW) gather(a, a->entries + begin, i, n, &c);
        for (int i = 0; i < n;) {
            int first = i, end[BATCH];
            for (r.count = 0; i < n && i - first < BATCH && r.count + BLOCKS <= BATCH; i++) {
                uint32_t e = begin + (uint32_t)i;
                if (e >= until) open = open_blocks(a->last, e, &until);
                if (e + AHEAD < count) __builtin_prefetch(a->sums + (size_t)a->slots[e + AHEAD] * SF_SUMS, 1);
                if (!SF_BLEND_CULL_ONLY) add_pairs(&r, i, a->parts[e] & open);
                end[i - first] = r.count;
            }
            find_opacities(&c, p, &r);
            for (int g = first, k = 0; g < i; g++) {
                vf sums[9];
                for (int j = 0; j < 9; j++) sums[j] = vf_set(0);
                if (worth)
                    for (; k < end[g - first]; k++) blend_importance_pair(&c, g, &r, k, p, q, sums);
                else if (c.power[g] > LOG2_ALPHA_MAX)
                    for (; k < end[g - first]; k++) blend_bwd_pair(&c, g, &r, k, 1, p, sums);
                else
                    for (; k < end[g - first]; k++) blend_bwd_pair(&c, g, &r, k, 0, p, sums);
                float *out = a->sums + (size_t)a->slots[begin + (uint32_t)g] * SF_SUMS;
                vf_sums8(sums, out);
                out[8] = vf_sum(sums[8]);
            }
        }
    }
    for (uint32_t e = count; e < a->count; e++)
        for (int k = 0; k < 9; k++) a->sums[(size_t)a->slots[e] * SF_SUMS + (size_t)k] = 0;
}

void KERNEL(sf_blend_bwd)(const sf_blend_args *a) { gather_sums(a, 0); }

#if !defined(SF_BLEND_VARIANT)
void KERNEL(sf_blend_importance)(const sf_blend_args *a) { gather_sums(a, 1); }
#endif
