/* test_ply_refusals.c - .ply files that are refused: malformed, cut, changed; and memory that runs out. */
#include "ply_fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "io/ply.h"

static const struct {
    const char *text, *part;
    sf_status status;
} refused[] = {
    {"", "not a .ply file", SF_ERR_FORMAT},
    {"\n", "not a .ply file", SF_ERR_FORMAT},
    {"ply", "not a .ply file", SF_ERR_FORMAT},
    {"plyx\nformat ascii 1.0\n", "not a .ply file", SF_ERR_FORMAT},
    {"{\"a\": 1}\n", "not a .ply file", SF_ERR_FORMAT},
    {"ply\n", "end_header is missing", SF_ERR_FORMAT},
    {"ply\nelement vertex 0\n" GAUSSIAN_PROPERTIES END, "the format line is missing", SF_ERR_FORMAT},
    {"ply\nformat binary_middle_endian 1.0\n", "line 2: format 'binary_middle_endian' is unknown",
     SF_ERR_FORMAT},
    {"ply\nformat ascii 2.0\n", "line 2: format is not of version 1.0", SF_ERR_FORMAT},
    {"ply\nformat ascii\n", "line 2: format is not of version 1.0", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelephant vertex 1\n", "line 3: 'elephant'", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nproperty float x\n", "line 3: property without an element", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex\n", "line 3: element without", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 1 2\n", "line 3: element without", SF_ERR_FORMAT},
    {VERTEX("1") "property float\n", "line 4: property without a type and a name", SF_ERR_FORMAT},
    {VERTEX("1") "property float x y\n", "line 4: property without a type and a name", SF_ERR_FORMAT},
    {VERTEX("1") "property list uchar x\n", "line 4: property without a type and a name", SF_ERR_FORMAT},
    {VERTEX("1") "property float128 x\n", "line 4: type 'float128'", SF_ERR_FORMAT},
    {VERTEX("1") "property list float int x\n", "property x: its length is of type float", SF_ERR_FORMAT},
    {VERTEX("1") POINT "property float x\n", "property x: given twice", SF_ERR_FORMAT},
    {VERTEX("1") POINT "element vertex 2\n", "element vertex: given twice", SF_ERR_FORMAT},
    {VERTEX("1") POINT "property list uchar int tags\n" END, "property tags is a list", SF_ERR_UNSUPPORTED},
    {"ply\nformat ascii 1.0\nelement face 0\n" END, "element vertex is missing", SF_ERR_FORMAT},
    {VERTEX("-1"), "element vertex: count '-1'", SF_ERR_FORMAT},
    {VERTEX("1.5"), "element vertex: count '1.5'", SF_ERR_FORMAT},
    {VERTEX("0x10"), "element vertex: count '0x10'", SF_ERR_FORMAT},
    {VERTEX("2147483648"), "element vertex: count '2147483648'", SF_ERR_FORMAT},
    {VERTEX("4294967296"), "element vertex: count '4294967296'", SF_ERR_FORMAT},
    {VERTEX("9223372036854775808"), "element vertex: count '9223372036854775808'", SF_ERR_FORMAT},
    {VERTEX("18446744073709551617"), "element vertex: count '18446744073709551617'", SF_ERR_FORMAT},
    {VERTEX("2147483647") GAUSSIAN_PROPERTIES END, "truncated: 120259084232 bytes are missing",
     SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 2147483647\n" GAUSSIAN_PROPERTIES END "1 2 3",
     "truncated: at least 60129542110 bytes are missing", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES END
     "1 2 3 4 5 6 7 8 9.000000000000000 10\n",
     "truncated: ends before property rot_0 of vertex 0 of 1", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES END
     "1 2 red 4 5 6 7 8 9 10 11 12 13 14\n",
     "vertex 0: property z: 'red' is not a number", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement vertex 1\n" GAUSSIAN_PROPERTIES END
     "1 2 3,4 5 6 7 8 9 10 11 12 13 14 15\n",
     "vertex 0: property z: '3,4' is not a number", SF_ERR_FORMAT},
    {"ply\nformat ascii 1.0\nelement strip 1\nproperty list uchar int tags\nelement vertex 0\n" END "-3\n",
     "strip 0: property tags: length -3", SF_ERR_FORMAT},
    {"ply\nformat binary_little_endian 1.0\nelement strip 2147483647\nproperty list uchar int tags\n"
     "element vertex 0\n" END "\x01"
     "abcd",
     "truncated: ends before property tags of strip 1", SF_ERR_FORMAT},
    {"ply\nformat binary_little_endian 1.0\nelement chunk 2147483647\nproperty double a\nelement vertex "
     "0\n" END,
     "truncated: 17179869176 bytes are missing for element chunk", SF_ERR_FORMAT},
    {VERTEX("0") GAUSSIAN_PROPERTIES "property float f_rest_0\n" END, "1 properties f_rest, not",
     SF_ERR_FORMAT},
    {VERTEX("0") GAUSSIAN_PROPERTIES
     "property float f_rest_0\nproperty float f_rest_1\nproperty float f_rest_2\nproperty float f_rest_3\n"
     "property float f_rest_4\nproperty float f_rest_6\nproperty float f_rest_7\nproperty float f_rest_8\n"
     "property float f_rest_9\n" END,
     "property f_rest_5 is missing", SF_ERR_FORMAT},
};

