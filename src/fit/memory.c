/* memory.c - estimates the memory of a fit in advance.
 *
 * All sizes but those of the tile lists follow from the options. The number of tiles of a Gaussian depends on
 * the scene: MEAN_TILES is typical of fits that have reached their cap, TILE_LAYERS of the entries in a tile
 * where few and large Gaussians fill pictures, as after a start at random; both are estimated high.
 */
#include "memory.h"

#include <math.h>
#include <string.h>

#include "../base/memory.h"
#include "../base/pool.h"
#include "ranks.h"

enum {
    PLANES = 9,      /* floats a pixel of a render: colour, its gradient, transmittance, depth, last entry */
    LOSS_PLANES = 4, /* of the loss: target and weight */
    EVALUATION_PLANES = 7 /* of an evaluation: picture, weight, render */
};

/* Bytes of a Gaussian. DENSIFYING: candidates or relocation draws, remap entries and the order made of them.
 * WRITING: saving the result, most for .spz. */
enum { DENSIFYING = 16 + 2 * sizeof(uint32_t) + sizeof(sf_remap_entry), WRITING = 24 };
/* Model selection: the importance and neighbours of all Gaussians, and tentative merges of a quarter of them.
 * More are merged only in models that earlier rounds have made smaller. */
enum { SELECTING = 128 + sizeof(sf_merge) / 4 };

/* Mean entries (a Gaussian's tiles) and strips (its rows of tiles). */
#define MEAN_TILES  3.6
#define MEAN_STRIPS 2.5
#define TILE_LAYERS 100.0
#define LAYER_ROWS  0.5 /* strips an entry, of the TILE_LAYERS */
/* Factors of what the allocator holds: low for arrays that are made once, higher for those that grow or are
 * made again. */
#define ARRAY_SLACK 1.05
#define LIST_SLACK  1.05
#define PLANE_SLACK 1.1

/* The estimate is high, and a process that continues from a checkpoint has a little more resident memory than
 * the one that chose the cap. So what must fit may exceed the budget by this factor. */
#define OVERDRAFT 1.1

static const double mega = 1048576.0;

static size_t values_of(int sh_degree) {
    size_t values = 0;
    for (int i = 0; i < SF_FIELD_COUNT; i++)
        if (sf_field_stored(i, sh_degree)) values += (size_t)sf_field_components(i);
    return values;
}

/* Pixels of the largest picture in whole tiles; *stride: of the widest. */
static double largest_picture(sf_scene *scene, double *stride) {
    double most = 0;
    *stride = 0;
    pthread_mutex_lock(&scene->lock);
    for (size_t i = 0; i < scene->view_count; i++) {
        const sf_camera *c = &scene->views[i]->camera;
        double width = ceil((double)c->width / SF_TILE) * SF_TILE;
        most = fmax(most, width * ceil((double)c->height / SF_TILE) * SF_TILE);
        *stride = fmax(*stride, width);
    }
    pthread_mutex_unlock(&scene->lock);
    return most;
}

/* Bytes for each Gaussian, and bytes that do not depend on their number. */
typedef struct bill_rates {
    double gaussians, lists, results;
    double copy, drawn; /* of a result that is drawn: the copy; lists without sums */
    double fixed_lists, fixed_drawn, planes, evaluation;
} bill_rates;

static bill_rates rates_of(sf_fitter *f, int sh_degree) {
    const double drawn = 2 * sizeof(uint32_t) + sizeof(uint64_t);
    const double entry = drawn + SF_SUMS * sizeof(float);
    const double strip = sizeof(sf_span); /* the rest is where the sums of entries are later */
    const double seen =
        sizeof(sf_splat) + sizeof(uint8_t) + 2 * sizeof(uint16_t) + 3 * sizeof(uint32_t) + 2 * sizeof(float);
    double stride, pixels = largest_picture(f->scene, &stride);
    double threads = sf_pool_threads(f->ctx->pool), values = (double)values_of(sh_degree) * sizeof(float);
    double scratch = threads * (double)sf_loss_scratch((size_t)stride) * sizeof(float);
    double layers = TILE_LAYERS * pixels / SF_TILE_PIXELS;
    int planes = PLANES + LOSS_PLANES + (f->options.exposure ? SF_CHANNELS : 0);
    double pictures = pixels * planes * sizeof(float) + scratch;
    double halves = (double)sf_field_components(SF_FIELD_mean) * sizeof(uint16_t); /* means are whole */
    double models = values + values / 2 + halves; /* the model and the restore point */
    sf_optimizer_state moments = sf_optimizer_moments((int)f->options.moments, f->options.ema_steps);
    models += SF_MOMENT_VALUE * sf_moment_values(&moments, sh_degree);
    if (moments.mean_kept > 0) models += (double)values_of(0) * sizeof(float); /* the moving average */
    double densifying = DENSIFYING + (f->options.size == SF_SIZE_AUTO ? SELECTING : 0);
    return (bill_rates){.gaussians = models + sizeof *f->densify.gradient_sum +
                                     sizeof *f->densify.visible_count + sizeof *f->units.inverse + densifying,
                        .lists = seen + MEAN_TILES * entry + MEAN_STRIPS * strip,
                        .results = values + WRITING,
                        .copy = values,
                        .drawn = seen + MEAN_TILES * drawn + MEAN_STRIPS * strip,
                        .fixed_lists = layers * (entry + LAYER_ROWS * strip),
                        .fixed_drawn = layers * (drawn + LAYER_ROWS * strip),
                        .planes = pictures,
                        .evaluation = pictures + pixels * EVALUATION_PLANES * sizeof(float)};
}

