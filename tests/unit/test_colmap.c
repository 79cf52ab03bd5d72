/* test_colmap.c - COLMAP projects, whole and malformed, and what all projects share: pictures, splits, skips.
 */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <turbojpeg.h>
#include <unistd.h>

enum { WIDTH = 24, HEIGHT = 16, PIXELS = WIDTH * HEIGHT };

/* The project that the tests write. */

typedef struct camera {
    unsigned id;
    int model;
    const char *model_name;
    double width, height;
    int parameters;
    double parameter[16];
} camera;

typedef struct image {
    unsigned id, camera;
    double q[4], t[3];
    const char *name;
    int observations;
} image;

static const camera cameras[] = {
    {7, 1, "PINHOLE", WIDTH, HEIGHT, 4, {20, 21, 12.5, 8.25}},
    {2, 2, "SIMPLE_RADIAL", 2 * WIDTH, 2 * HEIGHT, 4, {40, 24, 16, -0.05}},
    {3, 0, "SIMPLE_PINHOLE", WIDTH, HEIGHT, 3, {19, 12, 8}},
};
static const image images[] = {
    {4, 7, {1, 0, 0, 0}, {0.1, -0.2, 3}, "c.png", 2},
    {1, 2, {2, 0, 0, 2}, {1, 2, 3}, "b.png", 0}, /* a quarter turn around z, not normalised */
    {9, 3, {0.5, 0.5, -0.5, 0.5}, {0, 0, 1e-3}, "sub/a 1.png", 1},
    {5, 7, {0.1, -0.9, 0.3, 0.2}, {-4, 0.25, 1. / 3}, "a.png", 3},
};
static const double points[3][3] = {{1, 2, 3}, {-0.1, 1e-3, 7.25}, {4, 5, -6}};
enum { CAMERAS = 3, IMAGES = 4, POINTS = 3 };

/* A file in the making. */
typedef struct buffer {
    uint8_t data[4096];
    size_t size;
} buffer;

static void add(buffer *b, const void *data, size_t size) {
    assert_true(size <= sizeof b->data - b->size);
    memcpy(b->data + b->size, data, size);
    b->size += size;
}

static void add_uint(buffer *b, uint64_t v, int bytes) {
    for (int i = 0; i < bytes; i++) {
        uint8_t byte = (uint8_t)(v >> (8 * i));
        add(b, &byte, 1);
    }
}

static void add_doubles(buffer *b, const double *v, int count) {
    for (int i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &v[i], 8);
        add_uint(b, bits, 8);
    }
}

static void add_camera(buffer *b, const camera *c) {
    add_uint(b, c->id, 4);
    add_uint(b, (uint64_t)c->model, 4);
    add_uint(b, (uint64_t)c->width, 8);
    add_uint(b, (uint64_t)c->height, 8);
    add_doubles(b, c->parameter, c->parameters);
}

static void add_image(buffer *b, const image *v) {
    add_uint(b, v->id, 4);
    add_doubles(b, v->q, 4);
    add_doubles(b, v->t, 3);
    add_uint(b, v->camera, 4);
    add(b, v->name, strlen(v->name) + 1);
    add_uint(b, (uint64_t)v->observations, 8);
    for (int i = 0; i < v->observations; i++) {
        add_doubles(b, v->t, 2);
        add_uint(b, UINT64_MAX, 8);
    }
}

static void add_point(buffer *b, int i) {
    add_uint(b, (uint64_t)i + 1, 8);
    add_doubles(b, points[i], 3);
    for (int c = 0; c < 3; c++) add_uint(b, (uint64_t)(100 * i + c), 1);
    add_doubles(b, &points[0][0], 1);
    add_uint(b, (uint64_t)i, 8);
    for (int k = 0; k < i; k++) add_uint(b, 0x100000004, 8);
}

typedef struct files {
    buffer cameras, images, points;
} files;

static files binary_files(void) {
    files f = {.cameras.size = 0};
    add_uint(&f.cameras, CAMERAS, 8);
    for (int i = 0; i < CAMERAS; i++) add_camera(&f.cameras, &cameras[i]);
    add_uint(&f.images, IMAGES, 8);
    for (int i = 0; i < IMAGES; i++) add_image(&f.images, &images[i]);
    add_uint(&f.points, POINTS, 8);
    for (int i = 0; i < POINTS; i++) add_point(&f.points, i);
    return f;
}

static void print(buffer *b, const char *format, ...) {
    char line[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(line, sizeof line, format, args);
    va_end(args);
    add(b, line, strlen(line));
}

static void print_doubles(buffer *b, const double *v, int count) {
    for (int i = 0; i < count; i++) print(b, " %.17g", v[i]);
}

static files text_files(void) {
    files f = {.cameras.size = 0};
    print(&f.cameras, "# Camera list with one line of data per camera:\n\n");
    for (int i = 0; i < CAMERAS; i++) {
        print(&f.cameras, "%u %s %.0f %.0f", cameras[i].id, cameras[i].model_name, cameras[i].width,
              cameras[i].height);
        print_doubles(&f.cameras, cameras[i].parameter, cameras[i].parameters);
        print(&f.cameras, "\r\n");
    }
    print(&f.images, "# Image list with two lines of data per image:\n");
    for (int i = 0; i < IMAGES; i++) {
        print(&f.images, "%u", images[i].id);
        print_doubles(&f.images, images[i].q, 4);
        print_doubles(&f.images, images[i].t, 3);
        print(&f.images, " %u %s\n", images[i].camera, images[i].name);
        for (int k = 0; k < images[i].observations; k++) print(&f.images, "1.5 2.5 -1 ");
        if (i < IMAGES - 1) print(&f.images, "\n"); /* the last line may lack its end */
    }
    print(&f.points, "# 3D point list with one line of data per point:\n");
    for (int i = 0; i < POINTS; i++) {
        print(&f.points, "%d", i + 1);
        print_doubles(&f.points, points[i], 3);
        print(&f.points, " %d %d %d 0.5 4 0\n", 100 * i, 100 * i + 1, 100 * i + 2);
    }
    return f;
}

/* Writing and loading it. */

static void make_folder(const char *path) { assert_true(mkdir(path, 0777) == 0 || test_exists(path)); }

static float shade(int picture, int i, int channel) {
    return (float)((37 * picture + 11 * i + 90 * channel) % 256) / 255;
}

static void write_picture(sf_context *ctx, const char *path, int picture, int width, int height) {
    float *rgb = calloc((size_t)(width * height), 3 * sizeof *rgb);
    assert_non_null(rgb);
    for (int i = 0; i < 3 * width * height; i++) rgb[i] = shade(picture, i / 3, i % 3);
    assert_ok(ctx, sf_write_png(ctx, path, width, height, rgb));
    free(rgb);
}

static void write_pictures(sf_context *ctx, const char *project, const char *folder, int divisor) {
    char path[256];
    make_folder(test_path(project));
    make_folder(test_path_in(project, folder));
    snprintf(path, sizeof path, "%s/sub", folder);
    make_folder(test_path_in(project, path));
    for (int i = 0; i < IMAGES; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, images[i].name);
        write_picture(ctx, test_path_in(project, path), i, WIDTH / divisor, HEIGHT / divisor);
    }
}

