/* test_cli.c - the program from outside: what it writes, what it says, how it ends. */
#define _XOPEN_SOURCE 700 /* realpath, SIGXFSZ */
#include "program.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <zlib.h>

/* A COLMAP project of the test's own. */

enum { IMAGES = 4, POINTS = 12, PICTURE_WIDTH = 32, PICTURE_HEIGHT = 24, MARKS = 256 };

/* A file in the making. Each value begins at a mark. */
typedef struct buffer {
    uint8_t data[4096];
    size_t size, mark[MARKS];
    int marks;
} buffer;

static void add_bytes(buffer *b, const void *data, size_t size) {
    assert_true(size <= sizeof b->data - b->size && b->marks < MARKS);
    b->mark[b->marks++] = b->size;
    memcpy(b->data + b->size, data, size);
    b->size += size;
}

static void add_uint(buffer *b, uint64_t v, size_t bytes) {
    uint8_t le[8];
    for (size_t i = 0; i < bytes; i++) le[i] = (uint8_t)(v >> (8 * i));
    add_bytes(b, le, bytes);
}

static void add_double(buffer *b, double v) {
    uint64_t bits;
    memcpy(&bits, &v, sizeof bits);
    add_uint(b, bits, 8);
}

/* What can be wrong with it. */
typedef struct plan {
    uint64_t cameras, images, points; /* counts that the files announce */
    uint64_t observations, track;     /* of the first image and the first point */
    uint64_t width, lens;             /* of the camera */
    uint64_t camera_of_image;
    double focal;
    double qw[IMAGES];
} plan;

static plan good_plan(void) {
    return (plan){.cameras = 1,
                  .images = IMAGES,
                  .points = POINTS,
                  .observations = 1,
                  .track = 1,
                  .width = PICTURE_WIDTH,
                  .lens = 1,
                  .camera_of_image = 1,
                  .focal = 30,
                  .qw = {1, 1, 1, 1}};
}

enum { CAMERAS_BIN, IMAGES_BIN, POINTS_BIN, BINS };
static const char *const bin_names[BINS] = {"sparse/0/cameras.bin", "sparse/0/images.bin",
                                            "sparse/0/points3D.bin"};

static void make_bins(const plan *p, buffer bins[BINS]) {
    buffer *cameras = &bins[CAMERAS_BIN], *images = &bins[IMAGES_BIN], *points = &bins[POINTS_BIN];
    for (int i = 0; i < BINS; i++) bins[i].size = 0, bins[i].marks = 0;
    add_uint(cameras, p->cameras, 8);
    add_uint(cameras, 1, 4);
    add_uint(cameras, p->lens, 4);
    add_uint(cameras, p->width, 8);
    add_uint(cameras, PICTURE_HEIGHT, 8);
    const double lens[] = {p->focal, p->focal, PICTURE_WIDTH / 2.0, PICTURE_HEIGHT / 2.0};
    for (int i = 0; i < 4; i++) add_double(cameras, lens[i]);

    add_uint(images, p->images, 8);
    for (unsigned i = 0; i < IMAGES; i++) {
        const double pose[] = {p->qw[i], 0, 0, 0, 0.2 * i, -0.1 * i, 4};
        char name[] = "0.png";
        name[0] = (char)('0' + i);
        add_uint(images, i + 1, 4);
        for (int k = 0; k < 7; k++) add_double(images, pose[k]);
        add_uint(images, p->camera_of_image, 4);
        add_bytes(images, name, sizeof name);
        add_uint(images, i ? 0 : p->observations, 8);
        if (i) continue;
        add_double(images, 1.5);
        add_double(images, 2.5);
        add_uint(images, 1, 8);
    }

    add_uint(points, p->points, 8);
    for (unsigned i = 0; i < POINTS; i++) {
        const double xyz[] = {0.3 * (i % 3) - 0.3, 0.3 * (i / 3 % 3) - 0.3, 0.2 * (i % 2)};
        const uint8_t rgb[] = {200, (uint8_t)(20 * i), 40};
        add_uint(points, i + 1, 8);
        for (int k = 0; k < 3; k++) add_double(points, xyz[k]);
        add_bytes(points, rgb, 3);
        add_double(points, 0.5);
        add_uint(points, i ? 0 : p->track, 8);
        if (!i) add_uint(points, 1, 8);
    }
}

/* "<project>/<name>", relative to the work folder. */
static const char *in_project(const char *project, const char *name) {
    static char paths[4][256];
    static unsigned turn;
    char *path = paths[turn++ % 4];
    snprintf(path, sizeof paths[0], "%s/%s", project, name);
    return path;
}

static void write_bins(const char *project, const plan *p) {
    static buffer bins[BINS];
    make_bins(p, bins);
    for (int i = 0; i < BINS; i++)
        test_write(work(in_project(project, bin_names[i])), bins[i].data, bins[i].size);
}

static const char *picture_name(const char *project, int i) {
    char name[32];
    snprintf(name, sizeof name, "images/%d.png", i);
    return in_project(project, name);
}

