/* in_view.c - see in_view.h.
 *
 * The tight box of a Gaussian (M.1) reaches r sqrt(a) beyond u, with r^2 = 2 ln(255 o) < 2 ln 255 and
 * a <= (fx / z)^2 (1 + X^2) s^2 + low-pass, as the rows of J are that long and rotations lengthen nothing. So
 * for z > 0 it ends before column c where
 *     fx x + (cx + r sqrt(low-pass) - c) z + r fx sqrt(1 + X^2) s < 0,
 * with X at its clamp: linear in the mean and in s. Likewise on the other sides; and z <= near is out of
 * view.
 */
#include "in_view.h"

#include <float.h>
#include <math.h>

#include "../scene/gaussians.h"

/* sqrt(2 ln 255) is 3.3291; the rest, and PAD px, are for what rounding adds. */
#define MOST_REACH 3.34
#define PAD        0.05

/* A side of the picture: sign 1 for the first pixel's centre, -1 for the last one's. */
static void set_side(const sf_eye *eye, int axis, double sign, sf_frustum *f, int side) {
    double focal = axis ? (double)eye->fy : (double)eye->fx,
           middle = axis ? (double)eye->cy : (double)eye->cx;
    double clamp = axis ? (double)eye->clamp_y : (double)eye->clamp_x;
    double end = sign > 0 ? 0.5 : (axis ? eye->height : eye->width) - 0.5;
    double by_depth = sign * (middle - end) + MOST_REACH * sqrt(eye->low_pass) + PAD;
    const float *along = eye->R + 3 * axis, *forward = eye->R + 6;
    for (int k = 0; k < 3; k++)
        f->normal[side][k] = sign * focal * (double)along[k] + by_depth * (double)forward[k];
    f->offset[side] = sign * focal * (double)eye->t[axis] + by_depth * (double)eye->t[2];
    f->reach[side] = MOST_REACH * focal * sqrt(1 + clamp * clamp);
}

sf_frustum sf_frustum_of(const sf_eye *eye) {
    sf_frustum f;
    for (int side = 0; side < 4; side++) set_side(eye, side / 2, side % 2 ? -1 : 1, &f, side);
    /* a little nearer than the near plane */
    for (int k = 0; k < 3; k++) f.normal[4][k] = (double)eye->R[6 + k];
    f.offset[4] = (double)eye->t[2] - (1 - 1e-6) * (double)eye->near_plane;
    f.reach[4] = 0;
    return f;
}

/* Of each lane: the least and greatest value of each axis. odd: NaN where a value is not finite. No branches,
 * so that compilers vectorise it. */
typedef struct extent {
    float least[3][SF_LANES], most[3][SF_LANES], odd[SF_LANES];
} extent;

static void extend(extent *e, const float *block) {
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < SF_LANES; i++) {
            float x = block[k * SF_LANES + i];
            e->least[k][i] = x < e->least[k][i] ? x : e->least[k][i];
            e->most[k][i] = x > e->most[k][i] ? x : e->most[k][i];
            e->odd[i] += x - x;
        }
}

/* Returns whether all are finite. */
static int bound(const float *values, size_t first, size_t end, double least[3], double most[3]) {
    extent e = {.odd = {0}};
    float odd = 0;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < SF_LANES; i++) e.least[k][i] = FLT_MAX, e.most[k][i] = -FLT_MAX;
    for (size_t b = first; b < end; b++) extend(&e, values + 3 * SF_LANES * b);
    for (int k = 0; k < 3; k++) {
        float low = FLT_MAX, high = -FLT_MAX;
        for (int i = 0; i < SF_LANES; i++) {
            low = e.least[k][i] < low ? e.least[k][i] : low;
            high = e.most[k][i] > high ? e.most[k][i] : high;
            odd += e.odd[i];
        }
        least[k] = (double)low, most[k] = (double)high;
    }
    return odd == 0;
}

int sf_are_out_of_view(const sf_frustum *f, const sf_params *params, size_t first, size_t end) {
    double low[3], high[3], least[3], most[3];
    if (!bound(params->field[SF_FIELD_mean], first, end, low, high)) return 0;
    if (!bound(params->field[SF_FIELD_log_scale], first, end, least, most)) return 0;
    double scale = exp(fmax(fmax(most[0], most[1]), most[2]));
    for (int side = 0; side < SF_FRUSTUM_SIDES; side++) {
        double sum = f->offset[side] + f->reach[side] * scale, size = fabs(f->offset[side]);
        for (int k = 0; k < 3; k++) {
            double at = fmax(f->normal[side][k] * low[k], f->normal[side][k] * high[k]);
            sum += at, size += fabs(at);
        }
        if (sum < -1e-6 * size) return 1;
    }
    return 0;
}
