/* test_match.c - products of descriptors and the best two of rows and columns, at every level and with what
 * some processors add to it, against exact sums. */
#include "check.h"

#include <string.h>

static const size_t row_counts[] = {8, 16, 24, 40}, column_counts[] = {32, 64, 96, 160};
enum { ROW_COUNTS = 4, COLUMN_COUNTS = 4, MOST_ROWS = 40, MOST_COLUMNS = 160 };

/* What bytes are: any; the greatest; a few values, so that products tie; 0. */
enum content { ANY, GREATEST, FEW, NOTHING, CONTENTS };

typedef struct sets {
    sf_match_args args;
    uint32_t products[MOST_ROWS][MOST_COLUMNS];
} sets;

static uint8_t some_byte(check *c, enum content content) {
    switch (content) {
    case GREATEST:
        return SF_MATCH_MOST;
    case FEW:
        return (uint8_t)(check_pick(c, 40) == 0);
    case NOTHING:
        return 0;
    default:
        return (uint8_t)check_pick(c, SF_MATCH_MOST + 1);
    }
}

static void make_sets(check *c, sets *s) {
    uint64_t kind = c->seed / 2;
    size_t rows = row_counts[kind % ROW_COUNTS], columns = column_counts[kind / ROW_COUNTS % COLUMN_COUNTS];
    enum content content_a = (enum content)check_pick(c, CONTENTS),
                 content_b = (enum content)check_pick(c, CONTENTS);
    uint8_t *a = check_input(c, "a", rows, SF_DESCRIPTOR, 64);
    uint8_t *b = check_input(c, "b", columns, SF_DESCRIPTOR, 64);
    for (size_t i = 0; i < rows * SF_DESCRIPTOR; i++) a[i] = some_byte(c, content_a);
    for (size_t j = 0; j < columns; j++)
        for (size_t k = 0; k < SF_DESCRIPTOR; k++)
            b[(j / SF_LANES * (SF_DESCRIPTOR / 4) + k / 4) * 4 * SF_LANES + j % SF_LANES * 4 + k % 4] =
                some_byte(c, content_b);
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < columns; j++) {
            s->products[i][j] = 0;
            for (size_t k = 0; k < SF_DESCRIPTOR; k++) {
                size_t at = (j / SF_LANES * (SF_DESCRIPTOR / 4) + k / 4) * 4 * SF_LANES + j % SF_LANES * 4;
                s->products[i][j] += (uint32_t)a[i * SF_DESCRIPTOR + k] * b[at + k % 4];
            }
        }
    s->args = (sf_match_args){.a = a, .b = b, .rows = rows, .columns = columns};
    s->args.row_best = check_output(c, "row_best", rows, sizeof(uint32_t), sizeof(uint32_t));
    s->args.row_second = check_output(c, "row_second", rows, sizeof(uint32_t), sizeof(uint32_t));
    s->args.column_best = check_output(c, "column_best", columns, sizeof(uint32_t), 64);
    s->args.column_second = check_output(c, "column_second", columns, sizeof(uint32_t), 64);
}

static void call_match(const sf_kernels *kernels, void *args) {
    const sets *s = args;
    kernels->match(&s->args);
}

/* The level's own file, without what the processor adds. */
static void call_plain(const sf_kernels *kernels, void *args) {
    unsigned mask = 0;
    sf_kernels plain;
    assert_int_equal(sf_cpu_choose(kernels->isa, &mask), SF_OK);
    sf_kernels_init(&plain, mask & ~(unsigned)(SF_CPU_VNNI | SF_CPU_DOT));
    call_match(&plain, args);
}

/* Keys are those of the greatest and the second of `count` products, `step` apart; of equal ones, the first.
 */
static int are_best(const uint32_t *products, size_t count, size_t step, uint32_t best, uint32_t second) {
    size_t first = 0;
    for (size_t i = 1; i < count; i++)
        if (products[i * step] > products[first * step]) first = i;
    size_t next = first ? 0 : 1;
    for (size_t i = 0; i < count; i++)
        if (i != first && products[i * step] > products[next * step]) next = i;
    return best == sf_match_key(products[first * step], (uint32_t)first) &&
           second == sf_match_key(products[next * step], (uint32_t)next);
}

static void check_sets(check *c, const sets *s) {
    const sf_match_args *a = &s->args;
    for (size_t i = 0; i < a->rows; i++)
        check_that(c, are_best(s->products[i], a->columns, 1, a->row_best[i], a->row_second[i]), "of a row",
                   i);
    for (size_t j = 0; j < a->columns; j++)
        check_that(
            c, are_best(&s->products[0][j], a->rows, MOST_COLUMNS, a->column_best[j], a->column_second[j]),
            "of a column", j);
}

static void match_case(check *c) {
    static sets s;
    make_sets(c, &s);
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (check_call(c, 0, call_match, &s)) check_sets(c, &s);
        check_at(c, l);
        if (check_call(c, 0, call_plain, &s)) check_sets(c, &s);
    }
}

static void products_are_exact(void **state) {
    (void)state;
    static const check_kernel kernel = {"match", SF_KERNEL_match};
    check_kernels(&kernel, 1, (size_t)(2 * ROW_COUNTS * COLUMN_COUNTS * 6), match_case);
}

/* As many rows and columns as a block has: all bits of the index. */
static void a_whole_block_is_exact(void **state) {
    (void)state;
    static _Alignas(64) uint8_t a[SF_MATCH_BLOCK][SF_DESCRIPTOR], b[SF_MATCH_BLOCK * SF_DESCRIPTOR];
    static _Alignas(64) uint32_t keys[4][SF_MATCH_BLOCK];
    sf_isa_info info;
    a[SF_MATCH_BLOCK - 1][5] = b[1 * 4 * SF_LANES + 1] = 3; /* the last row, the first column */
    a[0][127] = b[sizeof b - 1] = 1;                        /* the first, the last */
    for (size_t i = 0; !sf_isa_describe(i, &info); i++) {
        unsigned mask;
        sf_kernels kernels;
        if (sf_cpu_choose(info.name, &mask)) continue;
        sf_kernels_init(&kernels, mask);
        sf_match_args args = {a[0], b, SF_MATCH_BLOCK, SF_MATCH_BLOCK, keys[0], keys[1], keys[2], keys[3]};
        kernels.match(&args);
        assert_int_equal(keys[0][SF_MATCH_BLOCK - 1], sf_match_key(9, 0));
        assert_int_equal(keys[0][0], sf_match_key(1, SF_MATCH_BLOCK - 1));
        assert_int_equal(keys[1][0], sf_match_key(0, 0));
        assert_int_equal(keys[2][0], sf_match_key(9, SF_MATCH_BLOCK - 1));
        assert_int_equal(keys[3][0], sf_match_key(0, 0));
        assert_int_equal(keys[2][SF_MATCH_BLOCK - 1], sf_match_key(1, 0));
        assert_int_equal(keys[0][7], sf_match_key(0, 0));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(products_are_exact),
                                       cmocka_unit_test(a_whole_block_is_exact)};
    return cmocka_run_group_tests_name("check match", tests, NULL, NULL);
}
