/* test_cli_refusals.c - the program from outside, with bad input: what it says, how it ends. */
#include "cli_fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#define PRUNE "prune", "good.ply", SCENE, "-o", "out/x.ply"

static void test_wrong_usage(void **state) {
    (void)state;
    static const bad_input cases[] = {
        {USAGE, "command is missing", {NULL}},
        {USAGE, "fly: unknown command", {"fly", SCENE}},
        {USAGE, "-x: unknown command", {"-x"}},
        {USAGE, "fly: unknown command", {"help", "fly"}},
        {USAGE, "argument is missing", {"fit"}},
        {USAGE, "argument is missing", {"fit", "--"}},
        {USAGE, "argument is missing", {"eval", "good.ply"}},
        {USAGE, "argument is missing", {"render", "--out", "out"}},
        {USAGE, "argument is missing", {"info"}},
        {USAGE, "--json: goes with a project, not with good.ply", {"info", "good.ply", "--json", "-"}},
        {USAGE, "--masks: goes with a project, not with good.ply", {"info", "good.ply", "--masks", "masks"}},
        {USAGE, "--no-masks: goes with a project, not with good.ply", {"info", "good.ply", "--no-masks"}},
        {USAGE, "--downscale: goes with a project, not with --cpu", {"info", "--cpu", "--downscale", "2"}},
        {USAGE, "good: one argument too many", {FIT, "good"}},
        {USAGE, "good: one argument too many", {"eval", "good.ply", SCENE, "good"}},
        {USAGE, "--bogus: unknown option", {FIT, "--bogus"}},
        {USAGE, "--bogus=1: unknown option", {FIT, "--bogus=1"}},
        {USAGE, "-z: unknown option", {FIT, "-z"}},
        {USAGE, "--ste: unknown option", {FIT, "--ste", "5"}},
        {USAGE, "--steps: unknown option", {"eval", "good.ply", SCENE, "--steps", "5"}},
        {USAGE, "--steps: needs a value", {"fit", SCENE, "-o", "out/x.ply", "--steps"}},
        {USAGE, "-o: needs a value", {"fit", SCENE, "-o"}},
        {USAGE, "--json: needs a value", {"eval", "good.ply", SCENE, "--json"}},
        {USAGE, "--quiet=1: takes no value", {FIT, "--quiet=1"}},
        {USAGE, "--out", {"render", "good.ply", SCENE}},
        {USAGE, "argument is missing", {"prune", "good.ply"}},
        {USAGE, "-o FILE: is needed", {"prune", "good.ply", SCENE}},
        {USAGE, "--loss: cannot be given beside --to", {PRUNE, "--loss", "1", "--to", "3"}},
        {USAGE, "--refit: cannot be given beside --random", {PRUNE, "--refit", "9", "--random"}},
        {USAGE, "out/x.ply: is named for two outputs", {PRUNE, "--log", "out/x.ply"}},
    };
    assert_all_refused(cases, COUNT(cases));
}

