/* svg.c - a small writer of charts: text, lines, marks, areas and axes. */
#include "svg.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

void svg_begin(svg *s, sf_writer *out, int width, int height) {
    s->count = 0;
    s->out = out;
    sf_writer_printf(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" "
        "font-family=\"system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif\">\n",
        width, height, width, height);
}

void svg_end(svg *s) { sf_writer_printf(s->out, "</svg>\n"); }

sf_status svg_open(svg *s, sf_context *ctx, const char *path, int width, int height) {
    sf_status status = sf_writer_open(&s->own, ctx, path);
    if (!status) svg_begin(s, &s->own, width, height);
    return status;
}

sf_status svg_close(svg *s) {
    svg_end(s);
    return sf_writer_commit(&s->own);
}

void svg_put_text(sf_writer *out, const char *text) {
    static const char *const names[] = {['&'] = "&amp;", ['<'] = "&lt;", ['>'] = "&gt;", ['"'] = "&quot;"};
    for (; *text; text++) {
        unsigned char c = (unsigned char)*text;
        if (c < sizeof names / sizeof *names && names[c])
            sf_writer_printf(out, "%s", names[c]);
        else
            sf_writer_put(out, c < ' ' ? "?" : text, 1); /* XML has no control characters */
    }
}

void svg_text(svg *s, double x, double y, double size, svg_anchor anchor, const char *color,
              const char *text) {
    static const char *const names[] = {"start", "middle", "end"};
    sf_writer_printf(s->out, "<text x=\"%.1f\" y=\"%.1f\" font-size=\"%.1f\" text-anchor=\"%s\" fill=\"%s\">",
                     x, y, size, names[anchor], color);
    svg_put_text(s->out, text);
    sf_writer_printf(s->out, "</text>\n");
}

void svg_text_up(svg *s, double x, double y, double size, const char *color, const char *text) {
    sf_writer_printf(s->out,
                     "<text transform=\"translate(%.1f %.1f) rotate(-90)\" font-size=\"%.1f\" "
                     "text-anchor=\"middle\" fill=\"%s\">",
                     x, y, size, color);
    svg_put_text(s->out, text);
    sf_writer_printf(s->out, "</text>\n");
}

void svg_line(svg *s, double x0, double y0, double x1, double y1, const svg_style *style) {
    sf_writer_printf(s->out,
                     "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" "
                     "stroke-width=\"%.1f\" stroke-dasharray=\"%s\"/>\n",
                     x0, y0, x1, y1, style->stroke, style->width, style->dashes ? style->dashes : "none");
}

static void take_box(svg *s, double x0, double y0, double x1, double y1) {
    if (s->count < SVG_LABELS) s->taken[s->count++] = (svg_box){x0, y0, x1, y1};
}

void svg_dot(svg *s, double x, double y, double radius, const char *color) {
    sf_writer_printf(s->out, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"%s\"/>\n", x, y, radius,
                     color);
    take_box(s, x - radius, y - radius, x + radius, y + radius);
}

static void put_style(svg *s, const svg_style *style, const char *element) {
    if (style->kind) sf_writer_printf(s->out, " class=\"%s\"", style->kind);
    sf_writer_printf(s->out, " fill=\"%s\"", style->fill ? style->fill : "none");
    if (style->opacity > 0) sf_writer_printf(s->out, " fill-opacity=\"%g\"", style->opacity);
    if (style->stroke)
        sf_writer_printf(s->out, " stroke=\"%s\" stroke-width=\"%.1f\" stroke-linejoin=\"round\"",
                         style->stroke, style->width);
    if (style->dashes) sf_writer_printf(s->out, " stroke-dasharray=\"%s\"", style->dashes);
    if (!style->note) {
        sf_writer_printf(s->out, "/>\n");
        return;
    }
    sf_writer_printf(s->out, "><title>");
    svg_put_text(s->out, style->note);
    sf_writer_printf(s->out, "</title></%s>\n", element);
}

static void put_points(svg *s, const char *element, const svg_point *points, size_t count,
                       const svg_style *style) {
    sf_writer_printf(s->out, "<%s points=\"", element);
    for (size_t i = 0; i < count; i++)
        sf_writer_printf(s->out, "%s%.1f,%.1f", i ? " " : "", points[i].x, points[i].y);
    sf_writer_printf(s->out, "\"");
    put_style(s, style, element);
}

void svg_polyline(svg *s, const svg_point *points, size_t count, const svg_style *style) {
    put_points(s, "polyline", points, count, style);
}

void svg_polygon(svg *s, const svg_point *points, size_t count, const svg_style *style) {
    put_points(s, "polygon", points, count, style);
}

void svg_rect(svg *s, double x, double y, double width, double height, const svg_style *style) {
    sf_writer_printf(s->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"", x, y, width,
                     height);
    put_style(s, style, "rect");
}

