/* row_poison.c - row 5: one value that is not finite, huge or denormal, of a Gaussian, a picture or a pose.
 */
#include <stdlib.h>
#include <string.h>

#include "lab.h"

enum { VICTIM = 7 };

/* The scene with Gaussian VICTIM in the middle of the picture, before most others. */
static test_ref_scene scene_with_victim(void) {
    test_ref_scene scene = test_random_scene(71, 40, 3, 40, 30);
    test_random_place(&scene, VICTIM, (const double[]){0.01, 0.02, 1});
    scene.gaussians.logit_opacities[VICTIM] = 1;
    for (size_t k = 0; k < 3; k++) scene.gaussians.log_scales[3 * VICTIM + k] = -3 - 0.5 * (double)k;
    return scene;
}

static void copy_gaussians(const test_ref_scene *from, size_t first, size_t count, test_ref_scene *to,
                           size_t at) {
    test_ref_array source[TEST_REF_ARRAYS], target[TEST_REF_ARRAYS];
    test_ref_list(&from->gaussians, from->sh_degree, source);
    test_ref_list(&to->gaussians, from->sh_degree, target);
    for (int a = 0; a < TEST_REF_ARRAYS; a++)
        memcpy(target[a].values + at * target[a].width, source[a].values + first * source[a].width,
               count * source[a].width * sizeof(double));
}

static test_ref_scene without_victim(const test_ref_scene *scene) {
    test_ref_scene rest = *scene;
    rest.count = scene->count - 1;
    rest.gaussians = test_ref_gaussians_create(rest.count, rest.sh_degree);
    copy_gaussians(scene, 0, VICTIM, &rest, 0);
    copy_gaussians(scene, VICTIM + 1, rest.count - VICTIM, &rest, VICTIM);
    return rest;
}

/* ---- one value of a Gaussian ----------------------------------------------------------------------------
 */

static int same(const void *a, const void *b, size_t bytes) { return !memcmp(a, b, bytes); }

/* Whether the picture and the gradients of the others are as if the victim were not there, and its own 0. */
static int victim_is_left_out(const test_outcome *got, const test_outcome *rest) {
    float *from[TEST_REF_ARRAYS], *to[TEST_REF_ARRAYS];
    test_ref_array shape[TEST_REF_ARRAYS];
    int out = same(got->rgb, rest->rgb, 3 * got->pixels * sizeof(float)) &&
              same(got->transmittance, rest->transmittance, got->pixels * sizeof(float)) &&
              same(got->depth, rest->depth, got->pixels * sizeof(float)) &&
              same(got->pose, rest->pose, sizeof got->pose);
    test_gaussians_list(&got->gradient, from);
    test_gaussians_list(&rest->gradient, to);
    test_ref_list(&(test_ref_gaussians){0}, got->sh_degree, shape);
    for (int a = 0; a < TEST_REF_ARRAYS && out; a++) {
        size_t width = shape[a].width, after = VICTIM + 1;
        out = same(from[a], to[a], VICTIM * width * sizeof(float)) &&
              same(from[a] + after * width, to[a] + VICTIM * width,
                   (got->count - after) * width * sizeof(float));
        for (size_t k = 0; k < width; k++) out &= from[a][VICTIM * width + k] == 0;
    }
    return out;
}

/* What was seen of the values that were poisoned. */
typedef struct poisoned {
    size_t not_left_out, not_zero, not_finite, tried;
    /* of the values that were NaN: their numbers, and the share of the picture that changed, also without a
     * check */
    size_t nan_count, number[64];
    double share[64], textbook[64];
} poisoned;

/* Pixels, as a share, that differ by more than 1/255 from what they are without the victim, or are not
 * finite. */
static double share_changed(size_t pixels, const float *ours, const double *textbook,
                            const test_outcome *rest) {
    size_t changed = 0;
    for (size_t i = 0; i < pixels; i++)
        for (size_t k = 3 * i; k < 3 * i + 3; k++) {
            double value = ours ? (double)ours[k] : textbook[k];
            if (fabs(value - (double)rest->rgb[k]) <= 1.0 / 255) continue;
            changed++;
            break;
        }
    return (double)changed / (double)pixels;
}

