/* arrange.c - reorders Gaussians by falling SH degree, or in any order.
 *
 * One field's array at a time is copied to scratch memory and back, so that the peak is one more array, not a
 * second model.
 */
#include "gaussians.h"

#include <string.h>

enum { VALUE = 4, MOST_PLAIN = 16 }; /* bytes */

int sf_degree_of(const sf_model *model, size_t i) {
    int degree = model->sh_degree;
    while (degree && i >= model->banded[degree]) degree--;
    return degree;
}

sf_status sf_order_create(sf_context *ctx, const sf_remap_entry *entries, size_t n, uint32_t *where,
                          sf_order *order) {
    size_t at[SF_BANDS];
    *order = (sf_order){.from = sf_alloc(ctx, n, sizeof *order->from)};
    if (!order->from) return SF_ERR_MEMORY;
    for (size_t k = 0; k < n; k++)
        for (int band = 0; band <= entries[k].degree; band++) order->banded[band]++;
    for (int degree = 0; degree < SF_BANDS; degree++) /* higher degrees come first */
        at[degree] = degree < SF_MAX_SH_DEGREE ? order->banded[degree + 1] : 0;
    for (size_t k = 0; k < n; k++) {
        size_t to = at[entries[k].degree]++;
        order->from[to] = entries[k].from;
        if (where) where[k] = (uint32_t)to;
    }
    while (order->unmoved < n && order->from[order->unmoved] == order->unmoved) order->unmoved++;
    return SF_OK;
}

/* The blocks of a band that change, without those that hold no Gaussian afterwards. */
static void changed_blocks(const sf_order *order, int band, size_t *first, size_t *end) {
    size_t count = order->banded[band];
    *first = (order->unmoved < count ? order->unmoved : count) / SF_LANES;
    *end = sf_blocks(count);
}

static size_t block_bytes(int components) { return (size_t)components * SF_LANES * VALUE; }

sf_status sf_order_prepare(sf_context *ctx, sf_order *order) {
    size_t first, end, most = MOST_PLAIN * order->banded[0];
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        changed_blocks(order, sf_field_band(field), &first, &end);
        size_t bytes = (end - first) * block_bytes(sf_field_components(field));
        if (bytes > most) most = bytes;
    }
    order->scratch = sf_alloc(ctx, most, 1);
    return order->scratch ? SF_OK : SF_ERR_MEMORY;
}

void sf_order_free(sf_context *ctx, sf_order *order) {
    sf_free(ctx, order->from);
    sf_free(ctx, order->scratch);
    *order = (sf_order){0};
}

/* Builds block b from its source Gaussians; lanes without a source are 0. */
static void gather_block(int components, const char *array, size_t had, const sf_order *order, size_t end,
                         size_t b, char *block) {
    size_t n = (size_t)components;
    memset(block, 0, block_bytes(components));
    for (size_t lane = 0; lane < SF_LANES && b * SF_LANES + lane < end; lane++) {
        size_t from = order->from[b * SF_LANES + lane];
        if (from >= had) continue;
        const char *value = array + VALUE * sf_at(from, (int)n, 0);
        for (size_t c = 0; c < n; c++)
            memcpy(block + VALUE * (c * SF_LANES + lane), value + VALUE * c * SF_LANES, VALUE);
    }
}

void sf_blocked_reorder(int components, int band, void *array, size_t had, const sf_order *order) {
    size_t first, end, block = block_bytes(components);
    char *values = array, *scratch = order->scratch;
    changed_blocks(order, band, &first, &end);
    for (size_t b = first; b < end; b++)
        gather_block(components, values, had, order, order->banded[band], b, scratch + (b - first) * block);
    if (end > first) memcpy(values + first * block, scratch, (end - first) * block);
    if (end * SF_LANES < had) memset(values + end * block, 0, (sf_blocks(had) - end) * block);
}

void sf_values_reorder(void *values, size_t size, size_t count, const sf_order *order) {
    char *at = values, *scratch = order->scratch;
    size_t n = order->banded[0];
    for (size_t k = 0; k < n; k++) memcpy(scratch + k * size, at + order->from[k] * size, size);
    memcpy(at, scratch, n * size);
    if (n < count) memset(at + n * size, 0, (count - n) * size);
}

/* The highest band of Gaussian i that is not all 0. */
static uint8_t used_degree(const sf_model *model, size_t i) {
    for (int degree = sf_degree_of(model, i); degree > 0; degree--) {
        int field = SF_FIELD_sh0 + degree, n = sf_field_components(field);
        for (int c = 0; c < n; c++)
            if (model->params.field[field][sf_at(i, n, c)] != 0) return (uint8_t)degree;
    }
    return 0;
}

sf_status sf_model_pack(sf_model *model) {
    sf_order order = {0};
    sf_remap_entry *entries = sf_alloc(model->ctx, model->count, sizeof *entries);
    if (!entries) return SF_ERR_MEMORY;
    for (size_t i = 0; i < model->count; i++)
        entries[i] = (sf_remap_entry){(uint32_t)i, used_degree(model, i)};
    sf_status status = sf_order_create(model->ctx, entries, model->count, NULL, &order);
    sf_free(model->ctx, entries);
    if (!status) status = sf_order_prepare(model->ctx, &order);
    if (!status) sf_model_reorder(model, &order);
    sf_order_free(model->ctx, &order);
    for (int band = 1; band <= model->sh_degree && !status; band++) {
        size_t room = model->banded[band]; /* on failure the arrays stay larger than needed */
        if (sf_blocks(room) * SF_LANES < model->capacity[band]) (void)sf_model_set_room(model, band, room);
    }
    return status;
}

void sf_model_degrees(const sf_model *model, size_t count[SF_MAX_SH_DEGREE + 1]) {
    for (int degree = 0; degree < SF_BANDS; degree++)
        count[degree] = model->banded[degree] - (degree < SF_MAX_SH_DEGREE ? model->banded[degree + 1] : 0);
}

size_t sf_model_floats(const sf_model *model) {
    size_t floats = 0;
    for (int f = 0; f < SF_FIELD_COUNT; f++)
        floats += model->banded[sf_field_band(f)] * (size_t)sf_field_components(f);
    return floats;
}
