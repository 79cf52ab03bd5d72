/* test_checkpoint.c - fits that are interrupted and gone on with make the same bytes; files that are damaged
 * or of something else are refused by name; runs limited by time are repeated. */
/* link: -Wl,--wrap=write,--wrap=fsync,--wrap=rename */
#include "testing.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/hash.h"
#include "fit/fitter.h"
#include "fit/reorder.h"

#define SCENE "sim:studio?width=64&height=48&frames=9"

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

/* Runs. */

typedef struct run {
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
} run;

static run fresh_scene(int threads) {
    run r = {.ctx = test_context_threads(threads)};
    assert_ok(r.ctx, sf_scene_load(r.ctx, SCENE, NULL, &r.scene));
    return r;
}

/* The scene is made once for each number of threads. */
enum { MOST_THREADS = 4 };
static run opened[MOST_THREADS + 1];

static run open_scene(int threads) {
    if (!opened[threads].ctx) opened[threads] = fresh_scene(threads);
    return opened[threads];
}

static int close_scenes(void **state) {
    (void)state;
    for (int i = 0; i <= MOST_THREADS; i++) {
        sf_scene_destroy(&opened[i].scene);
        sf_context_destroy(&opened[i].ctx);
    }
    return 0;
}

static void begin(run *r, const sf_fit_options *options) {
    assert_ok(r->ctx, sf_fitter_create(r->ctx, r->scene, NULL, options, &r->fitter));
}

static run start(int threads, const sf_fit_options *options) {
    run r = open_scene(threads);
    begin(&r, options);
    return r;
}

static run go_on(int threads, const char *path) {
    run r = open_scene(threads);
    assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, path, NULL, &r.fitter));
    return r;
}

static void end(run *r) { sf_fitter_destroy(&r->fitter); }

/* Of a fresh scene. */
static void end_all(run *r) {
    end(r);
    sf_scene_destroy(&r->scene);
    sf_context_destroy(&r->ctx);
}

static void take_steps(const run *r, int64_t steps) {
    for (int64_t i = 0; i < steps; i++) assert_ok(r->ctx, sf_fitter_step(r->fitter));
}

/* Every stage of a run within `steps`: growth every 7 steps, three resolutions, all degrees. */
static sf_fit_options short_fit(int64_t steps) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps;
    options.max_gaussians = 300;
    options.init_random = 100;
    options.densify_every = 7;
    options.background = SF_BACKGROUND_AUTO;
    return options;
}

typedef struct content {
    uint8_t *data;
    size_t size;
} content;

static content read_content(const char *path) {
    content c;
    c.data = test_read(path, &c.size);
    return c;
}

