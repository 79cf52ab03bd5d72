/* workspace.c - the arrays of a step, allocated once and enlarged for a larger picture or model. */
#include "workspace.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"

enum { MOST_TILES = (1 << 28) / SF_TILE_PIXELS };

void sf_workspace_init(sf_workspace *ws, sf_context *ctx) {
    memset(ws, 0, sizeof *ws);
    ws->ctx = ctx;
}

void sf_workspace_free(sf_workspace *ws) {
    struct sf_cluster *cluster = ws->cluster;
    struct sf_shard *shard = ws->shard;
    void *blocks[] = {ws->transmittance, ws->depth,       ws->last,          ws->splats,      ws->state,
                      ws->first_row,     ws->rows,        ws->slot,          ws->span_offset, ws->screen,
                      ws->grads,         ws->depth_of,    ws->spans,         ws->bin_counts,  ws->tile_begin,
                      ws->entries,       ws->entry_slots, ws->sums,          ws->entry_parts, ws->weight,
                      ws->scratch,       ws->partial,     ws->partial_count, ws->in_view};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(ws->ctx, blocks[i]);
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        sf_free(ws->ctx, ws->rgb[ch]);
        sf_free(ws->ctx, ws->d_rgb[ch]);
        sf_free(ws->ctx, ws->target[ch]);
    }
    sf_workspace_init(ws, ws->ctx);
    ws->cluster = cluster, ws->shard = shard; /* what is drawn next is shared, too */
}

/* Replaces a block by a larger, cleared one; the content is lost. */
static sf_status renew(sf_context *ctx, void *block_pointer, size_t count, size_t size) {
    void *old, *block = sf_calloc(ctx, count, size);
    if (!block) return SF_ERR_MEMORY;
    memcpy(&old, block_pointer, sizeof old);
    sf_free(ctx, old);
    memcpy(block_pointer, &block, sizeof block);
    return SF_OK;
}

static void set_eye(sf_eye *eye, const sf_camera *camera, float near_plane) {
    double center[3];
    sf_camera_center(camera, center);
    for (int k = 0; k < 9; k++) eye->R[k] = (float)camera->R_cw[k];
    for (int k = 0; k < 3; k++) {
        eye->t[k] = (float)camera->t_cw[k];
        eye->center[k] = (float)center[k];
    }
    eye->fx = (float)camera->fx, eye->fy = (float)camera->fy;
    eye->cx = (float)camera->cx, eye->cy = (float)camera->cy;
    eye->clamp_x = (float)(1.3 * camera->width / (2 * camera->fx));
    eye->clamp_y = (float)(1.3 * camera->height / (2 * camera->fy));
    eye->near_plane = near_plane;
    eye->low_pass = SF_LOW_PASS;
    eye->width = camera->width, eye->height = camera->height;
    eye->tiles_x = (camera->width + SF_TILE - 1) / SF_TILE;
    eye->tiles_y = (camera->height + SF_TILE - 1) / SF_TILE;
}

/* The low-pass of the full picture in coarse pixels, plus the variance of the full picture's pixel centres
 * within a coarse pixel. With 0.3 px^2 at every size, a model fitted to small pictures would be too thin. */
void sf_workspace_reduced(sf_workspace *ws, int factor) {
    double square = (double)factor * factor;
    ws->eye.low_pass = SF_LOW_PASS / square + (1 - 1 / square) / 12;
}

