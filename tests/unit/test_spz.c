/* test_spz.c - Gaussians to .spz and back: bytes by hand, errors within the format's steps, hostile files. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/rng.h"
#include "scene/gaussian_math.h"

enum { MAX_COUNT = 64, MAX_K = 16, HEADER = 16, MAX_FILE = 1 << 16 };

typedef struct values {
    float means[3 * MAX_COUNT], quats[4 * MAX_COUNT], log_scales[3 * MAX_COUNT], logit_opacities[MAX_COUNT];
    float sh[3 * MAX_K * MAX_COUNT];
} values;

static sf_gaussians arrays_of(values *v) {
    return (sf_gaussians){v->means, v->quats, v->log_scales, v->logit_opacities, v->sh};
}

static sf_model *model_of(sf_context *ctx, values *v, size_t count, int degree) {
    sf_model *model;
    sf_gaussians g = arrays_of(v);
    assert_ok(ctx, sf_model_create(ctx, count, degree, &model));
    assert_ok(ctx, sf_model_set(model, 0, count, &g));
    return model;
}

static float within(sf_rng *rng, double least, double most) {
    return (float)(least + (most - least) * sf_rng_uniform(rng));
}

/* What the format can hold; x rises with the number, by which the tests find a Gaussian again. */
static void make_values(values *v, int count, int coefficients, uint64_t seed) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    for (int i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) v->means[3 * i + k] = within(&rng, -4, 4);
        v->means[3 * i] = (float)i / 8;
        for (int k = 0; k < 4; k++) v->quats[4 * i + k] = (float)sf_rng_normal(&rng);
        for (int k = 0; k < 3; k++) v->log_scales[3 * i + k] = within(&rng, -9.9, 5.9);
        v->logit_opacities[i] = within(&rng, -5, 5);
        for (int k = 0; k < 3 * coefficients; k++)
            v->sh[3 * coefficients * i + k] = within(&rng, -0.96, 0.96);
    }
}

/* A file as it is before gzip. */
typedef struct file {
    size_t size;
    uint8_t data[MAX_FILE];
} file;

static void put(file *f, const void *data, size_t size) {
    assert_true(size <= sizeof f->data - f->size);
    memcpy(f->data + f->size, data, size);
    f->size += size;
}

static void put_uint(file *f, uint64_t value, int bytes) {
    for (int b = 0; b < bytes; b++) put(f, &(uint8_t){(uint8_t)(value >> (8 * b))}, 1);
}

static void put_header(file *f, uint32_t version, uint32_t count, int degree, int fraction, int flags) {
    *f = (file){0};
    put(f, "NGSP", 4);
    put_uint(f, version, 4);
    put_uint(f, count, 4);
    put_uint(f, (uint64_t)degree, 1);
    put_uint(f, (uint64_t)fraction, 1);
    put_uint(f, (uint64_t)flags, 1);
    put_uint(f, 0, 1);
}

/* Packs `size` bytes by gzip; returns how many it takes. */
static size_t gzip(const uint8_t *data, size_t size, uint8_t *to, size_t room) {
    z_stream z = {
        .next_in = (Bytef *)(uintptr_t)data, .avail_in = (uInt)size, .next_out = to, .avail_out = (uInt)room};
    assert_int_equal(deflateInit2(&z, 9, Z_DEFLATED, 31, 9, Z_DEFAULT_STRATEGY), Z_OK);
    assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
    deflateEnd(&z);
    return room - z.avail_out;
}

static const char *write_plain(const void *data, size_t size) {
    const char *path = test_path("made.spz");
    remove(path);
    test_write(path, data, size);
    return path;
}

static const char *write_gzip(const file *f) {
    static uint8_t packed[2 * MAX_FILE];
    return write_plain(packed, gzip(f->data, f->size, packed, sizeof packed));
}

/* What a file of the library unpacks to. */
static file unpacked(const char *path) {
    size_t size;
    uint8_t *data = test_read(path, &size);
    file f = {0};
    z_stream z = {.next_in = data, .avail_in = (uInt)size, .next_out = f.data, .avail_out = sizeof f.data};
    assert_int_equal(inflateInit2(&z, 31), Z_OK);
    assert_int_equal(inflate(&z, Z_FINISH), Z_STREAM_END);
    f.size = sizeof f.data - z.avail_out;
    inflateEnd(&z);
    free(data);
    return f;
}

