/* test_allocations.c - every allocation of each job of the library gives nothing in turn: the job says so,
 * leaves nothing behind, and done again it makes what it makes undisturbed.
 *
 * SPLATFIT_FULL=1 walks through all of them (make test-allocations); otherwise, of the jobs that take
 * longest, every few.
 */
#include "allocations_fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#ifdef SF_HAVE_LIBZIP
#include <zip.h>
#endif

#include "base/hash.h"

enum { PICTURES = 3, TEXT = 8192 };
#define SCENE "sim:studio?width=64&height=64&frames=9"

typedef struct job {
    const char *name;
    sf_status (*attempt)(world *w);
    int degrades; /* it may go on without what there was no memory for, and says so in the log */
    int every;    /* of its allocations, where not all are asked for */
} job;

/* Files. */

static void write_text(const char *name, const char *text) {
    char json[TEXT];
    size_t size = strlen(text);
    assert_true(size < sizeof json);
    for (size_t i = 0; i < size; i++) json[i] = text[i] == '\'' ? '"' : text[i];
    test_write(test_path(name), json, size);
}

static void write_pictures(sf_context *ctx, const char *folder) {
    float rgb[3 * WIDTH * HEIGHT];
    char name[256];
    mkdir(test_path(folder), 0777);
    for (int k = 0; k < PICTURES; k++) {
        uint8_t *file;
        size_t size;
        for (int i = 0; i < 3 * WIDTH * HEIGHT; i++) rgb[i] = (float)((i * (k + 3)) % 97) / 97;
        snprintf(name, sizeof name, "%s/%d.jpg", folder, k);
        assert_ok(ctx, sf_encode_jpeg(ctx, WIDTH, HEIGHT, rgb, 90, &file, &size));
        test_write(test_path(name), file, size);
        sf_encoded_free(ctx, &file);
    }
}

/* A COLMAP project of a camera that distorts. */
static void write_colmap(sf_context *ctx) {
    mkdir(test_path("colmap"), 0777);
    write_pictures(ctx, "colmap/images");
    write_text("colmap/cameras.txt", "1 OPENCV 24 16 20 21 12 8 0.05 0.01 0.001 0.001\n");
    write_text("colmap/images.txt", "1 1 0 0 0 0 0 4 1 0.jpg\n\n2 1 0 0 0 1 0 4 1 1.jpg\n\n"
                                    "3 1 0 0 0 2 0 4 1 2.jpg\n\n");
    write_text("colmap/points3D.txt", "1 0 0 0 9 8 7 0.1 1 0\n2 1 0 0 9 8 7 0.1 1 0\n");
}

static void put(uint8_t **at, const void *data, size_t size) {
    memcpy(*at, data, size);
    *at += size;
}

static void put_u64(uint8_t **at, uint64_t value) { put(at, &value, sizeof value); }
static void put_u32(uint8_t **at, uint32_t value) { put(at, &value, sizeof value); }

/* The same in its binary form, with a PINHOLE camera. */
static void write_binary_colmap(sf_context *ctx) {
    const double params[] = {20, 21, 12, 8}, point[3] = {0, 1, 0}, error = 0.1;
    uint8_t data[1024], *at = data;
    mkdir(test_path("binary"), 0777);
    write_pictures(ctx, "binary/images");
    put_u64(&at, 1), put_u32(&at, 7), put_u32(&at, 1), put_u64(&at, WIDTH), put_u64(&at, HEIGHT);
    put(&at, params, sizeof params);
    test_write(test_path("binary/cameras.bin"), data, (size_t)(at - data));
    at = data;
    put_u64(&at, PICTURES);
    for (uint32_t k = 0; k < PICTURES; k++) {
        const double pose[7] = {1, 0, 0, 0, k, 0, 4};
        char name[8] = "0.jpg";
        name[0] = (char)('0' + k);
        put_u32(&at, k + 1), put(&at, pose, sizeof pose), put_u32(&at, 7), put(&at, name, 6);
        put_u64(&at, 0);
    }
    test_write(test_path("binary/images.bin"), data, (size_t)(at - data));
    at = data;
    put_u64(&at, 1), put_u64(&at, 1), put(&at, point, sizeof point), put(&at, "\1\2\3", 3);
    put(&at, &error, sizeof error), put_u64(&at, 0);
    test_write(test_path("binary/points3D.bin"), data, (size_t)(at - data));
}

