/* test_live.c - a fit of the scene in front of a simulated camera. */
#include "../testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <splatfit/live.h>
#include <splatfit/source.h>

#include "live/live.h"

#define SOURCE "sim:studio?width=64&height=48&fps=0&frames="

/* In real time, faster than slow_pose() lets frames be looked at, and endless: a fit begins late where checks
 * slow it. */
#define FAST_SOURCE "sim:studio?width=64&height=48&fps=100&frames=2000&loop=1"

enum { FRAMES = 40, FEW = 30, LOOKS = 20, SLOW_MS = 25 };

static int frames(void) { return getenv("SPLATFIT_QUICK") ? FEW : FRAMES; }

typedef struct run {
    sf_context *ctx, *source_ctx;
    sf_source *source;
    sf_live *live;
} run;

/* options NULL: the source alone. */
static run open_source(const char *name, int threads, const sf_live_options *options) {
    run r = {.ctx = test_context_threads(threads), .source_ctx = test_context_threads(1)};
    assert_ok(r.source_ctx, sf_source_open(r.source_ctx, name, &r.source));
    if (options) assert_ok(r.ctx, sf_live_create(r.ctx, r.source, options, &r.live));
    return r;
}

static run open_run(int threads, const sf_live_options *options) {
    char name[96];
    snprintf(name, sizeof name, SOURCE "%d", frames());
    return open_source(name, threads, options);
}

static void close_run(run *r) {
    sf_live_destroy(&r->live);
    sf_source_close(&r->source);
    sf_context_destroy(&r->source_ctx);
    sf_context_destroy(&r->ctx);
}

static sf_live_options options_for(int steps_per_frame) {
    sf_live_options o = sf_live_options_default();
    o.own_poses = 1;
    o.steps_per_frame = steps_per_frame;
    o.hold_out = 4;
    o.fit.max_gaussians = 1500;
    return o;
}

static sf_status run_to_end(run *r) {
    sf_status status;
    do status = sf_live_step(r->live);
    while (!status);
    return status;
}

static void fits_what_passes_by(void **state) {
    (void)state;
    sf_live_options options = options_for(6);
    run r = open_run(2, &options);
    sf_live_progress p;
    sf_live_frame frame;
    sf_model *model = NULL;
    assert_int_equal(sf_live_snapshot(r.live, &model), SF_ERR_EMPTY);
    sf_live_get_progress(r.live, &p);
    assert_int_equal(p.state, SF_LIVE_WAITING);
    assert_int_equal(run_to_end(&r), SF_ERR_END);
    sf_live_get_progress(r.live, &p);
    sf_live_get_frame(r.live, &frame);
    print_message("%zu keyframes, %zu Gaussians, held out %.2f dB\n", p.keyframes, p.fit.gaussians,
                  p.held_out_psnr_corrected);
    assert_int_equal(p.looked_at, frames());
    assert_int_equal(p.tracked, frames());
    assert_int_equal(frame.number, frames());
    assert_int_equal(p.lost, 0);
    assert_int_equal(p.frames.given, frames());
    assert_true(p.keyframes >= 10 && p.held_out >= 2 && p.has_fit);
    assert_true(p.fit.step > 100 && p.fit.gaussians > 300);
    assert_true(p.held_out_psnr_corrected > 15);
    assert_ok(r.ctx, sf_live_snapshot(r.live, &model));
    assert_int_equal(sf_model_count(model), p.fit.gaussians);
    sf_model_destroy(&model);
    close_run(&r);
}

/* Every keyframe that is trained on, once: also those that came while another was searched, the newest first.
 */
