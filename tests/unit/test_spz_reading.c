/* test_spz_reading.c - .spz files of each version made by hand, and hostile files. */
#include "spz_fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "scene/gaussian_math.h"

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
    spz_assert_near("opacity", sf_sigmoid((double)logit), 0.2, 1e-6);
    spz_assert_near("red", (double)sh[0], -0.5 / 0.15, 1e-6);
    spz_assert_near("green", (double)sh[1], 0.5 / 0.15, 1e-6);
    spz_assert_near("blue", (double)sh[2], 0.1 / 0.15, 1e-6);
    assert_true(scale[0] == -10 && scale[1] == 0 && scale[2] == 5.9375f);
    if (version < 3)
        assert_true(quat[0] == 0 && quat[1] == 1 && quat[2] == -1 && quat[3] == -1);
    else
        spz_assert_same_rotation(quat, (float[]){1, -1, 0, 0}, 1e-6);
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
        test_refuse_model(ctx, write_gzip(&f), axes > 16 ? SF_ERR_FORMAT : SF_ERR_UNSUPPORTED, "axes: ");
    }
    sf_context_destroy(&ctx);
}

static void test_version_4(void **state) {
    (void)state;
    static file f;
    sf_context *ctx = test_context();
    put_version_4(&f, 0);
#ifndef SF_HAVE_ZSTD
    test_refuse_model(ctx, write_plain(f.data, f.size), SF_ERR_UNSUPPORTED, "zstd");
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
        test_refuse_model(ctx, write_plain(f.data, cut), SF_ERR_FORMAT, "");
    f.data[15] = 6;
    test_refuse_model(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "streams: 6");
    put_version_4(&f, 0);
    f.data[8] = 2; /* Gaussians */
    test_refuse_model(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "stream 0: 9 bytes, not the 18");
    put_version_4(&f, 0);
    f.data[f.size - 1 - 4 - 3]++; /* the size of the last block */
    test_refuse_model(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "stream 4: zstd");
    put_version_4(&f, 0);
    f.data[11] = 0x70; /* a count of which the table knows nothing */
    test_refuse_model(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "stream 0");
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
        test_refuse_model(ctx, write_gzip(&f), cases[i].status, cases[i].part);
    }
    put_header(&f, 3, 1, 0, 8, 0);
    f.data[0] = 'M';
    test_refuse_model(ctx, write_gzip(&f), SF_ERR_FORMAT, "NGSP");
    put_header(&f, 3, 1, 0, 8, 0);
    put_columns(&f, 3);
    test_refuse_model(ctx, write_plain(f.data, f.size), SF_ERR_FORMAT, "version: 3 without gzip");
    test_refuse_model(ctx, write_plain("nothing", 7), SF_ERR_FORMAT, "not a .spz file");
    test_refuse_model(ctx, write_plain("", 0), SF_ERR_FORMAT, "not a .spz file");
    test_refuse_model(ctx, test_path("absent.spz"), SF_ERR_IO, "absent.spz");
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
        test_refuse_model(ctx, write_plain(packed, size), SF_ERR_FORMAT, "unpacks to more than the 20 bytes");
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
    spz_make_values(&v, 3, 4, 1);
    sf_model *model = spz_model_of(ctx, &v, 3, 1);
    const char *path = test_path("whole.spz");
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    size_t size;
    uint8_t *data = test_read(path, &size);
    for (size_t cut = 0; cut < size; cut++) test_refuse_model(ctx, write_plain(data, cut), SF_ERR_FORMAT, "");
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
    spz_make_values(&v, 5, 4, 1);
    sf_model *model = spz_model_of(ctx, &v, 5, 1);
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
