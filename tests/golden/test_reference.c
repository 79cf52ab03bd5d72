/* test_reference.c - the float64 reference against the golden cases, and its gradients against differences.
 */
#include "golden.h"

#include "../../src/base/rng.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- golden cases ---- */

/* Both are float64: what separates them is the order of their sums. */
static const double GOLDEN_BOUND = 1e-9;

/* Asserts that an array is within the bound, relative to its largest magnitude. */
static void compare(const test_golden *golden, const char *name, test_rows rows, const double *got,
                    const double *expected) {
    double worst = test_golden_worst(rows, got, expected);
    double bound = GOLDEN_BOUND * test_golden_largest(rows, expected);
    print_message(" %s %.1e", name, bound > 0 ? worst / bound * GOLDEN_BOUND : worst);
    if (!(worst <= bound)) fail_msg("%s: %s: off by %g, allowed %g", golden->name, name, worst, bound);
}

static void compare_number(const test_golden *golden, const char *name, double got, double expected) {
    compare(golden, name, (test_rows){1, 1, NULL}, &got, &expected);
}

static void compare_splats(const test_golden *golden, const test_ref_frame *frame) {
    size_t n = golden->scene.count;
    double *points = test_ref_numbers(3 * n), *means = test_ref_numbers(2 * n),
           *cov = test_ref_numbers(3 * n);
    double *conics = test_ref_numbers(3 * n), *rgb = test_ref_numbers(3 * n);
    for (size_t i = 0; i < n; i++) {
        const test_ref_splat *s = &frame->splats[i];
        assert_int_equal(s->visible, golden->visible[i]);
        memcpy(points + 3 * i, s->camera_point, sizeof s->camera_point);
        memcpy(means + 2 * i, s->mean2d, sizeof s->mean2d);
        memcpy(cov + 3 * i, s->cov2d, sizeof s->cov2d);
        memcpy(conics + 3 * i, s->conic, sizeof s->conic);
        memcpy(rgb + 3 * i, s->rgb, sizeof s->rgb);
    }
    const double *visible = golden->visible;
    compare(golden, "camera_points", (test_rows){n, 3, visible}, points, golden->camera_points);
    compare(golden, "means2d", (test_rows){n, 2, visible}, means, golden->means2d);
    compare(golden, "cov2d", (test_rows){n, 3, visible}, cov, golden->cov2d);
    compare(golden, "conics", (test_rows){n, 3, visible}, conics, golden->conics);
    compare(golden, "rgb", (test_rows){n, 3, visible}, rgb, golden->rgb);
    free(points), free(means), free(cov), free(conics), free(rgb);
}

static void compare_gradients(const test_golden *golden, const test_ref_grads *grads) {
    test_ref_array got[TEST_REF_ARRAYS], expected[TEST_REF_ARRAYS];
    test_ref_list(&grads->gaussians, golden->scene.sh_degree, got);
    test_ref_list(&golden->gradient.gaussians, golden->scene.sh_degree, expected);
    for (int i = 0; i < TEST_REF_ARRAYS; i++) {
        test_rows rows = {golden->scene.count, got[i].width, golden->visible};
        compare(golden, got[i].name, rows, got[i].values, expected[i].values);
    }
    compare(golden, "pose", (test_rows){1, 6, NULL}, grads->pose, golden->gradient.pose);
}

