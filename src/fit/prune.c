/* prune.c - prunes a finished model, at a given loss of PSNR or to a given number of Gaussians.
 *
 * The cost of removing one Gaussian is known exactly (select_importance.h); that of removing many is not,
 * since each may correct the error of others. So Gaussians are sorted by their squared change of the
 * pictures, which relies on no residual, and bisection on renders finds how many may be removed. This is done
 * in rounds, each of which may spend a part of the loss: the importance of the others rises as neighbours are
 * removed.
 */
#include <splatfit/prune.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compare.h"
#include "fit.h"
#include "select_importance.h"

enum {
    ROUNDS = 4,       /* each may spend the same part of the loss */
    MORE_ROUNDS = 2,  /* at most, after those, at the whole loss */
    COARSENESS = 64,  /* a bisection ends when it knows the number to the items / COARSENESS, */
    FINENESS = 256,   /* in the last rounds to the items / FINENESS */
    REFIT_ROUNDS = 8, /* cuts tried with refitting */
};
/* The part of the loss that SH bands may cause. */
#define BANDS_PART 0.3
/* With refitting: the first and the smallest cut, as parts of the Gaussians. */
#define FIRST_CUT 0.25
#define LEAST_CUT 0.03
/* Factor of the default learning rates while refitting: the model is nearly converged. */
#define REFIT_RATE 0.2

/* A Gaussian or SH band that may be removed. */
typedef struct item {
    float cost;
    uint32_t gaussian;
    int degree; /* SH degree that the Gaussian keeps; -1: it is removed */
} item;

typedef struct pruner {
    sf_context *ctx;
    sf_scene *scene;
    const sf_prune_options *options;
    sf_fitter *fitter; /* renders the views; its model is the tried one */
    sf_model *kept;    /* as pruned so far */
    double psnr;       /* of kept */
    size_t renders;
    item *items; /* by rising cost */
    size_t item_count;
    int8_t *degrees; /* [kept->count], scratch */
} pruner;

sf_prune_options sf_prune_options_default(void) {
    sf_prune_options options = {.loss = 0.1, .seed = 1, .render = sf_render_options_default()};
    options.render.near_plane = 0;
    return options;
}

/* Mean PSNR of the tried model over the training views. */
static sf_status measure(pruner *p, double *psnr) {
    sf_view **list;
    size_t count, views = 0;
    sf_status status = sf_scene_retain_training(p->scene, &list, &count);
    *psnr = 0;
    for (size_t i = 0; i < count && !status; i++) {
        double of_view;
        status = sf_view_psnr(p->fitter, list[i], &of_view);
        if (status || isnan(of_view)) continue; /* wholly masked */
        *psnr += of_view;
        views++;
    }
    sf_scene_release_all(p->scene, list, count);
    if (!status) p->renders++;
    if (!status && !views) return sf_fail(p->ctx, SF_ERR_EMPTY, "scene: all training views are masked");
    *psnr /= (double)views;
    return status;
}

/* Copies Gaussian i >= k of the tried model to index k, with the bands up to a degree; higher ones become 0.
 */
static void copy_bands(const sf_params *tried, size_t i, size_t k, int degree) {
    for (int field = 0; field < SF_FIELD_COUNT && tried->field[field]; field++)
        for (int c = 0; c < sf_field_components(field); c++)
            *sf_value(tried, field, k, c) =
                sf_field_band(field) <= degree ? *sf_value(tried, field, i, c) : 0;
}

/* Makes the tried model: p->kept without the first n items. */
static void try_without(pruner *p, size_t n) {
    sf_model *tried = p->fitter->model;
    size_t kept = 0;
    memset(p->degrees, p->kept->sh_degree, p->kept->count);
    for (size_t i = 0; i < n; i++) {
        int8_t *degree = &p->degrees[p->items[i].gaussian];
        if (p->items[i].degree < *degree) *degree = (int8_t)p->items[i].degree;
    }
    sf_model_assign(tried, p->kept);
    for (size_t i = 0; i < p->kept->count; i++)
        if (p->degrees[i] >= 0) copy_bands(&tried->params, i, kept++, p->degrees[i]);
    sf_model_resize(tried, kept);
}

