/* compressed_ply.c - Gaussians in, from the compressed .ply of PlayCanvas and SuperSplat.
 *
 * Each 256 vertices share a row of the element "chunk": the minimum and maximum of their means, log-scales
 * and colours, between which the bits of a vertex's 32-bit words interpolate. The SH bands above 0 are bytes
 * of the element "sh". Follows splat-transform 3.2.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/memory.h"
#include "model_ply.h"
#include "quantise.h"

enum { CHUNK = 256, AXES = 3, WORDS = 4 };

/* What a chunk has a minimum and a maximum of. */
enum { MEAN, LOG_SCALE, COLOR, KINDS };

typedef struct chunk {
    float min[KINDS][AXES], max[KINDS][AXES];
} chunk;

typedef struct packed {
    uint32_t position, rotation, scale, color;
} packed;

typedef struct compressed {
    sf_context *ctx;
    const char *path;
    size_t count;
    chunk *chunks;
    packed *words; /* [count] */
} compressed;

static sf_status bind_chunk(sf_ply *ply) {
    static const char *const names[KINDS][AXES] = {
        {"x", "y", "z"}, {"scale_x", "scale_y", "scale_z"}, {"r", "g", "b"}};
    int kinds = sf_ply_properties(ply, "min_r") ? KINDS : COLOR;
    sf_status status = SF_OK;
    for (int i = 0; i < kinds * AXES && !status; i++) {
        char name[16];
        snprintf(name, sizeof name, "min_%s", names[i / AXES][i % AXES]);
        status = sf_ply_bind(ply, name, i);
        snprintf(name, sizeof name, "max_%s", names[i / AXES][i % AXES]);
        if (!status) status = sf_ply_bind(ply, name, KINDS * AXES + i);
    }
    return status;
}

/* In older files, whose chunks have no colours, these are between 0 and 1. */
static sf_status read_chunks(compressed *c, sf_ply *ply) {
    size_t needed = c->count / CHUNK + (c->count % CHUNK != 0);
    sf_status status = sf_ply_enter(ply, "chunk");
    if (status) return status;
    if (sf_ply_rows(ply) != needed)
        return sf_fail(c->ctx, SF_ERR_FORMAT, "%s: element chunk: %zu rows, not %zu for %zu vertices",
                       c->path, sf_ply_rows(ply), needed, c->count);
    c->chunks = sf_calloc(c->ctx, needed, sizeof *c->chunks);
    if (!c->chunks) return SF_ERR_MEMORY;
    status = bind_chunk(ply);
    for (size_t i = 0; i < needed && !status; i++) {
        float limits[2 * KINDS * AXES] = {0};
        for (int k = 0; k < AXES; k++) limits[KINDS * AXES + COLOR * AXES + k] = 1;
        status = sf_ply_next(ply, limits);
        memcpy(c->chunks[i].min, limits, sizeof c->chunks[i].min);
        memcpy(c->chunks[i].max, limits + KINDS * AXES, sizeof c->chunks[i].max);
    }
    return status;
}

static sf_status read_words(compressed *c, sf_ply *ply) {
    static const char *const names[WORDS] = {"packed_position", "packed_rotation", "packed_scale",
                                             "packed_color"};
    sf_status status = sf_ply_enter(ply, "vertex");
    if (!status) status = sf_memory_check(c->ctx, c->path, "packed vertices", c->count * sizeof *c->words);
    if (status) return status;
    c->words = sf_alloc(c->ctx, c->count, sizeof *c->words);
    if (!c->words) return SF_ERR_MEMORY;
    for (int i = 0; i < WORDS && !status; i++) status = sf_ply_bind(ply, names[i], i);
    for (size_t i = 0; i < c->count && !status; i++) {
        uint32_t w[WORDS];
        status = sf_ply_next_words(ply, w);
        if (!status) c->words[i] = (packed){w[0], w[1], w[2], w[3]};
    }
    return status;
}

/* The unsigned number in some bits of a word, divided by the largest that they hold. */
static double part(uint32_t word, int from, int bits) {
    uint32_t most = (1u << bits) - 1;
    return (double)(word >> from & most) / most;
}

static float between(const chunk *c, int kind, int axis, double t) {
    return (float)((double)c->min[kind][axis] * (1 - t) + (double)c->max[kind][axis] * t);
}

