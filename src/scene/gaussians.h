/* gaussians.h - the inside of sf_model: the fields as the kernels take them.
 *
 * Gaussians are sorted by falling SH degree, so that those with a band come first: the array of a band ends
 * with the last Gaussian that has it.
 */
#ifndef SF_SCENE_GAUSSIANS_H
#define SF_SCENE_GAUSSIANS_H

#include "../base/context.h"
#include "../kernels/kernels.h"

#include <splatfit/model.h>

/* Logit of the opacity of an invisible Gaussian. */
#define SF_INVISIBLE (-20.0f)

/* Range of log-scales in files and models. Readers of other tools fail above it; below it the square of a
 * scale, an element of the covariance, is no normal float. */
#define SF_LOG_SCALE_LEAST (-40.0f)
#define SF_LOG_SCALE_MOST  20.0f

/* The least log-scale in training, where lengths are in units of about the scene's size. */
#define SF_LOG_SCALE_LEAST_TRAINED (-20.0f)

enum { SF_BANDS = SF_MAX_SH_DEGREE + 1 };

/* Gaussians that stay together when a model is divided into parts; pieces are dealt to the parts in turn. */
enum { SF_PIECE = 16 * SF_LANES };

struct sf_model {
    sf_context *ctx;
    int sh_degree; /* the highest that a Gaussian may have */
    int antialiased;
    double origin[3]; /* of the means, in the world */
    int unit;         /* means and scales are in units of 2^unit; 0 but while a fit trains the model */
    size_t parts;     /* of a model that was read in parts, this is one; 0: whole. Copies do not keep it */
    size_t count;     /* Gaussians */
    size_t banded[SF_BANDS];   /* Gaussian i has band b where i < banded[b]: count, then never rising; 0
                                  above sh_degree */
    size_t capacity[SF_BANDS]; /* Gaussians that the arrays of a band have room for, multiples of SF_LANES;
                                  all other fields go with band 0 */
    sf_params params;          /* lanes banded[b] .. capacity[b]-1 are neutral */
    uint64_t version;          /* of no other model of the context, nor of this one before
                                  sf_model_note_change */
};

/* Whether the coordinates are relative to another place than the world's 0. */
int sf_model_has_origin(const sf_model *model);

/* Changes model->unit; means exactly, log-scales rounded. The Gaussians stay as large as they are. */
void sf_model_set_unit(sf_model *model, int unit);

/* Marks the model as changed. Training steps do not call this, since no caller can hold a fit's model. */
void sf_model_note_change(sf_model *model);

/* Components of a field, whether a model of a degree stores it, and the band that it goes with. */
int sf_field_components(int field);
int sf_field_stored(int field, int sh_degree);
static inline int sf_field_band(int field) { return field > SF_FIELD_sh0 ? field - SF_FIELD_sh0 : 0; }

static inline float *sf_value(const sf_params *params, int field, size_t i, int component) {
    return &params->field[field][sf_at(i, sf_field_components(field), component)];
}

/* Blocks of SF_LANES that hold `count` Gaussians. */
static inline size_t sf_blocks(size_t count) { return (count + SF_LANES - 1) / SF_LANES; }

/* Values of a field's array, of whole blocks, for `count` Gaussians. */
static inline size_t sf_field_values(int field, size_t count) {
    return sf_blocks(count) * SF_LANES * (size_t)sf_field_components(field);
}

/* Arrays for room[b] Gaussians with band b (rounded up to SF_LANES), zeroed. On failure nothing is allocated.
 */
sf_status sf_params_create(sf_context *ctx, const size_t room[SF_BANDS], int sh_degree, sf_params *params);
void sf_params_destroy(sf_context *ctx, sf_params *params);

/* Reallocates a blocked array of 4-byte values with the given number of components for each Gaussian, to
 * `room` Gaussians. The first `used` keep their values, the others are 0. On failure the old array stays. */
sf_status sf_blocked_resize(sf_context *ctx, int components, void *array_pointer, size_t used, size_t room);

/* A model of neutral Gaussians, banded[b] of them with band b. Room for `capacity` >= banded[0]; bands that
 * not all have get room for those that have them. */
sf_status sf_model_create_banded(sf_context *ctx, const size_t banded[SF_BANDS], size_t capacity,
                                 int sh_degree, sf_model **model);