static void reproduces_golden_case(void **state) {
    test_golden golden;
    test_ref_frame frame;
    test_ref_grads grads;
    test_golden_load(*state, &golden);
    const sf_camera *camera = &golden.scene.camera;
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    double *d_rgb = test_ref_numbers(3 * pixels);

    test_ref_render(&golden.scene, &frame);
    test_ref_pair pair = {camera->width, camera->height, frame.rgb, golden.target, NULL, golden.lambda, 0};
    test_ref_loss loss = test_ref_compare(&pair, d_rgb);
    test_ref_backward(&golden.scene, &frame, d_rgb, &grads);

    print_message("%s:", golden.name);
    compare(&golden, "image", (test_rows){pixels, 3, NULL}, frame.rgb, golden.image);
    compare(&golden, "transmittance", (test_rows){pixels, 1, NULL}, frame.transmittance,
            golden.transmittance);
    compare(&golden, "depth", (test_rows){pixels, 1, NULL}, frame.depth, golden.depth);
    assert_int_equal(frame.counts.pairs, golden.contributing_pairs);
    compare_splats(&golden, &frame);
    compare_number(&golden, "loss", loss.loss, golden.loss);
    compare_number(&golden, "l1", loss.l1, golden.l1);
    compare_number(&golden, "ssim", loss.ssim, golden.ssim);
    compare(&golden, "d_image", (test_rows){pixels, 3, NULL}, d_rgb, golden.d_image);
    compare_gradients(&golden, &grads);
    print_message("\n");

    free(d_rgb);
    test_ref_grads_free(&grads);
    test_ref_frame_free(&frame);
    test_golden_free(&golden);
}

/* ---- central differences ---- */

/* The five-point difference of step h. Its truncation, f5 h^4/30, is nothing at these steps (h in units of
 * the parameter's natural size); what is left is the rounding of the loss, which is below 1 and a sum of some
 * hundreds of terms: 1e-15/h allows for it. The short step is for where a branch flips within the long one.
 */
static const double STEPS[] = {1e-5, 1e-6}, LOSS_ROUNDING = 1e-15, DIFFERENCE_BOUND = 1e-8;

/* What a scenario is made of; it is there to reach certain branches. */
typedef struct scenario {
    const char *name;
    uint64_t seed;
    size_t count;
    int sh_degree, antialiased, weighted;
    double lambda, delta;
    double field;            /* means spread to this multiple of the half field of view */
    double scale, spread;    /* standard deviations: middle, and normal spread of the logarithm */
    double logit;            /* of opacity: mean */
    double quat_decades;     /* norms 10^+-this */
    test_ref_counts reaches; /* the least of each branch that it must take */
} scenario;

/* A scene, its target and its weights, with the twist and the zoom under which it is seen. */
typedef struct fixture {
    test_ref_scene scene;
    double lambda, delta;
    double *target, *weight;
    double *offset, *d_rgb;   /* 0, added to the picture; dL/d of it */
    double twist[6], zoom[2]; /* 0, of the camera and of the logarithms of its focal lengths */
    test_ref_counts counts;
    uint64_t branches; /* where nothing is moved */
    size_t compared, skipped;
} fixture;

static size_t pixels_of(const fixture *f) {
    return (size_t)f->scene.camera.width * (size_t)f->scene.camera.height;
}

static double between(sf_rng *rng, double low, double high) {
    return low + (high - low) * sf_rng_uniform(rng);
}

/* R = exp([phi]x), by Rodrigues. */
static void exponential(const double phi[3], double R[9]) {
    double angle = sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]);
    double s = angle > 0 ? sin(angle) / angle : 1;
    double c = angle > 0 ? (1 - cos(angle)) / (angle * angle) : 0.5;
    const double K[9] = {0, -phi[2], phi[1], phi[2], 0, -phi[0], -phi[1], phi[0], 0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double K2 = phi[i] * phi[j] - (i == j ? angle * angle : 0);
            R[3 * i + j] = (i == j ? 1 : 0) + s * K[3 * i + j] + c * K2;
        }
}

/* p_c' = exp([phi]x) p_c + rho (M.6) */
static sf_camera twisted(const sf_camera *camera, const double twist[6]) {
    sf_camera out = *camera;
    double R[9];
    exponential(twist + 3, R);
    for (int i = 0; i < 3; i++) {
        out.t_cw[i] = twist[i];
        for (int k = 0; k < 3; k++) out.t_cw[i] += R[3 * i + k] * camera->t_cw[k];
        for (int j = 0; j < 3; j++) {
            out.R_cw[3 * i + j] = 0;
            for (int k = 0; k < 3; k++) out.R_cw[3 * i + j] += R[3 * i + k] * camera->R_cw[3 * k + j];
        }
    }
    return out;
}

