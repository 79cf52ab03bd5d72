/* model_ply.c - Gaussians in and out, as INRIA's .ply. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../scene/gaussians.h"
#include "model_ply.h"

enum { MEAN_VALUES = 3, NORMAL_VALUES = 3 };

/* ---- In ---- */

sf_status sf_ply_find_degree(sf_context *ctx, const char *path, const sf_ply *ply, int *degree) {
    size_t rest = sf_ply_properties(ply, "f_rest_");
    for (*degree = 0; *degree <= SF_FILE_SH_DEGREE; ++*degree)
        if (rest == 3 * (size_t)(sf_coefficients(*degree) - 1)) return SF_OK;
    return sf_fail(ctx, SF_ERR_FORMAT, "%s: %zu properties f_rest, not 0, 9, 24, 45 or 72", path, rest);
}

/* Of the bands that are not wanted there are colours between those that are: the number that a wanted one has
 * in the file. */
static void name_in_file(sf_file_value *v, int file_degree, int degree) {
    int i, all = sf_coefficients(file_degree) - 1, kept = sf_coefficients(degree) - 1;
    if (sscanf(v->name, "f_rest_%d", &i) == 1)
        snprintf(v->name, sizeof v->name, "f_rest_%d", i / kept * all + i % kept);
}

sf_status sf_ply_bind_values(sf_ply *ply, const char *prefix, int file_degree, int degree) {
    sf_file_value list[SF_GAUSSIAN_MOST];
    int values = sf_gaussian_values(degree, list);
    sf_status status = SF_OK;
    for (int i = 0; i < values && !status; i++) {
        if (strncmp(list[i].name, prefix, strlen(prefix))) continue;
        name_in_file(&list[i], file_degree, degree);
        status = sf_ply_bind(ply, list[i].name, list[i].at);
    }
    return status;
}

/* Files of the same name that hold Gaussians of another kind. */
static sf_status check_kind(sf_context *ctx, const char *path, const sf_ply *ply) {
    if (!sf_ply_properties(ply, "scale_0") || !sf_ply_properties(ply, "scale_1") ||
        sf_ply_properties(ply, "scale_2"))
        return SF_OK;
    return sf_fail(ctx, SF_ERR_UNSUPPORTED,
                   "%s: element vertex: property scale_2 is missing: the flat Gaussians of 2DGS are not read",
                   path);
}

sf_status sf_ply_end_builder(sf_ply *ply, sf_model_builder *in, sf_status status, sf_model **model) {
    if (status) {
        sf_model_builder_abandon(in);
        return status;
    }
    status = sf_model_builder_end(in, sf_ply_antialiased(ply), model);
    if (!status) memcpy((*model)->origin, sf_ply_origin(ply), sizeof(*model)->origin);
    if (!status) sf_ply_report_rest(ply);
    return status;
}

/* The ranges of a file's opacities and scales. */
typedef struct value_ranges {
    float least_opacity, most_opacity, least_scale, most_scale;
} value_ranges;

static void widen(value_ranges *r, sf_gaussian *g) {
    const sf_gaussians fields = sf_gaussian_fields(g);
    r->least_opacity = fminf(r->least_opacity, *fields.logit_opacities);
    r->most_opacity = fmaxf(r->most_opacity, *fields.logit_opacities);
    for (int k = 0; k < 3; k++) {
        r->least_scale = fminf(r->least_scale, fields.log_scales[k]);
        r->most_scale = fmaxf(r->most_scale, fields.log_scales[k]);
    }
}

/* Some exporters write opacities and scales as they are drawn. A model whose Gaussians are all at least half
 * opaque, none nearly opaque, and all larger than a unit is not made by a fit; a handful of them may be made
 * by hand. */
static void warn_of_activated(const sf_model_builder *in, const value_ranges *r) {
    enum { ENOUGH = 100 };
    if (in->offered < ENOUGH || r->least_opacity < 0 || r->most_opacity > 1 || !(r->least_scale > 0)) return;
    sf_log(
        in->ctx, SF_LOG_WARNING,
        "%s: opacity is in %g..%g and scale_0..2 in %g..%g in all of %zu Gaussians: these look like "
        "opacities and "
        "scales themselves, but are read as logits and logarithms, as .ply files have them: export it anew",
        in->path, (double)r->least_opacity, (double)r->most_opacity, (double)r->least_scale,
        (double)r->most_scale, in->offered);
}

