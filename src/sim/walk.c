/* walk.c - see walk.h. */
#include "walk.h"

#include <string.h>

#include "../base/linear.h"
#include "../base/rng.h"

static const double pi = 3.141592653589793;

/* Where the camera is and looks to: control points of a closed cubic B-spline, which smooths them, so that
 * the hand never jumps. Azimuth 0 is before the table, positive to the right. */
static const struct {
    double azimuth, radius, height; /* degrees; world units from the table's middle, above the floor */
    sf_vec3 at;
} way[] = {
    {0, 2.4, 2.2, {0.15, -1.0, 0.24}},   {12, 2.3, 1.85, {0.2, -1.0, 0.24}},
    {-10, 2.2, 1.95, {0.1, -1.0, 0.24}}, {-6, 2.7, 2.5, {0.1, -0.9, 0.3}},
    {15, 2.9, 2.3, {0.1, -0.6, 0.4}},    {35, 3.0, 2.1, {0.3, 0.0, 0.5}},
    {60, 2.9, 1.9, {0.4, 0.7, 0.6}},     {80, 2.8, 1.6, {0.2, 1.2, 0.6}},
    {95, 2.6, 1.5, {0.3, 1.5, 0.5}},     {95, 3.0, 1.9, {0.0, 1.4, 0.6}},
    {75, 3.6, 2.3, {0.0, 1.0, 0.6}},     {45, 3.9, 2.6, {0.0, -0.3, 0.4}},
    {10, 4.0, 2.6, {0.0, -0.5, 0.3}},    {-25, 3.4, 2.2, {-0.3, -0.1, 0.5}},
    {-55, 2.8, 1.8, {-0.9, 0.8, 0.6}},   {-80, 2.9, 1.6, {-0.7, 1.2, 0.6}},
    {-90, 3.0, 1.8, {-0.4, 1.4, 0.6}},   {-65, 3.0, 2.1, {-0.6, 0.5, 0.5}},
    {-30, 2.8, 2.3, {-0.1, -0.7, 0.3}},  {-8, 2.5, 2.3, {0.1, -1.0, 0.24}},
};

enum { WAY = sizeof way / sizeof *way };

static sf_vec3 eye_of(int i) {
    double azimuth = way[i].azimuth * pi / 180;
    return vec3(way[i].radius * sin(azimuth), -way[i].radius * cos(azimuth), way[i].height);
}

/* The spline at a place in control points, 0..WAY. */
static void on_way(double place, sf_vec3 *eye, sf_vec3 *at) {
    int32_t knot = whole_below(place);
    double t = place - knot, u = 1 - t;
    double weights[4] = {u * u * u / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
                         (3 * u * u * u - 6 * u * u + 4) / 6, t * t * t / 6};
    *eye = *at = vec3(0, 0, 0);
    for (int k = 0; k < 4; k++) {
        int i = (knot + k + WAY - 1) % WAY;
        *eye = vat(*eye, weights[k], eye_of(i));
        *at = vat(*at, weights[k], way[i].at);
    }
}

/* Around the block in the middle of the corridor. */
static void in_corridor(double turns, sf_vec3 *eye, sf_vec3 *at) {
    const double radius = 3.35, height = 1.5, ahead = pi / 6, far = 5, low = 1.1;
    double angle = 2 * pi * turns, next = angle + ahead;
    *eye = vec3(radius * sin(angle), -radius * cos(angle), height);
    *at = vec3(far * sin(next), -far * cos(next), low);
}

void sf_walk_init(sf_walk *walk, sf_walk_way which, uint64_t seed) {
    const double most_turn = 0.045, most_by = 0.03; /* radians, world units */
    sf_rng rng;
    walk->way = which;
    sf_rng_seed(&rng, seed);
    for (int i = 0; i < SF_WALK_WAVES; i++) walk->phase[i] = 2 * pi * sf_rng_uniform(&rng);
    for (int i = 0; i < SF_WALK_JERKS; i++) {
        double v[6];
        walk->jerk[i].at = (i + 0.2 + 0.6 * sf_rng_uniform(&rng)) * SF_WALK_SECONDS / SF_WALK_JERKS;
        for (int k = 0; k < 6; k++) v[k] = 2 * sf_rng_uniform(&rng) - 1;
        walk->jerk[i].turn = vscale(vec3(v[0], v[1], v[2]), most_turn);
        walk->jerk[i].by = vscale(vec3(v[3], v[4], v[5]), most_by);
    }
}

/* Three waves of whole numbers of turns in a walk, of size 1 together at most. */
static double sway(const sf_walk *walk, int which, double turn) {
    static const double turns[3] = {19, 37, 83}, size[3] = {0.55, 0.3, 0.15};
    double sum = 0;
    for (int k = 0; k < 3; k++) sum += size[k] * sin((turns[k] + which) * turn + walk->phase[3 * which + k]);
    return sum;
}

/* What the hand adds at a time in the walk: a turn in the camera's axes, and a shift in the world. */
static void shake(const sf_walk *walk, double seconds, sf_vec3 *turn, sf_vec3 *by) {
    const double size = 0.012, reach = 0.03, width = 0.12; /* radians, world units, s */
    double t = 2 * pi * seconds / SF_WALK_SECONDS;
    *turn = vscale(vec3(sway(walk, 0, t), sway(walk, 1, t), sway(walk, 2, t)), size);
    *by = vscale(vec3(sway(walk, 3, t), sway(walk, 4, t), sway(walk, 5, t)), reach);
    for (int i = 0; i < SF_WALK_JERKS; i++) {
        double off = (seconds - walk->jerk[i].at) / width, bump = exp(-off * off / 2);
        *turn = vat(*turn, bump, walk->jerk[i].turn);
        *by = vat(*by, bump, walk->jerk[i].by);
    }
}

void sf_camera_aim(sf_camera *camera, sf_vec3 from, sf_vec3 at, double roll) {
    sf_vec3 forward = vunit(vsub(at, from)), right = vunit(vcross(forward, vec3(0, 0, 1)));
    sf_vec3 down = vcross(forward, right);
    sf_vec3 rows[3] = {vat(vscale(right, cos(roll)), sin(roll), down),
                       vat(vscale(down, cos(roll)), -sin(roll), right), forward};
    for (int i = 0; i < 3; i++) {
        camera->R_cw[3 * i] = rows[i].x;
        camera->R_cw[3 * i + 1] = rows[i].y;
        camera->R_cw[3 * i + 2] = rows[i].z;
        camera->t_cw[i] = -vdot(rows[i], from);
    }
}

void sf_walk_pose(const sf_walk *walk, double seconds, sf_camera *camera) {
    double turns = seconds / SF_WALK_SECONDS;
    turns -= floor(turns);
    sf_vec3 eye, at, turn, by;
    if (walk->way == SF_WALK_CORRIDOR)
        in_corridor(turns, &eye, &at);
    else
        on_way(turns * WAY, &eye, &at);
    shake(walk, turns * SF_WALK_SECONDS, &turn, &by);
    sf_camera_aim(camera, vadd(eye, by), at, 0);
    double phi[3] = {turn.x, turn.y, turn.z}, Q[9], R[9], t[3];
    sf_rotation_exp(phi, Q);
    sf_mat3_mul(Q, camera->R_cw, R);
    sf_mat3_vec(Q, camera->t_cw, t);
    memcpy(camera->R_cw, R, sizeof R);
    memcpy(camera->t_cw, t, sizeof t);
}
