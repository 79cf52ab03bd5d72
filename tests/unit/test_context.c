/* test_context.c - options, messages and memory of a context; every allocation of a small run fails in turn.
 */
#define _GNU_SOURCE
#include "testing.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/context.h"
#include "base/pool.h"

/* ---- options --------------------------------------------------------------------------------------------
 */

static void assert_refused(sf_context_options options) {
    int nothing = 0;
    sf_context *ctx = (sf_context *)(void *)&nothing;
    assert_int_equal(sf_context_create(&ctx, &options), SF_ERR_ARGUMENT);
    assert_null(ctx);
}

static void assert_threads(int asked, int got) {
    sf_context *ctx;
    sf_context_options options = {.threads = asked};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    assert_int_equal(sf_context_threads(ctx), got);
    sf_context_destroy(&ctx);
    assert_null(ctx);
}

/* 256 stacks of the usual size are more than a 32-bit machine has room for. */
static void most_threads_are_256(void **state) {
    (void)state;
    pthread_attr_t usual, small;
    assert_int_equal(pthread_getattr_default_np(&usual), 0);
    assert_int_equal(pthread_getattr_default_np(&small), 0);
    assert_int_equal(pthread_attr_setstacksize(&small, 1 << 20), 0);
    assert_int_equal(pthread_setattr_default_np(&small), 0);
    sf_context *ctx;
    sf_context_options options = {.threads = 256};
    sf_status status = sf_context_create(&ctx, &options);
    int threads = status ? 0 : sf_context_threads(ctx);
    sf_context_destroy(&ctx);
    assert_int_equal(pthread_setattr_default_np(&usual), 0);
    pthread_attr_destroy(&small);
    pthread_attr_destroy(&usual);
    assert_int_equal(status, SF_OK);
    assert_int_equal(threads, 256);
}

static void threads_are_in_range(void **state) {
    (void)state;
    assert_threads(1, 1);
    assert_threads(3, 3);
    assert_threads(0, sf_usable_cpus());
    assert_refused((sf_context_options){.threads = 257});
    assert_refused((sf_context_options){.threads = -1});
}

static void no_options_are_the_defaults(void **state) {
    (void)state;
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, NULL), SF_OK);
    assert_int_equal(sf_context_threads(ctx), sf_usable_cpus());
    assert_true(strlen(sf_context_isa(ctx)) > 0);
    sf_context_destroy(&ctx);
    sf_context_destroy(&ctx); /* NULL by now */
}

static void assert_isa(const char *isa, const char *environment, const char *got) {
    sf_context *ctx;
    sf_context_options options = {.threads = 1, .isa = isa};
    if (environment)
        setenv("SPLATFIT_ISA", environment, 1);
    else
        unsetenv("SPLATFIT_ISA");
    if (got) {
        assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
        assert_string_equal(sf_context_isa(ctx), got);
        sf_context_destroy(&ctx);
    } else {
        assert_refused(options);
    }
}

static void isa_comes_from_options_then_environment(void **state) {
    (void)state;
    const char *set = getenv("SPLATFIT_ISA");
    char *before = set ? strdup(set) : NULL;
    assert_isa("scalar", NULL, "scalar");
    assert_isa("scalar", "nonesuch", "scalar");
    assert_isa(NULL, "scalar", "scalar");
    assert_isa(NULL, "nonesuch", NULL);
    assert_isa("nonesuch", NULL, NULL);
    assert_isa("nonesuch", "scalar", NULL);
    assert_isa("Scalar", NULL, NULL);
    assert_isa("scalar ", NULL, NULL);
    unsetenv("SPLATFIT_ISA");
    if (before) setenv("SPLATFIT_ISA", before, 1);
    free(before);
}

/* ---- messages -------------------------------------------------------------------------------------------
 */

static void fresh_context_has_no_error(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    assert_string_equal(sf_last_error(ctx), "");
    sf_context_destroy(&ctx);
}

static void assert_one_line(const char *text) {
    for (const char *c = text; *c; c++) assert_true((unsigned char)*c >= ' ' && *c != 127);
}

static void message_is_one_line(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model;
    assert_status(ctx, sf_model_load(ctx, "no/such\nfile\r\t\x1b[31m\x7f.ply", &model), SF_ERR_IO);
    assert_one_line(sf_last_error(ctx));
    assert_error_names(ctx, "no/such?file???[31m?.ply");
    sf_context_destroy(&ctx);
}

static void long_message_is_cut(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    char name[3000];
    memset(name, 'n', sizeof name - 1);
    name[sizeof name - 1] = 0;
    assert_int_equal(sf_fail(ctx, SF_ERR_IO, "%s", name), SF_ERR_IO);
    assert_int_equal(strlen(sf_last_error(ctx)), sizeof ctx->error - 1);
    sf_context_destroy(&ctx);
}

