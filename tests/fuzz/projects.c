/* projects.c - targets colmap, transforms, opensfm, zip, cameras, list: projects, their cameras and their
 * splits. */
#include <math.h>
#include <string.h>

#include "fuzz.h"
#include "io/dataset.h"
#include "io/paths.h"

/* A PNG of 4 x 3 pixels. */
static void put_picture(sf_context *ctx, const char *name) {
    static const float rgb[4 * 3 * 3] = {0.5f, [20] = 1};
    FUZZ_CHECK(!sf_write_png(ctx, fuzz_path(name), 4, 3, rgb), "%s: %s", name, sf_last_error(ctx));
}

static void put(const char *folder, const char *name, const sf_bytes *content) {
    char path[128];
    strcat(strcat(strcpy(path, folder), "/"), name);
    fuzz_file(path, content->data, content->size);
}

/* A project becomes a scene, whose cameras can be written and whose views can be copied. */
static int load(sf_context *ctx, const char *folder, int hold_out) {
    sf_load_options options = sf_load_options_default();
    sf_scene *scene;
    uint64_t fingerprint;
    options.hold_out = hold_out;
    int well = fuzz_went_well(ctx, sf_scene_load(ctx, folder, &options, &scene), folder);
    if (!well) return 0;
    FUZZ_CHECK(!sf_scene_save_cameras(scene, fuzz_path("again.json"), 0), "cameras: %s", sf_last_error(ctx));
    FUZZ_CHECK(!sf_scene_fingerprint(scene, &fingerprint), "fingerprint: %s", sf_last_error(ctx));
    sf_scene_destroy(&scene);
    return 1;
}

/* The first byte: which of the three files, parts of the input, are text. An image of 73 bytes becomes an
 * entry of a few hundred, with two names; what grows is held twice. */
int fuzz_colmap(const uint8_t *data, size_t size) {
    static const char folder[] = "colmap", model[] = "colmap/sparse";
    static const char *const names[] = {"cameras", "images", "points3D"};
    sf_bytes input = {.data = data, .size = size};
    sf_context *ctx = fuzz_begin(size, 1 << 20, 64);
    char pictures[] = "colmap/images/a.png";
    fuzz_subfolder(folder);
    fuzz_subfolder(model);
    fuzz_subfolder("colmap/images");
    fuzz_clear(model);
    if (!sf_is_file(fuzz_path(pictures))) put_picture(ctx, pictures);
    unsigned text = sf_bytes_u8(&input);
    for (int i = 0; i < 3; i++) {
        char name[32];
        sf_bytes part = i < 2 ? fuzz_part(&input) : fuzz_rest(&input);
        strcat(strcpy(name, names[i]), text >> i & 1 ? ".txt" : ".bin");
        put(model, name, &part);
    }
    int well = load(ctx, fuzz_path(folder), 0);
    fuzz_end();
    return well;
}

/* JSON takes up to 100 times its text: "{}," is an object of 250 bytes. */
int fuzz_transforms(const uint8_t *data, size_t size) {
    static const char folder[] = "transforms", points[] = "ply\nformat ascii 1.0\nelement vertex 1\n"
                                                          "property float x\nproperty float y\n"
                                                          "property float z\nend_header\n1 2 3\n";
    sf_bytes json = {.data = data, .size = size}, ply = {(const uint8_t *)points, sizeof points - 1, 0, 0};
    sf_context *ctx = fuzz_begin(size, 1 << 20, 128);
    fuzz_subfolder(folder);
    if (!sf_is_file(fuzz_path("transforms/a.png"))) {
        put_picture(ctx, "transforms/a.png");
        put_picture(ctx, "transforms/c.png");
        put(folder, "p.ply", &ply);
    }
    put(folder, "transforms.json", &json);
    int well = load(ctx, fuzz_path(folder), 8);
    fuzz_end();
    return well;
}

/* As JSON does. */
int fuzz_opensfm(const uint8_t *data, size_t size) {
    sf_bytes json = {.data = data, .size = size};
    sf_context *ctx = fuzz_begin(size, 1 << 20, 128);
    fuzz_subfolder("opensfm");
    fuzz_subfolder("opensfm/images");
    if (!sf_is_file(fuzz_path("opensfm/images/a.png"))) {
        put_picture(ctx, "opensfm/images/a.png");
        put_picture(ctx, "opensfm/images/c.png");
    }
    put("opensfm", "reconstruction.json", &json);
    int well = load(ctx, fuzz_path("opensfm"), 0);
    fuzz_end();
    return well;
}

/* What an archive unpacks to is bounded by its own size; of that what JSON and pictures take. */
int fuzz_zip(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, (size_t)1 << 28, 1 << 14);
    const char *path = fuzz_file("project.zip", data, size);
    int well = load(ctx, path, 0);
    fuzz_end();
    return well;
}

/* What a view of the camera is written as, read again. */
static void check_again(sf_context *ctx, const sf_camera *camera) {
    enum { MOST = 64 };
    static const uint8_t rgb[3 * MOST * MOST];
    const sf_pixels pixels = {.rgb = rgb, .stride = (size_t)3 * MOST};
    const char *path = fuzz_path("again.json");
    sf_scene *scene;
    sf_camera *again;
    size_t count;
    if (camera->width > MOST || camera->height > MOST) return;
    FUZZ_CHECK(!sf_scene_create(ctx, &scene), "scene: %s", sf_last_error(ctx));
    sf_status status = sf_scene_add_view(scene, NULL, camera, &pixels, SF_SPLIT_TRAIN, NULL);
    if (!status) {
        FUZZ_CHECK(!sf_scene_save_cameras(scene, path, 0), "cameras: %s", sf_last_error(ctx));
        FUZZ_CHECK(!sf_cameras_load(ctx, path, &again, &count, NULL), "again: %s", sf_last_error(ctx));
        FUZZ_CHECK(count == 1 && again->fx == camera->fx && again->width == camera->width,
                   "again: other cameras");
        sf_cameras_free(ctx, &again);
    }
    sf_scene_destroy(&scene);
}

/* As JSON does, and as many cameras as the list has entries, of which "1," is one. */
int fuzz_cameras(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, 1 << 20, 256);
    const char *path = fuzz_file("cameras.json", data, size);
    sf_camera *cameras;
    size_t count;
    int well = fuzz_went_well(ctx, sf_cameras_load(ctx, path, &cameras, &count, NULL), path);
    FUZZ_CHECK(well ? count > 0 : !cameras && !count, "cameras: %zu", count);
    for (size_t i = 0; i < count; i++) {
        double center[3];
        FUZZ_CHECK(!sf_camera_check(&cameras[i]), "camera %zu makes no sense", i);
        sf_camera_center(&cameras[i], center);
        FUZZ_CHECK(isfinite(center[0] + center[1] + center[2]), "camera %zu is nowhere", i);
    }
    if (well) check_again(ctx, cameras);
    sf_cameras_free(ctx, &cameras);
    fuzz_end();
    return well;
}

int fuzz_list(const uint8_t *data, size_t size) {
    static const char *const names[] = {"a.png", "b/a.png", "b/c.png"};
    sf_split splits[3];
    sf_context *ctx = fuzz_begin(size, 1 << 12, 2);
    sf_load_options options = sf_load_options_default();
    options.test_list = fuzz_file("list.txt", data, size);
    int well = fuzz_went_well(ctx, sf_split_names(ctx, &options, 3, names, splits), options.test_list);
    fuzz_end();
    return well;
}
