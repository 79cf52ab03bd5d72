/* checkpoint.c - everything that a fit is between two steps, to a file and back.
 *
 * A fit that goes on from a checkpoint makes the same bytes as one that was never interrupted. What a step
 * reads and does not make anew must therefore be here: a new array of the fitter needs one line in
 * `put_state` and one in `take_state`.
 */
#include "fitter.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/clock.h"
#include "../io/sections.h"

static const sf_sections_kind checkpoint_kind = {
    .magic = "SPLATFIT", .version = 2, .text = "a checkpoint of splatfit"};

/* The options that a run may be gone on with differently. */
static const char *const free_options[] = {"steps", "time_limit", "memory"};

/* Beyond any number of steps, Gaussians or views; a double holds it, and sums of it do not overflow. */
static const double MOST_COUNT = 0x1p53;

enum { OPTION_TEXT = 64, MOST_TEXT = 1 << 16, MOST_NAMES = 1 << 28, CAMERA_VALUES = 16, VIEW_VALUES = 3 };
enum { TRIAL_WORDS = sizeof(sf_merge) / sizeof(uint32_t) };

/* Scalars of the fitter, by kind. */
#define STATE_INTEGERS(F)                                                                                    \
    F(step)                                                                                                  \
    F(level)                                                                                                 \
    F(sh_degree)                                                                                             \
    F(skipped_values)                                                                                        \
    F(warm_start)                                                                                            \
    F(first_count)                                                                                           \
    F(densify.out_of_memory)                                                                                 \
    F(densify.ended)                                                                                         \
    F(select.vain_growths)                                                                                   \
    F(sampler.at)                                                                                            \
    F(trace.replayed)                                                                                        \
    F(trace.lost)                                                                                            \
    F(validation.assigned)                                                                                   \
    F(validation.next_step)                                                                                  \
    F(validation.best_step)                                                                                  \
    F(validation.merged)                                                                                     \
    F(blur.judged)                                                                                           \
    F(merges.in_vain)                                                                                        \
    F(select.min_error_level)                                                                                \
    F(end)                                                                                                   \
    F(optimizer_restart)                                                                                     \
    F(recovery.since)                                                                                        \
    F(sampler.views_before)                                                                                  \
    F(recovery.count)
#define STATE_REALS(F)                                                                                       \
    F(extent)                                                                                                \
    F(near_plane)                                                                                            \
    F(steps_per_second)                                                                                      \
    F(validation.best_fraction)                                                                              \
    F(validation.next_fraction)                                                                              \
    F(cool_down.from)                                                                                        \
    F(select.noise_variance)                                                                                 \
    F(select.growth_scale)                                                                                   \
    F(merges.part)                                                                                           \
    F(merges.squares)                                                                                        \
    F(select.min_error)                                                                                      \
    F(cool_down.length)                                                                                      \
    F(recovery.min_loss)                                                                                     \
    F(recovery.initial_loss)                                                                                 \
    F(recovery.lr_scale)                                                                                     \
    F(sampler.start)

#define COUNT_ONE(name) +1
enum { INTEGERS = 0 STATE_INTEGERS(COUNT_ONE), REALS = 0 STATE_REALS(COUNT_ONE) };
#undef COUNT_ONE

/* Arrays of all fields, under `prefix`. */

typedef struct field_name {
    char text[SF_SECTION_NAME];
} field_name;

static field_name name_of(const char *prefix, int field) {
#define NAME(name, components) #name,
    static const char *const names[] = {SF_FIELDS(NAME)};
#undef NAME
    field_name n;
    snprintf(n.text, sizeof n.text, "%s.%s", prefix, names[field]);
    return n;
}

/* Whole blocks: the lanes behind the last Gaussian come back as they were. */
static size_t field_size(const sf_model *model, int field) {
    return sf_field_values(field, model->banded[sf_field_band(field)]);
}

static void put_params(sf_sections_out *out, const char *prefix, const sf_model *model) {
    for (int i = 0; i < SF_FIELD_COUNT; i++)
        if (model->params.field[i])
            sf_sections_put(out, name_of(prefix, i).text, model->params.field[i], field_size(model, i),
                            sizeof(float));
}

static sf_status take_params(sf_sections_in *in, const char *prefix, const sf_model *model) {
    sf_status status = SF_OK;
    for (int i = 0; i < SF_FIELD_COUNT && !status; i++)
        if (model->params.field[i])
            status = sf_sections_take(in, name_of(prefix, i).text, model->params.field[i],
                                      field_size(model, i), sizeof(float));
    return status;
}

