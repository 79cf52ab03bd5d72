/* row_cameras.c - rows 16 and 17: poses and focal lengths that are off. */
#include <math.h>

#include "disturb.h"
#include "fits.h"

#define STUDIO "sim:studio?width=160&height=120&frames=24"

enum { STEPS = 2500, GAUSSIANS = 4000 };

typedef struct refined {
    test_cameras cameras;
    sf_camera refined[TEST_MOST_VIEWS];
    sf_quality quality;
    sf_fit_progress progress;
} refined;

static void fit_disturbed(sf_context *ctx, test_cameras cameras, sf_fit_options options, refined *r) {
    sf_fitter *fitter;
    r->cameras = cameras;
    sf_scene *scene = test_changed_scene(ctx, STUDIO, test_disturb, &r->cameras);
    options.validate = 0;
    stab_fit fit = stab_fit_scene(ctx, scene, &options, 0, &fitter);
    test_cameras_of(ctx, scene, fitter, &r->cameras, r->refined);
    r->quality = fit.quality, r->progress = fit.progress;
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
}

/* ---- row 16
 * ------------------------------------------------------------------------------------------------
 */

static const struct { double degrees, depth; } noises[] = {{0.1, 0.01}, {0.5, 0.01}, {1, 0.02}, {2, 0.05}};
enum { NOISES = sizeof noises / sizeof *noises };

/* Right poses lose a little where they are free to move. */
static void right_poses(stab_run *run, sf_context *ctx) {
    enum { SEEDS = 4 };
    static refined r;
    double fall = 0;
    for (int seed = 1; seed <= SEEDS; seed++)
        for (int refine = 0; refine < 2; refine++) {
            sf_fit_options options = stab_fit_options(STEPS, GAUSSIANS);
            options.refine_poses = refine, options.seed = seed;
            fit_disturbed(ctx, test_disturbance(0, 0, 1), options, &r);
            fall += (refine ? -1 : 1) * r.quality.psnr / SEEDS;
        }
    stab_at_most(run, fall, 0.05, "dB", "right poses: held-out PSNR lost by refining them, mean of %d seeds",
                 SEEDS);
}

static void poses(stab_run *run) {
    static refined r;
    test_pose_error before[NOISES], after[NOISES];
    sf_context *ctx = test_context();
    for (size_t i = 0; i < NOISES; i++) {
        sf_fit_options options = stab_fit_options(STEPS, GAUSSIANS);
        options.refine_poses = 1;
        fit_disturbed(ctx, test_disturbance(noises[i].degrees, noises[i].depth, 1), options, &r);
        before[i] = test_pose_error_of(r.cameras.given, r.cameras.truth, r.cameras.count);
        after[i] = test_pose_error_of(r.refined, r.cameras.truth, r.cameras.count);
        double turns = 100 * (1 - after[i].degrees / before[i].degrees);
        double places = 100 * (1 - after[i].depths / before[i].depths);
        if (noises[i].degrees == 0.5) {
            stab_at_least(run, turns, 80, "%", "0.5 degrees: recovered of the turns' error");
            stab_at_least(run, places, 80, "%", "1 %% of the depth: recovered of the places' error");
        } else {
            stab_shown(run, turns, "%", "%g degrees: recovered of the turns' error", noises[i].degrees);
            stab_shown(run, places, "%", "%g %% of the depth: recovered of the places' error",
                       100 * noises[i].depth);
        }
    }
    stab_chart_begin(run, "Poses of the studio, disturbed and refined",
                     (stab_axis){"turns given (degrees, rms)", 1}, (stab_axis){"mean error (degrees)", 1});
    stab_series_begin(run, STAB_TEXTBOOK, "textbook: as given");
    for (size_t i = 0; i < NOISES; i++) stab_point(run, noises[i].degrees, before[i].degrees);
    stab_series_begin(run, STAB_OURS, "refined");
    for (size_t i = 0; i < NOISES; i++) stab_point(run, noises[i].degrees, after[i].degrees);
    right_poses(run, ctx);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_16 = {
    .id = "16",
    .failure = "Noisy poses",
    .cure =
        "Refinement of poses with the model (M.6), coarse pictures first, what all corrections share taken "
        "back.",
    .run = poses,
};

/* ---- row 17
 * ------------------------------------------------------------------------------------------------
 */

static void focal_lengths(stab_run *run) {
    static const double zooms[] = {0.95, 1.05};
    static refined r;
    double after[2], psnr[2][2];
    sf_context *ctx = test_context();
    for (int i = 0; i < 2; i++)
        for (int refine = 0; refine < 2; refine++) {
            sf_fit_options options = stab_fit_options(STEPS, GAUSSIANS);
            options.refine_intrinsics = refine;
            fit_disturbed(ctx, test_disturbance(0, 0, zooms[i]), options, &r);
            psnr[i][refine] = r.quality.psnr;
            if (refine) after[i] = r.refined[0].fx / r.cameras.truth[0].fx;
        }
    for (int i = 0; i < 2; i++) {
        double error = fabs(zooms[i] - 1);
        stab_at_least(run, 100 * (1 - fabs(after[i] - 1) / error), 80, "%",
                      "focal length %+.0f %%: recovered of its error", 100 * (zooms[i] - 1));
        stab_shown(run, psnr[i][1], "dB", "focal length %+.0f %%: held-out PSNR", 100 * (zooms[i] - 1));
        stab_textbook(run, psnr[i][0]);
    }
    stab_chart_begin(run, "A focal length that is off",
                     (stab_axis){"focal length given over the true one (1)", 0},
                     (stab_axis){"focal length used over the true one (1)", 0});
    stab_series_begin(run, STAB_TEXTBOOK, "textbook: as given");
    for (int i = 0; i < 2; i++) stab_point(run, zooms[i], zooms[i]);
    stab_series_begin(run, STAB_OURS, "refined");
    for (int i = 0; i < 2; i++) stab_point(run, zooms[i], after[i]);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_17 = {
    .id = "17",
    .failure = "Wrong intrinsics",
    .cure = "The focal lengths are learned with the model, one for all views of a camera.",
    .run = focal_lengths,
};
