/* test_live_poses.c - poses from outside in another convention: the pictures contradict them, and say which.
 */
#include "testing.h"

#include <string.h>

#include "base/linear.h"
#include "live/live_state.h"
#include "pose/rigid.h"

#define SOURCE "sim:studio?width=160&height=120&fps=0&frames=150"

enum { MOST_LOOKS = 60 };

typedef struct given {
    sf_live *live;
    int reading; /* as those of pose_check.c, 4: turned by the view's number */
} given;

/* The camera's centre stays; its axes become those of camera to world R. */
static void put_axes(const double R[9], const double center[3], double R_cw[9], double t_cw[3]) {
    for (int i = 0; i < 9; i++) R_cw[i] = R[3 * (i % 3) + i / 3];
    for (int k = 0; k < 3; k++) t_cw[k] = -sf_dot3(R_cw + 3 * k, center);
}

static sf_status pose_as_given(void *user, int64_t time_ns, double R_cw[9], double t_cw[3],
                               double information[36]) {
    static const double flip[3] = {1, -1, -1};
    const given *g = user;
    const sf_camera *truth = &g->live->input.picture->truth;
    double R[9], q[4], center[3];
    (void)time_ns;
    memset(information, 0, 36 * sizeof *information);
    memcpy(R_cw, truth->R_cw, sizeof truth->R_cw);
    memcpy(t_cw, truth->t_cw, sizeof truth->t_cw);
    sf_camera_center(truth, center);
    for (int i = 0; i < 9; i++) R[i] = R_cw[3 * (i % 3) + i / 3];
    if (g->reading == 1) { /* world to camera where camera to world is wanted */
        memcpy(R_cw, R, sizeof R);
        memcpy(t_cw, center, sizeof center);
    } else if (g->reading == 2) {
        for (int i = 0; i < 9; i++) R[i] *= flip[i % 3];
        put_axes(R, center, R_cw, t_cw);
    } else if (g->reading == 3) { /* w x y z where x y z w is wanted */
        sf_rotation_to_quat(R, q);
        const double read[4] = {q[3], q[0], q[1], q[2]};
        sf_rotation_from_quat(read, R);
        put_axes(R, center, R_cw, t_cw);
    } else if (g->reading == 4) { /* of another frame's direction */
        double angle[3] = {0, 0.5 * (double)(g->live->keyframes.count % 3), 0}, turn[9], turned[9];
        sf_rotation_exp(angle, turn);
        sf_mat3_mul(R, turn, turned);
        put_axes(turned, center, R_cw, t_cw);
    }
    return SF_OK;
}

/* Runs until the poses were judged; the log holds what is said. */
static void judge(int reading) {
    given g = {.reading = reading};
    sf_context *ctx = test_context();
    sf_source *source;
    sf_live_progress p = {0};
    sf_live_options options = sf_live_options_default();
    options.steps_per_frame = 1;
    options.fit.max_gaussians = 1500;
    options.pose = pose_as_given, options.pose_user = &g;
    test_log_clear();
    assert_ok(ctx, sf_source_open(ctx, SOURCE, &source));
    assert_ok(ctx, sf_live_create(ctx, source, &options, &g.live));
    while (p.looked_at < MOST_LOOKS && g.live->pose_check.pairs < 5) {
        assert_ok(ctx, sf_live_step(g.live));
        sf_live_get_progress(g.live, &p);
    }
    print_message("%d: %d pairs after %d frames, %zu matches, agree %zu %zu %zu %zu\n", reading,
                  g.live->pose_check.pairs, (int)p.looked_at, g.live->pose_check.matches,
                  g.live->pose_check.agree[0], g.live->pose_check.agree[1], g.live->pose_check.agree[2],
                  g.live->pose_check.agree[3]);
    assert_int_equal(g.live->pose_check.pairs, 5);
    sf_live_destroy(&g.live);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static void right_poses_are_not_contradicted(void **state) {
    (void)state;
    test_skip_emulated();
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and wrong poses are judged the same way");
    judge(0);
    assert_null(strstr(test_log, "contradict"));
}

static void other_conventions_are_named(void **state) {
    (void)state;
    test_skip_emulated();
    static const char *const names[] = {" % if they are world to camera;",
                                        " % if they are y up and z back, as OpenGL has it;",
                                        " % if they are qw qx qy qz;"};
    for (int i = 0; i < (test_is_quick() ? 1 : 3); i++) {
        judge(i + 1);
        assert_non_null(strstr(test_log, "poses: the pictures contradict them: "));
        assert_non_null(strstr(test_log, names[i]));
    }
}

static void wrong_poses_are_told(void **state) {
    (void)state;
    test_skip_emulated();
    judge(4);
    assert_non_null(strstr(test_log, "poses: the pictures contradict them: "));
    assert_null(strstr(test_log, " % if they are "));
    assert_non_null(strstr(test_log, "wanted are camera to world, x right, y down, z ahead"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(right_poses_are_not_contradicted),
        cmocka_unit_test(other_conventions_are_named),
        cmocka_unit_test(wrong_poses_are_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
