/* test_outputs.c - the program from outside: models moved on their way, pictures along paths, films. */
#include "program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/rng.h"

#define SAYS(outcome, part)  test_assert_contains((outcome).out, part, __FILE__, __LINE__)
#define WARNS(outcome, part) test_assert_contains((outcome).err, part, __FILE__, __LINE__)

enum { BLOBS = 7 };

/* Blobs on the axes: at +x, -x, +y, ... of 1, 2, 3, ...; and one in the middle. */
static int set_up(void **state) {
    static float means[3 * BLOBS], scales[3 * BLOBS], logits[BLOBS], sh[12 * BLOBS], quats[4 * BLOBS];
    if (program_set_up(state)) return 1;
    sf_context *ctx = test_context();
    sf_model *model;
    for (size_t i = 0; i < BLOBS; i++) {
        if (i < 6) means[3 * i + i / 2] = i % 2 ? -(float)(i + 1) : (float)(i + 1);
        for (size_t k = 0; k < 3; k++) scales[3 * i + k] = -2;
        quats[4 * i] = 1;
        logits[i] = 3;
        sh[12 * i + i % 3] = 1.5f;
    }
    const sf_gaussians g = {means, quats, scales, logits, sh};
    assert_ok(ctx, sf_model_create(ctx, BLOBS, 1, &model));
    assert_ok(ctx, sf_model_set(model, 0, BLOBS, &g));
    assert_ok(ctx, sf_model_save(model, work("axes.ply")));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
    return 0;
}

