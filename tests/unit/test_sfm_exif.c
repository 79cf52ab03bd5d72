/* test_sfm_exif.c - what photos tell of their cameras: the focal length, which the pictures can overrule, and
 * which photos one camera took. */
#include "exif_fixture.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/linear.h"
#include "sfm/exif.h"

#include <splatfit/sfm.h>

#define STUDIO "sim:studio?width=320&height=240&frames=24"
enum { WIDTH = 320, HEIGHT = 240, VALUES = 3 * WIDTH * HEIGHT, PHOTOS = 10 };

static sf_context *studio_context;
static sf_scene *studio; /* drawn once */

#ifdef SF_HAVE_LIBEXIF

static sf_exif reread(sf_context *ctx, exif_wish wish) {
    static const float grey[3 * 16 * 16];
    sf_exif exif;
    write_exif_jpeg(ctx, test_path("told.jpg"), 16, 16, grey, &wish);
    sf_exif_read(test_path("told.jpg"), &exif);
    return exif;
}

static void test_tags(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_exif e = reread(ctx, (exif_wish){"Make er ", " Model\n1", 5.4, 250.5, 28, 4000, 3000, 1});
    assert_string_equal(e.make, "Make er");
    assert_string_equal(e.model, "Model1");
    assert_float_equal(e.focal_mm, 5.4, 1e-9);
    assert_float_equal(e.pixels_per_mm, 250.5, 1e-9);
    assert_float_equal(e.focal_35, 28, 1e-9);
    assert_int_equal(e.width, 4000);
    assert_int_equal(e.height, 3000);
    e = reread(ctx, (exif_wish){.focal_mm = 50});
    assert_string_equal(e.make, "");
    assert_float_equal(e.focal_35, 0, 0);
    assert_int_equal(e.width, 0);
    test_write(test_path("none.png"), "\x89PNG\r\n\x1a\n", 8);
    sf_exif_read(test_path("none.png"), &e);
    assert_float_equal(e.focal_mm, 0, 0);
    sf_exif_read(test_path("nowhere.jpg"), &e);
    assert_float_equal(e.focal_mm, 0, 0);
    sf_context_destroy(&ctx);
}

#endif

/* The parts of a focal length are known from how cameras are built: a diagonal of 43.27 mm. */
static void test_lengths(void **state) {
    (void)state;
    const sf_exif phone = {.focal_35 = 26, .width = 4000, .height = 3000},
                  camera = {.focal_35 = 24, .width = 6000, .height = 3376},
                  sensor = {.focal_mm = 4.5,
                            .pixels_per_mm = 650,
                            .focal_35 = 26,
                            .width = 4000,
                            .height = 3000},
                  reduced = {.focal_mm = 4.5, .pixels_per_mm = 1300, .focal_35 = 26}, mm = {.focal_mm = 50};
    const double diagonal = 43.2666;
    assert_float_equal(sf_exif_focal(&phone, 4000, 3000), 26 / diagonal * 5000, 1);
    assert_float_equal(sf_exif_focal(&phone, 3000, 4000), 26 / diagonal * 5000, 1);
    assert_float_equal(sf_exif_focal(&phone, 1000, 750), 26 / diagonal * 1250, 1);
    assert_float_equal(sf_exif_focal(&phone, 3000, 3000), 26 / diagonal * 5000, 1); /* cut, not reduced */
    assert_float_equal(sf_exif_focal(&phone, 2000, 2000), 0, 0); /* both: nothing is known */
    assert_float_equal(sf_exif_focal(&camera, 6000, 3376), 24.0 / 36 * 6000, 100);
    assert_float_equal(sf_exif_focal(&sensor, 4000, 3000), 2925, 1e-6);
    assert_float_equal(sf_exif_focal(&reduced, 4000, 3000), 26 / diagonal * 5000, 1);
    assert_float_equal(sf_exif_focal(&mm, 4000, 3000), 0, 0);
    sf_exif other = phone;
    assert_true(sf_exif_is_same(&phone, &other));
    other.width = 3000, other.height = 4000;
    assert_true(sf_exif_is_same(&phone, &other));
    other.focal_35 = 27;
    assert_false(sf_exif_is_same(&phone, &other));
    other = phone;
    strcpy(other.model, "another");
    assert_false(sf_exif_is_same(&phone, &other));
}