static void write_project(const char *project, const plan *p) {
    static const char *const folders[] = {"images", "sparse", "sparse/0"};
    float rgb[3 * PICTURE_WIDTH * PICTURE_HEIGHT];
    sf_context *ctx = test_context();
    make_folder(project);
    for (int i = 0; i < 3; i++) make_folder(in_project(project, folders[i]));
    for (int i = 0; i < IMAGES; i++) {
        for (int k = 0; k < 3 * PICTURE_WIDTH * PICTURE_HEIGHT; k++)
            rgb[k] = (float)((k * (i + 3)) % 97) / 97;
        assert_ok(ctx, sf_write_png(ctx, work(picture_name(project, i)), PICTURE_WIDTH, PICTURE_HEIGHT, rgb));
    }
    sf_context_destroy(&ctx);
    write_bins(project, p);
}

/* Bad input. */

#define FIT   "fit", SCENE, "-o", "out/x.ply", "--steps", "1"
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
    const char *name = strrchr(bin_names[file], '/') + 1;
    for (int m = 0; m < whole->marks + every; m += every) {
        size_t size = m < whole->marks ? whole->mark[m] : whole->size - 1;
        test_write(work(in_project("cut", bin_names[file])), whole->data, size);
        assert_refused(ARGS("fit", "cut", "-o", "out/x.ply"), FAILED, name, 0);
    }
    test_write(work(in_project("cut", bin_names[file])), whole->data, whole->size);
}

/* Each file of a COLMAP project ends wherever one of its values begins. */
static void test_truncated_projects(void **state) {
    (void)state;
    static buffer bins[BINS];
    plan p = good_plan();
    clear_out();
    write_project("cut", &p);
    make_bins(&p, bins);
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
    for (size_t i = 0; i < COUNT(parts); i++) plans[i] = good_plan();
    plans[0].cameras = plans[1].images = plans[2].points = plans[3].observations = plans[4].track = huge;
    plans[5].width = 0;
    plans[6].width = UINT64_C(1) << 40;
    plans[7].lens = 99;
    plans[8].camera_of_image = 2;
    plans[9].cameras = plans[10].images = plans[11].points = UINT64_MAX;
    clear_out();
    write_project("odd", &plans[0]);
    for (size_t i = 0; i < COUNT(parts); i++) {
        write_bins("odd", &plans[i]);
        assert_refused(ARGS("fit", "odd", "-o", "out/x.ply"), FAILED, parts[i], 0);
    }
}

/* Every picture empty or missing, every pose or lens not finite. */
static void test_views_that_are_none(void **state) {
    (void)state;
    plan p = good_plan();
    clear_out();
    write_project("none", &p);
    for (int i = 0; i < IMAGES; i++) test_write(work(picture_name("none", i)), "", 0);
    assert_refused(ARGS("fit", "none", "-o", "out/x.ply"), FAILED, "no training view", 1);
    outcome slashes = run("fit", "none//", "-o", "out/x.ply");
    test_assert_contains(slashes.err, "none/images/", __FILE__, __LINE__);
    free_outcome(&slashes);
    for (int i = 0; i < IMAGES; i++) assert_int_equal(unlink(work(picture_name("none", i))), 0);
    assert_refused(ARGS("fit", "none", "-o", "out/x.ply"), FAILED, "no training view", 1);
    assert_refused(ARGS("eval", "good.ply", "none"), FAILED, "no training view", 1);

    write_project("none", &p);
    for (int i = 0; i < IMAGES; i++) p.qw[i] = i % 2 ? NAN : INFINITY;
    write_bins("none", &p);
    assert_refused(ARGS("fit", "none", "-o", "out/x.ply"), FAILED, "no training view", 1);
    p = good_plan();
    p.focal = NAN;
    write_bins("none", &p);
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
    plan p = good_plan();
    clear_out();
    p.qw[3] = NAN;
    write_project("some", &p);
    assert_int_equal(unlink(work(picture_name("some", 0))), 0);
    write_empty_picture(picture_name("some", 1));
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

/* Good runs. */

static void test_help(void **state) {
    (void)state;
    static const struct {
        const char *args[3], *part;
    } cases[] = {{{"--help"}, "Exit codes"},
                 {{"-h"}, "Exit codes"},
                 {{"help"}, "Exit codes"},
                 {{"help", "fit"}, "--max-gaussians"},
                 {{"fit", "--help"}, "--eval-every"},
                 {{"fit", "-h"}, "--eval-every"},
                 {{"eval", "--help"}, "--json"},
                 {{"render", "--help"}, "--path"},
                 {{"convert", "--help"}, "--crop"},
                 {{"view", "--help"}, "--listen"},
                 {{"info", "--help"}, "--downscale"},
                 {{"--version"}, "splatfit 0."}};
    for (size_t i = 0; i < COUNT(cases); i++) {
        outcome o = run_args_ok(cases[i].args);
        test_assert_contains(o.out, cases[i].part, __FILE__, __LINE__);
        assert_string_equal(o.err, "");
        assert_int_equal(o.out[o.out_size - 1], '\n');
        free_outcome(&o);
    }
}

/* An option means one thing: where two tables of a command had the same name, the first would take what the
 * second is for. */
static void test_options_are_given_once(void **state) {
    (void)state;
    static const char *const names[] = {"fit",     "live", "eval",  "render",  "convert",   "prune", "view",
                                        "capture", "info", "board", "devices", "calibrate", "bench", "chart"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        outcome o = run_ok(names[i], "--help");
        char options[256][40];
        int count = 0;
        for (const char *at = o.out; (at = strstr(at, "\n  --")); at++) {
            assert_between(count, 0, 255);
            assert_int_equal(sscanf(at, "\n  --%39[a-z0-9-]", options[count]), 1);
            for (int k = 0; k < count; k++)
                if (!strcmp(options[k], options[count])) fail_msg("%s: --%s twice", names[i], options[k]);
            count++;
        }
        assert_true(count > 0);
        free_outcome(&o);
    }
}

/* With and without a model to begin with, whose file may say otherwise. */
static void test_fits_antialiased(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok(FIT, "--antialiased", "--steps", "3");
    free_outcome(&o);
    o = run_ok("info", "out/x.ply");
    assert_non_null(strstr(o.out, "anti-aliased"));
    free_outcome(&o);
    o = run_ok(FIT, "--from", "good.ply", "--steps", "3", "--antialiased");
    free_outcome(&o);
    o = run_ok("info", "out/x.ply");
    assert_non_null(strstr(o.out, "anti-aliased"));
    free_outcome(&o);
}

/* The help names every hyperparameter, as it is typed. */
static void test_help_is_complete(void **state) {
    (void)state;
    outcome o = run_ok("fit", "--help");
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char typed[64];
        snprintf(typed, sizeof typed, "  --%s ", info.name);
        for (char *c = typed + 4; *c; c++)
            if (*c == '_') *c = '-';
        test_assert_contains(o.out, typed, __FILE__, __LINE__);
        test_assert_contains(o.out, info.text, __FILE__, __LINE__);
    }
    free_outcome(&o);
}