static void error_stands_until_the_next(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model;
    assert_status(ctx, sf_model_create(ctx, 1, 4, &model), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "sh_degree: 4");
    assert_ok(ctx, sf_model_create(ctx, 1, 3, &model));
    assert_error_names(ctx, "sh_degree: 4");
    assert_status(ctx, sf_model_get(model, 1, 1, &(sf_gaussians){0}), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "range");
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

typedef struct sink {
    int lines;
    sf_log_level level;
    char last[2048];
} sink;

static void receive(void *user, sf_log_level level, const char *message) {
    sink *s = user;
    s->lines++;
    s->level = level;
    snprintf(s->last, sizeof s->last, "%s", message);
}

static void sink_receives_lines(void **state) {
    (void)state;
    sink s = {0};
    sf_context *ctx;
    sf_context_options options = {.log = receive, .log_user = &s, .threads = 2};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    assert_int_equal(s.lines, 0);
    sf_log(ctx, SF_LOG_WARNING, "%d views of %s", 3, "a\nscene");
    assert_int_equal(s.lines, 1);
    assert_int_equal(s.level, SF_LOG_WARNING);
    assert_string_equal(s.last, "3 views of a?scene");
    sf_log(ctx, SF_LOG_DEBUG, "more");
    assert_int_equal(s.lines, 2);
    assert_int_equal(s.level, SF_LOG_DEBUG);
    assert_string_equal(sf_last_error(ctx), "");
    sf_context_destroy(&ctx);
}

static void log_task(void *ctx, size_t task, int thread) {
    (void)thread;
    sf_log(ctx, SF_LOG_INFO, "task %zu", task);
    sf_fail(ctx, SF_ERR_IO, "task %zu failed", task);
}

static void tasks_log_one_at_a_time(void **state) {
    (void)state;
    sink s = {0};
    sf_context *ctx;
    sf_context_options options = {.log = receive, .log_user = &s, .threads = 4};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    sf_pool_run(ctx->pool, 500, log_task, ctx);
    assert_int_equal(s.lines, 500);
    assert_error_names(ctx, " failed");
    sf_context_destroy(&ctx);
}

static void statuses_have_texts(void **state) {
    (void)state;
    for (int a = SF_OK; a <= SF_ERR_END; a++) {
        assert_true(strlen(sf_status_text((sf_status)a)) > 0);
        for (int b = SF_OK; b < a; b++)
            assert_string_not_equal(sf_status_text((sf_status)a), sf_status_text((sf_status)b));
    }
    assert_non_null(sf_status_text((sf_status)1000));
    assert_true(sf_version()[0] >= '0' && sf_version()[0] <= '9');
}

/* ---- memory ---------------------------------------------------------------------------------------------
 */

static void allocator_is_whole_or_none(void **state) {
    (void)state;
    test_allocations c = {0};
    const sf_allocator alloc_alone = {test_count_alloc, NULL, &c}, free_alone = {NULL, test_count_free, &c},
                       whole = {test_count_alloc, test_count_free, &c};
    assert_refused((sf_context_options){.allocator = &alloc_alone});
    assert_refused((sf_context_options){.allocator = &free_alone});
    assert_int_equal(c.calls, 0);
    assert_refused((sf_context_options){.allocator = &whole, .isa = "nonesuch"});
    assert_true(c.calls > 0);
    assert_int_equal(c.live, 0);
}

static void memory_is_aligned_and_checked(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (size_t size = 0; size < 300; size++) {
        unsigned char *block = sf_calloc(ctx, size, 1);
        assert_non_null(block);
        assert_int_equal((uintptr_t)block % 64, 0);
        for (size_t i = 0; i < size; i++) assert_int_equal(block[i], 0);
        memset(block, 0xa5, size);
        sf_free(ctx, block);
    }
    assert_null(sf_alloc(ctx, SIZE_MAX, 1));
    assert_null(sf_alloc(ctx, SIZE_MAX / 4 + 1, 4));
    assert_null(sf_alloc(ctx, SIZE_MAX / 8, 16));
    assert_error_names(ctx, "out of memory");
    sf_free(ctx, NULL);
    sf_context_destroy(&ctx);
}

static void growing_keeps_what_is_used(void **state) {
    (void)state;
    test_allocations c = {0};
    const sf_allocator allocator = {test_count_alloc, test_count_free, &c};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    int *numbers = NULL;
    size_t capacity = 0;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    for (int n = 0; n < 1000; n++) {
        assert_ok(ctx, sf_grow(ctx, &numbers, &capacity, (size_t)n, (size_t)n + 1, sizeof *numbers));
        numbers[n] = n;
    }
    assert_true(c.calls < 40); /* by half at least each time */
    c.fail_at = c.calls + 1;
    size_t before = capacity;
    int *stood = numbers;
    assert_status(ctx, sf_grow(ctx, &numbers, &capacity, 1000, capacity + 1, sizeof *numbers), SF_ERR_MEMORY);
    assert_int_equal(capacity, before);
    assert_ptr_equal(numbers, stood);
    for (int n = 0; n < 1000; n++) assert_int_equal(numbers[n], n);
    sf_free(ctx, numbers);
    sf_context_destroy(&ctx);
    assert_int_equal(c.live, 0);
}

/* A whole small run: a scene of two views, a model, a picture of it, its loss and gradient, a fit, a file. */
enum { WIDTH = 24, HEIGHT = 17, GAUSSIANS = 20, POINTS = 30 };

typedef struct run {
    sf_context *ctx;
    sf_scene *scene;
    sf_model *model, *fitted, *loaded;
    sf_renderer *renderer;
    sf_fitter *fitter;
    double pose[6];
    sf_loss_value loss;
} run;

static const char *run_path(void) { return test_path("run.ply"); }

static sf_camera run_camera(int number) {
    return (sf_camera){.width = WIDTH,
                       .height = HEIGHT,
                       .fx = 20,
                       .fy = 20,
                       .cx = 12,
                       .cy = 8.5,
                       .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                       .t_cw = {0.3 * number, 0, 4}};
}

static sf_status make_scene(run *r) {
    uint8_t rgb[HEIGHT][WIDTH][3], mask[HEIGHT][WIDTH];
    float points[POINTS][3];
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            mask[y][x] = (uint8_t)(x < 3 ? 100 : 255);
            for (int k = 0; k < 3; k++) rgb[y][x][k] = (uint8_t)(x * 10 + y * 3 * k);
        }
    for (int i = 0; i < POINTS; i++)
        for (int k = 0; k < 3; k++) points[i][k] = (float)((i * (7 + 4 * k)) % 13 - 6) / 6.0f;
    sf_status status = sf_scene_create(r->ctx, &r->scene);
    for (int v = 0; v < 2 && !status; v++) {
        sf_camera camera = run_camera(v);
        sf_pixels pixels = {&rgb[0][0][0], sizeof rgb[0], v ? &mask[0][0] : NULL};
        status = sf_scene_add_view(r->scene, v ? "masked" : NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL);
    }
    if (!status) status = sf_scene_add_points(r->scene, POINTS, &points[0][0], NULL);
    return status;
}