#define FRAME(name, x)                                                                                       \
    "{'file_path':'images/" name "','transform_matrix':[[1,0,0," x "],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}"

static void write_transforms(sf_context *ctx) {
    mkdir(test_path("transforms"), 0777);
    write_pictures(ctx, "transforms/images");
    write_text("transforms/points.ply", "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n"
                                        "property float y\nproperty float z\nend_header\n0 0 0\n1 1 1\n");
    write_text("transforms/transforms.json",
               "{'w':24,'h':16,'fl_x':20,'fl_y':21,'cx':12,'cy':8,'k1':0.05,'ply_file_path':'points.ply',"
               "'frames':[" FRAME("0.jpg", "0") "," FRAME("1.jpg", "1") "," FRAME("2.jpg", "2") "]}");
    write_text("transforms/held-out.txt", "1.jpg\n");
}

/* A fisheye's pictures, one of them with a mask. */
static void write_opensfm(sf_context *ctx) {
    float rgb[3 * WIDTH * HEIGHT] = {0};
    mkdir(test_path("opensfm"), 0777);
    write_pictures(ctx, "opensfm/images");
    mkdir(test_path("opensfm/masks"), 0777);
    assert_ok(ctx, sf_write_png(ctx, test_path("opensfm/masks/1.jpg.png"), WIDTH, HEIGHT, rgb));
    write_text(
        "opensfm/reconstruction.json",
        "[{'cameras':{'v':{'projection_type':'fisheye','width':24,'height':16,'focal':0.8,'k1':0,'k2':0}},"
        "'shots':{'0.jpg':{'rotation':[0,0,0],'translation':[0,0,4],'camera':'v'},"
        "'1.jpg':{'rotation':[0,0,0],'translation':[1,0,4],'camera':'v'},"
        "'2.jpg':{'rotation':[0,0,0],'translation':[2,0,4],'camera':'v'}},"
        "'points':{'1':{'coordinates':[0,0,0],'color':[9,8,7]}}}]");
}

/* The COLMAP project in an archive. */
static void write_archive(void) {
#ifdef SF_HAVE_LIBZIP
    static const char *const names[] = {"cameras.txt",  "images.txt",   "points3D.txt",
                                        "images/0.jpg", "images/1.jpg", "images/2.jpg"};
    zip_t *zip = zip_open(test_path("colmap.zip"), ZIP_CREATE | ZIP_TRUNCATE, NULL);
    assert_non_null(zip);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char path[64];
        snprintf(path, sizeof path, "colmap/%s", names[i]);
        assert_true(zip_file_add(zip, names[i], zip_source_file(zip, test_path(path), 0, -1), 0) >= 0);
    }
    assert_int_equal(zip_close(zip), 0);
    mkdir(test_path("unpacked"), 0777);
    assert_int_equal(setenv("TMPDIR", test_path("unpacked"), 1), 0);
#endif
}

/* Masks of two of its pictures, in a folder anywhere. */
static void write_masks(sf_context *ctx) {
    float rgb[3 * WIDTH * HEIGHT] = {1, 1, 1};
    mkdir(test_path("masks"), 0777);
    assert_ok(ctx, sf_write_png(ctx, test_path("masks/0.jpg.png"), WIDTH, HEIGHT, rgb));
    assert_ok(ctx, sf_write_png(ctx, test_path("masks/2.png"), WIDTH / 2, HEIGHT / 2, rgb));
}

/* Jobs: projects. */

static sf_status load_scene(world *w, const char *path, const sf_load_options *options) {
    sf_scene *scene;
    uint64_t fingerprint = 0;
    sf_status status = sf_scene_load(w->ctx, path, options, &scene);
    if (status) {
        assert_null(scene);
        return status;
    }
    status = sf_scene_fingerprint(scene, &fingerprint);
    allocations_note(w, &fingerprint, sizeof fingerprint);
    if (!status) status = sf_scene_save_cameras(scene, test_path("cameras.json"), 0);
    if (!status) allocations_note_file(w, test_path("cameras.json"));
    sf_scene_destroy(&scene);
    return status;
}