static void check_log(const char *name) {
    json_t *log = test_json(work(name)), *options = json_object_get(log, "options");
    const json_t *curve = json_object_get(log, "curve"), *result = json_object_get(log, "result");
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++)
        if (!json_object_get(options, info.name)) fail_msg("the log lacks the option %s", info.name);
    assert_int_equal(test_number(options, "seed"), 7);
    assert_int_equal(test_number(options, "steps"), 30);
    assert_int_equal(test_number(log, "threads"), 2);
    assert_true(json_string_length(json_object_get(log, "isa")) > 0);
    assert_string_equal(json_string_value(json_object_get(log, "version")), sf_version());
    assert_string_equal(json_string_value(json_object_get(log, "project")), SCENE);
    assert_true(json_array_size(curve) >= 3);
    size_t i, with_psnr = 0;
    json_t *point;
    double step = 0, seconds = 0;
    json_array_foreach(curve, i, point) {
        assert_true(test_number(point, "step") >= step && test_number(point, "loss") > 0);
        assert_true(test_number(point, "gaussians") <= 400);
        step = test_number(point, "step");
        with_psnr += json_object_get(point, "psnr") != NULL;
        assert_true(!json_object_get(point, "psnr") == !json_object_get(point, "ssim"));
        assert_true(test_number(point, "seconds") > seconds);
        seconds = test_number(point, "seconds");
    }
    const json_t *machine = json_object_get(log, "machine"), *scene = json_object_get(log, "scene");
    assert_true(json_string_length(json_object_get(machine, "cpu")) > 0);
    assert_int_equal(test_number(machine, "threads"), 2);
    assert_string_equal(json_string_value(json_object_get(scene, "name")), "sim:studio");
    assert_int_equal(test_number(scene, "width"), SCENE_WIDTH);
    assert_int_equal(test_number(scene, "height"), SCENE_HEIGHT);
    assert_int_equal(test_number(log, "seed"), 7);
    assert_true(test_number(result, "seconds") >= seconds && test_number(result, "evaluation_seconds") > 0);
    assert_true(test_number(result, "setup_seconds") < seconds &&
                test_number(result, "fit_seconds") <= seconds);
    assert_between((size_t)(1000 * test_number(result, "needles")), 0, 1000);
    assert_int_equal(step, 30);
    assert_int_equal(with_psnr, 3); /* every 10 steps */
    assert_int_equal(test_number(result, "steps"), 30);
    assert_true(test_number(result, "psnr") > 5 && test_number(result, "ssim") > 0);
    assert_true(test_number(result, "psnr_corrected") > 5);
    assert_int_equal(json_array_size(json_object_get(result, "views")), SCENE_HELD_OUT);
    assert_true(json_is_true(json_object_get(result, "complete")));
    assert_string_equal(json_string_value(json_object_get(result, "end")), "complete");
    json_decref(log);
}

static void test_fit_writes_all(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("fit", SCENE, "-o", "out/m.ply", "--steps", "30", "--seed", "7", SMALL, "--log",
                       "out/log.json", "--compare", "out/c.png", "--eval-every", "10");
    test_assert_contains(o.out, "7 training views, 2 held out", __FILE__, __LINE__);
    test_assert_contains(o.out, "done after 30 steps", __FILE__, __LINE__);
    test_assert_contains(o.out, "wrote out/m.ply", __FILE__, __LINE__);
    test_assert_contains(o.out, "PSNR", __FILE__, __LINE__);
    test_assert_contains(o.out, "\ncomplete\n", __FILE__, __LINE__);
    free_outcome(&o);
    assert_int_equal(test_count_entries(work("out")), 4);
    size_t count = count_in("out/m.ply");
    assert_between(count, 1, 400);
    json_t *cameras = test_json(work("out/cameras.json"));
    assert_int_equal(json_array_size(cameras), SCENE_VIEWS);
    json_decref(cameras);
    assert_png("out/c.png", 2 * SCENE_WIDTH, SCENE_HEIGHT);
    check_log("out/log.json");
}