static void write_model(const char *project, const char *folder, const files *f, const char *ending) {
    char path[256];
    const buffer *all[] = {&f->cameras, &f->images, &f->points};
    const char *names[] = {"cameras", "images", "points3D"};
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s%s%s", folder, names[i], ending);
        test_write(test_path_in(project, path), all[i]->data, all[i]->size);
    }
}

/* A whole project of binary files in sparse/0, pictures in images. */
static const char *write_project(sf_context *ctx, const char *project) {
    files f = binary_files();
    write_pictures(ctx, project, "images", 1);
    make_folder(test_path_in(project, "sparse"));
    make_folder(test_path_in(project, "sparse/0"));
    write_model(project, "sparse/0/", &f, ".bin");
    return test_path(project);
}

static void assert_refused_with(sf_context *ctx, const char *path, const sf_load_options *options,
                                sf_status expected, const char *part) {
    sf_scene *scene;
    assert_status(ctx, sf_scene_load(ctx, path, options, &scene), expected);
    assert_null(scene);
    assert_error_names(ctx, part);
    assert_null(strchr(sf_last_error(ctx), '\n'));
}

static void assert_refused(sf_context *ctx, const char *path, sf_status expected, const char *part) {
    assert_refused_with(ctx, path, NULL, expected, part);
}

static void assert_log(const char *part) { test_assert_contains(test_log, part, __FILE__, __LINE__); }

static void assert_near(double got, double expected) {
    if (!(fabs(got - expected) <= 1e-12)) fail_msg("%.17g is not %.17g", got, expected);
}

/* Well-formed projects. */

static void assert_same_view(sf_scene *a, sf_scene *b, size_t index) {
    sf_view_info x = test_view_info(a, index), y = test_view_info(b, index);
    float first[3 * PIXELS], second[3 * PIXELS], first_weight[PIXELS], second_weight[PIXELS];
    assert_string_equal(x.name, y.name);
    assert_int_equal(x.split, y.split);
    assert_int_equal(x.has_mask, y.has_mask);
    assert_memory_equal(&x.camera.fx, &y.camera.fx, 4 * sizeof(double));
    assert_memory_equal(x.camera.R_cw, y.camera.R_cw, sizeof x.camera.R_cw);
    assert_memory_equal(x.camera.t_cw, y.camera.t_cw, sizeof x.camera.t_cw);
    assert_int_equal(x.camera.width, WIDTH);
    assert_int_equal(y.camera.width, WIDTH);
    assert_int_equal(sf_scene_get_pixels(a, x.id, first, first_weight), SF_OK);
    assert_int_equal(sf_scene_get_pixels(b, y.id, second, second_weight), SF_OK);
    assert_memory_equal(first, second, sizeof first);
    assert_memory_equal(first_weight, second_weight, sizeof first_weight);
}

static void assert_same_scene(sf_scene *a, sf_scene *b) {
    float first[3 * POINTS], second[3 * POINTS];
    uint8_t first_colors[3 * POINTS], second_colors[3 * POINTS];
    assert_int_equal(test_scene_info(a).views, test_scene_info(b).views);
    for (size_t i = 0; i < test_scene_info(a).views; i++) assert_same_view(a, b, i);
    assert_int_equal(sf_scene_get_points(a, 0, POINTS, first, first_colors), POINTS);
    assert_int_equal(sf_scene_get_points(b, 0, POINTS, second, second_colors), POINTS);
    assert_memory_equal(first, second, sizeof first);
    assert_memory_equal(first_colors, second_colors, sizeof first_colors);
}

