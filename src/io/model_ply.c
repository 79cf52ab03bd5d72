/* model_ply.c - Gaussians in and out, as INRIA's .ply. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/file.h"
#include "../scene/gaussians.h"
#include "ply.h"

/* The values of one Gaussian. In a file the order is POSITION, normal, DC, REST, then OPACITY, SCALE,
 * ROTATION; REST comes last here since its number depends on the degree. */
enum {
    POSITION = 0,
    DC = 3,
    OPACITY = 6,
    SCALE = 7,
    ROTATION = 10,
    REST = 14,
    MAX_COEFFICIENTS = (SF_MAX_SH_DEGREE + 1) * (SF_MAX_SH_DEGREE + 1),
    MAX_VALUES = REST + 3 * (MAX_COEFFICIENTS - 1)
};

enum { MAX_LOG_SCALE = 20 };
static const double min_quat_norm = 1e-12;

typedef struct gaussian {
    int coefficients; /* of the SH, 1, 4, 9 or 16 */
    float values[MAX_VALUES];
    float sh[3 * MAX_COEFFICIENTS];
} gaussian;

static int coefficients(int degree) { return (degree + 1) * (degree + 1); }
static int value_count(const gaussian *g) { return REST + 3 * (g->coefficients - 1); }

static sf_gaussians as_arrays(gaussian *g) {
    float *v = g->values;
    return (sf_gaussians){v + POSITION, v + ROTATION, v + SCALE, v + OPACITY, g->sh};
}

/* A file holds all reds of the higher bands, then all greens, then all blues; a model keeps RGB innermost. */
static void sh_from_values(gaussian *g) {
    int higher = g->coefficients - 1;
    for (int c = 0; c < 3; c++) {
        g->sh[c] = g->values[DC + c];
        for (int k = 0; k < higher; k++) g->sh[3 * (k + 1) + c] = g->values[REST + c * higher + k];
    }
}

static void values_from_sh(gaussian *g) {
    int higher = g->coefficients - 1;
    for (int c = 0; c < 3; c++) {
        g->values[DC + c] = g->sh[c];
        for (int k = 0; k < higher; k++) g->values[REST + c * higher + k] = g->sh[3 * (k + 1) + c];
    }
}

typedef struct name {
    char s[24];
} name;

typedef struct fault {
    char s[64];
} fault;

static name value_name(int value) {
    name n;
    if (value < DC)
        snprintf(n.s, sizeof n.s, "%c", "xyz"[value - POSITION]);
    else if (value < OPACITY)
        snprintf(n.s, sizeof n.s, "f_dc_%d", value - DC);
    else if (value < SCALE)
        snprintf(n.s, sizeof n.s, "opacity");
    else if (value < ROTATION)
        snprintf(n.s, sizeof n.s, "scale_%d", value - SCALE);
    else if (value < REST)
        snprintf(n.s, sizeof n.s, "rot_%d", value - ROTATION);
    else
        snprintf(n.s, sizeof n.s, "f_rest_%d", value - REST);
    return n;
}

/* Whether a Gaussian would hurt whoever reads it, and by which value. */
static int is_faulty(const gaussian *g, fault *found) {
    const float *v = g->values, *q = v + ROTATION;
    for (int i = 0; i < value_count(g); i++) {
        int is_scale = i >= SCALE && i < ROTATION;
        if (isfinite(v[i]) && !(is_scale && fabsf(v[i]) > MAX_LOG_SCALE)) continue;
        snprintf(found->s, sizeof found->s, "%s is %g", value_name(i).s, (double)v[i]);
        return 1;
    }
    double w = q[0], x = q[1], y = q[2], z = q[3];
    if (sqrt(w * w + x * x + y * y + z * z) >= min_quat_norm) return 0;
    snprintf(found->s, sizeof found->s, "rot_0..3 are a zero quaternion");
    return 1;
}

/* ---- In ---- */

typedef struct loader {
    sf_context *ctx;
    const char *path;
    sf_ply *ply;
    sf_model *model;
    size_t kept, first_skipped;
    fault first_fault;
} loader;

static sf_status find_degree(const loader *l, int *degree) {
    size_t rest = sf_ply_properties(l->ply, "f_rest_");
    for (*degree = 0; *degree <= SF_MAX_SH_DEGREE; ++*degree)
        if (rest == 3 * (size_t)(coefficients(*degree) - 1)) return SF_OK;
    return sf_fail(l->ctx, SF_ERR_FORMAT, "%s: element vertex: %zu properties f_rest, not 0, 9, 24 or 45",
                   l->path, rest);
}

static sf_status load_one(loader *l, gaussian *g, size_t index) {
    fault found;
    sf_status status = sf_ply_next(l->ply, g->values);
    if (status) return status;
    if (is_faulty(g, &found)) {
        if (l->kept < index) return SF_OK;
        l->first_skipped = index;
        l->first_fault = found;
        return SF_OK;
    }
    sh_from_values(g);
    sf_gaussians arrays = as_arrays(g);
    return sf_model_set(l->model, l->kept++, 1, &arrays);
}

