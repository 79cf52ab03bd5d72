/* evaluate.c - renders views and compares them with their pictures. */
#include <stdlib.h>
#include <string.h>

#include "ranks.h"

sf_status app_draw_model(void *drawer, const sf_view_info *view, float *rgb) {
    const app_drawer *d = drawer;
    sf_image_out out = {.rgb = rgb};
    return sf_render(d->renderer, d->model, &view->camera, &d->options, &out);
}

/* A view's picture, its weights, and its render. */
typedef struct pair {
    float *truth, *weight, *drawn; /* one block */
} pair;

static sf_status draw_pair(sf_scene *scene, const sf_view_info *view, app_draw draw, void *user, pair *p) {
    size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
    p->truth = calloc(pixels, 7 * sizeof *p->truth);
    if (!p->truth) return SF_ERR_MEMORY;
    p->weight = p->truth + 3 * pixels;
    p->drawn = p->weight + pixels;
    sf_status status = sf_scene_get_pixels(scene, view->id, p->truth, p->weight);
    return status || !draw ? status : draw(user, view, p->drawn);
}

/* A view is drawn by `draw`, and compared in memory of its own. */
typedef struct drawn_views {
    sf_scene *scene;
    sf_renderer *renderer;
    app_draw draw;
    void *user; /* of draw */
} drawn_views;

static sf_status measure_drawn(void *drawn, const sf_view_info *view, sf_quality *quality) {
    const drawn_views *d = drawn;
    pair p = {0};
    sf_status status = draw_pair(d->scene, view, d->draw, d->user, &p);
    if (!status)
        status = sf_compare(d->renderer, view->camera.width, view->camera.height, p.drawn, p.truth,
                            view->has_mask ? p.weight : NULL, quality);
    free(p.truth);
    return status;
}

static sf_status evaluate_view(const sf_view_info *view, app_measure measure, void *user,
                               evaluation *result) {
    sf_quality quality = {0};
    sf_status status = measure(user, view, &quality);
    if (status == SF_ERR_EMPTY) return SF_OK; /* masked altogether */
    if (status) return status;
    result->views++;
    result->psnr += quality.psnr;
    result->ssim += quality.ssim;
    result->psnr_corrected += quality.psnr_corrected;
    json_array_append_new(result->list, json_pack("{s:o, s:f, s:f, s:f}", "name", app_json_text(view->name),
                                                  "psnr", quality.psnr, "ssim", quality.ssim,
                                                  "psnr_corrected", quality.psnr_corrected));
    return SF_OK;
}

static size_t count_views(sf_scene *scene, const args *a, const char *otherwise) {
    sf_view_info view;
    size_t count = 0;
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++)
        count += (size_t)app_split_wants(a, otherwise, view.split);
    return count;
}

sf_status app_evaluate(sf_scene *scene, const args *a, const char *otherwise, app_measure measure, void *user,
                       evaluation *result) {
    *result = (evaluation){
        .list = json_array(), .most = result->most, .progress = result->progress, .user = result->user};
    result->of = count_views(scene, a, otherwise);
    size_t all = result->most && result->of > (size_t)result->most ? (size_t)result->most : result->of;
    sf_status status = SF_OK;
    sf_view_info view;
    for (size_t i = 0, at = 0, done = 0; done < all && !status; i++) {
        status = sf_scene_get_view(scene, i, &view);
        if (status || !app_split_wants(a, otherwise, view.split)) continue;
        if (at++ != done * result->of / all) continue;
        status = evaluate_view(&view, measure, user, result);
        done++;
        if (!status && result->progress && result->progress(result->user, done, all))
            status = SF_ERR_CANCELLED;
    }
    if (result->views) {
        result->psnr /= (double)result->views;
        result->ssim /= (double)result->views;
        result->psnr_corrected /= (double)result->views;
    }
    return status;
}

sf_status app_evaluate_drawn(sf_context *ctx, sf_scene *scene, const args *a, const char *otherwise,
                             app_draw draw, void *user, evaluation *result) {
    drawn_views drawn = {.scene = scene, .draw = draw, .user = user};
    sf_status status = sf_renderer_create(ctx, &drawn.renderer);
    if (!status) status = app_evaluate(scene, a, otherwise, measure_drawn, &drawn, result);
    sf_renderer_destroy(&drawn.renderer);
    return status;
}

sf_status app_write_view(sf_context *ctx, sf_scene *scene, const sf_view_info *view, app_draw draw,
                         void *user, const char *path, sf_quality *quality) {
    int width = view->camera.width, height = view->camera.height;
    pair p = {0};
    sf_renderer *renderer = NULL;
    sf_status status = draw_pair(scene, view, draw, user, &p);
    if (!status && draw) status = sf_renderer_create(ctx, &renderer);
    if (!status && draw)
        status =
            sf_compare(renderer, width, height, p.drawn, p.truth, view->has_mask ? p.weight : NULL, quality);
    if (status == SF_ERR_EMPTY) status = SF_OK; /* masked altogether: no quality */
    if (!status && app_is_first_rank(ctx))
        status = sf_write_png(ctx, path, width, height, draw ? p.drawn : p.truth);
    sf_renderer_destroy(&renderer);
    free(p.truth);
    return status;
}

sf_status app_write_pair(sf_context *ctx, sf_scene *scene, const sf_view_info *view, app_draw draw,
                         void *user, const char *path) {
    size_t width = (size_t)view->camera.width, height = (size_t)view->camera.height, row = 3 * width;
    pair p = {0};
    float *both = calloc(row * height, 2 * sizeof *both);
    sf_status status = both ? draw_pair(scene, view, draw, user, &p) : SF_ERR_MEMORY;
    for (size_t y = 0; y < height && !status; y++) {
        memcpy(both + 2 * row * y, p.truth + row * y, row * sizeof *both);
        memcpy(both + 2 * row * y + row, p.drawn + row * y, row * sizeof *both);
    }
    if (!status && app_is_first_rank(ctx))
        status = sf_write_png(ctx, path, (int)(2 * width), (int)height, both);
    free(both);
    free(p.truth);
    return status;
}
