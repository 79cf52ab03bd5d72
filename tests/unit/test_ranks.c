/* test_ranks.c - fits on several ranks, which are threads here: the collectives, a step, whole fits. */
#include "ranks_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "fit/fitter.h"

enum { MOST = 4, VALUES = 100, WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT, MOST_PIXELS = 16 * 4096 };

/* 1. Collectives. */

typedef struct chosen {
    double values[MOST][VALUES];
    size_t taken[MOST], wanted;
} chosen;

static int falling(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x < y) - (x > y);
}

static sf_status choose(sf_context *ctx, int rank, void *user) {
    chosen *c = user;
    c->taken[rank] = sf_cluster_largest(ctx->cluster, c->values[rank], VALUES, c->wanted);
    return SF_OK;
}

/* The largest of all, with many equal ones: of those, lower ranks first. */
static void test_largest(void **state) {
    (void)state;
    static chosen c;
    static double all[MOST * VALUES];
    static const size_t wanted[] = {0, 1, 37, 200, MOST * VALUES, 1000};
    for (int r = 0; r < MOST; r++) {
        for (int k = 0; k < VALUES; k++) c.values[r][k] = (double)((k * 7 + r * 3) % 11) - 5;
        qsort(c.values[r], VALUES, sizeof(double), falling);
        memcpy(all + r * VALUES, c.values[r], sizeof c.values[r]);
    }
    qsort(all, MOST * VALUES, sizeof *all, falling);
    for (size_t w = 0; w < sizeof wanted / sizeof *wanted; w++) {
        size_t n = 0, most = wanted[w] < MOST * VALUES ? wanted[w] : MOST * VALUES, more_equal = 0;
        c.wanted = wanted[w];
        assert_int_equal(ranks_run(MOST, 1, choose, &c), SF_OK);
        for (int r = 0; r < MOST; r++) n += c.taken[r];
        assert_int_equal(n, most);
        for (int r = 0; r < MOST && most; r++) {
            double least = all[most - 1];
            if (c.taken[r]) assert_true(c.values[r][c.taken[r] - 1] >= least);
            if (c.taken[r] < VALUES) assert_true(c.values[r][c.taken[r]] <= least);
            /* once a rank has left an equal one, the ranks after it take none */
            size_t above = 0;
            while (above < VALUES && c.values[r][above] > least) above++;
            if (more_equal) assert_int_equal(c.taken[r], above);
            more_equal |= c.taken[r] < VALUES && c.values[r][c.taken[r]] == least;
        }
    }
}

static sf_status share(sf_context *ctx, int rank, void *user) {
    sf_cluster *c = ctx->cluster;
    double sums[3] = {1, rank, 0.1 * rank}, *rows = (double *)user + VALUES * rank;
    size_t begin[MOST], end[MOST], wanted[2 * MOST];
    sf_cluster_sum(c, sums, 3);
    for (size_t r = 0; r < MOST; r++) {
        begin[r] = 5 * r, end[r] = 5 * r + 5; /* five rows each, and one of each neighbour */
        wanted[2 * r] = r ? begin[r] - 1 : 0, wanted[2 * r + 1] = r < MOST - 1 ? end[r] + 1 : end[r];
    }
    for (size_t k = 0; k < 5; k++) rows[begin[rank] + k] = 100 + (double)(begin[rank] + k);
    const sf_shared_ranges ranges = {sizeof *rows, begin, end, wanted};
    sf_cluster_share(c, &ranges, &(char *){(char *)rows}, 1);
    rows[VALUES - 1] = sums[0], rows[VALUES - 2] = sums[1], rows[VALUES - 3] = sums[2];
    return sf_cluster_most(c, -rank) == 0 && sf_cluster_first(c, 7 + rank) == 7 ? SF_OK : SF_ERR_ARGUMENT;
}

static void test_sums_and_rows(void **state) {
    (void)state;
    static double rows[MOST][VALUES];
    assert_int_equal(ranks_run(MOST, 1, share, rows), SF_OK);
    for (int r = 0; r < MOST; r++) {
        assert_true(rows[r][VALUES - 1] == MOST && rows[r][VALUES - 2] == 6);
        assert_true(rows[r][VALUES - 3] == rows[0][VALUES - 3]);
        for (int k = 0; k < 5 * MOST; k++) {
            int has = k >= 5 * r - 1 && k <= 5 * r + 5;
            assert_true(rows[r][k] == (has ? 100 + k : 0));
        }
    }
}