static sf_status make_model(run *r) {
    float means[GAUSSIANS][3], log_scales[GAUSSIANS][3], logits[GAUSSIANS];
    for (int i = 0; i < GAUSSIANS; i++) {
        logits[i] = 1;
        for (int k = 0; k < 3; k++) {
            means[i][k] = (float)((i * (5 + 2 * k)) % 11 - 5) / 4.0f;
            log_scales[i][k] = -1.5f;
        }
    }
    sf_gaussians g = {.means = &means[0][0], .log_scales = &log_scales[0][0], .logit_opacities = logits};
    sf_status status = sf_model_create(r->ctx, GAUSSIANS, 1, &r->model);
    return status ? status : sf_model_set(r->model, 0, GAUSSIANS, &g);
}

static sf_status render_and_differentiate(run *r) {
    static float rgb[HEIGHT * WIDTH * 3], target[HEIGHT * WIDTH * 3], d_rgb[HEIGHT * WIDTH * 3];
    sf_camera camera = run_camera(0);
    sf_image_out out = {.rgb = rgb};
    sf_quality quality;
    double background[3];
    sf_render_grads grads = {.pose = r->pose, .background = background};
    sf_status status = sf_renderer_create(r->ctx, &r->renderer);
    if (!status) status = sf_render(r->renderer, r->model, &camera, NULL, &out);
    if (!status)
        status =
            sf_loss(r->renderer, &(sf_image_pair){WIDTH, HEIGHT, rgb, target, NULL}, 0.2, &r->loss, d_rgb);
    if (!status) status = sf_render_backward(r->renderer, r->model, d_rgb, &grads);
    if (!status) status = sf_compare(r->renderer, WIDTH, HEIGHT, rgb, target, NULL, &quality);
    return status;
}