static content model_of(const run *r) {
    const char *path = test_path("model.ply");
    sf_model *model;
    assert_ok(r->ctx, sf_fitter_snapshot(r->fitter, &model));
    assert_ok(r->ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    return read_content(path);
}

/* Frees b. */
static void assert_same(const content *a, content b) {
    assert_int_equal(a->size, b.size);
    assert_memory_equal(a->data, b.data, a->size);
    free(b.data);
}

static sf_fit_progress progress_of(const run *r) {
    sf_fit_progress p;
    sf_fitter_get_progress(r->fitter, &p);
    return p;
}

/* The bytes. */

static int64_t whole(void) { return getenv("SPLATFIT_QUICK") ? 16 : 40; }

/* Interrupted after each step in turn: in passes of 7 views and between them, at growth, between resolutions,
 * with other numbers of threads. */
static sf_fit_end check_interrupted_every(const sf_fit_options *options, int64_t every) {
    static const int threads[] = {1, 2, 4};
    const char *path = test_path("c");
    run r = start(2, options);
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    content expected = model_of(&r);
    sf_fit_progress reached = progress_of(&r);
    end(&r);
    run writer = start(4, options);
    for (int64_t at = 0; at <= reached.step; at += every) {
        assert_ok(writer.ctx, sf_fitter_save(writer.fitter, path));
        run reader = go_on(threads[at % 3], path);
        assert_int_equal(progress_of(&reader).step, at);
        assert_ok(reader.ctx, sf_fitter_run(reader.fitter, NULL, NULL));
        assert_same(&expected, model_of(&reader));
        sf_fit_progress p = progress_of(&reader);
        assert_true(p.loss == reached.loss);
        assert_memory_equal(p.background, reached.background, sizeof p.background);
        assert_int_equal(p.skipped_values, reached.skipped_values);
        assert_int_equal(p.step, reached.step);
        assert_int_equal(p.best_step, reached.best_step);
        assert_int_equal(p.end, reached.end);
        end(&reader);
        if (at + every <= reached.step) take_steps(&writer, every);
    }
    end(&writer);
    free(expected.data);
    return reached.end;
}

static void check_interrupted(const sf_fit_options *options) {
    assert_int_equal(check_interrupted_every(options, 1), SF_FIT_COMPLETE);
}

static void test_same_bytes(void **state) {
    (void)state;
    sf_fit_options options = short_fit(whole());
    check_interrupted(&options);
}

static void test_same_bytes_otherwise(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = short_fit(whole() / 2);
    options.background = SF_BACKGROUND_RANDOM;
    options.sh_degree = 1;
    options.antialiased = 1;
    options.densify_every = 3;
    check_interrupted(&options);
}

/* Other ways to grow, with all that is learned of views. */
static void test_same_bytes_however_grown(void **state) {
    (void)state;
    test_skip_emulated();
    for (int growth = SF_DENSIFY_ERROR; growth <= SF_DENSIFY_RELOCATE; growth++) {
        sf_fit_options options = short_fit(whole() / 2);
        options.densify = growth;
        options.densify_every = 3;
        options.validate = 4;
        options.exposure = options.refine_poses = options.refine_intrinsics = 1;
        options.reg_opacity = options.reg_scale = 0.01;
        options.ema_steps = growth == SF_DENSIFY_ERROR ? 5 : 0;
        check_interrupted(&options);
    }
}

static void test_same_bytes_with_half_moments(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = short_fit(whole() / 2);
    options.moments = SF_MOMENTS_HALF;
    options.densify_every = 3;
    check_interrupted(&options);
}

/* Steps that spoil the model: its best comes back, and the views of validation join the others. */
static void test_same_bytes_when_stopped(void **state) {
    (void)state;
    test_skip_emulated();
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set");
    sf_fit_options options = short_fit(300);
    options.validate = 3;
    options.patience = 0.05;
    options.pyramid_end = options.densify_end = 0.1;
    options.size = SF_SIZE_CAP;
    options.lr_mean = 0.05;
    options.lr_mean_final = 1;
    assert_int_equal(check_interrupted_every(&options, 23), SF_FIT_VALIDATION);
}

/* Gaussian i gets degree (i + shift) % 4, shift counting upwards. */
static void mix_degrees(const run *r, size_t shift) {
    sf_fitter *f = r->fitter;
    sf_remap_entry *places = calloc(f->model->count, sizeof *places);
    assert_non_null(places);
    for (size_t i = 0; i < f->model->count; i++)
        places[i] = (sf_remap_entry){(uint32_t)i, (uint8_t)((i + shift) % 4)};
    assert_ok(r->ctx, sf_reorder(f, places, f->model->count, NULL));
    free(places);
}

/* Degrees that differ, and change in the course of a run that keeps its best model: N + N steps are 2N. */
static void check_degrees(int moments) {
    const char *path = test_path("d");
    int64_t half = whole() / 4;
    sf_fit_options options = short_fit(2 * half);
    options.densify_every = 3;
    options.validate = 4;
    options.moments = moments;
    content expected = {0};
    for (int64_t at = -1; at <= half; at += half / 2) { /* interrupted at step half + at; the first is not */
        run r = start(2, &options);
        mix_degrees(&r, 0);
        take_steps(&r, half);
        mix_degrees(&r, 1);
        if (at >= 0) {
            size_t degrees[4], back[4];
            take_steps(&r, at);
            assert_ok(r.ctx, sf_fitter_save(r.fitter, path));
            sf_model_degrees(r.fitter->model, degrees);
            end(&r);
            r = go_on(1, path);
            sf_model_degrees(r.fitter->model, back);
            assert_true(degrees[0] && degrees[1] && degrees[2] && degrees[3]);
            assert_memory_equal(back, degrees, sizeof back);
        }
        assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
        if (at < 0)
            expected = model_of(&r), at = -(half / 2);
        else
            assert_same(&expected, model_of(&r));
        end(&r);
    }
    free(expected.data);
}

static void test_same_bytes_of_mixed_degrees(void **state) {
    (void)state;
    check_degrees(SF_MOMENTS_FLOAT);
    check_degrees(SF_MOMENTS_HALF);
}

/* A checkpoint of a checkpoint is the same but for its time; saving changes nothing. */
static void test_again_and_again(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = short_fit(whole());
    run r = start(1, &options);
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    content expected = model_of(&r);
    end(&r);
    r = start(2, &options);
    while (progress_of(&r).step < options.steps) {
        take_steps(&r, 1);
        assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("a")));
        end(&r);
        r = go_on(1 + (int)(options.steps % 3), test_path("a"));
    }
    assert_status(r.ctx, sf_fitter_step(r.fitter), SF_ERR_END);
    assert_same(&expected, model_of(&r));
    free(expected.data);
    end(&r);
}

