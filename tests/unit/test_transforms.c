/* test_transforms.c - transforms.json as its three writers write it. */
#include "transforms_fixture.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static void assert_near(double got, double expected) {
    if (!(fabs(got - expected) <= 1e-9)) fail_msg("%.17g is not %.17g", got, expected);
}

/* Well-formed files. */

static void test_lens_for_all_and_for_one(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "lens");
    sf_scene *scene =
        transforms_load_json(ctx, "lens",
                             "{" LENS "'camera_model':'OPENCV','k1':0,'frames':["
                             "{'file_path':'./images/b.png','fl_x':30,'cx':12,'transform_matrix':" IDENTITY
                             "}," FRAME("images/a.png", IDENTITY) "]}");
    sf_view_info a = test_view_info(scene, 0), b = test_view_info(scene, 1);
    assert_int_equal(test_scene_info(scene).views, 2);
    assert_string_equal(a.name, "images/a.png");
    assert_string_equal(b.name, "images/b.png");
    assert_near(a.camera.fx, 20);
    assert_near(a.camera.fy, 21);
    assert_near(a.camera.cx, 12.5);
    assert_near(a.camera.cy, 8.25);
    assert_near(b.camera.fx, 30);
    assert_near(b.camera.fy, 30); /* as instant-ngp: of one level only */
    assert_near(b.camera.cx, 12);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The camera of the only view. */
static sf_camera camera_of(sf_context *ctx, const char *text) {
    sf_scene *scene = transforms_load_json(ctx, "one", text);
    sf_camera camera = test_view_info(scene, 0).camera;
    assert_int_equal(test_scene_info(scene).views, 1);
    sf_scene_destroy(&scene);
    return camera;
}

static void test_poses(void **state) {
    (void)state;
    static const double flip[9] = {1, 0, 0, 0, -1, 0, 0, 0, -1};
    static const char *const same[] = {
        "{" LENS "'frames':[" FRAME("images/a.png", IDENTITY) "]}",
        "{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0,1],[0,1,0,2],[0,0,1,3]]") "]}",
        "{" LENS "'frames':[" FRAME("images/a.png", "[[7,0,0,1],[0,7,0,2],[0,0,7,3],[0,0,0,1]]") "]}"};
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "one");
    for (size_t i = 0; i < 3; i++) {
        sf_camera c = camera_of(ctx, same[i]);
        for (int k = 0; k < 9; k++) assert_near(c.R_cw[k], flip[k]);
        assert_near(c.t_cw[0], -1); /* looks along -z of the world from (1, 2, 3) */
        assert_near(c.t_cw[1], 2);
        assert_near(c.t_cw[2], 3);
    }
    /* The camera's right is the world's y, its up is z, its back is x. */
    sf_camera c = camera_of(
        ctx, "{" LENS "'frames':[" FRAME("images/a.png", "[[0,0,1,5],[1,0,0,6],[0,1,0,7],[0,0,0,1]]") "]}");
    static const double turned[9] = {0, 1, 0, 0, 0, -1, -1, 0, 0};
    for (int k = 0; k < 9; k++) assert_near(c.R_cw[k], turned[k]);
    double center[3];
    sf_camera_center(&c, center);
    for (int k = 0; k < 3; k++) assert_near(center[k], 5 + k);
    sf_context_destroy(&ctx);
}

static void test_rotation_is_polished(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "one");
    sf_camera c =
        camera_of(ctx, "{" LENS "'frames':[" FRAME(
                           "images/a.png", "[[1,0.004,0,1],[-0.001,1.002,0,2],[0,0.003,0.999,3]]") "]}");
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double dot = 0;
            for (int k = 0; k < 3; k++) dot += c.R_cw[3 * i + k] * c.R_cw[3 * j + k];
            assert_true(fabs(dot - (i == j)) < 1e-14);
        }
    assert_true(fabs(c.R_cw[0] - 1) < 1e-2 && fabs(c.R_cw[4] + 1) < 1e-2);
    double center[3];
    sf_camera_center(&c, center);
    for (int k = 0; k < 3; k++) assert_near(center[k], 1 + k);
    sf_context_destroy(&ctx);
}

static void test_blender_angles_and_names(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "one");
    double angle = 0.6911112070083618;
    sf_camera c =
        camera_of(ctx, "{'camera_angle_x':0.6911112070083618,'frames':[" FRAME("./images/a", IDENTITY) "]}");
    assert_int_equal(c.width, WIDTH);
    assert_near(c.fx, 12 / tan(angle / 2));
    assert_near(c.fy, c.fx);
    assert_near(c.cx, 12);
    assert_near(c.cy, 8);
    c = camera_of(ctx, "{'camera_angle_x':0.5,'camera_angle_y':0.4,'w':48.0,'h':32.0,'frames':[" FRAME(
                           "images/a", IDENTITY) "]}");
    assert_near(c.fx, 12 / tan(0.25)); /* for 48 pixels, halved with the picture */
    assert_near(c.fy, 8 / tan(0.2));
    assert_near(c.cy, 8);
    sf_context_destroy(&ctx);
}

