/* test_options.c - hyperparameters by name: defaults, ranges, text in and out. */
#include "testing.h"

#include "fit/options.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Field by field: a struct has padding. */
static void assert_same_options(const sf_fit_options *a, const sf_fit_options *b) {
#define SAME(name, ...)                                                                                      \
    if (!(a->name == b->name)) fail_msg("%s differs: %g and %g", #name, (double)a->name, (double)b->name);
    SF_FIT_OPTIONS(SAME, SAME, SAME, SAME)
#undef SAME
}

static void assert_set(sf_context *ctx, sf_fit_options *options, const char *name, const char *text) {
    if (sf_fit_options_set(ctx, options, name, text))
        fail_msg("%s = \"%s\": %s", name, text, sf_last_error(ctx));
}

/* Refused with the name in the message, and nothing changed. */
static void assert_refused(sf_context *ctx, const char *name, const char *text, const char *part) {
    sf_fit_options options = sf_fit_options_default(), before = options;
    if (sf_fit_options_set(ctx, &options, name, text) != SF_ERR_ARGUMENT)
        fail_msg("%s = \"%s\" is not refused", name, text);
    assert_error_names(ctx, name);
    assert_error_names(ctx, part);
    assert_same_options(&options, &before);
}

static void test_list(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_fit_options defaults = sf_fit_options_default();
    assert_ok(ctx, sf_fit_options_check(ctx, &defaults));
    sf_option_info info, other;
    size_t count = 0;
    for (; !sf_fit_option_info(count, &info); count++) {
        if (!(info.least <= info.value && info.value <= info.most))
            fail_msg("%s: default %g is not in %g..%g", info.name, info.value, info.least, info.most);
        assert_true(info.least < info.most);
        assert_true(strlen(info.text) > 0);
        assert_non_null(info.unit);
        for (size_t i = 0; i < count; i++) {
            assert_int_equal(sf_fit_option_info(i, &other), SF_OK);
            assert_string_not_equal(info.name, other.name);
        }
    }
#define ONE(...) +1
    assert_int_equal(count, 0 SF_FIT_OPTIONS(ONE, ONE, ONE, ONE));
#undef ONE
    assert_int_equal(sf_fit_option_info(count, &info), SF_ERR_END);
    assert_int_equal(sf_fit_option_info(SIZE_MAX, &info), SF_ERR_END);
    sf_context_destroy(&ctx);
}

/* The info of each option says what the struct's defaults are. */
static void test_defaults_as_text(void **state) {
    (void)state;
    sf_fit_options defaults = sf_fit_options_default();
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char text[64], *end;
        assert_int_equal(sf_fit_options_get(&defaults, info.name, text, sizeof text), SF_OK);
        if (info.kind == SF_KIND_ENUM) {
            assert_memory_equal(text, info.unit, strlen(text)); /* the first of the values */
            continue;
        }
        assert_true(strtod(text, &end) == info.value);
        assert_int_equal(*end, 0);
    }
}

static void text_of(const sf_option_info *info, double value, char *text, size_t size) {
    if (info->kind == SF_KIND_REAL)
        snprintf(text, size, "%.17g", value);
    else
        snprintf(text, size, "%" PRId64, value >= 0x1p63 ? INT64_MAX : (int64_t)value);
}

/* Both ends of every range are set, come back as text, and set the same again. */
static void test_round_trip(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int end = 0; end < 2; end++) {
        sf_fit_options a = sf_fit_options_default(), b = a;
        sf_option_info info;
        for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
            char text[64], again[64];
            if (info.kind == SF_KIND_ENUM) continue;
            text_of(&info, end ? info.most : info.least, text, sizeof text);
            assert_set(ctx, &a, info.name, text);
            assert_ok(ctx, sf_fit_options_get(&a, info.name, again, sizeof again));
            assert_set(ctx, &b, info.name, again);
        }
        assert_same_options(&a, &b);
        assert_true(a.max_aspect == (end ? 1e9 : 0) && a.adam_epsilon == (end ? 1 : 1e-30));
        assert_int_equal(a.seed, end ? INT64_MAX : 0);
    }
    sf_context_destroy(&ctx);
}

