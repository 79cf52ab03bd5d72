/* test_checkpoint_files.c - files that are damaged or of something else are refused by name; disks that fail;
 * memory. */
/* link: -Wl,--wrap=write,--wrap=fsync,--wrap=rename */
#include "checkpoint_fixture.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/hash.h"

/* Writing fails on demand. */

enum { FAIL_NOTHING, FAIL_WRITE, FAIL_FSYNC, FAIL_RENAME };
static int failing;

ssize_t __real_write(int fd, const void *data, size_t size);
int __real_fsync(int fd);
int __real_rename(const char *from, const char *to);
ssize_t __wrap_write(int fd, const void *data, size_t size);
int __wrap_fsync(int fd);
int __wrap_rename(const char *from, const char *to);

static int fails(int call) {
    if (failing != call) return 0;
    errno = ENOSPC;
    return 1;
}

ssize_t __wrap_write(int fd, const void *data, size_t size) {
    return fails(FAIL_WRITE) ? -1 : __real_write(fd, data, size);
}
int __wrap_fsync(int fd) { return fails(FAIL_FSYNC) ? -1 : __real_fsync(fd); }
int __wrap_rename(const char *from, const char *to) {
    return fails(FAIL_RENAME) ? -1 : __real_rename(from, to);
}

/* What is refused. */

/* A small one: every byte of it is tried. */
static void write_checkpoint(const char *path) {
    sf_fit_options options = checkpoint_short_fit(20);
    options.max_gaussians = 16;
    options.sh_degree = 0;
    run r = checkpoint_start(2, &options);
    checkpoint_take_steps(&r, 9);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, path));
    checkpoint_end(&r);
}

static void assert_refused(const run *r, const char *path, sf_status expected, const char *part) {
    sf_fitter *fitter = (sf_fitter *)&fitter;
    sf_status status = sf_fitter_load(r->ctx, r->scene, path, NULL, &fitter);
    assert_null(fitter);
    assert_int_not_equal(status, SF_OK);
    if (expected) assert_status(r->ctx, status, expected);
    assert_error_names(r->ctx, path);
    assert_error_names(r->ctx, part);
}

/* Cut off anywhere, or with anything behind it. */
static void test_cut_off(void **state) {
    (void)state;
    const char *path = test_path("whole"), *cut = test_path("cut");
    write_checkpoint(path);
    run r = checkpoint_open_scene(1);
    content c = checkpoint_read_content(path);
    size_t pace = getenv("SPLATFIT_QUICK") ? 97 : 1;
    for (size_t size = 0; size < c.size; size += size < 200 || size > c.size - 200 ? 1 : pace) {
        test_write(cut, c.data, size);
        assert_refused(&r, cut, SF_ERR_FORMAT, size < 24 ? "is not a checkpoint" : "cut off");
    }
    uint8_t *longer = malloc(c.size + 1);
    assert_non_null(longer);
    memcpy(longer, c.data, c.size);
    longer[c.size] = 0;
    test_write(cut, longer, c.size + 1);
    assert_refused(&r, cut, SF_ERR_FORMAT, "1 bytes more");
    free(longer);
    free(c.data);
    checkpoint_end(&r);
}

/* No bit may differ. */
static void test_flipped_bits(void **state) {
    (void)state;
    const char *path = test_path("whole"), *flipped = test_path("flipped");
    write_checkpoint(path);
    run r = checkpoint_open_scene(1);
    content c = checkpoint_read_content(path);
    size_t pace = getenv("SPLATFIT_QUICK") ? 101 : 1;
    for (size_t i = 0; i < c.size; i += i < 400 || i > c.size - 200 ? 1 : pace) {
        c.data[i] ^= (uint8_t)(1 << i % 8);
        test_write(flipped, c.data, c.size);
        assert_refused(&r, flipped, i < 24 ? SF_ERR_FORMAT : SF_OK, flipped);
        c.data[i] ^= (uint8_t)(1 << i % 8);
    }
    free(c.data);
    checkpoint_end(&r);
}

static void store_hash(uint8_t *data, size_t at, size_t size) {
    uint64_t hash = sf_hash(SF_HASH_SEED, data + at, size);
    for (size_t i = 0; i < 8; i++) data[at + size + i] = (uint8_t)(hash >> (8 * i));
}