/* What the reference, which checks nothing, makes of it. */
static double textbook_share(const test_ref_scene *scene, const test_outcome *rest) {
    test_ref_frame frame;
    test_ref_render(scene, &frame);
    double share = share_changed(rest->pixels, NULL, frame.rgb, rest);
    test_ref_frame_free(&frame);
    return share;
}

/* A poison is what a Gaussian is left out for; or 0 by another name; or shown, whatever that may be. */
typedef enum poison_kind { NOT_FINITE, DENORMAL, HUGE_VALUE } poison_kind;

static void try_value(const stab_lab *lab, const test_ref_scene *scene, double *at, poison_kind kind,
                      double poison, const test_outcome *rest, poisoned *p) {
    double before = *at;
    *at = poison;
    test_outcome o = test_outcome_of(lab->ctx, lab->renderer, scene);
    p->tried++;
    p->not_finite += !test_outcome_is_finite(&o);
    if (kind == NOT_FINITE) {
        p->not_left_out += !victim_is_left_out(&o, rest);
        if (isnan(poison)) {
            p->share[p->nan_count] = share_changed(o.pixels, o.rgb, NULL, rest);
            p->textbook[p->nan_count++] = textbook_share(scene, rest);
        }
    }
    if (kind == DENORMAL) {
        *at = 0;
        test_outcome zero = test_outcome_of(lab->ctx, lab->renderer, scene);
        p->not_zero += test_outcome_apart(&o, &zero) != NULL;
        test_outcome_free(&zero);
    }
    *at = before;
    test_outcome_free(&o);
}

static void poison_values(const stab_run *run, const stab_lab *lab, poisoned *p) {
    static const struct {
        poison_kind kind;
        double value;
    } poisons[] = {{NOT_FINITE, NAN},  {NOT_FINITE, INFINITY}, {NOT_FINITE, -INFINITY},
                   {HUGE_VALUE, 1e38}, {HUGE_VALUE, -1e38},    {DENORMAL, 1e-40}};
    test_ref_scene scene = scene_with_victim(), without = without_victim(&scene);
    test_outcome rest = test_outcome_of(lab->ctx, lab->renderer, &without);
    test_ref_array list[TEST_REF_ARRAYS];
    size_t first = 0;
    test_ref_list(&scene.gaussians, scene.sh_degree, list);
    for (int a = 0; a < TEST_REF_ARRAYS; first += list[a++].width) {
        size_t width = list[a].width, step = width > 4 ? stab_count(run, 1, 1, 7) : 1;
        for (size_t k = 0; k < width; k += step) {
            p->number[p->nan_count] = first + k;
            for (size_t i = 0; i < sizeof poisons / sizeof *poisons; i++)
                try_value(lab, &scene, &list[a].values[VICTIM * width + k], poisons[i].kind, poisons[i].value,
                          &rest, p);
        }
    }
    test_outcome_free(&rest);
    test_ref_gaussians_free(&scene.gaussians);
    test_ref_gaussians_free(&without.gaussians);
}

/* Where 1e38 has no place in the picture, or no bound: the Gaussian is left out. */
static size_t huge_out_of_place(const stab_lab *lab) {
    static const struct {
        int array;
        size_t component;
        double value;
    } cases[] = {
        {0, 0, 1e38},  {0, 0, -1e38},               /* beside */
        {0, 1, 1e38},  {0, 1, -1e38},               /* above, below */
        {0, 2, -1e38},                              /* behind */
        {2, 0, 1e38},  {2, 1, 1e38},  {2, 2, 1e38}, /* exp() of it is infinite */
        {3, 0, -1e38},                              /* invisible */
    };
    test_ref_scene scene = scene_with_victim(), without = without_victim(&scene);
    test_outcome rest = test_outcome_of(lab->ctx, lab->renderer, &without);
    test_ref_array list[TEST_REF_ARRAYS];
    poisoned p = {0};
    test_ref_list(&scene.gaussians, scene.sh_degree, list);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        const test_ref_array *array = &list[cases[k].array];
        try_value(lab, &scene, &array->values[VICTIM * array->width + cases[k].component], NOT_FINITE,
                  cases[k].value, &rest, &p);
    }
    test_outcome_free(&rest);
    test_ref_gaussians_free(&scene.gaussians);
    test_ref_gaussians_free(&without.gaussians);
    return p.not_left_out;
}