static void test_wrong_values(void **state) {
    (void)state;
    static const bad_input cases[] = {
        {USAGE, "gaussians: 0 ", {FIT, "--max-gaussians", "0"}},
        {USAGE, "gaussians: -1 ", {FIT, "--max-gaussians", "-1"}},
        {USAGE, "gaussians: \"x\"", {FIT, "--max-gaussians", "x"}},
        {USAGE, "gaussians: 1e99", {FIT, "--max-gaussians", "1e99"}},
        {USAGE, "gaussians: \"1.5\"", {FIT, "--max_gaussians=1.5"}},
        {USAGE, "gaussians: \"\"", {FIT, "--max-gaussians", ""}},
        {USAGE, "steps: -5", {FIT, "--steps", "-5"}},
        {0, "steps: 0", {FIT, "--steps", "0"}},
        {USAGE, "seed", {FIT, "--seed", "9223372036854775808"}},
        {USAGE, "\"nan\"", {FIT, "--lr-mean", "nan"}},
        {USAGE, "antialiased: 2", {FIT, "--antialiased=2"}},
        {USAGE, "--threads: \"0\"", {FIT, "--threads", "0"}},
        {USAGE, "--threads: \"1000\"", {FIT, "--threads", "1000"}},
        {USAGE, "--threads: \"two\"", {FIT, "--threads", "two"}},
        {USAGE, "--downscale: \"0\"", {FIT, "--downscale", "0"}},
        {USAGE, "--downscale: \"65\"", {FIT, "--downscale", "65"}},
        {USAGE, "--hold-out: \"-1\"", {FIT, "--hold-out", "-1"}},
        {USAGE, "--hold-out: \"99999999999999999999\"", {FIT, "--hold-out", "99999999999999999999"}},
        {USAGE, "--eval-every: \"0\"", {FIT, "--eval-every", "0"}},
        {USAGE, "avx9000", {FIT, "--isa", "avx9000"}},
        {USAGE, "background: \"purple\"", {FIT, "--background", "purple"}},
        {USAGE, "--background", {FIT, "--background", "1,2"}},
        {USAGE, "--background", {FIT, "--background", "2,0,0"}},
        {USAGE, "--background", {FIT, "--background", "nan,0,0"}},
        {USAGE, "--background", {FIT, "--background", "0,0,0,0"}},
        {USAGE, "--progress: \"maybe\"", {FIT, "--progress", "maybe"}},
        {USAGE,
         "out/x.gltf: models are not written as .gltf: name it .ply, .spz",
         {"convert", "good.ply", "out/x.gltf"}},
        {USAGE, "out/x.ksplat: models are not written", {"fit", SCENE, "-o", "out/x.ksplat"}},
        {USAGE, "out/x.obj: models are not written", {"prune", "good.ply", SCENE, "-o", "out/x.obj"}},
        {USAGE, "--spz-frame: \"luf\" is neither own nor rub", {"view", "good.ply", "--spz-frame", "luf"}},
        {USAGE, "--antialiased: \"1\" is neither", {"eval", "good.ply", SCENE, "--antialiased", "1"}},
        {USAGE, "--split: \"foo\"", {"eval", "good.ply", SCENE, "--split", "foo"}},
        {USAGE, "--split: \"foo\"", {"render", "good.ply", SCENE, "--out", "out/r", "--split", "foo"}},
        {USAGE, "--background", {"eval", "good.ply", SCENE, "--background", "purple"}},
        {USAGE, "--near-plane", {"eval", "good.ply", SCENE, "--near-plane", "0"}},
        {USAGE, "--near-plane", {"eval", "good.ply", SCENE, "--near-plane", "near"}},
        {USAGE, "--near-plane", {PRUNE, "--near-plane", "0"}},
        {USAGE, "--loss: \"-1\"", {PRUNE, "--loss", "-1"}},
        {USAGE, "--loss: \"nan\"", {PRUNE, "--loss", "nan"}},
        {USAGE, "--loss: \"0.1 bar\"", {PRUNE, "--loss", "0.1 bar"}},
        {USAGE, "--loss: \"dB\"", {PRUNE, "--loss", "dB"}},
        {USAGE, "--to: \"0\"", {PRUNE, "--to", "0"}},
        {USAGE, "--refit: \"-1\"", {PRUNE, "--refit", "-1"}},
        {FAILED, "good.ply: holds 5 Gaussians, less than --to 6", {PRUNE, "--to", "6"}},
        {FAILED, "absent.ply", {"prune", "absent.ply", SCENE, "-o", "out/x.ply"}},
    };
    assert_all_refused(cases, COUNT(cases));
}

