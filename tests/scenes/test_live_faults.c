/* test_live_faults.c - a live fit of a simulated camera to which things happen: it says so, finds its pose
 * again, and forgets nothing of what it knew. In steps a frame, not in real time: each run can be repeated.
 */
#include "../testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <splatfit/calibrate.h>
#include <splatfit/live.h>

/* 12 frames a second of a walk of a minute; for the first 15 s tags of the board are in view, then for 20 s
 * none. */
#define SOURCE "sim:studio-board?width=240&height=180&fps=0&frames=720"

enum { STEPS_PER_FRAME = 3, FRAMES_A_SECOND = 12, MOST_KEPT = 16, LOOKS = 4 };

#define TAG_M      0.08
#define MOST_FALL  1.0  /* dB */
#define LOOK_EVERY 0.75 /* s */
#define BEFORE     3.0  /* s: figures are means over so long, single steps come and go by more than a dB */
#define MOST_WRONG 1.5  /* degrees, of a pose that is found again, with the map's own drift, */
#define FOUND_FOR  2.0  /* for so long (s): later it may drift */
#define DEGREES    57.29577951308232

typedef struct fault_case {
    const char *name, *option;
    double from, to, end; /* s of the stream; the fault's, and how long it is played */
    const char *said;     /* part of a line of the log; NULL: nothing need be */
    int lost;             /* the pose is */
    double found_within;  /* s after the fault */
    int pictures;         /* there is neither a board nor a lens: all is from pictures alone */
} fault_case;

/* Those on unknown ground are found again when the camera comes back to what the model knows. */
static const fault_case
    covered = {"covered lens, the board in view after",
               "&black=10:12",
               10,
               12,
               24,
               "nothing is to be seen: is the lens covered?",
               1,
               0.5,
               0},
    covered_away = {"covered lens, no board in view",
                    "&black=17:17.6",
                    17,
                    17.6,
                    24,
                    "nothing is to be seen: is the lens covered?",
                    1,
                    1,
                    0},
    covered_long = {"covered lens, new ground after",
                    "&black=17:19",
                    17,
                    19,
                    38,
                    "nothing is to be seen: is the lens covered?",
                    1,
                    18,
                    0},
    blurred = {"5 s of blur, the board in view before and after",
               "&smear=8:13",
               8,
               13,
               24,
               "the pictures are blurred",
               0, /* landmarks are found in them all the same */
               0.5,
               0},
    jumped = {"jump", "&jump=17", 17, 17.1, 38, NULL, 1, 18, 0},
    crossed = {"moving object in a tenth of the frames", "&mover=10:12.4", 10, 12.4, 24, NULL, 0, 0.5, 0},
    unplugged =
        {"unplugged", "&unplug=10:15", 10, 15, 24, "no frame for 2 s: is the camera there?", 0, 0.5, 0},
    covered_alone = {"covered lens, without a board",
                     "&black=26:26.6",
                     26,
                     26.6,
                     34,
                     "nothing is to be seen: is the lens covered?",
                     1,
                     1,
                     1},
    blurred_alone =
        {"3 s of blur, without a board", "&smear=26:29", 26, 29, 38, "the pictures are blurred", 0, 0.5, 1},
    crossed_alone = {"moving object, without a board", "&mover=26:28.4", 26, 28.4, 36, NULL, 0, 0.5, 1};

enum { PAIRS = 600 };

typedef struct stream {
    sf_context *ctx, *source_ctx;
    sf_source *source;
    sf_board *board;
    sf_live *live;
    sf_renderer *renderer;
    sf_live_frame frame;
    int ended;
    sf_camera found[PAIRS], truth[PAIRS]; /* before the fault */
    size_t pairs;
    sf_similarity to_truth;
} stream;