/* --quiet says nothing at all; a file named by --cameras, or none. */
static void test_quiet_and_cameras(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("fit", "good", "-q", "-o", "out/m.ply", "--steps", "2", "--cameras", "out/c.json");
    assert_string_equal(o.out, "");
    assert_string_equal(o.err, "");
    free_outcome(&o);
    json_t *cameras = test_json(work("out/c.json"));
    assert_int_equal(json_array_size(cameras), IMAGES);
    json_decref(cameras);
    assert_int_equal(test_count_entries(work("out")), 2);
    run_quietly(ARGS("fit", "good", "-o", "out/m.ply", "--steps", "2", "--cameras", "none"));
    assert_int_equal(test_count_entries(work("out")), 2);
}

static void test_eval(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("eval", "good.ply", SCENE, "--json", "out/e.json");
    assert_string_equal(o.err, "");
    test_assert_contains(o.out, "frame_0008", __FILE__, __LINE__);
    free_outcome(&o);
    json_t *json = test_json(work("out/e.json")), *views = json_object_get(json, "views"), *view;
    double psnr = 0, ssim = 0;
    size_t i;
    assert_int_equal(json_array_size(views), SCENE_HELD_OUT);
    json_array_foreach(views, i, view) {
        assert_true(json_is_string(json_object_get(view, "name")));
        psnr += test_number(view, "psnr") / SCENE_HELD_OUT;
        ssim += test_number(view, "ssim") / SCENE_HELD_OUT;
    }
    assert_true(fabs(test_number(json, "psnr") - psnr) < 1e-9 &&
                fabs(test_number(json, "ssim") - ssim) < 1e-9);
    content model = content_of("good.ply");
    assert_int_equal(test_number(json, "gaussians"), 5);
    assert_int_equal(test_number(json, "bytes"), model.size);
    free(model.data);
    json_decref(json);

    run_quietly(ARGS("eval", "good.ply", SCENE, "--split", "all", "--json", "out/e.json"));
    json = test_json(work("out/e.json"));
    assert_int_equal(json_array_size(json_object_get(json, "views")), SCENE_VIEWS);
    json_decref(json);
}

static void remove_renders(const char *folder) {
    for (int i = 0; i < SCENE_VIEWS; i++) {
        char name[64];
        snprintf(name, sizeof name, "%s/frame_%04d.png", folder, i);
        unlink(work(name));
    }
    unlink(work(in_project(folder, "cameras.json")));
    assert_int_equal(rmdir(work(folder)), 0);
}

/* The two that nobody sees go, or some at random; a model on standard output stands there alone. */
static void test_prune(void **state) {
    (void)state;
    clear_out();
    outcome o =
        run_ok("prune", "good.ply", SCENE, "--loss", "0.1dB", "-o", "out/p.ply", "--log", "out/p.json", "-q");
    assert_string_equal(o.err, "");
    assert_string_equal(o.out, "");
    free_outcome(&o);
    json_t *log = test_json(work("out/p.json")), *result = json_object_get(log, "result");
    json_t *before = json_object_get(result, "before");
    assert_true(count_in("out/p.ply") == (size_t)test_number(result, "gaussians"));
    assert_int_equal(test_number(before, "gaussians"), 5);
    assert_true(test_number(result, "train_psnr") >= test_number(before, "train_psnr") - 0.1);
    assert_true(test_number(result, "psnr") > 0 && test_number(before, "ssim") <= 1);
    content model = content_of("out/p.ply");
    assert_int_equal(test_number(result, "bytes"), model.size);
    assert_true(test_number(json_object_get(log, "options"), "loss") == 0.1);
    json_decref(log);

    o = run_ok("prune", "good.ply", SCENE, "--loss", "0.1", "-o", "-");
    assert_int_equal(o.out_size, model.size);
    assert_memory_equal(o.out, model.data, model.size);
    test_assert_contains(o.err, "before", __FILE__, __LINE__);
    free_outcome(&o);
    free(model.data);
    run_quietly(ARGS("prune", "good.ply", SCENE, "--random", "--to", "2", "-o", "out/r.ply", "-q"));
    assert_int_equal(count_in("out/r.ply"), 2);
}

static void test_render(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("render", "good.ply", SCENE, "--out", "out/r");
    assert_string_equal(o.err, "");
    free_outcome(&o);
    assert_int_equal(test_count_entries(work("out/r")), SCENE_VIEWS + 1);
    assert_png("out/r/frame_0000.png", SCENE_WIDTH, SCENE_HEIGHT);
    assert_png("out/r/frame_0008.png", SCENE_WIDTH, SCENE_HEIGHT);
    json_t *cameras = test_json(work("out/r/cameras.json"));
    assert_int_equal(json_array_size(cameras), SCENE_VIEWS);
    json_decref(cameras);
    remove_renders("out/r");
    run_quietly(
        ARGS("render", "good.ply", SCENE, "--out", "out/r", "--split", "test", "--background", "0.5,0,1"));
    assert_int_equal(test_count_entries(work("out/r")), SCENE_HELD_OUT + 1);
    assert_png("out/r/frame_0008.png", SCENE_WIDTH, SCENE_HEIGHT);
    remove_renders("out/r");
}

