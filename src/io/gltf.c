/* gltf.c - Gaussians in, from glTF 2.0 with KHR_gaussian_splatting: .glb, or .gltf with its buffers.
 *
 * Follows the extension's text as of April 2026. Every number of the JSON is held against the bytes that
 * there are before it is used.
 */
#include "gltf_format.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/bytes.h"
#include "../base/linear.h"
#include "../scene/gaussian_math.h"
#include "../scene/gaussians.h"
#include "gltf_data.h"
#include "model_file.h"

#include <splatfit/camera.h>

enum { NODES_DEEP = 64 };

/* A primitive as a node of the scene draws it. */
typedef struct piece {
    double M[12]; /* row-major 3 x 4, of the node in the world */
    const json_t *primitive;
    sf_gltf_column columns[SF_GLTF_ATTRIBUTES];
    size_t count;
    int sh_degree;
} piece;

typedef struct pieces {
    sf_gltf *in;
    piece *list;
    size_t count, capacity;
    uint64_t position_bytes;
} pieces;

/* ---- A primitive ---- */

static void warn_unless(const sf_gltf *in, const json_t *extension, const char *key, const char *known) {
    const char *value = json_string_value(json_object_get(extension, key));
    if (value && strcmp(value, known))
        sf_log(in->ctx, SF_LOG_WARNING, "%s: %s: %.40s is read as %s", in->path, key, value, known);
}

/* Compression stands inside the extension and takes the attributes' place. */
static sf_status refuse_compressed(const sf_gltf *in, const json_t *extension) {
    void *first = json_object_iter((json_t *)(uintptr_t)json_object_get(extension, "extensions"));
    if (!first) return SF_OK;
    return sf_fail(in->ctx, SF_ERR_UNSUPPORTED,
                   "%s: %.60s is not read: convert the file to one with plain attributes first", in->path,
                   json_object_iter_key(first));
}

static sf_status find_column(const sf_gltf *in, const json_t *attributes, int index, piece *p) {
    sf_gltf_attribute a = sf_gltf_attribute_at(index);
    const json_t *accessor = json_object_get(attributes, a.name);
    if (!accessor)
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: %s: the attribute is missing", in->path, a.name);
    sf_status status =
        sf_gltf_find_column((sf_gltf *)(uintptr_t)in, accessor, a.name, a.components, &p->columns[index]);
    if (status || !index) return status;
    if (p->columns[index].count == p->columns[0].count) return SF_OK;
    return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: %s: count: %zu is not POSITION's %zu", in->path, a.name,
                   p->columns[index].count, p->columns[0].count);
}

/* A band is there where its first coefficient is. */
static int degree_of(const json_t *attributes) {
    int degree = 0;
    while (degree < SF_MAX_SH_DEGREE &&
           json_object_get(attributes, sf_gltf_attribute_at(4 + sf_coefficients(degree)).name))
        degree++;
    return degree;
}

static sf_status read_primitive(sf_gltf *in, const json_t *extension, piece *p) {
    const json_t *attributes = json_object_get(p->primitive, "attributes");
    sf_status status = refuse_compressed(in, extension);
    warn_unless(in, extension, "kernel", "ellipse");
    warn_unless(in, extension, "colorSpace", "srgb_rec709_display");
    warn_unless(in, extension, "projection", "perspective");
    p->sh_degree = degree_of(attributes);
    for (int i = 0; i < 4 + sf_coefficients(p->sh_degree) && !status; i++)
        status = find_column(in, attributes, i, p);
    p->count = p->columns[0].count;
    return status;
}

static sf_status add_primitive(pieces *all, const json_t *primitive, const double M[12]) {
    const json_t *extension = json_object_get(json_object_get(primitive, "extensions"), SF_GLTF_EXTENSION);
    if (!json_is_object(extension)) return SF_OK;
    sf_status status =
        sf_grow(all->in->ctx, &all->list, &all->capacity, all->count, all->count + 1, sizeof *all->list);
    if (status) return status;
    piece *p = &all->list[all->count++];
    *p = (piece){.primitive = primitive};
    memcpy(p->M, M, sizeof p->M);
    status = read_primitive(all->in, extension, p);
    if (status) return status;
    all->position_bytes += (uint64_t)p->count * p->columns[0].bytes;
    if (all->position_bytes > all->in->loaded)
        return sf_fail(all->in->ctx, SF_ERR_FORMAT,
                       "%s: count: the positions of its Gaussians take more bytes than its buffers have",
                       all->in->path);
    return SF_OK;
}

