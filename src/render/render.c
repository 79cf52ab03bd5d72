/* render.c - the differentiable renderer, the loss and the quality metrics, for callers with plain arrays. */
#include "workspace.h"

#include <math.h>
#include <string.h>

struct sf_renderer {
    sf_context *ctx;
    sf_workspace picture;    /* of sf_render */
    sf_workspace comparison; /* of sf_loss and sf_compare */
    sf_params grads;
    size_t grad_room[SF_BANDS]; /* Gaussians with a band, at least */
    int grad_degree, has_grads;
    int rendered;                /* the workspace holds a picture */
    const sf_context *model_ctx; /* of the model that it shows */
    uint64_t version;
};

sf_render_options sf_render_options_default(void) {
    return (sf_render_options){.near_plane = 0, .sh_degree = -1, .antialiased = -1};
}

sf_status sf_renderer_create(sf_context *ctx, sf_renderer **out) {
    sf_renderer *renderer = *out = sf_calloc(ctx, 1, sizeof *renderer);
    if (!renderer) return SF_ERR_MEMORY;
    renderer->ctx = ctx;
    sf_workspace_init(&renderer->picture, ctx);
    sf_workspace_init(&renderer->comparison, ctx);
    return SF_OK;
}

void sf_renderer_destroy(sf_renderer **renderer_pointer) {
    sf_renderer *renderer = *renderer_pointer;
    if (!renderer) return;
    sf_workspace_free(&renderer->picture);
    sf_workspace_free(&renderer->comparison);
    sf_params_destroy(renderer->ctx, &renderer->grads);
    sf_free(renderer->ctx, renderer);
    *renderer_pointer = NULL;
}

sf_status sf_forward(sf_workspace *ws, const sf_model *model, const sf_camera *camera,
                     const sf_render_options *options, int with_depth) {
    if (sf_camera_check(camera))
        return sf_fail(ws->ctx, SF_ERR_ARGUMENT,
                       "camera: size, focal length or pose is out of range (%dx%d, fx %g, fy %g)",
                       (int)camera->width, (int)camera->height, camera->fx, camera->fy);
    if (!(options->near_plane >= 0 && isfinite(options->near_plane)))
        return sf_fail(ws->ctx, SF_ERR_ARGUMENT, "near_plane: %g is not above 0",
                       (double)options->near_plane);
    int degree = options->sh_degree < 0 ? model->sh_degree : options->sh_degree;
    if (degree > model->sh_degree)
        return sf_fail(ws->ctx, SF_ERR_ARGUMENT, "sh_degree: %d is more than the model's %d", degree,
                       model->sh_degree);
    int antialiased = options->antialiased < 0 ? model->antialiased : options->antialiased != 0;
    sf_status status = sf_workspace_look(ws, camera, options->near_plane);
    if (!status) status = sf_stage_project(ws, model, degree, antialiased);
    if (!status) status = sf_stage_bin(ws);
    if (!status) sf_stage_blend(ws, options->background, with_depth);
    return status;
}

sf_status sf_render(sf_renderer *renderer, const sf_model *model, const sf_camera *camera,
                    const sf_render_options *options, const sf_image_out *out) {
    sf_render_options defaults = sf_render_options_default();
    renderer->rendered = 0;
    sf_status status =
        sf_forward(&renderer->picture, model, camera, options ? options : &defaults, out->depth != NULL);
    if (status) return status;
    renderer->rendered = 1;
    renderer->model_ctx = model->ctx;
    renderer->version = model->version;
    sf_copy_out(&renderer->picture, out);
    return SF_OK;
}

static sf_status gradient_room(sf_renderer *renderer, const sf_model *model) {
    int enough = renderer->has_grads && model->sh_degree == renderer->grad_degree;
    for (int band = 0; band < SF_BANDS; band++)
        enough = enough && model->banded[band] <= renderer->grad_room[band];
    if (enough) return SF_OK;
    sf_params_destroy(renderer->ctx, &renderer->grads);
    renderer->has_grads = 0;
    sf_status status = sf_params_create(renderer->ctx, model->banded, model->sh_degree, &renderer->grads);
    if (status) return status;
    memcpy(renderer->grad_room, model->banded, sizeof renderer->grad_room);
    renderer->grad_degree = model->sh_degree;
    renderer->has_grads = 1;
    return SF_OK;
}

/* Clears the gradients of blocks that are out of view. */
static void clear_grads(const sf_renderer *renderer, size_t first, size_t end) {
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        size_t block = (size_t)sf_field_components(field) * SF_LANES;
        size_t stored = sf_blocks(renderer->grad_room[sf_field_band(field)]);
        size_t until = end < stored ? end : stored;
        if (renderer->grads.field[field] && first < until)
            memset(renderer->grads.field[field] + first * block, 0, (until - first) * block * sizeof(float));
    }
}

