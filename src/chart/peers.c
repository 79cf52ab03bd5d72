/* peers.c - what other programs reach on the same pictures. */
#include "chart.h"

#include <string.h>

/* PSNR of the 7 held-out views of the best run that each was given for a wall time, by splatfit's authors, on
 * two cores of a machine that is not the one of the curves. */
#define MEASURED "measured by the authors on two cores of another machine of this kind (Zen 5)"

static const chart_peer peers[] = {
    {"fox-centred-270",
     270,
     480,
     "OpenSplat (CPU), tuned for short runs",
     MEASURED,
     {{60, 25.8}, {120, 27.4}, {300, 29.4}, {600, 30.9}, {858, 31.4}}},
    {"fox-centred-270",
     270,
     480,
     "OpenSplat 1.2.0 (CPU), as shipped",
     MEASURED,
     {{60, 23.8}, {120, 25.9}, {300, 27.8}}},
};

const chart_peer *chart_peer_of(const chart_run *scene, size_t index) {
    for (size_t i = 0; i < sizeof peers / sizeof *peers; i++) {
        const chart_peer *p = &peers[i];
        int same = !strcmp(p->scene, scene->scene) && p->width == scene->width && p->height == scene->height;
        if (same && index-- == 0) return p;
    }
    return NULL;
}