static sf_status load_colmap(world *w) { return load_scene(w, test_path("colmap"), NULL); }
static sf_status load_binary_colmap(world *w) { return load_scene(w, test_path("binary"), NULL); }
static sf_status load_studio(world *w) {
    return load_scene(w, "sim:studio?width=16&height=16&frames=3", NULL);
}

static sf_status load_opensfm(world *w) { return load_scene(w, test_path("opensfm"), NULL); }

/* What it was unpacked to is gone, too. */
static sf_status load_archive(world *w) {
#ifdef SF_HAVE_LIBZIP
    sf_status status = load_scene(w, test_path("colmap.zip"), NULL);
    assert_int_equal(test_count_entries(test_path("unpacked")), 0);
    return status;
#else
    return load_scene(w, test_path("colmap"), NULL);
#endif
}

static sf_status load_masks(world *w) {
    sf_load_options options = sf_load_options_default();
    options.masks = test_path("masks");
    return load_scene(w, test_path("colmap"), &options);
}

static sf_status load_cameras(world *w) {
    sf_camera *cameras;
    size_t count;
    sf_status status = sf_cameras_load(w->ctx, test_path("known.json"), &cameras, &count, NULL);
    if (status) assert_true(!cameras && !count);
    allocations_note(w, cameras, count * sizeof *cameras);
    sf_cameras_free(w->ctx, &cameras);
    return status;
}

static sf_status load_transforms(world *w) {
    sf_load_options options = sf_load_options_default();
    options.downscale = 2;
    options.test_list = test_path("transforms/held-out.txt");
    return load_scene(w, test_path("transforms"), &options);
}

/* Jobs: models. */

static sf_status convert(world *w, const char *name, const sf_model_file_options *options) {
    sf_model *read = NULL;
    const char *path = test_path(name);
    sf_status status = sf_model_save_as(w->model, path, options);
    if (!status) status = sf_model_load_as(w->ctx, path, options, &read);
    if (!status) status = sf_model_pack(read);
    if (!status) {
        allocations_note_file(w, path);
        status = allocations_note_model(w, read);
    }
    sf_model_destroy(&read);
    return status;
}

static sf_status convert_to(world *w, const char *name, int rub) {
    sf_model_file_options options = sf_model_file_options_default();
    if (rub) {
        options.spz_frame = SF_SPZ_FRAME_RUB;
        options.sh_bits[0] = 5, options.sh_bits[1] = 4;
    }
    return convert(w, name, &options);
}

static sf_status convert_ply(world *w) { return convert_to(w, "m.ply", 0); }
static sf_status convert_spz(world *w) { return convert_to(w, "m.spz", 0); }
static sf_status convert_spz_turned(world *w) { return convert_to(w, "t.spz", 1); }
static sf_status convert_splat(world *w) { return convert_to(w, "m.splat", 0); }

/* A copy, by a file: a failure leaves what was there. */
static sf_status move(world *w) {
    static const sf_similarity turned = {{0, -1, 0, 1, 0, 0, 0, 0, 1}, 2, {1, 2, 3}};
    const double low[3] = {-3, -3, 2}, high[3] = {6, 6, 5};
    sf_model *model = NULL;
    sf_model_bounds bounds = {0};
    sf_status status = sf_model_load(w->ctx, test_path("moved.ply"), &model);
    size_t count = status ? 0 : sf_model_count(model);
    if (!status) status = sf_model_transform(model, &turned);
    if (!status) {
        status = sf_model_crop(model, low, high);
        assert_true(status ? sf_model_count(model) == count : sf_model_count(model) < count);
    }
    if (!status) status = sf_model_get_bounds(model, &bounds);
    if (!status) status = allocations_note_model(w, model);
    allocations_note(w, &bounds, sizeof bounds);
    sf_model_destroy(&model);
    return status;
}

/* Jobs: pictures. */

