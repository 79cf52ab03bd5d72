/* tile.c - a tile of Gaussians, the gradients of it and what each is worth, with bounds (M.1, M.2). */
#include "bounds.h"

#include <string.h>

/* As src/render/README.md has them; kernels hold them rounded. */
static const double MOST_ALPHA = 0.99, LEAST_ALPHA = 1.0 / 255, LEAST_TRANSMITTANCE = 1e-4;

/* The relative error of exp2 that arch/scalar/exp2.h states. */
static const double EXP2_ERROR = 2.4e-7;

/* One Gaussian at one pixel. */
typedef struct pair {
    bounded t, s;  /* the exponent's factors */
    bounded og;    /* o g */
    bounded alpha; /* alpha' */
    int saturated;
    int at_floor, at_clamp; /* within the bound of 1/255, of the clamp */
} pair;

/* t and s from offsets of the mean and the pixel within the tile: of the forms in use the one that rounds
 * most. 0 where nothing can be seen. */
static int whiten(const sf_splat *g, const sf_blend_args *a, int x, int y, pair *p) {
    bounded u = b_round((double)g->u - (a->x0 + 0.5), 0), v = b_round((double)g->v - (a->y0 + 0.5), 0);
    double t = (double)g->l00 * (x - u.v) + (double)g->l01 * (y - v.v), s = (double)g->m * (y - v.v);
    double span = fabs((double)g->l00) * (fabs(u.v) + x) + fabs((double)g->l01) * (fabs(v.v) + y);
    double rough = 8 * FLOAT_UNIT * (span + fabs(s));
    double nearest = fmax(fabs(t) - rough, 0), power = (double)g->log2_opacity - nearest * nearest;
    if (power < -8.5) return 0;
    bounded l00 = b_of((double)g->l00), l01 = b_of((double)g->l01), m = b_of((double)g->m);
    bounded t0 = b_negative(b_fma(l00, u, b_mul(l01, v))), s0 = b_negative(b_mul(m, v));
    p->t = b_fma(l00, b_of(x), b_fma(l01, b_of(y), t0));
    p->s = b_fma(m, b_of(y), s0);
    return 1;
}

/* 0: skipped, and not at the floor either. */
static int meet(const sf_splat *g, const sf_blend_args *a, int x, int y, pair *p) {
    if (!whiten(g, a, x, y, p)) return 0;
    bounded tt = b_square(p->t), ss = b_square(p->s);
    bounded power = b_sub(b_sub(b_of((double)g->log2_opacity), ss), tt);
    power.e += FLOAT_UNIT * (tt.v + ss.v); /* t^2 and s^2 may be added first */
    /* in base 2 an error of exp2 is one of 1/ln 2 times that in the exponent; the constant is rounded, too */
    bounded floor = b_widen(power, EXP2_ERROR / log(2) + 8 * FLOAT_UNIT);
    p->at_floor = b_near(floor, log2(LEAST_ALPHA));
    if (power.v < log2(LEAST_ALPHA)) return p->at_floor;
    p->og.v = exp2(power.v);
    p->og.e = p->og.v * (exp2(power.e) - 1 + EXP2_ERROR);
    p->at_clamp = b_near(b_widen(p->og, FLOAT_UNIT), MOST_ALPHA);
    p->saturated = p->og.v > MOST_ALPHA;
    p->alpha = p->og;
    if (p->saturated) p->alpha = b_round(MOST_ALPHA, p->at_clamp ? p->og.e : 0);
    return 1;
}

/* T (1 - alpha'), or T - T alpha'. */
static bounded dimmed(bounded T, bounded alpha) {
    double taken = T.v * alpha.v, left = T.v * (1 - alpha.v);
    double e = T.e * (1 - alpha.v) + T.v * alpha.e + T.e * alpha.e;
    return (bounded){left, e + FLOAT_UNIT * (taken + 2 * left)};
}

/* The next pair of a pixel. Returns 0 when no pair is left, or the pixel has stopped. */
typedef struct walk {
    const sf_blend_args *a;
    int x, y;
    uint32_t next; /* entry */
    bounded T;     /* before the pair */
    int at_floor, at_clamp, at_stop, stopped;
} walk;