static void every_keyframe_is_searched(void **state) {
    (void)state;
    test_skip_emulated();
    sf_live_options options = options_for(1);
    run r = open_run(1, &options);
    assert_int_equal(run_to_end(&r), SF_ERR_END);
    sf_keyframe *older = NULL, *newer = NULL;
    for (size_t i = 0; i < r.live->keyframes.count; i++) {
        sf_keyframe *k = &r.live->keyframes.list[i];
        if (k->held_out) continue;
        assert_int_equal(k->searched, 1);
        older = newer, newer = k;
    }
    assert_non_null(older);
    assert_ok(r.ctx, sf_live_take_points(r.live));
    older->searched = newer->searched = 0;
    assert_ok(r.ctx, sf_live_ask_for_points(r.live));
    assert_true(newer->searched && !older->searched);
    assert_ok(r.ctx, sf_live_ask_for_points(r.live)); /* what was found is not taken yet */
    assert_int_equal(older->searched, 0);
    assert_ok(r.ctx, sf_live_take_points(r.live));
    assert_ok(r.ctx, sf_live_ask_for_points(r.live));
    assert_int_equal(older->searched, 1);
    assert_ok(r.ctx, sf_live_take_points(r.live));
    assert_ok(r.ctx, sf_live_ask_for_points(r.live)); /* nothing is left to search */
    assert_int_equal(sf_spawner_idle(r.live->spawning.spawner), 1);
    close_run(&r);
}

/* Of a source that has an automatic one; the studio without a board has none. */
static void exposure_is_locked(void **state) {
    (void)state;
    static const char *const names[] = {"sim:studio-board?width=32&height=24&fps=0&frames=8", SOURCE "8"};
    for (int i = 0; i < 2; i++) {
        sf_live_options options = options_for(1);
        sf_live_progress p;
        run r = {.ctx = test_context_threads(1), .source_ctx = test_context_threads(1)};
        assert_ok(r.source_ctx, sf_source_open(r.source_ctx, names[i], &r.source));
        assert_ok(r.ctx, sf_live_create(r.ctx, r.source, &options, &r.live));
        sf_live_get_progress(r.live, &p);
        assert_int_equal(p.exposure_locked, i ? -1 : 0);
        sf_live_lock_exposure(r.live, 1);
        assert_int_equal(run_to_end(&r), SF_ERR_END);
        sf_live_get_progress(r.live, &p);
        assert_int_equal(p.exposure_locked, i ? -1 : 1);
        close_run(&r);
    }
}

/* A camera with automatic exposure: what its pictures are brighter by is not the model's. */
static void exposures_begin_where_they_are(void **state) {
    (void)state;
    test_skip_emulated();
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and exposure_is_locked has the same source");
    double usual = 0, n = 0, off = 0, apart = 0;
    sf_live_options options = options_for(getenv("SPLATFIT_QUICK") ? 2 : 4);
    char name[96];
    run r = {.ctx = test_context_threads(2), .source_ctx = test_context_threads(1)};
    snprintf(name, sizeof name, "sim:studio-board?width=64&height=48&fps=0&frames=%d", frames() * 3 / 2);
    assert_ok(r.source_ctx, sf_source_open(r.source_ctx, name, &r.source));
    assert_ok(r.ctx, sf_live_create(r.ctx, r.source, &options, &r.live));
    assert_int_equal(run_to_end(&r), SF_ERR_END);
    for (size_t i = 0; i < r.live->keyframes.count; i++)
        if (r.live->keyframes.list[i].told) usual += log(r.live->keyframes.list[i].light), n++;
    assert_true(n > 10);
    for (size_t i = 0; i < r.live->keyframes.count; i++) {
        const sf_keyframe *k = &r.live->keyframes.list[i];
        double gain[3], bias[3], of_light = (log(k->light) - usual / n) / 2.4; /* sRGB's power */
        if (!k->told) continue;
        assert_ok(r.ctx, sf_fitter_get_exposure(r.live->fitter, k->id, gain, bias));
        double error = log((0.4 * gain[1] + bias[1]) / 0.4) - of_light; /* of a grey in the middle */
        off += error * error / n;
        apart = fmax(apart, fabs(of_light));
    }
    print_message("exposures %.3f off in the root mean square, of up to %.2f\n", sqrt(off), apart);
    assert_true(apart > 0.08 && sqrt(off) < 0.25 * apart);
    close_run(&r);
}

