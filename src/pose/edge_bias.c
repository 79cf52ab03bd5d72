/* edge_bias.c - see edge_bias.h. */
#include "edge_bias.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"

/* What is usual of cameras (px, standard deviation), and the least scatter of corners. */
static const double USUAL = 0.5, LEAST_SPREAD = 0.1;

/* How the corners of a tag move where all of its edges move outwards by a px: each to where the two edges
 * meet then. Not at all where it is next to no quadrangle. */
static void find_outwards(const sf_board_corner *corner, double outwards[4][2]) {
    double area = 0, normal[4][2];
    for (int k = 0; k < 4; k++) {
        const double *p = corner[k].pixel, *q = corner[(k + 1) % 4].pixel;
        double length = hypot(q[0] - p[0], q[1] - p[1]);
        area += p[0] * q[1] - q[0] * p[1];
        normal[k][0] = (q[1] - p[1]) / length, normal[k][1] = (p[0] - q[0]) / length;
    }
    for (int k = 0; k < 4; k++) {
        const double *a = normal[(k + 3) % 4], *b = normal[k];
        double bend = 1 + a[0] * b[0] + a[1] * b[1];
        for (int i = 0; i < 2; i++)
            outwards[k][i] = bend > 0.1 ? copysign(1, area) * (a[i] + b[i]) / bend : 0;
    }
}

/* The tag that corner *i is the first of: how its corners move, and *i is the first of the next. 0: not all
 * of it is there. */
static int next_tag(const sf_board_corner *corners, size_t count, size_t *i, double outwards[4][2]) {
    const sf_board_corner *first = corners + *i;
    int whole = *i + 4 <= count;
    for (int k = 0; k < 4 && whole; k++) whole = first[k].id == first->id && first[k].corner == k;
    *i += whole ? 4 : 1;
    if (whole) find_outwards(first, outwards);
    return whole;
}

void sf_shift_edges(sf_board_corner *corners, size_t count, double px) {
    double outwards[4][2];
    for (size_t i = 0; i < count;) {
        sf_board_corner *tag = corners + i;
        if (!next_tag(corners, count, &i, outwards)) continue;
        for (int k = 0; k < 8; k++) tag[k / 2].pixel[k % 2] += px * outwards[k / 2][k % 2];
    }
}

static double squares_of_outwards(const sf_corner_list *list) {
    double outwards[4][2], squares = 0;
    for (size_t i = 0; i < list->count;) {
        size_t first = i;
        if (!next_tag(list->corners, list->count, &i, outwards)) continue;
        for (size_t k = 0; k < 4; k++)
            if (!list->rejected || !list->rejected[first + k])
                squares += outwards[k][0] * outwards[k][0] + outwards[k][1] * outwards[k][1];
    }
    return squares;
}

int sf_estimate_edge_bias(const sf_lens *lens, const sf_rigid *T, const sf_corner_list *list,
                          sf_board_corner *corners, sf_edge_bias *s) {
    sf_view_sums now, more; /* with a px more of it, so that r grows by the way outwards, v */
    double cross[SF_TWIST], L[SF_TWIST * SF_TWIST], vv = squares_of_outwards(list), told = vv;
    sf_view_sum(lens, T, list, 0, SF_VIEW_TWIST, &now);
    sf_shift_edges(corners, list->count, -1);
    sf_view_sum(lens, T, list, 0, SF_VIEW_TWIST, &more);
    sf_shift_edges(corners, list->count, 1);
    memcpy(L, now.twist, sizeof L);
    if (!sf_cholesky(SF_TWIST, L)) return 0;
    for (int k = 0; k < SF_TWIST; k++) cross[k] = more.d_twist[k] - now.d_twist[k], s->twist[k] = -cross[k];
    sf_cholesky_solve(SF_TWIST, L, s->twist);
    for (int k = 0; k < SF_TWIST; k++) told += cross[k] * s->twist[k];
    double freedom = fmax(2 * (double)now.count - SF_TWIST, 1);
    double variance = fmax(now.squares / freedom, LEAST_SPREAD * LEAST_SPREAD);
    double vr = (more.squares - now.squares - vv) / 2, usual = variance / (USUAL * USUAL);
    double step = -(vr + usual * s->px) / (fmax(told, 0) + usual);
    if (!isfinite(step)) return 0;
    s->variance = variance / (fmax(told, 0) + usual);
    s->px += step;
    sf_shift_edges(corners, list->count, -step);
    return 1;
}