/* 2. Fits. */

enum { VALUES_OF_VIEW = 5, SEEN_OF_VIEWS = 4 * VALUES_OF_VIEW };

typedef struct fit_job {
    sf_fit_options options;
    const char *project;
    double losses[512]; /* of each step */
    float rgb[MOST][3 * MOST_PIXELS];
    double psnr;
    size_t counts[MOST];
    uint64_t sent, in_steps[MOST];
    double designed[MOST];
    sf_fit_progress progress;
    int save_at;                       /* after this step a checkpoint is written; 0: none */
    const char *load;                  /* NULL, or the checkpoint to go on from */
    double screens[MOST];              /* sums of the screen gradients of the first step */
    double views[MOST][SEEN_OF_VIEWS]; /* what was learned of the first views */
} fit_job;

static sf_status view_of(sf_context *ctx, sf_scene *scene, sf_fitter *f, int rank, fit_job *job) {
    static float truth[MOST][3 * MOST_PIXELS];
    sf_view_info view;
    double squares = 0;
    sf_status status = sf_scene_get_view(scene, 1, &view);
    if (!status) status = sf_fitter_render(f, &view.camera, &(sf_image_out){.rgb = job->rgb[rank]});
    if (!status) status = sf_scene_get_pixels(scene, view.id, truth[rank], NULL);
    (void)ctx;
    for (int i = 0; i < 3 * PIXELS; i++)
        squares += pow((double)job->rgb[rank][i] - (double)truth[rank][i], 2);
    if (!rank) job->psnr = -10 * log10(squares / (3 * PIXELS));
    return status;
}

/* Displacement, angle and focal length. */
static void note_views(const sf_fitter *f, double *values) {
    for (size_t i = 0; i < f->views.count && i < 4; i++, values += VALUES_OF_VIEW) {
        const sf_view_state *view = &f->views.states[i];
        for (int k = 0; k < 3; k++) values[k] = view->t_cw[k] - view->given.t_cw[k];
        values[3] = view->turned_deg;
        values[4] = f->views.lenses[view->lens].log_focal[0];
    }
}

static sf_status fit(sf_context *ctx, int rank, void *user) {
    fit_job *job = user;
    sf_scene *scene;
    sf_fitter *f = NULL;
    sf_model *model = NULL;
    sf_status status = sf_scene_load(ctx, job->project, NULL, &scene);
    if (status) return status;
    status = job->load ? sf_fitter_load(ctx, scene, job->load, NULL, &f)
                       : sf_fitter_create(ctx, scene, NULL, &job->options, &f);
    for (int k = 0; !status; k++) {
        status = sf_fitter_step(f);
        for (size_t i = 0; !k && !status && i < f->model->count; i++)
            job->screens[rank] += (double)f->workspace.screen[i];
        if (!status && !rank && k < 512) job->losses[k] = f->losses[(f->step - 1) % SF_LOSS_WINDOW];
        if (!status && k + 1 == job->save_at) status = sf_fitter_save(f, test_path("ranks.checkpoint"));
    }
    if (status == SF_ERR_END) status = SF_OK;
    if (!status) {
        job->counts[rank] = f->model->count;
        note_views(f, job->views[rank]);
        if (!rank) sf_fitter_get_progress(f, &job->progress);
        status = view_of(ctx, scene, f, rank, job);
    }
    if (!status) status = sf_fitter_snapshot(f, &model);
    if (!status && ctx->cluster) {
        job->in_steps[rank] = ctx->cluster->in_steps;
        job->designed[rank] = ctx->cluster->designed;
    }
    if (!status && !rank) {
        job->sent = ctx->cluster ? ctx->cluster->sent : 0;
        status = sf_model_save_as(model, test_path("ranks.ply"), NULL);
    }
    sf_model_destroy(&model);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    return status;
}

static uint8_t *fitted(fit_job *job, int ranks, int threads, size_t *size) {
    assert_int_equal(ranks_run(ranks, threads, fit, job), SF_OK);
    return test_read(test_path("ranks.ply"), size);
}

static fit_job *new_job(const char *project, int64_t steps) {
    fit_job *job = calloc(1, sizeof *job);
    assert_non_null(job);
    job->options = sf_fit_options_default();
    job->options.steps = steps;
    job->options.seed = 1;
    job->project = project;
    return job;
}

/* Of what ranks send each other: src/render/float24.h. */
static const double rounding = 0x1p-16;

#define PROJECT "sim:studio?width=96&height=72&frames=9"

