/* focal.c - see focal.h. */
#include "focal.h"

#include <math.h>

#include "../base/linear.h"

enum { STEPS = 120 }; /* of the search, evenly spaced in the logarithm */

/* A misfit above this is a wrong matrix's, or one's that says nothing; then it does not matter how large. */
#define TRUNCATE 0.1

/* The singular values from the eigenvalues of E E^T by its invariants: with s3 = 0 (F is singular)
 * s1^2 + s2^2 = tr(E E^T) and s1^2 s2^2 is the sum of the squares of the cofactors. */
double sf_focal_misfit(const double F[9], double focal) {
    double E[9], trace = 0, squares = 0;
    for (int i = 0; i < 9; i++) {
        E[i] = F[i] * (i / 3 < 2 ? focal : 1) * (i % 3 < 2 ? focal : 1);
        trace += E[i] * E[i];
    }
    for (int i = 0; i < 3; i++) {
        double c[3];
        sf_cross3(E + 3 * i, E + 3 * ((i + 1) % 3), c);
        squares += sf_dot3(c, c);
    }
    if (!(trace > 0)) return 1;
    double root = sqrt(fmax(trace * trace / 4 - squares, 0));
    double first = trace / 2 + root, second = fmax(trace / 2 - root, 0);
    return 1 - sqrt(second / first);
}

double sf_focal_cost(const sf_focal_pair *pairs, size_t count, double focal) {
    double cost = 0, weights = 0;
    for (size_t i = 0; i < count; i++) {
        double misfit = sf_focal_misfit(pairs[i].F, focal) / TRUNCATE;
        cost += pairs[i].weight * (1 - exp(-misfit));
        weights += pairs[i].weight;
    }
    return weights > 0 ? cost / weights : 0;
}

/* With what the guess asks for: as much as one pair in 13, a factor of 2 away. */
static double cost_of(const sf_focal_pair *pairs, size_t count, double guess, double focal) {
    double off = log(focal / guess) / log(2);
    return sf_focal_cost(pairs, count, focal) + 0.15 * off * off / (1 + off * off);
}

double sf_focal_vote(const sf_focal_pair *pairs, size_t count, double least, double most, double guess,
                     double *contrast) {
    double costs[STEPS + 1], ratio = pow(most / least, 1.0 / STEPS), mean = 0;
    int best = 0;
    for (int i = 0; i <= STEPS; i++) {
        costs[i] = cost_of(pairs, count, guess, least * pow(ratio, i));
        mean += costs[i] / (STEPS + 1);
        if (costs[i] < costs[best]) best = i;
    }
    if (contrast) *contrast = count && mean > 0 ? fmax(1 - costs[best] / mean, 0) : 0;
    if (!count) return guess;
    double low = least * pow(ratio, best - 1), high = least * pow(ratio, best + 1);
    for (int i = 0; i < 40; i++) { /* the golden section */
        double a = high - 0.618033988749895 * (high - low), b = low + 0.618033988749895 * (high - low);
        if (cost_of(pairs, count, guess, a) < cost_of(pairs, count, guess, b))
            high = b;
        else
            low = a;
    }
    return fmin(fmax((low + high) / 2, least), most);
}