static sf_camera random_camera(sf_rng *rng) {
    sf_camera camera = {.width = 14, .height = 12, .fx = 13, .fy = 14, .cx = 6.6, .cy = 6.2};
    double twist[6];
    for (int k = 0; k < 3; k++) camera.R_cw[4 * k] = 1;
    for (int k = 0; k < 6; k++) twist[k] = between(rng, -1, 1);
    return twisted(&camera, twist);
}

/* A point given in the camera's frame, in the world. */
static void to_world(const sf_camera *camera, const double p[3], double *world) {
    for (int k = 0; k < 3; k++) {
        world[k] = 0;
        for (int i = 0; i < 3; i++) world[k] += camera->R_cw[3 * i + k] * (p[i] - camera->t_cw[i]);
    }
}

static void random_gaussian(const scenario *how, sf_rng *rng, test_ref_scene *scene, size_t i) {
    const test_ref_gaussians *g = &scene->gaussians;
    const sf_camera *c = &scene->camera;
    size_t width = 3 * (size_t)(how->sh_degree + 1) * (size_t)(how->sh_degree + 1);
    double z = between(rng, 0, 1) < 0.1 ? 0.1 : between(rng, 1, 3); /* one in ten before the near plane */
    double p[3] = {how->field * between(rng, -1, 1) * c->width / (2 * c->fx) * z,
                   how->field * between(rng, -1, 1) * c->height / (2 * c->fy) * z, z};
    double norm = pow(10, how->quat_decades * between(rng, -1, 1));
    to_world(c, p, g->means + 3 * i);
    for (size_t k = 0; k < 4; k++) g->quats[4 * i + k] = norm * sf_rng_normal(rng);
    for (size_t k = 0; k < 3; k++)
        g->log_scales[3 * i + k] = log(how->scale) + how->spread * sf_rng_normal(rng);
    g->logit_opacities[i] = how->logit + sf_rng_normal(rng);
    for (size_t k = 0; k < width; k++) g->sh[width * i + k] = (k < 3 ? 1 : 0.4) * sf_rng_normal(rng);
}

static void fixture_create(const scenario *how, fixture *f) {
    sf_rng rng;
    sf_rng_seed(&rng, how->seed);
    *f = (fixture){.lambda = how->lambda, .delta = how->delta};
    test_ref_scene *s = &f->scene;
    s->camera = random_camera(&rng);
    s->count = how->count;
    s->sh_degree = how->sh_degree;
    s->antialiased = how->antialiased;
    s->near_plane = 0.2;
    s->gaussians = test_ref_gaussians_create(how->count, how->sh_degree);
    for (size_t i = 0; i < how->count; i++) random_gaussian(how, &rng, s, i);
    for (int k = 0; k < 3; k++) s->background[k] = sf_rng_uniform(&rng);

    size_t pixels = pixels_of(f);
    f->target = test_ref_numbers(3 * pixels);
    f->weight = how->weighted ? test_ref_numbers(pixels) : NULL;
    f->offset = test_ref_numbers(3 * pixels);
    f->d_rgb = test_ref_numbers(3 * pixels);
    for (size_t i = 0; i < 3 * pixels; i++) f->target[i] = sf_rng_uniform(&rng);
    /* some pixels at 0, some at 1, the rest between */
    for (size_t i = 0; f->weight && i < pixels; i++)
        f->weight[i] = fmin(fmax(between(&rng, -0.3, 1.3), 0), 1);
}

static void fixture_free(fixture *f) {
    test_ref_gaussians_free(&f->scene.gaussians);
    free(f->target);
    free(f->weight);
    free(f->offset);
    free(f->d_rgb);
}

/* The loss of the fixture as it stands and the branches taken; d_rgb as test_ref_compare has it. */
static test_ref_loss evaluate(const fixture *f, double *d_rgb, test_ref_counts *counts) {
    test_ref_scene seen = f->scene;
    test_ref_frame frame;
    seen.camera = twisted(&f->scene.camera, f->twist);
    seen.camera.fx *= exp(f->zoom[0]), seen.camera.fy *= exp(f->zoom[1]);
    test_ref_render(&seen, &frame);
    for (size_t i = 0; i < 3 * pixels_of(f); i++) frame.rgb[i] += f->offset[i];
    test_ref_pair pair = {seen.camera.width, seen.camera.height, frame.rgb, f->target,
                          f->weight,         f->lambda,          f->delta};
    test_ref_loss loss = test_ref_compare(&pair, d_rgb);
    loss.branches = test_ref_branch(loss.branches, frame.branches);
    if (counts) *counts = frame.counts;
    test_ref_frame_free(&frame);
    return loss;
}

