/* polynomial.c - see polynomial.h. */
#include "polynomial.h"

#include <math.h>
#include <string.h>

/* The root between low and high, where the polynomial has values of opposite signs: Newton's method, and
 * bisection where that would leave the bracket or does not halve its steps. */
static double root_between(const double *c, int degree, double low, double high, int rises) {
    double x = (low + high) / 2, last = high - low;
    for (int step = 0; step < 100; step++) {
        double value = c[degree], slope = 0;
        for (int i = degree; i--;) {
            slope = slope * x + value;
            value = value * x + c[i];
        }
        if (value == 0) return x;
        if ((value > 0) == rises)
            high = x;
        else
            low = x;
        double next = x - value / slope;
        if (!(next > low && next < high && 2 * fabs(next - x) < last)) next = (low + high) / 2;
        last = fabs(next - x);
        if (fabs(next - x) <= 4e-16 * fabs(x)) return next;
        x = next;
    }
    return x;
}

/* Sturm's chain: the polynomial, its derivative, and then each the negative remainder of the two before it,
 * scaled. The signs that change along it at x tell how many different real roots lie above x. */
typedef struct chain {
    int count, degree[SF_DEGREE_MOST + 1];
    double c[SF_DEGREE_MOST + 1][SF_DEGREE_MOST + 1];
} chain;

/* Divides by the greatest magnitude, and drops leading coefficients that are rounding alone. 0: nothing is
 * left. */
static int normalize(double *c, int *degree, double rounding) {
    double most = 0;
    for (int i = 0; i <= *degree; i++) most = fmax(most, fabs(c[i]));
    if (!(most > rounding)) return 0;
    while (fabs(c[*degree]) <= 1e-15 * most) --*degree;
    for (int i = 0; i <= *degree; i++) c[i] /= most;
    return 1;
}

/* The negative remainder of p / q, in p's place. */
static void divide(double *p, int degree, const double *q, int least) {
    for (int i = degree; i >= least; i--) {
        double factor = p[i] / q[least];
        for (int k = 0; k < least; k++) p[i - least + k] -= factor * q[k];
    }
    for (int i = 0; i < least; i++) p[i] = -p[i];
}

static void make_chain(const double *c, int degree, chain *s) {
    memcpy(s->c[0], c, sizeof(double) * (size_t)(degree + 1));
    for (int i = 0; i < degree; i++) s->c[1][i] = (i + 1) * c[i + 1];
    s->degree[0] = degree, s->degree[1] = degree - 1;
    normalize(s->c[1], &s->degree[1], 0);
    for (s->count = 2; s->degree[s->count - 1] > 0; s->count++) {
        double *next = s->c[s->count];
        int least = s->degree[s->count - 1];
        memcpy(next, s->c[s->count - 2], sizeof s->c[0]);
        divide(next, s->degree[s->count - 2], s->c[s->count - 1], least);
        s->degree[s->count] = least - 1;
        if (!normalize(next, &s->degree[s->count], 1e-15)) return;
    }
}

static int sign_changes(const chain *s, double x) {
    int changes = 0;
    double last = 0;
    for (int k = 0; k < s->count; k++) {
        double value = sf_polynomial_at(s->c[k], s->degree[k], x);
        changes += value * last < 0;
        if (value != 0) last = value > 0 ? 1 : -1;
    }
    return changes;
}

typedef struct interval {
    double low, high;
    int above_low, above_high; /* sign changes there */
} interval;

/* The roots of the intervals, from the left to the right: halved until each holds one. */
static int isolate(const chain *s, double bound, double *roots) {
    enum { DEPTH = 80 };
    interval stack[DEPTH] = {{-bound, bound, sign_changes(s, -bound), sign_changes(s, bound)}};
    const double *c = s->c[0];
    int degree = s->degree[0], left = 1, found = 0;
    while (left && found < degree) {
        interval now = stack[--left];
        double middle = (now.low + now.high) / 2, at_high = sf_polynomial_at(c, degree, now.high);
        int inside = now.above_low - now.above_high;
        if (inside <= 0) continue;
        if (inside == 1 && sf_polynomial_at(c, degree, now.low) * at_high < 0) {
            roots[found++] = root_between(c, degree, now.low, now.high, at_high > 0);
        } else if (now.high - now.low <= fmax(1e-13 * fmax(fabs(now.low), fabs(now.high)), 1e-18 * bound) ||
                   left + 2 > DEPTH) {
            roots[found++] = middle; /* several in one, or so near that rounding hides it */
        } else {
            int above = sign_changes(s, middle);
            stack[left++] = (interval){middle, now.high, above, now.above_high};
            stack[left++] = (interval){now.low, middle, now.above_low, above};
        }
    }
    return found;
}

int sf_polynomial_roots(const double *coefficients, int degree, double roots[SF_DEGREE_MOST]) {
    double c[SF_DEGREE_MOST + 1], bound = 0;
    chain s;
    memcpy(c, coefficients, sizeof *c * (size_t)(degree + 1));
    for (int i = 0; i <= degree; i++)
        if (!isfinite(c[i])) return 0;
    if (!normalize(c, &degree, 0) || degree == 0) return 0;
    for (int k = 1; k <= degree; k++) /* Fujiwara's */
        bound = fmax(bound, 2.01 * pow(fabs(c[degree - k] / c[degree]), 1.0 / k));
    make_chain(c, degree, &s);
    return isolate(&s, fmax(bound, 1e-300), roots);
}
