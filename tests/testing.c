/* testing.c - see testing.h. */
#define _GNU_SOURCE
#include "testing.h"

#include <dirent.h>
#include <errno.h>
#include <ftw.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

char test_log[65536];
static pthread_mutex_t log_lock = PTHREAD_MUTEX_INITIALIZER;
static char folder[256];

void test_log_clear(void) { test_log[0] = 0; }

static void keep(void *user, sf_log_level level, const char *message) {
    (void)user, (void)level;
    pthread_mutex_lock(&log_lock);
    size_t used = strlen(test_log);
    snprintf(test_log + used, sizeof test_log - used, "%s\n", message);
    pthread_mutex_unlock(&log_lock);
}

sf_context *test_context_threads(int threads) {
    sf_context *ctx = NULL;
    sf_context_options options = {.log = keep, .threads = threads};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    return ctx;
}

sf_context *test_context(void) { return test_context_threads(2); }

size_t test_runner(char **command, size_t limit) {
    static char words[4096];
    size_t n = 0;
    snprintf(words, sizeof words, "%s", getenv("RUN") ? getenv("RUN") : "");
    for (char *word = strtok(words, " "); word && n < limit; word = strtok(NULL, " ")) command[n++] = word;
    return n;
}

void *test_count_alloc(void *allocations, size_t size) {
    test_allocations *a = allocations;
    if (atomic_fetch_add(&a->calls, 1) + 1 == a->fail_at) return NULL;
    void *block = malloc(size ? size : 1);
    if (block) atomic_fetch_add(&a->live, 1);
    return block;
}

void test_count_free(void *allocations, void *block) {
    test_allocations *a = allocations;
    assert_non_null(block);
    atomic_fetch_sub(&a->live, 1);
    free(block);
}

void *test_refuse_alloc(void *countdown, size_t size) {
    return (*(long *)countdown)-- == 0 ? NULL : malloc(size);
}

void test_refuse_free(void *countdown, void *block) {
    (void)countdown;
    free(block);
}

void test_assert_status(const sf_context *ctx, sf_status got, sf_status expected, const char *call,
                        const char *file, int line) {
    if (got == expected) return;
    print_error("%s:%d: %s gave \"%s\", not \"%s\"; last error: %s\n", file, line, call, sf_status_text(got),
                sf_status_text(expected), ctx ? sf_last_error(ctx) : "(no context)");
    fail();
}

void test_assert_between(uintmax_t value, uintmax_t least, uintmax_t most, const char *text, const char *file,
                         int line) {
    if (value >= least && value <= most) return;
    print_error("%s is %ju, not in %ju..%ju\n", text, value, least, most);
    _fail(file, line);
}

void test_assert_contains(const char *text, const char *part, const char *file, int line) {
    if (strstr(text, part)) return;
    print_error("%s:%d: \"%s\" does not name \"%s\"\n", file, line, text, part);
    fail();
}

static int remove_entry(const char *path, const struct stat *st, int type, struct FTW *ftw) {
    (void)st, (void)type, (void)ftw;
    return remove(path);
}

static void remove_folder(void) { nftw(folder, remove_entry, 16, FTW_DEPTH | FTW_PHYS); }

const char *test_folder(void) {
    if (folder[0]) return folder;
    const char *base = getenv("TMPDIR");
    snprintf(folder, sizeof folder, "%s/splatfit-test-XXXXXX", base && *base ? base : "/tmp");
    assert_non_null(mkdtemp(folder));
    atexit(remove_folder);
    return folder;
}

const char *test_path(const char *name) {
    static _Thread_local char buffers[16][1024];
    static _Thread_local unsigned turn;
    char *path = buffers[turn++ % 16];
    snprintf(path, sizeof buffers[0], "%s/%s", test_folder(), name);
    return path;
}

const char *test_path_in(const char *inside, const char *name) {
    char path[512];
    snprintf(path, sizeof path, "%s/%s", inside, name);
    return test_path(path);
}

void test_write(const char *path, const void *data, size_t size) {
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(data, 1, size, f), size);
    assert_int_equal(fclose(f), 0);
}