/* ---- Nodes ---- */

static sf_status numbers(const sf_gltf *in, const json_t *node, const char *key, size_t n, double *to) {
    const json_t *list = json_object_get(node, key);
    if (!list) return SF_OK;
    int good = json_array_size(list) == n;
    for (size_t i = 0; i < n && good; i++) {
        good = json_is_number(json_array_get(list, i));
        to[i] = json_number_value(json_array_get(list, i));
        good = good && isfinite(to[i]);
    }
    return good ? SF_OK
                : sf_fail(in->ctx, SF_ERR_FORMAT, "%s: nodes: %s: is not %zu finite numbers", in->path, key,
                          n);
}

/* A node's own matrix, given whole by columns or in three parts. */
static sf_status local_matrix(const sf_gltf *in, const json_t *node, double M[12]) {
    double whole[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    double move[3] = {0}, turn[4] = {0, 0, 0, 1}, scale[3] = {1, 1, 1}, R[9];
    sf_status status = numbers(in, node, "matrix", 16, whole);
    if (!status) status = numbers(in, node, "translation", 3, move);
    if (!status) status = numbers(in, node, "rotation", 4, turn);
    if (!status) status = numbers(in, node, "scale", 3, scale);
    if (status) return status;
    const double q[4] = {turn[3], turn[0], turn[1], turn[2]};
    if (!(sf_dot3(q, q) + q[3] * q[3] > 0))
        return sf_fail(in->ctx, SF_ERR_FORMAT, "%s: nodes: rotation: is a zero quaternion", in->path);
    sf_rotation_from_quat(q, R);
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            double sum = 0; /* whole times the parts, of which one is neutral */
            for (int j = 0; j < 3; j++) sum += whole[4 * j + i] * R[3 * j + k] * scale[k];
            M[4 * i + k] = sum;
        }
        M[4 * i + 3] = whole[12 + i] + move[i];
    }
    return SF_OK;
}

static void chain(const double A[12], const double B[12], double C[12]) {
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 4; k++) {
            C[4 * i + k] = k == 3 ? A[4 * i + 3] : 0;
            for (int j = 0; j < 3; j++) C[4 * i + k] += A[4 * i + j] * B[4 * j + k];
        }
}

static sf_status visit(pieces *all, const json_t *index, const double above[12], int depth) {
    double own[12], M[12];
    size_t i;
    const json_t *node, *item;
    sf_status status = sf_gltf_item(all->in, index, "nodes", &node);
    if (!status && depth >= NODES_DEEP)
        status = sf_fail(all->in->ctx, SF_ERR_UNSUPPORTED, "%s: nodes: are more than %d deep", all->in->path,
                         NODES_DEEP);
    /* A tree has each node once: more visits than nodes are a circle, or one drawn twice. */
    if (!status && ++all->in->visits > json_array_size(json_object_get(all->in->root, "nodes")))
        status = sf_fail(all->in->ctx, SF_ERR_FORMAT, "%s: nodes: one has two parents", all->in->path);
    if (!status) status = local_matrix(all->in, node, own);
    if (status) return status;
    chain(above, own, M);
    const json_t *mesh_index = json_object_get(node, "mesh"), *mesh = NULL;
    if (mesh_index) status = sf_gltf_item(all->in, mesh_index, "meshes", &mesh);
    if (status) return status;
    json_array_foreach(json_object_get(mesh, "primitives"), i, item) {
        status = add_primitive(all, item, M);
        if (status) return status;
    }
    json_array_foreach(json_object_get(node, "children"), i, item) {
        status = visit(all, item, M, depth + 1);
        if (status) return status;
    }
    return SF_OK;
}

