/* spz_code.c - the fields of a Gaussian as the bytes of .spz files, and back. */
#include "quantise.h"
#include "spz.h"

enum { ROTATION_BITS = 10, ROTATION_MOST = (1 << 9) - 1, SH_ZERO = 128 };

static const double color_step = 0.15, scale_step = 16, scale_zero = 10, sh_unit = 128;

int sf_spz_width(const sf_spz_header *h, sf_spz_column column) {
    switch (column) {
    case SF_SPZ_MEANS:
        return h->version == 1 ? 6 : 9;
    case SF_SPZ_ALPHAS:
        return 1;
    case SF_SPZ_COLORS:
    case SF_SPZ_SCALES:
        return 3;
    case SF_SPZ_ROTATIONS:
        return h->version < 3 ? 3 : 4;
    default:
        return 3 * (sf_coefficients(h->sh_degree) - 1);
    }
}

/* ---- Out ---- */

static void encode_mean(int fraction, const float mean[3], uint8_t *to, sf_spz_clips *clips) {
    for (int k = 0; k < 3; k++) {
        double fixed = round(ldexp((double)mean[k], fraction));
        if (fabs(fixed) > SF_SPZ_MEAN_MOST) {
            fixed = copysign(SF_SPZ_MEAN_MOST, fixed);
            clips->means++;
        }
        uint32_t u = (uint32_t)(int32_t)fixed;
        for (int b = 0; b < 3; b++) *to++ = (uint8_t)(u >> (8 * b));
    }
}

/* Steps of a rotation's components that are written: of no effect in a render, and smaller to compress. */
enum { ROTATION_STEP = 4 };

/* The largest component follows from the others, whose signs are taken for it to be positive. Its place is
 * the top two bits; the others follow in the order x y z w, a sign and 9 bits of magnitude over sqrt(1/2)
 * each. */
static void encode_rotation(const float quat[4], uint8_t *to) {
    float unit[4];
    sf_unit_quat(quat, unit);
    const float xyzw[4] = {unit[1], unit[2], unit[3], unit[0]};
    uint32_t largest = 0;
    for (uint32_t i = 1; i < 4; i++)
        if (fabsf(xyzw[i]) > fabsf(xyzw[largest])) largest = i;
    uint32_t word = largest;
    for (uint32_t i = 0; i < 4; i++) {
        if (i == largest) continue;
        uint32_t magnitude =
            (uint32_t)lround(sqrt(2) * ROTATION_MOST * fabs((double)xyzw[i]) / ROTATION_STEP);
        uint32_t negative = magnitude && (xyzw[i] < 0) != (xyzw[largest] < 0);
        magnitude *= ROTATION_STEP;
        if (magnitude > ROTATION_MOST) magnitude = ROTATION_MOST;
        word = word << ROTATION_BITS | negative << (ROTATION_BITS - 1) | magnitude;
    }
    for (int b = 0; b < 4; b++) to[b] = (uint8_t)(word >> (8 * b));
}

/* Fewer bits are wider steps with the same zero: the bytes that are left out are what makes the column small.
 */
static uint8_t encode_sh(float value, int bits, sf_spz_clips *clips) {
    double step = 1 << (8 - bits);
    return sf_byte_of(SH_ZERO + step * round((double)value * sh_unit / step), &clips->sh);
}

void sf_spz_encode(const sf_spz_header *h, sf_spz_column column, const int sh_bits[2], const sf_gaussians *g,
                   uint8_t *to, sf_spz_clips *clips) {
    switch (column) {
    case SF_SPZ_MEANS:
        encode_mean(h->fraction, g->means, to, clips);
        break;
    case SF_SPZ_ALPHAS:
        *to = sf_byte_of(255 * sf_sigmoid((double)*g->logit_opacities), NULL);
        break;
    case SF_SPZ_COLORS:
        for (int c = 0; c < 3; c++)
            to[c] = sf_byte_of(255 * (0.5 + color_step * (double)g->sh[c]), &clips->colors);
        break;
    case SF_SPZ_SCALES:
        for (int k = 0; k < 3; k++)
            to[k] = sf_byte_of(scale_step * (scale_zero + (double)g->log_scales[k]), &clips->scales);
        break;
    case SF_SPZ_ROTATIONS:
        encode_rotation(g->quats, to);
        break;
    default:
        for (int i = 3; i < 3 * sf_coefficients(h->sh_degree); i++)
            *to++ = encode_sh(g->sh[i], sh_bits[i >= 12], clips);
    }
}

/* ---- In ---- */

static float half_value(unsigned half) {
    int exponent = (int)(half >> 10 & 31);
    double fraction = half & 1023, value;
    if (exponent == 31)
        value = fraction ? (double)NAN : (double)INFINITY;
    else
        value = exponent ? ldexp(1024 + fraction, exponent - 25) : ldexp(fraction, -24);
    return (float)(half >> 15 ? -value : value);
}

static void decode_mean(const sf_spz_header *h, const uint8_t *from, float mean[3]) {
    for (int k = 0; k < 3; k++) {
        if (h->version == 1) {
            mean[k] = half_value(from[2 * k] | (unsigned)from[2 * k + 1] << 8);
            continue;
        }
        int32_t fixed = from[3 * k] | from[3 * k + 1] << 8 | from[3 * k + 2] << 16;
        mean[k] = (float)ldexp(fixed - (fixed >> 23 << 24), -h->fraction);
    }
}

/* Before version 3: x y z in 8 bits each, with w not negative. */
static void decode_first_three(const uint8_t *from, float quat[4]) {
    double squares = 0;
    for (int k = 0; k < 3; k++) {
        double q = from[k] / 127.5 - 1;
        squares += q * q;
        quat[1 + k] = (float)q;
    }
    quat[0] = (float)sqrt(fmax(0, 1 - squares));
}

static void decode_smallest_three(const uint8_t *from, float quat[4]) {
    uint32_t word = from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
    int largest = (int)(word >> 30);
    double xyzw[4], squares = 0;
    for (int i = 3; i >= 0; i--) {
        if (i == largest) continue;
        double q = (word & ROTATION_MOST) / (sqrt(2) * ROTATION_MOST);
        xyzw[i] = word >> (ROTATION_BITS - 1) & 1 ? -q : q;
        squares += q * q;
        word >>= ROTATION_BITS;
    }
    xyzw[largest] = sqrt(fmax(0, 1 - squares));
    for (int i = 0; i < 4; i++) quat[(i + 1) % 4] = (float)xyzw[i];
}

void sf_spz_decode(const sf_spz_header *h, sf_spz_column column, int sh_degree, const uint8_t *from,
                   const sf_gaussians *g) {
    switch (column) {
    case SF_SPZ_MEANS:
        decode_mean(h, from, g->means);
        break;
    case SF_SPZ_ALPHAS:
        *g->logit_opacities = sf_logit_of_byte(*from);
        break;
    case SF_SPZ_COLORS:
        for (int c = 0; c < 3; c++) g->sh[c] = (float)((from[c] / 255.0 - 0.5) / color_step);
        break;
    case SF_SPZ_SCALES:
        for (int k = 0; k < 3; k++) g->log_scales[k] = (float)(from[k] / scale_step - scale_zero);
        break;
    case SF_SPZ_ROTATIONS:
        if (h->version < 3)
            decode_first_three(from, g->quats);
        else
            decode_smallest_three(from, g->quats);
        break;
    default:
        for (int i = 3; i < 3 * sf_coefficients(sh_degree); i++)
            g->sh[i] = (float)((*from++ - SH_ZERO) / sh_unit);
    }
}
