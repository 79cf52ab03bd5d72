/* test_in_view.c - Gaussians out of view are left out by their box: what projection finds is the same, from
 * any camera, and most of what is out of view is left out. */
#include "testing.h"

#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "render/in_view.h"
#include "render/workspace.h"

enum { COUNT = 8192, TASK = SF_PROJECT_BLOCKS * SF_LANES };

/* Groups of TASK Gaussians, each within a small part of space, of sizes from tiny to as large as the group's
 * distance. */
static sf_model *scattered(sf_context *ctx) {
    sf_model *model;
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    assert_ok(ctx, sf_model_create(ctx, COUNT, 1, &model));
    float centre[3] = {0}, size = 0;
    for (size_t i = 0; i < COUNT; i++) {
        float mean[3], log_scale[3], quat[4], logit = (float)(6 * sf_rng_normal(&rng)), sh[12];
        if (i % TASK == 0) size = (float)(-6 + 6 * sf_rng_uniform(&rng));
        for (int k = 0; k < 3; k++) {
            if (i % TASK == 0) centre[k] = (float)(4 * sf_rng_normal(&rng));
            mean[k] = centre[k] + (float)(0.5 * sf_rng_normal(&rng));
            log_scale[k] = size + (float)sf_rng_normal(&rng);
        }
        for (int k = 0; k < 4; k++) quat[k] = (float)sf_rng_normal(&rng);
        for (int k = 0; k < 12; k++) sh[k] = (float)sf_rng_normal(&rng);
        sf_gaussians one = {mean, quat, log_scale, &logit, sh};
        assert_ok(ctx, sf_model_set(model, i, 1, &one));
    }
    return model;
}

static sf_camera random_camera(sf_rng *rng) {
    sf_camera c = {.width = 90, .height = 60};
    double q[4], length = 0;
    for (int k = 0; k < 4; k++) q[k] = sf_rng_normal(rng), length += q[k] * q[k];
    for (int k = 0; k < 4; k++) q[k] /= sqrt(length);
    double w = q[0], x = q[1], y = q[2], z = q[3];
    double R[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                   2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                   2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
    memcpy(c.R_cw, R, sizeof R);
    for (int k = 0; k < 3; k++) c.t_cw[k] = 2 * sf_rng_normal(rng);
    c.fx = 20 + 300 * sf_rng_uniform(rng), c.fy = c.fx * (0.7 + 0.6 * sf_rng_uniform(rng));
    c.cx = 90 * sf_rng_uniform(rng), c.cy = 60 * sf_rng_uniform(rng);
    return c;
}

/* Projects task by task as the kernel does alone, and compares. Counts the tasks out of view, and those that
 * were left out. */
static void compare(sf_workspace *ws, const sf_model *model, size_t *out, size_t *left_out) {
    static _Alignas(64) sf_splat splats[COUNT];
    static _Alignas(64) uint8_t state[COUNT];
    static _Alignas(64) uint16_t first_row[COUNT], rows[COUNT];
    sf_project_args args = {.eye = &ws->eye,
                            .params = model->params,
                            .sh_degree = 1,
                            .splats = splats,
                            .state = state,
                            .first_row = first_row,
                            .rows = rows};
    ws->ctx->kernels->project(&args, 0, COUNT / SF_LANES);
    assert_memory_equal(ws->state, state, COUNT);
    assert_memory_equal(ws->rows, rows, sizeof rows);
    for (size_t task = 0; task < COUNT / TASK; task++) {
        *out += !memchr(state + task * TASK, SF_SEEN, TASK);
        *left_out += !ws->in_view[task];
    }
}

static void test_left_out(void **state) {
    (void)state;
    const char *const levels[] = {"scalar", NULL};
    for (int level = 0; level < 2; level++) {
        sf_context *ctx;
        sf_context_options options = {.threads = 2, .isa = levels[level]};
        assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
        sf_model *model = scattered(ctx);
        sf_workspace ws;
        sf_rng rng;
        size_t out = 0, left_out = 0;
        sf_rng_seed(&rng, 11);
        sf_workspace_init(&ws, ctx);
        for (int view = 0; view < 60; view++) {
            sf_camera camera = random_camera(&rng);
            assert_ok(ctx, sf_workspace_look(&ws, &camera, view % 3 ? 0.2f : 0));
            if (view % 2) sf_workspace_reduced(&ws, 4);
            assert_ok(ctx, sf_stage_project(&ws, model, 1, 0));
            compare(&ws, model, &out, &left_out);
            assert_ok(ctx, sf_stage_bin(&ws));
        }
        assert_true(out > 300);
        assert_between(left_out, out * 2 / 3, out);
        sf_workspace_free(&ws);
        sf_model_destroy(&model);
        sf_context_destroy(&ctx);
    }
}

/* Gaussians with a mean or scale that is not finite are not left out. */
static void test_not_finite(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, TASK, 0, &model));
    sf_eye eye = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                  .t = {0, 0, -10},
                  .fx = 50,
                  .fy = 50,
                  .near_plane = 0.1f,
                  .width = 60,
                  .height = 60,
                  .cx = 30,
                  .cy = 30,
                  .clamp_x = 1,
                  .clamp_y = 1,
                  .low_pass = 0.3};
    sf_frustum frustum = sf_frustum_of(&eye);
    assert_true(sf_are_out_of_view(&frustum, &model->params, 0, SF_PROJECT_BLOCKS));
    const float odd[] = {NAN, INFINITY, -INFINITY};
    for (int k = 0; k < 3; k++)
        for (int field = SF_FIELD_mean; field <= SF_FIELD_log_scale; field++) {
            if (field != SF_FIELD_mean && field != SF_FIELD_log_scale) continue;
            float *value = sf_value(&model->params, field, 100, k), before = *value;
            *value = odd[k];
            assert_false(sf_are_out_of_view(&frustum, &model->params, 0, SF_PROJECT_BLOCKS));
            *value = before;
        }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_left_out),
        cmocka_unit_test(test_not_finite),
    };
    return cmocka_run_group_tests_name("in_view", tests, NULL, NULL);
}
