/* test_transforms_refusals.c - malformed transforms.json, and memory that runs out. */
#include "transforms_fixture.h"

#include <stdio.h>
#include <string.h>

/* Well-formed files. */

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
    transforms_make_project(ctx, "bad");
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char text[1024];
        snprintf(text, sizeof text,
                 "{" LENS "'frames':[" FRAME("images/b.png", IDENTITY) "," FRAME("images/a.png", "%s") "]}",
                 bad[i]);
        sf_scene *scene = transforms_load_json(ctx, "bad", text);
        assert_int_equal(test_scene_info(scene).views, 1);
        assert_int_equal(test_scene_info(scene).skipped_pose, 1);
        sf_scene_destroy(&scene);
    }
    transforms_assert_refused(
        ctx, "bad", "{" LENS "'frames':[" FRAME("images/a.png", "[[0,0,0,1],[0,0,0,2],[0,0,0,3]]") "]}",
        SF_ERR_EMPTY, "no training view");
    sf_context_destroy(&ctx);
}

/* Malformed files. */

static const struct {
    const char *text;
    sf_status status;
    const char *part;
} malformed[] = {
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
    {"{" LENS "'frames':[" FRAME("images/a.png", IDENTITY) ",{'file_path':'images/b.png'}]}", SF_ERR_FORMAT,
     "frames[1]: transform_matrix: is missing"},
    {"{" LENS "'frames':[" FRAME("images/a.png", "5") "]}", SF_ERR_FORMAT, "frames[0]: transform_matrix"},
    {"{" LENS "'frames':[" FRAME("images/a.png", "[1,2,3,4]") "]}", SF_ERR_FORMAT, "not 4 numbers"},
    {"{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0,0],[0,1,0,0]]") "]}", SF_ERR_FORMAT, "3 or 4 rows"},
    {"{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0],[0,1,0],[0,0,1]]") "]}", SF_ERR_FORMAT,
     "not 4 numbers"},
    {"{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0,'x'],[0,1,0,0],[0,0,1,0]]") "]}", SF_ERR_FORMAT,
     "no number"},
    {"{" LENS "'frames':[" FRAME("images/a.png", "[[1,0,0,null],[0,1,0,0],[0,0,1,0]]") "]}", SF_ERR_FORMAT,
     "no number"},
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
    {"{" LENS "'ply_file_path':'/x.ply'," THREE_FRAMES, SF_ERR_FORMAT, "ply_file_path: is not a path inside"},
    {"{" LENS "'test_filenames':'a'," THREE_FRAMES, SF_ERR_FORMAT, "test_filenames: is not an array"},
    {"{" LENS "'test_filenames':[1]," THREE_FRAMES, SF_ERR_FORMAT, "test_filenames[0]: is not a text"},
    {"{" LENS "'test_filenames':['d.png']," THREE_FRAMES, SF_ERR_FORMAT,
     "test_filenames[0]: no frame has 'd.png'"},
};

static void test_malformed(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "wrong");
    for (size_t i = 0; i < sizeof malformed / sizeof *malformed; i++)
        transforms_assert_refused(ctx, "wrong", malformed[i].text, malformed[i].status, malformed[i].part);
    sf_context_destroy(&ctx);
}

static void test_truncation_at_every_byte(void **state) {
    (void)state;
    static const char text[] = "{" LENS "'test_filenames':['images/b.png']," THREE_FRAMES;
    sf_context *ctx = test_context();
    char cut[sizeof text];
    transforms_make_project(ctx, "cut");
    for (size_t size = 0; size + 1 < sizeof text; size++) {
        memcpy(cut, text, size);
        cut[size] = 0;
        transforms_assert_refused(ctx, "cut", cut, SF_ERR_FORMAT, "transforms.json");
    }
    sf_scene *scene = transforms_load_json(ctx, "cut", text);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_deep_nesting(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    char text[TEXT_BYTES];
    transforms_make_project(ctx, "deep");
    memset(text, '[', sizeof text - 1);
    text[sizeof text - 1] = 0;
    transforms_assert_refused(ctx, "deep", text, SF_ERR_FORMAT, "JSON");
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
    transforms_make_project(ctx, "memory");
    transforms_write_json(
        "memory", "transforms.json",
        "{'camera_angle_x':0.7,'k1':0.1,'mask_path':'images/c.png','ply_file_path':'points.ply',"
        "'test_filenames':['images/b.png']," THREE_FRAMES);
    test_write(test_path_in("memory", "points.ply"), transforms_one_point, strlen(transforms_one_point));
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_poses_that_are_none),      cmocka_unit_test(test_malformed),
        cmocka_unit_test(test_truncation_at_every_byte), cmocka_unit_test(test_deep_nesting),
        cmocka_unit_test(test_each_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
