/* test_transforms.c - transforms.json as its three writers write it, and malformed. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { WIDTH = 24, HEIGHT = 16, PIXELS = WIDTH * HEIGHT, TEXT_BYTES = 8192 };

#define IDENTITY            "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]"
#define LENS                "'w':24,'h':16,'fl_x':20,'fl_y':21,'cx':12.5,'cy':8.25,"
#define FRAME(name, matrix) "{'file_path':'" name "','transform_matrix':" matrix "}"

/* Writes JSON that is spelled with ' for ". */
static void write_json(const char *project, const char *name, const char *text) {
    char json[TEXT_BYTES];
    size_t size = strlen(text);
    assert_true(size < sizeof json);
    for (size_t i = 0; i < size; i++) json[i] = text[i];
    for (size_t i = 0; i < size; i++)
        if (json[i] == '\'') json[i] = '"';
    test_write(test_path_in(project, name), json, size);
}

static void write_picture(sf_context *ctx, const char *path, float level) {
    float rgb[3 * PIXELS];
    for (int i = 0; i < 3 * PIXELS; i++) rgb[i] = i % 3 ? level : (float)(i / 3) / PIXELS;
    assert_ok(ctx, sf_write_png(ctx, path, WIDTH, HEIGHT, rgb));
}

/* A folder with images/a.png, b.png and c.png. */
static void make_project(sf_context *ctx, const char *project) {
    mkdir(test_path(project), 0777);
    mkdir(test_path_in(project, "images"), 0777);
    write_picture(ctx, test_path_in(project, "images/a.png"), 0.25f);
    write_picture(ctx, test_path_in(project, "images/b.png"), 0.5f);
    write_picture(ctx, test_path_in(project, "images/c.png"), 0.75f);
}

static sf_load_options train_all(void) {
    sf_load_options options = sf_load_options_default();
    options.hold_out = 0;
    return options;
}

static sf_scene *load_json(sf_context *ctx, const char *project, const char *text) {
    sf_load_options options = train_all();
    write_json(project, "transforms.json", text);
    return test_load_scene(ctx, test_path(project), &options);
}

static void assert_refused(sf_context *ctx, const char *project, const char *text, sf_status expected,
                           const char *part) {
    sf_scene *scene;
    sf_load_options options = train_all();
    write_json(project, "transforms.json", text);
    assert_status(ctx, sf_scene_load(ctx, test_path(project), &options, &scene), expected);
    assert_null(scene);
    assert_error_names(ctx, part);
    assert_error_names(ctx, project);
}

static void assert_near(double got, double expected) {
    if (!(fabs(got - expected) <= 1e-9)) fail_msg("%.17g is not %.17g", got, expected);
}

static void assert_log(const char *part) { test_assert_contains(test_log, part, __FILE__, __LINE__); }

/* Well-formed files. */

static const char one_point[] =
    "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    "property float z\nend_header\n1 2 3\n";