static sf_status find_pieces(pieces *all) {
    static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const json_t *index = json_object_get(all->in->root, "scene"), *scene, *item;
    json_t *first = json_integer(0);
    size_t i;
    sf_status status = first ? sf_gltf_item(all->in, index ? index : first, "scenes", &scene) : SF_ERR_MEMORY;
    json_decref(first);
    if (status) return status;
    json_array_foreach(json_object_get(scene, "nodes"), i, item) {
        status = visit(all, item, identity, 0);
        if (status) return status;
    }
    if (all->count) return SF_OK;
    return sf_fail(all->in->ctx, SF_ERR_FORMAT,
                   "%s: holds no Gaussians: its scene has no mesh with " SF_GLTF_EXTENSION, all->in->path);
}

/* ---- Values ---- */

/* splat-transform up to 2.3.1 wrote logarithms under the name; lengths are never negative. */
static int scales_are_logs(const sf_gltf *in, const pieces *all) {
    size_t negative = 0, values = 0;
    for (size_t p = 0; p < all->count; p++)
        for (size_t i = 0; i < all->list[p].count; i++)
            for (int k = 0; k < 3; k++, values++)
                negative += sf_gltf_value(&all->list[p].columns[2], i, k) < 0;
    if (negative <= values / 100) return 0;
    sf_log(in->ctx, SF_LOG_WARNING,
           "%s: SCALE: %zu of %zu values are negative: read as logarithms, as splat-transform up to 2.3.1 "
           "writes them",
           in->path, negative, values);
    return 1;
}

/* The ends come back finite: an opacity of 1 as what rounds to it as a float. */
static float logit_of(double opacity) {
    const double least = 2e-9, most = 1 - 3e-8;
    if (!(opacity >= 0 && opacity <= 1)) return NAN;
    double o = fmin(fmax(opacity, least), most);
    return (float)sf_logit(o);
}

static float log_of(double length) {
    return length == 0 ? SF_LOG_SCALE_LEAST : length > 0 ? (float)log(length) : NAN;
}

static void decode(const piece *p, size_t i, int logs, sf_gaussian *g) {
    sf_gaussians f = sf_gaussian_fields(g);
    for (int k = 0; k < 3; k++) f.means[k] = (float)sf_gltf_value(&p->columns[0], i, k);
    for (int k = 0; k < 4; k++) f.quats[(k + 1) % 4] = (float)sf_gltf_value(&p->columns[1], i, k);
    for (int k = 0; k < 3; k++) {
        double scale = sf_gltf_value(&p->columns[2], i, k);
        f.log_scales[k] = logs ? (float)scale : log_of(scale);
    }
    f.logit_opacities[0] = logit_of(sf_gltf_value(&p->columns[3], i, 0));
    for (int k = 0; k < 3 * sf_coefficients(p->sh_degree); k++)
        f.sh[k] = (float)sf_gltf_value(&p->columns[4 + k / 3], i, k % 3);
    sf_gltf_turn(g, p->sh_degree);
}

/* The node's matrix between turned axes: D M D, of a uniform scale. */
static sf_status motion_of(const sf_gltf *in, const double M[12], sf_similarity *motion) {
    static const double D[3] = {-1, -1, 1};
    double columns[9], cross[3];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) columns[3 * k + i] = D[i] * M[4 * i + k] * D[k];
    motion->scale = sqrt(sf_dot3(columns, columns));
    int good = isfinite(motion->scale) && motion->scale > 0;
    for (int i = 0; i < 3; i++) {
        motion->move[i] = D[i] * M[4 * i + 3];
        for (int k = 0; k < 3; k++) motion->R[3 * i + k] = columns[3 * k + i] / motion->scale;
    }
    sf_cross3(motion->R, motion->R + 3, cross);
    for (int k = 0; k < 3; k++) {
        double row = sf_dot3(motion->R + 3 * k, motion->R + 3 * k);
        good = good && fabs(row - 1) < 1e-4 && fabs(cross[k] - motion->R[6 + k]) < 1e-4;
    }
    if (!good)
        return sf_fail(in->ctx, SF_ERR_UNSUPPORTED,
                       "%s: nodes: a matrix is not a rotation, a move and one scale", in->path);
    double q[4];
    sf_rotation_to_quat(motion->R, q);
    sf_rotation_from_quat(q, motion->R); /* orthonormal */
    return SF_OK;
}

