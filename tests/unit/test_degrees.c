/* test_degrees.c - Gaussians of several SH degrees: pictures, gradients, memory, and how a fit rearranges
 * them. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/optimizer_state.h"
#include "fit/reorder.h"
#include "reference/random.h"

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

/* What is allocated: each block is preceded by its size. */
typedef struct meter {
    size_t live, peak;
    long left; /* calls that still succeed; below 0: all */
} meter;

enum { HEAD = 64 };

static void *meter_alloc(void *user, size_t size) {
    meter *m = user;
    if (m->left == 0) return NULL;
    if (m->left > 0) m->left--;
    char *block = malloc(HEAD + size);
    assert_non_null(block);
    memcpy(block, &size, sizeof size);
    m->live += size;
    if (m->live > m->peak) m->peak = m->live;
    return block + HEAD;
}

static void meter_free(void *user, void *block) {
    meter *m = user;
    size_t size;
    memcpy(&size, (char *)block - HEAD, sizeof size);
    m->live -= size;
    free((char *)block - HEAD);
}

static sf_context *metered(meter *m) {
    sf_context *ctx;
    *m = (meter){.left = -1};
    sf_allocator allocator = {meter_alloc, meter_free, m};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    return ctx;
}

/* Bytes of the arrays of banded[b] Gaussians with band b, `each` a value, but for what the allocator adds. */
static size_t bytes_of(const size_t banded[SF_BANDS], size_t each) {
    size_t bytes = 0;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        bytes += each * sf_field_values(field, banded[sf_field_band(field)]);
    return bytes;
}

static void assert_about(size_t bytes, size_t expected) {
    const size_t blocks = 32, added = 72 + 256; /* of each array, and the struct itself */
    assert_between(bytes, expected, expected + blocks * added);
}

static void test_memory_of_packed(void **state) {
    (void)state;
    enum { MANY = 4000 };
    meter m;
    sf_context *ctx = metered(&m);
    size_t idle = m.live;
    sf_model *model, *copy;
    assert_ok(ctx, sf_model_create(ctx, MANY, 3, &model));
    const size_t whole[SF_BANDS] = {MANY, MANY, MANY, MANY}, few[SF_BANDS] = {MANY, 1000, 100, 0};
    assert_about(m.live - idle, bytes_of(whole, sizeof(float)));
    for (size_t i = 0; i < 1000; i++) {
        float sh[48] = {0};
        sh[i < 100 ? 20 : 5] = 1;
        sf_gaussians one = {.sh = sh};
        assert_ok(ctx, sf_model_set(model, 4 * i, 1, &one));
    }
    assert_ok(ctx, sf_model_pack(model));
    assert_memory_equal(model->banded, few, sizeof few);
    assert_about(m.live - idle, bytes_of(few, sizeof(float)));
    /* an order and the largest array of a field once more */
    assert_about(m.peak - idle,
                 bytes_of(whole, sizeof(float)) + MANY * (sizeof(uint32_t) + 4 * sizeof(float)));
    size_t packed = m.live;
    assert_ok(ctx, sf_model_copy(model, MANY, &copy));
    assert_about(m.live - packed, bytes_of(few, sizeof(float)));
    sf_model_destroy(&copy);
    sf_model_destroy(&model);
    assert_int_equal(m.live, idle);
    sf_context_destroy(&ctx);
}

