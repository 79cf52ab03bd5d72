/* test_gltf.c - Gaussians to .glb and back, .gltf files by hand, and files that lie. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct gaussian {
    float mean[3], quat[4], log_scales[3], logit, sh[48];
} gaussian;

static sf_gaussians fields_of(gaussian *g) {
    return (sf_gaussians){g->mean, g->quat, g->log_scales, &g->logit, g->sh};
}

static gaussian sample(void) {
    gaussian g = {{1, 2, 3}, {0.5f, 0.5f, -0.5f, 0.5f}, {-1, -2, 0.5f}, 0.75f, {0}};
    for (int i = 0; i < 48; i++) g.sh[i] = 0.0625f * (float)(i - 20);
    return g;
}

static void save_sample(sf_context *ctx, const char *path, int antialiased) {
    gaussian g = sample();
    sf_gaussians f = fields_of(&g);
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, 1, 3, &model));
    assert_ok(ctx, sf_model_set(model, 0, 1, &f));
    sf_model_set_antialiased(model, antialiased);
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
}

static gaussian load_one(sf_context *ctx, const char *path, int degree) {
    gaussian g = {0};
    sf_gaussians f = fields_of(&g);
    sf_model *model;
    assert_ok(ctx, sf_model_load(ctx, path, &model));
    assert_int_equal(sf_model_count(model), 1);
    assert_int_equal(sf_model_sh_degree(model), degree);
    assert_ok(ctx, sf_model_get(model, 0, 1, &f));
    sf_model_destroy(&model);
    return g;
}

static void assert_near(const float *got, const float *expected, int n) {
    for (int i = 0; i < n; i++) assert_float_equal(got[i], expected[i], 1e-5);
}

static void test_comes_back(void **state) {
    sf_context *ctx = test_context();
    const char *path = test_path("model.glb");
    (void)state;
    test_log_clear();
    save_sample(ctx, path, 1);
    assert_non_null(strstr(test_log, "opacity compensation"));
    gaussian g = load_one(ctx, path, 3), was = sample();
    float sign = g.quat[0] < 0 ? -1 : 1;
    for (int k = 0; k < 4; k++) g.quat[k] *= sign;
    assert_near(g.mean, was.mean, 3);
    assert_near(g.quat, was.quat, 4);
    assert_near(g.log_scales, was.log_scales, 3);
    assert_near(&g.logit, &was.logit, 1);
    assert_memory_equal(g.sh, was.sh, sizeof g.sh);
    sf_context_destroy(&ctx);
}

/* The JSON of a .glb, and its numbers. */
static json_t *open_glb(const char *path, uint8_t **file, const float **bin) {
    size_t size;
    uint32_t length;
    *file = test_read(path, &size);
    memcpy(&length, *file + 12, 4);
    assert_int_equal(size % 4, 0);
    json_t *root = json_loadb((const char *)*file + 20, length, 0, NULL);
    assert_non_null(root);
    *bin = (const float *)(const void *)(*file + 20 + length + 8);
    return root;
}