static int step(walk *w, pair *p, uint32_t *entry) {
    for (; w->next < w->a->count; w->next++) {
        if (!meet(&w->a->splats[w->a->entries[w->next]], w->a, w->x, w->y, p)) continue;
        if (p->at_floor) {
            w->at_floor = 1; /* the pixel does not count any more */
            return 0;
        }
        w->at_clamp |= p->at_clamp;
        bounded next = dimmed(w->T, p->alpha);
        w->at_stop |= b_near(next, LEAST_TRANSMITTANCE);
        w->stopped = next.v < LEAST_TRANSMITTANCE;
        if (w->stopped) return 0;
        *entry = w->next++;
        return 1;
    }
    return 0;
}

static void blend_pixel(const sf_blend_args *a, int x, int y, test_ref_tile *tile) {
    int px = y * SF_TILE + x;
    walk w = {.a = a, .x = x, .y = y, .T = {1, 0}};
    pair p;
    uint32_t e;
    bounded rgb[3] = {{0, 0}}, depth = {0, 0};
    while (step(&w, &p, &e)) {
        const sf_splat *g = &a->splats[a->entries[e]];
        bounded weight = b_mul(p.alpha, w.T);
        for (int ch = 0; ch < 3; ch++) rgb[ch] = b_fma(weight, b_of((double)g->rgb[ch]), rgb[ch]);
        depth = b_fma(weight, b_of((double)g->depth), depth);
        w.T = dimmed(w.T, p.alpha);
        tile->pairs++;
        tile->saturated += (uint64_t)p.saturated;
    }
    for (int ch = 0; ch < 3; ch++) tile->rgb[ch][px] = b_fma(w.T, b_of((double)a->background[ch]), rgb[ch]);
    tile->transmittance[px] = w.T;
    tile->depth[px] = depth;
    tile->cliff[px] = w.at_floor || w.at_stop;
    tile->gradient_cliff[px] = tile->cliff[px] || w.at_clamp;
    tile->stopped += (uint64_t)w.stopped;
}

void test_ref_blend_tile(const sf_blend_args *a, test_ref_tile *tile) {
    memset(tile, 0, sizeof *tile);
    for (int y = 0; y < SF_TILE; y++)
        for (int x = 0; x < SF_TILE; x++) blend_pixel(a, x, y, tile);
}

/* A sum in no particular order: beside the errors of its terms, one rounding of the whole a term. */
typedef struct sum {
    double v, e, magnitude;
    unsigned terms;
} sum;

static void add(sum *s, bounded term) {
    s->v += term.v;
    s->e += term.e;
    s->magnitude += fabs(term.v);
    s->terms += term.v != 0 || term.e != 0;
}

/* M.2 for one pair. `behind` is dL/dgamma . (C - S_i). */
static void pair_backward(const pair *p, const sf_splat *g, bounded T, const bounded *d, bounded *behind,
                          sum sums[9]) {
    bounded w = b_mul(p->alpha, T), along = {0, 0};
    for (int ch = 0; ch < 3; ch++) {
        add(&sums[ch], b_mul(w, d[ch]));
        along = b_fma(d[ch], b_of((double)g->rgb[ch]), along);
    }
    bounded here = b_mul(w, along);
    *behind = b_sub(*behind, here);
    if (p->saturated) return;
    bounded ratio = b_div(p->alpha, b_sub(b_of(1), p->alpha)), beyond = b_mul(*behind, ratio);
    bounded q = b_sub(here, beyond), qt, qs;
    q.e += FLOAT_UNIT * (fabs(here.v) + fabs(beyond.v)); /* or alpha' is multiplied in last */
    qt = b_mul(q, p->t), qs = b_mul(q, p->s);
    const bounded moments[6] = {q, qt, qs, b_mul(qt, p->t), b_mul(qt, p->s), b_mul(qs, p->s)};
    for (int k = 0; k < 6; k++) add(&sums[3 + k], moments[k]);
}