static size_t moment_size(const sf_optimizer_state *moments, int part, const sf_model *model, int field) {
    size_t n = (size_t)sf_moment_components(moments, part, field);
    return n * SF_LANES * sf_blocks(model->banded[sf_field_band(field)]);
}

static void put_moments(sf_sections_out *out, const sf_optimizer_state *moments, const sf_model *model) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int i = 0; i < SF_FIELD_COUNT; i++)
            if (moments->part[part][i])
                sf_sections_put(out, name_of(sf_moment_part(moments, part), i).text, moments->part[part][i],
                                moment_size(moments, part, model, i), SF_MOMENT_VALUE);
}

static sf_status take_moments(sf_sections_in *in, const sf_optimizer_state *moments, const sf_model *model) {
    sf_status status = SF_OK;
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int i = 0; i < SF_FIELD_COUNT && !status; i++)
            if (moments->part[part][i])
                status = sf_sections_take(in, name_of(sf_moment_part(moments, part), i).text,
                                          moments->part[part][i], moment_size(moments, part, model, i),
                                          SF_MOMENT_VALUE);
    return status;
}

static sf_status bad(const sf_sections_in *in, const char *section, const char *what) {
    return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: section %s: %s", in->path, section, what);
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

/* The line at *at, which loses its newline, must be `info`'s. */
static sf_status take_option(sf_sections_in *in, const sf_option_info *info, char **at,
                             sf_fit_options *options) {
    char *line = *at, *end = strchr(line, '\n'), *space = strchr(line, ' '), what[256];
    if (!end || !space || space > end) {
        snprintf(what, sizeof what, "%s is missing", info->name);
        return bad(in, "options", what);
    }
    *end = *space = 0;
    *at = end + 1;
    if (strcmp(line, info->name)) {
        snprintf(what, sizeof what, "%.64s stands where %s is expected", line, info->name);
        return bad(in, "options", what);
    }
    if (!sf_fit_options_set(in->ctx, options, info->name, space + 1)) return SF_OK;
    snprintf(what, sizeof what, "%.200s", sf_last_error(in->ctx));
    return bad(in, "options", what);
}

static sf_status take_options(sf_sections_in *in, sf_fit_options *options) {
    char text[MOST_TEXT + 1], *at = text;
    uint64_t size;
    sf_status status = sf_sections_count(in, "options", 1, &size);
    if (!status && size > MOST_TEXT) status = bad(in, "options", "is too long");
    if (!status) status = sf_sections_take(in, "options", text, (size_t)size, 1);
    if (status) return status;
    text[size] = 0;
    *options = sf_fit_options_default();
    sf_option_info info;
    for (size_t i = 0; !status && !sf_fit_option_info(i, &info); i++)
        status = take_option(in, &info, &at, options);
    if (!status && *at) status = bad(in, "options", "holds more than this program knows");
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

/* The scene: views are known again by name, split, camera and picture. */

typedef struct view_table {
    size_t count;
    char *names; /* each followed by a 0 */
    size_t name_bytes;
    int32_t *values;    /* [count][VIEW_VALUES] split, width, height */
    double *cameras;    /* [count][CAMERA_VALUES] */
    uint64_t *pictures; /* [count] hashes */
} view_table;

static void free_table(sf_context *ctx, view_table *t) {
    sf_free(ctx, t->names);
    sf_free(ctx, t->values);
    sf_free(ctx, t->cameras);
    sf_free(ctx, t->pictures);
    *t = (view_table){0};
}

static void describe(sf_view *view, int32_t *values, double *camera, uint64_t *picture) {
    const sf_camera *c = &view->camera;
    const double lens[] = {c->fx, c->fy, c->cx, c->cy};
    values[0] = (int32_t)view->split, values[1] = c->width, values[2] = c->height;
    memcpy(camera, lens, sizeof lens);
    memcpy(camera + 4, c->R_cw, sizeof c->R_cw);
    memcpy(camera + 13, c->t_cw, sizeof c->t_cw);
    *picture = sf_view_hash(view);
}

static sf_status make_table(sf_context *ctx, sf_view *const *views, size_t count, view_table *t) {
    *t = (view_table){.count = count};
    for (size_t i = 0; i < count; i++) t->name_bytes += strlen(views[i]->name) + 1;
    t->names = sf_alloc(ctx, t->name_bytes, 1);
    t->values = sf_alloc(ctx, count, VIEW_VALUES * sizeof *t->values);
    t->cameras = sf_alloc(ctx, count, CAMERA_VALUES * sizeof *t->cameras);
    t->pictures = sf_alloc(ctx, count, sizeof *t->pictures);
    if (!t->names || !t->values || !t->cameras || !t->pictures) {
        free_table(ctx, t);
        return SF_ERR_MEMORY;
    }
    char *at = t->names;
    for (size_t i = 0; i < count; i++) {
        size_t size = strlen(views[i]->name) + 1;
        memcpy(at, views[i]->name, size);
        at += size;
        describe(views[i], t->values + VIEW_VALUES * i, t->cameras + CAMERA_VALUES * i, t->pictures + i);
    }
    return SF_OK;
}

/* Views are named by their place in the scene; one that has left has none. */
static uint32_t place_of(sf_view *const *views, size_t count, uint32_t id) {
    size_t place = 0;
    while (place < count && views[place]->id != id) place++;
    return place < count ? (uint32_t)place : UINT32_MAX;
}

static void put_places(sf_sections_out *out, const char *name, const uint32_t *ids, size_t n,
                       sf_view *const *views, size_t count, uint32_t *places) {
    for (size_t i = 0; i < n; i++) places[i] = place_of(views, count, ids[i]);
    sf_sections_put(out, name, places, n, sizeof *places);
}

/* The views that training and validation have, and how many views they have seen come. */
static void put_views(sf_sections_out *out, const sf_fitter *f, sf_view *const *views, size_t count,
                      uint32_t *places) {
    int64_t known = 0;
    while (known < (int64_t)count && views[known]->id <= f->validation.newest_id) known++;
    put_places(out, "order", f->sampler.ids, f->sampler.count, views, count, places);
    put_places(out, "kept.out", f->validation.ids, f->validation.count, views, count, places);
    put_places(out, "blurred", f->blur.ids, f->blur.count, views, count, places);
    sf_sections_put(out, "known", &known, 1, sizeof known);
}

static sf_status put_scene(sf_sections_out *out, const sf_fitter *f) {
    sf_view **views;
    size_t count;
    view_table t;
    sf_status status = sf_scene_retain_all(f->scene, &views, &count);
    if (status) return status;
    size_t most = f->sampler.count > f->validation.count ? f->sampler.count : f->validation.count;
    if (f->blur.count > most) most = f->blur.count;
    uint32_t *places = sf_alloc(f->ctx, most, sizeof *places);
    status = places ? make_table(f->ctx, views, count, &t) : SF_ERR_MEMORY;
    if (!status) {
        sf_sections_put(out, "views.names", t.names, t.name_bytes, 1);
        sf_sections_put(out, "views.sizes", t.values, VIEW_VALUES * count, sizeof *t.values);
        sf_sections_put(out, "views.cameras", t.cameras, CAMERA_VALUES * count, sizeof *t.cameras);
        sf_sections_put(out, "views.pictures", t.pictures, count, sizeof *t.pictures);
        put_views(out, f, views, count, places);
        free_table(f->ctx, &t);
    }
    sf_free(f->ctx, places);
    sf_scene_release_all(f->scene, views, count);
    return status;
}

static sf_status take_table(sf_sections_in *in, view_table *t) {
    *t = (view_table){0};
    size_t n;
    sf_status status = sf_sections_take_new(in, "views.pictures", &t->pictures, &t->count, INT32_MAX / 2,
                                            sizeof *t->pictures);
    if (!status) status = sf_sections_take_new(in, "views.names", &t->names, &t->name_bytes, MOST_NAMES, 1);
    if (!status)
        status = sf_sections_take_new(in, "views.sizes", &t->values, &n, VIEW_VALUES * t->count,
                                      sizeof *t->values);
    if (!status && n != VIEW_VALUES * t->count) status = bad(in, "views.sizes", "is too short");
    if (!status)
        status = sf_sections_take_new(in, "views.cameras", &t->cameras, &n, CAMERA_VALUES * t->count,
                                      sizeof *t->cameras);
    if (!status && n != CAMERA_VALUES * t->count) status = bad(in, "views.cameras", "is too short");
    if (!status && t->name_bytes && t->names[t->name_bytes - 1])
        status = bad(in, "views.names", "has no end");
    if (status) free_table(in->ctx, t);
    return status;
}

static sf_status other_scene(const sf_sections_in *in, const char *name, const char *what) {
    return sf_fail(in->ctx, SF_ERR_ARGUMENT, "%s: is of another scene: view %s: %s", in->path, name, what);
}

static const char *split_text(int32_t split) { return split == SF_SPLIT_TEST ? "held out" : "for training"; }

/* View i of the scene against that of the checkpoint, whose name is `name`. */
static sf_status compare_view(const sf_sections_in *in, const view_table *t, size_t i, const char *name,
                              sf_view *view) {
    int32_t values[VIEW_VALUES];
    double camera[CAMERA_VALUES];
    uint64_t picture;
    char what[128];
    const int32_t *was = t->values + VIEW_VALUES * i;
    describe(view, values, camera, &picture);
    if (strcmp(name, view->name)) {
        snprintf(what, sizeof what, "the checkpoint has %.80s in its place", name);
    } else if (values[1] != was[1] || values[2] != was[2]) {
        snprintf(what, sizeof what, "size: %dx%d, in the checkpoint %dx%d", (int)values[1], (int)values[2],
                 (int)was[1], (int)was[2]);
    } else if (values[0] != was[0]) {
        snprintf(what, sizeof what, "is %s, in the checkpoint %s", split_text(values[0]), split_text(was[0]));
    } else if (memcmp(camera, t->cameras + CAMERA_VALUES * i, sizeof camera)) {
        snprintf(what, sizeof what, "its camera differs from the checkpoint's");
    } else if (picture != t->pictures[i]) {
        snprintf(what, sizeof what, "its picture differs from the checkpoint's");
    } else {
        return SF_OK;
    }
    return other_scene(in, view->name, what);
}

static sf_status compare_scene(const sf_sections_in *in, const view_table *t, sf_view *const *views,
                               size_t count) {
    const char *name = t->names, *end = t->names + t->name_bytes;
    if (count != t->count)
        return sf_fail(in->ctx, SF_ERR_ARGUMENT, "%s: is of another scene: views: %zu, in the checkpoint %zu",
                       in->path, count, t->count);
    for (size_t i = 0; i < count; i++) {
        if (name >= end) return bad(in, "views.names", "is too short");
        sf_status status = compare_view(in, t, i, name, views[i]);
        if (status) return status;
        name += strlen(name) + 1;
    }
    return SF_OK;
}

/* Places back to ids; no view has the id 0. */
static sf_status take_places(sf_sections_in *in, const char *name, uint32_t **ids, size_t *n,
                             sf_view *const *views, size_t count) {
    sf_status status = sf_sections_take_new(in, name, ids, n, INT32_MAX, sizeof **ids);
    for (size_t i = 0; i < *n && !status; i++) {
        uint32_t place = (*ids)[i];
        if (place != UINT32_MAX && place >= count)
            status = bad(in, name, "names a view that is none");
        else
            (*ids)[i] = place == UINT32_MAX ? 0 : views[place]->id;
    }
    return status;
}

/* Views came and went since the run began: as many of those that there are were taken up. */
static sf_status take_newest(sf_sections_in *in, sf_fitter *f, sf_view *const *views, size_t count) {
    int64_t known;
    sf_status status = sf_sections_take(in, "known", &known, 1, sizeof known);
    if (!status && (known < 0 || known > (int64_t)count))
        status = bad(in, "known", "is not a number of the scene's views");
    if (!status) f->validation.newest_id = known ? views[known - 1]->id : 0;
    return status;
}

static sf_status take_scene(sf_sections_in *in, sf_fitter *f) {
    sf_view **views;
    size_t count;
    view_table t;
    sf_status status = sf_scene_retain_all(f->scene, &views, &count);
    if (status) return status;
    status = take_table(in, &t);
    if (!status) {
        status = compare_scene(in, &t, views, count);
        free_table(f->ctx, &t);
    }
    if (!status) status = take_places(in, "order", &f->sampler.ids, &f->sampler.count, views, count);
    if (!status) status = take_places(in, "kept.out", &f->validation.ids, &f->validation.count, views, count);
    if (!status) status = take_places(in, "blurred", &f->blur.ids, &f->blur.count, views, count);
    if (!status) f->validation.capacity = f->validation.count, status = take_newest(in, f, views, count);
    sf_scene_release_all(f->scene, views, count);
    return status;
}

/* What was learned of each view: a row of numbers each, views named by their place in the scene. */

/* Numbers and arrays of numbers of a view's state and of a lens. */
#define LEARNED_OF_VIEW(F)                                                                                   \
    F(log_gain)                                                                                              \
    F(bias)                                                                                                  \
    F(exposure.m)                                                                                            \
    F(exposure.v)                                                                                            \
    F(R_cw)                                                                                                  \
    F(t_cw)                                                                                                  \
    F(pose.m)                                                                                                \
    F(pose.v)                                                                                                \
    F(depth)                                                                                                 \
    F(turned_deg)                                                                                            \
    F(moved_depths)
#define LEARNED_OF_LENS(F) F(fx) F(fy) F(cx) F(cy) F(log_focal) F(focal.m) F(focal.v)
enum { VIEW_INTEGERS = 4, LENS_INTEGERS = 3 };
#define ROW_OF(name)      +sizeof(((const sf_view_state *)NULL)->name) / sizeof(double)
#define ROW_OF_LENS(name) +sizeof(((const sf_view_lens *)NULL)->name) / sizeof(double)
enum {
    VIEW_ROW = VIEW_INTEGERS LEARNED_OF_VIEW(ROW_OF),
    LENS_ROW = LENS_INTEGERS LEARNED_OF_LENS(ROW_OF_LENS)
};
#undef ROW_OF
#undef ROW_OF_LENS

static void pack_view(const sf_view_state *s, double *row) {
    const double integers[VIEW_INTEGERS] = {(double)s->lens, s->held, (double)s->exposure.steps,
                                            (double)s->pose.steps};
    memcpy(row, integers, sizeof integers);
    row += VIEW_INTEGERS;
#define PACK(name) memcpy(row, &s->name, sizeof s->name), row += sizeof s->name / sizeof *row;
    LEARNED_OF_VIEW(PACK)
}

static void unpack_view(const double *row, sf_view_state *s) {
    s->lens = (size_t)row[0], s->held = row[1] != 0;
    s->exposure.steps = (int64_t)row[2], s->pose.steps = (int64_t)row[3];
    row += VIEW_INTEGERS;
#define UNPACK(name) memcpy(&s->name, row, sizeof s->name), row += sizeof s->name / sizeof *row;
    LEARNED_OF_VIEW(UNPACK)
}

static void pack_lens(const sf_view_lens *s, double *row) {
    const double integers[LENS_INTEGERS] = {s->width, s->height, (double)s->focal.steps};
    memcpy(row, integers, sizeof integers);
    row += LENS_INTEGERS;
    LEARNED_OF_LENS(PACK)
}

static void unpack_lens(const double *row, sf_view_lens *s) {
    s->width = (int32_t)row[0], s->height = (int32_t)row[1], s->focal.steps = (int64_t)row[2];
    row += LENS_INTEGERS;
    LEARNED_OF_LENS(UNPACK)
}
#undef PACK
#undef UNPACK

static sf_status put_learned(sf_sections_out *out, const sf_fitter *f) {
    const sf_view_states *v = &f->views;
    if (!v->count) return SF_OK;
    double *rows = sf_alloc(f->ctx, v->count, VIEW_ROW * sizeof *rows);
    double *lenses = sf_alloc(f->ctx, v->lens_count, LENS_ROW * sizeof *lenses);
    uint32_t *places = sf_alloc(f->ctx, v->count, sizeof *places);
    sf_view **views = NULL;
    size_t count = 0;
    sf_status status =
        rows && lenses && places ? sf_scene_retain_all(f->scene, &views, &count) : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < v->count; i++) {
            places[i] = place_of(views, count, v->states[i].id);
            pack_view(&v->states[i], rows + VIEW_ROW * i);
        }
        for (size_t i = 0; i < v->lens_count; i++) pack_lens(&v->lenses[i], lenses + LENS_ROW * i);
        sf_sections_put(out, "learned.places", places, v->count, sizeof *places);
        sf_sections_put(out, "learned.views", rows, VIEW_ROW * v->count, sizeof *rows);
        sf_sections_put(out, "learned.lenses", lenses, LENS_ROW * v->lens_count, sizeof *lenses);
        sf_scene_release_all(f->scene, views, count);
    }
    sf_free(f->ctx, rows);
    sf_free(f->ctx, lenses);
    sf_free(f->ctx, places);
    return status;
}

