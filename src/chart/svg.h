/* svg.h - a small writer of charts: text, lines, marks, areas and axes. */
#ifndef CHART_SVG_H
#define CHART_SVG_H

#include "../base/file.h"

enum { SVG_LABELS = 256 };

typedef struct svg_box {
    double x0, y0, x1, y1;
} svg_box;

typedef struct svg {
    sf_writer *out, own;       /* own: the picture's file, if it has a separate one */
    svg_box taken[SVG_LABELS]; /* by dots and labels of dots */
    int count;
} svg;

/* An axis from `least` to `most`, at from .. to px, logarithmic or linear. */
typedef struct svg_axis {
    double least, most, from, to;
    int linear;
} svg_axis;

typedef struct svg_point {
    double x, y;
} svg_point;

/* Marks of one radius have one area. */
typedef enum svg_shape {
    SVG_CIRCLE,
    SVG_SQUARE,
    SVG_UP,
    SVG_DIAMOND,
    SVG_DOWN,
    SVG_PLUS,
    SVG_PENTAGON,
    SVG_CROSS,
    SVG_SHAPES
} svg_shape;

/* How something is drawn; what is NULL or 0 is left out. */
typedef struct svg_style {
    const char *fill, *stroke, *dashes;
    double opacity;   /* of the fill; 0: opaque */
    double width;     /* of the stroke */
    const char *kind; /* the class of the element */
    const char *note; /* shown where a pointer rests on it */
} svg_style;

typedef enum svg_anchor { SVG_START, SVG_MIDDLE, SVG_END } svg_anchor;

/* Colours that read on white and on black. */
#define SVG_INK   "#7d8590"
#define SVG_FAINT "#7d859055"

sf_status svg_open(svg *s, sf_context *ctx, const char *path, int width, int height);
/* Ends the file; what stood at its path stands until then. */
sf_status svg_close(svg *s);

/* The same within a document that `out` writes. */
void svg_begin(svg *s, sf_writer *out, int width, int height);
void svg_end(svg *s);

/* Text as XML and HTML hold it. */
void svg_put_text(sf_writer *out, const char *text);

void svg_text(svg *s, double x, double y, double size, svg_anchor anchor, const char *color,
              const char *text);
void svg_text_up(svg *s, double x, double y, double size, const char *color, const char *text);
void svg_line(svg *s, double x0, double y0, double x1, double y1, const svg_style *style);
void svg_dot(svg *s, double x, double y, double radius, const char *color);

void svg_polyline(svg *s, const svg_point *points, size_t count, const svg_style *style);
void svg_polygon(svg *s, const svg_point *points, size_t count, const svg_style *style);
void svg_rect(svg *s, double x, double y, double width, double height, const svg_style *style);
void svg_mark(svg *s, svg_shape shape, double x, double y, double radius, const svg_style *style);

/* A label beside a dot, where no dot and no other label is. Draw all dots before. */
void svg_label(svg *s, double x, double y, double size, const char *color, const char *text);

/* Widens the range of an axis by a value, which a logarithmic one wants above 0. */
void svg_axis_see(svg_axis *a, double value);
/* To whole decades, or to 1, 2 and 5 of them; a linear one to its ticks. */
void svg_axis_round(svg_axis *a);
double svg_axis_at(const svg_axis *a, double value);

/* The lines and numbers of one axis across from .. to px of the other; upright lines are those of an x axis.
 */
void svg_grid(svg *s, const svg_axis *a, double from, double to, int upright);

/* Frame, grid and numbers; title above; names of the axes where they are not NULL. */
void svg_axes(svg *s, const svg_axis *x, const svg_axis *y, const char *title, const char *x_name,
              const char *y_name);

#endif
