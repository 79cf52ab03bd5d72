/* channel.c - L1 and SSIM of one channel and their gradient, with bounds (M.5). */
#include "bounds.h"

#include <stdlib.h>

#include "reference.h"

enum { TAPS = 2 * SF_SSIM_RADIUS + 1, FILTER_ROUNDINGS = 2 + 5, LEAST_LANES = 4 };

/* Planes of width x height. */
typedef struct planes {
    int width, height;
    size_t size;
    bounded *x, *y, *squares, *product; /* x, y, x^2 + y^2, x y; then their means */
    bounded *map[3];                    /* G1 = dS/dmx - 2 mx dS/dsxx - my dS/dsxy, dS/dsxx, dS/dsxy */
    bounded *scratch;
} planes;

static bounded *plane(size_t size) { return (bounded *)(void *)test_ref_numbers(2 * size + 2); }

static void window(double weights[TAPS]) {
    double sum = 0;
    for (int i = 0; i < TAPS; i++) {
        double distance = i - SF_SSIM_RADIUS;
        sum += weights[i] = exp(-distance * distance / (2 * 1.5 * 1.5));
    }
    for (int i = 0; i < TAPS; i++) weights[i] /= sum;
}

/* A weight is rounded once and its product once. The partial sums of a bell, begun in its middle or at an
 * edge, come to five times the whole, and each of them is rounded. */
static void filter_line(const bounded *in, bounded *out, int length, size_t step, const double *weights) {
    for (int i = 0; i < length; i++) {
        double v = 0, e = 0, magnitude = 0;
        for (int k = 0; k < TAPS; k++) {
            int from = i + k - SF_SSIM_RADIUS;
            if (from < 0 || from >= length) continue;
            const bounded *at = &in[(size_t)from * step];
            v += weights[k] * at->v;
            e += weights[k] * at->e;
            magnitude += weights[k] * fabs(at->v);
        }
        out[(size_t)i * step] = (bounded){v, e + FILTER_ROUNDINGS * FLOAT_UNIT * (magnitude + e)};
    }
}

static void filter(const planes *p, bounded *in_out) {
    double weights[TAPS];
    size_t width = (size_t)p->width;
    window(weights);
    for (int y = 0; y < p->height; y++)
        filter_line(in_out + (size_t)y * width, p->scratch + (size_t)y * width, p->width, 1, weights);
    for (int x = 0; x < p->width; x++) filter_line(p->scratch + x, in_out + x, p->height, width, weights);
}

/* The four windowed means of a pixel: of x, y, x^2 + y^2, x y; and what M.5 makes of them: S, G1, dS/dsxx,
 * dS/dsxy. */
enum { FOUR = 4 };

static void compare(const bounded means[FOUR], bounded out[FOUR]) {
    bounded mx = means[0], my = means[1], C1 = b_round(1e-4, 0), C2 = b_round(9e-4, 0);
    bounded mxy = b_mul(mx, my), mm = b_fma(mx, mx, b_square(my)), sxy = b_sub(means[3], mxy);
    bounded A1 = b_add(b_twice(mxy), C1), A2 = b_add(b_twice(sxy), C2);
    bounded B1 = b_add(mm, C1), B2 = b_add(b_sub(means[2], mm), C2), B = b_mul(B1, B2);
    bounded A = b_mul(A1, A2), S = b_div(A, B);
    bounded d_sxx = b_negative(b_div(S, B2)), d_sxy = b_div(b_twice(A1), B);
    bounded d_mx = b_twice(b_sub(b_div(b_mul(my, A2), B), b_div(b_mul(mx, S), B1)));
    out[0] = S;
    out[1] = b_sub(b_sub(d_mx, b_mul(b_twice(mx), d_sxx)), b_mul(my, d_sxy));
    out[2] = d_sxx;
    out[3] = d_sxy;
}

/* The roundings of the formula itself, and what each mean's own error may do to the result: these errors go
 * into its terms together and mostly cancel, so that they are followed one by one. */
static void compare_means(const bounded means[FOUR], bounded out[FOUR]) {
    bounded exact[FOUR], moved[FOUR];
    for (int k = 0; k < FOUR; k++) exact[k] = (bounded){means[k].v, 0};
    compare(exact, out);
    for (int k = 0; k < FOUR; k++) {
        double worst[FOUR] = {0};
        for (int sign = -1; sign <= 1; sign += 2) {
            exact[k].v = means[k].v + sign * means[k].e;
            compare(exact, moved);
            for (int n = 0; n < FOUR; n++) worst[n] = fmax(worst[n], fabs(moved[n].v - out[n].v));
        }
        exact[k].v = means[k].v;
        for (int n = 0; n < FOUR; n++) out[n].e += worst[n];
    }
}