static stream open_stream(const char *option, double seconds, int pictures) {
    stream s = {.ctx = test_context_threads(0), .source_ctx = test_context_threads(1)};
    char name[128];
    snprintf(name, sizeof name, SOURCE "%s", option);
    sf_live_options o = sf_live_options_default();
    assert_ok(s.source_ctx, sf_source_open(s.source_ctx, name, &s.source));
    assert_ok(s.ctx, sf_board_open(s.ctx, "a3-36h11", TAG_M, &s.board));
    o.board = pictures ? NULL : s.board;
    o.find_lens = pictures;
    o.steps_per_frame = STEPS_PER_FRAME;
    o.hold_out = 4;
    o.fit.steps = (int64_t)(seconds * FRAMES_A_SECOND * STEPS_PER_FRAME);
    assert_ok(s.ctx, sf_live_create(s.ctx, s.source, &o, &s.live));
    assert_ok(s.ctx, sf_renderer_create(s.ctx, &s.renderer));
    return s;
}

static void close_stream(stream *s) {
    sf_live_destroy(&s->live);
    sf_renderer_destroy(&s->renderer);
    sf_board_close(&s->board);
    sf_source_close(&s->source);
    sf_context_destroy(&s->source_ctx);
    sf_context_destroy(&s->ctx);
}

static double now(const stream *s) { return 1e-9 * (double)s->frame.time_ns; }

/* To the next frame, and through the steps before it. */
static void play(stream *s) {
    uint64_t number = s->frame.number;
    while (!s->ended && s->frame.number == number) {
        sf_status status = sf_live_step(s->live);
        s->ended = status == SF_ERR_END;
        if (!s->ended) assert_ok(s->ctx, status);
        sf_live_get_frame(s->live, &s->frame);
    }
}

/* Before the fault: poses in the map, and true ones. */
static void note_pair(stream *s) {
    if (s->frame.from == SF_POSE_NONE || s->pairs == PAIRS) return;
    s->found[s->pairs] = s->frame.camera, s->truth[s->pairs++] = s->frame.truth;
}

/* How far the pose is off, degrees: of a map from pictures, in the world that the poses before tell. */
static double wrong_by(const stream *s, int pictures) {
    sf_camera c = s->frame.camera;
    double trace = 0;
    if (pictures) sf_camera_transform(&c, &s->to_truth);
    for (int k = 0; k < 9; k++) trace += s->frame.truth.R_cw[k] * c.R_cw[k];
    return acos(fmin(fmax((trace - 1) / 2, -1), 1)) * DEGREES;
}

/* dB of a keyframe, at the pose as tracked, with exposure corrected: the simulated one is automatic. */
static double psnr_of(const stream *s, const sf_view_info *view) {
    size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
    float *truth = malloc(3 * pixels * sizeof *truth), *drawn = malloc(3 * pixels * sizeof *drawn);
    sf_image_out out = {.rgb = drawn};
    sf_quality quality;
    assert_true(truth && drawn);
    assert_ok(s->ctx, sf_scene_get_pixels(sf_live_scene(s->live), view->id, truth, NULL));
    assert_ok(s->ctx, sf_live_render(s->live, &view->camera, &out));
    assert_ok(s->ctx,
              sf_compare(s->renderer, view->camera.width, view->camera.height, drawn, truth, NULL, &quality));
    free(truth);
    free(drawn);
    return quality.psnr_corrected;
}

/* The keyframes held out so far. */
typedef struct kept {
    uint32_t ids[MOST_KEPT];
    size_t count;
} kept;

static kept keep(const stream *s) {
    kept k = {.count = 0};
    sf_view_info view;
    for (size_t i = 0; !sf_scene_get_view(sf_live_scene(s->live), i, &view) && k.count < MOST_KEPT; i++)
        if (view.split == SF_SPLIT_TEST) k.ids[k.count++] = view.id;
    return k;
}