static void fill_in(sf_memory_bill *bill, const bill_rates *r, double count) {
    bill->gaussians = (uint64_t)(ARRAY_SLACK * r->gaussians * count);
    bill->lists = (uint64_t)(LIST_SLACK * (r->lists * count + r->fixed_lists));
    bill->planes = (uint64_t)(PLANE_SLACK * r->planes);
    /* the arrays of a step are freed before the result is copied, written and drawn */
    double freed = (double)bill->lists + (double)bill->planes;
    double drawn = ARRAY_SLACK * r->copy * count + LIST_SLACK * (r->drawn * count + r->fixed_drawn) +
                   PLANE_SLACK * r->evaluation;
    bill->results = (uint64_t)fmax(fmax(ARRAY_SLACK * r->results * count, drawn) - freed, 0);
    bill->total = bill->before + bill->gaussians + bill->lists + bill->planes + bill->results;
}

/* The most Gaussians whose estimate is within the budget; the estimate rises with their number. */
static size_t most_within(const sf_memory_bill *bill, const bill_rates *r, size_t most) {
    sf_memory_bill tried = *bill;
    size_t least = 0;
    while (least < most) {
        size_t middle = least + (most - least + 1) / 2;
        fill_in(&tried, r, (double)middle);
        if (tried.total <= bill->budget)
            least = middle;
        else
            most = middle - 1;
    }
    return least;
}

/* Of several ranks each has a part of the Gaussians and of what is drawn; results are gathered on one. */
static void share_rates(const sf_fitter *f, bill_rates *rates) {
    double part = 1 / sf_total_of(f, 1);
    rates->gaussians *= part;
    rates->lists *= part, rates->fixed_lists *= part;
}

sf_status sf_fitter_plan_memory(sf_fitter *f, size_t least, int sh_degree) {
    sf_memory_bill *bill = &f->bill;
    bill_rates rates = rates_of(f, sh_degree);
    share_rates(f, &rates);
    size_t asked = (size_t)f->options.max_gaussians, most = asked;
    bill->budget = sf_memory_budget((uint64_t)f->options.memory);
    bill->before = sf_memory_resident() + sf_scene_missing_bytes(f->scene, bill->budget);
    if (bill->budget) most = most_within(bill, &rates, asked);
    if (sf_is_shared(f)) most = (size_t)-sf_most_of_ranks(f, -(double)most); /* the least of them */
    if (most < least) {
        fill_in(bill, &rates, (double)least);
        if ((double)bill->total <= OVERDRAFT * (double)bill->budget) most = least;
    }
    if (most < least)
        return sf_fail(
            f->ctx, SF_ERR_MEMORY,
            "memory: %.0f MB are not enough: %zu Gaussians take about %.0f MB, %.0f of them for the "
            "program and the pictures",
            (double)bill->budget / mega, least, (double)bill->total / mega, (double)bill->before / mega);
    fill_in(bill, &rates, (double)most);
    if (most < asked) {
        sf_log(f->ctx, SF_LOG_WARNING, "memory: max_gaussians lowered from %zu to %zu: %.0f MB hold no more",
               asked, most, (double)bill->budget / mega);
        f->options.max_gaussians = (int64_t)most;
    }
    return SF_OK;
}

void sf_fitter_watch_memory(sf_fitter *f) {
    if (f->densify.out_of_memory) return;
    uint64_t resident = f->bill.budget ? sf_memory_resident() : 0;
    if (!(sf_most_of_ranks(f, resident > f->bill.budget) > 0)) return;
    f->densify.out_of_memory = 1;
    sf_log(
        f->ctx, SF_LOG_WARNING,
        "memory: %.0f MB are in use, %.0f were allowed: the model stays at %zu Gaussians; the run cannot be "
        "repeated to the byte",
        (double)resident / mega, (double)f->bill.budget / mega, f->model->count);
}

void sf_fitter_get_memory(const sf_fitter *f, sf_memory_bill *bill) { *bill = f->bill; }
