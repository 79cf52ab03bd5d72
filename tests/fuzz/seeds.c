/* seeds.c - inputs that are right, by our own writers, for the formats that are not text. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <zlib.h>

#include "fuzz.h"

static const char *folder;

/* An input, and the part of a target's own in front of it. */
static void put(const char *target, const char *name, const void *front, size_t front_size, const void *data,
                size_t size) {
    char path[600];
    snprintf(path, sizeof path, "%s/%s", folder, target);
    mkdir(path, 0777);
    snprintf(path, sizeof path, "%s/%s/%s", folder, target, name);
    FILE *file = fopen(path, "wb");
    FUZZ_CHECK(file, "%s: cannot be opened", path);
    size_t done = fwrite(front, 1, front_size, file) + (size ? fwrite(data, 1, size, file) : 0);
    FUZZ_CHECK(!fclose(file) && done == front_size + size, "%s: cannot be written", path);
}

static uint8_t *read_file(const char *path, size_t *size) {
    enum { MOST = 1 << 20 };
    uint8_t *data = malloc(MOST);
    FILE *file = fopen(path, "rb");
    FUZZ_CHECK(data && file, "%s: cannot be read", path);
    *size = fread(data, 1, MOST, file);
    fclose(file);
    return data;
}

static void put_file(const char *target, const char *name, const void *front, size_t front_size,
                     const char *path) {
    size_t size;
    uint8_t *data = read_file(path, &size);
    put(target, name, front, front_size, data, size);
    free(data);
}

/* Models. */

static sf_model *make_model(sf_context *ctx, int degree) {
    enum { COUNT = 3 };
    float means[3 * COUNT] = {0, 0, 1, 0.5f, 0, 0, -0.5f, 0.25f, 2}, scales[3 * COUNT],
                    opacities[COUNT] = {1, 2, -1};
    float quats[4 * COUNT] = {1, 0, 0, 0, 0.5f, 0.5f, -0.5f, 0.5f, 0, 1, 0, 0}, sh[3 * 16 * COUNT];
    for (int i = 0; i < 3 * COUNT; i++) scales[i] = -1 - 0.25f * (float)(i % 5);
    for (int i = 0; i < 3 * 16 * COUNT; i++) sh[i] = 0.125f * (float)(i % 7 - 3);
    const sf_gaussians from = {means, quats, scales, opacities, sh};
    sf_model *model;
    FUZZ_CHECK(!sf_model_create(ctx, COUNT, degree, &model) && !sf_model_set(model, 0, COUNT, &from),
               "model: %s", sf_last_error(ctx));
    return model;
}

static size_t unpack(const char *path, uint8_t *to, size_t room) {
    gzFile file = gzopen(path, "rb");
    int got = file ? gzread(file, to, (unsigned)room) : -1;
    FUZZ_CHECK(got > 0, "%s: cannot be read", path);
    gzclose(file);
    return (size_t)got;
}

