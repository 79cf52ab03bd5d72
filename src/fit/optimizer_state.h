/* optimizer_state.h - what the optimiser remembers of each parameter, and how far a running mean of it is
 * off.
 *
 * Adam's two moments, as floats or in 16 bits each. SH from degree 1 on have no first one, and one second one
 * for the three channels of a coefficient: three quarters of the parameters are there, and their momentum,
 * and a scale of its own for each channel, were measured to be worth nothing (MEASURED.md).
 */
#ifndef SF_FIT_OPTIMIZER_STATE_H
#define SF_FIT_OPTIMIZER_STATE_H

#include "../scene/gaussians.h"

#include <splatfit/fitter.h>

enum { SF_MOMENT_PARTS = 3, SF_MOMENT_VALUE = 4 /* bytes */ };

/* The parts' arrays are blocked as those of the fields, in values of 4 bytes: m and v as floats, or words
 * with both (src/kernels/kernels.h) in the first part and floats in the second, which only the higher SH
 * have. The third has floats, where a mean is kept: mean less parameter, of those that have momentum. NULL
 * for what is not stored. */
typedef struct sf_optimizer_state {
    int format;      /* sf_moment_format */
    float mean_kept; /* of the mean, in each step; 0: there is none */
    void *part[SF_MOMENT_PARTS][SF_FIELD_COUNT];
} sf_optimizer_state;

const char *sf_moment_part(const sf_optimizer_state *moments, int part);
/* Values of a field's part, of a Gaussian; 0: there is no such part. */
int sf_moment_components(const sf_optimizer_state *moments, int part, int field);
/* Values of all parts of all fields, of a Gaussian with all bands up to sh_degree. */
int sf_moment_values(const sf_optimizer_state *moments, int sh_degree);
/* Whether steps go on in the direction of those before: those of the higher SH do not. */
static inline int sf_has_momentum(int field) { return field <= SF_FIELD_sh0; }

/* Without arrays: what there would be. A mean is kept of `ema_steps` steps, if that is above 1. */
sf_optimizer_state sf_optimizer_moments(int format, int64_t ema_steps);
/* Zeros, with room for as many as the model has room for. On failure none is left. */
sf_status sf_optimizer_create(const sf_model *model, int format, int64_t ema_steps,
                              sf_optimizer_state *moments);
void sf_optimizer_destroy(sf_context *ctx, sf_optimizer_state *moments);

/* What sf_model_set_room and sf_model_reorder do to the model, before they do it. */
sf_status sf_optimizer_set_room(sf_optimizer_state *moments, const sf_model *model, int band, size_t room);
void sf_optimizer_reorder(const sf_optimizer_state *moments, const sf_model *model, const sf_order *order);

/* Gaussian i is not what it was: it has no direction yet, and begins with a part of the squares of what it
 * was made of. From squares of 0 the first steps would be 1 / sqrt(1 - beta2) times too long, and be seen. */
void sf_optimizer_restart(const sf_optimizer_state *moments, const sf_model *model, size_t i);
/* Those of Gaussian i of the model, and of all that there is room for, back to 0. */
void sf_optimizer_reset(const sf_optimizer_state *moments, const sf_model *model, size_t i);
void sf_optimizer_reset_all(const sf_optimizer_state *moments, const sf_model *model);

/* Values at .. at+n-1 of the array of a field, whole blocks. */
typedef struct sf_value_range {
    int field;
    size_t at, n;
} sf_value_range;

/* One step for the parameters of a range; p, g: the first parameter and its gradient. key: of the random
 * rounding, another one for each step and field. */
void sf_optimizer_step(const sf_optimizer_state *moments, const sf_kernels *kernels, sf_value_range range,
                       float *p, const float *g, const sf_adam *step, uint32_t key);

/* Around what moves parameters at .. at+n-1 of an array of a field, p their first: before, the third part
 * becomes the mean; afterwards the mean takes its step, and what is left is how far it is off. */
void sf_mean_open(const sf_optimizer_state *moments, int field, size_t at, size_t n, const float *p);
void sf_mean_close(const sf_optimizer_state *moments, int field, size_t at, size_t n, const float *p);
/* p[0..n-1]: the means of the first n values of a field that has them; from: its array. */
void sf_mean_take(const sf_optimizer_state *moments, int field, size_t n, const float *from, float *p);

#endif
