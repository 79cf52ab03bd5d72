/* checkpoint_views.c - the views of a scene in a checkpoint, and the learned values of each. */
#include "checkpoint.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* The scene: views are recognised by name, split, camera and picture. */

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

static sf_status describe(sf_view *view, int32_t *values, double *camera, uint64_t *picture) {
    const sf_camera *c = &view->camera;
    const double lens[] = {c->fx, c->fy, c->cx, c->cy};
    values[0] = (int32_t)view->split, values[1] = c->width, values[2] = c->height;
    memcpy(camera, lens, sizeof lens);
    memcpy(camera + 4, c->R_cw, sizeof c->R_cw);
    memcpy(camera + 13, c->t_cw, sizeof c->t_cw);
    return sf_view_hash(view, picture);
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
    sf_status status = SF_OK;
    char *at = t->names;
    for (size_t i = 0; i < count && !status; i++) {
        size_t size = strlen(views[i]->name) + 1;
        memcpy(at, views[i]->name, size);
        at += size;
        status =
            describe(views[i], t->values + VIEW_VALUES * i, t->cameras + CAMERA_VALUES * i, t->pictures + i);
    }
    if (status) free_table(ctx, t);
    return status;
}

/* Views are stored as their index in the scene; UINT32_MAX: the view was removed. */
static uint32_t index_of(sf_view *const *views, size_t count, uint32_t id) {
    size_t index = 0;
    while (index < count && views[index]->id != id) index++;
    return index < count ? (uint32_t)index : UINT32_MAX;
}

static void put_indices(sf_sections_out *out, const char *name, const uint32_t *ids, size_t n,
                        sf_view *const *views, size_t count, uint32_t *indices) {
    for (size_t i = 0; i < n; i++) indices[i] = index_of(views, count, ids[i]);
    sf_sections_put(out, name, indices, n, sizeof *indices);
}

/* The views in the pass and in validation, the blurred and the misplaced ones, and how many views were
 * assigned. */
static void put_views(sf_sections_out *out, const sf_fitter *f, sf_view *const *views, size_t count,
                      uint32_t *indices) {
    int64_t known = 0;
    while (known < (int64_t)count && views[known]->id <= f->validation.newest_id) known++;
    put_indices(out, "order", f->sampler.ids, f->sampler.count, views, count, indices);
    put_indices(out, "kept.out", f->validation.ids, f->validation.count, views, count, indices);
    put_indices(out, "blurred", f->blur.ids, f->blur.count, views, count, indices);
    put_indices(out, "misplaced", f->misplaced.ids, f->misplaced.count, views, count, indices);
    sf_sections_put(out, "known", &known, 1, sizeof known);
}

sf_status sf_checkpoint_put_scene(sf_sections_out *out, const sf_fitter *f) {
    sf_view **views;
    size_t count;
    view_table t;
    sf_status status = sf_scene_retain_all(f->scene, &views, &count);
    if (status) return status;
    size_t most = f->sampler.count > f->validation.count ? f->sampler.count : f->validation.count;
    if (f->blur.count > most) most = f->blur.count;
    if (f->misplaced.count > most) most = f->misplaced.count;
    uint32_t *indices = sf_alloc(f->ctx, most, sizeof *indices);
    status = indices ? make_table(f->ctx, views, count, &t) : SF_ERR_MEMORY;
    if (!status) {
        sf_sections_put(out, "views.names", t.names, t.name_bytes, 1);
        sf_sections_put(out, "views.sizes", t.values, VIEW_VALUES * count, sizeof *t.values);
        sf_sections_put(out, "views.cameras", t.cameras, CAMERA_VALUES * count, sizeof *t.cameras);
        sf_sections_put(out, "views.pictures", t.pictures, count, sizeof *t.pictures);
        put_views(out, f, views, count, indices);
        free_table(f->ctx, &t);
    }
    sf_free(f->ctx, indices);
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
    if (!status && n != VIEW_VALUES * t->count) status = sf_checkpoint_bad(in, "views.sizes", "is too short");
    if (!status)
        status = sf_sections_take_new(in, "views.cameras", &t->cameras, &n, CAMERA_VALUES * t->count,
                                      sizeof *t->cameras);
    if (!status && n != CAMERA_VALUES * t->count)
        status = sf_checkpoint_bad(in, "views.cameras", "is too short");
    if (!status && t->name_bytes && t->names[t->name_bytes - 1])
        status = sf_checkpoint_bad(in, "views.names", "has no end");
    if (status) free_table(in->ctx, t);
    return status;
}