static void put_models(sf_context *ctx) {
    static const char sog_meta[] =
        "{\"means\":{\"shape\":[3,3],\"mins\":[0,0,0],\"maxs\":[1,1,1],\"files\":[\"0\",\"1\"]},"
        "\"scales\":{\"mins\":[-5,-5,-5],\"maxs\":[0,0,0],\"files\":[\"2\"]},\"quats\":{\"files\":[\"3\"]},"
        "\"sh0\":{\"mins\":[0,0,0,-2],\"maxs\":[1,1,1,3],\"files\":[\"4\"]}}";
    const char *ply = fuzz_path("seed.ply"), *spz = fuzz_path("seed.spz"), *splat = fuzz_path("seed.splat"),
               *glb = fuzz_path("seed.glb"), *sog = fuzz_path("seed.sog");
    uint8_t unpacked[4096];
    size_t size;
    static const char packed[] =
        "ply\nformat ascii 1.0\nelement chunk 1\nproperty float min_x\nproperty float max_x\n"
        "property float min_y\nproperty float max_y\nproperty float min_z\nproperty float max_z\n"
        "property float min_scale_x\nproperty float max_scale_x\nproperty float min_scale_y\n"
        "property float max_scale_y\nproperty float min_scale_z\nproperty float max_scale_z\n"
        "element vertex 1\nproperty uint packed_position\nproperty uint packed_rotation\n"
        "property uint packed_scale\nproperty uint packed_color\nelement sh 1\nproperty uchar f_rest_0\n"
        "property uchar f_rest_1\nproperty uchar f_rest_2\nproperty uchar f_rest_3\nproperty uchar f_rest_4\n"
        "property uchar f_rest_5\nproperty uchar f_rest_6\nproperty uchar f_rest_7\nproperty uchar f_rest_8\n"
        "end_header\n-1 1 -1 1 3 4 -3 -2 -3 -2 -3 -2\n1 2 3 4\n1 2 3 4 5 6 7 8 9\n";
    put("sog", "meta", "\7", 1, sog_meta, sizeof sog_meta - 1);
    put("ply", "packed", "", 0, packed, sizeof packed - 1);
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree += 3) {
        sf_model *model = make_model(ctx, degree);
        char name[16];
        snprintf(name, sizeof name, "degree%d", degree);
        FUZZ_CHECK(!sf_model_save(model, ply) && !sf_model_save(model, spz) && !sf_model_save(model, splat) &&
                       !sf_model_save(model, glb),
                   "save: %s", sf_last_error(ctx));
        put_file("ply", name, "", 0, ply);
        put_file("spz", name, "", 1, spz);
        size = unpack(spz, unpacked, sizeof unpacked);
        put("spz", degree ? "unpacked3" : "unpacked0", "\1", 1, unpacked, size);
        put_file("splat", name, "", 0, splat);
        put_file("gltf", name, "", 0, glb);
        if (!sf_model_save(model, sog)) put_file("sog", name, "\377", 1, sog); /* where libwebp is there */
        sf_model_destroy(&model);
    }
}

/* Pictures and streams. */

enum { WIDTH = 16, HEIGHT = 12 };

static void make_pixels(float rgb[3 * WIDTH * HEIGHT], int turn) {
    for (int i = 0; i < 3 * WIDTH * HEIGHT; i++) rgb[i] = 0.5f + 0.5f * sinf(0.37f * (float)(i + 11 * turn));
}

/* A JPEG's first segments: "A camera", 6.5 mm, 28 mm on film, 400 x 300 px. */
static void put_exif(void) {
#ifdef SF_HAVE_LIBEXIF
    static const char exif[] = "\xff\xd8\xff\xe1\0\x80"
                               "Exif\0\0II*\0\x08\0\0\0"
                               "\2\0\x0f\1\2\0\x09\0\0\0\x5e\0\0\0\x69\x87\4\0\1\0\0\0\x26\0\0\0\0\0\0\0"
                               "\4\0\x0a\x92\5\0\1\0\0\0\x68\0\0\0\2\xa0\4\0\1\0\0\0\x90\1\0\0"
                               "\3\xa0\3\0\1\0\0\0\x2c\1\0\0\5\xa4\3\0\1\0\0\0\x1c\0\0\0\0\0\0\0"
                               "\0\0A camera\0\0\x41\0\0\0\x0a\0\0\0\0\0\0\0\0\0\0\0\xff\xd9";
    put("exif", "told", exif, sizeof exif - 1, "", 0);
#endif
}