static void assert_refused(sf_context *ctx, const char *path, sf_status expected, const char *part) {
    sf_model *model = (sf_model *)ctx;
    assert_status(ctx, sf_model_load(ctx, path, &model), expected);
    assert_null(model);
    assert_error_names(ctx, path);
    assert_error_names(ctx, part);
    assert_null(strchr(sf_last_error(ctx), '\n'));
}

/* ---- What is written ---- */

/* Two Gaussians of degree 1, with the bytes that the format's text asks for worked out by hand. They are at
 * 0 and 1 of x, in this order along the curve; scales of 1 and means below 2 take 4 fractional bits
 * (12 steps of the median middle axis of 1, up to a power of two). */
static void test_bytes(void **state) {
    (void)state;
    static values v = {
        .means = {0, -0.5f, 1.25f, 1, 1, 1.5f},
        .quats = {0.5f, 0.5f, -0.5f, 0.5f, 0, 0, 0, -2},
        .log_scales = {0, 0, 0, -10, 5.9375f, 0},
        .logit_opacities = {0, 20},
        .sh = {0, 1, -1, 0.125f, -0.25f, 0.5f, 0, 0, 0, 0.0625f, 0.03f, -0.0625f, 3.3333333f, -3.3333333f,
               0.2f},
    };
    static const uint8_t expected[] = {
        'N', 'G', 'S', 'P', 3, 0, 0, 0, 2, 0, 0, 0, 1, 4, 1, 0,
        /* means: 0 -8 20, 16 16 24 of sixteenths */
        0, 0, 0, 0xf8, 0xff, 0xff, 20, 0, 0, 16, 0, 0, 16, 0, 0, 24, 0, 0,
        /* alphas */
        128, 255,
        /* colours: 127.5 + 38.25 f_dc */
        128, 166, 89, 255, 0, 135,
        /* scales: 16 (s + 10) */
        160, 160, 160, 0, 255, 160,
        /* rotations: x is the first of the largest (index 0), positive: y -.5, z .5, w .5; 511 sqrt(2) / 2 =
         * 361.3, the nearest multiple of 4 is 360: 1 101101000, 0 101101000, 0 101101000. The other one is z
         * alone. */
        0x68, 0xa1, 0x85, 0x36, 0, 0, 0, 0x80,
        /* SH at 5 bits: steps of 8 around 128 */
        144, 96, 192, 128, 128, 128, 136, 128, 120, 128, 128, 128, 128, 128, 128, 128, 128, 128};
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, &v, 2, 1);
    sf_model_set_antialiased(model, 1);
    sf_model_file_options options = sf_model_file_options_default();
    options.sh_bits[0] = 5;
    options.sh_bits[1] = 4;
    const char *path = test_path("bytes.spz");
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    file f = unpacked(path);
    assert_int_equal(f.size, sizeof expected);
    for (size_t i = 0; i < sizeof expected; i++)
        if (f.data[i] != expected[i]) fail_msg("byte %zu is %d, not %d", i, f.data[i], expected[i]);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void assert_near(const char *what, double got, double expected, double bound) {
    if (!(fabs(got - expected) <= bound)) fail_msg("%s is %g, not %g within %g", what, got, expected, bound);
}

/* 1 - |q.p| of unit quaternions bounds how far two rotations are apart. */
static void assert_same_rotation(const float *a, const float *b, double bound) {
    double dot = 0, aa = 0, bb = 0;
    for (int k = 0; k < 4; k++) {
        dot += (double)a[k] * (double)b[k];
        aa += (double)a[k] * (double)a[k];
        bb += (double)b[k] * (double)b[k];
    }
    assert_near("the rotation's cosine", fabs(dot) / sqrt(aa * bb), 1, bound);
}