static void test_refuses_to_read(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        test_refuse_model(ctx, ply_write_text(refused[i].text), refused[i].status, refused[i].part);
    sf_context_destroy(&ctx);
}

/* What tools call a model too is named, with what to do next. */
static void test_names_other_kinds(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *ksplat = test_path("model.ksplat");
    test_write(ksplat, "\0\1", 2);
    test_refuse_model(ctx, ksplat, SF_ERR_UNSUPPORTED, "GaussianSplats3D");
    assert_error_names(ctx, "@playcanvas/splat-transform");
    test_refuse_model(
        ctx, ply_write_text(VERTEX("0") POINT "property float scale_0\nproperty float scale_1\n" END),
        SF_ERR_UNSUPPORTED, "2DGS");
    sf_context_destroy(&ctx);
}

/* Each property in turn gets another name. */
static void test_names_the_missing_property(void **state) {
    (void)state;
    static const char *const names[GAUSSIAN_VALUES] = {"x",      "y",       "z",       "f_dc_0",  "f_dc_1",
                                                       "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
                                                       "rot_0",  "rot_1",   "rot_2",   "rot_3"};
    sf_context *ctx = test_context();
    for (int missing = 0; missing < GAUSSIAN_VALUES; missing++) {
        file f = {0};
        char line[64];
        ply_put_text(&f, VERTEX("0"));
        for (int i = 0; i < GAUSSIAN_VALUES; i++) {
            snprintf(line, sizeof line, "property float %s%s\n", i == missing ? "no_" : "", names[i]);
            ply_put_text(&f, line);
        }
        ply_put_text(&f, END);
        snprintf(line, sizeof line, "property %s is missing", names[missing]);
        test_refuse_model(ctx, ply_write_file(&f), missing == 9 ? SF_ERR_UNSUPPORTED : SF_ERR_FORMAT, line);
    }
    sf_context_destroy(&ctx);
}

static void test_refuses_endless_headers(void **state) {
    (void)state;
    static file f;
    char line[32];
    sf_context *ctx = test_context();
    ply_put_text(&f, VERTEX("0"));
    for (int i = 0; i < 1000; i++) {
        snprintf(line, sizeof line, "property float p%d\n", i);
        ply_put_text(&f, line);
    }
    ply_put_text(&f, END);
    test_refuse_model(ctx, ply_write_file(&f), SF_ERR_UNSUPPORTED, "property p512: more than 512 properties");
    f.size = 0;
    ply_put_text(&f, "ply\nformat ascii 1.0\n");
    for (int i = 0; i < 100; i++) {
        snprintf(line, sizeof line, "element e%d 0\n", i);
        ply_put_text(&f, line);
    }
    ply_put_text(&f, END);
    test_refuse_model(ctx, ply_write_file(&f), SF_ERR_UNSUPPORTED, "element e16: more than 16 elements");
    sf_context_destroy(&ctx);
}

static void test_refuses_what_is_no_file(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    test_refuse_model(ctx, test_path("absent.ply"), SF_ERR_IO, "absent.ply");
    test_refuse_model(ctx, test_folder(), SF_ERR_IO, "");
    test_refuse_model(ctx, "/dev/null", SF_ERR_IO, "");
    sf_context_destroy(&ctx);
}

static void test_refuses_garbage(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    while (f.size < 4096) ply_put_uint(&f, sf_rng_next(&rng), 8);
    test_refuse_model(ctx, ply_write_file(&f), SF_ERR_FORMAT, "not a .ply file");
    memcpy(f.data, "ply\n", 4);
    test_refuse_model(ctx, ply_write_file(&f), SF_ERR_FORMAT, "line 2");
    sf_context_destroy(&ctx);
}

