/* sh.h - the basis functions of M.4 and their gradients, in vectors of Gaussians. */
#ifndef SF_ARCH_VECTOR_SH_H
#define SF_ARCH_VECTOR_SH_H

#include "vec.h"

#define SH_C0  0.28209479177387814f
#define SH_C1  0.4886025119029199f
#define SH_C2  1.0925484305920792f
#define SH_C20 0.31539156525252005f
#define SH_C22 0.5462742152960396f
#define SH_C30 0.5900435899266435f
#define SH_C31 2.890611442640554f
#define SH_C32 0.4570457994644658f
#define SH_C33 0.3731763325901154f
#define SH_C34 1.445305721320277f

VEC vf vf_times(float a, vf b) { return vf_mul(vf_set(a), b); }

/* Y of a unit direction; (degree + 1)^2 of them. */
VEC void sh_basis(int degree, const vf d[3], vf Y[16]) {
    vf x = d[0], y = d[1], z = d[2];
    Y[0] = vf_set(SH_C0);
    if (degree < 1) return;
    Y[1] = vf_times(-SH_C1, y);
    Y[2] = vf_times(SH_C1, z);
    Y[3] = vf_times(-SH_C1, x);
    if (degree < 2) return;
    vf xx = vf_mul(x, x), yy = vf_mul(y, y), zz = vf_mul(z, z);
    vf xy = vf_mul(x, y), yz = vf_mul(y, z), xz = vf_mul(x, z), sides = vf_sub(xx, yy);
    Y[4] = vf_times(SH_C2, xy);
    Y[5] = vf_times(-SH_C2, yz);
    Y[6] = vf_times(SH_C20, vf_sub(vf_sub(vf_add(zz, zz), xx), yy));
    Y[7] = vf_times(-SH_C2, xz);
    Y[8] = vf_times(SH_C22, sides);
    if (degree < 3) return;
    vf three = vf_set(3), around = vf_sub(vf_sub(vf_times(4, zz), xx), yy); /* 4 zz - xx - yy */
    Y[9] = vf_mul(vf_times(-SH_C30, y), vf_sub(vf_mul(three, xx), yy));
    Y[10] = vf_mul(vf_times(SH_C31, xy), z);
    Y[11] = vf_mul(vf_times(-SH_C32, y), around);
    Y[12] = vf_mul(vf_times(SH_C33, z), vf_fnma(three, vf_add(xx, yy), vf_add(zz, zz)));
    Y[13] = vf_mul(vf_times(-SH_C32, x), around);
    Y[14] = vf_mul(vf_times(SH_C34, z), sides);
    Y[15] = vf_mul(vf_times(-SH_C30, x), vf_fnma(three, yy, xx));
}

/* The sum of h_k grad Y_k, as polynomials of x, y and z. */
VEC void sh_basis_bwd(int degree, const vf d[3], const vf h[16], vf out[3]) {
    vf x = d[0], y = d[1], z = d[2];
    out[0] = out[1] = out[2] = vf_set(0);
    if (degree < 1) return;
    out[0] = vf_times(-SH_C1, h[3]);
    out[1] = vf_times(-SH_C1, h[1]);
    out[2] = vf_times(SH_C1, h[2]);
    if (degree < 2) return;
    vf c2 = vf_set(SH_C2), bulge = vf_times(2 * SH_C20, h[6]), stretch = vf_times(2 * SH_C22, h[8]);
    out[0] = vf_fma(c2, vf_sub(vf_mul(y, h[4]), vf_mul(z, h[7])), out[0]);
    out[0] = vf_fma(vf_sub(stretch, bulge), x, out[0]);
    out[1] = vf_fma(c2, vf_sub(vf_mul(x, h[4]), vf_mul(z, h[5])), out[1]);
    out[1] = vf_fnma(vf_add(stretch, bulge), y, out[1]);
    out[2] = vf_fnma(c2, vf_fma(y, h[5], vf_mul(x, h[7])), out[2]);
    out[2] = vf_fma(vf_add(bulge, bulge), z, out[2]);
    if (degree < 3) return;
    vf xx = vf_mul(x, x), yy = vf_mul(y, y), zz = vf_mul(z, z);
    vf xy = vf_mul(x, y), yz = vf_mul(y, z), xz = vf_mul(x, z), sides = vf_sub(xx, yy);
    vf three = vf_set(3), four_zz = vf_times(4, zz);
    vf h9 = vf_times(3 * SH_C30, h[9]), h10 = vf_times(SH_C31, h[10]), h11 = vf_times(SH_C32, h[11]);
    vf h12 = vf_times(3 * SH_C33, h[12]), h13 = vf_times(SH_C32, h[13]), h14 = vf_times(SH_C34, h[14]);
    vf h15 = vf_times(3 * SH_C30, h[15]), twice_xy = vf_add(xy, xy);
    out[0] = vf_fnma(h9, twice_xy, out[0]);
    out[1] = vf_fnma(h9, sides, out[1]);
    out[0] = vf_fma(h10, yz, out[0]);
    out[1] = vf_fma(h10, xz, out[1]);
    out[2] = vf_fma(h10, xy, out[2]);
    out[0] = vf_fma(h11, twice_xy, out[0]);
    out[1] = vf_fnma(h11, vf_fnma(three, yy, vf_sub(four_zz, xx)), out[1]);
    out[2] = vf_fnma(h11, vf_times(8, yz), out[2]);
    out[0] = vf_fnma(h12, vf_add(xz, xz), out[0]);
    out[1] = vf_fnma(h12, vf_add(yz, yz), out[1]);
    out[2] = vf_fma(h12, vf_sub(vf_sub(vf_add(zz, zz), xx), yy), out[2]);
    out[0] = vf_fnma(h13, vf_fnma(three, xx, vf_sub(four_zz, yy)), out[0]);
    out[1] = vf_fma(h13, twice_xy, out[1]);
    out[2] = vf_fnma(h13, vf_times(8, xz), out[2]);
    out[0] = vf_fma(h14, vf_add(xz, xz), out[0]);
    out[1] = vf_fnma(h14, vf_add(yz, yz), out[1]);
    out[2] = vf_fma(h14, sides, out[2]);
    out[0] = vf_fnma(h15, sides, out[0]);
    out[1] = vf_fma(h15, twice_xy, out[1]);
}

#endif
