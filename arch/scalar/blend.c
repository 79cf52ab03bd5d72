/* blend.c - one tile, front to back, and the gradient of it, in plain C. */
#include "scalar.h"

#include "exp2.h"
#include "interval.h"

/* The rows and, in a row, the columns of the tile that a Gaussian may reach; the threshold inside decides. */
static int first_index(float from, int origin) {
    float x = ceilf(from - 0.5f) - (float)origin;
    return x > 0 ? (x < SF_TILE ? (int)x : SF_TILE) : 0;
}

static int end_index(float to, int origin) {
    float x = floorf(to - 0.5f) - (float)origin + 1.0f;
    return x > 0 ? (x < SF_TILE ? (int)x : SF_TILE) : 0;
}

/* A Gaussian in one row of the tile. */
typedef struct row_span {
    int x0, x1;
    float dx0;       /* offset of column 0's centre */
    float t_row, ss; /* t at dx = 0; s^2 */
    float s;
} row_span;

static row_span row_of(const sf_splat *g, const sf_blend_args *a, int y) {
    row_span row;
    float dy = (float)(a->y0 + y) + 0.5f - g->v, left, right;
    sf_interval(g, dy, dy, &left, &right);
    row.x0 = first_index(left, a->x0);
    row.x1 = end_index(right, a->x0);
    row.dx0 = (float)a->x0 + 0.5f - g->u;
    row.t_row = g->l01 * dy;
    row.s = g->m * dy;
    row.ss = row.s * row.s;
    return row;
}

static int first_row_of(const sf_splat *g, const sf_blend_args *a) {
    return first_index(g->v - g->half_height - 0.01f, a->y0);
}

static int end_row_of(const sf_splat *g, const sf_blend_args *a) {
    return end_index(g->v + g->half_height + 0.01f, a->y0);
}

/* The distance along the row's own axis; with row.s it is the Gaussian's exponent (B.2). */
static inline float t_at(const sf_splat *g, const row_span *row, int x) {
    return row->t_row + g->l00 * (row->dx0 + (float)x);
}

/* Its opacity o g at a pixel of the row, before the clamp; 0 where it is too faint to count. */
static inline float opacity_at(const sf_splat *g, const row_span *row, float t) {
    float power = g->log2_opacity - (t * t + row->ss);
    if (power < -8.0f) return 0.0f;
    float opacity = sf_exp2(power);
    return opacity < SF_ALPHA_MIN ? 0.0f : opacity;
}

void sf_blend_scalar(const sf_blend_args *a) {
    float T[SF_TILE_PIXELS], color[SF_TILE_PIXELS][3], depth[SF_TILE_PIXELS];
    uint8_t finished[SF_TILE_PIXELS];
    int live = SF_TILE_PIXELS;
    for (int px = 0; px < SF_TILE_PIXELS; px++) {
        T[px] = 1.0f;
        color[px][0] = color[px][1] = color[px][2] = depth[px] = 0.0f;
        finished[px] = 0;
        a->last[px] = 0;
    }

    for (uint32_t e = 0; e < a->count && live; e++) {
        const sf_splat *g = &a->splats[a->entries[e]];
        for (int y = first_row_of(g, a), y_end = end_row_of(g, a); y < y_end; y++) {
            row_span row = row_of(g, a, y);
            for (int x = row.x0; x < row.x1; x++) {
                int px = y * SF_TILE + x;
                if (finished[px]) continue;
                /* 1. opacity at this pixel */
                float alpha = opacity_at(g, &row, t_at(g, &row, x));
                if (alpha == 0.0f) continue;
                if (alpha > SF_ALPHA_MAX) alpha = SF_ALPHA_MAX;
                /* 2. stop before the Gaussian that would bring T under the threshold */
                float T_next = T[px] * (1.0f - alpha);
                if (T_next < SF_T_STOP) {
                    finished[px] = 1;
                    live--;
                    continue;
                }
                /* 3. accumulate */
                float w = alpha * T[px];
                for (int ch = 0; ch < 3; ch++) color[px][ch] += w * g->rgb[ch];
                depth[px] += w * g->depth;
                T[px] = T_next;
                a->last[px] = e + 1;
            }
        }
    }

    for (int y = 0; y < SF_TILE; y++)
        for (int x = 0; x < SF_TILE; x++) {
            int px = y * SF_TILE + x;
            size_t at = (size_t)y * a->stride + (size_t)x;
            for (int ch = 0; ch < 3; ch++) a->rgb[ch][at] = color[px][ch] + T[px] * a->background[ch];
            a->transmittance[at] = T[px];
            if (a->depth) a->depth[at] = depth[px];
        }
}

