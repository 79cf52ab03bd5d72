/* test_sfm_inputs.c - a lens and masks that are given with photos; photos that no map can be made of, and
 * what is said of them. */
#include "testing.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "sfm/mask_folder.h"
#include "sfm/photos.h"

#include <splatfit/sfm.h>

#define STUDIO "sim:studio?width=320&height=240&frames=24"
enum { WIDTH = 320, HEIGHT = 240, VALUES = 3 * WIDTH * HEIGHT, PHOTOS = 5 };

static sf_context *context;
static sf_scene *studio; /* drawn once */
static float rgb[VALUES];

static void write_picture(const char *folder, const char *name) {
    char path[1024];
    mkdir(test_path(folder), 0777);
    snprintf(path, sizeof path, "%s/%s.png", test_path(folder), name);
    assert_ok(context, sf_write_png(context, path, WIDTH, HEIGHT, rgb));
}

/* Squares of 8 px at random: a place that no other picture shows. */
static void scatter(uint32_t seed) {
    enum { SQUARE = 8 };
    for (size_t y = 0; y < HEIGHT; y++)
        for (size_t x = 0; x < WIDTH; x++) {
            uint32_t v = (uint32_t)(y / SQUARE * WIDTH + x / SQUARE) * 2654435761u + seed * 40503u;
            v = (v ^ v >> 15) * 2246822519u;
            v = (v ^ v >> 13) * 3266489917u;
            for (size_t c = 0; c < 3; c++) rgb[3 * (y * WIDTH + x) + c] = (float)(v >> 24) / 255;
        }
}

/* Neighbours on the studio's path, or pictures of nothing. */
static const char *write_photos(const char *folder, char prefix, size_t count, int elsewhere) {
    for (size_t i = 0; i < count; i++) {
        char name[16];
        assert_ok(context, sf_scene_get_pixels(studio, test_view_info(studio, i).id, rgb, NULL));
        if (elsewhere) scatter((uint32_t)i + 1);
        snprintf(name, sizeof name, "%c%zu", prefix, i);
        write_picture(folder, name);
    }
    return test_path(folder);
}

static void assert_refused(const char *folder, const sf_sfm_options *options, sf_status status,
                           const char *part) {
    sf_reconstruction *r;
    assert_status(context, sf_sfm_run(context, folder, options, &r), status);
    assert_null(r);
    assert_error_names(context, part);
}

static void touch(const char *name) {
    FILE *f = fopen(test_path(name), "w");
    assert_non_null(f);
    assert_int_equal(fclose(f), 0);
}

/* Photos in folders of a folder: a rig's cameras, albums. Masks, hidden folders and other projects are no
 * photos. */
static void test_folders(void **state) {
    (void)state;
    static const char *const folders[] = {"nested",       "nested/left", "nested/left/day",
                                          "nested/masks", "nested/.old", "nested/project",
                                          "both",         "both/more"};
    static const char *const files[] = {"nested/left/b.PNG",
                                        "nested/left/day/a.jpg",
                                        "nested/masks/b.png",
                                        "nested/.old/x.jpg",
                                        "nested/left/notes.txt",
                                        "nested/project/p.jpg",
                                        "nested/project/transforms.json"};
    sf_photo_list list;
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) mkdir(test_path(folders[i]), 0777);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) touch(files[i]);
    assert_int_equal(sf_sfm_find_photos(test_path("nested")), SF_PHOTOS_HERE);
    assert_ok(context, sf_photos_list(context, test_path("nested"), &list));
    assert_int_equal(list.count, 2);
    assert_string_equal(list.photos[0].name, "left/b.PNG");
    assert_string_equal(list.photos[1].name, "left/day/a.jpg");
    sf_photos_free(context, &list);
    /* where the folder has photos itself, these alone */
    touch("both/IMG_10.jpg"), touch("both/IMG_9.jpeg"), touch("both/more/3.jpg");
    assert_ok(context, sf_photos_list(context, test_path("both"), &list));
    assert_int_equal(list.count, 2);
    assert_string_equal(list.photos[0].name, "IMG_9.jpeg"); /* as they were taken */
    sf_photos_free(context, &list);
}

