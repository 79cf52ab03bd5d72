/* test_cli_models.c - where the program writes a model, and in which format. */
#include "cli_fixture.h"

#include <fcntl.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Where a model goes. */

static void test_model_to_standard_output(void **state) {
    (void)state;
    clear_out();
    run_quietly(ARGS("fit", SHORT_FIT, "-o", "out/m.ply"));
    assert_int_equal(unlink(work("out/m.cameras.json")), 0);
    content file = content_of("out/m.ply");
    outcome o = run_ok("fit", SHORT_FIT, "-o", "-");
    assert_int_equal(o.out_size, file.size);
    assert_memory_equal(o.out, file.data, file.size);
    test_assert_contains(o.err, "done after 10 steps", __FILE__, __LINE__); /* people read it there */
    assert_int_equal(test_count_entries(work("out")), 1);
    free_outcome(&o);
    free(file.data);
}

/* The other end of a pipe gets the model, and the pipe is still one. */
static void test_model_to_a_pipe(void **state) {
    (void)state;
    clear_out();
    run_quietly(ARGS("fit", SHORT_FIT, "-o", "out/m.ply", "--cameras", "none"));
    content file = content_of("out/m.ply");
    assert_int_equal(mkfifo(work("out/pipe"), 0600), 0);
    int fd = open(work("out/pipe"), O_RDONLY | O_NONBLOCK), status = 0, ended = 0;
    assert_true(fd >= 0);
    pid_t pid = start_program(ARGS("fit", SHORT_FIT, "-o", "out/pipe"), NULL);
    double since = now();
    char *got = malloc(file.size + 1);
    size_t size = 0;
    assert_non_null(got);
    for (;;) {
        ssize_t n = read(fd, got + size, file.size + 1 - size);
        if (n > 0) size += (size_t)n;
        if (n > 0) continue;
        if (ended) break; /* nothing more after its end */
        ended = has_ended(pid, since, &status);
        if (!ended) test_pause_ms(5);
    }
    close(fd);
    outcome o = take_outcome(status);
    assert_int_equal(o.code, 0);
    assert_int_equal(size, file.size);
    assert_memory_equal(got, file.data, size);
    struct stat st;
    assert_true(!stat(work("out/pipe"), &st) && S_ISFIFO(st.st_mode));
    assert_int_equal(test_count_entries(work("out")), 2);
    free(got);
    free(file.data);
    free_outcome(&o);
}

static void test_model_to_a_device(void **state) {
    (void)state;
    clear_out();
    struct stat st;
    run_quietly(ARGS("fit", SHORT_FIT, "-o", "/dev/null"));
    assert_true(!stat("/dev/null", &st) && S_ISCHR(st.st_mode));
    assert_int_equal(test_count_entries(work("out")), 0);
}

/* Models in other formats. */

/* The bytes that the first step round a model is drawn from, by the cameras beside it or those that are
 * named. */
static content orbit_of(const char *model, const char *cameras) {
    run_quietly(ARGS("render", model, "--path", "orbit", "--frames", "1", "--size", "16x12", "--out", "out",
                     "-q", cameras ? "--cameras" : NULL, cameras));
    return content_of("out/path.txt");
}

static void assert_orbit(const char *model, const char *expected) {
    content a = orbit_of(model, NULL), b = orbit_of("good.ply", expected);
    assert_int_equal(a.size, b.size);
    assert_memory_equal(a.data, b.data, a.size);
    free(a.data);
    free(b.data);
}

/* Two models in a folder have a file of cameras each, which what reads them finds before the cameras.json of
 * the folder. */
static void test_cameras_beside_a_model(void **state) {
    (void)state;
    static const char *const other = "[{\"width\": 64, \"height\": 48, \"fx\": 48, \"fy\": 48, \"rotation\": "
                                     "[[1, 0, 0], [0, 0, -1], [0, 1, 0]], \"position\": [0, 9, 0]}]";
    clear_out();
    run_quietly(ARGS("fit", SHORT_FIT, "-o", "out/a.ply"));
    run_quietly(ARGS("fit", SHORT_FIT, "-o", "out/b.splat", "--hold-out", "0"));
    assert_int_equal(test_count_entries(work("out")), 4);
    assert_same_files("out/a.cameras.json", "out/b.cameras.json");
    write_text("other.json", other);
    assert_int_equal(rename(work("out/b.cameras.json"), work("known.json")), 0);
    static const char *const models[] = {"out/a.ply", "out/a.SPLAT", "out/a.compressed.ply", "out/b.ply"};
    for (int i = 0; i < 4; i++) run_quietly(ARGS("convert", "good.ply", models[i]));
    write_text("out/cameras.json", other);
    for (int i = 0; i < 3; i++) assert_orbit(models[i], "known.json");
    assert_orbit("out/b.ply", "other.json"); /* it has none of its own */
    content a = orbit_of("good.ply", "known.json"), b = orbit_of("good.ply", "other.json");
    assert_true(a.size != b.size || memcmp(a.data, b.data, a.size));
    free(a.data);
    free(b.data);
}

