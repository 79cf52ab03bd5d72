/* gltf_write.c - Gaussians out, as a .glb: floats, one after another what KHR_gaussian_splatting names. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "../scene/gaussians.h"
#include "gltf_format.h"
#include "model_file.h"
#include "quantise.h"

enum { TARGET_ARRAY = 34962, FLOAT_DIGITS = 9, DOUBLE_DIGITS = 17 };

sf_gltf_attribute sf_gltf_attribute_at(int index) {
    static const sf_gltf_attribute first[] = {{"POSITION", 3},
                                              {SF_GLTF_EXTENSION ":ROTATION", 4},
                                              {SF_GLTF_EXTENSION ":SCALE", 3},
                                              {SF_GLTF_EXTENSION ":OPACITY", 1}};
    if (index < 4) return first[index];
    int k = index - 4, degree = k < 1 ? 0 : k < 4 ? 1 : k < 9 ? 2 : 3;
    sf_gltf_attribute a = {.components = 3};
    snprintf(a.name, sizeof a.name, SF_GLTF_EXTENSION ":SH_DEGREE_%d_COEF_%d", degree, k - degree * degree);
    return a;
}

/* The turn is (0, 0, 0, 1) as a quaternion w x y z; of the SH it negates what is odd in x and y together,
 * which are the odd orders m. */
void sf_gltf_turn(sf_gaussian *g, int sh_degree) {
    sf_gaussians f = sf_gaussian_fields(g);
    const float q[4] = {f.quats[0], f.quats[1], f.quats[2], f.quats[3]};
    for (int k = 0; k < 2; k++) f.means[k] = -f.means[k];
    f.quats[0] = -q[3];
    f.quats[1] = -q[2];
    f.quats[2] = q[1];
    f.quats[3] = q[0];
    for (int degree = 1; degree <= sh_degree; degree++)
        for (int m = -degree; m <= degree; m++)
            for (int c = 0; c < 3 && m % 2; c++) {
                float *value = &f.sh[3 * (degree * degree + degree + m) + c];
                *value = -*value;
            }
}

typedef struct gltf_out {
    sf_writer *w;
    const sf_model *model;
    size_t count;
    int sh_degree, attributes;
    float low[3], high[3]; /* of the positions */
} gltf_out;

/* Gaussian i in glTF's axes, the quaternion of length 1. */
static sf_status take(const gltf_out *o, size_t i, sf_gaussian *g) {
    sf_gaussians f = sf_gaussian_fields(g);
    sf_status status = sf_model_get(o->model, i, 1, &f);
    if (status) return status;
    sf_gltf_turn(g, sf_model_sh_degree(o->model));
    float unit[4];
    sf_unit_quat(f.quats, unit);
    memcpy(f.quats, unit, sizeof unit);
    return SF_OK;
}

static void values_of(sf_gaussian *g, int attribute, float to[4]) {
    sf_gaussians f = sf_gaussian_fields(g);
    if (attribute == 0)
        memcpy(to, f.means, 3 * sizeof *to);
    else if (attribute == 1)
        for (int k = 0; k < 4; k++) to[k] = f.quats[(k + 1) % 4];
    else if (attribute == 2)
        for (int k = 0; k < 3; k++) to[k] = (float)exp((double)f.log_scales[k]);
    else if (attribute == 3)
        to[0] = (float)sf_sigmoid((double)f.logit_opacities[0]);
    else
        memcpy(to, f.sh + 3 * (attribute - 4), 3 * sizeof *to);
}

static sf_status find_bounds(gltf_out *o) {
    sf_gaussian g;
    for (size_t i = 0; i < o->count; i++) {
        sf_status status = take(o, i, &g);
        if (status) return status;
        const float *mean = sf_gaussian_fields(&g).means;
        for (int k = 0; k < 3; k++) {
            o->low[k] = i ? fminf(o->low[k], mean[k]) : mean[k];
            o->high[k] = i ? fmaxf(o->high[k], mean[k]) : mean[k];
        }
    }
    return SF_OK;
}

/* The JSON takes what it is given: a NULL where there is no memory makes the whole NULL. */
static json_t *accessors_of(const gltf_out *o) {
    static const char *const types[] = {"", "SCALAR", "", "VEC3", "VEC4"};
    json_t *list = json_array();
    for (int a = 0; a < o->attributes; a++)
        json_array_append_new(list, json_pack("{s:i, s:i, s:I, s:s}", "bufferView", a, "componentType",
                                              SF_GLTF_FLOAT, "count", (json_int_t)o->count, "type",
                                              types[sf_gltf_attribute_at(a).components]));
    json_t *means = json_array_get(list, 0);
    json_object_set_new(means, "min",
                        json_pack("[f, f, f]", (double)o->low[0], (double)o->low[1], (double)o->low[2]));
    json_object_set_new(means, "max",
                        json_pack("[f, f, f]", (double)o->high[0], (double)o->high[1], (double)o->high[2]));
    return list;
}

static json_int_t bytes_of(const gltf_out *o, int attribute) {
    return (json_int_t)o->count * sf_gltf_attribute_at(attribute).components * (json_int_t)sizeof(float);
}

static json_t *views_of(const gltf_out *o, json_int_t *at) {
    json_t *list = json_array();
    *at = 0;
    for (int a = 0; a < o->attributes; a++) {
        json_array_append_new(list, json_pack("{s:i, s:I, s:I, s:i}", "buffer", 0, "byteOffset", *at,
                                              "byteLength", bytes_of(o, a), "target", TARGET_ARRAY));
        *at += bytes_of(o, a);
    }
    return list;
}