/* A regular polygon of the circle's area, its first corner at `turn` of a whole turn from the right. */
static size_t regular(svg_point *corners, int n, double turn) {
    const double whole = 2 * acos(-1.0), radius = sqrt(whole / (n * sin(whole / n)));
    for (int i = 0; i < n; i++) {
        double angle = whole * (turn + (double)i / n);
        corners[i] = (svg_point){radius * cos(angle), radius * sin(angle)};
    }
    return (size_t)n;
}

/* Two bars that cross, three times as long as they are wide. */
static size_t cross(svg_point *corners, double turn) {
    static const double a[12][2] = {{3, 1},   {1, 1},   {1, 3},   {-1, 3}, {-1, 1}, {-3, 1},
                                    {-3, -1}, {-1, -1}, {-1, -3}, {1, -3}, {1, -1}, {3, -1}};
    const double half_turn = acos(-1.0), unit = sqrt(half_turn / 20), c = cos(2 * half_turn * turn),
                 d = sin(2 * half_turn * turn);
    for (int i = 0; i < 12; i++)
        corners[i] = (svg_point){unit * (c * a[i][0] - d * a[i][1]), unit * (d * a[i][0] + c * a[i][1])};
    return 12;
}

void svg_mark(svg *s, svg_shape shape, double x, double y, double radius, const svg_style *style) {
    svg_point corners[12];
    size_t n = 0;
    switch (shape) {
    case SVG_SQUARE:
        n = regular(corners, 4, 0.125);
        break;
    case SVG_UP:
        n = regular(corners, 3, -0.25);
        break;
    case SVG_DIAMOND:
        n = regular(corners, 4, 0);
        break;
    case SVG_DOWN:
        n = regular(corners, 3, 0.25);
        break;
    case SVG_PLUS:
        n = cross(corners, 0);
        break;
    case SVG_PENTAGON:
        n = regular(corners, 5, -0.25);
        break;
    case SVG_CROSS:
        n = cross(corners, 0.125);
        break;
    default:
        break;
    }
    for (size_t i = 0; i < n; i++)
        corners[i] = (svg_point){x + radius * corners[i].x, y + radius * corners[i].y};
    take_box(s, x - radius, y - radius, x + radius, y + radius);
    if (n) {
        svg_polygon(s, corners, n, style);
        return;
    }
    sf_writer_printf(s->out, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"", x, y, radius);
    put_style(s, style, "circle");
}

static int is_free(const svg *s, const svg_box *b) {
    for (int i = 0; i < s->count; i++) {
        const svg_box *t = &s->taken[i];
        if (b->x0 < t->x1 && t->x0 < b->x1 && b->y0 < t->y1 && t->y0 < b->y1) return 0;
    }
    return 1;
}

void svg_label(svg *s, double x, double y, double size, const char *color, const char *text) {
    /* around the dot, then farther off: directions in units of the label's own size */
    static const double around[][2] = {{1, 0}, {-1, 0}, {0, -1}, {0, 1}, {1, -1}, {-1, -1}, {1, 1}, {-1, 1}};
    double half_width = 0.31 * size * (double)strlen(text), half_height = 0.45 * size, gap = 6;
    for (int ring = 0; ring < 6; ring++)
        for (size_t k = 0; k < sizeof around / sizeof *around; k++) {
            double far = gap + 0.8 * size * ring;
            double cx = x + around[k][0] * (half_width + far), cy = y + around[k][1] * (half_height + far);
            svg_box b = {cx - half_width, cy - half_height, cx + half_width, cy + half_height};
            if (!is_free(s, &b)) continue;
            take_box(s, b.x0 - 2, b.y0 - 2, b.x1 + 2, b.y1 + 2);
            svg_text(s, cx, cy + 0.35 * size, size, SVG_MIDDLE, color, text);
            return;
        }
}

void svg_axis_see(svg_axis *a, double value) {
    if (!isfinite(value) || (!a->linear && !(value > 0))) return;
    int first = a->least == 0 && a->most == 0;
    if (first || value < a->least) a->least = value;
    if (first || value > a->most) a->most = value;
}

/* 1, 2 and 5 of each decade. */
static double step_below(double value) {
    double decade = pow(10, floor(log10(value))), lead = value / decade;
    return decade * (lead >= 5 ? 5 : lead >= 2 ? 2 : 1);
}

static double step_above(double value) {
    double decade = pow(10, floor(log10(value))), lead = value / decade;
    return decade * (lead <= 1 ? 1 : lead <= 2 ? 2 : lead <= 5 ? 5 : 10);
}

/* Between lines of a linear axis: 1, 2 or 5 of a decade, about 50 px. */
static double linear_step(const svg_axis *a) {
    double lines = fmax(2, fabs(a->to - a->from) / 50);
    return step_above((a->most - a->least) / lines);
}

static void round_linear(svg_axis *a) {
    if (!(a->most > a->least)) a->least -= 0.5, a->most += 0.5;
    double step = linear_step(a);
    a->least = step * floor(a->least / step + 1e-9);
    a->most = step * ceil(a->most / step - 1e-9);
}

