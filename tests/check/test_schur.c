/* test_schur.c - points taken out of the normal equations, at every level: the bytes of the specification,
 * and near sums in long double. */
#include "check.h"

#include <string.h>

enum { MOST = 12, VIEWS = 9, FREE_COUNTS = 5 };
static const size_t counts[FREE_COUNTS] = {0, 1, 2, 5, MOST};

typedef struct row {
    sf_schur_args args;
    const double *before;
} row;

static double some_number(check *c) {
    if (check_pick(c, 12) == 0) return 0;
    double value = check_magnitude(c, 1e-9, 1e9);
    return check_pick(c, 2) ? value : -value;
}

static void fill(check *c, double *numbers, size_t count) {
    for (size_t i = 0; i < count; i++) numbers[i] = some_number(c);
}

/* The views of a point are all different; some are not free, and some come after the row's. */
static void make_row(check *c, row *r) {
    size_t count = counts[c->seed / 2 % FREE_COUNTS];
    double *Y = check_input(c, "Y", 18, sizeof *Y, sizeof *Y);
    double *Z = check_input(c, "Z", 18 * count, sizeof *Z, sizeof *Z);
    uint32_t *rank = check_input(c, "rank", count, sizeof *rank, sizeof *rank);
    uint32_t last = (uint32_t)check_pick(c, VIEWS), views[VIEWS];
    uint32_t *table = check_input(c, "table", last + 1, sizeof *table, sizeof *table);
    double *before = check_input(c, "before", 36 * VIEWS, sizeof *before, sizeof *before);
    fill(c, Y, 18), fill(c, Z, 18 * count), fill(c, before, 36 * VIEWS);
    for (uint32_t i = 0; i < VIEWS; i++) views[i] = i;
    for (size_t i = VIEWS; i > 1; i--) {
        size_t other = check_pick(c, i);
        uint32_t kept = views[i - 1];
        views[i - 1] = views[other], views[other] = kept;
    }
    for (size_t i = 0; i < count; i++) rank[i] = i < VIEWS ? views[i] : UINT32_MAX;
    for (uint32_t i = 0; i <= last; i++) table[i] = (last - i + 3) % VIEWS; /* any order */
    r->before = before;
    r->args = (sf_schur_args){.Y = Y, .Z = Z, .rank = rank, .count = count, .last = last, .table = table};
    r->args.blocks = check_output(c, "blocks", 36 * VIEWS, sizeof *r->args.blocks, sizeof *r->args.blocks);
}

static void call_schur(const sf_kernels *kernels, void *args) { kernels->schur(&((row *)args)->args); }

static void compare(check *c, const row *r) {
    const sf_schur_args *a = &r->args;
    double want[36 * VIEWS];
    memcpy(want, r->before, sizeof want);
    for (size_t i = 0; i < a->count; i++)
        for (size_t k = 0; a->rank[i] <= a->last && k < 36; k++) {
            const double *Y = a->Y + k / 6, *Z = a->Z + 18 * i + k % 6;
            size_t at = 36 * a->table[a->rank[i]] + k;
            long double exact = (long double)want[at], sizes = fabsl(exact);
            for (int j = 0; j < 3; j++) {
                exact -= (long double)Y[6 * j] * (long double)Z[6 * j];
                sizes += fabsl((long double)Y[6 * j] * (long double)Z[6 * j]);
            }
            double first = Y[0] * Z[0], second = Y[6] * Z[6], third = Y[12] * Z[12], sum = first + second;
            sum = sum + third;
            want[at] = want[at] - sum;
            /* at most four roundings of what is no greater than the sizes' sum */
            check_that(c, fabsl((long double)a->blocks[at] - exact) <= 4 * sizes * 0x1p-53L,
                       "far from exact sums", at);
        }
    for (size_t i = 0; i < 36 * VIEWS; i++)
        check_that(c, memcmp(&a->blocks[i], &want[i], sizeof want[i]) == 0, "other bytes", i);
}

static void schur_case(check *c) {
    row r;
    make_row(c, &r);
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        memcpy(r.args.blocks, r.before, 36 * VIEWS * sizeof *r.before);
        if (check_call(c, 0, call_schur, &r)) compare(c, &r);
    }
}

static void points_are_taken_out(void **state) {
    (void)state;
    static const check_kernel kernel = {"schur", SF_KERNEL_schur};
    check_kernels(&kernel, 1, (size_t)(2 * FREE_COUNTS * 20), schur_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(points_are_taken_out)};
    return cmocka_run_group_tests_name("check schur", tests, NULL, NULL);
}