/* A model gone on from keeps its own schedule. */
static void test_gone_on_model(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = short_fit(10);
    run r = start(1, &options);
    sf_model *model;
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    assert_ok(r.ctx, sf_fitter_snapshot(r.fitter, &model));
    sf_fitter_destroy(&r.fitter);
    assert_ok(r.ctx, sf_fitter_create(r.ctx, r.scene, model, &options, &r.fitter));
    take_steps(&r, 4);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("g")));
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    content expected = model_of(&r);
    run other = go_on(2, test_path("g"));
    assert_ok(other.ctx, sf_fitter_run(other.fitter, NULL, NULL));
    assert_int_equal(progress_of(&other).level, 0);
    assert_same(&expected, model_of(&other));
    free(expected.data);
    end(&other);
    sf_model_destroy(&model);
    end(&r);
}

/* View `place` left in the middle of a pass. */
static void check_view_that_left(size_t place) {
    sf_fit_options options = short_fit(20);
    options.validate = 3;
    run r = fresh_scene(1), other = fresh_scene(2);
    sf_view_info view;
    begin(&r, &options);
    take_steps(&r, 3);
    assert_ok(r.ctx, sf_scene_get_view(r.scene, place, &view));
    assert_ok(r.ctx, sf_scene_remove_view(r.scene, view.id));
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("v")));
    assert_status(other.ctx, sf_fitter_load(other.ctx, other.scene, test_path("v"), NULL, &other.fitter),
                  SF_ERR_ARGUMENT);
    assert_error_names(other.ctx, "views: 9, in the checkpoint 8");
    assert_ok(other.ctx, sf_scene_get_view(other.scene, place, &view));
    assert_ok(other.ctx, sf_scene_remove_view(other.scene, view.id));
    assert_ok(other.ctx, sf_fitter_load(other.ctx, other.scene, test_path("v"), NULL, &other.fitter));
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    assert_ok(other.ctx, sf_fitter_run(other.fitter, NULL, NULL));
    content expected = model_of(&r);
    assert_same(&expected, model_of(&other));
    free(expected.data);
    end_all(&r);
    end_all(&other);
}

/* Of 0 .. 8, 0 and 8 are held out; 2 and 5 are kept out to validate. */
static void test_view_that_left(void **state) {
    (void)state;
    test_skip_emulated();
    check_view_that_left(5);
    check_view_that_left(1);
}

/* Time. */

static void rest(double seconds) {
    struct timespec t = {.tv_nsec = (long)(1e9 * seconds)};
    nanosleep(&t, NULL);
}