/* What the extension's text asks for: x and y negated, xyzw, lengths, opacities, odd orders negated. */
static void test_is_as_the_text_has_it(void **state) {
    sf_context *ctx = test_context();
    const char *path = test_path("model.glb");
    uint8_t *file;
    const float *bin;
    gaussian g = sample();
    (void)state;
    save_sample(ctx, path, 0);
    json_t *root = open_glb(path, &file, &bin);
    const float mean[] = {-1, -2, 3}, quat[] = {0.5f, 0.5f, 0.5f, -0.5f};
    assert_near(bin, mean, 3);
    assert_near(bin + 3, quat, 4);
    for (int k = 0; k < 3; k++) assert_float_equal(bin[7 + k], expf(g.log_scales[k]), 1e-6);
    assert_float_equal(bin[10], 1 / (1 + expf(-0.75f)), 1e-6);
    for (int c = 0; c < 3; c++) {
        assert_float_equal(bin[11 + c], g.sh[c], 0);
        assert_float_equal(bin[14 + c], -g.sh[3 + c], 0);  /* m = -1 */
        assert_float_equal(bin[17 + c], g.sh[6 + c], 0);   /* m = 0 */
        assert_float_equal(bin[20 + c], -g.sh[9 + c], 0);  /* m = 1 */
        assert_float_equal(bin[23 + c], g.sh[12 + c], 0);  /* m = -2 */
        assert_float_equal(bin[56 + c], -g.sh[45 + c], 0); /* degree 3, m = 3 */
    }
    const json_t *primitive =
        json_array_get(json_object_get(json_array_get(json_object_get(root, "meshes"), 0), "primitives"), 0);
    const json_t *extension =
        json_object_get(json_object_get(primitive, "extensions"), "KHR_gaussian_splatting");
    assert_string_equal(json_string_value(json_object_get(extension, "kernel")), "ellipse");
    assert_int_equal(json_integer_value(json_object_get(json_object_get(primitive, "attributes"),
                                                        "KHR_gaussian_splatting:SH_DEGREE_3_COEF_6")),
                     19);
    json_decref(root);
    free(file);
    sf_context_destroy(&ctx);
}

/* A .gltf of one Gaussian: position 1 2 3, rotation as normalised bytes, scale as given, opacity as a byte of
 * 51. Numbers stand in data.bin. */
typedef struct parts {
    float scale[3];
    const char *uri, *node, *root, *extension;
    int count;
} parts;

static const parts plain = {{1, 2, 4}, "data.bin", "\"mesh\":0", "", "", 1};

static const char *write_parts(const parts *p) {
    static char text[4096];
    uint8_t bin[48] = {0};
    const float mean[] = {1, 2, 3}, sh[] = {0.5f, 0, -0.5f};
    const char *e = "KHR_gaussian_splatting";
    memcpy(bin, mean, 12);
    memcpy(bin + 12, p->scale, 12);
    memcpy(bin + 24, sh, 12);
    bin[39] = 127;
    bin[40] = 51;
    test_write(test_path("data.bin"), bin, sizeof bin);
    int size = snprintf(
        text, sizeof text,
        "{\"asset\":{\"version\":\"2.0\"},%s\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{%s}],\"meshes\":[{"
        "\"primitives\":[{\"mode\":0,\"attributes\":{\"POSITION\":0,\"%s:SCALE\":1,\"%s:ROTATION\":2,"
        "\"%s:OPACITY\":3,\"%s:SH_DEGREE_0_COEF_0\":4},\"extensions\":{\"%s\":{\"kernel\":\"ellipse\"%s}}}]}]"
        ","
        "\"buffers\":[{\"byteLength\":48,\"uri\":\"%s\"}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\",\"count\":%d},"
        "{\"bufferView\":0,\"byteOffset\":12,\"componentType\":5126,\"type\":\"VEC3\",\"count\":1},"
        "{\"bufferView\":0,\"byteOffset\":36,\"componentType\":5120,\"normalized\":true,\"type\":\"VEC4\","
        "\"count\":1},{\"bufferView\":0,\"byteOffset\":40,\"componentType\":5121,\"normalized\":true,"
        "\"type\":"
        "\"SCALAR\",\"count\":1},{\"bufferView\":0,\"byteOffset\":24,\"componentType\":5126,\"type\":"
        "\"VEC3\","
        "\"count\":1}]}",
        p->root, p->node, e, e, e, e, e, p->extension, p->uri, p->count);
    assert_between(size, 1, sizeof text - 1);
    const char *path = test_path("hand.gltf");
    test_write(path, text, (size_t)size);
    return path;
}