/* What came as a number and is a count, or a side in px, before it is cast. */
static int is_whole(double value, double most) {
    return value >= 0 && value <= most && value == floor(value);
}

/* States from rows, by ascending ids; a view that has left has left its state too. */
static sf_status take_states(const sf_sections_in *in, sf_fitter *f, const uint32_t *places,
                             const double *rows, size_t n, sf_view *const *views, size_t count) {
    sf_view_states *v = &f->views;
    sf_status status = sf_grow(f->ctx, &v->states, &v->capacity, 0, n, sizeof *v->states);
    if (!status) status = sf_grow(f->ctx, &v->scratch, &v->scratch_capacity, 0, n, sizeof *v->scratch);
    for (size_t i = 0; i < n && !status; i++) {
        const double *row = rows + VIEW_ROW * i;
        if (places[i] == UINT32_MAX) continue;
        for (size_t k = 0; k < VIEW_ROW; k++)
            if (!isfinite(row[k])) return bad(in, "learned.views", "holds a value that is not finite");
        if (places[i] >= count || !(row[0] >= 0 && row[0] < (double)v->lens_count))
            return bad(in, "learned.views", "names a view or a lens that is none");
        if (!is_whole(row[2], MOST_COUNT) || !is_whole(row[3], MOST_COUNT))
            return bad(in, "learned.views", "a number of steps is none");
        if (v->count && views[places[i]]->id <= v->states[v->count - 1].id)
            return bad(in, "learned.places", "names a view twice, or before an earlier one");
        sf_view_state *s = &v->states[v->count++];
        *s = (sf_view_state){.id = views[places[i]]->id, .given = views[places[i]]->camera};
        unpack_view(row, s);
    }
    return status;
}