static sf_status render(world *w) {
    static float rgb[SIDE * SIDE * 3], depth[SIDE * SIDE], target[SIDE * SIDE * 3], d_rgb[SIDE * SIDE * 3];
    double pose[6], background[3], focal[2];
    float *means = calloc(sf_model_count(w->model), 3 * sizeof *means);
    sf_view_info view;
    sf_renderer *renderer = NULL;
    sf_loss_value loss;
    sf_quality quality;
    sf_image_out out = {.rgb = rgb, .depth = depth};
    sf_render_grads grads = {
        .gaussians = {.means = means}, .pose = pose, .background = background, .focal = focal};
    assert_non_null(means);
    assert_ok(w->ctx, sf_scene_get_view(w->scene, 0, &view));
    assert_ok(w->ctx, sf_scene_get_pixels(w->scene, view.id, target, NULL));
    sf_status status = sf_renderer_create(w->ctx, &renderer);
    if (!status) status = sf_render(renderer, w->model, &view.camera, NULL, &out);
    if (!status)
        status = sf_loss(renderer, &(sf_image_pair){SIDE, SIDE, rgb, target, NULL}, 0.2, &loss, d_rgb);
    if (!status) status = sf_render_backward(renderer, w->model, d_rgb, &grads);
    if (!status) status = sf_compare(renderer, SIDE, SIDE, rgb, target, NULL, &quality);
    if (!status) status = sf_write_png(w->ctx, test_path("r.png"), SIDE, SIDE, rgb);
    if (!status) {
        allocations_note(w, rgb, sizeof rgb);
        allocations_note(w, means, 3 * sizeof *means * sf_model_count(w->model));
        allocations_note_file(w, test_path("r.png"));
    }
    sf_renderer_destroy(&renderer);
    free(means);
    return status;
}

/* The walk. */

static const job jobs[] = {
    {"colmap", load_colmap, 0, 1},
    {"binary colmap", load_binary_colmap, 0, 1},
    {"transforms", load_transforms, 0, 1},
    {"opensfm", load_opensfm, 0, 1},
    {"archive", load_archive, 0, 1},
    {"masks", load_masks, 0, 1},
    {"cameras.json", load_cameras, 0, 1},
    {"studio", load_studio, 0, 1},
    {"ply", convert_ply, 0, 1},
    {"spz", convert_spz, 0, 1},
    {"spz turned", convert_spz_turned, 0, 1},
    {"splat", convert_splat, 0, 1},
    {"transform, crop, bounds", move, 0, 1},
    {"render", render, 0, 1},
    {"video", allocations_write_video, 0, 1},
    {"folder of frames", allocations_read_folder, 0, 1},
    {"simulated frames", allocations_read_studio, 0, 1},
    {"remap", allocations_remap, 0, 1},
    {"board", allocations_write_board, 0, 5},
    {"fit, all stages", allocations_fit_all_stages, 1, 5},
    {"fit by error", allocations_fit_by_error, 1, 5},
    {"fit by relocation", allocations_fit_by_relocation, 1, 3},
    {"fit from a sweep", allocations_fit_from_sweep, 1, 19},
    {"fit by time", allocations_fit_by_time, 1, 7},
    {"checkpoint", allocations_resume, 1, 11},
    {"fitted cameras", allocations_save_fitted_cameras, 0, 3},
    {"prune", allocations_prune, 0, 23},
    {"prune to a number", allocations_prune_to, 0, 5},
};

/* Gaussians of all degrees in front of the cameras. */
static void make_model(world *w) {
    enum { GAUSSIANS = 24, COEFFICIENTS = 16 };
    static float means[GAUSSIANS][3], log_scales[GAUSSIANS][3], logits[GAUSSIANS],
        sh[GAUSSIANS][COEFFICIENTS][3];
    for (int i = 0; i < GAUSSIANS; i++) {
        logits[i] = (float)(i % 5) - 1;
        for (int k = 0; k < 3; k++) {
            means[i][k] = (float)((i * (5 + 2 * k)) % 11 - 5) / 4;
            log_scales[i][k] = -1.5f - 0.1f * (float)k;
            for (int c = 0; c < COEFFICIENTS; c++)
                sh[i][c][k] = c > i % 17 ? 0 : (float)((i + c * (k + 2)) % 7 - 3) / 9;
        }
    }
    sf_gaussians g = {.means = &means[0][0],
                      .log_scales = &log_scales[0][0],
                      .logit_opacities = logits,
                      .sh = &sh[0][0][0]};
    assert_ok(w->ctx, sf_model_create(w->ctx, GAUSSIANS, 3, &w->model));
    assert_ok(w->ctx, sf_model_set(w->model, 0, GAUSSIANS, &g));
}

