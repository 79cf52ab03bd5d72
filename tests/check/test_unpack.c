/* test_unpack.c - a row of 8-bit pixels as floats, at every level against exact sums. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

static const int factors[] = {1, 2, 3, 4, 5, 6, 7, 8, 16, 64};
enum { FACTORS = sizeof factors / sizeof *factors };

static const int widths[] = {1,  2,  3,  4,  5,  7,  8,  9,  15, 16,  17,
                             31, 32, 33, 47, 48, 49, 63, 64, 65, 100, 257};
enum { WIDTHS = sizeof widths / sizeof *widths };

enum content { ANY, BLACK, WHITE, CONTENTS };

typedef struct row {
    uint8_t *src, *weight;
    size_t stride;
    int factor, width;
    float *dst;
} row;

static uint8_t *make_bytes(check *c, const char *name, const row *r) {
    size_t size = (size_t)(r->factor - 1) * r->stride + (size_t)(r->width * r->factor);
    enum content content = (enum content)check_pick(c, CONTENTS);
    uint8_t *bytes = check_input(c, name, size, 1, 1);
    for (size_t i = 0; i < size; i++)
        bytes[i] = content == ANY ? (uint8_t)check_pick(c, 256) : content == WHITE ? 255 : 0;
    return bytes;
}

static void call_unpack(const sf_kernels *kernels, void *args) {
    row *r = args;
    kernels->unpack(r->src, r->weight, r->stride, r->factor, r->dst, r->width);
}

/* The sums are exact, that of white, too; each is rounded to float32 and their quotient once more. */
static bounded mean(const row *r, int i) {
    uint64_t sum = 0, white = 0;
    for (int y = 0; y < r->factor; y++)
        for (int x = 0; x < r->factor; x++) {
            size_t at = (size_t)y * r->stride + (size_t)(i * r->factor + x);
            sum += (uint64_t)(r->src ? r->src[at] : 1) * (r->weight ? r->weight[at] : 1);
            white += (uint64_t)(r->src ? 255 : 1) * (r->weight ? 255 : 1);
        }
    return b_div(b_round((double)sum, 0), b_round((double)white, 0));
}

static void unpack_case(check *c) {
    row r = {.factor = factors[c->seed / 2 % FACTORS], .width = widths[c->seed / 2 / FACTORS % WIDTHS]};
    size_t which = check_pick(c, 3); /* pixels, weighted pixels, weights */
    r.stride = (size_t)(r.factor * r.width) + check_pick(c, 40);
    if (which < 2) r.src = make_bytes(c, "src", &r);
    if (which > 0) r.weight = make_bytes(c, "weight", &r);
    r.dst = check_floats_out(c, "dst", (size_t)r.width);
    for (size_t l = 0; l < c->level_count; l++) {
        check_at(c, l);
        if (!check_call(c, 0, call_unpack, &r)) continue;
        for (int i = 0; i < r.width; i++) {
            bounded want = mean(&r, i);
            check_near(c, "dst", (size_t)i, (double)r.dst[i], want);
            /* black and white are kept */
            check_that(c, r.dst[i] >= 0 && r.dst[i] <= 1 && (r.dst[i] == 0) == (want.v == 0), "beyond 0..1",
                       (size_t)i);
            check_that(c, want.v != 1 || r.dst[i] == 1, "white is not 1", (size_t)i);
        }
    }
}

static void unpack_agrees_with_exact_sums(void **state) {
    (void)state;
    static const check_kernel kernel = {"unpack", SF_KERNEL_unpack};
    check_kernels(&kernel, 1, 2 * FACTORS * WIDTHS, unpack_case);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(unpack_agrees_with_exact_sums)};
    return cmocka_run_group_tests_name("check unpack", tests, NULL, NULL);
}
