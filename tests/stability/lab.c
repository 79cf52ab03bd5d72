/* lab.c - what the experiments share. */
#include "lab.h"

#include <stdlib.h>
#include <string.h>

stab_lab stab_lab_open(const char *isa) {
    stab_lab lab = {0};
    sf_context_options options = {.threads = 1, .isa = isa};
    assert_int_equal(sf_context_create(&lab.ctx, &options), SF_OK);
    assert_ok(lab.ctx, sf_renderer_create(lab.ctx, &lab.renderer));
    return lab;
}

void stab_lab_close(stab_lab *lab) {
    sf_renderer_destroy(&lab->renderer);
    sf_context_destroy(&lab->ctx);
}

size_t stab_levels(const char *names[STAB_LEVELS]) {
    const char *only = getenv("SPLATFIT_ISA");
    size_t n = 0;
    sf_isa_info info;
    for (size_t i = 0; n < STAB_LEVELS && sf_isa_describe(i, &info) == SF_OK; i++)
        if (info.usable && (!only || !*only || !strcmp(only, info.name))) names[n++] = info.name;
    assert_true(n > 0);
    return n;
}

size_t stab_count(const stab_run *run, size_t whole, size_t quick, size_t emulated) {
    return run->effort == STAB_WHOLE ? whole : run->effort == STAB_QUICK ? quick : emulated;
}

double stab_most_of(const double *values, size_t n) {
    double most = 0;
    for (size_t i = 0; i < n; i++)
        if (fabs(values[i]) > most) most = fabs(values[i]);
    return most;
}

double stab_between(sf_rng *rng, double least, double most) {
    return (double)(float)test_random_between(rng, least, most);
}

void stab_set_opacity(test_ref_scene *scene, size_t i, double opacity) {
    scene->gaussians.logit_opacities[i] = (float)log(opacity / (1 - opacity));
}

