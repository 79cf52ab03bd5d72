/* loss.c - L1 and SSIM with weights, and their gradient (M.5). */
#include "reference.h"

#include <math.h>
#include <stdlib.h>

enum { RADIUS = 5 };
static const double SIGMA = 1.5, C1 = 1e-4, C2 = 9e-4;

/* One channel: x and y with their weights applied, and what becomes of them. */
typedef struct channel {
    int width, height;
    double *x, *y;
    double *mx, *my, *mxx, *myy, *mxy; /* windowed means of x, y, x^2, y^2, xy */
    double *d_mx, *d_sxx, *d_sxy;      /* dS/d of the mean (in all) and of the moments */
    double *f_mx, *f_sxx, *f_sxy;      /* these, windowed */
    double *scratch;
    double *block; /* all of the above */
} channel;

static void channel_create(channel *c, int width, int height) {
    size_t size = (size_t)width * (size_t)height;
    c->width = width;
    c->height = height;
    double **planes[] = {&c->x,    &c->y,     &c->mx,    &c->my,   &c->mxx,   &c->myy,   &c->mxy,
                         &c->d_mx, &c->d_sxx, &c->d_sxy, &c->f_mx, &c->f_sxx, &c->f_sxy, &c->scratch};
    size_t count = sizeof planes / sizeof *planes;
    c->block = test_ref_numbers(count * size);
    for (size_t i = 0; i < count; i++) *planes[i] = c->block + i * size;
}

static void window(double weights[2 * RADIUS + 1]) {
    double sum = 0;
    for (int i = -RADIUS; i <= RADIUS; i++) sum += weights[i + RADIUS] = exp(-i * i / (2 * SIGMA * SIGMA));
    for (int i = 0; i <= 2 * RADIUS; i++) weights[i] /= sum;
}

/* The windowed mean along one axis: `length` values, `step` apart, 0 beyond the ends. */
static void filter_line(const double *in, double *out, int length, size_t step, const double *weights) {
    for (int i = 0; i < length; i++) {
        double sum = 0;
        for (int k = -RADIUS; k <= RADIUS; k++)
            if (i + k >= 0 && i + k < length) sum += weights[k + RADIUS] * in[(size_t)(i + k) * step];
        out[(size_t)i * step] = sum;
    }
}

static void filter(const channel *c, const double *in, double *out) {
    double weights[2 * RADIUS + 1];
    window(weights);
    size_t width = (size_t)c->width;
    for (int j = 0; j < c->height; j++)
        filter_line(in + (size_t)j * width, c->scratch + (size_t)j * width, c->width, 1, weights);
    for (int i = 0; i < c->width; i++) filter_line(c->scratch + i, out + i, c->height, width, weights);
}

static void filter_product(const channel *c, const double *a, const double *b, double *out) {
    size_t size = (size_t)c->width * (size_t)c->height;
    for (size_t i = 0; i < size; i++) out[i] = a[i] * b[i];
    filter(c, out, out);
}

/* Fills in d_mx, d_sxx, d_sxy of a pixel and returns its S. */
static double ssim_pixel(channel *c, size_t i) {
    double mx = c->mx[i], my = c->my[i];
    double sxx = c->mxx[i] - mx * mx, syy = c->myy[i] - my * my, sxy = c->mxy[i] - mx * my;
    double a1 = 2 * mx * my + C1, a2 = 2 * sxy + C2, b1 = mx * mx + my * my + C1, b2 = sxx + syy + C2;
    double s = a1 * a2 / (b1 * b2);
    c->d_sxx[i] = -s / b2;
    c->d_sxy[i] = 2 * a1 / (b1 * b2);
    /* sxx and sxy hold mx too */
    c->d_mx[i] = 2 * my * a2 / (b1 * b2) - 2 * mx * s / b1 - 2 * mx * c->d_sxx[i] - my * c->d_sxy[i];
    return s;
}

/* The sum of 1 - S over a channel, and what ssim_gradient needs. */
static double ssim_channel(channel *c) {
    filter(c, c->x, c->mx);
    filter(c, c->y, c->my);
    filter_product(c, c->x, c->x, c->mxx);
    filter_product(c, c->y, c->y, c->myy);
    filter_product(c, c->x, c->y, c->mxy);
    double sum = 0;
    for (size_t i = 0; i < (size_t)c->width * (size_t)c->height; i++) sum += 1 - ssim_pixel(c, i);
    filter(c, c->d_mx, c->f_mx);
    filter(c, c->d_sxx, c->f_sxx);
    filter(c, c->d_sxy, c->f_sxy);
    return sum;
}

/* d(sum of S)/dx at a pixel. */
static double ssim_gradient(const channel *c, size_t i) {
    return c->f_mx[i] + 2 * c->x[i] * c->f_sxx[i] + c->y[i] * c->f_sxy[i];
}

test_ref_loss test_ref_compare(const test_ref_pair *pair, double *d_rgb) {
    size_t size = (size_t)pair->width * (size_t)pair->height;
    double weights = 0, l1 = 0, dssim = 0;
    for (size_t i = 0; i < size; i++) weights += pair->weight ? pair->weight[i] : 1;
    double unit = 1 / (3 * weights);

    test_ref_loss loss = {.branches = TEST_REF_NO_BRANCH};
    channel c;
    channel_create(&c, pair->width, pair->height);
    for (size_t k = 0; k < 3; k++) {
        for (size_t i = 0; i < size; i++) {
            double m = pair->weight ? pair->weight[i] : 1;
            c.x[i] = m * pair->rgb[3 * i + k];
            c.y[i] = m * pair->target[3 * i + k];
        }
        dssim += ssim_channel(&c);
        for (size_t i = 0; i < size; i++) {
            double difference = c.x[i] - c.y[i], far = fabs(difference), delta = pair->delta;
            double sign = (difference > 0) - (difference < 0),
                   slope = far < delta ? difference / delta : sign;
            l1 += far < delta ? 0.5 * difference * slope : far - 0.5 * delta;
            loss.branches = test_ref_branch(loss.branches, (uint64_t)(sign + 1) + 3 * (far < delta));
            if (!d_rgb) continue;
            double m = pair->weight ? pair->weight[i] : 1;
            d_rgb[3 * i + k] = m * unit * ((1 - pair->lambda) * slope - pair->lambda * ssim_gradient(&c, i));
        }
    }
    free(c.block);
    loss.l1 = l1 * unit;
    loss.ssim = 1 - dssim * unit;
    loss.loss = (1 - pair->lambda) * loss.l1 + pair->lambda * (1 - loss.ssim);
    return loss;
}
