/* test_cancel.c - a fit that is cancelled at any moment, from another thread and in the handler of a signal,
 * and gone on with is the fit that nobody cancelled. Made for a thread sanitizer. */
#include "testing.h"

#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <time.h>

#include "base/rng.h"

#define SCENE "sim:studio?width=64&height=64&frames=9"
enum { SEED = 11, LONGEST_US = 6000 };

typedef struct setup {
    sf_context *ctx;
    sf_scene *scene;
    sf_fit_options options;
    int times; /* cancelled, at least */
} setup;

static int open_setup(void **state) {
    static setup s;
    int quick = getenv("SPLATFIT_QUICK") != NULL;
    s.ctx = test_context();
    s.times = quick ? 10 : 100;
    assert_ok(s.ctx, sf_scene_load(s.ctx, SCENE, NULL, &s.scene));
    s.options = sf_fit_options_default();
    s.options.steps = quick ? 60 : 200;
    s.options.max_gaussians = 300;
    s.options.densify_every = 10;
    s.options.exposure = 1;
    *state = &s;
    return 0;
}

static int close_setup(void **state) {
    setup *s = *state;
    sf_scene_destroy(&s->scene);
    sf_context_destroy(&s->ctx);
    return 0;
}

static sf_fitter *start(const setup *s) {
    sf_fitter *f;
    assert_ok(s->ctx, sf_fitter_create(s->ctx, s->scene, NULL, &s->options, &f));
    return f;
}

/* The means at the end of a run; the caller frees them. */
static float *means_of(const sf_fitter *f, size_t *n) {
    sf_model *model;
    assert_int_equal(sf_fitter_snapshot(f, &model), SF_OK);
    *n = sf_model_count(model);
    float *means = malloc(3 * (*n + 1) * sizeof *means);
    assert_non_null(means);
    sf_gaussians g = {.means = means};
    assert_int_equal(sf_model_get(model, 0, *n, &g), SF_OK);
    sf_model_destroy(&model);
    return means;
}

static void assert_same_as_whole(const setup *s, const sf_fitter *cancelled) {
    sf_fitter *f = start(s);
    size_t n, m;
    assert_ok(s->ctx, sf_fitter_run(f, NULL, NULL));
    float *whole = means_of(f, &n), *got = means_of(cancelled, &m);
    assert_int_equal(m, n);
    assert_memory_equal(got, whole, 3 * n * sizeof *whole);
    free(whole);
    free(got);
    sf_fitter_destroy(&f);
}

/* What cancels, again and again, until it is told that there is nothing more to cancel. */
typedef struct canceller {
    sf_fitter *fitter;
    atomic_int over;
    atomic_long calls;
    pthread_t runs; /* the thread that runs the fit */
    int by_signal;
} canceller;

static _Atomic(sf_fitter *) in_handler;

static void on_signal(int number) {
    (void)number;
    sf_fitter_cancel(atomic_load(&in_handler));
}

static void *cancel_at_random(void *user) {
    canceller *c = user;
    sf_rng rng;
    sf_rng_seed(&rng, SEED);
    while (!atomic_load(&c->over)) {
        struct timespec pause = {0, (long)sf_rng_below(&rng, LONGEST_US) * 1000};
        nanosleep(&pause, NULL);
        if (c->by_signal)
            pthread_kill(c->runs, SIGUSR1);
        else
            sf_fitter_cancel(c->fitter);
        atomic_fetch_add(&c->calls, 1);
    }
    return NULL;
}

/* Each run ends with its step or before the first: what a cancelled run has done is counted. */
static void run_to_the_end(const setup *s, canceller *c) {
    int64_t before = 0;
    sf_status status;
    do {
        sf_fit_progress p;
        sf_fitter_resume(c->fitter);
        status = sf_fitter_run(c->fitter, NULL, NULL);
        sf_fitter_get_progress(c->fitter, &p);
        assert_true(p.step >= before && p.step <= s->options.steps);
        before = p.step;
    } while (status == SF_ERR_CANCELLED);
    assert_ok(s->ctx, status);
    assert_int_equal(before, s->options.steps);
}

static void check(const setup *s, int by_signal) {
    pthread_t thread;
    long calls = 0;
    while (calls < s->times) {
        canceller c = {.fitter = start(s), .runs = pthread_self(), .by_signal = by_signal};
        atomic_store(&in_handler, c.fitter);
        assert_int_equal(pthread_create(&thread, NULL, cancel_at_random, &c), 0);
        run_to_the_end(s, &c);
        atomic_store(&c.over, 1);
        pthread_join(thread, NULL);
        calls += atomic_load(&c.calls);
        assert_same_as_whole(s, c.fitter);
        sf_fitter_destroy(&c.fitter);
    }
    print_message("cancelled %ld times\n", calls);
}

static void test_from_another_thread(void **state) { check(*state, 0); }

static void test_from_a_signal(void **state) {
    struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART}, before;
    sigemptyset(&action.sa_mask);
    assert_int_equal(sigaction(SIGUSR1, &action, &before), 0);
    check(*state, 1);
    assert_int_equal(sigaction(SIGUSR1, &before, NULL), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_from_another_thread),
        cmocka_unit_test(test_from_a_signal),
    };
    return cmocka_run_group_tests_name("cancel", tests, open_setup, close_setup);
}
