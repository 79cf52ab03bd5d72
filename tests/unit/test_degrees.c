/* test_degrees.c - models of Gaussians of several SH degrees: pictures, gradients, files, memory. */
#include "degrees_fixture.h"

#include <math.h>
#include <stdlib.h>

#include "reference/random.h"
#include "scene/gaussians.h"

/* Values of the bands up to a degree, and of a whole Gaussian. */
static size_t sh_values(int degree) { return 3 * (size_t)(degree + 1) * (size_t)(degree + 1); }

/* ---- pictures and gradients ------------------------------------------------------------------------------
 */

static int degree_at(size_t i) { return (int)(i * 7 % 11 % 4); }

/* A model of degree 3 in which Gaussian i has values up to its degree alone. */
static sf_model *sparse_model(sf_context *ctx, const test_ref_scene *scene) {
    for (size_t i = 0; i < scene->count; i++)
        for (size_t k = sh_values(degree_at(i)); k < sh_values(3); k++)
            scene->gaussians.sh[i * sh_values(3) + k] = 0;
    return test_model_of(ctx, scene);
}

/* The same Gaussians in the same order, all with all bands. */
static sf_model *padded(sf_context *ctx, const sf_model *model) {
    sf_gaussians values = test_gaussians_create(model->count, 3);
    sf_model *copy;
    assert_ok(ctx, sf_model_get(model, 0, model->count, &values));
    assert_ok(ctx, sf_model_create(ctx, model->count, 3, &copy));
    assert_ok(ctx, sf_model_set(copy, 0, model->count, &values));
    test_gaussians_free(&values);
    return copy;
}

typedef struct outcome {
    size_t pixels, count;
    float *rgb;
    sf_gaussians gradient;
    double pose[6], focal[2];
} outcome;

static outcome render(sf_context *ctx, const sf_model *model, const test_ref_scene *scene, int used) {
    size_t pixels = (size_t)scene->camera.width * (size_t)scene->camera.height;
    outcome o = {.pixels = pixels, .count = model->count, .rgb = calloc(3 * pixels, sizeof *o.rgb)};
    o.gradient = test_gaussians_create(model->count, 3);
    float *d_rgb = malloc(3 * pixels * sizeof *d_rgb);
    assert_true(o.rgb && d_rgb);
    for (size_t i = 0; i < 3 * pixels; i++) d_rgb[i] = (float)(1 + 0.7 * sin(0.37 * (double)i));
    sf_renderer *renderer;
    sf_render_options options = test_render_options_of(scene);
    options.sh_degree = used;
    sf_image_out out = {.rgb = o.rgb};
    sf_render_grads grads = {.gaussians = o.gradient, .pose = o.pose, .focal = o.focal};
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_render(renderer, model, &scene->camera, &options, &out));
    assert_ok(ctx, sf_render_backward(renderer, model, d_rgb, &grads));
    sf_renderer_destroy(&renderer);
    free(d_rgb);
    return o;
}

static void outcome_free(outcome *o) {
    free(o->rgb);
    test_gaussians_free(&o->gradient);
}

/* All of `mixed` as of `whole`, but that a band which a Gaussian lacks has no gradient. */
static void assert_same_but_lacking(const sf_model *model, const outcome *mixed, const outcome *whole) {
    float *a[TEST_REF_ARRAYS], *b[TEST_REF_ARRAYS];
    test_ref_array shape[TEST_REF_ARRAYS];
    assert_memory_equal(mixed->rgb, whole->rgb, 3 * mixed->pixels * sizeof(float));
    assert_memory_equal(mixed->pose, whole->pose, sizeof mixed->pose);
    assert_memory_equal(mixed->focal, whole->focal, sizeof mixed->focal);
    for (size_t i = 0; i < whole->count; i++)
        for (size_t k = sh_values(sf_degree_of(model, i)); k < sh_values(3); k++)
            whole->gradient.sh[i * sh_values(3) + k] = 0;
    test_gaussians_list(&mixed->gradient, a);
    test_gaussians_list(&whole->gradient, b);
    test_ref_list(&(test_ref_gaussians){0}, 3, shape);
    for (int k = 0; k < TEST_REF_ARRAYS; k++)
        assert_memory_equal(a[k], b[k], mixed->count * shape[k].width * sizeof(float));
}

static double sum_of_magnitudes(const float *values, size_t n) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += fabs((double)values[i]);
    return sum;
}

static void check_level(const char *isa, size_t count, int threads) {
    sf_context *ctx;
    sf_context_options options = {.threads = threads, .isa = isa};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    test_ref_scene scene = test_random_scene(91, count, 3, 60, 44);
    sf_model *mixed = sparse_model(ctx, &scene);
    assert_ok(ctx, sf_model_pack(mixed));
    sf_model *whole = padded(ctx, mixed);
    for (int used = 3; used >= 0; used--) {
        outcome a = render(ctx, mixed, &scene, used), b = render(ctx, whole, &scene, used);
        assert_same_but_lacking(mixed, &a, &b);
        assert_true(sum_of_magnitudes(a.rgb, 3 * a.pixels) > 0);
        assert_true(sum_of_magnitudes(a.gradient.sh, count * sh_values(3)) > 0);
        outcome_free(&a);
        outcome_free(&b);
    }
    sf_model_destroy(&mixed);
    sf_model_destroy(&whole);
    test_ref_gaussians_free(&scene.gaussians);
    sf_context_destroy(&ctx);
}

