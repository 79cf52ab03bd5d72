/* test_cameras_json.c - the views' cameras as INRIA's cameras.json. */
#include "testing.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <jansson.h>

static const uint8_t pixels[3 * 4 * 2];

/* A quarter turn about z, then a shift: world (x, y, z) is camera (-y + 1, x + 2, z + 3). */
static const sf_camera turned = {.width = 4,
                                 .height = 2,
                                 .fx = 1.0 / 3,
                                 .fy = 123.456789,
                                 .cx = 2,
                                 .cy = 1,
                                 .R_cw = {0, -1, 0, 1, 0, 0, 0, 0, 1},
                                 .t_cw = {1, 2, 3}};

static uint32_t add_view(sf_context *ctx, sf_scene *scene, const char *name, sf_split split) {
    uint32_t id;
    sf_pixels p = {.rgb = pixels, .stride = 3 * 4};
    assert_ok(ctx, sf_scene_add_view(scene, name, &turned, &p, split, &id));
    return id;
}

static json_t *save_and_parse(sf_context *ctx, sf_scene *scene) {
    size_t size;
    json_error_t error;
    const char *path = test_path("cameras.json");
    assert_ok(ctx, sf_scene_save_cameras(scene, path, 0));
    uint8_t *data = test_read(path, &size);
    json_t *list = json_loadb((const char *)data, size, 0, &error);
    if (!list) fail_msg("%s: line %d: %s", path, error.line, error.text);
    assert_true(json_is_array(list));
    free(data);
    return list;
}

static void assert_numbers(const json_t *list, const double *expected, size_t count) {
    assert_int_equal(json_array_size(list), count);
    for (size_t i = 0; i < count; i++) {
        assert_true(json_is_number(json_array_get(list, i)));
        assert_true(json_number_value(json_array_get(list, i)) == expected[i]);
    }
}

static void assert_name(const json_t *list, size_t index, const char *name) {
    assert_string_equal(json_string_value(json_object_get(json_array_get(list, index), "img_name")), name);
}

