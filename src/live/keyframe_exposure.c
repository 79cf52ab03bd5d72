/* keyframe_exposure.c - exposures of keyframes: from their light, from their neighbours, from the fit. */
#include "keyframe_exposure.h"

#include <math.h>

#include "../fit/online.h"

/* sRGB: value = (1 + offset) light^(1 / power) - offset */
#define SRGB_POWER  2.4
#define SRGB_OFFSET 0.055

/* The mean of the logarithms of what light the training keyframes had. NAN: of one it is not known. */
static double usual_light(const sf_keyframes *keyframes) {
    double sum = 0, n = 0;
    for (size_t i = 0; i < keyframes->count; i++)
        if (!keyframes->list[i].held_out) sum += log(keyframes->list[i].light), n++;
    return isfinite(sum) && n > 0 ? sum / n : NAN;
}

/* The exposure that the light of a keyframe gives to values in sRGB, but for the darkest. Where all exposures
 * started alike, each new picture taught the model its own exposure where nothing else was seen, and a path
 * through brighter and darker places ended in colours that follow the exposures along it. 0, and nothing
 * changes: the light is not known. */
static int exposure_of_light(const sf_keyframes *keyframes, const sf_keyframe *k, double gain[3],
                             double bias[3]) {
    double usual = usual_light(keyframes), by = exp((log(k->light) - usual) / SRGB_POWER);
    for (int c = 0; c < 3 && !isnan(usual); c++) gain[c] = by, bias[c] = SRGB_OFFSET * (by - 1);
    return !isnan(usual);
}

int sf_neighbours_exposure(const sf_keyframes *keyframes, const sf_fitter *fitter, size_t at, double gain[3],
                           double bias[3]) {
    double log_gain[3] = {0}, sum[3] = {0};
    int n = 0;
    for (int way = -1; way <= 1; way += 2) {
        size_t i = at + (size_t)way; /* past 0 it wraps */
        while (i < keyframes->count && !keyframes->list[i].told) i += (size_t)way;
        if (i >= keyframes->count) continue;
        double g[3] = {1, 1, 1}, b[3] = {0};
        double by = exp(log(keyframes->list[at].light / keyframes->list[i].light) / SRGB_POWER);
        if (isnan(by)) by = 1;
        (void)sf_fitter_get_exposure(fitter, keyframes->list[i].id, g, b);
        for (int c = 0; c < 3; c++)
            log_gain[c] += log(by * g[c]), sum[c] += by * b[c] + SRGB_OFFSET * (by - 1);
        n++;
    }
    for (int c = 0; c < 3 && n; c++) gain[c] = exp(log_gain[c] / n), bias[c] = sum[c] / n;
    return n > 0;
}

/* Before the fit has learned it. */
static int first_exposure(const sf_keyframes *keyframes, const sf_fitter *fitter, size_t at, double gain[3],
                          double bias[3]) {
    return exposure_of_light(keyframes, &keyframes->list[at], gain, bias) ||
           sf_neighbours_exposure(keyframes, fitter, at, gain, bias);
}

void sf_keyframe_exposure(const sf_keyframes *keyframes, const sf_fitter *fitter, uint32_t id, double gain[3],
                          double bias[3]) {
    size_t at = keyframes->count;
    for (int c = 0; c < 3; c++) gain[c] = 1, bias[c] = 0;
    while (at && keyframes->list[at - 1].id != id) at--;
    if (!at) return;
    if (keyframes->list[at - 1].told)
        (void)sf_fitter_get_exposure(fitter, id, gain, bias);
    else
        (void)first_exposure(keyframes, fitter, at - 1, gain, bias);
}

void sf_tell_fit(sf_keyframes *keyframes, sf_fitter *fitter) {
    for (size_t i = keyframes->count; i--;) {
        sf_keyframe *k = &keyframes->list[i];
        if (k->told || k->held_out || !sf_online_has_view(fitter, k->id)) continue;
        if (k->hold) (void)sf_fitter_hold_pose(fitter, k->id);
        double gain[3], bias[3];
        if (first_exposure(keyframes, fitter, i, gain, bias))
            (void)sf_fitter_set_exposure(fitter, k->id, gain, bias);
        k->told = 1;
    }
}
