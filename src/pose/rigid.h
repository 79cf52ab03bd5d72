/* rigid.h - rigid motions: chains, ways back, and the twists between them. */
#ifndef SF_POSE_RIGID_H
#define SF_POSE_RIGID_H

/* Parameters of a pose: its left twist (rho, phi). */
enum { SF_TWIST = 6 };

/* p' = R p + t; of a pose, from the world to the camera. R is row-major. */
typedef struct sf_rigid {
    double R[9], t[3];
} sf_rigid;

/* T = (exp(phi), rho) T for the twist (rho, phi), with the rotation kept orthonormal. */
void sf_rigid_move(sf_rigid *T, const double twist[SF_TWIST]);

/* The twist that takes the pose `from` to `to`: to = (exp(phi), rho) from. */
void sf_rigid_twist(const sf_rigid *from, const sf_rigid *to, double twist[SF_TWIST]);

/* to = T(at), and the way back. */
void sf_rigid_apply(const sf_rigid *T, const double at[3], double to[3]);
void sf_rigid_apply_back(const sf_rigid *T, const double at[3], double to[3]);

/* c(p) = a(b(p)). c may be a or b. */
void sf_rigid_compose(const sf_rigid *a, const sf_rigid *b, sf_rigid *c);
void sf_rigid_invert(const sf_rigid *a, sf_rigid *inverse);

/* The place of a camera whose pose (world to camera) is T. */
void sf_rigid_center(const sf_rigid *T, double center[3]);

/* How far apart two cameras are: the angle between their directions, rad; the distance of their places. */
void sf_rigid_gap(const sf_rigid *a, const sf_rigid *b, double *angle, double *apart);

#endif