static double mean_psnr(const stream *s, const kept *k) {
    double sum = 0;
    sf_view_info view;
    for (size_t i = 0; !sf_scene_get_view(sf_live_scene(s->live), i, &view); i++)
        for (size_t j = 0; j < k->count; j++)
            if (k->ids[j] == view.id) sum += psnr_of(s, &view) / (double)k->count;
    return sum;
}

/* Means over the last looks, LOOK_EVERY apart. */
typedef struct figure {
    double last[LOOKS], next;
    size_t count;
} figure;

static double mean_of(const figure *f) {
    double sum = 0;
    for (size_t i = 0; i < LOOKS; i++) sum += f->last[i] / LOOKS;
    return f->count < LOOKS ? NAN : sum;
}

/* Whether there is a new mean. */
static int look(const stream *s, const kept *k, figure *f) {
    if (now(s) < f->next) return 0;
    f->next = now(s) + LOOK_EVERY;
    f->last[f->count++ % LOOKS] = mean_psnr(s, k);
    return f->count >= LOOKS;
}

static void recovers(void **state) {
    const fault_case *c = *state;
    if (getenv("SPLATFIT_QUICK") && c != &covered) test_skip("SPLATFIT_QUICK is set");
    stream s = open_stream(c->option, c->end, c->pictures);
    sf_live_progress p;
    figure before = {.next = c->from - BEFORE}, after = {.next = c->from};
    double found = NAN, least = INFINITY, worst = 0, mean;
    test_log_clear();
    while (now(&s) < c->from - BEFORE && !s.ended) play(&s);
    kept k = keep(&s);
    assert_true(k.count >= 2);
    for (; now(&s) < c->from && !s.ended; play(&s)) {
        note_pair(&s);
        (void)look(&s, &k, &before);
    }
    assert_int_equal(sf_similarity_between(s.found, s.truth, s.pairs, &s.to_truth), 1);
    double known = mean_of(&before);
    assert_true(isfinite(known));
    sf_live_get_progress(s.live, &p);
    size_t keyframes = p.keyframes;
    assert_int_equal(p.lost, 0);
    for (; now(&s) < c->to && !s.ended; play(&s))
        if (look(&s, &k, &after) && (mean = mean_of(&after)) < least) least = mean;
    sf_live_get_progress(s.live, &p);
    size_t meanwhile = p.keyframes - keyframes;
    for (; now(&s) < c->end && !s.ended; play(&s)) {
        if (look(&s, &k, &after) && (mean = mean_of(&after)) < least) least = mean;
        sf_live_get_progress(s.live, &p);
        if (p.state != SF_LIVE_TRACKING || s.frame.from == SF_POSE_NONE) continue;
        if (isnan(found)) found = now(&s) - c->to;
        if (now(&s) < c->to + found + FOUND_FOR) worst = fmax(worst, wrong_by(&s, c->pictures));
    }
    print_message("%s: %zu held out before: %.2f dB, %.2f at the least since, %.2f in the end; %zu keyframes "
                  "meanwhile; lost %llu times, found %.1f s after, poses then off by %.2f degrees at most\n",
                  c->name, k.count, known, least, mean_of(&after), meanwhile, (unsigned long long)p.lost,
                  found, worst);
    assert_true(known - least < MOST_FALL);
    assert_true(found < c->found_within);
    assert_true(worst < MOST_WRONG);
    assert_int_equal(p.lost > 0, c->lost);
    assert_int_equal(p.frames.reopened, c == &unplugged);
    if (c->said) test_assert_contains(test_log, c->said, __FILE__, __LINE__);
    close_stream(&s);
}

#define CASE(c)                                                                                              \
    { #c, recovers, NULL, NULL, (void *)&c }

int main(void) {
    const struct CMUnitTest tests[] = {CASE(jumped),       CASE(covered),       CASE(blurred),
                                       CASE(crossed),      CASE(unplugged),     CASE(covered_away),
                                       CASE(covered_long), CASE(covered_alone), CASE(blurred_alone),
                                       CASE(crossed_alone)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