test_ref_scene stab_scene(size_t count, int width, int height, double focal) {
    test_ref_scene scene = {.camera = {.width = width,
                                       .height = height,
                                       .fx = focal,
                                       .fy = focal,
                                       .cx = 0.5 * width,
                                       .cy = 0.5 * height,
                                       .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                            .count = count,
                            .gaussians = test_ref_gaussians_create(count, 0),
                            .near_plane = 0.2f};
    for (size_t i = 0; i < count; i++) {
        scene.gaussians.means[3 * i + 2] = 1;
        scene.gaussians.quats[4 * i] = 1;
        for (size_t k = 0; k < 3; k++) scene.gaussians.sh[3 * i + k] = (float)(0.4 / 0.28209479177387814);
        stab_set_opacity(&scene, i, 0.9);
    }
    return scene;
}

/* Whether some Gaussian is nearly too faint to count, or the pixel nearly finished. */
static int is_on_edge(const test_ref_frame *frame, double x, double y) {
    double T = 1;
    for (size_t k = 0; k < frame->visible; k++) {
        const test_ref_splat *s = &frame->splats[frame->order[k]];
        double d0 = s->mean2d[0] - x, d1 = s->mean2d[1] - y, c = s->cov2d[2];
        double t = (c * d0 - s->cov2d[1] * d1) / sqrt(c * s->det), squares = t * t + d1 * d1 / c;
        if (squares > 12) continue; /* o g < 1/400 */
        double og = s->opacity * exp(-0.5 * squares);
        if (fabs(255 * og - 1) < 0.01) return 1;
        if (255 * og < 1) continue;
        T *= 1 - fmin(0.99, og);
        if (fabs(1e4 * T - 1) < 0.001) return 1;
        if (T < 1e-4) return 0;
    }
    return 0;
}

/* dL/du of a Gaussian if all its pixels pulled one way, at one standard deviation across its narrow side. */
static double pull(const stab_truth *truth, size_t i) {
    const test_ref_splat *s = &truth->frame.splats[i];
    if (!s->visible) return 0;
    double half = 0.5 * (s->cov2d[0] + s->cov2d[2]);
    double most = half + sqrt(fmax(half * half - s->det, 0)); /* the larger variance; det is their product */
    double o = 1 / (1 + exp(-truth->scene->gaussians.logit_opacities[i]));
    return fabs(truth->grads.gaussians.logit_opacities[i]) / (1 - o) / sqrt(s->det / most);
}

enum { MEANS, QUATS }; /* of test_ref_list */

static void choose_units(stab_truth *truth) {
    const test_ref_scene *scene = truth->scene;
    test_ref_array list[TEST_REF_ARRAYS];
    test_ref_list(&truth->grads.gaussians, scene->sh_degree, list);
    for (int a = 0; a < TEST_REF_ARRAYS; a++)
        truth->units[a] = stab_most_of(list[a].values, scene->count * list[a].width);
    for (size_t i = 0; i < scene->count; i++) {
        const test_ref_splat *s = &truth->frame.splats[i];
        const double *q = scene->gaussians.quats + 4 * i;
        double by = pull(truth, i), norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        if (!(by > 0)) continue;
        double length = sqrt(fmax(s->cov2d[0], s->cov2d[2])); /* px: the lever of a turn */
        truth->units[MEANS] = fmax(truth->units[MEANS], by * scene->camera.fx / s->camera_point[2]);
        truth->units[QUATS] = fmax(truth->units[QUATS], by * length / norm);
    }
    for (int a = 0; a < TEST_REF_ARRAYS; a++)
        if (!(truth->units[a] > 0)) truth->units[a] = 1;
}

stab_truth stab_truth_of(const test_ref_scene *scene) {
    size_t width = (size_t)scene->camera.width, pixels = width * (size_t)scene->camera.height;
    stab_truth truth = {.scene = scene, .left_out = calloc(pixels, 1), .d_rgb = test_d_rgb(pixels)};
    double *d_rgb = test_ref_numbers(3 * pixels);
    assert_non_null(truth.left_out);
    test_ref_render(scene, &truth.frame);
    for (size_t i = 0; i < pixels; i++) {
        truth.left_out[i] =
            (uint8_t)is_on_edge(&truth.frame, (double)(i % width) + 0.5, (double)(i / width) + 0.5);
        for (size_t k = 3 * i; k < 3 * i + 3; k++) {
            if (truth.left_out[i]) truth.d_rgb[k] = 0;
            d_rgb[k] = (double)truth.d_rgb[k];
        }
    }
    test_ref_backward(scene, &truth.frame, d_rgb, &truth.grads);
    choose_units(&truth);
    free(d_rgb);
    return truth;
}

void stab_truth_free(stab_truth *truth) {
    test_ref_grads_free(&truth->grads);
    test_ref_frame_free(&truth->frame);
    free(truth->left_out);
    free(truth->d_rgb);
}

static void compare_pictures(const stab_truth *truth, const test_outcome *o, stab_errors *e) {
    const test_ref_frame *frame = &truth->frame;
    for (size_t i = 0; i < o->pixels; i++) {
        if (truth->left_out[i]) continue;
        e->rgb = fmax(e->rgb, test_worst_of(o->rgb + 3 * i, frame->rgb + 3 * i, 3));
        e->transmittance =
            fmax(e->transmittance, test_worst_of(o->transmittance + i, frame->transmittance + i, 1));
    }
}

stab_errors stab_errors_of(const stab_truth *truth, const test_outcome *o) {
    stab_errors e = {0};
    float *got[TEST_REF_ARRAYS];
    test_ref_array list[TEST_REF_ARRAYS];
    compare_pictures(truth, o, &e);
    test_gaussians_list(&o->gradient, got);
    test_ref_list(&truth->grads.gaussians, truth->scene->sh_degree, list);
    for (int a = 0; a < TEST_REF_ARRAYS; a++) {
        size_t n = truth->scene->count * list[a].width;
        e.gradient[a] = test_worst_of(got[a], list[a].values, n) / truth->units[a];
        e.worst_gradient = fmax(e.worst_gradient, e.gradient[a]);
    }
    return e;
}

stab_errors stab_compare(const stab_lab *lab, const stab_truth *truth) {
    test_outcome o = test_outcome_with(lab->ctx, lab->renderer, truth->scene, truth->d_rgb);
    stab_errors e = stab_errors_of(truth, &o);
    test_outcome_free(&o);
    return e;
}

double stab_gradient_error(const stab_truth *truth, const test_ref_gaussians *got) {
    test_ref_array from[TEST_REF_ARRAYS], to[TEST_REF_ARRAYS];
    double worst = 0;
    test_ref_list(got, truth->scene->sh_degree, from);
    test_ref_list(&truth->grads.gaussians, truth->scene->sh_degree, to);
    for (int a = 0; a < TEST_REF_ARRAYS; a++) {
        size_t n = truth->scene->count * to[a].width;
        worst = fmax(worst, test_worst_of_doubles(from[a].values, to[a].values, n) / truth->units[a]);
    }
    return worst;
}

double stab_ref_loss(const test_ref_scene *scene) {
    test_ref_frame frame;
    size_t values = 3 * (size_t)scene->camera.width * (size_t)scene->camera.height;
    double sum = 0;
    test_ref_render(scene, &frame);
    for (size_t i = 0; i < values; i++) sum += (double)test_d_rgb_at(i) * frame.rgb[i];
    test_ref_frame_free(&frame);
    return sum;
}

double stab_difference(const test_ref_scene *scene, double *at, double h) {
    double middle = *at;
    *at = middle + h;
    double after = stab_ref_loss(scene);
    *at = middle - h;
    double before = stab_ref_loss(scene);
    *at = middle;
    return (after - before) / (2 * h);
}
