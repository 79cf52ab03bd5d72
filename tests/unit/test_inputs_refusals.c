/* test_inputs_refusals.c - projects that are refused by name, as src/io/README.md lists them; hostile
 * archives; and what lies under masks. */
#include "inputs_fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <zlib.h>

static void make_all_masks_black(const char *project, const char *rest) {
    (void)rest;
    inputs_make_black_masks(project, VIEWS);
}

static void make_cmyk(const char *p, const char *rest) { inputs_make_kind(p, CMYK_JPEG, rest); }

/* What is refused. */

typedef struct refusal {
    const char *name;
    void (*make)(const char *project, const char *how);
    const char *how;
    sf_status status;
    const char *part;
    const char *images, *masks;
    int sub_model; /* + 1 */
} refusal;

#define REFUSE(name_, make_, how_, status_, part_)                                                           \
    .name = name_, .make = make_, .how = how_, .status = status_, .part = part_

static const refusal refusals[] = {
    {REFUSE("no_model", inputs_make_colmap,
            "RAD_TAN_THIN_PRISM_FISHEYE 24 16 1 1 1 1 0 0 0 0 0 0 0 0 0 0 0 0", SF_ERR_UNSUPPORTED,
            "model RAD_TAN_THIN_PRISM_FISHEYE is not supported")},
    {REFUSE("no_such_model", inputs_make_colmap, "SIMPLE_DIVISION 24 16 1 1 1 1", SF_ERR_UNSUPPORTED,
            "model SIMPLE_DIVISION is not supported; colmap image_undistorter")},
    {REFUSE("no_panorama", inputs_make_ngp, "'camera_model':'EQUIRECTANGULAR',", SF_ERR_UNSUPPORTED,
            "camera_model: EQUIRECTANGULAR is not supported")},
    {REFUSE("no_field", inputs_make_ngp, "'camera_model':'FOV',", SF_ERR_UNSUPPORTED,
            "camera_model: FOV is not supported")},
    {REFUSE("no_ftheta", inputs_make_ngp, "'ftheta_p0':1,", SF_ERR_UNSUPPORTED,
            "camera_model: FTHETA is not supported")},
    {REFUSE("no_k5", inputs_make_ngp, "'k5':1,", SF_ERR_UNSUPPORTED, "k5: 1 is not supported")},
    {REFUSE("no_sphere", inputs_make_opensfm, "'projection_type':'spherical'", SF_ERR_UNSUPPORTED,
            "projection_type: spherical is not supported")},
    {REFUSE("no_dual", inputs_make_opensfm, "'projection_type':'dual'", SF_ERR_UNSUPPORTED,
            "projection_type: dual")},
    {REFUSE("no_focal", inputs_make_opensfm, "'k1':0", SF_ERR_FORMAT,
            "cameras[\"v2 x\"]: focal: is missing")},
    {REFUSE("no_number", inputs_make_opensfm, "'focal':'wide'", SF_ERR_FORMAT, "focal: is not a number")},
    {REFUSE("no_side", inputs_make_opensfm, "'width':2e9,'focal':1", SF_ERR_FORMAT,
            "width: is not a picture's side")},
    {REFUSE("turned_pictures", inputs_make_colmap, "PINHOLE 16 24 21 20 8.5 12.5", SF_ERR_EMPTY,
            "24 x 16 is not the camera's 16 x 24, nor its shape: turned, by EXIF?")},
    {REFUSE("cropped_pictures", inputs_make_colmap, "PINHOLE 24 20 21 20 12.5 8.5", SF_ERR_EMPTY,
            "24 x 16 is not the camera's 24 x 20, nor its shape: cropped?")},
    {REFUSE("no_cmyk", make_cmyk, ".jpg", SF_ERR_EMPTY, "3 lack a readable picture")},
    {REFUSE("no_images", inputs_make_colmap, inputs_pinhole, SF_ERR_IO, "absent: no such folder of pictures"),
     .images = "absent"},
    {REFUSE("no_masks", inputs_make_colmap, inputs_pinhole, SF_ERR_IO, "absent: no such folder of masks"),
     .masks = "absent"},
    {REFUSE("empty_masks", inputs_make_masked, "masks/%s-other.png", SF_ERR_IO,
            "no mask fits a picture: looked for a.png.png, a.png, a_mask.png"),
     .masks = "masks"},
    {REFUSE("black_masks", make_all_masks_black, "", SF_ERR_EMPTY,
            "training views has a pixel that counts: masks or transparency hide all")},
    {REFUSE("no_sub_model", inputs_make_several, "", SF_ERR_IO, "none of its 2 models is 7"), .sub_model = 8},
    {REFUSE("no_reconstruction", inputs_make_opensfm, "'focal':1", SF_ERR_IO,
            "none of its 2 reconstructions is 2"),
     .sub_model = 3},
};