/* Numbers whose degrees end within blocks, and few enough that one block has all degrees. */
static void test_as_if_padded(void **state) {
    (void)state;
    sf_isa_info info;
    for (size_t i = 0; !sf_isa_describe(i, &info); i++) {
        if (!info.usable) continue;
        check_level(info.name, test_is_quick() ? 300 : 1500, 2);
        check_level(info.name, 21, 1);
    }
}

/* ---- packing --------------------------------------------------------------------------------------------
 */

enum { COUNT = 100 };

/* Gaussian i of a model stands where it should: its mean says where it comes from. */
static void number(sf_context *ctx, sf_model *model) {
    for (size_t i = 0; i < model->count; i++) {
        float mean[3] = {(float)i, 1, 2}, logit = 0, quat[4] = {1, 0, 0, 0};
        sf_gaussians one = {.means = mean, .logit_opacities = &logit, .quats = quat};
        assert_ok(ctx, sf_model_set(model, i, 1, &one));
    }
}

static sf_model *numbered(sf_context *ctx) {
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, COUNT, 3, &model));
    number(ctx, model);
    for (size_t i = 0; i < COUNT; i++) {
        float sh[48] = {0};
        for (size_t k = 0; k < sh_values(degree_at(i)); k++) sh[k] = (float)(i + 1) + (float)k / 64;
        sf_gaussians one = {.sh = sh};
        assert_ok(ctx, sf_model_set(model, i, 1, &one));
    }
    return model;
}

