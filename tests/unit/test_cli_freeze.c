/* test_cli_freeze.c - fit --freeze: the model that comes out is the one that went in. */
#include "cli_fixture.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"

enum {
    COUNT_OF_ALL = 2000, /* more than the fit leaves unsorted */
    SH = 12,
    FLOATS = 26, /* of a record: mean, normal, SH, opacity, scales, quaternion */
    FIRST_SCALE = 19
};

/* What a fit would change at once: needles, faint and very large Gaussians, pairs in one place; half of them
 * without SH of degree 1. */
static void save_extremes(const char *name) {
    static float means[3 * COUNT_OF_ALL], quats[4 * COUNT_OF_ALL], scales[3 * COUNT_OF_ALL],
        logits[COUNT_OF_ALL], sh[SH * COUNT_OF_ALL];
    sf_context *ctx = test_context();
    sf_model *model;
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    for (size_t i = 0; i < COUNT_OF_ALL; i++) {
        for (size_t k = 0; k < 3; k++) {
            means[3 * i + k] = i % 7 ? (float)(2 * sf_rng_uniform(&rng) - 1) : 0.25f;
            scales[3 * i + k] = (float)(-3 - 2 * sf_rng_uniform(&rng));
        }
        for (size_t k = 0; k < 4; k++) quats[4 * i + k] = (float)(sf_rng_uniform(&rng) - 0.5);
        for (size_t k = 0; k < SH; k++)
            sh[SH * i + k] = k < 3 || i % 2 ? (float)(sf_rng_uniform(&rng) - 0.5) : 0;
        logits[i] = (float)(4 * sf_rng_uniform(&rng) - 2);
        if (i % 5 == 1) scales[3 * i] = 1, scales[3 * i + 1] = scales[3 * i + 2] = -9;
        if (i % 5 == 2) logits[i] = -9;
        if (i % 500 == 3) scales[3 * i] = scales[3 * i + 1] = 4;
    }
    const sf_gaussians g = {means, quats, scales, logits, sh};
    assert_ok(ctx, sf_model_create(ctx, COUNT_OF_ALL, 1, &model));
    assert_ok(ctx, sf_model_set(model, 0, COUNT_OF_ALL, &g));
    assert_ok(ctx, sf_model_save(model, work(name)));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static size_t record_size; /* qsort has no argument for it */

static int compare_records(const void *a, const void *b) { return memcmp(a, b, record_size); }

/* The Gaussians of a .ply in the order of their bytes, at *records of the file. */
static content sorted_records(const char *name, char **records) {
    static const char end[] = "end_header\n";
    content file = content_of(name);
    char *text = file.data;
    for (*records = text; memcmp(*records, end, sizeof end - 1); ++*records)
        assert_true(*records < text + 4000);
    *records += sizeof end - 1;
    record_size = (file.size - (size_t)(*records - text)) / COUNT_OF_ALL;
    assert_int_equal(record_size * COUNT_OF_ALL, file.size - (size_t)(*records - text));
    qsort(*records, COUNT_OF_ALL, record_size, compare_records);
    return file;
}

/* All bytes, but for the log-scales' last one: a fit scales its model by a power of two. */
static void assert_same_gaussians(const char *a_name, const char *b_name) {
    char *a, *b;
    content a_file = sorted_records(a_name, &a), b_file = sorted_records(b_name, &b);
    assert_int_equal(a_file.size, b_file.size);
    for (size_t i = 0; i < COUNT_OF_ALL; i++, a += record_size, b += record_size) {
        float of_a[FLOATS], of_b[FLOATS];
        assert_int_equal(record_size, sizeof of_a);
        memcpy(of_a, a, record_size);
        memcpy(of_b, b, record_size);
        for (int k = 0; k < FLOATS; k++) {
            int scale = k >= FIRST_SCALE && k < FIRST_SCALE + 3;
            if (!(fabsf(of_a[k] - of_b[k]) <= (scale ? 0x1p-22f * fabsf(of_a[k]) : 0)))
                fail_msg("Gaussian %zu, value %d: %.9g is now %.9g", i, k, of_a[k], of_b[k]);
        }
    }
    free(a_file.data);
    free(b_file.data);
}

#define FREEZE "fit", SCENE, "-o", "out/f.ply", "--from", "extremes.ply", "--freeze"

/* Through densification, selection and the cool-down of a run as long as it is. */
static void test_model_stays(void **state) {
    (void)state;
    clear_out();
    save_extremes("extremes.ply");
    run_quietly(
        ARGS(FREEZE, "--steps", "40", "--log", "out/l.json", "--lr-mean", "0.1", "--max-aspect", "5"));
    assert_same_gaussians("extremes.ply", "out/f.ply");
    json_t *log = test_json(work("out/l.json")), *result = json_object_get(log, "result");
    assert_int_equal(test_number(result, "gaussians"), COUNT_OF_ALL);
    assert_int_equal(test_number(result, "steps"), 40);
    run_quietly(ARGS("eval", "extremes.ply", SCENE, "--json", "out/e.json"));
    json_t *own = test_json(work("out/e.json"));
    assert_true(fabs(test_number(own, "psnr") - test_number(result, "psnr")) < 1e-3);
    json_decref(own);
    json_decref(log);
    run_quietly(ARGS("fit", SCENE, "-o", "out/g.ply", "--from", "extremes.ply", "--steps", "3"));
    content kept = content_of("out/f.ply"), moved = content_of("out/g.ply");
    assert_true(kept.size != moved.size || memcmp(kept.data, moved.data, kept.size));
    free(kept.data);
    free(moved.data);
}

/* A run as long as those that select Gaussians; quick ones stay short. */
static void test_model_stays_in_a_long_run(void **state) {
    (void)state;
    clear_out();
    save_extremes("extremes.ply");
    run_quietly(ARGS(FREEZE, "--plan-steps", "3000", "--densify", "relocate", "--reg-opacity", "1", "--steps",
                     getenv("SPLATFIT_QUICK") ? "30" : "320", "--background", "auto"));
    assert_same_gaussians("extremes.ply", "out/f.ply");
}

static void test_freeze_refuses(void **state) {
    (void)state;
    clear_out();
    static const bad_input cases[] = {
        {USAGE,
         "--freeze: needs the model that stays as it is: --from MODEL",
         {"fit", SCENE, "-o", "out/f.ply", "--freeze"}},
        {USAGE, "--freeze: cannot be given beside --exposure", {FREEZE, "--exposure"}},
        {USAGE, "--freeze: cannot be given beside --refine-poses", {FREEZE, "--refine-poses"}},
        {USAGE, "--freeze: cannot be given beside --refine-intrinsics", {FREEZE, "--refine-intrinsics"}},
        {FAILED, "max_gaussians: 7 is less than the 2000", {FREEZE, "--max-gaussians", "7"}},
    };
    save_extremes("extremes.ply");
    assert_all_refused(cases, sizeof cases / sizeof *cases);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_model_stays),
        cmocka_unit_test(test_model_stays_in_a_long_run),
        cmocka_unit_test(test_freeze_refuses),
    };
    return cmocka_run_group_tests_name("freeze", tests, cli_set_up, NULL);
}