/* Whether the node moves its Gaussians so far that their means, as floats, would be coarse. */
static int is_far(const sf_model *model, const sf_similarity *motion) {
    const double most = 256; /* as of projects: origin.c */
    double reach = 0, move = 0;
    for (size_t i = 0; i < model->count; i++)
        for (int k = 0; k < 3; k++)
            reach = fmax(reach, fabs((double)*sf_value(&model->params, SF_FIELD_mean, i, k)));
    for (int k = 0; k < 3; k++) move = fmax(move, fabs(motion->move[k]));
    return move > most * motion->scale * reach;
}

/* alone: no other piece has the model's coordinates, so that a far translation can be its origin. */
static sf_status read_piece(const sf_gltf *in, const piece *p, int logs, int kept, int alone,
                            sf_model **model) {
    static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    sf_similarity motion;
    sf_model_builder builder;
    sf_gaussian g;
    piece part = *p;
    if (kept < part.sh_degree) part.sh_degree = kept;
    sf_status status = motion_of(in, p->M, &motion);
    if (status) return status;
    status = sf_model_builder_begin(&builder, in->ctx, in->path, p->count, part.sh_degree, NULL);
    for (size_t i = 0; i < p->count && !status; i++) {
        decode(&part, i, logs, &g);
        status = sf_model_builder_put(&builder, &g);
    }
    if (status)
        sf_model_builder_abandon(&builder);
    else
        status = sf_model_builder_end(&builder, 0, model);
    if (status || !memcmp(p->M, identity, sizeof identity)) return status;
    double origin[3] = {0};
    if (alone && is_far(*model, &motion)) {
        memcpy(origin, motion.move, sizeof origin);
        memset(motion.move, 0, sizeof motion.move);
    }
    status = sf_model_transform(*model, &motion);
    memcpy((*model)->origin, origin, sizeof origin);
    return status;
}

/* All models as one, of the highest degree. */
static sf_status join(sf_context *ctx, sf_model *const *parts, size_t n, sf_model **model) {
    size_t count = 0, at = 0;
    int degree = 0;
    for (size_t p = 0; p < n; p++) {
        count += sf_model_count(parts[p]);
        if (sf_model_sh_degree(parts[p]) > degree) degree = sf_model_sh_degree(parts[p]);
    }
    sf_status status = sf_model_create(ctx, count, degree, model);
    for (size_t p = 0; p < n && !status; p++)
        for (size_t i = 0; i < sf_model_count(parts[p]) && !status; i++) {
            sf_gaussian g = {0};
            sf_gaussians f = sf_gaussian_fields(&g);
            status = sf_model_get(parts[p], i, 1, &f);
            if (!status) status = sf_model_set(*model, at++, 1, &f);
        }
    return status;
}

static sf_status read_pieces(const pieces *all, const sf_model_file_options *options, sf_model **model) {
    sf_context *ctx = all->in->ctx;
    sf_model **parts = sf_calloc(ctx, all->count, sizeof(sf_model *));
    sf_status status = parts ? SF_OK : SF_ERR_MEMORY;
    int logs = scales_are_logs(all->in, all);
    for (size_t p = 0; p < all->count && !status; p++)
        status = read_piece(all->in, &all->list[p], logs, sf_kept_degree(SF_MAX_SH_DEGREE, options),
                            all->count == 1, &parts[p]);
    if (!status && all->count == 1) {
        *model = parts[0];
        parts[0] = NULL;
    } else if (!status) {
        status = join(ctx, parts, all->count, model);
    }
    for (size_t p = 0; parts && p < all->count; p++) sf_model_destroy(&parts[p]);
    if (status) sf_model_destroy(model);
    sf_free(ctx, parts);
    return status;
}

sf_status sf_gltf_load(sf_context *ctx, const char *path, const sf_model_file_options *options,
                       sf_model **model) {
    sf_gltf in;
    sf_status status = sf_gltf_open(&in, ctx, path);
    pieces all = {.in = &in};
    if (!status) status = find_pieces(&all);
    if (!status) status = read_pieces(&all, options, model);
    sf_free(ctx, all.list);
    sf_gltf_close(&in);
    return status;
}