static void test_isa_of_the_environment(void **state) {
    (void)state;
    const char *isa = getenv("SPLATFIT_ISA");
    char *kept = isa ? strdup(isa) : NULL;
    clear_out();
    setenv("SPLATFIT_ISA", "avx9000", 1);
    assert_refused(ARGS(FIT), USAGE, "avx9000", 0);
    if (kept)
        setenv("SPLATFIT_ISA", kept, 1);
    else
        unsetenv("SPLATFIT_ISA");
    free(kept);
}

static void test_wrong_paths(void **state) {
    (void)state;
    static const bad_input cases[] = {
        {FAILED, "absent: ", {"fit", "absent", "-o", "out/x.ply"}},
        {FAILED, "absent: ", {"info", "absent"}},
        {FAILED, "absent.ply: ", {"info", "absent.ply"}},
        {FAILED, "absent.ply: ", {"eval", "absent.ply", SCENE}},
        {FAILED, "absent.ply: ", {"render", "absent.ply", SCENE, "--out", "out/r"}},
        {FAILED, "absent.ply: ", {FIT, "--from", "absent.ply"}},
        {FAILED, "file: ", {"fit", "file", "-o", "out/x.ply"}},
        {FAILED, "file/x: ", {"fit", "file/x", "-o", "out/x.ply"}},
        {FAILED, "empty: no project", {"fit", "empty", "-o", "out/x.ply"}},
        {FAILED, "empty", {"eval", "good.ply", "empty"}},
        {FAILED, "sim:nothing: ", {"fit", "sim:nothing", "-o", "out/x.ply"}},
        {FAILED, "width: 1 ", {"fit", "sim:studio?width=1", "-o", "out/x.ply"}},
        {FAILED, "file/x.ply: ", {"fit", SCENE, "-o", "file/x.ply"}},
        {FAILED, "absent/x.ply: ", {"fit", SCENE, "-o", "absent/x.ply"}},
        {FAILED, "empty: is a folder", {"fit", SCENE, "-o", "empty"}},
        {FAILED, "\"\": ", {"fit", SCENE, "-o", ""}},
        {FAILED, "absent/log: ", {FIT, "--log", "absent/log"}},
        {FAILED, "absent/c.png: ", {FIT, "--compare", "absent/c.png"}},
        {FAILED, "absent/c.json: ", {FIT, "--cameras", "absent/c.json"}},
        {FAILED, "absent/e.json: ", {"eval", "good.ply", SCENE, "--json", "absent/e.json"}},
        {FAILED, "file", {"render", "good.ply", SCENE, "--out", "file"}},
        {FAILED, "file", {"render", "good.ply", SCENE, "--out", "file/r"}},
        {FAILED, "none.txt: ", {FIT, "--test-list", "none.txt"}},
        {FAILED, "nobody", {FIT, "--test-list", "list"}},
        {FAILED, "no training view", {FIT, "--hold-out", "1"}},
        {FAILED, "downscale", {FIT, "--downscale", "60"}},
        {FAILED, "nothing is held out", {"eval", "good.ply", SCENE, "--hold-out", "0"}},
        {FAILED, "max_gaussians: 4 ", {FIT, "--from", "good.ply", "--max-gaussians", "4"}},
        {FAILED, "images_3", {"fit", "good", "-o", "out/x.ply", "--images", "images_3"}},
    };
    assert_all_refused(cases, COUNT(cases));
    assert_int_equal(test_count_entries(work("empty")), 0);
}

static void test_full_device(void **state) {
    (void)state;
    static const bad_input cases[] = {
        {FAILED, "/dev/full: ", {"fit", "good", "-o", "/dev/full", "--steps", "1", "--init", "points"}},
        {FAILED, "/dev/full: ", {"eval", "good.ply", "good", "--json", "/dev/full"}},
    };
    struct stat st;
    assert_all_refused(cases, COUNT(cases));
    assert_true(!stat("/dev/full", &st) && S_ISCHR(st.st_mode));

    launch full = {.to_full_disk = 1};
    outcome o = wait_for(start_program(ARGS("fit", "good", "-o", "-", "--steps", "1"), &full));
    assert_int_equal(o.code, FAILED);
    test_assert_contains(o.err, "No space left", __FILE__, __LINE__);
    free_outcome(&o);
}