static void pixel_backward(const sf_blend_args *a, int x, int y, const test_ref_tile *tile, sum (*sums)[9]) {
    int px = y * SF_TILE + x;
    walk w = {.a = a, .x = x, .y = y, .T = {1, 0}};
    pair p;
    uint32_t e;
    bounded d[3], behind = {0, 0};
    for (int ch = 0; ch < 3; ch++) {
        d[ch] = b_of((double)a->d_rgb[ch][(size_t)y * a->stride + (size_t)x]);
        behind = b_fma(d[ch], tile->rgb[ch][px], behind);
    }
    if (d[0].v == 0 && d[1].v == 0 && d[2].v == 0) return;
    while (step(&w, &p, &e)) {
        pair_backward(&p, &a->splats[a->entries[e]], w.T, d, &behind, sums[e]);
        w.T = dimmed(w.T, p.alpha);
    }
}

/* What one pair is worth. `behind` is C - S_i. Without the pair, what is behind would count 1 / (1 -
 * alpha') times: the pixel loses w c and gains alpha' / (1 - alpha') of what is behind. */
static void pair_worth(const pair *p, const sf_splat *g, bounded T, const bounded *d, bounded m,
                       bounded *behind, sum sums[9]) {
    bounded w = b_mul(p->alpha, T), ratio = b_div(p->alpha, b_sub(b_of(1), p->alpha)), loss[3];
    for (int ch = 0; ch < 3; ch++) {
        bounded here = b_mul(w, b_of((double)g->rgb[ch]));
        behind[ch] = b_sub(behind[ch], here);
        loss[ch] = b_sub(here, b_mul(ratio, behind[ch]));
        add(&sums[ch], b_mul(w, d[ch]));
    }
    add(&sums[3], b_dot3(loss, d));
    add(&sums[4], b_mul(m, b_dot3(loss, loss)));
    add(&sums[5], b_mul(m, b_square(w)));
    add(&sums[6], b_mul(w, b_dot3(d, d)));
    add(&sums[7], b_mul(m, w));
}

static void pixel_worth(const sf_blend_args *a, int x, int y, const test_ref_tile *tile, sum (*sums)[9]) {
    size_t at = (size_t)y * a->stride + (size_t)x;
    walk w = {.a = a, .x = x, .y = y, .T = {1, 0}};
    pair p;
    uint32_t e;
    bounded d[3], behind[3], m = b_of((double)a->weight[at]);
    for (int ch = 0; ch < 3; ch++) {
        d[ch] = b_of((double)a->d_rgb[ch][at]);
        behind[ch] = tile->rgb[ch][y * SF_TILE + x];
    }
    if (m.v == 0 && d[0].v == 0 && d[1].v == 0 && d[2].v == 0) return;
    while (step(&w, &p, &e)) {
        pair_worth(&p, &a->splats[a->entries[e]], w.T, d, m, behind, sums[e]);
        w.T = dimmed(w.T, p.alpha);
    }
}

typedef void (*pixel_fn)(const sf_blend_args *a, int x, int y, const test_ref_tile *tile, sum (*sums)[9]);

static void sum_pixels(const sf_blend_args *a, const test_ref_tile *tile, pixel_fn pixel, bounded (*out)[9]) {
    static sum sums[4096][9];
    memset(sums, 0, sizeof sums[0] * a->count);
    for (int y = 0; y < SF_TILE; y++)
        for (int x = 0; x < SF_TILE; x++) pixel(a, x, y, tile, sums);
    for (uint32_t e = 0; e < a->count; e++)
        for (int k = 0; k < 9; k++) {
            const sum *s = &sums[e][k];
            out[e][k] = (bounded){s->v, s->e + (s->terms + 1) * FLOAT_UNIT * s->magnitude};
        }
}

void test_ref_blend_tile_backward(const sf_blend_args *a, const test_ref_tile *tile, bounded (*out)[9]) {
    sum_pixels(a, tile, pixel_backward, out);
}

void test_ref_blend_tile_worth(const sf_blend_args *a, const test_ref_tile *tile, bounded (*out)[9]) {
    sum_pixels(a, tile, pixel_worth, out);
}