/* Keeps the gradients of some blocks. */
static void keep_grads(void *renderer_pointer, const sf_params *grads, size_t first, size_t end) {
    const sf_renderer *renderer = renderer_pointer;
    if (!grads) {
        clear_grads(renderer, first, end);
        return;
    }
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        size_t block = (size_t)sf_field_components(field) * SF_LANES;
        if (grads->field[field])
            memcpy(renderer->grads.field[field] + first * block, grads->field[field],
                   (end - first) * block * sizeof(float));
    }
}

sf_status sf_render_backward(sf_renderer *renderer, const sf_model *model, const float *d_rgb,
                             const sf_render_grads *grads) {
    sf_workspace *ws = &renderer->picture;
    if (!renderer->rendered || model->ctx != renderer->model_ctx || model->version != renderer->version)
        return sf_fail(renderer->ctx, SF_ERR_ARGUMENT,
                       "model: not the one that was rendered last, or changed since: render it first");
    sf_status status = gradient_room(renderer, model);
    if (status) return status;
    sf_copy_in(ws, d_rgb, NULL, ws->d_rgb);
    double camera[SF_CAMERA_SUMS];
    int with_camera = grads->pose || grads->focal;
    status = sf_stage_blend_bwd(ws);
    if (!status) status = sf_stage_project_bwd(ws, with_camera ? camera : NULL, keep_grads, renderer);
    if (!status && grads->pose) memcpy(grads->pose, camera, 6 * sizeof *camera);
    if (!status && grads->focal) memcpy(grads->focal, camera + 6, 2 * sizeof *camera);
    if (!status && grads->background) status = sf_stage_background_bwd(ws, grads->background);
    if (!status)
        sf_params_get(&renderer->grads, model->banded, model->sh_degree, 0, model->count, &grads->gaussians);
    return status;
}

/* Copies two pictures of the caller into the comparison workspace; returns the sum of the weights. */
static sf_status load_pair(sf_renderer *renderer, int width, int height, const float *rgb,
                           const float *target, const float *weight, double *weight_sum) {
    sf_workspace *ws = &renderer->comparison;
    sf_camera camera = {
        .width = width, .height = height, .fx = 1, .fy = 1, .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    if (sf_camera_check(&camera))
        return sf_fail(renderer->ctx, SF_ERR_ARGUMENT, "size: %dx%d is not in 1..65535", width, height);
    sf_status status = sf_workspace_look(ws, &camera, 1);
    if (!status) status = sf_workspace_loss_room(ws);
    if (status) return status;
    size_t pixels = (size_t)width * (size_t)height;
    *weight_sum = weight ? 0 : (double)pixels;
    for (size_t i = 0; weight && i < pixels; i++) {
        if (!(weight[i] >= 0 && weight[i] <= 1))
            return sf_fail(renderer->ctx, SF_ERR_ARGUMENT, "weight: %g at pixel %zu is not in 0..1",
                           (double)weight[i], i);
        *weight_sum += (double)weight[i];
    }
    if (!(*weight_sum > 0)) return sf_fail(renderer->ctx, SF_ERR_EMPTY, "weight: sums to 0");
    sf_copy_in(ws, rgb, NULL, ws->rgb);
    sf_copy_in(ws, target, weight, ws->target);
    ws->has_weight = weight != NULL;
    for (int y = 0; weight && y < height; y++)
        memcpy(ws->weight + (size_t)y * ws->stride, weight + (size_t)y * (size_t)width,
               (size_t)width * sizeof *weight);
    return SF_OK;
}

sf_status sf_loss(sf_renderer *renderer, const sf_image_pair *pair, double lambda, sf_loss_value *value,
                  float *d_rgb) {
    size_t width = (size_t)pair->width, height = (size_t)pair->height;
    double weight_sum;
    if (!(lambda >= 0 && lambda <= 1))
        return sf_fail(renderer->ctx, SF_ERR_ARGUMENT, "lambda: %g is not in 0..1", lambda);
    sf_status status =
        load_pair(renderer, pair->width, pair->height, pair->rgb, pair->target, pair->weight, &weight_sum);
    if (status) return status;
    sf_workspace *ws = &renderer->comparison;
    sf_stage_loss(ws, lambda, 0, weight_sum, 1, d_rgb != NULL, value);
    for (size_t y = 0; d_rgb && y < height; y++)
        for (size_t x = 0; x < width; x++)
            for (size_t ch = 0; ch < 3; ch++)
                d_rgb[3 * (y * width + x) + ch] = ws->d_rgb[ch][y * ws->stride + x];
    return SF_OK;
}

sf_status sf_compare(sf_renderer *renderer, int width, int height, const float *rgb, const float *target,
                     const float *weight, sf_quality *quality) {
    double weight_sum;
    sf_status status = load_pair(renderer, width, height, rgb, target, weight, &weight_sum);
    if (!status) sf_stage_quality(&renderer->comparison, weight_sum, quality);
    return status;
}
