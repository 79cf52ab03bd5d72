/* frame_choice.c - see frame_choice.h. */
#include "frame_choice.h"

/* Of the picture's longer side, between two frames: as a rule, and at least. */
#define SPACING 0.06
#define NEAR    0.01
enum { FEWEST = 100, MOST = 300 };

/* What a frame at the end of its part loses of its sharpness, next to one in the middle. */
#define OFF_CENTRE 0.5

size_t sf_frames_wanted(double path) {
    double wanted = path / SPACING;
    if (wanted < FEWEST) wanted = FEWEST;
    if (wanted > MOST) wanted = MOST;
    if (wanted > path / NEAR) wanted = path / NEAR;
    return wanted < 2 ? 2 : (size_t)wanted;
}

size_t sf_frames_choose(const sf_frame_judged *frames, size_t count, size_t wanted, size_t *chosen) {
    double length = count ? frames[count - 1].path : 0;
    size_t taken = 0, next = 0;
    for (size_t part = 0; part < wanted && next < count; part++) {
        double from = length * (double)part / (double)wanted, half = length / (double)wanted / 2, best = -1;
        int is_last = part + 1 == wanted;
        for (; next < count && (is_last || frames[next].path < from + 2 * half); next++) {
            double off = half > 0 ? (frames[next].path - from - half) / half : 0;
            double worth = frames[next].sharpness * (1 - OFF_CENTRE * off * off);
            if (worth <= best) continue;
            best = worth;
            chosen[taken] = next;
        }
        if (best >= 0) taken++;
    }
    return taken;
}