static void test_info(void **state) {
    (void)state;
    outcome o = run_ok("info", "good.ply");
    test_assert_contains(o.out, "5 Gaussians, SH degree 1", __FILE__, __LINE__);
    test_assert_contains(o.out, " of degree 0, ", __FILE__, __LINE__);
    test_assert_contains(o.out, "floats  ", __FILE__, __LINE__);
    assert_string_equal(o.err, "");
    free_outcome(&o);
    o = run_ok("info", "good");
    test_assert_contains(o.out, "4 views: 3 to train on, 1 held out", __FILE__, __LINE__);
    test_assert_contains(o.out, "COLMAP: ", __FILE__, __LINE__);
    test_assert_contains(o.out, "12 sparse points", __FILE__, __LINE__);
    test_assert_contains(o.out, "PINHOLE, 32x24 px", __FILE__, __LINE__);
    test_assert_contains(o.out, "held out: ", __FILE__, __LINE__);
    test_assert_contains(o.out, "a fit with the defaults takes up to ", __FILE__, __LINE__);
    assert_string_equal(o.err, "");
    free_outcome(&o);
    o = run_ok("info", SCENE, "--hold-out", "0");
    test_assert_contains(o.out, "9 views: 9 to train on, 0 held out", __FILE__, __LINE__);
    free_outcome(&o);
    o = run_ok("info", "good", "--json", "-");
    json_error_t error;
    json_t *json = json_loads(o.out, 0, &error);
    assert_non_null(json);
    assert_string_equal(json_string_value(json_object_get(json, "kind")), "COLMAP");
    assert_int_equal((int)test_number(json, "views"), 4);
    assert_int_equal((int)json_array_size(json_object_get(json, "held_out")), 1);
    assert_true(test_number(json_array_get(json_object_get(json, "cameras"), 0), "fx") > 0);
    assert_true(test_number(json_object_get(json, "fit_memory"), "total") > 1e6);
    json_decref(json);
    free_outcome(&o);
}

/* Nothing but objects on standard output, one a line, the last one at the end of the run. */
/* Each camera of the list begins a line; where there is none, a line says so. */
static void test_devices(void **state) {
    (void)state;
    outcome o = run_ok("devices"), j = run_ok("devices", "--json");
    json_error_t error;
    json_t *json = json_loads(j.out, JSON_REJECT_DUPLICATES, &error);
    if (!json) fail_msg("line %d: %s", error.line, error.text);
    const json_t *list = json_object_get(json, "devices");
    assert_true(json_is_array(list));
    size_t i, lines = 0;
    json_t *device;
    json_array_foreach(list, i, device) {
        assert_true(json_is_array(json_object_get(device, "modes")));
        test_assert_contains(o.out, json_string_value(json_object_get(device, "source")), __FILE__, __LINE__);
    }
    for (const char *c = o.out; *c; c = strchr(c, '\n') + 1) lines += *c != ' ';
    assert_int_equal(lines, i ? i : 1);
    if (!i) test_assert_contains(o.out, "no camera was found; folder:DIR", __FILE__, __LINE__);
    json_decref(json);
    free_outcome(&o);
    free_outcome(&j);
}

static void test_progress_as_json(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("fit", SCENE, "-o", "out/m.ply", "--steps", "20", SMALL, "--progress", "json");
    double step = 0;
    int lines = 0;
    for (char *line = o.out, *end; (end = strchr(line, '\n')); line = end + 1, lines++) {
        json_error_t error;
        *end = 0;
        json_t *json = json_loads(line, 0, &error);
        if (!json) fail_msg("\"%s\": %s", line, error.text);
        assert_true(test_number(json, "step") >= step && test_number(json, "steps") == 20);
        assert_true(test_number(json, "gaussians") > 0 && json_is_number(json_object_get(json, "loss")));
        step = test_number(json, "step");
        json_decref(json);
    }
    assert_true(lines >= 1);
    assert_int_equal(step, 20);
    free_outcome(&o);
}

/* The same bytes again, and by any number of threads. */
static void test_same_bytes(void **state) {
    (void)state;
    static const char *const threads[] = {"1", "1", "2", "4"};
    const char *steps = getenv("SPLATFIT_QUICK") ? "6" : "20";
    clear_out();
    for (int i = 0; i < 4; i++) {
        char name[32];
        snprintf(name, sizeof name, "out/%d.ply", i);
        run_quietly(ARGS("fit", SCENE, "-o", name, "--steps", steps, "--max-gaussians", "400", "--threads",
                         threads[i], "--cameras", i ? "none" : "out/c.json"));
        if (i) assert_same_files("out/0.ply", name);
    }
    assert_int_equal(test_count_entries(work("out")), 5);
    run_quietly(ARGS("fit", SCENE, "-o", "out/5.ply", "--steps", steps, SMALL, "--seed", "2"));
    content a = content_of("out/0.ply"), b = content_of("out/5.ply");
    assert_true(a.size != b.size || memcmp(a.data, b.data, a.size));
    free(a.data);
    free(b.data);
    assert_same_files("out/c.json", "out/cameras.json");
}

#define SHORT_FIT SCENE, "--steps", "10", SMALL