/* dL/dvalue by the five-point difference; 0 if a branch flips on the way. */
static int difference(const fixture *f, double *value, double step, double *slope) {
    static const double at[4] = {-2, -1, 1, 2}, factor[4] = {1, -8, 8, -1};
    double kept = *value;
    int smooth = 1;
    *slope = 0;
    for (int i = 0; i < 4 && smooth; i++) {
        *value = kept + at[i] * step;
        test_ref_loss loss = evaluate(f, NULL, NULL);
        smooth = loss.branches == f->branches;
        *slope += factor[i] * loss.loss / (12 * step);
    }
    *value = kept;
    return smooth;
}

/* The values of a parameter and their gradients; unit: NULL, or the natural size of each row's values. */
typedef struct parameter {
    const char *name;
    size_t rows, width;
    double *values;
    const double *gradient, *unit;
} parameter;

static double unit_of(const parameter *p, size_t i) { return p->unit ? p->unit[i / p->width] : 1; }

/* One value by the longest step that stays on one side of every branch; 0 if none does. */
static int check_value(const fixture *f, const parameter *p, size_t i, double largest, double *error) {
    double slope;
    *error = 0;
    for (size_t k = 0; k < sizeof STEPS / sizeof *STEPS; k++) {
        if (!difference(f, &p->values[i], STEPS[k] * unit_of(p, i), &slope)) continue;
        *error = fabs(slope - p->gradient[i]) * unit_of(p, i);
        double bound = DIFFERENCE_BOUND * largest + LOSS_ROUNDING / STEPS[k];
        if (!(*error <= bound)) fail_msg("%s %zu: %g, by differences %g", p->name, i, p->gradient[i], slope);
        return 1;
    }
    return 0;
}

/* Compares gradient x unit, which is free of the rows' sizes. */
static void check_parameter(fixture *f, const parameter *p) {
    double largest = 0, worst = 0;
    size_t skipped = 0, values = p->rows * p->width;
    for (size_t i = 0; i < values; i++) largest = fmax(largest, fabs(p->gradient[i] * unit_of(p, i)));
    assert_true(largest > 1e4 * LOSS_ROUNDING / STEPS[0]); /* else rounding could hide it */
    /* where time is short one of 5, which is in step with no width */
    size_t stride = getenv("SPLATFIT_QUICK") && values >= 100 ? 5 : 1;
    size_t checked = (values + stride - 1) / stride;
    for (size_t i = 0; i < values; i += stride) {
        double error;
        skipped += !check_value(f, p, i, largest, &error);
        worst = fmax(worst, error);
    }
    print_message(" %s %.1e", p->name, worst / largest);
    assert_true(skipped < checked);
    f->compared += checked - skipped;
    f->skipped += skipped;
}

static void check_parameters(fixture *f) {
    test_ref_frame frame;
    test_ref_grads grads;
    test_ref_array values[TEST_REF_ARRAYS], gradients[TEST_REF_ARRAYS];
    size_t n = f->scene.count;
    double *norms = test_ref_numbers(n);
    for (size_t i = 0; i < n; i++) {
        const double *q = f->scene.gaussians.quats + 4 * i;
        norms[i] = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    }
    test_ref_render(&f->scene, &frame);
    test_ref_backward(&f->scene, &frame, f->d_rgb, &grads);
    test_ref_list(&f->scene.gaussians, f->scene.sh_degree, values);
    test_ref_list(&grads.gaussians, f->scene.sh_degree, gradients);
    for (int i = 0; i < TEST_REF_ARRAYS; i++) {
        const double *unit = values[i].values == f->scene.gaussians.quats ? norms : NULL;
        parameter p = {values[i].name, n, values[i].width, values[i].values, gradients[i].values, unit};
        check_parameter(f, &p);
    }
    check_parameter(f, &(parameter){"image", pixels_of(f), 3, f->offset, f->d_rgb, NULL});
    check_parameter(f, &(parameter){"background", 1, 3, f->scene.background, grads.background, NULL});
    check_parameter(f, &(parameter){"pose", 1, 6, f->twist, grads.pose, NULL});
    check_parameter(f, &(parameter){"focal", 1, 2, f->zoom, grads.focal, NULL});
    test_ref_grads_free(&grads);
    test_ref_frame_free(&frame);
    free(norms);
}