/* The mean of Gaussian i of a file. */
static void mean_in(const char *name, size_t i, float mean[3]) {
    sf_context *ctx = test_context();
    sf_model *model;
    const sf_gaussians g = {.means = mean};
    assert_ok(ctx, sf_model_load(ctx, work(name), &model));
    assert_ok(ctx, sf_model_get(model, i, 1, &g));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void assert_mean(const char *name, size_t i, double x, double y, double z) {
    float mean[3];
    const double wanted[3] = {x, y, z};
    mean_in(name, i, mean);
    for (int k = 0; k < 3; k++) assert_float_equal(mean[k], wanted[k], 1e-5);
}

/* ---- Models moved ---- */

/* Down a pipe, which cannot be read again and held against what it was made from: that takes its time. */
#define CONVERT_TO(name, ...) keep(name, ARGS("convert", "axes.ply", "-", __VA_ARGS__))
static void keep(const char *name, const char *const *args) {
    outcome o = run_args_ok(args);
    test_write(work(name), o.out, o.out_size);
    free_outcome(&o);
}

static void test_up_axes(void **state) {
    (void)state;
    static const char *const axes[] = {"x", "-x", "y", "-y", "z", "-z"};
    clear_out();
    for (size_t i = 0; i < COUNT(axes); i++) {
        CONVERT_TO("out/up.ply", "--up", axes[i]);
        assert_mean("out/up.ply", i, 0, -(double)(i + 1), 0);
    }
}

static void test_motions_in_order(void **state) {
    (void)state;
    clear_out();
    /* +x by 90 degrees about z is +y; about x then y: +y is +z is +x. */
    CONVERT_TO("out/m.ply", "--rotate", "0,0,90");
    assert_mean("out/m.ply", 0, 0, 1, 0);
    CONVERT_TO("out/m.ply", "--rotate", "90,90,0", "--scale", "2", "--move", "10,0,-1");
    assert_mean("out/m.ply", 2, 16, 0, -1);
    outcome o = run_ok("convert", "axes.ply", "out/m.ply", "--move", "0,0,1", "--crop", "-9,-9,0.5,1.5,1,7");
    SAYS(o, "; 5 Gaussians, SH degree 1");
    free_outcome(&o);
    assert_mean("out/m.ply", 3, 0, 0, 6);
    run_quietly(ARGS("convert", "axes.ply", "out/m.splat", "--crop", "0,0,0,9,9,9", "-q"));
    assert_int_equal(count_in("out/m.splat"), 4);
}

static void test_motions_are_refused(void **state) {
    (void)state;
    clear_out();
#define CONVERT "convert", "axes.ply", "out/x.ply"
    static const bad_input cases[] = {
        {USAGE, "--up: \"w\" is none of x, -x, y, -y, z, -z", {CONVERT, "--up", "w"}},
        {USAGE, "--up: \"-\" is none of", {CONVERT, "--up", "-"}},
        {USAGE, "--rotate: \"1,2\" is not 3 numbers set apart by commas", {CONVERT, "--rotate", "1,2"}},
        {USAGE, "--rotate: \"1,2,nan\" is not 3 numbers", {CONVERT, "--rotate", "1,2,nan"}},
        {USAGE, "--scale: is not above 0", {CONVERT, "--scale", "0"}},
        {USAGE, "--scale: \"two\" is not 1 number", {CONVERT, "--scale", "two"}},
        {USAGE, "--crop: y: 1 is not below -1", {CONVERT, "--crop", "0,1,0,1,-1,1"}},
        {FAILED, "box: no Gaussian lies in it", {CONVERT, "--crop", "50,50,50,51,51,51"}},
        {USAGE, "its views do not see the model", {CONVERT, SCENE, "--up", "z"}},
    };
    assert_all_refused(cases, COUNT(cases));
}

/* ---- Pictures along paths ---- */

static size_t lines_of(const char *name) {
    content c = content_of(name);
    size_t lines = 0;
    for (size_t i = 0; i < c.size; i++) lines += c.data[i] == '\n';
    free(c.data);
    return lines;
}

static void test_orbit(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("render", "axes.ply", "--path", "orbit", "--frames", "4", "--size", "64x48", "--fov",
                       "60", "--distance", "20", "--up", "z", "--elevation", "30", "--out", "out", "--depth",
                       "--depth-unit", "0.01", "--transmittance");
    SAYS(o, "wrote 4 pictures to out");
    free_outcome(&o);
    /* Three pictures each, path.txt and depth.json. */
    assert_int_equal(test_count_entries(work("out")), 4 * 3 + 2);
    assert_png("out/frame_00003.png", 64, 48);
    assert_png("out/frame_00000.depth.png", 64, 48);
    assert_png("out/frame_00000.transmittance.png", 64, 48);
    assert_int_equal(lines_of("out/path.txt"), 5);
    json_t *depth = test_json(work("out/depth.json"));
    assert_true(test_number(depth, "unit") == 0.01);
    json_decref(depth);
    /* It stands where it was told to: 20 off the middle, 10 of them upwards. */
    content path = content_of("out/path.txt");
    double c[3];
    assert_int_equal(sscanf(strchr(path.data, '\n'), "%*f %lf %lf %lf", &c[0], &c[1], &c[2]), 3);
    assert_float_equal(c[2], 10, 1e-4);
    assert_float_equal(hypot(hypot(c[0], c[1]), c[2]), 20, 1e-4);
    free(path.data);
}

enum { PLACES = 2000 };

/* Where a shape has its i-th Gaussian, [-1, 1] in most cases; `r`: a number that is as good as random. */
typedef void (*shape_fn)(size_t i, const double r[3], double at[3]);

/* Walls, of which one in three Gaussians is, and a floor at z = -1 with low things on it. */
static void in_room(size_t i, const double r[3], double at[3]) {
    for (int k = 0; k < 3; k++) at[k] = r[k];
    if (i % 3)
        at[2] = -1 + 0.2 * fabs(r[2]);
    else
        at[i / 3 % 2] = i / 6 % 2 ? 1 : -1;
}

static void in_ball(size_t i, const double r[3], double at[3]) {
    double length = hypot(hypot(r[0], r[1]), r[2]), radius = cbrt((double)(i % 997) / 997);
    for (int k = 0; k < 3; k++) at[k] = radius * r[k] / length;
}

/* A third of it in front of what lies far away, on all sides. */
static void before_a_horizon(size_t i, const double r[3], double at[3]) {
    in_ball(i % 3 ? 0 : i, r, at);
    for (int k = 0; k < 3; k++) at[k] = i % 3 ? 30 * r[k] / hypot(r[0], r[1]) : at[k];
}

/* What a camera inside sees of a wall. */
static void on_one_side(size_t i, const double r[3], double at[3]) {
    in_room(i, r, at);
    at[0] = 2 + fabs(at[0]);
}

static void save_shape(const char *name, shape_fn place) {
    static float means[3 * PLACES], scales[3 * PLACES], logits[PLACES], sh[3 * PLACES], quats[4 * PLACES];
    sf_context *ctx = test_context();
    sf_model *model;
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    for (size_t i = 0; i < PLACES; i++) {
        double r[3], at[3];
        for (size_t k = 0; k < 3; k++) r[k] = 2 * sf_rng_uniform(&rng) - 1;
        place(i, r, at);
        for (size_t k = 0; k < 3; k++) means[3 * i + k] = (float)at[k], scales[3 * i + k] = -3;
        quats[4 * i] = 1;
        logits[i] = 3;
    }
    const sf_gaussians g = {means, quats, scales, logits, sh};
    assert_ok(ctx, sf_model_create(ctx, PLACES, 0, &model));
    assert_ok(ctx, sf_model_set(model, 0, PLACES, &g));
    assert_ok(ctx, sf_model_save(model, work(name)));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Of four pictures around the model: each centre, and which way it looks. */
static void turn_around(const char *const more[2], double centers[4][3], double ahead[4][3]) {
    clear_out();
    run_quietly(ARGS("render", "shape.ply", "--path", "orbit", "--frames", "4", "--size", "16x12", "--up",
                     "z", "--out", "out", "-q", more[0], more[1]));
    content path = content_of("out/path.txt");
    const char *line = path.data;
    for (int i = 0; i < 4; i++) {
        double q[4], *c = centers[i];
        line = strchr(line, '\n') + 1;
        assert_int_equal(
            sscanf(line, "%*f %lf %lf %lf %lf %lf %lf %lf", &c[0], &c[1], &c[2], &q[0], &q[1], &q[2], &q[3]),
            7);
        ahead[i][0] = 2 * (q[0] * q[2] + q[3] * q[1]);
        ahead[i][1] = 2 * (q[1] * q[2] - q[3] * q[0]);
        ahead[i][2] = 1 - 2 * (q[0] * q[0] + q[1] * q[1]);
    }
    free(path.data);
}

/* A room is looked at from its middle, outwards; what is no room, or is to be seen from a distance, from
 * there, inwards. */
static void test_room_and_object(void **state) {
    (void)state;
    static const char *const from_afar[] = {"--distance", "5"}, *const inside[] = {"--distance", "0"};
    static const struct {
        shape_fn place;
        const char *const *more;
        int outwards;
    } cases[] = {{in_room, NULL, 1},     {in_ball, NULL, 0},      {before_a_horizon, NULL, 0},
                 {on_one_side, NULL, 0}, {in_room, from_afar, 0}, {in_ball, inside, 1}};
    for (size_t i = 0; i < COUNT(cases); i++) {
        static const char *const nothing[2];
        double centers[4][3], ahead[4][3];
        save_shape("shape.ply", cases[i].place);
        turn_around(cases[i].more ? cases[i].more : nothing, centers, ahead);
        for (int k = 0; k < 4; k++) {
            const double *c = centers[k], *d = ahead[k], *before = ahead[(k + 3) % 4];
            if (cases[i].outwards) {
                for (int n = 0; n < 3; n++) assert_true(fabs(c[n]) < 0.5);
                assert_float_equal(d[2], 0, 1e-5);
            } else {
                const double *o = centers[(k + 2) % 4]; /* on the other side */
                assert_true(hypot(c[0] - o[0], c[1] - o[1]) > 2.4);
                assert_float_equal(d[2], -sin(20 / 57.29577951308232), 1e-5);
            }
            /* A quarter of a turn after the one before. */
            assert_float_equal(d[0] * before[0] + d[1] * before[1], 0, 1e-4);
            assert_true(fabs(d[0]) + fabs(d[1]) > 0.5);
        }
    }
}

/* The path that is written leads along the same places. */
static void test_path_of_a_file(void **state) {
    (void)state;
    clear_out();
    run_quietly(ARGS("render", "axes.ply", SCENE, "--path", "cameras", "--keyframes", "3", "--fps", "4",
                     "--out", "out", "-q"));
    assert_int_equal(lines_of("out/path.txt"), 10);
    assert_png("out/frame_00008.png", SCENE_WIDTH, SCENE_HEIGHT);
    content first = content_of("out/path.txt");
    test_write(work("path.txt"), first.data, first.size);
    clear_out();
    run_quietly(ARGS("render", "axes.ply", SCENE, "--path", "path.txt", "--fps", "4", "--out", "out", "-q"));
    assert_int_equal(lines_of("out/path.txt"), 10);
    content again = content_of("out/path.txt");
    double a, b;
    char *p = strchr(first.data, '\n'), *q = strchr(again.data, '\n');
    for (int i = 0; i < 9 * 8; i++) {
        char *after;
        a = strtod(p, &after), p = after;
        b = strtod(q, &after), q = after;
        assert_float_equal(a, b, 3e-6);
    }
    free(again.data);
    free(first.data);
}

/* A model that states an origin is seen from the places of the world, of a path as of a cameras.json, which
 * may state another one. */
static void test_far_from_0(void **state) {
    (void)state;
#define CAMERA(at)                                                                                           \
    "[{\"width\": 64, \"height\": 48, \"fx\": 48, \"fy\": 48, \"rotation\": [[1, 0, 0], [0, 1, 0], [0, 0, "  \
    "1]], " at "}]"
    static const char *const paths[2] = {"0 0 0 -8 0 0 0 1\n1 0 0 -8 0 0 0 1\n",
                                         "0 500000 5000000 120 0 0 0 1\n1 500000 5000000 120 0 0 0 1\n"};
    static const char *const cameras[2] = {
        CAMERA("\"position\": [0, 0, -8]"),
        CAMERA("\"position\": [-8, 0, 20], \"origin\": [500008, 5000000, 100]")};
    static const double utm[3] = {500000, 5000000, 128};
    content seen[2][2];
    save_shape("shape.ply", in_ball);
    for (int far = 0; far < 2; far++) {
        test_write(work("path.txt"), paths[far], strlen(paths[far]));
        test_write(work("cameras.txt"), cameras[far], strlen(cameras[far]));
        for (int orbit = 0; orbit < 2; orbit++) {
            clear_out();
            run_quietly(ARGS("render", "shape.ply", "--path", orbit ? "orbit" : "path.txt", "--frames", "1",
                             "--size", "64x48", "--out", "out", "-q", orbit ? "--cameras" : "--fps",
                             orbit ? "cameras.txt" : "1"));
            seen[far][orbit] = content_of("out/frame_00000.png");
        }
        sf_context *ctx = test_context();
        sf_model *model;
        sf_scene *scene;
        assert_ok(ctx, sf_model_load(ctx, work("shape.ply"), &model));
        assert_ok(ctx, sf_scene_create(ctx, &scene));
        assert_ok(ctx, sf_scene_set_origin(scene, utm));
        sf_scene_place_model(scene, model);
        assert_ok(ctx, sf_model_save(model, work("shape.ply")));
        sf_scene_destroy(&scene);
        sf_model_destroy(&model);
        sf_context_destroy(&ctx);
    }
    for (int orbit = 0; orbit < 2; orbit++) {
        assert_int_equal(seen[1][orbit].size, seen[0][orbit].size);
        assert_memory_equal(seen[1][orbit].data, seen[0][orbit].data, seen[0][orbit].size);
        for (int far = 0; far < 2; far++) free(seen[far][orbit].data);
    }
    assert_true(seen[0][0].size != seen[0][1].size);
}

/* A stream is of the same pictures: bytes of one frame by its size, odd sides rounded up. */
static void test_film(void **state) {
    (void)state;
    static const char head[] = "YUV4MPEG2 W33 H21 F25:1 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n";
    clear_out();
#define FILM "render", "axes.ply", "--path", "orbit", "--frames", "3", "--size", "33x21", "--fps", "25"
    outcome o = run_ok(FILM, "--out", "-", "--format", "y4m");
    size_t frame = strlen("FRAME\n") + 33 * 21 + 2 * 17 * 11;
    assert_int_equal(o.out_size, strlen(head) + 3 * frame);
    assert_memory_equal(o.out, head, strlen(head));
    WARNS(o, "wrote 3 pictures to -");
    run_quietly(ARGS(FILM, "--out", "out/film.y4m", "-q"));
    content film = content_of("out/film.y4m");
    assert_int_equal(film.size, o.out_size);
    assert_memory_equal(film.data, o.out, film.size);
    free(film.data);
    free_outcome(&o);
    run_quietly(ARGS(FILM, "--out", "out/film.y4m", "--chroma", "444", "--matrix", "709", "-q"));
    film = content_of("out/film.y4m");
    assert_non_null(strstr(film.data, "C444"));
    free(film.data);
}

static void test_renders_are_refused(void **state) {
    (void)state;
    clear_out();
    write_text("bad.txt", "0 1 2\n");
    write_text("bad.json", "[{\"width\": 5}]");
#define RENDER "render", "axes.ply", "--out", "out/r"
#define ORBIT  RENDER, "--path", "orbit"
    static const bad_input cases[] = {
        {USAGE, "PROJECT: is needed, or --path", {RENDER}},
        {USAGE, "PROJECT: is needed for --path cameras", {RENDER, "--path", "cameras"}},
        {USAGE, "--size: goes with --path", {RENDER, SCENE, "--size", "64x48"}},
        {USAGE, "--size: \"64\" is not WxH", {ORBIT, "--size", "64"}},
        {USAGE, "--fov: is not in 1..170", {ORBIT, "--fov", "180"}},
        {USAGE, "--frames: \"0\" is not a whole number", {ORBIT, "--frames", "0"}},
        {USAGE, "--up: \"up\" is none of", {ORBIT, "--up", "up"}},
        {USAGE, "--distance: is below 0", {ORBIT, "--distance", "-1"}},
        {USAGE, "--elevation: is not in -90..90", {ORBIT, "--elevation", "91"}},
        {USAGE, "--format: \"mp4\" is neither png nor y4m", {ORBIT, "--format", "mp4"}},
        {USAGE, "--chroma: is of a stream", {ORBIT, "--chroma", "444"}},
        {USAGE, "--depth: is of pictures", {ORBIT, "--format", "y4m", "--depth"}},
        {USAGE, "--depth-unit: goes with --depth", {ORBIT, "--depth-unit", "1"}},
        {USAGE, "--depth-unit: is not above 0", {ORBIT, "--depth", "--depth-unit", "0"}},
        {USAGE,
         "PNG files go to a folder",
         {"render", "axes.ply", "--path", "orbit", "--out", "-", "--format", "png"}},
        {FAILED, "bad.txt: line 1: ", {RENDER, "--path", "bad.txt"}},
        {FAILED, "absent: ", {RENDER, "--path", "absent"}},
        {FAILED, "bad.json: camera 0: height: ", {ORBIT, "--cameras", "bad.json"}},
    };
    assert_all_refused(cases, COUNT(cases));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_up_axes),
        cmocka_unit_test(test_motions_in_order),
        cmocka_unit_test(test_motions_are_refused),
        cmocka_unit_test(test_orbit),
        cmocka_unit_test(test_room_and_object),
        cmocka_unit_test(test_path_of_a_file),
        cmocka_unit_test(test_far_from_0),
        cmocka_unit_test(test_film),
        cmocka_unit_test(test_renders_are_refused),
    };
    return cmocka_run_group_tests_name("outputs", tests, set_up, NULL);
}