static void unpack_vector(const chunk *c, int kind, uint32_t word, float to[3]) {
    to[0] = between(c, kind, 0, part(word, 21, 11));
    to[1] = between(c, kind, 1, part(word, 11, 10));
    to[2] = between(c, kind, 2, part(word, 0, 11));
}

/* The two highest bits say which of w, x, y, z is the largest; it follows from the three others, which lie
 * within 1 / sqrt(2) of 0. */
static void unpack_rotation(uint32_t word, float quat[4]) {
    unsigned largest = word >> 30;
    double sum = 0;
    int from = 20;
    for (unsigned k = 0; k < 4; k++) {
        if (k == largest) continue;
        double v = (part(word, from, 10) - 0.5) * sqrt(2);
        quat[k] = (float)v;
        sum += v * v;
        from -= 10;
    }
    quat[largest] = (float)sqrt(fmax(0, 1 - sum));
}

static void unpack_color(const chunk *c, uint32_t word, const sf_gaussians *to) {
    const double band_0 = 0.28209479177387814;
    for (int k = 0; k < 3; k++)
        to->sh[k] = (float)(((double)between(c, COLOR, k, part(word, 24 - 8 * k, 8)) - 0.5) / band_0);
    to->logit_opacities[0] = sf_logit_of_byte((uint8_t)word);
}

/* A byte counts 256 equal parts of -4..4 and stands for the middle of its part; 0 and 255 are -4 and 4. */
static float unpack_sh(float byte) {
    float part = byte <= 0 ? 0 : byte >= 255 ? 1 : (byte + 0.5f) / 256;
    return 8 * (part - 0.5f);
}

static sf_status enter_sh(compressed *c, sf_ply *ply, const sf_model_file_options *options, int *degree) {
    int file_degree;
    *degree = 0;
    if (!sf_ply_has(ply, "sh")) return SF_OK;
    sf_status status = sf_ply_enter(ply, "sh");
    if (!status && sf_ply_rows(ply) != c->count)
        status = sf_fail(c->ctx, SF_ERR_FORMAT, "%s: element sh: %zu rows, not %zu as of vertices", c->path,
                         sf_ply_rows(ply), c->count);
    if (!status) status = sf_ply_find_degree(c->ctx, c->path, ply, &file_degree);
    if (!status) *degree = sf_file_degree(c->ctx, c->path, file_degree, options);
    return status ? status : sf_ply_bind_values(ply, "f_rest_", file_degree, *degree);
}

static sf_status put_all(const compressed *c, sf_ply *ply, int degree, sf_model_builder *in) {
    sf_gaussian g;
    sf_gaussians fields = sf_gaussian_fields(&g);
    sf_status status = SF_OK;
    for (size_t i = 0; i < c->count && !status; i++) {
        const chunk *limits = &c->chunks[i / CHUNK];
        if (degree) status = sf_ply_next(ply, g.values);
        for (int k = 3; k < 3 * sf_coefficients(degree); k++) fields.sh[k] = unpack_sh(fields.sh[k]);
        unpack_vector(limits, MEAN, c->words[i].position, fields.means);
        unpack_vector(limits, LOG_SCALE, c->words[i].scale, fields.log_scales);
        unpack_rotation(c->words[i].rotation, fields.quats);
        unpack_color(limits, c->words[i].color, &fields);
        if (!status) status = sf_model_builder_put(in, &g);
    }
    return status;
}

static sf_status load(compressed *c, sf_ply *ply, const sf_model_file_options *options,
                      sf_model_builder *in) {
    int degree;
    sf_status status = read_chunks(c, ply);
    if (!status) status = read_words(c, ply);
    if (!status) status = enter_sh(c, ply, options, &degree);
    if (!status) status = sf_model_builder_begin(in, c->ctx, c->path, c->count, degree, options);
    return status ? status : put_all(c, ply, degree, in);
}

sf_status sf_compressed_ply_load(sf_context *ctx, const char *path, sf_ply *ply,
                                 const sf_model_file_options *options, sf_model **model) {
    compressed c = {.ctx = ctx, .path = path, .count = sf_ply_rows(ply)};
    sf_model_builder in = {0};
    sf_status status = load(&c, ply, options, &in);
    sf_free(ctx, c.chunks);
    sf_free(ctx, c.words);
    return sf_ply_end_builder(ply, &in, status, model);
}