/* A quarter turn of a picture: the pixel x, y goes to y, width - 1 - x. */
static void turn(const float *rgb, float *turned) {
    for (size_t y = 0; y < HEIGHT; y++)
        for (size_t x = 0; x < WIDTH; x++)
            memcpy(turned + 3 * ((WIDTH - 1 - x) * HEIGHT + y), rgb + 3 * (y * WIDTH + x), 3 * sizeof *rgb);
}

/* Photos of the studio; every third one is on its side if `turns`. Returns the true focal length. */
static double write_photos(sf_context *ctx, const char *folder, const exif_wish *wishes, size_t kinds,
                           int turns) {
    static float rgb[VALUES], turned[VALUES];
    char path[1024];
    mkdir(test_path(folder), 0777);
    for (size_t i = 0; i < PHOTOS; i++) {
        assert_ok(ctx, sf_scene_get_pixels(studio, test_view_info(studio, i).id, rgb, NULL));
        snprintf(path, sizeof path, "%s/%02zu.jpg", test_path(folder), i);
        if (turns && i % 3 == 2) {
            turn(rgb, turned);
            write_exif_jpeg(ctx, path, HEIGHT, WIDTH, turned, &wishes[i % kinds]);
        } else {
            write_exif_jpeg(ctx, path, WIDTH, HEIGHT, rgb, &wishes[i % kinds]);
        }
    }
    return test_view_info(studio, 0).camera.fx;
}

static sf_reconstruction *reconstruct(sf_context *ctx, const char *folder) {
    sf_reconstruction *r;
    sf_reconstruction_info info;
    assert_ok(ctx, sf_sfm_run(ctx, test_path(folder), NULL, &r));
    sf_reconstruction_get_info(r, &info);
    assert_int_equal(info.placed, PHOTOS);
    return r;
}

/* Pixels that are stored mirrored are named; those that are stored turned are of another pose. */
static void test_mirrored(void **state) {
    (void)state;
    static const unsigned mirrored[] = {2, 4, 5, 7};
    sf_context *ctx = test_context();
    exif_wish wishes[PHOTOS] = {{.make = NULL}};
    sf_reconstruction *r;
    sf_reconstruction_photo photo;
    for (size_t i = 0; i < 4; i++) wishes[i].orientation = mirrored[i];
    wishes[4].orientation = 3;
    write_photos(ctx, "mirrored", wishes, PHOTOS, 0);
    assert_ok(ctx, sf_sfm_run(ctx, test_path("mirrored"), NULL, &r));
    for (size_t i = 0; i < PHOTOS; i++) {
        char part[64];
        assert_int_equal(sf_reconstruction_get_photo(r, i, &photo), SF_OK);
        assert_int_equal(photo.placed, i >= 4);
        if (i >= 4) continue;
        snprintf(part, sizeof part, "EXIF orientation: %u says that it is mirrored", mirrored[i]);
        test_assert_contains(photo.why, part, __FILE__, __LINE__);
    }
    sf_reconstruction_destroy(&r);
    sf_context_destroy(&ctx);
}

/* How far a photo's focal length is from the truth, as a part of it. */
static double error_of(const sf_reconstruction *r, size_t index, double truth) {
    sf_reconstruction_photo photo;
    assert_int_equal(sf_reconstruction_get_photo(r, index, &photo), SF_OK);
    return fabs(photo.lens.fx / truth - 1);
}