/* Numbers that no short decimal is equal to survive. */
static void test_reals_are_exact(void **state) {
    (void)state;
    static const double values[] = {1.0 / 3, 0.1, 1e-3, 0.30000000000000004, 5e-324, 1};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
        sf_fit_options a = sf_fit_options_default(), b = a;
        char text[64];
        a.lr_opacity = values[i];
        assert_ok(ctx, sf_fit_options_get(&a, "lr_opacity", text, sizeof text));
        assert_set(ctx, &b, "lr_opacity", text);
        assert_true(b.lr_opacity == values[i]);
    }
    sf_context_destroy(&ctx);
}

static void test_names(void **state) {
    (void)state;
    static const char *const good[] = {"lr_sh_rest", "lr-sh-rest", "lr-sh_rest", "lr_sh-rest"};
    static const char *const bad[] = {"",           "lr",         "lr_sh_rest_", "lr_sh_res",
                                      "LR_SH_REST", "lr sh rest", "--steps"};
    sf_context *ctx = test_context();
    char text[64];
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        sf_fit_options options = sf_fit_options_default();
        assert_set(ctx, &options, good[i], "0.25");
        assert_true(options.lr_sh_rest == 0.25);
        assert_ok(ctx, sf_fit_options_get(&options, good[i], text, sizeof text));
        assert_string_equal(text, "0.25");
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        sf_fit_options options = sf_fit_options_default();
        assert_refused(ctx, bad[i], "0.25", "no such option");
        assert_int_equal(sf_fit_options_get(&options, bad[i], text, sizeof text), SF_ERR_ARGUMENT);
    }
    sf_context_destroy(&ctx);
}

/* A former name sets the option of the present one, reads it, and is no other option's name. */
static void test_former_names(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_option_info info, other;
    size_t found = 0;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        const char *former = sf_fit_option_former(info.name);
        if (!former) continue;
        found++;
        for (size_t k = 0; !sf_fit_option_info(k, &other); k++) assert_string_not_equal(former, other.name);
        sf_fit_options options = sf_fit_options_default();
        char set[64], present[64], read[64];
        const char *text = info.kind == SF_KIND_ENUM ? strchr(info.unit, '|') + 1 : "1";
        snprintf(set, sizeof set, "%.*s", (int)strcspn(text, "|"), text);
        assert_ok(ctx, sf_fit_options_set(ctx, &options, former, set));
        assert_int_equal(sf_fit_options_get(&options, info.name, present, sizeof present), SF_OK);
        assert_int_equal(sf_fit_options_get(&options, former, read, sizeof read), SF_OK);
        assert_string_equal(present, set);
        assert_string_equal(read, set);
    }
    assert_int_equal(found, 13);
    assert_null(sf_fit_option_former("steps"));
    assert_string_equal(sf_fit_option_former("cool_down"), "lr_settle");
    sf_context_destroy(&ctx);
}

static void test_numbers(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_fit_options options = sf_fit_options_default();
    assert_set(ctx, &options, "max_gaussians", "3e4");
    assert_int_equal(options.max_gaussians, 30000);
    assert_set(ctx, &options, "steps", "1.5e3");
    assert_int_equal(options.steps, 1500);
    assert_set(ctx, &options, "seed", "9223372036854775807");
    assert_true(options.seed == INT64_MAX);
    assert_set(ctx, &options, "seed", "9007199254740993"); /* no double is equal to it */
    assert_true(options.seed == INT64_C(9007199254740993));
    assert_set(ctx, &options, "antialiased", "1");
    assert_int_equal(options.antialiased, 1);

    assert_refused(ctx, "seed", "9223372036854775808", "9223372036854775808");
    assert_refused(ctx, "seed", "-1", "-1");
    assert_refused(ctx, "seed", "1e300", "1e300");
    assert_refused(ctx, "steps", "2.5", "whole number");
    assert_refused(ctx, "steps", "1e-3", "whole number");
    assert_refused(ctx, "max_gaussians", "0", "not in 1..");
    assert_refused(ctx, "max_gaussians", "100000001", "100000001");
    assert_refused(ctx, "antialiased", "2", "not in 0..1");
    assert_refused(ctx, "antialiased", "yes", "not a number");
    assert_refused(ctx, "lambda_dssim", "1.0000001", "1.0000001");
    sf_context_destroy(&ctx);
}

static void test_not_a_number(void **state) {
    (void)state;
    static const char *const texts[] = {"",    " ",    "x",     "1x",  "1 ", "nan",
                                        "inf", "-inf", "1e999", "1,5", "--1"};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        assert_refused(ctx, "lr_mean", texts[i], "not a number");
        assert_refused(ctx, "steps", texts[i], "not a number");
    }
    sf_context_destroy(&ctx);
}