/* Every gradient of a scenario against differences. */
static void gradients_match_differences(void **state) {
    const scenario *how = *state;
    fixture f;
    test_ref_counts counts;
    fixture_create(how, &f);
    print_message("%s:", how->name);
    f.branches = evaluate(&f, f.d_rgb, &counts).branches;
    check_parameters(&f);
    print_message("; %zu of %zu skipped\n", f.skipped, f.compared + f.skipped);
    assert_true(10 * f.skipped <= f.compared + f.skipped);
    assert_true(counts.pairs >= how->reaches.pairs);
    assert_true(counts.saturated >= how->reaches.saturated);
    assert_true(counts.wide >= how->reaches.wide);
    assert_true(counts.floored >= how->reaches.floored);
    assert_true(counts.stopped_pixels >= how->reaches.stopped_pixels);
    assert_true(counts.clamped_channels >= how->reaches.clamped_channels);
    fixture_free(&f);
}

static const scenario scenarios[] = {
    {"plain", 1, 12, .sh_degree = 3, .lambda = 0.2, .field = 0.9, .scale = 0.25, .spread = 0.5,
     .reaches = {.pairs = 500, .clamped_channels = 3}},
    {"weights", 2, 10, .sh_degree = 1, .weighted = 1, .lambda = 0.4, .field = 0.9, .scale = 0.25,
     .spread = 0.5, .reaches = {.pairs = 500}},
    {"Huber's loss", 8, 10, .sh_degree = 1, .weighted = 1, .lambda = 0.1, .delta = 0.2, .field = 0.9,
     .scale = 0.25, .spread = 0.5, .reaches = {.pairs = 500}},
    {"unnormalized quaternions", 3, 14, .lambda = 0.2, .field = 0.9, .scale = 0.2, .spread = 1,
     .quat_decades = 3, .reaches = {.pairs = 500}},
    {"beyond the Jacobian's clamp", 4, 16, .sh_degree = 2, .lambda = 0.2, .field = 2, .scale = 0.6,
     .spread = 0.3, .reaches = {.pairs = 500, .wide = 100}},
    {"opaque", 5, 12, .sh_degree = 1, .lambda = 0.2, .field = 0.9, .scale = 2, .spread = 0.4, .logit = 5,
     .reaches = {.pairs = 300, .saturated = 10, .stopped_pixels = 50}},
    {"anti-aliased", 6, 30, .sh_degree = 1, .antialiased = 1, .weighted = 1, .lambda = 0.2, .field = 0.9,
     .scale = 0.08, .spread = 0.7, .logit = 2, .reaches = {.pairs = 500}},
    {"anti-aliased, at the least compensation", 7, 80, .antialiased = 1, .lambda = 0.2, .field = 0.9,
     .scale = 0.004, .spread = 2.5, .logit = 3.5, .reaches = {.pairs = 100, .floored = 8}},
};
enum { SCENARIOS = sizeof scenarios / sizeof *scenarios };

/* ---- the branches of the reference itself ---- */

static void culls_at_the_near_plane_and_zero_quaternions(void **state) {
    (void)state;
    test_ref_scene scene = {.camera = {.width = 4, .height = 4, .fx = 4, .fy = 4, .cx = 2, .cy = 2},
                            .count = 4,
                            .near_plane = 0.25,
                            .gaussians = test_ref_gaussians_create(4, 0)};
    for (int k = 0; k < 3; k++) scene.camera.R_cw[4 * k] = 1;
    const double z[4] = {0.25, 0.2500001, 1, 1}, w[4] = {1, 1, 1e-13, 1e-11};
    const int visible[4] = {0, 1, 0, 1};
    for (size_t i = 0; i < 4; i++) {
        scene.gaussians.means[3 * i + 2] = z[i];
        scene.gaussians.quats[4 * i] = w[i];
    }
    for (size_t i = 0; i < 4; i++) {
        test_ref_splat splat;
        test_ref_project(&scene, i, &splat);
        assert_int_equal(splat.visible, visible[i]);
    }
    test_ref_gaussians_free(&scene.gaussians);
}

