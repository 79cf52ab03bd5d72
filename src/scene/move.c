/* move.c - brings the arrays that follow the Gaussians into a new order.
 *
 * Blocks are built one after another from where their Gaussians were, and put in place when LAG more are
 * built: as a model is nearly in order, nothing needs a block any longer then, and a few cached blocks are
 * all the scratch memory. Gaussians that come from blocks already replaced are far: they are copied before.
 * Each array is the task of one thread.
 */
#include "gaussians.h"

#include <string.h>

#include "../base/pool.h"

enum {
    WORD = 4,        /* bytes */
    LAG = 256,       /* blocks: 4,096 Gaussians, 340 KB of the largest field */
    MOST_SETS = 8,   /* of scratch memory */
    MOST_PLAIN = 16, /* bytes */
    MOST_WORDS = 3 * (2 * SF_MAX_SH_DEGREE + 1)
};
#define FAR 0x80000000u /* in order->from: the rest is the number among the far ones */

static size_t block_of(size_t i) { return i / SF_LANES; }

/* Whether block `from` is replaced before block `to` is built. */
static int is_replaced(int falling, size_t from, size_t to) {
    return falling ? from >= to + LAG : from + LAG <= to;
}

static size_t count_far(const sf_order *order, int falling) {
    size_t far = 0;
    for (size_t i = 0; i < order->banded[0]; i++)
        far += (size_t)is_replaced(falling, block_of(order->from[i]), block_of(i));
    return far;
}

static size_t least_of(size_t a, size_t b) { return a < b ? a : b; }

/* Notes which blocks change: those with another Gaussian, and those in which a band ends. */
static sf_status note_changes(sf_context *ctx, sf_order *order) {
    size_t n = order->banded[0];
    order->changes = sf_calloc(ctx, sf_blocks(n) + 1, 1);
    if (!order->changes) return SF_ERR_MEMORY;
    for (size_t i = 0; i < n; i++)
        if (order->from[i] != i) order->changes[block_of(i)] = 1;
    for (int band = 0; band < SF_BANDS; band++) order->changes[block_of(order->banded[band])] = 1;
    return SF_OK;
}

/* Notes which Gaussians are far, in the direction in which they are fewer. */
static sf_status note_far(sf_context *ctx, sf_order *order) {
    size_t rising = count_far(order, 0), falling = count_far(order, 1), k = 0;
    order->falling = falling < rising;
    order->far_count = least_of(rising, falling);
    order->far_from = sf_alloc(ctx, order->far_count + 1, sizeof *order->far_from);
    if (!order->far_from) return SF_ERR_MEMORY;
    for (size_t i = 0; i < order->banded[0]; i++) {
        uint32_t from = order->from[i];
        if (!is_replaced(order->falling, block_of(from), block_of(i))) continue;
        order->far_from[k] = from;
        order->from[i] = FAR | (uint32_t)k++;
        for (int band = 0; band < SF_BANDS; band++) order->far_banded[band] += i < order->banded[band];
    }
    return SF_OK;
}

/* Words of scratch memory for an array. */
static size_t words_of(const sf_order *order, int band, size_t words) {
    size_t lag = least_of(LAG, sf_blocks(order->banded[band]));
    return words * (lag * SF_LANES + order->far_banded[band]);
}

/* Words of a set of scratch memory: for any field and any plain values. */
static size_t words_of_set(const sf_order *order) {
    size_t most = words_of(order, 0, MOST_PLAIN / WORD);
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        size_t words = words_of(order, sf_field_band(field), (size_t)sf_field_components(field));
        if (words > most) most = words;
    }
    return most;
}

sf_status sf_order_prepare(sf_context *ctx, sf_order *order) {
    size_t threads = (size_t)sf_pool_threads(ctx->pool);
    sf_status status = note_changes(ctx, order);
    if (!status) status = note_far(ctx, order);
    if (status) return status;
    order->set_words = words_of_set(order);
    /* together no more than a copy of the largest array */
    size_t most = MOST_WORDS * order->banded[SF_MAX_SH_DEGREE] / (order->set_words + 1);
    order->sets = least_of(least_of(threads, MOST_SETS), most > 1 ? most : 1);
    order->scratch = sf_alloc(ctx, order->sets * order->set_words + 1, WORD);
    order->ctx = ctx;
    return order->scratch ? SF_OK : SF_ERR_MEMORY;
}

void sf_order_free(sf_context *ctx, sf_order *order) {
    sf_free(ctx, order->from);
    sf_free(ctx, order->changes);
    sf_free(ctx, order->far_from);
    sf_free(ctx, order->scratch);
    *order = (sf_order){0};
}

void sf_order_add_blocked(sf_order *order, int components, int band, void *array, size_t had) {
    order->array[order->arrays++] = (sf_ordered_array){.array = array,
                                                       .had = had,
                                                       .now = order->banded[band],
                                                       .far = order->far_banded[band],
                                                       .words = (size_t)components,
                                                       .lane_step = 1,
                                                       .word_step = SF_LANES};
}