/* Where the light is not known, as of most cameras: as in the pictures next to it. */
static void exposures_are_like_the_neighbours(void **state) {
    (void)state;
    test_skip_emulated();
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and this is of numbers");
    static const double of_one[] = {2, 1, 0.5}, of_other[] = {0.5, 1, 0.125}, here[] = {0.1, 0, 0.2},
                        there[] = {-0.3, 0, 0};
    sf_live_options options = options_for(1);
    run r = open_run(1, &options);
    assert_int_equal(run_to_end(&r), SF_ERR_END);
    sf_live *live = r.live;
    size_t at = 1, last = live->keyframes.count - 1;
    while (at < last && !(live->keyframes.list[at].held_out && live->keyframes.list[at - 1].told &&
                          live->keyframes.list[at + 1].told))
        at++;
    assert_true(at < last);
    for (size_t i = 0; i <= last; i++) live->keyframes.list[i].light = NAN;
    assert_ok(r.ctx, sf_fitter_set_exposure(live->fitter, live->keyframes.list[at - 1].id, of_one, here));
    assert_ok(r.ctx, sf_fitter_set_exposure(live->fitter, live->keyframes.list[at + 1].id, of_other, there));
    double gain[3], bias[3];
    sf_keyframe_exposure(&live->keyframes, live->fitter, live->keyframes.list[at].id, gain, bias);
    for (int c = 0; c < 3; c++) {
        assert_true(fabs(gain[c] - sqrt(of_one[c] * of_other[c])) < 1e-12);
        assert_true(fabs(bias[c] - (here[c] + there[c]) / 2) < 1e-12);
    }
    /* Four times the light is 4^(1 / 2.4) of the bytes. */
    live->keyframes.list[at].light = 4;
    live->keyframes.list[at - 1].light = 1;
    live->keyframes.list[at + 1].light = 1;
    for (size_t i = 0; i <= last; i++)
        if (i + 1 < at || i > at + 1) live->keyframes.list[i].light = NAN;
    sf_keyframe_exposure(&live->keyframes, live->fitter, live->keyframes.list[at].id, gain, bias);
    assert_true(fabs(gain[1] - pow(4, 1 / 2.4)) < 1e-9);
    close_run(&r);
}

/* Of a source that is not in real time. */
static void runs_can_be_repeated(void **state) {
    (void)state;
    sf_live_options options = options_for(getenv("SPLATFIT_QUICK") ? 1 : 3);
    sf_model *models[2];
    run runs[2];
    for (int i = 0; i < 2; i++) {
        runs[i] = open_run(i ? 3 : 1, &options);
        assert_int_equal(run_to_end(&runs[i]), SF_ERR_END);
        assert_ok(runs[i].ctx, sf_live_snapshot(runs[i].live, &models[i]));
    }
    sf_live_progress p[2];
    for (int i = 0; i < 2; i++) sf_live_get_progress(runs[i].live, &p[i]);
    assert_true(isfinite(p[0].held_out_psnr) &&
                p[0].held_out_psnr == p[1].held_out_psnr); /* looked at in the end */
    assert_true(p[0].first_psnr == p[1].first_psnr);
    size_t n = sf_model_count(models[0]);
    assert_int_equal(n, sf_model_count(models[1]));
    float *means[2];
    for (int i = 0; i < 2; i++) {
        means[i] = malloc(n * 3 * sizeof **means);
        assert_non_null(means[i]);
        sf_gaussians to = {.means = means[i]};
        assert_int_equal(sf_model_get(models[i], 0, n, &to), SF_OK);
    }
    assert_memory_equal(means[0], means[1], n * 3 * sizeof **means);
    for (int i = 0; i < 2; i++) {
        free(means[i]);
        sf_model_destroy(&models[i]);
        close_run(&runs[i]);
    }
}