/* The order of instant-ngp: the frame before the file; x_fov, in degrees, before fl_x before camera_angle_x.
 */
static void test_focal_order(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "one");
#define OF_FRAME(focal) "{'file_path':'images/a.png'," focal ",'transform_matrix':" IDENTITY "}]}"
    sf_camera c = camera_of(ctx, "{'fl_x':200,'frames':[" OF_FRAME("'camera_angle_x':0.5"));
    assert_near(c.fx, 12 / tan(0.25));
    assert_near(c.fy, c.fx);
    c = camera_of(ctx, "{'x_fov':70,'fl_x':200,'frames':[" OF_FRAME("'fl_x':30,'fl_y':31"));
    assert_near(c.fx, 30);
    assert_near(c.fy, 31);
    c = camera_of(ctx, "{'fl_x':1,'frames':[" OF_FRAME("'x_fov':90,'fl_x':7,'camera_angle_x':3"));
    assert_near(c.fx, 12);
    c = camera_of(ctx, "{'frames':[" OF_FRAME("'fl_x':7,'camera_angle_x':3,'y_fov':90,'fl_y':3"));
    assert_near(c.fx, 7);
    assert_near(c.fy, 8);
    c = camera_of(ctx, "{'frames':[" OF_FRAME("'fl_y':9"));
    assert_near(c.fx, 9);
    sf_context_destroy(&ctx);
}

static void test_pictures_of_no_pinhole(void **state) {
    (void)state;
    static const char *const flags[] = {"latlong", "equirectangular", "orthographic"};
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "flags");
    for (int i = 0; i < 3; i++) {
        char text[512];
        snprintf(text, sizeof text, "{'%s':true," LENS "'frames':[" FRAME("images/a.png", IDENTITY) "]}",
                 flags[i]);
        transforms_assert_refused(ctx, "flags", text, SF_ERR_UNSUPPORTED, flags[i]);
        snprintf(text, sizeof text, "{'%s':false," LENS "'frames':[" FRAME("images/a.png", IDENTITY) "]}",
                 flags[i]);
        sf_scene *scene = transforms_load_json(ctx, "flags", text);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

#define START_END                                                                                            \
    "'transform_matrix_start':[[1,0,0,1],[0,1,0,2],[0,0,1,3]],"                                              \
    "'transform_matrix_end':[[0,-1,0,3],[1,0,0,2],[0,0,1,3]]"

/* Half the way of a quarter turn about z that moves by 2 along x. */
static void test_start_and_end(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    double at[3];
    transforms_make_project(ctx, "one");
    sf_camera c = camera_of(ctx, "{" LENS "'rolling_shutter':[0.5,0,0,0],'frames':[{'file_path':"
                                 "'images/a.png'," START_END "}]}");
    sf_camera_center(&c, at);
    assert_near(at[0], 2);
    assert_near(at[1], 2);
    assert_near(c.R_cw[0], sqrt(0.5));
    assert_near(c.R_cw[1], sqrt(0.5));
    assert_near(c.R_cw[3], sqrt(0.5));
    assert_near(c.R_cw[4], -sqrt(0.5));
    c = camera_of(ctx, "{" LENS "'frames':[{'file_path':'images/a.png'," START_END "}]}");
    sf_camera_center(&c, at);
    assert_near(at[0], 1);
    c = camera_of(ctx,
                  "{" LENS "'rolling_shutter':[0,0,1,0],'frames':[" FRAME("images/a.png", IDENTITY) "]}");
    sf_camera_center(&c, at);
    assert_near(at[0], 1); /* a camera at rest */
    transforms_assert_refused(
        ctx, "one",
        "{" LENS "'frames':[{'file_path':'images/a.png','rolling_shutter':[0,0,1,0]," START_END "}]}",
        SF_ERR_UNSUPPORTED, "rolling_shutter");
    transforms_assert_refused(
        ctx, "one", "{" LENS "'frames':[{'file_path':'images/a.png','rolling_shutter':[0]," START_END "}]}",
        SF_ERR_FORMAT, "rolling_shutter");
    sf_context_destroy(&ctx);
}

/* As Windows writes names, and with endings as cameras write them. */
static void test_names_of_windows(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "windows");
    assert_int_equal(rename(test_path_in("windows", "images/b.png"), test_path_in("windows", "images/b.PNG")),
                     0);
    transforms_write_picture(ctx, test_path_in("windows", "mask.png"), 1);
    test_write(test_path_in("windows", "points.ply"), transforms_one_point, strlen(transforms_one_point));
    sf_scene *scene = transforms_load_json(
        ctx, "windows",
        "{" LENS "'ply_file_path':'.\\\\points.ply','test_filenames':['images\\\\c.png'],'frames':["
        "{'file_path':'.\\\\images\\\\a.png','mask_path':'.\\\\mask.png','transform_matrix':" IDENTITY
        "}," FRAME("images/b", IDENTITY) "," FRAME("images\\\\c.png", IDENTITY) "]}");
    assert_int_equal(test_scene_info(scene).views, 3);
    assert_string_equal(test_view_info(scene, 0).name, "images/a.png");
    assert_int_equal(test_scene_info(scene).masked_views, 1);
    assert_int_equal(test_scene_info(scene).points, 1);
    sf_scene_destroy(&scene);
    sf_load_options options = transforms_train_all();
    options.test_list = test_path("windows-list");
    test_write(options.test_list, "\xEF\xBB\xBFimages\\b\r\n", 13);
    scene = test_load_scene(ctx, test_path("windows"), &options);
    assert_int_equal(test_view_info(scene, 1).split, SF_SPLIT_TEST);
    assert_int_equal(test_view_info(scene, 2).split, SF_SPLIT_TRAIN);
    sf_scene_destroy(&scene);
    transforms_assert_refused(ctx, "windows", "{" LENS "'frames':[" FRAME("..\\\\a.png", IDENTITY) "]}",
                              SF_ERR_FORMAT, "is not a path inside its folder");
    sf_context_destroy(&ctx);
}