static void test_convert(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("convert", "good.ply", "out/m.spz", SCENE, "--json", "out/c.json");
    test_assert_contains(o.out, "good.ply: ", __FILE__, __LINE__);
    test_assert_contains(o.out, " times smaller; 5 Gaussians, SH degree 1", __FILE__, __LINE__);
    test_assert_contains(o.out, "2 views held out: PSNR ", __FILE__, __LINE__);
    test_assert_contains(o.out, "7 views to train on: PSNR ", __FILE__, __LINE__);
    free_outcome(&o);
    json_t *json = test_json(work("out/c.json")), *compared = json_object_get(json, "compared");
    content in = content_of("good.ply"), out = content_of("out/m.spz");
    assert_true(test_number(json, "bytes_in") == (double)in.size);
    assert_true(test_number(json, "bytes_out") == (double)out.size);
    assert_int_equal(json_array_size(json_object_get(compared, "views")), SCENE_VIEWS);
    assert_true(test_number(json_array_get(json_object_get(compared, "means"), 0), "psnr") > 30);
    json_decref(json);
    free(in.data);
    free(out.data);
    assert_int_equal(count_in("out/m.spz"), 5);

    o = run_ok("convert", "out/m.spz", "out/m.splat", "--sh-degree", "0");
    test_assert_contains(o.out, "8 views from a ring around the model: PSNR ", __FILE__, __LINE__);
    free_outcome(&o);
    assert_int_equal(count_in("out/m.splat"), 5);
    run_quietly(ARGS("convert", "good.ply", "out/same.ply", "-q"));
    assert_same_files("good.ply", "out/same.ply");
    run_quietly(ARGS("convert", "good.ply", "out/rub.spz", "--spz-frame", "rub", "--sh-bits", "8,8"));
    run_quietly(ARGS("convert", "good.ply", "out/own.spz", "--sh-bits", "8,8"));
    run_quietly(ARGS("convert", "out/rub.spz", "out/rub.ply", "--spz-frame", "rub"));
    o = run_ok("convert", "out/own.spz", "out/own.ply");
    test_assert_contains(o.out, " times larger; 5 Gaussians", __FILE__, __LINE__);
    free_outcome(&o);
    run_quietly(ARGS("convert", "good.ply", "/dev/null"));
    assert_int_equal(count_in("out/rub.ply"), 5);
}

/* All commands take all formats. */
static void test_formats(void **state) {
    (void)state;
    clear_out();
    run_quietly(ARGS(FIT, "-o", "out/m.spz", "--cameras", "none"));
    run_quietly(ARGS("convert", "out/m.spz", "out/m.splat", "-q"));
    static const char *const models[] = {"out/m.spz", "out/m.splat"};
    for (size_t i = 0; i < COUNT(models); i++) {
        outcome o = run_ok("info", models[i]);
        test_assert_contains(o.out, i ? "SH degree 0" : "SH degree 3", __FILE__, __LINE__);
        free_outcome(&o);
        o = run_ok("eval", models[i], SCENE);
        test_assert_contains(o.out, "mean", __FILE__, __LINE__);
        free_outcome(&o);
        run_quietly(ARGS("render", models[i], SCENE, "--out", "rendered", "-q"));
        run_quietly(ARGS(FIT, "--from", models[i], "-o", "out/from.ply", "--cameras", "none", "-q"));
    }
}

static const char no_gaussians[] =
    "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
    "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n"
    "property float scale_0\nproperty float scale_1\nproperty float scale_2\nproperty float rot_0\n"
    "property float rot_1\nproperty float rot_2\nproperty float rot_3\nend_header\n";

/* What shows a model without Gaussians says so. */
static void test_no_gaussians(void **state) {
    (void)state;
    static const char said[] = "warning: out/empty.ply: holds no Gaussians";
    clear_out();
    write_text("out/empty.ply", no_gaussians);
    outcome o = run_ok("eval", "out/empty.ply", SCENE);
    test_assert_contains(o.err, said, __FILE__, __LINE__);
    free_outcome(&o);
    o = run_ok("render", "out/empty.ply", SCENE, "--out", "rendered");
    test_assert_contains(o.err, said, __FILE__, __LINE__);
    free_outcome(&o);
    o = run_ok("eval", "good.ply", SCENE);
    assert_null(strstr(o.err, "no Gaussians"));
    free_outcome(&o);
}

static void test_convert_refuses(void **state) {
    (void)state;
    clear_out();
    assert_refused(ARGS("convert", "good.ply"), USAGE, "convert", 0);
    assert_refused(ARGS("convert", "good.ply", "out/a.spz", "--sh-bits", "5"), USAGE, "--sh-bits", 0);
    assert_refused(ARGS("convert", "good.ply", "out/a.spz", "--sh-bits", "5,9"), USAGE, "--sh-bits", 0);
    assert_refused(ARGS("convert", "good.ply", "out/a.spz", "--sh-degree", "4"), USAGE, "sh-degree", 0);
    assert_refused(ARGS("convert", "good.ply", "out/a.spz", "--spz-frame", "luf"), USAGE, "--spz-frame", 0);
    assert_refused(ARGS("convert", "good.ply", "absent/a.spz"), FAILED, "absent", 0);
    assert_refused(ARGS("convert", "absent.spz", "out/a.ply"), FAILED, "absent.spz: ", 0);
    write_text("bad.spz", "\x1f\x8b");
    assert_refused(ARGS("convert", "bad.spz", "out/a.ply"), FAILED, "bad.spz: truncated", 0);
    assert_refused(ARGS("eval", "bad.spz", SCENE), FAILED, "bad.spz: truncated", 0);
    write_text("bad.splat", "123");
    assert_refused(ARGS("info", "bad.splat"), FAILED, "bad.splat: size", 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_model_to_standard_output),
        cmocka_unit_test(test_model_to_a_pipe),
        cmocka_unit_test(test_model_to_a_device),
        cmocka_unit_test(test_cameras_beside_a_model),
        cmocka_unit_test(test_convert),
        cmocka_unit_test(test_formats),
        cmocka_unit_test(test_no_gaussians),
        cmocka_unit_test(test_convert_refuses),
    };
    return cmocka_run_group_tests(tests, cli_set_up, NULL);
}
