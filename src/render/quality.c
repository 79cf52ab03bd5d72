/* quality.c - PSNR, SSIM, and PSNR with exposure corrected, of a picture or of the bands that several ranks
 * draw. */
#include "workspace.h"

#include <math.h>

#include "../base/statistics.h"
#include "shard.h"

/* NaN stays NaN: a target that is not finite must be noticed. */
double sf_psnr_of(double mse) { return -10 * log10(mse < 1e-10 ? 1e-10 : mse); }

static double weight_at(const sf_workspace *ws, size_t at) {
    return ws->has_weight ? (double)ws->weight[at] : 1.0;
}

/* Half a step of 8 bits below white. Above it a pixel may be overexposed: its true value is unknown. */
#define WHITE (1 - 0.5 / 255)

/* Fits target = gain x + bias by least squares to the columns left of `end`, without pixels where the target
 * is white; returns the sum of weights. */
static double fit_left(const sf_workspace *ws, int ch, size_t end, double *gain, double *bias) {
    sf_line_sums s = {0};
    size_t first_row, end_row;
    sf_shard_rows(ws, &first_row, &end_row);
    for (size_t row = first_row; row < end_row; row++)
        for (size_t i = row * ws->stride; i < row * ws->stride + end; i++) {
            double weight = weight_at(ws, i), value = (double)ws->rgb[ch][i];
            double weighted = (double)ws->target[ch][i]; /* times the weight already */
            if (weighted >= WHITE * weight) continue;
            s.w += weight, s.x += weight * value, s.y += weighted;
            s.xx += weight * value * value, s.xy += weighted * value;
        }
    double sums[] = {s.w, s.x, s.y, s.xx, s.xy};
    sf_shard_sum(ws, sums, sizeof sums / sizeof *sums);
    s.w = sums[0], s.x = sums[1], s.y = sums[2], s.xx = sums[3], s.xy = sums[4];
    sf_line_fit(&s, 1e-9 * s.w * s.xx, gain, bias); /* a smaller variance is rounding */
    return s.w;
}

/* Adds the weighted squared errors of gain x + bias, clamped to 0..1, in the columns from `from`, and the
 * weights. */
static void add_squares(const sf_workspace *ws, int ch, size_t from, double gain, double bias,
                        double sums[2]) {
    size_t first_row, end_row, width = (size_t)ws->eye.width;
    sf_shard_rows(ws, &first_row, &end_row);
    for (size_t row = first_row; row < end_row; row++)
        for (size_t i = row * ws->stride + from; i < row * ws->stride + width; i++) {
            double weight = weight_at(ws, i), value = gain * (double)ws->rgb[ch][i] + bias;
            if (!(weight > 0)) continue;
            double difference = fmin(fmax(value, 0), 1) - (double)ws->target[ch][i] / weight;
            sums[0] += weight * difference * difference;
            sums[1] += weight;
        }
}

/* psnr_corrected of sf_quality; NAN if a half has no weight. */
static double corrected_psnr(const sf_workspace *ws) {
    size_t middle = (size_t)ws->eye.width / 2;
    double sums[2] = {0};
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        double gain, bias;
        if (!(fit_left(ws, ch, middle, &gain, &bias) > 0)) return NAN;
        add_squares(ws, ch, middle, gain, bias, sums);
    }
    sf_shard_sum(ws, sums, 2);
    return sums[1] > 0 ? sf_psnr_of(sums[0] / sums[1]) : NAN;
}

/* The render is clamped at 2, not 1, because a darker exposure may show detail above white. */
#define BRIGHTEST 2.0f

/* Clamps the planes to 0..most where the loss reads them; NaN becomes 0. */
static void clamp_planes(sf_workspace *ws, float most) {
    size_t first_row, end_row;
    sf_shard_loss_rows(ws, &first_row, &end_row);
    for (int ch = 0; ch < SF_CHANNELS; ch++)
        for (size_t y = first_row; y < end_row; y++)
            for (size_t x = 0; x < (size_t)ws->eye.width; x++) {
                float *value = &ws->rgb[ch][y * ws->stride + x];
                *value = *value >= 0 ? (*value <= most ? *value : most) : 0.0f;
            }
}

void sf_stage_quality(sf_workspace *ws, double weight_sum, sf_quality *quality) {
    double sums[2] = {0};
    sf_loss_value value;
    clamp_planes(ws, BRIGHTEST);
    double corrected = corrected_psnr(ws);
    clamp_planes(ws, 1);
    for (int ch = 0; ch < SF_CHANNELS; ch++) add_squares(ws, ch, 0, 1, 0, sums);
    sf_shard_sum(ws, sums, 2);
    sf_stage_loss(ws, 0.2, 0, weight_sum, 1, 0, &value);
    quality->psnr = sf_psnr_of(sums[0] / (3 * weight_sum));
    quality->ssim = value.ssim;
    quality->psnr_corrected = isnan(corrected) ? quality->psnr : corrected;
}
