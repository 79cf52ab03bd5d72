/* test_hostile.c - every parser reads what is right, what once went wrong, and what is nearly right. */
#include "testing.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "fuzz/fuzz.h"

static char at_work[800]; /* the input */

static void report(const char *what) { fail_msg("%s: %s", at_work, what); }

typedef void (*use_fn)(const fuzz_target *target, const uint8_t *data, size_t size);

/* Every input FOLDER/<target>/<name>, by name; how many there are. */
static int for_each(const char *folder, use_fn use) {
    int count = 0;
    for (size_t i = 0; fuzz_target_at(i); i++) {
        const fuzz_target *target = fuzz_target_at(i);
        char path[512];
        struct dirent **entries;
        snprintf(path, sizeof path, "%s/%s", folder, target->name);
        int n = scandir(path, &entries, NULL, alphasort);
        for (int k = 0; k < n; k++) {
            size_t size;
            if (*entries[k]->d_name != '.') {
                snprintf(at_work, sizeof at_work, "%s/%s", path, entries[k]->d_name);
                uint8_t *data = test_read(at_work, &size);
                use(target, data, size);
                free(data);
                count++;
            }
            free(entries[k]);
        }
        if (n >= 0) free(entries);
    }
    return count;
}

static void must_be_taken(const fuzz_target *target, const uint8_t *data, size_t size) {
    if (!target->run(data, size)) fail_msg("%s: is right, but was refused: %s", at_work, fuzz_last_error());
}

static void may_be_refused(const fuzz_target *target, const uint8_t *data, size_t size) {
    target->run(data, size);
}

static uint8_t *copy_of(const uint8_t *data, size_t size) {
    uint8_t *copy = malloc(size + 1);
    assert_non_null(copy);
    memcpy(copy, data, size);
    return copy;
}

/* Cut off, or with some bytes changed, and with checksums that are right nevertheless. */
static void change(const fuzz_target *target, const uint8_t *data, size_t size) {
    enum { MOST_CHANGES = 4 };
    const int variants = getenv("SPLATFIT_QUICK") ? 2 : 24;
    static const uint8_t edges[] = {0, 1, 0x7f, 0x80, 0xff, ' ', '-', '9'};
    sf_rng rng;
    sf_rng_seed(&rng, size);
    for (int i = 0; i < variants && size; i++) {
        uint8_t *copy = copy_of(data, size);
        size_t length = i % 4 ? size : sf_rng_next(&rng) % size;
        for (uint64_t k = 0; i % 4 && k <= sf_rng_next(&rng) % MOST_CHANGES; k++)
            copy[sf_rng_next(&rng) % size] = edges[sf_rng_next(&rng) % sizeof edges];
        if (target->repair && i % 4 != 1) target->repair(copy, length);
        target->run(copy, length);
        free(copy);
    }
}

static char seeds[512];

static void test_right_inputs(void **state) {
    (void)state;
    fuzz_write_seeds(seeds);
    assert_between(for_each(seeds, must_be_taken), 20, 1000);
    assert_between(for_each("tests/fuzz/corpus", must_be_taken), 20, 1000);
}

static void test_found_inputs(void **state) {
    (void)state;
    assert_between(for_each("tests/fuzz/found", may_be_refused), 5, 1000);
}

static void test_changed_inputs(void **state) {
    (void)state;
    assert_between(for_each(seeds, change), 20, 1000);
    assert_between(for_each("tests/fuzz/corpus", change), 20, 1000);
}

/* Numbers that stand in checkpoints, with sums that are right: none may be believed for its own sake. */

static void try_numbers(const fuzz_target *target, const uint8_t *data, size_t size, size_t at,
                        size_t element) {
    static const uint64_t wide[] = {0,
                                    1,
                                    0x7fffffff,
                                    0x100000000,
                                    0x7fffffffffffffff,
                                    0xffffffffffffffff,
                                    0x43e158e460913d00 /* 1e19 */,
                                    0x7fe1ccf385ebc8a0 /* 1e308 */,
                                    0x7ff0000000000000 /* infinity */},
                          narrow[] = {0, 1, 0x7fffffff, 0xffffffff, 0x7f7fffff, 0x7f800000};
    const uint64_t *values = element == 8 ? wide : narrow;
    size_t count = element == 8 ? sizeof wide / sizeof *wide : sizeof narrow / sizeof *narrow;
    for (size_t i = 0; i < count; i++) {
        uint8_t *copy = copy_of(data, size);
        fuzz_store(copy + at, values[i], element);
        target->repair(copy, size);
        target->run(copy, size);
        free(copy);
    }
}

/* How many elements of a section are tried: of those that are counts, places and sizes. */
static size_t elements_to_try(const char *name) {
    static const struct {
        const char *name;
        size_t elements;
    } sections[] = {{"integers", 18},      {"order", 2},         {"learned.places", 4},
                    {"learned.lenses", 3}, {"learned.views", 4}, {"model", 2},
                    {"model.banded", 4},   {"best.banded", 4},   {"known", 1}};
    for (size_t i = 0; i < sizeof sections / sizeof *sections; i++)
        if (!strcmp(name, sections[i].name)) return sections[i].elements;
    return 0;
}

static int checkpoints;

static void change_numbers(const fuzz_target *target, const uint8_t *data, size_t size) {
    const size_t step = getenv("SPLATFIT_QUICK") ? 8 : 1;
    size_t tried = 0, at = FUZZ_FILE_HEADER;
    fuzz_section s;
    if (strcmp(target->name, "checkpoint") != 0) return;
    for (; fuzz_section_at(data, size, at, &s); at = fuzz_section_end(&s)) {
        char name[SF_SECTION_NAME + 1] = "";
        memcpy(name, data + at, SF_SECTION_NAME);
        size_t most = elements_to_try(name), from = at + FUZZ_SECTION_HEADER;
        for (size_t i = 0; i < s.count && i < most; i++)
            if (tried++ % step == 0) try_numbers(target, data, size, from + i * s.element, s.element);
    }
    assert_int_equal(at, size);
    assert_between(tried, 20, 100);
    checkpoints++;
}

static void test_extreme_numbers(void **state) {
    (void)state;
    checkpoints = 0;
    for_each(seeds, change_numbers);
    assert_between(checkpoints, 2, 100);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_right_inputs),
        cmocka_unit_test(test_found_inputs),
        cmocka_unit_test(test_changed_inputs),
        cmocka_unit_test(test_extreme_numbers),
    };
    fuzz_failed = report;
    snprintf(seeds, sizeof seeds, "%s", test_path("seeds"));
    return cmocka_run_group_tests(tests, NULL, NULL);
}
