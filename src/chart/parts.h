/* parts.h - what the charts have in common: styles, titles, legends, bars. */
#ifndef CHART_PARTS_H
#define CHART_PARTS_H

#include "chart.h"

/* px */
enum {
    CHART_WIDTH = 760,
    CHART_LEFT = 70,
    CHART_RIGHT = 30,
    CHART_TOP = 64,
    CHART_PLOT = 320,
    CHART_ROW = 19
};

const char *chart_color(size_t style);
/* Where colours begin anew, shapes step on by one and dashes by two: no two pairs are the same. */
const char *chart_dashes(size_t style);
svg_shape chart_shape(size_t style);

/* 12345 as 12,345. */
void chart_grouped(double value, char *text, size_t size);

/* Title, and under it the machine of the scene of `first`, or that there are several. */
void chart_put_title(svg *s, const chart_input *input, const chart_run *first, const char *what);

/* Text at a row, cut off where the picture ends. */
void chart_row_text(svg *s, double x, double y, const char *text);

/* A row of the legend, *y px down, which goes on to the next: a piece of the line (may be NULL), the mark on
 * it, and what they stand for. */
void chart_legend_row(svg *s, double *y, const char *what, svg_shape shape, const svg_style *line,
                      const svg_style *mark);

/* Bars from 0 on, in rows: an axis below, the figures behind each bar. px; BAR_ROOM behind the longest bar.
 */
enum { CHART_BAR = 13, CHART_BAR_LEFT = 110, CHART_BAR_ROOM = 240 };

svg_axis chart_bar_axis(double most, int room);
void chart_draw_bar_axis(svg *s, const svg_axis *axis, double top, double bottom, const char *name);

#endif
