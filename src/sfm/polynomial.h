/* polynomial.h - the real roots of polynomials (GEOMETRY.md, S.10). */
#ifndef SF_SFM_POLYNOMIAL_H
#define SF_SFM_POLYNOMIAL_H

enum { SF_DEGREE_MOST = 10 };

/* The real roots of c[0] + c[1] x + ... + c[degree] x^degree, ascending; degree 0..SF_DEGREE_MOST. A double
 * root may come once or twice, or, by rounding, not at all. Returns how many there are. */
int sf_polynomial_roots(const double *c, int degree, double roots[SF_DEGREE_MOST]);

/* Its value at x. */
static inline double sf_polynomial_at(const double *c, int degree, double x) {
    double value = c[degree];
    for (int i = degree; i--;) value = value * x + c[i];
    return value;
}

#endif
