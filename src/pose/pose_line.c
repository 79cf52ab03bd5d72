/* pose_line.c - one line of poses: time tx ty tz qx qy qz qw; poses between two. */
#include "pose_line.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/linear.h"
#include "../scene/gaussian_math.h"

enum { FIELDS = 8 };

static const char *const fields[FIELDS] = {"time", "tx", "ty", "tz", "qx", "qy", "qz", "qw"};
static const double MOST_TIME = 9e9, MOST_PLACE = 1e12, LEAST_LENGTH = 0.9, MOST_LENGTH = 1.1;
static const char gaps[] = " \t,\r\n";

static sf_status wrong(char fault[SF_POSE_FAULT], int field, const char *text, size_t length,
                       const char *why) {
    snprintf(fault, SF_POSE_FAULT, "%s: \"%.*s\" %s", fields[field], (int)(length < 40 ? length : 40), text,
             why);
    return SF_ERR_FORMAT;
}

/* Reads the field at *text and goes behind it. */
static sf_status read_field(const char **text, int field, double *value, char fault[SF_POSE_FAULT]) {
    char copy[48], *end;
    size_t length = strcspn(*text, " \t,\r\n#");
    const char *start = *text;
    double most = field == 0 ? MOST_TIME : MOST_PLACE;
    if (length == 0) {
        snprintf(fault, SF_POSE_FAULT, "%s: is missing", fields[field]);
        return SF_ERR_FORMAT;
    }
    *text += length;
    if (length >= sizeof copy || strspn(start, "0123456789+-.eE") < length)
        return wrong(fault, field, start, length, "is not a number");
    memcpy(copy, start, length);
    copy[length] = 0;
    *value = strtod(copy, &end);
    if (*end) return wrong(fault, field, start, length, "is not a number");
    if (!(fabs(*value) <= most)) return wrong(fault, field, start, length, "is out of range");
    return SF_OK;
}

sf_status sf_pose_line_read(const char *line, sf_timed_pose *pose, char fault[SF_POSE_FAULT]) {
    double value[FIELDS] = {0};
    line += strspn(line, gaps);
    if (*line == 0 || *line == '#') return SF_ERR_EMPTY;
    for (int i = 0; i < FIELDS; i++) {
        sf_status status = read_field(&line, i, &value[i], fault);
        if (status != SF_OK) return status;
        line += strspn(line, gaps);
    }
    if (*line && *line != '#') {
        snprintf(fault, SF_POSE_FAULT, "\"%.40s\": is more than the %d fields", line, FIELDS);
        return SF_ERR_FORMAT;
    }
    double length = sqrt(sf_dot3(value + 4, value + 4) + value[7] * value[7]);
    if (!(length >= LEAST_LENGTH && length <= MOST_LENGTH)) {
        snprintf(fault, SF_POSE_FAULT, "qx qy qz qw: the quaternion's length %g is not 1", length);
        return SF_ERR_FORMAT;
    }
    pose->time_ns = (int64_t)floor(value[0]) * 1000000000 + llround((value[0] - floor(value[0])) * 1e9);
    memcpy(pose->center, value + 1, sizeof pose->center);
    for (int i = 0; i < 4; i++) pose->quat[i] = value[4 + i] / length;
    return SF_OK;
}

/* Turns evenly from a to b, the shorter way. */
static void slerp(const double a[4], const double b[4], double t, double out[4]) {
    double cosine = sf_dot3(a, b) + a[3] * b[3], sign = cosine < 0 ? -1 : 1, u = 1 - t, length = 0;
    double angle = acos(fmin(fabs(cosine), 1)), sine = sin(angle);
    double of_a = sine < 1e-9 ? u : sin(u * angle) / sine, of_b = sine < 1e-9 ? t : sin(t * angle) / sine;
    for (int i = 0; i < 4; i++) {
        out[i] = of_a * a[i] + sign * of_b * b[i];
        length += out[i] * out[i];
    }
    for (int i = 0; i < 4; i++) out[i] /= sqrt(length);
}

void sf_timed_pose_between(const sf_timed_pose *a, const sf_timed_pose *b, int64_t time_ns,
                           sf_timed_pose *pose) {
    double span = (double)(b->time_ns - a->time_ns), t = span > 0 ? (double)(time_ns - a->time_ns) / span : 0;
    sf_timed_pose between = {.time_ns = time_ns};
    for (int i = 0; i < 3; i++) between.center[i] = a->center[i] + t * (b->center[i] - a->center[i]);
    slerp(a->quat, b->quat, t, between.quat);
    *pose = between;
}

static void rotation_of(const double q[4], double R[9]) { sf_unit_quat_rotation(q[3], q[0], q[1], q[2], R); }

void sf_timed_pose_join(const sf_timed_pose *a, const sf_timed_pose *b, sf_timed_pose *pose) {
    const double *p = a->quat, *q = b->quat;
    sf_timed_pose joined = {.time_ns = a->time_ns};
    double R[9], cross[3];
    rotation_of(p, R);
    sf_mat3_vec(R, b->center, joined.center);
    sf_cross3(p, q, cross);
    for (int i = 0; i < 3; i++) {
        joined.center[i] += a->center[i];
        joined.quat[i] = p[3] * q[i] + q[3] * p[i] + cross[i];
    }
    joined.quat[3] = p[3] * q[3] - sf_dot3(p, q);
    *pose = joined;
}

void sf_timed_pose_view(const sf_timed_pose *pose, double R_cw[9], double t_cw[3]) {
    double R[9], t[3];
    rotation_of(pose->quat, R);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R_cw[3 * i + j] = R[3 * j + i];
    sf_mat3_vec(R_cw, pose->center, t);
    for (int i = 0; i < 3; i++) t_cw[i] = -t[i];
}