static sf_status load_all(sf_model_builder *in, sf_ply *ply) {
    sf_gaussian g;
    value_ranges ranges = {INFINITY, -INFINITY, INFINITY, -INFINITY};
    sf_status status = SF_OK;
    for (size_t i = 0; i < sf_ply_rows(ply) && !status; i++) {
        status = sf_ply_next(ply, g.values);
        if (status) break;
        widen(&ranges, &g);
        status = sf_model_builder_put(in, &g);
    }
    if (!status) warn_of_activated(in, &ranges);
    return status;
}

/* What a file announces has been checked against its size: the model may be allocated at once. */
static sf_status load_open(sf_context *ctx, const char *path, sf_ply *ply,
                           const sf_model_file_options *options, sf_model **model) {
    int file_degree, degree = 0;
    sf_model_builder in = {0};
    sf_status status = check_kind(ctx, path, ply);
    if (!status) status = sf_ply_find_degree(ctx, path, ply, &file_degree);
    if (!status) degree = sf_file_degree(ctx, path, file_degree, options);
    if (!status) status = sf_ply_bind_values(ply, "", file_degree, degree);
    if (!status) status = sf_model_builder_begin(&in, ctx, path, sf_ply_rows(ply), degree, options);
    if (!status) status = load_all(&in, ply);
    return sf_ply_end_builder(ply, &in, status, model);
}

sf_status sf_ply_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                      sf_model **model) {
    sf_ply *ply;
    sf_status status = sf_ply_open(ctx, path, &ply);
    if (!status) status = sf_ply_enter(ply, "vertex");
    if (!status)
        status = (sf_ply_properties(ply, "packed_position") ? sf_compressed_ply_load
                                                            : load_open)(ctx, path, ply, options, model);
    sf_ply_close(&ply);
    return status;
}

/* ---- Out ---- */

void sf_ply_put_header(sf_writer *w, const sf_model *model, size_t count, int sh_degree) {
    sf_file_value list[SF_GAUSSIAN_MOST];
    int values = sf_gaussian_values(sh_degree, list);
    sf_writer_printf(w, "ply\nformat binary_little_endian 1.0\n");
    if (sf_model_antialiased(model)) sf_writer_printf(w, "comment SplatRenderMode: mip\n");
    const double *o = model->origin;
    if (o[0] != 0 || o[1] != 0 || o[2] != 0)
        sf_writer_printf(w, "comment origin %.17g %.17g %.17g\n", o[0], o[1], o[2]);
    sf_writer_printf(w, "element vertex %zu\n", count);
    for (int i = 0; i < values; i++) {
        if (i == MEAN_VALUES)
            sf_writer_printf(w, "property float nx\nproperty float ny\nproperty float nz\n");
        sf_writer_printf(w, "property float %s\n", list[i].name);
    }
    sf_writer_printf(w, "end_header\n");
}

static uint8_t *encode(uint8_t *to, float value) {
    uint32_t u;
    memcpy(&u, &value, sizeof u);
    for (int b = 0; b < 4; b++) *to++ = (uint8_t)(u >> (8 * b));
    return to;
}

size_t sf_ply_row_bytes(int sh_degree) {
    return 4 * (size_t)(11 + 3 * sf_coefficients(sh_degree) + NORMAL_VALUES);
}

sf_status sf_ply_encode(const sf_model *model, size_t first, size_t count, int sh_degree, uint8_t *at) {
    sf_file_value list[SF_GAUSSIAN_MOST];
    int values = sf_gaussian_values(sh_degree, list);
    sf_gaussian g;
    sf_gaussians fields = sf_gaussian_fields(&g);
    for (size_t i = first; i < first + count; i++) {
        sf_status status = sf_model_get(model, i, 1, &fields);
        if (status) return status;
        for (int v = 0; v < values; v++) {
            for (int k = 0; v == MEAN_VALUES && k < NORMAL_VALUES; k++) at = encode(at, 0);
            at = encode(at, g.values[list[v].at]);
        }
    }
    return SF_OK;
}

sf_status sf_ply_put(sf_writer *w, const sf_model *model, int sh_degree,
                     const sf_model_file_options *options) {
    enum { ROWS = 64 };
    uint8_t rows[ROWS * 4 * (SF_GAUSSIAN_MOST + NORMAL_VALUES)];
    size_t all = sf_model_count(model);
    (void)options;
    sf_ply_put_header(w, model, all, sh_degree);
    for (size_t i = 0; i < all; i += ROWS) {
        size_t n = all - i < ROWS ? all - i : ROWS;
        sf_status status = sf_ply_encode(model, i, n, sh_degree, rows);
        if (status) return status;
        sf_writer_put(w, rows, n * sf_ply_row_bytes(sh_degree));
    }
    return SF_OK;
}