static sf_status other_scene(const sf_sections_in *in, const char *name, const char *what) {
    return sf_fail(in->ctx, SF_ERR_ARGUMENT, "%s: is of another scene: view %s: %s", in->path, name, what);
}

static const char *split_text(int32_t split) { return split == SF_SPLIT_TEST ? "held out" : "for training"; }

/* Compares view i of the scene with that of the checkpoint, named `name`. */
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
        if (name >= end) return sf_checkpoint_bad(in, "views.names", "is too short");
        sf_status status = compare_view(in, t, i, name, views[i]);
        if (status) return status;
        name += strlen(name) + 1;
    }
    return SF_OK;
}

/* Turns indices back to ids; 0 for a removed view, since no view has the id 0. */
static sf_status take_indices(sf_sections_in *in, const char *name, uint32_t **ids, size_t *n,
                              sf_view *const *views, size_t count) {
    sf_status status = sf_sections_take_new(in, name, ids, n, INT32_MAX, sizeof **ids);
    for (size_t i = 0; i < *n && !status; i++) {
        uint32_t index = (*ids)[i];
        if (index != UINT32_MAX && index >= count)
            status = sf_checkpoint_bad(in, name, "an index is out of range");
        else
            (*ids)[i] = index == UINT32_MAX ? 0 : views[index]->id;
    }
    return status;
}

/* Reads how many of the present views were assigned before; others may have been removed since. */
static sf_status take_newest(sf_sections_in *in, sf_fitter *f, sf_view *const *views, size_t count) {
    int64_t known;
    sf_status status = sf_sections_take(in, "known", &known, 1, sizeof known);
    if (!status && (known < 0 || known > (int64_t)count))
        status = sf_checkpoint_bad(in, "known", "is not a number of the scene's views");
    if (!status) f->validation.newest_id = known ? views[known - 1]->id : 0;
    return status;
}

sf_status sf_checkpoint_take_scene(sf_sections_in *in, sf_fitter *f) {
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
    if (!status) status = take_indices(in, "order", &f->sampler.ids, &f->sampler.count, views, count);
    if (!status)
        status = take_indices(in, "kept.out", &f->validation.ids, &f->validation.count, views, count);
    if (!status) status = take_indices(in, "blurred", &f->blur.ids, &f->blur.count, views, count);
    if (!status) status = take_indices(in, "misplaced", &f->misplaced.ids, &f->misplaced.count, views, count);
    if (!status) f->validation.capacity = f->validation.count, status = take_newest(in, f, views, count);
    sf_scene_release_all(f->scene, views, count);
    return status;
}

/* The learned values of each view: a row of numbers; views as indices in the scene. */

/* Reals and arrays of reals in the state of a view and of a lens. */
#define LEARNED_OF_VIEW(F)                                                                                   \
    F(log_gain)                                                                                              \
    F(bias)                                                                                                  \
    F(exposure.m)                                                                                            \
    F(exposure.v)                                                                                            \
    F(R_cw)                                                                                                  \
    F(t_cw)                                                                                                  \
    F(pose.last)                                                                                             \
    F(pose.size)                                                                                             \
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

sf_status sf_checkpoint_put_learned(sf_sections_out *out, const sf_fitter *f) {
    const sf_view_states *v = &f->views;
    if (!v->count) return SF_OK;
    double *rows = sf_alloc(f->ctx, v->count, VIEW_ROW * sizeof *rows);
    double *lenses = sf_alloc(f->ctx, v->lens_count, LENS_ROW * sizeof *lenses);
    uint32_t *indices = sf_alloc(f->ctx, v->count, sizeof *indices);
    sf_view **views = NULL;
    size_t count = 0;
    sf_status status =
        rows && lenses && indices ? sf_scene_retain_all(f->scene, &views, &count) : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < v->count; i++) {
            indices[i] = index_of(views, count, v->states[i].id);
            pack_view(&v->states[i], rows + VIEW_ROW * i);
        }
        for (size_t i = 0; i < v->lens_count; i++) pack_lens(&v->lenses[i], lenses + LENS_ROW * i);
        sf_sections_put(out, "learned.places", indices, v->count, sizeof *indices);
        sf_sections_put(out, "learned.views", rows, VIEW_ROW * v->count, sizeof *rows);
        sf_sections_put(out, "learned.lenses", lenses, LENS_ROW * v->lens_count, sizeof *lenses);
        sf_scene_release_all(f->scene, views, count);
    }
    sf_free(f->ctx, rows);
    sf_free(f->ctx, lenses);
    sf_free(f->ctx, indices);
    return status;
}