static void put_pictures(sf_context *ctx) {
    static const char y4m[] =
        "YUV4MPEG2 W2 H2 F30:1 Ip A1:1 C420jpeg XCOLORRANGE=FULL\nFRAME\n123456FRAME\nabcdef";
    float rgb[3 * WIDTH * HEIGHT];
    uint8_t *png, *jpeg, pair[8192];
    size_t png_size, jpeg_size;
    make_pixels(rgb, 0);
    FUZZ_CHECK(!sf_encode_png(ctx, WIDTH, HEIGHT, rgb, &png, &png_size) &&
                   !sf_encode_jpeg(ctx, WIDTH, HEIGHT, rgb, 75, &jpeg, &jpeg_size),
               "pictures: %s", sf_last_error(ctx));
    FUZZ_CHECK(2 * jpeg_size + 1 <= sizeof pair, "the JPEG is too long");
    put("picture", "png", png, png_size, "", 0);
    put("picture", "jpeg", jpeg, jpeg_size, "", 0);
    put("jpeg_cut", "one", jpeg, jpeg_size, "", 0);
    memcpy(pair, jpeg, jpeg_size);
    pair[jpeg_size] = 'x';
    memcpy(pair + jpeg_size + 1, jpeg, jpeg_size);
    put("jpeg_cut", "two", pair, 2 * jpeg_size + 1, "", 0);
    put("pipe", "jpegs", "", 1, pair, 2 * jpeg_size + 1);
    put("pipe", "y4m", "", 1, y4m, sizeof y4m - 1);
    for (int format = 1; format <= SF_PIXEL_FORMATS; format++) {
        const uint8_t front[] = {(uint8_t)(format % SF_PIXEL_FORMATS + 16 * format), 3, 2};
        char name[16];
        snprintf(name, sizeof name, "format%d", format);
        if (front[0] % (SF_PIXEL_FORMATS + 1) < SF_PIXEL_MJPEG)
            put("pipe", name, front, sizeof front, pair, 40);
    }
    sf_encoded_free(ctx, &png);
    sf_encoded_free(ctx, &jpeg);
}

/* Fits. */

sf_scene *fuzz_scene(sf_context *ctx) {
    static const double turns[] = {-0.2, 0, 0.2};
    sf_scene *scene;
    FUZZ_CHECK(!sf_scene_create(ctx, &scene), "scene: %s", sf_last_error(ctx));
    for (int v = 0; v < 3; v++) {
        float rgb[3 * WIDTH * HEIGHT];
        uint8_t bytes[3 * WIDTH * HEIGHT];
        double c = cos(turns[v]), s = sin(turns[v]);
        const sf_camera camera = {.width = WIDTH,
                                  .height = HEIGHT,
                                  .fx = 12,
                                  .fy = 12,
                                  .cx = WIDTH / 2.0,
                                  .cy = HEIGHT / 2.0,
                                  .R_cw = {c, 0, s, 0, 1, 0, -s, 0, c},
                                  .t_cw = {0, 0, 3}};
        const sf_pixels pixels = {.rgb = bytes, .stride = 3 * WIDTH};
        make_pixels(rgb, v);
        for (int i = 0; i < 3 * WIDTH * HEIGHT; i++) bytes[i] = (uint8_t)(255 * rgb[i]);
        FUZZ_CHECK(!sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL), "view: %s",
                   sf_last_error(ctx));
    }
    return scene;
}

static void put_checkpoint(sf_context *ctx, const char *name, const char *const (*settings)[2]) {
    sf_scene *scene = fuzz_scene(ctx);
    sf_fit_options options = sf_fit_options_default();
    sf_fitter *fitter;
    const char *path = fuzz_path("seed.fit");
    for (; (*settings)[0]; settings++)
        FUZZ_CHECK(!sf_fit_options_set(ctx, &options, (*settings)[0], (*settings)[1]), "%s",
                   sf_last_error(ctx));
    FUZZ_CHECK(!sf_fitter_create(ctx, scene, NULL, &options, &fitter), "fitter: %s", sf_last_error(ctx));
    for (int i = 0; i < 8; i++) FUZZ_CHECK(!sf_fitter_step(fitter), "step: %s", sf_last_error(ctx));
    FUZZ_CHECK(!sf_fitter_save(fitter, path), "save: %s", sf_last_error(ctx));
    put_file("checkpoint", name, "", 0, path);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
}