/* The first steps are those of one rank, but for the order of sums: loss, picture, gradients. */
static void test_first_steps(void **state) {
    (void)state;
    static const int ranks[] = {2, 3, 4};
    fit_job *one = new_job(PROJECT, 3);
    one->options.densify_every = 1000;
    one->options.exposure = 1;
    one->options.background = SF_BACKGROUND_AUTO;
    size_t size, other_size;
    free(fitted(one, 1, 2, &size));
    for (int i = 0; i < 3; i++) {
        fit_job *job = new_job(PROJECT, 3);
        job->options = one->options;
        free(fitted(job, ranks[i], 1, &other_size));
        assert_int_equal(size, other_size);
        size_t all = 0;
        double screen = 0;
        for (int r = 0; r < ranks[i]; r++) {
            all += job->counts[r], screen += job->screens[r];
            assert_between(job->counts[r], one->counts[0] / (size_t)ranks[i] - 256,
                           one->counts[0] / (size_t)ranks[i] + 256);
            assert_memory_equal(job->rgb[r], job->rgb[0],
                                sizeof job->rgb[0]); /* every rank has the picture */
        }
        assert_int_equal(all, one->counts[0]);
        assert_int_equal(job->progress.gaussians, all);
        assert_true(fabs(job->losses[0] - one->losses[0]) < rounding * one->losses[0]);
        for (int k = 1; k < 3; k++)
            assert_true(fabs(job->losses[k] - one->losses[k]) < 1e-4 * one->losses[k]);
        assert_true(one->screens[0] > 0 && fabs(screen - one->screens[0]) < 4 * rounding * one->screens[0]);
        /* Adam divides by the gradient's size: where that is rounding, a value may go either way, which few
         * pixels show */
        int off = 0;
        for (int p = 0; p < 3 * PIXELS; p++) off += fabsf(job->rgb[0][p] - one->rgb[0][p]) > 1e-3f;
        assert_true(off < 3 * PIXELS / 100);
        assert_true(job->sent > 0);
        free(job);
    }
    free(one);
}

/* A band of many rows of tiles: their numbers take more bytes. */
static void test_tall_picture(void **state) {
    (void)state;
    static const char project[] = "sim:studio?width=16&height=4096&frames=3";
    size_t size;
    fit_job *one = new_job(project, 1), *two = new_job(project, 1);
    free(fitted(one, 1, 2, &size));
    free(fitted(two, 2, 1, &size));
    assert_true(fabs(two->losses[0] - one->losses[0]) < rounding * one->losses[0]);
    double screen = two->screens[0] + two->screens[1];
    assert_true(one->screens[0] > 0 && fabs(screen - one->screens[0]) < 4 * rounding * one->screens[0]);
    free(one);
    free(two);
}

/* A fit of two ranks is as good as one's, and the same bytes each time, with any number of threads. The
 * caller's: the fit of two. */
static fit_job *check_whole(const sf_fit_options *options) {
    size_t size, other_size;
    fit_job *one = new_job(PROJECT, 200), *two = new_job(PROJECT, 200), *again = new_job(PROJECT, 200);
    one->options = two->options = again->options = *options;
    free(fitted(one, 1, 2, &size));
    uint8_t *bytes = fitted(two, 2, 1, &size), *same = fitted(again, 2, 2, &other_size);
    print_message("one rank %.2f dB, %zu Gaussians; two %.2f dB, %zu\n", one->psnr, one->counts[0], two->psnr,
                  two->progress.gaussians);
    assert_int_equal(size, other_size);
    assert_memory_equal(bytes, same, size);
    assert_true(two->psnr > one->psnr - 0.5);
    assert_true(two->progress.gaussians > one->counts[0] * 9 / 10);
    assert_true(two->progress.gaussians <= (size_t)options->max_gaussians);
    free(bytes);
    free(same);
    free(one);
    free(again);
    return two;
}

/* A whole run with growth, validation and selection. */
static void test_whole_fit(void **state) {
    (void)state;
    fit_job *job = new_job(PROJECT, 200);
    job->options.max_gaussians = 3000;
    fit_job *two = check_whole(&job->options);
    double sent = (double)two->in_steps[0] + (double)two->in_steps[1],
           designed = two->designed[0] + two->designed[1];
    print_message("sent in steps: %.0f bytes, designed %.0f\n", sent, designed);
    assert_true(designed > 0 && fabs(sent / designed - 1) < 0.1);
    free(job);
    free(two);
}

