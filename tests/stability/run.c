/* run.c - an experiment at work: collects its figures and its charts. */
#include "stability.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"

/* Room for one more. */
static void *grown(void *list, size_t count, size_t *room, size_t size) {
    if (count < *room) return list;
    *room = *room ? 2 * *room : 8;
    list = realloc(list, *room * size);
    assert_non_null(list);
    return list;
}

static stab_figure *add_figure(stab_run *run, const char *unit, const char *name, va_list list) {
    run->figures = grown(run->figures, run->figure_count, &run->figure_room, sizeof *run->figures);
    stab_figure *figure = &run->figures[run->figure_count++];
    *figure = (stab_figure){.textbook = NAN};
    vsnprintf(figure->name, sizeof figure->name, name, list);
    snprintf(figure->unit, sizeof figure->unit, "%s", unit);
    return figure;
}

void stab_at_most(stab_run *run, double value, double bound, const char *unit, const char *name, ...) {
    va_list list;
    va_start(list, name);
    stab_figure *figure = add_figure(run, unit, name, list);
    va_end(list);
    figure->value = value, figure->bound = bound, figure->sense = STAB_AT_MOST;
}

void stab_at_least(stab_run *run, double value, double bound, const char *unit, const char *name, ...) {
    va_list list;
    va_start(list, name);
    stab_figure *figure = add_figure(run, unit, name, list);
    va_end(list);
    figure->value = value, figure->bound = bound, figure->sense = STAB_AT_LEAST;
}

void stab_shown(stab_run *run, double value, const char *unit, const char *name, ...) {
    va_list list;
    va_start(list, name);
    stab_figure *figure = add_figure(run, unit, name, list);
    va_end(list);
    figure->value = value, figure->bound = NAN, figure->sense = STAB_SHOWN;
}

void stab_known(stab_run *run, const char *reason) {
    assert_true(run->figure_count > 0);
    stab_figure *figure = &run->figures[run->figure_count - 1];
    snprintf(figure->known, sizeof figure->known, "%s", reason);
}

void stab_textbook(stab_run *run, double value) {
    assert_true(run->figure_count > 0);
    run->figures[run->figure_count - 1].textbook = value;
    run->figures[run->figure_count - 1].has_textbook = 1;
}

void stab_chart_begin(stab_run *run, const char *title, stab_axis x, stab_axis y) {
    run->charts = grown(run->charts, run->chart_count, &run->chart_room, sizeof *run->charts);
    stab_chart *chart = &run->charts[run->chart_count++];
    *chart = (stab_chart){.x = x, .y = y};
    snprintf(chart->title, sizeof chart->title, "%s", title);
}

void stab_series_begin(stab_run *run, stab_line line, const char *name, ...) {
    assert_true(run->chart_count > 0);
    stab_chart *chart = &run->charts[run->chart_count - 1];
    chart->series = grown(chart->series, chart->count, &chart->room, sizeof *chart->series);
    stab_series *series = &chart->series[chart->count++];
    *series = (stab_series){.line = line};
    va_list list;
    va_start(list, name);
    vsnprintf(series->name, sizeof series->name, name, list);
    va_end(list);
}

void stab_point(stab_run *run, double x, double y) {
    assert_true(run->chart_count > 0 && run->charts[run->chart_count - 1].count > 0);
    stab_chart *chart = &run->charts[run->chart_count - 1];
    stab_series *series = &chart->series[chart->count - 1];
    size_t room = series->room;
    series->x = grown(series->x, series->count, &room, sizeof *series->x);
    series->y = grown(series->y, series->count, &series->room, sizeof *series->y);
    series->x[series->count] = x;
    series->y[series->count++] = y;
}

void stab_bound_line(stab_run *run, double y, const char *name) {
    stab_series_begin(run, STAB_BOUND, "%s", name);
    stab_point(run, 0, y);
}

void stab_skip(stab_run *run, const char *reason) {
    snprintf(run->skipped, sizeof run->skipped, "%s", reason);
}

int stab_figure_holds(const stab_figure *figure) {
    switch (figure->sense) {
    case STAB_AT_MOST:
        return figure->value <= figure->bound;
    case STAB_AT_LEAST:
        return figure->value >= figure->bound;
    case STAB_SHOWN:
        break;
    }
    return 1;
}

int stab_run_holds(const stab_run *run) {
    if (run->skipped[0]) return 1;
    for (size_t i = 0; i < run->figure_count; i++)
        if (!stab_figure_holds(&run->figures[i])) return 0;
    return run->figure_count > 0;
}

int stab_run_is_known(const stab_run *run) {
    for (size_t i = 0; i < run->figure_count; i++)
        if (!stab_figure_holds(&run->figures[i]) && !run->figures[i].known[0]) return 0;
    return run->skipped[0] || run->figure_count > 0;
}

const char *stab_run_verdict(const stab_run *run) {
    return run->skipped[0]          ? "skipped"
           : stab_run_holds(run)    ? "ok"
           : stab_run_is_known(run) ? "known failure"
                                    : "failed";
}

const char *stab_figure_verdict(const stab_figure *figure) {
    if (figure->sense == STAB_SHOWN) return "";
    return stab_figure_holds(figure) ? "ok" : figure->known[0] ? "known failure" : "FAILS";
}

void stab_execute(const stab_row *row, stab_effort effort, stab_run *run) {
    *run = (stab_run){.row = row, .effort = effort};
    double start = sf_clock();
    row->run(run);
    run->seconds = sf_clock() - start;
}

void stab_free(stab_run *run) {
    for (size_t c = 0; c < run->chart_count; c++) {
        for (size_t i = 0; i < run->charts[c].count; i++) {
            free(run->charts[c].series[i].x);
            free(run->charts[c].series[i].y);
        }
        free(run->charts[c].series);
    }
    free(run->charts);
    free(run->figures);
    *run = (stab_run){0};
}
