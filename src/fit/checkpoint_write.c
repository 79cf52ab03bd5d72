/* checkpoint_write.c - writes the state of a fit between two steps to a file. */
#include "checkpoint.h"

#include <stdio.h>
#include <string.h>

#include "../base/clock.h"
#include "../cluster/cluster.h"
#include "out_of_view.h"
#include "ranks.h"

static void put_params(sf_sections_out *out, const char *prefix, const sf_model *model) {
    for (int i = 0; i < SF_FIELD_COUNT; i++)
        if (model->params.field[i])
            sf_sections_put(out, sf_checkpoint_name(prefix, i).text, model->params.field[i],
                            sf_checkpoint_values(model, i), sizeof(float));
}

typedef struct half_field {
    const sf_half_model *half;
    int field;
} half_field;

static void expand(const void *user, size_t first, size_t count, void *to) {
    const half_field *from = user;
    sf_half_model_expand(from->half, from->field, first, count, to);
}

/* The restore point: a model, or its copy in halves, written as floats. */
static void put_restore_point(sf_sections_out *out, const sf_restore_point *restore) {
    const sf_half_model *half = &restore->half;
    if (restore->model) put_params(out, "best", restore->model);
    if (restore->model || sf_half_model_is_empty(half)) return;
    for (int i = 0; i < SF_FIELD_COUNT; i++)
        if (sf_field_stored(i, half->sh_degree))
            sf_sections_put_from(out, sf_checkpoint_name("best", i).text, expand, &(half_field){half, i},
                                 sf_half_model_values(half, i), sizeof(float));
}

static void put_moments(sf_sections_out *out, const sf_optimizer_state *moments, const sf_model *model) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int i = 0; i < SF_FIELD_COUNT; i++)
            if (moments->part[part][i])
                sf_sections_put(out, sf_checkpoint_name(sf_moment_part(moments, part), i).text,
                                moments->part[part][i], sf_checkpoint_moments(moments, part, model, i),
                                SF_MOMENT_VALUE);
}

/* Options, a line each. */

static sf_status put_options(sf_sections_out *out, const sf_fitter *f) {
    char *text = sf_alloc(f->ctx, MOST_TEXT, 1), value[OPTION_TEXT];
    if (!text) return SF_ERR_MEMORY;
    size_t used = 0;
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        sf_fit_options_get(&f->options, info.name, value, sizeof value);
        used += (size_t)snprintf(text + used, MOST_TEXT - used, "%s %s\n", info.name, value);
    }
    sf_sections_put(out, "options", text, used, 1);
    sf_free(f->ctx, text);
    return SF_OK;
}

/* The state. */

static void put_text(sf_sections_out *out, const char *name, const char *text) {
    sf_sections_put(out, name, text, strlen(text), 1);
}