/* As many ranks go on to the same bytes; other numbers of ranks go on, too, and one rank writes what ranks
 * take up. */
static void test_checkpoint(void **state) {
    (void)state;
    static const int others[] = {1, 3};
    size_t size, other_size;
    fit_job *two = new_job(PROJECT, 120);
    two->options.max_gaussians = 3000;
    two->save_at = 70;
    uint8_t *bytes = fitted(two, 2, 1, &size);
    fit_job *on = new_job(PROJECT, 120);
    on->load = test_path("ranks.checkpoint");
    uint8_t *same = fitted(on, 2, 1, &other_size);
    assert_int_equal(size, other_size);
    assert_memory_equal(bytes, same, size);
    for (int i = 0; i < 2; i++) {
        free(fitted(on, others[i], 1, &other_size));
        assert_int_equal(on->progress.step, 120);
        assert_int_equal(on->progress.gaussians, two->progress.gaussians);
        assert_true(on->psnr > two->psnr - 0.3);
    }
    fit_job *one = new_job(PROJECT, 120);
    one->options = two->options;
    one->save_at = 70;
    free(fitted(one, 1, 1, &other_size));
    free(fitted(on, 2, 1, &other_size));
    assert_true(on->psnr > one->psnr - 0.3);
    assert_true(on->counts[0] + on->counts[1] == on->progress.gaussians && on->counts[0] > 1000);
    free(bytes);
    free(same);
    free(one);
    free(two);
    free(on);
}

/* 3. A first model that is read in parts, and a model that is written in parts. */

typedef struct parts_job {
    size_t counts[MOST];
    float rgb[3 * PIXELS];
    size_t total;
} parts_job;

static sf_status go_on(sf_context *ctx, int rank, void *user) {
    parts_job *job = user;
    sf_scene *scene = NULL;
    sf_fitter *f = NULL;
    sf_model *from = NULL, *whole = NULL;
    sf_view_info view;
    sf_fit_progress progress;
    sf_fit_options options = sf_fit_options_default();
    sf_model_file_options file = sf_model_file_options_default();
    file.part = rank, file.parts = ctx->cluster ? ctx->cluster->size : 1;
    options.steps = 10;
    options.max_gaussians = 3000;
    sf_status status = sf_model_load_as(ctx, test_path("ranks.ply"), &file, &from);
    if (!status) job->counts[rank] = sf_model_count(from);
    if (!status) status = sf_scene_load(ctx, PROJECT, NULL, &scene);
    if (!status) status = sf_fitter_create(ctx, scene, from, &options, &f);
    if (!status) status = sf_scene_get_view(scene, 1, &view);
    if (!status) status = sf_fitter_render(f, &view.camera, &(sf_image_out){.rgb = rank ? NULL : job->rgb});
    if (!status) status = sf_fitter_save_model(f, test_path("parts.ply"), NULL);
    if (!status) status = sf_fitter_snapshot(f, &whole);
    if (!status && !rank) status = sf_model_save_as(whole, test_path("whole.ply"), NULL);
    if (!status && !rank) {
        sf_fitter_get_progress(f, &progress);
        job->total = progress.gaussians;
    }
    sf_model_destroy(&whole);
    sf_model_destroy(&from);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    return status;
}

static void test_parts(void **state) {
    (void)state;
    static parts_job one, some;
    size_t size, other_size;
    fit_job *job = new_job(PROJECT, 60);
    job->options.max_gaussians = 3000;
    free(fitted(job, 1, 2, &size));
    free(job);
    assert_int_equal(ranks_run(1, 1, go_on, &one), SF_OK);
    for (int ranks = 2; ranks <= MOST; ranks++) {
        memset(&some, 0, sizeof some);
        assert_int_equal(ranks_run(ranks, 1, go_on, &some), SF_OK);
        size_t sum = 0, least = one.counts[0], most = 0;
        for (int r = 0; r < ranks; r++) {
            sum += some.counts[r];
            least = some.counts[r] < least ? some.counts[r] : least;
            most = some.counts[r] > most ? some.counts[r] : most;
        }
        assert_int_equal(sum, one.counts[0]);
        assert_int_equal(some.total, sum);
        assert_true(most - least <= SF_PIECE);
        int off = 0;
        for (int p = 0; p < 3 * PIXELS; p++) off += fabsf(some.rgb[p] - one.rgb[p]) > 1e-4f;
        assert_true(off < 3 * PIXELS / 1000);
        uint8_t *parts = test_read(test_path("parts.ply"), &size);
        uint8_t *whole = test_read(test_path("whole.ply"), &other_size);
        assert_int_equal(size, other_size);
        assert_memory_equal(parts, whole, size);
        free(parts);
        free(whole);
    }
}

