/* epipolar.h - how far pairs are from the epipolar constraint b^T F a = 0 (GEOMETRY.md, S.18). */
#ifndef SF_SFM_EPIPOLAR_H
#define SF_SFM_EPIPOLAR_H

/* The square of the length of the derivative of b^T F a by a and b. */
static inline double sf_epipolar_slope(const double F[9], const double a[2], const double b[2]) {
    double x = F[0] * a[0] + F[1] * a[1] + F[2], y = F[3] * a[0] + F[4] * a[1] + F[5];
    double u = F[0] * b[0] + F[3] * b[1] + F[6], v = F[1] * b[0] + F[4] * b[1] + F[7];
    return x * x + y * y + u * u + v * v;
}

/* The square of Sampson's distance, in the coordinates' units. */
static inline double sf_sampson(const double F[9], const double a[2], const double b[2]) {
    double x = F[0] * a[0] + F[1] * a[1] + F[2], y = F[3] * a[0] + F[4] * a[1] + F[5];
    double z = F[6] * a[0] + F[7] * a[1] + F[8], error = b[0] * x + b[1] * y + z;
    double u = F[0] * b[0] + F[3] * b[1] + F[6], v = F[1] * b[0] + F[4] * b[1] + F[7];
    double slope = x * x + y * y + u * u + v * v;
    return slope > 0 ? error * error / slope : 0;
}

#endif