/* A third of the photos on their side: all have one focal length, and stand where they stood. */
static void test_turned(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const exif_wish nothing = {0};
    double focal = write_photos(ctx, "turned", &nothing, 1, 1), far = 0;
    sf_reconstruction *r = reconstruct(ctx, "turned");
    sf_reconstruction_photo photo, first;
    mkdir(test_path("project"), 0777);
    assert_ok(ctx, sf_reconstruction_save_colmap(r, test_path("project")));
    assert_int_equal(symlink(test_path("turned"), test_path_in("project", "images")), 0);
    sf_scene *scene = test_load_scene(ctx, test_path("project"), NULL);
    sf_reconstruction_get_photo(r, 0, &first);
    sf_view_info true_first = test_view_info(studio, 0);
    for (size_t i = 0; i < PHOTOS; i++) {
        double back[9], here[9], there[9], trace = 0;
        sf_view_info view = test_view_info(scene, i), is = test_view_info(studio, i);
        assert_int_equal(sf_reconstruction_get_photo(r, i, &photo), SF_OK);
        assert_float_equal(photo.lens.fx, first.lens.fx, 0);
        assert_float_equal(photo.lens.cx, photo.width / 2.0, 0);
        assert_int_equal(view.camera.width, i % 3 == 2 ? HEIGHT : WIDTH);
        for (int k = 0; k < 9; k++) assert_float_equal(view.camera.R_cw[k], photo.R_cw[k], 1e-6);
        /* A picture that was turned shows x as -y, and y as x. */
        double *R = photo.R_cw;
        for (int k = 0; k < 3 && i % 3 == 2; k++) {
            double x = R[k];
            R[k] = -R[3 + k], R[3 + k] = x;
        }
        for (int k = 0; k < 9; k++) back[k] = first.R_cw[3 * (k % 3) + k / 3];
        sf_mat3_mul(R, back, here);
        for (int k = 0; k < 9; k++) back[k] = true_first.camera.R_cw[3 * (k % 3) + k / 3];
        sf_mat3_mul(is.camera.R_cw, back, there);
        for (int k = 0; k < 9; k++) trace += here[k] * there[k];
        far = fmax(far, acos(fmin((trace - 1) / 2, 1)) * 57.29577951308232);
    }
    assert_true(far < 0.5);
    assert_true(error_of(r, 0, focal) < 0.02);
    sf_scene_destroy(&scene);
    sf_reconstruction_destroy(&r);
    sf_context_destroy(&ctx);
}

#ifdef SF_HAVE_LIBEXIF

/* What is told is overruled where it is wrong, as after a crop that the file does not tell. */
static void test_overruled(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const double factors[] = {0.6, 1, 1.8};
    for (size_t i = 0; i < (test_is_quick() ? 1 : sizeof factors / sizeof *factors); i++) {
        char folder[16];
        exif_wish wish = {.focal_mm = 1000, .make = "Maker"};
        snprintf(folder, sizeof folder, "told%zu", i);
        wish.pixels_per_mm = factors[i] * 343 / 1000;
        double focal = write_photos(ctx, folder, &wish, 1, 0);
        sf_reconstruction *r = reconstruct(ctx, folder);
        assert_true(error_of(r, 0, focal) < 0.02);
        sf_reconstruction_destroy(&r);
    }
    sf_context_destroy(&ctx);
}

/* Three cameras, one without a focal length, one with a wrong one. */
static void test_mixed(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const exif_wish wishes[] = {
        {.make = "Maker", .model = "Model one", .focal_mm = 1000, .pixels_per_mm = 0.343},
        {.make = "Maker", .model = "Model two"},
        {.make = "Maker", .model = "Model two", .focal_mm = 2000, .pixels_per_mm = 0.343}};
    double focal = write_photos(ctx, "mixed", wishes, 3, 0);
    sf_reconstruction *r = reconstruct(ctx, "mixed");
    sf_reconstruction_photo a, b;
    for (size_t i = 0; i < 3; i++) {
        assert_true(error_of(r, i, focal) < 0.03);
        sf_reconstruction_get_photo(r, i, &a);
        sf_reconstruction_get_photo(r, i + 3, &b);
        assert_float_equal(a.lens.fx, b.lens.fx, 0);
        sf_reconstruction_get_photo(r, i + 1, &b);
        assert_true(a.lens.fx != b.lens.fx);
    }
    sf_reconstruction_destroy(&r);
    sf_context_destroy(&ctx);
}

#endif

static int set_up(void **state) {
    (void)state;
    studio_context = test_context();
    studio = test_load_scene(studio_context, STUDIO, NULL);
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    sf_scene_destroy(&studio);
    sf_context_destroy(&studio_context);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mirrored), cmocka_unit_test(test_lengths),   cmocka_unit_test(test_turned),
#ifdef SF_HAVE_LIBEXIF
        cmocka_unit_test(test_tags),     cmocka_unit_test(test_overruled), cmocka_unit_test(test_mixed),
#endif
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