static void test_other_versions_and_files(void **state) {
    (void)state;
    const char *path = test_path("whole"), *other = test_path("other");
    write_checkpoint(path);
    run r = checkpoint_open_scene(1);
    content c = checkpoint_read_content(path);
    c.data[8] = 1;
    store_hash(c.data, 0, 16);
    test_write(other, c.data, c.size);
    assert_refused(&r, other, SF_ERR_UNSUPPORTED, "version: 1, this program reads 2");
    c.data[8] = 2;
    store_hash(c.data, 0, 16);
    c.data[24] ^= 1; /* a section of another name */
    store_hash(c.data, 24, 40);
    test_write(other, c.data, c.size);
    assert_refused(&r, other, SF_ERR_FORMAT, "section program: is missing");
    free(c.data);
    test_write(other, "{}", 2);
    assert_refused(&r, other, SF_ERR_FORMAT, "is not a checkpoint");
    assert_refused(&r, test_path("absent"), SF_ERR_IO, "cannot be opened");
    assert_refused(&r, test_folder(), SF_ERR_IO, "not a regular file");
    checkpoint_end(&r);
}

/* A section that this program does not know holds a state that it would lose. */
static void test_unknown_section(void **state) {
    (void)state;
    const char *path = test_path("whole"), *more = test_path("more");
    write_checkpoint(path);
    run r = checkpoint_open_scene(1);
    content c = checkpoint_read_content(path);
    enum { HEADER = 48, HASH = 8 };
    uint8_t *data = calloc(c.size + HEADER + HASH, 1);
    assert_non_null(data);
    size_t end_at = 0;
    for (size_t i = 0; i + 4 <= c.size; i++)
        if (!memcmp(c.data + i, "end\0", 4)) end_at = i;
    size_t tail = c.size - end_at;
    memcpy(data, c.data, end_at);
    memcpy(data + end_at, "poses", 5);
    data[end_at + 24] = 8;
    store_hash(data, end_at, 40);
    uint64_t nothing = SF_HASH_SEED; /* of no element */
    for (size_t i = 0; i < 8; i++) data[end_at + HEADER + i] = (uint8_t)(nothing >> (8 * i));
    memcpy(data + end_at + HEADER + HASH, c.data + end_at, tail);
    data[end_at + HEADER + HASH + HEADER]++; /* the number of sections */
    store_hash(data, end_at + HEADER + HASH + HEADER, 8);
    test_write(more, data, end_at + HEADER + HASH + tail);
    assert_refused(&r, more, SF_ERR_UNSUPPORTED, "section poses: is not known");
    free(data);
    free(c.data);
    checkpoint_end(&r);
}

static sf_scene *scene_with(sf_context *ctx, const char *path, int downscale, int hold_out) {
    sf_scene *scene;
    sf_load_options options = sf_load_options_default();
    options.downscale = downscale;
    options.hold_out = hold_out;
    assert_ok(ctx, sf_scene_load(ctx, path, &options, &scene));
    return scene;
}

/* Adds a view like view `index` of `from`, with a difference. */
static void add_like(sf_context *ctx, sf_scene *from, size_t index, sf_scene *to, int change) {
    sf_view_info view;
    assert_ok(ctx, sf_scene_get_view(from, index, &view));
    size_t pixels = (size_t)view.camera.width * (size_t)view.camera.height;
    float *values = malloc(3 * pixels * sizeof *values);
    uint8_t *rgb = malloc(3 * pixels);
    assert_true(values && rgb);
    assert_ok(ctx, sf_scene_get_pixels(from, view.id, values, NULL));
    for (size_t i = 0; i < 3 * pixels; i++) rgb[i] = (uint8_t)(255 * values[i] + 0.5f);
    if (change == 1) rgb[3 * pixels - 1] ^= 1;
    if (change == 2) view.camera.t_cw[0] += 1e-12;
    sf_pixels p = {.rgb = rgb, .stride = 3 * (size_t)view.camera.width};
    assert_ok(ctx,
              sf_scene_add_view(to, change == 3 ? "other" : view.name, &view.camera, &p, view.split, NULL));
    free(values);
    free(rgb);
}

