/* consistency.c - see consistency.h. */
#include "consistency.h"

#include <stdlib.h>
#include <string.h>

#include "pixels.h"

enum { SPREAD = 120 /* the distance of a probe's pixels is the longest side / SPREAD */ };

double sf_pixel_of(const sf_camera *c, const float *xyz, size_t *x, size_t *y) {
    double q[3];
    for (int i = 0; i < 3; i++) {
        q[i] = c->t_cw[i];
        for (int k = 0; k < 3; k++) q[i] += c->R_cw[3 * i + k] * (double)xyz[k];
    }
    double u = c->fx * q[0] / q[2] + c->cx, v = c->fy * q[1] / q[2] + c->cy;
    if (!(q[2] > 0 && u >= 0 && u < c->width && v >= 0 && v < c->height)) return 0;
    *x = (size_t)u, *y = (size_t)v;
    return q[2];
}

void sf_behind_pixel(const sf_camera *c, size_t x, size_t y, double depth, float *xyz) {
    double p[3] = {((double)x + 0.5 - c->cx) / c->fx * depth - c->t_cw[0],
                   ((double)y + 0.5 - c->cy) / c->fy * depth - c->t_cw[1], depth - c->t_cw[2]};
    for (int k = 0; k < 3; k++)
        xyz[k] = (float)(c->R_cw[k] * p[0] + c->R_cw[3 + k] * p[1] + c->R_cw[6 + k] * p[2]);
}

/* A view that is read. */
typedef struct read_view {
    const sf_view *view;
    const sf_camera *camera;
    sf_view_pixels pixels; /* rgb NULL: its pixels are read one by one */
    size_t width, plane;
    sf_status status; /* of these */
} read_view;

/* Its colour at a pixel; returns the weight. */
static uint8_t pixel(read_view *v, size_t x, size_t y, uint8_t rgb[3]) {
    size_t at = y * v->width + x;
    if (!v->pixels.rgb) {
        uint8_t weight = 255;
        if (!v->status) v->status = sf_view_weight(v->view, x, y, &weight);
        if (!v->status) v->status = sf_view_color(v->view, x, y, rgb);
        if (v->status) memset(rgb, 0, 3);
        return weight;
    }
    for (size_t k = 0; k < 3; k++) rgb[k] = v->pixels.rgb[k * v->plane + at];
    return v->pixels.weight ? v->pixels.weight[at] : 255;
}

/* What is done with an item, which reads up to `pixels` of its view. */
typedef struct visitor {
    void (*visit)(read_view *view, sf_probe *probes, size_t item);
    size_t pixels;
} visitor;

static sf_status visit(const sf_view *view, const size_t *items, size_t count, const visitor *by,
                       sf_probe *probes) {
    read_view v = {.view = view, .camera = &view->camera, .width = (size_t)view->camera.width};
    if (!count) return SF_OK;
    if (sf_view_is_worth_opening(view, count * by->pixels)) v.status = sf_view_open(view, &v.pixels);
    v.plane = v.width * (size_t)view->camera.height;
    for (size_t i = 0; i < count && !v.status; i++) by->visit(&v, probes, items[i]);
    if (v.pixels.rgb) sf_view_close(view, &v.pixels);
    return v.status;
}

/* Items [count], the view of each in keys. */

static sf_status visit_by_view(sf_context *ctx, const sf_view *const *views, size_t n, const uint32_t *keys,
                               size_t count, const visitor *by, sf_probe *probes) {
    size_t *first = sf_calloc(ctx, n + 2, sizeof *first), *items = sf_alloc(ctx, count, sizeof *items);
    sf_status status = first && items ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        /* counting sort: first[v + 1] becomes where the items of view v begin, and then where they end */
        for (size_t i = 0; i < count; i++) first[keys[i] + 2]++;
        for (size_t v = 2; v < n + 2; v++) first[v] += first[v - 1];
        for (size_t i = 0; i < count; i++) items[first[keys[i] + 1]++] = i;
    }
    for (size_t v = 0; v < n && !status; v++) {
        size_t next = v + 1 < n ? first[v + 2] - first[v + 1] : 0;
        if (next && sf_view_is_worth_opening(views[v + 1], next * by->pixels)) sf_view_expect(views[v + 1]);
        status = visit(views[v], items + first[v], first[v + 1] - first[v], by, probes);
    }
    sf_free(ctx, items);
    sf_free(ctx, first);
    return status;
}

