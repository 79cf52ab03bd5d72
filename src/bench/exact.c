/* exact.c - blending in float64, straight from M.1 and M.2 of src/render/README.md. */
#include "exact.h"

#include <math.h>

/* A pair is taken for one at a threshold within these: of o g in base 2, of T relative to its own threshold.
 */
#define EDGE_POWER 1e-4
#define EDGE_T     1e-3
#define EDGE_CLAMP 1e-5

exact_pair exact_evaluate(const sf_splat *s, int x, int y) {
    double dx = x + 0.5 - (double)s->u, dy = y + 0.5 - (double)s->v;
    exact_pair p = {.t = (double)s->l00 * dx + (double)s->l01 * dy, .s = (double)s->m * dy};
    double power = (double)s->log2_opacity - p.t * p.t - p.s * p.s;
    p.on_edge = fabs(power + SF_LOG2_255) < EDGE_POWER;
    p.visible = power >= -SF_LOG2_255;
    if (!p.visible) return p;
    double og = exp2(power), most = (double)SF_ALPHA_MAX;
    p.clamped = og > most;
    p.alpha = p.clamped ? most : og;
    p.on_edge |= fabs(og / most - 1) < EDGE_CLAMP;
    return p;
}

int exact_interval(const sf_splat *s, double dy0, double dy1, double *left, double *right) {
    double high = (double)s->half_height + 0.01, pad = 0.01;
    if (dy0 > high || dy1 < -high) return 0;
    double lean = (double)s->lean, reach = (double)s->reach, squeeze = (double)s->squeeze;
    double at_right = fmin(fmax(lean, dy0), dy1), at_left = fmin(fmax(-lean, dy0), dy1);
    *right = (double)s->u + (double)s->slope * at_right +
             sqrt(fmax(reach - squeeze * at_right * at_right, 0)) + pad;
    *left =
        (double)s->u + (double)s->slope * at_left - sqrt(fmax(reach - squeeze * at_left * at_left, 0)) - pad;
    return 1;
}

/* A tile's pixels on their way front to back. */
typedef struct tile {
    const sf_workspace *ws;
    exact *ex;
    int x0, y0;
    uint32_t begin, end;
    double T[SF_TILE_PIXELS], rgb[SF_TILE_PIXELS][3];
    double behind[SF_TILE_PIXELS]; /* dL/dgamma . (C - S_i) */
    uint8_t finished[SF_TILE_PIXELS];
} tile;

static size_t plane_at(const tile *t, int px) {
    return (size_t)(t->y0 + px / SF_TILE) * t->ws->stride + (size_t)(t->x0 + px % SF_TILE);
}

/* One pixel past one Gaussian; backwards where `sums` is given. */
typedef void (*visit_fn)(tile *t, const sf_splat *s, int px, const exact_pair *p, double *sums);

static void forward(tile *t, const sf_splat *s, int px, const exact_pair *p, double *sums) {
    (void)sums;
    for (int ch = 0; ch < 3; ch++) t->rgb[px][ch] += p->alpha * t->T[px] * (double)s->rgb[ch];
}

static void backward(tile *t, const sf_splat *s, int px, const exact_pair *p, double *sums) {
    double along = 0, w = p->alpha * t->T[px];
    for (int ch = 0; ch < 3; ch++) {
        double d = (double)t->ws->d_rgb[ch][plane_at(t, px)];
        sums[ch] += w * d;
        along += d * (double)s->rgb[ch];
    }
    t->behind[px] -= w * along;
    double q = p->clamped ? 0 : p->alpha * (t->T[px] * along - t->behind[px] / (1 - p->alpha));
    double moments[] = {q, q * p->t, q * p->s, q * p->t * p->t, q * p->t * p->s, q * p->s * p->s};
    for (int k = 0; k < 6; k++) sums[3 + k] += moments[k];
}

static void visit_pixel(tile *t, const sf_splat *s, int px, visit_fn visit, double *sums) {
    if (t->finished[px]) return;
    exact_pair p = exact_evaluate(s, t->x0 + px % SF_TILE, t->y0 + px / SF_TILE);
    uint8_t *left_out = &t->ex->left_out[plane_at(t, px)];
    *left_out |= (uint8_t)p.on_edge;
    if (!p.visible) return;
    double next = t->T[px] * (1 - p.alpha), stop = (double)SF_T_STOP;
    *left_out |= fabs(next / stop - 1) < EDGE_T;
    t->finished[px] = next < stop;
    if (t->finished[px]) return;
    visit(t, s, px, &p, sums);
    t->T[px] = next;
}

static void visit_tile(tile *t, visit_fn visit) {
    for (int px = 0; px < SF_TILE_PIXELS; px++) t->T[px] = 1, t->finished[px] = 0;
    for (uint32_t e = t->begin; e < t->end; e++) {
        uint32_t i = t->ws->entries[e];
        const sf_splat *s = &t->ws->splats[i];
        for (int y = 0; y < SF_TILE; y++) {
            double left, right, dy = t->y0 + y + 0.5 - (double)s->v;
            if (!exact_interval(s, dy, dy, &left, &right)) continue;
            for (int x = 0; x < SF_TILE; x++) {
                double center = t->x0 + x + 0.5;
                if (center >= left && center <= right)
                    visit_pixel(t, s, y * SF_TILE + x, visit, t->ex->sums + (size_t)i * EXACT_SUMS);
            }
        }
    }
}

/* The picture of a tile; what lies behind each pixel before its first Gaussian; no gradient where left out.
 */
static void finish_forward(tile *t, sf_workspace *ws) {
    for (int px = 0; px < SF_TILE_PIXELS; px++) {
        size_t at = plane_at(t, px);
        t->behind[px] = 0;
        for (int ch = 0; ch < 3; ch++) {
            double value = t->rgb[px][ch] + t->T[px] * (double)ws->background[ch];
            t->ex->rgb[(size_t)ch * t->ex->pixels + at] = value;
            if (t->ex->left_out[at]) ws->d_rgb[ch][at] = 0;
            t->behind[px] += (double)ws->d_rgb[ch][at] * value;
        }
    }
}

static sf_status room(sf_context *ctx, exact *ex) {
    ex->rgb = sf_calloc(ctx, ex->pixels, SF_CHANNELS * sizeof(double));
    ex->left_out = sf_calloc(ctx, ex->pixels, 1);
    ex->sums = sf_calloc(ctx, ex->gaussians, EXACT_SUMS * sizeof(double));
    if (ex->rgb && ex->left_out && ex->sums) return SF_OK;
    exact_destroy(ctx, ex);
    return SF_ERR_MEMORY;
}

sf_status exact_create(sf_workspace *ws, exact *ex) {
    *ex = (exact){.pixels = ws->plane_rows * ws->stride, .gaussians = ws->count};
    sf_status status = room(ws->ctx, ex);
    if (status) return status;
    int tiles = ws->eye.tiles_x * ws->eye.tiles_y;
    for (int i = 0; i < tiles; i++) {
        tile t = {.ws = ws,
                  .ex = ex,
                  .x0 = i % ws->eye.tiles_x * SF_TILE,
                  .y0 = i / ws->eye.tiles_x * SF_TILE,
                  .begin = ws->tile_begin[i],
                  .end = ws->tile_begin[i + 1]};
        visit_tile(&t, forward);
        finish_forward(&t, ws);
        visit_tile(&t, backward);
    }
    return SF_OK;
}

void exact_destroy(sf_context *ctx, exact *ex) {
    sf_free(ctx, ex->rgb);
    sf_free(ctx, ex->left_out);
    sf_free(ctx, ex->sums);
    *ex = (exact){0};
}