static void test_reads_bytes_beside_a_gltf(void **state) {
    sf_context *ctx = test_context();
    (void)state;
    gaussian g = load_one(ctx, write_parts(&plain), 0);
    const float mean[] = {-1, -2, 3}, scales[] = {0, logf(2), logf(4)}, sh[] = {0.5f, 0, -0.5f};
    assert_near(g.mean, mean, 3);
    assert_near(g.log_scales, scales, 3);
    assert_near(g.sh, sh, 3);
    assert_float_equal(fabsf(g.quat[3]), 1, 1e-6); /* the turn alone */
    assert_float_equal(g.logit, logf(0.2f / 0.8f), 1e-5);
    sf_context_destroy(&ctx);
}

static void test_tells_logarithms_from_lengths(void **state) {
    sf_context *ctx = test_context();
    parts p = plain;
    (void)state;
    for (int k = 0; k < 3; k++) p.scale[k] = -2 - (float)k;
    test_log_clear();
    gaussian g = load_one(ctx, write_parts(&p), 0);
    assert_near(g.log_scales, p.scale, 3);
    assert_non_null(strstr(test_log, "SCALE"));
    assert_non_null(strstr(test_log, "logarithms"));
    sf_context_destroy(&ctx);
}

/* A length may be 0, of which there is no logarithm. */
static void test_takes_flat_gaussians(void **state) {
    sf_context *ctx = test_context();
    parts p = plain;
    (void)state;
    p.scale[1] = 0;
    gaussian g = load_one(ctx, write_parts(&p), 0);
    assert_float_equal(g.log_scales[1], -40, 0);
    sf_context_destroy(&ctx);
}

/* Of glTF's axes: a quarter turn about z, 3 times, moved. */
static void test_moves_as_nodes_say(void **state) {
    static const char *const nodes[] = {
        "\"mesh\":0,\"translation\":[10,0,0],\"rotation\":[0,0,0.70710678,0.70710678],\"scale\":[3,3,3]",
        "\"mesh\":0,\"matrix\":[0,3,0,0,-3,0,0,0,0,0,3,0,10,0,0,1]",
        ("\"children\":[1],\"translation\":[10,0,0]},{\"mesh\":0,\"rotation\":[0,0,0.70710678,0.70710678],"
         "\"scale\":[3,3,3]")};
    sf_context *ctx = test_context();
    const float mean[] = {-4, -3, 9}, scales[] = {logf(3), logf(6), logf(12)};
    (void)state;
    for (size_t i = 0; i < sizeof nodes / sizeof *nodes; i++) {
        parts p = plain;
        p.node = nodes[i];
        gaussian g = load_one(ctx, write_parts(&p), 0);
        assert_near(g.mean, mean, 3);
        assert_near(g.log_scales, scales, 3);
    }
    sf_context_destroy(&ctx);
}

static void assert_refused(sf_context *ctx, const char *path, sf_status expected, const char *part) {
    sf_model *model = (sf_model *)ctx;
    assert_status(ctx, sf_model_load(ctx, path, &model), expected);
    assert_null(model);
    assert_error_names(ctx, part);
    assert_null(strchr(sf_last_error(ctx), '\n'));
}