/* What the view of a changed scene is refused for. */
static void test_other_scenes(void **state) {
    (void)state;
    test_skip_emulated();
    static const struct {
        const char *path;
        int downscale, hold_out;
        const char *part;
    } cases[] = {
        {"sim:studio?width=64&height=48&frames=8", 1, 8, "views: 8, in the checkpoint 9"},
        {"sim:studio?width=66&height=48&frames=9", 1, 8, "size: 66x48, in the checkpoint 64x48"},
        {SCENE, 2, 8, "size: 32x24, in the checkpoint 64x48"},
        {SCENE, 1, 3, "is held out, in the checkpoint for training"},
    };
    static const char *const changes[] = {NULL, "its picture differs", "its camera differs",
                                          "view other: the checkpoint has"};
    const char *path = test_path("whole");
    write_checkpoint(path);
    run r = checkpoint_open_scene(1);
    sf_scene *same = r.scene;
    uint64_t fingerprint, other;
    assert_ok(r.ctx, sf_scene_fingerprint(same, &fingerprint));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        r.scene = scene_with(r.ctx, cases[i].path, cases[i].downscale, cases[i].hold_out);
        assert_refused(&r, path, SF_ERR_ARGUMENT, cases[i].part);
        assert_ok(r.ctx, sf_scene_fingerprint(r.scene, &other));
        assert_true(other != fingerprint);
        sf_scene_destroy(&r.scene);
    }
    for (int change = 0; change < 4; change++) {
        assert_ok(r.ctx, sf_scene_create(r.ctx, &r.scene));
        for (size_t i = 0; i < 9; i++) add_like(r.ctx, same, i, r.scene, i == 4 ? change : 0);
        if (changes[change]) {
            assert_refused(&r, path, SF_ERR_ARGUMENT, changes[change]);
        } else {
            assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, path, NULL, &r.fitter));
            sf_fitter_destroy(&r.fitter);
        }
        sf_scene_destroy(&r.scene);
    }
    r.scene = same;
    checkpoint_end(&r);
}

static void test_other_options(void **state) {
    (void)state;
    test_skip_emulated();
    const char *path = test_path("whole");
    write_checkpoint(path);
    run r = checkpoint_open_scene(1);
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        sf_fit_options options;
        char text[64], part[128];
        assert_ok(r.ctx, sf_checkpoint_options(r.ctx, path, &options));
        assert_int_equal(options.max_gaussians, 16);
        assert_ok(r.ctx, sf_fit_options_get(&options, info.name, text, sizeof text));
        const char *other = info.kind == SF_KIND_ENUM ? "white" : info.kind == SF_KIND_FLAG ? "1" : "0.625";
        if (info.kind == SF_KIND_INT) other = strcmp(text, "2") ? "2" : "3";
        if (!strcmp(info.name, "memory")) other = "2G";
        if (sf_fit_options_set(r.ctx, &options, info.name, other)) continue;
        sf_status status = sf_fitter_load(r.ctx, r.scene, path, &options, &r.fitter);
        if (!strcmp(info.name, "steps") || !strcmp(info.name, "time_limit") || !strcmp(info.name, "memory")) {
            assert_status(r.ctx, status, SF_OK);
            sf_fitter_destroy(&r.fitter);
            continue;
        }
        assert_status(r.ctx, status, SF_ERR_ARGUMENT);
        snprintf(part, sizeof part, "%s: the run has ", info.name);
        assert_error_names(r.ctx, part);
    }
    checkpoint_end(&r);
}

/* Longer than it was planned. */
static void test_more_steps(void **state) {
    (void)state;
    test_skip_emulated();
    const char *path = test_path("whole");
    write_checkpoint(path);
    run r = checkpoint_open_scene(1);
    sf_fit_options options;
    assert_ok(r.ctx, sf_checkpoint_options(r.ctx, path, &options));
    options.steps = 30;
    assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, path, &options, &r.fitter));
    checkpoint_take_steps(&r, 21);
    assert_status(r.ctx, sf_fitter_step(r.fitter), SF_ERR_END);
    checkpoint_end(&r);
}

