/* svg.h - a small writer of charts: text, lines, dots and logarithmic axes. */
#ifndef BENCH_SVG_H
#define BENCH_SVG_H

#include "../base/file.h"

enum { SVG_LABELS = 256 };

typedef struct svg_box {
    double x0, y0, x1, y1;
} svg_box;

typedef struct svg {
    sf_writer out;
    svg_box taken[SVG_LABELS]; /* by dots and labels of dots */
    int count;
} svg;

/* An axis from `least` to `most`, at from .. to px, logarithmic. */
typedef struct svg_axis {
    double least, most, from, to;
} svg_axis;

typedef enum svg_anchor { SVG_START, SVG_MIDDLE, SVG_END } svg_anchor;

/* Colours that read on white and on black. */
#define SVG_INK   "#7d8590"
#define SVG_FAINT "#7d859055"

sf_status svg_open(svg *s, sf_context *ctx, const char *path, int width, int height);
/* Ends the file; what stood at its path stands until then. */
sf_status svg_close(svg *s);

void svg_text(svg *s, double x, double y, double size, svg_anchor anchor, const char *color,
              const char *text);
void svg_text_up(svg *s, double x, double y, double size, const char *color, const char *text);
void svg_line(svg *s, double x0, double y0, double x1, double y1, const char *color, double width,
              const char *dashes);
void svg_dot(svg *s, double x, double y, double radius, const char *color);

/* A label beside a dot, where no dot and no other label is. Draw all dots before. */
void svg_label(svg *s, double x, double y, double size, const char *color, const char *text);

/* Widens the range of an axis by a value above 0. */
void svg_axis_see(svg_axis *a, double value);
/* To whole decades, or to 1, 2 and 5 of them. */
void svg_axis_round(svg_axis *a);
double svg_axis_at(const svg_axis *a, double value);

/* Frame, grid and numbers; title above; names of the axes where they are not NULL. */
void svg_axes(svg *s, const svg_axis *x, const svg_axis *y, const char *title, const char *x_name,
              const char *y_name);

#endif