sf_status sf_workspace_look(sf_workspace *ws, const sf_camera *camera, float near_plane) {
    sf_eye eye;
    set_eye(&eye, camera, near_plane);
    if ((uint64_t)eye.tiles_x * (uint64_t)eye.tiles_y > MOST_TILES)
        return sf_fail(ws->ctx, SF_ERR_ARGUMENT, "camera: %dx%d px are more than 2^28", (int)camera->width,
                       (int)camera->height);
    size_t tiles = (size_t)eye.tiles_x * (size_t)eye.tiles_y, need = tiles * SF_TILE_PIXELS;
    sf_status status = SF_OK;
    if (need > ws->plane_capacity) {
        ws->plane_capacity = 0;
        for (int ch = 0; ch < SF_CHANNELS && !status; ch++) {
            status = renew(ws->ctx, &ws->rgb[ch], need, sizeof(float));
            if (!status) status = renew(ws->ctx, &ws->d_rgb[ch], need, sizeof(float));
        }
        if (!status) status = renew(ws->ctx, &ws->transmittance, need, sizeof(float));
        if (!status) status = renew(ws->ctx, &ws->depth, need, sizeof(float));
        if (!status) status = renew(ws->ctx, &ws->last, need, sizeof(uint32_t));
        if (!status) ws->plane_capacity = need;
    }
    if (!status && tiles + 1 > ws->tile_capacity) {
        ws->tile_capacity = 0;
        status = renew(ws->ctx, &ws->tile_begin, tiles + 1, sizeof(uint32_t));
        if (!status) ws->tile_capacity = tiles + 1;
    }
    if (status) return status;
    ws->eye = eye;
    ws->unit = 0;
    ws->stride = (size_t)eye.tiles_x * SF_TILE;
    ws->plane_rows = (size_t)eye.tiles_y * SF_TILE;
    return SF_OK;
}

sf_status sf_workspace_loss_room(sf_workspace *ws) {
    size_t need = ws->plane_capacity, threads = (size_t)sf_pool_threads(ws->ctx->pool);
    sf_status status = SF_OK;
    if (need > ws->loss_capacity) {
        ws->loss_capacity = 0;
        for (int ch = 0; ch < SF_CHANNELS && !status; ch++)
            status = renew(ws->ctx, &ws->target[ch], need, sizeof(float));
        if (!status) status = renew(ws->ctx, &ws->weight, need, sizeof(float));
        if (!status) ws->loss_capacity = need;
    }
    size_t scratch = threads * sf_loss_scratch(ws->stride);
    if (!status && scratch > ws->scratch_capacity) {
        ws->scratch_capacity = 0;
        status = renew(ws->ctx, &ws->scratch, scratch, sizeof(float));
        if (!status) ws->scratch_capacity = scratch;
    }
    /* loss: L1 and SSIM of each row of each channel */
    size_t partial = 2 * SF_CHANNELS * (size_t)ws->eye.height;
    if (!status) status = sf_grow(ws->ctx, &ws->partial, &ws->partial_capacity, 0, partial, sizeof(double));
    return status;
}

void sf_copy_out(const sf_workspace *ws, const sf_image_out *out) {
    size_t width = (size_t)ws->eye.width, height = (size_t)ws->eye.height;
    float unit = ldexpf(1, ws->unit);
    for (size_t y = 0; y < height; y++)
        for (size_t x = 0; x < width; x++) {
            size_t from = y * ws->stride + x, to = y * width + x;
            for (size_t ch = 0; out->rgb && ch < 3; ch++) out->rgb[3 * to + ch] = ws->rgb[ch][from];
            if (out->transmittance) out->transmittance[to] = ws->transmittance[from];
            if (out->depth) out->depth[to] = unit * ws->depth[from];
        }
}

void sf_copy_in(const sf_workspace *ws, const float *rgb, const float *weight, float *const plane[3]) {
    size_t width = (size_t)ws->eye.width, height = (size_t)ws->eye.height;
    for (size_t ch = 0; ch < SF_CHANNELS; ch++) {
        memset(plane[ch], 0, ws->plane_rows * ws->stride * sizeof(float));
        for (size_t y = 0; y < height; y++)
            for (size_t x = 0; x < width; x++) {
                size_t from = y * width + x;
                plane[ch][y * ws->stride + x] = rgb[3 * from + ch] * (weight ? weight[from] : 1.0f);
            }
    }
}