static void test_lens_for_all_and_for_one(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    make_project(ctx, "lens");
    sf_scene *scene = load_json(ctx, "lens",
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
    sf_scene *scene = load_json(ctx, "one", text);
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
    make_project(ctx, "one");
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
    make_project(ctx, "one");
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

static void test_poses_that_are_none(void **state) {
    (void)state;
    static const char *const bad[] = {
        "[[1,0.1,0,1],[0,1,0,2],[0,0,1,3]]",           /* sheared */
        "[[1,0,0,1],[0,1,0,2],[0,0,-1,3]]",            /* a mirror */
        "[[0,0,0,1],[0,0,0,2],[0,0,0,3]]",             /* nothing */
        "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,2]]",   /* not affine */
        "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[5,6,7,1]]",   /* transposed */
        "[[1,0,0,1],[0,2,0,2],[0,0,1,3]]",             /* scaled along one axis */
        "[[1e300,0,0,1],[0,1e300,0,2],[0,0,1e300,3]]", /* its squares overflow */
        "[[1,0,0,1e308],[0.6,0.8,0,1e308],[0,0,1,1e308]]",
    };
    sf_context *ctx = test_context();
    make_project(ctx, "bad");
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char text[1024];
        snprintf(text, sizeof text,
                 "{" LENS "'frames':[" FRAME("images/b.png", IDENTITY) "," FRAME("images/a.png", "%s") "]}",
                 bad[i]);
        sf_scene *scene = load_json(ctx, "bad", text);
        assert_int_equal(test_scene_info(scene).views, 1);
        assert_int_equal(test_scene_info(scene).skipped_pose, 1);
        sf_scene_destroy(&scene);
    }
    assert_refused(ctx, "bad",
                   "{" LENS "'frames':[" FRAME("images/a.png", "[[0,0,0,1],[0,0,0,2],[0,0,0,3]]") "]}",
                   SF_ERR_EMPTY, "no training view");
    sf_context_destroy(&ctx);
}

static void test_blender_angles_and_names(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    make_project(ctx, "one");
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
    make_project(ctx, "one");
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
    make_project(ctx, "flags");
    for (int i = 0; i < 3; i++) {
        char text[512];
        snprintf(text, sizeof text, "{'%s':true," LENS "'frames':[" FRAME("images/a.png", IDENTITY) "]}",
                 flags[i]);
        assert_refused(ctx, "flags", text, SF_ERR_UNSUPPORTED, flags[i]);
        snprintf(text, sizeof text, "{'%s':false," LENS "'frames':[" FRAME("images/a.png", IDENTITY) "]}",
                 flags[i]);
        sf_scene *scene = load_json(ctx, "flags", text);
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
    make_project(ctx, "one");
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
    assert_refused(ctx, "one",
                   "{" LENS "'frames':[{'file_path':'images/a.png','rolling_shutter':[0,0,1,0]," START_END
                   "}]}",
                   SF_ERR_UNSUPPORTED, "rolling_shutter");
    assert_refused(ctx, "one",
                   "{" LENS "'frames':[{'file_path':'images/a.png','rolling_shutter':[0]," START_END "}]}",
                   SF_ERR_FORMAT, "rolling_shutter");
    sf_context_destroy(&ctx);
}

/* As Windows writes names, and with endings as cameras write them. */
static void test_names_of_windows(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    make_project(ctx, "windows");
    assert_int_equal(rename(test_path_in("windows", "images/b.png"), test_path_in("windows", "images/b.PNG")),
                     0);
    write_picture(ctx, test_path_in("windows", "mask.png"), 1);
    test_write(test_path_in("windows", "points.ply"), one_point, strlen(one_point));
    sf_scene *scene = load_json(
        ctx, "windows",
        "{" LENS "'ply_file_path':'.\\\\points.ply','test_filenames':['images\\\\c.png'],'frames':["
        "{'file_path':'.\\\\images\\\\a.png','mask_path':'.\\\\mask.png','transform_matrix':" IDENTITY
        "}," FRAME("images/b", IDENTITY) "," FRAME("images\\\\c.png", IDENTITY) "]}");
    assert_int_equal(test_scene_info(scene).views, 3);
    assert_string_equal(test_view_info(scene, 0).name, "images/a.png");
    assert_int_equal(test_scene_info(scene).masked_views, 1);
    assert_int_equal(test_scene_info(scene).points, 1);
    sf_scene_destroy(&scene);
    sf_load_options options = train_all();
    options.test_list = test_path("windows-list");
    test_write(options.test_list, "\xEF\xBB\xBFimages\\b\r\n", 13);
    scene = test_load_scene(ctx, test_path("windows"), &options);
    assert_int_equal(test_view_info(scene, 1).split, SF_SPLIT_TEST);
    assert_int_equal(test_view_info(scene, 2).split, SF_SPLIT_TRAIN);
    sf_scene_destroy(&scene);
    assert_refused(ctx, "windows", "{" LENS "'frames':[" FRAME("..\\\\a.png", IDENTITY) "]}", SF_ERR_FORMAT,
                   "is not a path inside its folder");
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
    make_project(ctx, "shapes");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        snprintf(text, sizeof text,
                 "{'fl_x':20,'frames':[{'w':%d,'h':%d,'file_path':'images/a.png','transform_matrix':" IDENTITY
                 "}," FRAME("images/b.png", IDENTITY) "]}",
                 cases[i].w, cases[i].h);
        sf_scene *scene = load_json(ctx, "shapes", text);
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
    make_project(ctx, "bent");
    sf_scene *scene = load_json(
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
    make_project(ctx, "masks");
    for (int i = 0; i < 3 * PIXELS; i++) mask[i] = i / 3 % WIDTH < 10 ? 0 : 1;
    assert_ok(ctx, sf_write_png(ctx, test_path_in("masks", "mask.png"), WIDTH, HEIGHT, mask));
    assert_ok(ctx, sf_write_png(ctx, test_path_in("masks", "small.png"), WIDTH / 2, HEIGHT, mask));
    sf_scene *scene =
        load_json(ctx, "masks",
                  "{" LENS "'frames':["
                  "{'file_path':'images/a.png','mask_path':'mask.png','transform_matrix':" IDENTITY "},"
                  "{'file_path':'images/b.png','mask_path':'small.png','transform_matrix':" IDENTITY "},"
                  "{'file_path':'images/c.png','mask_path':'none.png','transform_matrix':" IDENTITY "}]}");
    assert_int_equal(test_scene_info(scene).views, 1);
    assert_int_equal(test_scene_info(scene).skipped_missing, 2);
    assert_log("mask: size: 12 x 16 is not the picture's 24 x 16");
    assert_log("mask: No such file");
    assert_ok(ctx, sf_scene_get_pixels(scene, test_view_info(scene, 0).id, NULL, weight));
    for (int i = 0; i < PIXELS; i++) assert_true(weight[i] == (i % WIDTH < 10 ? 0.0f : 1.0f));
    sf_scene_destroy(&scene);
    sf_load_options quarter = train_all(); /* boxes of 4 x 4: the third of a row is half hidden */
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
    make_project(ctx, "ply");
    test_log_clear();
    sf_scene *scene = load_json(ctx, "ply", text);
    assert_int_equal(test_scene_info(scene).points, 0);
    assert_log("ply_file_path");
    sf_scene_destroy(&scene);
    test_write(test_path_in("ply", "points.ply"), ply, strlen(ply));
    scene = load_json(ctx, "ply", text);
    assert_int_equal(test_scene_info(scene).points, 2);
    assert_int_equal(test_scene_info(scene).skipped_points, 1);
    assert_log("skipped 1 of 3 points that are not finite (first: #");
    assert_int_equal(sf_scene_get_points(scene, 0, 2, xyz, rgb), 2);
    assert_true(xyz[3] == 4 && xyz[5] == 6);
    assert_int_equal(rgb[4], 50);
    sf_scene_destroy(&scene);
    test_write(test_path_in("ply", "points.ply"), "plywood", 7);
    assert_refused(ctx, "ply", text, SF_ERR_FORMAT, "points.ply");
    sf_context_destroy(&ctx);
}

/* Splits. */

#define THREE_FRAMES                                                                                         \
    "'frames':[" FRAME("images/a.png", IDENTITY) "," FRAME("images/b.png", IDENTITY) "," FRAME(              \
        "images/c.png", IDENTITY) "]}"

static void assert_held_out(sf_context *ctx, const char *project, const sf_load_options *options,
                            unsigned mask) {
    sf_scene *scene = test_load_scene(ctx, test_path(project), options);
    for (size_t i = 0; i < test_scene_info(scene).views; i++)
        assert_int_equal(test_view_info(scene, i).split == SF_SPLIT_TEST, mask >> i & 1);
    sf_scene_destroy(&scene);
}

static void test_lists_of_names(void **state) {
    (void)state;
    static const struct {
        const char *text;
        unsigned mask;
    } lists[] = {{"'test_filenames':['images/b.png'],", 2},
                 {"'val_filenames':['./images/c.png'],'test_filenames':['images/b.png'],", 6},
                 {"'train_filenames':['images/a.png'],", 6},
                 {"'train_filenames':['images/a.png','images/b.png'],'test_filenames':['images/b.png'],", 6},
                 {"", 1}}; /* none: the first of every 8 */
    sf_context *ctx = test_context();
    sf_load_options none = train_all();
    make_project(ctx, "lists");
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        char text[2048];
        snprintf(text, sizeof text, "{" LENS "%s" THREE_FRAMES, lists[i].text);
        write_json("lists", "transforms.json", text);
        assert_held_out(ctx, "lists", NULL, lists[i].mask);
        assert_held_out(ctx, "lists", &none, 0);
    }
    char list[256];
    snprintf(list, sizeof list, "%s", test_path_in("lists", "list.txt"));
    test_write(list, "a.png\n", 6);
    write_json("lists", "transforms.json", "{" LENS "'test_filenames':['images/b.png']," THREE_FRAMES);
    sf_load_options by_list = sf_load_options_default();
    by_list.test_list = list; /* the user's word stands above the file's */
    assert_held_out(ctx, "lists", &by_list, 1);
    sf_context_destroy(&ctx);
}

static void test_blender_pair(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    make_project(ctx, "pair");
    write_json("pair", "transforms_train.json",
               "{'camera_angle_x':0.7,'frames':[" FRAME("./images/c", IDENTITY) "," FRAME("./images/a",
                                                                                          IDENTITY) "]}");
    sf_load_options all = train_all();
    assert_held_out(ctx, "pair", &all, 0);
    write_json("pair", "transforms_test.json",
               "{'camera_angle_x':0.7,'frames':[" FRAME("./images/b", IDENTITY) "]}");
    write_json("pair", "transforms_val.json", "nonsense");
    assert_held_out(ctx, "pair", NULL, 2);
    sf_scene *scene = test_load_scene(ctx, test_path("pair"), NULL);
    assert_int_equal(test_scene_info(scene).views, 3);
    assert_string_equal(test_view_info(scene, 1).name, "images/b");
    sf_scene_destroy(&scene);
    write_json("pair", "transforms_test.json", "{");
    assert_status(ctx, sf_scene_load(ctx, test_path("pair"), NULL, &scene), SF_ERR_FORMAT);
    assert_error_names(ctx, "transforms_test.json");
    sf_context_destroy(&ctx);
}

static void test_file_is_as_good_as_its_folder(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    make_project(ctx, "file");
    write_json("file", "other.json", "{" LENS THREE_FRAMES);
    sf_scene *scene = test_load_scene(ctx, test_path_in("file", "other.json"), NULL);
    assert_int_equal(test_scene_info(scene).views, 3);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_missing_picture_is_skipped(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    make_project(ctx, "gone");
    test_log_clear();
    sf_scene *scene = load_json(ctx, "gone",
                                "{'camera_angle_x':0.7,'frames':[" FRAME("images/none", IDENTITY) "," FRAME(
                                    "images/b.png", IDENTITY) "]}");
    assert_int_equal(test_scene_info(scene).views, 1);
    assert_int_equal(test_scene_info(scene).skipped_missing, 1);
    assert_log("images/none: skipped: No such file");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Malformed files. */

static void test_malformed(void **state) {
    (void)state;
    static const struct {
        const char *text;
        sf_status status;
        const char *part;
    } cases[] = {
        {"", SF_ERR_FORMAT, "JSON"},
        {"{", SF_ERR_FORMAT, "line 1: JSON"},
        {"{}\n\n{}", SF_ERR_FORMAT, "line 3: JSON"},
        {"[]", SF_ERR_FORMAT, "top level is not an object"},
        {"{'frames':NaN}", SF_ERR_FORMAT, "JSON"},
        {"{}", SF_ERR_FORMAT, "frames: is missing"},
        {"{'frames':{}}", SF_ERR_FORMAT, "frames: is not an array"},
        {"{'frames':[]}", SF_ERR_EMPTY, "names no picture"},
        {"{'frames':[5]}", SF_ERR_FORMAT, "frames[0]: is not an object"},
        {"{" LENS "'frames':[{}]}", SF_ERR_FORMAT, "frames[0]: file_path: is missing"},
        {"{" LENS "'frames':[{'file_path':5}]}", SF_ERR_FORMAT, "frames[0]: file_path: is not a text"},
        {"{" LENS "'frames':[" FRAME("images/a.png", IDENTITY) ",{'file_path':'images/b.png'}]}",
         SF_ERR_FORMAT, "frames[1]: transform_matrix: is missing"},
        {"{" LENS "'frames':[" FRAME("images/a.png", "5") "]}", SF_ERR_FORMAT, "frames[0]: transform_matrix"},
        {"{" LENS "'frames':[" FRAME("images/a.png", "[1,2,3,4]") "]}", SF_ERR_FORMAT, "not 4 numbers"},
        {"{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0,0],[0,1,0,0]]") "]}", SF_ERR_FORMAT,
         "3 or 4 rows"},
        {"{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0],[0,1,0],[0,0,1]]") "]}", SF_ERR_FORMAT,
         "not 4 numbers"},
        {"{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0,'x'],[0,1,0,0],[0,0,1,0]]") "]}", SF_ERR_FORMAT,
         "no number"},
        {"{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0,null],[0,1,0,0],[0,0,1,0]]") "]}",
         SF_ERR_FORMAT, "no number"},
        {"{" LENS "'frames':[" FRAME("../a.png", IDENTITY) "]}", SF_ERR_FORMAT, "'../a.png'"},
        {"{" LENS "'frames':[" FRAME("/etc/passwd", IDENTITY) "]}", SF_ERR_FORMAT, "'/etc/passwd'"},
        {"{" LENS "'frames':[" FRAME("images/a.png", IDENTITY) "," FRAME("./images/a.png", IDENTITY) "]}",
         SF_ERR_FORMAT, "'images/a.png' appears twice"},
        {"{'w':'24'," THREE_FRAMES, SF_ERR_FORMAT, "frames[0]: w: is not a number"},
        {"{'w':0,'h':16,'fl_x':20," THREE_FRAMES, SF_ERR_FORMAT, "w: 0 is not a whole number"},
        {"{'w':24,'h':1e9,'fl_x':20," THREE_FRAMES, SF_ERR_FORMAT, "h: 1e+09 is not a whole number"},
        {"{'w':24.5,'h':16,'fl_x':20," THREE_FRAMES, SF_ERR_FORMAT, "w: 24.5 is not a whole number"},
        {"{'w':24,'fl_x':20," THREE_FRAMES, SF_ERR_FORMAT, "h: is missing"},
        {"{'w':24,'h':16," THREE_FRAMES, SF_ERR_FORMAT, "fl_x: is missing"},
        {"{'w':24,'h':16,'fl_x':[20]," THREE_FRAMES, SF_ERR_FORMAT, "fl_x: is not a number"},
        {"{" LENS "'k2':'no'," THREE_FRAMES, SF_ERR_FORMAT, "k2: is not a number"},
        {"{" LENS "'k5':0.1," THREE_FRAMES, SF_ERR_UNSUPPORTED, "k5: 0.1 is not supported"},
        {"{" LENS "'k6':-1," THREE_FRAMES, SF_ERR_UNSUPPORTED, "k6: -1 is not supported"},
        {"{" LENS "'camera_model':'FOV'," THREE_FRAMES, SF_ERR_UNSUPPORTED, "FOV"},
        {"{" LENS "'camera_model':'EQUIRECTANGULAR'," THREE_FRAMES, SF_ERR_UNSUPPORTED, "EQUIRECTANGULAR"},
        {"{" LENS "'camera_model':4," THREE_FRAMES, SF_ERR_FORMAT, "camera_model: is not a text"},
        {"{" LENS "'mask_path':'../m.png'," THREE_FRAMES, SF_ERR_FORMAT, "mask_path: is not a path inside"},
        {"{" LENS "'ply_file_path':5," THREE_FRAMES, SF_ERR_FORMAT, "ply_file_path: is not a text"},
        {"{" LENS "'ply_file_path':'/x.ply'," THREE_FRAMES, SF_ERR_FORMAT,
         "ply_file_path: is not a path inside"},
        {"{" LENS "'test_filenames':'a'," THREE_FRAMES, SF_ERR_FORMAT, "test_filenames: is not an array"},
        {"{" LENS "'test_filenames':[1]," THREE_FRAMES, SF_ERR_FORMAT, "test_filenames[0]: is not a text"},
        {"{" LENS "'test_filenames':['d.png']," THREE_FRAMES, SF_ERR_FORMAT,
         "test_filenames[0]: no frame has 'd.png'"},
    };
    sf_context *ctx = test_context();
    make_project(ctx, "wrong");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_refused(ctx, "wrong", cases[i].text, cases[i].status, cases[i].part);
    sf_context_destroy(&ctx);
}