/* Sides of 25 x 17 halve to 12 or 13 x 8 or 9, whoever rounds them; 24 x 16 are theirs but for a crop. */
static void test_shapes(void **state) {
    (void)state;
    static const struct {
        int w, h, views;
    } cases[] = {{25, 17, 1}, {47, 33, 1}, {49, 31, 1}, {96, 64, 1},   {190, 130, 1}, {12, 8, 1},
                 {24, 19, 0}, {16, 24, 0}, {48, 36, 0}, {200, 128, 1}, {210, 128, 0}};
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "shapes");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        snprintf(text, sizeof text,
                 "{'fl_x':20,'frames':[{'w':%d,'h':%d,'file_path':'images/a.png','transform_matrix':" IDENTITY
                 "}," FRAME("images/b.png", IDENTITY) "]}",
                 cases[i].w, cases[i].h);
        sf_scene *scene = transforms_load_json(ctx, "shapes", text);
        if ((int)test_scene_info(scene).views != 1 + cases[i].views)
            fail_msg("%d x %d", cases[i].w, cases[i].h);
        assert_int_equal(test_scene_info(scene).skipped_missing, 1 - cases[i].views);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_distortion(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "bent");
    sf_scene *scene = transforms_load_json(
        ctx, "bent",
        "{" LENS "'k1':0.1,'p2':0.01,'k3':0,'k4':0.0,'frames':[" FRAME("images/a.png", IDENTITY) "]}");
    assert_int_equal(test_scene_info(scene).undistorted_views, 1);
    assert_int_equal(test_view_info(scene, 0).has_mask, 1);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_masks(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    float mask[3 * PIXELS], weight[PIXELS];
    transforms_make_project(ctx, "masks");
    for (int i = 0; i < 3 * PIXELS; i++) mask[i] = i / 3 % WIDTH < 10 ? 0 : 1;
    assert_ok(ctx, sf_write_png(ctx, test_path_in("masks", "mask.png"), WIDTH, HEIGHT, mask));
    assert_ok(ctx, sf_write_png(ctx, test_path_in("masks", "small.png"), WIDTH / 2, HEIGHT, mask));
    sf_scene *scene = transforms_load_json(
        ctx, "masks",
        "{" LENS "'frames':["
        "{'file_path':'images/a.png','mask_path':'mask.png','transform_matrix':" IDENTITY "},"
        "{'file_path':'images/b.png','mask_path':'small.png','transform_matrix':" IDENTITY "},"
        "{'file_path':'images/c.png','mask_path':'none.png','transform_matrix':" IDENTITY "}]}");
    assert_int_equal(test_scene_info(scene).views, 1);
    assert_int_equal(test_scene_info(scene).skipped_missing, 2);
    transforms_assert_log("mask: size: 12 x 16 is not the picture's 24 x 16");
    transforms_assert_log("mask: No such file");
    assert_ok(ctx, sf_scene_get_pixels(scene, test_view_info(scene, 0).id, NULL, weight));
    for (int i = 0; i < PIXELS; i++) assert_true(weight[i] == (i % WIDTH < 10 ? 0.0f : 1.0f));
    sf_scene_destroy(&scene);
    sf_load_options quarter = transforms_train_all(); /* boxes of 4 x 4: the third of a row is half hidden */
    quarter.downscale = 4;
    float rgb[3 * PIXELS / 16];
    scene = test_load_scene(ctx, test_path("masks"), &quarter);
    assert_ok(ctx, sf_scene_get_pixels(scene, test_view_info(scene, 0).id, rgb, weight));
    for (int x = 0; x < WIDTH / 4; x++)
        assert_int_equal(255 * weight[x] + 0.5f, x < 2 ? 0 : x == 2 ? 128 : 255);
    for (int x = 2; x < WIDTH / 4; x++) { /* red at column c and row r is (24 r + c) / 384 */
        float column = x == 2 ? 10.5f : 4 * x + 1.5f;
        assert_true(fabsf(rgb[3 * x] - (24 * 1.5f + column) / PIXELS) < 1.1f / 255);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_points(void **state) {
    (void)state;
    static const char ply[] =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "end_header\n1 2 3 10 20 30\nnan 0 0 1 1 1\n4 5 6 40 50 60\n";
    static const char text[] =
        "{" LENS "'ply_file_path':'points.ply','frames':[" FRAME("images/a.png", IDENTITY) "]}";
    sf_context *ctx = test_context();
    float xyz[6];
    uint8_t rgb[6];
    transforms_make_project(ctx, "ply");
    test_log_clear();
    sf_scene *scene = transforms_load_json(ctx, "ply", text);
    assert_int_equal(test_scene_info(scene).points, 0);
    transforms_assert_log("ply_file_path");
    sf_scene_destroy(&scene);
    test_write(test_path_in("ply", "points.ply"), ply, strlen(ply));
    scene = transforms_load_json(ctx, "ply", text);
    assert_int_equal(test_scene_info(scene).points, 2);
    assert_int_equal(test_scene_info(scene).skipped_points, 1);
    transforms_assert_log("skipped 1 of 3 points that are not finite (first: #");
    assert_int_equal(sf_scene_get_points(scene, 0, 2, xyz, rgb), 2);
    assert_true(xyz[3] == 4 && xyz[5] == 6);
    assert_int_equal(rgb[4], 50);
    sf_scene_destroy(&scene);
    test_write(test_path_in("ply", "points.ply"), "plywood", 7);
    transforms_assert_refused(ctx, "ply", text, SF_ERR_FORMAT, "points.ply");
    sf_context_destroy(&ctx);
}

/* Photographs. */

static void test_real_fox(void **state) {
    (void)state;
    char path[1024];
    snprintf(path, sizeof path, "%s/fox-centred-270", test_data());
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, path, NULL);
    assert_int_equal(test_scene_info(scene).views, 50);
    assert_int_equal(test_scene_info(scene).test_views, 7);
    assert_int_equal(test_scene_info(scene).points, 19020);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The same cameras, written as transforms.json and by COLMAP. */
static void test_real_fox_is_as_colmap_says(void **state) {
    (void)state;
    char path[1024], json[1100];
    snprintf(path, sizeof path, "%s/fox", test_data());
    snprintf(json, sizeof json, "%s/transforms_8.json", path);
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    options.images = "images_8";
    sf_scene *colmap = test_load_scene(ctx, path, &options), *transforms = test_load_scene(ctx, json, NULL);
    assert_int_equal(test_scene_info(transforms).views, 50);
    for (size_t i = 0; i < 50; i++) {
        sf_camera a = test_view_info(colmap, i).camera, b = test_view_info(transforms, i).camera;
        assert_true(fabs(a.fx - b.fx) < 1e-6 && fabs(a.cy - b.cy) < 1e-6);
        for (int k = 0; k < 9; k++) assert_near(a.R_cw[k], b.R_cw[k]);
        for (int k = 0; k < 3; k++) assert_near(a.t_cw[k], b.t_cw[k]);
    }
    sf_scene_destroy(&colmap);
    sf_scene_destroy(&transforms);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lens_for_all_and_for_one),
        cmocka_unit_test(test_poses),
        cmocka_unit_test(test_rotation_is_polished),
        cmocka_unit_test(test_blender_angles_and_names),
        cmocka_unit_test(test_focal_order),
        cmocka_unit_test(test_pictures_of_no_pinhole),
        cmocka_unit_test(test_start_and_end),
        cmocka_unit_test(test_names_of_windows),
        cmocka_unit_test(test_shapes),
        cmocka_unit_test(test_distortion),
        cmocka_unit_test(test_masks),
        cmocka_unit_test(test_points),
        cmocka_unit_test(test_real_fox),
        cmocka_unit_test(test_real_fox_is_as_colmap_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