/* A file of the project "cut" ends early: at a mark, or one byte short. */
static void check_truncations(int file, const buffer *whole, int every) {
    const char *name = strrchr(cli_bin_names[file], '/') + 1;
    for (int m = 0; m < whole->marks + every; m += every) {
        size_t size = m < whole->marks ? whole->mark[m] : whole->size - 1;
        test_write(work(cli_in_project("cut", cli_bin_names[file])), whole->data, size);
        assert_refused(ARGS("fit", "cut", "-o", "out/x.ply"), FAILED, name, 0);
    }
    test_write(work(cli_in_project("cut", cli_bin_names[file])), whole->data, whole->size);
}

/* Each file of a COLMAP project ends wherever one of its values begins. */
static void test_truncated_projects(void **state) {
    (void)state;
    static buffer bins[BINS];
    plan p = cli_good_plan();
    clear_out();
    cli_write_project("cut", &p);
    cli_make_bins(&p, bins);
    for (int i = 0; i < BINS; i++) check_truncations(i, &bins[i], getenv("SPLATFIT_QUICK") ? 11 : 1);
    outcome o = run_ok("info", "cut");
    test_assert_contains(o.out, "4 views", __FILE__, __LINE__);
    free_outcome(&o);
}

static void test_impossible_projects(void **state) {
    (void)state;
    static const uint64_t huge = UINT64_C(1) << 63;
    static const char *const parts[] = {"cameras.bin",  "images.bin",  "points3D.bin", "images.bin",
                                        "points3D.bin", "width: 0",    "width",        "camera 1",
                                        "images.bin",   "cameras.bin", "images.bin",   "points3D.bin"};
    plan plans[COUNT(parts)];
    for (size_t i = 0; i < COUNT(parts); i++) plans[i] = cli_good_plan();
    plans[0].cameras = plans[1].images = plans[2].points = plans[3].observations = plans[4].track = huge;
    plans[5].width = 0;
    plans[6].width = UINT64_C(1) << 40;
    plans[7].lens = 99;
    plans[8].camera_of_image = 2;
    plans[9].cameras = plans[10].images = plans[11].points = UINT64_MAX;
    clear_out();
    cli_write_project("odd", &plans[0]);
    for (size_t i = 0; i < COUNT(parts); i++) {
        cli_write_bins("odd", &plans[i]);
        assert_refused(ARGS("fit", "odd", "-o", "out/x.ply"), FAILED, parts[i], 0);
    }
}

/* Every picture empty or missing, every pose or lens not finite. */
static void test_views_that_are_none(void **state) {
    (void)state;
    plan p = cli_good_plan();
    clear_out();
    cli_write_project("none", &p);
    for (int i = 0; i < IMAGES; i++) test_write(work(cli_picture_name("none", i)), "", 0);
    assert_refused(ARGS("fit", "none", "-o", "out/x.ply"), FAILED, "no training view", 1);
    outcome slashes = run("fit", "none//", "-o", "out/x.ply");
    test_assert_contains(slashes.err, "none/images/", __FILE__, __LINE__);
    free_outcome(&slashes);
    for (int i = 0; i < IMAGES; i++) assert_int_equal(unlink(work(cli_picture_name("none", i))), 0);
    assert_refused(ARGS("fit", "none", "-o", "out/x.ply"), FAILED, "no training view", 1);
    assert_refused(ARGS("eval", "good.ply", "none"), FAILED, "no training view", 1);

    cli_write_project("none", &p);
    for (int i = 0; i < IMAGES; i++) p.qw[i] = i % 2 ? NAN : INFINITY;
    cli_write_bins("none", &p);
    assert_refused(ARGS("fit", "none", "-o", "out/x.ply"), FAILED, "no training view", 1);
    p = cli_good_plan();
    p.focal = NAN;
    cli_write_bins("none", &p);
    assert_refused(ARGS("fit", "none", "-o", "out/x.ply"), FAILED, "no training view", 1);
}