/* Sets the capacity of a band's arrays to `room` Gaussians, at least those that have the band. On failure the
 * model is unchanged. */
sf_status sf_model_set_room(sf_model *model, int band, size_t room);

/* Keeps the first `count` Gaussians; the lanes of the others become neutral. */
void sf_model_resize(sf_model *model, size_t count);

/* A copy, each Gaussian of its degree, with room as above. */
sf_status sf_model_copy(const sf_model *model, size_t capacity, sf_model **copy);
/* A copy in which all Gaussians have all bands up to sh_degree (new ones 0, higher ones dropped). */
sf_status sf_model_copy_whole(const sf_model *model, int sh_degree, sf_model **copy);
/* Replaces the Gaussians by those of a model of the same sh_degree; there must be room. */
void sf_model_assign(sf_model *model, const sf_model *from);

/* Copies from blocked arrays to the caller's plain ones; 0 for bands that a Gaussian lacks. */
void sf_params_get(const sf_params *params, const size_t banded[SF_BANDS], int sh_degree, size_t first,
                   size_t count, const sf_gaussians *to);

/* The SH degree of Gaussian i. */
int sf_degree_of(const sf_model *model, size_t i);

/* arrange.c: reordering. */

/* A copy of Gaussian `from`, with the bands up to `degree`. */
typedef struct sf_remap_entry {
    uint32_t from;
    uint8_t degree;
} sf_remap_entry;

/* An array that follows the Gaussians: of blocks, or of plain values. */
typedef struct sf_ordered_array {
    uint32_t *array;
    size_t had, now;             /* Gaussians with a value before and afterwards */
    size_t far;                  /* Gaussians that are copied first */
    size_t words;                /* of 4 bytes, of a Gaussian */
    size_t lane_step, word_step; /* from lane to lane of a block, and from word to word */
    size_t set;                  /* of scratch memory */
} sf_ordered_array;

enum { SF_ORDERED_ARRAYS = 40 };

/* Entries sorted by falling degree, and the arrays that follow. */
typedef struct sf_order {
    sf_context *ctx;
    uint32_t *from;          /* [banded[0]] */
    size_t banded[SF_BANDS]; /* afterwards */
    sf_ordered_array array[SF_ORDERED_ARRAYS];
    size_t arrays;
    /* see move.c */
    uint8_t *changes;   /* [blocks] whether a block changes */
    uint32_t *far_from; /* [far_count] where those were that must be copied first */
    size_t far_count, far_banded[SF_BANDS];
    int falling;   /* the last blocks are built first */
    void *scratch; /* [sets][set_words] words */
    size_t sets, set_words;
} sf_order;

/* Sorts n entries stably by falling degree. where[k] (may be NULL): the new index of entries[k].
 * sf_order_free releases it, also after a failure. */
sf_status sf_order_create(sf_context *ctx, const sf_remap_entry *entries, size_t n, uint32_t *where,
                          sf_order *order);
/* The same, but each entry whose Gaussian can keep its place keeps it, and the others fill what is left. */
sf_status sf_order_create_in_place(sf_context *ctx, const sf_remap_entry *entries, size_t n, uint32_t *where,
                                   sf_order *order);
/* Allocates what reordering needs, and changes order->from. */
sf_status sf_order_prepare(sf_context *ctx, sf_order *order);
void sf_order_free(sf_context *ctx, sf_order *order);

/* Adds a blocked array of values of 4 bytes that goes with a band, with at most as many components as a
 * field of it. `had`: Gaussians in it before. It must have room for those afterwards. Gaussians without a
 * value get 0. Or an array of `count` values of 4 to 16 bytes, a multiple of 4. */
void sf_order_add_blocked(sf_order *order, int components, int band, void *array, size_t had);
void sf_order_add_values(sf_order *order, void *values, size_t size, size_t count);
/* Reorders what was added. */
void sf_order_apply(sf_order *order);
/* Reorders a model, which must have room, with what was added. */
void sf_model_reorder(sf_model *model, sf_order *order);

/* Column `axis` of the rotation of Gaussian i (M.1), [3]. */
void sf_axis_of(const sf_params *params, size_t i, int axis, float *direction);

#endif