uint8_t *test_read(const char *path, size_t *size) {
    FILE *f = fopen(path, "rb");
    if (!f) fail_msg("%s: %s", path, strerror(errno));
    size_t used = 0, room = 1 << 16, got;
    uint8_t *data = malloc(room);
    assert_non_null(data);
    while ((got = fread(data + used, 1, room - used - 1, f)) > 0) {
        used += got;
        if (used + 1 == room) assert_non_null(data = realloc(data, room *= 2));
    }
    fclose(f);
    data[used] = 0;
    *size = used;
    return data;
}

int test_exists(const char *path) { return access(path, F_OK) == 0; }

int test_count_entries(const char *path) {
    DIR *d = opendir(path);
    if (!d) return -1;
    int n = 0;
    for (struct dirent *e; (e = readdir(d));) n += strcmp(e->d_name, ".") && strcmp(e->d_name, "..");
    closedir(d);
    return n;
}

const char *test_data(void) {
    const char *path = getenv("SPLATFIT_DATA");
    if (!path || !*path) test_skip("SPLATFIT_DATA is not set: no real scenes here");
    return path;
}

int test_is_quick(void) {
    const char *quick = getenv("SPLATFIT_QUICK");
    return quick && *quick && strcmp(quick, "0");
}

void test_skip(const char *reason) {
    print_message("skipped: %s\n", reason);
    skip();
}

int test_is_emulated(void) { return getenv("SPLATFIT_EMULATED") != NULL; }

void test_skip_emulated(void) {
    if (test_is_emulated())
        test_skip("this is the same on every machine, and takes long where it is emulated");
}

json_t *test_json(const char *path) {
    json_error_t error;
    json_t *json = json_load_file(path, JSON_REJECT_DUPLICATES, &error);
    if (!json) fail_msg("%s: line %d: %s", path, error.line, error.text);
    return json;
}

double test_number(const json_t *object, const char *key) {
    const json_t *value = json_object_get(object, key);
    if (!json_is_number(value)) fail_msg("%s: not a number", key);
    return json_number_value(value);
}

void test_pause_ms(long ms) { nanosleep(&(struct timespec){ms / 1000, ms % 1000 * 1000000}, NULL); }

static sf_quality quality_of_view(sf_renderer *renderer, sf_context *ctx, sf_scene *scene, sf_fitter *fitter,
                                  sf_view_info view) {
    size_t pixels = (size_t)view.camera.width * (size_t)view.camera.height;
    float *truth = malloc(3 * pixels * sizeof *truth), *drawn = malloc(3 * pixels * sizeof *drawn);
    assert_true(truth && drawn);
    sf_quality quality;
    sf_image_out out = {.rgb = drawn};
    assert_ok(ctx, sf_scene_get_pixels(scene, view.id, truth, NULL));
    assert_ok(ctx, sf_fitter_get_camera(fitter, view.id, &view.camera));
    assert_ok(ctx, sf_fitter_render(fitter, &view.camera, &out));
    assert_ok(ctx, sf_compare(renderer, view.camera.width, view.camera.height, drawn, truth, NULL, &quality));
    free(truth);
    free(drawn);
    return quality;
}

sf_quality test_quality(sf_context *ctx, sf_scene *scene, sf_fitter *fitter, sf_split split) {
    sf_quality mean = {0};
    sf_renderer *renderer;
    sf_scene_info info;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    sf_scene_get_info(scene, &info);
    size_t count = split == SF_SPLIT_TEST ? info.test_views : info.train_views;
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info view;
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        if (view.split != split) continue;
        sf_quality quality = quality_of_view(renderer, ctx, scene, fitter, view);
        mean.psnr += quality.psnr / (double)count;
        mean.ssim += quality.ssim / (double)count;
        mean.psnr_corrected += quality.psnr_corrected / (double)count;
    }
    sf_renderer_destroy(&renderer);
    return mean;
}