#define COMMON                                                                                               \
    {"steps", "20"}, {"max_gaussians", "24"}, {"init_random", "12"}, {"init", "random"}, {                   \
        "densify_every", "3"                                                                                 \
    }

static void put_checkpoints(sf_context *ctx) {
    static const char *const plain[][2] = {COMMON, {"validate", "3"}, {"background", "auto"}, {NULL, NULL}};
    static const char *const learning[][2] = {COMMON,
                                              {"validate", "0"},
                                              {"exposure", "1"},
                                              {"refine_poses", "1"},
                                              {"refine_intrinsics", "1"},
                                              {"refine_start", "0"},
                                              {"moments", "half"},
                                              {"densify", "error"},
                                              {"error_views", "2"},
                                              {NULL, NULL}};
    put_checkpoint(ctx, "plain", plain);
    put_checkpoint(ctx, "learning", learning);
}

/* COLMAP's three binary files. */

typedef struct file {
    size_t size;
    uint8_t data[1024];
} file;

static void put_uint(file *f, uint64_t value, int bytes) {
    for (int b = 0; b < bytes; b++) f->data[f->size++] = (uint8_t)(value >> (8 * b));
}

static void put_real(file *f, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_uint(f, bits, 8);
}

static void put_part(file *f, const file *part) {
    put_uint(f, part->size, 2);
    memcpy(f->data + f->size, part->data, part->size);
    f->size += part->size;
}

static void put_colmap(void) {
    const double opencv[] = {4, 4, 2, 1.5, 0.1, -0.01, 0.001, 0.002}, pose[] = {1, 0, 0.1, 0, 0, 0, 3};
    file cameras = {0}, images = {0}, all = {0};
    put_uint(&cameras, 1, 8);
    put_uint(&cameras, 7, 4); /* id, model OPENCV, size */
    put_uint(&cameras, 4, 4);
    put_uint(&cameras, 4, 8);
    put_uint(&cameras, 3, 8);
    for (int i = 0; i < 8; i++) put_real(&cameras, opencv[i]);
    put_uint(&images, 2, 8);
    for (unsigned v = 0; v < 2; v++) {
        put_uint(&images, v + 1, 4);
        for (int i = 0; i < 7; i++) put_real(&images, pose[i]);
        put_uint(&images, 7, 4);
        memcpy(images.data + images.size, v ? "a.png" : "0.png", 6);
        images.size += 6;
        put_uint(&images, v, 8);
        for (unsigned i = 0; i < 3 * v; i++) put_uint(&images, 0, 8); /* x, y, point */
    }
    put_uint(&all, 0, 1);
    put_part(&all, &cameras);
    put_part(&all, &images);
    put_uint(&all, 1, 8); /* a point: id, place, colour, error, a track of one */
    put_uint(&all, 1, 8);
    for (int i = 0; i < 3; i++) put_real(&all, i);
    put_uint(&all, 0xff8000, 3);
    put_real(&all, 0.5);
    put_uint(&all, 1, 8);
    put_uint(&all, 0, 8);
    put("colmap", "binary", all.data, all.size, "", 0);
}

