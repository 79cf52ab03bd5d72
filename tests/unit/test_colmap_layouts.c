/* test_colmap_layouts.c - COLMAP's files as other programs lay them out, and what is said where a part of
 * them is elsewhere. */
#include "colmap_fixture.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* The cameras and points of two scenes are the same. */
static void assert_same(sf_scene *a, sf_scene *b) {
    float xyz[2][3 * POINTS];
    assert_int_equal(test_scene_info(a).views, IMAGES);
    assert_int_equal(test_scene_info(b).views, IMAGES);
    for (size_t i = 0; i < IMAGES; i++) {
        sf_view_info x = test_view_info(a, i), y = test_view_info(b, i);
        assert_memory_equal(x.camera.R_cw, y.camera.R_cw, sizeof x.camera.R_cw);
        assert_memory_equal(x.camera.t_cw, y.camera.t_cw, sizeof x.camera.t_cw);
        assert_memory_equal(&x.camera.fx, &y.camera.fx, 4 * sizeof(double));
    }
    assert_int_equal(sf_scene_get_points(a, 0, POINTS, xyz[0], NULL), POINTS);
    assert_int_equal(sf_scene_get_points(b, 0, POINTS, xyz[1], NULL), POINTS);
    assert_memory_equal(xyz[0], xyz[1], sizeof xyz[0]);
}

/* rigs.bin and frames.bin of COLMAP 3.12: one rig of two cameras, and a frame of two pictures. Poses of
 * pictures are in images.bin as before. */
static void write_rig(const char *project) {
    static const double pose[7] = {0.7, 0.7, 0, 0.1, 5, 6, 7};
    buffer rigs = {.size = 0}, frames = {.size = 0};
    colmap_add_uint(&rigs, 1, 8);
    colmap_add_uint(&rigs, 1, 4); /* its number */
    colmap_add_uint(&rigs, 2, 4); /* sensors */
    colmap_add_uint(&rigs, 0, 4); /* a camera */
    colmap_add_uint(&rigs, 7, 4);
    colmap_add_uint(&rigs, 0, 4);
    colmap_add_uint(&rigs, 2, 4);
    colmap_add_uint(&rigs, 1, 1); /* has a pose */
    colmap_add_doubles(&rigs, pose, 7);
    colmap_add_uint(&frames, 1, 8);
    colmap_add_uint(&frames, 1, 4);
    colmap_add_uint(&frames, 1, 4);
    colmap_add_doubles(&frames, pose, 7);
    colmap_add_uint(&frames, 2, 4);
    for (uint64_t i = 0; i < 2; i++) {
        colmap_add_uint(&frames, 0, 4);
        colmap_add_uint(&frames, i ? 2 : 7, 4);
        colmap_add_uint(&frames, i ? 1 : 4, 8);
    }
    test_write(test_path_in(project, "sparse/0/rigs.bin"), rigs.data, rigs.size);
    test_write(test_path_in(project, "sparse/0/frames.bin"), frames.data, frames.size);
}

static void test_rigs(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *plain = test_load_scene(ctx, colmap_write_project(ctx, "plain"), NULL);
    colmap_write_project(ctx, "rig");
    write_rig("rig");
    sf_scene *rig = test_load_scene(ctx, test_path("rig"), NULL);
    assert_same(plain, rig);
    sf_scene_destroy(&plain);
    sf_scene_destroy(&rig);
    assert_int_equal(unlink(test_path_in("rig", "sparse/0/images.bin")), 0);
    colmap_assert_refused(ctx, test_path("rig"), SF_ERR_IO, "holds neither images.bin nor images.txt");
    sf_context_destroy(&ctx);
}

/* A project whose model has other names of the pictures. */
static void write_named(sf_context *ctx, const char *project, const char names[IMAGES][32]) {
    files f = colmap_binary_files();
    f.images.size = 0;
    colmap_add_uint(&f.images, IMAGES, 8);
    for (int i = 0; i < IMAGES; i++) {
        image v = colmap_images[i];
        v.name = names[i];
        colmap_add_image(&f.images, &v);
    }
    colmap_write_project(ctx, project);
    colmap_write_model(project, "sparse/0/", &f, ".bin");
}

