/* bounded.h - running error analysis: a value in float64, and how far arithmetic of a coarser unit may be
 * off.
 *
 * A formula written with these operations gives its value and, beside it, a bound for the error of any
 * program that makes the same operations with roundings of at most BOUNDED_UNIT, fused or not (Higham,
 * Accuracy and Stability of Numerical Algorithms, 3.3). A file that means another arithmetic than float32
 * defines the three constants before it includes this one.
 */
#ifndef TESTS_REFERENCE_BOUNDED_H
#define TESTS_REFERENCE_BOUNDED_H

#include <float.h>
#include <math.h>

/* One rounding to float32, relative. */
#define FLOAT_UNIT 0x1p-24

#ifndef BOUNDED_UNIT
#define BOUNDED_UNIT FLOAT_UNIT
/* What is smaller may be flushed to 0. */
#define BOUNDED_LEAST ((double)FLT_MIN)
/* Roundings of a quotient or a root: 32-bit ARM has to approach them in steps. */
#if defined(__arm__)
#define BOUNDED_QUOTIENT 6
#else
#define BOUNDED_QUOTIENT 1
#endif
#endif

typedef struct bounded {
    double v, e; /* |what the program has - v| <= e */
} bounded;

/* v, known to e, rounded once; a float that is known is not rounded. */
static inline bounded b_round(double v, double e) {
    if (e == 0 && v == (double)(float)v && fabs(v) >= BOUNDED_LEAST) return (bounded){v, 0};
    double rounding = BOUNDED_UNIT * (fabs(v) + e);
    if (fabs(v) - e < BOUNDED_LEAST && (v != 0 || e != 0)) rounding += BOUNDED_LEAST;
    return (bounded){v, e + rounding};
}

/* A number that the program has without an error, but for a flushed denormal. */
static inline bounded b_of(double v) { return (bounded){v, fabs(v) < BOUNDED_LEAST ? fabs(v) : 0}; }
/* One that is rounded to float32 first. */
static inline bounded b_stored(bounded a) {
    double e = a.e + FLOAT_UNIT * (fabs(a.v) + a.e);
    return (bounded){a.v, fabs(a.v) - a.e < FLT_MIN && (a.v != 0 || a.e != 0) ? e + FLT_MIN : e};
}
static inline bounded b_widen(bounded a, double e) { return (bounded){a.v, a.e + e}; }

static inline bounded b_negative(bounded a) { return (bounded){-a.v, a.e}; }
static inline bounded b_twice(bounded a) { return (bounded){2 * a.v, 2 * a.e}; }
static inline bounded b_add(bounded a, bounded b) { return b_round(a.v + b.v, a.e + b.e); }
static inline bounded b_sub(bounded a, bounded b) { return b_round(a.v - b.v, a.e + b.e); }

static inline bounded b_mul(bounded a, bounded b) {
    return b_round(a.v * b.v, fabs(a.v) * b.e + fabs(b.v) * a.e + a.e * b.e);
}

static inline bounded b_scale(double factor, bounded a) { return b_mul(b_of(factor), a); }
static inline bounded b_square(bounded a) { return b_mul(a, a); }
/* a b + c */
static inline bounded b_fma(bounded a, bounded b, bounded c) { return b_add(b_mul(a, b), c); }

/* Approached in steps, even a quotient that is a float may be off. */
static inline bounded b_quotient_round(double v, double e) {
    bounded once = b_round(v, e);
    if (BOUNDED_QUOTIENT == 1) return once;
    return (bounded){v, fmax(once.e, e + BOUNDED_QUOTIENT * BOUNDED_UNIT * (fabs(v) + e))};
}

static inline bounded b_div(bounded a, bounded b) {
    double v = a.v / b.v, least = fabs(b.v) - b.e;
    return b_quotient_round(v, least > 0 ? (a.e + fabs(v) * b.e) / least : INFINITY);
}

static inline bounded b_sqrt(bounded a) {
    double v = sqrt(fmax(a.v, 0));
    return b_quotient_round(v, fmax(v - sqrt(fmax(a.v - a.e, 0)), sqrt(fmax(a.v + a.e, 0)) - v));
}

static inline bounded b_exp(bounded a) {
    double v = exp(a.v);
    return b_round(v, v * expm1(a.e));
}

static inline bounded b_log2(bounded a) {
    return b_round(log2(a.v), a.e < a.v ? -log2(1 - a.e / a.v) : INFINITY);
}

/* Whether the program may find a on the other side of `limit`. */
static inline int b_near(bounded a, double limit) { return !(fabs(a.v - limit) > a.e); }

static inline bounded b_dot3(const bounded *a, const bounded *b) {
    return b_fma(a[0], b[0], b_fma(a[1], b[1], b_mul(a[2], b[2])));
}

static inline void b_cross3(const bounded *a, const bounded *b, bounded *out) {
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = b_sub(b_mul(a[i], b[j]), b_mul(a[j], b[i]));
    }
}

#endif