static void test_refusals(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof refusals / sizeof *refusals; i++) {
        const refusal *r = &refusals[i];
        sf_scene *scene;
        sf_load_options options = sf_load_options_default();
        r->make(r->name, r->how);
        options.images = r->images;
        options.masks = r->masks;
        if (r->sub_model) options.sub_model = r->sub_model - 1;
        assert_status(ctx, sf_scene_load(ctx, test_path(r->name), &options, &scene), r->status);
        assert_null(scene);
        assert_error_names(ctx, r->part);
        assert_error_names(ctx, r->name);
    }
    assert_true(strstr(test_log, "JPEG: colours: ") != NULL);
    sf_context_destroy(&ctx);
}

static void test_options_out_of_range(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    inputs_make_colmap("range", inputs_pinhole);
    for (int i = 0; i < 3; i++) {
        static const char *const parts[] = {"sub_model: -2", "alpha: 4", "background: 1.5"};
        sf_load_options options = sf_load_options_default();
        if (i == 0) options.sub_model = -2;
        if (i == 1) options.alpha = (sf_alpha)4;
        if (i == 2) options.background[1] = 1.5f;
        assert_status(ctx, sf_scene_load(ctx, test_path("range"), &options, &scene), SF_ERR_ARGUMENT);
        assert_error_names(ctx, parts[i]);
    }
    sf_context_destroy(&ctx);
}

/* Hostile archives. */

static void refuse_archive(sf_context *ctx, archive *a, const char *part) {
    sf_scene *scene;
    inputs_put_archive(a, "bad.zip");
    int before = test_count_entries(test_path("tmp"));
    sf_status status = sf_scene_load(ctx, test_path("bad.zip"), NULL, &scene);
    assert_int_not_equal(status, SF_OK);
    assert_error_names(ctx, test_path("bad.zip"));
#ifdef SF_HAVE_LIBZIP
    assert_error_names(ctx, part);
#else
    (void)part;
    assert_error_names(ctx, "this build reads no .zip");
#endif
    assert_int_equal(test_count_entries(test_path("tmp")), before); /* nothing is left */
}

static void test_hostile_archives(void **state) {
    (void)state;
    static const struct {
        const char *name;
        size_t claimed;
        int method;
        unsigned attributes;
        const char *part;
    } cases[] = {
        {"../out.png", 4, 0, 0100644, "../out.png: leads out"},
        {"a/../../out.png", 4, 0, 0100644, "leads out"},
        {"/etc/out.png", 4, 0, 0100644, "leads out"},
        {"..\\out.png", 4, 0, 0100644, "leads out"},
        {"a.png", 0xfffffff0u, 8, 0100644, "a.png: size: is more than its packed bytes can hold"},
        {"a.png", 4, 0, 0120777, "holds no picture and no model"}, /* a link */
        {"a.exe", 4, 0, 0100755, "holds no picture and no model"},
        {"a.png", 4, 0, 0100644, "no project"},
    };
    sf_context *ctx = test_context();
    static archive a;
    mkdir(test_path("tmp"), 0777);
    assert_int_equal(setenv("TMPDIR", test_path("tmp"), 1), 0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        memset(&a, 0, sizeof a);
        inputs_add_entry(&a, cases[i].name, (const uint8_t *)"text", 4, cases[i].claimed, cases[i].method,
                         cases[i].attributes);
        refuse_archive(ctx, &a, cases[i].part);
    }
    memset(&a, 0, sizeof a);
    for (int i = 0; i < 2; i++) inputs_add_entry(&a, "a.png", (const uint8_t *)"text", 4, 4, 0, 0100644);
    refuse_archive(ctx, &a, "bad.zip");
    assert_int_equal(unsetenv("TMPDIR"), 0);
    sf_context_destroy(&ctx);
}

