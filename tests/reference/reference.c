/* reference.c - the stages in a row, forward and back, and the memory that they need. */
#include "../testing.h"
#include "reference.h"

#include <stdlib.h>

double *test_ref_numbers(size_t n) {
    double *numbers = calloc(n ? n : 1, sizeof *numbers);
    assert_non_null(numbers);
    return numbers;
}

void test_ref_list(const test_ref_gaussians *g, int sh_degree, test_ref_array list[TEST_REF_ARRAYS]) {
    size_t coefficients = (size_t)(sh_degree + 1) * (size_t)(sh_degree + 1);
    list[0] = (test_ref_array){"means", g->means, 3};
    list[1] = (test_ref_array){"quats", g->quats, 4};
    list[2] = (test_ref_array){"log_scales", g->log_scales, 3};
    list[3] = (test_ref_array){"logit_opacities", g->logit_opacities, 1};
    list[4] = (test_ref_array){"sh", g->sh, 3 * coefficients};
}

test_ref_gaussians test_ref_gaussians_create(size_t count, int sh_degree) {
    test_ref_gaussians g = {0};
    test_ref_array list[TEST_REF_ARRAYS];
    test_ref_list(&g, sh_degree, list);
    double **arrays[TEST_REF_ARRAYS] = {&g.means, &g.quats, &g.log_scales, &g.logit_opacities, &g.sh};
    for (int i = 0; i < TEST_REF_ARRAYS; i++) *arrays[i] = test_ref_numbers(count * list[i].width);
    return g;
}

void test_ref_gaussians_free(test_ref_gaussians *g) {
    test_ref_array list[TEST_REF_ARRAYS];
    test_ref_list(g, 0, list);
    for (int i = 0; i < TEST_REF_ARRAYS; i++) free(list[i].values);
    *g = (test_ref_gaussians){0};
}

/* Ascending z; insertion keeps equals as they are. */
static void sort_by_depth(test_ref_frame *frame) {
    for (size_t i = 1; i < frame->visible; i++) {
        uint32_t moving = frame->order[i];
        double z = frame->splats[moving].camera_point[2];
        size_t k = i;
        for (; k > 0 && frame->splats[frame->order[k - 1]].camera_point[2] > z; k--)
            frame->order[k] = frame->order[k - 1];
        frame->order[k] = moving;
    }
}

static void project_all(const test_ref_scene *scene, test_ref_frame *frame) {
    for (uint32_t i = 0; i < scene->count; i++) {
        test_ref_splat *s = &frame->splats[i];
        test_ref_project(scene, i, s);
        if (!s->visible) continue;
        frame->order[frame->visible++] = i;
        int decisions = s->rgb_clamped | s->jacobian_clamped << 3 | s->compensation_floored << 5;
        frame->branches = test_ref_branch(frame->branches, (uint64_t)i << 6 | (uint64_t)decisions);
        for (int k = 0; k < 3; k++) frame->counts.clamped_channels += (uint64_t)(s->rgb_clamped >> k & 1);
    }
    sort_by_depth(frame);
    for (size_t k = 0; k < frame->visible; k++)
        frame->branches = test_ref_branch(frame->branches, frame->order[k]);
}

void test_ref_render(const test_ref_scene *scene, test_ref_frame *frame) {
    size_t pixels = (size_t)scene->camera.width * (size_t)scene->camera.height;
    *frame = (test_ref_frame){.branches = TEST_REF_NO_BRANCH};
    frame->splats = calloc(scene->count + 1, sizeof *frame->splats);
    frame->order = calloc(scene->count + 1, sizeof *frame->order);
    assert_non_null(frame->splats);
    assert_non_null(frame->order);
    frame->rgb = test_ref_numbers(3 * pixels);
    frame->transmittance = test_ref_numbers(pixels);
    frame->depth = test_ref_numbers(pixels);
    project_all(scene, frame);
    test_ref_blend(scene, frame);
}

void test_ref_frame_free(test_ref_frame *frame) {
    free(frame->splats);
    free(frame->order);
    free(frame->rgb);
    free(frame->transmittance);
    free(frame->depth);
    *frame = (test_ref_frame){0};
}

void test_ref_backward(const test_ref_scene *scene, const test_ref_frame *frame, const double *d_rgb,
                       test_ref_grads *grads) {
    *grads = (test_ref_grads){.gaussians = test_ref_gaussians_create(scene->count, scene->sh_degree)};
    test_ref_splat_grads *d_splats = calloc(scene->count + 1, sizeof *d_splats);
    assert_non_null(d_splats);
    test_ref_blend_backward(scene, frame, d_rgb, d_splats, grads->background);
    for (size_t i = 0; i < scene->count; i++) test_ref_project_backward(scene, i, &d_splats[i], grads);
    free(d_splats);
}

void test_ref_grads_free(test_ref_grads *grads) { test_ref_gaussians_free(&grads->gaussians); }
