/* consistency.h - photo-consistency: how well views agree on the colours at depths behind a pixel. Questions
 * are answered many at a time, view by view: each picture is opened once. */
#ifndef SF_SCENE_CONSISTENCY_H
#define SF_SCENE_CONSISTENCY_H

#include "scene.h"

enum {
    SF_PROBE_PIXELS = 5,            /* that sample a point's surroundings, the first in the middle */
    SF_PROBE_VIEWS = 8,             /* with which their colours are compared */
    SF_PROBE_DEPTHS = 21,           /* at most */
    SF_PROBE_MOST_DIFFERENCE = 120, /* of two colours, the sum over the channels, of 3 x 255 */
};

/* A pixel, a few around it, and the depths behind them at which other views are looked at. */
typedef struct sf_probe {
    uint32_t view, others[SF_PROBE_VIEWS]; /* indices of views */
    size_t x, y;
    size_t depth_count;
    double depths[SF_PROBE_DEPTHS]; /* camera z */
    /* sf_probe_colors: */
    size_t xs[SF_PROBE_PIXELS], ys[SF_PROBE_PIXELS]; /* the pixels; a masked one is replaced by the middle */
    uint8_t colors[SF_PROBE_PIXELS][3];
    /* sf_probe_compare: */
    float points[SF_PROBE_DEPTHS][SF_PROBE_PIXELS][3]; /* behind the pixels */
    int sums[SF_PROBE_DEPTHS]; /* differences of the colours, each at most SF_PROBE_MOST_DIFFERENCE, since
                                  something may occlude the point; that also where a view does not see it */
} sf_probe;

/* Projects a point to a pixel; returns its camera z, 0 outside the picture. */
double sf_pixel_of(const sf_camera *camera, const float *xyz, size_t *x, size_t *y);
/* The world point at `depth` behind a pixel. */
void sf_behind_pixel(const sf_camera *camera, size_t x, size_t y, double depth, float *xyz);

/* Reads the colours of the probes' own views. SF_ERR_MEMORY; as sf_view_open. */
sf_status sf_probe_colors(sf_context *ctx, const sf_view *const *views, size_t n, sf_probe *probes,
                          size_t count);
/* Compares these with the other views. SF_ERR_MEMORY; as sf_view_open. */
sf_status sf_probe_compare(sf_context *ctx, const sf_view *const *views, size_t n, sf_probe *probes,
                           size_t count);

#endif