static sf_status take_lenses(sf_sections_in *in, sf_fitter *f) {
    sf_view_states *v = &f->views;
    double *rows = NULL;
    size_t n = 0;
    sf_status status = sf_sections_take_new(in, "learned.lenses", &rows, &n, INT32_MAX, sizeof *rows);
    if (status) return status;
    for (size_t k = 0; k < n && !status; k++)
        if (!isfinite(rows[k])) status = bad(in, "learned.lenses", "holds a value that is not finite");
    if (!status && n % LENS_ROW) status = bad(in, "learned.lenses", "has another length");
    if (!status) status = sf_grow(f->ctx, &v->lenses, &v->lens_capacity, 0, n / LENS_ROW, sizeof *v->lenses);
    for (size_t i = 0; i < n / LENS_ROW && !status; i++) {
        const double *row = rows + LENS_ROW * i;
        if (!is_whole(row[0], INT32_MAX) || !is_whole(row[1], INT32_MAX) || !is_whole(row[2], MOST_COUNT)) {
            status = bad(in, "learned.lenses", "a size or a number of steps is none");
            break;
        }
        v->lenses[v->lens_count] = (sf_view_lens){0};
        unpack_lens(row, &v->lenses[v->lens_count++]);
    }
    sf_free(f->ctx, rows);
    return status;
}

