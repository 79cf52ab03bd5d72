/* landmark_map.c - see landmark_map.h. */
#include "landmark_map.h"

#include <math.h>

#include "../base/linear.h"

enum { CELLS = 20 /* along the longer side of the picture, for landmarks to be spread over */ };

#define WIDEST 1.5 /* px: residuals up to this are no outliers, */
#define WIDTHS 3.0 /* nor are those up to so many standard deviations, to twice that */

static double cosine(const double a[3], const double b[3]) {
    return sf_dot3(a, b) / fmax(sqrt(sf_dot3(a, a) * sf_dot3(b, b)), 1e-300);
}

void sf_landmark_place(const sf_landmarks *l, const sf_landmark *m, double inverse, double at[3]) {
    double p[3];
    for (int k = 0; k < 3; k++) p[k] = m->ray[k] / inverse;
    sf_rigid_apply_back(&l->keyframes[m->keyframe].view.pose, p, at);
}

double sf_landmark_cosine(const sf_landmarks *l, const sf_landmark *m, const sf_rigid *pose) {
    double a[3], b[3];
    sf_rigid_center(&l->keyframes[m->keyframe].view.pose, a);
    sf_rigid_center(pose, b);
    for (int k = 0; k < 3; k++) a[k] = m->at[k] - a[k], b[k] = m->at[k] - b[k];
    return cosine(a, b);
}

int sf_landmarks_cell(const sf_landmarks *l) {
    int side = l->width > l->height ? l->width : l->height;
    return side / CELLS > 8 ? side / CELLS : 8;
}

int sf_match_is_used(const sf_landmarks *l, const sf_landmark_match *at) {
    return at->found && !at->misled && l->all[at->landmark].state == SF_LANDMARK_KNOWN;
}

double sf_match_gate(double spread) { return fmin(fmax(WIDTHS * spread, WIDEST), 2 * WIDEST); }

void sf_landmarks_drop_stale(sf_landmarks *l) {
    size_t kept = 0;
    for (size_t i = 0; i < l->count; i++) l->all[i].observations = 0;
    for (size_t i = 0; i < l->observation_count; i++) {
        const sf_landmark_observation *s = &l->observations[i];
        if (l->all[s->landmark].state == SF_LANDMARK_EMPTY) continue;
        l->all[s->landmark].observations++;
        l->observations[kept++] = *s;
    }
    l->observation_count = kept;
}