/* Two scenes on different sides of a decision must not look alike to the differences. */
static void branches_tell_apart(void **state) {
    (void)state;
    fixture f;
    fixture_create(&scenarios[0], &f);
    uint64_t at_rest = evaluate(&f, NULL, NULL).branches;
    test_ref_gaussians *g = &f.scene.gaussians;
    assert_true(evaluate(&f, NULL, NULL).branches == at_rest);
    for (size_t i = 0; i < f.scene.count; i++) g->logit_opacities[i] += 0.1;
    assert_true(evaluate(&f, NULL, NULL).branches != at_rest);
    for (size_t i = 0; i < f.scene.count; i++) g->logit_opacities[i] -= 0.1;
    assert_true(evaluate(&f, NULL, NULL).branches == at_rest);
    for (size_t i = 0; i < f.scene.count; i++) g->sh[48 * i] -= 3;
    assert_true(evaluate(&f, NULL, NULL).branches != at_rest);
    fixture_free(&f);
}

/* What is masked must not matter, and a mask of ones must be none. */
static void weights_mask_the_loss(void **state) {
    (void)state;
    enum { W = 15, H = 14 };
    double rgb[W * H * 3], target[W * H * 3], ones[W * H], mask[W * H], d_rgb[W * H * 3];
    sf_rng rng;
    sf_rng_seed(&rng, 8);
    for (int i = 0; i < W * H * 3; i++) {
        rgb[i] = sf_rng_uniform(&rng);
        target[i] = sf_rng_uniform(&rng);
    }
    for (int i = 0; i < W * H; i++) {
        ones[i] = 1;
        mask[i] = i % W < 6;
    }
    test_ref_pair all = {W, H, rgb, target, NULL, 0.3, 0}, one = all, masked = all;
    one.weight = ones;
    masked.weight = mask;
    assert_true(test_ref_compare(&all, NULL).loss == test_ref_compare(&one, NULL).loss);

    double before = test_ref_compare(&masked, d_rgb).loss;
    for (int i = 0; i < W * H * 3; i++) {
        if (mask[i / 3] > 0) continue;
        assert_true(d_rgb[i] == 0);
        rgb[i] = 7;
    }
    assert_true(test_ref_compare(&masked, NULL).loss == before);

    for (int i = 0; i < W * H * 3; i++) target[i] = rgb[i];
    test_ref_loss same = test_ref_compare(&masked, NULL);
    assert_true(fabs(same.loss) < 1e-15);
    assert_true(fabs(same.ssim - 1) < 1e-15);
}

int main(void) {
    const struct CMUnitTest own[] = {
        cmocka_unit_test(culls_at_the_near_plane_and_zero_quaternions),
        cmocka_unit_test(branches_tell_apart),
        cmocka_unit_test(weights_mask_the_loss),
    };
    struct CMUnitTest differences[SCENARIOS], *cases;
    for (size_t i = 0; i < SCENARIOS; i++)
        differences[i] = (struct CMUnitTest){.name = scenarios[i].name,
                                             .test_func = gradients_match_differences,
                                             .initial_state = (void *)(uintptr_t)&scenarios[i]};
    size_t count = test_golden_list(reproduces_golden_case, "reference reproduces", &cases);
    int failed = cmocka_run_group_tests_name("reference", own, NULL, NULL);
    failed += _cmocka_run_group_tests("gradients against differences", differences, SCENARIOS, NULL, NULL);
    failed += _cmocka_run_group_tests("reference, golden cases", cases, count, NULL, NULL);
    test_golden_list_free(cases, count);
    return failed != 0;
}
