/* test_stages.c - what a larger picture has left in a workspace does not show in a smaller one, at every
 * level. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "reference/random.h"
#include "render/workspace.h"
#include "scene/gaussians.h"

/* All results of one step. */
typedef struct step {
    size_t pixels, count;
    float *rgb[3], *transmittance, *depth, *d_rgb[3];
    float *grads[SF_FIELD_COUNT], *screen;
    double camera[SF_CAMERA_SUMS], background[3];
    sf_loss_value loss;
} step;

static void take(void *user, const sf_params *grads, size_t first, size_t end) {
    step *s = user;
    for (int field = 0; grads && field < SF_FIELD_COUNT; field++) { /* NULL: all are 0, as calloc left them */
        size_t block = (size_t)sf_field_components(field) * SF_LANES;
        if (grads->field[field])
            memcpy(s->grads[field] + first * block, grads->field[field],
                   (end - first) * block * sizeof(float));
    }
}

static float *copy(const float *values, size_t n) {
    float *to = malloc((n ? n : 1) * sizeof *to);
    assert_non_null(to);
    memcpy(to, values, n * sizeof *to);
    return to;
}

/* The picture's part of a plane. */
static float *picture(const sf_workspace *ws, const float *plane) {
    size_t width = (size_t)ws->eye.width, height = (size_t)ws->eye.height;
    float *to = malloc(width * height * sizeof *to);
    assert_non_null(to);
    for (size_t y = 0; y < height; y++) memcpy(to + y * width, plane + y * ws->stride, width * sizeof *to);
    return to;
}

/* Look, project, bin, blend, loss, and all the way back. */
static step run(sf_workspace *ws, const sf_model *model, const test_ref_scene *scene, int with_weight) {
    step s = {.pixels = (size_t)scene->camera.width * (size_t)scene->camera.height, .count = scene->count};
    const float background[3] = {0.25f, 0.5f, 0.75f};
    float *target = malloc(3 * s.pixels * sizeof *target), *weight = malloc(s.pixels * sizeof *weight);
    double weights = 0;
    assert_true(target && weight);
    for (size_t i = 0; i < s.pixels; i++)
        weights += (double)(weight[i] = with_weight ? (float)(i % 5) / 4 : 1.0f);
    for (size_t i = 0; i < 3 * s.pixels; i++) target[i] = (float)(i % 17) / 16;
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        s.grads[field] =
            calloc(sf_blocks(s.count) * SF_LANES * (size_t)sf_field_components(field), sizeof(float));
        assert_non_null(s.grads[field]);
    }
    assert_ok(ws->ctx, sf_workspace_look(ws, &scene->camera, (float)scene->near_plane));
    assert_ok(ws->ctx, sf_stage_project(ws, model, model->sh_degree, 0));
    assert_ok(ws->ctx, sf_stage_bin(ws));
    sf_stage_blend(ws, background, 1);
    assert_ok(ws->ctx, sf_workspace_loss_room(ws));
    sf_copy_in(ws, target, with_weight ? weight : NULL, ws->target);
    ws->has_weight = with_weight;
    for (size_t i = 0; i < s.pixels; i++)
        ws->weight[i / (size_t)scene->camera.width * ws->stride + i % (size_t)scene->camera.width] =
            weight[i];
    sf_stage_loss(ws, 0.2, 0, weights, 1, 1, &s.loss);
    assert_ok(ws->ctx, sf_stage_blend_bwd(ws));
    assert_ok(ws->ctx, sf_stage_project_bwd(ws, s.camera, take, &s));
    assert_ok(ws->ctx, sf_stage_background_bwd(ws, s.background));
    for (int ch = 0; ch < 3; ch++) {
        s.rgb[ch] = picture(ws, ws->rgb[ch]);
        s.d_rgb[ch] = copy(ws->d_rgb[ch], ws->plane_rows * ws->stride); /* 0 beyond the picture */
    }
    s.transmittance = picture(ws, ws->transmittance);
    s.depth = picture(ws, ws->depth);
    s.screen = copy(ws->screen, s.count);
    free(target);
    free(weight);
    return s;
}

static void step_free(step *s) {
    for (int ch = 0; ch < 3; ch++) {
        free(s->rgb[ch]);
        free(s->d_rgb[ch]);
    }
    for (int field = 0; field < SF_FIELD_COUNT; field++) free(s->grads[field]);
    free(s->transmittance);
    free(s->depth);
    free(s->screen);
}

static void assert_same(const sf_workspace *ws, const step *a, const step *b) {
    size_t picture_size = a->pixels * sizeof(float), plane_size = ws->plane_rows * ws->stride * sizeof(float);
    for (int ch = 0; ch < 3; ch++) {
        assert_memory_equal(a->rgb[ch], b->rgb[ch], picture_size);
        assert_memory_equal(a->d_rgb[ch], b->d_rgb[ch], plane_size);
    }
    assert_memory_equal(a->transmittance, b->transmittance, picture_size);
    assert_memory_equal(a->depth, b->depth, picture_size);
    assert_memory_equal(a->screen, b->screen, a->count * sizeof(float));
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        assert_memory_equal(a->grads[field], b->grads[field],
                            sf_blocks(a->count) * SF_LANES * (size_t)sf_field_components(field) *
                                sizeof(float));
    assert_memory_equal(a->camera, b->camera, sizeof a->camera);
    assert_memory_equal(a->background, b->background, sizeof a->background);
    assert_memory_equal(&a->loss, &b->loss, sizeof a->loss);
}

/* A workspace used for larger and smaller pictures and models, against a fresh one each time. */
static void compare_with_fresh(sf_context *ctx) {
    static const struct {
        int width, height;
        size_t count;
    } sizes[] = {{150, 117, 700}, {33, 17, 90}, {16, 40, 300}, {1, 1, 20},
                 {130, 7, 701},   {77, 45, 16}, {150, 117, 5}};
    sf_workspace used;
    sf_workspace_init(&used, ctx);
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        test_ref_scene scene =
            test_random_scene(70 + k, sizes[k].count, (int)(3 - k % 4), sizes[k].width, sizes[k].height);
        sf_model *model = test_model_of(ctx, &scene);
        sf_workspace fresh;
        sf_workspace_init(&fresh, ctx);
        step a = run(&used, model, &scene, k % 2 == 0), b = run(&fresh, model, &scene, k % 2 == 0);
        assert_same(&used, &a, &b);
        step_free(&a);
        step_free(&b);
        sf_workspace_free(&fresh);
        sf_model_destroy(&model);
        test_ref_gaussians_free(&scene.gaussians);
    }
    sf_workspace_free(&used);
}

static void earlier_pictures_leave_no_trace(void **state) {
    (void)state;
    sf_isa_info info;
    for (size_t i = 0; !sf_isa_describe(i, &info); i++) {
        if (!info.usable) {
            print_message("stages %s: not on this machine, skipped\n", info.name);
            continue;
        }
        sf_context *ctx;
        sf_context_options options = {.threads = 2, .isa = info.name};
        assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
        compare_with_fresh(ctx);
        sf_context_destroy(&ctx);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(earlier_pictures_leave_no_trace)};
    return cmocka_run_group_tests_name("check stages", tests, NULL, NULL);
}