/* Every field comes back within half a step of the format. `sh_steps` of band 1 and of those above. */
static void assert_within_steps(const values *was, const values *is, int count, int coefficients,
                                double mean_step, const double sh_steps[2]) {
    const double rounding = 1e-5;
    /* Three components each within half of 4 / 511 sqrt(1/2): the largest follows, with at most as much
     * times 3. */
    double rotation = 4 / 511.0 * sqrt(0.5) / 2;
    for (int j = 0; j < count; j++) {
        int i = (int)lround(8 * (double)is->means[3 * j]);
        assert_true(i >= 0 && i < count);
        for (int k = 0; k < 3; k++) {
            assert_near("mean", (double)is->means[3 * j + k], (double)was->means[3 * i + k],
                        mean_step / 2 + rounding);
            assert_near("log-scale", (double)is->log_scales[3 * j + k], (double)was->log_scales[3 * i + k],
                        1 / 32.0 + rounding);
        }
        assert_same_rotation(is->quats + 4 * j, was->quats + 4 * i, 6 * rotation * rotation + rounding);
        assert_near("opacity", sf_sigmoid((double)is->logit_opacities[j]),
                    sf_sigmoid((double)was->logit_opacities[i]), 0.5 / 255 + rounding);
        for (int k = 0; k < 3 * coefficients; k++) {
            double step = k < 3 ? 1 / 255.0 / 0.15 : sh_steps[k >= 12];
            assert_near("SH", (double)is->sh[3 * coefficients * j + k],
                        (double)was->sh[3 * coefficients * i + k], step / 2 + rounding);
        }
    }
}

static void round_trip(sf_context *ctx, int degree, sf_spz_frame frame) {
    static values was, is;
    int k = (degree + 1) * (degree + 1);
    sf_model_file_options options = sf_model_file_options_default();
    options.sh_bits[0] = 6;
    options.sh_bits[1] = 5;
    options.spz_frame = frame;
    make_values(&was, MAX_COUNT, k, (uint64_t)degree + 1);
    sf_model *model = model_of(ctx, &was, MAX_COUNT, degree), *again;
    const char *path = test_path("round.spz");
    test_log_clear();
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    assert_string_equal(test_log, "");
    assert_ok(ctx, sf_model_load_as(ctx, path, &options, &again));
    assert_int_equal(sf_model_count(again), MAX_COUNT);
    assert_int_equal(sf_model_sh_degree(again), degree);
    assert_int_equal(sf_model_antialiased(again), 0);
    sf_gaussians g = arrays_of(&is);
    assert_ok(ctx, sf_model_get(again, 0, MAX_COUNT, &g));
    double mean_step = ldexp(1, -unpacked(path).data[13]);
    assert_within_steps(&was, &is, MAX_COUNT, k, mean_step, (double[]){1 / 32.0, 1 / 16.0});
    sf_model_destroy(&again);
    sf_model_destroy(&model);
}

static void test_round_trip(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree++)
        for (int frame = SF_SPZ_FRAME_OWN; frame <= SF_SPZ_FRAME_RUB; frame++)
            round_trip(ctx, degree, (sf_spz_frame)frame);
    sf_context_destroy(&ctx);
}

/* A half turn about x changes what is stored, and nothing of what a camera that turned with it sees. */
static void test_frame(void **state) {
    (void)state;
    static values v;
    enum { SIDE = 32 };
    static float before[3 * SIDE * SIDE], after[3 * SIDE * SIDE];
    sf_context *ctx = test_context();
    sf_renderer *renderer;
    sf_quality q;
    make_values(&v, MAX_COUNT, 16, 3);
    for (int i = 0; i < MAX_COUNT; i++) {
        v.means[3 * i] = v.means[3 * i] / 4 - 1, v.means[3 * i + 2] += 8;
        for (int k = 0; k < 3; k++) v.log_scales[3 * i + k] = -1 - (float)k;
    }
    sf_model *model = model_of(ctx, &v, MAX_COUNT, 3), *turned, *kept;
    sf_model_file_options options = sf_model_file_options_default();
    options.sh_bits[0] = options.sh_bits[1] = 8;
    const char *path = test_path("frame.spz");
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    assert_ok(ctx, sf_model_load_as(ctx, path, &options, &kept));
    options.spz_frame = SF_SPZ_FRAME_RUB;
    assert_ok(ctx, sf_model_load_as(ctx, path, &options, &turned));
    const sf_camera camera = {SIDE,     SIDE, SIDE, SIDE, SIDE / 2.0, SIDE / 2.0, {1, 0, 0, 0, 1, 0, 0, 0, 1},
                              {0, 0, 0}};
    sf_camera other = camera;
    other.R_cw[4] = other.R_cw[8] = -1;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_render(renderer, kept, &camera, NULL, &(sf_image_out){.rgb = before}));
    for (int i = 0; i < 3 * SIDE * SIDE; i++) before[i] = fminf(before[i], 1); /* as a picture */
    assert_ok(ctx, sf_render(renderer, turned, &other, NULL, &(sf_image_out){.rgb = after}));
    assert_ok(ctx, sf_compare(renderer, SIDE, SIDE, after, before, NULL, &q));
    assert_true(q.psnr > 90);
    assert_ok(ctx, sf_render(renderer, turned, &camera, NULL, &(sf_image_out){.rgb = after}));
    assert_ok(ctx, sf_compare(renderer, SIDE, SIDE, after, before, NULL, &q));
    assert_true(q.psnr < 30); /* and it was turned */
    sf_renderer_destroy(&renderer);
    sf_model_destroy(&kept);
    sf_model_destroy(&turned);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Without sh_bits heavier Gaussians keep more: errors fall with the weight. */
