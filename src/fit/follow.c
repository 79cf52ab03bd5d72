/* follow.c - see follow.h. */
#include "follow.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"

enum {
    NEIGHBOURS = 8, /* training views that a view follows */
    FEWEST = 4      /* of fewer, the common part cannot be told from chance */
};

typedef struct neighbour {
    const sf_view_state *view;
    double gap;
} neighbour;

/* Square distance of two given cameras: of their centres, in depths, and of the directions they look in. */
static double gap_between(const sf_view_state *view, const sf_camera *camera) {
    double p[3], q[3], sum = 0;
    sf_camera_center(&view->given, p);
    sf_camera_center(camera, q);
    for (int k = 0; k < 3; k++) {
        double apart = (p[k] - q[k]) / view->depth, turned = view->given.R_cw[6 + k] - camera->R_cw[6 + k];
        sum += apart * apart + turned * turned;
    }
    return sum;
}

/* The nearest refined views, nearest first; returns their number. */
static size_t find_neighbours(const sf_view_states *views, const sf_camera *camera,
                              neighbour near[NEIGHBOURS]) {
    size_t count = 0;
    for (size_t i = 0; i < views->count; i++) {
        const sf_view_state *view = &views->states[i];
        if (!(view->depth > 0) || !(view->pose.steps || view->held)) continue;
        neighbour new = {view, gap_between(view, camera)};
        size_t at = count < NEIGHBOURS ? count++ : NEIGHBOURS;
        while (at > 0 && new.gap < near[at - 1].gap) {
            if (at < NEIGHBOURS) near[at] = near[at - 1];
            at--;
        }
        if (at < NEIGHBOURS) near[at] = new;
    }
    return count;
}

/* How the world has to move with the view's correction so that the view sees the same: the turn about
 * `pivot`, and where the pivot goes. */
static void motion_of(const sf_view_state *view, const double pivot[3], double motion[6]) {
    const double *R = view->R_cw, *given = view->given.R_cw;
    double back[9], turn[9], seen[3], to[3];
    for (int k = 0; k < 9; k++) back[k] = R[k % 3 * 3 + k / 3];
    sf_mat3_mul(back, given, turn);
    sf_rotation_log(turn, motion);
    sf_mat3_vec(given, pivot, seen);
    for (int k = 0; k < 3; k++) seen[k] += view->given.t_cw[k] - view->t_cw[k];
    sf_mat3_vec(back, seen, to);
    for (int k = 0; k < 3; k++) motion[3 + k] = to[k] - pivot[k];
}

double sf_shrunk_mean(double mean, double error2) { return mean * mean > error2 ? mean - error2 / mean : 0; }

static void common_motion(const neighbour *near, size_t count, const double pivot[3], double motion[6]) {
    double mean[6] = {0}, square[6] = {0}, n = (double)count, of_view[6];
    for (size_t i = 0; i < count; i++) {
        motion_of(near[i].view, pivot, of_view);
        for (int k = 0; k < 6; k++) mean[k] += of_view[k] / n, square[k] += of_view[k] * of_view[k] / n;
    }
    for (int k = 0; k < 6; k++) {
        double error2 = fmax(square[k] - mean[k] * mean[k], 0) / (n - 1);
        motion[k] = sf_shrunk_mean(mean[k], error2);
    }
}

void sf_follow_neighbours(const sf_view_states *views, sf_camera *camera) {
    neighbour near[NEIGHBOURS];
    double pivot[3], motion[6], turn[9], R[9], seen[3], moved[3], to[3], any = 0;
    size_t count = find_neighbours(views, camera, near);
    if (count < FEWEST) return;
    sf_camera_center(camera, pivot); /* what the camera looks at */
    for (int k = 0; k < 3; k++) pivot[k] += near[0].view->depth * camera->R_cw[6 + k];
    common_motion(near, count, pivot, motion);
    for (int k = 0; k < 6; k++) any += fabs(motion[k]);
    if (!(any > 0)) return;
    /* the moved pivot is seen where the pivot was */
    const double back[3] = {-motion[0], -motion[1], -motion[2]};
    sf_rotation_exp(back, turn);
    sf_mat3_mul(camera->R_cw, turn, R);
    sf_mat3_vec(camera->R_cw, pivot, seen);
    for (int k = 0; k < 3; k++) moved[k] = pivot[k] + motion[3 + k];
    sf_mat3_vec(R, moved, to);
    memcpy(camera->R_cw, R, sizeof R);
    for (int k = 0; k < 3; k++) camera->t_cw[k] += seen[k] - to[k];
}
