/* report.c - experiments as a table of text and as JSON. */
#include "stability.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"

static const char *sense_text(const stab_figure *figure) {
    return figure->sense == STAB_AT_MOST ? "<=" : figure->sense == STAB_AT_LEAST ? ">=" : "";
}

static void number_text(double value, char *text, size_t size) { snprintf(text, size, "%.3g", value); }

static void print_figure(const stab_figure *figure) {
    char value[32], bound[40] = "", textbook[32] = "";
    number_text(figure->value, value, sizeof value);
    if (figure->sense != STAB_SHOWN)
        snprintf(bound, sizeof bound, "%s %.3g", sense_text(figure), figure->bound);
    if (figure->has_textbook) number_text(figure->textbook, textbook, sizeof textbook);
    printf("      %-66s %9s %10s %-9s %9s  %s\n", figure->name, value, bound, figure->unit, textbook,
           stab_figure_verdict(figure));
    if (!stab_figure_holds(figure) && figure->known[0]) printf("        known: %s\n", figure->known);
}

void stab_print(const stab_run *run) {
    printf("%-4s  %s\n", run->row->id, run->row->failure);
    if (run->skipped[0])
        printf("      skipped: %s\n", run->skipped);
    else if (!run->figure_count)
        printf("      no figure was made: FAILS\n");
    for (size_t i = 0; i < run->figure_count; i++) print_figure(&run->figures[i]);
    fflush(stdout);
}

/* What is not finite is written as a string, as JSON has no number for it. */
static json_t *number_json(double value) {
    if (isnan(value)) return json_string("nan");
    if (isinf(value)) return json_string(value > 0 ? "inf" : "-inf");
    return json_real(value);
}

static json_t *figure_json(const stab_figure *figure) {
    json_t *object = json_pack("{s:s, s:s, s:o, s:b}", "name", figure->name, "unit", figure->unit, "value",
                               number_json(figure->value), "holds", stab_figure_holds(figure));
    if (figure->sense != STAB_SHOWN)
        json_object_set_new(object, figure->sense == STAB_AT_MOST ? "at_most" : "at_least",
                            number_json(figure->bound));
    if (figure->known[0]) json_object_set_new(object, "known", json_string(figure->known));
    if (figure->has_textbook) json_object_set_new(object, "textbook", number_json(figure->textbook));
    return object;
}

static json_t *series_json(const stab_series *series) {
    static const char *const lines[] = {"ours", "textbook", "bound"};
    json_t *x = json_array(), *y = json_array();
    for (size_t i = 0; i < series->count; i++) {
        json_array_append_new(x, number_json(series->x[i]));
        json_array_append_new(y, number_json(series->y[i]));
    }
    return json_pack("{s:s, s:s, s:o, s:o}", "name", series->name, "line", lines[series->line], "x", x, "y",
                     y);
}

static json_t *chart_json(const stab_chart *chart) {
    json_t *series = json_array();
    for (size_t i = 0; i < chart->count; i++) json_array_append_new(series, series_json(&chart->series[i]));
    return json_pack("{s:s, s:s, s:s, s:o}", "title", chart->title, "x", chart->x.name, "y", chart->y.name,
                     "series", series);
}

static json_t *run_json(const stab_run *run) {
    json_t *figures = json_array(), *charts = json_array();
    for (size_t i = 0; i < run->figure_count; i++)
        json_array_append_new(figures, figure_json(&run->figures[i]));
    for (size_t i = 0; i < run->chart_count; i++) json_array_append_new(charts, chart_json(&run->charts[i]));
    json_t *object = json_pack("{s:s, s:s, s:s, s:s, s:f, s:o, s:o}", "row", run->row->id, "failure",
                               run->row->failure, "cure", run->row->cure, "result", stab_run_verdict(run),
                               "seconds", run->seconds, "figures", figures, "charts", charts);
    if (run->skipped[0]) json_object_set_new(object, "reason", json_string(run->skipped));
    return object;
}

sf_status stab_write_json(sf_context *ctx, const stab_run *runs, size_t count, const char *path) {
    sf_writer out;
    sf_status status = sf_writer_open(&out, ctx, path);
    if (status) return status;
    json_t *rows = json_array();
    for (size_t i = 0; i < count; i++) json_array_append_new(rows, run_json(&runs[i]));
    json_t *root =
        json_pack("{s:s, s:s, s:o}", "version", sf_version(), "isa", sf_context_isa(ctx), "rows", rows);
    char *text = json_dumps(root, JSON_INDENT(1) | JSON_REAL_PRECISION(6));
    json_decref(root);
    if (!text) {
        sf_writer_abandon(&out);
        return SF_ERR_MEMORY;
    }
    sf_writer_put(&out, text, strlen(text));
    sf_writer_put(&out, "\n", 1);
    free(text);
    return sf_writer_commit(&out);
}