/* One step beyond either end of every range is refused. */
static void test_out_of_range(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char below[64], above[64];
        if (info.kind == SF_KIND_ENUM) continue;
        int whole = info.kind != SF_KIND_REAL;
        snprintf(below, sizeof below, "%.17g", whole ? info.least - 1 : nextafter(info.least, -INFINITY));
        snprintf(above, sizeof above, "%.17g", whole ? info.most + 1 : nextafter(info.most, INFINITY));
        assert_refused(ctx, info.name, below, below);
        assert_refused(ctx, info.name, above, above);
    }
    sf_context_destroy(&ctx);
}

static void test_enums(void **state) {
    (void)state;
    static const char *const names[] = {"black", "white", "random", "auto", "color"};
    static const char *const bad[] = {"", "Black", "blac", "blacks", "black|white", "|", "0", "purple"};
    sf_context *ctx = test_context();
    sf_fit_options options = sf_fit_options_default();
    char text[64];
    for (int i = 0; i < 5; i++) {
        assert_set(ctx, &options, "background", names[i]);
        assert_int_equal(options.background, i);
        assert_ok(ctx, sf_fit_options_get(&options, "background", text, sizeof text));
        assert_string_equal(text, names[i]);
    }
    assert_int_equal(options.background, SF_BACKGROUND_COLOR);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_refused(ctx, "background", bad[i], "black|white");
    sf_context_destroy(&ctx);
}

static void test_get_needs_room(void **state) {
    (void)state;
    sf_fit_options options = sf_fit_options_default();
    char text[5] = "????";
    assert_int_equal(sf_fit_options_get(&options, "steps", text, 4), SF_ERR_ARGUMENT); /* 3000 and its end */
    assert_int_equal(text[4], 0);
    assert_int_equal(sf_fit_options_get(&options, "steps", text, 5), SF_OK);
    assert_string_equal(text, "3000");
}

static void assert_check_names(sf_context *ctx, const sf_fit_options *options, const char *name) {
    assert_status(ctx, sf_fit_options_check(ctx, options), SF_ERR_ARGUMENT);
    assert_error_names(ctx, name);
}

/* Every field of a struct that a caller filled in is checked, and named. */
static void test_check_names_the_field(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_fit_options options;
#define BREAK(name, bad)                                                                                     \
    options = sf_fit_options_default();                                                                      \
    options.name = bad;                                                                                      \
    assert_check_names(ctx, &options, #name);
#define BREAK_INT(name, value, least, most, unit, text) BREAK(name, (least)-1)
#define BREAK_REAL(name, value, least, most, unit, text)                                                     \
    BREAK(name, nextafter(least, -INFINITY))                                                                 \
    BREAK(name, nextafter(most, INFINITY))                                                                   \
    BREAK(name, NAN)
#define BREAK_FLAG(name, value, text)         BREAK(name, -1) BREAK(name, 2)
#define BREAK_ENUM(name, value, values, text) BREAK(name, -1) BREAK(name, 5)
    SF_FIT_OPTIONS(BREAK_INT, BREAK_REAL, BREAK_FLAG, BREAK_ENUM)
#undef BREAK
#undef BREAK_INT
#undef BREAK_REAL
#undef BREAK_FLAG
#undef BREAK_ENUM
    sf_context_destroy(&ctx);
}

static void test_steps_or_time(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_fit_options options = sf_fit_options_default();
    options.steps = 0;
    assert_check_names(ctx, &options, "time_limit");
    options.time_limit = 1e-3;
    assert_ok(ctx, sf_fit_options_check(ctx, &options));
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_list),           cmocka_unit_test(test_defaults_as_text),
        cmocka_unit_test(test_round_trip),     cmocka_unit_test(test_reals_are_exact),
        cmocka_unit_test(test_names),          cmocka_unit_test(test_former_names),
        cmocka_unit_test(test_numbers),        cmocka_unit_test(test_not_a_number),
        cmocka_unit_test(test_out_of_range),   cmocka_unit_test(test_enums),
        cmocka_unit_test(test_get_needs_room), cmocka_unit_test(test_check_names_the_field),
        cmocka_unit_test(test_steps_or_time),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