static sf_status fit(run *r) {
    sf_camera camera = run_camera(1);
    float depth[HEIGHT * WIDTH];
    sf_image_out out = {.depth = depth};
    sf_fit_options o = sf_fit_options_default();
    o.steps = 3;
    o.max_gaussians = 100;
    o.densify_start = 0;
    o.densify_end = 1;
    o.densify_every = 1;
    o.background = SF_BACKGROUND_AUTO;
    sf_status status = sf_fitter_create(r->ctx, r->scene, NULL, &o, &r->fitter);
    if (!status) status = sf_fitter_run(r->fitter, NULL, NULL);
    /* the step that failed was not done, and the others still can be */
    if (status == SF_ERR_MEMORY && r->fitter) {
        assert_ok(r->ctx, sf_fitter_run(r->fitter, NULL, NULL));
        return status;
    }
    if (!status) status = sf_fitter_render(r->fitter, &camera, &out);
    if (!status) status = sf_fitter_snapshot(r->fitter, &r->fitted);
    return status;
}

static sf_status do_run(run *r) {
    sf_status status = make_scene(r);
    if (!status) status = make_model(r);
    if (!status) status = render_and_differentiate(r);
    if (!status) status = fit(r);
    if (!status) status = sf_model_save(r->fitted, run_path());
    if (!status) status = sf_scene_save_cameras(r->scene, test_path("cameras.json"), 0);
    if (!status) status = sf_model_load(r->ctx, run_path(), &r->loaded);
    return status;
}

static void end_run(run *r) {
    sf_model_destroy(&r->loaded);
    sf_model_destroy(&r->fitted);
    sf_fitter_destroy(&r->fitter);
    sf_renderer_destroy(&r->renderer);
    sf_model_destroy(&r->model);
    sf_scene_destroy(&r->scene);
}

/* A run to its end; the model's file is the caller's to free. */
static uint8_t *complete_run(sf_context *ctx, size_t *size) {
    run r = {.ctx = ctx};
    assert_ok(ctx, do_run(&r));
    assert_int_equal(sf_model_count(r.loaded), sf_model_count(r.fitted));
    assert_true(sf_model_count(r.fitted) > POINTS);
    assert_true(r.loss.loss > 0);
    end_run(&r);
    return test_read(run_path(), size);
}

static sf_status create_counting(test_allocations *c, sf_context **ctx) {
    const sf_allocator allocator = {test_count_alloc, test_count_free, c};
    sf_context_options options = {.allocator = &allocator, .threads = 2};
    return sf_context_create(ctx, &options);
}

/* Lets allocation `k` fail; 0 if the run has fewer. */
static int run_with_failure(long k, const uint8_t *expected, size_t expected_size) {
    test_allocations c = {.fail_at = k};
    sf_context *ctx;
    remove(run_path());
    remove(test_path("cameras.json"));
    sf_status status = create_counting(&c, &ctx);
    if (status) {
        assert_int_equal(status, SF_ERR_MEMORY);
        assert_null(ctx);
        assert_int_equal(c.live, 0);
        return 1;
    }
    run r = {.ctx = ctx};
    status = do_run(&r);
    end_run(&r);
    int failed = c.calls >= k;
    if (failed) assert_error_names(ctx, "out of memory");
    /* where growth finds no memory the model stays as large as it is */
    if (status || !failed) assert_status(ctx, status, failed ? SF_ERR_MEMORY : SF_OK);
    assert_int_equal(test_count_entries(test_folder()),
                     test_exists(run_path()) + test_exists(test_path("cameras.json")));

    size_t size;
    c.fail_at = 0;
    uint8_t *file = complete_run(ctx, &size);
    assert_int_equal(size, expected_size);
    assert_memory_equal(file, expected, size);
    free(file);
    sf_context_destroy(&ctx);
    assert_int_equal(c.live, 0);
    return failed;
}

static void every_allocation_may_fail(void **state) {
    (void)state;
    test_skip_emulated();
    test_allocations c = {0};
    sf_context *ctx;
    size_t size;
    assert_int_equal(create_counting(&c, &ctx), SF_OK);
    uint8_t *expected = complete_run(ctx, &size);
    sf_context_destroy(&ctx);
    assert_int_equal(c.live, 0);
    long k = 1;
    while (run_with_failure(k, expected, size)) k++;
    print_message("%ld allocations\n", k - 1);
    assert_int_equal(k - 1, c.calls);
    free(expected);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(most_threads_are_256),
        cmocka_unit_test(threads_are_in_range),
        cmocka_unit_test(no_options_are_the_defaults),
        cmocka_unit_test(isa_comes_from_options_then_environment),
        cmocka_unit_test(fresh_context_has_no_error),
        cmocka_unit_test(message_is_one_line),
        cmocka_unit_test(long_message_is_cut),
        cmocka_unit_test(error_stands_until_the_next),
        cmocka_unit_test(sink_receives_lines),
        cmocka_unit_test(tasks_log_one_at_a_time),
        cmocka_unit_test(statuses_have_texts),
        cmocka_unit_test(allocator_is_whole_or_none),
        cmocka_unit_test(memory_is_aligned_and_checked),
        cmocka_unit_test(growing_keeps_what_is_used),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("context", tests, NULL, NULL);
}