/* The time that has passed is part of the run, the time between is not. */
static void test_time_goes_on(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = short_fit(0);
    options.time_limit = 1000;
    run r = start(1, &options);
    rest(0.05);
    take_steps(&r, 3);
    double before = progress_of(&r).seconds;
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("t")));
    rest(0.05);
    run other = go_on(1, test_path("t"));
    double after = progress_of(&other).seconds;
    assert_true(before >= 0.05);
    assert_true(after >= before);
    end(&r);
    end(&other);
}

/* A run limited by time, interrupted once, and the run that follows its plan: the same bytes. */
static void test_plan(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = short_fit(0);
    options.time_limit = getenv("SPLATFIT_QUICK") ? 1 : 0.4;
    run r = start(2, &options);
    while (progress_of(&r).fraction < 0.5) take_steps(&r, 1);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("p")));
    end(&r);
    r = go_on(1, test_path("p"));
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    content expected = model_of(&r);
    int64_t steps = progress_of(&r).step;
    size_t count, again;
    assert_ok(r.ctx, sf_fitter_get_plan(r.fitter, NULL, 0, &count));
    assert_int_equal(count, steps);
    uint32_t *ticks = malloc((count + 1) * sizeof *ticks);
    assert_non_null(ticks);
    assert_ok(r.ctx, sf_fitter_get_plan(r.fitter, ticks, count, &again));
    sf_fitter_get_options(r.fitter, &options); /* with what was planned */
    end(&r);
    options.time_limit = 1e-3; /* its own clock would end it at once */
    r = start(4, &options);
    assert_ok(r.ctx, sf_fitter_follow(r.fitter, ticks, count));
    take_steps(&r, steps / 2);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("p")));
    end(&r);
    r = go_on(2, test_path("p"));
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    assert_int_equal(progress_of(&r).step, steps);
    assert_same(&expected, model_of(&r));
    end(&r);
    free(expected.data);
    free(ticks);
}

static void test_bad_plans(void **state) {
    (void)state;
    static const uint32_t falling[] = {3, 2}, beyond[] = {1, SF_PLAN_TICKS}, good[] = {0, 5, 5};
    sf_fit_options options = short_fit(0);
    options.time_limit = 100;
    run r = start(1, &options);
    assert_status(r.ctx, sf_fitter_follow(r.fitter, falling, 2), SF_ERR_ARGUMENT);
    assert_error_names(r.ctx, "plan: step 1: 2 ");
    assert_status(r.ctx, sf_fitter_follow(r.fitter, beyond, 2), SF_ERR_ARGUMENT);
    assert_ok(r.ctx, sf_fitter_follow(r.fitter, good, 3));
    take_steps(&r, 3);
    assert_status(r.ctx, sf_fitter_step(r.fitter), SF_ERR_END);
    assert_status(r.ctx, sf_fitter_follow(r.fitter, good, 3), SF_ERR_ARGUMENT);
    assert_error_names(r.ctx, "has begun");
    end(&r);
}

/* What is refused. */

/* A small one: every byte of it is tried. */
static void write_checkpoint(const char *path) {
    sf_fit_options options = short_fit(20);
    options.max_gaussians = 16;
    options.sh_degree = 0;
    run r = start(2, &options);
    take_steps(&r, 9);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, path));
    end(&r);
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
    run r = open_scene(1);
    content c = read_content(path);
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
    end(&r);
}

/* No bit may differ. */
static void test_flipped_bits(void **state) {
    (void)state;
    const char *path = test_path("whole"), *flipped = test_path("flipped");
    write_checkpoint(path);
    run r = open_scene(1);
    content c = read_content(path);
    size_t pace = getenv("SPLATFIT_QUICK") ? 101 : 1;
    for (size_t i = 0; i < c.size; i += i < 400 || i > c.size - 200 ? 1 : pace) {
        c.data[i] ^= (uint8_t)(1 << i % 8);
        test_write(flipped, c.data, c.size);
        assert_refused(&r, flipped, i < 24 ? SF_ERR_FORMAT : SF_OK, flipped);
        c.data[i] ^= (uint8_t)(1 << i % 8);
    }
    free(c.data);
    end(&r);
}