/* A PNG of 0 x 24 pixels that is right in all else. */
static void write_empty_picture(const char *name) {
    content c = content_of(name);
    assert_true(c.size > 33);
    memset(c.data + 16, 0, 4);
    unsigned long crc = crc32(0, (const unsigned char *)c.data + 12, 17);
    for (int i = 0; i < 4; i++) c.data[29 + i] = (char)(crc >> (24 - 8 * i));
    test_write(work(name), c.data, c.size);
    free(c.data);
}

/* A picture that is missing, one that has no pixels, and a pose that is none skip their views, are counted,
 * and do no harm to the others. */
static void test_some_views_skipped(void **state) {
    (void)state;
    plan p = cli_good_plan();
    clear_out();
    p.qw[3] = NAN;
    cli_write_project("some", &p);
    assert_int_equal(unlink(work(cli_picture_name("some", 0))), 0);
    write_empty_picture(cli_picture_name("some", 1));
    outcome o = run_ok("fit", "some", "-o", "out/x.ply", "--steps", "5", SMALL);
    test_assert_contains(o.err, "images/0.png: skipped", __FILE__, __LINE__);
    test_assert_contains(o.err, "images/1.png: skipped", __FILE__, __LINE__);
    test_assert_contains(o.err, "2 of 4 pictures skipped", __FILE__, __LINE__);
    test_assert_contains(o.err, "1 of 4 views skipped", __FILE__, __LINE__);
    test_assert_contains(o.out, "1 training views", __FILE__, __LINE__);
    free_outcome(&o);
    assert_true(count_in("out/x.ply") > 0);
    o = run_ok("info", "some", "--quiet");
    test_assert_contains(o.out, "2 views skipped: picture", __FILE__, __LINE__);
    test_assert_contains(o.out, "1 views skipped: pose", __FILE__, __LINE__);
    assert_string_equal(o.err, "");
    free_outcome(&o);
}

#define POSE "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"

static void test_bad_transforms(void **state) {
    (void)state;
    static const struct {
        const char *text, *part;
    } cases[] = {
        {"", "transforms.json"},
        {"garbage", "transforms.json: line 1"},
        {"{\"frames\": [", "transforms.json: line 1"},
        {"[]", "transforms.json"},
        {"null", "transforms.json"},
        {"{}", "frames"},
        {"{\"frames\": 3}", "frames"},
        {"{\"frames\": []}", "names no picture"},
        {"{\"camera_angle_x\": 1, \"frames\": [3]}", "frames[0]"},
        {"{\"camera_angle_x\": 1, \"frames\": [{}]}", "frames[0]"},
        {"{\"camera_angle_x\": 1, \"frames\": [{\"file_path\": 3, \"transform_matrix\": " POSE "}]}",
         "frames[0]: file_path"},
        {"{\"camera_angle_x\": 1, \"frames\": [{\"file_path\": \"0.png\"}]}", "frames[0]: transform_matrix"},
        {"{\"camera_angle_x\": 1, \"frames\": [{\"file_path\": \"0.png\", \"transform_matrix\": [1, 2]}]}",
         "frames[0]: transform_matrix"},
        {"{\"camera_angle_x\": \"wide\", \"frames\": [{\"file_path\": \"0.png\", \"transform_matrix\": " POSE
         "}]}",
         "camera_angle_x"},
        {"{\"fl_x\": [], \"w\": 4, \"h\": 4, \"frames\": [{\"file_path\": \"0.png\", "
         "\"transform_matrix\": " POSE "}]}",
         "fl_x"},
        {"{\"camera_angle_x\": 1, \"frames\": [{\"file_path\": \"../0.png\", \"transform_matrix\": " POSE
         "}]}",
         "../0.png"},
    };
    clear_out();
    make_folder("json");
    for (size_t i = 0; i < COUNT(cases); i++) {
        write_text("json/transforms.json", cases[i].text);
        assert_refused(ARGS("fit", "json", "-o", "out/x.ply"), FAILED, cases[i].part, 0);
    }
    char deep[20001];
    memset(deep, '[', sizeof deep - 1);
    deep[sizeof deep - 1] = 0;
    write_text("json/transforms.json", deep);
    assert_refused(ARGS("info", "json/transforms.json"), FAILED, "transforms.json", 0);
}

