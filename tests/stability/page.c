/* page.c - the page of all experiments: a table of each one's figures, and its charts. */
#include "stability.h"

#include <math.h>
#include <stdio.h>

#include "chart/parts.h"

/* ---- one chart ------------------------------------------------------------------------------------------
 */

typedef struct plot {
    svg *s;
    const stab_chart *chart;
    svg_axis x, y;
    double legend; /* px down: of the next row */
} plot;

static int is_drawn(const stab_axis *axis, double value) {
    return isfinite(value) && (!axis->logarithmic || value > 0);
}

static void scale(plot *p) {
    const stab_chart *chart = p->chart;
    p->x = (svg_axis){.from = CHART_LEFT, .to = CHART_WIDTH - CHART_RIGHT, .linear = !chart->x.logarithmic};
    p->y = (svg_axis){.from = CHART_TOP + CHART_PLOT, .to = CHART_TOP, .linear = !chart->y.logarithmic};
    for (size_t i = 0; i < chart->count; i++) {
        const stab_series *series = &chart->series[i];
        for (size_t k = 0; k < series->count; k++) {
            if (series->line != STAB_BOUND && is_drawn(&chart->x, series->x[k]))
                svg_axis_see(&p->x, series->x[k]);
            if (is_drawn(&chart->y, series->y[k])) svg_axis_see(&p->y, series->y[k]);
        }
    }
    svg_axis_round(&p->x);
    svg_axis_round(&p->y);
}

/* Ours stand out; textbook forms are hollow. Styles count from 0 for the series that are no bounds. */
static svg_style line_style(stab_line line, size_t style) {
    if (line == STAB_BOUND) return (svg_style){.stroke = SVG_INK, .width = 1.4, .dashes = "10 5"};
    return (svg_style){.stroke = chart_color(style), .width = 1.8, .dashes = chart_dashes(style)};
}

static svg_style mark_style(stab_line line, size_t style) {
    if (line == STAB_TEXTBOOK)
        return (svg_style){.fill = "none", .stroke = chart_color(style), .width = 1.4, .kind = "mark"};
    return (svg_style){.fill = chart_color(style), .kind = "mark"};
}

static void draw_bound(plot *p, const stab_series *series) {
    if (!is_drawn(&p->chart->y, series->y[0])) return;
    double y = svg_axis_at(&p->y, series->y[0]);
    svg_line(p->s, p->x.from, y, p->x.to, y, &(svg_style){.stroke = SVG_INK, .width = 1.4, .dashes = "10 5"});
}

/* A piece of line from point `from` on, as far as points are drawn; what is not finite stands at the upper
 * edge and belongs to no line. Returns the next point. */
static size_t draw_piece(plot *p, const stab_series *series, size_t style, size_t from) {
    svg_point *points = calloc(series->count, sizeof *points);
    svg_style line = line_style(series->line, style), mark = mark_style(series->line, style);
    svg_style edge = mark_style(STAB_TEXTBOOK, style);
    size_t n = 0, k = from;
    assert_non_null(points);
    for (; k < series->count && is_drawn(&p->chart->y, series->y[k]); k++)
        points[n++] = (svg_point){svg_axis_at(&p->x, series->x[k]), svg_axis_at(&p->y, series->y[k])};
    if (n > 1) svg_polyline(p->s, points, n, &line);
    for (size_t i = 0; i < n; i++) {
        char note[2 * STAB_TEXT];
        snprintf(note, sizeof note, "%s: %.3g at %.3g", series->name, series->y[from + i],
                 series->x[from + i]);
        mark.note = note;
        if (series->count <= 60) svg_mark(p->s, chart_shape(style), points[i].x, points[i].y, 4, &mark);
    }
    free(points);
    if (k < series->count && !isfinite(series->y[k]))
        svg_mark(p->s, chart_shape(style), svg_axis_at(&p->x, series->x[k]), p->y.to, 5, &edge);
    return k + (k < series->count);
}

static void draw_series(plot *p, const stab_series *series, size_t style) {
    if (series->line == STAB_BOUND) {
        draw_bound(p, series);
        return;
    }
    for (size_t at = 0; at < series->count;) at = draw_piece(p, series, style, at);
}

static void name_series(plot *p, const stab_series *series, size_t style) {
    svg_style line = line_style(series->line, style), mark = mark_style(series->line, style);
    if (series->line == STAB_BOUND) mark = (svg_style){.fill = "none"};
    mark.kind = NULL;
    chart_legend_row(p->s, &p->legend, series->name, chart_shape(style), &line, &mark);
}

static void for_series(plot *p, void (*call)(plot *p, const stab_series *series, size_t style)) {
    size_t style = 0;
    for (size_t i = 0; i < p->chart->count; i++) {
        const stab_series *series = &p->chart->series[i];
        call(p, series, style);
        style += series->line != STAB_BOUND;
    }
}