static void put_state(sf_sections_out *out, const sf_fitter *f) {
    const sf_model *m = f->model, *restored = f->restore.model;
    const size_t *best_banded = restored ? restored->banded : f->restore.half.banded;
    int has_best = restored || !sf_half_model_is_empty(&f->restore.half);
#define VALUE(name) (int64_t) f->name,
    const int64_t integers[] = {STATE_INTEGERS(VALUE)};
#undef VALUE
#define VALUE(name) (double)f->name,
    const double reals[] = {STATE_REALS(VALUE)};
#undef VALUE
    const int64_t model[] = {m->sh_degree, m->antialiased, m->unit};
    int64_t banded[SF_BANDS], best[SF_BANDS];
    for (int band = 0; band < SF_BANDS; band++) {
        banded[band] = (int64_t)m->banded[band];
        best[band] = has_best ? (int64_t)best_banded[band] : -1;
    }
    const double seconds = sf_clock() - f->start;
    sf_sections_put(out, "integers", integers, INTEGERS, sizeof *integers);
    sf_sections_put(out, "reals", reals, REALS, sizeof *reals);
    sf_sections_put(out, "seconds", &seconds, 1, sizeof seconds);
    sf_sections_put(out, "rng", f->rng.s, 4, sizeof *f->rng.s);
    sf_sections_put(out, "background", f->background, 3, sizeof *f->background);
    sf_sections_put(out, "background.m", f->background_m, 3, sizeof *f->background_m);
    sf_sections_put(out, "background.v", f->background_v, 3, sizeof *f->background_v);
    sf_sections_put(out, "losses", f->losses, SF_LOSS_WINDOW, sizeof *f->losses);
    sf_sections_put(out, "plan", f->trace.ticks, f->trace.count, sizeof *f->trace.ticks);
    sf_sections_put(out, "model", model, 3, sizeof *model);
    sf_sections_put(out, "model.banded", banded, SF_BANDS, sizeof *banded);
    put_params(out, "model", m);
    put_moments(out, &f->moments, m);
    sf_sections_put(out, "screen.sum", f->densify.gradient_sum, m->count, sizeof *f->densify.gradient_sum);
    sf_sections_put(out, "screen.seen", f->densify.visible_count, m->count, sizeof *f->densify.visible_count);
    sf_sections_put(out, "units", f->units.inverse, m->count, sizeof *f->units.inverse);
    sf_sections_put(out, "trials", f->merges.list, f->merges.count * MERGE_WORDS, sizeof(uint32_t));
    sf_sections_put(out, "trials.tiles", f->merges.tiles, f->merges.tile_count, sizeof *f->merges.tiles);
    const double psnr[] = {f->validation.psnr, f->validation.best_psnr}; /* NAN before the first validation */
    sf_sections_put(out, "best.banded", best, SF_BANDS, sizeof *best);
    sf_sections_put(out, "validation", psnr, 2, sizeof *psnr);
    sf_sections_put(out, "best.background", f->restore.background, 3, sizeof *f->restore.background);
    put_restore_point(out, &f->restore);
}

/* ranks: what each of several ranks has of the model and of the restore point (NULL: one wrote it). */
static sf_status save(const sf_fitter *f, const char *path, const uint64_t *ranks, size_t count) {
    sf_sections_out out;
    sf_status status = sf_sections_create(&out, f->ctx, path, &sf_checkpoint_kind);
    if (status) return status;
    put_text(&out, "program", sf_version());
    put_text(&out, "isa", sf_context_isa(f->ctx));
    status = put_options(&out, f);
    if (!status) status = sf_checkpoint_put_scene(&out, f);
    if (!status) status = sf_checkpoint_put_learned(&out, f);
    if (status) {
        sf_writer_abandon(&out.writer);
        return status;
    }
    put_state(&out, f);
    if (ranks) sf_sections_put(&out, SF_CHECKPOINT_RANKS, ranks, count, sizeof *ranks);
    return sf_sections_commit(&out);
}

/* Rank 0 writes what all have. */
static sf_status save_shared(const sf_fitter *f, const char *path) {
    const sf_cluster *c = sf_cluster_of(f->ctx);
    size_t of_model = SF_BANDS * (size_t)c->size;
    uint64_t *ranks = sf_calloc(f->ctx, 2 * of_model, sizeof *ranks);
    sf_fitter *whole = sf_calloc(f->ctx, 1, sizeof *whole);
    sf_status status = ranks && whole ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        status = sf_ranks_gather_all(f, ranks, ranks + of_model, whole);
        if (!status && !c->rank) status = save(whole, path, ranks, 2 * of_model);
        sf_ranks_free_gathered(whole);
    }
    sf_free(f->ctx, whole);
    sf_free(f->ctx, ranks);
    return status;
}

sf_status sf_fitter_save(const sf_fitter *f, const char *path) {
    sf_update_second_moments(f);
    return sf_is_shared(f) ? save_shared(f, path) : save(f, path, NULL, 0);
}