static void store_hash(uint8_t *data, size_t at, size_t size) {
    uint64_t hash = sf_hash(SF_HASH_SEED, data + at, size);
    for (size_t i = 0; i < 8; i++) data[at + size + i] = (uint8_t)(hash >> (8 * i));
}

static void test_other_versions_and_files(void **state) {
    (void)state;
    const char *path = test_path("whole"), *other = test_path("other");
    write_checkpoint(path);
    run r = open_scene(1);
    content c = read_content(path);
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
    end(&r);
}

/* A section that this program does not know holds a state that it would lose. */
static void test_unknown_section(void **state) {
    (void)state;
    const char *path = test_path("whole"), *more = test_path("more");
    write_checkpoint(path);
    run r = open_scene(1);
    content c = read_content(path);
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
    end(&r);
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
    run r = open_scene(1);
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
    end(&r);
}

static void test_other_options(void **state) {
    (void)state;
    test_skip_emulated();
    const char *path = test_path("whole");
    write_checkpoint(path);
    run r = open_scene(1);
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
    end(&r);
}

/* Longer than it was planned. */
static void test_more_steps(void **state) {
    (void)state;
    test_skip_emulated();
    const char *path = test_path("whole");
    write_checkpoint(path);
    run r = open_scene(1);
    sf_fit_options options;
    assert_ok(r.ctx, sf_checkpoint_options(r.ctx, path, &options));
    options.steps = 30;
    assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, path, &options, &r.fitter));
    take_steps(&r, 21);
    assert_status(r.ctx, sf_fitter_step(r.fitter), SF_ERR_END);
    end(&r);
}

/* Where a checkpoint cannot be written, the old one stays, and the fit is unharmed. */
static void test_failing_disk(void **state) {
    (void)state;
    test_skip_emulated();
    const char *path = test_path("kept");
    sf_fit_options options = short_fit(20);
    run r = start(1, &options);
    take_steps(&r, 5);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, path));
    content kept = read_content(path);
    int entries = test_count_entries(test_folder());
    take_steps(&r, 5);
    for (int call = FAIL_WRITE; call <= FAIL_RENAME; call++) {
        failing = call;
        sf_status status = sf_fitter_save(r.fitter, path);
        failing = FAIL_NOTHING;
        assert_status(r.ctx, status, SF_ERR_IO);
        assert_error_names(r.ctx, path);
        assert_error_names(r.ctx, strerror(ENOSPC));
        assert_same(&kept, read_content(path));
        assert_int_equal(test_count_entries(test_folder()), entries);
    }
    assert_status(r.ctx, sf_fitter_save(r.fitter, test_path("absent/c")), SF_ERR_IO);
    take_steps(&r, 10);
    content model = model_of(&r);
    run other = go_on(1, path);
    assert_int_equal(progress_of(&other).step, 5);
    assert_ok(other.ctx, sf_fitter_run(other.fitter, NULL, NULL));
    assert_same(&model, model_of(&other));
    free(kept.data);
    free(model.data);
    end(&r);
    end(&other);
}

/* Killed at any moment: a whole checkpoint stands. */
static void test_killed(void **state) {
    (void)state;
    test_skip_emulated();
    const char *path = test_path("survivor");
    for (int attempt = 0; attempt < 6; attempt++) {
        write_checkpoint(path);
        pid_t pid = fork();
        assert_true(pid >= 0);
        if (pid == 0) {
            sf_context *ctx = NULL;
            sf_context_options one = {.threads = 1};
            sf_scene *scene = NULL;
            sf_fitter *fitter = NULL;
            if (sf_context_create(&ctx, &one) || sf_scene_load(ctx, SCENE, NULL, &scene) ||
                sf_fitter_load(ctx, scene, path, NULL, &fitter))
                _exit(1);
            for (;;) {
                sf_fitter_step(fitter);
                sf_fitter_save(fitter, path);
            }
        }
        rest(0.05 + 0.0137 * attempt);
        int status;
        kill(pid, SIGKILL);
        assert_int_equal(waitpid(pid, &status, 0), pid);
        assert_true(WIFSIGNALED(status));
        run r = go_on(1, path);
        assert_between(progress_of(&r).step, 9, 20);
        assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
        end(&r);
    }
}