sf_quality test_held_out(sf_context *ctx, sf_scene *scene, sf_fitter *fitter) {
    return test_quality(ctx, scene, fitter, SF_SPLIT_TEST);
}

void test_thin_out(sf_context *ctx, sf_scene *scene, size_t wanted) {
    sf_scene_info info;
    sf_view_info view;
    sf_scene_get_info(scene, &info);
    size_t have = info.train_views, next = 0;
    for (size_t i = 0, number = 0; !sf_scene_get_view(scene, i, &view);) {
        int stays = view.split == SF_SPLIT_TEST;
        if (!stays && number++ == (2 * next + 1) * have / (2 * wanted)) next++, stays = 1;
        if (stays)
            i++;
        else
            assert_ok(ctx, sf_scene_remove_view(scene, view.id));
    }
    sf_scene_get_info(scene, &info);
    assert_int_equal(info.train_views, wanted);
}

static void copy_points(sf_context *ctx, sf_scene *from, sf_scene *to) {
    sf_scene_info info;
    sf_scene_get_info(from, &info);
    float *xyz = malloc((info.points + 1) * 3 * sizeof *xyz);
    uint8_t *rgb = malloc((info.points + 1) * 3);
    assert_true(xyz && rgb);
    assert_int_equal(sf_scene_get_points(from, 0, info.points, xyz, rgb), info.points);
    assert_ok(ctx, sf_scene_add_points(to, info.points, xyz, rgb));
    free(xyz);
    free(rgb);
}

static uint32_t copy_view(sf_context *ctx, sf_scene *from, const sf_view_info *view, sf_scene *to,
                          size_t number, test_change change, void *user) {
    uint32_t id;
    size_t values = 3 * (size_t)view->camera.width * (size_t)view->camera.height;
    float *rgb = malloc(values * sizeof *rgb);
    uint8_t *bytes = malloc(values);
    sf_camera camera = view->camera;
    assert_true(rgb && bytes);
    assert_ok(ctx, sf_scene_get_pixels(from, view->id, rgb, NULL));
    for (size_t i = 0; i < values; i++) bytes[i] = (uint8_t)(255 * rgb[i] + 0.5f);
    if (change && view->split == SF_SPLIT_TRAIN) change(user, number, &camera, bytes);
    sf_pixels pixels = {.rgb = bytes, .stride = 3 * (size_t)camera.width};
    assert_ok(ctx, sf_scene_add_view(to, view->name, &camera, &pixels, view->split, &id));
    free(rgb);
    free(bytes);
    return id;
}

uint32_t test_copy_view(sf_context *ctx, sf_scene *from, sf_view_info view, sf_scene *to, sf_split split) {
    view.split = split;
    return copy_view(ctx, from, &view, to, 0, NULL, NULL);
}

void test_copy_views(sf_context *ctx, sf_scene *from, sf_scene *to, test_change change, void *user) {
    sf_view_info view;
    size_t number = 0;
    for (size_t i = 0; !sf_scene_get_view(from, i, &view); i++) {
        copy_view(ctx, from, &view, to, number, change, user);
        number += view.split == SF_SPLIT_TRAIN;
    }
}

sf_scene *test_changed_scene(sf_context *ctx, const char *name, test_change change, void *user) {
    sf_scene *from, *to;
    assert_ok(ctx, sf_scene_load(ctx, name, NULL, &from));
    assert_ok(ctx, sf_scene_create(ctx, &to));
    copy_points(ctx, from, to);
    test_copy_views(ctx, from, to, change, user);
    sf_scene_destroy(&from);
    return to;
}

sf_scene *test_load_scene(sf_context *ctx, const char *path, const sf_load_options *options) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, path, options, &scene));
    assert_non_null(scene);
    return scene;
}

sf_scene_info test_scene_info(sf_scene *scene) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    return info;
}

sf_view_info test_view_info(sf_scene *scene, size_t index) {
    sf_view_info view = {0};
    assert_int_equal(sf_scene_get_view(scene, index, &view), SF_OK);
    return view;
}