static void test_truncation_at_every_byte(void **state) {
    (void)state;
    static const char text[] = "{" LENS "'test_filenames':['images/b.png']," THREE_FRAMES;
    sf_context *ctx = test_context();
    char cut[sizeof text];
    make_project(ctx, "cut");
    for (size_t size = 0; size + 1 < sizeof text; size++) {
        memcpy(cut, text, size);
        cut[size] = 0;
        assert_refused(ctx, "cut", cut, SF_ERR_FORMAT, "transforms.json");
    }
    sf_scene *scene = load_json(ctx, "cut", text);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_deep_nesting(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    char text[TEXT_BYTES];
    make_project(ctx, "deep");
    memset(text, '[', sizeof text - 1);
    text[sizeof text - 1] = 0;
    assert_refused(ctx, "deep", text, SF_ERR_FORMAT, "JSON");
    sf_context_destroy(&ctx);
}

/* No memory. */

static void test_each_allocation_may_fail(void **state) {
    (void)state;
    long countdown = -1, at = 0;
    sf_allocator allocator = {test_refuse_alloc, test_refuse_free, &countdown};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx = test_context();
    sf_scene *scene;
    make_project(ctx, "memory");
    write_json("memory", "transforms.json",
               "{'camera_angle_x':0.7,'k1':0.1,'mask_path':'images/c.png','ply_file_path':'points.ply',"
               "'test_filenames':['images/b.png']," THREE_FRAMES);
    test_write(test_path_in("memory", "points.ply"), one_point, strlen(one_point));
    sf_context_destroy(&ctx);
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    for (;; at++) {
        countdown = at;
        sf_status status = sf_scene_load(ctx, test_path("memory"), NULL, &scene);
        if (countdown >= 0) { /* it took fewer allocations than that */
            assert_ok(ctx, status);
            break;
        }
        assert_status(ctx, status, SF_ERR_MEMORY);
        assert_null(scene);
        assert_error_names(ctx, "out of memory");
    }
    assert_int_equal(test_scene_info(scene).views, 3);
    assert_int_equal(test_scene_info(scene).points, 1);
    assert_true(at > 50);
    sf_scene_destroy(&scene);
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
        cmocka_unit_test(test_poses_that_are_none),
        cmocka_unit_test(test_blender_angles_and_names),
        cmocka_unit_test(test_focal_order),
        cmocka_unit_test(test_pictures_of_no_pinhole),
        cmocka_unit_test(test_start_and_end),
        cmocka_unit_test(test_names_of_windows),
        cmocka_unit_test(test_shapes),
        cmocka_unit_test(test_distortion),
        cmocka_unit_test(test_masks),
        cmocka_unit_test(test_points),
        cmocka_unit_test(test_lists_of_names),
        cmocka_unit_test(test_blender_pair),
        cmocka_unit_test(test_file_is_as_good_as_its_folder),
        cmocka_unit_test(test_missing_picture_is_skipped),
        cmocka_unit_test(test_malformed),
        cmocka_unit_test(test_truncation_at_every_byte),
        cmocka_unit_test(test_deep_nesting),
        cmocka_unit_test(test_each_allocation_may_fail),
        cmocka_unit_test(test_real_fox),
        cmocka_unit_test(test_real_fox_is_as_colmap_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
