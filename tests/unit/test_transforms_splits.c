/* test_transforms_splits.c - the splits of transforms.json: lists of names, pairs of files. */
#include "transforms_fixture.h"

#include <stdio.h>
#include <string.h>

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
    sf_load_options none = transforms_train_all();
    transforms_make_project(ctx, "lists");
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        char text[2048];
        snprintf(text, sizeof text, "{" LENS "%s" THREE_FRAMES, lists[i].text);
        transforms_write_json("lists", "transforms.json", text);
        assert_held_out(ctx, "lists", NULL, lists[i].mask);
        assert_held_out(ctx, "lists", &none, 0);
    }
    char list[256];
    snprintf(list, sizeof list, "%s", test_path_in("lists", "list.txt"));
    test_write(list, "a.png\n", 6);
    transforms_write_json("lists", "transforms.json",
                          "{" LENS "'test_filenames':['images/b.png']," THREE_FRAMES);
    sf_load_options by_list = sf_load_options_default();
    by_list.test_list = list; /* the user's word stands above the file's */
    assert_held_out(ctx, "lists", &by_list, 1);
    sf_context_destroy(&ctx);
}

static void test_blender_pair(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "pair");
    transforms_write_json("pair", "transforms_train.json",
                          "{'camera_angle_x':0.7,'frames':[" FRAME("./images/c", IDENTITY) "," FRAME(
                              "./images/a", IDENTITY) "]}");
    sf_load_options all = transforms_train_all();
    assert_held_out(ctx, "pair", &all, 0);
    transforms_write_json("pair", "transforms_test.json",
                          "{'camera_angle_x':0.7,'frames':[" FRAME("./images/b", IDENTITY) "]}");
    transforms_write_json("pair", "transforms_val.json", "nonsense");
    assert_held_out(ctx, "pair", NULL, 2);
    sf_scene *scene = test_load_scene(ctx, test_path("pair"), NULL);
    assert_int_equal(test_scene_info(scene).views, 3);
    assert_string_equal(test_view_info(scene, 1).name, "images/b");
    sf_scene_destroy(&scene);
    transforms_write_json("pair", "transforms_test.json", "{");
    assert_status(ctx, sf_scene_load(ctx, test_path("pair"), NULL, &scene), SF_ERR_FORMAT);
    assert_error_names(ctx, "transforms_test.json");
    sf_context_destroy(&ctx);
}

static void test_file_is_as_good_as_its_folder(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "file");
    transforms_write_json("file", "other.json", "{" LENS THREE_FRAMES);
    sf_scene *scene = test_load_scene(ctx, test_path_in("file", "other.json"), NULL);
    assert_int_equal(test_scene_info(scene).views, 3);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_missing_picture_is_skipped(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "gone");
    test_log_clear();
    sf_scene *scene =
        transforms_load_json(ctx, "gone",
                             "{'camera_angle_x':0.7,'frames':[" FRAME("images/none", IDENTITY) "," FRAME(
                                 "images/b.png", IDENTITY) "]}");
    assert_int_equal(test_scene_info(scene).views, 1);
    assert_int_equal(test_scene_info(scene).skipped_missing, 1);
    transforms_assert_log("images/none: skipped: No such file");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* One line, which names a copy and its original; not for copies that are all trained on. */
static void test_copies_are_told(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options all = transforms_train_all();
    transforms_make_project(ctx, "copies");
    transforms_write_json("copies", "transforms.json", "{" LENS THREE_FRAMES);
    test_log_clear();
    assert_held_out(ctx, "copies", NULL, 1);
    assert_null(strstr(test_log, "copies of"));
    transforms_write_picture(ctx, test_path_in("copies", "images/c.png"), 0.25f);
    assert_held_out(ctx, "copies", &all, 0);
    assert_null(strstr(test_log, "copies of"));
    assert_held_out(ctx, "copies", NULL, 1);
    transforms_assert_log(
        "1 held-out pictures are copies of training pictures (images/a.png of images/c.png)");
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lists_of_names),
        cmocka_unit_test(test_blender_pair),
        cmocka_unit_test(test_copies_are_told),
        cmocka_unit_test(test_file_is_as_good_as_its_folder),
        cmocka_unit_test(test_missing_picture_is_skipped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