/* Memory. */

enum { MEGA = 1 << 20 };

/* The cap follows the budget; what does not fit is refused before the start. */
static void test_memory_budget(void **state) {
    (void)state;
    test_skip_emulated();
    run r = open_scene(1);
    sf_fit_options options = short_fit(10), used;
    sf_memory_bill bill, less;
    options.max_gaussians = 100000;
    begin(&r, &options);
    sf_fitter_get_memory(r.fitter, &bill);
    sf_fitter_get_options(r.fitter, &used);
    assert_int_equal(used.max_gaussians, 100000);
    assert_true(bill.total == bill.before + bill.gaussians + bill.lists + bill.planes + bill.results);
    /* the model's values, two moments of 14 of them and one of the 15 coefficients of higher SH */
    assert_true(bill.gaussians >= (uint64_t)100000 * (4 * (59 + 2 * 14 + 15) + 12));
    end(&r);
    options.moments = SF_MOMENTS_HALF;
    begin(&r, &options);
    sf_fitter_get_memory(r.fitter, &less);
    assert_true(bill.gaussians - less.gaussians >= (uint64_t)100000 * 14 * 4);
    assert_true(less.gaussians >= (uint64_t)100000 * (4 * (59 + 14 + 15) + 12));
    options.moments = SF_MOMENTS_FLOAT;
    end(&r);

    options.max_gaussians = 1; /* what is resident by now: a sanitizer keeps what was freed */
    begin(&r, &options);
    sf_fitter_get_memory(r.fitter, &less);
    end(&r);
    options.max_gaussians = 100000;
    options.memory = (int64_t)(less.before + (bill.total - bill.before) / 2);
    test_log_clear();
    begin(&r, &options);
    test_assert_contains(test_log, "max_gaussians lowered from 100000 to ", __FILE__, __LINE__);
    sf_fitter_get_memory(r.fitter, &less);
    sf_fitter_get_options(r.fitter, &used);
    assert_between(used.max_gaussians, 20000, 70000);
    assert_true(less.total <= less.budget && less.budget == (uint64_t)options.memory);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("lowered")));
    end(&r);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, test_path("lowered"), NULL, &r.fitter));
    end(&r);
#endif
    assert_ok(r.ctx, sf_checkpoint_options(r.ctx, test_path("lowered"), &options));
    options.memory = 0;
    assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, test_path("lowered"), &options, &r.fitter));
    sf_fitter_get_options(r.fitter, &options);
    assert_int_equal(options.max_gaussians, used.max_gaussians);
    end(&r);

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
    run r = open_scene(1);
    sf_fit_options options = short_fit(40);
    sf_memory_bill bill;
    begin(&r, &options);
    sf_fitter_get_memory(r.fitter, &bill);
    end(&r);
    options.memory = (int64_t)bill.total + 8 * MEGA;
    begin(&r, &options);
    size_t size = 64 * MEGA; /* taken behind its back */
    uint8_t *taken = malloc(size);
    assert_non_null(taken);
    for (size_t i = 0; i < size; i += 512) ((volatile uint8_t *)taken)[i] = 1;
    test_log_clear();
    size_t before = progress_of(&r).gaussians;
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    test_assert_contains(test_log, "the model stays at ", __FILE__, __LINE__);
    assert_true(progress_of(&r).gaussians <= before);
    free(taken);
    end(&r);
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_same_bytes_otherwise),
        cmocka_unit_test(test_same_bytes_however_grown),
        cmocka_unit_test(test_same_bytes_with_half_moments),
        cmocka_unit_test(test_same_bytes_of_mixed_degrees),
        cmocka_unit_test(test_again_and_again),
        cmocka_unit_test(test_same_bytes_when_stopped),
        cmocka_unit_test(test_gone_on_model),
        cmocka_unit_test(test_view_that_left),
        cmocka_unit_test(test_time_goes_on),
        cmocka_unit_test(test_plan),
        cmocka_unit_test(test_bad_plans),
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
    return cmocka_run_group_tests(tests, NULL, close_scenes);
}