void sf_order_add_values(sf_order *order, void *values, size_t size, size_t count) {
    order->array[order->arrays++] = (sf_ordered_array){.array = values,
                                                       .had = count,
                                                       .now = order->banded[0],
                                                       .far = order->far_banded[0],
                                                       .words = size / WORD,
                                                       .lane_step = size / WORD,
                                                       .word_step = 1};
}

static uint32_t *place_of(const sf_ordered_array *a, size_t i) {
    return a->array + i / SF_LANES * SF_LANES * a->words + i % SF_LANES * a->lane_step;
}

/* Copies a Gaussian's values. */
static void copy_values(const sf_ordered_array *a, const uint32_t *from, size_t from_step, uint32_t *to) {
    size_t words = a->words;
    if (from_step == SF_LANES && a->word_step == SF_LANES)
        for (size_t w = 0; w < words; w++) to[w * SF_LANES] = from[w * SF_LANES];
    else
        for (size_t w = 0; w < words; w++) to[w * a->word_step] = from[w * from_step];
}

/* Builds block b; lanes without a source are 0. */
static void gather_block(const sf_order *order, const sf_ordered_array *a, const uint32_t *far, size_t b,
                         uint32_t *to) {
    size_t first = b * SF_LANES, lanes = least_of(a->now - first, SF_LANES);
    if (lanes < SF_LANES) memset(to, 0, SF_LANES * a->words * WORD);
    for (size_t lane = 0; lane < lanes; lane++, to += a->lane_step) {
        uint32_t from = order->from[first + lane], number = from & ~FAR;
        size_t was = from & FAR ? order->far_from[number] : from;
        if (was >= a->had)
            for (size_t w = 0; w < a->words; w++) to[w * a->word_step] = 0;
        else if (from & FAR)
            copy_values(a, far + number * a->words, 1, to);
        else
            copy_values(a, place_of(a, was), a->word_step, to);
    }
}

/* Copies the far ones. */
static void keep_far(const sf_order *order, const sf_ordered_array *a, uint32_t *far) {
    for (size_t k = 0; k < a->far; k++)
        for (size_t w = 0; w < a->words && order->far_from[k] < a->had; w++)
            far[k * a->words + w] = place_of(a, order->far_from[k])[w * a->word_step];
}

static void reorder_array(const sf_order *order, const sf_ordered_array *a, uint32_t *scratch) {
    size_t block = SF_LANES * a->words, blocks = sf_blocks(a->now), lag = least_of(LAG, blocks);
    uint32_t *far = scratch, *built = scratch + a->far * a->words;
    keep_far(order, a, far);
    for (size_t k = 0; k < blocks + lag; k++) { /* the one built `lag` blocks ago, then the next */
        uint32_t *at = built + k % lag * block;
        size_t done = k - lag, b = order->falling ? blocks - 1 - k : k;
        if (order->falling) done = blocks - 1 - done;
        if (k >= lag && order->changes[done]) memcpy(a->array + done * block, at, block * WORD);
        if (k < blocks && order->changes[b]) gather_block(order, a, far, b, at);
    }
    if (blocks < sf_blocks(a->had))
        memset(a->array + blocks * block, 0, (sf_blocks(a->had) - blocks) * block * WORD);
}

/* The arrays of one set of scratch memory. */
static void set_task(void *order_pointer, size_t set, int thread) {
    (void)thread;
    const sf_order *order = order_pointer;
    uint32_t *scratch = order->scratch;
    for (size_t k = 0; k < order->arrays; k++)
        if (order->array[k].set == set)
            reorder_array(order, &order->array[k], scratch + set * order->set_words);
}

/* Values that an array takes to move. */
static size_t size_of(const sf_ordered_array *a) { return a->words * a->now; }

/* Deals the arrays out, the largest first, each to the set with the fewest values. */
static void deal_arrays(sf_order *order) {
    size_t dealt[MOST_SETS] = {0};
    uint8_t done[SF_ORDERED_ARRAYS] = {0};
    for (size_t n = 0; n < order->arrays; n++) {
        size_t next = 0, set = 0;
        while (done[next]) next++;
        for (size_t k = next; k < order->arrays; k++)
            if (!done[k] && size_of(&order->array[k]) > size_of(&order->array[next])) next = k;
        for (size_t k = 1; k < order->sets; k++)
            if (dealt[k] < dealt[set]) set = k;
        order->array[next].set = set;
        dealt[set] += size_of(&order->array[next]);
        done[next] = 1;
    }
}

void sf_order_apply(sf_order *order) {
    deal_arrays(order);
    sf_pool_run(order->ctx->pool, order->sets, set_task, order);
    order->arrays = 0;
}