void test_turn_camera(sf_camera *camera, const double right[3], const double ahead[3]) {
    for (int k = 0; k < 3; k++) {
        camera->R_cw[k] = right[k];
        camera->R_cw[3 + k] =
            ahead[(k + 1) % 3] * right[(k + 2) % 3] - ahead[(k + 2) % 3] * right[(k + 1) % 3];
        camera->R_cw[6 + k] = ahead[k];
    }
}

void test_move_camera(sf_camera *camera, const double at[3]) {
    const double *R = camera->R_cw;
    for (int j = 0; j < 3; j++)
        camera->t_cw[j] = -(R[3 * j] * at[0] + R[3 * j + 1] * at[1] + R[3 * j + 2] * at[2]);
}

sf_camera test_camera_around(int view, int views, int width, int height) {
    const double pi = 3.141592653589793;
    double angle = 2 * pi * view / views, c = cos(angle), s = sin(angle);
    return (sf_camera){.width = width,
                       .height = height,
                       .fx = 60,
                       .fy = 60,
                       .cx = width / 2.0,
                       .cy = height / 2.0,
                       .R_cw = {s, -c, 0, 0, 0, -1, c, s, 0},
                       .t_cw = {0, 0, 4}};
}

static const char *self;

void test_say_begun(void) {
    if (write(STDOUT_FILENO, "x", 1) != 1) _exit(1);
}

void test_begin(int argc, char **argv, void (*begin)(sf_context *ctx, const char *path)) {
    self = argv[0];
    if (argc == 1) return;
    sf_context *ctx;
    sf_context_options options = {.threads = 1};
    if (sf_context_create(&ctx, &options)) _exit(1);
    begin(ctx, argv[1]);
    test_say_begun();
    pause();
    _exit(1);
}

pid_t test_start(const char *path) {
    enum { MAX_COMMAND = 64 };
    int begun[2];
    char byte;
    char *command[MAX_COMMAND];
    assert_non_null(self);
    assert_int_equal(pipe(begun), 0);
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (!pid) {
        size_t n = test_runner(command, MAX_COMMAND - 3);
        memcpy(&command[n], &self, sizeof self);
        memcpy(&command[n + 1], &path, sizeof path);
        command[n + 2] = NULL;
        close(begun[0]);
        if (dup2(begun[1], STDOUT_FILENO) >= 0) execvp(command[0], command);
        _exit(99);
    }
    close(begun[1]);
    assert_int_equal(read(begun[0], &byte, 1), 1);
    close(begun[0]);
    return pid;
}

void test_kill(pid_t pid) {
    assert_int_equal(kill(pid, SIGKILL), 0);
    assert_int_equal(waitpid(pid, NULL, 0), pid);
}

void test_refuse_model(sf_context *ctx, const char *path, sf_status expected, const char *part) {
    sf_model *model = (sf_model *)ctx;
    assert_status(ctx, sf_model_load(ctx, path, &model), expected);
    assert_null(model);
    assert_error_names(ctx, path);
    assert_error_names(ctx, part);
    assert_null(strchr(sf_last_error(ctx), '\n'));
}

void test_draw(sf_context *ctx, const sf_model *model, const sf_camera *camera, float *rgb) {
    sf_renderer *renderer;
    sf_image_out out = {.rgb = rgb};
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_render(renderer, model, camera, NULL, &out));
    sf_renderer_destroy(&renderer);
}

void test_source_without_memory(sf_context *ctx, test_allocations *memory, const char *(*name)(void),
                                long least) {
    long before = memory->live, failures = 0;
    for (sf_status status = SF_ERR_MEMORY; status != SF_OK; failures++) {
        sf_source *source;
        sf_frame frame;
        memory->fail_at = memory->calls + failures + 1;
        status = sf_source_open(ctx, name(), &source);
        if (status == SF_OK) status = sf_source_next(source, -1, &frame);
        if (status != SF_OK) assert_int_equal(status, SF_ERR_MEMORY);
        sf_source_close(&source);
        assert_int_equal(memory->live, before);
    }
    assert_true(failures > least);
    memory->fail_at = 0;
}