static void is_paused_and_reset(void **state) {
    (void)state;
    sf_live_options options = options_for(2);
    run r = open_run(2, &options);
    sf_live_progress before, p;
    do {
        assert_ok(r.ctx, sf_live_step(r.live));
        sf_live_get_progress(r.live, &p);
    } while (!p.has_fit || p.fit.step < 5);
    before = p;
    print_message("%llu frames before the fit\n", (unsigned long long)p.looked_at);
    sf_live_pause(r.live, 1);
    while (p.looked_at < before.looked_at + 5) {
        assert_ok(r.ctx, sf_live_step(r.live));
        sf_live_get_progress(r.live, &p);
    }
    assert_int_equal(p.fit.step, before.fit.step);
    assert_int_equal(p.keyframes, before.keyframes);
    assert_true(p.paused && p.tracked > before.tracked);
    sf_live_pause(r.live, 0);
    sf_live_reset(r.live);
    sf_live_get_progress(r.live, &p);
    assert_true(!p.has_fit && p.keyframes == 0 && p.state == SF_LIVE_WAITING);
    assert_int_equal(run_to_end(&r), SF_ERR_END);
    sf_live_get_progress(r.live, &p);
    assert_true(p.has_fit && p.keyframes > 3);
    close_run(&r);
}

static void keeps_no_more_keyframes_than_allowed(void **state) {
    (void)state;
    sf_live_options options = options_for(1);
    options.keyframes_most = 12;
    options.keyframe_gap = 0.01;
    run r = open_run(2, &options);
    sf_scene_info info;
    sf_live_progress p;
    assert_int_equal(run_to_end(&r), SF_ERR_END);
    sf_live_get_progress(r.live, &p);
    sf_scene_get_info(sf_live_scene(r.live), &info);
    assert_int_equal(p.keyframes, 12);
    assert_int_equal(info.views, 12);
    close_run(&r);
}

/* The frame's own camera, late. */
static sf_status slow_pose(void *live, int64_t time_ns, double R_cw[9], double t_cw[3],
                           double information[36]) {
    (void)time_ns;
    const sf_camera *truth = &(*(sf_live *const *)live)->input.picture->truth;
    memcpy(R_cw, truth->R_cw, sizeof truth->R_cw);
    memcpy(t_cw, truth->t_cw, sizeof truth->t_cw);
    for (int k = 0; k < 36; k++) information[k] = k % 7 ? 0 : 1e8;
    nanosleep(&(struct timespec){.tv_nsec = SLOW_MS * 1000000L}, NULL);
    return SF_OK;
}

/* A machine that is slower than its camera: a frame always waits. */
static void fits_between_slow_looks(void **state) {
    (void)state;
    sf_live_options options = options_for(0);
    sf_live *live = NULL;
    sf_live_progress p = {0};
    options.track_rate = 1000;
    options.own_poses = 0;
    options.pose = slow_pose;
    options.pose_user = &live;
    run r = open_source(FAST_SOURCE, 1, &options);
    live = r.live;
    uint64_t looks = 0;
    for (int since = 0; since < LOOKS; since += p.has_fit && p.looked_at > looks) {
        int64_t steps = p.fit.step;
        looks = p.looked_at;
        while (p.looked_at == looks) {
            assert_ok(r.ctx, sf_live_step(r.live));
            sf_live_get_progress(r.live, &p);
        }
        if (since) assert_true(p.fit.step > steps);
    }
    close_run(&r);
}

static void is_cancelled(void **state) {
    (void)state;
    sf_live_options options = options_for(1);
    run r = open_run(1, &options);
    assert_ok(r.ctx, sf_live_step(r.live));
    sf_live_cancel(r.live);
    assert_int_equal(sf_live_step(r.live), SF_ERR_CANCELLED);
    close_run(&r);
}

