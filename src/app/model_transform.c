/* model_transform.c - a model turned, scaled, moved and cut, as the command line says. */
#include "model_transform.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

const arg_option model_transform_options[] = {
    {"up", 0, "AXIS",
     "the axis of IN that points up, x, -x, y, -y, z or -z: it is turned to -y, which is up in .ply files of "
     "trainers"},
    {"rotate", 0, "X,Y,Z", "then rotate by X degrees about the x axis, by Y about y, by Z about z"},
    {"scale", 0, "S", "then scale by S about the origin"},
    {"move", 0, "X,Y,Z", "then move by X,Y,Z"},
    {"crop", 0, "BOX",
     "then keep the Gaussians whose means lie in the box X0,Y0,Z0,X1,Y1,Z1, in the axes of OUT"},
    {0},
};

typedef struct motions {
    sf_similarity motion;
    double box[6];
    int moves, crops;
} motions;

int model_transform_up(const args *a, const char *text, double up[3]) {
    int minus = text[0] == '-';
    up[0] = up[1] = up[2] = 0;
    if (text[minus] < 'x' || text[minus] > 'z' || text[minus + 1]) {
        args_error(a->command, "--up: \"%s\" is none of x, -x, y, -y, z, -z", text);
        return EXIT_USAGE;
    }
    up[text[minus] - 'x'] = minus ? -1 : 1;
    return 0;
}

/* R = by R. */
static void turn(const double by[9], double R[9]) {
    double was[9];
    memcpy(was, R, sizeof was);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            R[3 * i + j] = 0;
            for (int k = 0; k < 3; k++) R[3 * i + j] += by[3 * i + k] * was[3 * k + j];
        }
}

/* By the angle (degrees) about the axis x, y or z. Quarter turns are exact. */
static void turn_about(int axis, double degrees, double R[9]) {
    double quarters = degrees / 90, angle = degrees * 0.017453292519943295;
    double c = cos(angle), s = sin(angle);
    if (quarters == floor(quarters)) {
        c = round(c);
        s = round(s);
    }
    int i = (axis + 1) % 3, j = (axis + 2) % 3;
    double by[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    by[4 * i] = by[4 * j] = c;
    by[3 * j + i] = s;
    by[3 * i + j] = -s;
    turn(by, R);
}

/* The shortest way to -y; from y half a turn about x, so that x stays. */
static int set_up(const args *a, const char *text, double R[9]) {
    double up[3];
    int error = model_transform_up(a, text, up);
    if (error) return error;
    if (up[1] > 0) turn_about(0, 180, R);
    if (up[0] != 0) turn_about(2, up[0] > 0 ? -90 : 90, R);
    if (up[2] != 0) turn_about(0, up[2] > 0 ? 90 : -90, R);
    return 0;
}

static int check_box(const args *a, const double box[6]) {
    for (int k = 0; k < 3; k++)
        if (!(box[k] < box[3 + k])) {
            args_error(a->command, "--crop: %c: %g is not below %g", 'x' + k, box[k], box[3 + k]);
            return EXIT_USAGE;
        }
    return 0;
}

static int read_motions(const args *a, motions *m) {
    const char *up = args_value(a, "up");
    double angles[3] = {0, 0, 0};
    *m = (motions){.motion = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .scale = 1}};
    int error = up ? set_up(a, up, m->motion.R) : 0;
    if (!error) error = args_numbers(a, "rotate", 3, angles);
    for (int k = 0; k < 3 && !error; k++) turn_about(k, angles[k], m->motion.R);
    if (!error) error = args_numbers(a, "scale", 1, &m->motion.scale);
    if (!error && !(m->motion.scale > 0)) {
        app_say(a, "--scale", "is not above 0");
        error = EXIT_USAGE;
    }
    if (!error) error = args_numbers(a, "move", 3, m->motion.move);
    if (!error) error = args_numbers(a, "crop", 6, m->box);
    m->crops = args_value(a, "crop") != NULL;
    m->moves = up || args_value(a, "rotate") || args_value(a, "scale") || args_value(a, "move");
    return error || !m->crops ? error : check_box(a, m->box);
}

int model_transform_apply(const args *a, sf_context *ctx, sf_model *model, int *moved) {
    motions m;
    int error = read_motions(a, &m);
    if (error) return error;
    *moved = m.moves;
    if (!model) return 0;
    if (m.moves && sf_model_transform(model, &m.motion)) return app_fail(a, ctx);
    return m.crops && sf_model_crop(model, m.box, m.box + 3) ? app_fail(a, ctx) : 0;
}