static void test_binary(void **state) {
    (void)state;
    static const char *const order[] = {"a.png", "b.png", "c.png", "sub/a 1.png"};
    static const double quarter[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1};
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, write_project(ctx, "binary"), NULL);
    sf_scene_info info = test_scene_info(scene);
    assert_int_equal(info.views, IMAGES);
    assert_int_equal(info.test_views, 1);
    assert_int_equal(info.points, POINTS);
    assert_int_equal(info.undistorted_views, 1);
    assert_int_equal(info.skipped_missing + info.skipped_pose + info.skipped_points, 0);
    for (size_t i = 0; i < IMAGES; i++) {
        sf_view_info view = test_view_info(scene, i);
        assert_string_equal(view.name, order[i]);
        assert_int_equal(view.split, i ? SF_SPLIT_TRAIN : SF_SPLIT_TEST);
        assert_int_equal(view.has_mask, i == 1); /* the lens that is undistorted */
        assert_int_equal(sf_camera_check(&view.camera), SF_OK);
    }
    sf_view_info b = test_view_info(scene, 1), c = test_view_info(scene, 2);
    for (int i = 0; i < 9; i++) assert_near(b.camera.R_cw[i], quarter[i]);
    assert_near(b.camera.t_cw[1], 2);
    assert_near(b.camera.fx, 20); /* its camera record is of twice the size */
    assert_near(b.camera.cx, 12);
    assert_near(c.camera.fx, 20);
    assert_near(c.camera.fy, 21);
    assert_near(c.camera.cx, 12.5);
    assert_near(c.camera.cy, 8.25);
    float rgb[3 * PIXELS], xyz[3];
    uint8_t color[3];
    assert_ok(ctx, sf_scene_get_pixels(scene, c.id, rgb, NULL));
    for (int i = 0; i < 3 * PIXELS; i++) assert_true(fabsf(rgb[i] - shade(0, i / 3, i % 3)) < 1e-6f);
    assert_int_equal(sf_scene_get_points(scene, 1, 1, xyz, color), 1);
    assert_true(xyz[0] == -0.1f && xyz[1] == 1e-3f && xyz[2] == 7.25f);
    assert_memory_equal(color, ((uint8_t[]){100, 101, 102}), 3);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_text_is_the_same(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = text_files();
    write_pictures(ctx, "text", "images", 1);
    write_model("text", "", &f, ".txt"); /* in the root */
    sf_scene *text = test_load_scene(ctx, test_path("text"), NULL);
    sf_scene *binary = test_load_scene(ctx, write_project(ctx, "text-binary"), NULL);
    assert_same_scene(text, binary);
    sf_scene_destroy(&text);
    write_project(ctx, "text"); /* where both exist, sparse/0 and binary come first */
    test_write(test_path_in("text", "sparse/0/images.txt"), "nonsense", 8);
    text = test_load_scene(ctx, test_path("text"), NULL);
    assert_same_scene(text, binary);
    sf_scene_destroy(&text);
    sf_scene_destroy(&binary);
    sf_context_destroy(&ctx);
}

static void test_any_number_of_threads(void **state) {
    (void)state;
    sf_context *one = test_context_threads(1), *five = test_context_threads(5);
    const char *path = write_project(one, "threads");
    sf_scene *a = test_load_scene(one, path, NULL), *b = test_load_scene(five, path, NULL);
    assert_same_scene(a, b);
    sf_scene_destroy(&a);
    sf_scene_destroy(&b);
    sf_context_destroy(&one);
    sf_context_destroy(&five);
}

static void test_sparse_without_number(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = binary_files();
    write_pictures(ctx, "flat", "images", 1);
    make_folder(test_path_in("flat", "sparse"));
    write_model("flat", "sparse/", &f, ".bin");
    sf_scene *scene = test_load_scene(ctx, test_path("flat"), NULL);
    assert_int_equal(test_scene_info(scene).views, IMAGES);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_largest_of_several_models(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = binary_files(), small = f, text = text_files();
    write_project(ctx, "several");
    small.images.size = 0;
    add_uint(&small.images, 1, 8);
    add_image(&small.images, &images[0]);
    write_model("several", "sparse/0/", &small, ".bin");
    make_folder(test_path_in("several", "sparse/1"));
    make_folder(test_path_in("several", "sparse/10"));
    make_folder(test_path_in("several", "sparse/other"));
    write_model("several", "sparse/1/", &small, ".bin");
    write_model("several", "sparse/10/", &text, ".txt");
    write_model("several", "sparse/other/", &f, ".bin");
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, test_path("several"), NULL);
    assert_int_equal(test_scene_info(scene).views, IMAGES);
    assert_log("of 3 models, 10 is taken");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_folders_of_pictures(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    write_project(ctx, "folders");
    assert_int_equal(rename(test_path_in("folders", "images"), test_path_in("folders", "kept")), 0);
    assert_refused(ctx, test_path("folders"), SF_ERR_IO, "images_2");
    options.images = "none";
    assert_refused_with(ctx, test_path("folders"), &options, SF_ERR_IO, "folders/none");
    write_pictures(ctx, "folders", "images_4", 4);
    write_pictures(ctx, "folders", "images_8", 8);
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, test_path("folders"), NULL);
    assert_log("images_4");
    sf_view_info c = test_view_info(scene, 2);
    assert_int_equal(c.camera.width, WIDTH / 4);
    assert_int_equal(c.camera.height, HEIGHT / 4);
    assert_near(c.camera.fx, 5);
    assert_near(c.camera.fy, 5.25);
    assert_near(c.camera.cx, 3.125);
    sf_scene_destroy(&scene);
    options.images = "kept";
    scene = test_load_scene(ctx, test_path("folders"), &options);
    assert_int_equal(test_view_info(scene, 2).camera.width, WIDTH);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_downscale(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    options.downscale = 5; /* 24 x 16 leaves 4 x 3, with a rest */
    sf_scene *scene = test_load_scene(ctx, write_project(ctx, "downscale"), &options);
    sf_view_info c = test_view_info(scene, 2);
    float rgb[3 * 4 * 3];
    assert_int_equal(c.camera.width, 4);
    assert_int_equal(c.camera.height, 3);
    assert_near(c.camera.fx, 4);
    assert_near(c.camera.cy, 1.65);
    assert_ok(ctx, sf_scene_get_pixels(scene, c.id, rgb, NULL));
    for (int i = 0; i < 3 * 4 * 3; i++) {
        int x = i / 3 % 4, y = i / 12, sum = 0;
        for (int k = 0; k < 25; k++)
            sum += (int)(255 * shade(0, (5 * y + k / 5) * WIDTH + 5 * x + k % 5, i % 3) + 0.5f);
        assert_int_equal((int)(255 * rgb[i] + 0.5f), (sum + 12) / 25);
    }
    sf_scene_destroy(&scene);
    options.downscale = 17;
    assert_refused_with(ctx, test_path("downscale"), &options, SF_ERR_ARGUMENT, "downscale: 17");
    sf_context_destroy(&ctx);
}

/* Splits and other options. */

static void assert_held_out(sf_context *ctx, const char *path, const sf_load_options *options,
                            unsigned mask) {
    sf_scene *scene = test_load_scene(ctx, path, options);
    for (size_t i = 0; i < IMAGES; i++)
        assert_int_equal(test_view_info(scene, i).split == SF_SPLIT_TEST, mask >> i & 1);
    sf_scene_destroy(&scene);
}

static void test_hold_out(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    write_project(ctx, "hold");
    options.hold_out = 0;
    assert_held_out(ctx, test_path("hold"), &options, 0);
    options.hold_out = 3;
    assert_held_out(ctx, test_path("hold"), &options, 1 | 8);
    options.hold_out = 2;
    assert_held_out(ctx, test_path("hold"), &options, 1 | 4);
    options.hold_out = 1;
    assert_refused_with(ctx, test_path("hold"), &options, SF_ERR_EMPTY, "no training view");
    options.hold_out = 2;
    assert_int_equal(unlink(test_path_in("hold", "images/a.png")),
                     0); /* what is missing does not move the others */
    sf_scene *scene = test_load_scene(ctx, test_path("hold"), &options);
    assert_int_equal(test_scene_info(scene).views, 3);
    assert_string_equal(test_view_info(scene, 1).name, "c.png");
    assert_int_equal(test_view_info(scene, 1).split, SF_SPLIT_TEST);
    assert_int_equal(test_scene_info(scene).test_views, 1);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_test_list(void **state) {
    (void)state;
    static const struct {
        const char *text;
        unsigned mask;
    } lists[] = {{"b.png\r\n\r\n  \nsub/a 1.png", 2 | 8}, {"a 1.png\n", 8}, {"./c.png\nc.png\n", 4}, {"", 0}};
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    char list[256];
    write_project(ctx, "list");
    snprintf(list, sizeof list, "%s", test_path_in("list", "test.txt"));
    options.test_list = list;
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        test_write(list, lists[i].text, strlen(lists[i].text));
        assert_held_out(ctx, test_path("list"), &options, lists[i].mask);
    }
    test_write(list, "a.png\n\nd.png\n", 13);
    assert_refused_with(ctx, test_path("list"), &options, SF_ERR_ARGUMENT,
                        "line 3: no picture is named 'd.png'");
    options.test_list = test_path_in("list", "none.txt");
    assert_refused_with(ctx, test_path("list"), &options, SF_ERR_IO, "none.txt");
    sf_context_destroy(&ctx);
}

static void test_options_out_of_range(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    write_project(ctx, "options");
    sf_load_options options = sf_load_options_default();
    options.downscale = 0;
    assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT, "downscale: 0");
    options.downscale = 65;
    assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT, "downscale: 65");
    options = sf_load_options_default();
    options.hold_out = -1;
    assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT, "hold_out: -1");
    options = sf_load_options_default();
    options.max_views = -1;
    assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT, "max_views: -1");
    options.max_views = 3;
    assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT,
                        "max_views: 4 views are more than 3");
    options.max_views = 4;
    sf_scene *scene = test_load_scene(ctx, test_path("options"), &options);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What skips a view. */