/* 4. Steps over a slow network take as long as src/cluster/README.md says of bytes and exchanges. */

typedef struct slow_job {
    double seconds[MOST], sent[MOST], rounds[MOST];
} slow_job;

enum { SLOW_STEPS = 12 };

static sf_status step_slowly(sf_context *ctx, int rank, void *user) {
    slow_job *job = user;
    sf_scene *scene = NULL;
    sf_fitter *f = NULL;
    sf_fit_options options = sf_fit_options_default();
    options.steps = 1000;
    options.max_gaussians = 3000;
    options.pyramid_levels = 0;
    sf_status status = sf_scene_load(ctx, PROJECT, NULL, &scene);
    if (!status) status = sf_fitter_create(ctx, scene, NULL, &options, &f);
    if (!status) status = sf_fitter_step(f);
    double start = sf_clock(), sent = (double)ctx->cluster->sent, rounds = (double)ctx->cluster->rounds;
    for (int k = 0; k < SLOW_STEPS && !status; k++) status = sf_fitter_step(f);
    job->seconds[rank] = sf_clock() - start;
    job->sent[rank] = (double)ctx->cluster->sent - sent;
    job->rounds[rank] = (double)ctx->cluster->rounds - rounds;
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    return status;
}

static void test_slow_network(void **state) {
    (void)state;
    static slow_job quick, slow;
    assert_int_equal(ranks_run(4, 1, step_slowly, &quick), SF_OK);
    ranks_between = (ranks_network){.latency = 2e-3, .bandwidth = 5e6};
    assert_int_equal(ranks_run(4, 1, step_slowly, &slow), SF_OK);
    ranks_between = (ranks_network){0};
    double sent = (slow.sent[0] + slow.sent[1] + slow.sent[2] + slow.sent[3]) / 4;
    double network = sent / 5e6 + slow.rounds[0] * 2e-3;
    print_message("a step: %.1f ms, over a network %.1f, of which %.1f by bytes and exchanges\n",
                  1e3 * quick.seconds[0] / SLOW_STEPS, 1e3 * slow.seconds[0] / SLOW_STEPS,
                  1e3 * network / SLOW_STEPS);
    assert_true(slow.rounds[0] == quick.rounds[0] && slow.sent[0] == quick.sent[0]);
    assert_true(slow.seconds[0] >= network); /* the slowest rank of an exchange sends more than the mean */
}

/* 5. What is learned of views, and Gaussians that are relocated. */

/* Poses and focal lengths go where those of one rank do, and are the same on all ranks. */
static void test_refined_views(void **state) {
    (void)state;
    fit_job *one = new_job(PROJECT, 12), *two = new_job(PROJECT, 12);
    size_t size;
    one->options.refine_poses = one->options.refine_intrinsics = 1;
    one->options.refine_start = 0;
    one->options.densify_every = 1000;
    two->options = one->options;
    free(fitted(one, 1, 2, &size));
    free(fitted(two, 3, 1, &size));
    double moved = 0, off = 0;
    for (size_t k = 0; k < SEEN_OF_VIEWS; k++) {
        assert_true(two->views[1][k] == two->views[0][k] && two->views[2][k] == two->views[0][k]);
        moved += fabs(one->views[0][k]);
        off += fabs(two->views[0][k] - one->views[0][k]);
    }
    print_message("values of views: %g in sum, %g off\n", moved, off);
    assert_true(moved > 0 && off < 0.05 * moved);
    free(one);
    free(two);
}

static void test_relocate(void **state) {
    (void)state;
    fit_job *job = new_job(PROJECT, 200);
    job->options.densify = SF_DENSIFY_RELOCATE;
    job->options.max_gaussians = 3000;
    free(check_whole(&job->options));
    free(job);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_largest),       cmocka_unit_test(test_sums_and_rows),
        cmocka_unit_test(test_first_steps),   cmocka_unit_test(test_whole_fit),
        cmocka_unit_test(test_tall_picture),  cmocka_unit_test(test_parts),
        cmocka_unit_test(test_slow_network),  cmocka_unit_test(test_checkpoint),
        cmocka_unit_test(test_refined_views), cmocka_unit_test(test_relocate)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
