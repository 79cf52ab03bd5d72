/* stability.h - experiments on where methods of this kind fail: what a row reports, and who runs it.
 *
 * A row is one failure of the field, with what is done about it here. Its experiment reports figures, each
 * with the bound that it must keep, and where a textbook form exists that form's figure beside it: textbook
 * forms live here, never in the library. A figure beyond its bound, or not a number, fails the row.
 *
 * A row is `const stab_row stab_row_<id>` in a file row_*.c, entered in STAB_ROWS below. Rows use
 * tests/testing.h for what must hold for an experiment to run at all; what is measured goes into figures.
 */
#ifndef TESTS_STABILITY_H
#define TESTS_STABILITY_H

#include "../testing.h"

#include "base/context.h"

/* clang-format off */
#define STAB_ROWS(X) \
    X(1) \
    X(2) \
    X(3) \
    X(4) \
    X(5) \
    X(6) \
    X(7) \
    X(8) \
    X(9) \
    X(10) \
    X(11) \
    X(12) \
    X(13) \
    X(14) \
    X(15) \
    X(16) \
    X(17) \
    X(18) \
    X(19) \
    X(20) \
    X(21) \
    X(22) \
    X(23) \
    X(24) \
    X(25) \
    X(A1) \
    X(A2) \
    X(A3) \
    X(A4) \
    X(A5) \
    X(A6) \
    X(S1) \
    X(S2) \
    X(L1) \
    X(L2) \
    X(L3) \
    X(L4) \
    X(L5)
/* clang-format on */

/* How much of an experiment is wanted. */
typedef enum stab_effort {
    STAB_WHOLE,   /* all that the chart shows: make stability */
    STAB_QUICK,   /* what makes the figures: make test */
    STAB_EMULATED /* SPLATFIT_QUICK: every instruction is slow; a few points that still can fail */
} stab_effort;

typedef enum stab_sense {
    STAB_AT_MOST,
    STAB_AT_LEAST,
    STAB_SHOWN /* no bound: stated for comparison */
} stab_sense;

enum { STAB_TEXT = 160 };

typedef struct stab_figure {
    char name[STAB_TEXT], unit[32];
    double value, bound;
    char known[STAB_TEXT]; /* why it is beyond its bound, where that is known; "": it is not */
    double textbook; /* the same figure of the textbook's form, if has_textbook; INFINITY: it broke down */
    int has_textbook;
    stab_sense sense;
} stab_figure;

typedef enum stab_line {
    STAB_OURS,
    STAB_TEXTBOOK, /* hollow marks, dashed */
    STAB_BOUND     /* a level across the chart: one point, its x of no meaning */
} stab_line;

typedef struct stab_series {
    char name[STAB_TEXT];
    stab_line line;
    double *x, *y;
    size_t count, room;
} stab_series;

/* An axis: name with its unit in parentheses. On a logarithmic one values <= 0 are not drawn. */
typedef struct stab_axis {
    const char *name; /* a string constant */
    int logarithmic;
} stab_axis;

typedef struct stab_chart {
    char title[STAB_TEXT];
    stab_axis x, y;
    stab_series *series;
    size_t count, room;
} stab_chart;

typedef struct stab_row stab_row;

/* An experiment at work, and then its results. */
typedef struct stab_run {
    const stab_row *row;
    stab_effort effort;
    stab_figure *figures;
    size_t figure_count, figure_room;
    stab_chart *charts;
    size_t chart_count, chart_room;
    char skipped[STAB_TEXT]; /* why it could not run; "": it did */
    double seconds;
} stab_run;

struct stab_row {
    const char *id;      /* "1", "A1" */
    const char *failure; /* in one line */
    const char *cure;    /* what is done here */
    int quick;           /* runs with make test */
    void (*run)(stab_run *run);
};

/* A figure and its bound. `name` is formatted; at most 159 bytes are kept. */
void stab_at_most(stab_run *run, double value, double bound, const char *unit, const char *name, ...)
    SF_PRINTF(5, 6);
void stab_at_least(stab_run *run, double value, double bound, const char *unit, const char *name, ...)
    SF_PRINTF(5, 6);
void stab_shown(stab_run *run, double value, const char *unit, const char *name, ...) SF_PRINTF(4, 5);
/* Marks the last figure as one that does not keep its bound yet, and why: it is shown as a known failure, and
 * does not fail the program. */
void stab_known(stab_run *run, const char *reason);
/* The textbook's figure beside the last one. */
void stab_textbook(stab_run *run, double value);

/* Begins a chart; series go to the last chart, points to the last series. */
void stab_chart_begin(stab_run *run, const char *title, stab_axis x, stab_axis y);
void stab_series_begin(stab_run *run, stab_line line, const char *name, ...) SF_PRINTF(3, 4);
/* A y that is not finite is drawn hollow at the upper edge. */
void stab_point(stab_run *run, double x, double y);
/* A level across the last chart. */
void stab_bound_line(stab_run *run, double y, const char *name);

/* Ends the experiment as one that cannot run here; return after it. */
void stab_skip(stab_run *run, const char *reason);

/* Whether a figure keeps its bound; whether all of a run's do. A run that was not skipped and has no figures
 * does not hold. */
int stab_figure_holds(const stab_figure *figure);
int stab_run_holds(const stab_run *run);
/* Whether what does not hold is known not to. */
int stab_run_is_known(const stab_run *run);
/* "skipped", "ok", "known failure", "failed". */
const char *stab_run_verdict(const stab_run *run);
/* "ok", "known failure", "FAILS"; "" of a figure without a bound. */
const char *stab_figure_verdict(const stab_figure *figure);

/* rows.c */
size_t stab_row_count(void);
const stab_row *stab_row_at(size_t index);
/* NULL: there is none of that id. */
const stab_row *stab_row_find(const char *id, size_t length);

/* run.c: makes the experiment; free its results with stab_free. */
void stab_execute(const stab_row *row, stab_effort effort, stab_run *run);
void stab_free(stab_run *run);

/* report.c */
void stab_print(const stab_run *run);
sf_status stab_write_json(sf_context *ctx, const stab_run *runs, size_t count, const char *path);
/* page.c: one page with all charts, that needs nothing else. */
sf_status stab_write_page(sf_context *ctx, const stab_run *runs, size_t count, const char *path);

#define STAB_DECLARE(id) extern const stab_row stab_row_##id;
STAB_ROWS(STAB_DECLARE)
#undef STAB_DECLARE

#endif