static sf_status take_learned(sf_sections_in *in, sf_fitter *f) {
    uint64_t have;
    if (sf_sections_count(in, "learned.places", sizeof(uint32_t), &have))
        return SF_OK; /* nothing was learned */
    uint32_t *places = NULL;
    double *rows = NULL;
    sf_view **views = NULL;
    size_t n = 0, values = 0, count = 0;
    sf_status status = take_lenses(in, f);
    if (!status)
        status = sf_sections_take_new(in, "learned.places", &places, &n, INT32_MAX / 128, sizeof *places);
    if (!status)
        status = sf_sections_take_new(in, "learned.views", &rows, &values, VIEW_ROW * n, sizeof *rows);
    if (!status && values != VIEW_ROW * n) status = bad(in, "learned.views", "has another length");
    if (!status) status = sf_scene_retain_all(f->scene, &views, &count);
    if (!status) {
        status = take_states(in, f, places, rows, n, views, count);
        sf_scene_release_all(f->scene, views, count);
    }
    sf_free(f->ctx, places);
    sf_free(f->ctx, rows);
    return status;
}

/* The state. */

static void put_text(sf_sections_out *out, const char *name, const char *text) {
    sf_sections_put(out, name, text, strlen(text), 1);
}

static void put_state(sf_sections_out *out, const sf_fitter *f) {
    const sf_model *m = f->model;
#define VALUE(name) (int64_t) f->name,
    const int64_t integers[] = {STATE_INTEGERS(VALUE)};
#undef VALUE
#define VALUE(name) (double)f->name,
    const double reals[] = {STATE_REALS(VALUE)};
#undef VALUE
    const int64_t model[] = {m->sh_degree, m->antialiased};
    int64_t banded[SF_BANDS], best[SF_BANDS];
    for (int band = 0; band < SF_BANDS; band++) {
        banded[band] = (int64_t)m->banded[band];
        best[band] = f->restore.model ? (int64_t)f->restore.model->banded[band] : -1;
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
    sf_sections_put(out, "model", model, 2, sizeof *model);
    sf_sections_put(out, "model.banded", banded, SF_BANDS, sizeof *banded);
    put_params(out, "model", m);
    put_moments(out, &f->moments, m);
    sf_sections_put(out, "screen.sum", f->densify.gradient_sum, m->count, sizeof *f->densify.gradient_sum);
    sf_sections_put(out, "screen.seen", f->densify.visible_count, m->count, sizeof *f->densify.visible_count);
    sf_sections_put(out, "trials", f->merges.list, f->merges.count * TRIAL_WORDS, sizeof(uint32_t));
    sf_sections_put(out, "trials.tiles", f->merges.tiles, f->merges.tile_count, sizeof *f->merges.tiles);
    const double psnr[] = {f->validation.psnr, f->validation.best_psnr}; /* NAN before the first validation */
    sf_sections_put(out, "best.banded", best, SF_BANDS, sizeof *best);
    sf_sections_put(out, "validation", psnr, 2, sizeof *psnr);
    sf_sections_put(out, "best.background", f->restore.background, 3, sizeof *f->restore.background);
    if (f->restore.model) put_params(out, "best", f->restore.model);
}

static sf_status take_integers(sf_sections_in *in, sf_fitter *f) {
    int64_t integers[INTEGERS], *at = integers;
    sf_status status = sf_sections_take(in, "integers", integers, INTEGERS, sizeof *integers);
    for (int i = 0; i < INTEGERS && !status; i++) {
        if (integers[i] < 0) status = bad(in, "integers", "one is below 0");
        if (integers[i] > (int64_t)MOST_COUNT)
            status = bad(in, "integers", "one is more than anything counts");
    }
    if (status) return status;
        /* some are kept in less than 64 bits */
#define VALUE(name)                                                                                          \
    f->name = *at;                                                                                           \
    if ((int64_t)f->name != *at++) return bad(in, "integers", #name " is out of range");
    STATE_INTEGERS(VALUE)
#undef VALUE
    if (f->first_count > (size_t)f->options.max_gaussians)
        return bad(in, "integers", "first_count is more than max_gaussians");
    if (f->sampler.at > f->sampler.count) return bad(in, "integers", "order_at lies behind the order");
    if (f->end >= SF_FIT_END_COUNT) return bad(in, "integers", "end is none that a run can have");
    if (f->recovery.since > f->step) return bad(in, "integers", "guard_since lies behind the step");
    if (f->optimizer_restart > f->step) return bad(in, "integers", "adam_before lies behind the step");
    return SF_OK;
}

static sf_status take_reals(sf_sections_in *in, sf_fitter *f) {
    double reals[REALS], *at = reals, seconds;
    sf_status status = sf_sections_take(in, "reals", reals, REALS, sizeof *reals);
    for (int i = 0; i < REALS && !status; i++)
        if (!(isfinite(reals[i]) && reals[i] >= 0)) status = bad(in, "reals", "one is not a number above 0");
    if (!status) status = sf_sections_take(in, "seconds", &seconds, 1, sizeof seconds);
    if (!status && !(isfinite(seconds) && seconds >= 0)) status = bad(in, "seconds", "is not a time");
    if (status) return status;
#define VALUE(name) f->name = *at++;
    STATE_REALS(VALUE)
#undef VALUE
    if (f->merges.part > 1) return bad(in, "reals", "trials.part is more than the whole");
    if (f->sampler.start >= 1) return bad(in, "reals", "pass_start lies behind the views");
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
    return sf_time_trace_check(f->ctx, f->trace.ticks, f->trace.count) ? bad(in, "plan", "times do not rise")
                                                                       : SF_OK;
}

/* How many Gaussians have each band, at most max_gaussians. The numbers are believed only where the file is
 * long enough for them. *none: they are -1. */
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
            status = bad(in, section, "a number of Gaussians is out of range");
        banded[band] = (size_t)kept[band];
    }
    for (int i = 0; i < SF_FIELD_COUNT && !status && !*none && sf_field_stored(i, sh_degree); i++) {
        uint64_t have;
        status = sf_sections_count(in, name_of(prefix, i).text, sizeof(float), &have);
        if (!status && have != sf_field_values(i, banded[sf_field_band(i)]))
            status = bad(in, name_of(prefix, i).text, "is not of the model's length");
    }
    return status;
}

