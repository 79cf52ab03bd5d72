/* elementary.h - functions that are the same on every machine, which those of the C library are not: of sums
 * and products alone. */
#ifndef SF_SFM_ELEMENTARY_H
#define SF_SFM_ELEMENTARY_H

/* e^x for |x| <= 64, within 1e-12 of it: of x / 256, by its series, squared eight times. */
static inline double sf_plain_exp(double x) {
    double term = 1, sum = 1;
    x /= 256;
    for (int n = 1; n <= 13; n++) {
        term *= x / n;
        sum += term;
    }
    for (int i = 0; i < 8; i++) sum *= sum;
    return sum;
}

/* The cosine and the sine of 0 <= x <= 7, within 2e-15: by their series about the nearest multiple of pi / 2.
 */
static inline void sf_plain_turn(double x, double *cosine, double *sine) {
    const double quarter = 1.57079632679489661923;
    int turns = (int)(x / quarter + 0.5);
    double d = x - turns * quarter, term = 1, c = 1, s = 0;
    for (int n = 1; n <= 18; n++) {
        term *= d / n;
        double signed_term = n & 2 ? -term : term; /* 1, d, -d^2/2, -d^3/6, ... */
        if (n & 1)
            s += signed_term;
        else
            c += signed_term;
    }
    *cosine = turns & 1 ? (turns & 2 ? s : -s) : turns & 2 ? -c : c;
    *sine = turns & 1 ? (turns & 2 ? -c : c) : turns & 2 ? -s : s;
}

#endif