/* A model that cannot be what it says, by every command that takes one. */
static void assert_model_refused(const void *data, size_t size, const char *part) {
    test_write(work("bad.ply"), data, size);
    assert_refused(ARGS("info", "bad.ply"), FAILED, part, 0);
}

static void test_bad_models(void **state) {
    (void)state;
    static const char *const properties[] = {"x", "z", "f_dc_1", "opacity", "scale_2", "rot_0"};
    static const char *const counts[] = {"-1",  "9223372036854775808", "18446744073709551616", "6", "4e9",
                                         "five"};
    content good = content_of("good.ply");
    char *header_end = strstr(good.data, "end_header\n"), text[64];
    assert_non_null(header_end);
    size_t header = (size_t)(header_end - good.data) + 11;
    const size_t cuts[] = {
        0, 1, 3, 4, 40, header - 11, header - 1, header, header + 1, good.size / 2, good.size - 1};
    clear_out();
    write_text("bad.ply", "");
    for (size_t i = 0; i < COUNT(cuts); i++) assert_model_refused(good.data, cuts[i], "bad.ply: ");

    for (size_t i = 0; i < COUNT(properties); i++) {
        content c = content_of("good.ply");
        snprintf(text, sizeof text, "property float %s\n", properties[i]);
        char *at = strstr(c.data, text);
        assert_non_null(at);
        at[strlen(text) - 2] = '?';
        assert_model_refused(c.data, c.size, properties[i]);
        free(c.data);
    }
    for (size_t i = 0; i < COUNT(counts); i++) {
        char *at = strstr(good.data, "element vertex 5\n"), *whole = malloc(good.size + 64);
        assert_true(at && whole);
        int n = sprintf(whole, "%.*selement vertex %s\n", (int)(at - good.data), good.data, counts[i]);
        size_t rest = good.size - (size_t)(at - good.data) - 17;
        memcpy(whole + n, at + 17, rest);
        assert_model_refused(whole, (size_t)n + rest, "vertex");
        free(whole);
    }
    memset(good.data, 0xa5, good.size);
    assert_model_refused(good.data, good.size, "bad.ply: ");
    assert_refused(ARGS("eval", "bad.ply", SCENE), FAILED, "bad.ply: ", 0);
    assert_refused(ARGS("render", "bad.ply", SCENE, "--out", "out/r"), FAILED, "bad.ply: ", 0);
    assert_refused(ARGS(FIT, "--from", "bad.ply"), FAILED, "bad.ply: ", 0);
    assert_refused(ARGS("info", "empty.ply"), FAILED, "empty.ply: ", 0);
    free(good.data);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wrong_usage),
        cmocka_unit_test(test_wrong_values),
        cmocka_unit_test(test_isa_of_the_environment),
        cmocka_unit_test(test_wrong_paths),
        cmocka_unit_test(test_full_device),
        cmocka_unit_test(test_truncated_projects),
        cmocka_unit_test(test_impossible_projects),
        cmocka_unit_test(test_views_that_are_none),
        cmocka_unit_test(test_some_views_skipped),
        cmocka_unit_test(test_bad_transforms),
        cmocka_unit_test(test_bad_models),
    };
    return cmocka_run_group_tests(tests, cli_set_up, NULL);
}