/* The sum of a row: in float32 by the lanes of a vector, or better. */
static bounded row_sum(const bounded *values, int width) {
    double v = 0, e = 0, magnitude = 0;
    for (int x = 0; x < width; x++) {
        v += values[x].v;
        e += values[x].e;
        magnitude += fabs(values[x].v);
    }
    return (bounded){v, e + ((double)width / LEAST_LANES + LEAST_LANES) * FLOAT_UNIT * magnitude};
}

/* Of a magnitude; both halves have the same value and slope where they meet, so that either is right there.
 */
static bounded huber(bounded d, double delta) {
    if (delta == 0) return d;
    bounded top = b_of(delta), h = d.v < delta ? d : top;
    bounded square = b_mul(h, b_mul(h, b_div(b_of(0.5), top)));
    return d.v < delta ? square : b_add(b_sub(d, top), square);
}

/* Its derivative by the difference. */
static bounded slope(bounded d, double delta) {
    if (delta == 0) return b_of((d.v > 0) - (d.v < 0));
    bounded s = b_mul(d, b_div(b_of(1), b_of(delta)));
    return (bounded){fmin(fmax(s.v, -1), 1), s.e};
}

void test_ref_loss_channel(const sf_loss_args *a, test_ref_channel *out) {
    size_t width = (size_t)a->width, height = (size_t)a->height, size = width * height;
    planes p = {a->width,    a->height,   size,        plane(size),
                plane(size), plane(size), plane(size), {plane(size), plane(size), plane(size)},
                plane(size)};
    bounded *x = plane(size), *y = plane(size), *weight = plane(size), *difference = plane(size);
    double delta = (double)a->delta;
    *out = (test_ref_channel){plane(height), plane(height), plane(size), calloc(size, 1)};
    for (size_t i = 0; i < size; i++) {
        size_t at = i / width * a->stride + i % width;
        weight[i] = b_of(a->weight ? (double)a->weight[at] : 1);
        x[i] = a->weight ? b_mul(b_of((double)a->x[at]), weight[i]) : b_of((double)a->x[at]);
        y[i] = b_of((double)a->y[at]);
        difference[i] = b_sub(x[i], y[i]);
        if (difference[i].v < 0) difference[i] = b_negative(difference[i]);
        difference[i] = huber(difference[i], delta);
        p.x[i] = x[i];
        p.y[i] = y[i];
        p.squares[i] = b_fma(x[i], x[i], b_square(y[i]));
        p.product[i] = b_mul(x[i], y[i]);
    }
    bounded *means[4] = {p.x, p.y, p.squares, p.product}, *S = p.squares;
    for (int k = 0; k < 4; k++) filter(&p, means[k]);
    for (size_t i = 0; i < size; i++) {
        const bounded pixel[FOUR] = {p.x[i], p.y[i], p.squares[i], p.product[i]};
        bounded result[FOUR];
        compare_means(pixel, result);
        S[i] = result[0];
        for (int k = 0; k < 3; k++) p.map[k][i] = result[1 + k];
    }
    for (int k = 0; k < 3; k++) filter(&p, p.map[k]);
    for (size_t row = 0; row < height; row++) {
        out->l1[row] = row_sum(difference + row * width, a->width);
        out->ssim[row] = row_sum(S + row * width, a->width);
    }
    for (size_t i = 0; i < size; i++) {
        bounded d = b_scale((double)a->l1_scale, slope(b_sub(x[i], y[i]), delta));
        out->cliff[i] = delta == 0 && x[i].e > 0 && fabs(x[i].v - y[i].v) <= 2 * x[i].e;
        if (a->ssim_scale != 0.0f) {
            bounded g = b_fma(b_twice(x[i]), p.map[1][i], p.map[0][i]);
            d = b_fma(b_of((double)a->ssim_scale), b_fma(y[i], p.map[2][i], g), d);
        }
        out->d_x[i] = b_mul(weight[i], d);
    }
    bounded *all[] = {p.x,      p.y,       p.squares, p.product, p.map[0], p.map[1],
                      p.map[2], p.scratch, x,         y,         weight,   difference};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) free(all[k]);
}