/* Whether a number read from the file is a count or a side in px, before it is cast. */
static int is_whole(double value, double most) {
    return value >= 0 && value <= most && value == floor(value);
}

/* States from rows, by ascending ids; rows of removed views are skipped. */
static sf_status take_states(const sf_sections_in *in, sf_fitter *f, const uint32_t *indices,
                             const double *rows, size_t n, sf_view *const *views, size_t count) {
    sf_view_states *v = &f->views;
    sf_status status = sf_grow(f->ctx, &v->states, &v->capacity, 0, n, sizeof *v->states);
    if (!status) status = sf_grow(f->ctx, &v->scratch, &v->scratch_capacity, 0, n, sizeof *v->scratch);
    for (size_t i = 0; i < n && !status; i++) {
        const double *row = rows + VIEW_ROW * i;
        if (indices[i] == UINT32_MAX) continue;
        for (size_t k = 0; k < VIEW_ROW; k++)
            if (!isfinite(row[k]))
                return sf_checkpoint_bad(in, "learned.views", "holds a value that is not finite");
        if (indices[i] >= count || !(row[0] >= 0 && row[0] < (double)v->lens_count))
            return sf_checkpoint_bad(in, "learned.views", "an index is out of range");
        if (!is_whole(row[2], SF_CHECKPOINT_MOST) || !is_whole(row[3], SF_CHECKPOINT_MOST))
            return sf_checkpoint_bad(in, "learned.views", "a number of steps is out of range");
        if (v->count && views[indices[i]]->id <= v->states[v->count - 1].id)
            return sf_checkpoint_bad(in, "learned.places", "names a view twice, or before an earlier one");
        sf_view_state *s = &v->states[v->count++];
        *s = (sf_view_state){.id = views[indices[i]]->id, .given = views[indices[i]]->camera};
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
        if (!isfinite(rows[k]))
            status = sf_checkpoint_bad(in, "learned.lenses", "holds a value that is not finite");
    if (!status && n % LENS_ROW) status = sf_checkpoint_bad(in, "learned.lenses", "has another length");
    if (!status) status = sf_grow(f->ctx, &v->lenses, &v->lens_capacity, 0, n / LENS_ROW, sizeof *v->lenses);
    for (size_t i = 0; i < n / LENS_ROW && !status; i++) {
        const double *row = rows + LENS_ROW * i;
        if (!is_whole(row[0], INT32_MAX) || !is_whole(row[1], INT32_MAX) ||
            !is_whole(row[2], SF_CHECKPOINT_MOST)) {
            status = sf_checkpoint_bad(in, "learned.lenses", "a size or a number of steps is out of range");
            break;
        }
        v->lenses[v->lens_count] = (sf_view_lens){0};
        unpack_lens(row, &v->lenses[v->lens_count++]);
    }
    sf_free(f->ctx, rows);
    return status;
}

sf_status sf_checkpoint_take_learned(sf_sections_in *in, sf_fitter *f) {
    uint64_t have;
    if (sf_sections_count(in, "learned.places", sizeof(uint32_t), &have))
        return SF_OK; /* nothing was learned */
    uint32_t *indices = NULL;
    double *rows = NULL;
    sf_view **views = NULL;
    size_t n = 0, values = 0, count = 0;
    sf_status status = take_lenses(in, f);
    if (!status)
        status = sf_sections_take_new(in, "learned.places", &indices, &n, INT32_MAX / 128, sizeof *indices);
    if (!status)
        status = sf_sections_take_new(in, "learned.views", &rows, &values, VIEW_ROW * n, sizeof *rows);
    if (!status && values != VIEW_ROW * n)
        status = sf_checkpoint_bad(in, "learned.views", "has another length");
    if (!status) status = sf_scene_retain_all(f->scene, &views, &count);
    if (!status) {
        status = take_states(in, f, indices, rows, n, views, count);
        sf_scene_release_all(f->scene, views, count);
    }
    sf_free(f->ctx, indices);
    sf_free(f->ctx, rows);
    return status;
}