/* Keeps the tried model, of this PSNR. */
static void accept(pruner *p, double psnr) {
    const sf_model *tried = p->fitter->model;
    sf_model_assign(p->kept, tried);
    p->psnr = psnr;
}

/* Removes as many items as possible, at most `most`, while the PSNR is `floor` or more; *removed: how many,
 * known to the items / fineness. p->kept must have such a PSNR. */
static sf_status remove_most(pruner *p, size_t most, double floor, int fineness, size_t *removed) {
    size_t least = 0, beyond = most + 1, step = p->item_count / (size_t)fineness + 1;
    double psnr = p->psnr, tried;
    while (beyond - least > step) {
        size_t middle = least + (beyond - least) / 2;
        try_without(p, middle);
        sf_status status = measure(p, &tried);
        if (status) return status;
        if (tried >= floor)
            least = middle, psnr = tried;
        else
            beyond = middle;
    }
    try_without(p, least);
    accept(p, psnr);
    *removed = least;
    return SF_OK;
}

static int compare(const void *a, const void *b) {
    const item *x = a, *y = b;
    if (x->cost != y->cost) return x->cost < y->cost ? -1 : 1;
    if (x->gaussian != y->gaussian) return x->gaussian < y->gaussian ? -1 : 1;
    return x->degree > y->degree ? -1 : 1;
}

/* Sum of squares of a band's coefficients. */
static double energy(const sf_model *model, size_t i, int band) {
    double sum = 0;
    for (int c = 0; c < sf_field_components(SF_FIELD_sh0 + band); c++) {
        double value = (double)*sf_value(&model->params, SF_FIELD_sh0 + band, i, c);
        sum += value * value;
    }
    return sum;
}

/* Lists the bands of each Gaussian. At the end of a fit no coefficient has a gradient. So the cost of a band
 * is the mean square over all directions of the colour that it adds, times the pixels that show the Gaussian,
 * divided by its floats. The error share stands for the pixels: the error is about the same everywhere. */
static void list_bands(pruner *p, const sf_importance *importance) {
    for (size_t i = 0; i < p->kept->count; i++) {
        double cost = 0;
        for (int band = p->kept->sh_degree; band > 0; band--) {
            double of_band = energy(p->kept, i, band);
            if (of_band == 0 && cost == 0) continue; /* it was removed already */
            double floats = 3.0 * (2 * band + 1);
            /* no band costs less than a higher one */
            cost = fmax(cost, of_band * (double)importance->error_share[i] / floats);
            p->items[p->item_count++] = (item){(float)cost, (uint32_t)i, band - 1};
        }
    }
}

/* Lists what may be removed, by rising cost. */
static sf_status list_items(pruner *p, int bands) {
    sf_importance importance;
    p->item_count = 0;
    sf_status status = sf_measure_importance(p->fitter, 0, &importance);
    if (!status && bands) list_bands(p, &importance);
    for (size_t i = 0; i < p->kept->count && !status && !bands; i++)
        p->items[p->item_count++] = (item){importance.score[i], (uint32_t)i, -1};
    sf_importance_free(p->ctx, &importance);
    if (!status) qsort(p->items, p->item_count, sizeof *p->items, compare);
    return status;
}

static void list_at_random(pruner *p) {
    sf_rng rng;
    sf_rng_seed(&rng, p->options->seed);
    p->item_count = p->kept->count;
    for (size_t i = 0; i < p->item_count; i++) p->items[i] = (item){0, (uint32_t)i, -1};
    for (size_t i = p->item_count; i > 1; i--) {
        size_t j = (size_t)sf_rng_below(&rng, i);
        item keep = p->items[i - 1];
        p->items[i - 1] = p->items[j];
        p->items[j] = keep;
    }
}

/* Removes the first n items whatever the loss. */
static sf_status remove_first(pruner *p, size_t n) {
    double psnr;
    try_without(p, n);
    sf_status status = measure(p, &psnr);
    if (!status) accept(p, psnr);
    return status;
}

/* Removes Gaussians down to `count`, the same part of them in each round. */
static sf_status cut_to(pruner *p, size_t count, int rounds) {
    double part = pow((double)count / (double)p->kept->count, 1.0 / rounds);
    sf_status status = SF_OK;
    for (int round = rounds; round > 0 && !status && p->kept->count > count; round--) {
        size_t left = round > 1 ? (size_t)((double)p->kept->count * part) : count;
        status = list_items(p, 0);
        if (!status) status = remove_first(p, p->kept->count - (left < count ? count : left));
    }
    return status;
}