/* A packing that finds no memory changes nothing. */
static void test_pack_without_memory(void **state) {
    (void)state;
    meter m;
    sf_context *ctx = metered(&m);
    sf_model *model = numbered(ctx);
    sf_gaussians before = test_gaussians_create(COUNT, 3), after = test_gaussians_create(COUNT, 3);
    assert_ok(ctx, sf_model_get(model, 0, COUNT, &before));
    for (long allowed = 0; allowed < 3; allowed++) {
        m.left = allowed;
        assert_status(ctx, sf_model_pack(model), SF_ERR_MEMORY);
        m.left = -1;
        assert_int_equal(model->banded[3], COUNT);
        assert_ok(ctx, sf_model_get(model, 0, COUNT, &after));
        assert_memory_equal(after.sh, before.sh, 48 * COUNT * sizeof(float));
        assert_memory_equal(after.means, before.means, 3 * COUNT * sizeof(float));
    }
    m.left = 3; /* bands stay larger than they need be */
    assert_ok(ctx, sf_model_pack(model));
    m.left = -1;
    assert_int_equal(sf_degree_of(model, COUNT - 1), 0);
    test_gaussians_free(&before);
    test_gaussians_free(&after);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* ---- in a fit -------------------------------------------------------------------------------------------
 */

#define SCENE "sim:studio?width=64&height=48&frames=6"

static sf_fit_options fit_options(int moments) {
    sf_fit_options options = sf_fit_options_default();
    options.validate = 0;
    options.size = SF_SIZE_CAP;
    options.steps = 40;
    options.max_gaussians = 400;
    options.init_random = 150;
    options.init = SF_INIT_RANDOM;
    options.densify_every = 1000;
    options.sh_end = 0.05; /* soon all degrees */
    options.moments = moments;
    return options;
}

/* A fit that knows something: with moments of all bands. */
static sf_fitter *fitter_of(sf_context *ctx, sf_scene *scene, int moments) {
    sf_fit_options options = fit_options(moments);
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
    for (int i = 0; i < 6; i++) assert_ok(ctx, sf_fitter_step(f));
    assert_int_equal(f->sh_degree, 3);
    return f;
}

/* All that belongs to one Gaussian. */
typedef struct belongings {
    uint32_t values[1 + SF_MOMENT_PARTS][SF_FIELD_COUNT][21];
    double screen_sum;
    uint32_t screen_seen;
} belongings;

static void gather(const sf_fitter *f, size_t i, belongings *b) {
    memset(b, 0, sizeof *b);
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        if (i >= f->model->banded[sf_field_band(field)]) continue;
        for (int part = 0; part <= SF_MOMENT_PARTS; part++) {
            const void *array =
                part ? f->moments.part[part - 1][field] : (const void *)f->model->params.field[field];
            int n = part ? sf_moment_components(&f->moments, part - 1, field) : sf_field_components(field);
            assert_true(!array == !n);
            for (int c = 0; c < n; c++)
                memcpy(&b->values[part][field][c], (const char *)array + 4 * sf_at(i, n, c), 4);
        }
    }
    b->screen_sum = f->densify.gradient_sum[i];
    b->screen_seen = f->densify.visible_count[i];
}

static belongings *gather_all(const sf_fitter *f) {
    belongings *all = calloc(f->model->count, sizeof *all);
    assert_non_null(all);
    for (size_t i = 0; i < f->model->count; i++) gather(f, i, &all[i]);
    return all;
}

/* What a Gaussian is when it has the bands up to a degree alone. */
static belongings cut(belongings b, int degree) {
    for (int part = 0; part <= SF_MOMENT_PARTS; part++)
        for (int field = SF_FIELD_sh0 + degree + 1; field < SF_FIELD_COUNT; field++)
            memset(b.values[part][field], 0, sizeof b.values[part][field]);
    return b;
}

/* Lanes behind the last that has a band are neutral, in whole blocks: kernels go over them. */
static void assert_neutral_behind(const sf_fitter *f) {
    const sf_model *m = f->model;
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        int n = sf_field_components(field), band = sf_field_band(field);
        if (field == SF_FIELD_log_scale) continue; /* limits go over all lanes */
        assert_true(m->banded[band] <= m->capacity[band]);
        for (size_t i = m->banded[band]; i < m->capacity[band]; i++)
            for (int c = 0; c < n; c++) {
                float neutral = field == SF_FIELD_quat && c == 0  ? 1
                                : field == SF_FIELD_logit_opacity ? -20
                                                                  : 0;
                assert_true(m->params.field[field][sf_at(i, n, c)] == neutral);
            }
        for (int part = 0; part < SF_MOMENT_PARTS; part++) {
            const uint32_t *words = f->moments.part[part][field];
            int parts = sf_moment_components(&f->moments, part, field);
            for (size_t i = m->banded[band]; i < m->capacity[band]; i++)
                for (int c = 0; c < parts; c++) assert_true(words[sf_at(i, parts, c)] == 0);
        }
    }
}

/* Places n Gaussians, drawn from those that there are, and checks each of them. */
static void check_arranged(sf_context *ctx, sf_fitter *f, size_t n, sf_rng *rng, int most) {
    sf_remap_entry *places = calloc(n + 1, sizeof *places);
    uint32_t *where = calloc(n + 1, sizeof *where);
    belongings *before = gather_all(f);
    uint8_t *taken = calloc(n + 1, 1);
    size_t expected[SF_BANDS] = {0};
    assert_true(places && where && taken);
    for (size_t k = 0; k < n; k++) {
        places[k] = (sf_remap_entry){(uint32_t)sf_rng_below(rng, f->model->count),
                                     (uint8_t)sf_rng_below(rng, (uint64_t)most + 1)};
        for (int band = 0; band <= places[k].degree; band++) expected[band]++;
    }
    assert_ok(ctx, sf_reorder(f, places, n, where));
    assert_int_equal(f->model->count, n);
    assert_memory_equal(f->model->banded, expected, sizeof expected);
    for (size_t k = 0; k < n; k++) {
        belongings now, then = cut(before[places[k].from], places[k].degree);
        assert_true(where[k] < n && !taken[where[k]]);
        taken[where[k]] = 1;
        gather(f, where[k], &now);
        assert_int_equal(sf_degree_of(f->model, where[k]), places[k].degree);
        assert_memory_equal(&now, &then, sizeof now);
        if (k && places[k].degree == places[k - 1].degree) assert_true(where[k] == where[k - 1] + 1);
    }
    assert_neutral_behind(f);
    free(places);
    free(where);
    free(before);
    free(taken);
}