void sf_blend_bwd_scalar(const sf_blend_args *a) {
    float T[SF_TILE_PIXELS], d_rgb[SF_TILE_PIXELS][3];
    float behind[SF_TILE_PIXELS]; /* dL/dgamma . (C - S_i): what lies behind the entries so far */
    uint32_t last = 0;
    for (int y = 0; y < SF_TILE; y++)
        for (int x = 0; x < SF_TILE; x++) {
            int px = y * SF_TILE + x;
            size_t at = (size_t)y * a->stride + (size_t)x;
            T[px] = 1.0f;
            behind[px] = 0.0f;
            for (int ch = 0; ch < 3; ch++) {
                d_rgb[px][ch] = a->d_rgb[ch][at];
                behind[px] += d_rgb[px][ch] * a->rgb[ch][at];
            }
            if (a->last[px] > last) last = a->last[px];
        }

    for (uint32_t e = 0; e < a->count; e++) {
        float *sums = a->sums + (size_t)a->slots[e] * SF_SUMS;
        for (int k = 0; k < 9; k++) sums[k] = 0.0f;
        if (e >= last) continue;
        const sf_splat *g = &a->splats[a->entries[e]];
        for (int y = first_row_of(g, a), y_end = end_row_of(g, a); y < y_end; y++) {
            row_span row = row_of(g, a, y);
            /* s is constant in the row: its factor goes in once a row */
            float row_p = 0, row_pt = 0, row_ptt = 0;
            for (int x = row.x0; x < row.x1; x++) {
                int px = y * SF_TILE + x;
                if (e >= a->last[px]) continue;
                /* 1. opacity at this pixel */
                float t = t_at(g, &row, x);
                float alpha = opacity_at(g, &row, t);
                if (alpha == 0.0f) continue;
                int clamped = alpha > SF_ALPHA_MAX;
                if (clamped) alpha = SF_ALPHA_MAX;
                /* 2. B.5b, and B.5a in its front-to-back form */
                float w = alpha * T[px], along = 0;
                for (int ch = 0; ch < 3; ch++) {
                    sums[ch] += w * d_rgb[px][ch];
                    along += d_rgb[px][ch] * g->rgb[ch];
                }
                behind[px] -= w * along;
                float d_alpha = T[px] * along - behind[px] / (1.0f - alpha);
                T[px] *= 1.0f - alpha;
                /* 3. moments; the clamp passes no gradient */
                float p = clamped ? 0.0f : d_alpha * alpha;
                row_p += p;
                row_pt += p * t;
                row_ptt += p * (t * t);
            }
            sums[3] += row_p;
            sums[4] += row_pt;
            sums[5] += row_p * row.s;
            sums[6] += row_ptt;
            sums[7] += row_pt * row.s;
            sums[8] += row_p * row.ss;
        }
    }
}

void sf_blend_importance_scalar(const sf_blend_args *a) {
    float T[SF_TILE_PIXELS], d_rgb[SF_TILE_PIXELS][3], behind[SF_TILE_PIXELS][3]; /* C - S_i */
    float weight[SF_TILE_PIXELS], error[SF_TILE_PIXELS];
    uint32_t last = 0;
    for (int y = 0; y < SF_TILE; y++)
        for (int x = 0; x < SF_TILE; x++) {
            int px = y * SF_TILE + x;
            size_t at = (size_t)y * a->stride + (size_t)x;
            T[px] = 1.0f;
            weight[px] = a->weight[at];
            error[px] = 0.0f;
            for (int ch = 0; ch < 3; ch++) {
                d_rgb[px][ch] = a->d_rgb[ch][at];
                behind[px][ch] = a->rgb[ch][at];
                error[px] += d_rgb[px][ch] * d_rgb[px][ch];
            }
            if (a->last[px] > last) last = a->last[px];
        }

    for (uint32_t e = 0; e < a->count; e++) {
        float *sums = a->sums + (size_t)a->slots[e] * SF_SUMS;
        for (int k = 0; k < SF_IMPORTANCE_SUMS; k++) sums[k] = 0.0f;
        if (e >= last) continue;
        const sf_splat *g = &a->splats[a->entries[e]];
        for (int y = first_row_of(g, a), y_end = end_row_of(g, a); y < y_end; y++) {
            row_span row = row_of(g, a, y);
            for (int x = row.x0; x < row.x1; x++) {
                int px = y * SF_TILE + x;
                if (e >= a->last[px]) continue;
                /* 1. opacity at this pixel */
                float alpha = opacity_at(g, &row, t_at(g, &row, x));
                if (alpha == 0.0f) continue;
                if (alpha > SF_ALPHA_MAX) alpha = SF_ALPHA_MAX;
                /* 2. what the pixel has of it, and what it hides */
                float w = alpha * T[px], ratio = alpha / (1.0f - alpha), square = 0, along = 0;
                for (int ch = 0; ch < 3; ch++) {
                    behind[px][ch] -= w * g->rgb[ch];
                    float part = w * g->rgb[ch] - ratio * behind[px][ch];
                    sums[ch] += w * d_rgb[px][ch];
                    along += part * d_rgb[px][ch];
                    square += part * part;
                }
                T[px] *= 1.0f - alpha;
                /* 3. sums */
                sums[3] += along;
                sums[4] += weight[px] * square;
                sums[5] += weight[px] * w * w;
                sums[6] += w * error[px];
                sums[7] += weight[px] * w;
            }
        }
    }
}