/* Floats of all Gaussians, without bands that are 0. */
static size_t floats_in_use(const sf_model *model) {
    size_t floats = 0;
    for (size_t i = 0; i < model->count; i++) {
        int degree = model->sh_degree;
        while (degree > 0 && energy(model, i, degree) == 0) degree--;
        for (int field = 0; field <= SF_FIELD_sh0 + degree; field++)
            floats += (size_t)sf_field_components(field);
    }
    return floats;
}

static void report(const pruner *p, const char *what) {
    sf_log(p->ctx, SF_LOG_INFO, "%s: %zu Gaussians, %zu floats in use, training views %.3f dB", what,
           p->kept->count, floats_in_use(p->kept), p->psnr);
}

/* Removes Gaussians, or bands, in rounds from the present PSNR down to `floor`. */
static sf_status prune_rounds(pruner *p, double floor, int bands) {
    double initial = p->psnr;
    sf_status status = SF_OK;
    for (int round = 1; round <= ROUNDS + MORE_ROUNDS && !status; round++) {
        double part = round < ROUNDS ? (double)round / ROUNDS : 1;
        size_t removed = 0;
        status = list_items(p, bands);
        if (status || !p->item_count) break;
        size_t most = bands ? p->item_count : p->item_count - 1;
        status = remove_most(p, most, initial - part * (initial - floor), part < 1 ? COARSENESS : FINENESS,
                             &removed);
        if (!status) report(p, bands ? "bands" : "pruned");
        if (round >= ROUNDS && removed <= p->item_count / FINENESS + 1) break;
    }
    return status;
}

static sf_fit_options refit_options(const pruner *p) {
    sf_fit_options o = sf_fit_options_default();
    o.steps = o.plan_steps = p->options->refit_steps;
    o.seed = (int64_t)(p->options->seed & INT64_MAX);
    o.max_gaussians = (int64_t)p->fitter->model->count;
    o.densify_every = o.steps + 1; /* no densification */
    o.validate = 0;
    o.size = SF_SIZE_CAP;
    o.sh_degree = p->kept->sh_degree;
    o.lr_mean *= REFIT_RATE, o.lr_scale *= REFIT_RATE, o.lr_quat *= REFIT_RATE;
    o.lr_opacity *= REFIT_RATE, o.lr_sh0 *= REFIT_RATE, o.lr_sh_rest *= REFIT_RATE;
    o.background = SF_BACKGROUND_COLOR;
    o.background_red = (double)p->options->render.background[0];
    o.background_green = (double)p->options->render.background[1];
    o.background_blue = (double)p->options->render.background[2];
    return o;
}

/* Trains the tried model further. */
static sf_status refit(pruner *p) {
    sf_fit_options o = refit_options(p);
    sf_fitter *fitter;
    sf_status status = sf_fitter_create(p->ctx, p->scene, p->fitter->model, &o, &fitter);
    if (status) return status;
    fitter->near_plane = p->fitter->near_plane;
    status = sf_fitter_run(fitter, NULL, NULL);
    sf_model *fitted = NULL;
    if (!status) status = sf_model_copy_whole(fitter->model, p->kept->sh_degree, &fitted);
    if (!status) sf_model_set_unit(fitted, 0);
    if (!status) sf_model_assign(p->fitter->model, fitted);
    sf_model_destroy(&fitted);
    sf_fitter_destroy(&fitter);
    return status;
}

/* Keeps cuts after which refitting reaches `floor`; halves the cut where it does not. */
static sf_status cut_and_refit(pruner *p, double floor) {
    double cut = FIRST_CUT, psnr;
    sf_status status = SF_OK;
    for (int round = 0; round < REFIT_ROUNDS && cut >= LEAST_CUT && !status; round++) {
        try_without(p, 0);
        status = list_items(p, 0);
        if (status) break;
        try_without(p, (size_t)(cut * (double)p->kept->count));
        status = refit(p);
        if (!status) status = measure(p, &psnr);
        if (status) break;
        if (psnr >= floor)
            accept(p, psnr);
        else
            cut *= 0.5;
        report(p, psnr >= floor ? "refitted" : "refitting is not enough");
    }
    return status;
}