void svg_axis_round(svg_axis *a) {
    if (a->linear) {
        round_linear(a);
        return;
    }
    if (!(a->least > 0)) a->least = a->most = 1;
    a->least = step_below(a->least * 0.5);
    a->most = step_above(a->most * 1.3);
}

double svg_axis_at(const svg_axis *a, double value) {
    if (a->linear) return a->from + (a->to - a->from) * (value - a->least) / (a->most - a->least);
    return a->from + (a->to - a->from) * log(value / a->least) / log(a->most / a->least);
}

static void number(double value, char *text, size_t size) {
    if (value <= 0)
        snprintf(text, size, "%g", value + 0.0); /* no -0 */
    else if (value >= 1e9)
        snprintf(text, size, "%.0fe%d", value / pow(10, floor(log10(value) + 1e-9)),
                 (int)floor(log10(value) + 1e-9));
    else if (value >= 1e6)
        snprintf(text, size, "%gM", value * 1e-6);
    else if (value >= 1e4)
        snprintf(text, size, "%gk", value * 1e-3);
    else if (value >= 9e-3)
        snprintf(text, size, "%g", value);
    else
        snprintf(text, size, "%.0fe%d", value / pow(10, floor(log10(value) + 1e-9)),
                 (int)floor(log10(value) + 1e-9));
}

/* A line of the grid at a value, with its number beside it. */
static void grid_line(svg *s, const svg_axis *a, double from, double to, int upright, double value,
                      int numbered) {
    char text[16];
    double at = svg_axis_at(a, value);
    number(value, text, sizeof text);
    if (upright)
        svg_line(s, at, from, at, to, &(svg_style){.stroke = SVG_FAINT, .width = 0.7});
    else
        svg_line(s, from, at, to, at, &(svg_style){.stroke = SVG_FAINT, .width = 0.7});
    if (numbered && upright) svg_text(s, at, from + 16, 11, SVG_MIDDLE, SVG_INK, text);
    if (numbered && !upright) svg_text(s, from - 6, at + 4, 11, SVG_END, SVG_INK, text);
}

/* Decades from one line to the next, and from one number to the next: 24 px and 45 px at least. */
static long decades_apart(const svg_axis *a, double px) {
    double each = fabs(a->to - a->from) / log10(a->most / a->least);
    static const long steps[] = {1, 2, 5, 10, 20, 50, 100};
    size_t k = 0;
    while (k + 1 < sizeof steps / sizeof *steps && (double)steps[k] * each < px) k++;
    return steps[k];
}

/* Lines at 1, 2 and 5 where decades are few or wide; numbered at decades, and at 2 and 5 likewise. */
static void logarithmic_grid(svg *s, const svg_axis *a, double from, double to, int upright) {
    double decades = log10(a->most / a->least);
    int wide = decades <= 2.2 || fabs(a->to - a->from) >= 180 * decades;
    static const double leads[] = {1, 2, 5};
    long lines = decades > 20 ? decades_apart(a, 24) : 1, numbers = decades > 20 ? decades_apart(a, 45) : 2;
    for (double decade = pow(10, floor(log10(a->least) + 1e-9)); decade <= a->most * 1.001; decade *= 10)
        for (int k = 0; k < 3; k++) {
            double value = decade * leads[k];
            int numbered = wide || (k == 0 && (decades <= 7 || lround(log10(decade)) % numbers == 0));
            if (value < a->least * 0.999 || value > a->most * 1.001 || (k && !wide)) continue;
            if (lround(log10(decade)) % lines) continue;
            grid_line(s, a, from, to, upright, value, numbered);
        }
}

void svg_grid(svg *s, const svg_axis *a, double from, double to, int upright) {
    if (!a->linear) {
        logarithmic_grid(s, a, from, to, upright);
        return;
    }
    double step = linear_step(a), first = ceil(a->least / step - 1e-9);
    for (double i = first; i * step <= a->most + 1e-9 * step; i++)
        grid_line(s, a, from, to, upright, i * step, 1);
}

void svg_axes(svg *s, const svg_axis *x, const svg_axis *y, const char *title, const char *x_name,
              const char *y_name) {
    svg_grid(s, x, y->from, y->to, 1);
    svg_grid(s, y, x->from, x->to, 0);
    svg_line(s, x->from, y->from, x->to, y->from, &(svg_style){.stroke = SVG_INK, .width = 1});
    svg_line(s, x->from, y->from, x->from, y->to, &(svg_style){.stroke = SVG_INK, .width = 1});
    svg_text(s, x->from, y->to - 10, 13, SVG_START, SVG_INK, title);
    if (x_name) svg_text(s, 0.5 * (x->from + x->to), y->from + 34, 12, SVG_MIDDLE, SVG_INK, x_name);
    if (y_name) svg_text_up(s, x->from - 46, 0.5 * (y->from + y->to), 12, SVG_INK, y_name);
}
