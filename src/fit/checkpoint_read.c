/* checkpoint_read.c - restores a fit from a checkpoint, and checks all that the file holds. */
#include "checkpoint.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/clock.h"
#include "../cluster/cluster.h"
#include "fit.h"
#include "memory.h"
#include "ranks.h"
#include "ranks_divide.h"
#include "reorder.h"
#include "schedule.h"
#include "time_trace.h"

/* The options that may differ when a run continues. */
static const char *const free_options[] = {"steps", "time_limit", "memory"};

static sf_status take_params(sf_sections_in *in, const char *prefix, const sf_model *model) {
    sf_status status = SF_OK;
    for (int i = 0; i < SF_FIELD_COUNT && !status; i++)
        if (model->params.field[i])
            status = sf_sections_take(in, sf_checkpoint_name(prefix, i).text, model->params.field[i],
                                      sf_checkpoint_values(model, i), sizeof(float));
    return status;
}

static sf_status take_moments(sf_sections_in *in, const sf_optimizer_state *moments, const sf_model *model) {
    sf_status status = SF_OK;
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int i = 0; i < SF_FIELD_COUNT && !status; i++)
            if (moments->part[part][i])
                status = sf_sections_take(in, sf_checkpoint_name(sf_moment_part(moments, part), i).text,
                                          moments->part[part][i],
                                          sf_checkpoint_moments(moments, part, model, i), SF_MOMENT_VALUE);
    return status;
}

/* Options. */

/* Takes the line at *at, which must set the option `info`; its newline is overwritten. */
static sf_status take_option(sf_sections_in *in, const sf_option_info *info, char **at,
                             sf_fit_options *options) {
    char *line = *at, *end = strchr(line, '\n'), *space = strchr(line, ' '), what[256];
    if (!end || !space || space > end) {
        snprintf(what, sizeof what, "%s is missing", info->name);
        return sf_checkpoint_bad(in, "options", what);
    }
    *end = *space = 0;
    *at = end + 1;
    if (strcmp(line, info->name)) {
        snprintf(what, sizeof what, "%.64s stands where %s is expected", line, info->name);
        return sf_checkpoint_bad(in, "options", what);
    }
    if (!sf_fit_options_set(in->ctx, options, info->name, space + 1)) return SF_OK;
    snprintf(what, sizeof what, "%.200s", sf_last_error(in->ctx));
    return sf_checkpoint_bad(in, "options", what);
}

static sf_status take_options(sf_sections_in *in, sf_fit_options *options) {
    char text[MOST_TEXT + 1], *at = text;
    uint64_t size;
    sf_status status = sf_sections_count(in, "options", 1, &size);
    if (!status && size > MOST_TEXT) status = sf_checkpoint_bad(in, "options", "is too long");
    if (!status) status = sf_sections_take(in, "options", text, (size_t)size, 1);
    if (status) return status;
    text[size] = 0;
    *options = sf_fit_options_default();
    sf_option_info info;
    for (size_t i = 0; !status && !sf_fit_option_info(i, &info); i++)
        status = take_option(in, &info, &at, options);
    if (!status && *at) status = sf_checkpoint_bad(in, "options", "holds more than this program knows");
    return status;
}

static int is_free(const char *name) {
    for (size_t i = 0; i < sizeof free_options / sizeof *free_options; i++)
        if (!strcmp(free_options[i], name)) return 1;
    return 0;
}

static sf_status check_options(const sf_sections_in *in, const sf_fit_options *kept,
                               const sf_fit_options *asked) {
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char was[OPTION_TEXT], is[OPTION_TEXT];
        sf_fit_options_get(kept, info.name, was, sizeof was);
        sf_fit_options_get(asked, info.name, is, sizeof is);
        if (strcmp(was, is) && !is_free(info.name))
            return sf_fail(in->ctx, SF_ERR_ARGUMENT, "%s: %s: the run has %s and cannot go on with %s",
                           in->path, info.name, was, is);
    }
    return SF_OK;
}