static sf_status take_model(sf_sections_in *in, sf_fitter *f) {
    int64_t model[2];
    size_t banded[SF_BANDS], most = (size_t)f->options.max_gaussians;
    int none, degree = 0;
    sf_status status = sf_sections_take(in, "model", model, 2, sizeof *model);
    if (!status && (model[0] < 0 || model[0] > SF_MAX_SH_DEGREE))
        status = bad(in, "model", "the degree is out of range");
    if (!status) degree = (int)model[0];
    if (!status) status = take_banded(in, "model", degree, most, banded, &none);
    if (!status && none) status = bad(in, "model.banded", "a number of Gaussians is out of range");
    if (!status) status = sf_fitter_plan_memory(f, most, degree);
    if (!status) status = sf_model_create_banded(f->ctx, banded, banded[0], degree, &f->model);
    if (status) return status;
    f->model->antialiased = model[1] != 0;
    status = take_params(in, "model", f->model);
    if (!status) status = sf_fitter_start_room(f, sf_planned_count(f, 1));
    if (!status) status = take_moments(in, &f->moments, f->model);
    size_t count = banded[0];
    if (!status)
        status = sf_sections_take(in, "screen.sum", f->densify.gradient_sum, count,
                                  sizeof *f->densify.gradient_sum);
    if (!status)
        status = sf_sections_take(in, "screen.seen", f->densify.visible_count, count,
                                  sizeof *f->densify.visible_count);
    return status;
}

