/* ticker.h - how often something happened in the last few seconds. */
#ifndef SF_LIVE_TICKER_H
#define SF_LIVE_TICKER_H

#include <stdint.h>

enum { SF_TICKS = 64 };

/* The times of the last events, s; all 0 to begin with. */
typedef struct sf_ticker {
    double time[SF_TICKS];
    uint64_t count; /* of all events */
} sf_ticker;

void sf_tick(sf_ticker *ticker, double now);
/* Events a second; 0 where fewer than two are in the last seconds. */
double sf_tick_rate(const sf_ticker *ticker, double now);

#endif