/* COLMAP was told of the project as the folder of the pictures. */
static void test_names_with_their_folder(void **state) {
    (void)state;
    static char names[IMAGES][32];
    sf_context *ctx = test_context();
    sf_scene *plain = test_load_scene(ctx, colmap_write_project(ctx, "short"), NULL);
    for (int i = 0; i < IMAGES; i++) snprintf(names[i], sizeof names[i], "images/%s", colmap_images[i].name);
    write_named(ctx, "long", names);
    sf_scene *named = test_load_scene(ctx, test_path("long"), NULL);
    assert_same(plain, named);
    assert_int_equal(test_scene_info(named).skipped_missing, 0);
    assert_string_equal(test_view_info(named, 0).name, "images/a.png");
    sf_scene_destroy(&plain);
    sf_scene_destroy(&named);
    sf_context_destroy(&ctx);
}

static void test_points_of_others(void **state) {
    (void)state;
    static const char ply[] =
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "end_header\n1 2 3 10 20 30\n-1 0 2 40 50 60\n";
    sf_context *ctx = test_context();
    float xyz[6];
    uint8_t rgb[6];
    colmap_write_project(ctx, "cloud");
    test_write(test_path_in("cloud", "sparse/0/points3D.ply"), ply, sizeof ply - 1);
    sf_scene *scene = test_load_scene(ctx, test_path("cloud"), NULL);
    assert_int_equal(test_scene_info(scene).points, POINTS); /* COLMAP's own come first */
    sf_scene_destroy(&scene);
    assert_int_equal(unlink(test_path_in("cloud", "sparse/0/points3D.bin")), 0);
    scene = test_load_scene(ctx, test_path("cloud"), NULL);
    assert_int_equal(sf_scene_get_points(scene, 0, 2, xyz, rgb), 2);
    assert_memory_equal(xyz, ((float[]){1, 2, 3, -1, 0, 2}), sizeof xyz);
    assert_memory_equal(rgb, ((uint8_t[]){10, 20, 30, 40, 50, 60}), sizeof rgb);
    sf_scene_destroy(&scene);
    assert_int_equal(unlink(test_path_in("cloud", "sparse/0/points3D.ply")), 0);
    test_log_clear();
    scene = test_load_scene(ctx, test_path("cloud"), NULL);
    colmap_assert_log("no points3D.bin, points3D.txt or points3D.ply");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* An image is two lines. Where the second is left out, every second image would be taken for it: 12 words are
 * 4 triples. */
static void test_second_lines_left_out(void **state) {
    (void)state;
    static const char images[] = "4 1 0 0 0 0 0 3 7 my photo c.png\n5 1 0 0 0 0 0 4 7 my photo a.png\n";
    sf_context *ctx = test_context();
    files f = colmap_text_files();
    colmap_write_pictures(ctx, "lines", "images", 1);
    colmap_write_model("lines", "", &f, ".txt");
    test_write(test_path_in("lines", "images.txt"), images, sizeof images - 1);
    colmap_assert_refused(ctx, test_path("lines"), SF_ERR_FORMAT,
                          "images.txt: line 2: observations: 12 words are not x, y, id each");
    sf_context_destroy(&ctx);
}

/* The pictures were converted or copied since: another ending, another case. */
static void test_names_with_another_ending(void **state) {
    (void)state;
    static char names[IMAGES][32];
    sf_context *ctx = test_context();
    sf_scene *plain = test_load_scene(ctx, colmap_write_project(ctx, "first"), NULL);
    for (int i = 0; i < IMAGES; i++) {
        const char *name = colmap_images[i].name;
        snprintf(names[i], sizeof names[i], "%.*s.TIF", (int)(strlen(name) - strlen(".png")), name);
        char *letter = names[i] + (strchr(names[i], '/') ? strcspn(names[i], "/") + 1 : 0);
        *letter = (char)toupper((unsigned char)*letter);
    }
    write_named(ctx, "later", names);
    sf_scene *later = test_load_scene(ctx, test_path("later"), NULL);
    assert_same(plain, later);
    assert_int_equal(test_scene_info(later).skipped_missing, 0);
    colmap_assert_log("pictures have another ending or another case on disk");
    assert_string_equal(test_view_info(later, 0).name, "A.TIF");
    sf_scene_destroy(&later);
    sf_scene_destroy(&plain);
    sf_context_destroy(&ctx);
}

/* What is said names what there is. */
static void test_pictures_elsewhere(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    files f = colmap_binary_files();
    colmap_write_project(ctx, "inria");
    assert_int_equal(rename(test_path_in("inria", "images"), test_path_in("inria", "input")), 0);
    colmap_assert_refused(ctx, test_path("inria"), SF_ERR_IO, "if it is 'input', add --images 'input'");
    options.images = "input";
    sf_scene *scene = test_load_scene(ctx, test_path("inria"), &options);
    assert_int_equal(test_scene_info(scene).views, IMAGES);
    sf_scene_destroy(&scene);
    /* ns-process-data's and INRIA's */
    colmap_make_folder(test_path_in("inria", "distorted"));
    assert_int_equal(rename(test_path_in("inria", "sparse"), test_path_in("inria", "distorted/sparse")), 0);
    colmap_assert_refused(ctx, test_path("inria"), SF_ERR_IO, "no project here, but in 'distorted': give '");
    colmap_assert_refused(ctx, test_path_in("inria", "distorted"), SF_ERR_IO, "add --images '../input'");
    options.images = "../input";
    scene = test_load_scene(ctx, test_path_in("inria", "distorted"), &options);
    assert_int_equal(test_scene_info(scene).views, IMAGES);
    sf_scene_destroy(&scene);
    assert_int_equal(rename(test_path_in("inria", "input"), test_path_in("inria", "images")), 0);
    colmap_assert_refused(ctx, test_path("inria"), SF_ERR_IO, "no project here, but cameras in 'distorted'");
    /* automatic_reconstructor's */
    colmap_make_folder(test_path("auto"));
    colmap_make_folder(test_path_in("auto", "sparse"));
    colmap_make_folder(test_path_in("auto", "dense"));
    colmap_write_model("auto", "sparse/", &f, ".bin");
    colmap_write_project(ctx, "auto/dense/0");
    colmap_assert_refused(ctx, test_path("auto"), SF_ERR_IO, "auto/dense/0' has one: give that instead");
    sf_context_destroy(&ctx);
}

/* The folder around a project, and pictures further down. */
static void test_folder_around(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    colmap_make_folder(test_path("around"));
    colmap_write_project(ctx, "around/b");
    colmap_write_project(ctx, "around/a 10");
    colmap_write_project(ctx, "around/a 9");
    colmap_assert_refused(ctx, test_path("around/"), SF_ERR_IO, "no project here, but in 'a 9': give '");
    assert_error_names(ctx, "around/a 9' instead");
    colmap_make_folder(test_path("scan"));
    colmap_make_folder(test_path("scan/keyframes"));
    colmap_write_pictures(ctx, "scan/keyframes", "images", 1);
    colmap_assert_refused(ctx, test_path("scan"), SF_ERR_IO,
                          "pictures in 'keyframes/images', but no cameras");
    assert_error_names(ctx, "scan.project'");
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rigs),
        cmocka_unit_test(test_names_with_their_folder),
        cmocka_unit_test(test_points_of_others),
        cmocka_unit_test(test_second_lines_left_out),
        cmocka_unit_test(test_names_with_another_ending),
        cmocka_unit_test(test_pictures_elsewhere),
        cmocka_unit_test(test_folder_around),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
