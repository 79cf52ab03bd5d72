/* pose_line.h - one line of poses: time tx ty tz qx qy qz qw. */
#ifndef SF_POSE_POSE_LINE_H
#define SF_POSE_POSE_LINE_H

#include <stddef.h>
#include <stdint.h>

#include <splatfit/status.h>

enum { SF_POSE_LINE = 512, SF_POSE_FAULT = 160 }; /* bytes */

typedef struct sf_timed_pose {
    int64_t time_ns;
    double center[3]; /* of the camera in the world */
    double quat[4];   /* x, y, z, w: camera to world, of length 1 */
} sf_timed_pose;

/* Reads a line that ends in 0. SF_ERR_EMPTY: blank, or a comment (#); SF_ERR_FORMAT: `fault` says which field
 * is wrong, and its value. Fields are set apart by spaces, tabs or commas; what follows the eighth is left
 * alone only where it is a comment. */
sf_status sf_pose_line_read(const char *line, sf_timed_pose *pose, char fault[SF_POSE_FAULT]);

/* The pose at a time from a's to b's, which is later. */
void sf_timed_pose_between(const sf_timed_pose *a, const sf_timed_pose *b, int64_t time_ns,
                           sf_timed_pose *pose);

/* a, then b in a's frame: T = T_a T_b, at a's time. */
void sf_timed_pose_join(const sf_timed_pose *a, const sf_timed_pose *b, sf_timed_pose *pose);

/* World to camera. */
void sf_timed_pose_view(const sf_timed_pose *pose, double R_cw[9], double t_cw[3]);

#endif
