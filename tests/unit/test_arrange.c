/* test_arrange.c - reordering Gaussians: any order, also of more Gaussians than the scratch memory holds, in
 * either direction; and the curve that sorts them. */
#include "testing.h"

#include <math.h>

#include "base/rng.h"
#include "scene/curve.h"
#include "scene/gaussians.h"

enum { MANY = 20000 };

/* A value that tells what it is of. */
static float mark_of(int field, size_t i, int c) { return (float)(i + 1) + (float)(field * 64 + c) / 1024; }

/* `had` Gaussians, a half with band 1, with room for `room`. */
static sf_model *marked(sf_context *ctx, size_t had, size_t room) {
    const size_t banded[SF_BANDS] = {had, had / 2};
    sf_model *model;
    assert_ok(ctx, sf_model_create_banded(ctx, banded, room, 1, &model));
    assert_ok(ctx, sf_model_set_room(model, 1, room));
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (size_t i = 0; i < banded[sf_field_band(field)]; i++)
            for (int c = 0; c < sf_field_components(field); c++)
                *sf_value(&model->params, field, i, c) = mark_of(field, i, c);
    return model;
}

/* Whether each of n Gaussians has the values of its entry, also in an array of plain values. */
static void assert_moved(const sf_model *model, const sf_remap_entry *entries, const uint32_t *where,
                         const double *values, size_t had) {
    for (size_t k = 0; k < model->count; k++) {
        size_t i = where[k], from = entries[k].from;
        assert_int_equal(sf_degree_of(model, i), entries[k].degree);
        assert_true(values[i] == (double)from);
        for (int field = 0; field <= SF_FIELD_sh1; field++)
            for (int c = 0; c < sf_field_components(field); c++) {
                int lacks = field == SF_FIELD_sh1 && from >= had / 2;
                if (field == SF_FIELD_sh1 && !entries[k].degree) continue;
                float expected = lacks ? 0 : mark_of(field, from, c);
                assert_true(*sf_value(&model->params, field, i, c) == expected);
            }
    }
    for (size_t i = model->banded[1]; i < model->capacity[1]; i++)
        for (int c = 0; c < 9; c++) assert_true(*sf_value(&model->params, SF_FIELD_sh1, i, c) == 0);
    for (size_t i = model->count; i < model->capacity[0]; i++)
        assert_true(*sf_value(&model->params, SF_FIELD_quat, i, 0) == 1);
}

typedef sf_status (*create_fn)(sf_context *, const sf_remap_entry *, size_t, uint32_t *, sf_order *);

/* Reorders `had` Gaussians to n entries, of a hash of k from `near` off the place in step, or from anywhere.
 */
static void move(create_fn create, size_t had, size_t n, size_t near, int threads) {
    sf_context *ctx = test_context_threads(threads);
    sf_model *model = marked(ctx, had, MANY);
    sf_remap_entry *entries = sf_alloc(ctx, n, sizeof *entries);
    uint32_t *where = sf_alloc(ctx, n, sizeof *where);
    double *values = sf_calloc(ctx, MANY, sizeof *values);
    sf_order order;
    sf_rng rng;
    sf_rng_seed(&rng, had + 3 * n + near);
    for (size_t i = 0; i < had; i++) values[i] = (double)i;
    for (size_t k = 0; k < n; k++) {
        size_t at = k * had / n, off = (size_t)(sf_rng_uniform(&rng) * (double)(near ? near : had));
        size_t from = (at + off) % had;
        uint8_t degree = (from < had / 2) != (sf_rng_uniform(&rng) < 0.02);
        entries[k] = (sf_remap_entry){(uint32_t)from, degree};
    }
    assert_ok(ctx, create(ctx, entries, n, where, &order));
    assert_ok(ctx, sf_order_prepare(ctx, &order));
    sf_order_add_values(&order, values, sizeof *values, had);
    sf_model_reorder(model, &order);
    assert_int_equal(model->count, n);
    assert_moved(model, entries, where, values, had);
    for (size_t i = n; i < MANY; i++) assert_true(values[i] == 0);
    sf_order_free(ctx, &order);
    sf_free(ctx, entries);
    sf_free(ctx, where);
    sf_free(ctx, values);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_any_order(void **state) {
    (void)state;
    const create_fn creates[] = {sf_order_create, sf_order_create_in_place};
    for (int c = 0; c < 2; c++)
        for (int threads = 1; threads <= 3; threads += 2) {
            move(creates[c], 1, 1, 0, threads);
            move(creates[c], 100, 37, 5, threads);
            move(creates[c], MANY, 15001, 0, threads);  /* anywhere */
            move(creates[c], MANY, 15001, 30, threads); /* fewer: from further on */
            move(creates[c], 12001, MANY, 30, threads); /* more: from before */
        }
}

/* In place, those that stay move nowhere. */
static void test_in_place(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_remap_entry entries[] = {{0, 1}, {2, 1}, {3, 0}, {5, 0}, {2, 1}, {5, 0}};
    uint32_t where[6];
    sf_order order; /* of six: 0 to 2 had degree 1; 1 and 4 go, 2 and 5 are copied */
    assert_ok(ctx, sf_order_create_in_place(ctx, entries, 6, where, &order));
    const uint32_t expected[] = {0, 2, 3, 5, 1, 4};
    assert_memory_equal(where, expected, sizeof expected);
    sf_order_free(ctx, &order);
    sf_context_destroy(&ctx);
}

/* Along Hilbert's curve, each point of a grid is beside the one before. Equal points stay in order. Those of
 * a higher class come first. */
static void test_curve(void **state) {
    (void)state;
    enum { SIDE = 32, GRID = SIDE * SIDE * SIDE, N = 3 * GRID };
    for (int threads = 1; threads <= 3; threads += 2) {
        sf_context *ctx = test_context_threads(threads);
        float *xyz = sf_calloc(ctx, 3 * N, sizeof *xyz);
        uint8_t *classes = sf_alloc(ctx, N, 1);
        uint32_t *order;
        for (size_t i = 0; i < N; i++) {
            size_t at = i * 7919 % GRID;
            for (size_t k = 0; k < 3; k++, at /= SIDE) xyz[3 * i + k] = (float)(at % SIDE);
            classes[i] = i >= 2 * GRID;
        }
        assert_ok(ctx, sf_curve_order(ctx, xyz, N, classes, &order));
        for (size_t k = 1; k < N; k++) {
            size_t a = order[k - 1], b = order[k];
            float apart = 0;
            for (size_t c = 0; c < 3; c++) apart += fabsf(xyz[3 * a + c] - xyz[3 * b + c]);
            assert_int_equal(classes[b], k < GRID);
            if (k == GRID) continue;
            assert_true(apart == (float)(k < GRID || k % 2 == 0));
            assert_true(apart == 1 || a < b);
        }
        sf_free(ctx, order);
        sf_free(ctx, classes);
        sf_free(ctx, xyz);
        sf_context_destroy(&ctx);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_any_order),
        cmocka_unit_test(test_in_place),
        cmocka_unit_test(test_curve),
    };
    return cmocka_run_group_tests_name("arrange", tests, NULL, NULL);
}