/* Pairs on trial, and what they are judged by. */
static sf_status take_trials(sf_sections_in *in, sf_fitter *f) {
    sf_merges *t = &f->merges;
    size_t n = f->model->count, words;
    sf_status status =
        sf_sections_take_new(in, "trials", &t->list, &words, n * TRIAL_WORDS, sizeof(uint32_t));
    if (status) return status;
    if (words % TRIAL_WORDS) return bad(in, "trials", "has another length");
    t->count = t->capacity = words / TRIAL_WORDS;
    for (size_t k = 0; k < t->count; k++)
        if (t->list[k].a >= n || t->list[k].b >= n || t->list[k].leader >= n)
            return bad(in, "trials", "names a Gaussian that is none");
    status = sf_sections_take_new(in, "trials.tiles", &t->tiles, &t->tile_count, INT32_MAX, sizeof *t->tiles);
    t->tile_capacity = t->tile_count;
    return status;
}

/* The best model so far, or one to go back to, if there is one. */
static sf_status take_best(sf_sections_in *in, sf_fitter *f) {
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
    if (!status) status = take_trials(in, f);
    if (!status) status = take_best(in, f);
    if (!status) status = take_learned(in, f);
    return status;
}

/* Other kernels or another program go on with the run, but not to the same bytes. */
static sf_status check_origin(sf_sections_in *in) {
    const char *names[] = {"program", "isa"}, *mine[] = {sf_version(), sf_context_isa(in->ctx)};
    for (int i = 0; i < 2; i++) {
        char text[64];
        uint64_t size;
        sf_status status = sf_sections_count(in, names[i], 1, &size);
        if (!status && size >= sizeof text) status = bad(in, names[i], "is too long");
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

sf_status sf_fitter_save(const sf_fitter *f, const char *path) {
    sf_sections_out out;
    sf_status status = sf_sections_create(&out, f->ctx, path, &checkpoint_kind);
    if (status) return status;
    put_text(&out, "program", sf_version());
    put_text(&out, "isa", sf_context_isa(f->ctx));
    status = put_options(&out, f);
    if (!status) status = put_scene(&out, f);
    if (!status) status = put_learned(&out, f);
    if (status) {
        sf_writer_abandon(&out.writer);
        return status;
    }
    put_state(&out, f);
    return sf_sections_commit(&out);
}

sf_status sf_checkpoint_options(sf_context *ctx, const char *path, sf_fit_options *options) {
    sf_sections_in in;
    sf_fit_options read;
    sf_status status = sf_sections_open(&in, ctx, path, &checkpoint_kind);
    if (status) return status;
    status = take_options(&in, &read);
    sf_sections_close(&in);
    if (!status) *options = read;
    return status;
}

static sf_status restore(sf_sections_in *in, sf_scene *scene, const sf_fit_options *asked, sf_fitter **f) {
    sf_fit_options options;
    sf_status status = take_options(in, &options);
    if (!status && asked) status = check_options(in, &options, asked);
    if (!status) status = sf_fitter_create_empty(in->ctx, scene, asked ? asked : &options, f);
    if (!status) status = take_scene(in, *f);
    if (!status) status = check_origin(in);
    if (!status) status = take_state(in, *f);
    return status ? status : sf_sections_all_taken(in);
}

sf_status sf_fitter_load(sf_context *ctx, sf_scene *scene, const char *path, const sf_fit_options *options,
                         sf_fitter **fitter) {
    sf_sections_in in;
    *fitter = NULL;
    sf_status status = sf_sections_open(&in, ctx, path, &checkpoint_kind);
    if (status) return status;
    status = restore(&in, scene, options, fitter);
    sf_sections_close(&in);
    if (status) sf_fitter_destroy(fitter);
    return status;
}