static void refuses_options_by_name(void **state) {
    (void)state;
    static const struct {
        size_t offset;
        double value;
        int kind; /* 0 int, 1 double, 2 int64_t */
        const char *name;
    } cases[] = {{offsetof(sf_live_options, track_rate), 0, 1, "track_rate"},
                 {offsetof(sf_live_options, downscale), 17, 0, "downscale"},
                 {offsetof(sf_live_options, keyframes_most), 7, 2, "keyframes_most"},
                 {offsetof(sf_live_options, hold_out), 1, 0, "hold_out"},
                 {offsetof(sf_live_options, keyframe_gap), 2, 1, "keyframe_gap"},
                 {offsetof(sf_live_options, steps_per_frame), -1, 0, "steps_per_frame"},
                 {offsetof(sf_live_options, scale), -1, 1, "scale"},
                 {offsetof(sf_live_options, find_lens), 1, 0, "find_lens"},
                 {offsetof(sf_live_options, own_poses), 0, 0, "poses"}};
    run r = open_run(1, NULL);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_live_options o = options_for(1);
        o.from_pictures = 0;
        o.lens.fx = 60;
        char *at = (char *)&o + cases[i].offset;
        if (cases[i].kind == 0) *(int *)at = (int)cases[i].value;
        if (cases[i].kind == 1) *(double *)at = cases[i].value;
        if (cases[i].kind == 2) *(int64_t *)at = (int64_t)cases[i].value;
        assert_int_equal(sf_live_create(r.ctx, r.source, &o, &r.live), SF_ERR_ARGUMENT);
        assert_null(r.live);
        assert_memory_equal(sf_last_error(r.ctx), cases[i].name, strlen(cases[i].name));
    }
    close_run(&r);
}

/* A new Gaussian is no larger in a keyframe than 8 px, whether its middle is in the picture or beside it. */
static void new_gaussians_are_not_large_in_keyframes(void **state) {
    (void)state;
    test_skip_emulated();
    sf_keyframe keyframes[2] = {{.pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .t = {0, 0, 1}}},
                                {.pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .t = {0, 0, 8}}}};
    const sf_keyframes both = {.list = keyframes, .count = 2};
    const sf_camera camera = {.width = 64, .height = 48, .fx = 64, .fy = 64, .cx = 32, .cy = 24};
    const struct {
        float xyz[3], radius, limited;
    } cases[] = {
        {{0, 0, 0}, 0.1f, 0.1f},      /* 6.4 px of the near one */
        {{0, 0, 0}, 0.5f, 0.125f},    /* 32 px */
        {{0.6f, 0, 0}, 0.3f, 0.125f}, /* beside its picture, and yet in it */
        {{3, 0, 0}, 0.3f, 0.3f},      /* too far beside it; 2.4 px of the other */
        {{3, 0, 0}, 3, 0.125f},       /* so large that it is not */
        {{0, 0, -0.95f}, 0.3f, 0.3f}, /* nearer than the near plane */
        {{0, 0, -2}, 1, 0.75f},       /* behind it, before the other */
        {{0, 0, -20}, 1, 1},          /* behind both */
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_true(fabsf(sf_limit_radius(&both, &camera, 0.1, cases[i].xyz, cases[i].radius) -
                          cases[i].limited) < 1e-6f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fits_what_passes_by),
        cmocka_unit_test(runs_can_be_repeated),
        cmocka_unit_test(is_paused_and_reset),
        cmocka_unit_test(keeps_no_more_keyframes_than_allowed),
        cmocka_unit_test(is_cancelled),
        cmocka_unit_test(refuses_options_by_name),
        cmocka_unit_test(every_keyframe_is_searched),
        cmocka_unit_test(exposure_is_locked),
        cmocka_unit_test(exposures_begin_where_they_are),
        cmocka_unit_test(exposures_are_like_the_neighbours),
        cmocka_unit_test(fits_between_slow_looks),
        cmocka_unit_test(new_gaussians_are_not_large_in_keyframes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