static void set_time(const char *name, time_t at) {
    const struct timespec times[2] = {{.tv_sec = at}, {.tv_sec = at}};
    assert_int_equal(utimensat(AT_FDCWD, test_path(name), times, 0), 0);
}

/* Photos that are written, and folders that get or lose some. */
static void test_changes(void **state) {
    (void)state;
    mkdir(test_path("changed"), 0777), mkdir(test_path("changed/in"), 0777);
    assert_int_equal(sf_sfm_photos_changed(test_path("changed")), 0);
    touch("changed/in/1.jpg"), touch("changed/in/2.jpg"), touch("changed/notes");
    set_time("changed/in/1.jpg", 1000), set_time("changed/in/2.jpg", 3000), set_time("changed/in", 2000);
    set_time("changed/notes", 9000);
    assert_int_equal(sf_sfm_photos_changed(test_path("changed")), 3000);
    set_time("changed/in", 4000);
    assert_int_equal(sf_sfm_photos_changed(test_path("changed")), 4000);
}

/* What phones and raw converters write, and what is to be done with it. */
static void test_other_kinds(void **state) {
    (void)state;
    sf_scene *scene;
    mkdir(test_path("phone"), 0777);
    touch("phone/1.HEIC"), touch("phone/2.heic"), touch("phone/3.dng");
    assert_refused(test_path("phone"), NULL, SF_ERR_EMPTY, "2 .heic files");
    assert_error_names(context, "mogrify -format jpg '*.heic'");
    assert_status(context, sf_scene_load(context, test_path("phone"), NULL, &scene), SF_ERR_IO);
    assert_error_names(context, "2 .heic files");
}

/* Two folders of photos without EXIF are of two cameras. */
static void test_rig(void **state) {
    (void)state;
    char folder[1024];
    sf_reconstruction *r;
    sf_reconstruction_photo photos[2 * PHOTOS];
    mkdir(test_path("rig"), 0777);
    write_photos("rig/left", 'a', PHOTOS, 0);
    write_photos("rig/right", 'a', PHOTOS, 0);
    snprintf(folder, sizeof folder, "%s", test_path("rig"));
    assert_ok(context, sf_sfm_run(context, folder, NULL, &r));
    for (size_t i = 0; i < 2 * PHOTOS; i++) {
        assert_int_equal(sf_reconstruction_get_photo(r, i, &photos[i]), SF_OK);
        assert_int_equal(photos[i].camera == photos[0].camera, i < PHOTOS);
    }
    assert_string_equal(photos[PHOTOS].name, "right/a0.png");
    sf_reconstruction_destroy(&r);
}

/* A lens stays as it is, and is for photos of its size. */
static void test_lens(void **state) {
    (void)state;
    char folder[1024];
    sf_lens lens = {.fx = 343, .fy = 344, .cx = 161, .cy = 119, .k1 = 0.001, .k3 = 0.002};
    sf_sfm_options o = sf_sfm_options_default();
    sf_reconstruction *r;
    sf_reconstruction_photo photo;
    snprintf(folder, sizeof folder, "%s", write_photos("lens", 'a', PHOTOS, 0));
    o.lens = &lens, o.lens_width = WIDTH, o.lens_height = HEIGHT;
    assert_ok(context, sf_sfm_run(context, folder, &o, &r));
    for (size_t i = 0; i < PHOTOS; i++) {
        assert_int_equal(sf_reconstruction_get_photo(r, i, &photo), SF_OK);
        assert_true(photo.placed);
        assert_memory_equal(&photo.lens, &lens, sizeof lens);
    }
    assert_ok(context, sf_reconstruction_save_colmap(r, folder));
    sf_calibration again;
    char path[1100];
    snprintf(path, sizeof path, "%s/cameras.bin", folder);
    assert_ok(context, sf_calibration_load(context, path, &again));
    assert_memory_equal(&again.lens, &lens, sizeof lens);
    sf_reconstruction_destroy(&r);
    o.lens_width = 640, o.lens_height = 480;
    assert_refused(folder, &o, SF_ERR_ARGUMENT, "a0.png: size: 320 x 240 is not the lens's 640 x 480");
    o.lens_width = o.lens_height = 0, lens.fy = 0;
    assert_refused(folder, &o, SF_ERR_ARGUMENT, "lens: fx, fy");
}

