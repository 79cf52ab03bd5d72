/* outcome.c - what the library makes of a scene of the reference. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "outcome.h"

static float *floats(size_t n) {
    float *values = calloc(n ? n : 1, sizeof *values);
    assert_non_null(values);
    return values;
}

test_outcome test_outcome_create(const test_ref_scene *scene) {
    size_t pixels = (size_t)scene->camera.width * (size_t)scene->camera.height;
    return (test_outcome){.pixels = pixels,
                          .count = scene->count,
                          .sh_degree = scene->sh_degree,
                          .rgb = floats(3 * pixels),
                          .transmittance = floats(pixels),
                          .depth = floats(pixels),
                          .gradient = test_gaussians_create(scene->count, scene->sh_degree)};
}

void test_outcome_free(test_outcome *o) {
    free(o->rgb);
    free(o->transmittance);
    free(o->depth);
    test_gaussians_free(&o->gradient);
}

float *test_d_rgb(size_t pixels) {
    float *d_rgb = floats(3 * pixels);
    for (size_t i = 0; i < 3 * pixels; i++) d_rgb[i] = test_d_rgb_at(i);
    return d_rgb;
}

/* The same for the reference. */
static double *ref_d_rgb(size_t pixels) {
    double *d_rgb = test_ref_numbers(3 * pixels);
    for (size_t i = 0; i < 3 * pixels; i++) d_rgb[i] = (double)test_d_rgb_at(i);
    return d_rgb;
}

test_outcome test_outcome_with(sf_context *ctx, sf_renderer *renderer, const test_ref_scene *scene,
                               const float *d_rgb) {
    test_outcome o = test_outcome_create(scene);
    sf_model *model = test_model_of(ctx, scene);
    sf_render_options options = test_render_options_of(scene);
    sf_image_out image = {o.rgb, o.transmittance, o.depth};
    sf_render_grads grads = {o.gradient, o.pose, o.background, o.focal};
    assert_ok(ctx, sf_render(renderer, model, &scene->camera, &options, &image));
    assert_ok(ctx, sf_render_backward(renderer, model, d_rgb, &grads));
    sf_model_destroy(&model);
    return o;
}

test_outcome test_outcome_of(sf_context *ctx, sf_renderer *renderer, const test_ref_scene *scene) {
    float *d_rgb = test_d_rgb((size_t)scene->camera.width * (size_t)scene->camera.height);
    test_outcome o = test_outcome_with(ctx, renderer, scene, d_rgb);
    free(d_rgb);
    return o;
}

test_outcome test_outcome_alone(const test_ref_scene *scene, int threads) {
    sf_context *ctx = test_context_threads(threads);
    sf_renderer *renderer;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    test_outcome o = test_outcome_of(ctx, renderer, scene);
    sf_renderer_destroy(&renderer);
    sf_context_destroy(&ctx);
    return o;
}

void test_ref_outcome(const test_ref_scene *scene, test_ref_frame *frame, test_ref_grads *grads) {
    double *d_rgb = ref_d_rgb((size_t)scene->camera.width * (size_t)scene->camera.height);
    test_ref_render(scene, frame);
    test_ref_backward(scene, frame, d_rgb, grads);
    free(d_rgb);
}

double test_worst_of(const float *got, const double *expected, size_t n) {
    double worst = 0;
    for (size_t i = 0; i < n; i++) {
        double error = fabs((double)got[i] - expected[i]);
        worst = isnan(error) ? INFINITY : fmax(worst, error);
    }
    return worst;
}

double test_worst_of_doubles(const double *got, const double *expected, size_t n) {
    double worst = 0;
    for (size_t i = 0; i < n; i++) {
        double error = fabs(got[i] - expected[i]);
        worst = isnan(error) ? INFINITY : fmax(worst, error);
    }
    return worst;
}

double test_relative(double worst, const double *expected, size_t n) {
    double largest = 0;
    for (size_t i = 0; i < n; i++) largest = fmax(largest, fabs(expected[i]));
    return largest > 0 ? worst / largest : worst;
}

const char *test_outcome_apart(const test_outcome *a, const test_outcome *b) {
    const struct {
        const char *name;
        const void *a, *b;
        size_t size;
    } parts[] = {
        {"rgb", a->rgb, b->rgb, 3 * a->pixels * sizeof(float)},
        {"transmittance", a->transmittance, b->transmittance, a->pixels * sizeof(float)},
        {"depth", a->depth, b->depth, a->pixels * sizeof(float)},
        {"the gradient of the pose", a->pose, b->pose, sizeof a->pose},
        {"the gradient of the focal lengths", a->focal, b->focal, sizeof a->focal},
        {"the gradient of the background", a->background, b->background, sizeof a->background},
    };
    float *from[TEST_REF_ARRAYS], *to[TEST_REF_ARRAYS];
    test_ref_array shape[TEST_REF_ARRAYS];
    if (a->pixels != b->pixels || a->count != b->count || a->sh_degree != b->sh_degree) return "their shape";
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
        if (memcmp(parts[i].a, parts[i].b, parts[i].size) != 0) return parts[i].name;
    test_gaussians_list(&a->gradient, from);
    test_gaussians_list(&b->gradient, to);
    test_ref_list(&(test_ref_gaussians){0}, a->sh_degree, shape);
    for (int k = 0; k < TEST_REF_ARRAYS; k++)
        if (memcmp(from[k], to[k], a->count * shape[k].width * sizeof(float)) != 0) return shape[k].name;
    return NULL;
}

static int all_finite(const float *values, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (!isfinite(values[i])) return 0;
    return 1;
}

int test_outcome_is_finite(const test_outcome *o) {
    float *list[TEST_REF_ARRAYS];
    test_ref_array shape[TEST_REF_ARRAYS];
    int finite = all_finite(o->rgb, 3 * o->pixels) && all_finite(o->transmittance, o->pixels) &&
                 all_finite(o->depth, o->pixels);
    test_gaussians_list(&o->gradient, list);
    test_ref_list(&(test_ref_gaussians){0}, o->sh_degree, shape);
    for (int a = 0; a < TEST_REF_ARRAYS; a++) finite &= all_finite(list[a], o->count * shape[a].width);
    for (int k = 0; k < 6; k++) finite &= isfinite(o->pose[k]) != 0;
    for (int k = 0; k < 2; k++) finite &= isfinite(o->focal[k]) != 0;
    return finite;
}
