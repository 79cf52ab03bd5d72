/* compare.c - measures the fit's renders of views against their pictures.
 *
 * All is done in the fitter's workspace; of several ranks each draws a band of the picture, reads the pixels
 * of its band, and adds its sums to those of the others.
 */
#include "compare.h"

#include <math.h>

#include "../cluster/cluster.h"
#include "../render/shard.h"
#include "../scene/pixels.h"
#include "draw_view.h"
#include "moving_average.h"
#include "refine.h"

/* Draws a view as a band on each rank. What travels for it is not a step's. */
static sf_status draw(sf_fitter *f, const sf_model *model, const sf_camera *camera,
                      const sf_render_options *options) {
    sf_cluster *ranks = f->workspace.cluster;
    double designed = ranks ? ranks->designed : 0;
    f->workspace.band_only = 1;
    sf_status status = sf_forward(&f->workspace, model, camera, options, 0);
    if (ranks) ranks->designed = designed;
    return status;
}

static sf_status compare(sf_fitter *f, const sf_view *view, sf_quality *quality) {
    sf_workspace *ws = &f->workspace;
    double weight_sum;
    sf_status status = sf_workspace_loss_room(ws);
    if (!status) status = sf_load_target(f, view, 1, &weight_sum);
    if (status) return status;
    if (!(weight_sum > 0)) return sf_fail(f->ctx, SF_ERR_EMPTY, "view %u is wholly masked", view->id);
    sf_stage_quality(ws, weight_sum, quality);
    return SF_OK;
}

sf_status sf_fitter_compare(sf_fitter *f, uint32_t id, sf_quality *quality) {
    sf_render_options options;
    sf_camera camera;
    sf_status status = sf_fitter_get_camera(f, id, &camera);
    sf_view *view = status ? NULL : sf_scene_retain_id(f->scene, id);
    if (!view) return status ? status : sf_fail(f->ctx, SF_ERR_ARGUMENT, "there is no view %u", id);
    sf_view_expect(view);
    sf_fitter_render_options(f, &options);
    status = draw(f, sf_fitter_average_model(f), &camera, &options);
    if (!status) status = compare(f, view, quality);
    f->workspace.band_only = 0;
    sf_view_release(view);
    return status;
}

/* Adds the weighted squared error of the rows that this rank draws against the view, and the weights. */
static sf_status add_squares(sf_fitter *f, const sf_view *view, double sums[2]) {
    const sf_workspace *ws = &f->workspace;
    size_t width = (size_t)view->camera.width, first, end;
    sf_view_pixels pixels;
    sf_shard_rows(ws, &first, &end);
    size_t rows = end - first, plane = rows * width;
    sf_status status = sf_grow(f->ctx, &f->band_pixels, &f->band_pixels_capacity, 0,
                               plane * sf_view_pixel_bytes(view) + 1, 1);
    if (!status) status = sf_view_read_rows(view, first, end, f->band_pixels, &pixels);
    for (size_t y = 0; y < rows && !status; y++)
        for (size_t x = 0; x < width; x++) {
            size_t at = y * width + x;
            double weight = pixels.weight ? pixels.weight[at] / 255.0 : 1;
            for (size_t ch = 0; ch < SF_CHANNELS; ch++) {
                double value = (double)ws->rgb[ch][(first + y) * ws->stride + x];
                double error = fmin(fmax(value, 0), 1) - pixels.rgb[ch * plane + at] / 255.0;
                sums[0] += weight * error * error;
            }
            sums[1] += weight;
        }
    return status;
}

sf_status sf_view_psnr(sf_fitter *f, const sf_view *view, double *psnr) {
    sf_render_options options;
    sf_camera camera = view->camera;
    double sums[2] = {0};
    sf_view_expect(view);
    sf_fitter_render_options(f, &options);
    options.sh_degree = f->sh_degree;
    sf_refine_camera(&f->views, view->id, &camera);
    sf_status status = draw(f, f->model, &camera, &options);
    if (!status) status = add_squares(f, view, sums);
    if (!status) sf_shard_sum(&f->workspace, sums, 2);
    f->workspace.band_only = 0;
    if (status) return status;
    *psnr = sums[1] > 0 ? sf_psnr_of(sums[0] / (3 * sums[1])) : NAN;
    return SF_OK;
}