static sf_status prune(pruner *p) {
    const sf_prune_options *o = p->options;
    double initial = p->psnr, floor = initial - o->loss;
    size_t removed;
    int bands = !o->keep_sh && p->kept->sh_degree > 0;
    if (o->random) {
        list_at_random(p);
        return o->keep ? remove_first(p, p->kept->count - o->keep)
                       : remove_most(p, p->item_count - 1, floor, FINENESS, &removed);
    }
    if (o->keep) {
        sf_status status = cut_to(p, o->keep, ROUNDS);
        if (status || !o->refit_steps) return status;
        status = refit(p);
        double psnr = 0;
        if (!status) status = measure(p, &psnr);
        if (!status) accept(p, psnr);
        return status;
    }
    double of_gaussians = bands ? initial - (1 - BANDS_PART) * o->loss : floor;
    sf_status status = prune_rounds(p, of_gaussians, 0);
    if (!status && o->refit_steps) status = cut_and_refit(p, of_gaussians);
    if (!status && bands) {
        try_without(p, 0);
        status = prune_rounds(p, floor, 1);
    }
    return status;
}

/* Makes a fitter that only renders: it has a copy of the model and no optimizer state. */
static sf_status make_fitter(pruner *p) {
    const sf_render_options *render = &p->options->render;
    sf_fit_options o = sf_fit_options_default();
    o.validate = 0; /* all training views count */
    sf_status status = sf_fitter_create_empty(p->ctx, p->scene, &o, &p->fitter);
    if (!status) status = sf_model_copy_whole(p->kept, p->kept->sh_degree, &p->fitter->model);
    if (status) return status;
    sf_fitter *f = p->fitter;
    f->sh_degree = p->kept->sh_degree;
    if (render->near_plane > 0) f->near_plane = render->near_plane;
    for (int k = 0; k < 3; k++) {
        f->step_background[k] = render->background[k];
        f->background[k] = (double)render->background[k];
    }
    return SF_OK;
}

static sf_status check(sf_context *ctx, const sf_model *model, const sf_prune_options *o) {
    if (!model->count) return sf_fail(ctx, SF_ERR_EMPTY, "model: holds no Gaussian");
    if (!(o->loss >= 0 && o->loss <= 100))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "loss: %g dB is not in 0..100", o->loss);
    if (o->keep > model->count)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "keep: %zu is more than the model's %zu Gaussians", o->keep,
                       model->count);
    if (!(o->refit_steps >= 0 && o->refit_steps <= 100000000))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "refit_steps: %lld is not in 0..100000000",
                       (long long)o->refit_steps);
    return SF_OK;
}

sf_status sf_prune(sf_context *ctx, sf_scene *scene, const sf_model *model, const sf_prune_options *options,
                   sf_model **pruned, sf_prune_result *result) {
    sf_prune_options defaults = sf_prune_options_default();
    pruner p = {.ctx = ctx, .scene = scene, .options = options ? options : &defaults};
    size_t most = model->count * (size_t)(model->sh_degree > 1 ? model->sh_degree : 1);
    double before = 0;
    *pruned = NULL;
    sf_status status = check(ctx, model, p.options);
    if (!status) status = sf_model_copy_whole(model, model->sh_degree, &p.kept);
    if (!status) status = make_fitter(&p);
    p.items = status ? NULL : sf_alloc(ctx, most, sizeof *p.items);
    p.degrees = status ? NULL : sf_alloc(ctx, model->count, sizeof *p.degrees);
    if (!status && (!p.items || !p.degrees)) status = SF_ERR_MEMORY;
    if (!status) status = measure(&p, &before);
    p.psnr = before;
    if (!status) status = prune(&p);
    if (!status) status = sf_model_pack(p.kept);
    if (!status) status = sf_model_copy(p.kept, p.kept->count, pruned);
    if (!status && result) *result = (sf_prune_result){before, p.psnr, p.renders};
    sf_fitter_destroy(&p.fitter);
    sf_model_destroy(&p.kept);
    sf_free(ctx, p.items);
    sf_free(ctx, p.degrees);
    return status;
}