static void draw_chart(const stab_chart *chart, sf_writer *out) {
    svg s;
    plot p = {.s = &s, .chart = chart, .legend = CHART_TOP + CHART_PLOT + 62};
    svg_begin(&s, out, CHART_WIDTH, CHART_TOP + CHART_PLOT + 54 + CHART_ROW * (int)chart->count);
    svg_text(&s, CHART_LEFT, 28, 15, SVG_START, SVG_INK, chart->title);
    scale(&p);
    svg_axes(&s, &p.x, &p.y, "", chart->x.name, chart->y.name);
    for_series(&p, draw_series);
    for_series(&p, name_series);
    svg_end(&s);
}

/* ---- the page -------------------------------------------------------------------------------------------
 */

static void put_cell(sf_writer *out, const char *tag, const char *text) {
    sf_writer_printf(out, "<%s>", tag);
    svg_put_text(out, text);
    sf_writer_printf(out, "</%s>", tag);
}

static void put_overview(sf_writer *out, const stab_run *runs, size_t count) {
    sf_writer_printf(out, "<table>\n<tr><th>row</th><th>result</th><th>s</th><th>failure</th></tr>\n");
    for (size_t i = 0; i < count; i++) {
        sf_writer_printf(out, "<tr><td><a href=\"#row-%s\">%s</a></td><td>%s</td><td>%.1f</td>",
                         runs[i].row->id, runs[i].row->id, stab_run_verdict(&runs[i]), runs[i].seconds);
        put_cell(out, "td", runs[i].row->failure);
        sf_writer_printf(out, "</tr>\n");
    }
    sf_writer_printf(out, "</table>\n");
}

static void put_figure(sf_writer *out, const stab_figure *figure) {
    sf_writer_printf(out, "<tr>");
    put_cell(out, "td", figure->name);
    sf_writer_printf(out, "<td>%.3g</td><td>", figure->value);
    if (figure->sense != STAB_SHOWN)
        sf_writer_printf(out, "%s %.3g", figure->sense == STAB_AT_MOST ? "&#8804;" : "&#8805;",
                         figure->bound);
    sf_writer_printf(out, "</td>");
    put_cell(out, "td", figure->unit);
    if (figure->has_textbook)
        sf_writer_printf(out, "<td>%.3g</td>", figure->textbook);
    else
        sf_writer_printf(out, "<td></td>");
    sf_writer_printf(out, "<td>%s", stab_figure_verdict(figure));
    if (!stab_figure_holds(figure) && figure->known[0]) {
        sf_writer_printf(out, ": ");
        svg_put_text(out, figure->known);
    }
    sf_writer_printf(out, "</td></tr>\n");
}

static void put_run(sf_writer *out, const stab_run *run) {
    sf_writer_printf(out, "<h2 id=\"row-%s\">%s. ", run->row->id, run->row->id);
    svg_put_text(out, run->row->failure);
    sf_writer_printf(out, "</h2>\n");
    put_cell(out, "p", run->row->cure);
    if (run->skipped[0]) {
        sf_writer_printf(out, "\n<p>Skipped: ");
        svg_put_text(out, run->skipped);
        sf_writer_printf(out, "</p>\n");
        return;
    }
    sf_writer_printf(out, "\n<table>\n<tr><th>figure</th><th>value</th><th>bound</th><th>unit</th>"
                          "<th>textbook</th><th></th></tr>\n");
    for (size_t i = 0; i < run->figure_count; i++) put_figure(out, &run->figures[i]);
    sf_writer_printf(out, "</table>\n");
    for (size_t i = 0; i < run->chart_count; i++) {
        sf_writer_printf(out, "<figure>\n");
        draw_chart(&run->charts[i], out);
        sf_writer_printf(out, "</figure>\n");
    }
}

sf_status stab_write_page(sf_context *ctx, const stab_run *runs, size_t count, const char *path) {
    sf_writer out;
    sf_status status = sf_writer_open(&out, ctx, path);
    if (status) return status;
    chart_page_begin(&out, "Where methods of this kind fail, and what shows it");
    sf_writer_printf(
        &out,
        "<p>splatfit %s, kernels %s. Each row is a failure seen in the field, what is done about "
        "it, and an experiment that shows whether that works. Where the textbook's form can be "
        "run beside ours its figure stands beside ours; in charts it is hollow. A mark at the "
        "upper edge is a value that is not finite.</p>\n",
        sf_version(), sf_context_isa(ctx));
    put_overview(&out, runs, count);
    for (size_t i = 0; i < count; i++) put_run(&out, &runs[i]);
    chart_page_end(&out);
    return sf_writer_commit(&out);
}