static void keep_log(void *log_pointer, sf_log_level level, const char *message) {
    char *log = log_pointer;
    if (level == SF_LOG_WARNING && strstr(message, "out of memory")) snprintf(log, TEXT, "%s", message);
}

static char said[TEXT]; /* the last warning about memory */

static sf_allocator allocator;

static int open_world(void **state) {
    static world w;
    allocator = (sf_allocator){test_count_alloc, test_count_free, &w.memory};
    sf_context_options options = {.allocator = &allocator, .log = keep_log, .log_user = said, .threads = 1};
    assert_int_equal(sf_context_create(&w.ctx, &options), SF_OK);
    write_colmap(w.ctx);
    write_binary_colmap(w.ctx);
    write_transforms(w.ctx);
    write_opensfm(w.ctx);
    write_masks(w.ctx);
    write_archive();
    mkdir(test_path("video"), 0777);
    assert_ok(w.ctx, sf_scene_load(w.ctx, SCENE, NULL, &w.scene));
    assert_ok(w.ctx, sf_scene_save_cameras(w.scene, test_path("known.json"), 0));
    make_model(&w);
    assert_ok(w.ctx, sf_model_save(w.model, test_path("moved.ply")));
    *state = &w;
    return 0;
}

static int close_world(void **state) {
    world *w = *state;
    sf_model_destroy(&w->model);
    sf_scene_destroy(&w->scene);
    sf_context_destroy(&w->ctx);
    return w->memory.live != 0;
}

/* The job with allocation `at` of it failing (0: none); its status. */
static sf_status attempt(world *w, const job *j, long at) {
    long live = w->memory.live;
    said[0] = 0;
    w->result = 0;
    w->memory.fail_at = at ? w->memory.calls + at : 0;
    sf_status status = j->attempt(w);
    w->memory.fail_at = 0;
    if (w->memory.live != live)
        fail_msg("%s: allocation %ld leaves %ld blocks", j->name, at, w->memory.live - live);
    return status;
}

static void check_undisturbed(world *w, const job *j, uint64_t expected) {
    assert_ok(w->ctx, attempt(w, j, 0));
    if (w->result != expected) fail_msg("%s: not the same any more", j->name);
}

/* Without the block the job is not done; or it is done as well without; or worse, and says so. */
static void fail_one(world *w, const job *j, long at, uint64_t expected) {
    sf_status status = attempt(w, j, at);
    if (status == SF_ERR_MEMORY)
        assert_error_names(w->ctx, "out of memory");
    else if (status || (w->result != expected && !(j->degrades && said[0])))
        fail_msg("%s: allocation %ld: %s: %s", j->name, at, sf_status_text(status), sf_last_error(w->ctx));
}

static void walk(world *w, const job *j, long every) {
    assert_ok(w->ctx, attempt(w, j, 0));
    uint64_t expected = w->result;
    long before = w->memory.calls, failed = 0;
    check_undisturbed(w, j, expected);
    long calls = w->memory.calls - before;
    assert_true(calls > 0);
    for (long at = 1; at <= calls; at += every, failed++) {
        fail_one(w, j, at, expected);
        if (failed % 16 == 0) check_undisturbed(w, j, expected);
    }
    check_undisturbed(w, j, expected);
    print_message("%s: %ld of %ld allocations\n", j->name, failed, calls);
}

/* Started by cmocka with the world as its state, once a job: the next one. */
static void test_each_allocation_may_fail(void **state) {
    static size_t next;
    const job *j = &jobs[next++];
    long every = getenv("SPLATFIT_FULL") ? 1 : getenv("SPLATFIT_QUICK") ? 23 * j->every : j->every;
    walk(*state, j, every);
}

int main(void) {
    enum { JOBS = sizeof jobs / sizeof *jobs };
    struct CMUnitTest tests[JOBS];
    for (int i = 0; i < JOBS; i++)
        tests[i] = (struct CMUnitTest){.name = jobs[i].name, .test_func = test_each_allocation_may_fail};
    return cmocka_run_group_tests_name("allocations", tests, open_world, close_world);
}
