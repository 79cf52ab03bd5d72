/* gaussian.c - one Gaussian on its way between a file and a model: its values, what is wrong with them. */
#include "gaussian.h"

#include <math.h>
#include <stdio.h>

#include "../base/memory.h"

/* Where the fields begin in sf_gaussian.values. */
enum { MEAN = 0, QUAT = 3, LOG_SCALE = 7, LOGIT_OPACITY = 10, SH = 11 };

static const double min_quat_norm = 1e-12;

sf_gaussians sf_gaussian_fields(sf_gaussian *g) {
    float *v = g->values;
    return (sf_gaussians){v + MEAN, v + QUAT, v + LOG_SCALE, v + LOGIT_OPACITY, v + SH};
}

static sf_file_value *add(sf_file_value *to, const char *format, int number, int at) {
    snprintf(to->name, sizeof to->name, format, number);
    to->at = at;
    return to + 1;
}

/* A file holds all reds of the higher bands, then all greens, then all blues; a model keeps RGB innermost. */
int sf_gaussian_values(int sh_degree, sf_file_value list[SF_GAUSSIAN_MOST]) {
    int higher = sf_coefficients(sh_degree) - 1;
    sf_file_value *to = list;
    for (int k = 0; k < 3; k++) to = add(to, "%c", 'x' + k, MEAN + k);
    for (int c = 0; c < 3; c++) to = add(to, "f_dc_%d", c, SH + c);
    for (int i = 0; i < 3 * higher; i++) to = add(to, "f_rest_%d", i, SH + 3 * (i % higher + 1) + i / higher);
    to = add(to, "opacity", 0, LOGIT_OPACITY);
    for (int k = 0; k < 3; k++) to = add(to, "scale_%d", k, LOG_SCALE + k);
    for (int k = 0; k < 4; k++) to = add(to, "rot_%d", k, QUAT + k);
    return (int)(to - list);
}

/* What each SH coefficient is odd in: a bit for each axis, as SF_FLIP_X has them. With D the diagonal of
 * signs the covariance becomes D R S S R^T D, which D R D has as its rotation: the quaternion's vector
 * changes its signs as the products of two axes do. */
static const unsigned char sh_is_odd[SF_MAX_COEFFICIENTS] = {0, 2, 4, 1, 3, 6, 0, 5, 0, 2, 7, 2, 4, 1, 4, 1};
static const unsigned char quat_is_odd[4] = {0, 6, 5, 3};

static int changes_sign(unsigned odd, unsigned axes) {
    unsigned both = odd & axes;
    return (both ^ both >> 1 ^ both >> 2) & 1;
}

void sf_gaussian_flip(sf_gaussian *g, int sh_degree, unsigned axes) {
    float *v = g->values;
    for (int k = 0; k < 3; k++)
        if (changes_sign(1u << k, axes)) v[MEAN + k] = -v[MEAN + k];
    for (int k = 1; k < 4; k++)
        if (changes_sign(quat_is_odd[k], axes)) v[QUAT + k] = -v[QUAT + k];
    for (int i = 0; i < 3 * sf_coefficients(sh_degree); i++)
        if (changes_sign(sh_is_odd[i / 3], axes)) v[SH + i] = -v[SH + i];
}

int sf_gaussian_is_faulty(const sf_gaussian *g, const sf_file_value *list, int values, sf_fault *found) {
    const float *v = g->values, *q = v + QUAT;
    for (int i = 0; i < values; i++) {
        int at = list[i].at, is_scale = at >= LOG_SCALE && at < LOG_SCALE + 3;
        if (isfinite(v[at]) && !(is_scale && (v[at] < SF_LOG_SCALE_LEAST || v[at] > SF_LOG_SCALE_MOST)))
            continue;
        snprintf(found->text, sizeof found->text, "%s is %g", list[i].name, (double)v[at]);
        return 1;
    }
    double w = q[0], x = q[1], y = q[2], z = q[3];
    if (sqrt(w * w + x * x + y * y + z * z) >= min_quat_norm) return 0;
    snprintf(found->text, sizeof found->text, "rot_0..3 are a zero quaternion");
    return 1;
}