/* Where a checkpoint cannot be written, the old one stays, and the fit is unharmed. */
static void test_failing_disk(void **state) {
    (void)state;
    test_skip_emulated();
    const char *path = test_path("kept");
    sf_fit_options options = checkpoint_short_fit(20);
    run r = checkpoint_start(1, &options);
    checkpoint_take_steps(&r, 5);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, path));
    content kept = checkpoint_read_content(path);
    int entries = test_count_entries(test_folder());
    checkpoint_take_steps(&r, 5);
    for (int call = FAIL_WRITE; call <= FAIL_RENAME; call++) {
        failing = call;
        sf_status status = sf_fitter_save(r.fitter, path);
        failing = FAIL_NOTHING;
        assert_status(r.ctx, status, SF_ERR_IO);
        assert_error_names(r.ctx, path);
        assert_error_names(r.ctx, strerror(ENOSPC));
        checkpoint_assert_same(&kept, checkpoint_read_content(path));
        assert_int_equal(test_count_entries(test_folder()), entries);
    }
    assert_status(r.ctx, sf_fitter_save(r.fitter, test_path("absent/c")), SF_ERR_IO);
    checkpoint_take_steps(&r, 10);
    content model = checkpoint_model_of(&r);
    run other = checkpoint_go_on(1, path);
    assert_int_equal(checkpoint_progress_of(&other).step, 5);
    assert_ok(other.ctx, sf_fitter_run(other.fitter, NULL, NULL));
    checkpoint_assert_same(&model, checkpoint_model_of(&other));
    free(kept.data);
    free(model.data);
    checkpoint_end(&r);
    checkpoint_end(&other);
}

/* Takes steps from a checkpoint and keeps it again, until it is killed. */
static void keep_on_saving(sf_context *ctx, const char *path) {
    sf_scene *scene = NULL;
    sf_fitter *fitter = NULL;
    if (sf_scene_load(ctx, SCENE, NULL, &scene) || sf_fitter_load(ctx, scene, path, NULL, &fitter)) _exit(1);
    test_say_begun();
    for (;;) {
        sf_fitter_step(fitter);
        sf_fitter_save(fitter, path);
    }
}

/* Killed at any moment: a whole checkpoint stands. */
static void test_killed(void **state) {
    (void)state;
    test_skip_emulated();
    const char *path = test_path("survivor");
    for (int attempt = 0; attempt < 6; attempt++) {
        write_checkpoint(path);
        pid_t pid = test_start(path);
        checkpoint_rest(0.05 + 0.0137 * attempt);
        int status;
        kill(pid, SIGKILL);
        assert_int_equal(waitpid(pid, &status, 0), pid);
        assert_true(WIFSIGNALED(status));
        run r = checkpoint_go_on(1, path);
        assert_between(checkpoint_progress_of(&r).step, 9, 20);
        assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
        checkpoint_end(&r);
    }
}

/* Memory. */

enum { MEGA = 1 << 20 };

/* The cap follows the budget; what does not fit is refused before the start. */
static void test_memory_budget(void **state) {
    (void)state;
    test_skip_emulated();
    run r = checkpoint_open_scene(1);
    sf_fit_options options = checkpoint_short_fit(10), used;
    sf_memory_bill bill, less;
    options.max_gaussians = 100000;
    checkpoint_begin(&r, &options);
    sf_fitter_get_memory(r.fitter, &bill);
    sf_fitter_get_options(r.fitter, &used);
    assert_int_equal(used.max_gaussians, 100000);
    assert_true(bill.total == bill.before + bill.gaussians + bill.lists + bill.planes + bill.results);
    /* the model's values, two moments of 14 of them and one of the 15 coefficients of higher SH */
    assert_true(bill.gaussians >= (uint64_t)100000 * (4 * (59 + 2 * 14 + 15) + 12));
    checkpoint_end(&r);
    options.moments = SF_MOMENTS_HALF;
    checkpoint_begin(&r, &options);
    sf_fitter_get_memory(r.fitter, &less);
    assert_true(bill.gaussians - less.gaussians >= (uint64_t)100000 * 14 * 4);
    assert_true(less.gaussians >= (uint64_t)100000 * (4 * (59 + 14 + 15) + 12));
    options.moments = SF_MOMENTS_FLOAT;
    checkpoint_end(&r);

    options.max_gaussians = 1; /* what is resident by now: a sanitizer keeps what was freed */
    checkpoint_begin(&r, &options);
    sf_fitter_get_memory(r.fitter, &less);
    checkpoint_end(&r);
    options.max_gaussians = 100000;
    options.memory = (int64_t)(less.before + (bill.total - bill.before) / 2);
    test_log_clear();
    checkpoint_begin(&r, &options);
    test_assert_contains(test_log, "max_gaussians lowered from 100000 to ", __FILE__, __LINE__);
    sf_fitter_get_memory(r.fitter, &less);
    sf_fitter_get_options(r.fitter, &used);
    assert_between(used.max_gaussians, 20000, 70000);
    assert_true(less.total <= less.budget && less.budget == (uint64_t)options.memory);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("lowered")));
    checkpoint_end(&r);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, test_path("lowered"), NULL, &r.fitter));
    checkpoint_end(&r);
