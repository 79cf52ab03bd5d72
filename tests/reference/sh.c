/* sh.c - the spherical harmonics of M.4 and the gradients of their polynomials. */
#include "reference.h"

static const double SH0 = 0.28209479177387814, SH1 = 0.4886025119029199, SH2 = 1.0925484305920792,
                    SH2Z = 0.31539156525252005, SH2X = 0.5462742152960396, SH3A = 0.5900435899266435,
                    SH3B = 2.890611442640554, SH3C = 0.4570457994644658, SH3Z = 0.3731763325901154,
                    SH3X = 1.445305721320277;

void test_ref_sh_basis(int degree, const double d[3], double basis[16]) {
    double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
    basis[0] = SH0;
    if (degree < 1) return;
    basis[1] = -SH1 * y;
    basis[2] = SH1 * z;
    basis[3] = -SH1 * x;
    if (degree < 2) return;
    basis[4] = SH2 * x * y;
    basis[5] = -SH2 * y * z;
    basis[6] = SH2Z * (2 * zz - xx - yy);
    basis[7] = -SH2 * x * z;
    basis[8] = SH2X * (xx - yy);
    if (degree < 3) return;
    basis[9] = -SH3A * y * (3 * xx - yy);
    basis[10] = SH3B * x * y * z;
    basis[11] = -SH3C * y * (4 * zz - xx - yy);
    basis[12] = SH3Z * z * (2 * zz - 3 * xx - 3 * yy);
    basis[13] = -SH3C * x * (4 * zz - xx - yy);
    basis[14] = SH3X * z * (xx - yy);
    basis[15] = -SH3A * x * (xx - 3 * yy);
}

static void set(double out[3], double factor, double x, double y, double z) {
    out[0] = factor * x;
    out[1] = factor * y;
    out[2] = factor * z;
}

void test_ref_sh_basis_backward(int degree, const double d[3], double d_basis[16][3]) {
    double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
    set(d_basis[0], SH0, 0, 0, 0);
    if (degree < 1) return;
    set(d_basis[1], -SH1, 0, 1, 0);
    set(d_basis[2], SH1, 0, 0, 1);
    set(d_basis[3], -SH1, 1, 0, 0);
    if (degree < 2) return;
    set(d_basis[4], SH2, y, x, 0);
    set(d_basis[5], -SH2, 0, z, y);
    set(d_basis[6], SH2Z, -2 * x, -2 * y, 4 * z);
    set(d_basis[7], -SH2, z, 0, x);
    set(d_basis[8], SH2X, 2 * x, -2 * y, 0);
    if (degree < 3) return;
    set(d_basis[9], -SH3A, 6 * x * y, 3 * xx - 3 * yy, 0);
    set(d_basis[10], SH3B, y * z, x * z, x * y);
    set(d_basis[11], -SH3C, -2 * x * y, 4 * zz - xx - 3 * yy, 8 * y * z);
    set(d_basis[12], SH3Z, -6 * x * z, -6 * y * z, 6 * zz - 3 * xx - 3 * yy);
    set(d_basis[13], -SH3C, 4 * zz - 3 * xx - yy, -2 * x * y, 8 * x * z);
    set(d_basis[14], SH3X, 2 * x * z, -2 * y * z, xx - yy);
    set(d_basis[15], -SH3A, 3 * xx - 3 * yy, -6 * x * y, 0);
}
