/* sh.h - the real spherical harmonics that colours are made of (M.4). */
#ifndef SF_KERNELS_SH_H
#define SF_KERNELS_SH_H

/* Factors of the bands: of band 1; of band 2, of m = 0 and of |m| = 2; of band 3 from |m| = 3 down to 0 and
 * of m = 2. */
#define SF_SH_0   0.28209479177387814
#define SF_SH_1   0.4886025119029199
#define SF_SH_2   1.0925484305920792
#define SF_SH_20  0.31539156525252005
#define SF_SH_22  0.5462742152960396
#define SF_SH_33  0.5900435899266435
#define SF_SH_32  2.890611442640554
#define SF_SH_31  0.4570457994644658
#define SF_SH_30  0.3731763325901154
#define SF_SH_32C 1.445305721320277

/* Y of M.4, [(degree + 1)^2], in the direction d, of length 1. */
static inline void sf_sh_basis(int degree, const double *d, double *Y) {
    double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
    Y[0] = SF_SH_0;
    if (degree > 0) Y[1] = -SF_SH_1 * y, Y[2] = SF_SH_1 * z, Y[3] = -SF_SH_1 * x;
    if (degree > 1) {
        Y[4] = SF_SH_2 * x * y, Y[5] = -SF_SH_2 * y * z, Y[6] = SF_SH_20 * (2 * zz - xx - yy);
        Y[7] = -SF_SH_2 * x * z, Y[8] = SF_SH_22 * (xx - yy);
    }
    if (degree > 2) {
        Y[9] = -SF_SH_33 * y * (3 * xx - yy), Y[10] = SF_SH_32 * x * y * z;
        Y[11] = -SF_SH_31 * y * (4 * zz - xx - yy), Y[12] = SF_SH_30 * z * (2 * zz - 3 * xx - 3 * yy);
        Y[13] = -SF_SH_31 * x * (4 * zz - xx - yy), Y[14] = SF_SH_32C * z * (xx - yy);
        Y[15] = -SF_SH_33 * x * (xx - 3 * yy);
    }
}

#endif