static void test_pack(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = numbered(ctx);
    size_t degrees[4], expected[4] = {0}, floats = 0;
    assert_int_equal(sf_model_floats(model), 59 * COUNT);
    sf_model_degrees(model, degrees);
    assert_true(!degrees[0] && !degrees[1] && !degrees[2] && degrees[3] == COUNT);
    for (size_t i = 0; i < COUNT; i++) {
        expected[degree_at(i)]++;
        floats += 11 + sh_values(degree_at(i));
    }
    assert_true(expected[0] && expected[1] && expected[2] && expected[3]);
    for (int again = 0; again < 2; again++) { /* the second time nothing changes */
        assert_ok(ctx, sf_model_pack(model));
        sf_model_degrees(model, degrees);
        assert_memory_equal(degrees, expected, sizeof expected);
        assert_int_equal(sf_model_floats(model), floats);
        assert_int_equal(sf_model_count(model), COUNT);
        assert_int_equal(sf_model_sh_degree(model), 3);
        size_t at = 0;
        for (int degree = 3; degree >= 0; degree--)
            for (size_t i = 0; i < COUNT; i++) {
                if (degree_at(i) != degree) continue;
                float mean[3], sh[48];
                sf_gaussians one = {.means = mean, .sh = sh};
                assert_int_equal(sf_degree_of(model, at), degree);
                assert_ok(ctx, sf_model_get(model, at++, 1, &one));
                assert_true(mean[0] == (float)i && mean[1] == 1 && mean[2] == 2);
                for (size_t k = 0; k < 48; k++)
                    assert_true(sh[k] == (k < sh_values(degree) ? (float)(i + 1) + (float)k / 64 : 0));
            }
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* A value that would be lost is refused, and nothing of the call is done. */
static void test_set_into_packed(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = numbered(ctx);
    assert_ok(ctx, sf_model_pack(model));
    sf_gaussians values = test_gaussians_create(COUNT, 3), back = test_gaussians_create(COUNT, 3);
    assert_ok(ctx, sf_model_get(model, 0, COUNT, &values));
    for (size_t k = 0; k < 3 * (size_t)COUNT; k++) values.means[k] += 1;
    size_t i = model->banded[2];
    assert_int_equal(sf_degree_of(model, i), 1);
    values.sh[48 * i + 12] = 0.5f;
    assert_status(ctx, sf_model_set(model, 0, COUNT, &values), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "is packed to degree 1 and cannot take 0.5");
    assert_ok(ctx, sf_model_get(model, 0, COUNT, &back));
    assert_true(back.means[0] == values.means[0] - 1);
    values.sh[48 * i + 12] = 0;
    assert_ok(ctx, sf_model_set(model, 0, COUNT, &values));
    assert_ok(ctx, sf_model_get(model, 0, COUNT, &back));
    assert_memory_equal(back.means, values.means, 3 * COUNT * sizeof(float));
    assert_memory_equal(back.sh, values.sh, 48 * COUNT * sizeof(float));
    test_gaussians_free(&values);
    test_gaussians_free(&back);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* A file keeps the order and is padded; what comes back has all bands. */
static void test_file(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = numbered(ctx), *loaded;
    sf_gaussians a = test_gaussians_create(COUNT, 3), b = test_gaussians_create(COUNT, 3);
    size_t degrees[4], expected[4];
    assert_ok(ctx, sf_model_pack(model));
    assert_ok(ctx, sf_model_save(model, test_path("m.ply")));
    assert_ok(ctx, sf_model_load(ctx, test_path("m.ply"), &loaded));
    assert_ok(ctx, sf_model_get(model, 0, COUNT, &a));
    assert_ok(ctx, sf_model_get(loaded, 0, COUNT, &b));
    assert_memory_equal(a.means, b.means, 3 * COUNT * sizeof(float));
    assert_memory_equal(a.sh, b.sh, 48 * COUNT * sizeof(float));
    assert_int_equal(sf_model_floats(loaded), 59 * COUNT);
    assert_ok(ctx, sf_model_pack(loaded));
    sf_model_degrees(model, expected);
    sf_model_degrees(loaded, degrees);
    assert_memory_equal(degrees, expected, sizeof expected);
    test_gaussians_free(&a);
    test_gaussians_free(&b);
    sf_model_destroy(&loaded);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* ---- memory ---------------------------------------------------------------------------------------------
 */

/* Bytes of the arrays of banded[b] Gaussians with band b, `each` a value, but for what the allocator adds. */
static size_t bytes_of(const size_t banded[SF_BANDS], size_t each) {
    size_t bytes = 0;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        bytes += each * sf_field_values(field, banded[sf_field_band(field)]);
    return bytes;
}

static void test_memory_of_packed(void **state) {
    (void)state;
    enum { MANY = 4000 };
    meter m;
    sf_context *ctx = degrees_metered(&m);
    size_t idle = m.live;
    sf_model *model, *copy;
    assert_ok(ctx, sf_model_create(ctx, MANY, 3, &model));
    const size_t whole[SF_BANDS] = {MANY, MANY, MANY, MANY}, few[SF_BANDS] = {MANY, 1000, 100, 0};
    degrees_assert_about(m.live - idle, bytes_of(whole, sizeof(float)));
    for (size_t i = 0; i < 1000; i++) {
        float sh[48] = {0};
        sh[i < 100 ? 20 : 5] = 1;
        sf_gaussians one = {.sh = sh};
        assert_ok(ctx, sf_model_set(model, 4 * i, 1, &one));
    }
    assert_ok(ctx, sf_model_pack(model));
    assert_memory_equal(model->banded, few, sizeof few);
    degrees_assert_about(m.live - idle, bytes_of(few, sizeof(float)));
    /* an order and the largest array of a field once more */
    degrees_assert_about(m.peak - idle,
                         bytes_of(whole, sizeof(float)) + MANY * (sizeof(uint32_t) + 4 * sizeof(float)));
    size_t packed = m.live;
    assert_ok(ctx, sf_model_copy(model, MANY, &copy));
    degrees_assert_about(m.live - packed, bytes_of(few, sizeof(float)));
    sf_model_destroy(&copy);
    sf_model_destroy(&model);
    assert_int_equal(m.live, idle);
    sf_context_destroy(&ctx);
}

/* A packing that finds no memory changes nothing. */
static void test_pack_without_memory(void **state) {
    (void)state;
    meter m;
    sf_context *ctx = degrees_metered(&m);
    sf_model *model = numbered(ctx);
    sf_gaussians before = test_gaussians_create(COUNT, 3), after = test_gaussians_create(COUNT, 3);
    assert_ok(ctx, sf_model_get(model, 0, COUNT, &before));
    for (long allowed = 0; allowed < 5; allowed++) {
        m.left = allowed;
        assert_status(ctx, sf_model_pack(model), SF_ERR_MEMORY);
        m.left = -1;
        assert_int_equal(model->banded[3], COUNT);
        assert_ok(ctx, sf_model_get(model, 0, COUNT, &after));
        assert_memory_equal(after.sh, before.sh, 48 * COUNT * sizeof(float));
        assert_memory_equal(after.means, before.means, 3 * COUNT * sizeof(float));
    }
    m.left = 5; /* bands stay larger than they need be */
    assert_ok(ctx, sf_model_pack(model));
    m.left = -1;
    assert_int_equal(sf_degree_of(model, COUNT - 1), 0);
    test_gaussians_free(&before);
    test_gaussians_free(&after);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_as_if_padded),     cmocka_unit_test(test_pack),
        cmocka_unit_test(test_set_into_packed),  cmocka_unit_test(test_file),
        cmocka_unit_test(test_memory_of_packed), cmocka_unit_test(test_pack_without_memory),
    };
    return cmocka_run_group_tests_name("degrees", tests, NULL, NULL);
}