static json_t *primitive_of(const gltf_out *o) {
    json_t *attributes = json_object();
    for (int a = 0; a < o->attributes; a++)
        json_object_set_new(attributes, sf_gltf_attribute_at(a).name, json_integer(a));
    return json_pack("{s:o, s:i, s:{s:{s:s, s:s, s:s, s:s}}}", "attributes", attributes, "mode", 0,
                     "extensions", SF_GLTF_EXTENSION, "kernel", "ellipse", "colorSpace",
                     "srgb_rec709_display", "projection", "perspective", "sortingMethod", "cameraDistance");
}

/* The only node; an origin is its translation, a JSON number, in glTF's axes. */
static json_t *node_of(const sf_model *model) {
    const double *o = model->origin;
    return sf_model_has_origin(model)
               ? json_pack("{s:i, s:[f, f, f]}", "mesh", 0, "translation", -o[0], -o[1], o[2])
               : json_pack("{s:i}", "mesh", 0);
}

static json_t *json_of(const gltf_out *o, json_int_t *bytes) {
    json_t *views = views_of(o, bytes);
    return json_pack("{s:{s:s, s:s}, s:[s], s:i, s:[{s:[i]}], s:[o], s:[{s:[o]}], s:[{s:I}], s:o, s:o}",
                     "asset", "version", "2.0", "generator", "splatfit " SF_VERSION, "extensionsUsed",
                     SF_GLTF_EXTENSION, "scene", 0, "scenes", "nodes", 0, "nodes", node_of(o->model),
                     "meshes", "primitives", primitive_of(o), "buffers", "byteLength", *bytes, "bufferViews",
                     views, "accessors", accessors_of(o));
}

static void put_u32(sf_writer *w, uint32_t value) {
    uint8_t bytes[4];
    for (int b = 0; b < 4; b++) bytes[b] = (uint8_t)(value >> (8 * b));
    sf_writer_put(w, bytes, sizeof bytes);
}

/* Headers and JSON; all is a multiple of 4 bytes long. */
static sf_status put_front(const gltf_out *o) {
    json_int_t bytes;
    json_t *json = json_of(o, &bytes);
    size_t digits = sf_model_has_origin(o->model) ? DOUBLE_DIGITS : FLOAT_DIGITS;
    char *text = json ? json_dumps(json, JSON_COMPACT | JSON_REAL_PRECISION(digits)) : NULL;
    json_decref(json);
    if (!text) return sf_fail(o->w->ctx, SF_ERR_MEMORY, "%s: no memory for its JSON", o->w->path);
    size_t size = strlen(text), padded = (size + 3) / 4 * 4;
    uint64_t all = SF_GLB_HEADER + 2 * SF_GLB_CHUNK + padded + (uint64_t)bytes;
    if (all <= UINT32_MAX) {
        const uint32_t header[] = {SF_GLB_MAGIC, 2, (uint32_t)all, (uint32_t)padded, SF_GLB_JSON};
        for (int k = 0; k < 5; k++) put_u32(o->w, header[k]);
        sf_writer_put(o->w, text, size);
        sf_writer_put(o->w, "   ", padded - size);
        put_u32(o->w, (uint32_t)bytes);
        put_u32(o->w, SF_GLB_BIN);
    }
    free(text);
    return all <= UINT32_MAX ? SF_OK
                             : sf_fail(o->w->ctx, SF_ERR_UNSUPPORTED,
                                       "%s: not written: %llu bytes are more than the 4 GiB of a .glb",
                                       o->w->path, (unsigned long long)all);
}

static sf_status put_attribute(const gltf_out *o, int attribute) {
    sf_gaussian g;
    int components = sf_gltf_attribute_at(attribute).components;
    for (size_t i = 0; i < o->count; i++) {
        float values[4];
        sf_status status = take(o, i, &g);
        if (status) return status;
        values_of(&g, attribute, values);
        for (int k = 0; k < components; k++) {
            uint32_t u;
            memcpy(&u, &values[k], sizeof u);
            put_u32(o->w, u);
        }
    }
    return SF_OK;
}

sf_status sf_gltf_put(sf_writer *w, const sf_model *model, int sh_degree,
                      const sf_model_file_options *options) {
    size_t length = strlen(w->path);
    (void)options;
    gltf_out o = {.w = w,
                  .model = model,
                  .count = sf_model_count(model),
                  .sh_degree = sh_degree,
                  .attributes = 4 + sf_coefficients(sh_degree)};
    if (length > 5 && !strcmp(w->path + length - 5, ".gltf"))
        return sf_fail(w->ctx, SF_ERR_UNSUPPORTED, "%s: a .gltf is read only: name it .glb to write one file",
                       w->path);
    if (!o.count)
        return sf_fail(w->ctx, SF_ERR_ARGUMENT, "%s: not written: a .glb cannot hold 0 Gaussians", w->path);
    if (sf_model_antialiased(model))
        sf_log(w->ctx, SF_LOG_WARNING,
               "%s: that it was fitted with opacity compensation is left out: glTF "
               "has no word for it",
               w->path);
    sf_status status = find_bounds(&o);
    if (!status) status = put_front(&o);
    for (int a = 0; a < o.attributes && !status; a++) status = put_attribute(&o, a);
    return status;
}