static void test_fields(void **state) {
    (void)state;
    static const double position[] = {-2, 1, -3};
    static const double rotation[3][3] = {{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    add_view(ctx, scene, "a.jpg", SF_SPLIT_TRAIN);
    json_t *list = save_and_parse(ctx, scene);
    assert_int_equal(json_array_size(list), 1);
    const json_t *view = json_array_get(list, 0), *rows = json_object_get(view, "rotation");
    assert_int_equal(json_object_size(view), 8);
    assert_int_equal(json_integer_value(json_object_get(view, "id")), 0);
    assert_name(list, 0, "a.jpg");
    assert_int_equal(json_integer_value(json_object_get(view, "width")), 4);
    assert_int_equal(json_integer_value(json_object_get(view, "height")), 2);
    assert_true(json_real_value(json_object_get(view, "fx")) == turned.fx);
    assert_true(json_real_value(json_object_get(view, "fy")) == turned.fy);
    assert_numbers(json_object_get(view, "position"), position, 3);
    assert_int_equal(json_array_size(rows), 3);
    for (size_t i = 0; i < 3; i++) assert_numbers(json_array_get(rows, i), rotation[i], 3);
    json_decref(list);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_every_view_in_order(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    add_view(ctx, scene, "z.jpg", SF_SPLIT_TRAIN);
    uint32_t gone = add_view(ctx, scene, "gone.jpg", SF_SPLIT_TRAIN);
    add_view(ctx, scene, "sub/folder/a.jpg", SF_SPLIT_TEST);
    assert_ok(ctx, sf_scene_remove_view(scene, gone));
    json_t *list = save_and_parse(ctx, scene);
    assert_int_equal(json_array_size(list), 2);
    assert_name(list, 0, "z.jpg");
    assert_name(list, 1, "sub/folder/a.jpg");
    assert_int_equal(json_integer_value(json_object_get(json_array_get(list, 1), "id")), 1);
    json_decref(list);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_names_of_any_bytes(void **state) {
    (void)state;
    static const char *const names[][2] = {
        {"say \"x\"\\\n\t\x01.png", "say \"x\"\\\n\t\x01.png"},
        {"f\xc3\xbcnf.png", "f\xc3\xbcnf.png"},
        {"f\xfcnf.png", "f?nf.png"}, /* Latin-1 */
        {"\xed\xa0\x80", "???"},     /* half a surrogate pair */
        {"", ""},
    };
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        add_view(ctx, scene, names[i][0], SF_SPLIT_TRAIN);
    json_t *list = save_and_parse(ctx, scene);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) assert_name(list, i, names[i][1]);
    json_decref(list);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_no_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    json_t *list = save_and_parse(ctx, scene);
    assert_int_equal(json_array_size(list), 0);
    json_decref(list);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_to_where_no_file_can_be(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    add_view(ctx, scene, "a.jpg", SF_SPLIT_TRAIN);
    test_write(test_path("a-file"), "old", 3);
    assert_int_equal(mkdir(test_path("a-folder"), 0700), 0);
    int entries = test_count_entries(test_folder());
    const char *paths[] = {test_path("a-file/cameras.json"), test_path("a-folder"),
                           test_path("absent/cameras.json")};
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        assert_status(ctx, sf_scene_save_cameras(scene, paths[i], 0), SF_ERR_IO);
        assert_error_names(ctx, paths[i]);
    }
    assert_int_equal(test_count_entries(test_folder()), entries);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_read_again(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_camera *cameras;
    size_t count;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    add_view(ctx, scene, "a.jpg", SF_SPLIT_TRAIN);
    add_view(ctx, scene, "b.jpg", SF_SPLIT_TEST);
    assert_ok(ctx, sf_scene_save_cameras(scene, test_path("again.json"), 0));
    assert_ok(ctx, sf_cameras_load(ctx, test_path("again.json"), &cameras, &count, NULL));
    assert_int_equal(count, 2);
    const sf_camera *c = &cameras[1];
    assert_true(c->width == 4 && c->height == 2 && c->cx == 2 && c->cy == 1);
    assert_float_equal(c->fx, turned.fx, 1e-12);
    assert_float_equal(c->fy, turned.fy, 1e-9);
    for (int k = 0; k < 9; k++) assert_float_equal(c->R_cw[k], turned.R_cw[k], 1e-12);
    for (int k = 0; k < 3; k++) assert_float_equal(c->t_cw[k], turned.t_cw[k], 1e-12);
    sf_cameras_free(ctx, &cameras);
    assert_null(cameras);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_files_that_are_wrong(void **state) {
    (void)state;
#define CAMERA(w, h, rotation)                                                                               \
    "{\"width\": " w ", \"height\": " h                                                                      \
    ", \"fx\": 1, \"fy\": 1, \"position\": [0, 0, 0], \"rotation\": " rotation "}"
#define UPRIGHT "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"
    static const struct {
        const char *text, *named;
        sf_status status;
    } cases[] = {
        {"", "line 1", SF_ERR_FORMAT},
        {"{}", "is not an array", SF_ERR_FORMAT},
        {"[]", "holds no camera", SF_ERR_EMPTY},
        {"[7]", "camera 0: width", SF_ERR_FORMAT},
        {"[" CAMERA("1e9", "4", UPRIGHT) "]", "camera 0: width", SF_ERR_FORMAT},
        {"[" CAMERA("4", "\"4\"", UPRIGHT) "]", "camera 0: height", SF_ERR_FORMAT},
        {"[" CAMERA("4", "4", UPRIGHT) ", " CAMERA("4", "4", "[1, 2, 3]") "]", "camera 1: rotation",
         SF_ERR_FORMAT},
        {"[" CAMERA("4", "4", "[[1, 0, 0], [0, 1, 0], [0, 0, -1]]") "]", "camera 0: rotation", SF_ERR_FORMAT},
        {"[" CAMERA("4", "4", "[[1, 0, 0], [0, 1, 0]]") "]", "camera 0: rotation", SF_ERR_FORMAT},
    };
    sf_context *ctx = test_context();
    const char *path = test_path("wrong.json");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_camera *cameras;
        size_t count;
        test_write(path, cases[i].text, strlen(cases[i].text));
        assert_status(ctx, sf_cameras_load(ctx, path, &cameras, &count, NULL), cases[i].status);
        assert_error_names(ctx, cases[i].named);
        assert_null(cameras);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fields),
        cmocka_unit_test(test_every_view_in_order),
        cmocka_unit_test(test_names_of_any_bytes),
        cmocka_unit_test(test_no_views),
        cmocka_unit_test(test_to_where_no_file_can_be),
        cmocka_unit_test(test_read_again),
        cmocka_unit_test(test_files_that_are_wrong),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