/* A quaternion that is too short has no direction. */
static size_t without_direction(const stab_lab *lab) {
    static const double norms[] = {0, 1e-30, 1e-14};
    test_ref_scene scene = scene_with_victim(), without = without_victim(&scene);
    test_outcome rest = test_outcome_of(lab->ctx, lab->renderer, &without);
    size_t changed = 0;
    for (size_t n = 0; n < sizeof norms / sizeof *norms; n++) {
        const double quat[4] = {0.5, -0.5, 0.5, 0.5};
        for (size_t k = 0; k < 4; k++) scene.gaussians.quats[4 * VICTIM + k] = quat[k] * norms[n];
        test_outcome o = test_outcome_of(lab->ctx, lab->renderer, &scene);
        changed += !victim_is_left_out(&o, &rest);
        test_outcome_free(&o);
    }
    test_outcome_free(&rest);
    test_ref_gaussians_free(&scene.gaussians);
    test_ref_gaussians_free(&without.gaussians);
    return changed;
}

/* ---- a pixel of the gradient, a pose, a fit -------------------------------------------------------------
 */

/* One pixel of dL/dimage: gradients that are not finite, and gradients that are 0 for most others. */
static void poison_pixel(const stab_lab *lab, size_t *not_finite, size_t *dead) {
    static const float poisons[] = {NAN, INFINITY, -INFINITY, 1e38f};
    test_ref_scene scene = test_random_scene(8, 60, 2, 40, 30);
    for (size_t p = 0; p < sizeof poisons / sizeof *poisons; p++) {
        float *d_rgb = test_d_rgb(40 * 30);
        d_rgb[3 * (15 * 40 + 20)] = poisons[p];
        test_outcome o = test_outcome_with(lab->ctx, lab->renderer, &scene, d_rgb);
        size_t live = 0;
        for (size_t i = 0; i < o.count; i++) live += o.gradient.means[3 * i] != 0;
        *not_finite += !test_outcome_is_finite(&o);
        *dead += live <= o.count / 10;
        test_outcome_free(&o);
        free(d_rgb);
    }
    test_ref_gaussians_free(&scene.gaussians);
}

/* Cameras with one number that is not finite that a scene took. */
static size_t poison_poses(sf_scene *scene) {
    static const double poisons[] = {NAN, INFINITY, -INFINITY, 1e38};
    static uint8_t rgb[3 * 40 * 30];
    sf_pixels pixels = {.rgb = rgb, .stride = 3 * 40};
    size_t taken = 0;
    for (size_t p = 0; p < sizeof poisons / sizeof *poisons; p++)
        for (int k = 0; k < 9 + 3; k++) {
            sf_camera camera = test_camera_around(0, 3, 40, 30);
            if (k >= 9 && isfinite(poisons[p])) continue; /* 1e38 is far off, but a place */
            *(k < 9 ? &camera.R_cw[k] : &camera.t_cw[k - 9]) = poisons[p];
            taken += sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL) == SF_OK;
        }
    return taken;
}

/* A few steps from a model with a poisoned Gaussian: Gaussians of the result that are not finite. */
static size_t fit_poisoned(const stab_lab *lab, sf_scene *scene, uint64_t *skipped) {
    test_ref_scene first = scene_with_victim();
    sf_fit_options options = sf_fit_options_default();
    sf_fit_progress progress;
    sf_fitter *fitter;
    first.gaussians.means[3 * VICTIM] = NAN;
    sf_model *model = test_model_of(lab->ctx, &first), *result;
    options.steps = 8, options.validate = 0, options.prune_opacity = 0, options.densify_rate = 0;
    assert_ok(lab->ctx, sf_fitter_create(lab->ctx, scene, model, &options, &fitter));
    assert_ok(lab->ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_fitter_get_progress(fitter, &progress);
    assert_ok(lab->ctx, sf_fitter_snapshot(fitter, &result));
    size_t count = sf_model_count(result), bad = 0;
    test_outcome room = {.gradient = test_gaussians_create(count, 3)};
    assert_ok(lab->ctx, sf_model_get(result, 0, count, &room.gradient));
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < 3; k++)
            bad += !isfinite(room.gradient.means[3 * i + k]) || !isfinite(room.gradient.sh[48 * i + k]);
    *skipped = progress.skipped_values;
    test_gaussians_free(&room.gradient);
    sf_model_destroy(&model);
    sf_model_destroy(&result);
    sf_fitter_destroy(&fitter);
    test_ref_gaussians_free(&first.gaussians);
    return bad;
}

