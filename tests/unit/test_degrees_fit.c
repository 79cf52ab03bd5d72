/* test_degrees_fit.c - how a fit rearranges Gaussians of several SH degrees. */
#include "degrees_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/optimizer_state.h"
#include "fit/reorder.h"
#include "reference/random.h"

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
    sf_context *ctx = degrees_metered(&m);
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
    degrees_assert_about(m.live, others + fitted_bytes(f->model->capacity));
    sf_remap_entry *places = mixed_places(f);
    for (size_t i = 0; i < n; i++) places[i].degree = 0;
    assert_ok(ctx, sf_reorder(f, places, n, NULL));
    free(places);
    const size_t none[SF_BANDS] = {whole[0], 0, 0, 0};
    degrees_assert_about(m.live, others + fitted_bytes(none));
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Each allocation of an arranging fails in turn: all stays, or it is done. */
static void test_arrange_without_memory(void **state) {
    (void)state;
    meter m;
    sf_context *ctx = degrees_metered(&m);
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
        cmocka_unit_test(test_arrange),       cmocka_unit_test(test_sort),
        cmocka_unit_test(test_memory_of_fit), cmocka_unit_test(test_arrange_without_memory),
        cmocka_unit_test(test_growth),
    };
    return cmocka_run_group_tests_name("degrees_fit", tests, NULL, NULL);
}