/* An archive of one stored file. */
static void put_zip(void) {
    static const char
        name[] = "transforms.json",
        json[] = "{\"w\":4,\"h\":3,\"fl_x\":4,\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":"
                 "[[1,0,0,0],[0,1,0,0],[0,0,1,3],[0,0,0,1]]}]}";
    static const float rgb[4 * 3 * 3] = {0.5f};
    sf_context *ctx = fuzz_begin(0, 1 << 20, 0);
    const char *path = fuzz_path("a.png");
    FUZZ_CHECK(!sf_write_png(ctx, path, 4, 3, rgb), "%s", sf_last_error(ctx));
    size_t png_size;
    uint8_t *png = read_file(path, &png_size);
    const struct {
        const char *name;
        const uint8_t *data;
        size_t size;
    } entries[] = {{name, (const uint8_t *)json, sizeof json - 1}, {"a.png", png, png_size}};
    file all = {0}, directory = {0};
    for (int i = 0; i < 2; i++) {
        uint32_t crc = (uint32_t)crc32(0, entries[i].data, (unsigned)entries[i].size);
        size_t at = all.size;
        for (int central = 0; central < 2; central++) {
            file *f = central ? &directory : &all;
            put_uint(f, central ? 0x02014b50 : 0x04034b50, 4);
            if (central) put_uint(f, 20, 2);
            put_uint(f, 20, 2); /* version; then flags, stored, time, date */
            put_uint(f, 0, 4);
            put_uint(f, 0x210000, 4);
            put_uint(f, crc, 4);
            put_uint(f, entries[i].size, 4);
            put_uint(f, entries[i].size, 4);
            put_uint(f, strlen(entries[i].name), 2);
            put_uint(f, 0, central ? 8 : 2); /* extra; comment, disk, attributes inside */
            if (central) put_uint(f, 0, 4);
            if (central) put_uint(f, at, 4);
            memcpy(f->data + f->size, entries[i].name, strlen(entries[i].name));
            f->size += strlen(entries[i].name);
        }
        memcpy(all.data + all.size, entries[i].data, entries[i].size);
        all.size += entries[i].size;
    }
    size_t at = all.size;
    memcpy(all.data + all.size, directory.data, directory.size);
    all.size += directory.size;
    put_uint(&all, 0x06054b50, 4);
    put_uint(&all, 0, 4);
    put_uint(&all, 2, 2);
    put_uint(&all, 2, 2);
    put_uint(&all, directory.size, 4);
    put_uint(&all, at, 4);
    put_uint(&all, 0, 2);
    put("zip", "stored", all.data, all.size, "", 0);
    free(png);
    fuzz_end();
}

/* A log's recipe: of the empty scene, limited by time. */
static void put_replay(sf_context *ctx) {
    char text[16384], value[64];
    uint64_t fingerprint;
    sf_scene *scene;
    sf_option_info info;
    sf_fit_options options = sf_fit_options_default();
    options.time_limit = 5;
    FUZZ_CHECK(!sf_scene_create(ctx, &scene) && !sf_scene_fingerprint(scene, &fingerprint), "scene: %s",
               sf_last_error(ctx));
    size_t used = (size_t)snprintf(text, sizeof text,
                                   "{\"version\": \"%s\", \"isa\": \"%s\", \"gone_on\": false,\n"
                                   " \"scene\": {\"fingerprint\": \"%016" PRIx64 "\"},\n"
                                   " \"plan\": {\"ticks\": %d, \"steps\": 4, \"deltas\": \"5 7*2 100\"},\n"
                                   " \"options\": {",
                                   sf_version(), sf_context_isa(ctx), fingerprint, (int)SF_PLAN_TICKS);
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        sf_fit_options_get(&options, info.name, value, sizeof value);
        const char *quote = info.kind == SF_KIND_ENUM ? "\"" : "";
        used += (size_t)snprintf(text + used, sizeof text - used, "%s\"%s\": %s%s%s", i ? ", " : "",
                                 info.name, quote, value, quote);
    }
    used += (size_t)snprintf(text + used, sizeof text - used, "}}\n");
    put("replay", "plan", text, used, "", 0);
    sf_scene_destroy(&scene);
}

void fuzz_write_seeds(const char *to) {
    folder = to;
    mkdir(folder, 0777);
    sf_context *ctx = fuzz_begin(0, (size_t)1 << 30, 0);
    put_models(ctx);
    put_exif();
    put_pictures(ctx);
    put_checkpoints(ctx);
    put_colmap();
    put_replay(ctx);
    fuzz_end();
#ifdef SF_HAVE_LIBZIP
    put_zip();
#endif
}