/* Many megabytes of nothing: possible for deflate, refused by the archive's size. */
static void test_bomb(void **state) {
    (void)state;
    enum { BLOCK = 1 << 20, BLOCKS = 64 };
    static archive a;
    static uint8_t zeros[BLOCK], packed[1 << 17];
    z_stream z = {.next_out = packed, .avail_out = sizeof packed};
    memset(&a, 0, sizeof a);
    mkdir(test_path("tmp"), 0777);
    assert_int_equal(deflateInit2(&z, 9, Z_DEFLATED, -15, 9, Z_DEFAULT_STRATEGY), Z_OK);
    for (int i = 0; i < BLOCKS; i++) {
        z.next_in = zeros;
        z.avail_in = BLOCK;
        assert_int_not_equal(deflate(&z, i == BLOCKS - 1 ? Z_FINISH : Z_NO_FLUSH), Z_STREAM_ERROR);
    }
    assert_true(z.total_out < 80000);
    inputs_add_entry(&a, "transforms.json", packed, z.total_out, (size_t)BLOCK * BLOCKS, 8, 0100644);
    deflateEnd(&z);
    sf_context *ctx = test_context();
    assert_int_equal(setenv("TMPDIR", test_path("tmp"), 1), 0);
    refuse_archive(ctx, &a, "64 MB unpacked are more than 100 times the file");
    assert_int_equal(unsetenv("TMPDIR"), 0);
    sf_context_destroy(&ctx);
}

/* What lies under a mask does not change the model by a bit. */
static void fit_masked(const char *project, float under) {
    sf_context *ctx = test_context();
    float rgb[3 * WIDTH * HEIGHT];
    inputs_make_masked(project, "masks/%s.png");
    for (int v = 0; v < VIEWS; v++) {
        char name[64];
        for (int i = 0; i < WIDTH * HEIGHT; i++)
            for (int c = 0; c < 3; c++) {
                int x = i % WIDTH, y = i / WIDTH, near = abs(x - PX) <= 2 && abs(y - PY) <= 2;
                rgb[3 * i + c] = near ? under : (float)inputs_shade(v, x, y, c) / 255;
            }
        snprintf(name, sizeof name, "images/%s.png", inputs_names[v]);
        assert_ok(ctx, sf_write_png(ctx, test_path_in(project, name), WIDTH, HEIGHT, rgb));
    }
    sf_scene *scene;
    sf_fitter *fitter;
    sf_model *model;
    sf_load_options load = sf_load_options_default();
    sf_fit_options options = sf_fit_options_default();
    load.hold_out = 0;
    options.steps = 20;
    options.init = SF_INIT_RANDOM;
    options.init_random = 200;
    assert_ok(ctx, sf_scene_load(ctx, test_path(project), &load, &scene));
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    char file[128];
    snprintf(file, sizeof file, "%s.ply", project);
    assert_ok(ctx, sf_model_save(model, test_path(file)));
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_content_under_a_mask(void **state) {
    (void)state;
    size_t first_size, second_size;
    fit_masked("under-black", 0);
    fit_masked("under-white", 1);
    uint8_t *first = test_read(test_path("under-black.ply"), &first_size),
            *second = test_read(test_path("under-white.ply"), &second_size);
    assert_true(first_size > 1000);
    assert_int_equal(first_size, second_size);
    assert_memory_equal(first, second, first_size);
    free(first);
    free(second);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_refusals),
        cmocka_unit_test(test_options_out_of_range),
        cmocka_unit_test(test_hostile_archives),
        cmocka_unit_test(test_bomb),
        cmocka_unit_test(test_content_under_a_mask),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