static void test_bits_by_weight(void **state) {
    (void)state;
    static values v, w;
    sf_context *ctx = test_context();
    make_values(&v, MAX_COUNT, 16, 9);
    for (int i = 0; i < MAX_COUNT; i++) {
        v.logit_opacities[i] = i < MAX_COUNT / 2 ? 4 : -4;
        for (int k = 0; k < 3; k++) v.log_scales[3 * i + k] = i < MAX_COUNT / 2 ? -2 : -5;
    }
    sf_model *model = model_of(ctx, &v, MAX_COUNT, 3), *again;
    const char *path = test_path("weight.spz");
    assert_ok(ctx, sf_model_save(model, path));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    sf_gaussians g = arrays_of(&w);
    assert_ok(ctx, sf_model_get(again, 0, MAX_COUNT, &g));
    double error[2] = {0, 0};
    for (int j = 0; j < MAX_COUNT; j++) {
        int i = (int)lround(8 * (double)w.means[3 * j]);
        for (int k = 12; k < 48; k++)
            error[i < MAX_COUNT / 2] += fabs((double)w.sh[48 * j + k] - (double)v.sh[48 * i + k]);
    }
    assert_true(error[1] > 0);
    assert_true(error[0] > 4 * error[1]);
    sf_model_destroy(&again);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Beyond the format: moved to its edge, counted and said. */
static void test_clips(void **state) {
    (void)state;
    static values v, w;
    sf_context *ctx = test_context();
    make_values(&v, 4, 4, 5);
    v.log_scales[3] = -15;
    v.log_scales[4] = 12;
    v.sh[12 * 2] = 9;
    v.sh[12 * 2 + 5] = -3;
    v.means[3 * 3 + 1] = 1e9f;
    sf_model *model = model_of(ctx, &v, 4, 1), *again;
    const char *path = test_path("clips.spz");
    test_log_clear();
    assert_ok(ctx, sf_model_save(model, path));
    assert_non_null(strstr(test_log, "clips.spz: 1 coordinates"));
    assert_non_null(strstr(test_log, "2 log-scales"));
    assert_non_null(strstr(test_log, "1 values f_dc"));
    assert_non_null(strstr(test_log, "1 values of higher SH bands"));
    assert_non_null(strstr(test_log, "coordinates of up to 1e+09 leave steps of 1 to the means"));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    sf_gaussians g = arrays_of(&w);
    assert_ok(ctx, sf_model_get(again, 0, 4, &g));
    float least = 0, most = 0, furthest = 0;
    for (int i = 0; i < 12; i++) {
        least = fminf(least, w.log_scales[i]);
        most = fmaxf(most, w.log_scales[i]);
        furthest = fmaxf(furthest, w.means[i]);
    }
    assert_true(least == -10);
    assert_true(most == 5.9375f);
    assert_true(furthest == (1 << 23) - 1);
    sf_model_destroy(&again);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_options(void **state) {
    (void)state;
    static values v;
    sf_context *ctx = test_context();
    make_values(&v, 3, 16, 5);
    sf_model *model = model_of(ctx, &v, 3, 3), *again;
    const char *path = test_path("options.spz");
    sf_model_file_options options = sf_model_file_options_default();
    options.sh_degree = 1;
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    assert_int_equal(sf_model_sh_degree(again), 1);
    sf_model_destroy(&again);
    options.sh_degree = 0;
    assert_ok(ctx, sf_model_load_as(ctx, path, &options, &again));
    assert_int_equal(sf_model_sh_degree(again), 0);
    sf_model_destroy(&again);
    static const struct {
        sf_model_file_options o;
        const char *part;
    } wrong[] = {
        {{.sh_degree = 4}, "sh_degree: 4"},
        {{.sh_degree = -1, .sh_bits = {9, 4}}, "sh_bits: 9"},
        {{.sh_degree = -1, .sh_bits = {0, 4}}, "sh_bits: 0 and 4"},
        {{.sh_degree = -1, .spz_frame = (sf_spz_frame)2}, "spz_frame: 2"},
        {{.sh_degree = -1, .format = (sf_model_format)99}, "format: 99"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_status(ctx, sf_model_save_as(model, path, &wrong[i].o), SF_ERR_ARGUMENT);
        assert_error_names(ctx, wrong[i].part);
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_empty_model(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model, *again;
    const char *path = test_path("none.spz");
    assert_ok(ctx, sf_model_create(ctx, 0, 2, &model));
    assert_ok(ctx, sf_model_save(model, path));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    assert_int_equal(sf_model_count(again), 0);
    assert_int_equal(sf_model_sh_degree(again), 2);
    sf_model_destroy(&again);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* ---- What is read ---- */

/* One Gaussian of degree 0, by hand, in each version. */
static void put_columns(file *f, int version) {
    if (version == 1) {
        put_uint(f, 0x3c00, 2), put_uint(f, 0xc100, 2), put_uint(f, 0x0001, 2); /* halves: 1, -2.5, 2^-24 */
    } else {
        put_uint(f, 256, 3), put_uint(f, 0xfffd80, 3), put_uint(f, 0, 3); /* 1, -2.5 at 8 bits */
    }
    put_uint(f, 51, 1);                                          /* alpha: 0.2 */
    put_uint(f, 0, 1), put_uint(f, 255, 1), put_uint(f, 153, 1); /* colours */
    put_uint(f, 0, 1), put_uint(f, 160, 1), put_uint(f, 255, 1); /* scales: -10, 0, 5.9375 */
    if (version < 3)
        put_uint(f, 255, 1), put_uint(f, 0, 1), put_uint(f, 0, 1); /* x 1, y -1, z -1: w 0 */
    else
        put_uint(f, 0xc0000000u | 1u << 29 | 511u << 20, 4); /* w the largest, x -sqrt(1/2) */
}

static void check_version(sf_context *ctx, int version) {
    file f;
    sf_model *model;
    float mean[3], quat[4], scale[3], logit, sh[3];
    put_header(&f, (uint32_t)version, 1, 0, 8, version == 3);
    put_columns(&f, version);
    assert_ok(ctx, sf_model_load(ctx, write_gzip(&f), &model));
    assert_int_equal(sf_model_count(model), 1);
    assert_int_equal(sf_model_antialiased(model), version == 3);
    assert_ok(ctx, sf_model_get(model, 0, 1, &(sf_gaussians){mean, quat, scale, &logit, sh}));
    assert_true(mean[0] == 1 && mean[1] == -2.5f && mean[2] == (version == 1 ? ldexpf(1, -24) : 0));
    assert_near("opacity", sf_sigmoid((double)logit), 0.2, 1e-6);
    assert_near("red", (double)sh[0], -0.5 / 0.15, 1e-6);
    assert_near("green", (double)sh[1], 0.5 / 0.15, 1e-6);
    assert_near("blue", (double)sh[2], 0.1 / 0.15, 1e-6);
    assert_true(scale[0] == -10 && scale[1] == 0 && scale[2] == 5.9375f);
    if (version < 3)
        assert_true(quat[0] == 0 && quat[1] == 1 && quat[2] == -1 && quat[3] == -1);
    else
        assert_same_rotation(quat, (float[]){1, -1, 0, 0}, 1e-6);
    sf_model_destroy(&model);
}

static void test_versions(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int version = 1; version <= 3; version++) check_version(ctx, version);
    sf_context_destroy(&ctx);
}

/* A frame of zstd with its bytes as they are: no library is needed to write it. */
static void put_zstd(file *f, const uint8_t *data, size_t size) {
    put_uint(f, 0xfd2fb528, 4);
    put_uint(f, 0x20, 1), put_uint(f, size, 1); /* one segment, its size in a byte */
    put_uint(f, size << 3 | 1, 3);              /* the last block, raw */
    put(f, data, size);
}

/* Version 4 of put_columns; `extension` bytes before the table. */
static void put_version_4(file *f, size_t extension) {
    static const size_t widths[] = {9, 1, 3, 3, 4};
    file columns = {0}, streams[5];
    put_columns(&columns, 3);
    put_header(f, 4, 1, 0, 8, extension ? 2 : 0);
    f->data[15] = 5;
    put_uint(f, 32 + extension, 4);
    put_uint(f, 0, 8), put_uint(f, 0, 4);
    for (size_t i = 0; i < extension; i++) put_uint(f, 7, 1);
    size_t at = 0;
    for (int i = 0; i < 5; at += widths[i++]) {
        streams[i] = (file){0};
        put_zstd(&streams[i], columns.data + at, widths[i]);
        put_uint(f, streams[i].size, 8), put_uint(f, widths[i], 8);
    }
    for (int i = 0; i < 5; i++) put(f, streams[i].data, streams[i].size);
}

/* An extension of another kind, then the one that says which axes there are. */
static void put_axes(file *f, uint32_t axes) {
    put_uint(f, 0xadbe0002, 4), put_uint(f, 2, 4), put_uint(f, 0, 2);
    put_uint(f, 0xadbe0003, 4), put_uint(f, 4, 4), put_uint(f, axes, 4);
}

/* Each number of a coordinate system and which of the axes differ from a model's right, down, front. */
static void test_axes_of_the_extension(void **state) {
    (void)state;
    static const float signs[9][3] = {{1, 1, 1},  {-1, 1, -1}, {1, 1, -1},  {-1, -1, -1}, {1, -1, -1},
                                      {-1, 1, 1}, {1, 1, 1},   {-1, -1, 1}, {1, -1, 1}};
    sf_context *ctx = test_context();
    static file f;
    float plain[3] = {0}, mean[3];
    for (uint32_t axes = 0; axes <= 8; axes++) {
        sf_model *model;
        put_header(&f, 3, 1, 0, 8, 2);
        put_columns(&f, 3);
        f.data[HEADER + 7] = 3; /* z: 3 */
        put_axes(&f, axes);
        test_log_clear();
        assert_ok(ctx, sf_model_load(ctx, write_gzip(&f), &model));
        assert_non_null(strstr(test_log, "extensions ignored: 10 bytes"));
        assert_ok(ctx, sf_model_get(model, 0, 1, &(sf_gaussians){.means = mean}));
        if (!axes) memcpy(plain, mean, sizeof plain);
        for (int k = 0; k < 3; k++) assert_true(plain[k] != 0 && mean[k] == signs[axes][k] * plain[k]);
        sf_model_destroy(&model);
    }
    for (uint32_t axes = 9; axes <= 17; axes += 8) {
        put_header(&f, 3, 1, 0, 8, 2);
        put_columns(&f, 3);
        put_axes(&f, axes);
        assert_refused(ctx, write_gzip(&f), axes > 16 ? SF_ERR_FORMAT : SF_ERR_UNSUPPORTED, "axes: ");
    }
    sf_context_destroy(&ctx);
}

static void test_version_4(void **state) {
    (void)state;
    static file f;
    sf_context *ctx = test_context();
    put_version_4(&f, 0);
#ifndef SF_HAVE_ZSTD
    assert_refused(ctx, write_plain(f.data, f.size), SF_ERR_UNSUPPORTED, "zstd");
#else
    for (size_t extension = 0; extension < 20; extension += 12) {
        sf_model *model;
        float mean[3], scale[3];
        put_version_4(&f, extension);
        test_log_clear();
        assert_ok(ctx, sf_model_load(ctx, write_plain(f.data, f.size), &model));
        assert_int_equal(strstr(test_log, "extensions ignored: 12 bytes") != NULL, extension != 0);
        assert_ok(ctx, sf_model_get(model, 0, 1, &(sf_gaussians){.means = mean, .log_scales = scale}));
        assert_true(mean[0] == 1 && mean[1] == -2.5f && scale[2] == 5.9375f);
        sf_model_destroy(&model);
    }
    file axes = {0}; /* right, up, back: a model's y and z negated */
    put_uint(&axes, 0xadbe0003, 4), put_uint(&axes, 4, 4), put_uint(&axes, 4, 4);
    put_version_4(&f, 12);
    memcpy(f.data + 32, axes.data, axes.size);
    sf_model *turned;
    float mean[3];
    assert_ok(ctx, sf_model_load(ctx, write_plain(f.data, f.size), &turned));
    assert_ok(ctx, sf_model_get(turned, 0, 1, &(sf_gaussians){.means = mean}));
    assert_true(mean[0] == 1 && mean[1] == 2.5f);
    sf_model_destroy(&turned);
    put_version_4(&f, 0);
    for (size_t cut = 0; cut < f.size; cut++)
        assert_refused(ctx, write_plain(f.data, cut), SF_ERR_FORMAT, "");
    f.data[15] = 6;
    assert_refused(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "streams: 6");
    put_version_4(&f, 0);
    f.data[8] = 2; /* Gaussians */
    assert_refused(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "stream 0: 9 bytes, not the 18");
    put_version_4(&f, 0);
    f.data[f.size - 1 - 4 - 3]++; /* the size of the last block */
    assert_refused(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "stream 4: zstd");
    put_version_4(&f, 0);
    f.data[11] = 0x70; /* a count of which the table knows nothing */
    assert_refused(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "stream 0");
#endif
    sf_context_destroy(&ctx);
}

static void test_band_4_is_left_out(void **state) {
    (void)state;
    static file f;
    float sh[48];
    sf_model *model;
    sf_context *ctx = test_context();
    put_header(&f, 3, 1, 4, 8, 0);
    put_columns(&f, 3);
    for (int i = 0; i < 72; i++) put_uint(&f, (uint64_t)(128 + i), 1);
    test_log_clear();
    assert_ok(ctx, sf_model_load(ctx, write_gzip(&f), &model));
    assert_non_null(strstr(test_log, "band 4 of the SH is left out"));
    assert_int_equal(sf_model_sh_degree(model), 3);
    assert_ok(ctx, sf_model_get(model, 0, 1, &(sf_gaussians){.sh = sh}));
    for (int i = 0; i < 45; i++) assert_true(sh[3 + i] == (float)i / 128);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* ---- Hostile files ---- */

static void test_refuses_headers(void **state) {
    (void)state;
    static file f;
    static const struct {
        uint32_t version, count;
        int degree, fraction;
        sf_status status;
        const char *part;
    } cases[] = {
        {9, 1, 0, 8, SF_ERR_UNSUPPORTED, "version: 9"},
        {0, 1, 0, 8, SF_ERR_UNSUPPORTED, "version: 0"},
        {4, 1, 0, 8, SF_ERR_FORMAT, "version: 4 in a stream of gzip"},
        {3, 1, 7, 8, SF_ERR_FORMAT, "SH degree: 7"},
        {3, 1, 0, 31, SF_ERR_FORMAT, "fractional bits: 31"},
        {3, 0xffffffff, 0, 8, SF_ERR_UNSUPPORTED, "count: 4294967295"},
        {3, 0x7fffff00, 3, 8, SF_ERR_FORMAT, "truncated"},
        {3, 2, 0, 8, SF_ERR_FORMAT, "truncated: 20 of the 40 bytes of its 2 Gaussians"},
    };
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        put_header(&f, cases[i].version, cases[i].count, cases[i].degree, cases[i].fraction, 0);
        put_columns(&f, 3);
        assert_refused(ctx, write_gzip(&f), cases[i].status, cases[i].part);
    }
    put_header(&f, 3, 1, 0, 8, 0);
    f.data[0] = 'M';
    assert_refused(ctx, write_gzip(&f), SF_ERR_FORMAT, "NGSP");
    put_header(&f, 3, 1, 0, 8, 0);
    put_columns(&f, 3);
    assert_refused(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "version: 3 without gzip");
    assert_refused(ctx, write_plain("nothing", 7), SF_ERR_FORMAT, "not a .spz file");
    assert_refused(ctx, write_plain("", 0), SF_ERR_FORMAT, "not a .spz file");
    assert_refused(ctx, test_path("absent.spz"), SF_ERR_IO, "absent.spz");
    sf_context_destroy(&ctx);
}

/* A file of a few kilobytes that unpacks to many megabytes stops where its Gaussians end. */
static void test_bomb(void **state) {
    (void)state;
    enum { BOMB = 16 << 20, ROOM = 1 << 16 };
    static file f;
    static uint8_t packed[ROOM];
    sf_context *ctx = test_context();
    uint8_t *zeros = calloc(BOMB, 1);
    assert_non_null(zeros);
    for (int flags = 0; flags <= 2; flags += 2) {
        put_header(&f, 3, 1, 0, 8, flags);
        put_columns(&f, 3);
        memcpy(zeros, f.data, f.size);
        size_t size = gzip(zeros, BOMB, packed, sizeof packed);
        assert_refused(ctx, write_plain(packed, size), SF_ERR_FORMAT, "unpacks to more than the 20 bytes");
    }
    free(zeros);
    put(&f, "extensions", 10);
    sf_model *model;
    test_log_clear();
    assert_ok(ctx, sf_model_load(ctx, write_gzip(&f), &model));
    assert_non_null(strstr(test_log, "extensions ignored: 10 bytes"));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Every proper beginning of a file is an error, and a changed byte gives a model or an error. */
static void test_cut_and_changed(void **state) {
    (void)state;
    static values v;
    sf_context *ctx = test_context();
    make_values(&v, 3, 4, 1);
    sf_model *model = model_of(ctx, &v, 3, 1);
    const char *path = test_path("whole.spz");
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    size_t size;
    uint8_t *data = test_read(path, &size);
    for (size_t cut = 0; cut < size; cut++) assert_refused(ctx, write_plain(data, cut), SF_ERR_FORMAT, "");
    for (size_t at = 0; at < size; at++) {
        data[at] ^= 0x55;
        sf_status status = sf_model_load(ctx, write_plain(data, size), &model);
        assert_int_equal(status == SF_OK, model != NULL);
        sf_model_destroy(&model);
        data[at] ^= 0x55;
    }
    free(data);
    sf_context_destroy(&ctx);
}

/* With any allocation refused nothing is left behind. */
static void test_no_memory(void **state) {
    (void)state;
    static values v;
    test_allocations count = {0};
    sf_allocator allocator = {test_count_alloc, test_count_free, &count};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    make_values(&v, 5, 4, 1);
    sf_model *model = model_of(ctx, &v, 5, 1);
    const char *path = test_path("memory.spz");
    for (int loading = 0; loading < 2; loading++) {
        sf_status status = SF_ERR_MEMORY;
        long before = count.live;
        for (long n = 1; status; n++) {
            sf_model *again = NULL;
            count.fail_at = count.calls + n;
            status = loading ? sf_model_load(ctx, path, &again) : sf_model_save(model, path);
            assert_true(status == SF_OK || status == SF_ERR_MEMORY);
            sf_model_destroy(&again);
            assert_int_equal(count.live, before);
            assert_true(n < 100);
        }
        count.fail_at = 0;
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bytes),
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_frame),
        cmocka_unit_test(test_bits_by_weight),
        cmocka_unit_test(test_clips),
        cmocka_unit_test(test_options),
        cmocka_unit_test(test_empty_model),
        cmocka_unit_test(test_versions),
        cmocka_unit_test(test_version_4),
        cmocka_unit_test(test_axes_of_the_extension),
        cmocka_unit_test(test_band_4_is_left_out),
        cmocka_unit_test(test_refuses_headers),
        cmocka_unit_test(test_bomb),
        cmocka_unit_test(test_cut_and_changed),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
