/* vec3.h - three doubles: points, directions and colours of the simulated scene. */
#ifndef SF_SIM_VEC3_H
#define SF_SIM_VEC3_H

#include <math.h>
#include <stdint.h>

/* Without a library call, which floor, fmin and fmax are on some targets; no argument is NaN. */
static inline double lesser(double a, double b) { return a < b ? a : b; }
static inline double greater(double a, double b) { return a > b ? a : b; }
static inline int32_t whole_below(double x) {
    int32_t i = (int32_t)x; /* |x| < 2^31 */
    return i - (i > x);
}

typedef struct sf_vec3 {
    double x, y, z;
} sf_vec3;

static inline sf_vec3 vec3(double x, double y, double z) { return (sf_vec3){x, y, z}; }
static inline sf_vec3 vadd(sf_vec3 a, sf_vec3 b) { return vec3(a.x + b.x, a.y + b.y, a.z + b.z); }
static inline sf_vec3 vsub(sf_vec3 a, sf_vec3 b) { return vec3(a.x - b.x, a.y - b.y, a.z - b.z); }
static inline sf_vec3 vmul(sf_vec3 a, sf_vec3 b) { return vec3(a.x * b.x, a.y * b.y, a.z * b.z); }
static inline sf_vec3 vscale(sf_vec3 a, double s) { return vec3(a.x * s, a.y * s, a.z * s); }
static inline sf_vec3 vat(sf_vec3 a, double s, sf_vec3 b) { return vadd(a, vscale(b, s)); }
static inline sf_vec3 vmix(sf_vec3 a, sf_vec3 b, double t) { return vat(a, t, vsub(b, a)); }
static inline double vdot(sf_vec3 a, sf_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline double vlength(sf_vec3 a) { return sqrt(vdot(a, a)); }
static inline sf_vec3 vunit(sf_vec3 a) { return vscale(a, 1 / vlength(a)); }
static inline sf_vec3 vcross(sf_vec3 a, sf_vec3 b) {
    return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

#endif
