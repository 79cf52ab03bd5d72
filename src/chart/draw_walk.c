/* draw_walk.c - how far the keyframes of live fits are off the truth along their walks. */
#include <math.h>
#include <stdio.h>

#include "../base/statistics.h"
#include "parts.h"

static void draw_walk(svg *s, const chart_walk *w, size_t style, const svg_axis *x, const svg_axis *y,
                      svg_point *points) {
    char note[CHART_TEXT + 96];
    for (size_t i = 0; i < w->count; i++)
        points[i] = (svg_point){svg_axis_at(x, w->points[i].x), svg_axis_at(y, w->points[i].y)};
    svg_style line = {
        .stroke = chart_color(style), .width = 1.4, .dashes = chart_dashes(style), .kind = "curve"};
    svg_polyline(s, points, w->count, &line);
    for (size_t i = 0; i < w->count; i++) {
        snprintf(note, sizeof note, "%s: the keyframe of %.1f s is off by %.3g", w->name, w->points[i].x,
                 w->points[i].y);
        svg_style mark = {.fill = chart_color(style), .kind = "mark", .note = note};
        svg_mark(s, chart_shape(style), points[i].x, points[i].y, 3, &mark);
    }
}

/* A row of the legend; scratch [count]. */
static void name_walk(svg *s, const chart_walk *w, size_t style, double *scratch, double *legend) {
    char what[CHART_TEXT + 128];
    svg_style line = {.stroke = chart_color(style), .width = 1.4, .dashes = chart_dashes(style)};
    svg_style mark = {.fill = chart_color(style)};
    double most = 0;
    for (size_t i = 0; i < w->count; i++) scratch[i] = w->points[i].y, most = fmax(most, w->points[i].y);
    snprintf(what, sizeof what, "%s: %zu keyframes, median %.3g and %.2f degrees, at most %.3g", w->name,
             w->count, sf_median(scratch, w->count), w->degrees, most);
    chart_legend_row(s, legend, what, chart_shape(style), &line, &mark);
}

sf_status chart_draw_walks(const chart_input *input, sf_writer *out) {
    svg s;
    size_t longest = 0;
    double legend = CHART_TOP + CHART_PLOT + 62;
    svg_axis x = {.from = CHART_LEFT, .to = CHART_WIDTH - CHART_RIGHT, .linear = 1};
    svg_axis y = {.from = CHART_TOP + CHART_PLOT, .to = CHART_TOP, .linear = 1};
    svg_axis_see(&x, 0), svg_axis_see(&y, 0), svg_axis_see(&x, 1e-3), svg_axis_see(&y, 1e-9);
    for (size_t i = 0; i < input->walk_count; i++) {
        const chart_walk *w = &input->walks[i];
        if (w->count > longest) longest = w->count;
        for (size_t k = 0; k < w->count; k++)
            svg_axis_see(&x, w->points[k].x), svg_axis_see(&y, w->points[k].y);
    }
    svg_axis_round(&x), svg_axis_round(&y);
    svg_point *points = sf_alloc(input->ctx, longest + 1, sizeof *points);
    double *scratch = sf_alloc(input->ctx, longest + 1, sizeof *scratch);
    if (points && scratch) {
        svg_begin(&s, out, CHART_WIDTH,
                  CHART_TOP + CHART_PLOT + 44 + CHART_ROW * (int)(input->walk_count + 1));
        svg_text(&s, CHART_LEFT, 24, 15, SVG_START, SVG_INK, "Keyframes off the truth along the walk");
        svg_axes(&s, &x, &y, "", "seconds of the camera's clock", "distance to the true place, world units");
        for (size_t i = 0; i < input->walk_count; i++) draw_walk(&s, &input->walks[i], i, &x, &y, points);
        for (size_t i = 0; i < input->walk_count; i++) name_walk(&s, &input->walks[i], i, scratch, &legend);
        svg_end(&s);
    }
    sf_status status = points && scratch ? SF_OK : SF_ERR_MEMORY;
    sf_free(input->ctx, points);
    sf_free(input->ctx, scratch);
    return status;
}
