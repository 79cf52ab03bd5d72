/* test_colmap_skips.c - what of a COLMAP project is left out with a warning: views, cameras, points. */
#include "colmap_fixture.h"

#include <math.h>
#include <string.h>
#include <turbojpeg.h>
#include <unistd.h>

static void test_missing_pictures(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "missing");
    assert_int_equal(unlink(test_path_in("missing", "images/b.png")), 0);
    test_write(test_path_in("missing", "images/c.png"), "some text", 9);
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, test_path("missing"), NULL);
    assert_int_equal(test_scene_info(scene).views, 2);
    assert_int_equal(test_scene_info(scene).skipped_missing, 2);
    colmap_assert_log("images/b.png: skipped: No such file");
    colmap_assert_log("images/c.png: skipped: is neither a JPEG nor a PNG");
    colmap_assert_log("2 of 4 pictures skipped");
    sf_scene_destroy(&scene);
    assert_int_equal(unlink(test_path_in("missing", "images/a.png")), 0);
    assert_int_equal(unlink(test_path_in("missing", "images/sub/a 1.png")), 0);
    colmap_assert_refused(ctx, test_path("missing"), SF_ERR_EMPTY, "4 lack a readable picture");
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
    colmap_write_project(ctx, "poses");
    for (size_t k = 0; k < sizeof bad / sizeof *bad; k++) {
        files f = colmap_binary_files();
        f.images.size = 8;
        for (int i = 0; i < IMAGES; i++) {
            image v = colmap_images[i];
            if (i < 2) memcpy(v.q, bad[k], sizeof v.q);
            if (i < 2) memcpy(v.t, bad[k] + 4, sizeof v.t);
            colmap_add_image(&f.images, &v);
        }
        colmap_write_model("poses", "sparse/0/", &f, ".bin");
        test_log_clear();
        sf_scene *scene = test_load_scene(ctx, test_path("poses"), NULL);
        assert_int_equal(test_scene_info(scene).views, 2);
        assert_int_equal(test_scene_info(scene).skipped_pose, 2);
        colmap_assert_log("2 of 4 views skipped: pose or intrinsics not usable (first: ");
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_lenses_that_are_none(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "lenses");
    static const double bad[] = {NAN, 0, -20, INFINITY};
    for (size_t k = 0; k < 4; k++) {
        files f = colmap_binary_files();
        f.cameras.size = 8;
        for (int i = 0; i < CAMERAS; i++) {
            camera c = colmap_cameras[i];
            if (i == 0) c.parameter[0] = bad[k];
            colmap_add_camera(&f.cameras, &c);
        }
        colmap_write_model("lenses", "sparse/0/", &f, ".bin");
        sf_scene *scene = test_load_scene(ctx, test_path("lenses"), NULL);
        assert_int_equal(test_scene_info(scene).skipped_pose, 2);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_points_that_are_none(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = colmap_binary_files();
    const double bad[3] = {1e39, NAN, -INFINITY};
    colmap_write_project(ctx, "points");
    colmap_add_uint(&f.points, 77, 8);
    colmap_add_doubles(&f.points, bad, 3);
    colmap_add_uint(&f.points, 0, 3);
    colmap_add_doubles(&f.points, bad, 1);
    colmap_add_uint(&f.points, 0, 8);
    f.points.data[0]++;
    colmap_write_model("points", "sparse/0/", &f, ".bin");
    sf_scene *scene = test_load_scene(ctx, test_path("points"), NULL);
    assert_int_equal(test_scene_info(scene).points, POINTS);
    assert_int_equal(test_scene_info(scene).skipped_points, 1);
    sf_scene_destroy(&scene);
    assert_int_equal(unlink(test_path_in("points", "sparse/0/points3D.bin")), 0);
    test_log_clear();
    scene = test_load_scene(ctx, test_path("points"), NULL);
    assert_int_equal(test_scene_info(scene).points, 0);
    colmap_assert_log("no points3D.bin");
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
    colmap_write_project(ctx, "turned");
    write_turned(test_path_in("turned", "images/a.png")); /* told by its content */
    write_turned(test_path_in("turned", "images/c.png"));
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, test_path("turned"), NULL);
    assert_int_equal(test_view_info(scene, 0).camera.width, WIDTH);
    colmap_assert_log("2 pictures carry an EXIF orientation");
    assert_null(strstr(strstr(test_log, "EXIF") + 1, "EXIF"));
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_missing_pictures),         cmocka_unit_test(test_poses_that_are_none),
        cmocka_unit_test(test_lenses_that_are_none),     cmocka_unit_test(test_points_that_are_none),
        cmocka_unit_test(test_orientation_is_said_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