#endif
    assert_ok(r.ctx, sf_checkpoint_options(r.ctx, test_path("lowered"), &options));
    options.memory = 0;
    assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, test_path("lowered"), &options, &r.fitter));
    sf_fitter_get_options(r.fitter, &options);
    assert_int_equal(options.max_gaussians, used.max_gaussians);
    checkpoint_end(&r);

    options.memory = MEGA;
    assert_status(r.ctx, sf_fitter_create(r.ctx, r.scene, NULL, &options, &r.fitter), SF_ERR_MEMORY);
    assert_error_names(r.ctx, "memory: 1 MB are not enough: 1000 Gaussians take about ");
    assert_null(r.fitter);
    assert_status(r.ctx, sf_fitter_load(r.ctx, r.scene, test_path("lowered"), &options, &r.fitter),
                  SF_ERR_MEMORY);
    assert_error_names(r.ctx, "memory: 1 MB are not enough");
    assert_null(r.fitter);
}

/* Growth ends where the process has more than it may. */
static void test_memory_watched(void **state) {
    (void)state;
    test_skip_emulated();
    run r = checkpoint_open_scene(1);
    sf_fit_options options = checkpoint_short_fit(40);
    sf_memory_bill bill;
    checkpoint_begin(&r, &options);
    sf_fitter_get_memory(r.fitter, &bill);
    checkpoint_end(&r);
    options.memory = (int64_t)bill.total + 8 * MEGA;
    checkpoint_begin(&r, &options);
    size_t size = 64 * MEGA; /* taken behind its back */
    uint8_t *taken = malloc(size);
    assert_non_null(taken);
    for (size_t i = 0; i < size; i += 512) ((volatile uint8_t *)taken)[i] = 1;
    test_log_clear();
    size_t before = checkpoint_progress_of(&r).gaussians;
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    test_assert_contains(test_log, "the model stays at ", __FILE__, __LINE__);
    assert_true(checkpoint_progress_of(&r).gaussians <= before);
    free(taken);
    checkpoint_end(&r);
}

static void test_memory_units(void **state) {
    (void)state;
    static const struct {
        const char *text;
        int64_t bytes; /* -1: refused */
    } cases[] = {{"900M", (int64_t)900 << 20},
                 {"2G", (int64_t)2 << 30},
                 {"0.5G", 1 << 29},
                 {"16K", 1 << 14},
                 {"123456", 123456},
                 {"0", 0},
                 {"1T", -1},
                 {"1MB", -1},
                 {"M", -1},
                 {"-1M", -1},
                 {"0.3", -1},
                 {"9999999G", -1}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_fit_options options = sf_fit_options_default();
        sf_status status = sf_fit_options_set(ctx, &options, "memory", cases[i].text);
        assert_status(ctx, status, cases[i].bytes < 0 ? SF_ERR_ARGUMENT : SF_OK);
        if (!status) assert_int_equal(options.memory, cases[i].bytes);
        assert_status(ctx, sf_fit_options_set(ctx, &options, "steps", "1K"), SF_ERR_ARGUMENT);
    }
    sf_context_destroy(&ctx);
}

int main(int argc, char **argv) {
    test_begin(argc, argv, keep_on_saving);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cut_off),
        cmocka_unit_test(test_flipped_bits),
        cmocka_unit_test(test_other_versions_and_files),
        cmocka_unit_test(test_unknown_section),
        cmocka_unit_test(test_other_scenes),
        cmocka_unit_test(test_other_options),
        cmocka_unit_test(test_more_steps),
        cmocka_unit_test(test_failing_disk),
        cmocka_unit_test(test_killed),
        cmocka_unit_test(test_memory_budget),
        cmocka_unit_test(test_memory_watched),
        cmocka_unit_test(test_memory_units),
    };
    return cmocka_run_group_tests(tests, NULL, checkpoint_close_scenes);
}