/* Nothing is found where a mask is black; the photo without one counts as a whole. */
static void test_masks(void **state) {
    (void)state;
    char folder[1024];
    sf_photo_list list;
    sf_features_options options = sf_features_options_default();
    snprintf(folder, sizeof folder, "%s", write_photos("masked", 'a', 2, 0));
    for (size_t i = 0; i < VALUES; i++) rgb[i] = i / 3 % WIDTH < WIDTH / 2 ? 0 : 1;
    mkdir(test_path("masked/masks"), 0777);
    assert_ok(context, sf_write_png(context, test_path("masked/masks/a1.png.png"), WIDTH, HEIGHT, rgb));
    assert_ok(context, sf_photos_list(context, folder, &list));
    assert_ok(context, sf_photo_masks_find(context, folder, NULL, &list));
    assert_non_null(list.masks);
    assert_ok(context, sf_photos_find_features(context, folder, 160, &options, NULL, NULL, &list));
    size_t left[2] = {0};
    for (size_t i = 0; i < 2; i++)
        for (size_t k = 0; k < list.photos[i].features.count; k++)
            left[i] += list.photos[i].features.points[k].x < WIDTH / 2;
    assert_true(left[0] > 20 && list.photos[1].features.count > 20);
    assert_int_equal(left[1], 0);
    sf_photos_free(context, &list);
    sf_sfm_options o = sf_sfm_options_default();
    o.masks = test_path("nowhere");
    assert_refused(folder, &o, SF_ERR_IO, "nowhere: no folder with a mask of a photo");
}

static void test_reasons(void **state) {
    (void)state;
    sf_reconstruction *r;
    sf_reconstruction_photo photo;
    char folder[1024];
    snprintf(folder, sizeof folder, "%s", write_photos("reasons", 'a', PHOTOS, 0));
    write_photos("reasons", 'z', 2, 1);
    for (size_t i = 0; i < VALUES; i++) rgb[i] = 0.5f;
    write_picture("reasons", "y");
    assert_ok(context, sf_sfm_run(context, folder, NULL, &r));
    for (size_t i = 0; i < PHOTOS + 3; i++) {
        assert_int_equal(sf_reconstruction_get_photo(r, i, &photo), SF_OK);
        assert_int_equal(photo.placed, i < PHOTOS);
        if (i == PHOTOS) test_assert_contains(photo.why, "too few features", __FILE__, __LINE__);
        if (i > PHOTOS) test_assert_contains(photo.why, "overlap", __FILE__, __LINE__);
    }
    sf_reconstruction_destroy(&r);
}

static void test_none(void **state) {
    (void)state;
    for (size_t i = 0; i < VALUES; i++) rgb[i] = 0.5f;
    write_picture("grey", "a");
    write_picture("grey", "b");
    assert_refused(test_path("grey"), NULL, SF_ERR_EMPTY, "too few features, 0 in the median");
    write_photos("same", 'a', 1, 0);
    write_photos("same", 'b', 1, 0);
    assert_refused(test_path("same"), NULL, SF_ERR_EMPTY, "or did not move");
    write_photos("apart", 'a', 1, 0);
    write_photos("apart", 'b', 1, 1);
    assert_refused(test_path("apart"), NULL, SF_ERR_EMPTY, "no two photos show the same things");
}

static int set_up(void **state) {
    (void)state;
    context = test_context();
    studio = test_load_scene(context, STUDIO, NULL);
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    sf_scene_destroy(&studio);
    sf_context_destroy(&context);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_folders), cmocka_unit_test(test_changes), cmocka_unit_test(test_other_kinds),
        cmocka_unit_test(test_rig),     cmocka_unit_test(test_lens),    cmocka_unit_test(test_masks),
        cmocka_unit_test(test_reasons), cmocka_unit_test(test_none),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