static void check_arranging(int moments) {
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    assert_ok(ctx, sf_scene_load(ctx, SCENE, NULL, &scene));
    sf_fitter *f = fitter_of(ctx, scene, moments);
    static const struct {
        size_t n;
        int most;
    } turns[] = {{150, 3}, {290, 3}, {290, 0}, {37, 2}, {600, 3}, {16, 1}, {500, 3}};
    for (size_t t = 0; t < sizeof turns / sizeof *turns; t++) {
        check_arranged(ctx, f, turns[t].n, &rng, turns[t].most);
        assert_ok(ctx, sf_fitter_step(f));
        assert_neutral_behind(f);
    }
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_arrange(void **state) {
    (void)state;
    check_arranging(SF_MOMENTS_FLOAT);
    check_arranging(SF_MOMENTS_HALF);
}

/* Every other one is of degree 0, the others of degrees 0 to 3. */
static sf_remap_entry *mixed_places(const sf_fitter *f) {
    sf_remap_entry *places = calloc(f->model->count, sizeof *places);
    assert_non_null(places);
    for (size_t i = 0; i < f->model->count; i++)
        places[i] = (sf_remap_entry){(uint32_t)i, (uint8_t)(i % 2 ? 0 : i / 2 % 4)};
    return places;
}

static void mix(sf_context *ctx, sf_fitter *f) {
    sf_remap_entry *places = mixed_places(f);
    assert_ok(ctx, sf_reorder(f, places, f->model->count, NULL));
    free(places);
}

static double way_between(const belongings *all, size_t n) {
    double way = 0;
    for (size_t i = 1; i < n; i++) {
        double square = 0;
        for (int k = 0; k < 3; k++) {
            double step = (double)(sf_float_of(all[i].values[0][SF_FIELD_mean][k]) -
                                   sf_float_of(all[i - 1].values[0][SF_FIELD_mean][k]));
            square += step * step;
        }
        way += sqrt(square);
    }
    return way;
}

static int by_bytes(const void *a, const void *b) { return memcmp(a, b, sizeof(belongings)); }

/* Sorting moves whole Gaussians, so that those of a degree lie beside one another; few stay where they are.
 */
static void check_sorting(size_t n, int sorts) {
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, SCENE, NULL, &scene));
    sf_fitter *f = fitter_of(ctx, scene, SF_MOMENTS_FLOAT);
    sf_remap_entry *places = calloc(n, sizeof *places);
    assert_non_null(places);
    for (size_t k = 0; k < n; k++)
        places[k] = (sf_remap_entry){(uint32_t)(k * 7919 % f->model->count), (uint8_t)(k % 4)};
    assert_ok(ctx, sf_reorder(f, places, n, NULL));
    belongings *before = gather_all(f);
    assert_ok(ctx, sf_fitter_sort(f));
    belongings *after = gather_all(f);
    assert_int_equal(f->model->count, n);
    assert_neutral_behind(f);
    if (sorts)
        assert_true(way_between(after, n) < 0.5 * way_between(before, n));
    else
        assert_memory_equal(after, before, n * sizeof *before);
    qsort(before, n, sizeof *before, by_bytes);
    qsort(after, n, sizeof *after, by_bytes);
    assert_memory_equal(after, before, n * sizeof *before);
    free(places);
    free(before);
    free(after);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_sort(void **state) {
    (void)state;
    check_sorting(1500, 1);
    check_sorting(500, 0);
}

/* Bytes of a fit's model and its moments, which are floats. */
static size_t fitted_bytes(const size_t room[SF_BANDS]) {
    size_t bytes = 0;
    sf_optimizer_state moments = sf_optimizer_moments(SF_MOMENTS_FLOAT, 0);
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        int values = sf_field_components(field);
        for (int part = 0; part < SF_MOMENT_PARTS; part++)
            values += sf_moment_components(&moments, part, field);
        bytes += room[sf_field_band(field)] * (size_t)values * sizeof(float);
    }
    return bytes;
}

