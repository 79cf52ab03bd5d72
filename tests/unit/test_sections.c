/* test_sections.c - files of named arrays: what was put in comes out, and nothing else is taken for it. */
#include "testing.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/sections.h"

static const sf_sections_kind kind = {"SFTESTED", 3, "a file of this test"};

static sf_sections_out begin(sf_context *ctx, const char *path) {
    sf_sections_out out;
    assert_ok(ctx, sf_sections_create(&out, ctx, path, &kind));
    return out;
}

static void assert_opens_not(sf_context *ctx, const char *path, sf_status status, const char *part) {
    sf_sections_in in;
    assert_status(ctx, sf_sections_open(&in, ctx, path, &kind), status);
    assert_error_names(ctx, path);
    assert_error_names(ctx, part);
}

/* Elements of all sizes, more than a piece of them, and none. */
static void test_what_was_put_comes_out(void **state) {
    (void)state;
    enum { MANY = 2 * SF_SECTION_PIECE / 8 + 5 };
    sf_context *ctx = test_context();
    const char *path = test_path("good");
    const uint16_t two[] = {1, 0xfffe};
    uint16_t two_back[2];
    uint64_t *many = calloc(MANY, sizeof *many), *back;
    size_t count;
    assert_non_null(many);
    for (size_t i = 0; i < MANY; i++) many[i] = i * 0x9e3779b97f4a7c15u;
    sf_sections_out out = begin(ctx, path);
    sf_sections_put(&out, "text", "abc", 3, 1);
    sf_sections_put(&out, "two", two, 2, sizeof *two);
    sf_sections_put(&out, "many", many, MANY, sizeof *many);
    sf_sections_put(&out, "none", NULL, 0, 4);
    assert_ok(ctx, sf_sections_commit(&out));

    sf_sections_in in;
    char text[3];
    assert_ok(ctx, sf_sections_open(&in, ctx, path, &kind));
    assert_ok(ctx, sf_sections_take_new(&in, "many", &back, &count, MANY, sizeof *back));
    assert_int_equal(count, MANY);
    assert_memory_equal(back, many, MANY * sizeof *many);
    assert_ok(ctx, sf_sections_take(&in, "two", two_back, 2, sizeof *two_back));
    assert_memory_equal(two_back, two, sizeof two);
    assert_ok(ctx, sf_sections_take(&in, "none", NULL, 0, 4));
    assert_status(ctx, sf_sections_all_taken(&in), SF_ERR_UNSUPPORTED);
    assert_error_names(ctx, "text");
    assert_ok(ctx, sf_sections_take(&in, "text", text, 3, 1));
    assert_memory_equal(text, "abc", 3);
    assert_ok(ctx, sf_sections_all_taken(&in));
    sf_sections_close(&in);
    sf_free(ctx, back);
    free(many);
    sf_context_destroy(&ctx);
}

/* What a reader expects and what is there differ: the section and both figures are named. */
static void test_other_arrays_than_expected(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path = test_path("other");
    const float three[3] = {1, 2, 3};
    float back[8];
    void *block = NULL;
    size_t count;
    sf_sections_out out = begin(ctx, path);
    sf_sections_put(&out, "three", three, 3, sizeof *three);
    assert_ok(ctx, sf_sections_commit(&out));

    sf_sections_in in;
    assert_ok(ctx, sf_sections_open(&in, ctx, path, &kind));
    assert_status(ctx, sf_sections_take(&in, "four", back, 4, 4), SF_ERR_FORMAT);
    assert_error_names(ctx, "section four: is missing");
    assert_status(ctx, sf_sections_take(&in, "three", back, 3, 8), SF_ERR_FORMAT);
    assert_error_names(ctx, "section three: elements of 4 bytes, not of 8");
    assert_status(ctx, sf_sections_take(&in, "three", back, 4, 4), SF_ERR_FORMAT);
    assert_error_names(ctx, "section three: 3 elements, not 4");
    assert_status(ctx, sf_sections_take_new(&in, "three", &block, &count, 2, 4), SF_ERR_FORMAT);
    assert_error_names(ctx, "section three: 3 elements are more than 2");
    assert_null(block);
    assert_ok(ctx, sf_sections_take(&in, "three", back, 3, 4));
    sf_sections_close(&in);
    sf_context_destroy(&ctx);
}

/* Files whose checksums are right, and whose tables are not. */
static void test_impossible_tables(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path = test_path("impossible");
    const uint8_t bytes[3] = {1, 2, 3};
    uint64_t others = 7;

    sf_sections_out out = begin(ctx, path);
    sf_sections_put(&out, "odd", bytes, 1, 3);
    assert_ok(ctx, sf_sections_commit(&out));
    assert_opens_not(ctx, path, SF_ERR_FORMAT, "section odd: elements are not of 1, 2, 4 or 8 bytes");

    out = begin(ctx, path);
    sf_sections_put(&out, "one", bytes, 1, 1);
    sf_sections_put(&out, "end", &others, 1, sizeof others);
    assert_ok(ctx, sf_writer_commit(&out.writer));
    assert_opens_not(ctx, path, SF_ERR_FORMAT, "sections: 1, not the 7 announced");

    out = begin(ctx, path);
    sf_sections_put(&out, "end", bytes, 3, 1);
    assert_ok(ctx, sf_writer_commit(&out.writer));
    assert_opens_not(ctx, path, SF_ERR_FORMAT, "section end: elements of 1 bytes, not of 8");

    out = begin(ctx, path);
    for (int i = 0; i < SF_SECTIONS_MOST; i++) {
        char name[SF_SECTION_NAME];
        snprintf(name, sizeof name, "part.%d", i);
        sf_sections_put(&out, name, bytes, 3, 1);
    }
    assert_ok(ctx, sf_sections_commit(&out));
    assert_opens_not(ctx, path, SF_ERR_FORMAT, "more than 128 sections");
    sf_context_destroy(&ctx);
}

/* Cut anywhere, or with any byte changed, it is refused, and says so at the latest when the section is taken.
 */
static void test_damage_is_noticed(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const char *path = test_path("damaged");
    const uint32_t values[2] = {5, 6};
    size_t size;
    sf_sections_out out = begin(ctx, path);
    sf_sections_put(&out, "values", values, 2, sizeof *values);
    assert_ok(ctx, sf_sections_commit(&out));
    uint8_t *whole = test_read(path, &size);
    for (size_t i = 0; i < 2 * size; i++) {
        uint32_t back[2];
        sf_sections_in in;
        if (i >= size) whole[i - size] ^= 0x10;
        test_write(path, whole, i < size ? i : size);
        if (i >= size) whole[i - size] ^= 0x10;
        sf_status status = sf_sections_open(&in, ctx, path, &kind);
        if (!status) {
            status = sf_sections_take(&in, "values", back, 2, sizeof *back);
            sf_sections_close(&in);
        }
        if (status != SF_ERR_FORMAT) fail_msg("%zu of %zu: status %d", i, size, (int)status);
        assert_error_names(ctx, path);
    }
    free(whole);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_what_was_put_comes_out),
        cmocka_unit_test(test_other_arrays_than_expected),
        cmocka_unit_test(test_impossible_tables),
        cmocka_unit_test(test_damage_is_noticed),
    };
    return cmocka_run_group_tests_name("sections", tests, NULL, NULL);
}
