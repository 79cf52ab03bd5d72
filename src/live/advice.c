/* advice.c - see advice.h. */
#include "advice.h"

#include <math.h>

/* Limits: where an advice begins, and where one that is shown is over. */
#define FAST         1.2
#define SLOW_AGAIN   0.8
#define UNEVEN       1.5 /* brighter or darker by this factor */
#define EVEN_AGAIN   1.25
#define BARE         0.35 /* coverage */
#define BARE_NO_MORE 0.5

/* In the order of their weight: where nothing is tracked, the rest does not matter. */
static sf_live_advice want(sf_live_advice shown, const sf_advice_facts *f) {
    double fast = shown == SF_ADVICE_SLOWER ? SLOW_AGAIN : FAST;
    double darker = shown == SF_ADVICE_DARKER ? EVEN_AGAIN : UNEVEN;
    double brighter = shown == SF_ADVICE_BRIGHTER ? EVEN_AGAIN : UNEVEN;
    double bare = shown == SF_ADVICE_MORE_VIEWS ? BARE_NO_MORE : BARE;
    if (f->state == SF_LIVE_LOST) return SF_ADVICE_COME_BACK;
    if (f->speed > fast || f->blurred) return SF_ADVICE_SLOWER;
    if (f->state == SF_LIVE_STARTING) return SF_ADVICE_SIDEWAYS;
    if (f->brightness * darker < 1) return SF_ADVICE_DARKER;
    if (f->brightness > brighter) return SF_ADVICE_BRIGHTER;
    if (f->coverage < bare) return SF_ADVICE_MORE_VIEWS;
    return SF_ADVICE_NONE;
}

sf_live_advice sf_advise(sf_adviser *a, const sf_advice_facts *f) {
    int is_over = (a->shown == SF_ADVICE_COME_BACK && f->state != SF_LIVE_LOST) ||
                  (a->shown == SF_ADVICE_SIDEWAYS && f->state != SF_LIVE_STARTING);
    if (is_over) a->shown = SF_ADVICE_NONE; /* done: it would be wrong */
    sf_live_advice wanted = want(a->shown, f);
    if (f->seconds < a->wanted_since)
        *a = (sf_adviser){.wanted_since = f->seconds}; /* the clock began anew */
    if (wanted != a->wanted) a->wanted = wanted, a->wanted_since = f->seconds;
    if (wanted == a->shown) {
        a->right = f->seconds;
        return a->shown;
    }
    double has_been = f->seconds - a->wanted_since, kept = f->seconds - a->shown_since;
    int ripe = wanted ? has_been >= SF_ADVICE_RAISE : f->seconds - a->right >= SF_ADVICE_CLEAR;
    if (ripe && (!a->shown || kept >= SF_ADVICE_KEEP || wanted == SF_ADVICE_COME_BACK))
        a->shown = wanted, a->shown_since = a->right = f->seconds;
    return a->shown;
}