static sf_status take_integers(sf_sections_in *in, sf_fitter *f) {
    int64_t integers[INTEGERS], *at = integers;
    sf_status status = sf_sections_take(in, "integers", integers, INTEGERS, sizeof *integers);
    for (int i = 0; i < INTEGERS && !status; i++) {
        if (integers[i] < 0) status = sf_checkpoint_bad(in, "integers", "one is below 0");
        if (integers[i] > (int64_t)SF_CHECKPOINT_MOST)
            status = sf_checkpoint_bad(in, "integers", "one is out of range");
    }
    if (status) return status;
        /* some are kept in less than 64 bits */
#define VALUE(name)                                                                                          \
    f->name = *at;                                                                                           \
    if ((int64_t)f->name != *at++) return sf_checkpoint_bad(in, "integers", #name " is out of range");
    STATE_INTEGERS(VALUE)
#undef VALUE
    if (f->first_count > (size_t)f->options.max_gaussians)
        return sf_checkpoint_bad(in, "integers", "first_count is more than max_gaussians");
    if (f->sampler.at > f->sampler.count)
        return sf_checkpoint_bad(in, "integers", "sampler.at is beyond the pass");
    if (f->end >= SF_FIT_END_COUNT) return sf_checkpoint_bad(in, "integers", "end is out of range");
    if (f->recovery.since > f->step)
        return sf_checkpoint_bad(in, "integers", "recovery.since is after the step");
    if (f->optimizer_restart > f->step)
        return sf_checkpoint_bad(in, "integers", "optimizer_restart is after the step");
    return SF_OK;
}

static sf_status take_reals(sf_sections_in *in, sf_fitter *f) {
    double reals[REALS], *at = reals, seconds;
    sf_status status = sf_sections_take(in, "reals", reals, REALS, sizeof *reals);
    for (int i = 0; i < REALS && !status; i++)
        if (!(isfinite(reals[i]) && reals[i] >= 0))
            status = sf_checkpoint_bad(in, "reals", "one is below 0 or not finite");
    if (!status) status = sf_sections_take(in, "seconds", &seconds, 1, sizeof seconds);
    if (!status && !(isfinite(seconds) && seconds >= 0))
        status = sf_checkpoint_bad(in, "seconds", "is not a time");
    if (status) return status;
#define VALUE(name) f->name = *at++;
    STATE_REALS(VALUE)
#undef VALUE
    if (f->merges.part > 1) return sf_checkpoint_bad(in, "reals", "merges.part is above 1");
    if (f->sampler.start >= 1) return sf_checkpoint_bad(in, "reals", "sampler.start is not below 1");
    f->rate_time = sf_clock();
    f->rate_step = f->step;
    f->start = f->rate_time - seconds;
    return SF_OK;
}

static sf_status take_plan(sf_sections_in *in, sf_fitter *f) {
    sf_status status =
        sf_sections_take_new(in, "plan", &f->trace.ticks, &f->trace.count, INT32_MAX, sizeof *f->trace.ticks);
    if (status) return status;
    f->trace.capacity = f->trace.count;
    return sf_time_trace_check(f->ctx, f->trace.ticks, f->trace.count)
               ? sf_checkpoint_bad(in, "plan", "times do not rise")
               : SF_OK;
}

/* Reads the number of Gaussians with each band, at most `most`, and checks it against the length of the
 * parameters before memory is allocated. *none: the numbers are -1. */
static sf_status take_banded(sf_sections_in *in, const char *prefix, int sh_degree, size_t most,
                             size_t banded[SF_BANDS], int *none) {
    int64_t kept[SF_BANDS];
    char section[SF_SECTION_NAME];
    snprintf(section, sizeof section, "%s.banded", prefix);
    sf_status status = sf_sections_take(in, section, kept, SF_BANDS, sizeof *kept);
    *none = !status && kept[0] == -1;
    for (int band = 0; band < SF_BANDS && !status && !*none; band++) {
        int64_t least = band < SF_MAX_SH_DEGREE ? kept[band + 1] : 0,
                limit = band > sh_degree ? 0 : (int64_t)most;
        if (kept[band] < 0 || kept[band] < least || kept[band] > limit)
            status = sf_checkpoint_bad(in, section, "a number of Gaussians is out of range");
        banded[band] = (size_t)kept[band];
    }
    for (int i = 0; i < SF_FIELD_COUNT && !status && !*none && sf_field_stored(i, sh_degree); i++) {
        uint64_t have;
        status = sf_sections_count(in, sf_checkpoint_name(prefix, i).text, sizeof(float), &have);
        if (!status && have != sf_field_values(i, banded[sf_field_band(i)]))
            status =
                sf_checkpoint_bad(in, sf_checkpoint_name(prefix, i).text, "is not of the model's length");
    }
    return status;
}

static sf_status take_model(sf_sections_in *in, sf_fitter *f) {
    int64_t model[3];
    size_t banded[SF_BANDS], most = (size_t)f->options.max_gaussians;
    int none, degree = 0;
    sf_status status = sf_sections_take(in, "model", model, 3, sizeof *model);
    if (!status && (model[0] < 0 || model[0] > SF_MAX_SH_DEGREE))
        status = sf_checkpoint_bad(in, "model", "the degree is out of range");
    if (!status) degree = (int)model[0];
    if (!status) status = take_banded(in, "model", degree, most, banded, &none);
    if (!status && none)
        status = sf_checkpoint_bad(in, "model.banded", "a number of Gaussians is out of range");
    if (!status) status = sf_fitter_plan_memory(f, most, degree);
    if (!status) status = sf_model_create_banded(f->ctx, banded, banded[0], degree, &f->model);
    if (status) return status;
    f->model->antialiased = model[1] != 0;
    f->model->unit = (int)model[2];
    memcpy(f->model->origin, f->scene->origin, sizeof f->model->origin);
    status = take_params(in, "model", f->model);
    if (!status) status = sf_fitter_start_room(f, sf_is_shared(f) ? 0 : sf_planned_count(f, 1));
    if (!status) status = take_moments(in, &f->moments, f->model);
    size_t count = banded[0];
    if (!status)
        status = sf_sections_take(in, "screen.sum", f->densify.gradient_sum, count,
                                  sizeof *f->densify.gradient_sum);
    if (!status)
        status = sf_sections_take(in, "screen.seen", f->densify.visible_count, count,
                                  sizeof *f->densify.visible_count);
    if (!status) status = sf_sections_take(in, "units", f->units.inverse, count, sizeof *f->units.inverse);
    return status;
}

/* The tentative merges, and the errors before them. */
static sf_status take_merges(sf_sections_in *in, sf_fitter *f) {
    sf_merges *t = &f->merges;
    size_t n = f->model->count, words;
    sf_status status =
        sf_sections_take_new(in, "trials", &t->list, &words, n * MERGE_WORDS, sizeof(uint32_t));
    if (status) return status;
    if (words % MERGE_WORDS) return sf_checkpoint_bad(in, "trials", "has another length");
    t->count = t->capacity = words / MERGE_WORDS;
    for (size_t k = 0; k < t->count; k++)
        if (t->list[k].a >= n || t->list[k].b >= n || t->list[k].leader >= n)
            return sf_checkpoint_bad(in, "trials", "an index is out of range");
    status = sf_sections_take_new(in, "trials.tiles", &t->tiles, &t->tile_count, INT32_MAX, sizeof *t->tiles);
    t->tile_capacity = t->tile_count;
    return status;
}

/* The restore point, if there is one. */
static sf_status take_restore_point(sf_sections_in *in, sf_fitter *f) {
    double psnr[2];
    size_t banded[SF_BANDS];
    int none, degree = f->model->sh_degree;
    sf_status status = sf_sections_take(in, "validation", psnr, 2, sizeof *psnr);
    if (!status)
        status =
            sf_sections_take(in, "best.background", f->restore.background, 3, sizeof *f->restore.background);
    if (!status) status = take_banded(in, "best", degree, f->model->capacity[0], banded, &none);
    if (status) return status;
    f->validation.psnr = psnr[0], f->validation.best_psnr = psnr[1];
    if (none) return SF_OK;
    status = sf_model_create_banded(f->ctx, banded, f->model->capacity[0], degree, &f->restore.model);
    if (status) return status;
    f->restore.model->antialiased = f->model->antialiased;
    f->restore.model->unit = f->model->unit;
    memcpy(f->restore.model->origin, f->model->origin, sizeof f->model->origin);
    return take_params(in, "best", f->restore.model);
}

static sf_status take_state(sf_sections_in *in, sf_fitter *f) {
    sf_status status = take_integers(in, f);
    if (!status) status = take_reals(in, f);
    if (!status) status = sf_sections_take(in, "rng", f->rng.s, 4, sizeof *f->rng.s);
    if (!status) status = sf_sections_take(in, "background", f->background, 3, sizeof *f->background);
    if (!status) status = sf_sections_take(in, "background.m", f->background_m, 3, sizeof *f->background_m);
    if (!status) status = sf_sections_take(in, "background.v", f->background_v, 3, sizeof *f->background_v);
    if (!status) status = sf_sections_take(in, "losses", f->losses, SF_LOSS_WINDOW, sizeof *f->losses);
    if (!status) status = take_plan(in, f);
    if (!status) status = take_model(in, f);
    if (!status) status = take_merges(in, f);
    if (!status) status = take_restore_point(in, f);
    if (!status) status = sf_checkpoint_take_learned(in, f);
    return status;
}

/* Warns if another program or other kernels wrote the checkpoint: the bytes will differ. */
static sf_status check_origin(sf_sections_in *in) {
    const char *names[] = {"program", "isa"}, *mine[] = {sf_version(), sf_context_isa(in->ctx)};
    for (int i = 0; i < 2; i++) {
        char text[64];
        uint64_t size;
        sf_status status = sf_sections_count(in, names[i], 1, &size);
        if (!status && size >= sizeof text) status = sf_checkpoint_bad(in, names[i], "is too long");
        if (!status) status = sf_sections_take(in, names[i], text, (size_t)size, 1);
        if (status) return status;
        text[size] = 0;
        if (strcmp(text, mine[i]))
            sf_log(in->ctx, SF_LOG_WARNING,
                   "%s: %s: written by %s, gone on from by %s: results may differ in rounding", in->path,
                   names[i], text, mine[i]);
    }
    return SF_OK;
}

sf_status sf_checkpoint_options(sf_context *ctx, const char *path, sf_fit_options *options) {
    sf_sections_in in;
    sf_fit_options read;
    sf_status status = sf_sections_open(&in, ctx, path, &sf_checkpoint_kind);
    if (status) return status;
    status = take_options(&in, &read);
    sf_sections_close(&in);
    if (!status) *options = read;
    return status;
}

/* Sums over the ranks are the model's numbers. */
static int sum_up(const uint64_t *ranks, size_t count, const sf_model *m) {
    for (size_t band = 0; band < SF_BANDS; band++) {
        uint64_t sum = 0;
        for (size_t k = band; k < count; k += SF_BANDS) {
            if (ranks[k] > SF_CHECKPOINT_MOST || (band && ranks[k] > ranks[k - 1])) return 0;
            sum += ranks[k];
        }
        if (sum != (m ? m->banded[band] : 0)) return 0;
    }
    return 1;
}

/* Of a fit on several ranks each keeps its part: its own, where as many wrote the checkpoint. */
static sf_status take_ranks(sf_sections_in *in, sf_fitter *f) {
    uint64_t *ranks = NULL, have;
    size_t count = 0, size = sf_is_shared(f) ? (size_t)sf_cluster_of(f->ctx)->size : 1;
    if (!sf_sections_count(in, SF_CHECKPOINT_RANKS, sizeof *ranks, &have)) {
        sf_status status =
            sf_sections_take_new(in, SF_CHECKPOINT_RANKS, &ranks, &count, INT32_MAX, sizeof *ranks);
        if (status) return status;
    }
    size_t half = count / 2;
    int sound = count % (2 * SF_BANDS) == 0 &&
                (!count || (sum_up(ranks, half, f->model) && sum_up(ranks + half, half, f->restore.model)));
    int same = count == 2 * SF_BANDS * size;
    sf_status status = sound ? sf_ranks_divide_restored(f, same ? ranks : NULL, same ? ranks + half : NULL)
                             : sf_checkpoint_bad(in, SF_CHECKPOINT_RANKS, "is not of the model");
    sf_free(f->ctx, ranks);
    return status;
}

static sf_status restore(sf_sections_in *in, sf_scene *scene, const sf_fit_options *asked, sf_fitter **f) {
    sf_fit_options options;
    sf_status status = take_options(in, &options);
    if (!status && asked) status = check_options(in, &options, asked);
    if (!status) status = sf_fitter_create_empty(in->ctx, scene, asked ? asked : &options, f);
    if (!status) status = sf_checkpoint_take_scene(in, *f);
    if (!status) status = check_origin(in);
    if (!status) status = take_state(in, *f);
    if (!status) status = take_ranks(in, *f);
    return status ? status : sf_sections_all_taken(in);
}

sf_status sf_fitter_load(sf_context *ctx, sf_scene *scene, const char *path, const sf_fit_options *options,
                         sf_fitter **fitter) {
    sf_sections_in in;
    *fitter = NULL;
    sf_status status = sf_sections_open(&in, ctx, path, &sf_checkpoint_kind);
    if (status) return status;
    status = restore(&in, scene, options, fitter);
    sf_sections_close(&in);
    if (status) sf_fitter_destroy(fitter);
    return status;
}
