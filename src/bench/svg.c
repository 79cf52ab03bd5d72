/* svg.c - a small writer of charts: text, lines, dots and logarithmic axes. */
#include "svg.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

sf_status svg_open(svg *s, sf_context *ctx, const char *path, int width, int height) {
    s->count = 0;
    sf_status status = sf_writer_open(&s->out, ctx, path);
    if (status) return status;
    sf_writer_printf(
        &s->out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" "
        "font-family=\"system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif\">\n",
        width, height, width, height);
    return SF_OK;
}

sf_status svg_close(svg *s) {
    sf_writer_printf(&s->out, "</svg>\n");
    return sf_writer_commit(&s->out);
}

static void put_escaped(svg *s, const char *text) {
    for (; *text; text++) {
        if (*text == '&')
            sf_writer_printf(&s->out, "&amp;");
        else if (*text == '<')
            sf_writer_printf(&s->out, "&lt;");
        else
            sf_writer_put(&s->out, text, 1);
    }
}

void svg_text(svg *s, double x, double y, double size, svg_anchor anchor, const char *color,
              const char *text) {
    static const char *const names[] = {"start", "middle", "end"};
    sf_writer_printf(&s->out,
                     "<text x=\"%.1f\" y=\"%.1f\" font-size=\"%.1f\" text-anchor=\"%s\" fill=\"%s\">", x, y,
                     size, names[anchor], color);
    put_escaped(s, text);
    sf_writer_printf(&s->out, "</text>\n");
}

void svg_text_up(svg *s, double x, double y, double size, const char *color, const char *text) {
    sf_writer_printf(&s->out,
                     "<text transform=\"translate(%.1f %.1f) rotate(-90)\" font-size=\"%.1f\" "
                     "text-anchor=\"middle\" fill=\"%s\">",
                     x, y, size, color);
    put_escaped(s, text);
    sf_writer_printf(&s->out, "</text>\n");
}

void svg_line(svg *s, double x0, double y0, double x1, double y1, const char *color, double width,
              const char *dashes) {
    sf_writer_printf(&s->out,
                     "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" "
                     "stroke-width=\"%.1f\" stroke-dasharray=\"%s\"/>\n",
                     x0, y0, x1, y1, color, width, dashes ? dashes : "none");
}

static void take_box(svg *s, double x0, double y0, double x1, double y1) {
    if (s->count < SVG_LABELS) s->taken[s->count++] = (svg_box){x0, y0, x1, y1};
}

void svg_dot(svg *s, double x, double y, double radius, const char *color) {
    sf_writer_printf(&s->out, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"%s\"/>\n", x, y, radius,
                     color);
    take_box(s, x - radius, y - radius, x + radius, y + radius);
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
    if (!(value > 0) || !isfinite(value)) return;
    if (a->least == 0 || value < a->least) a->least = value;
    if (value > a->most) a->most = value;
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

void svg_axis_round(svg_axis *a) {
    if (!(a->least > 0)) a->least = a->most = 1;
    a->least = step_below(a->least * 0.5);
    a->most = step_above(a->most * 1.3);
}

double svg_axis_at(const svg_axis *a, double value) {
    return a->from + (a->to - a->from) * log(value / a->least) / log(a->most / a->least);
}

static void number(double value, char *text, size_t size) {
    if (value >= 1e6)
        snprintf(text, size, "%gM", value * 1e-6);
    else if (value >= 1e4)
        snprintf(text, size, "%gk", value * 1e-3);
    else if (value >= 9e-3)
        snprintf(text, size, "%g", value);
    else
        snprintf(text, size, "%.0fe%d", value / pow(10, floor(log10(value) + 1e-9)),
                 (int)floor(log10(value) + 1e-9));
}

/* Calls for each line of the grid: numbered at decades, and at 2 and 5 where the range is short. */
static void grid(svg *s, const svg_axis *a, const svg_axis *across, int upright) {
    double decades = log10(a->most / a->least);
    static const double leads[] = {1, 2, 5};
    for (double decade = pow(10, floor(log10(a->least) + 1e-9)); decade <= a->most * 1.001; decade *= 10)
        for (int k = 0; k < 3; k++) {
            double value = decade * leads[k], at = svg_axis_at(a, value);
            int numbered = decades <= 2.2 || (k == 0 && (decades <= 7 || lround(log10(decade)) % 2 == 0));
            if (value < a->least * 0.999 || value > a->most * 1.001 || (k && decades > 2.2)) continue;
            char text[16];
            number(value, text, sizeof text);
            if (upright)
                svg_line(s, at, across->from, at, across->to, SVG_FAINT, 0.7, NULL);
            else
                svg_line(s, across->from, at, across->to, at, SVG_FAINT, 0.7, NULL);
            if (numbered && upright) svg_text(s, at, across->from + 16, 11, SVG_MIDDLE, SVG_INK, text);
            if (numbered && !upright) svg_text(s, across->from - 6, at + 4, 11, SVG_END, SVG_INK, text);
        }
}

void svg_axes(svg *s, const svg_axis *x, const svg_axis *y, const char *title, const char *x_name,
              const char *y_name) {
    grid(s, x, y, 1);
    grid(s, y, x, 0);
    svg_line(s, x->from, y->from, x->to, y->from, SVG_INK, 1, NULL);
    svg_line(s, x->from, y->from, x->from, y->to, SVG_INK, 1, NULL);
    svg_text(s, x->from, y->to - 10, 13, SVG_START, SVG_INK, title);
    if (x_name) svg_text(s, 0.5 * (x->from + x->to), y->from + 34, 12, SVG_MIDDLE, SVG_INK, x_name);
    if (y_name) svg_text_up(s, x->from - 46, 0.5 * (y->from + y->to), 12, SVG_INK, y_name);
}
