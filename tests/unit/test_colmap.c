/* test_colmap.c - COLMAP projects as they should be, and what all projects share: pictures, splits, options.
 */
#include "colmap_fixture.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

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
    sf_scene *scene = test_load_scene(ctx, colmap_write_project(ctx, "binary"), NULL);
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
    for (int i = 0; i < 3 * PIXELS; i++) assert_true(fabsf(rgb[i] - colmap_shade(0, i / 3, i % 3)) < 1e-6f);
    assert_int_equal(sf_scene_get_points(scene, 1, 1, xyz, color), 1);
    assert_true(xyz[0] == -0.1f && xyz[1] == 1e-3f && xyz[2] == 7.25f);
    assert_memory_equal(color, ((uint8_t[]){100, 101, 102}), 3);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_text_is_the_same(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = colmap_text_files();
    colmap_write_pictures(ctx, "text", "images", 1);
    colmap_write_model("text", "", &f, ".txt"); /* in the root */
    sf_scene *text = test_load_scene(ctx, test_path("text"), NULL);
    sf_scene *binary = test_load_scene(ctx, colmap_write_project(ctx, "text-binary"), NULL);
    assert_same_scene(text, binary);
    sf_scene_destroy(&text);
    colmap_write_project(ctx, "text"); /* where both exist, sparse/0 and binary come first */
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
    const char *path = colmap_write_project(one, "threads");
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
    files f = colmap_binary_files();
    colmap_write_pictures(ctx, "flat", "images", 1);
    colmap_make_folder(test_path_in("flat", "sparse"));
    colmap_write_model("flat", "sparse/", &f, ".bin");
    sf_scene *scene = test_load_scene(ctx, test_path("flat"), NULL);
    assert_int_equal(test_scene_info(scene).views, IMAGES);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_largest_of_several_models(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = colmap_binary_files(), small = f, text = colmap_text_files();
    colmap_write_project(ctx, "several");
    small.images.size = 0;
    colmap_add_uint(&small.images, 1, 8);
    colmap_add_image(&small.images, &colmap_images[0]);
    colmap_write_model("several", "sparse/0/", &small, ".bin");
    colmap_make_folder(test_path_in("several", "sparse/1"));
    colmap_make_folder(test_path_in("several", "sparse/10"));
    colmap_make_folder(test_path_in("several", "sparse/other"));
    colmap_write_model("several", "sparse/1/", &small, ".bin");
    colmap_write_model("several", "sparse/10/", &text, ".txt");
    colmap_write_model("several", "sparse/other/", &f, ".bin");
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, test_path("several"), NULL);
    assert_int_equal(test_scene_info(scene).views, IMAGES);
    colmap_assert_log("of 3 models, 10 is taken");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_folders_of_pictures(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    colmap_write_project(ctx, "folders");
    assert_int_equal(rename(test_path_in("folders", "images"), test_path_in("folders", "kept")), 0);
    colmap_assert_refused(ctx, test_path("folders"), SF_ERR_IO, "images_2");
    options.images = "none";
    colmap_assert_refused_with(ctx, test_path("folders"), &options, SF_ERR_IO, "folders/none");
    colmap_write_pictures(ctx, "folders", "images_4", 4);
    colmap_write_pictures(ctx, "folders", "images_8", 8);
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, test_path("folders"), NULL);
    colmap_assert_log("images_4");
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
    sf_scene *scene = test_load_scene(ctx, colmap_write_project(ctx, "downscale"), &options);
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
            sum += (int)(255 * colmap_shade(0, (5 * y + k / 5) * WIDTH + 5 * x + k % 5, i % 3) + 0.5f);
        assert_int_equal((int)(255 * rgb[i] + 0.5f), (sum + 12) / 25);
    }
    sf_scene_destroy(&scene);
    options.downscale = 17;
    colmap_assert_refused_with(ctx, test_path("downscale"), &options, SF_ERR_ARGUMENT, "downscale: 17");
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
    colmap_write_project(ctx, "hold");
    options.hold_out = 0;
    assert_held_out(ctx, test_path("hold"), &options, 0);
    options.hold_out = 3;
    assert_held_out(ctx, test_path("hold"), &options, 1 | 8);
    options.hold_out = 2;
    assert_held_out(ctx, test_path("hold"), &options, 1 | 4);
    options.hold_out = 1;
    colmap_assert_refused_with(ctx, test_path("hold"), &options, SF_ERR_EMPTY, "no training view");
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
    colmap_write_project(ctx, "list");
    snprintf(list, sizeof list, "%s", test_path_in("list", "test.txt"));
    options.test_list = list;
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        test_write(list, lists[i].text, strlen(lists[i].text));
        assert_held_out(ctx, test_path("list"), &options, lists[i].mask);
    }
    test_write(list, "a.png\n\nd.png\n", 13);
    colmap_assert_refused_with(ctx, test_path("list"), &options, SF_ERR_ARGUMENT,
                               "line 3: no picture is named 'd.png'");
    options.test_list = test_path_in("list", "none.txt");
    colmap_assert_refused_with(ctx, test_path("list"), &options, SF_ERR_IO, "none.txt");
    sf_context_destroy(&ctx);
}

static void test_options_out_of_range(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "options");
    sf_load_options options = sf_load_options_default();
    options.downscale = 0;
    colmap_assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT, "downscale: 0");
    options.downscale = 65;
    colmap_assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT, "downscale: 65");
    options = sf_load_options_default();
    options.hold_out = -1;
    colmap_assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT, "hold_out: -1");
    options = sf_load_options_default();
    options.max_views = -1;
    colmap_assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT, "max_views: -1");
    options.max_views = 3;
    colmap_assert_refused_with(ctx, test_path("options"), &options, SF_ERR_ARGUMENT,
                               "max_views: 4 views are more than 3");
    options.max_views = 4;
    sf_scene *scene = test_load_scene(ctx, test_path("options"), &options);
    sf_scene_destroy(&scene);
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
    colmap_write_picture(ctx, path, 0, WIDTH, HEIGHT);
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
        cmocka_unit_test(test_add_file),
        cmocka_unit_test(test_real_fox),
        cmocka_unit_test(test_real_tagboard),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
