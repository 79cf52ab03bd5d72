/* ticker.c - see ticker.h. */
#include "ticker.h"

#include <math.h>

void sf_tick(sf_ticker *t, double now) { t->time[t->count++ % SF_TICKS] = now; }

double sf_tick_rate(const sf_ticker *t, double now) {
    const double window = 3;
    double first = now;
    int n = 0;
    for (uint64_t k = 1; k <= SF_TICKS && k <= t->count; k++) {
        double time = t->time[(t->count - k) % SF_TICKS];
        if (time < now - window) break;
        first = time, n++;
    }
    return n > 1 ? (n - 1) / fmax(now - first, 1e-3) : 0;
}