/* Every proper beginning of a file is an error. */
static void test_truncation_at_every_byte(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = ply_make_model(ctx, 2, 0);
    const char *path = test_path("whole.ply");
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    size_t size;
    uint8_t *data = test_read(path, &size);
    size_t header = size - 2 * 17 * sizeof(float);
    for (size_t cut = 0; cut < size; cut++) {
        char missing[64] = "";
        if (cut >= header) snprintf(missing, sizeof missing, "truncated: %zu bytes are missing", size - cut);
        test_refuse_model(ctx, ply_write_bytes(data, cut), SF_ERR_FORMAT, missing);
    }
    free(data);
    sf_context_destroy(&ctx);
}

/* In text the last number may lose its end unseen; all that is lost with its blank before is missed. */
static void test_truncation_of_text(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    size_t end = strlen(ply_ascii_file) - strlen(" 0");
    for (size_t cut = 0; cut <= end; cut++)
        test_refuse_model(ctx, ply_write_bytes(ply_ascii_file, cut), SF_ERR_FORMAT, "");
    sf_context_destroy(&ctx);
}

static void assert_whole_or_refused(sf_context *ctx, const char *path) {
    sf_model *model = (sf_model *)ctx;
    double *xyz;
    uint8_t *rgb;
    size_t count;
    sf_status status = sf_model_load(ctx, path, &model);
    assert_int_equal(status == SF_OK, model != NULL);
    sf_model_destroy(&model);
    status = sf_ply_read_points(ctx, path, &xyz, &rgb, &count);
    assert_int_equal(status == SF_OK, xyz != NULL);
    assert_int_equal(status == SF_OK, rgb != NULL);
    sf_free(ctx, xyz);
    sf_free(ctx, rgb);
}

/* Each byte in turn becomes another: a model or an error, never a crash. */
static void change_every_byte(sf_context *ctx, const file *whole) {
    static const uint8_t others[] = {0, '\n', ' ', '9', 0xff};
    for (size_t at = 0; at < whole->size; at++)
        for (size_t i = 0; i < sizeof others; i++) {
            file f = *whole;
            f.data[at] = others[i];
            assert_whole_or_refused(ctx, ply_write_file(&f));
        }
}

static void test_survives_changed_bytes(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    ply_put_text(&f,
                 "ply\nformat binary_little_endian 1.0\nelement strip 2\nproperty list uchar int indices\n"
                 "element vertex 1\n" GAUSSIAN_PROPERTIES "property uchar red\n" END);
    ply_put_uint(&f, 1, 1), ply_put_uint(&f, 5, 4), ply_put_uint(&f, 0, 1);
    ply_put_one_gaussian(&f);
    ply_put_uint(&f, 9, 1);
    change_every_byte(ctx, &f);
    f.size = 0;
    ply_put_text(&f, ply_ascii_file);
    change_every_byte(ctx, &f);
    sf_context_destroy(&ctx);
}

/* An allocator that gives out a number of blocks and then none. */
typedef struct short_memory {
    long left, out;
} short_memory;

static void *short_alloc(void *user, size_t size) {
    short_memory *m = user;
    if (m->left-- <= 0) return NULL;
    m->out++;
    return malloc(size);
}

static void short_free(void *user, void *block) {
    ((short_memory *)user)->out -= block != NULL;
    free(block);
}

static void test_no_memory(void **state) {
    (void)state;
    short_memory memory = {.left = 1000};
    sf_allocator allocator = {short_alloc, short_free, &memory};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    file f = {0};
    ply_put_text(&f, VERTEX("1") GAUSSIAN_PROPERTIES END);
    ply_put_one_gaussian(&f);
    const char *path = ply_write_file(&f);
    long before = memory.out;
    sf_status status = SF_ERR_MEMORY;
    for (long blocks = 0; status; blocks++) {
        sf_model *model = (sf_model *)ctx;
        memory.left = blocks;
        status = sf_model_load(ctx, path, &model);
        assert_true(status == SF_OK || status == SF_ERR_MEMORY);
        assert_int_equal(status == SF_OK, model != NULL);
        sf_model_destroy(&model);
        assert_int_equal(memory.out, before);
        assert_true(blocks < 100);
    }
    memory.left = 1000;
    sf_context_destroy(&ctx);
    assert_int_equal(memory.out, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_refuses_to_read),
        cmocka_unit_test(test_names_other_kinds),
        cmocka_unit_test(test_names_the_missing_property),
        cmocka_unit_test(test_refuses_endless_headers),
        cmocka_unit_test(test_refuses_what_is_no_file),
        cmocka_unit_test(test_refuses_garbage),
        cmocka_unit_test(test_truncation_at_every_byte),
        cmocka_unit_test(test_truncation_of_text),
        cmocka_unit_test(test_survives_changed_bytes),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
