/* ply_fixture.c - makes models and files. */
#include "ply_fixture.h"

#include <stdio.h>
#include <string.h>

#include "base/rng.h"

sf_gaussians ply_arrays_of(values *v) {
    return (sf_gaussians){v->means, v->quats, v->log_scales, v->logit_opacities, v->sh};
}

static void fill(float *to, int count, double scale, sf_rng *rng) {
    for (int i = 0; i < count; i++) to[i] = (float)(scale * sf_rng_normal(rng));
}

sf_model *ply_model_of(sf_context *ctx, values *v, size_t count, int degree) {
    sf_model *model;
    sf_gaussians g = ply_arrays_of(v);
    assert_ok(ctx, sf_model_create(ctx, count, degree, &model));
    assert_ok(ctx, sf_model_set(model, 0, count, &g));
    return model;
}

void ply_make_values(values *v, uint64_t seed) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    fill(v->means, 3 * MAX_COUNT, 10, &rng);
    fill(v->quats, 4 * MAX_COUNT, 1, &rng);
    fill(v->log_scales, 3 * MAX_COUNT, 2, &rng);
    fill(v->logit_opacities, MAX_COUNT, 4, &rng);
    fill(v->sh, 3 * MAX_K * MAX_COUNT, 0.3, &rng);
    v->means[0] = -0.0f;
    v->means[1] = 1e-42f;
    v->means[2] = 3.4028235e38f;
    v->log_scales[3] = 20;
    v->log_scales[4] = -20;
    v->sh[5] = -1e-45f;
}

sf_model *ply_make_model(sf_context *ctx, size_t count, int degree) {
    static values v;
    ply_make_values(&v, (uint64_t)degree + 1);
    return ply_model_of(ctx, &v, count, degree);
}

static void put(file *f, const void *data, size_t size) {
    assert_true(size <= sizeof f->data - f->size);
    memcpy(f->data + f->size, data, size);
    f->size += size;
}

void ply_put_text(file *f, const char *text) { put(f, text, strlen(text)); }

void ply_put_uint(file *f, uint64_t v, int size) {
    for (int i = 0; i < size; i++) {
        uint8_t byte = (uint8_t)(v >> (8 * (f->big_endian ? size - 1 - i : i)));
        put(f, &byte, 1);
    }
}

void ply_put_f32(file *f, float v) {
    uint32_t u;
    memcpy(&u, &v, sizeof u);
    ply_put_uint(f, u, 4);
}

void ply_put_f64(file *f, double v) {
    uint64_t u;
    memcpy(&u, &v, sizeof u);
    ply_put_uint(f, u, 8);
}

const char *ply_write_bytes(const void *data, size_t size) {
    const char *path = test_path("made.ply");
    remove(path);
    test_write(path, data, size);
    return path;
}

const char *ply_write_file(const file *f) { return ply_write_bytes(f->data, f->size); }

const char *ply_write_text(const char *text) { return ply_write_bytes(text, strlen(text)); }

const float ply_one_gaussian[GAUSSIAN_VALUES] = {1,  2,  3,  0.5f, 0.25f, 0.125f, -1,
                                                 -2, -3, -4, 1,    -7,    0.5f,   0};

void ply_put_one_gaussian(file *f) {
    for (int i = 0; i < GAUSSIAN_VALUES; i++) ply_put_f32(f, ply_one_gaussian[i]);
}

const char ply_ascii_file[] = "ply\nformat ascii 1.0\nelement strip 2\nproperty list uchar int indices\n"
                              "element nothing 2147483647\n"
                              "element vertex 2\n" GAUSSIAN_PROPERTIES "end_header\n"
                              "0\n2 7 8\n"
                              "1e0 2 +3.0 .5 0.25 125e-3 -1 -2 -3 -4 1 -7 0.5 0\r\n"
                              "\t 1 2 3 0.5 0.25 0.125 -1\n-2 -3 -4 1 -7 0.5 0";
