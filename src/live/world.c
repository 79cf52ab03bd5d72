/* world.c - see world.h. */
#include "world.h"

#include <math.h>
#include <string.h>

#include "../base/statistics.h"

enum { PAIRS_LEAST = 6 };

/* Distances to what the camera sees: between two poses that are taken; between the farthest two, for a
 * similarity. */
#define STEP 0.05
#define SPAN 0.25
/* Medians of the pairs' errors: pairs beyond are left out. */
#define GATE 3.0

static double apart(const sf_camera *a, const sf_camera *b) {
    double p[3], q[3], sum = 0;
    sf_camera_center(a, p), sf_camera_center(b, q);
    for (int k = 0; k < 3; k++) sum += pow(p[k] - q[k], 2);
    return sqrt(sum);
}

static double span(const sf_world *w) {
    double most = 0;
    for (size_t i = 0; i < w->count; i++)
        for (size_t j = 0; j < i; j++) most = fmax(most, apart(&w->map[i], &w->map[j]));
    return most;
}

/* By all pairs, then by those that agree with it. */
static int align(sf_world *w) {
    sf_camera from[SF_WORLD_PAIRS], to[SF_WORLD_PAIRS];
    double errors[SF_WORLD_PAIRS], sorted[SF_WORLD_PAIRS];
    sf_similarity s;
    size_t n = 0;
    if (!sf_similarity_between(w->map, w->world, w->count, &s)) return 0;
    for (size_t i = 0; i < w->count; i++) {
        sf_camera moved = w->map[i];
        sf_camera_transform(&moved, &s);
        errors[i] = sorted[i] = apart(&moved, &w->world[i]);
    }
    double most = GATE * sf_median(sorted, w->count);
    for (size_t i = 0; i < w->count; i++)
        if (errors[i] <= most) from[n] = w->map[i], to[n++] = w->world[i];
    if (n < PAIRS_LEAST || !sf_similarity_between(from, to, n, &s)) return 0;
    w->similarity = s;
    return 1;
}

int sf_world_note(sf_world *w, const sf_camera *in_map, const sf_rigid *in_world, double distance) {
    size_t newest = (w->oldest + SF_WORLD_PAIRS - 1) % SF_WORLD_PAIRS;
    if (w->count && apart(&w->map[newest], in_map) < STEP * distance) return 0;
    w->map[w->oldest] = w->world[w->oldest] = *in_map;
    memcpy(w->world[w->oldest].R_cw, in_world->R, sizeof in_world->R);
    memcpy(w->world[w->oldest].t_cw, in_world->t, sizeof in_world->t);
    w->oldest = (w->oldest + 1) % SF_WORLD_PAIRS;
    if (w->count < SF_WORLD_PAIRS) w->count++;
    int was_known = w->is_known;
    if (w->count >= PAIRS_LEAST && span(w) > SPAN * distance) w->is_known |= align(w);
    return w->is_known && !was_known;
}