static void draw_shares(stab_run *run, const poisoned *p) {
    stab_chart_begin(
        run, "What one NaN in one Gaussian of 40 changes, by the value that it stands in",
        (stab_axis){"value: mean 0, quaternion 3, scale 7, opacity 10, SH from 11 on (number)", 0},
        (stab_axis){"pixels changed by more than 1/255 (%)", 0});
    for (int line = STAB_OURS; line <= STAB_TEXTBOOK; line++) {
        stab_series_begin(run, (stab_line)line, line == STAB_OURS ? "ours" : "without a check");
        for (size_t k = 0; k < p->nan_count; k++)
            stab_point(run, (double)p->number[k], 100 * (line == STAB_OURS ? p->share[k] : p->textbook[k]));
    }
}

static void report_gaussian(stab_run *run, const stab_lab *lab) {
    poisoned p = {0};
    poison_values(run, lab, &p);
    draw_shares(run, &p);
    stab_at_most(run, (double)p.not_left_out, 0, "",
                 "%zu poisoned values: others changed by a bit for a NaN or Inf", p.tried);
    stab_at_most(run, (double)p.not_zero, 0, "", "denormals that are not 0");
    stab_at_most(run, (double)p.not_finite, 0, "", "pictures and gradients that are not finite");
    stab_at_most(run, 100 * stab_most_of(p.share, p.nan_count), 0, "%",
                 "largest share of a picture that one NaN changes");
    stab_textbook(run, 100 * stab_most_of(p.textbook, p.nan_count));
    stab_at_most(run, (double)huge_out_of_place(lab), 0, "", "1e38 out of place: others changed by a bit");
    stab_at_most(run, (double)without_direction(lab), 0, "",
                 "a quaternion without a direction: others changed by a bit");
}

static void report_pixel(stab_run *run, const stab_lab *lab) {
    size_t not_finite = 0, dead = 0;
    poison_pixel(lab, &not_finite, &dead);
    stab_at_most(run, (double)not_finite, 0, "",
                 "a poisoned pixel of dL/dimage: gradients that are not finite");
    stab_at_most(run, (double)dead, 0, "", "a poisoned pixel of dL/dimage: most other gradients lost");
}

static void report_fit(stab_run *run, const stab_lab *lab) {
    static const uint8_t rgb[3 * 40 * 30];
    const sf_pixels pixels = {.rgb = rgb, .stride = 3 * 40};
    sf_camera camera = test_camera_around(0, 3, 40, 30);
    uint64_t skipped;
    sf_scene *scene;
    assert_ok(lab->ctx, sf_scene_create(lab->ctx, &scene));
    stab_at_most(run, (double)poison_poses(scene), 0, "", "poses that are not finite, taken into a scene");
    assert_ok(lab->ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
    stab_at_most(run, (double)fit_poisoned(lab, scene, &skipped), 1, "",
                 "8 steps from a model with a NaN: Gaussians that are not finite");
    stab_at_least(run, (double)skipped, 1, "", "8 steps from a model with a NaN: counted");
    sf_scene_destroy(&scene);
}

static void poison(stab_run *run) {
    stab_lab lab = stab_lab_open(NULL);
    report_gaussian(run, &lab);
    report_pixel(run, &lab);
    report_fit(run, &lab);
    stab_lab_close(&lab);
}

const stab_row stab_row_5 = {
    .id = "5",
    .failure = "NaN and Inf spread from one parameter to the whole model in one step",
    .cure =
        "Values are checked where they enter: at load, in the projection, in the update. The Gaussian at "
        "fault is left out, counted and, in a fit, removed; the picture is otherwise the same to the bit.",
    .quick = 1,
    .run = poison,
};
