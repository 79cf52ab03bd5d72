/* quality.c - PSNR, and PSNR with exposure corrected. */
#include "workspace.h"

#include <math.h>

#include "../base/statistics.h"

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
    for (size_t row = 0; row < (size_t)ws->eye.height; row++)
        for (size_t i = row * ws->stride; i < row * ws->stride + end; i++) {
            double weight = weight_at(ws, i), value = (double)ws->rgb[ch][i];
            double weighted = (double)ws->target[ch][i]; /* times the weight already */
            if (weighted >= WHITE * weight) continue;
            s.w += weight, s.x += weight * value, s.y += weighted;
            s.xx += weight * value * value, s.xy += weighted * value;
        }
    sf_line_fit(&s, 1e-9 * s.w * s.xx, gain, bias); /* a smaller variance is rounding */
    return s.w;
}

double sf_corrected_psnr(const sf_workspace *ws) {
    size_t width = (size_t)ws->eye.width, middle = width / 2;
    double squares = 0, weights = 0;
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        double gain, bias;
        if (!(fit_left(ws, ch, middle, &gain, &bias) > 0)) return NAN;
        for (size_t row = 0; row < (size_t)ws->eye.height; row++)
            for (size_t i = row * ws->stride + middle; i < row * ws->stride + width; i++) {
                double weight = weight_at(ws, i), value = gain * (double)ws->rgb[ch][i] + bias;
                if (!(weight > 0)) continue;
                double difference = fmin(fmax(value, 0), 1) - (double)ws->target[ch][i] / weight;
                squares += weight * difference * difference;
                weights += weight;
            }
    }
    return weights > 0 ? sf_psnr_of(squares / weights) : NAN;
}