static void test_model_to_standard_output(void **state) {
    (void)state;
    clear_out();
    run_quietly(ARGS("fit", SHORT_FIT, "-o", "out/m.ply"));
    assert_int_equal(unlink(work("out/cameras.json")), 0);
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

/* A model gone on from: not worse by more than 0.5 dB after 20 steps. */
static void test_from(void **state) {
    (void)state;
    int quick = getenv("SPLATFIT_QUICK") != NULL;
    clear_out();
    run_quietly(ARGS("fit", SCENE, "-o", "out/a.ply", "--steps", quick ? "20" : "60", SMALL));
    run_quietly(
        ARGS("fit", SCENE, "-o", "out/b.ply", "--steps", quick ? "7" : "20", SMALL, "--from", "out/a.ply"));
    double psnr[2];
    for (int i = 0; i < 2; i++) {
        run_quietly(
            ARGS("eval", i ? "out/b.ply" : "out/a.ply", SCENE, "--split", "train", "--json", "out/e.json"));
        json_t *json = test_json(work("out/e.json"));
        psnr[i] = test_number(json, "psnr");
        json_decref(json);
    }
    print_message("%.2f dB, after a third more steps %.2f dB\n", psnr[0], psnr[1]);
    assert_true(psnr[1] >= psnr[0] - 0.5);
}

/* Going on and repeating. */

static void wait_for_text(pid_t pid, const char *text) {
    double since = now();
    int status = 0, found = 0;
    while (!found) {
        size_t size;
        char *out = (char *)test_read(test_path("stdout"), &size);
        found = strstr(out, text) != NULL;
        free(out);
        if (!found && has_ended(pid, since, &status)) fail_msg("ended before it said \"%s\"", text);
        if (!found) test_pause_ms(5);
    }
}

/* Interrupted by a signal, gone on with: the bytes of a run that was not. */
static void test_resume(void **state) {
    (void)state;
    const char *steps = getenv("SPLATFIT_QUICK") ? "60" : "400";
    clear_out();
    run_quietly(ARGS("fit", SCENE, "-o", "out/a.ply", "--steps", steps, SMALL, "--cameras", "none"));
    pid_t pid = start_program(ARGS("fit", SCENE, "-o", "out/b.ply", "--steps", steps, "--max-gaussians",
                                   "400", "--threads", "1", "--checkpoint", "out/c", "--checkpoint-every",
                                   "0", "--progress", "plain", "--cameras", "none"),
                              NULL);
    wait_for_text(pid, "step ");
    kill(pid, SIGTERM);
    outcome o = wait_for(pid);
    assert_true(o.code == 128 + SIGTERM || o.code == 0);
    free_outcome(&o);
    o = run_ok("fit", SCENE, "-o", "out/b.ply", "--resume", "out/c", "--checkpoint", "out/c", "--threads",
               "2", "--cameras", "none", "--log", "out/log.json");
    test_assert_contains(o.out, "going on after step ", __FILE__, __LINE__);
    free_outcome(&o);
    assert_same_files("out/a.ply", "out/b.ply");
    json_t *log = test_json(work("out/log.json"));
    assert_true(test_number(json_object_get(log, "options"), "max_gaussians") == 400);
    json_decref(log);

    assert_int_equal(rename(work("out/c"), work("c")), 0);
    clear_out();
    static const bad_input cases[] = {
        {FAILED, "c: sh_degree: the run has 3", {"fit", SCENE, "--resume", "c", "--sh-degree", "2"}},
        {FAILED, "c: is of another scene", {"fit", SCENE, "--resume", "c", "--downscale", "2"}},
        {FAILED, "good.ply: is not a checkpoint", {"fit", SCENE, "--resume", "good.ply"}},
        {FAILED, "absent: cannot be opened", {"fit", SCENE, "--resume", "absent"}},
        {USAGE, "from: cannot be given", {"fit", SCENE, "--resume", "c", "--from", "good.ply"}},
        {FAILED, "empty: is a folder", {"fit", SCENE, "--checkpoint", "empty"}},
        {USAGE, "--checkpoint-every: \"-1\"", {"fit", SCENE, "--checkpoint-every", "-1"}},
        {FAILED, "memory: 1 MB are not enough", {"fit", SCENE, "--memory", "1M"}},
    };
    for (size_t i = 0; i < COUNT(cases); i++) assert_refused(cases[i].args, cases[i].code, cases[i].part, 0);
}

/* The old checkpoint stays where there is no room for the new one, and the exit code tells of it. */
static void test_checkpoint_too_large(void **state) {
    (void)state;
    clear_out();
    write_text("out/c", "the old checkpoint");
    launch limited = {.file_limit = 8192};
    outcome o = wait_for(start_program(
        ARGS("fit", SHORT_FIT, "--quiet", "-o", "/dev/null", "--cameras", "none", "--checkpoint", "out/c"),
        &limited));
    assert_int_equal(o.code, FAILED);
    test_assert_contains(o.err, "out/c: ", __FILE__, __LINE__);
    free_outcome(&o);
    content c = content_of("out/c");
    assert_string_equal(c.data, "the old checkpoint");
    free(c.data);
    assert_int_equal(test_count_entries(work("out")), 1);
}

static void write_changed(const char *name, json_t *log, const char *key, json_t *value) {
    json_t *copy = json_deep_copy(log);
    if (value)
        json_object_set_new(copy, key, value);
    else
        json_object_del(copy, key);
    assert_int_equal(json_dump_file(copy, work(name), 0), 0);
    json_decref(copy);
}

/* A run limited by time, again, as fast as it goes. */
static void test_replay(void **state) {
    (void)state;
    clear_out();
    const char *limit =
        getenv("SPLATFIT_QUICK") ? "3" : "1"; /* a program with sanitizers has read the scene by then */
    run_quietly(ARGS("fit", SCENE, "-o", "out/a.ply", "--time-limit", limit, SMALL, "--log", "out/a.json",
                     "--cameras", "none", "--seed", "3"));
    run_quietly(ARGS("fit", SCENE, "-o", "out/b.ply", "--replay", "out/a.json", "--threads", "1", "--log",
                     "out/b.json", "--cameras", "none"));
    assert_same_files("out/a.ply", "out/b.ply");
    json_t *a = test_json(work("out/a.json")), *b = test_json(work("out/b.json")),
           *times = json_object_get(a, "plan");
    assert_true(json_equal(times, json_object_get(b, "plan")));
    assert_true(json_equal(json_object_get(a, "options"), json_object_get(b, "options")));
    assert_true(test_number(times, "steps") == test_number(json_object_get(a, "result"), "steps"));
    write_changed("other.json", a, "isa", json_string("abacus"));
    write_changed("version.json", a, "version", json_string("0"));
    write_changed("planless.json", a, "plan", NULL);
    write_changed("plan.json", a, "plan",
                  json_pack("{s:i,s:i,s:s}", "ticks", 1 << 24, "steps", 3, "deltas", "5 6"));
    write_changed("optionless.json", a, "options", NULL);
    write_changed("options.json", a, "options", json_object());
    write_changed("from.json", a, "warm_start", json_true());
    json_decref(a);
    json_decref(b);
    assert_int_equal(rename(work("out/a.json"), work("a.json")), 0);
    clear_out();
    static const bad_input cases[] = {
        {FAILED, "steps: is given again", {"fit", SCENE, "--replay", "a.json", "--steps", "5"}},
        {FAILED, "a.json: scene: ", {"fit", SCENE, "--replay", "a.json", "--downscale", "2"}},
        {FAILED, "other.json: isa: ", {"fit", SCENE, "--replay", "other.json"}},
        {FAILED, "version.json: version: ", {"fit", SCENE, "--replay", "version.json"}},
        {FAILED, "planless.json: plan: ", {"fit", SCENE, "--replay", "planless.json"}},
        {FAILED, "plan.json: plan: ", {"fit", SCENE, "--replay", "plan.json"}},
        {FAILED, "optionless.json: options: ", {"fit", SCENE, "--replay", "optionless.json"}},
        {FAILED, "options.json: steps: is missing", {"fit", SCENE, "--replay", "options.json"}},
        {FAILED, "from.json: gone_on: ", {"fit", SCENE, "--replay", "from.json"}},
        {FAILED, "good.ply: line 1: ", {"fit", SCENE, "--replay", "good.ply"}},
        {FAILED, "/dev/zero: is not a regular file", {"fit", SCENE, "--replay", "/dev/zero"}},
        {FAILED, "absent.json: No such file", {"fit", SCENE, "--replay", "absent.json"}},
    };
    for (size_t i = 0; i < COUNT(cases); i++) assert_refused(cases[i].args, cases[i].code, cases[i].part, 0);
}

/* MB that the program has had resident, by its log. */
static double peak_in(const char *name) {
    json_t *log = test_json(work(name));
    double peak = test_number(json_object_get(log, "result"), "peak_memory_mb");
    json_decref(log);
    return peak;
}

/* The cap that the memory allows, said in one line. What a sanitizer or an emulator takes is found out first.
 */
static void test_memory(void **state) {
    (void)state;
    char budget[32];
    clear_out();
    run_quietly(ARGS("fit", SCENE, "-o", "/dev/null", "--steps", "1", "--log", "out/log.json"));
    double allowed = floor(peak_in("out/log.json")) + 100;
    snprintf(budget, sizeof budget, "%.0fM", allowed);
    outcome o = run_ok("fit", SCENE, "-o", "/dev/null", "--steps", "1", "--max-gaussians", "1000000",
                       "--memory", budget, "--log", "out/log.json");
    test_assert_contains(o.out, "memory: about ", __FILE__, __LINE__);
    test_assert_contains(o.err, "max_gaussians lowered from 1000000 to ", __FILE__, __LINE__);
    free_outcome(&o);
    json_t *log = test_json(work("out/log.json")), *options = json_object_get(log, "options");
    assert_true(test_number(options, "max_gaussians") > 1000 &&
                test_number(options, "max_gaussians") < 200000);
    assert_true(test_number(options, "memory") == allowed * 1048576);
    json_decref(log);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    assert_true(peak_in("out/log.json") <= allowed);
#endif
    clear_out();
    assert_refused(ARGS("fit", "good", "-o", "out/x.ply", "--memory", "10K"), FAILED,
                   "good: memory: 0 MB are not enough: the pictures take about ", 0);
}

/* Signals and full disks. */

/* A fit that is under way. */
static pid_t start_endless(const char *model) {
    pid_t pid = start_program(ARGS("fit", SCENE, "-o", model, "--steps", "100000000", SMALL, "--progress",
                                   "plain", "--log", "out/log.json"),
                              NULL);
    wait_for_text(pid, "step ");
    return pid;
}

/* The model so far is written, whole, and the exit code tells which signal it was. */
static void check_signal(int number_of_signal) {
    clear_out();
    pid_t pid = start_endless("out/m.ply");
    assert_int_equal(kill(pid, number_of_signal), 0);
    test_pause_ms(1);
    assert_int_equal(kill(pid, number_of_signal), 0); /* as timeout(1) does */
    outcome o = wait_for(pid);
    assert_int_equal(o.signal, 0);
    assert_int_equal(o.code, 128 + number_of_signal);
    test_assert_contains(o.out, "stopped after ", __FILE__, __LINE__);
    test_assert_contains(o.out, "wrote out/m.ply", __FILE__, __LINE__);
    free_outcome(&o);
    assert_true(count_in("out/m.ply") > 0);
    assert_int_equal(test_count_entries(work("out")), 3);
    json_t *log = test_json(work("out/log.json")), *result = json_object_get(log, "result");
    assert_true(json_is_false(json_object_get(result, "complete")));
    assert_string_equal(json_string_value(json_object_get(result, "end")), "signal");
    assert_true(test_number(result, "steps") >= 1 && test_number(result, "steps") < 100000000);
    json_decref(log);
}

static void test_interrupted(void **state) {
    (void)state;
    check_signal(SIGINT);
}

static void test_terminated(void **state) {
    (void)state;
    check_signal(SIGTERM);
}

/* A model that nobody reads holds the program up; who asks a second time, a second later, is rid of it. */
static void test_interrupted_twice(void **state) {
    (void)state;
    clear_out();
    assert_int_equal(mkfifo(work("out/pipe"), 0600), 0);
    pid_t pid = start_endless("out/pipe");
    assert_int_equal(kill(pid, SIGINT), 0);
    test_pause_ms(1200);
    int status;
    assert_int_equal(waitpid(pid, &status, WNOHANG), 0);
    assert_int_equal(kill(pid, SIGINT), 0);
    outcome o = wait_for(pid);
    assert_int_equal(o.signal, SIGINT);
    free_outcome(&o);
}

/* No room for the new model: the old one stays, and nothing beside it. */
static void test_file_too_large(void **state) {
    (void)state;
    clear_out();
    write_text("out/m.ply", "the old model");
    launch limited = {.file_limit = 8192};
    outcome o = wait_for(start_program(ARGS("fit", SHORT_FIT, "--quiet", "-o", "out/m.ply"), &limited));
    assert_int_equal(o.code, FAILED);
    test_assert_contains(o.err, "out/m.ply: ", __FILE__, __LINE__);
    test_assert_contains(o.err, "File too large", __FILE__, __LINE__);
    assert_ptr_equal(strchr(o.err, '\n'), o.err + strlen(o.err) - 1);
    free_outcome(&o);
    content c = content_of("out/m.ply");
    assert_string_equal(c.data, "the old model");
    free(c.data);
    assert_int_equal(test_count_entries(work("out")), 1);
}

/* Models in other formats. */

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

/* What all tests share. */

static void write_model(void) {
    sf_context *ctx = test_context();
    sf_model *model;
    float values[5 * 3];
    for (int i = 0; i < 15; i++) values[i] = 0.2f * (float)(i % 4);
    sf_gaussians from = {.means = values, .logit_opacities = values};
    assert_ok(ctx, sf_model_create(ctx, 5, 1, &model));
    assert_ok(ctx, sf_model_set(model, 0, 5, &from));
    assert_ok(ctx, sf_model_save(model, work("good.ply")));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static int set_up(void **state) {
    if (program_set_up(state)) return -1;
    plan p = good_plan();
    make_folder("empty");
    make_folder("empty.ply");
    write_text("file", "text\n");
    write_text("list", "nobody\n");
    write_model();
    write_project("good", &p);
    return 0;
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
        cmocka_unit_test(test_help),
        cmocka_unit_test(test_help_is_complete),
        cmocka_unit_test(test_options_are_given_once),
        cmocka_unit_test(test_fits_antialiased),
        cmocka_unit_test(test_fit_writes_all),
        cmocka_unit_test(test_quiet_and_cameras),
        cmocka_unit_test(test_eval),
        cmocka_unit_test(test_prune),
        cmocka_unit_test(test_render),
        cmocka_unit_test(test_info),
        cmocka_unit_test(test_devices),
        cmocka_unit_test(test_progress_as_json),
        cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_model_to_standard_output),
        cmocka_unit_test(test_model_to_a_pipe),
        cmocka_unit_test(test_model_to_a_device),
        cmocka_unit_test(test_from),
        cmocka_unit_test(test_resume),
        cmocka_unit_test(test_checkpoint_too_large),
        cmocka_unit_test(test_replay),
        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_interrupted),
        cmocka_unit_test(test_terminated),
        cmocka_unit_test(test_interrupted_twice),
        cmocka_unit_test(test_file_too_large),
        cmocka_unit_test(test_convert),
        cmocka_unit_test(test_formats),
        cmocka_unit_test(test_convert_refuses),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