static size_t clamped(int at, int size) { return (size_t)(at < 0 ? 0 : at < size ? at : size - 1); }

static void read_colors(read_view *v, sf_probe *probes, size_t item) {
    static const int across[SF_PROBE_PIXELS] = {0, 1, -1, 0, 0}, down[SF_PROBE_PIXELS] = {0, 0, 0, 1, -1};
    sf_probe *p = &probes[item];
    const sf_camera *c = v->camera;
    int step = 1 + (c->width > c->height ? c->width : c->height) / SPREAD;
    for (int i = 0; i < SF_PROBE_PIXELS; i++) {
        p->xs[i] = clamped((int)p->x + step * across[i], c->width);
        p->ys[i] = clamped((int)p->y + step * down[i], c->height);
        if (pixel(v, p->xs[i], p->ys[i], p->colors[i])) continue;
        p->xs[i] = p->x, p->ys[i] = p->y;
        (void)pixel(v, p->x, p->y, p->colors[i]);
    }
}

sf_status sf_probe_colors(sf_context *ctx, const sf_view *const *views, size_t n, sf_probe *probes,
                          size_t count) {
    uint32_t *keys = sf_alloc(ctx, count, sizeof *keys);
    const visitor by = {read_colors, SF_PROBE_PIXELS};
    if (!keys) return SF_ERR_MEMORY;
    for (size_t i = 0; i < count; i++) keys[i] = probes[i].view;
    sf_status status = visit_by_view(ctx, views, n, keys, count, &by, probes);
    sf_free(ctx, keys);
    return status;
}

static int difference(read_view *v, const float *xyz, const uint8_t *rgb) {
    size_t x, y;
    uint8_t there[3];
    int sum = 0;
    if (!(sf_pixel_of(v->camera, xyz, &x, &y) > 0)) return SF_PROBE_MOST_DIFFERENCE;
    if (!pixel(v, x, y, there)) return SF_PROBE_MOST_DIFFERENCE;
    for (int k = 0; k < 3; k++) sum += abs((int)there[k] - (int)rgb[k]);
    return sum < SF_PROBE_MOST_DIFFERENCE ? sum : SF_PROBE_MOST_DIFFERENCE;
}

static void add_differences(read_view *v, sf_probe *probes, size_t item) {
    sf_probe *p = &probes[item / SF_PROBE_VIEWS];
    for (size_t d = 0; d < p->depth_count; d++)
        for (int i = 0; i < SF_PROBE_PIXELS; i++) p->sums[d] += difference(v, p->points[d][i], p->colors[i]);
}

sf_status sf_probe_compare(sf_context *ctx, const sf_view *const *views, size_t n, sf_probe *probes,
                           size_t count) {
    uint32_t *keys = sf_alloc(ctx, count, SF_PROBE_VIEWS * sizeof *keys);
    const visitor by = {add_differences, SF_PROBE_DEPTHS * SF_PROBE_PIXELS};
    if (!keys) return SF_ERR_MEMORY;
    for (size_t i = 0; i < count; i++) {
        sf_probe *p = &probes[i];
        memcpy(keys + SF_PROBE_VIEWS * i, p->others, sizeof p->others);
        for (size_t d = 0; d < p->depth_count; d++) {
            p->sums[d] = 0;
            for (int k = 0; k < SF_PROBE_PIXELS; k++)
                sf_behind_pixel(&views[p->view]->camera, p->xs[k], p->ys[k], p->depths[d], p->points[d][k]);
        }
    }
    sf_status status = visit_by_view(ctx, views, n, keys, SF_PROBE_VIEWS * count, &by, probes);
    sf_free(ctx, keys);
    return status;
}