/* Model and moments take what the Gaussians have, and an arranging one array more. */
static void test_memory_of_fit(void **state) {
    (void)state;
    meter m;
    sf_context *ctx = metered(&m);
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, SCENE, NULL, &scene));
    sf_fitter *f = fitter_of(ctx, scene, SF_MOMENTS_FLOAT);
    size_t n = f->model->count, whole[SF_BANDS], others, before;
    for (int band = 0; band < SF_BANDS; band++) whole[band] = f->model->capacity[band];
    others = m.live - fitted_bytes(whole);
    m.peak = before = m.live;
    mix(ctx, f);
    assert_between(m.peak - before, 0, (21 + 6) * sizeof(float) * sf_blocks(n) * SF_LANES);
    assert_true(f->model->capacity[0] == whole[0]);
    for (int band = 1; band < SF_BANDS; band++)
        assert_true(f->model->capacity[band] <= 2 * f->model->banded[band] + 2 * SF_LANES);
    assert_about(m.live, others + fitted_bytes(f->model->capacity));
    sf_remap_entry *places = mixed_places(f);
    for (size_t i = 0; i < n; i++) places[i].degree = 0;
    assert_ok(ctx, sf_reorder(f, places, n, NULL));
    free(places);
    const size_t none[SF_BANDS] = {whole[0], 0, 0, 0};
    assert_about(m.live, others + fitted_bytes(none));
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Each allocation of an arranging fails in turn: all stays, or it is done. */
static void test_arrange_without_memory(void **state) {
    (void)state;
    meter m;
    sf_context *ctx = metered(&m);
    sf_scene *scene;
    int refused = 0;
    assert_ok(ctx, sf_scene_load(ctx, SCENE, NULL, &scene));
    sf_fitter *f = fitter_of(ctx, scene, SF_MOMENTS_FLOAT);
    mix(ctx, f);
    size_t n = f->model->count, more = f->model->capacity[0] + 40; /* all arrays grow */
    sf_remap_entry *places = calloc(more, sizeof *places);
    belongings *before = gather_all(f);
    assert_non_null(places);
    for (size_t k = 0; k < more; k++) places[k] = (sf_remap_entry){(uint32_t)(k * 7 % n), 3};
    for (long allowed = 0;; allowed++) {
        m.left = allowed;
        sf_status status = sf_reorder(f, places, more, NULL);
        m.left = -1;
        if (!status) break;
        refused++;
        assert_status(ctx, status, SF_ERR_MEMORY);
        assert_int_equal(f->model->count, n);
        belongings *after = gather_all(f);
        assert_memory_equal(after, before, n * sizeof *before);
        free(after);
        assert_neutral_behind(f);
    }
    assert_true(refused > 10);
    assert_int_equal(f->model->count, more);
    assert_neutral_behind(f);
    free(places);
    free(before);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What a fit of mixed degrees comes to: growth of all kinds, then steps. */
static void grow(int threads, int growth, const char *path) {
    sf_context *ctx = test_context_threads(threads);
    sf_scene *scene;
    sf_model *model;
    sf_fit_options options = fit_options(SF_MOMENTS_HALF);
    options.densify = growth;
    options.densify_every = 4;
    options.densify_start = 0;
    options.densify_per_step = 1e6;
    options.steps = test_is_quick() ? 12 : 30;
    assert_ok(ctx, sf_scene_load(ctx, SCENE, NULL, &scene));
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
    mix(ctx, f);
    size_t first = f->model->count, before[4], after[4];
    sf_model_degrees(f->model, before);
    assert_ok(ctx, sf_fitter_run(f, NULL, NULL));
    assert_neutral_behind(f);
    sf_model_degrees(f->model, after);
    assert_true(f->model->count > first);
    for (int degree = 0; degree < 4; degree++) /* children are of their parents' degree */
        assert_true(after[degree] > before[degree] / 2 && after[degree] < f->model->count);
    assert_ok(ctx, sf_fitter_snapshot(f, &model));
    assert_memory_equal(model->banded, f->model->banded, sizeof model->banded);
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_growth(void **state) {
    (void)state;
    for (int growth = SF_DENSIFY_GRADIENT; growth <= SF_DENSIFY_RELOCATE; growth++) {
        size_t size, other;
        grow(1, growth, test_path("one.ply"));
        grow(3, growth, test_path("more.ply"));
        uint8_t *a = test_read(test_path("one.ply"), &size), *b = test_read(test_path("more.ply"), &other);
        assert_int_equal(size, other);
        assert_memory_equal(a, b, size);
        free(a);
        free(b);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_as_if_padded),     cmocka_unit_test(test_pack),
        cmocka_unit_test(test_set_into_packed),  cmocka_unit_test(test_file),
        cmocka_unit_test(test_memory_of_packed), cmocka_unit_test(test_pack_without_memory),
        cmocka_unit_test(test_arrange),          cmocka_unit_test(test_sort),
        cmocka_unit_test(test_memory_of_fit),    cmocka_unit_test(test_arrange_without_memory),
        cmocka_unit_test(test_growth),
    };
    return cmocka_run_group_tests_name("degrees", tests, NULL, NULL);
}