static sf_status load_all(loader *l, gaussian *g) {
    size_t count = sf_ply_vertices(l->ply);
    for (size_t i = 0; i < count; i++) {
        sf_status status = load_one(l, g, i);
        if (status) return status;
    }
    if (l->kept < count)
        sf_log(l->ctx, SF_LOG_WARNING,
               "%s: skipped %zu of %zu Gaussians with values not finite or out of range (first: #%zu, %s)",
               l->path, count - l->kept, count, l->first_skipped, l->first_fault.s);
    sf_ply_report_rest(l->ply);
    sf_model_resize(l->model, l->kept);
    sf_model_set_antialiased(l->model, sf_ply_antialiased(l->ply));
    return SF_OK;
}

/* What a file announces has been checked against its size: the model may be allocated at once. */
static sf_status load_open(loader *l) {
    int degree;
    sf_status status = find_degree(l, &degree);
    if (status) return status;
    gaussian g = {.coefficients = coefficients(degree)};
    for (int i = 0; i < value_count(&g) && !status; i++) status = sf_ply_bind(l->ply, value_name(i).s, i);
    if (!status) status = sf_model_create(l->ctx, sf_ply_vertices(l->ply), degree, &l->model);
    if (!status) status = load_all(l, &g);
    return status;
}

sf_status sf_model_load(sf_context *ctx, const char *path, sf_model **model) {
    loader l = {.ctx = ctx, .path = path};
    *model = NULL;
    sf_status status = sf_ply_open(ctx, path, &l.ply);
    if (!status) status = load_open(&l);
    if (status)
        sf_model_destroy(&l.model);
    else
        *model = l.model;
    sf_ply_close(&l.ply);
    return status;
}

/* ---- Out ---- */

static sf_status check_model(const sf_model *model, const char *path, gaussian *g) {
    fault found;
    sf_gaussians arrays = as_arrays(g);
    for (size_t i = 0; i < sf_model_count(model); i++) {
        sf_status status = sf_model_get(model, i, 1, &arrays);
        if (status) return status;
        values_from_sh(g);
        if (is_faulty(g, &found))
            return sf_fail(model->ctx, SF_ERR_ARGUMENT, "%s: not written: Gaussian #%zu: %s", path, i,
                           found.s);
    }
    return SF_OK;
}

static void put_properties(sf_writer *w, int first, int count) {
    for (int i = first; i < first + count; i++) sf_writer_printf(w, "property float %s\n", value_name(i).s);
}

static void put_header(sf_writer *w, const sf_model *model, int rest) {
    sf_writer_printf(w, "ply\nformat binary_little_endian 1.0\n");
    if (sf_model_antialiased(model)) sf_writer_printf(w, "comment SplatRenderMode: mip\n");
    sf_writer_printf(w, "element vertex %zu\n", sf_model_count(model));
    put_properties(w, POSITION, 3);
    sf_writer_printf(w, "property float nx\nproperty float ny\nproperty float nz\n");
    put_properties(w, DC, 3);
    put_properties(w, REST, rest);
    put_properties(w, OPACITY, REST - OPACITY);
    sf_writer_printf(w, "end_header\n");
}

static uint8_t *encode(uint8_t *to, const float *values, int count) {
    for (int i = 0; i < count; i++, to += 4) {
        uint32_t u;
        memcpy(&u, values + i, sizeof u);
        for (int b = 0; b < 4; b++) to[b] = (uint8_t)(u >> (8 * b));
    }
    return to;
}

static void put_row(sf_writer *w, const gaussian *g, int rest) {
    static const float normal[3] = {0, 0, 0};
    uint8_t row[4 * (MAX_VALUES + 3)], *at = row;
    at = encode(at, g->values + POSITION, 3);
    at = encode(at, normal, 3);
    at = encode(at, g->values + DC, 3);
    at = encode(at, g->values + REST, rest);
    at = encode(at, g->values + OPACITY, REST - OPACITY);
    sf_writer_put(w, row, (size_t)(at - row));
}

static sf_status put_gaussians(sf_writer *w, const sf_model *model, gaussian *g) {
    int rest = value_count(g) - REST;
    sf_gaussians arrays = as_arrays(g);
    put_header(w, model, rest);
    for (size_t i = 0; i < sf_model_count(model); i++) {
        sf_status status = sf_model_get(model, i, 1, &arrays);
        if (status) return status;
        values_from_sh(g);
        put_row(w, g, rest);
    }
    return SF_OK;
}

sf_status sf_model_save(const sf_model *model, const char *path) {
    gaussian g = {.coefficients = coefficients(sf_model_sh_degree(model))};
    sf_writer w;
    sf_status status = check_model(model, path, &g);
    if (!status) status = sf_writer_open(&w, model->ctx, path);
    if (status) return status;
    status = put_gaussians(&w, model, &g);
    if (!status) return sf_writer_commit(&w);
    sf_writer_abandon(&w);
    return status;
}
