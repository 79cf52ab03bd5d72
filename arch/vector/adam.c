/* adam.c - one step of Adam (Kingma and Ba 2015, algorithm 1), and of RMSProp, in vectors of parameters. */
#include "kernels.h"

#include "vec.h"

void SF_AT_LEVEL(sf_adam)(float *p, const float *g, float *m, float *v, size_t n, const sf_adam *step) {
    vf beta1 = vf_set(step->beta1), rest1 = vf_set(1.0f - step->beta1);
    vf beta2 = vf_set(step->beta2), rest2 = vf_set(1.0f - step->beta2);
    vf rate = vf_set(step->rate), v_scale = vf_set(step->v_scale), epsilon = vf_set(step->epsilon);
    for (size_t i = 0; i < n; i += VW) {
        /* 1. moments */
        vf gradient = vf_load(g + i);
        vf first = vf_fma(beta1, vf_load(m + i), vf_mul(rest1, gradient));
        vf second = vf_fma(beta2, vf_load(v + i), vf_mul(rest2, vf_mul(gradient, gradient)));
        vf_store(m + i, first);
        vf_store(v + i, second);
        /* 2. the step */
        vf down = vf_add(vf_sqrt(vf_mul(second, v_scale)), epsilon);
        vf_store(p + i, vf_sub(vf_load(p + i), vf_div(vf_mul(rate, first), down)));
    }
}

void SF_AT_LEVEL(sf_adam_half)(float *p, const float *g, uint32_t *moments, size_t n, const sf_adam *step,
                               uint32_t number) {
    vf beta1 = vf_set(step->beta1), rest1 = vf_set(1.0f - step->beta1);
    vf beta2 = vf_set(step->beta2), rest2 = vf_set(1.0f - step->beta2);
    vf rate = vf_set(step->rate), v_scale = vf_set(step->v_scale), epsilon = vf_set(step->epsilon);
    vf least = vf_set(-SF_MOMENT_MOST), most = vf_set(SF_MOMENT_MOST);
    vu high = vu_set(0xffff0000u);
    _Alignas(64) uint32_t first_noise[VW];
    for (uint32_t i = 0; i < VW; i++) first_noise[i] = sf_noise(number + i);
    vu noise = vu_load(first_noise), stride = vu_set(sf_noise(VW));
    for (size_t i = 0; i < n; i += VW, noise = vu_add(noise, stride)) {
        vu word = vu_load(moments + i);
        vf gradient = vf_min(vf_max(vf_load(g + i), least), most);
        vf m = vf_of_bits(vu_and(word, high)), v = vf_of_bits(vu_right(vu_left(word, 16), 1));
        /* 1. moments */
        m = vf_fma(beta1, m, vf_mul(rest1, gradient));
        v = vf_fma(beta2, v, vf_mul(rest2, vf_mul(gradient, gradient)));
        /* 2. the step */
        vf down = vf_add(vf_sqrt(vf_mul(v, v_scale)), epsilon);
        vf_store(p + i, vf_sub(vf_load(p + i), vf_div(vf_mul(rate, m), down)));
        /* 3. rounding */
        vu above = vu_and(vu_add(vf_bits(m), vu_right(noise, 16)), high);
        vu below = vu_right(vu_add(vf_bits(v), vu_right(noise, 17)), 15);
        vu_store(moments + i, vu_or(above, below));
    }
}

void SF_AT_LEVEL(sf_rmsprop)(float *p, const float *g, float *v, size_t n, const sf_adam *step) {
    vf beta2 = vf_set(step->beta2), rest2 = vf_set(1.0f - step->beta2), third = vf_set(1.0f / 3);
    vf rate = vf_set(step->rate), v_scale = vf_set(step->v_scale), epsilon = vf_set(step->epsilon);
    for (size_t i = 0; i < n; i += VW) {
        size_t red = sf_at(i, 3, 0), green = red + SF_LANES, blue = green + SF_LANES;
        vf r = vf_load(g + red), gr = vf_load(g + green), b = vf_load(g + blue), before = vf_load(v + i);
        /* 1. the second moment, of all channels */
        vf square = vf_mul(vf_fma(b, b, vf_fma(gr, gr, vf_mul(r, r))), third);
        vf second = vf_fma(beta2, before, vf_mul(rest2, square));
        second = vf_select(vf_le(square, vf_set(0)), before, second);
        vf_store(v + i, second);
        /* 2. the step */
        vf along = vf_div(rate, vf_add(vf_sqrt(vf_mul(second, v_scale)), epsilon));
        vf_store(p + red, vf_fnma(along, r, vf_load(p + red)));
        vf_store(p + green, vf_fnma(along, gr, vf_load(p + green)));
        vf_store(p + blue, vf_fnma(along, b, vf_load(p + blue)));
    }
}