sf_status sf_model_check(const sf_model *model, const char *path) {
    sf_file_value list[SF_GAUSSIAN_MOST];
    int values = sf_gaussian_values(sf_model_sh_degree(model), list);
    sf_gaussian g;
    sf_gaussians fields = sf_gaussian_fields(&g);
    sf_fault found;
    for (size_t i = 0; i < sf_model_count(model); i++) {
        sf_status status = sf_model_get(model, i, 1, &fields);
        if (status) return status;
        if (sf_gaussian_is_faulty(&g, list, values, &found))
            return sf_fail(model->ctx, SF_ERR_ARGUMENT, "%s: not written: Gaussian #%zu: %s", path, i,
                           found.text);
    }
    return SF_OK;
}

/* ---- In ---- */

/* An opacity of 1 or 0 has no finite logit, a Gaussian without extent no finite logarithm: writers give them
 * as infinite, or as far out as they please. Both are drawn as the nearest that a model holds. */
static int keep_ends(float *v) {
    int moved = isinf(v[LOGIT_OPACITY]) != 0; /* may be -1 */
    if (moved) v[LOGIT_OPACITY] = v[LOGIT_OPACITY] > 0 ? -SF_INVISIBLE : SF_INVISIBLE;
    for (int k = LOG_SCALE; k < LOG_SCALE + 3; k++) {
        if (!(v[k] < SF_LOG_SCALE_LEAST)) continue;
        v[k] = SF_LOG_SCALE_LEAST;
        moved = 1;
    }
    return moved;
}

/* Of `count` Gaussians, those in a part's pieces. */
static size_t of_part(size_t count, size_t part, size_t parts) {
    size_t pieces = count / SF_PIECE, last = pieces % parts;
    size_t full = pieces / parts + (part < last);
    return full * SF_PIECE + (part == last ? count % SF_PIECE : 0);
}

sf_status sf_model_builder_begin(sf_model_builder *in, sf_context *ctx, const char *path, size_t count,
                                 int sh_degree, const sf_model_file_options *options) {
    *in = (sf_model_builder){.ctx = ctx, .path = path};
    if (options && options->parts > 1) {
        in->part = (size_t)options->part, in->parts = (size_t)options->parts;
        count = of_part(count, in->part, in->parts);
    }
    in->values = sf_gaussian_values(sh_degree, in->list);
    sf_status status =
        sf_memory_check(ctx, path, "Gaussians", (uint64_t)count * (uint64_t)in->values * sizeof(float));
    if (status) return status;
    return sf_model_create(ctx, count, sh_degree, &in->model);
}

sf_status sf_model_builder_put(sf_model_builder *in, sf_gaussian *g) {
    sf_fault found;
    size_t index = in->offered++;
    in->moved += (size_t)keep_ends(g->values);
    if (sf_gaussian_is_faulty(g, in->list, in->values, &found)) {
        if (in->usable < index) return SF_OK;
        in->first_skipped = index;
        in->first_fault = found;
        return SF_OK;
    }
    size_t piece = in->usable++ / SF_PIECE;
    if (in->parts && piece % in->parts != in->part) return SF_OK;
    sf_gaussians fields = sf_gaussian_fields(g);
    return sf_model_set(in->model, in->kept++, 1, &fields);
}

static void report_moved(const sf_model_builder *in) {
    if (in->moved)
        sf_log(
            in->ctx, SF_LOG_INFO,
            "%s: of %zu Gaussians infinite logits of the opacity became %g or %g, log-scales below %g became "
            "that",
            in->path, in->moved, (double)SF_INVISIBLE, -(double)SF_INVISIBLE, (double)SF_LOG_SCALE_LEAST);
}

sf_status sf_model_builder_end(sf_model_builder *in, int antialiased, sf_model **model) {
    if (in->offered && !in->usable) {
        sf_model_builder_abandon(in);
        return sf_fail(
            in->ctx, SF_ERR_FORMAT,
            "%s: none of its %zu Gaussians can be used: their values are not finite or out of range "
            "(first: #%zu, %s)",
            in->path, in->offered, in->first_skipped, in->first_fault.text);
    }
    if (in->usable < in->offered)
        sf_log(in->ctx, SF_LOG_WARNING,
               "%s: skipped %zu of %zu Gaussians with values not finite or out of range (first: #%zu, %s)",
               in->path, in->offered - in->usable, in->offered, in->first_skipped, in->first_fault.text);
    report_moved(in);
    *model = in->model;
    sf_model_resize(*model, in->kept);
    (*model)->parts = in->parts;
    sf_model_set_antialiased(*model, antialiased);
    in->model = NULL;
    return SF_OK;
}

void sf_model_builder_abandon(sf_model_builder *in) { sf_model_destroy(&in->model); }