static void test_missing_pictures(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    write_project(ctx, "missing");
    assert_int_equal(unlink(test_path_in("missing", "images/b.png")), 0);
    test_write(test_path_in("missing", "images/c.png"), "some text", 9);
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, test_path("missing"), NULL);
    assert_int_equal(test_scene_info(scene).views, 2);
    assert_int_equal(test_scene_info(scene).skipped_missing, 2);
    assert_log("images/b.png: skipped: No such file");
    assert_log("images/c.png: skipped: is neither a JPEG nor a PNG");
    assert_log("2 of 4 pictures skipped");
    sf_scene_destroy(&scene);
    assert_int_equal(unlink(test_path_in("missing", "images/a.png")), 0);
    assert_int_equal(unlink(test_path_in("missing", "images/sub/a 1.png")), 0);
    assert_refused(ctx, test_path("missing"), SF_ERR_EMPTY, "4 lack a readable picture");
    sf_context_destroy(&ctx);
}

static void test_poses_that_are_none(void **state) {
    (void)state;
    static const double bad[][7] = {{NAN, 0, 0, 0, 1, 2, 3},
                                    {0, 0, 0, 0, 1, 2, 3},
                                    {1, 0, 0, 0, INFINITY, 2, 3},
                                    {1e300, 1e300, 0, 0, 1, 2, 3},
                                    {1, 0, 0, 0, 1, 2, NAN}};
    sf_context *ctx = test_context();
    write_project(ctx, "poses");
    for (size_t k = 0; k < sizeof bad / sizeof *bad; k++) {
        files f = binary_files();
        f.images.size = 8;
        for (int i = 0; i < IMAGES; i++) {
            image v = images[i];
            if (i < 2) memcpy(v.q, bad[k], sizeof v.q);
            if (i < 2) memcpy(v.t, bad[k] + 4, sizeof v.t);
            add_image(&f.images, &v);
        }
        write_model("poses", "sparse/0/", &f, ".bin");
        test_log_clear();
        sf_scene *scene = test_load_scene(ctx, test_path("poses"), NULL);
        assert_int_equal(test_scene_info(scene).views, 2);
        assert_int_equal(test_scene_info(scene).skipped_pose, 2);
        assert_log("2 of 4 views skipped: pose or intrinsics not usable (first: ");
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_lenses_that_are_none(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    write_project(ctx, "lenses");
    static const double bad[] = {NAN, 0, -20, INFINITY};
    for (size_t k = 0; k < 4; k++) {
        files f = binary_files();
        f.cameras.size = 8;
        for (int i = 0; i < CAMERAS; i++) {
            camera c = cameras[i];
            if (i == 0) c.parameter[0] = bad[k];
            add_camera(&f.cameras, &c);
        }
        write_model("lenses", "sparse/0/", &f, ".bin");
        sf_scene *scene = test_load_scene(ctx, test_path("lenses"), NULL);
        assert_int_equal(test_scene_info(scene).skipped_pose, 2);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_points_that_are_none(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = binary_files();
    const double bad[3] = {1e39, NAN, -INFINITY};
    write_project(ctx, "points");
    add_uint(&f.points, 77, 8);
    add_doubles(&f.points, bad, 3);
    add_uint(&f.points, 0, 3);
    add_doubles(&f.points, bad, 1);
    add_uint(&f.points, 0, 8);
    f.points.data[0]++;
    write_model("points", "sparse/0/", &f, ".bin");
    sf_scene *scene = test_load_scene(ctx, test_path("points"), NULL);
    assert_int_equal(test_scene_info(scene).points, POINTS);
    assert_int_equal(test_scene_info(scene).skipped_points, 1);
    sf_scene_destroy(&scene);
    assert_int_equal(unlink(test_path_in("points", "sparse/0/points3D.bin")), 0);
    test_log_clear();
    scene = test_load_scene(ctx, test_path("points"), NULL);
    assert_int_equal(test_scene_info(scene).points, 0);
    assert_log("no points3D.bin");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A JPEG with an EXIF orientation. */
static void write_turned(const char *path) {
    static const uint8_t exif[] = "\xff\xe1\0\x22"
                                  "Exif\0\0MM\0*\0\0\0\x08\0\x01"
                                  "\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    uint8_t pixels[3 * PIXELS], file[8192], *jpeg = NULL;
    unsigned long size = 0;
    memset(pixels, 100, sizeof pixels);
    tjhandle handle = tjInitCompress();
    assert_int_equal(tjCompress2(handle, pixels, WIDTH, 0, HEIGHT, TJPF_RGB, &jpeg, &size, TJSAMP_444, 90, 0),
                     0);
    assert_true(size + sizeof exif <= sizeof file);
    memcpy(file, jpeg, 2);
    memcpy(file + 2, exif, sizeof exif - 1);
    memcpy(file + 1 + sizeof exif, jpeg + 2, size - 2);
    test_write(path, file, size + sizeof exif - 1);
    tjFree(jpeg);
    tjDestroy(handle);
}

static void test_orientation_is_said_once(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    write_project(ctx, "turned");
    write_turned(test_path_in("turned", "images/a.png")); /* told by its content */
    write_turned(test_path_in("turned", "images/c.png"));
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, test_path("turned"), NULL);
    assert_int_equal(test_view_info(scene, 0).camera.width, WIDTH);
    assert_log("2 pictures carry an EXIF orientation");
    assert_null(strstr(strstr(test_log, "EXIF") + 1, "EXIF"));
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Malformed projects. */

static void check_truncations(sf_context *ctx, const char *name, const buffer *b) {
    for (size_t size = 0; size < b->size; size++) {
        sf_scene *scene;
        test_write(test_path_in("cut", name), b->data, size);
        sf_status status = sf_scene_load(ctx, test_path("cut"), NULL, &scene);
        if (status != SF_ERR_FORMAT)
            fail_msg("%s cut to %zu of %zu bytes: %s", name, size, b->size, sf_status_text(status));
        assert_null(scene);
        assert_error_names(ctx, name);
    }
    test_write(test_path_in("cut", name), b->data, b->size);
    sf_scene *scene = test_load_scene(ctx, test_path("cut"), NULL);
    sf_scene_destroy(&scene);
}

static void test_truncation_at_every_byte(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = binary_files();
    write_project(ctx, "cut");
    check_truncations(ctx, "sparse/0/cameras.bin", &f.cameras);
    check_truncations(ctx, "sparse/0/images.bin", &f.images);
    check_truncations(ctx, "sparse/0/points3D.bin", &f.points);
    sf_context_destroy(&ctx);
}

static void check_flips(sf_context *ctx, const char *name, const buffer *b) {
    for (size_t at = 0; at < b->size; at++) {
        buffer flipped = *b;
        sf_scene *scene;
        flipped.data[at] ^= 0x81;
        test_write(test_path_in("flip", name), flipped.data, flipped.size);
        sf_status status = sf_scene_load(ctx, test_path("flip"), NULL, &scene);
        assert_int_equal(scene != NULL, status == SF_OK);
        if (!status) assert_between(test_scene_info(scene).views, 1, IMAGES);
        sf_scene_destroy(&scene);
    }
    test_write(test_path_in("flip", name), b->data, b->size);
}

static void test_flipped_bits(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = binary_files();
    write_project(ctx, "flip");
    check_flips(ctx, "sparse/0/cameras.bin", &f.cameras);
    check_flips(ctx, "sparse/0/images.bin", &f.images);
    check_flips(ctx, "sparse/0/points3D.bin", &f.points);
    sf_context_destroy(&ctx);
}

static void test_counts_beyond_the_file(void **state) {
    (void)state;
    static const uint64_t counts[] = {(uint64_t)1 << 63, UINT64_MAX, (uint64_t)1 << 32, 0xffffffff, 100};
    static const char *const names[] = {"cameras.bin", "images.bin", "points3D.bin"};
    sf_context *ctx = test_context();
    write_project(ctx, "counts");
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        for (int k = 0; k < 3; k++) {
            files f = binary_files();
            buffer *b = k == 0 ? &f.cameras : k == 1 ? &f.images : &f.points;
            char value[32];
            for (int byte = 0; byte < 8; byte++) b->data[byte] = (uint8_t)(counts[i] >> (8 * byte));
            write_model("counts", "sparse/0/", &f, ".bin");
            snprintf(value, sizeof value, "%llu", (unsigned long long)counts[i]);
            assert_refused(ctx, test_path("counts"), SF_ERR_FORMAT, names[k]);
            assert_error_names(ctx, value);
        }
    sf_context_destroy(&ctx);
}

/* The offset of image `index`'s number of observations. */
static size_t observations_at(int index) {
    buffer b = {.size = 8};
    for (int i = 0; i < index; i++) add_image(&b, &images[i]);
    return b.size + 4 + 7 * 8 + 4 + strlen(images[index].name) + 1;
}

static void test_inner_counts_beyond_the_file(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    write_project(ctx, "inner");
    for (size_t byte = 0; byte < 8; byte++) {
        files f = binary_files();
        f.images.data[observations_at(1) + byte] |= 0x80;
        write_model("inner", "sparse/0/", &f, ".bin");
        assert_refused(ctx, test_path("inner"), SF_ERR_FORMAT, "images.bin");
        f = binary_files();
        f.points.data[8 + 43 + byte] |= 0x80; /* the first point's track */
        write_model("inner", "sparse/0/", &f, ".bin");
        assert_refused(ctx, test_path("inner"), SF_ERR_FORMAT, "points3D.bin");
    }
    sf_context_destroy(&ctx);
}

/* Loads the project with one other camera in place of the first. */
/* Of COLMAP 4.2's models those that are not supported: number and parameters. */
static const struct {
    int model, parameters;
    const char *name;
} unsupported[] = {{11, 16, "RAD_TAN_THIN_PRISM_FISHEYE"},
                   {12, 4, "SIMPLE_DIVISION"},
                   {13, 5, "DIVISION"},
                   {16, 6, "EUCM"},
                   {17, 2, "EQUIRECTANGULAR"}};

/* They are refused where a picture uses them, and skipped where none does. */
static void test_unsupported_cameras(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = NULL;
    char part[96];
    write_project(ctx, "unused");
    for (size_t i = 0; i < sizeof unsupported / sizeof *unsupported; i++)
        for (unsigned used = 0; used < 2; used++) {
            camera c = {used ? 7 : 42, unsupported[i].model, "", 10, 10, unsupported[i].parameters,
                        {1, 1, 1, 1}};
            files f = binary_files();
            f.cameras.size = 0;
            add_uint(&f.cameras, CAMERAS + !used, 8);
            add_camera(&f.cameras, &c);
            for (int k = used ? 1 : 0; k < CAMERAS; k++) add_camera(&f.cameras, &cameras[k]);
            write_model("unused", "sparse/0/", &f, ".bin");
            snprintf(part, sizeof part, "images.bin: camera 7: model %s is not supported",
                     unsupported[i].name);
            if (used) {
                assert_refused(ctx, test_path("unused"), SF_ERR_UNSUPPORTED, part);
                int panorama = !strcmp(unsupported[i].name, "EQUIRECTANGULAR");
                assert_int_equal(strstr(sf_last_error(ctx), "image_undistorter") == NULL, panorama);
                continue;
            }
            assert_ok(ctx, sf_scene_load(ctx, test_path("unused"), NULL, &scene));
            assert_int_equal(test_scene_info(scene).views, IMAGES);
            sf_scene_destroy(&scene);
        }
    sf_context_destroy(&ctx);
}

static void refuse_camera(sf_context *ctx, const camera *c, sf_status expected, const char *part) {
    files f = binary_files();
    f.cameras.size = 8;
    add_camera(&f.cameras, c);
    for (int i = 1; i < CAMERAS; i++) add_camera(&f.cameras, &cameras[i]);
    write_model("other", "sparse/0/", &f, ".bin");
    assert_refused(ctx, test_path("other"), expected, "cameras.bin");
    assert_error_names(ctx, part);
}

static void test_other_cameras(void **state) {
    (void)state;
    static const int unknown[] = {-1, 18, 1 << 20};
    static const double sizes[] = {0, 65536, 9e18};
    sf_context *ctx = test_context();
    write_project(ctx, "other");
    for (size_t i = 0; i < 3; i++) {
        camera c = cameras[0];
        c.model = unknown[i];
        refuse_camera(ctx, &c, SF_ERR_FORMAT, "camera 7: model: number");
        c = cameras[0];
        c.width = sizes[i];
        refuse_camera(ctx, &c, SF_ERR_FORMAT, "camera 7: width: ");
        c = cameras[0];
        c.height = sizes[i];
        refuse_camera(ctx, &c, SF_ERR_FORMAT, "camera 7: height: ");
    }
    camera twice = cameras[0];
    twice.id = cameras[2].id;
    refuse_camera(ctx, &twice, SF_ERR_FORMAT, "camera 3 appears twice");
    sf_context_destroy(&ctx);
}

/* Loads the project with one other image in place of the first. */
static void refuse_image(sf_context *ctx, const image *v, const char *part) {
    files f = binary_files();
    f.images.size = 8;
    add_image(&f.images, v);
    for (int i = 1; i < IMAGES; i++) add_image(&f.images, &images[i]);
    write_model("other", "sparse/0/", &f, ".bin");
    assert_refused(ctx, test_path("other"), SF_ERR_FORMAT, part);
}

static void test_other_images(void **state) {
    (void)state;
    static const char *const escapes[] = {"/etc/passwd", "../a.png", "sub/../../a.png", "..", "",
                                          ".",           "sub/.."};
    sf_context *ctx = test_context();
    write_project(ctx, "other");
    image v = images[0];
    v.camera = 99;
    refuse_image(ctx, &v, "images.bin: image 4: camera 99 does not exist");
    v = images[0];
    v.id = images[2].id;
    refuse_image(ctx, &v, "images.bin: image 9 appears twice");
    v = images[0];
    v.name = images[1].name;
    refuse_image(ctx, &v, "'b.png' appears twice");
    for (size_t i = 0; i < sizeof escapes / sizeof *escapes; i++) {
        v = images[0];
        v.name = escapes[i];
        refuse_image(ctx, &v, "images.bin: picture name");
    }
    sf_context_destroy(&ctx);
}

static void test_bytes_that_follow(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    write_project(ctx, "follow");
    for (int k = 0; k < 3; k++) {
        files f = binary_files();
        add_uint(k == 0 ? &f.cameras : k == 1 ? &f.images : &f.points, 0, 1);
        write_model("follow", "sparse/0/", &f, ".bin");
        assert_refused(ctx, test_path("follow"), SF_ERR_FORMAT, "1 bytes follow");
    }
    sf_context_destroy(&ctx);
}

static void test_garbage(void **state) {
    (void)state;
    static const char *const names[] = {"sparse/0/cameras.bin", "sparse/0/images.bin",
                                        "sparse/0/points3D.bin"};
    sf_context *ctx = test_context();
    uint8_t garbage[500];
    for (int k = 0; k < 3; k++) {
        write_project(ctx, "garbage");
        for (unsigned seed = 0; seed < 20; seed++) {
            for (size_t i = 0; i < sizeof garbage; i++)
                garbage[i] = i < 8 ? (uint8_t)(i == 0) : (uint8_t)((i * 2654435761u + seed * 40503u) >> 11);
            test_write(test_path_in("garbage", names[k]), garbage, sizeof garbage);
            assert_refused(ctx, test_path("garbage"), SF_ERR_FORMAT, names[k]);
        }
    }
    sf_context_destroy(&ctx);
}

static void test_absent_files(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    write_project(ctx, "absent");
    assert_refused(ctx, test_path("nothing-here"), SF_ERR_IO, "nothing-here");
    assert_refused(ctx, test_path_in("absent", "images"), SF_ERR_IO, "its pictures belong to the project in");
    assert_refused(ctx, test_path_in("absent", "sparse/0/cameras.bin"), SF_ERR_FORMAT,
                   "neither a folder nor");
    assert_int_equal(unlink(test_path_in("absent", "sparse/0/cameras.bin")), 0);
    assert_refused(ctx, test_path("absent"), SF_ERR_IO,
                   "sparse/0: holds neither cameras.bin nor cameras.txt");
    write_project(ctx, "absent");
    assert_int_equal(unlink(test_path_in("absent", "sparse/0/images.bin")), 0);
    assert_refused(ctx, test_path("absent"), SF_ERR_IO, "holds neither images.bin nor images.txt");
    make_folder(test_path_in("absent", "sparse/0/images.bin")); /* a folder is no file */
    assert_refused(ctx, test_path("absent"), SF_ERR_IO, "holds neither images.bin nor images.txt");
    sf_context_destroy(&ctx);
}

static void test_no_images(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    write_project(ctx, "none");
    test_write(test_path_in("none", "sparse/0/images.bin"), "\0\0\0\0\0\0\0", 8);
    assert_refused(ctx, test_path("none"), SF_ERR_EMPTY, "names no picture");
    sf_context_destroy(&ctx);
}

static void test_malformed_text(void **state) {
    (void)state;
    static const struct {
        const char *file, *text;
        sf_status status;
        const char *part;
    } cases[] = {
        {"cameras.txt", "x PINHOLE 24 16 1 1 1 1\n", SF_ERR_FORMAT, "line 1: camera id: 'x'"},
        {"cameras.txt", "#\n-1 PINHOLE 24 16 1 1 1 1\n", SF_ERR_FORMAT, "line 2: camera id: '-1'"},
        {"cameras.txt", "4294967296 PINHOLE 24 16 1 1 1 1\n", SF_ERR_FORMAT, "camera id"},
        {"cameras.txt", "1 PINWHEEL 24 16 1 1 1 1\n", SF_ERR_FORMAT, "model: 'PINWHEEL' is not known"},
        {"cameras.txt", "7 EUCM 24 16 1 1 1 1 1 1\n", SF_ERR_UNSUPPORTED,
         "images.txt: camera 7: model EUCM is not supported"},
        {"cameras.txt", "7 EUCM 24 16 1 1 1 1\n", SF_ERR_FORMAT, "parameters: ''"},
        {"cameras.txt", "1 PINHOLE 0 16 1 1 1 1\n", SF_ERR_FORMAT, "camera 1: width: 0"},
        {"cameras.txt", "1 PINHOLE 24 99999999999999999999 1 1 1 1\n", SF_ERR_FORMAT, "height: '9999"},
        {"cameras.txt", "1 PINHOLE 24 16 1 1 1\n", SF_ERR_FORMAT, "parameters: ''"},
        {"cameras.txt", "1 PINHOLE 24 16 1 1 1 1 1\n", SF_ERR_FORMAT, "end of line: '1'"},
        {"cameras.txt", "1 PINHOLE 24 16 1 1 1 one\n", SF_ERR_FORMAT, "parameters: 'one'"},
        {"cameras.txt", "", SF_ERR_FORMAT, "camera 7 does not exist"},
        {"images.txt", "4 1 0 0\n", SF_ERR_FORMAT, "line 1: quaternion: ''"},
        {"images.txt", "4 1 0 0 0 1 1 1 7\n\n", SF_ERR_FORMAT, "picture name: ''"},
        {"images.txt", "4 1 0 0 0 1 1 1 8 c.png\n\n", SF_ERR_FORMAT, "image 4: camera 8 does not exist"},
        {"images.txt", "4 1 0 0 0 1 1 1 7 c.png\n5 1 0 0 0 1 1 1 7 b.png\n", SF_ERR_FORMAT,
         "line 2: observations"},
        {"images.txt", "# nothing\n", SF_ERR_EMPTY, "names no picture"},
        {"points3D.txt", "1 1 2 three 0 0 0 1\n", SF_ERR_FORMAT, "line 1: position: 'three'"},
        {"points3D.txt", "1 1 2 3 256 0 0 1\n", SF_ERR_FORMAT, "colour: '256'"},
        {"points3D.txt", "1 1 2\n", SF_ERR_FORMAT, "position: ''"},
    };
    sf_context *ctx = test_context();
    files f = text_files();
    write_pictures(ctx, "words", "images", 1);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        write_model("words", "", &f, ".txt");
        test_write(test_path_in("words", cases[i].file), cases[i].text, strlen(cases[i].text));
        assert_refused(ctx, test_path("words"), cases[i].status, cases[i].part);
    }
    write_model("words", "", &f, ".txt");
    test_write(test_path_in("words", "cameras.txt"), "1 PINHOLE\0", 10);
    assert_refused(ctx, test_path("words"), SF_ERR_FORMAT, "zero byte");
    sf_context_destroy(&ctx);
}

static void test_not_finite_text(void **state) {
    (void)state;
    static const char text[] =
        "4 nan 0 0 0 1 1 1 7 c.png\n\n5 1 0 0 0 1 1 1 7 a.png\n\n1 1 0 0 0 1 1 1e999 7 b.png\n";
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    files f = text_files();
    options.hold_out = 0;
    write_pictures(ctx, "nan", "images", 1);
    write_model("nan", "", &f, ".txt");
    test_write(test_path_in("nan", "images.txt"), text, strlen(text));
    sf_scene *scene = test_load_scene(ctx, test_path("nan"), &options);
    assert_int_equal(test_scene_info(scene).views, 1);
    assert_int_equal(test_scene_info(scene).skipped_pose, 2);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* No memory. */

static void check_each_allocation(const char *project, long least) {
    long countdown = -1, at = 0;
    sf_allocator allocator = {test_refuse_alloc, test_refuse_free, &countdown};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    sf_scene *scene;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    for (;; at++) {
        countdown = at;
        sf_status status = sf_scene_load(ctx, test_path(project), NULL, &scene);
        if (countdown >= 0) { /* it took fewer allocations than that */
            assert_ok(ctx, status);
            break;
        }
        assert_status(ctx, status, SF_ERR_MEMORY);
        assert_null(scene);
        assert_error_names(ctx, "out of memory");
    }
    assert_int_equal(test_scene_info(scene).views, IMAGES);
    assert_true(at > least);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_each_allocation_may_fail(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files text = text_files();
    write_project(ctx, "memory");
    make_folder(test_path_in("memory", "sparse/1"));
    write_model("memory", "sparse/1/", &text, ".txt");
    check_each_allocation("memory", 50);
    sf_context_destroy(&ctx);
}

/* Pictures of the caller's. */

static void test_add_file(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_camera c = {.width = 2 * WIDTH,
                   .height = 4 * HEIGHT,
                   .fx = 30,
                   .fy = 40,
                   .cx = 24,
                   .cy = 32,
                   .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const char *path = test_path("added.png");
    uint32_t id = 0;
    write_picture(ctx, path, 0, WIDTH, HEIGHT);
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    assert_ok(ctx, sf_scene_add_file(scene, path, &c, SF_SPLIT_TRAIN, &id));
    sf_view_info view = test_view_info(scene, 0);
    assert_int_equal(view.id, id);
    assert_string_equal(view.name, "added.png");
    assert_int_equal(view.camera.width, WIDTH);
    assert_near(view.camera.fx, 15);
    assert_near(view.camera.fy, 10);
    assert_near(view.camera.cx, 12);
    assert_near(view.camera.cy, 8);
    assert_status(ctx, sf_scene_add_file(scene, test_path("none.png"), &c, SF_SPLIT_TRAIN, NULL), SF_ERR_IO);
    assert_error_names(ctx, "none.png");
    c.R_cw[0] = 2;
    assert_status(ctx, sf_scene_add_file(scene, path, &c, SF_SPLIT_TRAIN, NULL), SF_ERR_ARGUMENT);
    assert_int_equal(test_scene_info(scene).views, 1);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Photographs. */

static void test_real_fox(void **state) {
    (void)state;
    char path[1024];
    snprintf(path, sizeof path, "%s/fox", test_data());
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    options.images = "images_4";
    sf_scene *scene = test_load_scene(ctx, path, &options);
    sf_scene_info info = test_scene_info(scene);
    assert_int_equal(info.views, 50);
    assert_int_equal(info.test_views, 7);
    assert_int_equal(info.points, 12222);
    assert_int_equal(test_view_info(scene, 0).camera.width, 266);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_real_tagboard(void **state) {
    (void)state;
    char path[1024];
    snprintf(path, sizeof path, "%s/rbt-tagboard", test_data());
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, path, NULL);
    assert_int_equal(test_scene_info(scene).views, 99);
    assert_int_equal(test_scene_info(scene).test_views, 13);
    assert_int_equal(test_scene_info(scene).points, 4743);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_binary),
        cmocka_unit_test(test_text_is_the_same),
        cmocka_unit_test(test_any_number_of_threads),
        cmocka_unit_test(test_sparse_without_number),
        cmocka_unit_test(test_largest_of_several_models),
        cmocka_unit_test(test_folders_of_pictures),
        cmocka_unit_test(test_downscale),
        cmocka_unit_test(test_hold_out),
        cmocka_unit_test(test_test_list),
        cmocka_unit_test(test_options_out_of_range),
        cmocka_unit_test(test_missing_pictures),
        cmocka_unit_test(test_poses_that_are_none),
        cmocka_unit_test(test_lenses_that_are_none),
        cmocka_unit_test(test_points_that_are_none),
        cmocka_unit_test(test_orientation_is_said_once),
        cmocka_unit_test(test_truncation_at_every_byte),
        cmocka_unit_test(test_flipped_bits),
        cmocka_unit_test(test_counts_beyond_the_file),
        cmocka_unit_test(test_inner_counts_beyond_the_file),
        cmocka_unit_test(test_unsupported_cameras),
        cmocka_unit_test(test_other_cameras),
        cmocka_unit_test(test_other_images),
        cmocka_unit_test(test_bytes_that_follow),
        cmocka_unit_test(test_garbage),
        cmocka_unit_test(test_absent_files),
        cmocka_unit_test(test_no_images),
        cmocka_unit_test(test_malformed_text),
        cmocka_unit_test(test_not_finite_text),
        cmocka_unit_test(test_each_allocation_may_fail),
        cmocka_unit_test(test_add_file),
        cmocka_unit_test(test_real_fox),
        cmocka_unit_test(test_real_tagboard),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