static void test_refuses_what_it_cannot_read(void **state) {
    static const struct {
        parts p;
        sf_status status;
        const char *part;
    } cases[] = {
        {{{1, 1, 1}, "data.bin", "\"mesh\":0", "", "", 2147483000}, SF_ERR_FORMAT, "POSITION: count"},
        {{{1, 1, 1}, "data.bin", "\"mesh\":0", "", "", 2}, SF_ERR_FORMAT, "count: 1 is not POSITION's 2"},
        {{{1, 1, 1}, "data.bin", "\"mesh\":0", "", "", -1}, SF_ERR_FORMAT, "count: is not a whole number"},
        {{{1, 1, 1}, "data.bin", "\"mesh\":7", "", "", 1}, SF_ERR_FORMAT, "meshes: there is no number 7"},
        {{{1, 1, 1}, "data.bin", "\"name\":\"x\"", "", "", 1}, SF_ERR_FORMAT, "holds no Gaussians"},
        {{{1, 1, 1}, "data.bin", "\"mesh\":0,\"children\":[0]", "", "", 1}, SF_ERR_FORMAT, "two parents"},
        {{{1, 1, 1}, "data.bin", "\"mesh\":0,\"scale\":[1,2,1]", "", "", 1}, SF_ERR_UNSUPPORTED, "one scale"},
        {{{1, 1, 1}, "data.bin", "\"mesh\":0,\"scale\":[-1,1,1]", "", "", 1}, SF_ERR_UNSUPPORTED, "matrix"},
        {{{1, 1, 1}, "data.bin", "\"mesh\":0,\"rotation\":[0,0,0,0]", "", "", 1}, SF_ERR_FORMAT, "rotation"},
        {{{1, 1, 1}, "../data.bin", "\"mesh\":0", "", "", 1}, SF_ERR_FORMAT, "leads out"},
        {{{1, 1, 1}, "%2e%2e/data.bin", "\"mesh\":0", "", "", 1}, SF_ERR_FORMAT, "leads out"},
        {{{1, 1, 1}, "/etc/hostname", "\"mesh\":0", "", "", 1}, SF_ERR_FORMAT, "leads out"},
        {{{1, 1, 1}, "none.bin", "\"mesh\":0", "", "", 1}, SF_ERR_IO, "none.bin"},
        {{{1, 1, 1}, "data:x;base64,AAAA", "\"mesh\":0", "", "", 1}, SF_ERR_FORMAT, "truncated"},
        {{{1, 1, 1},
          "data.bin",
          "\"mesh\":0",
          "\"extensionsRequired\":[\"EXT_meshopt_compression\"],",
          "",
          1},
         SF_ERR_UNSUPPORTED,
         "EXT_meshopt_compression is not read"},
        {{{1, 1, 1},
          "data.bin",
          "\"mesh\":0",
          "",
          ",\"extensions\":{\"KHR_gaussian_splatting_compression_spz_2\":{}}",
          1},
         SF_ERR_UNSUPPORTED,
         "compression_spz_2 is not read"},
    };
    sf_context *ctx = test_context();
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_refused(ctx, write_parts(&cases[i].p), cases[i].status, cases[i].part);
    sf_context_destroy(&ctx);
}

/* Cut off anywhere a .glb is refused: its header says how long it is. */
static void test_refuses_what_is_cut_off(void **state) {
    sf_context *ctx = test_context();
    size_t size;
    (void)state;
    save_sample(ctx, test_path("whole.glb"), 0);
    uint8_t *file = test_read(test_path("whole.glb"), &size);
    for (size_t kept = 4; kept < size; kept += 37) {
        test_write(test_path("cut.glb"), file, kept);
        assert_refused(ctx, test_path("cut.glb"), kept < 8 ? SF_ERR_UNSUPPORTED : SF_ERR_FORMAT, "cut.glb");
    }
    free(file);
    sf_context_destroy(&ctx);
}

static void test_does_not_write_what_gltf_has_not(void **state) {
    sf_context *ctx = test_context();
    sf_model *model;
    (void)state;
    assert_ok(ctx, sf_model_create(ctx, 0, 0, &model));
    assert_status(ctx, sf_model_save(model, test_path("empty.glb")), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "empty.glb");
    assert_false(test_exists(test_path("empty.glb")));
    assert_status(ctx, sf_model_save(model, test_path("text.gltf")), SF_ERR_UNSUPPORTED);
    assert_error_names(ctx, ".glb");
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_comes_back),
        cmocka_unit_test(test_is_as_the_text_has_it),
        cmocka_unit_test(test_reads_bytes_beside_a_gltf),
        cmocka_unit_test(test_tells_logarithms_from_lengths),
        cmocka_unit_test(test_takes_flat_gaussians),
        cmocka_unit_test(test_moves_as_nodes_say),
        cmocka_unit_test(test_refuses_what_it_cannot_read),
        cmocka_unit_test(test_refuses_what_is_cut_off),
        cmocka_unit_test(test_does_not_write_what_gltf_has_not),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
