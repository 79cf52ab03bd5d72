/* test_extrema.c - the pixels of a row that no neighbour reaches, at every level, against all comparisons. */
#include "check.h"

#include <string.h>

static const int widths[] = {2, 3, 4, 5, 6, 7, 8, 9, 10, 15, 16, 17, 18, 19, 31, 33, 34, 63, 66, 100, 257};
enum { WIDTHS = sizeof widths / sizeof *widths };

/* What differences are: any; a few values, so that neighbours tie; all the same; waves with many extrema. */
enum content { ANY, FEW, SAME, WAVES, CONTENTS };

typedef struct row {
    sf_extrema_args args;
    size_t count;
} row;

static float some_value(check *c, enum content content, size_t row_at, int x) {
    switch (content) {
    case FEW:
        return (float)((int)check_pick(c, 5) - 2) * 0.5f;
    case SAME:
        return 0.75f;
    case WAVES:
        return (float)(sin(2.1 * x) * (row_at == 4 ? 1 : 0.5) + check_between(c, -0.1, 0.1));
    default:
        return (float)check_between(c, -1, 1);
    }
}

static void make_row(check *c, row *r) {
    uint64_t kind = c->seed / 2;
    int width = widths[kind % WIDTHS];
    enum content content = (enum content)(kind / WIDTHS % CONTENTS);
    r->args = (sf_extrema_args){.first = 1, .end = width, .threshold = (float)check_between(c, 0.1, 0.9)};
    if (check_pick(c, 2)) r->args.threshold = 0.5f; /* a value of FEW */
    if (check_pick(c, 2)) r->args.first = 1 + (int)check_pick(c, (size_t)width - 1);
    for (size_t i = 0; i < 9; i++) {
        float *values = check_floats_in(c, "row", (size_t)width + SF_LANES);
        for (int x = 0; x <= width; x++) values[x] = some_value(c, content, i, x);
        for (int x = width + 1; x < width + SF_LANES; x++) values[x] = x % 2 ? 9.0f : -9.0f;
        r->args.rows[i / 3][i % 3] = values;
    }
    r->args.columns =
        check_output(c, "columns", (size_t)(r->args.end - r->args.first), sizeof(uint32_t), sizeof(uint32_t));
}

static void call_extrema(const sf_kernels *kernels, void *args) {
    row *r = args;
    r->count = kernels->extrema(&r->args);
}

/* Beyond the threshold, on one side of all 26, and of those that are the same the first. */
static int is_extremum(const sf_extrema_args *a, int x) {
    float value = a->rows[1][1][x];
    int higher = 0, lower = 0, same_before = 0;
    if (fabsf(value) < a->threshold) return 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = -1; k <= 1; k++) {
                int order = (i - 1) * 9 + (j - 1) * 3 + k;
                float other = a->rows[i][j][x + k];
                if (order == 0) continue;
                higher += other > value;
                lower += other < value;
                same_before += other == value && order < 0;
            }
    return !same_before && !(value > 0 ? higher : lower);
}

static void extrema_case(check *c) {
    row r;
    make_row(c, &r);
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (!check_call(c, 0, call_extrema, &r)) continue;
        size_t n = 0;
        for (int x = r.args.first; x < r.args.end; x++)
            if (is_extremum(&r.args, x)) {
                check_that(c, n < r.count && r.args.columns[n] == (uint32_t)x, "an extremum is not listed",
                           (size_t)x);
                n++;
            }
        check_that(c, n == r.count, "more are listed than there are", n);
    }
}

static void extrema_are_those_of_all_comparisons(void **state) {
    (void)state;
    static const check_kernel kernel = {"extrema", SF_KERNEL_extrema};
    check_kernels(&kernel, 1, (size_t)(2 * WIDTHS * CONTENTS * 6), extrema_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(extrema_are_those_of_all_comparisons)};
    return cmocka_run_group_tests_name("check extrema", tests, NULL, NULL);
}
