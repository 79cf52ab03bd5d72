/* optimizer_state.h - the optimizer state of each parameter, and the offset of its moving average.
 *
 * Adam's two moments, as floats or in 16 bits each. SH from degree 1 on have no first moment, and one second
 * moment for the three channels of a coefficient: they are three quarters of the parameters, and momentum and
 * a second moment for each channel were measured to gain nothing (MEASURED.md).
 */
#ifndef SF_FIT_OPTIMIZER_STATE_H
#define SF_FIT_OPTIMIZER_STATE_H

#include "../scene/gaussians.h"

#include <splatfit/fitter.h>

enum { SF_MOMENT_PARTS = 3, SF_MOMENT_VALUE = 4 /* bytes */ };

/* Arrays blocked as those of the fields, in values of 4 bytes; NULL for what is not stored. First part: m as
 * floats, or words with both moments (src/kernels/kernels.h). Second part: v as floats; with words only of
 * the higher SH. Third part, if a moving average is kept: average minus parameter, of fields with momentum.
 */
typedef struct sf_optimizer_state {
    int format;      /* sf_moment_format */
    float mean_kept; /* decay of the moving average in a step; 0: none is kept */
    void *part[SF_MOMENT_PARTS][SF_FIELD_COUNT];
} sf_optimizer_state;

const char *sf_moment_part(const sf_optimizer_state *moments, int part);
/* Values of a part of a field, for each Gaussian; 0: not stored. */
int sf_moment_components(const sf_optimizer_state *moments, int part, int field);
/* Values of all parts of all fields, for each Gaussian with all bands up to sh_degree. */
int sf_moment_values(const sf_optimizer_state *moments, int sh_degree);
/* Whether the field has a first moment: the higher SH have none. */
static inline int sf_has_momentum(int field) { return field <= SF_FIELD_sh0; }

/* A state without arrays. A moving average over `ema_steps` steps is kept if that is above 1. */
sf_optimizer_state sf_optimizer_moments(int format, int64_t ema_steps);
/* Zeros, with the capacities of the model. On failure nothing is allocated. */
sf_status sf_optimizer_create(const sf_model *model, int format, int64_t ema_steps,
                              sf_optimizer_state *moments);
void sf_optimizer_destroy(sf_context *ctx, sf_optimizer_state *moments);

/* Call before sf_model_set_room and sf_model_reorder: the same change of the state. */
sf_status sf_optimizer_set_room(sf_optimizer_state *moments, const sf_model *model, int band, size_t room);
void sf_optimizer_reorder(const sf_optimizer_state *moments, const sf_model *model, sf_order *order);

/* For a new or changed Gaussian i: clears the first moment and the offset of the average, and keeps a part of
 * the second moment. With second moments of 0 the first steps would be 1 / sqrt(1 - beta2) times too long,
 * and visible. */
void sf_optimizer_restart(const sf_optimizer_state *moments, const sf_model *model, size_t i);
/* Clears the state of Gaussian i, or of all that there is room for. */
void sf_optimizer_reset(const sf_optimizer_state *moments, const sf_model *model, size_t i);
void sf_optimizer_reset_all(const sf_optimizer_state *moments, const sf_model *model);

/* Values at .. at+n-1 of the array of a field, whole blocks. */
typedef struct sf_value_range {
    int field;
    size_t at, n;
} sf_value_range;

/* Multiplies the second moments of blocks first .. end-1 by beta2, `steps` times one after another; those of
 * the fields with momentum, as floats. */
void sf_optimizer_decay_second(const sf_optimizer_state *moments, size_t first, size_t end, float beta2,
                               uint32_t steps);

/* One step for the parameters of a range; p, g: the first parameter and its gradient; key: seed of the
 * stochastic rounding, different for each step and field. */
void sf_optimizer_step(const sf_optimizer_state *moments, const sf_kernels *kernels, sf_value_range range,
                       float *p, const float *g, const sf_adam *step, uint32_t key);

/* Update of the moving average of parameters at .. at+n-1 of a field's array, p the first of them.
 * sf_mean_open, before the parameters change, turns the offset into the average; sf_mean_close, afterwards,
 * moves the average and turns it into the new offset. */
void sf_mean_open(const sf_optimizer_state *moments, int field, size_t at, size_t n, const float *p);
void sf_mean_close(const sf_optimizer_state *moments, int field, size_t at, size_t n, const float *p);
/* Writes the moving averages of the first n values of a field that has them to p; from: its array. */
void sf_mean_take(const sf_optimizer_state *moments, int field, size_t n, const float *from, float *p);

#endif
